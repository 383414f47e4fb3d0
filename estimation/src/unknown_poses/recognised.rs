//! Mistakes of measurements whose poses are unknown, recognised by trying what would mend them.
//!
//! Each hypothesis is fitted at a few poses first, and those that leave less there than the rows as given at more of them. One
//! is believed where it brings the residuals to the noise or much nearer to it, as with measured poses
//! (`trust/recognise.rs`): any change of rows lowers somewhat what a model lacks. A dimension set free pays for the room
//! that it leaves. Where rows meet the noise as given, dimensions alone speak of a mistake, and it must leave none beyond its
//! tolerance.

use std::collections::BTreeSet;

use tau_kinematics::Machine;
use tau_robot::measurements::{Folder, TCP_POSES};
use tau_robot::robot_file::RobotFile;

use super::compared::{has_estimated_noise, misfit, scale, total, total_beside};
use super::fit::Fit;
use super::starts;
use super::tracker::of_true_poses;
use super::trials::{Case, Dimensions, Trial};
use super::{ROUGH_COST, RowDivision, UnknownPoses, recognising};
use crate::calibration;
use crate::machine::Error;
use crate::numerics::distribution::chi2_survival;
use crate::numerics::order::smallest_first;
use crate::numerics::parallel;
use crate::setup::Setup;
use crate::trust::dimensions;
use crate::trust::drawing;
use crate::trust::hypothesis::Hypothesis;
use crate::trust::negative::negative_length;
use crate::trust::recognise::{CLOSER, FEW_ITERATIONS, FEW_POSES, POSES, Recognised};
use crate::trust::{LEVEL, Mistake, MistakeKind, NEARER, ODDS, words};

/// A first look at all hypotheses.
pub(super) struct Look<'a> {
    dimensions: Dimensions,
    /// Of the rows as given.
    given: Squares,
    /// Number of hypotheses that were tried.
    tried: usize,
    /// Those that leave less at a few poses than the rows as given, the best first.
    ranked: Vec<(Squares, Trial<'a>)>,
}

impl Look<'_> {
    /// True if one of so many hypotheses would leave as little by chance, were all of them wrong: residuals of n degrees of
    /// freedom fall to a share s or less with the probability sⁿ. Rows that are met as given are not judged by that.
    fn is_chance(&self, found: &UnknownPoses, given: Option<&UnknownPoses>) -> bool {
        let share = match given {
            Some(given) if given.is_consistent() => return false,
            Some(given) => misfit(found, given) / given.residual_over_noise(),
            None => found.residual_over_noise() / (self.given.sum / self.given.expected).sqrt(),
        };
        let (_, degrees) = found.of_stated();
        self.tried as f64 * share.powf(degrees) > LEVEL
    }
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

/// Mistakes in the rows of a folder that explain why a variant does not fit: none where it does, and none where it
/// fails on something else.
///
/// # Errors
/// As [`super::rank`].
pub fn mistakes(setup: Setup<'_>, division: &RowDivision) -> Result<Vec<Mistake>, Error> {
    Ok(recognised(setup, division)?.mistakes)
}

/// The same, and whether the rows are those of another machine.
///
/// # Errors
/// As [`mistakes`].
pub fn recognised(setup: Setup<'_>, division: &RowDivision) -> Result<Recognised, Error> {
    let variant = &*of_true_poses(setup)?;
    let setup = Setup { variant, ..setup };
    let Setup { file, folder, .. } = setup;
    let case = Case {
        setup,
        division,
        options: &calibration::Options::default(),
        tolerances: None,
    };
    let completed = &file.completed(setup.robot);
    match Fit::new(
        Setup {
            file: completed,
            ..setup
        },
        division,
    ) {
        Ok(fit) => {
            let exchanged = fit.exchanged_distances();
            let is_one = || {
                let found = case.fitted(file, folder, None);
                found.map_or(true, |found| !found.mistakes.is_empty())
            };
            if !exchanged.is_empty() && is_one() {
                return Ok(Recognised {
                    mistakes: exchanged,
                    ..Recognised::default()
                });
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
    // Without a mistake rows lead to the noise in a few steps: with it they may still, but not after a long way.
    let mut brief = case.options.clone();
    brief.solver.max_iterations = brief.solver.max_iterations.min(starts::DESCENT);
    let case = Case {
        options: if seen.is_some() { &brief } else { case.options },
        ..case
    };
    match recognising(&case, None, Some((seen.clone(), look))) {
        Ok((found, mut mistakes)) => {
            let fitted = found.as_ref().ok();
            let another_machine = fitted.and_then(UnknownPoses::another_machine);
            let is_missed = |found: &&UnknownPoses| !found.is_consistent() || found.widened > 1.0;
            let misfit = fitted
                .filter(is_missed)
                .map(UnknownPoses::residual_over_noise);
            let has_fit = fitted.is_some();
            mistakes.extend(found.into_iter().flat_map(|found| found.mistakes));
            let is_explained = !mistakes.is_empty();
            Ok(Recognised {
                mistakes,
                another_machine: another_machine.filter(|_| !is_explained),
                misfit: misfit.filter(|_| !is_explained),
                is_without_fit: !has_fit && !is_explained,
                machine: None,
            })
        }
        // A mistake may be the reason of a refusal before the fit.
        Err(error) => seen.ok_or(error).map(|seen| Recognised {
            mistakes: vec![seen],
            ..Recognised::default()
        }),
    }
}

impl<'a> Case<'a> {
    /// A mistake without which the rows of a few poses lead to the noise in a few steps, as they don't with it, and all rows do
    /// in the end. A sketch may be as far off as other rows are. The look at hypotheses comes back where there was one.
    pub(super) fn at_first_sight(&self) -> (Option<Mistake>, Option<Look<'a>>) {
        let thinned = self.division.thinned(self.setup.folder, POSES);
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            ..*self
        };
        let few = case.few();
        let as_given = case
            .cost(self.setup.folder, &few, None)
            .unwrap_or(Squares::NONE);
        if as_given.are_noise() || self.is_sketch() {
            return (None, None);
        }
        let look = self.look(&few, as_given);
        let meets = |(squares, trial): &&(Squares, Trial<'_>)| {
            squares.are_noise() && trial.freed().is_none()
        };
        let right = look.ranked.iter().take_while(meets);
        let fitted = case.closer(right, &look, None);
        let fitted: Vec<_> = (fitted.into_iter())
            .filter(|(_, found, _)| found.is_consistent())
            .collect();
        (case.likeliest(fitted, &look.dimensions), Some(look))
    }

    fn is_sketch(&self) -> bool {
        let file = &self.setup.file.completed(self.setup.robot);
        let drawn = Setup { file, ..self.setup }.prepared(&[]);
        drawn.is_ok_and(|drawn| starts::sketched(&drawn).is_some())
    }

    fn few(&self) -> RowDivision {
        let few = self.division.thinned(self.setup.folder, FEW_POSES);
        few.unwrap_or_else(|| self.division.clone())
    }

    /// All hypotheses at a few poses.
    fn look(&self, few: &RowDivision, as_given: Squares) -> Look<'a> {
        let dimensions = self.dimensions(few);
        let trials = self.trials(&dimensions);
        self.ranked(few, as_given, dimensions, trials)
    }

    fn ranked(
        &self,
        few: &RowDivision,
        as_given: Squares,
        dimensions: Dimensions,
        trials: Vec<Trial<'a>>,
    ) -> Look<'a> {
        let tried = trials.len();
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
        Look {
            dimensions,
            given: as_given,
            tried,
            ranked,
        }
    }

    pub(super) fn fitted(
        &self,
        file: &RobotFile,
        folder: &Folder,
        freed: Option<(usize, f64)>,
    ) -> Result<UnknownPoses, Error> {
        let case = Case {
            setup: Setup {
                file,
                folder,
                ..self.setup
            },
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
        let thinned = self.division.thinned(self.setup.folder, POSES);
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            ..*self
        };
        if let Some(mistake) = case.wide_tolerances(given) {
            return vec![mistake];
        }
        let is_met = given.is_some_and(|given| {
            given.is_met() && given.beyond_tolerance().is_none() && !is_doubtful(given, look)
        });
        // Squares are compared with those of the same rows.
        let of_few = (thinned.is_some() && !is_met)
            .then(|| case.fitted(self.setup.file, self.setup.folder, None));
        let same_rows = of_few.as_ref().map_or(given, |found| found.as_ref().ok());
        let of_rows = (!is_met).then(|| case.of_rows(same_rows, look)).flatten();
        let of_tolerances = || given.and_then(|given| self.small_tolerances(given));
        let of_noise = || given.and_then(|given| self.wrong_noise(given));
        let found = match of_rows {
            // With wider tolerances residuals are the noise: what leaves so much more explains less.
            Some((mistake, left)) if left > NEARER => of_tolerances().or(Some(mistake)),
            Some((mistake, _)) => Some(mistake),
            None => of_tolerances().or_else(of_noise),
        };
        found.into_iter().collect()
    }

    /// The mistake that brings residuals nearest to the noise, and the least that one leaves, over the noise.
    fn of_rows(
        &self,
        given: Option<&UnknownPoses>,
        look: Option<&Look<'_>>,
    ) -> Option<(Mistake, f64)> {
        let own;
        let look = match look {
            Some(look) => look,
            None => {
                let few = self.few();
                let as_given = self
                    .cost(self.setup.folder, &few, None)
                    .unwrap_or(Squares::NONE);
                own = self.look(&few, as_given);
                &own
            }
        };
        let furthest = given.and_then(|given| self.furthest(given, look));
        let is_other = |own: &&(Squares, Trial<'_>)| {
            (furthest.as_ref()).is_none_or(|(_, trial)| trial.freed() != own.1.freed())
        };
        let trials = look.ranked.iter().filter(is_other).chain(&furthest);
        let mut fitted = self.closer(trials, look, given);
        // Where places were not measured, most dimensions do what some others do: those that are off tell whether to look.
        let is_off = |given: &UnknownPoses| given.beyond_tolerance().is_some();
        let drawing = (given.is_some_and(is_off) && !self.has_poses()).then(|| self.drawing());
        let drawing = drawing.as_ref();
        fitted.extend(drawing.into_iter().flat_map(|own| {
            let mut fitted = self.closer(own.ranked.iter(), own, given);
            fitted.retain(|(_, found, _)| found.is_consistent());
            fitted
        }));
        let dimensions = drawing.map_or(&look.dimensions, |own| &own.dimensions);
        let left = fitted.iter().map(|own| own.1.residual_over_noise());
        let left = left.fold(f64::INFINITY, f64::min);
        let mut found = self.likeliest(fitted, dimensions)?;
        let is_missed = given.is_none_or(|given| given.missed().is_some());
        found.is_absurd |= found.kind == MistakeKind::CommandZero && is_missed;
        Some((found, left))
    }

    /// The parameter that lies farthest from its nominal value where the rows meet the noise so, set free: a few steps from the
    /// drawing may lead elsewhere.
    fn furthest(&self, given: &UnknownPoses, look: &Look<'_>) -> Option<(Squares, Trial<'a>)> {
        let furthest = given.is_consistent().then(|| given.beyond_tolerance())??;
        let name = &given.calibration.parameters[furthest.parameter].name;
        let parameters = &given.calibration.machine.variant.parameters;
        let own = parameters.iter().position(|own| own.name == *name)?;
        let mut trials = look.dimensions.freed_of(self.setup.folder);
        let trial = trials.find(|trial| trial.freed() == Some(own))?;
        Some((Squares::NONE, trial))
    }

    /// Fits of the rows without mistakes, those that are near the noise and of plausible machines, with their squares.
    fn closer<'t>(
        &self,
        trials: impl Iterator<Item = &'t (Squares, Trial<'t>)>,
        look: &Look<'_>,
        given: Option<&UnknownPoses>,
    ) -> Vec<(f64, UnknownPoses, &'t Trial<'t>)> {
        let dimensions = &look.dimensions;
        let trials: Vec<&Trial<'_>> = trials.map(|(_, trial)| trial).collect();
        let fitted = parallel::map(&trials, |trial| {
            let freed = dimensions.freed(trial);
            let found = self.fitted(self.setup.file, &trial.folder, freed).ok()?;
            let is_near = match given {
                Some(given) => NEARER * misfit(&found, given) < given.residual_over_noise(),
                None => found.missed().is_none(),
            };
            let is_near = is_near || (found.is_consistent() && !has_estimated_noise(&found));
            let room = match trial.hypothesis {
                Hypothesis::Dimension { parameter, .. } => {
                    dimensions.room(parameter, &found, given)?
                }
                Hypothesis::Frame { .. } => scale(&found) * drawing::room(6),
                Hypothesis::Zero { .. } => scale(&found) * drawing::room(1),
                _ => 0.0,
            };
            let total = total_beside(&found, given.unwrap_or(&found)) + room;
            // Rows that meet the noise as given, with parameters far off, must speak for it by these.
            let is_likelier = given.is_none_or(|given| {
                let decisive = scale(&found) * 2.0 * ODDS.ln();
                !given.is_consistent() || self::total(given) - total > decisive
            });
            // Rows that meet the noise are of the same machine, whatever its zeros.
            let is_met = matches!(trial.hypothesis, Hypothesis::Zero { .. })
                && given.is_some_and(UnknownPoses::is_consistent);
            let is_told = is_near && is_likelier && !is_met && !look.is_chance(&found, given);
            let is_drawn = !given.is_some_and(UnknownPoses::is_consistent)
                || found.beyond_tolerance().is_none();
            (is_told && is_drawn && found.is_plausible()).then_some((total, found, *trial))
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
        let mut rivals: Vec<_> = fitted.iter().take_while(|own| own.0 < limit).collect();
        // A value of the drawing that does the same as a zero is looked up first.
        rivals.sort_by_key(|own| matches!(own.2.hypothesis, Hypothesis::Zero { .. }));
        let rivals: Vec<Mistake> = (rivals.into_iter())
            .filter_map(|(_, found, trial)| self.described(trial, dimensions, found))
            .collect();
        words::beside(rivals)
    }

    /// A look at all dimensions, each set free.
    fn drawing(&self) -> Look<'a> {
        let few = self.few();
        let dimensions = self.seen(&few);
        let trials = dimensions.freed_of(self.setup.folder).collect();
        self.ranked(&few, Squares::NONE, dimensions, trials)
    }

    fn has_poses(&self) -> bool {
        !self.setup.folder.tcp_poses.is_empty()
    }

    /// One dimension far off with which the rows meet the stated noise, where no place was measured and a few of its kind do
    /// the same.
    pub(super) fn dimension_instead(&self, given: &UnknownPoses) -> Option<Mistake> {
        let thinned = self.division.thinned(self.setup.folder, POSES);
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            ..*self
        };
        let look = case.drawing();
        let mut fitted = case.closer(look.ranked.iter(), &look, Some(given));
        fitted.retain(|(_, found, _)| found.is_consistent());
        case.likeliest(fitted, &look.dimensions)
    }

    /// Parameters that some measured poses tell of, to first order. Where less was measured of them, others do the same.
    fn dimensions(&self, few: &RowDivision) -> Dimensions {
        if self.has_poses() {
            self.seen(few)
        } else {
            Dimensions::default()
        }
    }

    /// Parameters that some rows tell of, to first order.
    fn seen(&self, few: &RowDivision) -> Dimensions {
        let file = &self.setup.file.completed(self.setup.robot);
        let fit = Fit::new(Setup { file, ..self.setup }, few);
        let Ok(fit) = fit else {
            return Dimensions::default();
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
        let file = &self.setup.file.completed(self.setup.robot);
        let setup = Setup {
            file,
            folder,
            ..self.setup
        };
        let mut prepared = setup.prepared_by_all().ok()?;
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

    fn described(
        &self,
        trial: &Trial<'_>,
        dimensions: &Dimensions,
        found: &UnknownPoses,
    ) -> Option<Mistake> {
        if let Some(parameter) = trial.freed() {
            let value = found.calibration.machine.values[parameter];
            let described = &self.setup.variant.parameters[parameter];
            let nominal = &dimensions.nominal[parameter];
            return Some(words::dimension(described, nominal, value));
        }
        let first = self
            .setup
            .folder
            .plate_rows
            .first()
            .map(|row| row.kind.file());
        let file = trial.file.or(first).unwrap_or(TCP_POSES);
        words::of_measurements(self.setup.robot, &trial.hypothesis, file)
    }

    /// A command that drives a length below zero.
    fn negative_length(&self, machine: &Machine) -> Option<Mistake> {
        let of_rows = (self.setup.folder.plate_rows.iter())
            .map(|row| (row.kind.file(), row.commands_m.as_slice()));
        let of_poses = self.setup.folder.tcp_poses.iter();
        let of_poses = of_poses.map(|pose| (TCP_POSES, pose.commands_m.as_slice()));
        let files: Vec<_> = of_rows.chain(of_poses).collect();
        let names: BTreeSet<&'static str> = files.iter().map(|own| own.0).collect();
        names.into_iter().find_map(|name| {
            let own = files.iter().filter(|own| own.0 == name);
            let command = negative_length(machine, own.map(|own| own.1))?;
            let hypothesis = Hypothesis::Signs(vec![command]);
            words::of_measurements(self.setup.robot, &hypothesis, name)
        })
    }
}

/// Noise that is estimated is met by any fit: then it tells something if a few rows are met far better without a mistake.
fn is_doubtful(given: &UnknownPoses, look: Option<&Look<'_>>) -> bool {
    let is_nearer = |look: &Look<'_>| {
        let best = look.ranked.first();
        best.is_some_and(|(squares, _)| NEARER.powi(2) * squares.sum < look.given.sum)
    };
    has_estimated_noise(given) && look.is_some_and(is_nearer)
}
