//! Targets, surfaces and balls that measurements are taken of or from.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{Matrix3, SymmetricEigen, Vector3};
use tau_codes::files;
use tau_robot::input_error::{InputError, suggestion};
use tau_robot::measurements::{Folder, ObjectKind, PlateKind};
use tau_robot::robot_file::{Measuring, Value};

use crate::machine::error::Error;
use crate::numerics::order::smallest_first;

/// Places of a target, a surface or a ball among the shared unknowns, behind the parameters of the variant.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Its kind.
    pub kind: ObjectKind,
    /// Its name; empty for the only ball.
    pub name: String,
    /// Index of its first unknown behind the variant's.
    pub(super) first: usize,
    /// Its unknowns, which stand one behind the other.
    pub(super) unknowns: Vec<ObjectUnknown>,
    /// Normal at no tilt, of surfaces.
    pub(super) normal: Vector3<f64>,
}

#[derive(Debug, Clone, PartialEq)]
pub(super) struct ObjectUnknown {
    pub(super) name: String,
    pub(super) unit: &'static str,
    pub(super) start: f64,
    /// Mean and standard deviation.
    pub(super) prior: Option<(f64, f64)>,
}

/// Targets, surfaces and balls of unknown place that rows of `poses` are taken of or from; poses, by number, are where they
/// are taken to be.
///
/// # Errors
/// A name that the robot file does not list.
pub(super) fn collect_objects(
    folder: &Folder,
    measuring: &Measuring,
    poses: &BTreeMap<u32, Vector3<f64>>,
) -> Result<Vec<Object>, Error> {
    refuse_unknown_names(folder, measuring)?;
    let mut objects: Vec<Object> = vec![];
    for kind in [PlateKind::Position, PlateKind::Height, PlateKind::BallBar] {
        let Some(object) = kind.object() else {
            continue;
        };
        let names: BTreeSet<Option<&String>> = (folder.rows_of(kind))
            .filter(|row| poses.contains_key(&row.pose))
            .map(|row| row.of.as_ref())
            .collect();
        for name in names {
            // Without a name: the TCP itself, the plane z = 0; but a ball is always somewhere.
            let Some(name) = name
                .map(String::as_str)
                .or((object == ObjectKind::Ball).then_some(""))
            else {
                continue;
            };
            let first = objects.iter().map(|object| object.unknowns.len()).sum();
            let rows: Vec<(Vector3<f64>, f64)> = (folder.rows_of(kind))
                .filter(|row| row.of.as_deref().unwrap_or("") == name)
                .filter_map(|row| Some((*poses.get(&row.pose)?, row.values[0]?)))
                .collect();
            let (unknowns, normal) = unknowns(object, name, measuring, &rows);
            objects.push(Object {
                kind: object,
                name: name.to_owned(),
                first,
                unknowns,
                normal,
            });
        }
    }
    Ok(objects)
}

/// Refuses names that the robot file does not list, where it lists some of their kind.
fn refuse_unknown_names(folder: &Folder, measuring: &Measuring) -> Result<(), InputError> {
    for row in &folder.plate_rows {
        let Some(object) = row.kind.object() else {
            continue;
        };
        let known: Vec<&str> = match object {
            ObjectKind::Target => measuring.targets.keys().map(String::as_str).collect(),
            ObjectKind::Surface => measuring.surfaces.keys().map(String::as_str).collect(),
            ObjectKind::Ball => measuring.balls.keys().map(String::as_str).collect(),
        };
        let is_ball = object == ObjectKind::Ball;
        let name = row.of.as_deref().or(is_ball.then_some(""));
        let Some(name) = name.filter(|name| !known.is_empty() && !known.contains(name)) else {
            continue;
        };
        let place = format!("{}/{}:{}", folder.name, row.kind.file(), row.line);
        let (column, section) = (object.column(), object.section());
        let message = format!("{column} `{name}` is in no `[{section}.NAME]` of the robot file");
        return Err(
            InputError::whole(files::UNKNOWN_NAME, place, message).help(suggestion(name, known))
        );
    }
    Ok(())
}

/// Unknowns of an object, and its normal at no tilt; `rows` are places of the TCP with what was measured there.
fn unknowns(
    kind: ObjectKind,
    name: &str,
    measuring: &Measuring,
    rows: &[(Vector3<f64>, f64)],
) -> (Vec<ObjectUnknown>, Vector3<f64>) {
    let called = if name.is_empty() { "ball" } else { name };
    let axes = ["x", "y", "z"];
    let place = |start: Vector3<f64>, stated: Option<&Value>| {
        let coordinate = |axis: usize| ObjectUnknown {
            name: format!("{called}.{}", axes[axis]),
            unit: "m",
            start: start[axis],
            prior: stated.map(|stated| (stated.value[axis], stated.tol)),
        };
        (0..3).map(coordinate).collect()
    };
    match kind {
        ObjectKind::Surface => {
            let stated = measuring.surfaces.get(name);
            let normal = match stated {
                Some(surface) => Vector3::from_column_slice(&surface.normal.value).normalize(),
                None => normal_of_surface(rows),
            };
            let tilt = |axis: &str| ObjectUnknown {
                name: format!("{called}.tilt.{axis}"),
                unit: "rad",
                start: 0.0,
                prior: stated.map(|surface| (0.0, surface.normal.tol)),
            };
            let count = rows.len().max(1) as f64;
            let mean = rows
                .iter()
                .map(|(at, height)| normal.dot(at) - height)
                .sum::<f64>()
                / count;
            let offset = ObjectUnknown {
                name: format!("{called}.offset"),
                unit: "m",
                start: stated.map_or(mean, |surface| surface.offset.value[0]),
                prior: stated.map(|surface| (surface.offset.value[0], surface.offset.tol)),
            };
            (vec![tilt("1"), tilt("2"), offset], normal)
        }
        ObjectKind::Ball => {
            let stated = measuring.balls.get(name);
            (place(place_of_ball(rows, stated), stated), Vector3::z())
        }
        ObjectKind::Target => {
            let stated = measuring.targets.get(name);
            let start = stated.map_or(Vector3::zeros(), stated_place);
            (place(start, stated), Vector3::z())
        }
    }
}

/// Normal of a plane, to start from, whose distances from points are nearest to those of `rows`.
///
/// The gradient of the distances is the normal. Points that hardly spread along one direction tell little of that coordinate;
/// there its length may tell more, but for the side. Of these the one is taken that misses the least, up where none does.
fn normal_of_surface(rows: &[(Vector3<f64>, f64)]) -> Vector3<f64> {
    // Fewer are on any plane.
    if rows.len() < 3 {
        return Vector3::z();
    }
    let cloud = Cloud::new(rows);
    let mut by_differences = cloud.gradient(|(_, height)| *height);
    let whole = cloud.axes * by_differences;
    by_differences[cloud.least] = 0.0;
    let across = cloud.axes * by_differences;
    let along = cloud.axes.column(cloud.least);
    let rest = (1.0 - across.norm_squared()).max(0.0).sqrt();
    let up = rest.copysign(along.z);
    let mean = cloud.mean_of(|(_, height)| *height);
    let missed = |normal: &Vector3<f64>| {
        cloud.mean_of(|(at, height)| (height - mean - normal.dot(&(at - cloud.mean))).powi(2))
    };
    let all = [whole, across + along * up, across - along * up];
    let mut normals: Vec<Vector3<f64>> = (all
        .iter()
        .filter_map(|normal| normal.try_normalize(f64::EPSILON)))
    .collect();
    smallest_first(&mut normals, missed);
    normals.first().copied().unwrap_or(Vector3::z())
}

/// Places of the TCP with what was measured there, and how they spread.
struct Cloud<'a> {
    rows: &'a [(Vector3<f64>, f64)],
    mean: Vector3<f64>,
    /// Principal axes, and the sum of squares along each.
    axes: Matrix3<f64>,
    spreads: Vector3<f64>,
    /// The axis along which they spread least.
    least: usize,
}

impl<'a> Cloud<'a> {
    fn new(rows: &'a [(Vector3<f64>, f64)]) -> Self {
        let count = rows.len().max(1) as f64;
        let mean = rows.iter().map(|(at, _)| at).sum::<Vector3<f64>>() / count;
        let scatter = rows.iter().fold(Matrix3::zeros(), |sum, (at, _)| {
            sum + (at - mean) * (at - mean).transpose()
        });
        let SymmetricEigen {
            mut eigenvectors,
            eigenvalues,
        } = scatter.symmetric_eigen();
        // An axis of either sign is one; here its largest coordinate is positive.
        for mut axis in eigenvectors.column_iter_mut() {
            if axis[axis.iamax()] < 0.0 {
                axis.neg_mut();
            }
        }
        Self {
            rows,
            mean,
            axes: eigenvectors,
            least: eigenvalues.imin(),
            spreads: eigenvalues,
        }
    }

    fn mean_of(&self, of: impl Fn(&(Vector3<f64>, f64)) -> f64) -> f64 {
        self.rows.iter().map(of).sum::<f64>() / self.rows.len().max(1) as f64
    }

    /// Slopes of a quantity along the axes, by least squares; zero along those that tell nothing.
    fn gradient(&self, of: impl Fn(&(Vector3<f64>, f64)) -> f64) -> Vector3<f64> {
        let mean = self.mean_of(&of);
        let products = self
            .rows
            .iter()
            .map(|row| (row.0 - self.mean) * (of(row) - mean));
        let products = self.axes.transpose() * products.sum::<Vector3<f64>>();
        Vector3::from_fn(|axis, _| {
            let is_told = self.spreads[axis] > f64::EPSILON * self.spreads.max();
            if is_told {
                products[axis] / self.spreads[axis]
            } else {
                0.0
            }
        })
    }
}

fn stated_place(stated: &Value) -> Vector3<f64> {
    Vector3::from_column_slice(&stated.value)
}

/// Place of a ball, to start from: as stated, or else the centre of the sphere whose distances from points are nearest to
/// those of `rows`, by the linear equations of differences of squares.
///
/// These tell little along the direction in which the points spread least, nothing where a plate moves in a plane. The mean
/// of the squares tells how far the ball is off in all, and so how far along that direction, but for the side. There the
/// distances depend on the square of its height alone, and a fit that starts in the plane is blind to it: none starts
/// nearer than the squares are uncertain. Of a plane z = 0 it is taken to be above.
fn place_of_ball(rows: &[(Vector3<f64>, f64)], stated: Option<&Value>) -> Vector3<f64> {
    let cloud = Cloud::new(rows);
    let Cloud {
        mean, axes, least, ..
    } = cloud;
    let square =
        |(at, distance): &(Vector3<f64>, f64)| (at - mean).norm_squared() - distance * distance;
    let average = cloud.mean_of(square);
    let mut found = cloud.gradient(|row| 0.5 * square(row));
    let told = std::mem::take(&mut found[least]);
    let in_plane = axes * found;
    let misfit = |row: &(Vector3<f64>, f64)| {
        (square(row) - average - 2.0 * in_plane.dot(&(row.0 - mean))).powi(2)
    };
    let uncertain = cloud.mean_of(misfit).sqrt();
    let spread = (cloud.spreads[least] / rows.len().max(1) as f64).max(0.0);
    if let Some(stated) = stated {
        let place = stated_place(stated);
        let height_m = axes.column(least).dot(&(place - mean));
        let is_blind = spread.max(height_m * height_m) < uncertain;
        let off_m = uncertain.sqrt().min(stated.tol).copysign(height_m);
        return place + axes.column(least) * if is_blind { off_m } else { 0.0 };
    }
    let square = (-average - in_plane.norm_squared()).max(uncertain);
    found[least] = if spread > square {
        told
    } else {
        square.sqrt().copysign(told)
    };
    mean + axes * found
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Points of a box, by its sides (m), with their distances from a plane.
    fn rows(sides: [f64; 3], normal: Vector3<f64>) -> Vec<(Vector3<f64>, f64)> {
        let at = |k: u32| {
            let share = |axis: u32| f64::from((k * (3 + 2 * axis)) % 11) / 11.0 - 0.5;
            Vector3::new(
                sides[0] * share(0),
                sides[1] * share(1),
                sides[2] * share(2),
            )
        };
        let at = (0..40).map(|k| at(k) + Vector3::new(0.3, -0.2, 0.5));
        at.map(|at| (at, normal.dot(&at) + 0.7)).collect()
    }

    /// Machines in space, one whose plate stays at a height, and one in a plane; planes that lie, stand and lean.
    #[test]
    fn normals_of_planes_are_told_by_distances() {
        for sides in [[0.4, 0.5, 0.3], [0.4, 0.5, 0.0]] {
            for normal in [
                [0.0, 0.0, 1.0],
                [1.0, 0.0, 0.0],
                [-0.3, 0.8, 0.5],
                [0.0, -1.0, 0.0],
            ] {
                let normal = Vector3::from(normal).normalize();
                let found = normal_of_surface(&rows(sides, normal));
                assert!(
                    (found - normal).norm() < 1e-6,
                    "{sides:?} {normal}: {found}"
                );
            }
        }
        assert_eq!(normal_of_surface(&[]), Vector3::z());
    }

    /// A ball beside the plane of a machine is taken to be above.
    #[test]
    fn a_ball_beside_a_plane_is_above_it() {
        for height_m in [0.4, -0.4] {
            let ball = Vector3::new(0.5, 0.1, height_m);
            let rows: Vec<(Vector3<f64>, f64)> = (rows([0.4, 0.5, 0.0], Vector3::z()).iter())
                .map(|(at, _)| Vector3::new(at.x, at.y, 0.0))
                .map(|at| (at, (at - ball).norm()))
                .collect();
            let found = place_of_ball(&rows, None);
            assert!(
                (found - Vector3::new(0.5, 0.1, 0.4)).norm() < 1e-6,
                "{found}"
            );
        }
    }
}
