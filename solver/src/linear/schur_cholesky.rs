//! Schur elimination of small groups of parameters, by normal equations.
//!
//! With E the columns of a group and F the kept columns in its rows, what the rows say of the kept
//! parameters is `Fᵀ M F` with `M = I − E (EᵀE)⁻¹ Eᵀ`. Rows touch few kept parameters each, so it is summed
//! up row by row with row, `M_rs f_r f_sᵀ`, without ever filling a row of the kept columns; groups of the
//! same pattern stand side by side and share one sum. Rows without kept parameters (priors) only add to `EᵀE`.
//!
//! Memory is linear in the number of groups. Groups are handed out to threads in portions that do not
//! depend on how many there are, and portions are added in order: results repeat bit for bit.

use std::collections::BTreeMap;
use std::fmt;

use faer::linalg::solvers::{Llt, Solve};
use faer::{Mat, Side};
use tau_runtime::{LANES, Lanes, block_count};

use crate::jacobian::{Jacobian, narrow};
use crate::linear::group::{MOST_ROWS, Normal, Pattern};
use crate::linear::schur::{Elimination, MAX_GROUP};
use crate::linear::{LEAST_DAMPING, LinearSolver};
use crate::parallel;
use crate::vector::{at_once, on_each};

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
    rows: Vec<usize>,
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
    columns: &'a [usize],
    rows: &'a [usize],
    values: &'a mut [Lanes],
    factors: &'a mut [Lanes],
}

/// Place of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    /// Among the kept ones.
    Kept(u32),
    /// In a group of a class.
    Eliminated { class: u32, group: u32, place: u32 },
}

/// Solves by elimination of groups and a dense Cholesky factorisation of the kept parameters.
pub(crate) struct SchurCholesky {
    classes: Vec<Class>,
    /// Rows in which no eliminated parameter occurs.
    other_rows: Vec<usize>,
    kept: Vec<usize>,
    /// Of each column.
    places: Vec<Place>,
    /// Information of the other rows about the kept parameters.
    base: Normal,
    factor: Option<Llt<f64>>,
    kept_step: Mat<f64>,
    /// Damping with which all is factored, if no column was held.
    factored: Option<f64>,
    /// True if all is factored without damping or held columns, and nothing was solved since.
    is_undamped: bool,
}

impl fmt::Debug for SchurCholesky {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("SchurCholesky")
            .field("classes", &self.classes.len())
            .field("kept", &self.kept.len())
            .finish_non_exhaustive()
    }
}

impl Class {
    fn groups(&self) -> usize {
        self.columns.len() / self.pattern.own
    }

    fn portions(&mut self) -> impl Iterator<Item = Portion<'_>> {
        let pattern = &self.pattern;
        let columns = self.columns.chunks(CHUNK * LANES * pattern.own);
        let rows = self.rows.chunks(CHUNK * LANES * pattern.rows.len());
        (columns.zip(rows).zip(&mut self.numbers)).map(move |((columns, rows), numbers)| Portion {
            pattern,
            columns,
            rows,
            values: &mut numbers.values,
            factors: &mut numbers.factors,
        })
    }

    /// Values and factors of a block.
    fn block(&self, index: usize) -> (&[Lanes], &[Lanes]) {
        let (values, factors) = (self.pattern.values_len(), self.pattern.factors_len());
        let (numbers, index) = (&self.numbers[index / CHUNK], index % CHUNK);
        (
            &numbers.values[index * values..(index + 1) * values],
            &numbers.factors[index * factors..(index + 1) * factors],
        )
    }

    /// Makes room for the numbers of all groups.
    fn make_room(&mut self) {
        let blocks = block_count(self.groups());
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

    /// Those of all blocks.
    fn blocks(&self) -> impl Iterator<Item = (&[Lanes], &[Lanes])> {
        (0..block_count(self.groups())).map(|index| self.block(index))
    }
}

/// The work in portions, put together so that there are not too many sums.
fn portions(classes: &mut [Class]) -> Vec<Vec<Portion<'_>>> {
    let all: Vec<Portion<'_>> = classes.iter_mut().flat_map(Class::portions).collect();
    let together = all.len().div_ceil(PORTIONS).max(1);
    let mut all = all.into_iter().peekable();
    let mut parts = Vec::new();
    while all.peek().is_some() {
        parts.push(all.by_ref().take(together).collect());
    }
    parts
}

impl SchurCholesky {
    /// Elimination of this method: small groups with few rows.
    pub(crate) fn elimination(jacobian: &Jacobian) -> Elimination {
        Elimination::detect(jacobian, narrow(MOST_ROWS)).with_few_rows(jacobian, MOST_ROWS)
    }

    /// Sorts the groups by their patterns.
    pub(crate) fn new(jacobian: &Jacobian, elimination: &Elimination) -> Self {
        let n = jacobian.column_count;
        let kept = elimination.kept.clone();
        let mut places = vec![Place::Kept(0); n];
        // The place of each column in its group, and behind all of these that among the kept ones.
        let mut codes = vec![0; n];
        for (place, &column) in (0..).zip(&kept) {
            places[column] = Place::Kept(place);
            codes[column] = MAX_GROUP + place as usize;
        }
        for columns in &elimination.groups {
            for (place, &column) in columns.iter().enumerate() {
                codes[column] = place;
            }
        }
        let rows_of = elimination.rows(jacobian);
        let mut class_of: BTreeMap<Vec<usize>, usize> = BTreeMap::new();
        let (mut rows, mut inner, mut key) = (vec![], vec![], vec![]);
        let mut classes: Vec<Class> = Vec::new();
        // Mostly a group is like the one before.
        let (mut last_key, mut last_class) = (vec![], 0);
        for (group, columns) in elimination.groups.iter().enumerate() {
            rows.clear();
            inner.clear();
            for &row in rows_of.of(group) {
                let mut columns = jacobian.row(row).0.iter();
                if columns.any(|&column| codes[column as usize] >= MAX_GROUP) {
                    rows.push(row);
                } else {
                    inner.push(row);
                }
            }
            rows.append(&mut inner);
            // Rows one after the other; the group's size and their lengths, so that they can be told apart.
            key.clear();
            key.push(columns.len());
            for &row in &rows {
                let columns = jacobian.row(row).0;
                key.push(columns.len());
                key.extend(columns.iter().map(|&column| codes[column as usize]));
            }
            if key != last_key {
                last_class = class_of.get(&key).copied().unwrap_or_else(|| {
                    classes.push(Class {
                        pattern: Pattern::new(columns.len(), &key[1..]),
                        columns: Vec::new(),
                        rows: Vec::new(),
                        numbers: Vec::new(),
                    });
                    class_of.insert(key.clone(), classes.len() - 1);
                    classes.len() - 1
                });
                last_key.clone_from(&key);
            }
            let class = &mut classes[last_class];
            let group = narrow(class.groups());
            for (place, &column) in (0..).zip(columns) {
                places[column] = Place::Eliminated {
                    class: narrow(last_class),
                    group,
                    place,
                };
            }
            class.columns.extend_from_slice(columns);
            class.rows.extend_from_slice(&rows);
        }
        classes.iter_mut().for_each(Class::make_room);
        Self {
            classes,
            other_rows: rows_of.of(elimination.groups.len()).to_vec(),
            base: Normal::new(kept.len()),
            kept_step: Mat::zeros(kept.len(), 1),
            factor: None,
            factored: None,
            is_undamped: false,
            places,
            kept,
        }
    }

    /// Eliminates and factors; false if something is not positive definite.
    fn factor(&mut self, damping: f64, held: &[bool], step: &[f64]) -> bool {
        let size = self.kept.len();
        self.factored = None;
        let sums: Vec<Option<Normal>> =
            parallel::map_owned(portions(&mut self.classes), |portions| {
                let mut normal = Normal::new(size);
                let mut regular = true;
                for portion in portions {
                    regular &= portion.eliminate(damping, held, step, &mut normal);
                }
                regular.then_some(normal)
            });
        let mut normal = self.base.clone();
        for sum in &sums {
            let Some(sum) = sum else { return false };
            normal.add(sum);
        }
        for (place, &column) in self.kept.iter().enumerate() {
            self.kept_step[(place, 0)] = -normal.gradient[place];
            normal.matrix[place * size + place] += damping;
            if !held[column] {
                continue;
            }
            for other in 0..size {
                let entry = &mut normal.matrix[other.max(place) * size + other.min(place)];
                if other != place {
                    self.kept_step[(other, 0)] -= *entry * step[column];
                }
                *entry = f64::from(u8::from(other == place));
            }
        }
        for (place, &column) in self.kept.iter().enumerate() {
            if held[column] {
                self.kept_step[(place, 0)] = step[column];
            }
        }
        let matrix = Mat::from_fn(size, size, |i, j| normal.matrix[i.max(j) * size + i.min(j)]);
        self.factor = matrix.llt(Side::Lower).ok();
        let Some(factor) = &self.factor else {
            return false;
        };
        factor.solve_in_place(self.kept_step.as_mut());
        let is_finite = (0..size).all(|place| self.kept_step[(place, 0)].is_finite());
        self.factored = (is_finite && !held.contains(&true)).then_some(damping);
        is_finite
    }

    /// Factors `JᵀJ`; false if it is not positive definite.
    pub(crate) fn factor_undamped(&mut self, jacobian: &Jacobian, residuals: &[f64]) -> bool {
        let n = jacobian.column_count;
        self.load(jacobian, residuals);
        self.is_undamped = self.factor(0.0, &vec![false; n], &vec![0.0; n]);
        self.is_undamped
    }

    /// The least pivot of all that is factored.
    pub(crate) fn least_pivot(&self) -> f64 {
        let of_groups = self.classes.iter().flat_map(|class| {
            let blocks = class.blocks();
            blocks.flat_map(|(_, factors)| class.pattern.pivots(factors))
        });
        let size = self.kept.len();
        let factor = self.factor.iter();
        let kept = factor.flat_map(|factor| (0..size).map(|i| factor.L()[(i, i)]));
        let least = of_groups.chain(kept).fold(f64::INFINITY, f64::min);
        least * least
    }

    /// An entry of the inverse of the matrix factored last.
    pub(crate) fn inverse_entry(&self, row: usize, column: usize) -> f64 {
        let (first, in_group_first) = self.influence(row);
        let (second, in_group_second) = self.influence(column);
        let mut solved = Mat::from_fn(self.kept.len(), 1, |i, _| second[i]);
        if let Some(factor) = &self.factor {
            factor.solve_in_place(solved.as_mut());
        }
        let mut entry: f64 = (0..first.len()).map(|i| first[i] * solved[(i, 0)]).sum();
        let group = |column: usize| match self.places[column] {
            Place::Kept(_) => None,
            Place::Eliminated { class, group, .. } => Some((class, group)),
        };
        if group(row).is_some() && group(row) == group(column) {
            entry += in_group_first
                .iter()
                .zip(&in_group_second)
                .map(|(a, b)| a * b)
                .sum::<f64>();
        }
        entry
    }

    /// Information of the rows in which no eliminated parameter occurs.
    fn load_other_rows(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        let size = self.kept.len();
        self.base.matrix.fill(0.0);
        self.base.gradient.fill(0.0);
        for &row in &self.other_rows {
            let (columns, values) = jacobian.row(row);
            for (i, (&first, &value)) in columns.iter().zip(values).enumerate() {
                let Place::Kept(first) = self.places[first as usize] else {
                    continue;
                };
                let first = first as usize;
                self.base.gradient[first] += value * residuals[row];
                for (&second, &other) in columns[..=i].iter().zip(values) {
                    if let Place::Kept(second) = self.places[second as usize] {
                        self.base.matrix[first * size + second as usize] += value * other;
                    }
                }
            }
        }
    }

    /// Steps of the groups, given that of the kept parameters, and all entries that are not held.
    fn back_substitute(&mut self, held: &[bool], step: &mut [f64]) {
        let kept_step = self.kept_step.col_as_slice(0);
        parallel::map_owned(portions(&mut self.classes), |portions| {
            for portion in portions {
                portion.back_substitute(kept_step);
            }
        });
        self.gather(held, step);
    }

    /// Writes the entries of the step that are not held, after back substitution.
    fn gather(&self, held: &[bool], step: &mut [f64]) {
        let kept = self.kept_step.col_as_slice(0);
        let of_class = |class: &Class| {
            let (own, length) = (class.pattern.own, class.pattern.factors_len());
            (length, length - own)
        };
        let places: Vec<(usize, usize)> = self.classes.iter().map(of_class).collect();
        let (columns, length) = (step.len(), at_once(step.len()));
        let parts = step.chunks_mut(length).enumerate();
        on_each(columns, parts, |(part, step)| {
            for (column, step) in (part * length..).zip(step).filter(|own| !held[own.0]) {
                *step = match self.places[column] {
                    Place::Kept(place) => kept[place as usize],
                    Place::Eliminated {
                        class,
                        group,
                        place,
                    } => {
                        let (length, first) = places[class as usize];
                        let (block, lane) = (group as usize / LANES, group as usize % LANES);
                        let numbers = &self.classes[class as usize].numbers[block / CHUNK];
                        let start = block % CHUNK * length + first;
                        numbers.factors[start + place as usize][lane]
                    }
                };
            }
        });
    }

    /// A parameter as a combination of kept ones, and, if it is eliminated, `L⁻¹` of its unit vector.
    fn influence(&self, column: usize) -> (Vec<f64>, [f64; MAX_GROUP]) {
        let mut kept = vec![0.0; self.kept.len()];
        let (class, group, place) = match self.places[column] {
            Place::Kept(place) => {
                kept[place as usize] = 1.0;
                return (kept, [0.0; MAX_GROUP]);
            }
            Place::Eliminated {
                class,
                group,
                place,
            } => (class, group, place),
        };
        let class = &self.classes[class as usize];
        let (block, lane) = (group as usize / LANES, group as usize % LANES);
        let pattern = &class.pattern;
        let mut sums = vec![Lanes::ZERO; pattern.kept_entries()];
        let (values, factors) = class.block(block);
        let mut factors = factors.to_vec();
        let x = pattern.steps_mut(&mut factors);
        x.fill(Lanes::ZERO);
        x[place as usize][lane] = 1.0;
        pattern.influence(values, &mut factors, &mut sums);
        pattern.subtract(&sums, Some(lane), &mut kept);
        let mut own = [0.0; MAX_GROUP];
        for (own, x) in own.iter_mut().zip(pattern.steps(&factors)) {
            *own = x[lane];
        }
        (kept, own)
    }
}

impl Portion<'_> {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        let pattern = self.pattern;
        let values = self.values.chunks_exact_mut(pattern.values_len());
        for (rows, values) in self.rows.chunks(LANES * pattern.rows.len()).zip(values) {
            pattern.load(rows, jacobian, residuals, values);
        }
    }

    fn eliminate(self, damping: f64, held: &[bool], step: &[f64], normal: &mut Normal) -> bool {
        let pattern = self.pattern;
        let mut sums = vec![Lanes::ZERO; pattern.sums_len()];
        let mut changed = vec![];
        let values = self.values.chunks_exact(pattern.values_len());
        let factors = self.factors.chunks_exact_mut(pattern.factors_len());
        let blocks = self.columns.chunks(LANES * pattern.own);
        for (columns, (mut values, factors)) in blocks.zip(values.zip(factors)) {
            if columns.iter().any(|&column| held[column]) {
                changed.clear();
                changed.extend_from_slice(values);
                for (place, &column) in columns.iter().enumerate() {
                    if held[column] {
                        let (lane, place) = (place / pattern.own, place % pattern.own);
                        pattern.hold(&mut changed, lane, place, step[column]);
                    }
                }
                values = &changed;
            }
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
        let values = self.values.chunks_exact_mut(pattern.values_len());
        let factors = self.factors.chunks_exact_mut(pattern.factors_len());
        let blocks = self.rows.chunks(LANES * pattern.rows.len());
        for (rows, (values, factors)) in blocks.zip(values.zip(factors)) {
            pattern.load_residuals(rows, jacobian, residuals, values);
            pattern.substitute(values, factors, &mut sums);
        }
        pattern.subtract(&sums, None, right);
    }

    fn back_substitute(self, kept: &[f64]) {
        let pattern = self.pattern;
        let values = self.values.chunks_exact(pattern.values_len());
        let factors = self.factors.chunks_exact_mut(pattern.factors_len());
        for (values, factors) in values.zip(factors) {
            pattern.back_substitute(values, factors, kept);
        }
    }

    /// Adds `‖L⁻¹x‖²` of the groups' own entries x of a vector, and takes what they say of the kept parameters from `kept`.
    fn influence(self, v: &[f64], form: &mut Lanes, kept: &mut [f64]) {
        let (pattern, own) = (self.pattern, self.pattern.own);
        let mut sums = vec![Lanes::ZERO; pattern.kept_entries()];
        let values = self.values.chunks_exact(pattern.values_len());
        let factors = self.factors.chunks_exact_mut(pattern.factors_len());
        let blocks = self.columns.chunks(LANES * own);
        for (columns, (values, factors)) in blocks.zip(values.zip(factors)) {
            let x = pattern.steps_mut(factors);
            x.fill(Lanes::ZERO);
            for (lane, columns) in columns.chunks_exact(own).enumerate() {
                for (x, &column) in x.iter_mut().zip(columns) {
                    x[lane] = v[column];
                }
            }
            pattern.influence(values, factors, &mut sums);
            for x in pattern.steps(factors) {
                for (form, x) in form.0.iter_mut().zip(x.0) {
                    *form += x * x;
                }
            }
        }
        pattern.subtract(&sums, None, kept);
    }
}

impl LinearSolver for SchurCholesky {
    fn load(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        parallel::map_owned(portions(&mut self.classes), |portions| {
            for mut portion in portions {
                portion.load(jacobian, residuals);
            }
        });
        self.is_undamped = false;
        self.factored = None;
        self.load_other_rows(jacobian, residuals);
    }

    fn solve(&mut self, damping: f64, held: &[bool], step: &mut [f64]) -> bool {
        let mut used = damping;
        let is_factored = std::mem::take(&mut self.is_undamped);
        let mut solved = is_factored && damping == 0.0 && !held.contains(&true);
        solved = solved || self.factor(used, held, step);
        while !solved && used < 1.0 {
            used = f64::max(LEAST_DAMPING, 100.0 * used);
            solved = self.factor(used, held, step);
        }
        if !solved {
            return false;
        }
        self.back_substitute(held, step);
        // A factorisation without pivoting cannot vouch for rank unless damped.
        used == damping && damping > 0.0
    }

    fn solve_again(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        damping: f64,
        held: &[bool],
        step: &mut [f64],
    ) -> bool {
        if self.factored != Some(damping) || held.contains(&true) {
            self.load(jacobian, residuals);
            return self.solve(damping, held, step);
        }
        self.load_other_rows(jacobian, residuals);
        let size = self.kept.len();
        let of_portions = parallel::map_owned(portions(&mut self.classes), |portions| {
            let mut right = vec![0.0; size];
            for portion in portions {
                portion.substitute(jacobian, residuals, &mut right);
            }
            right
        });
        for place in 0..size {
            let less = of_portions.iter().map(|right| right[place]);
            self.kept_step[(place, 0)] =
                less.fold(-self.base.gradient[place], |sum, own| sum + own);
        }
        if let Some(factor) = &self.factor {
            factor.solve_in_place(self.kept_step.as_mut());
        }
        self.is_undamped = false;
        self.back_substitute(held, step);
        damping > 0.0
    }

    fn inverse_form(&mut self, v: &[f64]) -> f64 {
        self.is_undamped = false;
        let mut kept: Vec<f64> = self.kept.iter().map(|&column| v[column]).collect();
        let of_portions = parallel::map_owned(portions(&mut self.classes), |portions| {
            let mut form = Lanes::ZERO;
            let mut kept = vec![0.0; kept.len()];
            for portion in portions {
                portion.influence(v, &mut form, &mut kept);
            }
            (form.sum(), kept)
        });
        let mut form = 0.0;
        for (own, less) in of_portions {
            form += own;
            (kept.iter_mut().zip(less)).for_each(|(kept, less)| *kept += less);
        }
        let mut solved = Mat::from_fn(kept.len(), 1, |i, _| kept[i]);
        if let Some(factor) = &self.factor {
            factor.solve_in_place(solved.as_mut());
        }
        form + (0..kept.len())
            .map(|i| kept[i] * solved[(i, 0)])
            .sum::<f64>()
    }
}
