//! Sparse Cholesky factorisation of the normal equations; symbolic analysis once.

use std::fmt;

use faer::dyn_stack::{MemBuffer, MemStack, StackReq};
use faer::linalg::cholesky::llt::factor::LltRegularization;
use faer::sparse::linalg::cholesky::{
    CholeskySymbolicParams, LltRef, SymbolicCholesky, SymmetricOrdering,
    factorize_symbolic_cholesky,
};
use faer::sparse::{SparseColMatRef, SymbolicSparseColMat};
use faer::{Conj, Mat, Par, Side, Spec};

use crate::Error;
use crate::jacobian::Jacobian;
use crate::linear::{LEAST_DAMPING, LinearSolver};

/// Factors `JᵀJ + damping I` by a sparse Cholesky factorisation.
pub(crate) struct SparseCholesky {
    /// Lower triangle of the normal matrix by columns, diagonal first.
    pattern: SymbolicSparseColMat<usize>,
    normal: Vec<f64>,
    /// For each pair of entries of each Jacobian row, its place in the normal matrix.
    places: Vec<usize>,
    gradient: Vec<f64>,
    damped: Vec<f64>,
    symbolic: SymbolicCholesky<usize>,
    factor: Vec<f64>,
    rhs: Mat<f64>,
    memory: MemBuffer,
}

impl fmt::Debug for SparseCholesky {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SparseCholesky")
            .field("columns", &self.gradient.len())
            .field("entries", &self.factor.len())
            .finish_non_exhaustive()
    }
}

impl SparseCholesky {
    /// Analyses the pattern of `jacobian`.
    pub(crate) fn new(jacobian: &Jacobian) -> Result<Self, Error> {
        let n = jacobian.column_count;
        let mut pairs: Vec<(usize, usize)> = (0..n).map(|column| (column, column)).collect();
        for_each_pair(jacobian, |column, row, _| pairs.push((column, row)));
        pairs.sort_unstable();
        pairs.dedup();
        let mut places = Vec::new();
        let mut starts = vec![0; n + 1];
        for &(column, _) in &pairs {
            starts[column + 1] += 1;
        }
        for column in 0..n {
            starts[column + 1] += starts[column];
        }
        let rows: Vec<usize> = pairs.iter().map(|&(_, row)| row).collect();
        for_each_pair(jacobian, |column, row, _| {
            let start = starts[column];
            let place = rows[start..starts[column + 1]].partition_point(|&r| r < row);
            places.push(start + place);
        });
        let entries = rows.len();
        let pattern = SymbolicSparseColMat::new_checked(n, n, starts, None, rows);
        let symbolic = factorize_symbolic_cholesky(
            pattern.as_ref(),
            Side::Lower,
            SymmetricOrdering::Amd,
            CholeskySymbolicParams::default(),
        )
        .map_err(|_| Error::TooLarge)?;
        let memory = MemBuffer::try_new(StackReq::any_of(&[
            symbolic.factorize_numeric_llt_scratch::<f64>(Par::Seq, Spec::default()),
            symbolic.solve_in_place_scratch::<f64>(1, Par::Seq),
        ]))
        .map_err(|_| Error::TooLarge)?;
        Ok(Self {
            normal: vec![0.0; entries],
            places,
            gradient: vec![0.0; n],
            damped: vec![0.0; entries],
            factor: vec![0.0; symbolic.len_val()],
            rhs: Mat::zeros(n, 1),
            pattern,
            symbolic,
            memory,
        })
    }

    /// Factors with the columns held replaced by unit ones; false if not positive definite.
    fn factor(&mut self, damping: f64, held: &[bool]) -> bool {
        let (starts, rows) = (self.pattern.col_ptr(), self.pattern.row_idx());
        for column in 0..held.len() {
            let range = starts[column]..starts[column + 1];
            for place in range.clone() {
                let dropped = held[column] || held[rows[place]];
                self.damped[place] = if dropped { 0.0 } else { self.normal[place] };
            }
            self.damped[range.start] += if held[column] { 1.0 } else { damping };
        }
        self.symbolic
            .factorize_numeric_llt(
                &mut self.factor,
                SparseColMatRef::new(self.pattern.as_ref(), &self.damped),
                Side::Lower,
                LltRegularization::default(),
                Par::Seq,
                MemStack::new(&mut self.memory),
                Spec::default(),
            )
            .is_ok()
            && self.factor.iter().all(|value| value.is_finite())
    }

    /// Factors `JᵀJ`; false if it is not positive definite.
    pub(crate) fn factor_undamped(&mut self, jacobian: &Jacobian, residuals: &[f64]) -> bool {
        self.load(jacobian, residuals);
        self.factor(0.0, &vec![false; jacobian.column_count])
    }

    /// An entry of the inverse of the matrix factored last.
    pub(crate) fn inverse_entry(&self, row: usize, column: usize) -> f64 {
        let mut unit = Mat::zeros(self.gradient.len(), 1);
        unit[(column, 0)] = 1.0;
        let scratch = self.symbolic.solve_in_place_scratch::<f64>(1, Par::Seq);
        LltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            unit.as_mut(),
            Par::Seq,
            MemStack::new(&mut MemBuffer::new(scratch)),
        );
        unit[(row, 0)]
    }

    /// Replaces [`Self::rhs`] by the solution.
    fn back_substitute(&mut self) {
        LltRef::new(&self.symbolic, &self.factor).solve_in_place_with_conj(
            Conj::No,
            self.rhs.as_mut(),
            Par::Seq,
            MemStack::new(&mut self.memory),
        );
    }
}

impl LinearSolver for SparseCholesky {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        jacobian.transpose_times(residuals, &mut self.gradient);
        self.normal.fill(0.0);
        let mut places = self.places.iter();
        for_each_pair(jacobian, |_, _, product| {
            if let Some(&place) = places.next() {
                self.normal[place] += product;
            }
        });
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) -> bool {
        let mut used = damping;
        while !self.factor(used, held) && used < 1.0 {
            used = f64::max(LEAST_DAMPING, 100.0 * used);
        }
        let (starts, rows) = (self.pattern.col_ptr(), self.pattern.row_idx());
        for (j, &gradient) in self.gradient.iter().enumerate() {
            self.rhs[(j, 0)] = -gradient;
        }
        for column in 0..held.len() {
            let range = starts[column]..starts[column + 1];
            for (&row, entry) in rows[range.clone()].iter().zip(&self.normal[range]) {
                if held[column] {
                    self.rhs[(row, 0)] -= entry * step[column];
                }
                if held[row] && row != column {
                    self.rhs[(column, 0)] -= entry * step[row];
                }
            }
        }
        for (j, _) in held.iter().enumerate().filter(|(_, held)| **held) {
            self.rhs[(j, 0)] = 0.0;
        }
        self.back_substitute();
        for (j, step) in step.iter_mut().enumerate() {
            if !held[j] {
                *step = self.rhs[(j, 0)];
            }
        }
        // A factorisation without pivoting cannot vouch for rank unless damped.
        used == damping && damping > 0.0
    }

    fn inverse_form(&mut self, v: &[f64]) -> f64 {
        for (j, &v) in v.iter().enumerate() {
            self.rhs[(j, 0)] = v;
        }
        self.back_substitute();
        (0..v.len()).map(|j| v[j] * self.rhs[(j, 0)]).sum()
    }
}

/// Calls `visit(column, row, product)` for each pair of entries of each Jacobian row, row ≥ column.
fn for_each_pair(jacobian: &Jacobian, mut visit: impl FnMut(usize, usize, f64)) {
    for row in 0..jacobian.row_count() {
        let (columns, values) = jacobian.row(row);
        for i in 0..columns.len() {
            for j in 0..=i {
                visit(
                    columns[j] as usize,
                    columns[i] as usize,
                    values[i] * values[j],
                );
            }
        }
    }
}
