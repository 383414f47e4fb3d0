//! Robot files that stand alone: what they were calibrated on, paths of piecewise tracks, effects of the tracker.

use serde_json::Value;
use tau::robot_file::RobotFile;
use tau_testkit::{GANTRY, Work, list, number, robots};

/// A robot file of the folder.
fn file(work: &Work, name: &str) -> RobotFile {
    RobotFile::parse(&work.read(name), "robot.toml").unwrap()
}

fn mean(value: &Value) -> f64 {
    number(&value["position_um"]["mean"])
}

#[test]
fn a_piecewise_file_holds_on_another_folder_of_the_machine() {
    let work = Work::empty();
    // Trackers stand elsewhere in the second one, so that angles against the first one's frame mean nothing there.
    for (folder, seed) in [("a", 1), ("b", 2)] {
        let line = format!("simulate --out DIR/{folder} --exact --seed {seed} --cart-poses 0");
        work.run(&line).done();
    }
    for variant in ["BestPerLink", "FullPiecewise"] {
        let with = format!("--robot DIR/fit/robot.toml --variant {variant}");
        let line = format!("calibrate DIR/a --variant {variant} --out DIR/fit");
        let own = work.json(&line);
        let other = work.json(&format!("evaluate DIR/b {with}"));
        assert_eq!(other["evaluated_on"], "new_folder");
        // And as the start of a calibration on the other folder.
        let again = work.json(&format!("calibrate DIR/b {with} --out DIR/again"));
        for found in [other, again] {
            assert!(
                mean(&found) < 1.5 * mean(&own),
                "{variant}: {} µm",
                mean(&found)
            );
        }
        // Without any folder, too.
        let alone = work.json(&format!("kinematics forward {with} --commands 0,0,0"));
        let x = number(&alone["poses"][0]["position_m"][0]);
        assert!((x + 1.304).abs() < 2e-3, "{variant}: {x}");
    }
}

/// Polynomials scale to the travel of the drives in the folder that calibrated; its file says what that was.
#[test]
fn a_calibration_writes_the_travel_that_its_effects_read() {
    let work = Work::prototype();
    let effect =
        "effect bend on cart { param size: length tol 1 mm; vertical += size * travel^2; }\n";
    let own = std::fs::read_to_string(GANTRY).unwrap();
    let own = robots::extended(&own, "variant Bent = Full + bend(one);");
    work.write("x.tau", format!("{effect}{own}"));
    let with = "--model DIR/x.tau --variant";
    // A folder says how far drives travel; without one the robot file has to.
    let forward = format!("kinematics forward {with} Bent --commands 0.5,0,0 --robot");
    let ran = work.run(&format!("{forward} MEASURED/robot.toml"));
    ran.refused(&[("T257", "measured/robot.toml", 0)]);
    ran.shows("T257");
    let calibrate = |more: &str| work.json(&format!("calibrate MEASURED {with} {more}"));
    calibrate("Full --out DIR/plain");
    assert!(file(&work, "plain/robot.toml").measuring.travel.is_empty());

    let found = calibrate("Bent --out DIR/fit");
    let written = file(&work, "fit/robot.toml");
    // Nothing is said of their noise, which would be another calibration.
    assert!(written.measuring.drives.is_empty());
    let [low, high] = written.measuring.travel[0];
    assert!(low < -0.6 && high > 0.6, "{low} {high}");

    // Alone it moves the plate as it did there, with another travel it does not.
    let x = |robot: &str| {
        let found = work.json(&format!("{forward} {robot}"));
        number(&found["poses"][0]["position_m"][2])
    };
    let text = work.read("fit/robot.toml");
    let (before, after) = text.split_once("travel = [[").unwrap();
    let (_, rest) = after.split_once(']').unwrap();
    work.write("other.toml", format!("{before}travel = [[-0.1, 0.1]{rest}"));
    let ran = work.run(&format!(
        "evaluate MEASURED {with} Bent --robot DIR/other.toml"
    ));
    ran.shows("T258");
    let size = written.effects["bend(one)"]["size"].value[0];
    let off = x("DIR/other.toml") - x("DIR/fit/robot.toml");
    assert!(off.abs() > size.abs(), "{off} {size}");
    // On the folder it has the errors that the calibration said.
    let line = format!("evaluate MEASURED {with} Bent --robot DIR/fit/robot.toml");
    let again = work.json(&line);
    assert!((mean(&again) - mean(&found)).abs() < 1e-3);
}

#[test]
fn a_file_says_where_it_comes_from() {
    let work = Work::empty();
    work.run("calibrate --variant BestPerLink --out DIR/fit -q")
        .done();
    let file = file(&work, "fit/robot.toml");
    assert_eq!(file.to_toml(), work.read("fit/robot.toml"));
    let record = file.calibration.as_ref().unwrap();
    assert_eq!((record.variant.as_str(), record.poses), ("BestPerLink", 61));
    assert_eq!(record.split.to_string(), "alternate");
    assert!(
        record.program.starts_with("tau ") && record.date.len() == 10,
        "{record:?}"
    );
    assert!(record.folder.starts_with("fnv1a64:") && record.folder != record.description);
    for [low, high] in &record.commands_m {
        assert!(-0.66 < *low && low < high && *high < 0.71);
    }
    assert_eq!(record.position_m.len(), 3);
    assert_eq!(file.paths["two"].commands_m.len(), 28);
    assert!(file.reference.is_some() && !file.paths.contains_key("one"));
    // Outside the region it says so, and a variant of which the file holds no covariance is nowhere known as well as where
    // the machine was calibrated.
    for (variant, q, codes) in [
        ("BestPerLink", 0.0, [].as_slice()),
        ("BestPerLink", 0.9, &["T543", "T544"]),
        ("Full", 0.0, &["T254", "T546"]),
    ] {
        let line = "kinematics forward --robot DIR/fit/robot.toml --json - --variant";
        let ran = work.run(&format!("{line} {variant} --commands {q},{q},{q}"));
        let found = ran.clone().json();
        let is_inside = (variant, q) == ("BestPerLink", 0.0);
        assert_eq!(found["poses"][0]["inside"], is_inside, "{variant}");
        assert_eq!(tau_testkit::said(&ran.err), codes, "{}", ran.err);
    }
}

#[test]
fn kinematics_leaves_out_what_is_wrong_with_the_tracker() {
    let work = Work::prototype();
    let scaled = "effect tracker_scale on tcp { param scale: ratio tol 5 ppm; position += scale * (x, y, z); }
    variant Scaled = Full + tracker_scale(tcp);
    variant FullRack";
    let text = std::fs::read_to_string(GANTRY).unwrap();
    work.write("scaled.tau", text.replacen("variant FullRack", scaled, 1));
    let effect = "\n[effects.\"tracker_scale(tcp)\"]\nscale = { value = 1e-3, tol = 1e-3 }\n";
    work.write("robot.toml", work.read("measured/robot.toml") + effect);
    let ask = |what: &str, variant: &str| {
        let with = "--model DIR/scaled.tau --robot DIR/robot.toml --variant";
        work.json(&format!("{what} {with} {variant}"))
    };
    for what in [
        "kinematics forward --commands 0.1,0.2,-0.1",
        "kinematics inverse --pose=-1.3,-4.4,0",
    ] {
        let (full, scaled) = (ask(what, "Full"), ask(what, "Scaled"));
        assert_eq!(full["poses"], scaled["poses"]);
        assert_eq!(scaled["tracker_effects_left_out"][0], "tracker_scale(tcp)");
        assert!(list(&full["tracker_effects_left_out"]).is_empty());
    }
    // Measured poses are compared with the tracker's error: at five metres, five millimetres.
    let [full, scaled] = ["Full", "Scaled"].map(|variant| mean(&ask("evaluate MEASURED", variant)));
    assert!((scaled - full).abs() > 500.0, "{full} µm and {scaled} µm");
    work.run("calibrate MEASURED --model DIR/scaled.tau --variant Scaled --out DIR/fit")
        .done();
    let record = file(&work, "fit/robot.toml").calibration.unwrap();
    assert_eq!(record.tracker_effects, ["tracker_scale(tcp)"]);
}

#[test]
fn discovery_can_fit_what_it_found_to_all_poses() {
    let work =
        Work::simulated("--seed 5 --poses 80 --variant Full --effect backlash(two):gap=4e-4");
    let with = "MEASURED --model DIR/all/discovered.tau --variant Discovered";
    work.run("discover MEASURED --out DIR/all --refit all -q")
        .done();
    work.run(&format!("calibrate {with} --out DIR/half")).done();
    let [all, half] = ["all", "half"].map(|name| file(&work, &format!("{name}/robot.toml")));
    let [smaller, sigma] = [&all, &half].map(|file| {
        let gap = &file.effects["backlash(two)"]["gap"];
        assert!((gap.value[0] - 4e-4).abs() < 5e-5, "{gap:?}");
        gap.sigma.as_ref().unwrap()[0]
    });
    assert!(smaller < sigma, "{smaller} {sigma}");
    let [all, half] = [all, half].map(|file| file.calibration.unwrap());
    assert_eq!(
        (all.split.to_string(), all.poses > 2 * half.poses - 4),
        ("all".to_owned(), true)
    );
    let found = work.json(&format!("evaluate {with} --robot DIR/all/robot.toml"));
    assert_eq!(found["evaluated_on"], "calibration");
}
