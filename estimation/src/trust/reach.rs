//! Calibrations that cannot speak for the rest: poses that leave open where the plate stands elsewhere.
//!
//! Held-out poses lie among those that calibrate and show what is known there. So the standard deviation of the position
//! is looked up at other commands, too: each command at values that it took, but combined otherwise. Where most of these
//! poses are known less well than the errors that poses like the measured ones show, noise included, validation shows
//! less than there is: of one layer, of a line, of a plate that never turned.

use nalgebra::{Matrix3, Rotation3, SymmetricEigen, Vector3};
use tau_kinematics::{Machine, Sample, nearest_rotation, zyz};
use tau_robot::measurements::TcpPose;
use tau_robot::robot::Plate;
use tau_robot::robot_file::Noise;

use crate::numerics::order::extent;
use crate::numerics::{count, parallel};
use crate::uncertainty::Uncertainty;

/// Commands at which it is looked up: enough for a median to a fifth.
const COMMANDS: u16 = 48;

/// Knowledge of the position at the poses that calibrate, and elsewhere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reach {
    /// Standard deviation of the predicted position where commands are combined otherwise (m), three axes together, under
    /// the stated noise: half of the poses are known better.
    pub elsewhere_m: f64,
    /// Its root mean square at the poses that calibrate (m).
    pub poses_m: f64,
    /// Root mean square error of the position that such poses show: with the noise of their measurement (m).
    pub shown_m: f64,
    /// Lengths that the positions take up along the principal axes of their scatter, largest first (m).
    pub spread_m: [f64; 3],
    /// Largest turn of the plate from its mean orientation (rad).
    pub turn_rad: f64,
    /// Freedoms of the plate.
    pub plate: Plate,
}

impl Reach {
    /// Of a machine with parameters so far known. `None` where the poses can't be predicted.
    pub(crate) fn new(
        machine: &Machine,
        uncertainty: &Uncertainty,
        poses: &[&TcpPose],
        noise: Noise,
    ) -> Option<Self> {
        let at = |sample: &Sample<'_>| -> Option<f64> {
            let known = uncertainty.pose(machine, sample).ok()?;
            Some(known.distance_m()).filter(|distance| distance.is_finite())
        };
        // As many of the poses as commands.
        let step = poses.len().div_ceil(usize::from(COMMANDS)).max(1);
        let some: Vec<&TcpPose> = poses.iter().step_by(step).copied().collect();
        let known: Vec<f64> = (parallel::map(&some, |&pose| at(&pose.into())).into_iter())
            .flatten()
            .collect();
        let squares: f64 = known.iter().map(|distance| distance * distance).sum();
        let poses_m = (squares / known.len() as f64).sqrt();
        let values: Vec<Vec<f64>> = (0..machine.robot.commands)
            .map(|k| {
                let mut values: Vec<f64> = poses.iter().map(|pose| pose.commands_m[k]).collect();
                values.sort_by(f64::total_cmp);
                values
            })
            .collect();
        let combined: Vec<Vec<f64>> = combined(&values).collect();
        let elsewhere = parallel::map(&combined, |commands_m| {
            let off = |pose: &TcpPose| -> f64 {
                let pairs = pose.commands_m.iter().zip(commands_m);
                pairs.map(|(a, b)| (a - b).powi(2)).sum()
            };
            let near = (poses.iter()).min_by(|a, b| off(a).total_cmp(&off(b)))?;
            let start = Sample {
                commands_m,
                ..Sample::from(*near)
            };
            at(&start.at(machine.forward_fitted(&start).ok()?.pose))
        });
        let mut elsewhere: Vec<f64> = elsewhere.into_iter().flatten().collect();
        elsewhere.sort_by(f64::total_cmp);
        Some(Self {
            elsewhere_m: *elsewhere.get(elsewhere.len() / 2)?,
            poses_m,
            shown_m: poses_m.hypot(3.0_f64.sqrt() * noise.position_m),
            spread_m: principal_spread(poses),
            turn_rad: largest_turn(poses),
            plate: machine.robot.plate,
        })
    }

    /// True if poses like those that calibrate show as much as there is elsewhere.
    pub fn speaks_for_rest(&self) -> bool {
        self.elsewhere_m <= self.shown_m
    }
}

/// Commands each at one of its values, ascending, combined evenly: by the additive recurrence of powers of the generalised
/// golden ratio, the root of g^(d+1) = g + 1 in d dimensions.
fn combined(values: &[Vec<f64>]) -> impl Iterator<Item = Vec<f64>> {
    let power = (values.len() as f64 + 1.0).recip();
    let golden = (0..64).fold(2.0_f64, |g, _| (1.0 + g).powf(power));
    (1..=COMMANDS).map(move |index| {
        let mut place = 1.0;
        let along = |values: &Vec<f64>| {
            place /= golden;
            let share = (0.5 + f64::from(index) * place).fract();
            let index = count(share * values.len() as f64);
            values.get(index).copied().unwrap_or_default()
        };
        values.iter().map(along).collect()
    })
}

fn largest_turn(poses: &[&TcpPose]) -> f64 {
    let rotations = || poses.iter().map(|pose| zyz(pose.angles_rad));
    let mean = nearest_rotation(rotations().map(Rotation3::into_inner).sum());
    rotations()
        .map(|rotation| rotation.angle_to(&mean))
        .fold(0.0, f64::max)
}

fn principal_spread(poses: &[&TcpPose]) -> [f64; 3] {
    let positions: Vec<Vector3<f64>> = poses.iter().map(|pose| pose.position_m.into()).collect();
    let mean = positions.iter().sum::<Vector3<f64>>() / positions.len().max(1) as f64;
    let scatter: Matrix3<f64> = positions
        .iter()
        .map(|position| (position - mean) * (position - mean).transpose())
        .sum();
    let axes = SymmetricEigen::new(scatter).eigenvectors;
    let mut spread = [0, 1, 2].map(|k| {
        let along = positions
            .iter()
            .map(|position| position.dot(&axes.column(k)));
        let (low, high) = extent(along);
        (high - low).max(0.0)
    });
    spread.sort_by(|a, b| b.total_cmp(a));
    spread
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every stretch of a command, and every box of a grid, holds its share of the combinations.
    #[test]
    fn commands_are_combined_evenly() {
        let values: Vec<f64> = (0..60).map(f64::from).collect();
        let found: Vec<Vec<f64>> = combined(&[values.clone(), values]).collect();
        let share = |is: &dyn Fn(&[f64]) -> bool| {
            found.iter().filter(|point| is(point)).count() as f64 / found.len() as f64
        };
        for (low, high) in [(0.0, 30.0), (15.0, 45.0), (45.0, 60.0)] {
            let inside = share(&|point| (low..high).contains(&point[0]));
            assert!((inside - (high - low) / 60.0).abs() < 0.07, "{inside}");
        }
        let corner = share(&|point| point[0] < 30.0 && point[1] >= 30.0);
        assert!((corner - 0.25).abs() < 0.07, "{corner}");
    }

    #[test]
    fn a_layer_is_thin_however_it_lies() {
        let poses: Vec<TcpPose> = (0..60)
            .map(|index| {
                let (a, b) = (f64::from(index % 8) / 8.0, f64::from(index / 8) / 16.0);
                TcpPose {
                    pose: 1,
                    line: 2,
                    commands_m: vec![],
                    position_m: [a, b, 3.0 + a - b],
                    angles_rad: [0.0; 3],
                    conditions: tau_robot::measurements::Conditions::default(),
                    directions: None,
                    tensions_n: None,
                    sigmas: tau_robot::measurements::PoseSigmas::default(),
                }
            })
            .collect();
        let [first, second, third] = principal_spread(&poses.iter().collect::<Vec<_>>());
        assert!(first > second && second > 0.3 && third < 1e-12);
    }
}
