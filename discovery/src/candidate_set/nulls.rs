//! Residuals under random signs, in which upcrossings of searches are counted.

use nalgebra::DVector;
use tau_estimation::numerics::distribution::Random;

use super::super::linear_model::LinearModel;
use super::super::response::Responses;
use super::CandidateSet;
use super::searched::Scans;

/// Number of null scans.
const SCANS: usize = 24;

impl CandidateSet {
    /// Residuals of which each unit has a random sign, as sums over the samples of each probe, unless upcrossings have
    /// been counted.
    pub(super) fn nulls(&self, linear: &LinearModel, scans: &Scans) -> Vec<Vec<DVector<f64>>> {
        if scans.bands.iter().all(|band| band.crossings().is_some()) {
            return vec![];
        }
        let mut random = Random(self.seed);
        let null = |_| {
            let signs: Vec<f64> = (0..self.units).map(|_| random.sign()).collect();
            let mut turned = DVector::zeros(linear.residuals.len());
            for (row, at) in linear.rows.iter().enumerate() {
                turned[row] = linear.residuals[row] * signs[self.samples[at.sample].unit];
            }
            let absorbed = linear.q.tr_mul(&turned);
            turned.gemv(-1.0, &*linear.q, &absorbed, 1.0);
            Responses::sums(linear, &self.probes, turned.as_slice())
        };
        (0..SCANS).map(null).collect()
    }
}
