//! The plan of measurements: poses, points on the tracks, order, time, temperature and side of approach.

use nalgebra::Vector3;
use tau_codegen::language::model::Plate;

use super::commanded::Commanded;
use super::effect::Conditions;
use super::machine::{Machine, track_frame};
use super::random::Random;

/// Choice of the TCP's positions in set 1.
#[derive(Debug, Clone, PartialEq)]
pub enum Poses {
    /// A grid about the pose of the reference: layers along the mean track, rows across, columns up,
    /// walked to and fro. In a plane nothing goes up: a column is one point.
    Grid {
        /// Layers, rows, columns.
        counts: [usize; 3],
        /// Steps (m); by default those of the prototype, in proportion to the links.
        step_m: Option<[f64; 3]>,
        /// Poses after which to stop.
        limit: Option<usize>,
        /// Random displacement of each point, as a share of the step.
        jitter: f64,
    },
    /// At random in the box that the prototype's grid fills, with all commands in the measured range.
    Random {
        /// Number.
        count: usize,
    },
    /// At these positions (m).
    Positions(Vec<[f64; 3]>),
}

impl Default for Poses {
    fn default() -> Self {
        Self::Grid {
            counts: GRID,
            step_m: None,
            limit: Some(176),
            jitter: 0.0,
        }
    }
}

/// Points on each track in set 2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackPoints {
    /// Number of points; none, and there is no set 2.
    pub count: usize,
    /// Random displacement of each point within the track, as a share of the step, as ISO 230-2 asks
    /// for against aliasing.
    pub jitter: f64,
    /// True if each point is measured on the way back, too.
    pub both_ways: bool,
}

impl Default for TrackPoints {
    fn default() -> Self {
        Self {
            count: 28,
            jitter: 0.0,
            both_ways: false,
        }
    }
}

/// The side from which poses are approached.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Approach {
    /// As the last move leaves it.
    #[default]
    Moves,
    /// At random, by a detour.
    Random,
}

/// Temperature during set 1; sets 2 and 3 are taken before, at its start.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Temperature {
    /// At the start (°C).
    pub start_c: f64,
    /// Rise that it tends to (K).
    pub rise_k: f64,
    /// Time in which it comes nearer by a factor e (s).
    pub time_constant_s: f64,
    /// Random part, one standard deviation (K).
    pub jitter_k: f64,
}

impl Default for Temperature {
    fn default() -> Self {
        Self {
            start_c: 20.0,
            rise_k: 0.0,
            time_constant_s: 2000.0,
            jitter_k: 0.02,
        }
    }
}

impl Temperature {
    fn at(&self, time_s: f64, random: &mut Random) -> f64 {
        self.start_c
            + self.rise_k * (1.0 - (-time_s / self.time_constant_s).exp())
            + self.jitter_k * random.normal()
    }
}

/// The prototype's grid, and its steps over the mean link length.
const GRID: [usize; 3] = [6, 6, 5];
const STEPS: [f64; 3] = [0.24 / 2.0435, 0.2 / 2.0435, 0.2 / 2.0435];
/// Times between measurements of the three sets (s).
pub(super) const SECONDS: [f64; 3] = [30.0, 20.0, 10.0];
/// Farthest that the plate turns from home (rad): spherical joints swing by twenty degrees or so.
pub const FARTHEST_TURN: f64 = 0.35;
/// Commands are rounded as a controller's are (1/m).
const COUNTS_PER_METRE: f64 = 1e7;

/// Number of a pose in the files.
pub(super) fn number(index: usize) -> u32 {
    u32::try_from(index + 1).unwrap_or(u32::MAX)
}

/// One stop: commands with the pose where the machine of the drawings would be.
#[derive(Debug, Clone)]
pub(super) struct Stop {
    pub(super) commanded: Commanded,
    pub(super) conditions: Conditions,
    /// Measured tension of each link (N), NaN where it is not; `None` where none is.
    pub(super) tensions_n: Option<Vec<f64>>,
}

/// Stops, and how many points were out of reach.
pub(super) struct Stops {
    pub(super) stops: Vec<Stop>,
    pub(super) left_out: usize,
}

/// Places that the machine can take, and how many it can't.
struct Reached {
    stops: Vec<Commanded>,
    left_out: usize,
}

/// Input of a plan.
pub(super) struct Planner<'a> {
    /// The machine of the drawings.
    pub(super) nominal: &'a Machine,
    /// At the reference.
    pub(super) home: &'a Commanded,
    /// Measured range of the commands (m).
    pub(super) range_m: (f64, f64),
    pub(super) approach: Approach,
    pub(super) temperature: Temperature,
}

impl Planner<'_> {
    /// Set 1.
    pub(super) fn tcp_poses(&self, poses: &Poses, tilt_rad: f64, random: &mut Random) -> Stops {
        let mut reached = match poses {
            Poses::Grid { counts, limit, .. } if !self.home.places_tcp(self.nominal) => {
                let points = grid_points(*counts, self.nominal.plate);
                self.random(points.min(limit.unwrap_or(usize::MAX)), random)
            }
            Poses::Grid {
                counts,
                step_m,
                limit,
                jitter,
            } => {
                let steps = step_m.unwrap_or_else(|| self.default_steps());
                let points = self.grid(*counts, steps, *jitter, random);
                let mut reached = self.visit(&points);
                reached.stops.truncate(limit.unwrap_or(usize::MAX));
                reached
            }
            Poses::Random { count } => self.random(*count, random),
            Poses::Positions(points) => {
                self.visit(&points.iter().map(|&point| point.into()).collect::<Vec<_>>())
            }
        };
        if tilt_rad > 0.0 {
            reached = self.tilted(reached, tilt_rad, random);
        }
        self.schedule(reached, 0.0, SECONDS[0], true, random)
    }

    /// Set 3: random poses.
    pub(super) fn random_poses(&self, count: usize, random: &mut Random) -> Stops {
        let reached = self.random(count, random);
        self.schedule(reached, SECONDS[2], SECONDS[2], false, random)
    }

    /// Set 2: commands of all carts and sides of approach, in order.
    pub(super) fn track_points(
        &self,
        points: TrackPoints,
        random: &mut Random,
    ) -> Vec<(u32, f64, f64)> {
        let (low, high) = self.range_m;
        let step = (high - low) / (points.count.max(2) - 1) as f64;
        let there: Vec<(u32, f64, f64)> = (0..points.count)
            .map(|k| {
                let q = low + step * k as f64 + points.jitter * step * random.uniform(-0.5, 0.5);
                (k as u32 + 1, rounded(q.clamp(low, high)), 1.0)
            })
            .collect();
        let back = there.iter().rev().map(|&(point, q, _)| (point, q, -1.0));
        let back: Vec<_> = if points.both_ways {
            back.collect()
        } else {
            Vec::new()
        };
        there.into_iter().chain(back).collect()
    }

    fn default_steps(&self) -> [f64; 3] {
        STEPS.map(|share| share * self.nominal.workspace_m())
    }

    /// Along the mean track, across it and up; the axes of the measurement frame without tracks.
    fn axes(&self) -> nalgebra::Matrix3<f64> {
        let tracks = 0..self.nominal.tracks;
        let mean: Vector3<f64> = tracks.map(|track| self.nominal.direction(track)).sum();
        track_frame(mean)
    }

    fn grid(
        &self,
        counts: [usize; 3],
        steps: [f64; 3],
        jitter: f64,
        random: &mut Random,
    ) -> Vec<Vector3<f64>> {
        let (axes, centre) = (self.axes(), self.home.pose.position_m);
        let counts = counts_of(counts, self.nominal.plate);
        let mut points = Vec::new();
        let to_and_fro = |back: bool, k: usize, count: usize| if back { count - 1 - k } else { k };
        for layer in 0..counts[0] {
            for row in 0..counts[1] {
                let row = to_and_fro(layer % 2 == 1, row, counts[1]);
                let back = points.len() / counts[2].max(1) % 2 == 1;
                for column in 0..counts[2] {
                    let column = to_and_fro(back, column, counts[2]);
                    let index = [layer, row, column];
                    let offset = Vector3::from_fn(|axis, _| {
                        let middle = (counts[axis] as f64 - 1.0) / 2.0;
                        let place =
                            index[axis] as f64 - middle + jitter * random.uniform(-0.5, 0.5);
                        place * steps[axis]
                    });
                    points.push(centre + axes * offset);
                }
            }
        }
        points
    }

    /// A point, in the plane of the plate where it has one.
    fn within(&self, mut point: Vector3<f64>) -> Vector3<f64> {
        if self.nominal.plate.is_in_plane() {
            point.z = self.home.pose.position_m.z;
        }
        point
    }

    /// True if the joints of the links let the plate turn so far from home.
    fn is_within_joints(&self, stop: &Commanded) -> bool {
        let home = self.home.pose.rotation;
        stop.pose.rotation.angle_to(&home) <= FARTHEST_TURN
    }

    fn visit(&self, points: &[Vector3<f64>]) -> Reached {
        let mut here = self.home.clone();
        let mut stops = Vec::new();
        for point in points.iter().map(|&point| self.within(point)) {
            // From home, so that an orientation that the arm leaves open does not drift along the way; what is hidden
            // from there may be reached from the point before.
            let next = (self.home.towards(self.nominal, point))
                .or_else(|| here.towards(self.nominal, point))
                .filter(|next| self.is_within_joints(next));
            if let Some(next) = next {
                here = next;
                stops.push(here.clone());
            }
        }
        let left_out = points.len() - stops.len();
        Reached { stops, left_out }
    }

    /// Steps of a grid in proportion to those given, by tenths and in two digits of which the second is rounded down, at which
    /// all of it is within reach, however the plate turns there. `None` where it is at those, or only at less than half of
    /// them, which would leave most of the workspace empty.
    pub(super) fn steps_within_reach(
        &self,
        poses: &Poses,
        tilt_rad: f64,
        random: &Random,
    ) -> Option<[f64; 3]> {
        let Poses::Grid {
            counts,
            step_m,
            limit,
            jitter,
        } = *poses
        else {
            return None;
        };
        let given = step_m.unwrap_or_else(|| self.default_steps());
        let is_within = |steps: &[f64; 3]| {
            let grid = Poses::Grid {
                counts,
                step_m: Some(*steps),
                limit,
                jitter,
            };
            // Displaced and turned as those of the simulation will be.
            self.tcp_poses(&grid, tilt_rad, &mut random.clone())
                .left_out
                == 0
        };
        if !self.home.places_tcp(self.nominal) || is_within(&given) {
            return None;
        }
        let tenths = (5..10).rev().map(|tenths| {
            given.map(|step| {
                let step = step * f64::from(tenths) / 10.0;
                let unit = 10_f64.powf(step.log10().floor() - 1.0);
                ((step / unit).floor() * unit * 1e12).round() / 1e12
            })
        });
        tenths.into_iter().find(is_within)
    }

    /// Stops with the plate turned at random, up to an angle (rad) from where it is; those at which it can't be are left
    /// out.
    fn tilted(&self, reached: Reached, tilt_rad: f64, random: &mut Random) -> Reached {
        let freedoms = self.nominal.plate.freedoms();
        let mut turn = || {
            let turn = loop {
                let cube = Vector3::from_fn(|_, _| random.uniform(-tilt_rad, tilt_rad));
                if cube.norm() <= tilt_rad {
                    break cube;
                }
            };
            Vector3::from_fn(|axis, _| {
                if freedoms.contains(&(axis + 3)) {
                    turn[axis]
                } else {
                    0.0
                }
            })
        };
        let count = reached.stops.len();
        let stops: Vec<Commanded> = (reached.stops.into_iter())
            .filter_map(|stop| stop.turned(self.nominal, turn()))
            .filter(|stop| self.is_within_joints(stop))
            .collect();
        let left_out = reached.left_out + count - stops.len();
        Reached { stops, left_out }
    }

    /// At random: the TCP in the box that the prototype's grid fills; or, where the drives do not place it, the drives, as
    /// far to both sides of home. Carts move the TCP about as far as they go: where their range is narrow, the box reaches
    /// no farther than it is wide, or else hardly a point would be within the range.
    fn random(&self, count: usize, random: &mut Random) -> Reached {
        let (axes, steps) = (self.axes(), self.default_steps());
        let (low, high) = self.range_m;
        let farthest = if self.nominal.guideways().next().is_some() {
            high - low
        } else {
            f64::INFINITY
        };
        let half = [0, 1, 2].map(|axis| {
            let half = (GRID[axis] as f64 - 1.0) / 2.0 * steps[axis];
            half.min(farthest)
        });
        let places_tcp = self.home.places_tcp(self.nominal);
        let mut stops = Vec::new();
        for _ in 0..50 * count {
            if stops.len() == count {
                break;
            }
            let stop = if places_tcp {
                let offset = Vector3::from_fn(|axis, _| random.uniform(-half[axis], half[axis]));
                let point = self.within(self.home.pose.position_m + axes * offset);
                self.home.towards(self.nominal, point)
            } else {
                let drives = self.home.commands_m.iter().zip(&self.nominal.ways_m);
                let commands: Vec<f64> = drives
                    .map(|(home, way)| home + random.uniform(-half[2], half[2]) / way)
                    .collect();
                self.home.led_to(self.nominal, &commands)
            };
            let carts = |stop: &Commanded| {
                let mut guideways = self.nominal.guideways();
                guideways.all(|track| (low..=high).contains(&stop.commands_m[track]))
            };
            let stop = stop.filter(|stop| self.is_within_joints(stop));
            stops.extend(stop.filter(carts));
        }
        let left_out = count - stops.len();
        Reached { stops, left_out }
    }

    fn schedule(
        &self,
        Reached { stops, left_out }: Reached,
        start_s: f64,
        step_s: f64,
        warming: bool,
        random: &mut Random,
    ) -> Stops {
        let mut before: Option<Conditions> = None;
        let mut last = vec![f64::NEG_INFINITY; self.nominal.commands];
        let mut scheduled = Vec::with_capacity(stops.len());
        for (index, mut commanded) in stops.into_iter().enumerate() {
            for command in &mut commanded.commands_m {
                *command = rounded(*command);
            }
            let directions = commanded
                .commands_m
                .iter()
                .enumerate()
                .map(|(k, &now)| match self.approach {
                    Approach::Random => random.sign(),
                    Approach::Moves if now > last[k] => 1.0,
                    Approach::Moves if now < last[k] => -1.0,
                    Approach::Moves => before.as_ref().map_or(1.0, |before| before.directions[k]),
                })
                .collect();
            let time_s = start_s + step_s * index as f64;
            let temperature_c = if warming {
                self.temperature.at(time_s, random)
            } else {
                self.temperature.start_c
            };
            let conditions = Conditions {
                directions,
                time_s,
                temperature_c,
                lengths_m: vec![],
            };
            last.clone_from(&commanded.commands_m);
            before = Some(conditions.clone());
            scheduled.push(Stop {
                commanded,
                conditions,
                tensions_n: None,
            });
        }
        Stops {
            stops: scheduled,
            left_out,
        }
    }
}

/// Layers, rows and columns, of which a plane has one.
fn counts_of([layers, rows, columns]: [usize; 3], plate: Plate) -> [usize; 3] {
    [layers, rows, if plate.is_in_plane() { 1 } else { columns }]
}

/// Number of points of a grid.
pub(super) fn grid_points(counts: [usize; 3], plate: Plate) -> usize {
    counts_of(counts, plate).iter().product()
}

fn rounded(command_m: f64) -> f64 {
    (command_m * COUNTS_PER_METRE).round() / COUNTS_PER_METRE
}
