//! Names in formulas: parameters of the effect or the robot, quantities, values of the link, units.

use proc_macro2::Ident;

use super::value::{Checked, Shape};
use super::vocabulary::{FUNCTIONS, QUANTITIES, find_quantity, subject_word};
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{EffectParameter, Formula, Readable, Subject, Track, Value};
use crate::names::{article, nearest};
use crate::units::{Dimension, find_unit};

/// Names that formulas may use.
pub(super) struct Scope<'a> {
    pub(super) home: Home,
    pub(super) tracks: &'a [Track],
    parameters: Vec<Declaration<'a>>,
}

/// Where a formula stands.
pub(super) enum Home {
    /// In an effect of a name, on a subject that is `None` after an error.
    Effect(String, Option<Subject>),
    /// The value of a link or a crank.
    Value(ValueHome),
}

/// Names of a value's own.
pub(super) struct ValueHome {
    /// The value in words, such as `length`.
    pub(super) what: &'static str,
    /// Dimension of `q`, where it may be read.
    pub(super) command: Option<Dimension>,
    /// Other values of the same link.
    pub(super) others: Vec<(Value, Other)>,
}

/// Meaning of a value's name in a formula of the same link.
#[derive(Clone)]
pub(super) enum Other {
    /// Parameters of its own.
    Own,
    /// The formula that it is.
    Formula(Formula),
    /// Why it can't be read.
    Refused(&'static str),
    /// An error has been reported.
    Poisoned,
}

struct Declaration<'a> {
    name: &'a Ident,
    parameter: EffectParameter,
    /// Meanings of its components; none after an error in its name.
    leaves: Vec<Formula>,
    /// True if the dimension is known.
    sound: bool,
    used: bool,
}

impl<'a> Scope<'a> {
    pub(super) fn new(home: Home, tracks: &'a [Track]) -> Self {
        Self {
            home,
            tracks,
            parameters: Vec::new(),
        }
    }

    /// Declares a parameter of an effect.
    pub(super) fn declare(&mut self, name: &'a Ident, parameter: EffectParameter, sound: bool) {
        let index = self.parameters.len();
        let leaves =
            (0..parameter.components).map(|component| Formula::Parameter(index, component));
        let leaves = leaves.collect();
        self.declare_as(name, parameter, leaves, sound);
    }

    /// Declares a parameter whose components mean something else.
    pub(super) fn declare_as(
        &mut self,
        name: &'a Ident,
        parameter: EffectParameter,
        leaves: Vec<Formula>,
        sound: bool,
    ) {
        self.parameters.push(Declaration {
            name,
            parameter,
            leaves,
            sound,
            used: false,
        });
    }

    /// Takes the meaning from a name that has another one already: its uses may mean either, and raise no errors.
    pub(super) fn poison(&mut self, name: &Ident) {
        for own in self.parameters.iter_mut().filter(|own| own.name == name) {
            own.leaves.clear();
        }
    }

    pub(super) fn unused(&self) -> impl Iterator<Item = (&'a Ident, &EffectParameter)> {
        self.parameters
            .iter()
            .filter(|own| !own.used)
            .map(|own| (own.name, &own.parameter))
    }

    pub(super) fn into_parameters(self) -> Vec<EffectParameter> {
        self.parameters
            .into_iter()
            .map(|own| own.parameter)
            .collect()
    }

    /// Index of the parameter of a name.
    pub(super) fn parameter(&self, name: &Ident) -> Option<usize> {
        self.parameters.iter().position(|own| own.name == name)
    }

    pub(super) fn subject(&self) -> Option<Subject> {
        match self.home {
            Home::Effect(_, subject) => subject,
            Home::Value(_) => None,
        }
    }

    fn word(&self) -> Option<&'static str> {
        self.subject().map(subject_word)
    }

    /// The place of the formulas in words.
    fn place(&self) -> String {
        match &self.home {
            Home::Effect(name, _) => format!("effect `{name}`"),
            Home::Value(home) => format!("the formula of `{}`", home.what),
        }
    }
}

/// Meaning of a name in the value of a link or a crank.
enum Meaning {
    Known(Checked),
    /// Nothing, which has been reported.
    Refused,
    /// Its meaning in effects.
    Shared,
}

fn of_value(name: &Ident, home: &ValueHome, diagnostics: &mut Diagnostics) -> Meaning {
    let text = name.to_string();
    if text == "q" {
        let Some(dimension) = home.command else {
            error!(diagnostics, UNREADABLE_IN_VALUE, name; "`{}` cannot read `q`", home.what;
                "only `length` of a link that is `actuated` reads its command");
            return Meaning::Refused;
        };
        let q = Formula::Read(Readable::Command);
        return Meaning::Known(Checked::scalar(q, dimension));
    }
    if let Some(value) = Value::find(&text) {
        let other = home.others.iter().find(|(own, _)| *own == value);
        let reason = match other.map(|(_, other)| other) {
            Some(Other::Own) => {
                let leaf = |component| Formula::OfLink(value, component);
                let shape = if value.is_vector() {
                    Shape::Vector(Box::new([leaf(0), leaf(1), leaf(2)]))
                } else {
                    Shape::Scalar(leaf(0))
                };
                let dimension = Some(value.dimension());
                return Meaning::Known(Checked { shape, dimension });
            }
            Some(Other::Formula(formula)) => {
                let shape = match formula.clone() {
                    Formula::Vector(components) => Shape::Vector(components),
                    scalar => Shape::Scalar(scalar),
                };
                let dimension = Some(value.dimension());
                return Meaning::Known(Checked { shape, dimension });
            }
            Some(Other::Poisoned) => return Meaning::Refused,
            Some(Other::Refused(reason)) => reason,
            None => "it is no value of the same link",
        };
        error!(diagnostics, UNREADABLE_IN_VALUE, name; "`{}` cannot read `{text}`: {reason}", home.what;
            "declare what both follow from as a parameter of the robot: `param name: …;`");
        return Meaning::Refused;
    }
    if find_quantity(&text).is_some() {
        error!(diagnostics, UNREADABLE_IN_VALUE, name; "`{}` cannot read `{text}`", home.what;
            "values of the geometry are the same at every pose; what changes is an effect: `effect … on link {{ … }}`");
        return Meaning::Refused;
    }
    Meaning::Shared
}

/// Value of a name: a parameter, a constant, a quantity or a unit.
pub(super) fn named(
    name: &Ident,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let text = name.to_string();
    if let Some(index) = scope.parameter(name) {
        let own = &mut scope.parameters[index];
        own.used = true;
        let shape = match own.leaves.as_slice() {
            [x, y, z] => Shape::Vector(Box::new([x.clone(), y.clone(), z.clone()])),
            leaves => Shape::Scalar(leaves.first()?.clone()),
        };
        let dimension = own.sound.then_some(own.parameter.dimension);
        return Some(Checked { shape, dimension });
    }
    if text == "pi" {
        return Some(Checked::scalar(
            Formula::Number(std::f64::consts::PI),
            Dimension::NUMBER,
        ));
    }
    if let Home::Value(home) = &scope.home {
        match of_value(name, home, diagnostics) {
            Meaning::Known(checked) => return Some(checked),
            Meaning::Refused => return None,
            Meaning::Shared => {}
        }
    }
    if let Some(quantity) = find_quantity(&text) {
        available(name, quantity.subjects, scope, diagnostics)?;
        if quantity.readable == Readable::PaidOut && !is_wound(scope) && scope.subject().is_some() {
            error!(diagnostics, UNREADABLE_IN_EFFECT, name;
                "only a drum pays out: `paid_out` is read by effects on links that it winds up";
                "write `on link actuated angle`");
            return None;
        }
        let dimension = match quantity.readable {
            Readable::Command if scope.subject().is_some_and(Subject::is_turned) => {
                Dimension::ANGLE
            }
            _ => quantity.dimension,
        };
        return Some(Checked::scalar(Formula::Read(quantity.readable), dimension));
    }
    if let Some(unit) = find_unit(&text) {
        return Some(Checked::scalar(
            Formula::Number(unit.factor),
            unit.dimension,
        ));
    }
    let diagnostic = if FUNCTIONS.iter().any(|(own, ..)| *own == text) {
        diagnostic!(ARGUMENT_COUNT, name; "`{text}` is a function"; "write `{text}(…)`")
    } else {
        unknown(name, scope)
    };
    diagnostics.push(diagnostic);
    None
}

/// True in effects on links that drums wind up.
fn is_wound(scope: &Scope<'_>) -> bool {
    scope.subject() == Some(Subject::LinkByAngle)
}

/// Reports a quantity that the effect's subject does not have.
fn available(
    name: &Ident,
    subjects: &[&str],
    scope: &Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<()> {
    let Some(word) = scope.word().filter(|word| !subjects.contains(word)) else {
        return Some(());
    };
    let help = if *name == "q" {
        "name a track: `q(track)`".to_owned()
    } else {
        let own: Vec<_> = QUANTITIES
            .iter()
            .filter(|quantity| quantity.subjects.contains(&word))
            .filter(|quantity| quantity.readable != Readable::PaidOut || is_wound(scope))
            .map(|quantity| quantity.name)
            .collect();
        format!("it reads {}", own.join(", "))
    };
    error!(diagnostics, UNREADABLE_IN_EFFECT, name; "an effect on {word} cannot read `{name}`"; "{help}");
    None
}

fn unknown(name: &Ident, scope: &Scope<'_>) -> Diagnostic {
    let text = name.to_string();
    let parameters = scope
        .parameters
        .iter()
        .map(|own| ("parameter", own.parameter.name.as_str()));
    let quantities = QUANTITIES.iter().map(|own| ("quantity", own.name));
    let quantities = quantities.filter(|_| matches!(scope.home, Home::Effect(..)));
    let functions = FUNCTIONS.iter().map(|(name, ..)| ("function", *name));
    let all: Vec<_> = parameters.chain(quantities).chain(functions).collect();
    let near = nearest(&text, all.iter().map(|(_, name)| *name))
        .and_then(|near| all.iter().find(|(_, name)| *name == near));
    let help = match near {
        Some((what, near)) => {
            format!(
                "{} {what} with a similar name exists: `{near}`",
                article(what)
            )
        }
        None if scope.tracks.iter().any(|track| track.name == text) => {
            format!("write `q({text})` for the command of track `{text}`")
        }
        None if matches!(scope.home, Home::Value(_)) => {
            format!("declare it as a parameter of the robot: `param {text}: …;`")
        }
        None => format!("declare it: `param {text}: …;`"),
    };
    diagnostic!(UNKNOWN_NAME, name; "cannot find `{text}` in {}", scope.place(); "{help}")
}

/// Value of a component of a parameter.
pub(super) fn component(
    name: &Ident,
    component: u64,
    location: Location,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let Some(index) = scope.parameter(name) else {
        if matches!(scope.home, Home::Value(_)) && Value::find(&name.to_string()).is_some() {
            let shape = named(name, scope, diagnostics)?;
            let component = usize::try_from(component).ok();
            return match (shape.shape, component) {
                (Shape::Vector(components), Some(component @ 0..3)) => Some(Checked {
                    shape: Shape::Scalar(components[component].clone()),
                    dimension: shape.dimension,
                }),
                _ => {
                    error!(diagnostics, NO_COMPONENT, location; "`{name}` has no such component";
                        "vectors have the components 0 to 2, lengths have none");
                    None
                }
            };
        }
        diagnostics.push(if find_quantity(&name.to_string()).is_some() {
            diagnostic!(NO_COMPONENT, location; "`{name}` is a scalar and has no components"; "write `{name}`")
        } else {
            unknown(name, scope)
        });
        return None;
    };
    let own = &mut scope.parameters[index];
    own.used = true;
    if own.leaves.is_empty() {
        return None;
    }
    if own.parameter.components == 1 {
        error!(diagnostics, NO_COMPONENT, location; "`{name}` is a scalar and has no components";
            "write `{name}`, or declare it as `{name}[3]`");
        return None;
    }
    let Some(component) = usize::try_from(component)
        .ok()
        .filter(|component| *component < 3)
    else {
        error!(diagnostics, NO_COMPONENT, location; "`{name}` has components 0 to 2, there is no {component}";
            "count from 0");
        return None;
    };
    let dimension = own.sound.then_some(own.parameter.dimension);
    let leaf = own.leaves.get(component)?.clone();
    Some(Checked {
        shape: Shape::Scalar(leaf),
        dimension,
    })
}
