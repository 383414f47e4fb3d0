//! Provenance of calibrated values, and the poses that took no part.

use std::collections::BTreeSet;

use tau_codes::fit;
use tau_estimation::calibration::{Calibration, Prepared};
use tau_estimation::numerics::order::extent;
use tau_estimation::uncertainty::Uncertainty;
use tau_estimation::unknown_poses::{EstimatedPoses, JudgedRows, RowDivision, UnknownPoses};
use tau_kinematics::Machine;
use tau_robot::fingerprint;
use tau_robot::measurements::{Distance, Folder, PoseCounts, Poses, Shape, Split, TcpPose};
use tau_robot::robot_file::Provenance;
use tau_robot::{InputError, Robot, prototype};

use super::{Input, Session, Stamp};

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

    /// The same of measurements whose poses are unknown.
    pub(super) fn provenance_of_rows(&self, found: &UnknownPoses) -> Provenance {
        let division = self.row_division();
        let placed = EstimatedPoses::of(found, &self.robot_file, &self.folder, &division);
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
    pub(super) fn calibrating_rows(&self) -> BTreeSet<String> {
        let rows = if self.has_unknown_poses() {
            self.row_division()
        } else {
            let poses = self.poses().map(|poses| poses.division.calibration);
            RowDivision::of_poses(&self.folder, &poses.unwrap_or_default())
        };
        let of_poses = self.folder.fingerprints();
        let of_poses = of_poses.filter(|(pose, _)| rows.calibration.contains(pose));
        let distances = self.folder.distances.iter();
        let distances = distances.filter(|own| rows.distances.contains(&own.line));
        (of_poses.map(|(_, own)| own))
            .chain(distances.map(Distance::fingerprint))
            .collect()
    }

    /// Rows of this folder that calibrated the robot file; `None` where it does not say how it was calibrated.
    fn calibrated_rows(&self) -> Option<RowDivision> {
        let known = &self.robot_file.calibration.as_ref()?.rows;
        let of_poses = self.folder.fingerprints();
        let of_poses = of_poses.filter(|(_, own)| known.contains(own));
        let distances = self.folder.distances.iter();
        let distances = distances.filter(|own| known.contains(&own.fingerprint()));
        Some(RowDivision {
            calibration: of_poses.map(|(pose, _)| pose).collect(),
            distances: distances.map(|own| own.line).collect(),
            ..RowDivision::default()
        })
    }

    /// Poses of this folder, by index, that calibrated the robot file.
    pub(super) fn calibrated(&self) -> Vec<usize> {
        let known = self.calibrated_rows().unwrap_or_default().calibration;
        let poses = self.folder.tcp_poses.iter().enumerate();
        let own = poses.filter(|(_, pose)| known.contains(&pose.pose));
        own.map(|(index, _)| index).collect()
    }

    /// Poses, by index, without those that calibrated the robot file.
    fn without_calibrated(&self, poses: &[usize]) -> Vec<usize> {
        let known = self.calibrated_rows().unwrap_or_default().calibration;
        let is_new = |pose: &&usize| !known.contains(&self.folder.tcp_poses[**pose].pose);
        poses.iter().filter(is_new).copied().collect()
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

    /// The poses that validate, without those on which the robot file was calibrated.
    pub(super) fn validating(&self) -> Result<Vec<usize>, InputError> {
        let validating = self.without_calibrated(&self.poses()?.division.validation);
        if validating.is_empty() {
            let message = "all poses that validate took part in the calibration of the robot file";
            return Err(
                InputError::whole(fit::NOTHING_HELD_OUT, &self.folder.name, message)
                    .help("take another split or another folder"),
            );
        }
        Ok(validating)
    }

    /// The poses on which the robot file can be judged, and what they are to it: of the folder that it was calibrated on
    /// those that took no part, of another folder all. A split that is asked for takes its validation poses of them.
    ///
    /// # Errors
    /// No pose lies in the range; the split leaves none.
    pub fn unseen(&self, asked: Option<Split>) -> Result<(Vec<usize>, Basis), InputError> {
        let record = self.robot_file.calibration.as_ref();
        if asked.is_some() || record.is_none() {
            // Mistakes in a split are reported here.
            self.poses()?;
        }
        let in_range = self
            .folder
            .in_range(&self.robot_file, &Shape::from(&self.robot));
        let mut poses = match (asked, record) {
            (Some(split), _) => self.folder.divide(split, &in_range).validation,
            (None, None) => self.folder.divide(self.split, &in_range).validation,
            (None, Some(_)) => in_range.clone(),
        };
        let basis = if record.is_none() {
            match asked.unwrap_or(self.split) {
                Split::All => Basis::NewFolder,
                _ => Basis::Split,
            }
        } else if self.without_calibrated(&in_range).len() == in_range.len() {
            Basis::NewFolder
        } else {
            let unseen = self.without_calibrated(&poses);
            if unseen.is_empty() {
                Basis::Calibration
            } else {
                poses = unseen;
                Basis::HeldOut
            }
        };
        if poses.is_empty() {
            let total = self.folder.tcp_poses.len();
            let message =
                format!("none of the {total} poses has all its commands in the measured range");
            return Err(InputError::whole(
                fit::NONE_IN_RANGE,
                &self.folder.name,
                message,
            ));
        }
        Ok((poses, basis))
    }

    /// Numbers of the poses by their part in what the robot file is judged by: the poses that [`Self::unseen`] gave.
    ///
    /// # Errors
    /// No pose lies in the range; the split leaves none.
    pub fn counts_of(&self, unseen: &[usize], basis: Basis) -> Result<PoseCounts, InputError> {
        let (robot, file, folder) = (&self.robot, &self.robot_file, &self.folder);
        let counts = Poses::select(robot, file, folder, self.split)?.counts;
        let in_range = folder.in_range(file, &Shape::from(robot));
        let unseen_in_all = self.without_calibrated(&in_range).len();
        Ok(PoseCounts {
            calibration: match basis {
                Basis::Split => counts.calibration,
                _ => in_range.len() - unseen_in_all,
            },
            validation: match basis {
                Basis::Calibration => 0,
                _ => unseen.len(),
            },
            ..counts
        })
    }

    /// The same of measurements whose poses are unknown. Of the folder that the robot file was calibrated on, distances
    /// between poses at which redundant drives calibrated took part, too.
    ///
    /// # Errors
    /// The split leaves no measurement.
    pub fn unseen_rows(&self, asked: Option<Split>) -> Result<(JudgedRows, Basis), InputError> {
        let record = self.robot_file.calibration.as_ref();
        let held_out = |split: Split| {
            let division = RowDivision::of(&self.folder, split);
            (division.validation, division.held_out_distances)
        };
        let (mut poses, mut distances) = match (asked, record) {
            (Some(split), _) => held_out(split),
            (None, None) => held_out(self.split),
            (None, Some(_)) => held_out(Split::All),
        };
        let mut are_fitted = false;
        let basis = match record {
            None if asked.unwrap_or(self.split) == Split::All => Basis::NewFolder,
            None => Basis::Split,
            Some(_) => {
                let calibrated = self.calibrated_rows().unwrap_or_default();
                let unseen = RowDivision {
                    validation: poses,
                    held_out_distances: distances,
                    ..calibrated
                };
                let judged = unseen.judged(&self.folder, self.robot.is_redundant());
                let is_seen = |pose| unseen.calibration.contains(pose);
                let is_known = |line| unseen.distances.contains(line);
                let overlaps =
                    judged.poses.iter().any(is_seen) || judged.distances.iter().any(is_known);
                JudgedRows {
                    poses,
                    distances,
                    are_fitted,
                } = judged;
                if unseen.calibration.is_empty() && unseen.distances.is_empty() {
                    Basis::NewFolder
                } else if overlaps {
                    Basis::Calibration
                } else {
                    Basis::HeldOut
                }
            }
        };
        if poses.is_empty() && distances.is_empty() {
            let message = "no measurement is left to judge the machine by";
            return Err(
                InputError::whole(fit::NOTHING_HELD_OUT, &self.folder.name, message)
                    .help("let fewer of them calibrate with `--split`, or measure more"),
            );
        }
        let judged = JudgedRows {
            poses,
            distances,
            are_fitted,
        };
        Ok((judged, basis))
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
