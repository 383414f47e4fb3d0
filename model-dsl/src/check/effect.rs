//! Effects: subject, parameters, terms.

use super::declared::{Declared, twice};
use super::formula::formula;
use super::quantity::{dimension, scalar, tolerance, unit_help};
use super::scope::{Home, Scope};
use super::value::Shape;
use super::vocabulary::{TARGETS, meaning, subject_of, subject_word};
use crate::diagnostics::Diagnostics;
use crate::model::{Effect, EffectParameter, Subject, Target, Term, Track};
use crate::names::nearest;
use crate::plausible::SMALLEST_OF_PARAMETER;
use crate::syntax;
use crate::units::Dimension;

/// An effect with what is known about it beyond the model.
pub(super) struct CheckedEffect {
    pub(super) effect: Effect,
    /// Its subject; `None` after an error.
    pub(super) subject: Option<Subject>,
}

pub(super) fn effect(
    effect: &syntax::Effect,
    tracks: &[Track],
    diagnostics: &mut Diagnostics,
) -> CheckedEffect {
    let subject = subject(effect, diagnostics);
    let before = diagnostics.count();
    let mut scope = Scope::new(Home::Effect(effect.name.to_string(), subject), tracks);
    let mut names = Declared::default();
    for declaration in &effect.parameters {
        parameters(declaration, &mut names, &mut scope, diagnostics);
    }
    let mut searches = effect.parameters.iter().filter(|one| one.search.is_some());
    let first = searches.next().and_then(|one| one.names.first());
    for further in searches.flat_map(|one| &one.names) {
        let known = first.map_or_else(String::new, |first| format!(" beside `{}`", first.name));
        error!(diagnostics, SEARCH, &further.name; "`{}` is searched{known}", further.name;
            "an effect searches one parameter: declare the others with `param`");
    }
    if effect.terms.is_empty() {
        error!(diagnostics, NO_TERMS, &effect.name; "effect `{}` adds to nothing", effect.name;
            "add a term, such as `along += …;`");
    }
    let terms: Vec<Term> = effect
        .terms
        .iter()
        .filter_map(|given| term(given, &mut scope, diagnostics))
        .collect();
    // A parameter may be unused because the formula that means it has an error.
    if diagnostics.count() == before {
        for (name, _) in scope.unused() {
            error!(diagnostics, UNUSED_PARAMETER, name; "parameter `{name}` is used in no term";
                "use it in a formula, or remove it");
        }
    }
    let effect = Effect {
        name: effect.name.to_string(),
        docs: effect.docs.clone(),
        subject: subject.unwrap_or(Subject::Cart),
        parameters: scope.into_parameters(),
        terms,
    };
    CheckedEffect { effect, subject }
}

/// Names of effects so far, with their subject and line. Several effects may have one name where no place is one of both.
pub(super) type Names = Vec<(String, Option<Subject>, usize)>;

/// Declares the name of an effect; one that a use could not tell from an earlier one is an error.
pub(super) fn declare(
    effect: &syntax::Effect,
    checked: &CheckedEffect,
    names: &mut Names,
    diagnostics: &mut Diagnostics,
) {
    let name = &effect.name;
    let first = names.iter().find(|(own, subject, _)| {
        name == own && (subject.zip(checked.subject)).is_none_or(|(first, own)| first.overlaps(own))
    });
    if let Some((_, subject, line)) = first {
        let help = match subject.zip(checked.subject) {
            Some((first, own)) if first != own => format!(
                "choose another name: `on {}` and `on {}` can mean the same place",
                first.written(),
                own.written()
            ),
            _ => "choose another name".to_owned(),
        };
        twice(name, "effect", *line, &help, diagnostics);
        return;
    }
    let line = name.span().start().line;
    names.push((name.to_string(), checked.subject, line));
}

fn subject(effect: &syntax::Effect, diagnostics: &mut Diagnostics) -> Option<Subject> {
    let word = effect.subject.to_string();
    let subject = match (word.as_str(), &effect.source) {
        ("link", None) => Some(match (&effect.actuated, &effect.kind) {
            (Some((_, true)), _) => Subject::LinkByAngle,
            (Some((_, false)), _) => Subject::LinkByLength,
            (None, Some(kind)) if kind == "pulled" => Subject::PulledLink,
            (None, Some(_)) => Subject::DrivenLink,
            (None, None) => Subject::Link,
        }),
        ("cart", None) => Some(Subject::Cart),
        ("crank", _) => Some(Subject::Crank),
        ("base", _) => Some(Subject::BaseJoint),
        ("cart", Some(_)) => Some(Subject::CartFromSource),
        ("link", _) => Some(Subject::Link),
        ("tcp", _) => Some(Subject::Tcp),
        _ => {
            let help = match nearest(&word, ["cart", "link", "crank", "tcp"]) {
                Some(near) => format!("did you mean `{near}`?"),
                None => {
                    "an effect on a cart moves it, on a link changes its length or joint, on a crank its \
                         angle, on a base joint shifts that, on the tcp the measured position"
                        .to_owned()
                }
            };
            error!(diagnostics, UNKNOWN_SUBJECT, &effect.subject;
                "effects act on `cart`, `link`, `crank`, `base joint` or `tcp`, found `{word}`"; "{help}");
            None
        }
    };
    let actuated = effect.actuated.as_ref().map(|(actuated, _)| actuated);
    let word = subject.map_or(word.as_str(), |own| subject_word(own));
    if let (Some(subject), Some(kind)) = (subject, effect.kind.as_ref().or(actuated))
        && !subject.is_link()
    {
        error!(diagnostics, SUBJECT, kind; "only links are {kind}, found an effect on {word}";
            "leave out `{kind}`, or let the effect act on `link`");
    }
    if let (Some(kind), Some(actuated)) = (&effect.kind, actuated) {
        error!(diagnostics, SUBJECT, actuated; "the link is {kind} and {actuated}, expected one of the two";
            "write `on driven link`, `on pulled link`, `on link actuated length` or `on link actuated angle`");
    }
    let has_none = |subject: Subject| {
        matches!(
            subject,
            Subject::Link | Subject::Crank | Subject::BaseJoint | Subject::Tcp
        )
    };
    if let (Some(source), true) = (&effect.source, subject.is_some_and(has_none)) {
        error!(diagnostics, SUBJECT, source; "only an effect on cart has a source, found `on {word} from source`";
            "leave out `from source`; `q(track)` reads the command of a named track");
    }
    subject
}

fn parameters<'a>(
    declaration: &'a syntax::Parameters,
    names: &mut Declared,
    scope: &mut Scope<'a>,
    diagnostics: &mut Diagnostics,
) {
    let dimension = dimension(&declaration.dimension, diagnostics);
    let first = declaration
        .names
        .first()
        .map_or_else(String::new, |one| format!("`{}`", one.name));
    let nominal = declaration.nominal.as_ref().and_then(|quantity| {
        scalar(
            quantity,
            dimension,
            &format!("the value of {first}"),
            diagnostics,
        )
    });
    let bounds = SMALLEST_OF_PARAMETER..=f64::INFINITY;
    let tolerance = declaration
        .tolerance
        .as_ref()
        .and_then(|quantity| tolerance(quantity, dimension, &first, &bounds, diagnostics));
    if let Some(exact) = declaration.exact {
        error!(diagnostics, CERTAINTY, exact; "an exact parameter of an effect would be a number of its formulas";
            "write the number into the formulas");
    }
    let search = search(declaration, dimension, &first, diagnostics);
    for given in &declaration.names {
        let name = given.name.to_string();
        let mut is_sound = names.declare(&given.name, "parameter", diagnostics);
        if let Some(meaning) = meaning(&name) {
            error!(diagnostics, NAME_WITH_MEANING, &given.name; "`{name}` is {meaning} and cannot be a parameter";
                "choose another name");
            is_sound = false;
        }
        let components = match given.components {
            None => 1,
            Some((3, location)) => {
                if declaration.search.is_some() {
                    error!(diagnostics, SEARCH, location; "`{name}` is searched and cannot be a vector";
                        "search one number at a time");
                }
                3
            }
            Some((number, location)) => {
                error!(diagnostics, VECTOR_COMPONENTS, location; "a vector has 3 components, found {number}";
                    "write `{name}[3]`, or `{name}` for a scalar");
                3
            }
        };
        let middle = search.map(|(from, to)| from + 0.5 * (to - from));
        let parameter = EffectParameter {
            name,
            components,
            dimension: dimension.unwrap_or_default(),
            nominal: nominal.or(middle).unwrap_or(0.0),
            tolerance,
            search,
            optional: declaration.optional,
        };
        scope.declare(&given.name, parameter, dimension.is_some());
        if !is_sound {
            scope.poison(&given.name);
        }
    }
}

/// The range of a searched parameter: one in which a grid even in the reciprocal has a meaning.
fn search(
    declaration: &syntax::Parameters,
    dimension: Option<Dimension>,
    name: &str,
    diagnostics: &mut Diagnostics,
) -> Option<(f64, f64)> {
    let (low, high) = declaration.search.as_ref()?;
    // The grid's density follows from the range of the commands, which are lengths or angles.
    let of_commands = [Dimension::LENGTH, Dimension::ANGLE];
    if let Some(found) = dimension.filter(|dimension| !of_commands.contains(dimension)) {
        error!(diagnostics, SEARCH, declaration.dimension.location;
            "{name} is searched and must be {} or {}, found {}",
                Dimension::LENGTH.describe(), Dimension::ANGLE.describe(), found.describe();
            "what is searched is the length or angle in which an effect repeats; declare anything else with `param`");
        return None;
    }
    let what = format!("the search range of {name}");
    let ends = (
        scalar(low, dimension, &what, diagnostics),
        scalar(high, dimension, &what, diagnostics),
    );
    let (from, to) = ends.0.zip(ends.1)?;
    if from >= to {
        error!(diagnostics, SEARCH_RANGE, low.location.to(high.location); "{what} is empty";
            "write two ends, the smaller one first: `in 4 mm ..= 50 mm`");
        return None;
    }
    // Reciprocals of numbers smaller than the normal ones are infinite.
    if from < f64::MIN_POSITIVE {
        error!(diagnostics, SEARCH_RANGE, low.location; "{what} must begin above zero";
            "write the smallest value that is plausible first: `in 4 mm ..= 50 mm`");
        return None;
    }
    Some((from, to))
}

fn term(
    given: &syntax::Term,
    scope: &mut Scope<'_>,
    diagnostics: &mut Diagnostics,
) -> Option<Term> {
    let name = given.target.to_string();
    let target = TARGETS.iter().find(|(own, ..)| *own == name);
    match (target, scope.subject()) {
        (None, _) => {
            let names = TARGETS.iter().map(|(name, ..)| *name);
            let help = match nearest(&name, names.clone()) {
                Some(near) => format!("did you mean `{near}`?"),
                None => format!("effects add to {}", names.collect::<Vec<_>>().join(", ")),
            };
            error!(diagnostics, UNKNOWN_TARGET, &given.target; "an effect cannot add to `{name}`"; "{help}");
        }
        (Some((_, Target::Command, ..)), Some(subject))
            if subject.is_link() && !subject.takes(Target::Command) =>
        {
            let on = subject.written();
            error!(diagnostics, TARGET_OF_OTHER, &given.target;
                "an effect on {on} cannot add to `{name}`, which is a length or an angle";
                "write `on link actuated length` or `on link actuated angle`");
        }
        (Some((_, target, ..)), Some(subject)) if !subject.takes(*target) => {
            let word = subject_word(subject);
            let own: Vec<_> = TARGETS
                .iter()
                .filter(|(_, target, ..)| subject.takes(*target))
                .map(|(name, ..)| *name)
                .collect();
            error!(diagnostics, TARGET_OF_OTHER, &given.target; "an effect on {word} cannot add to `{name}`";
                "it adds to {}; `{name}` needs an effect on {}", own.join(", "), subject_of(*target));
        }
        _ => {}
    }
    let formula = formula(&given.formula, scope, diagnostics)?;
    let (_, target, _, vector) = *target?;
    let expected = match (target, scope.subject()) {
        // Whether it is a length or an angle nobody knows after an error.
        (Target::Command, None) => return None,
        (_, subject) => target.dimension(subject.unwrap_or(Subject::Cart)),
    };
    let location = given.formula.location;
    if vector != matches!(formula.shape, Shape::Vector(_)) {
        let (wanted, found, help) = if vector {
            (
                "vector",
                "scalar",
                "write `(x, y, z)`, or use a parameter of 3 components",
            )
        } else {
            ("scalar", "vector", "use one component, such as `rate[0]`")
        };
        error!(diagnostics, WRONG_SHAPE, location; "`{name}` is a {wanted}, but this formula is a {found}"; "{help}");
        return None;
    }
    let found = formula.dimension?;
    let number_as_angle = expected == Dimension::ANGLE && found == Dimension::NUMBER;
    if found != expected && !number_as_angle {
        error!(diagnostics, WRONG_DIMENSION, location;
            "`{name}` is {}, but this formula is {}", expected.describe(), found.describe();
            "{}", found.divide(expected).map_or_else(|| unit_help(expected), |factor| mismatch_help(factor, expected)));
        return None;
    }
    let written = location.source_text();
    Some(Term {
        target,
        formula: formula.shape.into_formula(),
        text: written.map_or_else(String::new, |formula| format!("{name} += {formula}")),
    })
}

/// Remedy for a formula that is off by a factor.
fn mismatch_help(factor: Dimension, expected: Dimension) -> String {
    if factor.angle != 0 && (Dimension { angle: 0, ..factor }) == Dimension::NUMBER {
        return "divide an angle by `1 rad` to make a number of it".to_owned();
    }
    format!(
        "the formula must come out in `{}`; it is off by a factor in `{}`",
        expected.si_unit(),
        factor.si_unit()
    )
}
