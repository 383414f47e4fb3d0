//! The parts of a robot, checked.

use proc_macro2::Ident;

use super::declared::Declared;
use crate::diagnostics::Diagnostic;
use crate::model::{Cluster, Drive, Link, Plate, RobotParameter, Track};
use crate::names::suggest;

/// The parts of a robot, with the names of all.
pub(super) struct Geometry {
    pub(super) plate: Plate,
    pub(super) parameters: Vec<RobotParameter>,
    /// Drive of each command; `None` after an error in what is driven.
    pub(super) drives: Option<Vec<Drive>>,
    pub(super) tracks: Vec<Track>,
    pub(super) clusters: Vec<Cluster>,
    pub(super) links: Vec<Link>,
    pub(super) names: Declared,
}

/// Error of a name that is no track's.
pub(super) fn unknown_track(name: &Ident, tracks: &[Track]) -> Diagnostic {
    let names = tracks.iter().map(|track| track.name.as_str());
    diagnostic!(UNKNOWN_TRACK, name; "cannot find track `{name}`"; "{}", suggest("track", &name.to_string(), names))
}
