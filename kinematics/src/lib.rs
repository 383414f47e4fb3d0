//! Forward and inverse kinematics of any variant, by its generated closures and their derivatives.

mod continuation;
mod error;
mod forward;
mod inputs;
mod inverse;
mod layout;
mod least_norm;
mod machine;
mod nearest;
mod newton;
mod paths;
mod pose;
mod statics;

pub use error::Error;
pub use forward::LARGEST_MISMATCH_M;
pub use inputs::{LengthNoise, Missing, Sample, Surroundings, UnknownPull};
pub use inverse::{InverseOptions, Reached};
pub use layout::{Layout, Rail, Rod};
pub use least_norm::least_norm;
pub use machine::{Closures, Machine};
pub use paths::{Path, Segment};
pub use pose::{POSE_COLUMNS, Pose, angle_rates, nearest_rotation, xyz, xyz_angles, zyz};
pub use statics::{ByPull, Forces, Statics, track_axes};
