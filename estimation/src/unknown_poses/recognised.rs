//! Mistakes of measurements whose poses are unknown, recognised by trying what would mend them.
//!
//! Each hypothesis is fitted at a few poses first, and those that leave less there than the rows as given at more of them. One
//! is believed where it brings the residuals to the noise or much nearer to it, as with measured poses
//! (`trust/recognise.rs`): any change of rows lowers somewhat what a model lacks. A dimension set free pays for the room
//! that it leaves.

use std::borrow::Cow;
use std::collections::BTreeSet;

use tau_kinematics::Machine;
use tau_robot::measurements::{Folder, PlateKind, TCP_POSES};
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::{RobotFile, StatedNoise};

use super::fit::Fit;
use super::starts;
use super::{ROUGH_COST, RowDivision, UnknownPoses, of_plate};
use crate::calibration::{self, Error, Nominal, Prepared};
use crate::numerics::distribution::chi2_survival;
use crate::numerics::order::smallest_first;
use crate::numerics::parallel;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::trust::dimensions;
use crate::trust::exchanged::orders;
use crate::trust::hypothesis::{Hypothesis, THOUSAND, angles, axes};
use crate::trust::negative::negative_length;
use crate::trust::recognise::{CLOSER, FEW_ITERATIONS, FEW_POSES, POSES, STATED, differ, has_sign};
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
    let completed = &file.completed(robot);
    match Fit::new(robot, variant, completed, folder, division) {
        Ok(fit) => {
            let exchanged = fit.exchanged_distances();
            if !exchanged.is_empty() {
                return Ok(exchanged);
            }
        }
        // A pose that the drawing can't take may be a mistake.
        Err(Error::Kinematics { .. }) => {}
        Err(error) => return Err(error),
    }
    let thinned = division.thinned(folder, POSES);
    let case = Case {
        robot,
        variant,
        file,
        folder,
        division: thinned.as_ref().unwrap_or(division),
        options: &calibration::Options::default(),
    };
    Ok(case.explaining(case.fitted(file, folder, None).as_ref()))
}

impl Case<'_> {
    fn fitted(
        &self,
        file: &RobotFile,
        folder: &Folder,
        freed: Option<(usize, f64)>,
    ) -> Result<UnknownPoses, Error> {
        let of = (self.robot, self.variant);
        let (found, _) = of_plate(of, file, folder, self.division, (self.options, freed))?;
        Ok(found)
    }

    /// Of a calibration of the rows as they are, or of its failure.
    pub(super) fn explaining(&self, found: Result<&UnknownPoses, &Error>) -> Vec<Mistake> {
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
        let is_met = given.is_some_and(|given| given.is_consistent() && is_plausible(given));
        // Squares are compared with those of the same rows.
        let of_few =
            (thinned.is_some() && !is_met).then(|| case.fitted(self.file, self.folder, None));
        let same_rows = of_few.as_ref().map_or(given, |found| found.as_ref().ok());
        let of_rows = (!is_met).then(|| case.of_rows(same_rows)).flatten();
        let of_noise = || given.and_then(|given| case.wrong_noise(given));
        of_rows.or_else(of_noise).into_iter().collect()
    }

    /// The mistake that brings residuals nearest to the noise.
    fn of_rows(&self, given: Option<&UnknownPoses>) -> Option<Mistake> {
        let few = self.division.thinned(self.folder, FEW_POSES);
        let few = few.as_ref().unwrap_or(self.division);
        let ratio = given.map(UnknownPoses::residual_over_noise);
        let dimensions = self.dimensions(few);
        let length_m = dimensions.length_m;
        let freed = |trial: &Trial<'_>| trial.freed().map(|parameter| (parameter, length_m));
        let as_given = self.cost(self.folder, few, None).unwrap_or(f64::INFINITY);
        let trials = self.trials(&dimensions);
        let costs = parallel::map(&trials, |trial| self.cost(&trial.folder, few, freed(trial)));
        let mut ranked: Vec<(f64, &Trial<'_>)> = (costs.into_iter().zip(&trials))
            .filter_map(|(cost, trial)| Some((cost.filter(|cost| *cost < as_given)?, trial)))
            .collect();
        smallest_first(&mut ranked, |own| own.0);
        ranked.truncate(CLOSER);
        // Others leave residuals that are so many times as large.
        let least = ranked.first()?.0;
        ranked.retain(|own| own.0 < NEARER.powi(2) * least);
        let fitted = parallel::map(&ranked, |(_, trial)| {
            let found = self.fitted(self.file, &trial.folder, freed(trial)).ok()?;
            let is_near = found.is_consistent()
                || ratio.is_none_or(|given| NEARER * found.residual_over_noise() < given);
            let room = match trial.freed() {
                Some(parameter) => dimensions.room(parameter, &found, given)?,
                None => 0.0,
            };
            (is_near && is_plausible(&found)).then_some((total(&found) + room, found, *trial))
        });
        let mut fitted: Vec<_> = fitted.into_iter().flatten().collect();
        smallest_first(&mut fitted, |own| own.0);
        let (least, best, _) = fitted.first()?;
        let limit = least + 2.0 * ODDS.ln() * scale(best);
        let rivals = fitted.iter().take_while(|own| own.0 < limit);
        let rivals: Vec<Mistake> = rivals
            .map(|(_, found, trial)| self.described(trial, &dimensions, found))
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
    ) -> Option<f64> {
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
        let mut options = self.options.clone();
        options.solver.max_iterations = FEW_ITERATIONS;
        let solution = fit.solved(&fit.start, ROUGH_COST, &options).ok()?;
        Some(solution.cost).filter(|cost| cost.is_finite())
    }

    /// All hypotheses.
    fn trials(&self, dimensions: &Dimensions) -> Vec<Trial<'_>> {
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
        let of_commands: Vec<Hypothesis> = commands.chain(signs.map(Hypothesis::Sign)).collect();
        let turns_in_degrees = fit.as_ref().map_or(true, |fit| {
            let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
            let of = |folder: &Folder| Sample::all(robot, folder, &all, &Frames::default());
            let mended = mended(folder, &Hypothesis::Degrees, Some(TCP_POSES));
            let pairs = of(folder).into_iter().zip(of(&mended));
            differ(&fit.machine, pairs, fit.mean_length_m())
        });
        let places = [PlateKind::Position.file(), TCP_POSES];
        let of_places = files.iter().filter(|file| places.contains(file));
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
        let of_rows = (of_commands.chain(of_places)).map(|(hypothesis, file)| Trial {
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
    ) -> Mistake {
        if let Some(parameter) = trial.freed() {
            let value = found.calibration.machine.values[parameter];
            let described = &self.variant.parameters[parameter];
            return words::dimension(described, &dimensions.nominal[parameter], value);
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
            Some(words::of_measurements(self.robot, &hypothesis, name))
        })
    }

    /// Noise of the measurements, or of the drives, that is stated a thousand times too large or too small: residuals are far
    /// from it, by more than chance, and by no more than chance beyond a factor of two about a thousandth or a thousand times it.
    fn wrong_noise(&self, given: &UnknownPoses) -> Option<Mistake> {
        let ratio = given.residual_over_noise();
        let is_by_chance = chi2_survival(given.chi2, given.dof) < 1.0 - LEVEL;
        // Tolerances may hold a fit back at noise so large, so that it leaves much of what is stated.
        let factor = if ratio < NEARER.recip() && !is_by_chance {
            THOUSAND.recip()
        } else if ratio > THOUSAND.sqrt() {
            THOUSAND
        } else {
            return None;
        };
        // Few residuals scatter by more than that factor themselves.
        let is_noise = |found: &UnknownPoses| {
            let chance = |factor: f64| chi2_survival(found.chi2 * factor.powi(2), found.dof);
            chance(STATED.recip()) > LEVEL && chance(STATED) < 1.0 - LEVEL
        };
        let is_mended = |file: &RobotFile| {
            let found = self.fitted(file, self.folder, None);
            found.is_ok_and(|found| is_noise(&found) && is_plausible(&found))
        };
        let own = "of the measurements (`[noise]`)";
        let whose = if is_mended(&with_noise(self.file, factor)) {
            own
        } else if !self.file.measuring.drives.is_empty()
            && is_mended(&with_drives(self.file, factor))
        {
            "of the drives (`[drives]`)"
        } else {
            return None;
        };
        Some(words::of_noise(whose, factor))
    }
}

impl Dimensions {
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

/// No parameter is off by more than any machine.
fn is_plausible(found: &UnknownPoses) -> bool {
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
    let mut folder = folder.clone();
    let is_meant = |own: &str| file.is_none_or(|file| file == own);
    for row in (folder.plate_rows.iter_mut()).filter(|row| is_meant(row.kind.file())) {
        match hypothesis {
            Hypothesis::Axes { columns, signs, .. } => {
                let given = row.values;
                row.values = [0, 1, 2].map(|axis| Some(signs[axis] * given[columns[axis]]?));
            }
            Hypothesis::Millimetres => row.values = row.values.map(|value| Some(value? / THOUSAND)),
            own => own.mend_commands(&mut row.commands_m, row.directions.as_mut()),
        }
    }
    if is_meant(TCP_POSES) {
        hypothesis.mend_poses(&mut folder.tcp_poses);
    }
    folder
}

fn scaled(noise: &mut StatedNoise, factor: f64) {
    if let StatedNoise::Known(sigma) = noise {
        *sigma *= factor;
    }
}

fn with_noise(file: &RobotFile, factor: f64) -> RobotFile {
    let mut file = file.clone();
    file.noise.position_m *= factor;
    file.noise.rotation_rad *= factor;
    let axes = file.measuring.axes.iter_mut().flatten();
    let all = file.measuring.noise.values_mut().chain(axes);
    all.for_each(|own| scaled(own, factor));
    file
}

fn with_drives(file: &RobotFile, factor: f64) -> RobotFile {
    let mut file = file.clone();
    let drives = file.measuring.drives.iter_mut();
    drives.for_each(|own| scaled(own, factor));
    file
}
