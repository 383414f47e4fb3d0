//! The figures, as SVG documents.
//!
//! Each function returns `None` where the study has no such data.

mod assumptions;
mod axis;
mod bars;
mod cells;
mod chart;
mod discovery;
mod errors;
mod evidence;
mod palette;
mod sensitivity;

use tau::study::results::Study;

pub use assumptions::{linearity_orthogonal, linearity_parallel, orientation_grid, set_comparison};
pub(super) use axis::typographic;
pub use discovery::{discovery, gap_by_step, unnamed_structure};
pub use errors::{error_by_pose, error_by_variant, orientation_errors};
pub use evidence::evidence;
pub(super) use palette::dark_style;
pub use sensitivity::{orientation_sensitivity, position_sensitivity};

/// A drawing with what the reader needs to understand it.
#[derive(Debug, Clone)]
pub struct Figure {
    /// Name of the file it is written to.
    pub file_name: String,
    /// Title, in a few words.
    pub title: String,
    /// Origin and reading of the figure, in sentences.
    pub caption: String,
    /// The SVG document.
    pub svg: String,
}

/// All figures that the study has data for, in the order of the report.
pub fn all(study: &Study) -> Vec<Figure> {
    [
        error_by_variant(study),
        error_by_pose(study),
        orientation_errors(study),
        orientation_grid(study),
        linearity_parallel(study),
        linearity_orthogonal(study),
        set_comparison(study),
        position_sensitivity(study),
        orientation_sensitivity(study),
    ]
    .into_iter()
    .flatten()
    .chain(study.discovery.iter().flat_map(discovery))
    .collect()
}

/// Factor and name of the unit in which angles of this size (rad) read best.
fn angle_unit(largest_rad: f64) -> (f64, &'static str) {
    if largest_rad < 1e-3 {
        (1e6, "µrad")
    } else {
        (1e3, "mrad")
    }
}

/// Factor and name of the unit in which lengths of this size (µm) read best.
fn length_unit(largest_um: f64) -> (f64, &'static str) {
    if largest_um < 1e4 {
        (1.0, "µm")
    } else {
        (1e-3, "mm")
    }
}
