//! Tests of the solver, one module per theme.

mod family;
mod more_garbow_hillstrom;
mod nist;
mod scalar;
