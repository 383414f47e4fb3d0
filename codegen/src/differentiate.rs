//! Derivatives by reverse accumulation on the graph.
//!
//! The adjoint of a rotation chain `Ra (Rb (Rg p))` is the chain of inverse turns applied to the
//! adjoint vector, so it stays factored, and an angle's derivative costs three operations.
//!
//! A select is differentiated branch by branch and the choice is made behind the partial derivatives, so that an
//! infinite derivative in the branch not taken does not reach the result.

use std::collections::{BTreeMap, BTreeSet};

use crate::graph::{Elementary, Expr, Graph, Node, Symbol};

/// Derivatives of one expression with respect to the given symbols, in their order.
///
/// Structural zeros come out as the constant zero. A select is differentiated branch by branch with
/// the condition held fixed: the derivative is exact on the side that the condition picks, and an
/// infinite derivative on the other side does not reach it.
pub fn gradient(graph: &mut Graph, of: Expr, with_respect_to: &[Symbol]) -> Vec<Expr> {
    let wanted: BTreeSet<Symbol> = with_respect_to.iter().copied().collect();
    let one = graph.constant(1.0);
    let zero = graph.constant(0.0);
    let totals = accumulate(graph, of, one, &wanted);
    with_respect_to
        .iter()
        .map(|symbol| totals.get(symbol).copied().unwrap_or(zero))
        .collect()
}

/// Adjoints of the wanted symbols, for a given adjoint of the root.
fn accumulate(
    graph: &mut Graph,
    of: Expr,
    seed: Expr,
    wanted: &BTreeSet<Symbol>,
) -> BTreeMap<Symbol, Expr> {
    let active = graph.dependence(|symbol| wanted.contains(&symbol));
    let zero = graph.constant(0.0);
    let mut totals: BTreeMap<Symbol, Expr> = BTreeMap::new();
    let mut adjoints: BTreeMap<Expr, Expr> = BTreeMap::from([(of, seed)]);
    while let Some((expr, adjoint)) = adjoints.pop_last() {
        if !active[expr.index()] {
            continue;
        }
        match graph.node(expr) {
            Node::Symbol(symbol) => {
                let so_far = totals.get(&symbol).copied().unwrap_or(zero);
                let total = graph.add(so_far, adjoint);
                totals.insert(symbol, total);
            }
            Node::Select {
                left,
                right,
                below,
                otherwise,
            } => {
                // The choice is made symbol by symbol, behind all partial derivatives of a branch:
                // a zero adjoint sent into the branch not taken would meet its infinities.
                let taken = accumulate(graph, below, adjoint, wanted);
                let other = accumulate(graph, otherwise, adjoint, wanted);
                let symbols: BTreeSet<Symbol> = taken.keys().chain(other.keys()).copied().collect();
                for symbol in symbols {
                    let a = taken.get(&symbol).copied().unwrap_or(zero);
                    let b = other.get(&symbol).copied().unwrap_or(zero);
                    let chosen = graph.select(left, right, a, b);
                    let so_far = totals.get(&symbol).copied().unwrap_or(zero);
                    let total = graph.add(so_far, chosen);
                    totals.insert(symbol, total);
                }
            }
            _ => {
                for (child, partial) in partials(graph, expr, adjoint).into_iter().flatten() {
                    if active[child.index()] {
                        let so_far = adjoints.get(&child).copied().unwrap_or(zero);
                        let total = graph.add(so_far, partial);
                        adjoints.insert(child, total);
                    }
                }
            }
        }
    }
    totals
}

/// Contributions of an expression's adjoint to those of its children.
fn partials(g: &mut Graph, expr: Expr, adjoint: Expr) -> [Option<(Expr, Expr)>; 3] {
    match g.node(expr) {
        Node::Constant(_) | Node::Symbol(_) | Node::Select { .. } => [None; 3],
        Node::Add(a, b) => [Some((a, adjoint)), Some((b, adjoint)), None],
        Node::Negate(a) => [Some((a, g.negate(adjoint))), None, None],
        Node::Multiply(a, b) => {
            let by_a = g.multiply(adjoint, b);
            [Some((a, by_a)), Some((b, g.multiply(adjoint, a))), None]
        }
        Node::Divide(a, b) if g.constant_value(a) == Some(1.0) => {
            // A reciprocal is at hand as the value itself: no second division.
            let scaled = g.multiply(adjoint, expr);
            let product = g.multiply(scaled, expr);
            [Some((b, g.negate(product))), None, None]
        }
        Node::Divide(a, b) => {
            let by_a = g.divide(adjoint, b);
            let product = g.multiply(by_a, expr);
            [Some((a, by_a)), Some((b, g.negate(product))), None]
        }
        Node::Apply(function, a) => {
            let partial = elementary_partial(g, function, expr, a, adjoint);
            [Some((a, partial)), None, None]
        }
        Node::TurnFirst(angle, x, y) => {
            let (_, second) = g.turn(angle, x, y);
            let zero = g.constant(0.0);
            let back = g.negate(angle);
            let (to_x, to_y) = g.turn(back, adjoint, zero);
            let to_angle = g.multiply(adjoint, second);
            let to_angle = g.negate(to_angle);
            [(angle, to_angle), (x, to_x), (y, to_y)].map(Some)
        }
        Node::TurnSecond(angle, x, y) => {
            let (first, _) = g.turn(angle, x, y);
            let zero = g.constant(0.0);
            let back = g.negate(angle);
            let (to_x, to_y) = g.turn(back, zero, adjoint);
            let to_angle = g.multiply(adjoint, first);
            [(angle, to_angle), (x, to_x), (y, to_y)].map(Some)
        }
    }
}

fn elementary_partial(
    g: &mut Graph,
    function: Elementary,
    value: Expr,
    a: Expr,
    adjoint: Expr,
) -> Expr {
    let one = g.constant(1.0);
    match function {
        Elementary::Sqrt => {
            let twice = g.add(value, value);
            g.divide(adjoint, twice)
        }
        Elementary::Sin => {
            let cos = g.apply(Elementary::Cos, a);
            g.multiply(adjoint, cos)
        }
        Elementary::Cos => {
            let sin = g.apply(Elementary::Sin, a);
            let product = g.multiply(adjoint, sin);
            g.negate(product)
        }
        Elementary::Tan => {
            let square = g.multiply(value, value);
            let slope = g.add(one, square);
            g.multiply(adjoint, slope)
        }
        Elementary::Atan => {
            let square = g.multiply(a, a);
            let slope = g.add(one, square);
            g.divide(adjoint, slope)
        }
        Elementary::Exp => g.multiply(adjoint, value),
        Elementary::Ln => g.divide(adjoint, a),
        Elementary::Tanh => {
            let square = g.multiply(value, value);
            let slope = g.subtract(one, square);
            g.multiply(adjoint, slope)
        }
    }
}
