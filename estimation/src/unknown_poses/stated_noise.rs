//! Noise and tolerances that are stated a thousand times too large or too small, where poses are unknown.
//!
//! More noise makes any residuals fit. That they are noise shows in each kind of them for itself, and in most as in all; and
//! a dimension without which they are the stated noise goes before, for it leaves less room.

use tau_robot::measurements::PlateKind;
use tau_robot::measurements::plausible::LARGEST_NOISE;
use tau_robot::robot_file::{RobotFile, StatedNoise};

use super::measurand::Measurand;
use super::rows::KindFit;
use super::trials::Case;
use super::{UnknownPoses, starts};
use crate::numerics::distribution::chi2_survival;
use crate::numerics::parallel;
use crate::setup::Setup;
use crate::trust::hypothesis::{Hypothesis, LENGTH, THOUSAND, small_tolerances};
use crate::trust::recognise::POSES;
use crate::trust::tried::STATED;
use crate::trust::{LEVEL, Mistake, NEARER, ODDS, wide, words};

/// Fits from the stated noise to a thousandth or a thousand times it, a factor of three between each two.
const STEPS: u32 = 6;

/// Whose noise it is.
#[derive(Clone, Copy, PartialEq)]
enum Whose {
    Measurements,
    Drives,
    Both,
}

impl Case<'_> {
    /// Noise of the measurements, of the drives, or of both that is stated a thousand times too large or too small: residuals are far
    /// from it, by more than chance, and of all noise between the evidence is the largest for a thousandth or a thousand
    /// times. Of few rows, residuals alone tell little: at a thousandth, tolerances give way to them.
    pub(super) fn wrong_noise(&self, given: &UnknownPoses) -> Option<Mistake> {
        let by_chance = chi2_survival(given.chi2, given.dof);
        let ratio = given.residual_over_noise();
        let factor = if ratio < NEARER.recip() && by_chance > 1.0 - LEVEL {
            THOUSAND.recip()
        } else if ratio > NEARER && by_chance < LEVEL {
            THOUSAND
        } else {
            return None;
        };
        let is_told = |whose: Whose| given.kinds.iter().any(|fit| whose.is_of(fit));
        let tried = [Whose::Measurements, Whose::Drives].into_iter();
        let tried: Vec<Whose> = tried.filter(|&whose| is_told(whose)).collect();
        let both = (tried.len() > 1).then_some(Whose::Both);
        let tried = tried.into_iter().chain(both);
        // Noise of one kind passes for that of others: what no file may state is nobody's.
        let tried = tried.filter(|whose| can_be_stated(&whose.scaled(self.setup.file, factor)));
        let gains = tried.filter_map(|whose| Some((self.gain(whose, factor)?, whose)));
        let (_, whose) = gains.max_by(|a, b| a.0.total_cmp(&b.0))?;
        let dimension = (factor > 1.0 && !self.has_places()).then(|| self.dimension_instead(given));
        if let Some(dimension) = dimension.flatten() {
            return Some(dimension);
        }
        let whose = match whose {
            Whose::Measurements => "of the measurements (`[noise]`)",
            Whose::Drives => "of the drives (`[drives]`)",
            Whose::Both => "of the measurements and of the drives (`[noise]` and `[drives]`)",
        };
        Some(words::of_noise(whose, factor))
    }

    /// True if a tracker measured places, which tell noise from dimensions.
    fn has_places(&self) -> bool {
        let folder = self.setup.folder;
        let mut positions = folder.rows_of(PlateKind::Position);
        !folder.tcp_poses.is_empty() || positions.next().is_some()
    }

    /// Tolerances that are stated a thousand times too small, all or those of lengths: with wider ones residuals are the stated
    /// noise, no parameter is off beyond chance, and most of those that measurements tell are off by what the wider ones let
    /// expect rather than the stated ones.
    pub(super) fn small_tolerances(&self, given: &UnknownPoses) -> Option<Mistake> {
        let by_chance = chi2_survival(given.chi2, given.dof);
        if given.residual_over_noise() < NEARER || by_chance > LEVEL || !self.has_places() {
            return None;
        }
        let thinned = self.division.thinned(self.setup.folder, POSES);
        small_tolerances().into_iter().find_map(|hypothesis| {
            let case = Case {
                division: thinned.as_ref().unwrap_or(self.division),
                tolerances: Some(&hypothesis),
                ..*self
            };
            let found = case.fitted(self.setup.file, self.setup.folder, None).ok()?;
            let Hypothesis::Tolerances {
                factor,
                lengths_only,
                ..
            } = hypothesis
            else {
                return None;
            };
            // Of what data hardly tell, departures say nothing of tolerances.
            let told = (found.calibration.parameters.iter()).filter_map(|own| {
                let tolerance = own.tolerance?;
                let is_told = own.sigma.powi(2) < 0.5 * tolerance.powi(2);
                let counts = is_told && (!lengths_only || own.unit == LENGTH);
                counts.then(|| factor * ((own.value - own.nominal) / tolerance).powi(2) > 1.0)
            });
            let told: Vec<bool> = told.collect();
            let wide = told.iter().filter(|is_wide| **is_wide).count();
            let is_right = found.is_consistent()
                && found.beyond_tolerance().is_none()
                && !told.is_empty()
                && 2 * wide >= told.len();
            is_right.then(|| words::of_tolerances(&hypothesis))?
        })
    }

    /// Tolerances of lengths that no machine has, where a thousandth of them all is enough. Those of some alone may be stated
    /// with caution: where no pose is known, others make up for what these are then denied.
    pub(super) fn wide_tolerances(&self, given: Option<&UnknownPoses>) -> Option<Mistake> {
        let file = &self.setup.file.completed(self.setup.robot);
        let prepared = Setup { file, ..self.setup }.prepared_by_all().ok()?;
        let length_m = starts::length_m(&prepared.machine)?;
        let narrower = wide::narrower(self.setup.variant, &prepared.nominal, length_m);
        let hypothesis = narrower.into_iter().next()?;
        let case = Case {
            tolerances: Some(&hypothesis),
            ..*self
        };
        let found = case.fitted(self.setup.file, self.setup.folder, None).ok()?;
        let ratio = given.map_or(1.0, UnknownPoses::residual_over_noise);
        let are_enough = wide::are_enough(found.residual_over_noise(), &found.deviations(), ratio);
        are_enough.then(|| words::of_tolerances(&hypothesis))?
    }

    /// Gain in 2 ln of the evidence by a factor on noise, if it is decisive and no factor between gains more. With
    /// parameters integrated out it changes with ln of the noise by 2 (χ² − degrees of freedom), both of the residuals with this
    /// noise (D. J. C. MacKay, Neural Computation 4, 1992, equation 4.9).
    fn gain(&self, whose: Whose, factor: f64) -> Option<f64> {
        let thinned = self.division.thinned(self.setup.folder, POSES);
        // No row is left out: what noise is too small for would cost nothing.
        let mut options = self.options.clone();
        options.treatment.keep_outliers = true;
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            options: &options,
            ..*self
        };
        let steps: Vec<u32> = (0..=STEPS).collect();
        let slopes = parallel::map(&steps, |&step| {
            let factor = factor.powf(f64::from(step) / f64::from(STEPS));
            let found = case.fitted(
                &whose.scaled(self.setup.file, factor),
                self.setup.folder,
                None,
            );
            let found = found.ok()?;
            let own = found.kinds.iter().filter(|fit| whose.is_of(fit));
            let slope: f64 = own.clone().map(|fit| fit.chi2() - fit.dof()).sum();
            let is_right = found.residual_over_noise().ln().abs() < STATED.ln()
                && own.into_iter().all(is_noise)
                && found.is_plausible();
            Some((2.0 * slope, is_right))
        });
        // Of noise that is far too small, there may be no fit.
        let slopes = slopes.into_iter().skip_while(Option::is_none);
        let slopes: Vec<(f64, bool)> = slopes.collect::<Option<_>>()?;
        if !slopes.last()?.1 {
            return None;
        }
        let width = factor.ln() / f64::from(STEPS);
        let (mut gain, mut largest) = (0.0, 0.0_f64);
        for pair in slopes.windows(2) {
            largest = largest.max(gain);
            gain += 0.5 * width * (pair[0].0 + pair[1].0);
        }
        (gain > largest && gain > 2.0 * ODDS.ln()).then_some(gain)
    }
}

/// The residuals of a kind are noise: they are the stated one, to the factor to which it is known, and a few do not make up for
/// most.
fn is_noise(fit: &KindFit) -> bool {
    let is_told = fit.dof() >= 1.0;
    let ratio = (fit.chi2() / fit.dof()).sqrt();
    !is_told || (ratio.ln().abs() < STATED.ln() && fit.of_most.sqrt().ln().abs() < NEARER.ln())
}

impl Whose {
    fn is_of(self, fit: &KindFit) -> bool {
        let is_closure = matches!(fit.kind.of, Measurand::Closure { .. });
        let is_drives = is_closure && !fit.kind.is_exact();
        let is_its = self == Self::Both || is_drives == (self == Self::Drives);
        !fit.kind.is_estimated() && is_its
    }

    fn scaled(self, file: &RobotFile, factor: f64) -> RobotFile {
        match self {
            Self::Measurements => with_noise(file, factor),
            Self::Drives => with_drives(file, factor),
            Self::Both => with_drives(&with_noise(file, factor), factor),
        }
    }
}

fn scaled(noise: &mut StatedNoise, factor: f64) {
    if let StatedNoise::Known(sigma) = noise {
        *sigma *= factor;
    }
}

/// True if a robot file may hold such noise of positions, lengths and drives.
fn can_be_stated(file: &RobotFile) -> bool {
    let measuring = &file.measuring;
    let axes = measuring.axes.iter().flatten();
    let mut stated = axes
        .chain(measuring.noise.values())
        .chain(&measuring.drives);
    let can_be = |sigma: f64| sigma <= LARGEST_NOISE;
    can_be(file.noise.position_m)
        && stated.all(|own| match own {
            StatedNoise::Known(sigma) => can_be(*sigma),
            StatedNoise::Estimate => true,
        })
}

fn with_noise(file: &RobotFile, factor: f64) -> RobotFile {
    let mut file = file.clone();
    file.noise.position_m *= factor;
    file.noise.rotation_rad *= factor;
    let axes = file.measuring.axes.iter_mut().flatten();
    let all = file.measuring.noise.values_mut().chain(axes);
    all.for_each(|own| scaled(own, factor));
    file
}

fn with_drives(file: &RobotFile, factor: f64) -> RobotFile {
    let mut file = file.clone();
    let drives = file.measuring.drives.iter_mut();
    drives.for_each(|own| scaled(own, factor));
    file
}
