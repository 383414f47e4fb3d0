//! From the tracker frames of sets 2 and 3 to the measurement frame.

use nalgebra::{Matrix3, Rotation3, Vector3};
use tau_kinematics::{nearest_rotation, xyz};
use tau_robot::measurements::Folder;
use tau_robot::robot::{Robot, Value as Geometry};
use tau_robot::robot_file::{Dimensions, LinkValues, RobotFile, Value};

/// Distance at which a target may be mounted from its cart's reference point (m), one standard deviation per
/// axis: nobody measures it.
pub const MOUNTING_M: f64 = 0.1;
/// Tolerance of a direction that the file does not give with one, as where it follows from a formula.
const DIRECTION_TOLERANCE: f64 = 1e-2;

/// Straight line with even scale through points at commands: `origin + q · direction`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Point at q = 0 (m).
    pub origin: Vector3<f64>,
    /// Motion per command, not normalised.
    pub direction: Vector3<f64>,
}

/// A track by the robot file: the mean over the joints that ride on its cart.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NominalTrack {
    /// Reference point of the cart at q = 0, and direction, in the measurement frame.
    pub line: Line,
    /// One standard deviation of the direction per axis.
    pub direction_tolerance: f64,
    /// One standard deviation of the reference point per axis (m).
    pub offset_tolerance_m: f64,
}

/// The rigid transform from a tracker frame to the measurement frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Registration {
    /// Rotation.
    pub rotation: Rotation3<f64>,
    /// Translation (m), applied after the rotation.
    pub translation: Vector3<f64>,
}

impl Line {
    /// Least-squares line through points (m) at commands (m); `None` where all commands are the same.
    pub fn fit(points: &[(f64, Vector3<f64>)]) -> Option<Self> {
        let count = points.len() as f64;
        let mean_q = points.iter().map(|(q, _)| q).sum::<f64>() / count;
        let mean = points.iter().map(|(_, point)| point).sum::<Vector3<f64>>() / count;
        let spread: f64 = points.iter().map(|(q, _)| (q - mean_q).powi(2)).sum();
        if spread.is_nan() || spread < 1e-12 {
            return None;
        }
        let direction = points
            .iter()
            .map(|(q, point)| (point - mean) * (q - mean_q))
            .sum::<Vector3<f64>>()
            / spread;
        Some(Self {
            origin: mean - direction * mean_q,
            direction,
        })
    }

    /// Point at a command (m).
    pub fn at(&self, command: f64) -> Vector3<f64> {
        self.origin + self.direction * command
    }
}

impl NominalTrack {
    /// Every track of a robot; `None` of a crank, and where neither links, by their values or formulas, nor clusters give
    /// its place.
    pub fn all(robot: &Robot, file: &RobotFile) -> Vec<Option<Self>> {
        (0..robot.tracks.len())
            .map(|track| Self::of(robot, file, track))
            .collect()
    }

    fn of(robot: &Robot, file: &RobotFile, track: usize) -> Option<Self> {
        if robot.is_angle(track) {
            return None;
        }
        let dimensions = Dimensions::new(robot, file);
        let shared = file
            .tracks
            .get(&robot.tracks[track])
            .and_then(|v| v.track_direction.as_ref());
        let tolerance = |value: Option<&Value>| value.map_or(0.0, |value| value.tol);
        let links = robot.links_of_track(track).into_iter().map(|link| {
            let line = Line {
                origin: dimensions.vector(link, Geometry::TrackOffset)?.into(),
                direction: dimensions.vector(link, Geometry::TrackDirection)?.into(),
            };
            let stated = file.links.get(&robot.links[link].name);
            let direction = stated.and_then(|values| values.track_direction.as_ref());
            let offset = stated.and_then(|values| values.track_offset.as_ref());
            Some((line, tolerance(direction.or(shared)), tolerance(offset)))
        });
        let clusters = robot
            .clusters
            .iter()
            .filter(|cluster| cluster.track == Some(track));
        let clusters = clusters.filter_map(|cluster| file.clusters.get(&cluster.name));
        let of_cluster = |values: &LinkValues| {
            let direction = values.track_direction.as_ref().or(shared)?;
            let offset = values.track_offset.as_ref()?;
            let line = Line {
                origin: vector(offset)?,
                direction: vector(direction)?,
            };
            Some((line, direction.tol, offset.tol))
        };
        let mut places: Vec<(Line, f64, f64)> = links.flatten().collect();
        if places.is_empty() {
            places = clusters.filter_map(of_cluster).collect();
        }
        if places.is_empty() {
            return None;
        }
        let count = places.len() as f64;
        let mean = |of: fn(&Line) -> Vector3<f64>| {
            places
                .iter()
                .map(|(line, ..)| of(line))
                .sum::<Vector3<f64>>()
                / count
        };
        let tolerance = |of: fn(&(Line, f64, f64)) -> f64| {
            places.iter().map(of).sum::<f64>() / count / count.sqrt()
        };
        let direction_tolerance = tolerance(|place| place.1);
        Some(Self {
            line: Line {
                origin: mean(|line| line.origin),
                direction: mean(|line| line.direction),
            },
            direction_tolerance: if direction_tolerance > 0.0 {
                direction_tolerance
            } else {
                DIRECTION_TOLERANCE
            },
            offset_tolerance_m: tolerance(|place| place.2),
        })
    }
}

/// Means of the firsts and of the seconds of some pairs of places, about which the best rotation turns them (W. Kabsch, Acta
/// Crystallographica A32, 1976).
pub(crate) fn centres(
    pairs: impl ExactSizeIterator<Item = [Vector3<f64>; 2]>,
) -> [Vector3<f64>; 2] {
    let count = pairs.len() as f64;
    let sums = pairs.fold([Vector3::zeros(); 2], |[a, b], own| {
        [a + own[0], b + own[1]]
    });
    sums.map(|sum| sum / count)
}

/// The rotation nearest to a sum of products of vectors with those that it turns; a plane is turned in itself alone.
pub(crate) fn turn_of(products: Matrix3<f64>, is_in_plane: bool) -> Rotation3<f64> {
    if is_in_plane {
        let (along, across) = (products.m11 + products.m22, products.m21 - products.m12);
        Rotation3::from_axis_angle(&Vector3::z_axis(), across.atan2(along))
    } else {
        nearest_rotation(products)
    }
}

impl Registration {
    /// Registers measured lines, one per track, on the nominal tracks; `None` where no track has both.
    ///
    /// Least squares over all rotations (Kabsch, by singular values) of two kinds of vectors, each
    /// weighted by its variance: the directions of the tracks, and their separations from each
    /// other. The directions leave the turn about themselves open where the tracks are parallel; the
    /// separations settle it, but only as well as the targets' unknown places on the carts
    /// ([`MOUNTING_M`]) are small against them.
    pub fn of(tracks: &[Option<NominalTrack>], measured: &[Option<Line>]) -> Option<Self> {
        let pairs: Vec<(&NominalTrack, &Line)> = tracks
            .iter()
            .zip(measured)
            .filter_map(|(track, line)| Some((track.as_ref()?, line.as_ref()?)))
            .collect();
        if pairs.is_empty() {
            return None;
        }
        let origins = pairs
            .iter()
            .map(|(track, line)| [track.line.origin, line.origin]);
        let [nominal_centre, measured_centre] = centres(origins);
        let correlation: Matrix3<f64> = pairs
            .iter()
            .map(|(track, line)| {
                let separation = 1.0 / (MOUNTING_M.powi(2) + track.offset_tolerance_m.powi(2));
                track.line.direction * line.direction.transpose()
                    / track.direction_tolerance.powi(2)
                    + (track.line.origin - nominal_centre)
                        * (line.origin - measured_centre).transpose()
                        * separation
            })
            .sum();
        let rotation = nearest_rotation(correlation);
        Some(Self {
            rotation,
            translation: nominal_centre - rotation * measured_centre,
        })
    }

    /// Set 2 of a folder; `None` where it is missing. Where the file holds calibrated track rotations,
    /// the first of them is the rotation.
    pub(crate) fn of_set_2(robot: &Robot, file: &RobotFile, folder: &Folder) -> Option<Self> {
        let measured: Vec<Option<Line>> = (0..robot.tracks.len())
            .map(|track| Line::fit(&set_2(folder, track)))
            .collect();
        let registration = Self::of(&NominalTrack::all(robot, file), &measured)?;
        let calibrated = file
            .links
            .values()
            .chain(file.clusters.values())
            .chain(file.tracks.values())
            .find_map(|values| rotation(values.track_rotation.as_ref()?));
        Some(match calibrated {
            Some(rotation) => Self {
                rotation,
                ..registration
            },
            None => registration,
        })
    }

    /// A point in the measurement frame (m).
    pub fn apply(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.rotation * point + self.translation
    }
}

/// Points (m) of set 2 on a track at their commands (m), in the tracker frame.
pub(crate) fn set_2(folder: &Folder, track: usize) -> Vec<(f64, Vector3<f64>)> {
    folder
        .cart_poses
        .iter()
        .filter(|pose| pose.track == track)
        .map(|pose| (pose.command_m, pose.position_m.into()))
        .collect()
}

/// Points (m) of set 3 on a track at their commands (m), in the tracker frame.
pub(crate) fn set_3(folder: &Folder, track: usize) -> Vec<(f64, Vector3<f64>)> {
    folder
        .cart_positions
        .iter()
        .filter(|position| position.track == track)
        .filter_map(|position| Some((*position.commands_m.get(track)?, position.position_m.into())))
        .collect()
}

fn vector(value: &Value) -> Option<Vector3<f64>> {
    <[f64; 3]>::try_from(value.value.as_slice())
        .ok()
        .map(Vector3::from)
}

fn rotation(value: &Value) -> Option<Rotation3<f64>> {
    <[f64; 3]>::try_from(value.value.as_slice()).ok().map(xyz)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_known_transform_is_found_despite_mounting_offsets() {
        let track = |y: f64, z: f64| NominalTrack {
            line: Line {
                origin: Vector3::new(-3.0, y, z),
                direction: Vector3::new(0.998, -0.066, -0.005),
            },
            direction_tolerance: 1e-2,
            offset_tolerance_m: 1e-2,
        };
        let tracks = [track(-4.9, 0.7), track(-3.4, 0.7), track(-4.8, -0.7)];
        let truth = xyz([2.0, -1.2, 0.7]);
        let shift = Vector3::new(1.0, 2.0, 3.0);
        let measured = |mounting: f64| {
            tracks.map(|track| {
                let mounted =
                    track.line.origin + Vector3::new(0.0, mounting, 0.0) * track.line.origin.z;
                Some(Line {
                    origin: truth.inverse() * (mounted - shift),
                    direction: truth.inverse() * track.line.direction,
                })
            })
        };
        let exact = Registration::of(&tracks.map(Some), &measured(0.0)).unwrap();
        assert!((exact.rotation.matrix() - truth.matrix()).norm() < 1e-12);
        assert!(
            (exact.apply(measured(0.0)[1].unwrap().origin) - tracks[1].line.origin).norm() < 1e-12
        );
        // A decimetre of mounting turns the frame about the tracks, hardly across them.
        let mounted = Registration::of(&tracks.map(Some), &measured(0.1)).unwrap();
        let along = mounted.rotation * (truth.inverse() * tracks[0].line.direction);
        assert!(mounted.rotation.angle_to(&truth) > 1e-3);
        assert!((along - tracks[0].line.direction).norm() < 1e-4);
    }
}
