//! Proposal of the measurement that would tell an effect from its rival.

use nalgebra::{Cholesky, DMatrix, DVector};
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::distribution::{chi2_quantile_above, detectable_noncentrality};
use tau_estimation::numerics::order::largest_first;
use tau_estimation::numerics::products::transposed_times;
use tau_estimation::samples::{Sample, Treatment};

use super::candidate_set::CandidateSet;
use super::candidates::{self, Candidate};
use super::linear_model::scale_rows;
use super::results::{Separation, TREATMENTS};

/// Further poses that are proposed.
pub(crate) const POSES: usize = 30;
/// A measurement that raises the separation by less than this factor is not worth proposing.
pub(crate) const MIN_SEPARATION_GAIN: f64 = 2.0;

/// An effect with values of its parameters.
pub(super) struct Signal<'a> {
    pub(super) candidate: &'a Candidate,
    pub(super) values: Vec<f64>,
}

/// Poses of set 1, repeated under other conditions, that separate an effect as fitted from a
/// rival, or that nothing does. The rival is one effect or several together.
///
/// The separation is the non-centrality that is left of the effect's signal once base and rival have
/// been fitted to it, over the old rows and those of the poses that are repeated: those where the
/// signal is predicted worst.
pub(super) fn separate_by(
    set: &CandidateSet,
    fit: &Fit,
    own: &Signal<'_>,
    rivals: &[Signal<'_>],
    base: &[usize],
) -> Separation {
    let Some(now) = system(set, fit, own, rivals, base, Treatment::Same) else {
        return Separation::NotInSet1;
    };
    let present = now.all().separation();
    let parameters: usize = rivals.iter().map(|r| r.candidate.parameters.len()).sum();
    let parameters = parameters as f64;
    let threshold = chi2_quantile_above(set.constants.level, parameters);
    let needed = detectable_noncentrality(threshold, parameters, set.constants.power);
    let best = TREATMENTS
        .into_iter()
        .filter_map(|(treatment, _)| {
            let (poses, sum) = if treatment == Treatment::Same {
                now.with_best(&now)
            } else {
                now.with_best(&system(set, fit, own, rivals, base, treatment)?)
            };
            Some((sum.separation(), poses, treatment))
        })
        .max_by(|a, b| a.0.total_cmp(&b.0));
    let Some((raised, poses, treatment)) = best else {
        return Separation::NotInSet1;
    };
    let mut poses: Vec<u32> = poses.iter().map(|&s| set.samples[s].number).collect();
    poses.sort_unstable();
    Separation::Repeat {
        poses,
        treatment,
        chi2: [present, raised, needed],
    }
}

/// Products of the columns of base and rival, and of the signal with them, by sample.
struct System {
    by_sample: Vec<Products>,
    rest: Products,
}

#[derive(Clone)]
struct Products {
    columns: DMatrix<f64>,
    signal: DVector<f64>,
    square: f64,
    /// Rows of the columns and of the signal, for samples that may be repeated.
    rows: Option<(DMatrix<f64>, DVector<f64>)>,
}

fn system(
    set: &CandidateSet,
    fit: &Fit,
    own: &Signal<'_>,
    rivals: &[Signal<'_>],
    base: &[usize],
    treatment: Treatment,
) -> Option<System> {
    let samples: Vec<Sample> = set
        .samples
        .iter()
        .map(|sample| sample.under(treatment))
        .collect();
    let rows = fit.joint.rows.len();
    let row_samples: Vec<usize> = fit.joint.rows.iter().map(|row| row.sample).collect();
    let columns_of = |signal: &Signal<'_>| {
        let wanted = signal.candidate.amplitudes();
        let entries = signal
            .candidate
            .entries(
                &set.model,
                (&signal.values, &wanted),
                &set.probes,
                &samples,
                &set.surroundings,
            )
            .ok()?;
        let mut columns = candidates::columns(&entries, &wanted, &set.probes);
        scale_rows(&mut columns, &fit.factors);
        Some(columns)
    };
    let amplitudes = DVector::from_iterator(
        own.candidate.amplitudes().len(),
        own.candidate
            .amplitudes()
            .into_iter()
            .map(|k| own.values[k] - own.candidate.parameters[k].none),
    );
    let signal = columns_of(own)? * amplitudes;
    let of_rivals: Vec<DMatrix<f64>> = rivals.iter().map(columns_of).collect::<Option<_>>()?;
    let jacobian = fit.jacobian.select_columns(base);
    let width = base.len() + of_rivals.iter().map(DMatrix::ncols).sum::<usize>();
    let block = |rows: &[usize]| {
        let mut block = DMatrix::zeros(rows.len(), width);
        for (to, &from) in rows.iter().enumerate() {
            for column in 0..base.len() {
                block[(to, column)] = jacobian[(from, column)];
            }
            let of_rivals = of_rivals.iter().flat_map(DMatrix::column_iter);
            for (column, of_rival) in of_rivals.enumerate() {
                block[(to, base.len() + column)] = of_rival[from];
            }
        }
        let values = DVector::from_iterator(rows.len(), rows.iter().map(|&row| signal[row]));
        Products::of(block, values)
    };
    let mut of_sample: Vec<Vec<usize>> = vec![Vec::new(); samples.len()];
    let mut others = Vec::new();
    for (row, &sample) in row_samples.iter().enumerate() {
        if fit.factors[row] == 0.0 {
            continue;
        }
        if samples[sample].set == 1 {
            of_sample[sample].push(row);
        } else {
            others.push(row);
        }
    }
    let mut rest = block(&others);
    rest.rows = None;
    // The rows of the priors know neither effect.
    let priors = jacobian.rows(rows, jacobian.nrows() - rows);
    let products = priors.transpose() * priors;
    let mut corner = rest.columns.view_mut((0, 0), (base.len(), base.len()));
    corner += products;
    Some(System {
        by_sample: of_sample.iter().map(|rows| block(rows)).collect(),
        rest,
    })
}

impl Products {
    fn of(block: DMatrix<f64>, values: DVector<f64>) -> Self {
        Self {
            columns: transposed_times(&block, &block),
            signal: block.tr_mul(&values),
            square: values.norm_squared(),
            rows: Some((block, values)),
        }
    }

    fn add(&mut self, other: &Self) {
        self.columns += &other.columns;
        self.signal += &other.signal;
        self.square += other.square;
    }

    /// Energy of the signal beside base and rival.
    fn separation(&self) -> f64 {
        self.solved()
            .map_or(0.0, |x| (self.square - x.dot(&self.signal)).max(0.0))
    }

    /// Coefficients of the columns that predict the signal best.
    fn solved(&self) -> Option<DVector<f64>> {
        let scale = self.columns.diagonal().map(|square| {
            if square > 0.0 {
                square.sqrt().recip()
            } else {
                1.0
            }
        });
        let mut scaled = DMatrix::from_fn(scale.len(), scale.len(), |i, j| {
            self.columns[(i, j)] * scale[i] * scale[j]
        });
        for k in 0..scale.len() {
            scaled[(k, k)] += 1e-12;
        }
        let solved = Cholesky::new(scaled)?.solve(&self.signal.component_mul(&scale));
        Some(solved.component_mul(&scale))
    }
}

impl System {
    /// Everything that was measured.
    fn all(&self) -> Products {
        let mut sum = self.rest.clone();
        self.by_sample.iter().for_each(|products| sum.add(products));
        sum
    }

    /// The samples of `further` that tell most, and everything measured with them.
    fn with_best(&self, further: &Self) -> (Vec<usize>, Products) {
        let mut sum = self.all();
        let Some(x) = sum.solved() else {
            return (vec![], sum);
        };
        let mut gains: Vec<(f64, usize)> = further
            .by_sample
            .iter()
            .enumerate()
            .filter_map(|(sample, products)| {
                let (block, values) = products.rows.as_ref()?;
                (!values.is_empty()).then(|| ((values - block * &x).norm_squared(), sample))
            })
            .collect();
        largest_first(&mut gains, |&(gain, _)| gain);
        let chosen: Vec<usize> = gains
            .into_iter()
            .take(POSES)
            .map(|(_, sample)| sample)
            .collect();
        for &sample in &chosen {
            sum.add(&further.by_sample[sample]);
        }
        (chosen, sum)
    }
}
