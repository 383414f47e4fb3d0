//! Forces in the links and on the carts, from the load that the arm carries and the drives that pull.

use nalgebra::{DMatrix, Rotation3, Vector3};
use tau_robot::robot::{Plate, Robot, Value};
use tau_robot::robot_file::{Dimensions, Payload, RobotFile};

use super::Pose;
use super::least_norm::least_norm;

/// The arm as a framework of rods under its payload and pulls, with nominal dimensions: the forces change by
/// parts in ten thousand with calibration.
#[derive(Debug, Clone)]
pub struct Statics {
    payload: Option<Payload>,
    plate: Plate,
    links: Vec<Rod>,
    tracks: usize,
}

#[derive(Debug, Clone)]
struct Rod {
    plate_joint: Vector3<f64>,
    track_offset: Vector3<f64>,
    direction: Vector3<f64>,
    /// Centre and axis of the crank that carries it.
    crank: Option<[Vector3<f64>; 2]>,
    track: Option<usize>,
    /// Tension to which its drive is controlled (N).
    pull_n: Option<f64>,
}

/// Forces at one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Forces {
    /// Tension of each link (N), positive where it pulls the plate towards the cart.
    pub tensions_n: Vec<f64>,
    /// Force of the arm on each cart (N): along its track, horizontally across it, and in the third
    /// direction; on a crank along x, y, z.
    pub loads_n: Vec<[f64; 3]>,
}

impl Statics {
    /// `None` where there is neither a payload nor a known pull, a pull is not known, or not all dimensions of the links
    /// are.
    pub fn new(robot: &Robot, file: &RobotFile) -> Option<Self> {
        let dimensions = Dimensions::new(robot, file);
        let links: Vec<Rod> = (0..robot.links.len())
            .map(|link| Rod::new(robot, dimensions, link))
            .collect::<Option<_>>()?;
        let is_loaded = file.payload.is_some() || links.iter().any(|rod| rod.pull_n.is_some());
        is_loaded.then_some(Self {
            payload: file.payload,
            plate: robot.plate,
            links,
            tracks: robot.tracks.len(),
        })
    }

    /// Forces that hold the plate in equilibrium in its freedoms at a pose; where more drives hold their position than
    /// there are conditions of equilibrium, the smallest such forces.
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
                let rod = rod.joint(q) - pose.position - lever;
                rod.try_normalize(0.0).unwrap_or_default()
            })
            .collect();
        let freedoms = self.plate.freedoms();
        let wrench = |link: usize, motion: usize| {
            let (force, lever) = (towards_cart[link], levers[link]);
            if motion < 3 {
                force[motion]
            } else {
                lever.cross(&force)[motion - 3]
            }
        };
        let (weight, moment) = self.payload.map_or_else(Default::default, |payload| {
            let weight = Vector3::from(payload.gravity_m_s2) * payload.mass_kg;
            let lever = pose.rotation * Vector3::from(payload.centre_m);
            (weight, lever.cross(&weight))
        });
        let pulled = |motion: usize| -> f64 {
            let pulls = self.links.iter().enumerate();
            pulls
                .filter_map(|(link, rod)| Some(wrench(link, motion) * rod.pull_n?))
                .sum()
        };
        let load = DMatrix::from_fn(freedoms.len(), 1, |row, _| {
            let motion = freedoms[row];
            let of_payload = if motion < 3 {
                weight[motion]
            } else {
                moment[motion - 3]
            };
            -of_payload - pulled(motion)
        });
        let holding: Vec<usize> = (0..self.links.len())
            .filter(|&link| self.links[link].pull_n.is_none())
            .collect();
        let wrenches = DMatrix::from_fn(freedoms.len(), holding.len(), |row, column| {
            wrench(holding[column], freedoms[row])
        });
        let held = least_norm(&wrenches, &load);
        let pulls = self.links.iter().map(|rod| rod.pull_n.unwrap_or(0.0));
        let mut tensions: Vec<f64> = pulls.collect();
        for (row, &link) in holding.iter().enumerate() {
            tensions[link] = held.as_ref().map_or(0.0, |held| held[(row, 0)]);
        }
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
    fn new(robot: &Robot, dimensions: Dimensions<'_>, link: usize) -> Option<Self> {
        let vector = |value| dimensions.vector(link, value).map(Vector3::from);
        let track = robot.clusters.get(robot.links[link].cluster)?.track;
        let model = robot.model.as_ref();
        let pull = model.and_then(|model| model.links.get(link)?.pull.as_ref());
        Some(Self {
            plate_joint: vector(Value::PlateJoint)?,
            track_offset: vector(Value::TrackOffset)?,
            direction: vector(Value::TrackDirection)?,
            crank: track
                .and_then(|track| dimensions.crank(track))
                .map(|crank| crank.map(Vector3::from)),
            track,
            pull_n: match pull {
                Some(pull) => Some(pull.value?[0]),
                None => None,
            },
        })
    }

    /// The joint on the cart, the crank or the base at a command.
    fn joint(&self, command: f64) -> Vector3<f64> {
        match self.crank {
            Some([centre, axis]) => {
                centre + Rotation3::new(axis * command) * (self.track_offset - centre)
            }
            None => self.track_offset + self.direction * command,
        }
    }
}

/// The frame of a track: along its direction v, horizontally across it (ẑ × v), and the third
/// direction (v × (ẑ × v)), unit vectors. On a track within 25° of vertical x̂ takes the place of ẑ,
/// as in the generated code.
pub fn track_axes(direction: Vector3<f64>) -> [Vector3<f64>; 3] {
    /// cos² 25°, rounded as in the generated code.
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
