//! What commands compute and write.

use std::fs;

use serde_json::Value;
use tau_testkit::{GANTRY, PROTOTYPE, Work, fields, list, number};

/// Mean, largest and root of the mean squared position error.
fn position_um(of: &Value) -> [f64; 3] {
    ["mean", "max", "rms"].map(|name| number(&of["position_um"][name]))
}

#[track_caller]
fn same_um(one: &Value, other: &Value) {
    for (one, other) in position_um(one).into_iter().zip(position_um(other)) {
        assert!((one - other).abs() < 1e-3, "{one} µm, then {other} µm");
    }
}

#[test]
fn a_split_changes_which_poses_take_part() {
    let evaluated = |options: &str| {
        let line = format!("evaluate --variant Nominal --json - {options}");
        let found = Work::empty().run(&line).json();
        let counts = ["calibration", "validation"].map(|part| number(&found["poses"][part]));
        (counts, number(&found["position_um"]["mean"]))
    };
    assert_eq!(evaluated("--split first:100").0, [100.0, 21.0]);
    let of_seed = |seed: u32| evaluated(&format!("--split fraction:0.8 --seed {seed}"));
    assert_eq!(of_seed(2).0, [97.0, 24.0]);
    assert_eq!(of_seed(2), evaluated("--split fraction:0.8:2"));
    assert_ne!(of_seed(2).1, of_seed(3).1);
}

/// A reduced arm, and a full one with an effect.
#[test]
fn what_calibrate_writes_evaluates_to_what_it_says() {
    for variant in ["Nominal", "FullRack"] {
        let work = Work::empty();
        let line = format!("calibrate PROTOTYPE --variant {variant} --out DIR/out");
        let calibrated = work.json(&line);
        let line = format!("evaluate PROTOTYPE --variant {variant} --robot DIR/out/robot.toml");
        same_um(&calibrated, &work.json(&line));
        let names = "covariance.csv parameters.csv robot.toml statistics.json undetermined.csv";
        assert_eq!(work.listing("out").join(" "), names);
        let statistics: Value = serde_json::from_str(&work.read("out/statistics.json")).unwrap();
        assert_eq!(statistics, calibrated);

        let table = |name: &str| work.table(&format!("out/{name}.csv"));
        let (parameters, covariance) = (table("parameters"), table("covariance"));
        let names = parameters.cells(&parameters.header[0]);
        assert_eq!(covariance.header[1..], names);
        assert_eq!(covariance.cells(&covariance.header[0]), names);
        let sigmas = parameters.numbers(&parameters.header[5]);
        for (row, name) in (1..).zip(&names) {
            let sigma = sigmas[row - 1];
            let variance = covariance.number(row, name);
            assert!((variance.sqrt() - sigma).abs() < 1e-9 * sigma, "{name}");
            for (column, other) in (1..row).zip(&names) {
                let difference = covariance.number(row, other) - covariance.number(column, name);
                let scale = sigma * sigmas[column - 1];
                assert!(difference.abs() <= 1e-9 * scale, "{name} {other}");
            }
        }
    }
}

/// All files calibrate, an option of old says so, and those that are named alone.
#[test]
fn every_file_calibrates_that_is_not_left_out() {
    let work = Work::empty();
    let of = |with: &str| {
        let line = format!("calibrate PROTOTYPE --variant Full --split all {with} --out DIR/out");
        work.json(&line)
    };
    let files = |of: &Value| -> Vec<String> {
        let by_file = list(&of["fit"]["by_file"]).iter();
        by_file
            .map(|own| own["file"].as_str().unwrap().to_owned())
            .collect()
    };
    let (all, old) = (of(""), of("--errors-in-variables"));
    assert_eq!(all["parameters"], old["parameters"]);
    assert!(list(&old["remark_codes"]).contains(&Value::from("T262")));
    let [set_1, set_2, set_3] = ["tcp_poses.csv", "cart_poses.csv", "cart_positions.csv"];
    assert_eq!(files(&all), [set_1, set_2, set_2, set_3]);
    let alone = of(&format!("--files {set_1}"));
    assert_eq!(files(&alone), [set_1]);
}

#[test]
fn sensitivities_are_proportional_to_the_step() {
    let work = Work::empty();
    work.run("calibrate PROTOTYPE --variant Full --out DIR/full -q")
        .done();
    let of = |with: &str| {
        let line = format!("sensitivity {with} --robot DIR/full/robot.toml --variant Full");
        work.json(&line)
    };
    let found = of("PROTOTYPE --step 5e-5");
    assert_eq!([&found["poses"], &found["step"]].map(number), [60.0, 5e-5]);
    let names = ["L", "Px", "Offset_z", "Orient_1", "Orient_3"];
    for table in ["position_mm", "orientation_rad", "cost_m4"] {
        for link in ["l1", "l2a", "l2b", "l3a", "l3b", "l3c"] {
            fields(&found[table][link], names);
        }
    }
    let length = |found: &Value| number(&found["position_mm"]["l1"]["L"]);
    let halved = length(&of("PROTOTYPE --step 2.5e-5"));
    let ratio = 2.0 * halved / length(&found);
    assert!((ratio - 1.0).abs() < 1e-3, "{ratio}");
    // Without a folder and a step they are those of the measurements that ship, by the paper's step.
    assert_eq!(of(""), found);
}

/// Commands that the machine of the drawings reaches are out of the true one's reach here and there.
#[test]
fn poses_that_the_true_machine_does_not_reach_are_left_out() {
    // A joint so far off its place that the rod is too short for the highest poses.
    let line = "simulate --model ROBOTS/hexaglide.tau --seed 7 --random --poses 60 --cart-poses 20 --track-points 6 --noise-position 1e-5 --noise-rotation 4e-5 \
                --effect joint_placement(l1):offset=(0,0,-0.035) --out MEASURED --json -";
    let made = Work::empty().run(line).json();
    let left_out = number(&made["out_of_reach"]);
    assert!((1.0..20.0).contains(&left_out), "{made:#}");
    let poses = number(&made["rows"]["tcp_poses"]);
    let positions = number(&made["rows"]["cart_positions"]) / 6.0;
    assert_eq!(poses + positions + left_out, 60.0 + 20.0);
}

#[test]
fn generate_writes_what_is_checked_in() {
    let work = Work::empty();
    work.write("gantry_tau.tau", fs::read(GANTRY).unwrap());
    let line = "generate DIR/gantry_tau.tau --out DIR/code";
    let check = |expected: u8| {
        let ran = work.run(&format!("{line} --check"));
        let told = (ran.code, ran.says("T283"));
        assert_eq!(told, (expected, expected == 1), "{}", ran.err);
        ran
    };
    check(1).shows("T283");
    assert_eq!(work.listing(""), ["gantry_tau.tau"]);

    work.run(line).done();
    let written = work.read("code/gantry_tau.rs");
    let checked_in = include_str!("../../generated/src/models/gantry_tau.rs");
    let code = |text: &str| text.split_once('\n').unwrap().1.to_owned();
    assert_eq!(code(&written), code(checked_in));
    check(0);

    // The header's command is one that a user can run.
    let command = written.lines().next().unwrap().split('`').nth(1).unwrap();
    work.remove("code/gantry_tau.rs");
    work.run(command.strip_prefix("tau ").unwrap()).done();
    assert_eq!(work.read("code/gantry_tau.rs"), written);

    work.write("code/gantry_tau.rs", written.replacen("const", "static", 1));
    check(1);
    work.run(line).done();
    assert_eq!(work.read("code/gantry_tau.rs"), written);
}

/// However its places are spaced, and told where the variant does not have it.
#[test]
fn an_effect_of_a_robot_file_takes_effect_or_is_told() {
    let work = Work::empty();
    let robot = fs::read_to_string(format!("{PROTOTYPE}/robot.toml")).unwrap();
    let mean_um = |effect: &str| {
        let effect = format!("[effects.\"{effect}\"]\nsine = {{ value = 1e-3, tol = 1.0 }}\n");
        work.write("robot.toml", format!("{robot}\n{effect}"));
        let ran = work.run("evaluate PROTOTYPE --variant FullRack --robot DIR/robot.toml --json -");
        let is_told = ran.says("T255");
        (position_um(&ran.json())[0], is_told)
    };
    let moved = mean_um("rack_pitch(two)");
    assert!(!moved.1);
    assert_eq!(mean_um("rack_pitch( two )"), moved);
    let unmoved = mean_um("rack_pich(two)");
    assert!(unmoved.1);
    assert!((moved.0 - unmoved.0).abs() > 100.0, "{moved:?} {unmoved:?}");
}

/// A folder of a standard robot needs no description: its parameters say which one it is.
#[test]
fn robot_files_name_standard_robots() {
    let work = Work::simulated("--model five_bar");
    assert_eq!(work.calibrated("--variant Full")["robot"], "FiveBar");
    work.run("kinematics forward --robot DIR/out/robot.toml --variant Full --commands 0,0")
        .done();
    work.run("simulate --robot DIR/out/robot.toml --out DIR/again")
        .done();
    let other = work.run("calibrate MEASURED --model rotary_delta --variant Full --out DIR/other");
    assert_eq!(other.code, 2, "the description that is asked for counts");
}

#[test]
fn a_file_for_another_robot_is_remarked() {
    let work = Work::prototype();
    work.replace("\"GantryTau\"", "\"GantryTau2\"");
    for line in [
        "calibrate PROTOTYPE --robot MEASURED/robot.toml --variant Nominal --out DIR/calibrated",
        "kinematics forward --robot MEASURED/robot.toml --variant Full --commands 0,0,0",
    ] {
        let ran = work.run(line);
        let told = (ran.code, ran.says("T253"));
        assert_eq!(told, (0, true), "{line}: {}", ran.err);
    }
    let with = "PROTOTYPE --robot MEASURED/robot.toml --no-discover --out DIR/study";
    let study = work.json(&format!("study {with}"));
    assert_eq!(study["remark_codes"][0], "T253");
}

/// Readings of more drives than freedoms are measurements, whose noise nobody stated.
#[test]
fn exact_readings_of_redundant_drives_are_remarked() {
    for (with, is_remarked) in [
        ("four_belts --measure readings", true),
        ("four_lines", true),
        ("four_belts --measure readings --noise-drives 1e-4", false),
        ("five_bar", false),
    ] {
        let line = format!("simulate --model {with} --poses 12 --out DIR/out --json -");
        let ran = Work::empty().run(&line);
        assert_eq!(ran.says("T347"), is_remarked, "{with}: {}", ran.err);
        // Sets of carts that a machine lacks are not counted.
        assert_eq!(ran.json()["rows"]["cart_poses"], 0, "{with}");
    }
}

/// Of each leg of a hexapod seven parameters are not known: seven poses leave nothing to judge a fit by, whatever asks for it.
#[test]
fn commands_count_poses_alike() {
    let work = Work::simulated("--model hexapod --random --poses 8 --seed 3");
    for (poses, codes) in [(8, [0, 0, 0]), (7, [1, 2, 2]), (6, [1, 2, 2])] {
        work.edit("tcp_poses.csv", |table| table.keep(|row| row <= poses));
        let ran = [
            "check MEASURED --variant Full",
            "calibrate MEASURED --variant Full --out DIR/out",
            "discover MEASURED --out DIR/out",
        ];
        let ran = ran.map(|line| work.run(&format!("{line} --split all")));
        for (ran, code) in ran.iter().zip(codes) {
            assert_eq!(
                (ran.code, ran.says("T330")),
                (code, code > 0),
                "{poses}: {}",
                ran.err
            );
        }
    }
}

/// Whatever is not consistent fails where that is asked for, and is written all the same.
#[test]
fn strict_commands_fail_unless_consistent() {
    let (clean, noisy) = ("--model five_bar --poses 20", "--noise-scale 5,5,5");
    for (simulated, failed) in [(clean, 0), (&format!("{clean} {noisy}"), 1)] {
        let work = Work::simulated(simulated);
        for line in [
            "check MEASURED",
            "calibrate MEASURED --variant Full --out DIR/out",
            "evaluate MEASURED --variant Full --robot DIR/out/robot.toml",
            "study MEASURED --no-discover --out DIR/study",
            "discover MEASURED --out DIR/found",
        ] {
            let [strict, lenient] =
                ["--strict", ""].map(|more| work.run(&format!("{line} {more}")));
            assert_eq!(
                (strict.code, lenient.code),
                (failed, 0),
                "{line}: {}",
                strict.err
            );
            assert_eq!(strict.says("T362"), failed > 0, "{line}");
            assert_eq!(strict.out, lenient.out, "{line}");
        }
    }
}
