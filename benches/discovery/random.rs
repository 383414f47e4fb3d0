//! Random numbers of a trial, by its seed and purpose.

use std::f64::consts::TAU;

use tau_estimation::numerics::distribution;

/// A stream of random numbers.
pub(crate) struct Random(distribution::Random);

impl Random {
    /// A stream of its own for each purpose.
    pub(crate) fn new(seed: u64, purpose: &str) -> Self {
        let mut random = distribution::Random(seed ^ fnv(purpose));
        random.bits();
        Self(random)
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.0.bits()
    }

    /// Evenly between two limits.
    pub(crate) fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.uniform()
    }

    pub(crate) fn chance(&mut self) -> bool {
        self.uniform(0.0, 1.0) < 0.5
    }

    /// A number from zero, evenly below a limit.
    pub(crate) fn below(&mut self, limit: usize) -> usize {
        (self.bits() % limit as u64) as usize
    }

    /// One of several.
    pub(crate) fn choose<'a, T>(&mut self, items: &'a [T]) -> &'a T {
        &items[self.below(items.len())]
    }

    /// A direction in space.
    pub(crate) fn axis(&mut self) -> [f64; 3] {
        let direction = self.direction(3);
        std::array::from_fn(|axis| direction[axis])
    }

    /// A direction of unit length, all alike.
    pub(crate) fn direction(&mut self, components: usize) -> Vec<f64> {
        let normals: Vec<f64> = (0..components).map(|_| self.normal()).collect();
        let norm = normals.iter().map(|x| x * x).sum::<f64>().sqrt();
        normals.iter().map(|x| x / norm).collect()
    }

    /// Standard normal (Box and Muller).
    fn normal(&mut self) -> f64 {
        let radius = (-2.0 * (1.0 - self.uniform(0.0, 1.0)).ln()).sqrt();
        radius * (TAU * self.uniform(0.0, 1.0)).cos()
    }
}

/// FNV-1a.
fn fnv(text: &str) -> u64 {
    text.bytes().fold(0xcbf2_9ce4_8422_2325, |hash: u64, byte| {
        (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
    })
}
