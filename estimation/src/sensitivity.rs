//! Influence of each parameter: Table III, Figures 9 and 10 of the paper.
//!
//! Twice, by independent ways that must agree: by steps of each parameter through forward kinematics,
//! as the paper did, and by the implicit function theorem, `∂X/∂p = −(∂r/∂X)⁻¹ ∂r/∂p` with the pose X
//! and the closures r.
//!
//! The paper sums changes of the ZYZ Euler angles. Near β = 0 and π, where deltas and hexapods stand level, they mean
//! nothing: a small turn changes α and γ by anything. There the components of the rotation vector are summed instead.

use nalgebra::{DMatrix, DVector, Vector3};
use tau_kinematics::{Machine, POSE_COLUMNS, Pose, Sample, angle_rates};
use tau_robot::measurements::{Folder, TcpPose};
use tau_robot::robot::{Instance, ResidualKind};

use crate::calibration::{closure_cost, own_parameter};
use crate::implicit::Linearized;
use crate::machine::Error;
use crate::machine::error::not_finite;
use crate::numerics::parallel;
use crate::numerics::spread::spread;

/// Table III: effect of a step in each parameter of each link, summed over the validation poses.
#[derive(Debug, Clone)]
pub struct Sensitivity {
    /// Variant it was computed for.
    pub variant: String,
    /// Number of poses summed over.
    pub poses: usize,
    /// Step, in SI units of each parameter.
    pub step: f64,
    /// Coordinates in which changes of the orientation are summed.
    pub turn: Turn,
    /// One entry per link.
    pub links: Vec<LinkSensitivity>,
    /// Largest relative difference between steps and implicit differentiation, over all entries.
    pub disagreement: f64,
}

impl Sensitivity {
    /// Names of the parameters that any link has, in the order of the table.
    pub fn parameters(&self) -> Vec<&'static str> {
        let has = |name: &str| {
            let mut rows = self.links.iter().flat_map(|link| &link.parameters);
            rows.any(|row| row.parameter == name)
        };
        let names = ROWS.iter().map(|row| row.0);
        names.filter(|name| has(name)).collect()
    }
}

/// Coordinates of a small change of orientation.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Turn {
    /// Differences of the ZYZ Euler angles, as in the paper.
    EulerAngles,
    /// The rotation vector in the measurement frame: at some pose the Euler angles are singular or nearly so.
    RotationVector,
}

/// Sine of β below which the Euler angles count as singular: they move ten times as fast as the plate turns.
const SINGULAR: f64 = 0.1;

impl Turn {
    /// Those that mean something at all places.
    fn at(places: &[Place<'_>]) -> Self {
        let is_singular = |place: &Place<'_>| place.pose.angles_rad()[1].sin() < SINGULAR;
        if places.iter().any(is_singular) {
            Self::RotationVector
        } else {
            Self::EulerAngles
        }
    }

    /// Sum of the magnitudes of the three changes from one pose to another (rad).
    fn sum(self, from: &Pose, to: &Pose) -> f64 {
        match self {
            Self::EulerAngles => {
                let before = from.angles_rad();
                let after = to.angles_near(before);
                after.iter().zip(before).map(|(a, b)| (a - b).abs()).sum()
            }
            Self::RotationVector => from.turn_to(&to.rotation).lp_norm(1),
        }
    }

    /// The same per unit of a rate of the rotation vector at a pose.
    fn rate(self, at: &Pose, turning: Vector3<f64>) -> f64 {
        match self {
            Self::EulerAngles => (angle_rates(at.angles_rad()) * turning).lp_norm(1),
            Self::RotationVector => turning.lp_norm(1),
        }
    }
}

/// Table III for one link.
#[derive(Debug, Clone)]
pub struct LinkSensitivity {
    /// Name of the link.
    pub link: String,
    /// One entry per parameter that it has, in the order `L, Px, Py, Pz, Offset_x, …, Orient_3`.
    pub parameters: Vec<ParameterSensitivity>,
}

/// Table III for one parameter of one link.
#[derive(Debug, Clone)]
pub struct ParameterSensitivity {
    /// `L`, `Px`, …, `Orient_3`.
    pub parameter: String,
    /// Sum of ‖ΔT⁺‖ + ‖ΔT⁻‖ (mm), by steps.
    pub position_mm: f64,
    /// Sum of ‖T⁺ − T⁻‖ (mm), by steps: the same without what is of second order in the step.
    pub position_mm_central: f64,
    /// The same by implicit differentiation.
    pub position_mm_analytic: f64,
    /// Sum of the magnitudes of the three changes in [`Sensitivity::turn`] over both steps (rad), by steps.
    pub orientation_rad: f64,
    /// The same from the lower step to the upper one (rad).
    pub orientation_rad_central: f64,
    /// The same by implicit differentiation.
    pub orientation_rad_analytic: f64,
    /// Change of the paper's cost on the validation poses (m⁴), magnitudes summed over both steps.
    pub cost_m4: f64,
    /// Position change at each validation pose for the positive step (µm): Figures 9 and 10.
    pub by_pose_um: Vec<f64>,
    /// Orientation change, likewise summed, at each validation pose for the positive step (rad).
    pub by_pose_rad: Vec<f64>,
}

/// Step of the paper, in SI units of each parameter.
pub const PAPER_STEP: f64 = 5e-5;

/// Poses that are summed over, at most: changes are smooth over the workspace, so that more of them tell the same.
const MOST_POSES: usize = 1000;

/// A sum below this share of the largest of its quantity does not count in the comparison of the two
/// ways: it is rounding, or of third order in the step.
const NEGLIGIBLE: f64 = 1e-6;

/// Parameters of Table III: name, quantity, component.
const ROWS: [(&str, &str, Option<usize>); 10] = [
    ("L", "length", None),
    ("Px", "plate_joint", Some(0)),
    ("Py", "plate_joint", Some(1)),
    ("Pz", "plate_joint", Some(2)),
    ("Offset_x", "track_offset", Some(0)),
    ("Offset_y", "track_offset", Some(1)),
    ("Offset_z", "track_offset", Some(2)),
    ("Orient_1", "orientation", Some(0)),
    ("Orient_2", "orientation", Some(1)),
    ("Orient_3", "orientation", Some(2)),
];

/// Table III for a machine at poses of a folder, given by index; of thousands, at a thousand evenly spread. For each parameter of each link, the
/// sums over the poses of the changes that a step up and a step down of the parameter make. Rows that
/// a reduced arm lacks are left out; a direction or rotation that links share counts for each of them.
///
/// # Errors
/// Columns that the variant needs are missing; a pose can't be predicted or is singular.
pub fn analyse(
    machine: &Machine,
    folder: &Folder,
    poses: &[usize],
    step: f64,
) -> Result<Sensitivity, Error> {
    let chosen: Vec<&TcpPose> = (spread(poses.len(), MOST_POSES).into_iter())
        .filter_map(|index| folder.tcp_poses.get(poses[index]))
        .collect();
    let places = parallel::map(&chosen, |measured| Place::new(machine, measured));
    let places = places.into_iter().collect::<Result<Vec<_>, Error>>()?;
    let turn = Turn::at(&places);
    let closures: Vec<&Instance> = (machine.variant)
        .instances_of(ResidualKind::Closure)
        .collect();
    let links = parallel::map(&closures, |closure| {
        let parameters = parallel::map(&ROWS, |&(name, quantity, component)| {
            let parameter = find(machine, closure, quantity, component)?;
            Some(row(machine, name, parameter, &places, turn, step))
        });
        let parameters = parameters.into_iter().flatten();
        Ok(LinkSensitivity {
            link: machine.closure_name(closure).to_owned(),
            parameters: parameters.collect::<Result<Vec<_>, Error>>()?,
        })
    });
    let links = links.into_iter().collect::<Result<Vec<_>, Error>>()?;
    Ok(Sensitivity {
        variant: machine.variant.name.clone(),
        poses: places.len(),
        step,
        turn,
        disagreement: disagreement(&links),
        links,
    })
}

/// A measured pose, the pose predicted at its commands, and the derivatives there.
struct Place<'a> {
    measured: &'a TcpPose,
    pose: Pose,
    /// `−(∂r/∂X)⁻¹`, by least squares: rows translation and rotation vector, one column per closure.
    response: DMatrix<f64>,
    closures: Linearized,
}

/// Changes of the pose at every place.
struct Change {
    /// ‖ΔT‖ (m).
    position: Vec<f64>,
    /// Sum of the magnitudes of three changes (rad).
    orientation: Vec<f64>,
}

impl Change {
    fn between(from: &[Pose], to: &[Pose], turn: Turn) -> Self {
        let pairs = || from.iter().zip(to);
        Self {
            position: (pairs().map(|(from, to)| (to.position - from.position).norm())).collect(),
            orientation: pairs().map(|(from, to)| turn.sum(from, to)).collect(),
        }
    }
}

impl<'a> Place<'a> {
    fn new(machine: &Machine, measured: &'a TcpPose) -> Result<Self, Error> {
        let sample = Sample::from(measured);
        let fail = |error| Error::at_pose(measured.pose, machine.explained(error, &sample));
        let pose = machine.forward_fitted(&sample).map_err(fail)?.pose;
        let closures = Linearized::new(machine, &sample.at(pose)).map_err(fail)?;
        let unknowns = machine.pose_unknowns();
        let inverse = closures.response(unknowns);
        let inverse = inverse.ok_or_else(|| Error::NotConverged {
            variant: machine.variant.name.clone(),
            why: not_finite("derivatives"),
        })?;
        let mut response = DMatrix::zeros(POSE_COLUMNS, inverse.ncols());
        for (row, &unknown) in unknowns.iter().enumerate() {
            response.set_row(unknown, &inverse.row(row));
        }
        Ok(Self {
            measured,
            pose,
            response,
            closures,
        })
    }

    /// Derivatives of all closures by a parameter, at the predicted pose.
    fn closure_derivatives(&self, parameter: usize) -> DVector<f64> {
        let closures = &self.closures.by_parameters;
        let of = |entries: &Vec<(usize, f64)>| {
            let own = entries.iter().find(|&&(index, _)| index == parameter);
            own.map_or(0.0, |&(_, entry)| entry)
        };
        DVector::from_iterator(closures.len(), closures.iter().map(of))
    }
}

fn row(
    machine: &Machine,
    name: &str,
    parameter: usize,
    places: &[Place<'_>],
    turn: Turn,
    step: f64,
) -> Result<ParameterSensitivity, Error> {
    let with = |change: f64| {
        let mut values = machine.values.clone();
        values[parameter] += change;
        machine.with_values(values)
    };
    let (plus, minus) = (with(step), with(-step));
    let before: Vec<Pose> = places.iter().map(|place| place.pose).collect();
    let (above, below) = (moved(&plus, places)?, moved(&minus, places)?);
    let up = Change::between(&before, &above, turn);
    let down = Change::between(&before, &below, turn);
    let across = Change::between(&below, &above, turn);
    let analytic = implicit(machine, parameter, places, turn);
    let total = |values: &[f64]| values.iter().sum::<f64>();
    let measured: Vec<&TcpPose> = places.iter().map(|place| place.measured).collect();
    let total_cost = |machine: &Machine| -> Result<f64, Error> {
        machine
            .variant
            .instances_of(ResidualKind::Closure)
            .filter(|closure| closure.parameters.contains(&parameter))
            .map(|closure| closure_cost(machine, closure, &measured))
            .sum()
    };
    let cost = total_cost(machine)?;
    Ok(ParameterSensitivity {
        parameter: name.to_owned(),
        position_mm: (total(&up.position) + total(&down.position)) * 1e3,
        position_mm_central: total(&across.position) * 1e3,
        position_mm_analytic: 2.0 * step * total(&analytic.position) * 1e3,
        orientation_rad: total(&up.orientation) + total(&down.orientation),
        orientation_rad_central: total(&across.orientation),
        orientation_rad_analytic: 2.0 * step * total(&analytic.orientation),
        cost_m4: (total_cost(&plus)? - cost).abs() + (total_cost(&minus)? - cost).abs(),
        by_pose_um: up.position.iter().map(|change| change * 1e6).collect(),
        by_pose_rad: up.orientation,
    })
}

/// The poses that a machine with a parameter moved takes in place of the predicted ones.
fn moved(moved: &Machine, places: &[Place<'_>]) -> Result<Vec<Pose>, Error> {
    let poses = places.iter().map(|place| {
        let from = Sample::from(place.measured).at(place.pose);
        let pose = moved.forward_unchecked(&from);
        pose.map_err(|error| Error::at_pose(place.measured.pose, error))
    });
    poses.collect()
}

/// Changes of the predicted poses per unit of a parameter, by the implicit function theorem.
fn implicit(machine: &Machine, parameter: usize, places: &[Place<'_>], turn: Turn) -> Change {
    let mut change = Change {
        position: Vec::new(),
        orientation: Vec::new(),
    };
    let turns = machine.turns();
    for place in places {
        let motion = &place.response * place.closure_derivatives(parameter);
        change.position.push(motion.fixed_rows::<3>(0).norm());
        let turning = motion.fixed_rows::<3>(3).into_owned();
        change.orientation.push(if turns {
            turn.rate(&place.pose, turning)
        } else {
            0.0
        });
    }
    change
}

/// Largest relative difference between the two ways, over all entries that are not negligible.
fn disagreement(links: &[LinkSensitivity]) -> f64 {
    let entries = |of: fn(&ParameterSensitivity) -> [f64; 2]| {
        let rows = || links.iter().flat_map(|link| &link.parameters).map(of);
        let largest = rows().flatten().fold(0.0, f64::max);
        rows()
            .map(|[by_step, analytic]| ((by_step - analytic).abs(), by_step.max(analytic)))
            .filter(|(_, size)| *size > NEGLIGIBLE * largest)
            .map(|(difference, size)| difference / size)
            .fold(0.0, f64::max)
    };
    let position = entries(|row| [row.position_mm_central, row.position_mm_analytic]);
    let orientation = entries(|row| [row.orientation_rad_central, row.orientation_rad_analytic]);
    position.max(orientation)
}

/// The parameter of a closure's own link, cluster or track that a row of the table changes.
fn find(
    machine: &Machine,
    closure: &Instance,
    quantity: &str,
    component: Option<usize>,
) -> Option<usize> {
    own_parameter(machine, closure, component, |own| {
        own == quantity
            || quantity == "orientation" && matches!(own, "track_direction" | "track_rotation")
    })
}
