//! A mistake of the input, with its mend.

use std::fmt;

use crate::trust::status::Status;

/// Something wrong with the input.
#[derive(Debug, Clone, PartialEq)]
pub struct Mistake {
    /// Its kind.
    pub kind: MistakeKind,
    /// The file that holds it.
    pub file: &'static str,
    /// The mistake in words.
    pub what: String,
    /// The mend in words.
    pub mend: String,
    /// True if nothing that is computed from such input means anything.
    pub is_absurd: bool,
}

/// The mistake, then the mend.
impl fmt::Display for Mistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}; {}", self.file, self.what, self.mend)
    }
}

impl Mistake {
    /// The best status of a verdict that holds it.
    pub(super) fn status(&self) -> Status {
        if self.is_absurd {
            Status::Absurd
        } else {
            Status::Inconsistent
        }
    }

    /// True if measurements are wrong, and not noise, tolerances, dimensions or zeros: an effect that the model lacks looks
    /// like these.
    pub(crate) fn is_of_measurements(&self) -> bool {
        !matches!(
            self.kind,
            MistakeKind::Noise
                | MistakeKind::Tolerances
                | MistakeKind::Dimension
                | MistakeKind::CommandZero
        )
    }
}

/// The kind of a mistake.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MistakeKind {
    /// Columns of commands are exchanged.
    Commands,
    /// A command counts the other way.
    CommandSign,
    /// A command counts from another zero.
    CommandZero,
    /// Measured rows are shifted against those of the commands.
    Rows,
    /// Heights count the other way.
    HeightSign,
    /// Axes of positions are exchanged or mirrored.
    Axes,
    /// Angles follow another convention.
    Angles,
    /// Poses are those of another frame than the drawing's.
    Frame,
    /// Lengths that were measured are in millimetres.
    Millimetres,
    /// Lengths that were measured are in centimetres.
    Centimetres,
    /// Lengths that were measured are in inches.
    Inches,
    /// Angles are in degrees.
    Degrees,
    /// Stated noise is a thousand times off.
    Noise,
    /// Tolerances are a thousand times off.
    Tolerances,
    /// A dimension is far off.
    Dimension,
    /// Carts are numbered otherwise.
    Carts,
    /// Distances are exchanged.
    Distances,
}

impl MistakeKind {
    /// Its name, as JSON has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Commands => "commands",
            Self::CommandSign => "command_sign",
            Self::CommandZero => "command_zero",
            Self::Rows => "rows",
            Self::HeightSign => "height_sign",
            Self::Axes => "axes",
            Self::Angles => "angles",
            Self::Frame => "frame",
            Self::Millimetres => "millimetres",
            Self::Centimetres => "centimetres",
            Self::Inches => "inches",
            Self::Degrees => "degrees",
            Self::Noise => "noise",
            Self::Tolerances => "tolerances",
            Self::Dimension => "dimension",
            Self::Carts => "carts",
            Self::Distances => "distances",
        }
    }
}
