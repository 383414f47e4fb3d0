//! Programs and tables as Rust.
//!
//! The same functions make both outputs, the macro's expansion and checked-in files; they differ only in
//! the path under which generated code finds the runtime crate, and in that statements are laid out in a
//! file and read as tokens in an expansion.

mod family;
mod handles;
mod layout;
mod tables;

use std::fmt::Write;
use std::panic::resume_unwind;
use std::sync::atomic::{AtomicUsize, Ordering};

use proc_macro2::{Ident, Span, TokenStream};
use quote::quote;

pub use handles::{Clash, clashes};

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
            Arm, EffectUse, Formulas, Input, Instance, Owner, Parameter, ParameterHandle, Pattern,
            ResidualKind, Samples, Shape, TrackModel, TrackShape, Variant, math,
        };
    }
}

/// A robot's file: header, then its items, formatted.
///
/// The text depends on the description alone: no paths, times or versions. Where names clash, it says so
/// when it is compiled.
pub fn file(compiled: &CompiledRobot, source: &str, command: &str) -> String {
    let paths = Paths::runtime_crate;
    let formatted = |tokens: TokenStream| {
        let items = syn::parse2(tokens).expect("generated tokens are Rust items");
        pack_lists(&prettyplease::unparse(&items))
    };
    let homes = homes(compiled);
    let module = |variant| {
        let mut bodies = Vec::new();
        let mut place = |statements| {
            bodies.push(statements);
            quote!(statements!();)
        };
        let items = module(compiled, variant, &homes, &paths(), &mut place);
        layout::with_bodies(&formatted(items), "statements!();", bodies)
    };
    let items = std::iter::once(formatted(table(compiled, &paths())))
        .chain(on_all_cores(compiled.variants.len(), module));
    let items: Vec<String> = items.collect();
    let mut text = format!(
        "// @generated by `{command}` from {source}. Do not edit: edit that file and run the command.\n//\n\
         // Operations once per sample / per residual / with the Jacobian:\n"
    );
    for variant in &compiled.variants {
        for family in &variant.families {
            let _ = writeln!(
                text,
                "//   {}::{}: {} / {} / {}",
                snake_case(&variant.name),
                family.name,
                family.programs.prepare.counts().total(),
                family.programs.value.counts().total(),
                family.programs.linearize.counts().total(),
            );
        }
    }
    text.push('\n');
    for clash in clashes(compiled) {
        let _ = writeln!(text, "compile_error!({:?});", clash.to_string());
    }
    text.push_str(&items.concat());
    text
}

/// Results of work on each of some indices, in order. Formatting takes longest of all, and tokens can't be sent
/// from one thread to another.
fn on_all_cores<R: Send>(count: usize, work: impl Fn(usize) -> R + Sync) -> Vec<R> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let next = AtomicUsize::new(0);
    let run = || -> Vec<(usize, R)> {
        let indices = std::iter::repeat_with(|| next.fetch_add(1, Ordering::Relaxed));
        let own = indices.take_while(|&index| index < count);
        own.map(|index| (index, work(index))).collect()
    };
    let mut results = std::thread::scope(|scope| {
        let threads: Vec<_> = (1..cores.min(count)).map(|_| scope.spawn(run)).collect();
        let mut results = run();
        for thread in threads {
            results.extend(thread.join().unwrap_or_else(|panic| resume_unwind(panic)));
        }
        results
    });
    results.sort_by_key(|(index, _)| *index);
    results.into_iter().map(|(_, result)| result).collect()
}

/// Sets list entries of one word each side by side: the formatter gives each a line of its own, which
/// makes a sparsity pattern longer than the code.
fn pack_lists(text: &str) -> String {
    const WIDTH: usize = 100;
    let is_entry = |line: &str| {
        line.trim_start().strip_suffix(',').is_some_and(|entry| {
            !entry.is_empty()
                && entry
                    .chars()
                    .all(|c| c.is_alphanumeric() || "_.-:()&".contains(c))
        })
    };
    let mut packed = String::with_capacity(text.len());
    let mut open = 0;
    for line in text.lines() {
        let entry = line.trim_start();
        if is_entry(line) && open > 0 && open + 1 + entry.len() <= WIDTH {
            packed.push(' ');
            packed.push_str(entry);
            open += 1 + entry.len();
            continue;
        }
        if !packed.is_empty() {
            packed.push('\n');
        }
        packed.push_str(line);
        open = if is_entry(line) { line.len() } else { 0 };
    }
    packed.push('\n');
    packed
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::language::check_text;

    /// Each written constant is finite, but not what they come out as together.
    #[test]
    fn no_infinity_is_written() {
        let text = "robot Slide { track one; cluster arm on one { link l1; }
            effect vast on cart { param a: length; along += 1e300 * (1e300 * a); }
            variant Nominal { arm reduced; tracks linear; }
            variant Vast = Nominal + vast(one); }";
        let compiled = crate::compile(&check_text(text).unwrap(), text);
        let file = file(&compiled, "slide.tau", "tau generate");
        assert!(!file.contains("inf"), "{file}");
    }

    /// A file holds what the macro expands to, for all that bodies are made of.
    #[test]
    fn a_file_is_the_expansion_laid_out() {
        let text = "robot Slide { track one; cluster arm on one { link l1; }
            effect bent on cart { param a: length; param rate: 1/length;
                along += max(a, -a / 2) * tanh(rate * q) + a * sin(2*pi*q/(1 m)) - a * cos(2*pi*q/(1 m)); }
            variant Nominal { arm reduced; tracks linear; }
            variant Full { arm full; tracks linear per link; }
            variant Bent = Full + bent(one); }";
        let compiled = crate::compile(&check_text(text).unwrap(), text);
        let formatted = |file: &syn::File| prettyplease::unparse(file);
        let file = syn::parse_file(&file(&compiled, "slide.tau", "tau generate")).unwrap();
        let expansion = syn::parse2(robot(&compiled, &Paths::runtime_crate())).unwrap();
        assert_eq!(formatted(&file), formatted(&expansion));
        assert!(formatted(&file).contains("if "), "a maximum");
    }
}
