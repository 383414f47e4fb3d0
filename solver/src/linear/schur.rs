//! Elimination of small groups of parameters, by normal equations.
//!
//! With E the columns of a group and F the kept columns in its rows, what the rows say of the kept
//! parameters is `Fᵀ M F` with `M = I − E (EᵀE)⁻¹ Eᵀ`. Rows touch few kept parameters each, so it is summed
//! up row by row with row, `M_rs f_r f_sᵀ`, without ever filling a row of the kept columns; groups of the
//! same pattern stand side by side and share one sum. Rows without kept parameters (priors) only add to `EᵀE`.
//!
//! Memory is linear in the number of groups. Groups are handed out to threads in portions that do not
//! depend on how many there are, and portions are added in order: results repeat bit for bit.

use std::collections::BTreeMap;

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use tau_runtime::{LANES, Lanes, block_count};

use crate::jacobian::Jacobian;
use crate::linear::elimination::{Elimination, MAX_GROUP};
use crate::linear::group::{Normal, Pattern};
use crate::linear::{LEAST_DAMPING, LinearSolver};
use crate::parallel;

/// Blocks of groups of a class that are summed up together.
const CHUNK: usize = 32;
/// Most portions of the work, each with a sum of its own.
const PORTIONS: usize = 32;

/// Groups of the same pattern, one after the other in each array.
struct Class {
    pattern: Pattern,
    /// Columns of each group.
    columns: Vec<usize>,
    /// Rows of each group: those with kept columns first.
    rows: Vec<u32>,
    numbers: Vec<Numbers>,
}

/// Numbers of [`CHUNK`] blocks of groups that stand side by side.
struct Numbers {
    /// Those of each block that the Jacobian gives.
    values: Vec<Lanes>,
    /// Those that depend on the damping.
    factors: Vec<Lanes>,
}

/// Some groups of a class.
struct Portion<'a> {
    pattern: &'a Pattern,
    rows: &'a [u32],
    numbers: &'a mut Numbers,
}

/// Solves by elimination of groups and a dense Cholesky factorisation of the kept parameters.
pub(super) struct Schur {
    classes: Vec<Class>,
    /// Rows in which no eliminated parameter occurs.
    other_rows: Vec<u32>,
    kept: Vec<usize>,
    /// Place of each kept column among these.
    kept_places: Vec<usize>,
    /// Information of the other rows on the kept parameters.
    base: Normal,
    factor: Option<Llt<f64>>,
    /// Right-hand side of the kept parameters, then their step.
    kept_step: Mat<f64>,
    /// Damping with which all is factored, if no column was held.
    factored: Option<f64>,
}

impl Class {
    fn portions(&mut self) -> impl Iterator<Item = Portion<'_>> {
        let pattern = &self.pattern;
        let rows = self.rows.chunks(CHUNK * LANES * pattern.rows.len());
        let own = rows.zip(&mut self.numbers);
        own.map(move |(rows, numbers)| Portion {
            pattern,
            rows,
            numbers,
        })
    }

    /// Makes room for the numbers of all groups.
    fn make_room(&mut self) {
        let blocks = block_count(self.columns.len() / self.pattern.own);
        let firsts: Vec<usize> = (0..blocks).step_by(CHUNK).collect();
        let (values, factors) = (self.pattern.values_len(), self.pattern.factors_len());
        self.numbers = parallel::map(&firsts, |first| {
            let count = CHUNK.min(blocks - first);
            Numbers {
                values: vec![Lanes::ZERO; count * values],
                factors: vec![Lanes::ZERO; count * factors],
            }
        });
    }
}

/// Work on each portion, put together so that there are not too many results.
fn on_portions<R: Send>(
    classes: &mut [Class],
    start: impl Fn() -> R + Sync,
    work: impl Fn(Portion, &mut R) + Sync,
) -> Vec<R> {
    let all: Vec<Portion<'_>> = classes.iter_mut().flat_map(Class::portions).collect();
    let together = all.len().div_ceil(PORTIONS).max(1);
    let mut all = all.into_iter().peekable();
    let mut parts: Vec<Vec<Portion>> = Vec::new();
    while all.peek().is_some() {
        parts.push(all.by_ref().take(together).collect());
    }
    parallel::map_owned(parts, |portions| {
        let mut result = start();
        for portion in portions {
            work(portion, &mut result);
        }
        result
    })
}

impl Schur {
    /// Sorts the groups by their patterns.
    pub(super) fn new(jacobian: &Jacobian, elimination: Elimination) -> Self {
        let Elimination { groups, kept, rows } = elimination;
        // The place of each column in its group, and behind all of these that among the kept ones.
        let mut codes = vec![0; jacobian.column_count];
        for (place, &column) in kept.iter().enumerate() {
            codes[column] = MAX_GROUP + place;
        }
        for (place, &column) in groups.iter().flat_map(|columns| columns.iter().enumerate()) {
            codes[column] = place;
        }
        let has_kept = |&row: &u32| {
            let mut columns = jacobian.row(row as usize).0.iter();
            columns.any(|&column| codes[column as usize] >= MAX_GROUP)
        };
        let mut class_of: BTreeMap<Vec<usize>, usize> = BTreeMap::new();
        let mut classes: Vec<Class> = Vec::new();
        let (mut key, mut last_key, mut last_class) = (vec![], vec![], 0);
        for (group, columns) in groups.iter().enumerate() {
            let (mut of_group, inner): (Vec<u32>, Vec<u32>) =
                rows.of(group).iter().partition(|row| has_kept(row));
            of_group.extend(inner);
            // Rows one after the other; the group's size and their lengths, so that they can be told apart.
            key.clear();
            key.push(columns.len());
            for &row in &of_group {
                let columns = jacobian.row(row as usize).0;
                key.push(columns.len());
                key.extend(columns.iter().map(|&column| codes[column as usize]));
            }
            // Mostly a group is like the one before.
            if key != last_key {
                last_class = *class_of.entry(key.clone()).or_insert_with(|| {
                    classes.push(Class {
                        pattern: Pattern::new(columns.len(), &key[1..]),
                        columns: Vec::new(),
                        rows: Vec::new(),
                        numbers: Vec::new(),
                    });
                    classes.len() - 1
                });
                last_key.clone_from(&key);
            }
            classes[last_class].columns.extend_from_slice(columns);
            classes[last_class].rows.extend(of_group);
        }
        classes.iter_mut().for_each(Class::make_room);
        for code in &mut codes {
            *code = code.saturating_sub(MAX_GROUP);
        }
        Self {
            classes,
            other_rows: rows.of(groups.len()).to_vec(),
            kept_places: codes,
            base: Normal::new(kept.len()),
            kept_step: Mat::zeros(kept.len(), 1),
            factor: None,
            factored: None,
            kept,
        }
    }

    /// Eliminates and factors; false if something is not positive definite.
    fn factor(&mut self, damping: f64, held: &[bool], step: &[f64]) -> bool {
        let size = self.kept.len();
        self.factored = None;
        let start = || (Normal::new(size), true);
        let sums = on_portions(&mut self.classes, start, |portion, (sum, is_regular)| {
            *is_regular = *is_regular && portion.eliminate(damping, sum);
        });
        let mut normal = self.base.clone();
        for (sum, is_regular) in &sums {
            if !is_regular {
                return false;
            }
            normal.add(sum);
        }
        let held = |place: usize| held[self.kept[place]];
        for i in 0..size {
            self.kept_step[(i, 0)] = -normal.gradient[i];
            normal.matrix[i * size + i] += damping;
        }
        let entry = |i: usize, j: usize| normal.matrix[i.max(j) * size + i.min(j)];
        for j in (0..size).filter(|&j| held(j)) {
            for i in 0..size {
                self.kept_step[(i, 0)] -= entry(i, j) * step[self.kept[j]];
            }
        }
        for j in (0..size).filter(|&j| held(j)) {
            self.kept_step[(j, 0)] = step[self.kept[j]];
        }
        let matrix = Mat::from_fn(size, size, |i, j| {
            if held(i) || held(j) {
                f64::from(u8::from(i == j))
            } else {
                entry(i, j)
            }
        });
        self.factor = matrix.llt(Side::Lower).ok();
        let Some(factor) = &self.factor else {
            return false;
        };
        factor.solve_in_place(self.kept_step.as_mut());
        let is_finite = (0..size).all(|place| self.kept_step[(place, 0)].is_finite());
        self.factored = (is_finite && !(0..size).any(held)).then_some(damping);
        is_finite
    }

    /// Information of the rows in which no eliminated parameter occurs.
    fn load_other_rows(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        let size = self.kept.len();
        self.base.matrix.fill(0.0);
        self.base.gradient.fill(0.0);
        for &row in &self.other_rows {
            let (columns, values) = jacobian.row(row as usize);
            for (i, (&first, &value)) in columns.iter().zip(values).enumerate() {
                let first = self.kept_places[first as usize];
                self.base.gradient[first] += value * residuals[row as usize];
                for (&second, &other) in columns[..=i].iter().zip(values) {
                    let second = self.kept_places[second as usize];
                    self.base.matrix[first * size + second] += value * other;
                }
            }
        }
    }

    /// Steps of the groups, given that of the kept parameters, and all entries that are not held.
    fn back_substitute(&mut self, step: &mut [f64]) {
        let kept_step = self.kept_step.col_as_slice(0);
        on_portions(
            &mut self.classes,
            || (),
            |portion, ()| portion.back_substitute(kept_step),
        );
        for (&column, own) in self.kept.iter().zip(kept_step) {
            step[column] = *own;
        }
        for Class {
            pattern,
            columns,
            numbers,
            ..
        } in &self.classes
        {
            let factors = numbers
                .iter()
                .flat_map(|own| own.factors.chunks(pattern.factors_len()));
            for (columns, factors) in columns.chunks(LANES * pattern.own).zip(factors) {
                let steps = pattern.steps(factors);
                for (place, &column) in columns.iter().enumerate() {
                    step[column] = steps[place % pattern.own][place / pattern.own];
                }
            }
        }
    }
}

impl<'a> Portion<'a> {
    /// Rows, values and factors of each block.
    fn blocks(self) -> impl Iterator<Item = (&'a [u32], &'a mut [Lanes], &'a mut [Lanes])> {
        let pattern = self.pattern;
        let values = self.numbers.values.chunks_exact_mut(pattern.values_len());
        let factors = self.numbers.factors.chunks_exact_mut(pattern.factors_len());
        let rows = self.rows.chunks(LANES * pattern.rows.len());
        (rows.zip(values).zip(factors)).map(|((rows, values), factors)| (rows, values, factors))
    }

    fn load(self, jacobian: &Jacobian, residuals: &[f64]) {
        let pattern = self.pattern;
        for (rows, values, _) in self.blocks() {
            pattern.load(rows, jacobian, residuals, values);
        }
    }

    /// Factors, and adds what the rows then say of the kept parameters; false if a group is singular.
    fn eliminate(self, damping: f64, normal: &mut Normal) -> bool {
        let pattern = self.pattern;
        let mut sums = vec![Lanes::ZERO; pattern.sums_len()];
        for (_, values, factors) in self.blocks() {
            if !pattern.eliminate(values, factors, damping, &mut sums) {
                return false;
            }
        }
        pattern.scatter(&sums, normal);
        true
    }

    /// Takes other residuals, and what they say of the kept parameters from `right`.
    fn substitute(self, jacobian: &Jacobian, residuals: &[f64], right: &mut [f64]) {
        let pattern = self.pattern;
        let mut sums = vec![Lanes::ZERO; pattern.kept_entries()];
        for (rows, values, factors) in self.blocks() {
            pattern.load_residuals(rows, jacobian, residuals, values);
            pattern.substitute(values, factors, &mut sums);
        }
        pattern.subtract(&sums, right);
    }

    fn back_substitute(self, kept: &[f64]) {
        let pattern = self.pattern;
        for (_, values, factors) in self.blocks() {
            pattern.back_substitute(values, factors, kept);
        }
    }
}

impl LinearSolver for Schur {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        let load = |portion: Portion, (): &mut ()| portion.load(jacobian, residuals);
        on_portions(&mut self.classes, || (), load);
        self.factored = None;
        self.load_other_rows(jacobian, residuals);
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) {
        let mut used = damping;
        let mut is_solved = self.factor(used, held, step);
        while !is_solved && used < 1.0 {
            used = f64::max(LEAST_DAMPING, 100.0 * used);
            is_solved = self.factor(used, held, step);
        }
        if is_solved {
            self.back_substitute(step);
        }
    }

    fn solve_again(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        damping: f64,
        held: &[bool],
        step: &mut [f64],
    ) {
        let Some(factor) = self
            .factor
            .take()
            .filter(|_| self.factored == Some(damping))
        else {
            self.load(jacobian, residuals);
            return self.solve(damping, held, step);
        };
        self.load_other_rows(jacobian, residuals);
        let size = self.kept.len();
        let substitute = |portion: Portion, right: &mut Vec<f64>| {
            portion.substitute(jacobian, residuals, right);
        };
        let of_portions = on_portions(&mut self.classes, || vec![0.0; size], substitute);
        for place in 0..size {
            let less = of_portions.iter().map(|right| right[place]);
            let right = less.fold(-self.base.gradient[place], |sum, own| sum + own);
            self.kept_step[(place, 0)] = right;
        }
        factor.solve_in_place(self.kept_step.as_mut());
        self.factor = Some(factor);
        self.back_substitute(step);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const GROUPS: usize = 21;
    const KEPT: usize = 3;

    /// Numbers without pattern, between −1 and 1.
    fn numbers(count: usize, seed: u64) -> Vec<f64> {
        let mut state = seed;
        let mut next = || {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1);
            (state >> 40) as f64 / f64::from(1 << 23) - 1.0
        };
        (0..count).map(|_| next()).collect()
    }

    /// Groups of two columns in three rows with kept ones each and a row of their own, and a row of kept columns alone.
    fn jacobian() -> Jacobian {
        let mut jacobian = Jacobian::new(KEPT + 2 * GROUPS);
        for group in 0..GROUPS {
            let own = KEPT + 2 * group;
            for row in 0..3 {
                jacobian.push_rows(&[row, own, own + 1], &[3]);
            }
            jacobian.push_rows(&[own], &[1]);
        }
        jacobian.push_rows(&[0, 1, 2], &[3]);
        jacobian.values = numbers(jacobian.columns.len(), 1);
        jacobian
    }

    #[test]
    fn other_residuals_are_solved_for_with_the_factor_at_hand() {
        let jacobian = jacobian();
        let (rows, columns) = (jacobian.row_count(), jacobian.column_count);
        let (first, other) = (numbers(rows, 2), numbers(rows, 3));
        for held in [None, Some(1)] {
            let mut is_held = vec![false; columns];
            is_held[..KEPT].fill(true);
            let solver = || Schur::new(&jacobian, Elimination::detect(&jacobian, &is_held));
            assert_eq!(solver().kept, [0, 1, 2]);
            let held: Vec<bool> = (0..columns).map(|column| Some(column) == held).collect();
            for damping in [0.0, 0.3, 0.7] {
                let (mut fresh, mut at_hand) = (vec![0.1; columns], vec![0.1; columns]);
                let mut linear = solver();
                linear.load(&jacobian, &other);
                linear.solve(damping, &held, &mut fresh);

                let mut linear = solver();
                linear.load(&jacobian, &first);
                linear.solve(0.3, &held, &mut at_hand);
                linear.solve_again(&jacobian, &other, damping, &held, &mut at_hand);
                assert_eq!(at_hand, fresh, "damping {damping}");
            }
        }
    }
}
