//! Mistakes of the input, outliers and repeated readings.

mod absurd;
mod carts_beside;
mod drawing;
mod gross_rows;
mod held_out_rows;
mod recognition;
mod recognition_of_figures;
mod recognition_of_rows;
#[allow(dead_code)]
#[path = "../../support.rs"]
mod support;
mod trust;
mod weighing;
mod wrong_mends;
