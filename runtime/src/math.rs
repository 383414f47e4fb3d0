//! Elementary functions as generated code and interpreter call them.
//!
//! One place for both, so that the two agree bit for bit on one machine.

macro_rules! elementary {
    ($($(#[$doc:meta])* $name:ident = $libm:ident;)*) => {
        $(
            $(#[$doc])*
            #[inline(always)]
            pub fn $name(x: f64) -> f64 {
                #[cfg(feature = "std")]
                { x.$name() }
                #[cfg(all(not(feature = "std"), feature = "libm"))]
                { libm::$libm(x) }
                #[cfg(not(any(feature = "std", feature = "libm")))]
                { let _ = x; compile_error!("tau-runtime needs the feature `std` or the feature `libm`") }
            }
        )*
    };
}

elementary! {
    /// Square root.
    sqrt = sqrt;
    /// Sine of an angle in radians.
    sin = sin;
    /// Cosine of an angle in radians.
    cos = cos;
    /// Tangent of an angle in radians.
    tan = tan;
    /// Arctangent, in radians.
    atan = atan;
    /// Exponential.
    exp = exp;
    /// Natural logarithm.
    ln = log;
    /// Hyperbolic tangent.
    tanh = tanh;
}

/// Sine and cosine of an angle in radians.
#[inline(always)]
pub fn sin_cos(x: f64) -> (f64, f64) {
    (sin(x), cos(x))
}
