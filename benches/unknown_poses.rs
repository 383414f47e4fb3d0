//! Calibration from unknown poses: coverage of 95 % intervals over simulated folders, and growth with samples.
//!
//! ```sh
//! cargo bench -p tau-benches --bench unknown_poses -- --folders 200
//! cargo bench -p tau-benches --bench unknown_poses -- --growth
//! ```

#[path = "support/coverage.rs"]
mod intervals;

use std::collections::BTreeMap;
use std::time::Instant;

use clap::Parser;
use intervals::Coverage;
use tau::Setup;
use tau::calibration::Options;
use tau::measurements::{PlateKind, Split};
use tau::simulation::{Build, Machine, Measure, Poses, Simulation, TrackPoints, simulate};
use tau::unknown_poses::{RowDivision, UnknownPoses, calibrate};
use tau_robot::robot::{Arm, Owner, Parameter, Robot};
use tau_robot::robot_file::RobotFile;

const DELTA: &str = include_str!("../tests/robots/linear_delta.tau");
const HEXAPOD: &str = include_str!("../tests/robots/stewart.tau");
const FIVE_BAR: &str = include_str!("../generated/models/five_bar.tau");
const FOUR_BELTS: &str = include_str!("../generated/models/four_belts.tau");
/// Noise of the drives of belts, and the frame of readings alone: one lower anchor is the origin, the other lies on the x
/// axis.
const BELTS: &str = "[drives]\nnoise_m = 2e-4\n[parameters]\nbottom_left_x = { value = 0.0, tol = 1e-6 }\nbottom_left_y = { value = 0.0, tol = 1e-6 }\nbottom_right_y = { value = 0.0, tol = 1e-6 }\n";
/// Half the width of a 95 % interval, in standard deviations.
const HALF_WIDTH: f64 = 1.96;
/// Noise of lengths, and of drives that are not exact (m).
const NOISE_M: f64 = 1e-5;

/// Coverage and growth of calibrations from unknown poses.
#[derive(Debug, Parser)]
struct Arguments {
    /// Folders of each case.
    #[arg(long, default_value_t = 200)]
    folders: u64,
    /// Seed of the first folder.
    #[arg(long, default_value_t = 0)]
    seed: u64,
    /// Only parameters of which the standard deviation is less than this share of the tolerance.
    #[arg(long, default_value_t = 0.2)]
    told: f64,
    /// Factor on noise and tolerances, of which the smaller ones leave less to curvature.
    #[arg(long, default_value_t = 1.0)]
    scale: f64,
    /// Only cases whose name contains this.
    #[arg(long, default_value = "")]
    case: String,
    /// Time and memory against the number of samples, in place of coverage.
    #[arg(long)]
    growth: bool,
    /// An argument that `cargo bench` adds.
    #[arg(long, hide = true)]
    bench: bool,
}

/// A robot, its variant, and what is measured at how many poses.
struct Case {
    name: &'static str,
    description: &'static str,
    variant: &'static str,
    measures: Vec<Measure>,
    poses: usize,
    /// More of the robot file.
    more: &'static str,
    /// Noise that the fit has to estimate, as the robot file asks for it.
    estimated: &'static str,
}

fn cases() -> Vec<Case> {
    let rows = Measure::Rows;
    let case = |name, description, variant, measures, poses, more| Case {
        name,
        description,
        variant,
        measures,
        poses,
        more,
        estimated: "",
    };
    let estimating = |estimated, case: Case| Case { estimated, ..case };
    let drives = "[drives]\nnoise_m = 1e-5\n";
    vec![
        case(
            "delta, positions",
            DELTA,
            "Nominal",
            vec![rows(PlateKind::Position)],
            30,
            "",
        ),
        case(
            "delta, positions, drives",
            DELTA,
            "Nominal",
            vec![rows(PlateKind::Position)],
            30,
            drives,
        ),
        case(
            "delta, heights",
            DELTA,
            "Nominal",
            vec![rows(PlateKind::Height)],
            40,
            "",
        ),
        case(
            "delta, heights, drives",
            DELTA,
            "Nominal",
            vec![rows(PlateKind::Height)],
            40,
            drives,
        ),
        case(
            "delta, distances",
            DELTA,
            "Nominal",
            vec![Measure::Distances],
            40,
            "",
        ),
        case(
            "delta, heights and distances",
            DELTA,
            "Nominal",
            vec![rows(PlateKind::Height), Measure::Distances],
            40,
            "",
        ),
        case(
            "hexapod, ball bar",
            HEXAPOD,
            "Full",
            vec![rows(PlateKind::BallBar)],
            60,
            "",
        ),
        case(
            "hexapod, positions",
            HEXAPOD,
            "Full",
            vec![rows(PlateKind::Position)],
            40,
            "",
        ),
        case(
            "hexapod, poses, drives",
            HEXAPOD,
            "Full",
            vec![Measure::Poses],
            40,
            drives,
        ),
        case(
            "hexapod, heights and distances",
            HEXAPOD,
            "Full",
            vec![rows(PlateKind::Height), Measure::Distances],
            80,
            "",
        ),
        case(
            "hexapod, distances",
            HEXAPOD,
            "Full",
            vec![Measure::Distances],
            80,
            "",
        ),
        case(
            "hexapod, ball bar, drives",
            HEXAPOD,
            "Full",
            vec![rows(PlateKind::BallBar)],
            60,
            drives,
        ),
        case(
            "hexapod, positions, drives",
            HEXAPOD,
            "Full",
            vec![rows(PlateKind::Position)],
            40,
            drives,
        ),
        case(
            "hexapod, heights and distances, drives",
            HEXAPOD,
            "Full",
            vec![rows(PlateKind::Height), Measure::Distances],
            80,
            drives,
        ),
        case(
            "hexapod, distances, drives",
            HEXAPOD,
            "Full",
            vec![Measure::Distances],
            80,
            drives,
        ),
        case(
            "belts, readings",
            FOUR_BELTS,
            "Full",
            vec![rows(PlateKind::Reading)],
            100,
            BELTS,
        ),
        case(
            "five bar, positions",
            FIVE_BAR,
            "Full",
            vec![rows(PlateKind::Position)],
            40,
            "",
        ),
        case(
            "five bar, positions, drives",
            FIVE_BAR,
            "Full",
            vec![rows(PlateKind::Position)],
            40,
            drives,
        ),
        case(
            "five bar, ball bar",
            FIVE_BAR,
            "Full",
            vec![rows(PlateKind::BallBar)],
            60,
            "",
        ),
        case(
            "five bar, distances",
            FIVE_BAR,
            "Full",
            vec![Measure::Distances],
            60,
            "",
        ),
        estimating(
            "[noise]\nrotation_rad = 4e-5\n[noise.tcp_positions]\nposition_m = \"estimate\"\n[drives]\nnoise_m = \"estimate\"\n",
            case(
                "hexapod, positions, drives, noise estimated",
                HEXAPOD,
                "Full",
                vec![rows(PlateKind::Position)],
                40,
                drives,
            ),
        ),
        estimating(
            "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\nheights = { height_m = \"estimate\" }\nball_bar = { distance_m = \"estimate\" }\n",
            case(
                "hexapod, positions, heights and ball bar, noise estimated",
                HEXAPOD,
                "Full",
                vec![
                    rows(PlateKind::Position),
                    rows(PlateKind::Height),
                    rows(PlateKind::BallBar),
                ],
                40,
                "",
            ),
        ),
        estimating(
            "[noise]\nheights = { height_m = \"estimate\" }\ndistances = { distance_m = \"estimate\" }\n",
            case(
                "delta, heights and distances, noise estimated",
                DELTA,
                "Nominal",
                vec![rows(PlateKind::Height), Measure::Distances],
                40,
                "",
            ),
        ),
    ]
}

impl Case {
    fn robot(&self, scale: f64) -> (Robot, RobotFile) {
        let robot = Robot::from_text(self.description).unwrap();
        let [position, rotation] = [scale * NOISE_M, scale * 4e-5];
        let noise = format!("[noise]\nposition_m = {position:e}\nrotation_rad = {rotation:e}\n");
        let file = Self::file(&robot, scale, &format!("{noise}{}", self.more));
        (robot, file)
    }

    /// The robot file with noise and more in text.
    fn file(robot: &Robot, scale: f64, more: &str) -> RobotFile {
        let text = format!("robot = \"{}\"\n{more}", robot.name);
        let file = RobotFile::parse_for(&text, "robot.toml", robot).unwrap();
        let mut file = file.completed(robot);
        for link in file.links.values_mut() {
            let places = [&mut link.plate_joint, &mut link.track_offset];
            let others = [&mut link.length, &mut link.track_direction];
            let values = places.into_iter().chain(others).flatten();
            values.for_each(|value| value.tol *= scale);
        }
        file
    }

    /// The file from which machines are drawn. Parallel links have the mean of their lengths, which scatters less than the
    /// tolerance of each, and is known no better.
    fn scattered(&self, robot: &Robot, file: &RobotFile) -> RobotFile {
        let mut scattered = file.clone();
        if robot.variant(self.variant).unwrap().arm == Arm::Reduced {
            for cluster in 0..robot.clusters.len() {
                let links = robot.links_of_cluster(cluster);
                for &link in &links {
                    let values = scattered.links.get_mut(&robot.links[link].name);
                    if let Some(length) = values.and_then(|values| values.length.as_mut()) {
                        length.tol *= (links.len() as f64).sqrt();
                    }
                }
            }
        }
        scattered
    }

    fn simulation(&self, robot: &Robot, file: &RobotFile, poses: usize, seed: u64) -> Simulation {
        Simulation {
            variant: Some(self.variant.to_owned()),
            // Priors are as wide as machines scatter, or else intervals of what they tell a part of were too wide.
            build: Build::Drawn {
                links: 1.0,
                tracks: 1.0,
            },
            poses: Poses::Random { count: poses },
            measures: self.measures.clone(),
            track_points: TrackPoints {
                count: 0,
                ..TrackPoints::default()
            },
            random_poses: 0,
            seed,
            ..Simulation::new(robot.clone(), file.clone())
        }
    }

    fn fit(
        &self,
        robot: &Robot,
        file: &RobotFile,
        poses: usize,
        seed: u64,
    ) -> Option<(UnknownPoses, Machine, f64)> {
        let scattered = self.scattered(robot, file);
        let simulated = simulate(&self.simulation(robot, &scattered, poses, seed)).unwrap();
        let division = RowDivision::of(&simulated.folder, Split::All);
        let variant = robot.variant(self.variant).unwrap();
        let start = Instant::now();
        let options = Options::default();
        let estimating =
            (!self.estimated.is_empty()).then(|| Self::file(robot, 1.0, self.estimated));
        let stated = estimating.as_ref().unwrap_or(file);
        let found = calibrate(
            Setup::new(robot, variant, stated, &simulated.folder),
            &division,
            &options,
        );
        let seconds = start.elapsed().as_secs_f64();
        match found {
            Ok(found) => Some((found, simulated.truth.machine, seconds)),
            Err(error) => {
                println!("{} {seed}: {error}", self.name);
                None
            }
        }
    }
}

/// The true value of a parameter, and its kind; `None` where the fit has it in another form.
fn truth(parameter: &Parameter, robot: &Robot, machine: &Machine) -> Option<(&'static str, f64)> {
    let component = |vector: &[f64]| vector.get(parameter.component?).copied();
    let rod = match parameter.owner {
        Owner::Link(link) => &machine.rods[link],
        Owner::Cluster(cluster) => &machine.rods[*robot.links_of_cluster(cluster).first()?],
        Owner::Robot => {
            let values = machine.parameters.get(&parameter.quantity)?;
            let value = values.get(parameter.component.unwrap_or(0))?;
            return Some(("machine parameters", *value));
        }
        _ => return None,
    };
    let (kind, value) = match parameter.quantity.as_str() {
        "length" => ("lengths", Some(rod.length_m)),
        "plate_joint" => ("plate joints", component(rod.plate_joint_m.as_slice())),
        // Plate joints are folded into the offsets of a reduced arm; the plate is level.
        "track_offset" => {
            let folded = matches!(parameter.owner, Owner::Cluster(_));
            let plate = if folded {
                rod.plate_joint_m
            } else {
                rod.plate_joint_m * 0.0
            };
            let joint = rod.track_offset_m - plate;
            ("track origins", component(joint.as_slice()))
        }
        "track_direction" => (
            "track directions",
            component(rod.track_direction.as_slice()),
        ),
        _ => return None,
    };
    Some((kind, value?))
}

/// Parameters within their intervals.
#[derive(Default)]
struct Counts {
    within: Coverage,
    /// By the covariance alone.
    to_first_order: Coverage,
    squares: f64,
    /// Largest error, in standard deviations.
    most: f64,
}

impl Counts {
    fn add(&mut self, off: f64, [sigma, first_order]: [f64; 2]) {
        let z = off.abs() / sigma;
        self.within.add(z < HALF_WIDTH);
        (self.to_first_order).add(off.abs() / first_order < HALF_WIDTH);
        self.squares += z * z;
        self.most = self.most.max(z);
    }

    fn next(&mut self) {
        self.within.next();
        self.to_first_order.next();
    }

    /// Number, share within and by the covariance alone, root mean square and largest of the errors over their standard
    /// deviations.
    fn columns(&self) -> String {
        let rms = (self.squares / self.within.count()).sqrt();
        format!(
            "{} | {} | {} | {rms:.3} | {:.1}",
            self.within.count(),
            self.within,
            self.to_first_order,
            self.most
        )
    }
}

fn main() {
    let arguments = Arguments::parse();
    if arguments.growth {
        growth();
        return;
    }
    println!(
        "| case | poses | parameters | coverage of 95 % | to first order | rms z | largest | chi2/dof | too large | ms a fit |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |"
    );
    for case in cases()
        .iter()
        .filter(|case| case.name.contains(&arguments.case))
    {
        let (robot, file) = case.robot(arguments.scale);
        let (mut told, mut kinds) = (Counts::default(), BTreeMap::<_, Counts>::new());
        let (mut chi2, mut dof, mut seconds, mut fits) = (0.0, 0.0, 0.0, 0.0);
        let mut too_large = 0;
        for seed in arguments.seed..arguments.seed + arguments.folders {
            let Some((found, machine, took)) = case.fit(&robot, &file, case.poses, seed) else {
                continue;
            };
            let fitted = &found.calibration;
            told.next();
            kinds.values_mut().for_each(Counts::next);
            for (place, &index) in fitted.used.iter().enumerate() {
                let parameter = &fitted.machine.variant.parameters[index];
                let own = &fitted.parameters[place];
                let Some((kind, truth)) = truth(parameter, &robot, &machine) else {
                    continue;
                };
                // Where the prior says more than the data, the drawing of the machine is tested and not the fit.
                let first_order = fitted.covariance[place][place].sqrt();
                let is_told = |tolerance| first_order < arguments.told * tolerance;
                if own.tolerance.is_some_and(is_told) {
                    let (off, sigmas) = (own.value - truth, [own.sigma, first_order]);
                    told.add(off, sigmas);
                    let of_kind = kinds.entry(kind).or_insert_with(|| {
                        let mut counts = Counts::default();
                        counts.next();
                        counts
                    });
                    of_kind.add(off, sigmas);
                }
            }
            chi2 += found.chi2;
            dof += found.dof;
            seconds += took;
            fits += 1.0;
            // By chance, one folder in a thousand is: others are in another minimum.
            if !found.is_consistent() {
                println!(
                    "{} {seed}: chi2 {:.0} of {:.0}",
                    case.name, found.chi2, found.dof
                );
                too_large += 1;
            }
        }
        println!(
            "| {} | {} | {} | {:.3} | {too_large} | {:.1} |",
            case.name,
            case.poses,
            told.columns(),
            chi2 / dof,
            1e3 * seconds / fits
        );
        for (kind, counts) in &kinds {
            println!("| – {kind} | | {} | | | |", counts.columns());
        }
    }
}

/// Peak memory of this process (MB), where the system tells.
fn peak_mb() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM"));
    let kilobytes = line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok());
    kilobytes.unwrap_or(f64::NAN) / 1024.0
}

fn growth() {
    println!("| samples | s a fit | us a sample | peak MB |\n| --- | --- | --- | --- |");
    let cases = cases();
    let case = &cases[1];
    let (robot, file) = case.robot(1.0);
    for samples in [1000, 3000, 10_000, 30_000, 100_000] {
        if let Some((_, _, seconds)) = case.fit(&robot, &file, samples, 1) {
            let each = 1e6 * seconds / f64::from(samples as u32);
            println!(
                "| {samples} | {seconds:.2} | {each:.1} | {:.0} |",
                peak_mb()
            );
        }
    }
}
