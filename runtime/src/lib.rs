//! The contract between generated code, the interpreter and the solver.
//!
//! Generated code names nothing but this crate. It holds the trait [`ResidualFamily`], the tables that
//! describe a robot's variants ([`Robot`], [`Variant`], [`Instance`]), typed handles of their rows
//! ([`VariantHandle`], [`ParameterHandle`]), what turns generated [`Formulas`]
//! into a family that computes single samples and blocks of them, and the elementary functions
//! ([`math`]) that generated code and interpreter share, so that both round alike.
//!
//! The crate is `no_std` and depends on nothing; without the feature `std` it allocates nothing.
#![no_std]

#[cfg(feature = "std")]
extern crate std;

mod family;
mod formulas;
mod handles;
mod lanes;
pub mod math;
mod normal;
mod tables;

pub use family::{BlockFamily, Pattern, ResidualFamily, Shape};
pub use formulas::Formulas;
pub use handles::{DeclaredRobot, ParameterHandle, VariantHandle};
pub use lanes::{Kernel, LANES, Lanes, Samples, block_count, vectorized};
pub use normal::NormalEquations;
pub use tables::{Input, Instance, Owner, Parameter, ResidualKind, Robot, Variant};
