//! Values and tolerances of a variant's parameters before calibration.

use nalgebra::{Rotation3, Vector3};
use tau_codes::fit;
use tau_kinematics::{xyz, xyz_angles};
use tau_robot::input_error::InputError;
use tau_robot::robot::{LinkKey, Owner, Parameter, Robot, Value as Geometry, Variant};
use tau_robot::robot_file::keys::{crank_key, effect_key};
use tau_robot::robot_file::{LinkValues, RobotFile, Value};

use super::registration::Registration;

/// Tolerance of the angles by which a joint's path is turned against the registered path of its cart
/// (rad), where the file gives none: what registration may be wrong by about the tracks, since targets
/// are mounted a decimetre off on tracks a metre or two apart. Across the tracks the poses say far more.
const TRACK_ROTATION_TOLERANCE_RAD: f64 = 5e-2;

/// Value of a parameter with its prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nominal {
    /// Mean of the prior, SI.
    pub value: f64,
    /// One standard deviation; `None` where there is no prior.
    pub tolerance: Option<f64>,
    /// True if the file states a standard deviation after calibration.
    pub is_calibrated: bool,
}

impl Nominal {
    /// The k-th number of a file's value.
    fn of(value: &Value, k: usize) -> Option<Self> {
        Some(Self {
            value: *value.value.get(k)?,
            tolerance: Some(value.tol),
            is_calibrated: value.sigma.is_some(),
        })
    }

    /// Standard deviation of the prior; `None` where there is none, or it is zero.
    pub fn sigma(&self) -> Option<f64> {
        self.tolerance.filter(|&tolerance| tolerance > 0.0)
    }

    /// The same, or what stands for the size of a value that has no prior.
    pub(crate) fn scale(&self) -> f64 {
        self.sigma().unwrap_or_else(|| self.value.abs().max(1.0))
    }

    /// Deviation of a value, in tolerances; not a number where there is no tolerance.
    pub(crate) fn tolerances_to(&self, value: f64) -> f64 {
        (value - self.value) / self.tolerance.unwrap_or(f64::NAN)
    }

    /// A value that has not been calibrated.
    pub fn new(value: f64, tolerance: Option<f64>) -> Self {
        Self {
            value,
            tolerance,
            is_calibrated: false,
        }
    }
}

/// Sources of nominal values.
#[derive(Clone, Copy)]
pub(crate) struct Sources<'a> {
    pub(crate) robot: &'a Robot,
    pub(crate) variant: &'a Variant,
    pub(crate) file: &'a RobotFile,
    /// Mean measured rotation R̄ of the plate, which carries plate joints of reduced arms into the
    /// track offsets.
    pub(crate) mean_rotation: Option<Rotation3<f64>>,
    pub(crate) registration: Option<Registration>,
}

impl<'a> Sources<'a> {
    /// Nominal value of each of the variant's parameters.
    ///
    /// From the file; where it has nothing for the owner, the mean over the owner's links: for the
    /// offsets of a reduced arm, of `track_offset − R̄·plate_joint`. Otherwise from the description.
    pub(crate) fn nominal(&self) -> Result<Vec<Nominal>, InputError> {
        self.variant
            .parameters
            .iter()
            .map(|parameter| self.of(parameter))
            .collect()
    }

    fn of(&self, parameter: &Parameter) -> Result<Nominal, InputError> {
        let component = parameter.component.unwrap_or(0);
        let from_description =
            || (parameter.nominal).map(|value| Nominal::new(value, parameter.tolerance));
        let found = match parameter.owner {
            Owner::Effect(_) => self
                .effect(parameter)
                .or_else(from_description)
                .or_else(|| {
                    let search = parameter.search;
                    let middle = search.map_or(0.0, |(low, high)| f64::midpoint(low, high));
                    Some(Nominal::new(middle, parameter.tolerance))
                }),
            Owner::Robot | Owner::Crank(_) => self.machine(parameter).or_else(from_description),
            Owner::Frame(_) | Owner::Target { .. } => {
                from_description().or(Some(Nominal::new(0.0, parameter.tolerance)))
            }
            Owner::Link(_) | Owner::Cluster(_) | Owner::Track(_) => match LinkKey::of(parameter) {
                Some(LinkKey::TrackRotation) => Some(self.rotation(parameter, component)),
                key => key
                    .and_then(|key| self.geometric(parameter, key, component))
                    .or_else(from_description),
            },
        };
        found
            .filter(|nominal| nominal.value.is_finite())
            .ok_or_else(|| {
                InputError::whole(
                    fit::NO_VALUE,
                    &self.file.source,
                    format!(
                        "nothing gives a value for `{}` of variant `{}`",
                        parameter.name, self.variant.name
                    ),
                )
            })
    }

    fn effect(&self, parameter: &Parameter) -> Option<Nominal> {
        let key = effect_key(parameter)?;
        let value = self.file.effects.get(key)?.get(&parameter.quantity)?;
        Nominal::of(value, parameter.component.unwrap_or(0))
    }

    /// A parameter of the machine, or a value of a crank.
    fn machine(&self, parameter: &Parameter) -> Option<Nominal> {
        let value = match parameter.owner {
            Owner::Crank(track) => {
                let values = self.file.cranks.get(self.robot.tracks.get(track)?)?;
                values.get(crank_key(&parameter.quantity))?
            }
            _ => self.file.parameters.get(&parameter.quantity)?,
        };
        Nominal::of(value, parameter.component.unwrap_or(0))
    }

    /// Angles against the registered path; the file gives them against the tracker frame.
    fn rotation(&self, parameter: &Parameter, component: usize) -> Nominal {
        let given = |values: &'a LinkValues| values.track_rotation.as_ref();
        let value = self
            .own_values(parameter.owner)
            .and_then(given)
            .or_else(|| self.shared_values(parameter.owner).and_then(given))
            .or_else(|| self.links_of(parameter.owner).into_iter().find_map(given));
        let angles = value.and_then(|value| {
            let absolute = xyz(<[f64; 3]>::try_from(value.value.as_slice()).ok()?);
            let registered = self.registration?.rotation;
            Some((xyz_angles(&(absolute * registered.inverse())), value.tol))
        });
        let (angles, tolerance) = angles.unwrap_or((
            [0.0; 3],
            parameter.tolerance.unwrap_or(TRACK_ROTATION_TOLERANCE_RAD),
        ));
        Nominal {
            value: angles[component],
            tolerance: Some(tolerance),
            is_calibrated: value.is_some_and(|value| value.sigma.is_some()),
        }
    }

    fn geometric(&self, parameter: &Parameter, key: LinkKey, component: usize) -> Option<Nominal> {
        let given = |values: &'a LinkValues| values.get(key);
        let own = self.own_values(parameter.owner).and_then(given);
        if let Some(value) = own.or_else(|| self.shared_values(parameter.owner).and_then(given)) {
            return Nominal::of(value, component);
        }
        let links = self.links_of(parameter.owner);
        if links.is_empty() {
            return None;
        }
        let is_folded = matches!(parameter.owner, Owner::Cluster(_))
            && key == LinkKey::Geometry(Geometry::TrackOffset);
        let (mut sum, mut variance) = (0.0, 0.0);
        let mut is_calibrated = false;
        for values in &links {
            let value = values.get(key)?;
            is_calibrated |= value.sigma.is_some();
            sum += value.value.get(component)?;
            variance += value.tol.powi(2);
            if is_folded {
                let joint = values.plate_joint.as_ref()?;
                let lever: [f64; 3] = joint.value.as_slice().try_into().ok()?;
                sum -= (self.mean_rotation? * Vector3::from(lever))[component];
                variance += joint.tol.powi(2);
            }
        }
        // The links of a cluster differ by their tolerances, so their mean is known no better than one.
        let count = links.len() as f64;
        Some(Nominal {
            value: sum / count,
            tolerance: Some((variance / count).sqrt()),
            is_calibrated,
        })
    }

    fn own_values(&self, owner: Owner) -> Option<&'a LinkValues> {
        let (section, name) = match owner {
            Owner::Link(link) => (&self.file.links, &self.robot.links.get(link)?.name),
            Owner::Cluster(cluster) => {
                (&self.file.clusters, &self.robot.clusters.get(cluster)?.name)
            }
            Owner::Track(track) => (&self.file.tracks, self.robot.tracks.get(track)?),
            Owner::Crank(_)
            | Owner::Robot
            | Owner::Effect(_)
            | Owner::Frame(_)
            | Owner::Target { .. } => return None,
        };
        section.get(name)
    }

    /// The file's values for all joints on the cart of a link or cluster.
    fn shared_values(&self, owner: Owner) -> Option<&'a LinkValues> {
        let cluster = match owner {
            Owner::Link(link) => self.robot.links.get(link)?.cluster,
            Owner::Cluster(cluster) => cluster,
            _ => return None,
        };
        let track = self.robot.clusters.get(cluster)?.track?;
        self.file.tracks.get(&self.robot.tracks[track])
    }

    fn links_of(&self, owner: Owner) -> Vec<&'a LinkValues> {
        let links = match owner {
            Owner::Cluster(cluster) => self.robot.links_of_cluster(cluster),
            Owner::Track(track) => self.robot.links_of_track(track),
            _ => Vec::new(),
        };
        links
            .iter()
            .filter_map(|&link| self.file.links.get(&self.robot.links[link].name))
            .collect()
    }
}
