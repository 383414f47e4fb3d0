//! The plate's pose while carts are measured.

use std::collections::BTreeMap;

use tau_kinematics::{self as kinematics, Machine, Pose, Statics};
use tau_robot::robot_file::RobotFile;

use super::Sample;

/// The plate's pose in sets 2 and 3, and the weight of the arm on its carts. In set 2 all carts move equally, which
/// changes the load where their tracks are not parallel.
pub fn place_plates(machine: &Machine, file: &RobotFile, samples: &mut [Sample]) {
    let known: Vec<(Vec<f64>, Pose)> = samples
        .iter()
        .filter(|sample| sample.set == 1)
        .map(|sample| (sample.commands_m.clone(), sample.pose))
        .collect();
    let statics = Statics::new(&machine.robot, file);
    let pose_at = |commands_m: &[f64]| {
        let distance = |commands: &[f64]| -> f64 {
            let differences = commands.iter().zip(commands_m);
            differences.map(|(a, b)| (a - b).powi(2)).sum()
        };
        let nearest = known
            .iter()
            .min_by(|a, b| distance(&a.0).total_cmp(&distance(&b.0)));
        let start = kinematics::Sample::new(nearest?.1, commands_m);
        machine.forward_unchecked(&start).ok()
    };
    // Carts are measured at the same commands, one after the other.
    let mut placed: BTreeMap<Vec<u64>, Option<Pose>> = BTreeMap::new();
    for sample in samples {
        if sample.set != 1 {
            let commands = sample.commands_m.iter().map(|command| command.to_bits());
            let plate = placed.entry(commands.collect());
            sample.plate = *plate.or_insert_with(|| pose_at(&sample.commands_m));
        }
        if let Some(statics) = &statics {
            sample.load(statics);
        }
    }
}
