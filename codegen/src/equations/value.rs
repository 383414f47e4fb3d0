//! Values of links and cranks: parameters of their own, or formulas.

use tau_model_dsl::model::{Crank, CrankValue, Formula, Value};
use tau_runtime::Owner;

use super::Context;
use super::formula::{Reading, Scope};
use crate::graph::Expr;
use crate::vector::Vector;

impl<'a> Context<'a> {
    /// `length` of a link or cluster, as effects read it; that of a link may follow from its command.
    pub(super) fn length(&mut self, owner: Owner) -> Expr {
        self.length_by(owner, Reading::Commanded)
    }

    /// The same at the command with the errors that effects add.
    pub(super) fn driven_length(&mut self, owner: Owner) -> Expr {
        self.length_by(owner, Reading::Driven)
    }

    fn length_by(&mut self, owner: Owner, reading: Reading) -> Expr {
        match self.formula_of(owner, Value::Length) {
            Some(formula) => {
                let scope = self.scope_of(owner);
                self.of_machine(formula, scope, reading)[0]
            }
            None => self.parameter(owner, "length", None),
        }
    }

    /// Joint of a link or cluster on the base, or centre of a crank, without effects (m).
    pub(super) fn base(&mut self, of: Owner) -> Vector {
        match of {
            Owner::Crank(track) => self.crank_value(track, CrankValue::Centre),
            joint => self.vector_value(joint, Value::TrackOffset),
        }
    }

    /// Length of a link beyond that at command zero; nothing where no formula says how it follows from the command.
    pub(super) fn paid_out(&mut self, owner: Owner) -> Expr {
        let Some(formula) = self.formula_of(owner, Value::Length) else {
            return self.g.constant(0.0);
        };
        let scope = self.scope_of(owner);
        let [length, at_zero] = [Reading::Commanded, Reading::AtZero]
            .map(|reading| self.of_machine(formula, scope, reading)[0]);
        self.g.subtract(length, at_zero)
    }

    /// A vector of a link or cluster.
    pub(super) fn vector_value(&mut self, owner: Owner, value: Value) -> Vector {
        match self.formula_of(owner, value) {
            Some(formula) => {
                let scope = self.scope_of(owner);
                self.vector_formula(formula, scope)
            }
            None => self.vector_parameter(owner, value.name()),
        }
    }

    /// A vector of a crank.
    pub(super) fn crank_value(&mut self, track: usize, value: CrankValue) -> Vector {
        let model = self.model;
        let crank = model.tracks[track].crank.as_ref();
        match crank.and_then(|crank: &Crank| crank.formula(value)) {
            Some(formula) => self.vector_formula(formula, Scope::default()),
            None => self.vector_parameter(Owner::Crank(track), value.name()),
        }
    }

    /// The formula that a value of a link is; clusters have none.
    pub(super) fn formula_of(&self, owner: Owner, value: Value) -> Option<&'a Formula> {
        let model = self.model;
        match owner {
            Owner::Link(link) => model.links[link].defaults.formula(value),
            _ => None,
        }
    }

    fn vector_formula(&mut self, formula: &Formula, scope: Scope) -> Vector {
        let components = self.of_machine(formula, scope, Reading::Commanded);
        components
            .try_into()
            .unwrap_or_else(|_| unreachable!("the checker admits only vectors here"))
    }

    fn scope_of(&self, owner: Owner) -> Scope {
        let command = match owner {
            Owner::Link(link) => self.model.links[link].actuated_by,
            _ => None,
        };
        Scope {
            command,
            length_of: Some(owner),
            ..Scope::default()
        }
    }
}
