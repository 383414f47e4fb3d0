//! Scores under random signs.

use std::collections::BTreeMap;

use nalgebra::DMatrix;
use tau_estimation::numerics::distribution::f_quantile_above;
use tau_estimation::numerics::parallel;

use super::super::scan::{LEAST_SHOWN, LEAST_SHOWN_BY_HALF, global_p, peaks};
use super::super::signs::{self, Flipped, single};
use super::super::view::View;
use super::searched::{Point, Scan, Scanned, Scans};
use super::{Bench, Table, f_form};

/// Null scans in which upcrossings are counted.
const NULL_SCANS: usize = 24;

/// The largest of each row.
fn highest(statistics: &DMatrix<f32>) -> Vec<f64> {
    let mut highest = vec![0.0_f32; statistics.nrows()];
    for point in statistics.column_iter() {
        for (highest, &statistic) in highest.iter_mut().zip(point.iter()) {
            *highest = highest.max(statistic);
        }
    }
    highest.into_iter().map(f64::from).collect()
}

impl Bench {
    /// Chance, over random signs of the units' residuals, that any candidate does as well as an adjusted
    /// p-value.
    pub(in super::super) fn flip_p(
        &self,
        view: &View,
        table: &Table,
        adjusted: f64,
        flips: usize,
        seed: u64,
    ) -> f64 {
        let flipped = self.flipped(view, flips, seed);
        let total = view.total();
        let degrees = view.degrees;
        let sums: Vec<f64> = (flipped.absorbed)
            .column_iter()
            .map(|column| (total - column.norm_squared()).max(1e-12))
            .collect();
        let mut exceeded = vec![false; flips];
        // The candidates without a search are one task beside the bands.
        let tasks: Vec<Option<usize>> = std::iter::once(None)
            .chain((0..table.bands.len()).map(Some))
            .collect();
        let of_tasks = parallel::map(&tasks, |&task| match task {
            None => self.plain_exceeds(table, (adjusted, degrees), &sums, &flipped),
            Some(place) => self.band_exceeds(table, place, (adjusted, degrees), &sums, &flipped),
        });
        for of_task in of_tasks {
            exceeded
                .iter_mut()
                .zip(of_task)
                .for_each(|(all, own)| *all |= own);
        }
        let count = exceeded.iter().filter(|&&exceeded| exceeded).count();
        (1.0 + count as f64) / (1.0 + flips as f64)
    }

    /// For each flip, whether a candidate without a search does as well as an adjusted p-value.
    fn plain_exceeds(
        &self,
        table: &Table,
        (adjusted, degrees): (f64, f64),
        sums: &[f64],
        signs: &Flipped,
    ) -> Vec<bool> {
        let mut exceeded = vec![false; sums.len()];
        let mut criticals: BTreeMap<(usize, bool), f64> = BTreeMap::new();
        let products = self.columns.flipped(
            &table.responses,
            &table.plain.absorbed,
            signs,
            0..self.columns.width(),
        );
        for ((candidate, place), c) in self.places.iter().zip(&table.plain.coefficients) {
            if c.ncols() == 0 || self.hidden.contains(candidate) {
                continue;
            }
            let rank = c.ncols() as f64;
            let is_named = self.candidates[*candidate].is_named();
            let critical = *criticals.entry((c.ncols(), is_named)).or_insert_with(|| {
                f_quantile_above(adjusted * table.weights.of(is_named), rank, degrees)
            });
            let statistics = products.columns(place.start, place.len()) * c.map(single);
            for (flip, exceeded) in exceeded.iter_mut().enumerate() {
                let statistic = f64::from(statistics.row(flip).norm_squared());
                let rest = (sums[flip] - statistic).max(1e-12) / (degrees - rank).max(1.0);
                *exceeded |= statistic / rank / rest >= critical;
            }
        }
        exceeded
    }

    /// For each flip, whether a searched candidate does as well as an adjusted p-value within a band.
    fn band_exceeds(
        &self,
        table: &Table,
        place: usize,
        (adjusted, degrees): (f64, f64),
        sums: &[f64],
        signs: &Flipped,
    ) -> Vec<bool> {
        let scans: Vec<&Scan> = self
            .scans_in(table)
            .filter(|scan| scan.bands.contains(&place) && !self.hidden.contains(&scan.candidate))
            .collect();
        let (Some(band), Some(first)) = (self.band(place), scans.first()) else {
            return vec![false; sums.len()];
        };
        let levels: Vec<(f64, f64, f64)> = scans
            .iter()
            .map(|scan| {
                let Scanned {
                    rank, crossings, ..
                } = self.scanned(scan, &table.bands);
                let is_named = self.candidates[scan.candidate].is_named();
                (rank, crossings, adjusted * table.weights.of(is_named))
            })
            .filter(|(rank, ..)| *rank > 0.0)
            .collect();
        let does = |flip: usize, statistic: f64| {
            levels.iter().any(|&(rank, crossings, p_value)| {
                let (equivalent, _) = f_form(statistic, rank, sums[flip], degrees);
                global_p(equivalent, rank, crossings) <= p_value
            })
        };
        let scores = &table.bands[place];
        // Where the winner is strong, half of the points tell already that no flip comes near.
        let at_half = highest(&band.flipped(scores, &table.responses, signs, 2));
        let comes_near = |(flip, height): (usize, &f64)| does(flip, height / LEAST_SHOWN_BY_HALF);
        if !at_half.iter().enumerate().any(comes_near) {
            return vec![false; sums.len()];
        }
        let nulls = band.flipped(scores, &table.responses, signs, 1);
        let highest = highest(&nulls);
        let exceeds = |flip: usize| {
            let does = |statistic: f64| does(flip, statistic);
            let highest = highest[flip];
            let refined = |k: usize| {
                band.around(k).any(|value| {
                    let point = self.point(&table.responses, first.candidate, value);
                    point.is_some_and(|point| {
                        let Point {
                            columns, absorbed, ..
                        } = &point;
                        let responses = &table.responses;
                        let products = columns.flipped_once(responses, absorbed, signs, flip);
                        does(point.statistic(&products))
                    })
                })
            };
            does(highest)
                || (does(highest / LEAST_SHOWN) && {
                    let null: Vec<f64> = nulls.row(flip).iter().copied().map(f64::from).collect();
                    peaks(&null, LEAST_SHOWN * highest)
                        .filter(|&k| does(null[k] / LEAST_SHOWN))
                        .any(refined)
                })
        };
        (0..sums.len()).map(exceeds).collect()
    }

    /// Residuals under few random signs, in which upcrossings are counted, unless all have been.
    pub(super) fn nulls(&self, view: &View, scans: &Scans) -> Option<Flipped> {
        let mut bands = scans.bands.iter();
        let is_wanted = bands.any(|band| band.crossings().is_none());
        is_wanted.then(|| self.flipped(view, NULL_SCANS, 1))
    }

    fn flipped(&self, view: &View, flips: usize, seed: u64) -> Flipped {
        let signs = signs::random(self.units, flips, seed);
        Flipped::of(view, &self.probes, &self.samples, signs)
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::DVector;

    use super::super::super::base::base_fit;
    use super::super::super::probes::{self, Probes};
    use super::super::super::{Input, Options, model_of};
    use super::*;
    use tau_robot::measurements::Poses;
    use tau_robot::robot::Robot;

    /// Shortcuts aside, a flip counts if any candidate scores as well on residuals that are turned round and fitted
    /// anew.
    #[test]
    fn flips_that_exceed_are_those_of_whole_tables() {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let folder = tau_robot::prototype::folder().unwrap();
        let file = tau_robot::prototype::robot_file()
            .unwrap()
            .completed(&robot);
        let options = Options::default();
        let Poses { division, .. } = Poses::select(&robot, &file, &folder, options.split).unwrap();
        let input = Input {
            robot: &robot,
            base: "Full",
            file: &file,
            folder: &folder,
            division: &division,
            options: &options,
        };
        let (model, index, families) = model_of(&input).unwrap();
        let variant = robot.variant("Full").unwrap();
        let (fit, samples) = base_fit(&input, &model, index, variant).unwrap();
        let compiled = probes::compiled(&model, index);
        let (joint, fitted) = (&fit.joint, &fit.fitted);
        let probes = Probes::of(&model, 0, compiled, joint, fitted, &samples, file.noise).unwrap();
        let bench = Bench::new(model, variant, &families, samples, probes, &fit);
        let view = View::of(&fit);
        let table = bench.table(&view);
        let (flips, seed) = (60, 3);
        let signs = signs::random(bench.units, flips, seed);
        let mut best: Vec<f64> = (0..flips)
            .map(|flip| {
                let mut turned = DVector::zeros(view.residuals.len());
                for (row, at) in view.rows.iter().enumerate() {
                    turned[row] =
                        view.residuals[row] * signs[(bench.samples[at.sample].unit, flip)];
                }
                let turned = View {
                    residuals: &turned - &*view.q * view.q.tr_mul(&turned),
                    ..view.clone()
                };
                let scores = bench.table(&turned).scores;
                scores
                    .iter()
                    .fold(f64::INFINITY, |best, score| best.min(score.adjusted))
            })
            .collect();
        best.sort_by(f64::total_cmp);
        let mut tried = 0;
        for count in 1..flips {
            let (last, next) = (best[count - 1], best[count]);
            if next < 2.0 * last {
                continue;
            }
            tried += 1;
            let found = bench.flip_p(&view, &table, (last * next).sqrt(), flips, seed);
            let expected = (1.0 + count as f64) / (1.0 + flips as f64);
            assert_eq!(found, expected, "{count} of {flips}: {last} {next}");
        }
        assert!(tried > 10, "{tried}");
    }
}
