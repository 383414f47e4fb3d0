//! Cells that stand for more points than a panel has room for: a picture is no better for marks that hide each other, and
//! a file of a hundred thousand of them can't be opened.

use std::collections::BTreeMap;

/// Share of a panel that marks may cover before they hide each other too often.
const CROWDED: f64 = 0.25;
/// Steps of shade: eyes tell no more apart on a small cell.
const SHADES: f64 = 5.0;
/// Shade of a cell with one point: light, and seen.
const LIGHTEST: f64 = 0.35;

/// For captions.
pub(super) const NOTE: &str = " Where marks would hide each other, cells of their size are drawn instead, the darker the more of them fall \
                               into one (by the logarithm of their number); every one is in a cell, so that extremes are kept.";

/// True if so many marks would hide each other.
pub(super) fn are_needed(count: usize, radius: f64, area: f64) -> bool {
    count as f64 * (2.0 * radius).powi(2) > CROWDED * area
}

/// Neighbouring cells of one shade.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Bar {
    pub(super) corners: [(i32, i32); 2],
    /// Between 0 and 1.
    pub(super) shade: f64,
}

/// The cells that points fall into, those of a row and a shade together.
pub(super) fn shaded(points: &[(i32, i32)], size: i32) -> Vec<Bar> {
    let size = size.max(1);
    let mut counts: BTreeMap<(i32, i32), u32> = BTreeMap::new();
    for (x, y) in points {
        *counts
            .entry((y.div_euclid(size), x.div_euclid(size)))
            .or_default() += 1;
    }
    let most = counts.values().copied().max().unwrap_or(1);
    let shade = |count: u32| {
        let share = if most > 1 {
            f64::from(count).ln() / f64::from(most).ln()
        } else {
            0.0
        };
        LIGHTEST + (1.0 - LIGHTEST) * (share * (SHADES - 1.0)).round() / (SHADES - 1.0)
    };
    let mut bars: Vec<Bar> = Vec::new();
    for ((row, column), count) in counts {
        let shade = shade(count);
        let (left, top) = (column * size, row * size);
        let corner = (left + size, top + size);
        match bars.last_mut() {
            Some(last)
                if last.shade == shade && last.corners[0].1 == top && last.corners[1].0 == left =>
            {
                last.corners[1] = corner;
            }
            _ => bars.push(Bar {
                corners: [(left, top), corner],
                shade,
            }),
        }
    }
    bars
}

/// A line with no more than four points for each step of its way to the right: the first, the lowest, the highest and the
/// last of those that fall into it.
pub(super) fn outlined(points: &[(i32, i32)], step: i32) -> Vec<(i32, i32)> {
    let mut kept: Vec<(i32, i32)> = Vec::new();
    for same in points.chunk_by(|a, b| a.0.div_euclid(step.max(1)) == b.0.div_euclid(step.max(1))) {
        if same.len() <= 4 {
            kept.extend(same);
            continue;
        }
        let ends = [0, same.len() - 1];
        let low = (0..same.len()).min_by_key(|&k| same[k].1).unwrap_or(0);
        let high = (0..same.len()).max_by_key(|&k| same[k].1).unwrap_or(0);
        let mut indices = [ends[0], low, high, ends[1]].to_vec();
        indices.sort_unstable();
        indices.dedup();
        kept.extend(indices.into_iter().map(|k| same[k]));
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_is_in_a_bar_and_the_densest_is_darkest() {
        let points: Vec<(i32, i32)> = (0..5000).map(|k| (k * k % 977, k * 7 % 400)).collect();
        let mut all = points.clone();
        all.extend(std::iter::repeat_n((500, 200), 300));
        all.push((-40, 399));
        let bars = shaded(&all, 14);
        let holds = |bar: &Bar, (x, y): (i32, i32)| {
            let [(left, top), (right, bottom)] = bar.corners;
            (left..right).contains(&x) && (top..bottom).contains(&y)
        };
        for point in &all {
            assert_eq!(
                bars.iter().filter(|bar| holds(bar, *point)).count(),
                1,
                "{point:?}"
            );
        }
        let darkest = bars
            .iter()
            .max_by(|a, b| a.shade.total_cmp(&b.shade))
            .unwrap();
        assert!(holds(darkest, (500, 200)) && darkest.shade == 1.0);
        // A panel holds no more cells than its area over theirs, however many points there are.
        assert!(bars.len() <= (977 / 14 + 5) * (400 / 14 + 2));
    }

    #[test]
    fn marks_give_way_only_where_they_crowd() {
        assert!(!are_needed(176, 1.8, 190.0 * 106.0));
        assert!(are_needed(50_000, 1.8, 190.0 * 106.0));
    }

    #[test]
    fn a_line_keeps_its_extremes() {
        let line: Vec<(i32, i32)> = (0..100_000).map(|k| (k / 1000, k * 37 % 1009)).collect();
        let kept = outlined(&line, 2);
        assert!(kept.len() <= 4 * 50, "{}", kept.len());
        let span = |points: &[(i32, i32)]| {
            let values = || points.iter().map(|point| point.1);
            (values().min(), values().max())
        };
        assert_eq!(span(&kept), span(&line));
        assert_eq!(
            (kept[0], kept[kept.len() - 1]),
            (line[0], line[line.len() - 1])
        );
        assert_eq!(outlined(&line[..3], 2), line[..3]);
    }
}
