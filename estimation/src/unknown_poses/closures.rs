//! Closures of the links at every reading of the drives, whitened by the noise of these.

use std::sync::Arc;

use nalgebra::{Cholesky, DMatrix};
use tau_codes::fit;
use tau_kinematics::{Closures, Machine};
use tau_robot::input_error::InputError;
use tau_runtime::ResidualFamily;

use super::assembly::{Assembly, CHUNK, Chosen};
use super::coupled::Coupled;
use super::kinds::drive_sigmas;
use super::lengths::Lengths;
use super::measurand::Measurand;
use super::pose::UnknownPose;
use super::rows::{RowPlace, Rows};
use crate::machine::error::Error;
use crate::numerics::order::place;
use crate::numerics::parallel;
use crate::problem::{CLOSURE_SHARE, POSE_UNKNOWNS, TruePose, closures_of};

impl Assembly<'_> {
    /// The closures at every reading of the drives.
    pub(super) fn closures(
        &self,
        machine: &Machine,
        used: &[usize],
        chosen: &Chosen<'_>,
    ) -> Result<Rows, Error> {
        let closures = closures_of(machine);
        let count = closures.len();
        let are_lengths = self.file.noise_of_links().is_some();
        let free = if are_lengths {
            &Lengths::FREE
        } else {
            self.free
        };
        let family = Arc::new(TruePose::new(&closures, free));
        let column = |index: &usize| place(used, index);
        let parameters = family.parameters().iter().map(column).collect();
        let sigmas = drive_sigmas(self.file, machine.robot.commands);
        let inner = Arc::clone(&family) as Arc<dyn ResidualFamily>;
        let kind = self.kind(Measurand::is_of_lengths).unwrap_or_default();
        let mut rows = Rows::new("links", inner, parameters, vec![kind; count]);
        let mut is_coupled = vec![false; count * count];
        let of_chunk = |(chunk, poses): (usize, &[UnknownPose])| {
            let mut found = ClosureRows {
                is_coupled: is_coupled.clone(),
                ..ClosureRows::default()
            };
            for (index, pose) in poses.iter().enumerate() {
                let own = POSE_UNKNOWNS * (CHUNK * chunk + index);
                for reading in &pose.readings {
                    let sample = pose.sample(reading);
                    let view = sample.view();
                    let filled = family.fill(&machine.surroundings, &view, &mut found.data);
                    filled.map_err(|missing| sample.lacks_in(reading.place.file, &missing))?;
                    found.own.extend(own..own + POSE_UNKNOWNS);
                    let failed = |error| reading.failed(machine.explained(error, &view));
                    let by_pose = machine.closures(&view).map_err(failed)?;
                    let is_gross = |link: usize| {
                        chosen.left_out.contains(&RowPlace {
                            drive: Some(link),
                            ..reading.place
                        })
                    };
                    let weight = |link: usize| match (&sigmas, is_gross(link)) {
                        (_, true) => 0.0,
                        (Some(_), _) => 1.0,
                        _ if are_lengths => 1.0,
                        (None, _) => by_pose.slopes[link].recip(),
                    };
                    found.weights.extend((0..count).map(weight));
                    if let Some(sigmas) = &sigmas {
                        let factor = factor(&by_pose, sample.number, sigmas)?;
                        for (is_coupled, entry) in found.is_coupled.iter_mut().zip(&factor) {
                            *is_coupled |= *entry != 0.0;
                        }
                        found.factors.extend(factor);
                    }
                    found.places.push(reading.place);
                }
            }
            Ok::<_, Error>(found)
        };
        let chunks = self.poses.chunks(CHUNK).enumerate().collect();
        let found = parallel::map_owned(chunks, of_chunk).into_iter();
        let found: Vec<ClosureRows> = found.collect::<Result<_, _>>()?;
        for found in &found {
            for (is_coupled, own) in is_coupled.iter_mut().zip(&found.is_coupled) {
                *is_coupled |= own;
            }
        }
        if sigmas.is_some() {
            // Links that no drive moves together are coupled in no sample.
            let coupled = Coupled::new(family, |row, inner| is_coupled[row * count + inner]);
            let coupled = Arc::new(coupled);
            rows.family = Arc::clone(&coupled) as Arc<dyn ResidualFamily>;
            rows.coupled = Some(coupled);
        } else if are_lengths {
            rows.family = Arc::new(Lengths::new(family));
        }
        let samples: usize = found.iter().map(|found| found.places.len()).sum();
        rows.data.reserve_exact(samples * rows.family.shape().data);
        for found in found {
            match &rows.coupled {
                Some(coupled) => coupled.fill(&found.data, &found.factors, &mut rows.data),
                None => rows.data.extend(found.data),
            }
            rows.own.extend(found.own);
            rows.weights.extend(found.weights);
            rows.places.extend(found.places);
        }
        Ok(rows)
    }
}

/// Rows of the closures of some poses.
#[derive(Default)]
struct ClosureRows {
    data: Vec<f64>,
    /// Of each sample the matrix that whitens its closures, by rows, where drives have noise.
    factors: Vec<f64>,
    own: Vec<usize>,
    weights: Vec<f64>,
    places: Vec<RowPlace>,
    /// True of entries of the factors that are not zero throughout.
    is_coupled: Vec<bool>,
}

/// Inverse Cholesky factor, by rows, of the covariance that the noise of the drives gives the closures (m²) of a pose.
fn factor(closures: &Closures, pose: u32, sigmas: &[f64]) -> Result<Vec<f64>, Error> {
    let count = closures.slopes.len();
    let by_drives = DMatrix::from_fn(count, sigmas.len(), |row, command| {
        closures.jacobian[(row, POSE_UNKNOWNS + command)] * sigmas[command]
    });
    let mut covariance = &by_drives * by_drives.transpose();
    // Directions that no drive moves, and differences between links of one cart, are exact.
    let largest = covariance.diagonal().max();
    for row in 0..count {
        covariance[(row, row)] += CLOSURE_SHARE.powi(2) * largest;
    }
    let lower = Cholesky::new(covariance).map(Cholesky::unpack);
    let inverse =
        lower.and_then(|lower| lower.solve_lower_triangular(&DMatrix::identity(count, count)));
    let inverse = inverse.ok_or_else(|| {
        let message = format!("pose {pose}: the closures do not depend on the drives");
        InputError::whole(fit::UNSOLVABLE, "readings.csv", message)
    })?;
    let scaled = DMatrix::from_fn(count, count, |row, column| {
        inverse[(row, column)] / closures.slopes[column]
    });
    Ok(scaled.transpose().as_slice().to_vec())
}
