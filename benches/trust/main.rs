//! Counts of verdicts on virtual machines: mistakes that are named rightly, and clean folders that are consistent.

mod rows;
#[path = "../support/mod.rs"]
mod support;

use clap::Parser;
use nalgebra::Matrix3;
use tau::Setup;
use tau::simulation::{Noise, Simulation, simulate};
use tau_estimation::calibration::{self, Error, calibrate};
use tau_estimation::trust::{Mistake, Status, Verdict, mistakes, of_calibration, of_prediction};
use tau_estimation::weighing::Treatment;
use tau_kinematics::{Pose, zyz};
use tau_robot::measurements::{Folder, Poses, Split};
use tau_robot::robot::Robot;
use tau_robot::robot_file::{LinkValues, RobotFile, Value};

/// Verdicts on virtual machines of which the truth is known.
#[derive(Debug, Parser)]
struct Arguments {
    /// Machines of each robot, for each mistake.
    #[arg(long, default_value_t = 20)]
    machines: u64,
    /// Clean folders of each robot.
    #[arg(long, default_value_t = 100)]
    clean: u64,
    /// Machines of each robot whose poses are not measured, for each mistake and for none.
    #[arg(long, default_value_t = 3)]
    rows: u64,
    /// Share of the poses that are outliers where something is wrong.
    #[arg(long, default_value_t = 0.0)]
    outliers: f64,
    /// All that is said of mistakes, not only where none is named rightly.
    #[arg(long)]
    texts: bool,
    /// An argument that `cargo bench` adds.
    #[arg(long, hide = true)]
    bench: bool,
}

fn simulated(robot: &Robot, file: &RobotFile, seed: u64, outliers: f64) -> Folder {
    let simulation = Simulation {
        seed,
        random_poses: 0,
        noise: Noise {
            outliers,
            ..Noise::default()
        },
        ..Simulation::new(robot.clone(), file.clone())
    };
    simulate(&simulation).unwrap().folder
}

/// Something done wrong, the kind that it should be recognised as, and a word of what is said of it.
type Wrong = (
    &'static str,
    &'static str,
    &'static str,
    fn(&mut Folder, &mut RobotFile),
);

fn exchange(folder: &mut Folder, one: usize, other: usize) {
    for pose in &mut folder.tcp_poses {
        pose.commands_m.swap(one, other);
        if let Some(directions) = &mut pose.directions {
            directions.swap(one, other);
        }
    }
}

/// Angles a, b, c of Rz(a)·Ry(b)·Rx(c).
fn zyx([a, b, c]: [f64; 3]) -> Matrix3<f64> {
    tau_kinematics::xyz([c, b, a]).into_inner()
}

fn each_value(file: &mut RobotFile, change: impl Fn(&mut Value, bool)) {
    for values in file.links.values_mut() {
        let LinkValues {
            length,
            plate_joint,
            track_offset,
            track_direction,
            ..
        } = values;
        for value in [length, plate_joint, track_offset].into_iter().flatten() {
            change(value, true);
        }
        for value in track_direction.iter_mut() {
            change(value, false);
        }
    }
}

fn first_length(file: &mut RobotFile, tolerances: f64) {
    let length = file.links.values_mut().next().unwrap().length.as_mut();
    let length = length.unwrap();
    length.value[0] += tolerances * length.tol;
}

const WRONG: [Wrong; 11] = [
    ("q1 and q2", "commands", "`q1_m` and `q2_m`", |f, _| {
        exchange(f, 0, 1);
    }),
    ("q2 and q3", "commands", "`q2_m` and `q3_m`", |f, _| {
        exchange(f, 1, 2);
    }),
    ("z mirrored", "axes", "the z axis", |f, _| {
        f.tcp_poses
            .iter_mut()
            .for_each(|pose| pose.position_m[2] *= -1.0);
    }),
    ("ZYX angles", "angles", "", |f, _| {
        for pose in &mut f.tcp_poses {
            let r = zyz(pose.angles_rad);
            let (c, b, a) = r.euler_angles();
            assert!((zyx([a, b, c]) - r.matrix()).norm() < 1e-9);
            pose.angles_rad = [a, b, c];
        }
    }),
    ("transposed", "angles", "", |f, _| {
        for pose in &mut f.tcp_poses {
            let r = Pose::from(&*pose).rotation;
            let inverse = Pose {
                position: pose.position_m.into(),
                rotation: r.inverse(),
            };
            pose.angles_rad = inverse.angles_rad();
        }
    }),
    ("noise in mm", "noise", "`position_m`", |_, file| {
        file.noise.position_m *= 1e3;
    }),
    ("tolerances in mm", "tolerances", "too large", |_, file| {
        each_value(file, |value, is_length| {
            if is_length {
                value.tol *= 1e3;
            }
        });
    }),
    ("tolerances / 1000", "tolerances", "too small", |_, file| {
        each_value(file, |value, _| value.tol /= 1e3);
    }),
    ("10 tolerances", "dimension", ".length`", |_, file| {
        first_length(file, 10.0);
    }),
    ("100 tolerances", "dimension", ".length`", |_, file| {
        first_length(file, 100.0);
    }),
    ("3.6 m", "dimension", ".track_offset.x`", |_, file| {
        let link = file.links.values_mut().nth(1).unwrap();
        link.track_offset.as_mut().unwrap().value[0] += 3.6;
    }),
];

/// The answer of `tau calibrate`: the verdict, or the mistakes for which there is no fit.
fn judged(
    robot: &Robot,
    file: &RobotFile,
    folder: &Folder,
) -> Result<Verdict, Box<(Error, Vec<Mistake>)>> {
    let variant = robot.variant("Full").unwrap();
    let poses = Poses::select(robot, file, folder, Split::Alternate).unwrap();
    let poses = &poses.division.calibration;
    let options = calibration::Options::default();
    let verdict = calibrate(Setup::new(robot, variant, file, folder), poses, &options)
        .and_then(|calibration| of_calibration(&calibration, file, folder, poses, None));
    verdict.map_err(|error| {
        let found = mistakes(Setup::new(robot, variant, file, folder), poses);
        Box::new((error, found.unwrap_or_default()))
    })
}

/// True if a mistake is named, and the sentences that name it.
fn is_named(robot: &Robot, clean: (&Folder, &RobotFile), wrong: &Wrong) -> (bool, String) {
    let (mut folder, mut file) = (clean.0.clone(), clean.1.clone());
    wrong.3(&mut folder, &mut file);
    let (found, said) = match judged(robot, &file, &folder) {
        Ok(verdict) => (verdict.mistakes.clone(), verdict.line()),
        Err(failed) => {
            let (error, found) = *failed;
            let said = format!("{error}: {found:?}");
            (found, said)
        }
    };
    let is_right =
        |mistake: &Mistake| mistake.kind.name() == wrong.1 && mistake.what.contains(wrong.2);
    (found.first().is_some_and(is_right), said)
}

fn main() {
    let arguments = Arguments::parse();
    println!("| robot | mistake | named rightly |\n| --- | --- | --- |");
    for (name, robot, file) in support::robots() {
        for wrong in &WRONG {
            let is_right = |seed: &u64| {
                let folder = simulated(&robot, &file, 7000 + seed, arguments.outliers);
                let (is_named, said) = is_named(&robot, (&folder, &file), wrong);
                if arguments.texts || !is_named {
                    eprintln!("{name}, {}, {seed}: {said}", wrong.0);
                }
                is_named
            };
            let right = (0..arguments.machines).filter(is_right).count();
            println!(
                "| {name} | {} | {right} of {} |",
                wrong.0, arguments.machines
            );
        }
    }
    println!("\n| robot | clean folders | consistent | inconsistent | absurd | mean χ²/dof |");
    println!("| --- | --- | --- | --- | --- | --- |");
    for (name, robot, file) in support::robots() {
        let (mut calibrated, mut predicted) = (Counts::default(), Counts::default());
        for seed in 0..arguments.clean {
            let folder = simulated(&robot, &file, 9000 + seed, 0.0);
            let variant = robot.variant("Full").unwrap();
            let poses = Poses::select(&robot, &file, &folder, Split::Alternate).unwrap();
            let division = poses.division;
            let (poses, options) = (&division.calibration, calibration::Options::default());
            let found =
                calibrate(Setup::new(&robot, variant, &file, &folder), poses, &options).unwrap();
            calibrated.add(&of_calibration(&found, &file, &folder, poses, None).unwrap());
            let after = of_prediction(
                &found.machine,
                &found.file,
                &folder,
                &division,
                Treatment::default(),
            );
            predicted.add(&after.unwrap());
        }
        calibrated.print(name, "calibrated");
        predicted.print(name, "evaluated");
    }
    rows::print(arguments.rows);
}

/// Verdicts by status, and the sum of χ² over its degrees of freedom.
#[derive(Default)]
struct Counts {
    by_status: [u32; 3],
    ratios: f64,
}

impl Counts {
    fn add(&mut self, verdict: &Verdict) {
        let place = match verdict.status {
            Status::Consistent => 0,
            Status::Inconsistent => 1,
            Status::Absurd => 2,
        };
        self.by_status[place] += 1;
        self.ratios += verdict.chi2 / verdict.dof;
    }

    fn print(&self, robot: &str, done: &str) {
        let [consistent, inconsistent, absurd] = self.by_status;
        let ratio = self.ratios / f64::from(consistent + inconsistent + absurd);
        println!("| {robot} | {done} | {consistent} | {inconsistent} | {absurd} | {ratio:.4} |");
    }
}
