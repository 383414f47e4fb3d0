//! Proposal of the measurement that would tell an effect from its rival.

use nalgebra::{Cholesky, DMatrix, DVector};
use tau_estimation::joint::fit::Fit;
use tau_estimation::numerics::distribution::{chi2_quantile_above, detectable_noncentrality};
use tau_estimation::numerics::order::largest_first;
use tau_estimation::numerics::products::transposed_times;
use tau_estimation::samples::{Sample, Treatment};

use super::candidate_set::CandidateSet;
use super::candidates::{self, Candidate};
use super::constants::Constants;
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

/// An effect of a fit beside which rivals are set, with what all of them share: the base without it.
pub(super) struct Separator<'a> {
    set: &'a CandidateSet,
    fit: &'a Fit,
    own: Signal<'a>,
    /// Columns of the base over the rows of the measurements, and their products, priors included: these know neither
    /// effect.
    base: DMatrix<f64>,
    products: DMatrix<f64>,
    /// Of each treatment: the samples under it, and the signal of the effect, if it has one there.
    treated: Vec<(Vec<Sample>, Option<DVector<f64>>)>,
    /// Rows that count of each sample that may be repeated.
    repeatable: Vec<(usize, Vec<usize>)>,
}

/// The columns of rivals and the signal of the effect over the rows of the measurements.
struct Columns<'a> {
    rivals: DMatrix<f64>,
    signal: &'a DVector<f64>,
}

impl<'a> Separator<'a> {
    /// Of an effect as fitted; `base` are the columns of the fit that are not its own.
    pub(super) fn new(
        set: &'a CandidateSet,
        fit: &'a Fit,
        own: Signal<'a>,
        base: &[usize],
    ) -> Self {
        let rows = fit.joint.rows.len();
        let jacobian = fit.jacobian.select_columns(base);
        let mut of_sample: Vec<Vec<usize>> = vec![vec![]; set.samples.len()];
        for (row, at) in fit.joint.rows.iter().enumerate() {
            if fit.factors[row] != 0.0 && set.samples[at.sample].set == 1 {
                of_sample[at.sample].push(row);
            }
        }
        let repeatable = of_sample.into_iter().enumerate();
        let mut separator = Self {
            set,
            fit,
            own,
            base: jacobian.rows(0, rows).into_owned(),
            products: transposed_times(&jacobian, &jacobian),
            treated: vec![],
            repeatable: repeatable.filter(|(_, rows)| !rows.is_empty()).collect(),
        };
        let treated = TREATMENTS.map(|(treatment, _)| {
            let samples = set.samples.iter().map(|sample| sample.under(treatment));
            let samples: Vec<Sample> = samples.collect();
            let signal = separator.signal(&samples);
            (samples, signal)
        });
        separator.treated = treated.into();
        separator
    }

    /// Poses of set 1, repeated under other conditions, that separate the effect from a rival, or that nothing does. The
    /// rival is one effect or several together.
    ///
    /// The separation is the non-centrality that is left of the effect's signal once base and rival have been fitted to
    /// it, over the old rows and those of the poses that are repeated: those where the signal is predicted worst.
    pub(super) fn separation_from(&self, rivals: &[Signal<'_>]) -> Separation {
        let mut treated = TREATMENTS.iter().enumerate();
        let same = treated.find(|(_, (treatment, _))| *treatment == Treatment::Same);
        let Some(now) = same.and_then(|(k, _)| self.columns(rivals, k)) else {
            return Separation::NotInSet1;
        };
        let present = self.all(&now);
        let predicted_by = present.solved();
        let parameters: usize = rivals.iter().map(|r| r.candidate.parameters.len()).sum();
        let parameters = parameters as f64;
        let Constants { level, power, .. } = self.set.constants;
        let threshold = chi2_quantile_above(level, parameters);
        let needed = detectable_noncentrality(threshold, parameters, power);
        let best = (TREATMENTS.into_iter().enumerate())
            .filter_map(|(k, (treatment, _))| {
                let (poses, sum) =
                    self.with_best(&present, predicted_by.as_ref(), &self.columns(rivals, k)?);
                Some((sum.separation(), poses, treatment))
            })
            .max_by(|a, b| a.0.total_cmp(&b.0));
        let Some((raised, mut poses, treatment)) = best else {
            return Separation::NotInSet1;
        };
        poses.sort_unstable();
        Separation::Repeat {
            poses,
            treatment,
            chi2: [present.separation(), raised, needed],
        }
    }

    /// Columns of an effect at samples, in units of the noise.
    fn columns_of(&self, signal: &Signal<'_>, samples: &[Sample]) -> Option<DMatrix<f64>> {
        let Self { set, fit, .. } = self;
        let wanted = signal.candidate.amplitudes();
        let values = (&signal.values[..], &wanted[..]);
        let entries =
            (signal.candidate).entries(&set.model, values, &set.probes, samples, &set.surroundings);
        let mut columns = candidates::columns(&entries.ok()?, &wanted, &set.probes);
        scale_rows(&mut columns, &fit.factors);
        Some(columns)
    }

    fn signal(&self, samples: &[Sample]) -> Option<DVector<f64>> {
        let Signal { candidate, values } = &self.own;
        let amplitudes = candidate.amplitudes().into_iter();
        let amplitudes: Vec<f64> = amplitudes
            .map(|k| values[k] - candidate.parameters[k].none)
            .collect();
        Some(self.columns_of(&self.own, samples)? * DVector::from_vec(amplitudes))
    }

    /// Columns under a treatment; `None` where an effect has none there.
    fn columns(&self, rivals: &[Signal<'_>], treatment: usize) -> Option<Columns<'_>> {
        let (samples, signal) = &self.treated[treatment];
        let of_rivals = rivals.iter().map(|rival| self.columns_of(rival, samples));
        let of_rivals: Vec<DMatrix<f64>> = of_rivals.collect::<Option<_>>()?;
        let columns: Vec<_> = of_rivals.iter().flat_map(DMatrix::column_iter).collect();
        Some(Columns {
            rivals: DMatrix::from_columns(&columns),
            signal: signal.as_ref()?,
        })
    }

    /// Products over everything that was measured.
    fn all(&self, Columns { rivals, signal }: &Columns<'_>) -> Products {
        let (base, own) = (self.base.ncols(), rivals.ncols());
        let mut columns = DMatrix::zeros(base + own, base + own);
        let mixed = transposed_times(&self.base, rivals);
        let (of_base, of_rivals) = ((base, base), (own, own));
        columns.view_mut((0, 0), of_base).copy_from(&self.products);
        columns.view_mut((0, base), (base, own)).copy_from(&mixed);
        let mixed = mixed.transpose();
        columns.view_mut((base, 0), (own, base)).copy_from(&mixed);
        let products = rivals.tr_mul(rivals);
        columns
            .view_mut((base, base), of_rivals)
            .copy_from(&products);
        let mut with_signal = DVector::zeros(base + own);
        with_signal
            .rows_mut(0, base)
            .copy_from(&self.base.tr_mul(signal));
        with_signal
            .rows_mut(base, own)
            .copy_from(&rivals.tr_mul(signal));
        Products {
            columns,
            signal: with_signal,
            square: signal.norm_squared(),
        }
    }

    /// The numbers of the poses that tell most where they are measured once more, and everything measured with them;
    /// `x` are the coefficients by which what was measured predicts the signal.
    fn with_best(
        &self,
        present: &Products,
        x: Option<&DVector<f64>>,
        further: &Columns<'_>,
    ) -> (Vec<u32>, Products) {
        let mut sum = present.clone();
        let Some(x) = x else {
            return (vec![], sum);
        };
        let (base, Columns { rivals, signal }) = (self.base.ncols(), further);
        let predicted = &self.base * x.rows(0, base) + rivals * x.rows(base, rivals.ncols());
        let left = *signal - predicted;
        let gain = |rows: &[usize]| rows.iter().map(|&row| left[row].powi(2)).sum::<f64>();
        let gains = self
            .repeatable
            .iter()
            .map(|sample| (gain(&sample.1), sample));
        let mut gains: Vec<(f64, &(usize, Vec<usize>))> = gains.collect();
        largest_first(&mut gains, |&(gain, _)| gain);
        gains.truncate(POSES);
        let rows = gains.iter().flat_map(|(_, (_, rows))| rows).copied();
        let rows: Vec<usize> = rows.collect();
        let own = [&self.base, rivals].map(|columns| columns.select_rows(&rows));
        let block: Vec<_> = own.iter().flat_map(DMatrix::column_iter).collect();
        let block = DMatrix::from_columns(&block);
        let signal = signal.select_rows(&rows);
        sum.columns += transposed_times(&block, &block);
        sum.signal += block.tr_mul(&signal);
        sum.square += signal.norm_squared();
        let number =
            |&(_, (sample, _)): &(f64, &(usize, Vec<usize>))| self.set.samples[*sample].number;
        (gains.iter().map(number).collect(), sum)
    }
}

/// Products of the columns of base and rival, and of the signal with them.
#[derive(Clone)]
struct Products {
    columns: DMatrix<f64>,
    signal: DVector<f64>,
    square: f64,
}

impl Products {
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
