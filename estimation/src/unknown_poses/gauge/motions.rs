//! Motions of a machine that its parameters can make up for.
//!
//! A motion of the machine in space, or of the TCP on the plate, changes no closure where the poses move along with it.
//! So parameters make it as far as there is one change of them that changes the closures of all poses, held or not by the
//! links, by what the poses' own motion takes away: linear equations at more places than there are parameters. Whether
//! these are coordinates of joints, or formulas, centres of cranks and scales of drives follow from them, does not matter.

use nalgebra::{DMatrix, DVector, Vector3};
use tau_kinematics::{Machine, Pose};
use tau_robot::measurements::ObjectKind;

use super::super::measurand::AXES;
use super::super::objects::Object;
use super::super::pose::UnknownPose;
use super::super::quantity::across;
use crate::implicit::Linearized;

/// Share of what a motion asks of the closures that parameters may leave: rounding. A thousandth and a hundred times of it
/// find the same motions.
const LEFT: f64 = 1e-7;
/// Share of the largest singular value below which closures do not see a change of parameters.
const UNSEEN: f64 = 1e-11;
/// Displacement of places from measured poses, over the length of the links, and turn (rad): as far as shows all terms.
const APART: f64 = 0.2;

/// Unknowns that poses share, as motions change them.
pub(in super::super) struct Shared<'a> {
    pub(in super::super) machine: &'a Machine,
    /// Indices in the variant of the first ones.
    pub(in super::super) used: &'a [usize],
    /// The others.
    pub(in super::super) objects: &'a [Object],
    /// Values of all of them.
    pub(in super::super) values: &'a [f64],
    /// Units of all of them.
    pub(in super::super) scale: &'a [f64],
    pub(in super::super) poses: &'a [UnknownPose],
}

/// A motion with its name.
pub(super) struct Motion {
    pub(super) words: String,
    pub(super) is_scale: bool,
    /// Change of the shared unknowns, in their units, of length one.
    pub(super) change: DVector<f64>,
    /// Its length by one metre or radian of the motion, or where the machine becomes twice as large.
    pub(super) size: f64,
}

/// Along or about a unit vector, or of all lengths alike.
#[derive(Clone, Copy, PartialEq)]
enum Kind {
    /// The machine is shifted (m).
    Shift(Vector3<f64>),
    /// The machine is turned about the origin (rad).
    Turn(Vector3<f64>),
    /// All points of the plate are shifted against the TCP, in its frame (m).
    ShiftOnPlate(Vector3<f64>),
    /// All points of the plate are turned about the TCP, in its frame (rad).
    TurnOnPlate(Vector3<f64>),
    /// All lengths grow in proportion.
    Scale,
    /// All drives count more (m or rad).
    Zero,
}

impl Kind {
    /// All, with names.
    fn all() -> Vec<(String, Self)> {
        type Along = fn(Vector3<f64>) -> Kind;
        let along: [(&str, Along); 4] = [
            ("position of the machine along", Self::Shift),
            ("rotation of the machine about", Self::Turn),
            (
                "position of the TCP on the plate along its",
                Self::ShiftOnPlate,
            ),
            (
                "orientation of the TCP on the plate about its",
                Self::TurnOnPlate,
            ),
        ];
        let along = along.into_iter().flat_map(|(words, kind)| {
            let axes = AXES.iter().enumerate();
            axes.map(move |(axis, name)| (format!("{words} {name}"), kind(Vector3::ith(axis, 1.0))))
        });
        let others = [
            ("scale of the whole machine", Self::Scale),
            ("common zero of all drives", Self::Zero),
        ];
        let others = others.map(|(words, kind)| (words.to_owned(), kind));
        along.chain(others).collect()
    }

    /// True of a motion that keeps a plate that moves in the plane z = 0 there.
    fn stays_in_plane(self) -> bool {
        match self {
            Self::Shift(way) | Self::ShiftOnPlate(way) => way.z == 0.0,
            Self::Turn(axis) | Self::TurnOnPlate(axis) => axis.x == 0.0 && axis.y == 0.0,
            Self::Scale | Self::Zero => true,
        }
    }

    /// Change of the closures at a pose that parameters have to make.
    fn of_closures(self, closures: &Linearized, pose: &Pose) -> DVector<f64> {
        let shifted = |way: Vector3<f64>| closures.by_pose.columns(0, 3) * -way;
        let turned = |axis: Vector3<f64>| closures.by_pose.columns(3, 3) * -axis;
        match self {
            Self::Shift(way) => shifted(way),
            Self::Turn(axis) => shifted(axis.cross(&pose.position)) + turned(axis),
            Self::ShiftOnPlate(way) => shifted(-(pose.rotation * way)),
            Self::TurnOnPlate(axis) => turned(-(pose.rotation * axis)),
            // They are homogeneous of degree two.
            Self::Scale => shifted(pose.position) + &closures.residuals * 2.0,
            Self::Zero => closures.by_pose.columns_range(6..).column_sum(),
        }
    }

    /// Change of a point fixed in space (m).
    fn of_point(self, point: Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Shift(way) => way,
            Self::Turn(axis) => axis.cross(&point),
            Self::Scale => point,
            _ => Vector3::zeros(),
        }
    }

    /// Change of a direction in space.
    fn of_direction(self, direction: Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::Turn(axis) => axis.cross(&direction),
            _ => Vector3::zeros(),
        }
    }

    /// Change of a point on the plate (m).
    fn of_plate(self, point: Vector3<f64>) -> Vector3<f64> {
        match self {
            Self::ShiftOnPlate(way) => way,
            Self::TurnOnPlate(axis) => axis.cross(&point),
            Self::Scale => point,
            _ => Vector3::zeros(),
        }
    }

    /// Change of the unknowns of an object.
    fn of_object(self, object: &Object, own: &[f64]) -> Vector3<f64> {
        let place = Vector3::from_column_slice(own);
        match object.kind {
            ObjectKind::Target => self.of_plate(place),
            ObjectKind::Ball => self.of_point(place),
            ObjectKind::Surface => {
                let [u, v] = across(&object.normal);
                let normal = (object.normal + u * own[0] + v * own[1]).normalize();
                let turned = self.of_direction(normal);
                let point = normal * own[2];
                let offset = normal.dot(&self.of_point(point)) + turned.dot(&point);
                Vector3::new(u.dot(&turned), v.dot(&turned), offset)
            }
        }
    }
}

impl Shared<'_> {
    /// The motions that the shared unknowns can make.
    pub(super) fn motions(&self) -> Vec<Motion> {
        let mut kinds = Kind::all();
        if self.machine.robot.plate.is_in_plane() {
            kinds.retain(|(_, kind)| kind.stays_in_plane());
        }
        let places = self.places();
        let of_parameters = self.of_parameters(&kinds, &places);
        let motions = kinds.into_iter().zip(of_parameters);
        motions
            .filter_map(|((words, kind), of_parameters)| {
                let mut change = of_parameters?.resize_vertically(self.values.len(), 0.0);
                for object in self.objects {
                    let at = self.used.len() + object.first;
                    let moved = kind.of_object(object, &self.values[at..at + 3]);
                    let in_units =
                        moved.component_div(&Vector3::from_column_slice(&self.scale[at..at + 3]));
                    change.rows_mut(at, 3).copy_from(&in_units);
                }
                let size = change.norm();
                (size > 0.0).then(|| Motion {
                    words,
                    is_scale: kind == Kind::Scale,
                    change: change / size,
                    size,
                })
            })
            .collect()
    }

    /// Closures at more places than there are parameters to tell, none of them where the links hold the plate.
    fn places(&self) -> Vec<(Pose, Linearized)> {
        let freedoms = self.machine.pose_unknowns();
        let count = 2 * self
            .used
            .len()
            .div_ceil(self.machine.closure_count().max(1))
            + 4;
        let place = |index: usize| {
            let pose = &self.poses[index * self.poses.len() / count % self.poses.len()];
            let sample = pose.first_sample()?;
            let length_m = self.machine.mean_length_m(&sample.view()).ok()?;
            // Multiples of irrational numbers, modulo 1, fill a cube evenly.
            let part = |axis: usize| {
                let share = ((index + 1) as f64 * (axis as f64 + 0.5).sqrt()).fract();
                if freedoms.contains(&axis) {
                    2.0 * APART * (share - 0.5)
                } else {
                    0.0
                }
            };
            let shift = Vector3::from_fn(|axis, _| length_m * part(axis));
            let turn = Vector3::from_fn(|axis, _| part(3 + axis));
            let pose = pose.base.moved(shift, turn);
            let closures = Linearized::new(self.machine, &sample.view().at(pose)).ok()?;
            Some((pose, closures))
        };
        if self.poses.is_empty() {
            return vec![];
        }
        (0..count).filter_map(place).collect()
    }

    /// Changes of the parameters, in their units, by which they make motions; `None` for those that they can't.
    fn of_parameters(
        &self,
        kinds: &[(String, Kind)],
        places: &[(Pose, Linearized)],
    ) -> Vec<Option<DVector<f64>>> {
        let width = self.used.len();
        let closures = self.machine.closure_count();
        let mut by_parameters = DMatrix::zeros(closures * places.len(), width);
        let mut wanted = DMatrix::zeros(closures * places.len(), kinds.len());
        for (index, (pose, own)) in places.iter().enumerate() {
            for (row, entries) in own.by_parameters.iter().enumerate() {
                for (parameter, entry) in entries {
                    if let Ok(column) = self.used.binary_search(parameter) {
                        by_parameters[(closures * index + row, column)] =
                            entry * self.scale[column];
                    }
                }
            }
            for (column, (_, kind)) in kinds.iter().enumerate() {
                let change = kind.of_closures(own, pose);
                wanted
                    .view_mut((closures * index, column), (closures, 1))
                    .copy_from(&change);
            }
        }
        if width == 0 {
            let nothing = |column: DVector<f64>| (column.norm() == 0.0).then(|| DVector::zeros(0));
            return wanted
                .column_iter()
                .map(|column| nothing(column.into()))
                .collect();
        }
        let svd = by_parameters.clone().svd(true, true);
        let least = UNSEEN * svd.singular_values.max();
        let Ok(solution) = svd.solve(&wanted, least) else {
            return vec![None; kinds.len()];
        };
        let left = by_parameters * &solution - &wanted;
        let columns = solution
            .column_iter()
            .zip(left.column_iter().zip(wanted.column_iter()));
        columns
            .map(|(change, (left, wanted))| {
                (left.norm() <= LEFT * wanted.norm()).then(|| change.into())
            })
            .collect()
    }
}
