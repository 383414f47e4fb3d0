//! The static tables of a robot and its variants.

use proc_macro2::{Literal, TokenStream};
use quote::{ToTokens, quote};
use tau_model_dsl::model::Model;
use tau_runtime::{Arm, Input, Owner, ResidualKind, TrackShape};

use super::{ident, snake_case};
use crate::compile::{CompiledRobot, CompiledVariant};

/// `ROBOT`; its imports are its own, since a robot may have the name of one.
pub(super) fn robot(robot: &CompiledRobot, runtime: &TokenStream) -> TokenStream {
    let model = &robot.model;
    let name = &model.name;
    let description = raw_string(&robot.description);
    let tracks = model.tracks.iter().map(|track| &track.name);
    let clusters = model.clusters.iter().map(|cluster| {
        let (name, track) = (&cluster.name, optional(cluster.track));
        quote!(Cluster { name: #name, track: #track })
    });
    let links = model.links.iter().map(|link| {
        let (name, cluster) = (&link.name, index(link.cluster));
        let actuated_by = optional(link.actuated_by);
        quote!(Link { name: #name, cluster: #cluster, actuated_by: #actuated_by })
    });
    let commands = index(model.commands());
    let variants = robot.variants.iter().map(|variant| {
        let module = ident(&snake_case(&variant.name));
        quote!(#module::VARIANT)
    });
    let docs = model.docs.iter().map(|line| quote!(#[doc = #line]));
    let summary = format!(" The robot `{name}`.");
    quote! {
        #[doc = #summary]
        #(#docs)*
        pub static ROBOT: #runtime::Robot = {
            use #runtime::{Cluster, Link, Robot};
            Robot {
                name: #name,
                description: #description,
                tracks: &[#(#tracks),*],
                clusters: &[#(#clusters),*],
                links: &[#(#links),*],
                commands: #commands,
                variants: &[#(#variants),*],
            }
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
    let arm = match variant.arm {
        Arm::Reduced => quote!(Arm::Reduced),
        Arm::Full => quote!(Arm::Full),
    };
    let tracks = variant.tracks.iter().map(|track| {
        let shape = match track.shape {
            TrackShape::Linear => quote!(TrackShape::Linear),
            TrackShape::Piecewise => quote!(TrackShape::Piecewise),
            TrackShape::Crank => quote!(TrackShape::Crank),
        };
        let per_link = track.per_link;
        quote!(TrackModel { shape: #shape, per_link: #per_link })
    });
    let effects = variant
        .effects
        .iter()
        .map(|(name, places)| quote!(EffectUse { name: #name, places: &[#(#places),*] }));
    let parameters = variant.parameters.iter().map(|parameter| {
        let (name, quantity, unit) = (&parameter.name, &parameter.quantity, &parameter.unit);
        let owner = owner(parameter.owner);
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
        let kind = match instance.kind {
            ResidualKind::Closure => quote!(ResidualKind::Closure),
            ResidualKind::ClosureByPose => quote!(ResidualKind::ClosureByPose),
            ResidualKind::CartPose => quote!(ResidualKind::CartPose),
            ResidualKind::CartPosition => quote!(ResidualKind::CartPosition),
            ResidualKind::TrackerError => quote!(ResidualKind::TrackerError),
        };
        let of = index(instance.of);
        let family = &families[instance.family];
        let parameters = instance.parameters.iter().map(|&p| index(p));
        let inputs = instance.inputs.iter().map(|&i| input(i));
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
            arm: #arm,
            tracks: &[#(#tracks),*],
            effects: &[#(#effects),*],
            parameters: &[#(#parameters),*],
            instances: &[#(#instances),*],
        };
    }
}

fn owner(owner: Owner) -> TokenStream {
    match owner {
        Owner::Link(link) => {
            let link = index(link);
            quote!(Owner::Link(#link))
        }
        Owner::Cluster(cluster) => {
            let cluster = index(cluster);
            quote!(Owner::Cluster(#cluster))
        }
        Owner::Track(track) => {
            let track = index(track);
            quote!(Owner::Track(#track))
        }
        Owner::Crank(track) => {
            let track = index(track);
            quote!(Owner::Crank(#track))
        }
        Owner::Robot => quote!(Owner::Robot),
        Owner::Effect(effect) => {
            let effect = index(effect);
            quote!(Owner::Effect(#effect))
        }
        Owner::Frame(set) => {
            let set = Literal::u8_unsuffixed(set);
            quote!(Owner::Frame(#set))
        }
        Owner::Target { set, track } => {
            let (set, track) = (Literal::u8_unsuffixed(set), index(track));
            quote!(Owner::Target { set: #set, track: #track })
        }
    }
}

fn input(input: Input) -> TokenStream {
    let simple = |name: &str, argument: usize| {
        let (name, argument) = (ident(name), index(argument));
        quote!(Input::#name(#argument))
    };
    let component_of = |name: &str, track: usize, component: usize| {
        let (name, track, component) = (ident(name), index(track), index(component));
        quote!(Input::#name { track: #track, component: #component })
    };
    match input {
        Input::Command(command) => simple("Command", command),
        Input::Position(component) => simple("Position", component),
        Input::Angle(component) => simple("Angle", component),
        Input::Rotation(entry) => simple("Rotation", entry),
        Input::TcpPosition(component) => simple("TcpPosition", component),
        Input::Direction(command) => simple("Direction", command),
        Input::Time => quote!(Input::Time),
        Input::Temperature => quote!(Input::Temperature),
        Input::Load { track, component } => component_of("Load", track, component),
        Input::Tension(link) => simple("Tension", link),
        Input::Pull(link) => simple("Pull", link),
        Input::TensionByPull { link, pulled } => {
            let (link, pulled) = (index(link), index(pulled));
            quote!(Input::TensionByPull { link: #link, pulled: #pulled })
        }
        Input::LoadByPull {
            track,
            component,
            pulled,
        } => {
            let (track, component, pulled) = (index(track), index(component), index(pulled));
            quote!(Input::LoadByPull { track: #track, component: #component, pulled: #pulled })
        }
        Input::SegmentStart { track, component } => component_of("SegmentStart", track, component),
        Input::SegmentEnd { track, component } => component_of("SegmentEnd", track, component),
        Input::SegmentStartCommand(track) => simple("SegmentStartCommand", track),
        Input::SegmentEndCommand(track) => simple("SegmentEndCommand", track),
        Input::Held(parameter) => simple("Held", parameter),
    }
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
