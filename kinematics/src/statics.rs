//! Forces in the links and on the carts, from the load that the arm carries.

use nalgebra::{DMatrix, Vector3};
use tau_robot::robot::Robot;
use tau_robot::robot_file::{LinkValues, Payload, RobotFile};

use super::Pose;
use super::least_norm::least_norm;

/// The arm as a framework of rods under its payload, with nominal dimensions: the forces change by
/// parts in ten thousand with calibration.
#[derive(Debug, Clone)]
pub struct Statics {
    payload: Payload,
    links: Vec<Rod>,
    tracks: usize,
}

#[derive(Debug, Clone)]
struct Rod {
    plate_joint: Vector3<f64>,
    track_offset: Vector3<f64>,
    direction: Vector3<f64>,
    track: Option<usize>,
}

/// Forces at one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Forces {
    /// Tension of each link (N), positive where it pulls the plate towards the cart.
    pub tensions_n: Vec<f64>,
    /// Force of the arm on each cart (N): along its track, horizontally across it, and in the third
    /// direction.
    pub loads_n: Vec<[f64; 3]>,
}

impl Statics {
    /// `None` where the file states no payload or not all dimensions of the links.
    pub fn new(robot: &Robot, file: &RobotFile) -> Option<Self> {
        let payload = file.payload?;
        let links = robot
            .links
            .iter()
            .map(|link| {
                let values = file.links.get(&link.name)?;
                let track = robot.clusters.get(link.cluster)?.track;
                Rod::new(values, track)
            })
            .collect::<Option<Vec<_>>>()?;
        Some(Self {
            payload,
            links,
            tracks: robot.tracks.len(),
        })
    }

    /// Forces that hold the payload in equilibrium at a pose; where there are more links than
    /// conditions of equilibrium, the smallest such forces.
    pub fn forces(&self, pose: &Pose, commands_m: &[f64]) -> Forces {
        let levers: Vec<Vector3<f64>> = self
            .links
            .iter()
            .map(|rod| pose.rotation * rod.plate_joint)
            .collect();
        let towards_cart: Vec<Vector3<f64>> = self
            .links
            .iter()
            .zip(&levers)
            .map(|(rod, lever)| {
                let q = rod
                    .track
                    .and_then(|track| commands_m.get(track))
                    .copied()
                    .unwrap_or(0.0);
                let rod = rod.track_offset + rod.direction * q - pose.position - lever;
                rod.try_normalize(0.0).unwrap_or_default()
            })
            .collect();
        let wrenches = DMatrix::from_fn(6, self.links.len(), |row, link| {
            let (force, lever) = (towards_cart[link], levers[link]);
            if row < 3 {
                force[row]
            } else {
                lever.cross(&force)[row - 3]
            }
        });
        let weight = Vector3::from(self.payload.gravity_m_s2) * self.payload.mass_kg;
        let moment = (pose.rotation * Vector3::from(self.payload.centre_m)).cross(&weight);
        let load = DMatrix::from_fn(6, 1, |row, _| {
            if row < 3 {
                -weight[row]
            } else {
                -moment[row - 3]
            }
        });
        let tensions: Vec<f64> = least_norm(&wrenches, &load).map_or_else(
            || vec![0.0; self.links.len()],
            |t| t.iter().copied().collect(),
        );
        let mut forces = vec![Vector3::zeros(); self.tracks];
        let mut directions = vec![Vector3::zeros(); self.tracks];
        for ((rod, direction), tension) in self.links.iter().zip(&towards_cart).zip(&tensions) {
            if let Some(track) = rod.track {
                forces[track] -= direction * *tension;
                directions[track] += rod.direction;
            }
        }
        let loads_n = forces
            .iter()
            .zip(&directions)
            .map(|(force, direction)| track_axes(*direction).map(|axis| force.dot(&axis)))
            .collect();
        Forces {
            tensions_n: tensions,
            loads_n,
        }
    }
}

impl Rod {
    fn new(values: &LinkValues, track: Option<usize>) -> Option<Self> {
        let vector = |value: &tau_robot::robot_file::Value| -> Option<Vector3<f64>> {
            <[f64; 3]>::try_from(value.value.as_slice())
                .ok()
                .map(Vector3::from)
        };
        let direction = match track {
            Some(_) => vector(values.track_direction.as_ref()?)?,
            None => Vector3::zeros(),
        };
        Some(Self {
            plate_joint: vector(values.plate_joint.as_ref()?)?,
            track_offset: vector(values.track_offset.as_ref()?)?,
            direction,
            track,
        })
    }
}

/// The frame of a track: along its direction v, horizontally across it (ẑ × v), and the third
/// direction (v × (ẑ × v)), unit vectors. On a track within 25° of vertical x̂ takes the place of ẑ,
/// as in the generated code.
pub fn track_axes(direction: Vector3<f64>) -> [Vector3<f64>; 3] {
    const STEEPEST: f64 = 0.82;
    let along = direction.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let reference = if along.z * along.z < STEEPEST {
        Vector3::z()
    } else {
        Vector3::x()
    };
    let horizontal = reference.cross(&along).normalize();
    [along, horizontal, along.cross(&horizontal)]
}
