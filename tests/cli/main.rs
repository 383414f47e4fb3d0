//! The command line, the study and its report.

mod browser;
mod cli;
mod session;
mod start;
mod study;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
