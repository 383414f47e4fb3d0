//! The closure equation, by parameters and by pose.
//!
//! `closure_by_pose` is the same equation with other columns: the plate's translation, its rotation *vector* and the
//! commands. ZYZ angles, which trackers report, are singular at β = 0, where a Stewart platform stands at home; so the
//! rotation comes as a matrix, is perturbed on the left and differentiated at zero.

use std::collections::BTreeMap;

use tau_model_dsl::model::{Arm, Place, Plate, Target, Value};
use tau_runtime::{Input, Owner, ResidualKind};

use super::context::symbol;
use super::formula::Scope;
use super::{Context, Equations, SparseRows, tracker};
use crate::differentiate::gradient;
use crate::graph::{Expr, Stage, Symbol};
use crate::vector::{self, Rotation, Vector};

const REDUCED: &str = "L² − ‖T − C(q)‖²";
const POINT: &str = "L² − ‖T − C(q)‖², T the point";
const POINT_IN_PLANE: &str = "L² − ‖T − C(q)‖², T the point, z = 0";
const IN_PLANE: &str = "L² − ‖T + R·P − C(q)‖², z = 0, R = Rz(alpha + gamma)";
const REDUCED_IN_PLANE: &str = "L² − ‖T − C(q)‖², z = 0";
const FULL: &str = "L² − ‖T + R·P − C(q)‖², R = Rz(alpha)·Ry(beta)·Rz(gamma)";
const IN_PLANE_BY_POSE: &str = "L² − ‖T + R·P − C(q)‖², z = 0, R a rotation about z";
const FULL_BY_POSE: &str = "L² − ‖T + R·P − C(q)‖²";

/// Closure of a link (full arm) or cluster (reduced arm), by its parameters.
///
/// With `pose`, also by the TCP's position and Euler angles, as further columns in front.
pub fn closure(mut context: Context<'_>, of: usize, pose: bool) -> Equations {
    let residual = residual(&mut context, of, None);
    let equation = equation(&context, false);
    let Context {
        mut g,
        parameters,
        data,
        ..
    } = context;
    let pose_inputs = [
        Input::Position(0),
        Input::Position(1),
        Input::Position(2),
        Input::Angle(0),
        Input::Angle(1),
        Input::Angle(2),
    ];
    let mut variables: Vec<Expr> = Vec::new();
    if pose {
        variables.extend(pose_inputs.iter().filter_map(|input| data.get(input)));
    }
    variables.extend(parameters.values());
    let symbols: Vec<Symbol> = variables
        .iter()
        .map(|&variable| symbol(&g, variable))
        .collect();
    let row = gradient(&mut g, residual, &symbols);
    Equations {
        kind: ResidualKind::Closure,
        of,
        jacobian: SparseRows::from_dense(&g, &[row]),
        data: data.into_iter().collect(),
        parameters: parameters.into_iter().collect(),
        residuals: vec![residual],
        equation,
        graph: g,
    }
}

/// Closure of a link or cluster, by the plate's translation, its rotation vector and the commands.
///
/// The rotation is perturbed on the left, R ← (I + ρ×)·R, and differentiated at ρ = 0, which has no
/// singularity whatever the Euler angles are.
pub fn closure_by_pose(mut context: Context<'_>, of: usize) -> Equations {
    let g = &mut context.g;
    let [shift, turn] = [["dx", "dy", "dz"], ["rho_x", "rho_y", "rho_z"]]
        .map(|names| names.map(|name| g.symbol(name, Stage::Parameter)));
    context.shift = Some(shift);
    let perturbed = residual(&mut context, of, Some(turn));
    let equation = equation(&context, true);
    let Context {
        mut g,
        parameters,
        data,
        ..
    } = context;
    let motion = || shift.into_iter().chain(turn);
    let commands = data.iter().filter_map(|(input, &symbol)| {
        let is_command = matches!(input, Input::Command(_));
        is_command.then_some(symbol)
    });
    let columns = motion().chain(commands);
    let columns: Vec<Symbol> = columns.map(|variable| symbol(&g, variable)).collect();
    let row = gradient(&mut g, perturbed, &columns);
    let zero = g.constant(0.0);
    let replacements: BTreeMap<Symbol, Expr> = motion()
        .map(|variable| (symbol(&g, variable), zero))
        .collect();
    let roots: Vec<Expr> = std::iter::once(perturbed).chain(row).collect();
    let roots = g.substitute(&roots, &replacements);
    Equations {
        kind: ResidualKind::ClosureByPose,
        of,
        jacobian: SparseRows::from_dense(&g, &[roots[1..].to_vec()]),
        data: data.into_iter().collect(),
        parameters: parameters.into_iter().collect(),
        residuals: vec![roots[0]],
        equation,
        graph: g,
    }
}

/// The closure in words.
fn equation(context: &Context<'_>, by_pose: bool) -> &'static str {
    match (context.model.plate, context.variant.arm) {
        (Plate::Body, Arm::Full) if by_pose => FULL_BY_POSE,
        (Plate::BodyInPlane, Arm::Full) if by_pose => IN_PLANE_BY_POSE,
        (Plate::Point, _) => POINT,
        (Plate::PointInPlane, _) => POINT_IN_PLANE,
        (Plate::Body, Arm::Reduced) => REDUCED,
        (Plate::Body, Arm::Full) => FULL,
        (Plate::BodyInPlane, Arm::Reduced) => REDUCED_IN_PLANE,
        (Plate::BodyInPlane, Arm::Full) => IN_PLANE,
    }
}

/// L² − ‖T + R·P − C(q)‖² (eq. 5) or L² − ‖T − C(q)‖² (eqs. 1 and 3), effects included.
fn residual(context: &mut Context<'_>, of: usize, turn: Option<Vector>) -> Expr {
    let (owner, cluster) = match context.variant.arm {
        Arm::Full => (Owner::Link(of), context.model.links[of].cluster),
        Arm::Reduced => (Owner::Cluster(of), of),
    };
    let track = context.model.clusters[cluster].track;
    let links = match context.variant.arm {
        Arm::Full => vec![of],
        Arm::Reduced => context.model.links_of_cluster(of),
    };
    // The checker admits a driven link in a reduced arm only where the cluster is one link.
    let driven = |link: &usize| context.model.links[*link].actuated_by;
    let actuated_by = links.iter().find_map(driven);
    context.own = Some(owner);
    context.own_command = track.or(actuated_by);

    let mut tcp = context.vector_datum(Input::Position);
    let mut length = context.driven_length(owner);
    let plate = context.model.plate;
    let mut joint = match context.variant.arm {
        Arm::Full if plate.is_point() => None,
        Arm::Full => Some(context.vector_value(owner, Value::PlateJoint)),
        Arm::Reduced => None,
    };
    for error in tracker::errors(context) {
        // The effect is part of what was measured; closure holds for the rest.
        tcp = vector::subtract(&mut context.g, tcp, error);
    }
    let variant = context.variant;
    for (index, used) in variant.effects.iter().enumerate() {
        let applies = match used.place {
            Place::AllLinks => {
                let subject = context.model.effects[used.effect].subject;
                (links.iter()).any(|&link| subject.admits(&context.model.links[link]))
            }
            Place::Link(link) => links.contains(&link),
            _ => false,
        };
        if !applies {
            continue;
        }
        let scope = Scope {
            command: context.own_command,
            track,
            source: None,
            // The checker admits a tension in a reduced arm only where the cluster is one link.
            link: links.first().copied(),
            length_of: Some(owner),
            at_tcp: true,
            ..Scope::default()
        };
        for (target, value) in context.terms(index, scope) {
            match (target, value.as_slice()) {
                (Target::Length, &[amount]) => length = context.g.add(length, amount),
                (Target::Joint, &[x, y, z]) => {
                    joint = joint.map(|joint| vector::add(&mut context.g, joint, [x, y, z]));
                }
                // What the drive adds to its command stands in the length that follows from it.
                (Target::Command, _) => {}
                _ => unreachable!("the checker admits only such targets on a link"),
            }
        }
    }
    // A formula reads its command itself.
    let counts_from_zero = context.formula_of(owner, Value::Length).is_none();
    if let Some(command) = actuated_by.filter(|_| counts_from_zero) {
        let q = context.driven(command);
        length = context.g.add(length, q);
    }
    let mut base = match track {
        Some(track) => context.joint_position(owner, track),
        None => context.vector_value(owner, Value::TrackOffset),
    };
    for shift in context.base_shifts(owner, &links, track) {
        base = vector::add(&mut context.g, base, shift);
    }
    if plate.is_in_plane() {
        tcp[2] = context.g.constant(0.0);
    }
    let mut plate_point = tcp;
    if let Some(joint) = joint {
        let arm = match turn {
            Some(turn) => turned_by_matrix(context, joint, turn),
            None => {
                let angles = context.vector_datum(Input::Angle);
                let g = &mut context.g;
                let rotation = if plate.is_in_plane() {
                    Rotation::about_z(g, angles)
                } else {
                    Rotation::zyz(angles)
                };
                rotation.apply(g, joint, "r")
            }
        };
        plate_point = vector::add(&mut context.g, plate_point, arm);
    }
    let g = &mut context.g;
    let rod = vector::subtract(g, plate_point, base);
    for (&component, axis) in rod.iter().zip(["x", "y", "z"]) {
        g.name(component, format!("rod_{axis}"));
    }
    let (square, distance) = (g.multiply(length, length), vector::dot(g, rod, rod));
    let residual = g.subtract(square, distance);
    g.name(residual, "residual");
    residual
}

/// (I + ρ×)·R·v with the entries of R as data; in a plane, of a rotation about z.
fn turned_by_matrix(context: &mut Context<'_>, vector: Vector, [x, y, z]: Vector) -> Vector {
    let is_in_plane = context.model.plate.is_in_plane();
    let mut entry = |row: usize, column: usize| {
        if is_in_plane && (row == 2 || column == 2) {
            context.g.constant(if row == column { 1.0 } else { 0.0 })
        } else {
            context.datum(Input::Rotation(3 * row + column))
        }
    };
    let rows = [0, 1, 2].map(|row| [0, 1, 2].map(|column| entry(row, column)));
    let g = &mut context.g;
    let arm = rows.map(|row| vector::dot(g, row, vector));
    let zero = g.constant(0.0);
    let turn = if is_in_plane {
        [zero, zero, z]
    } else {
        [x, y, z]
    };
    let swing = vector::cross(g, turn, arm);
    vector::add(g, arm, swing)
}
