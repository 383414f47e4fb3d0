//! Readings at the same commands: visits of one pose.

use std::collections::BTreeMap;

use super::Folder;

/// Commands that differ by less (m) are the same: below what drives resolve.
const SAME_M: f64 = 1e-6;

/// For each row of numbers, commands (m) among them, the number of the visit that it belongs to: rows that agree in all
/// of them are readings of one visit. Visits are counted from 0 in the order of their first reading.
pub fn visits<'a>(rows: impl Iterator<Item = &'a [f64]>) -> Vec<usize> {
    // Saturates, far beyond any machine.
    let key = |values: &[f64]| -> Vec<i64> {
        let steps = values.iter().map(|value| (value / SAME_M).round() as i64);
        steps.collect()
    };
    let mut known = BTreeMap::new();
    rows.map(|row| {
        let next = known.len();
        *known.entry(key(row)).or_insert(next)
    })
    .collect()
}

impl Folder {
    /// For each pose of set 1, by index, the number of its visit: readings at the same commands are of one.
    pub fn visits(&self) -> Vec<usize> {
        visits(self.tcp_poses.iter().map(|pose| pose.commands_m.as_slice()))
    }
}
