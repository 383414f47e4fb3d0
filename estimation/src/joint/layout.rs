//! How the rows of a joint fit are laid out, and what they are filled with.

use std::sync::Arc;

use nalgebra::DMatrix;
use tau_kinematics::Machine;
use tau_robot::input_error::InputError;
use tau_robot::robot::{Owner, ResidualKind};
use tau_robot::robot_file::Noise;
use tau_runtime::ResidualFamily;

use super::{Component, Joint, Part, Row};
use crate::calibration::{Error, MOUNTING_M, Nominal};
use crate::joint::knots;
use crate::joint::whitened::WhitenedPose;
use crate::numerics::grouped::Groups;
use crate::samples::Sample;

/// A part before its parameters are numbered.
struct Layout {
    family: Arc<dyn ResidualFamily>,
    /// Index of each parameter in the variant.
    parameters: Vec<usize>,
    data: Vec<f64>,
    samples: Vec<usize>,
    weights: Vec<(f64, Component)>,
}

impl Layout {
    /// The closures of set 1, those of a pose whitened together.
    fn closures(machine: &Machine, samples: &[Sample], noise: Noise) -> Result<Self, Error> {
        let closures: Vec<_> = machine
            .variant
            .instances_of(ResidualKind::Closure)
            .cloned()
            .collect();
        let poses = indices(samples, 1, None);
        let mut data = Vec::new();
        for &pose in &poses {
            let sample = &samples[pose];
            for closure in &closures {
                sample.fill(machine, closure, &mut data)?;
            }
            let factor = WhitenedPose::factor(machine, &sample.view(), noise).ok_or_else(|| {
                Error::Input(InputError::whole(
                    "tcp_poses.csv",
                    format!(
                        "pose {}: the closures do not depend on the pose",
                        sample.number
                    ),
                ))
            })?;
            data.extend(factor);
        }
        let weights = vec![(1.0, Component::Closure); closures.len()];
        let family = WhitenedPose::new(closures);
        let parameters = family.parameters().to_vec();
        Ok(Self {
            family: Arc::new(family),
            parameters,
            data,
            samples: poses,
            weights,
        })
    }

    /// The carts of sets 2 and 3, track by track.
    fn carts(machine: &Machine, samples: &[Sample], noise: Noise) -> Result<Vec<Self>, Error> {
        let (position, rotation) = (noise.position_m.recip(), noise.rotation_rad.recip());
        let of_poses = [
            [(position, Component::CartPosition); 3],
            [(rotation, Component::CartRotation); 3],
        ]
        .concat();
        let of_positions = vec![(position, Component::Position); 3];
        let sets = [
            (ResidualKind::CartPose, 2, of_poses),
            (ResidualKind::CartPosition, 3, of_positions),
        ];
        let mut layouts = Vec::new();
        for (kind, set, weights) in sets {
            for instance in machine.variant.instances_of(kind) {
                let of_cart = indices(samples, set, Some(instance.of));
                if of_cart.is_empty() {
                    continue;
                }
                let mut data = Vec::new();
                for &sample in &of_cart {
                    samples[sample].fill(machine, instance, &mut data)?;
                }
                layouts.push(Self {
                    family: Arc::clone(&instance.family),
                    parameters: instance.parameters.clone(),
                    data,
                    samples: of_cart,
                    weights: weights.clone(),
                });
            }
        }
        Ok(layouts)
    }

    /// The part with its parameters numbered as in `used`; its rows are added to those before.
    fn numbered(self, used: &[usize], rows: &mut Vec<Row>) -> Part {
        let Self {
            family,
            parameters,
            data,
            samples,
            weights,
        } = self;
        let first_row = rows.len();
        for &sample in &samples {
            let residuals = weights.iter().enumerate();
            rows.extend(residuals.map(|(residual, &(_, component))| Row {
                sample,
                component,
                residual,
            }));
        }
        let mut prepared = vec![0.0; samples.len() * family.shape().prepared];
        family.prepare_all(&data, &mut prepared);
        let place = |index: &usize| used.binary_search(index).unwrap_or_default();
        Part {
            parameters: parameters.iter().map(place).collect(),
            family,
            data,
            prepared,
            samples,
            first_row,
            weights,
        }
    }
}

/// Samples of a set, and in sets 2 and 3 of a track.
fn indices(samples: &[Sample], set: u8, track: Option<usize>) -> Vec<usize> {
    (0..samples.len())
        .filter(|&i| samples[i].set == set && samples[i].track == track)
        .collect()
}

impl Joint {
    /// Lays out the rows: set 1, then sets 2 and 3 by track.
    pub fn new(
        machine: Machine,
        nominal: &[Nominal],
        samples: &[Sample],
        noise: Noise,
    ) -> Result<Self, Error> {
        let mut layouts = vec![Layout::closures(&machine, samples, noise)?];
        layouts.extend(Layout::carts(&machine, samples, noise)?);
        let parameters = layouts.iter().flat_map(|layout| &layout.parameters);
        let mut used: Vec<usize> = parameters.copied().collect();
        used.sort_unstable();
        used.dedup();
        let mut rows = Vec::new();
        let parts = layouts
            .into_iter()
            .map(|layout| layout.numbered(&used, &mut rows))
            .collect();
        let parameters = &machine.variant.parameters;
        let priors = used
            .iter()
            .map(|&index| match parameters[index].owner {
                Owner::Target { .. } if parameters[index].quantity == "position" => Nominal {
                    value: 0.0,
                    tolerance: Some(MOUNTING_M),
                },
                _ => nominal[index],
            })
            .collect();
        let knots = DMatrix::zeros(rows.len(), 0);
        let mut joint = Self {
            machine,
            used,
            priors,
            parts,
            knots,
            groups: Groups::default(),
            rows,
        };
        joint.groups = joint.groups();
        if let Some(knots) = knots::columns(&joint, samples) {
            joint.knots = knots;
            joint.groups = joint.groups();
        }
        Ok(joint)
    }

    fn groups(&self) -> Groups {
        let columns = self.used.len() + self.knots.ncols();
        // Priors are none of the components.
        let of_priors = std::iter::repeat_n(Component::ALL.len(), columns);
        let kinds = self.rows.iter().map(|row| row.component as usize);
        let kinds: Vec<usize> = kinds.chain(of_priors).collect();
        Groups::of(&kinds, columns, |mark| {
            for part in &self.parts {
                let (residuals, pattern) = (part.weights.len(), part.family.pattern());
                for row in 0..part.samples.len() * residuals {
                    let within = row % residuals;
                    let entries = pattern.row_starts[within] as usize
                        ..pattern.row_starts[within + 1] as usize;
                    for &parameter in &pattern.columns[entries] {
                        mark(part.first_row + row, part.parameters[parameter as usize]);
                    }
                }
            }
            for (k, knot) in self.knots.column_iter().enumerate() {
                for (row, _) in knot.iter().enumerate().filter(|(_, value)| **value != 0.0) {
                    mark(row, self.used.len() + k);
                }
            }
            (0..columns).for_each(|column| mark(self.rows.len() + column, column));
        })
    }
}
