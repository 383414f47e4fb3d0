//! Mistakes of the input, outliers and repeated readings: what is named, by its code and file, and what is not.
//!
//! | file | promise |
//! | --- | --- |
//! | `measurements` | columns, rows, units and frames of measurements are named when they are wrong |
//! | `robot_files` | so are noise, tolerances, dimensions and zeros of robot files and descriptions |
//! | `carts` | so are numbers and columns of carts, which tell how tracks run beside a plate |
//! | `no_mistake` | what is no mistake gets no name of one |
//! | `gross_rows` | single rows that are far off are named, left out and foretold without |
//! | `outliers` | so are poses; standard deviations hold the truth all the same |
//! | `verdicts` | what verdicts and checks say, refuse and leave unwritten |
//! | `reach` | what is computed or advised is within reach |
//! | `slow` | the same mistakes over machines and seeds, and counts over many machines |

mod carts;
mod cases;
mod gross_rows;
mod measurements;
mod no_mistake;
mod outliers;
mod reach;
mod robot_files;
#[cfg(feature = "slow")]
mod slow;
mod verdicts;
