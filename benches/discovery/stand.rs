//! A machine on the test stand: measured by the virtual robot, searched, and the answer judged.
//!
//! λ is by how much the effect raises the least misfit of the base to noise-free measurements, priors included: twice
//! the rise of the fit's cost over the rows that calibrate.

use std::f64::consts::TAU;

use serde::{Deserialize, Serialize};
use tau::calibration;
use tau::discovery::{Options, Outcome, discover};
use tau::effects::CATALOGUE;
use tau::measurements::{PlateKind, Split};
use tau::robot_file::RobotFile;
use tau::simulation::{
    Approach, Effect, Measure, Noise, Poses, SimulatedFolder, Simulation, Temperature, TrackPoints,
    simulate,
};
use tau::unknown_poses::{RowDivision, calibrate};
use tau::weighing::Treatment;
use tau::{Robot, Setup};
use tau_codegen::language::model::Place;
use tau_codegen::language::{Model, check_text, effects_from_text};
use tau_estimation::trust::{self, Verdict as Fit};
use tau_robot::effects::places;

use crate::answer::Found;
use crate::hidden::{Hidden, Sized, UNLISTED_OF_DRIVES};
use crate::plan::Section;
use crate::random::Random;
use crate::scoring::Verdict;
use crate::trials::{DRAWINGS, catalogue_without, sized};

/// Where the plate is measured.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Places {
    /// At random in the workspace, turned by up to so much (rad).
    Anywhere { count: usize, tilt_rad: f64 },
    /// On the bed of a printer: in the middle, on circles of half and of this radius (m), and between.
    OnBed { count: usize, radius_m: f64 },
}

/// A machine and its measurements.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kind {
    pub(crate) name: &'static str,
    pub(crate) robot: &'static str,
    /// The variant that the search starts from, and that the machine is one of.
    pub(crate) base: &'static str,
    pub(crate) measures: &'static [Measure],
    pub(crate) places: Places,
    /// Number of poses of which heights are measured, where not all are: the first ones.
    pub(crate) heights: Option<usize>,
    /// The robot file behind the robot's name.
    pub(crate) file: &'static str,
}

/// Hidden part of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Subject {
    Nothing,
    Listed,
    Withheld,
}

impl Subject {
    pub(crate) fn section(self) -> Section {
        match self {
            Self::Nothing => Section::Nulls,
            Self::Listed => Section::Single,
            Self::Withheld => Section::Withheld,
        }
    }
}

/// A trial of a machine.
#[derive(Debug, Clone)]
pub(crate) struct Trial {
    pub(crate) subject: Subject,
    /// Names of effects of which one is hidden.
    pub(crate) names: Vec<String>,
    /// True if it acts at one place, and not at all of a kind.
    pub(crate) at_one_place: bool,
    pub(crate) noncentrality: f64,
    pub(crate) index: usize,
    /// Name of the noise, and the noise.
    pub(crate) noise: (&'static str, Noise),
    /// Name of the split, and the split.
    pub(crate) split: (&'static str, Split),
    /// False if poses are always approached from random sides, and not in every second trial from where the last move came.
    pub(crate) moves: bool,
}

/// What was tried on a machine.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct OnMachine {
    pub(crate) machine: String,
    pub(crate) subject: Subject,
    #[serde(default)]
    pub(crate) noise: String,
    #[serde(default)]
    pub(crate) split: String,
    /// Of a confidently wrong answer without the effect in the catalogue: true if with it the answer lists both, one as a
    /// rival of the other, so that these measurements can't tell them apart.
    pub(crate) look_alike: bool,
}

pub(crate) type Record = crate::record::Record<OnMachine>;

/// A machine on the test stand.
pub(crate) struct Stand<'a> {
    kind: &'a Kind,
    robot: Robot,
    pub(crate) model: Model,
    file: RobotFile,
    method: &'a Options,
}

impl<'a> Stand<'a> {
    pub(crate) fn new(kind: &'a Kind, method: &'a Options) -> Self {
        let mut robots = tau_generated::ROBOTS.iter();
        let found = robots.find(|(name, _)| *name == kind.robot);
        let robot = Robot::from(found.expect("a standard robot").1);
        let bare = check_text(&robot.description).expect("a sound description");
        let text = format!("robot = \"{}\"\n{}", robot.name, kind.file);
        let file = RobotFile::parse_for(&text, "robot.toml", &robot).expect("a sound robot file");
        Self {
            kind,
            model: effects_from_text(CATALOGUE, &bare).expect("the catalogue that ships"),
            file: file.completed(&robot),
            robot,
            method,
        }
    }

    /// Runs a trial. Whatever is random follows from the seed and the trial.
    pub(crate) fn run(&self, seed: u64, trial: &Trial) -> Record {
        let Trial {
            subject,
            noncentrality,
            index,
            ..
        } = *trial;
        let (noise, split) = (trial.noise.0, trial.split.0);
        let purpose = format!("{} {subject:?} {noncentrality} {index}", self.kind.name);
        let names = if trial.at_one_place {
            trial.names.concat()
        } else {
            String::new()
        };
        let mut random = Random::new(seed, &format!("{purpose}{noise}{names}"));
        // Exact as a number of JSON.
        let seed = random.bits() >> 12;
        let rise_k = random.uniform(2.0, 8.0);
        let mut simulation = self.simulation(seed, rise_k, &mut random);
        if trial.moves && random.chance() {
            simulation.approach = Approach::Moves;
        }
        let tried = OnMachine {
            machine: self.kind.name.to_owned(),
            subject,
            noise: noise.to_owned(),
            split: split.to_owned(),
            look_alike: false,
        };
        let mut record = Record::new(tried, noncentrality, index, seed);
        if let Err(failure) = self.fill(trial, &mut record, simulation, &mut random) {
            record.failure = Some(failure);
        }
        record
    }

    /// The machine without noise and errors.
    fn simulation(&self, seed: u64, rise_k: f64, random: &mut Random) -> Simulation {
        let (poses, tilt_rad) = match self.kind.places {
            Places::Anywhere { count, tilt_rad } => (Poses::Random { count }, tilt_rad),
            Places::OnBed { count, radius_m } => (on_bed(count, radius_m, random), 0.0),
        };
        Simulation {
            variant: Some(self.kind.base.to_owned()),
            noise: Noise {
                scale: [0.0; 3],
                ..Noise::default()
            },
            poses,
            tilt_rad,
            measures: self.kind.measures.to_vec(),
            track_points: TrackPoints {
                count: 0,
                ..TrackPoints::default()
            },
            random_poses: 0,
            approach: Approach::Random,
            temperature: Temperature {
                rise_k,
                ..Temperature::default()
            },
            seed,
            ..Simulation::new(self.robot.clone(), self.file.clone())
        }
    }

    /// The folder of a simulation, with heights of those poses alone that have some.
    fn measured(&self, simulation: &Simulation) -> Result<SimulatedFolder, String> {
        let mut measured = simulate(simulation).map_err(|error| error.to_string())?;
        if let Some(heights) = self.kind.heights {
            let has_height = |pose: u32| pose as usize <= heights;
            (measured.folder.plate_rows)
                .retain(|row| has_height(row.pose) == (row.kind == PlateKind::Height));
        }
        Ok(measured)
    }

    fn fill(
        &self,
        trial: &Trial,
        record: &mut Record,
        mut simulation: Simulation,
        random: &mut Random,
    ) -> Result<(), String> {
        let mut catalogue = CATALOGUE.to_owned();
        if trial.subject != Subject::Nothing {
            let (hidden, sized) = self.hidden(trial, &simulation, random)?;
            if trial.subject == Subject::Withheld {
                catalogue = catalogue_without(&catalogue, &hidden.name);
            }
            record.truth = vec![hidden.truth(&sized)];
            simulation.effects = vec![sized.effect];
        }
        simulation.noise = trial.noise.1.clone();
        let measured = self.measured(&simulation)?;
        let split = trial.split.1;
        let found = self.answer(&measured, split, catalogue)?;
        let is_listed = trial.subject != Subject::Withheld;
        let verdict = Verdict::of(&record.truth, &found, is_listed);
        if !is_listed && verdict.confidently_wrong {
            let with = self.answer(&measured, split, CATALOGUE.to_owned())?;
            let said = |(name, place): (&str, &str)| {
                with.named.iter().any(|own| {
                    let mut rivals = own.rivals.iter();
                    (own.name == name && own.place == place)
                        || rivals.any(|rival| rival.0 == name && rival.1 == place)
                })
            };
            let mut names = found.named.iter();
            record.tried.look_alike = Verdict::of(&record.truth, &with, true).right_set
                && names.all(|own| said((&own.name, &own.place)));
        }
        record.verdict = Some(verdict);
        record.found = Some(found);
        Ok(())
    }

    fn answer(
        &self,
        measured: &SimulatedFolder,
        split: Split,
        catalogue: String,
    ) -> Result<Found, String> {
        let options = Options {
            split,
            catalogues: vec![catalogue],
            ..self.method.clone()
        };
        let (file, folder) = (&measured.file, &measured.folder);
        let base = self.kind.base;
        let outcome = discover(&self.robot, base, file, folder, &options, &mut |_| {});
        let outcome = outcome.map_err(|error| error.to_string())?;
        Ok(Found {
            fit: fit(&outcome, measured, split).map(|fit| fit.status.name().to_owned()),
            ..Found::of(&outcome.discovery)
        })
    }

    /// An effect of the catalogue at a random place, of the size that has a λ.
    fn hidden(
        &self,
        trial: &Trial,
        simulation: &Simulation,
        random: &mut Random,
    ) -> Result<(Hidden, Sized), String> {
        let least = self.cost(&self.measured(simulation)?, trial.split.1);
        let least = least.ok_or("the base does not fit")?;
        let of_effect = |effect: &Effect| {
            let with = Simulation {
                effects: vec![effect.clone()],
                ..simulation.clone()
            };
            let cost = self.cost(&self.measured(&with).ok()?, trial.split.1)?;
            Some(2.0 * (cost - least))
        };
        let is_meant = |place: Place| !trial.at_one_place || !place.is_common();
        for _ in 0..DRAWINGS {
            let name = random.choose(&trial.names);
            let hidden = if UNLISTED_OF_DRIVES.contains(&name.as_str()) {
                Hidden::unlisted_of_drive(&self.robot, name, random)
            } else {
                Hidden::listed(&self.robot, &self.model, name, is_meant, random)
            };
            if let Some(sized) = sized(&hidden, trial.noncentrality, of_effect) {
                return Ok((hidden, sized));
            }
        }
        Err("no effect of plausible size is visible".to_owned())
    }

    /// Least cost of the base on measurements that calibrate.
    fn cost(&self, measured: &SimulatedFolder, split: Split) -> Option<f64> {
        let division = RowDivision::of(&measured.folder, split);
        let options = calibration::Options {
            treatment: Treatment {
                keep_outliers: true,
                ..Treatment::default()
            },
            ..calibration::Options::default()
        };
        let variant = self.robot.variant(self.kind.base)?;
        let (file, folder) = (&measured.file, &measured.folder);
        let found = calibrate(
            Setup::new(&self.robot, variant, file, folder),
            &division,
            &options,
        );
        found.ok().map(|found| found.calibration.cost)
    }

    /// Names of the effects that the machine can have somewhere, each once.
    pub(crate) fn possible(&self) -> Vec<String> {
        let effects = self.model.effects.iter();
        let mut names: Vec<String> = effects
            .filter(|effect| !places(&self.model, effect).is_empty())
            .map(|effect| effect.name.clone())
            .collect();
        names.dedup();
        names
    }
}

/// The verdict on the model that a search ends at, fitted to the measurements that calibrate, as a calibration has it.
fn fit(outcome: &Outcome, measured: &SimulatedFolder, split: Split) -> Option<Fit> {
    let (file, folder) = (&measured.file, &measured.folder);
    if outcome.unknown.is_some() {
        let rows = RowDivision::of(folder, split);
        let found = outcome.calibration_of_unknown_poses(file, folder, &rows);
        return found.ok().map(|found| found.verdict());
    }
    let stated = || outcome.stated(file, folder).ok();
    let calibration = outcome.calibration.clone().or_else(stated)?;
    trust::of_calibration(&calibration, file, folder, &outcome.poses, Some(&[])).ok()
}

/// Places on a bed, in the frame of a machine that stands in the middle of it.
fn on_bed(count: usize, radius_m: f64, random: &mut Random) -> Poses {
    let mut places = vec![[0.0; 3]];
    let on_circle = |radius_m: f64, share: f64| {
        let (sine, cosine) = (TAU * share).sin_cos();
        [radius_m * cosine, radius_m * sine, 0.0]
    };
    places.extend((0..6).map(|k| on_circle(radius_m, f64::from(k) / 6.0)));
    while places.len() < count {
        let radius_m = radius_m * random.uniform(0.0, 1.0).sqrt();
        places.push(on_circle(radius_m, random.uniform(0.0, 1.0)));
    }
    Poses::Positions(places)
}
