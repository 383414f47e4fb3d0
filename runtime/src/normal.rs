//! Normal equations of a residual family, accumulated without storing its Jacobian.
//!
//! A few blocks at a time are linearised into scratch space that stays in the first cache, and products of columns
//! are added to sums in lanes, for any family that has blocks: no code per family.

use crate::lanes::{Kernel, LANES, Lanes, vectorized};
use crate::{BlockFamily, Pattern, Shape};

/// Blocks that are linearised before their products are added: few enough to stay in the first cache.
const CHUNK: usize = 8;
/// Columns that one column is multiplied with at once: as many sums as registers hold.
const TILE: usize = 4;

/// One number of each sample of a chunk.
type Column = [Lanes; CHUNK];

/// Sizes of the normal equations of a family.
///
/// They are the products of the weighted Jacobian's columns and of the weighted residuals: the upper
/// triangle of `[J r]ᵀ [J r]`, row by row. With n parameters that is JᵀJ, with Jᵀr as its column n, and
/// rᵀr as the last entry. Entries that are structurally zero stay as they were.
///
/// Products are summed per lane, and over the lanes at the end: the order, and so the rounding, is the
/// same on every machine.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NormalEquations {
    parameters: usize,
    residuals: usize,
    entries: usize,
    longest_row: usize,
}

impl NormalEquations {
    /// The sizes for a family of this shape and pattern.
    pub fn new(shape: Shape, pattern: Pattern<'_>) -> Self {
        let rows = pattern.row_starts.windows(2);
        Self {
            parameters: shape.parameters,
            residuals: shape.residuals,
            entries: pattern.len(),
            longest_row: rows
                .map(|row| (row[1] - row[0]) as usize)
                .max()
                .unwrap_or(0),
        }
    }

    /// Number of sums.
    pub const fn sums(&self) -> usize {
        (self.parameters + 1) * (self.parameters + 2) / 2
    }

    /// Index of the product of columns `i ≤ j`; column n are the residuals.
    pub const fn index(&self, i: usize, j: usize) -> usize {
        i * (2 * self.parameters + 1 - i) / 2 + j
    }

    /// Length of the scratch space that [`Self::add`] needs.
    pub const fn scratch(&self) -> usize {
        CHUNK * (self.residuals + self.entries + self.longest_row + 1)
    }

    /// Adds the products of as many blocks as `weights` holds to `sums`.
    ///
    /// `weights` has one weight per residual, 1/sigma of its noise, laid out as residuals are; lanes
    /// past the last sample must have weight zero.
    ///
    /// # Panics
    /// If a slice has the wrong length, or the sizes are those of another family.
    pub fn add(
        &self,
        family: &dyn BlockFamily,
        prepared: &[Lanes],
        parameters: &[f64],
        weights: &[Lanes],
        scratch: &mut [Lanes],
        sums: &mut [Lanes],
    ) {
        let width = family.shape().prepared;
        let (residuals, scratch) = scratch.split_at_mut(CHUNK * self.residuals);
        let (jacobian, columns) = scratch.split_at_mut(CHUNK * self.entries);
        for (chunk, weights) in weights.chunks(CHUNK * self.residuals).enumerate() {
            let blocks = weights.len() / self.residuals;
            let first = chunk * CHUNK;
            let residuals = &mut residuals[..weights.len()];
            let jacobian = &mut jacobian[..blocks * self.entries];
            family.linearize_blocks(
                &prepared[first * width..(first + blocks) * width],
                parameters,
                residuals,
                jacobian,
            );
            for row in 0..self.residuals {
                let products = Products {
                    sizes: self,
                    row,
                    pattern: family.pattern(),
                    residuals,
                    jacobian,
                };
                vectorized(products, weights, &[], columns, sums);
            }
        }
    }
}

/// Adds the products of one residual's columns over a chunk.
struct Products<'a> {
    sizes: &'a NormalEquations,
    row: usize,
    pattern: Pattern<'a>,
    residuals: &'a [Lanes],
    jacobian: &'a [Lanes],
}

impl Kernel for Products<'_> {
    #[inline(always)]
    fn run(self, weights: &[Lanes], _: &[f64], columns: &mut [Lanes], sums: &mut [Lanes]) {
        let NormalEquations {
            parameters,
            residuals,
            entries,
            ..
        } = *self.sizes;
        let start = self.pattern.row_starts[self.row] as usize;
        let end = self.pattern.row_starts[self.row + 1] as usize;
        let indices = &self.pattern.columns[start..end];
        let weights = (weights, self.row, residuals);
        // The residual is the last column.
        let (columns, _) = columns[..(indices.len() + 1) * CHUNK].as_chunks_mut::<CHUNK>();
        if let Some((last, columns)) = columns.split_last_mut() {
            weigh((self.residuals, self.row, residuals), weights, last);
            for (entry, column) in columns.iter_mut().enumerate() {
                weigh((self.jacobian, start + entry, entries), weights, column);
            }
        }
        let index = |column: usize| {
            indices
                .get(column)
                .map_or(parameters, |&index| index as usize)
        };
        for (a, left) in columns.iter().enumerate() {
            let start = index(a);
            let (tiles, rest) = columns[a..].as_chunks::<TILE>();
            for (tile, rights) in tiles.iter().enumerate() {
                let products = products(left, rights);
                for (b, product) in products.iter().enumerate() {
                    let column = index(a + tile * TILE + b);
                    add(&mut sums[self.sizes.index(start, column)], product);
                }
            }
            for (b, right) in rest.iter().enumerate() {
                let [product] = products(left, core::array::from_ref(right));
                let column = index(columns.len() - rest.len() + b);
                add(&mut sums[self.sizes.index(start, column)], &product);
            }
        }
    }
}

/// Numbers, the first wanted, and the distance to that of the next block.
type Strided<'a> = (&'a [Lanes], usize, usize);

/// Writes weighted values block after block, and zero for missing blocks.
#[inline(always)]
fn weigh(
    (values, first_value, value_step): Strided<'_>,
    (weights, first_weight, weight_step): Strided<'_>,
    column: &mut Column,
) {
    let blocks = weights.len() / weight_step;
    for (block, column) in column.iter_mut().enumerate() {
        let mut product = Lanes::ZERO;
        if block < blocks {
            let value = values[first_value + block * value_step];
            let weight = weights[first_weight + block * weight_step];
            for lane in 0..LANES {
                product[lane] = value[lane] * weight[lane];
            }
        }
        *column = product;
    }
}

/// Lane by lane, the products of one column with several, summed over the chunk.
#[inline(always)]
fn products<const N: usize>(left: &Column, rights: &[Column; N]) -> [Lanes; N] {
    let mut sums = [Lanes::ZERO; N];
    // The loop's length is kept from the compiler: unrolled, it runs out of registers.
    for block in 0..core::hint::black_box(CHUNK) {
        for (sum, right) in sums.iter_mut().zip(rights) {
            for lane in 0..LANES {
                sum[lane] += left[block][lane] * right[block][lane];
            }
        }
    }
    sums
}

#[inline(always)]
fn add(sum: &mut Lanes, term: &Lanes) {
    for lane in 0..LANES {
        sum[lane] += term[lane];
    }
}
