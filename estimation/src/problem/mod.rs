//! The least-squares problem of every calibration: the residuals of a variant at samples, their noise, priors.
//!
//! They differ in how the noise of the measured poses meets the closures ([`Closures`]): the [joint fit](crate::joint) takes
//! those of a pose together, starts and first looks each for itself.

mod attenuation;
mod component;
mod true_pose;
mod whitened;

use std::collections::BTreeMap;
use std::sync::Arc;

use tau_codes::fit;
use tau_kinematics::{Machine, POSE_COLUMNS};
use tau_robot::input_error::InputError;
use tau_robot::measurements::TCP_POSES;
use tau_robot::robot::{Instance, Owner, ResidualKind, TrackShape, Variant};
use tau_robot::robot_file::Noise;
use tau_runtime::ResidualFamily;
use tau_solver::{Block, Parameter};

use crate::machine::error::Error;
use crate::machine::nominal::Nominal;
use crate::machine::registration::MOUNTING_M;
use crate::numerics::order::place;
use crate::samples::Sample;
use whitened::WhitenedPose;

pub use whitened::{Eliminated, Origin, RowPlace, Tracked};

pub(crate) use attenuation::whitened_bias;
pub use component::Component;
pub use true_pose::CLOSURE_SHARE;
pub(crate) use true_pose::{POSE_UNKNOWNS, TruePose, left_jacobian};

/// Treatment of the measured poses' noise in the closures.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Closures<'a> {
    /// Each closure for itself, with the standard deviation that the noise of its pose gives it.
    Apart,
    /// The closures of a pose whitened together: its noise is eliminated to first order.
    Whitened,
    /// The unknowns of poses that are unknown eliminated.
    Eliminated(&'a [Eliminated]),
}

/// A family with its samples.
#[derive(Debug, Clone)]
pub(crate) struct Part {
    pub(crate) label: String,
    pub(crate) family: Arc<dyn ResidualFamily>,
    /// Index of each parameter that the samples share: in the variant, among those of the fit once
    /// [numbered](Self::numbered).
    pub(crate) parameters: Vec<usize>,
    pub(crate) data: Vec<f64>,
    /// Index of each sample, of several that belong together the first, and its number in the file.
    pub(crate) samples: Vec<usize>,
    pub(crate) numbers: Vec<u32>,
    /// Reciprocal stated noise: samples × residuals, row-major.
    pub(crate) weights: Vec<f64>,
    /// Noise group of each residual of a sample.
    pub(crate) components: Vec<Component>,
    /// Index of the sample that each residual is of, where samples belong together; empty where each is for itself.
    owners: Vec<usize>,
}

/// The residuals of a variant at samples.
pub(crate) struct Residuals {
    /// Index in the variant of each parameter of the fit.
    pub(crate) used: Vec<usize>,
    /// Prior of each of them.
    pub(crate) priors: Vec<Nominal>,
    /// Set 1, then sets 2 and 3 by track.
    pub(crate) parts: Vec<Part>,
}

impl Residuals {
    /// Those that a variant has at the samples; `nominal` holds a value and tolerance of each of its parameters.
    ///
    /// # Errors
    /// Data that residuals take are missing; closures that do not depend on the pose.
    pub(crate) fn new(
        machine: &Machine,
        nominal: &[Nominal],
        samples: &[Sample],
        noise: Noise,
        closures: Closures<'_>,
    ) -> Result<Self, Error> {
        let mut parts = match closures {
            Closures::Apart => Part::closures(machine, samples, noise)?,
            Closures::Whitened => vec![Part::whitened(machine, samples, noise)?],
            Closures::Eliminated(groups) => Part::eliminated(machine, samples, groups)?,
        };
        // A path interpolated through points of set 2 passes through them by itself, unless they are free to move.
        let are_free = matches!(closures, Closures::Whitened);
        parts.extend(Part::carts(machine, samples, noise, are_free)?);
        let parameters = parts.iter().flat_map(|part| &part.parameters);
        let mut used: Vec<usize> = parameters.copied().collect();
        used.sort_unstable();
        used.dedup();
        Ok(Self {
            priors: priors(&machine.variant, &used, nominal),
            parts: (parts.into_iter())
                .map(|part| part.numbered(&used))
                .collect(),
            used,
        })
    }
}

/// Components of so many residuals of closures, the last of them exact.
fn of_closures(residuals: usize, exact: usize) -> Vec<Component> {
    let mut components = vec![Component::Closure; residuals - exact];
    components.resize(residuals, Component::Exact);
    components
}

/// Priors of the parameters of a fit; `nominal` holds a value and tolerance of each of the variant.
pub(crate) fn priors(variant: &Variant, used: &[usize], nominal: &[Nominal]) -> Vec<Nominal> {
    let described = &variant.parameters;
    let priors = used.iter().map(|&index| match described[index].owner {
        Owner::Target { .. } if described[index].quantity == "position" => {
            Nominal::new(0.0, Some(MOUNTING_M))
        }
        _ => nominal[index],
    });
    priors.collect()
}

/// Coordinates of a pose's noise in units of it, in metres and radians.
pub(crate) fn times_noise([x, y, z, a, b, c]: [f64; 6], noise: Noise) -> [f64; 6] {
    let (position, rotation) = (noise.position_m, noise.rotation_rad);
    [
        x * position,
        y * position,
        z * position,
        a * rotation,
        b * rotation,
        c * rotation,
    ]
}

/// The parameters of a fit as the solver takes them; `start` holds a value of each.
pub(crate) fn parameters(
    variant: &Variant,
    used: &[usize],
    priors: &[Nominal],
    start: impl IntoIterator<Item = f64>,
) -> Vec<Parameter> {
    let known = used.iter().zip(priors).zip(start);
    known
        .map(|((&index, prior), start)| {
            let described = &variant.parameters[index];
            let mut parameter = Parameter::new(&described.name, start);
            if let Some(tolerance) = prior.sigma() {
                parameter = parameter.with_prior(prior.value, tolerance);
            }
            match described.search {
                Some((low, high)) => parameter.with_bounds(low, high),
                None => parameter,
            }
        })
        .collect()
}

/// The values of a variant where those of the fit are put in place of its own.
pub(crate) fn values(machine: &Machine, used: &[usize], fitted: &[f64]) -> Vec<f64> {
    let mut values = machine.values.clone();
    for (&index, &value) in used.iter().zip(fitted) {
        values[index] = value;
    }
    values
}

impl Part {
    /// A family at some of the samples; data and weights are still to come.
    fn of(
        label: String,
        family: Arc<dyn ResidualFamily>,
        parameters: Vec<usize>,
        (all, samples): (&[Sample], Vec<usize>),
        components: Vec<Component>,
    ) -> Self {
        Self {
            label,
            family,
            parameters,
            data: Vec::new(),
            numbers: samples.iter().map(|&sample| all[sample].number).collect(),
            samples,
            weights: Vec::new(),
            components,
            owners: Vec::new(),
        }
    }

    /// Index of the sample that each residual is of.
    pub(crate) fn owners(&self) -> impl Iterator<Item = usize> {
        let each = self.components.len();
        let own = self.samples.iter();
        let own = own.flat_map(move |&sample| std::iter::repeat_n(sample, each));
        let stated = self.owners.iter().copied();
        stated.chain(own.skip(self.owners.len()))
    }

    /// Closures, each with the noise that it has from that of the pose.
    fn closures(machine: &Machine, samples: &[Sample], noise: Noise) -> Result<Vec<Self>, Error> {
        let of_set = indices(samples, 1, None);
        let closures = machine.variant.instances_of(ResidualKind::Closure);
        let part = |closure: &Instance| {
            Self::of(
                machine.closure_name(closure).to_owned(),
                Arc::clone(&closure.family),
                closure.parameters.clone(),
                (samples, of_set.clone()),
                vec![Component::Closure],
            )
        };
        let mut parts: Vec<Self> = closures.map(part).collect();
        let mut data = Vec::new();
        for &sample in &of_set {
            data.clear();
            samples[sample].fill_closures(machine, &mut data)?;
            let mut rest = data.as_slice();
            for part in &mut parts {
                let (own, others) = rest.split_at(part.family.shape().data);
                part.data.extend_from_slice(own);
                rest = others;
            }
        }
        let closures = machine.variant.instances_of(ResidualKind::Closure);
        for (part, closure) in parts.iter_mut().zip(closures) {
            let Some(by_pose) = by_pose(machine, closure) else {
                part.weights = vec![1.0; of_set.len()];
                continue;
            };
            let views = of_set.iter().map(|&sample| samples[sample].view());
            let gradients = machine.gradients_at(by_pose, views).zip(&of_set);
            let weights = gradients.map(|(gradient, &sample)| {
                let gradient = gradient.map_err(|error| samples[sample].failed(machine, error))?;
                let by_noise = times_noise(gradient, noise);
                let variance: f64 = by_noise.iter().map(|slope| slope * slope).sum();
                Ok(variance.sqrt().recip())
            });
            part.weights = weights.collect::<Result<_, Error>>()?;
        }
        Ok(parts)
    }

    /// All closures, those of a pose whitened together.
    pub(crate) fn whitened(
        machine: &Machine,
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        let closures: Vec<Instance> = (machine.variant.instances_of(ResidualKind::Closure))
            .cloned()
            .collect();
        let serial = machine.surroundings.serial;
        let family = match serial {
            None => WhitenedPose::new(closures.clone()),
            Some(_) => WhitenedPose::in_coordinates(closures.clone()),
        };
        let parameters = family.parameters().to_vec();
        // The factor is triangular: the last rows are what the motions of the plate leave of closures.
        let scatters = machine.surroundings.length_noise.is_any();
        let exact = if scatters {
            0
        } else {
            (closures.len()).saturating_sub(machine.pose_unknowns().len())
        };
        let mut part = Self::of(
            "closures".to_owned(),
            Arc::new(family),
            parameters,
            (samples, indices(samples, 1, None)),
            of_closures(closures.len(), exact),
        );
        for &sample in &part.samples {
            let sample = &samples[sample];
            sample.fill_closures(machine, &mut part.data)?;
            let view = sample.view();
            let factor = match serial {
                None => WhitenedPose::factor(machine, &view, noise),
                Some(_) => WhitenedPose::coordinates(machine, &view, noise),
            };
            let factor = factor.ok_or_else(|| {
                let pose = sample.number;
                if let Err(error) = machine.closures(&view) {
                    return Error::at_pose(pose, machine.explained(error, &view));
                }
                let why = format!("pose {pose}: the closures do not depend on the pose");
                InputError::whole(fit::UNSOLVABLE, TCP_POSES, why).into()
            })?;
            part.data.extend(factor);
        }
        part.weights = vec![1.0; part.samples.len() * closures.len()];
        Ok(part)
    }

    /// All closures and errors of the tracker, the poses eliminated: groups of as many samples and residuals are one part.
    fn eliminated(
        machine: &Machine,
        samples: &[Sample],
        groups: &[Eliminated],
    ) -> Result<Vec<Self>, Error> {
        let instances = |kind| machine.variant.instances_of(kind).cloned();
        let closures: Vec<Instance> = instances(ResidualKind::Closure).collect();
        let errors: Vec<Instance> = instances(ResidualKind::TrackerError).collect();
        let mut parts: BTreeMap<[usize; 4], Self> = BTreeMap::new();
        for group in groups {
            let shape @ [poses, tracked, rows, exact] = group.shape();
            if rows == 0 {
                continue;
            }
            let part = parts.entry(shape).or_insert_with(|| {
                let of_tracker = std::iter::repeat_n(&errors, tracked);
                let all = std::iter::repeat_n(&closures, poses).chain(of_tracker);
                let family = WhitenedPose::eliminated(all.flatten().cloned().collect(), rows);
                let parameters = family.parameters().to_vec();
                Self::of(
                    "closures".to_owned(),
                    Arc::new(family),
                    parameters,
                    (samples, vec![]),
                    of_closures(rows, exact),
                )
            });
            for &sample in &group.samples {
                samples[sample].fill_closures(machine, &mut part.data)?;
            }
            for tracked in &group.tracked {
                for error in &errors {
                    tracked.measured.fill(machine, error, &mut part.data)?;
                }
            }
            for row in 0..rows {
                part.data.extend(group.by_closure.row(row).iter());
                // Shares of errors that the variant does not have are of no account.
                let of_tracker = 3 * if errors.is_empty() { 0 } else { tracked };
                part.data
                    .extend(group.by_tracker.row(row).columns(0, of_tracker).iter());
            }
            part.data.extend(group.constants.iter());
            let first = group.samples[0];
            part.samples.push(first);
            part.numbers.push(samples[first].number);
            part.owners.extend(&group.owners);
            part.weights.extend(std::iter::repeat_n(1.0, rows));
        }
        Ok(parts.into_values().collect())
    }

    /// Carts in sets 2 and 3, those that were measured. `are_free` says that points of set 2 may move.
    pub(crate) fn carts(
        machine: &Machine,
        samples: &[Sample],
        noise: Noise,
        are_free: bool,
    ) -> Result<Vec<Self>, Error> {
        let kinds = [ResidualKind::CartPose, ResidualKind::CartPosition];
        let instances = (kinds.into_iter()).flat_map(|kind| machine.variant.instances_of(kind));
        let parts = instances.map(|instance| {
            let shape = machine.variant.tracks[instance.of].shape;
            let passes_through = !are_free && shape == TrackShape::Piecewise;
            Self::cart(machine, instance, samples, noise, passes_through)
        });
        parts.filter_map(Result::transpose).collect()
    }

    /// A cart in set 2 or 3; `None` where it was not measured.
    fn cart(
        machine: &Machine,
        instance: &Instance,
        samples: &[Sample],
        noise: Noise,
        passes_through: bool,
    ) -> Result<Option<Self>, Error> {
        let (position, rotation) = (noise.position_m.recip(), noise.rotation_rad.recip());
        let (set, of_sample) = if instance.kind == ResidualKind::CartPose {
            let on_path = if passes_through { 0.0 } else { position };
            let positions = [(on_path, Component::CartPosition); 3];
            let rotations = [(rotation, Component::CartRotation); 3];
            (2, [positions, rotations].concat())
        } else {
            (3, vec![(position, Component::Position); 3])
        };
        let measured = indices(samples, set, Some(instance.of));
        if measured.is_empty() {
            return Ok(None);
        }
        let mut part = Self::of(
            format!("set {set}, cart on {}", machine.robot.tracks[instance.of]),
            Arc::clone(&instance.family),
            instance.parameters.clone(),
            (samples, measured),
            of_sample.iter().map(|of| of.1).collect(),
        );
        for &sample in &part.samples {
            samples[sample].fill(machine, instance, &mut part.data)?;
            part.weights.extend(of_sample.iter().map(|of| of.0));
        }
        Ok(Some(part))
    }

    /// The part with its parameters numbered as in `used`.
    pub(crate) fn numbered(mut self, used: &[usize]) -> Self {
        for index in &mut self.parameters {
            *index = place(used, index);
        }
        self
    }

    /// Residuals in the units of the family, at values of the parameters.
    pub(crate) fn values(&self, values: &[f64]) -> Vec<f64> {
        let parameters: Vec<f64> = self.parameters.iter().map(|&p| values[p]).collect();
        let mut residuals = vec![0.0; self.weights.len()];
        let mut prepared = vec![0.0; self.samples.len() * self.family.shape().prepared];
        self.family.prepare_all(&self.data, &mut prepared);
        (self.family).value_all(&prepared, &parameters, &mut residuals);
        residuals
    }

    /// The part for the solver. `weigh` gives the weight of a residual from its place and its reciprocal stated
    /// noise.
    pub(crate) fn block(&self, weigh: impl Fn(usize, f64) -> f64) -> Block<'_> {
        let weights = self.weights.iter().enumerate();
        Block::new(
            &self.label,
            &*self.family,
            self.parameters.clone(),
            &self.data,
        )
        .with_weights(weights.map(|(k, &weight)| weigh(k, weight)).collect())
        .with_sample_names(self.numbers.clone())
    }

    /// The part for the solver with at most so many of its samples, evenly spread, each of which counts for those left
    /// out as well: beside priors they weigh as much as all.
    pub(crate) fn block_of_some(&self, most: usize) -> Block<'_> {
        let shape = self.family.shape();
        let step = self.samples.len().div_ceil(most).max(1);
        let some = |numbers: &[f64], each: usize| -> Vec<f64> {
            let of_samples = numbers.chunks(each.max(1)).step_by(step);
            of_samples.flatten().copied().collect()
        };
        let counted = (step as f64).sqrt();
        let weights = some(&self.weights, shape.residuals).into_iter();
        Block::new(
            &self.label,
            &*self.family,
            self.parameters.clone(),
            &some(&self.data, shape.data),
        )
        .with_weights(weights.map(|weight| weight * counted).collect())
        .with_sample_names(self.numbers.iter().copied().step_by(step).collect())
    }
}

/// The closure by pose that belongs to one by parameters.
pub(crate) fn by_pose<'a>(machine: &'a Machine, closure: &Instance) -> Option<&'a Instance> {
    machine
        .closure_instances()
        .find(|instance| instance.of == closure.of)
}

/// Derivatives of a closure by the translation and the rotation vector of a sample's pose.
pub(crate) fn gradient(
    machine: &Machine,
    by_pose: &Instance,
    sample: &Sample,
) -> Result<[f64; POSE_COLUMNS], Error> {
    let linearized = machine.closure_by_pose(by_pose, &sample.view());
    let (_, gradient) = linearized.map_err(|error| sample.failed(machine, error))?;
    Ok(gradient)
}

/// Samples of a set, and in sets 2 and 3 of a track.
fn indices(samples: &[Sample], set: u8, track: Option<usize>) -> Vec<usize> {
    (0..samples.len())
        .filter(|&i| samples[i].set == set && samples[i].track == track)
        .collect()
}

/// Indices in the variant of its parameters that what concerns the plate depends on, ascending: closures, and errors of the
/// tracker.
pub(crate) fn used_by_plate(machine: &Machine) -> Vec<usize> {
    let closures = true_pose::TruePose::new(&closures_of(machine), machine.pose_unknowns());
    let tracker = machine.variant.instances_of(ResidualKind::TrackerError);
    let of_tracker = tracker.flat_map(|own| &own.parameters);
    let mut used: Vec<usize> = closures
        .parameters()
        .iter()
        .chain(of_tracker)
        .copied()
        .collect();
    used.sort_unstable();
    used.dedup();
    used
}

/// Closures by parameters, each with that by pose.
pub(crate) fn closures_of(machine: &Machine) -> Vec<(Instance, Instance)> {
    let closures = machine.variant.instances_of(ResidualKind::Closure);
    closures
        .filter_map(|closure| Some((closure.clone(), by_pose(machine, closure)?.clone())))
        .collect()
}
