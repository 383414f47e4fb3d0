//! The trackers of the three sets: where they stand, what they see.

use std::collections::BTreeMap;

use nalgebra::{Rotation3, Vector3};
use tau_robot::measurements::{self, CartPose, CartPosition, TcpPose};

use super::angles::zyz_angles;
use super::commanded::Commanded;
use super::effect::Conditions;
use super::machine::{CartState, Machine, State};
use super::noise::{self, Deviation};
use super::parts::Pose;
use super::plan::{SECONDS, Stop, number};
use super::random::Random;
use super::simulation::Simulation;

/// Farthest that a target sits from its cart's reference point, along each axis (m).
const MOUNTING_M: f64 = 0.15;
/// Distance of the trackers of sets 2 and 3 from the machine (m).
const TRACKER_M: (f64, f64) = (3.0, 6.0);

/// A tracker's frame and the targets that it sees: a point p of the measurement frame is seen at
/// `rotation` · p + `translation_m`.
#[derive(Debug, Clone, PartialEq)]
pub struct Mounting {
    /// Rotation of the measurement frame in the tracker's.
    pub rotation: Rotation3<f64>,
    /// Its origin there (m).
    pub translation_m: Vector3<f64>,
    /// Targets by track: place on the cart (m), from its reference point, and rotation on it, in
    /// axes of the measurement frame at q = 0.
    pub targets: Vec<(Vector3<f64>, Rotation3<f64>)>,
}

impl Mounting {
    pub(super) fn draw(tracks: usize, centre: Vector3<f64>, random: &mut Random) -> Self {
        let rotation = random.rotation();
        let distance = random.uniform(TRACKER_M.0, TRACKER_M.1);
        let translation_m = random.direction() * distance - rotation * centre;
        let targets = (0..tracks)
            .map(|_| {
                let place = Vector3::from_fn(|_, _| random.uniform(-MOUNTING_M, MOUNTING_M));
                (place, random.rotation())
            })
            .collect();
        Self {
            rotation,
            translation_m,
            targets,
        }
    }

    /// Position (m) and rotation of a cart's target as this tracker sees them.
    fn see(&self, cart: &CartState, track: usize) -> Pose {
        let (place, turn) = self.targets[track];
        Pose {
            position_m: self.rotation * (cart.point_m + cart.rotation * place) + self.translation_m,
            rotation: self.rotation * cart.rotation * turn,
        }
    }
}

/// Measures a machine with noise.
pub(super) struct Trackers<'a> {
    simulation: &'a Simulation,
    machine: &'a Machine,
    noise: noise::Generator<'a>,
}

impl<'a> Trackers<'a> {
    pub(super) fn new(simulation: &'a Simulation, machine: &'a Machine) -> Self {
        Self {
            simulation,
            machine,
            noise: noise::Generator::new(&simulation.noise, simulation.seed),
        }
    }

    /// Set 1: what is measured are the freedoms of the plate.
    pub(super) fn tcp_poses(
        &mut self,
        stops: &[Stop],
        states: &[State],
        outliers: &BTreeMap<usize, Deviation>,
    ) -> Vec<TcpPose> {
        let none = [Vector3::zeros(); 2];
        let readings = self.simulation.readings.max(1);
        let mut visits = noise::Visits::new(&self.simulation.noise, self.simulation.seed);
        let mut visit = none;
        stops
            .iter()
            .zip(states)
            .enumerate()
            .map(|(index, (stop, state))| {
                let conditions = &stop.conditions;
                let common = self.noise.pose();
                let outlier = outliers.get(&index).unwrap_or(&none);
                if index % readings == 0 {
                    visit = visits.next();
                }
                let [shift, turn] = visits.with(self.noise.next(1, 0, common), &visit);
                let error = self
                    .machine
                    .measuring_error(state.pose.position_m, conditions);
                let pose = Pose {
                    position_m: state.pose.position_m + self.seen_of_plate(error, 0),
                    ..state.pose
                };
                let deviation = [
                    self.seen_of_plate(shift + outlier[0], 0),
                    self.seen_of_plate(turn + outlier[1], 3),
                ];
                let seen = self.disturbed(pose, deviation);
                TcpPose {
                    pose: number(index),
                    line: index + 2,
                    commands_m: stop.commanded.commands_m.clone(),
                    position_m: seen.position_m.into(),
                    angles_rad: zyz_angles(&seen.rotation),
                    conditions: conditions.recorded(),
                    directions: Some(conditions.directions.clone()),
                    tensions_n: stop.tensions_n.clone(),
                    sigmas: measurements::PoseSigmas::default(),
                }
            })
            .collect()
    }

    /// Set 2: all carts stand at the same command, the arm between them; cranks and driven lengths as at home.
    pub(super) fn cart_poses(
        &mut self,
        points: &[(u32, f64, f64)],
        mounting: &Mounting,
        home: &Commanded,
    ) -> Vec<CartPose> {
        let guideways: Vec<usize> = self.machine.guideways().collect();
        let mut pose = home.pose;
        let carts: Vec<Vec<CartState>> = points
            .iter()
            .enumerate()
            .map(|(index, &(_, q, direction))| {
                let mut commands = home.commands_m.clone();
                for &track in &guideways {
                    commands[track] = q;
                }
                let conditions = Conditions {
                    directions: vec![direction; commands.len()],
                    time_s: SECONDS[1] * index as f64,
                    temperature_c: self.simulation.temperature.start_c,
                    lengths_m: vec![],
                };
                match self.machine.solve(&commands, &conditions, pose) {
                    Some(state) => {
                        pose = state.pose;
                        state.carts
                    }
                    None => self.machine.carts_without_arm(&commands, &conditions, pose),
                }
            })
            .collect();
        let mut rows = Vec::new();
        for &track in &guideways {
            for (index, (&(point, q, direction), carts)) in points.iter().zip(&carts).enumerate() {
                let common = self.noise.pose();
                let deviation = self.noise.next(2, track + 1, common);
                let seen = self.disturbed(mounting.see(&carts[track], track), deviation);
                rows.push(CartPose {
                    track,
                    point,
                    command_m: q,
                    position_m: seen.position_m.into(),
                    angles_rad: zyz_angles(&seen.rotation),
                    conditions: measurements::Conditions {
                        time_s: Some(SECONDS[1] * index as f64),
                        temperature_c: Some(self.simulation.temperature.start_c),
                    },
                    direction: Some(direction),
                });
            }
        }
        rows
    }

    pub(super) fn cart_positions(
        &mut self,
        stops: &[Stop],
        states: &[State],
        mounting: &Mounting,
    ) -> Vec<CartPosition> {
        let mut rows = Vec::new();
        for (index, (stop, state)) in stops.iter().zip(states).enumerate() {
            let common = self.noise.pose();
            for track in self.machine.guideways() {
                let cart = &state.carts[track];
                let deviation = self.noise.next(3, track + 1, common);
                let seen = self.disturbed(mounting.see(cart, track), deviation);
                rows.push(CartPosition {
                    pose: number(index),
                    track,
                    commands_m: stop.commanded.commands_m.clone(),
                    position_m: seen.position_m.into(),
                    conditions: stop.conditions.recorded(),
                    direction: stop.conditions.directions.get(track).copied(),
                });
            }
        }
        rows
    }

    /// The part of an error along the freedoms of the plate, which alone are measured: of those from `first` on.
    fn seen_of_plate(&self, error: Vector3<f64>, first: usize) -> Vector3<f64> {
        let freedoms = self.machine.plate.freedoms();
        Vector3::from_fn(|axis, _| {
            let is_free = freedoms.contains(&(first + axis));
            if is_free { error[axis] } else { 0.0 }
        })
    }

    fn disturbed(&self, pose: Pose, [shift, turn]: Deviation) -> Pose {
        let noise = self.simulation.file.noise;
        Pose {
            position_m: pose.position_m + shift * noise.position_m,
            rotation: Rotation3::new(turn * noise.rotation_rad) * pose.rotation,
        }
    }
}
