//! The plate's pose while carts are measured.

use std::collections::BTreeMap;

use tau_kinematics::{self as kinematics, Machine, Pose};

use super::Sample;

/// The plate's pose in sets 2 and 3, and the weight of the arm on its carts. In set 2 all carts move equally, which
/// changes the load where their tracks are not parallel. The machine is followed from the nearest pose of set 1, or, where
/// there is none, from its reference.
pub fn place_plates(machine: &Machine, samples: &mut [Sample]) {
    let known: Vec<(Vec<f64>, Pose)> = samples
        .iter()
        .filter(|sample| sample.set == 1)
        .map(|sample| (sample.commands_m.clone(), sample.pose))
        .collect();
    let pose_at = |sample: &Sample| {
        let distance = |commands: &[f64]| -> f64 {
            let differences = commands.iter().zip(&sample.commands_m);
            differences.map(|(a, b)| (a - b).powi(2)).sum()
        };
        let nearest = known
            .iter()
            .min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)));
        // The other carts' sides of approach were not noted: the middle of what they may be is near enough for a load.
        let directions = sample.directions().iter();
        let directions: Vec<f64> = directions
            .map(|&direction| if direction.is_nan() { 0.0 } else { direction })
            .collect();
        let like = kinematics::Sample {
            plate: None,
            forces: None,
            directions: Some(&directions),
            ..sample.view()
        };
        match nearest {
            Some((_, pose)) => machine.forward_unchecked(&like.at(*pose)).ok(),
            None => from_reference(machine, &like),
        }
    };
    // Carts are measured at the same commands, one after the other.
    let mut placed: BTreeMap<Vec<u64>, Option<Pose>> = BTreeMap::new();
    for sample in samples {
        if sample.set != 1 {
            let commands = sample.commands_m.iter().map(|command| command.to_bits());
            let plate = placed.entry(commands.collect());
            sample.plate = *plate.or_insert_with(|| pose_at(sample));
        }
        if let Some(statics) = &machine.surroundings.statics {
            sample.load(statics);
        }
    }
}

/// The plate's pose at the commands of a sample, whose own pose does not matter, on the way from the machine's reference.
fn from_reference(machine: &Machine, sample: &kinematics::Sample<'_>) -> Option<Pose> {
    let known = machine.at_reference(sample).ok()?;
    let reached = machine.forward_along(&known.commands_m, &sample.at(known.pose));
    Some(reached.ok()?.pose)
}
