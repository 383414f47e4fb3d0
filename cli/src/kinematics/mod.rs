//! `tau kinematics`.

mod failure;
mod targets;
mod trust;

use std::path::{Path, PathBuf};
use tau_robot::input_error;

use serde_json::{Value, json};
use tau::calibration::Prepared;
use tau::input_error::InputError;
use tau::kinematics::{self, InverseOptions, Machine, Pose, Reached};
use tau::measurements::{Folder, Poses, Shape, Split, TcpPose};
use tau::prototype;
use tau::robot::Arm;
use tau::robot_file::{RobotFile, StatedNoise};
use tau::session::csv;
use tau::uncertainty::PoseUncertainty;
use tau_codes::{Remark, kinematics as codes, remark};
use tau_report as report;
use tau_robot::input_error::{both, quoted};
use tau_robot::number::shortest;

use super::deliver::{Outcome, Target, check_file};
use super::kept::Kept;
use super::resolve::{self, files};
use super::{Failure, arguments};
pub(super) use failure::misplaced;
use failure::source_of_reference;
use targets::{Asked, Row};
use trust::Certainty;

pub(super) fn forward(arguments: &arguments::Forward) -> Result<Outcome, Failure> {
    let mut setup = Setup::resolve(&arguments.with, arguments.poses.as_ref())?;
    let ((rows, unknown), start) = both(
        match (&arguments.poses, &arguments.commands) {
            (Some(path), _) => targets::of_file(path, Asked::Poses, &setup.machine),
            (None, Some(numbers)) => {
                let rows = targets::commands_of_option(numbers, &setup.machine.robot);
                rows.map(|rows| (rows, Vec::new()))
            }
            (None, None) => Ok((Vec::new(), Vec::new())),
        },
        arguments
            .start
            .as_ref()
            .map(|start| targets::start_of_option(start, &setup.machine))
            .transpose(),
    )?;
    setup.remarks.extend(unknown);
    setup.check_turns(&rows)?;
    let mut reached: Vec<Reached> = Vec::with_capacity(rows.len());
    for row in &rows {
        let next = setup.predict(row, reached.last(), start);
        reached.push(next.map_err(|error| setup.fail(row, &error))?);
    }
    setup.remarks.extend(setup.half_turns(&rows));
    setup.remarks.extend(misfits(&rows, &reached));
    Ok(setup.outcome(&rows, &reached, Asked::Poses))
}

pub(super) fn inverse(arguments: &arguments::Inverse) -> Result<Outcome, Failure> {
    let mut setup = Setup::resolve(&arguments.with, arguments.poses.as_ref())?;
    let (rows, unknown) = match (&arguments.poses, &arguments.pose) {
        (Some(path), _) => targets::of_file(path, Asked::Commands, &setup.machine)?,
        (None, Some(numbers)) => (
            targets::poses_of_option(numbers, &setup.machine)?,
            Vec::new(),
        ),
        (None, None) => (Vec::new(), Vec::new()),
    };
    setup.remarks.extend(unknown);
    let mut reached: Vec<Reached> = Vec::with_capacity(rows.len());
    for row in &rows {
        let next = setup
            .reach(row, reached.last())
            .map_err(|error| setup.fail(row, &error))?;
        reached.push(next);
    }
    setup
        .remarks
        .extend(misses(&setup.machine, &rows, &reached));
    Ok(setup.outcome(&rows, &reached, Asked::Commands))
}

/// A way and a turn (m, rad) off what was asked for, below which a pose is that one.
const SMALLEST_MISS: f64 = 1e-6;

/// A machine, and what settles how its arm is assembled.
struct Setup<'a> {
    machine: Machine,
    certainty: Certainty,
    range_m: Vec<Option<(f64, f64)>>,
    measured: Vec<TcpPose>,
    /// Name of the folder that the measured poses are of.
    folder: String,
    file: RobotFile,
    /// The known pose from which the first way started.
    known: Option<Known>,
    /// Effects of the tracker, which kinematics leaves out.
    left_out: Vec<String>,
    json: Option<Target>,
    out: Option<&'a Path>,
    remarks: Vec<Remark>,
}

impl<'a> Setup<'a> {
    fn resolve(
        with: &'a arguments::Kinematic,
        poses: Option<&PathBuf>,
    ) -> Result<Self, InputError> {
        let files = files(with.folder.as_deref(), &with.robot);
        let robot = resolve::robot(with.robot.model.as_deref(), &files)?;
        let kept = Kept::of(with.folder.as_ref(), with.robot.files().chain(poses));
        let out = with.out.as_deref();
        // Parameters without measurements are enough for straight tracks and full arms.
        let is_built_in = with.robot.robot.is_none() && RobotFile::described(&robot).is_err();
        let needs_folder = with.folder.is_some() || is_built_in && prototype::is_of(&robot);
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
        let (((folder, file), mut variant), (json, ())) =
            both(both(both(measurements, file), variant), outputs)?;

        let poses = match &folder {
            Some(folder) => {
                let poses = Poses::select(&robot, &file, folder, Split::default())?;
                poses.division.calibration
            }
            None => Vec::new(),
        };
        // Errors of the tracker are in what it measures, not where the machine stands.
        let (own, left_out) = robot.of_machine_alone(&variant)?;
        let asked = std::mem::replace(&mut variant, own);
        let shape = Shape::from(&robot);
        let range_m = folder.as_ref().map_or_else(
            || Folder::default().measured_range(&file, &shape),
            |folder| folder.measured_range(&file, &shape),
        );
        let prepared = Prepared::from_file(&robot, &variant, &file, folder.as_ref(), &poses);
        let prepared = prepared.map_err(|error| {
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
        let certainty = Certainty::new(&prepared, &file);
        let machine = prepared.noisy_machine(&file);
        let of_tracker = (!left_out.is_empty()).then(|| {
            remark!(codes::TRACKER_LEFT_OUT;
                "{} of `{}` are errors of the tracker, not of the machine, and are left out",
                    quoted(left_out.iter().map(String::as_str)), variant.name)
        });
        let region = file.calibration.as_ref();
        let range_m = region.map_or(range_m, |region| {
            let ranges = region.commands_m.iter();
            ranges.map(|&[low, high]| Some((low, high))).collect()
        });
        let (folder, measured) =
            folder.map_or_else(Default::default, |folder| (folder.name, folder.tcp_poses));
        Ok(Self {
            machine,
            range_m,
            measured,
            folder,
            known: None,
            left_out,
            json,
            out: with.out.as_deref(),
            remarks: (file.other_robot(&robot).into_iter())
                .chain(file.other_description(&robot))
                .chain(file.unused_effects(&asked))
                .chain(file.other_variant(&asked))
                .chain(of_tracker)
                .chain(certainty.remark())
                .chain(noise_left_out(&file))
                .collect(),
            certainty,
            file,
        })
    }

    /// The pose at the commands of a row: along the way from the row before, or from a known pose.
    fn predict(
        &mut self,
        row: &Row,
        before: Option<&Reached>,
        start: Option<Pose>,
    ) -> Result<Reached, kinematics::Error> {
        let along = |machine: &Machine, from: &Reached| {
            machine.forward_along(&from.commands_m, &row.sample(&row.commands_m, from.pose))
        };
        match (row.start, before, start) {
            (Some(own), ..) => {
                let sample = row.sample(&row.commands_m, own);
                self.machine.forward_along(&row.commands_m, &sample)
            }
            (None, Some(before), _) => match along(&self.machine, before) {
                // Another way may be free.
                Err(kinematics::Error::Way { share }) if start.is_none() => {
                    let known = self.known(row)?;
                    along(&self.machine, &known).map_err(|_| kinematics::Error::Way { share })
                }
                found => found,
            },
            (None, None, Some(start)) => {
                let sample = row.sample(&row.commands_m, start);
                self.known = Some(Known {
                    from: "--start".to_owned(),
                    commands_m: row.commands_m.clone(),
                    pose: start,
                });
                self.machine.forward_along(&row.commands_m, &sample)
            }
            (None, None, None) => {
                let known = self.known(row)?;
                along(&self.machine, &known)
            }
        }
    }

    /// The commands for the pose of a row: along the way from the row before, or from a known pose.
    fn reach(&mut self, row: &Row, before: Option<&Reached>) -> Result<Reached, kinematics::Error> {
        let mut options = InverseOptions {
            range_m: self.range_m.clone(),
            directions: row.directions.clone(),
            conditions: row.conditions,
            tensions_n: row.tensions_n.clone(),
            ..InverseOptions::default()
        };
        let by_position = self.machine.is_given_by_position();
        let is_partial = self.machine.partial_freedoms().is_some();
        let asked = match row.start {
            None if !by_position => {
                return self.machine.inverse_position(row.position_m, &options);
            }
            asked => asked,
        };
        let from = match before {
            Some(before) => before.clone(),
            None => match (self.known(row), asked) {
                // Nothing tells how the arm is assembled; a driven length is the distance of its joints, however it is.
                (Err(kinematics::Error::NoReference), Some(pose))
                    if !by_position && !is_partial && self.machine.robot.tracks.is_empty() =>
                {
                    return self.machine.inverse(pose, &options);
                }
                (known, _) => known?,
            },
        };
        let to = match asked {
            Some(pose) if !by_position => pose,
            _ => Pose {
                position: row.position_m.into(),
                ..from.pose
            },
        };
        let mut along = self.machine.inverse_along(&from, to, &options);
        if let (Err(kinematics::Error::Way { .. }), Some(_)) = (&along, before) {
            // Another way may be free.
            let known = self.known(row)?;
            let again = self.machine.inverse_along(&known, to, &options);
            along = again.or(along);
        }
        // A pose that the drives can't turn the plate into is approached.
        let is_missed = |error: &kinematics::Error| {
            use kinematics::Error::{Missing, NotFinite};
            !matches!(error, Missing { .. } | NotFinite { .. })
        };
        if is_partial && along.as_ref().is_err_and(is_missed) {
            return self.machine.inverse_nearest(&from, to, &options);
        }
        // Angles beside a position from which they follow choose between the ways of assembling the arm.
        match asked {
            Some(pose) if by_position && self.machine.orientation_follows() => {
                let commands_m = along.map_or(from.commands_m, |reached| reached.commands_m);
                options.near = Some((pose, commands_m));
                self.machine.inverse_position(row.position_m, &options)
            }
            _ => along,
        }
    }

    /// A pose of the machine with its commands, from which ways start: its reference, or else the measured pose of the
    /// folder that is nearest to the row.
    fn known(&mut self, row: &Row) -> Result<Reached, kinematics::Error> {
        use kinematics::Error::{NoReference, Reference, Unassembled};
        let anywhere = Pose::from_zyz(row.position_m, [0.0; 3]);
        let at_reference = self.machine.at_reference(&row.sample(&[], anywhere));
        let reference = source_of_reference(&self.file, &self.machine.robot);
        let is_described = reference != self.file.source.0;
        let (from, reached) = match at_reference {
            Err(NoReference) => self.measured_near(row).ok_or(NoReference)?,
            // Measurements in another frame than the description's say it better.
            Err(error @ (Reference { .. } | Unassembled { .. })) if is_described => {
                self.measured_near(row).ok_or(error)?
            }
            found => (reference.to_owned(), found?),
        };
        self.known.get_or_insert_with(|| Known {
            from,
            commands_m: reached.commands_m.clone(),
            pose: reached.pose,
        });
        Ok(reached)
    }

    /// The measured pose nearest to what a row asks about, and its name.
    fn measured_near(&self, row: &Row) -> Option<(String, Reached)> {
        let measured = if row.commands_m.is_empty() {
            nearest(&self.measured, &row.position_m, |pose| &pose.position_m)
        } else {
            nearest(&self.measured, &row.commands_m, |pose| &pose.commands_m)
        }?;
        let reached = Reached {
            commands_m: measured.commands_m.clone(),
            pose: measured.into(),
            mismatch_m: 0.0,
        };
        Some((
            format!("pose {} of {}", measured.pose, self.folder),
            reached,
        ))
    }

    /// Adds commands under the key that a robot file has where some are angles.
    fn add_commands(&self, found: &mut Value) {
        let robot = &self.machine.robot;
        if (0..robot.commands).any(|command| robot.is_angle(command)) {
            found["commands"] = found["commands_m"].clone();
        }
    }

    /// A remark where commands lie outside the measured range: there, paths and effects are extrapolated.
    fn beyond_range(&self, rows: &[Row], reached: &[Reached]) -> Option<Remark> {
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
        let text = match &beyond[..] {
            [] => return None,
            [pose] => format!("commands of pose {pose} lie outside the measured range"),
            [pose, others @ ..] => format!(
                "commands of pose {pose} and {} more lie outside the measured range",
                others.len()
            ),
        };
        Some(Remark::new(codes::BEYOND_RANGE, text))
    }

    /// A remark where the position is less well known than at any pose that calibrated.
    fn beyond_knowledge(rows: &[Row], known: &[trust::Known]) -> Option<Remark> {
        let pairs = rows.iter().zip(known);
        let mut beyond = pairs.filter(|(_, known)| known.is_uncertain);
        let (row, first) = beyond.next()?;
        let more = match beyond.count() {
            0 => String::new(),
            more => format!(", as do {more} more"),
        };
        let why = &first.outside.last()?.text;
        Some(remark!(codes::BEYOND_KNOWLEDGE;
            "pose {} lies outside the region of calibration{more}: {why}", row.pose))
    }

    fn outcome(mut self, rows: &[Row], reached: &[Reached], asked: Asked) -> Outcome {
        let with_commands = asked == Asked::Commands;
        let (machine, certainty) = (&self.machine, &self.certainty);
        let known = certainty.of(machine, rows, reached, with_commands);
        let has_orientation = self.machine.turns();
        let pairs = || rows.iter().zip(reached).zip(&known);
        let mut header = vec!["pose".to_owned()];
        header.extend(self.machine.robot.command_columns());
        header.extend(["x_m", "y_m", "z_m"].map(String::from));
        if has_orientation {
            header.extend(["alpha_rad", "beta_rad", "gamma_rad"].map(String::from));
        }
        let known_columns = trust::Known::default().cells(certainty, machine, with_commands);
        header.extend(known_columns.into_iter().map(|(name, _)| name));
        let table = pairs().map(|((row, reached), known)| {
            let angles = if has_orientation {
                &reached.pose.angles_rad()[..]
            } else {
                &[]
            };
            let mut fields = vec![row.pose.to_string()];
            let numbers = reached.commands_m.iter().copied();
            fields.extend(numbers.chain(reached.pose.position_m()).map(shortest));
            fields.extend(angles.iter().copied().map(shortest));
            let cells = known.cells(certainty, machine, with_commands);
            fields.extend(cells.into_iter().map(|(_, cell)| cell));
            fields
        });
        let table = csv(header, table);
        let poses: Vec<Value> = pairs()
            .map(|((row, reached), known)| {
                let pose = known.pose.as_ref();
                let mut found = json!({
                    "pose": row.pose,
                    "commands_m": reached.commands_m,
                    "position_m": reached.pose.position_m(),
                    "angles_rad": has_orientation.then(|| reached.pose.angles_rad()),
                    "mismatch_m": reached.mismatch_m,
                    "position_sigma_m": pose.map(PoseUncertainty::position_m),
                    "rotation_sigma_rad": pose.filter(|_| has_orientation).map(PoseUncertainty::rotation_rad),
                    "commands_sigma_m": known.commands_m,
                    "inside": certainty.has_region().then_some(known.outside.is_empty()),
                    "outside": known.outside.iter().map(|own| &own.text).collect::<Vec<_>>(),
                    "outside_codes": known.outside.iter().map(|own| own.code.to_string()).collect::<Vec<_>>(),
                });
                self.add_commands(&mut found);
                found
            })
            .collect();
        let reference = self.known.as_ref().map(|known| {
            let mut reference = json!({
                "from": known.from,
                "commands_m": known.commands_m,
                "position_m": known.pose.position_m(),
                "orientation_rad": known.pose.angles_rad(),
            });
            self.add_commands(&mut reference);
            reference
        });
        let value = json!({
            "robot": self.machine.robot.name,
            "variant": self.machine.variant.name,
            "reference": reference,
            "tracker_effects_left_out": self.left_out,
            "widening": certainty.widening,
            "poses": poses,
        });
        let beyond = self.beyond_range(rows, reached);
        self.remarks.extend(beyond);
        self.remarks.extend(Self::beyond_knowledge(rows, &known));
        let remarks = self.remarks;
        let json = self
            .json
            .map(|target| (report::json::document(value), target));
        match self.out {
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
        }
    }
}

/// The known pose that settled how the arm is assembled.
struct Known {
    /// The file or option that it is from.
    from: String,
    commands_m: Vec<f64>,
    pose: Pose,
}

/// A remark on poses that are only the best of all, because the links can't all have their lengths.
fn misfits(rows: &[Row], reached: &[Reached]) -> Option<Remark> {
    let allowed_m = InverseOptions::default().allowed_mismatch_m;
    let (row, worst) = rows
        .iter()
        .zip(reached)
        .max_by(|(_, a), (_, b)| a.mismatch_m.total_cmp(&b.mismatch_m))
        .filter(|(_, reached)| reached.mismatch_m > allowed_m)?;
    Some(remark!(codes::COMPROMISE;
        "the links can't all have their lengths at these commands, and poses are those of least squares: they differ by \
         {:.1} µm at pose {}, where it is most", worst.mismatch_m * 1e6, row.pose))
}

/// A remark on poses that the drives can't give, in place of which the nearest ones were taken.
fn misses(machine: &Machine, rows: &[Row], reached: &[Reached]) -> Option<Remark> {
    let freedoms = machine.partial_freedoms()?;
    let off = rows.iter().zip(reached).filter_map(|(row, reached)| {
        let asked = row.start?;
        let off_m = (reached.pose.position - asked.position).norm();
        let off_rad = asked.turn_to(&reached.pose.rotation).norm();
        (off_m > SMALLEST_MISS || off_rad > SMALLEST_MISS).then_some((row.pose, off_m, off_rad))
    });
    let (pose, off_m, off_rad) = off.max_by(|a, b| (a.1 + a.2).total_cmp(&(b.1 + b.2)))?;
    Some(remark!(codes::NEAREST_POSE;
        "the plate has {freedoms} freedoms and can't take all poses that were asked for: the nearest ones were taken, \
         at pose {pose}, where most is missed, {:.3} mm and {off_rad:.6} rad away", 1e3 * off_m))
}

/// A remark where noise of drives or links is in the measurements, and nothing says how large it is.
fn noise_left_out(file: &RobotFile) -> Option<Remark> {
    let stated = file.measuring.drives.iter().copied();
    let is_open = (stated.chain(file.noise_of_links())).any(|own| own == StatedNoise::Estimate);
    let record = file.calibration.as_ref();
    let is_found = record.is_some_and(|record| record.length_noise.is_some());
    (is_open && !is_found).then(|| {
        let text = "the noise of drives or links is to be estimated, and the robot file does not say what a calibration \
                    found: standard deviations are without it";
        Remark::new(codes::NOISE_UNKNOWN, text)
    })
}

/// A reduced arm whose robot file gives links, without measured poses.
fn no_orientation(variant: &str, file: &Path) -> InputError {
    input_error!(codes::NO_ORIENTATION, file.display().to_string();
        "`{variant}` has a reduced arm, whose track offsets hold the plate joints in the mean measured orientation: \
         found links and no measured poses";
        "name a measurement FOLDER, or give with --robot a file that `tau calibrate` wrote for this variant")
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
