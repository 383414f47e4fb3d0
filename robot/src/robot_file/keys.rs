//! Keys of a `robot.toml`: which parameter of a robot each value is, and what the robot's description gives.

use std::ops::Range;

use tau_codegen::language;
pub use tau_model_dsl::plausible::WIDE;
use toml::de::DeTable;

use super::{LinkValues, Reference, RobotFile, Value};
use crate::robot::{LinkKey, Parameter, Robot};

impl RobotFile {
    /// The file with what it lacks taken from the robot's description: values of links, and where the machine stands.
    #[must_use]
    pub fn completed(&self, robot: &Robot) -> Self {
        let mut completed = self.clone();
        for (link, described) in robot.links.iter().zip(described_links(robot)) {
            let values = completed.links.entry(link.name.clone()).or_default();
            for key in LinkKey::ALL {
                let slot = values.slot(key);
                if slot.is_none() {
                    *slot = described.get(key).cloned();
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
    let of_link = |link: &language::model::Link| {
        let mut values = LinkValues::default();
        for key in LinkKey::ALL {
            let (value, tolerance) = key.described(link);
            *values.slot(key) = value.map(|value| {
                let size = value.iter().fold(1.0, |size: f64, v| size.max(v.abs()));
                Value {
                    tol: tolerance.unwrap_or(WIDE * size),
                    value,
                    sigma: None,
                }
            });
        }
        values
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

pub(super) fn key_place(table: &DeTable<'_>, key: &str) -> Range<usize> {
    table.get_key_value(key).map_or(0..0, |(key, _)| key.span())
}
