//! Terms of effects by themselves, over many samples: values and derivatives without the machine that they act on.
//!
//! They are read, differentiated, lowered and interpreted as in the residuals of a variant that has the effect.

use tau_model_dsl::model::{Effect, Formula, Readable, Term};
use tau_runtime::{BlockFamily, LANES, Lanes, Pattern, ResidualFamily, Shape, block_count};

use crate::differentiate::gradient;
use crate::equations::formula::{Leaves, components, scalar};
use crate::equations::{SparseRows, symbol};
use crate::graph::{Expr, Graph, Stage, Symbol};
use crate::interpret::Interpreted;
use crate::lower::lower;

/// A term of an effect as a function of parameters and of the quantities that it reads.
#[derive(Debug, Clone, PartialEq)]
pub struct TermFunction {
    /// The quantities, in the order of first reading.
    pub reads: Vec<Readable>,
    function: Interpreted,
}

/// Quantities of samples, with all that a term makes of them before its parameters are known.
#[derive(Debug, Clone)]
pub struct Prepared {
    samples: usize,
    blocks: Vec<Lanes>,
}

impl TermFunction {
    /// A function of some parameters of an effect, differentiated by the first so many of them; the others are constants,
    /// as where a variant does not take them. Parameters are counted component by component, in order of declaration.
    pub fn new(effect: &Effect, term: &Term, parameters: &[usize], derivatives: usize) -> Self {
        let mut graph = Graph::new();
        let symbols: Vec<Expr> = (0..parameters.len())
            .map(|index| graph.symbol(format!("p{index}"), Stage::Parameter))
            .collect();
        let mut leaves = OfEffect {
            effect,
            graph,
            parameters: parameters.iter().copied().zip(symbols.clone()).collect(),
            reads: Vec::new(),
        };
        let residuals: Vec<Expr> = (components(&term.formula).iter())
            .map(|component| scalar(component, &mut leaves))
            .collect();
        let OfEffect {
            mut graph, reads, ..
        } = leaves;
        let by: Vec<Symbol> = (symbols[..derivatives].iter())
            .map(|&parameter| symbol(&graph, parameter))
            .collect();
        let rows: Vec<Vec<Expr>> = (residuals.iter())
            .map(|&residual| gradient(&mut graph, residual, &by))
            .collect();
        let jacobian = SparseRows::from_dense(&graph, &rows);
        let data: Vec<Expr> = reads.iter().map(|&(_, symbol)| symbol).collect();
        let programs = lower(&mut graph, &residuals, &jacobian.entries, &data, &symbols);
        let shape = Shape {
            data: data.len(),
            prepared: programs.prepare.outputs.len(),
            parameters: symbols.len(),
            residuals: residuals.len(),
        };
        Self {
            reads: reads.into_iter().map(|(readable, _)| readable).collect(),
            function: Interpreted::new(shape, jacobian.row_starts, jacobian.columns, &programs),
        }
    }

    /// True if a derivative by any of the parameters, given by their places, is other than zero.
    pub fn depends_on(&self, parameter: impl Fn(usize) -> bool) -> bool {
        let mut columns = self.function.pattern().columns.iter();
        columns.any(|&column| parameter(column as usize))
    }

    /// Takes in so many samples; `data` are their values of each quantity.
    pub fn prepare(&self, samples: usize, data: &[Vec<f64>]) -> Prepared {
        let by_sample: Vec<f64> = (0..samples)
            .flat_map(|sample| data.iter().map(move |values| values[sample]))
            .collect();
        let width = self.function.shape().prepared;
        let mut blocks = vec![Lanes::ZERO; block_count(samples) * width];
        self.function.prepare_blocks(&by_sample, &mut blocks);
        Prepared { samples, blocks }
    }

    /// Values of each component at every sample.
    pub fn values(&self, prepared: &Prepared, parameters: &[f64]) -> Vec<Vec<f64>> {
        let width = self.function.shape().residuals;
        let mut values = vec![Lanes::ZERO; block_count(prepared.samples) * width];
        (self.function).value_blocks(&prepared.blocks, parameters, &mut values);
        let values = (0..width).map(|component| series(&values, width, component, prepared));
        values.collect()
    }

    /// Derivatives at every sample: of each component, those that are not zero everywhere, with the parameter (place
    /// among those given) that each is by.
    pub fn derivatives(
        &self,
        prepared: &Prepared,
        parameters: &[f64],
    ) -> Vec<Vec<(usize, Vec<f64>)>> {
        let components = self.function.shape().residuals;
        let Pattern {
            row_starts,
            columns,
        } = self.function.pattern();
        let width = columns.len();
        let count = block_count(prepared.samples);
        let mut values = vec![Lanes::ZERO; count * components];
        let mut entries = vec![Lanes::ZERO; count * width];
        (self.function).linearize_blocks(&prepared.blocks, parameters, &mut values, &mut entries);
        let of_component = |rows: &[u32]| {
            let own = rows[0] as usize..rows[1] as usize;
            own.map(|entry| {
                let derivative = series(&entries, width, entry, prepared);
                (columns[entry] as usize, derivative)
            })
            .collect()
        };
        row_starts.windows(2).map(of_component).collect()
    }
}

/// One of several numbers of each sample.
fn series(blocks: &[Lanes], width: usize, place: usize, prepared: &Prepared) -> Vec<f64> {
    let mut series = Vec::with_capacity(blocks.len() / width * LANES);
    for block in blocks.chunks_exact(width) {
        series.extend_from_slice(&block[place].0);
    }
    series.truncate(prepared.samples);
    series
}

/// Parameters and quantities of an effect, as symbols.
struct OfEffect<'a> {
    effect: &'a Effect,
    graph: Graph,
    /// Place of each parameter that is none of the constants.
    parameters: Vec<(usize, Expr)>,
    reads: Vec<(Readable, Expr)>,
}

impl Leaves for OfEffect<'_> {
    fn graph(&mut self) -> &mut Graph {
        &mut self.graph
    }

    fn leaf(&mut self, leaf: &Formula) -> Expr {
        match leaf {
            Formula::Parameter(index, component) => {
                let before = self.effect.parameters[..*index].iter();
                let start: usize = before.map(|parameter| parameter.components).sum();
                let place = start + component;
                let known = self.parameters.iter().find(|own| own.0 == place);
                match known {
                    Some(&(_, symbol)) => symbol,
                    None => {
                        let nominal = self.effect.parameters[*index].nominal;
                        self.graph.constant(nominal)
                    }
                }
            }
            Formula::Read(readable) => {
                if let Some(&(_, symbol)) = self.reads.iter().find(|own| own.0 == *readable) {
                    return symbol;
                }
                let name = format!("r{}", self.reads.len());
                let symbol = self.graph.symbol(name, Stage::Data);
                self.reads.push((*readable, symbol));
                symbol
            }
            _ => unreachable!("the checker admits values of links in links alone"),
        }
    }
}

#[cfg(test)]
mod tests {
    use tau_model_dsl::{check_text, effects_from_text};

    use super::*;

    fn effect(text: &str) -> Effect {
        let model = check_text(
            "robot Slide { track one; cluster a on one { link l, l2, l3; } variant N { arm reduced; tracks linear; } }",
        );
        let model = effects_from_text(text, &model.unwrap()).unwrap();
        model.effects[0].clone()
    }

    /// More samples than a block has, and one that is not full.
    fn commands() -> Vec<f64> {
        (0..11).map(|k| 0.37 * f64::from(k) - 1.9).collect()
    }

    #[test]
    fn derivatives_are_those_of_small_steps() {
        let effect = effect(
            "effect everything on cart {
            param a, b: length;
            param c: number;
            along += a * sin(c * q / (1 m)) + b * cos(c) / (2 + tanh(c)) - sqrt(a^2 + b^2) * exp(-c);
            along += max(a, b * q / (1 m)) + abs(a - b) * atan(c) / (1 rad) + a * ln(3 + c) * tan(c / 5) - min(a, b);
        }",
        );
        let q = commands();
        let values = [0.7, -0.3, 0.9];
        for term in &effect.terms {
            let function = TermFunction::new(&effect, term, &[0, 1, 2], 3);
            let data: Vec<Vec<f64>> = function.reads.iter().map(|_| q.clone()).collect();
            let prepared = function.prepare(q.len(), &data);
            let mut found = vec![vec![0.0; q.len()]; 3];
            for (parameter, derivative) in function.derivatives(&prepared, &values).remove(0) {
                found[parameter] = derivative;
            }
            for (parameter, found) in found.iter().enumerate() {
                let value = |step: f64| {
                    let mut moved = values;
                    moved[parameter] += step;
                    function.values(&prepared, &moved).remove(0)
                };
                let (up, down) = (value(1e-6), value(-1e-6));
                for sample in 0..q.len() {
                    let expected = (up[sample] - down[sample]) / 2e-6;
                    let off = (found[sample] - expected).abs();
                    assert!(off < 1e-8, "{parameter}, {sample}: {found:?} {expected}");
                }
            }
        }
    }

    /// Parameters stand in the order asked for; those that are not asked for are constants at their nominal values.
    #[test]
    fn components_of_vectors_have_the_derivatives_by_hand() {
        let effect = effect(
            "effect drift on tcp {
            param rate[3]: velocity;
            param b: length = 3 um;
            param reach: length = 500 mm;
            position += rate * time + (b * sin(x / reach), 0 m, b * y / reach);
        }",
        );
        let function = TermFunction::new(&effect, &effect.terms[0], &[3, 2, 4], 2);
        let (x, y, time) = (commands(), vec![0.2; 11], commands());
        let data = |readable: &Readable| match readable {
            Readable::Position(0) => x.clone(),
            Readable::Position(_) => y.clone(),
            Readable::Time => time.clone(),
            other => panic!("{other:?} is not read"),
        };
        let data: Vec<Vec<f64>> = function.reads.iter().map(data).collect();
        let prepared = function.prepare(11, &data);
        let derivatives = function.derivatives(&prepared, &[2e-6, 1e-9, 0.4]);
        let by = |component: usize| -> Vec<usize> {
            derivatives[component].iter().map(|own| own.0).collect()
        };
        assert_eq!([by(0), by(1), by(2)], [vec![0], vec![], vec![0, 1]]);
        let values = function.values(&prepared, &[2e-6, 1e-9, 0.4]);
        for sample in 0..11 {
            let sine = (x[sample] / 0.4).sin();
            let close = |found: f64, expected: f64| (found - expected).abs() < 1e-15;
            assert!(close(derivatives[0][0].1[sample], sine));
            assert!(close(derivatives[2][0].1[sample], 0.2 / 0.4));
            assert!(close(derivatives[2][1].1[sample], time[sample]));
            assert!(close(values[0][sample], 2e-6 * sine) && values[1][sample] == 0.0);
            assert!(close(values[2][sample], 2e-6 * 0.5 + 1e-9 * time[sample]));
        }
        assert!(function.depends_on(|parameter| parameter == 1));
        assert!(!function.depends_on(|parameter| parameter == 2));
    }
}
