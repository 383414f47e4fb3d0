//! The command line: what it computes, prints and writes, and what it answers bad input with.

mod bad_input;
mod kinematics;

use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

use serde_json::Value;
use tau::Robot;
use tau::robot_file::RobotFile;

use crate::support::{DATA, DESCRIPTION, fields, gantry_tau, listing, number, tau_in};

const VARIANTS: [&str; 5] = [
    "Nominal",
    "Piecewise",
    "Full",
    "FullPiecewise",
    "BestPerLink",
];

#[test]
fn the_study_prints_the_tables_and_writes_the_report() {
    let folder = tempfile::tempdir().unwrap();
    let ran = tau_in(
        folder.path(),
        "tau study --no-discover --out DIR/new/study --json DIR/json/study.json",
    );
    assert_eq!(ran.err, "");
    let out = ran.done();
    for expected in ["Table I.", "Table II.", "Table III.", "report.html"] {
        assert!(out.contains(expected), "{expected} in {out}");
    }
    let study = folder.path().join("new/study");
    let written: Vec<PathBuf> = out
        .lines()
        .skip_while(|line| *line != "Written")
        .skip(1)
        .map(|line| PathBuf::from(line.trim()))
        .collect();
    assert_eq!(listing(&study).len(), written.len());
    assert!(written.iter().all(|path| path.is_file()), "{written:?}");
    for figure in [
        "figure_4",
        "figure_5",
        "figure_6",
        "figure_8",
        "figure_9",
        "figure_10",
    ] {
        let is_there = listing(&study).iter().any(|name| name.starts_with(figure));
        assert!(is_there, "{figure}");
    }
    let json = |path: &Path| -> Value { serde_json::from_slice(&fs::read(path).unwrap()).unwrap() };
    assert_eq!(
        json(&study.join("study.json")),
        json(&folder.path().join("json/study.json"))
    );
}

#[test]
fn the_json_of_a_study_has_its_fields() {
    let folder = tempfile::tempdir().unwrap();
    let study = tau_in(folder.path(), "tau study DATA --out DIR/study --json -").json();
    fields(&study, ["variants", "poses", "discovery"]);
    assert_eq!(study["discovery"]["base"], "Full");
    let poses =
        ["total", "in_range", "calibration", "validation"].map(|name| &study["poses"][name]);
    assert_eq!(poses.map(number), [176.0, 121.0, 61.0, 60.0]);
    for name in VARIANTS {
        let variant = &study["variants"][name];
        fields(&variant["position_um"], ["mean", "max", "rms"]);
        assert!(number(&variant["position_um"]["mean"]) < 150.0);
        assert!(number(&variant["iterations"]) > 0.0);
        let links = variant["links"].as_object().expect("links");
        let is_full = variant["orientation_rad"].is_object();
        assert_eq!(links.len(), if is_full { 6 } else { 3 }, "{name}");
        if is_full {
            let angles = &variant["orientation_rad"]["max_abs"];
            assert_eq!(angles.as_array().map(Vec::len), Some(3));
        }
        for link in links.values() {
            let names = [
                "length_m",
                "plate_joint_m",
                "track_offset_m",
                "track_direction",
                "cost",
            ];
            fields(link, names);
        }
    }
}

#[test]
fn a_split_changes_which_poses_take_part() {
    let folder = tempfile::tempdir().unwrap();
    let counts = |options: &str| {
        let line = format!("tau evaluate --variant Nominal --json - {options}");
        let poses = &tau_in(folder.path(), &line).json()["poses"];
        [number(&poses["calibration"]), number(&poses["validation"])]
    };
    assert_eq!(counts("--split first:100"), [100.0, 21.0]);
    assert_eq!(counts("--split fraction:0.8 --seed 2"), [97.0, 24.0]);
    let mean = |options: &str| {
        let line = format!("tau evaluate --variant Nominal --json - {options}");
        number(&tau_in(folder.path(), &line).json()["position_um"]["mean"])
    };
    let of_seed = |seed: u32| mean(&format!("--split fraction:0.8 --seed {seed}"));
    assert_eq!(of_seed(2), mean("--split fraction:0.8:2"));
    assert_ne!(of_seed(2), of_seed(3));
}

#[test]
fn what_calibrate_writes_evaluates_to_what_it_says() {
    let folder = tempfile::tempdir().unwrap();
    let robot = gantry_tau();
    for variant in VARIANTS.into_iter().chain(["FullRack"]) {
        let line = format!("tau calibrate DATA --variant {variant} --out DIR/{variant} --json -");
        let calibrated = tau_in(folder.path(), &line).json();
        let line = format!(
            "tau evaluate DATA --variant {variant} --robot DIR/{variant}/robot.toml --json -"
        );
        let evaluated = tau_in(folder.path(), &line).json();
        fields(
            &evaluated,
            ["position_um", "orientation_rad", "poses", "pose_errors"],
        );
        for name in ["mean", "max", "rms"] {
            let [a, b] = [&calibrated, &evaluated].map(|v| number(&v["position_um"][name]));
            assert!(
                (a - b).abs() < 1e-3,
                "{variant}: {name} is {a} µm, then {b} µm"
            );
        }
        let out = folder.path().join(variant);
        let names = [
            "covariance.csv",
            "parameters.csv",
            "robot.toml",
            "statistics.json",
            "undetermined.csv",
        ];
        assert_eq!(listing(&out), names);
        let statistics = fs::read_to_string(out.join("statistics.json")).unwrap();
        assert_eq!(
            serde_json::from_str::<Value>(&statistics).unwrap(),
            calibrated
        );
        RobotFile::read(&out.join("robot.toml"), &robot).unwrap();
    }
}

#[test]
fn errors_in_variables_stand_beside_the_closure_fit() {
    let folder = tempfile::tempdir().unwrap();
    for variant in ["Nominal", "FullRack"] {
        let of = |flag: &str, out: &str| {
            let line =
                format!("tau calibrate DATA --variant {variant} {flag} --out DIR/{out} --json -");
            tau_in(folder.path(), &line).json()
        };
        let (ordinary, found) = (of("", "closures"), of("--errors-in-variables", "poses"));
        let comparison = &found["errors_in_variables"];
        fields(
            comparison,
            [
                "unknowns",
                "closure_m",
                "groups",
                "position_um",
                "closure_fit",
            ],
        );
        let closure_fit = &comparison["closure_fit"];
        for name in ["mean", "max", "rms"] {
            assert_eq!(
                closure_fit["position_um"][name],
                ordinary["position_um"][name]
            );
            assert_eq!(comparison["position_um"][name], found["position_um"][name]);
        }
        let parameters = |value: &Value| value["parameters"].as_array().unwrap().clone();
        let (before, after) = (parameters(&ordinary), parameters(&found));
        for ((before, after), difference) in before.iter().zip(&after).zip(parameters(closure_fit))
        {
            assert_eq!(before["name"], after["name"]);
            assert_eq!(before["value"], difference["value"]);
            let change = number(&after["value"]) - number(&before["value"]);
            let sigmas = number(&difference["difference_sigma"]);
            assert!((sigmas * number(&before["sigma"]) - change).abs() < 1e-12);
        }
        let line =
            format!("tau evaluate DATA --variant {variant} --robot DIR/poses/robot.toml --json -");
        let evaluated = tau_in(folder.path(), &line).json();
        let [a, b] = [&found, &evaluated].map(|v| number(&v["position_um"]["mean"]));
        assert!((a - b).abs() < 1e-3, "{variant}: {a} µm, then {b} µm");
    }
    let line = "tau calibrate DATA --variant Nominal --errors-in-variables --out DIR/again";
    let summary = tau_in(folder.path(), line).done();
    assert!(
        summary.contains("Against the closure fit of set 1"),
        "{summary}"
    );
}

#[test]
fn the_covariance_belongs_to_the_parameters() {
    let folder = tempfile::tempdir().unwrap();
    let summary = tau_in(folder.path(), "tau calibrate --variant Full --out DIR").done();
    assert!(summary.contains("Table II."), "{summary}");
    let table = |name: &str| -> Vec<Vec<String>> {
        let text = fs::read_to_string(folder.path().join(name)).unwrap();
        let row = |line: &str| line.split(',').map(str::to_owned).collect();
        text.lines().map(row).collect()
    };
    let (parameters, covariance) = (table("parameters.csv"), table("covariance.csv"));
    assert_eq!(parameters.len(), 61);
    assert_eq!(covariance.len(), 61);
    let entry = |row: usize, column: usize| covariance[row][column].parse::<f64>().unwrap();
    for row in 1..61 {
        assert_eq!(covariance[row][0], parameters[row][0]);
        assert_eq!(covariance[0][row], parameters[row][0]);
        let sigma: f64 = parameters[row][5].parse().unwrap();
        assert!((entry(row, row).sqrt() - sigma).abs() < 1e-9 * sigma);
        let is_symmetric = |column: usize| {
            let difference = (entry(row, column) - entry(column, row)).abs();
            difference <= 1e-9 * (entry(row, row) * entry(column, column)).sqrt()
        };
        assert!((1..row).all(is_symmetric), "{}", covariance[row][0]);
    }
    assert_eq!(
        table("undetermined.csv")[0][..2],
        ["combination", "data_over_prior"]
    );
}

#[test]
fn the_json_of_sensitivity_has_its_fields() {
    let folder = tempfile::tempdir().unwrap();
    tau_in(
        folder.path(),
        "tau calibrate DATA --variant Full --out DIR/full -q",
    )
    .done();
    let line =
        "tau sensitivity DATA --robot DIR/full/robot.toml --variant Full --step 5e-5 --json -";
    let found = tau_in(folder.path(), line).json();
    assert_eq!(number(&found["poses"]), 60.0);
    assert_eq!(number(&found["step"]), 5e-5);
    for table in ["position_mm", "orientation_rad", "cost_m4"] {
        for link in ["l1", "l2a", "l2b", "l3a", "l3b", "l3c"] {
            let row = &found[table][link];
            fields(
                row,
                ["L", "Px", "Py", "Pz", "Offset_x", "Offset_y", "Offset_z"],
            );
            fields(row, ["Orient_1", "Orient_2", "Orient_3"]);
        }
    }
    // Table III of the paper gives 11.42 mm for the length of link 1, with its own parameters.
    let length = number(&found["position_mm"]["l1"]["L"]);
    assert!((8.0..15.0).contains(&length), "{length}");

    let half = tau_in(folder.path(), &line.replace("5e-5", "2.5e-5")).json();
    let halved = number(&half["position_mm"]["l1"]["L"]);
    assert!((2.0 * halved - length).abs() < 1e-3 * length);
    let without_folder = "tau sensitivity --variant Full --robot DIR/full/robot.toml --json -";
    assert_eq!(tau_in(folder.path(), without_folder).json(), found);
}

#[test]
fn simulate_writes_a_folder_that_calibrates() {
    let folder = tempfile::tempdir().unwrap();
    let line =
        "tau simulate --out DIR/measured --seed 5 --poses 60 --effect backlash(two):gap=4e-5";
    let made = tau_in(folder.path(), &format!("{line} --json -")).json();
    assert_eq!(made["effects"][0]["name"], "backlash");
    assert_eq!(made["effects"][0]["place"], "two");
    assert_eq!(number(&made["rows"]["tcp_poses"]), 60.0);
    let names = [
        "cart_poses.csv",
        "cart_positions.csv",
        "robot.toml",
        "tcp_poses.csv",
        "truth.json",
    ];
    assert_eq!(listing(&folder.path().join("measured")), names);
    let line = "tau calibrate DIR/measured --variant Full --out DIR/calibrated --json -";
    let calibrated = tau_in(folder.path(), line).json();
    assert!(
        (15.0..60.0).contains(&number(&calibrated["position_um"]["mean"])),
        "{calibrated:#}"
    );
}

/// Commands that the machine of the drawings reaches are out of the true one's reach here and there.
#[test]
fn poses_that_the_true_machine_does_not_reach_are_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let robot = "robot = \"Hexaglide\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    fs::write(folder.path().join("robot.toml"), robot).unwrap();
    // A joint so far off its place that the rod is too short for the highest poses.
    let line = "tau simulate --model ROBOTS/hexaglide.tau --robot DIR/robot.toml --seed 7 --random \
                --effect joint_placement(l1):offset=(0,0,-0.035) --out DIR/measured --json -";
    let made = tau_in(folder.path(), line).json();
    let left_out = number(&made["out_of_reach"]);
    assert!((1.0..20.0).contains(&left_out), "{made:#}");
    let poses = number(&made["rows"]["tcp_poses"]);
    let positions = number(&made["rows"]["cart_positions"]) / 6.0;
    assert_eq!(poses + positions + left_out, 176.0 + 150.0);
}

#[test]
fn generate_writes_what_is_checked_in() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau generate GANTRY --out DIR/code";
    let path = folder.path().join("code/gantry_tau.rs");

    let missing = tau_in(folder.path(), &format!("{line} --check"));
    assert_eq!((missing.code, missing.out.as_str()), (1, ""));
    assert!(
        missing.err.contains("gantry_tau.rs does not exist"),
        "{}",
        missing.err
    );
    assert!(!path.exists());

    tau_in(folder.path(), line).done();
    let written = fs::read_to_string(&path).unwrap();
    let checked_in = include_str!("../../generated/src/models/gantry_tau.rs");
    let code = |text: &str| text.split_once('\n').unwrap().1.to_owned();
    assert_eq!(code(&written), code(checked_in));
    tau_in(folder.path(), &format!("{line} --check")).done();

    // The header's command is one that a user can run.
    let header = written.lines().next().unwrap();
    let command = header.split('`').nth(1).unwrap();
    fs::remove_file(&path).unwrap();
    tau_in(folder.path(), command).done();
    assert_eq!(fs::read_to_string(&path).unwrap(), written);

    fs::write(&path, written.replacen("const", "static", 1)).unwrap();
    let stale = tau_in(folder.path(), &format!("{line} --check"));
    assert_eq!(stale.code, 1);
    assert!(
        stale.err.contains("gantry_tau.rs is stale from line"),
        "{}",
        stale.err
    );
    tau_in(folder.path(), line).done();
    assert_eq!(fs::read_to_string(&path).unwrap(), written);
}

#[test]
fn a_description_of_ones_own_is_compiled_at_run_time() {
    let folder = tempfile::tempdir().unwrap();
    let line = |model: &str| format!("tau calibrate DATA --variant Full --out DIR/{model}");
    tau_in(folder.path(), &line("built_in")).done();
    tau_in(folder.path(), &(line("typed") + " --model GANTRY")).done();
    for file in ["robot.toml", "covariance.csv", "statistics.json"] {
        let [a, b] = ["built_in", "typed"]
            .map(|model| fs::read(folder.path().join(model).join(file)).unwrap());
        assert!(a == b, "{file}");
    }
}

/// Names that Rust could not tell apart are refused, where the description declares them.
#[test]
fn names_that_would_be_one_in_generated_code_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let text = "robot Slide {
    track one;
    cluster arm on one { link l1, l2, l3, l4, l5, l6; }
    variant Robot { arm full; tracks linear; }
}
";
    fs::write(folder.path().join("slide.tau"), text).unwrap();
    let ran = tau_in(folder.path(), "tau generate DIR/slide.tau --out DIR/code");
    assert_eq!(ran.code, 2);
    assert!(ran.err.contains("slide.tau:4:13"), "{}", ran.err);
    assert!(
        ran.err.contains("`ROBOT` is the robot itself"),
        "{}",
        ran.err
    );
    assert!(!folder.path().join("code").exists());
}

#[test]
fn quiet_commands_print_only_what_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    for line in [
        "tau -q study --out DIR/study",
        "tau calibrate --quiet --variant Nominal --out DIR/nominal",
        "tau generate -q GANTRY --out DIR/code",
        "tau evaluate -q --variant Nominal",
    ] {
        let ran = tau_in(folder.path(), line);
        assert_eq!((ran.code, ran.out.as_str()), (0, ""), "{line}");
        // A verdict is not hidden: the measurements that ship hold more than these variants know.
        let verdicts = usize::from(!line.contains("generate"));
        assert_eq!(ran.err.lines().count(), verdicts, "{line}: {}", ran.err);
        assert!(
            ran.err.lines().all(|line| line.starts_with("verdict: ")),
            "{}",
            ran.err
        );
    }
    let value = tau_in(folder.path(), "tau evaluate -q --variant Nominal --json -").json();
    assert_eq!(value["variant"], "Nominal");
}

/// However its places are spaced, and told where the variant does not have it.
#[test]
fn an_effect_of_a_robot_file_takes_effect_or_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let robot = fs::read_to_string(format!("{DATA}/robot.toml")).unwrap();
    let mean_um = |effect: &str| {
        let text =
            format!("{robot}\n[effects.\"{effect}\"]\nsine = {{ value = 1e-3, tol = 1.0 }}\n");
        fs::write(folder.path().join("robot.toml"), text).unwrap();
        let line = "tau evaluate DATA --variant FullRack --robot DIR/robot.toml --json -";
        let ran = tau_in(folder.path(), line);
        let remarks = ran.err.clone();
        (number(&ran.json()["position_um"]["mean"]), remarks)
    };
    let (moved, remarks) = mean_um("rack_pitch(two)");
    assert!(!remarks.contains("rack"), "{remarks}");
    assert_eq!(mean_um("rack_pitch( two )").0, moved);
    let (unmoved, remarks) = mean_um("rack_pich(two)");
    assert!(
        remarks.contains("the values of `rack_pich(two)`"),
        "{remarks}"
    );
    assert!((moved - unmoved).abs() > 100.0, "{moved} {unmoved}");
}

/// A folder of a standard robot needs no description: its parameters say which one it is.
#[test]
fn robot_files_name_standard_robots() {
    let folder = tempfile::tempdir().unwrap();
    let run = |line: &str| {
        let ran = tau_in(folder.path(), line);
        assert_eq!(ran.code, 0, "{line}: {}", ran.err);
        ran
    };
    run("tau simulate --model five_bar --out DIR/measured");
    let line = "tau calibrate DIR/measured --variant Full --out DIR/calibrated --json -";
    let found = run(line).json();
    assert_eq!(found["robot"], "FiveBar");
    run("tau kinematics forward --robot DIR/calibrated/robot.toml --variant Full --commands 0,0");
    run("tau simulate --robot DIR/calibrated/robot.toml --out DIR/again");
    let line = "tau calibrate DIR/measured --model rotary_delta --variant Full --out DIR/other";
    let other = tau_in(folder.path(), line);
    assert_eq!(other.code, 2, "the description that is asked for counts");
}

#[test]
fn a_file_for_another_robot_is_remarked() {
    let folder = tempfile::tempdir().unwrap();
    let file = fs::read_to_string(format!("{DATA}/robot.toml")).unwrap();
    let other = file.replacen("\"GantryTau\"", "\"GantryTau2\"", 1);
    fs::write(folder.path().join("robot.toml"), other).unwrap();
    let remark = "robot.toml is for robot `GantryTau2`, the description is of `GantryTau`";
    let with = "DATA --robot DIR/robot.toml";
    for line in [
        format!("tau calibrate {with} --variant Full --out DIR/calibrated"),
        "tau kinematics forward --robot DIR/robot.toml --variant Full --commands 0,0,0".to_owned(),
    ] {
        let ran = tau_in(folder.path(), &line);
        assert!(
            ran.code == 0 && ran.err.contains(remark),
            "{line}: {}",
            ran.err
        );
    }
    let line = format!("tau study {with} --no-discover --out DIR/study --json -");
    let study = tau_in(folder.path(), &line).json();
    assert_eq!(study["remarks"][0], remark);
}

#[test]
fn remarks_go_to_standard_error() {
    let folder = tempfile::tempdir().unwrap();
    let ran = tau_in(
        folder.path(),
        "tau evaluate DATA --variant Nominal --json -",
    );
    assert!(ran.err.starts_with("note: 55 of 176 poses"), "{}", ran.err);
    ran.json();
}

#[test]
fn completions_know_every_command() {
    let folder = tempfile::tempdir().unwrap();
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = tau_in(folder.path(), &format!("tau completions {shell}")).done();
        for command in [
            "study",
            "calibrate",
            "evaluate",
            "sensitivity",
            "generate",
            "kinematics",
        ] {
            assert!(script.contains(command), "{command} in {shell}");
        }
    }
}

#[test]
fn help_teaches() {
    let folder = tempfile::tempdir().unwrap();
    for command in [
        "",
        "study",
        "check",
        "calibrate",
        "evaluate",
        "sensitivity",
        "discover",
        "import",
        "export",
        "simulate",
        "generate",
        "kinematics",
        "kinematics forward",
        "kinematics inverse",
        "completions",
    ] {
        let line = format!("tau {command} --help");
        let ran = tau_in(folder.path(), &line);
        assert_eq!(ran.err, "");
        let help = ran.done();
        let too_wide = help.lines().find(|line| line.chars().count() > 110);
        assert_eq!(too_wide, None);
        // Usage is wrapped by hand.
        let usage = help.lines().skip_while(|line| !line.starts_with("Usage:"));
        let mut usage = usage.take_while(|line| !line.is_empty());
        assert_eq!(usage.find(|line| line.chars().count() > 80), None);
        let name = format!("help_{}", command.replace(' ', "_"));
        insta::assert_snapshot!(name.trim_end_matches('_'), help);
    }
}

/// A stream that can't be written.
struct Closed(io::ErrorKind);

impl Write for Closed {
    fn write(&mut self, _: &[u8]) -> io::Result<usize> {
        Err(self.0.into())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn a_reader_that_leaves_is_no_error_and_a_full_disk_is_one() {
    let code = |kind| {
        let mut err = Vec::new();
        let line = ["tau", "evaluate", "--variant", "Nominal", "--json", "-"];
        let code = tau_cli::run(line.map(Into::into), &mut Closed(kind), &mut err);
        (code, String::from_utf8(err).unwrap())
    };
    let (left, _) = code(io::ErrorKind::BrokenPipe);
    assert_eq!(left, 0);
    let (full, err) = code(io::ErrorKind::StorageFull);
    assert_eq!(full, 2);
    assert!(err.contains("standard output"), "{err}");
}

#[test]
fn the_built_in_robot_is_the_checked_in_description() {
    let text = fs::read_to_string(DESCRIPTION).unwrap();
    let typed = Robot::from_text(&text).unwrap();
    let names = |robot: &Robot| -> Vec<String> {
        robot
            .variants
            .iter()
            .map(|variant| variant.name.clone())
            .collect()
    };
    assert_eq!(names(&typed), names(&gantry_tau()));
}
