//! What the documentation and the packages state.

mod docs;
mod packages;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
mod words;
