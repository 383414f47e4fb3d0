//! Numbers of a hypothesis, estimated beside the machine: a frame and a zero that the drawing tells are as far off as it is.

use nalgebra::{DMatrix, DVector, Rotation3, Vector3};

use crate::joint::judged::Judged;
use crate::trust::hypothesis::{Case, Hypothesis};
use crate::trust::tried::{ITERATIONS, judged};

/// Change of a number (m or rad) by which its derivatives are taken.
const STEP: f64 = 1e-6;
/// Steps of Gauss and Newton's method: closures are nearly linear over what a drawing is off.
const STEPS: usize = 3;

/// The hypothesis with the numbers that bring squares, those of the tolerances among them, to their least; as it is where it
/// has none, or they are not determined.
pub(super) fn refined(case: &Case<'_>, mut hypothesis: Hypothesis) -> Hypothesis {
    for _ in 0..STEPS {
        match step(case, &hypothesis) {
            Some(better) => hypothesis = better,
            None => break,
        }
    }
    hypothesis
}

/// A step of Gauss and Newton's method in the numbers and all parameters together: with J the derivatives of the whitened
/// residuals r by the parameters, priors among the rows, and G those by the numbers, −(GᵀMG)⁻¹·GᵀMr with
/// M = 1 − J·(JᵀJ)⁻¹·Jᵀ.
fn step(case: &Case<'_>, hypothesis: &Hypothesis) -> Option<Hypothesis> {
    let varied = varied(case, hypothesis);
    if varied.is_empty() {
        return None;
    }
    let mended = case.mended(hypothesis);
    let prepared = mended.prepared().ok()?;
    let at = judged(&mended, &prepared, &prepared.machine.values, ITERATIONS).ok()?;
    let values = at.values();
    let residuals = &at.descent().residuals;
    let columns: Option<Vec<DVector<f64>>> = (varied.iter())
        .map(|other| {
            let mended = case.mended(&changed(hypothesis, other, STEP));
            let moved = judged(&mended, &prepared, &values, 0).ok()?;
            Some((&moved.descent().residuals - residuals) / STEP)
        })
        .collect();
    let by_numbers = DMatrix::from_columns(&columns?);
    let seen = |column: &DVector<f64>| gradient(&at, column);
    let shared: Vec<DVector<f64>> = by_numbers
        .column_iter()
        .map(|own| at.factor().tr_mul(&seen(&own.into_owned())))
        .collect();
    let shared = DMatrix::from_columns(&shared);
    let absorbed = at.factor().tr_mul(&seen(residuals));
    let information = by_numbers.tr_mul(&by_numbers) - shared.tr_mul(&shared);
    let slope = by_numbers.tr_mul(residuals) - shared.tr_mul(&absorbed);
    let change = -information.cholesky()?.solve(&slope);
    let moved = varied.iter().zip(change.iter());
    let better = moved.fold(hypothesis.clone(), |found, (number, &by)| {
        changed(&found, number, by)
    });
    change
        .iter()
        .all(|change| change.is_finite())
        .then_some(better)
}

fn gradient(at: &Judged, residuals: &DVector<f64>) -> DVector<f64> {
    at.descent().normal.gradient(residuals)
}

/// A number of a hypothesis.
enum Number {
    Zero,
    Turn(usize),
    Shift(usize),
}

/// The numbers of a hypothesis that a plate of its freedoms can tell.
fn varied(case: &Case<'_>, hypothesis: &Hypothesis) -> Vec<Number> {
    let along = case.robot.plate.freedoms_of_tcp();
    let about = if case.robot.plate.is_in_plane() {
        2..3
    } else {
        0..3
    };
    match hypothesis {
        Hypothesis::Zero { .. } => vec![Number::Zero],
        Hypothesis::Frame { .. } => {
            let turns = about.map(Number::Turn);
            turns
                .chain(along.iter().copied().map(Number::Shift))
                .collect()
        }
        _ => vec![],
    }
}

fn changed(hypothesis: &Hypothesis, number: &Number, by: f64) -> Hypothesis {
    match (hypothesis, number) {
        (&Hypothesis::Zero { command, by: at }, Number::Zero) => Hypothesis::Zero {
            command,
            by: at + by,
        },
        (Hypothesis::Frame { rotation, shift }, Number::Turn(axis)) => {
            let turn = Rotation3::new(Vector3::ith(*axis, by));
            Hypothesis::Frame {
                rotation: turn * rotation,
                shift: turn * shift,
            }
        }
        (Hypothesis::Frame { rotation, shift }, Number::Shift(axis)) => Hypothesis::Frame {
            rotation: *rotation,
            shift: shift + Vector3::ith(*axis, by),
        },
        _ => hypothesis.clone(),
    }
}
