//! Samples as a family prepares them once, and evaluation of their residuals.

use tau_runtime::{BlockFamily, LANES, Lanes, ResidualFamily, block_count};

use super::Block;

/// The prepared samples of a block, in the layout that its family computes fastest.
pub(crate) enum Prepared<'a> {
    /// One sample after the other.
    Samples(Vec<f64>),
    /// Several at once.
    Blocks(&'a dyn BlockFamily, Vec<Lanes>),
}

impl<'a> Prepared<'a> {
    pub(super) fn new(family: &'a dyn ResidualFamily, samples: usize, data: &[f64]) -> Self {
        let shape = family.shape();
        // Data that do not divide into samples are refused when the problem is checked.
        let data = &data[..samples * shape.data];
        match family.blocks() {
            Some(family) => {
                let mut prepared = vec![Lanes::ZERO; block_count(samples) * shape.prepared];
                family.prepare_blocks(data, &mut prepared);
                Self::Blocks(family, prepared)
            }
            None => {
                let mut prepared = vec![0.0; samples * shape.prepared];
                family.prepare_all(data, &mut prepared);
                Self::Samples(prepared)
            }
        }
    }

    /// Takes blocks apart, for families whose samples have parameters of their own.
    pub(super) fn separate(&mut self, samples: usize, width: usize) {
        if let Self::Blocks(_, lanes) = self {
            let mut separate = vec![0.0; samples * width];
            take_apart(lanes, width, &mut separate);
            *self = Self::Samples(separate);
        }
    }
}

impl Block<'_> {
    /// The residuals of samples that share all parameters, and the Jacobian's entries where wanted, one
    /// sample after the other. `first` is a multiple of [`LANES`]; `lanes` is room to work in.
    pub(crate) fn evaluate(
        &self,
        first: usize,
        samples: usize,
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: Option<&mut [f64]>,
        lanes: &mut Vec<Lanes>,
    ) {
        let shape = self.family.shape();
        match &self.prepared {
            Prepared::Samples(prepared) => {
                let prepared =
                    &prepared[first * shape.prepared..(first + samples) * shape.prepared];
                match jacobian {
                    Some(jacobian) => {
                        self.family
                            .linearize_all(prepared, parameters, residuals, jacobian);
                    }
                    None => self.family.value_all(prepared, parameters, residuals),
                }
            }
            Prepared::Blocks(family, prepared) => {
                let (first, count) = (first / LANES, block_count(samples));
                let prepared = &prepared[first * shape.prepared..(first + count) * shape.prepared];
                let entries = jacobian.as_ref().map_or(0, |_| self.family.pattern().len());
                lanes.resize(count * (shape.residuals + entries), Lanes::ZERO);
                let (values, derivatives) = lanes.split_at_mut(count * shape.residuals);
                match jacobian {
                    Some(jacobian) => {
                        family.linearize_blocks(prepared, parameters, values, derivatives);
                        take_apart(derivatives, entries, jacobian);
                    }
                    None => family.value_blocks(prepared, parameters, values),
                }
                take_apart(values, shape.residuals, residuals);
            }
        }
    }
}

/// Copies blocks of `width` numbers per sample to one sample after the other.
fn take_apart(blocks: &[Lanes], width: usize, samples: &mut [f64]) {
    if width == 0 {
        return;
    }
    for (block, samples) in blocks
        .chunks_exact(width)
        .zip(samples.chunks_mut(LANES * width))
    {
        for (lane, sample) in samples.chunks_exact_mut(width).enumerate() {
            for (number, lanes) in sample.iter_mut().zip(block) {
                *number = lanes[lane];
            }
        }
    }
}
