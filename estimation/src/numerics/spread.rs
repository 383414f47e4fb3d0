//! A part of many, evenly spread.

/// So many of all numbers from 0, or all, evenly spread.
pub fn spread(all: usize, most: usize) -> Vec<usize> {
    let count = all.min(most);
    (0..count).map(|k| k * all / count).collect()
}
