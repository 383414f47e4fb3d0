//! What the program `tau` and a session answer, print and write.
//!
//! | file | promise |
//! | --- | --- |
//! | `commands.rs` | what each command computes and writes |
//! | `study.rs` | what a study holds, and its checks of what models assume |
//! | `kinematics.rs` | poses and commands by `tau kinematics` |
//! | `start.rs` | first steps with a robot of one's own: descriptions, `tau init`, sketches |
//! | `output.rs` | streams, help, completions |
//! | `messages.rs` | words of messages that no other test shows |
//! | `bad_input.rs` | mistakes are refused with code and place, and nothing is written |
//! | `session.rs` | a session of the library answers as the commands do |
//! | `agreement.rs` | commands agree with each other |
//! | `slow/browser.rs` | the report can be read on screens and on paper |

mod agreement;
mod bad_input;
mod commands;
mod kinematics;
mod messages;
mod output;
mod session;
#[cfg(feature = "slow")]
mod slow;
mod start;
mod study;

/// A plate in a plane on three pistons.
const PISTONS: &str = include_str!("robots/pistons.tau");
