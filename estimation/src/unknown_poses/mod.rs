//! Calibration from any measurements: the true pose behind every sample is unknown.
//!
//! Readings of the drives and of the plate are residuals of the true pose: each link's closure, with the
//! noise that the drives give it; positions, heights, distances, each with its own. The solver eliminates the poses
//! one by one (Schur complement), so that time and memory grow linearly with their number; distances couple two.
//! Where poses are measured fully and drives are exact, this is to first order the fit of the closures, whitened.

mod assembly;
mod branches;
mod carts;
mod closures;
mod clusters;
mod compared;
mod coupled;
mod curvature;
mod dense;
mod directions;
mod elimination;
mod estimated;
mod evaluation;
mod exchanged;
mod finish;
mod fit;
mod frames;
mod gauge;
mod gross_poses;
mod heldout;
mod kinds;
mod lengths;
mod linearized;
mod measurand;
mod mirror;
mod noise;
mod objects;
mod outcome;
mod pose;
mod predicted;
mod quantity;
mod recognised;
mod refusals;
mod repeats;
pub mod rounds;
mod rows;
mod serial;
mod starts;
mod stated_noise;
#[cfg(test)]
mod tests;
mod tracked;
mod tracker;
mod trials;
mod unsolved;
mod verdict;
mod widened;

use std::collections::BTreeSet;

use tau_kinematics::Machine;
use tau_robot::measurements::{Folder, ObjectKind};
use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;
use tau_solver::{Solution, solve};

use crate::calibration::serial::refuse_rho;
use crate::calibration::{self, Combination, EXACT_COST};
use crate::machine::Error;
use crate::machine::error::{ended, unsolved};
use crate::problem::CLOSURE_SHARE;
use crate::setup::Setup;
use crate::trust::Mistake;
use crate::weighing::Loss;
use elimination::Reduced;
use fit::{Fit, UNSEEN};
use kinds::kinds_of_noise;
use refusals::{refuse_commands, refuse_contradictions};
use starts::Search;
use tracker::of_true_poses;
use trials::Case;

pub use estimated::{EstimatedPoses, Placed, Side};
pub use evaluation::{
    HeldErrors, JudgedRows, KindErrors, Moved, PlaceEstimate, RowError, evaluate,
};
pub use gauge::Freedom;
pub use gross_poses::GrossPose;
pub use heldout::{HeldOut, HeldOutFit};
pub use measurand::Measurand;
pub use objects::Object;
pub use outcome::{GrossRow, ObjectEstimate, Rank, RowDivision, UnknownPoses};
pub use predicted::HeldOutKind;
pub use recognised::{mistakes, recognised};
pub use rows::{Kind, KindFit, KindRepeats, RowPlace};
pub use unsolved::Unsolved;

/// Rounds of fit, weights and noise; a handful is usual. Estimated noise of kinds with little redundancy converges
/// slowest.
const ROUNDS: usize = 60;
/// Relative change of the cost at which a round ends while the noise of groups is judged: it hardly follows where cost
/// creeps along valleys that mean nothing.
const CREEPING_COST: f64 = 1e-4;
/// The same while noise is taken for larger than stated: a tenth of the cost is a twentieth of the noise that follows.
const STAGE_COST: f64 = 0.1;
/// Relative change of the cost at which a round ends while noise is still estimated: 1e-8 moves parameters by 1e-4 of their
/// standard deviations, and noise by less.
const ROUGH_COST: f64 = 1e-8;
/// Changes of a standard deviation below this share are none: far less than what its own estimate is known to.
const SAME_NOISE: f64 = 1e-3;
/// The same while gross rows are sought, for which a standard deviation to a percent is more than enough.
const ROUGH_NOISE: f64 = 1e-2;
/// Moves of a base (m, rad) below which the weights of closures stay as they are: over links of a metre they turn by
/// as little.
const SAME_POSE: f64 = 1e-4;
/// Standard deviations from which on a square is told from none, one in forty times by chance.
const TOLD: f64 = 2.0;

/// True if a folder does not tell poses as they are: it holds measurements that tell less than a pose, or poses with noise of
/// their own; drives are not exact; or there are more of them than freedoms, so that they measure each other. Every command
/// then takes true poses for unknown.
pub fn are_unknown(robot: &Robot, file: &RobotFile, folder: &Folder) -> bool {
    folder.has_partial_poses() || !file.measuring.drives.is_empty() || robot.is_redundant()
}

/// Rank and gauge from the nominal values, before the first step of a fit, and the combinations of which the tolerances say
/// more than the measurements, but for what these leave open.
///
/// # Errors
/// As [`calibrate`], but for what only a fit can fail on.
pub fn observability(
    setup: Setup<'_>,
    division: &RowDivision,
) -> Result<(Rank, Vec<Combination>), Error> {
    let variant = &*of_true_poses(setup)?;
    let file = &setup.file.completed(setup.robot);
    let at = Setup {
        variant,
        file,
        ..setup
    };
    let fit = Fit::new(at, division)?;
    refuse_commands(&fit.prepared.machine, setup.folder)?;
    refuse_contradictions(&fit)?;
    let reduced = fit.elimination(&fit.start).reduce();
    let mut weak = fit.undetermined(&reduced.triangle, &fit.start)?;
    weak.retain(|combination| combination.data_over_prior < 1.0 / UNSEEN);
    Ok((fit.rank(&reduced, &fit.machine), weak))
}

/// Fits a variant to all measurements of a folder; `division` says which rows of the plate take part.
///
/// # Errors
/// [`Error::Input`] where columns, noise or values are missing, where every row is needed to determine the parameters,
/// and where a scale is free; [`Error::Kinematics`] where a pose can't be found from the nominal machine;
/// [`Error::NotConverged`]. Where a mistake of the rows leaves no fit, [`mistakes`] says so.
pub fn calibrate(
    setup: Setup<'_>,
    division: &RowDivision,
    options: &calibration::Options,
) -> Result<UnknownPoses, Error> {
    refuse_rho(setup.file)?;
    let variant = &*of_true_poses(setup)?;
    let fitted = Setup { variant, ..setup };
    let (plate, mistakes) = of_plate(fitted, division, options)?;
    let file = &setup.file.completed(setup.robot);
    let mut found = carts::beside(plate, Setup { file, ..fitted }, division, options)?;
    found.mistakes.extend(mistakes);
    // Who takes the machine for poses that were measured wants closures with the errors in them, as they are described.
    found.calibration.machine.variant.clone_from(setup.variant);
    Ok(found)
}

/// The same of the plate alone, with mistakes that explain it, as far as options ask for these.
///
/// # Errors
/// As [`calibrate`].
fn of_plate(
    setup: Setup<'_>,
    division: &RowDivision,
    options: &calibration::Options,
) -> Result<(UnknownPoses, Vec<Mistake>), Error> {
    let case = Case {
        setup,
        division,
        options,
        tolerances: None,
    };
    let sight = (options.recognises_mistakes).then(|| case.at_first_sight());
    let (found, mistakes) = recognising(&case, None, sight)?;
    Ok((found?, mistakes))
}

/// The fit of a case, and the mistakes that explain it or why there is none, if anything was looked at for these: a mistake at
/// first sight, or hypotheses. Where a parameter is `freed`, links being so long (m), it is as if nothing were stated of it.
///
/// # Errors
/// Data that the variant takes are missing.
fn recognising<'a>(
    case: &Case<'a>,
    freed: Option<(usize, f64)>,
    sight: Option<(Option<Mistake>, Option<recognised::Look<'a>>)>,
) -> Result<(Result<UnknownPoses, Error>, Vec<Mistake>), Error> {
    let Case {
        setup,
        division,
        options,
        tolerances,
    } = *case;
    let file = &setup.file.completed(setup.robot);
    let folder = setup.folder;
    let mut prepared = Setup { file, ..setup }.prepared_by_all()?;
    refuse_commands(&prepared.machine, folder)?;
    // Narrower tolerances make a drawing of a sketch; wider ones are tried from the drawing, which is none.
    let mut sketch_m = starts::sketched(&prepared);
    if let Some(hypothesis) = tolerances {
        hypothesis.restate(&mut prepared);
        sketch_m = sketch_m.and(starts::sketched(&prepared));
    }
    if let Some((parameter, length_m)) = freed {
        prepared.free(parameter, length_m);
    }
    let without = |gross: &[GrossRow], machine: Machine, division: &RowDivision, search: Search| {
        let options = calibration::Options {
            solver: search.options(&options.solver, division.calibration.len()),
            ..options.clone()
        };
        let has_others = sketch_m.is_some();
        let tried = |is_loose: bool, gross: &[GrossRow]| {
            let machine = machine.clone();
            let mut fit = Fit::from(&prepared, machine, file, folder, division, has_others)?;
            if is_loose {
                fit.loosen();
            }
            fit.is_lead = search == Search::Lead;
            fit.start_without(gross)?;
            if search == Search::Widened {
                fit.widen(&options)?;
            }
            let found = fitted(fit, &options)?;
            Ok(found.beside_gross(gross))
        };
        let is_missed = |found: &UnknownPoses| found.kinds.iter().any(KindFit::is_missed);
        match tried(false, gross) {
            Ok(found) if is_missed(&found) => {
                let loose = tried(true, gross)?;
                if loose.gross.iter().all(|row| row.place.drive.is_none()) {
                    return Ok(loose);
                }
                // Without readings that are off, exact drives may agree.
                let exact = tried(false, &loose.gross).ok();
                Ok(exact.filter(|found| !is_missed(found)).unwrap_or(loose))
            }
            found => found,
        }
    };
    let fitted = |machine, division: &RowDivision, search| without(&[], machine, division, search);
    let nominal = || prepared.machine.clone();
    let widened = || widened::best(|gross| without(gross, nominal(), division, Search::Widened));
    let looks = sight.is_some();
    let (at_sight, look) = sight.unwrap_or_default();
    let mirrored = |found: &UnknownPoses| {
        let has_image = found.rank.has_mirror_image;
        has_image.then(|| mirror::image(&prepared, &found.calibration.machine))?
    };
    let first = match sketch_m {
        Some(length_m) => starts::best(&prepared, length_m, division, fitted, mirrored),
        None => fitted(nominal(), division, Search::Stated),
    };
    // Beside noise that is to be estimated anything passes for a fit: rows are suspected only where they have none as they are.
    let leads_nowhere = matches!(first, Err(Error::NotConverged { .. }));
    let is_estimated = || {
        let kinds = kinds_of_noise(folder, file, &prepared.machine);
        kinds.is_ok_and(|kinds| kinds.iter().any(Kind::is_estimated))
    };
    let is_widened = leads_nowhere && at_sight.is_none() && sketch_m.is_none() && is_estimated();
    let first = if is_widened {
        widened().or(first)
    } else {
        first
    };
    let is_met = || first.as_ref().is_ok_and(UnknownPoses::is_met);
    let mut mistakes = match at_sight {
        Some(mistake) if !is_met() => vec![mistake],
        _ if looks => case.explaining(first.as_ref(), look.as_ref()),
        _ => vec![],
    };
    let is_explained = sketch_m.is_some() || mistakes.iter().any(|mistake| mistake.is_absurd);
    let found = match first {
        found if is_widened => found,
        Ok(found) if !is_explained && found.outweighs_tolerances() => widened().or(Ok(found)),
        Err(Error::NotConverged { .. } | Error::Kinematics { .. }) if !is_explained => widened(),
        found => found,
    };
    if let Some(found) = found.as_ref().ok().filter(|found| found.widened > 1.0)
        && looks
        && mistakes.is_empty()
    {
        mistakes.extend(case.wrong_noise(found));
    }
    Ok((found, mistakes))
}

/// The fit from a start to its end, with the noise of kinds that ask for it and without gross rows.
fn fitted(mut fit: Fit<'_>, options: &calibration::Options) -> Result<UnknownPoses, Error> {
    refuse_contradictions(&fit)?;
    let reduced = fit.elimination(&fit.start).reduce();
    fit.refuse_units(&reduced)?;
    let rank = fit.rank(&reduced, &fit.machine);
    fit.refuse_rank(&rank, options.free_scale)?;
    fit.refuse_treatment(options.treatment)?;
    let mistakes = fit.exchanged_distances();
    let mut settled = fit.settled(options)?;
    fit.narrow(&mut settled);
    let loss = options.treatment.loss;
    if loss.is_some() || options.treatment.keep_outliers {
        fit.gross = fit.gross_rows(&settled.reduced, &settled.leverages);
    }
    if options.treatment.keep_outliers {
        // One that pulls as much as the others makes all of its pose look as bad.
        let mut seen = BTreeSet::new();
        fit.gross.retain(|row| seen.insert(row.place.pose));
    }
    fit.restate_gross(&settled.solution.parameters)?;
    let machine = fit.machine_at(&settled.solution.parameters);
    let rank = if fit.is_lead {
        rank
    } else {
        fit.rank(&settled.reduced, &machine)
    };
    let found = fit.finish(&settled, rank, options)?;
    // About a rough drawing, what bends more than the noise looks like a mistake to first order: the fit decides.
    let is_met = found.gross.is_empty() && found.is_met();
    Ok(UnknownPoses {
        mistakes: if is_met { vec![] } else { mistakes },
        loss,
        widened: fit.widened,
        is_settled: settled.has_converged,
        ..found
    })
}

/// A fit at its end.
struct Settled {
    solution: Solution,
    /// Of all rounds.
    iterations: usize,
    reduced: Reduced,
    /// Share of each residual that the fit absorbs.
    leverages: Vec<Vec<f64>>,
    /// False where the rounds ran out.
    has_converged: bool,
}

impl Fit<'_> {
    /// Fits in rounds, until poses, noise and the rows that take part stay as they are.
    fn settled(&mut self, options: &calibration::Options) -> Result<Settled, Error> {
        let mut values = self.start.clone();
        let mut iterations = 0;
        let mut rounds = 0;
        // Noise that is estimated must not be that of gross rows, which would hide among it: they are sought under Huber's loss
        // first. Losses that let go of what is far off begin where this convex one ends, with the noise that it found (V. J.
        // Yohai, 1987, MM-estimates): their own could shrink to that of the few rows that they keep.
        let loss = options.treatment.loss;
        let keeps = loss.is_some() || options.treatment.keep_outliers;
        let has_groups = !self.groups.is_empty();
        let is_estimated = has_groups || self.assembly.kinds.iter().any(Kind::is_estimated);
        self.loss = (loss.is_some() || (is_estimated && !keeps)).then_some(Loss::Huber);
        let mut is_exact = !is_estimated;
        // Errors in variables start from the fit of the closures, which is near.
        if !has_groups {
            iterations += self.approach(&mut values, options)?;
        }
        loop {
            rounds += 1;
            let tolerance = match (is_exact, has_groups) {
                (true, _) => EXACT_COST,
                (false, true) => CREEPING_COST,
                (false, false) => ROUGH_COST,
            };
            let mut solution = self.solved(&values, tolerance, options)?;
            if !solution.converged() || solution.parameters.iter().any(|value| !value.is_finite()) {
                return Err(self.not_converged(ended(solution.termination)));
            }
            iterations += solution.iterations;

            values.clone_from(&solution.parameters);
            // A sketch has several starts. Others are given up as soon as those of a sketch are.
            if rounds == 1 && !has_groups && !self.has_others {
                let mut brief = options.clone();
                brief.solver = Search::Descent.options(&options.solver, self.assembly.poses.len());
                for other in self.other_sides(&values) {
                    let found = self.solved(&other, tolerance, &brief);
                    let better = found.ok().filter(Solution::converged);
                    if let Some(better) = better.filter(|own| own.cost < solution.cost) {
                        iterations += better.iterations;
                        solution = better;
                        values.clone_from(&solution.parameters);
                    }
                }
            }
            let moved = self.largest_move(&values);
            // Errors in variables measure all poses; those that stay were looked at a round before.
            let may_turn = !has_groups && (rounds == 1 || moved >= SAME_POSE);
            if may_turn && rounds < ROUNDS && self.revisit(&mut values) {
                self.rebuild(&mut values)?;
                continue;
            }
            // Weights change until poses stay: nothing else is known before.
            let waits = !is_estimated || (has_groups && !is_exact);
            if waits && moved >= SAME_POSE && rounds < ROUNDS {
                is_exact = !is_estimated;
                self.rebuild(&mut values)?;
                continue;
            }
            let elimination = self.elimination(&values);
            let reduced = elimination.reduce();
            // The noise of groups is that of rounds before the last, which costs the most steps.
            if has_groups && is_exact {
                return Ok(Settled {
                    solution,
                    iterations,
                    reduced,
                    leverages: vec![],
                    has_converged: rounds < ROUNDS,
                });
            }
            let leverages = elimination.leverages(&self.determined(&reduced.triangle));
            let is_last = self.loss == loss;
            let noise = if is_last && loss.is_some_and(|loss| loss != Loss::Huber) {
                0.0
            } else {
                self.estimate_noise(&reduced, &leverages)
            };
            let same_noise = if is_last && !has_groups {
                SAME_NOISE
            } else {
                ROUGH_NOISE
            };
            let is_settled = moved < SAME_POSE && noise < same_noise;
            let left_out = is_settled && !keeps && self.leave_out_gross(&reduced, &leverages);
            let is_done = is_settled && is_last && !left_out;
            if rounds == ROUNDS || (is_done && is_exact) {
                return Ok(Settled {
                    solution,
                    iterations,
                    reduced,
                    leverages,
                    has_converged: is_done && is_exact,
                });
            }
            if is_settled && !left_out {
                self.loss = loss;
            }
            is_exact = !is_estimated || is_done;
            self.rebuild(&mut values)?;
        }
    }

    fn solved(
        &self,
        values: &[f64],
        cost_tolerance: f64,
        options: &calibration::Options,
    ) -> Result<Solution, Error> {
        let solver = tau_solver::Options {
            cost_tolerance: options.solver.cost_tolerance.max(cost_tolerance),
            ..options.solver.clone()
        };
        let failed = |error: tau_solver::Error| self.not_converged(unsolved(&error));
        solve(&self.problem(values), &solver).map_err(failed)
    }

    /// Comes near from afar, and returns iterations. Closures that are exact are taken for as noisy as what was measured:
    /// poses that they hold to much less can follow the machine along their curves in tiny steps alone, hundreds of them
    /// where tolerances are wide; from where this ends, a few are left (a quadratic penalty that grows: J. Nocedal and S.
    /// J. Wright, *Numerical Optimization*, 2006, section 17.1).
    fn approach(
        &mut self,
        values: &mut Vec<f64>,
        options: &calibration::Options,
    ) -> Result<usize, Error> {
        let heights = self.heights();
        let kinds = self.assembly.kinds.clone();
        let exact = kinds.iter().position(Kind::is_exact);
        // A sketch has several starts, each soon given up, in place of a long way from one.
        if self.has_others && exact.is_none() && heights.is_empty() {
            return Ok(0);
        }
        if let Some(exact) = exact {
            self.assembly.kinds[exact].sigma /= CLOSURE_SHARE;
        }
        let came_near = self
            .follow_from_afar(values, options)
            .and_then(|iterations| Ok((iterations, self.solved(values, ROUGH_COST, options)?)));
        self.assembly.kinds = kinds;
        let (iterations, solution) = came_near?;
        values.clone_from(&solution.parameters);
        self.rebuild(values)?;
        if !heights.is_empty() {
            self.lay_in_plane(&heights, values);
        }
        Ok(iterations + solution.iterations)
    }

    /// Follows the minimum from noise as large as the misfit of the start down to the stated one, and returns iterations. Of
    /// a start hundreds of standard deviations off, derivatives miss dozens: at the stated noise, steps would follow these
    /// against the tolerances, and some end in another minimum (E. L. Allgower and K. Georg, *Numerical Continuation
    /// Methods*, 1990).
    fn follow_from_afar(
        &mut self,
        values: &mut Vec<f64>,
        options: &calibration::Options,
    ) -> Result<usize, Error> {
        let stated = self.assembly.kinds.clone();
        let reduced = self.elimination(values).reduce();
        let left = reduced.rows().saturating_sub(reduced.spent).max(1) as f64;
        let residuals = reduced.residuals.iter().flatten();
        let squares: f64 = residuals.map(|residual| residual * residual).sum();
        let mut times = (squares / left).sqrt();
        let mut iterations = 0;
        while times > 1.0 {
            for (kind, stated) in self.assembly.kinds.iter_mut().zip(&stated) {
                kind.sigma = times * stated.sigma;
            }
            let solution = self.solved(values, STAGE_COST, options)?;
            iterations += solution.iterations;
            // Squares, those of the tolerances among them, are expected to be as many as the rows that poses leave. Where
            // parameters take up little of the misfit that falls slowly: noise is halved at least.
            times *= (2.0 * solution.cost / left).sqrt().min(0.5);
            values.clone_from(&solution.parameters);
            self.revisit(values);
        }
        self.assembly.kinds = stated;
        Ok(iterations)
    }

    /// Indices of the heights of balls beside a plate that moves in the plane z = 0.
    fn heights(&self) -> Vec<usize> {
        let is_in_plane = !self.assembly.free.contains(&2);
        let objects = self.assembly.objects.iter();
        let balls = objects.filter(|object| is_in_plane && object.kind == ObjectKind::Ball);
        balls.map(|ball| self.used.len() + ball.first + 2).collect()
    }

    /// Lays balls into the plane whose height is not told from none. Distances depend on its square, which noise may make
    /// negative: a fit would go on towards the plane without an end. Where nothing is stated of it, it stays there.
    fn lay_in_plane(&self, heights: &[usize], values: &mut [f64]) {
        let reduced = self.elimination(values).reduce();
        let covariance = self.determined(&reduced.triangle);
        for &height in heights {
            let (at, sigma) = (values[height], covariance[(height, height)].sqrt());
            // The square's own standard deviation is 2·at·sigma.
            if at * at < TOLD * 2.0 * at.abs() * sigma {
                values[height] = 0.0;
            }
        }
    }
}
