//! Columns of commands in each other's place.

use tau_robot::robot::Arm;

use crate::numerics::order::smallest_first;
use crate::trust::hypothesis::{Case, Hypothesis};

/// Columns of commands exchanged, the best few: each closure follows one command, so the misfit of each with every
/// column tells that of all permutations.
pub(super) fn exchanged_commands(case: &Case<'_>) -> Vec<Hypothesis> {
    // Robots that look alike from several sides leave a few orders that fit nearly as well.
    const KEPT: usize = 4;
    // 5040 orders are added up in a moment; of more commands, exchanges of two are tried.
    const MOST_PERMUTED: usize = 7;
    let count = case.robot.commands;
    let Ok(prepared) = case.prepared() else {
        return vec![];
    };
    let machine = &prepared.machine;
    let followed: Vec<Option<usize>> = machine
        .closure_instances()
        .map(|closure| command_of(case, closure.of))
        .collect();
    // By column, then by the command that it would hold.
    let mut misfits = vec![vec![0.0; count]; count];
    for sample in case.samples() {
        for (&command_m, own) in sample.commands_m.iter().zip(&mut misfits) {
            let commands_m = vec![command_m; count];
            let view = tau_kinematics::Sample {
                commands_m: &commands_m,
                ..sample.view()
            };
            let Ok(closures) = machine.closures(&view) else {
                return vec![];
            };
            for (residual, command) in closures.residuals.iter().zip(&followed) {
                if let Some(command) = *command {
                    own[command] += residual.powi(2);
                }
            }
        }
    }
    let orders = if count <= MOST_PERMUTED {
        permutations(count)
    } else {
        transpositions(count)
    };
    let misfit = |columns: &Vec<usize>| -> f64 {
        let pairs = columns.iter().enumerate();
        pairs
            .map(|(command, &column)| misfits[command][column])
            .sum()
    };
    let mut ranked: Vec<(f64, Vec<usize>)> = orders
        .into_iter()
        .skip(1)
        .map(|columns| (misfit(&columns), columns))
        .collect();
    smallest_first(&mut ranked, |own| own.0);
    ranked.truncate(KEPT);
    ranked
        .into_iter()
        .map(|(_, columns)| Hypothesis::Commands(columns))
        .collect()
}

/// The command that a closure, by its link or cluster, follows.
fn command_of(case: &Case<'_>, of: usize) -> Option<usize> {
    let robot = case.robot;
    match case.variant.arm {
        Arm::Full => {
            let link = robot.links.get(of)?;
            (link.actuated_by).or_else(|| robot.clusters.get(link.cluster)?.track)
        }
        Arm::Reduced => robot.clusters.get(of)?.track,
    }
}

/// All orders of so many numbers, the natural one first.
pub(crate) fn permutations(count: usize) -> Vec<Vec<usize>> {
    let mut all = vec![vec![]];
    for _ in 0..count {
        all = all
            .into_iter()
            .flat_map(|order: Vec<usize>| {
                (0..count)
                    .filter(|next| !order.contains(next))
                    .map(|next| [order.clone(), vec![next]].concat())
                    .collect::<Vec<_>>()
            })
            .collect();
    }
    all
}

/// Orders of so many commands that are tried one by one, without the natural one: all of few, else exchanges of two.
pub(crate) fn orders(count: usize) -> Vec<Vec<usize>> {
    let all = if count <= 3 {
        permutations(count)
    } else {
        transpositions(count)
    };
    all.into_iter().skip(1).collect()
}

/// The natural order of so many numbers, then those in which two are exchanged.
fn transpositions(count: usize) -> Vec<Vec<usize>> {
    let natural: Vec<usize> = (0..count).collect();
    let mut all = vec![natural.clone()];
    for one in 0..count {
        for other in one + 1..count {
            let mut order = natural.clone();
            order.swap(one, other);
            all.push(order);
        }
    }
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn permutations_are_all_there() {
        let all = permutations(3);
        assert_eq!(all[0], [0, 1, 2]);
        let every = [
            [0, 1, 2],
            [0, 2, 1],
            [1, 0, 2],
            [1, 2, 0],
            [2, 0, 1],
            [2, 1, 0],
        ];
        assert_eq!(
            all.into_iter().collect::<BTreeSet<_>>(),
            every.map(Vec::from).into()
        );
    }
}
