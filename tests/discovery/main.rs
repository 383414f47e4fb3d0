//! Discovery of effects that a model lacks.
//!
//! | file | what it holds |
//! | --- | --- |
//! | `trials.rs` | folders that ship: what was hidden in them has its name, nothing else has |
//! | `evidence.rs` | what residuals show of it: spectra, patterns, look-alikes, serial noise |
//! | `bases.rs` | searches from other variants: full arms that are missing, tracks that follow their points |
//! | `folders.rs` | folders that lack something or state it wrongly; effects of one's own |
//! | `kinds.rs` | machines of every kind at random: one each, and many in the slow tier |
//! | `robots.rs` | other robots than the Gantry-Tau, with and without measured poses |
//! | `drives.rs` | belts and drums: drives that measure each other |
//! | `tracker.rs` | errors of the tracker |
//! | `command.rs` | `tau discover`: what it writes, prints and refuses |
//! | `slow/` | statistics over many machines, searches that take long, and what is written, compiled |
//! | `search.rs` | what these share |

mod bases;
mod command;
mod drives;
mod evidence;
mod folders;
mod kinds;
mod robots;
mod search;
#[cfg(feature = "slow")]
mod slow;
mod tracker;
mod trials;
