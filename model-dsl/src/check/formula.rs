//! Formulas: names, shapes and dimensions.

use proc_macro2::Ident;

use super::call::call;
use super::quantity::unit_factor;
use super::vocabulary::{FUNCTIONS, QUANTITIES, find_quantity, meaning, subject_word};
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{BinaryOperator, EffectParameter, Formula, Subject, Track};
use crate::names::{article, nearest};
use crate::syntax::{self, Expression, ExpressionKind};
use crate::units::{Dimension, find_unit, to_si};

/// What the formulas of one effect may name.
pub(super) struct Scope<'a> {
    pub(super) effect: &'a syntax::Effect,
    pub(super) subject: Option<Subject>,
    pub(super) tracks: &'a [Track],
    parameters: Vec<Declaration<'a>>,
}

struct Declaration<'a> {
    name: &'a Ident,
    parameter: EffectParameter,
    /// Whether the dimension is known.
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

/// A scalar or three components.
pub(super) enum Shape {
    Scalar(Formula),
    Vector(Box<[Formula; 3]>),
}

impl Shape {
    pub(super) fn into_formula(self) -> Formula {
        match self {
            Self::Scalar(formula) => formula,
            Self::Vector(components) => Formula::Vector(components),
        }
    }

    fn map(self, operation: impl Fn(Formula) -> Formula) -> Self {
        match self {
            Self::Scalar(formula) => Self::Scalar(operation(formula)),
            Self::Vector(components) => Self::Vector(Box::new(components.map(operation))),
        }
    }

    fn word(&self) -> &'static str {
        match self {
            Self::Scalar(_) => "a scalar",
            Self::Vector(_) => "a vector",
        }
    }
}

/// A checked formula; its dimension is unknown after an error in a declaration.
pub(super) struct Checked {
    pub(super) shape: Shape,
    pub(super) dimension: Option<Dimension>,
}

impl Checked {
    pub(super) fn scalar(formula: Formula, dimension: Dimension) -> Self {
        Self {
            shape: Shape::Scalar(formula),
            dimension: Some(dimension),
        }
    }
}

/// Checks a formula; `None` after an error in it.
pub(super) fn formula(
    expression: &Expression,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let checked = by_kind(expression, scope, diagnostics)?;
    let components = match &checked.shape {
        Shape::Scalar(scalar) => std::slice::from_ref(scalar),
        Shape::Vector(components) => &components[..],
    };
    let mut constants = components.iter().filter_map(Formula::constant);
    let Some(wrong) = constants.find(|value| !value.is_finite()) else {
        return Some(checked);
    };
    let (message, help) = if wrong.is_nan() {
        let help =
            "check the arguments of its functions: roots and logarithms take positive numbers";
        ("this constant is not a number", help.to_owned())
    } else {
        let help = format!(
            "numbers end at {:e}: check its values and exponents",
            f64::MAX
        );
        ("this constant is infinite", help)
    };
    diagnostics.error(expression.location, message, help);
    None
}

fn by_kind(
    expression: &Expression,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    match &expression.kind {
        ExpressionKind::Number(value) => {
            Some(Checked::scalar(Formula::Number(*value), Dimension::NUMBER))
        }
        ExpressionKind::Measure(value, unit) => {
            let name = unit.name.to_string();
            let is_value = scope.parameter(&unit.name).is_some() || meaning(&name).is_some();
            if is_value && find_unit(&name).is_none() {
                let message = format!("`{name}` is not a unit");
                diagnostics.error(
                    &unit.name,
                    message,
                    "for a product write `*` between the two",
                );
                return None;
            }
            let (size, dimension) = unit_factor(unit, false, diagnostics)?;
            let value = to_si(*value, size);
            if !value.is_finite() {
                let message = "this value is too large";
                let help = format!("numbers end at {:e}", f64::MAX);
                diagnostics.error(expression.location, message, help);
                return None;
            }
            Some(Checked::scalar(Formula::Number(value), dimension))
        }
        ExpressionKind::Name(name) => named(name, scope, diagnostics),
        ExpressionKind::Component(name, index) => {
            component(name, *index, expression.location, scope, diagnostics)
        }
        ExpressionKind::Call(name, arguments) => {
            call(name, arguments, expression.location, scope, diagnostics)
        }
        ExpressionKind::Negate(inner) => {
            let Checked { shape, dimension } = formula(inner, scope, diagnostics)?;
            let shape = shape.map(|inner| Formula::Negate(Box::new(inner)));
            Some(Checked { shape, dimension })
        }
        ExpressionKind::Binary(operator, left, right) => {
            let operands = (
                formula(left, scope, diagnostics),
                formula(right, scope, diagnostics),
            );
            let (left, right_checked) = operands.0.zip(operands.1)?;
            if *operator == BinaryOperator::Divide
                && matches!(&right_checked.shape, Shape::Scalar(right) if right.constant() == Some(0.0))
            {
                let message = "division by zero";
                diagnostics.error(right.location, message, "divide by something else");
                return None;
            }
            binary(
                *operator,
                left,
                right_checked,
                expression.location,
                diagnostics,
            )
        }
        ExpressionKind::Power(base, exponent) => {
            let Checked { shape, dimension } = formula(base, scope, diagnostics)?;
            let Shape::Scalar(base) = shape else {
                let message = "a vector has no power";
                let help = "take the power of a component, such as `rate[0]^2`";
                diagnostics.error(expression.location, message, help);
                return None;
            };
            let dimension = match dimension.map(|dimension| dimension.power(*exponent)) {
                Some(None) => return unit_overflow(expression.location, diagnostics),
                known => known.flatten(),
            };
            Some(Checked {
                shape: Shape::Scalar(Formula::Power(Box::new(base), *exponent)),
                dimension,
            })
        }
        ExpressionKind::Tuple(components) => {
            tuple(components, expression.location, scope, diagnostics)
        }
    }
}

fn unit_overflow<T>(location: Location, diagnostics: &mut Diagnostics) -> Option<T> {
    let message = "the power of this formula's unit is too large";
    diagnostics.error(location, message, "check the exponents");
    None
}

fn tuple(
    components: &[Expression],
    location: Location,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let checked: Vec<_> = components
        .iter()
        .map(|one| formula(one, scope, diagnostics))
        .collect();
    if components.len() != 3 {
        let message = format!("a vector has 3 components, found {}", components.len());
        diagnostics.error(location, message, "write `(x, y, z)`");
        return None;
    }
    let mut scalars = Vec::new();
    let mut dimension: Option<Dimension> = None;
    for (one, written) in checked.into_iter().zip(components) {
        let one = one?;
        let Shape::Scalar(scalar) = one.shape else {
            let message = "a component of a vector cannot be a vector";
            diagnostics.error(written.location, message, "write a scalar");
            return None;
        };
        scalars.push(scalar);
        if let (Some(expected), Some(found)) = (dimension, one.dimension)
            && expected != found
        {
            let message = format!(
                "the components of a vector have one unit, found {} after {}",
                found.describe(),
                expected.describe()
            );
            diagnostics.error(written.location, message, "bring them to the same unit");
            return None;
        }
        dimension = dimension.or(one.dimension);
    }
    let shape = Shape::Vector(Box::new(scalars.try_into().ok()?));
    Some(Checked { shape, dimension })
}

fn binary(
    operator: BinaryOperator,
    left: Checked,
    right: Checked,
    location: Location,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    use BinaryOperator::{Add, Divide, Multiply, Subtract};
    let apply = |a, b| Formula::Binary(operator, Box::new(a), Box::new(b));
    let refuse = |left: &str, right: &str| match operator {
        Add => format!("cannot add {left} and {right}"),
        Subtract => format!("cannot subtract {right} from {left}"),
        Multiply => format!("cannot multiply {left} and {right}"),
        Divide => format!("cannot divide {left} by {right}"),
    };
    let known = left.dimension.zip(right.dimension);
    let dimension = match (operator, known) {
        (_, None) => None,
        (Add | Subtract, Some((a, b))) => {
            let dimension = common(a, b);
            if dimension.is_none() {
                let message = refuse(&a.describe(), &b.describe());
                diagnostics.error(location, message, different_help(a, b));
                return None;
            }
            dimension
        }
        (Multiply | Divide, Some((a, b))) => {
            let dimension = if operator == Multiply {
                a.multiply(b)
            } else {
                a.divide(b)
            };
            if dimension.is_none() {
                return unit_overflow(location, diagnostics);
            }
            dimension
        }
    };
    let shape = match (operator, left.shape, right.shape) {
        (_, Shape::Scalar(a), Shape::Scalar(b)) => Shape::Scalar(apply(a, b)),
        (Add | Subtract, Shape::Vector(a), Shape::Vector(b)) => {
            let ([a0, a1, a2], [b0, b1, b2]) = (*a, *b);
            Shape::Vector(Box::new([apply(a0, b0), apply(a1, b1), apply(a2, b2)]))
        }
        (Multiply | Divide, vector @ Shape::Vector(_), Shape::Scalar(scalar)) => {
            vector.map(|component| apply(component, scalar.clone()))
        }
        (Multiply, Shape::Scalar(scalar), vector @ Shape::Vector(_)) => {
            vector.map(|component| apply(scalar.clone(), component))
        }
        (_, left, right) => {
            let message = refuse(left.word(), right.word());
            let help = "vectors add to vectors; multiply or divide them by scalars, or use components, \
                        such as `rate[0]`";
            diagnostics.error(location, message, help);
            return None;
        }
    };
    Some(Checked { shape, dimension })
}

/// Dimension of a sum; a number stands for an angle where one is wanted.
pub(super) fn common(left: Dimension, right: Dimension) -> Option<Dimension> {
    let angles = [Dimension::ANGLE, Dimension::NUMBER];
    if left == right {
        Some(left)
    } else if angles.contains(&left) && angles.contains(&right) {
        Some(Dimension::ANGLE)
    } else {
        None
    }
}

/// How to mend two dimensions that do not go together.
pub(super) fn different_help(left: Dimension, right: Dimension) -> String {
    if left == Dimension::NUMBER {
        format!("give the number a unit, such as `1 {}`", right.si_unit())
    } else if right == Dimension::NUMBER {
        format!("give the number a unit, such as `1 {}`", left.si_unit())
    } else {
        "both sides must have the same dimension".to_owned()
    }
}

fn named(name: &Ident, scope: &mut Scope<'_>, diagnostics: &mut Diagnostics) -> Option<Checked> {
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

fn component(
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
