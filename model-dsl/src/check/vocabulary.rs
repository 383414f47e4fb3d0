//! The words that effects and their formulas may use.

use crate::model::{Function, Readable, Subject, Target, Track};
use crate::units::{Dimension, find_unit};

/// Targets of effects: name, target, dimension, whether it is a vector.
pub(super) const TARGETS: [(&str, Target, Dimension, bool); 11] = [
    ("along", Target::Along, Dimension::LENGTH, false),
    ("horizontal", Target::Horizontal, Dimension::LENGTH, false),
    ("vertical", Target::Vertical, Dimension::LENGTH, false),
    ("roll", Target::Roll, Dimension::ANGLE, false),
    ("pitch", Target::Pitch, Dimension::ANGLE, false),
    ("yaw", Target::Yaw, Dimension::ANGLE, false),
    ("length", Target::Length, Dimension::LENGTH, false),
    ("joint", Target::Joint, Dimension::LENGTH, true),
    ("position", Target::Position, Dimension::LENGTH, true),
    ("command", Target::Command, Dimension::LENGTH, false),
    ("shift", Target::Shift, Dimension::LENGTH, true),
];

impl Target {
    fn described(self) -> (&'static str, Self, Dimension, bool) {
        let known = TARGETS.into_iter().find(|known| known.1 == self);
        known.unwrap_or_else(|| unreachable!("every target has a word"))
    }

    /// Its word in the language.
    pub fn name(self) -> &'static str {
        self.described().0
    }

    /// Dimension of the quantity in effects on a subject: commands of cranks and drums are angles.
    pub fn dimension(self, subject: Subject) -> Dimension {
        if self == Self::Command && subject.is_turned() {
            return Dimension::ANGLE;
        }
        self.described().2
    }

    /// True if it has three components.
    pub fn is_vector(self) -> bool {
        self.described().3
    }
}

/// The word for what an effect acts on.
pub(super) fn subject_word(subject: Subject) -> &'static str {
    match subject {
        Subject::Cart | Subject::CartFromSource => "cart",
        Subject::Link
        | Subject::DrivenLink
        | Subject::LinkByLength
        | Subject::LinkByAngle
        | Subject::PulledLink => "link",
        Subject::Crank => "crank",
        Subject::BaseJoint => "base joint",
        Subject::Tcp => "tcp",
    }
}

impl Subject {
    /// True if the command of the part that it acts on is an angle.
    pub fn is_turned(self) -> bool {
        matches!(self, Self::LinkByAngle | Self::Crank)
    }

    /// True if effects on it may add to a target.
    pub(super) fn takes(self, target: Target) -> bool {
        match target {
            Target::Command => {
                matches!(self, Self::LinkByLength | Self::LinkByAngle | Self::Crank)
            }
            _ => subject_of(target) == subject_word(self),
        }
    }
}

/// The words for the places of all effects that a target belongs to.
pub(super) fn subject_of(target: Target) -> &'static str {
    match target {
        Target::Along
        | Target::Horizontal
        | Target::Vertical
        | Target::Roll
        | Target::Pitch
        | Target::Yaw => "cart",
        Target::Length | Target::Joint => "link",
        Target::Position => "tcp",
        Target::Command => "crank, link actuated length or link actuated angle",
        Target::Shift => "base joint",
    }
}

/// A quantity that formulas read by a bare name.
pub(super) struct Quantity {
    pub(super) name: &'static str,
    pub(super) readable: Readable,
    pub(super) dimension: Dimension,
    /// The subjects of effects that can read it.
    pub(super) subjects: &'static [&'static str],
}

const fn quantity(
    name: &'static str,
    readable: Readable,
    dimension: Dimension,
    subjects: &'static [&'static str],
) -> Quantity {
    Quantity {
        name,
        readable,
        dimension,
        subjects,
    }
}

const EVERYWHERE: &[&str] = &["cart", "link", "crank", "base joint", "tcp"];
const DRIVES: &[&str] = &["cart", "link", "crank", "base joint"];

/// The quantities that formulas read by a bare name.
pub(super) const QUANTITIES: [Quantity; 17] = [
    quantity("q", Readable::Command, Dimension::LENGTH, DRIVES),
    quantity("travel", Readable::Travel, Dimension::NUMBER, DRIVES),
    quantity("direction", Readable::Direction, Dimension::NUMBER, DRIVES),
    quantity("time", Readable::Time, Dimension::TIME, EVERYWHERE),
    quantity(
        "temperature",
        Readable::Temperature,
        Dimension::TEMPERATURE,
        EVERYWHERE,
    ),
    quantity(
        "load_along",
        Readable::LoadAlong,
        Dimension::FORCE,
        &["cart"],
    ),
    quantity(
        "load_horizontal",
        Readable::LoadHorizontal,
        Dimension::FORCE,
        &["cart"],
    ),
    quantity(
        "load_vertical",
        Readable::LoadVertical,
        Dimension::FORCE,
        &["cart"],
    ),
    quantity("tension", Readable::Tension, Dimension::FORCE, &["link"]),
    quantity("length", Readable::Length, Dimension::LENGTH, &["link"]),
    quantity("paid_out", Readable::PaidOut, Dimension::LENGTH, &["link"]),
    quantity("x", Readable::Position(0), Dimension::LENGTH, EVERYWHERE),
    quantity("y", Readable::Position(1), Dimension::LENGTH, EVERYWHERE),
    quantity("z", Readable::Position(2), Dimension::LENGTH, EVERYWHERE),
    quantity(
        "base_x",
        Readable::Base(0),
        Dimension::LENGTH,
        &["base joint"],
    ),
    quantity(
        "base_y",
        Readable::Base(1),
        Dimension::LENGTH,
        &["base joint"],
    ),
    quantity(
        "base_z",
        Readable::Base(2),
        Dimension::LENGTH,
        &["base joint"],
    ),
];

/// The quantity of a name.
pub(super) fn find_quantity(name: &str) -> Option<&'static Quantity> {
    QUANTITIES.iter().find(|quantity| quantity.name == name)
}

impl Readable {
    fn quantity(self) -> Option<&'static Quantity> {
        QUANTITIES.iter().find(|known| known.readable == self)
    }

    /// As a formula writes it, on a robot with these tracks.
    pub fn written(self, tracks: &[Track]) -> String {
        match self {
            Self::CommandOf(track) => format!("q({})", tracks[track].name),
            Self::SourceCommand => "q(source)".to_owned(),
            _ => self.quantity().map_or("", |known| known.name).to_owned(),
        }
    }

    /// Its dimension.
    pub fn dimension(self) -> Dimension {
        self.quantity()
            .map_or(Dimension::LENGTH, |known| known.dimension)
    }
}

/// Elementary functions with their number of arguments.
pub(super) const FUNCTIONS: [(&str, Function, usize); 12] = [
    ("sin", Function::Sin, 1),
    ("cos", Function::Cos, 1),
    ("tan", Function::Tan, 1),
    ("atan", Function::Atan, 1),
    ("exp", Function::Exp, 1),
    ("ln", Function::Ln, 1),
    ("tanh", Function::Tanh, 1),
    ("sqrt", Function::Sqrt, 1),
    ("abs", Function::Abs, 1),
    ("sign", Function::Sign, 1),
    ("min", Function::Min, 2),
    ("max", Function::Max, 2),
];

/// Meaning of a word in every formula, if it has one.
pub(super) fn meaning(name: &str) -> Option<&'static str> {
    if find_quantity(name).is_some() {
        Some("a quantity that formulas read")
    } else if name == "pi" {
        Some("a constant")
    } else if find_unit(name).is_some() {
        Some("a unit")
    } else if name == "norm" || FUNCTIONS.iter().any(|(own, ..)| *own == name) {
        Some("a function")
    } else {
        None
    }
}
