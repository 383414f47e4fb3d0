//! Euler angles of set 2, told by their noise.
//!
//! A cart hardly turns, so that angles of any convention run smoothly along its track. Their noise tells: it is the stated
//! one in all directions, which angles about other axes show larger in one and smaller in another. How densely angles lie
//! about a rotation belongs to its probability; it is the sine of the second angle where the first axis comes back, else its
//! cosine.

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Vector3};
use tau_robot::measurements::{CART_POSES, CartPose, Folder};
use tau_robot::robot::{Plate, Robot};

use crate::numerics::distribution::exceeds_noise;
use crate::trust::ODDS;
use crate::trust::hypothesis::{Hypothesis, angles};
use crate::trust::mistake::Mistake;
use crate::trust::words;

/// Points side by side, along which a cart turns evenly: a line through them takes two, so that most of them tell noise.
const POINTS: usize = 6;

/// Noise of the rotations of all carts, read in some way.
#[derive(Clone, Copy)]
struct Scatter {
    chi2: f64,
    dof: f64,
    /// −2 ln of the probability of the angles.
    surprise: f64,
}

impl Scatter {
    fn is_beyond_noise(&self) -> bool {
        exceeds_noise(self.chi2, self.dof)
    }
}

/// Angles of the carts that are others than those asked for: with these the noise is as stated (rad), as given it is not.
pub(super) fn mistake(robot: &Robot, folder: &Folder, noise_rad: f64) -> Option<Mistake> {
    let runs = runs(folder);
    if noise_rad.is_nan() || noise_rad <= 0.0 || runs.is_empty() {
        return None;
    }
    let given = scatter(&runs, None, noise_rad);
    if !given.is_beyond_noise() {
        return None;
    }
    let all = angles(Plate::Body);
    let decisive = 2.0 * ODDS.ln();
    let limit = given.surprise - decisive - 2.0 * (all.len() as f64).ln();
    let all = all
        .into_iter()
        .map(|own| (scatter(&runs, Some(&own), noise_rad), own));
    let right: Vec<_> = all
        .filter(|(own, _)| own.surprise < limit && !own.is_beyond_noise())
        .collect();
    let least = right
        .iter()
        .map(|(own, _)| own.surprise)
        .fold(f64::INFINITY, f64::min);
    // Of those that are about as likely the best known comes first.
    let likely = right
        .iter()
        .filter(|(own, _)| own.surprise < least + decisive);
    let named = likely.filter_map(|(_, own)| words::of_measurements(robot, own, CART_POSES));
    words::beside(named.collect())
}

/// Points of each cart on its way in one direction, a few side by side.
fn runs(folder: &Folder) -> Vec<Vec<&CartPose>> {
    let mut ways: BTreeMap<(usize, bool), Vec<&CartPose>> = BTreeMap::new();
    for pose in &folder.cart_poses {
        let is_back = pose.direction.is_some_and(|direction| direction < 0.0);
        ways.entry((pose.track, is_back)).or_default().push(pose);
    }
    let mut runs = vec![];
    for mut way in ways.into_values() {
        way.sort_by(|a, b| a.command_m.total_cmp(&b.command_m));
        runs.extend(
            way.chunks(POINTS)
                .filter(|run| run.len() > 2)
                .map(<[_]>::to_vec),
        );
    }
    runs
}

fn scatter(runs: &[Vec<&CartPose>], read: Option<&Hypothesis>, noise_rad: f64) -> Scatter {
    let axes = match read {
        Some(Hypothesis::Angles { axes, .. }) => *axes,
        _ => [2, 1, 2],
    };
    let rotation = |pose: &CartPose| match read {
        Some(own) => own.rotation(pose.angles_rad),
        None => tau_kinematics::zyz(pose.angles_rad),
    };
    let density = |pose: &CartPose| {
        let second = pose.angles_rad[1];
        let density = if axes[0] == axes[2] {
            second.sin()
        } else {
            second.cos()
        };
        density.abs().max(f64::MIN_POSITIVE).ln()
    };
    let mut all = Scatter {
        chi2: 0.0,
        dof: 0.0,
        surprise: 0.0,
    };
    for run in runs {
        let first: Rotation3<f64> = rotation(run[0]).inverse();
        let turns: Vec<Vector3<f64>> = (run.iter())
            .map(|pose| (first * rotation(pose)).scaled_axis())
            .collect();
        let commands: Vec<f64> = run.iter().map(|pose| pose.command_m).collect();
        let (squares, left) = about_line(&commands, &turns);
        let density = run.iter().map(|pose| density(pose)).sum::<f64>() / run.len() as f64;
        let chi2 = squares / noise_rad.powi(2);
        all.chi2 += chi2;
        all.dof += 3.0 * left;
        all.surprise += chi2 - 2.0 * left * density;
    }
    all
}

/// Squares that a straight line through points leaves, and the number of points beyond those that it takes.
fn about_line(at: &[f64], points: &[Vector3<f64>]) -> (f64, f64) {
    let count = at.len() as f64;
    let middle = at.iter().sum::<f64>() / count;
    let mean = points.iter().sum::<Vector3<f64>>() / count;
    let width: f64 = at.iter().map(|at| (at - middle).powi(2)).sum();
    let pairs = || at.iter().zip(points);
    let slope = pairs()
        .map(|(at, point)| point * (at - middle))
        .sum::<Vector3<f64>>();
    let slope = if width > 0.0 {
        slope / width
    } else {
        Vector3::zeros()
    };
    let squares = pairs().map(|(at, point)| (point - mean - slope * (at - middle)).norm_squared());
    let taken = if width > 0.0 { 2.0 } else { 1.0 };
    (squares.sum(), count - taken)
}
