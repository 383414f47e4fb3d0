//! Direct evaluation of expressions, to check everything that is made of them.

use std::collections::HashMap;

use crate::graph::{Elementary, Expr, Graph, Node};

/// Values of expressions for given values of all symbols, in order of creation.
///
/// Walks the graph as it stands: no staging, no regrouping, turns included. Slow and simple on
/// purpose: lowering is tested against it.
pub fn evaluate(graph: &Graph, roots: &[Expr], symbols: &[f64]) -> Vec<f64> {
    let mut values: HashMap<Expr, f64> = HashMap::new();
    for expr in graph.reachable(roots) {
        let at = |e: Expr| values[&e];
        let value: f64 = match graph.node(expr) {
            Node::Constant(bits) => f64::from_bits(bits),
            Node::Symbol(symbol) => symbols[symbol.0 as usize],
            Node::Add(a, b) => at(a) + at(b),
            Node::Multiply(a, b) => at(a) * at(b),
            Node::Negate(a) => -at(a),
            Node::Divide(a, b) => at(a) / at(b),
            Node::Apply(function, a) => {
                let a: f64 = at(a);
                match function {
                    Elementary::Sqrt => a.sqrt(),
                    Elementary::Sin => a.sin(),
                    Elementary::Cos => a.cos(),
                    Elementary::Tan => a.tan(),
                    Elementary::Atan => a.atan(),
                    Elementary::Exp => a.exp(),
                    Elementary::Ln => a.ln(),
                    Elementary::Tanh => a.tanh(),
                }
            }
            Node::TurnFirst(angle, x, y) => at(angle).cos() * at(x) - at(angle).sin() * at(y),
            Node::TurnSecond(angle, x, y) => at(angle).sin() * at(x) + at(angle).cos() * at(y),
            Node::Select {
                left,
                right,
                below,
                otherwise,
            } => {
                if at(left) < at(right) {
                    at(below)
                } else {
                    at(otherwise)
                }
            }
        };
        values.insert(expr, value);
    }
    roots.iter().map(|root| values[root]).collect()
}
