//! Calibrations written back into the firmware's configuration, which an independent reader then takes as it would.

use tau_testkit::{Ran, Work};

use super::reader::as_read;
use super::{NAMES, imagined};
use crate::answers::{Answers, cases, replaced};

const EXPORT: &str = "export DIR/found.toml --model MEASURED/printer.tau --to klipper";

/// Case, a stretch of the configuration, and what stands in its place.
const WRITTEN: &str = r"
saved                        | [printer]                         | [printer]
by hand                      | [printer]\n                       | [printer]\ndelta_radius: 170\n
upper case                   | [printer]\n                       | [printer]\nDELTA_RADIUS = 170 ; nominal\n
first and indented           | [printer]\n                       | [printer]\n  delta_radius: 170\n
all indented                 | [printer]\nkinematics: delta\nmax | [printer]\n  delta_radius: 170\n  kinematics: delta\n  max
several lines                | [stepper_a]\n                     | [stepper_a]\nangle:\n  211\narm_length: 300\n
several lines in the block   | *#*# angle =                       | #*# angle =\n#*# \t
a macro that looks so        | [delta_calibrate]                 | [gcode_macro X]\ngcode:\n\n  ; c\n  delta_radius: 1\n[delta_calibrate]
other lines in the block     | #*# [delta_calibrate]             | #*# [mesh x]\n#*# points =\n#*# \t  0.1, 0.2\n#*# \t  0.3\n#*# k = 2\n#*# [delta_calibrate]
a section twice in the block | #*# [delta_calibrate]             | #*# [printer]\n#*# delta_radius = 3\n#*# max_accel = 77\n#*# [delta_calibrate]
the mark without a space     | [printer]                         | #*#SAVE_CONFIG later\n[printer]
";

/// Case, a stretch of the configuration, what stands in its place, and the answer.
const REFUSED: &str = r"
include     | [printer]         | [include geo.cfg]\n[printer]                      | T275@geo.cfg:2
includes    | [printer]         | [include g*.cfg]\n[printer]                       | T275@geo.cfg:2
circle      | [printer]         | [include loop.cfg]\n[printer]                     | T272@loop.cfg:1
other mark  | DO NOT EDIT       | DO NOT edit                                       | T271:23
mark above  | [printer]         | [mcu]\n#*# run SAVE_CONFIG afterwards\n[printer] | T271:2
no delta    | kinematics: delta | kinematics: corexy                                | T275:2
";

/// Section and option of a parameter in the firmware's file.
fn place(name: &str) -> (String, String) {
    let (section, key) = match name.split_once('_') {
        None => ("printer".to_owned(), "delta_radius"),
        Some((kind, tower)) => {
            let key = match kind {
                "angle" => "angle",
                "endstop" => "position_endstop",
                _ => "arm_length",
            };
            (format!("stepper_{tower}"), key)
        }
    };
    (section, key.to_owned())
}

/// The imagined printer's folder with its calibration, `found.toml`: not by a fit, but by a robot file that states other
/// values.
fn calibrated() -> Work {
    let (printer, truth) = imagined();
    let work = printer.imported();
    let mut text = work.read("measured/robot.toml");
    // The description holds angle c for exact.
    for (name, value) in NAMES.iter().zip(truth).filter(|own| *own.0 != "angle_c") {
        let value = if name.starts_with("angle") {
            value.to_radians()
        } else {
            value / 1000.0
        };
        text += &format!("\n[parameters.{name}]\nvalue = {value:?}\ntol = 0.001\n");
    }
    work.write("found.toml", text);
    work
}

/// Writes the calibration into `printer.cfg`, which holds this text, as `new.cfg`.
fn export(work: &Work, text: &str) -> Ran {
    let _ = std::fs::remove_file(work.path().join("new.cfg"));
    work.write("printer.cfg", text);
    work.run(&format!(
        "{EXPORT} --into DIR/printer.cfg --out DIR/new.cfg"
    ))
}

/// The firmware reads what was calibrated, and otherwise what it read before.
#[track_caller]
fn assert_written(work: &Work, what: &str) {
    let read = |name: &str| as_read(&work.path().join(name)).unwrap();
    let (mut before, mut after) = (read("printer.cfg"), read("new.cfg"));
    for (name, expected) in NAMES.iter().zip(imagined().1) {
        let place = place(name);
        before.remove(&place);
        let found: f64 = after.remove(&place).unwrap().trim().parse().unwrap();
        assert!((found - expected).abs() < 1e-6, "{what}: {name} {found}");
    }
    assert_eq!(before, after, "{what}");
}

#[test]
fn the_block_alone_stands_below_what_is_written_by_hand() {
    let work = calibrated();
    let alone = work.run(EXPORT).done();
    let config = imagined().0.config();
    let (by_hand, _) = config.split_once("\n#*#").unwrap();
    work.write("printer.cfg", by_hand);
    work.write("new.cfg", format!("{by_hand}\n{alone}"));
    assert_written(&work, "alone");
}

/// By hand the options would win: they become comments with all of their lines, however they are written.
#[test]
fn a_calibration_is_written_back_as_the_firmware_reads_it() {
    let work = calibrated();
    let config = imagined().0.config();
    let mut texts: Vec<(String, String)> = cases(WRITTEN)
        .into_iter()
        .map(|[what, old, new]| (what, replaced(&config, &old, &new.replace("\\t", "\t"))))
        .collect();
    let (by_hand, _) = config.split_once("\n#*#").unwrap();
    texts.extend([
        ("line ends".to_owned(), config.replace('\n', "\r\n")),
        ("nothing saved".to_owned(), by_hand.to_owned()),
    ]);
    for (what, text) in texts {
        export(&work, &text).done();
        assert_written(&work, &what);
    }
    // And the program reads it again.
    work.run("import klipper DIR/new.cfg --out DIR/again")
        .done();
}

/// Text in which the firmware would not read the block, or other values than those of the block: nothing is written.
#[test]
fn nothing_is_written_where_the_firmware_would_read_another_value() {
    let work = calibrated();
    let config = imagined().0.config();
    work.write("geo.cfg", "[stepper_b]\n  angle: 331\n");
    work.write("loop.cfg", "[include printer.cfg]\n");
    let mut answers = Answers::default();
    let mut answer = |case: &str, text: &str, expected: &str| {
        answers.ran(case, ["printer.cfg", expected], &export(&work, text));
        assert!(!work.listing("").contains(&"new.cfg".to_owned()), "{case}");
    };
    for [case, old, new, expected] in cases(REFUSED) {
        answer(&case, &replaced(&config, &old, &new), &expected);
    }
    let below = format!("{config}\n# a note\n[fan]\npin: PA1\n");
    answer("lines below the block", &below, "T271:96");
    answer("no section", "kinematics = \"delta\"\n", "T270:1");
    answer("no printer", "[robot]\nname = delta\n", "T274");
    answer("a table", "pose,q1_m\n1,2\n", "T270:1 T270:2");
    answer("nothing", "", "T274");
    insta::assert_snapshot!(answers.shown());
}

/// A file that is not there is named in a remark.
#[test]
fn includes_that_are_not_there_are_named() {
    let work = calibrated();
    let config = format!("[include other.cfg]\n{}", imagined().0.config());
    work.write("other.cfg", "[fan]\npin: PA1\n");
    assert!(!export(&work, &config).says("T273"));
    assert_written(&work, "an include of other sections");
    work.remove("other.cfg");
    let ran = export(&work, &config);
    assert_eq!((ran.code, ran.says("T273")), (0, true), "{}", ran.err);
}

/// Parameters that the firmware refuses.
#[test]
fn printers_that_can_not_be_are_not_exported() {
    let work = calibrated();
    let (config, found) = (imagined().0.config(), work.read("found.toml"));
    let mut answers = Answers::default();
    for (case, radius, expected) in [
        ("a radius below 0", "-0.1613", "T276"),
        ("no radius", "0.0", "T276"),
        ("a radius longer than a rod", "0.3449", "T252:9"),
    ] {
        work.write("found.toml", found.replace("0.1613", radius));
        let ran = export(&work, &config);
        answers.ran(case, ["found.toml", expected], &ran);
        assert!(!work.listing("").contains(&"new.cfg".to_owned()), "{case}");
    }
    insta::assert_snapshot!(answers.shown());
}

/// The firmware's towers are upright: with one that leans, its printer is not the calibrated one.
#[test]
fn a_machine_that_the_firmware_does_not_have_is_exported_by_force_alone() {
    let work = calibrated();
    let upright = work.run(EXPORT);
    assert_eq!(
        (upright.code, upright.codes().concat().as_str()),
        (0, "T279")
    );
    let description = work.read("measured/printer.tau");
    let (old, leaning) = ("(0, 0, -1) exact", "(0.01, 0, -1) exact");
    work.write(
        "measured/printer.tau",
        description.replacen(old, leaning, 1),
    );
    let ran = work.run(&format!("{EXPORT} --out DIR/new.cfg"));
    assert_eq!(ran.code, 1);
    ran.shows("T279");
    assert!(!work.listing("").contains(&"new.cfg".to_owned()));
    let forced = work.run(&format!("{EXPORT} --force"));
    assert_eq!((forced.code, forced.says("T279")), (0, true));
    assert_eq!(forced.out, upright.out);
}
