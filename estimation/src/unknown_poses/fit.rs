//! A calibration on its way: unknowns, residuals, and what they say of each other.

use std::collections::BTreeSet;

use nalgebra::{DMatrix, Vector3};
use tau_codes::{Remark, fit};
use tau_kinematics::{Machine, Statics};
use tau_robot::input_error::InputError;
use tau_robot::measurements::Folder;
use tau_robot::robot_file::RobotFile;
use tau_solver::{Parameter, Problem};

use super::assembly::{Assembly, Chosen};
use super::elimination::{Elimination, Reduced};
use super::gauge::Shared;
use super::kinds::{KindsOfComponent, kinds_of_carts, moves_links_apart};
use super::rows::{ABSORBED, CLOSURES, RowPlace, Rows, noise_of_rows};
use super::starts;
use super::{GrossRow, KindFit, Rank, RowDivision};
use crate::calibration::statics;
use crate::machine::{Error, Nominal, Prepared};
use crate::numerics::posterior::Posterior;
use crate::numerics::singular;
use crate::numerics::triangle::scaled;
use crate::problem::used_by_plate;
use crate::problem::{self, POSE_UNKNOWNS, Part};
use crate::samples::outliers::variance_of_most;
use crate::setup::Setup;
use crate::weighing::Loss;

/// Knowledge of a combination, in units of that of its tolerance, that is none: it takes less than a millionth off the
/// variance.
pub(super) const UNSEEN: f64 = 1e-3;

/// A calibration on its way.
#[derive(Debug)]
pub(super) struct Fit<'a> {
    pub(super) folder: &'a Folder,
    pub(super) file: &'a RobotFile,
    pub(super) division: &'a RowDivision,
    pub(super) prepared: Prepared,
    /// The variant at the values of the last round.
    pub(super) machine: Machine,
    /// Indices in the variant of its parameters among the shared unknowns.
    pub(super) used: Vec<usize>,
    pub(super) priors: Vec<Nominal>,
    pub(super) assembly: Assembly<'a>,
    pub(super) blocks: Vec<Rows>,
    /// Shared unknowns, then those of the poses.
    pub(super) start: Vec<f64>,
    pub(super) left_out: BTreeSet<RowPlace>,
    pub(super) gross: Vec<GrossRow>,
    /// Kinds whose noise may exceed the stated one.
    pub(super) groups: Vec<KindsOfComponent>,
    /// Loss of single residuals, if it is not least squares.
    pub(super) loss: Option<Loss>,
    /// True if it is one of several starts, as of a sketch: each is soon given up.
    pub(super) has_others: bool,
    /// True if its machine is but where another fit starts: then nobody asks how well it is known.
    pub(super) is_lead: bool,
    /// Noise that parameters are sought at, over the stated one.
    pub(super) widened: f64,
}

impl<'a> Fit<'a> {
    /// From the nominal values.
    pub(super) fn new(setup: Setup<'a>, division: &'a RowDivision) -> Result<Self, Error> {
        let prepared = setup.prepared_by_all()?;
        let machine = prepared.machine.clone();
        Self::from(
            &prepared,
            machine,
            setup.file,
            setup.folder,
            division,
            false,
        )
    }

    /// From the values of a machine, under the priors of the nominal ones; `has_others` where other starts are tried.
    pub(super) fn from(
        prepared: &Prepared,
        machine: Machine,
        file: &'a RobotFile,
        folder: &'a Folder,
        division: &'a RowDivision,
        has_others: bool,
    ) -> Result<Self, Error> {
        Self::beside_carts(
            vec![],
            prepared,
            machine,
            file,
            folder,
            division,
            has_others,
        )
    }

    /// The same with residuals of carts, which concern no pose.
    pub(super) fn beside_carts(
        carts: Vec<Part>,
        prepared: &Prepared,
        mut machine: Machine,
        file: &'a RobotFile,
        folder: &'a Folder,
        division: &'a RowDivision,
        has_others: bool,
    ) -> Result<Self, Error> {
        machine.surroundings.is_sketch = starts::sketched(prepared).is_some();
        let left_out = BTreeSet::new();
        let chosen = Chosen {
            poses: &division.calibration,
            distances: &division.distances,
            left_out: &left_out,
        };
        let mut used = used_by_plate(&machine);
        used.extend(carts.iter().flat_map(|part| &part.parameters));
        used.sort_unstable();
        used.dedup();
        let assembly = Assembly::with_closures(&machine, &used, file, folder, &chosen);
        let (mut assembly, closures) = assembly.map_err(|error| match error {
            // No row is to blame.
            Error::Kinematics {
                error: error @ tau_kinematics::Error::NoReference,
                ..
            } => InputError::whole(
                tau_codes::kinematics::NO_REFERENCE,
                &file.source,
                error.to_string(),
            )
            .help(file.reference_advice(&machine.robot))
            .into(),
            error => error,
        })?;
        if assembly.poses.is_empty() {
            let message = "no pose of the plate is left to calibrate";
            return Err(InputError::whole(fit::NO_POSES, &folder.name, message).into());
        }
        let mut blocks = match closures {
            Some(closures) => assembly.beside(closures, &machine, &used, &chosen)?,
            None => assembly.rows(&machine, &used, &chosen)?,
        };
        if !carts.is_empty() {
            let kinds = kinds_of_carts(file.noise);
            blocks.extend(Rows::of_carts(carts, &used, assembly.kinds.len()));
            assembly.kinds.extend(kinds);
        }
        let priors = problem::priors(&machine.variant, &used, &prepared.nominal);
        let mut start: Vec<f64> = used.iter().map(|&index| machine.values[index]).collect();
        start.extend(assembly.object_unknowns().map(|unknown| unknown.start));
        start.resize(start.len() + POSE_UNKNOWNS * assembly.poses.len(), 0.0);
        Ok(Self {
            folder,
            file,
            division,
            prepared: prepared.clone(),
            machine,
            used,
            priors,
            assembly,
            blocks,
            start,
            left_out,
            gross: vec![],
            groups: vec![],
            loss: None,
            has_others,
            is_lead: false,
            widened: 1.0,
        })
    }

    /// Number of shared unknowns.
    pub(super) fn shared(&self) -> usize {
        self.used.len() + self.assembly.object_unknowns().count()
    }

    pub(super) fn not_converged(&self, why: Remark) -> Error {
        Error::NotConverged {
            variant: self.machine.variant.name.clone(),
            why,
        }
    }

    /// The shared unknowns as the solver takes them.
    pub(super) fn shared_parameters(&self, values: &[f64]) -> Vec<Parameter> {
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

    /// True if a residual of a block may be a gross one. Exact closures are no measurements; others tell of a drive where
    /// links have noise, or each drive moves one of them alone.
    pub(super) fn can_be_gross(&self, block: usize) -> bool {
        let are_exact = || self.assembly.kinds[self.blocks[CLOSURES].kinds[0]].is_exact();
        let tells_drives = || !are_exact() && moves_links_apart(&self.machine.robot);
        block != CLOSURES || self.file.noise_of_links().is_some() || tells_drives()
    }

    /// Residuals of blocks that may hold gross ones: block, index, residual over its noise, share that the fit leaves.
    pub(super) fn judged<'b>(
        &'b self,
        reduced: &'b Reduced,
        leverages: &'b [Vec<f64>],
    ) -> impl Iterator<Item = (usize, usize, f64, f64)> + 'b {
        let blocks = self.blocks.iter().enumerate();
        let blocks = blocks.filter(|(block, _)| self.can_be_gross(*block));
        blocks.flat_map(|(block, rows)| {
            let residuals = reduced.residuals[block].iter().zip(&leverages[block]);
            let own = residuals.zip(&rows.weights).enumerate();
            own.filter(|(_, (_, weight))| **weight > 0.0)
                .map(move |(k, ((residual, leverage), _))| (block, k, *residual, 1.0 - leverage))
        })
    }

    /// Variance of estimates over that of least squares at the noise: 1 but under a loss.
    pub(super) fn loss_variance(&self, reduced: &Reduced, leverages: &[Vec<f64>]) -> f64 {
        let Some(loss) = self.loss else {
            return 1.0;
        };
        let judged = || self.judged(reduced, leverages);
        let norms: Vec<f64> = judged().map(|(_, _, residual, _)| residual.abs()).collect();
        let absorbed = judged().map(|(_, _, _, left)| 1.0 - left).sum();
        loss.tuned(1).variance(&norms, absorbed)
    }

    pub(super) fn problem(&self, values: &[f64]) -> Problem<'_> {
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
            let name = format!("pose {} ", pose.number);
            for (coordinate, (axis, &value)) in axes.iter().zip(own).enumerate() {
                parameters.push(if self.assembly.free.contains(&coordinate) {
                    Parameter::new([&name, *axis].concat(), value)
                } else {
                    // Nothing is ever said of a coordinate that the plate can't move along.
                    Parameter::new("", value).fixed()
                });
            }
        }
        let loss = |index: usize| match self.loss {
            Some(loss) if self.can_be_gross(index) => loss.of_single_residuals(),
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

    pub(super) fn elimination<'b>(&'b self, values: &'b [f64]) -> Elimination<'b> {
        let (shared, own) = values.split_at(self.shared());
        Elimination::new(&self.blocks, &self.assembly, shared, own)
    }

    /// Standard deviation of the prior of each shared unknown, or what stands for its size where it has none.
    pub(super) fn scales(&self) -> Vec<f64> {
        let of_variant = self.priors.iter().map(Nominal::scale);
        let of_objects = self.assembly.object_unknowns();
        of_variant
            .chain(of_objects.map(|unknown| unknown.prior.map_or(1.0, |prior| prior.1)))
            .collect()
    }

    pub(super) fn has_prior(&self) -> Vec<bool> {
        let of_variant = self.priors.iter();
        let of_variant =
            of_variant.map(|prior| prior.tolerance.is_some_and(|tolerance| tolerance > 0.0));
        let of_objects = self.assembly.object_unknowns();
        of_variant
            .chain(of_objects.map(|unknown| unknown.prior.is_some()))
            .collect()
    }

    /// Knowledge of the shared unknowns, priors included. `variance` is that of what the data say, over that of least squares.
    pub(super) fn posterior(&self, triangle: &DMatrix<f64>, variance: f64) -> Posterior {
        Posterior::new(triangle, self.scales(), &self.has_prior(), variance)
    }

    /// Covariance of the shared unknowns as far as they are determined.
    pub(super) fn determined(&self, triangle: &DMatrix<f64>) -> DMatrix<f64> {
        self.posterior(triangle, 1.0).determined().0
    }

    pub(super) fn rank(&self, reduced: &Reduced, machine: &Machine) -> Rank {
        let scales = self.scales();
        let scaled = scaled(&reduced.triangle, &scales);
        let (known, v_t) = singular::right(scaled.clone());
        let shared = Shared {
            machine,
            used: &self.used,
            objects: &self.assembly.objects,
            values: &self.start[..self.shared()],
            scale: &scales,
            poses: &self.assembly.poses,
        };
        // All coordinates along which a point moves tell left from right.
        let free = self.assembly.free.iter().filter(|axis| **axis < 3);
        let has_all = |rows: &Rows| {
            let mut weights = rows.weights.chunks_exact(rows.kinds.len());
            weights.any(|own| free.clone().all(|&axis| own[axis] > 0.0))
        };
        let mut measured = self.blocks.iter().skip(CLOSURES + 1);
        let fixes_handedness = measured.any(|rows| rows.kinds.len() >= 3 && has_all(rows));
        let places = self.assembly.places();
        let firsts = places.iter().enumerate();
        let poses = firsts.filter(|(pose, first)| pose == *first).count();
        let again = places.len() - poses;
        Rank {
            rows: reduced.rows(),
            repeated: self.repeated(&places),
            spent: (reduced.spent).saturating_sub(again * self.assembly.free.len()),
            poses,
            unknowns: scales.len(),
            determined: known.iter().filter(|value| **value > 1.0).count(),
            is_seen: known.is_empty() || known.iter().any(|value| *value > UNSEEN),
            open: shared.freedoms(reduced, &scaled, (&known, &v_t)),
            has_mirror_image: !fixes_handedness,
        }
    }

    /// Number of residuals that measure what another does, poses at the same commands having the same `places`.
    fn repeated(&self, places: &[usize]) -> usize {
        let of_block = |rows: &Rows| {
            let each = rows.kinds.len();
            let measured = (0..rows.weights.len()).filter(|&row| rows.weights[row] > 0.0);
            let mut all: Vec<([usize; 2], usize)> = measured
                .filter_map(|row| {
                    let ends = rows.ends_of(row / each)?;
                    Some((ends.map(|pose| places[pose]), row % each))
                })
                .collect();
            let count = all.len();
            // Mostly in order: poses follow each other.
            all.sort_unstable();
            all.dedup();
            count - all.len()
        };
        self.blocks.iter().map(of_block).sum()
    }

    /// Largest move of a pose from its base, or of a joint from where forces take it to be (m, rad).
    pub(super) fn largest_move(&self, values: &[f64]) -> f64 {
        let own = &values[self.shared()..];
        let of_poses = own.iter().map(|value| value.abs());
        let statics = self.statics_at(&self.machine_at(values));
        let before = self.machine.surroundings.statics.as_ref().zip(statics);
        let of_joints = before.map(|(before, after)| after.joints_apart_m(before));
        of_poses.chain(of_joints).fold(0.0, f64::max)
    }

    /// Forces of the arm as the values of a machine draw it, where they matter.
    fn statics_at(&self, machine: &Machine) -> Option<Statics> {
        let matter = machine.surroundings.statics.is_some() && machine.reads_forces();
        matter.then(|| statics(machine, self.file))?
    }

    /// Takes the poses found for new bases, and weights from there.
    pub(super) fn rebuild(&mut self, values: &mut [f64]) -> Result<(), Error> {
        let shared = self.shared();
        self.machine = self.machine_at(values);
        // Where dimensions were known roughly, so were forces.
        if let Some(statics) = self.statics_at(&self.machine) {
            self.machine.surroundings.statics = Some(statics);
        }
        for (pose, own) in
            (self.assembly.poses.iter_mut()).zip(values[shared..].chunks_exact_mut(POSE_UNKNOWNS))
        {
            let vector = |k: usize| Vector3::new(own[k], own[k + 1], own[k + 2]);
            pose.base = pose.base.moved(vector(0), vector(3));
            own.fill(0.0);
        }
        let chosen = Chosen {
            poses: &self.division.calibration,
            distances: &self.division.distances,
            left_out: &self.left_out,
        };
        let blocks = self.assembly.rows(&self.machine, &self.used, &chosen)?;
        let before = std::mem::replace(&mut self.blocks, blocks);
        let of_carts = before.into_iter().filter(|rows| rows.own_each() == 0);
        self.blocks.extend(of_carts);
        Ok(())
    }

    pub(super) fn machine_at(&self, values: &[f64]) -> Machine {
        self.machine
            .with_values(problem::values(&self.machine, &self.used, values))
    }

    /// Sums of squares and redundancies of each kind.
    pub(super) fn kind_fits(&self, reduced: &Reduced, leverages: &[Vec<f64>]) -> Vec<KindFit> {
        let noise = noise_of_rows(&self.assembly.kinds, &self.blocks);
        let kinds = self.assembly.kinds.iter().zip(&reduced.counts);
        let mut fits: Vec<KindFit> = kinds
            .zip(noise)
            .map(|((&kind, &rows), noise)| KindFit {
                kind,
                rows,
                noise,
                redundancy: 0.0,
                squares: 0.0,
                of_most: 1.0,
                repeats: None,
            })
            .collect();
        // Under a loss, gross residuals count as little in the noise as in the fit (P. J. Huber, 1964, proposal 2).
        let tuned = self.loss.map(|loss| loss.tuned(1));
        let usual = tuned.map_or(1.0, |tuned| tuned.square_at_normal_noise());
        let mut squares = vec![vec![]; fits.len()];
        for (block, ((rows, residuals), leverages)) in
            (self.blocks.iter().zip(&reduced.residuals).zip(leverages)).enumerate()
        {
            let tuned = tuned.filter(|_| self.can_be_gross(block));
            let of_rows = rows.kinds.iter().cycle().zip(&rows.weights);
            for ((&kind, weight), (residual, leverage)) in
                of_rows.zip(residuals.iter().zip(leverages))
            {
                if *weight > 0.0 {
                    fits[kind].redundancy += 1.0 - leverage;
                    if *leverage < ABSORBED {
                        squares[kind].push((residual * residual / (1.0 - leverage), 1.0));
                    }
                    fits[kind].squares += match tuned {
                        Some(tuned) => (tuned.weight(residual.abs()) * residual).powi(2) / usual,
                        None => residual * residual,
                    };
                }
            }
        }
        for (fit, squares) in fits.iter_mut().zip(squares) {
            if !squares.is_empty() {
                fit.of_most = variance_of_most(&squares);
            }
        }
        fits
    }
}
