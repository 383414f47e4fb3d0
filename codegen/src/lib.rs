//! From a checked model to code.
//!
//! The data flows one way: [`equations`] writes each variant's residuals into a [`graph`];
//! [`differentiate`] adds their derivatives; [`lower`] stages them and makes straight-line
//! [`program`]s; [`emit`] prints those as Rust, [`interpret`] runs them. No step knows an effect by
//! name.

pub mod compile;
pub mod differentiate;
pub mod emit;
pub mod equations;
pub mod evaluate;
pub mod graph;
pub mod interpret;
pub mod lower;
pub mod program;
pub mod vector;

#[cfg(test)]
mod tests;

pub use compile::{CompiledRobot, CompiledVariant, Family, compile};
pub use tau_model_dsl as language;

use proc_macro2::{Ident, Span, TokenStream, TokenTree};
use quote::quote;

/// What `tau_model!` expands to.
///
/// On error: the errors at their tokens, and the bare type, so that its uses elsewhere raise no errors
/// of their own.
pub fn expand(description: &TokenStream, paths: &emit::Paths) -> TokenStream {
    match language::check_tokens(description.clone()) {
        Ok(model) => {
            let name = robot_name(description, &model.name);
            let compiled = compile(&model, &description.to_string());
            emit::expansion(&compiled, &name, paths)
        }
        Err(errors) => {
            let messages = errors
                .diagnostics
                .iter()
                .map(|diagnostic| syn::Error::from(diagnostic).into_compile_error());
            let bare = errors.robot.as_ref().map(|(public, name)| {
                let visibility = if *public { quote!(pub) } else { quote!() };
                quote!(#[allow(missing_docs)] #visibility struct #name;)
            });
            quote!(#(#messages)* #bare)
        }
    }
}

/// The robot's name with the span that it has in the description.
fn robot_name(description: &TokenStream, name: &str) -> Ident {
    let mut previous_is_robot = false;
    for token in description.clone() {
        if let TokenTree::Ident(ident) = &token {
            if previous_is_robot && *ident == name {
                return ident.clone();
            }
            previous_is_robot = *ident == "robot";
        }
    }
    Ident::new(name, Span::call_site())
}
