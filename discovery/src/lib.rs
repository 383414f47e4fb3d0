//! Discovery of the effects that a model lacks: its misfit, the missing effects, the part of the gap that
//! they close, and the rest.
//!
//! All sets are fitted at once; every effect of a catalogue is scored at every place beside unnamed
//! families. A `search` goes from model to model, each of a better `score` than the one before;
//! `significance` is one policy for all. Candidates that join are confirmed on blocks that were held out. Validation
//! poses take no part in anything. `docs/discovery-method.md` has the formulas.

mod base;
mod candidate_set;
mod candidates;
mod confirmation;
pub mod constants;
mod contradiction;
mod detectability;
mod evidence;
mod few;
mod findings;
#[cfg(test)]
mod fixture;
mod floor;
mod generic;
mod gross_row;
mod held_out;
mod linear_model;
mod measured;
mod misfit;
mod p_value;
mod probes;
mod response;
pub mod results;
mod scan;
mod score;
mod search;
mod separation;
mod serial;
mod significance;
mod structural;
mod structure;
mod subspace;
mod text;
mod unknown_poses;
mod visits;
mod waves;

use std::collections::{BTreeMap, BTreeSet};
use std::time::Instant;

use nalgebra::DMatrix;
use tau_codegen::language::{self, Model, effects_from_text};
use tau_codes::{Remark, files};
use tau_estimation::all_sets;
use tau_estimation::calibration::{self, Calibration, Nominal, Prepared, Stated, check_poses};
use tau_estimation::joint::fit::Fit;
use tau_estimation::joint::variant::PosesOf;
use tau_estimation::numerics::parallel;
use tau_estimation::numerics::spread::spread;
use tau_estimation::samples::Sample;
use tau_estimation::trust;
use tau_robot::effects::CATALOGUE;
use tau_robot::input_error::InputError;
use tau_robot::measurements::{Division, Folder, Poses, Split};
use tau_robot::robot::{Parameter, Robot, Variant};
use tau_robot::robot_file::RobotFile;

pub use constants::Constants;
pub use p_value::PValue;
pub use results::{Discovery, Status};
pub use tau_estimation::calibration::Error;
pub use text::DISCOVERED;
pub use unknown_poses::OfUnknownPoses;

use base::base_fit;
use candidate_set::CandidateSet;
use evidence::whiteness::Series;
use few::NothingDetectable;
use findings::{Beforehand, finish};
pub use generic::UNNAMED;
use held_out::PoseError;
use linear_model::LinearModel;
use misfit::misfits;
use probes::Probes;
use results::Misfit;
use score::ProfileLikelihood;
use search::Search;
use structural::piecewise::Found;
use structural::search;
use tau_estimation::Setup;
use unknown_poses::{Unknown, not_calibrated};

/// Options of a search.
#[derive(Debug, Clone)]
pub struct Options {
    /// The split into poses that take part and poses that only show the gap.
    pub split: Split,
    /// Seed of the resamples, and of the signs under which upcrossings are counted.
    pub seed: u64,
    /// Constants on which verdicts depend.
    pub constants: Constants,
    /// Rules that are left out, to see what they are worth.
    pub without: BTreeSet<Rule>,
    /// Catalogues of effects in the language; of effects of one name, the first counts.
    pub catalogues: Vec<String>,
}

/// A part of the method that can be left out.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// Held-out blocks must be predicted better by what joins the model.
    HeldOut,
    /// Serial noise inflates what it could imitate.
    Serial,
    /// So do errors that readings of a visit share.
    Visits,
    /// A second climb from the base, with unnamed families from the start.
    SecondStart,
    /// Structure that is left where effects were found is looked for at a level of its own.
    Left,
    /// Effects that measurements which took no part contradict leave the model.
    Contradicted,
}

impl Rule {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::HeldOut,
        Self::Serial,
        Self::Visits,
        Self::SecondStart,
        Self::Left,
        Self::Contradicted,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::HeldOut => "held_out",
            Self::Serial => "serial",
            Self::Visits => "visits",
            Self::SecondStart => "second_start",
            Self::Left => "left",
            Self::Contradicted => "contradicted",
        }
    }
}

impl Default for Options {
    fn default() -> Self {
        Self {
            split: Split::default(),
            seed: 0,
            constants: Constants::default(),
            without: BTreeSet::new(),
            catalogues: vec![CATALOGUE.to_owned()],
        }
    }
}

/// Input of a search.
#[derive(Clone, Copy)]
struct Input<'a> {
    robot: &'a Robot,
    /// Its description, checked.
    model: &'a Model,
    base: &'a str,
    file: &'a RobotFile,
    folder: &'a Folder,
    division: &'a Division,
    /// Where no pose was measured: what was, with estimates of the poses, which are those of `folder`.
    unknown: Option<&'a Unknown<'a>>,
    options: &'a Options,
}

impl Input<'_> {
    /// Poses that closures are functions of. Where no tracker measured the plate, those that one would measure.
    fn poses(&self) -> PosesOf {
        match self.unknown {
            Some(unknown) if unknown.hides_tracker.is_none() => PosesOf::Machine,
            _ => PosesOf::Tracker,
        }
    }
}

/// Result of a discovery, with the model as fitted.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// The result.
    pub discovery: Discovery,
    /// Fitted value of each parameter of the discovered variant, by name, SI.
    pub values: BTreeMap<String, f64>,
    /// Their covariance, in the order of their names.
    covariance: DMatrix<f64>,
    /// Half the sum of squared whitened residuals and priors.
    cost: f64,
    /// Poses of set 1 that calibrate it: indices in the folder, or in the estimated one.
    pub poses: Vec<usize>,
    /// The calibration of what was found, as of any variant. There is none of unknown poses.
    pub calibration: Option<Calibration>,
    /// Where poses are unknown: their estimates, and the calibration of what was found.
    pub unknown: Option<OfUnknownPoses>,
}

impl Outcome {
    /// The robot with the discovered variant alone, compiled at run time.
    pub fn robot(&self) -> Robot {
        let mut model = self.discovery.model.clone();
        model.variants.retain(|variant| variant.name == DISCOVERED);
        Robot::from(&tau_codegen::compile(&model, &self.discovery.model_text))
    }

    /// The discovered variant calibrated on poses of a folder, given by index: as any variant, from where the search ended.
    ///
    /// # Errors
    /// As [`all_sets::calibrate`].
    pub fn calibrated(
        &self,
        file: &RobotFile,
        folder: &Folder,
        poses: &[usize],
    ) -> Result<Calibration, Error> {
        let robot = self.robot();
        let variant = variant_of(&robot, DISCOVERED)?;
        let prepared = Prepared::new(
            &robot,
            variant,
            &file.completed(&robot),
            Some(folder),
            poses,
        )?;
        let options = calibration::Options {
            start: Some(self.values_in(&prepared)),
            ..calibration::Options::default()
        };
        all_sets::calibrate(Setup::new(&robot, variant, file, folder), poses, &options)
    }

    /// Value of each parameter of a variant where the search ended.
    fn values_in(&self, prepared: &Prepared) -> Vec<f64> {
        let parameters = prepared.machine.variant.parameters.iter();
        let value = |(parameter, nominal): (&Parameter, &Nominal)| {
            let fitted = self.values.get(&parameter.name).copied();
            fitted.unwrap_or(nominal.value)
        };
        parameters.zip(&prepared.nominal).map(value).collect()
    }

    /// The discovered variant as the joint fit of all sets left it.
    ///
    /// # Errors
    /// The robot lacks the variant; a pose lacks what its closures read.
    pub fn stated(&self, file: &RobotFile, folder: &Folder) -> Result<Calibration, Error> {
        let robot = &self.robot();
        let variant = variant_of(robot, DISCOVERED)?;
        let completed = file.completed(robot);
        let prepared = Prepared::new(robot, variant, &completed, Some(folder), &self.poses)?;
        let places: BTreeMap<&str, usize> = (self.values.keys().enumerate())
            .map(|(place, name)| (name.as_str(), place))
            .collect();
        let place = |index: usize| places.get(variant.parameters[index].name.as_str()).copied();
        let count = variant.parameters.len();
        let stated = Stated {
            values: self.values_in(&prepared),
            covariance: DMatrix::from_fn(count, count, |a, b| match (place(a), place(b)) {
                (Some(a), Some(b)) => self.covariance[(a, b)],
                _ => 0.0,
            }),
            cost: self.cost,
        };
        prepared.stated(&completed, folder, &self.poses, stated)
    }
}

impl Outcome {
    /// The same model calibrated on all poses in range, also those that showed the gap. What [`Self::discovery`] says of errors
    /// at poses that took no part is not true of this fit.
    ///
    /// # Errors
    /// As [`Poses::select`].
    pub fn refitted_to_all(&self, file: &RobotFile, folder: &Folder) -> Result<Self, Error> {
        let robot = self.robot();
        let file = &file.completed(&robot);
        let division = Poses::select(&robot, file, folder, Split::All)?.division;
        Ok(self
            .clone()
            .with_calibration(file, folder, division.calibration))
    }

    /// The same with the calibration of what was found, on poses of a folder, given by index.
    fn with_calibration(mut self, file: &RobotFile, folder: &Folder, poses: Vec<usize>) -> Self {
        match self.calibrated(file, folder, &poses) {
            Ok(found) => (self.calibration, self.poses) = (Some(found), poses),
            Err(error) => self.discovery.remarks.push(not_calibrated(&error)),
        }
        self
    }
}

/// Searches for what the variant `base` lacks. `progress` is told of each step in words.
///
/// # Errors
/// [`Error::Input`] where the folder or the catalogues can't be used; [`Error::NotConverged`] where the
/// base does not fit.
pub fn discover(
    robot: &Robot,
    base: &str,
    file: &RobotFile,
    folder: &Folder,
    options: &Options,
    progress: &mut (dyn FnMut(&str) + Send),
) -> Result<Outcome, Error> {
    let started = Instant::now();
    let found = parallel::within(|| discovered(robot, base, file, folder, options, progress));
    let mut outcome = found?;
    outcome.discovery.seconds = started.elapsed().as_secs_f64();
    Ok(outcome)
}

fn discovered(
    robot: &Robot,
    base: &str,
    file: &RobotFile,
    folder: &Folder,
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> Result<Outcome, Error> {
    let variant = variant_of(robot, base)?;
    if robot.variant(text::DISCOVERED).is_some() {
        let problem = format!("there is a variant `{}` already", text::DISCOVERED);
        return Err(
            InputError::whole(tau_codes::discovery::RESERVED_NAME, &robot.name, problem)
                .help("rename it in the description: what is found gets this name")
                .into(),
        );
    }
    let completed = file.completed(robot);
    let model = &*robot.model;
    if let Some(folder) = measured::with_unknown_poses(folder, &completed, robot) {
        progress("estimating the poses");
        let described = (robot, model, base);
        return unknown_poses::search(described, &completed, &folder, options, progress);
    }
    let Poses { mut division, .. } = Poses::select(robot, file, folder, options.split)?;
    let setup = Setup::new(robot, variant, &completed, folder);
    check_poses(setup, &division.calibration, !setup.takes_carts())?;
    let all = division.calibration.clone();
    let taken = spread(all.len(), constants::count(options.constants.most_poses));
    division.calibration = taken.iter().map(|&k| all[k]).collect();
    let input = Input {
        robot,
        model,
        base,
        file: &completed,
        folder,
        division: &division,
        unknown: None,
        options,
    };
    let mut outcome = search(&input, progress)?;
    if taken.len() < all.len() {
        let remark = remark_on_part(all.len(), taken.len());
        outcome.discovery.remarks.push(remark);
    }
    progress("calibrating what was found");
    let mut outcome = outcome.with_calibration(&completed, folder, all);
    let calibration = outcome.calibration.clone();
    let calibration =
        calibration.map_or_else(|| outcome.stated(&completed, folder), Ok::<_, Error>)?;
    let verdict = trust::of_calibration(&calibration, &completed, folder, &outcome.poses, None)?;
    (outcome.discovery).conclude(&calibration, Some(verdict), robot);
    Ok(outcome)
}

fn remark_on_part(all: usize, taken: usize) -> Remark {
    let text = format!(
        "of {all} poses that calibrate {taken}, evenly spread, took part in the search: more take memory, and an effect \
         that so many do not show is below an eighth of the noise"
    );
    Remark::new(tau_codes::discovery::PART, text)
}

fn variant_of<'r>(robot: &'r Robot, name: &str) -> Result<&'r Variant, InputError> {
    let variant = robot.variant(name);
    variant.ok_or_else(|| not_described(robot, name))
}

fn not_described(robot: &Robot, name: &str) -> InputError {
    let problem = format!("robot `{}` has no variant `{name}`", robot.name);
    InputError::whole(files::NO_SUCH_VARIANT, &robot.name, problem)
}

/// The base fitted to all sets.
fn fitted(input: &Input<'_>) -> Result<(Fit, Vec<Sample>), Error> {
    let (model, index, _) = model_of(input)?;
    base_fit(input, &model, index, variant_of(input.robot, input.base)?)
}

/// Misfit of the base, and its errors on what took no part.
fn shortfall(input: &Input<'_>) -> Result<(Vec<Misfit>, Vec<PoseError>), Error> {
    let (fit, samples) = fitted(input)?;
    let errors = held_out::errors(input, &fit)?;
    Ok((misfits(&fit, &samples, input.file.noise), errors))
}

/// The model with all that may be added to it, the index of the base, and the unnamed families.
fn model_of(input: &Input<'_>) -> Result<(Model, usize, Vec<generic::Family>), Error> {
    let Input {
        robot,
        model,
        options,
        ..
    } = *input;
    let (model, families) = catalogue(model, options)?;
    let index = model
        .variants
        .iter()
        .position(|v| v.name == input.base)
        .ok_or_else(|| not_described(robot, input.base))?;
    Ok((model, index, families))
}

/// Searches from a base as it is; `likelihood` is that of another base with which scores shall compare.
fn search_from(
    input: &Input<'_>,
    likelihood: Option<ProfileLikelihood>,
    progress: &mut dyn FnMut(&str),
) -> Result<Found, Error> {
    let (mut search, beforehand) = begun(input, likelihood, progress)?;
    let blind = beforehand.nothing_detectable.as_ref();
    let is_searched = !blind.is_some_and(NothingDetectable::is_by_degrees);
    if is_searched {
        search.run(progress)?;
    }
    let of_effects = search.found();
    let undecided = is_searched.then(|| search.undecided()).flatten();
    let variant = variant_of(input.robot, input.base)?;
    let (outcome, tracks) = parallel::both(
        || finish(input, &search, (&of_effects, undecided), beforehand),
        || {
            let tracks = is_searched.then(|| structural::piecewise::tracks(&search, variant));
            tracks.unwrap_or_default()
        },
    );
    Found::new(search, tracks, outcome?)
}

/// A search at its base, and what is known before it.
fn begun<'a>(
    input: &'a Input<'a>,
    likelihood: Option<ProfileLikelihood>,
    progress: &mut dyn FnMut(&str),
) -> Result<(Search<'a>, Beforehand), Error> {
    let Input { robot, file, .. } = *input;
    let (model, index, families) = model_of(input)?;
    let variant = variant_of(robot, input.base)?;
    progress("fitting the base to all sets");
    let (fitted, compiled) = parallel::both(
        || base_fit(input, &model, index, variant),
        || probes::compiled(&model, index, input.poses()),
    );
    let (fit, samples) = fitted?;
    progress("looking at what could be seen");
    let own_effects = variant.effects.len();
    let probes = Probes::of(
        &model,
        own_effects,
        (compiled, input.poses()),
        &fit.joint,
        &fit.fitted,
        &samples,
        file.noise,
    )?;
    let mut set = CandidateSet::new(
        model,
        variant,
        &families,
        samples,
        probes,
        (&fit, input.options),
        input.unknown.and_then(|unknown| unknown.hides_tracker),
    );
    // What these take is gone before the table takes as much.
    let best_columns = set.best_columns(&LinearModel::of(&fit.at_stated_noise()?));
    let linear = LinearModel::of(&fit);
    let table = set.table(&linear);
    let (detectable, cannot_see) = detectability::detectability(&mut set, &best_columns, &table);
    let nothing_detectable =
        NothingDetectable::of(&set, &best_columns, &detectable, &cannot_see, &fit);
    set.weigh();
    let table = set.without_hidden(table);
    let (ambiguous, (misfit, serial)) = parallel::both(
        || evidence::ambiguity::ambiguous(&set, &linear),
        || {
            let series = Series::of(&linear, &set.samples);
            (
                misfits(&fit, &set.samples, file.noise),
                series.map(|series| series.correlation()),
            )
        },
    );
    let beforehand = Beforehand {
        linear,
        detectable,
        cannot_see,
        nothing_detectable,
        ambiguous,
        misfit,
        serial,
    };
    let at = (index, own_effects);
    let search = Search::new(input, set, at, fit, table, likelihood)?;
    Ok((search, beforehand))
}

/// Says that names with the prefix of the unnamed families are theirs.
pub fn reserved(error: InputError) -> InputError {
    error.help(format!(
        "rename it: effects whose names begin with `{UNNAMED}` are the unnamed families of discovery"
    ))
}

/// The model of a description with all catalogues and the unnamed families.
fn catalogue(described: &Model, options: &Options) -> Result<(Model, Vec<generic::Family>), Error> {
    let mut model = described.clone();
    for text in &options.catalogues {
        model = effects_from_text(text, &model).map_err(|errors| not_sound(&errors))?;
    }
    let mut names = model.effects.iter().map(|effect| &effect.name);
    if let Some(name) = names.find(|name| name.starts_with(UNNAMED)) {
        let problem = format!("there is an effect `{name}`");
        return Err(Error::Input(reserved(InputError::whole(
            tau_codes::discovery::RESERVED_NAME,
            "effects",
            problem,
        ))));
    }
    let triangles = constants::count(options.constants.triangles).max(2);
    let (effects, families) = generic::families(&model, triangles);
    model.effects.extend(effects);
    Ok((model, families))
}

fn not_sound(errors: &language::Errors) -> Error {
    Error::Input(InputError::whole(
        tau_codes::discovery::NOT_SOUND,
        "effects",
        errors.to_string(),
    ))
}
