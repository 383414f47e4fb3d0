//! Errors of the tracker where true poses are unknown: they are part of what was measured, and of nothing else.

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;

use tau_codes::{files, fit};
use tau_kinematics::{Machine, Missing, Pose};
use tau_robot::input_error::InputError;
use tau_robot::measurements::{PlateRow, TcpPose};
use tau_robot::robot::{Input, Instance, ResidualKind, Variant};
use tau_runtime::{Pattern, ResidualFamily, Shape};

use crate::joint::variant::at_true_poses;
use crate::machine::error::Error;
use crate::numerics::number;
use crate::numerics::order::place;
use crate::samples::Sample;
use crate::setup::Setup;

/// The variant that a folder with unknown poses is fitted with: closures of true poses, errors of the tracker apart.
///
/// # Errors
/// The variant has errors of a tracker, and no row of the plate was measured by one.
pub(super) fn of_true_poses(setup: Setup<'_>) -> Result<Cow<'_, Variant>, Error> {
    let Setup {
        robot,
        variant,
        folder,
        ..
    } = setup;
    let effects = variant.tracker_effects();
    let Some(effect) = effects.first() else {
        return Ok(Cow::Borrowed(variant));
    };
    if let Some(file) = folder.measured_without_tracker() {
        let message = format!(
            "`{effect}` of variant `{}` is an error of the tracker, and {file} is measured without it",
            variant.name
        );
        let help = "take a variant without it, or add positions or poses that a tracker measured";
        return Err(InputError::whole(fit::NO_TRACKER, &folder.name, message)
            .help(help)
            .into());
    }
    let mut variants = robot.model.variants.iter();
    let index = variants.position(|own| own.name == variant.name);
    let known = index.map(|index| at_true_poses(&robot.model, index, variant));
    let unknown = || {
        let message = format!("variant `{}` is not in its description", variant.name);
        InputError::whole(files::NO_SUCH_VARIANT, &robot.name, message).into()
    };
    known.map(Cow::Owned).ok_or_else(unknown)
}

/// A pose as a tracker measured it, with its context.
pub(super) fn pose_sample(row: &TcpPose) -> Sample {
    Sample::of_drives(
        row.pose,
        &row.commands_m,
        [&row.directions, &row.tensions_n].map(Option::as_deref),
        row.conditions,
        Pose::from_zyz(row.position_m, row.angles_rad),
    )
}

/// A position as a tracker measured it, with its context. A coordinate that was not measured is where the plate is taken to
/// be: errors change little on the way.
pub(super) fn position_sample(row: &PlateRow, mut pose: Pose) -> Sample {
    for (axis, value) in row.values.iter().enumerate() {
        pose.position[axis] = value.unwrap_or(pose.position[axis]);
    }
    Sample::of_drives(
        row.pose,
        &row.commands_m,
        [&row.directions, &row.tensions_n].map(Option::as_deref),
        row.conditions,
        pose,
    )
}

/// The tracker's errors along the axes, as a function of the parameters of the variant.
#[derive(Debug, Clone)]
pub(super) struct TrackerErrors {
    axes: [Axis; 3],
    inputs: Vec<Input>,
    /// Indices in the variant.
    pub(super) parameters: Vec<usize>,
}

/// The error along an axis, with the places of its data and parameters among those of all three.
#[derive(Debug, Clone)]
struct Axis {
    instance: Instance,
    data: Vec<usize>,
    parameters: Vec<usize>,
}

/// Union of some numbers, ascending.
fn union<T: Ord>(of: impl Iterator<Item = T>) -> Vec<T> {
    of.collect::<BTreeSet<T>>().into_iter().collect()
}

impl TrackerErrors {
    /// Those of a variant, if it has some.
    pub(super) fn of(variant: &Variant) -> Option<Self> {
        let instances = variant.instances_of(ResidualKind::TrackerError);
        let instances: Vec<&Instance> = instances.collect();
        let instances: [&Instance; 3] = instances.try_into().ok()?;
        let all = || instances.iter();
        let inputs = union(all().flat_map(|own| own.inputs.iter().copied()));
        let parameters = union(all().flat_map(|own| own.parameters.iter().copied()));
        let axes = instances.map(|instance| {
            let datum = |input| place(&inputs, input);
            let parameter = |index| place(&parameters, index);
            Axis {
                data: instance.inputs.iter().map(datum).collect(),
                parameters: instance.parameters.iter().map(parameter).collect(),
                instance: instance.clone(),
            }
        });
        Some(Self {
            axes,
            inputs,
            parameters,
        })
    }

    /// Their parameters at the values of a machine.
    pub(super) fn values(&self, machine: &Machine) -> Vec<f64> {
        let own = self.parameters.iter();
        own.map(|&index| machine.values[index]).collect()
    }

    /// Appends the data of a sample at the measured position.
    ///
    /// # Errors
    /// The missing column or value.
    pub(super) fn fill(
        &self,
        machine: &Machine,
        sample: &Sample,
        data: &mut Vec<f64>,
    ) -> Result<(), Missing> {
        let surroundings = &machine.surroundings;
        surroundings.fill(&self.inputs, &sample.view(), data)
    }

    /// The errors (m) at a sample's data, and of each axis the derivatives by the parameters, which `visit` gets by axis and place.
    pub(super) fn at(
        &self,
        data: &[f64],
        parameters: &[f64],
        mut visit: impl FnMut(usize, usize, f64),
    ) -> [f64; 3] {
        std::array::from_fn(|axis| {
            let own = &self.axes[axis];
            let family = &own.instance.family;
            let data: Vec<f64> = own.data.iter().map(|&place| data[place]).collect();
            let mut prepared = vec![0.0; family.shape().prepared];
            family.prepare(&data, &mut prepared);
            let taken = own.parameters.iter();
            let taken: Vec<f64> = taken.map(|&place| parameters[place]).collect();
            let mut error = [0.0];
            let pattern = family.pattern();
            let mut entries = vec![0.0; pattern.len()];
            family.linearize(&prepared, &taken, &mut error, &mut entries);
            for (&column, entry) in pattern.columns.iter().zip(entries) {
                visit(axis, own.parameters[column as usize], entry);
            }
            error[0]
        })
    }
}

/// Residuals of a pose that a tracker measured, with its errors: the quantity plus the errors, less what was measured.
///
/// A sample's data are those of the errors, then the quantity's; parameters likewise. The first three residuals are the
/// coordinates.
pub(super) struct WithErrors {
    quantity: Arc<dyn ResidualFamily>,
    errors: Arc<TrackerErrors>,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
}

impl WithErrors {
    pub(super) fn new(quantity: Arc<dyn ResidualFamily>, errors: Arc<TrackerErrors>) -> Self {
        let first = errors.parameters.len();
        let (mut row_starts, mut columns) = (vec![0], vec![]);
        let pattern = quantity.pattern();
        for row in 0..quantity.shape().residuals {
            if row < 3 {
                columns.extend((0..first).map(number));
            }
            let own = pattern.row_starts[row] as usize..pattern.row_starts[row + 1] as usize;
            let own = pattern.columns[own].iter();
            columns.extend(own.map(|&column| column + number(first)));
            row_starts.push(number(columns.len()));
        }
        Self {
            quantity,
            errors,
            row_starts,
            columns,
        }
    }

    /// Number of the errors' data, and of their parameters.
    fn first(&self) -> [usize; 2] {
        [self.errors.inputs.len(), self.errors.parameters.len()]
    }
}

impl ResidualFamily for WithErrors {
    fn shape(&self) -> Shape {
        let (of, [data, parameters]) = (self.quantity.shape(), self.first());
        Shape {
            data: of.data + data,
            prepared: of.prepared + data,
            parameters: of.parameters + parameters,
            residuals: of.residuals,
        }
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        let [first, _] = self.first();
        prepared[..first].copy_from_slice(&data[..first]);
        (self.quantity).prepare(&data[first..], &mut prepared[first..]);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let [data, first] = self.first();
        (self.quantity).value(&prepared[data..], &parameters[first..], residuals);
        let errors = self.errors.at(prepared, parameters, |_, _, _| ());
        for (residual, error) in residuals.iter_mut().zip(errors) {
            *residual += error;
        }
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let [data, first] = self.first();
        let pattern = self.quantity.pattern();
        let mut own = vec![0.0; pattern.len()];
        (self.quantity).linearize(&prepared[data..], &parameters[first..], residuals, &mut own);
        let mut entries = own.into_iter();
        for row in 0..residuals.len() {
            let start = self.row_starts[row] as usize + if row < 3 { first } else { 0 };
            let end = self.row_starts[row + 1] as usize;
            jacobian[start - if row < 3 { first } else { 0 }..start].fill(0.0);
            for (entry, own) in jacobian[start..end].iter_mut().zip(&mut entries) {
                *entry = own;
            }
        }
        let errors = self.errors.at(prepared, parameters, |axis, column, entry| {
            jacobian[self.row_starts[axis] as usize + column] += entry;
        });
        for (residual, error) in residuals.iter_mut().zip(errors) {
            *residual += error;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::quantity::{Measured, Quantity};
    use tau_robot::robot::Robot;

    use super::*;

    const TEXT: &str = "
        effect wave on tcp {
            param a: length; param b[3]: velocity; search p: length in 100 mm ..= 1 m;
            position += (a * sin(2*pi*x/p), 0 mm, a * y * z / (1 m)^2);
            position += b * time;
        }
        robot Slide {
            track one; cluster arm on one { link k, l, m, n, o, p; }
            variant Plain { arm full; tracks linear per link; }
            variant Waving = Plain + wave(tcp);
        }";

    /// Errors by hand, and six-point central differences of each residual by each parameter.
    #[test]
    fn errors_join_what_was_measured() {
        let robot = Robot::from_text(TEXT).unwrap();
        assert!(TrackerErrors::of(robot.variant("Plain").unwrap()).is_none());
        let variant = robot.variant("Waving").unwrap();
        let errors = Arc::new(TrackerErrors::of(variant).unwrap());
        let named = |name: &str| -> usize {
            let index = variant.index_of(&format!("wave(tcp).{name}"));
            errors.parameters.binary_search(&index).unwrap()
        };
        let mut of_errors = [0.0; 5];
        for (name, value) in [
            ("a", 3e-2),
            ("b.x", 1e-2),
            ("b.y", -2e-2),
            ("b.z", 4e-2),
            ("p", 0.7),
        ] {
            of_errors[named(name)] = value;
        }
        let (position, time) = ([0.3, -0.2, 0.9], 2.5);
        let datum = |input: &Input| match *input {
            Input::Position(axis) => position[axis],
            Input::Time => time,
            ref other => panic!("{other:?}"),
        };
        let data: Vec<f64> = errors.inputs.iter().map(datum).collect();
        let expected = [
            3e-2 * (std::f64::consts::TAU * 0.3 / 0.7).sin() + 1e-2 * time,
            -2e-2 * time,
            3e-2 * (-0.2 * 0.9) + 4e-2 * time,
        ];
        let found = errors.at(&data, &of_errors, |_, _, _| ());
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-15, "{found} {expected}");
        }

        for quantity in [Quantity::Pose, Quantity::Tcp, Quantity::Target] {
            let inner: Arc<dyn ResidualFamily> = Arc::new(Measured::new(quantity));
            let family = WithErrors::new(Arc::clone(&inner), Arc::clone(&errors));
            let (of, shape) = (inner.shape(), family.shape());
            let pose = |at| super::super::quantity::base(&Pose::from_zyz(position, at));
            let mut data = data.clone();
            data.extend(pose([0.4, 0.9, -1.2]));
            data.extend(pose([0.5, 0.8, -1.1]));
            data.truncate(shape.data);
            let mut at = of_errors.to_vec();
            at.extend((0..of.parameters).map(|k| 0.03 * (k as f64 - 2.5)));
            let residuals = |family: &dyn ResidualFamily, data: &[f64], at: &[f64]| {
                let mut residuals = vec![0.0; family.shape().residuals];
                let mut prepared = vec![0.0; family.shape().prepared];
                family.prepare(data, &mut prepared);
                family.value(&prepared, at, &mut residuals);
                residuals
            };
            let with = residuals(&family, &data, &at);
            let without = residuals(&*inner, &data[errors.inputs.len()..], &at[5..]);
            for (row, (with, without)) in with.iter().zip(without).enumerate() {
                let error = expected.get(row).copied().unwrap_or_default();
                assert!((with - without - error).abs() < 1e-14, "{quantity:?} {row}");
            }
            let mut prepared = vec![0.0; shape.prepared];
            family.prepare(&data, &mut prepared);
            let mut again = vec![0.0; shape.residuals];
            let mut entries = vec![f64::NAN; family.pattern().len()];
            family.linearize(&prepared, &at, &mut again, &mut entries);
            assert_eq!(again, with);
            let pattern = family.pattern();
            for column in 0..shape.parameters {
                let moved = |steps: f64| {
                    let mut at = at.clone();
                    at[column] += steps * 1e-3;
                    residuals(&family, &data, &at)
                };
                let pairs = [1.0, 2.0, 3.0].map(|s| (moved(s), moved(-s)));
                for row in 0..shape.residuals {
                    let slope = |k: usize| pairs[k].0[row] - pairs[k].1[row];
                    let expected = (slope(0) * 45.0 - slope(1) * 9.0 + slope(2)) / 60e-3;
                    let own =
                        pattern.row_starts[row] as usize..pattern.row_starts[row + 1] as usize;
                    let own = pattern.columns[own.clone()].iter().zip(&entries[own]);
                    let found = own.filter(|(entry, _)| **entry as usize == column);
                    let found: f64 = found.map(|(_, entry)| entry).sum();
                    assert!(
                        (found - expected).abs() < 1e-8,
                        "{quantity:?} {row} {column}: {found} {expected}"
                    );
                }
            }
        }
    }
}
