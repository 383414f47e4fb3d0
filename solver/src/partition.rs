//! Independent parts of a problem.

use crate::Problem;

/// Free parameters that share residuals, directly or through others, and the blocks they occur in.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Part {
    /// Indices of parameters, ascending.
    pub(crate) parameters: Vec<usize>,
    /// Indices of blocks, ascending.
    pub(crate) blocks: Vec<usize>,
}

/// A problem split into independent parts.
pub(crate) struct Partition {
    /// Parts in order of their first parameter.
    pub(crate) parts: Vec<Part>,
    /// Blocks in which no parameter is free.
    pub(crate) constant_blocks: Vec<usize>,
}

/// Disjoint sets of the numbers below a bound.
pub(crate) struct DisjointSets {
    parent: Vec<usize>,
}

impl DisjointSets {
    pub(crate) fn new(len: usize) -> Self {
        Self {
            parent: (0..len).collect(),
        }
    }

    /// The least member of the set that holds `i`.
    pub(crate) fn find(&mut self, mut i: usize) -> usize {
        while self.parent[i] != i {
            self.parent[i] = self.parent[self.parent[i]];
            i = self.parent[i];
        }
        i
    }

    pub(crate) fn union(&mut self, i: usize, j: usize) {
        let (i, j) = (self.find(i), self.find(j));
        self.parent[i.max(j)] = i.min(j);
    }
}

/// Splits a checked problem. A free parameter that neither block nor prior mentions is in no part.
pub(crate) fn partition(problem: &Problem) -> Partition {
    let count = problem.parameters.len();
    let mut sets = DisjointSets::new(count);
    let mut used = vec![false; count];
    let mut constant_blocks = Vec::new();
    let mut first_parameter = vec![None; problem.blocks.len()];

    for (b, block) in problem.blocks.iter().enumerate() {
        let mut columns = block.family.pattern().columns.to_vec();
        columns.sort_unstable();
        columns.dedup();
        let shared = columns.partition_point(|&column| (column as usize) < block.parameters.len());
        let mut uses = |sample: usize, columns: &[u32]| {
            for &column in columns {
                let p = block.parameter(sample, column as usize);
                if problem.parameters[p].is_free() {
                    used[p] = true;
                    let first = *first_parameter[b].get_or_insert(p);
                    sets.union(first, p);
                }
            }
        };
        uses(0, &columns[..shared]);
        if shared < columns.len() {
            for sample in 0..block.samples {
                uses(sample, &columns[shared..]);
            }
        }
        if first_parameter[b].is_none() {
            constant_blocks.push(b);
        }
    }

    let mut part_of_root = vec![None; count];
    let mut parts: Vec<Part> = Vec::new();
    for (p, parameter) in problem.parameters.iter().enumerate() {
        if parameter.is_free() && (used[p] || parameter.prior.is_some()) {
            let root = sets.find(p);
            let part = *part_of_root[root].get_or_insert_with(|| {
                parts.push(Part {
                    parameters: Vec::new(),
                    blocks: Vec::new(),
                });
                parts.len() - 1
            });
            parts[part].parameters.push(p);
        }
    }
    for (b, first) in first_parameter.into_iter().enumerate() {
        if let Some(part) = first.and_then(|p| part_of_root[sets.find(p)]) {
            parts[part].blocks.push(b);
        }
    }
    Partition {
        parts,
        constant_blocks,
    }
}
