//! Calibrations written back into the firmware's configuration, which an independent reader then takes as it would.

use std::fs;
use std::path::Path;

use super::reader::{Options, as_read};
use super::{NAMES, imagined};
use crate::support::{Ran, tau_in};

/// Section and option of each parameter.
fn places() -> Vec<(String, String)> {
    let of = |section: &str, key: &str| (section.to_owned(), key.to_owned());
    let mut places = vec![of("printer", "delta_radius")];
    for key in ["angle", "position_endstop", "arm_length"] {
        places.extend(["a", "b", "c"].map(|tower| of(&format!("stepper_{tower}"), key)));
    }
    places
}

/// A printer and its folder, `DIR/printer`, calibrated: not by a fit, but by a robot file that states other values.
fn calibrated(folder: &Path) -> [f64; 10] {
    let (printer, truth) = imagined();
    printer.import(folder);
    let mut text = fs::read_to_string(folder.join("printer/robot.toml")).unwrap();
    // The description holds angle c for exact.
    for (name, value) in NAMES.iter().zip(truth).filter(|own| *own.0 != "angle_c") {
        let value = if name.starts_with("angle") {
            value.to_radians()
        } else {
            value / 1000.0
        };
        text += &format!("\n[parameters.{name}]\nvalue = {value:?}\ntol = 0.001\n");
    }
    fs::write(folder.join("found.toml"), text).unwrap();
    truth
}

fn export(folder: &Path) -> Ran {
    let _ = fs::remove_file(folder.join("new.cfg"));
    let line = "tau export DIR/found.toml --model DIR/printer/printer.tau --to klipper --into DIR/printer.cfg --out DIR/new.cfg";
    tau_in(folder, line)
}

/// The firmware reads what was calibrated, and otherwise what it read before.
#[track_caller]
fn assert_written(folder: &Path, truth: &[f64; 10], what: &str) {
    let (before, after): (Options, Options) = (
        as_read(&folder.join("printer.cfg")).unwrap(),
        as_read(&folder.join("new.cfg")).unwrap(),
    );
    let places = places();
    for (place, expected) in places.iter().zip(truth) {
        let found: f64 = after[place].trim().parse().unwrap();
        assert!((found - expected).abs() < 1e-6, "{what}: {place:?} {found}");
    }
    let others = |options: &Options| {
        let mut options = options.clone();
        options.retain(|place, _| !places.contains(place));
        options
    };
    assert_eq!(others(&before), others(&after), "{what}");
}

#[test]
fn the_block_alone_stands_below_what_is_written_by_hand() {
    let folder = tempfile::tempdir().unwrap();
    let truth = calibrated(folder.path());
    let line = "tau export DIR/found.toml --model DIR/printer/printer.tau --to klipper";
    let alone = tau_in(folder.path(), line).done();
    let config = imagined().0.config();
    let (by_hand, _) = config.split_once("\n#*#").unwrap();
    fs::write(folder.path().join("printer.cfg"), by_hand).unwrap();
    let whole = format!("{by_hand}\n{alone}");
    fs::write(folder.path().join("new.cfg"), whole).unwrap();
    assert_written(folder.path(), &truth, "alone");
}

/// By hand the options would win: they become comments with all of their lines, however they are written.
#[test]
fn a_calibration_is_written_back_as_the_firmware_reads_it() {
    let folder = tempfile::tempdir().unwrap();
    let truth = calibrated(folder.path());
    let config = imagined().0.config();
    let by_hand = |text: &str| config.replacen("[printer]\n", &format!("[printer]\n{text}"), 1);
    let of_tower =
        |text: &str| config.replacen("[stepper_a]\n", &format!("[stepper_a]\n{text}"), 1);
    let cases = [
        ("saved", config.clone()),
        ("by hand", by_hand("delta_radius: 170\n")),
        ("upper case", by_hand("DELTA_RADIUS = 170 ; nominal\n")),
        ("first and indented", by_hand("  delta_radius: 170\n")),
        (
            "all indented",
            by_hand("  delta_radius: 170\n")
                .replace("\nkinematics", "\n  kinematics")
                .replace("\nmax_velocity", "\n  max_velocity"),
        ),
        (
            "several lines",
            of_tower("angle:\n  211\narm_length: 300\n"),
        ),
        (
            "several lines in the block",
            config.replace("#*# angle = ", "#*# angle =\n#*# \t"),
        ),
        (
            "a macro that looks so",
            config.replacen(
                "[delta_calibrate]",
                "[gcode_macro X]\ngcode:\n\n  ; c\n  delta_radius: 1\n[delta_calibrate]",
                1,
            ),
        ),
        (
            "other lines in the block",
            config.clone()
                + "#*#\n#*# [bed_mesh default]\n#*# points =\n#*# \t  0.1, 0.2\n#*# \t  0.3, 0.4\n#*# tension = 0.2\n",
        ),
        (
            "a section twice in the block",
            config.clone() + "#*# [printer]\n#*# delta_radius = 3\n#*# max_accel = 77\n",
        ),
        ("line ends", config.replace('\n', "\r\n")),
        (
            "nothing saved",
            config.split_once("\n#*#").unwrap().0.to_owned(),
        ),
        (
            "the mark without a space",
            config.replacen("[printer]", "#*#SAVE_CONFIG later\n[printer]", 1),
        ),
    ];
    for (what, text) in cases {
        fs::write(folder.path().join("printer.cfg"), text).unwrap();
        export(folder.path()).done();
        assert_written(folder.path(), &truth, what);
    }
    let whole = fs::read_to_string(folder.path().join("new.cfg")).unwrap();
    assert!(whole.contains("max_velocity: 300  # mm/s"), "{whole}");
    // And the program reads it again.
    let line = "tau import klipper DIR/new.cfg --out DIR/again";
    tau_in(folder.path(), line).done();
}

/// Text in which the firmware would not read the block, or other values than those of the block: nothing is written.
#[test]
fn nothing_is_written_where_the_firmware_would_read_another_value() {
    let folder = tempfile::tempdir().unwrap();
    calibrated(folder.path());
    let config = imagined().0.config();
    fs::write(folder.path().join("geo.cfg"), "[stepper_b]\n  angle: 331\n").unwrap();
    fs::write(folder.path().join("loop.cfg"), "[include printer.cfg]\n").unwrap();
    let mut told = String::new();
    for text in [
        format!("[include geo.cfg]\n{config}"),
        format!("[include g*.cfg]\n{config}"),
        format!("[include loop.cfg]\n{config}"),
        config.replace("DO NOT EDIT", "DO NOT edit"),
        format!("[mcu]\n#*# run SAVE_CONFIG afterwards\n{config}"),
        format!("{config}\n# a note\n[fan]\npin: PA1\n"),
        config.replace("kinematics: delta", "kinematics: corexy"),
        "kinematics = \"delta\"\n".to_owned(),
        "[robot]\nname = delta\n".to_owned(),
        "pose,q1_m\n1,2\n".to_owned(),
        String::new(),
    ] {
        fs::write(folder.path().join("printer.cfg"), &text).unwrap();
        let ran = export(folder.path());
        assert_eq!(ran.code, 2, "{text}");
        assert!(!folder.path().join("new.cfg").exists(), "{text}");
        told += &ran.err.replace(&folder.path().display().to_string(), "DIR");
        told += "\n";
    }
    insta::assert_snapshot!(told);
}

/// A file that is not there is named in a remark.
#[test]
fn includes_that_are_not_there_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let truth = calibrated(folder.path());
    let config = format!("[include other.cfg]\n{}", imagined().0.config());
    fs::write(folder.path().join("other.cfg"), "[fan]\npin: PA1\n").unwrap();
    fs::write(folder.path().join("printer.cfg"), &config).unwrap();
    let ran = export(folder.path());
    assert!(!ran.err.contains("other.cfg"), "{}", ran.err);
    assert_written(folder.path(), &truth, "an include of other sections");
    fs::remove_file(folder.path().join("other.cfg")).unwrap();
    let ran = export(folder.path());
    assert_eq!(ran.code, 0);
    assert!(
        ran.err
            .contains("printer.cfg:1: `other.cfg` (no such file) is included"),
        "{}",
        ran.err
    );
}

/// Parameters that the firmware refuses.
#[test]
fn printers_that_can_not_be_are_not_exported() {
    let folder = tempfile::tempdir().unwrap();
    calibrated(folder.path());
    fs::write(folder.path().join("printer.cfg"), imagined().0.config()).unwrap();
    let path = folder.path().join("found.toml");
    let found = fs::read_to_string(&path).unwrap();
    for (value, why) in [
        (
            "-0.1613",
            "found parameter `radius` of -161.3 mm, expected one above 0",
        ),
        (
            "0.0",
            "found parameter `radius` of 0 mm, expected one above 0",
        ),
        (
            "0.3449",
            "is not a finite number at the values of `endstop_a`, `arm_a`, `radius`",
        ),
    ] {
        fs::write(&path, found.replace("0.1613", value)).unwrap();
        let ran = export(folder.path());
        assert_eq!(ran.code, 2, "{value}");
        assert!(ran.err.contains(why), "{value}: {}", ran.err);
        assert!(!folder.path().join("new.cfg").exists(), "{value}");
    }
}
