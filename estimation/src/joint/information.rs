//! Information of the rows of a fit about its unknowns, without priors: sums, which need no room for the rows.

use std::ops::AddAssign;

use nalgebra::{DMatrix, DVector};
use tau_kinematics::Machine;
use tau_robot::robot::{Arm, Instance, Owner};

use super::Joint;
use crate::machine::Nominal;
use crate::numerics::grouped::Grouped;
use crate::samples::Sample;

/// Sums over rows.
#[derive(Debug, Clone, Default)]
pub(crate) struct Information {
    /// `JᵀJ`.
    pub(crate) matrix: DMatrix<f64>,
    /// `Jᵀe`, less its bias by the noise of measured poses.
    pub(crate) gradient: DVector<f64>,
    /// `Jᵀc` of the scale of the way of each closure's joint: unknowns × closures.
    pub(crate) by_way: DMatrix<f64>,
    /// `eᵀe`.
    pub(crate) squares: f64,
}

impl Information {
    /// Of residuals and derivatives, priors last.
    pub(crate) fn of(
        joint: &Joint,
        jacobian: &Grouped,
        residuals: &DVector<f64>,
        samples: &[Sample],
    ) -> Self {
        let rows = joint.rows.len();
        let mut matrix = jacobian.gram();
        for k in 0..matrix.ncols() {
            let prior = joint.priors.get(k).and_then(Nominal::sigma);
            // What stands in for a prior that is not there.
            let weight = prior.map_or_else(
                || jacobian.select_columns(&[k])[(rows + k, 0)].powi(2),
                |sigma| sigma.powi(-2),
            );
            matrix[(k, k)] -= weight;
        }
        let mut measured = residuals.clone();
        measured.rows_range_mut(rows..).fill(0.0);
        let mut gradient = jacobian.gradient(&measured);
        for (gradient, bias) in gradient.iter_mut().zip(&joint.bias) {
            *gradient -= bias;
        }
        let closures: Vec<&Instance> = joint.machine.closure_instances().collect();
        let mut by_way = DMatrix::zeros(gradient.len(), closures.len());
        for (k, closure) in closures.into_iter().enumerate() {
            let along = Way::of(&joint.machine, closure)
                .and_then(|way| joint.along(&way, jacobian, samples));
            if let Some(along) = along {
                by_way.set_column(k, &jacobian.gradient(&along));
            }
        }
        Self {
            matrix,
            gradient,
            by_way,
            squares: measured.norm_squared(),
        }
    }

    /// Information about the first unknowns: the last ones, with the information of their priors, are eliminated.
    pub(crate) fn without_points(self, priors: &[f64]) -> Self {
        let kept = self.gradient.len() - priors.len();
        if priors.is_empty() {
            return self;
        }
        let mut own = (self.matrix)
            .view((kept, kept), (priors.len(), priors.len()))
            .into_owned();
        for (k, prior) in priors.iter().enumerate() {
            own[(k, k)] += prior;
        }
        let Some(own) = own.cholesky() else {
            return self;
        };
        let with = self.matrix.view((kept, 0), (priors.len(), kept));
        let follows = own.solve(&with);
        let ways = self.by_way.ncols();
        let of_points = |k: usize| {
            self.by_way
                .view((kept, 0), (priors.len(), ways))
                .column(k)
                .into_owned()
        };
        let mut by_way = self.by_way.rows(0, kept).into_owned();
        for k in 0..ways {
            let mut column = by_way.column_mut(k);
            column -= follows.tr_mul(&of_points(k));
        }
        Self {
            matrix: self.matrix.view((0, 0), (kept, kept)) - follows.tr_mul(&with),
            gradient: self.gradient.rows(0, kept)
                - follows.tr_mul(&self.gradient.rows(kept, priors.len())),
            by_way,
            squares: self.squares,
        }
    }
}

impl AddAssign<&Self> for Information {
    fn add_assign(&mut self, other: &Self) {
        self.matrix += &other.matrix;
        self.gradient += &other.gradient;
        self.by_way += &other.by_way;
        self.squares += other.squares;
    }
}

/// The way of a closure's joint along the measured path of its cart.
pub(crate) struct Way {
    pub(crate) track: usize,
    /// Parameters of the joint's place at command 0.
    pub(crate) offset: [usize; 3],
}

impl Way {
    /// `None` where the joint's place at command 0 is no parameter of the variant, or nothing was measured of its path.
    pub(crate) fn of(machine: &Machine, closure: &Instance) -> Option<Self> {
        let variant = &machine.variant;
        let owner = match variant.arm {
            Arm::Full => Owner::Link(closure.of),
            Arm::Reduced => Owner::Cluster(closure.of),
        };
        let offset = |axis| variant.parameter(owner, "track_offset", Some(axis));
        let track = machine.track_of(closure)?;
        machine.measured_path(track)?;
        Some(Self {
            track,
            offset: [offset(0)?, offset(1)?, offset(2)?],
        })
    }
}

impl Joint {
    /// Derivatives of all rows by the scale of a way: a joint that goes further is displaced in proportion.
    pub(crate) fn along(
        &self,
        way: &Way,
        jacobian: &Grouped,
        samples: &[Sample],
    ) -> Option<DVector<f64>> {
        let path = self.machine.measured_path(way.track)?;
        let place = |axis: usize| Some((axis, self.used.binary_search(&way.offset[axis]).ok()?));
        let (axes, places): (Vec<usize>, Vec<usize>) = (0..3).filter_map(place).unzip();
        let by_offset = jacobian.select_columns(&places);
        let mut along = DVector::zeros(jacobian.nrows());
        for (row, at) in self.rows.iter().enumerate() {
            let travel = path.at(samples[at.sample].commands_m[way.track]);
            let own = axes.iter().enumerate();
            along[row] = own
                .map(|(k, &axis)| by_offset[(row, k)] * travel[axis])
                .sum();
        }
        Some(along)
    }
}
