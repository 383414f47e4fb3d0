//! The true machine: rods, carts and plate, solved exactly.
//!
//! Nothing here is shared with the estimator: distances instead of their squares, rotation matrices
//! instead of Euler angles, equilibrium by iteration instead of at nominal dimensions.

use nalgebra::{DMatrix, DVector, Matrix3, Rotation3, Vector3};
use tau_robot::robot_file::Payload;

use super::effect::{CartReading, Conditions, Effect, LinkReading, TcpReading};

/// Step of the plate (m, rad) below which Newton's method has settled.
const SETTLED: f64 = 1e-12;
const NEWTON_STEPS: usize = 60;
/// Rounds of displacement, closure and equilibrium; each reduces the error by the ratio of arm to cart
/// stiffness, a hundredfold at the least.
const EQUILIBRIUM_ROUNDS: usize = 60;
/// Longest step of Newton's method, as a share of the mean link length and in rad.
const LONGEST_STEP: f64 = 0.3;

/// A rod with its joints.
#[derive(Debug, Clone, PartialEq)]
pub struct Rod {
    /// Length (m); of a driven link at command zero.
    pub length_m: f64,
    /// Plate joint in TCP coordinates (m).
    pub plate_joint_m: Vector3<f64>,
    /// Cart-side joint at q = 0 in the measurement frame (m).
    pub track_offset_m: Vector3<f64>,
    /// Travel of that joint per command; zero on the fixed base.
    pub track_direction: Vector3<f64>,
    /// The track whose cart carries it.
    pub track: Option<usize>,
    /// The command that drives its length.
    pub actuated_by: Option<usize>,
}

/// A machine with its load and its errors.
#[derive(Debug, Clone)]
pub struct Machine {
    /// Links in order of the description.
    pub rods: Vec<Rod>,
    /// Number of tracks.
    pub tracks: usize,
    /// Number of commands.
    pub commands: usize,
    /// The load that the arm carries.
    pub payload: Option<Payload>,
    /// Physical errors.
    pub effects: Vec<Effect>,
}

/// Position T (m) and rotation R of the TCP frame in the measurement frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// T.
    pub position_m: Vector3<f64>,
    /// R.
    pub rotation: Rotation3<f64>,
}

/// A cart at a command, effects included.
#[derive(Debug, Clone, PartialEq)]
pub struct CartState {
    /// Reference point, the mean of the joints (m).
    pub point_m: Vector3<f64>,
    /// Rotation since q = 0.
    pub rotation: Rotation3<f64>,
}

/// The machine at commands.
#[derive(Debug, Clone, PartialEq)]
pub struct State {
    /// Pose of the plate.
    pub pose: Pose,
    /// Carts by track.
    pub carts: Vec<CartState>,
    /// Cart-side joint of each link (m).
    pub joints_m: Vec<Vector3<f64>>,
    /// Plate joint of each link in TCP coordinates (m).
    pub plate_joints_m: Vec<Vector3<f64>>,
    /// Length of each link (m).
    pub lengths_m: Vec<f64>,
    /// Tension of each link (N).
    pub tensions_n: Vec<f64>,
    /// Force of the arm on each cart (N) along, horizontally across and in the third direction.
    pub loads_n: Vec<[f64; 3]>,
}

/// Along the track, level across it, and the third direction; on a track within 25° of vertical, x̂
/// takes the place of ẑ.
pub(crate) fn track_frame(direction: Vector3<f64>) -> Matrix3<f64> {
    let along = direction.try_normalize(0.0).unwrap_or_else(Vector3::x);
    let up = if along.z.powi(2) < 0.82 {
        Vector3::z()
    } else {
        Vector3::x()
    };
    let across = up.cross(&along).normalize();
    Matrix3::from_columns(&[along, across, along.cross(&across)])
}

impl Machine {
    /// True if there are more rods than freedoms of the plate, so that they fit at matching commands only.
    pub(crate) fn is_redundant(&self) -> bool {
        self.rods.len() > 6
    }

    fn rods_of(&self, track: usize) -> impl Iterator<Item = &Rod> {
        self.rods.iter().filter(move |rod| rod.track == Some(track))
    }

    /// Mean direction of the joints on a cart.
    pub(crate) fn direction(&self, track: usize) -> Vector3<f64> {
        let count = self.rods_of(track).count().max(1) as f64;
        self.rods_of(track)
            .map(|rod| rod.track_direction)
            .sum::<Vector3<f64>>()
            / count
    }

    /// Mean length of the links (m).
    pub(crate) fn mean_length_m(&self) -> f64 {
        self.rods.iter().map(|rod| rod.length_m).sum::<f64>() / self.rods.len().max(1) as f64
    }

    /// The machine at commands (m): joints where the effects put them, rods exactly of their length,
    /// forces in equilibrium, all three consistent. Of several ways of assembling the arm, the one that
    /// Newton's method reaches from `start`. `None` where the rods do not meet.
    pub fn solve(&self, commands_m: &[f64], conditions: &Conditions, start: Pose) -> Option<State> {
        let mut state = self.unloaded(commands_m, start);
        for round in 0..EQUILIBRIUM_ROUNDS {
            self.displace(commands_m, conditions, &mut state);
            let before = state.pose;
            state.pose = self.close(&state)?;
            let (tensions, loads) = self.forces(&state)?;
            let moved = (state.pose.position_m - before.position_m).norm()
                + (state.pose.rotation.matrix() - before.rotation.matrix()).norm();
            let changed = loads
                .iter()
                .zip(&state.loads_n)
                .flat_map(|(new, old)| new.iter().zip(old).map(|(new, old)| (new - old).abs()))
                .chain(
                    tensions
                        .iter()
                        .zip(&state.tensions_n)
                        .map(|(new, old)| (new - old).abs()),
                )
                .fold(0.0, f64::max);
            state.tensions_n = tensions;
            state.loads_n = loads;
            if round > 0 && moved < 10.0 * SETTLED && changed < 1e-8 {
                return Some(state);
            }
        }
        None
    }

    /// The carts where the arm does not close: as if it were taken off.
    pub(crate) fn carts_without_arm(
        &self,
        commands_m: &[f64],
        conditions: &Conditions,
        pose: Pose,
    ) -> Vec<CartState> {
        let mut state = self.unloaded(commands_m, pose);
        self.displace(commands_m, conditions, &mut state);
        state.carts
    }

    fn unloaded(&self, commands_m: &[f64], pose: Pose) -> State {
        let command = |index: Option<usize>| index.and_then(|k| commands_m.get(k)).copied();
        State {
            pose,
            carts: (0..self.tracks)
                .map(|_| CartState {
                    point_m: Vector3::zeros(),
                    rotation: Rotation3::identity(),
                })
                .collect(),
            joints_m: self
                .rods
                .iter()
                .map(|rod| {
                    rod.track_offset_m + rod.track_direction * command(rod.track).unwrap_or(0.0)
                })
                .collect(),
            plate_joints_m: self.rods.iter().map(|rod| rod.plate_joint_m).collect(),
            lengths_m: self
                .rods
                .iter()
                .map(|rod| rod.length_m + command(rod.actuated_by).unwrap_or(0.0))
                .collect(),
            tensions_n: vec![0.0; self.rods.len()],
            loads_n: vec![[0.0; 3]; self.tracks],
        }
    }

    /// Moves joints and changes lengths by what the effects say at the state's forces and pose.
    fn displace(&self, commands_m: &[f64], conditions: &Conditions, state: &mut State) {
        let straight = self.unloaded(commands_m, state.pose);
        let command = |k: usize| commands_m.get(k).copied().unwrap_or(0.0);
        let direction = |k: usize| conditions.directions.get(k).copied().unwrap_or(1.0);
        for track in 0..self.tracks {
            let mut shift = Vector3::zeros();
            let mut turn = Vector3::zeros();
            for (effect, source) in self
                .effects
                .iter()
                .filter_map(|effect| effect.on_cart(track))
            {
                let error = effect(&CartReading {
                    q_m: command(track),
                    source_q_m: source.map_or(0.0, command),
                    direction: direction(track),
                    time_s: conditions.time_s,
                    temperature_c: conditions.temperature_c,
                    load_n: state.loads_n[track],
                    tcp_m: state.pose.position_m.into(),
                });
                shift += Vector3::from(error.shift_m);
                turn += Vector3::from(error.turn_rad);
            }
            let frame = track_frame(self.direction(track));
            let turn = Rotation3::new(frame * turn);
            let on_cart: Vec<usize> = (0..self.rods.len())
                .filter(|&k| self.rods[k].track == Some(track))
                .collect();
            let mean = |points: &[Vector3<f64>]| {
                on_cart.iter().map(|&k| points[k]).sum::<Vector3<f64>>()
                    / on_cart.len().max(1) as f64
            };
            let centre = mean(&straight.joints_m);
            let point = centre + frame * shift;
            for &k in &on_cart {
                state.joints_m[k] = point + turn * (straight.joints_m[k] - centre);
            }
            let built = self.built_rotation(track, command(track));
            state.carts[track] = CartState {
                point_m: point,
                rotation: turn * built,
            };
        }
        for (k, rod) in self.rods.iter().enumerate() {
            let own = rod.track.or(rod.actuated_by);
            let reading = LinkReading {
                length_m: rod.length_m,
                tension_n: state.tensions_n[k],
                q_m: own.map_or(0.0, command),
                direction: own.map_or(1.0, direction),
                time_s: conditions.time_s,
                temperature_c: conditions.temperature_c,
                tcp_m: state.pose.position_m.into(),
            };
            state.lengths_m[k] = straight.lengths_m[k];
            state.plate_joints_m[k] = straight.plate_joints_m[k];
            for effect in self.effects.iter().filter_map(|effect| effect.on_link(k)) {
                let error = effect(&reading);
                state.lengths_m[k] += error.length_m;
                state.plate_joints_m[k] += Vector3::from(error.joint_m);
            }
        }
    }

    /// Rotation of a cart since q = 0 that its joints' directions imply: the smallest one that carries
    /// the joints, in the sense of least squares, from their places at q = 0 to those at q.
    fn built_rotation(&self, track: usize, q: f64) -> Rotation3<f64> {
        let count = self.rods_of(track).count();
        if count < 2 {
            return Rotation3::identity();
        }
        let direction = self.direction(track);
        let centre = self
            .rods_of(track)
            .map(|rod| rod.track_offset_m)
            .sum::<Vector3<f64>>()
            / count as f64;
        let mut matrix = DMatrix::zeros(3 * count, 3);
        let mut travel = DVector::zeros(3 * count);
        for (k, rod) in self.rods_of(track).enumerate() {
            let arm = rod.track_offset_m - centre;
            // ω × arm = −[arm]× ω
            matrix
                .view_mut((3 * k, 0), (3, 3))
                .copy_from(&-arm.cross_matrix());
            travel
                .rows_mut(3 * k, 3)
                .copy_from(&((rod.track_direction - direction) * q));
        }
        let (w, _) = shortest(&matrix, &travel);
        Rotation3::new(Vector3::new(w[0], w[1], w[2]))
    }

    /// Pose at which every rod has its length.
    fn close(&self, state: &State) -> Option<Pose> {
        let longest = LONGEST_STEP * self.mean_length_m();
        let mut pose = state.pose;
        for _ in 0..NEWTON_STEPS {
            let mut matrix = DMatrix::zeros(self.rods.len(), 6);
            let mut gap = DVector::zeros(self.rods.len());
            for k in 0..self.rods.len() {
                let lever = pose.rotation * state.plate_joints_m[k];
                let rod = pose.position_m + lever - state.joints_m[k];
                let along = rod.normalize();
                let moment = lever.cross(&along);
                gap[k] = state.lengths_m[k] - rod.norm();
                for axis in 0..3 {
                    matrix[(k, axis)] = along[axis];
                    matrix[(k, 3 + axis)] = moment[axis];
                }
            }
            let step = least_norm(matrix, &gap)?;
            let (mut shift, mut turn) = (
                Vector3::new(step[0], step[1], step[2]),
                Vector3::new(step[3], step[4], step[5]),
            );
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
                return (gap.amax() < 1e-9).then_some(pose);
            }
        }
        None
    }

    /// Tensions that hold the payload, and the forces of the arm on the carts.
    fn forces(&self, state: &State) -> Option<(Vec<f64>, Vec<[f64; 3]>)> {
        let Some(payload) = self.payload else {
            return Some((vec![0.0; self.rods.len()], vec![[0.0; 3]; self.tracks]));
        };
        let Pose {
            position_m,
            rotation,
        } = state.pose;
        let weight = Vector3::from(payload.gravity_m_s2) * payload.mass_kg;
        let moment = (rotation * Vector3::from(payload.centre_m)).cross(&weight);
        let mut wrenches = DMatrix::zeros(6, self.rods.len());
        let mut pulls = Vec::with_capacity(self.rods.len());
        for (k, (joint, plate_joint)) in
            state.joints_m.iter().zip(&state.plate_joints_m).enumerate()
        {
            let lever = rotation * plate_joint;
            let pull = (joint - position_m - lever).normalize();
            wrenches.view_mut((0, k), (3, 1)).copy_from(&pull);
            wrenches
                .view_mut((3, k), (3, 1))
                .copy_from(&lever.cross(&pull));
            pulls.push(pull);
        }
        let balance = DVector::from_iterator(6, weight.iter().chain(moment.iter()).map(|w| -w));
        let tensions: Vec<f64> = least_norm(wrenches, &balance)?.iter().copied().collect();
        let loads = (0..self.tracks)
            .map(|track| {
                let force: Vector3<f64> = (0..self.rods.len())
                    .filter(|&k| self.rods[k].track == Some(track))
                    .map(|k| -pulls[k] * tensions[k])
                    .sum();
                (track_frame(self.direction(track)).transpose() * force).into()
            })
            .collect();
        Some((tensions, loads))
    }

    /// Sum of the tracker's errors at a measured TCP position (m).
    pub fn measuring_error(&self, pose: Pose, conditions: &Conditions) -> Vector3<f64> {
        let reading = TcpReading {
            position_m: pose.position_m.into(),
            time_s: conditions.time_s,
            temperature_c: conditions.temperature_c,
        };
        let errors = self.effects.iter().filter_map(Effect::on_tcp);
        errors.map(|error| Vector3::from(error(&reading))).sum()
    }
}

/// Least-norm solution of a linear system; `None` where its rank is below both sizes or a number is not
/// finite.
pub(crate) fn least_norm(matrix: DMatrix<f64>, right: &DVector<f64>) -> Option<DVector<f64>> {
    if !matrix
        .iter()
        .chain(right.iter())
        .all(|value| value.is_finite())
    {
        return None;
    }
    if matrix.is_square() {
        let solution = matrix.lu().solve(right)?;
        return solution
            .iter()
            .all(|value| value.is_finite())
            .then_some(solution);
    }
    let (solution, rank) = shortest(&matrix, right);
    (rank == matrix.nrows().min(matrix.ncols())).then_some(solution)
}

/// The shortest of the least-squares solutions, and the rank, by the eigenvectors of the smaller Gram matrix.
fn shortest(matrix: &DMatrix<f64>, right: &DVector<f64>) -> (DVector<f64>, usize) {
    let is_wide = matrix.ncols() > matrix.nrows();
    let gram = if is_wide {
        matrix * matrix.transpose()
    } else {
        matrix.transpose() * matrix
    };
    let eigen = gram.symmetric_eigen();
    let cutoff = 1e-14 * eigen.eigenvalues.max();
    let (mut sum, mut rank) = (DVector::zeros(eigen.eigenvalues.len()), 0);
    let projected = if is_wide {
        right.clone()
    } else {
        matrix.tr_mul(right)
    };
    for (vector, &value) in eigen.eigenvectors.column_iter().zip(&eigen.eigenvalues) {
        if value > cutoff {
            sum += vector * (vector.dot(&projected) / value);
            rank += 1;
        }
    }
    let solution = if is_wide { matrix.tr_mul(&sum) } else { sum };
    (solution, rank)
}
