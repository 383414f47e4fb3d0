//! Long vectors, on all cores.

use std::array::from_fn;

use rayon::iter::IndexedParallelIterator;
use tau_runtime::{LANES, Lanes};

use crate::parallel;

/// Numbers that one thread takes at a time; sums over chunks are added in their order, so that they do not depend on the
/// number of threads.
pub(crate) const CHUNK: usize = 1 << 13;
/// Below so many numbers one thread is faster.
pub(crate) const SHARED: usize = 1 << 16;

/// Numbers of vectors of such a length that one thread takes at a time: all of short ones.
pub(crate) fn at_once(length: usize) -> usize {
    if length < SHARED {
        length.max(1)
    } else {
        CHUNK
    }
}

/// Results of work on each of such parts of vectors of a length, in order.
pub(crate) fn on_each<T: Send, R: Send>(
    length: usize,
    parts: impl Iterator<Item = T>,
    work: impl Fn(T) -> R + Sync,
) -> Vec<R> {
    if length < SHARED {
        parts.map(work).collect()
    } else {
        parallel::map_owned(parts.collect(), work)
    }
}

/// So many zeros; of long vectors each core touches its part of fresh memory first, which takes longer than writing to it.
pub(crate) fn zeros(length: usize) -> Vec<f64> {
    if length < SHARED {
        return vec![0.0; length];
    }
    let mut zeros = Vec::new();
    let all = rayon::iter::repeat_n(0.0, length);
    all.with_min_len(CHUNK).collect_into_vec(&mut zeros);
    zeros
}

/// Sum over a vector and another of the same length.
fn total(x: &[f64], y: &[f64], of_chunk: impl Fn(&[f64], &[f64]) -> f64 + Sync) -> f64 {
    if x.len() < SHARED {
        return of_chunk(x, y);
    }
    let chunks = x.chunks(CHUNK).zip(y.chunks(CHUNK)).collect();
    let sums = parallel::map_owned(chunks, |(x, y)| of_chunk(x, y));
    sums.iter().sum()
}

/// Euclidean norm.
pub(crate) fn norm(x: &[f64]) -> f64 {
    dot(x, x).sqrt()
}

/// Inner product.
pub(crate) fn dot(x: &[f64], y: &[f64]) -> f64 {
    total(x, y, |x, y| x.iter().zip(y).map(|(x, y)| x * y).sum())
}

/// Inner product of `x − y` and `y`.
pub(crate) fn dot_of_difference(x: &[f64], y: &[f64]) -> f64 {
    total(x, y, |x, y| x.iter().zip(y).map(|(x, y)| (x - y) * y).sum())
}

/// Sum of many numbers.
pub(crate) fn sum(x: &[f64]) -> f64 {
    total(x, x, |x, _| {
        let (blocks, rest) = x.as_chunks();
        sum_of_lanes(blocks.iter().copied(), rest.iter().copied())
    })
}

/// Sum of the differences of many numbers.
pub(crate) fn sum_of_differences(x: &[f64], y: &[f64]) -> f64 {
    total(x, y, |x, y| {
        let (blocks, rest) = x.as_chunks::<LANES>();
        let (other_blocks, other_rest) = y.as_chunks::<LANES>();
        let pairs = blocks.iter().zip(other_blocks);
        let rest = rest.iter().zip(other_rest).map(|(x, y)| x - y);
        sum_of_lanes(pairs.map(|(x, y)| from_fn(|lane| x[lane] - y[lane])), rest)
    })
}

/// Sum over all lanes and the rest: no addition waits for the one before.
fn sum_of_lanes(
    blocks: impl Iterator<Item = [f64; LANES]>,
    rest: impl Iterator<Item = f64>,
) -> f64 {
    let mut sums = Lanes::ZERO;
    for block in blocks {
        for (sum, x) in sums.0.iter_mut().zip(block) {
            *sum += x;
        }
    }
    sums.sum() + rest.sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_of_long_vectors_are_those_of_their_parts() {
        // Small whole numbers add up without rounding, in whatever order.
        let x: Vec<f64> = (0..2 * SHARED + 5)
            .map(|i| f64::from(i as u32 % 7))
            .collect();
        let y: Vec<f64> = (0..x.len()).map(|i| f64::from(i as u32 % 5)).collect();
        let pairs = || x.iter().zip(&y);
        assert_eq!(sum(&x), x.iter().sum::<f64>());
        assert_eq!(dot(&x, &y), pairs().map(|(x, y)| x * y).sum::<f64>());
        assert_eq!(
            sum_of_differences(&x, &y),
            pairs().map(|(x, y)| x - y).sum::<f64>()
        );
        assert_eq!(
            norm(&x).powi(2).round(),
            x.iter().map(|x| x * x).sum::<f64>()
        );
    }
}
