//! Values of links and cranks: numbers with tolerances, or formulas.

use std::collections::BTreeMap;

use proc_macro2::Ident;

use super::declared::Declared;
use super::formula::formula;
use super::quantity::{metres, scalar, tolerance, unit_help, values};
use super::scope::{Home, Other, Scope, ValueHome};
use super::value::Shape;
use crate::diagnostics::Diagnostics;
use crate::model::{Crank, Formula, LinkDefaults, Plate, Quantity, Readable, Value};
use crate::plausible::{FARTHEST_M, LARGEST_PLATE_M, LONGEST_M, SMALLEST_DEVIATION, WIDE};
use crate::syntax::{self, Expression, ExpressionKind, Given};
use crate::units::{Dimension, find_unit};

/// Carrier of a link.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Carrier {
    Base,
    Track,
    Crank,
}

/// Surroundings of the values of a link.
#[derive(Clone, Copy)]
pub(super) struct OfLink {
    pub(super) carrier: Carrier,
    pub(super) plate: Plate,
    /// Where the length is driven: whether by an angle.
    pub(super) driven_by_angle: Option<bool>,
}

impl OfLink {
    /// True of a link that a cart or a crank drives already: an error, so that its length may be meant either way.
    pub(super) fn is_drive_refused(self) -> bool {
        self.driven_by_angle.is_some() && self.carrier != Carrier::Base
    }
}

/// The values that a link's declaration gives.
pub(super) fn link(
    links: &syntax::Links,
    of: OfLink,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> LinkDefaults {
    let mut names = Declared::default();
    let mut given: BTreeMap<Value, &syntax::NamedValue> = BTreeMap::new();
    for one in &links.values {
        names.declare(&one.name, "value of this link", diagnostics);
        let Some(value) = Value::find(&one.name.to_string()) else {
            continue;
        };
        let refused = match (value, of.carrier) {
            (Value::PlateJoint, _) if of.plate.is_point() => Some((
                format!(
                    "the plate is a {}, where links have no joints of their own",
                    of.plate.written()
                ),
                "leave it out: all links meet in the point, whose place is that of the TCP",
            )),
            (Value::TrackDirection, Carrier::Base) => Some((
                "a link on the fixed base has no track direction".to_owned(),
                "leave it out",
            )),
            (Value::TrackDirection, Carrier::Crank) => Some((
                "a link on a crank has no track direction".to_owned(),
                "leave it out: its joint turns about the `axis` of the crank",
            )),
            _ => None,
        };
        match refused {
            Some((message, help)) => {
                error!(diagnostics, VALUE_NOT_HERE, &one.name; "{message}"; "{help}");
            }
            None => drop(given.entry(value).or_insert(one)),
        }
    }
    let mut defaults = LinkDefaults::default();
    // A value may read others of the same link, so those come first.
    let mut others: Vec<(Value, Other)> = Value::ALL
        .into_iter()
        .map(|value| (value, initial(value, of)))
        .collect();
    let mut waiting: Vec<Value> = Value::ALL
        .into_iter()
        .filter(|value| given.contains_key(value))
        .collect();
    while !waiting.is_empty() {
        let is_ready = |value: &Value| {
            let read = given
                .get(value)
                .map_or_else(Vec::new, |one| read_values(one, scope));
            read.iter().all(|other| !waiting.contains(other))
        };
        let Some(next) = waiting.iter().position(is_ready) else {
            circle(&waiting, &given, diagnostics);
            break;
        };
        let value = waiting.remove(next);
        let Some(one) = given.get(&value) else {
            continue;
        };
        let before = diagnostics.count();
        let command = match (value, of.driven_by_angle) {
            (Value::Length, Some(true)) => Some(Dimension::ANGLE),
            (Value::Length, Some(false)) => Some(Dimension::LENGTH),
            _ => None,
        };
        scope.home = Home::Value(ValueHome {
            what: value.name(),
            command,
            others: others.clone(),
        });
        let (dimension, largest) = (value.dimension(), largest_m(value));
        let found = match value {
            Value::Length => {
                let found: Quantity<1> =
                    quantity(one, dimension, largest, false, scope, diagnostics);
                positive(one, &found, diagnostics);
                defaults.length = driven(one, found, of, diagnostics);
                defaults.length.formula.clone()
            }
            _ => {
                let found: Quantity<3> =
                    quantity(one, dimension, largest, true, scope, diagnostics);
                if value == Value::TrackDirection {
                    moves_plate(one, of.plate, &found, diagnostics);
                }
                let formula = found.formula.clone();
                match value {
                    Value::PlateJoint => defaults.plate_joint = found,
                    Value::TrackOffset => defaults.track_offset = found,
                    _ => defaults.track_direction = found,
                }
                formula
            }
        };
        if let Some((_, other)) = others.iter_mut().find(|(own, _)| *own == value) {
            match (found, &*other) {
                _ if diagnostics.count() > before => *other = Other::Poisoned,
                (Some(formula), Other::Own) => *other = Other::Formula(formula),
                _ => {}
            }
        }
    }
    if of.driven_by_angle == Some(true)
        && !of.is_drive_refused()
        && !given.contains_key(&Value::Length)
        && let (Some((_, location)), Some(name)) = (links.actuated, links.names.first())
    {
        error!(diagnostics, COMMAND_UNREAD, location; "how long `{name}` is at an angle is not said";
            "write it as a formula of the command: `length = zero + radius * q;`, with `param radius: m/rad;`");
    }
    defaults
}

/// Meaning of reading a value before its formula is known.
fn initial(value: Value, of: OfLink) -> Other {
    match value {
        Value::Length if of.is_drive_refused() => Other::Poisoned,
        Value::Length if of.driven_by_angle.is_some() => {
            Other::Refused("the length of a driven link changes with its command")
        }
        Value::PlateJoint if of.plate.is_point() => {
            Other::Refused("links that meet in a point have none")
        }
        Value::TrackDirection if of.carrier != Carrier::Track => {
            Other::Refused("the link is on no track")
        }
        _ => Other::Own,
    }
}

/// The values of a crank of a machine with such a plate.
pub(super) fn crank(
    given: &[syntax::NamedValue],
    plate: Plate,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Crank {
    let mut crank = Crank::default();
    let mut names = Declared::default();
    for one in given {
        names.declare(&one.name, "value of this crank", diagnostics);
        let (what, dimension, largest, slot) = if one.name == "axis" {
            ("axis", Dimension::NUMBER, f64::INFINITY, &mut crank.axis)
        } else {
            ("centre", Dimension::LENGTH, FARTHEST_M, &mut crank.centre)
        };
        scope.home = Home::Value(ValueHome {
            what,
            command: None,
            others: Vec::new(),
        });
        *slot = quantity(one, dimension, largest, true, scope, diagnostics);
    }
    if let Some(axis) = given.iter().find(|one| one.name == "axis") {
        moves_plate(axis, plate, &crank.axis, diagnostics);
    }
    crank
}

/// Reports a direction or an axis that is nowhere, or that moves no plate in its plane.
fn moves_plate(
    given: &syntax::NamedValue,
    plate: Plate,
    found: &Quantity<3>,
    diagnostics: &mut Diagnostics,
) {
    let components = match &found.formula {
        Some(Formula::Vector(components)) => {
            let constant = components.each_ref().map(Formula::constant);
            let [Some(x), Some(y), Some(z)] = constant else {
                return;
            };
            [x, y, z]
        }
        _ => match found.value {
            Some(value) => value,
            None => return,
        },
    };
    let is_axis = given.name == "axis";
    let (what, help) = if is_axis {
        let help = "write a vector along the axis, about which it turns as a right-hand screw";
        ("axis of the crank", help)
    } else {
        ("track direction", "write a vector along the track")
    };
    if components == [0.0; 3] {
        error!(diagnostics, NO_DIRECTION, &given.name; "the {what} is zero"; "{help}");
    } else if plate.is_in_plane() && is_axis && components[2] == 0.0 {
        error!(diagnostics, NO_DIRECTION, &given.name;
            "the {what} lies in the plane of the plate, out of which it would turn links";
            "write an axis across the plane: `axis = (0, 0, 1) exact;`");
    } else if plate.is_in_plane() && !is_axis && components[..2] == [0.0; 2] {
        error!(diagnostics, NO_DIRECTION, &given.name; "the {what} leads out of the plane of the plate";
            "write a vector in the plane, such as `(1, 0, 0)`");
    }
}

/// Largest number (m) in a value of a link; a direction may have any.
fn largest_m(value: Value) -> f64 {
    match value {
        Value::Length => LONGEST_M,
        Value::PlateJoint => LARGEST_PLATE_M,
        Value::TrackOffset => FARTHEST_M,
        Value::TrackDirection => f64::INFINITY,
    }
}

/// A value of a dimension whose numbers, where they are written out, are no larger than the largest.
fn quantity<const N: usize>(
    given: &syntax::NamedValue,
    dimension: Dimension,
    largest: f64,
    is_vector: bool,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Quantity<N> {
    let what = format!("`{}`", given.name);
    let mut found = Quantity::default();
    match &given.value {
        None => {}
        Some(Given::Quantity(quantity)) if is_vector => {
            let numbers = values(quantity, Some(dimension), &what, diagnostics);
            found.value = numbers.and_then(|numbers| {
                metres(quantity, &numbers, largest, diagnostics);
                let vector = numbers.try_into().ok();
                if vector.is_none() {
                    error!(diagnostics, WRONG_SHAPE, quantity.location; "{what} must be a vector, found one number";
                        "write `(x, y, z)`");
                }
                vector
            });
        }
        Some(Given::Quantity(quantity)) => {
            let number = scalar(quantity, Some(dimension), &what, diagnostics);
            found.value = number.map(|number| {
                metres(quantity, &[number], largest, diagnostics);
                [number; N]
            });
        }
        Some(Given::Formula(expression)) => {
            found.formula = derived(given, expression, dimension, is_vector, scope, diagnostics);
            if let Some(tolerance) = &given.tolerance {
                error!(diagnostics, CERTAINTY, tolerance.location;
                    "{what} is a formula, which has no tolerance of its own";
                    "give the parameters that it reads their tolerances");
            }
            return found;
        }
    }
    let bounds = SMALLEST_DEVIATION..=WIDE * largest;
    found.tolerance = given
        .tolerance
        .as_ref()
        .and_then(|given| tolerance(given, Some(dimension), &what, &bounds, diagnostics));
    if let Some(exact) = given.exact {
        if given.tolerance.is_some() {
            error!(diagnostics, CERTAINTY, exact; "{what} is exact and has a tolerance"; "leave out one of them");
        }
        found.formula = found.value.take().map(|value| {
            let numbers = value.map(Formula::Number);
            match <[Formula; 3]>::try_from(numbers.to_vec()) {
                Ok(components) => Formula::Vector(Box::new(components)),
                Err(numbers) => numbers.into_iter().next().unwrap_or(Formula::Number(0.0)),
            }
        });
    }
    found
}

/// A value that is a formula.
fn derived(
    given: &syntax::NamedValue,
    expression: &Expression,
    expected: Dimension,
    is_vector: bool,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Formula> {
    let what = format!("`{}`", given.name);
    let mut names = names_of(expression).into_iter();
    let reads = names.any(|name| is_variable(name) || scope.parameter(name).is_some());
    match given.exact {
        Some(exact) if reads => {
            error!(diagnostics, CERTAINTY, exact; "{what} is exact, but its formula reads names";
                "`exact` marks constants: mark the parameters that it reads");
        }
        None if !reads => {
            error!(diagnostics, CONSTANT_FORMULA, expression.location; "{what} is a formula without parameters";
                "write `exact` behind it, or a number with its unit and tolerance");
        }
        _ => {}
    }
    let checked = formula(expression, scope, diagnostics)?;
    if is_vector != matches!(checked.shape, Shape::Vector(_)) {
        let (wanted, found, help) = if is_vector {
            ("vector", "scalar", "write `(x, y, z)`")
        } else {
            ("scalar", "vector", "its length is `norm(…)`")
        };
        error!(diagnostics, WRONG_SHAPE, expression.location; "{what} is a {wanted}, but this formula is a {found}";
            "{help}");
        return None;
    }
    let found = checked.dimension?;
    if found != expected {
        let by_angles = found.divide(expected).is_some_and(|factor| {
            factor.angle != 0 && (Dimension { angle: 0, ..factor }) == Dimension::NUMBER
        });
        let help = if by_angles {
            "give the radius of a drum in `m/rad`, or divide angles by `1 rad`".to_owned()
        } else {
            unit_help(expected)
        };
        error!(diagnostics, WRONG_DIMENSION, expression.location;
            "{what} is {}, but this formula is {}", expected.describe(), found.describe(); "{help}");
        return None;
    }
    Some(checked.shape.into_formula())
}

/// The length of a driven link is a formula that reads its command; a plain one is that at command 0.
fn driven(
    given: &syntax::NamedValue,
    found: Quantity<1>,
    of: OfLink,
    diagnostics: &mut Diagnostics,
) -> Quantity<1> {
    let Some(by_angle) = of.driven_by_angle.filter(|_| !of.is_drive_refused()) else {
        return found;
    };
    let command = || Formula::Read(Readable::Command);
    match (&found.formula, given.exact) {
        (Some(formula), Some(_)) if !by_angle => Quantity {
            formula: Some(formula.clone() + command()),
            ..found
        },
        (Some(formula), _) if formula.quantities().next().is_none() => {
            error!(diagnostics, COMMAND_UNREAD, &given.name; "the length of a driven link does not read its command";
                "add it: `… + q`, or leave out `actuated`");
            found
        }
        (None, _) if by_angle && matches!(given.value, Some(Given::Quantity(_))) => {
            error!(diagnostics, COMMAND_UNREAD, &given.name; "a length that an angle drives is a formula of it";
                "write it with the command: `length = zero + radius * q;`, with `param radius: m/rad;`");
            found
        }
        _ => found,
    }
}

fn positive(given: &syntax::NamedValue, found: &Quantity<1>, diagnostics: &mut Diagnostics) {
    let constant = found.formula.as_ref().and_then(Formula::constant);
    let value = found.value.map(|[value]| value).or(constant);
    let location = match &given.value {
        Some(Given::Quantity(quantity)) => quantity.location,
        Some(Given::Formula(expression)) => expression.location,
        None => return,
    };
    if let Some(length) = value.filter(|length| *length <= 0.0) {
        error!(diagnostics, NOT_POSITIVE, location; "`length` must be greater than zero, found {length} m";
            "write the distance of the two joints");
    }
}

/// Reports values that read each other in a circle.
fn circle(
    waiting: &[Value],
    given: &BTreeMap<Value, &syntax::NamedValue>,
    diagnostics: &mut Diagnostics,
) {
    let Some((first, one)) = waiting
        .first()
        .and_then(|first| Some((first, given.get(first)?)))
    else {
        return;
    };
    let names: Vec<String> = waiting
        .iter()
        .map(|value| format!("`{}`", value.name()))
        .collect();
    error!(diagnostics, VALUES_IN_CIRCLE, &one.name;
        "the formulas of {} read each other in a circle", names.join(" and ");
        "write `{}` without the others", first.name());
}

/// Values of the link that a value reads.
fn read_values(given: &syntax::NamedValue, scope: &Scope<'_>) -> Vec<Value> {
    match &given.value {
        Some(Given::Formula(expression)) => names_of(expression)
            .into_iter()
            .filter(|name| scope.parameter(name).is_none())
            .filter_map(|name| Value::find(&name.to_string()))
            .collect(),
        _ => Vec::new(),
    }
}

/// True for a name that is neither a unit nor a constant.
fn is_variable(name: &Ident) -> bool {
    name != "pi" && find_unit(&name.to_string()).is_none()
}

/// Names that a formula holds, without those of functions and units behind numbers.
pub(super) fn names_of(expression: &Expression) -> Vec<&Ident> {
    let mut names = Vec::new();
    let mut ahead = vec![expression];
    while let Some(next) = ahead.pop() {
        match &next.kind {
            ExpressionKind::Number(_) | ExpressionKind::Measure(..) => {}
            ExpressionKind::Name(name) | ExpressionKind::Component(name, _) => names.push(name),
            ExpressionKind::Call(_, parts) | ExpressionKind::Tuple(parts) => ahead.extend(parts),
            ExpressionKind::Negate(inner) | ExpressionKind::Power(inner, _) => ahead.push(inner),
            ExpressionKind::Binary(_, left, right) => ahead.extend([&**left, &**right]),
        }
    }
    names
}
