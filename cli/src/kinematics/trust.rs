//! Standard deviations of predicted poses and commands, and a flag where the calibration does not reach.

use rayon::prelude::*;
use tau::Robot;
use tau::calibration::Prepared;
use tau::kinematics::{Machine, Reached};
use tau::robot_file::{Provenance, RobotFile};
use tau::uncertainty::{PoseUncertainty, Uncertainty};
use tau_codes::{Remark, kinematics as codes, remark};

use super::targets::Row;

/// Uncertainty of a robot file's values, with its record.
pub(super) struct Certainty {
    uncertainty: Option<Uncertainty>,
    record: Option<Provenance>,
    /// Factor of standard deviations over those by the stated noise.
    pub(super) widening: f64,
}

/// Certainty of a result.
#[derive(Default)]
pub(super) struct Known {
    /// Of the pose at the commands.
    pub(super) pose: Option<PoseUncertainty>,
    /// Standard deviations of the commands (m), where they were asked for.
    pub(super) commands_m: Option<Vec<f64>>,
    /// Why it lies outside the region of calibration; empty inside.
    pub(super) outside: Vec<Remark>,
    /// True if that is for want of knowledge of the position, not for a command.
    pub(super) is_uncertain: bool,
}

impl Certainty {
    pub(super) fn new(prepared: &Prepared, file: &RobotFile) -> Self {
        let widening = file.widening();
        Self {
            uncertainty: Uncertainty::of_prepared(prepared, file),
            record: file.calibration.clone(),
            widening,
        }
    }

    /// True if the file was calibrated, so that there is a region to lie in.
    pub(super) fn has_region(&self) -> bool {
        self.record.is_some()
    }

    /// True if standard deviations are known.
    pub(super) fn has_sigmas(&self) -> bool {
        self.uncertainty.is_some()
    }

    /// A remark where a calibrated file does not say how its values go together.
    pub(super) fn remark(&self) -> Option<Remark> {
        let is_lost = self.record.is_some() && self.uncertainty.is_none();
        is_lost.then(|| {
            let text = "the robot file holds no covariance of the variant's parameters, so that poses have no standard \
                        deviations: calibrate it again";
            Remark::new(tau_codes::kinematics::NO_COVARIANCE, text)
        })
    }

    /// Certainty of results, row by row.
    pub(super) fn of(
        &self,
        machine: &Machine,
        rows: &[Row],
        reached: &[Reached],
        with_commands: bool,
    ) -> Vec<Known> {
        let pairs = rows.par_iter().zip(reached);
        pairs
            .map(|(row, reached)| self.of_row(machine, row, reached, with_commands))
            .collect()
    }

    fn of_row(
        &self,
        machine: &Machine,
        row: &Row,
        reached: &Reached,
        with_commands: bool,
    ) -> Known {
        let sample = row.sample(&reached.commands_m, reached.pose);
        let known = self.uncertainty.as_ref();
        let widened = |pose: PoseUncertainty| pose.widened(self.widening);
        let pose = known.and_then(|known| known.pose_with_length_noise(machine, &sample).ok());
        let commands_m = known
            .filter(|_| with_commands)
            .and_then(|known| known.commands(machine, &sample).ok());
        let commands_m = commands_m.map(|commands_m| {
            let widened = commands_m.into_iter().map(|sigma| self.widening * sigma);
            widened.collect()
        });
        // The noise of drives and links is the same everywhere: where the calibration reaches is a matter of the parameters.
        let by_parameters = known.and_then(|known| known.pose(machine, &sample).ok());
        let by_parameters = by_parameters.map(widened);
        let (outside, is_uncertain) =
            self.outside(&machine.robot, &reached.commands_m, by_parameters.as_ref());
        Known {
            pose: pose.map(widened),
            commands_m,
            outside,
            is_uncertain,
        }
    }

    /// Reasons why commands, or the pose there, lie outside the region of calibration.
    fn outside(
        &self,
        robot: &Robot,
        commands_m: &[f64],
        pose: Option<&PoseUncertainty>,
    ) -> (Vec<Remark>, bool) {
        let Some(record) = &self.record else {
            return (vec![], false);
        };
        let ranges = commands_m.iter().zip(&record.commands_m).enumerate();
        let mut outside: Vec<Remark> = ranges
            .filter(|(_, (q, [low, high]))| *q < low || *q > high)
            .map(|(k, (q, [low, high]))| {
                let unit = if robot.is_angle(k) { "rad" } else { "m" };
                remark!(codes::BEYOND_RANGE;
                    "q{} is {q:.4} {unit}, calibrated were {low:.4} to {high:.4} {unit}", k + 1)
            })
            .collect();
        let largest = record.position_sigma_m.map(|sigma| self.widening * sigma);
        let uncertain = pose
            .map(PoseUncertainty::distance_m)
            .zip(largest)
            .filter(|(here, largest)| here > largest)
            .map(|(here, largest)| {
                remark!(codes::BEYOND_KNOWLEDGE;
                    "the position is known to {:.1} µm, at the poses that calibrated to {:.1} µm or better",
                        1e6 * here, 1e6 * largest)
            });
        let is_uncertain = uncertain.is_some();
        outside.extend(uncertain);
        if self.uncertainty.is_none() {
            outside.push(remark!(codes::NOT_CALIBRATED; "parameters of this variant were not calibrated with the others"));
        }
        (outside, is_uncertain)
    }
}

impl Known {
    /// Columns of a table of results, with their cells; what is not known has no number.
    pub(super) fn cells(
        &self,
        certainty: &Certainty,
        machine: &Machine,
        with_commands: bool,
    ) -> Vec<(String, String)> {
        let mut sigmas: Vec<(String, Option<f64>)> = Vec::new();
        let mut add = |names: Vec<String>, values: Option<Vec<f64>>| {
            let value = |k: usize| values.as_ref().map(|values| values[k]);
            let named = names.into_iter().enumerate();
            sigmas.extend(named.map(|(k, name)| (format!("sigma_{name}"), value(k))));
        };
        if certainty.has_sigmas() {
            let pose = self.pose.as_ref();
            let position_m = pose.map(|pose| pose.position_m().to_vec());
            add(["x_m", "y_m", "z_m"].map(String::from).into(), position_m);
            if machine.turns() {
                let names = ["rx_rad", "ry_rad", "rz_rad"].map(String::from);
                add(names.into(), pose.map(|pose| pose.rotation_rad().to_vec()));
            }
            if with_commands {
                add(machine.robot.command_columns(), self.commands_m.clone());
            }
        }
        let cell = |sigma: Option<f64>| {
            let known = sigma.filter(|sigma| sigma.is_finite());
            known.map_or_else(String::new, |sigma| format!("{sigma:.4e}"))
        };
        let cells = sigmas.into_iter().map(|(name, sigma)| (name, cell(sigma)));
        let is_inside = u8::from(self.outside.is_empty()).to_string();
        let inside = (certainty.has_region()).then(|| ("inside".to_owned(), is_inside));
        cells.chain(inside).collect()
    }
}
