//! Poses that belong together because distances couple them.

use std::collections::BTreeSet;
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
    /// By all unknowns of the poses, where each stands among those of its cluster, if it is free.
    places: Vec<Option<usize>>,
}

impl Clusters {
    pub(super) fn new(blocks: &[Rows], poses: usize, free: &[usize]) -> Self {
        let mut parent: Vec<usize> = (0..poses).collect();
        let mut neighbours = vec![BTreeSet::new(); poses];
        let samples = |rows: &Rows| rows.places.len();
        for rows in blocks {
            for sample in 0..samples(rows) {
                let Some([a, b]) = rows.poses_of(sample).filter(|[a, b]| a != b) else {
                    continue;
                };
                neighbours[a].insert(b);
                neighbours[b].insert(a);
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
        let order = by_least_degree(neighbours);
        let unknowns = order.iter().flat_map(|&pose| {
            let first = firsts[pose];
            free.iter()
                .map(move |axis| (first, POSE_UNKNOWNS * pose + axis))
        });
        let (own_ends, own) = grouped(poses, unknowns);
        let mut places = vec![None; POSE_UNKNOWNS * poses];
        for range in own_ends.windows(2) {
            for (place, &unknown) in own[range[0]..range[1]].iter().enumerate() {
                places[unknown] = Some(place);
            }
        }
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
            places,
        }
    }

    /// Where an unknown stands among the free ones of a cluster, if it is one of them.
    pub(super) fn place(&self, cluster: &Cluster, unknown: usize) -> Option<usize> {
        let own = &self.own[cluster.own.clone()];
        self.places[unknown].filter(|&place| own.get(place) == Some(&unknown))
    }

    /// Each pose by itself with all rows that touch it, in sets of poses of which no two share a row.
    pub(super) fn apart(blocks: &[Rows], poses: usize, free: &[usize]) -> Vec<Self> {
        let mut samples = vec![vec![]; poses];
        let mut neighbours = vec![vec![]; poses];
        for (block, rows) in blocks.iter().enumerate() {
            for sample in 0..rows.places.len() {
                let Some([a, b]) = rows.poses_of(sample) else {
                    continue;
                };
                samples[a].push((block, sample));
                if b != a {
                    samples[b].push((block, sample));
                    neighbours[a].push(b);
                    neighbours[b].push(a);
                }
            }
        }
        let mut places = [None; POSE_UNKNOWNS];
        for (place, &axis) in free.iter().enumerate() {
            places[axis] = Some(place);
        }
        let places = places.repeat(poses);
        let mut sets: Vec<Self> = vec![];
        let mut set_of: Vec<Option<usize>> = vec![None; poses];
        for pose in 0..poses {
            let taken = |set: usize| neighbours[pose].iter().any(|&at| set_of[at] == Some(set));
            let set = (0..sets.len()).find(|&set| !taken(set));
            let set = set.unwrap_or_else(|| {
                sets.push(Self {
                    all: vec![],
                    own: vec![],
                    samples: vec![],
                    places: places.clone(),
                });
                sets.len() - 1
            });
            set_of[pose] = Some(set);
            let of = &mut sets[set];
            let (own, first) = (of.own.len(), of.samples.len());
            of.own
                .extend(free.iter().map(|axis| POSE_UNKNOWNS * pose + axis));
            of.samples.append(&mut samples[pose]);
            of.all.push(Cluster {
                own: own..of.own.len(),
                samples: first..of.samples.len(),
            });
        }
        sets
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

/// Neighbours from which on a pose waits for all that have fewer, whatever becomes of theirs.
const MANY: usize = 64;

/// An order in which few poses come to share rows when one after the other is eliminated: next is always one of fewest
/// neighbours, and these become neighbours of each other (W. F. Tinney and J. W. Walker, Proc. IEEE 55, 1967).
fn by_least_degree(mut neighbours: Vec<BTreeSet<usize>>) -> Vec<usize> {
    let degrees = neighbours.iter().map(BTreeSet::len).enumerate();
    let mut waiting: BTreeSet<(usize, usize)> = degrees.map(|(pose, of)| (of, pose)).collect();
    let mut order = Vec::with_capacity(neighbours.len());
    while let Some((degree, pose)) = waiting.pop_first() {
        order.push(pose);
        if degree >= MANY {
            continue;
        }
        let beside = std::mem::take(&mut neighbours[pose]);
        for &own in &beside {
            waiting.remove(&(neighbours[own].len(), own));
            neighbours[own].extend(beside.iter().filter(|&&other| other != own));
            neighbours[own].remove(&pose);
            waiting.insert((neighbours[own].len(), own));
        }
    }
    order
}

/// Representative of the cluster of a pose.
fn root(parent: &mut [usize], mut pose: usize) -> usize {
    while parent[pose] != pose {
        parent[pose] = parent[parent[pose]];
        pose = parent[pose];
    }
    pose
}
