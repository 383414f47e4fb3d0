//! A mistake of the input, with its mend.

use std::fmt;

use tau_codes::{Code, mistakes as codes};

use crate::trust::status::Status;

/// Something wrong with the input.
#[derive(Debug, Clone, PartialEq)]
pub struct Mistake {
    /// Its kind.
    pub kind: MistakeKind,
    /// The file that holds it.
    pub file: &'static str,
    /// The lines that it is in, where it is in a few.
    pub lines: Vec<usize>,
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
    /// Rows name other poses than they measured.
    PoseNumbers,
    /// Heights count the other way.
    HeightSign,
    /// Axes of positions are exchanged.
    Axes,
    /// An axis of positions is mirrored.
    Mirrored,
    /// Angles follow another convention.
    Angles,
    /// An angle counts the other way.
    AngleSign,
    /// Poses are those of another frame than the drawing's.
    Frame,
    /// Lengths that were measured are in millimetres.
    Millimetres,
    /// Lengths that were measured are in centimetres.
    Centimetres,
    /// Lengths that were measured are in inches.
    Inches,
    /// Lengths that were measured are in inches that were taken for millimetres.
    InchesForMillimetres,
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
    /// Its code.
    pub fn code(self) -> Code {
        match self {
            Self::Commands => codes::COMMANDS,
            Self::CommandSign => codes::COMMAND_SIGN,
            Self::CommandZero => codes::COMMAND_ZERO,
            Self::Rows => codes::ROWS,
            Self::PoseNumbers => codes::POSE_NUMBERS,
            Self::HeightSign => codes::HEIGHT_SIGN,
            Self::Axes => codes::AXES,
            Self::Mirrored => codes::MIRRORED,
            Self::Angles => codes::ANGLES,
            Self::AngleSign => codes::ANGLE_SIGN,
            Self::Frame => codes::FRAME,
            Self::Millimetres => codes::MILLIMETRES,
            Self::Centimetres => codes::CENTIMETRES,
            Self::Inches => codes::INCHES,
            Self::InchesForMillimetres => codes::INCHES_FOR_MILLIMETRES,
            Self::Degrees => codes::DEGREES,
            Self::Noise => codes::NOISE,
            Self::Tolerances => codes::TOLERANCES,
            Self::Dimension => codes::DIMENSION,
            Self::Carts => codes::CARTS,
            Self::Distances => codes::DISTANCES,
        }
    }

    /// Its name, as JSON has it; mistakes of one name may have codes of their own, where their fixes differ.
    pub fn name(self) -> &'static str {
        match self {
            Self::Commands => "commands",
            Self::CommandSign => "command_sign",
            Self::CommandZero => "command_zero",
            Self::Rows | Self::PoseNumbers => "rows",
            Self::HeightSign => "height_sign",
            Self::Axes | Self::Mirrored => "axes",
            Self::Angles | Self::AngleSign => "angles",
            Self::Frame => "frame",
            Self::Millimetres => "millimetres",
            Self::Centimetres => "centimetres",
            Self::Inches | Self::InchesForMillimetres => "inches",
            Self::Degrees => "degrees",
            Self::Noise => "noise",
            Self::Tolerances => "tolerances",
            Self::Dimension => "dimension",
            Self::Carts => "carts",
            Self::Distances => "distances",
        }
    }
}
