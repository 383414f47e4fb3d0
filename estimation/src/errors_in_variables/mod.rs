//! Calibration with errors in variables: the true pose behind each measured one is unknown, too.
//!
//! The ordinary [calibration](crate::calibration) asks how far each closure is from zero at the measured
//! pose, as if closures had errors of their own. In truth position and rotation were measured with noise,
//! which the six closures of a pose share, and at the true pose all of them hold. Here every pose's
//! position and rotation are unknowns, seen through the tracker with its noise; all sets are fitted in one
//! problem, sets 2 and 3 with their frames and the mountings of their targets. The solver eliminates the
//! poses one by one (Schur complement), so that time and memory grow linearly with their number.

mod all_sets;

use statrs::distribution::{ChiSquared, ContinuousCDF};
use tau_codegen::language;
use tau_robot::input_error::InputError;
use tau_robot::measurements::{Folder, TcpPose};
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::RobotFile;
use tau_solver::{Options, identifiability, solve};

pub use crate::problem::Component;
pub use all_sets::AllSets;

use crate::calibration::{self, Calibration, Error, Fitted, Prepared};
use crate::joint::variant::free_turning;
use crate::numerics::triangle;
use crate::problem::{CLOSURE_SHARE, Part};
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::samples::plates::place_plates;
use crate::trust;
use all_sets::Misfit;

/// A group whose misfit noise as stated would exceed with less than this probability has more noise.
const SIGNIFICANT: f64 = 1e-3;
/// Changes of the estimated noise below this share are none.
const SAME_NOISE: f64 = 0.02;
const NOISE_ROUNDS: usize = 8;
/// Change of the cost, as a share, that is no progress while the noise is being estimated.
const ROUGH: f64 = 1e-4;
/// Change of the cost that is no progress in the end: where something is missing, mountings and turning
/// rates creep along a valley that means nothing.
const CONVERGED: f64 = 1e-3;

/// A calibration with errors in variables, beside the ordinary one.
#[derive(Clone)]
pub struct ErrorsInVariables {
    /// The result.
    pub calibration: Calibration,
    /// The fit of set 1 by closures that it started from.
    pub closure_fit: Calibration,
    /// Fit of each group of measurements.
    pub groups: Vec<GroupFit>,
    /// Standard deviation of a link's length at the true pose that was assumed (m).
    pub closure_m: f64,
    /// Unknowns in all: shared ones, and six a pose.
    pub unknowns: usize,
}

/// Fit of a group of measurements.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GroupFit {
    /// The measurements.
    pub group: Component,
    /// Number of residuals.
    pub residuals: usize,
    /// Their root mean square, in units of the stated noise.
    pub rms: f64,
    /// Factor by which the noise was taken to exceed the stated one: 1 unless the misfit is significantly
    /// larger.
    pub noise_factor: f64,
}

/// Fits a variant to all sets of a folder; `poses` are those of set 1 that take part, by index, but for outliers.
///
/// If a group of measurements is met significantly worse than its stated noise (the model lacks
/// something), its noise is estimated instead, so that it neither overrides the others nor pretends to
/// standard deviations that it can't have.
///
/// # Errors
/// Those of [`calibration::calibrate`], and carts of sets 2 and 3 that are numbered wrongly.
pub fn calibrate(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: &Folder,
    poses: &[usize],
    options: &calibration::Options,
) -> Result<ErrorsInVariables, Error> {
    let closure_fit = calibration::calibrate(robot, variant, file, folder, poses, options)?;
    let weighing = closure_fit.weighing.clone();
    let poses: &[usize] = &weighing.taking_part(poses).collect::<Vec<_>>();
    let file = &file.completed(robot);
    let measured: Vec<&TcpPose> = poses.iter().map(|&pose| &folder.tcp_poses[pose]).collect();
    let sets = AllSets::of(robot, variant, file, folder, poses, &closure_fit)?;
    let not_converged = |why: String| Error::NotConverged {
        variant: variant.name.clone(),
        why,
    };
    let failed = |error: tau_solver::Error| not_converged(error.to_string());
    // Half the number of residuals is the cost to be expected.
    let fine = CONVERGED / (0.5 * sets.count() as f64).max(1.0);

    let mut factors = [1.0; 4];
    let mut values = sets.start(&closure_fit);
    let (mut iterations, mut rounds, mut tolerance) = (0, 0, ROUGH.max(fine));
    let (solution, misfits) = loop {
        let solver = Options {
            cost_tolerance: options.solver.cost_tolerance.max(tolerance),
            ..options.solver.clone()
        };
        let solution = solve(&sets.problem(&values, factors), &solver).map_err(failed)?;
        iterations += solution.iterations;
        if !solution.converged() || solution.parameters.iter().any(|value| !value.is_finite()) {
            return Err(not_converged(solution.termination.to_string()));
        }
        values = sets.values(&solution);
        let misfits = sets.misfits(&solution);
        if tolerance <= fine {
            break (solution, misfits);
        }
        let next = noise_factors(&misfits, sets.shared());
        let same = |(old, new): (&f64, &f64)| (new / old - 1.0).abs() <= SAME_NOISE;
        rounds += 1;
        if rounds == NOISE_ROUNDS || factors.iter().zip(&next).all(same) {
            tolerance = fine;
        } else {
            factors = next;
        }
    };

    let problem = sets.problem(&values, factors);
    let covariance = tau_solver::covariance(&problem, &solution.parameters).map_err(failed)?;
    let prepared = Prepared::new(robot, variant, file, Some(folder), poses)?;
    let places = sets.places_in(variant);
    let used: Vec<usize> = closure_fit.used.clone();
    let place = |index: usize| places[used[index]];
    let covariance: Vec<Vec<f64>> = (0..used.len())
        .map(|i| {
            let entry = |j| Some(covariance.covariance(place(i)?, place(j)?));
            (0..used.len()).map(|j| entry(j).unwrap_or(0.0)).collect()
        })
        .collect();
    let fitted = Fitted {
        values: places
            .iter()
            .zip(&prepared.machine.values)
            .map(|(place, &nominal)| place.map_or(nominal, |place| solution.parameters[place]))
            .collect(),
        factor: triangle::lower(&covariance),
        covariance,
        undetermined: {
            let machine = sets.machine.with_values(values.clone());
            let whitened = {
                let samples = Sample::all(robot, folder, poses, &Frames::default());
                let whitened = Part::whitened(&machine, &samples, file.noise)?;
                whitened.numbered(&sets.residuals.used)
            };
            let marginal = sets.marginal(&whitened, &values, factors);
            let at: Vec<f64> = marginal.parameters.iter().map(|p| p.start).collect();
            let found = identifiability(&marginal, &at).map_err(failed)?;
            let name = |index: usize| marginal.parameters[index].name.clone();
            let described = |name: &String| closure_fit.parameters.iter().any(|p| p.name == *name);
            let mut combinations = calibration::combinations(&found, name);
            // Where trackers stood and how targets were mounted is nobody's question.
            combinations.retain(|c| c.terms.first().is_some_and(|(name, _)| described(name)));
            combinations
        },
        used,
        cost: solution.cost,
        iterations,
        termination: solution.termination.to_string(),
    };
    Ok(ErrorsInVariables {
        calibration: Calibration {
            weighing,
            ..calibration::finish(&prepared, file, &measured, fitted)?
        },
        closure_fit,
        groups: Component::ALL
            .into_iter()
            .zip(misfits)
            .zip(factors)
            .filter(|((_, misfit), _)| misfit.count > 0)
            .map(|((group, misfit), noise_factor)| GroupFit {
                group,
                residuals: misfit.count,
                rms: (misfit.squares / misfit.count as f64).sqrt(),
                noise_factor,
            })
            .collect(),
        closure_m: sets.closure_m(),
        unknowns: solution.parameters.len(),
    })
}

impl AllSets {
    /// All sets of a folder, registered by a fit of set 1.
    ///
    /// # Errors
    /// Columns that the variant needs are missing; carts are numbered wrongly.
    pub fn of(
        robot: &Robot,
        variant: &Variant,
        file: &RobotFile,
        folder: &Folder,
        poses: &[usize],
        closure_fit: &Calibration,
    ) -> Result<Self, Error> {
        trust::refuse(&closure_fit.machine, file, folder, poses)?;
        let frames = Frames::of(&closure_fit.machine, file, folder);
        let mut samples = Sample::all(robot, folder, poses, &frames);
        let with_carts = samples.len() > poses.len();
        if with_carts {
            place_plates(&closure_fit.machine, file, &mut samples);
        }
        let variant = if with_carts {
            carts_turning_freely(robot, variant)?
        } else {
            variant.clone()
        };
        let prepared = Prepared::new(robot, &variant, file, Some(folder), poses)?;
        let closure_m = CLOSURE_SHARE * file.noise.position_m;
        Self::new(prepared, &samples, file.noise, closure_m)
    }

    /// Values to start from: those that fit set 1, nominal ones elsewhere.
    pub fn start(&self, closure_fit: &Calibration) -> Vec<f64> {
        let mut values = self.machine.values.clone();
        for estimate in &closure_fit.parameters {
            let mut parameters = self.machine.variant.parameters.iter();
            if let Some(index) = parameters.position(|p| p.name == estimate.name) {
                values[index] = estimate.value;
            }
        }
        values
    }

    /// For each parameter of the variant as described, its place among the unknowns.
    fn places_in(&self, variant: &Variant) -> Vec<Option<usize>> {
        let own = &self.machine.variant.parameters;
        let place = |name: &str| {
            let index = own.iter().position(|parameter| parameter.name == name)?;
            self.residuals.used.binary_search(&index).ok()
        };
        let described = variant.parameters.iter();
        described.map(|parameter| place(&parameter.name)).collect()
    }
}

/// The variant with carts that sets 2 and 3 may see turn in proportion to their commands, as discovery
/// fits it.
fn carts_turning_freely(robot: &Robot, variant: &Variant) -> Result<Variant, Error> {
    let model = language::check_text(&robot.description)
        .map_err(|errors| InputError::whole(&robot.name, errors.to_string()))?;
    let index = model.variants.iter().position(|v| v.name == variant.name);
    Ok(index.map_or_else(
        || variant.clone(),
        |index| free_turning(&model, index, Some(variant)),
    ))
}

/// Noise of each group over the stated one. A group pays for its share of the shared unknowns; whether it
/// has more noise at all is judged as if priors settled them all, so as not to cry wolf.
fn noise_factors(misfits: &[Misfit; 4], shared: usize) -> [f64; 4] {
    let count: usize = misfits.iter().map(|misfit| misfit.count).sum();
    let left = 1.0 - (shared as f64 / count.max(1) as f64).min(0.9);
    misfits.map(|misfit| {
        let degrees = misfit.count as f64;
        let chance = ChiSquared::new(degrees).map_or(1.0, |chi2| chi2.sf(misfit.squares));
        if chance < SIGNIFICANT {
            (misfit.squares / (degrees * left)).sqrt()
        } else {
            1.0
        }
    })
}
