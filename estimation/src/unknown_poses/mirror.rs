//! The mirror image of a machine whose plate is a point, as a start of a fit.
//!
//! Lengths and heights are those of its mirror image, and a rough reference may lie as near to both. What is drawn tells
//! them apart, by the squares over the tolerances; they are known once both have been fitted.

use nalgebra::{Matrix3, Vector3};
use tau_kinematics::{Machine, Pose, Sample};
use tau_solver::solve;

use super::ROUGH_COST;
use super::assembly::Chosen;
use super::fit::Fit;
use crate::calibration::{self, turn_of};

impl Fit<'_> {
    /// The mirror image of the machine that this starts from, its joints as near as they come to those that are drawn: with
    /// its poses held there, parameters follow from the drawing. `None` of a body, whose own joints tell left from right, and
    /// where nothing says how the machine stands.
    pub(super) fn mirror_image(mut self, options: &calibration::Options) -> Option<Machine> {
        let drawn = self.prepared.machine.clone();
        if drawn.turns() {
            return None;
        }
        let [from, to] = [joints(&self.machine)?, joints(&drawn)?];
        let image = reflection(&from, &to, !self.assembly.free.contains(&2));
        for pose in &mut self.assembly.poses {
            pose.base.position = image.of(pose.base.position);
        }
        let values = self.used.iter().map(|&index| drawn.values[index]);
        let mut start: Vec<f64> = values.collect();
        start.extend(self.assembly.object_unknowns().map(|unknown| unknown.start));
        start.resize(self.start.len(), 0.0);
        let chosen = Chosen {
            poses: &self.division.calibration,
            distances: &self.division.distances,
            left_out: &self.left_out,
        };
        self.blocks = self.assembly.rows(&drawn, &self.used, &chosen).ok()?;
        self.machine = drawn;
        let mut problem = self.problem(&start);
        let shared = self.shared();
        for own in &mut problem.parameters[shared..] {
            *own = own.clone().fixed();
        }
        let solver = tau_solver::Options {
            cost_tolerance: ROUGH_COST,
            ..options.solver.clone()
        };
        let found = solve(&problem, &solver).ok()?;
        Some(self.machine_at(&found.parameters))
    }
}

/// Where the links of a machine with a point as plate begin, at its reference.
fn joints(machine: &Machine) -> Option<Vec<Vector3<f64>>> {
    let stated = machine.surroundings.reference.as_ref()?;
    let origin = Pose {
        position: Vector3::zeros(),
        ..stated.into()
    };
    let sample = Sample::new(origin, &stated.commands_m);
    let joint = |closure| {
        // The closure is L² − ‖T − C‖², with T the point and C the joint.
        let (_, [x, y, z, ..]) = machine.closure_by_pose(closure, &sample).ok()?;
        Some(Vector3::new(x, y, z) / 2.0)
    };
    machine.closure_instances().map(joint).collect()
}

/// A reflection, and what turns and shifts.
struct Reflection {
    turn: Matrix3<f64>,
    from: Vector3<f64>,
    to: Vector3<f64>,
}

impl Reflection {
    fn of(&self, point: Vector3<f64>) -> Vector3<f64> {
        self.turn * (point - self.from) + self.to
    }
}

/// The motion of a mirror image that brings points nearest to others, by least squares (W. Kabsch, Acta Crystallographica
/// A32, 1976), in space or in the plane z = 0.
fn reflection(points: &[Vector3<f64>], others: &[Vector3<f64>], is_in_plane: bool) -> Reflection {
    let centre =
        |points: &[Vector3<f64>]| points.iter().sum::<Vector3<f64>>() / points.len() as f64;
    let (from, to) = (centre(points), centre(others));
    let mirror = Matrix3::from_diagonal(&Vector3::new(-1.0, 1.0, 1.0));
    let pairs = points.iter().zip(others);
    let products = pairs.fold(Matrix3::zeros(), |sum, (point, other)| {
        sum + (other - to) * (mirror * (point - from)).transpose()
    });
    let rotation = turn_of(products, is_in_plane);
    Reflection {
        turn: rotation.matrix() * mirror,
        from,
        to,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Rotation3;

    use super::*;

    fn points() -> Vec<Vector3<f64>> {
        let points = [
            [0.0, 0.1, 0.0],
            [3.0, 0.0, 0.4],
            [2.5, 2.0, -0.3],
            [0.2, 1.5, 1.0],
        ];
        points.map(Vector3::from).to_vec()
    }

    #[test]
    fn mirrored_points_are_met_in_space_and_in_the_plane() {
        for is_in_plane in [false, true] {
            let mut own = points();
            if is_in_plane {
                for point in &mut own {
                    point.z = 0.0;
                }
            }
            let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), 2.5);
            let image = |point: &Vector3<f64>| {
                turn * Vector3::new(point.x, -point.y, point.z) + Vector3::new(1.0, -2.0, 0.0)
            };
            let others: Vec<Vector3<f64>> = own.iter().map(image).collect();
            let found = reflection(&own, &others, is_in_plane);
            for (point, other) in own.iter().zip(&others) {
                assert!((found.of(*point) - other).norm() < 1e-12, "{is_in_plane}");
            }
            assert!(found.turn.determinant() < 0.0);
        }
    }
}
