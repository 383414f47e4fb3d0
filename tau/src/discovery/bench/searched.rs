//! Candidates with a searched parameter.

use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use tau_codegen::language::model::{Model, Place};

use super::super::candidates::{self, Candidate};
use super::super::parallel;
use super::super::projection::{Subspace, orthonormal};
use super::super::response::{Displacements, Responses};
use super::super::samples::Sample;
use super::super::scan::{AS_GOOD, Band, LEAST_SHOWN, Scores, global_p, lengths, lobe, peaks};
use super::super::selection::LEVEL;
use super::super::view::View;
use super::{Bench, Score, Table, f_form};
use crate::calibration::widest;

/// A searched candidate and the bands that cover its range, by their places.
pub(super) struct Scan {
    pub(super) candidate: usize,
    pub(super) bands: Vec<usize>,
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

impl Bench {
    /// The best of each scan; `bands` are the scores of all bands so far.
    pub(super) fn scan_scores(
        &self,
        view: &View,
        responses: &Responses,
        scans: &Scans,
        bands: &[Arc<Scores>],
    ) -> Vec<Score> {
        let best = |scan: &Scan| self.scan_score(view, responses, scan, bands);
        parallel::map(&scans.scans, best)
            .into_iter()
            .flatten()
            .collect()
    }

    fn scan_score(
        &self,
        view: &View,
        responses: &Responses,
        scan: &Scan,
        bands: &[Arc<Scores>],
    ) -> Option<Score> {
        let (rank, crossings) = self.search_of(scan, bands);
        if rank == 0.0 || self.hidden.contains(&scan.candidate) {
            return None;
        }
        let p_value = |statistic: f64| {
            let (equivalent, _) = f_form(statistic, rank, view.total(), view.degrees);
            global_p(equivalent, rank, crossings)
        };
        let scores = || scan.bands.iter().map(|&place| &bands[place]);
        let highest = scores().map(|band| band.highest()).fold(0.0, f64::max);
        let height = LEAST_SHOWN * highest;
        let peaks = if p_value(highest / LEAST_SHOWN) > LEVEL {
            // Nothing between the points of the grid could be significant, not even alone.
            let of_band = |&place: &usize| Some((&self.band(place)?.grid, &bands[place].statistics));
            (scan.bands.iter().filter_map(of_band))
                .flat_map(|(grid, statistics)| {
                    peaks(statistics, height).map(|k| (grid[k], statistics[k]))
                })
                .collect()
        } else {
            self.refined(responses, scan, bands, height)
        };
        let described = &self.candidates[scan.candidate];
        let (value, statistic) = peaks
            .into_iter()
            .filter(|(value, _)| described.allows(*value))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        let p_value = p_value(statistic);
        Some(Score {
            candidate: scan.candidate,
            statistic,
            p_value,
            adjusted: p_value,
            bic: statistic - (rank + 1.0) * self.observations().ln(),
            searched: Some(value),
        })
    }

    /// Largest number of amplitudes of a scan that can be told apart, and its mean upcrossings.
    pub(super) fn search_of(&self, scan: &Scan, bands: &[Arc<Scores>]) -> (f64, f64) {
        let ranks = scan.bands.iter().map(|&place| bands[place].rank());
        let crossings = scan.bands.iter().filter_map(|&place| self.band(place)?.crossings());
        (ranks.max().unwrap_or(0) as f64, crossings.sum())
    }

    /// The peaks of a scan that reach a height on the grid: value of what is searched, and statistic.
    fn refined(
        &self,
        responses: &Responses,
        scan: &Scan,
        bands: &[Arc<Scores>],
        height: f64,
    ) -> Vec<(f64, f64)> {
        let of_band = |&place: &usize| {
            let (band, statistics) = (self.band(place)?, &bands[place].statistics);
            Some(peaks(statistics, height).map(move |k| {
                let on_grid = (band.grid[k], statistics[k]);
                band.around(k)
                    .filter_map(|value| {
                        let point = self.point(responses, scan.candidate, value)?;
                        Some((value, point.statistic(&point.columns.score(responses))))
                    })
                    .fold(
                        on_grid,
                        |best, next| if next.1 > best.1 { next } else { best },
                    )
            }))
        };
        scan.bands.iter().filter_map(of_band).flatten().collect()
    }

    /// A searched candidate at a value, beside a model.
    pub(super) fn point(
        &self,
        responses: &Responses,
        candidate: usize,
        value: f64,
    ) -> Option<Point> {
        let described = &self.candidates[candidate];
        let (searched, _) = described.search?;
        let mut values = described.nominal();
        values[searched] = value;
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
        let least = score.statistic - AS_GOOD;
        self.refined(
            &table.responses,
            scan,
            &table.bands,
            LEAST_SHOWN * least,
        )
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
            let scanned = parallel::map(&self.searched_families, |&family| self.family_scan(family));
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
        let mut shared: Vec<(usize, (f64, f64))> = (self.scans.scans.iter())
            .filter(|scan| self.candidates[scan.candidate].looks_like(described, &self.model))
            .flat_map(|scan| {
                let (_, of_name) = self.candidates[scan.candidate].search?;
                Some((scan.bands[0], of_name))
            })
            .filter(|(_, (low, high))| range.0 <= *low && *high <= range.1)
            .collect();
        shared.sort_by(|a, b| a.1.0.total_cmp(&b.1.0));
        let (mut bands, mut gaps, mut from) = (vec![], vec![], range.0);
        for (band, (low, high)) in shared {
            if low < from {
                continue;
            }
            bands.push(band);
            gaps.push((from, low));
            from = high;
        }
        gaps.push((from, range.1));
        let reach = reach(described, &self.model, &self.samples);
        let own = (gaps.into_iter())
            .filter(|(low, high)| low < high)
            .map(|gap| {
                Band::new(
                    described,
                    &self.model,
                    &self.probes,
                    &self.samples,
                    &self.surroundings,
                    (gap, reach),
                )
            });
        let own = own.collect::<Result<Vec<Band>, _>>().ok()?;
        let scan = Scan {
            candidate: family,
            bands,
        };
        Some((scan, own))
    }

    /// Columns of a searched candidate at a value of what is searched.
    pub(super) fn at(
        &self,
        view: &View,
        candidate: usize,
        value: f64,
    ) -> Option<(DMatrix<f64>, Subspace)> {
        let described = &self.candidates[candidate];
        let (searched, _) = described.search?;
        let mut values = described.nominal();
        values[searched] = value;
        self.expanded(view, candidate, &values)
    }

    /// The bands of a searched candidate with their scores in a table; its rank, and its mean upcrossings.
    pub(in super::super) fn scanned<'a>(
        &'a self,
        table: &'a Table,
        candidate: usize,
    ) -> Option<(Vec<(&'a Band, &'a Scores)>, (f64, f64))> {
        let scan = self.scans_in(table).find(|scan| scan.candidate == candidate)?;
        let of_band = |&place: &usize| Some((self.band(place)?, &*table.bands[place]));
        let bands = scan.bands.iter().filter_map(of_band).collect();
        Some((bands, self.search_of(scan, &table.bands)))
    }

    /// Columns of a named candidate that is in sight, in units of the stated noise; of a searched one,
    /// in the middle of its range.
    pub(in super::super) fn shown_columns(&self, candidate: usize) -> Option<DMatrix<f64>> {
        let described = &self.candidates[candidate];
        if !described.is_named() || self.hidden.contains(&candidate) {
            return None;
        }
        let mut values = described.nominal();
        if let Some((searched, (low, high))) = described.search {
            values[searched] = (low * high).sqrt();
        }
        let wanted = described.amplitudes();
        let entries = self.entries(candidate, &values, &wanted)?;
        Some(candidates::columns(&entries, &wanted, &self.probes))
    }
}

/// Widest range of the commands that a searched effect sees.
pub(super) fn reach(candidate: &Candidate, model: &Model, samples: &[Sample]) -> f64 {
    let own = match candidate.place {
        Place::Cart { track, .. } => Some(track),
        Place::Link(link) => {
            let link = &model.links[link];
            model.clusters[link.cluster].track.or(link.actuated_by)
        }
        _ => None,
    };
    let commands = samples
        .iter()
        .filter_map(|sample| sample.commands_m.get(own.unwrap_or(0)));
    widest(commands)
}
