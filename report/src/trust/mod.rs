//! How far an answer can be trusted, and what a folder determines, for people and for programs.

pub mod json;
pub mod terminal;
