//! Output of a calibration: estimates, Table II, the calibrated robot file.

use serde::Serialize;
use tau_kinematics::{Machine, Sample, Statics, xyz, xyz_angles};
use tau_robot::measurements::TcpPose;
use tau_robot::robot::{
    Instance, LinkKey, Owner, Parameter, ResidualKind, Robot, Value as Geometry,
};
use tau_robot::robot_file::keys::{WIDE, crank_key, effect_key};
use tau_robot::robot_file::{Covariance, Reference, RobotFile, Value};

use super::cost::closure_cost;
use super::link_sigma::{Knowledge, LinkSigma, own_parameter};
use crate::machine::error::Error;
use crate::machine::nominal::Nominal;
use crate::machine::registration::Registration;

/// A row of Table II.
#[derive(Debug, Clone, PartialEq)]
pub struct LinkResult {
    /// Name of the link, or of the cluster where the arm is reduced.
    pub name: String,
    /// Length (m); not a number where it follows from the command alone.
    pub length_m: f64,
    /// Plate joint in TCP coordinates (m); `None` where the arm is reduced, or links meet in a point.
    pub plate_joint_m: Option<[f64; 3]>,
    /// Cart-side joint at q = 0 (m).
    pub track_offset_m: [f64; 3],
    /// Direction, for a linear track.
    pub track_direction: Option<[f64; 3]>,
    /// Rotation angles about x, y, z (rad), for a piecewise track.
    pub track_rotation_rad: Option<[f64; 3]>,
    /// Sum over calibration poses of the squared closure residual (m⁴).
    pub cost_m4: f64,
    /// Standard deviations from the stated noise.
    pub sigma: LinkSigma,
    /// Those of the priors; infinite where there is none.
    pub tolerance: LinkSigma,
}

impl LinkResult {
    /// Standard deviations at noise so many times the stated one, as [`ParameterEstimate::sigma_widened`].
    pub fn sigma_widened(&self, widening: f64) -> LinkSigma {
        let (sigma, prior) = (&self.sigma, &self.tolerance);
        let three = |sigma: [f64; 3], prior: [f64; 3]| {
            std::array::from_fn(|k| widened(sigma[k], widening, prior[k]))
        };
        LinkSigma {
            length_m: widened(sigma.length_m, widening, prior.length_m),
            plate_joint_m: three(sigma.plate_joint_m, prior.plate_joint_m),
            track_offset_m: three(sigma.track_offset_m, prior.track_offset_m),
            track: three(sigma.track, prior.track),
        }
    }
}

/// A standard deviation at noise so many times the stated one: no more than its prior's, which noise does not widen.
pub(crate) fn widened(sigma: f64, widening: f64, prior: f64) -> f64 {
    (widening * sigma).min(prior.max(sigma))
}

/// A calibrated parameter.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ParameterEstimate {
    /// Full name.
    pub name: String,
    /// The part of the robot that it belongs to.
    #[serde(skip)]
    pub owner: Owner,
    /// SI unit.
    pub unit: String,
    /// Value before calibration.
    pub nominal: f64,
    /// One standard deviation of its prior, if it has one.
    pub tolerance: Option<f64>,
    /// Calibrated value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
}

/// What a calibrated value is known by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Source {
    /// By the data: they leave less than half of its tolerance.
    Data,
    /// By its tolerance.
    Tolerance,
    /// It was held.
    Fixed,
}

impl Source {
    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Data => "data",
            Self::Tolerance => "tolerance",
            Self::Fixed => "fixed",
        }
    }
}

impl ParameterEstimate {
    /// What its value is known by.
    pub fn source(&self) -> Source {
        match self.tolerance {
            _ if self.sigma == 0.0 => Source::Fixed,
            Some(tolerance) if self.sigma >= tolerance / 2.0 => Source::Tolerance,
            _ => Source::Data,
        }
    }

    /// Its standard deviation at noise so many times the stated one: no more than its prior's, which noise does not widen.
    pub fn sigma_widened(&self, widening: f64) -> f64 {
        widened(
            self.sigma,
            widening,
            self.tolerance.unwrap_or(f64::INFINITY),
        )
    }
}

pub(super) fn estimates(
    machine: &Machine,
    nominal: &[Nominal],
    used: &[usize],
    covariance: &[Vec<f64>],
    second_order: &[f64],
) -> Vec<ParameterEstimate> {
    used.iter()
        .enumerate()
        .map(|(place, &index)| {
            let parameter = &machine.variant.parameters[index];
            ParameterEstimate {
                name: parameter.name.clone(),
                owner: parameter.owner,
                unit: parameter.unit.clone(),
                nominal: nominal[index].value,
                tolerance: nominal[index].tolerance,
                value: machine.values[index],
                sigma: (covariance[place][place] + second_order[place]).sqrt(),
            }
        })
        .collect()
}

/// Digits of the factor of a covariance: predicted poses are known to some thousandths of what a parameter is known to,
/// since its errors cancel in them.
const DIGITS: usize = 8;

/// The covariance for the file; `None` where nothing determines a parameter.
pub(super) fn covariance(
    (estimates, scales): (&[ParameterEstimate], impl Iterator<Item = String>),
    factor: Option<&[Vec<f64>]>,
    registration: Option<&Registration>,
) -> Option<Covariance> {
    let factor = factor?;
    let rows = factor.iter();
    let rows = rows.map(|row| row.iter().copied().map(rounded).collect());
    let estimated = estimates.iter().map(|estimate| estimate.name.clone());
    Some(Covariance {
        parameters: estimated.chain(scales).take(factor.len()).collect(),
        factor: rows.collect(),
        registered_rad: registration.map(|registration| xyz_angles(&registration.rotation)),
    })
}

/// The number of [`DIGITS`] digits next to a value.
fn rounded(value: f64) -> f64 {
    // A value so near to halfway between two of them is left to the text, which is exact.
    const HALFWAY: f64 = 1e-3;
    const LEAST: f64 = 10_u64.pow(DIGITS as u32 - 1) as f64;
    let places = DIGITS as f64 - 1.0 - value.abs().log10().floor();
    // Powers of ten are exact so far, so that the quotient of whole numbers is the number next to its decimals.
    if (0.0..=22.0).contains(&places) {
        let power = 10_f64.powi(places as i32);
        let scaled = value * power;
        let whole = scaled.round();
        let has_digits = (LEAST..10.0 * LEAST).contains(&whole.abs());
        if has_digits && ((scaled - whole).abs() - 0.5).abs() > HALFWAY {
            return whole / power;
        }
    }
    let text = format!("{value:.*e}", DIGITS - 1);
    text.parse().unwrap_or(value)
}

/// One row of Table II per closure.
pub(super) fn links(
    machine: &Machine,
    known: &Knowledge<'_>,
    registration: Option<&Registration>,
    poses: &[&TcpPose],
) -> Result<Vec<LinkResult>, Error> {
    machine
        .variant
        .instances_of(ResidualKind::Closure)
        .map(|closure| {
            let vector = |quantity: &str| vector_of(machine, closure, quantity);
            let value = |value: Geometry| {
                vector(value.name()).or_else(|| machine.described(closure, value))
            };
            let [sigma, tolerance] = known.of_link(machine, closure);
            Ok(LinkResult {
                name: machine.closure_name(closure).to_owned(),
                length_m: machine.length_m(closure, &[]),
                plate_joint_m: value(Geometry::PlateJoint),
                track_offset_m: value(Geometry::TrackOffset).unwrap_or_default(),
                track_direction: value(Geometry::TrackDirection),
                track_rotation_rad: vector("track_rotation")
                    .map(|angles| absolute_angles(angles, registration)),
                cost_m4: closure_cost(machine, closure, poses)?,
                sigma,
                tolerance,
            })
        })
        .collect()
}

/// Reference that poses show: the one whose commands are nearest to the middle of all. To a tenth
/// of a millimetre and of a milliradian, which is far more than it takes to tell the assemblies of an arm apart.
pub(crate) fn reference(machine: &Machine, poses: &[Sample<'_>]) -> Option<Reference> {
    let count = poses.len() as f64;
    let middle: Vec<f64> = (0..machine.robot.commands)
        .map(|k| {
            let commands = poses.iter().filter_map(|pose| pose.commands_m.get(k));
            commands.sum::<f64>() / count
        })
        .collect();
    let off = |pose: &Sample<'_>| -> f64 {
        let pairs = pose.commands_m.iter().zip(&middle);
        pairs.map(|(q, middle)| (q - middle).powi(2)).sum()
    };
    let shown = (poses.iter()).min_by(|a, b| off(a).total_cmp(&off(b)))?;
    let pose = machine
        .forward_fitted(shown)
        .map_or(shown.pose, |reached| reached.pose);
    let rounded = |value: f64| (value * 1e4).round() / 1e4;
    Some(Reference {
        commands_m: shown.commands_m.to_vec(),
        has_angles: (0..machine.robot.commands).any(|command| machine.robot.is_angle(command)),
        position_m: pose.position_m().map(rounded),
        orientation_rad: pose.angles_rad().map(rounded),
    })
}

/// The file with calibrated values; a parameter without prior gets a tolerance that says nothing when
/// the file is calibrated again. What the variant does not have stays as it was; the record of an earlier calibration,
/// which gave other values, goes.
pub(super) fn file(
    machine: &Machine,
    estimates: &[ParameterEstimate],
    used: &[usize],
    nominal: &RobotFile,
    registration: Option<&Registration>,
) -> RobotFile {
    let mut file = RobotFile {
        calibration: None,
        ..nominal.clone()
    };
    let robot = &machine.robot;
    // Without its folder the file would not say what its polynomials scale to.
    if !machine.variant.reads_travel().is_empty() {
        file.measuring
            .travel
            .clone_from(&machine.surroundings.travel);
    }
    for (estimate, &index) in estimates.iter().zip(used) {
        let parameter = &machine.variant.parameters[index];
        let tolerance = estimate
            .tolerance
            .unwrap_or_else(|| match parameter.search {
                Some((low, high)) => high - low,
                None => WIDE * estimate.value.abs().max(1.0),
            });
        if let Some(value) = slot(&mut file, robot, parameter) {
            let component = parameter.component;
            set(value, component, estimate.value, estimate.sigma, tolerance);
        }
    }
    // The program's angles refer to the registered path, the file's to the tracker frame of set 2.
    let rotations = used.iter().filter(|&&index| {
        let parameter = &machine.variant.parameters[index];
        LinkKey::of(parameter) == Some(LinkKey::TrackRotation) && parameter.component == Some(0)
    });
    for &index in rotations {
        let slot = match machine.variant.parameters[index].owner {
            Owner::Link(link) => file.links.get_mut(&robot.links[link].name),
            Owner::Cluster(cluster) => file.clusters.get_mut(&robot.clusters[cluster].name),
            Owner::Track(track) => file.tracks.get_mut(&robot.tracks[track]),
            _ => None,
        };
        if let Some(value) = slot.and_then(|values| values.track_rotation.as_mut())
            && let Ok(angles) = <[f64; 3]>::try_from(value.value.as_slice())
        {
            value.value = absolute_angles(angles, registration).into();
        }
    }
    file
}

/// Forces of the arm as the values of a machine draw it; `None` where the file does not tell them.
pub(crate) fn statics(machine: &Machine, nominal: &RobotFile) -> Option<Statics> {
    let mut file = nominal.clone();
    for (parameter, &own) in machine.variant.parameters.iter().zip(&machine.values) {
        if let Some(value) = slot(&mut file, &machine.robot, parameter) {
            put(value, parameter.component, own);
        }
    }
    Statics::new(&machine.robot, &file)
}

/// The place of a parameter in a file, which is made where it is not there.
fn slot<'f>(
    file: &'f mut RobotFile,
    robot: &Robot,
    parameter: &Parameter,
) -> Option<&'f mut Value> {
    let quantity = parameter.quantity.clone();
    let (section, name) = match parameter.owner {
        Owner::Link(link) => (&mut file.links, &robot.links[link].name),
        Owner::Cluster(cluster) => (&mut file.clusters, &robot.clusters[cluster].name),
        Owner::Track(track) => (&mut file.tracks, &robot.tracks[track]),
        Owner::Effect(_) => {
            let values = file.effects.entry(effect_key(parameter)?.to_owned());
            return Some(values.or_default().entry(quantity).or_default());
        }
        Owner::Crank(track) => {
            let values = file.cranks.entry(robot.tracks[track].clone()).or_default();
            return Some(values.entry(crank_key(&quantity).to_owned()).or_default());
        }
        Owner::Robot => return Some(file.parameters.entry(quantity).or_default()),
        Owner::Frame(_) | Owner::Target { .. } => return None,
    };
    let values = section.entry(name.clone()).or_default();
    LinkKey::of(parameter).map(|key| values.slot(key).get_or_insert_default())
}

/// Writes a number to its place, and returns that and the number of places.
fn put(value: &mut Value, component: Option<usize>, number: f64) -> (usize, usize) {
    let place = component.unwrap_or(0);
    let size = if component.is_some() { 3 } else { 1 };
    value.value.resize(size, 0.0);
    value.value[place] = number;
    (place, size)
}

fn set(value: &mut Value, component: Option<usize>, estimate: f64, sigma: f64, tolerance: f64) {
    let (place, size) = put(value, component, estimate);
    value.tol = tolerance;
    let sigmas = value.sigma.get_or_insert_with(|| vec![0.0; size]);
    sigmas.resize(size, 0.0);
    sigmas[place] = sigma;
}

/// Angles that carry the path from the tracker frame of set 2 into the measurement frame.
fn absolute_angles(angles: [f64; 3], registration: Option<&Registration>) -> [f64; 3] {
    match registration {
        Some(registration) => xyz_angles(&(xyz(angles) * registration.rotation)),
        None => angles,
    }
}

fn vector_of(machine: &Machine, closure: &Instance, quantity: &str) -> Option<[f64; 3]> {
    let component = |k| component_of(machine, closure, quantity, Some(k));
    Some([component(0)?, component(1)?, component(2)?])
}

fn component_of(
    machine: &Machine,
    closure: &Instance,
    quantity: &str,
    component: Option<usize>,
) -> Option<f64> {
    own_parameter(machine, closure, component, |own| own == quantity)
        .map(|index| machine.values[index])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::numerics::distribution::Random;

    /// Rows of Table II widen as parameters do: to the prior's deviation at most, and never below their own.
    #[test]
    fn noise_widens_no_row_beyond_its_prior() {
        let sigma = LinkSigma {
            length_m: 1e-4,
            plate_joint_m: [1e-4, 2e-4, 5e-4],
            ..LinkSigma::default()
        };
        let tolerance = LinkSigma {
            length_m: 3e-4,
            plate_joint_m: [f64::INFINITY, 1e-3, 4e-4],
            ..LinkSigma::default()
        };
        let link = LinkResult {
            name: "l1".to_owned(),
            length_m: 1.0,
            plate_joint_m: None,
            track_offset_m: [0.0; 3],
            track_direction: None,
            track_rotation_rad: None,
            cost_m4: 0.0,
            sigma,
            tolerance,
        };
        let expected = LinkSigma {
            length_m: 3e-4,
            plate_joint_m: [6e-4, 1e-3, 5e-4],
            ..LinkSigma::default()
        };
        let found = link.sigma_widened(6.0);
        assert!((found.plate_joint_m[0] - expected.plate_joint_m[0]).abs() < 1e-15);
        assert_eq!(found.length_m, expected.length_m);
        assert_eq!(found.plate_joint_m[1..], expected.plate_joint_m[1..]);
    }

    #[test]
    fn values_are_rounded_as_their_text_is() {
        let by_text = |value: f64| format!("{value:.7e}").parse::<f64>().unwrap();
        let mut random = Random(5);
        let mut uniform = || random.below(1 << 30) as f64 / f64::from(1 << 30);
        for _ in 0..20_000 {
            let exponent = 40.0 * uniform() - 25.0;
            let value = (2.0 * uniform() - 1.0) * 10_f64.powf(exponent);
            let short = (value * 1e9).round() / 1e9;
            for value in [value, short, value.round() + 0.5] {
                assert_eq!(
                    rounded(value).to_bits(),
                    by_text(value).to_bits(),
                    "{value:e}"
                );
            }
        }
        for value in [
            0.0,
            -0.0,
            9.999_999_99,
            1e-5,
            0.1,
            12_345_678.5,
            1.000_000_05,
            f64::MIN_POSITIVE,
        ] {
            assert_eq!(
                rounded(value).to_bits(),
                by_text(value).to_bits(),
                "{value:e}"
            );
        }
    }
}
