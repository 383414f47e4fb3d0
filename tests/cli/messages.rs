//! The words of messages that no other test shows, each under its code in `tests/messages`. What leads to a message is
//! tested elsewhere: here the cheapest input that does is enough.

use std::fmt::Debug;

use serde_json::Value;
use tau::calibration::Options;
use tau::discovery;
use tau::measurements::Split;
use tau::trust::Reason;
use tau::{Error, Files, Session};
use tau_generated::five_bar::FiveBar;
use tau_generated::linear_delta::LinearDelta;
use tau_testkit::{OWN, Ran, Work, robots, show};

const POSES: &str = "tcp_poses.csv";
const BAR: &str = "--model five_bar --poses 20";
const LINES: &str =
    "--model four_lines --measure readings --noise-drives 1e-4 --random --poses 60 --seed 2";
const CALIBRATE: &str = "calibrate --variant Full";

/// Codes, a simulation, and a command that shows them.
const CASES: &str = "\
T394 | --model five_bar --poses 20 | calibrate --variant Full --free-scale
T333 | --model five_bar --poses 20 | evaluate --variant Full --split first:20
T330 | --model five_bar --poses 20 | calibrate --variant Full --split first:3
T361 | --model five_bar --poses 20 | sensitivity --variant Full --step 1e-14
T645 | --model five_bar --poses 20 | study --keep-outliers
T340 | --model five_bar --random --measure heights | calibrate --variant Full
T360 T392 | --model five_bar --random --measure heights | check -q
T391 T362 | --model five_bar --poses 20 --noise-scale 5,5,5 | check -q --strict
T339 | --model linear_delta --exact --measure ball-bar --random --poses 6 | evaluate --variant Full
T393 | --model linear_delta --poses 20 | check
T343 | --random --poses 40 --measure readings --noise-drives 1e-4 | evaluate --variant Full --keep-outliers
T602 T603 T604 T605 | --model hexapod --random --poses 20 --measure heights | check --json -
T634 | --model five_bar --random --poses 80 --outliers 0.05 --seed 3 | discover
T395 | --model five_bar --random --poses 80 --serial-noise 0.7 --seed 3 | calibrate --variant Full
T397 | --model five_bar --random --poses 80 --measure positions --noise-drives 1e-5 --serial-noise 0.8 --seed 3 | calibrate --variant Full
T639 | --model five_bar --random --poses 80 --serial-noise 0.7 --seed 3 | discover
T647 | --model five_bar --random --poses 80 --serial-noise -0.7 --seed 3 | discover --split all
T640 | --model five_bar --random --poses 2001 | discover --split all
T306 | --model four_belts --random --poses 60 --effect length_scale(top_left):scale=1e-3 | calibrate --variant Full
T606 T637 T641 | --poses 60 --variant Nominal --effect link_compliance(l1):strain=1e-6 | discover --base Nominal";

#[test]
fn measurements_lead_to_messages() {
    for case in CASES.lines() {
        let mut parts = case.split(" | ");
        let [codes, simulation, line] = [(); 3].map(|()| parts.next().unwrap());
        changed(codes, simulation, line, |_| {});
    }
}

/// Shows what a command says of a folder in which something is changed.
#[track_caller]
fn changed(codes: &str, simulation: &str, line: &str, change: impl FnOnce(&Work)) {
    let work = Work::simulated(simulation);
    change(&work);
    let (command, arguments) = line.split_once(' ').unwrap_or((line, ""));
    let out = match command {
        "calibrate" => "--out DIR/out",
        "discover" | "study" => "--out DIR/out --json -",
        _ => "",
    };
    shows(
        &work.run(&format!("{command} MEASURED {arguments} {out}")),
        codes,
    );
}

/// Shows codes, which stand in lines or, with their texts, in JSON.
#[track_caller]
fn shows(ran: &Ran, codes: &str) {
    let json = serde_json::from_str(&ran.out).unwrap_or(Value::Null);
    let mut told = Vec::new();
    gather(&json, &mut told);
    for code in codes.split(' ') {
        let own = told.iter().filter(|(of, _)| *of == code);
        let mut texts: Vec<String> = own.map(|(_, text)| format!("{text} [{code}]")).collect();
        texts.sort();
        texts.dedup();
        if texts.is_empty() {
            ran.shows(code);
        } else {
            show(code, &texts.join("\n"));
        }
    }
}

/// Codes of a JSON document with their texts.
fn gather<'a>(value: &'a Value, told: &mut Vec<(&'a str, &'a str)>) {
    let lists = [
        ["remark_codes", "remarks"],
        ["outside_codes", "outside"],
        ["codes", "lacks"],
    ];
    for keys in lists {
        let [codes, texts] = keys.map(|key| value[key].as_array().into_iter().flatten());
        let pairs = codes.zip(texts);
        told.extend(pairs.filter_map(|(code, text)| code.as_str().zip(text.as_str())));
    }
    for text in ["why", "why_not"] {
        told.extend(value["code"].as_str().zip(value[text].as_str()));
    }
    match value {
        Value::Array(all) => all.iter().for_each(|own| gather(own, told)),
        Value::Object(all) => all.values().for_each(|own| gather(own, told)),
        _ => {}
    }
}

#[test]
fn changed_tables_lead_to_messages() {
    let distances = "--model five_bar --measure distances --poses 20";
    changed("T344", distances, CALIBRATE, |work| {
        work.edit("distances.csv", |table| table.scale(&["distance_m"], 39.37));
    });
    changed("T345", LINES, "discover --base Anchors", |work| {
        let drives = ["q1_rad", "q2_rad", "q3_rad", "q4_rad"];
        let degrees = 1_f64.to_degrees();
        work.edit("readings.csv", |table| table.scale(&drives, degrees));
    });
    let hexapod = "--model hexapod --random --poses 20";
    changed("T540", hexapod, "study --no-discover", |work| {
        work.edit(POSES, |table| table.set(4, "q1_m", 3.0));
    });
    // A drive that loses motion at the poses which calibrate, and none at the few others.
    let random = "--model five_bar --random --poses 80 --seed 3";
    changed("T646", random, "discover --split first:74", |work| {
        work.edit(POSES, |table| {
            table.map_together(["dir1", "q1_rad"], |row, [side, command]| {
                *command -= if row <= 74 { 6e-5 * *side } else { 0.0 };
            });
        });
    });
    let first = &format!("{CALIBRATE} --split first:12");
    changed("T335", BAR, first, |work| {
        work.edit(POSES, |table| {
            table.map("x_m", |row, x| if row > 12 { x } else { 0.0 });
            table.map("y_m", |row, y| if row > 12 { y } else { 0.4 });
        });
    });
    for (code, shift, factor) in [("T530", 0.0, 3.0), ("T531", 5.0, 1.0)] {
        let work = Work::simulated(BAR);
        work.edit(POSES, |table| table.map("x_m", |_, x| shift + factor * x));
        shown(code, bar(&work).calibrate(FiveBar::FULL));
    }
}

#[test]
fn files_lead_to_messages() {
    changed("T205", BAR, "check", |work| {
        let path = work.measured().join(POSES);
        std::fs::remove_file(&path).unwrap();
        std::fs::create_dir(path).unwrap();
    });
    let work = Work::prototype();
    work.edit("cart_poses.csv", |table| {
        let cart = table.index("cart");
        table.rows.retain(|row| row[cart] != "3");
    });
    shows(&work.run("check MEASURED"), "T235");
    // A point is no line, along which a cart could be seen to move.
    let work = Work::prototype();
    work.edit("cart_positions.csv", |table| table.rows.truncate(1));
    let line = "discover MEASURED --base Nominal --json - --out DIR/out";
    shows(&work.run(line), "T635");
}

#[test]
fn robot_files_lead_to_messages() {
    changed("T256", BAR, "evaluate --variant Full", |work| {
        work.replace("position_m = 1e-5", "position_m = \"estimate\"");
    });
    changed("T396", LINES, "calibrate --variant Full", |work| {
        work.replace("[noise]", "[noise]\nrho = 0.5");
    });
    changed(
        "T342",
        LINES,
        "calibrate --variant Full --split all",
        |_| {},
    );
    changed("T348", LINES, "calibrate --variant Anchors", |work| {
        work.state("[noise.links]\nlength_m = 1e-4");
    });
    let positions = "--model five_bar --measure positions --poses 20";
    changed("T349", positions, "sensitivity --variant Full", |work| {
        work.state("[noise.tcp_positions]\nposition_m = \"estimate\"");
    });
    let heights = "--model linear_delta --random --poses 40 --measure heights";
    changed("T357", heights, CALIBRATE, |work| {
        let of_tracker = "position_m = 1e-5\nrotation_rad = 4e-5\n";
        work.replace(of_tracker, "heights = { height_m = 1e-5 }\n");
    });
    let work = Work::simulated(BAR);
    work.state("[drives]\nnoise_m = \"estimate\"");
    let forward = "kinematics forward MEASURED --variant Full --commands 2.09,1.04";
    shows(&work.run(forward), "T547");

    let work = Work::simulated(BAR);
    work.calibrated("--variant Full --split all");
    let forward = "kinematics forward --robot DIR/out/robot.toml --commands 2.5,0.6 --variant";
    shows(&work.run(&format!("{forward} Full")), "T543 T544");
    let other = work.run(&format!("{forward} Basic --json -"));
    shows(&other, "T254 T517 T546");
    let files = Files::from(work.measured()).robot_file(work.path().join("out/robot.toml"));
    let session = Session::<FiveBar>::open(files).unwrap().split(Split::All);
    let machine = session.machine(FiveBar::FULL).unwrap();
    shown("T334", session.evaluate(&machine));
}

const ON_TCP: &str = "effect more on tcp { param by: ratio tol 1e-4; position += by * (x, y, z); }";
const ON_LINK: &str =
    "effect more on link { param by: 1/N tol 1e-6 1/N; length += length * by * tension; }";
const KNOWN: &str = "effect known on link { length += 1 um; }";
/// The prototype without its single links.
const FOLDED: &str = "robot GantryTau {
    track one, two, three;
    cluster arm1 on one { link l1; }
    cluster arm2 on two { link l2a, l2b; }
    cluster arm3 on three { link l3a, l3b, l3c; }
    variant Nominal { arm reduced; tracks linear; }
}";
/// Parallel legs.
const LOOSE: &str = "robot Loose {
    plate body in plane;
    cluster legs on base {
        link a actuated length { length = 1 m tol 1 mm; plate_joint = (-0.1, 0, 0) m tol 1 mm; track_offset = (-0.1, -1, 0) m tol 1 mm; }
        link b actuated length { length = 1 m tol 1 mm; plate_joint = (0, 0, 0) m tol 1 mm; track_offset = (0, -1, 0) m tol 1 mm; }
        link c actuated length { length = 1 m tol 1 mm; plate_joint = (0.1, 0, 0) m tol 1 mm; track_offset = (0.1, -1, 0) m tol 1 mm; }
    }
    reference { commands = (0, 0, 0) m; position = (0, 0, 0) m; }
    variant Full { arm full; }
}";

/// Writes a standard robot's description, some words of which are others, as `own.tau`.
fn describe(work: &Work, robot: &str, changes: &[(&str, &str)]) {
    let text = robots::named(robot).description;
    let changed = |text: String, (old, new): &(&str, &str)| text.replacen(old, new, 1);
    work.write("own.tau", changes.iter().fold(text, changed));
}

#[test]
fn descriptions_lead_to_messages() {
    let with_effect = |work: &Work, robot: &str, effect: &str, place: &str| {
        let more = format!("{effect}\nvariant More = Full + more({place});");
        let text = robots::extended(&robots::named(robot).description, &more);
        work.write("own.tau", text);
    };
    let calibrate = &format!("calibrate {OWN} --variant More");
    let discover = &format!("discover {OWN}");
    let distances = "--model five_bar --measure distances --poses 20";
    changed("T350", distances, calibrate, |work| {
        with_effect(work, "five_bar", ON_TCP, "tcp");
        let forward = format!("kinematics forward {OWN} --variant More --commands 2,1");
        shows(&work.run(&forward), "T545");
    });
    let forces = "--model hexapod --random --poses 40 --measure positions --noise-drives 1e-4 --noise-force 0.5 --payload 20";
    changed("T358", forces, calibrate, |work| {
        with_effect(work, "hexapod", ON_LINK, "leg2");
    });
    changed("T642", forces, "discover", |work| {
        let without_payload = "robot = \"Hexapod\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[drives]\nnoise_m = 1e-4\n";
        work.write("measured/robot.toml", without_payload);
        work.edit("tcp_positions.csv", |table| table.set(5, "force1_N", ""));
    });
    changed("T389", BAR, &format!("check {OWN} --json -"), |work| {
        let twins = [
            (
                "left_y, right_y: length = 0 mm tol 0.5 mm",
                "left_y, twin, right_y: length = 0 mm",
            ),
            ("(left_x, left_y,", "(left_x, left_y + twin,"),
            ("left_y + upper_left", "left_y + twin + upper_left"),
        ];
        describe(work, "five_bar", &twins);
    });
    let work = Work::prototype();
    work.write("own.tau", FOLDED);
    shows(&work.run(&format!("{discover} MEASURED")), "T630");
    let study = format!("study MEASURED {OWN} --out DIR/out --json -");
    shows(&work.run(&study), "T644");
    changed("T631", BAR, discover, |work| {
        describe(work, "five_bar", &[("variant Basic", "variant Discovered")]);
    });
    let effects = format!("{discover} --effects DIR/effects.tau");
    changed("T633 T662", BAR, &effects, |work| {
        with_effect(work, "five_bar", ON_LINK, "lower_left");
        work.write("effects.tau", format!("{KNOWN}\n{ON_LINK}"));
    });
    let work = Work::described(LOOSE);
    shows(&work.run(&format!("simulate {OWN} --out MEASURED")), "T535");
    let forward = format!("kinematics forward {OWN} --variant Full --commands 0,0,0");
    let ran = work.run(&forward);
    assert_eq!((ran.code, ran.codes().concat().as_str()), (1, "T504"));
}

fn bar(work: &Work) -> Session<FiveBar> {
    Session::open(work.measured()).unwrap()
}

/// Shows an error, in which files stand without their folder.
#[track_caller]
fn shown<T>(code: &str, answer: Result<T, impl Into<Error> + Debug>) {
    let error: Error = answer.err().expect("a refusal").into();
    assert_eq!(error.code().to_string(), code);
    let text = error.to_string();
    let of_file = |line| str::rsplit_once(line, "measured").map_or(line, |own| own.1);
    let lines: Vec<&str> = text.lines().map(of_file).collect();
    show(code, &lines.join("\n"));
}

/// What no command leads to: other starts and options of the solver, and noise that no file may state.
#[test]
fn the_library_gives_messages() {
    let session = bar(&Work::simulated(BAR));
    let calibrated = |start: Option<Vec<f64>>, iterations| {
        let mut options = Options::default();
        (options.start, options.solver.max_iterations) = (start, iterations);
        session.calibrate_with(FiveBar::FULL, &options)
    };
    let count = session.robot().variant("Full").unwrap().parameters.len();
    let with_catalogue = |text: &str| {
        let options = discovery::Options {
            catalogues: vec![text.to_owned()],
            ..Default::default()
        };
        session.discover_with(FiveBar::FULL, &options, &mut |_| {})
    };
    shown("T632", with_catalogue("effect more on cart { }"));
    let reserved = "effect unnamed_more on link { param by: length; length += by; }";
    let reserved = with_catalogue(reserved).err().unwrap();
    assert_eq!(reserved.code().to_string(), "T631");
    shown("T354", calibrated(Some(vec![]), 100));
    shown("T370", calibrated(Some(vec![1e150; count]), 100));
    shown("T371", calibrated(Some(vec![f64::NAN; count]), 100));
    shown("T301", calibrated(None, 1));
    let held_out = Reason::OfHeld(vec![Reason::WithinTolerances], true);
    show("T385", &held_out.remark().to_string());

    let wave =
        "--model linear_delta --random --poses 60 --effect rack_pitch(b):sine=4e-5,period=0.0133";
    let session = Session::<LinearDelta>::open(Work::simulated(wave).measured()).unwrap();
    // Set 2 has a frame of its own, which set 1 does not depend on.
    let calibrated = session.calibrate(LinearDelta::FULL).unwrap();
    shown("T353", calibrated.estimate("set2.translation.x"));
    let mut found = session.discover(LinearDelta::FULL).unwrap().discovery;
    found.effects[0].aliases = vec![0.02];
    let text = tau_report::terminal::discovery(&found, usize::MAX);
    for code in ["T660", "T661"] {
        let said = text.lines().find(|line| line.contains(code));
        show(code, said.unwrap().trim());
    }
}
