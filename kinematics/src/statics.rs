//! Forces in the links and on the carts, from the load that the arm carries and the drives that pull.

use nalgebra::{DMatrix, Vector3};
use tau_robot::robot::{Plate, Robot};
use tau_robot::robot_file::{Dimensions, Joints, Payload, RobotFile};

use super::Pose;
use super::least_norm::least_norm;

/// The arm as a framework of rods under its payload and pulls, with the dimensions of a file.
#[derive(Debug, Clone)]
pub struct Statics {
    payload: Option<Payload>,
    plate: Plate,
    links: Vec<Rod>,
    tracks: usize,
}

#[derive(Debug, Clone)]
struct Rod {
    joints: Joints,
    /// Tension to which its drive is controlled (N).
    pull_n: Option<f64>,
    /// True if that is known to a tolerance.
    is_uncertain: bool,
}

/// Forces at one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct Forces {
    /// Tension of each link (N), positive where it pulls the plate towards the cart.
    pub tensions_n: Vec<f64>,
    /// Force of the arm on each cart (N): along its track, horizontally across it, and in the third
    /// direction; on a crank along x, y, z.
    pub loads_n: Vec<[f64; 3]>,
    /// Share of each pull that is known to a tolerance.
    pub by_pull: Vec<ByPull>,
}

/// Share of a pull in the forces at a pose: they are linear in it.
#[derive(Debug, Clone, PartialEq)]
pub struct ByPull {
    /// Index of the link that is pulled.
    pub link: usize,
    /// Tension (N) to which it is.
    pub pull_n: f64,
    /// Tension of each link for each newton of that.
    pub tensions: Vec<f64>,
    /// Force on each cart for each newton, as [`Forces::loads_n`].
    pub loads: Vec<[f64; 3]>,
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

    /// Largest distance (m) of a joint of the links from that of another drawing of the same arm: over links of a metre forces
    /// differ by as large a share.
    pub fn joints_apart_m(&self, other: &Self) -> f64 {
        let pairs = self.links.iter().zip(&other.links);
        let apart = pairs.map(|(own, other)| {
            let on_plate = (own.joints.plate - other.joints.plate).norm();
            on_plate.max((own.joints.offset - other.joints.offset).norm())
        });
        apart.fold(0.0, f64::max)
    }

    /// Forces that hold the plate in equilibrium in its freedoms at a pose; where more drives hold their position than
    /// there are conditions of equilibrium, the smallest such forces.
    pub fn forces(&self, pose: &Pose, commands_m: &[f64]) -> Forces {
        let frame = Frame::of(self, pose, commands_m);
        let (weight, moment) = self.payload.map_or_else(Default::default, |payload| {
            let weight = Vector3::from(payload.gravity_m_s2) * payload.mass_kg;
            let lever = pose.rotation * Vector3::from(payload.centre_m);
            (weight, lever.cross(&weight))
        });
        let pulls: Vec<f64> = (self.links.iter())
            .map(|rod| rod.pull_n.unwrap_or(0.0))
            .collect();
        let tensions_n = frame.tensions(weight, moment, &pulls);
        let uncertain = self.links.iter().enumerate();
        let uncertain = uncertain.filter(|(_, rod)| rod.is_uncertain);
        let by_pull = uncertain.map(|(link, rod)| {
            let mut one = vec![0.0; self.links.len()];
            one[link] = 1.0;
            let tensions = frame.tensions(Vector3::zeros(), Vector3::zeros(), &one);
            ByPull {
                link,
                pull_n: rod.pull_n.unwrap_or(0.0),
                loads: frame.loads(&tensions),
                tensions,
            }
        });
        Forces {
            by_pull: by_pull.collect(),
            loads_n: frame.loads(&tensions_n),
            tensions_n,
        }
    }
}

/// The framework at a pose.
struct Frame<'s> {
    statics: &'s Statics,
    /// From the tool centre point to each plate joint.
    levers: Vec<Vector3<f64>>,
    /// Unit vector along each link, away from the plate.
    directions: Vec<Vector3<f64>>,
}

impl<'s> Frame<'s> {
    fn of(statics: &'s Statics, pose: &Pose, commands_m: &[f64]) -> Self {
        let links = statics.links.iter();
        let levers: Vec<Vector3<f64>> = links
            .clone()
            .map(|rod| pose.rotation * rod.joints.plate)
            .collect();
        let directions = links.zip(&levers).map(|(rod, lever)| {
            let command = rod.joints.track.and_then(|track| commands_m.get(track));
            let rod = rod.joints.at(command.copied().unwrap_or(0.0)) - pose.position - lever;
            rod.try_normalize(0.0).unwrap_or_default()
        });
        Self {
            directions: directions.collect(),
            statics,
            levers,
        }
    }

    /// Tensions under a force and a moment about the tool centre point on the plate; `pulls` has those of links that are
    /// pulled.
    fn tensions(&self, force: Vector3<f64>, moment: Vector3<f64>, pulls: &[f64]) -> Vec<f64> {
        let freedoms = self.statics.plate.freedoms();
        let wrench = |link: usize, motion: usize| {
            let (direction, lever) = (self.directions[link], self.levers[link]);
            if motion < 3 {
                direction[motion]
            } else {
                lever.cross(&direction)[motion - 3]
            }
        };
        let (pulled, holding): (Vec<usize>, Vec<usize>) =
            (0..pulls.len()).partition(|&link| self.statics.links[link].pull_n.is_some());
        let load = DMatrix::from_fn(freedoms.len(), 1, |row, _| {
            let motion = freedoms[row];
            let outer = if motion < 3 {
                force[motion]
            } else {
                moment[motion - 3]
            };
            let by_pulls: f64 = (pulled.iter())
                .map(|&link| wrench(link, motion) * pulls[link])
                .sum();
            -outer - by_pulls
        });
        let wrenches = DMatrix::from_fn(freedoms.len(), holding.len(), |row, column| {
            wrench(holding[column], freedoms[row])
        });
        let held = least_norm(&wrenches, &load);
        let mut tensions = pulls.to_vec();
        for (row, &link) in holding.iter().enumerate() {
            tensions[link] = held.as_ref().map_or(0.0, |held| held[(row, 0)]);
        }
        tensions
    }

    /// Forces on the carts, as [`Forces::loads_n`].
    fn loads(&self, tensions: &[f64]) -> Vec<[f64; 3]> {
        let tracks = self.statics.tracks;
        let mut forces = vec![Vector3::zeros(); tracks];
        let mut directions = vec![Vector3::zeros(); tracks];
        let links = self.statics.links.iter().zip(&self.directions);
        for ((rod, direction), tension) in links.zip(tensions) {
            if let Some(track) = rod.joints.track {
                forces[track] -= direction * *tension;
                directions[track] += rod.joints.direction;
            }
        }
        forces
            .iter()
            .zip(&directions)
            .map(|(force, direction)| track_axes(*direction).map(|axis| force.dot(&axis)))
            .collect()
    }
}

impl Rod {
    fn new(robot: &Robot, dimensions: Dimensions<'_>, link: usize) -> Option<Self> {
        let own = robot.links.get(link)?;
        let pull_n = dimensions.pull_n(link);
        // Without the tension of a link that is pulled no forces are known.
        (pull_n.is_some() == own.pull.is_some()).then_some(Self {
            joints: dimensions.joints(link)?,
            pull_n,
            is_uncertain: own.uncertain_pull().is_some(),
        })
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
