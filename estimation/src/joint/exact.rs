//! Closures beyond the plate's freedoms at measured poses, which exact drives hold: bounds that a model meets or misses.
//!
//! No motion of the plate changes what is left of these closures, so measured poses say nothing of it, and where drives are
//! exact nothing else has noise. Where the model is right it is zero, and counts neither as residual nor as noise; it binds
//! parameters. Where the model lacks something, parameters that would meet the bounds at any price miss the poses: then
//! such closures are as noisy as the others.

use tau_robot::robot_file::Noise;

use super::descent::Descent;
use super::{Component, Joint};
use crate::machine::error::Error;
use crate::machine::prepared::Prepared;
use crate::problem::{CLOSURE_SHARE, Part};
use crate::samples::Sample;

impl Joint {
    /// The whitening of each pose of set 1, by rows, in order.
    pub fn closure_factors(&self) -> impl Iterator<Item = &[f64]> {
        self.closure_data().map(|(_, factor)| factor)
    }

    /// The same, with the data that all closures take of the pose before it.
    pub(crate) fn closure_data(&self) -> impl Iterator<Item = (&[f64], &[f64])> {
        let is_of_closures = |part: &&Part| part.components.first() == Some(&Component::Closure);
        let parts = self.parts.iter().map(|rows| &rows.part);
        parts.filter(is_of_closures).flat_map(|part| {
            let (rows, width) = (part.components.len(), part.family.shape().data);
            let samples = part.data.chunks_exact(width);
            samples.map(move |data| data.split_at(width - rows * rows))
        })
    }

    /// True if there are such closures, and they are taken for exact.
    pub fn has_exact(&self) -> bool {
        (self.rows.iter()).any(|row| row.component == Component::Exact)
    }

    /// The same with these closures among those that have noise, at a share of their stated weight: [`CLOSURE_SHARE`] makes
    /// them as noisy as the others.
    #[must_use]
    pub fn without_exact(mut self, share: f64) -> Self {
        if !self.has_exact() {
            return self;
        }
        for row in &mut self.rows {
            if row.component == Component::Exact {
                row.component = Component::Closure;
                row.share = share;
            }
        }
        self.groups = self.groups();
        self
    }

    /// True if residuals, in units of the stated noise, miss the bounds.
    pub fn misses_exact(&self, residuals: &[f64]) -> bool {
        let [_, (squares, count)] = self.by_exactness(residuals);
        squares > count as f64
    }

    /// Sum of squares and number of the residuals that count: of those that have noise, and where they are missed of the
    /// exact ones.
    pub(crate) fn counted(&self, residuals: &[f64]) -> (f64, usize) {
        let [noisy, exact] = self.by_exactness(residuals);
        if self.misses_exact(residuals) {
            (noisy.0 + exact.0, noisy.1 + exact.1)
        } else {
            noisy
        }
    }

    /// Sum of squares and number of the residuals that have noise, and of exact ones.
    fn by_exactness(&self, residuals: &[f64]) -> [(f64, usize); 2] {
        let mut found = [(0.0, 0); 2];
        for (row, residual) in self.rows.iter().zip(residuals) {
            let own = &mut found[usize::from(row.component == Component::Exact)];
            own.0 += residual * residual;
            own.1 += 1;
        }
        found
    }

    /// Number of residuals of the first sample that have noise: of measured poses, those of each.
    pub(crate) fn noisy_closures(&self) -> usize {
        let first = self.rows.first().map(|row| row.sample);
        let own = self.rows.iter().take_while(|row| Some(row.sample) == first);
        own.filter(|row| row.component != Component::Exact).count()
    }
}

/// The descent of the closures of measured poses to their minimum from values of a variant, in so many iterations at most;
/// `weights` are those of the samples.
///
/// # Errors
/// Data that closures take are missing; derivatives that are not finite.
pub(crate) fn descent(
    prepared: &Prepared,
    start: &[f64],
    samples: &[Sample],
    noise: Noise,
    (weights, iterations): (Vec<f64>, usize),
) -> Result<Descent, Error> {
    let whitened_at = |values: &[f64]| {
        let machine = prepared.machine.with_values(values.to_vec());
        let joint = Joint::new(machine, &prepared.nominal, samples, noise)?;
        Ok::<_, Error>(joint.with_path_noise(samples, noise.position_m))
    };
    let begun = |joint: Joint, values: &[f64]| {
        let start = joint.fitted(values);
        Descent::from(joint, start, [1.0; 4], weights.clone())
    };
    let joint = whitened_at(&prepared.machine.values)?;
    if !joint.has_exact() {
        return begun(joint, start)?.approached(iterations);
    }
    // Which closures the plate's motions leave follows from where the machine is.
    let near = begun(joint.without_exact(CLOSURE_SHARE), start)?.approached(iterations)?;
    let values = near.joint.values(&near.fitted);
    let joint = whitened_at(&values)?;
    let bound = begun(joint.clone(), &values)?.approached(iterations)?;
    let plain = bound.joint.factors(&[1.0; 4], &vec![1.0; samples.len()]);
    let residuals = bound.joint.residuals(&bound.fitted, &plain);
    if bound.joint.misses_exact(residuals.as_slice()) {
        begun(joint.without_exact(CLOSURE_SHARE), &values)?.approached(iterations)
    } else {
        Ok(bound)
    }
}
