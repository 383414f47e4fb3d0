//! The language: a declarative description of a parallel robot becomes a checked [`Model`].
//!
//! The same text stands inside `tau_model! { … }` and in a `.tau` file. This crate turns it into a
//! syntax tree with spans, resolves names, checks units and hands over a [`Model`] of which nothing
//! refers to the text any more. It emits no code. The grammar is in the project's book,
//! `docs/language.md`.
//!
//! ```
//! let model = tau_model_dsl::check_text(
//!     "robot Slide {
//!          track one;
//!          cluster arm on one { link l1, l2, l3; }
//!          variant Nominal { arm reduced; tracks linear; }
//!      }",
//! )?;
//! assert_eq!(model.tracks[0].name, "one");
//!
//! let errors = tau_model_dsl::check_text("robot Slide { track one; cluster arm on two { link l1; } }")
//!     .unwrap_err();
//! let codes: Vec<_> = errors.diagnostics.iter().map(|error| error.code).collect();
//! assert_eq!(codes, [tau_model_dsl::codes::PARTS_MISSING, tau_model_dsl::codes::UNKNOWN_TRACK]);
//! # Ok::<(), tau_model_dsl::Errors>(())
//! ```

#[macro_use]
mod diagnostics;
mod check;
pub mod model;
mod names;
mod parse;
pub mod plausible;
mod syntax;
pub mod units;

#[cfg(test)]
mod tests;

use std::str::FromStr;

use proc_macro2::TokenStream;

pub use crate::diagnostics::{Diagnostic, Errors};
pub use crate::model::Model;
pub use crate::names::nearest;
/// Codes of the mistakes in descriptions.
pub use tau_codes::{Code, language as codes};

use crate::diagnostics::Diagnostics;

/// Checks a description given as tokens, as the macro receives it.
///
/// The tokens hold one `robot` and any number of `effect` items.
///
/// # Errors
/// All mistakes of the description, each at its tokens.
pub fn check_tokens(tokens: TokenStream) -> Result<Model, Errors> {
    let mut diagnostics = Diagnostics::new();
    let description = parse::description(tokens.clone(), true, &mut diagnostics);
    let robot = description.robot_name();
    // Follow-on errors of a broken item would hide the first mistake, so checking waits for a clean tree.
    diagnostics.into_result(robot.clone())?;

    let Some(declared) = &description.robot else {
        return Err(Errors::without_robot(tokens));
    };
    let mut diagnostics = Diagnostics::new();
    let model = check::robot(declared, &description.effects, &mut diagnostics);
    diagnostics.into_result(robot)?;
    Ok(model)
}

/// Checks a description given as text.
///
/// # Errors
/// As [`check_tokens`], and where the text holds what is no token; positions count from the start of `text`.
pub fn check_text(text: &str) -> Result<Model, Errors> {
    check_tokens(tokens(text)?)
}

/// Adds the effects of a catalogue, a text of `effect` items, to a model.
///
/// An effect that the model already has stands: a description's own effect wins over the catalogue's of the same name
/// where both act on places of the same kind.
///
/// # Errors
/// All mistakes of the catalogue; positions count from the start of `text`.
pub fn effects_from_text(text: &str, into: &Model) -> Result<Model, Errors> {
    let tokens = tokens(text)?;
    let mut diagnostics = Diagnostics::new();
    let description = parse::description(tokens, false, &mut diagnostics);
    diagnostics.into_result(None)?;

    let mut diagnostics = Diagnostics::new();
    let effects = check::catalogue(&description.effects, &into.tracks, &mut diagnostics);
    diagnostics.into_result(None)?;

    let mut model = into.clone();
    for effect in effects {
        if !model.effects.iter().any(|own| own.is_rival_of(&effect)) {
            model.effects.push(effect);
        }
    }
    Ok(model)
}

/// Reads a text as tokens, with the places in it.
///
/// # Errors
/// Where the text holds what is no token.
pub fn tokens(text: &str) -> Result<TokenStream, Errors> {
    TokenStream::from_str(text).map_err(|error| Errors::from_lexer(text, &error))
}
