//! Formulas: names, shapes and dimensions.

use proc_macro2::Ident;

use super::quantity::unit_factor;
use super::robot::unknown_track;
use crate::diagnostics::{Diagnostic, Diagnostics, Location};
use crate::model::{BinaryOperator, EffectParameter, Formula, Function, Readable, Subject, Track};
use crate::names::{article, nearest};
use crate::syntax::{self, Expression, ExpressionKind};
use crate::units::{Dimension, find_unit, to_si};

use super::effect::subject_word;

/// What a formula reads by a bare name besides `q`: name, meaning, dimension, subjects.
pub(super) const READABLES: [(&str, Readable, Dimension, &[&str]); 11] = [
    (
        "direction",
        Readable::Direction,
        Dimension::NUMBER,
        &["cart", "link"],
    ),
    (
        "time",
        Readable::Time,
        Dimension::TIME,
        &["cart", "link", "tcp"],
    ),
    (
        "temperature",
        Readable::Temperature,
        Dimension::TEMPERATURE,
        &["cart", "link", "tcp"],
    ),
    (
        "load_along",
        Readable::LoadAlong,
        Dimension::FORCE,
        &["cart"],
    ),
    (
        "load_horizontal",
        Readable::LoadHorizontal,
        Dimension::FORCE,
        &["cart"],
    ),
    (
        "load_vertical",
        Readable::LoadVertical,
        Dimension::FORCE,
        &["cart"],
    ),
    ("tension", Readable::Tension, Dimension::FORCE, &["link"]),
    ("length", Readable::Length, Dimension::LENGTH, &["link"]),
    (
        "x",
        Readable::Position(0),
        Dimension::LENGTH,
        &["cart", "link", "tcp"],
    ),
    (
        "y",
        Readable::Position(1),
        Dimension::LENGTH,
        &["cart", "link", "tcp"],
    ),
    (
        "z",
        Readable::Position(2),
        Dimension::LENGTH,
        &["cart", "link", "tcp"],
    ),
];

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

/// What the formulas of one effect may name.
pub(super) struct Scope<'a> {
    effect: &'a syntax::Effect,
    pub(super) subject: Option<Subject>,
    tracks: &'a [Track],
    parameters: Vec<Declaration<'a>>,
    pub(super) reads_cart: Option<&'static str>,
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
            reads_cart: None,
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
    fn scalar(formula: Formula, dimension: Dimension) -> Self {
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
    match &expression.kind {
        ExpressionKind::Number(value) => {
            Some(Checked::scalar(Formula::Number(*value), Dimension::NUMBER))
        }
        ExpressionKind::Measure(value, unit) => {
            let (size, dimension) = unit_factor(unit, false, diagnostics)?;
            let value = to_si(*value, size);
            if !value.is_finite() {
                let message = "this value is too large";
                let help = format!("numbers end at {:e}", f64::MAX);
                diagnostics.push(Diagnostic::new(expression.location, message).help(help));
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
                && matches!(right_checked.shape, Shape::Scalar(Formula::Number(0.0)))
            {
                let message = "division by zero";
                diagnostics.push(
                    Diagnostic::new(right.location, message).help("divide by something else"),
                );
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
                diagnostics.push(Diagnostic::new(expression.location, message).help(help));
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
    diagnostics.push(Diagnostic::new(location, message).help("check the exponents"));
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
        diagnostics.push(Diagnostic::new(location, message).help("write `(x, y, z)`"));
        return None;
    }
    let mut scalars = Vec::new();
    let mut dimension: Option<Dimension> = None;
    for (one, written) in checked.into_iter().zip(components) {
        let one = one?;
        let Shape::Scalar(scalar) = one.shape else {
            let message = "a component of a vector cannot be a vector";
            diagnostics.push(Diagnostic::new(written.location, message).help("write a scalar"));
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
            diagnostics.push(
                Diagnostic::new(written.location, message).help("bring them to the same unit"),
            );
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
    let (verb, joint) = match operator {
        Add => ("add", "and"),
        Subtract => ("subtract", "and"),
        Multiply => ("multiply", "and"),
        Divide => ("divide", "by"),
    };
    let known = left.dimension.zip(right.dimension);
    let dimension = match (operator, known) {
        (_, None) => None,
        (Add | Subtract, Some((a, b))) => match common(a, b) {
            Some(dimension) => Some(dimension),
            None => {
                diagnostics.push(different(&format!("cannot {verb}"), joint, a, b, location));
                return None;
            }
        },
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
            let message = format!("cannot {verb} {} {joint} {}", left.word(), right.word());
            let help = "vectors add to vectors; multiply or divide them by scalars, or use components, \
                        such as `rate[0]`";
            diagnostics.push(Diagnostic::new(location, message).help(help));
            return None;
        }
    };
    Some(Checked { shape, dimension })
}

/// Dimension of a sum; a number stands for an angle where one is wanted.
fn common(left: Dimension, right: Dimension) -> Option<Dimension> {
    let angles = [Dimension::ANGLE, Dimension::NUMBER];
    if left == right {
        Some(left)
    } else if angles.contains(&left) && angles.contains(&right) {
        Some(Dimension::ANGLE)
    } else {
        None
    }
}

fn different(
    verb: &str,
    joint: &str,
    left: Dimension,
    right: Dimension,
    location: Location,
) -> Diagnostic {
    let message = format!("{verb} {} {joint} {}", left.describe(), right.describe());
    let help = if left == Dimension::NUMBER {
        format!("give the number a unit, such as `1 {}`", right.si_unit())
    } else if right == Dimension::NUMBER {
        format!("give the number a unit, such as `1 {}`", left.si_unit())
    } else {
        "both sides must have the same dimension".to_owned()
    };
    Diagnostic::new(location, message).help(help)
}

fn named(name: &Ident, scope: &mut Scope<'_>, diagnostics: &mut Diagnostics) -> Option<Checked> {
    let text = name.to_string();
    if let Some(index) = scope.parameters.iter().position(|own| own.name == name) {
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
    if text == "q" {
        readable(name, &["cart", "link"], scope, diagnostics)?;
        scope.reads_cart.get_or_insert("q");
        return Some(Checked::scalar(
            Formula::Read(Readable::Command),
            Dimension::LENGTH,
        ));
    }
    if let Some((_, what, dimension, subjects)) = READABLES.iter().find(|(own, ..)| *own == text) {
        readable(name, subjects, scope, diagnostics)?;
        if *what == Readable::Direction {
            scope.reads_cart.get_or_insert("direction");
        }
        return Some(Checked::scalar(Formula::Read(*what), *dimension));
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
fn readable(
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
        let mut own: Vec<_> = READABLES
            .iter()
            .filter(|(.., subjects)| subjects.contains(&word))
            .map(|(name, ..)| *name)
            .collect();
        own.insert(0, if word == "tcp" { "q(track)" } else { "q" });
        format!("it reads {}", own.join(", "))
    };
    let message = format!("an effect on {word} cannot read `{name}`");
    diagnostics.push(Diagnostic::new(name, message).help(help));
    None
}

fn unknown(name: &Ident, scope: &Scope<'_>) -> Diagnostic {
    let text = name.to_string();
    let parameters = scope
        .parameters
        .iter()
        .map(|own| ("parameter", own.parameter.name.as_str()));
    let quantities = READABLES.iter().map(|(name, ..)| ("quantity", *name));
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
    let Some(index) = scope.parameters.iter().position(|own| own.name == name) else {
        let known = *name == "q" || READABLES.iter().any(|(own, ..)| *own == name.to_string());
        diagnostics.push(if known {
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
        diagnostics.push(Diagnostic::new(location, message).help(help));
        return None;
    }
    let Some(component) = usize::try_from(component)
        .ok()
        .filter(|component| *component < 3)
    else {
        let message = format!("`{name}` has components 0 to 2, there is no {component}");
        diagnostics.push(Diagnostic::new(location, message).help("count from 0"));
        return None;
    };
    let dimension = own.sound.then_some(own.parameter.dimension);
    Some(Checked {
        shape: Shape::Scalar(Formula::Parameter(index, component)),
        dimension,
    })
}

fn call(
    name: &Ident,
    arguments: &[Expression],
    location: Location,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    if *name == "q" {
        return command_of(arguments, location, scope, diagnostics);
    }
    let checked: Vec<_> = arguments
        .iter()
        .map(|one| formula(one, scope, diagnostics))
        .collect();
    let Some((_, function, arity)) = FUNCTIONS.iter().find(|(own, ..)| *name == own) else {
        let text = name.to_string();
        let is_value = scope.parameters.iter().any(|own| own.name == name)
            || READABLES.iter().any(|(own, ..)| *own == text)
            || text == "pi"
            || find_unit(&text).is_some();
        let help = if is_value {
            format!("for a product write `{text} * (…)`")
        } else {
            match nearest(&text, FUNCTIONS.iter().map(|(name, ..)| *name)) {
                Some(near) => format!("a function with a similar name exists: `{near}`"),
                None => {
                    let names: Vec<_> = FUNCTIONS.iter().map(|(name, ..)| *name).collect();
                    format!("the functions are {}", names.join(", "))
                }
            }
        };
        diagnostics.push(Diagnostic::new(name, format!("`{text}` is not a function")).help(help));
        return None;
    };
    if arguments.len() != *arity {
        let plural = if *arity == 1 { "" } else { "s" };
        let message = format!(
            "`{name}` takes {arity} argument{plural}, found {}",
            arguments.len()
        );
        let help = if *arity == 1 {
            format!("write `{name}(a)`")
        } else {
            format!("write `{name}(a, b)`")
        };
        diagnostics.push(Diagnostic::new(location, message).help(help));
        return None;
    }
    let mut scalars = Vec::new();
    let mut dimensions = Vec::new();
    for (one, written) in checked.into_iter().zip(arguments) {
        let one = one?;
        let Shape::Scalar(scalar) = one.shape else {
            let message = format!("`{name}` takes scalars, but this is a vector");
            let help = "take it of a component, such as `rate[0]`";
            diagnostics.push(Diagnostic::new(written.location, message).help(help));
            return None;
        };
        scalars.push(scalar);
        dimensions.push(one.dimension);
    }
    let dimension = match dimensions.into_iter().collect::<Option<Vec<_>>>() {
        Some(known) => Some(result(
            *function,
            &known,
            name,
            arguments,
            location,
            diagnostics,
        )?),
        None => None,
    };
    Some(Checked {
        shape: Shape::Scalar(Formula::Call(*function, scalars)),
        dimension,
    })
}

/// Dimension of a function's value.
fn result(
    function: Function,
    dimensions: &[Dimension],
    name: &Ident,
    arguments: &[Expression],
    location: Location,
    diagnostics: &mut Diagnostics,
) -> Option<Dimension> {
    let first = *dimensions.first()?;
    let (allowed, value): (&[Dimension], Dimension) = match function {
        Function::Sin | Function::Cos | Function::Tan => {
            (&[Dimension::NUMBER, Dimension::ANGLE], Dimension::NUMBER)
        }
        Function::Atan => (&[Dimension::NUMBER], Dimension::ANGLE),
        Function::Exp | Function::Ln | Function::Tanh => (&[Dimension::NUMBER], Dimension::NUMBER),
        Function::Abs => return Some(first),
        Function::Sign => return Some(Dimension::NUMBER),
        Function::Sqrt => {
            let root = first.square_root();
            if root.is_none() {
                let message = format!("{} has no square root", first.describe());
                let help = "every exponent of the unit must be even";
                diagnostics.push(Diagnostic::new(arguments.first()?.location, message).help(help));
            }
            return root;
        }
        Function::Min | Function::Max => {
            let second = *dimensions.get(1)?;
            let value = common(first, second);
            if value.is_none() {
                let verb = format!("`{name}` cannot compare");
                diagnostics.push(different(&verb, "and", first, second, location));
            }
            return value;
        }
    };
    if allowed.contains(&first) {
        return Some(value);
    }
    let wanted = if allowed.len() == 1 {
        "a number"
    } else {
        "an angle or a number"
    };
    let message = format!("`{name}` takes {wanted}, found {}", first.describe());
    let help = format!("divide by something in `{}`", first.si_unit());
    diagnostics.push(Diagnostic::new(arguments.first()?.location, message).help(help));
    None
}

/// `q(track)`, `q(source)`
fn command_of(
    arguments: &[Expression],
    location: Location,
    scope: &Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    let [
        Expression {
            kind: ExpressionKind::Name(place),
            ..
        },
    ] = arguments
    else {
        let message = "`q(…)` takes the name of one track";
        let help = "write `q(track)`, or `q * (…)` for a product";
        diagnostics.push(Diagnostic::new(location, message).help(help));
        return None;
    };
    let what = if *place == "source" {
        if scope
            .subject
            .is_some_and(|subject| subject != Subject::CartFromSource)
        {
            let message = format!("effect `{}` has no source", scope.effect.name);
            let help = format!(
                "declare it: `effect {} on cart from source`",
                scope.effect.name
            );
            diagnostics.push(Diagnostic::new(place, message).help(help));
            return None;
        }
        Readable::SourceCommand
    } else {
        let Some(track) = scope.tracks.iter().position(|track| *place == track.name) else {
            diagnostics.push(unknown_track(place, scope.tracks));
            return None;
        };
        Readable::CommandOf(track)
    };
    Some(Checked::scalar(Formula::Read(what), Dimension::LENGTH))
}
