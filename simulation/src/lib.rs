//! The virtual robot: a hand-written machine that measures itself, for data of which the truth is known.
//!
//! It shares no generated function and no residual with the estimator. At each pose the rods are closed
//! exactly by a Newton method of its own, with the carts where the [effects](Effect) put them and the
//! forces in equilibrium; trackers stand in frames of their own, targets are mounted anyhow.

mod build;
mod effect;
mod machine;
mod noise;
mod parse;
mod plan;
mod plate;
mod random;
mod request;
mod write;

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};
use tau_robot::input_error::InputError;
use tau_robot::measurements::{self, CartPose, CartPosition, Folder, TcpPose};
use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;

pub use build::Build;
pub use effect::{
    CartError, CartFunction, CartReading, Conditions, Effect, LinkError, LinkFunction, LinkReading,
    Physics, TcpFunction, TcpReading,
};
pub use machine::{CartState, Machine, Pose, Rod, State};
pub use noise::{Noise, Tails};
pub use plan::{Approach, Poses, Temperature, TrackPoints};
pub use plate::{Measure, Objects, Plane};
pub use request::{Request, Summary};

use build::Commanded;
use noise::Deviation;
use plan::{Planner, SECONDS, Stop, Stops};
use random::Random;

/// Farthest that a target sits from its cart's reference point, along each axis (m).
const MOUNTING_M: f64 = 0.15;
/// Distance of the trackers of sets 2 and 3 from the machine (m).
const TRACKER_M: (f64, f64) = (3.0, 6.0);

/// A simulation. The defaults are those of the prototype's measurements.
#[derive(Clone)]
pub struct Simulation {
    /// The robot.
    pub robot: Robot,
    /// Drawings, tolerances, stated noise and payload; written as the folder's `robot.toml`.
    pub file: RobotFile,
    /// Name of the variant whose simplifications the true machine keeps: with a reduced arm, parallel
    /// links; without paths per link, carts that do not turn. `None`: none of them.
    pub variant: Option<String>,
    /// Differences of the true machine from its drawings.
    pub build: Build,
    /// Physical errors.
    pub effects: Vec<Effect>,
    /// Noise.
    pub noise: Noise,
    /// Set 1.
    pub poses: Poses,
    /// Kinds of measurement of the plate at the poses of set 1.
    pub measures: Vec<Measure>,
    /// Number of readings at each pose of set 1, at least one.
    pub readings: usize,
    /// Set 2.
    pub track_points: TrackPoints,
    /// Number of random poses of set 3; none, and there is no set 3.
    pub random_poses: usize,
    /// Sides of approach in sets 1 and 3.
    pub approach: Approach,
    /// Temperature.
    pub temperature: Temperature,
    /// Seed of all random numbers.
    pub seed: u64,
}

impl Simulation {
    /// The prototype's measurements, of a machine without errors beyond its tolerances.
    pub fn new(robot: Robot, file: RobotFile) -> Self {
        Self {
            robot,
            file,
            variant: None,
            build: Build::default(),
            effects: Vec::new(),
            noise: Noise::default(),
            poses: Poses::default(),
            measures: vec![Measure::Poses],
            readings: 1,
            track_points: TrackPoints::default(),
            random_poses: 150,
            approach: Approach::default(),
            temperature: Temperature::default(),
            seed: 1,
        }
    }
}

/// A measurement folder in memory, with the truth behind it.
#[derive(Debug, Clone)]
pub struct SimulatedFolder {
    /// The measurements.
    pub folder: Folder,
    /// The robot file that belongs to them.
    pub file: RobotFile,
    /// The hidden truth.
    pub truth: Truth,
}

/// The hidden truth.
#[derive(Debug, Clone)]
pub struct Truth {
    /// The machine as built, with its effects.
    pub machine: Machine,
    /// Names of its rods.
    pub links: Vec<String>,
    /// Effects by name and place, as the description writes it (`two`, `all`, `one,two`).
    pub effects: Vec<(String, String)>,
    /// Verdicts of discovery that are right.
    pub status: Vec<&'static str>,
    /// True states at the poses of set 1.
    pub tcp_poses: Vec<State>,
    /// Tracker and targets of set 2.
    pub set2: Mounting,
    /// Tracker and targets of set 3.
    pub set3: Mounting,
    /// Numbers of the TCP poses that are outliers.
    pub outliers: Vec<u32>,
    /// File and line of other rows that are.
    pub gross_rows: Vec<(&'static str, usize)>,
    /// Targets, surfaces and balls that measurements were taken of or from.
    pub objects: Objects,
    /// Points that were out of reach and left out of sets 1 and 3.
    pub out_of_reach: usize,
}

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
    fn draw(tracks: usize, centre: Vector3<f64>, random: &mut Random) -> Self {
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

/// Simulates a measurement folder.
///
/// # Errors
/// The robot file lacks values of a link, or the payload that an effect follows; the links do not hold the plate, or
/// not at all commands zero; fewer than two poses can be reached.
pub fn simulate(simulation: &Simulation) -> Result<SimulatedFolder, InputError> {
    Session::new(simulation)?.run()
}

struct Session<'a> {
    simulation: &'a Simulation,
    nominal: Machine,
    machine: Machine,
    home: Commanded,
    range_m: (f64, f64),
}

impl<'a> Session<'a> {
    fn new(simulation: &'a Simulation) -> Result<Self, InputError> {
        let Simulation {
            robot, file, seed, ..
        } = simulation;
        let (nominal, tolerances) = build::nominal(robot, file)?;
        // Another assembly would be another machine, of which no variant of the robot file is true.
        let Some(reference) = file.completed(robot).reference else {
            let message = "found no `[reference]`, expected the pose at which the machine stands at some commands";
            return Err(InputError::whole("robot.toml", message).help(
                "add `[reference]` with `commands_m`, `position_m` and `orientation_rad` (ZYZ) to the robot file, \
                 or `reference { … }` to the description",
            ));
        };
        let Some(pose) = build::home(&nominal, &reference) else {
            let message = "the arm can't be assembled near `[reference]`, or not at commands zero, so that the links hold the plate";
            return Err(InputError::whole("robot.toml", message).help(
                "compare lengths, joints and the reference with the drawing: in metres, and of the assembly that was built",
            ));
        };
        let home = Commanded {
            pose,
            commands_m: vec![0.0; nominal.commands],
        };
        let mut machine = match simulation.build {
            Build::Exact => nominal.clone(),
            Build::Drawn { links, tracks } => {
                let mut random = Random::new(*seed, "machine");
                build::drawn(&nominal, &tolerances, (links, tracks), &mut random)
            }
        };
        machine.effects.clone_from(&simulation.effects);
        if let Some(name) = &simulation.variant {
            let variant = robot.find(name, "--variant")?;
            build::simplify(&mut machine, robot, variant, pose);
            for (effect, places) in &variant.effects {
                let key = format!("{effect}({})", places.join(", "));
                if let Some(values) = file.effects.get(&key) {
                    machine.effects.push(Effect::of_file(&key, values, robot)?);
                }
            }
        }
        let is_loaded =
            |effect: &&Effect| effect.listed && effect::LOADED.contains(&effect.name.as_str());
        if let (None, Some(effect)) = (nominal.payload, machine.effects.iter().find(is_loaded)) {
            let message = format!(
                "found no `[payload]`, expected one: `{}` follows the forces in the arm",
                effect.name
            );
            return Err(InputError::whole("robot.toml", message)
                .help("add `[payload]` to the robot file, or give its mass with `--payload`"));
        }
        let length = nominal.mean_length_m();
        let range_m = file.range_m.unwrap_or((-length / 3.0, length / 3.0));
        Ok(Self {
            simulation,
            nominal,
            machine,
            home,
            range_m,
        })
    }

    fn run(self) -> Result<SimulatedFolder, InputError> {
        let simulation = self.simulation;
        let seed = simulation.seed;
        let planner = Planner {
            nominal: &self.nominal,
            home: &self.home,
            range_m: self.range_m,
            approach: simulation.approach,
            temperature: simulation.temperature,
        };
        let set1 = planner.tcp_poses(&simulation.poses, &mut Random::new(seed, "poses"));
        let errors = plate::drive_errors(
            &simulation.file,
            self.nominal.commands,
            simulation.noise.scale[0],
            set1.stops.len(),
            seed,
        );
        let (visited, true_states) = self.reached_by_drives(set1, errors);
        let objects = plate::Objects::draw(
            &simulation.file,
            simulation.build == Build::Exact,
            self.home.pose.position_m,
            self.nominal.mean_length_m() / 3.0,
            seed,
        );
        let gauges = plate::Gauges {
            measures: &simulation.measures,
            file: &simulation.file,
            objects: &objects,
            noise: &simulation.noise,
            readings: simulation.readings.max(1),
            seed,
        };
        let measured = gauges.measure(&visited.stops, &true_states);
        let (set1, states1) = self.read_again(&visited, true_states);
        if set1.stops.len() < 2 {
            let message = "fewer than two poses are within reach";
            return Err(InputError::whole("poses", message)
                .help("take a grid of smaller steps, or smaller effects"));
        }
        let has_carts = self.nominal.tracks > 0;
        let mut random = Random::new(seed, "random poses");
        let set3 = planner.random_poses(
            if has_carts {
                simulation.random_poses
            } else {
                0
            },
            &mut random,
        );
        let (set3, states3) = self.reached(set3);
        let points =
            planner.track_points(simulation.track_points, &mut Random::new(seed, "points"));

        let mut random = Random::new(seed, "trackers");
        let centre = self.home.pose.position_m;
        let mut mounting = || Mounting::draw(self.nominal.tracks, centre, &mut random);
        let (mounting2, mounting3) = (mounting(), mounting());

        let mut noise = noise::Generator::new(&simulation.noise, seed);
        let outliers = noise::outliers(&simulation.noise, set1.stops.len(), seed);
        let has_poses = simulation.measures.contains(&Measure::Poses);
        let (set1_stops, outliers) = if has_poses {
            (&set1.stops[..], outliers)
        } else {
            (&[][..], BTreeMap::new())
        };
        let tcp_poses = self.tcp_poses(set1_stops, &states1, &mut noise, &outliers);
        let cart_poses = if has_carts {
            self.cart_poses(&points, &mounting2, &mut noise)
        } else {
            Vec::new()
        };
        let cart_positions = self.cart_positions(&set3.stops, &states3, &mounting3, &mut noise);

        let effects: Vec<(String, String)> = self
            .machine
            .effects
            .iter()
            .map(|effect| (effect.name.clone(), write::place(effect, &simulation.robot)))
            .collect();
        let listed = self
            .machine
            .effects
            .iter()
            .filter(|effect| effect.listed)
            .count();
        let status = match (effects.len(), effects.len() - listed) {
            (0, _) => vec!["nothing_missing"],
            (_, 0) => vec!["explained"],
            _ => vec!["unnamed_structure", "partly_explained"],
        };
        Ok(SimulatedFolder {
            folder: Folder {
                name: "simulated".to_owned(),
                tcp_poses,
                cart_poses,
                cart_positions,
                plate_rows: measured.rows,
                distances: measured.distances,
                fingerprint: String::new(),
                remarks: Vec::new(),
            },
            file: RobotFile {
                reference: simulation.file.completed(&simulation.robot).reference,
                ..simulation.file.clone()
            },
            truth: Truth {
                effects,
                status,
                tcp_poses: states1,
                set2: mounting2,
                set3: mounting3,
                outliers: outliers.keys().map(|&index| number(index)).collect(),
                gross_rows: measured.gross,
                objects,
                out_of_reach: set1.left_out + set3.left_out,
                links: simulation
                    .robot
                    .links
                    .iter()
                    .map(|link| link.name.clone())
                    .collect(),
                machine: self.machine,
            },
        })
    }

    /// The same where drives err: `errors` are those of each stop. Redundant drives can't be commanded at will: the
    /// plate goes where it was meant to, and they follow and are read.
    fn reached_by_drives(&self, planned: Stops, errors: Vec<Vec<f64>>) -> (Stops, Vec<State>) {
        let is_redundant = self.nominal.is_redundant();
        let mut left_out = planned.left_out;
        let (mut stops, mut states) = (Vec::new(), Vec::new());
        for (mut stop, errors) in planned.stops.into_iter().zip(errors) {
            let with_errors = |commands: &[f64], sign: f64| -> Vec<f64> {
                let pairs = commands.iter().zip(&errors);
                pairs
                    .map(|(command, error)| command + sign * error)
                    .collect()
            };
            let state = if is_redundant {
                let target = stop.commanded.pose.position_m;
                let reached = stop.commanded.near(&self.machine, target);
                reached.and_then(|reached| {
                    let state =
                        (self.machine).solve(&reached.commands_m, &stop.conditions, reached.pose);
                    stop.commanded.commands_m = with_errors(&reached.commands_m, -1.0);
                    state
                })
            } else {
                let Commanded { pose, commands_m } = &stop.commanded;
                let truly = with_errors(commands_m, 1.0);
                self.machine.solve(&truly, &stop.conditions, *pose)
            };
            match state {
                Some(state) => {
                    stops.push(stop);
                    states.push(state);
                }
                None => left_out += 1,
            }
        }
        (Stops { stops, left_out }, states)
    }

    /// The stops at which the true machine closes, and its states there; the others are left out.
    fn reached(&self, planned: Stops) -> (Stops, Vec<State>) {
        let solve = |stop: &Stop| {
            let Commanded { pose, commands_m } = &stop.commanded;
            self.machine.solve(commands_m, &stop.conditions, *pose)
        };
        let count = planned.stops.len();
        let reached = planned.stops.into_iter();
        let (stops, states): (Vec<Stop>, Vec<State>) = reached
            .filter_map(|stop| solve(&stop).map(|state| (stop, state)))
            .unzip();
        let left_out = planned.left_out + count - stops.len();
        (Stops { stops, left_out }, states)
    }

    /// Each stop of set 1 as often as it is read, one reading after the other.
    fn read_again(&self, stops: &Stops, states: Vec<State>) -> (Stops, Vec<State>) {
        let readings = self.simulation.readings.max(1);
        let read = |k: usize, stop: &Stop| {
            let mut stop = stop.clone();
            stop.conditions.time_s += SECONDS[0] * k as f64 / readings as f64;
            stop
        };
        let again = stops.stops.iter().zip(states);
        let (stops_again, states) = again
            .flat_map(|(stop, state)| (0..readings).map(move |k| (read(k, stop), state.clone())))
            .unzip();
        let stops = Stops {
            stops: stops_again,
            ..*stops
        };
        (stops, states)
    }

    fn tcp_poses(
        &self,
        stops: &[Stop],
        states: &[State],
        noise: &mut noise::Generator<'_>,
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
                let common = noise.pose();
                let outlier = outliers.get(&index).unwrap_or(&none);
                if index % readings == 0 {
                    visit = visits.next();
                }
                let [shift, turn] = visits.with(noise.next(1, 0, common), &visit);
                let error = self.machine.measuring_error(state.pose, conditions);
                let pose = Pose {
                    position_m: state.pose.position_m + error,
                    ..state.pose
                };
                let seen = self.disturbed(pose, [shift + outlier[0], turn + outlier[1]]);
                TcpPose {
                    pose: number(index),
                    commands_m: stop.commanded.commands_m.clone(),
                    position_m: seen.position_m.into(),
                    angles_rad: zyz_angles(&seen.rotation),
                    conditions: recorded(conditions),
                    directions: Some(conditions.directions.clone()),
                    sigmas: measurements::PoseSigmas::default(),
                }
            })
            .collect()
    }

    /// All carts stand at the same command, the arm between them.
    fn cart_poses(
        &self,
        points: &[(u32, f64, f64)],
        mounting: &Mounting,
        noise: &mut noise::Generator<'_>,
    ) -> Vec<CartPose> {
        let tracks = self.nominal.tracks;
        let mut pose = self.home.pose;
        let carts: Vec<Vec<CartState>> = points
            .iter()
            .enumerate()
            .map(|(index, &(_, q, direction))| {
                let mut commands = vec![q; self.nominal.commands];
                commands[tracks..].fill(0.0);
                let conditions = Conditions {
                    directions: vec![direction; commands.len()],
                    time_s: SECONDS[1] * index as f64,
                    temperature_c: self.simulation.temperature.start_c,
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
        for track in 0..tracks {
            for (index, (&(point, q, direction), carts)) in points.iter().zip(&carts).enumerate() {
                let common = noise.pose();
                let deviation = noise.next(2, track + 1, common);
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

    fn cart_positions(
        &self,
        stops: &[Stop],
        states: &[State],
        mounting: &Mounting,
        noise: &mut noise::Generator<'_>,
    ) -> Vec<CartPosition> {
        let mut rows = Vec::new();
        for (index, (stop, state)) in stops.iter().zip(states).enumerate() {
            let common = noise.pose();
            for (track, cart) in state.carts.iter().enumerate() {
                let deviation = noise.next(3, track + 1, common);
                let seen = self.disturbed(mounting.see(cart, track), deviation);
                rows.push(CartPosition {
                    pose: number(index),
                    track,
                    commands_m: stop.commanded.commands_m.clone(),
                    position_m: seen.position_m.into(),
                    conditions: recorded(&stop.conditions),
                    direction: stop.conditions.directions.get(track).copied(),
                });
            }
        }
        rows
    }

    fn disturbed(&self, pose: Pose, [shift, turn]: Deviation) -> Pose {
        let noise = self.simulation.file.noise;
        Pose {
            position_m: pose.position_m + shift * noise.position_m,
            rotation: Rotation3::new(turn * noise.rotation_rad) * pose.rotation,
        }
    }
}

/// Number of a pose in the file.
fn number(index: usize) -> u32 {
    u32::try_from(index + 1).unwrap_or(u32::MAX)
}

fn recorded(conditions: &Conditions) -> measurements::Conditions {
    measurements::Conditions {
        time_s: Some(conditions.time_s),
        temperature_c: Some(conditions.temperature_c),
    }
}

/// ZYZ Euler angles (rad) of a rotation, the middle one in [0, π].
///
/// Half their sum and half their difference are angles of the quaternion's parts along and across z, so
/// that none of the rotation is lost near the poles, where the angles themselves mean little.
fn zyz_angles(rotation: &Rotation3<f64>) -> [f64; 3] {
    let q = UnitQuaternion::from_rotation_matrix(rotation);
    let (along, across) = (q.w.hypot(q.k), q.i.hypot(q.j));
    let half_sum = q.k.atan2(q.w);
    // Exactly level, any difference will do: the one that makes the last angle zero.
    let half_difference = if across > 0.0 {
        (-q.i).atan2(q.j)
    } else {
        half_sum
    };
    let wrapped = |angle: f64| angle - TAU * (angle / TAU).round();
    [
        wrapped(half_sum + half_difference),
        2.0 * across.atan2(along),
        wrapped(half_sum - half_difference),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn euler_angles_lose_nothing_near_the_poles() {
        use std::f64::consts::PI;
        let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
        let mut random = Random::new(1, "rotations");
        for exponent in 0..36 {
            for pole in [0.0, PI] {
                let tilt = 10_f64.powf(-0.5 * f64::from(exponent));
                let turned = about(Vector3::z_axis(), random.uniform(-PI, PI));
                let heading = random.uniform(-PI, PI);
                let axis = Vector3::new(heading.cos(), heading.sin(), 0.0);
                let rotation =
                    Rotation3::new(axis * tilt) * about(Vector3::x_axis(), pole) * turned;
                let [alpha, beta, gamma] = zyz_angles(&rotation);
                let again = about(Vector3::z_axis(), alpha)
                    * about(Vector3::y_axis(), beta)
                    * about(Vector3::z_axis(), gamma);
                let off = (again.matrix() - rotation.matrix()).amax();
                assert!(off < 2e-15, "{tilt:e} {pole}: {off:e}");
                assert!((0.0..=PI).contains(&beta));
            }
        }
        let level = zyz_angles(&about(Vector3::z_axis(), 0.7));
        assert!(
            (level[0] - 0.7).abs() < 1e-15 && level[1..] == [0.0, 0.0],
            "{level:?}"
        );
    }
}
