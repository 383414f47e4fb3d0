//! Unnamed rivals: smooth functions of every covariate at every place, in the language.

use std::fmt::Write;

use tau_codegen::language::Model;

/// Start of the names of unnamed families; no catalogue may use it.
pub const UNNAMED: &str = "unnamed_";

/// An unnamed family: the displacement, and the quantity that it follows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Family {
    pub(super) name: String,
    /// `along`, `roll`, `length`, `position x`, …
    pub(super) direction: String,
    /// `q`, `time`, `load`, …
    pub(super) against: &'static str,
    pub(super) placement: Placement,
}

/// Placement of a family.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Placement {
    /// At one place.
    Single,
    /// At all places at once, with amplitudes of their own.
    PerPlace,
    /// At all places at once, with the same amplitudes.
    Shared,
}

/// Periods of what repeats along a track: racks, pinions, rails on a cart; joints and cables on a link.
const PERIODS: [(&str, &str, &str); 2] = [
    ("cart", "along", "4 mm ..= 1 m"),
    ("link", "length", "50 mm ..= 1 m"),
];
/// Number of triangles that follow a track piece by piece.
const TRIANGLES: usize = 9;
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

/// The families of a robot whose commands span a range (m): their text in the language, and what each is.
pub(super) fn families(model: &Model, (low_m, high_m): (f64, f64)) -> (String, Vec<Family>) {
    let (middle_m, half_m) = (
        f64::midpoint(low_m, high_m),
        (0.5 * (high_m - low_m)).max(1e-3),
    );
    // From −1 to 1 along the track.
    let s = format!("((q - ({middle_m} m)) / ({half_m} m))");
    let legendre = [
        s.clone(),
        format!("(3*{s}^2 - 1) / 2"),
        format!("(5*{s}^3 - 3*{s}) / 2"),
        format!("(35*{s}^4 - 30*{s}^2 + 3) / 8"),
    ];
    let legendre = legendre.each_ref().map(String::as_str);
    let triangles: Vec<String> = (0..TRIANGLES)
        .map(|k| {
            let width = 2.0 / (TRIANGLES - 1) as f64;
            let top = width * k as f64 - 1.0;
            format!("max(0, 1 - abs({s} - ({top})) / {width})")
        })
        .collect();
    let triangles: Vec<&str> = triangles.iter().map(String::as_str).collect();
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
    let shift = ["along", "horizontal", "vertical"];
    let turn = ["roll", "pitch", "yaw"];
    if !model.tracks.is_empty() {
        for axis in shift {
            families.add("cart", axis, "q", &legendre);
            families.add("cart", axis, "direction", &DIRECTION);
            families.add("cart", axis, "temperature", &WARM_TRAVEL);
            families.add("cart", axis, "time", &TIME);
            families.add("cart", axis, "load", &LOAD);
            families.add("cart", axis, "position", &PLACE);
            families.add("cart", axis, "commands", &travels);
            families.add("cart", axis, "stretch", &triangles);
        }
        for axis in turn {
            families.add("cart", axis, "q", &legendre[..3]);
            families.add("cart", axis, "direction", &DIRECTION[..2]);
            families.add("cart", axis, "temperature", &TEMPERATURE);
            families.add("cart", axis, "time", &TIME);
            families.add("cart", axis, "load", &LOAD);
            families.add("cart", axis, "commands", &travels);
        }
        for (axes, name) in [(shift, "shift"), (turn, "turn")] {
            families.bundle(
                ("cart", Placement::Single),
                name,
                &axes,
                "q",
                &legendre[..3],
            );
            families.bundle(
                ("cart", Placement::Single),
                name,
                &axes,
                "direction",
                &DIRECTION[..2],
            );
            families.bundle(("cart", Placement::Single), name, &axes, "load", &LOAD);
        }
        families.of_all("cart", "along", "temperature", &WARM_TRAVEL);
        families.of_all("cart", "along", "direction", &DIRECTION[..1]);
        families.of_all("cart", "along", "q", &legendre[..3]);
    }
    families.add("link", "length", "q", &legendre);
    families.add("link", "length", "stretch", &triangles);
    families.add("link", "length", "position", &PLACE);
    families.add("link", "length", "tension", &TENSION);
    families.add("link", "length", "temperature", &TEMPERATURE);
    families.add("link", "length", "time", &TIME);
    families.of_all("link", "length", "tension", &TENSION[..1]);
    families.of_all("link", "length", "temperature", &TEMPERATURE);
    let axes = ["x", "y", "z"];
    for axis in axes {
        families.add("tcp", axis, "time", &TIME);
        families.add("tcp", axis, "temperature", &TEMPERATURE);
        families.add("tcp", axis, "position", &PLACE);
    }
    families.bundle(("tcp", Placement::Single), "vector", &axes, "time", &TIME);
    families.bundle(
        ("tcp", Placement::Single),
        "vector",
        &axes,
        "temperature",
        &TEMPERATURE,
    );
    families.bundle(
        ("tcp", Placement::Single),
        "vector",
        &axes,
        "position",
        &PLACE[..3],
    );
    families.scale();
    for (subject, axis, range) in PERIODS {
        families.periodic(subject, axis, range);
    }
    families.common("link", "length", "temperature", &TEMPERATURE);
    families.common("link", "length", "tension", &TENSION[..1]);
    (families.text, families.list)
}

struct Families {
    text: String,
    list: Vec<Family>,
}

impl Families {
    /// One axis as a function of something.
    fn add(&mut self, subject: &str, axis: &str, against: &'static str, basis: &[&str]) {
        self.bundle((subject, Placement::Single), axis, &[axis], against, basis);
    }

    /// A wave along a track.
    fn periodic(&mut self, subject: &str, axis: &str, range: &str) {
        let name = format!("{UNNAMED}{subject}_{axis}_periodic");
        let _ = writeln!(
            self.text,
            "effect {name} on {subject} {{ param sine, cosine: length; \
             search period: length in {range}; \
             {axis} += sine * sin(2*pi*q/period) + cosine * cos(2*pi*q/period); }}"
        );
        self.list.push(Family {
            name,
            direction: axis.into(),
            against: "q",
            placement: Placement::Single,
        });
    }

    /// A displacement that grows with the distance from the origin.
    fn scale(&mut self) {
        let name = format!("{UNNAMED}tcp_scale_position");
        let _ = writeln!(
            self.text,
            "effect {name} on tcp {{ param c: length; position += c * (x/(1 m), y/(1 m), z/(1 m)); }}"
        );
        self.list.push(Family {
            name,
            direction: "position".into(),
            against: "position",
            placement: Placement::Single,
        });
    }

    /// The same everywhere.
    fn common(&mut self, subject: &str, axis: &str, against: &'static str, basis: &[&str]) {
        self.bundle((subject, Placement::Shared), axis, &[axis], against, basis);
    }

    /// The same at all places at once.
    fn of_all(&mut self, subject: &str, axis: &str, against: &'static str, basis: &[&str]) {
        self.bundle(
            (subject, Placement::PerPlace),
            axis,
            &[axis],
            against,
            basis,
        );
    }

    /// Several axes, each with amplitudes of its own.
    fn bundle(
        &mut self,
        (subject, placement): (&str, Placement),
        direction: &str,
        axes: &[&str],
        against: &'static str,
        basis: &[&str],
    ) {
        let at = match placement {
            Placement::Single => "",
            Placement::PerPlace => "_all",
            Placement::Shared => "_common",
        };
        let name = format!("{UNNAMED}{subject}{at}_{direction}_{against}");
        let (mut parameters, mut terms) = (String::new(), String::new());
        for (k, axis) in axes.iter().enumerate() {
            let coefficients: Vec<String> =
                (1..=basis.len()).map(|i| format!("c{k}_{i}")).collect();
            let sum: Vec<String> = coefficients
                .iter()
                .zip(basis)
                .map(|(c, term)| format!("{c} * ({term})"))
                .collect();
            let sum = sum.join(" + ");
            let unit = match *axis {
                "roll" | "pitch" | "yaw" => "angle",
                _ => "length",
            };
            let term = match *axis {
                "x" => format!("position += ({sum}) * (1, 0, 0);"),
                "y" => format!("position += ({sum}) * (0, 1, 0);"),
                "z" => format!("position += ({sum}) * (0, 0, 1);"),
                _ => format!("{axis} += {sum};"),
            };
            // Writing into a string can't fail.
            let _ = write!(parameters, "param {}: {unit}; ", coefficients.join(", "));
            let _ = write!(terms, "{term} ");
        }
        let _ = writeln!(
            self.text,
            "effect {name} on {subject} {{ {parameters}{terms}}}"
        );
        let direction = match direction {
            "x" | "y" | "z" => format!("position {direction}"),
            "vector" => "position".into(),
            "shift" | "turn" => axes.join(", "),
            _ => direction.to_owned(),
        };
        self.list.push(Family {
            name,
            direction,
            against: if against == "stretch" { "q" } else { against },
            placement,
        });
    }
}
