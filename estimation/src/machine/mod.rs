//! A variant ready for a fit: its values with their tolerances, the ways of its carts, and what a fit of it fails on.

pub(crate) mod error;
pub(crate) mod nominal;
mod paths;
pub(crate) mod prepared;
pub(crate) mod registration;
pub mod searched;
pub(crate) mod track_scale;

pub use error::Error;
pub use nominal::Nominal;
pub use prepared::{Prepared, length_noise};
pub use registration::{Line, MOUNTING_M, NominalTrack, Registration};
pub(crate) use registration::{centres, set_2, set_3, turn_of};
