//! Noise that is stated a thousand times too large or too small, where poses are unknown.

use tau_robot::robot_file::{RobotFile, StatedNoise};

use super::UnknownPoses;
use super::recognised::{Case, is_plausible};
use crate::numerics::distribution::chi2_survival;
use crate::trust::hypothesis::THOUSAND;
use crate::trust::recognise::{CAUTIOUS, POSES, STATED};
use crate::trust::{LEVEL, Mistake, words};

impl Case<'_> {
    /// Noise of the measurements, or of the drives, that is stated a thousand times too large or too small: residuals are far
    /// from it, by more than chance, and within a factor of two of a thousandth or a thousand times it.
    pub(super) fn wrong_noise(&self, given: &UnknownPoses) -> Option<Mistake> {
        let thinned = self.division.thinned(self.folder, POSES);
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            ..*self
        };
        let ratio = given.residual_over_noise();
        let is_by_chance = chi2_survival(given.chi2, given.dof) < 1.0 - LEVEL;
        let factor = if ratio < CAUTIOUS.recip() && !is_by_chance {
            THOUSAND.recip()
        } else if ratio > THOUSAND.sqrt() {
            THOUSAND
        } else {
            return None;
        };
        let is_mended = |file: &RobotFile| {
            case.fitted(file, self.folder, None).is_ok_and(|found| {
                found.residual_over_noise().ln().abs() < STATED.ln() && is_plausible(&found)
            })
        };
        let own = "of the measurements (`[noise]`)";
        let whose = if is_mended(&with_noise(self.file, factor)) {
            own
        } else if !self.file.measuring.drives.is_empty()
            && is_mended(&with_drives(self.file, factor))
        {
            "of the drives (`[drives]`)"
        } else {
            return None;
        };
        Some(words::of_noise(whose, factor))
    }
}

fn scaled(noise: &mut StatedNoise, factor: f64) {
    if let StatedNoise::Known(sigma) = noise {
        *sigma *= factor;
    }
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
