//! Formulas of effects over many samples at once, with their derivatives by the effect's parameters.

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

/// What formulas read, at every sample; an error says what the measurements lack.
pub(super) type Reader<'a> = dyn Fn(Readable) -> Result<Vec<f64>, &'static str> + 'a;

impl Series {
    pub(super) fn at(&self, sample: usize) -> f64 {
        match self {
            Self::Same(value) => *value,
            Self::Each(values) => values[sample],
        }
    }

    fn map(&self, f: impl Fn(f64) -> f64) -> Self {
        match self {
            Self::Same(value) => Self::Same(f(*value)),
            Self::Each(values) => Self::Each(values.iter().map(|&value| f(value)).collect()),
        }
    }

    fn zip(&self, other: &Self, f: impl Fn(f64, f64) -> f64) -> Self {
        match (self, other) {
            (Self::Same(a), Self::Same(b)) => Self::Same(f(*a, *b)),
            (Self::Same(a), Self::Each(b)) => Self::Each(b.iter().map(|&b| f(*a, b)).collect()),
            (Self::Each(a), Self::Same(b)) => Self::Each(a.iter().map(|&a| f(a, *b)).collect()),
            (Self::Each(a), Self::Each(b)) => {
                Self::Each(a.iter().zip(b).map(|(&a, &b)| f(a, b)).collect())
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
    fn apply(&self, f: impl Fn(f64) -> f64, slope: impl Fn(f64) -> f64) -> Self {
        let slopes = if self.slopes.is_empty() {
            BTreeMap::new()
        } else {
            let outer = self.value.map(slope);
            self.slopes
                .iter()
                .map(|(&p, inner)| (p, inner.zip(&outer, |a, b| a * b)))
                .collect()
        };
        Self {
            value: self.value.map(f),
            slopes,
        }
    }

    /// A function of two, with its derivatives by each.
    fn combine(
        &self,
        other: &Self,
        f: impl Fn(f64, f64) -> f64,
        left: impl Fn(f64, f64) -> f64,
        right: impl Fn(f64, f64) -> f64,
    ) -> Self {
        let mut slopes: BTreeMap<usize, Series> = BTreeMap::new();
        for (inner, outer) in [
            (
                &self.slopes,
                (!self.slopes.is_empty()).then(|| self.value.zip(&other.value, left)),
            ),
            (
                &other.slopes,
                (!other.slopes.is_empty()).then(|| self.value.zip(&other.value, right)),
            ),
        ] {
            let Some(outer) = outer else { continue };
            for (&p, slope) in inner {
                let part = slope.zip(&outer, |a, b| a * b);
                let sum = slopes.get(&p).map(|known| known.zip(&part, |a, b| a + b));
                slopes.insert(p, sum.unwrap_or(part));
            }
        }
        Self {
            value: self.value.zip(&other.value, f),
            slopes,
        }
    }
}

/// An effect at given values of its parameters, ready to be evaluated.
pub(super) struct Formulas<'a> {
    values: &'a [f64],
    starts: Vec<usize>,
    /// The component that no derivatives are taken by.
    fixed: Option<usize>,
}

impl<'a> Formulas<'a> {
    /// `values` holds one number per component of each parameter, in order.
    pub(super) fn new(effect: &Effect, values: &'a [f64]) -> Self {
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
            fixed: None,
        }
    }

    /// Without derivatives by a component, which save half of what waves cost.
    pub(super) fn fixing(self, fixed: Option<usize>) -> Self {
        Self { fixed, ..self }
    }

    /// The derivatives of a term by the parameters: one entry per component of the target (one, or
    /// three for a vector), each from parameter index to its derivative at every sample.
    pub(super) fn slopes(
        &self,
        term: &Term,
        reader: &Reader<'_>,
    ) -> Result<Vec<BTreeMap<usize, Series>>, &'static str> {
        let components: &[Formula] = match &term.formula {
            Formula::Vector(components) => &components[..],
            scalar => std::slice::from_ref(scalar),
        };
        components
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
                if self.fixed != Some(place) {
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
                    BinaryOperator::Add => a.combine(&b, |a, b| a + b, |_, _| 1.0, |_, _| 1.0),
                    BinaryOperator::Subtract => {
                        a.combine(&b, |a, b| a - b, |_, _| 1.0, |_, _| -1.0)
                    }
                    BinaryOperator::Multiply => a.combine(&b, |a, b| a * b, |_, b| b, |a, _| a),
                    BinaryOperator::Divide => {
                        a.combine(&b, |a, b| a / b, |_, b| b.recip(), |a, b| -a / (b * b))
                    }
                }
            }
            Formula::Power(a, n) => self
                .dual(a, reader)?
                .apply(|a| a.powi(*n), |a| f64::from(*n) * a.powi(*n - 1)),
            Formula::Call(function, arguments) => {
                let arguments = arguments
                    .iter()
                    .map(|argument| self.dual(argument, reader))
                    .collect::<Result<Vec<_>, _>>()?;
                call(*function, &arguments)
            }
            // The checker resolves vectors into components; what is left has no value.
            Formula::Vector(_) => Dual::constant(f64::NAN),
        })
    }
}

fn call(function: Function, arguments: &[Dual]) -> Dual {
    let a = &arguments[0];
    let b = arguments.get(1).unwrap_or(a);
    let below = |a: f64, b: f64| if a < b { 1.0 } else { 0.0 };
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
        Function::Min => a.combine(b, f64::min, below, |a, b| 1.0 - below(a, b)),
        Function::Max => a.combine(b, f64::max, |a, b| 1.0 - below(a, b), below),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_codegen::language::{check_text, effects_from_text};

    /// Slopes agree with central differences, for every function and operator.
    #[test]
    fn slopes_are_those_of_small_steps() {
        let model = check_text(
            "robot Slide { track one; cluster a on one { link l; } variant N { arm reduced; tracks linear; } }",
        )
        .unwrap();
        let text = "effect everything on cart {
            param a, b: length;
            param c: number;
            along += a * sin(c * q / (1 m)) + b * cos(c) / (2 + tanh(c)) - sqrt(a^2 + b^2) * exp(-c);
            along += max(a, b * q / (1 m)) + abs(a - b) * atan(c) / (1 rad) + a * ln(3 + c) * tan(c / 5) - min(a, b);
        }";
        let model = effects_from_text(text, &model).unwrap();
        let effect = &model.effects[0];
        let q = vec![-0.4, 0.3, 1.1];
        let reader = |_: Readable| Ok(q.clone());
        let values = [0.7, -0.3, 0.9];
        for term in &effect.terms {
            let slopes = Formulas::new(effect, &values)
                .slopes(term, &reader)
                .unwrap();
            for parameter in 0..3 {
                let value = |step: f64| {
                    let mut moved = values;
                    moved[parameter] += step;
                    let formulas = Formulas {
                        values: &moved,
                        starts: vec![0, 1, 2],
                        fixed: None,
                    };
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
}
