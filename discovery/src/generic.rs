//! Unnamed rivals: smooth functions of every covariate at every place.

use tau_codegen::language::Model;
use tau_codegen::language::model::{
    Effect, EffectParameter, Formula, Function, Link, Readable, Subject, Target, Term,
};
use tau_codegen::language::units::Dimension;

/// Start of the names of unnamed families; no catalogue may use it.
pub const UNNAMED: &str = "unnamed_";

/// An unnamed family besides its effect: the quantities that it follows.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Family {
    pub(super) against: Vec<Readable>,
    pub(super) placement: Placement,
}

/// Placement of a family.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Placement {
    /// At one place.
    Single,
    /// At all places at once, with amplitudes of their own.
    PerPlace,
    /// At all places at once, with the same amplitudes.
    Shared,
}

const PLACEMENTS: [Placement; 2] = [Placement::Single, Placement::PerPlace];

/// Where families act.
type At = (Subject, Placement);
/// A target and its component.
type Axis = (Target, usize);

const SHIFT: [Axis; 3] = [
    (Target::Along, 0),
    (Target::Horizontal, 0),
    (Target::Vertical, 0),
];
const TURN: [Axis; 3] = [(Target::Roll, 0), (Target::Pitch, 0), (Target::Yaw, 0)];
const LENGTH: [Axis; 1] = [(Target::Length, 0)];
const COMMAND: [Axis; 1] = [(Target::Command, 0)];
const POSITION: [Axis; 3] = [
    (Target::Position, 0),
    (Target::Position, 1),
    (Target::Position, 2),
];
const TURN_RAD: f64 = std::f64::consts::TAU;
/// Periods of errors that repeat: racks, pinions and rails under a cart, joints and cables of a link, screws and belts that
/// lengthen one (m); gears of a crank, from a two hundredth of its turn; from a turn of a drum's motor to one of a drum behind
/// a gear of thirty (rad).
const PERIODS: [(Subject, Target, (f64, f64)); 5] = [
    (Subject::Cart, Target::Along, (4e-3, 1.0)),
    (Subject::Link, Target::Length, (50e-3, 1.0)),
    (Subject::LinkByLength, Target::Length, (1e-3, 1.0)),
    (
        Subject::LinkByAngle,
        Target::Length,
        (TURN_RAD, 30.0 * TURN_RAD),
    ),
    (
        Subject::Crank,
        Target::Command,
        (TURN_RAD / 200.0, TURN_RAD),
    ),
];

/// Functions of conditions, and the name that they have in those of families.
type Covariate = (&'static str, Vec<Formula>);

/// The first of the functions.
fn first((name, basis): &Covariate, count: usize) -> Covariate {
    (name, basis[..count].to_vec())
}

fn number(value: f64) -> Formula {
    Formula::Number(value)
}

/// A quantity over its SI unit.
fn si(readable: Readable) -> Formula {
    Formula::Read(readable) / number(1.0)
}

fn power(base: &Formula, exponent: i32) -> Formula {
    Formula::Power(Box::new(base.clone()), exponent)
}

/// The families of a robot, and the effects that they are, in the same order. So many triangles follow a track piece by
/// piece.
pub(super) fn families(model: &Model, triangle_count: usize) -> (Vec<Effect>, Vec<Family>) {
    let covariates = Covariates::of(model, triangle_count);
    let mut families = Families::default();
    let has = |subject: Subject| model.links.iter().any(|link| subject.admits(link));
    if model.guideways().next().is_some() {
        families.of_carts(&covariates);
    }
    families.of_links(&covariates);
    if has(Subject::DrivenLink) {
        families.of_driven_links(&covariates);
    }
    if model.cranks().next().is_some() {
        families.of_cranks(&covariates);
    }
    families.of_tcp(&covariates);
    families.scale();
    let is_passive = |link: &Link| link.actuated_by.is_none();
    for (subject, target, range) in PERIODS {
        // What lengthens a driven link has a range of its own.
        let is_there = match subject {
            Subject::Cart => model.guideways().next().is_some(),
            Subject::Crank => model.cranks().next().is_some(),
            Subject::Link => model.links.iter().all(is_passive),
            driven => has(driven),
        };
        if is_there {
            families.periodic(subject, target, range);
        }
    }
    let tension = &first(&covariates.tension, 1);
    families.add(
        (Subject::Link, Placement::Shared),
        &LENGTH,
        &[&covariates.temperature, tension],
    );
    (families.effects, families.list)
}

/// Functions that families follow.
struct Covariates {
    smooth: Covariate,
    stretch: Covariate,
    direction: Covariate,
    warm_travel: Covariate,
    temperature: Covariate,
    time: Covariate,
    tension: Covariate,
    load: Covariate,
    place: Covariate,
    travel: Covariate,
}

impl Covariates {
    fn of(model: &Model, triangle_count: usize) -> Self {
        use Readable::{
            Command, Direction, LoadAlong, LoadHorizontal, LoadVertical, Position, Temperature,
            Tension, Time, Travel,
        };
        // From −1 to 1 along the travel of the drive.
        let s = Formula::Read(Travel);
        let legendre = [
            s.clone(),
            (number(3.0) * power(&s, 2) - number(1.0)) / number(2.0),
            (number(5.0) * power(&s, 3) - number(3.0) * s.clone()) / number(2.0),
            (number(35.0) * power(&s, 4) - number(30.0) * power(&s, 2) + number(3.0)) / number(8.0),
        ];
        let triangle = |k: usize| {
            let width = 2.0 / (triangle_count - 1) as f64;
            let off = s.clone() - number(width * k as f64 - 1.0);
            let height = number(1.0) - Formula::Call(Function::Abs, vec![off]) / number(width);
            Formula::Call(Function::Max, vec![number(0.0), height])
        };
        let triangles: Vec<Formula> = (0..triangle_count).map(triangle).collect();
        let warm = Formula::Read(Temperature) - number(20.0);
        let side = Formula::Read(Direction);
        let axes = [0, 1, 2].map(Position);
        let product = |a: usize, b: usize| {
            Formula::Read(axes[a]) * Formula::Read(axes[b]) / power(&number(1.0), 2)
        };
        let commands: Vec<Readable> = (0..model.tracks.len()).map(Readable::CommandOf).collect();
        let mut travels: Vec<Formula> = commands.iter().copied().map(si).collect();
        for (k, &a) in commands.iter().enumerate() {
            let products = commands[k..].iter();
            travels.extend(products.map(|&b| si(a) * Formula::Read(b) / number(1.0)));
        }
        let places = [
            axes.map(si),
            axes.map(|axis| power(&si(axis), 2)),
            [product(0, 1), product(1, 2), product(2, 0)],
        ];

        let sides = vec![
            side.clone(),
            side.clone() * Formula::Read(Command) / number(1.0),
            side * power(&si(Command), 2),
        ];
        let warm_travel = vec![warm.clone() / number(1.0), si(Command) * warm / number(1.0)];
        let warm_travel = ("temperature", warm_travel);
        let loads = [LoadAlong, LoadHorizontal, LoadVertical];
        Self {
            smooth: ("q", legendre.to_vec()),
            stretch: ("stretch", triangles),
            direction: ("direction", sides),
            temperature: first(&warm_travel, 1),
            warm_travel,
            time: ("time", vec![si(Time), power(&si(Time), 2)]),
            tension: ("tension", vec![si(Tension), power(&si(Tension), 2)]),
            load: ("load", loads.map(si).to_vec()),
            place: ("position", places.concat()),
            travel: ("commands", travels),
        }
    }
}

#[derive(Default)]
struct Families {
    effects: Vec<Effect>,
    list: Vec<Family>,
}

impl Families {
    fn of_carts(&mut self, of: &Covariates) {
        let (single, per_place) = PLACEMENTS.map(|own| (Subject::Cart, own)).into();
        for axis in SHIFT.map(|axis| [axis]) {
            self.add(single, &axis, &[&of.smooth, &of.direction, &of.warm_travel]);
            self.add(single, &axis, &[&of.time, &of.load, &of.place, &of.travel]);
            self.add(single, &axis, &[&of.stretch]);
        }
        let (cubic, sides) = (&first(&of.smooth, 3), &first(&of.direction, 2));
        for axis in TURN.map(|axis| [axis]) {
            self.add(single, &axis, &[cubic, sides, &of.temperature, &of.time]);
            self.add(single, &axis, &[&of.load, &of.travel]);
        }
        for axes in [SHIFT, TURN] {
            self.add(single, &axes, &[cubic, sides, &of.load]);
        }
        let one_side = &first(sides, 1);
        self.add(per_place, &SHIFT[..1], &[&of.warm_travel, one_side, cubic]);
    }

    fn of_links(&mut self, of: &Covariates) {
        let (single, per_place) = PLACEMENTS.map(|own| (Subject::Link, own)).into();
        self.add(single, &LENGTH, &[&of.smooth, &of.stretch, &of.place]);
        self.add(single, &LENGTH, &[&of.tension, &of.temperature, &of.time]);
        let tension = &first(&of.tension, 1);
        self.add(per_place, &LENGTH, &[tension, &of.temperature]);
    }

    /// Families of a link's drive, in addition to those of any link: it reverses.
    fn of_driven_links(&mut self, of: &Covariates) {
        let (single, per_place) = PLACEMENTS.map(|own| (Subject::DrivenLink, own)).into();
        let sides = &first(&of.direction, 2);
        self.add(single, &LENGTH, &[sides]);
        self.add(per_place, &LENGTH, &[&first(sides, 1)]);
    }

    fn of_cranks(&mut self, of: &Covariates) {
        let (single, per_place) = PLACEMENTS.map(|own| (Subject::Crank, own)).into();
        let (cubic, sides) = (&first(&of.smooth, 3), &first(&of.direction, 2));
        self.add(single, &COMMAND, &[&of.smooth, &of.stretch, sides]);
        self.add(single, &COMMAND, &[&of.warm_travel, &of.time, &of.place]);
        let one_side = &first(sides, 1);
        self.add(per_place, &COMMAND, &[&of.temperature, one_side, cubic]);
    }

    fn of_tcp(&mut self, of: &Covariates) {
        let single = (Subject::Tcp, Placement::Single);
        for axis in POSITION {
            self.add(single, &[axis], &[&of.time, &of.temperature, &of.place]);
        }
        let linear = &first(&of.place, 3);
        self.add(single, &POSITION, &[&of.time, &of.temperature, linear]);
    }

    /// A family of such a name, with functions of what it follows.
    fn push(
        &mut self,
        name: &str,
        (subject, placement): At,
        basis: &[Formula],
        parameters: Vec<EffectParameter>,
        terms: Vec<Term>,
    ) {
        let word = subject.written().replace(' ', "_");
        let at = match placement {
            Placement::Single => "",
            Placement::PerPlace => "_all",
            Placement::Shared => "_common",
        };
        let mut against: Vec<Readable> = Vec::new();
        for function in basis {
            let mut read: Vec<Readable> = function.quantities().collect();
            read.dedup();
            if let [single] = read[..]
                && !against.contains(&single)
            {
                against.push(single);
            }
        }
        self.list.push(Family { against, placement });
        self.effects.push(Effect {
            name: format!("{UNNAMED}{word}{at}_{name}"),
            docs: vec![],
            subject,
            parameters,
            terms,
        });
    }

    /// Families of functions of each covariate.
    fn add(&mut self, at: At, axes: &[Axis], covariates: &[&Covariate]) {
        let covariates = covariates.iter();
        covariates.for_each(|covariate| self.add_one(at, axes, covariate));
    }

    /// Functions of a covariate along each axis, with amplitudes of its own.
    fn add_one(&mut self, at: At, axes: &[Axis], (name, basis): &Covariate) {
        let (mut parameters, mut terms) = (Vec::new(), Vec::new());
        for (k, &(target, component)) in axes.iter().enumerate() {
            let products = basis.iter().enumerate().map(|(i, function)| {
                let name = format!("c{k}_{}", i + 1);
                parameters.push(EffectParameter::amplitude(&name, target.dimension(at.0)));
                Formula::Parameter(k * basis.len() + i, 0) * function.clone()
            });
            let Some(sum) = products.reduce(|sum, next| sum + next) else {
                return;
            };
            let along = |k: usize| sum.clone() * number(f64::from(u8::from(k == component)));
            let formula = if target.is_vector() {
                Formula::Vector(Box::new([0, 1, 2].map(along)))
            } else {
                sum
            };
            terms.push(Term::new(target, formula));
        }
        let direction = match axes {
            [(target, component)] if target.is_vector() => ["x", "y", "z"][*component],
            [(target, _)] => target.name(),
            [(Target::Along, _), ..] => "shift",
            [(Target::Roll, _), ..] => "turn",
            _ => "vector",
        };
        let name = format!("{direction}_{name}");
        self.push(&name, at, basis, parameters, terms);
    }

    /// A wave over the travel of a drive.
    fn periodic(&mut self, subject: Subject, target: Target, range: (f64, f64)) {
        let amplitude = |name| EffectParameter::amplitude(name, target.dimension(subject));
        let is_angle = matches!(subject, Subject::Crank | Subject::LinkByAngle);
        let of_period = if is_angle {
            Dimension::ANGLE
        } else {
            Dimension::LENGTH
        };
        let period = EffectParameter {
            nominal: range.0 + 0.5 * (range.1 - range.0),
            search: Some(range),
            ..EffectParameter::amplitude("period", of_period)
        };
        let q = Formula::Read(Readable::Command);
        let turn = number(2.0) * number(std::f64::consts::PI);
        let angle = turn * q.clone() / Formula::Parameter(2, 0);
        let swing = |index, function| {
            Formula::Parameter(index, 0) * Formula::Call(function, vec![angle.clone()])
        };
        let formula = swing(0, Function::Sin) + swing(1, Function::Cos);
        let name = format!("{}_periodic", target.name());
        let parameters = vec![amplitude("sine"), amplitude("cosine"), period];
        let terms = vec![Term::new(target, formula)];
        let at = (subject, Placement::Single);
        self.push(&name, at, &[q], parameters, terms);
    }

    /// A displacement that grows with the distance from the origin.
    fn scale(&mut self) {
        let basis = [0, 1, 2].map(|axis| si(Readable::Position(axis)));
        let along = basis.clone().map(|own| Formula::Parameter(0, 0) * own);
        let term = Term::new(Target::Position, Formula::Vector(Box::new(along)));
        let amplitude = EffectParameter::amplitude("c", Dimension::LENGTH);
        let at = (Subject::Tcp, Placement::Single);
        self.push("scale_position", at, &basis, vec![amplitude], vec![term]);
    }
}
