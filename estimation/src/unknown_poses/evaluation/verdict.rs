//! The verdict on measurements of a machine whose parameters are held.

use std::collections::BTreeMap;

use super::super::outcome::GrossRow;
use super::HeldErrors;
use super::known::Sum;
use crate::numerics::distribution::{chi2_survival, f_survival};
use crate::trust::reason::{Estimate, HeldBy, Reason, Size};
use crate::trust::{LARGEST_MISFIT, LEVEL, PoseFit, Pull, Status, Verdict};

/// A parameter that takes away this share of the squares beyond chance is named for them; it decides the words alone, not
/// the status.
const MOST: f64 = 0.8;

impl HeldErrors {
    /// Residuals against noise and the covariance of the parameters, or where these are those of a drawing the fit within
    /// their tolerances.
    pub fn verdict(&self) -> Verdict {
        if let Some(fitted) = &self.within_tolerances {
            let mut verdict = fitted.clone();
            verdict.why.push(Reason::WithinTolerances);
            verdict.blame_rows(&self.mistakes);
            return verdict;
        }
        let mut verdict = Verdict {
            chi2: self.all.squares,
            dof: self.all.degrees,
            residual_over_noise: (self.all.squares / self.all.degrees.max(1.0)).sqrt(),
            by_file: (self.kinds.iter())
                .map(|own| own.kind.fit(own.rows, own.rms, own.expected_rms))
                .collect(),
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
        let by = match (self.knows_parameters, self.are_fitted) {
            (false, _) => HeldBy::Noise,
            (true, false) => HeldBy::NoiseAndParameters,
            (true, true) => HeldBy::Fit,
        };
        // Noise that was estimated is as large as it looks, and parameters that are known better than stated are not its.
        let is_small = |sum: &Sum| {
            let is_tested = !is_estimated && sum.degrees > 0.0;
            is_tested && chi2_survival(sum.squares, sum.degrees) > 1.0 - LEVEL
        };
        let is_loose = self.kinds.iter().any(|own| own.kind.is_loose);
        let size = if is_misfit || has_moved {
            verdict.status = Status::Inconsistent;
            Size::Unsaid
        } else if is_small(&self.rest) && !is_loose {
            Size::TooLarge
        } else if is_small(&self.all) {
            Size::Unsaid
        } else {
            Size::Chance
        };
        verdict.meet_noise(Reason::Held {
            over_noise: verdict.residual_over_noise,
            squares: [self.all.squares, self.all.degrees],
            by,
            size,
        });
        verdict.say_contradiction(self.kinds.iter().map(|own| &own.kind));
        let why = &mut verdict.why;
        if has_moved {
            why.push(Reason::Changed([squares, degrees]));
            let beyond = squares - degrees;
            let first = self.moved.first();
            let first = first.filter(|own| own.squares > MOST * beyond);
            if let Some((own, change)) = first.and_then(|own| Some((own, own.change?))) {
                why.push(Reason::Alone {
                    parameter: own.parameter.clone(),
                    squares: own.squares,
                    change,
                    unit: own.unit.clone(),
                });
            }
        }
        if is_misfit {
            why.push(Reason::NotTaken([self.rest.squares, self.rest.degrees]));
        }
        if !self.knows_parameters {
            why.push(Reason::ParametersExact);
        }
        for own in &self.kinds {
            let of = own.kind.words();
            if !own.is_judged() {
                why.push(Reason::NotJudged(of, own.redundancy, own.rows));
            } else if own.kind.is_estimated() {
                let estimate = Estimate::OfResiduals(own.kind.sigma);
                why.push(Reason::Estimated(of, estimate, own.kind.of.unit()));
            }
        }
        let farthest = self.kinds.iter().find_map(|own| {
            let rms_m = own.rms * own.kind.unit_m?;
            let is_far = rms_m > LARGEST_MISFIT * self.length_m && own.rms > own.expected_rms;
            is_far.then_some(Reason::AnotherMachine(own.kind.table(), rms_m))
        });
        if let Some(another) = farthest.filter(|_| verdict.status == Status::Inconsistent) {
            verdict.say(Status::Absurd, another);
        }
        verdict.blame_rows(&self.mistakes);
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
        PoseFit::worst(
            sums.into_iter()
                .map(|(pose, (squares, count))| (pose, (squares / count).sqrt())),
        )
    }

    fn pulls(&self) -> Vec<Pull> {
        Pull::largest(self.moved.iter().map(|own| Pull {
            parameter: own.parameter.clone(),
            tolerances: own.sigmas,
        }))
    }
}
