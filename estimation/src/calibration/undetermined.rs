//! Combinations of parameters that measurements leave to tolerances.

use nalgebra::{DMatrix, DVector};
use tau_solver::{Block, Parameter, Problem, Undetermined};

use super::Combination;
use crate::numerics::number;

/// Number of combinations that rows R determine at all, and those of which the priors of the parameters say more; RᵀR is the
/// information of the measurements.
///
/// # Errors
/// As [`tau_solver::identifiability`].
pub(crate) fn undetermined(
    parameters: Vec<Parameter>,
    rows: &DMatrix<f64>,
    values: &[f64],
) -> Result<(usize, Vec<Combination>), tau_solver::Error> {
    // The solver takes no block without residuals.
    if parameters.is_empty() {
        return Ok((0, vec![]));
    }
    let family = Linear::new(rows);
    let block = Block::new("measurements", &family, (0..values.len()).collect(), &[]);
    let problem = Problem {
        parameters,
        blocks: vec![block],
    };
    let found = tau_solver::identifiability(&problem, values)?;
    let name = |&(index, share): &(usize, f64)| (problem.parameters[index].name.clone(), share);
    let of = |combination: &Undetermined| Combination {
        terms: combination.terms.iter().map(name).collect(),
        data_over_prior: combination.data_over_prior,
    };
    Ok((found.rank, found.undetermined.iter().map(of).collect()))
}

/// Linear residuals `R·x` for what asks for derivatives alone.
struct Linear {
    triangle: DMatrix<f64>,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
}

impl Linear {
    fn new(triangle: &DMatrix<f64>) -> Self {
        let (rows, width) = triangle.shape();
        Self {
            triangle: triangle.clone(),
            row_starts: (0..=rows).map(|row| number(row * width)).collect(),
            columns: (0..rows).flat_map(|_| (0..width).map(number)).collect(),
        }
    }
}

impl tau_runtime::ResidualFamily for Linear {
    fn shape(&self) -> tau_runtime::Shape {
        tau_runtime::Shape {
            data: 0,
            prepared: 0,
            parameters: self.triangle.ncols(),
            residuals: self.triangle.nrows(),
        }
    }

    fn pattern(&self) -> tau_runtime::Pattern<'_> {
        tau_runtime::Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, _: &[f64], _: &mut [f64]) {}

    fn value(&self, _: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        let product = &self.triangle * DVector::from_column_slice(parameters);
        residuals.copy_from_slice(product.as_slice());
    }

    fn linearize(
        &self,
        data: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.value(data, parameters, residuals);
        jacobian.copy_from_slice(self.triangle.transpose().as_slice());
    }
}
