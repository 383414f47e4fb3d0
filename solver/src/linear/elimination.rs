//! Choice of the parameters that are eliminated.
//!
//! Where parameters form many small groups that share no residual (the pose of each sample, the points of a bundle
//! adjustment), each group can be eliminated from its own rows.

use crate::jacobian::{Jacobian, narrow};

/// Most parameters of a group.
pub(super) const MAX_GROUP: usize = 12;
/// Groups with more rows are kept: the work is quadratic in the rows.
const MOST_ROWS: usize = 48;
/// No group.
const NONE: u32 = u32::MAX;

/// Groups of parameters, and the rows in which they occur.
pub(super) struct Elimination {
    /// Groups of columns that share no row with each other, each ascending.
    pub(super) groups: Vec<Vec<usize>>,
    /// The other columns, ascending.
    pub(super) kept: Vec<usize>,
    /// Rows of each group, and last those of none.
    pub(super) rows: Lists,
}

impl Elimination {
    /// Finds groups greedily: columns in order of the number of their rows join the groups that they touch, unless the union
    /// would be too large; then they are kept. So are columns that may be held.
    pub(super) fn detect(jacobian: &Jacobian, may_be_held: &[bool]) -> Self {
        let n = jacobian.column_count;
        let mut counts = vec![0; n];
        for &column in &jacobian.columns {
            counts[column as usize] += 1;
        }
        let joins =
            |column: usize| (1..=MOST_ROWS).contains(&counts[column]) && !may_be_held[column];
        let entries = (0..jacobian.row_count()).flat_map(|row| {
            let columns = jacobian.row(row).0.iter().map(|&column| column as usize);
            columns
                .filter(|&column| joins(column))
                .map(move |column| (column, narrow(row)))
        });
        let rows_of = Lists::new(n, entries);
        let mut order: Vec<usize> = (0..n).filter(|&column| joins(column)).collect();
        order.sort_by_key(|&column| counts[column]);

        let mut group_of_row = vec![NONE; jacobian.row_count()];
        let mut groups: Vec<Vec<usize>> = Vec::with_capacity(order.len());
        let mut touched: Vec<u32> = Vec::new();
        for column in order {
            touched.clear();
            let mut size = 1;
            for &row in rows_of.of(column) {
                let group = group_of_row[row as usize];
                if group != NONE && !touched.contains(&group) {
                    touched.push(group);
                    size += groups[group as usize].len();
                }
                if size > MAX_GROUP {
                    break;
                }
            }
            if size > MAX_GROUP {
                continue;
            }
            let target = touched.pop().unwrap_or_else(|| {
                groups.push(Vec::new());
                narrow(groups.len() - 1)
            });
            let mut joined = vec![column];
            for group in touched.drain(..) {
                joined.append(&mut groups[group as usize]);
            }
            for &row in joined.iter().flat_map(|&column| rows_of.of(column)) {
                group_of_row[row as usize] = target;
            }
            groups[target as usize].append(&mut joined);
        }
        groups.retain(|group| !group.is_empty());
        for group in &mut groups {
            group.sort_unstable();
        }
        groups.sort_unstable();
        let rows = rows_by_group(jacobian, &groups);
        let mut index = 0;
        let has_few_rows = |_: &Vec<usize>| {
            index += 1;
            rows.of(index - 1).len() <= MOST_ROWS
        };
        let count = groups.len();
        groups.retain(has_few_rows);
        let rows = if groups.len() == count {
            rows
        } else {
            rows_by_group(jacobian, &groups)
        };
        let mut is_kept = vec![true; n];
        groups
            .iter()
            .flatten()
            .for_each(|&own| is_kept[own] = false);
        Self {
            kept: (0..n).filter(|&column| is_kept[column]).collect(),
            groups,
            rows,
        }
    }
}

/// Rows of each group, and last those of none.
fn rows_by_group(jacobian: &Jacobian, groups: &[Vec<usize>]) -> Lists {
    let none = groups.len();
    let mut group_of = vec![narrow(none); jacobian.column_count];
    for (group, columns) in (0..).zip(groups) {
        for &column in columns {
            group_of[column] = group;
        }
    }
    let group = |row: usize| {
        let columns = jacobian.row(row).0.iter();
        columns.map(|&column| group_of[column as usize]).min()
    };
    let rows = 0..jacobian.row_count();
    let pairs = rows.map(|row| (group(row).map_or(none, |group| group as usize), narrow(row)));
    Lists::new(none + 1, pairs)
}

/// Lists of numbers.
pub(super) struct Lists {
    starts: Vec<usize>,
    all: Vec<u32>,
}

impl Lists {
    /// So many lists, of pairs of a list and a number.
    fn new(count: usize, pairs: impl Iterator<Item = (usize, u32)> + Clone) -> Self {
        let mut starts = vec![0; count + 1];
        for (list, _) in pairs.clone() {
            starts[list + 1] += 1;
        }
        for list in 0..count {
            starts[list + 1] += starts[list];
        }
        let mut next = starts.clone();
        let mut all = vec![0; starts[count]];
        for (list, number) in pairs {
            all[next[list]] = number;
            next[list] += 1;
        }
        Self { starts, all }
    }

    /// Numbers of a list, in order.
    pub(super) fn of(&self, list: usize) -> &[u32] {
        &self.all[self.starts[list]..self.starts[list + 1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Groups of two columns share rows with three others, which occur in more rows than a group may.
    #[test]
    fn columns_in_many_rows_are_kept() {
        const GROUPS: usize = 21;
        let mut jacobian = Jacobian::new(3 + 2 * GROUPS);
        for group in 0..GROUPS {
            let own = 3 + 2 * group;
            for row in 0..3 {
                jacobian.push_rows(&[row, own, own + 1], &[3]);
            }
            (0..MOST_ROWS / GROUPS).for_each(|_| jacobian.push_rows(&[0, 1, 2], &[3]));
            jacobian.push_rows(&[own], &[1]);
        }
        jacobian.values = vec![0.0; jacobian.columns.len()];
        let mut may_be_held = vec![false; jacobian.column_count];
        let found = Elimination::detect(&jacobian, &may_be_held);
        assert_eq!((found.groups.len(), found.kept), (GROUPS, vec![0, 1, 2]));
        assert_eq!(found.rows.of(1), [6, 7, 8, 11]);
        may_be_held[5] = true;
        let found = Elimination::detect(&jacobian, &may_be_held);
        assert_eq!(
            (&found.groups[1][..], &found.kept[3..]),
            (&[6][..], &[5][..])
        );
    }
}
