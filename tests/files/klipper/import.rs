//! Configurations as they are written, read as the firmware takes them, or refused.

use std::fs;
use std::path::Path;

use super::{Printer, imagined};
use crate::support::{Ran, tau_in};

fn import(folder: &Path, more: &str) -> Ran {
    let _ = fs::remove_dir_all(folder.join("out"));
    let line = format!("tau import klipper DIR/printer.cfg {more} --out DIR/out");
    tau_in(folder, &line)
}

/// Files of the folder that is made of a configuration.
#[track_caller]
fn imported(folder: &Path, text: &str) -> Vec<String> {
    fs::write(folder.join("printer.cfg"), text).unwrap();
    import(folder, "").done();
    let names = [
        "printer.tau",
        "heights.csv",
        "distances.csv",
        "readings.csv",
    ];
    let of = |name| fs::read_to_string(folder.join("out").join(name)).unwrap();
    names.map(of).into()
}

/// The configuration with all options of the block by hand.
fn by_hand(printer: &Printer) -> String {
    let config = printer.config();
    let lines = config.lines().filter(|line| !line.contains("SAVE_CONFIG"));
    let lines = lines.filter(|line| !line.contains("DO NOT EDIT"));
    let lines: Vec<&str> = lines
        .map(|line| line.trim_start_matches("#*#").trim_start())
        .collect();
    lines.join("\n") + "\n"
}

#[test]
fn options_are_read_however_they_are_indented() {
    let (printer, _) = imagined();
    let folder = tempfile::tempdir().unwrap();
    let expected = imported(folder.path(), &printer.config());
    let text = by_hand(&printer);
    let deeper: Vec<String> = (text.lines())
        .map(|line| {
            if line.starts_with('[') {
                line.to_owned()
            } else {
                format!("  {line}")
            }
        })
        .collect();
    assert_eq!(imported(folder.path(), &deeper.join("\n")), expected);
    // Lines that go on: a value below its name, and a macro whose lines look like options.
    let goes_on = text
        .replace("delta_radius = ", "delta_radius =\n   ")
        .replace(
            "[delta_calibrate]\n",
            "[gcode_macro X]\ngcode:\n  [printer]\n  delta_radius: 3\n[delta_calibrate]\n",
        );
    assert_eq!(imported(folder.path(), &goes_on), expected);
}

/// Each file stands where it is included: what comes later wins.
#[test]
fn includes_stand_at_their_lines() {
    let (printer, _) = imagined();
    let folder = tempfile::tempdir().unwrap();
    let text = by_hand(&printer);
    let expected = imported(folder.path(), &text);
    let write = |name: &str, radius: &str| {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, format!("[printer]\ndelta_radius: {radius}\n")).unwrap();
    };
    write("geo.cfg", "155");
    write("conf/a.cfg", "162");
    write("conf/b.cfg", "157");
    write("conf/.hidden.cfg", "158");
    assert_eq!(
        imported(folder.path(), &format!("[include geo.cfg]\n{text}")),
        expected
    );
    assert_eq!(
        imported(folder.path(), &format!("[include conf/*.cfg]\n{text}")),
        expected
    );
    let of_file = |radius: &str| {
        let mut own = expected.clone();
        own[0] = own[0].replace(
            "radius: length = 162 mm",
            &format!("radius: length = {radius} mm"),
        );
        assert_ne!(own[0], expected[0]);
        own
    };
    for (include, radius) in [
        ("[include geo.cfg]", "155"),
        ("[include conf/*.cfg]", "157"),
        ("[include conf/[!a].cfg] # c", "157"),
        ("[include conf/*.cfg]\n[include geo.cfg]", "155"),
    ] {
        assert_eq!(
            imported(folder.path(), &format!("{text}{include}\n")),
            of_file(radius),
            "{include}"
        );
    }
    // By hand in an include it wins over the block, too.
    let saved = format!("[include geo.cfg]\n{}", printer.config());
    let own = imported(folder.path(), &saved);
    assert!(own[0].contains("radius: length = 155 mm"), "{}", own[0]);
}

/// Files are known by their paths, and those that are not there are named.
#[test]
fn included_files_are_known_by_their_paths() {
    let (printer, _) = imagined();
    let folder = tempfile::tempdir().unwrap();
    for name in ["a", "b"] {
        fs::create_dir_all(folder.path().join(name)).unwrap();
        fs::write(folder.path().join(name).join("geo.cfg"), "[fan]\npin: 1\n").unwrap();
    }
    let text = format!(
        "[include a/geo.cfg]\n[include macros.cfg]\n[include m/*.cfg]\n{}",
        printer.config()
    );
    fs::write(folder.path().join("printer.cfg"), text).unwrap();
    let ran = import(folder.path(), "DIR/a/geo.cfg");
    assert_eq!(ran.code, 0, "{}", ran.err);
    for says in [
        "printer.cfg:2: `macros.cfg` (no such file) is included, but was not read",
        "printer.cfg:3: `m/*.cfg` (no file matches) is included, but was not read",
    ] {
        assert!(ran.err.contains(says), "{}", ran.err);
    }
    assert!(!ran.err.contains("geo.cfg"), "{}", ran.err);
    let ran = import(folder.path(), "DIR/b/geo.cfg");
    assert_eq!(ran.code, 2);
    assert!(
        ran.err.contains("printer.cfg does not include this file"),
        "{}",
        ran.err
    );
    assert!(!folder.path().join("out").exists());
}

/// The firmware reads measurements up to the first number that is missing.
#[test]
fn measurements_that_are_not_read_are_named() {
    let (printer, _) = imagined();
    let folder = tempfile::tempdir().unwrap();
    let text = printer
        .config()
        .replace("#*# height3 =", "#*# height_3 =")
        .replace("#*# distance11 =", "#*# distance =");
    fs::write(folder.path().join("printer.cfg"), &text).unwrap();
    let ran = import(folder.path(), "");
    assert!(ran.out.contains("3 heights, 11 distances"), "{}", ran.out);
    let line = 1 + text
        .lines()
        .position(|line| line.contains("height3_pos"))
        .unwrap();
    let says = format!(
        "printer.cfg:{line}: without a value of `height3` the firmware does not read `height3`, `height4`, `height5`, \
         `height6`, which took no part"
    );
    assert!(ran.err.contains(&says), "{}", ran.err);
    assert!(
        ran.err.contains("without a value of `distance11`"),
        "{}",
        ran.err
    );
}

/// Where both are stated the turn of the motor counts.
#[test]
fn turns_of_motors_win_over_steps() {
    let (printer, _) = imagined();
    let folder = tempfile::tempdir().unwrap();
    let expected = imported(folder.path(), &printer.config());
    for (from, to) in [
        ("microsteps: 16", "microsteps: 16\nstep_distance: 0.02"),
        ("microsteps: 16", "microsteps: 8\ngear_ratio: 4:1, 1:2"),
        (
            "microsteps: 16",
            "microsteps: 8\nfull_steps_per_rotation: 400",
        ),
    ] {
        let text = printer.config().replace(from, to);
        assert_eq!(imported(folder.path(), &text), expected, "{to}");
    }
}

/// A caliper in inches, or distances in metres: told before anything is fitted; a distance that is 20 % off is not.
#[test]
fn distances_in_other_units_are_told() {
    let (printer, _) = imagined();
    let folder = tempfile::tempdir().unwrap();
    for (unit_mm, says) in [
        (25.4, Some("in inches, expected millimetres")),
        (1000.0, Some("in metres, expected millimetres")),
        (1.2, None),
        (0.3, None),
    ] {
        let mut own = printer.clone();
        for (distance, _) in &mut own.distances {
            *distance /= unit_mm;
        }
        // One that was typed wrong does not hide the others.
        own.distances[0].0 *= 30.0;
        let text = own.config();
        fs::write(folder.path().join("printer.cfg"), &text).unwrap();
        let ran = import(folder.path(), "");
        assert_eq!(ran.code == 2, says.is_some(), "{unit_mm}: {}", ran.err);
        let line = 1 + text
            .lines()
            .position(|line| line.contains("distance0 ="))
            .unwrap();
        if let Some(says) = says {
            assert!(ran.err.contains(says), "{}", ran.err);
            assert!(
                ran.err.contains(&format!("printer.cfg:{line}:17")),
                "{}",
                ran.err
            );
            assert!(!folder.path().join("out").exists());
        }
    }
}

/// A change that the firmware refuses, or by which it would read other measurements.
fn refused(printer: &Printer) -> Vec<(String, String)> {
    let first = printer.distances[0].0;
    let step = format!("{:.3}", printer.heights[3].1[0]);
    let pairs = [
        ("kinematics: delta", "kinematics: corexy"),
        ("kinematics: delta\n", ""),
        ("#*# delta_radius", "#*# print_radius"),
        ("#*# delta_radius = ", "#*# delta_radius = -"),
        ("delta_radius = 162.000000", "delta_radius = 0"),
        ("rotation_distance: 40", "rotation_distance: forty"),
        ("rotation_distance: 40", "rotation_distance: -40"),
        ("rotation_distance: 40", "rotation_distance: inf"),
        ("rotation_distance: 40", "step_distance: 0"),
        ("microsteps: 16", "microsteps: 0"),
        ("microsteps: 16", "microsteps: 16.5"),
        ("microsteps: 16", "microsteps: 16\ngear_ratio: 80:0"),
        ("microsteps: 16", "microsteps: 16\ngear_ratio: 5"),
        ("height3_pos = ", "height3_pos = 1,"),
        ("height3_pos = ", "height3_pos = x,"),
        ("height4_pos = ", "height3_other = "),
        ("height3 = 0", "height3 = nan"),
        ("arm_length = 345", "arm_length = 145"),
        ("arm_length = 345", "rod_length = 345"),
        ("angle = 330", "angle = 210"),
        ("max_velocity: 300", "max_velocity 300"),
    ];
    let mut pairs: Vec<(String, String)> = (pairs.iter())
        .map(|(from, to)| ((*from).to_owned(), (*to).to_owned()))
        .collect();
    pairs.extend([
        (
            format!("distance0 = {first}"),
            format!("distance0 = -{first}"),
        ),
        (
            format!("height3_pos = {step}"),
            "height3_pos = nan".to_owned(),
        ),
        (
            format!("height3_pos = {step}"),
            "height3_pos = 999999".to_owned(),
        ),
    ]);
    pairs
}

#[test]
fn configurations_that_mean_nothing_are_refused() {
    let (printer, _) = imagined();
    let config = printer.config();
    let folder = tempfile::tempdir().unwrap();
    let mut told = String::new();
    for (from, to) in refused(&printer) {
        assert!(config.contains(&from), "{from}");
        let text = config.replace(&from, &to);
        fs::write(folder.path().join("printer.cfg"), text).unwrap();
        let ran = import(folder.path(), "");
        assert_eq!(ran.code, 2, "{to}");
        assert!(!folder.path().join("out").exists(), "{to}");
        told += &ran.err.replace(&folder.path().display().to_string(), "DIR");
        told += "\n";
    }
    insta::assert_snapshot!(told);
}
