//! The frame in which poses were measured, against that of the drawing.

use nalgebra::Matrix3;
use tau_kinematics::Pose;

use crate::calibration::{centres, turn_of};
use crate::trust::hypothesis::{Case, Hypothesis};

/// The rigid motion that carries the measured poses to where the machine as drawn takes them, by least squares (W. Kabsch,
/// Acta Crystallographica A32, 1976); `None` where no reference says how the arm is assembled, or no pose is reached.
pub(super) fn of_drawing(case: &Case<'_>) -> Option<Hypothesis> {
    let machine = case.prepared().ok()?.machine;
    let samples = case.samples();
    let pairs: Vec<(Pose, Pose)> = (samples.iter())
        .filter_map(|sample| {
            let sample = sample.view();
            let start = machine.at_reference(&sample).ok()?;
            let from = sample.at(start.pose);
            let reached = machine.forward_along(&start.commands_m, &from).ok()?;
            Some((sample.pose, reached.pose))
        })
        .collect();
    if pairs.is_empty() {
        return None;
    }
    let places = pairs.iter().map(|own| [own.0.position, own.1.position]);
    let [from, to] = centres(places);
    let length_m = case.mean_length_m();
    let mut products = Matrix3::zeros();
    for (measured, drawn) in &pairs {
        products += (drawn.position - to) * (measured.position - from).transpose();
        if machine.turns() {
            // Points of the plate as far from the TCP as links are long.
            let turn = drawn.rotation * measured.rotation.inverse();
            products += turn.matrix() * length_m.powi(2);
        }
    }
    let rotation = turn_of(products, case.robot.plate.freedoms_of_tcp().len() < 3);
    Some(Hypothesis::Frame {
        rotation,
        shift: to - rotation * from,
    })
}
