//! Noise that is stated a thousand times too large or too small, where poses are unknown.

use tau_robot::robot_file::{RobotFile, StatedNoise};

use super::UnknownPoses;
use super::recognised::{Case, Squares, is_plausible};
use crate::numerics::distribution::chi2_survival;
use crate::trust::hypothesis::THOUSAND;
use crate::trust::recognise::{POSES, STATED};
use crate::trust::{LEVEL, Mistake, NEARER, words};

impl Case<'_> {
    /// Noise of the measurements, or of the drives, that is stated a thousand times too large or too small: residuals are far
    /// from it, by more than chance, and by no more than chance beyond a factor of two about a thousandth or a thousand times it.
    pub(super) fn wrong_noise(&self, given: &UnknownPoses) -> Option<Mistake> {
        let thinned = self.division.thinned(self.folder, POSES);
        let case = Case {
            division: thinned.as_ref().unwrap_or(self.division),
            ..*self
        };
        let ratio = given.residual_over_noise();
        let chance = chi2_survival(given.chi2, given.dof);
        // Tolerances may hold a fit back at noise so large, so that it leaves much of what is stated.
        if ratio.ln().abs() < NEARER.ln() || (LEVEL..1.0 - LEVEL).contains(&chance) {
            return None;
        }
        let factor = if ratio < 1.0 {
            THOUSAND.recip()
        } else {
            THOUSAND
        };
        // Few residuals scatter by more than that factor themselves.
        let is_noise = |found: &UnknownPoses| {
            let chance = |factor: f64| chi2_survival(found.chi2 * factor.powi(2), found.dof);
            chance(STATED.recip()) > LEVEL && chance(STATED) < 1.0 - LEVEL
        };
        let few = case.few();
        let is_mended = |file: &RobotFile| {
            // More steps leave less, at which noise is too large already.
            let look = Case { file, ..case };
            let left = look.cost(self.folder, &few, None);
            let least = (STATED * NEARER).powi(-2);
            let is_less =
                |left: Squares| chi2_survival(left.sum / least, left.expected) > 1.0 - LEVEL;
            if left.is_some_and(is_less) {
                return false;
            }
            case.fitted(file, self.folder, None)
                .is_ok_and(|found| is_noise(&found) && is_plausible(&found))
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
