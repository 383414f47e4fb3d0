//! Candidates with a searched parameter.

use nalgebra::{DMatrix, DVector};
use tau_codegen::language::model::{Model, Place};

use super::super::candidates::{self, Candidate};
use super::super::parallel;
use super::super::projection::{Subspace, orthonormal};
use super::super::response::{Displacements, Responses};
use super::super::samples::Sample;
use super::super::scan::{AS_GOOD, LEAST_SHOWN, Scan, Scores, global_p, lengths, lobe, peaks};
use super::super::selection::LEVEL;
use super::super::view::View;
use super::{Bench, Score, Table, f_form};
use crate::calibration::widest;

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
    /// The best of a scan.
    pub(super) fn scan_score(
        &self,
        view: &View,
        responses: &Responses,
        (place, scanned): (usize, &Scores),
        nulls: &[DMatrix<f32>],
    ) -> Option<Score> {
        let (candidate, scan) = self.scan(place)?;
        let rank = scanned.rank() as f64;
        if rank == 0.0 || self.hidden.contains(candidate) {
            return None;
        }
        let crossings =
            *self.crossings[place].get_or_init(|| Self::count_crossings(scan, scanned, nulls));
        let p_value = |statistic: f64| {
            let (equivalent, _) = f_form(statistic, rank, view.total(), view.degrees);
            global_p(equivalent, rank, crossings)
        };
        let highest = scanned.highest();
        let height = LEAST_SHOWN * highest;
        let peaks = if p_value(highest / LEAST_SHOWN) > LEVEL {
            // Nothing between the points of the grid could be significant, not even alone.
            peaks(&scanned.statistics, height)
                .map(|k| (scan.grid[k], scanned.statistics[k]))
                .collect()
        } else {
            self.refined(responses, place, scanned, height)
        };
        let (value, statistic) = peaks
            .into_iter()
            .filter(|(value, _)| scan.allows(*value))
            .max_by(|a, b| a.1.total_cmp(&b.1))?;
        let p_value = p_value(statistic);
        Some(Score {
            candidate: *candidate,
            statistic,
            p_value,
            adjusted: p_value,
            bic: statistic - (rank + 1.0) * self.observations().ln(),
            searched: Some(value),
        })
    }

    /// The peaks of a scan that reach a height on the grid: value of what is searched, and statistic.
    pub(super) fn refined(
        &self,
        responses: &Responses,
        place: usize,
        scanned: &Scores,
        height: f64,
    ) -> Vec<(f64, f64)> {
        let Some((candidate, scan)) = self.scan(place) else {
            return vec![];
        };
        peaks(&scanned.statistics, height)
            .map(|k| {
                let on_grid = (scan.grid[k], scanned.statistics[k]);
                scan.around(k)
                    .filter_map(|value| {
                        let point = self.point(responses, *candidate, value)?;
                        Some((value, point.statistic(&point.columns.score(responses))))
                    })
                    .fold(
                        on_grid,
                        |best, next| if next.1 > best.1 { next } else { best },
                    )
            })
            .collect()
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
        let place = (0..table.scans.len()).find(|&place| {
            self.scan(place)
                .is_some_and(|scan| scan.0 == score.candidate)
        });
        let (Some(place), Some(best)) = (place, score.searched) else {
            return vec![];
        };
        let allows = |value| self.scan(place).is_some_and(|scan| scan.1.allows(value));
        let apart = lobe(reach(
            &self.candidates[score.candidate],
            &self.model,
            &self.samples,
        ));
        let least = score.statistic - AS_GOOD;
        self.refined(
            &table.responses,
            place,
            &table.scans[place],
            LEAST_SHOWN * least,
        )
        .into_iter()
        .filter(|(value, statistic)| {
            *statistic > least && allows(*value) && (value.recip() - best.recip()).abs() > apart
        })
        .map(|(value, _)| value)
        .collect()
    }

    /// A scan and its candidate, by its place: unnamed families last.
    pub(super) fn scan(&self, place: usize) -> Option<&(usize, Scan)> {
        let families = || self.family_scans.get()?.get(place - self.scans.len());
        self.scans.get(place).or_else(families)
    }

    /// Unnamed families with a search.
    pub(in super::super) fn searched_families(&self) -> &[usize] {
        &self.searched_families
    }

    /// The scans of unnamed families, which are built when first wanted.
    pub(super) fn family_scans(&self) -> &[(usize, Scan)] {
        self.family_scans.get_or_init(|| {
            let scans = parallel::map(&self.searched_families, |&index| {
                let candidate = &self.candidates[index];
                let range = reach(candidate, &self.model, &self.samples);
                let (probes, samples) = (&self.probes, &self.samples);
                Scan::new(
                    candidate,
                    &self.model,
                    probes,
                    samples,
                    &self.surroundings,
                    range,
                )
                .ok()
                .map(|scan| (index, scan))
            });
            scans.into_iter().flatten().collect()
        })
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

    /// The scan of a searched candidate with its scores in a table, and its mean upcrossings.
    pub(in super::super) fn scanned<'a>(
        &'a self,
        table: &'a Table,
        candidate: usize,
    ) -> Option<(&'a Scan, &'a Scores, f64)> {
        let place = self.scans.iter().position(|(of, _)| *of == candidate)?;
        let crossings = self.crossings[place].get().copied().unwrap_or(0.0);
        Some((&self.scans[place].1, table.scans.get(place)?, crossings))
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
