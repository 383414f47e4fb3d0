//! Provenance of calibrated values, and the poses that took no part.

use std::collections::BTreeSet;

use tau_codes::fit;
use tau_estimation::calibration::{Calibration, Error, Prepared};
use tau_estimation::evaluation::{Evaluation, evaluate_knowing};
use tau_estimation::numerics::order::extent;
use tau_estimation::trust::Verdict;
use tau_estimation::uncertainty::Uncertainty;
use tau_estimation::unknown_poses::{
    EstimatedPoses, HeldErrors, JudgedRows, RowDivision, UnknownPoses,
};
use tau_kinematics::Machine;
use tau_robot::fingerprint;
use tau_robot::measurements::{Distance, Division, Folder, PoseCounts, Shape, Split, TcpPose};
use tau_robot::robot_file::Provenance;
use tau_robot::{InputError, Robot, prototype};

use super::{Input, Session, Stamp, VariantKey};

/// Origin of an answer: the program, the day, the split of the poses, and the files that were read.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Record {
    /// The program and the day.
    pub stamp: Stamp,
    /// The split, as `--split` takes it.
    pub split: String,
    /// The files, the description first; empty for measurements that were in no file.
    pub inputs: Vec<Input>,
    /// Arguments of `tau` that name the measurements, the machine and the split; none: those that are built in.
    pub arguments: Vec<String>,
}

/// Relation of evaluated poses to the calibration of a robot file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// The file says nothing of its calibration: the poses that the split holds out.
    Split,
    /// Poses of the folder that the file was calibrated on, none of which calibrated.
    HeldOut,
    /// Poses of another folder than the file was calibrated on.
    NewFolder,
    /// Poses that calibrated the file, since no others are left: residuals of the fit.
    Calibration,
}

/// Measurements of the plate by the part that they take.
#[derive(Debug, Clone)]
pub struct Parts {
    /// Numbers of poses, and lines of distances, whose rows calibrate or validate.
    pub rows: RowDivision,
    /// The measured poses among them, by index.
    pub poses: Division,
    /// Numbers of poses.
    pub counts: PoseCounts,
}

/// How parameters as given meet measurements.
#[derive(Debug, Clone)]
pub struct Evaluated {
    /// What the measurements are to the parameters.
    pub basis: Basis,
    /// Numbers of poses: of `calibration` those that calibrated the parameters, of `validation` those that are new to them.
    pub counts: PoseCounts,
    /// Number of poses that were compared.
    pub compared: usize,
    /// Predicted less measured poses, where poses were measured.
    pub poses: Option<Evaluation>,
    /// Errors of all measurements, where true poses are unknown.
    pub rows: Option<HeldErrors>,
    /// The verdict on it.
    pub verdict: Verdict,
    /// Factor by which standard deviations of the parameters are too small, as the robot file states it.
    pub widening: f64,
}

impl<R> Session<R> {
    /// The record of a calibration on some poses of a folder, given by index, and how far its predictions are known;
    /// `widening` is that of the [verdict](tau_estimation::trust::Verdict::widening).
    pub(super) fn provenance(
        &self,
        calibration: &Calibration,
        folder: &Folder,
        poses: &[usize],
        widening: f64,
    ) -> Provenance {
        let Machine { robot, variant, .. } = &calibration.machine;
        let placed: Vec<&TcpPose> = (poses.iter())
            .filter_map(|&pose| folder.tcp_poses.get(pose))
            .collect();
        let range =
            |of: &dyn Fn(&TcpPose) -> f64| extent(placed.iter().map(|pose| of(pose))).into();
        let Stamp { program, date } = Stamp::today();
        Provenance {
            program,
            date,
            variant: variant.name.clone(),
            split: self.split,
            poses: placed.len(),
            rows: self.calibrating_rows(),
            folder: self.folder.fingerprint.clone(),
            description: fingerprint::of_description(&robot.description),
            commands_m: (0..robot.commands)
                .map(|k| range(&|pose| pose.commands_m[k]))
                .collect(),
            position_m: (0..3).map(|k| range(&|pose| pose.position_m[k])).collect(),
            widening,
            position_sigma_m: largest_sigma_m(calibration, folder, poses),
            length_noise: None,
            tracker_effects: variant.tracker_effects(),
        }
    }

    /// The same of measurements whose poses are unknown, by their division.
    pub(super) fn provenance_of_rows(
        &self,
        found: &UnknownPoses,
        division: &RowDivision,
    ) -> Provenance {
        let placed = EstimatedPoses::of(found, &self.robot_file, &self.folder, division);
        let placed = placed.map_or_else(|_| Default::default(), |placed| placed.folder());
        let (folder, division) = (&placed.0, &placed.1.calibration);
        let estimated = found.kinds.iter().map(|fit| &fit.kind);
        let mut estimated = estimated.filter(|kind| kind.is_estimated() && kind.is_of_lengths());
        Provenance {
            poses: found.poses,
            length_noise: estimated.next().map(|kind| kind.sigma),
            commands_m: found.commands_m.clone(),
            position_m: found.position_m.clone(),
            ..self.provenance(
                &found.calibration,
                folder,
                division,
                found.verdict().widening(),
            )
        }
    }

    /// Fingerprints of the measurements of the plate that calibrate, outliers among them.
    fn calibrating_rows(&self) -> BTreeSet<String> {
        let rows = self.divided(self.split);
        let of_poses = self.folder.fingerprints();
        let of_poses = of_poses.filter(|(pose, _)| rows.calibration.contains(pose));
        let distances = self.folder.distances.iter();
        let distances = distances.filter(|own| rows.distances.contains(&own.line));
        (of_poses.map(|(_, own)| own))
            .chain(distances.map(Distance::fingerprint))
            .collect()
    }

    /// Rows of this folder that calibrated the robot file; none where it does not say how it was calibrated.
    fn calibrated_rows(&self) -> RowDivision {
        let Some(record) = &self.robot_file.calibration else {
            return RowDivision::default();
        };
        let of_poses = self.folder.fingerprints();
        let of_poses = of_poses.filter(|(_, own)| record.rows.contains(own));
        let distances = self.folder.distances.iter();
        let distances = distances.filter(|own| record.rows.contains(&own.fingerprint()));
        RowDivision {
            calibration: of_poses.map(|(pose, _)| pose).collect(),
            distances: distances.map(|own| own.line).collect(),
            ..RowDivision::default()
        }
    }

    /// Poses of this folder, by index, that calibrated the robot file.
    pub(super) fn calibrated(&self) -> Vec<usize> {
        self.poses_of(&self.calibrated_rows().calibration)
    }

    /// The origin of what this session computes. Of a description only the text is known: the argument for its file is
    /// `F.tau`.
    pub fn record(&self) -> Record {
        let Robot {
            name, description, ..
        } = &self.robot;
        let text = Input::new(&format!("description of {name}"), description.as_bytes());
        let inputs = std::iter::once(text).chain(self.inputs.iter().cloned());
        Record {
            stamp: Stamp::today(),
            split: self.split.to_string(),
            inputs: inputs.collect(),
            arguments: self.arguments(),
        }
    }

    fn arguments(&self) -> Vec<String> {
        let is_read = !self.folder.fingerprint.is_empty() && self.folder.name != prototype::NAME;
        let folder = is_read.then(|| self.folder.name.clone());
        let model = ["--model", "F.tau"].map(str::to_owned);
        let model = (!prototype::is_of(&self.robot)).then_some(model);
        folder
            .into_iter()
            .chain(model.into_iter().flatten())
            .collect()
    }

    /// Measurements by the part that a split gives them: all of the plate where poses are unknown, else the poses in range.
    fn divided(&self, split: Split) -> RowDivision {
        let folder = &self.folder;
        if self.has_unknown_poses() {
            return RowDivision::of(folder, split);
        }
        let in_range = folder.in_range(&self.robot_file, &Shape::from(&self.robot));
        let own = folder.divide(split, &in_range);
        RowDivision {
            validation: RowDivision::of_poses(folder, &own.validation).calibration,
            ..RowDivision::of_poses(folder, &own.calibration)
        }
    }

    /// Measured poses, by index, of these numbers.
    fn poses_of(&self, numbers: &BTreeSet<u32>) -> Vec<usize> {
        let poses = self.folder.tcp_poses.iter().enumerate();
        let own = poses.filter(|(_, pose)| numbers.contains(&pose.pose));
        own.map(|(index, _)| index).collect()
    }

    /// The measurements of the plate by the part that they take in a calibration.
    ///
    /// # Errors
    /// Poses are known, and none lies in the range, or none is left to calibrate or to validate.
    pub fn parts(&self) -> Result<Parts, InputError> {
        let rows = self.divided(self.split);
        let (poses, counts) = if self.has_unknown_poses() {
            let poses = Division {
                calibration: self.poses_of(&rows.calibration),
                validation: self.poses_of(&rows.validation),
            };
            (poses, rows.counts())
        } else {
            let own = self.poses()?;
            (own.division, own.counts)
        };
        Ok(Parts {
            rows,
            poses,
            counts,
        })
    }

    /// The poses that validate, without those on which the robot file was calibrated.
    pub(super) fn validating(&self) -> Result<Vec<usize>, InputError> {
        let mut validating = self.poses()?.division.validation;
        let calibrated = self.calibrated();
        validating.retain(|pose| !calibrated.contains(pose));
        if validating.is_empty() {
            let message = "all poses that validate took part in the calibration of the robot file";
            return Err(self.nothing_held_out(message, "take another split or another folder"));
        }
        Ok(validating)
    }

    fn nothing_held_out(&self, message: &str, help: &str) -> InputError {
        InputError::whole(fit::NOTHING_HELD_OUT, &self.folder.name, message).help(help)
    }

    /// The measurements by which the robot file can be judged, and what they are to it: of the folder that it was calibrated
    /// on those that took no part, of another folder all. Of a split that is asked for, those that validate among them.
    /// Distances between poses at which redundant drives calibrated took part, too.
    ///
    /// # Errors
    /// No pose lies in the range; the split leaves no measurement.
    pub fn unseen(&self, asked: Option<Split>) -> Result<(JudgedRows, Basis), InputError> {
        let is_recorded = self.robot_file.calibration.is_some();
        if !self.has_no_poses() && (asked.is_some() || !is_recorded) {
            // Mistakes in a split are reported here.
            self.poses()?;
        }
        let split = asked.unwrap_or(if is_recorded { Split::All } else { self.split });
        let known = self.calibrated_rows();
        let is_new_folder = known.calibration.is_empty() && known.distances.is_empty();
        let divided = self.divided(split);
        let rows = RowDivision {
            validation: divided.validation,
            held_out_distances: divided.held_out_distances,
            ..known
        };
        let judged = rows.judged(&self.folder, self.robot.is_redundant());
        let is_seen = !judged.poses.is_disjoint(&rows.calibration)
            || !judged.distances.is_disjoint(&rows.distances);
        let basis = match split {
            Split::All if !is_recorded => Basis::NewFolder,
            _ if !is_recorded => Basis::Split,
            _ if is_new_folder => Basis::NewFolder,
            _ if is_seen => Basis::Calibration,
            _ => Basis::HeldOut,
        };
        if !judged.poses.is_empty() || !judged.distances.is_empty() {
            return Ok((judged, basis));
        }
        Err(if self.has_no_poses() {
            let message = "no measurement is left to judge the machine by";
            let help = "let fewer of them calibrate with `--split`, or measure more";
            self.nothing_held_out(message, help)
        } else {
            let total = self.folder.tcp_poses.len();
            let message =
                format!("none of the {total} poses has all its commands in the measured range");
            InputError::whole(fit::NONE_IN_RANGE, &self.folder.name, message)
        })
    }

    /// How the session's robot file meets the measurements that are [unseen](Self::unseen): poses that were measured are
    /// predicted, and where poses are unknown, all measurements are compared, the parameters held.
    ///
    /// # Errors
    /// As [`Self::unseen`] and [`Self::machine`]; no pose can be predicted; the measurements leave nothing to judge the machine
    /// by.
    pub fn evaluate_unseen(
        &self,
        variant: impl VariantKey<R>,
        asked: Option<Split>,
    ) -> Result<Evaluated, Error> {
        let variant = variant.variant_of(&self.robot)?;
        let (judged, basis) = self.unseen(asked)?;
        let counts = self.parts()?.counts;
        let counts = PoseCounts {
            calibration: match basis {
                Basis::Split => counts.calibration,
                _ => self.calibrated_rows().calibration.len(),
            },
            validation: match basis {
                Basis::Calibration => 0,
                _ => judged.poses.len(),
            },
            ..counts
        };
        let rows = (self.has_unknown_poses())
            .then(|| self.held_errors(variant, &judged))
            .transpose()?;
        let poses = self.poses_of(&judged.poses);
        let compare = || {
            let prepared = self.prepared(variant)?;
            let expected = self.expected(&prepared, &poses);
            evaluate_knowing(&prepared.machine, expected.as_ref(), &self.folder, &poses)
        };
        Ok(Evaluated {
            basis,
            counts,
            compared: rows.as_ref().map_or(poses.len(), |rows| rows.poses),
            poses: (!poses.is_empty()).then(compare).transpose()?,
            // Where other measurements or redundant drives say something of the poses, they are judged together.
            verdict: match &rows {
                Some(rows) => rows.verdict(),
                None => self.verdict_on_prediction(&self.prepared(variant)?.machine, poses)?,
            },
            rows,
            widening: self.robot_file.widening(),
        })
    }
}

/// Largest standard deviation of the position (m) at poses of a folder, given by index, of the machine without effects of
/// the tracker, as kinematics predicts it; `None` where nothing is uncertain, or a pose can't be predicted.
fn largest_sigma_m(calibration: &Calibration, folder: &Folder, poses: &[usize]) -> Option<f64> {
    let Machine { robot, variant, .. } = &calibration.machine;
    let (own, left_out) = robot.of_machine_alone(variant).ok()?;
    let alone;
    let (machine, known) = if left_out.is_empty() {
        let known = Uncertainty::of_calibration(calibration)?;
        (&calibration.machine, known)
    } else {
        let file = &calibration.file;
        alone = Prepared::from_file(robot, &own, file, Some(folder), poses).ok()?;
        let known = Uncertainty::of_prepared(&alone, file)?;
        (&alone.machine, known)
    };
    let largest = known.largest_m(machine, folder, poses).ok();
    largest.filter(|sigma| *sigma > 0.0)
}
