//! Calibration from any measurements: the true pose behind every sample is unknown.
//!
//! What drives read and what was measured of the plate are residuals of the true pose: each link's closure, with the
//! noise that the drives give it; positions, heights, distances, each with its own. The solver eliminates the poses
//! one by one (Schur complement), so that time and memory grow linearly with their number; distances couple two.
//! Where poses are measured fully and drives are exact, this is to first order the fit of the closures, whitened.

mod assembly;
mod coupled;
mod elimination;
mod gauge;
mod heldout;
mod quantity;
mod rows;
#[cfg(test)]
mod tests;
mod verdict;

use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector};
use tau_kinematics::Machine;
use tau_robot::input_error::InputError;
use tau_robot::measurements::{DISTANCES, Folder, Split};
use tau_robot::robot::{Robot, Variant};
use tau_robot::robot_file::{RobotFile, Value};
use tau_solver::{Parameter, Problem, solve};

use crate::calibration::{
    self, Calibration, Combination, Error, Fitted, Nominal, Prepared, combinations,
};
use crate::numerics::distribution::{chi2_quantile_above, chi2_survival};
use crate::numerics::triangle;
use crate::problem::{self, POSE_UNKNOWNS};
use crate::weighing::Loss;
use assembly::{Assembly, Chosen};
use elimination::{Elimination, Reduced};
use gauge::{Shared, scaled};
use rows::Rows;

pub use assembly::Object;
pub use gauge::Freedom;
pub use heldout::{HeldOut, HeldOutKind};
pub use rows::{Kind, RowPlace};

/// Rounds of fit, weights and noise.
const ROUNDS: usize = 30;
/// Changes of a standard deviation below this share are none.
const SAME_NOISE: f64 = 1e-3;
/// Moves of a base (m, rad) below which the weights of closures stay as they are.
const SAME_POSE: f64 = 1e-4;
/// Chance that the largest of all residuals is taken for a gross one though it is none.
const GROSS_LEVEL: f64 = 0.01;
/// Share of all rows above which those far off are no gross ones but part of what is measured.
const MOST_GROSS: f64 = 0.1;
/// Chance below which residuals are larger than their noise.
const SIGNIFICANT: f64 = 1e-3;
/// Share of a kind's rows that pay for the fit, above which nothing of them is left to tell their noise.
const ABSORBED: f64 = 0.95;

/// The rows of a folder that calibrate and those that are held out.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RowDivision {
    /// Numbers of the poses whose rows calibrate.
    pub calibration: BTreeSet<u32>,
    /// Numbers of those whose rows validate.
    pub validation: BTreeSet<u32>,
    /// Lines of `distances.csv` that calibrate.
    pub distances: BTreeSet<usize>,
    /// Lines that validate.
    pub held_out_distances: BTreeSet<usize>,
}

impl RowDivision {
    /// Divides poses by their commands, as poses of set 1 are, and distances row by row.
    pub fn of(folder: &Folder, split: Split) -> Self {
        let poses = folder.plate_poses();
        let indices: Vec<usize> = (0..poses.len()).collect();
        let own = split.divide_readings(&indices, poses.iter().map(|pose| pose.1));
        let numbers = |indices: &[usize]| indices.iter().map(|&index| poses[index].0).collect();
        let rows: Vec<usize> = (0..folder.distances.len()).collect();
        let keys: Vec<[f64; 2]> = (folder.distances.iter())
            .map(|row| [f64::from(row.poses[0]), f64::from(row.poses[1])])
            .collect();
        let of_rows = split.divide_readings(&rows, keys.iter().map(<[f64; 2]>::as_slice));
        let lines = |indices: &[usize]| {
            indices
                .iter()
                .map(|&index| folder.distances[index].line)
                .collect()
        };
        Self {
            calibration: numbers(&own.calibration),
            validation: numbers(&own.validation),
            distances: lines(&of_rows.calibration),
            held_out_distances: lines(&of_rows.validation),
        }
    }
}

/// A kind of residual, and how it is met.
#[derive(Debug, Clone, PartialEq)]
pub struct KindFit {
    /// The kind, with the noise that it was given.
    pub kind: Kind,
    /// Number of residuals.
    pub rows: usize,
    /// Residuals less what the fit absorbs of them.
    pub redundancy: f64,
    /// Sum of their squares over the noise.
    pub squares: f64,
}

impl KindFit {
    /// Root mean square of the residuals over the noise, by what the fit leaves of them; `None` where it leaves nothing.
    pub fn residual_over_noise(&self) -> Option<f64> {
        let left = self.redundancy > (1.0 - ABSORBED) * self.rows as f64;
        left.then(|| (self.squares / self.redundancy).sqrt())
    }
}

/// A row far off the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrossRow {
    /// Its place.
    pub place: RowPlace,
    /// Its residual over the noise that the fit leaves of it.
    pub sigmas: f64,
}

/// An unknown that is no parameter of the machine.
#[derive(Debug, Clone, PartialEq)]
pub struct ObjectEstimate {
    /// Name, such as `ball.x`.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// Ranks, and what is open.
#[derive(Debug, Clone, PartialEq)]
pub struct Rank {
    /// Number of residuals.
    pub rows: usize,
    /// Unknowns of poses that they pay for.
    pub spent: usize,
    /// Number of poses.
    pub poses: usize,
    /// Number of shared unknowns.
    pub unknowns: usize,
    /// Combinations of these that the data know better than the tolerances.
    pub determined: usize,
    /// Combinations that no residual sees, in words.
    pub open: Vec<Freedom>,
    /// True if a mirror image of the machine would fit as well.
    pub has_mirror_image: bool,
}

impl Rank {
    /// Residuals that are left for the shared unknowns once poses have their own.
    pub fn net_rows(&self) -> usize {
        self.rows - self.spent
    }

    /// True if every residual is needed to determine something, so that none can be told to be wrong.
    pub fn is_saturated(&self) -> bool {
        self.net_rows() <= self.determined
    }

    /// Number of poses, measured like these, from which on residuals are left to judge the fit by.
    pub fn poses_needed(&self) -> usize {
        let each = (self.net_rows() as f64 / self.poses.max(1) as f64).max(1e-9);
        let factors = self.unknowns - self.open.len().min(self.unknowns);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small count"
        )]
        let needed = ((factors + 1) as f64 / each).ceil() as usize;
        needed
    }

    /// Why a calibration would mean nothing, if so.
    pub fn why_not(&self) -> Option<String> {
        let (net, poses) = (self.net_rows(), self.poses);
        if self.is_saturated() {
            return Some(format!(
                "{net} residuals of {poses} poses determine as many factors: the fit would repeat its input, and no wrong \
                 measurement could be told"
            ));
        }
        let scale = self.open.iter().find(|freedom| freedom.is_scale)?;
        Some(format!(
            "nothing determines the {}: a free scale makes a machine of any size fit, the smaller the better",
            scale.words
        ))
    }
}

/// A calibration from poses that are unknown.
#[derive(Clone)]
pub struct UnknownPoses {
    /// The machine, with parameters, covariance and file.
    pub calibration: Calibration,
    /// Targets, surfaces and balls.
    pub objects: Vec<ObjectEstimate>,
    /// Kinds of residuals.
    pub kinds: Vec<KindFit>,
    /// What the measurements determine.
    pub rank: Rank,
    /// Rows that were left out, worst first.
    pub gross: Vec<GrossRow>,
    /// Fit of rows that took no part; `None` where all did.
    pub held_out: Option<HeldOut>,
    /// Number of poses that took part.
    pub poses: usize,
    /// Sum of squared residuals over their noise, and what is left of their number.
    pub chi2: f64,
    /// Residuals less what the fit absorbs.
    pub dof: f64,
    /// Loss of the fit, if it is not least squares.
    pub loss: Option<Loss>,
    /// Lowest and highest value of each command among the poses (m or rad).
    pub commands_m: Vec<[f64; 2]>,
    /// Lowest and highest coordinate of the TCP along each axis (m).
    pub position_m: Vec<[f64; 2]>,
}

impl UnknownPoses {
    /// √(chi2/dof).
    pub fn residual_over_noise(&self) -> f64 {
        (self.chi2 / self.dof.max(1e-9)).sqrt()
    }

    /// True if residuals are no larger than the stated noise lets expect.
    pub fn is_consistent(&self) -> bool {
        chi2_survival(self.chi2, self.dof.max(1e-9)) > SIGNIFICANT
    }
}

/// What is known before a fit.
///
/// # Errors
/// As [`calibrate`], but for what only a fit can fail on.
pub fn rank(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: &Folder,
    division: &RowDivision,
) -> Result<Rank, Error> {
    let file = &file.completed(robot);
    let fit = Fit::new(robot, variant, file, folder, division)?;
    let reduced = fit.elimination(&fit.start).reduce();
    Ok(fit.rank(&reduced, &fit.machine))
}

/// Fits a variant to all measurements of the plate in a folder; `division` says which rows take part.
///
/// # Errors
/// [`Error::Input`] where columns, noise or values are missing, where every row is needed to determine the parameters,
/// and where a scale is free; [`Error::Kinematics`] where a pose can't be found from the nominal machine;
/// [`Error::NotConverged`].
pub fn calibrate(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: &Folder,
    division: &RowDivision,
    options: &calibration::Options,
) -> Result<UnknownPoses, Error> {
    let file = &file.completed(robot);
    let mut fit = Fit::new(robot, variant, file, folder, division)?;
    fit.refuse_units()?;
    let reduced = fit.elimination(&fit.start).reduce();
    let rank = fit.rank(&reduced, &fit.machine);
    fit.refuse_rank(&rank, options.free_scale)?;
    let mut values = fit.start.clone();
    let mut iterations = 0;
    let mut rounds = 0;
    let (solution, reduced, leverages) = loop {
        rounds += 1;
        let solution = {
            let problem = fit.problem(&values, options);
            let solver = tau_solver::Options {
                cost_tolerance: options.solver.cost_tolerance.max(1e-12),
                ..options.solver.clone()
            };
            let failed = |error: tau_solver::Error| fit.not_converged(error.to_string());
            let solution = solve(&problem, &solver).map_err(failed)?;
            if !solution.converged() || solution.parameters.iter().any(|value| !value.is_finite()) {
                return Err(fit.not_converged(solution.termination.to_string()));
            }
            solution
        };
        iterations += solution.iterations;
        values.clone_from(&solution.parameters);
        let moved = fit.largest_move(&values);
        let reduced = fit.elimination(&values).reduce();
        let covariance = fit.covariance(&reduced.triangle);
        let leverages = fit.elimination(&values).leverages(&covariance);
        let noise = fit.estimate_noise(&reduced, &leverages);
        let gross = options.treatment.loss.is_none()
            && !options.treatment.keep_outliers
            && fit.leave_out_gross(&reduced, &leverages);
        if rounds == ROUNDS || (moved < SAME_POSE && noise < SAME_NOISE && !gross) {
            break (solution, reduced, leverages);
        }
        fit.rebuild(&mut values)?;
    };
    let machine = fit.machine_at(&values);
    let rank = fit.rank(&reduced, &machine);
    let found = fit.finish(
        &values,
        (&reduced, &leverages),
        rank,
        (&solution, iterations),
    )?;
    Ok(UnknownPoses {
        loss: options.treatment.loss,
        ..found
    })
}

/// A calibration on its way.
struct Fit<'a> {
    folder: &'a Folder,
    file: &'a RobotFile,
    division: &'a RowDivision,
    prepared: Prepared,
    /// The variant at the values of the last round.
    machine: Machine,
    /// Indices in the variant of its parameters among the shared unknowns.
    used: Vec<usize>,
    priors: Vec<Nominal>,
    assembly: Assembly<'a>,
    blocks: Vec<Rows>,
    /// Shared unknowns, then those of the poses.
    start: Vec<f64>,
    left_out: BTreeSet<RowPlace>,
    gross: Vec<GrossRow>,
}

impl<'a> Fit<'a> {
    fn new(
        robot: &Robot,
        variant: &Variant,
        file: &'a RobotFile,
        folder: &'a Folder,
        division: &'a RowDivision,
    ) -> Result<Self, Error> {
        refuse_tracker_effects(variant, folder)?;
        let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        let prepared = Prepared::new(robot, variant, file, Some(folder), &all)?;
        let machine = prepared.machine.clone();
        let left_out = BTreeSet::new();
        let chosen = Chosen {
            poses: &division.calibration,
            distances: &division.distances,
            left_out: &left_out,
        };
        let assembly = Assembly::new(&machine, file, folder, &chosen)?;
        if assembly.poses.is_empty() {
            let message = "no pose of the plate is left to calibrate";
            return Err(InputError::whole(&folder.name, message).into());
        }
        let used = assembly.rows(&machine, &[], &chosen)?[0].shared.clone();
        let blocks = assembly.rows(&machine, &used, &chosen)?;
        let priors: Vec<Nominal> = used.iter().map(|&index| prepared.nominal[index]).collect();
        let mut start: Vec<f64> = used.iter().map(|&index| machine.values[index]).collect();
        start.extend(assembly.object_unknowns().map(|unknown| unknown.start));
        start.resize(start.len() + POSE_UNKNOWNS * assembly.poses.len(), 0.0);
        Ok(Self {
            folder,
            file,
            division,
            prepared,
            machine,
            used,
            priors,
            assembly,
            blocks,
            start,
            left_out,
            gross: vec![],
        })
    }

    /// Number of shared unknowns.
    fn shared(&self) -> usize {
        self.used.len() + self.assembly.object_unknowns().count()
    }

    fn not_converged(&self, why: String) -> Error {
        Error::NotConverged {
            variant: self.machine.variant.name.clone(),
            why,
        }
    }

    /// The shared unknowns as the solver takes them.
    fn shared_parameters(&self, values: &[f64]) -> Vec<Parameter> {
        let own = values.iter().copied().take(self.used.len());
        let mut parameters =
            problem::parameters(&self.machine.variant, &self.used, &self.priors, own);
        let others = values.iter().skip(self.used.len());
        parameters.extend(
            self.assembly
                .object_unknowns()
                .zip(others)
                .map(|(unknown, &value)| {
                    let parameter = Parameter::new(&unknown.name, value);
                    match unknown.prior {
                        Some((mean, sigma)) => parameter.with_prior(mean, sigma),
                        None => parameter,
                    }
                }),
        );
        parameters
    }

    fn problem(&self, values: &[f64], options: &calibration::Options) -> Problem<'_> {
        let shared = self.shared();
        let mut parameters = self.shared_parameters(values);
        let axes = ["x", "y", "z", "about x", "about y", "about z"];
        let own = &values[shared..];
        for (pose, own) in self
            .assembly
            .poses
            .iter()
            .zip(own.chunks_exact(POSE_UNKNOWNS))
        {
            for (coordinate, (axis, &value)) in axes.iter().zip(own).enumerate() {
                let parameter = Parameter::new(format!("pose {} {axis}", pose.number), value);
                parameters.push(if self.assembly.free.contains(&coordinate) {
                    parameter
                } else {
                    parameter.fixed()
                });
            }
        }
        // Links are no measurements that could be gross: their drives are.
        let loss = |index: usize| match options.treatment.loss {
            Some(loss) if index > 0 => loss.of_single_residuals(),
            _ => tau_solver::Loss::Squared,
        };
        let blocks = self.blocks.iter().enumerate();
        Problem {
            parameters,
            blocks: blocks
                .map(|(index, rows)| rows.block(shared, &self.assembly.kinds, loss(index)))
                .collect(),
        }
    }

    fn elimination<'b>(&'b self, values: &'b [f64]) -> Elimination<'b> {
        let (shared, own) = values.split_at(self.shared());
        Elimination {
            blocks: &self.blocks,
            kinds: &self.assembly.kinds,
            shared,
            own,
            free: self.assembly.free,
        }
    }

    /// Standard deviation of the prior of each shared unknown, or what stands for its size where it has none.
    fn scales(&self) -> Vec<f64> {
        let of_variant = self.priors.iter().map(|prior| {
            let tolerance = prior.tolerance.filter(|tolerance| *tolerance > 0.0);
            tolerance.unwrap_or_else(|| prior.value.abs().max(1.0))
        });
        let of_objects = self.assembly.object_unknowns();
        of_variant
            .chain(of_objects.map(|unknown| unknown.prior.map_or(1.0, |prior| prior.1)))
            .collect()
    }

    fn has_prior(&self) -> Vec<bool> {
        let of_variant = self.priors.iter();
        let of_variant =
            of_variant.map(|prior| prior.tolerance.is_some_and(|tolerance| tolerance > 0.0));
        let of_objects = self.assembly.object_unknowns();
        of_variant
            .chain(of_objects.map(|unknown| unknown.prior.is_some()))
            .collect()
    }

    /// Covariance of the shared unknowns, priors included; infinite variances where nothing determines them.
    fn covariance(&self, triangle: &DMatrix<f64>) -> DMatrix<f64> {
        let scales = self.scales();
        let width = scales.len();
        let priors = DMatrix::from_diagonal(&DVector::from_iterator(
            width,
            self.has_prior()
                .into_iter()
                .map(|has| f64::from(u8::from(has))),
        ));
        let all = elimination::stacked(&scaled(triangle, &scales), &[priors]);
        let svd = all.svd(false, true);
        let Some(v_t) = svd.v_t else {
            return DMatrix::from_element(width, width, f64::NAN);
        };
        let largest = svd.singular_values.max();
        let least = largest * f64::EPSILON * 8.0 * width as f64;
        let mut covariance = DMatrix::zeros(width, width);
        let mut lost = vec![false; width];
        for (k, &value) in svd.singular_values.iter().enumerate() {
            let row = v_t.row(k);
            if value > least {
                covariance += row.transpose() * row / (value * value);
            } else {
                for (lost, share) in lost.iter_mut().zip(row.iter()) {
                    *lost |= share.abs() > 1e-6;
                }
            }
        }
        for i in 0..width {
            for j in 0..width {
                covariance[(i, j)] *= scales[i] * scales[j];
            }
            if lost[i] {
                covariance[(i, i)] = f64::INFINITY;
            }
        }
        covariance
    }

    fn rank(&self, reduced: &Reduced, machine: &Machine) -> Rank {
        let scales = self.scales();
        let known = scaled(&reduced.triangle, &scales).singular_values();
        let shared = Shared {
            machine,
            used: &self.used,
            objects: &self.assembly.objects,
            values: &self.start[..self.shared()],
        };
        // All three coordinates of a point tell left from right.
        let has_all = |rows: &Rows| {
            let weights = rows.weights.chunks_exact(rows.kinds.len());
            weights
                .into_iter()
                .any(|own| own[..3].iter().all(|weight| *weight > 0.0))
        };
        let of_positions = self
            .blocks
            .iter()
            .skip(1)
            .filter(|rows| rows.kinds.len() >= 3);
        let fixes_handedness = of_positions.into_iter().any(has_all);
        Rank {
            rows: reduced.rows(),
            spent: reduced.spent,
            poses: self.assembly.poses.len(),
            unknowns: scales.len(),
            determined: known.iter().filter(|value| **value > 1.0).count(),
            open: shared.freedoms(&reduced.triangle, &scales),
            has_mirror_image: !fixes_handedness,
        }
    }

    /// Refuses as many factors as points, and a scale that nothing determines.
    fn refuse_rank(&self, rank: &Rank, free_scale: bool) -> Result<(), Error> {
        let Some(why) = rank
            .why_not()
            .filter(|_| rank.is_saturated() || !free_scale)
        else {
            return Ok(());
        };
        let help = if rank.is_saturated() {
            format!(
                "measure at least {} poses like these, or let more of them calibrate with `--split all`",
                rank.poses_needed()
            )
        } else {
            "measure a distance; `--free-scale` fits it all the same, with the size of the tolerances".to_owned()
        };
        Err(InputError::whole(&self.folder.name, why).help(help).into())
    }

    /// Refuses lengths in millimetres that are plausible in themselves.
    fn refuse_units(&self) -> Result<(), Error> {
        let values = &self.start;
        let reduced = self.elimination(values).reduce();
        for (rows, residuals) in self.blocks.iter().zip(&reduced.residuals).skip(1) {
            if rows.kinds.len() != 1 {
                continue;
            }
            let measured = rows.data.chunks_exact(rows.family.shape().data);
            let off = |divisor: f64| {
                let pairs = residuals.iter().zip(&rows.weights).zip(measured.clone());
                let mut off: Vec<f64> = pairs
                    .map(|((residual, weight), data)| {
                        let sigma = self.assembly.kinds[rows.kinds[0]].sigma;
                        let measured = data[data.len() - 1];
                        let predicted = residual * sigma / weight + measured;
                        (predicted - measured / divisor).abs()
                    })
                    .collect();
                off.sort_by(f64::total_cmp);
                off[off.len() / 2]
            };
            let (as_is, as_millimetres) = (off(1.0), off(1000.0));
            if as_is > MILLIMETRES_OFF * as_millimetres && as_is > MILLIMETRES_M {
                let message = format!(
                    "the lengths are {as_is:.3} m off what the machine would have them, {as_millimetres:.3} m if they were millimetres"
                );
                let error = InputError::whole(rows.label.clone(), message);
                return Err(error
                    .help("these look like millimetres: divide by 1000")
                    .into());
            }
        }
        Ok(())
    }

    /// Largest move of a pose from its base (m, rad).
    fn largest_move(&self, values: &[f64]) -> f64 {
        let own = &values[self.shared()..];
        own.iter()
            .fold(0.0, |most: f64, value| most.max(value.abs()))
    }

    /// Takes the poses found for new bases, and weights from there.
    fn rebuild(&mut self, values: &mut [f64]) -> Result<(), Error> {
        let shared = self.shared();
        self.machine = self.machine_at(values);
        for (pose, own) in
            (self.assembly.poses.iter_mut()).zip(values[shared..].chunks_exact_mut(POSE_UNKNOWNS))
        {
            let vector = |k: usize| nalgebra::Vector3::new(own[k], own[k + 1], own[k + 2]);
            pose.base = pose.base.moved(vector(0), vector(3));
            own.fill(0.0);
        }
        let chosen = Chosen {
            poses: &self.division.calibration,
            distances: &self.division.distances,
            left_out: &self.left_out,
        };
        self.blocks = self.assembly.rows(&self.machine, &self.used, &chosen)?;
        Ok(())
    }

    fn machine_at(&self, values: &[f64]) -> Machine {
        self.machine
            .with_values(problem::values(&self.machine, &self.used, values))
    }

    /// Sums of squares and redundancies of each kind.
    fn kind_fits(&self, reduced: &Reduced, leverages: &[Vec<f64>]) -> Vec<KindFit> {
        let kinds = self.assembly.kinds.iter().zip(&reduced.counts);
        let mut fits: Vec<KindFit> = kinds
            .map(|(&kind, &rows)| KindFit {
                kind,
                rows,
                redundancy: 0.0,
                squares: 0.0,
            })
            .collect();
        for ((rows, residuals), leverages) in
            self.blocks.iter().zip(&reduced.residuals).zip(leverages)
        {
            let of_rows = rows.kinds.iter().cycle().zip(&rows.weights);
            for ((&kind, weight), (residual, leverage)) in of_rows
                .map(|(k, w)| (k, w))
                .zip(residuals.iter().zip(leverages))
            {
                if *weight > 0.0 {
                    fits[kind].redundancy += 1.0 - leverage;
                    fits[kind].squares += residual * residual;
                }
            }
        }
        fits
    }

    /// Estimates the noise of kinds that ask for it, by their squares over what the fit leaves of their number (W. Förstner,
    /// 1979); the largest relative change.
    fn estimate_noise(&mut self, reduced: &Reduced, leverages: &[Vec<f64>]) -> f64 {
        let fits = self.kind_fits(reduced, leverages);
        let mut largest: f64 = 0.0;
        for (kind, fit) in self.assembly.kinds.iter_mut().zip(fits) {
            if !kind.is_estimated() {
                continue;
            }
            if let Some(ratio) = fit.residual_over_noise() {
                // Bounded, so that a first round far off does not throw the others away.
                let ratio = ratio.clamp(0.1, 10.0);
                largest = largest.max((ratio - 1.0).abs());
                kind.sigma *= ratio;
            }
        }
        largest
    }

    /// Leaves out rows that are farther off than the largest of so many; true if there were any. Readings of drives are
    /// rows by themselves where each drive moves one link.
    fn leave_out_gross(&mut self, reduced: &Reduced, leverages: &[Vec<f64>]) -> bool {
        let mut all: Vec<GrossRow> = vec![];
        let tells_drives = self.assembly.tells_drives(&self.machine);
        let blocks = self.blocks.iter().zip(&reduced.residuals).zip(leverages);
        for (index, ((rows, residuals), leverages)) in blocks.enumerate() {
            if index == 0 && !tells_drives {
                continue;
            }
            let each = rows.kinds.len();
            for (k, residual) in residuals.iter().enumerate() {
                let left = 1.0 - leverages[k];
                // What the fit follows anyway can't be told to be off.
                if rows.weights[k] > 0.0 && left > 1.0 - ABSORBED {
                    let drive = (index == 0).then_some(k % each);
                    all.push(GrossRow {
                        place: RowPlace {
                            drive,
                            ..rows.places[k / each]
                        },
                        sigmas: residual.abs() / left.sqrt(),
                    });
                }
            }
        }
        let mut sorted: Vec<f64> = all.iter().map(|row| row.sigmas).collect();
        sorted.sort_by(f64::total_cmp);
        // Larger noise, or an effect that the model lacks, makes no gross rows: they are told at the scale of most.
        let median = sorted.get(sorted.len() / 2).copied().unwrap_or(0.0);
        let scale = (median / MEDIAN_OF_NORMAL).max(1.0);
        let count = all.len();
        let level = GROSS_LEVEL / count.max(1) as f64;
        let limit = scale * chi2_quantile_above(level, 1.0).sqrt();
        let mut far = all;
        far.retain(|row| row.sigmas > limit);
        far.sort_by(|a, b| b.sigmas.total_cmp(&a.sigmas));
        // One gross row drags others along: only those nearly as far off as the worst go at once, and of one pose the worst.
        let worst = far.first().map_or(0.0, |row| row.sigmas);
        let mut seen = BTreeSet::new();
        far.retain(|row| row.sigmas > 0.7 * worst && seen.insert(row.place.pose));
        let total = count + self.gross.len();
        if far.is_empty()
            || (self.gross.len() + far.len()) as f64 > (MOST_GROSS * total as f64).max(1.0)
        {
            return false;
        }
        self.left_out.extend(far.iter().map(|row| row.place));
        self.gross.extend(far);
        true
    }

    fn finish(
        &self,
        values: &[f64],
        (reduced, leverages): (&Reduced, &[Vec<f64>]),
        rank: Rank,
        (solution, iterations): (&tau_solver::Solution, usize),
    ) -> Result<UnknownPoses, Error> {
        let shared = self.shared();
        let covariance = self.covariance(&reduced.triangle);
        let count = self.used.len();
        let of_variant: Vec<Vec<f64>> = (0..count)
            .map(|i| (0..count).map(|j| covariance[(i, j)]).collect())
            .collect();
        let kinds = self.kind_fits(reduced, leverages);
        let machine = self.machine_at(values);
        let fitted = Fitted {
            values: machine.values.clone(),
            used: self.used.clone(),
            factor: triangle::lower(&of_variant),
            covariance: of_variant,
            undetermined: self.undetermined(&reduced.triangle, values)?,
            cost: solution.cost,
            iterations,
            termination: solution.termination.to_string(),
        };
        let objects: Vec<ObjectEstimate> = (self.assembly.object_unknowns().enumerate())
            .map(|(index, unknown)| ObjectEstimate {
                name: unknown.name.clone(),
                unit: unknown.unit,
                value: values[count + index],
                sigma: covariance[(count + index, count + index)].sqrt(),
            })
            .collect();
        let poses = self.assembly.poses.len();
        let mut calibration = Calibration {
            poses,
            ..calibration::finish(&self.prepared, self.file, &[], fitted)?
        };
        self.write_objects(&mut calibration.file, values, &covariance);
        let held_out = heldout::HeldOut::of(&machine, self, &values[..shared])?;
        Ok(UnknownPoses {
            calibration,
            objects,
            chi2: kinds.iter().map(|kind| kind.squares).sum(),
            dof: kinds.iter().map(|kind| kind.redundancy).sum(),
            kinds,
            rank,
            gross: self.gross.clone(),
            held_out,
            poses,
            loss: None,
            commands_m: (0..self.machine.robot.commands)
                .map(|k| range(self.assembly.commands().map(|commands| commands[k])))
                .collect(),
            position_m: (0..3)
                .map(|axis| {
                    range(
                        self.assembly
                            .poses
                            .iter()
                            .map(|pose| pose.base.position[axis]),
                    )
                })
                .collect(),
        })
    }

    /// Combinations that the data leave to the tolerances.
    fn undetermined(
        &self,
        triangle: &DMatrix<f64>,
        values: &[f64],
    ) -> Result<Vec<Combination>, Error> {
        let family = Linear::new(triangle);
        let shared = self.shared();
        let block = tau_solver::Block::new("measurements", &family, (0..shared).collect(), &[]);
        let problem = Problem {
            parameters: self.shared_parameters(values),
            blocks: vec![block],
        };
        let found = tau_solver::identifiability(&problem, &values[..shared]);
        let found = found.map_err(|error| self.not_converged(error.to_string()))?;
        Ok(combinations(&found, |index| {
            problem.parameters[index].name.clone()
        }))
    }

    /// Writes places found into the robot file.
    fn write_objects(&self, file: &mut RobotFile, values: &[f64], covariance: &DMatrix<f64>) {
        for object in &self.assembly.objects {
            let at = self.used.len() + object.first;
            let own: Vec<f64> = values[at..at + 3].to_vec();
            let sigma: Vec<f64> = (at..at + 3).map(|k| covariance[(k, k)].sqrt()).collect();
            let tol = |k: usize| object.unknowns[k].prior.map_or(WIDE_M, |prior| prior.1);
            let name = if object.name.is_empty() {
                "ball"
            } else {
                &object.name
            };
            let place = Value {
                value: own.clone(),
                tol: tol(0),
                sigma: Some(sigma.clone()),
            };
            match object.section {
                "targets" => {
                    file.measuring.targets.insert(name.to_owned(), place);
                }
                "balls" if !object.name.is_empty() => {
                    file.measuring.balls.insert(name.to_owned(), place);
                }
                "surfaces" => {
                    let [u, v] = quantity::across(&object.normal);
                    let normal = (object.normal + u * own[0] + v * own[1]).normalize();
                    let surface = tau_robot::robot_file::Surface {
                        normal: Value {
                            value: normal.as_slice().to_vec(),
                            tol: tol(0),
                            sigma: None,
                        },
                        offset: Value {
                            value: vec![own[2]],
                            tol: tol(2),
                            sigma: Some(vec![sigma[2]]),
                        },
                    };
                    file.measuring.surfaces.insert(name.to_owned(), surface);
                }
                _ => {}
            }
        }
    }
}

/// Lowest and highest of some values.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], value| {
        [low.min(value), high.max(value)]
    })
}

/// Tolerance (m or rad) that says nothing, of places that had none.
const WIDE_M: f64 = 1e3;
/// Median of the absolute value of a normal deviate.
const MEDIAN_OF_NORMAL: f64 = 0.674_489_750_196_081_7;
/// Lengths that are so much (m) off, and so many times farther than a thousandth of them, are millimetres.
const MILLIMETRES_M: f64 = 1.0;
const MILLIMETRES_OFF: f64 = 10.0;

/// Effects of a tracker have no part in what is measured without one.
fn refuse_tracker_effects(variant: &Variant, folder: &Folder) -> Result<(), Error> {
    let effects = variant.tracker_effects();
    let other = folder.plate_rows.first().map(|row| row.kind.file());
    let other = other.or((!folder.distances.is_empty()).then_some(DISTANCES));
    match (effects.first(), other) {
        (Some(effect), Some(file)) => {
            let message = format!(
                "`{effect}` of variant `{}` is an error of the tracker, and {file} is measured without it",
                variant.name
            );
            Err(InputError::whole(&folder.name, message).into())
        }
        _ => Ok(()),
    }
}

/// Linear residuals `R·x` of the shared unknowns, for what asks for derivatives alone.
struct Linear {
    triangle: DMatrix<f64>,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
}

impl Linear {
    fn new(triangle: &DMatrix<f64>) -> Self {
        let number = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
        let (rows, width) = triangle.shape();
        Self {
            triangle: triangle.clone(),
            row_starts: (0..=rows).map(|row| number(row * width)).collect(),
            columns: (0..rows).flat_map(|_| (0..width).map(number)).collect(),
        }
    }
}

impl tau_runtime::ResidualFamily for Linear {
    fn shape(&self) -> tau_runtime::Shape {
        tau_runtime::Shape {
            data: 0,
            prepared: 0,
            parameters: self.triangle.ncols(),
            residuals: self.triangle.nrows(),
        }
    }

    fn pattern(&self) -> tau_runtime::Pattern<'_> {
        tau_runtime::Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, _: &[f64], _: &mut [f64]) {}

    fn value(&self, _: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let product = &self.triangle * DVector::from_column_slice(parameters);
        residuals.copy_from_slice(product.as_slice());
    }

    fn linearize(
        &self,
        data: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.value(data, parameters, residuals);
        jacobian.copy_from_slice(self.triangle.transpose().as_slice());
    }
}
