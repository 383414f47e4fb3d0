//! Errors of what drives alone foretell.

use super::elimination::Reduced;
use super::rows::{CLOSURES, Kind, Rows};
use serde::Serialize;

/// Errors of a kind of measurement on rows held out.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct HeldOutKind {
    /// Name of the file.
    pub file: &'static str,
    /// Number of residuals.
    pub rows: usize,
    /// Root mean square of measured less predicted (m or rad).
    #[serde(rename = "rms_m")]
    pub rms: f64,
    /// Largest.
    #[serde(rename = "max_m")]
    pub max: f64,
}

/// Errors of each kind of lengths that were measured, from residuals where poses follow from the drives alone.
pub(super) fn predicted(blocks: &[Rows], kinds: &[Kind], reduced: &Reduced) -> Vec<HeldOutKind> {
    let mut predicted: Vec<HeldOutKind> = vec![];
    for (rows, residuals) in blocks.iter().zip(&reduced.residuals).skip(CLOSURES + 1) {
        for (k, (residual, weight)) in residuals.iter().zip(&rows.weights).enumerate() {
            let kind = &kinds[rows.kinds[k % rows.kinds.len()]];
            if *weight == 0.0 || kind.of.is_angle() {
                continue;
            }
            let error = (residual * kind.sigma / weight).abs();
            let file = kind.of.file();
            let known = predicted.iter().position(|known| known.file == file);
            let place = known.unwrap_or_else(|| {
                predicted.push(HeldOutKind {
                    file,
                    rows: 0,
                    rms: 0.0,
                    max: 0.0,
                });
                predicted.len() - 1
            });
            let own = &mut predicted[place];
            own.rows += 1;
            own.rms += error * error;
            own.max = own.max.max(error);
        }
    }
    for kind in &mut predicted {
        kind.rms = (kind.rms / kind.rows as f64).sqrt();
    }
    predicted
}
