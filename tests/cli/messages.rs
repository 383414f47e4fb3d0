//! The words of messages that no other test shows, each under its code in `tests/messages`. What leads to a message is
//! tested elsewhere: here the cheapest input that does is enough.

use std::fmt::Debug;

use serde_json::Value;
use tau::calibration::Options;
use tau::measurements::Split;
use tau::trust::Reason;
use tau::{Error, Files, Session};
use tau_generated::five_bar::FiveBar;
use tau_generated::linear_delta::LinearDelta;
use tau_testkit::{Ran, Work, show};

const POSES: &str = "tcp_poses.csv";
const BAR: &str = "--model five_bar --poses 20";
const LINES: &str =
    "--model four_lines --measure readings --noise-drives 1e-4 --random --poses 60 --seed 2";

/// Codes, a simulation, and a command line that shows them.
const CASES: &str = "\
T333 | --model five_bar --poses 20 | evaluate MEASURED --variant Full --split first:20
T330 | --model five_bar --poses 20 | calibrate MEASURED --variant Full --split first:3 --out DIR/out
T361 | --model five_bar --poses 20 | sensitivity MEASURED --variant Full --step 1e-14
T645 | --model five_bar --poses 20 | study MEASURED --keep-outliers --out DIR/out --json -
T340 | --model five_bar --random --measure heights | calibrate MEASURED --variant Full --out DIR/out
T360 T392 | --model five_bar --random --measure heights | check MEASURED -q
T391 | --model five_bar --poses 20 --noise-scale 5,5,5 | check MEASURED -q
T339 | --model linear_delta --exact --measure ball-bar --random --poses 6 | evaluate MEASURED --variant Full
T393 | --model linear_delta --poses 20 | check MEASURED
T343 | --random --poses 40 --measure readings --noise-drives 1e-4 | evaluate MEASURED --variant Full --keep-outliers
T602 T603 T604 T605 | --model hexapod --random --poses 20 --measure heights | check MEASURED --json -
T634 | --model five_bar --random --poses 80 --outliers 0.05 --seed 3 | discover MEASURED --out DIR/out --json -
T639 | --model five_bar --random --poses 80 --serial-noise 0.7 --seed 3 | discover MEASURED --out DIR/out --json -
T647 | --model five_bar --random --poses 80 --serial-noise -0.7 --seed 3 | discover MEASURED --split all --out DIR/out --json -
T640 | --model five_bar --random --poses 2001 | discover MEASURED --split all --out DIR/out --json -
T636 | --model four_belts --random --poses 60 --effect length_scale(top_left):scale=1e-3 | discover MEASURED --base Full --out DIR/out --json -
T606 T637 T641 | --poses 60 --track-points 20 --cart-poses 10 --variant Nominal --effect link_compliance(l1):strain=1e-6 | discover MEASURED --base Nominal --out DIR/out --json -";

#[test]
fn what_is_measured_leads_to_messages() {
    for case in CASES.lines() {
        let [codes, simulation, line] = case.split(" | ").collect::<Vec<_>>()[..] else {
            panic!("{case}")
        };
        shows(&Work::simulated(simulation).run(line), codes);
    }
}

/// Shows codes, which stand in lines or, with their texts, in JSON.
#[track_caller]
fn shows(ran: &Ran, codes: &str) {
    let json = serde_json::from_str(&ran.out).unwrap_or(Value::Null);
    let mut told = Vec::new();
    gather(&json, &mut told);
    for code in codes.split(' ') {
        let own = told.iter().filter(|(of, _)| *of == code);
        let mut texts: Vec<&str> = own.map(|(_, text)| *text).collect();
        texts.sort_unstable();
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
    for [codes, texts] in [
        ["remark_codes", "remarks"],
        ["outside_codes", "outside"],
        ["codes", "lacks"],
    ] {
        let [codes, texts] = [codes, texts].map(|key| value[key].as_array().into_iter().flatten());
        let pairs = codes.zip(texts);
        told.extend(pairs.filter_map(|(code, text)| code.as_str().zip(text.as_str())));
    }
    for text in ["reason", "why_not"] {
        told.extend(value["code"].as_str().zip(value[text].as_str()));
    }
    match value {
        Value::Array(all) => all.iter().for_each(|own| gather(own, told)),
        Value::Object(all) => all.values().for_each(|own| gather(own, told)),
        _ => {}
    }
}

#[track_caller]
fn changed(codes: &str, simulation: &str, line: &str, change: impl FnOnce(&Work)) {
    let work = Work::simulated(simulation);
    change(&work);
    shows(&work.run(line), codes);
}

/// Adds lines to the robot file of the measurements.
fn state(work: &Work, lines: &str) {
    let stated = work.read("measured/robot.toml");
    work.write("measured/robot.toml", format!("{stated}\n{lines}\n"));
}

#[test]
fn changed_tables_lead_to_messages() {
    let full = "calibrate MEASURED --variant Full --out DIR/out";
    changed("T335", BAR, full, |work| {
        work.edit(POSES, |table| {
            let first = table.rows[0].clone();
            let rows = table.rows.iter_mut().step_by(2);
            rows.for_each(|row| row.clone_from(&first));
            table.map("pose", |row, _| row as f64);
        });
    });
    let distances = "--model five_bar --measure distances --poses 20";
    changed("T344", distances, full, |work| {
        work.edit("distances.csv", |table| table.scale(&["distance_m"], 39.37));
    });
    let search = "discover MEASURED --base Anchors --out DIR/out";
    changed("T345", LINES, search, |work| {
        let drives = ["q1_rad", "q2_rad", "q3_rad", "q4_rad"];
        work.edit("readings.csv", |table| {
            table.scale(&drives, 1_f64.to_degrees());
        });
    });
    let heights = "--model linear_delta --measure positions,heights --poses 20";
    changed("T346", heights, full, |work| {
        work.edit("heights.csv", |table| table.add(5, "q1_m", 0.03));
    });
    let study = "study MEASURED --no-discover --out DIR/out --json -";
    changed(
        "T540",
        "--model hexapod --random --poses 20",
        study,
        |work| {
            work.edit(POSES, |table| table.set(4, "q1_m", 3.0));
        },
    );
    let carts = "--model linear_delta --random --poses 60";
    let search = "discover MEASURED --out DIR/out --json -";
    changed("T235 T635", carts, search, |work| {
        work.edit("cart_poses.csv", |table| table.keep(|row| row == 1));
    });
    let poses = "--model five_bar --random --poses 80 --seed 3";
    changed("T646", poses, &search.replace("--json -", "-q"), |work| {
        work.edit(POSES, |table| {
            table.map_together(["pose", "time_s", "x_m"], |_, [pose, time_s, x_m]| {
                *x_m += if *pose % 2.0 > 0.0 { 1e-7 } else { -1e-7 } * *time_s;
            });
        });
    });
    // Most poses out of reach, and some.
    for (code, shift, factor) in [("T530", 0.0, 3.0), ("T531", 5.0, 1.0)] {
        let work = Work::simulated(BAR);
        work.edit(POSES, |table| table.map("x_m", |_, x| shift + factor * x));
        shown(code, bar(&work).calibrate(FiveBar::FULL));
    }
}

#[test]
fn robot_files_lead_to_messages() {
    let evaluate = "evaluate MEASURED --variant Full";
    changed("T256", BAR, evaluate, |work| {
        work.replace("position_m = 1e-5", "position_m = \"estimate\"");
    });
    let full = "calibrate MEASURED --variant Full --out DIR/out";
    let both = full.replace("Full", "Anchors");
    changed("T348", LINES, &both, |work| {
        state(work, "[noise.links]\nlength_m = 1e-4");
    });
    changed("T342", LINES, &format!("{full} --split all"), |_| {});
    let positions = "--model five_bar --measure positions --poses 20";
    let sensitivity = "sensitivity MEASURED --variant Full";
    changed("T349", positions, sensitivity, |work| {
        state(work, "[noise.tcp_positions]\nposition_m = \"estimate\"");
    });
    let heights = "--model linear_delta --random --poses 40 --measure heights";
    changed("T357", heights, full, |work| {
        let of_tracker = "position_m = 1e-5\nrotation_rad = 4e-5\n";
        work.replace(of_tracker, "heights = { height_m = 1e-5 }\n");
    });
    let forward = "kinematics forward --model five_bar --robot DIR/robot.toml --variant Full --commands 2.09,1.04";
    let drives = "robot = \"FiveBar\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[drives]\nnoise_m = \"estimate\"\n";
    let work = Work::empty();
    work.write("robot.toml", drives);
    shows(&work.run(forward), "T547");
}

#[test]
fn calibrated_robot_files_lead_to_messages() {
    let work = Work::simulated(BAR);
    work.run("calibrate MEASURED --variant Full --split all --out DIR/out")
        .done();
    let forward = "kinematics forward --robot DIR/out/robot.toml --commands 2.5,0.6 --variant";
    shows(&work.run(&format!("{forward} Full")), "T543 T544");
    let other = work.run(&format!("{forward} Basic --json -"));
    shows(&other, "T254 T517 T546");
    let files = Files::from(work.measured()).robot_file(work.path().join("out/robot.toml"));
    let session = Session::<FiveBar>::open(files).unwrap();
    let session = session.split(Split::All);
    let machine = session.machine(FiveBar::FULL).unwrap();
    shown("T334", session.evaluate(&machine));
}

/// A folder with a standard robot's description, some words of which are others, as `own.tau`.
fn described(simulation: &str, robot: &str, changes: &[(&str, &str)]) -> Work {
    let models = concat!(env!("CARGO_MANIFEST_DIR"), "/../generated/models");
    let mut text = std::fs::read_to_string(format!("{models}/{robot}.tau")).unwrap();
    for (old, new) in changes {
        assert!(text.contains(old), "{old}");
        text = text.replacen(old, new, 1);
    }
    let work = Work::simulated(simulation);
    work.write("own.tau", text);
    work
}

#[test]
fn descriptions_lead_to_messages() {
    let on_tcp =
        "effect more on tcp { param by: ratio tol 1e-4; position += by * (x, y, z); }\npub robot";
    let on_link = "effect more on link { param by: 1/N tol 1e-6 1/N; length += by * length * tension; }\npub robot";
    let variant = |place: &str| format!("variant More = Full + more({place});\n    variant Full");
    let hexapod = |simulation: &str, effect: &str, place: &str| {
        let simulation = format!("--model hexapod --random --poses 40 {simulation}");
        let changes = [("pub robot", effect), ("variant Full", &variant(place))];
        described(&simulation, "hexapod", &changes)
    };
    let calibrate = "calibrate MEASURED --model DIR/own.tau --variant More --out DIR/out";
    let work = hexapod("--measure distances", on_tcp, "tcp");
    shows(&work.run(calibrate), "T350");
    let forward = "kinematics forward --model DIR/own.tau --variant More --commands 0,0,0,0,0,0";
    shows(&work.run(forward), "T545");
    let forces = "--measure positions --noise-drives 1e-4 --noise-force 0.5 --payload 20";
    let work = hexapod(forces, on_link, "leg2");
    shows(&work.run(calibrate), "T358");
    let (before, payload) = work
        .read("measured/robot.toml")
        .split_once("[payload]")
        .map(|(a, b)| (a.to_owned(), b.to_owned()))
        .unwrap();
    let after = payload.split_once("\n[").map_or("", |rest| rest.1);
    work.write("measured/robot.toml", format!("{before}[{after}"));
    work.edit("tcp_positions.csv", |table| table.set(5, "force1_N", ""));
    let discover = "discover MEASURED --model DIR/own.tau --out DIR/found --json -";
    shows(&work.run(discover), "T642");

    let twice = [
        (
            "left_y, right_y: length = 0 mm tol 0.5 mm",
            "left_y, twin_y, right_y: length = 0 mm",
        ),
        ("left_y, 0 m", "left_y + twin_y, 0 m"),
        ("left_y + upper_left", "left_y + twin_y + upper_left"),
    ];
    let work = described(BAR, "five_bar", &twice);
    shows(
        &work.run("check MEASURED --model DIR/own.tau --json -"),
        "T389",
    );
    let work = described(BAR, "five_bar", &[("variant Basic", "variant Discovered")]);
    shows(&work.run(discover), "T631");
    let effect = "effect more on link { param by: length tol 1 mm; length += by; }\npub robot";
    let changes = [
        ("pub robot", effect),
        ("variant Full", &variant("lower_left")),
    ];
    let work = described(BAR, "five_bar", &changes);
    let known = "effect known on link { length += 1 um; }\n";
    work.write(
        "effects.tau",
        format!("{known}{}", effect.replace("pub robot", "")),
    );
    shows(
        &work.run(&format!("{discover} --effects DIR/effects.tau")),
        "T633 T662",
    );

    let reduced = described(
        "--poses 40 --track-points 10 --cart-poses 5",
        "gantry_tau",
        &[],
    );
    let text = reduced.read("own.tau");
    let kept = text.lines().filter(|line| {
        !["arm full", "FullRack"]
            .iter()
            .any(|own| line.contains(own))
    });
    let kept: Vec<&str> = kept.collect();
    reduced.write("own.tau", kept.join("\n"));
    shows(&reduced.run(discover), "T630");
    shows(
        &reduced.run("study MEASURED --model DIR/own.tau --out DIR/out --json -"),
        "T644",
    );

    let link = |name: &str, x: f64| {
        format!(
            "link {name} actuated length {{ length = 1 m tol 1 mm; plate_joint = ({x}, 0, 0) m tol 1 mm; track_offset = ({x}, -1, 0) m tol 1 mm; }}"
        )
    };
    let links = ["a", "b", "c"].into_iter().zip([-0.1, 0.0, 0.1]);
    let links: Vec<String> = links.map(|(name, x)| link(name, x)).collect();
    let parallel = links.join("\n");
    work.write("own.tau", format!("robot Loose {{ plate body in plane; cluster legs on base {{ {parallel} }} reference {{ commands = (0, 0, 0) m; position = (0, 0, 0) m; }} variant Full {{ arm full; }} }}"));
    shows(
        &work.run("simulate --model DIR/own.tau --out DIR/loose"),
        "T535",
    );
}

fn bar(work: &Work) -> Session<FiveBar> {
    Session::open(work.measured()).unwrap()
}

#[track_caller]
fn shown<T>(code: &str, answer: Result<T, impl Into<Error> + Debug>) {
    let error: Error = answer.err().expect("a refusal").into();
    assert_eq!(error.code().to_string(), code);
    // Without the folder's name.
    let place = error.to_string();
    let text = place
        .lines()
        .map(|line| line.rsplit_once("measured/").map_or(line, |own| own.1));
    show(code, &text.collect::<Vec<_>>().join("\n"));
}

/// What no command line leads to: other starts and options of the solver, and noise that no file may state.
#[test]
fn the_library_gives_messages() {
    let session = bar(&Work::simulated(BAR));
    let count = session.robot().variant("Full").unwrap().parameters.len();
    let started = |start: Vec<f64>| {
        let start = Some(start);
        session.calibrate_with(
            FiveBar::FULL,
            &Options {
                start,
                ..Options::default()
            },
        )
    };
    shown("T354", started(vec![]));
    shown("T370", started(vec![1e200; count]));
    shown("T371", started(vec![f64::NAN; count]));
    let mut brief = Options::default();
    brief.solver.max_iterations = 1;
    shown("T301", session.calibrate_with(FiveBar::FULL, &brief));
    let mut file = session.robot_file().clone();
    (file.noise.position_m, file.noise.rotation_rad) = (0.0, 0.0);
    let exact = Session::<FiveBar>::of(session.folder().clone(), file);
    shown("T351", exact.calibrate(FiveBar::FULL));
    let held_out = Reason::OfHeld(vec![Reason::WithinTolerances], true);
    show("T385", &held_out.remark().to_string());

    let wave =
        "--model linear_delta --random --poses 60 --effect rack_pitch(b):sine=4e-5,period=0.0133";
    let session = Session::<LinearDelta>::open(Work::simulated(wave).measured()).unwrap();
    let mut found = session.discover(LinearDelta::FULL).unwrap().discovery;
    found.effects[0].aliases = vec![0.02];
    let text = tau_report::terminal::discovery(&found, usize::MAX);
    for code in ["T660", "T661"] {
        let said = text.lines().find(|line| line.contains(code));
        show(code, said.unwrap().trim());
    }
}
