//! Repeatability beside lack of fit where poses are unknown: on machines of which the truth is known.

use std::collections::{BTreeMap, BTreeSet};

use tau::calibration::Options;
use tau::measurements::{Folder, PlateKind, Split};
use tau::robot_file::RobotFile;
use tau::simulation::{Measure, Noise, Simulation, simulate};
use tau::trust::Status;
use tau::unknown_poses::{KindRepeats, RowDivision, UnknownPoses, calibrate};
use tau::weighing::Treatment;

use crate::support::{Random, tau_in};
use crate::support::{robot, simulation};
use tau::Setup;

const MACHINES: u64 = 40;
/// Standard deviations that one of twelve sums exceeds, on either side, once in a thousand runs.
const RARE: f64 = 3.94;
/// Noise of the measurements (m).
const NOISE_M: f64 = 1e-5;
/// Beginning of what is said where exact drives may not be.
const OR_DRIVES: &str = "Or the drives do not repeat as well as readings at one place";
/// Noise of the drives (m).
const DRIVES_M: f64 = 2e-5;

fn fit(variant: &str, file: &RobotFile, folder: &Folder) -> UnknownPoses {
    let (robot, _) = robot("linear_delta", "");
    let division = RowDivision::of(folder, Split::All);
    let variant = robot.variant(variant).unwrap();
    let options = Options {
        treatment: Treatment {
            loss: None,
            keep_outliers: true,
        },
        ..Options::default()
    };
    calibrate(
        Setup::new(&robot, variant, file, folder),
        &division,
        &options,
    )
    .unwrap()
}

fn repeats_of(found: &UnknownPoses, file: &str) -> KindRepeats {
    let own = found.kinds.iter().find(|fit| fit.kind.of.file() == file);
    own.unwrap().repeats.unwrap()
}

/// Heights and distances, three readings each.
fn heights(more: &str, change: impl FnOnce(&mut Simulation)) -> (RobotFile, Folder) {
    let (robot, file) = robot("linear_delta", more);
    let measures = [Measure::Rows(PlateKind::Height), Measure::Distances];
    let mut simulation = Simulation {
        readings: 3,
        ..simulation(&robot, &file, "Nominal", &measures, 25)
    };
    change(&mut simulation);
    (file, simulate(&simulation).unwrap().folder)
}

/// Four readings of positions, and of drives with noise.
fn positions(variant: &str, seed: u64) -> (RobotFile, Folder) {
    let (robot, file) = robot("linear_delta", "");
    let measures = [Measure::Rows(PlateKind::Position)];
    let simulated = simulate(&Simulation {
        seed,
        readings: 4,
        ..simulation(&robot, &file, variant, &measures, 20)
    });
    let mut folder = simulated.unwrap().folder;
    let mut random = Random(seed);
    for row in &mut folder.plate_rows {
        for command in &mut row.commands_m {
            *command += DRIVES_M * random.normal();
        }
    }
    let noisy = format!("[drives]\nnoise_m = {DRIVES_M:e}\n");
    (crate::support::robot("linear_delta", &noisy).1, folder)
}

/// Pooled standard deviation of values about the means of their groups, and the number of these.
fn pooled<K: Ord>(values: impl Iterator<Item = (K, f64)>) -> (f64, usize) {
    let mut groups: BTreeMap<K, Vec<f64>> = BTreeMap::new();
    values.for_each(|(key, value)| groups.entry(key).or_default().push(value));
    let (mut squares, mut degrees) = (0.0, 0.0);
    for own in groups.values() {
        let mean = own.iter().sum::<f64>() / own.len() as f64;
        squares += own.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        degrees += own.len() as f64 - 1.0;
    }
    ((squares / degrees).sqrt(), groups.len())
}

/// Under a right model p-values are evenly spread, by mean and variance, and readings scatter as simulated.
#[test]
fn right_models_have_even_p_values_and_the_noise_that_was_simulated() {
    let mut by_kind: BTreeMap<&str, Vec<KindRepeats>> = BTreeMap::new();
    for seed in 1..=MACHINES {
        let (file, folder) = heights("", |simulation| simulation.seed = seed);
        let found = fit("Nominal", &file, &folder);
        for file in ["heights.csv", "distances.csv"] {
            by_kind
                .entry(file)
                .or_default()
                .push(repeats_of(&found, file));
        }
        let heights = folder.plate_rows.iter();
        let distances = folder.distances.iter();
        let by_hand = [
            pooled(heights.map(|row| (row.pose, row.values[0].unwrap()))),
            // A distance is that from either end.
            pooled(distances.map(|row| (BTreeSet::from(row.poses), row.distance_m))),
        ];
        for (file, (sigma, quantities)) in ["heights.csv", "distances.csv"].iter().zip(by_hand) {
            let repeats = repeats_of(&found, file);
            assert_eq!(repeats.quantities, quantities, "{file}");
            let ratio = repeats.sigma / sigma;
            assert!((ratio - 1.0).abs() < 1e-6, "{file}: {ratio}");
        }
        let (file, folder) = positions("Nominal", seed);
        let found = fit("Nominal", &file, &folder);
        for file in ["tcp_positions.csv", "drives"] {
            by_kind
                .entry(file)
                .or_default()
                .push(repeats_of(&found, file));
        }
    }
    for (file, all) in by_kind {
        let noise_m = if file == "drives" { DRIVES_M } else { NOISE_M };
        let degrees: f64 = all.iter().map(|own| own.degrees).sum();
        let squares: f64 = all.iter().map(|own| own.degrees * own.sigma.powi(2)).sum();
        let variance = squares / degrees / noise_m.powi(2);
        let spread = (2.0 / degrees).sqrt();
        assert!((variance - 1.0).abs() < RARE * spread, "{file}: {variance}");
        let tests: Vec<f64> = (all.iter())
            .filter_map(|own| Some(own.lack_of_fit?.p_value - 0.5))
            .collect();
        assert_eq!(tests.len() as u64, MACHINES, "{file}");
        let count = tests.len() as f64;
        // A uniform number less its mean has the variance 1/12, its square the variance 1/180.
        let mean = tests.iter().sum::<f64>() / count;
        assert!(mean.abs() < RARE / (12.0 * count).sqrt(), "{file}: {mean}");
        let square = tests.iter().map(|own| own * own).sum::<f64>() / count;
        let off = (square - 1.0 / 12.0).abs();
        assert!(off < RARE / (180.0 * count).sqrt(), "{file}: {square}");
    }
}

/// A misfit of the model is told from noise that is larger than stated, also where noise is estimated.
#[test]
fn an_effect_shows_as_lack_of_fit_and_noise_as_scatter() {
    let effect = |simulation: &mut Simulation| {
        let text = "rack_pitch(a): sine=8e-5, period=0.0133";
        let parsed = tau::simulation::Effect::parse(text, &simulation.robot, "effect");
        simulation.effects = vec![parsed.unwrap()];
    };
    let (file, folder) = heights("", effect);
    let found = fit("Nominal", &file, &folder);
    let repeats = repeats_of(&found, "heights.csv");
    // 50 degrees of freedom: four standard deviations of a standard deviation are 40 %.
    assert!((repeats.sigma / NOISE_M - 1.0).abs() < 0.4, "{repeats:?}");
    let test = repeats.lack_of_fit.unwrap();
    assert!(test.p_value < 1e-6 && test.over_noise > 2.0, "{test:?}");
    assert!(repeats.missed > NOISE_M, "{repeats:?}");
    let why = found.verdict().reasons();
    assert!(why.contains("Readings of heights.csv repeat to"), "{why}");
    assert!(why.contains("it lacks something."), "{why}");
    assert!(why.contains(OR_DRIVES), "{why}");
    assert!(!why.contains("too small"), "{why}");

    let (file, folder) = heights("", |simulation| {
        simulation.noise = Noise {
            scale: [3.0; 3],
            ..Noise::default()
        };
    });
    let found = fit("Nominal", &file, &folder);
    let test = repeats_of(&found, "heights.csv").lack_of_fit.unwrap();
    assert!(test.p_value > 1e-3, "{test:?}");
    let why = found.verdict().reasons();
    let expected = "The stated noise of heights.csv is too small: readings of one value scatter by";
    assert!(why.contains(expected), "{why}");
    assert!(!why.contains("lacks something"), "{why}");

    let estimated =
        "[noise.heights]\nheight_m = \"estimate\"\n[noise.distances]\ndistance_m = \"estimate\"\n";
    let (file, folder) = heights(estimated, effect);
    let found = fit("Nominal", &file, &folder);
    let repeats = repeats_of(&found, "heights.csv");
    assert!((repeats.sigma / NOISE_M - 1.0).abs() < 0.4, "{repeats:?}");
    assert!(repeats.lack_of_fit.unwrap().p_value < 1e-6, "{repeats:?}");
    let verdict = found.verdict();
    let why = verdict.reasons();
    assert!(why.contains("it lacks something."), "{why}");
    assert!(why.contains(OR_DRIVES), "{why}");
    assert_eq!(verdict.status, Status::Inconsistent);
}

/// Most of the stated noise is what the machine does not repeat, which readings of a pose share: they scatter by less, and
/// the noise is stated rightly.
#[test]
fn noise_that_readings_share_is_not_stated_too_large() {
    let (file, folder) = heights("", |simulation| {
        simulation.readings = 10;
        simulation.noise = Noise {
            visit: 0.9,
            ..Noise::default()
        };
    });
    let found = fit("Nominal", &file, &folder);
    let test = repeats_of(&found, "heights.csv").lack_of_fit.unwrap();
    assert!(test.p_value < 1e-6, "{test:?}");
    let why = found.verdict().reasons();
    assert!(!why.contains("too large"), "{why}");
    assert!(why.contains(OR_DRIVES), "{why}");
}

/// Readings that share half of their variance: four of them are worth 1.6, and deviations by noise of each are too small
/// by √2.5. Widened, they are those of the parameters' errors.
#[test]
fn deviations_are_widened_by_what_readings_share() {
    let (stated, widened) = squares_of_errors("--measure heights,distances");
    assert!(stated > 1.9 * widened, "{stated}, {widened}");
    // Errors of one machine go together: as if of a third of them, a mean square is known to a quarter.
    assert!((0.4..1.9).contains(&widened), "{widened}");
}

/// Poses that drives with noise and a tracker measure together: the readings of a dwell are of one pose.
#[test]
fn readings_of_a_dwell_share_their_pose_and_the_noise_of_the_drives() {
    let (stated, widened) = squares_of_errors("--noise-drives 5e-6");
    assert!(stated > 1.3 * widened, "{stated}, {widened}");
    // All parameters of a machine share one error: eight squares have a mean beyond 3.3 once in a thousand times.
    assert!((0.1..4.0).contains(&widened), "{widened}");
}

/// Mean squares of errors over their standard deviations, as stated and widened, where readings share half of their variance.
fn squares_of_errors(measured: &str) -> (f64, f64) {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    let [mut stated, mut widened, mut count] = [0.0; 3];
    for seed in 1..=8 {
        run(&format!(
            "tau simulate --model linear_delta {measured} --random --poses 25 --readings 4 \
             --visit-noise 0.5 --seed {seed} --out DIR/{seed}"
        ))
        .done();
        let truth =
            std::fs::read_to_string(folder.path().join(format!("{seed}/truth.json"))).unwrap();
        let truth: serde_json::Value = serde_json::from_str(&truth).unwrap();
        let found = run(&format!(
            "tau calibrate DIR/{seed} --model linear_delta --variant Full --split all --out DIR/out --json -"
        ))
        .json();
        for own in found["parameters"].as_array().unwrap() {
            let number = |key: &str| own[key].as_f64().unwrap();
            let name = own["name"].as_str().unwrap();
            if let Some(truth) = truth["parameters"][name].as_f64() {
                let error = number("value") - truth;
                stated += (error / number("sigma")).powi(2);
                widened += (error / number("sigma_widened")).powi(2);
                count += 1.0;
            }
        }
    }
    assert!(count >= 60.0, "{count}");
    (stated / count, widened / count)
}

/// Of noise that is estimated from residuals the verdict says that their size tells nothing. Where readings are repeated
/// their scatter does, and finds nothing in a right model.
#[test]
fn noise_that_is_estimated_proves_no_model() {
    let asked = std::env::var("MACHINES").ok();
    let machines = asked.and_then(|count| count.parse().ok()).unwrap_or(20);
    let estimated =
        "[noise.heights]\nheight_m = \"estimate\"\n[noise.distances]\ndistance_m = \"estimate\"\n";
    let mut alarms = 0;
    for seed in 1..=machines {
        for readings in [1, 3] {
            let (file, folder) = heights(estimated, |simulation| {
                simulation.seed = 500 + seed;
                simulation.readings = readings;
            });
            let verdict = fit("Nominal", &file, &folder).verdict();
            alarms += u64::from(verdict.status > Status::Consistent);
            let why = verdict.reasons();
            assert!(!why.contains("times their noise"), "{why}");
            let tells_nothing = "the size of its residuals, which says nothing of the model";
            let tells = "of the model its repeated readings tell";
            // By chance a distance is measured twice.
            let mut said = why.split("The noise of ");
            let of_heights = said.find(|own| own.starts_with("heights.csv was estimated"));
            let of_heights = of_heights.expect(&why);
            assert_eq!(of_heights.contains(tells_nothing), readings == 1, "{why}");
            assert_eq!(of_heights.contains(tells), readings > 1, "{why}");
        }
    }
    // One in a thousand is allowed to be.
    assert!(alarms <= 1 + machines / 100, "{alarms} of {machines}");
}

/// Residuals beyond a stated noise are not diluted by many whose noise is estimated.
#[test]
fn stated_noise_is_tested_beside_estimated_noise() {
    let more = "[noise.heights]\nheight_m = \"estimate\"\n";
    let (file, mut folder) = heights(more, |simulation| simulation.readings = 1);
    let consistent = fit("Nominal", &file, &folder);
    assert_eq!(consistent.verdict().status, Status::Consistent);
    // The distances' own error, of 1.6 times their noise beside it.
    let mut random = Random(1);
    for row in &mut folder.distances {
        row.distance_m += 1.6 * NOISE_M * random.normal();
    }
    let found = fit("Nominal", &file, &folder);
    assert_eq!(
        found.verdict().status,
        Status::Inconsistent,
        "{:?}",
        found.verdict().why
    );
}

/// Of the six closures of a reading three tell of noise: a drive moves two links.
#[test]
fn links_of_one_drive_scatter_together() {
    let (file, folder) = positions("Full", 1);
    let repeats = repeats_of(&fit("Full", &file, &folder), "drives");
    assert_eq!((repeats.quantities, repeats.readings), (120, 480));
    assert!((repeats.degrees - 180.0).abs() < 1e-9, "{repeats:?}");
    // Four standard deviations of a standard deviation are 21 %; all six would make it 29 % too small.
    assert!((repeats.sigma / DRIVES_M - 1.0).abs() < 0.21, "{repeats:?}");
}

/// From files to the screen and the JSON.
#[test]
fn repeats_are_said_by_the_command() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| tau_in(folder.path(), line);
    let model = "--model ROBOTS/linear_delta.tau --variant Nominal";
    for readings in [1, 3] {
        run(&format!(
            "tau simulate {model} --measure heights,distances --poses 60 --readings {readings} --random --track-points 0 \
             --cart-poses 0 --out DIR/measured{readings}"
        ))
        .done();
        let calibrate = format!(
            "tau calibrate DIR/measured{readings} {model} --split all --out DIR/out{readings}"
        );
        let said = run(&calibrate).done();
        let found = run(&format!("{calibrate} --json - -q")).json();
        let kinds = found["kinds"].as_array().unwrap();
        let heights = kinds.iter().find(|kind| kind["file"] == "heights.csv");
        let repeats = &heights.unwrap()["repeats"];
        assert_eq!(said.contains("repeat to"), readings > 1, "{said}");
        assert_eq!(repeats.is_null(), readings == 1, "{repeats}");
        if readings > 1 {
            assert_eq!(
                (&repeats["quantities"], &repeats["readings"]),
                (&60.into(), &180.into())
            );
            assert_eq!(repeats["repeatability"]["dof"], 120.0);
            assert!(repeats["lack_of_fit"]["p_value"].is_f64());
        }
    }
}

/// Rows that were copied under new numbers repeat to the last digit: that is no repeatability, and no angle is a number of
/// nothing.
#[test]
fn copied_rows_are_no_repeats() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = "tau simulate --model servo_hexapod --random --poses 60 --seed 2 --out DIR/m";
    tau_in(folder.path(), simulate).done();
    let path = folder.path().join("m/tcp_poses.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let rows = text.lines().skip(1).take(30);
    let copies = rows.map(|row| {
        let (number, rest) = row.split_once(',').unwrap();
        format!("{},{rest}\n", number.parse::<u32>().unwrap() + 1000)
    });
    std::fs::write(&path, copies.fold(text.clone(), |all, copy| all + &copy)).unwrap();
    let calibrate = "tau calibrate DIR/m --variant Full --split all --out DIR/c";
    let said = tau_in(folder.path(), calibrate).done();
    assert!(!said.contains("NaN"), "{said}");
    let flat = said.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(flat.contains("the same to the last digit"), "{said}");
}
