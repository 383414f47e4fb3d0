//! Blocks of samples, and the instruction set they are computed with.
//!
//! Values of eight samples stand side by side ([`Lanes`], a cache line), block after block: a block is few streams,
//! and every operation is one of vectors. The compiler vectorises the loops over lanes where it knows that the
//! slices do not overlap, which it knows of function arguments and of nothing else: hence the form of [`Kernel`].
//!
//! The instruction set is chosen at run time. A build for any x86-64 holds each loop three times and takes AVX-512
//! or AVX2 where the machine has it; with two lanes an instruction, a closure residual with its ten derivatives
//! takes about twice as long as with AVX2.

use core::ops::{Index, IndexMut};

/// Samples per block.
pub const LANES: usize = 8;

/// One number of each sample of a block, side by side: a cache line.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
#[repr(C, align(64))]
pub struct Lanes(pub [f64; LANES]);

impl Lanes {
    /// Zero in every lane.
    pub const ZERO: Self = Self([0.0; LANES]);

    /// The same number in every lane.
    #[inline(always)]
    pub const fn splat(value: f64) -> Self {
        Self([value; LANES])
    }

    /// Sum over the lanes, in one order on every machine.
    pub fn sum(&self) -> f64 {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }
}

impl Index<usize> for Lanes {
    type Output = f64;

    #[inline(always)]
    fn index(&self, lane: usize) -> &f64 {
        &self.0[lane]
    }
}

impl IndexMut<usize> for Lanes {
    #[inline(always)]
    fn index_mut(&mut self, lane: usize) -> &mut f64 {
        &mut self.0[lane]
    }
}

/// One number of one or more samples: `[f64; 1]` for a single sample, [`Lanes`] for a block.
pub trait Samples: IndexMut<usize, Output = f64> {}

impl Samples for [f64; 1] {}
impl Samples for Lanes {}

/// Blocks that hold so many samples; the last one may be partly filled.
pub const fn block_count(samples: usize) -> usize {
    samples.div_ceil(LANES)
}

/// Work over blocks that is worth a wider instruction set.
///
/// [`Self::run`] and all that it calls in its loops must be `#[inline(always)]`, so that
/// [`vectorized`] can compile it for the instruction set it finds. What it reads and writes comes as
/// arguments and not in `self`: of arguments alone the compiler knows that they do not overlap, and
/// without that it vectorises no loop.
pub trait Kernel {
    /// Does the work.
    fn run(
        self,
        inputs: &[Lanes],
        parameters: &[f64],
        outputs: &mut [Lanes],
        more_outputs: &mut [Lanes],
    );
}

/// Runs a kernel with the widest instruction set that the machine has.
///
/// On x86-64 that is AVX-512 or AVX2, asked for at run time, so that a build for any machine uses it. Lanes
/// are independent and multiply-add is not fused: the results are the same bit for bit whichever it is.
#[inline]
pub fn vectorized<K: Kernel>(
    kernel: K,
    inputs: &[Lanes],
    parameters: &[f64],
    outputs: &mut [Lanes],
    more_outputs: &mut [Lanes],
) {
    #[cfg(all(
        feature = "std",
        target_arch = "x86_64",
        not(target_feature = "avx512f")
    ))]
    {
        // SAFETY: a function compiled for an instruction set is unsafe to call because a machine without it
        // would meet an illegal instruction; this machine was just found to have it.
        #[allow(
            unsafe_code,
            reason = "AVX2 takes a third off the time of a fit, AVX-512 more; see ARCHITECTURE.md"
        )]
        unsafe {
            if std::is_x86_feature_detected!("avx512f") {
                return with_avx512(kernel, inputs, parameters, outputs, more_outputs);
            }
            if std::is_x86_feature_detected!("avx2") {
                return with_avx2(kernel, inputs, parameters, outputs, more_outputs);
            }
        }
    }
    kernel.run(inputs, parameters, outputs, more_outputs);
}

#[cfg(all(
    feature = "std",
    target_arch = "x86_64",
    not(target_feature = "avx512f")
))]
#[target_feature(enable = "avx512f")]
fn with_avx512<K: Kernel>(
    kernel: K,
    inputs: &[Lanes],
    parameters: &[f64],
    outputs: &mut [Lanes],
    more_outputs: &mut [Lanes],
) {
    kernel.run(inputs, parameters, outputs, more_outputs);
}

#[cfg(all(
    feature = "std",
    target_arch = "x86_64",
    not(target_feature = "avx512f")
))]
#[target_feature(enable = "avx2")]
fn with_avx2<K: Kernel>(
    kernel: K,
    inputs: &[Lanes],
    parameters: &[f64],
    outputs: &mut [Lanes],
    more_outputs: &mut [Lanes],
) {
    kernel.run(inputs, parameters, outputs, more_outputs);
}

#[cfg(all(test, feature = "std", target_arch = "x86_64"))]
mod tests {
    use super::*;

    const BLOCKS: usize = 20;

    /// Products and sums, which a compiler that fused them would round differently.
    #[derive(Clone, Copy)]
    struct Polynomial;

    impl Kernel for Polynomial {
        #[inline(always)]
        fn run(
            self,
            inputs: &[Lanes],
            parameters: &[f64],
            outputs: &mut [Lanes],
            more_outputs: &mut [Lanes],
        ) {
            for ((input, output), more) in inputs.iter().zip(outputs).zip(more_outputs) {
                for lane in 0..LANES {
                    let x = input[lane];
                    let value = parameters.iter().fold(0.0, |sum, factor| sum * x + factor);
                    output[lane] = value;
                    more[lane] = value * x + 1.0 / x;
                }
            }
        }
    }

    #[test]
    #[allow(unsafe_code, reason = "each set is run only where the machine has it")]
    fn every_instruction_set_gives_the_same_bits() {
        let inputs: [Lanes; BLOCKS] = core::array::from_fn(|block| {
            Lanes(core::array::from_fn(|lane| {
                0.1 + (LANES * block + lane) as f64 / 7.0
            }))
        });
        let parameters = [0.1, -1.7, 3.3, 1e-3];
        let (mut plain, mut more) = ([Lanes::ZERO; BLOCKS], [Lanes::ZERO; BLOCKS]);
        Polynomial.run(&inputs, &parameters, &mut plain, &mut more);
        let expected = (plain, more);
        let check = |run: &dyn Fn(&mut [Lanes], &mut [Lanes])| {
            let (mut outputs, mut more) = ([Lanes::ZERO; BLOCKS], [Lanes::ZERO; BLOCKS]);
            run(&mut outputs, &mut more);
            assert!((outputs, more) == expected);
        };
        check(&|outputs, more| vectorized(Polynomial, &inputs, &parameters, outputs, more));
        #[cfg(not(target_feature = "avx512f"))]
        {
            // SAFETY: the machine was just found to have the instructions.
            if std::is_x86_feature_detected!("avx2") {
                check(&|outputs, more| unsafe {
                    with_avx2(Polynomial, &inputs, &parameters, outputs, more);
                });
            }
            // SAFETY: as above.
            if std::is_x86_feature_detected!("avx512f") {
                check(&|outputs, more| unsafe {
                    with_avx512(Polynomial, &inputs, &parameters, outputs, more);
                });
            }
        }
    }
}
