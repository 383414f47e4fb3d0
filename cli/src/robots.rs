//! `tau robots`.

use std::fmt::Write;

use tau::Robot;

use super::deliver::Outcome;

pub(super) fn run() -> Outcome {
    let width = tau_generated::ROBOTS.iter().map(|(name, _)| name.len());
    let width = width.max().unwrap_or(0);
    let mut summary = String::new();
    for (name, robot) in tau_generated::ROBOTS {
        let robot = Robot::from(robot);
        let docs = robot.model.as_ref().map_or(&[][..], |model| &model.docs);
        let about = docs.first().map_or("", String::as_str);
        let commands = robot.command_columns().join(", ");
        // Writing into a string can't fail.
        let _ = writeln!(summary, "{name:width$}  {about}\n{:width$}  {commands}", "");
    }
    Outcome {
        summary,
        ..Outcome::default()
    }
}
