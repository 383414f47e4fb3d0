//! The static tables of a robot and its variants.

use std::fmt::Debug;

use proc_macro2::{Literal, TokenStream};
use quote::{ToTokens, quote};
use tau_model_dsl::model::Model;

use super::{ident, snake_case};
use crate::compile::{CompiledRobot, CompiledVariant};

/// `ROBOT`, without an import: a robot may have the name of one.
pub(super) fn robot(robot: &CompiledRobot, runtime: &TokenStream) -> TokenStream {
    let model = &robot.model;
    let name = &model.name;
    let description = raw_string(&robot.description);
    let variants = robot.variants.iter().map(|variant| {
        let module = ident(&snake_case(&variant.name));
        quote!(#module::VARIANT)
    });
    let docs = model.docs.iter().map(|line| quote!(#[doc = #line]));
    let summary = format!(" The robot `{name}`.");
    quote! {
        #[doc = #summary]
        #(#docs)*
        pub static ROBOT: #runtime::Robot = #runtime::Robot {
            name: #name,
            description: #description,
            variants: &[#(#variants),*],
        };
    }
}

/// `VARIANT`; `families` are the types of the variant's families.
pub(super) fn variant(
    model: &Model,
    variant: &CompiledVariant,
    families: &[TokenStream],
) -> TokenStream {
    let name = &variant.name;
    let parameters = variant.parameters.iter().map(|parameter| {
        let (name, quantity, unit) = (&parameter.name, &parameter.quantity, &parameter.unit);
        let owner = as_written("Owner", parameter.owner);
        let component = optional(parameter.component);
        let (nominal, tolerance) = (
            optional_number(parameter.nominal),
            optional_number(parameter.tolerance),
        );
        let search = match parameter.search {
            Some((low, high)) => {
                let (low, high) = (number(low), number(high));
                quote!(Some((#low, #high)))
            }
            None => quote!(None),
        };
        let mut entry = quote!(Parameter::new(#name, #owner, #quantity, #component, #unit));
        if parameter.nominal.is_some() || parameter.tolerance.is_some() {
            entry.extend(quote!(.with_values(#nominal, #tolerance)));
        }
        if parameter.search.is_some() {
            entry.extend(quote!(.with_search(#search)));
        }
        entry
    });
    let instances = variant.instances.iter().map(|instance| {
        let kind = as_written("ResidualKind", instance.kind);
        let of = index(instance.of);
        let family = &families[instance.family];
        let parameters = instance.parameters.iter().map(|&p| index(p));
        let inputs = instance.inputs.iter().map(|&i| as_written("Input", i));
        quote! {
            Instance {
                kind: #kind,
                of: #of,
                family: &#family,
                parameters: &[#(#parameters),*],
                inputs: &[#(#inputs),*],
            }
        }
    });
    let summary = format!(" Tables of the variant `{name}` of `{}`.", model.name);
    quote! {
        #[doc = #summary]
        pub const VARIANT: Variant = Variant {
            name: #name,
            parameters: &[#(#parameters),*],
            instances: &[#(#instances),*],
        };
    }
}

/// A value of a type of the tables, as its `Debug` writes it: the path from that type on.
fn as_written(of: &str, value: impl Debug) -> TokenStream {
    let path = format!("{of}::{value:?}");
    path.parse().expect("derived `Debug` writes an expression")
}

fn index(value: usize) -> Literal {
    Literal::usize_unsuffixed(value)
}

fn optional(value: Option<usize>) -> TokenStream {
    match value {
        Some(value) => {
            let value = index(value);
            quote!(Some(#value))
        }
        None => quote!(None),
    }
}

fn number(value: f64) -> TokenStream {
    let literal = Literal::f64_unsuffixed(value.abs());
    if value.is_sign_negative() {
        quote!(-#literal)
    } else {
        quote!(#literal)
    }
}

fn optional_number(value: Option<f64>) -> TokenStream {
    match value {
        Some(value) => {
            let value = number(value);
            quote!(Some(#value))
        }
        None => quote!(None),
    }
}

/// A string literal that keeps its lines.
fn raw_string(text: &str) -> TokenStream {
    if text.replace("\r\n", "\n").contains('\r') {
        // A carriage return alone may not stand in a raw string.
        return Literal::string(text).into_token_stream();
    }
    let mut hashes = String::from("#");
    while text.contains(&format!("\"{hashes}")) {
        hashes.push('#');
    }
    format!("r{hashes}\"{text}\"{hashes}")
        .parse()
        .expect("a raw string is one token")
}

#[cfg(test)]
mod tests {
    use super::raw_string;

    /// Whatever a description holds, the literal reads back as it.
    #[test]
    fn literals_read_back() {
        for text in ["a\nb", "\"#", "#\"##", "// a\rb", "\\n"] {
            let literal: syn::LitStr = syn::parse2(raw_string(text)).unwrap();
            assert_eq!(literal.value(), text);
        }
    }
}
