//! Residual families: functions of a sample's data and of parameters, with their Jacobian.

use core::fmt;

use crate::lanes::Lanes;

/// The sizes of a residual family.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shape {
    /// Numbers that a sample brings (commands, measured coordinates, loads).
    pub data: usize,
    /// Numbers that [`ResidualFamily::prepare`] makes of them, once per sample.
    pub prepared: usize,
    /// Parameters that the residuals depend on.
    pub parameters: usize,
    /// Residuals per sample.
    pub residuals: usize,
}

/// Places of a Jacobian's entries, in compressed rows.
///
/// Row `i` holds the entries `row_starts[i]..row_starts[i + 1]`; `columns` gives the parameter of each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Pattern<'a> {
    /// Start of each row in `columns`, and the number of entries at the end.
    pub row_starts: &'a [u32],
    /// Parameter index of each entry, ascending within a row.
    pub columns: &'a [u32],
}

impl Pattern<'_> {
    /// The number of entries that are not structurally zero.
    pub const fn len(&self) -> usize {
        self.columns.len()
    }

    /// True if no residual depends on any parameter.
    pub const fn is_empty(&self) -> bool {
        self.columns.is_empty()
    }
}

/// Residuals of one sample as a function of parameters, with a Jacobian of fixed sparsity.
///
/// The work is staged. [`prepare`](Self::prepare) does everything that depends on the sample's data
/// alone (the trigonometry of measured angles, interpolation weights) and is called once per sample;
/// [`value`](Self::value) and [`linearize`](Self::linearize) do the rest at every iteration.
///
/// All slices have exactly the lengths given by [`shape`](Self::shape) and [`pattern`](Self::pattern);
/// implementations may panic on others.
pub trait ResidualFamily: Send + Sync {
    /// The sizes of all slices.
    fn shape(&self) -> Shape;

    /// The structural non-zeros of the Jacobian.
    fn pattern(&self) -> Pattern<'_>;

    /// Writes what depends on the sample's data only.
    fn prepare(&self, data: &[f64], prepared: &mut [f64]);

    /// Writes the residuals of one prepared sample.
    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]);

    /// Writes the residuals and the Jacobian's entries, in the order of [`pattern`](Self::pattern).
    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    );

    /// The same functions on blocks of samples, where the family has them.
    fn blocks(&self) -> Option<&dyn BlockFamily> {
        None
    }

    /// [`prepare`](Self::prepare) for many samples, one after the other in each slice.
    fn prepare_all(&self, data: &[f64], prepared: &mut [f64]) {
        let shape = self.shape();
        if shape.prepared == 0 {
            return;
        }
        for (sample, prepared) in prepared.chunks_exact_mut(shape.prepared).enumerate() {
            self.prepare(
                &data[sample * shape.data..(sample + 1) * shape.data],
                prepared,
            );
        }
    }

    /// [`value`](Self::value) for many samples.
    fn value_all(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let shape = self.shape();
        for (sample, residuals) in residuals.chunks_exact_mut(shape.residuals).enumerate() {
            let prepared = &prepared[sample * shape.prepared..(sample + 1) * shape.prepared];
            self.value(prepared, parameters, residuals);
        }
    }

    /// [`linearize`](Self::linearize) for many samples.
    fn linearize_all(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let shape = self.shape();
        let entries = self.pattern().len();
        for (sample, residuals) in residuals.chunks_exact_mut(shape.residuals).enumerate() {
            let prepared = &prepared[sample * shape.prepared..(sample + 1) * shape.prepared];
            let jacobian = &mut jacobian[sample * entries..(sample + 1) * entries];
            self.linearize(prepared, parameters, residuals, jacobian);
        }
    }

    /// [`value`](Self::value) for many samples whose last parameters are each sample's own: `shared` are those that come
    /// before them, `own` the others, one sample after the other.
    #[cfg(feature = "std")]
    fn value_each(&self, prepared: &[f64], shared: &[f64], own: &[f64], residuals: &mut [f64]) {
        let shape = self.shape();
        let mut parameters = shared.to_vec();
        let own_each = shape.parameters - shared.len();
        for (sample, residuals) in residuals.chunks_exact_mut(shape.residuals).enumerate() {
            let prepared = &prepared[sample * shape.prepared..(sample + 1) * shape.prepared];
            parameters.truncate(shared.len());
            parameters.extend_from_slice(&own[sample * own_each..(sample + 1) * own_each]);
            self.value(prepared, &parameters, residuals);
        }
    }

    /// [`linearize`](Self::linearize) for such samples.
    #[cfg(feature = "std")]
    fn linearize_each(
        &self,
        prepared: &[f64],
        shared: &[f64],
        own: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (shape, entries) = (self.shape(), self.pattern().len());
        let mut parameters = shared.to_vec();
        let own_each = shape.parameters - shared.len();
        for (sample, residuals) in residuals.chunks_exact_mut(shape.residuals).enumerate() {
            let prepared = &prepared[sample * shape.prepared..(sample + 1) * shape.prepared];
            let jacobian = &mut jacobian[sample * entries..(sample + 1) * entries];
            parameters.truncate(shared.len());
            parameters.extend_from_slice(&own[sample * own_each..(sample + 1) * own_each]);
            self.linearize(prepared, &parameters, residuals, jacobian);
        }
    }
}

/// The sizes alone.
impl fmt::Debug for dyn ResidualFamily + '_ {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.shape().fmt(f)
    }
}

/// A residual family that computes blocks of [`LANES`](crate::LANES) samples at once.
///
/// Numbers of a block stand together: block 0 has all its prepared values, then block 1, and each value
/// is [`Lanes`], one number of each sample. So a block is read and written in few streams, and every
/// operation is one of vectors. Results equal those of single samples bit for bit.
pub trait BlockFamily: ResidualFamily {
    /// [`prepare`](ResidualFamily::prepare) for the samples in `data`, one after the other, into
    /// [`block_count(samples)`](crate::block_count) blocks; lanes past the end repeat the last sample.
    /// A family without data has one sample.
    fn prepare_blocks(&self, data: &[f64], prepared: &mut [Lanes]);

    /// [`value`](ResidualFamily::value) for as many blocks as `residuals` holds.
    fn value_blocks(&self, prepared: &[Lanes], parameters: &[f64], residuals: &mut [Lanes]);

    /// [`linearize`](ResidualFamily::linearize) for as many blocks as `residuals` holds.
    fn linearize_blocks(
        &self,
        prepared: &[Lanes],
        parameters: &[f64],
        residuals: &mut [Lanes],
        jacobian: &mut [Lanes],
    );
}
