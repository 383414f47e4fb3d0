//! Configurations as they are written, read as the firmware takes them, or refused.

use tau_testkit::{Ran, Work};

use super::{Printer, imagined};
use crate::answers::{Answers, cases, replaced};

/// A line of the printer's file, a stretch of it, what stands in its place, and the answer.
const REFUSED: &str = r"
kinematics: delta     | kinematics: corexy                | T275:2
kinematics: delta\n   |                                   | T274
#*# delta_radius      | #*# print_radius                  | T274
delta_radius =        | delta_radius = -                  | T275:27
162.000000            | 0                                 | T275:27
*rotation_distance: 40 | rotation_distance: forty         | T275:8 T275:13 T275:18
*rotation_distance: 40 | rotation_distance: -40           | T275:8 T275:13 T275:18
rotation_distance: 40 | rotation_distance: inf            | T275:8
rotation_distance: 40 | step_distance: 0                  | T275:8
microsteps: 16        | microsteps: 0                     | T275:7
microsteps: 16        | microsteps: 16.5                  | T275:7
microsteps: 16        | microsteps: 16\ngear_ratio: 80:0  | T275:8
microsteps: 16        | microsteps: 16\ngear_ratio: 5     | T275:8
height3_pos =         | height3_pos = 1,                  | T275:52
height3_pos =         | height3_pos = x,                  | T275:52
height3_pos = 30569   | height3_pos = 999999              | T277:52
height3_pos = 30569.961 | height3_pos = nan               | T275:52
height4_pos =         | height3_other =                   | T274
height3 = 0           | height3 = nan                     | T275:51
distance0 = 65        | distance0 = -65                   | T275:59
*arm_length = 345     | arm_length = 145                  | T276:31 T276:36 T276:41
*arm_length = 345     | rod_length = 345                  | T274
angle = 330           | angle = 210                       | T276:35
max_velocity: 300     | max_velocity 300                  | T270:3
";

/// Imports `printer.cfg`, which holds this text.
fn import(work: &Work, text: &str, more: &str) -> Ran {
    let _ = std::fs::remove_dir_all(work.path().join("out"));
    work.write("printer.cfg", text);
    work.run(&format!(
        "import klipper DIR/printer.cfg {more} --out DIR/out"
    ))
}

/// Files of the folder that is made of a configuration.
#[track_caller]
fn imported(work: &Work, text: &str) -> [String; 5] {
    import(work, text, "").done();
    [
        "printer.tau",
        "heights.csv",
        "distances.csv",
        "readings.csv",
        "robot.toml",
    ]
    .map(|name| work.read(&format!("out/{name}")))
}

/// The configuration with all options of the block by hand.
fn by_hand(printer: &Printer) -> String {
    let config = printer.config();
    let lines = config.lines().filter(|line| !line.contains("SAVE_CONFIG"));
    let lines = lines.filter(|line| !line.contains("DO NOT EDIT"));
    let lines = lines.map(|line| line.trim_start_matches("#*#").trim_start());
    lines.collect::<Vec<_>>().join("\n") + "\n"
}

#[test]
fn configurations_that_mean_the_same_are_read_the_same() {
    let (printer, _) = imagined();
    let work = Work::empty();
    let (config, text) = (printer.config(), by_hand(&printer));
    let expected = imported(&work, &config);
    let macro_like = "[gcode_macro X]\ngcode:\n  [printer]\n  delta_radius: 3\n[delta_calibrate]\n";
    let motor = |more: &str| config.replace("microsteps: 16", &format!("microsteps: {more}"));
    for (what, other) in [
        ("nothing saved", text.clone()),
        ("indented", text.replace('\n', "\n  ").replace("  [", "[")),
        (
            "a value below its name",
            text.replace("delta_radius = ", "delta_radius =\n   "),
        ),
        (
            "a macro that looks so",
            text.replace("[delta_calibrate]\n", macro_like),
        ),
        // Step lengths stand by themselves in old configurations; where both are stated the turn of the motor counts.
        (
            "old",
            text.replace(
                "microsteps: 16\nrotation_distance: 40",
                "step_distance: 0.0125",
            ),
        ),
        ("both", motor("16\nstep_distance: 0.02")),
        ("gears", motor("8\ngear_ratio: 4:1, 1:2")),
        ("full steps", motor("8\nfull_steps_per_rotation: 400")),
    ] {
        assert_eq!(imported(&work, &other), expected, "{what}");
    }
}

/// Each file stands where it is included: what comes later wins, and what is by hand over the block.
#[test]
fn includes_stand_at_their_lines() {
    let (printer, _) = imagined();
    let work = Work::empty();
    let text = by_hand(&printer);
    let expected = imported(&work, &text);
    for (name, radius) in [
        ("geo.cfg", "155"),
        ("conf/a.cfg", "162"),
        ("conf/b.cfg", "157"),
        ("conf/.hidden.cfg", "158"),
    ] {
        work.write(name, format!("[printer]\ndelta_radius: {radius}\n"));
    }
    for (text, radius) in [
        (format!("[include geo.cfg]\n{text}"), "162"),
        (format!("[include conf/*.cfg]\n{text}"), "162"),
        (format!("{text}[include geo.cfg]\n"), "155"),
        (format!("{text}[include conf/*.cfg]\n"), "157"),
        (format!("{text}[include conf/[!a].cfg] # c\n"), "157"),
        (
            format!("{text}[include conf/*.cfg]\n[include geo.cfg]\n"),
            "155",
        ),
        (format!("[include geo.cfg]\n{}", printer.config()), "155"),
    ] {
        let mut own = imported(&work, &text);
        let [known, changed] = ["162", radius].map(|own| format!("radius: length = {own} mm"));
        assert!(own[0].contains(&changed), "{text}");
        own[0] = own[0].replace(&changed, &known);
        assert_eq!(own, expected, "{text}");
    }
}

/// Files are known by their paths, and those that are not there are named.
#[test]
fn included_files_are_known_by_their_paths() {
    let work = Work::empty();
    for name in ["a", "b"] {
        work.write(&format!("{name}/geo.cfg"), "[fan]\npin: 1\n");
    }
    let includes = "[include a/geo.cfg]\n[include macros.cfg]\n[include m/*.cfg]\n";
    let text = includes.to_owned() + &imagined().0.config();
    let mut answers = Answers::default();
    let mut answer = |case, expected, more| {
        answers.ran(case, expected, &import(&work, &text, more));
    };
    answer("included", ["printer.cfg", "T273 T273"], "DIR/a/geo.cfg");
    answer("another of this name", ["geo.cfg", "T273"], "DIR/b/geo.cfg");
    insta::assert_snapshot!(answers.shown());
    assert!(!work.listing("").contains(&"out".to_owned()));
}

/// The firmware reads measurements up to the first number that is missing.
#[test]
fn measurements_that_are_not_read_are_named() {
    let work = Work::empty();
    let config = imagined().0.config();
    let text = config.replace("#*# height3 =", "#*# height_3 =");
    let text = text.replace("#*# distance11 =", "#*# distance =");
    let ran = import(&work, &text, "");
    for (file, rows) in [("heights", 3), ("distances", 11)] {
        assert_eq!(work.table(&format!("out/{file}.csv")).rows.len(), rows);
    }
    assert_eq!(ran.codes()[..2], ["T278", "T278"]);
    insta::assert_snapshot!(ran.err);
}

/// A caliper in inches, or distances in metres: told before anything is fitted; a distance that is 20 % off is not.
#[test]
fn distances_in_other_units_are_told() {
    let mut answers = Answers::default();
    for (case, unit_mm, expected) in [
        ("inches", 25.4, "T277:59"),
        ("metres", 1000.0, "T277:59"),
        ("a sixth too short", 1.2, "-"),
        ("far too long", 0.3, "-"),
    ] {
        let (mut printer, _) = imagined();
        for (distance, _) in &mut printer.distances {
            *distance /= unit_mm;
        }
        // One that was typed wrong does not hide the others.
        printer.distances[0].0 *= 30.0;
        let work = Work::empty();
        let ran = import(&work, &printer.config(), "");
        answers.ran(case, ["printer.cfg", expected], &ran);
        let is_written = work.listing("").contains(&"out".to_owned());
        assert_eq!(is_written, expected == "-", "{case}");
    }
    insta::assert_snapshot!(answers.shown());
}

#[test]
fn configurations_that_mean_nothing_are_refused() {
    let mut answers = Answers::default();
    let config = imagined().0.config();
    let work = Work::empty();
    for [old, new, expected] in cases(REFUSED) {
        let ran = import(&work, &replaced(&config, &old, &new), "");
        let case = format!("{} → {}", old.trim(), new.replace('\n', " "));
        answers.ran(&case, ["printer.cfg", &expected], &ran);
    }
    assert_eq!(work.listing(""), ["printer.cfg"]);
    insta::assert_snapshot!(answers.shown());
}
