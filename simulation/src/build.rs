//! The machine that a robot file describes, and the one that was built instead.

use nalgebra::{Rotation3, Vector3};
use tau_codegen::language;
use tau_codegen::language::model::{Link, Plate, Quantity, Value as Geometry};
use tau_robot::input_error::{Errors, InputError};
use tau_robot::robot::{Arm, Robot, Variant};
use tau_robot::robot_file::{LinkValues, Reference, RobotFile, Value};

use super::effect::Conditions;
use super::machine::{Machine, Pose, Rod, least_norm};
use super::random::Random;

/// Differences of the true machine from its drawings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Build {
    /// Exactly as the robot file says.
    Exact,
    /// Drawn at random from the tolerances.
    ///
    /// Carts are rigid: what the joints of a cart have in common is drawn from the tolerances of the
    /// tracks, each joint's own error on its cart from that of the plate joints, and the cart turns by
    /// some 100 µrad a metre.
    Drawn {
        /// Share of the tolerance of lengths and joints.
        links: f64,
        /// Share of the tolerance of the tracks' offsets and directions: tracks stand in place far
        /// better than a first guess of the tracker's frame says.
        tracks: f64,
    },
}

impl Default for Build {
    fn default() -> Self {
        Self::Drawn {
            links: 1.0,
            tracks: 0.1,
        }
    }
}

/// Farthest that the machine may stand from its reference, over the mean length of its links; twice as much in rad.
const ROUGH: f64 = 0.1;
/// Rotation of a drawn machine's carts along their track (rad/m), one standard deviation.
const CART_TURN: f64 = 1e-4;

/// One standard deviation of each quantity of a link, SI.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tolerances {
    length: f64,
    plate_joint: f64,
    track_offset: f64,
    track_direction: f64,
}

/// The machine of the drawings, with the tolerances of its links.
pub(super) fn nominal(
    robot: &Robot,
    file: &RobotFile,
) -> Result<(Machine, Vec<Tolerances>), InputError> {
    not_simulated(robot)?;
    // Without a text, as for a robot made by hand, nothing is described.
    let links = language::check_text(&robot.description).map_or_else(|_| vec![], |m| m.links);
    let mut errors = Errors::default();
    let mut tolerances = Vec::new();
    let mut rods = Vec::new();
    for (index, link) in robot.links.iter().enumerate() {
        let track = robot.clusters[link.cluster].track;
        let mut tolerance = Tolerances::default();
        let mut find = |quantity: &str, of: fn(&LinkValues) -> &Option<Value>, tol: &mut f64| {
            let shared = track.and_then(|track| file.tracks.get(&robot.tracks[track]));
            let stated = [file.links.get(&link.name), shared]
                .into_iter()
                .flatten()
                .find_map(|values| of(values).as_ref());
            let found = match stated {
                Some(value) => Some((value.value.clone(), value.tol)),
                None => links.get(index).and_then(|link| described(link, quantity)),
            };
            if let Some((values, own)) = found {
                *tol = own;
                values
            } else {
                errors.add(InputError::whole(
                    "robot.toml",
                    format!(
                        "the virtual robot needs the {quantity} of link `{}`",
                        link.name
                    ),
                ));
                vec![0.0; 3]
            }
        };
        let length = find("length", |v| &v.length, &mut tolerance.length);
        let plate_joint = find(
            "plate_joint",
            |v| &v.plate_joint,
            &mut tolerance.plate_joint,
        );
        let offset = find(
            "track_offset",
            |v| &v.track_offset,
            &mut tolerance.track_offset,
        );
        let direction = match track {
            Some(_) => find(
                "track_direction",
                |v| &v.track_direction,
                &mut tolerance.track_direction,
            ),
            None => vec![0.0; 3],
        };
        let vector =
            |values: &[f64]| Vector3::from_fn(|i, _| values.get(i).copied().unwrap_or(0.0));
        rods.push(Rod {
            length_m: length.first().copied().unwrap_or(0.0),
            plate_joint_m: vector(&plate_joint),
            track_offset_m: vector(&offset),
            track_direction: vector(&direction),
            track,
            actuated_by: link.actuated_by,
        });
        tolerances.push(tolerance);
    }
    errors.finish()?;
    let machine = Machine {
        rods,
        tracks: robot.tracks.len(),
        commands: robot.commands,
        payload: file.payload,
        effects: Vec::new(),
    };
    Ok((machine, tolerances))
}

/// Refuses machines of which the virtual robot knows nothing.
fn not_simulated(robot: &Robot) -> Result<(), InputError> {
    let Some(model) = &robot.model else {
        return Ok(());
    };
    let what = if model.plate != Plate::Body {
        format!("a plate that is a {}", model.plate.written())
    } else if model.tracks.iter().any(|track| track.crank.is_some()) {
        "cranks".to_owned()
    } else if (model.links.iter()).any(|link| {
        Geometry::ALL
            .into_iter()
            .any(|value| link.defaults.formula(value).is_some())
    }) {
        "links whose values are formulas or exact".to_owned()
    } else {
        return Ok(());
    };
    let message = format!("the virtual robot knows no machines with {what}");
    Err(InputError::whole(&robot.name, message).help(
        "it simulates bodies on carts and on links of driven length, with values of their own",
    ))
}

/// Values and tolerance of a link's quantity that the description itself gives.
fn described(link: &Link, quantity: &str) -> Option<(Vec<f64>, f64)> {
    let given = &link.defaults;
    let vector = |quantity: &Quantity<3>| {
        let tolerance = quantity.tolerance.unwrap_or(0.0);
        Some((quantity.value?.to_vec(), tolerance))
    };
    match quantity {
        "length" => {
            let length = &given.length;
            Some((length.value?.to_vec(), length.tolerance.unwrap_or(0.0)))
        }
        "plate_joint" => vector(&given.plate_joint),
        "track_offset" => vector(&given.track_offset),
        "track_direction" => vector(&given.track_direction),
        _ => None,
    }
}

/// A machine drawn from the tolerances.
pub(super) fn drawn(
    nominal: &Machine,
    tolerances: &[Tolerances],
    (links, tracks): (f64, f64),
    random: &mut Random,
) -> Machine {
    let mut machine = nominal.clone();
    for (rod, tolerance) in machine.rods.iter_mut().zip(tolerances) {
        rod.length_m += links * tolerance.length * random.normal();
        rod.plate_joint_m += random.normals() * (links * tolerance.plate_joint);
        // A joint on a cart is made like one on the plate.
        rod.track_offset_m += random.normals() * (links * tolerance.plate_joint);
    }
    for track in 0..machine.tracks {
        let on_cart: Vec<usize> = (0..machine.rods.len())
            .filter(|&k| machine.rods[k].track == Some(track))
            .collect();
        let Some(&first) = on_cart.first() else {
            continue;
        };
        let shift = random.normals() * (tracks * tolerances[first].track_offset);
        let swing = random.normals() * (tracks * tolerances[first].track_direction);
        let turn = random.normals() * (links * CART_TURN);
        let direction = nominal.direction(track) + swing;
        let centre = on_cart
            .iter()
            .map(|&k| machine.rods[k].track_offset_m)
            .sum::<Vector3<f64>>()
            / on_cart.len() as f64;
        for &k in &on_cart {
            let rod = &mut machine.rods[k];
            rod.track_direction = direction + turn.cross(&(rod.track_offset_m - centre));
            rod.track_offset_m += shift;
        }
    }
    machine
}

/// Makes the machine as simple as a variant takes it: with a reduced arm, the links of a cluster
/// parallel and of one length at the given orientation; without paths per link, one direction a cart.
pub(super) fn simplify(machine: &mut Machine, robot: &Robot, variant: &Variant, home: Pose) {
    for (track, model) in variant.tracks.iter().enumerate() {
        if !model.per_link {
            let direction = machine.direction(track);
            for rod in machine
                .rods
                .iter_mut()
                .filter(|rod| rod.track == Some(track))
            {
                rod.track_direction = direction;
            }
        }
    }
    if variant.arm != Arm::Reduced {
        return;
    }
    for cluster in 0..robot.clusters.len() {
        let links = robot.links_of_cluster(cluster);
        let Some(&first) = links.first() else {
            continue;
        };
        let count = links.len() as f64;
        let arm = |rod: &Rod| rod.track_offset_m - home.rotation * rod.plate_joint_m;
        let mean = links
            .iter()
            .map(|&k| arm(&machine.rods[k]))
            .sum::<Vector3<f64>>()
            / count;
        let length = links.iter().map(|&k| machine.rods[k].length_m).sum::<f64>() / count;
        let direction = machine.rods[first]
            .track
            .map(|track| machine.direction(track));
        for &k in &links {
            let rod = &mut machine.rods[k];
            rod.track_offset_m = mean + home.rotation * rod.plate_joint_m;
            rod.length_m = length;
            rod.track_direction = direction.unwrap_or_else(Vector3::zeros);
        }
    }
}

/// The pose at all commands zero, along the straight way from the commands at which a reference says where the machine
/// stands; `None` where the rods do not meet near it, or do not hold the plate.
pub(super) fn home(machine: &Machine, reference: &Reference) -> Option<Pose> {
    let bare = Machine {
        payload: None,
        effects: Vec::new(),
        ..machine.clone()
    };
    let stated = Pose {
        position_m: reference.position_m.into(),
        rotation: zyz(reference.orientation_rad),
    };
    let conditions = Conditions::default();
    let found = bare.solve(&reference.commands_m, &conditions, stated)?.pose;
    let is_near = (found.position_m - stated.position_m).norm() < ROUGH * machine.mean_length_m()
        && found.rotation.angle_to(&stated.rotation) < 2.0 * ROUGH;
    let farthest = reference
        .commands_m
        .iter()
        .fold(0.0, |far: f64, q| far.max(q.abs()));
    let steps = (farthest / (WAY * machine.mean_length_m())).ceil();
    let (mut pose, mut step) = (found, 0.0);
    while step < steps {
        step += 1.0;
        let rest = 1.0 - step / steps;
        let commands: Vec<f64> = reference.commands_m.iter().map(|q| q * rest).collect();
        pose = bare.solve(&commands, &conditions, pose)?.pose;
    }
    (is_near && firmness(&bare, pose) > 1e-4).then_some(pose)
}

/// The rotation Rz(alpha)·Ry(beta)·Rz(gamma).
fn zyz([alpha, beta, gamma]: [f64; 3]) -> Rotation3<f64> {
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    about(Vector3::z_axis(), alpha)
        * about(Vector3::y_axis(), beta)
        * about(Vector3::z_axis(), gamma)
}

/// Smallest singular value of the change of the rods' lengths with the plate's motion, rotation counted
/// at the plate joints.
fn firmness(machine: &Machine, pose: Pose) -> f64 {
    let levers: Vec<Vector3<f64>> = machine
        .rods
        .iter()
        .map(|rod| pose.rotation * rod.plate_joint_m)
        .collect();
    let lever =
        (levers.iter().map(Vector3::norm_squared).sum::<f64>() / levers.len() as f64).sqrt();
    let matrix = nalgebra::DMatrix::from_fn(levers.len(), 6, |k, column| {
        let along = (pose.position_m + levers[k] - machine.rods[k].track_offset_m).normalize();
        if column < 3 {
            along[column]
        } else {
            levers[k].cross(&along)[column - 3] / lever.max(1e-9)
        }
    });
    if matrix.nrows() < 6 {
        0.0
    } else {
        matrix.singular_values().min()
    }
}

/// Pose and commands (m) of the machine of the drawings, as a controller computes them.
#[derive(Debug, Clone)]
pub(super) struct Commanded {
    pub(super) pose: Pose,
    pub(super) commands_m: Vec<f64>,
}

/// Length of the steps on the way to a target, as a share of the mean link length: long ones would
/// jump from one side of a cart to the other.
const WAY: f64 = 0.05;

impl Commanded {
    /// Commands that bring the TCP of the machine, without load and errors, to a position (m); `None`
    /// where it is out of reach. The orientation is what the arm leaves it, nearest to the one before.
    pub(super) fn towards(&self, machine: &Machine, target_m: Vector3<f64>) -> Option<Self> {
        let way = target_m - self.pose.position_m;
        let steps = (way.norm() / (WAY * machine.mean_length_m()))
            .ceil()
            .max(1.0);
        let mut here = self.clone();
        let mut step = 0.0;
        while step < steps {
            step += 1.0;
            let position = self.pose.position_m + way * (step / steps);
            here = here.near(machine, position)?;
        }
        Some(here)
    }

    /// Commands and orientation at a position (m) close by.
    pub(super) fn near(&self, machine: &Machine, position_m: Vector3<f64>) -> Option<Self> {
        let mut here = Self {
            pose: Pose {
                position_m,
                ..self.pose
            },
            ..self.clone()
        };
        for _ in 0..30 {
            let unknowns = 3 + machine.commands;
            let mut matrix = nalgebra::DMatrix::zeros(machine.rods.len(), unknowns);
            let mut gap = nalgebra::DVector::zeros(machine.rods.len());
            for (k, rod) in machine.rods.iter().enumerate() {
                let lever = here.pose.rotation * rod.plate_joint_m;
                let travel = rod.track.map_or(0.0, |track| here.commands_m[track]);
                let driven = rod
                    .actuated_by
                    .map_or(0.0, |command| here.commands_m[command]);
                let way = position_m + lever - rod.track_offset_m - rod.track_direction * travel;
                let along = way.normalize();
                gap[k] = rod.length_m + driven - way.norm();
                let moment = lever.cross(&along);
                for axis in 0..3 {
                    matrix[(k, axis)] = moment[axis];
                }
                if let Some(track) = rod.track {
                    matrix[(k, 3 + track)] = -along.dot(&rod.track_direction);
                }
                if let Some(command) = rod.actuated_by {
                    matrix[(k, 3 + command)] = -1.0;
                }
            }
            let step = least_norm(matrix, &gap)?;
            here.pose.rotation =
                Rotation3::new(Vector3::new(step[0], step[1], step[2])) * here.pose.rotation;
            for (command, change) in here.commands_m.iter_mut().zip(step.iter().skip(3)) {
                *command += change;
            }
            if step.amax() > 1.0 {
                return None;
            }
            if step.amax() < 1e-11 {
                here.pose.rotation.renormalize();
                return Some(here);
            }
        }
        None
    }
}
