//! Covariance of the parameters at a solution.

use faer::Mat;

use crate::fused::Fused;
use crate::jacobian::Jacobian;
use crate::linear::qr::triangle;
use crate::linear::svd::svd;
use crate::linear::{Method, SchurCholesky, SparseCholesky, pays};
use crate::partition::{Part, partition};
use crate::system::{Content, System};
use crate::{Error, Parameter, Problem};

/// Parts with more parameters are factored sparsely.
const DENSE_COVARIANCE_COLUMNS: usize = 400;
/// Share of a direction without information from which on a parameter counts as taking part in it.
const LEAST_SHARE: f64 = 1e-6;

/// Covariance of the parameters for residuals in units of their noise.
///
/// The linear approximation `(JᵀJ)⁻¹`, priors included, robust losses as weights. Fixed parameters
/// have none; parameters in different independent parts are uncorrelated; parameters that nothing
/// determines have infinite variance. Bounds are ignored.
///
/// Small parts are inverted at once; in large ones each question costs a triangular solve.
#[derive(Debug)]
pub struct Covariance {
    /// Part and column of each parameter.
    place: Vec<Place>,
    parts: Vec<PartCovariance>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Fixed,
    Unknown,
    In { part: usize, column: usize },
}

/// Computes the covariance at `parameters`, one value per parameter of the problem.
///
/// # Errors
/// As [`solve`](crate::solve), at `parameters` instead of the start; [`Error::ParameterCount`] where these are
/// too many or too few; [`Error::SingularValues`] where a decomposition fails.
pub fn covariance(problem: &Problem, parameters: &[f64]) -> Result<Covariance, Error> {
    check_at(problem, parameters)?;
    let mut covariance = Covariance::of_none(problem);
    for part in &partition(problem).parts {
        covariance.add(problem, parameters, part)?;
    }
    Ok(covariance)
}

/// Derivatives of the data of a part, reduced.
pub(crate) struct Data {
    /// The triangle, its columns multiplied by `factors`.
    pub(crate) triangle: Mat<f64>,
    /// Reciprocal norms of the columns.
    pub(crate) factors: Vec<f64>,
}

impl Data {
    /// Those of a part at a point: by way of the normal equations where the iteration goes that way too, so that no Jacobian
    /// of very many samples is stored.
    pub(crate) fn new(problem: &Problem, part: &Part, parameters: &[f64]) -> Result<Self, Error> {
        let x: Vec<f64> = part.parameters.iter().map(|&p| parameters[p]).collect();
        let content = Content::DataOnly;
        let jacobian = match Fused::new(problem, part, parameters, content, Method::Auto) {
            Some(mut fused) => {
                let linearized = fused.linearize(&x);
                linearized.map_err(|fault| fault.into_error(problem))?;
                fused.triangle
            }
            None => linearized(problem, part, parameters, content)?.jacobian,
        };
        let factors = inverse_column_norms(&jacobian);
        Ok(Self {
            triangle: triangle(&jacobian, &factors),
            factors,
        })
    }
}

/// Derivatives of a part at a point, row by row.
fn linearized<'p>(
    problem: &'p Problem<'p>,
    part: &Part,
    parameters: &[f64],
    content: Content,
) -> Result<System<'p>, Error> {
    let mut system = System::new(problem, part, parameters, content);
    let x: Vec<f64> = part.parameters.iter().map(|&p| parameters[p]).collect();
    let linearized = system.linearize(&x);
    linearized.map_err(|fault| fault.into_error(problem))?;
    Ok(system)
}

/// Checks a problem and a point of it.
pub(crate) fn check_at(problem: &Problem, parameters: &[f64]) -> Result<(), Error> {
    problem.check()?;
    if parameters.len() != problem.parameters.len() {
        return Err(Error::ParameterCount {
            expected: problem.parameters.len(),
            found: parameters.len(),
        });
    }
    Ok(())
}

/// The covariance of one part.
#[derive(Debug)]
enum PartCovariance {
    Dense(Mat<f64>),
    /// By elimination of what touches few residuals.
    Schur {
        /// Of the normal equations with columns multiplied by `factors`.
        factor: Box<SchurCholesky>,
        factors: Vec<f64>,
    },
    Sparse {
        /// Of the normal equations with columns multiplied by `factors`.
        factor: Box<SparseCholesky>,
        factors: Vec<f64>,
    },
}

impl PartCovariance {
    fn new(system: &mut System) -> Result<Self, Error> {
        let factors = inverse_column_norms(&system.jacobian);
        if factors.len() > DENSE_COVARIANCE_COLUMNS {
            let jacobian = &mut system.jacobian;
            for (&column, value) in jacobian.columns.iter().zip(&mut jacobian.values) {
                *value *= factors[column as usize];
            }
            let elimination = SchurCholesky::elimination(jacobian);
            if pays(&elimination, factors.len()) {
                let mut factor = Box::new(SchurCholesky::new(jacobian, &elimination));
                if factor.factor_undamped(jacobian, &system.residuals) {
                    return Ok(Self::Schur { factor, factors });
                }
            }
            let mut factor = Box::new(SparseCholesky::new(jacobian)?);
            if factor.factor_undamped(jacobian, &system.residuals) {
                return Ok(Self::Sparse { factor, factors });
            }
            // singular: only the dense decomposition tells which parameters are to blame
            return dense_covariance(system, &vec![1.0; factors.len()], &factors).map(Self::Dense);
        }
        dense_covariance(system, &factors, &factors).map(Self::Dense)
    }

    fn entry(&self, i: usize, j: usize) -> f64 {
        match self {
            Self::Dense(matrix) => matrix[(i, j)],
            Self::Schur { factor, factors } => {
                factors[i] * factors[j] * factor.inverse_entry(i.min(j), i.max(j))
            }
            Self::Sparse { factor, factors } => {
                factors[i] * factors[j] * factor.inverse_entry(i.min(j), i.max(j))
            }
        }
    }
}

/// Covariance by singular values of the Jacobian with columns multiplied by `scaling`; entry i, j of
/// what comes out is multiplied by the factors of i and j.
fn dense_covariance(system: &System, scaling: &[f64], factors: &[f64]) -> Result<Mat<f64>, Error> {
    of_triangle(&triangle(&system.jacobian, scaling), factors)
}

fn of_triangle(triangle: &Mat<f64>, factors: &[f64]) -> Result<Mat<f64>, Error> {
    let n = factors.len();
    let decomposition = svd(triangle.as_ref())?;
    let least = rank_tolerance(&decomposition.values);
    let rank = decomposition
        .values
        .iter()
        .take_while(|&&s| s > least)
        .count();
    let v = &decomposition.v;
    let undetermined: Vec<bool> = (0..n)
        .map(|i| (rank..n).any(|k| v[(i, k)].abs() > LEAST_SHARE))
        .collect();
    Ok(Mat::from_fn(n, n, |i, j| {
        if undetermined[i] || undetermined[j] {
            return if i == j { f64::INFINITY } else { f64::NAN };
        }
        let sum: f64 = (0..rank)
            .map(|k| v[(i, k)] * v[(j, k)] / decomposition.values[k].powi(2))
            .sum();
        sum * factors[i] * factors[j]
    }))
}

/// Reciprocal column norms of a Jacobian; one for columns of zeros.
fn inverse_column_norms(jacobian: &Jacobian) -> Vec<f64> {
    let mut norms = vec![0.0; jacobian.column_count];
    jacobian.column_norms(&mut norms);
    norms
        .iter()
        .map(|&norm| if norm > 0.0 { 1.0 / norm } else { 1.0 })
        .collect()
}

/// Singular values up to this are rounding.
pub(crate) fn rank_tolerance(values: &[f64]) -> f64 {
    values.first().unwrap_or(&0.0) * f64::EPSILON * 8.0 * values.len() as f64
}

impl Covariance {
    /// Before any part is known.
    pub(crate) fn of_none(problem: &Problem) -> Self {
        let place = |parameter: &Parameter| {
            if parameter.is_free() {
                Place::Unknown
            } else {
                Place::Fixed
            }
        };
        Self {
            place: problem.parameters.iter().map(place).collect(),
            parts: Vec::new(),
        }
    }

    /// Adds a part.
    pub(crate) fn add(
        &mut self,
        problem: &Problem,
        parameters: &[f64],
        part: &Part,
    ) -> Result<(), Error> {
        for (column, &p) in part.parameters.iter().enumerate() {
            self.place[p] = Place::In {
                part: self.parts.len(),
                column,
            };
        }
        let system = &mut linearized(problem, part, parameters, Content::Information)?;
        let own = PartCovariance::new(system)?;
        self.parts.push(own);
        Ok(())
    }

    /// Standard deviation of a parameter, by index in the problem: zero if fixed, infinite if nothing
    /// determines it.
    ///
    /// # Panics
    /// Where the problem has no parameter of that index.
    pub fn sigma(&self, parameter: usize) -> f64 {
        self.covariance(parameter, parameter).sqrt()
    }

    /// Covariance of two parameters, by index in the problem. Not a number where one of two different
    /// parameters of the same part is undetermined.
    ///
    /// # Panics
    /// Where the problem has no parameter of one of the indices.
    pub fn covariance(&self, first: usize, second: usize) -> f64 {
        match (self.place[first], self.place[second]) {
            (Place::Unknown, Place::Unknown) if first == second => f64::INFINITY,
            (
                Place::In { part, column: i },
                Place::In {
                    part: other,
                    column: j,
                },
            ) if part == other => self.parts[part].entry(i, j),
            _ => 0.0,
        }
    }

    /// Correlation coefficient of two parameters, by index in the problem.
    ///
    /// One of a parameter with itself, be it fixed or undetermined. Zero of different ones where either is
    /// fixed, where no residual and no prior knows it, or where they are in different parts. Not a number where
    /// one of two different parameters of the same part is undetermined.
    ///
    /// # Panics
    /// Where the problem has no parameter of one of the indices.
    pub fn correlation(&self, first: usize, second: usize) -> f64 {
        if first == second {
            return 1.0;
        }
        let covariance = self.covariance(first, second);
        if covariance == 0.0 {
            0.0
        } else {
            covariance / (self.sigma(first) * self.sigma(second))
        }
    }
}
