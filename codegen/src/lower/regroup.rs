//! Flattening of sums and products, grouping by stage, common factors.
//!
//! Data-only parts of a sum or a product stand together, so that each becomes one prepared value.

use super::form::core;
use crate::graph::{Expr, ExprMap, Graph, Node, Stage};

/// Rebuilds expressions so that data-only parts of sums and products stand together and common
/// factors of sums are taken out. Values are the same up to rounding.
pub(super) fn regroup(graph: &mut Graph, roots: &[Expr]) -> Vec<Expr> {
    let mut uses: ExprMap<usize> = ExprMap::new(graph);
    for expr in graph.reachable(roots) {
        if !matches!(graph.node(expr), Node::Negate(_)) {
            for child in graph.node(expr).children() {
                uses.count(core(graph, child).1, 1);
            }
        }
    }
    for &root in roots {
        // A root is read from outside: it is never dissolved in another expression.
        uses.count(core(graph, root).1, 2);
    }
    graph.map(roots, |graph, expr, images| {
        let pass = Pass {
            uses: &uses,
            images,
        };
        pass.rebuild(graph, expr)
    })
}

struct Pass<'a> {
    uses: &'a ExprMap<usize>,
    images: &'a ExprMap<Expr>,
}

/// A term of a flattened sum: its sign and its factors, already rebuilt.
struct Term {
    negative: bool,
    factors: Vec<Expr>,
}

impl Pass<'_> {
    fn rebuild(&self, g: &mut Graph, expr: Expr) -> Expr {
        let image = |e: Expr| self.images[e];
        match g.node(expr) {
            Node::Constant(_) | Node::Symbol(_) => expr,
            Node::Add(..) if g.stage(expr) == Stage::Parameter => {
                let mut terms = Vec::new();
                self.terms(g, expr, false, true, &mut terms);
                sum_of_terms(g, terms)
            }
            Node::Multiply(..) if g.stage(expr) == Stage::Parameter => {
                let mut factors = Vec::new();
                self.factors(g, expr, true, &mut factors);
                product(g, &factors)
            }
            Node::Add(a, b) => g.add(image(a), image(b)),
            Node::Multiply(a, b) => g.multiply(image(a), image(b)),
            Node::Negate(a) => g.negate(image(a)),
            Node::Divide(a, b) => g.divide(image(a), image(b)),
            Node::Apply(function, a) => g.apply(function, image(a)),
            Node::Select {
                left,
                right,
                below,
                otherwise,
            } => g.select(image(left), image(right), image(below), image(otherwise)),
            Node::TurnFirst(..) | Node::TurnSecond(..) => {
                unreachable!("turns are expanded before regrouping")
            }
        }
    }

    fn dissolves(&self, g: &Graph, expr: Expr) -> bool {
        g.stage(expr) == Stage::Parameter && self.uses.get(expr) == Some(1)
    }

    fn terms(&self, g: &Graph, expr: Expr, negative: bool, top: bool, into: &mut Vec<Term>) {
        let (flips, inner) = core(g, expr);
        let negative = negative != flips;
        match g.node(inner) {
            Node::Add(a, b) if top || self.dissolves(g, inner) => {
                self.terms(g, a, negative, false, into);
                self.terms(g, b, negative, false, into);
            }
            Node::Multiply(..) if self.dissolves(g, inner) => {
                let mut factors = Vec::new();
                self.factors(g, inner, true, &mut factors);
                into.push(Term { negative, factors });
            }
            _ => into.push(Term {
                negative,
                factors: vec![self.images[inner]],
            }),
        }
    }

    fn factors(&self, g: &Graph, expr: Expr, top: bool, into: &mut Vec<Expr>) {
        match g.node(expr) {
            Node::Multiply(a, b) if top || self.dissolves(g, expr) => {
                self.factors(g, a, false, into);
                self.factors(g, b, false, into);
            }
            _ => into.push(self.images[expr]),
        }
    }
}

/// Product with the data-only factors multiplied first.
fn product(g: &mut Graph, factors: &[Expr]) -> Expr {
    let mut result = g.constant(1.0);
    for stage in [Stage::Constant, Stage::Data, Stage::Parameter] {
        for &factor in factors {
            if g.stage(factor) == stage {
                result = g.multiply(result, factor);
            }
        }
    }
    result
}

/// Sum with the data-only terms added first and common factors taken out.
fn sum_of_terms(g: &mut Graph, mut terms: Vec<Term>) -> Expr {
    loop {
        // The factor that most terms share; ties go to the oldest expression.
        let mut factors: Vec<Expr> = Vec::with_capacity(4 * terms.len());
        for term in terms.iter().filter(|term| term.factors.len() > 1) {
            let of_term = factors.len();
            for factor in &term.factors {
                if !factors[of_term..].contains(factor) {
                    factors.push(*factor);
                }
            }
        }
        factors.sort_unstable();
        let shared = factors.chunk_by(Expr::eq).filter(|same| same.len() > 1);
        let best = shared.max_by_key(|same| (same.len(), std::cmp::Reverse(same[0])));
        let Some(&[factor, ..]) = best else { break };
        let (with, without): (Vec<Term>, Vec<Term>) = terms
            .into_iter()
            .partition(|t| t.factors.len() > 1 && t.factors.contains(&factor));
        let inner: Vec<Term> = with
            .into_iter()
            .map(|mut term| {
                let position = term
                    .factors
                    .iter()
                    .position(|&f| f == factor)
                    .expect("contains it");
                term.factors.remove(position);
                term
            })
            .collect();
        let rest = sum_of_terms(g, inner);
        let (negative, rest) = core(g, rest);
        terms = without;
        terms.push(Term {
            negative,
            factors: vec![factor, rest],
        });
    }
    let mut result = g.constant(0.0);
    let products: Vec<(bool, Expr)> = terms
        .iter()
        .map(|term| (term.negative, product(g, &term.factors)))
        .collect();
    for stage in [Stage::Constant, Stage::Data, Stage::Parameter] {
        for &(negative, value) in &products {
            if g.stage(value) == stage {
                result = if negative {
                    g.subtract(result, value)
                } else {
                    g.add(result, value)
                };
            }
        }
    }
    result
}
