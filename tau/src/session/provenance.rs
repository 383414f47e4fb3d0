//! Provenance of calibrated values.

use std::collections::BTreeSet;

use tau_estimation::calibration::{Calibration, Prepared};
use tau_estimation::numerics::order::extent;
use tau_estimation::uncertainty::Uncertainty;
use tau_estimation::unknown_poses::{EstimatedPoses, RowDivision, UnknownPoses};
use tau_kinematics::Machine;
use tau_robot::fingerprint;
use tau_robot::measurements::{Distance, Folder, TcpPose};
use tau_robot::robot_file::Provenance;
use tau_robot::{Robot, prototype};

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
