//! Names in formulas: parameters of the effect, quantities, units.

use proc_macro2::Ident;

use super::value::{Checked, Shape};
use super::vocabulary::{FUNCTIONS, QUANTITIES, find_quantity, subject_word};
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{EffectParameter, Formula, Subject, Track};
use crate::names::{article, nearest};
use crate::syntax;
use crate::units::{Dimension, find_unit};

/// Names that the formulas of one effect may use.
pub(super) struct Scope<'a> {
    pub(super) effect: &'a syntax::Effect,
    pub(super) subject: Option<Subject>,
    pub(super) tracks: &'a [Track],
    parameters: Vec<Declaration<'a>>,
}

struct Declaration<'a> {
    name: &'a Ident,
    parameter: EffectParameter,
    /// True if the dimension is known.
    sound: bool,
    used: bool,
}

impl<'a> Scope<'a> {
    pub(super) fn new(
        effect: &'a syntax::Effect,
        subject: Option<Subject>,
        tracks: &'a [Track],
    ) -> Self {
        Self {
            effect,
            subject,
            tracks,
            parameters: Vec::new(),
        }
    }

    pub(super) fn declare(&mut self, name: &'a Ident, parameter: EffectParameter, sound: bool) {
        self.parameters.push(Declaration {
            name,
            parameter,
            sound,
            used: false,
        });
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

    fn word(&self) -> Option<&'static str> {
        self.subject.map(subject_word)
    }
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
        let shape = if own.parameter.components == 3 {
            Shape::Vector(Box::new(
                [0, 1, 2].map(|component| Formula::Parameter(index, component)),
            ))
        } else {
            Shape::Scalar(Formula::Parameter(index, 0))
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
    if let Some(quantity) = find_quantity(&text) {
        available(name, quantity.subjects, scope, diagnostics)?;
        return Some(Checked::scalar(
            Formula::Read(quantity.readable),
            quantity.dimension,
        ));
    }
    if let Some(unit) = find_unit(&text) {
        return Some(Checked::scalar(
            Formula::Number(unit.factor),
            unit.dimension,
        ));
    }
    let diagnostic = if FUNCTIONS.iter().any(|(own, ..)| *own == text) {
        Diagnostic::new(name, format!("`{text}` is a function")).help(format!("write `{text}(…)`"))
    } else {
        unknown(name, scope)
    };
    diagnostics.push(diagnostic);
    None
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
            .map(|quantity| quantity.name)
            .collect();
        format!("it reads {}", own.join(", "))
    };
    let message = format!("an effect on {word} cannot read `{name}`");
    diagnostics.error(name, message, help);
    None
}

fn unknown(name: &Ident, scope: &Scope<'_>) -> Diagnostic {
    let text = name.to_string();
    let parameters = scope
        .parameters
        .iter()
        .map(|own| ("parameter", own.parameter.name.as_str()));
    let quantities = QUANTITIES.iter().map(|own| ("quantity", own.name));
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
        None => format!("declare it: `param {text}: …;`"),
    };
    Diagnostic::new(
        name,
        format!("cannot find `{text}` in effect `{}`", scope.effect.name),
    )
    .help(help)
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
        diagnostics.push(if find_quantity(&name.to_string()).is_some() {
            Diagnostic::new(
                location,
                format!("`{name}` is a scalar and has no components"),
            )
            .help(format!("write `{name}`"))
        } else {
            unknown(name, scope)
        });
        return None;
    };
    let own = &mut scope.parameters[index];
    own.used = true;
    if own.parameter.components == 1 {
        let message = format!("`{name}` is a scalar and has no components");
        let help = format!("write `{name}`, or declare it as `{name}[3]`");
        diagnostics.error(location, message, help);
        return None;
    }
    let Some(component) = usize::try_from(component)
        .ok()
        .filter(|component| *component < 3)
    else {
        let message = format!("`{name}` has components 0 to 2, there is no {component}");
        diagnostics.error(location, message, "count from 0");
        return None;
    };
    let dimension = own.sound.then_some(own.parameter.dimension);
    Some(Checked {
        shape: Shape::Scalar(Formula::Parameter(index, component)),
        dimension,
    })
}
