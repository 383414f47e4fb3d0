//! The interpreter: programs run without rustc.
//!
//! Each instruction runs over a block of samples before the next one is looked at, so that decoding is
//! paid once per block. Operations and elementary functions are those of generated code, in the same
//! order: results agree bit for bit.

use tau_runtime::{Pattern, ResidualFamily, Shape, math};

use crate::graph::Elementary;
use crate::lower::Programs;
use crate::program::{Operand, Operation, Program};

/// Samples per block.
const LANES: usize = 16;
type Lanes = [f64; LANES];

/// A residual family that is interpreted.
#[derive(Debug, Clone)]
pub struct Interpreted {
    shape: Shape,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
    programs: Programs,
}

impl Interpreted {
    /// A family from its programs, sizes and sparsity.
    pub fn new(shape: Shape, row_starts: Vec<u32>, columns: Vec<u32>, programs: Programs) -> Self {
        Self {
            shape,
            row_starts,
            columns,
            programs,
        }
    }
}

/// Runs a program over a block. `inputs` and `registers` hold one row of lanes each.
fn run(program: &Program, inputs: &[Lanes], registers: &mut Vec<Lanes>) {
    registers.clear();
    for operation in &program.operations {
        let read = |operand: Operand| match operand {
            Operand::Constant(value) => [value; LANES],
            Operand::Input(index) => inputs[index],
            Operand::Temporary(index) => registers[index],
        };
        let result = match *operation {
            Operation::Add(a, b) => zip(read(a), read(b), |x, y| x + y),
            Operation::Subtract(a, b) => zip(read(a), read(b), |x, y| x - y),
            Operation::Multiply(a, b) => zip(read(a), read(b), |x, y| x * y),
            Operation::Divide(a, b) => zip(read(a), read(b), |x, y| x / y),
            Operation::Negate(a) => read(a).map(|x| -x),
            Operation::Apply(function, a) => read(a).map(elementary(function)),
            Operation::Select([l, r, a, b]) => {
                let (l, r, a, b) = (read(l), read(r), read(a), read(b));
                std::array::from_fn(|i| if l[i] < r[i] { a[i] } else { b[i] })
            }
        };
        registers.push(result);
    }
}

fn zip(a: Lanes, b: Lanes, f: impl Fn(f64, f64) -> f64) -> Lanes {
    std::array::from_fn(|i| f(a[i], b[i]))
}

fn elementary(function: Elementary) -> fn(f64) -> f64 {
    match function {
        Elementary::Sqrt => math::sqrt,
        Elementary::Sin => math::sin,
        Elementary::Cos => math::cos,
        Elementary::Tan => math::tan,
        Elementary::Atan => math::atan,
        Elementary::Exp => math::exp,
        Elementary::Ln => math::ln,
        Elementary::Tanh => math::tanh,
    }
}

/// Evaluates a program for many samples. `per_sample` holds `stride` numbers per sample, `shared`
/// follows them in the program's inputs; `write` receives (sample, output, value).
fn evaluate(
    program: &Program,
    per_sample: &[f64],
    stride: usize,
    shared: &[f64],
    samples: usize,
    mut write: impl FnMut(usize, usize, f64),
) {
    let mut inputs: Vec<Lanes> = vec![[0.0; LANES]; stride];
    inputs.extend(shared.iter().map(|&value| [value; LANES]));
    let mut registers = Vec::with_capacity(program.operations.len());
    let mut first = 0;
    while first < samples {
        let count = LANES.min(samples - first);
        for lane in 0..LANES {
            // Lanes past the end repeat the last sample: no special values, no branches.
            let sample = first + lane.min(count - 1);
            for (input, &value) in inputs
                .iter_mut()
                .zip(&per_sample[sample * stride..(sample + 1) * stride])
            {
                input[lane] = value;
            }
        }
        run(program, &inputs, &mut registers);
        for (output, operand) in program.outputs.iter().enumerate() {
            for lane in 0..count {
                let value = match *operand {
                    Operand::Constant(value) => value,
                    Operand::Input(index) => inputs[index][lane],
                    Operand::Temporary(index) => registers[index][lane],
                };
                write(first + lane, output, value);
            }
        }
        first += count;
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
        evaluate(
            &self.programs.prepare,
            data,
            self.shape.data,
            &[],
            1,
            |_, output, value| {
                prepared[output] = value;
            },
        );
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        self.value_all(prepared, parameters, residuals);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.linearize_all(prepared, parameters, residuals, jacobian);
    }

    fn prepare_all(&self, data: &[f64], prepared: &mut [f64]) {
        let width = self.shape.prepared;
        if width == 0 {
            return;
        }
        let samples = prepared.len() / width;
        let program = &self.programs.prepare;
        evaluate(
            program,
            data,
            self.shape.data,
            &[],
            samples,
            |sample, output, value| {
                prepared[sample * width + output] = value;
            },
        );
    }

    fn value_all(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let width = self.shape.residuals;
        let samples = residuals.len() / width;
        evaluate(
            &self.programs.value,
            prepared,
            self.shape.prepared,
            parameters,
            samples,
            |sample, output, value| residuals[sample * width + output] = value,
        );
    }

    fn linearize_all(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (width, entries) = (self.shape.residuals, self.columns.len());
        let samples = residuals.len() / width;
        evaluate(
            &self.programs.linearize,
            prepared,
            self.shape.prepared,
            parameters,
            samples,
            |sample, output, value| {
                if output < width {
                    residuals[sample * width + output] = value;
                } else {
                    jacobian[sample * entries + output - width] = value;
                }
            },
        );
    }
}
