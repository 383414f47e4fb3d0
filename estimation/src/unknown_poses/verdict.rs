//! The verdict on a calibration from unknown poses.

use tau_kinematics::Sample;

use super::outcome::{GrossRow, SIGNIFICANT};
use super::rows::{Kind, KindFit};
use super::{ROUGH_NOISE, ROUNDS, UnknownPoses};
use crate::joint::judged::Deviation;
use crate::numerics::distribution::chi2_survival;
use crate::trust::reason::{Estimate, Reason, Repeated, Size};
use crate::trust::tried::beyond_tolerance;
use crate::trust::{
    ABSURD_TOLERANCES, FileFit, LARGEST_MISFIT, LEVEL, PoseFit, Pull, Status, Verdict,
};

/// A parameter that is pulled farther than this many tolerances takes up what the model lacks, where it lacks something: of a
/// hundred parameters, one in a hundred and fifty machines has one by chance.
const FAR_PULL: f64 = 4.0;

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

    /// A refusal of measurements that are missed by far, where some are: see [`Self::missed`].
    pub(super) fn another_machine(&self) -> Option<Reason> {
        let (kind, rms_m) = self.missed()?;
        Some(Reason::AnotherMachine(kind.table(), rms_m))
    }

    /// The kind of lengths that is missed most and its rms (m), where no machine that is the right one would miss it by as
    /// much; `None` where none is missed so. Some may be as rough as that and state it, but not all.
    pub(super) fn missed(&self) -> Option<(&Kind, f64)> {
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
        let farthest = missed.max_by(|a, b| a.1.total_cmp(&b.1));
        farthest.map(|(fit, rms_m)| (&fit.kind, rms_m))
    }

    /// Repeated readings of a kind.
    fn repeatability(fit: &KindFit) -> Option<Reason> {
        let repeats = fit.repeats?;
        Some(Reason::Repeats(Repeated {
            of: Some(fit.kind.words()),
            readings: repeats.readings,
            quantities: repeats.quantities,
            sigmas: vec![(repeats.sigma, fit.kind.of.unit())],
            degrees: repeats.degrees,
            over_noise: repeats.within_over_noise,
            is_estimated: fit.kind.is_estimated(),
            is_shared: false,
            lack_of_fit: repeats.lack_of_fit,
        }))
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
    fn or_drives(&self) -> Option<Reason> {
        let are_exact = self.kinds.iter().any(|fit| fit.kind.is_exact());
        are_exact.then_some(Reason::OrDrives)
    }

    /// Reasons for the size of the residuals, as far as repeated readings tell: noise that scatters more than stated, or a
    /// misfit of the model; of the kinds that `takes` says.
    fn causes(&self, takes: impl Fn(&Kind) -> bool) -> Vec<Reason> {
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
            let (of, unit) = (fit.kind.words(), fit.kind.of.unit());
            if is_too_small(fit) {
                causes.push(Reason::NoiseTooSmall(of.clone(), repeats.sigma, unit));
            }
            if self.lacks_fit(fit) {
                are_missed = true;
                // Noise of other kinds, which no readings confirm, moves poses and so means.
                let others = noisy()
                    .filter(|other| other.kind != fit.kind)
                    .filter(|other| other.repeats.is_none() || is_too_small(other));
                causes.push(Reason::MeansMissed {
                    of,
                    scatter_and_missed: [repeats.sigma, repeats.missed],
                    unit,
                    or_noise_of: others.map(|other| other.kind.words()).collect(),
                });
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
    pub(super) fn deviations(&self) -> Vec<Deviation> {
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
        let kinds = self.kinds.iter().filter(|kind| kind.is_listed());
        let by_file = kinds.map(|fit| fit.kind.fit(fit.rows, fit.rms(), fit.expected_rms()));
        let gross = self.gross.iter().map(|row| (row.place.pose, row.sigmas));
        let is_gross = |pose: u32| self.gross.iter().any(|row| row.place.pose == pose);
        let worst = self.worst.iter().filter(|own| !is_gross(own.pose));
        let worst = worst.map(|own| (own.pose, own.sigmas));
        let mut verdict = Verdict {
            chi2: self.chi2,
            dof: self.dof,
            residual_over_noise: self.residual_over_noise(),
            by_file: by_file.collect(),
            worst: PoseFit::worst(gross.chain(worst)),
            pulls: Pull::largest(self.pulls()),
            outliers: self.gross.iter().map(GrossRow::outlier).collect(),
            means_over_noise: self.means_over_noise(),
            loss: self.loss,
            ..Verdict::default()
        };
        if self.is_consistent() {
            self.ratio_to_noise()
                .into_iter()
                .for_each(|why| verdict.meet_noise(why));
            if self.kinds.iter().any(is_missed) {
                verdict.status = Status::Inconsistent;
                verdict.why.extend(self.causes(Kind::is_estimated));
            } else {
                verdict.why.extend(self.shared_within_noise());
            }
        } else {
            verdict.status = Status::Inconsistent;
            verdict.why.extend(self.misfit_reasons());
        }
        verdict.say_contradiction(self.kinds.iter().map(|fit| &fit.kind));
        if !self.is_settled {
            verdict.why.push(Reason::Unsettled(ROUNDS));
        }
        let parameters = &self.calibration.parameters;
        if let Some(deviation) = self.beyond_tolerance() {
            let pull = Pull::named(&parameters[deviation.parameter].name, &deviation);
            let pulled = Reason::Pulled(pull, deviation.freed);
            verdict.say(Status::Inconsistent, pulled);
        }
        let estimated = self.kinds.iter().filter(|fit| fit.kind.is_estimated());
        verdict.why.extend(estimated.map(estimated_noise));
        verdict.why.extend(self.misses_of_carts());
        let repeats = self.kinds.iter().filter_map(Self::repeatability);
        verdict.why.extend(repeats);
        verdict.blame_rows(&self.mistakes);
        let furthest = verdict.pulls.first().and_then(Pull::refusal);
        verdict.refuse([furthest, self.another_machine()]);
        verdict
    }

    /// Repeated readings whose means are missed by more than they scatter by, and by no more than the stated noise.
    fn shared_within_noise(&self) -> Vec<Reason> {
        let missed = self.kinds.iter().filter(|fit| self.lacks_fit(fit));
        let missed: Vec<String> = missed.map(|fit| fit.kind.words()).collect();
        if missed.is_empty() {
            return vec![];
        }
        let factor = self.means_over_noise().max(1.0);
        let why = Reason::MeansMissedWithinNoise(missed, factor);
        [why].into_iter().chain(self.or_drives()).collect()
    }

    /// Residuals over the noise that they meet; `None` where the fit follows its rows.
    fn ratio_to_noise(&self) -> Option<Reason> {
        let (chi2, dof) = self.of_stated();
        // Noise that readings of a pose share is not seen between them: that it is smaller than stated is no mistake.
        let is_shared = self.kinds.iter().any(|fit| self.lacks_fit(fit));
        // Loose drives count as far noisier than they are.
        let is_loose = self.kinds.iter().any(|fit| fit.kind.is_loose);
        let is_too_large = !is_shared && !is_loose && chi2_survival(chi2, dof) > 1.0 - LEVEL;
        (dof > 0.0).then(|| Reason::Within {
            over_noise: (chi2 / dof).sqrt(),
            left: Some(dof),
            size: if is_too_large {
                Size::TooLarge
            } else {
                Size::Unsaid
            },
        })
    }

    /// Residuals that exceed the stated noise.
    fn misfit_reasons(&self) -> Vec<Reason> {
        let (chi2, dof) = self.of_stated();
        let noisy_kinds = self.kinds.iter().filter(|fit| fit.is_tested()).count();
        let causes = self.causes(|_| true);
        let mut why = vec![Reason::Beyond {
            over_noise: (chi2 / dof.max(1e-9)).sqrt(),
            squares: [chi2, dof],
            is_unexplained: causes.is_empty(),
        }];
        let beyond: Vec<(String, f64)> = (self.beyond_noise().into_iter())
            .filter_map(|fit| Some((fit.kind.words(), fit.residual_over_noise()?)))
            .collect();
        if noisy_kinds > 1 && !beyond.is_empty() {
            why.push(Reason::BeyondChance(beyond));
        }
        why.extend(causes);
        if self.widened > 1.0 {
            why.push(Reason::Widened(self.widened));
        }
        why.extend(self.one_left());
        why
    }

    /// The reason why nothing can be told of what the model lacks, where one residual is left beyond what is determined.
    pub fn one_left(&self) -> Option<Reason> {
        (self.rank.net_rows() == self.rank.factors() + 1).then_some(Reason::OneLeft)
    }

    fn misses_of_carts(&self) -> Option<Reason> {
        let missed = self.kinds.iter().map(|kind| &kind.kind);
        let missed: Vec<_> = missed
            .filter(|kind| kind.is_missed_of_carts())
            .map(|kind| (kind.of.quantity(), kind.of.file(), kind.excess()))
            .collect();
        (!missed.is_empty()).then_some(Reason::CartsMissed(missed))
    }
}

impl Kind {
    /// The fit of its rows, for a verdict.
    pub(super) fn fit(&self, rows: usize, rms: f64, expected_rms: f64) -> FileFit {
        FileFit {
            file: self.of.file(),
            kind: self.of.quantity(),
            rows,
            rms,
            expected_rms,
            unit: self.of.unit(),
        }
    }
}

fn estimated_noise(fit: &KindFit) -> Reason {
    let Kind { of, sigma, .. } = fit.kind;
    let tells = fit.repeats.is_some_and(|own| own.lack_of_fit.is_some());
    let estimate = match fit.residual_over_noise() {
        None => Estimate::Unknown,
        Some(ratio) if ratio < 1.0 - ROUGH_NOISE => Estimate::AtMost(sigma),
        Some(_) if tells => Estimate::BesideRepeats(sigma),
        Some(_) => Estimate::OfResiduals(sigma),
    };
    Reason::Estimated(fit.kind.words(), estimate, of.unit())
}

impl Verdict {
    /// Says that exact drives contradict each other, where some of the kinds are loose.
    pub(super) fn say_contradiction<'a>(&mut self, mut kinds: impl Iterator<Item = &'a Kind>) {
        if kinds.any(|kind| kind.is_loose) {
            self.say(Status::Inconsistent, Reason::DrivesContradict);
        }
    }
}
