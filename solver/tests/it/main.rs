//! Tests of the solver, one module per theme.

mod family;
mod nist;
mod scalar;
