//! The closures of the paper's five variants, differentiated by hand with vectors and matrices.
//!
//! They take the place of the generated code in calibration and kinematics: both must lead to the same
//! numbers.

use std::sync::Arc;

use nalgebra::{Matrix3, Rotation3, Vector3};
use tau::Robot;
use tau::calibration::machine_from_file;
use tau::kinematics::{xyz, zyz};
use tau::robot::{Arm, Input, Instance, Owner, ResidualFamily, ResidualKind, TrackShape, Variant};
use tau_runtime::{Pattern, Shape};

/// L² − ‖T + R P − C(q)‖², of a link or, without P, of a cluster.
struct Closure {
    arm: Arm,
    track: TrackShape,
    /// True if derivatives are those by pose and command.
    by_pose: bool,
    row_starts: [u32; 2],
    columns: Vec<u32>,
}

/// The robot with hand-written closures in every variant; parameters and structure stay.
pub(crate) fn robot() -> Robot {
    let mut robot = crate::support::gantry_tau();
    let structure = robot.clone();
    let mut variants = robot.variants.to_vec();
    variants.retain(|variant| variant.effects.is_empty());
    for variant in &mut variants {
        let closures = match variant.arm {
            Arm::Full => structure.links.len(),
            Arm::Reduced => structure.clusters.len(),
        };
        variant.instances = [false, true]
            .into_iter()
            .flat_map(|by_pose| (0..closures).map(move |of| (of, by_pose)))
            .map(|(of, by_pose)| instance(&structure, variant, of, by_pose))
            .collect();
    }
    robot.variants = variants.into();
    robot
}

fn instance(robot: &Robot, variant: &Variant, of: usize, by_pose: bool) -> Instance {
    let (owner, cluster) = match variant.arm {
        Arm::Full => (Owner::Link(of), robot.links[of].cluster),
        Arm::Reduced => (Owner::Cluster(of), of),
    };
    let track = robot.clusters[cluster]
        .track
        .expect("every cluster is on a track");
    let shape = variant.tracks[track].shape;
    let path = match shape {
        TrackShape::Linear => "track_direction",
        TrackShape::Piecewise => "track_rotation",
        TrackShape::Crank => unreachable!("the Gantry-Tau has no cranks"),
    };
    let mut parameters = vec![variant.parameter(owner, "length", None)];
    let vectors: &[&str] = match variant.arm {
        Arm::Full => &["plate_joint", "track_offset", path],
        Arm::Reduced => &["track_offset", path],
    };
    for quantity in vectors {
        parameters
            .extend((0..3).map(|component| variant.parameter(owner, quantity, Some(component))));
    }
    let mut inputs = vec![Input::Command(track)];
    inputs.extend((0..3).map(Input::Position));
    if by_pose {
        inputs.extend((0..9).map(Input::Rotation));
    } else {
        inputs.extend((0..3).map(Input::Angle));
    }
    if shape == TrackShape::Piecewise {
        inputs.extend((0..3).map(|component| Input::SegmentStart { track, component }));
        inputs.extend((0..3).map(|component| Input::SegmentEnd { track, component }));
        inputs.extend([
            Input::SegmentStartCommand(track),
            Input::SegmentEndCommand(track),
        ]);
    }
    let columns: Vec<u32> = if by_pose {
        let pose = if variant.arm == Arm::Full { 0..6 } else { 0..3 };
        pose.chain([6]).collect()
    } else {
        (0..u32::try_from(parameters.len()).unwrap()).collect()
    };
    Instance {
        kind: if by_pose {
            ResidualKind::ClosureByPose
        } else {
            ResidualKind::Closure
        },
        of,
        family: Arc::new(Closure {
            arm: variant.arm,
            track: shape,
            by_pose,
            row_starts: [0, u32::try_from(columns.len()).unwrap()],
            columns,
        }),
        parameters: parameters
            .into_iter()
            .map(|p| p.expect("the variant has it"))
            .collect(),
        inputs,
    }
}

fn vector(numbers: &[f64]) -> Vector3<f64> {
    Vector3::new(numbers[0], numbers[1], numbers[2])
}

impl Closure {
    /// Residual, then derivatives by the parameters, or by translation, rotation vector and command.
    fn compute(&self, data: &[f64], parameters: &[f64]) -> (f64, Vec<f64>) {
        let (q, position) = (data[0], vector(&data[1..]));
        let (rotation, segment) = if self.by_pose {
            let matrix = Matrix3::from_row_slice(&data[4..13]);
            (Rotation3::from_matrix_unchecked(matrix), &data[13..])
        } else {
            (zyz([data[4], data[5], data[6]]), &data[7..])
        };
        let length = parameters[0];
        let (joint, own) = match self.arm {
            Arm::Full => (vector(&parameters[1..]), &parameters[4..]),
            Arm::Reduced => (Vector3::zeros(), &parameters[1..]),
        };
        let (offset, path) = (vector(own), [own[3], own[4], own[5]]);
        let (travel, slope, by_path) = match self.track {
            TrackShape::Linear => {
                let direction = Vector3::from(path);
                (
                    direction * q,
                    direction,
                    [Vector3::x() * q, Vector3::y() * q, Vector3::z() * q],
                )
            }
            TrackShape::Piecewise => {
                let (start, end) = (vector(segment), vector(&segment[3..]));
                let slope = (end - start) / (segment[7] - segment[6]);
                let turn = xyz(path);
                let travel = turn * (start + slope * (q - segment[6]));
                // The axes that the angles turn about: x after the other two, y after c, and z.
                let about_z = Rotation3::from_axis_angle(&Vector3::z_axis(), path[2]);
                let axes = [turn * Vector3::x(), about_z * Vector3::y(), Vector3::z()];
                (travel, turn * slope, axes.map(|axis| axis.cross(&travel)))
            }
            TrackShape::Crank => unreachable!("the Gantry-Tau has no cranks"),
        };
        let lever = rotation * joint;
        let rod = position + lever - offset - travel;
        let residual = length * length - rod.norm_squared();
        let mut derivatives = Vec::new();
        if self.by_pose {
            derivatives.extend((-2.0 * rod).iter());
            if self.arm == Arm::Full {
                derivatives.extend((-2.0 * lever.cross(&rod)).iter());
            }
            derivatives.push(2.0 * rod.dot(&slope));
        } else {
            derivatives.push(2.0 * length);
            if self.arm == Arm::Full {
                derivatives.extend((rotation.inverse() * rod * -2.0).iter());
            }
            derivatives.extend((2.0 * rod).iter());
            derivatives.extend(by_path.map(|motion| 2.0 * rod.dot(&motion)));
        }
        (residual, derivatives)
    }
}

impl ResidualFamily for Closure {
    fn shape(&self) -> Shape {
        let own = if self.arm == Arm::Full { 10 } else { 7 };
        let segment = if self.track == TrackShape::Piecewise {
            8
        } else {
            0
        };
        let data = segment + if self.by_pose { 13 } else { 7 };
        Shape {
            data,
            prepared: data,
            parameters: own,
            residuals: 1,
        }
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        prepared.copy_from_slice(data);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        residuals[0] = self.compute(prepared, parameters).0;
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let (residual, derivatives) = self.compute(prepared, parameters);
        residuals[0] = residual;
        jacobian.copy_from_slice(&derivatives);
    }
}

#[test]
fn generated_closures_agree_at_every_measured_pose() {
    use tau::kinematics::Sample;
    let (folder, file) = crate::support::prototype();
    let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
    let (by_hand, generated) = (robot(), crate::support::gantry_tau());
    for variant in by_hand.variants.iter() {
        let machine = |robot: &Robot| {
            let variant = robot.variant(&variant.name).unwrap();
            machine_from_file(robot, variant, &file, Some(&folder), &all).unwrap()
        };
        let (by_hand, generated) = (machine(&by_hand), machine(&generated));
        for measured in &folder.tcp_poses {
            let sample = Sample::from(measured);
            let (a, b) = (
                by_hand.closures(&sample).unwrap(),
                generated.closures(&sample).unwrap(),
            );
            assert!(
                (a.residuals - b.residuals).amax() < 1e-14,
                "{} {}",
                variant.name,
                measured.pose
            );
            assert!(
                (a.jacobian - b.jacobian).amax() < 1e-13,
                "{} {}",
                variant.name,
                measured.pose
            );
        }
    }
}
