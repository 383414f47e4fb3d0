//! Start of the fit of all sets.

use nalgebra::Vector3;
use tau_kinematics::track_axes;
use tau_robot::robot_file::Noise;

use super::{Component, Joint};
use crate::joint::variant::{ROTATIONS, TURNING};
use crate::machine::Line;
use crate::samples::Sample;

impl Joint {
    /// Start of the fit of all sets: values that fit set 1, and carts that turn as set 2 sees them.
    pub fn start(&self, values: &[f64], samples: &[Sample], noise: Noise) -> Vec<f64> {
        let variant = &self.machine.variant;
        let mut values = values.to_vec();
        let residuals = self.residuals(&self.fitted(&values), &vec![1.0; self.rows.len()]);
        for track in 0..self.machine.robot.tracks.len() {
            let mut points: Vec<(f64, Vector3<f64>)> = Vec::new();
            for (row, at) in self.rows.iter().enumerate() {
                let sample = &samples[at.sample];
                if at.component == Component::CartRotation && sample.track == Some(track) {
                    if at.residual == 3 {
                        points.push((sample.commands_m[track], Vector3::zeros()));
                    }
                    if let Some((_, turn)) = points.last_mut() {
                        turn[at.residual - 3] = residuals[row] * noise.rotation_rad;
                    }
                }
            }
            let joints = self.machine.joint_lines(track);
            let (Some(line), Some([_, direction])) = (Line::fit(&points), joints.first()) else {
                continue;
            };
            for (target, axis) in ROTATIONS.iter().zip(track_axes(*direction)) {
                let name = format!(
                    "{TURNING}({}).{}",
                    self.machine.robot.tracks[track],
                    target.name()
                );
                let mut parameters = variant.parameters.iter();
                let rate = parameters.position(|parameter| parameter.name == name);
                if let Some(rate) = rate {
                    values[rate] -= line.direction.dot(&axis);
                }
            }
        }
        self.fitted(&values)
    }
}
