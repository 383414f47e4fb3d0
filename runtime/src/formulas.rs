//! The parts of generated code, and the residual family made of them.
//!
//! Each formula is written once, generic over what holds the numbers; single-sample functions and loops over lanes
//! are made of it here. Preparation stays per sample, since trigonometry is most of it.

use core::marker::PhantomData;

use crate::lanes::{Kernel, LANES, Lanes, Samples, block_count, vectorized};
use crate::{BlockFamily, Pattern, ResidualFamily, Shape};

/// The formulas of a residual family, written once for single samples and for blocks.
///
/// Every function computes the sample in `lane` and touches no other. The slices have the lengths that
/// [`Self::SHAPE`] and [`Self::PATTERN`] give.
pub trait Formulas: Send + Sync {
    /// The sizes of all slices.
    const SHAPE: Shape;
    /// The structural non-zeros of the Jacobian.
    const PATTERN: Pattern<'static>;

    /// Writes what depends on the sample's data only; `data` are those of this sample.
    fn prepare<S: Samples>(lane: usize, data: &[f64], prepared: &mut [S]);

    /// Writes the residuals.
    fn value<S: Samples>(lane: usize, prepared: &[S], parameters: &[f64], residuals: &mut [S]);

    /// Writes the residuals and the Jacobian's entries.
    fn linearize<S: Samples>(
        lane: usize,
        prepared: &[S],
        parameters: &[f64],
        residuals: &mut [S],
        jacobian: &mut [S],
    );
}

/// Numbers of one sample.
#[inline]
fn single(numbers: &[f64]) -> &[[f64; 1]] {
    numbers.as_chunks().0
}

#[inline]
fn single_mut(numbers: &mut [f64]) -> &mut [[f64; 1]] {
    numbers.as_chunks_mut().0
}

/// Checks the lengths once, so that the compiler can drop the bounds checks of all later accesses.
macro_rules! check_lengths {
    ($($slice:ident: $length:expr),* $(,)?) => {
        $(assert!($slice.len() == $length, concat!("wrong length of `", stringify!($slice), "`"));)*
    };
}

impl<F: Formulas> ResidualFamily for F {
    fn shape(&self) -> Shape {
        F::SHAPE
    }

    fn pattern(&self) -> Pattern<'_> {
        F::PATTERN
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        check_lengths!(data: F::SHAPE.data, prepared: F::SHAPE.prepared);
        F::prepare(0, data, single_mut(prepared));
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        check_lengths!(
            prepared: F::SHAPE.prepared,
            parameters: F::SHAPE.parameters,
            residuals: F::SHAPE.residuals,
        );
        F::value(0, single(prepared), parameters, single_mut(residuals));
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        check_lengths!(
            prepared: F::SHAPE.prepared,
            parameters: F::SHAPE.parameters,
            residuals: F::SHAPE.residuals,
            jacobian: F::PATTERN.len(),
        );
        F::linearize(
            0,
            single(prepared),
            parameters,
            single_mut(residuals),
            single_mut(jacobian),
        );
    }

    fn blocks(&self) -> Option<&dyn BlockFamily> {
        Some(self)
    }

    // Lengths are checked once for all samples, so that their loop holds nothing but formulas.

    fn value_all(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let (width, rows) = (F::SHAPE.prepared, F::SHAPE.residuals);
        check_lengths!(parameters: F::SHAPE.parameters);
        for (sample, residuals) in residuals.chunks_exact_mut(rows).enumerate() {
            let prepared = single(&prepared[sample * width..][..width]);
            F::value(0, prepared, parameters, single_mut(residuals));
        }
    }

    fn linearize_all(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (width, rows, entries) = (F::SHAPE.prepared, F::SHAPE.residuals, F::PATTERN.len());
        check_lengths!(parameters: F::SHAPE.parameters);
        for (sample, residuals) in residuals.chunks_exact_mut(rows).enumerate() {
            let prepared = single(&prepared[sample * width..][..width]);
            let jacobian = single_mut(&mut jacobian[sample * entries..][..entries]);
            F::linearize(0, prepared, parameters, single_mut(residuals), jacobian);
        }
    }
}

impl<F: Formulas> BlockFamily for F {
    fn prepare_blocks(&self, data: &[f64], prepared: &mut [Lanes]) {
        let (width, entries) = (F::SHAPE.data, F::SHAPE.prepared);
        if entries == 0 {
            return;
        }
        // Without data there is one sample; constants may still have to be prepared.
        let samples = data.len().checked_div(width).unwrap_or(1);
        check_lengths!(prepared: block_count(samples) * entries);
        for (block, prepared) in prepared.chunks_exact_mut(entries).enumerate() {
            for lane in 0..LANES {
                // Lanes past the end repeat the last sample: no special values, no branches.
                let sample = (block * LANES + lane).min(samples - 1);
                F::prepare(lane, &data[sample * width..(sample + 1) * width], prepared);
            }
        }
    }

    fn value_blocks(&self, prepared: &[Lanes], parameters: &[f64], residuals: &mut [Lanes]) {
        vectorized(
            Value::<F>(PhantomData),
            prepared,
            parameters,
            residuals,
            &mut [],
        );
    }

    fn linearize_blocks(
        &self,
        prepared: &[Lanes],
        parameters: &[f64],
        residuals: &mut [Lanes],
        jacobian: &mut [Lanes],
    ) {
        vectorized(
            Linearize::<F>(PhantomData),
            prepared,
            parameters,
            residuals,
            jacobian,
        );
    }
}

// Blocks come from iterators that cannot fail: where a loop could panic before it reads the parameters, the compiler
// computes what depends on them alone, such as sines of angles that are fitted, anew for each block.

struct Value<F>(PhantomData<F>);

impl<F: Formulas> Kernel for Value<F> {
    #[inline(always)]
    fn run(self, prepared: &[Lanes], parameters: &[f64], residuals: &mut [Lanes], _: &mut [Lanes]) {
        let width = F::SHAPE.prepared;
        check_lengths!(parameters: F::SHAPE.parameters);
        let prepared = &prepared[..residuals.len() / F::SHAPE.residuals * width];
        let blocks = residuals.chunks_exact_mut(F::SHAPE.residuals);
        if width == 0 {
            // Residuals of nothing that was measured.
            for residuals in blocks {
                values::<F>(prepared, parameters, residuals);
            }
            return;
        }
        for (residuals, prepared) in blocks.zip(prepared.chunks_exact(width)) {
            values::<F>(prepared, parameters, residuals);
        }
    }
}

/// Values of one block.
#[inline(always)]
fn values<F: Formulas>(prepared: &[Lanes], parameters: &[f64], residuals: &mut [Lanes]) {
    for lane in 0..LANES {
        F::value(lane, prepared, parameters, residuals);
    }
}

struct Linearize<F>(PhantomData<F>);

impl<F: Formulas> Kernel for Linearize<F> {
    #[inline(always)]
    fn run(
        self,
        prepared: &[Lanes],
        parameters: &[f64],
        residuals: &mut [Lanes],
        jacobian: &mut [Lanes],
    ) {
        let (width, entries) = (F::SHAPE.prepared, F::PATTERN.len());
        if width == 0 || entries == 0 {
            // Residuals of nothing that was measured, or of nothing that is fitted.
            for (block, residuals) in residuals.chunks_exact_mut(F::SHAPE.residuals).enumerate() {
                let prepared = &prepared[block * width..][..width];
                let jacobian = &mut jacobian[block * entries..][..entries];
                derivatives::<F>(prepared, parameters, residuals, jacobian);
            }
            return;
        }
        check_lengths!(parameters: F::SHAPE.parameters);
        let count = residuals.len() / F::SHAPE.residuals;
        let (prepared, jacobian) = (&prepared[..count * width], &mut jacobian[..count * entries]);
        let blocks = residuals.chunks_exact_mut(F::SHAPE.residuals);
        let blocks = blocks.zip(jacobian.chunks_exact_mut(entries));
        for ((residuals, jacobian), prepared) in blocks.zip(prepared.chunks_exact(width)) {
            derivatives::<F>(prepared, parameters, residuals, jacobian);
        }
    }
}

/// Values and derivatives of one block.
#[inline(always)]
fn derivatives<F: Formulas>(
    prepared: &[Lanes],
    parameters: &[f64],
    residuals: &mut [Lanes],
    jacobian: &mut [Lanes],
) {
    for lane in 0..LANES {
        F::linearize(lane, prepared, parameters, residuals, jacobian);
    }
}
