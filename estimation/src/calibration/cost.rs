//! The paper's cost of a closure.

use tau_kinematics::{Machine, Sample};
use tau_robot::measurements::TcpPose;
use tau_robot::robot::Instance;

use crate::machine::error::Error;

/// The paper's cost of one closure: sum over poses of the squared closure residual (m⁴).
///
/// # Errors
/// Columns that the variant needs are missing.
pub(crate) fn closure_cost(
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
        let filled = machine.fill(instance, &Sample::from(*pose), &mut data);
        filled.map_err(|error| Error::at_pose(pose.pose, error))?;
        instance.family.prepare(&data, &mut prepared);
        let mut residual = [0.0];
        instance.family.value(&prepared, &parameters, &mut residual);
        cost += residual[0] * residual[0];
    }
    Ok(cost)
}
