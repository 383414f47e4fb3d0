//! From programs to instructions: where each value is, and what runs once or for all samples.

use rustc_hash::FxHashMap;

use super::{Action, Code, Instruction, Target, Then};
use crate::program::{Operand, Operation, Program};

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
pub(super) struct Translation<'a> {
    program: &'a Program,
    samples: usize,
    constants: Vec<f64>,
    /// Index of each constant, by its bits.
    constant_places: FxHashMap<u64, usize>,
    shared: Vec<Instruction>,
    /// Where each temporary is; `None` for products inside a later instruction.
    temporaries: Vec<Option<Source>>,
    /// Instructions for samples.
    varying: Vec<Step>,
}

/// An instruction whose slots are not given out yet.
#[derive(Debug, Clone)]
struct Step {
    action: Action,
    operands: Vec<Source>,
    then: Then,
    further: Vec<Source>,
    /// What it computes.
    temporary: usize,
}

impl Step {
    fn sources(&self) -> impl Iterator<Item = Source> {
        self.operands.iter().chain(&self.further).copied()
    }

    /// What it does with an operand that is computed right before it, and its other operands.
    fn with_first(&self, first: Source) -> Option<(Then, Vec<Source>)> {
        Some(match (self.action, self.operands.as_slice()) {
            (Action::Add, &[a, b]) if b == first => (Then::Add, vec![a]),
            (Action::Add, &[a, b]) if a == first => (Then::Add, vec![b]),
            (Action::Subtract, &[a, b]) if a == first => (Then::Subtract, vec![b]),
            (Action::Multiply, &[a, b]) if b == first => (Then::Multiply, vec![a]),
            (Action::Multiply, &[a, b]) if a == first => (Then::Multiply, vec![b]),
            (Action::MultiplyAdd, &[a, b, c]) if c == first => (Then::AddProduct, vec![a, b]),
            (Action::SubtractProduct, &[a, b, c]) if c == first => {
                (Then::SubtractProduct, vec![a, b])
            }
            _ => return None,
        })
    }
}

impl<'a> Translation<'a> {
    pub(super) fn new(program: &'a Program, samples: usize) -> Self {
        let mut translation = Self {
            program,
            samples,
            constants: vec![],
            constant_places: FxHashMap::default(),
            shared: vec![],
            temporaries: vec![None; program.operations.len()],
            varying: vec![],
        };
        translation.collect_constants();
        translation.translate();
        translation.join();
        translation
    }

    fn collect_constants(&mut self) {
        let operations = self.program.operations.iter().flat_map(Operation::operands);
        for operand in operations.chain(self.program.outputs.iter().copied()) {
            if let Operand::Constant(value) = operand {
                let next = self.constants.len();
                if *self.constant_places.entry(value.to_bits()).or_insert(next) == next {
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
                let index = self.constant_places.get(&value.to_bits())?;
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
                    then: Then::Nothing,
                    further: [0; 2],
                    target: Target::Slot(result),
                });
                Source::Shared(result)
            } else {
                self.varying.push(Step {
                    action,
                    operands: sources,
                    then: Then::Nothing,
                    further: vec![],
                    temporary: index,
                });
                Source::Result(index)
            });
        }
    }

    /// Joins a step with the one that alone reads its result: that saves storing and reading it.
    fn join(&mut self) {
        let mut uses = vec![0_usize; self.program.operations.len()];
        let outputs = self.program.outputs.iter();
        let outputs = outputs.filter_map(|&output| self.source(output));
        for source in (self.varying.iter().flat_map(Step::sources)).chain(outputs) {
            if let Source::Result(temporary) = source {
                uses[temporary] += 1;
            }
        }
        let mut place_of: Vec<Option<usize>> = vec![None; uses.len()];
        let mut joined: Vec<Option<Step>> = Vec::with_capacity(self.varying.len());
        for step in self.varying.drain(..) {
            let found = step.operands.iter().find_map(|&source| {
                let Source::Result(temporary) = source else {
                    return None;
                };
                let place = place_of[temporary].filter(|_| uses[temporary] == 1)?;
                let first = joined[place].as_ref()?;
                let can_join = first.then == Then::Nothing && first.action.is_arithmetic();
                let (then, further) = step.with_first(source).filter(|_| can_join)?;
                Some((place, then, further))
            });
            let temporary = step.temporary;
            place_of[temporary] = Some(joined.len());
            let both = found.and_then(|(place, then, further)| {
                Some(Step {
                    then,
                    further,
                    temporary,
                    ..joined[place].take()?
                })
            });
            joined.push(Some(both.unwrap_or(step)));
        }
        self.varying = joined.into_iter().flatten().collect();
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
    pub(super) fn finish(self, outputs: usize) -> Code {
        let stored: Vec<Option<Source>> = self
            .program
            .outputs
            .iter()
            .map(|&output| self.source(output))
            .collect();
        let mut copied: Vec<usize> = Vec::new();
        let mut copies: FxHashMap<usize, usize> = FxHashMap::default();
        let sources = self.varying.iter().flat_map(Step::sources);
        for source in sources.chain(stored.iter().flatten().copied()) {
            if let Source::Shared(slot) = source
                && *copies.entry(slot).or_insert(copied.len()) == copied.len()
            {
                copied.push(slot);
            }
        }
        let temporaries = self.program.operations.len();
        let mut last_use: Vec<Option<usize>> = vec![None; temporaries];
        for (position, step) in self.varying.iter().enumerate() {
            for source in step.sources() {
                if let Source::Result(temporary) = source {
                    last_use[temporary] = Some(position);
                }
            }
        }
        let mut stores_of: Vec<Vec<usize>> = vec![vec![]; temporaries];
        for (output, source) in stored.iter().enumerate() {
            if let Some(Source::Result(temporary)) = source {
                stores_of[*temporary].push(output);
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
        let mut slot_of: Vec<Option<usize>> = vec![None; temporaries];
        let mut free: Vec<usize> = Vec::new();
        let copy = |code: &mut Code, output: usize, place: usize| {
            code.instructions.push(Instruction {
                action: Action::Copy,
                operands: [place; 4],
                then: Then::Nothing,
                further: [0; 2],
                target: Target::Output(output),
            });
        };
        let samples = code.samples;
        let at_once = move |source: Source| match source {
            Source::Input(index) => Some(index),
            Source::Shared(slot) => Some(samples + copies.get(&slot)?),
            Source::Result(_) => None,
        };
        for (output, source) in stored.iter().enumerate() {
            if let Some(place) = source.and_then(&at_once) {
                copy(&mut code, output, place);
            }
        }
        for (position, step) in self.varying.iter().enumerate() {
            let slots = |sources: &[Source]| -> Vec<usize> {
                let slot = |&source: &Source| match source {
                    Source::Result(temporary) => slot_of[temporary],
                    other => at_once(other),
                };
                sources.iter().filter_map(slot).collect()
            };
            let (operands, further) = (slots(&step.operands), slots(&step.further));
            let stores = &stores_of[step.temporary];
            let is_read = last_use[step.temporary].is_some();
            let target = match stores.as_slice() {
                &[output] if !is_read => Target::Output(output),
                _ => Target::Slot(free.pop().unwrap_or_else(|| {
                    code.slots += 1;
                    code.slots - 1
                })),
            };
            code.instructions.push(Instruction {
                action: step.action,
                operands: padded(&operands),
                then: step.then,
                further: padded(&further),
                target,
            });
            if let Target::Slot(slot) = target {
                for &output in stores {
                    copy(&mut code, output, slot);
                }
                if is_read {
                    slot_of[step.temporary] = Some(slot);
                } else {
                    free.push(slot);
                }
            }
            for source in step.sources() {
                if let Source::Result(operand) = source
                    && last_use[operand] == Some(position)
                    && let Some(slot) = slot_of[operand].take()
                {
                    free.push(slot);
                }
            }
        }
        code
    }
}

/// Operands that an action does not have repeat the first.
fn padded<const N: usize>(operands: &[usize]) -> [usize; N] {
    let mut padded = [operands.first().copied().unwrap_or(0); N];
    for (slot, &operand) in padded.iter_mut().zip(operands) {
        *slot = operand;
    }
    padded
}
