//! Formulas as expressions.
//!
//! One reading of the language for all that runs a formula: residuals of machines ([`Context`]), and terms of effects by
//! themselves ([`crate::term`]).

use tau_model_dsl::model::{BinaryOperator, Formula, Function, Readable, Value};
use tau_runtime::{Input, Owner};

use super::Context;
use super::parameters::{PULL, uncertain_pulls};
use crate::graph::{Elementary, Expr, Graph};

/// Meaning of a formula's words at a place.
#[derive(Debug, Clone, Copy, Default)]
pub struct Scope {
    /// The command that `q`, `travel` and `direction` mean.
    pub command: Option<usize>,
    /// The track whose load is read.
    pub track: Option<usize>,
    /// The track that `q(source)` means.
    pub source: Option<usize>,
    /// The link whose tension is read.
    pub link: Option<usize>,
    /// Owner of `length`.
    pub length_of: Option<Owner>,
    /// Link, cluster or crank whose base joint or centre is read.
    pub base_of: Option<Owner>,
    /// True if `x`, `y`, `z` are the measured position of this residual (set 1), or the TCP's elsewhere.
    pub at_tcp: bool,
}

impl Scope {
    /// The datum that a quantity is; `None` for travels, which are two more, for lengths and base joints, which are values
    /// of the machine, and for what does not exist here.
    pub fn input(&self, readable: Readable) -> Option<Input> {
        let load = |component| {
            let track = self.track?;
            Some(Input::Load { track, component })
        };
        match readable {
            Readable::Command => self.command.map(Input::Command),
            Readable::CommandOf(track) => Some(Input::Command(track)),
            Readable::SourceCommand => self.source.map(Input::Command),
            Readable::Direction => self.command.map(Input::Direction),
            Readable::Time => Some(Input::Time),
            Readable::Temperature => Some(Input::Temperature),
            Readable::LoadAlong => load(0),
            Readable::LoadHorizontal => load(1),
            Readable::LoadVertical => load(2),
            Readable::Tension => self.link.map(Input::Tension),
            Readable::Position(component) if self.at_tcp => Some(Input::Position(component)),
            Readable::Position(component) => Some(Input::TcpPosition(component)),
            Readable::Travel | Readable::Length | Readable::PaidOut | Readable::Base(_) => None,
        }
    }
}

/// Parameters and quantities that formulas are made of, as expressions of a graph.
pub(crate) trait Leaves {
    /// The graph.
    fn graph(&mut self) -> &mut Graph;
    /// A parameter, or a quantity that is read.
    fn leaf(&mut self, leaf: &Formula) -> Expr;
}

/// The components of a formula at the top of a term: itself, or three of a vector.
pub(crate) fn components(formula: &Formula) -> &[Formula] {
    match formula {
        Formula::Vector(components) => &components[..],
        scalar => std::slice::from_ref(scalar),
    }
}

/// A scalar formula as an expression.
pub(crate) fn scalar(formula: &Formula, leaves: &mut impl Leaves) -> Expr {
    match formula {
        Formula::Number(value) => leaves.graph().constant(*value),
        Formula::Parameter(..) | Formula::OfRobot(..) | Formula::OfLink(..) | Formula::Read(_) => {
            leaves.leaf(formula)
        }
        Formula::Negate(a) => {
            let a = scalar(a, leaves);
            leaves.graph().negate(a)
        }
        Formula::Binary(operator, a, b) => {
            let (a, b) = (scalar(a, leaves), scalar(b, leaves));
            let g = leaves.graph();
            match operator {
                BinaryOperator::Add => g.add(a, b),
                BinaryOperator::Subtract => g.subtract(a, b),
                BinaryOperator::Multiply => g.multiply(a, b),
                BinaryOperator::Divide => g.divide(a, b),
            }
        }
        Formula::Power(a, exponent) => {
            let a = scalar(a, leaves);
            leaves.graph().power(a, *exponent)
        }
        Formula::Call(function, arguments) => {
            let arguments: Vec<Expr> = (arguments.iter())
                .map(|argument| scalar(argument, leaves))
                .collect();
            call(leaves.graph(), *function, &arguments)
        }
        Formula::Vector(_) => unreachable!("the checker resolves vectors into components"),
    }
}

fn call(g: &mut Graph, function: Function, arguments: &[Expr]) -> Expr {
    let a = arguments[0];
    let sign = |g: &mut Graph| {
        let (zero, one) = (g.constant(0.0), g.constant(1.0));
        let minus_one = g.negate(one);
        g.select(a, zero, minus_one, one)
    };
    let elementary = match function {
        Function::Sin => Elementary::Sin,
        Function::Cos => Elementary::Cos,
        Function::Tan => Elementary::Tan,
        Function::Atan => Elementary::Atan,
        Function::Exp => Elementary::Exp,
        Function::Ln => Elementary::Ln,
        Function::Tanh => Elementary::Tanh,
        Function::Sqrt => Elementary::Sqrt,
        // A select between `-a` and `a` would have both differentiated, and what is nested in them
        // twice as often at every level.
        Function::Abs => {
            let sign = sign(g);
            return g.multiply(a, sign);
        }
        Function::Sign => return sign(g),
        Function::Min => return g.select(arguments[1], a, arguments[1], a),
        Function::Max => return g.select(a, arguments[1], arguments[1], a),
    };
    g.apply(elementary, a)
}

/// A formula of a machine, or of an effect that a variant has, at a place.
struct Placed<'c, 'm> {
    context: &'c mut Context<'m>,
    scope: Scope,
    /// Index of the effect in the variant.
    effect: Option<usize>,
    /// The command that values of the machine follow.
    reading: Reading,
}

/// The command that values of the machine follow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Reading {
    /// As it stands in the data that effects read.
    Commanded,
    /// With what effects make the drive add to it.
    Driven,
    /// Zero.
    AtZero,
}

impl Leaves for Placed<'_, '_> {
    fn graph(&mut self) -> &mut Graph {
        &mut self.context.g
    }

    fn leaf(&mut self, leaf: &Formula) -> Expr {
        let scope = self.scope;
        let context = &mut *self.context;
        match leaf {
            Formula::Parameter(index, component) => {
                let effect = self.effect.expect("parameters are read in effects");
                let used = &context.variant.effects[effect];
                let parameter = &context.model.effects[used.effect].parameters[*index];
                if !used.takes(*index, parameter) {
                    return context.g.constant(parameter.nominal);
                }
                let component = (parameter.components > 1).then_some(*component);
                context.parameter(Owner::Effect(effect), &parameter.name, component)
            }
            Formula::OfRobot(index, component) => {
                let parameter = &context.model.parameters[*index];
                let component = (parameter.components > 1).then_some(*component);
                context.parameter(Owner::Robot, &parameter.name, component)
            }
            Formula::OfLink(value, component) => {
                let owner = scope.length_of.expect("values are read in values of links");
                match value {
                    Value::Length => context.length(owner),
                    Value::TrackDirection => context.direction_of(owner)[*component],
                    _ => context.vector_value(owner, *value)[*component],
                }
            }
            Formula::Read(readable) => {
                let known = "the checker admits this quantity only where it exists";
                match readable {
                    Readable::Command if self.reading == Reading::AtZero => context.g.constant(0.0),
                    Readable::Command if self.reading == Reading::Driven => {
                        context.driven(scope.command.expect(known))
                    }
                    Readable::Travel => context.travel(scope.command.expect(known)),
                    Readable::Base(component) => {
                        context.base(scope.base_of.expect(known))[*component]
                    }
                    Readable::Length => context.length(scope.length_of.expect(known)),
                    Readable::PaidOut => context.paid_out(scope.length_of.expect(known)),
                    _ => {
                        let input = scope.input(*readable).expect(known);
                        let datum = context.datum(input);
                        context.at_pulls(input, datum)
                    }
                }
            }
            _ => unreachable!("no leaf: {leaf:?}"),
        }
    }
}

impl Context<'_> {
    /// A datum as it stands; of a force, what it is at the tensions to which links are pulled, where these are parameters:
    /// forces are linear in them.
    fn at_pulls(&mut self, input: Input, datum: Expr) -> Expr {
        let by_pull = |pulled: usize| match input {
            Input::Tension(link) => Some(Input::TensionByPull { link, pulled }),
            Input::Load { track, component } => Some(Input::LoadByPull {
                track,
                component,
                pulled,
            }),
            _ => None,
        };
        let mut force = datum;
        for pulled in uncertain_pulls(self.model) {
            let Some(by_pull) = by_pull(pulled) else {
                break;
            };
            let pull = self.parameter(Owner::Link(pulled), PULL, None);
            let stated = self.datum(Input::Pull(pulled));
            let by_pull = self.datum(by_pull);
            let more = self.g.subtract(pull, stated);
            let more = self.g.multiply(by_pull, more);
            force = self.g.add(force, more);
        }
        force
    }

    /// A formula of an effect (index in the variant): one expression, or three for a vector.
    pub(super) fn of_effect(
        &mut self,
        effect: usize,
        formula: &Formula,
        scope: Scope,
    ) -> Vec<Expr> {
        self.placed(formula, scope, Some(effect), Reading::Commanded)
    }

    /// A formula that a value of the machine is.
    pub(super) fn of_machine(
        &mut self,
        formula: &Formula,
        scope: Scope,
        reading: Reading,
    ) -> Vec<Expr> {
        self.placed(formula, scope, None, reading)
    }

    /// A command as a number: from -1 to 1 over the travel of its drive.
    fn travel(&mut self, command: usize) -> Expr {
        let inputs = [
            Input::Command(command),
            Input::TravelMiddle(command),
            Input::TravelHalf(command),
        ];
        let [q, middle, half] = inputs.map(|input| self.datum(input));
        let off = self.g.subtract(q, middle);
        self.g.divide(off, half)
    }

    fn placed(
        &mut self,
        formula: &Formula,
        scope: Scope,
        effect: Option<usize>,
        reading: Reading,
    ) -> Vec<Expr> {
        let mut placed = Placed {
            context: self,
            scope,
            effect,
            reading,
        };
        (components(formula).iter())
            .map(|component| scalar(component, &mut placed))
            .collect()
    }
}
