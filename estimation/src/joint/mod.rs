//! All sets in one fit: residuals in units of their noise, their derivatives, priors.

pub mod descent;
pub(crate) mod exact;
pub mod fit;
mod information;
pub(crate) mod judged;
pub mod knots;
pub mod predicted;
mod priors;
mod serial;
mod start;
pub mod variant;

use nalgebra::DVector;
use tau_kinematics::Machine;
use tau_robot::robot_file::Noise;
use tau_solver::Problem;

pub(crate) use information::{Information, Way};
pub(crate) use serial::{filtered, links};

pub use crate::problem::{CLOSURE_SHARE, Component, Eliminated, Origin, RowPlace, Tracked};

use crate::joint::knots::Knots;
use crate::machine::error::Error;
use crate::machine::nominal::Nominal;
use crate::numerics::grouped::{Filling, Grouped, Groups};
use crate::numerics::parallel;
use crate::problem::{self, Closures, Part, Residuals, parameters};
use crate::samples::Sample;
use crate::samples::outliers;

/// A family with its samples, prepared.
#[derive(Debug, Clone)]
struct Rows {
    part: Part,
    prepared: Vec<f64>,
    /// First row of the fit; samples follow each other.
    first: usize,
}

impl Rows {
    /// The family's own parameters among those of the fit.
    fn local(&self, fitted: &[f64]) -> Vec<f64> {
        self.part.parameters.iter().map(|&p| fitted[p]).collect()
    }
}

/// The residuals of a variant at all samples.
#[derive(Debug, Clone)]
pub struct Joint {
    /// The variant; its values are those of parameters that the fit does not move.
    pub machine: Machine,
    /// Index in the variant of each parameter of the fit.
    pub used: Vec<usize>,
    /// Prior of each of them.
    pub priors: Vec<Nominal>,
    /// Bias of the score by each of them, which the rows of the priors take off: see [`problem::whitened_bias`].
    bias: Vec<f64>,
    parts: Vec<Rows>,
    /// Displacements of the points that piecewise tracks pass through: unknowns of the fit behind the parameters.
    knots: Knots,
    /// Dependence of rows, those of the priors too, on columns.
    pub(crate) groups: Groups,
    /// Correlation of each pose of set 1 with the one before, where their noise follows itself.
    links: Vec<f64>,
    /// Sample, component and place within the sample of each row.
    pub rows: Vec<Row>,
    /// The poses that are unknown, in the order of their rows; nothing where poses are known.
    pub eliminated: Vec<Eliminated>,
    /// Least noise of a component over the stated one: 1, or next to nothing where noise is estimated.
    pub(crate) least_scale: f64,
}

/// Origin of a residual.
#[derive(Debug, Clone, Copy)]
pub struct Row {
    /// Index of the sample.
    pub sample: usize,
    /// Component of the noise.
    pub component: Component,
    /// Index of the residual in its sample.
    pub residual: usize,
    /// Share of its stated weight: 1, but of exact closures that a model misses.
    pub share: f64,
}

/// Residuals and derivatives at a point, whitened; the rows of the priors last.
#[derive(Debug)]
pub struct Linear {
    /// Whitened residuals.
    pub residuals: DVector<f64>,
    /// Their derivatives by the parameters of the fit and the displacements of points.
    pub jacobian: Grouped,
}

/// Residuals this many standard deviations large count less in the first fit.
const ROBUST: f64 = 3.0;
/// Least noise, over the one that residuals are weighed by, where that is estimated.
const LEAST_SCALE: f64 = 1e-3;
/// Share of a column's norm that stands in for the prior of a parameter that has none.
const WEAK: f64 = 1e-6;

impl Joint {
    /// Lays out the rows: set 1, then sets 2 and 3 by track.
    ///
    /// # Errors
    /// Data that residuals take are missing; closures that do not depend on the pose.
    pub fn new(
        machine: Machine,
        nominal: &[Nominal],
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        let mut joint = Self::of_residuals(machine, nominal, samples, noise)?;
        joint.bias = joint.bias((samples, noise), None, 1.0)?;
        Ok(joint)
    }

    /// The same for residuals at known values, where priors play no part.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub(crate) fn of_residuals(
        machine: Machine,
        nominal: &[Nominal],
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        Self::with(machine, nominal, samples, noise, Closures::Whitened)
    }

    /// The same where poses are unknown. Behind the parameters come the unknowns of targets, surfaces and balls, as
    /// displacements from where groups are linearised; `objects` are their priors.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn of_unknown_poses(
        machine: Machine,
        nominal: &[Nominal],
        samples: &[Sample],
        noise: Noise,
        groups: &[Eliminated],
        objects: &[Nominal],
    ) -> Result<Self, Error> {
        // In the order of their rows: groups of one shape follow each other.
        let mut groups = groups.to_vec();
        groups.sort_by_key(Eliminated::shape);
        let closures = Closures::Eliminated(&groups);
        let mut joint = Self::with(machine, nominal, samples, noise, closures)?;
        if !objects.is_empty() {
            let of_paths = joint.displacements();
            let of_objects = Knots::of_objects(&groups, joint.rows.len());
            joint.knots = joint.knots.beside(of_objects);
            let unknown = Nominal::new(0.0, None);
            (joint.priors).extend(std::iter::repeat_n(unknown, of_paths));
            joint.priors.extend_from_slice(objects);
            joint.groups = joint.groups();
        }
        let mut origins = groups.iter().flat_map(|group| &group.origins);
        if origins.any(|origin| !origin.is_stated) {
            joint.least_scale = LEAST_SCALE;
        }
        joint.eliminated = groups;
        Ok(joint)
    }

    fn with(
        machine: Machine,
        nominal: &[Nominal],
        samples: &[Sample],
        noise: Noise,
        closures: Closures<'_>,
    ) -> Result<Self, Error> {
        let Residuals {
            used,
            priors,
            parts,
        } = Residuals::new(&machine, nominal, samples, noise, closures)?;
        let mut rows = Vec::new();
        let parts = parts
            .into_iter()
            .map(|part| {
                let first = rows.len();
                let residuals = part.components.iter().enumerate().cycle();
                let owners = part.owners().zip(residuals);
                rows.extend(owners.map(|(sample, (residual, &component))| Row {
                    sample,
                    component,
                    residual,
                    share: 1.0,
                }));
                let mut prepared = vec![0.0; part.samples.len() * part.family.shape().prepared];
                part.family.prepare_all(&part.data, &mut prepared);
                Rows {
                    part,
                    prepared,
                    first,
                }
            })
            .collect();
        let links = (machine.surroundings.serial).map_or_else(Vec::new, |rho| links(samples, rho));
        let mut joint = Self {
            machine,
            bias: vec![0.0; used.len()],
            used,
            priors,
            parts,
            knots: Knots::none(rows.len()),
            groups: Groups::default(),
            links,
            rows,
            eliminated: vec![],
            least_scale: 1.0,
        };
        joint.groups = joint.groups();
        if let Some(knots) = knots::measured(&joint, samples) {
            joint.knots = knots;
            joint.groups = joint.groups();
        }
        Ok(joint)
    }

    /// The same of set 1 alone, with the noise (m) of the points that piecewise tracks pass through: unknowns with a
    /// prior, since no sample measures them.
    #[must_use]
    pub(crate) fn with_path_noise(mut self, samples: &[Sample], position_m: f64) -> Self {
        if let Some(knots) = knots::of_data(&self, samples) {
            let prior = Nominal::new(0.0, Some(position_m));
            self.knots = knots;
            (self.priors).extend(std::iter::repeat_n(prior, self.displacements()));
            self.groups = self.groups();
        }
        self
    }

    fn groups(&self) -> Groups {
        let columns = self.used.len() + self.displacements();
        // Priors are none of the components.
        let of_priors = std::iter::repeat_n(Component::ALL.len(), columns);
        let kinds = self.rows.iter().map(|row| row.component as usize);
        let kinds: Vec<usize> = kinds.chain(of_priors).collect();
        Groups::of(&kinds, columns, |mark| {
            for Rows { part, first, .. } in &self.parts {
                let (residuals, pattern) = (part.components.len(), part.family.pattern());
                for row in 0..part.samples.len() * residuals {
                    let within = row % residuals;
                    let entries = pattern.row_starts[within] as usize
                        ..pattern.row_starts[within + 1] as usize;
                    for &parameter in &pattern.columns[entries] {
                        mark(first + row, part.parameters[parameter as usize]);
                    }
                }
            }
            for row in 0..self.rows.len() {
                let unknowns = self.knots.unknowns(row);
                unknowns.for_each(|unknown| mark(row, self.used.len() + unknown));
            }
            (0..columns).for_each(|column| mark(self.rows.len() + column, column));
        })
    }

    /// Number of displacements of measured points that are unknown.
    pub fn displacements(&self) -> usize {
        self.knots.count
    }

    /// The values of the whole variant.
    pub fn values(&self, fitted: &[f64]) -> Vec<f64> {
        problem::values(&self.machine, &self.used, fitted)
    }

    /// Values of the fit out of those of the whole variant, measured points where they were measured.
    pub fn fitted(&self, values: &[f64]) -> Vec<f64> {
        let points = std::iter::repeat_n(0.0, self.displacements());
        self.used
            .iter()
            .map(|&index| values[index])
            .chain(points)
            .collect()
    }

    /// Factor of each row beyond the stated noise: reciprocal scale of its component times the weight
    /// of its sample.
    pub fn factors(&self, scales: &[f64; 4], weights: &[f64]) -> Vec<f64> {
        self.rows
            .iter()
            .map(|row| row.share * weights[row.sample] / row.component.scale(scales))
            .collect()
    }

    /// Deviation of each sample at some values, those left out like the others.
    pub fn deviations(
        &self,
        fitted: &[f64],
        scales: &[f64; 4],
        samples: &[Sample],
    ) -> Vec<(f64, f64)> {
        let factors = self.factors(scales, &vec![1.0; samples.len()]);
        let plain = self.residuals(fitted, &factors);
        outliers::deviations(self.sums(&plain, samples.len()), samples)
    }

    /// Each sample's sum of squared residuals, and the number of those that have noise.
    pub fn sums(&self, residuals: &DVector<f64>, samples: usize) -> Vec<(f64, f64)> {
        let mut sums = vec![(0.0, 0.0_f64); samples];
        for (row, at) in self.rows.iter().enumerate() {
            sums[at.sample].0 += residuals[row].powi(2);
            sums[at.sample].1 += f64::from(u8::from(at.component != Component::Exact));
        }
        sums
    }

    /// The fit as a problem for the solver, robust against outliers. `factors` holds one number per row.
    pub fn problem(&self, start: &[f64], factors: &[f64]) -> Problem<'_> {
        let blocks = self.parts.iter().map(|rows| {
            let weigh = |k, weight: f64| weight * factors[rows.first + k];
            let block = rows.part.block(weigh);
            block.with_loss(tau_solver::Loss::Huber(ROBUST))
        });
        let start = start.iter().copied();
        let priors: Vec<Nominal> = (0..self.used.len())
            .filter_map(|column| self.prior(column))
            .collect();
        Problem {
            parameters: parameters(&self.machine.variant, &self.used, &priors, start),
            blocks: blocks.collect(),
        }
    }

    /// Residuals at a point, in units of the noise times `factors`, priors last.
    pub fn residuals(&self, fitted: &[f64], factors: &[f64]) -> DVector<f64> {
        let rows = self.rows.len();
        let mut residuals = DVector::zeros(rows + fitted.len());
        let of_parts = parallel::map(&self.parts, |rows| {
            let mut plain = vec![0.0; rows.part.weights.len()];
            let family = &rows.part.family;
            family.value_all(&rows.prepared, &rows.local(fitted), &mut plain);
            self.filter(rows, &mut plain);
            plain
        });
        for (Rows { part, first, .. }, plain) in self.parts.iter().zip(of_parts) {
            let weighted = plain.iter().zip(&part.weights);
            for (row, (&residual, &weight)) in (*first..).zip(weighted) {
                residuals[row] = residual * weight * factors[row];
            }
        }
        self.displace(fitted, factors, &mut residuals);
        for (column, &value) in fitted.iter().enumerate() {
            if let Some((departure, _)) = self.departure(column, value) {
                residuals[rows + column] = departure;
            }
        }
        residuals
    }

    /// Adds what the displacements of measured points do; they are small, so it is linear in them.
    fn displace(&self, fitted: &[f64], factors: &[f64], residuals: &mut DVector<f64>) {
        let moved = self.knots.moved(&fitted[self.used.len()..]);
        for ((residual, moved), factor) in residuals.iter_mut().zip(moved).zip(factors) {
            *residual += moved * factor;
        }
    }

    /// `Jᵀe` of a Jacobian with these factors.
    pub(crate) fn gradient(
        &self,
        jacobian: &Grouped,
        factors: &[f64],
        residuals: &DVector<f64>,
    ) -> DVector<f64> {
        let first = self.used.len();
        let mut gradient = jacobian.gradient_before(first, residuals);
        let weighed = residuals.iter().zip(factors);
        let by_knots = self
            .knots
            .gradient(weighed.map(|(residual, factor)| residual * factor));
        for (k, own) in by_knots.iter().enumerate() {
            gradient[first + k] += own;
        }
        // Where there is no prior, its row has no residual.
        let of_priors = self.priors.iter().enumerate().skip(first);
        for (column, prior) in of_priors {
            if let Some(tolerance) = prior.sigma() {
                gradient[column] += residuals[self.rows.len() + column] / tolerance;
            }
        }
        gradient
    }

    /// Residuals and Jacobian at a point, in units of the noise times `factors`.
    pub fn linearize(&self, fitted: &[f64], factors: &[f64]) -> Linear {
        let mut jacobian = self.groups.zeros();
        let mut by_knots = vec![0.0; self.displacements()];
        for (row, factor) in factors.iter().enumerate() {
            self.knots.derivatives(row, &mut by_knots);
            let own = by_knots.iter().map(|derivative| derivative * factor);
            jacobian.set_row(row, (self.used.len()..).zip(own));
        }
        self.linearized(fitted, factors, jacobian)
    }

    /// The same from the Jacobian at another point with these factors: derivatives by displacements are the same everywhere.
    pub(crate) fn relinearize(&self, fitted: &[f64], factors: &[f64], before: Grouped) -> Linear {
        self.linearized(fitted, factors, before.refilling(self.used.len()))
    }

    fn linearized(&self, fitted: &[f64], factors: &[f64], mut jacobian: Filling) -> Linear {
        let (rows, columns) = (self.rows.len(), fitted.len());
        let mut residuals = DVector::zeros(rows + columns);
        let of_parts = parallel::map(&self.parts, |rows| {
            let (part, local) = (&rows.part, rows.local(fitted));
            let mut plain = vec![0.0; part.weights.len()];
            let mut entries = vec![0.0; part.samples.len() * part.family.pattern().len()];
            part.family
                .linearize_all(&rows.prepared, &local, &mut plain, &mut entries);
            self.filter(rows, &mut plain);
            self.filter(rows, &mut entries);
            (plain, entries)
        });
        for (Rows { part, first, .. }, (plain, entries)) in self.parts.iter().zip(of_parts) {
            let (shape, pattern) = (part.family.shape(), part.family.pattern());
            for (k, &residual) in plain.iter().enumerate() {
                let row = first + k;
                let within = k % shape.residuals;
                let weight = part.weights[k] * factors[row];
                residuals[row] = residual * weight;
                let (start, end) = (
                    pattern.row_starts[within] as usize,
                    pattern.row_starts[within + 1] as usize,
                );
                let offset = k / shape.residuals * pattern.len();
                let of_row = pattern.columns[start..end].iter();
                let columns = of_row.map(|&column| part.parameters[column as usize]);
                let own = entries[offset + start..offset + end].iter();
                jacobian.set_row(row, columns.zip(own.map(|entry| entry * weight)));
            }
        }
        self.displace(fitted, factors, &mut residuals);
        for (column, &value) in fitted.iter().enumerate() {
            let row = rows + column;
            if let Some((departure, tolerance)) = self.departure(column, value) {
                residuals[row] = departure;
                if column < jacobian.open() {
                    jacobian.set_row(row, [(column, tolerance.recip())]);
                }
            } else if column < jacobian.open() {
                let norm = jacobian.norm(column);
                let weak = if norm > 0.0 { WEAK * norm } else { 1.0 };
                jacobian.set_row(row, [(column, weak)]);
            }
        }
        Linear {
            residuals,
            jacobian: jacobian.filled(),
        }
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::machine::Prepared;
    use crate::samples::frames::Frames;
    use tau_robot::robot::Robot;

    /// Every fifth pose of the prototype under `Full`.
    pub(crate) fn of_set_1() -> (Joint, Vec<Sample>) {
        of_set_1_on("Full")
    }

    fn of_set_1_on(variant: &str) -> (Joint, Vec<Sample>) {
        let (prepared, samples, noise) = of_prototype(variant, 5);
        let joint = Joint::new(prepared.machine, &prepared.nominal, &samples, noise);
        (joint.unwrap(), samples)
    }

    /// A variant on some of the poses of the prototype, from each to the next so many, with their stated noise.
    pub(crate) fn of_prototype(variant: &str, step: usize) -> (Prepared, Vec<Sample>, Noise) {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let folder = tau_robot::prototype::folder().unwrap();
        let file = tau_robot::prototype::robot_file().unwrap();
        let poses: Vec<usize> = (0..folder.tcp_poses.len()).step_by(step).collect();
        let variant = robot.variant(variant).unwrap();
        let prepared = Prepared::new(&robot, variant, &file, Some(&folder), &poses).unwrap();
        let samples = Sample::all(&robot, &folder, &poses, &Frames::default());
        (prepared, samples, file.noise)
    }

    /// Nothing of the derivatives is outside of the groups of rows: all sets, and points of tracks that are free to
    /// move. Held against differences of the residuals.
    #[test]
    fn groups_hold_all_derivatives() {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let folder = tau_robot::prototype::folder().unwrap();
        let file = tau_robot::prototype::robot_file().unwrap();
        let in_range = folder.in_range(&file, &tau_robot::measurements::Shape::from(&robot));
        let poses: Vec<usize> = in_range.into_iter().step_by(5).collect();
        let variant = robot.variant("FullPiecewise").unwrap();
        let prepared = Prepared::new(&robot, variant, &file, Some(&folder), &poses).unwrap();
        let frames = Frames::of(&prepared.machine, &folder);
        let samples = Sample::all(&robot, &folder, &poses, &frames);
        let joint = Joint::new(prepared.machine, &prepared.nominal, &samples, file.noise).unwrap();
        assert!(joint.displacements() > 0);
        let factors = joint.factors(&[1.0; 4], &vec![1.0; samples.len()]);
        let linear = joint.linearize(&joint.fitted(&joint.machine.values), &factors);
        let jacobian = linear.jacobian.dense();
        let at = joint.fitted(&joint.machine.values);
        let steps: Vec<f64> = jacobian
            .column_iter()
            .enumerate()
            .map(|(column, own)| 1e-3 * own.norm().recip() * (1.0 + 0.01 * column as f64))
            .collect();
        let moved = |sign: f64| {
            let moved: Vec<f64> = at.iter().zip(&steps).map(|(a, s)| a + sign * s).collect();
            joint.residuals(&moved, &factors)
        };
        let expected = (moved(1.0) - moved(-1.0)) / 2.0;
        let found = jacobian * DVector::from_vec(steps);
        // A row that stands in for a prior has no residual.
        let of_rows = |vector: &DVector<f64>| vector.rows(0, joint.rows.len()).into_owned();
        let off = of_rows(&(found - &expected)).amax() / of_rows(&expected).amax();
        assert!(off < 1e-7, "{off}");
    }

    /// Displacements of points have derivatives that stay where the fit goes, and touch few rows.
    #[test]
    fn what_stays_is_what_is_made_anew() {
        let (joint, samples) = of_set_1_on("FullPiecewise");
        let joint = joint.with_path_noise(&samples, 1e-5);
        assert!(joint.displacements() > 0);
        let weights: Vec<f64> = (0..samples.len()).map(|k| 0.8 + 0.01 * k as f64).collect();
        let factors = joint.factors(&[1.3, 1.0, 1.0, 1.0], &weights);
        let at = joint.fitted(&joint.machine.values);
        let moved: Vec<f64> = at.iter().map(|value| value + 1e-5).collect();
        let before = joint.linearize(&at, &factors).jacobian;
        let _known = before.gram();
        let again = joint.relinearize(&moved, &factors, before);
        let anew = joint.linearize(&moved, &factors);
        assert_eq!(again.residuals, anew.residuals);
        let dense = anew.jacobian.dense();
        assert_eq!(again.jacobian.dense(), dense);
        let gram = dense.tr_mul(&dense);
        assert!((again.jacobian.gram() - &gram).amax() < 1e-12 * gram.amax());
        let gradient = dense.tr_mul(&anew.residuals);
        let found = joint.gradient(&again.jacobian, &factors, &anew.residuals);
        for (column, (found, expected)) in found.iter().zip(&gradient).enumerate() {
            let scale = dense.column(column).norm() * anew.residuals.norm();
            assert!((found - expected).abs() < 1e-12 * scale, "column {column}");
        }
    }

    /// Those of the priors too, off their means.
    #[test]
    fn derivatives_are_those_of_small_steps() {
        let (joint, samples) = of_set_1();
        let factors = joint.factors(&[1.3, 1.0, 1.0, 1.0], &vec![0.9; samples.len()]);
        let tolerances: Vec<f64> = joint.priors.iter().map(|p| p.tolerance.unwrap()).collect();
        let nominal = joint.fitted(&joint.machine.values);
        let at: Vec<f64> = nominal
            .iter()
            .zip(&tolerances)
            .map(|(value, tolerance)| value + 0.5 * tolerance)
            .collect();
        let linear = joint.linearize(&at, &factors);
        let jacobian = linear.jacobian.dense();
        let residuals = joint.residuals(&at, &factors);
        assert!((&linear.residuals - residuals).amax() < 1e-7);
        for (column, tolerance) in tolerances.iter().enumerate() {
            let step = 1e-3 * tolerance;
            let moved = |step: f64| {
                let mut moved = at.clone();
                moved[column] += step;
                joint.residuals(&moved, &factors)
            };
            let expected = (moved(step) - moved(-step)) / (2.0 * step);
            let found = jacobian.column(column);
            assert!(
                (found - &expected).amax() < 1e-6 * found.amax(),
                "column {column}"
            );
            let prior = found[joint.rows.len() + column];
            assert!((prior * tolerance - 1.0).abs() < 1e-12, "column {column}");
        }
    }
}
