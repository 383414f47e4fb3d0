//! Machines with more drives than freedoms, whose drives are exact: what the poses do not say of the closures binds
//! parameters, and is neither residual nor noise.

use std::ops::RangeInclusive;

use serde_json::Value;
use tau::robot_file::RobotFile;
use tau_testkit::{Work, effects, list, number, reasons, robots};

/// Links that grow by half a millimetre and more, where poses are measured to 10 µm.
const GROWING: &str = "--measure poses --warming 8 --effect link_thermal(all):expansion=";

fn simulated(robot: &str, seed: u64, more: &str) -> Work {
    Work::simulated(&format!(
        "--model {robot} --variant Full --random --poses 100 --seed {seed} {more}"
    ))
}

fn evaluated(work: &Work, file: &str) -> Value {
    let line = format!("evaluate MEASURED --robot DIR/{file} --variant Full --force");
    work.json(&line)["fit"].take()
}

/// χ² over its expectation, by the file of the calibration and by that of the drawing. Closures that exact drives hold, counted
/// among the residuals, would halve it: what is left are the coordinates that were measured.
pub(crate) fn chi2_is_that_of_coordinates(robot: &str, seeds: RangeInclusive<u64>) {
    let mut sums = [[0.0; 2]; 2];
    for seed in seeds {
        let work = simulated(robot, seed, "--measure poses");
        work.calibrated("--variant Full");
        let files = ["out/robot.toml", "measured/robot.toml"];
        for (sums, file) in sums.iter_mut().zip(files) {
            let fit = evaluated(&work, file);
            assert_eq!(fit["status"], "consistent", "{robot} {seed} {file}");
            let dof = number(&fit["dof"]);
            sums[0] += number(&fit["chi2"]);
            sums[1] += dof;
            let coordinates = list(&fit["by_file"]).iter();
            let coordinates: f64 = coordinates
                .filter(|own| own["file"] != "drives")
                .map(|own| number(&own["rows"]))
                .sum();
            assert!((dof / coordinates - 1.0).abs() < 0.15, "{robot}: {fit}");
            if file == files[0] {
                assert!((dof / coordinates - 1.0).abs() < 0.01, "{robot}: {fit}");
                // The same number is said.
                let said = number(&fit["reasons"][0]["values"]["expected"]);
                assert!((said / dof - 1.0).abs() < 1e-9, "{fit}");
            }
        }
    }
    for [chi2, dof] in sums {
        // Of a sum of so many squares, once in ten thousand.
        let level = 3.89 * (2.0 / dof).sqrt();
        assert!((chi2 / dof - 1.0).abs() < level, "{robot}: {chi2} {dof}");
    }
}

#[test]
fn chi2_is_that_of_the_measured_coordinates() {
    for robot in ["four_belts", "four_lines"] {
        chi2_is_that_of_coordinates(robot, 1..=1);
    }
}

/// Drives that contradict each other since the model lacks something are no wrong noise and no other machine, though residuals
/// are some hundred times the noise.
#[test]
fn what_the_model_lacks_is_found_where_drives_contradict_each_other() {
    for (expansion, range) in [("2e-5", 3.0..300.0), ("3e-4", 100.0..f64::INFINITY)] {
        let work = simulated("four_lines", 5, &format!("{GROWING}{expansion}"));
        let fit = evaluated(&work, "measured/robot.toml");
        assert_eq!(fit["status"], "inconsistent", "{}", fit["why"]);
        let ratio = number(&fit["residual_over_noise"]);
        assert!(range.contains(&ratio), "{ratio}");
        if expansion == "2e-5" {
            let found = work.discovered("--base Full");
            assert_eq!(found["status"], "explained");
            assert_eq!(effects(&found)[0], "link_thermal(all)");
        }
    }
}

/// Where poses are unknown, an offset of 2 mm of one line, measured to 10 µm. The length of a belt is nearly even in what its
/// drive counts, so that the other sign would make up for an error of it.
#[test]
fn unknown_poses_do_not_reconcile_drives_at_any_price() {
    for (robot, seed, least, hidden) in [
        (
            "four_lines",
            5,
            3.0,
            "--measure heights --effect length_offset(a):offset=2e-3",
        ),
        (
            "four_belts",
            7140,
            1.5,
            "--measure positions --effect length_offset(bottom_right):offset=4e-3",
        ),
    ] {
        let work = simulated(robot, seed, hidden);
        let fitted = work.calibrated("--variant Full");
        for fit in [&fitted["fit"], &evaluated(&work, "out/robot.toml")] {
            assert_eq!(fit["status"], "inconsistent", "{robot}: {}", fit["why"]);
            let ratio = number(&fit["residual_over_noise"]);
            assert!((least..200.0).contains(&ratio), "{robot}: {ratio}");
        }
    }
}

/// Links of a drawing contradict each other by millimetres: forward kinematics finds where they miss their lengths least, to
/// the last step, so that steps of a parameter show what its derivative says. A solver that ends where a step gains little
/// of the whole mismatch is off by tens of micrometres, and by a factor of fifty here.
#[test]
fn steps_show_what_derivatives_say_where_links_contradict_each_other() {
    let work = simulated("four_lines", 3, "");
    let found = work.json("sensitivity MEASURED --variant Full");
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
    let work = Work::simulated(
        "--model four_lines --random --poses 120 --payload 2 --warming 8 --noise-drives 1e-5 --seed 1 \
         --effect link_compliance(all):strain=3e-6 --effect link_thermal(all):expansion=3e-5",
    );
    let both = ["link_compliance(all)", "link_thermal(all)"];
    assert_eq!(effects(&work.discovered("")), both);
}

/// Drives whose noise is to be estimated and that have none are held as exact ones are: what is written can be read again,
/// and values are the same.
#[test]
fn noise_that_is_not_there_is_estimated_as_little() {
    let work =
        Work::simulated("--model four_belts --measure positions --random --poses 60 --seed 100");
    let exact = work.calibrated("--variant Full --force");
    let text = work.read("measured/robot.toml");
    let estimate = format!("{text}\n[drives]\nnoise_m = \"estimate\"\n");
    work.write("measured/robot.toml", estimate);
    let found = work.calibrated("--variant Full --force");
    assert_eq!(found["fit"]["status"], "consistent", "{found:#}");
    assert!(reasons(&found["fit"]).contains(&"T378"), "{found:#}");
    for kind in list(&found["kinds"]) {
        assert!(number(&kind["redundancy"]) >= 0.0, "{kind}");
    }
    let both = [&exact, &found].map(|found| list(&found["parameters"]));
    for (exact, own) in both[0].iter().zip(both[1]) {
        let [exact, value, sigma] = [&exact["value"], &own["value"], &own["sigma"]].map(number);
        let off = (value - exact) / sigma;
        assert!(off.abs() < 1.0, "{off}");
    }
    work.run(
        "kinematics forward --variant Full --robot DIR/out/robot.toml --poses MEASURED/tcp_positions.csv",
    )
    .done();
}

/// A base that contradicts exact drives is searched from with noise of links; what is found, beside which they agree, is told
/// with the values and deviations of a calibration, and calibrated as it was found: with the tolerance of the catalogue as the
/// prior, a calibration would draw an effect of twenty of these back.
#[test]
fn what_reconciles_exact_drives_is_calibrated_as_it_was_found() {
    for (simulate, effect, parameter, size, reason) in [
        (
            "--model four_belts --random --poses 60 --seed 7",
            "length_scale(top_left)",
            "scale",
            3e-4,
            "T308",
        ),
        (
            "--model four_lines --random --poses 120 --seed 7 --payload 5 --noise-force 0.02",
            "link_compliance(a)",
            "strain",
            2e-5,
            "T306",
        ),
    ] {
        let work = Work::simulated(&format!(
            "{simulate} --measure positions --effect {effect}:{parameter}={size:e}"
        ));
        let found = work.discovered("");
        assert_eq!(effects(&found), [effect]);
        // Noise of the measured forces, which no file states, leaves drives that contradict each other.
        let agree = reason == "T308";
        assert_eq!(found["status"] == "explained", agree);
        let own = &found["effects"][0]["parameters"][parameter];
        let [value, sigma] = ["value", "sigma"].map(|key| number(&own[key]));
        assert!((value - size).abs() < 4.0 * sigma, "{effect}: {own}");

        let model = "--model DIR/found/discovered.tau --variant Discovered";
        let fit = work.calibrated(model)["fit"].take();
        assert_eq!(fit["status"] == "consistent", agree, "{fit}");
        let robot = robots::described(&work.read("found/discovered.tau"));
        let read = |file: &str| RobotFile::read(&work.path().join(file), &robot).unwrap();
        let [searched, calibrated] = ["found/robot.toml", "out/robot.toml"].map(read);
        let sigma = |file: &RobotFile, name: &str| file.parameters[name].sigma.as_ref().unwrap()[0];
        // Where drives agree with what was found, values are known as well.
        for name in searched.parameters.keys().filter(|_| agree) {
            let ratio = sigma(&searched, name) / sigma(&calibrated, name);
            assert!((0.85..1.15).contains(&ratio), "{effect}, {name}: {ratio}");
        }
        let of = |file: &RobotFile| file.effects[effect][parameter].clone();
        let (searched, calibrated) = (of(&searched), of(&calibrated));
        let off = (searched.value[0] - calibrated.value[0]).abs();
        let sigma = calibrated.sigma.as_ref().unwrap()[0];
        assert!(off < sigma, "{searched:?} {calibrated:?}");
        assert!((searched.tol / calibrated.tol - 1.0).abs() < 1e-9);
        let line = format!("evaluate MEASURED {model} --robot DIR/found/robot.toml");
        let fit = work.json(&line)["fit"].take();
        assert!(reasons(&fit).contains(&reason), "{fit}");
    }
}

/// Drives that scatter by a fifth of what is stated.
#[test]
fn residuals_far_below_the_noise_are_not_left_to_chance() {
    let work = simulated("four_belts", 5, "--measure positions --noise-drives 1e-4");
    work.replace("noise_m = 0.0001", "noise_m = 0.0005");
    work.calibrated("--variant Full");
    let fit = evaluated(&work, "out/robot.toml");
    assert_eq!(fit["status"], "inconsistent");
    let said = reasons(&fit);
    assert!(
        said.contains(&"T305") && !said.contains(&"T308"),
        "{said:?}"
    );
}

/// Drives that scatter by 2 mm leave 1.4 mm of two belts too many on average: 2 mm of each, over the four. Five times that are
/// allowed.
#[test]
fn links_may_miss_by_what_the_noise_of_drives_makes() {
    let work = simulated("four_belts", 5, "--measure readings --noise-drives 2e-3");
    work.calibrated("--variant Full --split all");
    let forward = |more: &str| {
        work.run(&format!(
            "kinematics forward --model four_belts --variant Full --robot DIR/out/robot.toml {more}"
        ))
    };
    forward("--poses MEASURED/readings.csv").done();
    // One belt too short by a tenth of a metre.
    let ran = forward("--commands 1.8527,1.8527,1.8527,1.7527");
    assert_eq!(ran.code, 1, "{}", ran.out);
    assert_eq!(ran.codes(), ["T508"]);
    assert!(ran.err.contains("7.0 mm"), "{}", ran.err);
}
