//! A program as instructions on slots, and their execution.

use std::cell::RefCell;
use std::collections::BTreeMap;

use tau_runtime::{Kernel, LANES, Lanes, math, vectorized};

use crate::graph::Elementary;
use crate::program::{Operand, Operation, Program};

/// Blocks over which an instruction runs: enough to hide its decoding, few enough for the slots of a
/// residual to stay in cache.
const CHUNK: usize = 16;
/// One value for the samples of a chunk.
type Slot = [Lanes; CHUNK];

/// What an instruction does with its operands, slots a, b, c and d.
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
    /// Slot a is the output of this number.
    Store(usize),
}

#[derive(Debug, Clone, Copy)]
struct Instruction {
    action: Action,
    operands: [usize; 4],
    result: usize,
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
            if let Action::Store(output) = instruction.action {
                let value = slots[instruction.operands[0]];
                match output.checked_sub(self.outputs) {
                    None => outputs[output] = value,
                    Some(output) => more[output] = value,
                }
            } else {
                instruction.run(slots, 1);
            }
        }
        NUMBERS.set(numbers);
    }

    /// Computes what depends on parameters alone.
    fn share(&self, parameters: &[f64], numbers: &mut Vec<f64>) {
        numbers.clear();
        numbers.extend_from_slice(parameters);
        numbers.extend_from_slice(&self.constants);
        numbers.resize(self.shared_slots, 0.0);
        for instruction in &self.shared {
            instruction.run(numbers, 1);
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
                if let Action::Store(output) = instruction.action {
                    let slot = &slots[instruction.operands[0]];
                    for (block, lanes) in slot[..count].iter().enumerate() {
                        let block = first + block;
                        match output.checked_sub(code.outputs) {
                            None => outputs[block * code.outputs + output] = *lanes,
                            Some(output) => more[block * code.more_outputs + output] = *lanes,
                        }
                    }
                } else {
                    instruction.run(slots, count);
                }
            }
        }
    }
}

/// What a slot holds: a number, or those of a chunk.
trait Value: Copy {
    /// Applies a function of up to three numbers, lane by lane, in the first `count` blocks.
    fn map(&mut self, count: usize, a: &Self, b: &Self, c: &Self, f: impl Fn(f64, f64, f64) -> f64);
    /// `if a < b { c } else { d }`, lane by lane.
    fn select(&mut self, count: usize, operands: [&Self; 4]);
}

impl Value for f64 {
    #[inline(always)]
    fn map(&mut self, _: usize, a: &Self, b: &Self, c: &Self, f: impl Fn(f64, f64, f64) -> f64) {
        *self = f(*a, *b, *c);
    }

    #[inline(always)]
    fn select(&mut self, _: usize, [a, b, c, d]: [&Self; 4]) {
        *self = if a < b { *c } else { *d };
    }
}

impl Value for Slot {
    #[inline(always)]
    fn map(
        &mut self,
        count: usize,
        a: &Self,
        b: &Self,
        c: &Self,
        f: impl Fn(f64, f64, f64) -> f64,
    ) {
        for block in 0..count.min(CHUNK) {
            // Copies tell the compiler that the result overlaps no operand.
            let (a, b, c) = (a[block], b[block], c[block]);
            let mut result = Lanes::ZERO;
            for lane in 0..LANES {
                result[lane] = f(a[lane], b[lane], c[lane]);
            }
            self[block] = result;
        }
    }

    #[inline(always)]
    fn select(&mut self, count: usize, [a, b, c, d]: [&Self; 4]) {
        for block in 0..count.min(CHUNK) {
            let (a, b, c, d) = (a[block], b[block], c[block], d[block]);
            let mut result = Lanes::ZERO;
            for lane in 0..LANES {
                result[lane] = if a[lane] < b[lane] { c[lane] } else { d[lane] };
            }
            self[block] = result;
        }
    }
}

impl Instruction {
    #[inline(always)]
    fn run<V: Value>(&self, slots: &mut [V], count: usize) {
        let (below, rest) = slots.split_at_mut(self.result);
        let Some((result, above)) = rest.split_first_mut() else {
            return;
        };
        // A result's slot is never an operand's.
        let [a, b, c, d] = self.operands.map(|operand| {
            if operand < self.result {
                &below[operand]
            } else {
                &above[operand - self.result - 1]
            }
        });
        match self.action {
            Action::Add => result.map(count, a, b, b, |a, b, _| a + b),
            Action::Subtract => result.map(count, a, b, b, |a, b, _| a - b),
            Action::Multiply => result.map(count, a, b, b, |a, b, _| a * b),
            Action::Divide => result.map(count, a, b, b, |a, b, _| a / b),
            Action::Negate => result.map(count, a, a, a, |a, _, _| -a),
            Action::MultiplyAdd => result.map(count, a, b, c, |a, b, c| a * b + c),
            Action::MultiplySubtract => result.map(count, a, b, c, |a, b, c| a * b - c),
            Action::SubtractProduct => result.map(count, a, b, c, |a, b, c| c - a * b),
            Action::Select => result.select(count, [a, b, c, d]),
            Action::Apply(function) => {
                let function = elementary(function);
                result.map(count, a, a, a, |a, _, _| function(a));
            }
            Action::Store(_) => {}
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
                    result,
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
            let varying = operation
                .operands()
                .into_iter()
                .any(|operand| match operand {
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
        let store = |code: &mut Code, wanted: &dyn Fn(Source) -> Option<usize>| {
            for (output, source) in stored.iter().enumerate() {
                if let Some(slot) = source.and_then(wanted) {
                    code.instructions.push(Instruction {
                        action: Action::Store(output),
                        operands: [slot; 4],
                        result: 0,
                    });
                }
            }
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
        store(&mut code, &at_once);
        for (position, (action, sources, temporary)) in self.varying.iter().enumerate() {
            let result = free.pop().unwrap_or_else(|| {
                code.slots += 1;
                code.slots - 1
            });
            let operands: Vec<usize> = sources
                .iter()
                .filter_map(|&source| match source {
                    Source::Result(temporary) => slot_of.get(&temporary).copied(),
                    other => at_once(other),
                })
                .collect();
            code.instructions.push(Instruction {
                action: *action,
                operands: padded(&operands),
                result,
            });
            slot_of.insert(*temporary, result);
            store(&mut code, &|source| {
                (source == Source::Result(*temporary)).then_some(result)
            });
            for source in sources {
                if let Source::Result(operand) = source
                    && last_use.get(operand) == Some(&position)
                    && let Some(slot) = slot_of.remove(operand)
                {
                    free.push(slot);
                }
            }
            if !last_use.contains_key(temporary)
                && let Some(slot) = slot_of.remove(temporary)
            {
                free.push(slot);
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
