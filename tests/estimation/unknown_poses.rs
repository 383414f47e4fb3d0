//! Calibration from any measurements: against truth, against the fit of closures, and gross rows by their places.

use tau::calibration::{self, Calibration, Options, ParameterEstimate};
use tau::measurements::{PlateKind, Split};
use tau::robot::Owner;
use tau::robot_file::{RobotFile, Value};
use tau::simulation::{Build, Machine, Measure, Noise, SimulatedFolder, Simulation, simulate};
use tau::unknown_poses::{RowDivision, UnknownPoses};
use tau::{Robot, Setup};
use tau_testkit::{Random, Work, list, number, robots, symmetric};

const HEIGHTS: Measure = Measure::Rows(PlateKind::Height);
const POSITIONS: Measure = Measure::Rows(PlateKind::Position);

/// A machine, its file and what was measured of it at random poses.
pub(crate) struct Measured {
    pub(crate) robot: Robot,
    variant: &'static str,
    pub(crate) file: RobotFile,
    pub(crate) made: SimulatedFolder,
}

impl Measured {
    pub(crate) fn new(
        (robot, file): (Robot, RobotFile),
        variant: &'static str,
        (measures, poses): (&[Measure], usize),
        change: impl FnOnce(&mut Simulation),
    ) -> Self {
        let mut simulation = robots::measured_at_random(&robot, &file, variant, measures, poses);
        change(&mut simulation);
        let made = simulate(&simulation).unwrap();
        Self {
            robot,
            variant,
            file,
            made,
        }
    }

    fn setup(&self) -> Setup<'_> {
        let variant = self.robot.variant(self.variant).unwrap();
        Setup::new(&self.robot, variant, &self.file, &self.made.folder)
    }

    pub(crate) fn fit(&self, options: &Options) -> UnknownPoses {
        let division = RowDivision::of(&self.made.folder, Split::All);
        tau::unknown_poses::calibrate(self.setup(), &division, options).unwrap()
    }

    fn fit_of_closures(&self) -> Calibration {
        let poses: Vec<usize> = (0..self.made.folder.tcp_poses.len()).collect();
        calibration::calibrate(self.setup(), &poses, &Options::default()).unwrap()
    }
}

/// Poses of a hexapod, whose drawing is off by a millimetre, which tolerances do not hold back.
fn hexapod(poses: usize, noise: f64) -> Measured {
    let drawn = robots::drawn("hexapod", "");
    let mut measured = Measured::new(drawn, "Full", (&[Measure::Poses], poses), |simulation| {
        simulation.build = Build::Exact;
        simulation.noise.scale = [noise; 3];
    });
    let mut random = Random(7);
    for link in measured.file.links.values_mut() {
        let own = [
            &mut link.length,
            &mut link.plate_joint,
            &mut link.track_offset,
        ];
        for value in own.into_iter().flatten() {
            for component in &mut value.value {
                *component += 1e-3 * symmetric(&mut random);
            }
            value.tol = 1e3;
        }
    }
    measured
}

/// Errors of the numbers of links, with their standard deviations.
fn errors(found: &Calibration, machine: &Machine) -> Vec<(f64, f64)> {
    let of = |(own, &index): (&ParameterEstimate, &usize)| {
        let parameter = &found.machine.variant.parameters[index];
        let Owner::Link(link) = parameter.owner else {
            return None;
        };
        let rod = &machine.rods[link];
        let truth = match (parameter.quantity.as_str(), parameter.component) {
            ("length", _) => rod.length_m,
            ("plate_joint", Some(axis)) => rod.plate_joint_m[axis],
            ("track_offset", Some(axis)) => rod.track_offset_m[axis],
            _ => return None,
        };
        Some((own.value - truth, own.sigma))
    };
    found
        .parameters
        .iter()
        .zip(&found.used)
        .filter_map(of)
        .collect()
}

/// The largest error of a number of links, in its standard deviations.
fn largest_deviation(found: &UnknownPoses, machine: &Machine) -> f64 {
    let errors = errors(&found.calibration, machine).into_iter();
    errors.fold(0.0, |most, (off, sigma)| most.max((off / sigma).abs()))
}

/// So does the fit of the closures.
#[test]
fn the_42_parameters_of_a_hexapod_follow_from_18_exact_poses() {
    let measured = hexapod(18, 0.0);
    for found in [
        measured.fit(&Options::default()).calibration,
        measured.fit_of_closures(),
    ] {
        let errors = errors(&found, &measured.made.truth.machine);
        assert_eq!(errors.len(), 42);
        // The millionth of a standard deviation at which fits end, and as much again of what its rounds leave.
        let is_exact = |own: &&(f64, f64)| own.0.abs() < 1e-5 * own.1;
        assert_eq!(errors.iter().filter(is_exact).count(), 42, "{errors:?}");
    }
}

/// Two fits of one model: the one eliminates measured poses by the noise that they give closures, the other as unknowns.
#[test]
fn fully_measured_poses_tell_what_their_closures_tell() {
    let measured = hexapod(40, 1.0);
    let found = measured.fit(&Options::default()).calibration;
    let closures = measured.fit_of_closures();
    for (own, closures) in found.parameters.iter().zip(&closures.parameters) {
        let off = (own.value - closures.value).abs() / closures.sigma;
        assert!(off < 0.1, "{}: {off}", own.name);
        let ratio = own.sigma / closures.sigma;
        assert!((0.99..1.01).contains(&ratio), "{}: {ratio}", own.name);
    }
}

#[test]
fn readings_of_redundant_drives_calibrate_them() {
    let drives = "[drives]\nnoise_m = 1e-5\n";
    let readings = [Measure::Rows(PlateKind::Reading)];
    let drawn = robots::drawn("eight_legs", drives);
    let measured = Measured::new(drawn, "Full", (&readings, 60), |_| ());
    let found = measured.fit(&Options::default());
    // Two of eight readings are left by the six freedoms of each pose.
    assert_eq!(found.rank.rows - found.rank.spent, 120);
    assert_eq!(found.rank.open.len(), 12);
    assert!(found.rank.has_mirror_image && found.gross.is_empty());
    assert!((found.residual_over_noise() - 1.0).abs() < 0.25);
    let errors = errors(&found.calibration, &measured.made.truth.machine);
    let squares = errors.iter().map(|(off, sigma)| (off / sigma).powi(2));
    let rms = (squares.sum::<f64>() / errors.len() as f64).sqrt();
    assert!(rms < 1.5, "{rms}");
}

#[test]
fn noise_is_estimated_by_kind() {
    let more = "[noise.heights]\nheight_m = \"estimate\"\n[noise.distances]\ndistance_m = 3e-5\n[drives]\nnoise_m = 1e-6\n";
    let drawn = robots::drawn("linear_delta", more);
    let measured = Measured::new(
        drawn,
        "Full",
        (&[HEIGHTS, Measure::Distances], 150),
        |simulation| {
            simulation.noise = Noise {
                scale: [3.0; 3],
                ..Noise::default()
            };
        },
    );
    let found = measured.fit(&Options::default());
    let of = |file: &str| {
        let mut kinds = found.kinds.iter();
        kinds.find(|fit| fit.kind.of.file() == file).unwrap()
    };
    // The simulation takes the general noise, 10 µm, for what is to be estimated, three times as large as stated.
    let heights = of("heights.csv").kind.sigma;
    assert!((heights / 3e-5 - 1.0).abs() < 0.2, "{heights}");
    let ratio = of("distances.csv").residual_over_noise().unwrap();
    assert!((ratio / 3.0 - 1.0).abs() < 0.25, "{ratio}");
}

#[test]
fn gross_rows_are_named_by_file_and_line() {
    let drawn = robots::drawn("hexapod", "");
    let measured = Measured::new(drawn, "Full", (&[HEIGHTS, POSITIONS], 100), |simulation| {
        simulation.noise = Noise {
            outliers: 0.03,
            ..Noise::default()
        };
    });
    let found = measured.fit(&Options::default());
    let named = found
        .gross
        .iter()
        .map(|row| (row.place.file, row.place.line));
    let mut named: Vec<(&str, usize)> = named.collect();
    let mut truth = measured.made.truth.gross_rows.clone();
    named.sort_unstable();
    truth.sort_unstable();
    assert!(!truth.is_empty());
    assert_eq!(named, truth);
    assert!(found.is_consistent(), "{}", found.residual_over_noise());
}

/// Repeats are readings of one true pose: four rows are worth as much as their mean with half the noise.
#[test]
fn repeats_are_readings_of_one_pose() {
    let drawn = robots::drawn("hexapod", "");
    let mut measured = Measured::new(drawn, "Full", (&[POSITIONS], 40), |simulation| {
        simulation.readings = 4;
    });
    let mut means = measured.made.folder.clone();
    means.plate_rows = (measured.made.folder.plate_rows.chunks(4))
        .map(|rows| {
            let mut row = rows[0].clone();
            for axis in 0..3 {
                let sum: f64 = rows.iter().filter_map(|row| row.values[axis]).sum();
                row.values[axis] = Some(sum / 4.0);
                row.sigmas[axis] = Some(5e-6);
            }
            row
        })
        .collect();
    let repeated = measured.fit(&Options::default());
    measured.made.folder = means;
    let meant = measured.fit(&Options::default());
    assert_eq!(repeated.poses, 40);
    assert_eq!(repeated.rank.spent, meant.rank.spent);
    let [repeated, meant] = [&repeated, &meant].map(|found| &found.calibration.parameters);
    for (own, other) in repeated.iter().zip(meant) {
        let off = (own.value - other.value).abs() / own.sigma;
        let ratio = own.sigma / other.sigma;
        assert!(off < 1e-5 && (ratio - 1.0).abs() < 1e-5, "{}", own.name);
    }
}

#[test]
fn a_folder_of_mixed_measurements_is_checked_and_calibrated() {
    let work = Work::simulated(
        "--model hexapod --measure poses,heights,distances,ball-bar --poses 80 --seed 1",
    );
    let check = work.json("check MEASURED");
    let open = &check["variants"]["Full"]["gauge"]["open"];
    assert_eq!(list(open).len(), 0, "{open}");
    let found = work.calibrated("--variant Full");
    assert_eq!(found["fit"]["status"], "consistent");
    let kinds = list(&found["kinds"]);
    assert!(kinds.iter().all(|kind| number(&kind["rows"]) > 0.0));
    let files = kinds.iter().map(|kind| kind["file"].as_str().unwrap());
    let files: Vec<_> = files.collect();
    for file in [
        "tcp_poses.csv",
        "heights.csv",
        "distances.csv",
        "ball_bar.csv",
    ] {
        assert!(files.contains(&file), "{files:?}");
    }
    for kind in list(&found["held_out"]["predicted"]) {
        assert!(number(&kind["rms_m"]) < 3e-5, "{kind}");
    }
    // The calibrated file is read again, and predicts.
    work.run(
        "kinematics forward --model hexapod --variant Full --robot DIR/out/robot.toml --commands 0,0,0,0,0,0",
    )
    .done();
}

/// Lines wound on drums that read to 20 mrad, 60 µm of line: a machine that is right is called so, with nothing missing,
/// by commands that compare poses; were drives taken for exact, residuals would exceed their noise many times.
#[test]
fn positions_of_a_point_are_its_poses() {
    let work = Work::simulated_with(
        "robot = \"FourLines\"\n[noise]\nposition_m = 5e-4\nrotation_rad = 1e-4\n[drives]\nnoise_m = 2e-2\n",
        "--model four_lines --robot DIR/robot.toml --variant Full --seed 3 --random --poses 60 --measure positions",
    );
    work.calibrated("--variant Full");
    let evaluated = work.evaluated("--variant Full");
    assert_eq!(evaluated["fit"]["status"], "consistent", "{evaluated:#}");
    assert_eq!(evaluated["poses"]["evaluated"], 30);
    let found = work.discovered("");
    assert_eq!(found["status"], "nothing_missing", "{found:#}");
}

/// A ball beside a machine that moves in a plane: its distances depend on the square of its height over the plane alone.
/// Every second ball lies in the plane, where noise may make that square negative.
pub(crate) fn a_ball_calibrates_a_five_bar(folders: u64) {
    let (robot, file) = robots::drawn("five_bar", "");
    let mut in_plane = file.clone();
    let place = Value {
        value: vec![0.05, -0.2, 0.0],
        tol: 1e-12,
        sigma: None,
    };
    in_plane.measuring.balls.insert("low".to_owned(), place);
    let (mut without, mut told, mut chi2, mut dof) = (0, 0, 0.0, 0.0);
    for seed in 0..folders {
        let with = if seed % 2 == 0 { &file } else { &in_plane };
        let ball = [Measure::Rows(PlateKind::BallBar)];
        let drawn = (robot.clone(), with.clone());
        let mut measured = Measured::new(drawn, "Full", (&ball, 60), |simulation| {
            simulation.seed = seed;
        });
        measured.file = file.clone();
        let found = measured.fit(&Options::default());
        chi2 += found.chi2;
        dof += found.dof;
        let truth = &measured.made.truth.machine.parameters;
        for estimate in &found.calibration.parameters {
            // Where the prior says more than the data, the drawing is tested and not the fit.
            let mut tolerance = estimate.tolerance.into_iter();
            let is_told = tolerance.any(|tol| estimate.sigma < 0.2 * tol);
            let true_values = truth.get(&estimate.name).filter(|_| is_told);
            for value in true_values.into_iter().flatten() {
                told += 1;
                without += usize::from((estimate.value - value).abs() > 1.96 * estimate.sigma);
            }
        }
    }
    // Some two of a folder, which go together: of half as many, each out in one of twenty.
    let rare = 2 * tau_testkit::rare_count(told / 2, 0.05);
    assert!(
        u64::from(told) > folders && without <= rare,
        "{without} of {told}"
    );
    // Once in ten thousand.
    let spread = 3.89 * (2.0_f64 / dof).sqrt();
    assert!((chi2 / dof - 1.0).abs() < spread, "{chi2} of {dof}");
}

#[test]
fn a_ball_beside_a_plane_calibrates_a_five_bar() {
    a_ball_calibrates_a_five_bar(2);
}

/// Machines each with exact and with noisy drives that ended elsewhere while noise was the stated one from the start, 7 to 20
/// standard deviations off. `cargo bench --bench unknown_poses` counts all.
pub(crate) fn lead_to_the_machine(drives: &str, seeds: &[u64]) {
    for &seed in seeds {
        let drawn = robots::drawn("hexapod", drives);
        let measured = Measured::new(drawn, "Full", (&[POSITIONS], 40), |simulation| {
            simulation.seed = seed;
            let [links, tracks] = [1.0; 2];
            simulation.build = Build::Drawn { links, tracks };
        });
        let found = measured.fit(&Options::default());
        assert!(found.is_consistent(), "{seed}: {}", found.chi2);
        let most = largest_deviation(&found, &measured.made.truth.machine);
        assert!(most < 5.0, "{seed}: {most}");
    }
}

pub(crate) const NOISY_DRIVES: &str = "[drives]\nnoise_m = 1e-5\n";

#[test]
fn positions_of_a_hexapod_lead_to_the_machine() {
    lead_to_the_machine("", &[643]);
    lead_to_the_machine(NOISY_DRIVES, &[218, 906]);
}
