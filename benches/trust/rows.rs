//! Mistakes in rows of machines whose poses are not measured, as `tau check` recognises them.

use tau::Setup;
use tau::measurements::PlateKind;
use tau::simulation::{Measure, Simulation, simulate};
use tau::unknown_poses::{RowDivision, mistakes};
use tau_robot::measurements::{Folder, Split};
use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;

const POSITIONS: &[Measure] = &[Measure::Rows(PlateKind::Position)];
const LENGTHS: &[Measure] = &[Measure::Rows(PlateKind::Height), Measure::Distances];

/// Robots by the name of their module, with what is measured.
const CASES: [(&str, &[Measure]); 7] = [
    ("gantry_tau", POSITIONS),
    ("linear_delta", POSITIONS),
    ("rotary_delta", POSITIONS),
    ("hexapod", POSITIONS),
    ("five_bar", POSITIONS),
    ("linear_delta", LENGTHS),
    ("hexapod", LENGTHS),
];

/// Something done wrong, the kind that it should be recognised as (`None`: nothing is wrong), and what it does.
type Wrong = (
    &'static str,
    Option<&'static str>,
    fn(&mut Folder, &mut RobotFile),
);

const WRONG: [Wrong; 7] = [
    ("q1 and q2 exchanged", Some("commands"), |folder, _| {
        each_command(folder, |commands| commands.swap(0, 1));
    }),
    ("q1 the other way", Some("command_sign"), |folder, _| {
        each_command(folder, |commands| commands[0] *= -1.0);
    }),
    ("y mirrored", Some("axes"), |folder, _| {
        let rows = folder.plate_rows.iter_mut();
        for row in rows.filter(|row| row.kind == PlateKind::Position) {
            row.values[1] = row.values[1].map(|y| -y);
        }
    }),
    ("frame of a tracker", Some("frame"), |folder, _| {
        let (sine, cosine) = 0.5_f64.sin_cos();
        let rows = folder.plate_rows.iter_mut();
        for row in rows.filter(|row| row.kind == PlateKind::Position) {
            if let [Some(x), Some(y), _] = row.values {
                row.values[0] = Some(cosine * x - sine * y + 1.5);
                row.values[1] = Some(sine * x + cosine * y - 0.7);
            }
        }
    }),
    ("noise in mm", Some("noise"), |_, file| {
        scale_noise(file, 1e3);
    }),
    ("noise / 1000", Some("noise"), |_, file| {
        scale_noise(file, 1e-3);
    }),
    ("nothing", None, |_, _| {}),
];

fn each_command(folder: &mut Folder, change: impl Fn(&mut [f64])) {
    for row in &mut folder.plate_rows {
        change(&mut row.commands_m);
    }
}

fn scale_noise(file: &mut RobotFile, factor: f64) {
    file.noise.position_m *= factor;
    file.noise.rotation_rad *= factor;
}

/// Counts of machines of which the mistake alone is named.
pub(crate) fn print(machines: u64) {
    println!("\n| robot | measured | mistake | named alone |\n| --- | --- | --- | --- |");
    let robots: Vec<Robot> = (tau_generated::ROBOTS.iter())
        .map(|(_, robot)| Robot::from(*robot))
        .collect();
    for (name, measures) in CASES {
        let place = (tau_generated::ROBOTS.iter()).position(|(known, _)| *known == name);
        let robot = &robots[place.unwrap()];
        // The one description that has no values of its own.
        let file = if name == "gantry_tau" {
            tau_robot::prototype::robot_file().unwrap()
        } else {
            super::support::tracked(name, robot.clone()).2
        };
        let has_positions = measures == POSITIONS;
        for (what, kind, change) in WRONG {
            if [Some("axes"), Some("frame")].contains(&kind) && !has_positions {
                continue;
            }
            let is_right = |seed: &u64| {
                let simulation = Simulation {
                    seed: 5000 + seed,
                    random_poses: 0,
                    measures: measures.to_vec(),
                    ..Simulation::new(robot.clone(), file.clone())
                };
                let (mut folder, mut file) = (simulate(&simulation).unwrap().folder, file.clone());
                change(&mut folder, &mut file);
                let division = RowDivision::of(&folder, Split::Alternate);
                let variant = robot.variant("Full").unwrap();
                let found = mistakes(Setup::new(robot, variant, &file, &folder), &division)
                    .unwrap_or_default();
                let kinds: Vec<&str> = found.iter().map(|mistake| mistake.kind.name()).collect();
                let is_right = kinds == Vec::from_iter(kind);
                if !is_right {
                    eprintln!("{name}, {what}, {seed}: {found:?}");
                }
                is_right
            };
            let right = (0..machines).filter(is_right).count();
            let measured = if has_positions {
                "positions"
            } else {
                "heights, distances"
            };
            println!("| {name} | {measured} | {what} | {right} of {machines} |");
        }
    }
}
