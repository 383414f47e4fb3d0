//! `tau kinematics`.

mod targets;

use std::path::{Path, PathBuf};

use serde_json::{Value, json};
use tau::calibration::machine_from_file;
use tau::input_error::InputError;
use tau::kinematics::{self, InverseOptions, Machine, Pose, Reached};
use tau::measurements::{Folder, Poses, Shape, Split, TcpPose};
use tau::robot::Arm;
use tau_robot::input_error::both;

use super::calibrate::{csv, number};
use super::deliver::{Outcome, Target, check_file};
use super::kept::Kept;
use super::resolve::{files, robot};
use super::{Failure, arguments};
use targets::{Asked, Row};

pub(super) fn forward(arguments: &arguments::Forward) -> Result<Outcome, Failure> {
    let mut setup = Setup::resolve(&arguments.with, arguments.poses.as_ref())?;
    let commands = setup.machine.robot.commands;
    let ((rows, unknown), start) = both(
        match (&arguments.poses, &arguments.commands) {
            (Some(path), _) => targets::of_file(path, Asked::Poses, &setup.machine),
            (None, Some(numbers)) => {
                targets::commands_of_option(numbers, commands).map(|rows| (rows, None))
            }
            (None, None) => Ok((Vec::new(), None)),
        },
        arguments
            .start
            .as_ref()
            .map(targets::start_of_option)
            .transpose(),
    )?;
    setup.remarks.extend(unknown);
    let mut reached: Vec<Reached> = Vec::with_capacity(rows.len());
    for row in &rows {
        let next = setup
            .predict(row, reached.last(), start)
            .map_err(|error| fail(row, &error))?;
        reached.push(next);
    }
    setup.remarks.extend(misfits(&rows, &reached));
    setup.outcome(&rows, &reached)
}

pub(super) fn inverse(arguments: &arguments::Inverse) -> Result<Outcome, Failure> {
    let mut setup = Setup::resolve(&arguments.with, arguments.poses.as_ref())?;
    let (rows, unknown) = match (&arguments.poses, &arguments.pose) {
        (Some(path), _) => targets::of_file(path, Asked::Commands, &setup.machine)?,
        (None, Some(numbers)) => (targets::poses_of_option(numbers)?, None),
        (None, None) => (Vec::new(), None),
    };
    setup.remarks.extend(unknown);
    let mut reached: Vec<Reached> = Vec::with_capacity(rows.len());
    for row in &rows {
        let next = setup
            .reach(row, reached.last())
            .map_err(|error| fail(row, &error))?;
        reached.push(next);
    }
    setup.outcome(&rows, &reached)
}

/// An error of a row; what the input lacks is the input's fault.
fn fail(row: &Row, error: &kinematics::Error) -> Failure {
    use kinematics::Error::{Commands, Missing, Target};
    let of_input = || InputError::whole(&row.source, format!("pose {}: {error}", row.pose));
    match error {
        Missing { what, .. } if what.is_column() => {
            let is_option = row.source.starts_with("--");
            of_input()
                .help(if is_option {
                    "give them, with the commands or poses, in a CSV with `--poses`"
                } else {
                    "add them to the CSV"
                })
                .into()
        }
        Missing { .. } | Commands { .. } | Target(_) => of_input().into(),
        error => Failure::Failed(format!("{}: pose {}: {error}", row.source, row.pose)),
    }
}

/// A machine, and what settles how its arm is assembled.
struct Setup<'a> {
    machine: Machine,
    range_m: Vec<Option<(f64, f64)>>,
    measured: Vec<TcpPose>,
    json: Option<Target>,
    out: Option<&'a Path>,
    remarks: Vec<String>,
}

impl<'a> Setup<'a> {
    fn resolve(
        with: &'a arguments::Kinematic,
        poses: Option<&PathBuf>,
    ) -> Result<Self, InputError> {
        let robot = robot(with.robot.model.as_deref())?;
        let files = files(with.folder.as_deref(), &with.robot);
        let kept = Kept::of(with.folder.as_ref(), with.robot.files().chain(poses));
        let out = with.out.as_deref();
        // Parameters without measurements are enough for straight tracks and full arms.
        let needs_folder = with.folder.is_some() || with.robot.robot.is_none();
        let measurements = if needs_folder {
            files.read_folder(&robot).map(Some)
        } else {
            Ok(None)
        };
        let file = files.read_robot_file(&robot);
        let outputs = both(
            Target::resolve(&with.json, &kept),
            out.map_or(Ok(()), |out| {
                check_file(out).and_then(|()| kept.check("--out", out))
            }),
        );
        let variant = robot.find(&with.variant.name, "--variant").cloned();
        let (((folder, file), variant), (json, ())) =
            both(both(both(measurements, file), variant), outputs)?;

        let poses = match &folder {
            Some(folder) => {
                let poses = Poses::select(&robot, &file, folder, Split::default())?;
                poses.division.calibration
            }
            None => Vec::new(),
        };
        let shape = Shape::from(&robot);
        let range_m = folder.as_ref().map_or_else(
            || Folder::default().measured_range(&file, shape),
            |folder| folder.measured_range(&file, shape),
        );
        let machine = machine_from_file(&robot, &variant, &file, folder.as_ref(), &poses);
        let machine = machine.map_err(|error| {
            let is_folded = variant.arm == Arm::Reduced
                && robot
                    .clusters
                    .iter()
                    .any(|cluster| !file.clusters.contains_key(&cluster.name));
            match (&with.robot.robot, &folder) {
                (Some(path), None) if is_folded => no_orientation(&variant.name, path),
                _ => error,
            }
        })?;
        Ok(Self {
            machine,
            range_m,
            measured: folder.map_or_else(Vec::new, |folder| folder.tcp_poses),
            json,
            out: with.out.as_deref(),
            remarks: (file.other_robot(&robot).into_iter())
                .chain(file.unused_effects(&variant))
                .collect(),
        })
    }

    /// The pose at the commands of a row, by continuity from the row before where it gives no start.
    fn predict(
        &mut self,
        row: &Row,
        before: Option<&Reached>,
        start: Option<Pose>,
    ) -> Result<Reached, kinematics::Error> {
        let (from, pose) = match (row.start, before) {
            (Some(own), _) => (&row.commands_m, own),
            (None, Some(before)) => (&before.commands_m, before.pose),
            (None, None) => {
                let known = start.or_else(|| self.measured_near_commands(&row.commands_m));
                let pose = match known {
                    Some(pose) => pose,
                    None => self.guess(row, &row.commands_m, "a pose nearby as `--start`")?,
                };
                (&row.commands_m, pose)
            }
        };
        self.machine
            .forward_along(from, &row.sample(&row.commands_m, pose))
    }

    /// The pose at commands (m) in the best held way of assembling the arm, with a remark on how to
    /// say which one is meant.
    fn guess(
        &mut self,
        row: &Row,
        commands_m: &[f64],
        settle: &str,
    ) -> Result<Pose, kinematics::Error> {
        let anywhere = Pose::from_zyz(row.position_m, [0.0; 3]);
        let modes = self
            .machine
            .assembly_modes_of(&row.sample(commands_m, anywhere), None)?;
        if modes.len() > 1 {
            self.remarks.push(format!(
                "how the arm is assembled was guessed: of {} ways that were found, the one that holds \
                 the plate most firmly was taken; give {settle}, or a measurement FOLDER",
                modes.len()
            ));
        }
        Ok(modes[0].pose)
    }

    /// The commands for the pose of a row, by continuity from the row before where it gives no angles.
    fn reach(&mut self, row: &Row, before: Option<&Reached>) -> Result<Reached, kinematics::Error> {
        let position = row.position_m;
        let measured = self.measured_near_position(position);
        let measured_pose =
            measured.map(|measured| Pose::from_zyz(measured.position_m, measured.angles_rad));
        let commands_m = match (before, measured) {
            (Some(before), _) => before.commands_m.clone(),
            (None, Some(measured)) => measured.commands_m.clone(),
            (None, None) => {
                let middle = |range: &Option<(f64, f64)>| {
                    range.map_or(0.0, |(low, high)| f64::midpoint(low, high))
                };
                self.range_m.iter().map(middle).collect()
            }
        };
        let known = row
            .start
            .or(before.map(|before| before.pose))
            .or(measured_pose);
        let nearby = match known {
            None if self.machine.orientation_follows() => {
                let settle = "the angles of a pose nearby after its position";
                Some(self.guess(row, &commands_m, settle)?)
            }
            known => known,
        };
        let options = InverseOptions {
            near: nearby.map(|pose| (pose, commands_m)),
            range_m: self.range_m.clone(),
            directions: row.directions.clone(),
            conditions: row.conditions,
            ..InverseOptions::default()
        };
        match row.start {
            Some(pose) if !self.is_given_by_position() => self.machine.inverse(pose, &options),
            _ => self.machine.inverse_position(position, &options),
        }
    }

    /// True if a position says all that can be asked for.
    fn is_given_by_position(&self) -> bool {
        self.machine.variant.arm == Arm::Reduced || self.machine.orientation_follows()
    }

    fn measured_near_commands(&self, commands_m: &[f64]) -> Option<Pose> {
        let measured = nearest(&self.measured, commands_m, |pose| &pose.commands_m)?;
        Some(Pose::from_zyz(measured.position_m, measured.angles_rad))
    }

    fn measured_near_position(&self, position_m: [f64; 3]) -> Option<&TcpPose> {
        nearest(&self.measured, &position_m, |pose| &pose.position_m)
    }

    /// A remark where commands lie outside the measured range: there, paths and effects are extrapolated.
    fn beyond_range(&self, rows: &[Row], reached: &[Reached]) -> Option<String> {
        let is_beyond = |reached: &Reached| {
            let mut pairs = reached.commands_m.iter().zip(&self.range_m);
            pairs.any(|(q, range)| range.is_some_and(|(low, high)| *q < low || *q > high))
        };
        let beyond: Vec<u32> = rows
            .iter()
            .zip(reached)
            .filter(|(_, reached)| is_beyond(reached))
            .map(|(row, _)| row.pose)
            .collect();
        match &beyond[..] {
            [] => None,
            [pose] => Some(format!(
                "commands of pose {pose} lie outside the measured range"
            )),
            [pose, others @ ..] => Some(format!(
                "commands of pose {pose} and {} more lie outside the measured range",
                others.len()
            )),
        }
    }

    fn outcome(mut self, rows: &[Row], reached: &[Reached]) -> Result<Outcome, Failure> {
        let has_orientation = self.machine.variant.arm == Arm::Full;
        let pairs = || rows.iter().zip(reached);
        let mut header = vec!["pose".to_owned()];
        header.extend((1..=self.machine.robot.commands).map(|k| format!("q{k}_m")));
        header.extend(["x_m", "y_m", "z_m"].map(String::from));
        if has_orientation {
            header.extend(["alpha_rad", "beta_rad", "gamma_rad"].map(String::from));
        }
        let table = pairs().map(|(row, reached)| {
            let angles = if has_orientation {
                &reached.pose.angles_rad()[..]
            } else {
                &[]
            };
            let mut fields = vec![row.pose.to_string()];
            let numbers = reached.commands_m.iter().copied();
            fields.extend(numbers.chain(reached.pose.position_m()).map(number));
            fields.extend(angles.iter().copied().map(number));
            fields
        });
        let table = csv(header, table)?;
        let poses: Vec<Value> = pairs()
            .map(|(row, reached)| {
                json!({
                    "pose": row.pose,
                    "commands_m": reached.commands_m,
                    "position_m": reached.pose.position_m(),
                    "angles_rad": has_orientation.then(|| reached.pose.angles_rad()),
                    "mismatch_m": reached.mismatch_m,
                })
            })
            .collect();
        let value = json!({
            "robot": self.machine.robot.name,
            "variant": self.machine.variant.name,
            "poses": poses,
        });
        let beyond = self.beyond_range(rows, reached);
        self.remarks.extend(beyond);
        let remarks = self.remarks;
        let json = self.json.map(|target| (value, target));
        Ok(match self.out {
            Some(path) => Outcome {
                summary: format!("written: {}\n", path.display()),
                files: vec![(path.to_owned(), table)],
                json,
                remarks,
                ..Outcome::default()
            },
            None => Outcome {
                data: table,
                json,
                remarks,
                ..Outcome::default()
            },
        })
    }
}

/// A remark on poses that are only the best of all, because the links can't all have their lengths.
fn misfits(rows: &[Row], reached: &[Reached]) -> Option<String> {
    let allowed_m = InverseOptions::default().allowed_mismatch_m;
    let (row, worst) = rows
        .iter()
        .zip(reached)
        .max_by(|(_, a), (_, b)| a.mismatch_m.total_cmp(&b.mismatch_m))
        .filter(|(_, reached)| reached.mismatch_m > allowed_m)?;
    Some(format!(
        "the links can't all have their lengths at these commands, and poses are those of least squares: \
         they differ by {:.1} µm at pose {}, where it is most",
        worst.mismatch_m * 1e6,
        row.pose
    ))
}

/// A reduced arm whose robot file gives links, without measured poses.
fn no_orientation(variant: &str, file: &Path) -> InputError {
    InputError::whole(
        file.display().to_string(),
        format!(
            "`{variant}` has a reduced arm, whose track offsets hold the plate joints in the mean measured \
             orientation: found links and no measured poses"
        ),
    )
    .help("name a measurement FOLDER, or give with --robot a file that `tau calibrate` wrote for this variant")
}

fn nearest<'a>(
    poses: &'a [TcpPose],
    to: &[f64],
    of: impl Fn(&'a TcpPose) -> &'a [f64],
) -> Option<&'a TcpPose> {
    let distance = |pose: &'a TcpPose| -> f64 {
        let pairs = of(pose).iter().zip(to);
        pairs.map(|(a, b)| (a - b).powi(2)).sum()
    };
    poses
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
}
