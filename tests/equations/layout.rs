//! The arm in space, as it is drawn: against the equations of its links, which know nothing of the drawing.

use std::fs;

use nalgebra::Vector3;
use tau::calibration::calibrate;
use tau::kinematics::{Layout, Machine, Pose, Sample};
use tau::measurements::{Poses, Split};
use tau::robot_file::RobotFile;
use tau::study;
use tau::{Robot, calibration};

use crate::support::{ROBOTS, gantry_tau, prototype};
use tau::Setup;

fn distance([a, b]: [[f64; 3]; 2]) -> f64 {
    (Vector3::from(a) - Vector3::from(b)).norm()
}

/// Lengths of the links by a parameter of the variant.
fn length(machine: &Machine, name: &str) -> f64 {
    let name = format!("{name}.length");
    machine.values[machine.variant.index_of(&name)]
}

/// Where closures are fulfilled, every link that is drawn is as long as its length, and as its command where that drives
/// it.
fn is_closed(machine: &Machine, layout: &Layout, commands_m: &[f64], tolerance: f64) {
    assert_eq!(layout.links.len(), machine.closure_count());
    for link in &layout.links {
        let driven = link.driven_by.map_or(0.0, |command| commands_m[command]);
        let expected = length(machine, &link.name) + driven;
        let found = distance(link.ends_m);
        assert!(
            (found - expected).abs() < tolerance,
            "{}: {found} {expected}",
            link.name
        );
    }
}

#[test]
fn links_reach_from_joint_to_joint_on_every_standard_robot() {
    let robots = [
        ("four_track", 0.004),
        ("hexaglide", -0.004),
        ("linear_delta", 0.04),
        ("stewart", 0.01),
    ];
    for (name, step) in robots {
        let text = fs::read_to_string(format!("{ROBOTS}/{name}.tau")).unwrap();
        // No measured path is at hand.
        let text = text.replace("track north piecewise per link;", "");
        let robot = Robot::from_text(&text).unwrap();
        let file = format!(
            "robot = \"{}\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n",
            robot.name
        );
        let file = RobotFile::parse_for(&file, "robot.toml", &robot).unwrap();
        let variant = robot.variant("Full").unwrap();
        let machine = calibration::machine_from_file(&robot, variant, &file, None, &[]).unwrap();
        let reference = machine.surroundings.reference.clone().unwrap();
        let commands: Vec<f64> = (reference.commands_m.iter().enumerate())
            .map(|(k, command_m)| command_m + step * (k as f64 - 1.0))
            .collect();
        let start = Pose::from_zyz(reference.position_m, reference.orientation_rad);
        let found = machine.forward(&Sample::new(start, &commands));
        let pose = found.unwrap_or_else(|error| panic!("{name}: {error}"));
        let ranges = vec![(-0.1, 0.2); robot.commands];
        let layout = machine.layout(&pose, &commands, &ranges);
        is_closed(&machine, &layout, &commands, 1e-9);
        assert_eq!(layout.tracks.len(), robot.tracks.len());
        assert_eq!(layout.base_m.is_empty(), !robot.tracks.is_empty(), "{name}");
        for rail in &layout.tracks {
            // The cart is on its track.
            let [a, b] = [rail.line_m[0], rail.line_m[1]];
            let detour = distance([a, rail.cart_m]) + distance([rail.cart_m, b]) - distance([a, b]);
            assert!(detour.abs() < 1e-9, "{name} {}", rail.name);
        }
    }
}

#[test]
fn a_calibrated_machine_is_drawn_as_it_was_measured() {
    let (folder, file) = prototype();
    let robot = gantry_tau();
    let poses = Poses::select(&robot, &file, &folder, Split::default()).unwrap();
    let used = &poses.division.calibration;
    for name in ["Nominal", "Full", "FullPiecewise"] {
        let variant = robot.variant(name).unwrap();
        let options = calibration::Options::default();
        let found = calibrate(Setup::new(&robot, variant, &file, &folder), used, &options).unwrap();
        let layout = study::layout(&found, &folder).unwrap();
        let reference = found.file.reference.as_ref().unwrap();
        // The reference is rounded to a tenth of a millimetre and of a milliradian.
        is_closed(&found.machine, &layout, &reference.commands_m, 3e-4);
        assert_eq!(layout.plate_m.is_empty(), name == "Nominal");
        let points = layout.tracks.iter().map(|rail| rail.line_m.len());
        assert!(
            points
                .into_iter()
                .all(|count| (count > 2) == (name == "FullPiecewise"))
        );
    }
}
