//! A group of parameters that is eliminated, and what its rows then say of the others.

use faer::Mat;

use crate::jacobian::Jacobian;
use crate::linear::schur::MAX_GROUP;

/// Groups with more rows are kept: the work is quadratic in the rows.
pub(super) const MOST_ROWS: usize = 48;

/// The pattern of a group.
pub(super) struct Pattern {
    /// Columns of the group.
    pub(super) own: usize,
    /// Entries of each row, in order.
    pub(super) rows: Vec<Vec<Entry>>,
    /// Kept columns of each row that has some, ascending.
    pub(super) outer: Vec<Vec<usize>>,
    /// Start of each such row among all kept entries, and their number.
    pub(super) starts: Vec<usize>,
    /// Start of each such row among the products of its kept entries with those of all rows up to it, and
    /// their number.
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

/// Numbers of a group that the Jacobian gives.
pub(super) struct Values<'a> {
    /// Own columns of the rows with kept columns, row-major.
    pub(super) e: &'a [f64],
    /// Kept entries of these rows.
    pub(super) f: &'a [f64],
    /// Residuals of these rows.
    pub(super) r: &'a [f64],
    /// Normal matrix of the other rows.
    pub(super) normal: &'a [f64],
    /// Their gradient.
    pub(super) gradient: &'a [f64],
}

/// Numbers of a group that depend on the damping.
pub(super) struct Factors<'a> {
    /// Cholesky factor L of the group's normal matrix, row-major.
    pub(super) lower: &'a mut [f64],
    /// `L⁻¹Eᵀ`, row-major.
    pub(super) w: &'a mut [f64],
    /// `L⁻¹` times the gradient; after back substitution, the step.
    pub(super) z: &'a mut [f64],
}

/// Sums over the groups of a class.
pub(super) struct Sums {
    pub(super) products: Vec<f64>,
    pub(super) gradient: Vec<f64>,
    /// Room for a row of one group.
    pub(super) scaled: Vec<f64>,
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
            products.push(products[r] + kept.len() * starts[r + 1]);
        }
        Self {
            own,
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

    pub(super) fn values<'a>(&self, values: &'a [f64]) -> Values<'a> {
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

    pub(super) fn factors<'a>(&self, factors: &'a mut [f64]) -> Factors<'a> {
        let (lower, rest) = factors.split_at_mut(self.own * self.own);
        let (w, z) = rest.split_at_mut(self.own * self.outer.len());
        Factors { lower, w, z }
    }

    /// Takes the numbers of a group out of the Jacobian.
    pub(super) fn load(
        &self,
        rows: &[usize],
        jacobian: &Jacobian,
        residuals: &[f64],
        values: &mut [f64],
    ) {
        let (own, outer) = (self.own, self.outer.len());
        values.fill(0.0);
        let (e, rest) = values.split_at_mut(outer * own);
        let (f, rest) = rest.split_at_mut(self.kept_entries());
        let (r, rest) = rest.split_at_mut(outer);
        let (normal, gradient) = rest.split_at_mut(own * own);
        for (k, (&row, entries)) in rows.iter().zip(&self.rows).enumerate() {
            let numbers = jacobian.row(row).1;
            if k < outer {
                r[k] = residuals[row];
                for (entry, &value) in entries.iter().zip(numbers) {
                    match *entry {
                        Entry::Own(column) => e[k * own + column] = value,
                        Entry::Kept(place) => f[place] = value,
                    }
                }
                continue;
            }
            for (first, &value) in entries.iter().zip(numbers) {
                let Entry::Own(i) = *first else { continue };
                gradient[i] += value * residuals[row];
                for (second, &other) in entries.iter().zip(numbers) {
                    if let Entry::Own(j) = *second {
                        normal[i * own + j] += value * other;
                    }
                }
            }
        }
    }

    /// Factors a group, and adds what its rows then say of the kept parameters: for each kept entry its
    /// products with those of all rows up to its own, and its gradient. False if the group is singular.
    pub(super) fn eliminate(
        &self,
        values: &Values<'_>,
        factors: &mut Factors<'_>,
        damping: f64,
        held: impl Fn(usize) -> Option<f64>,
        sums: &mut Sums,
    ) -> bool {
        match self.own {
            2 => self.eliminate_columns(2, values, factors, damping, held, sums),
            3 => self.eliminate_columns(3, values, factors, damping, held, sums),
            6 => self.eliminate_columns(6, values, factors, damping, held, sums),
            own => self.eliminate_columns(own, values, factors, damping, held, sums),
        }
    }

    #[inline(always)]
    #[allow(
        clippy::inline_always,
        reason = "loops over a known number of columns unroll"
    )]
    pub(super) fn eliminate_columns(
        &self,
        own: usize,
        values: &Values<'_>,
        factors: &mut Factors<'_>,
        damping: f64,
        held: impl Fn(usize) -> Option<f64>,
        sums: &mut Sums,
    ) -> bool {
        let outer = self.outer.len();
        let mut fixed = [None; MAX_GROUP];
        let mut right = [0.0; MOST_ROWS];
        right[..outer].copy_from_slice(values.r);
        factors.z.copy_from_slice(values.gradient);
        for (j, fixed) in fixed[..own].iter_mut().enumerate() {
            *fixed = held(j);
            if let Some(y) = *fixed {
                for (row, right) in right[..outer].iter_mut().enumerate() {
                    *right += values.e[row * own + j] * y;
                }
                for (i, z) in factors.z.iter_mut().enumerate() {
                    *z += values.normal[i * own + j] * y;
                }
            }
        }
        for i in 0..own {
            for (row, right) in right[..outer].iter().enumerate() {
                factors.z[i] += values.e[row * own + i] * right;
            }
            for j in 0..=i {
                let mut sum = values.normal[i * own + j];
                for row in values.e.chunks_exact(own) {
                    sum += row[i] * row[j];
                }
                if i == j {
                    sum += damping;
                }
                if fixed[i].is_some() || fixed[j].is_some() {
                    sum = f64::from(u8::from(i == j));
                }
                factors.lower[i * own + j] = sum;
            }
            if fixed[i].is_some() {
                factors.z[i] = 0.0;
            }
        }
        if !cholesky(factors.lower, own) {
            return false;
        }
        forward(factors.lower, own, factors.z);
        let mut column = [0.0; MAX_GROUP];
        for (row, right) in right[..outer].iter_mut().enumerate() {
            let column = &mut column[..own];
            for (i, entry) in column.iter_mut().enumerate() {
                let free = fixed[i].is_none();
                *entry = if free { values.e[row * own + i] } else { 0.0 };
            }
            forward(factors.lower, own, column);
            for (i, &entry) in column.iter().enumerate() {
                factors.w[i * outer + row] = entry;
                *right -= entry * factors.z[i];
            }
        }
        for (r, right) in right[..outer].iter().enumerate() {
            let first = &values.f[self.starts[r]..self.starts[r + 1]];
            for (sum, f) in sums.gradient[self.starts[r]..].iter_mut().zip(first) {
                *sum += f * right;
            }
            // M_rs f_s of all rows s up to this one, side by side: the sums run over long stretches.
            for s in 0..=r {
                let mut m = f64::from(u8::from(r == s));
                for i in 0..own {
                    m -= factors.w[i * outer + r] * factors.w[i * outer + s];
                }
                let range = self.starts[s]..self.starts[s + 1];
                for (scaled, f) in sums.scaled[range.clone()].iter_mut().zip(&values.f[range]) {
                    *scaled = m * f;
                }
            }
            let scaled = &sums.scaled[..self.starts[r + 1]];
            let products = &mut sums.products[self.products[r]..self.products[r + 1]];
            for (products, f) in products.chunks_exact_mut(scaled.len()).zip(first) {
                for (product, scaled) in products.iter_mut().zip(scaled) {
                    *product += f * scaled;
                }
            }
        }
        true
    }

    /// Replaces z by the step, given that of the kept parameters.
    pub(super) fn back_substitute(
        &self,
        values: &Values<'_>,
        factors: &mut Factors<'_>,
        kept: &Mat<f64>,
    ) {
        let outer = self.outer.len();
        for (r, places) in self.outer.iter().enumerate() {
            let entries = &values.f[self.starts[r]..self.starts[r + 1]];
            let image: f64 = entries
                .iter()
                .zip(places)
                .map(|(f, &place)| f * kept[(place, 0)])
                .sum();
            for (z, w) in factors.z.iter_mut().zip(factors.w.chunks_exact(outer)) {
                *z += w[r] * image;
            }
        }
        backward(factors.lower, self.own, factors.z);
        factors.z.iter_mut().for_each(|z| *z = -*z);
    }

    /// Takes `FᵀWᵀx` from a vector over the kept parameters.
    pub(super) fn subtract_influence(&self, f: &[f64], w: &[f64], x: &[f64], kept: &mut [f64]) {
        let outer = self.outer.len();
        for (r, places) in self.outer.iter().enumerate() {
            let image: f64 = x
                .iter()
                .zip(w.chunks_exact(outer))
                .map(|(x, w)| x * w[r])
                .sum();
            let entries = &f[self.starts[r]..self.starts[r + 1]];
            for (f, &place) in entries.iter().zip(places) {
                kept[place] -= f * image;
            }
        }
    }

    /// Adds up products and gradients of kept entries where they belong.
    pub(super) fn scatter(&self, sums: &Sums, normal: &mut Normal) {
        let size = normal.gradient.len();
        let places: Vec<usize> = self.outer.iter().flatten().copied().collect();
        for (&place, &value) in places.iter().zip(&sums.gradient) {
            normal.gradient[place] += value;
        }
        let mut products = sums.products.iter();
        for (r, first) in self.outer.iter().enumerate() {
            for &a in first {
                for (entry, &b) in places[..self.starts[r + 1]].iter().enumerate() {
                    let Some(&product) = products.next() else {
                        return;
                    };
                    let same_row = entry >= self.starts[r];
                    if !same_row && a == b {
                        normal.matrix[a * size + a] += 2.0 * product;
                    } else if !same_row || a >= b {
                        normal.matrix[a.max(b) * size + a.min(b)] += product;
                    }
                }
            }
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

/// Replaces the lower triangle of a matrix by its Cholesky factor; false if it is singular to rounding.
#[inline(always)]
#[allow(
    clippy::inline_always,
    reason = "loops over a known number of columns unroll"
)]
pub(super) fn cholesky(matrix: &mut [f64], size: usize) -> bool {
    for i in 0..size {
        let diagonal = matrix[i * size + i];
        for j in 0..=i {
            let mut sum = matrix[i * size + j];
            for k in 0..j {
                sum -= matrix[i * size + k] * matrix[j * size + k];
            }
            if i > j {
                matrix[i * size + j] = sum / matrix[j * size + j];
            } else if sum > 8.0 * f64::EPSILON * diagonal {
                matrix[i * size + i] = sum.sqrt();
            } else {
                return false;
            }
        }
    }
    true
}

/// Replaces x by `L⁻¹x`.
#[inline(always)]
#[allow(
    clippy::inline_always,
    reason = "loops over a known number of columns unroll"
)]
pub(super) fn forward(lower: &[f64], size: usize, x: &mut [f64]) {
    for i in 0..size {
        let mut sum = x[i];
        for k in 0..i {
            sum -= lower[i * size + k] * x[k];
        }
        x[i] = sum / lower[i * size + i];
    }
}

/// Replaces x by `L⁻ᵀx`.
pub(super) fn backward(lower: &[f64], size: usize, x: &mut [f64]) {
    for i in (0..size).rev() {
        let mut sum = x[i];
        for k in i + 1..size {
            sum -= lower[k * size + i] * x[k];
        }
        x[i] = sum / lower[i * size + i];
    }
}
