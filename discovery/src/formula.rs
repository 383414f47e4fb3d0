//! Formulas of effects over many samples at once, with their derivatives by the effect's parameters.

use std::cell::RefCell;
use std::collections::BTreeMap;

use tau_codegen::language::model::{BinaryOperator, Effect, Formula, Function, Readable, Term};

/// A number for every sample, or the same for all.
#[derive(Debug, Clone)]
pub(super) enum Series {
    Same(f64),
    Each(Vec<f64>),
}

/// Values with derivatives by parameters, by index of the parameter's component in the effect; those
/// that are not there are zero.
#[derive(Debug, Clone)]
pub(super) struct Dual {
    value: Series,
    slopes: BTreeMap<usize, Series>,
}

/// Values of a readable quantity at every sample; an error says what the measurements lack.
pub(super) type Reader<'a> = dyn Fn(Readable) -> Result<Vec<f64>, &'static str> + 'a;

impl Series {
    #[cfg(test)]
    fn at(&self, sample: usize) -> f64 {
        match self {
            Self::Same(value) => *value,
            Self::Each(values) => values[sample],
        }
    }

    fn map(mut self, f: impl Fn(f64) -> f64) -> Self {
        match &mut self {
            Self::Same(value) => *value = f(*value),
            Self::Each(values) => values.iter_mut().for_each(|value| *value = f(*value)),
        }
        self
    }

    /// Sines and cosines of angles.
    fn sines_and_cosines(self) -> (Self, Self) {
        match self {
            Self::Same(angle) => {
                let (sine, cosine) = angle.sin_cos();
                (Self::Same(sine), Self::Same(cosine))
            }
            Self::Each(angles) => {
                let (sines, cosines) = angles.into_iter().map(f64::sin_cos).unzip();
                (Self::Each(sines), Self::Each(cosines))
            }
        }
    }

    fn zip(self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        match (self, other) {
            (series, Self::Same(b)) => series.map(|a| f(a, *b)),
            (Self::Same(a), Self::Each(b)) => Self::Each(b.iter().map(|&b| f(a, b)).collect()),
            (Self::Each(mut a), Self::Each(b)) => {
                a.iter_mut().zip(b).for_each(|(a, &b)| *a = f(*a, b));
                Self::Each(a)
            }
        }
    }
}

impl Dual {
    fn constant(value: f64) -> Self {
        Self {
            value: Series::Same(value),
            slopes: BTreeMap::new(),
        }
    }

    /// `f` of it, whose derivative is `slope`.
    fn apply(mut self, f: impl Fn(f64) -> f64, slope: impl Fn(f64) -> f64) -> Self {
        if !self.slopes.is_empty() {
            self.scale(&self.value.clone().map(slope));
        }
        Self {
            value: self.value.map(f),
            ..self
        }
    }

    /// Multiplies the derivatives alone.
    fn scale(&mut self, factor: &Series) {
        for slope in self.slopes.values_mut() {
            let own = std::mem::replace(slope, Series::Same(0.0));
            *slope = own.zip(factor, |a, b| a * b);
        }
    }

    /// Adds derivatives.
    fn take_in(&mut self, slopes: BTreeMap<usize, Series>) {
        for (parameter, slope) in slopes {
            let sum = match self.slopes.remove(&parameter) {
                Some(known) => known.zip(&slope, |a, b| a + b),
                None => slope,
            };
            self.slopes.insert(parameter, sum);
        }
    }

    /// A function of two, with its derivatives by each.
    fn combine(
        mut self,
        mut other: Self,
        f: impl Fn(f64, f64) -> f64,
        left: impl Fn(f64, f64) -> f64,
        right: impl Fn(f64, f64) -> f64,
    ) -> Self {
        if !self.slopes.is_empty() {
            self.scale(&self.value.clone().zip(&other.value, left));
        }
        if !other.slopes.is_empty() {
            other.scale(&self.value.clone().zip(&other.value, right));
        }
        self.take_in(other.slopes);
        Self {
            value: self.value.zip(&other.value, f),
            ..self
        }
    }

    fn plus(mut self, other: Self) -> Self {
        self.take_in(other.slopes);
        Self {
            value: self.value.zip(&other.value, |a, b| a + b),
            ..self
        }
    }

    fn times(mut self, mut other: Self) -> Self {
        self.scale(&other.value);
        other.scale(&self.value);
        self.take_in(other.slopes);
        Self {
            value: self.value.zip(&other.value, |a, b| a * b),
            ..self
        }
    }
}

/// An effect at given values of its parameters, ready to be evaluated.
pub(super) struct Formulas<'a> {
    values: &'a [f64],
    starts: Vec<usize>,
    /// Indices of the components that derivatives are taken by.
    wanted: &'a [usize],
    /// Sines (true) and cosines at angles of which a term has asked for the other: one costs little beside the other.
    waves: RefCell<Vec<(bool, Formula, Series)>>,
}

impl<'a> Formulas<'a> {
    /// `values` holds one number per component of each parameter, in order; `wanted` are the indices of those
    /// that derivatives are taken by.
    pub(super) fn new(effect: &Effect, values: &'a [f64], wanted: &'a [usize]) -> Self {
        let mut start = 0;
        let starts = effect
            .parameters
            .iter()
            .map(|parameter| {
                start += parameter.components;
                start - parameter.components
            })
            .collect();
        Self {
            values,
            starts,
            wanted,
            waves: RefCell::default(),
        }
    }

    /// True if all terms of an effect are zero, whatever they read.
    pub(super) fn vanish(&self, effect: &Effect) -> bool {
        // Numbers that no formula singles out.
        let reader = |_: Readable| Ok(vec![0.3719, 0.8171, 1.4387, 31.7]);
        let is_zero = |value: Series| match value {
            Series::Same(value) => value == 0.0,
            Series::Each(values) => values.iter().all(|&value| value == 0.0),
        };
        effect.terms.iter().all(|term| {
            let mut components = components_of(term).iter();
            components.all(|component| {
                let dual = self.dual(component, &reader);
                dual.is_ok_and(|dual| is_zero(dual.value))
            })
        })
    }

    /// True if a term has any of the wanted derivatives.
    pub(super) fn concern(&self, term: &Term) -> bool {
        term.formula.parts().any(|part| match part {
            Formula::Parameter(index, component) => {
                self.wanted.contains(&(self.starts[*index] + component))
            }
            _ => false,
        })
    }

    /// A formula with the wanted parameters counted in their order, and the values of all others.
    pub(super) fn form(&self, formula: &Formula) -> Formula {
        let form = |part: &Formula| Box::new(self.form(part));
        match formula {
            Formula::Number(_) | Formula::Read(_) | Formula::OfRobot(..) | Formula::OfLink(..) => {
                formula.clone()
            }
            Formula::Parameter(index, component) => {
                let place = self.starts[*index] + component;
                let wanted = self.wanted.iter().position(|&wanted| wanted == place);
                wanted.map_or(Formula::Number(self.values[place]), |wanted| {
                    Formula::Parameter(wanted, 0)
                })
            }
            Formula::Negate(a) => Formula::Negate(form(a)),
            Formula::Power(a, n) => Formula::Power(form(a), *n),
            Formula::Binary(operator, a, b) => Formula::Binary(*operator, form(a), form(b)),
            Formula::Call(function, parts) => Formula::Call(
                *function,
                parts.iter().map(|part| self.form(part)).collect(),
            ),
            Formula::Vector(parts) => {
                Formula::Vector(Box::new(parts.each_ref().map(|part| self.form(part))))
            }
        }
    }

    /// The derivatives of a term by the parameters: one entry per component of the target (one, or
    /// three for a vector), each from parameter index to its derivative at every sample.
    pub(super) fn slopes(
        &self,
        term: &Term,
        reader: &Reader<'_>,
    ) -> Result<Vec<BTreeMap<usize, Series>>, &'static str> {
        // At other places the same angle reads other numbers.
        self.waves.borrow_mut().clear();
        components_of(term)
            .iter()
            .map(|component| Ok(self.dual(component, reader)?.slopes))
            .collect()
    }

    fn dual(&self, formula: &Formula, reader: &Reader<'_>) -> Result<Dual, &'static str> {
        Ok(match formula {
            Formula::Number(value) => Dual::constant(*value),
            Formula::Parameter(index, component) => {
                let place = self.starts[*index] + component;
                let mut dual = Dual::constant(self.values[place]);
                if self.wanted.contains(&place) {
                    dual.slopes.insert(place, Series::Same(1.0));
                }
                dual
            }
            Formula::Read(readable) => Dual {
                value: Series::Each(reader(*readable)?),
                slopes: BTreeMap::new(),
            },
            Formula::Negate(a) => self.dual(a, reader)?.apply(|a| -a, |_| -1.0),
            Formula::Binary(operator, a, b) => {
                let (a, b) = (self.dual(a, reader)?, self.dual(b, reader)?);
                match operator {
                    BinaryOperator::Add => a.plus(b),
                    BinaryOperator::Subtract => a.plus(b.apply(|b| -b, |_| -1.0)),
                    BinaryOperator::Multiply => a.times(b),
                    BinaryOperator::Divide => {
                        a.combine(b, |a, b| a / b, |_, b| b.recip(), |a, b| -a / (b * b))
                    }
                }
            }
            Formula::Power(a, n) => self
                .dual(a, reader)?
                .apply(|a| a.powi(*n), |a| f64::from(*n) * a.powi(*n - 1)),
            Formula::Call(function, arguments) => match (function, arguments.as_slice()) {
                (Function::Sin | Function::Cos, [angle]) => {
                    self.wave(*function == Function::Sin, angle, reader)?
                }
                (function, arguments) => {
                    let arguments = arguments.iter().map(|argument| self.dual(argument, reader));
                    call(*function, arguments.collect::<Result<Vec<_>, _>>()?)
                }
            },
            // The checker resolves vectors into components and refuses values of links; what is left has no value.
            Formula::Vector(_) | Formula::OfRobot(..) | Formula::OfLink(..) => {
                Dual::constant(f64::NAN)
            }
        })
    }

    /// A sine, or a cosine.
    fn wave(
        &self,
        is_sine: bool,
        angle: &Formula,
        reader: &Reader<'_>,
    ) -> Result<Dual, &'static str> {
        let mut waves = self.waves.borrow_mut();
        let is_known = |(sine, of, _): &(bool, Formula, Series)| *sine == is_sine && of == angle;
        if let Some(known) = waves.iter().position(is_known) {
            return Ok(Dual {
                value: waves.swap_remove(known).2,
                slopes: BTreeMap::new(),
            });
        }
        drop(waves);
        let dual = self.dual(angle, reader)?;
        if !dual.slopes.is_empty() {
            let function = if is_sine {
                Function::Sin
            } else {
                Function::Cos
            };
            return Ok(call(function, vec![dual]));
        }
        let (sines, cosines) = dual.value.sines_and_cosines();
        let (value, other) = if is_sine {
            (sines, cosines)
        } else {
            (cosines, sines)
        };
        let other = (!is_sine, angle.clone(), other);
        self.waves.borrow_mut().push(other);
        Ok(Dual {
            value,
            slopes: BTreeMap::new(),
        })
    }
}

/// Formulas of a term, one for each component of its target.
fn components_of(term: &Term) -> &[Formula] {
    match &term.formula {
        Formula::Vector(components) => &components[..],
        scalar => std::slice::from_ref(scalar),
    }
}

fn call(function: Function, mut arguments: Vec<Dual>) -> Dual {
    let below = |a: f64, b: f64| if a < b { 1.0 } else { 0.0 };
    let b = (arguments.len() > 1).then(|| arguments.remove(1));
    let (a, b) = match (arguments.pop(), b) {
        (Some(a), Some(b)) => (a, b),
        (Some(a), None) => (a, Dual::constant(f64::NAN)),
        // The checker counts arguments.
        (None, _) => return Dual::constant(f64::NAN),
    };
    match function {
        Function::Sin => a.apply(f64::sin, f64::cos),
        Function::Cos => a.apply(f64::cos, |a| -a.sin()),
        Function::Tan => a.apply(f64::tan, |a| 1.0 + a.tan().powi(2)),
        Function::Atan => a.apply(f64::atan, |a| 1.0 / (1.0 + a * a)),
        Function::Exp => a.apply(f64::exp, f64::exp),
        Function::Ln => a.apply(f64::ln, f64::recip),
        Function::Tanh => a.apply(f64::tanh, |a| 1.0 - a.tanh().powi(2)),
        Function::Sqrt => a.apply(f64::sqrt, |a| 0.5 / a.sqrt()),
        Function::Abs => a.apply(f64::abs, |a| if a < 0.0 { -1.0 } else { 1.0 }),
        Function::Sign => a.apply(|a| if a < 0.0 { -1.0 } else { 1.0 }, |_| 0.0),
        // Where both are equal the derivative is that of the first, as in compiled code.
        Function::Min => a.combine(b, f64::min, |a, b| 1.0 - below(b, a), |a, b| below(b, a)),
        Function::Max => a.combine(b, f64::max, |a, b| 1.0 - below(a, b), below),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_codegen::language::{check_text, effects_from_text};

    use tau_robot::Robot;
    use tau_robot::robot::{Input, Owner, ResidualKind};

    fn effect(text: &str) -> Effect {
        let model = check_text(
            "robot Slide { track one; cluster a on one { link l; } variant N { arm reduced; tracks linear; } }",
        );
        let model = effects_from_text(text, &model.unwrap()).unwrap();
        model.effects[0].clone()
    }

    /// Waves that share an angle, in whichever order, one that has an angle of its own, and ones whose partner is in
    /// another term: at three carts, each with commands of its own.
    #[test]
    fn waves_of_one_angle_are_its_sine_and_cosine() {
        let effect = effect(
            "effect waves on cart {
            param a, b: length;
            param c: number;
            along += a * sin(c * q / (1 m)) + b * cos(c * q / (1 m));
            along += a * cos(c * q / (1 m)) + b * sin(2 * c * q / (1 m)) + b * sin(c * q / (1 m));
            along += a * sin(3 * c * q / (1 m)) + b;
            along += a * cos(3 * c * q / (1 m)) + b;
        }",
        );
        let carts = [vec![-0.4, 0.3, 1.1], vec![0.2, 0.7], vec![-0.9]];
        let c = 1.7;
        let expected = |q: f64| {
            let (sine, cosine) = (c * q).sin_cos();
            [
                [sine, cosine],
                [cosine, (2.0 * c * q).sin() + sine],
                [(3.0 * c * q).sin(), 1.0],
                [(3.0 * c * q).cos(), 1.0],
            ]
        };
        let (values, wanted) = ([0.0, 0.0, c], [0, 1]);
        let formulas = Formulas::new(&effect, &values, &wanted);
        for (k, term) in effect.terms.iter().enumerate() {
            for commands in &carts {
                let reader = |_: Readable| Ok(commands.clone());
                let slopes = formulas.slopes(term, &reader).unwrap();
                for parameter in wanted {
                    for (sample, &q) in commands.iter().enumerate() {
                        let off = slopes[0][&parameter].at(sample) - expected(q)[k][parameter];
                        assert!(off.abs() < 1e-14, "term {k}, parameter {parameter}: {off}");
                    }
                }
            }
        }
    }

    /// Slopes agree with central differences, for every function and operator.
    #[test]
    fn slopes_are_those_of_small_steps() {
        let text = "effect everything on cart {
            param a, b: length;
            param c: number;
            along += a * sin(c * q / (1 m)) + b * cos(c) / (2 + tanh(c)) - sqrt(a^2 + b^2) * exp(-c);
            along += max(a, b * q / (1 m)) + abs(a - b) * atan(c) / (1 rad) + a * ln(3 + c) * tan(c / 5) - min(a, b);
        }";
        let effect = &effect(text);
        let q = vec![-0.4, 0.3, 1.1];
        let reader = |_: Readable| Ok(q.clone());
        let values = [0.7, -0.3, 0.9];
        for term in &effect.terms {
            let slopes = Formulas::new(effect, &values, &[0, 1, 2])
                .slopes(term, &reader)
                .unwrap();
            for parameter in 0..3 {
                let value = |step: f64| {
                    let mut moved = values;
                    moved[parameter] += step;
                    let formulas = Formulas::new(effect, &moved, &[0, 1, 2]);
                    formulas.dual(&term.formula, &reader).unwrap().value
                };
                let (up, down) = (value(1e-6), value(-1e-6));
                for sample in 0..3 {
                    let expected = (up.at(sample) - down.at(sample)) / 2e-6;
                    let found = slopes[0]
                        .get(&parameter)
                        .map_or(0.0, |slope| slope.at(sample));
                    assert!(
                        (found - expected).abs() < 1e-8,
                        "{parameter}: {found} {expected}"
                    );
                }
            }
        }
    }

    /// At zero amplitudes every sample is a tie. The closure's derivatives are those of the cart's displacement
    /// times one factor, which that by `c` gives.
    #[test]
    fn ties_fall_to_the_side_that_compiled_code_takes() {
        let text = "robot Slide { track one; cluster arm on one { link l; }
            effect tied on cart {
                param a, b, c, d, e, f: number;
                along += min(a*q, b*q) + max(d*q, e*q) + abs(f*q) + c*q;
            }
            variant Nominal { arm reduced; tracks linear; }
            variant Tied = Nominal + tied(one); }";
        let model = check_text(text).unwrap();
        let robot = Robot::from_text(text).unwrap();
        let variant = &robot.variants[1];
        let closure = variant.instances_of(ResidualKind::Closure).next().unwrap();
        let family = &closure.family;
        let (shape, pattern) = (family.shape(), family.pattern());
        let q = 0.7;
        let data: Vec<f64> = (closure.inputs.iter())
            .map(|input| if *input == Input::Command(0) { q } else { 0.4 })
            .collect();
        let parameters: Vec<f64> = (closure.parameters.iter())
            .map(|&index| match variant.parameters[index].owner {
                Owner::Effect(_) => 0.0,
                _ => 0.9,
            })
            .collect();
        let mut prepared = vec![0.0; shape.prepared];
        family.prepare(&data, &mut prepared);
        let (mut residuals, mut jacobian) = (vec![0.0], vec![0.0; pattern.len()]);
        family.linearize(&prepared, &parameters, &mut residuals, &mut jacobian);
        let compiled = |name: &str| {
            let is_own = |&index: &usize| variant.parameters[index].quantity == name;
            let column = closure.parameters.iter().position(is_own).unwrap();
            let entry = (pattern.columns.iter()).position(|&own| own as usize == column);
            entry.map_or(0.0, |entry| jacobian[entry])
        };

        let effect = &model.effects[0];
        let wanted = [0, 1, 2, 3, 4, 5];
        let slopes = Formulas::new(effect, &[0.0; 6], &wanted)
            .slopes(&effect.terms[0], &|_| Ok(vec![q]))
            .unwrap();
        let slope = |place: usize| slopes[0].get(&place).map_or(0.0, |slope| slope.at(0));
        assert!(slope(2) == q && compiled("c") != 0.0);
        for (place, name) in ["a", "b", "c", "d", "e", "f"].into_iter().enumerate() {
            assert_eq!(
                slope(place) * compiled("c"),
                compiled(name) * slope(2),
                "{name}"
            );
        }
    }
}
