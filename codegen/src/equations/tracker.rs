//! Errors of the tracker at the TCP, which are part of what was measured.

use tau_model_dsl::model::{Place, Target};
use tau_runtime::ResidualKind;

use super::context::symbol;
use super::formula::Scope;
use super::{Context, Equations, SparseRows};
use crate::differentiate::gradient;
use crate::graph::{Expr, Symbol};
use crate::vector::Vector;

/// Terms by which effects on `tcp` move what is measured (m), in the order of the variant.
pub(super) fn errors(context: &mut Context<'_>) -> Vec<Vector> {
    let scope = Scope {
        at_tcp: true,
        ..Scope::default()
    };
    let mut errors = vec![];
    let variant = context.variant;
    for (index, used) in variant.effects.iter().enumerate() {
        if used.place != Place::Tcp {
            continue;
        }
        for (target, value) in context.terms(index, scope) {
            match (target, value.as_slice()) {
                (Target::Position, &[x, y, z]) => errors.push([x, y, z]),
                _ => unreachable!("the checker admits only positions on the TCP"),
            }
        }
    }
    errors
}

/// Error of the tracker along an axis of the measurement frame, m: measured less true position, by the parameters of
/// the effects. It is a function of the measured position, so that no part of it waits for the true one.
pub fn tracker_error(mut context: Context<'_>, axis: usize) -> Equations {
    let mut residual = context.g.constant(0.0);
    for error in errors(&mut context) {
        residual = context.g.add(residual, error[axis]);
    }
    let Context {
        mut g,
        parameters,
        data,
        ..
    } = context;
    let symbols: Vec<Symbol> = (parameters.values())
        .map(|&variable: &Expr| symbol(&g, variable))
        .collect();
    let row = gradient(&mut g, residual, &symbols);
    Equations {
        kind: ResidualKind::TrackerError,
        of: axis,
        jacobian: SparseRows::from_dense(&g, &[row]),
        data: data.into_iter().collect(),
        parameters: parameters.into_iter().collect(),
        residuals: vec![residual],
        equation: "e(m): measured less true position along an axis",
        graph: g,
    }
}
