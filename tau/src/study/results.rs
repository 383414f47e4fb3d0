//! Results of a study, as plain data: the report, the terminal tables and the JSON are written from this.

use tau_codes::Remark;
use tau_discovery::Discovery;
use tau_estimation::assumptions::Assumptions;
use tau_estimation::check::Check;
use tau_estimation::evaluation::VariantResult;
use tau_estimation::sensitivity::Sensitivity;
use tau_estimation::trust::{Status, Verdict};
use tau_estimation::unknown_poses::RowDivision;
use tau_kinematics::Layout;
use tau_robot::measurements::PoseCounts;
use tau_robot::robot::Architecture;

/// Everything `tau study` reports.
#[derive(Debug, Clone)]
pub struct Study {
    /// Name of the robot.
    pub robot: String,
    /// Its drives.
    pub architecture: Architecture,
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
    /// Contents of the measurements, before anything is fitted.
    pub check: Option<Check>,
    /// Table III, where a variant with a full arm and parameters of its links was calibrated.
    pub sensitivity: Option<Sensitivity>,
    /// The effects that the base of discovery lacks, where the search succeeded.
    pub discovery: Option<Discovery>,
    /// The machine in space, as the variant of [`Study::fit`] has it at the reference pose that its calibration found.
    pub layout: Option<Layout>,
    /// Rows that calibrate and that validate, where poses were not measured.
    pub rows: Option<RowDivision>,
    /// Positions of poses as they were estimated, where they were not measured (m).
    pub placed_m: Vec<[f64; 3]>,
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
            if self.rows.is_some() {
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
