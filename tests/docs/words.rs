//! Words of the program and its reports: machines are called by the parts that they have, and a mistake has one message.

use std::fs;
use std::path::Path;

use crate::support::{Ran, tau_in};

/// A plate that slides and turns in the plane, held by three rods of driven length.
const PLANAR: &str = "
pub robot Planar {
    plate body in plane;
    cluster rods on base {
        link a actuated length {
            length = 0.5 m tol 1 mm; plate_joint = (0.1, 0.05, 0) m tol 0.3 mm; track_offset = (0.6, 0.05, 0) m tol 1 mm;
        }
        link b actuated length {
            length = 0.5 m tol 1 mm; plate_joint = (-0.1, 0.05, 0) m tol 0.3 mm; track_offset = (-0.1, 0.55, 0) m tol 1 mm;
        }
        link c actuated length {
            length = 0.5 m tol 1 mm; plate_joint = (0, -0.1, 0) m tol 0.3 mm; track_offset = (-0.4, -0.4, 0) m tol 1 mm;
        }
    }
    reference { commands = (0, 0, 0) m; position = (0, 0, 0) m; }
    variant Full { arm full; }
    variant Lengths = Full hold all.plate_joint, all.track_offset;
}
";

/// Text of a page as a reader sees it: no tags, styles or scripts.
fn seen(page: &str) -> String {
    let mut text = page.to_owned();
    for element in ["style", "script"] {
        while let Some(start) = text.find(&format!("<{element}")) {
            let end = format!("</{element}>");
            let length = text[start..].find(&end).unwrap() + end.len();
            text.replace_range(start..start + length, " ");
        }
    }
    let mut is_tag = false;
    let visible = text.chars().filter(|&letter| {
        let is_shown = !is_tag && letter != '<';
        is_tag = (is_tag || letter == '<') && letter != '>';
        is_shown
    });
    visible.collect()
}

/// Words in the order in which they stand; names such as `track_offset` are one.
fn words(text: &str) -> Vec<String> {
    let parts = text.split(|letter: char| !(letter.is_alphanumeric() || letter == '_'));
    parts.map(str::to_lowercase).collect()
}

/// Text of a study of a simulated machine, on the screen and on the page, and the names of the files that it writes.
fn study(work: &Path, model: &str) -> (String, Vec<String>) {
    let line = format!(
        "tau simulate --model {model} --poses 36 --track-points 6 --cart-poses 12 --out DIR/measured"
    );
    tau_in(work, &line).done();
    study_of(work, &format!("DIR/measured --model {model}"))
}

fn study_of(work: &Path, with: &str) -> (String, Vec<String>) {
    let line = format!("tau study {with} --no-discover --out DIR/study");
    let said = tau_in(work, &line).done();
    let page = fs::read_to_string(work.join("study/report.html")).unwrap();
    let files = fs::read_dir(work.join("study")).unwrap();
    let files = files.map(|file| file.unwrap().file_name().into_string().unwrap());
    // Files that were written are listed with their place, which may hold any word.
    let said = said.split("\nWritten\n").next().unwrap();
    (format!("{said}\n{}", seen(&page)), files.collect())
}

fn assert_lacks(text: &str, lacking: &[&str], model: &str) {
    for (index, word) in words(text).iter().enumerate() {
        if lacking.contains(&word.as_str()) {
            let all = words(text);
            let near = &all[index.saturating_sub(12)..(index + 8).min(all.len())];
            panic!("{model}: `{word}` in `{}`", near.join(" "));
        }
    }
}

const OF_TRACKS: [&str; 4] = ["cart", "carts", "track", "tracks"];
const OF_TURNING: [&str; 8] = [
    "orientation",
    "mrad",
    "euler",
    "ωx",
    "ωy",
    "ωz",
    "rotation",
    "µrad",
];
const OF_PAPER: [&str; 4] = ["dressler", "paper", "iii", "icra"];

/// Cranks are no tracks, a point does not turn, and no table of another machine is one of the paper's.
#[test]
fn a_study_calls_a_machine_by_its_parts() {
    let none: [&str; 0] = [];
    for (model, tracks, turning, paper) in [
        ("five_bar", &OF_TRACKS[..], &OF_TURNING[..], &OF_PAPER[..]),
        ("rotary_delta", &OF_TRACKS, &OF_TURNING, &OF_PAPER),
        ("servo_hexapod", &OF_TRACKS, &none, &OF_PAPER),
        ("linear_delta", &none, &OF_TURNING, &OF_PAPER),
        ("four_belts", &OF_TRACKS, &OF_TURNING, &OF_PAPER),
        ("hexaglide", &none, &none, &OF_PAPER),
    ] {
        let work = tempfile::tempdir().unwrap();
        let (text, files) = study(work.path(), model);
        // The next steps are commands for this machine and its measurements.
        let given = format!("{}/measured --model {model} ", work.path().display());
        assert!(text.contains(&given), "{model}: {text}");
        for lacking in [tracks, turning, paper] {
            assert_lacks(&text, lacking, model);
        }
        // Nothing stands under a heading where a machine has nothing of it.
        let has_tables = text.contains("Sensitivity: position");
        assert_eq!(
            has_tables,
            !["four_belts", "linear_delta"].contains(&model),
            "{model}"
        );
        let assumes = text.contains("What the models assume");
        assert_eq!(assumes, tracks.is_empty() || turning.is_empty(), "{model}");
        assert_eq!(text.contains("\nAssumptions\n"), assumes, "{model}");
        let of_turning = files.iter().any(|file| file.contains("orientation"));
        assert_eq!(of_turning, turning.is_empty(), "{model}: {files:?}");
    }
}

/// The paper's own robot keeps its tables; a plate in the plane turns about one axis, and has a column for it alone.
#[test]
fn a_study_has_a_column_for_each_axis_about_which_the_plate_turns() {
    let work = tempfile::tempdir().unwrap();
    let (text, files) = study_of(work.path(), "DATA");
    for words in [
        "Dressler",
        "Table I. Errors",
        "Table III. Sensitivity: orientation",
        "track one",
    ] {
        assert!(text.contains(words), "{words}: {text}");
    }
    assert!(
        files.contains(&"figure_4_orientation.svg".to_owned()),
        "{files:?}"
    );

    let work = tempfile::tempdir().unwrap();
    let model = work.path().join("planar.tau");
    fs::write(&model, PLANAR).unwrap();
    let (text, files) = study(work.path(), "DIR/planar.tau");
    assert_lacks(&text, &["ωx", "ωy"], "planar");
    assert!(
        text.contains("|ωz|") && text.contains("mrad about z"),
        "{text}"
    );
    assert!(
        files.contains(&"figure_4_orientation.svg".to_owned()),
        "{files:?}"
    );
}

/// A table of measurements with other numbers in some columns.
fn with_columns(path: &Path, change: impl Fn(&str, f64) -> f64) {
    let text = fs::read_to_string(path).unwrap();
    let mut lines = text.lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let mut changed = header.join(",") + "\n";
    for line in lines {
        let cells = header.iter().zip(line.split(','));
        let cells = cells.map(|(name, cell)| match cell.parse() {
            Ok(value) => change(name, value).to_string(),
            Err(_) => cell.to_owned(),
        });
        changed += &(cells.collect::<Vec<_>>().join(",") + "\n");
    }
    fs::write(path, changed).unwrap();
}

#[test]
fn points_have_no_rotations_to_mistake_and_none_to_repeat() {
    let work = tempfile::tempdir().unwrap();
    let line = "tau simulate --model rotary_delta --poses 40 --readings 3 --out DIR/measured";
    tau_in(work.path(), line).done();
    let said = tau_in(
        work.path(),
        "tau calibrate DIR/measured --variant Full --out DIR/out",
    )
    .done();
    assert!(
        said.contains("repeat to") && !said.contains("mrad"),
        "{said}"
    );

    let change = |name: &str, value: f64| if name == "x_m" { -value } else { value };
    with_columns(&work.path().join("measured/tcp_poses.csv"), change);
    let ran = tau_in(work.path(), "tau check DIR/measured");
    assert_eq!(ran.code, 1, "{}", ran.out);
    assert!(
        ran.err.contains("the x axis of the positions is mirrored"),
        "{}",
        ran.err
    );
    // The measurements may be right, and the drawing mirrored: both fit as well.
    let said: Vec<&str> = ran.out.split_whitespace().collect();
    let said = said.join(" ");
    assert!(
        said.contains("if it is the drawing that is mirrored"),
        "{said}"
    );
    assert!(!ran.err.contains("rotations"), "{}", ran.err);
}

fn errors(ran: &Ran) -> usize {
    ran.err.matches("error: ").count()
}

/// Nobody knows which robot was measured where the robot file does not say: what another one lacks is no mistake.
#[test]
fn an_input_that_can_not_be_read_is_the_only_mistake() {
    let work = tempfile::tempdir().unwrap();
    tau_in(
        work.path(),
        "tau simulate --model rotary_delta --out DIR/measured",
    )
    .done();
    fs::write(work.path().join("broken.toml"), "robot = \"RotaryDelta\n").unwrap();
    let other = fs::read_to_string(work.path().join("measured/robot.toml")).unwrap();
    let other = other.replacen("\"RotaryDelta\"", "\"Other\"", 1);
    fs::write(work.path().join("other.toml"), other).unwrap();
    fs::create_dir(work.path().join("bare")).unwrap();
    fs::copy(
        work.path().join("measured/tcp_poses.csv"),
        work.path().join("bare/tcp_poses.csv"),
    )
    .unwrap();
    for (with, expected) in [
        (
            "DIR/measured --robot DIR/missing.toml",
            "the file does not exist",
        ),
        (
            "DIR/measured --robot DIR/broken.toml",
            "invalid basic string",
        ),
        (
            "DIR/measured --robot DIR/other.toml",
            "robot.toml is for robot `Other`",
        ),
        ("DIR/bare", "expected the parameters of the robot"),
        ("DIR/nowhere", "the folder does not exist"),
        (
            "DIR/nowhere --model rotary_delta",
            "the folder does not exist",
        ),
        (
            "DIR/measured --model DIR/missing.tau",
            "expected the description of the robot",
        ),
    ] {
        for command in [
            "check WITH",
            "calibrate WITH --variant Basic --out DIR/out",
            "evaluate WITH --variant Basic",
            "study WITH --out DIR/out",
            "kinematics forward WITH --variant Basic --commands 0,0,0",
        ] {
            let line = format!("tau {}", command.replace("WITH", with));
            let ran = tau_in(work.path(), &line);
            assert_eq!(ran.code, 2, "{line}");
            assert!(
                ran.err.contains(expected) && errors(&ran) == 1,
                "{line}: {}",
                ran.err
            );
        }
    }
}

/// Without a robot file there is none to add anything to.
#[test]
fn a_missing_reference_is_asked_of_the_file_that_is_there() {
    let work = tempfile::tempdir().unwrap();
    let model = PLANAR.replace("    reference {", "    // reference {");
    fs::write(work.path().join("X.tau"), model).unwrap();
    for line in [
        "tau kinematics forward --model DIR/X.tau --variant Full --commands 0,0,0",
        "tau simulate --model DIR/X.tau --out DIR/measured",
    ] {
        let ran = tau_in(work.path(), line);
        assert_eq!(ran.code, 2);
        let place = format!("--> {}", work.path().join("X.tau").display());
        let mend = "add `reference { commands = (0, 0, 0) m; position = (x, y, 0) m; orientation = (alpha, 0, 0) rad; }` to \
                    the description";
        let said = ran.err.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains(&place) && said.contains(mend), "{said}");
        assert!(!said.contains("robot.toml"), "{said}");
    }
    let line = "tau init DIR/X.tau --out DIR/robot.toml";
    tau_in(work.path(), line).done();
    let file = work.path().join("robot.toml");
    let text = fs::read_to_string(&file).unwrap();
    let end = text.find("[reference]").unwrap_or(text.len());
    let text = text[..end].replace("position_m = \"?\"", "position_m = 1e-5");
    fs::write(
        &file,
        text.replace("rotation_rad = \"?\"", "rotation_rad = 4e-5"),
    )
    .unwrap();
    let line = "tau kinematics forward --model DIR/X.tau --robot DIR/robot.toml --variant Full --commands 0,0,0";
    let ran = tau_in(work.path(), line);
    let said = ran.err.split_whitespace().collect::<Vec<_>>().join(" ");
    let mend = "add `[reference]` with `commands_m = [0, 0, 0]`";
    assert!(
        said.contains(&format!("--> {}", file.display())) && said.contains(mend),
        "{said}"
    );
}

/// A file may hold the paths of some tracks, and no folder those of the others.
#[test]
fn a_missing_path_has_a_place() {
    let work = tempfile::tempdir().unwrap();
    tau_in(
        work.path(),
        "tau calibrate DATA --variant BestPerLink --out DIR/out",
    )
    .done();
    for file in ["DIR/out/robot.toml", "DATA/robot.toml"] {
        let line = format!(
            "tau kinematics forward --robot {file} --variant FullPiecewise --commands 0,0,0"
        );
        let ran = tau_in(work.path(), &line);
        assert_eq!(ran.code, 2);
        let places = ran
            .err
            .lines()
            .filter_map(|line| line.trim().strip_prefix("-->"));
        for place in places {
            assert!(place.trim().ends_with("robot.toml"), "{}", ran.err);
        }
        assert!(ran.err.contains("name a measurement FOLDER"), "{}", ran.err);
    }
}

/// Readings of more drives than freedoms are measurements, whose noise nobody stated.
#[test]
fn exact_readings_of_redundant_drives_are_remarked() {
    let remark = "the drives read exactly";
    for (with, is_remarked) in [
        ("--model four_belts --measure readings", true),
        ("--model four_lines", true),
        (
            "--model four_belts --measure readings --noise-drives 1e-4",
            false,
        ),
        ("--model five_bar", false),
    ] {
        let work = tempfile::tempdir().unwrap();
        let ran = tau_in(
            work.path(),
            &format!("tau simulate {with} --poses 12 --out DIR/out"),
        );
        assert_eq!(ran.code, 0, "{}", ran.err);
        assert_eq!(ran.err.contains(remark), is_remarked, "{with}: {}", ran.err);
        // Sets of carts that a machine lacks are not counted.
        assert!(!ran.out.contains("cart poses"), "{}", ran.out);
    }
}

/// Sets of carts count where places of tracks follow from formulas, and are not said to be missing.
#[test]
fn sets_beside_tracks_by_formulas_take_part() {
    let work = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --poses 30 --track-points 6 --cart-poses 12 --out DIR/out";
    tau_in(work.path(), line).done();
    let said = tau_in(
        work.path(),
        "tau discover DIR/out --base Full --out DIR/found",
    )
    .done();
    assert!(!said.contains("takes no part"), "{said}");
    assert!(!said.contains("is missing: it would show"), "{said}");
}
