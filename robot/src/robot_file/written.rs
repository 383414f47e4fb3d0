//! A reference as texts write it.

use super::Reference;
use crate::robot::Robot;

/// Tenths of a millimetre and of a milliradian, of which a reference needs none.
const STEPS: f64 = 1e4;

/// A number of a reference, without a negative zero.
pub(super) fn rounded(number: f64) -> String {
    ((number * STEPS).round() / STEPS + 0.0).to_string()
}

/// `reference { … }` of a description.
pub(super) fn in_description(
    robot: &Robot,
    commands: &[String],
    position: &[String],
    angles: &[String],
) -> String {
    let unit = |command: usize| if robot.is_angle(command) { "rad" } else { "m" };
    let units: Vec<&str> = (0..robot.commands).map(unit).collect();
    let commands = match units.as_slice() {
        [first, more @ ..] if more.iter().all(|other| other == first) => {
            format!("({}) {first}", commands.join(", "))
        }
        _ => {
            let each = commands.iter().zip(&units);
            let each: Vec<String> = each
                .map(|(number, unit)| format!("{number} {unit}"))
                .collect();
            format!("({})", each.join(", "))
        }
    };
    let angles = if robot.plate.turning_axes().is_empty() {
        String::new()
    } else {
        format!(" orientation = ({}) rad;", angles.join(", "))
    };
    let position = position.join(", ");
    format!("reference {{ commands = {commands}; position = ({position}) m;{angles} }}")
}

/// `[reference]` of a robot file with its keys, in words.
pub(super) fn in_robot_file(
    robot: &Robot,
    commands: &[String],
    position: &[String],
    angles: &[String],
) -> String {
    let has_angles = (0..robot.commands).any(|command| robot.is_angle(command));
    let key = Reference::key_of(has_angles);
    let (commands, position) = (commands.join(", "), position.join(", "));
    if robot.plate.turning_axes().is_empty() {
        return format!(
            "`[reference]` with `{key} = [{commands}]` and `position_m = [{position}]`"
        );
    }
    let angles = angles.join(", ");
    format!(
        "`[reference]` with `{key} = [{commands}]`, `position_m = [{position}]` and `orientation_rad = [{angles}]`"
    )
}
