//! What the program `tau` and a session answer, print and write.
//!
//! | file | promise |
//! | --- | --- |
//! | `commands.rs` | what each command computes and writes |
//! | `study.rs` | what a study holds, and its checks of what models assume |
//! | `kinematics.rs` | poses and commands by `tau kinematics` |
//! | `start.rs` | first steps with a robot of one's own: descriptions, `tau init`, sketches |
//! | `output.rs` | streams, help, completions |
//! | `bad_input.rs` | mistakes are refused with code and place, and nothing is written |
//! | `session.rs` | a session of the library answers as the commands do |
//! | `agreement.rs` | commands agree with each other |
//! | `slow/browser.rs` | the report can be read on screens and on paper |

mod agreement;
mod bad_input;
mod commands;
mod kinematics;
mod output;
mod session;
#[cfg(feature = "slow")]
mod slow;
mod start;
mod study;

/// A plate in a plane on three pistons.
const PISTONS: &str = "robot Pistons {
    plate body in plane;
    cluster legs on base {
        link a actuated length { length = 0.5 m tol 0.5 mm; track_offset = (0, 0, 0) m tol 1 mm; plate_joint = (-0.1, -0.06, 0) m tol 0.3 mm; }
        link b actuated length { length = 0.5 m tol 0.5 mm; track_offset = (1, 0, 0) m tol 1 mm; plate_joint = (0.1, -0.06, 0) m tol 0.3 mm; }
        link c actuated length { length = 0.5 m tol 0.5 mm; track_offset = (0.6, 0.9, 0) m tol 1 mm; plate_joint = (0, 0.12, 0) m tol 0.3 mm; }
    }
    reference { commands = (0, 0, 0) m; position = (0.503, 0.3237, 0) m; orientation = (0.5474, 0, 0) rad; }
    variant Full { arm full; }
}
";
