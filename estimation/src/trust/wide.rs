//! Tolerances of lengths so wide that they tell nothing of a machine, as those that are written in millimetres.

use tau_robot::robot::{Owner, Variant};

use crate::joint::judged::Deviation;
use crate::machine::Nominal;
use crate::numerics::distribution::exceeds_noise;
use crate::trust::NEARER;
use crate::trust::hypothesis::{Hypothesis, LENGTH, THOUSAND, is_stated};

/// Share of the links' length that no tolerance reaches: it would tell nothing of the machine.
const WIDEST: f64 = 0.1;

/// The widest tolerance of a dimension (m) that is stated; zero where none is. Those of effects only keep a fit from
/// wandering, and may be as wide as one likes.
pub(super) fn widest_m(variant: &Variant, nominal: &[Nominal]) -> f64 {
    let parameters = variant.parameters.iter().zip(nominal);
    parameters
        .filter(|(own, _)| own.unit == LENGTH && !matches!(own.owner, Owner::Effect(_)))
        .filter_map(|(parameter, nominal)| {
            nominal.tolerance.filter(|own| is_stated(parameter, *own))
        })
        .fold(0.0, f64::max)
}

/// Tolerances of lengths a thousand times narrower, where some are wider than those of a machine with links so long (m): all
/// of them, or, where the rest is in metres, those that no machine has.
pub(crate) fn narrower(variant: &Variant, nominal: &[Nominal], length_m: f64) -> Vec<Hypothesis> {
    let limit_m = WIDEST * length_m;
    if length_m <= 0.0 || widest_m(variant, nominal) <= limit_m {
        return vec![];
    }
    let of = |from_m| Hypothesis::Tolerances {
        factor: THOUSAND.recip(),
        lengths_only: true,
        from_m,
    };
    vec![of(0.0), of(limit_m)]
}

/// True if narrower tolerances are enough: residuals over the noise are about as small under them as under the `given` ones,
/// and parameters depart from nominal no further than chance lets them. Whoever states wide tolerances with caution has a
/// machine that departs further.
pub(crate) fn are_enough(residuals: f64, departures: &[Deviation], given: f64) -> bool {
    let squares: f64 = departures.iter().map(|own| own.tolerances.powi(2)).sum();
    let expected: f64 = departures.iter().map(|own| own.told).sum();
    let scale = residuals.max(1.0);
    residuals < NEARER * given.max(1.0) && !exceeds_noise(squares / scale.powi(2), expected)
}
