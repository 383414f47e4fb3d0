//! Symbols of one set of equations, created as they are read.

use std::collections::BTreeMap;

use tau_model_dsl::model::{Model, Variant};
use tau_runtime::{Input, Owner};

use super::Parameter;
use super::parameters::{PULL, uncertain_pulls};
use super::roles::role;
use crate::graph::{Expr, Graph, Node, Stage, Symbol};
use crate::vector::Vector;

/// Treatment of data-only work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Staging {
    /// Data-only work goes into `prepare`.
    Staged,
    /// Everything in one program.
    Unstaged,
}

/// Workspace of equations: a graph and the symbols made so far.
#[derive(Debug)]
pub struct Context<'a> {
    pub(super) model: &'a Model,
    pub(super) variant: &'a Variant,
    table: &'a [Parameter],
    staging: Staging,
    pub(super) g: Graph,
    pub(super) parameters: BTreeMap<usize, Expr>,
    pub(super) data: BTreeMap<Input, Expr>,
    /// Translation that the plate is moved by from the pose among the data.
    pub(super) shift: Option<Vector>,
    /// The link or cluster that the closure is of; its parameters need no qualification.
    pub(super) own: Option<Owner>,
    /// The track whose command is plain `q`.
    pub(super) own_command: Option<usize>,
}

impl<'a> Context<'a> {
    /// An empty graph for equations of a variant with the given parameters.
    pub fn new(
        model: &'a Model,
        variant: &'a Variant,
        table: &'a [Parameter],
        staging: Staging,
    ) -> Self {
        Self {
            model,
            variant,
            table,
            staging,
            g: Graph::new(),
            parameters: BTreeMap::new(),
            data: BTreeMap::new(),
            shift: None,
            own: None,
            own_command: None,
        }
    }

    /// The symbol of a parameter.
    pub(super) fn parameter(
        &mut self,
        owner: Owner,
        quantity: &str,
        component: Option<usize>,
    ) -> Expr {
        let index = self
            .table
            .iter()
            .position(|p| p.owner == owner && p.quantity == quantity && p.component == component)
            .unwrap_or_else(|| {
                unreachable!("{owner:?} has {quantity} in every variant that reads it")
            });
        if let Some(&symbol) = self.parameters.get(&index) {
            return symbol;
        }
        if self.table[index].is_held(self.model, self.variant) {
            return self.datum(Input::Held(index));
        }
        let name = self.local_name(&self.table[index]);
        let symbol = self.g.symbol(name, Stage::Parameter);
        self.parameters.insert(index, symbol);
        symbol
    }

    /// The three components of a vector parameter.
    pub(super) fn vector_parameter(&mut self, owner: Owner, quantity: &str) -> Vector {
        [0, 1, 2].map(|component| self.parameter(owner, quantity, Some(component)))
    }

    /// Name inside the family: by role, so that links of the same form share one family.
    fn local_name(&self, info: &Parameter) -> String {
        let mut name = match info.owner {
            Owner::Link(link) if info.quantity == PULL => self.pull_name(link),
            owner if Some(owner) == self.own => info.quantity.clone(),
            Owner::Link(link) => {
                let siblings = self.model.clusters[self.model.links[link].cluster]
                    .track
                    .map_or_else(Vec::new, |track| self.model.links_of_track(track));
                match siblings.iter().position(|&sibling| sibling == link) {
                    Some(role) if siblings.len() > 1 => {
                        format!("joint{}_{}", role + 1, info.quantity)
                    }
                    _ => info.quantity.clone(),
                }
            }
            Owner::Cluster(cluster) => {
                let siblings = self.model.clusters[cluster]
                    .track
                    .map_or_else(Vec::new, |track| self.model.clusters_of_track(track));
                match siblings.iter().position(|&sibling| sibling == cluster) {
                    Some(role) if siblings.len() > 1 => {
                        format!("joint{}_{}", role + 1, info.quantity)
                    }
                    _ => info.quantity.clone(),
                }
            }
            Owner::Track(_) => info.quantity.clone(),
            Owner::Robot => self.role_of(&info.quantity),
            Owner::Crank(_) => format!("crank_{}", info.quantity),
            Owner::Effect(index) => {
                let effect = &self.model.effects[self.variant.effects[index].effect];
                format!("{}_{}", effect.name, info.quantity)
            }
            Owner::Frame(_) => format!("frame_{}", info.quantity),
            Owner::Target { .. } => format!("target_{}", info.quantity),
        };
        if let Some(component) = info.component {
            name.push_str(["_x", "_y", "_z"][component]);
        }
        name
    }

    /// Name of the tension to which a link is pulled, the same whichever link the equations are of.
    fn pull_name(&self, link: usize) -> String {
        let before = uncertain_pulls(self.model).filter(|&pulled| pulled < link);
        format!("{PULL}{}", before.count() + 1)
    }

    /// Name of a parameter of the machine by its role for the link that the equations are of.
    fn role_of(&self, name: &str) -> String {
        let link = match self.own {
            Some(Owner::Link(link)) => Some(link),
            _ => None,
        };
        let index = self
            .model
            .parameters
            .iter()
            .position(|own| own.name == name);
        let role = link
            .zip(index)
            .and_then(|(link, index)| role(self.model, link, index));
        role.unwrap_or_else(|| name.to_owned())
    }

    /// The symbol of a datum.
    pub(super) fn datum(&mut self, input: Input) -> Expr {
        let symbol = self.datum_symbol(input);
        match (self.shift, input) {
            (Some(shift), Input::Position(component)) => self.g.add(symbol, shift[component]),
            _ => symbol,
        }
    }

    fn datum_symbol(&mut self, input: Input) -> Expr {
        if let Some(&symbol) = self.data.get(&input) {
            return symbol;
        }
        let stage = match self.staging {
            Staging::Staged => Stage::Data,
            Staging::Unstaged => Stage::Parameter,
        };
        let name = self.input_name(input);
        let symbol = self.g.symbol(name, stage);
        self.data.insert(input, symbol);
        symbol
    }

    /// Three data by component.
    pub(super) fn vector_datum(&mut self, input: impl Fn(usize) -> Input) -> Vector {
        [0, 1, 2].map(|component| self.datum(input(component)))
    }

    fn input_name(&self, input: Input) -> String {
        let axis = |component: usize| ["x", "y", "z"][component];
        let qualified = |what: &str, command: usize| {
            if self.own_command == Some(command) {
                what.to_owned()
            } else {
                format!("{what}{}", command + 1)
            }
        };
        match input {
            Input::Command(command) => qualified("q", command),
            Input::Direction(command) => qualified("direction", command),
            Input::Position(component) => axis(component).into(),
            Input::Angle(component) => ["alpha", "beta", "gamma"][component].into(),
            Input::Rotation(entry) => format!("r_{}{}", axis(entry / 3), axis(entry % 3)),
            Input::TcpPosition(component) => format!("tcp_{}", axis(component)),
            Input::Time => "time".into(),
            Input::Temperature => "temperature".into(),
            Input::Load { component, .. } => {
                ["load_along", "load_horizontal", "load_vertical"][component].into()
            }
            Input::Tension(_) => "tension".into(),
            Input::Pull(link) => format!("stated_{}", self.pull_name(link)),
            Input::TensionByPull { pulled, .. } => {
                format!("tension_by_{}", self.pull_name(pulled))
            }
            Input::LoadByPull {
                component, pulled, ..
            } => {
                let load = ["load_along", "load_horizontal", "load_vertical"][component];
                format!("{load}_by_{}", self.pull_name(pulled))
            }
            Input::SegmentStart { component, .. } => format!("segment_start_{}", axis(component)),
            Input::SegmentEnd { component, .. } => format!("segment_end_{}", axis(component)),
            Input::SegmentStartCommand(_) => "segment_start_q".into(),
            Input::SegmentEndCommand(_) => "segment_end_q".into(),
            Input::Held(index) => self.local_name(&self.table[index]),
            Input::TravelMiddle(command) => qualified("travel_middle", command),
            Input::TravelHalf(command) => qualified("travel_half", command),
        }
    }
}

/// The symbol that a variable is.
pub(crate) fn symbol(g: &Graph, expr: Expr) -> Symbol {
    match g.node(expr) {
        Node::Symbol(symbol) => symbol,
        other => unreachable!("a variable is a symbol, not {other:?}"),
    }
}
