//! Formulas of a description, and the forces that they read: linear in the pulls that are parameters.

use num_dual::{Dual64, DualNum};
use tau::robot::{Input, Owner};
use tau_model_dsl::model::{BinaryOperator, CrankValue, Formula, Function, Readable, Value};

use super::Reference;
use super::matrices::V;

/// What the names of a formula stand for.
#[derive(Clone, Copy, Default)]
pub(super) struct Scope {
    pub(super) effect: usize,
    pub(super) command: Option<usize>,
    pub(super) track: Option<usize>,
    pub(super) source: Option<usize>,
    pub(super) link: Option<usize>,
    pub(super) length_of: Option<Owner>,
    pub(super) at_zero: bool,
    /// True if the command is what the drive makes of it.
    pub(super) driven: bool,
    pub(super) base_of: Option<Owner>,
    pub(super) set_one: bool,
}

impl Reference<'_> {
    pub(super) fn formulas(&self, formula: &Formula, scope: Scope) -> V {
        match formula {
            Formula::Vector(parts) => V::from_fn(|k, _| self.formula(&parts[k], scope)),
            other => panic!("{other:?} is no vector"),
        }
    }

    pub(super) fn formula(&self, formula: &Formula, scope: Scope) -> Dual64 {
        let of = |formula: &Formula| self.formula(formula, scope);
        match formula {
            Formula::Number(value) => Dual64::from(*value),
            Formula::Parameter(index, component) => {
                let used = &self.described.effects[scope.effect];
                let parameter = &self.model.effects[used.effect].parameters[*index];
                if parameter.optional && !used.with.contains(index) {
                    return Dual64::from(parameter.nominal);
                }
                let component = (parameter.components == 3).then_some(*component);
                self.parameter(Owner::Effect(scope.effect), &parameter.name, component)
            }
            Formula::OfRobot(index, component) => {
                let parameter = &self.model.parameters[*index];
                let component = (parameter.components == 3).then_some(*component);
                self.parameter(Owner::Robot, &parameter.name, component)
            }
            Formula::OfLink(value, component) => match (scope.length_of.unwrap(), value) {
                (owner, Value::Length) => self.length(owner),
                (owner, value) => self.value(owner, *value)[*component],
            },
            Formula::Negate(a) => -of(a),
            Formula::Binary(operator, a, b) => match operator {
                BinaryOperator::Add => of(a) + of(b),
                BinaryOperator::Subtract => of(a) - of(b),
                BinaryOperator::Multiply => of(a) * of(b),
                BinaryOperator::Divide => of(a) / of(b),
            },
            Formula::Power(a, n) => of(a).powi(*n),
            Formula::Call(function, arguments) => {
                let (a, b) = (of(&arguments[0]), || of(&arguments[1]));
                match function {
                    Function::Sin => a.sin(),
                    Function::Cos => a.cos(),
                    Function::Tan => a.tan(),
                    Function::Atan => a.atan(),
                    Function::Exp => a.exp(),
                    Function::Ln => a.ln(),
                    Function::Tanh => a.tanh(),
                    Function::Sqrt => a.sqrt(),
                    Function::Abs if a.re < 0.0 => -a,
                    Function::Sign => Dual64::from(if a.re < 0.0 { -1.0 } else { 1.0 }),
                    Function::Min if b().re < a.re => b(),
                    Function::Max if a.re < b().re => b(),
                    Function::Abs | Function::Min | Function::Max => a,
                }
            }
            Formula::Read(readable) => self.read(*readable, scope),
            Formula::Vector(_) => panic!("a vector inside a scalar"),
        }
    }

    fn read(&self, readable: Readable, scope: Scope) -> Dual64 {
        let load = |component| self.load(scope.track.unwrap(), component);
        match readable {
            Readable::Command if scope.at_zero => Dual64::from(0.0),
            Readable::Command if scope.driven => self.driven(scope.command.unwrap()),
            Readable::Command => self.datum(Input::Command(scope.command.unwrap())),
            Readable::Travel => {
                let command = scope.command.unwrap();
                let of = |input: fn(usize) -> Input| self.datum(input(command));
                (of(Input::Command) - of(Input::TravelMiddle)) / of(Input::TravelHalf)
            }
            Readable::Base(i) => match scope.base_of.unwrap() {
                Owner::Crank(track) => self.crank(track, CrankValue::Centre)[i],
                joint => self.value(joint, Value::TrackOffset)[i],
            },
            Readable::CommandOf(track) => self.datum(Input::Command(track)),
            Readable::SourceCommand => self.datum(Input::Command(scope.source.unwrap())),
            Readable::Direction => self.datum(Input::Direction(scope.command.unwrap())),
            Readable::Time => self.datum(Input::Time),
            Readable::Temperature => self.datum(Input::Temperature),
            Readable::LoadAlong => load(0),
            Readable::LoadHorizontal => load(1),
            Readable::LoadVertical => load(2),
            Readable::Tension => self.tension(scope.link.unwrap()),
            Readable::Length => self.length(scope.length_of.unwrap()),
            Readable::PaidOut => {
                let owner = scope.length_of.unwrap();
                let at_zero = Scope {
                    at_zero: true,
                    ..self.of_link(owner)
                };
                let formula = self.derived(owner, Value::Length).unwrap();
                self.length(owner) - self.formula(formula, at_zero)
            }
            Readable::Position(i) if scope.set_one => self.datum(Input::Position(i)),
            Readable::Position(i) => self.datum(Input::TcpPosition(i)),
        }
    }

    fn tension(&self, link: usize) -> Dual64 {
        let by_pull = |pulled| Input::TensionByPull { link, pulled };
        self.force(Input::Tension(link), by_pull)
    }

    fn load(&self, track: usize, component: usize) -> Dual64 {
        let by_pull = |pulled| Input::LoadByPull {
            track,
            component,
            pulled,
        };
        self.force(Input::Load { track, component }, by_pull)
    }

    fn force(&self, stated: Input, by_pull: impl Fn(usize) -> Input) -> Dual64 {
        let mut force = self.datum(stated);
        for (pulled, link) in self.model.links.iter().enumerate() {
            let pull = link.pull.as_ref();
            if pull.is_some_and(|pull| pull.tolerance.is_some()) {
                let pull = self.parameter(Owner::Link(pulled), "pull", None);
                force += (pull - self.datum(Input::Pull(pulled))) * self.datum(by_pull(pulled));
            }
        }
        force
    }
}
