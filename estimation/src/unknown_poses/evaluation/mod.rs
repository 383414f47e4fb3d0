//! Measurements of a machine whose parameters are those of a robot file.
//!
//! Parameters are held; poses, places and noise that the file leaves open follow the measurements. What these leave of
//! the residuals is compared with what noise and the covariance of the parameters make them (see [`known`]). Noise that is
//! to be estimated must not be that of parameters which have changed, so it follows from what is left of the residuals
//! whatever the parameters, where that is something.

mod known;
mod verdict;

use serde::Serialize;
use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector};
use tau_codes::fit;
use tau_kinematics::Machine;
use tau_robot::input_error::InputError;
use tau_solver::solve;

use super::assembly::Chosen;
use super::elimination::{Elimination, Reduced};
use super::fit::Fit;
use super::predicted::{HeldOutKind, predicted};
use super::rows::{ABSORBED, CLOSURES, Kind, RowPlace, Rows, noise_of_rows};
use super::tracker::of_true_poses;
use super::{GrossRow, ROUNDS, RowDivision, SAME_NOISE, SAME_POSE};
use crate::calibration::{self, EXACT_COST};
use crate::machine::error::{ended, unsolved};
use crate::machine::{Error, Prepared};
use crate::numerics::order::largest_first;
use crate::problem::POSE_UNKNOWNS;
use crate::setup::Setup;
use crate::trust::{Mistake, Verdict};
use crate::uncertainty::Uncertainty;
use crate::weighing::{Loss, Treatment};
pub(super) use known::Known;
use known::{Found, ROUNDING, Sum};

/// Names of the unknowns of a pose.
const COORDINATES: [&str; POSE_UNKNOWNS] = ["x", "y", "z", "about x", "about y", "about z"];

/// Rows of a folder that are judged.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct JudgedRows {
    /// Numbers of the poses whose rows are.
    pub poses: BTreeSet<u32>,
    /// Lines of `distances.csv` that are.
    pub distances: BTreeSet<usize>,
    /// True if all of them calibrated the parameters, so that what is left is the residuals of that fit.
    pub are_fitted: bool,
}

impl JudgedRows {
    /// The division by which they alone calibrate.
    pub fn division(&self) -> RowDivision {
        RowDivision {
            calibration: self.poses.clone(),
            distances: self.distances.clone(),
            ..RowDivision::default()
        }
    }
}

/// A residual with the parameters of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RowError {
    /// Its place; `drive` is the index of the link where it is one of a link's length.
    pub place: RowPlace,
    /// Index of its kind.
    pub kind: usize,
    /// Coordinate, where a row has several.
    pub coordinate: Option<&'static str>,
    /// The machine's value less the measured one, in the unit of the kind.
    pub error: f64,
    /// The same as a length (m), where it is one or what drives that turn make of it.
    pub error_m: Option<f64>,
    /// Share of it that poses and places do not follow.
    pub redundancy: f64,
    /// Standard deviation of that by noise and covariance of the parameters; `None` where poses and places follow the row,
    /// so that it can't be judged.
    pub expected: Option<f64>,
    /// Its variance by noise and covariance of the parameters, however little it is.
    variance: f64,
}

impl RowError {
    /// Error over its standard deviation.
    pub fn sigmas(&self) -> Option<f64> {
        self.expected.map(|expected| self.error.abs() / expected)
    }
}

/// Residuals of a kind with the parameters of the file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KindErrors {
    /// Index by which residuals name it.
    pub index: usize,
    /// The kind, with the noise that it was given.
    pub kind: Kind,
    /// Number of residuals.
    pub rows: usize,
    /// Root mean square of the noise of its rows, in the unit of the kind.
    pub noise: f64,
    /// Those less what poses and places follow.
    pub redundancy: f64,
    /// Root mean square of the residuals, in the unit of the kind.
    pub rms: f64,
    /// That to be expected by noise and covariance of the parameters.
    pub expected_rms: f64,
    /// Largest residual.
    pub max: f64,
}

impl KindErrors {
    /// False where poses and places follow the rows, so that they say nothing of the machine.
    pub fn is_judged(&self) -> bool {
        self.redundancy > (1.0 - ABSORBED) * self.rows as f64
    }
}

/// A place that was estimated.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PlaceEstimate {
    /// Name, such as `ball.x`.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
}

/// A parameter that the measurements would have elsewhere.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Moved {
    /// Full name.
    pub parameter: String,
    /// SI unit.
    pub unit: String,
    /// Change that takes away most squares where it alone changes; `None` where the measurements see too little of it.
    pub change: Option<f64>,
    /// These squares; zero without a change.
    #[serde(rename = "chi2_drop")]
    pub squares: f64,
    /// Change where all may, in standard deviations of what chance makes it.
    pub sigmas: f64,
}

/// Measurements of a machine whose parameters are held.
#[derive(Debug, Clone, PartialEq)]
pub struct HeldErrors {
    /// Number of poses.
    pub poses: usize,
    /// Number of residuals.
    pub rows: usize,
    /// Unknowns of poses that they pay for.
    pub spent: usize,
    /// Unknowns of places that they pay for.
    pub placed: usize,
    /// By kind of measurement.
    pub kinds: Vec<KindErrors>,
    /// Every residual, in the order of the files.
    pub errors: Vec<RowError>,
    /// Errors of what was measured, where poses follow from the drives alone.
    pub predicted: Vec<HeldOutKind>,
    /// Targets, surfaces and balls.
    pub places: Vec<PlaceEstimate>,
    /// Rows that were left out, worst first.
    pub gross: Vec<GrossRow>,
    /// Parameters, that which explains most alone first.
    pub moved: Vec<Moved>,
    /// Mistakes in the rows.
    pub mistakes: Vec<Mistake>,
    /// Names of the links, in the order of their closures.
    pub links: Vec<String>,
    /// True if the file says how well its parameters are known; otherwise they count as exact.
    pub knows_parameters: bool,
    /// True if the rows calibrated them.
    pub are_fitted: bool,
    /// Verdict on a fit within the tolerances, where parameters are those of a drawing: over tolerances that are many times the
    /// noise, residuals are not linear.
    pub within_tolerances: Option<Verdict>,
    all: Sum,
    rest: Sum,
    absorbed: f64,
    /// Mean length of the links (m).
    length_m: f64,
}

/// Errors of chosen measurements of a folder with the parameters of a robot file.
///
/// # Errors
/// [`Error::Input`] where columns, noise or values are missing, and where the measurements leave nothing to judge the
/// machine by; [`Error::Kinematics`] where it can't take a pose; [`Error::NotConverged`].
pub fn evaluate(
    setup: Setup<'_>,
    rows: &JudgedRows,
    options: &calibration::Options,
) -> Result<HeldErrors, Error> {
    let of = |is_loose| evaluated(setup, rows, options, is_loose);
    let (found, is_missed) = of(false)?;
    let mut found = if is_missed { of(true)?.0 } else { found };
    if setup.file.covariance.is_none() {
        let fitted = super::calibrate(setup, &rows.division(), options);
        found.within_tolerances = fitted.ok().map(|fitted| fitted.verdict());
    }
    Ok(found)
}

/// The same, and true if exact closures are missed that are not taken for loose.
fn evaluated(
    setup: Setup<'_>,
    rows: &JudgedRows,
    options: &calibration::Options,
    is_loose: bool,
) -> Result<(HeldErrors, bool), Error> {
    let Setup { robot, folder, .. } = setup;
    let file = &setup.file.completed(robot);
    let variant = &*of_true_poses(setup)?;
    let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let prepared = Prepared::from_file(robot, variant, file, Some(folder), &all)?;
    // A fit follows the noise of its own rows as it was weighed.
    let of_parameters = if rows.are_fitted {
        Uncertainty::of_prepared(&prepared, file)
    } else {
        Uncertainty::widened_of_prepared(&prepared, file)
    };
    let division = rows.division();
    let machine = prepared.machine.clone();
    let mut fit = Fit::from(&prepared, machine, file, folder, &division, false)?;
    if is_loose {
        fit.loosen();
    }
    fit.refuse_units(&fit.elimination(&fit.start).reduce())?;
    fit.refuse_treatment(options.treatment)?;
    let mistakes = fit.exchanged_distances();
    let known = Known::new(&fit, of_parameters.as_ref(), rows.are_fitted);
    let is_known = fit.take_noise_of_calibration(rows.are_fitted, options)?;
    let is_estimated = !is_known && fit.assembly.kinds.iter().any(Kind::is_estimated);
    let takes = Follows {
        noise: is_estimated,
        gross: !is_known && !options.treatment.keep_outliers,
    };
    let (values, reduced, mut found) = fit.judged_by(&known, &takes, options)?;
    fit.refuse_nothing_left(&reduced, &found)?;
    found.all.degrees -= fit.exact_left(&values, &found.after.covariance);
    found.rest.degrees -= fit.exact_left(&values, &found.free);
    let errors = fit.errors(&values, &found);
    let kinds = fit.kind_errors(&errors);
    let unknowns = fit.assembly.object_unknowns();
    let places = unknowns.zip(&values[fit.used.len()..]);
    let places = places.map(|(unknown, &value)| PlaceEstimate {
        name: unknown.name.clone(),
        unit: unknown.unit,
        value,
    });
    let (places, length_m) = (places.collect(), fit.mean_length_m());
    let shared = fit.shared();
    let is_missed = fit.misses_exact(&reduced);
    let held = HeldErrors {
        poses: fit.assembly.poses.len(),
        rows: reduced.rows(),
        spent: reduced.spent,
        placed: found.objects,
        moved: fit.moved(&known, &found),
        places,
        mistakes,
        links: (prepared.machine.closure_instances())
            .map(|closure| prepared.machine.closure_name(closure).to_owned())
            .collect(),
        knows_parameters: of_parameters.is_some(),
        are_fitted: rows.are_fitted,
        within_tolerances: None,
        all: found.all,
        rest: found.rest,
        absorbed: found.absorbed,
        length_m,
        predicted: fit.predicted(&prepared.machine, &values[..shared], &kinds)?,
        kinds,
        gross: fit.gross,
        errors,
    };
    Ok((held, is_missed))
}

/// Estimates beside poses and places that a judgement makes.
pub(super) struct Follows {
    pub(super) noise: bool,
    /// Gross rows are left out.
    pub(super) gross: bool,
}

impl Fit<'_> {
    /// Values at which poses, places, noise and the rows that take part follow the measurements, with parameters of which so
    /// much is known.
    pub(super) fn judged_by(
        &mut self,
        known: &Known,
        follows: &Follows,
        options: &calibration::Options,
    ) -> Result<(Vec<f64>, Reduced, Found), Error> {
        // As in a calibration: gross rows are sought before noise is estimated from the others.
        self.loss = (follows.noise && follows.gross).then_some(Loss::Huber);
        let mut values = self.start.clone();
        let mut rounds = 0;
        loop {
            rounds += 1;
            values = self.followed(&values, options)?;
            let moved = self.largest_move(&values);
            let reduced = self.elimination(&values).reduce();
            let found = known.found(self, &values, &reduced);
            let (after, leverages) = self.after(&values, &reduced, &found.after);
            let noise = if follows.noise {
                self.estimate_noise(&after, &leverages)
            } else {
                0.0
            };
            let is_settled = moved < SAME_POSE && noise < SAME_NOISE;
            let left_out = is_settled && follows.gross && self.leave_out_gross(&after, &leverages);
            let is_last = self.loss.is_none();
            if rounds == ROUNDS || (is_settled && is_last && !left_out) {
                return Ok((values, reduced, found));
            }
            if is_settled && !left_out {
                self.loss = None;
            }
            self.rebuild(&mut values)?;
        }
    }

    /// True if drives are more than the freedoms of the plate.
    pub(super) fn is_redundant(&self) -> bool {
        self.blocks[CLOSURES].kinds.len() > self.assembly.free.len()
    }

    /// True if exact drives contradict each other: redundant closures are further off than what stands for their noise.
    pub(super) fn misses_exact(&self, reduced: &Reduced) -> bool {
        let (kinds, residuals) = (&self.blocks[CLOSURES].kinds, &reduced.residuals[CLOSURES]);
        let squares: f64 = residuals.iter().map(|residual| residual * residual).sum();
        self.is_redundant()
            && self.assembly.kinds[kinds[0]].is_exact()
            && squares > residuals.len() as f64
    }

    /// Share of the residuals' expected squares that exact rows do not have: what stands for their noise, less the part that
    /// unknowns with a covariance take up.
    fn exact_left(&self, values: &[f64], covariance: &DMatrix<f64>) -> f64 {
        if !self.is_redundant() {
            // Poses follow all of them.
            return 0.0;
        }
        let leverages = self.elimination(values).leverages(covariance);
        let of_block = |(rows, leverages): (&Rows, &Vec<f64>)| -> f64 {
            let kinds = rows.kinds.iter().cycle();
            let exact = leverages.iter().zip(kinds);
            exact
                .filter(|&(_, &kind)| self.assembly.kinds[kind].is_exact())
                .map(|(leverage, _)| 1.0 - leverage)
                .sum()
        };
        self.blocks.iter().zip(&leverages).map(of_block).sum()
    }

    /// Takes noise that is to be estimated, and what rows are gross, from a calibration of these rows that begins at the
    /// parameters of the file, if it leaves something of each such kind or is the fit that gave the parameters, which has no
    /// other noise; true if it does.
    ///
    /// The residuals of a machine that has changed are no noise, and most of them are large, so that they are no matter of
    /// gross rows either: both are sought where parameters are free within the tolerances of the drawing, which are wide
    /// beside what the file knows, and hold what these rows leave open.
    fn take_noise_of_calibration(
        &mut self,
        are_fitted: bool,
        options: &calibration::Options,
    ) -> Result<bool, Error> {
        if !self.assembly.kinds.iter().any(Kind::is_estimated) {
            return Ok(false);
        }
        let (folder, file, division) = (self.folder, self.file, self.division);
        let machine = self.machine.clone();
        let mut free = Fit::from(&self.prepared, machine, file, folder, division, false)?;
        let options = calibration::Options {
            treatment: Treatment {
                loss: None,
                ..options.treatment
            },
            ..options.clone()
        };
        let settled = match free.settled(&options) {
            Ok(settled) => settled,
            // Whatever this machine is: it has no such calibration.
            Err(Error::NotConverged { .. }) => return Ok(false),
            Err(error) => return Err(error),
        };
        if !are_fitted && !free.can_estimate_noise(&settled.reduced, &settled.leverages) {
            return Ok(false);
        }
        self.assembly.kinds = free.assembly.kinds;
        self.left_out = free.left_out;
        self.gross = free.gross;
        let mut start = self.start.clone();
        self.rebuild(&mut start)?;
        Ok(true)
    }

    /// Values at which poses and objects follow the measurements, with held parameters: by least squares, whatever the
    /// loss, since to first order what parameters leave of the residuals does not depend on where the poses are.
    fn followed(&self, values: &[f64], options: &calibration::Options) -> Result<Vec<f64>, Error> {
        let mut problem = self.problem(values);
        for parameter in &mut problem.parameters[..self.used.len()] {
            *parameter = parameter.clone().fixed();
        }
        let blocks = problem.blocks.into_iter();
        problem.blocks = (blocks.map(|block| block.with_loss(tau_solver::Loss::Squared))).collect();
        // Poses are small moves from their bases: no step is small beside them.
        let solver = tau_solver::Options {
            cost_tolerance: options.solver.cost_tolerance.max(EXACT_COST),
            ..options.solver.clone()
        };
        let solution = solve(&problem, &solver);
        let solution = solution.map_err(|error| self.not_converged(unsolved(&error)))?;
        if !solution.converged() || solution.parameters.iter().any(|value| !value.is_finite()) {
            return Err(self.not_converged(ended(solution.termination)));
        }
        Ok(solution.parameters)
    }

    /// Residuals after a change of the shared unknowns, and the shares that it absorbs.
    fn after(
        &self,
        values: &[f64],
        reduced: &Reduced,
        moved: &known::Moved,
    ) -> (Reduced, Vec<Vec<f64>>) {
        let elimination = self.elimination(values);
        let after = Reduced {
            residuals: elimination.residuals_after(&moved.change),
            triangle: reduced.triangle.clone(),
            projected: reduced.projected.clone(),
            counts: reduced.counts.clone(),
            spent: reduced.spent,
        };
        let leverages = elimination.leverages(&moved.covariance);
        (after, leverages)
    }

    /// True if something is left of the residuals of each kind whose noise is to be estimated.
    fn can_estimate_noise(&self, reduced: &Reduced, leverages: &[Vec<f64>]) -> bool {
        let fits = self.kind_fits(reduced, leverages);
        let estimated = fits
            .iter()
            .filter(|fit| fit.kind.is_estimated() && fit.rows > 0);
        estimated
            .into_iter()
            .all(|fit| fit.residual_over_noise().is_some())
    }

    /// Refuses measurements that poses and places follow, whatever the machine.
    fn refuse_nothing_left(&self, reduced: &Reduced, found: &Found) -> Result<(), Error> {
        let (rows, spent, placed) = (reduced.rows(), reduced.spent, found.objects);
        if rows > spent + placed {
            return Ok(());
        }
        let poses = self.assembly.poses.len();
        let places = if placed > 0 {
            format!(" and {placed} of places")
        } else {
            String::new()
        };
        let message = format!(
            "{rows} residuals of {poses} poses for {spent} unknowns of these{places}: they fit any machine"
        );
        let error = InputError::whole(fit::FITS_ANYTHING, &self.folder.name, message);
        Err(error
            .help("measure more at each pose, or more poses from the same place")
            .into())
    }

    fn errors(&self, values: &[f64], found: &Found) -> Vec<RowError> {
        let elimination = self.elimination(values);
        let residuals = elimination.residuals_after(&DVector::zeros(self.shared()));
        let absorbed = elimination.leverages(&found.held);
        let by_poses = elimination.leverages(&found.followed);
        let mut errors = vec![];
        for (block, rows) in self.blocks.iter().enumerate() {
            if !self.can_be_gross(block) && self.assembly.kinds[rows.kinds[0]].is_exact() {
                continue;
            }
            let each = rows.kinds.len();
            for (k, &weight) in rows.weights.iter().enumerate() {
                if weight == 0.0 {
                    continue;
                }
                let kind = rows.kinds[k % each];
                // Weights of links' closures are their slopes, those of others their own noise.
                let noise =
                    self.assembly.kinds[kind].sigma / if block == CLOSURES { 1.0 } else { weight };
                let is_judged = 1.0 - by_poses[block][k] > 1.0 - ABSORBED;
                let variance = (1.0 - absorbed[block][k]).max(0.0);
                let error = residuals[block][k] * noise;
                errors.push(RowError {
                    place: RowPlace {
                        drive: (block == CLOSURES).then_some(k % each),
                        ..rows.places[k / each]
                    },
                    kind,
                    coordinate: (block != CLOSURES && each > 1).then(|| COORDINATES[k % each]),
                    error,
                    error_m: (self.assembly.kinds[kind].unit_m).map(|unit_m| error * unit_m),
                    redundancy: (1.0 - by_poses[block][k]).max(0.0),
                    expected: is_judged.then(|| noise * variance.sqrt()),
                    variance: noise * noise * variance,
                });
            }
        }
        errors
    }

    fn kind_errors(&self, errors: &[RowError]) -> Vec<KindErrors> {
        let noise = noise_of_rows(&self.assembly.kinds, &self.blocks);
        let kinds = self.assembly.kinds.iter().enumerate();
        let of_kind = |(index, &kind): (usize, &Kind)| {
            let own: Vec<&RowError> = errors.iter().filter(|error| error.kind == index).collect();
            let mean = |of: &dyn Fn(&RowError) -> f64| {
                own.iter().map(|error| of(error)).sum::<f64>() / own.len().max(1) as f64
            };
            (!own.is_empty()).then(|| KindErrors {
                index,
                kind,
                rows: own.len(),
                noise: noise[index],
                redundancy: own.iter().map(|error| error.redundancy).sum(),
                rms: mean(&|error| error.error.powi(2)).sqrt(),
                expected_rms: mean(&|error| error.variance).sqrt(),
                max: own
                    .iter()
                    .fold(0.0, |most, error| f64::max(most, error.error.abs())),
            })
        };
        kinds.filter_map(of_kind).collect()
    }

    /// Parameters that the measurements would have elsewhere, that which explains most first.
    fn moved(&self, known: &Known, found: &Found) -> Vec<Moved> {
        let variances = known.variances();
        let parameters = &self.machine.variant.parameters;
        let of = |(k, &index): (usize, &usize)| {
            let (change, squares) = found.alone[k].unzip();
            let by_chance = variances[k] - found.after.covariance[(k, k)];
            Moved {
                parameter: parameters[index].name.clone(),
                unit: parameters[index].unit.clone(),
                change,
                squares: squares.unwrap_or(0.0),
                sigmas: if by_chance > ROUNDING * variances[k] {
                    found.after.change[k] / by_chance.sqrt()
                } else {
                    0.0
                },
            }
        };
        let mut moved: Vec<Moved> = self.used.iter().enumerate().map(of).collect();
        largest_first(&mut moved, |own| own.squares);
        moved
    }

    /// Errors of what was measured, where poses follow from the drives alone.
    fn predicted(
        &mut self,
        machine: &Machine,
        shared: &[f64],
        kinds: &[KindErrors],
    ) -> Result<Vec<HeldOutKind>, Error> {
        self.assembly.place_by_drives(machine)?;
        let chosen = Chosen {
            poses: &self.division.calibration,
            distances: &self.division.distances,
            left_out: &self.left_out,
        };
        let blocks = self.assembly.rows(machine, &self.used, &chosen)?;
        let own = vec![0.0; POSE_UNKNOWNS * self.assembly.poses.len()];
        let elimination = Elimination::new(&blocks, &self.assembly, shared, &own);
        let mut found = predicted(&blocks, &self.assembly.kinds, &elimination.reduce());
        // Errors of rows that a place follows are none of the machine.
        found.retain(|own| {
            let mut kinds = kinds.iter();
            kinds.any(|kind| kind.kind.of.file() == own.file && kind.is_judged())
        });
        Ok(found)
    }

    pub(in super::super) fn mean_length_m(&self) -> f64 {
        self.assembly.mean_length_m(&self.machine)
    }
}
