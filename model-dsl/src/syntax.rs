//! The syntax tree: what was written, with the place of every part.

use std::rc::Rc;

use proc_macro2::{Ident, Span};

use crate::diagnostics::Location;
use crate::model::{Arm, BinaryOperator, Plate, TrackShape};

#[derive(Debug, Default)]
pub(crate) struct Description {
    pub(crate) robot: Option<Robot>,
    /// Effects beside the robot, in order.
    pub(crate) effects: Vec<Effect>,
}

impl Description {
    pub(crate) fn robot_name(&self) -> Option<(bool, Ident)> {
        self.robot
            .as_ref()
            .map(|robot| (robot.public, robot.name.clone()))
    }
}

#[derive(Debug)]
pub(crate) struct Robot {
    pub(crate) docs: Vec<String>,
    pub(crate) public: bool,
    pub(crate) name: Ident,
    pub(crate) plates: Vec<(Plate, Location)>,
    pub(crate) parameters: Vec<Parameters>,
    pub(crate) tracks: Vec<Track>,
    pub(crate) clusters: Vec<Cluster>,
    pub(crate) effects: Vec<Effect>,
    pub(crate) variants: Vec<Variant>,
    pub(crate) references: Vec<Reference>,
}

/// `reference { position = (0, 0, 0.8) m; }`
#[derive(Debug)]
pub(crate) struct Reference {
    /// The word `reference`.
    pub(crate) location: Location,
    /// `commands`, `position` or `orientation`, with its value.
    pub(crate) values: Vec<(Ident, Vec<Quantity>)>,
}

#[derive(Debug)]
pub(crate) struct Cluster {
    pub(crate) name: Ident,
    /// A track or `base`.
    pub(crate) place: Ident,
    pub(crate) links: Vec<Links>,
}

/// `link a, b actuated length { … }`
#[derive(Debug)]
pub(crate) struct Links {
    pub(crate) names: Vec<Ident>,
    /// The words `actuated length` or `actuated angle`; true for the latter.
    pub(crate) actuated: Option<(bool, Location)>,
    pub(crate) values: Vec<NamedValue>,
    /// `pulled;`, `pulled = 20 N tol 1 N;`
    pub(crate) pulls: Vec<NamedValue>,
}

/// `track one;`, `crank one { axis = (0, 1, 0); }`
#[derive(Debug)]
pub(crate) struct Track {
    pub(crate) name: Ident,
    /// Values of a crank, which those that are declared together share.
    pub(crate) crank: Option<Rc<Vec<NamedValue>>>,
}

/// `length = 2.04 m tol 0.3 mm;`, `length = arm;`, `length = 2 m exact;`
#[derive(Debug)]
pub(crate) struct NamedValue {
    pub(crate) name: Ident,
    pub(crate) value: Option<Given>,
    pub(crate) tolerance: Option<Quantity>,
    /// The word `exact`.
    pub(crate) exact: Option<Location>,
}

#[derive(Debug)]
pub(crate) enum Given {
    Quantity(Quantity),
    Formula(Expression),
}

/// One number or three, with a unit.
#[derive(Debug)]
pub(crate) struct Quantity {
    pub(crate) numbers: Vec<f64>,
    pub(crate) unit: Option<UnitExpression>,
    pub(crate) location: Location,
}

impl Quantity {
    /// True if its unit is this one.
    pub(crate) fn is_in(&self, unit: &str) -> bool {
        let factors = self.unit.as_ref().map(|own| &own.factors[..]);
        matches!(factors, Some([one]) if one.name == unit && one.exponent == 1)
    }
}

/// A product of powers of units, or of dimensions where one is wanted.
#[derive(Debug)]
pub(crate) struct UnitExpression {
    pub(crate) factors: Vec<UnitFactor>,
    pub(crate) location: Location,
}

#[derive(Debug)]
pub(crate) struct UnitFactor {
    pub(crate) name: Ident,
    pub(crate) exponent: i32,
}

#[derive(Debug)]
pub(crate) struct Effect {
    pub(crate) docs: Vec<String>,
    pub(crate) name: Ident,
    /// The word `driven` or `pulled` before its subject.
    pub(crate) kind: Option<Ident>,
    /// `cart`, `link`, `crank`, `base` (of `base joint`) or `tcp`.
    pub(crate) subject: Ident,
    /// `actuated length` or `actuated angle`: the word `actuated`, and true for an angle.
    pub(crate) actuated: Option<(Ident, bool)>,
    /// `from source`.
    pub(crate) source: Option<Ident>,
    pub(crate) parameters: Vec<Parameters>,
    pub(crate) terms: Vec<Term>,
}

/// `param a, b[3]: length = 0 mm tol 1 mm;` or `search p: length in 4 mm ..= 50 mm;`
#[derive(Debug)]
pub(crate) struct Parameters {
    /// `optional param …`
    pub(crate) optional: bool,
    pub(crate) names: Vec<ParameterName>,
    pub(crate) dimension: UnitExpression,
    pub(crate) nominal: Option<Quantity>,
    pub(crate) tolerance: Option<Quantity>,
    /// The word `exact`.
    pub(crate) exact: Option<Location>,
    pub(crate) search: Option<(Quantity, Quantity)>,
}

#[derive(Debug)]
pub(crate) struct ParameterName {
    pub(crate) name: Ident,
    /// The number in brackets, with its place.
    pub(crate) components: Option<(u64, Location)>,
}

#[derive(Debug)]
pub(crate) struct Term {
    pub(crate) target: Ident,
    pub(crate) formula: Expression,
}

#[derive(Debug)]
pub(crate) struct Expression {
    pub(crate) kind: ExpressionKind,
    pub(crate) location: Location,
}

#[derive(Debug)]
pub(crate) enum ExpressionKind {
    Number(f64),
    /// `20 K`, `3 m^2`
    Measure(f64, UnitFactor),
    Name(Ident),
    /// `rate[0]`
    Component(Ident, u64),
    /// `sin(a)`, `q(two)`
    Call(Ident, Vec<Expression>),
    Negate(Box<Expression>),
    Binary(BinaryOperator, Box<Expression>, Box<Expression>),
    Power(Box<Expression>, i32),
    Tuple(Vec<Expression>),
}

#[derive(Debug)]
pub(crate) struct Variant {
    pub(crate) docs: Vec<String>,
    pub(crate) name: Ident,
    pub(crate) body: VariantBody,
}

#[derive(Debug)]
pub(crate) enum VariantBody {
    Own(Vec<VariantLine>),
    /// `= Base + effect(place) + …;`
    Derived {
        base: Ident,
        effects: Vec<EffectUse>,
        holds: Vec<Held>,
    },
}

#[derive(Debug)]
pub(crate) enum VariantLine {
    Arm {
        arm: Arm,
        location: Location,
    },
    Tracks {
        track: Option<Ident>,
        shape: TrackShape,
        per_link: Option<Location>,
        location: Location,
    },
    /// `hold radius, l1.length;`
    Hold(Vec<Held>),
}

/// `radius`, `l1.length` or `all.plate_joint`
#[derive(Debug)]
pub(crate) struct Held {
    /// The parameter, or the link.
    pub(crate) name: Ident,
    pub(crate) value: Option<Ident>,
    pub(crate) location: Location,
}

#[derive(Debug)]
pub(crate) struct EffectUse {
    pub(crate) effect: Ident,
    pub(crate) places: Vec<Ident>,
    /// `with a, b`: optional parameters that it takes.
    pub(crate) with: Vec<Ident>,
    /// `tol * 10`: tolerances of its parameters, in those of the effect.
    pub(crate) tolerance_factor: Option<(f64, Span)>,
    pub(crate) location: Location,
}
