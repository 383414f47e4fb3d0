//! Residuals of targets on the carts: sets 2 and 3.
//!
//! Tracker frames of these sets may be anything, so that measured poses come registered near the frame of set 1.
//! Frame and mounting are then small parameters, without a singularity in reach.

use tau_runtime::{Input, Owner, ResidualKind};

use super::context::symbol;
use super::{Context, Equations, SparseRows};
use crate::differentiate::gradient;
use crate::graph::{Expr, Symbol};
use crate::vector::{self, Rotation, RotationVector, Vector};

/// Position and rotation of a cart's target in set 2: predicted minus measured, m and rad.
///
/// The measured pose comes registered: carried near the measurement frame of set 1 by a start estimate,
/// so that the frame's translation and rotation and the target's rotation are small corrections. The
/// rotation residual is the axial vector of predicted·measuredᵀ, ½ Σₖ mₖ × pₖ over their columns.
pub fn cart_pose(mut context: Context<'_>, track: usize) -> Equations {
    let residuals = residuals(&mut context, track, 2);
    finish(
        context,
        track,
        ResidualKind::CartPose,
        residuals,
        "F·(C(q) + A(q)·m) + t − x; axial vector of F·A(q)·M·Rᵀ",
    )
}

/// Position of a cart's target in set 3: predicted minus measured, m.
pub fn cart_position(mut context: Context<'_>, track: usize) -> Equations {
    let residuals = residuals(&mut context, track, 3);
    finish(
        context,
        track,
        ResidualKind::CartPosition,
        residuals,
        "F·(C(q) + A(q)·m) + t − x",
    )
}

fn residuals(context: &mut Context<'_>, track: usize, set: u8) -> Vec<Expr> {
    context.own_command = Some(track);
    if let [joint] = context.joints(track)[..] {
        context.own = Some(joint);
    }
    let target = Owner::Target { set, track };
    let (point, rotation) = context.cart_motion(track);
    let mounting = context.vector_parameter(target, "position");
    let translation = context.vector_parameter(Owner::Frame(set), "translation");
    let angles = context.vector_parameter(Owner::Frame(set), "rotation");
    let frame = Rotation::xyz(angles);
    let measured = context.vector_datum(Input::Position);

    let g = &mut context.g;
    let rotation = RotationVector::new(g, rotation);
    let lever = rotation.apply(g, mounting);
    let position = vector::add(g, point, lever);
    let seen = frame.apply(g, position, "frame");
    let predicted = vector::add(g, seen, translation);
    let mut residuals = vector::subtract(g, predicted, measured).to_vec();

    if set == 2 {
        let mounting_angles = context.vector_parameter(target, "rotation");
        let measured_angles = context.vector_datum(Input::Angle);
        let g = &mut context.g;
        let measured_columns = Rotation::zyz(measured_angles).columns(g);
        let mounting_columns = Rotation::xyz(mounting_angles).columns(g);
        let mut twice: Vector = vector::zero(g);
        for (measured, mounted) in measured_columns.iter().zip(mounting_columns) {
            let turned = rotation.apply(g, mounted);
            let predicted = frame.apply(g, turned, "frame");
            let part = vector::cross(g, *measured, predicted);
            twice = vector::add(g, twice, part);
        }
        let half = g.constant(0.5);
        residuals.extend(vector::scale(g, half, twice));
    }
    residuals
}

fn finish(
    context: Context<'_>,
    of: usize,
    kind: ResidualKind,
    residuals: Vec<Expr>,
    equation: &'static str,
) -> Equations {
    let Context {
        mut g,
        parameters,
        data,
        ..
    } = context;
    let symbols: Vec<Symbol> = parameters
        .values()
        .map(|&variable| symbol(&g, variable))
        .collect();
    let rows: Vec<Vec<Expr>> = residuals
        .iter()
        .map(|&residual| gradient(&mut g, residual, &symbols))
        .collect();
    Equations {
        kind,
        of,
        jacobian: SparseRows::from_dense(&g, &rows),
        data: data.into_iter().collect(),
        parameters: parameters.into_iter().collect(),
        residuals,
        equation,
        graph: g,
    }
}
