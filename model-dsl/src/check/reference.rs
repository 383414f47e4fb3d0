//! The pose at which the machine stands at some commands.

use super::Declared;
use super::quantity::values;
use super::robot::Geometry;
use crate::diagnostics::Diagnostics;
use crate::model::Reference;
use crate::syntax;
use crate::units::Dimension;

/// The reference of a robot, where it declares one; commands and orientation that are left out are zero.
pub(super) fn reference(
    robot: &syntax::Robot,
    geometry: &Geometry,
    diagnostics: &mut Diagnostics,
) -> Option<Reference> {
    let [first, more @ ..] = &robot.references[..] else {
        return None;
    };
    for second in more {
        let message = "a second `reference`, but one pose settles how the arm is assembled";
        diagnostics.error(second.location, message, "leave out one of them");
    }
    let driven = geometry
        .links
        .iter()
        .filter(|link| link.actuated_by.is_some());
    let count = geometry.tracks.len() + driven.count();
    let mut reference = Reference {
        commands: vec![0.0; count],
        position: [0.0; 3],
        orientation: [0.0; 3],
    };
    let mut names = Declared::default();
    for (name, given) in &first.values {
        names.declare(name, "part of the reference", diagnostics);
        let what = format!("`{name}`");
        let (dimension, expected) = match name.to_string().as_str() {
            "commands" => (Dimension::LENGTH, count),
            "position" => (Dimension::LENGTH, 3),
            _ => (Dimension::ANGLE, 3),
        };
        let Some(numbers) = values(given, Some(dimension), &what, diagnostics) else {
            continue;
        };
        if numbers.len() != expected {
            let message = format!("{what} must be {expected} numbers, found {}", numbers.len());
            let help = match name.to_string().as_str() {
                "commands" => "one for each track, then one for each link of `actuated length`",
                "position" => "write `(x, y, z)`",
                _ => "write the ZYZ Euler angles `(alpha, beta, gamma)`",
            };
            diagnostics.error(given.location, message, help);
            continue;
        }
        let plate = geometry.plate;
        let wrong = match name.to_string().as_str() {
            "orientation" if plate.is_point() => Some("leave it out: a point has no orientation"),
            "orientation" if plate.is_in_plane() && numbers[1] != 0.0 => {
                Some("in the plane beta is zero: write the turn about z as `(angle, 0, 0)`")
            }
            "position" if plate.is_in_plane() && numbers[2] != 0.0 => {
                Some("the plane is z = 0: write `(x, y, 0)`, and heights into the links' joints")
            }
            _ => None,
        };
        if let Some(help) = wrong {
            let message = format!("{what} does not fit a plate that is a {}", plate.written());
            diagnostics.error(given.location, message, help);
            continue;
        }
        let slot = match name.to_string().as_str() {
            "commands" => &mut reference.commands[..],
            "position" => &mut reference.position[..],
            _ => &mut reference.orientation[..],
        };
        slot.copy_from_slice(&numbers);
    }
    if !first.values.iter().any(|(name, _)| name == "position") {
        diagnostics.error(
            first.location,
            "the reference lacks `position`",
            "write where the TCP stands at these commands: `position = (x, y, z) m;`",
        );
    }
    Some(reference)
}
