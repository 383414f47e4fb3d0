//! Machines with more drives than freedoms, whose drives are exact: what the poses do not say of the closures binds
//! parameters, and is neither residual nor noise.

use std::fs;

use serde_json::Value;

use crate::support::effects;
use crate::support::{number, tau_in};

const ROBOTS: [&str; 2] = ["four_belts", "four_lines"];
/// Links that grow by half a millimetre and more, where poses are measured to 10 µm.
const GROWING: &str = "--measure poses --warming 8 --effect link_thermal(all):expansion=2e-5";

fn simulate(folder: &std::path::Path, robot: &str, seed: u32, more: &str) {
    let line = format!(
        "tau simulate --model {robot} --variant Full --random --poses 100 --seed {seed} {more} --out DIR/measured"
    );
    tau_in(folder, &line).done();
}

fn evaluated(folder: &std::path::Path, robot: &str, file: &str) -> Value {
    let line = format!(
        "tau evaluate DIR/measured --model {robot} --robot DIR/{file} --variant Full --force --json -"
    );
    tau_in(folder, &line).json()["fit"].clone()
}

/// χ² over its expectation, of 800 residuals and more, departs from 1 by four standard deviations, a fifth, less than once in
/// ten thousand times. Closures that exact drives hold, counted among the residuals, would halve it.
#[test]
fn chi2_is_that_of_the_measured_coordinates() {
    for robot in ROBOTS {
        let mut sums = [[0.0; 2]; 2];
        for seed in 1..=8 {
            let folder = tempfile::tempdir().unwrap();
            simulate(folder.path(), robot, seed, "--measure poses");
            let line = format!(
                "tau calibrate DIR/measured --model {robot} --variant Full --out DIR/cal -q"
            );
            tau_in(folder.path(), &line).done();
            let files = ["cal/robot.toml", "measured/robot.toml"];
            for (sums, file) in sums.iter_mut().zip(files) {
                let fit = evaluated(folder.path(), robot, file);
                assert_eq!(fit["status"], "consistent", "{robot} {seed} {file}");
                sums[0] += number(&fit["chi2"]);
                sums[1] += number(&fit["dof"]);
            }
        }
        for [chi2, dof] in sums {
            assert!(dof > 700.0 && dof < 1300.0, "{robot}: {dof}");
            assert!((chi2 / dof - 1.0).abs() < 0.2, "{robot}: {chi2} {dof}");
        }
    }
}

/// Drives that contradict each other since the model lacks something are no wrong noise and no other machine.
#[test]
fn what_the_model_lacks_is_found_where_drives_contradict_each_other() {
    for robot in ROBOTS {
        let folder = tempfile::tempdir().unwrap();
        simulate(folder.path(), robot, 5, GROWING);
        let fit = evaluated(folder.path(), robot, "measured/robot.toml");
        assert_eq!(fit["status"], "inconsistent", "{robot}: {}", fit["why"]);
        // Half a millimetre over 10 µm.
        let ratio = number(&fit["residual_over_noise"]);
        assert!((3.0..300.0).contains(&ratio), "{robot}: {ratio}");
        let line =
            format!("tau discover DIR/measured --model {robot} --base Full --out DIR/out --json -");
        let found = tau_in(folder.path(), &line).json();
        assert_eq!(found["status"], "explained", "{robot}");
        assert_eq!(effects(&found)[0], "link_thermal(all)", "{robot}");
    }
}

/// Residuals of some hundred times the noise are not those of one that is stated a thousand times too small.
#[test]
fn what_the_model_lacks_is_no_wrong_noise() {
    let folder = tempfile::tempdir().unwrap();
    let hidden = GROWING.replace("2e-5", "3e-4");
    simulate(folder.path(), "four_lines", 5, &hidden);
    let fit = evaluated(folder.path(), "four_lines", "measured/robot.toml");
    assert_eq!(fit["status"], "inconsistent", "{}", fit["why"]);
    assert!(number(&fit["residual_over_noise"]) > 100.0);
}

/// Where poses are unknown too: an offset of 2 mm of one line, measured to 10 µm.
#[test]
fn unknown_poses_do_not_reconcile_drives_at_any_price() {
    let folder = tempfile::tempdir().unwrap();
    let hidden = "--measure heights --effect length_offset(a):offset=2e-3";
    simulate(folder.path(), "four_lines", 5, hidden);
    let line =
        "tau calibrate DIR/measured --model four_lines --variant Full --out DIR/cal --json -";
    let fitted = tau_in(folder.path(), line).json();
    let held = evaluated(folder.path(), "four_lines", "cal/robot.toml");
    for fit in [&fitted["fit"], &held] {
        assert_eq!(fit["status"], "inconsistent", "{}", fit["why"]);
        let ratio = number(&fit["residual_over_noise"]);
        assert!((3.0..200.0).contains(&ratio), "{ratio}");
    }
}

/// The length of a belt is nearly even in what its drive counts, so that the other sign would make up for an error of it.
#[test]
fn an_error_of_a_length_is_no_drive_that_counts_the_other_way() {
    let folder = tempfile::tempdir().unwrap();
    let hidden = "--measure positions --effect length_offset(bottom_right):offset=4e-3";
    simulate(folder.path(), "four_belts", 7140, hidden);
    let line =
        "tau calibrate DIR/measured --model four_belts --variant Full --out DIR/cal --json -";
    tau_in(folder.path(), line).done();
    let fit = evaluated(folder.path(), "four_belts", "cal/robot.toml");
    assert_eq!(fit["status"], "inconsistent", "{}", fit["why"]);
}

/// Links of a drawing contradict each other by millimetres: forward kinematics finds where they miss their lengths least, to
/// the last step, so that steps of a parameter show what its derivative says. A solver that ends where a step gains little
/// of the whole mismatch is off by tens of micrometres, and by a factor of fifty here.
#[test]
fn steps_show_what_derivatives_say_where_links_contradict_each_other() {
    let folder = tempfile::tempdir().unwrap();
    simulate(folder.path(), "four_lines", 3, "");
    let line = "tau sensitivity DIR/measured --model four_lines --variant Full --json -";
    let found = tau_in(folder.path(), line).json();
    for (link, parameters) in found["position_mm"].as_object().unwrap() {
        for (parameter, steps) in parameters.as_object().unwrap() {
            let derivative = number(&found["analytic"]["position_mm"][link][parameter]);
            let off = (number(steps) - derivative).abs();
            assert!(off < 0.05, "{link} {parameter}: {steps} {derivative}");
        }
    }
}

/// Growth of all links by hundreds of micrometres enlarges the noise that residuals show a hundred times. An effect that such
/// noise would hide is a candidate all the same, and is found beside it.
#[test]
fn an_effect_hides_no_smaller_one() {
    for seed in 1..=3 {
        let folder = tempfile::tempdir().unwrap();
        let line = format!(
            "tau simulate --model four_lines --random --poses 120 --payload 2 --warming 8 --noise-drives 1e-5 --seed {seed} \
             --effect link_compliance(all):strain=3e-6 --effect link_thermal(all):expansion=3e-5 --out DIR/measured"
        );
        tau_in(folder.path(), &line).done();
        let found = tau_in(
            folder.path(),
            "tau discover DIR/measured --out DIR/found --json -",
        )
        .json();
        let mut named = effects(&found);
        named.sort_unstable();
        assert_eq!(
            named,
            ["link_compliance(all)", "link_thermal(all)"],
            "{seed}"
        );
    }
}

/// An anchor drawn far off is named with the place that the measurements ask for.
#[test]
fn a_dimension_far_off_is_named() {
    for off_m in [0.7, 2.0] {
        let folder = tempfile::tempdir().unwrap();
        simulate(folder.path(), "four_belts", 1, "--measure poses");
        let path = folder.path().join("measured/robot.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let wrong =
            format!("{text}\n[parameters]\nbottom_left_x = {{ value = {off_m}, tol = 0.02 }}\n");
        std::fs::write(&path, wrong).unwrap();
        let line = "tau check DIR/measured --model four_belts --variant Full --json -";
        let ran = tau_in(folder.path(), line);
        assert_eq!(ran.code, 1, "{}", ran.err);
        let found: Value = serde_json::from_str(&ran.out).unwrap();
        let mistakes = found["mistakes"].as_array().unwrap();
        assert_eq!(mistakes.len(), 1, "{mistakes:?}");
        assert_eq!(mistakes[0]["kind"], "dimension");
        assert!(
            mistakes[0]["what"]
                .as_str()
                .unwrap()
                .contains("`bottom_left_x`"),
            "{mistakes:?}"
        );
    }
}

/// Tolerances that are written a thousand times too small are named, and not the noise, which more of would cover as well.
#[test]
fn small_tolerances_are_named() {
    let dimensions = [
        ("top_left_x", 0.0, 2e-2),
        ("top_left_y", 2.0, 2e-2),
        ("top_right_x", 3.4, 2e-2),
        ("top_right_y", 2.0, 2e-2),
        ("bottom_left_x", 0.0, 2e-2),
        ("bottom_left_y", 0.0, 2e-2),
        ("bottom_right_x", 3.4, 2e-2),
        ("bottom_right_y", 0.0, 2e-2),
        ("arm", 0.12, 1e-3),
        ("height", 0.04, 3e-3),
        ("zero", 0.0, 2e-3),
    ];
    for seed in [1, 2, 3] {
        let folder = tempfile::tempdir().unwrap();
        simulate(folder.path(), "four_belts", seed, "--measure poses");
        let path = folder.path().join("measured/robot.toml");
        let mut text = std::fs::read_to_string(&path).unwrap() + "\n[parameters]\n";
        for (name, value, tolerance) in dimensions {
            let tolerance = 1e-3 * tolerance;
            text += &format!("{name} = {{ value = {value:?}, tol = {tolerance:?} }}\n");
        }
        std::fs::write(&path, text).unwrap();
        let line = "tau check DIR/measured --model four_belts --variant Full --json -";
        let ran = tau_in(folder.path(), line);
        let found: Value = serde_json::from_str(&ran.out).unwrap();
        let mistakes = found["mistakes"].as_array().unwrap();
        assert_eq!(mistakes.len(), 1, "{seed}: {mistakes:?}");
        assert_eq!(mistakes[0]["kind"], "tolerances", "{seed}: {mistakes:?}");
    }
}

/// Belts by positions, with effects, and the folder that `simulate` writes.
fn positions(folder: &std::path::Path, robot: &str, more: &str) {
    let line = format!(
        "tau simulate --model {robot} --measure positions --random --poses 60 {more} --out DIR/measured -q"
    );
    tau_in(folder, &line).done();
}

/// Drives whose noise is to be estimated and that have none are held as exact ones are: what is written can be read again,
/// and values are the same.
#[test]
fn noise_that_is_not_there_is_estimated_as_little() {
    for robot in ROBOTS {
        let folder = tempfile::tempdir().unwrap();
        positions(folder.path(), robot, "--seed 100");
        let path = folder.path().join("measured/robot.toml");
        let text = std::fs::read_to_string(&path).unwrap();
        let calibrated = || {
            let line = "tau calibrate DIR/measured --variant Full --force --out DIR/cal --json -";
            tau_in(folder.path(), line).json()
        };
        let exact = calibrated();
        let estimate = format!("{text}\n[drives]\nnoise_m = \"estimate\"\n");
        std::fs::write(&path, estimate).unwrap();
        let found = calibrated();
        assert_eq!(found["fit"]["status"], "consistent", "{found:#}");
        let why = found["fit"]["why"].to_string();
        assert!(why.contains("was estimated to be no more than"), "{why}");
        for kind in found["kinds"].as_array().unwrap() {
            assert!(number(&kind["redundancy"]) >= 0.0, "{kind}");
        }
        let pairs = |found: &Value| {
            let own = found["parameters"].as_array().unwrap();
            let pair = |own: &Value| (number(&own["value"]), number(&own["sigma"]));
            own.iter().map(pair).collect::<Vec<_>>()
        };
        for ((exact, _), (own, sigma)) in pairs(&exact).into_iter().zip(pairs(&found)) {
            assert!((own - exact).abs() < sigma, "{own} ± {sigma} of {exact}");
        }
        let line = "tau kinematics forward --variant Full --robot DIR/cal/robot.toml \
                    --poses DIR/measured/tcp_positions.csv";
        tau_in(folder.path(), line).done();
    }
}

/// A base that contradicts exact drives is searched from with noise of links; what is found beside which they agree is told with
/// the values and deviations of a calibration.
#[test]
fn what_reconciles_exact_drives_is_told_with_its_own_deviations() {
    let folder = tempfile::tempdir().unwrap();
    let effect = "--seed 7 --effect length_scale(top_left):scale=3e-4";
    positions(folder.path(), "four_belts", effect);
    let found = tau_in(
        folder.path(),
        "tau discover DIR/measured --out DIR/found --json -",
    )
    .json();
    assert_eq!(effects(&found), ["length_scale(top_left)"]);
    assert!(
        found["remarks"].to_string().contains("they agree"),
        "{found:#}"
    );
    let scale = &found["effects"][0]["parameters"]["scale"];
    let [scale, sigma] = ["value", "sigma"].map(|key| number(&scale[key]));
    assert!(
        (scale - 3e-4).abs() < 4.0 * sigma && sigma < 1e-7,
        "{scale} ± {sigma}"
    );
    let line = "tau calibrate DIR/measured --model DIR/found/discovered.tau --variant Discovered --out DIR/cal -q";
    tau_in(folder.path(), line).done();
    let sigmas = |path: &str| {
        let text = std::fs::read_to_string(folder.path().join(path)).unwrap();
        let sigma = |name: &str| {
            let line = text.lines().find(|line| line.starts_with(name)).unwrap();
            let (_, sigma) = line.split_once("sigma = ").unwrap();
            sigma.trim_end_matches(" }").parse::<f64>().unwrap()
        };
        ["top_right_x", "top_right_y", "bottom_left_x", "height"].map(sigma)
    };
    let pairs = sigmas("found/robot.toml")
        .into_iter()
        .zip(sigmas("cal/robot.toml"));
    for (searched, calibrated) in pairs {
        let ratio = searched / calibrated;
        assert!((0.85..1.15).contains(&ratio), "{searched} of {calibrated}");
    }
}

/// An effect of twenty tolerances of the catalogue: with these as the prior, a calibration would draw it back to 1.8e-5.
#[test]
fn what_was_found_is_calibrated_as_it_was_found() {
    for (robot, link) in [("four_lines", "a"), ("four_belts", "top_left")] {
        let folder = tempfile::tempdir().unwrap();
        let line = format!(
            "tau simulate --model {robot} --random --poses 120 --seed 7 --measure positions --payload 5 --noise-force 0.02 \
             --effect link_compliance({link}):strain=2e-5 --out DIR/measured"
        );
        tau_in(folder.path(), &line).done();
        let line = "tau discover DIR/measured --out DIR/out --json -";
        let found = tau_in(folder.path(), line).json();
        assert_eq!(effects(&found), [format!("link_compliance({link})")]);
        assert_eq!(found["status"], "explained", "{robot}");
        let strain = number(&found["effects"][0]["parameters"]["strain"]["value"]);
        let model = "--model DIR/out/discovered.tau --variant Discovered";
        let line = format!("tau calibrate DIR/measured {model} --out DIR/cal --json -");
        let fitted = tau_in(folder.path(), &line).json();
        let fit = &fitted["fit"];
        assert_eq!(fit["status"], "consistent", "{robot}: {fit}");
        for file in ["out", "cal"] {
            let text = fs::read_to_string(folder.path().join(file).join("robot.toml")).unwrap();
            let own = text.split("strain = ").nth(1).unwrap();
            let [value, tol, sigma] = ["value = ", "tol = ", "sigma = "].map(|key| {
                let rest = own.split(key).nth(1).unwrap();
                let number = rest.split([',', ' ']).next().unwrap();
                number.parse::<f64>().unwrap()
            });
            assert!((tol - 1e-5).abs() < 1e-10, "{robot}: {tol}");
            assert!(
                (value - strain).abs() < 3.0 * sigma,
                "{robot}: {value} {sigma}"
            );
        }
        let line = format!("tau evaluate DIR/measured {model} --robot DIR/out/robot.toml --json -");
        let why = tau_in(folder.path(), &line).json()["fit"]["why"].to_string();
        assert!(
            why.contains("exact drives that contradict each other"),
            "{why}"
        );
    }
}

/// Drives that scatter by a fifth of what is stated.
#[test]
fn residuals_far_below_the_noise_are_not_left_to_chance() {
    let folder = tempfile::tempdir().unwrap();
    simulate(
        folder.path(),
        "four_belts",
        5,
        "--measure positions --noise-drives 1e-4",
    );
    let path = folder.path().join("measured/robot.toml");
    let text = fs::read_to_string(&path).unwrap();
    assert!(text.contains("noise_m = 0.0001"), "{text}");
    fs::write(&path, text.replace("noise_m = 0.0001", "noise_m = 0.0005")).unwrap();
    let line = "tau calibrate DIR/measured --model four_belts --variant Full --out DIR/cal -q";
    tau_in(folder.path(), line).done();
    let fit = evaluated(folder.path(), "four_belts", "cal/robot.toml");
    assert_eq!(fit["status"], "consistent");
    let why = fit["why"].to_string();
    assert!(why.contains("the noise is stated too large"), "{why}");
    assert!(!why.contains("as chance allows"), "{why}");
}

/// Drives that scatter by 2 mm leave 1.4 mm of two belts too many on average: 2 mm of each, over the four.
#[test]
fn links_may_miss_by_what_the_noise_of_drives_makes() {
    let folder = tempfile::tempdir().unwrap();
    simulate(
        folder.path(),
        "four_belts",
        5,
        "--measure readings --noise-drives 2e-3",
    );
    let line =
        "tau calibrate DIR/measured --model four_belts --variant Full --split all --out DIR/cal -q";
    tau_in(folder.path(), line).done();
    let forward = |more: &str| {
        let line = format!(
            "tau kinematics forward --model four_belts --variant Full --robot DIR/cal/robot.toml {more}"
        );
        tau_in(folder.path(), &line)
    };
    forward("--poses DIR/measured/readings.csv").done();
    // One belt too short by a tenth of a metre.
    let ran = forward("--commands 1.8527,1.8527,1.8527,1.7527");
    assert_eq!(ran.code, 1, "{}", ran.out);
    assert!(ran.err.contains("allowed are 7.0 mm"), "{}", ran.err);
}
