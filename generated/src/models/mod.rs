//! Hand-written: names the generated modules.

#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod five_bar;
#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod four_belts;
#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod four_lines;
#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod gantry_tau;
#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod hexaglide;
#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod hexapod;
#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod linear_delta;
#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod rotary_delta;
#[rustfmt::skip]
#[allow(
    clippy::all,
    clippy::pedantic,
    missing_docs,
    reason = "generated code is read, not polished"
)]
pub mod servo_hexapod;
