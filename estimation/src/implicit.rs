//! The implicit function theorem on the closures: how pose and commands follow parameters.
//!
//! Closures r(X, q, p) = 0 hold for whatever parameters p, so that ∂(unknowns)/∂p = −(∂r/∂unknowns)⁺ ∂r/∂p, where the
//! unknowns are some of the pose X and the commands q. Where closures are more than unknowns, it is the solution of
//! least squares that follows, to first order in their mismatch.

use nalgebra::{DMatrix, DVector};
use tau_kinematics::{self as kinematics, Machine, Sample, least_norm};

/// The closures of a machine at a sample, linearised.
pub(crate) struct Linearized {
    /// Derivatives by translation, rotation vector and commands: one row per closure, each divided by the length of its
    /// gradient in the plate's position.
    pub(crate) by_pose: DMatrix<f64>,
    /// The closures themselves, likewise (m).
    pub(crate) residuals: DVector<f64>,
    /// Derivatives by parameters, likewise: of each closure the index in the variant and the entry.
    pub(crate) by_parameters: Vec<Vec<(usize, f64)>>,
}

impl Linearized {
    /// The closures at a sample on which they hold.
    ///
    /// # Errors
    /// Data that the sample lacks; a derivative that is not finite.
    pub(crate) fn new(machine: &Machine, sample: &Sample<'_>) -> Result<Self, kinematics::Error> {
        let kinematics::Closures {
            residuals,
            jacobian: by_pose,
            slopes,
        } = machine.closures(sample)?;
        let mut by_parameters = machine.closures_by_parameters(sample)?;
        for (own, slope) in by_parameters.iter_mut().zip(&slopes) {
            let scale = slope.recip();
            for (_, entry) in own {
                *entry *= scale;
            }
        }
        Ok(Self {
            by_pose,
            residuals,
            by_parameters,
        })
    }

    /// −(∂r/∂unknowns)⁺ for columns of pose and commands: one row per unknown, one column per closure. `None` where
    /// nothing holds the unknowns.
    pub(crate) fn response(&self, unknowns: &[usize]) -> Option<DMatrix<f64>> {
        let reduced = self.by_pose.select_columns(unknowns);
        let identity = DMatrix::identity(reduced.nrows(), reduced.nrows());
        Some(-least_norm(&reduced, &identity)?)
    }
}
