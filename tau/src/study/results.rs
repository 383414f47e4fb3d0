//! Results of a study, as plain data: the report, the terminal tables and the JSON are written from this.

use tau_discovery::Discovery;
use tau_estimation::assumptions::Assumptions;
use tau_estimation::evaluation::VariantResult;
use tau_estimation::sensitivity::Sensitivity;
use tau_robot::measurements::PoseCounts;

/// Everything `tau study` reports.
#[derive(Debug, Clone)]
pub struct Study {
    /// Name of the robot.
    pub robot: String,
    /// Source of the measurements, as the user named it.
    pub folder: String,
    /// Numbers of poses in each part.
    pub poses: PoseCounts,
    /// Stated noise: position (m) and rotation (rad), one standard deviation per axis.
    pub noise: (f64, f64),
    /// One result per variant, in the order calibrated.
    pub variants: Vec<VariantResult>,
    /// Checks of what the models assume (section III-C of the paper).
    pub assumptions: Assumptions,
    /// Table III, where a variant with a full arm was calibrated.
    pub sensitivity: Option<Sensitivity>,
    /// The effects that the base of discovery lacks, where the search succeeded.
    pub discovery: Option<Discovery>,
    /// Remarks for the reader: poses dropped, columns missing, and so on.
    pub remarks: Vec<String>,
}
