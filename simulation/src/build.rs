//! The machine that was built instead of the one of the drawings.

use nalgebra::Vector3;
use tau_robot::robot::{Arm, Robot, TrackShape, Variant};

use super::drawing::Drawing;
use super::machine::Machine;
use super::parts::{Pose, Rod};
use super::random::Random;

/// Differences of the true machine from its drawings.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Build {
    /// Exactly as the robot file says.
    Exact,
    /// Drawn at random from the tolerances.
    ///
    /// Carts are rigid: what the joints of a cart have in common is drawn from the tolerances of the
    /// tracks, each joint's own error on its cart from that of the plate joints, and the cart turns by
    /// some 100 µrad a metre. Formulas follow from what they read; what is exact, or held by the variant whose
    /// simplifications the machine keeps, or else by the [ordinary one](tau_robot::robot::Robot::base), is as drawn.
    Drawn {
        /// Share of the tolerance of lengths and joints, of cranks, pulls and parameters of the machine.
        links: f64,
        /// Share of the tolerance of the tracks' offsets and directions, and of joints on the fixed base: they stand in
        /// place far better than a first guess of the tracker's frame says.
        tracks: f64,
    },
}

impl Default for Build {
    fn default() -> Self {
        Self::Drawn {
            links: 1.0,
            tracks: 0.1,
        }
    }
}

/// Rotation of a drawn machine's carts along their track (rad/m), one standard deviation.
const CART_TURN: f64 = 1e-4;

/// A machine drawn from the tolerances.
pub(super) fn drawn(drawing: &Drawing<'_>, links: f64, tracks: f64, seed: u64) -> Machine {
    let (nominal, tolerances) = (&drawing.nominal, &drawing.tolerances);
    let mut machine = nominal.clone();
    let mut random = Random::new(seed, "machine");
    for (rod, tolerance) in machine.rods.iter_mut().zip(&tolerances.links) {
        rod.length_m += links * tolerance.length * random.normal();
        rod.plate_joint_m += random.normals() * (links * tolerance.plate_joint);
        let crank = rod.track.and_then(|track| nominal.crank(track));
        let own = match (rod.track, crank) {
            (Some(_), Some(_)) => links * tolerance.track_offset,
            // A joint on a cart is made like one on the plate.
            (Some(_), None) => links * tolerance.plate_joint,
            (None, _) => tracks * tolerance.track_offset,
        };
        rod.track_offset_m += random.normals() * own;
    }
    for track in nominal.guideways() {
        let on_cart: Vec<usize> = (0..machine.rods.len())
            .filter(|&k| machine.rods[k].track == Some(track))
            .collect();
        let Some(&first) = on_cart.first() else {
            continue;
        };
        let tolerance = tolerances.links[first];
        let shift = random.normals() * (tracks * tolerance.track_offset);
        let swing = random.normals() * (tracks * tolerance.track_direction);
        let turn = random.normals() * (links * CART_TURN);
        let turn = if tolerance.is_free_to_turn {
            turn
        } else {
            Vector3::zeros()
        };
        let direction = nominal.direction(track) + swing;
        let centre = on_cart
            .iter()
            .map(|&k| machine.rods[k].track_offset_m)
            .sum::<Vector3<f64>>()
            / on_cart.len() as f64;
        for &k in &on_cart {
            let rod = &mut machine.rods[k];
            rod.track_direction = direction + turn.cross(&(rod.track_offset_m - centre));
            rod.track_offset_m += shift;
        }
    }
    let mut random = Random::new(seed, "parameters");
    for (name, values) in &mut machine.parameters {
        let tolerance = tolerances.parameters.get(name).copied().unwrap_or(0.0);
        for value in values {
            *value += links * tolerance * random.normal();
        }
    }
    let mut random = Random::new(seed, "cranks");
    for (crank, [of_centre, of_axis]) in machine.cranks.iter_mut().zip(&tolerances.cranks) {
        if let Some(crank) = crank {
            crank.centre_m += random.normals() * (links * of_centre);
            crank.axis += random.normals() * (links * of_axis);
        }
    }
    let mut random = Random::new(seed, "pulls");
    for (rod, tolerance) in machine.rods.iter_mut().zip(&tolerances.links) {
        if let Some(pull) = &mut rod.pull_n {
            *pull += links * tolerance.pull * random.normal();
        }
    }
    drawing.follow(&mut machine);
    machine
}

/// Makes the machine as simple as a variant takes it: with a reduced arm, the links of a cluster
/// parallel and of one length at the given orientation; without paths per link, one direction a cart.
pub(super) fn simplify(machine: &mut Machine, robot: &Robot, variant: &Variant, home: Pose) {
    for (track, model) in variant.tracks.iter().enumerate() {
        if !model.per_link && model.shape != TrackShape::Crank {
            let direction = machine.direction(track);
            for rod in machine
                .rods
                .iter_mut()
                .filter(|rod| rod.track == Some(track))
            {
                rod.track_direction = direction;
            }
        }
    }
    if variant.arm != Arm::Reduced {
        return;
    }
    for cluster in 0..robot.clusters.len() {
        let links = robot.links_of_cluster(cluster);
        let Some(&first) = links.first() else {
            continue;
        };
        let count = links.len() as f64;
        let arm = |rod: &Rod| rod.track_offset_m - home.rotation * rod.plate_joint_m;
        let mean = links
            .iter()
            .map(|&k| arm(&machine.rods[k]))
            .sum::<Vector3<f64>>()
            / count;
        let length = links.iter().map(|&k| machine.rods[k].length_m).sum::<f64>() / count;
        let direction = machine.rods[first]
            .track
            .map(|track| machine.direction(track));
        for &k in &links {
            let rod = &mut machine.rods[k];
            rod.track_offset_m = mean + home.rotation * rod.plate_joint_m;
            rod.length_m = length;
            rod.track_direction = direction.unwrap_or_else(Vector3::zeros);
        }
    }
}
