//! A variant with numbers in place: what kinematics, evaluation and sensitivity work on.

use nalgebra::{DMatrix, DVector};
use tau_robot::robot::{Arm, Input, Instance, ResidualKind, Robot, TrackShape, Variant};

use super::Error;
use super::inputs::{Sample, Surroundings, reads_forces};
use super::paths::Path;
use super::pose::POSE_COLUMNS;

/// A variant of a robot with a value for each parameter.
#[derive(Debug, Clone)]
pub struct Machine {
    /// The robot.
    pub robot: Robot,
    /// The variant.
    pub variant: Variant,
    /// Value of each of the variant's parameters, SI.
    pub values: Vec<f64>,
    /// Measured paths and loads.
    pub surroundings: Surroundings,
}

/// All closures at one pose and commands, each divided by the length of its gradient in the plate's
/// position, so that residuals are errors of link length (m) to first order.
#[derive(Debug, Clone)]
pub struct Closures {
    /// One per closure (m).
    pub residuals: DVector<f64>,
    /// Derivatives by translation (m), rotation vector in the measurement frame (rad) and commands
    /// (m): one row per closure, `6 + commands` columns.
    pub jacobian: DMatrix<f64>,
    /// Divisor of each (m), 1 where the closure does not depend on the position.
    pub slopes: DVector<f64>,
}

impl Default for Closures {
    /// None.
    fn default() -> Self {
        Self {
            residuals: DVector::zeros(0),
            jacobian: DMatrix::zeros(0, 0),
            slopes: DVector::zeros(0),
        }
    }
}

impl Closures {
    /// Those of a machine at a sample, in the place of others.
    ///
    /// # Errors
    /// As [`Machine::closures`].
    pub(crate) fn fill(
        &mut self,
        machine: &Machine,
        sample: &Sample<'_>,
        scratch: &mut Scratch,
    ) -> Result<(), Error> {
        let commands = machine.robot.commands;
        if sample.commands_m.len() != commands {
            return Err(Error::Commands {
                found: sample.commands_m.len(),
                expected: commands,
            });
        }
        let count = machine.closure_count();
        if self.jacobian.shape() != (count, POSE_COLUMNS + commands) {
            self.residuals = DVector::zeros(count);
            self.slopes = DVector::zeros(count);
            self.jacobian = DMatrix::zeros(count, POSE_COLUMNS + commands);
        }
        // Data of all closures, for which forces are found once.
        let mut data = std::mem::take(&mut scratch.data);
        data.clear();
        machine.fill_kind(ResidualKind::ClosureByPose, sample, &mut data)?;
        let mut rest = data.as_slice();
        for (row, instance) in machine.closure_instances().enumerate() {
            let own;
            (own, rest) = rest.split_at(instance.family.shape().data);
            let residual = scratch.linearize_filled(machine, instance, own)?;
            let pattern = instance.family.pattern();
            let entries = || pattern.columns.iter().zip(&scratch.jacobian);
            let by_position = entries().filter(|&(&column, _)| column < 3);
            let square: f64 = by_position.map(|(_, entry)| entry * entry).sum();
            let slope = if square > 0.0 { square.sqrt() } else { 1.0 };
            let scale = slope.recip();
            self.residuals[row] = residual * scale;
            self.slopes[row] = slope;
            // Other places stay zero: the pattern of a closure is always the same.
            for (&column, entry) in entries() {
                let column = motion_column(instance, column as usize);
                self.jacobian[(row, column)] = entry * scale;
            }
        }
        scratch.data = data;
        Ok(())
    }
}

/// A link or cluster as it is, and as a pose would have it.
pub(crate) struct Span {
    /// Its name.
    pub(crate) closure: String,
    /// The length that it has (m).
    pub(crate) length_m: f64,
    /// The distance that it bridges (m).
    pub(crate) distance_m: f64,
    /// The part of that distance (m) which no motion of the plate changes: across the plane of a plate that stays in one.
    pub(crate) across_m: f64,
}

impl Machine {
    /// The closure that is farthest from holding at a sample. Residuals say so only to first order, and in a plane of the
    /// level parts alone.
    pub(crate) fn farthest(&self, closures: &Closures, sample: &Sample<'_>) -> Option<Span> {
        let of_row = |(row, closure): (usize, &Instance)| {
            let slope = closures.slopes[row];
            // A closure is the square of a length less that of a distance, by which its slope is twice the distance.
            let along = slope / 2.0 * closures.jacobian.fixed_view::<1, 3>(row, 0).norm();
            let across_m = if self.robot.plate.is_in_plane() {
                let [base, plate] = self.ends(closure, &sample.pose, sample.commands_m);
                (plate - base).z.abs()
            } else {
                0.0
            };
            let distance_m = along.hypot(across_m);
            let square = closures.residuals[row] * slope + distance_m * distance_m;
            Span {
                closure: self.closure_name(closure).to_owned(),
                length_m: square.max(0.0).sqrt(),
                distance_m,
                across_m,
            }
        };
        let off_m = |span: &Span| (span.length_m - span.distance_m).abs();
        let spans = self.closure_instances().enumerate().map(of_row);
        spans.max_by(|a, b| off_m(a).total_cmp(&off_m(b)))
    }

    /// Closures by pose, in order of link or cluster.
    pub fn closure_instances(&self) -> impl Iterator<Item = &Instance> {
        self.variant.instances_of(ResidualKind::ClosureByPose)
    }

    /// Number of closures.
    pub fn closure_count(&self) -> usize {
        self.closure_instances().count()
    }

    /// Index of the track whose cart carries the link or cluster of a closure; `None` on the fixed base.
    pub fn track_of(&self, closure: &Instance) -> Option<usize> {
        let cluster = match self.variant.arm {
            Arm::Full => self.robot.links.get(closure.of)?.cluster,
            Arm::Reduced => closure.of,
        };
        self.robot.clusters.get(cluster)?.track
    }

    /// The measured path that a piecewise track passes along, given by index.
    pub fn measured_path(&self, track: usize) -> Option<&Path> {
        let shape = self.variant.tracks.get(track)?.shape;
        let path = self.surroundings.paths.get(track)?.as_ref();
        path.filter(|_| shape == TrackShape::Piecewise)
    }

    /// Name of the link or cluster of an instance.
    pub fn closure_name(&self, instance: &Instance) -> &str {
        match self.variant.arm {
            Arm::Full => self
                .robot
                .links
                .get(instance.of)
                .map_or("?", |link| &link.name),
            Arm::Reduced => self
                .robot
                .clusters
                .get(instance.of)
                .map_or("?", |cluster| &cluster.name),
        }
    }

    /// The same with other values, one for each of the variant's parameters.
    ///
    /// # Panics
    /// There are fewer or more of them.
    #[must_use]
    pub fn with_values(&self, values: Vec<f64>) -> Self {
        let (found, expected) = (values.len(), self.variant.parameters.len());
        assert_eq!(
            found, expected,
            "one value for each parameter of the variant"
        );
        Self {
            values,
            ..self.clone()
        }
    }

    /// True if closures depend on forces of the arm.
    pub fn reads_forces(&self) -> bool {
        self.closure_instances().any(reads_forces)
    }

    /// Appends the data that a closure takes of a sample.
    ///
    /// # Errors
    /// [`Error::Missing`] where neither the sample nor the surroundings give what it takes.
    pub fn fill(
        &self,
        closure: &Instance,
        sample: &Sample<'_>,
        data: &mut Vec<f64>,
    ) -> Result<(), Error> {
        let filled = self.surroundings.fill(&closure.inputs, sample, data);
        filled.map_err(|what| Error::Missing {
            closure: self.closure_name(closure).to_owned(),
            what,
            effects: Box::default(),
        })
    }

    /// Appends the data that all closures by parameters take of a sample, one after the other.
    ///
    /// # Errors
    /// As [`Self::fill`], of the first closure that lacks something.
    pub fn fill_closures(&self, sample: &Sample<'_>, data: &mut Vec<f64>) -> Result<(), Error> {
        self.fill_kind(ResidualKind::Closure, sample, data)
    }

    /// The same of the instances of a kind.
    fn fill_kind(
        &self,
        kind: ResidualKind,
        sample: &Sample<'_>,
        data: &mut Vec<f64>,
    ) -> Result<(), Error> {
        let closures = || self.variant.instances_of(kind);
        let inputs = closures().map(|closure| closure.inputs.as_slice());
        if self.surroundings.fill_all(inputs, sample, data).is_ok() {
            return Ok(());
        }
        closures().try_for_each(|closure| self.fill(closure, sample, &mut Vec::new()))
    }

    /// All closures with their derivatives at a sample.
    ///
    /// # Errors
    /// Data that the sample lacks; a wrong number of commands; a number that is not finite.
    pub fn closures(&self, sample: &Sample<'_>) -> Result<Closures, Error> {
        let mut closures = Closures::default();
        closures.fill(self, sample, &mut Scratch::default())?;
        Ok(closures)
    }

    /// Derivatives of all closures (m²) at a sample by parameters: of each the index in the variant and the entry.
    ///
    /// # Errors
    /// As [`Self::closures`].
    pub fn closures_by_parameters(
        &self,
        sample: &Sample<'_>,
    ) -> Result<Vec<Vec<(usize, f64)>>, Error> {
        let (mut data, mut scratch) = (Vec::new(), Scratch::default());
        self.fill_closures(sample, &mut data)?;
        let mut rest = data.as_slice();
        let of_closure = |closure: &Instance| {
            let own;
            (own, rest) = rest.split_at(closure.family.shape().data);
            scratch.linearize_filled(self, closure, own)?;
            let columns = closure.family.pattern().columns.iter();
            let parameters = columns.map(|&column| closure.parameters[column as usize]);
            Ok(parameters.zip(scratch.jacobian.iter().copied()).collect())
        };
        let closures = self.variant.instances_of(ResidualKind::Closure);
        closures.map(of_closure).collect()
    }

    /// Gradients of all closures by position (3) and rotation vector (3), in order of link or cluster.
    ///
    /// # Errors
    /// As [`Self::closure_by_pose`].
    pub fn gradients(&self, sample: &Sample<'_>) -> Result<Vec<[f64; POSE_COLUMNS]>, Error> {
        let mut scratch = Scratch::default();
        self.closure_instances()
            .map(|instance| {
                scratch.linearize(self, instance, sample)?;
                Ok(scratch.gradient(instance))
            })
            .collect()
    }

    /// Gradients of one closure by position (3) and rotation vector (3) at samples.
    ///
    /// # Errors
    /// As [`Self::closure_by_pose`].
    pub fn gradients_at<'a>(
        &self,
        instance: &Instance,
        samples: impl Iterator<Item = Sample<'a>>,
    ) -> impl Iterator<Item = Result<[f64; POSE_COLUMNS], Error>> {
        let mut scratch = Scratch::default();
        samples.map(move |sample| {
            scratch.linearize(self, instance, &sample)?;
            Ok(scratch.gradient(instance))
        })
    }

    /// Scatter of the closures (m²) from the noise of drives and links: closures × independent deviations, so that the
    /// product with its transpose is their covariance. No columns where nothing scatters.
    ///
    /// # Errors
    /// As [`Self::closures`].
    pub fn length_scatter(&self, sample: &Sample<'_>) -> Result<DMatrix<f64>, Error> {
        let noise = &self.surroundings.length_noise;
        if !noise.is_any() {
            return Ok(DMatrix::zeros(self.closure_count(), 0));
        }
        let closures = self.closures(sample)?;
        let mut scatter = noise.scatter(&closures.jacobian);
        for (mut row, slope) in scatter.row_iter_mut().zip(closures.slopes.iter()) {
            row *= *slope;
        }
        Ok(scatter)
    }

    /// An error at a sample, with the effects that are at fault where a number is not finite or a quantity is missing.
    #[must_use]
    pub fn explained(&self, mut error: Error, sample: &Sample<'_>) -> Error {
        let found = self.effects_at_fault(&error, sample);
        if let Error::NotFinite { effects, .. } | Error::Missing { effects, .. } = &mut error {
            *effects = found.into();
        }
        error
    }

    /// The effects without which the closures at a sample are finite numbers, or do not lack the same, with their terms.
    fn effects_at_fault(&self, error: &Error, sample: &Sample<'_>) -> Vec<String> {
        let is_missing = matches!(error, Error::Missing { .. });
        if !is_missing && !matches!(error, Error::NotFinite { .. }) {
            return vec![];
        }
        let lacks = |machine: &Self| machine.closures(sample).err().as_ref() == Some(error);
        if is_missing && !lacks(self) {
            return vec![];
        }
        let value = |name: &str| {
            let parameters = self.variant.parameters.iter().zip(&self.values);
            let mut own = parameters.filter(|(parameter, _)| parameter.name == name);
            own.next().map(|(_, &value)| value)
        };
        let is_at_fault = |index: usize| {
            let without = self.robot.without_effect(&self.variant, index).ok()?;
            let values: Option<Vec<f64>> = (without.parameters.iter())
                .map(|parameter| value(&parameter.name))
                .collect();
            let machine = Self {
                values: values?,
                variant: without,
                ..self.clone()
            };
            Some(if is_missing {
                !lacks(&machine)
            } else {
                machine.closures(sample).is_ok()
            })
        };
        let effects = self.variant.effects.iter().enumerate();
        effects
            .filter(|&(index, _)| is_at_fault(index) == Some(true))
            .map(|(_, (name, places))| {
                let terms = self.robot.terms_of(name, places).join("; ");
                format!("`{name}({})`: `{terms}`", places.join(", "))
            })
            .collect()
    }

    /// Residual of one closure (m²) and its derivative by a command.
    ///
    /// # Errors
    /// Data that the sample lacks; a number that is not finite.
    pub(crate) fn closure_by_command(
        &self,
        instance: &Instance,
        sample: &Sample<'_>,
        command: usize,
    ) -> Result<(f64, f64), Error> {
        let mut scratch = Scratch::default();
        let residual = scratch.linearize(self, instance, sample)?;
        let wanted = POSE_COLUMNS + command;
        let mut columns = instance.family.pattern().columns.iter();
        let found = columns.position(|&column| motion_column(instance, column as usize) == wanted);
        Ok((residual, found.map_or(0.0, |entry| scratch.jacobian[entry])))
    }

    /// Residual of one closure (m²) and its gradient by position (3) and rotation vector (3).
    ///
    /// # Errors
    /// Data that the sample lacks; a number that is not finite.
    pub fn closure_by_pose(
        &self,
        instance: &Instance,
        sample: &Sample<'_>,
    ) -> Result<(f64, [f64; POSE_COLUMNS]), Error> {
        let mut scratch = Scratch::default();
        let residual = scratch.linearize(self, instance, sample)?;
        Ok((residual, scratch.gradient(instance)))
    }
}

/// Column of [`Closures::jacobian`] of a column of a closure by pose: of commands, it has those that it reads.
fn motion_column(instance: &Instance, column: usize) -> usize {
    let Some(rank) = column.checked_sub(POSE_COLUMNS) else {
        return column;
    };
    let mut commands = instance.inputs.iter().filter_map(|input| match input {
        Input::Command(command) => Some(*command),
        _ => None,
    });
    POSE_COLUMNS + commands.nth(rank).unwrap_or_default()
}

/// Buffers for calling families.
#[derive(Default)]
pub(crate) struct Scratch {
    data: Vec<f64>,
    prepared: Vec<f64>,
    parameters: Vec<f64>,
    jacobian: Vec<f64>,
}

impl Scratch {
    /// Residual of a closure at the sample; its derivatives are left in the buffer.
    fn linearize(
        &mut self,
        machine: &Machine,
        instance: &Instance,
        sample: &Sample<'_>,
    ) -> Result<f64, Error> {
        let mut data = std::mem::take(&mut self.data);
        data.clear();
        machine.fill(instance, sample, &mut data)?;
        let residual = self.linearize_filled(machine, instance, &data);
        self.data = data;
        residual
    }

    /// The same with the data of the closure at hand.
    fn linearize_filled(
        &mut self,
        machine: &Machine,
        instance: &Instance,
        data: &[f64],
    ) -> Result<f64, Error> {
        let family = &instance.family;
        self.parameters.clear();
        self.parameters.extend(
            instance
                .parameters
                .iter()
                .map(|&index| machine.values[index]),
        );
        self.prepared.resize(family.shape().prepared, 0.0);
        family.prepare(data, &mut self.prepared);
        self.jacobian.resize(family.pattern().len(), 0.0);
        let mut residual = [0.0];
        family.linearize(
            &self.prepared,
            &self.parameters,
            &mut residual,
            &mut self.jacobian,
        );
        // Later steps would turn in circles on a number that is none.
        if !residual.iter().chain(&self.jacobian).all(|v| v.is_finite()) {
            return Err(Error::NotFinite {
                closure: machine.closure_name(instance).to_owned(),
                effects: Box::default(),
            });
        }
        Ok(residual[0])
    }

    /// Derivatives of the closure that was linearised last by position and rotation vector.
    fn gradient(&self, instance: &Instance) -> [f64; POSE_COLUMNS] {
        let mut gradient = [0.0; POSE_COLUMNS];
        for (&column, entry) in (instance.family.pattern().columns.iter()).zip(&self.jacobian) {
            if let Some(place) = gradient.get_mut(column as usize) {
                *place = *entry;
            }
        }
        gradient
    }
}
