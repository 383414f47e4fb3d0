//! Actions of an effect's terms at a place, and the values of what their formulas read there.

use tau_codegen::equations::Scope;
use tau_codegen::language::model::{Model, Place, Readable, Subject, Target, Term};
use tau_codes::discovery as codes;
use tau_estimation::samples::{Lack, Sample};
use tau_kinematics::Surroundings;
use tau_runtime::{Input, Owner};

use super::super::probes::{BaseProbe, ClosureProbe, Probes, TARGETS_OF_CART};

/// Reason why an effect that reads a link's length or tension is no candidate beside a reduced arm.
pub(crate) const NEEDS_FULL_ARM: Lack = Lack {
    code: codes::NEEDS_FULL_ARM,
    words: "it needs a full arm",
};

/// Action of a term on a probe.
pub(super) struct Action {
    /// Indices of the probes of the target's components, which act on the same samples.
    pub(super) probes: Vec<usize>,
    pub(super) scope: Scope,
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
        let scope = of_cart(track, source);
        axis.map(|axis| Action {
            probes: vec![probes.carts[track][axis]],
            scope,
        })
    };
    let on_command = |command: usize, scope: Scope| {
        let probe = probes.commands.get(command).copied().flatten()?;
        Some(Action {
            probes: vec![probe],
            scope: Scope {
                command: Some(command),
                ..scope
            },
        })
    };
    let on_crank = |track: usize| on_command(track, Scope::default());
    let on_base = |wanted: &dyn Fn(&BaseProbe) -> bool| {
        let found = probes.bases.iter().filter(|base| wanted(base));
        found
            .map(|base| Action {
                probes: base.shift.to_vec(),
                scope: of_base(base),
            })
            .collect()
    };
    let on_closure = |closure: usize| {
        let owner = &probes.closures[closure];
        if term.target == Target::Command {
            let mut links = model.links.iter().enumerate();
            let (_, link) = links.find(|(index, own)| {
                own.cluster == owner.cluster
                    && owner.link.is_none_or(|link| link == *index)
                    && subject.admits(own)
            })?;
            return on_command(link.actuated_by?, of_closure(owner));
        }
        Some(Action {
            probes: match term.target {
                Target::Length => vec![owner.length],
                _ => owner.joint?.to_vec(),
            },
            scope: of_closure(owner),
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
        Place::Crank(track) => on_crank(track).into_iter().collect(),
        Place::AllCranks => model.cranks().filter_map(on_crank).collect(),
        Place::BaseJoint(_) | Place::CrankCentre(_) => on_base(&|base| base.place == place),
        Place::AllBaseJoints => on_base(&|_| true),
        Place::Tcp => vec![Action {
            probes: probes.tcp.to_vec(),
            scope: Scope::default(),
        }],
    }
}

/// Meaning of words on a cart.
pub(crate) fn of_cart(track: usize, source: Option<usize>) -> Scope {
    Scope {
        command: Some(track),
        track: Some(track),
        source,
        ..Scope::default()
    }
}

/// Meaning of words on a link, or a cluster of a reduced arm.
pub(crate) fn of_closure(closure: &ClosureProbe) -> Scope {
    Scope {
        command: closure.command,
        link: closure.link,
        length_of: Some(closure.owner()),
        ..Scope::default()
    }
}

/// Meaning of words at a joint on the base or the centre of a crank.
fn of_base(base: &BaseProbe) -> Scope {
    Scope {
        command: base.command,
        base_of: Some(base.owner),
        ..Scope::default()
    }
}

/// The cart, link, crank or base joint that moves.
pub(crate) fn place(scope: &Scope) -> Option<Place> {
    let cart = |track| Place::Cart {
        track,
        source: None,
    };
    let crank = match scope.base_of {
        Some(Owner::Link(link)) => return Some(Place::BaseJoint(link)),
        Some(Owner::Crank(track)) => return Some(Place::CrankCentre(track)),
        Some(_) => return None,
        None => scope.command.filter(|_| scope.length_of.is_none()),
    };
    let own = scope.track.map(cart).or(scope.link.map(Place::Link));
    own.or(crank.map(Place::Crank))
}

/// Values of a quantity at samples.
///
/// # Errors
/// The column, set, cart or arm that is missing, in words.
pub(crate) fn read(
    scope: &Scope,
    readable: Readable,
    at: &[usize],
    samples: &[Sample],
    surroundings: &Surroundings,
    probes: &Probes,
) -> Result<Vec<f64>, Lack> {
    const NO_CART: Lack = Lack {
        code: codes::LACKS_PART,
        words: "it needs a cart, and the link has none",
    };
    if let Readable::Length | Readable::PaidOut = readable {
        let mut own = probes.closures.iter();
        let own = own.find(|closure| Some(closure.owner()) == scope.length_of);
        let own = own.ok_or(NEEDS_FULL_ARM)?;
        let zero_m = match readable {
            Readable::PaidOut => own.length_at_zero_m,
            _ => 0.0,
        };
        let lengths_m = at.iter().map(|&sample| own.lengths_m[sample] - zero_m);
        return Ok(lengths_m.collect());
    }
    if let Readable::Base(component) = readable {
        let mut own = probes.bases.iter();
        let own = own.find(|base| Some(base.owner) == scope.base_of);
        let own = own.ok_or(NEEDS_FULL_ARM)?;
        return Ok(vec![own.at_m[component]; at.len()]);
    }
    if readable == Readable::Travel {
        let command = scope.command.ok_or(NO_CART)?;
        let inputs = [
            Input::Command(command),
            Input::TravelMiddle(command),
            Input::TravelHalf(command),
        ];
        let travel = |&sample: &usize| {
            let value = |input| samples[sample].input(input, surroundings);
            let [q, middle, half] = inputs.map(value);
            Ok((q? - middle?) / half?)
        };
        return at.iter().map(travel).collect();
    }
    let lacking = match readable {
        Readable::Tension => NEEDS_FULL_ARM,
        _ => NO_CART,
    };
    let input = scope.input(readable).ok_or(lacking)?;
    at.iter()
        .map(|&sample| samples[sample].input(input, surroundings))
        .collect()
}
