//! Commands at which a driven length would be negative.
//!
//! A closure holds the square of a length, and says as little of its sign. The stated reference says it: from there to a
//! command at which the closure changes with the command in the opposite sense, the length passes through nothing, or, of
//! a belt before a rigid arm, the belt. Counted from a zero that is known by the fit alone, commands may be negative.

use tau_kinematics::{Machine, POSE_COLUMNS, Pose, Sample};
use tau_robot::robot::Arm;

/// The first command that drives a length below zero in most of the rows, if there is one.
pub(crate) fn negative_length<'a>(
    machine: &Machine,
    rows: impl Iterator<Item = &'a [f64]>,
) -> Option<usize> {
    let stated = machine.surroundings.reference.as_ref()?;
    let pose = Pose::from(stated);
    let closures = machine.closure_instances().enumerate();
    let driven = closures.filter_map(|(row, closure)| {
        let link = machine.robot.links.get(closure.of)?;
        Some((row, link.actuated_by?))
    });
    let driven: Vec<(usize, usize)> = driven.collect();
    if driven.is_empty() || machine.variant.arm == Arm::Reduced {
        return None;
    }
    // Half of the slope is the length times its own slope.
    let slopes = |commands_m: &[f64]| {
        let closures = machine.closures(&Sample::new(pose, commands_m)).ok()?;
        let slope =
            |&(row, command): &(usize, usize)| closures.jacobian[(row, POSE_COLUMNS + command)];
        Some(driven.iter().map(slope).collect::<Vec<f64>>())
    };
    let known = slopes(&stated.commands_m)?;
    let mut counts = vec![0_usize; driven.len()];
    let mut total = 0;
    for own in rows.filter_map(slopes) {
        total += 1;
        for (count, (own, known)) in counts.iter_mut().zip(own.iter().zip(&known)) {
            *count += usize::from(own * known < 0.0);
        }
    }
    let found = counts.iter().position(|count| 2 * count > total);
    found.map(|index| driven[index].1)
}
