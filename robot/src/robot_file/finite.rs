//! Formulas of a description that have no value at the numbers of a `robot.toml`.

use tau_codegen::language::model::{Formula, Model, Value};
use tau_codes::files;
use toml::de::DeTable;

use super::keys::key_place;
use super::{Dimensions, RobotFile};
use crate::input_error::{Mistakes, quoted};
use crate::robot::Robot;

/// Reports the first value of a link that is no finite number: no machine has it, whatever was measured, so that no row is
/// to blame. Lengths that read the command are looked at where the machine stands at its reference.
pub(super) fn values(
    mistakes: &mut Mistakes<'_>,
    root: &DeTable<'_>,
    file: &RobotFile,
    robot: &Robot,
) {
    let dimensions = Dimensions::new(robot, file);
    let reference = file.completed(robot).reference;
    let commands = reference.map_or_else(Vec::new, |own| own.commands_m);
    let numbers = |link: usize, value: Value| match value {
        Value::Length => dimensions.length_m(link, &commands).map(|own| vec![own]),
        _ => dimensions.vector(link, value).map(|own| own.to_vec()),
    };
    for (link, own) in robot.model.links.iter().enumerate() {
        for value in Value::ALL {
            let Some(formula) = own.defaults.formula(value) else {
                continue;
            };
            let components = match formula {
                Formula::Vector(components) => &components[..],
                scalar => std::slice::from_ref(scalar),
            };
            let found = numbers(link, value).unwrap_or_default();
            let wrong = components.iter().zip(&found);
            let Some((wrong, _)) = { wrong }.find(|(_, number)| !number.is_finite()) else {
                continue;
            };
            let mut read = Vec::new();
            parameters(wrong, &robot.model, link, &mut read);
            mistake!(mistakes, files::FORMULA_VALUE, key_place(root, "parameters");
                "`{}` of link `{}` is not a finite number at the values of {}", value.name(), own.name, quoted(read);
                "compare them with the drawing, in metres and radians: the root of a negative number or a division by \
                 zero has no value");
            return;
        }
    }
}

/// Names of the parameters that a formula of a link reads, also by other values of the link, from the left.
fn parameters<'m>(formula: &Formula, model: &'m Model, link: usize, names: &mut Vec<&'m str>) {
    for part in formula.parts() {
        match *part {
            Formula::OfRobot(index, _) => {
                let parameter = model.parameters.get(index);
                let name = parameter.map(|own| own.name.as_str());
                names.extend(name.filter(|name| !names.contains(name)));
            }
            Formula::OfLink(value, _) => {
                let other = model
                    .links
                    .get(link)
                    .and_then(|own| own.defaults.formula(value));
                if let Some(other) = other {
                    parameters(other, model, link, names);
                }
            }
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use tau_codes::Code;

    use super::*;

    /// Code, line and column of the first error of a file of a linear delta with these parameters, and its message.
    fn found(parameters: &str) -> Option<((Code, usize, usize), String)> {
        let robot = Robot::from(&tau_generated::linear_delta::ROBOT);
        let text = format!(
            "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[parameters]\n{parameters}\n"
        );
        let error = RobotFile::parse_for(&text, "robot.toml", &robot).err()?;
        let problem = &error.problems()[0];
        let place = problem.place.as_ref()?;
        let at = (problem.code, place.line, place.column);
        Some((at, problem.message.clone()))
    }

    #[test]
    fn millimetres_are_told_at_their_line() {
        let (at, _) = found("radius = { value = 140, tol = 1e-3 }").unwrap();
        assert_eq!(at, (files::NOT_METRES, 6, 20));
    }

    #[test]
    fn parameters_of_a_formula_without_a_value_are_named() {
        assert_eq!(found("radius = { value = 0.15, tol = 1e-3 }"), None);
        let (at, message) = found("radius = { value = 14, tol = 1e-3 }").unwrap();
        assert_eq!(at, (files::FORMULA_VALUE, 5, 2));
        for name in ["track_offset", "rods_a", "endstop_a", "arm_a", "radius"] {
            assert!(message.contains(&format!("`{name}`")), "{message}");
        }
    }
}
