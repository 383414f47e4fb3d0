//! Refusals of machines of users: each says where, the value found and its mend.

use tau::robot_file::{RobotFile, StatedNoise};
use tau_testkit::{Work, list, number, robots};

use crate::answers::{Answers, replaced};

/// Three lines hold a body's point in the plane, of which one pulls.
const WINCH: &str = include_str!("machines/winch.tau");

/// Two cranks hold a point in the plane.
const CRANKS: &str = include_str!("machines/arms.tau");
const ARMS: &str = "robot = \"Arms\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[parameters]\nlead = { value = 2.0, tol = 0.001 }\n\
                    [reference]\ncommands = [0.5, 1.0]\nposition_m = [0.0, 1.0, 0.0]\n";
/// Three legs hold a body in the plane.
const PLANAR: &str = include_str!("machines/legs.tau");
const FULL: &str = "--model DIR/own.tau --variant Full";

/// A tension that nobody states is not zero: neither the simulation nor an effect goes on with it.
#[test]
fn an_unknown_tension_is_asked_for() {
    let work = Work::described(&WINCH.replace("PULLED", "pulled = 20 N"));
    let simulate = "simulate --model DIR/own.tau --random --poses 40 --out";
    work.run(&format!("{simulate} MEASURED")).done();
    let mut answers = Answers::default();
    // The simulation has physics of its own, so that it plants no effect by the formulas that are to find it.
    let ran = work.run(&format!(
        "{simulate} DIR/own --effect own_stretch(all):strain=1e-6"
    ));
    answers.ran("an effect of the description", ["--effect", "T291:1"], &ran);
    work.write("own.tau", WINCH.replace("PULLED", "pulled"));
    answers.ran(
        "simulated",
        ["own.tau", "T294"],
        &work.run(&format!("{simulate} DIR/again")),
    );
    let calibrate = "calibrate MEASURED --model DIR/own.tau --out DIR/c --variant";
    let stretched = work.run(&format!("{calibrate} Stretched"));
    answers.ran("calibrated", ["tcp_poses.csv", "T501"], &stretched);
    insta::assert_snapshot!(answers.shown());
    work.run(&format!("{calibrate} Full")).done();
}

/// Where it was measured, kinematics takes it from the table.
#[test]
fn a_measured_tension_is_taken_from_the_table() {
    let work = Work::described(&WINCH.replace("PULLED", "pulled"));
    work.write(
        "robot.toml",
        "robot = \"Winch\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n\
         [effects.\"own_stretch(all)\"]\nstrain = { value = 1e-4, tol = 1e-5 }\n",
    );
    let poses = |way: &str, table: &str| {
        work.write("poses.csv", table);
        let with = "--model DIR/own.tau --robot DIR/robot.toml --variant Stretched --json -";
        let ran = work.run(&format!("kinematics {way} {with} --poses DIR/poses.csv"));
        assert_eq!(ran.err, "");
        ran.json()["poses"].clone()
    };
    let forces = "force1_N,force2_N,force3_N";
    let found = poses(
        "inverse",
        &format!("x_m,y_m,{forces}\n0.1,0,0,0,0\n0.1,0,20,20,20\n"),
    );
    let [slack, tight] = [0, 1].map(|pose: usize| -> Vec<f64> {
        list(&found[pose]["commands_m"])
            .iter()
            .map(number)
            .collect()
    });
    // A metre of line is two thousandths longer, by which less of it is let out.
    for (slack, tight) in slack.iter().zip(&tight) {
        assert!((slack - tight - 2e-3).abs() < 1e-9, "{slack} {tight}");
    }
    let [a, b, c] = [tight[0], tight[1], tight[2]];
    let found = poses(
        "forward",
        &format!("q1_m,q2_m,q3_m,{forces}\n{a},{b},{c},20,20,20\n"),
    );
    assert!(
        (number(&found[0]["position_m"][0]) - 0.1).abs() < 1e-9,
        "{found}"
    );
}

#[test]
fn commands_in_degrees_are_known() {
    let mut answers = Answers::default();
    for (model, commands, expected) in [
        ("five_bar", "120,60", "T538"),
        ("rotary_delta", "10,20,30", "T538"),
        // Within a turn they are radians, whether or not a pose has them; drums turn many times.
        ("five_bar", "4,0.5", "1 T505"),
        ("four_lines", "1,1,1,-1", "1 T508"),
        ("four_lines", "20,20,20,-20", "1 T508"),
        // Reached, but half a turn away.
        ("servo_hexapod", "5,5,5,5,5,5", "T538"),
        ("servo_hexapod", "0.08,0.08,0.08,0.08,0.08,0.08", "-"),
    ] {
        let line =
            format!("kinematics forward --model {model} --variant Full --commands {commands}");
        let ran = Work::empty().run(&line);
        answers.ran(
            &format!("{model} at {commands}"),
            ["--commands", expected],
            &ran,
        );
    }
    insta::assert_snapshot!(answers.shown());
}

/// Angles of a robot file are radians, at their lines.
#[test]
fn degrees_in_robot_files_are_refused() {
    let work = Work::described(CRANKS);
    let mut answers = Answers::default();
    for (case, old, new, expected) in [
        ("command", "[0.5, 1.0]", "[30.0, 57.0]", "T222:8 T222:8"),
        ("parameter", "value = 2.0", "value = 120.0", "T222:6"),
        ("tolerance", "tol = 0.001", "tol = 5", "T222:6"),
        (
            "noise",
            "[noise]",
            "[drives]\nnoise_m = [0.01, 0.5]\n[noise]",
            "T223:3",
        ),
    ] {
        work.write("robot.toml", replaced(ARMS, old, new));
        let ran = work.run("simulate --model DIR/own.tau --robot DIR/robot.toml --out DIR/m");
        answers.ran(case, ["robot.toml", expected], &ran);
    }
    insta::assert_snapshot!(answers.shown());
    // Drums wind many turns.
    let drum = "robot Drum {
    plate point in plane;
    param zero: angle = 40 rad tol 0.1 rad;
    cluster lines on base { link a, b actuated angle { length = 50 mm/rad * (q + zero); } }
    variant Full { arm full; }
}";
    let text = "robot = \"Drum\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[parameters]\nzero = { value = 41.0, tol = 4.0 }\n\
                [links.a]\ntrack_offset_m = { value = [1.0, 1.0, 0.0], tol = 0.001 }\n\
                [links.b]\ntrack_offset_m = { value = [-1.0, 1.0, 0.0], tol = 0.001 }\n";
    RobotFile::parse_for(text, "robot.toml", &robots::described(drum)).unwrap();
}

/// A reference 0.3 m off is refused with the pose that the links give, and taken with that pose.
#[test]
fn a_refused_reference_is_mended_by_what_is_said() {
    let work =
        Work::described(&PLANAR.replace("REFERENCE", "reference { position = (0.3, 0.1, 0) m; }"));
    let forward = format!("kinematics forward {FULL} --commands 0,0,0 --json -");
    let mut answers = Answers::default();
    let ran = work.run(&forward);
    answers.ran("wrong", ["own.tau", "T510"], &ran);
    // Not in the simulation alone: the same is said where it begins.
    let simulated = work.run("simulate --model DIR/own.tau --out DIR/m");
    assert_eq!((simulated.code, &simulated.err), (2, &ran.err));
    let (_, mend) = ran.err.split_once("`reference {").unwrap();
    let (mend, _) = mend.split_once('`').unwrap();
    // Without any, what is to be added is what the language takes.
    work.write("own.tau", PLANAR.replace("REFERENCE", ""));
    answers.ran("missing", ["own.tau", "T533"], &work.run(&forward));
    insta::assert_snapshot!(answers.shown());
    work.write(
        "own.tau",
        PLANAR.replace("REFERENCE", &format!("reference {{{mend}")),
    );
    let found = work.run(&forward).json();
    let at = &found["poses"][0]["position_m"];
    assert!(number(&at[0]).hypot(number(&at[1])) < 1e-3, "{at}");
}

/// A calibration without measured poses begins at the reference: no row is to blame for a wrong one.
#[test]
fn a_wrong_reference_is_no_mistake_of_a_row() {
    let work = Work::simulated(crate::HEIGHTS);
    work.replace(
        "position_m = [0.0, 0.0, 0.0]",
        "position_m = [0.0, 0.0, 0.2]",
    );
    let ran = work.run("calibrate MEASURED --model linear_delta --variant Full --out DIR/c");
    let mut answers = Answers::default();
    answers.ran("0.2 m off", ["robot.toml", "T510"], &ran);
    insta::assert_snapshot!(answers.shown());
}

/// A machine of four drives takes some poses of a body: others are approached, and it is said by how much they are missed.
#[test]
fn poses_that_four_drives_miss_are_approached() {
    let work = Work::described(&robots::text("four_of_six"));
    let given = [0.02, 0.03, 0.01, -0.5];
    let line = format!("kinematics forward {FULL} --commands 0.02,0.03,0.01,-0.5");
    let found = work.json(&line)["poses"][0].clone();
    let numbers: Vec<f64> = ["position_m", "angles_rad"]
        .iter()
        .flat_map(|key| list(&found[key]).iter().map(number))
        .collect();
    let inverse = |numbers: &[f64]| {
        let pose: Vec<String> = numbers.iter().map(ToString::to_string).collect();
        work.run(&format!(
            "kinematics inverse {FULL} --json - --pose={}",
            pose.join(",")
        ))
    };
    let back = inverse(&numbers).json();
    for (found, given) in list(&back["poses"][0]["commands_m"]).iter().zip(given) {
        assert!((number(found) - given).abs() < 1e-6, "{back}");
    }
    let mut answers = Answers::default();
    let mut beside = numbers.clone();
    beside[5] += 0.02;
    answers.ran("turned", ["--pose", "T542"], &inverse(&beside));
    answers.ran("a position", ["--pose", "T513"], &inverse(&numbers[..3]));
    insta::assert_snapshot!(answers.shown());
}

/// The file to fill in has a range of lengths only where commands are lengths, and asks for the noise of drives where they
/// measure each other: taken for exact, they can only contradict each other.
#[test]
fn sections_to_fill_in_are_those_that_the_machine_needs() {
    for (model, has_range, has_drives) in [
        ("five_bar", false, false),
        ("linear_delta", true, false),
        ("four_belts", true, true),
        ("four_lines", false, true),
    ] {
        let work = Work::empty();
        let file = tau_testkit::GANTRY.replace("gantry_tau", model);
        work.run(&format!("init {file} --out DIR/own.toml")).done();
        let text = work.read("own.toml");
        assert_eq!(text.contains("q_m"), has_range, "{model}");
        let asked = text.contains("\n[drives]\nnoise_m = \"?\"\n");
        assert_eq!(asked, has_drives, "{model}");
        if has_drives {
            let robot = robots::named(model);
            for (noise, expected) in [
                ("2e-5", StatedNoise::Known(2e-5)),
                ("\"estimate\"", StatedNoise::Estimate),
            ] {
                let drives = text.replace("noise_m = \"?\"", &format!("noise_m = {noise}"));
                let filled = drives.replace("\"?\"", "1e-4");
                let file = RobotFile::parse_for(&filled, "own.toml", &robot).unwrap();
                assert_eq!(file.noise_of_drive(3), Some(expected), "{model}");
            }
        }
    }
}
