//! Where the machine of the drawings stands, and the commands that bring it to a place, as a controller computes them.

use nalgebra::{DMatrix, Rotation3, Vector3};
use tau_robot::robot_file::Reference;

use super::angles::zyz;
use super::closing;
use super::machine::Machine;
use super::parts::Pose;

/// Farthest that the machine may stand from its reference, over the mean length of its links; twice as much in rad.
const ROUGH: f64 = 0.1;
/// Smallest change of the rods' lengths, over a motion of the plate, at which they hold it.
const FIRM: f64 = 1e-4;
/// Share of a motion of length one that is not worth naming.
const FAINT: f64 = 0.2;
/// Length of the steps on the way to a target, as a share of the size of the workspace: long ones would
/// jump from one side of a cart to the other. Turns (rad) take steps as long.
const WAY: f64 = 0.05;
/// A place beside another, as a share of the size of the workspace, or a turn (rad): what the drives can't do is told from
/// what they can to first order, which a hundredth is.
const BESIDE: f64 = 0.01;

/// Pose and commands (m or rad) of the machine of the drawings, as a controller computes them.
#[derive(Debug, Clone)]
pub(super) struct Commanded {
    pub(super) pose: Pose,
    pub(super) commands_m: Vec<f64>,
}

impl Commanded {
    /// The machine at the commands of its reference; where redundant drives do not agree with each other there, at its
    /// position, or, where that is out of reach, at the place nearest to both. `None` where the rods do not
    /// meet near it, or do not hold the plate.
    pub(super) fn reference(machine: &Machine, reference: &Reference) -> Option<Self> {
        let stated = Self::stated(reference);
        let state = machine.unloaded(&stated.commands_m, stated.pose);
        let stands =
            |found: &Self| found.is_near(&stated, machine) && found.firmness(machine) > FIRM;
        if machine.is_redundant() {
            let at_position = stated.near(machine, stated.pose.position_m).filter(stands);
            return at_position.or_else(|| {
                let (pose, commands_m) = closing::place(machine, &state, &stated.commands_m)?;
                Some(Self { pose, commands_m }).filter(stands)
            });
        }
        let found = Self {
            pose: closing::pose(machine, &state)?,
            ..stated.clone()
        };
        stands(&found).then_some(found)
    }

    /// True if it is no farther from a stated place than that may be off.
    fn is_near(&self, stated: &Self, machine: &Machine) -> bool {
        let rough = ROUGH * machine.mean_length_m();
        let commands = self.commands_m.iter().zip(&stated.commands_m);
        let off = (commands.zip(&machine.ways_m))
            .map(|((found, stated), way)| (found - stated).abs() * way)
            .fold(0.0, f64::max);
        (self.pose.position_m - stated.pose.position_m).norm() < rough
            && off < rough
            && self.pose.rotation.angle_to(&stated.pose.rotation) < 2.0 * ROUGH
    }

    /// The motion of the plate, in words, that no rod holds at the reference of a machine; `None` where all are held.
    pub(super) fn free_at(machine: &Machine, reference: &Reference) -> Option<String> {
        let stated = Self::stated(reference);
        if stated.firmness(machine) > FIRM {
            return None;
        }
        let matrix = stated.held(machine);
        let eigen = matrix.tr_mul(&matrix).symmetric_eigen();
        let weakest = eigen.eigenvectors.column(eigen.eigenvalues.imin());
        let (mut shift, mut turn) = (Vector3::zeros(), Vector3::zeros());
        for (&motion, &amount) in machine.plate.freedoms().iter().zip(&weakest) {
            if motion < 3 {
                shift[motion] = amount;
            } else {
                turn[motion - 3] = amount;
            }
        }
        Some(motion_in_words(shift, turn))
    }

    /// The state that a reference says.
    fn stated(reference: &Reference) -> Self {
        Self {
            pose: Pose {
                position_m: reference.position_m.into(),
                rotation: zyz(reference.orientation_rad),
            },
            commands_m: reference.commands_m.clone(),
        }
    }

    /// Smallest singular value of the change of the rods' lengths with the plate's freedoms, rotation counted
    /// at the plate joints.
    fn firmness(&self, machine: &Machine) -> f64 {
        let matrix = self.held(machine);
        if matrix.nrows() < matrix.ncols() {
            0.0
        } else {
            matrix.singular_values().min()
        }
    }

    /// Change of the rods' lengths with the plate's freedoms, rotation counted at the plate joints.
    fn held(&self, machine: &Machine) -> DMatrix<f64> {
        let joints = machine.unloaded(&self.commands_m, self.pose).joints_m;
        let levers: Vec<Vector3<f64>> = machine
            .rods
            .iter()
            .map(|rod| self.pose.rotation * rod.plate_joint_m)
            .collect();
        let lever =
            (levers.iter().map(Vector3::norm_squared).sum::<f64>() / levers.len() as f64).sqrt();
        let lever = lever.max(1e-9);
        let freedoms = machine.plate.freedoms();
        DMatrix::from_fn(levers.len(), freedoms.len(), |k, column| {
            let along = (self.pose.position_m + levers[k] - joints[k]).normalize();
            let motion = freedoms[column];
            if motion < 3 {
                along[motion]
            } else {
                levers[k].cross(&along)[motion - 3] / lever
            }
        })
    }

    /// The same, unless a singular pose lies between it and another, where drives do not lead the plate from one to the other:
    /// behind it lengths of the rods change with its motions in the opposite sense. Of redundant drives nothing is said.
    fn beside(self, other: &Self, machine: &Machine) -> Option<Self> {
        let sense = |of: &Self| {
            let matrix = of.held(machine);
            (matrix.is_square()).then(|| matrix.determinant().signum())
        };
        (sense(&self) == sense(other)).then_some(self)
    }

    /// Commands that bring the TCP of the machine, without load and errors, to a position (m); `None`
    /// where it is out of reach or behind a singular pose. The orientation is what the arm leaves it, nearest to the one before.
    pub(super) fn towards(&self, machine: &Machine, target_m: Vector3<f64>) -> Option<Self> {
        let way = target_m - self.pose.position_m;
        let steps = (way.norm() / (WAY * machine.workspace_m())).ceil().max(1.0);
        let mut here = self.clone();
        let mut step = 0.0;
        while step < steps {
            step += 1.0;
            let position = self.pose.position_m + way * (step / steps);
            here = here.near(machine, position)?;
        }
        here.beside(self, machine)
    }

    /// The same place with the plate turned by a rotation vector (rad) in the measurement frame; `None` where the drives
    /// can't turn it so, or not from here.
    pub(super) fn turned(&self, machine: &Machine, turn: Vector3<f64>) -> Option<Self> {
        let steps = (turn.norm() / WAY).ceil().max(1.0);
        let mut here = self.clone();
        let mut step = 0.0;
        while step < steps {
            step += 1.0;
            here.pose.rotation = Rotation3::new(turn * (step / steps)) * self.pose.rotation;
            let state = machine.unloaded(&here.commands_m, here.pose);
            here.commands_m = closing::commands_of_pose(machine, &state, &here.commands_m)?;
        }
        here.beside(self, machine)
    }

    /// The pose at other commands (m or rad), along the straight way to them; `None` where the rods do not meet there, or
    /// on the way do not hold the plate.
    pub(super) fn led_to(&self, machine: &Machine, commands: &[f64]) -> Option<Self> {
        let pairs = || self.commands_m.iter().zip(commands);
        let ways = pairs()
            .zip(&machine.ways_m)
            .map(|((from, to), way)| (to - from).abs() * way);
        let steps = (ways.fold(0.0, f64::max) / (WAY * machine.workspace_m()))
            .ceil()
            .max(1.0);
        let mut here = self.clone();
        let mut step = 0.0;
        while step < steps {
            step += 1.0;
            here.commands_m = pairs()
                .map(|(from, to)| from + (to - from) * (step / steps))
                .collect();
            let state = machine.unloaded(&here.commands_m, here.pose);
            here.pose = closing::pose(machine, &state)?;
            if here.firmness(machine) < FIRM {
                return None;
            }
        }
        here.beside(self, machine)
    }

    /// True if the drives bring the TCP to places beside this one along each axis of its freedoms. Where they do not, as
    /// those of a tripod that lifts and tilts, no steps make a grid of positions; nor where the plate turns by so much on the
    /// way that on a quarter of the workspace, half of a grid, it would turn by more than a radian.
    pub(super) fn places_tcp(&self, machine: &Machine) -> bool {
        let mut axes = machine.plate.freedoms_of_tcp().iter();
        axes.all(|&axis| {
            let mut way = Vector3::zeros();
            way[axis] = BESIDE * machine.workspace_m();
            [way, -way].into_iter().any(|way| {
                let there = self.near(machine, self.pose.position_m + way);
                there.is_some_and(|there| there.pose.rotation.angle_to(&self.pose.rotation) < WAY)
            })
        })
    }

    /// True if they turn it about each axis of its freedoms where it is.
    pub(super) fn turns_plate(&self, machine: &Machine) -> bool {
        let mut axes = machine
            .plate
            .freedoms()
            .iter()
            .filter(|&&motion| motion >= 3)
            .peekable();
        axes.peek().is_some()
            && axes.all(|&motion| {
                let mut turn = Vector3::zeros();
                turn[motion - 3] = BESIDE;
                [turn, -turn]
                    .into_iter()
                    .any(|turn| self.turned(machine, turn).is_some())
            })
    }

    /// Commands and orientation at a position (m) close by.
    fn near(&self, machine: &Machine, position_m: Vector3<f64>) -> Option<Self> {
        let pose = Pose {
            position_m,
            ..self.pose
        };
        let state = machine.unloaded(&self.commands_m, pose);
        let (pose, commands_m) = closing::commands(machine, &state, &self.commands_m)?;
        Some(Self { pose, commands_m })
    }
}

/// A motion of the plate: translation, and rotation counted at its joints.
fn motion_in_words(shift: Vector3<f64>, turn: Vector3<f64>) -> String {
    let axis = |vector: Vector3<f64>| {
        let unit = vector.normalize();
        let sign = if unit[unit.iamax()] < 0.0 { -1.0 } else { 1.0 };
        // Adding zero turns -0 into 0.
        let [x, y, z]: [f64; 3] = unit
            .map(|v| (sign * v * 100.0).round() / 100.0 + 0.0)
            .into();
        format!("({x:.2}, {y:.2}, {z:.2})")
    };
    match (shift.norm() > FAINT, turn.norm() > FAINT) {
        (true, true) => format!(
            "turn about {} while it moves along {}",
            axis(turn),
            axis(shift)
        ),
        (false, true) => format!("turn about {}", axis(turn)),
        _ => format!("move along {}", axis(shift)),
    }
}

#[cfg(test)]
mod tests {
    use tau_robot::robot::Robot;

    use super::*;
    use crate::drawing::Drawing;

    /// The rod on the rail is 780 mm long; the plate joint of the stated references stands as far above the rail, or farther,
    /// and the commands are those of another place, 5 mm below.
    #[test]
    fn redundant_drives_need_not_lead_to_a_rough_reference() {
        for height in ["0.1", "0.101"] {
            let text = SQUARE.replace("HEIGHT", height);
            let robot = Robot::from_text(&text).unwrap();
            let file = tau_robot::prototype::parameters_of(&robot).unwrap();
            let reference = file.completed(&robot).reference.unwrap();
            let machine = Drawing::new(&robot, &file, &reference).unwrap().nominal;
            let found = Commanded::reference(&machine, &reference).unwrap();
            let state = machine.unloaded(&found.commands_m, found.pose);
            for (k, rod) in machine.rods.iter().enumerate() {
                let plate_joint_m = found.pose.position_m + found.pose.rotation * rod.plate_joint_m;
                let length_m = (plate_joint_m - state.joints_m[k]).norm();
                assert!((length_m - state.lengths_m[k]).abs() < 1e-9, "{height} {k}");
            }
            let off_m = found.pose.position_m - Vector3::from(reference.position_m);
            assert!(off_m.norm() < 1e-2, "{height}: {off_m}");
            for (found, stated) in found.commands_m.iter().zip(&reference.commands_m) {
                assert!((found - stated).abs() < 1e-2, "{height}: {found} {stated}");
            }
        }
    }

    const SQUARE: &str = "robot Square {
        plate body in plane;
        track rail;
        cluster c on rail {
            link r { length = 780 mm tol 1 mm; plate_joint = (0, -120, 0) mm tol 1 mm;
                track_offset = (300, -800, 0) mm tol 1 mm; track_direction = (1, 0, 0) exact; }
        }
        cluster b on base {
            link left actuated length { length = q; plate_joint = (-120, 0, 0) mm tol 1 mm;
                track_offset = (-1000, 300, 0) mm tol 1 mm; }
            link right actuated length { length = q; plate_joint = (60, 104, 0) mm tol 1 mm;
                track_offset = (2000, 300, 0) mm tol 1 mm; }
            link top actuated length { length = q; plate_joint = (120, 60, 0) mm tol 1 mm;
                track_offset = (1500, 1400, 0) mm tol 1 mm; }
        }
        reference { commands = (0.087776 m, 1.197281 m, 1.643506 m, 1.648420 m); position = (0.3, HEIGHT, 0) m; }
        variant Full { arm full; tracks linear per link; }
    }";
}
