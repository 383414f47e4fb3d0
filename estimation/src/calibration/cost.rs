//! The paper's cost of a closure.

use tau_kinematics::{self as kinematics, Machine, Sample};
use tau_robot::measurements::TcpPose;
use tau_robot::robot::Instance;

use super::error::Error;

/// The paper's cost of one closure: sum over poses of the squared closure residual (m⁴).
///
/// # Errors
/// Columns that the variant needs are missing.
pub fn closure_cost(
    machine: &Machine,
    instance: &Instance,
    poses: &[&TcpPose],
) -> Result<f64, Error> {
    let shape = instance.family.shape();
    let parameters: Vec<f64> = instance
        .parameters
        .iter()
        .map(|&p| machine.values[p])
        .collect();
    let (mut data, mut prepared) = (Vec::new(), vec![0.0; shape.prepared]);
    let mut cost = 0.0;
    for pose in poses {
        data.clear();
        fill(machine, instance, pose, &mut data)?;
        instance.family.prepare(&data, &mut prepared);
        let mut residual = [0.0];
        instance.family.value(&prepared, &parameters, &mut residual);
        cost += residual[0] * residual[0];
    }
    Ok(cost)
}

/// Appends the data that a closure takes of a pose.
pub(super) fn fill(
    machine: &Machine,
    instance: &Instance,
    pose: &TcpPose,
    data: &mut Vec<f64>,
) -> Result<(), Error> {
    machine
        .surroundings
        .fill(&instance.inputs, &Sample::from(pose), data)
        .map_err(|what| {
            let closure = machine.closure_name(instance).to_owned();
            Error::at_pose(pose.pose, kinematics::Error::Missing { closure, what })
        })
}
