//! What a study finds, as plain data: the report, the terminal tables and the JSON are written from this.

use crate::discovery::Discovery;
use crate::measurements::PoseCounts;

/// Everything `tau study` reports.
#[derive(Debug, Clone)]
pub struct Study {
    /// Name of the robot.
    pub robot: String,
    /// Where the measurements came from, as the user named it.
    pub folder: String,
    /// How many poses took which part.
    pub poses: PoseCounts,
    /// Stated noise: position (m) and rotation (rad), one standard deviation per axis.
    pub noise: (f64, f64),
    /// One result per variant, in the order calibrated.
    pub variants: Vec<VariantResult>,
    /// Checks of what the models assume (section III-C of the paper).
    pub assumptions: Assumptions,
    /// Table III, where a variant with a full arm was calibrated.
    pub sensitivity: Option<Sensitivity>,
    /// What the variant that discovery starts from lacks, where the search succeeded.
    pub discovery: Option<Discovery>,
    /// Remarks for the reader: poses dropped, columns missing, and so on.
    pub remarks: Vec<String>,
}

/// Mean, largest and root-mean-square of a length, in µm.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    /// Mean.
    pub mean: f64,
    /// Largest.
    pub max: f64,
    /// Root mean square.
    pub rms: f64,
}

/// One calibrated variant.
#[derive(Debug, Clone)]
pub struct VariantResult {
    /// Name.
    pub name: String,
    /// Position error on the validation poses (Table I).
    pub position_um: Summary,
    /// Largest magnitude of each orientation error (rad), where the model predicts orientation.
    pub orientation_rad_max_abs: Option<[f64; 3]>,
    /// Error at each validation pose.
    pub pose_errors: Vec<PoseError>,
    /// One row per link (full arm) or cluster (reduced arm): Table II.
    pub links: Vec<LinkResult>,
    /// Every parameter with its standard deviation.
    pub parameters: Vec<ParameterEstimate>,
    /// Pairs with the largest correlations.
    pub correlations: Vec<(String, String, f64)>,
    /// Combinations that the data do not determine: only the prior does.
    pub undetermined: Vec<Combination>,
    /// Iterations of the solver, summed over independent parts.
    pub iterations: usize,
    /// Why the solver stopped, in words.
    pub termination: String,
}

/// Predicted minus measured, at one validation pose.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseError {
    /// Pose number in the file.
    pub pose: u32,
    /// Measured TCP position (m).
    pub position_m: [f64; 3],
    /// Position error (µm).
    pub error_um: [f64; 3],
    /// Orientation error as alpha, beta, gamma (rad), where the model predicts orientation.
    pub orientation_rad: Option<[f64; 3]>,
}

impl PoseError {
    /// Length of the position error (µm).
    pub fn length_um(&self) -> f64 {
        self.error_um.iter().map(|e| e * e).sum::<f64>().sqrt()
    }
}

/// A row of Table II.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkResult {
    /// Name of the link, or of the cluster where the arm is reduced.
    pub name: String,
    /// Length (m).
    pub length_m: f64,
    /// Plate joint in TCP coordinates (m); `None` where the arm is reduced.
    pub plate_joint_m: Option<[f64; 3]>,
    /// Cart-side joint at q = 0 (m).
    pub track_offset_m: [f64; 3],
    /// Direction, for a linear track.
    pub track_direction: Option<[f64; 3]>,
    /// Rotation angles about x, y, z (rad), for a piecewise track.
    pub track_rotation_rad: Option<[f64; 3]>,
    /// Sum over calibration poses of the squared closure residual (m⁴).
    pub cost_m4: f64,
}

/// A calibrated parameter.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterEstimate {
    /// Full name.
    pub name: String,
    /// SI unit.
    pub unit: String,
    /// Value before calibration.
    pub nominal: f64,
    /// One standard deviation of its prior, if it has one.
    pub tolerance: Option<f64>,
    /// Calibrated value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// A combination of parameters that the data do not determine.
#[derive(Debug, Clone, PartialEq)]
pub struct Combination {
    /// Parameter names with their shares, largest first; shares are in units of the tolerances.
    pub terms: Vec<(String, f64)>,
    /// Standard deviation of the combination from the data alone, relative to its prior; infinite
    /// where the data say nothing.
    pub data_over_prior: f64,
}

/// Checks of what the models assume.
#[derive(Debug, Clone, Default)]
pub struct Assumptions {
    /// Orientation over the grid, as deviation from the mean (Figure 4).
    pub orientation: Vec<OrientationPoint>,
    /// Deviation of each cart from a straight line (Figures 5 and 6); empty without set 2.
    pub linearity: Vec<TrackLinearity>,
    /// Set 3 against the paths of set 2; empty without both.
    pub sets: Vec<TrackComparison>,
}

/// Orientation of one pose against the mean orientation.
#[derive(Debug, Clone, PartialEq)]
pub struct OrientationPoint {
    /// Pose number.
    pub pose: u32,
    /// Measured TCP position (m).
    pub position_m: [f64; 3],
    /// Deviation of alpha, beta, gamma from their means (rad).
    pub deviation_rad: [f64; 3],
}

/// Deviation of a cart's path from a straight line with even scale.
#[derive(Debug, Clone)]
pub struct TrackLinearity {
    /// Name of the track.
    pub track: String,
    /// One entry per point of set 2.
    pub points: Vec<PathDeviation>,
}

/// Deviation of a cart at a command, split parallel and orthogonal to the track.
#[derive(Debug, Clone, PartialEq)]
pub struct PathDeviation {
    /// Command (m).
    pub q_m: f64,
    /// Along the track (µm).
    pub parallel_um: f64,
    /// Horizontal, orthogonal to the track (µm).
    pub horizontal_um: f64,
    /// The third direction (µm).
    pub vertical_um: f64,
}

/// Set 3 against the path of set 2, for one track.
#[derive(Debug, Clone)]
pub struct TrackComparison {
    /// Name of the track.
    pub track: String,
    /// One entry per pose of set 3 inside the range.
    pub points: Vec<PathDeviation>,
    /// Root mean square of each direction (µm): parallel, horizontal, vertical.
    pub rms_um: [f64; 3],
}

/// Table III: effect of a step in each parameter of each link, summed over the validation poses.
#[derive(Debug, Clone)]
pub struct Sensitivity {
    /// Variant it was computed for.
    pub variant: String,
    /// Number of poses summed over.
    pub poses: usize,
    /// Step, in SI units of each parameter.
    pub step: f64,
    /// One entry per link.
    pub links: Vec<LinkSensitivity>,
    /// Largest relative difference between steps and implicit differentiation, over all entries.
    pub disagreement: f64,
}

/// Table III for one link.
#[derive(Debug, Clone)]
pub struct LinkSensitivity {
    /// Name of the link.
    pub link: String,
    /// One entry per parameter, in the order `L, Px, Py, Pz, Offset_x, …, Orient_3`.
    pub parameters: Vec<ParameterSensitivity>,
}

/// Table III for one parameter of one link.
#[derive(Debug, Clone)]
pub struct ParameterSensitivity {
    /// `L`, `Px`, …, `Orient_3`.
    pub parameter: String,
    /// Sum of ‖ΔT⁺‖ + ‖ΔT⁻‖ (mm), by steps.
    pub position_mm: f64,
    /// The same by implicit differentiation.
    pub position_mm_analytic: f64,
    /// Sum of |Δα| + |Δβ| + |Δγ| over both steps (rad), by steps.
    pub orientation_rad: f64,
    /// The same by implicit differentiation.
    pub orientation_rad_analytic: f64,
    /// Change of the paper's cost on the validation poses (m⁴), magnitudes summed over both steps.
    pub cost_m4: f64,
    /// Position change at each validation pose for the positive step (µm): Figures 9 and 10.
    pub by_pose_um: Vec<f64>,
    /// Orientation change |Δα| + |Δβ| + |Δγ| at each validation pose for the positive step (rad).
    pub by_pose_rad: Vec<f64>,
}
