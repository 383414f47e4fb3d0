//! How subspaces of candidates overlap.

use nalgebra::{DMatrix, DVector};
use tau_estimation::numerics::projection::Subspace;

use super::super::response::Responses;
use super::super::view::View;
use super::{Bench, Score, Table};

impl Bench {
    /// Of some scores, the components `Uᵀe` in the candidate's subspace, and `UᵀU` with another subspace.
    pub(in super::super) fn overlaps(
        &self,
        view: &View,
        table: &Table,
        with: &Subspace,
        of: &[&Score],
    ) -> Vec<(DVector<f64>, DMatrix<f64>)> {
        let sums: Vec<Vec<DVector<f64>>> = with
            .u
            .column_iter()
            .map(|column| Responses::sums(view, &self.probes, column.as_slice()))
            .collect();
        let across: Vec<DVector<f64>> = sums
            .iter()
            .map(|sums| self.columns.products(|probe| sums[probe].as_slice()))
            .collect();
        let plain = self.columns.score(&table.responses);
        of.iter()
            .map(|score| {
                if let Some(value) = score.searched {
                    let Some(point) = self.point(&table.responses, score.candidate, value) else {
                        return (DVector::zeros(0), DMatrix::zeros(0, with.rank()));
                    };
                    let own = point.columns.score(&table.responses);
                    let across: Vec<DVector<f64>> = sums
                        .iter()
                        .map(|sums| point.columns.products(|probe| sums[probe].as_slice()))
                        .map(|products| point.coefficients.tr_mul(&products))
                        .collect();
                    return (point.coefficients.tr_mul(&own), columns_of(&across));
                }
                let place = self
                    .places
                    .iter()
                    .position(|place| place.0 == score.candidate);
                let Some(place) = place else {
                    return (DVector::zeros(0), DMatrix::zeros(0, with.rank()));
                };
                let (range, c) = (&self.places[place].1, &table.plain.coefficients[place]);
                let rows =
                    |products: &DVector<f64>| c.tr_mul(&products.rows(range.start, range.len()));
                let across: Vec<DVector<f64>> = across.iter().map(rows).collect();
                (rows(&plain), columns_of(&across))
            })
            .collect()
    }
}

fn columns_of(columns: &[DVector<f64>]) -> DMatrix<f64> {
    if columns.is_empty() {
        return DMatrix::zeros(0, 0);
    }
    DMatrix::from_columns(columns)
}
