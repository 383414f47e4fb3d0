//! The contract between generated code, the interpreter and the solver.
//!
//! Generated code names nothing but this crate. It holds one trait, [`ResidualFamily`], the tables that
//! describe a robot's variants ([`Robot`], [`Variant`], [`Instance`]), and the elementary functions
//! ([`math`]) that generated code and interpreter share, so that both round alike.
//!
//! The crate is `no_std`, allocates nothing and depends on nothing.
#![no_std]
#[cfg(feature = "std")]
extern crate std;

mod family;
pub mod math;
mod tables;

pub use family::{Pattern, ResidualFamily, Shape};
pub use tables::{
    Arm, Cluster, EffectUse, Input, Instance, Link, Owner, Parameter, ResidualKind, Robot,
    TrackModel, TrackShape, Variant,
};
