//! Schur elimination of small groups of parameters, by orthogonal transformations.
//!
//! Where parameters form many small groups that share no residual (the pose of each sample, the points
//! of a bundle adjustment), each group is eliminated from its own rows, and what the rows still say of
//! the other parameters joins the reduced problem. The elimination is by QR, not by the normal
//! equations (N. Demmel et al., "Square Root Bundle Adjustment for Large-Scale Reconstruction", 2021),
//! and so keeps the accuracy of a dense QR of the whole.

use faer::Mat;

use crate::jacobian::Jacobian;
use crate::linear::LinearSolver;
use crate::linear::dense::DampedTriangle;
use crate::linear::qr::{Qr, RowReduction};

/// Most parameters of a group.
pub(crate) const MAX_GROUP: usize = 12;
/// Damping used where a group alone is singular; columns have norm one.
const LEAST_DAMPING: f64 = 1e-14;

/// Which parameters are eliminated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Elimination {
    /// Groups of columns that share no row with each other, each ascending.
    pub(crate) groups: Vec<Vec<usize>>,
    /// The other columns, ascending.
    pub(crate) kept: Vec<usize>,
}

impl Elimination {
    /// Finds groups greedily: columns in order of the number of their rows join the groups that they
    /// touch, unless the union would be too large; then they are kept.
    pub(crate) fn detect(jacobian: &Jacobian) -> Self {
        let n = jacobian.column_count;
        let mut rows_of = vec![Vec::new(); n];
        for row in 0..jacobian.row_count() {
            for &column in jacobian.row(row).0 {
                rows_of[column].push(row);
            }
        }
        let mut order: Vec<usize> = (0..n).collect();
        order.sort_by_key(|&column| rows_of[column].len());

        let mut group_of_row: Vec<Option<usize>> = vec![None; jacobian.row_count()];
        let mut groups: Vec<Vec<usize>> = Vec::new();
        let mut kept = Vec::new();
        for column in order {
            let mut touched: Vec<usize> = Vec::new();
            let mut size = 1;
            for group in rows_of[column].iter().filter_map(|&row| group_of_row[row]) {
                if !touched.contains(&group) {
                    touched.push(group);
                    size += groups[group].len();
                    if size > MAX_GROUP {
                        break;
                    }
                }
            }
            if size > MAX_GROUP {
                kept.push(column);
                continue;
            }
            let target = touched.pop().unwrap_or_else(|| {
                groups.push(Vec::new());
                groups.len() - 1
            });
            for group in touched {
                let members = std::mem::take(&mut groups[group]);
                for &member in &members {
                    for &row in &rows_of[member] {
                        group_of_row[row] = Some(target);
                    }
                }
                groups[target].extend(members);
            }
            groups[target].push(column);
            for &row in &rows_of[column] {
                group_of_row[row] = Some(target);
            }
        }
        groups.retain(|group| !group.is_empty());
        for group in &mut groups {
            group.sort_unstable();
        }
        groups.sort_unstable();
        kept.sort_unstable();
        Self { groups, kept }
    }

    /// Keeps the groups that occur in more rows than this.
    pub(crate) fn with_few_rows(mut self, jacobian: &Jacobian, most: usize) -> Self {
        let mut group_of = vec![usize::MAX; jacobian.column_count];
        for (g, columns) in self.groups.iter().enumerate() {
            for &column in columns {
                group_of[column] = g;
            }
        }
        let mut rows = vec![0; self.groups.len()];
        for row in 0..jacobian.row_count() {
            let columns = jacobian.row(row).0.iter();
            let group = columns.map(|&column| group_of[column]).min();
            if let Some(rows) = group.and_then(|group| rows.get_mut(group)) {
                *rows += 1;
            }
        }
        let mut rows = rows.into_iter();
        self.groups.retain(|columns| {
            let few = rows.next().is_some_and(|rows| (1..=most).contains(&rows));
            if !few {
                self.kept.extend(columns);
            }
            few
        });
        self.kept.sort_unstable();
        self
    }
}

/// A group of eliminated parameters, with the rows in which they occur.
struct Group {
    columns: Vec<usize>,
    rows: Vec<usize>,
    /// Kept parameters in those rows, as indices into the kept ones, ascending.
    others: Vec<usize>,
    /// `[R E c]` after QR of the group's rows: own columns, other columns, residual.
    undamped: Mat<f64>,
    /// The same with damping, and with held columns replaced by unit ones.
    damped: Mat<f64>,
}

/// Solves by elimination of groups and dense QR of the kept parameters.
pub(crate) struct Schur {
    groups: Vec<Group>,
    /// Rows in which no eliminated parameter occurs.
    other_rows: Vec<usize>,
    kept: Vec<usize>,
    /// For each column, its place among its group's columns or among the kept ones.
    place: Vec<usize>,
    group_of: Vec<Option<usize>>,
    workspace: Qr,
    /// What is known of the kept parameters whatever the damping.
    base: RowReduction,
    reduced: RowReduction,
    damped: DampedTriangle,
    kept_held: Vec<bool>,
    kept_step: Vec<f64>,
}

impl Schur {
    pub(crate) fn new(jacobian: &Jacobian, elimination: Elimination) -> Self {
        let Elimination { groups, kept } = elimination;
        let n = jacobian.column_count;
        let mut place = vec![0; n];
        let mut group_of = vec![None; n];
        for (g, columns) in groups.iter().enumerate() {
            for (i, &column) in columns.iter().enumerate() {
                (place[column], group_of[column]) = (i, Some(g));
            }
        }
        for (i, &column) in kept.iter().enumerate() {
            place[column] = i;
        }
        let mut groups: Vec<Group> = groups
            .into_iter()
            .map(|columns| Group {
                columns,
                rows: Vec::new(),
                others: Vec::new(),
                undamped: Mat::new(),
                damped: Mat::new(),
            })
            .collect();
        let mut other_rows = Vec::new();
        for row in 0..jacobian.row_count() {
            let columns = jacobian.row(row).0;
            let Some(g) = columns.iter().find_map(|&column| group_of[column]) else {
                other_rows.push(row);
                continue;
            };
            groups[g].rows.push(row);
            let others = columns.iter().filter(|&&column| group_of[column].is_none());
            groups[g].others.extend(others.map(|&column| place[column]));
        }
        let (mut most_rows, mut most_columns) = (0, 0);
        for group in &mut groups {
            group.others.sort_unstable();
            group.others.dedup();
            let (own, width) = (group.columns.len(), group.width());
            group.undamped = Mat::zeros(own, width);
            group.damped = Mat::zeros(own, width);
            most_rows = most_rows.max(group.rows.len()).max(2 * own);
            most_columns = most_columns.max(width);
        }
        let size = kept.len();
        Self {
            groups,
            other_rows,
            place,
            group_of,
            workspace: Qr::new(most_rows, most_columns),
            base: RowReduction::new(jacobian.row_count(), size + 1),
            reduced: RowReduction::new(jacobian.row_count(), size + 1),
            damped: DampedTriangle::new(size),
            kept_held: vec![false; size],
            kept_step: vec![0.0; size],
            kept,
        }
    }

    /// Eliminates the groups with damping; false if one of them is singular.
    fn eliminate(&mut self, damping: f64, held: &[bool], step: &[f64]) -> bool {
        let size = self.kept.len();
        self.reduced.clear();
        let base = self.base.triangle();
        for row in 0..=size {
            self.reduced
                .push((row..=size).map(|column| (column, base[(row, column)])));
        }
        for group in &mut self.groups {
            let (own, width) = (group.columns.len(), group.width());
            let any_held = group.columns.iter().any(|&column| held[column]);
            if damping == 0.0 && !any_held {
                group.damped.copy_from(&group.undamped);
            } else {
                let matrix = &mut self.workspace.matrix;
                for column in 0..width {
                    for row in 0..own {
                        matrix[(row, column)] = group.undamped[(row, column)];
                        matrix[(own + row, column)] = 0.0;
                    }
                }
                for (i, &column) in group.columns.iter().enumerate() {
                    matrix[(own + i, i)] = if held[column] { 1.0 } else { damping.sqrt() };
                    if held[column] {
                        for row in 0..own {
                            matrix[(row, width - 1)] += matrix[(row, i)] * step[column];
                            matrix[(row, i)] = 0.0;
                        }
                    }
                }
                self.workspace.factor(2 * own, width);
                let matrix = &self.workspace.matrix;
                group
                    .damped
                    .copy_from(matrix.as_ref().submatrix(0, 0, own, width));
                for row in own..width.min(2 * own) {
                    self.reduced.push(group.reduced_row(matrix, row, size));
                }
            }
            let diagonal = |i| group.damped[(i, i)].abs();
            let largest = (0..own).map(diagonal).fold(0.0, f64::max);
            let least = largest * f64::EPSILON * (8 * own) as f64;
            if (0..own).any(|i| diagonal(i) <= least) {
                return false;
            }
        }
        self.reduced.reduce();
        true
    }
}

impl Group {
    fn width(&self) -> usize {
        self.columns.len() + self.others.len() + 1
    }

    /// A row of a group's matrix beyond its own columns, as a row of the reduced problem.
    fn reduced_row<'m>(
        &'m self,
        matrix: &'m Mat<f64>,
        row: usize,
        size: usize,
    ) -> impl Iterator<Item = (usize, f64)> + 'm {
        let own = self.columns.len();
        let targets = self.others.iter().copied().chain(std::iter::once(size));
        targets
            .enumerate()
            .map(move |(i, column)| (column, matrix[(row, own + i)]))
    }
}

impl LinearSolver for Schur {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        let size = self.kept.len();
        self.base.clear();
        for &row in &self.other_rows {
            let (columns, values) = jacobian.row(row);
            let entries = columns
                .iter()
                .zip(values)
                .map(|(&column, &value)| (self.place[column], value));
            let last = (size, residuals[row]);
            self.base.push(entries.chain(std::iter::once(last)));
        }
        for group in &mut self.groups {
            let (own, width, rows) = (group.columns.len(), group.width(), group.rows.len());
            let matrix = &mut self.workspace.matrix;
            for column in 0..width {
                for row in 0..rows.max(own) {
                    matrix[(row, column)] = 0.0;
                }
            }
            for (i, &row) in group.rows.iter().enumerate() {
                let (columns, values) = jacobian.row(row);
                for (&column, &value) in columns.iter().zip(values) {
                    let place = self.place[column];
                    let target = if self.group_of[column].is_some() {
                        place
                    } else {
                        own + group.others.partition_point(|&other| other < place)
                    };
                    matrix[(i, target)] = value;
                }
                matrix[(i, width - 1)] = residuals[row];
            }
            self.workspace.factor(rows.max(own), width);
            let matrix = &self.workspace.matrix;
            group
                .undamped
                .copy_from(matrix.as_ref().submatrix(0, 0, own, width));
            for row in own..width.min(rows) {
                self.base.push(group.reduced_row(matrix, row, size));
            }
        }
        self.base.reduce();
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) -> bool {
        let regular = self.eliminate(damping, held, step);
        if !regular {
            self.eliminate(damping.max(LEAST_DAMPING), held, step);
        }
        for (i, &column) in self.kept.iter().enumerate() {
            self.kept_held[i] = held[column];
            self.kept_step[i] = step[column];
        }
        let full_rank = self.damped.solve(
            self.reduced.triangle(),
            damping,
            &self.kept_held,
            &mut self.kept_step,
        );
        for (i, &column) in self.kept.iter().enumerate() {
            step[column] = self.kept_step[i];
        }
        for group in &self.groups {
            let own = group.columns.len();
            let matrix = &group.damped;
            let mut solution = [0.0; MAX_GROUP];
            for i in (0..own).rev() {
                let mut sum = -matrix[(i, group.width() - 1)];
                for (o, &other) in group.others.iter().enumerate() {
                    sum -= matrix[(i, own + o)] * self.kept_step[other];
                }
                for j in i + 1..own {
                    sum -= matrix[(i, j)] * solution[j];
                }
                solution[i] = sum / matrix[(i, i)];
                if !held[group.columns[i]] {
                    step[group.columns[i]] = solution[i];
                }
            }
        }
        regular && full_rank
    }

    fn inverse_form(&mut self, v: &[f64]) -> f64 {
        for (i, &column) in self.kept.iter().enumerate() {
            self.kept_step[i] = v[column];
        }
        let mut form = 0.0;
        for group in &self.groups {
            let own = group.columns.len();
            let matrix = &group.damped;
            let mut w = [0.0; MAX_GROUP];
            for i in 0..own {
                let mut sum = v[group.columns[i]];
                for j in 0..i {
                    sum -= matrix[(j, i)] * w[j];
                }
                w[i] = sum / matrix[(i, i)];
                form += w[i] * w[i];
                for (o, &other) in group.others.iter().enumerate() {
                    self.kept_step[other] -= matrix[(i, own + o)] * w[i];
                }
            }
        }
        form + self.damped.inverse_form(&self.kept_step)
    }
}
