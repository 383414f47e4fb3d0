//! Results of a study, as plain data: the report, the terminal tables and the JSON are written from this.

use tau_codes::Remark;
use tau_discovery::Discovery;
use tau_estimation::assumptions::Assumptions;
use tau_estimation::calibration::{Combination, LinkResult, ParameterEstimate};
use tau_estimation::check::Check;
use tau_estimation::evaluation::{Evaluation, Summary};
use tau_estimation::sensitivity::Sensitivity;
use tau_estimation::trust::{Status, Verdict};
use tau_estimation::unknown_poses::{HeldErrors, RowDivision};
use tau_estimation::weighing::Outlier;
use tau_kinematics::Layout;
use tau_robot::measurements::PoseCounts;
use tau_robot::robot::{Architecture, Arm};

/// One calibrated variant, and how it meets what validates.
#[derive(Debug, Clone)]
pub struct VariantResult {
    /// Name.
    pub name: String,
    /// One closure per link, or one per cluster.
    pub arm: Arm,
    /// Errors of the measured poses that validate; none where poses were not measured.
    pub evaluation: Evaluation,
    /// One row per link (full arm) or cluster (reduced arm).
    pub links: Vec<LinkResult>,
    /// Every parameter with its standard deviation.
    pub parameters: Vec<ParameterEstimate>,
    /// Pairs with the largest correlations.
    pub correlations: Vec<(String, String, f64)>,
    /// Combinations of which the tolerances say more than the data, worst first.
    pub undetermined: Vec<Combination>,
    /// Iterations of the solver, summed over independent parts.
    pub iterations: usize,
    /// Why the solver stopped, in words.
    pub termination: String,
    /// Verdict on the fit, where that was asked.
    pub fit: Option<Verdict>,
    /// Outliers among the validation poses, where that was asked.
    pub validation_outliers: Vec<Outlier>,
    /// Errors of all measurements that validate, where true poses are unknown.
    pub held: Option<HeldErrors>,
}

impl VariantResult {
    /// Position error (µm), or, where poses were not measured, that of lengths which were held out; not numbers where there
    /// is neither.
    pub fn error_um(&self) -> Summary {
        if !self.evaluation.errors.is_empty() {
            return self.evaluation.position_um;
        }
        let errors = self.held.iter().flat_map(|held| &held.errors);
        let judged = errors.filter(|own| own.expected.is_some());
        let lengths_m = judged.filter_map(|own| own.error_m);
        let errors_um: Vec<f64> = lengths_m.map(|error_m| 1e6 * error_m.abs()).collect();
        if errors_um.is_empty() {
            return Summary {
                mean: f64::NAN,
                max: f64::NAN,
                rms: f64::NAN,
            };
        }
        Summary::of(&errors_um)
    }

    /// Factor on its standard deviations: above one where residuals are beyond the stated noise.
    pub fn widening(&self) -> f64 {
        self.fit.as_ref().map_or(1.0, Verdict::widening)
    }
}

/// The machine and the measurements of a result, by which the reader judges it.
#[derive(Debug, Clone)]
pub struct Setting {
    /// Name of the robot.
    pub robot: String,
    /// Its drives.
    pub architecture: Architecture,
    /// Source of the measurements, as the user named it.
    pub folder: String,
    /// Numbers of poses in each part.
    pub poses: PoseCounts,
    /// Rows that calibrate and that validate, where poses were not measured.
    pub rows: Option<RowDivision>,
    /// True if there is a set 2, whose range decides on the poses.
    pub has_cart_poses: bool,
    /// Stated noise: position (m) and rotation (rad), one standard deviation per axis.
    pub noise: (f64, f64),
    /// Positions of all poses (m), as they were measured, or else estimated.
    pub positions_m: Vec<[f64; 3]>,
    /// The machine in space, as a calibrated variant has it at the reference pose that its calibration found.
    pub layout: Option<Layout>,
}

impl Setting {
    /// True if what validates took no part in calibration.
    pub fn is_held_out(&self) -> bool {
        let of_poses = self.poses.validation > 0;
        self.rows
            .as_ref()
            .map_or(of_poses, RowDivision::is_disjoint)
    }
}

/// Everything `tau study` reports.
#[derive(Debug, Clone)]
pub struct Study {
    /// The machine and the measurements; the layout is of the variant of [`Study::fit`].
    pub setting: Setting,
    /// One result per variant, in the order calibrated.
    pub variants: Vec<VariantResult>,
    /// Checks of what the models assume (section III-C of the paper).
    pub assumptions: Assumptions,
    /// Contents of the measurements, before anything is fitted.
    pub check: Option<Check>,
    /// Sensitivities, where a variant with a full arm and parameters of its links was calibrated.
    pub sensitivity: Option<Sensitivity>,
    /// The effects that the base of discovery lacks, where the search succeeded.
    pub discovery: Option<Discovery>,
    /// Remarks for the reader: poses dropped, columns missing, and so on.
    pub remarks: Vec<Remark>,
}

impl Study {
    /// The verdict on the variant whose residuals come nearest to the noise, or, where poses were not measured, which has the
    /// smallest errors of what was held out; where some are consistent, of these. Mistakes of the input are on every variant;
    /// what one alone misses, such as a value that it holds, is the variant's own.
    pub fn fit(&self) -> Option<(&VariantResult, &Verdict)> {
        let judged = self.variants.iter();
        let judged = judged.filter_map(|variant| Some((variant, variant.fit.as_ref()?)));
        let key = |(variant, verdict): &(&VariantResult, &Verdict)| {
            if self.setting.rows.is_some() {
                variant.error_um().mean
            } else {
                verdict.residual_over_noise
            }
        };
        let is_missed = |own: &(&VariantResult, &Verdict)| own.1.status != Status::Consistent;
        judged.min_by(|a, b| {
            let by_status = is_missed(a).cmp(&is_missed(b));
            by_status.then(key(a).total_cmp(&key(b)))
        })
    }
}
