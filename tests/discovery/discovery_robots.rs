//! `tau discover` on other robots than the Gantry-Tau.

use std::fs;

use crate::support::{CABLES, effects};
use crate::support::{ROBOTS, number, tau_in};

/// The noise of a linear delta's trackers, and nothing else.
const DELTA: &str = "robot = \"LinearDelta\"
[noise]
position_m = 1e-5
rotation_rad = 4e-5
";

/// Redundant drives that are stated to be exact contradict each other where one counts wrongly, by far more than poses are
/// measured; what is wrong is named all the same, and it is said that nothing states their noise.
#[test]
fn what_exact_drives_contradict_each_other_by_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cables.tau"), CABLES).unwrap();
    for seed in [50, 51, 53] {
        let line = format!(
            "tau simulate --model DIR/cables.tau --out DIR/measured{seed} --random --random-approach --poses 100 --seed {seed} --effect length_scale(a):scale=1e-3"
        );
        tau_in(folder.path(), &line).done();
        let line = format!(
            "tau discover DIR/measured{seed} --model DIR/cables.tau --out DIR/out --json -"
        );
        let found = tau_in(folder.path(), &line).json();
        assert_eq!(effects(&found), ["length_scale(a)"], "{seed}");
        let remarks = found["remarks"].as_array().unwrap();
        let said = "with what was found, they agree";
        let is_said = |remark: &serde_json::Value| remark.as_str().unwrap().contains(said);
        assert!(remarks.iter().any(is_said), "{remarks:?}");
    }
}

/// A leg that is longer than its drive counts is as good as another length of it, but for the tolerance of that: it is
/// tried and named, though it has no amplitude beyond which measurements alone would show it.
#[test]
fn an_offset_that_only_tolerances_tell_from_a_length_is_a_candidate() {
    let folder = tempfile::tempdir().unwrap();
    for (poses, seed) in [(60, 1), (60, 2), (176, 3)] {
        let line = format!(
            "tau simulate --model hexapod --poses {poses} --seed {seed} --out DIR/measured{seed} --effect length_offset(leg3):offset=4e-3"
        );
        tau_in(folder.path(), &line).done();
        let line = format!("tau discover DIR/measured{seed} --out DIR/out --json -");
        let found = tau_in(folder.path(), &line).json();
        assert_eq!(effects(&found), ["length_offset(leg3)"], "{seed}");
        let promised = found["detectable"].as_array().unwrap();
        let is_leg = |effect: &&serde_json::Value| {
            effect["name"] == "length_offset" && effect["place"] == "leg3"
        };
        assert_eq!(promised.iter().find(is_leg), None);
    }
}

/// All carts move equally in set 2, and on tracks that lean towards each other that changes what the arm weighs on them.
#[test]
fn carts_yield_in_set_2_where_their_load_changes() {
    let folder = tempfile::tempdir().unwrap();
    let upright = fs::read_to_string(format!("{ROBOTS}/linear_delta.tau")).unwrap();
    let leaning = [
        ("cluster arm_a", "(0.8660254, 0, 0.5)"),
        ("cluster arm_b", "(-0.4330127, 0.75, 0.5)"),
        ("cluster arm_c", "(-0.4330127, -0.75, 0.5)"),
    ];
    let mut description = upright;
    for (cluster, direction) in leaning.into_iter().rev() {
        let (before, after) = description.split_once(cluster).unwrap();
        description = format!("{before}{cluster}{}", after.replace("(0, 0, 1)", direction));
    }
    fs::write(folder.path().join("leaning.tau"), description).unwrap();
    let payload = "[payload]
mass_kg = 20.0
centre_m = [0.0, 0.0, 0.0]
gravity_m_s2 = [0.0, 0.0, -9.81]
";
    fs::write(folder.path().join("delta.toml"), [DELTA, payload].concat()).unwrap();
    let hidden = "cart_compliance(c):along_compliance=7e-7,horizontal_compliance=9e-7";
    let line = format!(
        "tau simulate --model DIR/leaning.tau --robot DIR/delta.toml --out DIR/measured --random --seed 1 \
         --effect {hidden}"
    );
    tau_in(folder.path(), &line).done();
    let line = "tau discover DIR/measured --model DIR/leaning.tau --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    assert_eq!(effects(&found), ["cart_compliance(c)"]);
    assert_eq!(found["status"], "explained");
    let along = &found["effects"][0]["parameters"]["along_compliance"];
    let [value, sigma] = ["value", "sigma"].map(|key| along[key].as_f64().unwrap());
    assert!((value - 7e-7).abs() < 4.0 * sigma, "{along}");
}

/// Where tracks follow from formulas too, their carts show what the arm alone does not: a wave of 4 µm on a rack, and how a
/// cart turns.
#[test]
fn carts_on_tracks_by_formulas_take_part() {
    let folder = tempfile::tempdir().unwrap();
    for (name, effect) in [
        (
            "rack_pitch(b)",
            "rack_pitch(b):sine=4e-6,cosine=2e-6,period=0.0133",
        ),
        (
            "angular_motion(b)",
            "angular_motion(b):roll2=1.5e-2,pitch2=1.5e-2",
        ),
    ] {
        let measured = folder.path().join(name);
        let line = format!("--seed 100 --random-approach --effect {effect}");
        let line = format!(
            "tau simulate --model linear_delta --out {} {line}",
            measured.display()
        );
        tau_in(folder.path(), &line).done();
        let line = format!("tau discover {} --out DIR/out --json -", measured.display());
        let found = tau_in(folder.path(), &line).json();
        assert_eq!(effects(&found), [name]);
        let remarks = found["remarks"].to_string();
        assert!(!remarks.contains("is missing"), "{remarks}");
    }
}

/// Without poses too, what is written is what is said: a period starts where it was found, not in the middle of its range.
#[test]
fn a_period_is_written_where_it_was_found() {
    let folder = tempfile::tempdir().unwrap();
    let robot = "robot = \"LinearDelta\"
[noise]
heights = { height_m = 1e-5 }
distances = { distance_m = 2e-5 }
";
    fs::write(folder.path().join("delta.toml"), robot).unwrap();
    let with = "--model linear_delta";
    let line = format!(
        "tau simulate {with} --robot DIR/delta.toml --out DIR/measured --variant Full --random --poses 160 --seed 4 \
         --measure heights,distances --effect rack_pitch(b):sine=8e-5,period=0.0096"
    );
    tau_in(folder.path(), &line).done();
    let line = format!("tau discover DIR/measured {with} --out DIR/out --json -");
    let found = tau_in(folder.path(), &line).json();
    assert_eq!(effects(&found), ["rack_pitch(b)"]);
    let period = &found["effects"][0]["parameters"]["period"];
    let [value, sigma] = ["value", "sigma"].map(|key| period[key].as_f64().unwrap());
    let written = fs::read_to_string(folder.path().join("out/robot.toml")).unwrap();
    let line = written.lines().find(|line| line.starts_with("period"));
    let number = line.unwrap().split("value = ").nth(1).unwrap();
    let number: f64 = number.split(',').next().unwrap().parse().unwrap();
    assert!((number - value).abs() < 3.0 * sigma, "{number} {period}");
}

/// The length of a step is no track that bends: measured carts take no part where poses are unknown, and tracks stay straight.
#[test]
fn tracks_stay_straight_where_poses_are_unknown() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --out DIR/measured --random --poses 60 --measure heights";
    tau_in(folder.path(), line).done();
    assert!(folder.path().join("measured/cart_poses.csv").exists());
    let line = "tau discover DIR/measured --model linear_delta --base Full --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    assert_eq!(found["piecewise_tracks"].as_array().map_or(0, Vec::len), 0);
}

/// Set 1 are measured poses: where there are none, noise beyond the stated one is that of what was measured.
#[test]
fn noise_of_heights_is_none_of_set_1() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --out DIR/measured --random --poses 80 --seed 4 --measure heights \
         --noise-scale 2,2,2";
    tau_in(folder.path(), line).done();
    let line = "tau discover DIR/measured --model linear_delta --base Full --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    let remarks: Vec<&str> = (found["remarks"].as_array().unwrap().iter())
        .map(|remark| remark.as_str().unwrap())
        .collect();
    let says = |text: &str| remarks.iter().any(|remark| remark.contains(text));
    assert!(
        says("the noise of what was measured of the plate is "),
        "{remarks:?}"
    );
    assert!(!says("set 1 ("), "{remarks:?}");
}

/// Closures of exact drives beyond the plate's freedoms are no residuals: distances alone tell the noise, and where nothing
/// is hidden nothing is found.
#[test]
fn exact_drives_of_a_redundant_machine_are_no_residuals() {
    let folder = tempfile::tempdir().unwrap();
    let with = "--model four_belts";
    let line = format!(
        "tau simulate {with} --out DIR/measured --variant Full --random --poses 80 --seed 2 --measure distances"
    );
    tau_in(folder.path(), &line).done();
    let line = format!("tau calibrate DIR/measured {with} --variant Full --out DIR/c --json -");
    let fit = tau_in(folder.path(), &line).json();
    let number = |key: &str| fit["fit"][key].as_f64().unwrap();
    // Of forty distances by chance: three standard deviations.
    assert!((number("residual_over_noise") - 1.0).abs() < 0.34);
    assert!((number("dof") - 40.0).abs() < 2.0);
    let line = format!("tau discover DIR/measured {with} --base Full --out DIR/d --json -");
    let found = tau_in(folder.path(), &line).json();
    assert_eq!(found["status"], "nothing_missing");
}

/// A leg's stretch has its true size by measured forces though the stated payload is twice the true one; by statics it
/// has half of it. That of what holds the leg looks the same, by the leg's length: nothing tells which of the two it is.
#[test]
fn compliance_follows_measured_forces() {
    const STRAIN: f64 = 1.5e-6;
    const LENGTH_M: f64 = 0.855_522;
    let folder = tempfile::tempdir().unwrap();
    let line = format!(
        "tau simulate --model hexapod --variant Full --random --poses 80 --seed 3 --payload 40 --noise-force 0.5 \
         --effect link_compliance(leg2):strain={STRAIN:e} --out DIR/measured"
    );
    tau_in(folder.path(), &line).done();
    let edit = |file: &str, edit: &dyn Fn(&str) -> String| {
        let path = folder.path().join("measured").join(file);
        let text = fs::read_to_string(&path).unwrap();
        let edited = edit(&text);
        assert_ne!(text, edited);
        fs::write(&path, edited).unwrap();
    };
    edit("robot.toml", &|text| {
        text.replace("mass_kg = 40", "mass_kg = 80")
    });
    let found = || {
        let line = "tau discover DIR/measured --model hexapod --base Full --out DIR/out --json -";
        let found = tau_in(folder.path(), line).json();
        let effect = &found["effects"][0];
        let name = effects(&found).join(" + ");
        let (parameter, rival, length_m) = match name.as_str() {
            "link_compliance(leg2)" => ("strain", "anchor_compliance", 1.0),
            "anchor_compliance(leg2)" => ("yielding", "link_compliance", LENGTH_M),
            _ => panic!("{name}"),
        };
        assert_eq!(effect["rivals"][0]["name"], rival);
        let parameter = &effect["parameters"][parameter];
        let strain = ["value", "sigma"].map(|key| number(&parameter[key]) / length_m);
        (name, length_m, strain)
    };
    let is_near = |[value, sigma]: [f64; 2], expected: f64| {
        assert!(
            (value - expected).abs() < 4.0 * sigma && sigma < 0.1 * STRAIN,
            "{value} {sigma}"
        );
    };
    let (name, length_m, strain) = found();
    is_near(strain, STRAIN);
    let line = "tau calibrate DIR/measured --model DIR/out/discovered.tau --variant Discovered --out DIR/again --json -";
    assert_eq!(
        tau_in(folder.path(), line).json()["fit"]["status"],
        "consistent"
    );
    let robot = fs::read_to_string(folder.path().join("again/robot.toml")).unwrap();
    let of_effect = robot.split(&name).nth(1).unwrap();
    let value = of_effect.split("value = ").nth(1).unwrap();
    let value: f64 = value
        .split([',', ' ', '}'])
        .next()
        .unwrap()
        .parse()
        .unwrap();
    assert!((value / length_m / STRAIN - 1.0).abs() < 0.4, "{value}");
    edit("tcp_poses.csv", &|text| {
        let six = |line: &str| line.rsplitn(7, ',').last().unwrap().to_owned();
        text.lines().map(six).collect::<Vec<_>>().join("\n")
    });
    is_near(found().2, STRAIN / 2.0);
}

/// Links that grow by half a millimetre, fifty times the noise: at the stated noise the sixty parameters creep on in search of
/// it, or to a machine that does not reach its poses.
#[test]
fn what_is_missing_may_be_far_more_than_the_noise() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model gantry_tau --variant Full --random --poses 60 --seed 5 --measure positions \
                --warming 10 --effect link_thermal(all):expansion=4e-5 --out DIR/measured";
    tau_in(folder.path(), line).done();
    let line =
        "tau calibrate DIR/measured --model gantry_tau --variant Full --out DIR/cal --json -";
    let fitted = tau_in(folder.path(), line).json();
    assert_eq!(fitted["fit"]["status"], "inconsistent");
    assert!(number(&fitted["noise_factor"]) > 3.0, "{fitted}");
    assert!(number(&fitted["fit"]["residual_over_noise"]) > 3.0);
    assert!((number(&fitted["kinds"][0]["noise"]) / 1e-5 - 1.0).abs() < 1e-9);
    let line = "tau discover DIR/measured --model gantry_tau --base Full --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    assert_eq!(effects(&found), ["link_thermal(all)"]);
    assert_eq!(found["status"], "explained");
    let expansion = &found["effects"][0]["parameters"]["expansion"];
    let [value, sigma] = ["value", "sigma"].map(|key| number(&expansion[key]));
    assert!(
        (value - 4e-5).abs() < 4.0 * sigma && sigma < 2e-6,
        "{expansion}"
    );
}

/// The misfit of a link is told as an error of its length, also where the length is a formula: of clean positions it is
/// their noise along the link, 10 µm, less what the fit takes of it.
#[test]
fn misfit_of_lengths_is_in_micrometres_of_the_length() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --out DIR/measured --random --seed 3";
    tau_in(folder.path(), line).done();
    let line = "tau discover DIR/measured --model linear_delta --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    let lengths: Vec<_> = (found["where"].as_array().unwrap().iter())
        .filter(|misfit| misfit["coordinate"] == "length")
        .collect();
    assert_eq!(lengths.len(), 3, "{lengths:?}");
    for misfit in lengths {
        let [rms, expected] = ["rms", "expected_rms"].map(|key| number(&misfit[key]));
        assert!((9.0..10.0).contains(&expected), "{misfit}");
        assert!((rms / expected - 1.0).abs() < 0.3, "{misfit}");
    }
}

/// Where no pose was measured, targets on carts still tell that a cart yields: its load follows from where the machine
/// stands, which drives say.
#[test]
fn a_cart_that_yields_is_calibrated_without_poses() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --measure heights,distances --poses 120 --random \
                --random-approach --warming 6 --payload 20 --seed 1 --out DIR/measured \
                --effect cart_compliance(a):along_compliance=2.59e-7";
    tau_in(folder.path(), line).done();
    assert!(folder.path().join("measured/cart_positions.csv").is_file());
    let line = "tau discover DIR/measured --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    assert_eq!(effects(&found), ["cart_compliance(a)"]);
    let line = "tau calibrate DIR/measured --model DIR/out/discovered.tau --variant Discovered \
                --out DIR/cal --json -";
    let fitted = tau_in(folder.path(), line).json();
    assert_eq!(fitted["fit"]["status"], "consistent");
}

/// Distances and heights beside a few poses count: they tell a backlash from the waves of a rack, which the poses alone
/// don't.
#[test]
fn what_was_measured_beside_poses_takes_part() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --measure poses,heights,distances --poses 120 --random \
                --random-approach --warming 6 --payload 20 --seed 5 --out DIR/measured \
                --effect backlash(a):gap=6e-5";
    tau_in(folder.path(), line).done();
    for file in ["cart_poses.csv", "cart_positions.csv"] {
        fs::remove_file(folder.path().join("measured").join(file)).unwrap();
    }
    let poses = folder.path().join("measured/tcp_poses.csv");
    let text = fs::read_to_string(&poses).unwrap();
    let few: Vec<&str> = text.lines().take(17).collect();
    fs::write(&poses, few.join("\n") + "\n").unwrap();
    let line = "tau discover DIR/measured --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    assert_eq!(effects(&found), ["backlash(a)"]);
    assert_eq!(found["effects"][0]["rivals"].to_string(), "[]");
    assert_eq!(found["validation"]["of"], "measurements");
}

/// Drives that turn have noise in radians, which makes errors of lengths: on a clean folder these are what noise alone leaves.
#[test]
fn errors_of_drives_that_turn_are_lengths() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model rotary_delta --measure heights,distances --poses 120 --random \
                --noise-drives 1e-4 --seed 1 --out DIR/measured";
    tau_in(folder.path(), line).done();
    let line = "tau discover DIR/measured --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    let floor = number(&found["noise_floor_um"]);
    let before = number(&found["validation"]["before"]["mean_um"]);
    assert!((5.0..40.0).contains(&floor), "{floor}");
    assert!((before / floor - 1.0).abs() < 0.3, "{before} {floor}");
}
