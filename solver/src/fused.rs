//! The linear model of a part from its normal equations, which residual families accumulate without
//! storing a Jacobian.
//!
//! The iteration sees the Cholesky factor: with `[J r]ᵀ[J r] = [R c; 0 ρ]ᵀ[R c; 0 ρ]`, the small
//! problem `½‖R y + c‖² + ½ρ²` is the same function of the step as `½‖J y + r‖²`, and nothing after it
//! need know.
//!
//! Products square the condition number. So the factor is used only while rounding can't have touched
//! more than a tiny share of any pivot; on the first pivot for which that fails, the part goes over to
//! the QR factor of the Jacobian, which is the same triangle computed more accurately. Its rows are reduced as they
//! come: a Jacobian of many samples is larger than a cache, and writing and reading it takes longer than computing it.

use std::array::from_fn;

use tau_runtime::{BlockFamily, LANES, Lanes, NormalEquations, block_count};

use crate::jacobian::{Jacobian, JacobianPattern};
use crate::linear::qr::RowReduction;
use crate::linear::{DENSE_COLUMNS, Method};
use crate::parallel;
use crate::partition::Part;
use crate::problem::{Prepared, Prior, Problem};
use crate::system::{Content, DROPPED, NonFinite, System};
use crate::{Block, Loss};

/// Largest share of a pivot that may be rounding. What is lost of the pivots is lost of the last steps, and
/// the iteration goes on until these are all rounding.
const PIVOT_ERROR: f64 = 1e-10;
/// Residuals per parameter from which on the triangle is much smaller than the Jacobian.
const TALL: usize = 4;
/// Blocks of samples that are summed up apart; the sums are added in their order, so that they do not
/// depend on the number of threads.
const RANGE: usize = 512;
/// Blocks of samples of a range that one thread linearises at a time: some ten microseconds' work.
const SHARE: usize = 64;

/// One block of residuals.
struct Piece<'p> {
    block: usize,
    family: &'p dyn BlockFamily,
    prepared: &'p [Lanes],
    sizes: NormalEquations,
    /// Laid out as residuals are; zero past the last sample.
    weights: Vec<Lanes>,
    /// For each parameter of the family its column, and that of the residuals.
    columns: Vec<usize>,
}

/// The normal equations of a part, and their triangular factor.
pub(crate) struct Fused<'p> {
    problem: &'p Problem<'p>,
    part: Part,
    pieces: Vec<Piece<'p>>,
    priors: Vec<(usize, Prior)>,
    /// All parameters of the problem; those of other parts do not matter here.
    all: Vec<f64>,
    /// Number of residuals.
    pub(crate) rows: usize,
    /// The factor's rows `R`, and last a row without entries.
    pub(crate) triangle: Jacobian,
    /// `c`, and last ρ, what no step removes.
    pub(crate) residuals: Vec<f64>,
    /// Upper triangle of `[J r]ᵀ[J r]`, row by row; then its factor.
    matrix: Vec<f64>,
    /// Reduces the Jacobian, once the normal equations have turned out ill-conditioned.
    reduction: Option<RowReduction>,
}

impl<'p> Fused<'p> {
    /// The normal equations of a part; `None` where a family does not offer them, where a robust loss
    /// needs each residual's own weight, or where a dense factor is not what `method` asks for or pays.
    /// `all` gives the fixed parameters.
    pub(crate) fn new(
        problem: &'p Problem<'p>,
        part: &Part,
        all: &[f64],
        content: Content,
        method: Method,
    ) -> Option<Self> {
        let n = part.parameters.len();
        let asked_for = method == Method::NormalEquations;
        if n == 0 || !(asked_for || method == Method::Auto && n <= DENSE_COLUMNS) {
            return None;
        }
        let mut column_of = vec![DROPPED; problem.parameters.len()];
        for (column, &p) in part.parameters.iter().enumerate() {
            column_of[p] = column;
        }
        let mut pieces = Vec::with_capacity(part.blocks.len());
        let mut rows = 0;
        for &b in &part.blocks {
            let block = &problem.blocks[b];
            let Prepared::Blocks(family, prepared) = &block.prepared else {
                return None;
            };
            if block.loss != Loss::Squared || block.family.pattern().is_empty() {
                return None;
            }
            let columns = block.parameters.iter().map(|&p| column_of[p]);
            pieces.push(Piece {
                block: b,
                family: *family,
                prepared,
                sizes: NormalEquations::new(block.family.shape(), block.family.pattern()),
                weights: weights(block),
                columns: columns.chain([n]).collect(),
            });
            rows += block.samples * block.family.shape().residuals;
        }
        let has_priors = content != Content::DataOnly;
        let prior = |(column, &p): (usize, &usize)| {
            let prior = problem.parameters[p].prior.filter(|_| has_priors);
            Some((column, prior?))
        };
        let priors: Vec<_> = (part.parameters.iter().enumerate())
            .filter_map(prior)
            .collect();
        rows += priors.len();
        (asked_for || rows >= TALL * n).then(|| Self {
            problem,
            part: part.clone(),
            pieces,
            priors,
            all: all.to_vec(),
            rows,
            triangle: triangle(n),
            residuals: vec![0.0; n + 1],
            matrix: vec![0.0; (n + 1) * (n + 1)],
            reduction: None,
        })
    }

    /// True if the normal equations were given up for the QR factor of the Jacobian.
    pub(crate) fn is_by_qr(&self) -> bool {
        self.reduction.is_some()
    }

    /// Number of costs: a block of samples that is partly filled has zeros past the last.
    pub(crate) fn cost_count(&self) -> usize {
        let blocks: usize = self.pieces.iter().map(|piece| piece.weights.len()).sum();
        blocks * LANES + self.priors.len()
    }

    /// As [`System::costs`], block by block.
    pub(crate) fn costs(&mut self, x: &[f64], costs: &mut [f64]) -> Result<(), NonFinite> {
        self.scatter(x);
        let mut rest = costs;
        for piece in &self.pieces {
            let (own, others) = rest.split_at_mut(piece.weights.len() * LANES);
            rest = others;
            let range = RANGE * piece.family.shape().residuals;
            let samples = self.problem.blocks[piece.block].samples;
            let parameters = piece.parameters(self.problem, &self.all);
            let mut values = vec![Lanes::ZERO; piece.weights.len().min(range)];
            for (index, costs) in own.as_chunks_mut().0.chunks_mut(range).enumerate() {
                let values = &mut values[..costs.len()];
                if !piece.costs(index, &parameters, values, costs) {
                    return Err(piece.not_finite(index, values, samples));
                }
            }
        }
        for ((column, prior), cost) in self.priors.iter().zip(rest) {
            *cost = prior.cost(x[*column]);
        }
        Ok(())
    }

    /// Fills [`Self::triangle`] and [`Self::residuals`] at the free parameters `x`.
    pub(crate) fn linearize(&mut self, x: &[f64]) -> Result<(), NonFinite> {
        self.scatter(x);
        let n = x.len();
        if self.reduction.is_none() {
            self.accumulate(x);
            if factor(&mut self.matrix, n) {
                let matrix = &self.matrix;
                let entry = |row, column| matrix[row * (n + 1) + column];
                write_triangle(&mut self.triangle, &mut self.residuals, entry);
                return Ok(());
            }
        }
        if !self.reduce(x) {
            // Evaluated once more, it says which number is not finite.
            let all = &self.all;
            System::new(self.problem, &self.part, all, Content::Minimize).linearize(x)?;
        }
        Ok(())
    }

    /// Fills [`Self::triangle`] and [`Self::residuals`] from the rows of the Jacobian; false where a number is not finite.
    fn reduce(&mut self, x: &[f64]) -> bool {
        let n = x.len();
        let reduction = (self.reduction).get_or_insert_with(|| RowReduction::new(self.rows, n + 1));
        reduction.clear();
        let mut is_finite = true;
        let (mut values, mut derivatives) = (Vec::new(), Vec::new());
        for piece in &self.pieces {
            let samples = self.problem.blocks[piece.block].samples;
            let parameters = piece.parameters(self.problem, &self.all);
            let (rows, pattern) = (piece.family.shape().residuals, piece.family.pattern());
            let columns = pattern.columns.iter();
            let columns: Vec<usize> = columns.map(|&own| piece.columns[own as usize]).collect();
            for (range, weights) in piece.weights.chunks(RANGE * rows).enumerate() {
                let blocks = weights.len() / rows;
                values.resize(blocks * rows, Lanes::ZERO);
                derivatives.resize(blocks * pattern.len(), Lanes::ZERO);
                is_finite &= piece.linearize(range, &parameters, &mut values, &mut derivatives);
                let count = (blocks * LANES).min(samples - range * RANGE * LANES);
                for (block, lane) in (0..count).map(|sample| (sample / LANES, sample % LANES)) {
                    let derivatives = &derivatives[block * pattern.len()..][..pattern.len()];
                    let values = &values[block * rows..][..rows];
                    for (value, ends) in values.iter().zip(pattern.row_starts.windows(2)) {
                        let own = ends[0] as usize..ends[1] as usize;
                        let entries = columns[own.clone()].iter().zip(&derivatives[own]);
                        let entries = entries.map(|(&column, own)| (column, own[lane]));
                        let entries = entries.filter(|&(column, _)| column != DROPPED);
                        reduction.push(entries.chain([(n, value[lane])]));
                    }
                }
            }
        }
        for (column, prior) in &self.priors {
            let (slope, r) = (1.0 / prior.sigma, (x[*column] - prior.mean) / prior.sigma);
            reduction.push([(*column, slope), (n, r)].into_iter());
        }
        let factor = reduction.reduce();
        let entry = |row, column| factor[(row, column)];
        write_triangle(&mut self.triangle, &mut self.residuals, entry);
        let mut numbers = self.triangle.values.iter().chain(&self.residuals);
        is_finite && numbers.all(|number| number.is_finite())
    }

    fn scatter(&mut self, x: &[f64]) {
        for (&p, &x) in self.part.parameters.iter().zip(x) {
            self.all[p] = x;
        }
    }

    /// Fills [`Self::matrix`].
    fn accumulate(&mut self, x: &[f64]) {
        let width = x.len() + 1;
        self.matrix.fill(0.0);
        for piece in &self.pieces {
            let parameters = piece.parameters(self.problem, &self.all);
            let residuals = piece.family.shape().residuals;
            let ranges = piece.weights.chunks(RANGE * residuals).enumerate();
            let sums = parallel::map_owned(ranges.collect(), |(index, weights)| {
                piece.sums(index, weights, &parameters)
            });
            for (i, &a) in piece.columns.iter().enumerate() {
                for (j, &b) in piece.columns.iter().enumerate().skip(i) {
                    if a == DROPPED || b == DROPPED {
                        continue;
                    }
                    let index = piece.sizes.index(i, j);
                    let sum: f64 = sums.iter().map(|sums| sums[index].sum()).sum();
                    // Two parameters of the family may be the same unknown.
                    let twice = if a == b && i != j { 2.0 } else { 1.0 };
                    self.matrix[a.min(b) * width + a.max(b)] += twice * sum;
                }
            }
        }
        for (column, prior) in &self.priors {
            let (slope, r) = (1.0 / prior.sigma, (x[*column] - prior.mean) / prior.sigma);
            self.matrix[column * width + column] += slope * slope;
            self.matrix[column * width + width - 1] += slope * r;
            self.matrix[width * width - 1] += r * r;
        }
    }
}

impl Piece<'_> {
    fn parameters(&self, problem: &Problem, all: &[f64]) -> Vec<f64> {
        let indices = &problem.blocks[self.block].parameters;
        indices.iter().map(|&index| all[index]).collect()
    }

    /// Residuals and derivatives of one range, weighted; false where one is not finite.
    fn linearize(
        &self,
        range: usize,
        parameters: &[f64],
        residuals: &mut [Lanes],
        derivatives: &mut [Lanes],
    ) -> bool {
        let (shape, pattern) = (self.family.shape(), self.family.pattern());
        let shares = residuals.chunks_mut(SHARE * shape.residuals);
        let shares = shares.zip(derivatives.chunks_mut(SHARE * pattern.len()));
        let share = |(share, (residuals, derivatives)): (usize, (&mut [Lanes], &mut [Lanes]))| {
            let first = range * RANGE + share * SHARE;
            let count = residuals.len() / shape.residuals;
            let prepared = &self.prepared[first * shape.prepared..][..count * shape.prepared];
            (self.family).linearize_blocks(prepared, parameters, residuals, derivatives);
            let weights = self.weights[first * shape.residuals..].iter();
            let rows = pattern.row_starts.windows(2).cycle();
            let (mut rest, mut is_finite) = (derivatives, true);
            for ((residual, weight), ends) in residuals.iter_mut().zip(weights).zip(rows) {
                let (own, others) = rest.split_at_mut((ends[1] - ends[0]) as usize);
                for numbers in own.iter_mut().chain([residual]) {
                    for (number, weight) in numbers.0.iter_mut().zip(&weight.0) {
                        *number *= weight;
                        is_finite &= number.is_finite();
                    }
                }
                rest = others;
            }
            is_finite
        };
        let are_finite = parallel::map_owned(shares.enumerate().collect(), share);
        are_finite.into_iter().all(|is_finite| is_finite)
    }

    /// Products of the columns over one range.
    fn sums(&self, range: usize, weights: &[Lanes], parameters: &[f64]) -> Vec<Lanes> {
        let width = self.family.shape().prepared;
        let mut sums = vec![Lanes::ZERO; self.sizes.sums()];
        let mut scratch = vec![Lanes::ZERO; self.sizes.scratch()];
        let prepared = &self.prepared[range * RANGE * width..];
        self.sizes.add(
            self.family,
            prepared,
            parameters,
            weights,
            &mut scratch,
            &mut sums,
        );
        sums
    }

    /// Costs of one range's residuals; false where one is not finite.
    fn costs(
        &self,
        range: usize,
        parameters: &[f64],
        values: &mut [Lanes],
        costs: &mut [[f64; LANES]],
    ) -> bool {
        let shape = self.family.shape();
        let first = range * RANGE;
        let count = values.len() / shape.residuals;
        let prepared = &self.prepared[first * shape.prepared..(first + count) * shape.prepared];
        self.family.value_blocks(prepared, parameters, values);
        let weights = &self.weights[first * shape.residuals..];
        let mut is_finite = true;
        for ((costs, value), weight) in costs.iter_mut().zip(values).zip(weights) {
            let whitened: [f64; LANES] = from_fn(|lane| value[lane] * weight[lane]);
            is_finite &= whitened.iter().fold(true, |all, own| all & own.is_finite());
            *costs = whitened.map(|whitened| 0.5 * whitened * whitened);
        }
        is_finite
    }

    /// Place of the first residual of a range that is not finite, in a block of so many samples.
    fn not_finite(&self, range: usize, values: &[Lanes], samples: usize) -> NonFinite {
        let (residuals, first) = (self.family.shape().residuals, range * RANGE);
        let is_wrong = |&index: &usize| {
            let (sample, residual) = (index / residuals, index % residuals);
            let at = sample / LANES * residuals + residual;
            let weight = self.weights[first * residuals + at][sample % LANES];
            !(values[at][sample % LANES] * weight).is_finite()
        };
        let count = (samples - first * LANES).min(values.len() / residuals * LANES) * residuals;
        let index = (0..count).find(is_wrong).unwrap_or_default();
        NonFinite {
            block: self.block,
            sample: first * LANES + index / residuals,
            residual: index % residuals,
            parameter: None,
        }
    }
}

/// An upper triangle of n columns, and a row without entries.
fn triangle(n: usize) -> Jacobian {
    let mut pattern = JacobianPattern::new(n);
    for row in 0..=n {
        let columns: Vec<usize> = (row..n).collect();
        pattern.push_rows(&columns, &[columns.len()]);
    }
    pattern.into_jacobian()
}

/// Writes the rows of an upper triangle `[R c]`.
fn write_triangle(
    triangle: &mut Jacobian,
    residuals: &mut [f64],
    entry: impl Fn(usize, usize) -> f64,
) {
    let n = triangle.column_count;
    let mut place = 0;
    for (row, residual) in residuals.iter_mut().enumerate() {
        for column in row..n {
            triangle.values[place] = entry(row, column);
            place += 1;
        }
        *residual = entry(row, n);
    }
}

/// Weights in the layout of residuals.
fn weights(block: &Block) -> Vec<Lanes> {
    let residuals = block.family.shape().residuals;
    let mut lanes = vec![Lanes::ZERO; block_count(block.samples) * residuals];
    for index in 0..block.samples * residuals {
        let (sample, residual) = (index / residuals, index % residuals);
        lanes[sample / LANES * residuals + residual][sample % LANES] =
            block.weights.get(index).copied().unwrap_or(1.0);
    }
    lanes
}

/// Replaces the upper triangle of a matrix of n + 1 columns by its Cholesky factor; false where rounding
/// may have touched more than a small share of one of the first n pivots.
fn factor(matrix: &mut [f64], n: usize) -> bool {
    let width = n + 1;
    let least = n as f64 * f64::EPSILON / PIVOT_ERROR;
    for row in 0..width {
        let (above, rest) = matrix.split_at_mut(row * width);
        let entries = &mut rest[row..width];
        let whole = entries[0];
        for above in above.chunks_exact(width) {
            let factor = above[row];
            for (entry, other) in entries.iter_mut().zip(&above[row..]) {
                *entry -= factor * other;
            }
        }
        let pivot = entries[0];
        if row == n {
            // Part that no step removes: zero where rounding leaves less.
            entries[0] = pivot.max(0.0).sqrt();
            return pivot.is_finite();
        }
        if !pivot.is_finite() || pivot <= least * whole {
            return false;
        }
        let root = pivot.sqrt();
        for entry in entries {
            *entry /= root;
        }
    }
    true
}
