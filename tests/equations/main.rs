//! Descriptions: what is said of their mistakes.

mod blocks;
mod codegen;
mod derivatives;
mod effects;
mod kinematics;
mod layout;
mod machines;
mod messages;
mod reference;
mod side_by_side;
mod simulation;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
