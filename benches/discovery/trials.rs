//! One trial: a fresh machine, measurements, the search, and what an oracle makes of them.

use std::collections::BTreeMap;
use std::f64::consts::PI;

use nalgebra::DVector;
use serde::{Deserialize, Serialize};
use tau::Robot;
use tau::discovery::{Discovery, Options, discover};
use tau::effects::CATALOGUE;
use tau::measurements::{Division, Shape, Split};
use tau::robot_file::{RobotFile, Value};
use tau::simulation::{
    Approach, Effect, Noise, Poses, SimulatedFolder, Simulation, Temperature, simulate,
};
use tau_codegen::language::{Model, check_text, effects_from_text};

use crate::answer::{Found, Named, True};
use crate::hidden::{Hidden, Sized};
use crate::noncentrality::{Base, signal};
use crate::plan::{Case, Section, Subject, possible};
use crate::random::Random;
use crate::scoring::{Verdict, oracle_power, searching_oracle_power};

/// The standard robot without any effect of its own.
const ROBOT: &str = "robot GantryTau {
    track one, two, three;
    cluster arm1 on one   { link l1; }
    cluster arm2 on two   { link l2a, l2b; }
    cluster arm3 on three { link l3a, l3b, l3c; }
    variant Full { arm full; tracks linear per link; }
}
";
const BASE: &str = "Full";

/// An effect of more than so many times its tolerance is none that a machine could have.
const MOST_TOLERANCES: f64 = 10.0;
/// Size of the first try, in tolerances, and how near λ has to come.
const FIRST_TRY: f64 = 0.1;
const NEAR: f64 = 0.01;
const TRIES: usize = 12;
/// Drawings of effects at random places until they are visible.
pub(crate) const DRAWINGS: usize = 20;
/// Displacement of poses from the grid, as a share of its step.
const JITTER: f64 = 0.5;

/// What was tried in a section.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(crate) struct InSection {
    pub(crate) section: Section,
    pub(crate) kind: String,
    /// True if an effect of plausible size reaches the λ.
    pub(crate) visible: bool,
    pub(crate) random_approach: bool,
    pub(crate) warming_k: f64,
}

pub(crate) type Record = crate::record::Record<InSection>;

/// Context of all trials.
pub(crate) struct Laboratory {
    robot: Robot,
    pub(crate) model: Model,
    file: RobotFile,
    seed: u64,
    method: Options,
}

impl Laboratory {
    /// `method` are the options of all searches, but for split and catalogue.
    pub(crate) fn new(seed: u64, method: Options) -> Self {
        let robot = Robot::from_text(ROBOT).expect("a sound description");
        let bare = check_text(ROBOT).expect("a sound description");
        Self {
            robot,
            model: effects_from_text(CATALOGUE, &bare).expect("the catalogue that ships"),
            file: tau::prototype::robot_file().expect("the robot file that ships"),
            seed,
            method,
        }
    }

    /// Runs a trial. Whatever is random follows from the seed and the trial's place in the plan.
    pub(crate) fn run(&self, case: &Case) -> Record {
        let Case {
            section,
            kind,
            index,
            noncentrality,
            ..
        } = case;
        let purpose = format!("{section:?} {kind} {noncentrality} {index}");
        let mut random = Random::new(self.seed, &purpose);
        // Exact as a number of JSON.
        let seed = random.bits() >> 12;
        let random_approach = random.chance();
        let warms = random.chance() || kind.contains("thermal");
        let warming_k = f64::from(u8::from(warms)) * random.uniform(2.0, 8.0);
        let simulation = Simulation {
            noise: Noise {
                scale: [0.0; 3],
                ..Noise::default()
            },
            poses: Poses::Grid {
                counts: [6, 6, 5],
                step_m: None,
                limit: Some(176),
                jitter: JITTER,
            },
            approach: if random_approach {
                Approach::Random
            } else {
                Approach::Moves
            },
            temperature: Temperature {
                rise_k: warming_k,
                ..Temperature::default()
            },
            seed,
            ..Simulation::new(self.robot.clone(), self.file.clone())
        };
        let tried = InSection {
            section: *section,
            kind: kind.clone(),
            visible: true,
            random_approach,
            warming_k,
        };
        let mut record = Record::new(tried, *noncentrality, *index, seed);
        if let Err(failure) = self.fill(case, simulation, &mut random, &mut record) {
            record.failure = Some(failure);
        }
        record
    }

    fn fill(
        &self,
        case: &Case,
        mut simulation: Simulation,
        random: &mut Random,
        record: &mut Record,
    ) -> Result<(), String> {
        let split = Split::default();
        let without = simulate(&simulation).map_err(|error| error.to_string())?;
        let in_range = without
            .folder
            .in_range(&self.file, &Shape::from(&self.robot));
        let division = without.folder.divide(split, &in_range);
        let Some(hidden) = self.hide(case, &simulation, &without, &division.calibration, random)
        else {
            record.tried.visible = false;
            return Ok(());
        };
        let truth = hidden.iter().map(|(hidden, sized)| hidden.truth(sized));
        record.truth = truth.collect();
        simulation.effects = hidden
            .iter()
            .map(|(_, sized)| sized.effect.clone())
            .collect();
        let exact = simulate(&simulation).map_err(|error| error.to_string())?;
        simulation.noise = case.noise.clone();
        let mut measured = simulate(&simulation).map_err(|error| error.to_string())?;
        // Poses that take no part show the error against the truth.
        for &pose in &division.validation {
            measured.folder.tcp_poses[pose] = exact.folder.tcp_poses[pose].clone();
        }
        let options = Options {
            split,
            catalogues: match &case.subject {
                Subject::Withheld(name) => vec![catalogue_without(CATALOGUE, name)],
                _ => vec![CATALOGUE.to_owned()],
            },
            ..self.method.clone()
        };
        let outcome = discover(
            &self.robot,
            BASE,
            &self.file,
            &measured.folder,
            &options,
            &mut |_| {},
        );
        let discovery = outcome.map_err(|error| error.to_string())?.discovery;
        for own in &mut record.truth {
            let score = discovery
                .considered
                .iter()
                .find(|score| score.name == own.name && score.place.to_string() == own.place);
            own.p_value = score.map(|score| score.p_value.value());
        }
        let mut found = Found::of(&discovery);
        if !matches!(case.section, Section::Nulls | Section::Withheld) {
            found.oracle_um = self.oracle_um(&record.truth, &measured);
        }
        if let (Section::Single, [own]) = (case.section, record.truth.as_slice()) {
            let power = oracle_power(own.noncentrality, own.amplitudes, found.candidates);
            found.oracle_power = Some(power);
            found.searching_oracle_power =
                Some(match self.search_width(own, &measured, &division) {
                    Some(width) => {
                        searching_oracle_power(own.noncentrality, width, found.candidates)
                    }
                    None => power,
                });
        }
        record.verdict = Some(Verdict::of(
            &record.truth,
            &found,
            case.section != Section::Withheld,
        ));
        record.found = Some(found);
        Ok(())
    }

    /// Width of the search for the period of an effect, where it has one: the range of reciprocal periods
    /// times √(4π·var q) over the commands that its cart is measured at.
    fn search_width(
        &self,
        own: &True,
        measured: &SimulatedFolder,
        division: &Division,
    ) -> Option<f64> {
        let effect = self.model.effects.iter().find(|e| e.name == own.name)?;
        let (low, high) = effect.parameters.iter().find_map(|p| p.search)?;
        let track = self.robot.tracks.iter().position(|t| *t == own.place)?;
        let of_set_1 = division.calibration.iter();
        let of_set_3 = measured.folder.cart_positions.iter();
        let commands: Vec<f64> = of_set_1
            .map(|&pose| measured.folder.tcp_poses[pose].commands_m[track])
            .chain(
                of_set_3
                    .filter(|at| at.track == track)
                    .map(|at| at.commands_m[track]),
            )
            .collect();
        let count = commands.len() as f64;
        let mean = commands.iter().sum::<f64>() / count;
        let variance = commands.iter().map(|q| (q - mean).powi(2)).sum::<f64>() / count;
        Some((low.recip() - high.recip()) * (4.0 * PI * variance).sqrt())
    }

    /// Draws what is hidden, of the size that has the wanted λ; `None` where no plausible size has.
    fn hide(
        &self,
        case: &Case,
        simulation: &Simulation,
        without: &SimulatedFolder,
        poses: &[usize],
        random: &mut Random,
    ) -> Option<Vec<(Hidden, Sized)>> {
        if case.subject == Subject::Nothing {
            return Some(Vec::new());
        }
        let base = Base::new(&self.robot, without, poses);
        let noncentrality_of = |effect: &Effect| {
            let with = Simulation {
                effects: vec![effect.clone()],
                ..simulation.clone()
            };
            let with = simulate(&with).ok()?;
            let signal: DVector<f64> = signal(without, &with, poses);
            Some(base.noncentrality(&signal))
        };
        let sized = |hidden: Hidden| {
            let sized = sized(&hidden, case.noncentrality, noncentrality_of)?;
            Some((hidden, sized))
        };
        match &case.subject {
            Subject::Nothing => None,
            Subject::Listed(name) | Subject::Withheld(name) => {
                let hidden = Hidden::listed(&self.robot, &self.model, name, |_| true, random);
                Some(vec![sized(hidden)?])
            }
            Subject::Unlisted(name) => {
                Some(vec![sized(Hidden::unlisted(&self.robot, name, random))?])
            }
            Subject::Several(count) => {
                let effects: Vec<_> = possible(&self.model).collect();
                let mut all: Vec<(Hidden, Sized)> = Vec::new();
                for _ in 0..DRAWINGS * count {
                    let name = &random.choose(&effects).name;
                    if all.len() == *count || all.iter().any(|(other, _)| other.name == *name) {
                        continue;
                    }
                    all.extend(sized(Hidden::listed(
                        &self.robot,
                        &self.model,
                        name,
                        |_| true,
                        random,
                    )));
                }
                (all.len() == *count).then_some(all)
            }
            Subject::AtTwo(name) => {
                let mut all: Vec<(Hidden, Sized)> = Vec::new();
                for _ in 0..2 * DRAWINGS {
                    let hidden = Hidden::listed(&self.robot, &self.model, name, |_| true, random);
                    let is_there = |other: &(Hidden, Sized)| other.0.place == hidden.place;
                    if all.len() < 2 && hidden.place != "all" && !all.iter().any(is_there) {
                        all.extend(sized(hidden));
                    }
                }
                (all.len() == 2).then_some(all)
            }
        }
    }

    /// Error on the poses that took no part, of the base with the true effects, fitted to the same
    /// measurements (µm, rms). Periods start from the true ones. `None` where that fit can't be had.
    fn oracle_um(&self, truth: &[True], measured: &SimulatedFolder) -> Option<f64> {
        let mut file = self.file.clone();
        let mut text = String::new();
        let mut line = format!("variant Truth = {BASE}");
        for own in truth {
            let place = own.place.replace(',', ", ");
            let key = format!("{}({place})", own.name);
            line += &format!(" + {key}");
            // At two places it is one item.
            for item in items(CATALOGUE, &own.name) {
                if !text.contains(&item) {
                    text += &item;
                }
            }
            if let Some(period) = own.period_m {
                let value = Value {
                    value: vec![period],
                    tol: 1.0,
                    sigma: None,
                };
                file.effects
                    .insert(key, BTreeMap::from([("period".to_owned(), value)]));
            }
        }
        let body = ROBOT.trim_end().trim_end_matches('}');
        let robot = Robot::from_text(&format!("{text}\n{body}{line};\n}}\n")).ok()?;
        // Only the fit of the base counts, which is now the truth; what follows may end early.
        let options = Options {
            catalogues: Vec::new(),
            ..Options::default()
        };
        let folder = &measured.folder;
        let outcome = discover(&robot, "Truth", &file, folder, &options, &mut |_| {}).ok()?;
        Some(outcome.discovery.validation.before.rms_um)
    }
}

/// The size at which an effect has a λ, which is nearly proportional to its square; `None` where no
/// plausible size has it.
pub(crate) fn sized(
    hidden: &Hidden,
    target: f64,
    noncentrality_of: impl Fn(&Effect) -> Option<f64>,
) -> Option<Sized> {
    let mut tolerances = FIRST_TRY;
    for _ in 0..TRIES {
        let effect = hidden.of_size(tolerances);
        let noncentrality = noncentrality_of(&effect)?;
        if (noncentrality / target - 1.0).abs() < NEAR {
            return Some(Sized {
                effect,
                tolerances,
                noncentrality,
            });
        }
        tolerances *= (target / noncentrality).sqrt();
        if tolerances.is_nan() || tolerances > MOST_TOLERANCES {
            return None;
        }
    }
    None
}

/// The texts of the effects of a name in a catalogue, with their documentation.
pub(crate) fn items(catalogue: &str, name: &str) -> Vec<String> {
    let begins = format!("effect {name} ");
    let found = catalogue.match_indices(&begins).map(|(effect, _)| {
        let start = catalogue[..effect].rfind("\n\n").map_or(0, |at| at + 2);
        let length = catalogue[start..].find("\n}\n").expect("its end") + "\n}\n".len();
        catalogue[start..start + length].to_owned()
    });
    found.collect()
}

/// A catalogue without the effects of a name.
pub(crate) fn catalogue_without(catalogue: &str, name: &str) -> String {
    let items = items(catalogue, name);
    items
        .iter()
        .fold(catalogue.to_owned(), |text, item| text.replace(item, ""))
}

impl Found {
    pub(crate) fn of(discovery: &Discovery) -> Self {
        let status = serde_json::to_value(discovery.status);
        let text = status
            .ok()
            .and_then(|status| Some(status.as_str()?.to_owned()));
        Self {
            status: text.unwrap_or_default(),
            named: discovery
                .effects
                .iter()
                .map(|effect| Named {
                    name: effect.name.clone(),
                    place: effect.place.to_string(),
                    p_value: effect.p_value.value(),
                    chi2_drop: effect.chi2_drop,
                    period_m: effect.parameters.get("period").map(|period| period.value),
                    rivals: effect
                        .rivals
                        .iter()
                        .map(|rival| (rival.name.clone(), rival.place.to_string()))
                        .collect(),
                })
                .collect(),
            unnamed: discovery
                .unnamed
                .iter()
                .map(|unnamed| {
                    [
                        unnamed.place.to_string(),
                        unnamed.direction.to_string(),
                        unnamed.against.name.clone(),
                    ]
                })
                .collect(),
            outliers: discovery.outliers.len(),
            unseen: discovery
                .cannot_see
                .iter()
                .map(|unseen| (unseen.name.clone(), unseen.place.to_string()))
                .collect(),
            candidates: discovery.considered.len(),
            fit: None,
            oracle_power: None,
            searching_oracle_power: None,
            base_um: discovery.validation.before.rms_um,
            tool_um: discovery.validation.after.rms_um,
            oracle_um: None,
            steps_um: (discovery.steps.iter())
                .map(|step| step.gap.rms_um)
                .collect(),
            seconds: discovery.seconds,
        }
    }
}
