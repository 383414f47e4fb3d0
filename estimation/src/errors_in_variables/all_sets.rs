//! The least-squares problem: all sets, with the true poses of set 1 among the unknowns.

use tau_kinematics::{self as kinematics, Machine};
use tau_robot::measurements::TcpPose;
use tau_robot::robot::{Instance, Owner, ResidualKind, TrackShape};
use tau_robot::robot_file::Noise;
use tau_runtime::ResidualFamily;
use tau_solver::{Block, Parameter, Problem, Solution};

use super::true_pose::{POSE_UNKNOWNS, TruePose};
use crate::calibration::{Error, MOUNTING_M, Nominal, Prepared};
use crate::joint::whitened::WhitenedPose;
use crate::samples::Sample;

/// Groups of residuals that share a noise.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// Poses of the TCP, set 1.
    TcpPoses,
    /// Positions of carts in set 2.
    CartPosePositions,
    /// Rotations of carts in set 2.
    CartPoseRotations,
    /// Positions of carts in set 3.
    CartPositions,
}

impl Group {
    /// All of them, in the order in which factors are given.
    pub const ALL: [Self; 4] = [
        Self::TcpPoses,
        Self::CartPosePositions,
        Self::CartPoseRotations,
        Self::CartPositions,
    ];
}

/// A variant with all its measurements, as residuals.
pub struct AllSets {
    pub(super) machine: Machine,
    /// Index in the variant of each shared unknown.
    pub(super) used: Vec<usize>,
    priors: Vec<Nominal>,
    noise: Noise,
    /// Standard deviation of a link's length at the true pose (m).
    closure_m: f64,
    closures: TruePose,
    closure_parameters: Vec<usize>,
    closure_data: Vec<f64>,
    /// Reciprocal standard deviation of each closure of each pose.
    closure_weights: Vec<f64>,
    pub(super) poses: usize,
    pose_names: Vec<u32>,
    carts: Vec<Cart>,
}

/// What set 2 or 3 says of a cart.
struct Cart {
    instance: Instance,
    parameters: Vec<usize>,
    data: Vec<f64>,
    /// Reciprocal stated noise and group of each residual of a sample.
    weights: Vec<(f64, Group)>,
    samples: Vec<u32>,
    label: String,
}

/// Sum of squared residuals of a group, in units of the stated noise, and their number.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Misfit {
    pub(super) squares: f64,
    pub(super) count: usize,
}

impl AllSets {
    /// `machine` and `nominal` are those of a variant; `poses` are those of set 1, `samples` those of sets 2
    /// and 3 (others are passed over).
    pub(super) fn new(
        prepared: Prepared,
        poses: &[&TcpPose],
        samples: &[Sample],
        noise: Noise,
        closure_m: f64,
    ) -> Result<Self, Error> {
        let Prepared {
            machine, nominal, ..
        } = prepared;
        let closures: Vec<(Instance, Instance)> = machine
            .variant
            .instances_of(ResidualKind::Closure)
            .filter_map(|closure| {
                let mut by_pose = machine.closure_instances();
                let by_pose = by_pose.find(|instance| instance.of == closure.of)?;
                Some((closure.clone(), by_pose.clone()))
            })
            .collect();
        let by_pose: Vec<Instance> = closures.iter().map(|pair| pair.1.clone()).collect();
        let closures = TruePose::new(&closures, machine.robot.commands);
        let (mut closure_data, mut closure_weights) = (Vec::new(), Vec::new());
        for pose in poses {
            let sample = kinematics::Sample::from(*pose);
            let filled = closures.fill(&machine.surroundings, &sample, &mut closure_data);
            filled.map_err(|what| {
                let closure = "every link".to_owned();
                Error::at_pose(pose.pose, kinematics::Error::Missing { closure, what })
            })?;
            for instance in &by_pose {
                let (_, [x, y, z, ..]) = machine
                    .closure_by_pose(instance, &sample)
                    .map_err(|error| Error::at_pose(pose.pose, error))?;
                let slope = (x * x + y * y + z * z).sqrt();
                closure_weights.push((slope * closure_m).recip());
            }
        }
        let mut carts = Vec::new();
        for (kind, set) in [(ResidualKind::CartPose, 2), (ResidualKind::CartPosition, 3)] {
            for instance in machine.variant.instances_of(kind) {
                let of = samples
                    .iter()
                    .filter(|sample| sample.set == set && sample.track == Some(instance.of));
                let of: Vec<&Sample> = of.collect();
                if !of.is_empty() {
                    carts.push(Cart::new(&machine, instance, &of, noise)?);
                }
            }
        }
        let mut used: Vec<usize> = closures.parameters().to_vec();
        used.extend(carts.iter().flat_map(|cart| &cart.instance.parameters));
        used.sort_unstable();
        used.dedup();
        let place = |index: &usize| used.binary_search(index).unwrap_or_default();
        for cart in &mut carts {
            cart.parameters = cart.instance.parameters.iter().map(place).collect();
        }
        let closure_parameters = closures.parameters().iter().map(place).collect();
        let priors = used
            .iter()
            .map(|&index| {
                let parameter = &machine.variant.parameters[index];
                match parameter.owner {
                    Owner::Target { .. } if parameter.quantity == "position" => Nominal {
                        value: 0.0,
                        tolerance: Some(MOUNTING_M),
                    },
                    _ => nominal[index],
                }
            })
            .collect();
        Ok(Self {
            used,
            priors,
            noise,
            closure_m,
            closure_parameters,
            closure_data,
            closure_weights,
            poses: poses.len(),
            pose_names: poses.iter().map(|pose| pose.pose).collect(),
            closures,
            carts,
            machine,
        })
    }

    /// Standard deviation of a link's length at the true pose (m).
    pub fn closure_m(&self) -> f64 {
        self.closure_m
    }

    /// Reciprocal standard deviation (1/m²) of each closure at each pose: poses × closures, row-major.
    pub fn closure_weights(&self) -> &[f64] {
        &self.closure_weights
    }

    /// Number of residuals, measured poses of set 1 counted by their closures.
    pub(super) fn residuals(&self) -> usize {
        let of_carts = |cart: &Cart| cart.samples.len() * cart.weights.len();
        self.closure_weights.len() + self.carts.iter().map(of_carts).sum::<usize>()
    }

    /// Number of unknowns that all poses share; those of the poses follow them.
    pub fn shared(&self) -> usize {
        self.used.len()
    }

    /// The problem, from values of the variant. `factors` are those by which the noise of each group of
    /// [`Group::ALL`] exceeds the stated one.
    ///
    /// The shared unknowns come first, then six for each pose: translation (m) and rotation vector (rad),
    /// in the measurement frame, from the measured pose to the true one. What was measured is their
    /// prior, with mean zero.
    pub fn problem(&self, values: &[f64], factors: [f64; 4]) -> Problem<'_> {
        let mut parameters = self.shared_parameters(values);
        let scale = factors[Group::TcpPoses as usize];
        let axes = ["x", "y", "z", "about x", "about y", "about z"];
        for pose in &self.pose_names {
            for (k, axis) in axes.iter().enumerate() {
                let noise = if k < 3 {
                    self.noise.position_m
                } else {
                    self.noise.rotation_rad
                };
                parameters.push(
                    Parameter::new(format!("pose {pose} {axis}"), 0.0)
                        .with_prior(0.0, noise * scale),
                );
            }
        }
        let first = self.used.len();
        let unknowns = first..first + POSE_UNKNOWNS * self.poses;
        let weights = self.closure_weights.iter().map(|weight| weight / scale);
        let closures = Block::new(
            "closures",
            &self.closures,
            self.closure_parameters.clone(),
            &self.closure_data,
        )
        .with_sample_parameters(unknowns.collect())
        .with_weights(weights.collect())
        .with_sample_names(self.pose_names.clone());
        let mut blocks = vec![closures];
        blocks.extend(self.carts.iter().map(|cart| cart.block(factors)));
        Problem { parameters, blocks }
    }

    /// The same to first order in the noise of the poses, without their unknowns: the closures of a pose
    /// at the measured one, whitened together. What the data determine is read off this.
    pub(super) fn marginal<'a>(
        &'a self,
        whitened: &'a Whitened,
        values: &[f64],
        factors: [f64; 4],
    ) -> Problem<'a> {
        let place = |index: &usize| self.used.binary_search(index).unwrap_or_default();
        let weight = factors[Group::TcpPoses as usize].recip();
        let closures = whitened.family.shape().residuals * self.poses;
        let mut blocks = vec![
            Block::new(
                "closures",
                &whitened.family,
                whitened.family.parameters().iter().map(place).collect(),
                &whitened.data,
            )
            .with_weights(vec![weight; closures]),
        ];
        blocks.extend(self.carts.iter().map(|cart| cart.block(factors)));
        Problem {
            parameters: self.shared_parameters(values),
            blocks,
        }
    }

    fn shared_parameters(&self, values: &[f64]) -> Vec<Parameter> {
        let shared = self.used.iter().zip(&self.priors).map(|(&index, prior)| {
            let described = &self.machine.variant.parameters[index];
            let mut parameter = Parameter::new(&described.name, values[index]);
            if let Some(tolerance) = prior.tolerance.filter(|tolerance| *tolerance > 0.0) {
                parameter = parameter.with_prior(prior.value, tolerance);
            }
            match described.search {
                Some((low, high)) => parameter.with_bounds(low, high),
                None => parameter,
            }
        });
        shared.collect()
    }

    /// Values of the whole variant at a solution.
    pub fn values(&self, solution: &Solution) -> Vec<f64> {
        let mut values = self.machine.values.clone();
        for (&index, &value) in self.used.iter().zip(&solution.parameters) {
            values[index] = value;
        }
        values
    }

    /// How well each group of [`Group::ALL`] is met at a solution, in units of the stated noise. That of
    /// set 1 counts one for each closure: its six measured coordinates pay for the pose's six unknowns.
    pub(super) fn misfits(&self, solution: &Solution) -> [Misfit; 4] {
        let mut misfits = [Misfit::default(); 4];
        let (shared, poses) = solution.parameters.split_at(self.used.len());
        let of_poses = &mut misfits[Group::TcpPoses as usize];
        for unknowns in poses.chunks_exact(POSE_UNKNOWNS) {
            for (k, &unknown) in unknowns.iter().enumerate() {
                let noise = if k < 3 {
                    self.noise.position_m
                } else {
                    self.noise.rotation_rad
                };
                of_poses.squares += (unknown / noise).powi(2);
            }
        }
        let shape = self.closures.shape();
        let mut parameters: Vec<f64> = self.closure_parameters.iter().map(|&p| shared[p]).collect();
        let common = parameters.len();
        let mut residuals = vec![0.0; shape.residuals];
        let data = self.closure_data.chunks_exact(shape.data);
        let weights = self.closure_weights.chunks_exact(shape.residuals);
        for ((unknowns, data), weights) in poses.chunks_exact(POSE_UNKNOWNS).zip(data).zip(weights)
        {
            parameters.truncate(common);
            parameters.extend_from_slice(unknowns);
            self.closures.value(data, &parameters, &mut residuals);
            for (residual, weight) in residuals.iter().zip(weights) {
                of_poses.squares += (residual * weight).powi(2);
            }
            of_poses.count += shape.residuals;
        }
        for cart in &self.carts {
            cart.add_misfit(shared, &mut misfits);
        }
        misfits
    }
}

impl Cart {
    fn new(
        machine: &Machine,
        instance: &Instance,
        samples: &[&Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        let mut data = Vec::new();
        for sample in samples {
            sample.fill(machine, instance, &mut data)?;
        }
        let (position, rotation) = (noise.position_m.recip(), noise.rotation_rad.recip());
        let weights = if instance.kind == ResidualKind::CartPose {
            // A path interpolated through points of set 2 passes through them by itself.
            let passes_through = machine.variant.tracks[instance.of].shape == TrackShape::Piecewise;
            let position = if passes_through { 0.0 } else { position };
            [
                [(position, Group::CartPosePositions); 3],
                [(rotation, Group::CartPoseRotations); 3],
            ]
            .concat()
        } else {
            vec![(position, Group::CartPositions); 3]
        };
        let set = if instance.kind == ResidualKind::CartPose {
            2
        } else {
            3
        };
        Ok(Self {
            label: format!("set {set}, cart on {}", machine.robot.tracks[instance.of]),
            instance: instance.clone(),
            parameters: Vec::new(),
            data,
            weights,
            samples: samples.iter().map(|sample| sample.number).collect(),
        })
    }

    fn block(&self, factors: [f64; 4]) -> Block<'_> {
        let of_sample = self
            .weights
            .iter()
            .map(|&(weight, group)| weight / factors[group as usize]);
        let of_sample: Vec<f64> = of_sample.collect();
        Block::new(
            &self.label,
            &*self.instance.family,
            self.parameters.clone(),
            &self.data,
        )
        .with_weights(of_sample.repeat(self.samples.len()))
        .with_sample_names(self.samples.clone())
    }

    fn add_misfit(&self, shared: &[f64], misfits: &mut [Misfit; 4]) {
        let family = &self.instance.family;
        let shape = family.shape();
        let parameters: Vec<f64> = self.parameters.iter().map(|&p| shared[p]).collect();
        let mut prepared = vec![0.0; self.samples.len() * shape.prepared];
        let mut residuals = vec![0.0; self.samples.len() * shape.residuals];
        family.prepare_all(&self.data, &mut prepared);
        family.value_all(&prepared, &parameters, &mut residuals);
        for (residual, &(weight, group)) in residuals.iter().zip(self.weights.iter().cycle()) {
            if weight > 0.0 {
                misfits[group as usize].squares += (residual * weight).powi(2);
                misfits[group as usize].count += 1;
            }
        }
    }
}

/// The closures of each pose, whitened together.
pub(super) struct Whitened {
    family: WhitenedPose,
    data: Vec<f64>,
}

impl Whitened {
    /// At given values of the variant.
    pub(super) fn new(machine: &Machine, poses: &[&TcpPose], noise: Noise) -> Result<Self, Error> {
        let closures: Vec<Instance> = machine
            .variant
            .instances_of(ResidualKind::Closure)
            .cloned()
            .collect();
        let mut data = Vec::new();
        for pose in poses {
            let sample = kinematics::Sample::from(*pose);
            for closure in &closures {
                let filled = machine.fill(closure, &sample, &mut data);
                filled.map_err(|error| Error::at_pose(pose.pose, error))?;
            }
            let factor = WhitenedPose::factor(machine, &sample, noise).ok_or_else(|| {
                let why = format!("pose {}: the closures do not depend on the pose", pose.pose);
                Error::Input(tau_robot::input_error::InputError::whole(
                    "tcp_poses.csv",
                    why,
                ))
            })?;
            data.extend(factor);
        }
        Ok(Self {
            family: WhitenedPose::new(closures),
            data,
        })
    }
}
