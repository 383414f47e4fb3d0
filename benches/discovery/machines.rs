//! Discovery on other robots, and by other measurements than poses.
//!
//! λ is by how much the effect raises the least misfit of the base to noise-free measurements, priors included: twice
//! the rise of the fit's cost.

use std::fmt::Write;

use serde::{Deserialize, Serialize};
use tau::Robot;
use tau::calibration;
use tau::discovery::{Options, discover};
use tau::effects::CATALOGUE;
use tau::measurements::{PlateKind, Split};
use tau::robot_file::RobotFile;
use tau::simulation::{
    Approach, Effect, Measure, Noise, Poses, SimulatedFolder, Simulation, Temperature, TrackPoints,
    simulate,
};
use tau::unknown_poses::{RowDivision, calibrate};
use tau::weighing::Treatment;
use tau_codegen::language::{Model, check_text, effects_from_text};
use tau_robot::effects::places;

use crate::answer::{Found, True};
use crate::hidden::Hidden;
use crate::plan::Section;
use crate::random::Random;
use crate::scoring::{Share, Verdict};
use crate::trials::{DRAWINGS, Sized, item, sized};
use tau::Setup;

const BASE: &str = "Full";
/// Trials of each kind: five kinds make 300 a machine.
const TRIALS: usize = 60;
/// λ of the effects that are named.
const NONCENTRALITIES: [f64; 3] = [30.0, 60.0, 120.0];
/// λ of an effect that is taken out of the catalogue.
const WITHHELD: f64 = 120.0;

/// A machine and its measurements.
struct Kind {
    name: &'static str,
    robot: &'static str,
    measures: &'static [Measure],
    poses: usize,
    /// The robot file behind the robot's name.
    file: &'static str,
}

const KINDS: [Kind; 4] = [
    Kind {
        name: "linear delta, poses",
        robot: "linear_delta",
        measures: &[Measure::Poses],
        poses: 120,
        file: TRACKED,
    },
    Kind {
        name: "hexapod, poses",
        robot: "hexapod",
        measures: &[Measure::Poses],
        poses: 120,
        file: TRACKED,
    },
    Kind {
        name: "four belts, readings",
        robot: "four_belts",
        measures: &[Measure::Rows(PlateKind::Reading)],
        poses: 160,
        file: "[drives]\nnoise_m = 2e-4\n[payload]\nmass_kg = 9.0\ncentre_m = [0.0, 0.0, 0.0]\n\
               gravity_m_s2 = [0.0, -9.81, 0.0]\n",
    },
    Kind {
        name: "linear delta, heights and distances",
        robot: "linear_delta",
        measures: &[Measure::Rows(PlateKind::Height), Measure::Distances],
        poses: 160,
        file: "[noise]\nheights = { height_m = 1e-5 }\ndistances = { distance_m = 2e-5 }\n\
               [payload]\nmass_kg = 3.0\ncentre_m = [0.0, 0.0, 0.0]\ngravity_m_s2 = [0.0, 0.0, -9.81]\n",
    },
];

const TRACKED: &str = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[payload]\nmass_kg = 3.0\n\
    centre_m = [0.0, 0.0, 0.0]\ngravity_m_s2 = [0.0, 0.0, -9.81]\n";

/// Hidden part of a trial.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Subject {
    Nothing,
    Listed,
    Withheld,
}

impl Subject {
    fn section(self) -> Section {
        match self {
            Self::Nothing => Section::Nulls,
            Self::Listed => Section::Single,
            Self::Withheld => Section::Withheld,
        }
    }
}

/// A trial and its answer.
#[derive(Debug, Clone, Serialize, Deserialize)]
struct Record {
    machine: String,
    subject: Subject,
    noncentrality: f64,
    index: usize,
    seed: u64,
    truth: Vec<True>,
    found: Option<Found>,
    verdict: Option<Verdict>,
    /// Of a confidently wrong answer without the effect in the catalogue: true if with it the answer lists both, one as a
    /// rival of the other, so that these measurements can't tell them apart.
    look_alike: bool,
    failure: Option<String>,
}

/// Runs the trials of the machines whose names hold a text, and prints a table; `only` are their sections, all where
/// it is empty.
pub(crate) fn run(
    seed: u64,
    (trials, only): (Option<usize>, &[Section]),
    wanted: &str,
    method: &Options,
    mut told: impl FnMut(&str),
) -> String {
    let mut records = vec![];
    for kind in KINDS.iter().filter(|kind| kind.name.contains(wanted)) {
        let bench = Bench::new(kind, method);
        let listed = NONCENTRALITIES.map(|lambda| (Subject::Listed, lambda));
        let cases = [(Subject::Nothing, 0.0), (Subject::Withheld, WITHHELD)];
        let cases = cases.into_iter().chain(listed);
        let is_run = |subject: Subject| only.is_empty() || only.contains(&subject.section());
        for (subject, noncentrality) in cases.filter(|(subject, _)| is_run(*subject)) {
            for index in 0..trials.unwrap_or(TRIALS) {
                let record = bench.trial(seed, subject, noncentrality, index);
                told(&serde_json::to_string(&record).unwrap_or_default());
                records.push(record);
            }
        }
    }
    table(&records)
}

struct Bench<'a> {
    kind: &'a Kind,
    robot: Robot,
    model: Model,
    file: RobotFile,
    method: &'a Options,
}

impl<'a> Bench<'a> {
    fn new(kind: &'a Kind, method: &'a Options) -> Self {
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

    fn trial(&self, seed: u64, subject: Subject, noncentrality: f64, index: usize) -> Record {
        let purpose = format!("{} {subject:?} {noncentrality} {index}", self.kind.name);
        let mut random = Random::new(seed, &purpose);
        // Exact as a number of JSON.
        let seed = random.bits() >> 12;
        let simulation = Simulation {
            variant: Some(BASE.to_owned()),
            noise: Noise {
                scale: [0.0; 3],
                ..Noise::default()
            },
            poses: Poses::Random {
                count: self.kind.poses,
            },
            measures: self.kind.measures.to_vec(),
            track_points: TrackPoints {
                count: 0,
                ..TrackPoints::default()
            },
            random_poses: 0,
            approach: Approach::Random,
            temperature: Temperature {
                rise_k: random.uniform(2.0, 8.0),
                ..Temperature::default()
            },
            seed,
            ..Simulation::new(self.robot.clone(), self.file.clone())
        };
        let mut record = Record {
            machine: self.kind.name.to_owned(),
            subject,
            noncentrality,
            index,
            seed,
            truth: vec![],
            found: None,
            verdict: None,
            look_alike: false,
            failure: None,
        };
        if let Err(failure) = self.fill(&mut record, simulation, &mut random) {
            record.failure = Some(failure);
        }
        record
    }

    fn fill(
        &self,
        record: &mut Record,
        mut simulation: Simulation,
        random: &mut Random,
    ) -> Result<(), String> {
        let mut catalogue = CATALOGUE.to_owned();
        if record.subject != Subject::Nothing {
            let (hidden, sized) = self.hidden(&simulation, record.noncentrality, random)?;
            if record.subject == Subject::Withheld {
                catalogue = catalogue.replace(item(CATALOGUE, &hidden.name), "");
            }
            record.truth = vec![True {
                name: hidden.name.clone(),
                place: hidden.place.clone(),
                noncentrality: sized.noncentrality,
                amplitudes: hidden.amplitudes,
                tolerances: sized.tolerances,
                period_m: hidden.period_m,
                p_value: None,
            }];
            simulation.effects = vec![sized.effect];
        }
        simulation.noise = Noise::default();
        let measured = simulate(&simulation).map_err(|error| error.to_string())?;
        let found = self.answer(&measured, catalogue)?;
        let is_listed = record.subject != Subject::Withheld;
        let verdict = Verdict::of(&record.truth, &found, is_listed);
        if !is_listed && verdict.confidently_wrong {
            let with = self.answer(&measured, CATALOGUE.to_owned())?;
            let said = |(name, place): (&str, &str)| {
                with.named.iter().any(|own| {
                    let mut rivals = own.rivals.iter();
                    (own.name == name && own.place == place)
                        || rivals.any(|rival| rival.0 == name && rival.1 == place)
                })
            };
            let mut names = found.named.iter();
            record.look_alike = Verdict::of(&record.truth, &with, true).right_set
                && names.all(|own| said((&own.name, &own.place)));
        }
        record.verdict = Some(verdict);
        record.found = Some(found);
        Ok(())
    }

    fn answer(&self, measured: &SimulatedFolder, catalogue: String) -> Result<Found, String> {
        let options = Options {
            split: Split::default(),
            catalogues: vec![catalogue],
            ..self.method.clone()
        };
        let (file, folder) = (&measured.file, &measured.folder);
        let outcome = discover(&self.robot, BASE, file, folder, &options, &mut |_| {});
        let outcome = outcome.map_err(|error| error.to_string())?;
        Ok(Found::of(&outcome.discovery))
    }

    /// An effect of the catalogue at a random place, of the size that has a λ.
    fn hidden(
        &self,
        simulation: &Simulation,
        noncentrality: f64,
        random: &mut Random,
    ) -> Result<(Hidden, Sized), String> {
        let without = simulate(simulation).map_err(|error| error.to_string())?;
        let least = self.cost(&without).ok_or("the base does not fit")?;
        let of_effect = |effect: &Effect| {
            let with = Simulation {
                effects: vec![effect.clone()],
                ..simulation.clone()
            };
            Some(2.0 * (self.cost(&simulate(&with).ok()?)? - least))
        };
        let names: Vec<&str> = (self.model.effects.iter())
            .filter(|effect| !places(&self.model, effect).is_empty())
            .map(|effect| effect.name.as_str())
            .collect();
        for _ in 0..DRAWINGS {
            let name = random.choose(&names);
            let hidden = Hidden::listed(&self.robot, &self.model, name, random);
            if let Some(sized) = sized(&hidden, noncentrality, of_effect) {
                return Ok((hidden, sized));
            }
        }
        Err("no effect of plausible size is visible".to_owned())
    }

    /// Least cost of the base on measurements that calibrate.
    fn cost(&self, measured: &SimulatedFolder) -> Option<f64> {
        let division = RowDivision::of(&measured.folder, Split::default());
        let options = calibration::Options {
            treatment: Treatment {
                keep_outliers: true,
                ..Treatment::default()
            },
            ..calibration::Options::default()
        };
        let variant = self.robot.variant(BASE)?;
        let (file, folder) = (&measured.file, &measured.folder);
        let found = calibrate(
            Setup::new(&self.robot, variant, file, folder),
            &division,
            &options,
        );
        found.ok().map(|found| found.calibration.cost)
    }
}

fn table(records: &[Record]) -> String {
    let mut text = "| machine | false names | λ 30 | λ 60 | λ 120 | confidently wrong, λ ≥ 60 | withheld: confidently wrong | \
                    of these a look-alike | failed | s |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |\n"
        .to_owned();
    let mut machines: Vec<&str> = records.iter().map(|own| own.machine.as_str()).collect();
    machines.dedup();
    for machine in machines {
        let own = || records.iter().filter(|record| record.machine == machine);
        let verdicts = |subject: Subject, least: f64, most: f64| {
            let range = least..=most;
            own()
                .filter(move |record| {
                    record.subject == subject && range.contains(&record.noncentrality)
                })
                .filter_map(|record| record.verdict)
        };
        let share = |share: Share| {
            let [low, high] = share.interval();
            format!("{}/{} ({low:.3} to {high:.3})", share.hits, share.of)
        };
        let right = |lambda: f64| {
            let own = verdicts(Subject::Listed, lambda, lambda);
            share(Share::of(own.map(|verdict| verdict.right_set)))
        };
        let nulls = verdicts(Subject::Nothing, 0.0, 0.0);
        let strong = verdicts(Subject::Listed, 60.0, f64::INFINITY);
        let withheld = verdicts(Subject::Withheld, 0.0, f64::INFINITY);
        let alike = own().filter(|record| record.look_alike).count();
        let failed = own().filter(|record| record.failure.is_some()).count();
        let seconds = own().filter_map(|record| Some(record.found.as_ref()?.seconds));
        let (sum, count) = seconds.fold((0.0, 0.0), |(sum, count), own| (sum + own, count + 1.0));
        let _ = writeln!(
            text,
            "| {machine} | {} | {} | {} | {} | {} | {} | {alike} | {failed} | {:.2} |",
            share(Share::of(nulls.map(|verdict| verdict.named))),
            right(30.0),
            right(60.0),
            right(120.0),
            share(Share::of(strong.map(|verdict| verdict.confidently_wrong))),
            share(Share::of(withheld.map(|verdict| verdict.confidently_wrong))),
            sum / f64::max(count, 1.0),
        );
    }
    text
}
