//! Whole-program, snapshot and property tests, one module a theme.

mod bad_input;
mod derivatives;
mod reference;
mod codegen;
