//! Variance inflation where readings of a visit share an error.
//!
//! Readings of one quantity at one visit are off by e + v: e differs between them, v is what they share (what the machine does
//! not repeat, and what the model lacks there). A model predicts the same for all of them, so that n readings tell of a signal
//! as little as one with the variance var e/n + var v.
//!
//! With the column `u` of a quantity one at each of its readings, and `U` all of them, residuals `M·w` of a fit have
//! `E‖Uᵀ·M·w‖² = var e·tr N + var v·tr N²`, `N = Uᵀ·M·U`: the variance of v follows from that sum and from the scatter of
//! readings about their means, which the fit does not change (C. R. Henderson, *Biometrics* 9, 1953, method 3).

use std::collections::BTreeMap;

use nalgebra::{DMatrix, DVector};
use tau_estimation::joint::{Component, Eliminated};
use tau_estimation::samples::Sample;

use super::constants::Constants;
use super::linear_model::LinearModel;
use crate::subspace::Subspace;

/// Factor by which the statistic of a signal is too large because readings of a visit share an error, at least 1.
///
/// An error counts as shared if means of readings scatter more than readings about their means do, by more than
/// [`Constants::serial`] standard deviations of independent noise.
pub(super) fn inflation(
    linear: &LinearModel,
    subspace: &Subspace,
    (samples, groups): (&[Sample], &[Eliminated]),
    constants: &Constants,
) -> f64 {
    let blocks = blocks(linear, samples, groups);
    let mut quantities = blocks.iter().flat_map(|block| &block.quantities);
    if quantities.all(|quantity| quantity.readings.len() < 2) {
        return 1.0;
    }
    let signal = &subspace.u * subspace.u.tr_mul(&linear.residuals);
    let residuals = &linear.residuals - &signal;
    let mut sums: BTreeMap<Kind, Sums> = BTreeMap::new();
    for block in &blocks {
        let absorbed = linear.rows_with(subspace, &block.rows);
        block.add_to(&mut sums, &residuals, &signal, &absorbed);
    }
    let shown = shown(linear, subspace, &residuals);
    let added = |((component, _), sums): (&Kind, &Sums)| {
        let shown = shown.get(component)?;
        Some(sums.variance_of_signal(constants.serial)? / shown - sums.signal)
    };
    let added: f64 = sums.iter().filter_map(added).sum();
    (1.0 + added / signal.norm_squared().max(f64::MIN_POSITIVE)).max(1.0)
}

/// Variance that the residuals of each component show.
fn shown(
    linear: &LinearModel,
    subspace: &Subspace,
    residuals: &DVector<f64>,
) -> BTreeMap<Component, f64> {
    let mut sums: BTreeMap<Component, (f64, f64)> = BTreeMap::new();
    for (row, at) in linear.rows.iter().enumerate() {
        if linear.factors[row] > 0.0 {
            let absorbed = linear.q.row(row).norm_squared() + subspace.u.row(row).norm_squared();
            let (square, degrees) = sums.entry(at.component).or_default();
            *square += residuals[row].powi(2);
            *degrees += 1.0 - absorbed;
        }
    }
    let told = sums.into_iter().filter(|(_, (_, degrees))| *degrees > 0.0);
    told.map(|(component, (square, degrees))| (component, square / degrees))
        .collect()
}

/// Component of the noise, and where poses are unknown the name of what was measured.
type Kind = (Component, &'static str);

/// A quantity that was measured, once or several times.
struct Quantity {
    kind: Kind,
    /// Index of each reading among the measurements of its block.
    readings: Vec<usize>,
}

/// Residuals that are told apart from all others.
struct Block<'a> {
    rows: Vec<usize>,
    /// Share of each measurement in each residual; `None` where these are the same.
    basis: Option<&'a DMatrix<f64>>,
    quantities: Vec<Quantity>,
}

impl Block<'_> {
    /// The measurements that residuals are of.
    fn measurements(&self, residuals: DMatrix<f64>) -> DMatrix<f64> {
        match self.basis {
            Some(basis) => basis * residuals,
            None => residuals,
        }
    }

    fn add_to(
        &self,
        sums: &mut BTreeMap<Kind, Sums>,
        residuals: &DVector<f64>,
        signal: &DVector<f64>,
        absorbed: &DMatrix<f64>,
    ) {
        let of = |values: &DVector<f64>| {
            let own = values.select_rows(&self.rows);
            self.measurements(DMatrix::from_column_slice(own.len(), 1, own.as_slice()))
        };
        let (left, of_signal) = (of(residuals), of(signal));
        let all = DMatrix::identity(self.rows.len(), self.rows.len());
        let (shares, absorbed) = (self.measurements(all), self.measurements(absorbed.clone()));
        let mut kinds: BTreeMap<Kind, Vec<&[usize]>> = BTreeMap::new();
        for quantity in &self.quantities {
            let own = kinds.entry(quantity.kind).or_default();
            own.push(&quantity.readings);
        }
        for (kind, own) in kinds {
            let sum = |of: &DMatrix<f64>| {
                DMatrix::from_fn(own.len(), of.ncols(), |quantity, column| {
                    own[quantity].iter().map(|&k| of[(k, column)]).sum()
                })
            };
            let (u, p) = (sum(&shares), sum(&absorbed));
            let gram: DMatrix<f64> = &u * u.transpose();
            let sums = sums.entry(kind).or_insert_with(|| Sums::new(p.ncols()));
            sums.traces[0] += gram.trace() - p.norm_squared();
            sums.traces[1] += gram.norm_squared() - 2.0 * p.dot(&(gram * &p));
            sums.absorbed += p.tr_mul(&p);
            for (readings, (sum, of_sum)) in own.iter().zip(sum(&left).iter().zip(&sum(&of_signal)))
            {
                let count = readings.len() as f64;
                let squares = |of: &DMatrix<f64>| -> f64 {
                    readings.iter().map(|&k| of[(k, 0)].powi(2)).sum()
                };
                sums.degrees += count - 1.0;
                sums.apart += squares(&left) - sum * sum / count;
                sums.between += sum * sum;
                sums.signal += squares(&of_signal);
                sums.of_means += of_sum * of_sum;
            }
        }
    }
}

/// Sums over the quantities of a kind.
struct Sums {
    /// Squares of readings about their means, and their degrees of freedom.
    apart: f64,
    degrees: f64,
    /// ‖Uᵀ·e‖² of the residuals.
    between: f64,
    /// tr N, and of tr N² all but the last term, which is that of what the fit absorbs: ‖(QᵀU)·(QᵀU)ᵀ‖².
    traces: [f64; 2],
    absorbed: DMatrix<f64>,
    /// ‖s‖² and ‖Uᵀ·s‖² of the signal.
    signal: f64,
    of_means: f64,
}

impl Sums {
    fn new(absorbed: usize) -> Self {
        Self {
            apart: 0.0,
            degrees: 0.0,
            between: 0.0,
            traces: [0.0; 2],
            absorbed: DMatrix::zeros(absorbed, absorbed),
            signal: 0.0,
            of_means: 0.0,
        }
    }

    /// Variance of the signal's score; `None` where nothing was measured again, or sharing could be chance.
    fn variance_of_signal(&self, least: f64) -> Option<f64> {
        let [trace, squares] = [
            self.traces[0],
            self.traces[1] + self.absorbed.norm_squared(),
        ];
        if self.degrees < 1.0 || trace <= 0.0 || squares <= 0.0 {
            return None;
        }
        let apart = (self.apart / self.degrees).max(f64::MIN_POSITIVE);
        let excess = self.between / (apart * trace) - 1.0;
        let deviation = (2.0 * squares / (trace * trace) + 2.0 / self.degrees).sqrt();
        let shared = (self.between - apart * trace) / squares;
        (excess > least * deviation).then_some(apart * self.signal + shared * self.of_means)
    }
}

/// Residuals by what was measured at visits.
fn blocks<'a>(
    linear: &LinearModel,
    samples: &[Sample],
    groups: &'a [Eliminated],
) -> Vec<Block<'a>> {
    let takes_part = |row: &usize| linear.factors[*row] > 0.0;
    let mut blocks = vec![];
    let mut first = 0;
    for group in groups {
        let rows: Vec<usize> = (first..first + group.by_closure.nrows()).collect();
        first += rows.len();
        if !rows.iter().all(takes_part) {
            continue;
        }
        let mut quantities: BTreeMap<usize, Quantity> = BTreeMap::new();
        for (row, origin) in group.origins.iter().enumerate() {
            let own = quantities.entry(origin.quantity).or_insert(Quantity {
                kind: (Component::Closure, origin.kind),
                readings: vec![],
            });
            own.readings.push(row);
        }
        blocks.push(Block {
            rows,
            basis: Some(&group.basis),
            quantities: quantities.into_values().collect(),
        });
    }
    let mut visits: BTreeMap<_, Vec<usize>> = BTreeMap::new();
    for row in (first..linear.rows.len()).filter(takes_part) {
        let at = &linear.rows[row];
        let sample = &samples[at.sample];
        let of = (at.component, sample.track, at.residual, sample.unit);
        visits.entry(of).or_default().push(row);
    }
    blocks.extend(visits.into_iter().map(|((component, ..), rows)| Block {
        quantities: vec![Quantity {
            kind: (component, ""),
            readings: (0..rows.len()).collect(),
        }],
        rows,
        basis: None,
    }));
    blocks
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::of_set_1;
    use tau_estimation::numerics::distribution::Random;
    use tau_estimation::numerics::projection::Basis;

    const READINGS: usize = 4;

    /// Inflations of a signal that is the same at all readings of a visit, where they share so much of their variance, behind
    /// a fit of smooth curves; with the variance that residuals show in the mean, over that of a reading.
    fn inflations(shared: f64, trials: usize) -> (Vec<f64>, f64) {
        let (joint, mut samples) = of_set_1();
        for (index, sample) in samples.iter_mut().enumerate() {
            sample.unit = index / READINGS;
        }
        let (rows, count) = (&joint.rows, joint.rows.len());
        let unit = |row: usize| samples[rows[row].sample].unit;
        let wave = |row: usize, cycles: f64| (cycles * unit(row) as f64 / 30.0).cos();
        let width = rows.iter().map(|row| row.residual).max().unwrap() + 1;
        let smooth = DMatrix::from_fn(count, 3 * width, |row, column| {
            let own = rows[row].residual == column % width;
            f64::from(own) * wave(row, 2.0 * (column / width) as f64)
        });
        let basis = Basis::of(&smooth).unwrap();
        let signal = DMatrix::from_fn(count, 1, |row, _| wave(row, 11.0));
        let left = basis.residuals_after(&signal.column(0).into_owned());
        let rest = DMatrix::from_column_slice(count, 1, left.as_slice());
        let subspace = Subspace::of(&signal, &rest);
        let mut random = Random(12);
        let mut of_trial = || {
            let visits = DMatrix::from_fn(samples.len(), width, |_, _| random.normal());
            let noise = DVector::from_fn(count, |row, _| {
                let own = (1.0 - shared).sqrt() * random.normal();
                own + shared.sqrt() * visits[(unit(row), rows[row].residual)]
            });
            let linear = LinearModel {
                residuals: basis.residuals_after(&noise),
                q: basis.q.clone(),
                factors: vec![1.0; count],
                rows: rows.clone(),
                degrees: (count - 3 * width) as f64,
                completed: 0.0,
                stated: 1.0,
            };
            let of = (&samples[..], &[][..]);
            inflation(&linear, &subspace, of, &Constants::default())
        };
        let mut found: Vec<f64> = (0..trials).map(|_| of_trial()).collect();
        found.sort_by(f64::total_cmp);
        // The fit absorbs directions of the means of visits.
        let absorbed = (basis.q.ncols() + 1) as f64;
        let left = count as f64 - absorbed * of_means(shared);
        (found, left / (count as f64 - absorbed))
    }

    /// Variance of a visit's mean, a reading's worth: that of e, and that of v for each of the readings.
    fn of_means(shared: f64) -> f64 {
        (1.0 - shared) + READINGS as f64 * shared
    }

    #[test]
    fn a_signal_is_inflated_by_what_visits_share() {
        for shared in [0.3, 0.6] {
            let (found, shown) = inflations(shared, 61);
            let expected = of_means(shared) / shown;
            let median = found[found.len() / 2];
            assert!(
                (median / expected - 1.0).abs() < 0.08,
                "{median} {expected}"
            );
        }
    }

    #[test]
    fn independent_readings_share_nothing() {
        let trials = 300;
        let (found, _) = inflations(0.0, trials);
        let inflated = found.iter().filter(|factor| **factor > 1.0).count();
        // One in 44 exceeds two standard deviations.
        assert!((1..=20).contains(&inflated), "{inflated} of {trials}");
    }
}
