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
    /// Unknowns of the pose that closures must have derivatives by: all.
    pub(super) const FREE: [usize; POSE_UNKNOWNS] = [0, 1, 2, 3, 4, 5];

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

#[cfg(test)]
mod tests {
    use super::*;

    /// One link from an anchor to a point: length² − distance², of length, anchor (a shared parameter along each axis)
    /// and the point's six unknowns, of which three turn it about the origin to no effect.
    struct OneLink;

    impl ResidualFamily for OneLink {
        fn shape(&self) -> Shape {
            Shape {
                data: 0,
                prepared: 0,
                parameters: 4 + POSE_UNKNOWNS,
                residuals: 1,
            }
        }

        fn pattern(&self) -> Pattern<'_> {
            Pattern {
                row_starts: &[0, 10],
                columns: &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9],
            }
        }

        fn prepare(&self, _: &[f64], _: &mut [f64]) {}

        fn value(&self, data: &[f64], parameters: &[f64], residuals: &mut [f64]) {
            self.linearize(data, parameters, residuals, &mut [0.0; 10]);
        }

        fn linearize(&self, _: &[f64], p: &[f64], residuals: &mut [f64], jacobian: &mut [f64]) {
            let way = Vector3::new(p[4] - p[1], p[5] - p[2], p[6] - p[3]);
            // The length follows from the anchor, too, as that of a line counted from the origin.
            let anchor = Vector3::new(p[1], p[2], p[3]);
            let length = p[0] + anchor.norm();
            residuals[0] = length * length - way.norm_squared();
            jacobian.fill(0.0);
            jacobian[0] = 2.0 * length;
            for axis in 0..3 {
                jacobian[1 + axis] = 2.0 * length * anchor[axis] / anchor.norm() + 2.0 * way[axis];
                jacobian[4 + axis] = -2.0 * way[axis];
            }
        }
    }

    /// Length less distance, with derivatives as by central differences.
    #[test]
    fn closures_become_lengths() {
        let lengths = Lengths::new(Arc::new(OneLink));
        let point = [0.3, 1.1, -0.4, 0.2, 0.1, 0.2, 0.5, 0.0, 0.0, 0.0];
        let value = |p: &[f64]| -> f64 {
            let mut found = [0.0];
            lengths.value(&[], p, &mut found);
            found[0]
        };
        let anchor = Vector3::new(1.1, -0.4, 0.2);
        let distance = (Vector3::new(0.1, 0.2, 0.5) - anchor).norm();
        let expected: f64 = 0.3 + anchor.norm() - distance;
        assert!((value(&point) - expected).abs() < 1e-15);
        let (mut residuals, mut jacobian) = ([0.0], [0.0; 10]);
        lengths.linearize(&[], &point, &mut residuals, &mut jacobian);
        assert_eq!(residuals[0], value(&point));
        for (index, entry) in jacobian.iter().enumerate() {
            let at = |step: f64| {
                let mut moved = point;
                moved[index] += step;
                value(&moved)
            };
            let rate = (at(1e-5) - at(-1e-5)) / 2e-5;
            assert!((rate - entry).abs() < 1e-9, "{index}: {rate}, {entry}");
        }
    }
}
