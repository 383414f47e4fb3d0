//! Refusals of machines of users: each says where, the value found and its mend.

use std::fs;
use std::path::Path;

use tempfile::TempDir;

use crate::support::{Ran, number, tau_in};

/// Three lines hold a body's point in the plane, of which one pulls.
const WINCH: &str = "robot Winch {
    plate point in plane;
    cluster lines on base {
        link left actuated length { length = 1 m tol 1 mm; track_offset = (-0.8, 0.6, 0) m tol 1 mm; }
        link right actuated length { length = 1 m tol 1 mm; track_offset = (0.8, 0.6, 0) m tol 1 mm; }
        link below actuated length { length = 1 m tol 1 mm; track_offset = (0, -1, 0) m tol 1 mm; PULLED; }
    }
    reference { position = (0, 0, 0) m; }
    variant Full { arm full; }
    variant Stretched = Full + own_stretch(all);
    effect own_stretch on link { param strain: 1/N tol 1e-5 1/N; length += length * strain * tension; }
}";

/// A folder with a description.
fn with(text: &str) -> TempDir {
    let folder = TempDir::new().unwrap();
    fs::write(folder.path().join("machine.tau"), text).unwrap();
    folder
}

#[track_caller]
fn says(ran: &Ran, code: u8, words: &[&str]) {
    assert_eq!(ran.code, code, "{}", ran.err);
    for word in words {
        assert!(ran.err.contains(word), "`{word}` in {}", ran.err);
    }
}

fn edit(path: &Path, from: &str, to: &str) {
    let text = fs::read_to_string(path).unwrap();
    assert!(text.contains(from), "`{from}` in {text}");
    fs::write(path, text.replacen(from, to, 1)).unwrap();
}

/// A tension that nobody states is not zero: neither the simulation nor an effect goes on with it.
#[test]
fn an_unknown_tension_is_asked_for() {
    let folder = with(&WINCH.replace("PULLED", "pulled = 20 N"));
    let simulate = "tau simulate --model DIR/machine.tau --random --poses 40 --out DIR/m";
    tau_in(folder.path(), simulate).done();
    fs::write(
        folder.path().join("machine.tau"),
        WINCH.replace("PULLED", "pulled"),
    )
    .unwrap();
    let again = tau_in(folder.path(), &format!("{simulate}2"));
    says(&again, 2, &["the tension of `below`", "`pulled = … N;`"]);
    let line = "tau calibrate DIR/m --model DIR/machine.tau --variant Stretched --out DIR/c";
    let stretched = tau_in(folder.path(), line);
    says(
        &stretched,
        2,
        &[
            "tcp_poses.csv",
            "pose 1",
            "`below`",
            "pulled = … N",
            "force3_N",
        ],
    );
    assert!(!stretched.err.contains("[payload]"), "{}", stretched.err);
    let line = "tau calibrate DIR/m --model DIR/machine.tau --variant Full --out DIR/c";
    tau_in(folder.path(), line).done();
}

/// Where it was measured, kinematics takes it from the table.
#[test]
fn a_measured_tension_is_taken_from_the_table() {
    let folder = with(&WINCH.replace("PULLED", "pulled"));
    let write = |name: &str, text: &str| fs::write(folder.path().join(name), text).unwrap();
    write(
        "robot.toml",
        "robot = \"Winch\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n\
         [effects.\"own_stretch(all)\"]\nstrain = { value = 1e-4, tol = 1e-5 }\n",
    );
    let with = "--model DIR/machine.tau --robot DIR/robot.toml --variant Stretched --json -";
    let rows = "force1_N,force2_N,force3_N\n0.1,0,0,0,0\n0.1,0,20,20,20\n";
    write("poses.csv", &format!("x_m,y_m,{rows}"));
    let line = format!("tau kinematics inverse {with} --poses DIR/poses.csv");
    let ran = tau_in(folder.path(), &line);
    assert_eq!(ran.err, "");
    let found = ran.json();
    let commands = |pose: usize| -> Vec<f64> {
        let commands = found["poses"][pose]["commands_m"].as_array().unwrap();
        commands.iter().map(number).collect()
    };
    // A metre of line is two thousandths longer, by which less of it is let out.
    let (slack, tight) = (commands(0), commands(1));
    for (slack, tight) in slack.iter().zip(&tight) {
        assert!((slack - tight - 2e-3).abs() < 1e-9, "{slack} {tight}");
    }
    let tight: Vec<String> = tight.iter().map(f64::to_string).collect();
    let rows = format!(
        "q1_m,q2_m,q3_m,force1_N,force2_N,force3_N\n{},20,20,20\n",
        tight.join(",")
    );
    write("commands.csv", &rows);
    let line = format!("tau kinematics forward {with} --poses DIR/commands.csv");
    let found = tau_in(folder.path(), &line).json();
    let x = number(&found["poses"][0]["position_m"][0]);
    assert!((x - 0.1).abs() < 1e-9, "{x}");
}

/// The simulation has physics of its own, so that it plants no effect by the formulas that are to find it.
#[test]
fn an_effect_of_the_description_is_not_planted() {
    let folder = with(&WINCH.replace("PULLED", "pulled = 20 N"));
    let line =
        "tau simulate --model DIR/machine.tau --out DIR/m --effect own_stretch(all):strain=1e-6";
    let ran = tau_in(folder.path(), line);
    says(
        &ran,
        2,
        &[
            "`own_stretch` is an effect of the description",
            "link_compliance",
        ],
    );
}

#[test]
fn commands_in_degrees_are_known() {
    let folder = TempDir::new().unwrap();
    let forward = |model: &str, commands: &str| {
        let line =
            format!("tau kinematics forward --model {model} --variant Full --commands {commands}");
        tau_in(folder.path(), &line)
    };
    let degrees = "multiply by pi/180";
    says(
        &forward("five_bar", "120,60"),
        2,
        &["q1_rad", "120", degrees],
    );
    says(
        &forward("rotary_delta", "10,20,30"),
        2,
        &["--commands", "q1_rad", degrees],
    );
    // Within a turn they are radians, whether or not a pose has them; drums turn many times.
    for (model, commands) in [
        ("five_bar", "4,0.5"),
        ("four_lines", "1,1,1,-1"),
        ("four_lines", "20,20,20,-20"),
    ] {
        let ran = forward(model, commands);
        assert_eq!(ran.code, 1, "{}", ran.err);
        assert!(!ran.err.contains("degrees"), "{}", ran.err);
    }
    // Reached, but half a turn away.
    says(
        &forward("servo_hexapod", "5,5,5,5,5,5"),
        0,
        &["more than half a turn", degrees],
    );
    let plain = forward("servo_hexapod", "0.08,0.08,0.08,0.08,0.08,0.08");
    assert!(!plain.err.contains(degrees), "{}", plain.err);
}

/// Angles of a robot file are radians, at their lines.
#[test]
fn degrees_in_robot_files_are_refused() {
    const CRANKS: &str = "robot Arms {
    plate point in plane;
    param lead: angle = 2 rad tol 1 mrad;
    crank left, right { axis = (0, 0, 1) exact; centre = (0, 0, 0) m tol 1 mm; }
    cluster a on left { link la { length = 1 m tol 1 mm; track_offset = (0.5 m * cos(lead), 0.5 m * sin(lead), 0 m); } }
    cluster b on right { link lb { length = 1 m tol 1 mm; track_offset = (0.5, 0, 0) m tol 1 mm; } }
    reference { commands = (0.5, 1) rad; position = (0, 1, 0) m; }
    variant Full { arm full; }
}";
    let folder = with(CRANKS);
    let path = folder.path().join("robot.toml");
    let given = "robot = \"Arms\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[parameters]\nlead = { value = 2.0, tol = 0.001 }\n\
                 [reference]\ncommands = [0.5, 1.0]\nposition_m = [0.0, 1.0, 0.0]\n";
    let simulate = "tau simulate --model DIR/machine.tau --robot DIR/robot.toml --out DIR/m";
    for (from, to, place, words) in [
        (
            "[0.5, 1.0]",
            "[30.0, 57.0]",
            "robot.toml:8:13",
            "found the command 30",
        ),
        (
            "value = 2.0",
            "value = 120.0",
            "robot.toml:6:18",
            "found 120 as the `value` of `lead`",
        ),
        (
            "tol = 0.001",
            "tol = 5",
            "robot.toml:6:29",
            "found 5 as the `tol` of `lead`",
        ),
        (
            "[noise]",
            "[drives]\nnoise_m = [0.01, 0.5]\n[noise]",
            "robot.toml:3:18",
            "found a noise of 0.5, expected radians",
        ),
    ] {
        fs::write(&path, given).unwrap();
        edit(&path, from, to);
        let ran = tau_in(folder.path(), simulate);
        says(&ran, 2, &[place, words, "multiply by pi/180"]);
    }
    // Drums wind many turns.
    let drum = "robot Drum {
    plate point in plane;
    param zero: angle = 40 rad tol 0.1 rad;
    cluster lines on base {
        link a, b actuated angle { length = 50 mm/rad * (q + zero); }
    }
    variant Full { arm full; }
}";
    let robot = tau::Robot::from_text(drum).unwrap();
    let text = "robot = \"Drum\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[parameters]\nzero = { value = 41.0, tol = 4.0 }\n";
    let points = "[links.a]\ntrack_offset_m = { value = [1.0, 1.0, 0.0], tol = 0.001 }\n[links.b]\ntrack_offset_m = { value = [-1.0, 1.0, 0.0], tol = 0.001 }\n";
    let text = [text, points].concat();
    let read = tau::robot_file::RobotFile::parse_for(&text, "robot.toml", &robot);
    read.unwrap_or_else(|errors| panic!("{errors}"));
}

/// A reference 0.3 m off is refused with the pose that the links give, and taken with that pose.
#[test]
fn a_refused_reference_is_mended_by_what_is_said() {
    const PLANAR: &str = "robot Planar {
    plate body in plane;
    cluster legs on base {
        link a actuated length { length = 1 m tol 1 mm; plate_joint = (0.1, 0, 0) m tol 1 mm; track_offset = (1.1, 0, 0) m tol 1 mm; }
        link b actuated length { length = 1 m tol 1 mm; plate_joint = (-0.05, 0.0866, 0) m tol 1 mm; track_offset = (0.45, 0.9526, 0) m tol 1 mm; }
        link c actuated length { length = 1 m tol 1 mm; plate_joint = (-0.05, -0.0866, 0) m tol 1 mm; track_offset = (-1.05, -0.0866, 0) m tol 1 mm; }
    }
    REFERENCE
    variant Full { arm full; }
}";
    let folder = with(&PLANAR.replace("REFERENCE", "reference { position = (0.3, 0.1, 0) m; }"));
    let forward =
        "tau kinematics forward --model DIR/machine.tau --variant Full --commands 0,0,0 --json -";
    let ran = tau_in(folder.path(), forward);
    says(
        &ran,
        2,
        &[
            "the reference is not a pose of this machine",
            "in the description",
        ],
    );
    assert!(!ran.err.contains("of the robot file"), "{}", ran.err);
    // Not in the simulation alone: the same is said where it begins.
    let simulate = "tau simulate --model DIR/machine.tau --out DIR/m";
    let simulated = tau_in(folder.path(), simulate);
    assert_eq!((simulated.code, simulated.err), (2, ran.err.clone()));
    let mend = ran
        .err
        .split("write `")
        .nth(1)
        .and_then(|rest| rest.split('`').next())
        .unwrap();
    fs::write(
        folder.path().join("machine.tau"),
        PLANAR.replace("REFERENCE", mend),
    )
    .unwrap();
    let found = tau_in(folder.path(), forward).json();
    let at = &found["poses"][0]["position_m"];
    assert!(
        number(&at[0]).abs() < 1e-3 && number(&at[1]).abs() < 1e-3,
        "{at}"
    );
    // Without any, what is to be added is what the language takes.
    fs::write(
        folder.path().join("machine.tau"),
        PLANAR.replace("REFERENCE", ""),
    )
    .unwrap();
    let ran = tau_in(folder.path(), forward);
    says(
        &ran,
        2,
        &[
            "`reference { commands = (0, 0, 0) m; position = (x, y, 0) m; orientation = (alpha, 0, 0) rad; }`",
        ],
    );
}

/// A calibration without measured poses begins at the reference: no row is to blame for a wrong one.
#[test]
fn a_wrong_reference_is_no_mistake_of_a_row() {
    let folder = TempDir::new().unwrap();
    let simulate = "tau simulate --model linear_delta --measure heights --noise-position 1e-5 --random --poses 40 --out DIR/m";
    tau_in(folder.path(), simulate).done();
    let robot = folder.path().join("m/robot.toml");
    edit(
        &robot,
        "position_m = [0.0, 0.0, 0.0]",
        "position_m = [0.0, 0.0, 0.2]",
    );
    let line = "tau calibrate DIR/m --model linear_delta --variant Full --out DIR/c";
    let ran = tau_in(folder.path(), line);
    says(
        &ran,
        2,
        &["robot.toml", "the plate stands", "write `[reference]` with"],
    );
    assert!(!ran.err.contains("heights.csv"), "{}", ran.err);
}

/// A joint farther out of the plane than its rod is long, which level parts of lengths do not show.
#[test]
fn a_joint_out_of_the_plane_is_named() {
    let folder = with("robot Raised {
    plate point in plane;
    cluster lines on base {
        link a actuated length { length = 1 m tol 1 mm; track_offset = (-0.8, 0.6, 1.5) m tol 1 mm; }
        link b actuated length { length = 1 m tol 1 mm; track_offset = (0.8, 0.6, 0) m tol 1 mm; }
    }
    reference { position = (0, 0, 0) m; }
    variant Full { arm full; }
}");
    let line = "tau kinematics forward --model DIR/machine.tau --variant Full --commands 0,0";
    let expected = "`a` would have to be 1802.8 mm long there, and has 1000.0 mm: across the plane alone its joints are \
                    1500.0 mm apart";
    says(&tau_in(folder.path(), line), 2, &[expected]);
}

/// Six parallel legs hold neither x nor y: the simulation names what is free, as kinematics does.
#[test]
fn a_singular_machine_is_called_singular() {
    let mut text = "robot Parallel {\ncluster legs on base {\n".to_owned();
    for (k, [x, y]) in [
        [1.0, 0.0],
        [0.0, 1.0],
        [-1.0, 0.0],
        [0.0, -1.0],
        [0.5, 0.5],
        [-0.5, 0.5],
    ]
    .iter()
    .enumerate()
    {
        text += &format!(
            "link l{k} actuated length {{ length = 1 m tol 1 mm; plate_joint = ({x}, {y}, 0) m tol 1 mm; track_offset = ({x}, {y}, 0) m tol 1 mm; }}\n"
        );
    }
    text += "}\nreference { position = (0, 0, 1) m; }\nvariant Full { arm full; }\n}";
    let folder = with(&text);
    let ran = tau_in(
        folder.path(),
        "tau simulate --model DIR/machine.tau --out DIR/m",
    );
    says(&ran, 2, &["singular", "the plate is free to "]);
    let free = ran.err.split("is free to ").nth(1).unwrap();
    assert!(
        free.starts_with("move along") || free.starts_with("turn about (0.00, 0.00, 1.00)"),
        "{free}"
    );
    let forward =
        "tau kinematics forward --model DIR/machine.tau --variant Full --commands 0,0,0,0,0,0";
    says(
        &tau_in(folder.path(), forward),
        1,
        &["singular", "the plate is free to "],
    );
}

/// A machine of four drives takes some poses of a body: others are approached, and it is said by how much they are missed.
#[test]
fn poses_that_four_drives_miss_are_approached() {
    let folder = with(include_str!("../robots/four_of_six.tau"));
    let kinematics = |way: &str| {
        let line = format!("tau kinematics {way} --model DIR/machine.tau --variant Full --json -");
        tau_in(folder.path(), &line)
    };
    let there = kinematics("forward --commands 0.02,0.03,0.01,-0.5").json();
    let pose = &there["poses"][0];
    let numbers: Vec<f64> = ["position_m", "angles_rad"]
        .iter()
        .flat_map(|key| pose[key].as_array().unwrap().iter().map(number))
        .collect();
    let written = |numbers: &[f64]| {
        let all: Vec<String> = numbers.iter().map(ToString::to_string).collect();
        all.join(",")
    };
    let back = kinematics(&format!("inverse --pose={}", written(&numbers))).json();
    for (found, given) in back["poses"][0]["commands_m"]
        .as_array()
        .unwrap()
        .iter()
        .zip([0.02, 0.03, 0.01, -0.5])
    {
        assert!((number(found) - given).abs() < 1e-6, "{back}");
    }
    let mut beside = numbers.clone();
    beside[5] += 0.02;
    let ran = kinematics(&format!("inverse --pose={}", written(&beside)));
    says(
        &ran,
        0,
        &[
            "the plate has 4 freedoms",
            "the nearest ones were taken",
            "rad away",
        ],
    );
    let ran = kinematics(&format!("inverse --pose={}", written(&numbers[..3])));
    says(&ran, 2, &["the plate has 4 freedoms", "give a full pose"]);
    assert!(
        !ran.err.contains("any orientation at this position"),
        "{}",
        ran.err
    );
}

/// The file to fill in has a range of lengths only where commands are lengths.
#[test]
fn a_range_is_asked_of_lengths_alone() {
    let folder = TempDir::new().unwrap();
    for (model, has_range) in [("five_bar", false), ("four_belts", true)] {
        let path = format!(
            "{}/../generated/models/{model}.tau",
            env!("CARGO_MANIFEST_DIR")
        );
        let line = format!("tau init {path} --out DIR/{model}.toml");
        tau_in(folder.path(), &line).done();
        let text = fs::read_to_string(folder.path().join(format!("{model}.toml"))).unwrap();
        assert_eq!(text.contains("q_m"), has_range, "{text}");
    }
}
