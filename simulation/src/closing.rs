//! Newton's method for a pose at which every rod has its length, or for commands at which it has.

use nalgebra::{DMatrix, DVector, Rotation3, Vector3};

use super::linear::least_norm;
use super::machine::{Machine, State};
use super::parts::Pose;

/// Step of the plate (m, rad) below which Newton's method has settled.
pub(crate) const SETTLED: f64 = 1e-12;
/// Step of commands (m) below which it has: commands are written to 1e-7.
const SETTLED_COMMANDS: f64 = 1e-11;
/// Length (m) that rods may lack: rounding.
const CLOSED: f64 = 1e-9;
/// Steps of Newton's method, which takes under ten from a place close by; damped ones from far off take more.
const NEWTON_STEPS: usize = 60;
/// The same of commands, which are sought near those of a place close by.
const COMMAND_STEPS: usize = 30;
/// Longest step of Newton's method, as a share of the mean link length and in rad.
const LONGEST_STEP: f64 = 0.3;
/// Step of an orientation or a crank (rad), or of another drive (m), at which commands are out of reach.
const OUT_OF_REACH: f64 = 1.0;

/// A rod at a pose.
struct Held {
    /// From its joint towards the plate, of length one.
    along: Vector3<f64>,
    /// Change of its length with the plate's rotation.
    moment: Vector3<f64>,
    /// Length that it lacks (m).
    gap_m: f64,
}

impl Held {
    fn new(pose: Pose, plate_joint: Vector3<f64>, joint: Vector3<f64>, length: f64) -> Self {
        let lever = pose.rotation * plate_joint;
        let rod = pose.position_m + lever - joint;
        let along = rod.normalize();
        Self {
            along,
            moment: lever.cross(&along),
            gap_m: length - rod.norm(),
        }
    }

    /// Change of its length with a motion of the plate: translation along x, y, z, then rotation about them.
    fn by_motion(&self, motion: usize) -> f64 {
        if motion < 3 {
            self.along[motion]
        } else {
            self.moment[motion - 3]
        }
    }
}

/// Translation and rotation vector by some of the plate's motions.
fn motion_of(motions: &[usize], amounts: &DVector<f64>) -> (Vector3<f64>, Vector3<f64>) {
    let (mut shift, mut turn) = (Vector3::zeros(), Vector3::zeros());
    for (&motion, &amount) in motions.iter().zip(amounts) {
        if motion < 3 {
            shift[motion] = amount;
        } else {
            turn[motion - 3] = amount;
        }
    }
    (shift, turn)
}

/// Pose at which every rod of a state has its length, in the freedoms of the plate.
pub(crate) fn pose(machine: &Machine, state: &State) -> Option<Pose> {
    let longest = LONGEST_STEP * machine.mean_length_m();
    let freedoms = machine.plate.freedoms();
    let mut pose = state.pose;
    for _ in 0..NEWTON_STEPS {
        let mut matrix = DMatrix::zeros(machine.rods.len(), freedoms.len());
        let mut gap = DVector::zeros(machine.rods.len());
        for k in 0..machine.rods.len() {
            let (joint, length) = (state.joints_m[k], state.lengths_m[k]);
            let held = Held::new(pose, state.plate_joints_m[k], joint, length);
            gap[k] = held.gap_m;
            for (column, &motion) in freedoms.iter().enumerate() {
                matrix[(k, column)] = held.by_motion(motion);
            }
        }
        let step = least_norm(matrix, &gap)?;
        let (mut shift, mut turn) = motion_of(freedoms, &step);
        let scale = (shift.norm() / longest)
            .max(turn.norm() / LONGEST_STEP)
            .max(1.0);
        shift /= scale;
        turn /= scale;
        pose = Pose {
            position_m: pose.position_m + shift,
            rotation: Rotation3::new(turn) * pose.rotation,
        };
        if shift.norm() + turn.norm() < SETTLED {
            pose.rotation.renormalize();
            return (gap.amax() < CLOSED).then_some(pose);
        }
    }
    None
}

/// Pose and commands at which every rod has its length: of all, those to which plate and commands move least from a state
/// that stands at `commands`.
pub(crate) fn place(
    machine: &Machine,
    state: &State,
    commands: &[f64],
) -> Option<(Pose, Vec<f64>)> {
    let freedoms = machine.plate.freedoms();
    let (pose, commands, gap_m) = commands_and_motion(machine, state, commands, freedoms)?;
    (gap_m < CLOSED).then_some((pose, commands))
}

/// Commands at which every rod has its length with the TCP of a state where it is, and the pose there: of several, the
/// one to which commands and plate move least. The displacements of effects are those of the state, which stands at
/// `commands`.
pub(crate) fn commands(
    machine: &Machine,
    state: &State,
    commands: &[f64],
) -> Option<(Pose, Vec<f64>)> {
    let turns: Vec<usize> = (machine.plate.freedoms().iter().copied())
        .filter(|&motion| motion >= 3)
        .collect();
    let (pose, commands, _) = commands_and_motion(machine, state, commands, &turns)?;
    Some((pose, commands))
}

/// The same with the plate turned as it is in the state. `None` where no commands turn it so, too.
pub(crate) fn commands_of_pose(
    machine: &Machine,
    state: &State,
    commands: &[f64],
) -> Option<Vec<f64>> {
    let (_, commands, gap_m) = commands_and_motion(machine, state, commands, &[])?;
    (gap_m < CLOSED).then_some(commands)
}

/// Pose, reached from that of the state by some motions, commands, and the largest length (m) that a rod still lacks.
fn commands_and_motion(
    machine: &Machine,
    state: &State,
    commands: &[f64],
    motions: &[usize],
) -> Option<(Pose, Vec<f64>, f64)> {
    let command = |commands: &[f64], k: Option<usize>| k.map_or(0.0, |k| commands[k]);
    let straight = |k: usize, commands: &[f64]| {
        let rod = &machine.rods[k];
        let crank = rod.track.and_then(|track| machine.crank(track));
        (
            rod.joint_at(crank, command(commands, rod.track)),
            rod.length_at(command(commands, rod.actuated_by)),
        )
    };
    let displaced: Vec<(Vector3<f64>, f64)> = (0..machine.rods.len())
        .map(|k| {
            let (joint, length) = straight(k, commands);
            (state.joints_m[k] - joint, state.lengths_m[k] - length)
        })
        .collect();
    let (mut pose, mut here) = (state.pose, commands.to_vec());
    for _ in 0..COMMAND_STEPS {
        let mut matrix = DMatrix::zeros(machine.rods.len(), motions.len() + machine.commands);
        let mut gap = DVector::zeros(machine.rods.len());
        for (k, rod) in machine.rods.iter().enumerate() {
            let (joint, length) = straight(k, &here);
            let (joint, length) = (joint + displaced[k].0, length + displaced[k].1);
            let held = Held::new(pose, state.plate_joints_m[k], joint, length);
            gap[k] = held.gap_m;
            for (column, &motion) in motions.iter().enumerate() {
                matrix[(k, column)] = held.by_motion(motion);
            }
            // Columns of angles are those of the way that they move, so that all count alike.
            if let Some(track) = rod.track {
                let rate = rod.joint_rate(machine.crank(track), here[track]);
                matrix[(k, motions.len() + track)] = -held.along.dot(&rate) / machine.ways_m[track];
            }
            if let Some(own) = rod.actuated_by {
                matrix[(k, motions.len() + own)] =
                    -rod.length_rate(here[own]) / machine.ways_m[own];
            }
        }
        let step = least_norm(matrix, &gap)?;
        let (shift, turn) = motion_of(motions, &step);
        pose = Pose {
            position_m: pose.position_m + shift,
            rotation: Rotation3::new(turn) * pose.rotation,
        };
        let mut farthest = shift.amax().max(turn.amax());
        for (k, way) in step.iter().skip(motions.len()).enumerate() {
            let change = way / machine.ways_m[k];
            here[k] += change;
            let is_crank = machine.crank(k).is_some();
            farthest = farthest.max(if is_crank { change.abs() } else { way.abs() });
        }
        if farthest > OUT_OF_REACH {
            return None;
        }
        if step.amax() < SETTLED_COMMANDS {
            pose.rotation.renormalize();
            return Some((pose, here, gap.amax()));
        }
    }
    None
}
