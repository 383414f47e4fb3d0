//! What the model lacks: where it disagrees with the measurements, which effect is missing, how much of
//! the gap that closes, and what remains.
//!
//! All sets are fitted at once; every effect of a catalogue is scored at every place by what the base
//! leaves of it, beside unnamed rivals; effects are added one at a time, each confirmed on blocks that
//! were held out, until nothing significant is left. Validation poses take no part in anything.

mod bench;
mod candidates;
mod confirmation;
mod descent;
mod distribution;
mod encompassing;
mod evidence;
mod fit;
mod floor;
mod formula;
pub(crate) mod frames;
mod generic;
pub(crate) mod joint;
mod misfit;
pub(crate) mod numbering;
mod outliers;
mod parallel;
mod probes;
mod projection;
mod response;
pub mod results;
pub(crate) mod samples;
mod scan;
mod selection;
mod separation;
mod serial;
mod sight;
mod structural;
mod structure;
mod text;
pub(crate) mod variant;
mod view;
pub(crate) mod whitened;

use std::collections::BTreeMap;
use std::time::Instant;

use tau_codegen::language::{self, Model, effects_from_text};
use tau_runtime::Owner;

pub use crate::calibration::Error;
pub use results::{Discovery, Status};
pub use text::DISCOVERED;

use crate::calibration::{Calibration, Prepared, calibrate};
use crate::effects::CATALOGUE;
use crate::evaluation::evaluate;
use crate::input_error::InputError;
use crate::kinematics::{self, Machine, Pose, Statics};
use crate::measurements::{Division, Folder, Shape, Split};
use crate::robot::{Arm, Robot, Variant};
use crate::robot_file::RobotFile;
use bench::Bench;
use evidence::whiteness::Series;
use fit::Fit;
use frames::Frames;
use joint::Joint;
use probes::Probes;
use results::{
    Considered, Estimate, FoundEffect, Gap, LeftOut, Rival, SerialCorrelation, Unseen, Validation,
    Whiteness,
};
use samples::Sample;
use selection::{LEVEL, Search};
use view::View;

/// Chance in white noise below which residuals are said to follow each other.
const SERIAL: f64 = 0.01;

/// Fewest sign flips that can show a level of 1 %: of so many and the measurements themselves, these are
/// the strongest by chance once in a hundred.
pub const LEAST_FLIPS: u32 = 99;

/// Residuals of a set that are so many times the stated noise leave something to explain.
const FAR_BEYOND: f64 = 2.0;

/// How to search.
#[derive(Debug, Clone)]
pub struct Options {
    /// Which poses take part and which only show the gap.
    pub split: Split,
    /// Seed of the sign flips and resamples.
    pub seed: u64,
    /// Number of sign flips; with fewer than [`LEAST_FLIPS`] the search ends early.
    pub flips: usize,
    /// Catalogues of effects in the language; of effects of one name, the first counts.
    pub catalogues: Vec<String>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            split: Split::default(),
            seed: 0,
            flips: 199,
            catalogues: vec![CATALOGUE.to_owned()],
        }
    }
}

/// What discovery works on.
#[derive(Clone, Copy)]
struct Input<'a> {
    robot: &'a Robot,
    base: &'a str,
    file: &'a RobotFile,
    folder: &'a Folder,
    division: &'a Division,
    options: &'a Options,
}

/// What was found, ready to be calibrated.
#[derive(Debug, Clone)]
pub struct Outcome {
    /// What was found.
    pub discovery: Discovery,
    /// Fitted value of each parameter of the discovered variant, by name, SI.
    pub values: BTreeMap<String, f64>,
    /// Poses of set 1 that took part, without outliers: indices in the folder.
    pub poses: Vec<usize>,
}

impl Outcome {
    /// The robot with the discovered variant, compiled at run time.
    ///
    /// # Errors
    /// None for a description that discovery wrote.
    pub fn robot(&self) -> Result<Robot, Error> {
        Robot::from_text(&self.discovery.model_text)
            .map_err(|errors| InputError::whole("model_text", errors.to_string()).into())
    }

    /// The discovered variant calibrated on the poses of set 1, from where the joint fit stands.
    ///
    /// # Errors
    /// As [`calibrate`].
    pub fn calibrate(
        &self,
        robot: &Robot,
        file: &RobotFile,
        folder: &Folder,
    ) -> Result<Calibration, Error> {
        let variant = robot.variant(DISCOVERED).ok_or_else(|| {
            InputError::whole(&robot.name, format!("there is no variant `{DISCOVERED}`"))
        })?;
        let nominal = Prepared::new(robot, variant, file, Some(folder), &self.poses)?;
        let start = variant
            .parameters
            .iter()
            .zip(&nominal.nominal)
            .map(|(parameter, nominal)| {
                self.values
                    .get(&parameter.name)
                    .copied()
                    .unwrap_or(nominal.value)
            })
            .collect();
        let options = crate::calibration::Options {
            start: Some(start),
            ..Default::default()
        };
        calibrate(robot, variant, file, folder, &self.poses, &options)
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
    progress: &mut dyn FnMut(&str),
) -> Result<Outcome, Error> {
    let started = Instant::now();
    let variant = robot.variant(base).ok_or_else(|| {
        InputError::whole(
            &robot.name,
            format!("robot `{}` has no variant `{base}`", robot.name),
        )
    })?;
    if folder.tcp_poses.is_empty() {
        return Err(
            InputError::whole(&folder.name, "discovery needs set 1, `tcp_poses.csv`").into(),
        );
    }
    let shape = Shape {
        commands: robot.commands,
        tracks: robot.tracks.len(),
    };
    let in_range = folder.in_range(file, shape);
    let division = options.split.divide(&in_range);
    let input = Input {
        robot,
        base,
        file,
        folder,
        division: &division,
        options,
    };

    let searched =
        |input: &Input<'_>, progress: &mut dyn FnMut(&str)| search_from(input, started, progress);
    if variant.arm == Arm::Full {
        return searched(&input, progress);
    }
    progress("comparing the reduced arm with a full one");
    let (fuller, name) = structural::with_full_arm(robot, variant)?;
    let with_full_arm = Input {
        robot: &fuller,
        base: &name,
        ..input
    };
    let full_arm = compared(&input, &with_full_arm)?;
    if full_arm.is_significant() {
        let mut outcome = searched(&with_full_arm, progress)?;
        full_arm.precede(base, &mut outcome.discovery);
        Ok(outcome)
    } else {
        let mut outcome = searched(&input, progress)?;
        full_arm.dismissed(&mut outcome.discovery);
        Ok(outcome)
    }
}

/// A base with a reduced arm beside one with the full one.
fn compared(reduced: &Input<'_>, full: &Input<'_>) -> Result<structural::FullArm, Error> {
    let fit = |input: &Input<'_>| {
        let (model, index, _) = model_of(input)?;
        base_fit(input, &model, index, &input.robot.variants[index])
    };
    let ((of_reduced, samples), (of_full, _)) = (fit(reduced)?, fit(full)?);
    let machine = of_reduced
        .joint
        .machine
        .with_values(of_reduced.joint.values(&of_reduced.fitted));
    let gap = evaluate(&machine, reduced.folder, &reduced.division.validation)?.position_um;
    let misfit = misfit::misfits(&of_reduced, &samples, reduced.file.noise);
    Ok(structural::FullArm::of(
        &of_reduced,
        &of_full,
        misfit,
        gap.into(),
    ))
}

/// The model with all that may be added to it, the index of the base, and the unnamed families.
fn model_of(input: &Input<'_>) -> Result<(Model, usize, Vec<generic::Family>), Error> {
    let Input {
        robot,
        folder,
        division,
        options,
        ..
    } = *input;
    let commands = division
        .calibration
        .iter()
        .flat_map(|&pose| &folder.tcp_poses[pose].commands_m);
    let range_m = commands.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &q| {
        (low.min(q), high.max(q))
    });
    let (model, families) = catalogue(robot, options, range_m)?;
    let index = model
        .variants
        .iter()
        .position(|v| v.name == input.base)
        .unwrap_or_default();
    Ok((model, index, families))
}

/// Searches from a base as it is.
fn search_from(
    input: &Input<'_>,
    started: Instant,
    progress: &mut dyn FnMut(&str),
) -> Result<Outcome, Error> {
    let Input {
        robot,
        file,
        folder,
        division,
        ..
    } = *input;
    let (model, index, families) = model_of(input)?;
    let variant = &robot.variants[index];
    progress("fitting the base to all sets");
    let (fitted, compiled) = std::thread::scope(|scope| {
        let compiled = scope.spawn(|| probes::compiled(&model, index));
        (base_fit(input, &model, index, variant), compiled.join())
    });
    let (fit, samples) = fitted?;
    let compiled = compiled.unwrap_or_else(|_| probes::compiled(&model, index));
    let machine = fit.joint.machine.with_values(fit.joint.values(&fit.fitted));
    let before_floor = floor::floor(&fit, &machine, folder, &division.validation, file.noise)?;
    progress("looking at what could be seen");
    let own_effects = variant.effects.len();
    let probes = Probes::of(
        &model,
        own_effects,
        compiled,
        &fit.joint,
        &fit.fitted,
        &samples,
        file.noise,
    )?;
    let mut bench = Bench::new(model, variant, &families, samples, probes, &fit);
    let view = View::of(&fit);
    let (detectable, cannot_see) = sight::sight(&mut bench, &view);
    let beforehand = Beforehand {
        ambiguous: evidence::ambiguity::ambiguous(&bench, &view),
        misfit: misfit::misfits(&fit, &bench.samples, file.noise),
        serial: Series::of(&view, &bench.samples).map(|series| series.correlation()),
        detectable,
        cannot_see,
        floor: before_floor,
        view,
    };
    let mut search = Search {
        input,
        bench,
        variant: index,
        own_effects,
        fit,
        accepted: vec![],
        unnamed: vec![],
        refused: std::collections::BTreeSet::new(),
        imitated: std::collections::BTreeSet::new(),
        steps: vec![],
        gaps: vec![],
        first: None,
        is_left: false,
    };
    search.run(progress)?;
    finish(input, &search, beforehand, started)
}

/// What was known before the search: of the experiment, and of the base.
struct Beforehand {
    view: View,
    detectable: Vec<results::Detectable>,
    cannot_see: Vec<Unseen>,
    ambiguous: Vec<results::Ambiguous>,
    misfit: Vec<results::Misfit>,
    serial: Option<results::SerialCorrelation>,
    floor: floor::Floor,
}

/// The model with all catalogues and the unnamed families.
fn catalogue(
    robot: &Robot,
    options: &Options,
    range_m: (f64, f64),
) -> Result<(Model, Vec<generic::Family>), Error> {
    let input_error =
        |errors: language::Errors| Error::Input(InputError::whole("effects", errors.to_string()));
    let mut model = language::check_text(&robot.description).map_err(input_error)?;
    for text in &options.catalogues {
        model = effects_from_text(text, &model).map_err(input_error)?;
    }
    let (text, families) = generic::families(&model, range_m);
    Ok((
        effects_from_text(&text, &model).map_err(input_error)?,
        families,
    ))
}

/// The base fitted to all sets, and their samples with the loads of the arm.
fn base_fit(
    input: &Input<'_>,
    model: &Model,
    index: usize,
    variant: &Variant,
) -> Result<(Fit, Vec<Sample>), Error> {
    let Input {
        robot,
        file,
        folder,
        division,
        ..
    } = *input;
    let free = variant::free_turning(model, index, Some(variant));
    let prepared = Prepared::new(robot, &free, file, Some(folder), &division.calibration)?;
    let mut of_set_1 = Sample::all(robot, folder, &division.calibration, &Frames::default());
    place_plates(&prepared.machine, file, &mut of_set_1);
    let alone = Joint::new(
        prepared.machine.clone(),
        &prepared.nominal,
        &of_set_1,
        file.noise,
    )?;
    let (values, mut weights) = Fit::of_set_1(&alone, &of_set_1)?;
    let machine = prepared.machine.with_values(values.clone());
    let frames = Frames::of(&machine, file, folder);
    numbering::check(&machine, folder)?;
    let mut samples = Sample::all(robot, folder, &division.calibration, &frames);
    place_plates(&machine, file, &mut samples);
    let joint = Joint::new(machine.clone(), &prepared.nominal, &samples, file.noise)?;
    let about_lines = outliers::deviations(outliers::about_lines(&samples), &samples);
    weights.extend(outliers::weights(&about_lines).drain(weights.len()..));
    let fit = Fit::robust(joint, &values, weights, &samples, file.noise)?;
    Ok((fit, samples))
}

/// Where the plate stands in set 3, and what the arm weighs on its carts.
pub(crate) fn place_plates(machine: &Machine, file: &RobotFile, samples: &mut [Sample]) {
    let known: Vec<(Vec<f64>, Pose)> = samples
        .iter()
        .filter(|sample| sample.set == 1)
        .map(|sample| (sample.commands_m.clone(), sample.pose))
        .collect();
    let statics = Statics::new(&machine.robot, file);
    let mut last: Option<(u32, Option<Pose>)> = None;
    for sample in samples {
        if sample.set == 3 {
            let plate = match last {
                Some((number, plate)) if number == sample.number => plate,
                _ => {
                    let distance = |commands: &[f64]| -> f64 {
                        commands
                            .iter()
                            .zip(&sample.commands_m)
                            .map(|(a, b)| (a - b).powi(2))
                            .sum()
                    };
                    known
                        .iter()
                        .min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)))
                        .and_then(|(_, pose)| {
                            let start = kinematics::Sample::new(*pose, &sample.commands_m);
                            machine.forward_unchecked(&start).ok()
                        })
                }
            };
            last = Some((sample.number, plate));
            sample.plate = plate;
        }
        if let Some(statics) = &statics {
            sample.load(statics);
        }
    }
}

fn finish(
    input: &Input<'_>,
    search: &Search<'_>,
    beforehand: Beforehand,
    started: Instant,
) -> Result<Outcome, Error> {
    let Input {
        robot,
        base,
        file,
        folder,
        division,
        options,
    } = *input;
    let (fit, bench) = (&search.fit, &search.bench);
    let machine = fit.joint.machine.with_values(fit.joint.values(&fit.fitted));
    let after = Gap::from(evaluate(&machine, folder, &division.validation)?.position_um);
    let before = search.gaps.first().copied().unwrap_or(after);
    let floor = floor::floor(fit, &machine, folder, &division.validation, file.noise)?;
    let line = text::line(base, &search.labels());
    let names: Vec<&str> = search
        .accepted
        .iter()
        .map(|a| bench.candidates[a.candidate].name.as_str())
        .collect();
    let catalogues: Vec<&str> = options.catalogues.iter().map(String::as_str).collect();
    let model_text = text::description(robot, &catalogues, &names, &line)?;
    let view = View::of(fit);
    let mut unnamed: Vec<results::Unnamed> = search
        .unnamed
        .iter()
        .flat_map(|&(family, searched)| structure::unnamed(bench, &view, family, searched))
        .collect();
    unnamed.extend(structure::crowds(fit, bench, file.noise));
    // Noise many times the stated one is something that no family follows, or stated wrongly by far.
    let is_noisy = misfit::noise_scales(fit)
        .iter()
        .any(|scale| scale.factor > FAR_BEYOND);
    let is_left = search.is_left || !unnamed.is_empty() || is_noisy;
    let status = match (search.accepted.is_empty(), is_left) {
        (true, false) => Status::NothingMissing,
        (true, true) => Status::UnnamedStructure,
        (false, false) => Status::Explained,
        (false, true) => Status::PartlyExplained,
    };
    let left_out: Vec<LeftOut> = (0..bench.samples.len())
        .filter(|&s| fit.weights[s] == 0.0)
        .map(|s| {
            let sample = &bench.samples[s];
            LeftOut {
                set: sample.set,
                cart: sample.track.map(|track| robot.tracks[track].clone()),
                number: sample.number,
            }
        })
        .collect();
    let values = fit
        .joint
        .used
        .iter()
        .zip(&fit.fitted)
        .map(|(&index, &value)| {
            (
                fit.joint.machine.variant.parameters[index].name.clone(),
                value,
            )
        })
        .collect();
    let poses = division
        .calibration
        .iter()
        .copied()
        .filter(|&pose| {
            let number = folder.tcp_poses[pose].pose;
            !left_out
                .iter()
                .any(|out| out.set == 1 && out.number == number)
        })
        .collect();
    let mut outliers: Vec<u32> = left_out.iter().map(|out| out.number).collect();
    outliers.sort_unstable();
    outliers.dedup();
    let whiteness = whiteness(search, beforehand.serial);
    let discovery = Discovery {
        base: base.to_owned(),
        status,
        noise_floor_um: floor.mean_m * 1e6,
        ceiling_um: removable_um(before, &beforehand.floor),
        remaining_um: removable_um(after, &floor),
        validation: Validation { before, after },
        misfit: beforehand.misfit,
        noise: misfit::noise_scales(fit),
        effects: effects(search),
        considered: considered(search)
            .into_iter()
            .chain(structural::piecewise_tracks(
                input,
                bench,
                &View::of(fit),
                &robot.variants[search.variant],
            ))
            .collect(),
        cannot_see: beforehand.cannot_see,
        detectable: beforehand.detectable,
        ambiguous: beforehand.ambiguous,
        evidence: evidence::of_effects(search, &beforehand.view),
        unnamed,
        outliers,
        left_out,
        steps: search.steps.clone(),
        model_text,
        remarks: remarks(search, whiteness.as_ref()),
        whiteness,
        seconds: started.elapsed().as_secs_f64(),
    };
    Ok(Outcome {
        discovery,
        values,
        poses,
    })
}

/// Root of what the mean squared error exceeds that of the noise by (µm).
fn removable_um(gap: Gap, floor: &floor::Floor) -> f64 {
    let excess = (gap.rms_um * 1e-6).powi(2) - floor.square_m2;
    excess.max(0.0).sqrt() * 1e6
}

/// Serial correlation of the residuals of the base and of what is left in the end.
fn whiteness(search: &Search<'_>, before: Option<SerialCorrelation>) -> Option<Whiteness> {
    let series = Series::of(&search.view(), &search.bench.samples)?;
    Some(Whiteness {
        order: if series.is_by_time { "time" } else { "row" },
        poses: series.len(),
        lags: series.lags(),
        before: before?,
        after: series.correlation(),
    })
}

fn effects(search: &Search<'_>) -> Vec<FoundEffect> {
    let (fit, bench) = (&search.fit, &search.bench);
    let variant = &fit.joint.machine.variant;
    search
        .accepted
        .iter()
        .enumerate()
        .map(|(index, accepted)| {
            let candidate = &bench.candidates[accepted.candidate];
            let owner = Owner::Effect(search.own_effects + index);
            let parameters = fit
                .joint
                .used
                .iter()
                .enumerate()
                .filter(|(_, used)| variant.parameters[**used].owner == owner)
                .zip(&candidate.parameters)
                .map(|((column, _), described)| {
                    let estimate = Estimate {
                        value: fit.fitted[column],
                        sigma: fit.basis.b.row(column).norm(),
                        unit: described.unit.clone(),
                    };
                    (described.name.clone(), estimate)
                })
                .collect();
            FoundEffect {
                name: candidate.name.clone(),
                place: candidate.places.clone(),
                parameters,
                p_value: accepted.p_value,
                flip_p_value: accepted.flip_p_value,
                chi2_drop: accepted.chi2_drop,
                heldout_drop_um: accepted.heldout_drop_um,
                rivals: accepted
                    .rivals
                    .iter()
                    .map(|rival| Rival {
                        name: bench.candidates[rival.candidate].name.clone(),
                        place: bench.candidates[rival.candidate].places.clone(),
                        cosine: rival.cosine,
                        separate_by: rival.separate_by.clone(),
                    })
                    .collect(),
                searched: candidate
                    .search
                    .map(|(place, _)| candidate.parameters[place].name.clone()),
                aliases: accepted.aliases.clone(),
            }
        })
        .collect()
}

fn considered(search: &Search<'_>) -> Vec<Considered> {
    let bench = &search.bench;
    let Some(table) = &search.first else {
        return vec![];
    };
    let tested = table.scores.len() as f64;
    table
        .scores
        .iter()
        .filter(|score| bench.candidates[score.candidate].is_named())
        .map(|score| {
            let candidate = &bench.candidates[score.candidate];
            let is_rival = search.accepted.iter().any(|a| {
                a.rivals
                    .iter()
                    .any(|rival| rival.candidate == score.candidate)
            });
            let verdict = if search
                .accepted
                .iter()
                .any(|a| a.candidate == score.candidate)
            {
                "found"
            } else if is_rival {
                "could be meant instead"
            } else if search.refused.contains(&score.candidate) {
                "not confirmed"
            } else if score.p_value <= LEVEL / tested {
                if search.accepted.is_empty() {
                    "not the best explanation"
                } else {
                    "explained by what was found"
                }
            } else {
                "not significant"
            };
            Considered {
                name: candidate.name.clone(),
                place: candidate.places.clone(),
                p_value: score.p_value,
                verdict,
            }
        })
        .collect()
}

fn remarks(search: &Search<'_>, whiteness: Option<&Whiteness>) -> Vec<String> {
    let mut remarks = Vec::new();
    for (set, what) in [
        (
            2,
            "set 2 (`cart_poses.csv`) is missing: it would show straightness and rotation of the carts without load",
        ),
        (
            3,
            "set 3 (`cart_positions.csv`) is missing: it would show the carts under load, and errors along the tracks at many commands",
        ),
    ] {
        if !search.bench.samples.iter().any(|sample| sample.set == set) {
            remarks.push(what.to_owned());
        }
    }
    for scale in misfit::noise_scales(&search.fit) {
        if !(0.85..1.15).contains(&scale.factor) {
            remarks.push(format!(
                "the noise of set {} ({}) is {:.2} times the stated one",
                scale.set, scale.of, scale.factor
            ));
        }
    }
    if let Some(found) = whiteness
        && found.after.p_value.min(found.after.portmanteau_p_value) < SERIAL
    {
        remarks.push(format!(
            "the residuals of set 1 that are left follow each other in the order of measurement (correlation of \
             neighbours {:.2}): noise is serial, or something unknown varies slowly; either imitates effects of time \
             and temperature, and makes p-values and standard deviations too small",
            found.after.lag1
        ));
    }
    remarks
}
