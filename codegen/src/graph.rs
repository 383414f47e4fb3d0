//! Expressions as a hash-consed graph.
//!
//! A node refers to earlier nodes by index, so every child stands before its parents; equal
//! expressions are one node, so common subexpressions are found by construction. The constructors
//! simplify as they build: constants fold, negations move outwards, neutral elements vanish.

mod traversal;

use std::collections::BTreeMap;
use std::ops::Index;

use rustc_hash::FxHashMap;

/// An expression: the index of a node in its [`Graph`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Expr(u32);

impl Expr {
    /// Position among the nodes.
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// A free variable: the index of a symbol in its [`Graph`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Symbol(pub u32);

/// The most that an expression depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Stage {
    /// Nothing.
    Constant,
    /// Data of the sample: computed once.
    Data,
    /// Parameters: computed at every iteration.
    Parameter,
}

/// An elementary function of one argument.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Elementary {
    /// Square root.
    Sqrt,
    /// Sine.
    Sin,
    /// Cosine.
    Cos,
    /// Tangent.
    Tan,
    /// Arctangent.
    Atan,
    /// Exponential.
    Exp,
    /// Natural logarithm.
    Ln,
    /// Hyperbolic tangent.
    Tanh,
}

/// An operation on earlier nodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Node {
    /// A number, as its bits.
    Constant(u64),
    /// A free variable.
    Symbol(Symbol),
    /// `a + b`, children in order of index.
    Add(Expr, Expr),
    /// `a * b`, children in order of index.
    Multiply(Expr, Expr),
    /// `-a`
    Negate(Expr),
    /// `a / b`
    Divide(Expr, Expr),
    /// An elementary function.
    Apply(Elementary, Expr),
    /// First coordinate of `(x, y)` turned by an angle: `cos θ x − sin θ y`.
    ///
    /// Turns are nodes of their own until differentiation is done: the derivative by the angle is the
    /// other coordinate (the planar case of `d(R p)/dθ = axis × R p`), which products of sines and
    /// cosines would hide.
    TurnFirst(Expr, Expr, Expr),
    /// Second coordinate: `sin θ x + cos θ y`.
    TurnSecond(Expr, Expr, Expr),
    /// `if left < right { below } else { otherwise }`
    Select {
        /// Left side of the comparison.
        left: Expr,
        /// Right side.
        right: Expr,
        /// Value where left < right.
        below: Expr,
        /// Value elsewhere.
        otherwise: Expr,
    },
}

impl Node {
    /// The children, in order.
    pub fn children(&self) -> impl Iterator<Item = Expr> + use<> {
        let children = match *self {
            Node::Constant(_) | Node::Symbol(_) => [None; 4],
            Node::Negate(a) | Node::Apply(_, a) => [Some(a), None, None, None],
            Node::Add(a, b) | Node::Multiply(a, b) | Node::Divide(a, b) => {
                [Some(a), Some(b), None, None]
            }
            Node::TurnFirst(a, x, y) | Node::TurnSecond(a, x, y) => {
                [Some(a), Some(x), Some(y), None]
            }
            Node::Select {
                left,
                right,
                below,
                otherwise,
            } => [left, right, below, otherwise].map(Some),
        };
        children.into_iter().flatten()
    }
}

/// A free variable's name and stage.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SymbolInfo {
    /// Name, a valid identifier.
    pub name: String,
    /// [`Stage::Data`] or [`Stage::Parameter`].
    pub stage: Stage,
}

/// Values of some expressions of a graph, by index.
#[derive(Debug, Clone)]
pub(crate) struct ExprMap<T>(Vec<Option<T>>);

impl<T: Copy> ExprMap<T> {
    /// For the expressions that a graph has now.
    pub(crate) fn new(graph: &Graph) -> Self {
        Self(vec![None; graph.len()])
    }

    /// `None` also for expressions that are newer than the map.
    pub(crate) fn get(&self, expr: Expr) -> Option<T> {
        self.0.get(expr.index()).copied().flatten()
    }

    pub(crate) fn contains(&self, expr: Expr) -> bool {
        self.get(expr).is_some()
    }

    pub(crate) fn values(&self) -> impl Iterator<Item = &T> {
        self.0.iter().flatten()
    }

    pub(crate) fn insert(&mut self, expr: Expr, value: T) {
        self.0[expr.index()] = Some(value);
    }
}

impl ExprMap<usize> {
    /// Counts an expression so many times more.
    pub(crate) fn count(&mut self, expr: Expr, times: usize) {
        *self.0[expr.index()].get_or_insert(0) += times;
    }
}

impl<T> Index<Expr> for ExprMap<T> {
    type Output = T;

    fn index(&self, expr: Expr) -> &T {
        self.0[expr.index()]
            .as_ref()
            .expect("children stand before their parents")
    }
}

/// A graph of expressions.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    stages: Vec<Stage>,
    interned: FxHashMap<Node, Expr>,
    symbols: Vec<SymbolInfo>,
    names: BTreeMap<Expr, String>,
}

/// Stages and lookup follow from nodes and symbols.
impl PartialEq for Graph {
    fn eq(&self, other: &Self) -> bool {
        (&self.nodes, &self.symbols, &self.names) == (&other.nodes, &other.symbols, &other.names)
    }
}

impl Graph {
    /// A graph without nodes.
    pub fn new() -> Self {
        Self::default()
    }

    /// The operation of an expression.
    pub fn node(&self, expr: Expr) -> Node {
        self.nodes[expr.index()]
    }

    /// The most that an expression depends on.
    pub fn stage(&self, expr: Expr) -> Stage {
        self.stages[expr.index()]
    }

    /// All symbols, in order of creation.
    pub fn symbols(&self) -> &[SymbolInfo] {
        &self.symbols
    }

    /// Number of nodes.
    pub fn len(&self) -> usize {
        self.nodes.len()
    }

    /// True if there are no nodes.
    pub fn is_empty(&self) -> bool {
        self.nodes.is_empty()
    }

    /// Suggests a name for the temporary that will hold an expression.
    pub fn name(&mut self, expr: Expr, name: impl Into<String>) {
        if !matches!(self.node(expr), Node::Constant(_) | Node::Symbol(_)) {
            self.names.entry(expr).or_insert_with(|| name.into());
        }
    }

    /// The suggested name of an expression.
    pub fn name_of(&self, expr: Expr) -> Option<&str> {
        self.names.get(&expr).map(String::as_str)
    }

    /// The value of a constant expression.
    pub fn constant_value(&self, expr: Expr) -> Option<f64> {
        match self.node(expr) {
            Node::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    /// True if an expression is the constant zero.
    pub fn is_zero(&self, expr: Expr) -> bool {
        self.constant_value(expr) == Some(0.0)
    }

    fn intern(&mut self, node: Node) -> Expr {
        if let Some(&expr) = self.interned.get(&node) {
            return expr;
        }
        let stage = match node {
            Node::Constant(_) => Stage::Constant,
            Node::Symbol(symbol) => self.symbols[symbol.0 as usize].stage,
            _ => node
                .children()
                .map(|child| self.stage(child))
                .max()
                .unwrap_or(Stage::Constant),
        };
        let expr = Expr(u32::try_from(self.nodes.len()).expect("a graph of less than 2³² nodes"));
        self.nodes.push(node);
        self.stages.push(stage);
        self.interned.insert(node, expr);
        expr
    }

    /// A new free variable.
    pub fn symbol(&mut self, name: impl Into<String>, stage: Stage) -> Expr {
        let symbol = Symbol(u32::try_from(self.symbols.len()).expect("less than 2³² symbols"));
        self.symbols.push(SymbolInfo {
            name: name.into(),
            stage,
        });
        self.intern(Node::Symbol(symbol))
    }

    /// A number; negative ones are negations, so that `2 x` and `-2 x` share.
    pub fn constant(&mut self, value: f64) -> Expr {
        if value.is_sign_negative() && value != 0.0 {
            let magnitude = self.intern(Node::Constant((-value).to_bits()));
            return self.intern(Node::Negate(magnitude));
        }
        // `+ 0.0` turns −0 into 0.
        self.intern(Node::Constant((value + 0.0).to_bits()))
    }

    /// The constant that an operation on constants comes out as; where that is infinite or not a number, the
    /// operation stays and is left to run time, which has an error for it.
    fn folded(&mut self, value: f64) -> Option<Expr> {
        value.is_finite().then(|| self.constant(value))
    }

    /// Value of a constant or of a negated constant.
    fn number(&self, expr: Expr) -> Option<f64> {
        match self.node(expr) {
            Node::Negate(inner) => self.constant_value(inner).map(|value| -value),
            _ => self.constant_value(expr),
        }
    }

    /// `-a`
    pub fn negate(&mut self, a: Expr) -> Expr {
        match self.node(a) {
            Node::Negate(inner) => inner,
            Node::Constant(bits) if f64::from_bits(bits) == 0.0 => a,
            _ => self.intern(Node::Negate(a)),
        }
    }

    /// `a + b`
    pub fn add(&mut self, a: Expr, b: Expr) -> Expr {
        if let (Some(x), Some(y)) = (self.number(a), self.number(b))
            && let Some(sum) = self.folded(x + y)
        {
            return sum;
        }
        if self.is_zero(a) {
            return b;
        }
        if self.is_zero(b) {
            return a;
        }
        if a == b {
            let two = self.constant(2.0);
            return self.multiply(two, a);
        }
        match (self.node(a), self.node(b)) {
            (Node::Negate(x), Node::Negate(y)) => {
                let sum = self.add(x, y);
                self.negate(sum)
            }
            (Node::Negate(x), _) if x == b => self.constant(0.0),
            (_, Node::Negate(y)) if y == a => self.constant(0.0),
            _ => self.intern(Node::Add(a.min(b), a.max(b))),
        }
    }

    /// `a - b`
    pub fn subtract(&mut self, a: Expr, b: Expr) -> Expr {
        let negated = self.negate(b);
        self.add(a, negated)
    }

    /// `a * b`
    pub fn multiply(&mut self, a: Expr, b: Expr) -> Expr {
        if let (Some(x), Some(y)) = (self.number(a), self.number(b))
            && let Some(product) = self.folded(x * y)
        {
            return product;
        }
        for (x, y) in [(a, b), (b, a)] {
            match self.node(x) {
                Node::Negate(inner) => {
                    let product = self.multiply(inner, y);
                    return self.negate(product);
                }
                Node::Constant(bits) => {
                    let value = f64::from_bits(bits);
                    if value == 0.0 {
                        return x;
                    }
                    if value == 1.0 {
                        return y;
                    }
                    // 2 · (3 · z) is 6 · z.
                    if let Node::Multiply(p, q) = self.node(y) {
                        for (constant, rest) in [(p, q), (q, p)] {
                            if let Some(other) = self.constant_value(constant)
                                && let Some(folded) = self.folded(value * other)
                            {
                                return self.multiply(folded, rest);
                            }
                        }
                    }
                }
                _ => {}
            }
        }
        self.intern(Node::Multiply(a.min(b), a.max(b)))
    }

    /// `a / b`
    pub fn divide(&mut self, a: Expr, b: Expr) -> Expr {
        if let (Some(x), Some(y)) = (self.number(a), self.number(b))
            && let Some(quotient) = self.folded(x / y)
        {
            return quotient;
        }
        if self.is_zero(a) || self.constant_value(b) == Some(1.0) {
            return a;
        }
        match (self.node(a), self.node(b)) {
            (Node::Negate(x), _) => {
                let quotient = self.divide(x, b);
                self.negate(quotient)
            }
            (_, Node::Negate(y)) => {
                let quotient = self.divide(a, y);
                self.negate(quotient)
            }
            _ => self.intern(Node::Divide(a, b)),
        }
    }

    /// `a` to a whole power, by repeated squaring.
    pub fn power(&mut self, a: Expr, exponent: i32) -> Expr {
        let mut result = self.constant(1.0);
        let mut square = a;
        let mut left = exponent.unsigned_abs();
        while left > 0 {
            if left & 1 == 1 {
                result = self.multiply(result, square);
            }
            left >>= 1;
            if left > 0 {
                square = self.multiply(square, square);
            }
        }
        if exponent < 0 {
            let one = self.constant(1.0);
            result = self.divide(one, result);
        }
        result
    }

    /// An elementary function.
    pub fn apply(&mut self, function: Elementary, a: Expr) -> Expr {
        // Exact values fold: functions of zero, and roots, which every machine rounds alike. The others depend
        // on the machine's library, and generated text must not.
        if self.is_zero(a) {
            match function {
                Elementary::Cos | Elementary::Exp => return self.constant(1.0),
                Elementary::Ln => {}
                _ => return a,
            }
        }
        if let Node::Negate(inner) = self.node(a) {
            match function {
                Elementary::Cos => return self.apply(function, inner),
                Elementary::Sin | Elementary::Tan | Elementary::Atan | Elementary::Tanh => {
                    let value = self.apply(function, inner);
                    return self.negate(value);
                }
                _ => {}
            }
        }
        if let (Elementary::Sqrt, Some(value)) = (function, self.constant_value(a)) {
            return self.constant(value.sqrt());
        }
        self.intern(Node::Apply(function, a))
    }

    /// `(x, y)` turned by an angle in its plane, anticlockwise.
    pub fn turn(&mut self, angle: Expr, x: Expr, y: Expr) -> (Expr, Expr) {
        if self.is_zero(angle) || (self.is_zero(x) && self.is_zero(y)) {
            return (x, y);
        }
        if self.is_zero(x) || self.is_zero(y) {
            return self.expanded_turn(angle, x, y);
        }
        if let (Node::Negate(p), Node::Negate(q)) = (self.node(x), self.node(y)) {
            let (first, second) = self.turn(angle, p, q);
            return (self.negate(first), self.negate(second));
        }
        (
            self.intern(Node::TurnFirst(angle, x, y)),
            self.intern(Node::TurnSecond(angle, x, y)),
        )
    }

    fn expanded_turn(&mut self, angle: Expr, x: Expr, y: Expr) -> (Expr, Expr) {
        let (cos, sin) = (
            self.apply(Elementary::Cos, angle),
            self.apply(Elementary::Sin, angle),
        );
        let (cx, sy) = (self.multiply(cos, x), self.multiply(sin, y));
        let (sx, cy) = (self.multiply(sin, x), self.multiply(cos, y));
        (self.subtract(cx, sy), self.add(sx, cy))
    }

    /// `if left < right { below } else { otherwise }`
    pub fn select(&mut self, left: Expr, right: Expr, below: Expr, otherwise: Expr) -> Expr {
        if below == otherwise {
            return below;
        }
        if let (Some(x), Some(y)) = (self.number(left), self.number(right)) {
            return if x < y { below } else { otherwise };
        }
        self.intern(Node::Select {
            left,
            right,
            below,
            otherwise,
        })
    }

    /// Sum of several expressions.
    pub fn sum(&mut self, terms: impl IntoIterator<Item = Expr>) -> Expr {
        let mut total = self.constant(0.0);
        for term in terms {
            total = self.add(total, term);
        }
        total
    }
}
