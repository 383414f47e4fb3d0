//! `tau_model!`: a robot's description, compiled at compile time.

use proc_macro::TokenStream;
use tau_codegen::emit::Paths;

/// Compiles the description of a parallel robot into residual functions and their Jacobians.
///
/// The text is that of a `.tau` file; the language is described in `docs/language.md`. For
/// `pub robot GantryTau { … }` it declares a unit struct `GantryTau` with the constant
/// `GantryTau::ROBOT` and a constant per variant, such as `GantryTau::FULL_RACK`, and a module `gantry_tau`
/// with a module per variant, which holds its generated functions and a constant per parameter, such as
/// `gantry_tau::full_rack::RACK_PITCH_TWO_PERIOD`. These are typed handles: a name that is misspelt, or of
/// another robot, does not compile.
///
/// The code is `no_std`, allocates nothing, and names nothing but `tau::runtime`.
///
/// Mistakes are reported all at once, each at its token, with what was expected.
#[proc_macro]
pub fn tau_model(description: TokenStream) -> TokenStream {
    tau_codegen::expand(&description.into(), &Paths::facade()).into()
}
