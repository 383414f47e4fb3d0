//! Arguments of `tau kinematics`.

use std::path::PathBuf;

use clap::{ArgGroup, Args, Subcommand};

use super::{Json, Robot, Variant};
use crate::numbers::Numbers;

/// Compute poses from commands, or commands from poses
#[derive(Debug, Subcommand)]
pub(crate) enum Kinematics {
    Forward(Forward),
    Inverse(Inverse),
}

/// Options of which exactly one is given.
fn one_of(options: [&'static str; 2]) -> ArgGroup {
    ArgGroup::new("asked").args(options).required(true)
}

/// Compute the pose of the plate at given commands
///
/// Several poses can belong to the same commands: the arm can be assembled in several ways. `[reference]` of
/// the robot file, or of the description, says in which, and is followed to the commands asked for; without
/// it the nearest measured pose of the folder; without a folder the command fails and says how to give it.
/// A pose in the same row of the CSV counts before it, then the row before, for the first row --start.
/// Where the pose is singular the command fails and says how the plate is free to move; where there are more
/// links than hold the plate and they differ from their lengths by more than a millimetre at best, and by more
/// than the stated noise of drives and links makes likely, it fails, too.
#[derive(Debug, Args)]
#[command(group(one_of(["commands", "poses"])), override_usage = "\
tau kinematics forward [OPTIONS] --variant <NAME>
                              <--commands <Q1,Q2,…>|--poses <FILE>> [FOLDER]", after_help = "\
Examples:
  tau kinematics forward --variant Full --commands 0.1,0.2,-0.1
  tau kinematics forward measured --variant Full --robot tau-calibration/robot.toml --poses path.csv

Columns read: q1_m, q2_m, …; optional pose, the start x_m, y_m, z_m, alpha_rad, beta_rad, gamma_rad \
(without angles where the plate is a point or the arm is reduced), and time_s, temperature_c, dir1, dir2, …, force1_N, \
force2_N, … where the variant's effects need them. Columns written: pose, q1_m, …, x_m, y_m, z_m and, unless the plate is a \
point or the arm is reduced, alpha_rad, beta_rad, gamma_rad (ZYZ Euler angles); then standard deviations sigma_x_m, …, \
sigma_rx_rad, … (of the \
rotation vector), and inside: 1 in the region of calibration, else 0.")]
pub(crate) struct Forward {
    #[command(flatten)]
    pub(crate) with: Kinematic,
    /// Commands of one pose (m, or rad of cranks and drums)
    #[arg(long, value_name = "Q1,Q2,…", allow_hyphen_values = true)]
    pub(crate) commands: Option<Numbers>,
    /// CSV with the commands of many poses; - is standard input
    #[arg(long, value_name = "FILE")]
    pub(crate) poses: Option<PathBuf>,
    /// Pose near the first one (m, rad); X,Y,ALPHA in a plane, the position of a point
    #[arg(
        long,
        value_name = "X,Y,Z[,ALPHA,BETA,GAMMA]",
        allow_hyphen_values = true
    )]
    pub(crate) start: Option<Numbers>,
}

/// Compute the commands that bring the plate to a pose
///
/// Where the orientation follows from the position, as on the Gantry-Tau, angles only choose between
/// the ways of assembling the arm, and the orientation that results is printed; a reduced arm ignores
/// them. Without angles, the way from the row before decides, for the first row from `[reference]` of the
/// robot file or of the description, without it from the nearest measured pose of the folder.
#[derive(Debug, Args)]
#[command(group(one_of(["pose", "poses"])), override_usage = "\
tau kinematics inverse [OPTIONS] --variant <NAME>
                              <--pose <X,Y,Z,…>|--poses <FILE>> [FOLDER]", after_help = "\
Examples:
  tau kinematics inverse --variant Full --pose -1.5,-4.6,0.2
  tau kinematics inverse measured --variant Full --robot tau-calibration/robot.toml --poses path.csv

Columns read: x_m, y_m, z_m; optional pose, alpha_rad, beta_rad, gamma_rad (ZYZ Euler angles), and time_s, \
temperature_c, dir1, dir2, …, force1_N, force2_N, … where the variant's effects need them. Columns written are those of \
`tau kinematics forward`, and the standard deviations of the commands, sigma_q1_m, ….")]
pub(crate) struct Inverse {
    #[command(flatten)]
    pub(crate) with: Kinematic,
    /// One position, with or without orientation (m, rad): X,Y,Z[,ALPHA,BETA,GAMMA]; in a plane X,Y or X,Y,ALPHA
    #[arg(long, value_name = "X,Y,Z,…", allow_hyphen_values = true)]
    pub(crate) pose: Option<Numbers>,
    /// CSV with many poses; - is standard input
    #[arg(long, value_name = "FILE")]
    pub(crate) poses: Option<PathBuf>,
}

/// Arguments that forward and inverse kinematics share.
#[derive(Debug, Args)]
pub(crate) struct Kinematic {
    /// Measurement folder, needed for piecewise tracks, and for reduced arms unless --robot was
    /// calibrated with them; of the built-in robot, with neither it nor --robot, the built-in one
    pub(crate) folder: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) variant: Variant,
    #[command(flatten)]
    pub(crate) robot: Robot,
    /// File for the CSV; standard output without it
    #[arg(long, value_name = "FILE")]
    pub(crate) out: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) json: Json,
}
