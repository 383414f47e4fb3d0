//! Calibration: against the truth of simulated machines, against other estimators, and what is said of a fit.

mod agreement;
mod assembly;
mod calibration;
mod evaluate;
mod gauge;
mod hand_written;
mod knowledge;
mod nothing_free;
mod pulls;
mod redundant;
mod repeats;
mod sensitivity;
mod split_all;
mod standard_robots;
#[allow(dead_code)]
#[path = "../support.rs"]
mod support;
mod uncertainty;
mod unknown_poses;
