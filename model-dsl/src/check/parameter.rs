//! Parameters of the whole machine.

use std::collections::BTreeSet;
use std::f64::consts::PI;

use super::declared::Declared;
use super::geometry::names_of;
use super::quantity::{angles, degrees_help, dimension, tolerance, values};
use super::scope::{Home, Scope, ValueHome};
use super::vocabulary::meaning;
use crate::diagnostics::Diagnostics;
use crate::model::{EffectParameter, Formula, RobotParameter, Value};
use crate::plausible::SMALLEST_OF_PARAMETER;
use crate::syntax::{self, Given};
use crate::units::Dimension;

/// The parameters of a robot, and the scope of formulas that may read them.
pub(super) fn parameters<'a>(
    robot: &'a syntax::Robot,
    names: &mut Declared,
    diagnostics: &mut Diagnostics,
) -> (Vec<RobotParameter>, Scope<'a>) {
    let home = ValueHome {
        what: "",
        command: None,
        others: Vec::new(),
    };
    let mut scope = Scope::new(Home::Value(home), &[]);
    let mut parameters = Vec::new();
    let wound = wound(robot);
    for declaration in &robot.parameters {
        let known = dimension(&declaration.dimension, diagnostics);
        for given in &declaration.names {
            let name = given.name.to_string();
            let mut is_sound = names.declare(&given.name, "parameter", diagnostics);
            let taken = meaning(&name).or_else(|| Value::find(&name).map(|_| "a value of links"));
            if let Some(meaning) = taken {
                error!(diagnostics, NAME_WITH_MEANING, &given.name; "`{name}` is {meaning} and cannot be a parameter";
                    "choose another name");
                is_sound = false;
            }
            let components = match given.components {
                None => 1,
                Some((3, _)) => 3,
                Some((number, location)) => {
                    error!(diagnostics, VECTOR_COMPONENTS, location; "a vector has 3 components, found {number}";
                        "write `{name}[3]`, or `{name}` for a scalar");
                    // Its value shows which of the two is meant.
                    let given = declaration.nominal.as_ref();
                    given.map_or(3, |quantity| quantity.numbers.len())
                }
            };
            let of = format!("`{name}`");
            let nominal = declaration.nominal.as_ref().and_then(|quantity| {
                let found = values(quantity, known, &format!("the value of {of}"), diagnostics)?;
                if found.len() == components {
                    return Some(found);
                }
                let (expected, help) = if components == 1 {
                    ("one number", format!("for a vector declare `{name}[3]`"))
                } else {
                    ("three numbers", "write `(x, y, z)`".to_owned())
                };
                error!(diagnostics, WRONG_SHAPE, quantity.location; "{of} must be {expected}, found {}", found.len();
                    "{help}");
                None
            });
            let bounds = SMALLEST_OF_PARAMETER..=f64::INFINITY;
            let tolerance = declaration
                .tolerance
                .as_ref()
                .and_then(|given| tolerance(given, known, &of, &bounds, diagnostics));
            if known == Some(Dimension::ANGLE) && !wound.contains(&name) {
                if let (Some(given), Some(nominal)) = (&declaration.nominal, &nominal) {
                    let describe =
                        |angle: f64| format!("{angle} rad as the value of {of}, an angle");
                    angles(given, nominal, describe, diagnostics);
                }
                if let (Some(given), Some(tolerance)) = (&declaration.tolerance, tolerance)
                    && tolerance > PI
                {
                    error!(diagnostics, ANGLE_OUT_OF_RANGE, given.location;
                        "found a tolerance of {tolerance} rad for {of}, an angle, expected at most pi";
                        "{}", degrees_help(given));
                }
            }
            if let Some(exact) = declaration.exact {
                if declaration.tolerance.is_some() {
                    error!(diagnostics, CERTAINTY, exact; "{of} is exact and has a tolerance"; "leave out one of them");
                } else if declaration.nominal.is_none() {
                    error!(diagnostics, CERTAINTY, exact; "{of} is exact, but has no value";
                        "write it: `param {name}: … = value unit exact;`");
                }
            }
            let leaves = (0..components).map(|component| {
                let constant = nominal.as_ref().and_then(|nominal| nominal.get(component));
                match constant.filter(|_| declaration.exact.is_some()) {
                    Some(&value) => Formula::Number(value),
                    None => Formula::OfRobot(parameters.len(), component),
                }
            });
            let leaves: Vec<Formula> = leaves.collect();
            let mut declared = EffectParameter::amplitude(&name, known.unwrap_or_default());
            declared.components = components;
            scope.declare_as(&given.name, declared, leaves, known.is_some());
            if !is_sound {
                scope.poison(&given.name);
            }
            parameters.push(RobotParameter {
                name,
                components,
                dimension: known.unwrap_or_default(),
                nominal,
                tolerance,
                exact: declaration.exact.is_some(),
            });
        }
    }
    (parameters, scope)
}

/// Names that the lengths of links read which a drum winds up, through other values, too: their angles may be of many
/// turns.
fn wound(robot: &syntax::Robot) -> BTreeSet<String> {
    let mut wound = BTreeSet::new();
    let links = robot.clusters.iter().flat_map(|cluster| &cluster.links);
    for links in links.filter(|links| matches!(links.actuated, Some((true, _)))) {
        let mut read = BTreeSet::new();
        let mut waiting = vec![Value::Length.name().to_owned()];
        while let Some(name) = waiting.pop() {
            let values = links.values.iter().filter(|value| value.name == name);
            for value in values.filter(|_| !read.contains(&name)) {
                if let Some(Given::Formula(formula)) = &value.value {
                    waiting.extend(names_of(formula).into_iter().map(ToString::to_string));
                }
            }
            read.insert(name);
        }
        wound.append(&mut read);
    }
    wound
}

/// Reports parameters that no formula reads.
pub(super) fn unused(scope: &Scope<'_>, diagnostics: &mut Diagnostics) {
    for (name, _) in scope.unused() {
        error!(diagnostics, UNUSED_PARAMETER, name; "parameter `{name}` is used in no formula";
            "use it in a value of a link or a crank, such as `length = …;`, or remove it");
    }
}
