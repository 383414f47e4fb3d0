//! The machine, drawn from its calibrated geometry: what stands where, what was found where it acts, and how far
//! predictions are off.
//!
//! [`scene`] says what is drawn in space, [`view`] puts it on paper, [`draw`] writes the SVG. `turn.js` repeats the
//! projection in the reader's browser.

mod draw;
mod labels;
mod scene;
#[cfg(test)]
mod tests;
mod view;

use tau::discovery::results::Place;

pub(crate) use draw::{Drawing, draw};
pub(crate) use scene::{Errors, Scene};

/// A script that turns the drawing with mouse, finger or keys. Without it the drawing stands as it is.
pub(crate) const SCRIPT: &str = include_str!("turn.js");

/// A place that carries a number: that of an entry of the list beside the drawing.
#[derive(Debug, Clone)]
pub(crate) struct Pin {
    pub(crate) number: usize,
    pub(crate) place: Place,
}
