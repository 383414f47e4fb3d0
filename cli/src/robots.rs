//! `tau robots`.

use tau::Robot;
use tau::measurements::PlateKind;
use tau::simulation::Measure;
use tau_report as report;
use tau_robot::measurements::Shape;

use super::deliver::Outcome;

/// The standard robots, in lines of so many characters.
pub(super) fn run(columns: usize) -> Outcome {
    let width = tau_generated::ROBOTS.iter().map(|(name, _)| name.len());
    let width = width.max().unwrap_or(0);
    let mut summary = String::new();
    for (name, robot) in tau_generated::ROBOTS {
        let robot = Robot::from(robot);
        let docs = &robot.model.docs;
        let about = docs.first().map_or("", String::as_str);
        let commands = robot.command_columns().join(", ");
        let measured = measured_by(&robot).join(", ");
        let indent = " ".repeat(width + 2);
        let said = [about, &commands, &format!("measured by {measured}")]
            .map(|own| report::terminal::sentence_within(&indent, own, columns))
            .concat();
        // The name stands in front of the first line.
        summary += name;
        summary += said.get(name.len()..).unwrap_or_default();
    }
    Outcome {
        summary,
        ..Outcome::default()
    }
}

/// Measurements that tell something of a robot, as `--measure` calls them, and carts: drives alone do where they are more
/// than freedoms, heights where the plate leaves a plane, carts where there are tracks.
fn measured_by(robot: &Robot) -> Vec<&'static str> {
    let leaves_plane = robot.plate.freedoms().contains(&2);
    let is_told = |measure: Measure| match measure {
        Measure::Rows(PlateKind::Reading) => robot.is_redundant(),
        Measure::Rows(PlateKind::Height) => leaves_plane,
        _ => true,
    };
    let of_plate = Measure::ALL
        .into_iter()
        .filter(|(_, measure)| is_told(*measure));
    let of_carts = Shape::from(robot).has_carts().then_some("carts");
    of_plate.map(|(name, _)| name).chain(of_carts).collect()
}
