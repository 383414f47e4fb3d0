//! Other robots than the Gantry-Tau, with and without measured poses.

use serde_json::{Value, json};
use tau_testkit::robots::CABLES;
use tau_testkit::{Work, effects, list};

use crate::search::{assert_near, at, calibrated_anew, estimate, found_of, of_effect, remarks};

/// Redundant drives that are stated to be exact contradict each other where one counts wrongly, by far more than poses are
/// measured; what is wrong is named all the same, and it is said that nothing states their noise.
#[test]
fn what_exact_drives_contradict_each_other_by_is_named() {
    let work = Work::empty();
    work.write("cables.tau", CABLES);
    let hidden =
        "--random --random-approach --poses 100 --seed 50 --effect length_scale(a):scale=1e-3";
    work.run(&format!(
        "simulate --model DIR/cables.tau {hidden} --out MEASURED -q"
    ))
    .done();
    let found = work.discovered("--model DIR/cables.tau");
    assert_eq!(effects(&found), ["length_scale(a)"]);
    assert_eq!(remarks(&found, "T636"), 1);
}

/// One effect of each kind, with its size. Where tracks follow from formulas too, their carts show what the arm alone does
/// not: a wave of 4 µm on a rack, and how a cart turns. A stretch of both pulled belts is one effect, which errors of scale
/// at two places explain no better.
#[test]
fn effects_of_other_robots_have_their_names() {
    let carts = "linear_delta --seed 100 --random-approach";
    let lines = "four_lines --variant Anchors --random --poses 60";
    let belts = "four_belts --variant Full --random --poses 60";
    for (simulation, name, values) in [
        (
            carts,
            "rack_pitch(b)",
            &[("sine", 4e-6), ("cosine", 2e-6), ("period", 0.0133)][..],
        ),
        (
            carts,
            "angular_motion(b)",
            &[("roll2", 1.5e-2), ("pitch2", 1.5e-2)],
        ),
        (
            "hexapod --poses 60 --seed 1",
            "length_offset(leg3)",
            &[("offset", 4e-3)],
        ),
        (lines, "drum_radius(b)", &[("error", 4e-3)]),
        (lines, "line_buildup(all)", &[("growth", 3e-5)]),
        (belts, "pull_strain(all)", &[("strain", 1e-4)]),
    ] {
        let hidden: Vec<String> = (values.iter())
            .map(|(parameter, value)| format!("{parameter}={value:e}"))
            .collect();
        let effect = format!("{name}:{}", hidden.join(","));
        let work = Work::simulated(&format!("--model {simulation} --effect {effect}"));
        let base = if simulation == lines {
            "--base Anchors"
        } else {
            ""
        };
        let found = work.discovered(base);
        assert_eq!(effects(&found), [name]);
        assert_eq!(found["status"], "explained", "{name}");
        assert_near(&found, values);
        assert_eq!(remarks(&found, SET_MISSING), 0, "{name}");
        // A leg that is longer than its drive counts is as good as another length of it, but for the tolerance of that.
        let (effect, place) = name.trim_end_matches(')').split_once('(').unwrap();
        let mut promised = of_effect(&found, "detectable", effect).into_iter();
        let is_promised = promised.any(|own| own["place"] == place);
        assert_eq!(is_promised, effect != "length_offset", "{name}");
    }
}

const SET_MISSING: &str = "T231";

/// All carts move equally in set 2, and on tracks that lean towards each other that changes what the arm weighs on them.
#[test]
fn carts_yield_in_set_2_where_their_load_changes() {
    let mut description = tau_testkit::robots::text("linear_delta");
    for (cluster, direction) in [
        ("cluster arm_c", "(-0.4330127, -0.75, 0.5)"),
        ("cluster arm_b", "(-0.4330127, 0.75, 0.5)"),
        ("cluster arm_a", "(0.8660254, 0, 0.5)"),
    ] {
        let (before, after) = description.split_once(cluster).unwrap();
        description = format!("{before}{cluster}{}", after.replace("(0, 0, 1)", direction));
    }
    let work = Work::empty();
    work.write("leaning.tau", description);
    let hidden = "cart_compliance(c):along_compliance=7e-7,horizontal_compliance=9e-7";
    let line = format!("--model DIR/leaning.tau --payload 20 --random --seed 1 --effect {hidden}");
    work.run(&format!("simulate {line} --out MEASURED -q"))
        .done();
    let found = work.discovered("--model DIR/leaning.tau");
    assert_eq!(effects(&found), ["cart_compliance(c)"]);
    assert_eq!(found["status"], "explained");
    assert_near(&found, &[("along_compliance", 7e-7)]);
}

/// Without poses too, what is written is what is said: a period starts where it was found, not in the middle of its range.
#[test]
fn a_period_is_written_where_it_was_found() {
    let robot = "robot = \"LinearDelta\"
[noise]
heights = { height_m = 1e-5 }
distances = { distance_m = 2e-5 }
";
    let work = Work::simulated_with(
        robot,
        "--model linear_delta --robot DIR/robot.toml --variant Full --random --poses 160 --seed 4 \
         --measure heights,distances --effect rack_pitch(b):sine=8e-5,period=0.0096",
    );
    let found = work.discovered("");
    assert_eq!(effects(&found), ["rack_pitch(b)"]);
    let [value, sigma] = estimate(&found, "period");
    let written = written_of_effect(&work, "found", "rack_pitch(b)", "period");
    assert!((written - value).abs() < 3.0 * sigma, "{written} {value}");
}

/// The length of a step is no track that bends: measured carts take no part where poses are unknown, and tracks stay straight.
/// Set 1 are measured poses: where there are none, noise beyond the stated one is that of what was measured.
#[test]
fn tracks_stay_straight_and_noise_is_that_of_the_plate_where_poses_are_unknown() {
    let (work, found) = found_of(
        "--model linear_delta --random --poses 80 --seed 4 --measure heights --noise-scale 2,2,2",
    );
    assert!(
        work.listing("measured")
            .contains(&"cart_poses.csv".to_owned())
    );
    assert_eq!(found["piecewise_tracks"].as_array().map_or(0, Vec::len), 0);
    assert_eq!(remarks(&found, "T637"), 1);
    let said = list(&found["remarks"]).iter().map(Value::to_string);
    assert!(
        !said.clone().any(|remark| remark.contains("set 1")),
        "{said:?}"
    );
}

/// Closures of exact drives beyond the plate's freedoms are no residuals: distances alone tell the noise, and where nothing
/// is hidden nothing is found.
#[test]
fn exact_drives_of_a_redundant_machine_are_no_residuals() {
    let work = Work::simulated(
        "--model four_belts --variant Full --random --poses 80 --seed 2 --measure distances",
    );
    let fit = work.calibrated("--variant Full");
    // Of forty distances by chance: three standard deviations.
    assert!((at(&fit, "fit.residual_over_noise") - 1.0).abs() < 0.34);
    assert!((at(&fit, "fit.dof") - 40.0).abs() < 2.0);
    assert_eq!(work.discovered("--base Full")["status"], "nothing_missing");
}

/// A number that a robot file holds of an effect.
fn written_of_effect(work: &Work, folder: &str, effect: &str, parameter: &str) -> f64 {
    let text = work.read(&format!("{folder}/robot.toml"));
    let of_effect = text
        .split_once(&format!("[effects.\"{effect}\"]"))
        .unwrap()
        .1;
    let start = format!("{parameter} = {{ value = ");
    let value = of_effect.split_once(&start).unwrap().1;
    let end = value.find([',', ' ', '}']).unwrap();
    value[..end].parse().unwrap()
}

/// A leg's stretch has its true size by measured forces though the stated payload is twice the true one; by statics it
/// has half of it. That of what holds the leg looks the same, by the leg's length: nothing tells which of the two it is.
#[test]
fn compliance_follows_measured_forces() {
    const STRAIN: f64 = 1.5e-6;
    let work = Work::simulated(&format!(
        "--model hexapod --variant Full --random --poses 80 --seed 3 --payload 40 --noise-force 0.5 \
         --effect link_compliance(leg2):strain={STRAIN:e}"
    ));
    work.replace("mass_kg = 40", "mass_kg = 80");
    let mut names = Vec::new();
    for (share, kept) in [(1.0, true), (0.5, false)] {
        if !kept {
            let forces = [
                "force1_N", "force2_N", "force3_N", "force4_N", "force5_N", "force6_N",
            ];
            work.edit("tcp_poses.csv", |table| table.drop(&forces));
        }
        let found = work.discovered("--base Full");
        let name = effects(&found).join(" + ");
        let (parameter, rival, length_m) = match name.as_str() {
            "link_compliance(leg2)" => ("strain", "anchor_compliance", 1.0),
            "anchor_compliance(leg2)" => ("yielding", "link_compliance", 0.855_522),
            _ => panic!("{name}"),
        };
        assert_eq!(found["effects"][0]["rivals"][0]["name"], rival);
        assert_near(&found, &[(parameter, share * STRAIN * length_m)]);
        if kept {
            let fitted = calibrated_anew(&work);
            assert_eq!(fitted["fit"]["status"], "consistent");
            let value = written_of_effect(&work, "out", &name, parameter);
            assert!((value / length_m / STRAIN - 1.0).abs() < 0.4, "{value}");
        }
        names.push(name);
    }
}

/// Links that grow by half a millimetre, fifty times the noise: at the stated noise the sixty parameters creep on in search of
/// it, or to a machine that does not reach its poses.
#[test]
fn what_is_missing_may_be_far_more_than_the_noise() {
    let work = Work::simulated(
        "--model gantry_tau --variant Full --random --poses 60 --seed 5 --measure positions \
         --warming 10 --effect link_thermal(all):expansion=4e-5",
    );
    let fitted = work.calibrated("--variant Full");
    assert_eq!(fitted["fit"]["status"], "inconsistent");
    assert!(at(&fitted, "noise_factor") > 3.0, "{fitted}");
    assert!(at(&fitted, "fit.residual_over_noise") > 3.0);
    let [kind, ..] = list(&fitted["kinds"]) else {
        panic!("{fitted}");
    };
    assert!((at(kind, "noise") / 1e-5 - 1.0).abs() < 1e-9);
    let found = work.discovered("--base Full");
    assert_eq!(effects(&found), ["link_thermal(all)"]);
    assert_eq!(found["status"], "explained");
    assert_near(&found, &[("expansion", 4e-5)]);
}

/// The misfit of a link is told as an error of its length, also where the length is a formula: of clean positions it is
/// their noise along the link, 10 µm, less what the fit takes of it.
#[test]
fn misfit_of_lengths_is_in_micrometres_of_the_length() {
    let (_, found) = found_of("--model linear_delta --random --seed 3");
    let all = list(&found["where"]).iter();
    let lengths: Vec<&Value> = all.filter(|own| own["coordinate"] == "length").collect();
    assert_eq!(lengths.len(), 3, "{lengths:?}");
    for misfit in lengths {
        let [rms, expected] = ["rms", "expected_rms"].map(|key| at(misfit, key));
        assert!((9.0..10.0).contains(&expected), "{misfit}");
        assert!((rms / expected - 1.0).abs() < 0.3, "{misfit}");
    }
}

/// Where no pose was measured, targets on carts still tell that a cart yields: its load follows from where the machine
/// stands, which drives say.
#[test]
fn a_cart_that_yields_is_calibrated_without_poses() {
    let (work, found) = found_of(
        "--model linear_delta --measure heights,distances --poses 120 --random --random-approach --warming 6 \
         --payload 20 --seed 1 --effect cart_compliance(a):along_compliance=2.59e-7",
    );
    assert!(
        work.listing("measured")
            .contains(&"cart_positions.csv".to_owned())
    );
    assert_eq!(effects(&found), ["cart_compliance(a)"]);
    assert_eq!(calibrated_anew(&work)["fit"]["status"], "consistent");
}

/// Distances and heights beside a few poses count: they tell a backlash from the waves of a rack, which the poses alone
/// don't.
#[test]
fn what_was_measured_beside_poses_takes_part() {
    let work = Work::simulated(
        "--model linear_delta --measure poses,heights,distances --poses 120 --random --random-approach \
         --warming 6 --payload 20 --seed 5 --effect backlash(a):gap=6e-5",
    );
    work.remove("measured/cart_poses.csv")
        .remove("measured/cart_positions.csv");
    work.edit("tcp_poses.csv", |table| table.keep(|row| row <= 16));
    let found = work.discovered("");
    assert_eq!(effects(&found), ["backlash(a)"]);
    assert_eq!(found["effects"][0]["rivals"], json!([]));
    assert_eq!(found["validation"]["of"], "measurements");
}

/// Drives that turn have noise in radians, which makes errors of lengths: on a clean folder these are what noise alone leaves.
#[test]
fn errors_of_drives_that_turn_are_lengths() {
    let (_, found) = found_of(
        "--model rotary_delta --measure heights,distances --poses 120 --random --noise-drives 1e-4 --seed 1",
    );
    let floor = at(&found, "noise_floor_um");
    let before = at(&found, "validation.before.mean_um");
    assert!((5.0..40.0).contains(&floor), "{floor}");
    assert!((before / floor - 1.0).abs() < 0.3, "{before} {floor}");
}
