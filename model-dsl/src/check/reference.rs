//! The pose at which the machine stands at some commands.

use super::parts::Geometry;
use super::quantity::{angles, metres, values};
use crate::diagnostics::{Diagnostics, Location};
use crate::model::Reference;
use crate::plausible::{FARTHEST_M, LONGEST_M};
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
        error!(diagnostics, SAID_TWICE, second.location;
            "a second `reference`, but one pose settles how the arm is assembled"; "leave out one of them");
    }
    let mut reference = Reference {
        commands: vec![0.0; geometry.drives.as_ref().map_or(0, Vec::len)],
        position: [0.0; 3],
        orientation: [0.0; 3],
    };
    for (index, (name, given)) in first.values.iter().enumerate() {
        if first.values[..index]
            .iter()
            .any(|(earlier, _)| earlier == name)
        {
            error!(diagnostics, SAID_TWICE, name; "`{name}` of the reference is given twice"; "leave out one of them");
            continue;
        }
        let what = format!("`{name}`");
        let Some(location) = whole(given) else {
            continue;
        };
        if name == "commands" {
            if let Some(numbers) = commands(given, location, geometry, diagnostics) {
                reference.commands = numbers;
            }
            continue;
        }
        let is_position = name == "position";
        let dimension = if is_position {
            Dimension::LENGTH
        } else {
            Dimension::ANGLE
        };
        let Some((quantity, numbers)) = given.first().and_then(|given| {
            let numbers = values(given, Some(dimension), &what, diagnostics)?;
            Some((given, numbers))
        }) else {
            continue;
        };
        let Ok(numbers) = <[f64; 3]>::try_from(numbers.as_slice()) else {
            let help = match (is_position, geometry.plate.is_in_plane()) {
                (true, false) => "write `(x, y, z)`",
                (true, true) => "write `(x, y, 0)`",
                (false, false) => "write the ZYZ Euler angles `(alpha, beta, gamma)`",
                (false, true) => "write the turn about z as `(angle, 0, 0)`",
            };
            error!(diagnostics, REFERENCE_INCOMPLETE, location; "{what} must be 3 numbers, found {}", numbers.len();
                "{help}");
            continue;
        };
        let plate = geometry.plate;
        let wrong = match is_position {
            false if plate.is_point() => Some("leave it out: a point has no orientation"),
            false if plate.is_in_plane() && numbers[1] != 0.0 => {
                Some("in the plane beta is zero: write the turn about z as `(angle, 0, 0)`")
            }
            true if plate.is_in_plane() && numbers[2] != 0.0 => {
                Some("the plane is z = 0: write `(x, y, 0)`, and heights into the links' joints")
            }
            _ => None,
        };
        if let Some(help) = wrong {
            let written = plate.written();
            error!(diagnostics, REFERENCE_UNFIT, location; "{what} does not fit a plate that is a {written}"; "{help}");
        } else if is_position {
            metres(quantity, &numbers, FARTHEST_M, diagnostics);
            reference.position = numbers;
        } else {
            let describe = |angle: f64| format!("the angle {angle}");
            angles(quantity, &numbers, describe, diagnostics);
            reference.orientation = numbers;
        }
    }
    if !first.values.iter().any(|(name, _)| name == "position") {
        let height = if geometry.plate.is_in_plane() {
            "0"
        } else {
            "z"
        };
        error!(diagnostics, REFERENCE_INCOMPLETE, first.location; "the reference lacks `position`";
            "write where the TCP stands at these commands: `position = (x, y, {height}) m;`");
    }
    Some(reference)
}

/// The place of several quantities.
fn whole(given: &[syntax::Quantity]) -> Option<Location> {
    let (first, last) = given.first().zip(given.last())?;
    Some(first.location.to(last.location))
}

/// A number for each drive, lengths in m and angles in rad: those of cranks, which do not go round, are of one turn.
fn commands(
    given: &[syntax::Quantity],
    location: Location,
    geometry: &Geometry,
    diagnostics: &mut Diagnostics,
) -> Option<Vec<f64>> {
    let drives = geometry.drives.as_ref()?;
    let found: usize = given.iter().map(|one| one.numbers.len()).sum();
    if found != drives.len() {
        let expected = drives.len();
        error!(diagnostics, REFERENCE_INCOMPLETE, location; "`commands` must be {expected} numbers, found {found}";
            "one for each track or crank, then one for each driven link");
        return None;
    }
    let mut numbers = Vec::new();
    for one in given {
        let own = drives.get(numbers.len()..numbers.len() + one.numbers.len())?;
        let is_angle = own.first()?.is_angle;
        if let Some(other) = own.iter().find(|drive| drive.is_angle != is_angle) {
            let kind = |is_angle: bool| if is_angle { "an angle" } else { "a length" };
            error!(diagnostics, REFERENCE_UNFIT, location;
                "one unit for all commands, but that of `{}` is {} and that of `{}` {}",
                    own.first()?.name, kind(is_angle), other.name, kind(other.is_angle);
                "give each command its unit: `(0.1 m, 0.2 rad)`");
            return None;
        }
        let dimension = if is_angle {
            Dimension::ANGLE
        } else {
            Dimension::LENGTH
        };
        let first = numbers.len();
        let own = values(one, Some(dimension), "`commands`", diagnostics)?;
        if is_angle {
            let is_crank = |k: &usize| geometry.tracks.get(first + k).is_some();
            let cranks: Vec<f64> = (0..own.len()).filter(is_crank).map(|k| own[k]).collect();
            let describe = |angle: f64| format!("the command {angle} of a crank");
            angles(one, &cranks, describe, diagnostics);
        } else {
            metres(one, &own, LONGEST_M, diagnostics);
        }
        numbers.extend(own);
    }
    Some(numbers)
}
