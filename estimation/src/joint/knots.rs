//! The measured points that piecewise tracks pass through: their noise is in every equation that asks for
//! the path.
//!
//! So the path is displaced at each point by an unknown, of which the position in set 2 is a measurement
//! like any other. Unknowns are tens of micrometres large, hence linear.

use nalgebra::{DMatrix, SymmetricEigen, Vector3};
use tau_kinematics::{Path, track_axes};
use tau_robot::robot::TrackShape;

use crate::joint::Joint;
use crate::problem::Eliminated;
use crate::samples::Sample;
use crate::samples::frames::joints_on;

/// Derivatives of all rows, in units of the stated noise, by the displacements of the points of all
/// piecewise tracks that set 2 takes part for; `None` where there are none.
pub fn columns(joint: &Joint, samples: &[Sample]) -> Option<DMatrix<f64>> {
    let is_measured = |track: usize| {
        samples
            .iter()
            .any(|sample| sample.set == 2 && sample.track == Some(track))
    };
    columns_of(joint, samples, is_measured, shapes)
}

/// The same of paths that no sample measures, by displacements of which each has the noise of a measured position:
/// shapes that parameters leave open, orthonormal.
pub fn columns_of_data(joint: &Joint, samples: &[Sample]) -> Option<DMatrix<f64>> {
    columns_of(joint, samples, |_| true, orthonormal_shapes)
}

/// Derivatives of all rows, of which those of groups come first, by the unknowns of targets, surfaces and balls.
pub(super) fn columns_of_objects(groups: &[Eliminated], rows: usize) -> DMatrix<f64> {
    let count = groups.first().map_or(0, |group| group.by_object.ncols());
    let mut columns = DMatrix::zeros(rows, count);
    let mut first = 0;
    for group in groups {
        let own = group.by_object.nrows();
        columns.rows_mut(first, own).copy_from(&group.by_object);
        first += own;
    }
    columns
}

/// Columns and others beside them.
pub(super) fn beside(left: &DMatrix<f64>, right: &DMatrix<f64>) -> DMatrix<f64> {
    let mut all = DMatrix::zeros(right.nrows(), left.ncols() + right.ncols());
    all.columns_mut(0, left.ncols()).copy_from(left);
    all.columns_mut(left.ncols(), right.ncols())
        .copy_from(right);
    all
}

fn columns_of(
    joint: &Joint,
    samples: &[Sample],
    takes_part: impl Fn(usize) -> bool,
    shapes: fn(&[f64], bool) -> DMatrix<f64>,
) -> Option<DMatrix<f64>> {
    let machine = &joint.machine;
    let paths: Vec<(usize, &Path)> = (machine.surroundings.paths.iter().enumerate())
        .zip(&machine.variant.tracks)
        .filter(|((track, _), model)| model.shape == TrackShape::Piecewise && takes_part(*track))
        .filter_map(|((track, path), _)| Some((track, path.as_ref()?)))
        .collect();
    if paths.is_empty() {
        return None;
    }
    let ones = vec![1.0; joint.rows.len()];
    let by_parameter = joint
        .linearize(&joint.fitted(&machine.values), &ones)
        .jacobian
        .dense();
    let blocks: Vec<DMatrix<f64>> = paths
        .into_iter()
        .flat_map(|(track, path)| of_track(joint, samples, &by_parameter, (track, path), shapes))
        .collect();
    let width = blocks.iter().map(DMatrix::ncols).sum();
    let mut columns = DMatrix::zeros(joint.rows.len(), width);
    let mut first = 0;
    for block in blocks {
        columns.columns_mut(first, block.ncols()).copy_from(&block);
        first += block.ncols();
    }
    Some(columns)
}

/// Those of one track, by axis: along, horizontal, vertical.
fn of_track(
    joint: &Joint,
    samples: &[Sample],
    by_parameter: &DMatrix<f64>,
    (track, path): (usize, &Path),
    shapes: fn(&[f64], bool) -> DMatrix<f64>,
) -> [DMatrix<f64>; 3] {
    let (first, last) = path.range();
    let axes = track_axes(path.at(last) - path.at(first));
    // A cart goes where the joints on it go, so it is displaced as their offsets displace them.
    let by_cart = by_displacement(joint, by_parameter, track);
    [0, 1, 2].map(|axis| {
        let shapes = shapes(path.commands(), axis > 0);
        let mut block = DMatrix::zeros(joint.rows.len(), shapes.ncols());
        for (row, at) in joint.rows.iter().enumerate() {
            let slope = by_cart[row].dot(&axes[axis]);
            if slope != 0.0 {
                for (knot, share) in path.shares(samples[at.sample].commands_m[track]) {
                    let mut entries = block.row_mut(row);
                    entries += shapes.row(knot) * (slope * share);
                }
            }
        }
        block
    })
}

/// Derivatives of each row by a displacement of a cart.
fn by_displacement(joint: &Joint, by_parameter: &DMatrix<f64>, track: usize) -> Vec<Vector3<f64>> {
    let variant = &joint.machine.variant;
    let mut by_cart = vec![Vector3::zeros(); joint.rows.len()];
    for owner in joints_on(&joint.machine, track) {
        for component in 0..3 {
            let column = variant
                .parameter(owner, "track_offset", Some(component))
                .and_then(|index| joint.used.binary_search(&index).ok());
            let Some(column) = column else { continue };
            for (row, derivatives) in by_cart.iter_mut().enumerate() {
                derivatives[component] += by_parameter[(row, column)];
            }
        }
    }
    by_cart
}

/// A basis of the displacements of points that the parameters of a path leave open, one column each: those
/// that neither shift it nor, across, turn it.
fn shapes(commands: &[f64], is_across: bool) -> DMatrix<f64> {
    let (open, taken) = open(commands, is_across);
    // Holding as many points leaves nothing open.
    open.columns(1, commands.len() - taken).into_owned()
}

/// An orthonormal basis of the same.
fn orthonormal_shapes(commands: &[f64], is_across: bool) -> DMatrix<f64> {
    let (open, taken) = open(commands, is_across);
    let eigen = SymmetricEigen::new(open);
    let mut order: Vec<usize> = (0..commands.len()).collect();
    order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
    eigen
        .eigenvectors
        .select_columns(&order[..commands.len() - taken])
}

/// The projection onto displacements that parameters leave open, and how many dimensions they take.
fn open(commands: &[f64], is_across: bool) -> (DMatrix<f64>, usize) {
    let count = commands.len();
    let taken = if is_across { 2 } else { 1 };
    let lines = DMatrix::from_fn(
        count,
        taken,
        |row, power| {
            if power == 0 { 1.0 } else { commands[row] }
        },
    );
    let q = lines.qr().q();
    (DMatrix::identity(count, count) - &q * q.transpose(), taken)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// All displacements but shifts and turns, each once.
    #[test]
    fn shapes_are_what_parameters_leave_open() {
        let commands = [-0.6, -0.2, 0.1, 0.15, 0.7];
        for (is_across, open) in [(false, 4), (true, 3)] {
            let orthonormal = orthonormal_shapes(&commands, is_across);
            let gram = orthonormal.tr_mul(&orthonormal);
            assert!((gram - DMatrix::identity(open, open)).amax() < 1e-12);
            let shapes = shapes(&commands, is_across);
            let outside = &shapes - &orthonormal * orthonormal.tr_mul(&shapes);
            assert!(outside.amax() < 1e-12);
            assert_eq!(shapes.ncols(), open);
            let singular = shapes.singular_values();
            assert!(singular.min() > 1e-2, "{singular}");
            for column in shapes.column_iter() {
                assert!(column.sum().abs() < 1e-12);
                let turn: f64 = column.iter().zip(&commands).map(|(d, q)| d * q).sum();
                assert_eq!(turn.abs() < 1e-12, is_across);
            }
        }
    }
}
