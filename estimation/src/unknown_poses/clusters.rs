//! Poses that belong together because distances couple them.

use std::ops::Range;

use super::rows::Rows;
use crate::problem::POSE_UNKNOWNS;

/// Rows of poses that belong together, as ranges of [`Clusters`].
pub(super) struct Cluster {
    /// Indices of the free unknowns of its poses.
    pub(super) own: Range<usize>,
    /// Block and index of each sample.
    pub(super) samples: Range<usize>,
}

/// All rows by the poses that belong together.
pub(super) struct Clusters {
    pub(super) all: Vec<Cluster>,
    /// Indices of free unknowns.
    pub(super) own: Vec<usize>,
    /// Block and index of samples.
    pub(super) samples: Vec<(usize, usize)>,
}

impl Clusters {
    pub(super) fn new(blocks: &[Rows], poses: usize, free: &[usize]) -> Self {
        let mut parent: Vec<usize> = (0..poses).collect();
        let samples = |rows: &Rows| rows.places.len();
        for rows in blocks {
            for sample in 0..samples(rows) {
                let Some([a, b]) = rows.poses_of(sample) else {
                    continue;
                };
                let (a, b) = (root(&mut parent, a), root(&mut parent, b));
                parent[a.max(b)] = a.min(b);
            }
        }
        let firsts: Vec<usize> = (0..poses).map(|pose| root(&mut parent, pose)).collect();
        let of_samples = blocks.iter().enumerate().flat_map(|(block, rows)| {
            let firsts = &firsts;
            // Samples of no pose stand behind all others, each for itself.
            (0..samples(rows)).map(move |sample| {
                let of_pose = rows.poses_of(sample).map(|poses| firsts[poses[0]]);
                (of_pose.unwrap_or(poses), (block, sample))
            })
        });
        let (sample_ends, samples) = grouped(poses + 1, of_samples);
        let of_poses = firsts.iter().enumerate();
        let unknowns = of_poses.flat_map(|(pose, &first)| {
            free.iter()
                .map(move |axis| (first, POSE_UNKNOWNS * pose + axis))
        });
        let (own_ends, own) = grouped(poses, unknowns);
        let is_first = |&pose: &usize| firsts[pose] == pose;
        let all = (0..poses).filter(is_first).map(|pose| Cluster {
            own: own_ends[pose]..own_ends[pose + 1],
            samples: sample_ends[pose]..sample_ends[pose + 1],
        });
        let alone = sample_ends[poses]..sample_ends[poses + 1];
        let all = all.chain(alone.map(|sample| Cluster {
            own: 0..0,
            samples: sample..sample + 1,
        }));
        Self {
            all: all.collect(),
            own,
            samples,
        }
    }
}

/// Items by their groups, in order within each, and where each group starts among them.
fn grouped<T: Copy + Default>(
    groups: usize,
    items: impl Iterator<Item = (usize, T)> + Clone,
) -> (Vec<usize>, Vec<T>) {
    let mut starts = vec![0; groups + 1];
    for (group, _) in items.clone() {
        starts[group + 1] += 1;
    }
    for group in 0..groups {
        starts[group + 1] += starts[group];
    }
    let mut next = starts.clone();
    let mut all = vec![T::default(); starts[groups]];
    for (group, item) in items {
        all[next[group]] = item;
        next[group] += 1;
    }
    (starts, all)
}

/// Representative of the cluster of a pose.
fn root(parent: &mut [usize], mut pose: usize) -> usize {
    while parent[pose] != pose {
        parent[pose] = parent[parent[pose]];
        pose = parent[pose];
    }
    pose
}
