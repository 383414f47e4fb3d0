//! Inputs and results of a calibration, crate by crate. Items that the crates below export only for others of
//! this workspace are left out.

pub use nalgebra;
pub use tau_codes as codes;
pub use tau_estimation::{Setup, assumptions, evaluation, expected, sensitivity, uncertainty};
pub use tau_robot::{InputError, Robot, prototype, robot};

pub use calibration::Error;

/// From nominal values and measured TCP poses to the parameters of a variant.
pub mod calibration {
    pub use tau_estimation::all_sets::calibrate;
    pub use tau_estimation::calibration::{
        Calibration, Carts, Combination, Error, Line, LinkResult, LinkSigma, Nominal, NominalTrack,
        Options, ParameterEstimate, Prepared, Registration, Serial, Source, Stated,
        machine_from_file,
    };
    pub use tau_estimation::joint::Component;
    pub use tau_estimation::joint::predicted::GroupFit;
}

/// The search for effects that a model lacks.
#[cfg(feature = "discovery")]
pub mod discovery {
    pub use tau_discovery::{
        Constants, DISCOVERED, Discovery, Error, OfUnknownPoses, Options, Outcome, PValue, Rule,
        Status, discover, results,
    };
}

/// The catalogue of effects that ships.
pub mod effects {
    pub use tau_robot::effects::CATALOGUE;
}

/// Mistakes of the input, each at its place.
pub mod input_error {
    pub use tau_robot::input_error::{InputError, Place, Problem, Source};
}

/// Forward and inverse kinematics and statics of any variant.
pub mod kinematics {
    pub use tau_kinematics::{
        ByPull, Closures, Error, Forces, InverseOptions, LARGEST_MISMATCH_M, Layout, LengthNoise,
        Machine, Missing, POSE_COLUMNS, Path, Pose, Rail, Reached, Rod, Sample, Segment, Statics,
        Surroundings, UnknownPull, track_axes, xyz, xyz_angles, zyz,
    };
}

/// Descriptions as the compiler of the language reads them, and the mistakes that it finds.
pub mod language {
    pub use tau_model_dsl::{Diagnostic, Errors, Model};
}

/// Measurement folders: TCP poses (set 1), cart poses (set 2), cart positions (set 3).
pub mod measurements {
    pub use tau_robot::measurements::{
        Actuator, CartPose, CartPosition, Conditions, Distance, Division, Folder, ObjectKind,
        PlateKind, PlateRow, PoseCounts, PoseSigmas, Poses, Shape, Split, TcpPose, Texts,
    };
}

/// The instance of a robot: nominal or calibrated parameters with tolerances, noise and loads (`robot.toml`).
pub mod robot_file {
    pub use tau_robot::robot_file::{
        Covariance, LinkValues, MeasuredPath, Measuring, Noise, Origin, Payload, Provenance,
        Reference, RobotFile, StatedNoise, Surface, Value,
    };
}

/// Trust in answers: verdicts, recognised mistakes, and checks before a fit.
pub mod trust {
    pub use tau_estimation::check::{Check, Checked, FileFacts, Range};
    pub use tau_estimation::trust::{
        Estimate, Fact, FileFit, Gap, HeldBy, Mistake, MistakeKind, Need, Observability, PoseFit,
        Pull, Reach, Reason, Repeated, Size, Status, Verdict,
    };
}

/// Calibration from any measurements: the true pose behind every sample is unknown.
pub mod unknown_poses {
    pub use tau_estimation::unknown_poses::{
        Freedom, GrossPose, GrossRow, HeldErrors, HeldOut, HeldOutFit, HeldOutKind, JudgedRows,
        Kind, KindErrors, KindFit, KindRepeats, Measurand, Moved, Object, ObjectEstimate,
        PlaceEstimate, Rank, RowDivision, RowError, RowPlace, UnknownPoses, calibrate, evaluate,
        mistakes,
    };
}

/// Weights of poses in a calibration: outliers, losses that bound their pull, repeated readings.
pub mod weighing {
    pub use tau_estimation::weighing::{
        Kept, LackOfFit, Loss, Misread, Outlier, Repeats, Treatment, Weighing,
    };
}
