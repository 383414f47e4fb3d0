//! The arm in space, as it is drawn: against the equations of its links, which know nothing of the drawing.

use nalgebra::Vector3;
use tau::Setup;
use tau::calibration::{Options, calibrate};
use tau::kinematics::{Layout, Machine, Pose, Sample};
use tau::measurements::{Poses, Split};
use tau_testkit::robots;

use crate::kinematics::machine_of;

fn distance([a, b]: [[f64; 3]; 2]) -> f64 {
    (Vector3::from(a) - Vector3::from(b)).norm()
}

/// Where closures are fulfilled, every link that is drawn is as long as its length, and as its command where that drives
/// it.
fn is_closed(machine: &Machine, layout: &Layout, commands_m: &[f64], tolerance_m: f64) {
    assert_eq!(layout.links.len(), machine.closure_count());
    for link in &layout.links {
        let index = machine.variant.index_of(&format!("{}.length", link.name));
        let driven = link.driven_by.map_or(0.0, |command| commands_m[command]);
        let off = machine.values[index] + driven - distance(link.ends_m);
        assert!(off.abs() < tolerance_m, "{}: {off}", link.name);
    }
}

#[test]
fn links_reach_from_joint_to_joint_on_robots_of_every_layout() {
    let robots = [
        ("four_track", 0.004),
        ("hexaglide", -0.004),
        ("hexapod", 0.01),
        ("eight_carts", 0.0),
    ];
    for (name, step) in robots {
        // No measured path is at hand.
        let text = robots::named(name).description;
        let text = text.replace("track north piecewise per link;", "");
        let machine = machine_of(&robots::described(&text), "Full");
        let reference = machine.surroundings.reference.clone().unwrap();
        let moved = reference.commands_m.iter().enumerate();
        let moved = moved.map(|(k, command_m)| command_m + step * (k as f64 - 1.0));
        let commands: Vec<f64> = moved.collect();
        let start = Pose::from_zyz(reference.position_m, reference.orientation_rad);
        let pose = machine.forward(&Sample::new(start, &commands)).unwrap();
        let layout = machine.layout(&pose, &commands, &vec![(-0.1, 0.2); commands.len()]);
        is_closed(&machine, &layout, &commands, 1e-9);
        assert_eq!(layout.tracks.len(), machine.robot.tracks.len());
        assert_eq!(layout.base_m.is_empty(), !layout.tracks.is_empty());
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
    let (folder, file) = robots::prototype();
    let robot = robots::gantry_tau();
    let poses = Poses::select(&robot, &file, &folder, Split::default()).unwrap();
    let used = &poses.division.calibration;
    for name in ["Nominal", "FullPiecewise"] {
        let setup = Setup::new(&robot, robot.variant(name).unwrap(), &file, &folder);
        let found = calibrate(setup, used, &Options::default()).unwrap();
        let layout = tau::study::layout(&found, &folder).unwrap();
        let reference = found.file.reference.as_ref().unwrap();
        // The reference is rounded to a tenth of a millimetre and of a milliradian.
        is_closed(&found.machine, &layout, &reference.commands_m, 3e-4);
        let is_full = name == "FullPiecewise";
        assert_eq!(layout.plate_m.is_empty(), !is_full);
        let mut rails = layout.tracks.iter();
        assert!(rails.all(|rail| (rail.line_m.len() > 2) == is_full));
    }
}
