//! The verdict on measurements of a machine whose parameters are held.

use std::collections::BTreeMap;

use super::super::measurand::Measurand;
use super::super::outcome::GrossRow;
use super::super::rows::Kind;
use super::super::verdict::{ESTIMATED_FROM_RESIDUALS, too_large};
use super::HeldErrors;
use super::known::Sum;
use crate::numerics::distribution::{chi2_survival, f_survival};
use crate::numerics::order::largest_first;
use crate::trust::{
    FileFit, LARGEST_MISFIT, LEVEL, LISTED, PoseFit, Pull, Status, Verdict, general, words,
};

/// A parameter that takes away this share of the squares beyond chance is named for them; it decides the words alone, not
/// the status.
const MOST: f64 = 0.8;

impl HeldErrors {
    /// Residuals against noise and the covariance of the parameters, or where these are those of a drawing the fit within
    /// their tolerances.
    pub fn verdict(&self) -> Verdict {
        if let Some(fitted) = &self.within_tolerances {
            let mut verdict = fitted.clone();
            let of_fit = "Parameters of a drawing may lie anywhere within their tolerances; this is the fit there.";
            verdict.why.push(of_fit.to_owned());
            verdict.blame_rows(&self.mistakes);
            return verdict;
        }
        let mut verdict = Verdict {
            chi2: self.all.squares,
            dof: self.all.degrees,
            residual_over_noise: (self.all.squares / self.all.degrees.max(1.0)).sqrt(),
            by_file: self.by_file(),
            worst: self.worst(),
            pulls: self.pulls(),
            outliers: self.gross.iter().map(GrossRow::outlier).collect(),
            ..Verdict::default()
        };
        self.judge(&mut verdict);
        verdict
    }

    /// Two tests: of what no parameters take away, and of parameters that are off those of the file.
    fn judge(&self, verdict: &mut Verdict) {
        let is_estimated = self.kinds.iter().any(|own| own.kind.is_estimated());
        let squares = self.all.squares - self.rest.squares;
        let degrees = self.all.degrees - self.rest.degrees;
        // Parameters that these rows calibrated are off by what tolerances hold back: of each at most as by chance.
        let tested = degrees + self.absorbed;
        let is_misfit =
            self.rest.degrees > 0.0 && chi2_survival(self.rest.squares, self.rest.degrees) < LEVEL;
        // Noise that was estimated from the rest is known no better than by so many residuals; what the model lacks is in
        // both.
        let has_moved = match (
            is_estimated || is_misfit,
            degrees > 0.0,
            self.rest.degrees > 0.0,
        ) {
            (_, false, _) | (true, _, false) => false,
            (true, ..) => {
                let of_noise = self.rest.squares / self.rest.degrees;
                let ratio = squares / tested / of_noise.max(f64::MIN_POSITIVE);
                f_survival(ratio, tested, self.rest.degrees) < LEVEL
            }
            (false, ..) => chi2_survival(squares, tested) < LEVEL,
        };
        let why = &mut verdict.why;
        let ratio = general(verdict.residual_over_noise, 3);
        let known = match (self.knows_parameters, self.are_fitted) {
            (false, _) => "noise makes",
            (true, false) => "noise and what is not known of the parameters make",
            (true, true) => "noise leaves in a fit to",
        };
        // Noise that was estimated is as large as it looks, and parameters that are known better than stated are not its.
        let is_small = |sum: &Sum| {
            let is_tested = !is_estimated && sum.degrees > 0.0;
            is_tested && chi2_survival(sum.squares, sum.degrees) > 1.0 - LEVEL
        };
        let chance = if is_misfit || has_moved {
            verdict.status = Status::Inconsistent;
            String::new()
        } else if is_small(&self.rest) {
            too_large(self.kinds.iter().map(|own| &own.kind), ": the noise")
        } else if is_small(&self.all) {
            String::new()
        } else {
            ", as chance allows".to_owned()
        };
        why.push(format!(
            "With the parameters held, residuals are {ratio} times what {known} them{chance} (χ² {} where {} is expected).",
            general(self.all.squares, 4),
            general(self.all.degrees, 4)
        ));
        if has_moved {
            why.push(words::changed(squares, degrees));
            let beyond = squares - degrees;
            let first = self.moved.first();
            let first = first.filter(|own| own.squares > MOST * beyond);
            if let Some((own, change)) = first.and_then(|own| Some((own, own.change?))) {
                why.push(format!(
                    "`{}` alone would take away {}, changed by {} {}.",
                    own.parameter,
                    general(own.squares, 3),
                    general(change, 2),
                    own.unit
                ));
            }
        }
        if is_misfit {
            why.push(format!(
                "No parameters take away {} of χ², where {} is expected: the model lacks something (`tau discover` looks for \
                 it), or the noise is larger than stated.",
                general(self.rest.squares, 4),
                general(self.rest.degrees, 4)
            ));
        }
        if !self.knows_parameters {
            why.push(
                "The robot file does not say how well its parameters are known: they count as exact.".to_owned(),
            );
        }
        for own in &self.kinds {
            let Kind { of, sigma, .. } = own.kind;
            let (file, quantity, unit) = (of.file(), of.quantity(), of.unit());
            let is_axis = matches!(of, Measurand::Coordinate(_));
            if !own.is_judged() {
                let rows = if is_axis {
                    format!("{quantity} in {file}")
                } else {
                    format!("The {} of {file}", plural(quantity))
                };
                why.push(format!(
                    "{rows} can't be judged: poses and places follow all but {} of {}.",
                    general(own.redundancy, 2),
                    own.rows
                ));
            } else if own.kind.is_estimated() {
                let of = if is_axis {
                    format!("{quantity} in {file}")
                } else {
                    file.to_owned()
                };
                why.push(format!(
                    "The noise of {of} was estimated: {} {unit}; {ESTIMATED_FROM_RESIDUALS}.",
                    general(sigma, 2)
                ));
            }
        }
        let farthest = self.kinds.iter().find_map(|own| {
            let rms_m = own.rms * own.kind.unit_m?;
            let is_far = rms_m > LARGEST_MISFIT * self.length_m && own.rms > own.expected_rms;
            is_far.then_some((own, rms_m))
        });
        if let Some((own, rms_m)) = farthest.filter(|_| verdict.status == Status::Inconsistent) {
            verdict.status = Status::Absurd;
            why.push(format!(
                "{} is off by {} mm: this is another machine, or commands and measurements do not belong together.",
                own.kind.of.file(),
                general(1e3 * rms_m, 3)
            ));
        }
        verdict.blame_rows(&self.mistakes);
    }

    fn by_file(&self) -> Vec<FileFit> {
        let kinds = self.kinds.iter();
        kinds
            .map(|own| FileFit {
                file: own.kind.of.file(),
                kind: own.kind.of.quantity(),
                rows: own.rows,
                rms: own.rms,
                expected_rms: own.expected_rms,
                unit: own.kind.of.unit(),
            })
            .collect()
    }

    /// The worst poses: root mean square of their residuals over their standard deviations.
    fn worst(&self) -> Vec<PoseFit> {
        let mut sums: BTreeMap<u32, (f64, f64)> = BTreeMap::new();
        for error in &self.errors {
            if let Some(sigmas) = error.sigmas() {
                let own = sums.entry(error.place.pose).or_default();
                own.0 += sigmas * sigmas;
                own.1 += 1.0;
            }
        }
        let mut worst: Vec<PoseFit> = (sums.into_iter())
            .map(|(pose, (squares, count))| PoseFit {
                pose,
                sigmas: (squares / count).sqrt(),
            })
            .collect();
        largest_first(&mut worst, |pose| pose.sigmas);
        worst.truncate(LISTED);
        worst
    }

    fn pulls(&self) -> Vec<Pull> {
        Pull::largest(self.moved.iter().map(|own| Pull {
            parameter: own.parameter.clone(),
            tolerances: own.sigmas,
        }))
    }
}

fn plural(quantity: &str) -> String {
    match quantity {
        "closure" => "readings".to_owned(),
        _ => format!("{quantity}s"),
    }
}
