//! Readings at the same commands: visits of one pose.

use std::collections::BTreeMap;

use super::{Folder, TcpPose};

/// Commands that differ by less (m) are the same: below what drives resolve.
const SAME_M: f64 = 1e-6;
/// Temperatures that differ by less (K) are the same: a metre of steel grows by [`SAME_M`].
const SAME_K: f64 = 0.1;

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

    /// For each pose of set 1, by index, the index of the first reading at which the machine stood where it stands there:
    /// readings in a row, at the same commands from the same sides and at one temperature, with no motion between them.
    pub fn dwells(&self) -> Vec<usize> {
        let mut first = 0;
        let mut of_numbers = BTreeMap::new();
        (0..self.tcp_poses.len())
            .map(|index| {
                // Whoever gives rows one number says so.
                let number = self.tcp_poses[index].pose;
                if let Some(&known) = of_numbers.get(&number) {
                    return known;
                }
                let stays = index > 0
                    && stands_still(&self.tcp_poses[index - 1], &self.tcp_poses[index])
                    && is_as_warm(&self.tcp_poses[first], &self.tcp_poses[index]);
                if !stays {
                    first = index;
                }
                of_numbers.insert(number, first);
                first
            })
            .collect()
    }
}

fn stands_still(before: &TcpPose, pose: &TcpPose) -> bool {
    let bits =
        |values: &[f64]| -> Vec<u64> { values.iter().map(|value| value.to_bits()).collect() };
    let sides = |pose: &TcpPose| pose.directions.as_deref().map(bits);
    bits(&before.commands_m) == bits(&pose.commands_m) && sides(before) == sides(pose)
}

fn is_as_warm(first: &TcpPose, pose: &TcpPose) -> bool {
    match (
        first.conditions.temperature_c,
        pose.conditions.temperature_c,
    ) {
        (Some(first), Some(own)) => (first - own).abs() < SAME_K,
        (first, own) => first == own,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurements::selection::tests::tcp_pose;

    fn pose(commands_m: [f64; 2], side: f64, temperature_c: f64) -> TcpPose {
        let mut pose = tcp_pose(&commands_m);
        pose.conditions.temperature_c = Some(temperature_c);
        pose.directions = Some(vec![side, f64::NAN]);
        pose
    }

    /// A dwell ends where the drives move, though they come back, or turn round, or where it has grown warmer, however slowly.
    #[test]
    fn a_dwell_lasts_as_long_as_nothing_moves() {
        let (here, there) = ([0.1, 0.2], [0.1, 0.3]);
        let mut folder = Folder {
            tcp_poses: vec![
                pose(here, 1.0, 20.0),
                pose(here, 1.0, 20.01),
                pose(there, 1.0, 20.0),
                pose(here, 1.0, 20.0),
                pose(here, -1.0, 20.0),
                pose(here, -1.0, 20.06),
                pose(here, -1.0, 20.12),
            ],
            ..Folder::default()
        };
        for (number, pose) in (1..).zip(&mut folder.tcp_poses) {
            pose.pose = number;
        }
        assert_eq!(folder.dwells(), [0, 0, 2, 3, 4, 4, 6]);
        // Whoever gives a reading the number of another pose says that it is of that.
        folder.tcp_poses[3].pose = 1;
        assert_eq!(folder.dwells(), [0, 0, 2, 0, 4, 4, 6]);
    }
}
