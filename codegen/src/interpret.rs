//! The interpreter: programs run without rustc.
//!
//! Each instruction runs over several blocks of samples before the next one is looked at, so that
//! decoding is paid once for many samples, and what depends on parameters alone is computed once for all.
//! Operations and elementary functions are those of generated code, in the same order: results agree bit
//! for bit.

mod code;

use tau_runtime::{BlockFamily, LANES, Lanes, Pattern, ResidualFamily, Shape, block_count};

use crate::lower::Programs;
use code::Code;

/// Blocks that are converted at once where samples come one after the other.
const BATCH: usize = 32;

/// A residual family that is interpreted.
#[derive(Debug, Clone, PartialEq)]
pub struct Interpreted {
    shape: Shape,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    prepare: Code,
    value: Code,
    linearize: Code,
}

impl Interpreted {
    /// A family from its programs, sizes and sparsity.
    pub fn new(shape: Shape, row_starts: Vec<u32>, columns: Vec<u32>, programs: &Programs) -> Self {
        Self {
            shape,
            row_starts,
            columns,
            prepare: Code::new(&programs.prepare, shape.data, shape.prepared),
            value: Code::new(&programs.value, shape.prepared, shape.residuals),
            linearize: Code::new(&programs.linearize, shape.prepared, shape.residuals),
        }
    }
}

/// Puts samples side by side; lanes past the end repeat the last one.
fn put_together(samples: &[f64], width: usize, blocks: &mut [Lanes]) {
    let last = (samples.len() / width.max(1)).saturating_sub(1);
    for (index, block) in blocks.chunks_exact_mut(width.max(1)).enumerate() {
        for lane in 0..LANES {
            let sample = (index * LANES + lane).min(last);
            for (lanes, &number) in block.iter_mut().zip(&samples[sample * width..][..width]) {
                lanes[lane] = number;
            }
        }
    }
}

/// Takes blocks apart into samples one after the other.
fn take_apart(blocks: &[Lanes], width: usize, samples: &mut [f64]) {
    for (index, sample) in samples.chunks_exact_mut(width.max(1)).enumerate() {
        let block = &blocks[index / LANES * width..][..width];
        for (number, lanes) in sample.iter_mut().zip(block) {
            *number = lanes[index % LANES];
        }
    }
}

/// Runs code on samples that come one after the other. `outputs` and `more` have `widths` numbers per
/// sample.
fn in_batches(
    code: &Code,
    inputs: &[f64],
    parameters: &[f64],
    outputs: &mut [f64],
    more: &mut [f64],
    [input_width, width, more_width]: [usize; 3],
) {
    let samples = outputs.len().checked_div(width).unwrap_or(0);
    let room = |width: usize| vec![Lanes::ZERO; block_count(samples).min(BATCH) * width];
    let (mut first, mut second, mut third) = (room(input_width), room(width), room(more_width));
    for start in (0..samples).step_by(BATCH * LANES) {
        let end = samples.min(start + BATCH * LANES);
        let count = block_count(end - start);
        let first = &mut first[..count * input_width];
        put_together(
            &inputs[start * input_width..end * input_width],
            input_width,
            first,
        );
        let second = &mut second[..count * width];
        let third = &mut third[..count * more_width];
        code.run(first, parameters, second, third);
        take_apart(second, width, &mut outputs[start * width..end * width]);
        take_apart(
            third,
            more_width,
            &mut more[start * more_width..end * more_width],
        );
    }
}

impl ResidualFamily for Interpreted {
    fn shape(&self) -> Shape {
        self.shape
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        self.prepare.run_single(data, &[], prepared, &mut []);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        self.value
            .run_single(prepared, parameters, residuals, &mut []);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.linearize
            .run_single(prepared, parameters, residuals, jacobian);
    }

    fn blocks(&self) -> Option<&dyn BlockFamily> {
        Some(self)
    }

    fn prepare_all(&self, data: &[f64], prepared: &mut [f64]) {
        let widths = [self.shape.data, self.shape.prepared, 0];
        in_batches(&self.prepare, data, &[], prepared, &mut [], widths);
    }

    fn value_all(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let widths = [self.shape.prepared, self.shape.residuals, 0];
        in_batches(
            &self.value,
            prepared,
            parameters,
            residuals,
            &mut [],
            widths,
        );
    }

    fn linearize_all(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let widths = [
            self.shape.prepared,
            self.shape.residuals,
            self.columns.len(),
        ];
        in_batches(
            &self.linearize,
            prepared,
            parameters,
            residuals,
            jacobian,
            widths,
        );
    }
}

impl BlockFamily for Interpreted {
    fn prepare_blocks(&self, data: &[f64], prepared: &mut [Lanes]) {
        let (width, entries) = (self.shape.data, self.shape.prepared);
        if entries == 0 {
            return;
        }
        let mut inputs = vec![Lanes::ZERO; prepared.len() / entries * width];
        put_together(data, width, &mut inputs);
        self.prepare.run(&inputs, &[], prepared, &mut []);
    }

    fn value_blocks(&self, prepared: &[Lanes], parameters: &[f64], residuals: &mut [Lanes]) {
        self.value.run(prepared, parameters, residuals, &mut []);
    }

    fn linearize_blocks(
        &self,
        prepared: &[Lanes],
        parameters: &[f64],
        residuals: &mut [Lanes],
        jacobian: &mut [Lanes],
    ) {
        self.linearize
            .run(prepared, parameters, residuals, jacobian);
    }
}
