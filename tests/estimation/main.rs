//! Calibration: against the truth of simulated machines, against other estimators, and what is said of a fit.
//!
//! | file | promise |
//! | --- | --- |
//! | `truth` | calibrated numbers are those of the machine, for standard robots and all kinds of measurements |
//! | `calibration` | the paper's five variants on the prototype: errors, optimum, standard deviations, refusals |
//! | `unknown_poses` | fits without poses: exact numbers, gross rows, noise by kind |
//! | `gauge` | what measurements leave open is named, what they do not determine is refused |
//! | `redundant` | exact drives that are more than freedoms bind parameters, or contradict each other |
//! | `pulls` | forces and pulls are those of the machine that is found |
//! | `repeats` | repeatability beside lack of fit |
//! | `assembly` | the arm is assembled as the reference says |
//! | `uncertainty` | standard deviations of predictions are those of steps by hand |
//! | `knowledge` | standard deviations in results: stated, widened, of formulas, of files |
//! | `evaluate` | a calibrated file on new measurements: consistent, changed, or not to be judged |
//! | `agreement` | answers of several commands agree with each other and with what was measured |
//! | `nothing_free` | models without free parameters are judged |
//! | `split_all` | where all measurements calibrate, nothing is said to have been held out |
//! | `sensitivity` | Table III of the paper |
//! | `slow` | statistics over many machines (`--features slow`) |

mod agreement;
mod assembly;
mod calibration;
mod evaluate;
mod gauge;
mod knowledge;
mod nothing_free;
mod pulls;
mod redundant;
mod repeats;
mod sensitivity;
#[cfg(feature = "slow")]
mod slow;
mod split_all;
mod truth;
mod uncertainty;
mod unknown_poses;
