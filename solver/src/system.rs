//! Residuals and Jacobian of one part as functions of its free parameters.

use rayon::prelude::*;
use tau_runtime::Lanes;

use crate::jacobian::Jacobian;
use crate::partition::Part;
use crate::problem::{Block, Prepared, Prior, Problem};
use crate::{Error, Loss};

/// Position in a row of an entry that belongs to no free parameter.
const DROPPED: usize = usize::MAX;
/// Samples that a family is asked for at once.
const BATCH: usize = 64;
/// From so many batches on, threads share them. Each writes to places of its own, so that nothing depends
/// on how many threads there are.
const SHARED_BATCHES: usize = 8;

/// Origin of a number that is not finite.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NonFinite {
    pub(crate) block: usize,
    pub(crate) sample: usize,
    pub(crate) residual: usize,
    /// Problem index of the parameter, for derivatives.
    pub(crate) parameter: Option<usize>,
}

impl NonFinite {
    pub(crate) fn into_error(self, problem: &Problem) -> Error {
        let block = &problem.blocks[self.block];
        Error::NonFinite {
            block: block.label.clone(),
            sample: block.sample_name(self.sample),
            residual: self.residual,
            parameter: self.parameter.map(|p| problem.parameters[p].name.clone()),
        }
    }
}

/// Successive samples of a block whose entries stand alike in the part's Jacobian.
struct Piece {
    block: usize,
    /// First sample, and their number.
    first: usize,
    samples: usize,
    /// First residual.
    row: usize,
    layout: SampleLayout,
}

/// Places of the entries of a sample.
struct SampleLayout {
    /// For each residual, the end of its entries among those of the sample.
    row_ends: Vec<usize>,
    /// For each entry of the family's pattern, its place among the entries of the sample.
    slots: Vec<usize>,
}

/// Part of a piece that a thread writes: some samples' rows.
struct Batch<'a> {
    /// First sample of the block, and their number.
    first: usize,
    samples: usize,
    residuals: &'a mut [f64],
    /// Entries of the Jacobian; empty where only values are wanted.
    entries: &'a mut [f64],
}

/// Room for what a family writes.
#[derive(Default)]
struct Scratch {
    /// Parameters that samples share, and those of each sample of a batch.
    shared: Vec<f64>,
    own: Vec<f64>,
    residuals: Vec<f64>,
    derivatives: Vec<f64>,
    lanes: Vec<Lanes>,
}

/// Residuals, Jacobian and cost of one part.
pub(crate) struct System<'p> {
    problem: &'p Problem<'p>,
    /// Problem indices of the free parameters.
    parameters: Vec<usize>,
    pieces: Vec<Piece>,
    /// Column, parameter's prior.
    pub(crate) priors: Vec<(usize, Prior)>,
    /// All parameters of the problem; those of other parts do not matter here.
    all: Vec<f64>,
    pub(crate) jacobian: Jacobian,
    pub(crate) residuals: Vec<f64>,
}

impl<'p> System<'p> {
    /// Lays out a part of a checked problem. `all` gives the fixed parameters.
    pub(crate) fn new(problem: &'p Problem<'p>, part: &Part, all: &[f64]) -> Self {
        let mut column_of = vec![DROPPED; problem.parameters.len()];
        for (column, &p) in part.parameters.iter().enumerate() {
            column_of[p] = column;
        }
        let mut jacobian = Jacobian::new(part.parameters.len());
        let priors: Vec<(usize, Prior)> = (part.parameters.iter().enumerate())
            .filter_map(|(column, &p)| Some((column, problem.parameters[p].prior?)))
            .collect();
        jacobian.reserve(priors.len(), priors.len());
        let mut pieces: Vec<Piece> = Vec::with_capacity(part.blocks.len());
        for &b in &part.blocks {
            let block = &problem.blocks[b];
            let (rows, entries) = (block.family.shape().residuals, block.family.pattern().len());
            jacobian.reserve(block.samples * rows, block.samples * entries);
            let mut columns = Vec::new();
            for sample in 0..block.samples {
                let row = jacobian.row_count();
                let is_as_before = |piece: &mut Piece| {
                    let is_same = !block.has_sample_parameters()
                        || (piece.layout).columns_at(block, sample, &column_of, &mut columns);
                    piece.samples += usize::from(is_same);
                    is_same
                };
                let last = pieces.last_mut().filter(|_| sample > 0);
                if !last.is_some_and(is_as_before) {
                    let layout;
                    (layout, columns) = SampleLayout::new(block, sample, &column_of);
                    pieces.push(Piece {
                        block: b,
                        first: sample,
                        samples: 1,
                        row,
                        layout,
                    });
                }
                if let Some(piece) = pieces.last() {
                    jacobian.push_rows(&columns, &piece.layout.row_ends);
                }
            }
        }
        for &(column, _) in &priors {
            jacobian.push_rows(&[column], &[1]);
        }
        jacobian.values = vec![0.0; jacobian.columns.len()];
        Self {
            residuals: vec![0.0; jacobian.row_count()],
            problem,
            parameters: part.parameters.clone(),
            pieces,
            priors,
            all: all.to_vec(),
            jacobian,
        }
    }

    /// Writes the cost of each residual, `½ρ`, at the free parameters `x`.
    pub(crate) fn costs(&mut self, x: &[f64], costs: &mut [f64]) -> Result<(), NonFinite> {
        self.each(x, costs, |loss, whitened| loss.at(whitened).0, Prior::cost)
    }

    /// Writes the residuals, weighted, at the free parameters `x`.
    pub(crate) fn residuals_at(
        &mut self,
        x: &[f64],
        residuals: &mut [f64],
    ) -> Result<(), NonFinite> {
        self.each(x, residuals, |_, whitened| whitened, Prior::residual)
    }

    /// Writes a number for each weighted residual, and for each prior. Numbers so large that their sum may overflow are not
    /// finite.
    fn each(
        &mut self,
        x: &[f64],
        numbers: &mut [f64],
        number: impl Fn(&Loss, f64) -> f64 + Sync,
        of_prior: impl Fn(&Prior, f64) -> f64,
    ) -> Result<(), NonFinite> {
        self.scatter(x);
        let most = f64::MAX / numbers.len() as f64;
        for piece in &self.pieces {
            let block = &self.problem.blocks[piece.block];
            let rows = block.family.shape().residuals;
            let numbers = &mut numbers[piece.row..piece.row + piece.samples * rows];
            in_batches(piece, block, numbers, &mut [], |scratch, batch| {
                scratch.evaluate(block, &self.all, batch, false);
                for (i, own) in batch.residuals.iter_mut().enumerate() {
                    let index = batch.first * rows + i;
                    *own = number(&block.loss, scratch.residuals[i] * weight(block, index));
                    if own.is_nan() || own.abs() > most {
                        return Some(piece.fault(index / rows, index % rows, None));
                    }
                }
                None
            })?;
        }
        let first_prior = numbers.len() - self.priors.len();
        for ((column, prior), own) in self.priors.iter().zip(&mut numbers[first_prior..]) {
            *own = of_prior(prior, x[*column]);
        }
        Ok(())
    }

    /// Fills [`Self::residuals`] and [`Self::jacobian`] at the free parameters `x`, weighted.
    pub(crate) fn linearize(&mut self, x: &[f64]) -> Result<(), NonFinite> {
        self.scatter(x);
        for piece in &self.pieces {
            let block = &self.problem.blocks[piece.block];
            let rows = piece.row..piece.row + piece.samples * block.family.shape().residuals;
            let starts = &self.jacobian.row_starts;
            let entries = &mut self.jacobian.values[starts[rows.start]..starts[rows.end]];
            let residuals = &mut self.residuals[rows];
            in_batches(piece, block, residuals, entries, |scratch, batch| {
                scratch.evaluate(block, &self.all, batch, true);
                piece.whiten(block, scratch, batch)
            })?;
        }
        let first_row = self.residuals.len() - self.priors.len();
        let first_entry = self.jacobian.values.len() - self.priors.len();
        for (i, (column, prior)) in self.priors.iter().enumerate() {
            self.residuals[first_row + i] = prior.residual(x[*column]);
            self.jacobian.values[first_entry + i] = 1.0 / prior.sigma;
        }
        Ok(())
    }

    /// True if all costs are squares of residuals.
    pub(crate) fn is_of_squares(&self) -> bool {
        let mut blocks = self
            .pieces
            .iter()
            .map(|piece| &self.problem.blocks[piece.block]);
        blocks.all(|block| block.loss == Loss::Squared)
    }

    fn scatter(&mut self, x: &[f64]) {
        for (&p, &x) in self.parameters.iter().zip(x) {
            self.all[p] = x;
        }
    }
}

impl SampleLayout {
    /// That of one sample over a part's columns, and the columns of its entries. Family parameters that are the same unknown
    /// share a place.
    fn new(block: &Block, sample: usize, column_of: &[usize]) -> (Self, Vec<usize>) {
        let pattern = block.family.pattern();
        let (mut columns, mut row_ends, mut slots) = (vec![], vec![], vec![]);
        for row in pattern.row_starts.windows(2) {
            let entries = &pattern.columns[row[0] as usize..row[1] as usize];
            let column = |&entry: &u32| column_of[block.parameter(sample, entry as usize)];
            let mut own: Vec<usize> = entries
                .iter()
                .map(column)
                .filter(|&c| c != DROPPED)
                .collect();
            own.sort_unstable();
            own.dedup();
            let place = |column| {
                own.binary_search(&column)
                    .map(|place| columns.len() + place)
            };
            slots.extend(
                entries
                    .iter()
                    .map(|entry| place(column(entry)).unwrap_or(DROPPED)),
            );
            columns.append(&mut own);
            row_ends.push(columns.len());
        }
        (Self { row_ends, slots }, columns)
    }

    /// Writes the columns of a sample's entries; false if they do not stand in this layout.
    fn columns_at(
        &self,
        block: &Block,
        sample: usize,
        column_of: &[usize],
        columns: &mut [usize],
    ) -> bool {
        columns.fill(DROPPED);
        for (&slot, &entry) in self.slots.iter().zip(block.family.pattern().columns) {
            let column = column_of[block.parameter(sample, entry as usize)];
            match columns.get_mut(slot) {
                None if column == DROPPED => {}
                Some(place) if *place == DROPPED || *place == column => *place = column,
                _ => return false,
            }
        }
        let mut start = 0;
        self.row_ends.iter().all(|&end| {
            let row = &columns[start..end];
            start = end;
            row.is_sorted_by(|a, b| a < b) && row.last() != Some(&DROPPED)
        })
    }
}

impl Piece {
    fn fault(&self, sample: usize, residual: usize, parameter: Option<usize>) -> NonFinite {
        NonFinite {
            block: self.block,
            sample,
            residual,
            parameter,
        }
    }

    /// Turns what a family wrote into whitened residuals and Jacobian entries.
    fn whiten(&self, block: &Block, scratch: &Scratch, batch: &mut Batch) -> Option<NonFinite> {
        let pattern = block.family.pattern();
        let rows = block.family.shape().residuals;
        let width = self.layout.row_ends.last().copied().unwrap_or(0);
        batch.entries.fill(0.0);
        for k in 0..batch.samples {
            let sample = batch.first + k;
            let derivatives = &scratch.derivatives[k * pattern.len()..][..pattern.len()];
            let entries = &mut batch.entries[k * width..(k + 1) * width];
            for (i, ends) in pattern.row_starts.windows(2).enumerate() {
                let weight = weight(block, sample * rows + i);
                let whitened = scratch.residuals[k * rows + i] * weight;
                if !whitened.is_finite() {
                    return Some(self.fault(sample, i, None));
                }
                // A square of equal gradient.
                let root = block.loss.at(whitened).1.sqrt();
                batch.residuals[k * rows + i] = root * whitened;
                let own = ends[0] as usize..ends[1] as usize;
                let slots = self.layout.slots[own.clone()].iter();
                for (&slot, (derivative, column)) in
                    slots.zip(derivatives[own.clone()].iter().zip(&pattern.columns[own]))
                {
                    if let Some(entry) = entries.get_mut(slot) {
                        *entry += root * weight * derivative;
                        if !entry.is_finite() {
                            let parameter = block.parameter(sample, *column as usize);
                            return Some(self.fault(sample, i, Some(parameter)));
                        }
                    }
                }
            }
        }
        None
    }
}

/// Hands a piece out in batches, to several threads where it is large; the first fault in order of the
/// samples is returned.
fn in_batches(
    piece: &Piece,
    block: &Block,
    mut residuals: &mut [f64],
    mut entries: &mut [f64],
    work: impl Fn(&mut Scratch, &mut Batch) -> Option<NonFinite> + Sync + Send,
) -> Result<(), NonFinite> {
    let rows = block.family.shape().residuals;
    let width = entries.len() / piece.samples;
    let mut batches = Vec::with_capacity(piece.samples.div_ceil(BATCH));
    for first in (0..piece.samples).step_by(BATCH) {
        let samples = BATCH.min(piece.samples - first);
        let (own_residuals, other_residuals) = residuals.split_at_mut(samples * rows);
        let (own_entries, other_entries) = entries.split_at_mut(samples * width);
        (residuals, entries) = (other_residuals, other_entries);
        batches.push(Batch {
            first: piece.first + first,
            samples,
            residuals: own_residuals,
            entries: own_entries,
        });
    }
    let fault = if batches.len() < SHARED_BATCHES {
        let mut scratch = Scratch::default();
        batches
            .iter_mut()
            .find_map(|batch| work(&mut scratch, batch))
    } else {
        let faults = batches.par_iter_mut().map_init(Scratch::default, work);
        faults.find_map_first(|fault| fault)
    };
    fault.map_or(Ok(()), Err)
}

impl Scratch {
    /// Asks the family for the values at a batch of samples, and for the derivatives.
    fn evaluate(&mut self, block: &Block, all: &[f64], batch: &Batch, derivatives: bool) {
        let shape = block.family.shape();
        let entries = block.family.pattern().len();
        self.shared.clear();
        self.shared
            .extend(block.parameters.iter().map(|&index| all[index]));
        self.residuals.resize(BATCH * shape.residuals, 0.0);
        if derivatives {
            self.derivatives.resize(BATCH * entries, 0.0);
        }
        let residuals = &mut self.residuals[..batch.samples * shape.residuals];
        let derivatives = derivatives.then(|| &mut self.derivatives[..batch.samples * entries]);
        if !block.has_sample_parameters() {
            let (first, lanes) = (batch.first, &mut self.lanes);
            block.evaluate(
                first,
                batch.samples,
                &self.shared,
                residuals,
                derivatives,
                lanes,
            );
            return;
        }
        let Prepared::Samples(prepared) = &block.prepared else {
            unreachable!("samples with parameters of their own are prepared one by one");
        };
        self.own.clear();
        for k in 0..batch.samples {
            let own = block.sample_parameters(batch.first + k).iter();
            self.own.extend(own.map(|&index| all[index]));
        }
        let end = (batch.first + batch.samples) * shape.prepared;
        let prepared = &prepared[batch.first * shape.prepared..end];
        let (family, shared, own) = (block.family, &self.shared, &self.own);
        match derivatives {
            Some(derivatives) => {
                family.linearize_each(prepared, shared, own, residuals, derivatives);
            }
            None => family.value_each(prepared, shared, own, residuals),
        }
    }
}

fn weight(block: &Block, index: usize) -> f64 {
    block.weights.get(index).copied().unwrap_or(1.0)
}

/// Cost of what no free parameter changes: blocks without any, and priors of fixed parameters.
pub(crate) fn constant_cost(
    problem: &Problem,
    blocks: &[usize],
    all: &[f64],
) -> Result<f64, Error> {
    let part = Part {
        parameters: Vec::new(),
        blocks: blocks.to_vec(),
    };
    let mut system = System::new(problem, &part, all);
    let mut costs = vec![0.0; system.residuals.len()];
    system
        .costs(&[], &mut costs)
        .map_err(|fault| fault.into_error(problem))?;
    for (parameter, x) in problem.parameters.iter().zip(all) {
        if let (false, Some(prior)) = (parameter.is_free(), parameter.prior) {
            costs.push(prior.cost(*x));
        }
    }
    Ok(costs.iter().sum())
}
