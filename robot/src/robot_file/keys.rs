//! Keys of a `robot.toml`: which parameter of a robot each value is, and what the robot's description gives.

use std::ops::Range;

use tau_codegen::language;
pub use tau_model_dsl::plausible::WIDE;
use toml::de::DeTable;

use super::{LinkValues, Reference, RobotFile, Value};
use crate::robot::{Parameter, Robot};

impl RobotFile {
    /// The file with what it lacks taken from the robot's description: values of links, and where the machine stands.
    #[must_use]
    pub fn completed(&self, robot: &Robot) -> Self {
        let mut completed = self.clone();
        for (link, described) in robot.links.iter().zip(described_links(robot)) {
            let values = completed.links.entry(link.name.clone()).or_default();
            for quantity in [
                "length",
                "plate_joint",
                "track_offset",
                "track_direction",
                "pull",
            ] {
                if let Some(slot) = quantity_slot(values, quantity)
                    && slot.is_none()
                {
                    *slot = quantity_of(&described, quantity).cloned();
                }
            }
            if *values == LinkValues::default() {
                completed.links.remove(&link.name);
            }
        }
        if completed.reference.is_none() {
            completed.reference = described_reference(robot);
        }
        completed
    }
}

/// Values that the description itself gives, by link.
pub(crate) fn described_links(robot: &Robot) -> Vec<LinkValues> {
    let value = |value: Option<&[f64]>, tolerance: Option<f64>| {
        let value = value?.to_vec();
        let size = value.iter().fold(1.0, |size: f64, v| size.max(v.abs()));
        Some(Value {
            tol: tolerance.unwrap_or(WIDE * size),
            value,
            sigma: None,
        })
    };
    let of_link = |link: &language::model::Link| {
        let given = &link.defaults;
        let length = given.length.value.as_ref().map(<[f64; 1]>::as_slice);
        let vector = |quantity: &language::model::Quantity<3>| {
            value(
                quantity.value.as_ref().map(<[f64; 3]>::as_slice),
                quantity.tolerance,
            )
        };
        LinkValues {
            length: value(length, given.length.tolerance),
            plate_joint: vector(&given.plate_joint),
            track_offset: vector(&given.track_offset),
            track_direction: vector(&given.track_direction),
            track_rotation: None,
            pull: link
                .uncertain_pull()
                .and_then(|[pull, tolerance]| value(Some(&[pull]), Some(tolerance))),
        }
    };
    robot.model.links.iter().map(of_link).collect()
}

/// A value of a crank that is a parameter.
pub(crate) struct OfCrank {
    /// As the language writes it, `centre` or `axis`.
    pub(crate) name: &'static str,
    /// Its key in the file.
    pub(crate) key: &'static str,
    /// Value and tolerance that the description gives.
    pub(crate) quantity: language::model::Quantity<3>,
}

/// The values of cranks that are parameters, with the names of the cranks.
pub(crate) fn crank_values(robot: &Robot) -> Vec<(String, OfCrank)> {
    use language::model::CrankValue;
    let tracks = robot.model.tracks.iter();
    let cranks = tracks.filter_map(|track| Some((&track.name, track.crank.as_ref()?)));
    let values = cranks.flat_map(|(name, crank)| {
        CrankValue::ALL.map(|value| {
            let quantity = crank.quantity(value).clone();
            let (key, value) = (crank_key(value.name()), value.name());
            (
                name.clone(),
                OfCrank {
                    name: value,
                    key,
                    quantity,
                },
            )
        })
    });
    values
        .filter(|(_, value)| value.quantity.formula.is_none())
        .collect()
}

/// Key of a value of a crank in the file.
pub fn crank_key(quantity: &str) -> &'static str {
    if quantity == "centre" {
        "centre_m"
    } else {
        "axis"
    }
}

/// The parameters of the whole machine that are none of its constants.
pub(crate) fn machine_parameters(robot: &Robot) -> Vec<language::model::RobotParameter> {
    let parameters = robot.model.parameters.iter();
    parameters
        .filter(|parameter| !parameter.exact)
        .cloned()
        .collect()
}

/// Reference of the description.
pub fn described_reference(robot: &Robot) -> Option<Reference> {
    let model = &robot.model;
    let reference = model.reference.as_ref()?;
    Some(Reference {
        has_angles: model.drives().iter().any(|drive| drive.is_angle),
        commands_m: reference.commands.clone(),
        position_m: reference.position,
        orientation_rad: reference.orientation,
    })
}

/// Key of an effect at its place in the file, such as `rack_pitch(two)`.
pub fn effect_key(parameter: &Parameter) -> Option<&str> {
    Some(&parameter.name[..=parameter.name.rfind(')')?])
}

/// A file's value of a quantity.
pub fn quantity_of<'a>(values: &'a LinkValues, quantity: &str) -> Option<&'a Value> {
    match quantity {
        "length" => values.length.as_ref(),
        "plate_joint" => values.plate_joint.as_ref(),
        "track_offset" => values.track_offset.as_ref(),
        "track_direction" => values.track_direction.as_ref(),
        "pull" => values.pull.as_ref(),
        _ => None,
    }
}

/// The place of a quantity in a file.
pub fn quantity_slot<'a>(
    values: &'a mut LinkValues,
    quantity: &str,
) -> Option<&'a mut Option<Value>> {
    match quantity {
        "length" => Some(&mut values.length),
        "plate_joint" => Some(&mut values.plate_joint),
        "track_offset" => Some(&mut values.track_offset),
        "track_direction" => Some(&mut values.track_direction),
        "track_rotation" => Some(&mut values.track_rotation),
        "pull" => Some(&mut values.pull),
        _ => None,
    }
}

pub(super) fn key_place(table: &DeTable<'_>, key: &str) -> Range<usize> {
    table.get_key_value(key).map_or(0..0, |(key, _)| key.span())
}
