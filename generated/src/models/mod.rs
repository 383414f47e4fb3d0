//! Hand-written: names the generated modules.

#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod gantry_tau;
