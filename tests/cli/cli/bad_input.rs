//! Answers to mistakes: exit code 2, nothing on standard output, nothing written.

use std::fs;
use std::path::Path;

use crate::support::{DATA, DESCRIPTION, listing, tau_in};

/// Everything below a folder.
fn tree(folder: &Path) -> Vec<String> {
    let mut names = Vec::new();
    for name in listing(folder) {
        let path = folder.join(&name);
        if path.is_dir() {
            names.extend(
                tree(&path)
                    .into_iter()
                    .map(|below| format!("{name}/{below}")),
            );
        }
        names.push(name);
    }
    names
}

/// The answers to lines that must fail, without paths of this machine.
fn answers(folder: &Path, lines: &[&str]) -> String {
    let before = tree(folder);
    let answers: Vec<String> = lines
        .iter()
        .map(|line| {
            let ran = tau_in(folder, line);
            assert_eq!((ran.code, ran.out.as_str()), (2, ""), "{line}");
            assert_eq!(tree(folder), before, "{line}");
            let err = ran.err.replace(&folder.display().to_string(), "DIR");
            format!("$ {line}\n{}", err.replace(DATA, "DATA"))
        })
        .collect();
    answers.join("\n")
}

#[test]
fn usage() {
    let folder = tempfile::tempdir().unwrap();
    let lines = [
        "tau stdy",
        "tau study --outt DIR/x",
        "tau calibrate DATA",
        "tau sensitivity --variant Full --step 0",
        "tau kinematics",
        "tau kinematics forward --variant Full",
        "tau kinematics inverse --variant Full",
        "tau kinematics forward --variant Full --commands 0.1,a,0.2",
        "tau kinematics forward --variant Full --commands 0.1,0.2,0.3 --poses DATA/tcp_poses.csv",
        "tau generate --out DIR/x",
        "tau generate GANTRY --out DIR/x --lang fortran",
        "tau completions tcsh",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

#[test]
fn names_and_numbers() {
    let folder = tempfile::tempdir().unwrap();
    let lines = [
        "tau calibrate DATA --variant Fulll --out DIR/x",
        "tau evaluate --variant Delta",
        "tau study --out DIR/x --split sometimes",
        "tau kinematics forward --variant Full --commands 0.1,0.2",
        "tau kinematics forward --variant Full --commands 0,0,0 --start 1,2,3",
        "tau kinematics inverse --variant Full --pose 1,2",
        "tau kinematics inverse --variant Full --pose 0,0,140",
        "tau kinematics forward --variant Full --commands 100,0.2,0.3",
        "tau kinematics inverse --variant Full --poses DATA/cart_poses.csv --out DIR/x.csv --json DIR",
        "tau generate GANTRY --out DIR/x --lang rust,c",
        "tau generate GANTRY --out DIR/x --lang latex",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

#[test]
fn options_that_contradict_each_other() {
    let folder = tempfile::tempdir().unwrap();
    let simulate = "tau simulate --model linear_delta --measure heights --noise-position 1e-5 --poses 30 --out DIR/heights";
    tau_in(folder.path(), simulate).done();
    let lines = [
        "tau simulate --out DIR/x --random --grid-step 0.1,0.1,0.1",
        "tau evaluate DATA --variant Full --split fraction:0.5:3 --seed 4",
        "tau study DATA --out DIR/x --split alternate --seed 4",
        "tau calibrate DIR/heights --model linear_delta --variant Full --errors-in-variables --out DIR/x",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

#[test]
fn outputs_on_one_file() {
    let folder = tempfile::tempdir().unwrap();
    let lines = [
        "tau calibrate --variant Nominal --out DIR/x --json DIR/x/statistics.json",
        "tau study --no-discover --out DIR/x --json DIR/./x/report.html",
        "tau kinematics inverse --variant Full --pose=-1.5,-4.6,0.2 --out DIR/x --json DIR/x",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

/// A name or a parameter that is misspelt changes numbers without a word, unless it is told.
#[test]
fn effects_of_robot_files() {
    let folder = tempfile::tempdir().unwrap();
    let robot = fs::read_to_string(format!("{DATA}/robot.toml")).unwrap();
    for (name, effect) in [
        (
            "parameter",
            "[effects.\"rack_pitch(two)\"]\nsinee = { value = 1e-3, tol = 1.0 }\n",
        ),
        (
            "vector",
            "[effects.\"rack_pitch(two)\"]\nsine = { value = [1e-3, 2, 3], tol = 1.0 }\n",
        ),
    ] {
        fs::write(folder.path().join(name), format!("{robot}\n{effect}")).unwrap();
    }
    let lines = [
        "tau evaluate DATA --variant FullRack --robot DIR/parameter",
        "tau evaluate DATA --variant FullRack --robot DIR/vector",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

#[test]
fn missing_input() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("empty")).unwrap();
    let lines = [
        "tau study DIR/nowhere --out DIR/x --json DIR/x.json",
        "tau calibrate DIR/empty --variant Nowhere --out DIR/x",
        "tau evaluate DATA --variant Full --robot DIR/nowhere.toml",
        "tau evaluate DATA --variant Full --model DIR/nowhere.tau",
        "tau generate DIR/nowhere.tau --out DIR/x",
        "tau kinematics forward --variant Full --poses DIR/nowhere.csv --out DIR/x.csv",
        "tau kinematics forward --variant Piecewise --robot DATA/robot.toml --commands 0,0,0",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

#[test]
fn outputs_that_cannot_be_written() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    fs::create_dir_all(folder.path().join("code/gantry_tau.rs")).unwrap();
    let lines = [
        "tau study --out DIR/file",
        "tau study --out DIR/file/below",
        "tau study --out DIR/x --json DIR/file/x.json",
        "tau study --out DIR/x --json DIR",
        "tau calibrate --variant Full --out DIR/file",
        "tau evaluate --variant Full --json DIR/file/x.json",
        "tau sensitivity --variant Full --json DIR",
        "tau simulate --out DIR/file/x",
        "tau generate GANTRY --out DIR/file",
        "tau generate GANTRY --out DIR/code",
        "tau kinematics forward --variant Full --commands 0,0,0 --out DIR/file/x.csv",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

#[test]
fn nominal_values_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["tcp_poses.csv", "cart_poses.csv", "robot.toml"] {
        fs::copy(Path::new(DATA).join(name), folder.path().join(name)).unwrap();
    }
    let nominal = fs::read(folder.path().join("robot.toml")).unwrap();
    let lines = [
        "tau calibrate DIR --variant Full --out DIR",
        "tau calibrate --robot DIR/robot.toml --variant Full --out DIR",
        "tau calibrate DIR --variant Full --out DIR/out --json DIR/cart_poses.csv",
        "tau evaluate DIR --variant Full --json DIR/robot.toml",
        "tau study DIR --out DIR/out --json DIR/tcp_poses.csv",
        "tau discover DIR --out DIR/out --json DIR/robot.toml",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
    assert_eq!(fs::read(folder.path().join("robot.toml")).unwrap(), nominal);
}

#[test]
fn descriptions_with_errors() {
    let folder = tempfile::tempdir().unwrap();
    let description = "\
/// Größe: with a letter beyond ASCII.
robot Pair {
    track one, two;
    cluster left on one { link l1; }
    cluster right on tow { link l1; }
    variant Full { arm full; tracks linear; }

    effect sag on cart {
        param droop: angle tol 1 mrad;
        vertical += droop + q;
    }
}
";
    fs::write(folder.path().join("pair.tau"), description).unwrap();
    let lines = [
        "tau generate DIR/pair.tau --out DIR/x",
        "tau study DATA --model DIR/pair.tau --out DIR/x",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

#[test]
fn measurements_of_another_robot() {
    let folder = tempfile::tempdir().unwrap();
    let description = "robot Pair { track one, two; cluster a on one { link l1; } \
                       cluster b on two { link l2, l3, l4, l5, l6; } variant Full { arm full; tracks linear; } }";
    fs::write(folder.path().join("pair.tau"), description).unwrap();
    let ran = tau_in(
        folder.path(),
        "tau study DATA --model DIR/pair.tau --out DIR/x",
    );
    assert_eq!((ran.code, ran.out.as_str()), (2, ""));
    assert!(ran.err.contains("Pair"), "{}", ran.err);
    assert_eq!(listing(folder.path()), ["pair.tau"]);
}

#[test]
fn tables_that_are_asked_about() {
    let folder = tempfile::tempdir().unwrap();
    let robot = "robot = \"LinearDelta\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    let files = [
        ("robot.toml", robot),
        ("side.csv", "q1_m,q2_m,q3_m,dir1,dir2,dir3\n0,0,0,1,0,1\n"),
        ("sides.csv", "q1_m,q2_m,q3_m,dir1\n0,0,0,1\n"),
        ("kelvin.csv", "q1_m,q2_m,q3_m,temperature_c\n0,0,0,293\n"),
        ("twice.csv", "pose,q1_m,q2_m,q3_m\n4,0,0,0\n4,0.1,0,0\n"),
        (
            "part.csv",
            "q1_m,q2_m,q3_m,x_m,y_m,alpha_rad\n0,0,0,0,0,0\n",
        ),
        (
            "angles.csv",
            "x_m,y_m,z_m,alpha_rad,beta_rad\n0,0,-0.6,0,0\n",
        ),
        (
            "degrees.csv",
            "x_m,y_m,z_m,alpha_rad,beta_rad,gamma_rad\n0,0,-0.6,90,0,0\n",
        ),
        ("plain.csv", "x_m,y_m,z_m\n0,0,-0.6\n"),
    ];
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    let with = "--model ROBOTS/linear_delta.tau --robot DIR/robot.toml --variant";
    let lines = [
        format!("tau kinematics forward {with} Full --poses DIR/side.csv"),
        format!("tau kinematics forward {with} Full --poses DIR/sides.csv"),
        format!("tau kinematics forward {with} Full --poses DIR/kelvin.csv"),
        format!("tau kinematics forward {with} Full --poses DIR/twice.csv"),
        format!("tau kinematics forward {with} Full --poses DIR/part.csv"),
        format!("tau kinematics inverse {with} Full --poses DIR/angles.csv"),
        format!("tau kinematics inverse {with} Full --poses DIR/degrees.csv"),
        format!("tau kinematics inverse {with} Warm --poses DIR/plain.csv"),
        format!("tau kinematics forward {with} Warm --commands 0,0,0"),
    ];
    let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
    insta::assert_snapshot!(answers(folder.path(), &lines));
}

#[test]
fn inputs_are_not_replaced() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["tcp_poses.csv", "robot.toml"] {
        fs::copy(Path::new(DATA).join(name), folder.path().join(name)).unwrap();
    }
    fs::write(folder.path().join("p.csv"), "q1_m,q2_m,q3_m\n0,0,0\n").unwrap();
    let lines = [
        "tau kinematics forward DIR --variant Full --poses DIR/p.csv --out DIR/p.csv",
        "tau kinematics forward DIR --variant Full --commands 0,0,0 --out DIR/robot.toml",
        "tau kinematics inverse DIR --variant Full --pose=-1.5,-4.6,0.2 --json DIR/tcp_poses.csv",
        "tau kinematics forward DIR --variant Full --commands 0,0,0 --out DIR/x --json DIR/x",
    ];
    insta::assert_snapshot!(answers(folder.path(), &lines));
    let kept = fs::read(folder.path().join("robot.toml")).unwrap();
    assert_eq!(kept, fs::read(Path::new(DATA).join("robot.toml")).unwrap());
}

#[test]
fn what_is_not_finite_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let text = fs::read_to_string(DESCRIPTION).unwrap();
    let own = "variant Odd = Full + odd(two); }\n\
               effect odd on cart { param size: length = 10 um tol 1 mm; along += size * sqrt((q + 0.2 m) / (1 m)); }";
    let text = format!("{}{own}", text.trim_end().strip_suffix('}').unwrap());
    fs::write(folder.path().join("odd.tau"), text).unwrap();
    let csv = fs::read_to_string(format!("{DATA}/tcp_poses.csv")).unwrap();
    // The first pose that calibrates at which the root of a negative number is asked for.
    let column = |name: &str| {
        csv.lines()
            .next()
            .unwrap()
            .split(',')
            .position(|own| own == name)
    };
    let (pose, q2) = (column("pose").unwrap(), column("q2_m").unwrap());
    let rows: Vec<Vec<&str>> = csv
        .lines()
        .skip(1)
        .map(|line| line.split(',').collect())
        .collect();
    let is_out = |row: &&Vec<&str>| row[q2].parse::<f64>().unwrap() < -0.2;
    let poses: Vec<&str> = rows.iter().filter(is_out).map(|row| row[pose]).collect();
    for line in [
        "tau calibrate DATA --model DIR/odd.tau --variant Odd --out DIR/out",
        "tau discover DATA --model DIR/odd.tau --base Odd --out DIR/out",
        "tau kinematics forward --model DIR/odd.tau --robot DATA/robot.toml --variant Odd --commands 0,-0.5,0",
    ] {
        let ran = tau_in(folder.path(), line);
        assert_eq!(ran.code, 1, "{line}");
        let expected = "in `odd(two)`: `along += size * sqrt((q + 0.2 m) / (1 m))`";
        assert!(ran.err.contains(expected), "{line}: {}", ran.err);
        let (_, named) = ran.err.split_once("pose ").unwrap();
        let named = named.split(':').next().unwrap();
        let is_given = line.contains("--commands") && named == "1";
        assert!(is_given || poses.contains(&named), "{line}: {}", ran.err);
        assert_eq!(listing(folder.path()), ["odd.tau"]);
    }
}

/// Columns of other drives than those of the robot that is assumed: no other name of the column would mend that.
#[test]
fn measurements_of_drives_that_the_robot_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let text = "pose,q1_rad,q2_rad,q3_rad,height_m\n1,0.1,0.1,0.1,0\n";
    fs::write(folder.path().join("heights.csv"), text).unwrap();
    // Where nothing names the robot, that is all that can be said.
    let ran = tau_in(folder.path(), "tau check DIR");
    assert_eq!(ran.code, 2);
    assert!(ran.err.contains("`tau init F.tau"), "{}", ran.err);
    assert!(!ran.err.contains("column"), "{}", ran.err);

    let file = format!("{DATA}/robot.toml");
    fs::copy(file, folder.path().join("robot.toml")).unwrap();
    let ran = tau_in(folder.path(), "tau check DIR");
    assert_eq!(ran.code, 2);
    for expected in ["column `q1_m` is missing, found `q1_rad`", "`--model`"] {
        assert!(ran.err.contains(expected), "{}", ran.err);
    }
    assert!(!ran.err.contains("name the column"), "{}", ran.err);
}

/// A name that may be meant for a standard robot: those that there are are told.
#[test]
fn a_misspelt_robot_comes_with_the_one_meant() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |model: &str| {
        let ran = tau_in(
            folder.path(),
            &format!("tau simulate --model {model} --out DIR/m"),
        );
        assert_eq!(ran.code, 2, "{model}");
        ran.err
    };
    for (typed, meant) in [
        ("LinearDelta", "linear_delta"),
        ("FOUR-BELTS", "four_belts"),
        ("hexapd", "hexapod"),
    ] {
        let err = refused(typed);
        assert!(err.contains(&format!("did you mean `{meant}`?")), "{err}");
        assert!(err.contains("`five_bar`"), "{err}");
    }
    assert!(refused("zzz").contains("standard robots are `gantry_tau`"));
    assert!(refused("mine.tau").contains("the file does not exist"));
}
