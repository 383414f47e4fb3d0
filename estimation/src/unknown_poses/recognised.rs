//! Mistakes of measurements whose poses are unknown, recognised by trying what would mend them.
//!
//! Each hypothesis is fitted at a few poses first, and those that leave less there than the rows as given at more of them. One
//! is believed where it brings the residuals to the noise or much nearer to it, as with measured poses
//! (`trust/recognise.rs`): any change of rows lowers somewhat what a model lacks. A dimension set free pays for the room
//! that it leaves.

use std::borrow::Cow;
use std::collections::BTreeSet;

use nalgebra::Vector3;
use tau_kinematics::Machine;
use tau_robot::measurements::{Folder, PlateKind, PlateRow, TCP_POSES};
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::RobotFile;

use super::fit::Fit;
use super::frames::{self, files_of_places};
use super::starts;
use super::{ROUGH_COST, RowDivision, UnknownPoses, recognising};
use crate::calibration::{self, Error, Nominal, Prepared};
use crate::numerics::distribution::chi2_survival;
use crate::numerics::order::smallest_first;
use crate::numerics::parallel;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::trust::dimensions;
use crate::trust::exchanged::orders;
use crate::trust::frame;
use crate::trust::hypothesis::{
    Hypothesis, THOUSAND, angles, axes, commands_in_degrees, neighbour,
};
use crate::trust::negative::negative_length;
use crate::trust::recognise::{CLOSER, FEW_ITERATIONS, FEW_POSES, POSES, differ, has_sign};
use crate::trust::{ABSURD_TOLERANCES, LEVEL, Mistake, NEARER, ODDS, words};

/// Measurements and the robot that they are of.
#[derive(Clone, Copy)]
pub(super) struct Case<'a> {
    pub(super) robot: &'a Robot,
    pub(super) variant: &'a Variant,
    pub(super) file: &'a RobotFile,
    pub(super) folder: &'a Folder,
    pub(super) division: &'a RowDivision,
    pub(super) options: &'a calibration::Options,
}

/// A mistake of rows, in one file or in all that have what it is about, or a dimension far off.
struct Trial<'a> {
    hypothesis: Hypothesis,
    /// The file; `None` for all.
    file: Option<&'static str>,
    folder: Cow<'a, Folder>,
}

impl Trial<'_> {
    /// The parameter that it sets free.
    fn freed(&self) -> Option<usize> {
        match self.hypothesis {
            Hypothesis::Dimension { parameter, .. } => Some(parameter),
            _ => None,
        }
    }
}

/// A first look at all hypotheses.
pub(super) struct Look<'a> {
    dimensions: Dimensions,
    /// Hypotheses that leave less at a few poses than the rows as given, the best first.
    ranked: Vec<(Squares, Trial<'a>)>,
}

/// Squares after a few steps, tolerances among them, and their expectation.
#[derive(Clone, Copy)]
struct Squares {
    sum: f64,
    expected: f64,
}

impl Squares {
    const NONE: Self = Self {
        sum: f64::INFINITY,
        expected: 1.0,
    };

    fn are_noise(&self) -> bool {
        chi2_survival(self.sum, self.expected) > LEVEL
    }
}

/// Parameters that may be far off, of a machine with links of some length.
struct Dimensions {
    nominal: Vec<Nominal>,
    seen: Vec<usize>,
    length_m: f64,
}

/// Mistakes in the rows of a folder that explain why a variant does not fit: none where it does, and none where it
/// fails on something else.
///
/// # Errors
/// As [`super::rank`].
pub fn mistakes(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: &Folder,
    division: &RowDivision,
) -> Result<Vec<Mistake>, Error> {
    let case = Case {
        robot,
        variant,
        file,
        folder,
        division,
        options: &calibration::Options::default(),
    };
    match Fit::new(robot, variant, &file.completed(robot), folder, division) {
        Ok(fit) => {
            let exchanged = fit.exchanged_distances();
            let is_one = || {
                let found = case.fitted(file, folder, None);
                found.map_or(true, |found| !found.mistakes.is_empty())
            };
            if !exchanged.is_empty() && is_one() {
                return Ok(exchanged);
            }
        }
        // A pose that the drawing can't take may be a mistake.
        Err(Error::Kinematics { .. }) => {}
        Err(error) => return Err(error),
    }
    let thinned = division.thinned(folder, POSES);
    let case = Case {
        division: thinned.as_ref().unwrap_or(division),
        ..case
    };
    let (seen, look) = case.at_first_sight();
    match recognising(&case, None, Some((seen.clone(), look))) {
        Ok((found, mut mistakes)) => {
            mistakes.extend(found.into_iter().flat_map(|found| found.mistakes));
            Ok(mistakes)
        }
        // What is refused before a fit may be why.
        Err(error) => seen.map(|seen| vec![seen]).ok_or(error),
    }
}

impl<'a> Case<'a> {
    /// A mistake without which the rows of a few poses lead to the noise in a few steps, as they don't with it, and all rows do
    /// in the end. A sketch may be as far off as other rows are. The look at hypotheses comes back where there was one.
    pub(super) fn at_first_sight(&self) -> (Option<Mistake>, Option<Look<'a>>) {
        let thinned = self.division.thinned(self.folder, POSES);
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            ..*self
        };
        let few = case.few();
        let as_given = case.cost(self.folder, &few, None).unwrap_or(Squares::NONE);
        if as_given.are_noise() || self.is_sketch() {
            return (None, None);
        }
        let look = self.look(&few, as_given);
        let meets = |(squares, trial): &&(Squares, Trial<'_>)| {
            squares.are_noise() && trial.freed().is_none()
        };
        let right = look.ranked.iter().take_while(meets);
        let fitted = case.closer(right, &look.dimensions, None);
        let fitted: Vec<_> = (fitted.into_iter())
            .filter(|(_, found, _)| found.is_consistent())
            .collect();
        (case.likeliest(fitted, &look.dimensions), Some(look))
    }

    fn is_sketch(&self) -> bool {
        let file = &self.file.completed(self.robot);
        let drawn = Prepared::new(self.robot, self.variant, file, Some(self.folder), &[]);
        drawn.is_ok_and(|drawn| starts::sketched(&drawn).is_some())
    }

    fn few(&self) -> RowDivision {
        let few = self.division.thinned(self.folder, FEW_POSES);
        few.unwrap_or_else(|| self.division.clone())
    }

    /// All hypotheses at a few poses.
    fn look(&self, few: &RowDivision, as_given: Squares) -> Look<'a> {
        let dimensions = self.dimensions(few);
        let trials = self.trials(&dimensions);
        let costs = parallel::map(&trials, |trial| {
            self.cost(&trial.folder, few, dimensions.freed(trial))
        });
        let mut ranked: Vec<(Squares, Trial<'a>)> = (costs.into_iter().zip(trials))
            .filter_map(|(cost, trial)| Some((cost.filter(|cost| cost.sum < as_given.sum)?, trial)))
            .collect();
        smallest_first(&mut ranked, |own| own.0.sum);
        ranked.truncate(CLOSER);
        // Others leave residuals that are so many times as large.
        let least = ranked.first().map_or(0.0, |own| own.0.sum);
        ranked.retain(|own| own.0.sum < NEARER.powi(2) * least);
        Look { dimensions, ranked }
    }

    pub(super) fn fitted(
        &self,
        file: &RobotFile,
        folder: &Folder,
        freed: Option<(usize, f64)>,
    ) -> Result<UnknownPoses, Error> {
        let case = Case {
            file,
            folder,
            ..*self
        };
        recognising(&case, freed, None)?.0
    }

    /// Of a calibration of the rows as they are, or of its failure; hypotheses may have been looked at.
    pub(super) fn explaining(
        &self,
        found: Result<&UnknownPoses, &Error>,
        look: Option<&Look<'_>>,
    ) -> Vec<Mistake> {
        let given = match found {
            Ok(found) if !found.mistakes.is_empty() => return vec![],
            Ok(found) => Some(found),
            Err(Error::Input(_)) => return vec![],
            Err(_) => None,
        };
        let negative = given.and_then(|given| self.negative_length(&given.calibration.machine));
        if let Some(mistake) = negative {
            return vec![mistake];
        }
        let thinned = self.division.thinned(self.folder, POSES);
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            ..*self
        };
        let is_met = given.is_some_and(is_met);
        // Squares are compared with those of the same rows.
        let of_few =
            (thinned.is_some() && !is_met).then(|| case.fitted(self.file, self.folder, None));
        let same_rows = of_few.as_ref().map_or(given, |found| found.as_ref().ok());
        let of_rows = (!is_met).then(|| case.of_rows(same_rows, look)).flatten();
        let of_noise = || given.and_then(|given| self.wrong_noise(given));
        of_rows.or_else(of_noise).into_iter().collect()
    }

    /// The mistake that brings residuals nearest to the noise.
    fn of_rows(&self, given: Option<&UnknownPoses>, look: Option<&Look<'_>>) -> Option<Mistake> {
        let own;
        let look = match look {
            Some(look) => look,
            None => {
                let few = self.few();
                let as_given = self.cost(self.folder, &few, None).unwrap_or(Squares::NONE);
                own = self.look(&few, as_given);
                &own
            }
        };
        let fitted = self.closer(look.ranked.iter(), &look.dimensions, given);
        self.likeliest(fitted, &look.dimensions)
    }

    /// Fits of the rows without mistakes, those that are near the noise and of plausible machines, with their squares.
    fn closer<'t>(
        &self,
        trials: impl Iterator<Item = &'t (Squares, Trial<'t>)>,
        dimensions: &Dimensions,
        given: Option<&UnknownPoses>,
    ) -> Vec<(f64, UnknownPoses, &'t Trial<'t>)> {
        let ratio = given.map(UnknownPoses::residual_over_noise);
        let trials: Vec<&Trial<'_>> = trials.map(|(_, trial)| trial).collect();
        let fitted = parallel::map(&trials, |trial| {
            let freed = dimensions.freed(trial);
            let found = self.fitted(self.file, &trial.folder, freed).ok()?;
            let is_near = match ratio {
                Some(given) => NEARER * found.residual_over_noise() < given,
                None => found.missed_m().is_none(),
            };
            let is_near = is_near || found.is_consistent();
            let room = match trial.hypothesis {
                Hypothesis::Dimension { parameter, .. } => {
                    dimensions.room(parameter, &found, given)?
                }
                Hypothesis::Frame { .. } => scale(&found) * frame::room(),
                _ => 0.0,
            };
            (is_near && is_plausible(&found)).then_some((total(&found) + room, found, *trial))
        });
        fitted.into_iter().flatten().collect()
    }

    /// The likeliest of several, with those beside it that are about as likely.
    fn likeliest(
        &self,
        mut fitted: Vec<(f64, UnknownPoses, &Trial<'_>)>,
        dimensions: &Dimensions,
    ) -> Option<Mistake> {
        smallest_first(&mut fitted, |own| own.0);
        let (least, best, _) = fitted.first()?;
        let limit = least + 2.0 * ODDS.ln() * scale(best);
        let rivals = fitted.iter().take_while(|own| own.0 < limit);
        let rivals: Vec<Mistake> = rivals
            .filter_map(|(_, found, trial)| self.described(trial, dimensions, found))
            .collect();
        words::beside(rivals)
    }

    /// Parameters that some measured poses tell of, to first order. Where less was measured of them, others do the same.
    fn dimensions(&self, few: &RowDivision) -> Dimensions {
        let file = &self.file.completed(self.robot);
        let fit = Fit::new(self.robot, self.variant, file, self.folder, few);
        let measured = fit.ok().filter(|_| !self.folder.tcp_poses.is_empty());
        let Some(fit) = measured else {
            return Dimensions {
                nominal: vec![],
                seen: vec![],
                length_m: 0.0,
            };
        };
        let length_m = fit.mean_length_m();
        let triangle = fit.elimination(&fit.start).reduce().triangle;
        let seen = (fit.used.iter().enumerate())
            .filter(|(k, _)| triangle.column(*k).norm() * dimensions::STEP * length_m > 1.0)
            .filter(|(_, parameter)| fit.prepared.nominal[**parameter].sigma().is_some());
        Dimensions {
            seen: seen.map(|(_, &parameter)| parameter).collect(),
            nominal: fit.prepared.nominal.clone(),
            length_m,
        }
    }

    /// Squares of some rows after a few steps from the drawing, tolerances among them; `None` where there are none. Rows without
    /// a mistake lie near the drawing, and Newton's method squares its error with each step.
    fn cost(
        &self,
        folder: &Folder,
        division: &RowDivision,
        freed: Option<(usize, f64)>,
    ) -> Option<Squares> {
        let file = &self.file.completed(self.robot);
        let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        let mut prepared =
            Prepared::new(self.robot, self.variant, file, Some(folder), &all).ok()?;
        let is_sketch = starts::sketched(&prepared).is_some();
        if let Some((parameter, length_m)) = freed {
            prepared.free(parameter, length_m)?;
        }
        let machine = prepared.machine.clone();
        let fit = Fit::from(&prepared, machine, file, folder, division, is_sketch).ok()?;
        let reduced = fit.elimination(&fit.start).reduce();
        let expected = reduced.rows().saturating_sub(reduced.spent);
        let mut options = self.options.clone();
        options.solver.max_iterations = FEW_ITERATIONS;
        let solution = fit.solved(&fit.start, ROUGH_COST, &options).ok()?;
        let squares = Squares {
            sum: 2.0 * solution.cost,
            expected: expected.max(1) as f64,
        };
        Some(squares).filter(|squares| squares.sum.is_finite())
    }

    /// All hypotheses.
    fn trials(&self, dimensions: &Dimensions) -> Vec<Trial<'a>> {
        let (robot, folder) = (self.robot, self.folder);
        let of_rows: BTreeSet<&str> = folder
            .plate_rows
            .iter()
            .map(|row| row.kind.file())
            .collect();
        let of_poses = (!folder.tcp_poses.is_empty()).then_some(TCP_POSES);
        let files: Vec<&'static str> = (PlateKind::ALL.iter().map(|kind| kind.file()))
            .filter(|file| of_rows.contains(file))
            .chain(of_poses)
            .collect();
        let mut scopes: Vec<Option<&'static str>> = vec![None];
        if files.len() > 1 {
            scopes.extend(files.iter().copied().map(Some));
        }
        let commands = orders(robot.commands).into_iter().map(Hypothesis::Commands);
        let file = &self.file.completed(robot);
        let fit = Fit::new(robot, self.variant, file, folder, self.division);
        let signs = (0..robot.commands).filter(|&command| {
            // Poses that the drawing can't take say nothing against it.
            fit.as_ref().map_or(true, |fit| {
                let (samples, length_m) = (fit.assembly.samples(), fit.mean_length_m());
                has_sign(&fit.machine, samples, command, length_m)
            })
        });
        let of_commands: Vec<Hypothesis> = commands
            .chain(signs.map(Hypothesis::Sign))
            .chain(commands_in_degrees(robot))
            .collect();
        let turns_in_degrees = fit.as_ref().map_or(true, |fit| {
            let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
            let of = |folder: &Folder| Sample::all(robot, folder, &all, &Frames::default());
            let mended = mended(folder, &Hypothesis::Degrees, Some(TCP_POSES));
            let pairs = of(folder).into_iter().zip(of(&mended));
            differ(&fit.machine, pairs, fit.mean_length_m())
        });
        let of_files = files.iter().flat_map(|&file| {
            let shifted = [1, -1].map(Hypothesis::Shifted).into_iter();
            let is_height = file == PlateKind::Height.file();
            let own = shifted.chain(is_height.then_some(Hypothesis::Heights));
            own.map(move |own| (own, Some(file)))
        });
        let of_places = files.iter().filter(|file| files_of_places().contains(file));
        let of_places = of_places.flat_map(|file| {
            let turns = *file == TCP_POSES;
            let is_told = move |own: &Hypothesis| match own {
                Hypothesis::Axes { turned, .. } => turns || !turned,
                Hypothesis::Millimetres => true,
                Hypothesis::Degrees => turns && turns_in_degrees,
                _ => turns,
            };
            let units = [Hypothesis::Millimetres, Hypothesis::Degrees];
            let own = axes(robot.plate)
                .into_iter()
                .chain(angles(robot.plate))
                .chain(units);
            own.filter(is_told).map(|own| (own, Some(*file)))
        });
        let of_commands = scopes.iter().flat_map(|&file| {
            let own = of_commands.iter().cloned();
            own.map(move |own| (own, file))
        });
        let mut frames: Vec<Option<&'static str>> = (files
            .iter()
            .copied()
            .filter(|file| files_of_places().contains(file)))
        .map(Some)
        .collect();
        if frames.len() > 1 {
            frames.push(None);
        }
        let is_whole = frames::are_whole(folder, robot.plate.freedoms_of_tcp());
        let drawn = fit.as_ref().ok().filter(|_| is_whole);
        let of_frames = frames
            .into_iter()
            .filter_map(|file| Some((drawn?.frame(file)?, file)));
        let of_rows = of_commands
            .chain(of_files)
            .chain(of_places)
            .chain(of_frames);
        let of_rows = of_rows.map(|(hypothesis, file)| Trial {
            folder: Cow::Owned(mended(folder, &hypothesis, file)),
            hypothesis,
            file,
        });
        let freed = dimensions.seen.iter().map(|&parameter| Trial {
            folder: Cow::Borrowed(folder),
            hypothesis: Hypothesis::Dimension {
                parameter,
                start: dimensions.nominal[parameter].value,
            },
            file: None,
        });
        of_rows.chain(freed).collect()
    }

    fn described(
        &self,
        trial: &Trial<'_>,
        dimensions: &Dimensions,
        found: &UnknownPoses,
    ) -> Option<Mistake> {
        if let Some(parameter) = trial.freed() {
            let value = found.calibration.machine.values[parameter];
            let described = &self.variant.parameters[parameter];
            let nominal = &dimensions.nominal[parameter];
            return Some(words::dimension(described, nominal, value));
        }
        let first = self.folder.plate_rows.first().map(|row| row.kind.file());
        let file = trial.file.or(first).unwrap_or(TCP_POSES);
        words::of_measurements(self.robot, &trial.hypothesis, file)
    }

    /// A command that drives a length below zero.
    fn negative_length(&self, machine: &Machine) -> Option<Mistake> {
        let of_rows =
            (self.folder.plate_rows.iter()).map(|row| (row.kind.file(), row.commands_m.as_slice()));
        let of_poses = self.folder.tcp_poses.iter();
        let of_poses = of_poses.map(|pose| (TCP_POSES, pose.commands_m.as_slice()));
        let files: Vec<_> = of_rows.chain(of_poses).collect();
        let names: BTreeSet<&'static str> = files.iter().map(|own| own.0).collect();
        names.into_iter().find_map(|name| {
            let own = files.iter().filter(|own| own.0 == name);
            let command = negative_length(machine, own.map(|own| own.1))?;
            let hypothesis = Hypothesis::Sign(command);
            words::of_measurements(self.robot, &hypothesis, name)
        })
    }
}

impl Dimensions {
    /// The parameter that a trial sets free, for links so long (m).
    fn freed(&self, trial: &Trial<'_>) -> Option<(usize, f64)> {
        trial.freed().map(|parameter| (parameter, self.length_m))
    }

    /// The price of a parameter's room: −2 ln of the evidence beside squares, in units of these, by Laplace's
    /// approximation, the choice of one of so many parameters included. `None` where the fit as given is about as likely, or
    /// the parameter keeps its tolerance.
    fn room(
        &self,
        parameter: usize,
        freed: &UnknownPoses,
        given: Option<&UnknownPoses>,
    ) -> Option<f64> {
        let stated = &self.nominal[parameter];
        let own = &freed.calibration;
        let name = &own.machine.variant.parameters[parameter].name;
        let estimate = own.parameters.iter().find(|own| own.name == *name)?;
        let (tolerance, room) = (stated.sigma()?, estimate.tolerance?);
        // Knowledge of it, freed and as stated.
        let known = estimate.sigma.powi(-2);
        let held = known - room.powi(-2) + tolerance.powi(-2);
        let volumes = (room.powi(2) * known / (tolerance.powi(2) * held)).ln();
        let choice = 2.0 * (self.nominal.len() as f64).ln();
        let pays = scale(freed) * (volumes + choice);
        let decisive = scale(freed) * 2.0 * ODDS.ln();
        let is_likelier = given.is_none_or(|given| total(given) - total(freed) - pays > decisive);
        (is_likelier && stated.tolerances_to(estimate.value).abs() > 1.0).then_some(pays)
    }
}

/// Squares count by what a fit leaves of them.
fn scale(found: &UnknownPoses) -> f64 {
    found.residual_over_noise().max(1.0).powi(2)
}

/// The rows are those of a machine.
pub(super) fn is_met(found: &UnknownPoses) -> bool {
    found.is_consistent() && is_plausible(found)
}

/// No parameter is off by more than any machine.
pub(super) fn is_plausible(found: &UnknownPoses) -> bool {
    let mut pulls = found.pulls();
    pulls.all(|pull| pull.tolerances.abs() < ABSURD_TOLERANCES)
}

/// The squares of residuals and tolerances.
fn total(found: &UnknownPoses) -> f64 {
    let pulls = found.pulls().map(|pull| pull.tolerances.powi(2));
    found.chi2 + pulls.sum::<f64>()
}

/// The rows as they would be without a mistake.
fn mended(folder: &Folder, hypothesis: &Hypothesis, file: Option<&str>) -> Folder {
    let given = folder;
    let mut folder = folder.clone();
    let is_meant = |own: &str| file.is_none_or(|file| file == own);
    if let Hypothesis::Shifted(by) = hypothesis {
        let of_file = |row: &&PlateRow| is_meant(row.kind.file());
        let rows: Vec<&PlateRow> = given.plate_rows.iter().filter(of_file).collect();
        let own = folder.plate_rows.iter_mut();
        for (place, row) in own.filter(|row| is_meant(row.kind.file())).enumerate() {
            if let Some(other) = neighbour(&rows, place, *by) {
                row.values = other.values;
                row.sigmas = other.sigmas;
                row.of.clone_from(&other.of);
            }
        }
        let poses = folder.tcp_poses.iter_mut();
        for (place, pose) in poses.enumerate().filter(|_| is_meant(TCP_POSES)) {
            if let Some(other) = neighbour(&given.tcp_poses, place, *by) {
                pose.position_m = other.position_m;
                pose.angles_rad = other.angles_rad;
                pose.sigmas = other.sigmas;
            }
        }
        return folder;
    }
    for row in (folder.plate_rows.iter_mut()).filter(|row| is_meant(row.kind.file())) {
        match hypothesis {
            Hypothesis::Heights => row.values = row.values.map(|value| Some(-value?)),
            Hypothesis::Axes { columns, signs, .. } => {
                let given = row.values;
                row.values = [0, 1, 2].map(|axis| Some(signs[axis] * given[columns[axis]]?));
            }
            Hypothesis::Millimetres => row.values = row.values.map(|value| Some(value? / THOUSAND)),
            Hypothesis::Frame { rotation, shift } if row.kind == PlateKind::Position => {
                let given = row.values;
                let at = rotation * Vector3::from(given.map(Option::unwrap_or_default)) + shift;
                row.values = [0, 1, 2].map(|axis| given[axis].map(|_| at[axis]));
            }
            own => own.mend_commands(&mut row.commands_m, row.directions.as_mut()),
        }
    }
    if is_meant(TCP_POSES) {
        hypothesis.mend_poses(&mut folder.tcp_poses);
    }
    folder
}
