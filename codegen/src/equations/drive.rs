//! Effects on drives and on the base: errors of commands, shifts of base joints and of crank centres.
//!
//! A drive that adds to its command does so wherever a crank or a length follows it; what effects read is the command as it
//! was given. A crank whose centre moves takes its joints along, so that each of them moves by the same.

use tau_model_dsl::model::{Arm, Place, Target};
use tau_runtime::{Input, Owner};

use super::Context;
use super::formula::Scope;
use crate::graph::Expr;
use crate::vector::Vector;

impl Context<'_> {
    /// A command with what effects make its drive add to it (m or rad).
    pub(super) fn driven(&mut self, command: usize) -> Expr {
        let mut driven = self.datum(Input::Command(command));
        let (model, variant) = (self.model, self.variant);
        let mut links = model.links.iter();
        let link = links.position(|link| link.actuated_by == Some(command));
        let is_crank = (model.tracks.get(command)).is_some_and(|track| track.crank.is_some());
        for (index, used) in variant.effects.iter().enumerate() {
            let effect = &model.effects[used.effect];
            let applies = match used.place {
                Place::Crank(track) => track == command,
                Place::AllCranks => is_crank,
                Place::Link(own) => link == Some(own),
                Place::AllLinks => {
                    link.is_some_and(|link| effect.subject.admits(&model.links[link]))
                }
                _ => false,
            };
            if !applies || !effect.adds_to(Target::Command) {
                continue;
            }
            let scope = Scope {
                command: Some(command),
                link,
                length_of: link.map(|link| self.closure_owner(link)),
                at_tcp: true,
                ..Scope::default()
            };
            for (target, value) in self.terms(index, scope) {
                if let (Target::Command, &[amount]) = (target, value.as_slice()) {
                    driven = self.g.add(driven, amount);
                }
            }
        }
        driven
    }

    /// Displacements of the joint of a link or cluster with these links, which stands on the base or on the crank of a
    /// track, in the order of the variant (m).
    pub(super) fn base_shifts(
        &mut self,
        owner: Owner,
        links: &[usize],
        track: Option<usize>,
    ) -> Vec<Vector> {
        let (model, variant) = (self.model, self.variant);
        let crank = track.filter(|&track| model.tracks[track].crank.is_some());
        let is_on_base = track.is_none() || crank.is_some();
        let mut shifts = vec![];
        for (index, used) in variant.effects.iter().enumerate() {
            let applies = match used.place {
                Place::BaseJoint(link) => links.contains(&link),
                Place::CrankCentre(track) => crank == Some(track),
                Place::AllBaseJoints => is_on_base,
                _ => false,
            };
            if !applies {
                continue;
            }
            let driven = links.iter().find_map(|&link| model.links[link].actuated_by);
            let scope = Scope {
                command: crank.or(driven),
                base_of: Some(crank.map_or(owner, Owner::Crank)),
                at_tcp: true,
                ..Scope::default()
            };
            for (target, value) in self.terms(index, scope) {
                match (target, value.as_slice()) {
                    (Target::Shift, &[x, y, z]) => shifts.push([x, y, z]),
                    _ => unreachable!("the checker admits only shifts of base joints"),
                }
            }
        }
        shifts
    }

    /// Owner of the closure that a link belongs to.
    fn closure_owner(&self, link: usize) -> Owner {
        match self.variant.arm {
            Arm::Full => Owner::Link(link),
            Arm::Reduced => Owner::Cluster(self.model.links[link].cluster),
        }
    }
}
