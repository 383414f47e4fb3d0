//! Losses of a pose's residual, and what they cost and bring in standard deviations.
//!
//! The residuals of a pose, whitened together, have a norm d; a loss is a function of d over the scale of the noise, so
//! that a pose counts as a whole and not by closures. Its M-estimate solves Σ Jᵀ·w(d)·r = 0 (P. J. Huber and E. M.
//! Ronchetti, *Robust Statistics*, 2nd edition, 2009, chapters 7 and 8).

use statrs::distribution::{Chi, Continuous};

/// A loss that bounds the pull of outliers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Loss {
    /// Squares up to a threshold, beyond it the distance itself.
    Huber,
    /// The logarithm of a Cauchy density: far off, the pull falls with the distance.
    Cauchy,
    /// Tukey's bisquare: beyond a threshold there is no pull at all.
    Tukey,
}

/// Efficiency at normal noise that thresholds are chosen for: standard deviations 2.6 % larger than those of least
/// squares, the usual premium (Huber and Ronchetti, section 4.5).
const EFFICIENCY: f64 = 0.95;

impl Loss {
    /// As typed.
    pub fn name(self) -> &'static str {
        match self {
            Self::Huber => "huber",
            Self::Cauchy => "cauchy",
            Self::Tukey => "tukey",
        }
    }

    /// The loss of the solver for residuals that stand for themselves.
    pub(crate) fn of_single_residuals(self) -> tau_solver::Loss {
        let threshold = self.tuned(1).threshold;
        match self {
            Self::Huber => tau_solver::Loss::Huber(threshold),
            Self::Cauchy => tau_solver::Loss::Cauchy(threshold),
            Self::Tukey => tau_solver::Loss::Tukey(threshold),
        }
    }

    /// The loss for poses of so many residuals, with the threshold that makes it as efficient as it should be.
    pub(crate) fn tuned(self, residuals: usize) -> Tuned {
        let of = |threshold: f64| Tuned {
            loss: self,
            threshold,
            residuals: residuals.max(1) as f64,
        };
        let (mut low, mut high) = (0.1, 10.0 * (residuals.max(1) as f64).sqrt());
        let noise = normal_noise(residuals.max(1) as f64);
        for _ in 0..50 {
            let middle = f64::midpoint(low, high);
            if of(middle).variance_at(&noise) > EFFICIENCY.recip() {
                low = middle;
            } else {
                high = middle;
            }
        }
        of(high)
    }
}

/// A loss with its threshold.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tuned {
    loss: Loss,
    threshold: f64,
    residuals: f64,
}

impl Tuned {
    /// Weight of a pose whose residuals have the norm `d`, in units of the noise.
    pub(crate) fn weight(&self, d: f64) -> f64 {
        let ratio = d / self.threshold;
        match self.loss {
            Loss::Huber => ratio.max(1.0).recip(),
            Loss::Cauchy => (1.0 + ratio * ratio).recip(),
            Loss::Tukey => (1.0 - ratio * ratio).max(0.0).powi(2),
        }
    }

    /// Mean over the directions of a residual of the derivative of weight times residual: w + w′·d/m.
    fn slope(&self, d: f64) -> f64 {
        let ratio = d / self.threshold;
        let fall = match self.loss {
            Loss::Huber if ratio <= 1.0 => 0.0,
            Loss::Huber => -ratio.recip(),
            Loss::Cauchy => -2.0 * ratio * ratio / (1.0 + ratio * ratio).powi(2),
            Loss::Tukey => -4.0 * ratio * ratio * (1.0 - ratio * ratio).max(0.0),
        };
        self.weight(d) + fall / self.residuals
    }

    /// Variance of estimates over that of least squares where noise is normal: E\[w²d²\]/m over E\[w + w′d/m\]².
    fn variance_at_normal_noise(&self) -> f64 {
        self.variance_at(&normal_noise(self.residuals))
    }

    fn variance_at(&self, noise: &[(f64, f64)]) -> f64 {
        let (square, slope) = self.means_at(noise);
        square / (slope * slope)
    }

    /// Mean of the squares of weighted residuals where noise is normal, of variance one: E\[w²d²\]/m.
    pub(crate) fn square_at_normal_noise(&self) -> f64 {
        self.means_at(&normal_noise(self.residuals)).0
    }

    /// E\[w²d²\]/m and E\[w + w′d/m\] over norms of noise, each with its probability.
    fn means_at(&self, noise: &[(f64, f64)]) -> (f64, f64) {
        let (mut square, mut slope) = (0.0, 0.0);
        for &(d, share) in noise {
            square += share * (self.weight(d) * d).powi(2) / self.residuals;
            slope += share * self.slope(d);
        }
        (square, slope)
    }

    /// Variance of estimates over that of least squares at unit noise, from the norms of the poses' residuals: Huber's
    /// K²·Σ(wd)²/(n − p)/(mean slope)² with K = 1 + p/n·var(slope)/(mean slope)² (Huber and Ronchetti, section 7.6),
    /// and at least what it is at normal noise. Of all residuals, the fit absorbs so many.
    pub(crate) fn variance(&self, norms: &[f64], absorbed: f64) -> f64 {
        let count = norms.len() as f64;
        let rows = count * self.residuals;
        let squares: f64 = norms.iter().map(|&d| (self.weight(d) * d).powi(2)).sum();
        let slopes = || norms.iter().map(|&d| self.slope(d));
        let mean = slopes().sum::<f64>() / count;
        let spread = slopes().map(|slope| (slope - mean).powi(2)).sum::<f64>() / count;
        let correction = 1.0 + absorbed / rows * spread / (mean * mean);
        let found = correction.powi(2) * squares / (rows - absorbed).max(1.0) / (mean * mean);
        let least = self.variance_at_normal_noise();
        if found.is_finite() {
            found.max(least)
        } else {
            least
        }
    }
}

/// Norms of so many normal deviates, evenly spaced, with the probability of each; nothing for none.
fn normal_noise(residuals: f64) -> Vec<(f64, f64)> {
    /// Steps of the midpoint rule: the kinks of a loss leave an error of some 1e-5, while thresholds matter to a percent.
    const STEPS: usize = 2000;
    #[allow(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "a small count"
    )]
    let Ok(chi) = Chi::new(residuals as u64) else {
        return vec![];
    };
    let step = (residuals.sqrt() + 10.0) / STEPS as f64;
    let middles = (0..STEPS).map(|k| step * (k as f64 + 0.5));
    middles.map(|d| (d, chi.pdf(d) * step)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Thresholds for a single residual are the published ones: 1.345, 2.385 and 4.685 standard deviations.
    #[test]
    fn thresholds_are_those_of_the_literature() {
        for (loss, expected) in [
            (Loss::Huber, 1.345),
            (Loss::Cauchy, 2.385),
            (Loss::Tukey, 4.685),
        ] {
            let threshold = loss.tuned(1).threshold;
            assert!(
                (threshold / expected - 1.0).abs() < 1e-3,
                "{loss:?}: {threshold}"
            );
        }
    }

    /// The slope is the derivative, by differences, averaged over directions.
    #[test]
    fn slopes_are_derivatives() {
        for loss in [Loss::Huber, Loss::Cauchy, Loss::Tukey] {
            let tuned = loss.tuned(6);
            for d in [0.5, 2.0, 3.0, 5.0, 9.0] {
                let step = 1e-6;
                let along = ((d + step) * tuned.weight(d + step)
                    - (d - step) * tuned.weight(d - step))
                    / (2.0 * step);
                let mean = (along + 5.0 * tuned.weight(d)) / 6.0;
                assert!((tuned.slope(d) - mean).abs() < 1e-7, "{loss:?} at {d}");
            }
        }
    }
}
