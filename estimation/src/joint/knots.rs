//! The measured points that piecewise tracks pass through: their noise is in every equation that asks for
//! the path.
//!
//! So the path is displaced at each point by an unknown, of which the position in set 2 is a measurement
//! like any other. Unknowns are tens of micrometres large, hence linear.

use nalgebra::{DMatrix, SymmetricEigen, Vector3};
use tau_kinematics::{Path, track_axes};
use tau_robot::robot::TrackShape;

use crate::joint::Joint;
use crate::numerics::order::largest_first;
use crate::problem::Eliminated;
use crate::samples::Sample;
use crate::samples::frames::joints_on;

/// Derivatives of all rows, in units of the stated noise, by unknowns that they are linear in: displacements of points that
/// tracks pass through, and of objects.
///
/// A row depends on few points, and a point is displaced by few unknowns: all together they are never written down.
#[derive(Debug, Clone)]
pub(super) struct Knots {
    /// Of each row, the points that it depends on, with its derivatives.
    by_point: Vec<Vec<(usize, f64)>>,
    points: Vec<Point>,
    /// Number of the unknowns.
    pub(super) count: usize,
}

/// A point, and its displacement by each of successive unknowns, of which the first is given.
#[derive(Debug, Clone)]
struct Point {
    first: usize,
    shares: Vec<f64>,
}

impl Point {
    /// The unknowns, with the displacement by each.
    fn by_unknown(&self) -> impl Iterator<Item = (usize, f64)> {
        (self.first..).zip(self.shares.iter().copied())
    }
}

impl Knots {
    /// None.
    pub(super) fn none(rows: usize) -> Self {
        Self {
            by_point: vec![vec![]; rows],
            points: vec![],
            count: 0,
        }
    }

    /// Of the groups that rows begin with, by the unknowns of targets, surfaces and balls.
    pub(super) fn of_objects(groups: &[Eliminated], rows: usize) -> Self {
        let count = groups.first().map_or(0, |group| group.by_object.ncols());
        let of_groups = groups.iter().flat_map(|group| group.by_object.row_iter());
        let mut knots = Self::none(rows);
        for (entries, row) in knots.by_point.iter_mut().zip(of_groups) {
            let own = row.iter().copied().enumerate();
            entries.extend(own.filter(|(_, derivative)| *derivative != 0.0));
        }
        let itself = |first| Point {
            first,
            shares: vec![1.0],
        };
        Self {
            points: (0..count).map(itself).collect(),
            count,
            ..knots
        }
    }

    /// These and others beside them.
    pub(super) fn beside(mut self, others: Self) -> Self {
        let before = self.points.len();
        for (all, own) in self.by_point.iter_mut().zip(others.by_point) {
            all.extend(own.iter().map(|&(point, by)| (before + point, by)));
        }
        let behind = others.points.into_iter().map(|point| Point {
            first: self.count + point.first,
            ..point
        });
        self.points.extend(behind);
        self.count += others.count;
        self
    }

    /// Unknowns that a row depends on, some of them several times.
    pub(super) fn unknowns(&self, row: usize) -> impl Iterator<Item = usize> {
        let points = self.by_point[row]
            .iter()
            .map(|&(point, _)| &self.points[point]);
        points.flat_map(|point| point.first..point.first + point.shares.len())
    }

    /// Derivatives of a row by all unknowns.
    pub(super) fn derivatives(&self, row: usize, derivatives: &mut [f64]) {
        derivatives.fill(0.0);
        for &(point, by) in &self.by_point[row] {
            for (unknown, share) in self.points[point].by_unknown() {
                derivatives[unknown] += by * share;
            }
        }
    }

    /// Change of each row by amounts of the unknowns.
    pub(super) fn moved(&self, amounts: &[f64]) -> impl Iterator<Item = f64> {
        let displacement = |point: &Point| -> f64 {
            let own = point.by_unknown();
            own.map(|(unknown, share)| share * amounts[unknown]).sum()
        };
        let points: Vec<f64> = self.points.iter().map(displacement).collect();
        (self.by_point.iter())
            .map(move |own| own.iter().map(|&(point, by)| by * points[point]).sum())
    }

    /// Products of all columns with a number for each row.
    pub(super) fn gradient(&self, rows: impl Iterator<Item = f64>) -> Vec<f64> {
        let mut of_points = vec![0.0; self.points.len()];
        for (own, number) in self.by_point.iter().zip(rows) {
            for &(point, by) in own {
                of_points[point] += by * number;
            }
        }
        let mut gradient = vec![0.0; self.count];
        for (point, by) in self.points.iter().zip(of_points) {
            for (unknown, share) in point.by_unknown() {
                gradient[unknown] += by * share;
            }
        }
        gradient
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
        .flat_map(|(track, path)| of_track(joint, samples, &by_parameter, track, path, shapes))
        .collect();
    let none = Knots::none(joint.rows.len());
    Some(of_paths.into_iter().fold(none, Knots::beside))
}

/// Those of one track, by axis: along, horizontal, vertical.
fn of_track(
    joint: &Joint,
    samples: &[Sample],
    by_parameter: &DMatrix<f64>,
    track: usize,
    path: &Path,
    shapes: fn(&[f64], bool) -> DMatrix<f64>,
) -> [Knots; 3] {
    let (first, last) = path.range();
    let axes = track_axes(path.at(last) - path.at(first));
    // A cart goes where the joints on it go, so it is displaced as their offsets displace them.
    let by_cart = by_displacement(joint, by_parameter, track);
    [0, 1, 2].map(|axis| {
        let shapes = shapes(path.commands(), axis > 0);
        let mut by_point = vec![vec![]; joint.rows.len()];
        for (row, at) in joint.rows.iter().enumerate() {
            let slope = by_cart[row].dot(&axes[axis]);
            if slope != 0.0 {
                let shares = path.shares(samples[at.sample].commands_m[track]);
                by_point[row].extend(
                    shares
                        .into_iter()
                        .map(|(knot, share)| (knot, slope * share)),
                );
            }
        }
        let points = shapes.row_iter().map(|shares| Point {
            first: 0,
            shares: shares.iter().copied().collect(),
        });
        Knots {
            by_point,
            points: points.collect(),
            count: shapes.ncols(),
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
    largest_first(&mut order, |&place| eigen.eigenvalues[place]);
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
