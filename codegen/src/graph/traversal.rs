//! Graphs gone through from given expressions: what they need, what they depend on, the same with parts replaced.

use std::collections::BTreeMap;

use super::{Expr, ExprMap, Graph, Node, Symbol};

impl Graph {
    /// All nodes that the given expressions need, children before parents.
    pub fn reachable(&self, roots: &[Expr]) -> Vec<Expr> {
        self.reachable_before(roots, |_| false)
    }

    /// The same, not looking behind leaves.
    pub(crate) fn reachable_before(
        &self,
        roots: &[Expr],
        is_leaf: impl Fn(Expr) -> bool,
    ) -> Vec<Expr> {
        let mut needed = vec![false; self.nodes.len()];
        for root in roots {
            needed[root.index()] = true;
        }
        for index in (0..self.nodes.len()).rev() {
            if needed[index] && !is_leaf(Expr(index as u32)) {
                for child in self.nodes[index].children() {
                    needed[child.index()] = true;
                }
            }
        }
        (0..self.nodes.len())
            .filter(|&i| needed[i])
            .map(|i| Expr(i as u32))
            .collect()
    }

    /// Dependence of the expressions, node by node, on a symbol: indexed by [`Expr::index`].
    pub fn dependence(&self, depends: impl Fn(Symbol) -> bool) -> Vec<bool> {
        let mut result = vec![false; self.nodes.len()];
        for (index, node) in self.nodes.iter().enumerate() {
            result[index] = match node {
                Node::Symbol(symbol) => depends(*symbol),
                _ => node.children().any(|child| result[child.index()]),
            };
        }
        result
    }

    /// Rebuilds expressions with every symbol replaced, simplifying again.
    pub fn substitute(
        &mut self,
        roots: &[Expr],
        replacements: &BTreeMap<Symbol, Expr>,
    ) -> Vec<Expr> {
        self.map(roots, |graph, expr, images| match graph.node(expr) {
            Node::Symbol(symbol) => replacements.get(&symbol).copied().unwrap_or(expr),
            node => graph.rebuild(node, images_of(node, images)),
        })
    }

    /// The images of expressions: `of` makes each from those of all that it needs; an image takes over the name.
    pub(crate) fn map(
        &mut self,
        roots: &[Expr],
        of: impl Fn(&mut Self, Expr, &ExprMap<Expr>) -> Expr,
    ) -> Vec<Expr> {
        let mut images: ExprMap<Expr> = ExprMap::new(self);
        for expr in self.reachable(roots) {
            let image = of(self, expr, &images);
            if image != expr
                && let Some(name) = self.names.get(&expr).cloned()
            {
                self.name(image, name);
            }
            images.insert(expr, image);
        }
        roots.iter().map(|&root| images[root]).collect()
    }

    /// The same operation on other children.
    fn rebuild(&mut self, node: Node, children: [Expr; 4]) -> Expr {
        match node {
            Node::Constant(_) | Node::Symbol(_) => self.intern(node),
            Node::Add(..) => self.add(children[0], children[1]),
            Node::Multiply(..) => self.multiply(children[0], children[1]),
            Node::Negate(_) => self.negate(children[0]),
            Node::Divide(..) => self.divide(children[0], children[1]),
            Node::Apply(function, _) => self.apply(function, children[0]),
            Node::TurnFirst(..) => self.turn(children[0], children[1], children[2]).0,
            Node::TurnSecond(..) => self.turn(children[0], children[1], children[2]).1,
            Node::Select { .. } => self.select(children[0], children[1], children[2], children[3]),
        }
    }

    /// Rebuilds expressions with turns written out as products of sines and cosines.
    pub fn expand_turns(&mut self, roots: &[Expr]) -> Vec<Expr> {
        self.map(roots, |graph, expr, images| {
            let node = graph.node(expr);
            let children @ [a, b, c, _] = images_of(node, images);
            match node {
                Node::TurnFirst(..) => graph.expanded_turn(a, b, c).0,
                Node::TurnSecond(..) => graph.expanded_turn(a, b, c).1,
                _ => graph.rebuild(node, children),
            }
        })
    }
}

/// Images of a node's children; places that it has no children for mean nothing.
fn images_of(node: Node, images: &ExprMap<Expr>) -> [Expr; 4] {
    let mut of_children = [Expr(0); 4];
    for (image, child) in of_children.iter_mut().zip(node.children()) {
        *image = images[child];
    }
    of_children
}
