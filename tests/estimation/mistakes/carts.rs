//! Carts: their numbers, columns and angles against the tracks, and what they tell beside a plate.

use serde_json::Value;
use tau_testkit::{Work, list, number};

use crate::cases::{GANTRY, all_named, exchange_carts, model, other_angles};

const CART_POSES: &str = "cart_poses.csv";
const CART_POSITIONS: &str = "cart_positions.csv";
/// A track of it follows the measured path.
pub(crate) const PATHS: &str = "--model ROBOTS/four_track.tau --random --poses 60";
/// Positions of the Gantry-Tau beside carts.
const BESIDE: &str = "--variant Full --measure positions --random --poses 40 --seed 3";

/// Upright tracks a decimetre apart are told by carts with commands of their own alone; where tracks follow measured paths, a
/// wrong numbering spoils the fit itself.
#[test]
fn exchanged_carts_are_named() {
    all_named! {
        GANTRY, CART_POSES, exchange_carts => "T416", "2 one 1 two 3 three";
        GANTRY, CART_POSITIONS, exchange_carts => "T416", "2 one 1 two";
        "--model linear_delta --random --poses 60", CART_POSITIONS, exchange_carts => "T416", "2 a 1 b";
        PATHS, CART_POSES, exchange_carts => "T416", "2 east 1 north 3 west";
    }
}

/// Beside a plate, a fit names them, and a search, and nothing is written.
#[test]
fn exchanged_carts_beside_a_plate_are_named() {
    let work = Work::simulated(BESIDE);
    work.edit(CART_POSES, exchange_carts);
    for command in ["calibrate MEASURED --variant", "discover MEASURED --base"] {
        let ran = work.run(&format!("{command} Full --out DIR/out"));
        assert!(ran.code != 0 && ran.says("T416"), "{command}: {}", ran.err);
        assert_eq!(work.listing(""), ["measured"], "{command}");
    }
}

#[test]
fn a_check_says_whose_exchange_would_not_be_noticed() {
    for (simulated, expected) in [
        (
            "--model linear_delta --random --poses 60",
            &[CART_POSES][..],
        ),
        (GANTRY, &[]),
    ] {
        let work = Work::simulated(simulated);
        let line = format!("check MEASURED {} -q --json -", model(simulated));
        let found = work.run(&line).printed();
        assert_eq!(found["exchange_unnoticed"], serde_json::json!(expected));
    }
}

/// Columns of set 3 alone, and the hand of a set's frame, against where set 1 has the tracks. Of set 2, and of the 720
/// numberings of six carts, other numbers may do about as well; a mirrored frame of carts is that of commands reversed.
#[test]
fn columns_of_carts_are_no_other_numbers() {
    all_named! {
        GANTRY, CART_POSITIONS, |t| t.scale(&["q1_m"], -1.0) => "T402", "q1_m";
        GANTRY, CART_POSITIONS, |t| t.scale(&["z_m"], -1.0) => "T402", "q1_m q2_m q3_m";
        GANTRY, CART_POSES, |t| t.scale(&["q_m"], -1.0) => "T402", "q_m";
        "--model hexaglide --random --poses 40", CART_POSES, |t| t.scale(&["q_m"], -1.0) => "T402", "q_m";
    }
}

/// Where nothing explains it, carts out of the measured range stay an error of the input.
#[test]
fn carts_out_of_range_without_a_mistake_are_refused() {
    let work = Work::simulated("--model linear_delta --random --poses 60");
    work.edit(CART_POSES, |table| table.shift("q_m", 10.0));
    work.run("check MEASURED")
        .refused(&[("T332", "measured", 0)]);
}

#[test]
fn angles_of_carts_about_other_axes_are_named() {
    let simulated = GANTRY;
    let zyx = "Rz(alpha_rad)·Ry(beta_rad)·Rx(gamma_rad)";
    all_named! {
        simulated, CART_POSES, other_angles => "T407", zyx;
    }
}

fn without_carts(work: &Work) {
    work.remove("measured/cart_poses.csv")
        .remove("measured/cart_positions.csv");
}

fn sigma(work: &Work, arguments: &str, name: &str) -> f64 {
    let line = format!("calibrate MEASURED {arguments} --out DIR/out --force -q");
    let found = work.json(&line);
    let mut parameters = list(&found["parameters"]).iter();
    number(&parameters.find(|own| own["name"] == name).unwrap()["sigma"])
}

/// How tracks run, and, where that follows from parameters of the whole machine, how far a command carries them.
#[test]
fn carts_tell_how_tracks_run() {
    for (simulated, variant, name, at_most) in [
        (BESIDE, "Full", "l3b.track_direction.x", 0.5),
        (
            "--model linear_delta --variant Scaled --measure positions",
            "Scaled",
            "scale",
            0.8,
        ),
    ] {
        let work = Work::simulated(simulated);
        let arguments = format!("{} --variant {variant}", model(simulated));
        let with = sigma(&work, &arguments, name);
        without_carts(&work);
        let ratio = with / sigma(&work, &arguments, name);
        assert!(ratio < at_most, "{name}: {ratio}");
    }
}

/// A track that runs off straight, in proportion to a number.
fn off_straight(vertical2: f64) -> Work {
    Work::simulated(&format!(
        "--measure positions --random --poses 40 --seed 3 --effect straightness(two):vertical2={vertical2:e}"
    ))
}

/// Carts that run a tenth of a millimetre off straight lines are no reason to move the machine: they count less, and the
/// verdict, which is on the plate, says so.
#[test]
fn carts_that_a_variant_misses_count_less() {
    let found = off_straight(2e-4).calibrated("--variant Full");
    let fit = &found["fit"];
    let missed = list(&fit["reasons"])
        .iter()
        .find(|own| own["code"] == "T317");
    let missed = &missed.expect("T317")["values"];
    assert!(number(&fit["dof"]) < 3.0 * number(&found["poses"]["calibration"]));
    let of = |all: &'static str, is_own: &dyn Fn(&&Value) -> bool| {
        let list = list(if all == "kinds" {
            &found[all]
        } else {
            &fit[all]
        });
        list.iter()
            .find(is_own)
            .unwrap_or_else(|| panic!("{all}"))
            .clone()
    };
    let own = of("by_file", &|own| {
        own["file"] == CART_POSES && own["kind"] == "position"
    });
    let ratio = number(&own["rms"]) / number(&own["expected_rms"]);
    assert!(ratio > 1.5, "{own} {missed}");
    // Their noise is what was found, and not as stated; that of positions is.
    let estimated = |file: &'static str| {
        of("kinds", &|own| {
            own["file"] == file && own["kind"] != "rotation"
        })["estimated"]
            .clone()
    };
    assert_eq!(
        [CART_POSES, "tcp_positions.csv"].map(estimated),
        [true, false]
    );
}

/// One gross row, and tracks that the variant misses: noise is taken for as large as the misfit of all others makes it, not
/// for the seventeen times that the row would.
#[test]
fn a_gross_row_widens_no_noise() {
    let work = off_straight(3e-4);
    work.edit("tcp_positions.csv", |table| table.add(11, "z_m", 2e-3));
    let found = work.calibrated("--variant Full --split all");
    let gross = list(&found["gross_rows"]);
    assert_eq!((gross.len(), &gross[0]["line"]), (1, &Value::from(12)));
    let widened = number(&found["noise_factor"]);
    assert!(widened < 2.0, "{widened}");
}

/// Tracks that a variant misses by a hundred times the noise would drive parameters five tolerances off, to a settled fit:
/// at as much noise as they show, tolerances hold.
#[test]
fn a_misfit_does_not_outweigh_tolerances() {
    let found = off_straight(1e-3).calibrated("--variant Full --split all");
    let fit = &found["fit"];
    let ratio = number(&fit["residual_over_noise"]) / number(&found["noise_factor"]);
    assert!((ratio - 1.0).abs() < 0.25, "{ratio}");
    let pull = number(&fit["pulls"][0]["tolerances"]);
    assert!(pull.abs() < 3.0, "{pull}");
}
