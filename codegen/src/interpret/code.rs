//! A program as instructions on slots, and their execution.

mod translation;

use std::cell::RefCell;

use tau_runtime::{Kernel, LANES, Lanes, math, vectorized};

use crate::graph::Elementary;
use crate::program::Program;
use translation::Translation;

/// Blocks over which an instruction runs: enough to hide its decoding, few enough for the slots of a
/// residual to stay in cache.
const CHUNK: usize = 12;
/// One value for the samples of a chunk.
type Slot = [Lanes; CHUNK];

/// What an instruction does with its operands a, b, c and d.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Action {
    Add,
    Subtract,
    Multiply,
    Divide,
    Negate,
    Apply(Elementary),
    /// `if a < b { c } else { d }`
    Select,
    /// `a * b + c`, rounded twice.
    MultiplyAdd,
    /// `a * b - c`
    MultiplySubtract,
    /// `c - a * b`
    SubtractProduct,
    /// a
    Copy,
}

/// What is done at once with the result r of an action, which nothing else reads: it is never stored.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Then {
    Nothing,
    /// `r + x`
    Add,
    /// `r - x`
    Subtract,
    /// `r * x`
    Multiply,
    /// `r + x * y`, rounded twice.
    AddProduct,
    /// `r - x * y`
    SubtractProduct,
}

/// Where a result goes.
#[derive(Debug, Clone, Copy)]
enum Target {
    Slot(usize),
    /// The output of this number, which no instruction reads.
    Output(usize),
}

#[derive(Debug, Clone, Copy)]
struct Instruction {
    action: Action,
    operands: [usize; 4],
    then: Then,
    /// x and y of what is done then.
    further: [usize; 2],
    target: Target,
}

/// A program, split into what depends on parameters alone and the rest.
#[derive(Debug, Clone)]
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

/// What instructions run on: the numbers of one sample, or blocks.
trait Numbers: Sized {
    type Result;
    /// A function of some operands and further ones.
    fn map<const N: usize, const M: usize>(
        self,
        operands: [usize; N],
        further: [usize; M],
        f: impl Fn([f64; N], [f64; M]) -> f64,
    ) -> Self::Result;
}

/// Slots of a single sample.
struct Single<'a>(&'a [f64]);

impl Numbers for Single<'_> {
    type Result = f64;

    fn map<const N: usize, const M: usize>(
        self,
        operands: [usize; N],
        further: [usize; M],
        f: impl Fn([f64; N], [f64; M]) -> f64,
    ) -> f64 {
        f(
            operands.map(|slot| self.0[slot]),
            further.map(|slot| self.0[slot]),
        )
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
    fn map<const N: usize, const M: usize>(
        self,
        operands: [usize; N],
        further: [usize; M],
        f: impl Fn([f64; N], [f64; M]) -> f64,
    ) {
        let operands = operands.map(|index| self.slot(index));
        let further = further.map(|index| self.slot(index));
        for (block, result) in (0..self.count.min(CHUNK)).zip(self.result) {
            // A value of its own tells the compiler that the result overlaps no operand.
            let mut value = Lanes::ZERO;
            for lane in 0..LANES {
                value[lane] = f(
                    operands.map(|slot| slot[block][lane]),
                    further.map(|slot| slot[block][lane]),
                );
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
        let [x, y] = self.further;
        match self.then {
            Then::Nothing => self.alone(numbers),
            Then::Add => self.and_then(numbers, [x], |r, [x]| r + x),
            Then::Subtract => self.and_then(numbers, [x], |r, [x]| r - x),
            Then::Multiply => self.and_then(numbers, [x], |r, [x]| r * x),
            Then::AddProduct => self.and_then(numbers, [x, y], |r, [x, y]| r + x * y),
            Then::SubtractProduct => self.and_then(numbers, [x, y], |r, [x, y]| r - x * y),
        }
    }

    #[inline(always)]
    fn alone<N: Numbers>(&self, numbers: N) -> N::Result {
        let [a, b, c, d] = self.operands;
        match self.action {
            Action::Divide => numbers.map([a, b], [], |[a, b], []| a / b),
            Action::Negate => numbers.map([a], [], |[a], []| -a),
            Action::Select => numbers.map(
                [a, b, c, d],
                [],
                |[a, b, c, d], []| {
                    if a < b { c } else { d }
                },
            ),
            Action::Apply(function) => {
                let function = elementary(function);
                numbers.map([a], [], |[a], []| function(a))
            }
            Action::Copy => numbers.map([a], [], |[a], []| a),
            _ => self.and_then(numbers, [], |r, []| r),
        }
    }

    /// Of the actions that have something done then; see [`Action::is_arithmetic`].
    #[inline(always)]
    fn and_then<N: Numbers, const M: usize>(
        &self,
        numbers: N,
        further: [usize; M],
        then: impl Fn(f64, [f64; M]) -> f64,
    ) -> N::Result {
        let [a, b, c, _] = self.operands;
        match self.action {
            Action::Add => numbers.map([a, b], further, |[a, b], m| then(a + b, m)),
            Action::Subtract => numbers.map([a, b], further, |[a, b], m| then(a - b, m)),
            Action::Multiply => numbers.map([a, b], further, |[a, b], m| then(a * b, m)),
            Action::MultiplyAdd => {
                numbers.map([a, b, c], further, |[a, b, c], m| then(a * b + c, m))
            }
            Action::MultiplySubtract => {
                numbers.map([a, b, c], further, |[a, b, c], m| then(a * b - c, m))
            }
            Action::SubtractProduct => {
                numbers.map([a, b, c], further, |[a, b, c], m| then(c - a * b, m))
            }
            Action::Divide | Action::Negate | Action::Select | Action::Apply(_) | Action::Copy => {
                unreachable!("nothing is done at once with these results")
            }
        }
    }
}

impl Action {
    /// Whether its result may be used at once instead of being stored.
    fn is_arithmetic(self) -> bool {
        matches!(
            self,
            Self::Add
                | Self::Subtract
                | Self::Multiply
                | Self::MultiplyAdd
                | Self::MultiplySubtract
                | Self::SubtractProduct
        )
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
