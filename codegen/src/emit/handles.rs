//! Typed handles: a robot's type with a constant per variant, and constants of a variant's parameters.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt::{self, Write};

use proc_macro2::{Ident, Literal, TokenStream};
use quote::quote;
use tau_model_dsl::{Code, codes};

use super::{Paths, ident, snake_case};
use crate::compile::{CompiledRobot, CompiledVariant};
use crate::equations::Parameter;

/// The type that stands for the robot; its constants are the variants.
pub(super) fn robot(robot: &CompiledRobot, paths: &Paths) -> TokenStream {
    let runtime = &paths.runtime;
    let name = ident(&robot.model.name);
    let docs = robot.model.docs.iter().map(|line| quote!(#[doc = #line]));
    let variants = robot.variants.iter().map(|variant| variant.name.clone());
    let variants = constants(variants, paths);
    quote! {
        #(#docs)*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub struct #name;

        impl #name {
            /// The robot's structure and its variants, with their generated functions.
            pub const ROBOT: &'static #runtime::Robot = &ROBOT;
            #variants
        }

        impl #runtime::DeclaredRobot for #name {
            const ROBOT: &'static #runtime::Robot = &ROBOT;
        }
    }
}

/// The same of a description that holds mistakes, by the names that it declares: it satisfies the uses of the robot, and
/// is never run.
pub fn broken(public: bool, name: &Ident, variants: &[Ident], paths: &Paths) -> TokenStream {
    let runtime = &paths.runtime;
    let visibility = if public { quote!(pub) } else { quote!() };
    let names: Vec<String> = variants.iter().map(Ident::to_string).collect();
    let constants = constants(names.iter().cloned(), paths);
    let robot = name.to_string();
    quote! {
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[allow(missing_docs, reason = "its description is not read to the end")]
        #visibility struct #name;

        #[allow(missing_docs, dead_code, reason = "its description is not read to the end")]
        impl #name {
            pub const ROBOT: &'static #runtime::Robot = <Self as #runtime::DeclaredRobot>::ROBOT;
            #constants
        }

        impl #runtime::DeclaredRobot for #name {
            const ROBOT: &'static #runtime::Robot = &#runtime::Robot {
                name: #robot,
                description: "",
                variants: &[#(#runtime::Variant {
                    name: #names,
                    parameters: &[],
                    instances: &[],
                }),*],
            };
        }
    }
}

/// A constant of the robot's type for each variant whose name gives one; names that would be one constant are one.
fn constants(variants: impl Iterator<Item = String>, paths: &Paths) -> TokenStream {
    let runtime = &paths.runtime;
    let mut known = BTreeSet::new();
    let constants = variants.enumerate().filter_map(|(index, name)| {
        let constant = variant_constant(&name);
        // A description that holds mistakes may name a variant as no constant can be named.
        let is_word = |character: char| character.is_ascii_alphanumeric() || character == '_';
        if !constant.chars().all(is_word) || constant == "_" || constant == "ROBOT" {
            return None;
        }
        let is_new = known.insert(constant.clone());
        let constant = ident(&constant);
        let index = Literal::usize_unsuffixed(index);
        let docs = format!(" The variant `{name}`.");
        is_new.then(|| quote! {
            #[doc = #docs]
            pub const #constant: #runtime::VariantHandle<Self> = #runtime::VariantHandle::new(#index);
        })
    });
    quote!(#(#constants)*)
}

/// Constants of all parameters of a variant, for its module.
pub(super) fn parameters(robot: &CompiledRobot, variant: usize) -> TokenStream {
    let name = ident(&robot.model.name);
    let compiled = &robot.variants[variant];
    let summary = format!(" Handle of a parameter of `{}`.", compiled.name);
    // Written as text, as bodies are: quoting every token is slow in an unoptimised macro.
    let mut constants = String::new();
    for (index, Parameter { name, unit, .. }) in compiled.parameters.iter().enumerate() {
        let constant = parameter_constant(name);
        let _ = write!(
            constants,
            "#[doc = \" `{name}` ({unit})\"] pub const {constant}: Handle = Handle::new({variant}, {index});"
        );
    }
    let constants: TokenStream = constants.parse().expect("constants are tokens of Rust");
    quote! {
        #[doc = #summary]
        pub type Handle = ParameterHandle<super::#name>;
        #constants
    }
}

/// `FullPiecewise` to `FULL_PIECEWISE`.
fn variant_constant(name: &str) -> String {
    snake_case(name).to_uppercase()
}

/// `rack_pitch(two).sine` to `RACK_PITCH_TWO_SINE`: words in capitals, whatever stands between them an
/// underscore.
fn parameter_constant(name: &str) -> String {
    let words = name.split(|character: char| !character.is_alphanumeric() && character != '_');
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    words.join("_").to_uppercase()
}

/// Two things of a description that Rust could not tell apart.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Clash {
    /// The kind of mistake.
    pub code: Code,
    /// Name of the variant or robot where they clash.
    pub of: String,
    /// Both, and the name in common.
    pub message: String,
    /// The remedy.
    pub help: &'static str,
}

impl fmt::Display for Clash {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} [{}]\nhelp: {}", self.message, self.code, self.help)
    }
}

/// Names of a description that would be one name of generated code.
///
/// Names of the language are unique as written; constants are in capitals, and their words are not told
/// from those of their neighbours.
pub fn clashes(robot: &CompiledRobot) -> Vec<Clash> {
    let mut clashes = Vec::new();
    let name = &robot.model.name;
    let is_module = |variant: &CompiledVariant| snake_case(&variant.name) == *name;
    if name == "ROBOT" || robot.variants.iter().any(is_module) {
        clashes.push(Clash {
            code: codes::NAMES_CLASH_IN_CODE,
            of: name.clone(),
            message: format!("generated code has something else named `{name}`"),
            help: "choose another name",
        });
    }
    for variant in &robot.variants {
        if variant_constant(&variant.name) == "ROBOT" {
            clashes.push(Clash {
                code: codes::NAMES_CLASH_IN_CODE,
                of: variant.name.clone(),
                message: "`ROBOT` is the robot itself in generated code".to_owned(),
                help: "choose another name",
            });
        }
        clashes.extend(clashes_in(variant));
    }
    clashes
}

fn clashes_in(variant: &CompiledVariant) -> Vec<Clash> {
    // The tables of the variant stand beside its parameters.
    let mut named: BTreeMap<String, &str> = BTreeMap::from([("VARIANT".to_owned(), "VARIANT")]);
    let mut clashes = Vec::new();
    for parameter in &variant.parameters {
        let constant = parameter_constant(&parameter.name);
        if let Some(first) = named.get(&constant) {
            clashes.push(Clash {
                code: codes::NAMES_CLASH_IN_CODE,
                of: variant.name.clone(),
                message: format!(
                    "parameters `{first}` and `{}` would be one constant `{constant}`",
                    parameter.name
                ),
                help: "choose names that differ in more than case, and not in where words end",
            });
        } else {
            named.insert(constant, &parameter.name);
        }
    }
    clashes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::language::check_text;

    fn compiled(items: &str) -> CompiledRobot {
        let text = format!(
            "robot Slide {{ track one; cluster arm on one {{ link l1, l2, l3, l4, l5, l6; }}
            variant Nominal {{ arm full; tracks linear per link; }} {items} }}"
        );
        crate::compile(&check_text(&text).unwrap(), &text)
    }

    #[test]
    fn constants_are_words_in_capitals() {
        for (name, constant) in [
            ("l2a.plate_joint.x", "L2A_PLATE_JOINT_X"),
            ("runout(two).period", "RUNOUT_TWO_PERIOD"),
            ("crosstalk(one, two).rate.z", "CROSSTALK_ONE_TWO_RATE_Z"),
            ("set2.target(one).position.y", "SET2_TARGET_ONE_POSITION_Y"),
        ] {
            assert_eq!(parameter_constant(name), constant);
        }
        assert_eq!(variant_constant("BestPerLink"), "BEST_PER_LINK");
    }

    /// Every parameter of every variant has its constant, with its own indices.
    #[test]
    fn constants_are_in_the_order_of_the_tables() {
        let robot = compiled(
            "effect bend on cart { param rate[3]: 1/length; horizontal += rate[0] * q^2;
                vertical += (rate[1] + rate[2]) * q^2; }
            variant Bent = Nominal + bend(one);",
        );
        for (index, variant) in robot.variants.iter().enumerate() {
            let items: syn::File = syn::parse2(parameters(&robot, index)).unwrap();
            let constants = items.items.iter().filter_map(|item| match item {
                syn::Item::Const(constant) => Some(constant),
                _ => None,
            });
            let constants: Vec<String> = constants
                .map(|constant| {
                    let (name, value) = (&constant.ident, &constant.expr);
                    format!("{name} = {}", quote!(#value)).replace(' ', "")
                })
                .collect();
            let expected: Vec<String> = (variant.parameters.iter().enumerate())
                .map(|(row, parameter)| {
                    let name = parameter.name.to_uppercase().replace(['.', '('], "_");
                    format!("{}=Handle::new({index},{row})", name.replace(')', ""))
                })
                .collect();
            assert_eq!(constants, expected);
            assert!(constants.len() > 30, "{} parameters", constants.len());
        }
    }

    #[test]
    fn names_that_rust_cannot_tell_apart_clash() {
        let shift = "{ param a, A: length; along += a - A; }";
        let robot = compiled(&format!(
            "effect shift on cart {shift} variant Shifted = Nominal + shift(one);"
        ));
        let found = clashes(&robot);
        assert_eq!(found.len(), 1, "{found:?}");
        assert_eq!(found[0].of, "Shifted");
        for part in ["`shift(one).a`", "`shift(one).A`", "`SHIFT_ONE_A`"] {
            assert!(found[0].message.contains(part), "{found:?}");
        }
        let robot = compiled("variant Robot { arm reduced; tracks linear; }");
        assert_eq!(clashes(&robot)[0].of, "Robot");
        assert_eq!(clashes(&compiled("")), []);
    }
}
