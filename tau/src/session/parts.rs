//! Measurements by the part that they take, and how a robot file meets those that are new to it.

use std::collections::BTreeSet;
use tau_robot::input_error;

use tau_codes::fit;
use tau_estimation::calibration::Error;
use tau_estimation::evaluation::{Evaluation, evaluate_knowing};
use tau_estimation::trust::{Status, Verdict};
use tau_estimation::unknown_poses::{self, HeldErrors, JudgedRows, RowDivision};
use tau_robot::InputError;
use tau_robot::measurements::{Division, PoseCounts, Shape, Split};
use tau_robot::robot::Variant;

use super::{Session, VariantKey};

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

/// Errors of measurements by parameters that are held.
#[derive(Debug, Clone)]
pub struct Evaluated {
    /// Relation of the measurements to the calibration of the parameters.
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

    /// Measurements by the part that a split gives them: all of the plate where poses are unknown, else the poses in range.
    pub(super) fn divided(&self, split: Split) -> RowDivision {
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

    /// The measurements by which the robot file can be judged, and what they are to it. Distances between poses at which
    /// redundant drives calibrated took part, too.
    fn unseen(&self, asked: Option<Split>) -> Result<(JudgedRows, Basis), InputError> {
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
            input_error!(fit::NONE_IN_RANGE, &self.folder.name;
                "none of the {total} poses has all its commands in the measured range")
        })
    }

    /// Errors of measurements with the parameters of the session's robot file, the true pose of each being unknown: see
    /// [`unknown_poses::evaluate`]; mistakes explain them where they are not consistent.
    fn held_errors(&self, variant: &Variant, rows: &JudgedRows) -> Result<HeldErrors, Error> {
        let setup = self.setup(variant);
        let mut held = unknown_poses::evaluate(setup, rows, &self.options())?;
        if held.verdict().status > Status::Consistent && held.mistakes.is_empty() {
            held.mistakes = unknown_poses::mistakes(setup, &rows.division())?;
        }
        Ok(held)
    }

    /// Evaluates the session's robot file on measurements that are new to it: of the folder that it was calibrated on those that
    /// took no part, of another folder all; of a split that is asked for, those that validate among them. Poses that were
    /// measured are predicted; where poses are unknown, all measurements are compared, the parameters held.
    ///
    /// # Errors
    /// No pose lies in the range; the split leaves no measurement; as [`Self::machine`]; no pose can be predicted; the
    /// measurements leave nothing to judge the machine by.
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
            compared: match &rows {
                Some(rows) if poses.is_empty() => rows.poses,
                _ => poses.len(),
            },
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
