//! Answers to mistakes: exit code 2, nothing on standard output, nothing written.

use tau_testkit::{GANTRY, PROTOTYPE, ROBOTS, Work, robots};

/// Runs lines that must be refused with just the errors behind their arrows, each a code with its file and line, or
/// option, and returns what they say.
#[track_caller]
fn refusals(work: &Work, cases: &str) -> String {
    // Nothing but the errors for programs, where they are asked for.
    let listing = || {
        let mut names = work.listing("");
        names.retain(|name| !name.starts_with("json"));
        names
    };
    let before = listing();
    let mut answers = String::new();
    for case in cases.trim().lines() {
        let (line, expected) = case.split_once("=>").expect("an arrow");
        let ran = work.run(line);
        ran.refused(&errors(expected));
        assert_eq!(ran.out, "", "{line}");
        assert_eq!(listing(), before, "{line}");
        answers += &format!("$ tau {}\n{}\n", line.trim(), ran.err);
    }
    for (path, name) in [
        (PROTOTYPE, "PROTOTYPE"),
        (GANTRY, "GANTRY"),
        (ROBOTS, "ROBOTS"),
    ] {
        answers = answers.replace(path, name);
    }
    answers
}

/// Errors such as `T217 rows.csv:2; T263 --variant`.
fn errors(text: &str) -> Vec<(&str, &str, usize)> {
    let mut found = Vec::new();
    for error in text.split(';').filter(|error| !error.trim().is_empty()) {
        let mut words = error.split_whitespace();
        let code = words.next().expect("a code");
        let place = words.next().unwrap_or_default();
        found.push(match place.rsplit_once(':') {
            Some((file, line)) => (code, file, line.parse().expect("a line")),
            None => (code, place, 0),
        });
    }
    found
}

#[test]
fn usage_is_refused_by_the_option_that_is_wrong() {
    let cases = "
        stdy => T260
        study --outt DIR/x => T260
        calibrate PROTOTYPE => T260
        sensitivity --variant Full --step 0 => T260
        kinematics =>
        kinematics forward --variant Full => T260
        kinematics inverse --variant Full => T260
        kinematics forward --variant Full --commands 0.1,a,0.2 => T260
        kinematics forward --variant Full --commands 0.1,0.2,0.3 --poses PROTOTYPE/tcp_poses.csv => T260
        generate --out DIR/x => T260
        completions tcsh => T260
        simulate --out DIR/x --random --grid-step 0.1,0.1,0.1 => T260";
    insta::assert_snapshot!("usage", refusals(&Work::empty(), cases));
}

#[test]
fn names_and_numbers_are_refused_at_their_option() {
    let cases = "
        calibrate PROTOTYPE --variant Fulll --out DIR/x => T263 --variant
        evaluate --variant Delta => T263 --variant
        study --out DIR/x --split sometimes => T261 --split:1
        evaluate PROTOTYPE --variant Full --split fraction:0.5:3 --seed 4 => T262 --seed
        study PROTOTYPE --out DIR/x --split alternate --seed 4 => T262 --seed
        calibrate MEASURED --variant Full --files ball_bar.csv --out DIR/x => T201 --files
        kinematics forward --variant Full --commands 0.1,0.2 => T246 --commands
        kinematics forward --variant Full --commands 0,0,0 --start 1,2,3 => T246 --start
        kinematics inverse --variant Full --pose 1,2 => T246 --pose
        kinematics inverse --variant Full --pose 0,0,140 => T221 --pose
        kinematics forward --variant Full --commands 100,0.2,0.3 => T221 --commands
        simulate --model LinearDelta --out DIR/x => T264 --model
        simulate --model FOUR-BELTS --out DIR/x => T264 --model
        simulate --model hexapd --out DIR/x => T264 --model
        simulate --model zzz --out DIR/x => T264 --model
        simulate --model mine.tau --out DIR/x => T201 mine.tau";
    let heights = "--model linear_delta --measure heights --noise-position 1e-5 --poses 30";
    insta::assert_snapshot!(
        "names_and_numbers",
        refusals(&Work::simulated(heights), cases)
    );
}

#[test]
fn input_that_is_missing_is_named() {
    let work = Work::prototype();
    work.write("empty/note", "");
    let cases = "
        study DIR/nowhere --out DIR/x => T203 nowhere
        calibrate DIR/empty --variant Nowhere --out DIR/x => T201 empty/robot.toml
        evaluate MEASURED --variant Full --robot DIR/nowhere.toml => T201 nowhere.toml
        evaluate MEASURED --variant Full --model DIR/nowhere.tau => T201 nowhere.tau
        generate DIR/nowhere.tau --out DIR/x => T201 nowhere.tau
        kinematics forward --variant Full --poses DIR/nowhere.csv --out DIR/x.csv => T201 nowhere.csv
        kinematics forward --variant Piecewise --robot MEASURED/robot.toml --commands 0,0,0 => T536 measured/robot.toml
        kinematics forward --variant FullPiecewise --robot MEASURED/robot.toml --commands 0,0,0 => T337 measured/robot.toml";
    insta::assert_snapshot!("missing_input", refusals(&work, cases));
}

/// Nobody knows which robot was measured where the robot file does not say: what another one lacks is no mistake.
#[test]
fn an_input_that_can_not_be_read_is_the_only_mistake() {
    let work = Work::simulated("--model rotary_delta --poses 12");
    let drawn = work.read("measured/robot.toml");
    work.write("broken.toml", "robot = \"RotaryDelta\n");
    work.write("other.toml", drawn.replace("\"RotaryDelta\"", "\"Other\""));
    work.write("bare/tcp_poses.csv", work.read("measured/tcp_poses.csv"));
    let mut cases = String::new();
    for with in [
        "MEASURED --robot DIR/missing.toml => T201 missing.toml",
        "MEASURED --robot DIR/broken.toml => T240 broken.toml:1",
        "MEASURED --robot DIR/other.toml => T253 other.toml:3",
        "DIR/bare => T201 bare/robot.toml",
        "DIR/nowhere => T203 nowhere",
        "DIR/nowhere --model rotary_delta => T203 nowhere",
        "MEASURED --model DIR/missing.tau => T201 missing.tau",
    ] {
        let (with, error) = with.split_once("=>").unwrap();
        for command in [
            "check WITH",
            "calibrate WITH --variant Basic --out DIR/out",
            "evaluate WITH --variant Basic",
            "study WITH --out DIR/out",
            "kinematics forward WITH --variant Basic --commands 0,0,0",
        ] {
            cases += &format!("{} => {error}\n", command.replace("WITH", with));
        }
    }
    refusals(&work, &cases);
}

#[test]
fn outputs_neither_fail_halfway_nor_replace_what_is_read() {
    let work = Work::prototype();
    work.write("file", "")
        .write("p.csv", "q1_m,q2_m,q3_m\n0,0,0\n");
    work.write("code/gantry_tau.rs/below", "");
    let cases = "
        calibrate --variant Nominal --out DIR/json --json DIR/json/statistics.json => T280 output
        study --no-discover --out DIR/json --json DIR/./json/report.html => T280 output
        kinematics inverse --variant Full --pose=-1.5,-4.6,0.2 --out DIR/json.csv --json DIR/json.csv => T280 output
        kinematics inverse --variant Full --poses MEASURED/cart_poses.csv --out DIR/x.csv --json DIR => T202 DIR
        study --out DIR/file => T204 file
        study --out DIR/file/below => T204 file
        study --out DIR/x --json DIR/file/x.json => T204 file
        study --out DIR/x --json DIR => T202 DIR
        calibrate --variant Full --out DIR/file => T204 file
        evaluate --variant Full --json DIR/file/x.json => T204 file
        sensitivity --variant Full --json DIR => T202 DIR
        simulate --out DIR/file/x => T204 file
        generate GANTRY --out DIR/file => T204 file
        generate GANTRY --out DIR/code => T202 code/gantry_tau.rs
        kinematics forward --variant Full --commands 0,0,0 --out DIR/file/x.csv => T204 file
        calibrate MEASURED --variant Full --out MEASURED => T282 measured/robot.toml
        calibrate --robot MEASURED/robot.toml --variant Full --out MEASURED => T282 measured/robot.toml
        discover MEASURED --out MEASURED => T282 measured/robot.toml
        simulate --poses 20 --random --out DIR/json --json DIR/json/robot.toml => T282 json/robot.toml
        calibrate MEASURED --variant Full --out DIR/out --json MEASURED/cart_poses.csv => T282 measured/cart_poses.csv
        evaluate MEASURED --variant Full --json MEASURED/robot.toml => T282 measured/robot.toml
        study MEASURED --out DIR/out --json MEASURED/tcp_poses.csv => T282 measured/tcp_poses.csv
        discover MEASURED --out DIR/out --json MEASURED/robot.toml => T282 measured/robot.toml
        kinematics forward MEASURED --variant Full --poses DIR/p.csv --out DIR/p.csv => T282 p.csv
        kinematics forward MEASURED --variant Full --commands 0,0,0 --out MEASURED/robot.toml => T282 measured/robot.toml
        kinematics inverse MEASURED --variant Full --pose=-1.5,-4.6,0.2 --json MEASURED/tcp_poses.csv => T282 measured/tcp_poses.csv";
    let files = ["robot.toml", "tcp_poses.csv", "cart_poses.csv"];
    let read = || files.map(|file| work.read(&format!("measured/{file}")));
    let before = read();
    insta::assert_snapshot!("outputs", refusals(&work, cases));
    assert_eq!(read(), before);
    assert!(!work.path().join("json/tcp_poses.csv").exists());
}

#[test]
fn descriptions_and_files_for_them_have_places() {
    let work = Work::prototype();
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
    work.write("pair.tau", description);
    let robot = work.read("measured/robot.toml");
    let line = robot.lines().count() + 2;
    for (name, value) in [
        ("parameter", "sinee = { value = 1e-3"),
        ("vector", "sine = { value = [1, 2, 3]"),
    ] {
        let effect = format!("[effects.\"rack_pitch(two)\"]\n{value}, tol = 1.0 }}\n");
        work.write(name, format!("{robot}{effect}"));
    }
    let cases = format!("
        generate DIR/pair.tau --out DIR/x => T131 pair.tau:5; T128 pair.tau:5; T144 pair.tau:10
        study PROTOTYPE --model DIR/pair.tau --out DIR/x => T131 pair.tau:5; T128 pair.tau:5; T144 pair.tau:10
        evaluate MEASURED --variant FullRack --robot DIR/parameter => T248 parameter:{line}
        evaluate MEASURED --variant FullRack --robot DIR/vector => T246 vector:{line}");
    insta::assert_snapshot!("descriptions", refusals(&work, &cases));
}

#[test]
fn tables_that_are_asked_about_have_places() {
    let work = Work::empty();
    for (name, text) in [
        ("side", "q1_m,q2_m,q3_m,dir1,dir2,dir3\n0,0,0,1,0,1\n"),
        ("sides", "q1_m,q2_m,q3_m,dir1\n0,0,0,1\n"),
        ("kelvin", "q1_m,q2_m,q3_m,temperature_c\n0,0,0,293\n"),
        ("twice", "pose,q1_m,q2_m,q3_m\n4,0,0,0\n4,0.1,0,0\n"),
        ("part", "q1_m,q2_m,q3_m,x_m,y_m,alpha_rad\n0,0,0,0,0,0\n"),
        ("angles", "x_m,y_m,z_m,alpha_rad,beta_rad\n0,0,-0.6,0,0\n"),
        (
            "degrees",
            "x_m,y_m,z_m,alpha_rad,beta_rad,gamma_rad\n0,0,-0.6,90,0,0\n",
        ),
        ("plain", "x_m,y_m,z_m\n0,0,-0.6\n"),
    ] {
        work.write(&format!("{name}.csv"), text);
    }
    let cases = "
        forward WITH Full --poses DIR/side.csv => T223 side.csv:2
        forward WITH Full --poses DIR/sides.csv => T539 sides.csv:1
        forward WITH Full --poses DIR/kelvin.csv => T223 kelvin.csv:2
        forward WITH Full --poses DIR/twice.csv => T226 twice.csv:3
        forward WITH Full --poses DIR/part.csv => T539 part.csv:1
        inverse WITH Full --poses DIR/angles.csv => T539 angles.csv:1
        inverse WITH Full --poses DIR/degrees.csv => T222 degrees.csv:2
        inverse WITH Warm --poses DIR/plain.csv => T501 plain.csv
        forward WITH Warm --commands 0,0,0 => T501 --commands";
    let cases = cases
        .replace("forward", "kinematics forward")
        .replace("inverse", "kinematics inverse");
    insta::assert_snapshot!(
        "tables",
        refusals(
            &work,
            &cases.replace("WITH", "--model ROBOTS/linear_delta.tau --variant")
        )
    );
}

/// Columns of other drives than those of the robot that is assumed: no other name of the column would mend that.
#[test]
fn measurements_of_drives_that_the_robot_lacks_are_refused() {
    let work = Work::prototype();
    let text = "pose,q1_rad,q2_rad,q3_rad,height_m\n1,0.1,0.1,0.1,0\n";
    work.write("unnamed/heights.csv", text);
    work.write("named/heights.csv", text)
        .write("named/robot.toml", work.read("measured/robot.toml"));
    // Where nothing names the robot, that is all that can be said.
    let cases = "
        check DIR/unnamed => T201 unnamed/robot.toml
        check DIR/named => T214 named/heights.csv:1; T214 named/heights.csv:1; T214 named/heights.csv:1";
    insta::assert_snapshot!("drives", refusals(&work, cases));
}

#[test]
fn what_is_not_finite_is_named() {
    let work = Work::prototype();
    let text = std::fs::read_to_string(GANTRY).unwrap();
    let own = "variant Odd = Full + odd(two);
               effect odd on cart { param size: length = 10 um tol 1 mm; along += size * sqrt((q + 0.2 m) / (1 m)); }";
    work.write("odd.tau", robots::extended(&text, own));
    let poses = work.table("measured/tcp_poses.csv");
    for line in [
        "calibrate MEASURED --model DIR/odd.tau --variant Odd --out DIR/out",
        "discover MEASURED --model DIR/odd.tau --base Odd --out DIR/out",
        "kinematics forward --model DIR/odd.tau --robot MEASURED/robot.toml --variant Odd --commands 0,-0.5,0",
    ] {
        let ran = work.run(line);
        let told = (ran.code, ran.codes().concat());
        assert_eq!(told, (1, "T502".to_owned()), "{line}: {}", ran.err);
        assert_eq!(work.listing(""), ["measured", "odd.tau"]);
        // The root of a negative number is asked for at the pose that is named.
        let (_, named) = ran.err.split_once("pose ").unwrap();
        let named = named.split(':').next().unwrap();
        let row = poses.cells("pose").iter().position(|pose| *pose == named);
        let q2 = poses.number(row.unwrap() + 1, "q2_m");
        let is_there = line.contains("--commands") || q2 < -0.2;
        assert!(is_there, "{line}: {}", ran.err);
    }
}
