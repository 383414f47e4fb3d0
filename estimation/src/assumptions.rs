//! Checks of what the models assume, on the measurements alone (section III-C of the paper).

use nalgebra::{Matrix3, Rotation3, Vector3};
use serde::Serialize;
use tau_kinematics::{Path, Pose, nearest_rotation, track_axes, zyz};
use tau_robot::measurements::Folder;
use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;

use crate::machine::{
    Line, MOUNTING_M, Registration, centres, prepared::mean_rotation, set_2, set_3,
};
use crate::numerics::order::smallest_first;

/// Checks of what the models assume.
#[derive(Debug, Clone, Default, Serialize)]
pub struct Assumptions {
    /// Orientation over the grid, as deviation from the mean (Figure 4).
    pub orientation: Vec<OrientationPoint>,
    /// Deviation of each cart from a straight line (Figures 5 and 6); empty without set 2.
    pub linearity: Vec<TrackLinearity>,
    /// Set 3 against the paths of set 2; empty without both.
    #[serde(rename = "set_3_against_set_2")]
    pub sets: Vec<TrackComparison>,
}

/// Orientation of one pose against the mean orientation.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct OrientationPoint {
    /// Pose number.
    pub pose: u32,
    /// Measured TCP position (m).
    pub position_m: [f64; 3],
    /// Rotation vector in the measurement frame from the mean orientation (rad).
    pub deviation_rad: [f64; 3],
}

/// Deviation of a cart's path from a straight line with even scale.
#[derive(Debug, Clone, Serialize)]
pub struct TrackLinearity {
    /// Name of the track.
    pub track: String,
    /// One entry per point of set 2.
    pub points: Vec<PathDeviation>,
}

/// Deviation of a cart at a command, split parallel and orthogonal to the track.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PathDeviation {
    /// Command (m).
    pub q_m: f64,
    /// Along the track (µm).
    pub parallel_um: f64,
    /// Horizontal, orthogonal to the track (µm).
    pub horizontal_um: f64,
    /// The third direction (µm).
    pub vertical_um: f64,
}

/// Set 3 against the path of set 2, for one track.
#[derive(Debug, Clone, Serialize)]
pub struct TrackComparison {
    /// Name of the track.
    pub track: String,
    /// One entry per pose of set 3 inside the range.
    pub points: Vec<PathDeviation>,
    /// Root mean square of each direction (µm): parallel, horizontal, vertical.
    pub rms_um: [f64; 3],
}

/// Checks all assumptions that the folder's sets allow.
///
/// Directions of deviations are those of each track in the measurement frame, for which the frames of
/// sets 2 and 3 are registered on the nominal tracks of the robot file.
pub fn check(robot: &Robot, file: &RobotFile, folder: &Folder) -> Assumptions {
    let file = &file.completed(robot);
    Assumptions {
        orientation: orientation(folder),
        linearity: linearity(robot, file, folder),
        sets: compare_sets(robot, file, folder),
    }
}

/// Orientation of every TCP pose against the mean (Figure 4): a reduced arm takes it for constant.
fn orientation(folder: &Folder) -> Vec<OrientationPoint> {
    let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let Some(rotation) = mean_rotation(folder, &all) else {
        return Vec::new();
    };
    let mean = Pose {
        position: Vector3::zeros(),
        rotation,
    };
    let points = folder.tcp_poses.iter().map(|pose| OrientationPoint {
        pose: pose.pose,
        position_m: pose.position_m,
        deviation_rad: mean.turn_to(&zyz(pose.angles_rad)).into(),
    });
    points.collect()
}

/// Deviation of each cart of set 2 from a straight line with even scale (Figures 5 and 6): a linear
/// track takes it for zero. Tracks without points are left out.
fn linearity(robot: &Robot, file: &RobotFile, folder: &Folder) -> Vec<TrackLinearity> {
    let to_measurement_frame = Registration::of_set_2(robot, file, folder)
        .map_or_else(Rotation3::identity, |registration| registration.rotation);
    (0..robot.tracks.len())
        .filter_map(|track| {
            let points = set_2(folder, track);
            let line = Line::fit(&points)?;
            let axes = track_axes(to_measurement_frame * line.direction);
            let points = points
                .iter()
                .map(|&(q, point)| deviation(q, to_measurement_frame * (point - line.at(q)), axes))
                .collect();
            Some(TrackLinearity {
                track: robot.tracks[track].clone(),
                points,
            })
        })
        .collect()
}

/// Set 3 against the paths of set 2: whether a cart's position depends on its own command only. Poses
/// of set 3 beyond the ends of the paths are left out.
///
/// One rotation for all tracks and one mounting offset per cart carry set 3 onto the paths, by least
/// squares; as in the registration, the separations of the tracks stand in where the paths are so
/// straight that they leave the turn about themselves open.
fn compare_sets(robot: &Robot, file: &RobotFile, folder: &Folder) -> Vec<TrackComparison> {
    let to_measurement_frame = Registration::of_set_2(robot, file, folder)
        .map_or_else(Rotation3::identity, |registration| registration.rotation);
    let pairs: Vec<Option<Pairs>> = (0..robot.tracks.len())
        .map(|track| Pairs::new(folder, track, &to_measurement_frame))
        .collect();
    let Some(rotation) = alignment(file, &pairs) else {
        return Vec::new();
    };
    pairs
        .iter()
        .zip(&robot.tracks)
        .filter_map(|(pairs, track)| Some(pairs.as_ref()?.compare(track, &rotation)))
        .collect()
}

/// Points of one track in set 3 with the points of the path of set 2 at the same commands.
struct Pairs {
    commands: Vec<f64>,
    /// In the measurement frame, relative to their mean.
    path: Vec<Vector3<f64>>,
    /// In the frame of set 3, relative to their mean.
    measured: Vec<Vector3<f64>>,
    /// Mean of the path's points (m), in the measurement frame up to a translation.
    path_centre: Vector3<f64>,
    measured_centre: Vector3<f64>,
}

impl Pairs {
    fn new(folder: &Folder, track: usize, to_measurement_frame: &Rotation3<f64>) -> Option<Self> {
        let set_2 = set_2(folder, track);
        let path = Path::new(&set_2)?.turned(to_measurement_frame);
        let origin = to_measurement_frame * Line::fit(&set_2)?.origin;
        let (low, high) = path.range();
        let inside: Vec<(f64, Vector3<f64>)> = set_3(folder, track)
            .into_iter()
            .filter(|(q, _)| (low..=high).contains(q))
            .collect();
        if inside.is_empty() {
            return None;
        }
        let count = inside.len() as f64;
        let on_path: Vec<Vector3<f64>> = inside.iter().map(|&(q, _)| path.at(q)).collect();
        let path_mean = on_path.iter().sum::<Vector3<f64>>() / count;
        let measured_centre = inside.iter().map(|(_, point)| point).sum::<Vector3<f64>>() / count;
        Some(Self {
            commands: inside.iter().map(|&(q, _)| q).collect(),
            path: on_path.iter().map(|point| point - path_mean).collect(),
            measured: inside
                .iter()
                .map(|(_, point)| point - measured_centre)
                .collect(),
            path_centre: origin + path_mean,
            measured_centre,
        })
    }

    fn compare(&self, track: &str, rotation: &Rotation3<f64>) -> TrackComparison {
        let line: Vec<(f64, Vector3<f64>)> = self
            .commands
            .iter()
            .copied()
            .zip(self.path.iter().copied())
            .collect();
        let direction = Line::fit(&line).map_or_else(Vector3::x, |line| line.direction);
        let axes = track_axes(direction);
        let mut points: Vec<PathDeviation> = self
            .commands
            .iter()
            .zip(&self.path)
            .zip(&self.measured)
            .map(|((&q, path), measured)| deviation(q, rotation * measured - path, axes))
            .collect();
        smallest_first(&mut points, |point| point.q_m);
        let rms = |of: fn(&PathDeviation) -> f64| {
            (points.iter().map(|point| of(point).powi(2)).sum::<f64>() / points.len() as f64).sqrt()
        };
        let rms_um = [
            rms(|p| p.parallel_um),
            rms(|p| p.horizontal_um),
            rms(|p| p.vertical_um),
        ];
        TrackComparison {
            track: track.to_owned(),
            points,
            rms_um,
        }
    }
}

/// The rotation that best carries set 3 onto the paths.
fn alignment(file: &RobotFile, pairs: &[Option<Pairs>]) -> Option<Rotation3<f64>> {
    let present: Vec<&Pairs> = pairs.iter().flatten().collect();
    if present.is_empty() {
        return None;
    }
    let places = present
        .iter()
        .map(|pairs| [pairs.path_centre, pairs.measured_centre]);
    let [path_centre, measured_centre] = centres(places);
    let correlation: Matrix3<f64> = present
        .iter()
        .map(|pairs| {
            let paths: Matrix3<f64> = pairs
                .path
                .iter()
                .zip(&pairs.measured)
                .map(|(path, measured)| path * measured.transpose())
                .sum();
            // The targets may have been mounted anew between the sets: two unknown places.
            let separation = (pairs.path_centre - path_centre)
                * (pairs.measured_centre - measured_centre).transpose();
            paths / file.noise.position_m.powi(2) + separation / (2.0 * MOUNTING_M.powi(2))
        })
        .sum();
    Some(nearest_rotation(correlation))
}

fn deviation(q_m: f64, vector_m: Vector3<f64>, axes: [Vector3<f64>; 3]) -> PathDeviation {
    let [parallel_um, horizontal_um, vertical_um] = axes.map(|axis| vector_m.dot(&axis) * 1e6);
    PathDeviation {
        q_m,
        parallel_um,
        horizontal_um,
        vertical_um,
    }
}
