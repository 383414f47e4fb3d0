//! Figures of robot files and descriptions: noise and tolerances that are a thousand times off, dimensions that are far off,
//! and zeros and frames of the drawing.

use std::f64::consts::FRAC_PI_2;

use tau_testkit::robots::{CABLES, named as robot};
use tau_testkit::{OWN, Work, number};

use crate::cases::{
    ANGLES, GANTRY, POSES, ROBOT, checked, draw, is_length, mistakes, model, named, scale,
    scale_noise,
};
use crate::measurements::DELTA_POSITIONS;

/// Noise in thousandths of the unit, also where tolerances hold residuals up; twice the noise is none of it.
#[test]
fn noise_in_other_units_is_named() {
    let delta = DELTA_POSITIONS;
    for (simulated, factor) in [
        (delta, 1e3),
        (delta, 1e-3),
        (
            "--model linear_delta --measure heights,distances --random --poses 30",
            1e3,
        ),
    ] {
        let work = Work::simulated(simulated);
        scale_noise(&work, factor);
        named(&work, &model(simulated), ["T413", ROBOT, ""]);
    }
    for factor in [0.5, 2.0] {
        let work = Work::simulated(delta);
        scale_noise(&work, factor);
        assert_eq!(checked(&work, ""), [""; 0]);
    }
}

/// Of rotations, whatever else would explain some of them; of measurements and drives together.
#[test]
fn noise_of_some_quantities_in_other_units_is_named() {
    let cranks = "--model servo_hexapod --random --poses 40 --seed 41";
    for (key, factor) in [("position_m", 1e3), ("rotation_rad", 1e-3)] {
        let work = Work::simulated(cranks);
        scale(&work, key, factor, |_| true);
        named(
            &work,
            &model(cranks),
            ["T413", ROBOT, &format!("{key} [noise]")],
        );
    }
    noise_of_drives_too("--model linear_delta --measure heights,distances", 41);
}

#[track_caller]
pub(crate) fn noise_of_drives_too(measured: &str, seed: u32) {
    let simulated = format!("{measured} --random --poses 40 --noise-drives 1e-5 --seed {seed}");
    let work = Work::simulated(&simulated);
    for key in ["position_m", "noise_m"] {
        scale(&work, key, 1e3, |_| true);
    }
    named(&work, &model(&simulated), ["T413", ROBOT, ""]);
}

/// Tolerances of lengths in millimetres, whatever was measured, and those that are too small, which no frame explains.
#[test]
fn tolerances_in_other_units_are_named() {
    for (measured, factor) in [
        ("--model four_belts --measure poses", 1e3),
        ("--model rotary_delta", 1e-3),
    ] {
        tolerances_are_named(measured, 41, factor);
    }
}

#[track_caller]
pub(crate) fn tolerances_are_named(measured: &str, seed: u32, factor: f64) {
    let work = with_tolerances(measured, seed, factor);
    named(&work, &model(measured), ["T414", ROBOT, ""]);
}

/// A folder of a drawn machine whose tolerances of lengths are stated so many times as large.
#[track_caller]
pub(crate) fn with_tolerances(measured: &str, seed: u32, factor: f64) -> Work {
    let work = Work::simulated(&format!("{measured} --random --poses 40 --seed {seed}"));
    draw(&work, measured.split(' ').nth(1).unwrap());
    scale(&work, "tol", factor, is_length);
    work
}

/// Whoever does not know where anchors are says so: machines depart further than by a thousandth of that.
#[test]
fn tolerances_that_are_wide_with_caution_are_no_mistake() {
    cautious_is_consistent("--model four_lines --measure poses", 41);
}

#[track_caller]
pub(crate) fn cautious_is_consistent(measured: &str, seed: u32) {
    let found = with_tolerances(measured, seed, 50.0).calibrated("--variant Full");
    assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
    assert_eq!(found["fit"]["mistakes"], serde_json::json!([]));
}

/// The description of cranks, another text in place of one in it.
fn cranks(stated: &str, other: &str) -> Work {
    let work =
        Work::simulated("--model servo_hexapod --measure poses --random --poses 60 --seed 3");
    let description = robot("servo_hexapod").description;
    assert!(description.contains(stated));
    work.write("own.tau", description.replace(stated, other));
    work
}

/// Lengths of rods alone: all else is in metres.
#[test]
fn some_tolerances_in_millimetres_are_named() {
    let work = cranks("0.214023 m tol 0.2 mm", "0.214023 m tol 0.2 m");
    named(&work, OWN, ["T414", ROBOT, ""]);
}

/// Two joints depart by hundreds of tolerances and all else by none: a thousand times the tolerances are not what they are. Yet
/// the misfit is said.
#[test]
fn exchanged_joints_are_no_tolerances() {
    let [first, second] = ["(0.0892, -0.0803, 0)", "(0.0892, 0.0803, 0)"];
    let work = cranks(first, "FIRST");
    let text = work.read("own.tau").replace(second, first);
    work.write("own.tau", text.replace("FIRST", second));
    let ran = work.run(&format!("check MEASURED {OWN} --json - -q"));
    let found = mistakes(&ran);
    assert!(found.iter().all(|own| own.code != "T414"), "{found:?}");
    if found.is_empty() {
        assert!(number(&ran.printed()["misfit"]) > 2.0, "{}", ran.out);
    }
}

/// A bad part is inconsistent, a slipped digit absurd. A parameter that measurements bias is free as any other: what completes
/// squares of its prior is no misfit.
#[test]
fn a_dimension_far_off_is_named() {
    for (tolerances, status, code) in [(10.0, "inconsistent", 0), (100.0, "absurd", 1)] {
        let work = Work::simulated(GANTRY);
        work.replace(
            "value = 2.04399, tol",
            &format!("value = {}, tol", 2.04399 + tolerances * 3e-4),
        );
        named(&work, "", ["T415", ROBOT, "l1.length"]);
        let line = "calibrate MEASURED --variant Full --out DIR/out -q --json -";
        let ran = work.run(line);
        assert_eq!(
            (&ran.printed()["fit"]["status"], ran.code),
            (&status.into(), code)
        );
        assert!(ran.says("T415"), "{}", ran.err);
    }
    let work = Work::simulated("--model linear_delta --random --poses 60");
    work.state("[parameters]\nradius = { value = 0.24, tol = 1e-3 }\n");
    named(&work, "--model linear_delta", ["T415", ROBOT, "radius"]);
}

/// Machines with more drives than freedoms are fitted with poses unknown, and asked for the same mistakes.
#[test]
fn a_dimension_of_redundant_drives_is_named() {
    let work =
        Work::described(CABLES).with_measured("--measure poses --random --poses 60 --seed 5");
    let wrong = CABLES.replacen("(-0.1, -0.05, 0) m", "(-0.13, -0.05, 0) m", 1);
    work.write("own.tau", wrong);
    named(&work, OWN, ["T415", ROBOT, "b.plate_joint.x"]);
}

/// Three sliders in a plane, each with a link to a plate that turns.
pub(crate) const SLIDERS: &str = "robot Sliders {
    plate body in plane;
    track t1, t2, t3;
    cluster arm1 on t1 { link l1 { length = 412 mm tol 0.3 mm; plate_joint = (24, -76, 0) mm tol 0.3 mm; track_offset = (-150, -450, 0) mm tol 5 mm; track_direction = (1, 0, 0) tol 0.01; } }
    cluster arm2 on t2 { link l2 { length = 412 mm tol 0.3 mm; plate_joint = (54, 59, 0) mm tol 0.3 mm; track_offset = (464, 95, 0) mm tol 5 mm; track_direction = (-0.5, 0.866, 0) tol 0.01; } }
    cluster arm3 on t3 { link l3 { length = 412 mm tol 0.3 mm; plate_joint = (-78, 18, 0) mm tol 0.3 mm; track_offset = (-315, 355, 0) mm tol 5 mm; track_direction = (-0.5, -0.866, 0) tol 0.01; } }
    reference { position = (0, 0, 0) mm; orientation = (0, 0, 0) rad; }
    variant Full { arm full; tracks linear per link; }
}";

/// In a plane, heights of joints change closures only by their squares: what no measurement sees is not what is wrong. Of
/// several explanations each differs from what is stated, and is said once.
#[test]
fn a_wrong_length_in_a_plane_is_no_height() {
    let work =
        Work::described(SLIDERS).with_measured("--measure poses --random --poses 60 --seed 3");
    work.write(
        "own.tau",
        SLIDERS.replacen("length = 412 mm", "length = 432 mm", 1),
    );
    named(&work, OWN, ["T415", ROBOT, "l1.length"]);
    let found = mistakes(&work.run(&format!("check MEASURED {OWN} -q --json -")));
    let (what, numbers) = (&found[0].told, found[0].numbers());
    // 20 mm at a tolerance of 0.3 mm, which the machine departs by some of.
    assert!(
        (numbers[0] - 66.7).abs() < 3.0 && (numbers[2] - 0.412).abs() < 1e-3,
        "{what}"
    );
    assert!(!what.contains(".z"), "{what}");
    let names = what.split(' ').filter(|own| own.contains(".length"));
    // The mend names the first once more.
    assert_eq!(names.count(), 2, "{what}");
}

/// The measurements tell the endstop to 3 µm, whatever the drawing says: at 30 of its tolerances, 0.1 mm, that is no drawing
/// of this machine.
#[test]
fn a_dimension_thirty_tolerances_off_is_absurd() {
    let simulated = "--model linear_delta --measure positions --random --poses 60 --seed 5";
    for (tolerances, status) in [(28.0, "inconsistent"), (32.0, "absurd")] {
        let work = Work::simulated(simulated);
        let value = number(&work.truth()["parameters"]["endstop_a"]) + tolerances * 1e-4;
        work.state(&format!(
            "[parameters]\nendstop_a = {{ value = {value}, tol = 1e-4 }}\n"
        ));
        let ran = work.run("calibrate MEASURED --variant Full --out DIR/out -q --json -");
        let fit = &ran.printed()["fit"];
        assert_eq!(fit["status"], status, "{}", fit["why"]);
        assert_eq!(ran.code, u8::from(status == "absurd"));
        let found = mistakes(&ran);
        let own = &found
            .iter()
            .find(|own| own.is_absurd == (status == "absurd"));
        let own = own.unwrap_or_else(|| panic!("{found:?}"));
        assert!(
            own.code == "T415" && own.told.starts_with("endstop_a"),
            "{own:?}"
        );
        assert!((own.numbers()[0] - tolerances).abs() < 0.1, "{own:?}");
    }
}

/// Towers that are alike nearly stand as in the drawing when two commands are exchanged; a dimension that is off does the
/// same alone, and is what an owner can measure again.
#[test]
fn a_drawing_that_is_off_is_no_exchange() {
    drawing_is_no_exchange(1, ("endstop_b", 0.322, 2e-3));
}

#[track_caller]
pub(crate) fn drawing_is_no_exchange(seed: u32, (name, value, tolerance): (&str, f64, f64)) {
    let work = Work::simulated(&format!(
        "--model linear_delta --measure heights,distances --random --poses 40 --noise-position 1e-4 --seed {seed}"
    ));
    work.state(&format!(
        "[parameters]\n{name} = {{ value = {value}, tol = {tolerance} }}\n"
    ));
    let found = mistakes(
        &work.run("calibrate MEASURED --variant Full --split all --out DIR/out -q --json -"),
    );
    assert_eq!(found.len(), 1, "{name}: {found:?}");
    assert_eq!(found[0].code, "T415", "{found:?}");
    assert!(found[0].told.starts_with(name), "{found:?}");
}

/// A drive that was homed elsewhere: one number, whatever it moves, to what the drawing's tolerances leave of it. Where one value
/// of the drawing does the same, such as an end stop, that is told first.
#[test]
fn a_zero_of_a_drive_is_told_by_its_size() {
    for (model, column, off) in [
        ("gantry_tau", "q2_m", 0.1),
        ("ROBOTS/winch.tau", "q2_rad", 0.4),
        ("ROBOTS/winch.tau", "q3_rad", -0.4),
    ] {
        let by = told_numbers(model, 3, "T403", |work| {
            work.edit(POSES, |table| table.shift(column, off));
        });
        assert!((by[0] + off).abs() < 5e-3, "{model} {column}: {by:?}");
    }
}

/// The turn of another frame is told beside the machine's own errors, which the drawing alone puts into it.
#[test]
fn a_frame_is_told_beside_the_machine() {
    for (model, seed) in [("ROBOTS/winch.tau", 1), ("linear_delta", 2)] {
        // A quarter turn about z: x' = −y, y' = x.
        let turn = told_numbers(model, seed, "T408", |work| {
            work.edit(POSES, |table| {
                table.map_together(["x_m", "y_m"], |_, place| *place = [-place[1], place[0]]);
                if table.header.iter().any(|name| name == ANGLES[0]) {
                    table.shift(ANGLES[0], FRAC_PI_2);
                }
            });
        });
        // Tolerances of anchors and guideways leave so much of it.
        let off = [turn[0], turn[1], turn[2] + FRAC_PI_2];
        assert!(off.iter().all(|own| own.abs() < 5e-3), "{model}: {turn:?}");
    }
}

/// Numbers in the one mistake that a check names.
#[track_caller]
fn told_numbers(model: &str, seed: u32, code: &str, edit: impl FnOnce(&Work)) -> Vec<f64> {
    let work = Work::simulated(&format!(
        "--model {model} --seed {seed} --random --poses 60"
    ));
    edit(&work);
    let found = mistakes(&work.run(&format!("check MEASURED --model {model} -q --json -")));
    assert_eq!(found.len(), 1, "{model}: {found:?}");
    assert_eq!(found[0].code, code, "{found:?}");
    found[0].numbers()
}
