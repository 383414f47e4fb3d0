//! Fits whose solution is known by another way: errors in variables, memory, directions that nothing determines.

mod curvature;
mod errors_in_variables;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
