//! Residuals and Jacobian of one part as functions of its free parameters.

use rayon::prelude::*;
use tau_runtime::Lanes;

use crate::jacobian::{Jacobian, JacobianPattern};
use crate::partition::Part;
use crate::problem::{Block, Prepared, Prior, Problem};
use crate::vector::zeros;
use crate::{Error, Loss};

/// Position in a row of an entry that belongs to no free parameter.
pub(crate) const DROPPED: usize = usize::MAX;
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

/// Purpose of an evaluation of the residuals.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Content {
    /// Data and priors, losses as squares of equal gradient and, where safe, equal curvature.
    Minimize,
    /// Data and priors, losses as weights: for covariances.
    Information,
    /// Data without priors, losses as weights: for identifiability.
    DataOnly,
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
    /// For one thread.
    scratch: Scratch,
}

/// Places of the entries of a sample.
#[derive(PartialEq, Eq)]
struct SampleLayout {
    /// For each residual, the end of its entries among those of the sample.
    row_ends: Vec<usize>,
    /// For each entry of the family's pattern, its place among the entries of the sample.
    slots: Vec<usize>,
    /// Entries of the pattern that have a place, with it, and the end of each residual's among them.
    kept: Vec<(usize, usize)>,
    kept_ends: Vec<usize>,
    /// True if the entries of the sample are those of the pattern, in its order.
    is_pattern: bool,
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
    pub(crate) parameters: Vec<usize>,
    content: Content,
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
    pub(crate) fn new(
        problem: &'p Problem<'p>,
        part: &Part,
        all: &[f64],
        content: Content,
    ) -> Self {
        let mut column_of = vec![DROPPED; problem.parameters.len()];
        for (column, &p) in part.parameters.iter().enumerate() {
            column_of[p] = column;
        }
        let mut pattern = JacobianPattern::new(part.parameters.len());
        let priors: Vec<(usize, Prior)> = (part.parameters.iter().enumerate())
            .filter(|_| content != Content::DataOnly)
            .filter_map(|(column, &p)| Some((column, problem.parameters[p].prior?)))
            .collect();
        // Where it has to grow it is copied.
        pattern.reserve(priors.len(), priors.len());
        for block in part.blocks.iter().map(|&b| &problem.blocks[b]) {
            let (rows, entries) = (block.family.shape().residuals, block.family.pattern().len());
            pattern.reserve(block.samples * rows, block.samples * entries);
        }
        let mut pieces: Vec<Piece> = Vec::with_capacity(part.blocks.len());
        for &b in &part.blocks {
            let block = &problem.blocks[b];
            let mut columns = Vec::new();
            for sample in 0..block.samples {
                let row = pattern.row_count();
                let as_before = sample > 0
                    && pieces.last().is_some_and(|piece| {
                        !block.has_sample_parameters()
                            || piece
                                .layout
                                .columns_at(block, sample, &column_of, &mut columns)
                    });
                if let (true, Some(piece)) = (as_before, pieces.last_mut()) {
                    piece.samples += 1;
                } else {
                    let layout;
                    (layout, columns) = sample_layout(block, sample, &column_of);
                    pieces.push(Piece {
                        block: b,
                        first: sample,
                        samples: 1,
                        row,
                        layout,
                        scratch: Scratch::default(),
                    });
                }
                if let Some(piece) = pieces.last() {
                    pattern.push_rows(&columns, &piece.layout.row_ends);
                }
            }
        }
        for &(column, _) in &priors {
            pattern.push_rows(&[column], &[1]);
        }
        let jacobian = pattern.into_jacobian();
        Self {
            residuals: zeros(jacobian.row_count()),
            problem,
            parameters: part.parameters.clone(),
            content,
            pieces,
            priors,
            all: all.to_vec(),
            jacobian,
        }
    }

    /// Writes the cost of each residual, `½ρ`, at the free parameters `x`.
    pub(crate) fn costs(&mut self, x: &[f64], costs: &mut [f64]) -> Result<(), NonFinite> {
        self.each(x, costs, |loss, whitened| loss.at(whitened).cost)?;
        let first_prior = costs.len() - self.priors.len();
        for ((column, prior), cost) in self.priors.iter().zip(&mut costs[first_prior..]) {
            *cost = prior.cost(x[*column]);
        }
        Ok(())
    }

    /// Writes the residuals, weighted, at the free parameters `x`.
    pub(crate) fn residuals_at(
        &mut self,
        x: &[f64],
        residuals: &mut [f64],
    ) -> Result<(), NonFinite> {
        self.each(x, residuals, |_, whitened| whitened)?;
        let first_prior = residuals.len() - self.priors.len();
        for ((column, prior), own) in self.priors.iter().zip(&mut residuals[first_prior..]) {
            *own = (x[*column] - prior.mean) / prior.sigma;
        }
        Ok(())
    }

    /// Writes a number for each weighted residual but those of priors.
    fn each(
        &mut self,
        x: &[f64],
        numbers: &mut [f64],
        number: impl Fn(&Loss, f64) -> f64 + Sync,
    ) -> Result<(), NonFinite> {
        self.scatter(x);
        for piece in &mut self.pieces {
            let mut scratch = std::mem::take(&mut piece.scratch);
            let block = &self.problem.blocks[piece.block];
            let shape = block.family.shape();
            let evaluate = |scratch: &mut Scratch, batch: &mut Batch| {
                scratch.evaluate(block, &self.all, batch, false);
                for (i, own) in batch.residuals.iter_mut().enumerate() {
                    let index = batch.first * shape.residuals + i;
                    let whitened = scratch.residuals[i] * weight(block, index);
                    if !whitened.is_finite() {
                        return Some(NonFinite {
                            block: piece.block,
                            sample: index / shape.residuals,
                            residual: index % shape.residuals,
                            parameter: None,
                        });
                    }
                    *own = number(&block.loss, whitened);
                }
                None
            };
            let rows = piece.samples * shape.residuals;
            let numbers = &mut numbers[piece.row..piece.row + rows];
            in_batches(piece, block, &mut scratch, numbers, &mut [], evaluate)?;
            piece.scratch = scratch;
        }
        Ok(())
    }

    /// Fills [`Self::residuals`] and [`Self::jacobian`] at the free parameters `x`, weighted.
    pub(crate) fn linearize(&mut self, x: &[f64]) -> Result<(), NonFinite> {
        self.scatter(x);
        for piece in &mut self.pieces {
            let mut scratch = std::mem::take(&mut piece.scratch);
            let block = &self.problem.blocks[piece.block];
            let rows = piece.samples * block.family.shape().residuals;
            let first_entry = self.jacobian.row_starts[piece.row];
            let end = self.jacobian.row_starts[piece.row + rows];
            in_batches(
                piece,
                block,
                &mut scratch,
                &mut self.residuals[piece.row..piece.row + rows],
                &mut self.jacobian.values[first_entry..end],
                |scratch, batch| {
                    scratch.evaluate(block, &self.all, batch, true);
                    piece.whiten(block, self.content, scratch, batch)
                },
            )?;
            piece.scratch = scratch;
        }
        let first_row = self.residuals.len() - self.priors.len();
        let first_entry = self.jacobian.values.len() - self.priors.len();
        for (i, (column, prior)) in self.priors.iter().enumerate() {
            self.residuals[first_row + i] = (x[*column] - prior.mean) / prior.sigma;
            self.jacobian.values[first_entry + i] = 1.0 / prior.sigma;
        }
        Ok(())
    }

    /// True if all costs are squares of residuals.
    pub(crate) fn is_of_squares(&self) -> bool {
        let mut losses = self
            .pieces
            .iter()
            .map(|piece| self.problem.blocks[piece.block].loss);
        losses.all(|loss| loss == Loss::Squared)
    }

    fn scatter(&mut self, x: &[f64]) {
        for (&p, &x) in self.parameters.iter().zip(x) {
            self.all[p] = x;
        }
    }
}

impl SampleLayout {
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
    /// Turns what a family wrote into whitened residuals and Jacobian entries.
    fn whiten(
        &self,
        block: &Block,
        content: Content,
        scratch: &Scratch,
        batch: &mut Batch,
    ) -> Option<NonFinite> {
        let shape = block.family.shape();
        let pattern = block.family.pattern();
        let width = self.layout.row_ends.last().copied().unwrap_or(0);
        // Where no two parameters of the family are the same unknown, each entry is written once.
        let is_once = self.layout.kept.len() == width;
        if !is_once {
            batch.entries.fill(0.0);
        }
        for k in 0..batch.samples {
            let sample = batch.first + k;
            let derivatives = &scratch.derivatives[k * pattern.len()..][..pattern.len()];
            let entries = &mut batch.entries[k * width..(k + 1) * width];
            let mut first = 0;
            for (i, &end) in self.layout.kept_ends.iter().enumerate() {
                let fault = |parameter| {
                    Some(NonFinite {
                        block: self.block,
                        sample,
                        residual: i,
                        parameter,
                    })
                };
                let weight = weight(block, sample * shape.residuals + i);
                let whitened = scratch.residuals[k * shape.residuals + i] * weight;
                if !whitened.is_finite() {
                    return fault(None);
                }
                let (residual_factor, jacobian_factor) = match block.loss {
                    Loss::Squared => (1.0, 1.0),
                    loss if content == Content::Minimize => loss.at(whitened).factors(),
                    loss => [loss.at(whitened).weight.sqrt(); 2].into(),
                };
                batch.residuals[k * shape.residuals + i] = residual_factor * whitened;
                let factor = jacobian_factor * weight;
                let own = first..end;
                let kept = &self.layout.kept[own.clone()];
                first = end;
                let mut is_finite = true;
                if self.layout.is_pattern {
                    let derivatives = &derivatives[own.clone()];
                    for (entry, derivative) in entries[own].iter_mut().zip(derivatives) {
                        *entry = factor * derivative;
                        is_finite &= entry.is_finite();
                    }
                } else {
                    for &(entry, slot) in kept {
                        let derivative = factor * derivatives[entry];
                        entries[slot] = if is_once {
                            derivative
                        } else {
                            entries[slot] + derivative
                        };
                        is_finite &= derivative.is_finite();
                    }
                }
                if !is_finite {
                    let is_wrong =
                        |&&(entry, _): &&(usize, usize)| !(factor * derivatives[entry]).is_finite();
                    if let Some(&(entry, _)) = kept.iter().find(is_wrong) {
                        let column = pattern.columns[entry] as usize;
                        return fault(Some(block.parameter(sample, column)));
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
    scratch: &mut Scratch,
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
        let mut batches = batches.iter_mut();
        batches.find_map(|batch| work(scratch, batch))
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
        self.shared.resize(block.parameters.len(), 0.0);
        gather(all, &block.parameters, &mut self.shared);
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

fn gather(all: &[f64], indices: &[usize], out: &mut [f64]) {
    for (out, &index) in out.iter_mut().zip(indices) {
        *out = all[index];
    }
}

/// The Jacobian pattern of one sample over a part's columns, and the columns of its entries. Family
/// parameters that are the same unknown share a place.
fn sample_layout(block: &Block, sample: usize, column_of: &[usize]) -> (SampleLayout, Vec<usize>) {
    let pattern = block.family.pattern();
    let mut row_ends = Vec::with_capacity(pattern.row_starts.len());
    let mut columns: Vec<usize> = Vec::with_capacity(pattern.len());
    let mut slots = Vec::with_capacity(pattern.len());
    let (mut kept, mut kept_ends) = (Vec::with_capacity(pattern.len()), Vec::new());
    for row in pattern.row_starts.windows(2) {
        let row_start = columns.len();
        let entries = &pattern.columns[row[0] as usize..row[1] as usize];
        let column = |&entry: &u32| column_of[block.parameter(sample, entry as usize)];
        columns.extend(entries.iter().map(column).filter(|&c| c != DROPPED));
        columns[row_start..].sort_unstable();
        let mut distinct = row_start;
        for i in row_start..columns.len() {
            if i == row_start || columns[i] != columns[distinct - 1] {
                columns[distinct] = columns[i];
                distinct += 1;
            }
        }
        columns.truncate(distinct);
        slots.extend(entries.iter().map(column).map(|c| {
            columns[row_start..]
                .binary_search(&c)
                .map_or(DROPPED, |place| row_start + place)
        }));
        row_ends.push(columns.len());
        let first = row[0] as usize;
        let places = slots[first..].iter().enumerate();
        let places = places.filter(|(_, slot)| **slot != DROPPED);
        kept.extend(places.map(|(entry, &slot)| (first + entry, slot)));
        kept_ends.push(kept.len());
    }
    let is_in_place = |(place, own): (usize, &(usize, usize))| *own == (place, place);
    let layout = SampleLayout {
        is_pattern: kept.len() == pattern.len() && kept.iter().enumerate().all(is_in_place),
        row_ends,
        slots,
        kept,
        kept_ends,
    };
    (layout, columns)
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
    let mut system = System::new(problem, &part, all, Content::Minimize);
    let mut costs = vec![0.0; system.residuals.len()];
    system
        .costs(&[], &mut costs)
        .map_err(|fault| fault.into_error(problem))?;
    for (parameter, x) in problem.parameters.iter().zip(all) {
        if let (false, Some(prior)) = (parameter.is_free(), parameter.prior) {
            costs.push(prior.cost(*x));
        }
    }
    let cost = costs.iter().sum();
    require_finite(cost, problem, &part, all)?;
    Ok(cost)
}

/// Refuses a cost at the start that is infinite although its residuals are not: names the largest residual, or
/// the parameter that starts farthest from its prior.
pub(crate) fn require_finite(
    cost: f64,
    problem: &Problem,
    part: &Part,
    all: &[f64],
) -> Result<(), Error> {
    if cost.is_finite() {
        return Ok(());
    }
    let mut system = System::new(problem, part, all, Content::DataOnly);
    let x: Vec<f64> = part.parameters.iter().map(|&p| all[p]).collect();
    let mut costs = vec![0.0; system.residuals.len()];
    system
        .costs(&x, &mut costs)
        .map_err(|fault| fault.into_error(problem))?;
    let largest = (0..costs.len()).max_by(|&a, &b| costs[a].total_cmp(&costs[b]));
    let least = largest.map_or(0.0, |row| costs[row]);
    let farthest = (problem.parameters.iter().zip(all))
        .filter_map(|(parameter, &x)| Some((parameter, parameter.prior?.cost(x))))
        .filter(|(_, cost)| *cost > least)
        .max_by(|(_, a), (_, b)| a.total_cmp(b));
    if let Some((parameter, _)) = farthest {
        return Err(Error::InvalidParameter {
            name: parameter.name.clone(),
            reason: "it starts too many standard deviations from its prior's mean".to_owned(),
        });
    }
    let fault = system.pieces.iter().find_map(|piece| {
        let residuals = problem.blocks[piece.block].family.shape().residuals;
        let index = largest?.checked_sub(piece.row)?;
        (index < piece.samples * residuals).then_some(NonFinite {
            block: piece.block,
            sample: piece.first + index / residuals,
            residual: index % residuals,
            parameter: None,
        })
    });
    fault.map_or(Ok(()), |fault| Err(fault.into_error(problem)))
}
