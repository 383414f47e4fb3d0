//! Parts of results that read as words: each displays, and serialises, as the text that it stands for.

use std::fmt;

use serde::ser::SerializeMap;
use serde::{Serialize, Serializer};
use tau_codegen::language::model;
use tau_codes::{Code, discovery as codes};

use super::{Dimension, Lack, Model, Readable, Target, Treatment, Verdict};
use crate::separation::{MIN_SEPARATION_GAIN, POSES};
use crate::text::DISCOVERED;

/// Place of an effect, of structure or of a motion, by names of the description. It displays as `one`, `two,one`, `all`
/// or `tcp`; several places as a list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Place {
    /// The cart of a track.
    Cart(String),
    /// A cart that moves, and the one whose command it follows.
    CartFrom(String, String),
    /// One link.
    Link(String),
    /// The links of a cluster, which a reduced arm takes for one.
    Cluster(String),
    /// All carts in common.
    AllCarts,
    /// All links in common.
    AllLinks,
    /// A crank.
    Crank(String),
    /// All cranks in common.
    AllCranks,
    /// The base joint of a link, or the centre of a crank.
    BaseJoint(String),
    /// All of these in common.
    AllBaseJoints,
    /// The TCP as measured.
    Tcp,
    /// The driven part of a command, counted from 1, where that has no name.
    Command(usize),
    /// Several places, each with amplitudes of its own.
    Several(Vec<Self>),
}

impl Place {
    /// The place of an effect of a model.
    pub(crate) fn of(model: &Model, place: model::Place) -> Self {
        let track = |track: usize| model.tracks[track].name.clone();
        match place {
            model::Place::Cart {
                track: moved,
                source: Some(source),
            } => Self::CartFrom(track(moved), track(source)),
            model::Place::Cart { track: moved, .. } => Self::Cart(track(moved)),
            model::Place::AllCarts => Self::AllCarts,
            model::Place::Link(link) => Self::Link(model.links[link].name.clone()),
            model::Place::AllLinks => Self::AllLinks,
            model::Place::Crank(own) => Self::Crank(track(own)),
            model::Place::AllCranks => Self::AllCranks,
            model::Place::BaseJoint(link) => Self::BaseJoint(model.links[link].name.clone()),
            model::Place::CrankCentre(own) => Self::BaseJoint(track(own)),
            model::Place::AllBaseJoints => Self::AllBaseJoints,
            model::Place::Tcp => Self::Tcp,
        }
    }
}

impl Place {
    /// True if an effect of a model acts there.
    pub fn is_of(&self, model: &Model, effect: &model::Effect) -> bool {
        let on = effect.subject;
        let is_kind = match self {
            Self::Cart(_) | Self::AllCarts => on == model::Subject::Cart,
            Self::CartFrom(..) => on == model::Subject::CartFromSource,
            Self::Link(_) | Self::Cluster(_) | Self::AllLinks => on.is_link(),
            Self::Crank(_) | Self::AllCranks => on == model::Subject::Crank,
            Self::BaseJoint(_) | Self::AllBaseJoints => on == model::Subject::BaseJoint,
            Self::Tcp => on == model::Subject::Tcp,
            Self::Command(_) => false,
            Self::Several(places) => return places.iter().all(|own| own.is_of(model, effect)),
        };
        let name = self.to_string();
        is_kind && name.split(',').all(|name| model.acts_on(effect, name))
    }
}

impl fmt::Display for Place {
    /// The alternate form (`{:#}`) is that of a description, with a space behind each comma.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Cart(name)
            | Self::Link(name)
            | Self::Cluster(name)
            | Self::Crank(name)
            | Self::BaseJoint(name) => f.write_str(name),
            Self::CartFrom(moved, source) if f.alternate() => write!(f, "{moved}, {source}"),
            Self::CartFrom(moved, source) => write!(f, "{moved},{source}"),
            Self::AllCarts | Self::AllLinks | Self::AllCranks | Self::AllBaseJoints => {
                f.write_str("all")
            }
            Self::Tcp => f.write_str("tcp"),
            Self::Command(number) => write!(f, "command {number}"),
            Self::Several(places) => {
                let places: Vec<String> = places.iter().map(Self::to_string).collect();
                f.write_str(&places.join(", "))
            }
        }
    }
}

/// A motion of a cart, a link or the measured TCP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Motion {
    /// Motion that effects add to: the target, and its component where it is a vector.
    Target(Target, usize),
    /// What a crank or a drum adds to its command, an angle.
    Turn,
    /// Off in one stretch of a track.
    InOneStretch,
}

impl Motion {
    /// That of a component of a target in effects on a subject.
    pub(crate) fn of(target: Target, component: usize, subject: model::Subject) -> Self {
        if target == Target::Command && subject.is_turned() {
            return Self::Turn;
        }
        Self::Target(target, component)
    }

    /// Unit of its size.
    pub fn unit(self) -> Micro {
        match self {
            Self::Target(Target::Roll | Target::Pitch | Target::Yaw, _) | Self::Turn => {
                Micro::Radian
            }
            _ => Micro::Metre,
        }
    }
}

impl fmt::Display for Motion {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Target(
                target @ (Target::Joint | Target::Position | Target::Shift),
                component,
            ) => {
                let axis = ["x", "y", "z"][(*component).min(2)];
                write!(f, "{} {axis}", target.name())
            }
            Self::Target(target, _) => f.write_str(target.name()),
            Self::Turn => f.write_str(Target::Command.name()),
            Self::InOneStretch => f.write_str("in one stretch"),
        }
    }
}

/// Millionths of an SI unit; in JSON `um` or `urad`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub enum Micro {
    /// Micrometres.
    #[serde(rename = "um")]
    Metre,
    /// Microradians.
    #[serde(rename = "urad")]
    Radian,
}

impl fmt::Display for Micro {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Metre => "µm",
            Self::Radian => "µrad",
        })
    }
}

/// A quantity that something is shown against.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Quantity {
    /// Its meaning in the language.
    #[serde(skip)]
    pub readable: Readable,
    /// As a formula writes it: `q`, `q(two)`, `time`, …
    #[serde(rename = "against")]
    pub name: String,
    /// Its unit: `m`, `s`, `°C`, `N`, or nothing.
    #[serde(rename = "against_unit")]
    pub unit: String,
}

impl Quantity {
    pub(crate) fn of(readable: Readable, model: &Model) -> Self {
        Self {
            readable,
            name: readable.written(&model.tracks),
            unit: match readable.dimension() {
                Dimension::NUMBER => String::new(),
                Dimension::TEMPERATURE => "°C".to_owned(),
                dimension => dimension.si_unit(),
            },
        }
    }
}

impl Quantity {
    /// The same of a drive whose command may be an angle.
    #[must_use]
    pub(crate) fn of_drive(self, is_angle: bool) -> Self {
        if !is_angle || self.readable != Readable::Command {
            return self;
        }
        Self {
            unit: Dimension::ANGLE.si_unit(),
            ..self
        }
    }
}

/// Reason why an effect can't be seen.
#[derive(Debug, Clone, PartialEq)]
pub enum Reason {
    /// The machine or the measurements lack something.
    Lacks(Lack),
    /// A quantity that it reads never changes.
    Constant(Readable),
    /// The base absorbs it.
    Absorbed,
    /// The base absorbs this share of its signal.
    MostlyAbsorbed(f64),
    /// It would be seen from an amplitude of a parameter on (SI, with its dimension) that is not plausible.
    Implausible(String, f64, Dimension),
}

impl Reason {
    /// Its code.
    pub fn code(&self) -> Code {
        match self {
            Self::Lacks(lack) => lack.code,
            Self::Constant(_) => codes::CONSTANT,
            Self::Absorbed => codes::ABSORBED,
            Self::MostlyAbsorbed(_) => codes::MOSTLY_ABSORBED,
            Self::Implausible(..) => codes::IMPLAUSIBLE,
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Lacks(what) => what.fmt(f),
            Self::Constant(readable) => {
                let what = match readable {
                    Readable::Temperature => "temperature",
                    Readable::Time => "time",
                    _ => "side of approach",
                };
                write!(f, "the {what} never changes")
            }
            Self::Absorbed => f.write_str("the base absorbs it"),
            Self::MostlyAbsorbed(share) => {
                write!(f, "the base absorbs {:.2} % of it", 100.0 * share)
            }
            Self::Implausible(parameter, amplitude, unit) => write!(
                f,
                "it would be seen from {parameter} = {amplitude:.1e} {} on, beyond what is plausible",
                unit.si_unit()
            ),
        }
    }
}

/// Ways to repeat a measurement, in words.
pub(crate) const TREATMENTS: [(Treatment, &str); 6] = [
    (Treatment::Same, "under the same conditions"),
    (Treatment::Load(3.0), "with three times the payload"),
    (Treatment::Load(0.0), "without payload"),
    (Treatment::Warmer(5.0), "5 K warmer"),
    (Treatment::Reversed, "approached from the other side"),
    (Treatment::Later(3600.0), "an hour later"),
];

/// The measurement that would tell an effect from its rival. Separations are the χ² that is left of the effect's signal
/// once base and rival have been fitted to it.
#[derive(Debug, Clone, PartialEq)]
pub enum Separation {
    /// Set 1 shows both or neither.
    NotInSet1,
    /// The poses of set 1 that tell most where they are measured once more.
    Repeat {
        /// Their numbers, ascending, each as often as it is measured.
        poses: Vec<u32>,
        /// The conditions.
        treatment: Treatment,
        /// Separation of what was measured, with these poses, and from which on they are enough.
        chi2: [f64; 3],
    },
}

impl Separation {
    /// Its code.
    pub fn code(&self) -> Code {
        match self {
            Self::NotInSet1 => codes::NOT_IN_SET_1,
            Self::Repeat { chi2, .. } if is_nothing(*chi2) => codes::INSEPARABLE,
            Self::Repeat { .. } if self.decides() => codes::SEPARABLE,
            Self::Repeat { .. } => codes::TOO_FEW_POSES,
        }
    }

    /// True if the measurement would decide.
    pub fn decides(&self) -> bool {
        let Self::Repeat { chi2, .. } = self else {
            return false;
        };
        let [present, raised, needed] = *chi2;
        raised >= needed && raised >= MIN_SEPARATION_GAIN * present
    }
}

/// True if nothing is left of a separation, to the digit that is written.
fn is_nothing([_, raised, _]: [f64; 3]) -> bool {
    raised < 0.05
}

impl fmt::Display for Separation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self::Repeat {
            poses,
            treatment,
            chi2: chi2 @ [present, raised, needed],
        } = self
        else {
            return f.write_str("no measurement of set 1 shows the one without the other");
        };
        if is_nothing(*chi2) {
            return f.write_str(
                "no measurement on this machine tells the two apart: the rival explains whatever the effect does",
            );
        }
        if !self.decides() {
            return write!(
                f,
                "no measurement on this machine tells the two apart: {POSES} further poses would raise the separation from χ² = {present:.1} to \
                 {raised:.1} at most, {needed:.1} are needed"
            );
        }
        let readings = poses.chunk_by(|a, b| a == b);
        let poses: Vec<String> = readings
            .map(|own| match own.len() {
                1 => own[0].to_string(),
                times => format!("{} ({times} times)", own[0]),
            })
            .collect();
        let known = TREATMENTS.iter().find(|known| known.0 == *treatment);
        write!(
            f,
            "poses {} once more, {}: they raise the separation from χ² = {present:.1} to {raised:.1}",
            poses.join(", "),
            known.map_or("", |known| known.1)
        )
    }
}

impl Verdict {
    /// Its code.
    pub fn code(self) -> Code {
        match self {
            Self::Found => codes::FOUND,
            Self::Rival => codes::RIVAL,
            Self::NotSignificant => codes::NOT_SIGNIFICANT,
            Self::NotConfirmed => codes::NOT_CONFIRMED,
            Self::Rejected => codes::REJECTED,
            Self::NotTheBest => codes::NOT_THE_BEST,
            Self::Explained => codes::EXPLAINED_BY_OTHERS,
            Self::WithoutName => codes::WITHOUT_NAME,
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Found => "found",
            Self::Rival => "could be meant instead",
            Self::NotSignificant => "not significant",
            Self::NotConfirmed => "not confirmed",
            Self::Rejected => "rejected",
            Self::NotTheBest => "not the best explanation",
            Self::Explained => "explained by what was found",
            Self::WithoutName => "in the model, without a name",
        })
    }
}

/// An effect in a variant. It displays without its tolerances: `rack_pitch(two) with sine2, cosine2`.
#[derive(Debug, Clone, PartialEq)]
pub struct UsedEffect {
    /// Name in the catalogue.
    pub name: String,
    /// What effects of this form act on; others of the name may act on something else.
    pub on: model::Subject,
    /// Its place.
    pub place: Place,
    /// Optional parameters that it takes.
    pub with: Vec<String>,
    /// Tolerances of its parameters, in those of the effect.
    pub tolerance_factor: f64,
}

impl UsedEffect {
    /// As a model uses it.
    pub(crate) fn of(model: &Model, used: &model::EffectUse) -> Self {
        let effect = &model.effects[used.effect];
        let names = used.with.iter().map(|&k| effect.parameters[k].name.clone());
        Self {
            name: effect.name.clone(),
            on: effect.subject,
            place: Place::of(model, used.place),
            with: names.collect(),
            tolerance_factor: used.tolerance_factor,
        }
    }
}

impl fmt::Display for UsedEffect {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            name, place, with, ..
        } = self;
        write!(f, "{name}({place:#})")?;
        match with.as_slice() {
            [] => Ok(()),
            with => write!(f, " with {}", with.join(", ")),
        }
    }
}

/// A variant as another one with effects. It displays as the line that derives what was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Derived {
    /// Name of the other variant.
    pub base: String,
    /// The effects that it has besides.
    pub effects: Vec<UsedEffect>,
}

impl Derived {
    /// The line of the description that derives it, as a variant of a name.
    pub(crate) fn line(&self, name: &str) -> String {
        let effects = self.effects.iter().map(|effect| {
            let tolerances = match effect.tolerance_factor {
                1.0 => String::new(),
                factor => format!(" tol * {factor}"),
            };
            format!(" + {effect}{tolerances}")
        });
        format!(
            "variant {name} = {}{};",
            self.base,
            effects.collect::<String>()
        )
    }
}

impl fmt::Display for Derived {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.line(DISCOVERED))
    }
}

macro_rules! serialize_as_displayed {
    ($($name:ty),*) => {$(
        impl Serialize for $name {
            fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.collect_str(self)
            }
        }
    )*};
}

serialize_as_displayed!(Place, Motion, Reason, Separation, Verdict, Derived);

/// Writes a text and its code as two fields, of the names `$field` and `code`, for `#[serde(flatten)]`.
macro_rules! serialize_with_code {
    ($($function:ident: $name:ty as $field:literal),*) => {$(
        #[allow(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
        pub(super) fn $function<S: Serializer>(
            own: &$name,
            serializer: S,
        ) -> Result<S::Ok, S::Error> {
            let mut fields = serializer.serialize_map(Some(2))?;
            fields.serialize_entry($field, own)?;
            fields.serialize_entry("code", &own.code().to_string())?;
            fields.end()
        }
    )*};
}

serialize_with_code!(
    why: Reason as "why",
    separate_by: Separation as "separate_by",
    verdict: Verdict as "verdict"
);
