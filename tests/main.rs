//! Whole-program, snapshot and property tests, one module a theme.

mod bad_input;
