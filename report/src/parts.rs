//! Names of the parts of a machine, by its drives and its plate.

use tau::robot::Architecture;
use tau::sensitivity::Sensitivity;

use super::discovery::listed;
use super::number::general;

const AXES: [&str; 3] = ["x", "y", "z"];

/// Part that carries the joint of a link opposite to the plate.
pub(super) fn carrier(of: Architecture) -> &'static str {
    match (of.carts > 0, of.cranks > 0) {
        (true, false) => "cart",
        (false, true) => "crank",
        (true, true) => "cart or crank",
        (false, false) => "base",
    }
}

/// Heading of the coordinates of that joint.
pub(super) fn joint_heading(of: Architecture) -> &'static str {
    match (of.carts > 0, of.cranks > 0) {
        (true, false) => "Track offset C⁰ (m)",
        (false, true) => "Crank joint C⁰ (m)",
        (true, true) => "Joint on cart or crank C⁰ (m)",
        (false, false) => "Base joint C (m)",
    }
}

/// Meaning of the letters by which tables of sensitivities call parameters; `None` where they have none.
pub(super) fn letters(sensitivity: &Sensitivity, of: Architecture) -> Option<String> {
    let parameters = sensitivity.parameters();
    let joint = match (of.carts > 0, of.cranks > 0) {
        (true, false) => "C: track offset".to_owned(),
        (false, false) => "C: joint on the base".to_owned(),
        _ => format!("C: joint on the {} at q = 0", carrier(of)),
    };
    let direction = "O: direction of a linear track or rotation of a piecewise one";
    let letters = [
        ("L", "L: length"),
        ("P", "P: plate joint"),
        ("Offset", &joint),
        ("Orient", direction),
    ];
    let meant: Vec<&str> = letters
        .into_iter()
        .filter(|(start, _)| parameters.iter().any(|own| own.starts_with(start)))
        .map(|(_, meaning)| meaning)
        .collect();
    (!meant.is_empty()).then(|| format!("{}.", meant.join("; ")))
}

/// The components about the axes about which the plate turns.
pub(super) fn turning<T: Copy>(of: Architecture, about_xyz: [T; 3]) -> Vec<T> {
    let axes = of.plate.turning_axes().iter();
    axes.map(|&axis| about_xyz[axis]).collect()
}

/// Angles (mrad) about the axes about which the plate turns, with their unit and the names of the axes.
pub(super) fn about_axes(axes: &[usize], angles_mrad: &[f64], digits: i32) -> String {
    let angles: Vec<String> = angles_mrad
        .iter()
        .map(|&angle| general(angle, digits))
        .collect();
    let names: Vec<&str> = axes.iter().map(|&axis| AXES[axis]).collect();
    format!("{} mrad about {}", listed(&angles), listed(&names))
}
