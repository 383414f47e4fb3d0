//! The least-squares problem: all sets, with the true poses of set 1 among the unknowns.

use tau_kinematics::Machine;
use tau_robot::robot_file::Noise;
use tau_solver::{Parameter, Problem, Solution};

use crate::calibration::{Error, Prepared};
use crate::problem::{self, Closures, Component, POSE_UNKNOWNS, Part, Residuals};
use crate::samples::Sample;

/// A variant with all its measurements, as residuals.
pub struct AllSets {
    pub(super) machine: Machine,
    pub(super) residuals: Residuals,
    noise: Noise,
    /// Standard deviation of a link's length at the true pose (m).
    closure_m: f64,
}

/// Sum of squared residuals of a group, in units of the stated noise, and their number.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Misfit {
    pub(super) squares: f64,
    pub(super) count: usize,
}

impl AllSets {
    pub(super) fn new(
        prepared: Prepared,
        samples: &[Sample],
        noise: Noise,
        closure_m: f64,
    ) -> Result<Self, Error> {
        let Prepared {
            machine, nominal, ..
        } = prepared;
        let closures = Closures::AtTruePose(closure_m);
        Ok(Self {
            residuals: Residuals::new(&machine, &nominal, samples, noise, closures)?,
            machine,
            noise,
            closure_m,
        })
    }

    /// Standard deviation of a link's length at the true pose (m).
    pub fn closure_m(&self) -> f64 {
        self.closure_m
    }

    /// Reciprocal standard deviation (1/m²) of each closure at each pose: poses × closures, row-major.
    pub fn closure_weights(&self) -> &[f64] {
        &self.residuals.parts[0].weights
    }

    /// Number of residuals, measured poses of set 1 counted by their closures.
    pub(super) fn count(&self) -> usize {
        let parts = self.residuals.parts.iter();
        parts.map(|part| part.weights.len()).sum()
    }

    /// Number of unknowns that all poses share; those of the poses follow them.
    pub fn shared(&self) -> usize {
        self.residuals.used.len()
    }

    /// The problem, from values of the variant. `factors` are those by which the noise of each group of
    /// [`Component::ALL`] exceeds the stated one.
    ///
    /// The shared unknowns come first, then six for each pose: translation (m) and rotation vector (rad),
    /// in the measurement frame, from the measured pose to the true one. What was measured is their
    /// prior, with mean zero.
    pub fn problem(&self, values: &[f64], factors: [f64; 4]) -> Problem<'_> {
        let mut parameters = self.shared_parameters(values);
        let scale = factors[Component::Closure as usize];
        let axes = ["x", "y", "z", "about x", "about y", "about z"];
        for pose in &self.residuals.parts[0].numbers {
            for (axis, noise) in axes.iter().zip(self.pose_noise()) {
                parameters.push(
                    Parameter::new(format!("pose {pose} {axis}"), 0.0)
                        .with_prior(0.0, noise * scale),
                );
            }
        }
        let parts = self.residuals.parts.iter();
        Problem {
            parameters,
            blocks: parts
                .map(|part| part.scaled_block(self.shared(), factors))
                .collect(),
        }
    }

    /// The same to first order in the noise of the poses, without their unknowns: `whitened` holds the closures
    /// of a pose at the measured one, whitened together. What the data determine is read off this.
    pub(super) fn marginal<'a>(
        &'a self,
        whitened: &'a Part,
        values: &[f64],
        factors: [f64; 4],
    ) -> Problem<'a> {
        let parts = [whitened].into_iter().chain(&self.residuals.parts[1..]);
        Problem {
            parameters: self.shared_parameters(values),
            blocks: parts
                .map(|part| part.scaled_block(self.shared(), factors))
                .collect(),
        }
    }

    fn shared_parameters(&self, values: &[f64]) -> Vec<Parameter> {
        let Residuals { used, priors, .. } = &self.residuals;
        let start = used.iter().map(|&index| values[index]);
        problem::parameters(&self.machine.variant, used, priors, start)
    }

    /// Stated noise of a pose's unknowns: translation (m), then rotation (rad).
    fn pose_noise(&self) -> [f64; POSE_UNKNOWNS] {
        let (position, rotation) = (self.noise.position_m, self.noise.rotation_rad);
        [position, position, position, rotation, rotation, rotation]
    }

    /// Values of the whole variant at a solution.
    pub fn values(&self, solution: &Solution) -> Vec<f64> {
        problem::values(&self.machine, &self.residuals.used, &solution.parameters)
    }

    /// Misfit of each group of [`Component::ALL`] at a solution, in units of the stated noise. That of
    /// set 1 counts one for each closure: its six measured coordinates pay for the pose's six unknowns.
    pub(super) fn misfits(&self, solution: &Solution) -> [Misfit; 4] {
        let mut misfits = [Misfit::default(); 4];
        let (shared, poses) = solution.parameters.split_at(self.shared());
        for (unknown, noise) in poses.iter().zip(self.pose_noise().iter().cycle()) {
            misfits[Component::Closure as usize].squares += (unknown / noise).powi(2);
        }
        for part in &self.residuals.parts {
            let rows = part.weights.iter().zip(part.components());
            for ((weight, component), residual) in rows.zip(part.values(shared, poses)) {
                let misfit = &mut misfits[component as usize];
                if *weight > 0.0 {
                    misfit.squares += (residual * weight).powi(2);
                    misfit.count += 1;
                }
            }
        }
        misfits
    }
}
