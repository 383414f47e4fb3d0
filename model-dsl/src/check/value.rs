//! Values of formulas: their shapes and dimensions, and arithmetic on them.

use crate::diagnostics::{Diagnostics, Location};
use crate::model::{BinaryOperator, Formula};
use crate::syntax::Expression;
use crate::units::Dimension;

/// A scalar or three components.
pub(super) enum Shape {
    Scalar(Formula),
    Vector(Box<[Formula; 3]>),
}

impl Shape {
    pub(super) fn into_formula(self) -> Formula {
        match self {
            Self::Scalar(formula) => formula,
            Self::Vector(components) => Formula::Vector(components),
        }
    }

    pub(super) fn map(self, operation: impl Fn(Formula) -> Formula) -> Self {
        match self {
            Self::Scalar(formula) => Self::Scalar(operation(formula)),
            Self::Vector(components) => Self::Vector(Box::new(components.map(operation))),
        }
    }

    fn word(&self) -> &'static str {
        match self {
            Self::Scalar(_) => "a scalar",
            Self::Vector(_) => "a vector",
        }
    }
}

/// A checked formula; its dimension is unknown after an error in a declaration.
pub(super) struct Checked {
    pub(super) shape: Shape,
    pub(super) dimension: Option<Dimension>,
}

impl Checked {
    pub(super) fn scalar(formula: Formula, dimension: Dimension) -> Self {
        Self {
            shape: Shape::Scalar(formula),
            dimension: Some(dimension),
        }
    }
}

/// A vector of the given components.
pub(super) fn tuple(
    components: &[Expression],
    values: Vec<Option<Checked>>,
    location: Location,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    if components.len() != 3 {
        error!(diagnostics, VECTOR_COMPONENTS, location; "a vector has 3 components, found {}", components.len();
            "write `(x, y, z)`");
        return None;
    }
    let mut scalars = Vec::new();
    let mut dimension: Option<Dimension> = None;
    for (one, written) in values.into_iter().zip(components) {
        let one = one?;
        let Shape::Scalar(scalar) = one.shape else {
            error!(diagnostics, WRONG_SHAPE, written.location; "a component of a vector cannot be a vector";
                "write a scalar");
            return None;
        };
        scalars.push(scalar);
        if let (Some(expected), Some(found)) = (dimension, one.dimension)
            && expected != found
        {
            error!(diagnostics, DIFFERENT_DIMENSIONS, written.location;
                "the components of a vector have one unit, found {} after {}", found.describe(), expected.describe();
                "bring them to the same unit");
            return None;
        }
        dimension = dimension.or(one.dimension);
    }
    let shape = Shape::Vector(Box::new(scalars.try_into().ok()?));
    Some(Checked { shape, dimension })
}

/// Sum, difference, product or quotient of two values.
pub(super) fn binary(
    operator: BinaryOperator,
    left: Checked,
    right: Checked,
    location: Location,
    diagnostics: &mut Diagnostics,
) -> Option<Checked> {
    use BinaryOperator::{Add, Divide, Multiply, Subtract};
    let apply = |a, b| Formula::Binary(operator, Box::new(a), Box::new(b));
    let refuse = |left: &str, right: &str| match operator {
        Add => format!("cannot add {left} and {right}"),
        Subtract => format!("cannot subtract {right} from {left}"),
        Multiply => format!("cannot multiply {left} and {right}"),
        Divide => format!("cannot divide {left} by {right}"),
    };
    let known = left.dimension.zip(right.dimension);
    let dimension = match (operator, known) {
        (_, None) => None,
        (Add | Subtract, Some((a, b))) => {
            let dimension = common(a, b);
            if dimension.is_none() {
                error!(diagnostics, DIFFERENT_DIMENSIONS, location; "{}", refuse(&a.describe(), &b.describe());
                    "{}", different_help(a, b));
                return None;
            }
            dimension
        }
        (Multiply | Divide, Some((a, b))) => {
            let dimension = if operator == Multiply {
                a.multiply(b)
            } else {
                a.divide(b)
            };
            if dimension.is_none() {
                return unit_overflow(location, diagnostics);
            }
            dimension
        }
    };
    let shape = match (operator, left.shape, right.shape) {
        (_, Shape::Scalar(a), Shape::Scalar(b)) => Shape::Scalar(apply(a, b)),
        (Add | Subtract, Shape::Vector(a), Shape::Vector(b)) => {
            let ([a0, a1, a2], [b0, b1, b2]) = (*a, *b);
            Shape::Vector(Box::new([apply(a0, b0), apply(a1, b1), apply(a2, b2)]))
        }
        (Multiply | Divide, vector @ Shape::Vector(_), Shape::Scalar(scalar)) => {
            vector.map(|component| apply(component, scalar.clone()))
        }
        (Multiply, Shape::Scalar(scalar), vector @ Shape::Vector(_)) => {
            vector.map(|component| apply(scalar.clone(), component))
        }
        (_, left, right) => {
            error!(diagnostics, VECTOR_OPERATION, location; "{}", refuse(left.word(), right.word());
                "vectors add to vectors; multiply or divide them by scalars, or use components, such as `rate[0]`");
            return None;
        }
    };
    Some(Checked { shape, dimension })
}

/// Dimension of a sum; a number stands for an angle where one is wanted.
pub(super) fn common(left: Dimension, right: Dimension) -> Option<Dimension> {
    let angles = [Dimension::ANGLE, Dimension::NUMBER];
    if left == right {
        Some(left)
    } else if angles.contains(&left) && angles.contains(&right) {
        Some(Dimension::ANGLE)
    } else {
        None
    }
}

/// Remedy for two dimensions that do not go together.
pub(super) fn different_help(left: Dimension, right: Dimension) -> String {
    if left == Dimension::NUMBER {
        format!("give the number a unit, such as `1 {}`", right.si_unit())
    } else if right == Dimension::NUMBER {
        format!("give the number a unit, such as `1 {}`", left.si_unit())
    } else {
        "both sides must have the same dimension".to_owned()
    }
}

/// Refuses a unit whose exponents are too large.
pub(super) fn unit_overflow<T>(location: Location, diagnostics: &mut Diagnostics) -> Option<T> {
    error!(diagnostics, UNIT_OVERFLOW, location; "the power of this formula's unit is too large";
        "check the exponents");
    None
}
