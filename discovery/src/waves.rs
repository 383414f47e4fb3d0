//! Sines and cosines of one argument as waves: amplitude, period and place of the crests.

use std::collections::BTreeMap;
use std::f64::consts::TAU;

use nalgebra::RowDVector;
use tau_codegen::language::Model;
use tau_codegen::language::model::{BinaryOperator, Effect, Formula, Function};

use super::results::{Motion, Quantity, Wave};

/// Every sine and cosine of one argument that parameters multiply in the same sum, where the argument is linear in one
/// quantity. `fitted` are the values of the parameters by name, each with its row of a root of the covariance.
pub(super) fn waves(
    model: &Model,
    effect: &Effect,
    fitted: &BTreeMap<&str, (f64, RowDVector<f64>)>,
) -> Vec<Wave> {
    let mut found = Vec::new();
    for term in &effect.terms {
        let mut addends = Vec::new();
        flatten(&term.formula, &mut addends);
        let swings: Vec<_> = addends.into_iter().filter_map(swing).collect();
        let of = |function: Function| swings.iter().filter(move |own| own.1 == function);
        for (sine, _, argument) in of(Function::Sin) {
            let cosine = of(Function::Cos).find(|other| other.2 == *argument);
            let parameters = cosine.map(|cosine| [*sine, cosine.0]);
            let motion = Motion::of(term.target, 0, effect.subject);
            found.extend(
                parameters.and_then(|own| wave(model, effect, fitted, own, argument, motion)),
            );
        }
    }
    found
}

fn wave(
    model: &Model,
    effect: &Effect,
    fitted: &BTreeMap<&str, (f64, RowDVector<f64>)>,
    parameters: [usize; 2],
    argument: &Formula,
    target: Motion,
) -> Option<Wave> {
    let described = parameters.map(|index| &effect.parameters[index]);
    let [(sine, of_sine), (cosine, of_cosine)] = [
        fitted.get(described[0].name.as_str())?,
        fitted.get(described[1].name.as_str())?,
    ];
    let amplitude = sine.hypot(*cosine);
    let mut read = argument.quantities();
    let readable = read.next()?;
    if read.any(|other| other != readable) {
        return None;
    }
    let at = |quantity: f64| {
        argument.value(&|part| match part {
            Formula::Parameter(index, _) => {
                let known = fitted.get(effect.parameters[*index].name.as_str());
                known.map(|known| known.0)
            }
            _ => Some(quantity),
        })
    };
    let (offset, slope) = (at(0.0)?, at(1.0)? - at(0.0)?);
    let off = |quantity: f64| Some((at(quantity)? - offset - slope * quantity).abs());
    let is_linear = off(-1.0)?.max(off(2.0)?) <= 1e-9 * slope.abs();
    let period = TAU / slope.abs();
    (is_linear && amplitude > 0.0).then(|| Wave {
        target,
        parameters: described.map(|parameter| parameter.name.clone()),
        amplitude,
        sigma: (of_sine * *sine + of_cosine * *cosine).norm() / amplitude,
        unit: described[0].dimension,
        against: Quantity::of(readable, model).of_drive(effect.subject.is_turned()),
        period,
        peak: ((sine.atan2(*cosine) - offset) / slope).rem_euclid(period),
    })
}

fn flatten<'a>(formula: &'a Formula, addends: &mut Vec<&'a Formula>) {
    match formula {
        Formula::Binary(BinaryOperator::Add, left, right) => {
            flatten(left, addends);
            flatten(right, addends);
        }
        other => addends.push(other),
    }
}

/// The parameter, the function and its argument of `parameter * sin(argument)`.
fn swing(formula: &Formula) -> Option<(usize, Function, &Formula)> {
    let Formula::Binary(BinaryOperator::Multiply, left, right) = formula else {
        return None;
    };
    match (&**left, &**right) {
        (Formula::Parameter(index, 0), Formula::Call(function, arguments))
        | (Formula::Call(function, arguments), Formula::Parameter(index, 0)) => {
            Some((*index, *function, arguments.first()?))
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_codegen::language::check_text;

    /// With a correlation, the error of the amplitude differs from that of independent errors: sine and cosine that err
    /// by the same amount turn a wave of phase 135° without changing its size.
    #[test]
    fn a_wave_has_the_amplitude_and_the_error_of_both_of_its_parts() {
        let model = check_text(
            "robot Machine {
                track one, two;
                cluster a on one { link l; }
                cluster b on two { link m, n, o, p, r; }
                effect hum on cart from source {
                    param in_phase, out_of_phase: length;
                    param a, b: length;
                    search pitch: length in 10 mm ..= 100 mm;
                    along += cos(2*pi*q(source)/pitch) * in_phase + out_of_phase * sin(2*pi*q(source)/pitch);
                    vertical += a * sin(q^2/(1 m)^2) + b * cos(q^2/(1 m)^2);
                }
                variant Full { arm full; tracks linear; }
            }",
        )
        .unwrap();
        let found = |in_phase: f64, out_of_phase: f64| {
            let estimate = |value, sigma| (value, RowDVector::from_element(1, sigma));
            let fitted = BTreeMap::from([
                ("in_phase", estimate(in_phase, 1e-6)),
                ("out_of_phase", estimate(out_of_phase, 1e-6)),
                ("a", estimate(1e-5, 0.0)),
                ("b", estimate(1e-5, 0.0)),
                ("pitch", estimate(0.05, 0.0)),
            ]);
            let mut found = waves(&model, &model.effects[0], &fitted);
            assert_eq!(found.len(), 1, "one is linear in what it follows");
            found.remove(0)
        };
        let wave = found(-3e-5, 4e-5);
        assert!((wave.amplitude - 5e-5).abs() < 1e-18 && (wave.period - 0.05).abs() < 1e-12);
        assert!((wave.sigma - 0.2e-6).abs() < 1e-18, "{}", wave.sigma);
        assert_eq!(wave.against.name, "q(source)");
        let at_peak = TAU * wave.peak / 0.05;
        let height = -3e-5 * at_peak.cos() + 4e-5 * at_peak.sin();
        assert!((height - 5e-5).abs() < 1e-15, "{height}");
        assert!(found(-4e-5, 4e-5).sigma < 1e-18);
    }
}
