//! Results of a calibration from unknown poses, and what is known before it.

use std::collections::BTreeSet;

use serde::Serialize;
use tau_codes::{Remark, fit as codes};
use tau_kinematics::Machine;
use tau_robot::measurements::{Distance, Folder, PoseCounts, Split};

use super::evaluation::JudgedRows;
use super::gauge::Freedom;
use super::gross_poses::GrossPose;
use super::heldout::HeldOut;
use super::objects::Object;
use super::rows::{KindFit, RowPlace};
use crate::calibration::{Calibration, widened};
use crate::numerics::distribution::chi2_survival;
use crate::numerics::spread::spread;
use crate::trust::{LEVEL, Mistake, PoseFit};
use crate::weighing::{Loss, Outlier};

/// Chance below which residuals are larger than their noise allows: one right fit in a thousand is called
/// inconsistent.
pub(super) const SIGNIFICANT: f64 = LEVEL;

/// The rows of a folder that calibrate and those that are held out.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct RowDivision {
    /// Numbers of the poses whose rows calibrate.
    pub calibration: BTreeSet<u32>,
    /// Numbers of those whose rows validate.
    pub validation: BTreeSet<u32>,
    /// Lines of `distances.csv` that calibrate.
    pub distances: BTreeSet<usize>,
    /// Lines that validate.
    pub held_out_distances: BTreeSet<usize>,
}

impl RowDivision {
    /// Poses of set 1, by index, that calibrate.
    pub fn of_poses(folder: &Folder, poses: &[usize]) -> Self {
        let numbers = poses.iter().map(|&pose| folder.tcp_poses[pose].pose);
        Self {
            calibration: numbers.collect(),
            ..Self::default()
        }
    }

    /// Divides poses by their commands, as poses of set 1 are, and distances row by row.
    pub fn of(folder: &Folder, split: Split) -> Self {
        let poses = folder.plate_poses();
        let indices: Vec<usize> = (0..poses.len()).collect();
        let own = split.divide_readings(&indices, poses.iter().map(|pose| pose.1));
        let numbers = |indices: &[usize]| indices.iter().map(|&index| poses[index].0).collect();
        let rows: Vec<usize> = (0..folder.distances.len()).collect();
        let keys: Vec<[f64; 2]> = (folder.distances.iter())
            .map(|row| [f64::from(row.poses[0]), f64::from(row.poses[1])])
            .collect();
        let of_rows = split.divide_readings(&rows, keys.iter().map(<[f64; 2]>::as_slice));
        let lines = |indices: &[usize]| {
            indices
                .iter()
                .map(|&index| folder.distances[index].line)
                .collect()
        };
        Self {
            calibration: numbers(&own.calibration),
            validation: numbers(&own.validation),
            distances: lines(&of_rows.calibration),
            held_out_distances: lines(&of_rows.validation),
        }
    }

    /// The same with rows of so many poses at most that calibrate, evenly spread: distances, whose other rows come along,
    /// and poses that no distance is of. `None` where these are no more.
    #[must_use]
    pub fn thinned(&self, folder: &Folder, most: usize) -> Option<Self> {
        let distances = folder.distances.iter();
        let distances: Vec<&Distance> = distances
            .filter(|row| self.distances.contains(&row.line))
            .collect();
        let ends = |rows: &[&Distance]| rows.iter().flat_map(|row| row.poses).collect();
        let coupled: BTreeSet<u32> = ends(&distances);
        let alone: Vec<u32> = self.calibration.difference(&coupled).copied().collect();
        let mut share = most as f64 / (coupled.len() + alone.len()) as f64;
        if share >= 1.0 {
            return None;
        }
        loop {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a share of a number of rows"
            )]
            let part = |all: usize| spread(all, (share * all as f64) as usize).into_iter();
            let rows: Vec<&Distance> = part(distances.len()).map(|k| distances[k]).collect();
            let mut poses: BTreeSet<u32> = ends(&rows);
            poses.extend(part(alone.len()).map(|k| alone[k]));
            if poses.len() <= most {
                return Some(Self {
                    calibration: self.calibration.intersection(&poses).copied().collect(),
                    distances: rows.iter().map(|row| row.line).collect(),
                    ..self.clone()
                });
            }
            // Where each pose has several distances, a share of these has a larger one of the poses.
            share *= most as f64 / poses.len() as f64;
        }
    }

    /// Numbers of poses by whether their own measurements calibrate.
    pub fn counts(&self) -> PoseCounts {
        let total = self.calibration.union(&self.validation).count();
        PoseCounts {
            total,
            in_range: total,
            calibration: self.calibration.len(),
            validation: self.validation.difference(&self.calibration).count(),
        }
    }

    /// Rows that are held out, all of those that calibrate where none are. Where redundant drives measure each other,
    /// distances between poses at which they calibrate took part.
    pub fn judged(&self, folder: &Folder, is_redundant: bool) -> JudgedRows {
        let is_new = |pose: &u32| !self.calibration.contains(pose);
        let poses: BTreeSet<u32> = self.validation.iter().copied().filter(is_new).collect();
        let distances = folder.distances.iter();
        let distances: BTreeSet<usize> = distances
            .filter(|row| self.held_out_distances.contains(&row.line))
            .filter(|row| !self.distances.contains(&row.line))
            .filter(|row| !is_redundant || row.poses.iter().all(is_new))
            .map(|row| row.line)
            .collect();
        if poses.is_empty() && distances.is_empty() {
            return JudgedRows {
                poses: self.validation.clone(),
                distances: self.held_out_distances.clone(),
                are_fitted: self.held_out_distances.is_subset(&self.distances),
            };
        }
        JudgedRows {
            poses,
            distances,
            are_fitted: false,
        }
    }

    /// True if no row both calibrates and validates.
    pub fn is_disjoint(&self) -> bool {
        self.calibration.is_disjoint(&self.validation)
            && self.distances.is_disjoint(&self.held_out_distances)
    }
}

/// A row far off the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GrossRow {
    /// Its place.
    pub place: RowPlace,
    /// Its residual over the noise that the fit leaves of it.
    pub sigmas: f64,
    /// Share with which it counts: 0 where it is left out, 1 where it is kept.
    pub weight: f64,
}

impl GrossRow {
    /// The same as an outlier of a verdict.
    pub(super) fn outlier(&self) -> Outlier {
        Outlier {
            file: self.place.file,
            line: Some(self.place.line),
            pose: self.place.pose,
            sigmas: self.sigmas,
            weight: self.weight,
            misread: None,
        }
    }

    /// Name of the link or cluster whose drive read it; `None` for what is no reading of a drive.
    pub fn drive<'a>(&self, machine: &'a Machine) -> Option<&'a str> {
        let closure = machine.closure_instances().nth(self.place.drive?)?;
        Some(machine.closure_name(closure))
    }
}

/// An unknown that is no parameter of the machine.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ObjectEstimate {
    /// Name, such as `ball.x`.
    pub name: String,
    /// SI unit.
    pub unit: &'static str,
    /// Value.
    pub value: f64,
    /// Its standard deviation.
    pub sigma: f64,
    /// That of its prior, if it has one.
    pub tolerance: Option<f64>,
}

impl ObjectEstimate {
    /// As [`ParameterEstimate::sigma_widened`](crate::calibration::ParameterEstimate::sigma_widened).
    pub fn sigma_widened(&self, widening: f64) -> f64 {
        widened(
            self.sigma,
            widening,
            self.tolerance.unwrap_or(f64::INFINITY),
        )
    }
}

/// Ranks, and what is open.
#[derive(Debug, Clone, PartialEq)]
pub struct Rank {
    /// Number of residuals.
    pub rows: usize,
    /// Residuals of what is measured by others already, at the same pose or the same commands.
    pub repeated: usize,
    /// Unknowns of poses that the others pay for.
    pub spent: usize,
    /// Number of poses at commands of their own.
    pub poses: usize,
    /// Number of shared unknowns.
    pub unknowns: usize,
    /// Combinations of these that the data know better than the tolerances.
    pub determined: usize,
    /// True if the data say anything of the machine, or nothing of it is unknown.
    pub is_seen: bool,
    /// Combinations that no residual sees, in words.
    pub open: Vec<Freedom>,
    /// True if a mirror image of the machine would fit as well.
    pub has_mirror_image: bool,
}

impl Rank {
    /// Residuals that are left for the shared unknowns once poses have their own.
    pub fn net_rows(&self) -> usize {
        self.rows.saturating_sub(self.repeated + self.spent)
    }

    /// Combinations of unknowns that measurements of these kinds can determine, if there are enough.
    pub fn factors(&self) -> usize {
        let motions = self.open.iter().filter(|open| open.is_motion);
        self.unknowns - motions.count().min(self.unknowns)
    }

    /// True if every residual is needed to determine something, so that none can be told to be wrong.
    pub fn is_saturated(&self) -> bool {
        self.net_rows() <= self.factors()
    }

    /// Number of calibrating poses, measured like these, from which on residuals are left to judge the fit by.
    pub fn poses_needed(&self) -> usize {
        let each = (self.net_rows() as f64 / self.poses.max(1) as f64).max(1e-9);
        #[allow(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a small count"
        )]
        let needed = ((self.factors() + 1) as f64 / each).ceil() as usize;
        needed
    }

    /// Why a calibration would mean nothing, if so.
    pub fn why_not(&self) -> Option<Remark> {
        let (net, poses) = (self.net_rows(), self.poses);
        if !self.is_seen {
            let why = "these measurements say nothing of the machine: none of its parameters changes what they measure";
            return Some(Remark::new(codes::NOTHING_SEEN, why));
        }
        if self.is_saturated() {
            let why = format!(
                "{net} residuals of {poses} poses for {} factors: the fit would repeat its input, and no wrong measurement \
                 could be told; at least {} such poses have to calibrate",
                self.factors(),
                self.poses_needed()
            );
            return Some(Remark::new(codes::RANK, why));
        }
        let scale = self.open.iter().find(|freedom| freedom.is_scale)?;
        let why = format!(
            "nothing determines the {}: a free scale makes a machine of any size fit, the smaller the better",
            scale.words
        );
        Some(Remark::new(codes::NO_SCALE, why))
    }
}

/// A calibration from poses that are unknown.
#[derive(Debug, Clone)]
pub struct UnknownPoses {
    /// The machine, with parameters, covariance and file.
    pub calibration: Calibration,
    /// Targets, surfaces and balls.
    pub objects: Vec<ObjectEstimate>,
    /// The same as unknowns of a fit.
    pub(super) unknown_objects: Vec<Object>,
    /// Kinds of residuals.
    pub kinds: Vec<KindFit>,
    /// Combinations that the measurements determine, and those they leave open.
    pub rank: Rank,
    /// Rows that were left out, or count less under a loss, or are kept, worst first.
    pub gross: Vec<GrossRow>,
    /// The poses that are met worst, without those rows.
    pub worst: Vec<PoseFit>,
    /// Poses whose rows are among them together, that with most of them first.
    pub gross_poses: Vec<GrossPose>,
    /// Fit of rows that took no part; `None` where all did.
    pub held_out: Option<HeldOut>,
    /// Number of poses that took part.
    pub poses: usize,
    /// Sum of squared residuals over their noise, and what is left of their number.
    pub chi2: f64,
    /// Residuals less what the fit absorbs.
    pub dof: f64,
    /// Mistakes in the rows, which were fitted as they are.
    pub mistakes: Vec<Mistake>,
    /// Loss of the fit, if it is not least squares.
    pub loss: Option<Loss>,
    /// Noise at which the parameters were found over the stated one: more than 1 where at that what the model misses would
    /// drive them beyond their tolerances.
    pub widened: f64,
    /// False where poses, noise or the rows that take part still changed when the rounds ran out.
    pub is_settled: bool,
    /// Lowest and highest value of each command among the poses (m or rad).
    pub commands_m: Vec<[f64; 2]>,
    /// Lowest and highest coordinate of the TCP along each axis (m).
    pub position_m: Vec<[f64; 2]>,
}

impl UnknownPoses {
    /// √(chi2/dof).
    pub fn residual_over_noise(&self) -> f64 {
        (self.chi2 / self.dof.max(1e-9)).sqrt()
    }

    /// Places of the rows that were left out.
    pub fn left_out(&self) -> BTreeSet<RowPlace> {
        let left_out = self.gross.iter().filter(|gross| gross.weight == 0.0);
        left_out.map(|gross| gross.place).collect()
    }

    /// Root mean square of the noise of lengths that residuals are weighed by (m), and of what drives that turn make of
    /// theirs.
    pub fn usual_noise_m(&self) -> f64 {
        let lengths = self.kinds.iter().filter_map(|kind| {
            let sigma_m = kind.kind.sigma * kind.kind.unit_m?;
            sigma_m.is_finite().then_some((kind.rows as f64, sigma_m))
        });
        let (rows, squares) = lengths.fold((0.0, 0.0), |(rows, squares), (own, sigma_m)| {
            (rows + own, squares + own * sigma_m.powi(2))
        });
        (squares / f64::max(rows, 1.0)).sqrt()
    }

    /// Squares of the residuals whose noise is stated, and what is left of their number: noise that was estimated from residuals
    /// makes these what is expected, whatever the model.
    pub(super) fn of_stated(&self) -> (f64, f64) {
        let stated = self.kinds.iter().filter(|fit| fit.is_tested());
        stated.fold((0.0, 0.0), |(chi2, dof), fit| {
            (chi2 + fit.chi2(), dof + fit.dof())
        })
    }

    /// True if residuals are no larger than the stated noise lets expect, all together and those of each kind.
    pub fn is_consistent(&self) -> bool {
        let (chi2, dof) = self.of_stated();
        chi2_survival(chi2, dof.max(1e-9)) > SIGNIFICANT && self.beyond_noise().is_empty()
    }

    /// Kinds whose residuals exceed their stated noise by more than chance allows, of all kinds that are tested (Bonferroni).
    ///
    /// Squares of a kind are a quadratic form of which the expectation is known; it scatters no more than χ² of as many degrees
    /// of freedom.
    pub(super) fn beyond_noise(&self) -> Vec<&KindFit> {
        let tested = self.kinds.iter().filter(|fit| fit.is_tested());
        let tested: Vec<&KindFit> = tested
            .filter(|fit| fit.residual_over_noise().is_some())
            .collect();
        let level = SIGNIFICANT / tested.len().max(1) as f64;
        let is_beyond = |fit: &&KindFit| chi2_survival(fit.squares, fit.redundancy) < level;
        tested.into_iter().filter(is_beyond).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A chain of distances over the first 101 poses, and a hundred more poses that none is of.
    #[test]
    fn a_part_keeps_distances_with_their_poses_and_is_evenly_spread() {
        let distances = (0..100).map(|k| Distance {
            line: k as usize + 2,
            poses: [k, k + 1],
            distance_m: 0.1,
            sigma_m: None,
        });
        let folder = Folder {
            distances: distances.collect(),
            ..Folder::default()
        };
        let all = RowDivision {
            calibration: (0..201).collect(),
            distances: (2..102).collect(),
            ..RowDivision::default()
        };
        assert_eq!(all.thinned(&folder, 201), None);
        let part = all.thinned(&folder, 40).unwrap();
        let poses = part.calibration.len();
        assert!((36..=40).contains(&poses), "{poses}");
        let is_whole = |line: &usize| {
            let ends = folder.distances[line - 2].poses;
            ends.iter().all(|pose| part.calibration.contains(pose))
        };
        assert!(part.distances.iter().all(is_whole));
        for quarter in 0..4 {
            let own = 50 * quarter..50 * (quarter + 1);
            let count = part.calibration.range(own).count();
            assert!((6..=15).contains(&count), "{quarter}: {count}");
        }
    }
}
