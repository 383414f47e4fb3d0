//! Robots that tests share.

use std::fs;

use tau::Robot;
use tau::measurements::Folder;
use tau::robot_file::RobotFile;
use tau::simulation::{Measure, Poses, Simulation, TrackPoints};

use crate::{ROBOTS, Table};

/// The variants of the Gantry-Tau in the paper.
pub const GANTRY_VARIANTS: [&str; 5] = [
    "Nominal",
    "Piecewise",
    "Full",
    "FullPiecewise",
    "BestPerLink",
];

/// The standard Gantry-Tau, with its generated code.
pub fn gantry_tau() -> Robot {
    Robot::from(&tau_generated::gantry_tau::ROBOT)
}

/// The measurements that ship, and the robot file with them.
///
/// # Panics
/// They can't be read.
pub fn prototype() -> (Folder, RobotFile) {
    (
        tau::prototype::folder().unwrap(),
        tau::prototype::robot_file().unwrap(),
    )
}

/// The prototype's robot file with Table II of the paper, model 3: every link with its own direction.
///
/// # Panics
/// The table can't be read.
pub fn paper_file() -> RobotFile {
    let (_, mut file) = prototype();
    let table = Table::parse(include_str!("../../equations/reference/table2_linear.csv"));
    for row in table.rows.iter().filter(|row| row[0] == "3") {
        let numbers: Vec<f64> = row[2..12].iter().map(|own| own.parse().unwrap()).collect();
        let link = file.links.get_mut(&format!("l{}", row[1])).unwrap();
        let slots = [
            (&mut link.length, 0..1),
            (&mut link.plate_joint, 1..4),
            (&mut link.track_offset, 4..7),
            (&mut link.track_direction, 7..10),
        ];
        for (slot, place) in slots {
            slot.as_mut().unwrap().value = numbers[place].to_vec();
        }
    }
    file
}

/// The description of a robot in `tests/robots`.
///
/// # Panics
/// There is none.
#[track_caller]
pub fn text(name: &str) -> String {
    fs::read_to_string(format!("{ROBOTS}/{name}.tau")).unwrap()
}

/// A robot that stands in `tests/robots`, or a standard one, by its name.
///
/// # Panics
/// There is none.
#[track_caller]
pub fn named(name: &str) -> Robot {
    match tau_generated::ROBOTS.iter().find(|(own, _)| *own == name) {
        Some((_, robot)) => Robot::from(*robot),
        None => described(&text(name)),
    }
}

/// A robot by its description.
///
/// # Panics
/// The description has a mistake.
#[track_caller]
pub fn described(description: &str) -> Robot {
    Robot::from_text(description).unwrap()
}

/// A description with more effects and variants.
///
/// # Panics
/// It has no end.
#[track_caller]
pub fn extended(description: &str, lines: &str) -> String {
    let body = description.trim_end().strip_suffix('}').unwrap();
    format!("{body}{lines}\n}}\n")
}

/// A robot in `tests/robots` with the values of its description, the noise of a tracker, and more of the robot file.
///
/// # Panics
/// There is none, or the robot file has a mistake.
#[track_caller]
pub fn drawn(name: &str, more: &str) -> (Robot, RobotFile) {
    let robot = named(name);
    let noise = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    let text = format!("robot = \"{}\"\n{noise}{more}", robot.name);
    let file = RobotFile::parse_for(&text, "robot.toml", &robot).unwrap();
    let file = file.completed(&robot);
    (robot, file)
}

/// Poses at random at which some measurements are made, without sets 2 and 3.
pub fn measured_at_random(
    robot: &Robot,
    file: &RobotFile,
    variant: &str,
    measures: &[Measure],
    poses: usize,
) -> Simulation {
    Simulation {
        variant: Some(variant.to_owned()),
        poses: Poses::Random { count: poses },
        measures: measures.to_vec(),
        track_points: TrackPoints {
            count: 0,
            ..TrackPoints::default()
        },
        random_poses: 0,
        ..Simulation::new(robot.clone(), file.clone())
    }
}

/// A plate in a plane that four cables hold.
pub const CABLES: &str = "robot Cables {
    plate body in plane;
    cluster cables on base {
        link a actuated length { length = 1 m tol 5 mm; track_offset = (1, 0.8, 0) m tol 5 mm; plate_joint = (0.1, -0.05, 0) m tol 0.5 mm; }
        link b actuated length { length = 1 m tol 5 mm; track_offset = (-1, 0.8, 0) m tol 5 mm; plate_joint = (-0.1, -0.05, 0) m tol 0.5 mm; }
        link c actuated length { length = 1 m tol 5 mm; track_offset = (-1, -0.8, 0) m tol 5 mm; plate_joint = (-0.1, 0.05, 0) m tol 0.5 mm; }
        link d actuated length { length = 1 m tol 5 mm; track_offset = (1, -0.8, 0) m tol 5 mm; plate_joint = (0.1, 0.05, 0) m tol 0.5 mm; }
    }
    reference { commands = (0.2379, 0.2379, 0.2379, 0.2379) m; position = (0, 0, 0) m; }
    variant Full { arm full; }
}";
