//! A residual family as a unit struct that implements the runtime trait.

use proc_macro2::{Ident, Literal, TokenStream};
use quote::quote;

use super::{camel_case, ident};
use crate::compile::Family;
use crate::graph::Elementary;
use crate::program::{Operand, Operation, Program};

/// The struct and its implementation.
pub(super) fn family(family: &Family) -> TokenStream {
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
    let (prepare_inputs, prepare_code, prepare_outputs) = prepare;
    let (value_inputs, value_code, value_outputs) = value;
    let (linearize_inputs, linearize_code, outputs) = linearize;
    let (residual_outputs, jacobian_outputs) = outputs.split_at(family.shape.residuals);
    let read_data = read(&prepare_inputs.0, &quote!(data));
    let read_value_prepared = read(&value_inputs.0, &quote!(prepared));
    let read_value_parameters = read(&value_inputs.1, &quote!(parameters));
    let read_prepared = read(&linearize_inputs.0, &quote!(prepared));
    let read_parameters = read(&linearize_inputs.1, &quote!(parameters));
    quote! {
        #(#[doc = #docs])*
        #[derive(Debug, Clone, Copy)]
        pub struct #name;

        impl ResidualFamily for #name {
            fn shape(&self) -> Shape {
                Shape {
                    data: #data,
                    prepared: #prepared,
                    parameters: #parameters,
                    residuals: #residuals,
                }
            }

            fn pattern(&self) -> Pattern<'_> {
                Pattern { row_starts: &[#(#row_starts),*], columns: &[#(#columns),*] }
            }

            fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
                #read_data
                #prepare_code
                prepared.copy_from_slice(&[#(#prepare_outputs),*]);
            }

            fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
                #read_value_prepared
                #read_value_parameters
                #value_code
                residuals.copy_from_slice(&[#(#value_outputs),*]);
            }

            fn linearize(
                &self,
                prepared: &[f64],
                parameters: &[f64],
                residuals: &mut [f64],
                jacobian: &mut [f64],
            ) {
                #read_prepared
                #read_parameters
                #linearize_code
                residuals.copy_from_slice(&[#(#residual_outputs),*]);
                jacobian.copy_from_slice(&[#(#jacobian_outputs),*]);
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

/// Binds the entries of a slice to names.
fn read(names: &[Ident], slice: &TokenStream) -> TokenStream {
    let count = names.len();
    let message = format!("`{slice}` must hold {count} numbers");
    if names.iter().all(|name| *name == "_") {
        // Nothing to bind, but a wrong length must not pass unseen.
        let count = Literal::usize_unsuffixed(count);
        return quote!(assert!(#slice.len() == #count, #message););
    }
    quote! {
        let &[#(#names),*] = #slice else { panic!(#message) };
    }
}

/// Input names (those before `split`, and the rest), statements, outputs.
type Body = ((Vec<Ident>, Vec<Ident>), TokenStream, Vec<TokenStream>);

fn body(program: &Program, split: usize) -> Body {
    let writer = Writer {
        program,
        uses: program.uses(),
        names: program.temporary_names(),
    };
    let reads = program.reads();
    let mut inputs: Vec<Ident> = program
        .inputs
        .iter()
        .zip(reads)
        .map(|(name, read)| {
            if read {
                ident(name)
            } else {
                Ident::new("_", proc_macro2::Span::mixed_site())
            }
        })
        .collect();
    let rest = inputs.split_off(split.min(inputs.len()));
    let mut statements = TokenStream::new();
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
            let (sin_name, cos_name) = (ident(&writer.names[sin]), ident(&writer.names[cos]));
            let (angle, _) = writer.operand(angle);
            statements.extend(quote!(let (#sin_name, #cos_name) = math::sin_cos(#angle);));
            written[sin] = true;
            written[cos] = true;
            continue;
        }
        let name = ident(&writer.names[index]);
        let (value, _) = writer.operation(index);
        statements.extend(quote!(let #name = #value;));
        written[index] = true;
    }
    let outputs = program
        .outputs
        .iter()
        .map(|&output| writer.operand(output).0)
        .collect();
    ((inputs, rest), statements, outputs)
}

/// How tightly an expression binds.
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
    /// Whether a temporary is written inside its only reader instead of having a name.
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
            .into_iter()
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

    fn operand(&self, operand: Operand) -> (TokenStream, Binding) {
        match operand {
            Operand::Constant(value) if value < 0.0 => {
                let literal = Literal::f64_unsuffixed(-value);
                (quote!(-#literal), Binding::Unary)
            }
            Operand::Constant(value) => {
                let literal = Literal::f64_unsuffixed(value);
                (quote!(#literal), Binding::Atom)
            }
            Operand::Input(index) => {
                let name = ident(&self.program.inputs[index]);
                (quote!(#name), Binding::Atom)
            }
            Operand::Temporary(index) if self.is_inline(index) => self.operation(index),
            Operand::Temporary(index) => {
                let name = ident(&self.names[index]);
                (quote!(#name), Binding::Atom)
            }
        }
    }

    /// An operand, in parentheses if it binds less tightly than required.
    fn at_least(&self, operand: Operand, binding: Binding) -> TokenStream {
        let (tokens, own) = self.operand(operand);
        if own < binding {
            quote!((#tokens))
        } else {
            tokens
        }
    }

    fn operation(&self, index: usize) -> (TokenStream, Binding) {
        match self.program.operations[index] {
            Operation::Add(a, b) => {
                let (a, b) = (
                    self.at_least(a, Binding::Sum),
                    self.at_least(b, Binding::Product),
                );
                (quote!(#a + #b), Binding::Sum)
            }
            Operation::Subtract(a, b) => {
                let (a, b) = (
                    self.at_least(a, Binding::Sum),
                    self.at_least(b, Binding::Product),
                );
                (quote!(#a - #b), Binding::Sum)
            }
            Operation::Multiply(a, b) => {
                let (a, b) = (
                    self.at_least(a, Binding::Product),
                    self.at_least(b, Binding::Unary),
                );
                (quote!(#a * #b), Binding::Product)
            }
            Operation::Divide(a, b) => {
                let (a, b) = (
                    self.at_least(a, Binding::Product),
                    self.at_least(b, Binding::Unary),
                );
                (quote!(#a / #b), Binding::Product)
            }
            Operation::Negate(a) => {
                let a = self.at_least(a, Binding::Atom);
                (quote!(-#a), Binding::Unary)
            }
            Operation::Apply(function, a) => {
                let (a, _) = self.operand(a);
                let name = ident(function.name());
                (quote!(math::#name(#a)), Binding::Atom)
            }
            Operation::Select([left, right, below, otherwise]) => {
                let [left, right] =
                    [left, right].map(|operand| self.at_least(operand, Binding::Sum));
                let [below, otherwise] = [below, otherwise].map(|operand| self.operand(operand).0);
                (
                    quote!(if #left < #right { #below } else { #otherwise }),
                    Binding::Sum,
                )
            }
        }
    }
}
