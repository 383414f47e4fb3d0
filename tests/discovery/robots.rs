//! Other robots than the Gantry-Tau, with and without measured poses.

use serde_json::{Value, json};
use tau_testkit::robots::CABLES;
use tau_testkit::{OWN, Work, effects, list};

use crate::search::{
    assert_alike, assert_near, assert_written, at, calibrated_anew, found_of, hidden_is_found,
    of_effect, remarks,
};

/// Redundant drives that are stated to be exact contradict each other where one counts wrongly, by far more than poses are
/// measured; what is wrong is named all the same, and with it they agree.
#[test]
fn what_exact_drives_contradict_each_other_by_is_named() {
    let hidden = "--effect length_scale(a):scale=1e-3";
    let measured = format!("--random --random-approach --poses 100 --seed 50 {hidden}");
    let work = Work::described(CABLES).with_measured(&measured);
    let found = work.discovered(OWN);
    assert_eq!(effects(&found), ["length_scale(a)"]);
    assert_eq!(found["status"], "explained");
}

/// Where tracks follow from formulas too, their carts show what the arm alone does not: a wave of 4 µm on a rack, and how a
/// cart turns. A stretch of both pulled belts is one effect, which errors of scale at two places explain no better.
#[test]
fn effects_of_other_robots_have_their_names() {
    let carts = "linear_delta --seed 100 --random-approach";
    let lines = "four_lines --variant Anchors --random --poses 60";
    let belts = "four_belts --variant Full --random --poses 60";
    for (simulation, hidden, base) in [
        (
            carts,
            "rack_pitch(b):sine=4e-6,cosine=2e-6,period=0.0133",
            "",
        ),
        (carts, "angular_motion(b):roll2=1.5e-2,pitch2=1.5e-2", ""),
        (lines, "drum_radius(b):error=4e-3", "--base Anchors"),
        (lines, "line_buildup(all):growth=3e-5", "--base Anchors"),
        (belts, "pull_strain(all):strain=1e-4", ""),
    ] {
        let (_, found) = hidden_is_found(&format!("--model {simulation}"), hidden, base);
        assert_eq!(remarks(&found, "T231"), 0, "{hidden}");
    }
}

/// The side of approach is that of a leg's own drive: a machine without tracks has one, too.
#[test]
fn sides_of_approach_are_those_of_the_drives() {
    let work = Work::simulated("--model hexapod --poses 60 --seed 1 --random-approach");
    let found = work.discovered("");
    let seen = of_effect(&found, "detectable", "backlash").into_iter();
    let places: Vec<&str> = seen.filter_map(|own| own["place"].as_str()).collect();
    for leg in ["leg1", "leg2", "leg3", "leg4", "leg5", "leg6", "all"] {
        assert!(places.contains(&leg), "{places:?}");
    }
}

/// A leg that is longer than its drive counts is as good as another length of it, but for the tolerance of that: it is
/// tried and named, though it has no amplitude beyond which measurements alone would show it.
#[test]
fn an_offset_that_only_tolerances_tell_from_a_length_is_a_candidate() {
    let hidden = "length_offset(leg3):offset=4e-3";
    let (_, found) = hidden_is_found("--model hexapod --poses 60 --seed 1", hidden, "");
    let promised = of_effect(&found, "detectable", "length_offset");
    assert!(promised.iter().all(|own| own["place"] != "leg3"));
}

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
    let hidden = "cart_compliance(c):along_compliance=7e-7,horizontal_compliance=9e-7";
    let measured = format!("--random --payload 20 --seed 1 --effect {hidden}");
    let work = Work::described(&description).with_measured(&measured);
    let found = work.discovered(OWN);
    assert_eq!(effects(&found), ["cart_compliance(c)"]);
    assert_eq!(found["status"], "explained");
    assert_near(&found, 0.1, &[("along_compliance", 7e-7)]);
}

/// Without poses too, what is written is what is said: a period starts where it was found, not in the middle of its range.
#[test]
fn a_period_is_written_where_it_was_found() {
    let work = Work::simulated_with(
        "robot = \"LinearDelta\"\n[noise]\nheights = { height_m = 1e-5 }\ndistances = { distance_m = 2e-5 }\n",
        "--model linear_delta --robot DIR/robot.toml --variant Full --random --poses 160 --seed 4 \
         --measure heights,distances --effect rack_pitch(b):sine=8e-5,period=0.0096",
    );
    let found = work.discovered("");
    assert_eq!(effects(&found), ["rack_pitch(b)"]);
    assert_written(&work, &found);
}

/// A wave of 20 µm on a rack, that carts tell more of than the plate: what is written is what is said.
#[test]
fn a_search_writes_what_carts_and_plate_say_together() {
    let work = Work::simulated(
        "--variant Full --measure positions --random --poses 40 --seed 3 \
         --effect rack_pitch(two):sine=2e-5,period=0.0091",
    );
    let found = work.discovered("--base Full");
    assert_eq!(effects(&found), ["rack_pitch(two)"]);
    assert_written(&work, &found);
}

/// The length of a step is no track that bends: measured carts take no part where poses are unknown, and tracks stay straight.
/// Set 1 are measured poses: where there are none, noise beyond the stated one is that of what was measured.
#[test]
fn tracks_stay_straight_and_noise_is_that_of_the_plate_where_poses_are_unknown() {
    let (work, found) = found_of(
        "--model linear_delta --random --poses 80 --seed 4 --measure heights --noise-scale 2,2,2",
    );
    assert!(!work.table("measured/cart_poses.csv").rows.is_empty());
    assert_eq!(found["piecewise_tracks"].as_array().map_or(0, Vec::len), 0);
    assert!(remarks(&found, "T637") >= 1);
    let said = found["remarks"].to_string();
    assert!(!said.contains("set 1"), "{said}");
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
    assert_alike(at(&fit, "fit.residual_over_noise"), 1.0, 0.34);
    assert_alike(at(&fit, "fit.dof"), 40.0, 0.05);
    assert_eq!(work.discovered("--base Full")["status"], "nothing_missing");
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
    let found = |share: f64| {
        let found = work.discovered("--base Full");
        let name = effects(&found).join(" + ");
        let (parameter, rival, length_m) = match name.as_str() {
            "link_compliance(leg2)" => ("strain", "anchor_compliance", 1.0),
            "anchor_compliance(leg2)" => ("yielding", "link_compliance", 0.855_522),
            _ => panic!("{name}"),
        };
        assert_eq!(found["effects"][0]["rivals"][0]["name"], rival);
        assert_near(&found, 0.1, &[(parameter, share * STRAIN * length_m)]);
        (format!("{name}.{parameter}"), STRAIN * length_m)
    };
    let (name, size) = found(1.0);
    let fitted = calibrated_anew(&work);
    assert_eq!(fitted["fit"]["status"], "consistent");
    let own = tau_testkit::estimate(&fitted, &name);
    assert_alike(at(own, "value"), size, 0.4);
    let forces = [1, 2, 3, 4, 5, 6].map(|drive| format!("force{drive}_N"));
    let forces = forces.each_ref().map(String::as_str);
    work.edit("tcp_poses.csv", |table| table.drop(&forces));
    found(0.5);
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
        assert_alike(rms, expected, 0.3);
    }
}

/// Where no pose was measured, targets on carts still tell that a cart yields: its load follows from where the machine
/// stands, which drives say.
#[test]
fn a_cart_that_yields_is_calibrated_without_poses() {
    let with = "--poses 60 --random --random-approach --warming 6 --payload 20 --seed 1";
    let simulation = format!("--model linear_delta --measure heights,distances {with}");
    let hidden = "cart_compliance(a):along_compliance=2.59e-7";
    let (work, _) = hidden_is_found(&simulation, hidden, "");
    assert!(!work.table("measured/cart_positions.csv").rows.is_empty());
    assert_eq!(calibrated_anew(&work)["fit"]["status"], "consistent");
}

/// Where no effect of a plausible size would show, a consistent base is no proof that nothing is missing.
#[test]
fn measurements_that_show_nothing_leave_open_whether_anything_is_missing() {
    let work = Work::simulated("--model rotary_delta --random --poses 10 --noise-position 1.2e-3");
    let found = work.discovered("--split all");
    assert_eq!(found["fit"]["status"], "consistent");
    assert_eq!(found["detectable"], json!([]));
    assert_eq!(found["status"], "unresolved");
    assert_eq!(remarks(&found, "T651"), 1, "{}", found["remarks"]);
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
    assert_alike(before, floor, 0.3);
}
