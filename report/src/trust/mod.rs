//! Trust in an answer, and contents of a folder, for people and for programs.

pub mod json;
pub mod terminal;
