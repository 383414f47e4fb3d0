//! The frame in which poses were measured, against that of the drawing.

use nalgebra::{Matrix3, Rotation3, Vector3};
use tau_kinematics::{Pose, nearest_rotation};

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
    let count = pairs.len() as f64;
    if pairs.is_empty() {
        return None;
    }
    let sum = pairs.iter().fold([Vector3::zeros(); 2], |[from, to], own| {
        [from + own.0.position, to + own.1.position]
    });
    let [from, to] = sum.map(|sum| sum / count);
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
    let rotation = if case.robot.plate.freedoms_of_tcp().len() < 3 {
        // A plane is turned in itself alone.
        let (along, across) = (products.m11 + products.m22, products.m21 - products.m12);
        Rotation3::from_axis_angle(&Vector3::z_axis(), across.atan2(along))
    } else {
        nearest_rotation(products)
    };
    Some(Hypothesis::Frame {
        rotation,
        shift: to - rotation * from,
    })
}
