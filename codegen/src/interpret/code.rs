//! A program as instructions on slots, and their execution.
//!
//! Nearly all instructions are one: up to six products with their signs, added up in the program's order. A term
//! that is no product is multiplied by one, which costs less than to store a value, to read it again and to decode
//! another instruction. Values that nothing else reads go straight to the output; slots are reused, so that they stay
//! in cache. Inputs are copied into slots: reading them where they stand costs more in strides and checks.

mod translation;

use std::cell::RefCell;

use tau_runtime::{Kernel, LANES, Lanes, math, vectorized};

use crate::graph::Elementary;
use crate::program::Program;
use translation::Translation;

/// Blocks over which an instruction runs: enough to hide its decoding, few enough for the slots of a
/// residual to stay in cache.
const CHUNK: usize = 16;
/// One value for the samples of a chunk.
type Slot = [Lanes; CHUNK];

/// Most products that one instruction adds up: as many as the closure equation does for a component of its rod.
const MOST: usize = 6;

/// Operation of an instruction on its operands a, b, c and d.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Action {
    /// `± a * b ± c * d ± …`, so many products, each rounded, added up from the first on. Signs are factors, which
    /// change no bit of what is rounded, and so is the one that stands beside a term that is no product: what takes
    /// time is to store a value and to read it again, not to multiply.
    Sum(usize),
    Divide,
    Apply(Elementary),
    /// `if a < b { c } else { d }`
    Select,
}

/// Destination of a result.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Target {
    Slot(usize),
    /// The output of this number, which no instruction reads.
    Output(usize),
}

#[derive(Debug, Clone, Copy, PartialEq)]
struct Instruction {
    action: Action,
    operands: [[usize; 2]; MOST],
    /// Of each product of a sum.
    signs: [f64; MOST],
    target: Target,
}

/// A program, split into what depends on parameters alone and the rest.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Code {
    /// Inputs per sample; parameters follow them.
    samples: usize,
    /// Outputs of the first slice; the others belong to the second.
    outputs: usize,
    more_outputs: usize,
    constants: Vec<f64>,
    /// Run once: slots are parameters, constants, results.
    shared: Vec<Instruction>,
    shared_slots: usize,
    /// Shared slots that samples read; they stand behind the samples' inputs.
    copied: Vec<usize>,
    /// Run for all samples: slots are inputs, copies, results.
    instructions: Vec<Instruction>,
    slots: usize,
}

thread_local! {
    /// Slots of the last run, kept because clearing them takes as long as a short program.
    static SLOTS: RefCell<Vec<Slot>> = const { RefCell::new(Vec::new()) };
    /// The same for single samples and for what all samples share.
    static NUMBERS: RefCell<Vec<f64>> = const { RefCell::new(Vec::new()) };
}

impl Code {
    /// Translates a program whose first inputs are a sample's, the others shared by all samples, and whose
    /// first outputs go to one slice, the others to another.
    pub(super) fn new(program: &Program, samples: usize, outputs: usize) -> Self {
        Translation::new(program, samples).finish(outputs)
    }

    /// Runs it for blocks: those that fill `outputs`.
    pub(super) fn run(
        &self,
        inputs: &[Lanes],
        parameters: &[f64],
        outputs: &mut [Lanes],
        more: &mut [Lanes],
    ) {
        let mut shared = NUMBERS.take();
        self.share(parameters, &mut shared);
        let mut slots = SLOTS.take();
        if slots.len() < self.slots {
            slots.resize(self.slots, [Lanes::ZERO; CHUNK]);
        }
        for (slot, &source) in slots[self.samples..].iter_mut().zip(&self.copied) {
            *slot = [Lanes::splat(shared[source]); CHUNK];
        }
        let run = Run {
            code: self,
            slots: &mut slots,
        };
        vectorized(run, inputs, parameters, outputs, more);
        SLOTS.set(slots);
        NUMBERS.set(shared);
    }

    /// Runs it for one sample.
    pub(super) fn run_single(
        &self,
        inputs: &[f64],
        parameters: &[f64],
        outputs: &mut [f64],
        more: &mut [f64],
    ) {
        let mut numbers = NUMBERS.take();
        self.share(parameters, &mut numbers);
        let first = self.shared_slots;
        numbers.resize(first + self.slots, 0.0);
        let (shared, slots) = numbers.split_at_mut(first);
        slots[..self.samples].copy_from_slice(inputs);
        for (slot, &source) in slots[self.samples..].iter_mut().zip(&self.copied) {
            *slot = shared[source];
        }
        for instruction in &self.instructions {
            let result = instruction.number(slots);
            match instruction.target {
                Target::Slot(slot) => slots[slot] = result,
                Target::Output(output) => match output.checked_sub(self.outputs) {
                    None => outputs[output] = result,
                    Some(output) => more[output] = result,
                },
            }
        }
        NUMBERS.set(numbers);
    }

    /// Computes what depends on parameters alone.
    fn share(&self, parameters: &[f64], numbers: &mut Vec<f64>) {
        numbers.clear();
        numbers.extend_from_slice(parameters);
        numbers.extend_from_slice(&self.constants);
        for instruction in &self.shared {
            numbers.push(instruction.number(numbers));
        }
    }
}

/// The instructions of a code on all blocks.
struct Run<'a> {
    code: &'a Code,
    slots: &'a mut [Slot],
}

impl Kernel for Run<'_> {
    #[inline(always)]
    fn run(self, inputs: &[Lanes], _: &[f64], outputs: &mut [Lanes], more: &mut [Lanes]) {
        let Self { code, slots } = self;
        let blocks = match code.outputs {
            0 => 0,
            width => outputs.len() / width,
        };
        for first in (0..blocks).step_by(CHUNK) {
            let count = CHUNK.min(blocks - first);
            for block in 0..count {
                let inputs = &inputs[(first + block) * code.samples..][..code.samples];
                for (slot, input) in slots.iter_mut().zip(inputs) {
                    slot[block] = *input;
                }
            }
            for instruction in &code.instructions {
                match instruction.target {
                    Target::Slot(slot) => {
                        let (before, rest) = slots.split_at_mut(slot);
                        let Some((result, after)) = rest.split_first_mut() else {
                            return;
                        };
                        instruction.run(Blocks {
                            count,
                            slots: (before, after),
                            result: result.iter_mut(),
                        });
                    }
                    Target::Output(output) => {
                        let (out, output, width) = match output.checked_sub(code.outputs) {
                            None => (&mut *outputs, output, code.outputs),
                            Some(output) => (&mut *more, output, code.more_outputs),
                        };
                        let result = out[first * width + output..].iter_mut();
                        instruction.run(Blocks {
                            count,
                            slots: (slots, &[]),
                            result: result.step_by(width),
                        });
                    }
                }
            }
        }
    }
}

/// Operands of instructions: the numbers of one sample, or blocks.
trait Numbers: Sized {
    type Result;

    /// See [`Action::Sum`].
    fn sum<const TERMS: usize>(
        self,
        operands: &[[usize; 2]; MOST],
        signs: &[f64; MOST],
    ) -> Self::Result;

    /// A function of some operands.
    fn map<const N: usize>(self, operands: [usize; N], f: impl Fn([f64; N]) -> f64)
    -> Self::Result;
}

/// Slots of a single sample.
struct Single<'a>(&'a [f64]);

impl Numbers for Single<'_> {
    type Result = f64;

    fn sum<const TERMS: usize>(self, operands: &[[usize; 2]; MOST], signs: &[f64; MOST]) -> f64 {
        let of_term = |term: usize| {
            let [a, b] = operands[term];
            signs[term] * self.0[a] * self.0[b]
        };
        (1..TERMS).fold(of_term(0), |sum, term| sum + of_term(term))
    }

    fn map<const N: usize>(self, operands: [usize; N], f: impl Fn([f64; N]) -> f64) -> f64 {
        f(operands.map(|slot| self.0[slot]))
    }
}

/// Slots of a chunk of blocks, and where the results of its blocks go.
struct Blocks<'a, R> {
    count: usize,
    /// Slots before and after that of the result.
    slots: (&'a [Slot], &'a [Slot]),
    result: R,
}

impl<'a, R: Iterator<Item = &'a mut Lanes>> Blocks<'a, R> {
    #[inline(always)]
    fn slot(&self, index: usize) -> &'a Slot {
        let (before, after) = self.slots;
        // A result's slot is never an operand's.
        match index.checked_sub(before.len()) {
            None => &before[index],
            Some(place) => &after[place - 1],
        }
    }
}

impl<'a, R: Iterator<Item = &'a mut Lanes>> Numbers for Blocks<'a, R> {
    type Result = ();

    #[inline(always)]
    fn sum<const TERMS: usize>(self, operands: &[[usize; 2]; MOST], signs: &[f64; MOST]) {
        let mut left = [self.slot(operands[0][0]); TERMS];
        let mut right = [self.slot(operands[0][1]); TERMS];
        let mut own = [signs[0]; TERMS];
        for term in 1..TERMS {
            left[term] = self.slot(operands[term][0]);
            right[term] = self.slot(operands[term][1]);
            own[term] = signs[term];
        }
        for (block, result) in (0..self.count.min(CHUNK)).zip(self.result) {
            // A value of its own tells the compiler that the result overlaps no operand.
            let mut value = Lanes::ZERO;
            for term in 0..TERMS {
                let (a, b) = (&left[term][block], &right[term][block]);
                for lane in 0..LANES {
                    let product = own[term] * a[lane] * b[lane];
                    value[lane] = if term == 0 {
                        product
                    } else {
                        value[lane] + product
                    };
                }
            }
            *result = value;
        }
    }

    #[inline(always)]
    fn map<const N: usize>(self, operands: [usize; N], f: impl Fn([f64; N]) -> f64) {
        let operands = operands.map(|index| self.slot(index));
        for (block, result) in (0..self.count.min(CHUNK)).zip(self.result) {
            let mut value = Lanes::ZERO;
            for lane in 0..LANES {
                value[lane] = f(operands.map(|slot| slot[block][lane]));
            }
            *result = value;
        }
    }
}

impl Instruction {
    fn number(&self, slots: &[f64]) -> f64 {
        self.run(Single(slots))
    }

    #[inline(always)]
    fn run<N: Numbers>(&self, numbers: N) -> N::Result {
        let Self {
            operands, signs, ..
        } = self;
        let [[a, b], [c, d], ..] = *operands;
        match self.action {
            Action::Sum(1) => numbers.sum::<1>(operands, signs),
            Action::Sum(2) => numbers.sum::<2>(operands, signs),
            Action::Sum(3) => numbers.sum::<3>(operands, signs),
            Action::Sum(4) => numbers.sum::<4>(operands, signs),
            Action::Sum(5) => numbers.sum::<5>(operands, signs),
            Action::Sum(_) => numbers.sum::<MOST>(operands, signs),
            Action::Divide => numbers.map([a, b], |[a, b]| a / b),
            Action::Apply(function) => {
                let function = elementary(function);
                numbers.map([a], |[a]| function(a))
            }
            Action::Select => numbers.map([a, b, c, d], |[a, b, c, d]| if a < b { c } else { d }),
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::program::{Operand, Operation};

    const SAMPLES: usize = 3;
    const PARAMETERS: usize = 2;

    /// A number below a limit, from a linear congruential generator.
    fn below(state: &mut u64, limit: usize) -> usize {
        *state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        (*state >> 33) as usize % limit
    }

    /// A program of operations on whatever came before; most sums go on from the last value.
    fn program(state: &mut u64) -> Program {
        let mut program = Program {
            inputs: vec!["input".to_owned(); SAMPLES + PARAMETERS],
            ..Program::default()
        };
        let length = 4 + below(state, 30);
        for index in 0..length {
            let mut operand = || match below(state, 8) {
                0 => Operand::Constant(1.5),
                1..4 => Operand::Input(below(state, SAMPLES + PARAMETERS)),
                4..6 if index > 0 => Operand::Temporary(below(state, index)),
                _ if index > 0 => Operand::Temporary(index - 1),
                _ => Operand::Input(0),
            };
            let (a, b, c, d) = (operand(), operand(), operand(), operand());
            program.operations.push(match below(state, 12) {
                0..3 => Operation::Add(a, b),
                3..6 => Operation::Subtract(a, b),
                6..9 => Operation::Multiply(a, b),
                9 => Operation::Negate(a),
                10 => Operation::Divide(a, b),
                _ => Operation::Select([a, b, c, d]),
            });
            program.names.push(None);
        }
        for _ in 0..3 {
            let output = below(state, length + 1).checked_sub(1);
            let output = output.map_or(
                Operand::Input(below(state, SAMPLES + PARAMETERS)),
                Operand::Temporary,
            );
            program.outputs.push(output);
        }
        program
    }

    /// Operation by operation.
    fn plainly(program: &Program, inputs: &[f64]) -> Vec<f64> {
        let mut results: Vec<f64> = vec![];
        let value = |operand: Operand, results: &[f64]| match operand {
            Operand::Constant(value) => value,
            Operand::Input(index) => inputs[index],
            Operand::Temporary(index) => results[index],
        };
        for operation in &program.operations {
            let of = |operand| value(operand, &results);
            results.push(match *operation {
                Operation::Add(a, b) => of(a) + of(b),
                Operation::Subtract(a, b) => of(a) - of(b),
                Operation::Multiply(a, b) => of(a) * of(b),
                Operation::Divide(a, b) => of(a) / of(b),
                Operation::Negate(a) => -of(a),
                Operation::Apply(function, a) => elementary(function)(of(a)),
                Operation::Select([a, b, c, d]) => {
                    if of(a) < of(b) {
                        of(c)
                    } else {
                        of(d)
                    }
                }
            });
        }
        program
            .outputs
            .iter()
            .map(|&output| value(output, &results))
            .collect()
    }

    fn are_same(a: f64, b: f64) -> bool {
        a.to_bits() == b.to_bits() || (a.is_nan() && b.is_nan())
    }

    /// Whatever is added up at once, results are those of one operation after the other, bit for bit.
    #[test]
    fn results_are_those_of_single_operations() {
        let mut state = 17;
        let parameters = [0.7, -1.3];
        let samples: Vec<[f64; SAMPLES]> = (0..200)
            .map(|_| std::array::from_fn(|_| below(&mut state, 2001) as f64 / 700.0 - 1.4))
            .collect();
        let mut blocks = vec![Lanes::ZERO; samples.len() / LANES * SAMPLES];
        for (sample, inputs) in samples.iter().enumerate() {
            for (k, &input) in inputs.iter().enumerate() {
                blocks[sample / LANES * SAMPLES + k][sample % LANES] = input;
            }
        }
        for _ in 0..300 {
            let program = program(&mut state);
            let code = Code::new(&program, SAMPLES, 1);
            let mut outputs = vec![Lanes::ZERO; samples.len() / LANES];
            let mut more = vec![Lanes::ZERO; 2 * outputs.len()];
            code.run(&blocks, &parameters, &mut outputs, &mut more);
            for (sample, inputs) in samples.iter().enumerate() {
                let expected = plainly(&program, &[&inputs[..], &parameters].concat());
                let (mut single, mut second) = ([0.0], [0.0; 2]);
                code.run_single(inputs, &parameters, &mut single, &mut second);
                let (block, lane) = (sample / LANES, sample % LANES);
                let of_blocks = [
                    outputs[block][lane],
                    more[2 * block][lane],
                    more[2 * block + 1][lane],
                ];
                for (k, expected) in expected.into_iter().enumerate() {
                    let found = [of_blocks[k], [single[0], second[0], second[1]][k]];
                    assert!(
                        found.iter().all(|&found| are_same(found, expected)),
                        "{found:?} {expected} {program:?}"
                    );
                }
            }
        }
    }
}
