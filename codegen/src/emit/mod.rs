//! Programs and tables as Rust.
//!
//! The same functions make both outputs, the macro's expansion and checked-in files; they differ only in
//! the path under which generated code finds the runtime crate, and in that statements are laid out in a
//! file and read as tokens in an expansion.

mod family;
#[cfg(feature = "files")]
mod file;
mod handles;
#[cfg(feature = "files")]
mod layout;
mod tables;

use proc_macro2::{Ident, Span, TokenStream};
use quote::quote;

#[cfg(feature = "files")]
pub use file::file;
pub use handles::{Clash, broken, clashes};

use crate::compile::{CompiledRobot, Family};

/// Path by which generated code finds the runtime crate.
#[derive(Debug, Clone)]
pub struct Paths {
    /// Rooted path of `tau_runtime`.
    pub runtime: TokenStream,
}

impl Paths {
    /// For checked-in files: the runtime crate itself.
    pub fn runtime_crate() -> Self {
        Self {
            runtime: quote!(::tau_runtime),
        }
    }

    /// For the macro: a user's crate depends on `tau` alone.
    pub fn facade() -> Self {
        Self {
            runtime: quote!(::tau::runtime),
        }
    }
}

/// All items of a robot: its type, `ROBOT`, and a module per variant.
pub fn robot(robot: &CompiledRobot, paths: &Paths) -> TokenStream {
    let table = table(robot, paths);
    let homes = homes(robot);
    let mut place = |statements: Vec<String>| {
        let tokens: Result<TokenStream, _> = statements.join("\n").parse();
        tokens.expect("statements are tokens of Rust")
    };
    let variants =
        (0..robot.variants.len()).map(|variant| module(robot, variant, &homes, paths, &mut place));
    let variants: Vec<TokenStream> = variants.collect();
    quote! {
        #table
        #(#variants)*
    }
}

/// For each family of each variant, where it is written: variant and family.
///
/// A family that an earlier variant has already is not written again: tables refer to it there.
fn homes(robot: &CompiledRobot) -> Vec<Vec<(usize, usize)>> {
    let mut written: Vec<(&Family, (usize, usize))> = Vec::new();
    let mut homes = Vec::new();
    for (variant, compiled) in robot.variants.iter().enumerate() {
        let mut of_families = Vec::new();
        for (index, family) in compiled.families.iter().enumerate() {
            let known = written.iter().find(|(known, _)| known.same_code(family));
            let home = known.map_or((variant, index), |&(_, home)| home);
            written.push((family, home));
            of_families.push(home);
        }
        homes.push(of_families);
    }
    homes
}

fn table(robot: &CompiledRobot, paths: &Paths) -> TokenStream {
    let handles = handles::robot(robot, paths);
    let table = tables::robot(robot, &paths.runtime);
    quote! {
        #handles
        #table
    }
}

/// The module of one variant.
fn module(
    robot: &CompiledRobot,
    variant: usize,
    homes: &[Vec<(usize, usize)>],
    paths: &Paths,
    place: &mut dyn FnMut(Vec<String>) -> TokenStream,
) -> TokenStream {
    let imports = imports(paths);
    let compiled = &robot.variants[variant];
    let mut items = Vec::new();
    let mut names = Vec::new();
    for (index, family) in compiled.families.iter().enumerate() {
        let (home, known) = homes[variant][index];
        let name = ident(&camel_case(&robot.variants[home].families[known].name));
        if (home, known) == (variant, index) {
            items.push(family::family(family, place));
            names.push(quote!(#name));
        } else {
            let home = ident(&snake_case(&robot.variants[home].name));
            names.push(quote!(super::#home::#name));
        }
    }
    let module = ident(&snake_case(&compiled.name));
    let docs = compiled.docs.iter().map(|line| quote!(#[doc = #line]));
    let summary = format!(" The variant `{}`.", compiled.name);
    let table = tables::variant(&robot.model, compiled, &names);
    let handles = handles::parameters(robot, variant);
    quote! {
        #[doc = #summary]
        #(#docs)*
        pub mod #module {
            #imports
            #table
            #handles
            #(#items)*
        }
    }
}

/// Imports of a variant's module from the runtime crate.
fn imports(paths: &Paths) -> TokenStream {
    let runtime = &paths.runtime;
    quote! {
        #[allow(unused_imports, reason = "one list for all modules")]
        use #runtime::{
            Formulas, Input, Instance, Owner, Parameter, ParameterHandle, Pattern, ResidualKind, Samples,
            Shape, Variant, math,
        };
    }
}

/// Expansion of `tau_model!`: a module of the robot's items, and beside it the type of its name.
pub fn expansion(compiled: &CompiledRobot, name: &Ident, paths: &Paths) -> TokenStream {
    let items = robot(compiled, paths);
    let module = Ident::new(&snake_case(&compiled.model.name), Span::mixed_site());
    let visibility = if compiled.model.public {
        quote!(pub)
    } else {
        quote!()
    };
    let module_docs = format!(" Generated code of [`{name}`].");
    quote! {
        #[allow(unused_imports, reason = "a robot may be declared for its module alone")]
        #[doc(inline)]
        #visibility use #module::#name;

        #[doc = #module_docs]
        #[allow(clippy::all, clippy::pedantic, missing_docs, unreachable_pub)]
        #visibility mod #module {
            #items
        }
    }
}

/// A name as Rust writes it; the language admits none that Rust keeps for itself.
pub(crate) fn ident(name: &str) -> Ident {
    Ident::new(name, Span::call_site())
}

/// `FullPiecewise` to `full_piecewise`.
pub fn snake_case(name: &str) -> String {
    let mut result = String::new();
    for (index, character) in name.chars().enumerate() {
        if character.is_uppercase() && index > 0 && !result.ends_with('_') {
            result.push('_');
        }
        result.extend(character.to_lowercase());
    }
    result
}

/// `closure_by_pose` to `ClosureByPose`.
pub(crate) fn camel_case(name: &str) -> String {
    name.split('_')
        .map(|word| {
            let mut characters = word.chars();
            characters.next().map_or_else(String::new, |first| {
                first.to_uppercase().collect::<String>() + characters.as_str()
            })
        })
        .collect()
}
