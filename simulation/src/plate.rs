//! Measurements that tell less of the plate than its pose: positions of targets, heights over a plane, distances, a
//! ball bar, or the drives alone.

use std::collections::{BTreeMap, BTreeSet};
use std::str::FromStr;

use nalgebra::Vector3;
use tau_codes::files;
use tau_robot::input_error::{InputError, quoted};
use tau_robot::measurements::{Conditions, Distance, PlateKind, PlateRow, Shape};
use tau_robot::robot_file::{RobotFile, StatedNoise, Value};

use super::forces;
use super::machine::{Machine, State};
use super::noise::{Noise, Series, displacements};
use super::plan::{Stop, number};
use super::random::Random;

/// A kind of measurement of the plate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Measure {
    /// `tcp_poses.csv`.
    Poses,
    /// `distances.csv`, between each pose and another; commands are in `readings.csv` where no other file has them.
    Distances,
    /// A file of its own.
    Rows(PlateKind),
}

impl Measure {
    /// All of them, with their names on the command line.
    pub const ALL: [(&'static str, Self); 6] = [
        ("poses", Self::Poses),
        ("positions", Self::Rows(PlateKind::Position)),
        ("heights", Self::Rows(PlateKind::Height)),
        ("distances", Self::Distances),
        ("ball-bar", Self::Rows(PlateKind::BallBar)),
        ("readings", Self::Rows(PlateKind::Reading)),
    ];
}

impl FromStr for Measure {
    type Err = InputError;

    fn from_str(text: &str) -> Result<Self, InputError> {
        let known = Self::ALL.iter().find(|(name, _)| *name == text);
        known.map(|(_, measure)| *measure).ok_or_else(|| {
            let names = quoted(Self::ALL.iter().map(|(name, _)| *name));
            let message = format!("found `{text}`, expected some of {names}, separated by commas");
            InputError::whole(files::OPTION_VALUE, "--measure", message)
        })
    }
}

/// A plane: heights count along a unit vector from so far (m) of the origin.
pub type Plane = (Vector3<f64>, f64);

/// True places of what measurements are taken of or from, by name; the empty name is that of what has none.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Objects {
    /// Targets in TCP coordinates (m).
    pub targets: BTreeMap<String, Vector3<f64>>,
    /// Surfaces.
    pub surfaces: BTreeMap<String, Plane>,
    /// Balls in the measurement frame (m).
    pub balls: BTreeMap<String, Vector3<f64>>,
}

impl Objects {
    /// Drawn from the tolerances of a robot file, or exactly as it says. Without any, the TCP itself, the plane z = 0
    /// and a ball beside the middle of the workspace.
    pub(super) fn draw(
        file: &RobotFile,
        exact: bool,
        centre: Vector3<f64>,
        reach_m: f64,
        seed: u64,
    ) -> Self {
        let mut random = Random::new(seed, "objects");
        let mut place = |value: &Value| {
            let off = if exact { 0.0 } else { value.tol };
            let stated = Vector3::from_fn(|axis, _| value.value.get(axis).copied().unwrap_or(0.0));
            stated + random.normals() * off
        };
        let measuring = &file.measuring;
        let of = |values: &BTreeMap<String, Value>,
                  place: &mut dyn FnMut(&Value) -> Vector3<f64>| {
            let each = values.iter();
            each.map(|(name, value)| (name.clone(), place(value)))
                .collect::<BTreeMap<_, _>>()
        };
        let mut targets = of(&measuring.targets, &mut place);
        let mut balls = of(&measuring.balls, &mut place);
        let surfaces = measuring.surfaces.iter();
        let mut surfaces: BTreeMap<String, Plane> = surfaces
            .map(|(name, surface)| {
                let normal = place(&surface.normal).normalize();
                (name.clone(), (normal, place(&surface.offset).x))
            })
            .collect();
        if targets.is_empty() {
            targets.insert(String::new(), Vector3::zeros());
        }
        if surfaces.is_empty() {
            surfaces.insert(String::new(), (Vector3::z(), 0.0));
        }
        if balls.is_empty() {
            balls.insert(String::new(), centre + random.direction() * reach_m);
        }
        Self {
            targets,
            surfaces,
            balls,
        }
    }
}

/// Plan of these measurements.
pub(super) struct Gauges<'a> {
    pub(super) machine: &'a Machine,
    pub(super) measures: &'a [Measure],
    pub(super) file: &'a RobotFile,
    pub(super) objects: &'a Objects,
    pub(super) noise: &'a Noise,
    /// Number of readings of each pose.
    pub(super) readings: usize,
    pub(super) seed: u64,
}

/// The rows, and which of them are gross: file and line.
#[derive(Debug, Clone, Default)]
pub(super) struct Measured {
    pub(super) rows: Vec<PlateRow>,
    pub(super) distances: Vec<Distance>,
    pub(super) gross: Vec<(&'static str, usize)>,
}

impl Gauges<'_> {
    /// Measures at stops with their true states; each pose is visited once and read as often as asked for.
    pub(super) fn measure(&self, stops: &[Stop], states: &[State]) -> Measured {
        let mut measured = Measured::default();
        let mut rows_there = self.measures.contains(&Measure::Poses);
        for kind in PlateKind::ALL {
            if !self.measures.contains(&Measure::Rows(kind)) {
                continue;
            }
            rows_there = true;
            self.rows(kind, stops, states, &mut measured);
        }
        if self.measures.contains(&Measure::Distances) {
            if !rows_there {
                self.rows(PlateKind::Reading, stops, states, &mut measured);
            }
            self.distances(states, &mut measured);
        }
        measured
    }

    fn rows(&self, kind: PlateKind, stops: &[Stop], states: &[State], measured: &mut Measured) {
        let sigmas = self.sigmas_m(kind);
        let mut random = Random::new(self.seed, kind.file());
        let objects = &self.objects;
        let names: Vec<&String> = match kind {
            PlateKind::Position => objects.targets.keys().collect(),
            PlateKind::Height => objects.surfaces.keys().collect(),
            PlateKind::BallBar => objects.balls.keys().collect(),
            PlateKind::Reading => vec![],
        };
        let nothing = String::new();
        let names = if names.is_empty() {
            vec![&nothing]
        } else {
            names
        };
        let readings = if kind == PlateKind::Reading {
            1
        } else {
            self.readings
        };
        let first = measured.rows.len();
        let visits = displacements(self.seed, stops.len());
        let mut series = Series::new(self.noise);
        for (index, (stop, state)) in stops.iter().zip(states).enumerate() {
            for _ in 0..readings {
                for name in &names {
                    let pose = state.pose;
                    let visit = visits[index];
                    // The true value, and the part of the visit's displacement that is along it.
                    let (true_m, visit): (Vec<f64>, [f64; 3]) = match kind {
                        PlateKind::Position => {
                            let target = objects.targets[*name];
                            let at = pose.position_m + pose.rotation * target;
                            // A tracker measures targets, with its errors as in poses.
                            let at = at + self.machine.measuring_error(at, &stop.conditions);
                            (at.iter().copied().collect(), visit.into())
                        }
                        PlateKind::Height => {
                            let (normal, offset) = objects.surfaces[*name];
                            let along = [normal.dot(&visit), 0.0, 0.0];
                            (vec![normal.dot(&pose.position_m) - offset], along)
                        }
                        PlateKind::BallBar => {
                            let bar = pose.position_m - objects.balls[*name];
                            let along = [unit(bar).dot(&visit), 0.0, 0.0];
                            (vec![bar.norm()], along)
                        }
                        PlateKind::Reading => (vec![], [0.0; 3]),
                    };
                    let deviates = series.next(&mut random, true_m.len(), visit);
                    let mut values = [None; 3];
                    for (k, true_m) in true_m.into_iter().enumerate() {
                        values[k] = Some(true_m + sigmas[k] * deviates[k]);
                    }
                    if kind == PlateKind::Position
                        && name.is_empty()
                        && self.machine.plate.is_in_plane()
                    {
                        // A way out of the plane is no motion of the plate.
                        values[2] = None;
                    }
                    measured.rows.push(PlateRow {
                        kind,
                        line: measured.rows.len() - first + 2,
                        pose: self.number(index),
                        commands_m: stop.commanded.commands_m.clone(),
                        conditions: stop.conditions.recorded(),
                        directions: Some(stop.conditions.directions.clone()),
                        tensions_n: stop.tensions_n.clone(),
                        values,
                        sigmas: [None; 3],
                        of: Some((*name).clone()).filter(|name| !name.is_empty()),
                    });
                }
            }
        }
        if kind == PlateKind::Reading {
            return;
        }
        let rows = &mut measured.rows[first..];
        for index in self.gross(rows.len(), &mut random) {
            let off = sigmas[0] * self.noise.outlier_size * random.sign();
            rows[index].values[0] = rows[index].values[0].map(|value| value + off);
            measured.gross.push((kind.file(), rows[index].line));
        }
    }

    /// Distances from each pose to another one, no pair twice.
    fn distances(&self, states: &[State], measured: &mut Measured) {
        let file = tau_robot::measurements::DISTANCES;
        let sigma = self.sigma_m(file);
        let mut random = Random::new(self.seed, file);
        let count = states.len();
        let visits = displacements(self.seed, count);
        let mut series = Series::new(self.noise);
        let mut taken = BTreeSet::new();
        for first in 0..count {
            let step = 1 + random.sample(1, (count - 1).max(1) / 2 + 1)[0];
            // A pair that is had already, from its other end, gives way to that of a shorter step.
            let mut others = (1..=step).rev().map(|step| (first + step) % count);
            let is_new = |&second: &usize| {
                first != second && taken.insert([first.min(second), first.max(second)])
            };
            let Some(second) = others.find(is_new) else {
                continue;
            };
            let way = states[first].pose.position_m - states[second].pose.position_m;
            // Two visits of variance one.
            let along = unit(way).dot(&(visits[first] - visits[second])) / 2f64.sqrt();
            for _ in 0..self.readings {
                let [deviate, ..] = series.next(&mut random, 1, [along, 0.0, 0.0]);
                measured.distances.push(Distance {
                    line: measured.distances.len() + 2,
                    poses: [first, second].map(|index| self.number(index)),
                    distance_m: way.norm() + sigma * deviate,
                    sigma_m: None,
                });
            }
        }
        for index in self.gross(measured.distances.len(), &mut random) {
            let row = &mut measured.distances[index];
            row.distance_m += sigma * self.noise.outlier_size * random.sign();
            measured.gross.push((file, row.line));
        }
    }

    /// Number of the pose at a stop: that of its first reading.
    fn number(&self, stop: usize) -> u32 {
        self.number_of_reading(stop * self.readings)
    }

    /// Number in the files of the pose of a reading, of which all stops have as many: rows of `tcp_poses.csv` have each
    /// their own, in the other files all readings at a stop are of one pose.
    pub(super) fn number_of_reading(&self, reading: usize) -> u32 {
        let has_poses = self.measures.contains(&Measure::Poses);
        number(if has_poses {
            reading
        } else {
            reading / self.readings
        })
    }

    /// True noise (m) of the lengths in a file.
    fn sigma_m(&self, file: &'static str) -> f64 {
        self.true_m(self.file.noise_of(file))
    }

    /// True noise (m) of each number of a row.
    fn sigmas_m(&self, kind: PlateKind) -> [f64; 3] {
        let axes = self.file.noise_of_axes();
        match axes.filter(|_| kind == PlateKind::Position) {
            Some(axes) => axes.map(|axis| self.true_m(axis)),
            None => [self.sigma_m(kind.file()); 3],
        }
    }

    /// The stated noise times the scale of set 1; of one that is to be estimated, that of positions.
    fn true_m(&self, stated: Option<StatedNoise>) -> f64 {
        let stated = match stated {
            Some(StatedNoise::Known(sigma)) => sigma,
            Some(StatedNoise::Estimate) | None => usual(self.file.noise.position_m),
        };
        stated * self.noise.scale[0]
    }

    fn gross(&self, rows: usize, random: &mut Random) -> Vec<usize> {
        let expected = (self.noise.outliers * rows as f64 + 0.5).floor();
        let count = (0..rows)
            .take_while(|&k| (k as f64) + 1.0 <= expected)
            .count();
        random.sample(count, rows)
    }
}

/// The direction of a vector; zero of none.
fn unit(vector: Vector3<f64>) -> Vector3<f64> {
    vector.try_normalize(0.0).unwrap_or_default()
}

/// A noise that is stated, or else that of a laser tracker (m).
pub(super) fn usual(stated_m: f64) -> f64 {
    if stated_m.is_finite() { stated_m } else { 1e-5 }
}

/// Errors of the drives at each stop (m or rad): what they truly are is what was commanded plus these. Noise that is to
/// be estimated is that of positions, by the way (m) that a unit of each command moves.
pub(super) fn drive_errors(
    file: &RobotFile,
    ways_m: &[f64],
    scale: f64,
    stops: usize,
    seed: u64,
) -> Vec<Vec<f64>> {
    let mut random = Random::new(seed, "drives");
    let sigma = |command: usize| match file.noise_of_drive(command) {
        None => 0.0,
        Some(StatedNoise::Known(sigma)) => sigma,
        Some(StatedNoise::Estimate) => usual(file.noise.position_m) / ways_m[command],
    };
    let sigmas: Vec<f64> = (0..ways_m.len())
        .map(|command| scale * sigma(command))
        .collect();
    (0..stops)
        .map(|_| sigmas.iter().map(|sigma| sigma * random.normal()).collect())
        .collect()
}

/// Deviations of the links' lengths at each stop (m); none where links are rigid. Noise that is to be estimated is that of
/// positions.
pub(super) fn length_errors(
    file: &RobotFile,
    links: usize,
    scale: f64,
    stops: usize,
    seed: u64,
) -> Vec<Vec<f64>> {
    let sigma_m = match file.noise_of_links() {
        None => return vec![vec![]; stops],
        Some(StatedNoise::Known(sigma)) => scale * sigma,
        Some(StatedNoise::Estimate) => scale * usual(file.noise.position_m),
    };
    let mut random = Random::new(seed, "links");
    (0..stops)
        .map(|_| (0..links).map(|_| sigma_m * random.normal()).collect())
        .collect()
}

/// Text of a file of rows.
pub(super) fn rows_text(kind: PlateKind, rows: &[&PlateRow], shape: &Shape) -> String {
    let commands = shape.command_names();
    let mut header = vec![
        "pose".to_owned(),
        "time_s".to_owned(),
        "temperature_c".to_owned(),
    ];
    header.extend(commands.iter().cloned());
    header.extend((1..=commands.len()).map(|n| format!("dir{n}")));
    let object = kind
        .object()
        .filter(|_| rows.iter().any(|row| row.of.is_some()));
    header.extend(object.map(|object| object.column().to_owned()));
    let is_measured = |&k: &usize| rows.iter().any(|row| row.values[k].is_some());
    let measured: Vec<usize> = (0..kind.columns().len()).filter(is_measured).collect();
    header.extend(measured.iter().map(|&k| kind.columns()[k].to_owned()));
    if rows.iter().any(|row| row.tensions_n.is_some()) {
        header.extend(shape.force_names());
    }
    let mut text = header.join(",") + "\n";
    for row in rows {
        let Conditions {
            time_s,
            temperature_c,
        } = row.conditions;
        let mut cells = vec![row.pose.to_string()];
        cells.extend([time_s, temperature_c].iter().flatten().map(f64::to_string));
        cells.extend(row.commands_m.iter().map(f64::to_string));
        cells.extend(row.directions.iter().flatten().map(f64::to_string));
        cells.extend(object.map(|_| row.of.clone().unwrap_or_default()));
        let values = measured.iter().map(|&k| row.values[k]);
        cells.extend(values.map(|value| value.map_or_else(String::new, |value| value.to_string())));
        if let Some(tensions_n) = &row.tensions_n {
            cells.extend(forces::links(shape).map(|link| tensions_n[link].to_string()));
        }
        text += &cells.join(",");
        text.push('\n');
    }
    text
}

/// Text of `distances.csv`.
pub(super) fn distances_text(distances: &[Distance]) -> String {
    let rows = distances.iter().map(|row| {
        let [a, b] = row.poses;
        format!("{a},{b},{}\n", row.distance_m)
    });
    let header = "pose_a,pose_b,distance_m\n".to_owned();
    rows.fold(header, |text, row| text + &row)
}
