//! The main job: the paper's study on a measurement folder.

pub mod results;
