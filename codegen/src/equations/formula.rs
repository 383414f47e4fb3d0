//! Formulas of effects as expressions.

use tau_model_dsl::model::{BinaryOperator, Formula, Function, Readable, Value};
use tau_runtime::{Input, Owner};

use super::Context;
use crate::graph::{Elementary, Expr, Graph};

/// Place at which a formula is evaluated.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scope {
    /// Index of the effect in the variant.
    pub(super) effect: usize,
    /// The command that `q` and `direction` mean.
    pub(super) command: Option<usize>,
    /// The track whose load is read.
    pub(super) track: Option<usize>,
    /// The track that `q(source)` means.
    pub(super) source: Option<usize>,
    /// The link whose tension is read.
    pub(super) link: Option<usize>,
    /// Owner of `length`.
    pub(super) length_of: Option<Owner>,
    /// True if that command is taken as zero.
    pub(super) at_zero: bool,
    /// True if `x`, `y`, `z` are the measured position of this residual (set 1), or the TCP's elsewhere.
    pub(super) at_tcp: bool,
}

impl Scope {
    /// Outside of effects, where formulas read parameters of the machine.
    pub(super) fn nowhere() -> Self {
        Self {
            effect: usize::MAX,
            command: None,
            track: None,
            source: None,
            link: None,
            length_of: None,
            at_zero: false,
            at_tcp: false,
        }
    }
}

impl Context<'_> {
    /// A formula at the top of a term: one expression, or three for a vector.
    pub(super) fn formula(&mut self, formula: &Formula, scope: Scope) -> Vec<Expr> {
        match formula {
            Formula::Vector(components) => components
                .iter()
                .map(|component| self.scalar(component, scope))
                .collect(),
            scalar => vec![self.scalar(scalar, scope)],
        }
    }

    fn scalar(&mut self, formula: &Formula, scope: Scope) -> Expr {
        match formula {
            Formula::Number(value) => self.g.constant(*value),
            Formula::Parameter(index, component) => {
                let used = &self.variant.effects[scope.effect];
                let parameter = &self.model.effects[used.effect].parameters[*index];
                if !used.takes(*index, parameter) {
                    return self.g.constant(parameter.nominal);
                }
                let component = (parameter.components > 1).then_some(*component);
                self.parameter(Owner::Effect(scope.effect), &parameter.name, component)
            }
            Formula::OfRobot(index, component) => {
                let parameter = &self.model.parameters[*index];
                let component = (parameter.components > 1).then_some(*component);
                self.parameter(Owner::Robot, &parameter.name, component)
            }
            Formula::OfLink(value, component) => {
                let owner = scope.length_of.expect("values are read in values of links");
                match value {
                    Value::Length => self.length(owner),
                    Value::TrackDirection => self.direction_of(owner)[*component],
                    _ => self.vector_value(owner, *value)[*component],
                }
            }
            Formula::Read(readable) => self.read(*readable, scope),
            Formula::Negate(a) => {
                let a = self.scalar(a, scope);
                self.g.negate(a)
            }
            Formula::Binary(operator, a, b) => {
                let (a, b) = (self.scalar(a, scope), self.scalar(b, scope));
                match operator {
                    BinaryOperator::Add => self.g.add(a, b),
                    BinaryOperator::Subtract => self.g.subtract(a, b),
                    BinaryOperator::Multiply => self.g.multiply(a, b),
                    BinaryOperator::Divide => self.g.divide(a, b),
                }
            }
            Formula::Power(a, exponent) => {
                let a = self.scalar(a, scope);
                self.g.power(a, *exponent)
            }
            Formula::Call(function, arguments) => {
                let arguments: Vec<Expr> = arguments
                    .iter()
                    .map(|argument| self.scalar(argument, scope))
                    .collect();
                self.call(*function, &arguments)
            }
            Formula::Vector(_) => unreachable!("the checker resolves vectors into components"),
        }
    }

    fn call(&mut self, function: Function, arguments: &[Expr]) -> Expr {
        let g = &mut self.g;
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

    fn read(&mut self, readable: Readable, scope: Scope) -> Expr {
        let known = "the checker admits this quantity only where it exists";
        match readable {
            Readable::Command if scope.at_zero => self.g.constant(0.0),
            Readable::Command => self.datum(Input::Command(scope.command.expect(known))),
            Readable::CommandOf(track) => self.datum(Input::Command(track)),
            Readable::SourceCommand => self.datum(Input::Command(scope.source.expect(known))),
            Readable::Direction => self.datum(Input::Direction(scope.command.expect(known))),
            Readable::Time => self.datum(Input::Time),
            Readable::Temperature => self.datum(Input::Temperature),
            Readable::LoadAlong => self.load(scope, 0),
            Readable::LoadHorizontal => self.load(scope, 1),
            Readable::LoadVertical => self.load(scope, 2),
            Readable::Tension => self.datum(Input::Tension(scope.link.expect(known))),
            Readable::Length => self.length(scope.length_of.expect(known)),
            Readable::PaidOut => self.paid_out(scope.length_of.expect(known)),
            Readable::Position(component) if scope.at_tcp => self.datum(Input::Position(component)),
            Readable::Position(component) => self.datum(Input::TcpPosition(component)),
        }
    }

    fn load(&mut self, scope: Scope, component: usize) -> Expr {
        let track = scope.track.expect("the checker admits loads only on carts");
        self.datum(Input::Load { track, component })
    }
}
