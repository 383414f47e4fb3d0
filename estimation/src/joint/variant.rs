//! Variants as discovery fits them: as described, but for how sets 2 and 3 see the carts turn.

use tau_codegen::compile::{CompiledVariant, compile_some};
use tau_codegen::language::model::{
    self as language, Effect, EffectParameter, EffectUse, Formula, Model, Place, Readable, Subject,
    Target, Term,
};
use tau_codegen::language::units::Dimension;
use tau_robot::robot::{Arm, Instance, Robot, Variant};
use tau_runtime::ResidualKind;

use crate::numerics::parallel;

/// Name of the effect that turns carts, and the rotations that it is of.
///
/// The directions of a cart's links say something of its rotation and of the direction in which it
/// runs, but not all: those of one or two links leave rotations open, and each absorbs what else is
/// linear in the command (the two links of the paper's second cart run along directions that differ by
/// 0.17 mm/m). So the rates at which sets 2 and 3 see the carts turn are free, and those at which they
/// see them drift aside have room.
pub(crate) const TURNING: &str = "unnamed_turning";
pub(crate) const ROTATIONS: [Target; 3] = [Target::Roll, Target::Pitch, Target::Yaw];

/// Name of the effect by which piecewise paths stretch with their cart's turning.
///
/// Straight paths of a cart's links allow motions that piecewise ones do not: a cart that turns in
/// proportion to its command carries its joints by different amounts along the track, but paths as measured
/// turn and do not stretch. So that nothing that every full arm takes up by itself gets a name.
const STRETCHING: &str = "unnamed_stretching";

/// Tolerances of the rates at which carts turn (rad/m) and drift aside (m/m).
const TURN: f64 = 10e-3;
const DRIFT: f64 = 200e-6;

/// An effect that adds to each target a parameter of the target's name, with a tolerance (SI) or free, times a
/// quantity, or alone.
pub fn additive(
    name: &str,
    subject: Subject,
    targets: &[(Target, Option<f64>)],
    factor: Option<Readable>,
) -> Effect {
    let per = factor.map_or(Dimension::NUMBER, Readable::dimension);
    let (mut parameters, mut terms) = (Vec::new(), Vec::new());
    for (index, &(target, tolerance)) in targets.iter().enumerate() {
        let dimension = target.dimension(subject).divide(per).unwrap_or_default();
        parameters.push(EffectParameter {
            components: if target.is_vector() { 3 } else { 1 },
            tolerance,
            ..EffectParameter::amplitude(target.name(), dimension)
        });
        let amount = |component| match factor {
            Some(factor) => Formula::Parameter(index, component) * Formula::Read(factor),
            None => Formula::Parameter(index, component),
        };
        let formula = if target.is_vector() {
            Formula::Vector(Box::new([0, 1, 2].map(amount)))
        } else {
            amount(0)
        };
        terms.push(Term::new(target, formula));
    }
    Effect {
        name: name.to_owned(),
        docs: vec![],
        subject,
        parameters,
        terms,
    }
}

/// Poses that closures are functions of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PosesOf {
    /// Poses as a tracker measured them, its errors included, which closures take off.
    Tracker,
    /// Those of the machine: errors of the tracker stand for themselves.
    Machine,
}

/// A variant of a model (by index) whose closures are functions of true poses: they leave out errors of the tracker, which
/// instances of [`ResidualKind::TrackerError`] hold.
pub(crate) fn at_true_poses(model: &Model, variant: usize, whole: &Variant) -> Variant {
    let mut own = whole.clone();
    own.instances.retain(|instance| !is_closure(instance.kind));
    let closures = closures_of_true_poses(model, variant, |_| true);
    adopt(&mut own, &Variant::from(&closures), |_| true);
    sort(&mut own);
    own
}

fn closures_of_true_poses(
    model: &Model,
    variant: usize,
    wanted: impl Fn(usize) -> bool,
) -> CompiledVariant {
    let mut model = model.clone();
    let effects = &mut model.variants[variant].effects;
    effects.retain(|used| used.place != Place::Tcp);
    compile_some(&model, variant, |kind, of| is_closure(kind) && wanted(of))
}

/// Those residuals of a variant that concern the plate.
pub fn of_plate(
    model: &Model,
    variant: usize,
    poses: PosesOf,
    wanted: impl Fn(ResidualKind, usize) -> bool,
) -> Variant {
    if poses == PosesOf::Tracker {
        return Variant::from(&compile_some(model, variant, |kind, of| {
            is_closure(kind) && wanted(kind, of)
        }));
    }
    let mut own = Variant::from(&compile_some(model, variant, |kind, of| {
        kind == ResidualKind::TrackerError && wanted(kind, of)
    }));
    let closures = closures_of_true_poses(model, variant, |of| wanted(ResidualKind::Closure, of));
    adopt(&mut own, &Variant::from(&closures), |_| true);
    own
}

/// The variant of a model (by index), its carts turning freely in sets 2 and 3. `closures` is the same
/// variant where its closures have been compiled already, as functions of these poses.
pub fn free_turning(
    model: &Model,
    variant: usize,
    closures: Option<&Variant>,
    poses: PosesOf,
) -> Variant {
    let stretching = stretching(model, variant);
    let (model, closures) = match &stretching {
        Some(stretching) => (stretching, None),
        None => (model, closures),
    };
    let mut free = Variant::from(&compile_some(
        &turning(model, variant),
        variant,
        |kind, _| is_of_cart(kind),
    ));
    let compiled;
    let closures = if let Some(closures) = closures {
        closures
    } else {
        compiled = of_plate(model, variant, poses, |_, _| true);
        &compiled
    };
    adopt(&mut free, closures, |instance| !is_of_cart(instance.kind));
    free
}

/// The variant of a robot with carts that turn freely; its closures are as they have been compiled.
pub(crate) fn turning_freely(robot: &Robot, variant: &Variant, poses: PosesOf) -> Variant {
    let model = &robot.model;
    let index = model
        .variants
        .iter()
        .position(|own| own.name == variant.name);
    index.map_or_else(
        || variant.clone(),
        |index| free_turning(model, index, Some(variant), poses),
    )
}

/// [`free_turning`] of a variant that differs from a compiled one, `before`, by one more effect at a place: only
/// what that touches is compiled.
pub fn free_turning_from(
    model: &Model,
    variant: usize,
    before: &Variant,
    place: Place,
    poses: PosesOf,
) -> Variant {
    let cluster_of = |closure: usize| match before.arm {
        Arm::Full => model.links[closure].cluster,
        Arm::Reduced => closure,
    };
    let touches = |kind: ResidualKind, of: usize| match place {
        _ if kind == ResidualKind::TrackerError => place == Place::Tcp,
        Place::Tcp if poses == PosesOf::Machine => false,
        Place::Cart { track, .. } if is_of_cart(kind) => of == track,
        Place::Cart { track, .. } => model.clusters[cluster_of(of)].track == Some(track),
        Place::AllCarts => true,
        Place::Crank(track) | Place::CrankCentre(track) => {
            !is_of_cart(kind) && model.clusters[cluster_of(of)].track == Some(track)
        }
        Place::Link(link) | Place::BaseJoint(link) => {
            !is_of_cart(kind)
                && match before.arm {
                    Arm::Full => of == link,
                    Arm::Reduced => of == model.links[link].cluster,
                }
        }
        Place::AllLinks | Place::AllCranks | Place::AllBaseJoints | Place::Tcp => !is_of_cart(kind),
    };
    let stretching = stretching(model, variant);
    let model = stretching.as_ref().unwrap_or(model);
    let turning = turning(model, variant);
    let (mut free, closures) = parallel::both(
        || {
            Variant::from(&compile_some(&turning, variant, |kind, of| {
                is_of_cart(kind) && touches(kind, of)
            }))
        },
        || of_plate(model, variant, poses, touches),
    );
    adopt(&mut free, &closures, |_| true);
    adopt(&mut free, before, |instance| {
        !touches(instance.kind, instance.of)
    });
    sort(&mut free);
    free
}

/// Puts residuals in the order in which a variant has them.
fn sort(variant: &mut Variant) {
    (variant.instances).sort_by_key(|instance| (order(instance.kind), instance.of));
}

/// The model with carts that turn and drift in proportion to their commands.
fn turning(model: &Model, variant: usize) -> Model {
    let turns = ROTATIONS.map(|target| (target, Some(TURN)));
    let drifts = [Target::Horizontal, Target::Vertical].map(|target| (target, Some(DRIFT)));
    let targets = [&turns[..], &drifts].concat();
    on_carts(model, variant, TURNING, &targets, model.guideways())
}

/// The model with an effect in proportion to the commands on the carts of some tracks in a variant.
fn on_carts(
    model: &Model,
    variant: usize,
    name: &str,
    targets: &[(Target, Option<f64>)],
    tracks: impl IntoIterator<Item = usize>,
) -> Model {
    let mut model = model.clone();
    let effect = additive(name, Subject::Cart, targets, Some(Readable::Command));
    add(&mut model, variant, effect, tracks.into_iter().map(cart));
    model
}

/// Adds an effect at places of a variant.
pub fn add(model: &mut Model, variant: usize, effect: Effect, places: impl Iterator<Item = Place>) {
    let index = model.effects.len();
    model.effects.push(effect);
    let used = places.map(|place| EffectUse {
        effect: index,
        place,
        with: vec![],
        tolerance_factor: 1.0,
    });
    model.variants[variant].effects.extend(used);
}

/// The cart of a track as a place.
pub fn cart(track: usize) -> Place {
    Place::Cart {
        track,
        source: None,
    }
}

/// The model with piecewise paths that stretch with the turning of their carts; `None` where it has no
/// carts with several of them.
fn stretching(model: &Model, variant: usize) -> Option<Model> {
    let own = &model.variants[variant];
    let tracks: Vec<usize> = (0..model.tracks.len())
        .filter(|&track| {
            own.arm == language::Arm::Full
                && own.tracks[track].shape == language::TrackShape::Piecewise
                && own.tracks[track].per_link
                && model.links_of_track(track).len() > 1
        })
        .collect();
    let targets = [Target::Pitch, Target::Yaw].map(|target| (target, Some(TURN)));
    (!tracks.is_empty()).then(|| on_carts(model, variant, STRETCHING, &targets, tracks))
}

/// Takes over instances of another variant whose parameters, and those that it holds, are there by the same names.
fn adopt(into: &mut Variant, from: &Variant, wanted: impl Fn(&Instance) -> bool) {
    let wanted = from.instances.iter().filter(|instance| wanted(instance));
    let index = |of: usize| into.index_of(&from.parameters[of].name);
    let adopted: Vec<Instance> = wanted.map(|own| own.renumbered(index)).collect();
    into.instances.extend(adopted);
}

fn is_of_cart(kind: ResidualKind) -> bool {
    matches!(kind, ResidualKind::CartPose | ResidualKind::CartPosition)
}

fn is_closure(kind: ResidualKind) -> bool {
    matches!(kind, ResidualKind::Closure | ResidualKind::ClosureByPose)
}

fn order(kind: ResidualKind) -> usize {
    match kind {
        ResidualKind::Closure => 0,
        ResidualKind::ClosureByPose => 1,
        ResidualKind::CartPose => 2,
        ResidualKind::CartPosition => 3,
        ResidualKind::TrackerError => 4,
    }
}
