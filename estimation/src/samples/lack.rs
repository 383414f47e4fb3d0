//! What measurements or a machine lack for an effect.

use std::fmt;

use tau_codes::{Code, discovery as codes};
use tau_kinematics::Missing;

/// Why an effect cannot be computed from measurements.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lack {
    /// Its code.
    pub code: Code,
    /// The missing quantity or part, in words.
    pub words: &'static str,
}

impl Lack {
    /// An effect whose derivative is not finite.
    pub const NOT_FINITE: Self = Self {
        code: codes::NOT_FINITE,
        words: "its derivative at no effect is not finite",
    };
}

impl fmt::Display for Lack {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.words)
    }
}

/// That something is missing, whichever set it is missing in.
impl From<&Missing> for Lack {
    fn from(missing: &Missing) -> Self {
        let (code, words) = match missing {
            Missing::Held => (
                codes::LACKS_VALUE,
                "the value of a parameter that the variant holds is missing",
            ),
            Missing::Travel => (
                codes::LACKS_VALUE,
                "the travel of the drives is missing (`travel` of `[drives]` in the robot file)",
            ),
            Missing::Command => (codes::LACKS_COLUMN, "a command is missing"),
            Missing::Direction(_) => (
                codes::LACKS_COLUMN,
                "the column of the side of approach (`dir`) is missing",
            ),
            Missing::Time => (codes::LACKS_COLUMN, "the column `time_s` is missing"),
            Missing::Temperature => (codes::LACKS_COLUMN, "the column `temperature_c` is missing"),
            Missing::Forces => (
                codes::LACKS_VALUE,
                "neither measured (`force1_N`, …) nor computable: `[payload]` or dimensions of the links are missing in the robot file",
            ),
            Missing::Pull(_) => (
                codes::LACKS_VALUE,
                "neither measured (`force1_N`, …) nor computable: a link is `pulled` by an unknown tension, which `pulled = … N` states",
            ),
            Missing::Path => (codes::LACKS_FILE, "set 2 (`cart_poses.csv`) is missing"),
        };
        Self { code, words }
    }
}
