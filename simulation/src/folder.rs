//! Results of a simulation: a measurement folder, and the truth behind it.

use tau_codes::Remark;
use tau_robot::measurements::{Folder, Shape};
use tau_robot::robot_file::RobotFile;

use super::machine::{Machine, State};
use super::plate::Objects;
use super::trackers::Mounting;

/// A measurement folder in memory, with the truth behind it.
#[derive(Debug, Clone)]
pub struct SimulatedFolder {
    /// Drives and plate, by which the columns are named.
    pub shape: Shape,
    /// The measurements.
    pub folder: Folder,
    /// The robot file that belongs to them.
    pub file: RobotFile,
    /// The hidden truth.
    pub truth: Truth,
}

/// The hidden truth.
#[derive(Debug, Clone)]
pub struct Truth {
    /// The machine as built, with its effects.
    pub machine: Machine,
    /// Names of its rods.
    pub links: Vec<String>,
    /// Names of its tracks and cranks.
    pub tracks: Vec<String>,
    /// Effects by name and place, as the description writes it (`two`, `all`, `one,two`).
    pub effects: Vec<(String, String)>,
    /// Verdicts of discovery that are right.
    pub status: Vec<&'static str>,
    /// True states at the readings of set 1.
    pub tcp_poses: Vec<State>,
    /// Numbers of their poses in the files: of readings of one pose the same, unless each is a pose of its own there.
    pub pose_numbers: Vec<u32>,
    /// Tracker and targets of set 2.
    pub set2: Mounting,
    /// Tracker and targets of set 3.
    pub set3: Mounting,
    /// Numbers of the TCP poses that are outliers.
    pub outliers: Vec<u32>,
    /// File and line of other rows that are.
    pub gross_rows: Vec<(&'static str, usize)>,
    /// Targets, surfaces and balls that measurements were taken of or from.
    pub objects: Objects,
    /// Points that were out of reach and left out of sets 1 and 3.
    pub out_of_reach: usize,
    /// Remarks on what was asked for and not had, or says nothing.
    pub remarks: Vec<Remark>,
}
