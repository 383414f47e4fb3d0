//! Mistakes in the folders of virtual machines: each is recognised, and clean folders are consistent.

use nalgebra::Matrix3;
use tau_kinematics::{Pose, zyz};
use tau_robot::measurements::{Folder, Poses, Split};
use tau_robot::robot::Robot;
use tau_robot::robot_file::{LinkValues, RobotFile, Value};
use tau_simulation::{Simulation, simulate};

use super::{Mistake, Status, Verdict, mistakes, of_calibration, of_prediction};
use crate::calibration::{self, Error, calibrate};

const DELTA: &str = include_str!("../../../tests/robots/linear_delta.tau");
const HEXAPOD: &str = include_str!("../../../tests/robots/stewart.tau");

/// Robots by name, with their robot files.
fn robots() -> Vec<(&'static str, Robot, RobotFile)> {
    let gantry = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let file = tau_robot::prototype::robot_file().unwrap();
    let of = |name: &'static str, text: &str| {
        let robot = Robot::from_text(text).unwrap();
        let noise = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
        let file = format!("robot = \"{}\"\n{noise}", robot.name);
        let file = RobotFile::parse_for(&file, "robot.toml", &robot).unwrap();
        let file = file.completed(&robot);
        (name, robot, file)
    };
    vec![
        ("gantry", gantry, file),
        of("delta", DELTA),
        of("hexapod", HEXAPOD),
    ]
}

fn simulated(robot: &Robot, file: &RobotFile, seed: u64) -> Folder {
    let simulation = Simulation {
        seed,
        random_poses: 0,
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
            let r = Pose::from_zyz(pose.position_m, pose.angles_rad).rotation;
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
) -> Result<Verdict, (Error, Vec<Mistake>)> {
    let variant = robot.variant("Full").unwrap();
    let poses = Poses::select(robot, file, folder, Split::Alternate).unwrap();
    let poses = &poses.division.calibration;
    let options = calibration::Options::default();
    let verdict = calibrate(robot, variant, file, folder, poses, &options)
        .and_then(|calibration| of_calibration(&calibration, file, folder, poses));
    verdict.map_err(|error| {
        let found = mistakes(robot, variant, file, folder, poses);
        (error, found.unwrap_or_default())
    })
}

/// True if a mistake is named, and the sentences that name it.
fn is_named(robot: &Robot, clean: (&Folder, &RobotFile), wrong: &Wrong) -> (bool, String) {
    let (mut folder, mut file) = (clean.0.clone(), clean.1.clone());
    wrong.3(&mut folder, &mut file);
    let (found, said) = match judged(robot, &file, &folder) {
        Ok(verdict) => (verdict.mistakes.clone(), verdict.line()),
        Err((error, found)) => {
            let said = format!("{error}: {found:?}");
            (found, said)
        }
    };
    let is_right = |mistake: &Mistake| mistake.kind == wrong.1 && mistake.what.contains(wrong.2);
    (found.first().is_some_and(is_right), said)
}

/// Counts mistakes that are named rightly, of all machines. `TRIALS` sets how many machines of each robot.
#[test]
#[ignore = "a measurement of minutes"]
fn how_many_mistakes_are_named() {
    let trials: u64 = std::env::var("TRIALS").map_or(20, |text| text.parse().unwrap());
    let (mut right, mut all) = (0, 0);
    for (name, robot, file) in robots() {
        for wrong in &WRONG {
            let mut own = 0;
            for seed in 0..trials {
                let folder = simulated(&robot, &file, 7000 + seed);
                let (named, said) = is_named(&robot, (&folder, &file), wrong);
                own += u32::from(named);
                if !named {
                    println!("{name}, {}, {seed}: {said}", wrong.0);
                }
            }
            println!("{name:8} {:20} {own} of {trials}", wrong.0);
            right += own;
            all += trials;
        }
    }
    println!("{right} of {all}");
}

/// Counts verdicts on clean folders. `TRIALS` sets how many machines of each robot.
#[test]
#[ignore = "a measurement of minutes"]
fn how_many_clean_folders_are_consistent() {
    let trials: u64 = std::env::var("TRIALS").map_or(100, |text| text.parse().unwrap());
    for (name, robot, file) in robots() {
        let mut counts = [0; 3];
        let mut predicted = [0; 3];
        let (mut ratio, mut predicted_ratio) = (0.0, 0.0);
        for seed in 0..trials {
            let folder = simulated(&robot, &file, 9000 + seed);
            let variant = robot.variant("Full").unwrap();
            let division = Poses::select(&robot, &file, &folder, Split::Alternate)
                .unwrap()
                .division;
            let poses = &division.calibration;
            let options = calibration::Options::default();
            let found = calibrate(&robot, variant, &file, &folder, poses, &options).unwrap();
            let verdict = of_calibration(&found, &file, &folder, poses).unwrap();
            counts[verdict.status as usize] += 1;
            ratio += verdict.chi2 / verdict.dof;
            let after = of_prediction(&found.machine, &found.file, &folder, &division).unwrap();
            predicted[after.status as usize] += 1;
            predicted_ratio += after.chi2 / after.dof;
            for verdict in [verdict, after] {
                if verdict.status != Status::Consistent {
                    println!("{name}, {seed}: {} {verdict:?}", verdict.line());
                }
            }
        }
        let [ratio, predicted_ratio] = [ratio, predicted_ratio].map(|sum| sum / trials as f64);
        println!(
            "{name}: calibrated {counts:?}, χ²/dof {ratio:.4}; predicted {predicted:?}, χ²/dof {predicted_ratio:.4}"
        );
    }
}
