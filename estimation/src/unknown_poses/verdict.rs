//! The verdict on a calibration from unknown poses.

use tau_kinematics::Sample;

use super::outcome::{GrossRow, SIGNIFICANT};
use super::rows::{Kind, KindFit};
use super::{ROUGH_NOISE, ROUNDS, UnknownPoses};
use crate::numerics::distribution::chi2_survival;
use crate::trust::judged::Deviation;
use crate::trust::tried::beyond_tolerance;
use crate::trust::weighing_words::{deviation, repeat_to};
use crate::trust::{
    ABSURD_TOLERANCES, FileFit, LARGEST_MISFIT, LEVEL, LISTED, PoseFit, Pull, Status, Verdict,
    general,
};

/// A parameter that is pulled farther than this many tolerances takes up what the model lacks, where it lacks something: of a
/// hundred parameters, one in a hundred and fifty machines has one by chance.
const FAR_PULL: f64 = 4.0;

/// Noise that is estimated is as large as the residuals, whatever these hold.
pub(super) const ESTIMATED_FROM_RESIDUALS: &str =
    "that is the size of its residuals, which says nothing of the model";

impl UnknownPoses {
    /// Mean length of the links at the reference (m); infinite where there is none.
    pub(super) fn length_m(&self) -> f64 {
        let machine = &self.calibration.machine;
        let stated = machine.surroundings.reference.as_ref();
        let length_m = stated.and_then(|stated| {
            let sample = Sample::new(stated.into(), &stated.commands_m);
            machine.mean_length_m(&sample).ok()
        });
        length_m.unwrap_or(f64::INFINITY)
    }

    /// Sentence on measurements that are missed by far, where some are: see [`Self::missed_m`].
    pub(super) fn another_machine(&self) -> Option<String> {
        let missed_m = self.missed_m()?;
        Some(format!(
            "Measurements are missed by {} mm: this is another machine, or commands and measurements do not belong together.",
            general(1e3 * missed_m, 3)
        ))
    }

    /// Largest rms (m) of what a kind of lengths is missed by, where no machine that is the right one would miss it by as much;
    /// `None` where none is missed so. Some may be as rough as that and state it, but not all.
    pub(super) fn missed_m(&self) -> Option<f64> {
        let limit_m = LARGEST_MISFIT * self.length_m();
        let judged = self.kinds.iter().filter(|fit| fit.is_listed());
        let lengths: Vec<(&KindFit, f64)> = judged
            .filter_map(|fit| Some((fit, fit.rms() * fit.kind.unit_m?)))
            .collect();
        let is_rough = |(fit, _): &(&KindFit, f64)| {
            let unit_m = fit.kind.unit_m;
            unit_m.is_some_and(|unit_m| fit.usual_rms() * unit_m > limit_m)
        };
        let is_consistent = self.is_consistent();
        let is_all = lengths.iter().all(is_rough);
        let is_missed = |(fit, rms_m): &(&KindFit, f64)| {
            *rms_m > limit_m && fit.rms() > fit.expected_rms() && !is_consistent
        };
        let missed = (lengths.into_iter()).filter(|own| is_all || is_missed(own));
        missed.map(|(_, rms_m)| rms_m).reduce(f64::max)
    }

    /// Repeated readings of a kind.
    fn repeatability(fit: &KindFit) -> Option<String> {
        let repeats = fit.repeats?;
        let unit = fit.kind.of.unit();
        let subject = format!(
            "Of {}, {} readings of {} values",
            fit.kind.words(),
            repeats.readings,
            repeats.quantities
        );
        let noise = if fit.kind.is_estimated() {
            "estimated"
        } else {
            "stated"
        };
        Some(repeat_to(
            &subject,
            (&deviation(repeats.sigma, unit), ""),
            repeats.degrees,
            (repeats.within_over_noise, noise),
            repeats.lack_of_fit.as_ref().map(|test| ("values", test)),
        ))
    }

    /// True if the model misses the means of a kind's repeated readings by more than their scatter lets expect, of all kinds
    /// with such a test by no more than chance allows (Bonferroni).
    fn lacks_fit(&self, fit: &KindFit) -> bool {
        let test = |fit: &KindFit| fit.repeats?.lack_of_fit;
        let tests = self.kinds.iter().filter_map(test).count();
        test(fit).is_some_and(|test| test.p_value * (tests as f64) < SIGNIFICANT)
    }

    /// [`Verdict::means_over_noise`].
    fn means_over_noise(&self) -> f64 {
        let missed = self.kinds.iter().filter(|fit| self.lacks_fit(fit));
        let tests = missed.filter_map(|fit| fit.repeats?.lack_of_fit);
        tests.fold(0.0, |most, test| test.over_noise.max(most))
    }

    /// The other reason for means that are missed where no noise of drives is known: readings of one value were taken at one
    /// place, and do not show how well the drives come back to it.
    fn or_drives(&self) -> Option<String> {
        let are_exact = self.kinds.iter().any(|fit| fit.kind.is_exact());
        are_exact.then(|| {
            "Or the drives do not repeat as well as readings at one place: then state their noise or have it estimated \
             (`[drives] noise_m = \"estimate\"`)."
                .to_owned()
        })
    }

    /// Reasons for the size of the residuals, as far as repeated readings tell: noise that scatters more than stated, or a
    /// misfit of the model; of the kinds that `takes` says.
    fn causes(&self, takes: impl Fn(&Kind) -> bool) -> Vec<String> {
        let noisy = || {
            self.kinds
                .iter()
                .filter(|fit| fit.rows > 0 && !fit.kind.is_exact())
        };
        let is_too_small = |fit: &KindFit| {
            let own = fit.repeats.filter(|_| !fit.kind.is_estimated());
            own.is_some_and(|own| {
                let squares = own.within_over_noise.powi(2) * own.degrees;
                chi2_survival(squares, own.degrees) < SIGNIFICANT
            })
        };
        let mut causes = vec![];
        let mut are_missed = false;
        for fit in noisy().filter(|fit| takes(&fit.kind)) {
            let Some(repeats) = fit.repeats else { continue };
            let own = fit.kind.words();
            let in_words = |sigma| deviation(sigma, fit.kind.of.unit());
            if is_too_small(fit) {
                causes.push(format!(
                    "The stated noise of {own} is too small: readings of one value scatter by {}.",
                    in_words(repeats.sigma)
                ));
            }
            // Noise of other kinds, which no readings confirm, moves poses and so means.
            let others: Vec<String> = noisy()
                .filter(|other| other.kind != fit.kind)
                .filter(|other| other.repeats.is_none() || is_too_small(other))
                .map(|other| other.kind.words())
                .collect();
            let or_noise = if others.is_empty() {
                String::new()
            } else {
                format!(", or the noise of {} is larger", others.join(" and "))
            };
            if self.lacks_fit(fit) {
                are_missed = true;
                causes.push(format!(
                    "Readings of {own} repeat to {}, the model misses their means by {}: it lacks something{or_noise}.",
                    in_words(repeats.sigma),
                    in_words(repeats.missed)
                ));
            }
        }
        if are_missed {
            causes.extend(self.or_drives());
        }
        causes
    }

    /// True if the rows are those of the machine.
    pub(super) fn is_met(&self) -> bool {
        self.is_consistent() && self.is_plausible()
    }

    /// True if no parameter is off by more than any machine.
    pub(super) fn is_plausible(&self) -> bool {
        (self.pulls()).all(|pull| pull.tolerances.abs() < ABSURD_TOLERANCES)
    }

    /// Parameters by how far they lie off their nominal values, in tolerances.
    pub(super) fn pulls(&self) -> impl Iterator<Item = Pull> {
        self.calibration.pulls()
    }

    /// True if what the model lacks, in units of the stated noise, outweighs tolerances: it drives a parameter far off, and no
    /// mistake is known to be the reason.
    pub(super) fn outweighs_tolerances(&self) -> bool {
        !self.is_consistent()
            && self.mistakes.is_empty()
            && (self.pulls()).any(|pull| pull.tolerances.abs() > FAR_PULL)
    }

    /// The parameter farthest off, where chance does not let it be so.
    pub(super) fn beyond_tolerance(&self) -> Option<Deviation> {
        beyond_tolerance(&self.deviations(), self.residual_over_noise())
    }

    /// Parameters against their tolerances.
    fn deviations(&self) -> Vec<Deviation> {
        let estimates = self.calibration.parameters.iter().enumerate();
        let of = estimates.filter_map(|(place, own)| {
            let tolerance = own.tolerance?;
            let off = (own.value - own.nominal) / tolerance;
            Some(Deviation::new(place, off, (own.sigma / tolerance).powi(2)))
        });
        of.collect()
    }

    /// Residuals against noise and parameters against tolerances.
    pub fn verdict(&self) -> Verdict {
        // Noise that was estimated from residuals holds what the model misses.
        let is_missed = |fit: &KindFit| fit.kind.is_estimated() && self.lacks_fit(fit);
        let (is_consistent, mut why) = if self.is_consistent() {
            let is_missed = self.kinds.iter().any(is_missed);
            let mut why: Vec<String> = self.ratio_to_noise().into_iter().collect();
            why.extend(if is_missed {
                self.causes(Kind::is_estimated)
            } else {
                self.shared_within_noise()
            });
            (!is_missed, why)
        } else {
            (false, self.misfit_in_words())
        };
        if !self.is_settled {
            why.push(format!(
                "Poses, noise or the rows that take part still changed after {ROUNDS} rounds of fit and weights."
            ));
        }
        let pulls = Pull::largest(self.pulls());
        let far = self.beyond_tolerance();
        if let Some(deviation) = far {
            let [off, freed] =
                [deviation.tolerances, deviation.freed].map(|own| general(own.abs(), 2));
            let name = &self.calibration.parameters[deviation.parameter].name;
            let mut said = format!("`{name}` lies {off} tolerances off its nominal value");
            if freed != off {
                said += &format!(", {freed} where its own did not hold it back");
            }
            why.push(said + ".");
        }
        let status = if is_consistent && far.is_none() {
            Status::Consistent
        } else {
            Status::Inconsistent
        };
        let estimated = self.kinds.iter().filter(|fit| fit.kind.is_estimated());
        why.extend(estimated.map(estimated_noise));
        why.extend(self.misses_of_carts());
        why.extend(self.kinds.iter().filter_map(Self::repeatability));
        let kinds = self.kinds.iter().filter(|kind| kind.is_listed());
        let mut verdict = Verdict {
            status,
            chi2: self.chi2,
            dof: self.dof,
            residual_over_noise: self.residual_over_noise(),
            by_file: kinds
                .map(|fit| FileFit {
                    file: fit.kind.of.file(),
                    kind: fit.kind.of.quantity(),
                    rows: fit.rows,
                    rms: fit.rms(),
                    expected_rms: fit.expected_rms(),
                    unit: fit.kind.of.unit(),
                })
                .collect(),
            worst: (self.gross.iter().take(LISTED))
                .map(|row| PoseFit {
                    pose: row.place.pose,
                    sigmas: row.sigmas,
                })
                .collect(),
            pulls,
            why,
            outliers: self.gross.iter().map(GrossRow::outlier).collect(),
            means_over_noise: self.means_over_noise(),
            loss: self.loss,
            ..Verdict::default()
        };
        verdict.blame_rows(&self.mistakes);
        let furthest = verdict.pulls.first().cloned();
        verdict.refuse_pull(furthest.as_ref());
        if verdict.mistakes.is_empty()
            && let Some(why) = self.another_machine()
        {
            verdict.status = Status::Absurd;
            verdict.why.push(why);
        }
        verdict
    }

    /// Sentences on repeated readings whose means are missed by more than they scatter by, and by no more than the stated
    /// noise.
    fn shared_within_noise(&self) -> Vec<String> {
        let missed = self.kinds.iter().filter(|fit| self.lacks_fit(fit));
        let missed: Vec<String> = missed.map(|fit| fit.kind.words()).collect();
        if missed.is_empty() {
            return vec![];
        }
        let why = format!(
            "The model misses means of repeated readings of {} by more than these scatter by, though within the stated noise: \
             it lacks something, and standard deviations, for which each reading has errors of its own, are up to {} times \
             as large.",
            missed.join(" and "),
            general(self.means_over_noise().max(1.0), 3)
        );
        [why].into_iter().chain(self.or_drives()).collect()
    }

    /// Residuals over the noise that they meet; `None` where the fit follows its rows.
    fn ratio_to_noise(&self) -> Option<String> {
        let (chi2, dof) = self.of_stated();
        // Noise that readings of a pose share is not seen between them: that it is smaller than stated is no mistake.
        let is_shared = self.kinds.iter().any(|fit| self.lacks_fit(fit));
        let is_too_large = !is_shared && chi2_survival(chi2, dof) > 1.0 - LEVEL;
        (dof > 0.0).then(|| {
            format!(
                "Residuals are {} times their noise{}, {} of them beyond what the fit absorbs.",
                general((chi2 / dof).sqrt(), 3),
                if is_too_large {
                    too_large(self.kinds.iter().map(|fit| &fit.kind), ", which")
                } else {
                    String::new()
                },
                general(dof, 3)
            )
        })
    }

    /// Sentences on residuals that exceed the stated noise.
    fn misfit_in_words(&self) -> Vec<String> {
        let (chi2, dof) = self.of_stated();
        let ratio = general((chi2 / dof.max(1e-9)).sqrt(), 3);
        let noisy_kinds = self.kinds.iter().filter(|fit| fit.is_tested()).count();
        let causes = self.causes(|_| true);
        let mut why = vec![if causes.is_empty() {
            format!(
                "Residuals are {ratio} times the stated noise: the model lacks something, or the noise is larger."
            )
        } else {
            format!("Residuals are {ratio} times the stated noise.")
        }];
        let beyond: Vec<String> = (self.beyond_noise().into_iter())
            .filter_map(|fit| {
                let ratio = general(fit.residual_over_noise()?, 3);
                Some(format!("{} {ratio} times", fit.kind.words()))
            })
            .collect();
        if noisy_kinds > 1 && !beyond.is_empty() {
            why.push(format!("Beyond chance are those of {}.", beyond.join(", ")));
        }
        why.extend(causes);
        if self.widened > 1.0 {
            why.push(format!(
                "At that noise what is missed would drive parameters beyond their tolerances: they are those at {} times \
                 that noise, where tolerances hold them.",
                general(self.widened, 3)
            ));
        }
        if self.rank.net_rows() == self.rank.factors() + 1 {
            why.push(
                "One residual is left beyond the factors: every effect would explain it as well as any other; measure \
                 more poses to tell what the model lacks."
                    .to_owned(),
            );
        }
        why
    }

    fn misses_of_carts(&self) -> Option<String> {
        let missed = self.kinds.iter().map(|kind| &kind.kind);
        let missed = missed.filter(|kind| kind.is_missed_of_carts());
        let missed: Vec<String> = missed
            .map(|kind| {
                let times = general(kind.excess(), 2);
                format!(
                    "{}s in {} {times} times",
                    kind.of.quantity(),
                    kind.of.file()
                )
            })
            .collect();
        (!missed.is_empty()).then(|| {
            format!(
                "Carts miss their stated noise, and count that much less: {}.",
                missed.join(", ")
            )
        })
    }
}

fn estimated_noise(fit: &KindFit) -> String {
    let own = fit.kind.words();
    let (unit, sigma) = (fit.kind.of.unit(), fit.kind.sigma);
    let Some(ratio) = fit.residual_over_noise() else {
        return format!("The noise of {own} could not be estimated: the fit follows its rows.");
    };
    if ratio < 1.0 - ROUGH_NOISE {
        return format!(
            "The noise of {own} was estimated to be no more than {} {unit}.",
            general(sigma, 2)
        );
    }
    format!(
        "The noise of {own} was estimated: {} {unit}; {}.",
        general(sigma, 2),
        if fit.repeats.is_some_and(|own| own.lack_of_fit.is_some()) {
            "of the model its repeated readings tell, not the size of its residuals"
        } else {
            ESTIMATED_FROM_RESIDUALS
        }
    )
}

/// Reason why residuals are less than their noise by more than chance.
pub(super) fn too_large<'a>(mut kinds: impl Iterator<Item = &'a Kind>, noise: &str) -> String {
    if kinds.any(|kind| kind.is_loose) {
        return ": exact drives that contradict each other are taken for as noisy as what was measured".to_owned();
    }
    format!("{noise} is stated too large")
}
