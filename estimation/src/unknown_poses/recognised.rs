//! Mistakes of measurements whose poses are unknown, recognised by trying what would mend them.
//!
//! Each hypothesis is fitted at a few poses first, and those that leave less there than the rows as given at more of them. One
//! is believed where it brings the residuals to the noise or much nearer to it, as with measured poses
//! (`trust/recognise.rs`): any change of rows lowers somewhat what a model lacks.

use std::collections::BTreeSet;

use tau_robot::measurements::{Folder, PlateKind, TCP_POSES};
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::{RobotFile, StatedNoise};

use super::fit::Fit;
use super::starts;
use super::{ROUGH_COST, RowDivision, UnknownPoses, calibrate};
use crate::calibration::{self, Error, Prepared};
use crate::numerics::distribution::chi2_survival;
use crate::numerics::order::smallest_first;
use crate::numerics::parallel;
use crate::trust::exchanged::orders;
use crate::trust::hypothesis::{Hypothesis, THOUSAND, axes};
use crate::trust::recognise::{
    CAUTIOUS, CLOSER, FEW_ITERATIONS, FEW_POSES, ODDS, POSES, STATED, has_sign,
};
use crate::trust::{ABSURD_TOLERANCES, LEVEL, Mistake, NEARER, words};

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

/// A mistake of rows, in one file or in all that have what it is about.
struct Trial {
    hypothesis: Hypothesis,
    /// The file; `None` for all.
    file: Option<&'static str>,
    folder: Folder,
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
    Ok(case.explaining(case.fitted(file, folder).as_ref()))
}

impl Case<'_> {
    fn fitted(&self, file: &RobotFile, folder: &Folder) -> Result<UnknownPoses, Error> {
        let (robot, variant) = (self.robot, self.variant);
        calibrate(robot, variant, file, folder, self.division, self.options)
    }

    /// Of a calibration of the rows as they are, or of its failure.
    pub(super) fn explaining(&self, found: Result<&UnknownPoses, &Error>) -> Vec<Mistake> {
        let given = match found {
            Ok(found) if !found.mistakes.is_empty() => return vec![],
            Ok(found) => Some(found),
            Err(Error::Input(_)) => return vec![],
            Err(_) => None,
        };
        let thinned = self.division.thinned(self.folder, POSES);
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            ..*self
        };
        let is_met = given.is_some_and(|given| given.is_consistent() && is_plausible(given));
        let ratio = given.map(UnknownPoses::residual_over_noise);
        let of_rows = (!is_met).then(|| case.of_rows(ratio)).flatten();
        let of_noise = || given.and_then(|given| case.wrong_noise(given));
        of_rows.or_else(of_noise).into_iter().collect()
    }

    /// The rows' mistake that brings residuals nearest to the noise.
    fn of_rows(&self, ratio: Option<f64>) -> Option<Mistake> {
        let few = self.division.thinned(self.folder, FEW_POSES);
        let few = few.as_ref().unwrap_or(self.division);
        let given = self.cost(self.folder, few).unwrap_or(f64::INFINITY);
        let trials = self.trials();
        let costs = parallel::map(&trials, |trial| self.cost(&trial.folder, few));
        let mut ranked: Vec<(f64, &Trial)> = (costs.into_iter().zip(&trials))
            .filter_map(|(cost, trial)| Some((cost.filter(|cost| *cost < given)?, trial)))
            .collect();
        smallest_first(&mut ranked, |own| own.0);
        ranked.truncate(CLOSER);
        // Others leave residuals that are so many times as large.
        let least = ranked.first()?.0;
        ranked.retain(|own| own.0 < NEARER.powi(2) * least);
        let fitted = parallel::map(&ranked, |(_, trial)| {
            let found = self.fitted(self.file, &trial.folder).ok()?;
            let is_near = found.is_consistent()
                || ratio.is_none_or(|given| NEARER * found.residual_over_noise() < given);
            (is_near && is_plausible(&found)).then_some((total(&found), found, *trial))
        });
        let mut fitted: Vec<_> = fitted.into_iter().flatten().collect();
        smallest_first(&mut fitted, |own| own.0);
        let (least, best, _) = fitted.first()?;
        let scale = best.residual_over_noise().max(1.0).powi(2);
        let limit = least + 2.0 * ODDS.ln() * scale;
        let rivals = fitted.iter().take_while(|own| own.0 < limit);
        let rivals: Vec<Mistake> = rivals.map(|own| self.described(own.2)).collect();
        words::beside(rivals)
    }

    /// Squares of some rows after a few steps from the drawing, tolerances among them; `None` where there are none. Rows without
    /// a mistake lie near the drawing, and Newton's method squares its error with each step.
    fn cost(&self, folder: &Folder, division: &RowDivision) -> Option<f64> {
        let file = &self.file.completed(self.robot);
        let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        let prepared = Prepared::new(self.robot, self.variant, file, Some(folder), &all).ok()?;
        let is_sketch = starts::sketched(&prepared).is_some();
        let machine = prepared.machine.clone();
        let fit = Fit::from(&prepared, machine, file, folder, division, is_sketch).ok()?;
        let mut options = self.options.clone();
        options.solver.max_iterations = FEW_ITERATIONS;
        let solution = fit.solved(&fit.start, ROUGH_COST, &options).ok()?;
        Some(solution.cost).filter(|cost| cost.is_finite())
    }

    /// All hypotheses on rows.
    fn trials(&self) -> Vec<Trial> {
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
        let places = [PlateKind::Position.file(), TCP_POSES];
        let of_places = files.iter().filter(|file| places.contains(file));
        let of_places = of_places.flat_map(|file| {
            let turns = *file == TCP_POSES;
            let own = axes(robot.plate).into_iter().filter(
                move |own| matches!(own, Hypothesis::Axes { turned, .. } if turns || !turned),
            );
            own.map(|own| (own, Some(*file)))
        });
        let of_commands = scopes.iter().flat_map(|&file| {
            let own = of_commands.iter().cloned();
            own.map(move |own| (own, file))
        });
        (of_commands.chain(of_places))
            .map(|(hypothesis, file)| Trial {
                folder: mended(folder, &hypothesis, file),
                hypothesis,
                file,
            })
            .collect()
    }

    fn described(&self, trial: &Trial) -> Mistake {
        let first = self.folder.plate_rows.first().map(|row| row.kind.file());
        let file = trial.file.or(first).unwrap_or(TCP_POSES);
        words::of_measurements(self.robot, &trial.hypothesis, file)
    }

    /// Noise of the measurements, or of the drives, that is stated a thousand times too large or too small: residuals are far
    /// from it, by more than chance, and within a factor of two of a thousandth or a thousand times it.
    fn wrong_noise(&self, given: &UnknownPoses) -> Option<Mistake> {
        let ratio = given.residual_over_noise();
        let is_by_chance = chi2_survival(given.chi2, given.dof) < 1.0 - LEVEL;
        let factor = if ratio < CAUTIOUS.recip() && !is_by_chance {
            THOUSAND.recip()
        } else if ratio > THOUSAND.sqrt() {
            THOUSAND
        } else {
            return None;
        };
        let off = |ratio: f64| ratio.ln().abs();
        let is_mended = |file: &RobotFile| {
            self.fitted(file, self.folder).is_ok_and(|found| {
                off(found.residual_over_noise()) < STATED.ln() && is_plausible(&found)
            })
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
