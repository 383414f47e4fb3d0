//! Actions of an effect's terms at a place, and the meaning of the words of their formulas there.

use tau_codegen::language::model::{Model, Place, Readable, Subject, Target, Term};
use tau_estimation::samples::Sample;
use tau_kinematics::Surroundings;
use tau_robot::robot::Input;

use super::super::probes::{ClosureProbe, Probes, TARGETS_OF_CART};

/// Action of a term on a probe.
pub(super) struct Action {
    /// Indices of the probes of the target's components, which act on the same samples.
    pub(super) probes: Vec<usize>,
    pub(super) scope: Scope,
}

/// Meaning of a formula's words.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Scope {
    command: Option<usize>,
    track: Option<usize>,
    source: Option<usize>,
    link: Option<usize>,
    /// Index of the link or cluster whose length is read.
    length: Option<usize>,
}

/// Actions of a term of an effect at a place.
pub(super) fn actions(
    (place, subject): (Place, Subject),
    model: &Model,
    term: &Term,
    probes: &Probes,
) -> Vec<Action> {
    let axis = TARGETS_OF_CART.iter().position(|own| *own == term.target);
    let on_cart = |track: usize, source: Option<usize>| {
        let scope = Scope::of_cart(track, source);
        axis.map(|axis| Action {
            probes: vec![probes.carts[track][axis]],
            scope,
        })
    };
    let on_closure = |closure: usize| {
        let owner = &probes.closures[closure];
        Some(Action {
            probes: match term.target {
                Target::Length => vec![owner.length],
                _ => owner.joint?.to_vec(),
            },
            scope: Scope::of_closure(closure, owner),
        })
    };
    match place {
        Place::Cart { track, source } => on_cart(track, source).into_iter().collect(),
        Place::AllCarts => (0..model.tracks.len())
            .filter_map(|track| on_cart(track, None))
            .collect(),
        Place::Link(link) => {
            let closure = probes.closures.iter().position(|closure| {
                closure.link == Some(link)
                    || (closure.link.is_none() && closure.cluster == model.links[link].cluster)
            });
            closure.and_then(on_closure).into_iter().collect()
        }
        Place::AllLinks => {
            let is_meant = |closure: &usize| {
                let ClosureProbe { cluster, link, .. } = probes.closures[*closure];
                let mut links = model.links.iter().enumerate();
                links.any(|(index, own)| {
                    own.cluster == cluster
                        && link.is_none_or(|link| link == index)
                        && subject.admits(own)
                })
            };
            let closures = (0..probes.closures.len()).filter(is_meant);
            closures.filter_map(on_closure).collect()
        }
        Place::Tcp => vec![Action {
            probes: probes.tcp.to_vec(),
            scope: Scope::NOWHERE,
        }],
    }
}

impl Scope {
    pub(crate) const NOWHERE: Self = Self {
        command: None,
        track: None,
        source: None,
        link: None,
        length: None,
    };

    pub(crate) fn of_cart(track: usize, source: Option<usize>) -> Self {
        Self {
            command: Some(track),
            track: Some(track),
            source,
            ..Self::NOWHERE
        }
    }

    pub(crate) fn of_closure(index: usize, closure: &ClosureProbe) -> Self {
        Self {
            command: closure.command,
            link: closure.link,
            length: Some(index),
            ..Self::NOWHERE
        }
    }

    /// True if there is a cart whose command `q` is.
    pub(crate) fn has_command(&self) -> bool {
        self.command.is_some()
    }

    /// The track that `source` is.
    pub(crate) fn source(&self) -> Option<usize> {
        self.source
    }

    /// The cart or link that moves.
    pub(crate) fn place(&self) -> Option<Place> {
        let cart = |track| Place::Cart {
            track,
            source: None,
        };
        self.track.map(cart).or(self.link.map(Place::Link))
    }

    pub(crate) fn read(
        &self,
        readable: Readable,
        at: &[usize],
        samples: &[Sample],
        surroundings: &Surroundings,
        closures: &[ClosureProbe],
    ) -> Result<Vec<f64>, &'static str> {
        const NO_CART: &str = "it needs a cart, and the link has none";
        const FULL_ARM: &str = "it needs a full arm";
        if let Readable::Length | Readable::PaidOut = readable {
            let own = &closures[self.length.ok_or(FULL_ARM)?];
            let zero_m = match readable {
                Readable::PaidOut => own.length_at_zero_m,
                _ => 0.0,
            };
            let lengths_m = at.iter().map(|&sample| own.lengths_m[sample] - zero_m);
            return Ok(lengths_m.collect());
        }
        let load = |component| {
            self.track
                .map(|track| Input::Load { track, component })
                .ok_or(NO_CART)
        };
        let input = match readable {
            Readable::Command => Input::Command(self.command.ok_or(NO_CART)?),
            Readable::CommandOf(track) => Input::Command(track),
            Readable::SourceCommand => Input::Command(self.source.ok_or(NO_CART)?),
            Readable::Direction => Input::Direction(self.command.ok_or(NO_CART)?),
            Readable::Time => Input::Time,
            Readable::Temperature => Input::Temperature,
            Readable::LoadAlong => load(0)?,
            Readable::LoadHorizontal => load(1)?,
            Readable::LoadVertical => load(2)?,
            Readable::Tension => Input::Tension(self.link.ok_or(FULL_ARM)?),
            Readable::Position(k) => Input::TcpPosition(k),
            Readable::Length | Readable::PaidOut => return Err(FULL_ARM),
        };
        at.iter()
            .map(|&sample| samples[sample].input(input, surroundings))
            .collect()
    }
}
