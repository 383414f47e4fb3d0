//! Groups of parameters that are eliminated, and what their rows then say of the others.
//!
//! Groups of one pattern stand side by side, a lane each, so that all operations are those of vectors.

use tau_runtime::{Kernel, LANES, Lanes, vectorized};

use crate::jacobian::Jacobian;
use crate::linear::elimination::MAX_GROUP;

/// The pattern of a block of groups.
pub(super) struct Pattern {
    /// Columns of the group.
    pub(super) own: usize,
    /// Entries of each row, in order.
    pub(super) rows: Vec<Vec<Entry>>,
    /// Place among the values of each entry of the rows that have kept columns.
    places: Vec<usize>,
    /// Kept columns of each row that has some, ascending.
    pub(super) outer: Vec<Vec<usize>>,
    /// Start of each such row among all kept entries, and their number.
    pub(super) starts: Vec<usize>,
    /// Start of each such row among the products of each of its kept entries with all up to it, and their number.
    pub(super) products: Vec<usize>,
}

/// Column of an entry of a row.
#[derive(Clone, Copy)]
pub(super) enum Entry {
    /// Column of the group.
    Own(usize),
    /// Kept entry, counted over all rows.
    Kept(usize),
}

/// Numbers of a block of groups that the Jacobian gives.
#[derive(Clone, Copy)]
pub(super) struct Values<'a> {
    /// Own columns of the rows with kept columns, row-major.
    e: &'a [Lanes],
    /// Kept entries of these rows.
    f: &'a [Lanes],
    /// Residuals of these rows.
    r: &'a [Lanes],
    /// Normal matrix of the other rows.
    normal: &'a [Lanes],
    /// Their gradient.
    gradient: &'a [Lanes],
}

/// Numbers of a block of groups that depend on the damping.
struct Factors<'a> {
    /// Cholesky factor L of the group's normal matrix, row-major.
    lower: &'a mut [Lanes],
    /// `L⁻¹Eᵀ`, row-major.
    w: &'a mut [Lanes],
    /// `L⁻¹` times the gradient; after back substitution, the step.
    z: &'a mut [Lanes],
}

/// Information of groups about the kept parameters: lower triangle of the normal matrix, and gradient.
#[derive(Clone)]
pub(super) struct Normal {
    pub(super) matrix: Vec<f64>,
    pub(super) gradient: Vec<f64>,
}

impl Pattern {
    /// From the rows, each as the number of its entries and their codes: own columns below [`MAX_GROUP`],
    /// kept places from there on.
    pub(super) fn new(own: usize, mut code: &[usize]) -> Self {
        let (mut rows, mut outer, mut starts) = (Vec::new(), Vec::new(), vec![0]);
        let mut count = 0;
        while let Some((&length, rest)) = code.split_first() {
            let (codes, others) = rest.split_at(length);
            code = others;
            let mut kept = Vec::new();
            let entries = codes.iter().map(|&code| {
                if code < MAX_GROUP {
                    Entry::Own(code)
                } else {
                    kept.push(code - MAX_GROUP);
                    Entry::Kept(count + kept.len() - 1)
                }
            });
            rows.push(entries.collect());
            if !kept.is_empty() {
                count += kept.len();
                starts.push(count);
                outer.push(kept);
            }
        }
        let mut products = vec![0];
        for (r, kept) in outer.iter().enumerate() {
            let count = kept.len();
            products.push(products[r] + count * starts[r] + count * (count + 1) / 2);
        }
        let place = |(row, entry): (usize, &Entry)| match *entry {
            Entry::Own(column) => row * own + column,
            Entry::Kept(place) => outer.len() * own + place,
        };
        let entries = rows[..outer.len()].iter().enumerate();
        let entries = entries
            .flat_map(|(row, own): (usize, &Vec<Entry>)| own.iter().map(move |entry| (row, entry)));
        Self {
            own,
            places: entries.map(place).collect(),
            rows,
            outer,
            starts,
            products,
        }
    }

    pub(super) fn kept_entries(&self) -> usize {
        self.starts[self.outer.len()]
    }

    pub(super) fn values_len(&self) -> usize {
        let outer = self.outer.len();
        outer * self.own + self.kept_entries() + outer + self.own * self.own + self.own
    }

    pub(super) fn factors_len(&self) -> usize {
        self.own * (self.own + self.outer.len() + 1)
    }

    fn values<'a>(&self, values: &'a [Lanes]) -> Values<'a> {
        let outer = self.outer.len();
        let (e, rest) = values.split_at(outer * self.own);
        let (f, rest) = rest.split_at(self.kept_entries());
        let (r, rest) = rest.split_at(outer);
        let (normal, gradient) = rest.split_at(self.own * self.own);
        Values {
            e,
            f,
            r,
            normal,
            gradient,
        }
    }

    fn factors<'a>(&self, factors: &'a mut [Lanes]) -> Factors<'a> {
        let (lower, rest) = factors.split_at_mut(self.own * self.own);
        let (w, z) = rest.split_at_mut(self.own * self.outer.len());
        Factors { lower, w, z }
    }

    /// The steps of the groups of a block, after back substitution.
    pub(super) fn steps<'a>(&self, factors: &'a [Lanes]) -> &'a [Lanes] {
        &factors[factors.len() - self.own..]
    }

    /// Length of the sums over blocks, and of the room that the work on one takes.
    pub(super) fn sums_len(&self) -> usize {
        let outer = self.outer.len();
        self.products[outer] + 2 * self.kept_entries() + outer + 1
    }

    /// Takes the numbers of a block of groups, at most as many as there are lanes, out of the Jacobian; `rows` are those of
    /// one group after the other. Lanes past the end are groups of unit columns that touch nothing.
    pub(super) fn load(
        &self,
        rows: &[u32],
        jacobian: &Jacobian,
        residuals: &[f64],
        values: &mut [Lanes],
    ) {
        let (own, outer) = (self.own, self.outer.len());
        let groups = rows.len() / self.rows.len();
        // Groups overwrite all but what they sum up.
        let sums = if groups == LANES {
            outer * own + self.kept_entries() + outer
        } else {
            0
        };
        values[sums..].fill(Lanes::ZERO);
        for (lane, rows) in rows.chunks_exact(self.rows.len()).enumerate() {
            let mut places = self.places.iter();
            for &row in &rows[..outer] {
                for (&value, &place) in jacobian.row(row as usize).1.iter().zip(&mut places) {
                    values[place][lane] = value;
                }
            }
        }
        let (_, rest) = values.split_at_mut(outer * own + self.kept_entries() + outer);
        let (normal, _) = rest.split_at_mut(own * own);
        for pivot in normal.iter_mut().step_by(own + 1) {
            pivot.0[groups..].fill(1.0);
        }
        for (lane, rows) in rows.chunks_exact(self.rows.len()).enumerate() {
            for (&row, entries) in rows.iter().zip(&self.rows).skip(outer) {
                let numbers = jacobian.row(row as usize).1;
                let of_own = |(entry, &value): (&Entry, &f64)| match *entry {
                    Entry::Own(column) => Some((column, value)),
                    Entry::Kept(_) => None,
                };
                let of_own = entries.iter().zip(numbers).filter_map(of_own);
                for (i, value) in of_own.clone() {
                    for (j, other) in of_own.clone() {
                        normal[i * own + j][lane] += value * other;
                    }
                }
            }
        }
        self.load_residuals(rows, jacobian, residuals, values);
    }

    /// Takes other residuals beside the numbers of the Jacobian.
    pub(super) fn load_residuals(
        &self,
        rows: &[u32],
        jacobian: &Jacobian,
        residuals: &[f64],
        values: &mut [Lanes],
    ) {
        let (own, outer) = (self.own, self.outer.len());
        let (others, gradient) = values.split_at_mut(values.len() - own);
        let of_rows = &mut others[outer * own + self.kept_entries()..][..outer];
        gradient.fill(Lanes::ZERO);
        for (lane, rows) in rows.chunks_exact(self.rows.len()).enumerate() {
            for (r, &row) in of_rows.iter_mut().zip(rows) {
                r[lane] = residuals[row as usize];
            }
            for (&row, entries) in rows.iter().zip(&self.rows).skip(outer) {
                for (entry, &value) in entries.iter().zip(jacobian.row(row as usize).1) {
                    if let Entry::Own(column) = *entry {
                        gradient[column][lane] += value * residuals[row as usize];
                    }
                }
            }
        }
    }

    /// Factors a block of groups, and adds to `sums` what their rows then say of the kept parameters: for each kept entry
    /// its products with all up to it, and its gradient. False if a group is singular.
    pub(super) fn eliminate(
        &self,
        values: &[Lanes],
        factors: &mut [Lanes],
        damping: f64,
        sums: &mut [Lanes],
    ) -> bool {
        vectorized(Eliminate(self), values, &[damping], factors, sums);
        sums[sums.len() - 1] == Lanes::ZERO
    }

    /// Makes z of a block of groups that was factored before for other residuals, and adds to `sums` the gradient for each
    /// kept entry.
    pub(super) fn substitute(&self, values: &[Lanes], factors: &mut [Lanes], sums: &mut [Lanes]) {
        vectorized(Substitute(self), values, &[], factors, sums);
    }

    /// Replaces z by the step, given that of the kept parameters.
    pub(super) fn back_substitute(&self, values: &[Lanes], factors: &mut [Lanes], kept: &[f64]) {
        vectorized(BackSubstitute(self), values, kept, factors, &mut []);
    }

    /// Takes the sums for kept entries from a vector over the kept parameters.
    pub(super) fn subtract(&self, sums: &[Lanes], kept: &mut [f64]) {
        for (sum, &place) in sums.iter().zip(self.outer.iter().flatten()) {
            kept[place] -= sum.sum();
        }
    }

    /// Adds up products and gradients of kept entries where they belong.
    pub(super) fn scatter(&self, sums: &[Lanes], normal: &mut Normal) {
        let size = normal.gradient.len();
        let places: Vec<usize> = self.outer.iter().flatten().copied().collect();
        let (products, gradient) = sums.split_at(self.products[self.outer.len()]);
        for (&place, value) in places.iter().zip(gradient) {
            normal.gradient[place] += value.sum();
        }
        let mut products = products.iter().map(Lanes::sum);
        for (r, first) in self.outer.iter().enumerate() {
            for (i, &a) in first.iter().enumerate() {
                let own = self.starts[r] + i;
                for (entry, &b) in places[..=own].iter().enumerate() {
                    let Some(product) = products.next() else {
                        return;
                    };
                    let is_twice = entry != own && a == b;
                    let times = if is_twice { 2.0 } else { 1.0 };
                    normal.matrix[a.max(b) * size + a.min(b)] += times * product;
                }
            }
        }
    }
}

/// Elimination of a block of groups.
struct Eliminate<'a>(&'a Pattern);

impl Kernel for Eliminate<'_> {
    #[inline(always)]
    fn run(self, values: &[Lanes], parameters: &[f64], factors: &mut [Lanes], sums: &mut [Lanes]) {
        let &[damping] = parameters else { return };
        // Loops over a known number of columns unroll.
        match self.0.own {
            2 => self.0.eliminate_columns(2, values, damping, factors, sums),
            3 => self.0.eliminate_columns(3, values, damping, factors, sums),
            6 => self.0.eliminate_columns(6, values, damping, factors, sums),
            own => self
                .0
                .eliminate_columns(own, values, damping, factors, sums),
        }
    }
}

impl Pattern {
    /// Adds the kept entries of a row, of all `f`, times a factor.
    #[inline(always)]
    fn add_row(&self, row: usize, f: &[Lanes], factor: Lanes, sums: &mut [Lanes]) {
        let range = self.starts[row]..self.starts[row + 1];
        for (sum, f) in sums[range.clone()].iter_mut().zip(&f[range]) {
            *sum = plus(*sum, *f, factor);
        }
    }

    #[inline(always)]
    fn eliminate_columns(
        &self,
        own: usize,
        values: &[Lanes],
        damping: f64,
        factors: &mut [Lanes],
        sums: &mut [Lanes],
    ) {
        let (outer, entries) = (self.outer.len(), self.kept_entries());
        let values = self.values(values);
        let Factors { lower, w, z } = self.factors(factors);
        let (products, rest) = sums.split_at_mut(self.products[outer]);
        let (gradient, rest) = rest.split_at_mut(entries);
        let (scaled, rest) = rest.split_at_mut(entries);
        let (right, irregular) = rest.split_at_mut(outer);
        for i in 0..own {
            for j in 0..=i {
                let mut sum = values.normal[i * own + j];
                for row in values.e.chunks_exact(own) {
                    sum = plus(sum, row[i], row[j]);
                }
                if i == j {
                    sum = plus(sum, Lanes::splat(1.0), Lanes::splat(damping));
                }
                lower[i * own + j] = sum;
            }
        }
        cholesky(lower, own, &mut irregular[0]);
        gradient_forward(own, values, lower, z);
        let mut column = [Lanes::ZERO; MAX_GROUP];
        for (row, right) in right.iter_mut().enumerate() {
            let column = &mut column[..own];
            column.copy_from_slice(&values.e[row * own..][..own]);
            forward(lower, own, column);
            *right = values.r[row];
            for (i, &entry) in column.iter().enumerate() {
                w[i * outer + row] = entry;
                *right = minus(*right, entry, z[i]);
            }
        }
        for (r, right) in right.iter().enumerate() {
            let first = &values.f[self.starts[r]..self.starts[r + 1]];
            for (sum, f) in gradient[self.starts[r]..].iter_mut().zip(first) {
                *sum = plus(*sum, *f, *right);
            }
            // M_rs f_s of all rows s up to this one, side by side: the sums run over long stretches.
            for s in 0..=r {
                let mut m = Lanes::splat(f64::from(u8::from(r == s)));
                for i in 0..own {
                    m = minus(m, w[i * outer + r], w[i * outer + s]);
                }
                let range = self.starts[s]..self.starts[s + 1];
                for (scaled, f) in scaled[range.clone()].iter_mut().zip(&values.f[range]) {
                    *scaled = plus(Lanes::ZERO, m, *f);
                }
            }
            let mut rest = &mut products[self.products[r]..self.products[r + 1]];
            for (i, f) in first.iter().enumerate() {
                let (products, others) = rest.split_at_mut(self.starts[r] + i + 1);
                for (product, scaled) in products.iter_mut().zip(&*scaled) {
                    *product = plus(*product, *f, *scaled);
                }
                rest = others;
            }
        }
    }
}

/// Forward substitution of residuals in a block of groups.
struct Substitute<'a>(&'a Pattern);

impl Kernel for Substitute<'_> {
    #[inline(always)]
    fn run(self, values: &[Lanes], _: &[f64], factors: &mut [Lanes], sums: &mut [Lanes]) {
        let (pattern, outer) = (self.0, self.0.outer.len());
        let values = pattern.values(values);
        let Factors { lower, w, z } = pattern.factors(factors);
        gradient_forward(pattern.own, values, lower, z);
        for (r, residual) in values.r.iter().enumerate() {
            let mut right = *residual;
            for (z, w) in z.iter().zip(w.chunks_exact(outer)) {
                right = minus(right, w[r], *z);
            }
            pattern.add_row(r, values.f, right, sums);
        }
    }
}

/// Back substitution in a block of groups; the kept parameters' step are the parameters.
struct BackSubstitute<'a>(&'a Pattern);

impl Kernel for BackSubstitute<'_> {
    #[inline(always)]
    fn run(self, values: &[Lanes], kept: &[f64], factors: &mut [Lanes], _: &mut [Lanes]) {
        let (pattern, outer) = (self.0, self.0.outer.len());
        let values = pattern.values(values);
        let Factors { lower, w, z } = pattern.factors(factors);
        for (r, places) in pattern.outer.iter().enumerate() {
            let entries = &values.f[pattern.starts[r]..pattern.starts[r + 1]];
            let mut image = Lanes::ZERO;
            for (f, &place) in entries.iter().zip(places) {
                image = plus(image, *f, Lanes::splat(kept[place]));
            }
            for (z, w) in z.iter_mut().zip(w.chunks_exact(outer)) {
                *z = plus(*z, w[r], image);
            }
        }
        let own = pattern.own;
        for i in (0..own).rev() {
            let mut sum = z[i];
            for k in i + 1..own {
                sum = minus(sum, lower[k * own + i], z[k]);
            }
            z[i] = over(sum, lower[i * own + i]);
        }
        for z in z.iter_mut() {
            *z = minus(Lanes::ZERO, *z, Lanes::splat(1.0));
        }
    }
}

impl Normal {
    pub(super) fn new(size: usize) -> Self {
        Self {
            matrix: vec![0.0; size * size],
            gradient: vec![0.0; size],
        }
    }

    pub(super) fn add(&mut self, other: &Self) {
        for (sum, term) in self.matrix.iter_mut().zip(&other.matrix) {
            *sum += term;
        }
        for (sum, term) in self.gradient.iter_mut().zip(&other.gradient) {
            *sum += term;
        }
    }
}

/// Replaces the lower triangles of matrices by their Cholesky factors; `irregular` becomes other than zero where one is
/// singular to rounding.
#[inline(always)]
fn cholesky(matrix: &mut [Lanes], size: usize, irregular: &mut Lanes) {
    for i in 0..size {
        let diagonal = matrix[i * size + i];
        for j in 0..=i {
            let mut sum = matrix[i * size + j];
            for k in 0..j {
                sum = minus(sum, matrix[i * size + k], matrix[j * size + k]);
            }
            matrix[i * size + j] = if i > j {
                over(sum, matrix[j * size + j])
            } else {
                for lane in 0..LANES {
                    let is_regular = sum[lane] > 8.0 * f64::EPSILON * diagonal[lane];
                    irregular[lane] += if is_regular { 0.0 } else { 1.0 };
                }
                Lanes(std::array::from_fn(|lane| sum[lane].sqrt()))
            };
        }
    }
}

/// Replaces x by `L⁻¹x`.
#[inline(always)]
fn forward(lower: &[Lanes], size: usize, x: &mut [Lanes]) {
    for i in 0..size {
        let mut sum = x[i];
        for k in 0..i {
            sum = minus(sum, lower[i * size + k], x[k]);
        }
        x[i] = over(sum, lower[i * size + i]);
    }
}

/// Replaces z by `L⁻¹` times the gradient of groups.
#[inline(always)]
fn gradient_forward(own: usize, values: Values<'_>, lower: &[Lanes], z: &mut [Lanes]) {
    z.copy_from_slice(values.gradient);
    for (i, z) in z.iter_mut().enumerate() {
        for (row, r) in values.r.iter().enumerate() {
            *z = plus(*z, values.e[row * own + i], *r);
        }
    }
    forward(lower, own, z);
}

/// `sum + a b`.
#[inline(always)]
fn plus(sum: Lanes, a: Lanes, b: Lanes) -> Lanes {
    Lanes(std::array::from_fn(|lane| sum[lane] + a[lane] * b[lane]))
}

/// `sum − a b`.
#[inline(always)]
fn minus(sum: Lanes, a: Lanes, b: Lanes) -> Lanes {
    Lanes(std::array::from_fn(|lane| sum[lane] - a[lane] * b[lane]))
}

/// `a / b`.
#[inline(always)]
fn over(a: Lanes, b: Lanes) -> Lanes {
    Lanes(std::array::from_fn(|lane| a[lane] / b[lane]))
}
