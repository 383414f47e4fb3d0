//! Schur elimination of small groups of parameters, by orthogonal transformations.
//!
//! If parameters form many small groups that share no residual (the pose of each sample, the points
//! of a bundle adjustment), each group is eliminated from its own rows, and what the rows still say of
//! the other parameters joins the reduced problem. The elimination is by QR, not by the normal
//! equations (N. Demmel et al., "Square Root Bundle Adjustment for Large-Scale Reconstruction", 2021),
//! and so keeps the accuracy of a dense QR of the whole.

use crate::jacobian::{Jacobian, narrow};
use crate::linear::dense::DampedTriangle;
use crate::linear::qr::{RowReduction, triangularize};
use crate::linear::{LEAST_DAMPING, LinearSolver};

/// Most parameters of a group.
pub(crate) const MAX_GROUP: usize = 12;
/// Numbers of a filled row that are handled at once, as most processors do.
const LANES: usize = 4;

/// No group.
const NONE: u32 = u32::MAX;

/// Choice of the parameters that are eliminated.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Elimination {
    /// Groups of columns that share no row with each other, each ascending.
    pub(crate) groups: Vec<Vec<usize>>,
    /// The other columns, ascending.
    pub(crate) kept: Vec<usize>,
}

impl Elimination {
    /// Finds groups greedily: columns in order of the number of their rows join the groups that they
    /// touch, unless the union would be too large; then they are kept. So are columns in more rows than `most_rows`.
    pub(crate) fn detect(jacobian: &Jacobian, most_rows: u32) -> Self {
        let n = jacobian.column_count;
        let mut counts = vec![0_u32; n];
        for &column in &jacobian.columns {
            counts[column as usize] += 1;
        }
        // Rows of each column that may join, one column after the other.
        let mut ends = Vec::with_capacity(n);
        let mut end = 0;
        for &count in &counts {
            ends.push(end);
            end += if count <= most_rows {
                count as usize
            } else {
                0
            };
        }
        let joins = |column: usize| counts[column] <= most_rows;
        let mut all = vec![0_u32; end];
        for (row, range) in (0_u32..).zip(jacobian.row_starts.windows(2)) {
            for &column in &jacobian.columns[range[0]..range[1]] {
                let column = column as usize;
                if joins(column) {
                    all[ends[column]] = row;
                    ends[column] += 1;
                }
            }
        }
        let rows_of = |column: usize| &all[ends[column] - counts[column] as usize..ends[column]];
        let mut order: Vec<usize> = (0..n).filter(|&column| joins(column)).collect();
        order.sort_by_key(|&column| counts[column]);

        let mut group_of_row = vec![NONE; jacobian.row_count()];
        let mut groups: Vec<Vec<usize>> = Vec::with_capacity(order.len());
        let mut kept: Vec<usize> = (0..n).filter(|&column| !joins(column)).collect();
        let mut touched: Vec<u32> = Vec::new();
        for column in order {
            touched.clear();
            let mut size = 1;
            for &row in rows_of(column) {
                let group = group_of_row[row as usize];
                if group != NONE && !touched.contains(&group) {
                    touched.push(group);
                    size += groups[group as usize].len();
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
                narrow(groups.len() - 1)
            });
            for group in touched.drain(..) {
                let members = std::mem::take(&mut groups[group as usize]);
                for &member in &members {
                    for &row in rows_of(member) {
                        group_of_row[row as usize] = target;
                    }
                }
                groups[target as usize].extend(members);
            }
            groups[target as usize].push(column);
            for &row in rows_of(column) {
                group_of_row[row as usize] = target;
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

    /// Rows by the groups that occur in them.
    pub(crate) fn rows(&self, jacobian: &Jacobian) -> GroupRows {
        let count = self.groups.len();
        let mut group_of = vec![narrow(count); jacobian.column_count];
        for (group, columns) in (0..).zip(&self.groups) {
            for &column in columns {
                group_of[column] = group;
            }
        }
        let group = |row: usize| {
            let columns = jacobian.row(row).0.iter();
            columns.map(|&column| group_of[column as usize]).min()
        };
        let rows = 0..jacobian.row_count();
        let of_rows: Vec<u32> = rows
            .map(|row| group(row).unwrap_or(narrow(count)))
            .collect();
        let mut starts = vec![0; count + 2];
        for &group in &of_rows {
            starts[group as usize + 1] += 1;
        }
        for group in 0..=count {
            starts[group + 1] += starts[group];
        }
        let mut next = starts.clone();
        let mut all = vec![0; of_rows.len()];
        for (row, &group) in of_rows.iter().enumerate() {
            all[next[group as usize]] = row;
            next[group as usize] += 1;
        }
        GroupRows { starts, all }
    }

    /// True if all groups occur in some rows, at most so many.
    pub(crate) fn has_few_rows(&self, jacobian: &Jacobian, most: usize) -> bool {
        let rows = self.rows(jacobian);
        (0..self.groups.len()).all(|group| (1..=most).contains(&rows.of(group).len()))
    }

    /// Keeps the groups that occur in more rows than this.
    pub(crate) fn with_few_rows(mut self, jacobian: &Jacobian, most: usize) -> Self {
        let rows = self.rows(jacobian);
        let mut group = 0;
        self.groups.retain(|columns| {
            let few = (1..=most).contains(&rows.of(group).len());
            group += 1;
            if !few {
                self.kept.extend(columns);
            }
            few
        });
        self.kept.sort_unstable();
        self
    }
}

/// Rows by groups, those of no group last.
pub(crate) struct GroupRows {
    starts: Vec<usize>,
    all: Vec<usize>,
}

impl GroupRows {
    /// Those of a group, ascending; behind the last group, those of none.
    pub(crate) fn of(&self, group: usize) -> &[usize] {
        &self.all[self.starts[group]..self.starts[group + 1]]
    }
}

/// A group of eliminated parameters, with the rows in which they occur.
struct Group {
    columns: Vec<usize>,
    /// Rows: those with kept parameters first.
    rows: Vec<usize>,
    /// Number of rows with kept parameters.
    outer: usize,
    /// Kept parameters in those rows, as indices into the kept ones, ascending.
    others: Vec<usize>,
    /// For each entry of each row its column here: own columns, then others.
    targets: Vec<usize>,
    /// `[R E c]` after QR of the group's rows, row-major: own columns, other columns, residual.
    undamped: Vec<f64>,
    /// The same with damping, and with held columns replaced by unit ones.
    damped: Vec<f64>,
}

/// Solves by elimination of groups and dense QR of the kept parameters.
pub(crate) struct Schur {
    groups: Vec<Group>,
    /// Rows in which no eliminated parameter occurs.
    other_rows: Vec<usize>,
    kept: Vec<usize>,
    /// For each kept column, its place among the kept ones.
    place: Vec<usize>,
    workspace: Workspace,
    /// Information about the kept parameters that is the same for any damping.
    base: RowReduction,
    /// The same with damping or held parameters, if there are any.
    reduced: RowReduction,
    changed: bool,
    damped: DampedTriangle,
    kept_held: Vec<bool>,
    kept_step: Vec<f64>,
}

/// Room for the matrix of one group, for a row of it, and for its reflections.
#[derive(Default)]
struct Workspace {
    matrix: Vec<f64>,
    row: Vec<f64>,
    reflected: Vec<f64>,
}

impl Schur {
    pub(crate) fn new(jacobian: &Jacobian, elimination: Elimination) -> Self {
        let rows = elimination.rows(jacobian);
        let Elimination { groups, kept } = elimination;
        let other_rows = rows.of(groups.len()).to_vec();
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
        let is_kept = |column: usize| group_of[column].is_none();
        let groups = groups.into_iter().enumerate();
        let size = kept.len();
        Self {
            groups: groups
                .map(|(group, columns)| {
                    let rows = rows.of(group).to_vec();
                    Group::new(jacobian, columns, rows, &place, &is_kept)
                })
                .collect(),
            other_rows,
            place,
            workspace: Workspace::default(),
            base: RowReduction::new(jacobian.row_count(), size + 1),
            reduced: RowReduction::new(jacobian.row_count(), size + 1),
            changed: false,
            damped: DampedTriangle::new(size),
            kept_held: vec![false; size],
            kept_step: vec![0.0; size],
            kept,
        }
    }

    /// Eliminates the groups with damping; false if one of them is singular.
    fn eliminate(&mut self, damping: f64, held: &[bool], step: &[f64]) -> bool {
        let size = self.kept.len();
        self.changed = damping != 0.0 || held.contains(&true);
        if !self.changed {
            self.groups.iter_mut().for_each(Group::leave_undamped);
            return self.groups.iter().all(Group::is_regular);
        }
        self.reduced.clear();
        let base = self.base.triangle();
        for row in 0..=size {
            self.reduced
                .push((row..=size).map(|column| (column, base[(row, column)])));
        }
        for group in &mut self.groups {
            group.damp(damping, held, step, &mut self.workspace, &mut self.reduced);
            if !group.is_regular() {
                return false;
            }
        }
        self.reduced.reduce();
        true
    }
}

impl Group {
    fn new(
        jacobian: &Jacobian,
        columns: Vec<usize>,
        mut rows: Vec<usize>,
        place: &[usize],
        is_kept: &impl Fn(usize) -> bool,
    ) -> Self {
        let kept = |row: usize| {
            let columns = jacobian.row(row).0.iter();
            columns
                .map(|&column| column as usize)
                .filter(|&column| is_kept(column))
        };
        rows.sort_by_key(|&row| kept(row).next().is_none());
        let outer = rows.partition_point(|&row| kept(row).next().is_some());
        let mut others: Vec<usize> = rows.iter().flat_map(|&row| kept(row)).collect();
        for column in &mut others {
            *column = place[*column];
        }
        others.sort_unstable();
        others.dedup();
        let target = |&column: &u32| {
            let column = column as usize;
            if is_kept(column) {
                columns.len() + others.partition_point(|&other| other < place[column])
            } else {
                place[column]
            }
        };
        let entries = rows.iter().flat_map(|&row| jacobian.row(row).0);
        let length = columns.len() * (columns.len() + others.len() + 1);
        Self {
            outer,
            targets: entries.map(target).collect(),
            undamped: vec![0.0; length],
            damped: vec![0.0; length],
            columns,
            rows,
            others,
        }
    }

    fn width(&self) -> usize {
        self.columns.len() + self.others.len() + 1
    }

    /// Reduces the group's rows to `[R E c]`; what they say beyond it goes to `rest`.
    fn reduce(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        workspace: &mut Workspace,
        rest: &mut RowReduction,
    ) {
        let (own, width) = (self.columns.len(), self.width());
        // The cost of reflections along filled rows, and that of putting rows together entry by entry.
        let filled = 2 * own * self.rows.len() * self.others.len() / LANES;
        let kept_entries = self.targets.iter().filter(|&&target| target >= own).count();
        if self.outer < self.others.len() && self.rows.len() * kept_entries < filled {
            self.reduce_apart(jacobian, residuals, workspace, rest);
            return;
        }
        let Workspace {
            matrix, reflected, ..
        } = workspace;
        matrix.clear();
        matrix.resize(self.rows.len().max(own) * width, 0.0);
        let mut targets = self.targets.iter();
        let numbers = matrix.chunks_exact_mut(width);
        for (&row, numbers) in self.rows.iter().zip(numbers) {
            for (&value, &target) in jacobian.row(row).1.iter().zip(&mut targets) {
                numbers[target] = value;
            }
            numbers[width - 1] = residuals[row];
        }
        triangularize(matrix, width, own, reflected);
        let (own_rows, others) = matrix.split_at(own * width);
        self.undamped.copy_from_slice(own_rows);
        for row in others.chunks_exact(width) {
            rest.push(self.kept_entries(row, rest.last_column()));
        }
    }

    /// The same where rows have few kept entries each: the reflections are not applied to these, but to unit vectors in
    /// their place, and then the rows are put together.
    fn reduce_apart(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        workspace: &mut Workspace,
        rest: &mut RowReduction,
    ) {
        let (own, width) = (self.columns.len(), self.width());
        let stride = own + self.outer + 1;
        let Workspace {
            matrix,
            row: sums,
            reflected,
        } = workspace;
        matrix.clear();
        matrix.resize(self.rows.len().max(own) * stride, 0.0);
        let mut targets = self.targets.iter();
        let numbers = matrix.chunks_exact_mut(stride).enumerate();
        for (&row, (i, numbers)) in self.rows.iter().zip(numbers) {
            for (&value, &target) in jacobian.row(row).1.iter().zip(&mut targets) {
                if target < own {
                    numbers[target] = value;
                }
            }
            if i < self.outer {
                numbers[own + i] = 1.0;
            }
            numbers[stride - 1] = residuals[row];
        }
        triangularize(matrix, stride, own, reflected);
        for (i, numbers) in matrix.chunks_exact(stride).enumerate() {
            sums.clear();
            sums.extend_from_slice(&numbers[..own]);
            sums.resize(width - 1, 0.0);
            let mut targets = self.targets.iter();
            for (&row, &factor) in self.rows.iter().zip(&numbers[own..stride - 1]) {
                for (&value, &target) in jacobian.row(row).1.iter().zip(&mut targets) {
                    if target >= own {
                        sums[target] += factor * value;
                    }
                }
            }
            sums.push(numbers[stride - 1]);
            if i < own {
                self.undamped[i * width..(i + 1) * width].copy_from_slice(sums);
            } else {
                rest.push(self.kept_entries(sums, rest.last_column()));
            }
        }
    }

    fn leave_undamped(&mut self) {
        self.damped.copy_from_slice(&self.undamped);
    }

    /// Makes [`Self::damped`]; what that says of the kept parameters goes to `rest`.
    fn damp(
        &mut self,
        damping: f64,
        held: &[bool],
        step: &[f64],
        workspace: &mut Workspace,
        rest: &mut RowReduction,
    ) {
        let Workspace {
            matrix, reflected, ..
        } = workspace;
        let (own, width) = (self.columns.len(), self.width());
        if damping == 0.0 && !self.columns.iter().any(|&column| held[column]) {
            self.leave_undamped();
            return;
        }
        matrix.clear();
        matrix.extend_from_slice(&self.undamped);
        matrix.resize(2 * own * width, 0.0);
        for (i, &column) in self.columns.iter().enumerate() {
            matrix[(own + i) * width + i] = if held[column] { 1.0 } else { damping.sqrt() };
            if held[column] {
                for row in matrix[..own * width].chunks_exact_mut(width) {
                    row[width - 1] += row[i] * step[column];
                    row[i] = 0.0;
                }
            }
        }
        triangularize(matrix, width, own, reflected);
        self.damped.copy_from_slice(&matrix[..own * width]);
        for row in matrix[own * width..].chunks_exact(width) {
            rest.push(self.kept_entries(row, rest.last_column()));
        }
    }

    /// A row beyond the group's own columns as entries of the reduced problem.
    fn kept_entries<'m>(
        &'m self,
        row: &'m [f64],
        last: usize,
    ) -> impl Iterator<Item = (usize, f64)> + 'm {
        let columns = self.others.iter().copied().chain(std::iter::once(last));
        columns.zip(row[self.columns.len()..].iter().copied())
    }

    /// True if the triangle has no pivot that is only rounding.
    fn is_regular(&self) -> bool {
        let own = self.columns.len();
        let rows = self.damped.chunks_exact(self.width());
        let diagonal = || rows.clone().enumerate().map(|(i, row)| row[i].abs());
        let least = diagonal().fold(0.0, f64::max) * f64::EPSILON * (8 * own) as f64;
        diagonal().all(|pivot| pivot > least)
    }

    /// The group's step, given that of the kept parameters.
    fn back_substitute(&self, kept: &[f64]) -> [f64; MAX_GROUP] {
        let own = self.columns.len();
        let mut solution = [0.0; MAX_GROUP];
        for (i, row) in self.damped.chunks_exact(self.width()).enumerate().rev() {
            let mut sum = -row[row.len() - 1];
            for (entry, &other) in row[own..].iter().zip(&self.others) {
                sum -= entry * kept[other];
            }
            for j in i + 1..own {
                sum -= row[j] * solution[j];
            }
            solution[i] = sum / row[i];
        }
        solution
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
                .map(|(&column, &value)| (self.place[column as usize], value));
            let last = (size, residuals[row]);
            self.base.push(entries.chain(std::iter::once(last)));
        }
        for group in &mut self.groups {
            group.reduce(jacobian, residuals, &mut self.workspace, &mut self.base);
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
        let reduced = if self.changed {
            &self.reduced
        } else {
            &self.base
        };
        let full_rank = self.damped.solve(
            reduced.triangle(),
            damping,
            &self.kept_held,
            &mut self.kept_step,
        );
        for (i, &column) in self.kept.iter().enumerate() {
            step[column] = self.kept_step[i];
        }
        for group in &self.groups {
            let solution = group.back_substitute(&self.kept_step);
            for (&column, value) in group.columns.iter().zip(solution) {
                if !held[column] {
                    step[column] = value;
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
            let (own, width) = (group.columns.len(), group.width());
            let matrix = &group.damped;
            let mut w = [0.0; MAX_GROUP];
            for (i, row) in matrix.chunks_exact(width).enumerate() {
                let mut sum = v[group.columns[i]];
                for j in 0..i {
                    sum -= matrix[j * width + i] * w[j];
                }
                w[i] = sum / row[i];
                form += w[i] * w[i];
                for (&other, entry) in group.others.iter().zip(&row[own..]) {
                    self.kept_step[other] -= entry * w[i];
                }
            }
        }
        form + self.damped.inverse_form(&self.kept_step)
    }
}
