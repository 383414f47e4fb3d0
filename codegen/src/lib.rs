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

/// Expansion of `tau_model!`.
///
/// On error: the errors at their tokens, and the bare type, so that its uses elsewhere raise no errors
/// of their own.
pub fn expand(description: &TokenStream, paths: &emit::Paths) -> TokenStream {
    match language::check_tokens(description.clone()) {
        Ok(model) => {
            let name = declared(description.clone(), "robot", &model.name);
            let compiled = compile(&model, &description.to_string());
            let clashes = emit::clashes(&compiled);
            if clashes.is_empty() {
                return emit::expansion(&compiled, &name, paths);
            }
            let messages = clashes.iter().map(|clash| {
                let keyword = if clash.of == model.name {
                    "robot"
                } else {
                    "variant"
                };
                let place = declared(description.clone(), keyword, &clash.of).span();
                syn::Error::new(place, clash).into_compile_error()
            });
            bare(&messages.collect(), model.public, &name)
        }
        Err(errors) => {
            let messages = errors
                .diagnostics
                .iter()
                .map(|diagnostic| syn::Error::from(diagnostic).into_compile_error())
                .collect();
            match &errors.robot {
                Some((public, name)) => bare(&messages, *public, name),
                None => messages,
            }
        }
    }
}

/// Errors, and the robot's bare type.
fn bare(messages: &TokenStream, public: bool, name: &Ident) -> TokenStream {
    let visibility = if public { quote!(pub) } else { quote!() };
    quote!(#messages #[allow(missing_docs)] #visibility struct #name;)
}

/// A name with the span that it has where the description declares it: after `robot` or `variant`.
fn declared(description: TokenStream, keyword: &str, name: &str) -> Ident {
    find(description, keyword, name).unwrap_or_else(|| Ident::new(name, Span::call_site()))
}

fn find(tokens: TokenStream, keyword: &str, name: &str) -> Option<Ident> {
    let mut follows_keyword = false;
    for token in tokens {
        match token {
            TokenTree::Ident(ident) if follows_keyword && ident == name => return Some(ident),
            TokenTree::Ident(ident) => follows_keyword = ident == keyword,
            TokenTree::Group(group) => {
                if let Some(found) = find(group.stream(), keyword, name) {
                    return Some(found);
                }
                follows_keyword = false;
            }
            _ => follows_keyword = false,
        }
    }
    None
}
