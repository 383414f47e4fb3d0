//! Random numbers that are the same on every machine and in every release.

use std::f64::consts::TAU;

use nalgebra::{Rotation3, Vector3};
use tau_robot::fingerprint::hash;

/// Streams of random numbers.
#[derive(Debug, Clone)]
pub(crate) struct Random(tau_robot::random::Random);

impl Random {
    /// A stream of its own for each purpose: a change of the noise leaves the machine as it is.
    pub(crate) fn new(seed: u64, purpose: &str) -> Self {
        let mut random = tau_robot::random::Random(seed ^ hash(purpose.as_bytes()));
        random.bits();
        Self(random)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        self.0.uniform()
    }

    /// Uniform between two limits.
    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    /// −1 or +1.
    pub(crate) fn sign(&mut self) -> f64 {
        self.0.sign()
    }

    /// Standard normal (Box and Muller).
    pub(crate) fn normal(&mut self) -> f64 {
        (-2.0 * (1.0 - self.unit()).ln()).sqrt() * (TAU * self.unit()).cos()
    }

    /// Student's t of three degrees of freedom, scaled to variance one.
    pub(crate) fn student3(&mut self) -> f64 {
        let square: f64 = (0..3).map(|_| self.normal().powi(2)).sum();
        // t has variance 3 and is normal / √(square / 3): the two threes cancel.
        self.normal() / square.sqrt()
    }

    /// Three independent standard normals.
    pub(crate) fn normals(&mut self) -> Vector3<f64> {
        Vector3::from_fn(|_, _| self.normal())
    }

    /// A direction, uniform on the sphere.
    pub(crate) fn direction(&mut self) -> Vector3<f64> {
        self.normals()
            .try_normalize(1e-9)
            .unwrap_or_else(Vector3::x)
    }

    /// A rotation about a random axis by an angle uniform in [−π, π).
    pub(crate) fn rotation(&mut self) -> Rotation3<f64> {
        let angle = self.uniform(-TAU / 2.0, TAU / 2.0);
        Rotation3::new(self.direction() * angle)
    }

    /// The places of `count` out of `total`, ascending.
    pub(crate) fn sample(&mut self, count: usize, total: usize) -> Vec<usize> {
        let mut left = count.min(total);
        (0..total)
            .filter(|&index| {
                let taken = self.unit() * ((total - index) as f64) < left as f64;
                left -= usize::from(taken);
                taken
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Mean and variance of many draws.
    fn moments(mut draw: impl FnMut() -> f64) -> (f64, f64) {
        let values: Vec<f64> = (0..200_000).map(|_| draw()).collect();
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64;
        (mean, variance)
    }

    #[test]
    fn normals_have_mean_zero_and_variance_one() {
        let mut random = Random::new(1, "test");
        let (mean, variance) = moments(|| random.normal());
        assert!(
            mean.abs() < 0.01 && (variance - 1.0).abs() < 0.015,
            "{mean} {variance}"
        );
    }

    #[test]
    fn students_t_has_heavy_tails_and_variance_one() {
        let mut random = Random::new(2, "test");
        let far = (0..200_000)
            .filter(|_| random.student3().abs() > 4.0)
            .count() as f64
            / 2e5;
        // P(|t3| > 4√3) = 0.00617; of a normal it would be 0.00006.
        assert!((far - 0.0062).abs() < 0.0008, "{far}");
        // The fourth moment is infinite, so that the variance settles slowly.
        let (_, variance) = moments(|| random.student3());
        assert!((0.8..1.3).contains(&variance), "{variance}");
    }

    #[test]
    fn streams_differ_by_purpose_and_seed() {
        let first = |seed, purpose| Random::new(seed, purpose).0.bits();
        assert_eq!(first(1, "a"), first(1, "a"));
        assert_ne!(first(1, "a"), first(1, "b"));
        assert_ne!(first(1, "a"), first(2, "a"));
    }

    #[test]
    fn a_sample_has_its_size_and_no_place_twice() {
        let mut random = Random::new(3, "test");
        for count in [0, 1, 7, 20, 30] {
            let sample = random.sample(count, 20);
            assert_eq!(sample.len(), count.min(20));
            assert!(sample.windows(2).all(|pair| pair[0] < pair[1]));
        }
    }
}
