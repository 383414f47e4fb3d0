//! Formulas: trees over numbers, parameters and quantities.

use super::Value;

/// A formula: a tree over the effect's parameters and the quantities it may read.
#[derive(Debug, Clone, PartialEq)]
pub enum Formula {
    /// A number, in SI units.
    Number(f64),
    /// A component of a parameter: index in [`Effect::parameters`], component (0 for a scalar).
    Parameter(usize, usize),
    /// A component of a parameter of the whole machine: index in [`Model::parameters`], component.
    OfRobot(usize, usize),
    /// A component of another value of the same link, which has parameters of its own.
    OfLink(Value, usize),
    /// A quantity of the sample or the model.
    Read(Readable),
    /// `-a`.
    Negate(Box<Formula>),
    /// `a + b`, and so on.
    Binary(BinaryOperator, Box<Formula>, Box<Formula>),
    /// `a ^ n` with a whole number.
    Power(Box<Formula>, i32),
    /// An elementary function.
    Call(Function, Vec<Formula>),
    /// `(a, b, c)`; vectors occur only at the top of a term for a vector target: scalar products and
    /// sums with vectors are resolved into components by the checker.
    Vector(Box<[Formula; 3]>),
}

impl Formula {
    /// The formulas that it is made of, in order.
    fn children(&self) -> impl DoubleEndedIterator<Item = &Self> {
        let (first, second, more): (Option<&Self>, Option<&Self>, &[Self]) = match self {
            Self::Number(_)
            | Self::Parameter(..)
            | Self::OfRobot(..)
            | Self::OfLink(..)
            | Self::Read(_) => (None, None, &[]),
            Self::Negate(inner) | Self::Power(inner, _) => (Some(inner), None, &[]),
            Self::Binary(_, left, right) => (Some(left), Some(right), &[]),
            Self::Call(_, arguments) => (None, None, arguments),
            Self::Vector(components) => (None, None, &components[..]),
        };
        first.into_iter().chain(second).chain(more)
    }

    /// Itself and all that it is made of, from the left, each before its own parts.
    pub fn parts(&self) -> impl Iterator<Item = &Self> {
        let mut ahead = vec![self];
        std::iter::from_fn(move || {
            let next = ahead.pop()?;
            ahead.extend(next.children().rev());
            Some(next)
        })
    }

    /// Its value, if it is a scalar that holds neither parameters nor quantities.
    pub fn constant(&self) -> Option<f64> {
        self.value(&|_| None)
    }

    /// Its value, if it is a scalar, with those of the parameters and quantities that it holds.
    pub fn value(&self, of: &dyn Fn(&Self) -> Option<f64>) -> Option<f64> {
        Some(match self {
            Self::Number(value) => *value,
            Self::Parameter(..) | Self::OfRobot(..) | Self::OfLink(..) | Self::Read(_) => of(self)?,
            Self::Vector(_) => return None,
            Self::Negate(inner) => -inner.value(of)?,
            Self::Binary(operator, left, right) => operator.of(left.value(of)?, right.value(of)?),
            Self::Power(inner, exponent) => inner.value(of)?.powi(*exponent),
            Self::Call(function, arguments) => {
                let values: Option<Vec<f64>> = arguments.iter().map(|a| a.value(of)).collect();
                function.of(&values?)?
            }
        })
    }

    /// The quantities that it reads, from the left.
    pub fn quantities(&self) -> impl Iterator<Item = Readable> {
        self.parts().filter_map(|part| match part {
            Self::Read(quantity) => Some(*quantity),
            _ => None,
        })
    }
}

/// A binary operator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BinaryOperator {
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
}

macro_rules! operators {
    ($($trait:ident $method:ident $operator:ident),*) => {$(
        impl std::ops::$trait for Formula {
            type Output = Self;

            fn $method(self, other: Self) -> Self {
                Self::Binary(BinaryOperator::$operator, Box::new(self), Box::new(other))
            }
        }
    )*};
}

operators!(Add add Add, Sub sub Subtract, Mul mul Multiply, Div div Divide);

impl BinaryOperator {
    fn of(self, left: f64, right: f64) -> f64 {
        match self {
            Self::Add => left + right,
            Self::Subtract => left - right,
            Self::Multiply => left * right,
            Self::Divide => left / right,
        }
    }
}

/// An elementary function. Angles are in radians, arguments otherwise dimensionless, except that
/// `sqrt`, `abs`, `min`, `max` carry units and `sign` takes any.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Function {
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
    /// Square root.
    Sqrt,
    /// Magnitude.
    Abs,
    /// −1, or +1 from zero upwards.
    Sign,
    /// The smaller of two.
    Min,
    /// The larger of two.
    Max,
}

impl Function {
    /// Its value; `None` for a wrong number of arguments.
    fn of(self, arguments: &[f64]) -> Option<f64> {
        Some(match (self, arguments) {
            (Self::Sin, [a]) => a.sin(),
            (Self::Cos, [a]) => a.cos(),
            (Self::Tan, [a]) => a.tan(),
            (Self::Atan, [a]) => a.atan(),
            (Self::Exp, [a]) => a.exp(),
            (Self::Ln, [a]) => a.ln(),
            (Self::Tanh, [a]) => a.tanh(),
            (Self::Sqrt, [a]) => a.sqrt(),
            (Self::Abs, [a]) => a.abs(),
            (Self::Sign, [a]) if *a < 0.0 => -1.0,
            (Self::Sign, [_]) => 1.0,
            (Self::Min, [a, b]) => a.min(*b),
            (Self::Max, [a, b]) => a.max(*b),
            _ => return None,
        })
    }
}

/// A quantity that a formula may read, SI.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Readable {
    /// `q`: command of the cart it acts on, or of the cart or drive of the link it acts on (m, rad of drums).
    Command,
    /// `travel`: the same as a number, from -1 at the low end of the drive's travel to 1 at its high end.
    Travel,
    /// `q(track)`: command of a named track (m).
    CommandOf(usize),
    /// `q(source)`: command of the source cart (m).
    SourceCommand,
    /// `direction`: ±1, side of approach of that drive.
    Direction,
    /// `time` (s).
    Time,
    /// `temperature` (°C, as a number of kelvins above 0 °C).
    Temperature,
    /// `load_along` (N).
    LoadAlong,
    /// `load_horizontal` (N).
    LoadHorizontal,
    /// `load_vertical` (N).
    LoadVertical,
    /// `tension` of the link (N).
    Tension,
    /// `length`: calibrated length of the link (m), without effects.
    Length,
    /// `paid_out`: what that is more than at command zero (m).
    PaidOut,
    /// `x`, `y` or `z` of the measured TCP (m).
    Position(usize),
    /// `base_x`, `base_y` or `base_z`: calibrated base joint, or centre of the crank (m), without effects.
    Base(usize),
}

impl Readable {
    /// True for what belongs to one drive: a place without a drive has none of it.
    pub fn is_of_drive(self) -> bool {
        matches!(self, Self::Command | Self::Travel | Self::Direction)
    }

    /// True for a force: the tension of a link, or what the arm does to a cart.
    pub fn is_force(self) -> bool {
        matches!(
            self,
            Self::LoadAlong | Self::LoadHorizontal | Self::LoadVertical | Self::Tension
        )
    }
}
