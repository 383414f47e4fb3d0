//! Whole fits against Ceres Solver: of one link, and of the variants of a robot.

use crate::{one_link, setup, variants};

/// Measures and prints both tables.
pub(crate) fn print() {
    println!("## Whole fits\n");
    let ceres = setup::ceres();
    one_link::print(ceres.as_deref().ok());
    variants::print(ceres.as_deref().ok());
    setup::or_say("Ceres Solver", ceres);
}
