//! The machine at commands, or with its plate at a place: joints, lengths and forces that agree with each other.
//!
//! Nothing here is shared with the estimator: distances instead of their squares, rotation matrices
//! instead of Euler angles, equilibrium by iteration instead of at nominal dimensions.

use nalgebra::{DMatrix, DVector, Rotation3, Vector3};

use super::closing::{self, SETTLED};
use super::effect::{BaseReading, CartReading, Conditions, DriveReading, Effect, LinkReading};
use super::linear::least_norm;
use super::machine::{CartState, Machine, State, track_frame};
use super::parts::Pose;

/// Rounds of displacement, closure and equilibrium; each reduces the error by the ratio of arm to cart
/// stiffness, a hundredfold at the least.
const EQUILIBRIUM_ROUNDS: usize = 60;

/// Unknowns of a closure: the pose at given commands, or the commands at a given position of the TCP.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Unknowns {
    Pose,
    Commands,
}

impl Machine {
    /// The machine at commands: joints where the effects put them, rods exactly of their length,
    /// forces in equilibrium, all three consistent. Of several ways of assembling the arm, the one that
    /// Newton's method reaches from `start`. `None` where the rods do not meet.
    pub fn solve(&self, commands: &[f64], conditions: &Conditions, start: Pose) -> Option<State> {
        let (state, _) = self.settle(commands.to_vec(), conditions, start, Unknowns::Pose)?;
        Some(state)
    }

    /// The machine with its TCP at the position of `start`, and the commands near those given at which it stands there;
    /// the orientation is what the arm leaves it, nearest to that of `start`. `None` where it is out of reach.
    pub(crate) fn reach(
        &self,
        commands: &[f64],
        conditions: &Conditions,
        start: Pose,
    ) -> Option<(State, Vec<f64>)> {
        self.settle(commands.to_vec(), conditions, start, Unknowns::Commands)
    }

    fn settle(
        &self,
        mut commands: Vec<f64>,
        conditions: &Conditions,
        start: Pose,
        unknowns: Unknowns,
    ) -> Option<(State, Vec<f64>)> {
        let mut state = self.unloaded(&commands, start);
        for round in 0..EQUILIBRIUM_ROUNDS {
            self.displace(&commands, conditions, &mut state);
            let (before, commands_before) = (state.pose, commands.clone());
            match unknowns {
                Unknowns::Pose => state.pose = closing::pose(self, &state)?,
                Unknowns::Commands => {
                    (state.pose, commands) = closing::commands(self, &state, &commands)?;
                }
            }
            let (tensions, loads) = self.forces(&state)?;
            let ways = commands.iter().zip(&commands_before).zip(&self.ways_m);
            let moved = (state.pose.position_m - before.position_m).norm()
                + (state.pose.rotation.matrix() - before.rotation.matrix()).norm()
                + ways
                    .map(|((now, then), way)| (now - then).abs() * way)
                    .fold(0.0, f64::max);
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
                return Some((state, commands));
            }
        }
        None
    }

    /// The carts where the arm does not close: as if it were taken off.
    pub(crate) fn carts_without_arm(
        &self,
        commands: &[f64],
        conditions: &Conditions,
        pose: Pose,
    ) -> Vec<CartState> {
        let mut state = self.unloaded(commands, pose);
        self.displace(commands, conditions, &mut state);
        state.carts
    }

    /// The machine without forces and effects, its plate at a pose.
    pub(crate) fn unloaded(&self, commands: &[f64], pose: Pose) -> State {
        let command = |index: Option<usize>| index.and_then(|k| commands.get(k)).copied();
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
                    let crank = rod.track.and_then(|track| self.crank(track));
                    rod.joint_at(crank, command(rod.track).unwrap_or(0.0))
                })
                .collect(),
            plate_joints_m: self.rods.iter().map(|rod| rod.plate_joint_m).collect(),
            lengths_m: self
                .rods
                .iter()
                .map(|rod| rod.length_at(command(rod.actuated_by).unwrap_or(0.0)))
                .collect(),
            tensions_n: vec![0.0; self.rods.len()],
            loads_n: vec![[0.0; 3]; self.tracks],
        }
    }

    /// Moves joints and changes lengths by what the effects say at the state's forces and pose.
    fn displace(&self, commands: &[f64], conditions: &Conditions, state: &mut State) {
        let driven = self.driven(commands, conditions);
        let mut straight = self.unloaded(&driven, state.pose);
        for k in 0..self.rods.len() {
            straight.joints_m[k] += self.shift_of_base(k, conditions);
        }
        let command = |k: usize| commands.get(k).copied().unwrap_or(0.0);
        let direction = |k: usize| conditions.directions.get(k).copied().unwrap_or(1.0);
        for (track, &commanded) in driven.iter().enumerate().take(self.tracks) {
            let mut shift = Vector3::zeros();
            let mut turn = Vector3::zeros();
            for (effect, source) in self
                .effects
                .iter()
                .filter(|_| self.crank(track).is_none())
                .filter_map(|effect| effect.on_cart(track))
            {
                let error = effect(&CartReading {
                    q_m: command(track),
                    travel: self.travelled(track, command(track)),
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
            let built = self.built_rotation(track, commanded);
            state.carts[track] = CartState {
                point_m: point,
                rotation: turn * built,
            };
        }
        for (k, rod) in self.rods.iter().enumerate() {
            if rod.track.is_none() {
                state.joints_m[k] = straight.joints_m[k];
            }
            let own = rod.track.or(rod.actuated_by);
            let reading = LinkReading {
                length_m: rod.undisturbed_m(rod.actuated_by.map_or(0.0, command)),
                tension_n: state.tensions_n[k],
                q_m: own.map_or(0.0, command),
                paid_out_m: match (&rod.transmission, rod.actuated_by) {
                    (Some(_), Some(k)) => rod.length_at(command(k)) - rod.length_at(0.0),
                    _ => 0.0,
                },
                direction_on_plate: {
                    let plate_joint =
                        state.pose.position_m + state.pose.rotation * rod.plate_joint_m;
                    let along = (state.joints_m[k] - plate_joint).normalize();
                    (state.pose.rotation.inverse() * along).into()
                },
                direction: own.map_or(1.0, direction),
                time_s: conditions.time_s,
                temperature_c: conditions.temperature_c,
                tcp_m: state.pose.position_m.into(),
            };
            let drawn = conditions.lengths_m.get(k).copied().unwrap_or(0.0);
            state.lengths_m[k] = straight.lengths_m[k] + drawn;
            state.plate_joints_m[k] = straight.plate_joints_m[k];
            for effect in self.effects.iter().filter_map(|effect| effect.on_link(k)) {
                let error = effect(&reading);
                state.lengths_m[k] += error.length_m;
                state.plate_joints_m[k] += Vector3::from(error.joint_m);
            }
        }
    }

    /// Commands (m or rad) with what the effects make the drives of links and cranks add to them.
    fn driven(&self, commands: &[f64], conditions: &Conditions) -> Vec<f64> {
        let reading = |drive: usize| DriveReading {
            q: commands[drive],
            travel: self.travelled(drive, commands[drive]),
            direction: conditions.directions.get(drive).copied().unwrap_or(1.0),
            time_s: conditions.time_s,
            temperature_c: conditions.temperature_c,
        };
        let mut driven = commands.to_vec();
        for effect in &self.effects {
            for track in (0..self.tracks).filter(|&track| self.crank(track).is_some()) {
                if let Some(error) = effect.on_crank(track) {
                    driven[track] += error(&reading(track));
                }
            }
            for (link, rod) in self.rods.iter().enumerate() {
                if let (Some(drive), Some(error)) = (rod.actuated_by, effect.on_drive_of_link(link))
                {
                    driven[drive] += error(&reading(drive));
                }
            }
        }
        driven
    }

    /// Displacement (m) of the joint of a rod with the base, or with the crank that carries it.
    fn shift_of_base(&self, link: usize, conditions: &Conditions) -> Vector3<f64> {
        let rod = &self.rods[link];
        let crank = rod
            .track
            .and_then(|track| Some((track, self.crank(track)?)));
        let point = crank.map_or(rod.track_offset_m, |(_, crank)| crank.centre_m);
        let reading = BaseReading {
            point_m: point.into(),
            time_s: conditions.time_s,
            temperature_c: conditions.temperature_c,
        };
        let shift = |effect: &Effect| {
            let error = match (crank, rod.track) {
                (Some((track, _)), _) => effect.on_crank_centre(track)?,
                (None, None) => effect.on_base_joint(link)?,
                // Carts stand on tracks, which have errors of their own.
                (None, Some(_)) => return None,
            };
            Some(Vector3::from(error(&reading)))
        };
        self.effects.iter().filter_map(shift).sum()
    }

    /// Tensions that hold the plate in equilibrium in its freedoms under payload and pulls, and the forces of the arm on
    /// the carts. Where more drives hold their position than there are freedoms, the smallest such tensions.
    fn forces(&self, state: &State) -> Option<(Vec<f64>, Vec<[f64; 3]>)> {
        if !self.is_loaded() {
            return Some((vec![0.0; self.rods.len()], vec![[0.0; 3]; self.tracks]));
        }
        let Pose {
            position_m,
            rotation,
        } = state.pose;
        let (weight, moment) = match self.payload {
            Some(payload) => {
                let weight = Vector3::from(payload.gravity_m_s2) * payload.mass_kg;
                let lever = rotation * Vector3::from(payload.centre_m);
                (weight, lever.cross(&weight))
            }
            None => (Vector3::zeros(), Vector3::zeros()),
        };
        let freedoms = self.plate.freedoms();
        let load: Vec<f64> = weight.iter().chain(&moment).copied().collect();
        let mut balance = DVector::from_fn(freedoms.len(), |row, _| -load[freedoms[row]]);
        let holding: Vec<usize> = (0..self.rods.len())
            .filter(|&k| self.rods[k].pull_n.is_none())
            .collect();
        let mut wrenches = DMatrix::zeros(freedoms.len(), holding.len());
        let mut pulls = Vec::with_capacity(self.rods.len());
        let joints = state.joints_m.iter().zip(&state.plate_joints_m);
        for (k, (joint, plate_joint)) in joints.enumerate() {
            let lever = rotation * plate_joint;
            let pull = (joint - position_m - lever).normalize();
            let turn = lever.cross(&pull);
            let wrench: Vec<f64> = pull.iter().chain(&turn).copied().collect();
            let wrench = DVector::from_fn(freedoms.len(), |row, _| wrench[freedoms[row]]);
            match self.rods[k].pull_n {
                Some(tension) => balance -= wrench * tension,
                None => {
                    let column = holding.iter().take_while(|&&other| other < k).count();
                    wrenches.set_column(column, &wrench);
                }
            }
            pulls.push(pull);
        }
        let held = least_norm(wrenches, &balance)?;
        let mut held = held.iter().copied();
        let tensions: Vec<f64> = (self.rods.iter())
            .map(|rod| (rod.pull_n).unwrap_or_else(|| held.next().unwrap_or(0.0)))
            .collect();
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
}
