//! From a checked model to code.
//!
//! The data flows one way: [`equations`] writes each variant's residuals into a [`graph`];
//! [`differentiate`] adds their derivatives; [`lower`] stages them and makes straight-line
//! [`program`]s; [`emit`] prints those as Rust, [`interpret`] runs them. [`term`] does so with terms of effects by
//! themselves. No step knows an effect by name.

pub mod compile;
pub mod differentiate;
pub mod emit;
pub mod equations;
pub mod evaluate;
pub mod graph;
pub mod interpret;
pub mod lower;
pub mod program;
pub mod term;
pub mod vector;

#[cfg(test)]
mod tests;

pub use compile::{CompiledRobot, CompiledVariant, Family, compile};
pub use tau_model_dsl as language;

use proc_macro2::{Ident, Span, TokenStream, TokenTree};
use quote::quote;
use tau_model_dsl::{Diagnostic, Errors};

/// Expansion of `tau_model!`.
///
/// On error: the errors at their tokens, and the type with a handle for each variant, so that their uses elsewhere raise
/// no errors of their own.
pub fn expand(description: &TokenStream, paths: &emit::Paths) -> TokenStream {
    let expansion = language::check_tokens(description.clone()).and_then(|model| {
        let compiled = compile(&model, &description.to_string());
        check_names(&compiled, description)?;
        let name = declared(description, "robot", &model.name);
        Ok(emit::expansion(&compiled, &name, paths))
    });
    expansion.unwrap_or_else(|errors| {
        let messages = errors.diagnostics.iter();
        let messages = messages
            .map(|diagnostic| syn::Error::from(diagnostic).into_compile_error())
            .collect();
        let Some((public, name)) = &errors.robot else {
            return messages;
        };
        let variants = after(description.clone(), "variant");
        let handles = emit::broken(*public, name, &variants, paths);
        quote!(#messages #handles)
    })
}

/// Refuses names that would be one name of generated code.
///
/// # Errors
/// Each [clash](emit::clashes), where the description declares the robot or the variant.
pub fn check_names(compiled: &CompiledRobot, description: &TokenStream) -> Result<(), Errors> {
    let model = &compiled.model;
    let clashes = emit::clashes(compiled).into_iter().map(|clash| {
        let keyword = if clash.of == model.name {
            "robot"
        } else {
            "variant"
        };
        let span = declared(description, keyword, &clash.of).span();
        Diagnostic {
            code: clash.code,
            message: clash.message,
            help: Some(clash.help.to_owned()),
            span,
            end: span,
        }
    });
    let diagnostics: Vec<Diagnostic> = clashes.collect();
    if diagnostics.is_empty() {
        return Ok(());
    }
    let name = declared(description, "robot", &model.name);
    Err(Errors {
        robot: Some((model.public, name)),
        diagnostics,
    })
}

/// A name with the span that it has where the description declares it: after `robot` or `variant`.
fn declared(description: &TokenStream, keyword: &str, name: &str) -> Ident {
    let declarations = after(description.clone(), keyword).into_iter();
    let mut named = declarations.filter(|declared| declared == name);
    (named.next()).unwrap_or_else(|| Ident::new(name, Span::call_site()))
}

/// Names that follow a keyword, in order, each once.
fn after(tokens: TokenStream, keyword: &str) -> Vec<Ident> {
    let mut found: Vec<Ident> = Vec::new();
    let mut follows_keyword = false;
    for token in tokens {
        let names = match &token {
            TokenTree::Ident(name) if follows_keyword => vec![name.clone()],
            TokenTree::Group(group) => after(group.stream(), keyword),
            _ => vec![],
        };
        follows_keyword =
            !follows_keyword && matches!(&token, TokenTree::Ident(word) if word == keyword);
        for name in names {
            if !found.contains(&name) {
                found.push(name);
            }
        }
    }
    found
}
