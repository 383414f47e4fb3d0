//! A residual family as a unit struct that implements the runtime trait.

use proc_macro2::{Literal, TokenStream};
use quote::quote;

use super::{camel_case, ident};
use crate::compile::Family;
use crate::graph::Elementary;
use crate::program::{Operand, Operation, Program};

/// The struct and its implementation; `place` makes the tokens that stand for the statements of a function.
pub(super) fn family(
    family: &Family,
    place: &mut dyn FnMut(Vec<String>) -> TokenStream,
) -> TokenStream {
    let name = ident(&camel_case(&family.name));
    let sizes = [
        family.shape.data,
        family.shape.prepared,
        family.shape.parameters,
        family.shape.residuals,
    ]
    .map(Literal::usize_unsuffixed);
    let [data, prepared, parameters, residuals] = sizes;
    let row_starts = family
        .row_starts
        .iter()
        .map(|&n| Literal::u32_unsuffixed(n));
    let columns = family.columns.iter().map(|&n| Literal::u32_unsuffixed(n));
    let docs = [
        format!(" `{}`", family.equation),
        String::new(),
        format!(" Data: {}.", list(&family.data)),
        String::new(),
        format!(" Parameters: {}.", list(&family.parameters)),
        String::new(),
        format!(" Once per sample: {}.", family.programs.prepare.counts()),
        format!(" Residuals: {}.", family.programs.value.counts()),
        format!(
            " With the Jacobian: {}.",
            family.programs.linearize.counts()
        ),
    ];
    let prepare = body(&family.programs.prepare, family.shape.data);
    let value = body(&family.programs.value, family.shape.prepared);
    let linearize = body(&family.programs.linearize, family.shape.prepared);
    let data_read = read(&prepare.first, "data");
    let prepared_read_by_value = read_lane(&value.first, "prepared");
    let parameters_read_by_value = read(&value.rest, "parameters");
    let prepared_read = read_lane(&linearize.first, "prepared");
    let parameters_read = read(&linearize.rest, "parameters");
    let (residual_outputs, jacobian_outputs) = linearize.outputs.split_at(family.shape.residuals);
    // Names of arguments that a family has no use for begin with an underscore.
    let argument =
        |name: &str, is_used: bool| ident(&format!("{}{name}", if is_used { "" } else { "_" }));
    let prepare_lane = argument("lane", !prepare.outputs.is_empty());
    let prepare_data = argument("data", !data_read.is_empty());
    let prepare_prepared = argument("prepared", !prepare.outputs.is_empty());
    let value_prepared = argument("prepared", !prepared_read_by_value.is_empty());
    let value_parameters = argument("parameters", !parameters_read_by_value.is_empty());
    let linearize_prepared = argument("prepared", !prepared_read.is_empty());
    let linearize_parameters = argument("parameters", !parameters_read.is_empty());
    let linearize_jacobian = argument("jacobian", !jacobian_outputs.is_empty());
    let prepare = place(
        [
            data_read,
            prepare.statements,
            write("prepared", &prepare.outputs),
        ]
        .concat(),
    );
    let value = place(
        [
            prepared_read_by_value,
            parameters_read_by_value,
            value.statements,
            write("residuals", &value.outputs),
        ]
        .concat(),
    );
    let linearize = place(
        [
            prepared_read,
            parameters_read,
            linearize.statements,
            write("residuals", residual_outputs),
            write("jacobian", jacobian_outputs),
        ]
        .concat(),
    );
    quote! {
        #(#[doc = #docs])*
        #[derive(Debug, Clone, Copy)]
        pub struct #name;

        impl Formulas for #name {
            const SHAPE: Shape = Shape {
                data: #data,
                prepared: #prepared,
                parameters: #parameters,
                residuals: #residuals,
            };
            const PATTERN: Pattern<'static> = Pattern {
                row_starts: &[#(#row_starts),*],
                columns: &[#(#columns),*],
            };

            #[inline(always)]
            fn prepare<S: Samples>(
                #prepare_lane: usize,
                #prepare_data: &[f64],
                #prepare_prepared: &mut [S],
            ) {
                #prepare
            }

            #[inline(always)]
            fn value<S: Samples>(
                lane: usize,
                #value_prepared: &[S],
                #value_parameters: &[f64],
                residuals: &mut [S],
            ) {
                #value
            }

            #[inline(always)]
            fn linearize<S: Samples>(
                lane: usize,
                #linearize_prepared: &[S],
                #linearize_parameters: &[f64],
                residuals: &mut [S],
                #linearize_jacobian: &mut [S],
            ) {
                #linearize
            }
        }
    }
}

fn list(names: &[String]) -> String {
    if names.is_empty() {
        return "none".into();
    }
    names
        .iter()
        .map(|name| format!("`{name}`"))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Binds the entries of a slice to names; nothing where none is read.
fn read(names: &[Option<String>], slice: &str) -> Vec<String> {
    let count = names.len();
    if names.iter().all(Option::is_none) {
        return vec![];
    }
    let names: Vec<&str> = names
        .iter()
        .map(|name| name.as_deref().unwrap_or("_"))
        .collect();
    let names = names.join(", ");
    let message = format!("`{slice}` must hold {count} numbers");
    vec![format!(
        "let &[{names}] = {slice} else {{ panic!({message:?}) }};"
    )]
}

/// Binds what the sample has of each entry of a slice to names.
fn read_lane(names: &[Option<String>], slice: &str) -> Vec<String> {
    let reads = names.iter().enumerate().filter_map(|(index, name)| {
        let name = name.as_ref()?;
        Some(format!("let {name} = {slice}[{index}][lane];"))
    });
    reads.collect()
}

/// Stores the sample's results.
fn write(slice: &str, values: &[String]) -> Vec<String> {
    let writes = values.iter().enumerate();
    writes
        .map(|(index, value)| format!("{slice}[{index}][lane] = {value};"))
        .collect()
}

/// A program as Rust.
struct Body {
    /// Names of the inputs of the first slice, where they are read.
    first: Vec<Option<String>>,
    /// Names of those of the second.
    rest: Vec<Option<String>>,
    statements: Vec<String>,
    outputs: Vec<String>,
}

fn body(program: &Program, split: usize) -> Body {
    let writer = Writer {
        program,
        uses: program.uses(),
        names: program.temporary_names(),
    };
    let reads = program.reads();
    let mut first: Vec<Option<String>> = program
        .inputs
        .iter()
        .zip(reads)
        .map(|(name, read)| read.then(|| name.clone()))
        .collect();
    let rest = first.split_off(split.min(first.len()));
    let mut statements = Vec::new();
    let mut written = vec![false; program.operations.len()];
    for index in 0..program.operations.len() {
        if writer.is_inline(index) || written[index] {
            continue;
        }
        if let Operation::Apply(function @ (Elementary::Sin | Elementary::Cos), angle) =
            program.operations[index]
            && let Some(other) = writer.partner(function, angle)
            && !written[other]
        {
            let (sin, cos) = if function == Elementary::Sin {
                (index, other)
            } else {
                (other, index)
            };
            let (sin_name, cos_name) = (&writer.names[sin], &writer.names[cos]);
            let (angle, _) = writer.operand(angle);
            statements.push(format!(
                "let ({sin_name}, {cos_name}) = math::sin_cos({angle});"
            ));
            written[sin] = true;
            written[cos] = true;
            continue;
        }
        let name = &writer.names[index];
        let (value, _) = writer.operation(index);
        statements.push(format!("let {name} = {value};"));
        written[index] = true;
    }
    let outputs = program
        .outputs
        .iter()
        .map(|&output| writer.operand(output).0)
        .collect();
    Body {
        first,
        rest,
        statements,
        outputs,
    }
}

/// Precedence of an expression.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Binding {
    Sum,
    Product,
    Unary,
    Atom,
}

struct Writer<'a> {
    program: &'a Program,
    uses: Vec<usize>,
    names: Vec<String>,
}

impl Writer<'_> {
    /// True if a temporary is written inside its only reader instead of having a name.
    fn is_inline(&self, index: usize) -> bool {
        self.uses[index] == 1
            && self.program.names[index].is_none()
            && !matches!(
                self.program.operations[index],
                Operation::Apply(Elementary::Sin | Elementary::Cos, _) | Operation::Select(_)
            )
            && self.depth(index) < 8
    }

    /// Length of the chain of inlined operands below a temporary.
    fn depth(&self, index: usize) -> usize {
        let below = self.program.operations[index]
            .operands()
            .filter_map(|operand| match operand {
                Operand::Temporary(t) if self.uses[t] == 1 && self.program.names[t].is_none() => {
                    Some(self.depth(t) + 1)
                }
                _ => None,
            });
        // Chains are cut at multiples of eight so that both sides of a cut stay readable.
        below.max().unwrap_or(0) % 9
    }

    /// The temporary that holds the cosine for a sine, or the other way round.
    fn partner(&self, function: Elementary, angle: Operand) -> Option<usize> {
        let wanted = match function {
            Elementary::Sin => Elementary::Cos,
            _ => Elementary::Sin,
        };
        self.program
            .operations
            .iter()
            .position(|operation| *operation == Operation::Apply(wanted, angle))
    }

    fn operand(&self, operand: Operand) -> (String, Binding) {
        match operand {
            Operand::Constant(value) if value < 0.0 => (literal(value), Binding::Unary),
            Operand::Constant(value) => (literal(value), Binding::Atom),
            Operand::Input(index) => (self.program.inputs[index].clone(), Binding::Atom),
            Operand::Temporary(index) if self.is_inline(index) => self.operation(index),
            Operand::Temporary(index) => (self.names[index].clone(), Binding::Atom),
        }
    }

    /// An operand, in parentheses if it binds less tightly than required.
    fn at_least(&self, operand: Operand, binding: Binding) -> String {
        let (text, own) = self.operand(operand);
        if own < binding {
            format!("({text})")
        } else {
            text
        }
    }

    fn operation(&self, index: usize) -> (String, Binding) {
        let sum = |a, sign, b| {
            let (a, b) = (
                self.at_least(a, Binding::Sum),
                self.at_least(b, Binding::Product),
            );
            (format!("{a} {sign} {b}"), Binding::Sum)
        };
        let product = |a, sign, b| {
            let (a, b) = (
                self.at_least(a, Binding::Product),
                self.at_least(b, Binding::Unary),
            );
            (format!("{a} {sign} {b}"), Binding::Product)
        };
        match self.program.operations[index] {
            Operation::Add(a, b) => sum(a, '+', b),
            Operation::Subtract(a, b) => sum(a, '-', b),
            Operation::Multiply(a, b) => product(a, '*', b),
            Operation::Divide(a, b) => product(a, '/', b),
            Operation::Negate(a) => {
                let a = self.at_least(a, Binding::Atom);
                (format!("-{a}"), Binding::Unary)
            }
            Operation::Apply(function, a) => {
                let (a, _) = self.operand(a);
                (format!("math::{}({a})", function.name()), Binding::Atom)
            }
            Operation::Select([left, right, below, otherwise]) => {
                let [left, right] =
                    [left, right].map(|operand| self.at_least(operand, Binding::Sum));
                let [below, otherwise] = [below, otherwise].map(|operand| self.operand(operand).0);
                (
                    format!("if {left} < {right} {{ {below} }} else {{ {otherwise} }}"),
                    Binding::Sum,
                )
            }
        }
    }
}

fn literal(value: f64) -> String {
    debug_assert!(value.is_finite(), "constants fold to finite numbers");
    let mut text = value.to_string();
    if !text.contains('.') {
        text.push_str(".0");
    }
    text
}
