//! The virtual robot: a hand-written machine that measures itself, for data of which the truth is known.
//!
//! It shares no generated function and no residual with the estimator, and no solver: values and formulas of the
//! description are evaluated as they stand (`drawing.rs`), rods are closed exactly by a Newton method of its own in the
//! freedoms of the plate, with the carts where the [effects](Effect) put them and the forces in equilibrium; trackers
//! stand in frames of their own, targets are mounted anyhow.

mod angles;
mod build;
mod closing;
mod commanded;
mod drawing;
mod effect;
mod equilibrium;
mod folder;
mod forces;
mod linear;
mod listed;
mod machine;
mod noise;
mod parse;
mod parts;
mod plan;
mod plate;
mod random;
mod session;
mod simulation;
mod trackers;
mod write;

pub use build::Build;
pub use effect::{
    BaseFunction, BaseReading, CartError, CartFunction, CartReading, Conditions, DriveFunction,
    DriveReading, Effect, LinkError, LinkFunction, LinkReading, Physics, TcpFunction, TcpReading,
};
pub use folder::{SimulatedFolder, Truth};
pub use machine::{CartState, Machine, State};
pub use noise::{Noise, Tails};
pub use parts::{Crank, Pose, Rod};
pub use plan::{Approach, FARTHEST_TURN, Poses, Temperature, TrackPoints};
pub use plate::{Measure, Objects, Plane};
pub use session::{simulate, within_reach};
pub use simulation::Simulation;
pub use tau_codegen::language::model::Place;
pub use trackers::Mounting;
