//! Candidates: effects at places, with the columns that they would add to the Jacobian.

mod readings;
pub(super) mod scope;

use std::sync::Arc;

use nalgebra::DMatrix;
use tau_codegen::equations::{self, Scope};
use tau_codegen::language::model::{Effect, EffectUse, Model, Place, Subject};
use tau_codegen::language::units::Dimension;
use tau_estimation::samples::{Lack, Sample};
use tau_kinematics::Surroundings;
use tau_robot::effects;
use tau_robot::robot::{Arm, Variant};

use super::generic::{self, Family, Placement};
use super::probes::Probes;
use super::results;
use readings::Functions;
pub(super) use readings::Readings;

/// An effect at a place.
#[derive(Debug, Clone)]
pub(super) struct Candidate {
    /// Index in [`Model::effects`].
    pub(super) effect: usize,
    pub(super) place: Place,
    /// Further places of an unnamed family, each with amplitudes of its own.
    further: Vec<Place>,
    pub(super) name: String,
    /// The same in words: all places at once where it has further ones.
    pub(super) at: results::Place,
    /// Description of an unnamed family.
    pub(super) family: Option<Family>,
    /// The parameter whose range is searched, by index of its component.
    pub(super) search: Option<(usize, (f64, f64))>,
    pub(super) parameters: Vec<ParameterKind>,
    /// Of the effect's terms, with parameters of one place.
    functions: Arc<Functions>,
}

/// A component of an effect's parameter.
#[derive(Debug, Clone)]
pub(super) struct ParameterKind {
    pub(super) name: String,
    pub(super) unit: Dimension,
    /// At no effect.
    pub(super) none: f64,
    pub(super) tolerance: Option<f64>,
    /// True if it joins the effect only where it earns its place.
    is_optional: bool,
}

/// Derivatives of a term by the parameters at every sample, with the probe that carries them.
pub(super) struct Entry {
    /// Index of the term in the effect, and of what it adds to among the target's components.
    pub(super) term: usize,
    pub(super) component: usize,
    pub(super) scope: Scope,
    /// Index of the probe: what the term adds to.
    pub(super) probe: usize,
    /// By component of the effect's parameters: the value at each sample of the probe.
    pub(super) slopes: Vec<Option<Vec<f64>>>,
}

impl Entry {
    /// Slopes that move one probe, apart from any effect.
    pub(super) fn plain(probe: usize, slopes: Vec<Option<Vec<f64>>>) -> Self {
        Self {
            term: 0,
            component: 0,
            scope: Scope::default(),
            probe,
            slopes,
        }
    }
}

/// All candidates for a variant: effects at every place that a name can have. The last effects are `families`.
pub(super) fn all(model: &Model, base: &Variant, families: &[Family]) -> Vec<Candidate> {
    let mut candidates = Vec::new();
    let is_admitted = |effect: &Effect, place| {
        base.arm == Arm::Full || effect.needs_full_arm(place, &model.links).is_none()
    };
    for (index, effect) in model.effects.iter().enumerate() {
        let family = (index + families.len()).checked_sub(model.effects.len());
        let family = family.map(|index| families[index].clone());
        let placement = family.as_ref().map(|family| family.placement);
        if let (Some(family), Some(Placement::PerPlace)) = (&family, placement) {
            let each: Vec<Place> = effects::places(model, effect)
                .into_iter()
                .filter(|place| !place.is_common())
                .filter(|&place| is_admitted(effect, place))
                .collect();
            if each.len() > 1 {
                candidates.push(Candidate::of_all(index, effect, &each, family));
            }
            continue;
        }
        let mut first: Option<Candidate> = None;
        for place in effects::places(model, effect) {
            let is_common = place.is_common();
            let is_searched = effect
                .parameters
                .iter()
                .any(|parameter| parameter.search.is_some());
            let is_wanted = match placement {
                Some(Placement::Shared) => is_common,
                Some(_) => !is_common,
                None => !(is_searched && is_common),
            };
            if !is_wanted || !is_admitted(effect, place) {
                continue;
            }
            let places = equations::places(model, place);
            let is_used = base
                .effects
                .iter()
                .any(|(name, at)| *name == effect.name && *at == places);
            if !is_used {
                let at = results::Place::of(model, place);
                let first = first.get_or_insert_with(|| {
                    Candidate::new(index, effect, place, at.clone(), family.clone())
                });
                candidates.push(Candidate {
                    place,
                    at,
                    ..first.clone()
                });
            }
        }
    }
    candidates
}

impl Candidate {
    fn new(
        index: usize,
        effect: &Effect,
        place: Place,
        at: results::Place,
        family: Option<Family>,
    ) -> Self {
        let mut parameters = Vec::new();
        let mut search = None;
        for parameter in &effect.parameters {
            if let Some(range) = parameter.search.filter(|_| search.is_none()) {
                search = Some((parameters.len(), range));
            }
            for component in 0..parameter.components {
                let suffix = if parameter.components > 1 {
                    ["_x", "_y", "_z"].get(component).copied().unwrap_or("")
                } else {
                    ""
                };
                parameters.push(ParameterKind {
                    name: format!("{}{suffix}", parameter.name),
                    unit: parameter.dimension,
                    none: parameter.nominal,
                    tolerance: parameter.tolerance,
                    is_optional: parameter.optional,
                });
            }
        }
        let start: Vec<f64> = parameters.iter().map(|parameter| parameter.none).collect();
        // An optional parameter that is not taken stays where it starts.
        let held = |k: usize| {
            parameters[k].is_optional || search.is_some_and(|(searched, _)| searched == k)
        };
        let amplitudes = (0..parameters.len()).filter(|&k| !held(k)).collect();
        let functions = Functions::new(effect, amplitudes, search.map(|(searched, _)| searched));
        let none = at_none(effect, &functions, start, held);
        for (parameter, none) in parameters.iter_mut().zip(none) {
            parameter.none = none;
        }
        Self {
            effect: index,
            place,
            further: vec![],
            name: effect.name.clone(),
            at,
            family,
            search,
            parameters,
            functions: Arc::new(functions),
        }
    }

    /// An unnamed family at all its places at once.
    fn of_all(index: usize, effect: &Effect, places: &[Place], family: &Family) -> Self {
        let at = match effect.subject {
            subject if subject.is_link() => results::Place::AllLinks,
            Subject::Crank => results::Place::AllCranks,
            Subject::BaseJoint => results::Place::AllBaseJoints,
            _ => results::Place::AllCarts,
        };
        let first = Self::new(index, effect, places[0], at, Some(family.clone()));
        Self {
            further: places[1..].to_vec(),
            parameters: vec![first.parameters.clone(); places.len()].concat(),
            ..first
        }
    }

    /// Commands of the drives that it acts on or moves with, of all its places.
    pub(super) fn commands(&self, model: &Model) -> Vec<usize> {
        let subject = model.effects[self.effect].subject;
        let places = std::iter::once(self.place).chain(self.further.iter().copied());
        places
            .flat_map(|place| model.commands_at(subject, place))
            .collect()
    }

    /// Number of places at which it has amplitudes of its own.
    pub(super) fn place_count(&self) -> usize {
        1 + self.further.len()
    }

    /// True if it has a name of its own.
    pub(super) fn is_named(&self) -> bool {
        !self.name.starts_with(generic::UNNAMED)
    }

    /// Indices of the parameters that are amplitudes: all but the searched and the optional ones.
    pub(super) fn amplitudes(&self) -> Vec<usize> {
        let taken = self.taken(false).into_iter();
        taken.filter(|&k| !self.is_searched(k)).collect()
    }

    /// Indices of the parameters that the effect has in a model, `extended` by its optional ones or not.
    pub(super) fn taken(&self, extended: bool) -> Vec<usize> {
        (0..self.parameters.len())
            .filter(|&k| extended || !self.parameters[k].is_optional)
            .collect()
    }

    /// Indices of the optional parameters.
    pub(super) fn optional(&self) -> Vec<usize> {
        (0..self.parameters.len())
            .filter(|&k| self.parameters[k].is_optional)
            .collect()
    }

    /// True if a parameter is the searched one.
    pub(super) fn is_searched(&self, parameter: usize) -> bool {
        self.search
            .is_some_and(|(searched, _)| searched == parameter)
    }

    /// True if a value of the searched parameter is one that the description allows.
    pub(super) fn allows(&self, value: f64) -> bool {
        self.search
            .is_some_and(|(_, (low, high))| (low..=high).contains(&value))
    }

    /// True if it has the columns of another, at any value of what is searched.
    pub(super) fn looks_like(&self, other: &Self) -> bool {
        self.place == other.place
            && self.further == other.further
            && self.functions.have_columns_of(&other.functions)
    }

    /// Its use in a model that finds it there, extended by its optional parameters or not. Its prior keeps what the data do
    /// not tell within what is plausible, so many tolerances, and must not pull back what they do.
    pub(super) fn used(&self, model: &Model, extended: bool, plausible: f64) -> EffectUse {
        let parameters = &model.effects[self.effect].parameters;
        let has_tolerance = parameters.iter().any(|own| own.tolerance.is_some());
        EffectUse {
            effect: self.effect,
            place: self.place,
            with: (0..parameters.len())
                .filter(|&k| extended && parameters[k].optional)
                .collect(),
            tolerance_factor: if has_tolerance { plausible } else { 1.0 },
        }
    }

    /// Parameter values at no effect.
    pub(super) fn none(&self) -> Vec<f64> {
        self.parameters
            .iter()
            .map(|parameter| parameter.none)
            .collect()
    }

    /// Parameter values at no effect, a searched parameter at a value.
    pub(super) fn values_at(&self, searched: Option<f64>) -> Vec<f64> {
        let mut values = self.none();
        if let (Some((place, _)), Some(value)) = (self.search, searched) {
            values[place] = value;
        }
        values
    }

    /// Derivatives of the effect by each parameter in `wanted`, term by term.
    ///
    /// # Errors
    /// The column or set that the measurements lack, in words.
    pub(super) fn entries(
        &self,
        model: &Model,
        (values, wanted): (&[f64], &[usize]),
        probes: &Probes,
        samples: &[Sample],
        surroundings: &Surroundings,
    ) -> Result<Vec<Entry>, Lack> {
        let is_nominal = |k: usize| values[k] == self.parameters[k].none;
        let takes_optional = !self.optional().into_iter().all(is_nominal);
        Readings::of(
            (self, takes_optional),
            model,
            wanted,
            probes,
            samples,
            surroundings,
        )?
        .entries(values)
    }
}

/// Parameter values at which an effect does nothing: those at which it starts where that is so, or else with as few
/// zeros in their place as it takes. An expansion may start at what is expected of steel; a length over which something
/// decays is not zero where nothing is there to decay.
fn at_none(
    effect: &Effect,
    functions: &Functions,
    start: Vec<f64>,
    held: impl Fn(usize) -> bool,
) -> Vec<f64> {
    let expected: Vec<usize> = (0..start.len())
        .filter(|&k| !held(k) && start[k] != 0.0)
        .collect();
    if expected.is_empty() {
        return start;
    }
    let without = |zero: &[usize]| -> Vec<f64> {
        let value = |k: usize| if zero.contains(&k) { 0.0 } else { start[k] };
        (0..start.len()).map(value).collect()
    };
    let single = expected.iter().map(|&k| without(&[k]));
    let mut tried = std::iter::once(start.clone())
        .chain(single)
        .chain([without(&expected)]);
    tried
        .find(|values| functions.vanish(effect, values))
        .unwrap_or(start)
}

/// The columns that entries add up to, one per parameter in `wanted`, on rows in units of noise.
pub(super) fn columns(entries: &[Entry], wanted: &[usize], probes: &Probes) -> DMatrix<f64> {
    let mut columns = DMatrix::zeros(probes.row_count, wanted.len());
    for entry in entries {
        let probe = &probes.all[entry.probe];
        for (column, &parameter) in wanted.iter().enumerate() {
            let Some(slopes) = &entry.slopes[parameter] else {
                continue;
            };
            let mut target = columns.column_mut(column);
            for moved in &probe.rows {
                target[moved.row] += moved.derivative * slopes[moved.place];
            }
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use tau_codegen::language::{check_text, effects_from_text};

    use super::*;

    const AT: results::Place = results::Place::Cart(String::new());

    #[test]
    fn no_effect_is_where_nothing_is_added() {
        let model = check_text(
            "robot Slide { track one; cluster a on one { link l, l2, l3; } variant N { arm reduced; tracks linear; } }",
        )
        .unwrap();
        let text = "
            effect warm on cart { param expansion: 1/K = 12 ppm/K; param shift: length;
                along += expansion * (temperature - 20 K) * q + shift; }
            effect fading on cart { param a: length; param reach: length = 300 mm; along += a * exp(-q/reach); }
            effect worn on cart { param a: length = 5 um; param reach: length = 300 mm;
                along += a * exp(-q/reach); }
            effect both on cart { param a, b: length = 5 um; along += a * q / (1 m); vertical += b; }
            effect fixed on cart { param a: length = 5 um; along += a + 1 um; }
            effect geared on cart { optional param gain: ratio = 2; param a: length = 5 um; along += gain * a; }";
        let model = effects_from_text(text, &model).unwrap();
        let place = Place::Cart {
            track: 0,
            source: None,
        };
        let none =
            |index: usize| Candidate::new(index, &model.effects[index], place, AT, None).none();
        let expected: [&[f64]; 6] = [
            &[0.0, 0.0],
            &[0.0, 0.3],
            &[0.0, 0.3],
            &[0.0, 0.0],
            &[5e-6],
            &[2.0, 0.0],
        ];
        for (index, expected) in expected.into_iter().enumerate() {
            assert_eq!(none(index), expected, "{}", model.effects[index].name);
        }
    }

    #[test]
    fn waves_are_alike_whatever_their_parameters_are_called() {
        let model = check_text(
            "robot Slide { track one; track two; cluster a on one { link l; } cluster b on two { link m, n; }
             variant N { arm reduced; tracks linear; } }",
        )
        .unwrap();
        let text = "
            effect wave on cart { param a, b: length; search p: length in 4 mm ..= 50 mm;
                along += a * sin(2*pi*q/p) + b * cos(2*pi*q/p); }
            effect richer on cart { param sine, c: length; optional param d: length;
                search period: length in 60 mm ..= 1 m;
                along += sine * sin(2*pi*q/period) + c * cos(2*pi*q/period); along += d * sin(4*pi*q/period); }
            effect twice on cart { param a, b: length; search p: length in 4 mm ..= 50 mm;
                along += a * sin(4*pi*q/p) + b * cos(4*pi*q/p); }
            effect upwards on cart { param a, b: length; search p: length in 4 mm ..= 50 mm;
                vertical += a * sin(2*pi*q/p) + b * cos(2*pi*q/p); }
            effect swapped on cart { param a, b: length; search p: length in 4 mm ..= 50 mm;
                along += b * sin(2*pi*q/p) + a * cos(2*pi*q/p); }";
        let model = effects_from_text(text, &model).unwrap();
        let at = |name: &str, track| {
            let index = model.effects.iter().position(|effect| effect.name == name);
            let place = Place::Cart {
                track,
                source: None,
            };
            let index = index.unwrap();
            Candidate::new(index, &model.effects[index], place, AT, None)
        };
        let wave = at("wave", 0);
        assert!(wave.looks_like(&at("richer", 0)));
        assert!(at("richer", 0).looks_like(&wave));
        assert!(!wave.looks_like(&at("richer", 1)));
        for other in ["twice", "upwards", "swapped"] {
            assert!(!wave.looks_like(&at(other, 0)), "{other}");
        }
    }
}
