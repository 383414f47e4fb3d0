//! The part of an effect that a measurement shows at best: λ = ‖M·g‖², with g the whitened noise-free
//! signal and M what the base leaves.
//!
//! Signals are differences of simulated measurements, and the base's derivatives those of the virtual
//! robot's own geometry, by the implicit function theorem on the lengths of the rods: nothing here is
//! taken from the estimator.

use nalgebra::linalg::QR;
use nalgebra::{DMatrix, DVector, Dyn, Matrix6, Rotation3, SMatrix, Vector3};
use tau::robot_file::RobotFile;
use tau::simulation::{Machine, Mounting, SimulatedFolder};

/// Of each rod: length, joint on the plate, joint on the cart, direction of the track.
const ROD: usize = 10;
/// Of each cart in sets 2 and 3, which discovery keeps free: rates of turning about three axes, and of
/// drifting aside along two, with the command.
const CART: usize = 5;
const TURNING: f64 = 1e-2;
const DRIFTING: f64 = 2e-4;
/// Place of a target on its cart (m).
const MOUNTING_M: f64 = 0.1;
/// Tolerances that stand for none: rotations (rad), translations (m).
const ANY: f64 = 1.0;
const ANYWHERE_M: f64 = 10.0;

/// The base at a machine, factored.
pub(crate) struct Base {
    qr: QR<f64, Dyn, Dyn>,
    rows: usize,
    columns: usize,
}

/// Writes whitened derivatives, each column in units of its tolerance.
struct Rows {
    jacobian: DMatrix<f64>,
    next: usize,
}

impl Rows {
    /// Adds a block of three rows at a row, in columns from `column` on.
    fn add(&mut self, row: usize, column: usize, block: &SMatrix<f64, 3, 3>) {
        let mut view = self.jacobian.view_mut((row, column), (3, 3));
        view += block;
    }
}

/// Columns of each kind.
struct Layout {
    carts: usize,
    frames: [usize; 2],
    targets: [usize; 2],
    columns: usize,
}

impl Layout {
    fn new(rods: usize, tracks: usize) -> Self {
        let carts = ROD * rods;
        let frame2 = carts + CART * tracks;
        let target2 = frame2 + 12;
        let target3 = target2 + 6 * tracks;
        Self {
            carts,
            frames: [frame2, frame2 + 6],
            targets: [target2, target3],
            columns: target3 + 3 * tracks,
        }
    }

    fn tolerances(&self, robot: &tau::Robot, file: &RobotFile, tracks: usize) -> Vec<f64> {
        let mut tolerances = vec![ANY; self.columns];
        for (rod, link) in robot.links.iter().enumerate() {
            let values = &file.links[&link.name];
            let of = |value: &Option<tau::robot_file::Value>| {
                value.as_ref().map_or(ANYWHERE_M, |value| value.tol)
            };
            let own = &mut tolerances[ROD * rod..ROD * (rod + 1)];
            own[0] = of(&values.length);
            own[1..4].fill(of(&values.plate_joint));
            own[4..7].fill(of(&values.track_offset));
            own[7..10].fill(of(&values.track_direction));
        }
        for cart in 0..tracks {
            let own = self.carts + CART * cart;
            tolerances[own..own + 3].fill(TURNING);
            tolerances[own + 3..own + CART].fill(DRIFTING);
            tolerances[self.targets[0] + 6 * cart..][..3].fill(MOUNTING_M);
            tolerances[self.targets[1] + 3 * cart..][..3].fill(MOUNTING_M);
        }
        for frame in self.frames {
            tolerances[frame..frame + 3].fill(ANYWHERE_M);
        }
        tolerances
    }
}

impl Base {
    /// The base at a simulated machine without effects; `poses` are the indices of those of set 1 that
    /// take part.
    pub(crate) fn new(robot: &tau::Robot, simulated: &SimulatedFolder, poses: &[usize]) -> Self {
        let machine = &simulated.truth.machine;
        let (folder, noise) = (&simulated.folder, simulated.file.noise);
        let layout = Layout::new(machine.rods.len(), machine.tracks);
        let rows = 6 * (poses.len() + folder.cart_poses.len()) + 3 * folder.cart_positions.len();
        let mut all = Rows {
            jacobian: DMatrix::zeros(rows + layout.columns, layout.columns),
            next: 0,
        };
        for &pose in poses {
            closure_rows(&mut all, simulated, pose);
        }
        for row in &folder.cart_poses {
            let mounting = &simulated.truth.set2;
            cart_rows(
                &mut all,
                machine,
                &layout,
                (0, mounting),
                row.track,
                row.command_m,
            );
        }
        for row in &folder.cart_positions {
            let (mounting, q) = (&simulated.truth.set3, row.commands_m[row.track]);
            cart_rows(&mut all, machine, &layout, (1, mounting), row.track, q);
        }
        let mut jacobian = all.jacobian;
        let tcp_and_set_2 = 6 * (poses.len() + folder.cart_poses.len());
        for row in 0..rows {
            let is_rotation = row < tcp_and_set_2 && row % 6 >= 3;
            let sigma = if is_rotation {
                noise.rotation_rad
            } else {
                noise.position_m
            };
            jacobian.row_mut(row).scale_mut(sigma.recip());
        }
        let tolerances = layout.tolerances(robot, &simulated.file, machine.tracks);
        for (column, tolerance) in tolerances.iter().enumerate() {
            jacobian.column_mut(column).scale_mut(*tolerance);
            jacobian[(rows + column, column)] = 1.0;
        }
        Self {
            qr: jacobian.qr(),
            rows,
            columns: layout.columns,
        }
    }

    /// λ of a whitened signal.
    pub(crate) fn noncentrality(&self, signal: &DVector<f64>) -> f64 {
        let mut signal = signal
            .clone()
            .resize_vertically(self.rows + self.columns, 0.0);
        self.qr.q_tr_mul(&mut signal);
        signal.rows_range(self.columns..).norm_squared()
    }
}

/// A pose of set 1: by which translation and rotation the plate answers to changes of the rods, from
/// nᵢ·(δjᵢ − δT − δφ × R pᵢ − R δpᵢ) = δLᵢ with nᵢ along rod i from the plate to its cart.
fn closure_rows(all: &mut Rows, simulated: &SimulatedFolder, pose: usize) {
    let truth = &simulated.truth;
    let state = &truth.tcp_poses[pose];
    let commands = &simulated.folder.tcp_poses[pose].commands_m;
    let (translation, rotation) = (state.pose.position_m, state.pose.rotation);
    let mut moved = Matrix6::zeros();
    let mut normals = Vec::new();
    for (rod, (joint, plate)) in state.joints_m.iter().zip(&state.plate_joints_m).enumerate() {
        let lever = rotation * plate;
        let normal = (joint - translation - lever).normalize();
        let turning = lever.cross(&normal);
        for axis in 0..3 {
            moved[(rod, axis)] = normal[axis];
            moved[(rod, 3 + axis)] = turning[axis];
        }
        normals.push(normal);
    }
    let answer = moved.try_inverse().expect("rods that hold the plate");
    for (rod, normal) in normals.iter().enumerate() {
        let q = truth.machine.rods[rod]
            .track
            .map_or(0.0, |track| commands[track]);
        let plate = -(rotation.inverse() * normal);
        let causes = std::iter::once(-1.0)
            .chain(plate.iter().copied())
            .chain(normal.iter().copied())
            .chain(normal.iter().map(|n| q * n));
        for (column, cause) in causes.enumerate() {
            for row in 0..6 {
                all.jacobian[(all.next + row, ROD * rod + column)] = answer[(row, rod)] * cause;
            }
        }
    }
    all.next += 6;
}

/// A cart in set 2 (index 0, position and rotation) or 3 (index 1, position), in axes of the
/// measurement frame.
fn cart_rows(
    all: &mut Rows,
    machine: &Machine,
    layout: &Layout,
    (set, mounting): (usize, &Mounting),
    track: usize,
    q: f64,
) {
    let rods: Vec<usize> = (0..machine.rods.len())
        .filter(|&rod| machine.rods[rod].track == Some(track))
        .collect();
    let share = (rods.len() as f64).recip();
    let mut point = Vector3::zeros();
    let mut direction = Vector3::zeros();
    for &rod in &rods {
        let rod = &machine.rods[rod];
        point += (rod.track_offset_m + rod.track_direction * q) * share;
        direction += rod.track_direction * share;
    }
    let place = mounting.targets[track].0;
    let identity = SMatrix::<f64, 3, 3>::identity();
    let row = all.next;
    for rod in rods {
        all.add(row, ROD * rod + 4, &(identity * share));
        all.add(row, ROD * rod + 7, &(identity * (q * share)));
    }
    let turned = |lever: Vector3<f64>| -lever.cross_matrix();
    let cart = layout.carts + CART * track;
    all.add(row, cart, &(turned(place) * q));
    let across = Vector3::z().cross(&direction).normalize();
    for (column, axis) in [across, direction.cross(&across).normalize()]
        .iter()
        .enumerate()
    {
        for k in 0..3 {
            all.jacobian[(row + k, cart + 3 + column)] = q * axis[k];
        }
    }
    let frame = layout.frames[set];
    all.add(row, frame, &identity);
    all.add(row, frame + 3, &turned(point + place));
    let target = layout.targets[set] + if set == 0 { 6 } else { 3 } * track;
    all.add(row, target, &identity);
    if set == 0 {
        all.add(row + 3, cart, &(identity * q));
        all.add(row + 3, frame + 3, &identity);
        all.add(row + 3, target + 3, &identity);
    }
    all.next += if set == 0 { 6 } else { 3 };
}

/// Signal of an effect in noise-free measurements, in standard deviations.
pub(crate) fn signal(
    without: &SimulatedFolder,
    with: &SimulatedFolder,
    poses: &[usize],
) -> DVector<f64> {
    let noise = without.file.noise;
    let mut signal = Vec::new();
    let position = |frame: &Rotation3<f64>, before: [f64; 3], after: [f64; 3]| {
        let moved = frame.inverse() * (Vector3::from(after) - Vector3::from(before));
        (moved / noise.position_m)
            .iter()
            .copied()
            .collect::<Vec<_>>()
    };
    let rotation = |frame: &Rotation3<f64>, before: [f64; 3], after: [f64; 3]| {
        let turned = frame.inverse() * small_turn(zyz(after) * zyz(before).inverse());
        (turned / noise.rotation_rad)
            .iter()
            .copied()
            .collect::<Vec<_>>()
    };
    let (before, after) = (&without.folder, &with.folder);
    let here = Rotation3::identity();
    for &pose in poses {
        let (a, b) = (&before.tcp_poses[pose], &after.tcp_poses[pose]);
        signal.extend(position(&here, a.position_m, b.position_m));
        signal.extend(rotation(&here, a.angles_rad, b.angles_rad));
    }
    for (a, b) in before.cart_poses.iter().zip(&after.cart_poses) {
        let frame = &without.truth.set2.rotation;
        signal.extend(position(frame, a.position_m, b.position_m));
        signal.extend(rotation(frame, a.angles_rad, b.angles_rad));
    }
    for (a, b) in before.cart_positions.iter().zip(&after.cart_positions) {
        signal.extend(position(
            &without.truth.set3.rotation,
            a.position_m,
            b.position_m,
        ));
    }
    DVector::from_vec(signal)
}

/// Rotation vector of a small rotation: its axial vector, which rounding harms less than its angle.
fn small_turn(rotation: Rotation3<f64>) -> Vector3<f64> {
    let m = rotation.matrix();
    Vector3::new(
        m[(2, 1)] - m[(1, 2)],
        m[(0, 2)] - m[(2, 0)],
        m[(1, 0)] - m[(0, 1)],
    ) / 2.0
}

/// R = Rz(α)·Ry(β)·Rz(γ).
fn zyz([alpha, beta, gamma]: [f64; 3]) -> Rotation3<f64> {
    let about = |axis: Vector3<f64>, angle: f64| Rotation3::new(axis * angle);
    about(Vector3::z(), alpha) * about(Vector3::y(), beta) * about(Vector3::z(), gamma)
}
