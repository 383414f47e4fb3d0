//! Residuals and Jacobian of one part as functions of its free parameters.

use crate::Error;
use crate::jacobian::Jacobian;
use crate::partition::Part;
use crate::problem::{Block, Prior, Problem};

/// Position in a row of an entry that belongs to no free parameter.
const DROPPED: usize = usize::MAX;
/// Samples that a family is asked for at once.
const BATCH: usize = 64;

/// Where a number that is not finite turned up.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct NonFinite {
    block: usize,
    sample: usize,
    residual: usize,
    /// Problem index of the parameter, for derivatives.
    parameter: Option<usize>,
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

/// What the residuals of a system are wanted for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Content {
    /// Data and priors, losses as squares of equal gradient and, where safe, equal curvature.
    Minimize,
    /// Data and priors, losses as weights: for covariances.
    Information,
    /// Data without priors, losses as weights: for identifiability.
    DataOnly,
}

/// One block, with the places of its entries in the part's Jacobian.
struct Piece {
    block: usize,
    /// First residual.
    row: usize,
    /// For each entry of the family's pattern, its place among the entries of one sample.
    slots: Vec<usize>,
    /// Entries per sample.
    entries: usize,
}

/// Residuals, Jacobian and cost of one part.
pub(crate) struct System<'p> {
    problem: &'p Problem<'p>,
    /// Problem indices of the free parameters.
    pub(crate) parameters: Vec<usize>,
    content: Content,
    pieces: Vec<Piece>,
    /// Column, parameter's prior.
    priors: Vec<(usize, Prior)>,
    /// All parameters of the problem; those of other parts do not matter here.
    all: Vec<f64>,
    pub(crate) jacobian: Jacobian,
    pub(crate) residuals: Vec<f64>,
    family_parameters: Vec<f64>,
    family_residuals: Vec<f64>,
    family_jacobian: Vec<f64>,
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
        let mut jacobian = Jacobian {
            row_starts: vec![0],
            columns: Vec::new(),
            values: Vec::new(),
            column_count: part.parameters.len(),
        };
        let mut pieces = Vec::with_capacity(part.blocks.len());
        let (mut most_parameters, mut most_residuals, mut most_entries) = (0, 0, 0);
        for &b in &part.blocks {
            let block = &problem.blocks[b];
            let shape = block.family.shape();
            most_parameters = most_parameters.max(shape.parameters);
            most_residuals = most_residuals.max(shape.residuals);
            most_entries = most_entries.max(block.family.pattern().len());

            let row = jacobian.row_starts.len() - 1;
            let (row_ends, columns, slots) = sample_pattern(block, &column_of);
            for _ in 0..block.samples {
                let base = jacobian.columns.len();
                jacobian.columns.extend_from_slice(&columns);
                jacobian
                    .row_starts
                    .extend(row_ends.iter().map(|end| base + end));
            }
            pieces.push(Piece {
                block: b,
                row,
                slots,
                entries: columns.len(),
            });
        }
        let mut priors = Vec::new();
        if content != Content::DataOnly {
            for (column, &p) in part.parameters.iter().enumerate() {
                if let Some(prior) = problem.parameters[p].prior {
                    priors.push((column, prior));
                    jacobian.columns.push(column);
                    jacobian.row_starts.push(jacobian.columns.len());
                }
            }
        }
        jacobian.values = vec![0.0; jacobian.columns.len()];
        Self {
            residuals: vec![0.0; jacobian.row_count()],
            problem,
            parameters: part.parameters.clone(),
            content,
            pieces,
            priors,
            all: all.to_vec(),
            jacobian,
            family_parameters: vec![0.0; most_parameters],
            family_residuals: vec![0.0; BATCH * most_residuals],
            family_jacobian: vec![0.0; BATCH * most_entries],
        }
    }

    /// Writes the cost of each residual, `½ρ`, at the free parameters `x`.
    pub(crate) fn costs(&mut self, x: &[f64], costs: &mut [f64]) -> Result<(), NonFinite> {
        self.scatter(x);
        for piece in &self.pieces {
            let block = &self.problem.blocks[piece.block];
            let shape = block.family.shape();
            let parameters = &mut self.family_parameters[..shape.parameters];
            gather(&self.all, &block.parameters, parameters);
            for first in (0..block.samples).step_by(BATCH) {
                let count = BATCH.min(block.samples - first);
                let residuals = &mut self.family_residuals[..count * shape.residuals];
                let prepared = first * shape.prepared..(first + count) * shape.prepared;
                block
                    .family
                    .value_all(&block.prepared[prepared], parameters, residuals);
                for (i, &residual) in residuals.iter().enumerate() {
                    let index = first * shape.residuals + i;
                    let whitened = residual * weight(block, index);
                    if !whitened.is_finite() {
                        return Err(NonFinite {
                            block: piece.block,
                            sample: index / shape.residuals,
                            residual: index % shape.residuals,
                            parameter: None,
                        });
                    }
                    costs[piece.row + index] = block.loss.at(whitened).cost;
                }
            }
        }
        let first_prior = costs.len() - self.priors.len();
        for ((column, prior), cost) in self.priors.iter().zip(&mut costs[first_prior..]) {
            let r = (x[*column] - prior.mean) / prior.sigma;
            *cost = 0.5 * r * r;
        }
        Ok(())
    }

    /// Fills [`Self::residuals`] and [`Self::jacobian`] at the free parameters `x`, weighted.
    pub(crate) fn linearize(&mut self, x: &[f64]) -> Result<(), NonFinite> {
        self.scatter(x);
        for piece in &self.pieces {
            let block = &self.problem.blocks[piece.block];
            let shape = block.family.shape();
            let pattern = block.family.pattern();
            let parameters = &mut self.family_parameters[..shape.parameters];
            gather(&self.all, &block.parameters, parameters);
            let first_entry = self.jacobian.row_starts[piece.row];
            for sample in 0..block.samples {
                let in_batch = sample % BATCH;
                if in_batch == 0 {
                    let count = BATCH.min(block.samples - sample);
                    let prepared = sample * shape.prepared..(sample + count) * shape.prepared;
                    block.family.linearize_all(
                        &block.prepared[prepared],
                        parameters,
                        &mut self.family_residuals[..count * shape.residuals],
                        &mut self.family_jacobian[..count * pattern.len()],
                    );
                }
                let residuals =
                    &self.family_residuals[in_batch * shape.residuals..][..shape.residuals];
                let derivatives =
                    &self.family_jacobian[in_batch * pattern.len()..][..pattern.len()];
                let start = first_entry + sample * piece.entries;
                let entries = &mut self.jacobian.values[start..start + piece.entries];
                entries.fill(0.0);
                for (i, &residual) in residuals.iter().enumerate() {
                    let fault = |parameter| NonFinite {
                        block: piece.block,
                        sample,
                        residual: i,
                        parameter,
                    };
                    let index = sample * shape.residuals + i;
                    let weight = weight(block, index);
                    let whitened = residual * weight;
                    if !whitened.is_finite() {
                        return Err(fault(None));
                    }
                    let at = block.loss.at(whitened);
                    let (residual_factor, jacobian_factor) = if self.content == Content::Minimize {
                        at.factors()
                    } else {
                        (at.weight.sqrt(), at.weight.sqrt())
                    };
                    self.residuals[piece.row + index] = residual_factor * whitened;
                    let factor = jacobian_factor * weight;
                    let range = pattern.row_starts[i] as usize..pattern.row_starts[i + 1] as usize;
                    for entry in range {
                        if piece.slots[entry] != DROPPED {
                            let derivative = factor * derivatives[entry];
                            if !derivative.is_finite() {
                                let column = pattern.columns[entry] as usize;
                                return Err(fault(Some(block.parameters[column])));
                            }
                            entries[piece.slots[entry]] += derivative;
                        }
                    }
                }
            }
        }
        let first_row = self.residuals.len() - self.priors.len();
        let first_entry = self.jacobian.values.len() - self.priors.len();
        for (i, (column, prior)) in self.priors.iter().enumerate() {
            self.residuals[first_row + i] = (x[*column] - prior.mean) / prior.sigma;
            self.jacobian.values[first_entry + i] = 1.0 / prior.sigma;
        }
        Ok(())
    }

    fn scatter(&mut self, x: &[f64]) {
        for (&p, &x) in self.parameters.iter().zip(x) {
            self.all[p] = x;
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

/// The Jacobian pattern of one sample over a part's columns: ends of rows, columns, and the place of
/// each entry of the family. Family parameters that are the same unknown share a place.
fn sample_pattern(block: &Block, column_of: &[usize]) -> (Vec<usize>, Vec<usize>, Vec<usize>) {
    let pattern = block.family.pattern();
    let mut row_ends = Vec::with_capacity(pattern.row_starts.len());
    let mut columns: Vec<usize> = Vec::with_capacity(pattern.len());
    let mut slots = Vec::with_capacity(pattern.len());
    for row in pattern.row_starts.windows(2) {
        let row_start = columns.len();
        let entries = &pattern.columns[row[0] as usize..row[1] as usize];
        let column = |&entry: &u32| column_of[block.parameters[entry as usize]];
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
    }
    (row_ends, columns, slots)
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
            let r = (x - prior.mean) / prior.sigma;
            costs.push(0.5 * r * r);
        }
    }
    Ok(costs.iter().sum())
}
