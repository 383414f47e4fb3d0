//! Repeatability beside lack of fit where poses are unknown: on machines of which the truth is known.

use std::collections::{BTreeMap, BTreeSet};

use tau::calibration::Options;
use tau::measurements::PlateKind;
use tau::robot_file::RobotFile;
use tau::simulation::{Effect, Measure, Noise, Simulation};
use tau::trust::{Reason, Status, Verdict};
use tau::unknown_poses::{KindRepeats, UnknownPoses};
use tau::weighing::Treatment;
use tau_testkit::{Random, Table, Work, list, number, robots, said};

use crate::unknown_poses::Measured;

/// Standard deviations that one of twelve sums exceeds, on either side, once in ten thousand runs.
const RARE: f64 = 4.46;
/// Noise of the measurements (m).
const NOISE_M: f64 = 1e-5;
/// Noise of the drives (m).
const DRIVES_M: f64 = 2e-5;
const ESTIMATED: &str =
    "[noise.heights]\nheight_m = \"estimate\"\n[noise.distances]\ndistance_m = \"estimate\"\n";

/// Heights and distances of a printer, three readings each.
fn heights(more: &str, change: impl FnOnce(&mut Simulation)) -> Measured {
    let drawn = robots::drawn("linear_delta", more);
    let measures = [Measure::Rows(PlateKind::Height), Measure::Distances];
    Measured::new(drawn, "Basic", (&measures, 25), |simulation| {
        simulation.readings = 3;
        change(simulation);
    })
}

/// Four readings of positions, and of drives with noise, of which each moves two links of a plate that keeps level.
fn positions(seed: u64) -> Measured {
    let robot = robots::described(&robots::text("linear_delta"));
    let noise = format!(
        "robot = \"LinearDelta\"\n[noise]\nposition_m = {NOISE_M:e}\nrotation_rad = 4e-5\n"
    );
    let file = |more: &str| {
        let file = RobotFile::parse_for(&format!("{noise}{more}"), "robot.toml", &robot);
        file.unwrap().completed(&robot)
    };
    let drawn = (robot.clone(), file(""));
    let measures = [Measure::Rows(PlateKind::Position)];
    let mut measured = Measured::new(drawn, "Full", (&measures, 24), |simulation| {
        simulation.seed = seed;
        simulation.readings = 4;
    });
    let mut random = Random(seed);
    for row in &mut measured.made.folder.plate_rows {
        for command in &mut row.commands_m {
            *command += DRIVES_M * random.normal();
        }
    }
    measured.file = file(&format!("[drives]\nnoise_m = {DRIVES_M:e}\n"));
    measured
}

/// The fit that leaves no reading out.
fn fit(measured: &Measured) -> UnknownPoses {
    measured.fit(&Options {
        treatment: Treatment {
            loss: None,
            keep_outliers: true,
        },
        ..Options::default()
    })
}

fn repeats_of(found: &UnknownPoses, file: &str) -> KindRepeats {
    let own = found.kinds.iter().find(|fit| fit.kind.of.file() == file);
    own.unwrap().repeats.unwrap()
}

/// Codes of what a verdict says of a file, or of several.
fn said_of(verdict: &Verdict, file: &str) -> Vec<String> {
    let facts = verdict.why.iter().flat_map(Reason::facts);
    let of_file = facts.filter(|fact| {
        let mut all = [&fact.file, &fact.place].into_iter().flatten();
        all.any(|own| own.contains(file))
    });
    of_file.map(|fact| fact.code.to_string()).collect()
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

/// Under a right model p-values are evenly spread, by mean and variance, and readings scatter as simulated. Of the six closures
/// of a reading three tell of noise, since a drive moves two links.
pub(crate) fn right_models_repeat_as_simulated(machines: u64) {
    let mut by_kind: BTreeMap<&str, Vec<KindRepeats>> = BTreeMap::new();
    for seed in 1..=machines {
        let measured = heights("", |simulation| simulation.seed = seed);
        let found = fit(&measured);
        let heights = measured.made.folder.plate_rows.iter();
        let distances = measured.made.folder.distances.iter();
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
            by_kind.entry(file).or_default().push(repeats);
        }
        let found = fit(&positions(seed));
        for file in ["tcp_positions.csv", "drives"] {
            let repeats = repeats_of(&found, file);
            if file == "drives" {
                assert_eq!((repeats.quantities, repeats.readings), (144, 576));
                assert!((repeats.degrees - 216.0).abs() < 1e-9, "{repeats:?}");
            }
            by_kind.entry(file).or_default().push(repeats);
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
        assert_eq!(tests.len() as u64, machines, "{file}");
        let count = tests.len() as f64;
        // A uniform number less its mean has the variance 1/12, its square the variance 1/180.
        let mean = tests.iter().sum::<f64>() / count;
        assert!(mean.abs() < RARE / (12.0 * count).sqrt(), "{file}: {mean}");
        let square = tests.iter().map(|own| own * own).sum::<f64>() / count;
        let off = (square - 1.0 / 12.0).abs();
        assert!(off < RARE / (180.0 * count).sqrt(), "{file}: {square}");
    }
}

#[test]
fn right_models_have_the_noise_that_was_simulated() {
    right_models_repeat_as_simulated(3);
}

/// A misfit of the model is told from noise that is larger than stated, also where noise is estimated. Most of a stated noise may
/// be what the machine does not repeat, which readings of a pose share: they scatter by less, and the noise is stated rightly.
#[test]
fn an_effect_shows_as_lack_of_fit_and_noise_as_scatter() {
    type Change = fn(&mut Simulation);
    let effect: Change = |simulation| {
        let text = "rack_pitch(a): sine=8e-5, period=0.0133";
        let parsed = Effect::parse(text, &simulation.robot, "effect");
        simulation.effects = vec![parsed.unwrap()];
    };
    let noisy: Change = |simulation| {
        simulation.noise = Noise {
            scale: [3.0; 3],
            ..Noise::default()
        };
    };
    let shared: Change = |simulation| {
        simulation.readings = 10;
        simulation.noise = Noise {
            visit: 0.9,
            ..Noise::default()
        };
    };
    // What is said of heights, and whether of drives that are stated to be exact.
    for (more, change, code, or_drives) in [
        ("", effect, "T327", true),
        (ESTIMATED, effect, "T327", true),
        ("", noisy, "T326", false),
        ("", shared, "T328", true),
    ] {
        let found = fit(&heights(more, change));
        let repeats = repeats_of(&found, "heights.csv");
        let test = repeats.lack_of_fit.unwrap();
        let has_misfit = code != "T326";
        assert_eq!(test.p_value < 1e-6, has_misfit, "{test:?}");
        assert!(has_misfit || test.p_value > 1e-4, "{test:?}");
        let verdict = found.verdict();
        let mut said_of_heights = said_of(&verdict, "heights.csv");
        said_of_heights.retain(|own| ["T305", "T326", "T327", "T328"].contains(&own.as_str()));
        assert_eq!(said_of_heights, [code], "{}", verdict.reasons());
        let all = said(&verdict.reasons());
        assert_eq!(all.contains(&"T329".to_owned()), or_drives, "{all:?}");
        if code == "T327" {
            // 50 degrees of freedom: 3.9 standard deviations of a standard deviation are 39 %.
            let ratio = repeats.sigma / NOISE_M;
            assert!((ratio - 1.0).abs() < 0.39, "{repeats:?}");
            assert!(
                test.over_noise > 1.5 && repeats.missed > NOISE_M,
                "{test:?}"
            );
            assert_eq!(verdict.status, Status::Inconsistent);
        }
    }
}

/// Mean squares of errors over their standard deviations, as stated and widened, of a robot measured with readings that share
/// half of their variance.
pub(crate) fn squares_of_errors(measured: &str, seeds: u64) -> [f64; 2] {
    let [mut stated, mut widened, mut count] = [0.0; 3];
    for seed in 1..=seeds {
        let work = Work::simulated(&format!(
            "--model linear_delta {measured} --random --poses 25 --readings 4 --visit-noise 0.5 --seed {seed}"
        ));
        let truth = work.truth();
        let found = work.calibrated("--variant Full --split all");
        for own in list(&found["parameters"]) {
            // Others are of what measures.
            let Some(truth) = truth["parameters"][own["name"].as_str().unwrap()].as_f64() else {
                continue;
            };
            let error = number(&own["value"]) - truth;
            stated += (error / number(&own["sigma"])).powi(2);
            widened += (error / number(&own["sigma_widened"])).powi(2);
            count += 1.0;
        }
    }
    assert!(count > 7.0 * seeds as f64, "{count}");
    [stated / count, widened / count]
}

/// Readings that share half of their variance: four of them are worth 1.6, and deviations by noise of each are too small
/// by √2.5. Widened, they are those of the errors.
#[test]
fn deviations_are_widened_by_what_readings_share() {
    let [stated, widened] = squares_of_errors("--measure heights,distances", 1);
    assert!(stated > 1.9 * widened, "{stated}, {widened}");
    // χ² of seven, since errors of one machine go together, beyond one of ten thousand.
    assert!(widened < 29.9 / 7.0, "{widened}");
}

/// Of noise that is estimated from residuals the verdict says that their size tells nothing. Where readings are repeated
/// their scatter does, and finds nothing in a right model.
pub(crate) fn estimated_noise_proves_no_model(machines: u64) {
    let mut alarms = 0;
    for seed in 1..=machines {
        for readings in [1, 3] {
            let measured = heights(ESTIMATED, |simulation| {
                simulation.seed = 500 + seed;
                simulation.readings = readings;
            });
            let verdict = fit(&measured).verdict();
            alarms += usize::from(verdict.status > Status::Consistent);
            let said = said_of(&verdict, "heights.csv");
            // By the size of residuals, or beside what repeats tell.
            let [code, other] = [["T379", "T380"], ["T380", "T379"]][usize::from(readings > 1)];
            let has = |code: &str| said.iter().any(|own| own == code);
            assert!(has(code) && !has(other), "{}", verdict.reasons());
        }
    }
    // One in a thousand is allowed to be.
    let trials = u32::try_from(2 * machines).unwrap();
    let rare = tau_testkit::rare_count(trials, 1e-3);
    assert!(alarms <= rare, "{alarms} of {trials}");
}

#[test]
fn noise_that_is_estimated_proves_no_model() {
    estimated_noise_proves_no_model(2);
}

/// Residuals beyond a stated noise are not diluted by many whose noise is estimated.
#[test]
fn stated_noise_is_tested_beside_estimated_noise() {
    let more = "[noise.heights]\nheight_m = \"estimate\"\n";
    let mut measured = heights(more, |simulation| simulation.readings = 1);
    assert_eq!(fit(&measured).verdict().status, Status::Consistent);
    // The distances' own error, of 1.6 times their noise beside it.
    let mut random = Random(1);
    for row in &mut measured.made.folder.distances {
        row.distance_m += 1.6 * NOISE_M * random.normal();
    }
    let verdict = fit(&measured).verdict();
    assert_eq!(verdict.status, Status::Inconsistent, "{:?}", verdict.why);
}

/// From files to the screen and the JSON. Rows that were copied under new numbers repeat to the last digit: that is no
/// repeatability, and no angle is a number of nothing.
#[test]
fn repeats_are_said_by_the_command() {
    let work = Work::simulated(
        "--model linear_delta --measure heights,distances --poses 20 --readings 3 --random",
    );
    let found = work.calibrated("--variant Full --split all");
    let mut kinds = list(&found["kinds"]).iter();
    let heights = kinds.find(|kind| kind["file"] == "heights.csv");
    let repeats = &heights.unwrap()["repeats"];
    assert_eq!(repeats["quantities"], 20);
    assert_eq!(repeats["readings"], 60);
    assert_eq!(repeats["repeatability"]["dof"], 40.0);
    assert!(repeats["lack_of_fit"]["p_value"].is_f64());
    let work = Work::simulated("--model servo_hexapod --random --poses 60 --seed 2");
    work.edit("tcp_poses.csv", |table| {
        for mut row in table.rows.clone().into_iter().take(30) {
            row[0] = (row[0].parse::<u32>().unwrap() + 1000).to_string();
            table.append(&row);
        }
    });
    let ran = work.run("calibrate MEASURED --variant Full --split all --out DIR/c");
    assert!(ran.says("T325") && !ran.out.contains("NaN"), "{}", ran.out);
}

/// Whoever counts poses may give all readings of one the same number.
#[test]
fn readings_may_share_the_number_of_their_pose() {
    let simulated = "--model servo_hexapod --random --poses 40 --readings 2 --seed 2";
    let work = Work::simulated(simulated);
    let apart = work.calibrated("--variant Full --split all");
    let commands = |table: &Table, row: usize| -> Vec<String> {
        let commands = (1..=6).map(|k| table.cell(row, &format!("q{k}_rad")).to_owned());
        commands.collect()
    };
    work.edit("tcp_poses.csv", |table| {
        let first = |row: usize| (1..row).find(|&own| commands(table, own) == commands(table, row));
        let shared: Vec<usize> = (1..=table.rows.len())
            .map(|row| first(row).unwrap_or(row))
            .collect();
        assert!(shared.iter().enumerate().any(|(row, own)| row + 1 != *own));
        for (row, number) in shared.into_iter().enumerate() {
            table.set(row + 1, "pose", number);
        }
    });
    let together = work.calibrated("--variant Full --split all");
    for key in ["chi2", "dof", "status"] {
        assert_eq!(together["fit"][key], apart["fit"][key], "{key}");
    }
    work.edit("tcp_poses.csv", |table| table.set(3, "pose", 1));
    work.run("check MEASURED")
        .refused(&[("T226", "measured/tcp_poses.csv", 4)]);
}
