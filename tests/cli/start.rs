//! First steps with a robot of one's own: descriptions that hold their values, `tau init`, sketches.

use tau_testkit::{Work, estimate, list, number, robots};

use crate::PISTONS;

/// A folder with a linear delta of which the description gives everything but the lengths.
fn without_lengths() -> Work {
    let work = Work::empty();
    let text = robots::text("linear_delta");
    let is_kept = |line: &&str| !line.trim_start().starts_with("length = ");
    let lines: Vec<&str> = text.lines().filter(is_kept).collect();
    work.write("delta.tau", lines.join("\n"));
    work
}

#[test]
fn a_description_with_all_values_needs_no_robot_file() {
    let found = Work::empty()
        .json("kinematics forward --model ROBOTS/linear_delta.tau --variant Full --commands 0,0,0");
    let position = list(&found["poses"][0]["position_m"]).iter().map(number);
    for (found, expected) in position.zip([0.0, 0.0, -0.6]) {
        assert!((found - expected).abs() < 1e-5, "{found}");
    }
    let reference = found["reference"]["from"].as_str().unwrap();
    assert!(reference.ends_with("linear_delta.tau"), "{reference}");
}

#[test]
fn init_asks_for_what_the_description_lacks() {
    let work = without_lengths();
    // Without a robot file, one error names them all.
    for line in [
        "kinematics forward --model DIR/delta.tau --variant Full --commands 0,0,0",
        "simulate --model DIR/delta.tau --out MEASURED",
    ] {
        work.run(line).refused(&[("T336", "delta.tau", 0)]);
    }
    let ran = work.run("calibrate --model DIR/delta.tau --variant Full --out DIR/out");
    ran.refused(&[("T265", "FOLDER", 0), ("T336", "delta.tau", 0)]);
    ran.shows("T265");
    ran.shows("T336");

    let init = "init DIR/delta.tau --out DIR/robot.toml";
    work.run(init).done();
    let text = work.read("robot.toml");
    assert!(text.contains("plate_joint_m = { value = [0.05, -0.04, 0.0], tol = 0.0003 }"));
    assert!(text.contains("position_m = [0.0, 0.0, -0.6]"), "{text}");

    // Until it is filled in, every placeholder is refused at its place.
    let forward = "kinematics forward --model DIR/delta.tau --robot DIR/robot.toml --variant Full --commands 0,0,0 --json -";
    let mut blanks = Vec::new();
    for (line, text) in (1..).zip(text.lines()) {
        let count = text.split('#').next().unwrap().matches("\"?\"").count();
        blanks.extend(vec![("T245", "robot.toml", line); count]);
    }
    assert_eq!(blanks.len(), 14);
    let ran = work.run(forward);
    ran.refused(&blanks);
    ran.shows("T245");

    let filled = text
        .replace("position_m = \"?\"", "position_m = 1e-5")
        .replace("rotation_rad = \"?\"", "rotation_rad = 4e-5")
        .replace("value = \"?\", tol = \"?\"", "value = 0.694622, tol = 3e-4");
    work.write("robot.toml", &filled);
    let found = work.run(forward).json();
    assert!((number(&found["poses"][0]["position_m"][2]) + 0.6).abs() < 1e-4);

    let ran = work.run(init);
    ran.refused(&[("T281", "robot.toml", 0)]);
    ran.shows("T281");
    assert_eq!(work.read("robot.toml"), filled);
    work.run(&format!("{init} --force")).done();
    assert_eq!(work.read("robot.toml"), text);
    assert_eq!(work.listing(""), ["delta.tau", "robot.toml"]);
}

/// Descriptions that give nothing, and all; with and without tracks.
#[test]
fn templates_are_refused_for_nothing_but_blanks() {
    for model in ["GANTRY", "ROBOTS/stewart.tau", "ROBOTS/four_track.tau"] {
        let work = Work::empty();
        let line = format!("init {model} --out DIR/robot.toml");
        work.run(&line).done();
        let line = format!("simulate --model {model} --robot DIR/robot.toml --out MEASURED");
        let ran = work.run(&line);
        let codes = ran.codes();
        assert!(codes.len() > 1, "{model}: {}", ran.err);
        assert!(
            codes.iter().all(|code| code == "T245"),
            "{model}: {}",
            ran.err
        );
    }
}

#[test]
fn poses_of_weak_cables_stand_at_the_right_one_of_two_minima() {
    let work = Work::described(include_str!("robots/weak_cables.tau")).with_measured(
        "--seed 3 --measure positions --noise-drives 1e-4 --random --poses 80 --tilt 0.3",
    );
    let found = work.calibrated("--model DIR/own.tau --variant Full --split all");
    assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
    assert_eq!(list(&found["fit"]["mistakes"]).len(), 0);
}

/// Anchors drawn far off need no redundant drives: where positions tell of the machine, its reference is where it is looked
/// for, and no pose that the drawing must have.
#[test]
fn a_sketch_starts_where_the_machine_may_stand() {
    let work = Work::simulated(
        "--model linear_delta --measure positions --poses 80 --random --noise-position 1e-4 --noise-drives 1e-5 --seed 2",
    );
    let drawn = work.read("measured/robot.toml");
    let [one, other] = [[0.088, 0.369, 0.353, 0.251], [0.190, 0.245, 0.371, 0.348]].map(|[radius, a, b, c]| {
        let sketch = format!(
            "[parameters]\nradius = {{ value = {radius}, tol = 0.07 }}\nendstop_a = {{ value = {a}, tol = 0.1 }}\n\
             endstop_b = {{ value = {b}, tol = 0.1 }}\nendstop_c = {{ value = {c}, tol = 0.1 }}\n"
        );
        work.write("measured/robot.toml", format!("{drawn}\n{sketch}"));
        let found = work.calibrated("--variant Full --split all");
        assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
        let radius = estimate(&found, "radius");
        [&radius["value"], &radius["sigma"]].map(number)
    });
    assert!(
        (one[0] - other[0]).abs() < 0.1 * one[1],
        "{one:?} {other:?}"
    );
}

/// Pistons in a plane whose anchors are drawn 0.1 m off, their heights left open: these act by their squares, and hold up no
/// other parameter. Steps by slopes alone creep for 357 and 1231 iterations.
#[test]
fn a_sketch_of_a_plane_machine_may_leave_heights_open() {
    let work = Work::described(PISTONS).with_measured(
        "--measure positions,distances --poses 80 --random --noise-position 1e-4 --noise-drives 1e-4 --seed 4",
    );
    let drawn = work.read("measured/robot.toml");
    for anchors in [
        [
            "0.103, 0.077, 0.001",
            "0.928, 0.003, 0.001",
            "0.685, 0.841, -0.001",
        ],
        [
            "-0.05, 0.08, 0.001",
            "1.06, -0.07, 0.001",
            "0.56, 0.99, -0.001",
        ],
    ] {
        let sketch = ["a", "b", "c"].iter().zip(anchors).map(|(link, anchor)| {
            format!("[links.{link}]\ntrack_offset_m = {{ value = [{anchor}], tol = 0.075 }}\n")
        });
        let sketch: String = sketch.collect();
        work.write("measured/robot.toml", format!("{drawn}\n{sketch}"));
        let found = work.calibrated("--model DIR/own.tau --variant Full --split all");
        assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
        assert!(
            number(&found["iterations"]) < 100.0,
            "{}",
            found["iterations"]
        );
    }
}
