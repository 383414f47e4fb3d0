//! The measured points that piecewise tracks pass through: their noise is in every equation that asks for
//! the path.
//!
//! So the path is displaced at each point by an unknown, of which the position in set 2 is a measurement
//! like any other. Unknowns are tens of micrometres large, hence linear.

use nalgebra::{DMatrix, DVector, SymmetricEigen, Vector3};
use tau_kinematics::{Path, track_axes};
use tau_robot::robot::TrackShape;

use crate::joint::Joint;
use crate::problem::Eliminated;
use crate::samples::Sample;
use crate::samples::frames::joints_on;

/// Derivatives of all rows, in units of the stated noise, by unknowns that they are linear in: displacements of points that
/// tracks pass through, and of objects.
#[derive(Clone)]
pub(super) struct Knots {
    /// Of all rows by all unknowns: `H·S`.
    pub(super) columns: DMatrix<f64>,
    /// `H`, by rows: points that each depends on, which are few, with the derivatives.
    by_point: Vec<Vec<(usize, f64)>>,
    /// `S`: displacement of each point by each unknown.
    shapes: DMatrix<f64>,
}

impl Knots {
    /// None.
    pub(super) fn none(rows: usize) -> Self {
        Self {
            columns: DMatrix::zeros(rows, 0),
            by_point: vec![vec![]; rows],
            shapes: DMatrix::zeros(0, 0),
        }
    }

    /// Of the groups that rows begin with, by the unknowns of targets, surfaces and balls.
    pub(super) fn of_objects(groups: &[Eliminated], rows: usize) -> Self {
        let count = groups.first().map_or(0, |group| group.by_object.ncols());
        let mut knots = Self::none(rows);
        knots.columns = DMatrix::zeros(rows, count);
        knots.shapes = DMatrix::identity(count, count);
        let mut first = 0;
        for group in groups {
            let own = group.by_object.nrows();
            knots
                .columns
                .rows_mut(first, own)
                .copy_from(&group.by_object);
            first += own;
        }
        for (entries, row) in knots.by_point.iter_mut().zip(knots.columns.row_iter()) {
            let own = row.iter().copied().enumerate();
            entries.extend(own.filter(|(_, derivative)| *derivative != 0.0));
        }
        knots
    }

    /// These and others beside them.
    pub(super) fn beside(&self, right: &Self) -> Self {
        let (rows, left) = (self.columns.nrows(), self.shapes.shape());
        let mut columns = DMatrix::zeros(rows, left.1 + right.columns.ncols());
        columns.columns_mut(0, left.1).copy_from(&self.columns);
        let mut others = columns.columns_mut(left.1, right.columns.ncols());
        others.copy_from(&right.columns);
        let of_right = right.shapes.shape();
        let mut shapes = DMatrix::zeros(left.0 + of_right.0, left.1 + of_right.1);
        shapes.view_mut((0, 0), left).copy_from(&self.shapes);
        shapes.view_mut(left, of_right).copy_from(&right.shapes);
        let mut by_point = self.by_point.clone();
        for (all, own) in by_point.iter_mut().zip(&right.by_point) {
            all.extend(
                own.iter()
                    .map(|&(point, derivative)| (left.0 + point, derivative)),
            );
        }
        Self {
            columns,
            by_point,
            shapes,
        }
    }

    /// Change of each row by amounts of the unknowns.
    pub(super) fn moved(&self, amounts: &[f64]) -> impl Iterator<Item = f64> {
        let points = &self.shapes * DVector::from_column_slice(amounts);
        (self.by_point.iter())
            .map(move |own| own.iter().map(|&(point, by)| by * points[point]).sum())
    }

    /// Products of all columns with a number for each row.
    pub(super) fn gradient(&self, rows: impl Iterator<Item = f64>) -> DVector<f64> {
        let mut of_points = DVector::zeros(self.shapes.nrows());
        for (own, number) in self.by_point.iter().zip(rows) {
            own.iter()
                .for_each(|&(point, by)| of_points[point] += by * number);
        }
        self.shapes.tr_mul(&of_points)
    }
}

/// By the displacements of the points of all piecewise tracks that set 2 takes part for; `None` where there are none.
pub(super) fn measured(joint: &Joint, samples: &[Sample]) -> Option<Knots> {
    let is_measured = |track: usize| {
        samples
            .iter()
            .any(|sample| sample.set == 2 && sample.track == Some(track))
    };
    knots_of(joint, samples, is_measured, shapes)
}

/// The same of paths that no sample measures, by displacements of which each has the noise of a measured position:
/// shapes that parameters leave open, orthonormal.
pub(super) fn of_data(joint: &Joint, samples: &[Sample]) -> Option<Knots> {
    knots_of(joint, samples, |_| true, orthonormal_shapes)
}

fn knots_of(
    joint: &Joint,
    samples: &[Sample],
    takes_part: impl Fn(usize) -> bool,
    shapes: fn(&[f64], bool) -> DMatrix<f64>,
) -> Option<Knots> {
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
    let of_paths: Vec<Knots> = paths
        .into_iter()
        .flat_map(|(track, path)| of_track(joint, samples, &by_parameter, (track, path), shapes))
        .collect();
    let none = Knots::none(joint.rows.len());
    Some(of_paths.iter().fold(none, |all, own| all.beside(own)))
}

/// Those of one track, by axis: along, horizontal, vertical.
fn of_track(
    joint: &Joint,
    samples: &[Sample],
    by_parameter: &DMatrix<f64>,
    (track, path): (usize, &Path),
    shapes: fn(&[f64], bool) -> DMatrix<f64>,
) -> [Knots; 3] {
    let (first, last) = path.range();
    let axes = track_axes(path.at(last) - path.at(first));
    // A cart goes where the joints on it go, so it is displaced as their offsets displace them.
    let by_cart = by_displacement(joint, by_parameter, track);
    [0, 1, 2].map(|axis| {
        let shapes = shapes(path.commands(), axis > 0);
        let mut columns = DMatrix::zeros(joint.rows.len(), shapes.ncols());
        let mut by_point = vec![vec![]; joint.rows.len()];
        for (row, at) in joint.rows.iter().enumerate() {
            let slope = by_cart[row].dot(&axes[axis]);
            if slope != 0.0 {
                for (knot, share) in path.shares(samples[at.sample].commands_m[track]) {
                    let mut entries = columns.row_mut(row);
                    entries += shapes.row(knot) * (slope * share);
                    by_point[row].push((knot, slope * share));
                }
            }
        }
        Knots {
            columns,
            by_point,
            shapes,
        }
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
