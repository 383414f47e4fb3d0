//! The machine of the drawings: numbers from the robot file or the description, and what formulas make of them.

use std::collections::BTreeMap;
use tau_robot::input_error;

use nalgebra::Vector3;
use tau_codegen::language::model::{CrankValue, Formula, Held, Link, Model, Value as Geometry};
use tau_codes::files;
use tau_robot::input_error::{Errors, InputError, quoted};
use tau_robot::robot::{LinkKey, Robot};
use tau_robot::robot_file::{Dimensions, Origin, Reference, RobotFile};

use super::machine::Machine;
use super::parts::{Crank, Rod};

/// One standard deviation of each value of a link, SI; zero of a formula and of what is exact.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct OfLink {
    pub(super) length: f64,
    pub(super) plate_joint: f64,
    pub(super) track_offset: f64,
    pub(super) track_direction: f64,
    pub(super) pull: f64,
    /// True if its direction is a parameter that nothing holds, so that its cart may turn.
    pub(super) is_free_to_turn: bool,
}

/// One standard deviation of every number of a machine, SI.
#[derive(Debug, Clone, Default)]
pub(super) struct Tolerances {
    pub(super) links: Vec<OfLink>,
    /// Of `centre` and `axis`, by track.
    pub(super) cranks: Vec<[f64; 2]>,
    pub(super) parameters: BTreeMap<String, f64>,
}

/// The machine of the drawings.
pub(super) struct Drawing<'a> {
    robot: &'a Robot,
    reference: &'a Reference,
    pub(super) nominal: Machine,
    pub(super) tolerances: Tolerances,
}

impl<'a> Drawing<'a> {
    /// Of the numbers that the robot file gives, or else the description.
    ///
    /// # Errors
    /// Numbers that neither gives.
    pub(super) fn new(
        robot: &'a Robot,
        file: &RobotFile,
        reference: &'a Reference,
    ) -> Result<Self, InputError> {
        let mut errors = Errors::default();
        let mut lacks = |what: String| {
            errors.add(input_error!(files::UNKNOWN_VALUES, &file.source;
                "the virtual robot needs {what}"));
        };
        if let Some(pulls) = unknown_pulls(robot) {
            lacks(pulls);
        }
        let (rods, links) = links(robot, file, &mut lacks);
        let (cranks, of_cranks) = cranks(robot, file, &mut lacks);
        let (parameters, of_parameters) = parameters(robot, file, &mut lacks);
        errors.finish()?;
        let mut drawing = Self {
            nominal: Machine {
                plate: robot.plate,
                rods,
                tracks: robot.tracks.len(),
                cranks,
                parameters,
                commands: robot.commands,
                ways_m: vec![1.0; robot.commands],
                payload: file.payload,
                effects: Vec::new(),
                travel: Vec::new(),
            },
            tolerances: Tolerances {
                links,
                cranks: of_cranks,
                parameters: of_parameters,
            },
            robot,
            reference,
        };
        let mut nominal = drawing.nominal.clone();
        drawing.follow(&mut nominal);
        drawing.nominal = nominal;
        Ok(drawing)
    }

    /// Takes the tolerance from what a variant holds at its nominal value.
    pub(super) fn hold(&mut self, variant: &str) {
        let model = &self.robot.model;
        let variant = model.variant(variant);
        for held in variant.map_or(&[][..], |variant| &variant.holds) {
            let tolerances = &mut self.tolerances;
            match *held {
                Held::Parameter(index) => {
                    let name = model.parameters[index].name.clone();
                    tolerances.parameters.insert(name, 0.0);
                }
                Held::Crank(track, value) => {
                    let index = usize::from(value == CrankValue::Axis);
                    tolerances.cranks[track][index] = 0.0;
                }
                Held::Link(link, value) => {
                    let of_link = &mut tolerances.links[link];
                    match value {
                        Geometry::Length => of_link.length = 0.0,
                        Geometry::PlateJoint => of_link.plate_joint = 0.0,
                        Geometry::TrackOffset => of_link.track_offset = 0.0,
                        Geometry::TrackDirection => {
                            (of_link.track_direction, of_link.is_free_to_turn) = (0.0, false);
                        }
                    }
                }
            }
        }
    }

    /// Computes what formulas say from the numbers of a machine that are its own.
    pub(super) fn follow(&self, machine: &mut Machine) {
        let model = &self.robot.model;
        for (track, described) in model.tracks.iter().enumerate() {
            let Some(described) = &described.crank else {
                continue;
            };
            let of = |value| {
                described
                    .formula(value)
                    .map(|f| vector(f, &|leaf| of_robot(model, machine, leaf)))
            };
            let (centre, axis) = (of(CrankValue::Centre), of(CrankValue::Axis));
            if let Some(crank) = &mut machine.cranks[track] {
                crank.centre_m = centre.unwrap_or(crank.centre_m);
                crank.axis = axis.unwrap_or(crank.axis);
            }
        }
        for link in 0..machine.rods.len() {
            let of = |value| {
                let formula = self.robot.formula_of(link, value)?;
                Some(vector(formula, &|leaf| {
                    of_link(self.robot, model, machine, link, leaf)
                }))
            };
            let [joint, offset, direction] = [
                Geometry::PlateJoint,
                Geometry::TrackOffset,
                Geometry::TrackDirection,
            ]
            .map(of);
            let length = self.robot.formula_of(link, Geometry::Length);
            let length = length.map(|formula| {
                bound(formula, &|leaf| {
                    of_link(self.robot, model, machine, link, leaf)
                })
            });
            let rod = &mut machine.rods[link];
            rod.plate_joint_m = joint.unwrap_or(rod.plate_joint_m);
            rod.track_offset_m = offset.unwrap_or(rod.track_offset_m);
            rod.track_direction = direction.unwrap_or(rod.track_direction);
            if let Some(formula) = length {
                match rod.actuated_by {
                    Some(command) => {
                        rod.transmission = Some(formula);
                        let stated = self.reference.commands_m.get(command);
                        rod.length_m = rod.length_at(stated.copied().unwrap_or(0.0));
                    }
                    None => rod.length_m = formula.constant().unwrap_or(f64::NAN),
                }
            }
        }
        machine.ways_m = ways(self.robot, machine, &self.reference.commands_m);
    }
}

/// Way (m) that each command moves joints or changes a length by, per unit, where it is an angle.
fn ways(robot: &Robot, machine: &Machine, commands: &[f64]) -> Vec<f64> {
    let way = |command: usize| {
        if !robot.is_angle(command) {
            return 1.0;
        }
        let at = commands.get(command).copied().unwrap_or(0.0);
        let of_rods = machine.rods.iter().filter_map(|rod| {
            if rod.actuated_by == Some(command) {
                return Some(rod.length_rate(at).abs());
            }
            let crank = machine.crank(rod.track.filter(|&track| track == command)?);
            Some(rod.joint_rate(crank, at).norm())
        });
        let largest = of_rods.fold(0.0, f64::max);
        if largest > 0.0 { largest } else { 1.0 }
    };
    (0..machine.commands).map(way).collect()
}

/// Refuses a machine of which a formula has no value, such as the root of a number below zero.
///
/// # Errors
/// A dimension of a link or a crank that is not a finite number.
pub(super) fn refuse_not_finite(
    machine: &Machine,
    robot: &Robot,
    source: &Origin,
) -> Result<(), InputError> {
    let is_finite = |vector: &Vector3<f64>| vector.iter().all(|own| own.is_finite());
    let of_rod = |rod: &Rod| {
        let vectors = [
            ("plate_joint", rod.plate_joint_m),
            ("track_offset", rod.track_offset_m),
            ("track_direction", rod.track_direction),
        ];
        let mut vectors = vectors.iter();
        let vector = vectors.find(|(_, vector)| !is_finite(vector));
        let name = vector.map(|(name, _)| *name);
        name.or((!rod.length_m.is_finite()).then_some("length"))
    };
    let mut rods = machine.rods.iter().zip(&robot.links);
    let Some((link, value)) = rods.find_map(|(rod, link)| Some((link, of_rod(rod)?))) else {
        return Ok(());
    };
    Err(input_error!(files::FORMULA_VALUE, source;
        "`{value}` of link `{}` is not a finite number", link.name;
        "compare its formula with the values of the parameters in it, and their tolerances: the root of a negative \
         number or a division by zero has no value"))
}

/// A component of a parameter of the whole machine.
fn of_robot(model: &Model, machine: &Machine, leaf: &Formula) -> Option<f64> {
    let Formula::OfRobot(index, component) = *leaf else {
        return None;
    };
    let values = machine.parameters.get(&model.parameters.get(index)?.name)?;
    values.get(component).copied()
}

/// The same, or a component of another value of the same link, which may follow from a formula itself.
fn of_link(
    robot: &Robot,
    model: &Model,
    machine: &Machine,
    link: usize,
    leaf: &Formula,
) -> Option<f64> {
    let Formula::OfLink(value, component) = *leaf else {
        return of_robot(model, machine, leaf);
    };
    let of = |leaf: &Formula| of_link(robot, model, machine, link, leaf);
    if let Some(formula) = robot.formula_of(link, value) {
        return match formula {
            Formula::Vector(components) => components[component].value(&of),
            scalar => scalar.value(&of),
        };
    }
    let rod = &machine.rods[link];
    Some(match value {
        Geometry::Length => rod.length_m,
        Geometry::PlateJoint => rod.plate_joint_m[component],
        Geometry::TrackOffset => rod.track_offset_m[component],
        Geometry::TrackDirection => rod.track_direction[component],
    })
}

/// Value of a vector formula; not a number where it has none.
fn vector(formula: &Formula, of: &dyn Fn(&Formula) -> Option<f64>) -> Vector3<f64> {
    match formula {
        Formula::Vector(components) => {
            Vector3::from_fn(|k, _| components[k].value(of).unwrap_or(f64::NAN))
        }
        _ => Vector3::repeat(f64::NAN),
    }
}

/// A formula with numbers in place of all that is known.
fn bound(formula: &Formula, of: &dyn Fn(&Formula) -> Option<f64>) -> Formula {
    if let Some(value) = formula.value(of) {
        return Formula::Number(value);
    }
    let inner = |part: &Formula| Box::new(bound(part, of));
    match formula {
        Formula::Negate(a) => Formula::Negate(inner(a)),
        Formula::Binary(operator, a, b) => Formula::Binary(*operator, inner(a), inner(b)),
        Formula::Power(a, exponent) => Formula::Power(inner(a), *exponent),
        Formula::Call(function, arguments) => {
            let arguments = arguments.iter().map(|a| bound(a, of));
            Formula::Call(*function, arguments.collect())
        }
        other => other.clone(),
    }
}

/// Tensions of links that pull by ones which the description leaves unknown, with the remedy.
fn unknown_pulls(robot: &Robot) -> Option<String> {
    let links = &robot.links;
    let is_unknown = |link: &&Link| link.pull.as_ref().is_some_and(|pull| pull.value.is_none());
    let names: Vec<&str> = links
        .iter()
        .filter(is_unknown)
        .map(|link| link.name.as_str())
        .collect();
    (!names.is_empty()).then(|| {
        format!(
            "the tension of {}, which `pulled;` leaves unknown: write `pulled = … N;` in the description",
            quoted(names)
        )
    })
}

/// Rods with the numbers of their own, and their tolerances.
fn links(
    robot: &Robot,
    file: &RobotFile,
    lacks: &mut dyn FnMut(String),
) -> (Vec<Rod>, Vec<OfLink>) {
    let dimensions = Dimensions::new(robot, file);
    let mut rods = Vec::new();
    let mut tolerances = Vec::new();
    for (index, link) in robot.links.iter().enumerate() {
        let mut find = |value: Geometry| -> (Vec<f64>, f64) {
            let key = LinkKey::Geometry(value);
            let components = key.components();
            if !robot.has_parameter(index, key) {
                return (vec![0.0; components], 0.0);
            }
            dimensions.stated(index, value).unwrap_or_else(|| {
                lacks(format!("the {} of link `{}`", value.name(), link.name));
                (vec![0.0; components], 0.0)
            })
        };
        let (length, of_length) = find(Geometry::Length);
        let (joint, of_joint) = find(Geometry::PlateJoint);
        let (offset, of_offset) = find(Geometry::TrackOffset);
        let (direction, of_direction) = find(Geometry::TrackDirection);
        let pull = link.pull.as_ref();
        let stated = file.links.get(&link.name);
        let stated = stated.and_then(|values| values.pull.as_ref());
        rods.push(Rod {
            length_m: length.first().copied().unwrap_or(0.0),
            plate_joint_m: three(&joint),
            track_offset_m: three(&offset),
            track_direction: three(&direction),
            track: robot.clusters[link.cluster].track,
            actuated_by: link.actuated_by,
            transmission: None,
            // Pulls without a value were refused.
            pull_n: dimensions.pull_n(index),
        });
        tolerances.push(OfLink {
            length: of_length,
            plate_joint: of_joint,
            track_offset: of_offset,
            track_direction: of_direction,
            pull: match (stated, pull) {
                (Some(stated), Some(_)) => stated.tol,
                (_, pull) => pull.and_then(|pull| pull.tolerance).unwrap_or(0.0),
            },
            is_free_to_turn: robot
                .has_parameter(index, LinkKey::Geometry(Geometry::TrackDirection)),
        });
    }
    (rods, tolerances)
}

/// Cranks with the numbers of their own, by track, and the tolerances of centre and axis.
fn cranks(
    robot: &Robot,
    file: &RobotFile,
    lacks: &mut dyn FnMut(String),
) -> (Vec<Option<Crank>>, Vec<[f64; 2]>) {
    let tracks = robot.tracks.iter().enumerate();
    let of_track = tracks.map(|(track, name)| {
        let described = robot.model.tracks.get(track);
        let Some(described) = described.and_then(|track| track.crank.as_ref()) else {
            return (None, [0.0; 2]);
        };
        let [(centre, of_centre), (axis, of_axis)] = CrankValue::ALL.map(|value| {
            if described.formula(value).is_some() {
                return (vec![0.0; 3], 0.0);
            }
            let stated = Dimensions::new(robot, file).stated_of_crank(track, value);
            stated.unwrap_or_else(|| {
                lacks(format!("the {} of crank `{name}`", value.name()));
                (vec![0.0; 3], 0.0)
            })
        });
        let crank = Crank {
            centre_m: three(&centre),
            axis: three(&axis),
        };
        (Some(crank), [of_centre, of_axis])
    });
    of_track.unzip()
}

/// Parameters of the whole machine and their tolerances, by name.
fn parameters(
    robot: &Robot,
    file: &RobotFile,
    lacks: &mut dyn FnMut(String),
) -> (BTreeMap<String, Vec<f64>>, BTreeMap<String, f64>) {
    let found = robot.model.parameters.iter().map(|parameter| {
        let name = &parameter.name;
        let stated = file.parameters.get(name).filter(|_| !parameter.exact);
        let stated = stated.map(|value| (value.value.clone(), value.tol));
        let tolerance = parameter.tolerance.filter(|_| !parameter.exact);
        let given = || Some((parameter.nominal.clone()?, tolerance.unwrap_or(0.0)));
        let (values, tolerance) = stated.or_else(given).unwrap_or_else(|| {
            lacks(format!("the parameter `{name}` of the machine"));
            (vec![0.0; parameter.components], 0.0)
        });
        ((name.clone(), values), (name.clone(), tolerance))
    });
    found.unzip()
}

fn three(values: &[f64]) -> Vector3<f64> {
    Vector3::from_fn(|axis, _| values.get(axis).copied().unwrap_or(0.0))
}
