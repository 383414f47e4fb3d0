//! Functions of an effect's terms, and the readings of samples that they are evaluated at.

use std::sync::OnceLock;

use tau_codegen::equations::Scope;
use tau_codegen::language::model::{Effect, Model, Target};
use tau_codegen::term::{Prepared, TermFunction};
use tau_estimation::samples::{Lack, Sample};
use tau_kinematics::Surroundings;

use super::super::probes::Probes;
use super::scope::{self, actions};
use super::{Candidate, Entry};

/// Terms of an effect as functions of its parameters, which are counted component by component.
#[derive(Debug)]
pub(super) struct Functions {
    by_amplitudes: OfParameters,
    /// Target of each term.
    targets: Vec<Target>,
    /// By all parameters, once they are wanted.
    by_all: OnceLock<OfParameters>,
}

/// Functions of some parameters.
#[derive(Debug)]
struct OfParameters {
    parameters: Vec<usize>,
    /// One per term.
    terms: Vec<TermFunction>,
}

impl OfParameters {
    fn new(effect: &Effect, parameters: Vec<usize>, derivatives: usize) -> Self {
        let of_term = |term| TermFunction::new(effect, term, &parameters, derivatives);
        Self {
            terms: effect.terms.iter().map(of_term).collect(),
            parameters,
        }
    }

    /// Their values among those of all.
    fn of(&self, values: &[f64]) -> Vec<f64> {
        self.parameters.iter().map(|&k| values[k]).collect()
    }
}

impl Functions {
    pub(super) fn new(effect: &Effect, amplitudes: Vec<usize>, searched: Option<usize>) -> Self {
        let derivatives = amplitudes.len();
        let parameters = amplitudes.into_iter().chain(searched).collect();
        Self {
            by_amplitudes: OfParameters::new(effect, parameters, derivatives),
            targets: effect.terms.iter().map(|term| term.target).collect(),
            by_all: OnceLock::new(),
        }
    }

    fn by_all(&self, effect: &Effect) -> &OfParameters {
        self.by_all.get_or_init(|| {
            let components = effect.parameters.iter().map(|own| own.components);
            let parameters: Vec<usize> = (0..components.sum()).collect();
            let derivatives = parameters.len();
            OfParameters::new(effect, parameters, derivatives)
        })
    }

    /// True if all terms are zero, whatever they read.
    pub(super) fn vanish(&self, effect: &Effect, values: &[f64]) -> bool {
        // Numbers that no formula singles out.
        const READ: [f64; 4] = [0.3719, 0.8171, 1.4387, 31.7];
        let OfParameters { terms, .. } = self.by_all(effect);
        terms.iter().all(|term| {
            let prepared = term.prepare(READ.len(), &vec![READ.to_vec(); term.reads.len()]);
            let values = term.values(&prepared, values);
            values.iter().flatten().all(|&value| value == 0.0)
        })
    }

    /// True if the columns by amplitudes are those of others, whatever the parameters are called.
    pub(super) fn have_columns_of(&self, other: &Self) -> bool {
        fn columns(of: &Functions) -> impl Iterator<Item = (Target, &TermFunction)> {
            let terms = of.targets.iter().copied().zip(&of.by_amplitudes.terms);
            terms.filter(|(_, term)| term.depends_on(|_| true))
        }
        columns(self).eq(columns(other))
    }
}

/// A candidate with what its terms read of samples: all but the values of its parameters.
pub(in super::super) struct Readings<'a> {
    candidate: &'a Candidate,
    wanted: &'a [usize],
    functions: &'a OfParameters,
    read: Vec<Reading>,
}

/// A term where it acts.
struct Reading {
    term: usize,
    /// Index of the first parameter of its place.
    first: usize,
    /// Of the target's components.
    probes: Vec<usize>,
    scope: Scope,
    prepared: Prepared,
}

impl<'a> Readings<'a> {
    /// Of derivatives by the parameters in `wanted`. Optional parameters stay at no effect unless they are wanted, or
    /// taken with other values.
    ///
    /// # Errors
    /// The column or set that the measurements lack, in words.
    pub(in super::super) fn of(
        (candidate, takes_optional): (&'a Candidate, bool),
        model: &Model,
        wanted: &'a [usize],
        probes: &Probes,
        samples: &[Sample],
        surroundings: &Surroundings,
    ) -> Result<Self, Lack> {
        let effect = &model.effects[candidate.effect];
        let amplitudes = candidate.amplitudes();
        let is_plain = !takes_optional && wanted.iter().all(|k| amplitudes.contains(k));
        let functions = if is_plain {
            &candidate.functions.by_amplitudes
        } else {
            candidate.functions.by_all(effect)
        };
        let own = candidate.parameters.len() / candidate.place_count();
        let mut read = Vec::new();
        let places = std::iter::once(&candidate.place).chain(&candidate.further);
        for (first, &place) in (0..).step_by(own.max(1)).zip(places) {
            let is_wanted = |k: usize| wanted.contains(&(first + functions.parameters[k]));
            let terms = effect.terms.iter().zip(&functions.terms).enumerate();
            let terms = terms.filter(|(_, (_, function))| function.depends_on(is_wanted));
            for (index, (term, function)) in terms {
                for action in actions((place, effect.subject), model, term, probes) {
                    let Some(&probe) = action.probes.first() else {
                        continue;
                    };
                    let at = &probes.all[probe].samples;
                    let of = |&readable| {
                        scope::read(&action.scope, readable, at, samples, surroundings, probes)
                    };
                    let data = function
                        .reads
                        .iter()
                        .map(of)
                        .collect::<Result<Vec<_>, _>>()?;
                    read.push(Reading {
                        term: index,
                        first,
                        prepared: function.prepare(at.len(), &data),
                        probes: action.probes,
                        scope: action.scope,
                    });
                }
            }
        }
        Ok(Self {
            candidate,
            wanted,
            functions,
            read,
        })
    }

    /// The derivatives, term by term, at values of all parameters.
    ///
    /// # Errors
    /// One that is not finite, in words.
    pub(in super::super) fn entries(&self, values: &[f64]) -> Result<Vec<Entry>, Lack> {
        let mut entries = Vec::new();
        for reading in &self.read {
            let own = self.functions.of(&values[reading.first..]);
            let derivatives =
                self.functions.terms[reading.term].derivatives(&reading.prepared, &own);
            for (component, (&probe, of_component)) in
                reading.probes.iter().zip(derivatives).enumerate()
            {
                let mut slopes = vec![None; self.candidate.parameters.len()];
                for (column, derivative) in of_component {
                    let parameter = reading.first + self.functions.parameters[column];
                    if !self.wanted.contains(&parameter) {
                        continue;
                    }
                    if derivative.iter().any(|slope| !slope.is_finite()) {
                        return Err(Lack::NOT_FINITE);
                    }
                    slopes[parameter] = Some(derivative);
                }
                entries.push(Entry {
                    term: reading.term,
                    component,
                    scope: reading.scope,
                    probe,
                    slopes,
                });
            }
        }
        Ok(entries)
    }
}
