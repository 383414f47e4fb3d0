//! Nominal dimensions of a robot: numbers of its file or else its description, and what formulas make of them.

use nalgebra::{Rotation3, Vector3};
use tau_codegen::language::model::{CrankValue, Formula, Model, Readable, Value as Geometry};

use super::RobotFile;
use super::keys::crank_key;
use crate::robot::{LinkKey, Robot};

/// Dimensions of a robot by its file.
#[derive(Debug, Clone, Copy)]
pub struct Dimensions<'a> {
    robot: &'a Robot,
    file: &'a RobotFile,
}

/// Joints of a link, and how that on its carrier moves.
#[derive(Debug, Clone, Copy)]
pub struct Joints {
    /// On the plate, in TCP coordinates (m).
    pub plate: Vector3<f64>,
    /// On the cart, the crank or the base at command 0 (m).
    pub offset: Vector3<f64>,
    /// Displacement on a cart per unit of the command; zero elsewhere.
    pub direction: Vector3<f64>,
    /// Centre (m) and axis of the crank that carries it.
    pub crank: Option<[Vector3<f64>; 2]>,
    /// Index of the track or crank.
    pub track: Option<usize>,
}

impl Joints {
    /// The joint on the cart, the crank or the base at a command (m).
    pub fn at(&self, command: f64) -> Vector3<f64> {
        match self.crank {
            Some([centre, axis]) => {
                centre + Rotation3::new(axis * command) * (self.offset - centre)
            }
            None => self.offset + self.direction * command,
        }
    }
}

impl<'a> Dimensions<'a> {
    /// Those that a file, or else the description, gives.
    pub fn new(robot: &'a Robot, file: &'a RobotFile) -> Self {
        Self { robot, file }
    }

    /// Length (m) of a link at commands; `None` where nothing gives it.
    pub fn length_m(&self, link: usize, commands: &[f64]) -> Option<f64> {
        let own = self.robot.links.get(link)?;
        let driven = own
            .actuated_by
            .and_then(|drive| commands.get(drive))
            .copied();
        match self.robot.formula_of(link, Geometry::Length) {
            Some(formula) => formula.value(&|leaf| self.leaf(link, driven, leaf)),
            None => Some(self.stated(link, Geometry::Length)?.0.first()? + driven.unwrap_or(0.0)),
        }
    }

    /// A vector of a link (m, or per unit of the command); zero where the plate or the base has none, `None` where nothing
    /// gives it.
    pub fn vector(&self, link: usize, value: Geometry) -> Option<[f64; 3]> {
        if let Some(formula) = self.robot.formula_of(link, value) {
            return components(formula, &|leaf| self.leaf(link, None, leaf));
        }
        if !self.robot.has_parameter(link, LinkKey::Geometry(value)) {
            return Some([0.0; 3]);
        }
        self.stated(link, value)?.0.try_into().ok()
    }

    /// Joints of a link; `None` where not all that places them is given.
    pub fn joints(&self, link: usize) -> Option<Joints> {
        let vector = |value| self.vector(link, value).map(Vector3::from);
        let track = self
            .robot
            .clusters
            .get(self.robot.links[link].cluster)?
            .track;
        let crank = track.and_then(|track| self.crank(track));
        Some(Joints {
            plate: vector(Geometry::PlateJoint)?,
            offset: vector(Geometry::TrackOffset)?,
            direction: vector(Geometry::TrackDirection)?,
            crank: crank.map(|crank| crank.map(Vector3::from)),
            track,
        })
    }

    /// Centre (m) and axis of a crank by its index among the tracks; `None` of a track, or where nothing gives them.
    pub fn crank(&self, track: usize) -> Option<[[f64; 3]; 2]> {
        let model = &self.robot.model;
        let of_track = model.tracks.get(track)?;
        let crank = of_track.crank.as_ref()?;
        let of = |value: CrankValue| {
            if let Some(formula) = crank.formula(value) {
                return components(formula, &|leaf| self.of_robot(model, leaf));
            }
            self.stated_of_crank(track, value)?.0.try_into().ok()
        };
        Some([of(CrankValue::Centre)?, of(CrankValue::Axis)?])
    }

    /// Tension (N) to which a link is pulled; `None` where it holds its length, or nothing states the tension.
    pub fn pull_n(&self, link: usize) -> Option<f64> {
        let own = self.robot.links.get(link)?;
        let pull = own.pull.as_ref()?;
        let stated = self.file.links.get(&own.name);
        let stated = stated.and_then(|values| values.pull.as_ref()?.value.first().copied());
        stated.or_else(|| pull.value.map(|[pull]| pull))
    }

    /// Numbers that the file, or else the description, states, with their tolerance: zero where it gives none.
    pub fn stated(&self, link: usize, value: Geometry) -> Option<(Vec<f64>, f64)> {
        let own = self.robot.links.get(link)?;
        let track = self.robot.clusters.get(own.cluster)?.track;
        let shared = track.and_then(|track| self.file.tracks.get(&self.robot.tracks[track]));
        let values = [self.file.links.get(&own.name), shared];
        let mut stated = values.into_iter().flatten();
        let stated = stated.find_map(|values| values.get(LinkKey::Geometry(value)));
        let stated = stated.map(|value| (value.value.clone(), value.tol));
        stated.or_else(|| given(own.defaults.given(value)))
    }

    /// The same of a crank by its index among the tracks.
    pub fn stated_of_crank(&self, track: usize, value: CrankValue) -> Option<(Vec<f64>, f64)> {
        let of_track = self.robot.model.tracks.get(track)?;
        let stated = self.file.cranks.get(&of_track.name);
        let stated = stated.and_then(|values| values.get(crank_key(value.name())));
        let stated = stated.map(|value| (value.value.clone(), value.tol));
        stated.or_else(|| given(of_track.crank.as_ref()?.quantity(value).given()))
    }

    fn leaf(&self, link: usize, command: Option<f64>, leaf: &Formula) -> Option<f64> {
        match *leaf {
            Formula::Read(Readable::Command) => command,
            Formula::OfLink(Geometry::Length, _) => self.length_m(link, &[]),
            Formula::OfLink(value, component) => Some(self.vector(link, value)?[component]),
            _ => self.of_robot(&self.robot.model, leaf),
        }
    }

    /// A component of a parameter of the whole machine.
    fn of_robot(&self, model: &Model, leaf: &Formula) -> Option<f64> {
        let Formula::OfRobot(index, component) = *leaf else {
            return None;
        };
        let parameter = model.parameters.get(index)?;
        let stated = self.file.parameters.get(&parameter.name);
        let stated = stated
            .filter(|_| !parameter.exact)
            .map(|value| &value.value);
        let values = stated.or(parameter.nominal.as_ref())?;
        values.get(component).copied()
    }
}

/// Value and tolerance that a description gives.
fn given((value, tolerance): (Option<&[f64]>, Option<f64>)) -> Option<(Vec<f64>, f64)> {
    Some((value?.to_vec(), tolerance.unwrap_or(0.0)))
}

fn components(formula: &Formula, of: &dyn Fn(&Formula) -> Option<f64>) -> Option<[f64; 3]> {
    let Formula::Vector(components) = formula else {
        return None;
    };
    let [x, y, z] = &**components;
    Some([x.value(of)?, y.value(of)?, z.value(of)?])
}
