//! Squares of fits under several hypotheses, made comparable.

use super::trials::{Dimensions, Trial};
use super::{KindFit, UnknownPoses};
use crate::trust::ODDS;

impl Dimensions {
    /// The parameter that a trial sets free, for links so long (m).
    pub(super) fn freed(&self, trial: &Trial<'_>) -> Option<(usize, f64)> {
        trial.freed().map(|parameter| (parameter, self.length_m))
    }

    /// The price of a parameter's room: −2 ln of the evidence beside squares, in units of these, by Laplace's
    /// approximation, the choice of one of so many parameters included. `None` where the fit as given is about as likely, or
    /// the parameter keeps its tolerance.
    pub(super) fn room(
        &self,
        parameter: usize,
        freed: &UnknownPoses,
        given: Option<&UnknownPoses>,
    ) -> Option<f64> {
        let stated = &self.nominal[parameter];
        let own = &freed.calibration;
        let name = &own.machine.variant.parameters[parameter].name;
        let estimate = own.parameters.iter().find(|own| own.name == *name)?;
        let (tolerance, room) = (stated.sigma()?, estimate.tolerance?);
        // Knowledge of it, freed and as stated.
        let known = estimate.sigma.powi(-2);
        let held = known - room.powi(-2) + tolerance.powi(-2);
        let volumes = (room.powi(2) * known / (tolerance.powi(2) * held)).ln();
        let choice = 2.0 * (self.nominal.len() as f64).ln();
        let pays = scale(freed) * (volumes + choice);
        let decisive = scale(freed) * 2.0 * ODDS.ln();
        let is_likelier = given.is_none_or(|given| total(given) - total(freed) - pays > decisive);
        (is_likelier && stated.tolerances_to(estimate.value).abs() > 1.0).then_some(pays)
    }
}

/// Squares count by what a fit leaves of them.
pub(super) fn scale(found: &UnknownPoses) -> f64 {
    found.residual_over_noise().max(1.0).powi(2)
}

/// The squares of residuals and tolerances.
pub(super) fn total(found: &UnknownPoses) -> f64 {
    total_beside(found, found)
}

/// The same where noise that is estimated is that of another fit.
pub(super) fn total_beside(found: &UnknownPoses, other: &UnknownPoses) -> f64 {
    let pulls = found.pulls().map(|pull| pull.tolerances.powi(2));
    squares_beside(found, other) + pulls.sum::<f64>()
}

/// Residuals over the noise, that which is estimated being that of another fit: by its own, all fits are alike.
pub(super) fn misfit(found: &UnknownPoses, other: &UnknownPoses) -> f64 {
    (squares_beside(found, other) / found.dof.max(1e-9)).sqrt()
}

fn squares_beside(found: &UnknownPoses, other: &UnknownPoses) -> f64 {
    let pairs = found.kinds.iter().zip(&other.kinds);
    let pairs = pairs.filter(|(own, _)| !own.kind.is_of_carts());
    let ratio = |own: &KindFit, other: &KindFit| {
        if own.kind.is_estimated() {
            own.kind.sigma / other.kind.sigma
        } else {
            1.0
        }
    };
    pairs
        .map(|(own, other)| own.chi2() * ratio(own, other).powi(2))
        .sum()
}

pub(super) fn has_estimated_noise(found: &UnknownPoses) -> bool {
    found.kinds.iter().any(|fit| fit.kind.is_estimated())
}
