//! The frame in which positions and poses were measured, against that of the drawing.

use nalgebra::Matrix3;
use tau_kinematics::Error::Inconsistent;
use tau_kinematics::{Machine, Pose};
use tau_robot::robot::Plate;

use crate::calibration::{centres, turn_of};
use crate::samples::Sample;
use crate::trust::hypothesis::{Case, Hypothesis, THOUSAND};

/// A measured place or pose of the plate, and where the drawing has it.
pub(crate) struct Place {
    pub(crate) measured: Pose,
    pub(crate) drawn: Pose,
    /// Rotations count as points of the plate so far (m) from its TCP; zero where none was measured.
    pub(crate) lever_m: f64,
}

/// The rigid motion that carries the measured poses to where the machine as drawn takes them; `None` where no reference says
/// how the arm is assembled, or no pose is reached.
pub(super) fn of_drawing(case: &Case<'_>) -> Option<Hypothesis> {
    let machine = case.prepared().ok()?.machine;
    let samples = case.samples();
    let length_m = case.mean_length_m();
    let places = samples.iter().filter_map(|sample| {
        Some(Place {
            measured: sample.view().pose,
            drawn: as_drawn(&machine, sample)?,
            lever_m: if machine.turns() { length_m } else { 0.0 },
        })
    });
    carrying(&places.collect::<Vec<_>>(), case.robot.plate)
}

/// Where the machine as drawn takes the plate at the commands of a sample, from its reference on.
pub(crate) fn as_drawn(machine: &Machine, sample: &Sample) -> Option<Pose> {
    let sample = sample.view();
    let start = machine.at_reference(&sample).ok()?;
    let from = sample.at(start.pose);
    let reached = match machine.forward_along(&start.commands_m, &from) {
        // Redundant drives agree about the drawing roughly.
        Err(Inconsistent { .. }) => machine.forward_fitted(&from),
        reached => reached,
    };
    Some(reached.ok()?.pose)
}

/// The rigid motion that carries measured places to the drawn ones, by least squares (W. Kabsch, Acta Crystallographica A32,
/// 1976); `None` of none.
pub(crate) fn carrying(places: &[Place], plate: Plate) -> Option<Hypothesis> {
    if places.is_empty() {
        return None;
    }
    let pairs = places.iter();
    let [from, to] = centres(pairs.map(|own| [own.measured.position, own.drawn.position]));
    let mut products = Matrix3::zeros();
    for Place {
        measured,
        drawn,
        lever_m,
    } in places
    {
        products += (drawn.position - to) * (measured.position - from).transpose();
        let turn = drawn.rotation * measured.rotation.inverse();
        products += turn.matrix() * lever_m.powi(2);
    }
    let rotation = turn_of(products, plate.freedoms_of_tcp().len() < 3);
    Some(Hypothesis::Frame {
        rotation,
        shift: to - rotation * from,
    })
}

/// −2 ln of the share of a frame among those that tolerances leave.
pub(crate) fn room() -> f64 {
    // Tolerances tell each of six numbers to a thousandth of the machine's size or so.
    6.0 * 2.0 * THOUSAND.ln()
}
