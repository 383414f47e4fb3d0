//! Lowered code: straight-line instructions with a known operation count.

use std::collections::BTreeSet;
use std::fmt;

use crate::graph::Elementary;

/// Source of an instruction's value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Operand {
    /// A number.
    Constant(f64),
    /// An input, by position.
    Input(usize),
    /// The result of an earlier instruction, by position.
    Temporary(usize),
}

/// One operation; its result is the temporary of its position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Operation {
    /// `a + b`
    Add(Operand, Operand),
    /// `a - b`
    Subtract(Operand, Operand),
    /// `a * b`
    Multiply(Operand, Operand),
    /// `a / b`
    Divide(Operand, Operand),
    /// `-a`
    Negate(Operand),
    /// An elementary function.
    Apply(Elementary, Operand),
    /// `if left < right { below } else { otherwise }`, as `[left, right, below, otherwise]`.
    Select([Operand; 4]),
}

impl Operation {
    /// The operands, in order.
    pub fn operands(&self) -> impl Iterator<Item = Operand> + use<> {
        let operands = match *self {
            Self::Add(a, b) | Self::Subtract(a, b) | Self::Multiply(a, b) | Self::Divide(a, b) => {
                [Some(a), Some(b), None, None]
            }
            Self::Negate(a) | Self::Apply(_, a) => [Some(a), None, None, None],
            Self::Select(operands) => operands.map(Some),
        };
        operands.into_iter().flatten()
    }
}

/// Straight-line code from inputs to outputs.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Program {
    /// Names of the inputs, valid identifiers.
    pub inputs: Vec<String>,
    /// Operations in order of execution.
    pub operations: Vec<Operation>,
    /// A suggested name for each temporary.
    pub names: Vec<Option<String>>,
    /// Results.
    pub outputs: Vec<Operand>,
}

/// Operations by class.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Additions and subtractions.
    pub additions: usize,
    /// Multiplications.
    pub multiplications: usize,
    /// Divisions.
    pub divisions: usize,
    /// Changes of sign.
    pub negations: usize,
    /// Elementary functions.
    pub functions: usize,
    /// Selects.
    pub selects: usize,
}

impl Counts {
    /// All together.
    pub fn total(&self) -> usize {
        self.additions
            + self.multiplications
            + self.divisions
            + self.negations
            + self.functions
            + self.selects
    }
}

impl fmt::Display for Counts {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} operations", self.total())?;
        let parts: Vec<String> = [
            (self.additions, "additions"),
            (self.multiplications, "multiplications"),
            (self.divisions, "divisions"),
            (self.negations, "negations"),
            (self.functions, "functions"),
            (self.selects, "selects"),
        ]
        .iter()
        .filter(|(count, _)| *count > 0)
        .map(|(count, what)| {
            format!(
                "{count} {}",
                if *count == 1 {
                    &what[..what.len() - 1]
                } else {
                    what
                }
            )
        })
        .collect();
        if parts.is_empty() {
            Ok(())
        } else {
            write!(f, " ({})", parts.join(", "))
        }
    }
}

/// Names that emitted functions give to their own arguments and modules.
pub(crate) const RESERVED: [&str; 7] = [
    "lane",
    "data",
    "prepared",
    "parameters",
    "residuals",
    "jacobian",
    "math",
];

impl Program {
    /// Operations by class.
    pub fn counts(&self) -> Counts {
        let mut counts = Counts::default();
        for operation in &self.operations {
            *match operation {
                Operation::Add(..) | Operation::Subtract(..) => &mut counts.additions,
                Operation::Multiply(..) => &mut counts.multiplications,
                Operation::Divide(..) => &mut counts.divisions,
                Operation::Negate(_) => &mut counts.negations,
                Operation::Apply(..) => &mut counts.functions,
                Operation::Select(_) => &mut counts.selects,
            } += 1;
        }
        counts
    }

    /// Number of reads of each temporary, outputs included.
    pub fn uses(&self) -> Vec<usize> {
        let mut uses = vec![0; self.operations.len()];
        let reads = self
            .operations
            .iter()
            .flat_map(Operation::operands)
            .chain(self.outputs.iter().copied());
        for operand in reads {
            if let Operand::Temporary(index) = operand {
                uses[index] += 1;
            }
        }
        uses
    }

    /// Inputs that are read, outputs included.
    pub fn reads(&self) -> Vec<bool> {
        let mut reads = vec![false; self.inputs.len()];
        for operand in self
            .operations
            .iter()
            .flat_map(Operation::operands)
            .chain(self.outputs.iter().copied())
        {
            if let Operand::Input(index) = operand {
                reads[index] = true;
            }
        }
        reads
    }

    /// A name for each temporary: the suggested one, `sin_alpha` for functions of inputs, or `t` with
    /// a number; made unique.
    pub fn temporary_names(&self) -> Vec<String> {
        let mut taken: BTreeSet<String> = self.inputs.iter().cloned().collect();
        taken.extend(RESERVED.map(str::to_owned));
        let mut names = Vec::with_capacity(self.names.len());
        for (index, (suggested, operation)) in self.names.iter().zip(&self.operations).enumerate() {
            let base = match (suggested, operation) {
                (Some(name), _) => name.clone(),
                (None, Operation::Apply(function, Operand::Input(input))) => {
                    format!("{}_{}", function.name(), self.inputs[*input])
                }
                _ => format!("t{}", index + 1),
            };
            let mut name = base.clone();
            let mut suffix = 1;
            while !taken.insert(name.clone()) {
                suffix += 1;
                name = format!("{base}_{suffix}");
            }
            names.push(name);
        }
        names
    }
}

/// One operation a line, then the outputs: the form that snapshots pin.
impl fmt::Display for Program {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names = self.temporary_names();
        let show = |operand: &Operand| match *operand {
            Operand::Constant(value) => format!("{value}"),
            Operand::Input(index) => self.inputs[index].clone(),
            Operand::Temporary(index) => names[index].clone(),
        };
        writeln!(f, "// {}", self.counts())?;
        for (operation, name) in self.operations.iter().zip(&names) {
            let text = match operation {
                Operation::Add(a, b) => format!("{} + {}", show(a), show(b)),
                Operation::Subtract(a, b) => format!("{} - {}", show(a), show(b)),
                Operation::Multiply(a, b) => format!("{} * {}", show(a), show(b)),
                Operation::Divide(a, b) => format!("{} / {}", show(a), show(b)),
                Operation::Negate(a) => format!("-{}", show(a)),
                Operation::Apply(function, a) => format!("{}({})", function.name(), show(a)),
                Operation::Select([l, r, a, b]) => {
                    format!(
                        "if {} < {} {{ {} }} else {{ {} }}",
                        show(l),
                        show(r),
                        show(a),
                        show(b)
                    )
                }
            };
            writeln!(f, "{name} = {text}")?;
        }
        for (index, output) in self.outputs.iter().enumerate() {
            writeln!(f, "output[{index}] = {}", show(output))?;
        }
        Ok(())
    }
}

impl Elementary {
    /// Its name in the language and in `tau_runtime::math`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sqrt => "sqrt",
            Self::Sin => "sin",
            Self::Cos => "cos",
            Self::Tan => "tan",
            Self::Atan => "atan",
            Self::Exp => "exp",
            Self::Ln => "ln",
            Self::Tanh => "tanh",
        }
    }
}
