//! Candidates with a searched parameter.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use tau_codegen::language::model::Model;
use tau_estimation::machine::searched::widest;
use tau_estimation::numerics::order::smallest_first;
use tau_estimation::numerics::parallel;
use tau_estimation::samples::Sample;

use super::super::candidates::{self, Candidate};
use super::super::linear_model::LinearModel;
use super::super::response::{Displacements, Responses};
use super::super::scan::{Band, LEAST_SHOWN, Scores, lengths, lobe, peaks};
use super::super::significance::Null;
use super::{CandidateSet, Score, Table};
use crate::subspace::orthonormal;

/// A searched candidate and the bands that cover its range, by their places.
pub(super) struct Scan {
    pub(super) candidate: usize,
    pub(super) bands: Vec<usize>,
}

/// A scan with its scores in a table.
pub(in super::super) struct Scanned<'a> {
    pub(in super::super) bands: Vec<(&'a Band, &'a Scores)>,
    /// Largest number of amplitudes that can be told apart.
    pub(in super::super) rank: f64,
    /// Mean number of upcrossings where there is no effect.
    pub(in super::super) crossings: f64,
}

/// Searched candidates, and bands that none before them had.
#[derive(Default)]
pub(super) struct Scans {
    pub(super) scans: Vec<Scan>,
    pub(super) bands: Vec<Band>,
}

impl Scans {
    /// Adds a candidate with a band of its own.
    pub(super) fn push(&mut self, candidate: usize, band: Band) {
        self.scans.push(Scan {
            candidate,
            bands: vec![self.bands.len()],
        });
        self.bands.push(band);
    }
}

/// A searched candidate at one value.
pub(super) struct Point {
    pub(super) columns: Displacements,
    pub(super) coefficients: DMatrix<f64>,
}

impl Point {
    pub(super) fn statistic(&self, products: &DVector<f64>) -> f64 {
        self.coefficients.tr_mul(products).norm_squared()
    }
}

impl CandidateSet {
    /// The best of each scan; `bands` are the scores of all bands so far.
    pub(super) fn scan_scores(
        &self,
        linear: &LinearModel,
        responses: &Responses,
        scans: &Scans,
        bands: &[Arc<Scores>],
    ) -> Vec<Score> {
        let best = |scan: &Scan| self.scan_score(linear, responses, scan, bands);
        parallel::map(&scans.scans, best)
            .into_iter()
            .flatten()
            .collect()
    }

    fn scan_score(
        &self,
        linear: &LinearModel,
        responses: &Responses,
        scan: &Scan,
        bands: &[Arc<Scores>],
    ) -> Option<Score> {
        let scanned = self.scanned(scan, bands);
        let Scanned {
            rank, crossings, ..
        } = scanned;
        if rank == 0.0 || self.hidden.contains(&scan.candidate) {
            return None;
        }
        let null = Null {
            rank,
            crossings: Some(crossings),
        };
        let residuals = linear.tested();
        let p_value = |statistic: f64| residuals.p_value(statistic, null);
        let highest = scanned.bands.iter().map(|(_, scores)| scores.highest());
        let highest = highest.fold(0.0, f64::max);
        let height = LEAST_SHOWN * highest;
        let peaks = if p_value(highest / LEAST_SHOWN).value() > self.constants.level {
            // Nothing between the points of the grid could be significant, not even alone.
            let of_band = |(band, scores): &(&Band, &Scores)| -> Vec<(f64, f64)> {
                let at = |k: usize| (band.grid[k], scores.statistics[k]);
                peaks(&scores.statistics, height).map(at).collect()
            };
            scanned.bands.iter().flat_map(of_band).collect()
        } else {
            self.refined(responses, scan.candidate, &scanned, height)
        };
        // Noise moves a peak near the end of the range beyond it: the end is then as much as the candidate can show, as a
        // rival. A name would be that of anything smoother.
        let described = &self.candidates[scan.candidate];
        let (_, (low, high)) = described.search?;
        let within = |(value, statistic): (f64, f64)| {
            if described.allows(value) {
                return Some((value, statistic, false));
            }
            let end = value.clamp(low, high);
            let point = self.point(responses, scan.candidate, end)?;
            let statistic = point.statistic(&point.columns.score(responses));
            Some((end, statistic, true))
        };
        let (value, statistic, is_beyond) = peaks
            .into_iter()
            .filter_map(within)
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        let p_value = p_value(statistic);
        Some(Score {
            candidate: scan.candidate,
            statistic,
            p_value,
            null,
            searched: Some(value),
            is_beyond,
        })
    }

    /// A scan with the scores of its bands.
    pub(super) fn scanned<'a>(&'a self, scan: &Scan, bands: &'a [Arc<Scores>]) -> Scanned<'a> {
        let of_band = |&place: &usize| Some((self.band(place)?, &*bands[place]));
        let bands: Vec<(&Band, &Scores)> = scan.bands.iter().filter_map(of_band).collect();
        let ranks = bands.iter().map(|(_, scores)| scores.rank());
        Scanned {
            rank: ranks.max().unwrap_or(0) as f64,
            crossings: bands.iter().filter_map(|(band, _)| band.crossings()).sum(),
            bands,
        }
    }

    /// The peaks of a scan that reach a height on the grid: value of what is searched, and statistic.
    fn refined(
        &self,
        responses: &Responses,
        candidate: usize,
        scanned: &Scanned<'_>,
        height: f64,
    ) -> Vec<(f64, f64)> {
        let of_peak = |band: &Band, k: usize, on_grid: (f64, f64)| {
            band.around(k)
                .filter_map(|value| {
                    let point = self.point(responses, candidate, value)?;
                    Some((value, point.statistic(&point.columns.score(responses))))
                })
                .fold(
                    on_grid,
                    |best, next| if next.1 > best.1 { next } else { best },
                )
        };
        let mut refined = Vec::new();
        for (band, Scores { statistics, .. }) in &scanned.bands {
            refined.extend(
                peaks(statistics, height).map(|k| of_peak(band, k, (band.grid[k], statistics[k]))),
            );
        }
        refined
    }

    /// A searched candidate at a value, beside a model.
    pub(super) fn point(
        &self,
        responses: &Responses,
        candidate: usize,
        value: f64,
    ) -> Option<Point> {
        let described = &self.candidates[candidate];
        let values = described.values_at(Some(value));
        let amplitudes = described.amplitudes();
        let mut columns = Displacements::default();
        columns.push(
            &self.entries(candidate, &values, &amplitudes)?,
            &amplitudes,
            &self.probes,
        );
        let absorbed = columns.absorbed(responses);
        let gram = columns.gram(0..amplitudes.len(), responses);
        let left = responses.left(&gram, absorbed.as_view());
        Some(Point {
            columns,
            coefficients: orthonormal(&lengths(&gram), &left),
        })
    }

    /// Other values of a searched parameter that fit as well as the best.
    pub(in super::super) fn aliases(&self, table: &Table, score: &Score) -> Vec<f64> {
        let mut scans = self.scans_in(table);
        let scan = scans.find(|scan| scan.candidate == score.candidate);
        let (Some(scan), Some(best)) = (scan, score.searched) else {
            return vec![];
        };
        let described = &self.candidates[score.candidate];
        let apart = lobe(reach(described, &self.model, &self.samples));
        let least = score.statistic - self.constants.as_good;
        let scanned = self.scanned(scan, &table.bands);
        let height = LEAST_SHOWN * least;
        self.refined(&table.responses, score.candidate, &scanned, height)
            .into_iter()
            .filter(|(value, statistic)| {
                *statistic > least
                    && described.allows(*value)
                    && (value.recip() - best.recip()).abs() > apart
            })
            .map(|(value, _)| value)
            .collect()
    }

    /// A band, by its place: those of unnamed families last.
    pub(super) fn band(&self, place: usize) -> Option<&Band> {
        let named = &self.scans.bands;
        let of_families = || self.family_scans.get()?.bands.get(place - named.len());
        named.get(place).or_else(of_families)
    }

    /// The scans that take part in a table.
    pub(super) fn scans_in(&self, table: &Table) -> impl Iterator<Item = &Scan> {
        let families = self.family_scans.get().filter(|_| table.has_families);
        let families = families.into_iter().flat_map(|families| &families.scans);
        self.scans.scans.iter().chain(families)
    }

    /// Unnamed families with a search.
    pub(in super::super) fn searched_families(&self) -> &[usize] {
        &self.searched_families
    }

    /// The scans of unnamed families, which are built when first wanted.
    pub(super) fn family_scans(&self) -> &Scans {
        self.family_scans.get_or_init(|| {
            let scanned =
                parallel::map(&self.searched_families, |&family| self.family_scan(family));
            let mut families = Scans::default();
            let first = self.scans.bands.len();
            for (mut scan, bands) in scanned.into_iter().flatten() {
                scan.bands
                    .extend((first + families.bands.len()..).take(bands.len()));
                families.bands.extend(bands);
                families.scans.push(scan);
            }
            families
        })
    }

    /// The scan of an unnamed family: it shares the bands of those names that have the same columns, and has
    /// its own in between.
    fn family_scan(&self, family: usize) -> Option<(Scan, Vec<Band>)> {
        let described = &self.candidates[family];
        let (_, range) = described.search?;
        let alike: Vec<(usize, (f64, f64))> = (self.scans.scans.iter())
            .filter(|scan| self.candidates[scan.candidate].looks_like(described))
            .filter_map(|scan| Some((scan.bands[0], self.candidates[scan.candidate].search?.1)))
            .collect();
        let (bands, gaps) = covered(range, alike);
        let reach = reach(described, &self.model, &self.samples);
        let own = gaps.into_iter().map(|gap| {
            let (probes, samples) = (&self.probes, &self.samples);
            let range = (gap, reach);
            Band::new(
                described,
                &self.model,
                probes,
                samples,
                &self.surroundings,
                range,
            )
        });
        let own = own.collect::<Result<Vec<Band>, _>>().ok()?;
        let scan = Scan {
            candidate: family,
            bands,
        };
        Some((scan, own))
    }

    /// The scan of a searched candidate with its scores in a table.
    pub(in super::super) fn scan_in<'a>(
        &'a self,
        table: &'a Table,
        candidate: usize,
    ) -> Option<Scanned<'a>> {
        let scan = self
            .scans_in(table)
            .find(|scan| scan.candidate == candidate)?;
        Some(self.scanned(scan, &table.bands))
    }

    /// Columns of a detectable candidate with a name, in units of the stated noise; of a searched one,
    /// in the middle of its range.
    pub(in super::super) fn shown_columns(&self, candidate: usize) -> Option<DMatrix<f64>> {
        let described = &self.candidates[candidate];
        if !described.is_named() || self.hidden.contains(&candidate) {
            return None;
        }
        let middle = described.search.map(|(_, (low, high))| (low * high).sqrt());
        let values = described.values_at(middle);
        let wanted = described.amplitudes();
        let entries = self.entries(candidate, &values, &wanted)?;
        Some(candidates::columns(&entries, &wanted, &self.probes))
    }
}

/// Bands that cover a range without going beyond it or into each other, and the rest of it.
fn covered(
    (low, high): (f64, f64),
    mut bands: Vec<(usize, (f64, f64))>,
) -> (Vec<usize>, Vec<(f64, f64)>) {
    smallest_first(&mut bands, |&(_, (first, _))| first);
    let (mut taken, mut gaps, mut from) = (vec![], vec![], low);
    for (band, (first, last)) in bands {
        if from <= first && last <= high {
            taken.push(band);
            gaps.push((from, first));
            from = last;
        }
    }
    gaps.push((from, high));
    gaps.retain(|(low, high)| low < high);
    (taken, gaps)
}

/// Widest range of the commands that a searched effect sees.
pub(super) fn reach(candidate: &Candidate, model: &Model, samples: &[Sample]) -> f64 {
    let own = candidate.commands(model);
    let own = if own.is_empty() { vec![0] } else { own };
    let range = |&command: &usize| {
        let samples = samples.iter();
        widest(samples.filter_map(|sample| sample.commands_m.get(command)))
    };
    own.iter().map(range).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::covered;

    #[test]
    fn bands_and_gaps_make_up_the_range() {
        let bands = vec![(7, (60.0, 100.0)), (3, (4.0, 50.0))];
        assert_eq!(
            covered((4.0, 100.0), bands),
            (vec![3, 7], vec![(50.0, 60.0)])
        );
        assert_eq!(covered((4.0, 9.0), vec![]), (vec![], vec![(4.0, 9.0)]));
    }

    #[test]
    fn a_band_beyond_the_range_or_into_another_is_not_shared() {
        let bands = vec![
            (0, (1.0, 5.0)),
            (1, (4.0, 6.0)),
            (2, (5.0, 8.0)),
            (3, (8.0, 11.0)),
        ];
        assert_eq!(
            covered((2.0, 10.0), bands),
            (vec![1], vec![(2.0, 4.0), (6.0, 10.0)])
        );
    }
}
