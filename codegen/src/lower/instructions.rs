//! Instruction selection: sums with chosen signs become additions and subtractions.

use rustc_hash::{FxBuildHasher, FxHashMap};

use super::form::{Form, Value};
use super::signs::Signs;
use crate::graph::{Elementary, ExprMap, Graph};
use crate::program::{Operand, Operation, Program};

/// Writes the instructions, with each value stored under its chosen sign.
pub(super) fn emit(
    graph: &Graph,
    form: &Form,
    signs: &Signs,
    inputs: &ExprMap<usize>,
    input_names: Vec<String>,
) -> Program {
    debug_assert!(inputs.values().all(|&input| input < input_names.len()));
    let mut writer = Writer {
        program: Program {
            inputs: input_names,
            ..Program::default()
        },
        stored: Vec::with_capacity(form.values.len()),
        negated: FxHashMap::default(),
        written: FxHashMap::with_capacity_and_hasher(2 * form.values.len(), FxBuildHasher),
    };
    for (index, value) in form.values.iter().enumerate() {
        let negative = signs.values[index];
        let operand = match value {
            Value::Input(input) => Operand::Input(*input),
            Value::Constant(number) => Operand::Constant(if negative { -number } else { *number }),
            Value::Sum(terms) => {
                let terms: Vec<(bool, Operand)> = terms
                    .iter()
                    .map(|&(minus, term)| {
                        (
                            (minus != signs.values[term]) != negative,
                            writer.stored[term],
                        )
                    })
                    .collect();
                writer.sum(&terms)
            }
            Value::Product(a, b) => {
                let (mut x, mut y) = (writer.stored[*a], writer.stored[*b]);
                // The product's sign follows from its factors unless one is a number.
                if (signs.values[*a] != signs.values[*b]) != negative {
                    if let Operand::Constant(number) = x {
                        x = Operand::Constant(-number);
                    } else if let Operand::Constant(number) = y {
                        y = Operand::Constant(-number);
                    }
                }
                writer.push(Operation::Multiply(x, y))
            }
            Value::Quotient(a, b) => {
                let (mut x, y) = (writer.stored[*a], writer.stored[*b]);
                if (signs.values[*a] != signs.values[*b]) != negative
                    && let Operand::Constant(number) = x
                {
                    x = Operand::Constant(-number);
                }
                writer.push(Operation::Divide(x, y))
            }
            Value::Apply(function, (minus, operand)) => {
                let operand = writer.read(*operand, *minus != signs.values[*operand]);
                writer.push(Operation::Apply(*function, operand))
            }
            Value::Select(operands) => {
                let operands = operands
                    .map(|(minus, operand)| writer.read(operand, minus != signs.values[operand]));
                writer.push(Operation::Select(operands))
            }
        };
        if let Operand::Temporary(temporary) = operand
            && !negative
            && let Some(name) = graph.name_of(form.exprs[index])
        {
            writer.program.names[temporary].get_or_insert_with(|| name.to_owned());
        }
        writer.stored.push(operand);
    }
    let outputs: Vec<Operand> = form
        .outputs
        .iter()
        .map(|&(minus, value)| writer.read(value, minus != signs.values[value]))
        .collect();
    writer.program.outputs = outputs;
    writer.program
}

struct Writer {
    program: Program,
    /// Place of each value, under its sign.
    stored: Vec<Operand>,
    /// Negated copies already made.
    negated: FxHashMap<usize, Operand>,
    /// Operations already written.
    written: FxHashMap<Key, usize>,
}

/// An operation as something that can be looked up.
type Key = (u8, Option<Elementary>, [(u8, u64); 4]);

fn key(operation: &Operation) -> Key {
    let mut operands = [(0, 0); 4];
    for (key, operand) in operands.iter_mut().zip(operation.operands()) {
        *key = match operand {
            Operand::Constant(value) => (1, value.to_bits()),
            Operand::Input(index) => (2, index as u64),
            Operand::Temporary(index) => (3, index as u64),
        };
    }
    let (kind, function) = match operation {
        Operation::Add(..) => (0, None),
        Operation::Subtract(..) => (1, None),
        Operation::Multiply(..) => (2, None),
        Operation::Divide(..) => (3, None),
        Operation::Negate(_) => (4, None),
        Operation::Apply(function, _) => (5, Some(*function)),
        Operation::Select(_) => (6, None),
    };
    if matches!(operation, Operation::Add(..) | Operation::Multiply(..)) {
        operands[..2].sort_unstable();
    }
    (kind, function, operands)
}

impl Writer {
    /// The result of an operation; one that was written before is not written again.
    ///
    /// Expressions are unique already, but flattened sums may begin with the same terms.
    fn push(&mut self, operation: Operation) -> Operand {
        let next = self.program.operations.len();
        let index = *self.written.entry(key(&operation)).or_insert(next);
        if index == next {
            self.program.operations.push(operation);
            self.program.names.push(None);
        }
        Operand::Temporary(index)
    }

    /// A stored value, negated if asked.
    fn read(&mut self, value: usize, negate: bool) -> Operand {
        let operand = self.stored[value];
        if !negate {
            return operand;
        }
        if let Operand::Constant(number) = operand {
            return Operand::Constant(-number);
        }
        if let Some(&copy) = self.negated.get(&value) {
            return copy;
        }
        let copy = self.push(Operation::Negate(operand));
        self.negated.insert(value, copy);
        copy
    }

    fn sum(&mut self, terms: &[(bool, Operand)]) -> Operand {
        let Some(lead) = terms.iter().position(|&(negative, _)| !negative) else {
            let positive: Vec<(bool, Operand)> = terms.iter().map(|&(_, t)| (false, t)).collect();
            let total = self.sum(&positive);
            return self.push(Operation::Negate(total));
        };
        let mut total = terms[lead].1;
        for (index, &(negative, term)) in terms.iter().enumerate() {
            if index != lead {
                total = self.push(if negative {
                    Operation::Subtract(total, term)
                } else {
                    Operation::Add(total, term)
                });
            }
        }
        total
    }
}
