//! Poses whose rows are far off together.
//!
//! A row that is wrong by itself leaves the others of its poses as they are. Where commands are wrong, the rows agree with each
//! other about the pose, and not with its commands: exact drives hold the plate where it was not, and no single row is at
//! fault.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use tau_robot::measurements::TCP_POSES;

use super::assembly::place_of;
use super::fit::Fit;
use super::rows::{CLOSURES, RowPlace};

/// A pose all of whose rows are far off, or all but one, which may agree by chance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrossPose {
    /// Number of the pose.
    pub pose: u32,
    /// File and line of its commands, the first of several.
    pub commands: Option<(&'static str, usize)>,
    /// Number of its rows that are far off.
    pub far: usize,
    /// Number of all of its rows.
    pub rows: usize,
}

impl fmt::Display for GrossPose {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            pose, far, rows, ..
        } = self;
        if far < rows {
            write!(f, "{far} of {rows} rows of pose {pose}")?;
        } else {
            write!(f, "all {rows} rows of pose {pose}")?;
        }
        if let Some((file, line)) = self.commands {
            write!(f, " ({file} line {line})")?;
        }
        write!(
            f,
            ": its commands are wrong, or what was measured there is of another pose"
        )
    }
}

impl GrossPose {
    /// Enough of its rows are far off that hardly each of them is wrong by itself.
    fn is_told(&self) -> bool {
        let kept = self.rows - self.far;
        kept <= 1 && self.far >= 2 + kept
    }
}

impl Fit<'_> {
    /// Poses whose rows are far off together, that with most rows first. A row that is explained by one of its poses says
    /// nothing of the other.
    pub(super) fn gross_poses(&self) -> Vec<GrossPose> {
        let mut far: BTreeSet<RowPlace> = self.gross.iter().map(|row| row.place).collect();
        far.extend(&self.left_out);
        far.retain(|place| place.drive.is_none());
        if far.is_empty() {
            return vec![];
        }
        // The first block are the closures, and carts have poses of their own.
        let plate = self.blocks.iter().skip(CLOSURES + 1);
        let plate = plate.filter(|rows| rows.own_each() > 0);
        let kept: BTreeSet<RowPlace> = (plate.flat_map(|rows| &rows.places).copied())
            .filter(|place| !far.contains(place))
            .collect();
        let mut found = vec![];
        loop {
            let mut counts: BTreeMap<u32, [usize; 2]> = BTreeMap::new();
            let all = far.iter().map(|place| (place, 1));
            for (place, is_far) in all.chain(kept.iter().map(|place| (place, 0))) {
                for pose in place.poses() {
                    let count = counts.entry(pose).or_default();
                    count[0] += is_far;
                    count[1] += 1;
                }
            }
            let poses = counts.into_iter().map(|(pose, [far, rows])| GrossPose {
                pose,
                commands: None,
                far,
                rows,
            });
            let told = poses.filter(GrossPose::is_told);
            let Some(mut worst) = told.max_by_key(|own| own.far) else {
                return found;
            };
            worst.commands = self.place_of_commands(worst.pose);
            far.retain(|place| place.poses().all(|pose| pose != worst.pose));
            found.push(worst);
        }
    }

    /// File and line of the first commands of a pose.
    fn place_of_commands(&self, pose: u32) -> Option<(&'static str, usize)> {
        let of_poses = self.folder.tcp_poses.iter();
        let mut of_poses = of_poses.filter(|own| own.pose == pose);
        if let Some(own) = of_poses.next() {
            return Some((TCP_POSES, own.line));
        }
        let rows = self.folder.plate_rows.iter().map(place_of);
        let mut own = rows.filter(|place| place.pose == pose);
        own.next().map(|place| (place.file, place.line))
    }
}
