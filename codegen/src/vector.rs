//! Vectors and rotations of expressions.
//!
//! A rotation about an axis is a node of the graph, a *turn*, until differentiation is done, so that chains stay
//! factored. Where all angles are data and the vector is a parameter, the matrix is data and replaces the chain.

use crate::graph::{Elementary, Expr, Graph, Stage};

/// A vector of three expressions.
pub type Vector = [Expr; 3];

/// An axis of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// x
    X,
    /// y
    Y,
    /// z
    Z,
}

/// A product of rotations about frame axes, the leftmost first: `[(Z, α), (Y, β), (Z, γ)]` is
/// Rz(α)·Ry(β)·Rz(γ).
#[derive(Debug, Clone)]
pub struct Rotation(pub Vec<(Axis, Expr)>);

impl Rotation {
    /// ZYZ Euler angles.
    pub fn zyz(angles: Vector) -> Self {
        Self(vec![
            (Axis::Z, angles[0]),
            (Axis::Y, angles[1]),
            (Axis::Z, angles[2]),
        ])
    }

    /// ZYZ Euler angles of a body that stays upright: alpha and gamma turn about the same axis, beta is zero.
    pub fn about_z(g: &mut Graph, [alpha, _, gamma]: Vector) -> Self {
        Self(vec![(Axis::Z, g.add(alpha, gamma))])
    }

    /// Rotation about x, then y, then z: Rz(c)·Ry(b)·Rx(a).
    pub fn xyz(angles: Vector) -> Self {
        Self(vec![
            (Axis::Z, angles[2]),
            (Axis::Y, angles[1]),
            (Axis::X, angles[0]),
        ])
    }

    /// Applies the rotation factor by factor.
    fn chain(&self, g: &mut Graph, vector: Vector) -> Vector {
        let [mut x, mut y, mut z] = vector;
        for &(axis, angle) in self.0.iter().rev() {
            match axis {
                Axis::X => (y, z) = g.turn(angle, y, z),
                Axis::Y => (z, x) = g.turn(angle, z, x),
                Axis::Z => (x, y) = g.turn(angle, x, y),
            }
        }
        [x, y, z]
    }

    /// Columns of the rotation matrix.
    pub fn columns(&self, g: &mut Graph) -> [Vector; 3] {
        let (zero, one) = (g.constant(0.0), g.constant(1.0));
        [[one, zero, zero], [zero, one, zero], [zero, zero, one]].map(|unit| self.chain(g, unit))
    }

    /// Applies the rotation to a vector.
    ///
    /// If the angles are data and the vector is not, the matrix is data too and is worth having:
    /// fifteen operations per iteration instead of eighteen. Elsewhere the factors stay apart.
    pub fn apply(&self, g: &mut Graph, vector: Vector, name: &str) -> Vector {
        let angles = self.0.iter().map(|&(_, angle)| g.stage(angle)).max();
        let varies = vector.iter().any(|&v| g.stage(v) == Stage::Parameter);
        if angles.is_some_and(|stage| stage <= Stage::Data) && varies {
            let columns = self.columns(g);
            for (column, axis) in columns.iter().zip(["x", "y", "z"]) {
                for (&entry, row) in column.iter().zip(["x", "y", "z"]) {
                    g.name(entry, format!("{name}_{row}{axis}"));
                }
            }
            let mut result = [g.constant(0.0); 3];
            for (column, &component) in columns.iter().zip(&vector) {
                let scaled = scale(g, component, *column);
                result = add(g, result, scaled);
            }
            result
        } else {
            self.chain(g, vector)
        }
    }
}

/// The rotation by a rotation vector ω, as Rodrigues parameters r = tan(|ω|/2)·ω/|ω|.
///
/// The tangent by its series, which is smooth at zero: r = ω/2·(1 + |ω|²/12). The angle is off by |ω|⁵/120, a tenth of
/// a microradian at 100 mrad; the matrix is orthogonal to rounding at any.
#[derive(Debug, Clone, Copy)]
pub struct RotationVector {
    /// r, and 2/(1 + |r|²); `None` where ω is zero.
    parameters: Option<(Vector, Expr)>,
}

impl RotationVector {
    /// By ω (rad).
    pub fn new(g: &mut Graph, vector: Vector) -> Self {
        if vector.iter().all(|&component| g.is_zero(component)) {
            return Self { parameters: None };
        }
        let (one, two) = (g.constant(1.0), g.constant(2.0));
        let (half, cubic) = (g.constant(0.5), g.constant(1.0 / 24.0));
        let square = dot(g, vector, vector);
        let bend = g.multiply(cubic, square);
        let factor = g.add(half, bend);
        let r = scale(g, factor, vector);
        let square = dot(g, r, r);
        let denominator = g.add(one, square);
        let factor = g.divide(two, denominator);
        Self {
            parameters: Some((r, factor)),
        }
    }

    /// Applies the rotation to a vector: v + 2/(1 + |r|²)·(r × v + r × (r × v)).
    pub fn apply(&self, g: &mut Graph, vector: Vector) -> Vector {
        let Some((r, factor)) = self.parameters else {
            return vector;
        };
        let first = cross(g, r, vector);
        let second = cross(g, r, first);
        let both = add(g, first, second);
        let change = scale(g, factor, both);
        add(g, vector, change)
    }
}

/// `a + b`
pub fn add(g: &mut Graph, a: Vector, b: Vector) -> Vector {
    [g.add(a[0], b[0]), g.add(a[1], b[1]), g.add(a[2], b[2])]
}

/// `a - b`
pub fn subtract(g: &mut Graph, a: Vector, b: Vector) -> Vector {
    [
        g.subtract(a[0], b[0]),
        g.subtract(a[1], b[1]),
        g.subtract(a[2], b[2]),
    ]
}

/// `s a`
pub fn scale(g: &mut Graph, s: Expr, a: Vector) -> Vector {
    a.map(|component| g.multiply(s, component))
}

/// `a · b`
pub fn dot(g: &mut Graph, a: Vector, b: Vector) -> Expr {
    let products = [
        g.multiply(a[0], b[0]),
        g.multiply(a[1], b[1]),
        g.multiply(a[2], b[2]),
    ];
    g.sum(products)
}

/// `a × b`
pub fn cross(g: &mut Graph, a: Vector, b: Vector) -> Vector {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let (p, q) = (g.multiply(a[i], b[j]), g.multiply(a[j], b[i]));
        g.subtract(p, q)
    })
}

/// `a / ‖a‖`
pub fn normalize(g: &mut Graph, a: Vector) -> Vector {
    let square = dot(g, a, a);
    let length = g.apply(Elementary::Sqrt, square);
    let one = g.constant(1.0);
    let inverse = g.divide(one, length);
    scale(g, inverse, a)
}

/// The arithmetic mean of several vectors.
pub fn mean(g: &mut Graph, vectors: &[Vector]) -> Vector {
    let mut total = [g.constant(0.0); 3];
    for vector in vectors {
        total = add(g, total, *vector);
    }
    let share = g.constant(1.0 / vectors.len() as f64);
    scale(g, share, total)
}

/// The zero vector.
pub fn zero(g: &mut Graph) -> Vector {
    [g.constant(0.0); 3]
}
