//! A simulation from drawings to measurements.

use std::collections::BTreeMap;
use tau_robot::input_error;

use tau_codes::{Remark, files, remark};
use tau_robot::input_error::InputError;
use tau_robot::measurements::{CART_POSITIONS, Folder, PlateKind, Shape};
use tau_robot::number::shortest;
use tau_robot::robot_file::RobotFile;

use super::build::{self, Build};
use super::commanded::Commanded;
use super::drawing::{self, Drawing};
use super::effect::Effect;
use super::folder::{SimulatedFolder, Truth};
use super::forces;
use super::listed::LOADED;
use super::machine::{Machine, State};
use super::noise;
use super::plan::{Planner, Poses, SECONDS, Stop, Stops, number};
use super::plate::{self, Measure};
use super::random::Random;
use super::simulation::Simulation;
use super::trackers::{Mounting, Trackers};
use super::write;

/// A force (N) that is rounding beside the load of any machine.
const NO_FORCE_N: f64 = 1e-9;

/// Simulates a measurement folder.
///
/// # Errors
/// The robot file lacks values that nothing else gives, or the payload that an effect follows; the links do not hold the
/// plate at the reference; fewer than two poses can be reached.
pub fn simulate(simulation: &Simulation) -> Result<SimulatedFolder, InputError> {
    Session::new(simulation)?.run()
}

/// A remark on what would be within reach, where points of a grid are not.
pub fn within_reach(simulation: &Simulation) -> Option<Remark> {
    let session = Session::new(simulation).ok()?;
    let is_grid = matches!(simulation.poses, Poses::Grid { .. });
    let places_tcp = session.home.places_tcp(&session.nominal);
    (is_grid && places_tcp)
        .then(|| remark!(files::LEFT_OUT; "to stay within reach, {}", session.advice()))
}

/// Stream of the random numbers of set 1.
const POSES: &str = "poses";

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
        // Another assembly would be another machine, of which no variant of the robot file is true.
        let Some(reference) = file.completed(robot).reference else {
            return Err(
                input_error!(tau_codes::kinematics::NO_REFERENCE, &file.source;
                    "found no `[reference]`, expected the pose at which the machine stands at some commands";
                    "{}", file.reference_advice(robot)),
            );
        };
        let mut drawing = Drawing::new(robot, file, &reference)?;
        drawing::refuse_not_finite(&drawing.nominal, robot, &file.source)?;
        let Some(home) = Commanded::reference(&drawing.nominal, &reference) else {
            if let Some(free) = Commanded::free_at(&drawing.nominal, &reference) {
                return Err(
                    input_error!(tau_codes::kinematics::REFERENCE_SINGULAR, &file.source;
                        "the machine is singular at its `[reference]`: the plate is free to {free}";
                        "links whose lines meet, are parallel or lie in one plane hold the plate too loosely: compare \
                         joints and the reference with the drawing"),
                );
            }
            return Err(
                input_error!(tau_codes::kinematics::REFERENCE_UNASSEMBLED, &file.source;
                    "the arm can't be assembled near `[reference]` so that the links hold the plate";
                    "compare lengths, joints and the reference with the drawing: in metres, and of the assembly that was \
                     built"),
            );
        };
        // A scale that the ordinary variant holds, or what else it can't describe, would be an error that nobody asked for.
        let variant = match &simulation.variant {
            Some(name) => Some(robot.find(name, "--variant")?),
            None => robot.base(),
        };
        if let Some(variant) = variant {
            drawing.hold(&variant.name);
        }
        let mut machine = match simulation.build {
            Build::Exact => drawing.nominal.clone(),
            Build::Drawn { links, tracks } => build::drawn(&drawing, links, tracks, *seed),
        };
        drawing::refuse_not_finite(&machine, robot, &file.source)?;
        let nominal = drawing.nominal;
        machine.effects.clone_from(&simulation.effects);
        if let Some(variant) = variant {
            build::simplify(&mut machine, robot, variant, home.pose);
            for (effect, places) in &variant.effects {
                let key = format!("{effect}({})", places.join(", "));
                if let Some(values) = file.effects.get(&key) {
                    machine.effects.push(Effect::of_file(&key, values, robot)?);
                }
            }
        }
        let follows_forces =
            |effect: &&Effect| effect.listed && LOADED.contains(&effect.name.as_str());
        let following = machine.effects.iter().find(follows_forces);
        if let Some(effect) = following.filter(|_| !machine.is_loaded()) {
            return Err(input_error!(files::NO_FORCES, &file.source;
                "found no `[payload]`, expected one: `{}` follows the forces in the arm", effect.name;
                "add `[payload]` to the robot file, or give its mass with `--payload`"));
        }
        if simulation.noise_force_n.is_some() {
            forces::check(&machine)?;
        }
        let range_m = file.range_m.unwrap_or_else(|| {
            let length = nominal.mean_length_m();
            let commands = nominal.guideways().map(|track| home.commands_m[track]);
            let middle = commands.sum::<f64>() / nominal.guideways().count().max(1) as f64;
            (middle - length / 3.0, middle + length / 3.0)
        });
        Ok(Self {
            simulation,
            nominal,
            machine,
            home,
            range_m,
        })
    }

    /// The folder. Effects along the travel of a drive scale to what the robot file states of it, or else to the extent of
    /// the commands in the folder. Redundant drives follow the plate, so that their commands depend on the effects again;
    /// each round brings both nearer by the size of the effects over that of the machine.
    fn run(mut self) -> Result<SimulatedFolder, InputError> {
        /// Change of the travel, as a share of it, that is rounding.
        const SETTLED: f64 = 1e-13;
        const ROUNDS: usize = 8;
        let stated = &self.simulation.file.measuring.travel;
        self.machine.travel.clone_from(stated);
        let mut simulated = self.measure()?;
        if !stated.is_empty() || !self.machine.effects.iter().any(Effect::reads_travel) {
            return Ok(simulated);
        }
        for _ in 0..ROUNDS {
            let found = simulated.folder.travel(self.machine.commands);
            let pairs = found.iter().zip(&self.machine.travel);
            let is_settled = found.len() == self.machine.travel.len()
                && pairs
                    .clone()
                    .all(|([low, high], [low_before, high_before])| {
                        let change = (low - low_before).abs().max((high - high_before).abs());
                        change <= SETTLED * (high - low)
                    });
            if is_settled {
                break;
            }
            self.machine.travel = found;
            simulated = self.measure()?;
        }
        Ok(simulated)
    }

    fn measure(&self) -> Result<SimulatedFolder, InputError> {
        let simulation = self.simulation;
        let seed = simulation.seed;
        let is_random = matches!(simulation.poses, Poses::Random { .. });
        let mut planner = self.planner();
        self.check_tilt()?;
        let mut random = Random::new(seed, POSES);
        let set1 = planner.tcp_poses(&simulation.poses, simulation.tilt_rad, &mut random);
        let planned = set1.stops.len();
        let mut remarks = Vec::new();
        if !self.home.places_tcp(&self.nominal) {
            let text = "the drives move the TCP about the reference only with large turns of the plate, or not along each \
                        axis: poses are at random commands, and no grid";
            remarks.push(Remark::new(files::LEFT_OUT, text));
        }
        // Carts are measured where the poses need them.
        if let (None, false) = (simulation.file.range_m, is_random)
            && let Some(range_m) = self.range_of(&set1)
        {
            planner.range_m = range_m;
        }
        let (visited, true_states) = self.visited(set1);
        let objects = plate::Objects::draw(
            &simulation.file,
            simulation.build == Build::Exact,
            self.home.pose.position_m,
            self.nominal.workspace_m() / 3.0,
            seed,
        );
        let gauges = plate::Gauges {
            machine: &self.machine,
            measures: &simulation.measures,
            file: &simulation.file,
            objects: &objects,
            noise: &simulation.noise,
            readings: simulation.readings.max(1),
            seed,
        };
        let measured = gauges.measure(&visited.stops, &true_states);
        let (set1, states1) = self.read_again(&visited, true_states);
        let readings = 0..states1.len();
        let pose_numbers = readings.map(|reading| gauges.number_of_reading(reading));
        let pose_numbers = pose_numbers.collect();
        if set1.stops.len() < 2 {
            return Err(self.too_few(planned));
        }
        remarks.extend(self.remarks_on_measures(&states1));
        // Without a tracker's noise there is no tracker that could measure carts.
        let noise = simulation.file.noise;
        let has_tracker = noise.position_m.is_finite() && noise.rotation_rad.is_finite();
        let has_carts = has_tracker && self.nominal.guideways().next().is_some();
        let mut random = Random::new(seed, "random poses");
        let set3 = planner.random_poses(
            if has_carts {
                simulation.random_poses
            } else {
                0
            },
            &mut random,
        );
        let (mut set3, mut states3) = self.reached(set3);
        // A single pose says nothing of how carts move, and readers refuse it.
        if set3.stops.len() == 1 {
            remarks.push(remark!(files::LEFT_OUT;
                "{CART_POSITIONS} is left out: of {} random poses one is within reach", simulation.random_poses));
            (set3.stops, states3) = (vec![], vec![]);
        }
        let points =
            planner.track_points(simulation.track_points, &mut Random::new(seed, "points"));

        let mut random = Random::new(seed, "trackers");
        let centre = self.home.pose.position_m;
        let mut mounting = || Mounting::draw(self.nominal.tracks, centre, &mut random);
        let (mounting2, mounting3) = (mounting(), mounting());

        let outliers = noise::outliers(&simulation.noise, set1.stops.len(), seed);
        let has_poses = simulation.measures.contains(&Measure::Poses);
        let (set1_stops, outliers) = if has_poses {
            (&set1.stops[..], outliers)
        } else {
            (&[][..], BTreeMap::new())
        };
        let mut trackers = Trackers::new(simulation, &self.machine);
        let tcp_poses = trackers.tcp_poses(set1_stops, &states1, &outliers);
        let cart_poses = if has_carts {
            trackers.cart_poses(&points, &mounting2, &self.home)
        } else {
            Vec::new()
        };
        let cart_positions = trackers.cart_positions(&set3.stops, &states3, &mounting3);

        let (effects, status) = self.hidden();
        Ok(SimulatedFolder {
            shape: Shape::from(&simulation.robot),
            folder: Folder {
                name: "simulated".to_owned(),
                tcp_poses,
                has_positions_for_poses: false,
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
                pose_numbers,
                set2: mounting2,
                set3: mounting3,
                outliers: outliers.keys().map(|&index| number(index)).collect(),
                gross_rows: measured.gross,
                objects,
                out_of_reach: set1.left_out + set3.left_out,
                remarks,
                links: simulation
                    .robot
                    .links
                    .iter()
                    .map(|link| link.name.clone())
                    .collect(),
                tracks: simulation.robot.tracks.clone(),
                machine: self.machine.clone(),
            },
        })
    }

    fn check_tilt(&self) -> Result<(), InputError> {
        if self.simulation.tilt_rad > 0.0 && !self.home.turns_plate(&self.nominal) {
            return Err(input_error!(tau_codes::kinematics::NO_TURN, "--tilt";
                "the drives can't turn the plate where it is: its orientation follows from its position, or it has none";
                "leave the option out"));
        }
        Ok(())
    }

    /// Where the plate comes to stand on its way through planned poses, as drives and links are off, with its forces.
    fn visited(&self, mut planned: Stops) -> (Stops, Vec<State>) {
        let Simulation {
            file, noise, seed, ..
        } = self.simulation;
        let (scale, count) = (noise.scale[0], planned.stops.len());
        let errors = plate::drive_errors(file, &self.nominal.ways_m, scale, count, *seed);
        let lengths = plate::length_errors(file, self.machine.rods.len(), scale, count, *seed);
        for (stop, lengths_m) in planned.stops.iter_mut().zip(lengths) {
            stop.conditions.lengths_m = lengths_m;
        }
        let (mut visited, states) = self.reached_by_drives(planned, errors);
        if let Some(sigma_n) = self.simulation.noise_force_n {
            let stops = &mut visited.stops;
            forces::measure(&self.machine, stops, &states, noise, sigma_n, *seed);
        }
        (visited, states)
    }

    /// Name and place of each hidden effect, and the statuses that a search may answer with.
    fn hidden(&self) -> (Vec<(String, String)>, Vec<&'static str>) {
        let all = &self.machine.effects;
        let status = if all.is_empty() {
            vec!["nothing_missing"]
        } else if all.iter().all(|effect| effect.listed) {
            vec!["explained"]
        } else {
            vec!["unnamed_structure", "partly_explained"]
        };
        let place = |effect: &Effect| write::place(effect, &self.simulation.robot);
        let effects = all
            .iter()
            .map(|effect| (effect.name.clone(), place(effect)));
        (effects.collect(), status)
    }

    fn planner(&self) -> Planner<'_> {
        Planner {
            nominal: &self.nominal,
            home: &self.home,
            range_m: self.range_m,
            approach: self.simulation.approach,
            temperature: self.simulation.temperature,
        }
    }

    /// The options that take poses within reach.
    fn advice(&self) -> String {
        let steps = self.fitting_steps().map(|steps| format!("{steps}, or "));
        format!(
            "take {}poses at random with --random",
            steps.unwrap_or_default()
        )
    }

    /// The option that gives a grid of which all points are within reach, where those that are asked for are not.
    fn fitting_steps(&self) -> Option<String> {
        let Simulation {
            poses,
            tilt_rad,
            seed,
            ..
        } = self.simulation;
        let random = Random::new(*seed, POSES);
        let steps = self
            .planner()
            .steps_within_reach(poses, *tilt_rad, &random)?;
        let steps = steps.map(shortest);
        Some(format!("--grid-step {}", steps.join(",")))
    }

    /// The error that fewer than two poses are left of those planned.
    fn too_few(&self, planned: usize) -> InputError {
        if planned > 1 {
            return input_error!(tau_codes::kinematics::TOO_FEW_WITHIN_REACH, "poses";
                "fewer than two poses are within reach of the machine that was drawn from the tolerances, with its \
                 effects; {planned} are of that of the drawings";
                "give smaller tolerances, or smaller effects, or take the drawings with --exact");
        }
        input_error!(tau_codes::kinematics::TOO_FEW_WITHIN_REACH, "poses"; "fewer than two poses are within reach";
            "{}", self.advice())
    }

    /// Remarks on what says nothing: measurements that no pose changes, effects of forces where none act, and of a tracker without one.
    fn remarks_on_measures(&self, states: &[State]) -> Vec<Remark> {
        let Simulation { measures, .. } = self.simulation;
        let mut remarks = Vec::new();
        let mut says_nothing = |text: String| remarks.push(Remark::new(files::SAYS_NOTHING, text));
        let surfaces = self.simulation.file.measuring.surfaces.is_empty();
        if self.nominal.plate.is_in_plane()
            && surfaces
            && measures.contains(&Measure::Rows(PlateKind::Height))
        {
            says_nothing(
                "heights over the plane in which the plate stays say nothing of it: place `[surfaces]` across it in \
                 the robot file"
                    .to_owned(),
            );
        }
        let is_alone = measures
            .iter()
            .all(|kind| *kind == Measure::Rows(PlateKind::Reading));
        if is_alone && !self.nominal.is_redundant() {
            says_nothing(
                "readings alone say nothing of the machine: it has no more drives than its plate has freedoms; measure \
                 something of the plate, too"
                    .to_owned(),
            );
        }
        let forces = states.iter().flat_map(|state| {
            let loads = state.loads_n.iter().flatten();
            state
                .tensions_n
                .iter()
                .chain(loads)
                .map(|force| force.abs())
        });
        let largest = forces.fold(0.0, f64::max);
        let following = self.machine.effects.iter();
        let following = following.filter(|effect| LOADED.contains(&effect.name.as_str()));
        for effect in following.filter(|_| largest < NO_FORCE_N) {
            says_nothing(format!(
                "`{}` does nothing: no forces act in the arm at these poses",
                effect.name
            ));
        }
        let of_tracker = [Measure::Poses, Measure::Rows(PlateKind::Position)];
        if !of_tracker.iter().any(|kind| measures.contains(kind)) {
            let effects = self.machine.effects.iter();
            for effect in effects.filter(|effect| effect.on_tcp().is_some()) {
                says_nothing(format!(
                    "`{}` does nothing: no tracker measures poses or positions of the plate",
                    effect.name
                ));
            }
        }
        remarks
    }

    /// Lowest and highest command of carts at some stops (m).
    fn range_of(&self, stops: &Stops) -> Option<(f64, f64)> {
        let commands = stops.stops.iter().flat_map(|stop| {
            let commands = &stop.commanded.commands_m;
            self.nominal.guideways().map(|track| commands[track])
        });
        let pairs = commands.map(|command| (command, command));
        let widest = pairs.reduce(|(low, high), (q, _)| (low.min(q), high.max(q)));
        widest.filter(|(low, high)| low < high)
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
            let Commanded { pose, commands_m } = &stop.commanded;
            let state = if is_redundant {
                let reached = self.machine.reach(commands_m, &stop.conditions, *pose);
                reached.map(|(state, commands)| {
                    stop.commanded.commands_m = with_errors(&commands, -1.0);
                    state
                })
            } else {
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
}

#[cfg(test)]
mod tests;
