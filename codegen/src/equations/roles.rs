//! Names of the machine's parameters by role.
//!
//! Links whose formulas differ in nothing but the parameters that they read share one family, in which a parameter is
//! called by what its names have in common: `angle` for `angle_a`, `angle_b`, `angle_c`.

use tau_model_dsl::model::{Formula, Model, Value};

/// Name of a parameter of the machine inside the family of a link; `None` where it keeps its own.
pub(super) fn role(model: &Model, link: usize, parameter: usize) -> Option<String> {
    let (form, read) = form(model, link);
    let rank = read.iter().position(|&own| own == parameter)?;
    let alike: Vec<Vec<usize>> = (0..model.links.len())
        .map(|other| self::form(model, other))
        .filter(|(other, _)| *other == form)
        .map(|(_, read)| read)
        .collect();
    let common = |rank: usize| {
        let names = alike.iter().filter_map(|read| read.get(rank));
        in_common(names.map(|&index| model.parameters[index].name.as_str()))
    };
    let name = common(rank)?;
    let others = (0..read.len()).filter(|&other| other != rank);
    let is_taken = others.filter_map(common).any(|other| other == name);
    (!is_taken).then_some(name)
}

/// The formulas of a link with its parameters counted in the order in which they are read, and those parameters.
fn form(model: &Model, link: usize) -> (Vec<Option<Formula>>, Vec<usize>) {
    let mut read = Vec::new();
    let defaults = &model.links[link].defaults;
    let formulas = Value::ALL.map(|value| {
        let formula = defaults.formula(value)?;
        Some(counted(formula, &mut read))
    });
    (formulas.to_vec(), read)
}

fn counted(formula: &Formula, read: &mut Vec<usize>) -> Formula {
    let mut of = |part: &Formula| Box::new(counted(part, read));
    match formula {
        Formula::OfRobot(index, component) => {
            let rank = read.iter().position(|own| own == index);
            let rank = rank.unwrap_or_else(|| {
                read.push(*index);
                read.len() - 1
            });
            Formula::OfRobot(rank, *component)
        }
        Formula::Number(_) | Formula::Parameter(..) | Formula::OfLink(..) | Formula::Read(_) => {
            formula.clone()
        }
        Formula::Negate(a) => Formula::Negate(of(a)),
        Formula::Power(a, exponent) => Formula::Power(of(a), *exponent),
        Formula::Binary(operator, a, b) => {
            let (a, b) = (of(a), of(b));
            Formula::Binary(*operator, a, b)
        }
        Formula::Call(function, parts) => {
            Formula::Call(*function, parts.iter().map(|part| *of(part)).collect())
        }
        Formula::Vector(parts) => Formula::Vector(Box::new(parts.each_ref().map(|part| *of(part)))),
    }
}

/// The words that names begin with in common, then those that they end with; `None` where there are none.
fn in_common<'a>(names: impl Iterator<Item = &'a str>) -> Option<String> {
    let names: Vec<Vec<&str>> = names.map(|name| name.split('_').collect()).collect();
    let first = names.first()?;
    let count = |same: &dyn Fn(&[&str], usize) -> bool| {
        let shortest = names.iter().map(Vec::len).min().unwrap_or(0);
        (0..shortest)
            .take_while(|&k| names.iter().all(|name| same(name, k)))
            .count()
    };
    let begin = count(&|name, k| name[k] == first[k]);
    if begin == first.len() && names.iter().all(|name| name.len() == begin) {
        return Some(first.join("_"));
    }
    let end = count(&|name, k| name[name.len() - 1 - k] == first[first.len() - 1 - k]);
    let mut words = first[..begin].to_vec();
    words.extend(&first[first.len() - end.min(first.len() - begin)..]);
    let name = words.join("_");
    match name.len() {
        0 => None,
        // One letter is taken for a coordinate of the plate.
        1 => Some(format!("own_{name}")),
        _ => Some(name),
    }
}

#[cfg(test)]
mod tests {
    use super::in_common;

    #[test]
    fn names_have_words_in_common() {
        let common = |names: &[&str]| in_common(names.iter().copied());
        assert_eq!(common(&["angle_a", "angle_b"]).as_deref(), Some("angle"));
        assert_eq!(
            common(&["top_left_x", "bottom_right_x"]).as_deref(),
            Some("own_x")
        );
        assert_eq!(
            common(&["a_zero_one", "a_zero_two"]).as_deref(),
            Some("a_zero")
        );
        assert_eq!(common(&["radius", "radius"]).as_deref(), Some("radius"));
        assert_eq!(common(&["left", "right"]), None);
    }
}
