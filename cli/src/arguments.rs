//! The command line as typed and as clap reads it; [`super::resolve`] gives it its meaning.

mod firmware;
mod generate;
mod init;
mod kinematics;
mod trust;

use std::path::{Path, PathBuf};

use clap::{Args, Parser, Subcommand, ValueEnum};
use clap_complete::Shell;

use super::numbers::{Triple, positive};
pub(super) use firmware::{Export, Firmware, Import};
pub(super) use generate::Generate;
pub(super) use init::Init;
pub(super) use kinematics::{Forward, Inverse, Kinematic, Kinematics};
pub(super) use trust::{Check, Judgement, KeepOutliers, Loss, Outliers, Strict};

/// Calibrates parallel robots from a declarative description.
#[derive(Debug, Parser)]
#[command(
    name = "tau",
    version,
    disable_help_subcommand = true,
    long_about = "Calibrates parallel robots from a declarative description.\n\n\
        Without a command, `tau` runs `tau study` on measurements that are built in.",
    after_help = "\
Examples:
  tau                                      the study on the built-in measurements
  tau study measured --out report          the study on your own
  tau init delta.tau                       a robot.toml to fill in, of a description
  tau import klipper printer.cfg --out printer   what a printer measured of itself
  tau check measured                       what measurements determine, and mistakes
  tau calibrate measured --variant Full    one variant: values, sigmas, covariance
  tau discover measured                    what the model lacks, with its evidence
  tau kinematics forward --variant Full --robot robot.toml --commands 0,0,0

A measurement folder holds CSV files with a header line, in SI units:
  tcp_poses.csv       set 1: commands q1_m, q2_m, … and pose of the plate
  cart_poses.csv      set 2: poses of the carts along their tracks (optional)
  cart_positions.csv  set 3: positions of the carts at random poses (optional)
  robot.toml          nominal parameters with tolerances, noise, loads

A robot is described in a .tau file; `tau robots` lists those that are built in.

Exit codes: 0 done, 1 failed to converge or check failed, 2 bad input or usage."
)]
pub(super) struct Arguments {
    /// Print nothing but errors, verdicts that are not `consistent` or that rows were left out of, that of `discover`, what `check`
    /// finds wrong, and the JSON or CSV that was asked for
    #[arg(long, short, global = true, display_order = 900)]
    pub(super) quiet: bool,
    #[command(subcommand)]
    pub(super) command: Option<Command>,
}

#[derive(Debug, Subcommand)]
pub(super) enum Command {
    Study(Study),
    Check(Check),
    Calibrate(Calibrate),
    Evaluate(Evaluate),
    Sensitivity(Sensitivity),
    Discover(Discover),
    Init(Init),
    Import(Import),
    Export(Export),
    /// List the standard robots, which `--model NAME` takes
    Robots,
    Simulate(Box<Simulate>),
    Generate(Generate),
    #[command(subcommand)]
    Kinematics(Kinematics),
    Completions(Completions),
}

/// Study a folder: every variant calibrated, compared and reported
///
/// Checks what the models assume, calibrates every variant without effects on one part of the poses,
/// compares them on the other part, and computes how much each parameter matters. Prints errors, geometry
/// and sensitivity, and searches for the physical effects that `Full` lacks, as `tau discover` does. Writes an HTML
/// report, the figures (SVG) and the numbers (JSON). Where poses were not measured, variants are compared by
/// the errors of measurements that were held out.
#[derive(Debug, Default, Args)]
#[command(after_help = "\
Examples:
  tau study                                on the built-in measurements
  tau study measured --out report
  tau study measured --model hexapod.tau --split fraction:0.7 --seed 3
  tau study measured --json - --quiet | jq .variants.Full.position_um")]
pub(super) struct Study {
    #[command(flatten)]
    pub(super) input: Input,
    /// Folder for report.html, study.json and the figures
    #[arg(long, value_name = "DIR", default_value = Study::OUT)]
    pub(super) out: Option<PathBuf>,
    /// Leave out the search for what the model lacks, which takes longer than all the rest
    #[arg(long)]
    pub(super) no_discover: bool,
    #[command(flatten)]
    pub(super) outliers: Outliers,
    #[command(flatten)]
    pub(super) judgement: Judgement,
}

impl Study {
    const OUT: &str = "tau-study";

    /// The folder to write into.
    pub(super) fn out(&self) -> &Path {
        self.out.as_deref().unwrap_or(Path::new(Self::OUT))
    }
}

/// Calibrate one variant
///
/// Fits the parameters of a variant to the calibration poses, with the tolerances of robot.toml as
/// priors. Where the folder holds positions, heights, distances, a ball bar or readings of the drives
/// alone, all of them are fitted at once, the true pose of each being unknown. Writes into a folder:
///
///   robot.toml        calibrated values, to be used with --robot
///   parameters.csv    nominal and calibrated value, tolerance, sigma and origin of each parameter
///   covariance.csv    covariance of the parameters, in products of their SI units
///   undetermined.csv  combinations that tolerances determine better than the data
///   statistics.json   the same as --json
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  tau calibrate --variant BestPerLink      on the built-in measurements
  tau calibrate measured --variant Full --out calibrated
  tau calibrate measured --variant Full --files tcp_poses.csv
  tau calibrate measured --variant Mine --model mine.tau --json -"
)]
pub(super) struct Calibrate {
    #[command(flatten)]
    pub(super) input: Input,
    #[command(flatten)]
    pub(super) variant: Variant,
    /// Has no effect any more: every calibration fits all files
    #[arg(long, hide = true)]
    pub(super) errors_in_variables: bool,
    /// Where poses are unknown: fit the scale of the whole machine even if no measurement determines it
    #[arg(long)]
    pub(super) free_scale: bool,
    #[command(flatten)]
    pub(super) outliers: Outliers,
    /// Folder for the files
    #[arg(long, value_name = "DIR", default_value = "tau-calibration")]
    pub(super) out: PathBuf,
    #[command(flatten)]
    pub(super) judgement: Judgement,
}

/// Compare predicted with measured poses, or what was measured instead
///
/// Predicts poses from their commands with the parameters of --robot, and prints the errors of position
/// (µm) and orientation (mrad, a rotation vector). Give the robot.toml that `tau calibrate` wrote: of the
/// folder that it was calibrated on it is compared at the poses that took no part, of another folder at all.
/// That of the folder holds nominal values, which are compared at the validation poses. Where poses were not
/// measured, heights, distances or readings are compared in the same way, the parameters held.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tau evaluate measured --variant Full --robot tau-calibration/robot.toml
  tau evaluate measured --variant Full     how good the drawing is")]
pub(super) struct Evaluate {
    #[command(flatten)]
    pub(super) input: Input,
    #[command(flatten)]
    pub(super) variant: Variant,
    #[command(flatten)]
    pub(super) outliers: KeepOutliers,
    #[command(flatten)]
    pub(super) judgement: Judgement,
}

/// Compute how much each parameter of each link matters
///
/// For a step up and a step down in each parameter: how far the validation poses move (mm, summed),
/// how far they turn (rad, summed), and how the cost changes (m⁴). Twice, by steps and by the implicit
/// function theorem; how far the two differ is printed.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tau sensitivity --variant Full           on the built-in measurements
  tau sensitivity measured --variant Full --robot tau-calibration/robot.toml --json sensitivity.json")]
pub(super) struct Sensitivity {
    #[command(flatten)]
    pub(super) input: Input,
    #[command(flatten)]
    pub(super) variant: Variant,
    /// Step, in the SI unit of each parameter
    #[arg(long, value_name = "STEP", default_value_t = tau::sensitivity::PAPER_STEP, value_parser = positive)]
    pub(super) step: f64,
}

/// Find the physical effects that a variant lacks
///
/// Fits a variant to all sets at once, scores every effect of the catalogue at every place, adds, drops
/// and exchanges effects while that explains the measurements better, and shows the error shrink on the
/// validation poses, which take no part. Says too what else could be meant, what could not be seen, and
/// what remains. Writes into a folder:
///
///   discovered.tau    the description with the variant `Discovered`, for --model and `tau generate`
///   discovered.rs     its generated code
///   robot.toml        calibrated values of `Discovered`, to be used with --robot
///   parameters.csv    and the other tables that `tau calibrate` writes
///   report.html       what is wrong with the machine, and the evidence
#[derive(Debug, Args)]
#[command(
    verbatim_doc_comment,
    after_help = "\
Examples:
  tau discover                             on the built-in measurements
  tau discover measured --base BestPerLink --out found
  tau discover measured --effects mine.tau --json - --quiet | jq .effects
  tau evaluate --variant Discovered --model tau-discovery/discovered.tau \\
      --robot tau-discovery/robot.toml

--seed is the seed of the resamples too."
)]
pub(super) struct Discover {
    #[command(flatten)]
    pub(super) input: Input,
    /// Variant to start from; without it `Full`, or else the last one with all links and without effects
    #[arg(long, value_name = "VARIANT")]
    pub(super) base: Option<String>,
    /// Effects of your own, in the language; may be given several times. They stand beside the
    /// catalogue's, and replace those of the same name
    #[arg(long = "effects", value_name = "F.tau")]
    pub(super) effects: Vec<PathBuf>,
    /// Poses to which the model that was found is fitted for robot.toml: those that calibrate, which leaves the
    /// others to judge it, or all
    #[arg(long, value_enum, value_name = "POSES", default_value = "calibration")]
    pub(super) refit: Refit,
    /// Folder for the files
    #[arg(long, value_name = "DIR", default_value = "tau-discovery")]
    pub(super) out: PathBuf,
    #[command(flatten)]
    pub(super) strict: Strict,
}

/// Poses for a fit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Refit {
    /// Those that calibrate
    Calibration,
    /// All in range
    All,
}

/// Simulate a measurement folder of which the truth is known
///
/// The project's virtual robot measures itself: its machine is drawn from the tolerances of robot.toml,
/// errors that no variant knows can be added, and the trackers have noise. It shares no code with the
/// calibration. Writes tcp_poses.csv, cart_poses.csv, cart_positions.csv, robot.toml and truth.json. The
/// defaults are those of the built-in measurements.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tau simulate --out simulated --effect 'rack_pitch(two): sine=8e-5, period=0.0133'
  tau simulate --out simulated --effect 'backlash(one): gap=4e-5' --noise-scale 2,2,2 --seed 7
  tau simulate --out simulated --robot mine.toml --model mine.tau --grid 5,5,4
  tau simulate --out simulated --robot mine.toml --model mine.tau --measure heights,distances --poses 40")]
pub(super) struct Simulate {
    /// Folder for the measurements
    #[arg(long, value_name = "DIR")]
    pub(super) out: PathBuf,
    /// Description of the robot, or name of a built-in one; without it, that of robot.toml if it is built in, or else
    /// the Gantry-Tau
    #[arg(long, value_name = "F.tau")]
    pub(super) model: Option<PathBuf>,
    /// Drawing of the robot, its noise and payload; without it, what the description gives, or those of the built-in
    /// Gantry-Tau
    #[arg(long, value_name = "ROBOT.toml")]
    pub(super) robot: Option<PathBuf>,
    /// Variant whose simplifications the machine keeps: what it holds is as in robot.toml, and not drawn. Without it, that
    /// of `Full`, or else of the last variant with all links and without effects
    #[arg(long, value_name = "NAME")]
    pub(super) variant: Option<String>,
    /// Physical error, `NAME(PLACE): PARAMETER=VALUE, …` in SI units; may be given several times. Some act at two places,
    /// `cart_crosstalk(one, two): gain=2e-5`, or take a vector, `joint_placement(l1): offset=(1e-3, 0, 0)`
    #[arg(long = "effect", value_name = "EFFECT")]
    pub(super) effects: Vec<String>,
    /// Seed of all random numbers
    #[arg(long, value_name = "SEED", default_value_t = 1)]
    pub(super) seed: u64,
    /// Take the machine exactly as in robot.toml instead of drawing it from the tolerances: of tracks' offsets and
    /// directions, and of anchors on the base, from a tenth of theirs, since they stand better than a first guess of the
    /// frame says
    #[arg(long)]
    pub(super) exact: bool,
    #[command(flatten)]
    pub(super) noise: SimulatedNoise,
    #[command(flatten)]
    pub(super) plan: SimulatedPlan,
    #[command(flatten)]
    pub(super) json: Json,
}

/// Noise of a simulation.
#[derive(Debug, Args)]
#[command(next_help_heading = "Noise")]
pub(super) struct SimulatedNoise {
    /// Noise of positions to state and to apply, per axis (m); without it, that of robot.toml
    #[arg(long, value_name = "M")]
    pub(super) noise_position: Option<f64>,
    /// Noise of rotations to state and to apply, per axis (rad); without it, that of robot.toml
    #[arg(long, value_name = "RAD")]
    pub(super) noise_rotation: Option<f64>,
    /// Noise of the drives' readings to state and to apply (m or rad); without it, that of robot.toml
    #[arg(long, value_name = "M")]
    pub(super) noise_drives: Option<f64>,
    /// Measure tensions of driven links, force1_N, …, with this noise (N), stated nowhere
    #[arg(long, value_name = "N")]
    pub(super) noise_force: Option<f64>,
    /// True noise of sets 1, 2 and 3 over the stated one
    #[arg(long, value_name = "S1,S2,S3", default_value = "1,1,1")]
    pub(super) noise_scale: Triple<f64>,
    /// Draw the noise from Student's t distribution of three degrees of freedom
    #[arg(long)]
    pub(super) heavy_tails: bool,
    /// Share of the variance that the coordinates of a pose or position have in common
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub(super) common_noise: f64,
    /// Share of its variance that a reading has in common with the others at the same TCP pose, where the plate is off
    /// alike for whatever measures it
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub(super) visit_noise: f64,
    /// Correlation of successive measurements of a file
    #[arg(
        long,
        value_name = "R",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub(super) serial_noise: f64,
    /// Share of the TCP poses that are outliers
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub(super) outliers: f64,
    /// Size of an outlier, in standard deviations
    #[arg(long, value_name = "SIZE", default_value_t = 20.0)]
    pub(super) outlier_size: f64,
}

/// Measurements of a simulation.
#[derive(Debug, Args)]
#[command(next_help_heading = "Measurements")]
pub(super) struct SimulatedPlan {
    /// Layers, rows and columns of the grid of TCP poses
    #[arg(long, value_name = "N,N,N", default_value = "6,6,5")]
    pub(super) grid: Triple<usize>,
    /// Steps of the grid (m); without it, those of the prototype in proportion to the links. Points out of reach are left
    /// out, and what would stay within reach is said
    #[arg(long, value_name = "M,M,M")]
    pub(super) grid_step: Option<Triple<f64>>,
    /// Number of TCP poses: those of the grid end there
    #[arg(long, value_name = "N", default_value_t = 176)]
    pub(super) poses: usize,
    /// Quantities measured at these poses, some of poses, positions, heights, distances, ball-bar, readings; targets,
    /// surfaces, balls and noise are those of robot.toml
    #[arg(
        long,
        value_name = "KINDS",
        default_value = "poses",
        value_delimiter = ','
    )]
    pub(super) measure: Vec<String>,
    /// Number of readings at each of them
    #[arg(long, value_name = "N", default_value_t = 1)]
    pub(super) readings: usize,
    /// Take random TCP poses instead of a grid
    #[arg(long, conflicts_with_all = ["grid", "grid_step"])]
    pub(super) random: bool,
    /// Turn the plate at each TCP pose at random, up to this angle (rad), where the drives can; without it, it stays as
    /// level as its position leaves it
    #[arg(long, value_name = "RAD", default_value_t = 0.0)]
    pub(super) tilt: f64,
    /// Random displacement of grid and track points, as a share of their step
    #[arg(long, value_name = "SHARE", default_value_t = 0.0)]
    pub(super) jitter: f64,
    /// Points on each track in set 2
    #[arg(long, value_name = "N", default_value_t = 28)]
    pub(super) track_points: usize,
    /// Measure set 2 both ways
    #[arg(long)]
    pub(super) both_ways: bool,
    /// Random poses in set 3
    #[arg(long, value_name = "N", default_value_t = 150)]
    pub(super) cart_poses: usize,
    /// Approach poses from random sides
    #[arg(long)]
    pub(super) random_approach: bool,
    /// Temperature at the start (°C)
    #[arg(
        long,
        value_name = "C",
        default_value_t = 20.0,
        allow_negative_numbers = true
    )]
    pub(super) temperature: f64,
    /// Rise of the temperature during set 1 (K)
    #[arg(
        long,
        value_name = "K",
        default_value_t = 0.0,
        allow_negative_numbers = true
    )]
    pub(super) warming: f64,
    /// Mass of the payload (kg); without it, that of robot.toml
    #[arg(long, value_name = "KG")]
    pub(super) payload: Option<f64>,
}

/// Print completions for a shell
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  tau completions bash > ~/.local/share/bash-completion/completions/tau
  tau completions fish > ~/.config/fish/completions/tau.fish")]
pub(super) struct Completions {
    /// Shell
    pub(super) shell: Shell,
}

/// Input of a computation.
#[derive(Debug, Default, Args)]
pub(super) struct Input {
    /// Measurement folder; without it, the measurements that are built in
    pub(super) folder: Option<PathBuf>,
    #[command(flatten)]
    pub(super) robot: Robot,
    /// Files of the folder that count, such as tcp_poses.csv,heights.csv; without it, all
    #[arg(long, value_name = "FILE,…", value_delimiter = ',')]
    pub(super) files: Vec<String>,
    /// Poses that calibrate, the others validate: alternate, all, first:N, fraction:F or fraction:F:SEED
    ///
    /// [default: alternate]
    #[arg(long, value_name = "SPLIT")]
    pub(super) split: Option<String>,
    /// Seed of the random choice of --split fraction:F
    #[arg(long, value_name = "SEED")]
    pub(super) seed: Option<u64>,
    #[command(flatten)]
    pub(super) json: Json,
}

impl Input {
    /// The arguments as they were given.
    pub(super) fn words(&self) -> Vec<String> {
        let path = |path: &PathBuf| path.display().to_string();
        let options = [
            ("--model", self.robot.model.as_ref().map(path)),
            ("--robot", self.robot.robot.as_ref().map(path)),
            (
                "--files",
                (!self.files.is_empty()).then(|| self.files.join(",")),
            ),
            ("--split", self.split.clone()),
            ("--seed", self.seed.map(|seed| seed.to_string())),
        ];
        let options = options.into_iter();
        let options = options.filter_map(|(name, value)| Some([name.to_owned(), value?]));
        let folder = self.folder.as_ref().map(path);
        folder.into_iter().chain(options.flatten()).collect()
    }
}

/// Choice of the robot.
#[derive(Debug, Default, Args)]
pub(super) struct Robot {
    /// Description of the robot, or name of a built-in one; without it, that of robot.toml if it is built in, or else
    /// the Gantry-Tau
    #[arg(long, value_name = "F.tau")]
    pub(super) model: Option<PathBuf>,
    /// Parameters of the robot; without it, FOLDER/robot.toml; without a folder what the description gives, or else
    /// the built-in ones
    #[arg(long, value_name = "ROBOT.toml")]
    pub(super) robot: Option<PathBuf>,
}

impl Robot {
    /// The files that are named.
    pub(super) fn files(&self) -> impl Iterator<Item = &PathBuf> {
        self.model.iter().chain(&self.robot)
    }
}

/// Choice of the variant.
#[derive(Debug, Args)]
pub(super) struct Variant {
    /// Variant of the robot, such as Nominal, Piecewise, Full, FullPiecewise or BestPerLink
    #[arg(long = "variant", value_name = "NAME")]
    pub(super) name: String,
}

/// Results for programs.
#[derive(Debug, Default, Args)]
pub(super) struct Json {
    /// Write the results as JSON; `-` prints them, and nothing else, on standard output
    #[arg(long = "json", value_name = "FILE", display_order = 800)]
    pub(super) target: Option<PathBuf>,
}
