//! Coverage of 95 % intervals on virtual machines: how often the truth lies within 1.96 stated standard deviations, of
//! parameters, and of poses that took no part.

#[path = "support/coverage.rs"]
mod intervals;
mod support;

use std::collections::BTreeMap;

use clap::Parser;
use intervals::Coverage;
use tau::Setup;
use tau::calibration::{Calibration, Options, calibrate};
use tau::simulation::{Machine, Noise, Poses as Planned, Simulation, State, simulate};
use tau_estimation::trust::{Status, of_calibration};
use tau_estimation::uncertainty::Uncertainty;
use tau_estimation::weighing::{Loss, Treatment};
use tau_kinematics::Sample;
use tau_robot::measurements::{Poses, Split, TcpPose};
use tau_robot::robot::{Owner, Parameter, Robot};
use tau_robot::robot_file::RobotFile;

/// Reach of a path about the reference (m).
const REACH_M: f64 = 0.1;
/// Half the width of a 95 % interval, in standard deviations.
const HALF_WIDTH: f64 = 1.96;

/// Coverage of 95 % intervals on virtual machines of which the truth is known.
#[derive(Debug, Parser)]
struct Arguments {
    /// Folders of each robot and case.
    #[arg(long, default_value_t = 200)]
    folders: u64,
    /// Only cases whose name contains this.
    #[arg(long, default_value = "")]
    case: String,
    /// Only robots whose name contains this.
    #[arg(long, default_value = "")]
    robot: String,
    /// Seed of the first folder.
    #[arg(long, default_value_t = 31_000)]
    seed: u64,
    /// Variant that is calibrated.
    #[arg(long, default_value = "Full")]
    variant: String,
    /// An argument that `cargo bench` adds.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A way to measure and to calibrate.
struct Case {
    name: &'static str,
    noise: Noise,
    /// Random poses with so many readings each, or else the prototype's grid.
    visits: Option<(usize, usize)>,
    /// So many rows along a smooth path through the workspace in place of them.
    path: Option<usize>,
    treatment: Treatment,
}

fn cases() -> Vec<Case> {
    let plain = |name, noise| Case {
        name,
        noise,
        visits: None,
        path: None,
        treatment: Treatment::default(),
    };
    let outliers = |outliers| Noise {
        outliers,
        ..Noise::default()
    };
    let under = |name, share, loss| Case {
        treatment: Treatment {
            loss: Some(loss),
            keep_outliers: false,
        },
        ..plain(name, outliers(share))
    };
    let repeated = |name, visit| Case {
        visits: Some((25, 4)),
        ..plain(
            name,
            Noise {
                visit,
                ..Noise::default()
            },
        )
    };
    let serial = |name, serial, path: Option<usize>| Case {
        path,
        visits: Some((120, 1)),
        ..plain(
            name,
            Noise {
                serial,
                ..Noise::default()
            },
        )
    };
    vec![
        serial("serial .5, 120 random poses", 0.5, None),
        serial("serial .9, 120 random poses", 0.9, None),
        serial("serial .97, 120 random poses", 0.97, None),
        serial("serial .5, path of 500 rows", 0.5, Some(500)),
        serial("serial .9, path of 500 rows", 0.9, Some(500)),
        serial("serial .97, path of 500 rows", 0.97, Some(500)),
        serial("serial .5, path of 2000 rows", 0.5, Some(2000)),
        serial("serial .9, path of 2000 rows", 0.9, Some(2000)),
        serial("serial .97, path of 2000 rows", 0.97, Some(2000)),
        plain("clean", Noise::default()),
        plain("1 % of outliers", outliers(0.01)),
        plain("5 % of outliers", outliers(0.05)),
        plain(
            "5 % of outliers of 6 standard deviations",
            Noise {
                outlier_size: 6.0,
                ..outliers(0.05)
            },
        ),
        Case {
            treatment: Treatment {
                loss: None,
                keep_outliers: true,
            },
            ..plain("5 % of outliers, kept", outliers(0.05))
        },
        under("clean, Huber", 0.0, Loss::Huber),
        under("5 % of outliers, Huber", 0.05, Loss::Huber),
        under("5 % of outliers, Cauchy", 0.05, Loss::Cauchy),
        under("5 % of outliers, Tukey", 0.05, Loss::Tukey),
        plain(
            "noise three times the stated",
            Noise {
                scale: [3.0; 3],
                ..Noise::default()
            },
        ),
        repeated("25 poses, four readings", 0.0),
        repeated("25 poses, four readings, half of the variance shared", 0.5),
    ]
}

/// The true value of a parameter, and its kind.
fn truth(machine: &Machine, parameter: &Parameter) -> Option<(&'static str, f64)> {
    let component = parameter.component.unwrap_or(0);
    let rod = match parameter.owner {
        Owner::Link(link) => &machine.rods[link],
        Owner::Robot => {
            let values = machine.parameters.get(&parameter.quantity)?;
            return Some(("machine parameters", *values.get(component)?));
        }
        _ => return None,
    };
    match parameter.quantity.as_str() {
        "length" => Some(("lengths", rod.length_m)),
        "plate_joint" => Some(("plate joints", rod.plate_joint_m[component])),
        "track_offset" => Some(("track origins", rod.track_offset_m[component])),
        "track_direction" => Some(("track directions", rod.track_direction[component])),
        _ => None,
    }
}

#[derive(Default)]
struct Counts {
    /// By kind of parameter, of intervals as stated and widened.
    kinds: BTreeMap<&'static str, [Coverage; 2]>,
    consistent: usize,
    left_out: usize,
    wrongly: usize,
    missed: usize,
}

impl Counts {
    fn add(&mut self, found: &Calibration, machine: &Machine, widening: f64) {
        self.kinds.values_mut().flatten().for_each(Coverage::next);
        for (estimate, &index) in found.parameters.iter().zip(&found.used) {
            let parameter = &found.machine.variant.parameters[index];
            let Some((kind, truth)) = truth(machine, parameter) else {
                continue;
            };
            let off = (estimate.value - truth).abs() / estimate.sigma;
            self.add_one((kind, widening), off);
        }
    }

    /// Counts the errors of poses, as the calibrated machine predicts them; of those outside the region of the calibration
    /// none.
    fn add_poses(
        &mut self,
        (found, known): (&Calibration, &Uncertainty),
        (poses, largest_m): (&[(&TcpPose, &State)], f64),
        widening: f64,
    ) {
        for (measured, truth) in poses {
            let sample = Sample::from(*measured);
            let Ok(pose) = found.machine.forward(&sample) else {
                continue;
            };
            let Ok(sigma) = known.pose(&found.machine, &sample.at(pose)) else {
                continue;
            };
            if sigma.distance_m() > largest_m {
                continue;
            }
            let off = pose.position - truth.pose.position_m;
            let turned = (pose.rotation * truth.pose.rotation.inverse()).scaled_axis();
            let positions = off.iter().zip(sigma.position_m());
            let rotations = turned.iter().zip(sigma.rotation_rad());
            for (kind, errors) in [
                ("predicted positions", positions),
                ("predicted rotations", rotations),
            ] {
                for (off, sigma) in errors.filter(|(_, sigma)| *sigma > 0.0) {
                    self.add_one((kind, widening), off.abs() / sigma);
                }
            }
        }
    }

    fn add_one(&mut self, (kind, widening): (&'static str, f64), off: f64) {
        let [stated, widened] = self.kinds.entry(kind).or_insert_with(|| {
            let mut coverage = Coverage::default();
            coverage.next();
            [coverage.clone(), coverage]
        });
        stated.add(off < HALF_WIDTH);
        widened.add(off < HALF_WIDTH * widening);
    }
}

fn main() {
    let arguments = Arguments::parse();
    println!(
        "| robot | case | coverage by kind, as stated → widened | consistent | outliers listed per folder (none, missed) |"
    );
    println!("| --- | --- | --- | --- | --- |");
    let five_bar = Robot::from(&tau_generated::five_bar::ROBOT);
    let robots = support::robots().into_iter();
    for (name, robot, file) in robots.chain([support::tracked("five bar", five_bar)]) {
        let has_variant = robot.variant(&arguments.variant).is_some();
        if !has_variant || !name.contains(&arguments.robot) {
            continue;
        }
        for case in cases() {
            if !case.name.contains(&arguments.case) {
                continue;
            }
            let counts = counted(&robot, &file, &case, &arguments);
            let by_kind: Vec<String> = (counts.kinds.iter())
                .map(|(kind, [stated, widened])| format!("{kind} {stated} → {widened}"))
                .collect();
            let folders = arguments.folders as f64;
            println!(
                "| {name} | {} | {} | {:.3} | {:.2} ({:.3}, {:.3}) |",
                case.name,
                by_kind.join(", "),
                counts.consistent as f64 / folders,
                counts.left_out as f64 / folders,
                counts.wrongly as f64 / folders,
                counts.missed as f64 / folders,
            );
        }
    }
}

/// Positions (m) about the reference, fifty rows a turn of the slowest coordinate.
fn path(robot: &Robot, file: &RobotFile, rows: usize) -> Vec<[f64; 3]> {
    let file = file.completed(robot);
    let centre_m = file
        .reference
        .as_ref()
        .map_or([0.0; 3], |own| own.position_m);
    let at = |row: usize| {
        let turn = std::f64::consts::TAU * row as f64 / 50.0;
        let along = [
            turn.sin(),
            (1.31 * turn + 1.0).sin(),
            (1.73 * turn + 2.0).sin(),
        ];
        std::array::from_fn(|axis| centre_m[axis] + REACH_M * along[axis])
    };
    (0..rows).map(at).collect()
}

fn counted(robot: &Robot, file: &RobotFile, case: &Case, arguments: &Arguments) -> Counts {
    let mut counts = Counts::default();
    let variant = robot.variant(&arguments.variant).unwrap();
    for seed in 0..arguments.folders {
        let mut simulation = Simulation {
            seed: arguments.seed + seed,
            random_poses: 0,
            noise: case.noise.clone(),
            ..Simulation::new(robot.clone(), file.clone())
        };
        let split = if let Some(rows) = case.path {
            simulation.poses = Planned::Positions(path(robot, file, rows));
            Split::All
        } else if let Some((count, readings)) = case.visits {
            simulation.poses = Planned::Random { count };
            simulation.readings = readings;
            Split::All
        } else {
            Split::Alternate
        };
        let simulated = simulate(&simulation).unwrap();
        let folder = &simulated.folder;
        let poses = Poses::select(robot, file, folder, split).unwrap();
        let (poses, unseen) = (poses.division.calibration, poses.division.validation);
        let options = Options {
            treatment: case.treatment,
            ..Options::default()
        };
        let found = match calibrate(Setup::new(robot, variant, file, folder), &poses, &options) {
            Ok(found) => found,
            Err(error) => {
                eprintln!("{}, {seed}: {error}", case.name);
                continue;
            }
        };
        let verdict = of_calibration(&found, file, folder, &poses, None).unwrap();
        counts.add(&found, &simulated.truth.machine, verdict.widening());
        let known = Uncertainty::of_calibration(&found).unwrap();
        let largest_m = known.largest_m(&found.machine, folder, &poses).unwrap();
        let unseen: Vec<(&TcpPose, &State)> = (unseen.iter())
            .map(|&pose| (&folder.tcp_poses[pose], &simulated.truth.tcp_poses[pose]))
            .collect();
        counts.add_poses((&found, &known), (&unseen, largest_m), verdict.widening());
        counts.consistent += usize::from(verdict.status == Status::Consistent);
        let listed: Vec<u32> = (found.weighing.outliers.iter())
            .map(|outlier| outlier.pose)
            .collect();
        let true_ones: Vec<u32> = (poses.iter())
            .map(|&pose| folder.tcp_poses[pose].pose)
            .filter(|pose| simulated.truth.outliers.contains(pose))
            .collect();
        let is_in = |all: &[u32], pose: &u32| all.contains(pose);
        counts.left_out += listed.len();
        counts.wrongly += listed
            .iter()
            .filter(|pose| !is_in(&true_ones, pose))
            .count();
        let missed = true_ones
            .iter()
            .filter(|pose| !is_in(&listed, pose))
            .count();
        counts.missed += missed;
        if missed > 0 {
            eprintln!("{}, {seed}: of {true_ones:?} found {listed:?}", case.name);
        }
    }
    counts
}
