//! Tests of the solver, one module per theme.

mod bounds;
mod family;
mod linear_model;
mod more_garbow_hillstrom;
mod nist;
mod normal_equations;
mod own_parameters;
mod robust;
mod scalar;
mod statistics;
mod structure;
