//! faer's singular value decomposition as a plain function of `f64`.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::svd::{self, ComputeSvdVectors};
use faer::{Mat, MatRef, Par, Spec};

use crate::Error;

/// Singular values, descending, and right singular vectors (columns of `v`) of a matrix with at least
/// as many rows as columns.
pub(crate) struct Svd {
    pub(crate) values: Vec<f64>,
    pub(crate) v: Mat<f64>,
}

/// Decomposes `matrix`.
pub(crate) fn svd(matrix: MatRef<f64>) -> Result<Svd, Error> {
    let (rows, columns) = (matrix.nrows(), matrix.ncols());
    let mut values = Diag::<f64>::zeros(columns);
    let mut v = Mat::zeros(columns, columns);
    if columns == 0 {
        return Ok(Svd {
            values: Vec::new(),
            v,
        });
    }
    let mut memory = MemBuffer::new(svd::svd_scratch::<f64>(
        rows,
        columns,
        ComputeSvdVectors::No,
        ComputeSvdVectors::Full,
        Par::Seq,
        Spec::default(),
    ));
    svd::svd(
        matrix,
        values.as_mut(),
        None,
        Some(v.as_mut()),
        Par::Seq,
        MemStack::new(&mut memory),
        Spec::default(),
    )
    .map_err(|_| Error::SingularValues)?;
    Ok(Svd {
        values: (0..columns).map(|i| values[i]).collect(),
        v,
    })
}
