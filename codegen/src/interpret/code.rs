//! A program as instructions on slots, and their execution.

use std::cell::RefCell;
use std::collections::BTreeMap;

use tau_runtime::{Kernel, LANES, Lanes, math, vectorized};

use crate::graph::Elementary;
use crate::program::{Operand, Operation, Program};

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
                let operands = instruction.operands;
                match instruction.target {
                    Target::Slot(slot) => {
                        let (before, rest) = slots.split_at_mut(slot);
                        let Some((result, after)) = rest.split_first_mut() else {
                            return;
                        };
                        instruction.run(Blocks {
                            count,
                            operands,
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
                            operands,
                            slots: (slots, &[]),
                            result: result.step_by(width),
                        });
                    }
                }
            }
        }
    }
}

/// An instruction's operands and result, for one sample or for blocks.
trait Numbers: Sized {
    type Result;
    fn unary(self, f: impl Fn(f64) -> f64) -> Self::Result;
    fn binary(self, f: impl Fn(f64, f64) -> f64) -> Self::Result;
    fn ternary(self, f: impl Fn(f64, f64, f64) -> f64) -> Self::Result;
    /// `if a < b { c } else { d }`
    fn select(self) -> Self::Result;
}

/// Operands of a single sample.
struct Single([f64; 4]);

impl Numbers for Single {
    type Result = f64;

    fn unary(self, f: impl Fn(f64) -> f64) -> f64 {
        f(self.0[0])
    }

    fn binary(self, f: impl Fn(f64, f64) -> f64) -> f64 {
        f(self.0[0], self.0[1])
    }

    fn ternary(self, f: impl Fn(f64, f64, f64) -> f64) -> f64 {
        f(self.0[0], self.0[1], self.0[2])
    }

    fn select(self) -> f64 {
        let [a, b, c, d] = self.0;
        if a < b { c } else { d }
    }
}

/// Operands of a chunk of blocks, and where the results of its blocks go.
struct Blocks<'a, R> {
    count: usize,
    operands: [usize; 4],
    /// Slots before and after that of the result.
    slots: (&'a [Slot], &'a [Slot]),
    result: R,
}

impl<'a, R: Iterator<Item = &'a mut Lanes>> Blocks<'a, R> {
    #[inline(always)]
    fn operand(&self, index: usize) -> &'a Slot {
        let (before, after) = self.slots;
        // A result's slot is never an operand's.
        match self.operands[index].checked_sub(before.len()) {
            None => &before[self.operands[index]],
            Some(place) => &after[place - 1],
        }
    }

    #[inline(always)]
    fn map(self, f: impl Fn(usize, usize) -> f64) {
        for (block, result) in (0..self.count.min(CHUNK)).zip(self.result) {
            // A value of its own tells the compiler that the result overlaps no operand.
            let mut value = Lanes::ZERO;
            for lane in 0..LANES {
                value[lane] = f(block, lane);
            }
            *result = value;
        }
    }
}

impl<'a, R: Iterator<Item = &'a mut Lanes>> Numbers for Blocks<'a, R> {
    type Result = ();

    #[inline(always)]
    fn unary(self, f: impl Fn(f64) -> f64) {
        let a = self.operand(0);
        self.map(|block, lane| f(a[block][lane]));
    }

    #[inline(always)]
    fn binary(self, f: impl Fn(f64, f64) -> f64) {
        let (a, b) = (self.operand(0), self.operand(1));
        self.map(|block, lane| f(a[block][lane], b[block][lane]));
    }

    #[inline(always)]
    fn ternary(self, f: impl Fn(f64, f64, f64) -> f64) {
        let (a, b, c) = (self.operand(0), self.operand(1), self.operand(2));
        self.map(|block, lane| f(a[block][lane], b[block][lane], c[block][lane]));
    }

    #[inline(always)]
    fn select(self) {
        let (a, b) = (self.operand(0), self.operand(1));
        let (c, d) = (self.operand(2), self.operand(3));
        self.map(|block, lane| {
            if a[block][lane] < b[block][lane] {
                c[block][lane]
            } else {
                d[block][lane]
            }
        });
    }
}

impl Instruction {
    fn number(&self, slots: &[f64]) -> f64 {
        self.run(Single(self.operands.map(|slot| slots[slot])))
    }

    #[inline(always)]
    fn run<N: Numbers>(&self, numbers: N) -> N::Result {
        match self.action {
            Action::Add => numbers.binary(|a, b| a + b),
            Action::Subtract => numbers.binary(|a, b| a - b),
            Action::Multiply => numbers.binary(|a, b| a * b),
            Action::Divide => numbers.binary(|a, b| a / b),
            Action::Negate => numbers.unary(|a| -a),
            Action::MultiplyAdd => numbers.ternary(|a, b, c| a * b + c),
            Action::MultiplySubtract => numbers.ternary(|a, b, c| a * b - c),
            Action::SubtractProduct => numbers.ternary(|a, b, c| c - a * b),
            Action::Select => numbers.select(),
            Action::Apply(function) => numbers.unary(elementary(function)),
            Action::Copy => numbers.unary(|a| a),
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

/// Where a value is before slots are given out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Source {
    /// A slot that all samples share.
    Shared(usize),
    /// An input of the sample.
    Input(usize),
    /// The result of an instruction that runs for samples.
    Result(usize),
}

/// A program on its way to [`Code`].
struct Translation<'a> {
    program: &'a Program,
    samples: usize,
    constants: Vec<f64>,
    shared: Vec<Instruction>,
    /// Where each temporary is; `None` for products inside a later instruction.
    temporaries: Vec<Option<Source>>,
    /// Instructions for samples: action, operands, temporary.
    varying: Vec<(Action, Vec<Source>, usize)>,
}

impl<'a> Translation<'a> {
    fn new(program: &'a Program, samples: usize) -> Self {
        let mut translation = Self {
            program,
            samples,
            constants: vec![],
            shared: vec![],
            temporaries: vec![None; program.operations.len()],
            varying: vec![],
        };
        translation.collect_constants();
        translation.translate();
        translation
    }

    fn collect_constants(&mut self) {
        let operations = self.program.operations.iter().flat_map(Operation::operands);
        for operand in operations.chain(self.program.outputs.iter().copied()) {
            if let Operand::Constant(value) = operand {
                let known = |other: &f64| other.to_bits() == value.to_bits();
                if !self.constants.iter().any(known) {
                    self.constants.push(value);
                }
            }
        }
    }

    fn parameters(&self) -> usize {
        self.program.inputs.len() - self.samples
    }

    fn source(&self, operand: Operand) -> Option<Source> {
        match operand {
            Operand::Constant(value) => {
                let known = |other: &f64| other.to_bits() == value.to_bits();
                let index = self.constants.iter().position(known)?;
                Some(Source::Shared(self.parameters() + index))
            }
            Operand::Input(index) => Some(match index.checked_sub(self.samples) {
                None => Source::Input(index),
                Some(parameter) => Source::Shared(parameter),
            }),
            Operand::Temporary(index) => self.temporaries[index],
        }
    }

    fn translate(&mut self) {
        let uses = self.program.uses();
        let inside = self.products_inside(&uses);
        for (index, &operation) in self.program.operations.iter().enumerate() {
            if inside[index] {
                continue;
            }
            let (action, operands) = self.action(operation, &inside);
            let sources: Vec<Source> = operands
                .into_iter()
                .filter_map(|operand| self.source(operand))
                .collect();
            let shared: Option<Vec<usize>> = sources
                .iter()
                .map(|source| match source {
                    Source::Shared(slot) => Some(*slot),
                    _ => None,
                })
                .collect();
            self.temporaries[index] = Some(if let Some(operands) = shared {
                let result = self.parameters() + self.constants.len() + self.shared.len();
                self.shared.push(Instruction {
                    action,
                    operands: padded(&operands),
                    target: Target::Slot(result),
                });
                Source::Shared(result)
            } else {
                self.varying.push((action, sources, index));
                Source::Result(index)
            });
        }
    }

    /// Which products only one sum reads: they become part of it, unless all samples share them.
    fn products_inside(&self, uses: &[usize]) -> Vec<bool> {
        let operations = &self.program.operations;
        let mut varies: Vec<bool> = Vec::with_capacity(operations.len());
        for operation in operations {
            let varying = operation.operands().any(|operand| match operand {
                Operand::Constant(_) => false,
                Operand::Input(index) => index < self.samples,
                Operand::Temporary(index) => varies[index],
            });
            varies.push(varying);
        }
        let mut inside = vec![false; operations.len()];
        for operation in operations {
            let (Operation::Add(a, b) | Operation::Subtract(a, b)) = *operation else {
                continue;
            };
            let product = [b, a].into_iter().find_map(|operand| match operand {
                Operand::Temporary(index)
                    if uses[index] == 1
                        && varies[index]
                        && matches!(operations[index], Operation::Multiply(..)) =>
                {
                    Some(index)
                }
                _ => None,
            });
            if let Some(product) = product {
                inside[product] = true;
            }
        }
        inside
    }

    /// An operation as an action, with the product that it takes in.
    fn action(&self, operation: Operation, inside: &[bool]) -> (Action, Vec<Operand>) {
        let product = |operand: Operand| match operand {
            Operand::Temporary(index) if inside[index] => match self.program.operations[index] {
                Operation::Multiply(a, b) => Some((a, b)),
                _ => None,
            },
            _ => None,
        };
        match operation {
            Operation::Add(x, y) => match (product(x), product(y)) {
                (_, Some((a, b))) => (Action::MultiplyAdd, vec![a, b, x]),
                (Some((a, b)), None) => (Action::MultiplyAdd, vec![a, b, y]),
                (None, None) => (Action::Add, vec![x, y]),
            },
            Operation::Subtract(x, y) => match (product(x), product(y)) {
                (_, Some((a, b))) => (Action::SubtractProduct, vec![a, b, x]),
                (Some((a, b)), None) => (Action::MultiplySubtract, vec![a, b, y]),
                (None, None) => (Action::Subtract, vec![x, y]),
            },
            Operation::Multiply(a, b) => (Action::Multiply, vec![a, b]),
            Operation::Divide(a, b) => (Action::Divide, vec![a, b]),
            Operation::Negate(a) => (Action::Negate, vec![a]),
            Operation::Apply(function, a) => (Action::Apply(function), vec![a]),
            Operation::Select(operands) => (Action::Select, operands.to_vec()),
        }
    }

    /// Gives out slots: a result's is free again after its last use.
    fn finish(self, outputs: usize) -> Code {
        let stored: Vec<Option<Source>> = self
            .program
            .outputs
            .iter()
            .map(|&output| self.source(output))
            .collect();
        let mut copied: Vec<usize> = Vec::new();
        let sources = self.varying.iter().flat_map(|(_, sources, _)| sources);
        for source in sources.chain(stored.iter().flatten()) {
            if let Source::Shared(slot) = source
                && !copied.contains(slot)
            {
                copied.push(*slot);
            }
        }
        let mut last_use: BTreeMap<usize, usize> = BTreeMap::new();
        for (position, (_, sources, _)) in self.varying.iter().enumerate() {
            for source in sources {
                if let Source::Result(temporary) = source {
                    last_use.insert(*temporary, position);
                }
            }
        }
        let mut code = Code {
            samples: self.samples,
            outputs,
            more_outputs: self.program.outputs.len() - outputs,
            shared_slots: self.parameters() + self.constants.len() + self.shared.len(),
            instructions: Vec::with_capacity(self.varying.len() + stored.len()),
            slots: self.samples + copied.len(),
            constants: self.constants,
            shared: self.shared,
            copied,
        };
        let mut slot_of: BTreeMap<usize, usize> = BTreeMap::new();
        let mut free: Vec<usize> = Vec::new();
        let copy = |code: &mut Code, output: usize, place: usize| {
            code.instructions.push(Instruction {
                action: Action::Copy,
                operands: [place; 4],
                target: Target::Output(output),
            });
        };
        let copies = code.copied.clone();
        let samples = code.samples;
        let at_once = move |source: Source| match source {
            Source::Input(index) => Some(index),
            Source::Shared(slot) => {
                let index = copies.iter().position(|&copied| copied == slot)?;
                Some(samples + index)
            }
            Source::Result(_) => None,
        };
        for (output, source) in stored.iter().enumerate() {
            if let Some(place) = source.and_then(&at_once) {
                copy(&mut code, output, place);
            }
        }
        for (position, (action, sources, temporary)) in self.varying.iter().enumerate() {
            let operands: Vec<usize> = sources
                .iter()
                .filter_map(|&source| match source {
                    Source::Result(temporary) => slot_of.get(&temporary).copied(),
                    other => at_once(other),
                })
                .collect();
            let is_result = |&output: &usize| stored[output] == Some(Source::Result(*temporary));
            let stores: Vec<usize> = (0..stored.len()).filter(is_result).collect();
            let is_read = last_use.contains_key(temporary);
            let target = match stores.as_slice() {
                &[output] if !is_read => Target::Output(output),
                _ => Target::Slot(free.pop().unwrap_or_else(|| {
                    code.slots += 1;
                    code.slots - 1
                })),
            };
            code.instructions.push(Instruction {
                action: *action,
                operands: padded(&operands),
                target,
            });
            if let Target::Slot(slot) = target {
                for output in stores {
                    copy(&mut code, output, slot);
                }
                if is_read {
                    slot_of.insert(*temporary, slot);
                } else {
                    free.push(slot);
                }
            }
            for source in sources {
                if let Source::Result(operand) = source
                    && last_use.get(operand) == Some(&position)
                    && let Some(slot) = slot_of.remove(operand)
                {
                    free.push(slot);
                }
            }
        }
        code
    }
}

/// Operands that an action does not have repeat the first.
fn padded(operands: &[usize]) -> [usize; 4] {
    let mut padded = [operands.first().copied().unwrap_or(0); 4];
    for (slot, &operand) in padded.iter_mut().zip(operands) {
        *slot = operand;
    }
    padded
}
