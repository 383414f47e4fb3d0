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
    let read_data = read(&prepare.first, &quote!(data));
    let write_prepared = write(&quote!(prepared), &prepare.outputs);
    let read_value_prepared = read_lane(&value.first, &quote!(prepared));
    let read_value_parameters = read(&value.rest, &quote!(parameters));
    let write_value = write(&quote!(residuals), &value.outputs);
    let read_prepared = read_lane(&linearize.first, &quote!(prepared));
    let read_parameters = read(&linearize.rest, &quote!(parameters));
    let (residual_outputs, jacobian_outputs) = linearize.outputs.split_at(family.shape.residuals);
    let write_residuals = write(&quote!(residuals), residual_outputs);
    let write_jacobian = write(&quote!(jacobian), jacobian_outputs);
    // Names of arguments that a family has no use for begin with an underscore.
    let argument = |name: &str, code: &[&TokenStream]| {
        let used = code.iter().any(|code| !code.is_empty());
        ident(&format!("{}{name}", if used { "" } else { "_" }))
    };
    let prepare_lane = argument("lane", &[&write_prepared]);
    let prepare_data = argument("data", &[&read_data]);
    let prepare_prepared = argument("prepared", &[&write_prepared]);
    let value_prepared = argument("prepared", &[&read_value_prepared]);
    let value_parameters = argument("parameters", &[&read_value_parameters]);
    let linearize_prepared = argument("prepared", &[&read_prepared]);
    let linearize_parameters = argument("parameters", &[&read_parameters]);
    let linearize_jacobian = argument("jacobian", &[&write_jacobian]);
    let [prepare, value, linearize] = [prepare, value, linearize].map(|body| body.statements);
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
                #read_data
                #prepare
                #write_prepared
            }

            #[inline(always)]
            fn value<S: Samples>(
                lane: usize,
                #value_prepared: &[S],
                #value_parameters: &[f64],
                residuals: &mut [S],
            ) {
                #read_value_prepared
                #read_value_parameters
                #value
                #write_value
            }

            #[inline(always)]
            fn linearize<S: Samples>(
                lane: usize,
                #linearize_prepared: &[S],
                #linearize_parameters: &[f64],
                residuals: &mut [S],
                #linearize_jacobian: &mut [S],
            ) {
                #read_prepared
                #read_parameters
                #linearize
                #write_residuals
                #write_jacobian
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
fn read(names: &[Option<Ident>], slice: &TokenStream) -> TokenStream {
    let count = names.len();
    if names.iter().all(Option::is_none) {
        return TokenStream::new();
    }
    let message = format!("`{slice}` must hold {count} numbers");
    let names = names.iter().map(|name| match name {
        Some(name) => quote!(#name),
        None => quote!(_),
    });
    quote! {
        let &[#(#names),*] = #slice else { panic!(#message) };
    }
}

/// Binds what the sample has of each entry of a slice to names.
fn read_lane(names: &[Option<Ident>], slice: &TokenStream) -> TokenStream {
    let reads = names.iter().enumerate().filter_map(|(index, name)| {
        let index = Literal::usize_unsuffixed(index);
        let name = name.as_ref()?;
        Some(quote!(let #name = #slice[#index][lane];))
    });
    quote!(#(#reads)*)
}

/// Stores the sample's results.
fn write(slice: &TokenStream, values: &[TokenStream]) -> TokenStream {
    let writes = values.iter().enumerate().map(|(index, value)| {
        let index = Literal::usize_unsuffixed(index);
        quote!(#slice[#index][lane] = #value;)
    });
    quote!(#(#writes)*)
}

/// A program as Rust.
struct Body {
    /// Names of the inputs of the first slice, where they are read.
    first: Vec<Option<Ident>>,
    /// Names of those of the second.
    rest: Vec<Option<Ident>>,
    statements: TokenStream,
    outputs: Vec<TokenStream>,
}

fn body(program: &Program, split: usize) -> Body {
    let writer = Writer {
        program,
        uses: program.uses(),
        names: program.temporary_names(),
    };
    let reads = program.reads();
    let mut first: Vec<Option<Ident>> = program
        .inputs
        .iter()
        .zip(reads)
        .map(|(name, read)| read.then(|| ident(name)))
        .collect();
    let rest = first.split_off(split.min(first.len()));
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
    Body {
        first,
        rest,
        statements,
        outputs,
    }
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
