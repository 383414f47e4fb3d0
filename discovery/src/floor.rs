//! The error that noise alone leaves on the validation poses.

use nalgebra::DMatrix;
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::parallel;
use tau_kinematics::{Machine, Sample, least_norm};
use tau_robot::measurements::{Folder, TcpPose};
use tau_robot::robot::TrackShape;
use tau_robot::robot_file::Noise;
use tau_runtime::{Owner, ResidualKind};

use super::Error;

/// Expected mean and mean square (m, m²) of the position error.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Floor {
    pub(super) mean_m: f64,
    pub(super) square_m2: f64,
}

/// By propagating the stated noise of the measured position, of drives and of links, and what it leaves of the calibrated
/// parameters through the forward kinematics. The noise is the stated one even where a model leaves more: what is more is
/// what a better model could remove.
pub(super) fn floor(
    fit: &Fit,
    machine: &Machine,
    folder: &Folder,
    poses: &[usize],
    noise: Noise,
) -> Result<Floor, Error> {
    let deviations = fit.deviations_at_stated_noise();
    let unknowns = machine.pose_unknowns();
    let axes = unknowns.iter().take_while(|&&motion| motion < 3).count();
    let closures: Vec<_> = machine
        .variant
        .instances_of(ResidualKind::Closure)
        .collect();
    // Mean and mean square at a pose; nothing where nothing holds it.
    let of_pose = |measured: &TcpPose| -> Result<Option<(f64, f64)>, Error> {
        let sample = Sample::from(measured);
        let mut by_pose = DMatrix::zeros(closures.len(), unknowns.len());
        let mut by_parameter = DMatrix::zeros(closures.len(), deviations.nrows());
        let mut by_path = DMatrix::zeros(closures.len(), 3 * machine.variant.tracks.len());
        let lengths = machine
            .length_scatter(&sample)
            .map_err(|error| Error::at_pose(measured.pose, error))?;
        let mut by_length = DMatrix::zeros(closures.len(), lengths.ncols());
        for (row, closure) in closures.iter().enumerate() {
            let mut pairs = machine.closure_instances().enumerate();
            let Some((place, pair)) = pairs.find(|(_, pair)| pair.of == closure.of) else {
                continue;
            };
            by_length.set_row(row, &lengths.row(place));
            let (_, gradient) = machine
                .closure_by_pose(pair, &sample)
                .map_err(|error| Error::at_pose(measured.pose, error))?;
            for (column, &motion) in unknowns.iter().enumerate() {
                by_pose[(row, column)] = gradient[motion];
            }
            let (family, shape) = (&closure.family, closure.family.shape());
            let mut data = Vec::new();
            let filled = machine
                .surroundings
                .fill(&closure.inputs, &sample, &mut data);
            if filled.is_err() {
                continue;
            }
            let mut prepared = vec![0.0; shape.prepared];
            family.prepare(&data, &mut prepared);
            let local: Vec<f64> = closure
                .parameters
                .iter()
                .map(|&p| machine.values[p])
                .collect();
            let (mut residual, mut entries) = ([0.0], vec![0.0; family.pattern().len()]);
            family.linearize(&prepared, &local, &mut residual, &mut entries);
            for (&column, entry) in family.pattern().columns.iter().zip(&entries) {
                let index = closure.parameters[column as usize];
                if let Ok(place) = fit.joint.used.binary_search(&index) {
                    by_parameter[(row, place)] = *entry;
                }
                if let Some((place, sigma)) = of_path(machine, index, &sample) {
                    by_path[(row, place)] += entry * sigma * noise.position_m;
                }
            }
        }
        let of_parameters = by_parameter * &deviations;
        let parts = [of_parameters, by_path, by_length];
        let columns = parts.iter().flat_map(DMatrix::column_iter);
        let width = parts.iter().map(DMatrix::ncols).sum();
        let mut spread = DMatrix::zeros(closures.len(), width);
        for (mut to, from) in spread.column_iter_mut().zip(columns) {
            to.copy_from(&from);
        }
        let Some(moved) = least_norm(&by_pose, &spread) else {
            return Ok(None);
        };
        // Columns of translation come first.
        let position = moved.rows(0, axes);
        let covariance = DMatrix::identity(axes, axes) * noise.position_m.powi(2)
            + position * position.transpose();
        let trace = covariance.trace();
        // Mean length of a normal vector, to second order in how uneven its covariance is.
        let spread = (&covariance * &covariance).trace() / trace.powi(2);
        Ok(Some((trace.sqrt() * (1.0 - 0.25 * spread), trace)))
    };
    let measured: Vec<&TcpPose> = (poses.iter())
        .filter_map(|&pose| folder.tcp_poses.get(pose))
        .collect();
    let (mut floor, mut count) = (Floor::default(), 0.0);
    // Added in order, so that the sums do not depend on threads.
    for of_pose in parallel::map(&measured, |own| of_pose(own)) {
        if let Some((mean_m, square_m2)) = of_pose? {
            floor.mean_m += mean_m;
            floor.square_m2 += square_m2;
            count += 1.0;
        }
    }
    if count > 0.0 {
        floor.mean_m /= count;
        floor.square_m2 /= count;
    }
    Ok(floor)
}

/// Coordinate of a cart that a parameter displaces, and the noise there of the path that is interpolated
/// through measured points, over that of a point; `None` where nothing is interpolated.
fn of_path(machine: &Machine, parameter: usize, sample: &Sample<'_>) -> Option<(usize, f64)> {
    let (robot, variant) = (&machine.robot, &machine.variant);
    let parameter = &variant.parameters[parameter];
    let cluster = match parameter.owner {
        Owner::Link(link) => robot.links[link].cluster,
        Owner::Cluster(cluster) => cluster,
        _ => return None,
    };
    let track = robot.clusters[cluster].track?;
    if parameter.quantity != "track_offset" || variant.tracks[track].shape != TrackShape::Piecewise
    {
        return None;
    }
    let path = machine.surroundings.paths.get(track)?.as_ref()?;
    let [(_, from), (_, to)] = path.shares(*sample.commands_m.get(track)?);
    Some((3 * track + parameter.component?, from.hypot(to)))
}
