//! Formulas that have no value where the description says all that they hold.

use crate::diagnostics::Diagnostics;
use crate::model::{Formula, LinkDefaults, RobotParameter, Value};
use crate::syntax;

/// Reports values of a link that are not finite at the nominal values of the parameters: no machine has them. What reads
/// the command is known to none.
pub(super) fn values(
    links: &syntax::Links,
    defaults: &LinkDefaults,
    parameters: &[RobotParameter],
    diagnostics: &mut Diagnostics,
) {
    let nominal = Nominal {
        defaults,
        parameters,
    };
    for one in &links.values {
        let value = Value::find(&one.name.to_string());
        let Some(formula) = value.and_then(|value| defaults.formula(value)) else {
            continue;
        };
        if nominal
            .components(formula)
            .any(|number| !number.is_finite())
        {
            error!(diagnostics, NOT_FINITE, &one.name;
                "`{}` is not a finite number at the values of the parameters", one.name;
                "compare them with the formula: the root of a negative number or a division by zero has no value");
        }
    }
}

/// Numbers that a description gives.
struct Nominal<'a> {
    defaults: &'a LinkDefaults,
    parameters: &'a [RobotParameter],
}

impl Nominal<'_> {
    /// Those of a formula that are known.
    fn components<'f>(&'f self, formula: &'f Formula) -> impl Iterator<Item = f64> + 'f {
        let components: &[Formula] = match formula {
            Formula::Vector(components) => &components[..],
            scalar => std::slice::from_ref(scalar),
        };
        let known = |part: &Formula| part.value(&|leaf| self.leaf(leaf));
        components.iter().filter_map(known)
    }

    fn leaf(&self, leaf: &Formula) -> Option<f64> {
        match *leaf {
            Formula::OfRobot(index, component) => {
                let values = self.parameters.get(index)?.nominal.as_ref()?;
                values.get(component).copied()
            }
            Formula::OfLink(value, component) => match self.defaults.formula(value) {
                Some(Formula::Vector(components)) => {
                    components[component].value(&|leaf| self.leaf(leaf))
                }
                Some(scalar) => scalar.value(&|leaf| self.leaf(leaf)),
                None => self.stated(value, component),
            },
            _ => None,
        }
    }

    fn stated(&self, value: Value, component: usize) -> Option<f64> {
        let given = self.defaults;
        let vector = match value {
            Value::Length => return Some(given.length.value?[0]),
            Value::PlateJoint => given.plate_joint.value,
            Value::TrackOffset => given.track_offset.value,
            Value::TrackDirection => given.track_direction.value,
        };
        Some(vector?[component])
    }
}
