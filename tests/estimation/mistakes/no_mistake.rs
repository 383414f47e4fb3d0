//! What is no mistake of a file, though much does not fit: no name is given to it, or only to what is behind it.

use tau_testkit::{Table, Work, list, number};

use crate::carts::PATHS;
use crate::cases::{checked, mistakes, model, verdict};
use crate::measurements::{DELTA_DISTANCES, DELTA_POSITIONS};

/// A fit that follows all that was measured says nothing of the noise.
#[test]
fn few_poses_tell_no_noise() {
    for model in ["linear_delta", "rotary_delta", "hexapod"] {
        let work = Work::simulated(&format!("--model {model} --random --poses 3"));
        assert_eq!(checked(&work, ""), [""; 0], "{model}");
    }
}

/// Noise fifty times the stated one is no mistake of angles, of dimensions or of units.
#[test]
fn noise_larger_than_stated_has_no_other_name() {
    larger_noise_has_no_name("five_bar", 1);
}

#[track_caller]
pub(crate) fn larger_noise_has_no_name(model: &str, seed: u32) {
    let work = Work::simulated(&format!(
        "--model {model} --seed {seed} --random --poses 80 --noise-scale 50,50,50"
    ));
    let ran = work.run("check MEASURED -q --json -");
    let found = mistakes(&ran);
    assert!(found.is_empty(), "{model}: {found:?}");
    let misfit = number(&ran.printed()["misfit"]);
    assert!((35.0..65.0).contains(&misfit), "{model}: {misfit}");
    let found = work.calibrated("--variant Full");
    assert_eq!(found["fit"]["status"], "inconsistent", "{model}: {found}");
}

/// Noise of positions that drives could have as well, were theirs a thousand times the stated one.
#[test]
fn noise_of_all_kinds_is_no_mistake_of_one() {
    let work = Work::simulated(
        "--model four_lines --measure positions --poses 60 --random --seed 51 --noise-drives 5e-3 --noise-position 1e-3 \
         --noise-scale 10,1,1",
    );
    let (status, codes) = verdict(&work, "");
    assert_eq!(status, "inconsistent");
    assert!(!codes.contains(&"T413".to_owned()), "{codes:?}");
}

/// A reading that was misread by 0.7 m, and belts that were measured to the middle of the sled: no larger noise is what their
/// residuals show.
#[test]
fn misread_belts_are_no_noise() {
    let edits: [fn(&mut Table); 2] = [
        |table| table.add(5, "q2_m", 0.7),
        |table| {
            for belt in ["q1_m", "q2_m", "q3_m", "q4_m"] {
                table.shift(belt, 0.095);
            }
        },
    ];
    for edit in edits {
        let work = Work::simulated(
            "--model four_belts --measure readings --noise-drives 5e-5 --random --poses 40 --seed 5",
        );
        work.edit("readings.csv", edit);
        let codes = checked(&work, "");
        assert!(!codes.contains(&"T413".to_owned()), "{codes:?}");
    }
}

/// Links of a cart that are not parallel are more than the noise for a reduced arm, by a hundred times, and no wrong noise:
/// the variant with all links has it right, though a track of it follows measured points.
#[test]
fn what_a_variant_is_too_simple_for_is_no_mistake() {
    let work = Work::simulated(PATHS);
    let found = work.calibrated(&format!("{} --variant Nominal", model(PATHS)));
    assert_eq!(found["fit"]["status"], "inconsistent");
    assert_eq!(found["fit"]["mistakes"], serde_json::json!([]));
    assert_eq!(checked(&work, &model(PATHS)), [""; 0]);
}

/// Distances that state their noise, with so much more of it, of either sign in turn.
fn state_noise(work: &Work, stated_m: f64, more_m: f64) {
    work.edit("distances.csv", |table| {
        table.map("distance_m", |row, distance| {
            distance + [more_m, -more_m][row / 2 % 2]
        });
        table.append_column("sigma_distance_m", |_| stated_m);
    });
}

/// Distances by a ruler miss a machine's by more than another machine's would, and that is what they state.
#[test]
fn rough_rows_that_say_so_are_no_other_machine() {
    let work = Work::simulated(DELTA_DISTANCES);
    state_noise(&work, 5e-3, 5e-3);
    assert_eq!(verdict(&work, "").0, "consistent");
}

/// Noise of a few rows that is stated too small hides among many others, which all together meet theirs.
#[test]
fn each_file_must_meet_its_noise() {
    let work = Work::simulated("--model linear_delta --measure positions,distances --poses 120");
    state_noise(&work, 1e-5, 2.5e-5);
    work.edit("distances.csv", |table| table.keep(|row| row <= 12));
    let found = work.calibrated("--variant Full --split all");
    let fit = &found["fit"];
    assert_eq!(fit["status"], "inconsistent");
    let mut reasons = list(&fit["reasons"]).iter();
    let is_of_file = reasons.any(|own| own["code"] == "T309" && own["file"] == "distances.csv");
    assert!(is_of_file, "{fit:#}");
}

/// A wall of which the robot file says nothing stands anywhere.
#[test]
fn surfaces_of_unknown_place_may_stand_upright() {
    let wall = "[surfaces.wall]\nnormal = { value = [1.0, 0.0, 0.0], tol = 0.01 }\noffset_m = { value = -1.5, tol = 0.001 }\n";
    let drawing =
        format!("robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n{wall}");
    let work = Work::simulated_with(
        &drawing,
        "--model linear_delta --robot DIR/robot.toml --measure positions,heights --poses 60 --random",
    );
    let text = work.read("measured/robot.toml");
    let (before, after) = text.split_once("[surfaces.wall]").unwrap();
    let rest = after.find("\n[").map_or("", |end| &after[end..]);
    work.write("measured/robot.toml", format!("{before}{rest}"));
    assert_eq!(verdict(&work, "").0, "consistent");
}

/// A ball bar that is read 50 mm too long is no mistake that is tried, and no calibration: the check does not pass over it.
#[test]
fn what_no_mistake_explains_is_not_passed_over() {
    let work = Work::simulated(
        "--model linear_delta --random --measure heights,distances,ball-bar --seed 3",
    );
    let misfit = || work.json("check MEASURED")["misfit"].clone();
    assert!(misfit().is_null());
    work.edit("ball_bar.csv", |table| table.shift("distance_m", 0.05));
    assert!(number(&misfit()) > 10.0);
}

/// Rows that fit no machine are no matter of single ones: each is told by its line.
#[test]
fn poses_that_commands_do_not_give_have_their_place() {
    let work = Work::simulated(DELTA_POSITIONS);
    work.edit("tcp_positions.csv", |table| table.add(5, "q1_m", 3.0));
    for command in ["check MEASURED", "calibrate MEASURED --out DIR/out"] {
        let ran = work.run(&format!("{command} --variant Full"));
        assert_eq!(ran.code, 1, "{}", ran.err);
        assert!(ran.says("T505"), "{}", ran.err);
        assert!(ran.err.contains("tcp_positions.csv:6"), "{}", ran.err);
    }
}

/// Drives without noise stand still at a pose, whatever was measured there.
#[test]
fn exact_drives_at_two_places_are_refused() {
    let work = Work::simulated("--model linear_delta --measure positions,heights --poses 40");
    work.edit("heights.csv", |table| table.add(5, "q1_m", 0.03));
    let ran = work.run("calibrate MEASURED --variant Full --out DIR/out -q");
    ran.refused(&[("T346", "heights.csv:6", 0)]);
    ran.shows("T346");
}
