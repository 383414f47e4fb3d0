//! What the documentation and the packages state.

mod codes;
mod docs;
mod packages;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
mod words;
