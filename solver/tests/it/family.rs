//! Residual families from models written over [`Scalar`].

use tau_runtime::{Pattern, ResidualFamily, Shape};
use tau_solver::{Block, Parameter, Problem};

use crate::scalar::{Dual, MAX_PARAMETERS, Scalar};

/// Residuals of a sample as a function of parameters, for any kind of number.
pub(crate) trait Model: Send + Sync {
    /// Numbers per sample, parameters, residuals per sample.
    fn sizes(&self) -> (usize, usize, usize);
    /// Writes the residuals.
    fn residuals<T: Scalar>(&self, data: &[f64], x: &[T], out: &mut [T]);
}

/// A model as a residual family with a dense Jacobian by dual numbers.
pub(crate) struct Family<M> {
    model: M,
    row_starts: Vec<u32>,
    columns: Vec<u32>,
}

impl<M: Model> Family<M> {
    pub(crate) fn new(model: M) -> Self {
        let (_, parameters, residuals) = model.sizes();
        assert!(parameters <= MAX_PARAMETERS);
        let [parameters, residuals] = [parameters, residuals].map(|n| u32::try_from(n).unwrap());
        Self {
            model,
            row_starts: (0..=residuals).map(|i| i * parameters).collect(),
            columns: (0..residuals).flat_map(|_| 0..parameters).collect(),
        }
    }
}

impl<M: Model> ResidualFamily for Family<M> {
    fn shape(&self) -> Shape {
        let (data, parameters, residuals) = self.model.sizes();
        Shape {
            data,
            prepared: data,
            parameters,
            residuals,
        }
    }

    fn pattern(&self) -> Pattern<'_> {
        Pattern {
            row_starts: &self.row_starts,
            columns: &self.columns,
        }
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        prepared.copy_from_slice(data);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        self.model.residuals(prepared, parameters, residuals);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        let x: Vec<Dual> = parameters
            .iter()
            .enumerate()
            .map(|(i, &x)| Dual::variable(x, i))
            .collect();
        let mut out = vec![Dual::from(0.0); residuals.len()];
        self.model.residuals(prepared, &x, &mut out);
        for (i, dual) in out.iter().enumerate() {
            residuals[i] = dual.value;
            jacobian[i * x.len()..(i + 1) * x.len()].copy_from_slice(&dual.gradient[..x.len()]);
        }
    }
}

/// A problem of one block whose parameters are those of the family.
pub(crate) fn problem<'a>(
    family: &'a dyn ResidualFamily,
    data: &[f64],
    start: &[f64],
) -> Problem<'a> {
    Problem {
        parameters: start
            .iter()
            .enumerate()
            .map(|(i, &x)| Parameter::new(format!("x{}", i + 1), x))
            .collect(),
        blocks: vec![Block::new(
            "block",
            family,
            (0..start.len()).collect(),
            data,
        )],
    }
}

/// Largest difference between a family's Jacobian over all samples and central differences of sixth
/// order, relative to the largest entry of each column.
pub(crate) fn finite_difference_error(family: &dyn ResidualFamily, data: &[f64], x: &[f64]) -> f64 {
    let shape = family.shape();
    let samples: Vec<Vec<f64>> = if shape.data == 0 {
        vec![Vec::new()]
    } else {
        data.chunks(shape.data).map(<[f64]>::to_vec).collect()
    };
    let prepared: Vec<Vec<f64>> = samples
        .iter()
        .map(|sample| {
            let mut prepared = vec![0.0; shape.prepared];
            family.prepare(sample, &mut prepared);
            prepared
        })
        .collect();
    assert!(shape.parameters > 0 && shape.residuals > 0 && !samples.is_empty());
    let mut worst = 0.0_f64;
    for j in 0..shape.parameters {
        let column = exact_column(family, &prepared, x, j);
        let largest = column.iter().fold(1e-12_f64, |a, b| a.max(b.abs()));
        // The better of several steps: one is too long where the function is curved, another too short
        // where it is large.
        let error = [1e-3, 1e-4, 1e-5].map(|relative| {
            let step = relative * if x[j] == 0.0 { 1.0 } else { x[j].abs() };
            let difference = central_difference(family, &prepared, x, j, step);
            column
                .iter()
                .zip(&difference)
                .map(|(exact, approximate)| (exact - approximate).abs() / largest)
                // The maximum of a number and NaN is the number.
                .map(|error| if error.is_nan() { f64::INFINITY } else { error })
                .fold(0.0, f64::max)
        });
        worst = worst.max(error.into_iter().fold(f64::INFINITY, f64::min));
    }
    worst
}

/// Derivatives by one parameter as the family gives them.
fn exact_column(
    family: &dyn ResidualFamily,
    prepared: &[Vec<f64>],
    x: &[f64],
    parameter: usize,
) -> Vec<f64> {
    let pattern = family.pattern();
    let mut residuals = vec![0.0; family.shape().residuals];
    let mut entries = vec![0.0; pattern.len()];
    let mut column = Vec::new();
    for prepared in prepared {
        family.linearize(prepared, x, &mut residuals, &mut entries);
        for rows in pattern.row_starts.windows(2) {
            let range = rows[0] as usize..rows[1] as usize;
            let place = pattern.columns[range.clone()]
                .iter()
                .position(|&c| c as usize == parameter);
            column.push(place.map_or(0.0, |place| entries[range.start + place]));
        }
    }
    column
}

/// Derivatives by one parameter, of sixth order in the step.
fn central_difference(
    family: &dyn ResidualFamily,
    prepared: &[Vec<f64>],
    x: &[f64],
    parameter: usize,
    step: f64,
) -> Vec<f64> {
    let count = family.shape().residuals;
    let mut residuals = vec![0.0; count];
    let mut difference = vec![0.0; count * prepared.len()];
    for (multiple, factor) in [(1.0, 0.75), (2.0, -0.15), (3.0, 1.0 / 60.0)] {
        for sign in [1.0, -1.0] {
            let mut moved = x.to_vec();
            moved[parameter] += sign * multiple * step;
            for (prepared, difference) in prepared.iter().zip(difference.chunks_mut(count)) {
                family.value(prepared, &moved, &mut residuals);
                for (difference, r) in difference.iter_mut().zip(&residuals) {
                    *difference += sign * factor * r / step;
                }
            }
        }
    }
    difference
}
