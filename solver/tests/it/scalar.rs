//! Numbers that test models are written over: `f64`, and dual numbers that carry derivatives.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// Most parameters that a dual number carries derivatives by.
pub(crate) const MAX_PARAMETERS: usize = 12;

/// A real number, perhaps with derivatives.
pub(crate) trait Scalar:
    Copy
    + From<f64>
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Add<f64, Output = Self>
    + Sub<f64, Output = Self>
    + Mul<f64, Output = Self>
    + Div<f64, Output = Self>
{
    /// The number without derivatives.
    fn value(self) -> f64;
    /// A function of it, given value and derivative.
    fn chain(self, value: f64, derivative: f64) -> Self;

    fn exp(self) -> Self {
        let e = self.value().exp();
        self.chain(e, e)
    }
    fn ln(self) -> Self {
        let x = self.value();
        self.chain(x.ln(), 1.0 / x)
    }
    fn sin(self) -> Self {
        let x = self.value();
        self.chain(x.sin(), x.cos())
    }
    fn cos(self) -> Self {
        let x = self.value();
        self.chain(x.cos(), -x.sin())
    }
    fn atan(self) -> Self {
        let x = self.value();
        self.chain(x.atan(), 1.0 / (1.0 + x * x))
    }
    fn sqrt(self) -> Self {
        let root = self.value().sqrt();
        self.chain(root, 0.5 / root)
    }
    fn square(self) -> Self {
        self * self
    }
    /// A constant power of a positive number.
    fn powf(self, exponent: f64) -> Self {
        let x = self.value();
        self.chain(x.powf(exponent), exponent * x.powf(exponent - 1.0))
    }
    /// A varying power of a positive number.
    fn pow(self, exponent: Self) -> Self {
        (self.ln() * exponent).exp()
    }
}

impl Scalar for f64 {
    fn value(self) -> f64 {
        self
    }
    fn chain(self, value: f64, _: f64) -> f64 {
        value
    }
    fn pow(self, exponent: f64) -> f64 {
        self.powf(exponent)
    }
}

/// A value with its gradient.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Dual {
    pub(crate) value: f64,
    pub(crate) gradient: [f64; MAX_PARAMETERS],
}

impl Dual {
    /// The variable with this index.
    pub(crate) fn variable(value: f64, index: usize) -> Self {
        let mut dual = Self::from(value);
        dual.gradient[index] = 1.0;
        dual
    }

    fn combine(value: f64, a: Self, by_a: f64, b: Self, by_b: f64) -> Self {
        let mut gradient = [0.0; MAX_PARAMETERS];
        for (i, g) in gradient.iter_mut().enumerate() {
            *g = a.gradient[i] * by_a + b.gradient[i] * by_b;
        }
        Self { value, gradient }
    }
}

impl From<f64> for Dual {
    fn from(value: f64) -> Self {
        Self {
            value,
            gradient: [0.0; MAX_PARAMETERS],
        }
    }
}

impl Scalar for Dual {
    fn value(self) -> f64 {
        self.value
    }
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self {
            value,
            gradient: self.gradient.map(|g| g * derivative),
        }
    }
}

impl Add for Dual {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        Self::combine(self.value + b.value, self, 1.0, b, 1.0)
    }
}

impl Sub for Dual {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        Self::combine(self.value - b.value, self, 1.0, b, -1.0)
    }
}

impl Mul for Dual {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        Self::combine(self.value * b.value, self, b.value, b, self.value)
    }
}

impl Div for Dual {
    type Output = Self;
    fn div(self, b: Self) -> Self {
        let quotient = self.value / b.value;
        Self::combine(quotient, self, 1.0 / b.value, b, -quotient / b.value)
    }
}

impl Neg for Dual {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl Add<f64> for Dual {
    type Output = Self;
    fn add(self, b: f64) -> Self {
        self.chain(self.value + b, 1.0)
    }
}

impl Sub<f64> for Dual {
    type Output = Self;
    fn sub(self, b: f64) -> Self {
        self.chain(self.value - b, 1.0)
    }
}

impl Mul<f64> for Dual {
    type Output = Self;
    fn mul(self, b: f64) -> Self {
        self.chain(self.value * b, b)
    }
}

impl Div<f64> for Dual {
    type Output = Self;
    fn div(self, b: f64) -> Self {
        self.chain(self.value / b, 1.0 / b)
    }
}
