//! The values of a program with sums flattened and negations turned into signs of their readers.

use crate::graph::{Elementary, Expr, ExprMap, Graph, Node};

/// A value of the program, in terms of earlier ones; negations have become signs of the readers.
#[derive(Debug, Clone)]
pub(super) enum Value {
    /// An input of the program, by position.
    Input(usize),
    /// A number.
    Constant(f64),
    /// A flattened sum: signs (true is negative) and positions of values.
    Sum(Vec<(bool, usize)>),
    /// A product.
    Product(usize, usize),
    /// A quotient.
    Quotient(usize, usize),
    /// An elementary function; the operand may be read negated.
    Apply(Elementary, (bool, usize)),
    /// A select of left, right, below, otherwise, each possibly negated.
    Select([(bool, usize); 4]),
}

/// The values that a program computes, children first, and its outputs.
#[derive(Debug)]
pub(super) struct Form {
    /// The values.
    pub(super) values: Vec<Value>,
    /// The expression behind each value.
    pub(super) exprs: Vec<Expr>,
    /// Sign (true is negative) and position of each output.
    pub(super) outputs: Vec<(bool, usize)>,
}

impl Form {
    /// Flattens sums that are read once; everything in `inputs` is a leaf.
    pub(super) fn new(graph: &Graph, roots: &[Expr], inputs: &ExprMap<usize>) -> Self {
        let order = reachable(graph, roots, inputs);
        let mut uses: ExprMap<usize> = ExprMap::new(graph);
        for &expr in &order {
            if !inputs.contains(expr) {
                for child in graph.node(expr).children() {
                    uses.count(core(graph, child).1, 1);
                }
            }
        }
        for &root in roots {
            uses.count(core(graph, root).1, 2);
        }
        let inline = |expr: Expr| {
            !inputs.contains(expr)
                && matches!(graph.node(expr), Node::Add(..))
                && uses.get(expr) == Some(1)
        };
        // A sum dissolves only in a sum; elsewhere it is a value of its own.
        let mut dissolved: ExprMap<()> = ExprMap::new(graph);
        for &expr in &order {
            if !inputs.contains(expr) && matches!(graph.node(expr), Node::Add(..)) {
                for child in graph.node(expr).children() {
                    let (_, child) = core(graph, child);
                    if inline(child) {
                        dissolved.insert(child, ());
                    }
                }
            }
        }
        let mut form = Self {
            values: vec![],
            exprs: vec![],
            outputs: vec![],
        };
        let mut position: ExprMap<usize> = ExprMap::new(graph);
        for &expr in &order {
            if dissolved.contains(expr) {
                continue;
            }
            let value = if let Some(input) = inputs.get(expr) {
                Value::Input(input)
            } else {
                let at = |child: Expr| {
                    let (negative, child) = core(graph, child);
                    (negative, position[child])
                };
                match graph.node(expr) {
                    Node::Constant(bits) => Value::Constant(f64::from_bits(bits)),
                    Node::Add(..) => {
                        let mut terms = Vec::new();
                        flatten(graph, expr, false, &dissolved, true, &mut terms);
                        Value::Sum(terms.into_iter().map(|(s, e)| (s, position[e])).collect())
                    }
                    Node::Multiply(a, b) => Value::Product(at(a).1, at(b).1),
                    Node::Divide(a, b) => Value::Quotient(at(a).1, at(b).1),
                    Node::Apply(function, a) => Value::Apply(function, at(a)),
                    Node::Select {
                        left,
                        right,
                        below,
                        otherwise,
                    } => Value::Select([at(left), at(right), at(below), at(otherwise)]),
                    Node::Symbol(symbol) => unreachable!(
                        "`{}` is neither data nor a parameter of this family",
                        graph.symbols()[symbol.0 as usize].name
                    ),
                    Node::Negate(_) | Node::TurnFirst(..) | Node::TurnSecond(..) => {
                        unreachable!("negations are signs, turns are expanded")
                    }
                }
            };
            position.insert(expr, form.values.len());
            form.values.push(value);
            form.exprs.push(expr);
        }
        form.outputs = roots
            .iter()
            .map(|&root| {
                let (negative, expr) = core(graph, root);
                (negative, position[expr])
            })
            .collect();
        form
    }
}

/// Cores of all expressions that the roots need, children first, not looking behind inputs.
fn reachable(graph: &Graph, roots: &[Expr], inputs: &ExprMap<usize>) -> Vec<Expr> {
    let mut reachable = graph.reachable_before(roots, |expr| inputs.contains(expr));
    reachable.retain(|&expr| !matches!(graph.node(expr), Node::Negate(_)));
    reachable
}

fn flatten(
    graph: &Graph,
    expr: Expr,
    negative: bool,
    dissolved: &ExprMap<()>,
    top: bool,
    into: &mut Vec<(bool, Expr)>,
) {
    let (flips, inner) = core(graph, expr);
    let negative = negative != flips;
    match graph.node(inner) {
        Node::Add(a, b) if top || dissolved.contains(inner) => {
            flatten(graph, a, negative, dissolved, false, into);
            flatten(graph, b, negative, dissolved, false, into);
        }
        _ => into.push((negative, inner)),
    }
}

/// An expression without its leading negation: whether there was one, and the rest.
pub(super) fn core(graph: &Graph, expr: Expr) -> (bool, Expr) {
    match graph.node(expr) {
        Node::Negate(inner) => (true, inner),
        _ => (false, expr),
    }
}
