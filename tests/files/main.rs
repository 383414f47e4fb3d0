//! Files: what is read, refused and written.
//!
//! | file | promise |
//! | --- | --- |
//! | `bad_input` | each mistake of a table or a robot file is told with code, line and remedy |
//! | `mutations` | no broken input panics or leaves something half-written |
//! | `mends` | a machine's description that means nothing is refused with what would mend it |
//! | `own_machines` | machines that users describe: what does not fit the plate, the links or the drives is said |
//! | `robot_files` | robot files that stand alone: what they were calibrated on, piecewise tracks, the tracker's effects |
//! | `requests` | arguments of `tau simulate` |
//! | `cranks` | turns that encoders count, and the unit of their commands |
//! | `klipper` | delta printers: their firmware's files read, calibrated and written back |
//! | `hangprinter` | three runs of a real machine of four lines |

mod answers;
mod bad_input;
mod cranks;
mod hangprinter;
mod klipper;
mod mends;
mod mutations;
mod own_machines;
mod requests;
mod robot_files;
#[cfg(feature = "slow")]
mod slow;

/// Heights of a printer of three carriages, by the arguments of a simulation.
const HEIGHTS: &str =
    "--model linear_delta --measure heights --noise-position 1e-5 --random --poses 40 --seed 1";
