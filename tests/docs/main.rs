//! What the documentation and the packages state.

mod docs;
mod packages;
mod words;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
