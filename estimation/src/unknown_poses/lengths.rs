//! Closures as lengths, for links whose length has noise.
//!
//! Closures are squares: length² − distance². Over twice the distance they are lengths to first order, which is enough
//! where residuals are micrometres. Where lines or belts are millimetres off, a least-squares fit of squares leans
//! towards small distances, along combinations that the data hardly determine by more than a standard deviation.

use std::sync::Arc;

use nalgebra::Vector3;
use tau_runtime::{Pattern, ResidualFamily, Shape};

use crate::problem::POSE_UNKNOWNS;

/// Share of its distance by which a joint is moved towards the other for second derivatives, which are exact at any:
/// a closure is a polynomial of second degree in the translation of the plate.
const STEP: f64 = 0.5;

/// The length of each link less the distance of its joints (m).
pub(super) struct Lengths {
    /// Closures (m²) as functions of shared parameters and the pose's unknowns.
    closures: Arc<dyn ResidualFamily>,
}

impl Lengths {
    pub(super) fn new(closures: Arc<dyn ResidualFamily>) -> Self {
        Self { closures }
    }

    /// Range of the entries of a row.
    fn row(&self, row: usize) -> std::ops::Range<usize> {
        let starts = self.closures.pattern().row_starts;
        starts[row] as usize..starts[row + 1] as usize
    }

    /// From a closure (m²) and its derivatives: length less distance (m), distance, and the direction in which the
    /// plate's joint lies from the other.
    fn length(&self, row: usize, closure: f64, entries: &[f64]) -> (f64, f64, Vector3<f64>) {
        let entries = &entries[self.row(row)];
        let by_pose = &entries[entries.len() - POSE_UNKNOWNS..];
        let way = Vector3::from_column_slice(&by_pose[..3]) * -0.5;
        let distance = way.norm();
        let length = (closure + distance * distance).max(0.0).sqrt();
        (length - distance, distance, way / distance)
    }
}

impl ResidualFamily for Lengths {
    fn shape(&self) -> Shape {
        self.closures.shape()
    }

    fn pattern(&self) -> Pattern<'_> {
        self.closures.pattern()
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        self.closures.prepare(data, prepared);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let mut entries = vec![0.0; self.pattern().len()];
        self.closures
            .linearize(prepared, parameters, residuals, &mut entries);
        for (row, residual) in residuals.iter_mut().enumerate() {
            *residual = self.length(row, *residual, &entries).0;
        }
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.closures
            .linearize(prepared, parameters, residuals, jacobian);
        let own = parameters.len() - POSE_UNKNOWNS;
        let mut moved = parameters.to_vec();
        let mut there = vec![0.0; jacobian.len()];
        let mut closures = vec![0.0; residuals.len()];
        for (row, residual) in residuals.iter_mut().enumerate() {
            let (off, distance, way) = self.length(row, *residual, jacobian);
            *residual = off;
            for axis in 0..3 {
                moved[own + axis] = parameters[own + axis] - STEP * distance * way[axis];
            }
            self.closures
                .linearize(prepared, &moved, &mut closures, &mut there);
            let range = self.row(row);
            let (here, there) = (&mut jacobian[range.clone()], &there[range]);
            let shared = here.len() - POSE_UNKNOWNS;
            let length = distance + off;
            for (here, there) in here[..shared].iter_mut().zip(there) {
                let by_distance = (there - *here) / (2.0 * STEP * distance);
                let by_length = (*here + 2.0 * distance * by_distance) / (2.0 * length);
                *here = by_length - by_distance;
            }
            for entry in &mut here[shared..] {
                *entry /= 2.0 * distance;
            }
        }
    }
}
