//! From programs to instructions: where each value is, and what runs once or for all samples.

use rustc_hash::FxHashMap;

use super::{Action, Code, Instruction, MOST, Target};
use crate::program::{Operand, Operation, Program};

/// Place of a value before slots are given out.
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
    /// Place of each temporary; `None` for those that are still to be computed.
    temporaries: Vec<Option<Source>>,
    /// Sums that a single later operation reads: they may become part of it.
    pending: Vec<Option<Vec<Term>>>,
    /// Instructions for samples.
    varying: Vec<Step>,
}

/// A product in a sum, with its sign.
#[derive(Debug, Clone, Copy)]
struct Term {
    is_negative: bool,
    factors: [Source; 2],
}

/// An instruction whose slots are not given out yet.
#[derive(Debug, Clone)]
struct Step {
    action: Action,
    operands: Vec<[Source; 2]>,
    signs: Vec<f64>,
    /// Its result.
    temporary: usize,
}

impl Step {
    fn sources(&self) -> impl Iterator<Item = Source> {
        self.operands.iter().flatten().copied()
    }

    /// True if all samples share what it computes.
    fn is_shared(&self) -> bool {
        let mut sources = self.sources();
        sources.all(|source| matches!(source, Source::Shared(_)))
    }

    fn instruction(&self, place: impl Fn(Source) -> usize, target: Target) -> Instruction {
        let operands: Vec<[usize; 2]> = (self.operands.iter())
            .map(|pair| pair.map(&place))
            .collect();
        Instruction {
            action: self.action,
            operands: padded(&operands),
            signs: padded(&self.signs),
            target,
        }
    }

    fn of_sum(terms: &[Term], temporary: usize) -> Self {
        let sign = |term: &Term| if term.is_negative { -1.0 } else { 1.0 };
        Self {
            action: Action::Sum(terms.len()),
            operands: terms.iter().map(|term| term.factors).collect(),
            signs: terms.iter().map(sign).collect(),
            temporary,
        }
    }
}

impl<'a> Translation<'a> {
    pub(super) fn new(program: &'a Program, samples: usize) -> Self {
        let temporaries = program.operations.len();
        let mut translation = Self {
            program,
            samples,
            constants: vec![],
            constant_places: FxHashMap::default(),
            shared: vec![],
            temporaries: vec![None; temporaries],
            pending: vec![None; temporaries],
            varying: vec![],
        };
        translation.collect_constants();
        translation.translate();
        translation
    }

    fn collect_constants(&mut self) {
        let operations = self.program.operations.iter().flat_map(Operation::operands);
        let one = std::iter::once(Operand::Constant(1.0));
        for operand in (one.chain(operations)).chain(self.program.outputs.iter().copied()) {
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

    /// Place of an operand; one that is still to be computed is computed now.
    fn source(&mut self, operand: Operand) -> Source {
        match operand {
            Operand::Constant(value) => {
                let index = self.constant_places[&value.to_bits()];
                Source::Shared(self.parameters() + index)
            }
            Operand::Input(index) => match index.checked_sub(self.samples) {
                None => Source::Input(index),
                Some(parameter) => Source::Shared(parameter),
            },
            Operand::Temporary(index) => match self.temporaries[index] {
                Some(source) => source,
                None => {
                    let terms = self.pending[index].take().unwrap_or_default();
                    self.varying.push(Step::of_sum(&terms, index));
                    *self.temporaries[index].insert(Source::Result(index))
                }
            },
        }
    }

    fn translate(&mut self) {
        let program = self.program;
        let uses = program.uses();
        for (index, &operation) in program.operations.iter().enumerate() {
            if let Some(terms) = self.terms(operation) {
                let step = Step::of_sum(&terms, index);
                if step.is_shared() {
                    self.share(&step);
                    continue;
                }
                self.pending[index] = Some(terms);
                if uses[index] > 1 {
                    self.source(Operand::Temporary(index));
                }
                continue;
            }
            let (action, operands) = match operation {
                Operation::Apply(function, a) => (Action::Apply(function), vec![[a, a]]),
                Operation::Select([a, b, c, d]) => (Action::Select, vec![[a, b], [c, d]]),
                Operation::Divide(a, b) => (Action::Divide, vec![[a, b]]),
                _ => unreachable!("all others are sums of products"),
            };
            let step = Step {
                action,
                operands: (operands.into_iter())
                    .map(|pair| pair.map(|operand| self.source(operand)))
                    .collect(),
                signs: vec![],
                temporary: index,
            };
            if step.is_shared() {
                self.share(&step);
            } else {
                self.varying.push(step);
                self.temporaries[index] = Some(Source::Result(index));
            }
        }
        for &output in &program.outputs {
            self.source(output);
        }
    }

    /// Has a step run once for all samples.
    fn share(&mut self, step: &Step) {
        let result = self.parameters() + self.constants.len() + self.shared.len();
        let place = |source: Source| match source {
            Source::Shared(slot) => slot,
            Source::Input(_) | Source::Result(_) => {
                unreachable!("what all samples share reads nothing of a sample")
            }
        };
        self.temporaries[step.temporary] = Some(Source::Shared(result));
        self.shared
            .push(step.instruction(place, Target::Slot(result)));
    }

    /// An operation as a sum of products, with what it takes in of operands that nothing else reads; `None` where
    /// it is none.
    fn terms(&mut self, operation: Operation) -> Option<Vec<Term>> {
        match operation {
            Operation::Multiply(a, b) => Some(vec![Term {
                is_negative: false,
                factors: [self.source(a), self.source(b)],
            }]),
            Operation::Negate(a) => {
                let mut terms = self.taken_in(a, 1);
                terms[0].is_negative ^= true;
                Some(terms)
            }
            Operation::Add(a, b) => {
                // Sums go on from the first operand, or the second: which one makes no difference.
                let (first, second) = if self.length(a) >= self.length(b) {
                    (a, b)
                } else {
                    (b, a)
                };
                let mut terms = self.taken_in(first, MOST - 1);
                terms.extend(self.taken_in(second, 1));
                Some(terms)
            }
            Operation::Subtract(a, b) => {
                let mut terms = self.taken_in(a, MOST - 1);
                let mut last = self.taken_in(b, 1);
                last[0].is_negative ^= true;
                terms.append(&mut last);
                Some(terms)
            }
            Operation::Divide(..) | Operation::Apply(..) | Operation::Select(_) => None,
        }
    }

    /// Number of products of an operand that is still to be computed.
    fn length(&self, operand: Operand) -> usize {
        match operand {
            Operand::Temporary(index) => self.pending[index].as_ref().map_or(0, Vec::len),
            _ => 0,
        }
    }

    /// The products of an operand that is still to be computed, up to so many; of any other the operand itself.
    fn taken_in(&mut self, operand: Operand, most: usize) -> Vec<Term> {
        if let Operand::Temporary(index) = operand
            && (1..=most).contains(&self.length(operand))
            && let Some(terms) = self.pending[index].take()
        {
            return terms;
        }
        let one = self.source(Operand::Constant(1.0));
        vec![Term {
            is_negative: false,
            factors: [self.source(operand), one],
        }]
    }

    /// Gives out slots: a result's is free again after its last use.
    pub(super) fn finish(mut self, outputs: usize) -> Code {
        let of_program = self.program.outputs.iter();
        let stored: Vec<Source> = of_program.map(|&output| self.source(output)).collect();
        let one = self.source(Operand::Constant(1.0));
        let mut copied: Vec<usize> = Vec::new();
        let mut copies: FxHashMap<usize, usize> = FxHashMap::default();
        let sources = self.varying.iter().flat_map(Step::sources);
        for source in (sources.chain(stored.iter().copied())).chain([one]) {
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
        for (output, &source) in stored.iter().enumerate() {
            if let Source::Result(temporary) = source {
                stores_of[temporary].push(output);
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
        let samples = code.samples;
        let at_once = move |source: Source| match source {
            Source::Input(index) => Some(index),
            Source::Shared(slot) => Some(samples + copies.get(&slot)?),
            Source::Result(_) => None,
        };
        let one = at_once(one).unwrap_or_default();
        let copy = |code: &mut Code, output: usize, place: usize| {
            let (operands, signs) = (padded(&[[place, one]]), padded(&[1.0]));
            code.instructions.push(Instruction {
                action: Action::Sum(1),
                operands,
                signs,
                target: Target::Output(output),
            });
        };
        for (output, &source) in stored.iter().enumerate() {
            if let Some(place) = at_once(source) {
                copy(&mut code, output, place);
            }
        }
        for (position, step) in self.varying.iter().enumerate() {
            let stores = &stores_of[step.temporary];
            let is_read = last_use[step.temporary].is_some();
            let target = match stores.as_slice() {
                &[output] if !is_read => Target::Output(output),
                _ => Target::Slot(free.pop().unwrap_or_else(|| {
                    code.slots += 1;
                    code.slots - 1
                })),
            };
            let place = |source| match source {
                Source::Result(temporary) => slot_of[temporary],
                other => at_once(other),
            };
            let place = |source| place(source).unwrap_or_else(|| unreachable!("computed before"));
            code.instructions.push(step.instruction(place, target));
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

/// Values that an action does not have repeat the first, if there is any.
fn padded<T: Copy + Default>(values: &[T]) -> [T; MOST] {
    let mut padded = [values.first().copied().unwrap_or_default(); MOST];
    for (place, &value) in padded.iter_mut().zip(values) {
        *place = value;
    }
    padded
}
