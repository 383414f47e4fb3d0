//! Unnamed rivals: smooth functions of every covariate at every place, in the language.

use std::fmt::Write;

use tau_codegen::language::Model;

/// Start of the names of unnamed families; no catalogue may use it.
pub(super) const PREFIX: &str = "unnamed_";

/// What an unnamed family moves, and as a function of what.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Family {
    pub(super) name: String,
    /// `along`, `roll`, `length`, `position x`, …
    pub(super) direction: String,
    /// `q`, `time`, `load`, …
    pub(super) against: &'static str,
}

/// Legendre polynomials P1 to P4 of q / 1 m, by terms of equal order.
const LEGENDRE: [&str; 4] = [
    "q/(1 m)",
    "(3*(q/(1 m))^2 - 1) / 2",
    "(5*(q/(1 m))^3 - 3*q/(1 m)) / 2",
    "(35*(q/(1 m))^4 - 30*(q/(1 m))^2 + 3) / 8",
];
/// Smooth functions of conditions.
const TIME: [&str; 2] = ["time/(1 s)", "(time/(1 s))^2"];
const TEMPERATURE: [&str; 1] = ["(temperature - 20 K)/(1 K)"];
const WARM_TRAVEL: [&str; 2] = [
    "(temperature - 20 K)/(1 K)",
    "q/(1 m) * (temperature - 20 K)/(1 K)",
];
const DIRECTION: [&str; 3] = [
    "direction",
    "direction * q/(1 m)",
    "direction * (q/(1 m))^2",
];
const LOAD: [&str; 3] = [
    "load_along/(1 N)",
    "load_horizontal/(1 N)",
    "load_vertical/(1 N)",
];
const TENSION: [&str; 2] = ["tension/(1 N)", "(tension/(1 N))^2"];
const PLACE: [&str; 9] = [
    "x/(1 m)",
    "y/(1 m)",
    "z/(1 m)",
    "(x/(1 m))^2",
    "(y/(1 m))^2",
    "(z/(1 m))^2",
    "x*y/(1 m)^2",
    "y*z/(1 m)^2",
    "z*x/(1 m)^2",
];

/// The families of a robot: their text in the language, and what each is.
pub(super) fn families(model: &Model) -> (String, Vec<Family>) {
    let mut families = Families {
        text: String::new(),
        list: Vec::new(),
    };
    let commands: Vec<String> = model
        .tracks
        .iter()
        .map(|track| format!("q({})/(1 m)", track.name))
        .collect();
    let mut travels = commands.clone();
    for (k, a) in commands.iter().enumerate() {
        travels.extend(commands[k..].iter().map(|b| format!("{a} * {b}")));
    }
    let travels: Vec<&str> = travels.iter().map(String::as_str).collect();
    if !model.tracks.is_empty() {
        for axis in ["along", "horizontal", "vertical"] {
            families.add("cart", axis, "q", &LEGENDRE);
            families.add("cart", axis, "direction", &DIRECTION);
            families.add("cart", axis, "temperature", &WARM_TRAVEL);
            families.add("cart", axis, "time", &TIME);
            families.add("cart", axis, "load", &LOAD);
            families.add("cart", axis, "position", &PLACE);
            families.add("cart", axis, "commands", &travels);
        }
        for axis in ["roll", "pitch", "yaw"] {
            families.add("cart", axis, "q", &LEGENDRE[..3]);
            families.add("cart", axis, "direction", &DIRECTION[..2]);
            families.add("cart", axis, "temperature", &TEMPERATURE);
            families.add("cart", axis, "time", &TIME);
            families.add("cart", axis, "load", &LOAD);
            families.add("cart", axis, "commands", &travels);
        }
    }
    families.add("link", "length", "position", &PLACE);
    families.add("link", "length", "tension", &TENSION);
    families.add("link", "length", "temperature", &TEMPERATURE);
    families.add("link", "length", "time", &TIME);
    for axis in ["x", "y", "z"] {
        families.add("tcp", axis, "time", &TIME);
        families.add("tcp", axis, "temperature", &TEMPERATURE);
        families.add("tcp", axis, "position", &PLACE);
    }
    (families.text, families.list)
}

struct Families {
    text: String,
    list: Vec<Family>,
}

impl Families {
    fn add(&mut self, subject: &str, direction: &str, against: &'static str, basis: &[&str]) {
        let name = format!("{PREFIX}{subject}_{direction}_{against}");
        let (unit, target) = match direction {
            "roll" | "pitch" | "yaw" => ("angle", direction),
            "x" | "y" | "z" => ("length", "position"),
            _ => ("length", direction),
        };
        let parameters: Vec<String> = (1..=basis.len()).map(|k| format!("c{k}")).collect();
        let sum: Vec<String> = parameters
            .iter()
            .zip(basis)
            .map(|(c, term)| format!("{c} * ({term})"))
            .collect();
        let sum = sum.join(" + ");
        let formula = match direction {
            "x" => format!("({sum}) * (1, 0, 0)"),
            "y" => format!("({sum}) * (0, 1, 0)"),
            "z" => format!("({sum}) * (0, 0, 1)"),
            _ => sum,
        };
        // Writing into a string can't fail.
        let _ = writeln!(
            self.text,
            "effect {name} on {subject} {{ param {}: {unit}; {target} += {formula}; }}",
            parameters.join(", ")
        );
        let direction = match direction {
            "x" | "y" | "z" => format!("position {direction}"),
            _ => direction.to_owned(),
        };
        self.list.push(Family {
            name,
            direction,
            against,
        });
    }
}
