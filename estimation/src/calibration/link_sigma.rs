//! Standard deviations of the values of a link: those of its parameters, and of what follows from parameters by a formula.

use tau_kinematics::Machine;
use tau_robot::robot::{Instance, Owner, Value};

/// Standard deviations of a row of Table II, of values that follow from formulas those of the parameters in these; zero for
/// what is not calibrated.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct LinkSigma {
    /// Of the length (m).
    pub length_m: f64,
    /// Of the plate joint (m).
    pub plate_joint_m: [f64; 3],
    /// Of the track offset (m).
    pub track_offset_m: [f64; 3],
    /// Of the track's direction, or of its rotation (rad).
    pub track: [f64; 3],
}

/// Values of a link: length, plate joint, track offset, direction or rotation of the track.
const VALUES: usize = 10;

/// Covariance and priors of the calibrated parameters.
pub(super) struct Knowledge<'a> {
    /// Indices of the calibrated ones in the variant.
    pub(super) used: &'a [usize],
    /// Their covariance.
    pub(super) covariance: &'a [Vec<f64>],
    /// Mean squares of their errors of second order, which go together with nothing.
    pub(super) second_order: &'a [f64],
    /// Standard deviations of their priors; infinite where there is none.
    pub(super) priors: &'a [f64],
}

impl Knowledge<'_> {
    /// Standard deviations of the values of a closure's link, and those that the priors alone give them.
    pub(super) fn of_link(&self, machine: &Machine, closure: &Instance) -> [LinkSigma; 2] {
        let gradients = self.gradients(machine, closure);
        [
            of_values(gradients.each_ref().map(|own| self.sigma(own))),
            of_values(gradients.each_ref().map(|own| self.prior(own))),
        ]
    }

    fn sigma(&self, gradient: &[f64]) -> f64 {
        let terms = || gradient.iter().enumerate().filter(|(_, by)| **by != 0.0);
        let variance = terms().map(|(k, by)| {
            let with_others = terms().map(|(other, with)| with * self.covariance[k][other]);
            by * (with_others.sum::<f64>() + by * self.second_order[k])
        });
        variance.sum::<f64>().max(0.0).sqrt()
    }

    fn prior(&self, gradient: &[f64]) -> f64 {
        let terms = gradient.iter().zip(self.priors);
        let terms = terms.filter(|(by, _)| **by != 0.0);
        let squares = terms.map(|(by, prior)| (by * prior).powi(2));
        squares.sum::<f64>().sqrt()
    }

    /// Derivatives of the values of a closure's link by the calibrated parameters: one by a parameter that is the value itself,
    /// of others quotients of central differences.
    fn gradients(&self, machine: &Machine, closure: &Instance) -> [Vec<f64>; VALUES] {
        // About the cube root of the rounding, where this does as much as terms of third order.
        const STEP: f64 = 1e-5;
        // Slopes below are rounding of the quotient, or of the formula, as that of `r * cos(90 deg)` by `r`.
        const LEAST: f64 = 1e-10;
        let own = own_parameters(machine, closure);
        let mut gradients = std::array::from_fn(|_| vec![0.0; self.used.len()]);
        let mut moved = machine.clone();
        for (place, &index) in self.used.iter().enumerate() {
            if !closure.parameters.contains(&index) {
                continue;
            }
            let value = machine.values[index];
            let step = STEP * value.abs().max(1.0);
            let [high, low] = [value + step, value - step].map(|at| {
                moved.values[index] = at;
                described(&moved, closure)
            });
            moved.values[index] = value;
            for (k, gradient) in gradients.iter_mut().enumerate() {
                let slope = (high[k] - low[k]) / (2.0 * step);
                gradient[place] = match own[k] {
                    Some(own) => f64::from(own == index),
                    // Values that the link does not have are no numbers, and no slope of theirs exceeds any.
                    None if slope.abs() > LEAST => slope,
                    None => 0.0,
                };
            }
        }
        gradients
    }
}

fn of_values(sigmas: [f64; VALUES]) -> LinkSigma {
    let three = |first: usize| [0, 1, 2].map(|k| sigmas[first + k]);
    LinkSigma {
        length_m: sigmas[0],
        plate_joint_m: three(1),
        track_offset_m: three(4),
        track: three(7),
    }
}

/// Parameters that are values of a closure's link themselves.
fn own_parameters(machine: &Machine, closure: &Instance) -> [Option<usize>; VALUES] {
    let own = |quantity: &str, component: Option<usize>| {
        own_parameter(machine, closure, component, |own| own == quantity)
    };
    std::array::from_fn(|k| match k.checked_sub(1) {
        None => own("length", None),
        Some(k) => match (k / 3, Some(k % 3)) {
            (0, axis) => own("plate_joint", axis),
            (1, axis) => own("track_offset", axis),
            (_, axis) => own("track_direction", axis).or_else(|| own("track_rotation", axis)),
        },
    })
}

/// Values of a closure's link as formulas have them; not a number where it has none.
fn described(machine: &Machine, closure: &Instance) -> [f64; VALUES] {
    let vectors = [Value::PlateJoint, Value::TrackOffset, Value::TrackDirection];
    let vectors = vectors.map(|value| {
        let own = machine.described(closure, value);
        own.unwrap_or([f64::NAN; 3])
    });
    let length_m = machine.length_m(closure, &[]);
    std::array::from_fn(|k| match k.checked_sub(1) {
        None => length_m,
        Some(k) => vectors[k / 3][k % 3],
    })
}

/// A parameter, of a quantity that is wanted, of the link, cluster or track that a closure belongs to: its index in the
/// variant.
pub(crate) fn own_parameter(
    machine: &Machine,
    closure: &Instance,
    component: Option<usize>,
    is_wanted: impl Fn(&str) -> bool,
) -> Option<usize> {
    let is_own = |owner: Owner| match owner {
        Owner::Link(index) | Owner::Cluster(index) => index == closure.of,
        Owner::Track(_) => true,
        Owner::Crank(_)
        | Owner::Robot
        | Owner::Effect(_)
        | Owner::Frame(_)
        | Owner::Target { .. } => false,
    };
    closure.parameters.iter().copied().find(|&index| {
        let parameter = &machine.variant.parameters[index];
        is_wanted(&parameter.quantity)
            && parameter.component == component
            && is_own(parameter.owner)
    })
}
