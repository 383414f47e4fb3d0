//! The mirror image of a machine whose plate is a point, as a start of a fit.
//!
//! Lengths and heights are those of its mirror image, and a rough reference may lie as near to both. What is drawn tells
//! them apart, by the squares over the tolerances: those of the image follow from its joints, which are the machine's in the
//! mirror that drawing and reference ask for.

use std::f64::consts::{FRAC_PI_2, PI};

use nalgebra::{Cholesky, DMatrix, DVector, Dyn, Matrix3, Rotation3, Vector3, Vector6};
use tau_kinematics::{Machine, Pose, Sample};

use super::starts::AT_REFERENCE;
use crate::machine::{Nominal, Prepared, centres, turn_of};
use crate::numerics::order::smallest_first;
use crate::problem::{priors, used_by_plate};

/// Standard deviation of a joint that is exact, as a share of the mean length of the links: small beside any sketch.
const EXACT: f64 = 1e-3;
/// Steps in which a mirror is moved to where squares are least; near there they converge quadratically.
const STEPS: usize = 20;

/// The mirror image of a machine, where drawing and reference speak for it more than for that machine. `None` of a body,
/// whose own joints tell left from right, and where nothing says how the machine stands.
pub(super) fn image(prepared: &Prepared, machine: &Machine) -> Option<Machine> {
    if machine.turns() {
        return None;
    }
    let drawing = Drawing::new(prepared)?;
    let mut points = joints(machine)?;
    let (pose, sample) = at_reference(machine)?;
    let reached = machine.forward_fitted(&sample.at(pose)).ok()?;
    points.push(reached.pose.position);
    let is_in_plane = !machine.pose_unknowns().contains(&2);
    let image = drawing.nearest_image(&points, is_in_plane)?;
    if drawing.squares(&image) >= drawing.squares(&points) {
        return None;
    }
    Some(machine.with_values(drawing.values(machine, &image)))
}

/// The stated reference of a machine: pose and commands.
fn at_reference(machine: &Machine) -> Option<(Pose, Sample<'_>)> {
    let stated = machine.surroundings.reference.as_ref()?;
    let pose = Pose::from(stated);
    Some((pose, Sample::new(pose, &stated.commands_m)))
}

/// Where the links of a machine with a point as plate begin, at its reference.
fn joints(machine: &Machine) -> Option<Vec<Vector3<f64>>> {
    let (pose, sample) = at_reference(machine)?;
    let origin = sample.at(Pose {
        position: Vector3::zeros(),
        ..pose
    });
    let joint = |closure| {
        // The closure is L² − ‖T − C‖², with T the point and C the joint.
        let (_, [x, y, z, ..]) = machine.closure_by_pose(closure, &origin).ok()?;
        Some(Vector3::new(x, y, z) / 2.0)
    };
    machine.closure_instances().map(joint).collect()
}

/// Coordinates of points from others.
fn differences(points: &[Vector3<f64>], others: &[Vector3<f64>]) -> impl Iterator<Item = f64> {
    let pairs = points.iter().zip(others);
    pairs.flat_map(|(point, other)| <[f64; 3]>::from(point - other))
}

/// Joints as they are drawn, and the stated reference behind them.
struct Drawing {
    points: Vec<Vector3<f64>>,
    /// Unknowns of the variant, by their indices.
    unknowns: Vec<(usize, Nominal)>,
    /// Of the points' coordinates by the unknowns, in units of tolerances.
    moves: DMatrix<f64>,
    /// Of the points' coordinates, as far as tolerances tell.
    covariance: Cholesky<f64, Dyn>,
}

impl Drawing {
    fn new(prepared: &Prepared) -> Option<Self> {
        let machine = &prepared.machine;
        let mut points = joints(machine)?;
        let (pose, sample) = at_reference(machine)?;
        let length_m = machine.mean_length_m(&sample).ok()?;
        let unknowns = used_by_plate(machine);
        let priors = priors(&machine.variant, &unknowns, &prepared.nominal);
        let mut moves = DMatrix::zeros(3 * points.len() + 3, unknowns.len());
        for (column, (&index, prior)) in unknowns.iter().zip(&priors).enumerate() {
            let mut values = machine.values.clone();
            values[index] += prior.scale();
            let moved = joints(&machine.with_values(values))?;
            for (row, entry) in differences(&moved, &points).enumerate() {
                moves[(row, column)] = entry;
            }
        }
        points.push(pose.position);
        let mut covariance = &moves * moves.transpose();
        for row in 0..covariance.nrows() {
            let is_reference = row + 3 >= covariance.nrows();
            let own = if is_reference { AT_REFERENCE } else { EXACT };
            covariance[(row, row)] += (own * length_m).powi(2);
        }
        Some(Self {
            points,
            unknowns: unknowns.into_iter().zip(priors).collect(),
            moves,
            covariance: covariance.cholesky()?,
        })
    }

    /// Sum of squares of how far points lie from the drawn ones.
    fn squares(&self, points: &[Vector3<f64>]) -> f64 {
        self.whitened(differences(points, &self.points))
            .norm_squared()
    }

    fn whitened(&self, coordinates: impl Iterator<Item = f64>) -> DVector<f64> {
        let mut vector = DVector::from_iterator(3 * self.points.len(), coordinates);
        self.covariance
            .l_dirty()
            .solve_lower_triangular_mut(&mut vector);
        vector
    }

    /// Values of a machine whose joints are most likely at such points; what moves none of them stays as it is.
    fn values(&self, machine: &Machine, points: &[Vector3<f64>]) -> Vec<f64> {
        let off = DVector::from_iterator(3 * points.len(), differences(points, &self.points));
        let changes = self.moves.transpose() * self.covariance.solve(&off);
        let mut values = machine.values.clone();
        for (column, (index, prior)) in self.unknowns.iter().enumerate() {
            if self.moves.column(column).amax() > 0.0 {
                values[*index] = prior.value + prior.scale() * changes[column];
            }
        }
        values
    }

    /// The mirror image of points that lies nearest to the drawn ones, in space or in the plane z = 0.
    fn nearest_image(
        &self,
        points: &[Vector3<f64>],
        is_in_plane: bool,
    ) -> Option<Vec<Vector3<f64>>> {
        let mirror = |point: &Vector3<f64>| Vector3::new(-point.x, point.y, point.z);
        let mirrored: Vec<_> = points.iter().map(mirror).collect();
        let pairs = || mirrored.iter().zip(&self.points);
        let [from, to] = centres(pairs().map(|(from, to)| [*from, *to]));
        let products = pairs().fold(Matrix3::zeros(), |sum, (own, other)| {
            sum + (other - to) * (own - from).transpose()
        });
        let turn = turn_of(products, is_in_plane);
        let turns: Vec<Vector3<f64>> = if is_in_plane {
            (0..4)
                .map(|quarters| Vector3::z() * FRAC_PI_2 * f64::from(quarters))
                .collect()
        } else {
            let half_turns = [Vector3::x(), Vector3::y(), Vector3::z()].map(|axis| axis * PI);
            std::iter::once(Vector3::zeros())
                .chain(half_turns)
                .collect()
        };
        let mut images: Vec<_> = turns
            .into_iter()
            .filter_map(|more| {
                let turn = Rotation3::new(more) * turn;
                let start = mirrored.iter().map(|point| turn * (point - from) + to);
                self.settled(start.collect(), is_in_plane)
            })
            .collect();
        smallest_first(&mut images, |image| self.squares(image));
        images.into_iter().next()
    }

    /// Points moved as one to where their squares are least (Gauss-Newton, each step halved until it lowers them).
    fn settled(
        &self,
        mut points: Vec<Vector3<f64>>,
        is_in_plane: bool,
    ) -> Option<Vec<Vector3<f64>>> {
        // Shifts along the axes, then turns about them.
        let motions: &[usize] = if is_in_plane {
            &[0, 1, 5]
        } else {
            &[0, 1, 2, 3, 4, 5]
        };
        for _ in 0..STEPS {
            let centre = points.iter().sum::<Vector3<f64>>() / points.len() as f64;
            let columns = motions.iter().map(|&motion| {
                let moved = |point: &Vector3<f64>| match motion {
                    0..3 => Vector3::ith(motion, 1.0),
                    _ => Vector3::ith(motion - 3, 1.0).cross(&(point - centre)),
                };
                self.whitened(
                    points
                        .iter()
                        .flat_map(|point| <[f64; 3]>::from(moved(point))),
                )
            });
            let columns: Vec<DVector<f64>> = columns.collect();
            let residuals = self.whitened(differences(&points, &self.points));
            let svd = DMatrix::from_columns(&columns).svd(true, true);
            let least = f64::EPSILON * svd.singular_values.max();
            let step = svd.solve(&-&residuals, least).ok()?;
            let moved = |share: f64| -> Vec<Vector3<f64>> {
                let mut own = Vector6::zeros();
                for (&motion, step) in motions.iter().zip(step.iter()) {
                    own[motion] = share * step;
                }
                let turn = Rotation3::new(own.fixed_rows::<3>(3).into_owned());
                let to = centre + own.fixed_rows::<3>(0);
                let moved = points.iter().map(|point| turn * (point - centre) + to);
                moved.collect()
            };
            let is_lower = |points: &Vec<_>| self.squares(points) < residuals.norm_squared();
            let shares = [1.0, 0.5, 0.25, 0.125];
            match shares.into_iter().map(moved).find(is_lower) {
                Some(next) => points = next,
                None => break,
            }
        }
        Some(points)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A drawing of points, the first of which is exact and the last hardly known.
    fn drawing(points: Vec<Vector3<f64>>) -> Drawing {
        let count = 3 * points.len();
        let variance = |row: usize| match row / 3 {
            0 => 1e-6,
            last if last + 1 == count / 3 => 1e6,
            _ => 1.0,
        };
        let covariance = DMatrix::from_diagonal(&DVector::from_fn(count, |row, _| variance(row)));
        Drawing {
            points,
            unknowns: vec![],
            moves: DMatrix::zeros(count, 0),
            covariance: covariance.cholesky().unwrap(),
        }
    }

    #[test]
    fn a_mirror_is_found_in_space_and_in_the_plane() {
        let points = [
            [0.0, 0.1, 0.0],
            [3.0, 0.0, 0.4],
            [2.5, 2.0, -0.3],
            [0.2, 1.5, 1.0],
            [1.0, 1.0, 0.5],
        ];
        for is_in_plane in [false, true] {
            let mut own = points.map(Vector3::from);
            if is_in_plane {
                own = own.map(|point| Vector3::new(point.x, point.y, 0.0));
            }
            for angle in [0.0, 1.0, 2.5, 4.0] {
                let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), angle);
                let image = own.map(|point| {
                    turn * Vector3::new(point.x, -point.y, point.z) + Vector3::new(1.0, -2.0, 0.0)
                });
                let mut drawn = image;
                drawn[4] += Vector3::new(2.0, -3.0, 0.0);
                let found = drawing(drawn.to_vec())
                    .nearest_image(&own, is_in_plane)
                    .unwrap();
                for (point, image) in found.iter().zip(&image) {
                    assert!((point - image).norm() < 1e-4, "{is_in_plane}: {angle}");
                }
            }
        }
    }
}
