//! Variants as discovery fits them: as described, but for how sets 2 and 3 see the carts turn.

use tau_codegen::compile::compile_some;
use tau_codegen::language::effects_from_text;
use tau_codegen::language::model::{self as language, EffectUse, Model, Place};
use tau_robot::robot::{Arm, Instance, Variant};
use tau_runtime::ResidualKind;

use crate::numerics::parallel;

/// Name of the effect that turns carts, and its parameters about the axes of the track.
pub(crate) const TURNING: &str = "unnamed_turning";
pub(crate) const TURNING_RATES: [&str; 3] = ["roll_rate", "pitch_rate", "yaw_rate"];

/// Turning and drifting of a cart in proportion to its command.
///
/// The directions of a cart's links say something of its rotation and of the direction in which it
/// runs, but not all: those of one or two links leave rotations open, and each absorbs what else is
/// linear in the command (the two links of the paper's second cart run along directions that differ by
/// 0.17 mm/m). So the rates at which sets 2 and 3 see the carts turn are free, and those at which they
/// see them drift aside have room.
const TEXT: &str = "
effect unnamed_turning on cart {
    param roll_rate, pitch_rate, yaw_rate: angle/length tol 10 mrad/m;
    param horizontal_rate, vertical_rate: ratio tol 200 ppm;
    roll += roll_rate * q; pitch += pitch_rate * q; yaw += yaw_rate * q;
    horizontal += horizontal_rate * q; vertical += vertical_rate * q;
}
";

/// Name of the effect by which piecewise paths stretch with their cart's turning.
const STRETCHING: &str = "unnamed_stretching";

/// Motions that straight paths of a cart's links allow and piecewise ones do not: a cart that turns in
/// proportion to its command carries its joints by different amounts along the track, but paths as measured
/// turn and do not stretch. So that nothing that every full arm takes up by itself gets a name.
const STRETCHES: &str = "
effect unnamed_stretching on cart {
    param pitch_rate, yaw_rate: angle/length tol 10 mrad/m;
    pitch += pitch_rate * q; yaw += yaw_rate * q;
}
";

/// The variant of a model (by index), its carts turning freely in sets 2 and 3. `closures` is the same
/// variant where its closures have been compiled already.
pub fn free_turning(model: &Model, variant: usize, closures: Option<&Variant>) -> Variant {
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
        compiled = Variant::from(&compile_some(model, variant, |kind, _| !is_of_cart(kind)));
        &compiled
    };
    adopt(&mut free, closures, |instance| !is_of_cart(instance.kind));
    free
}

/// The same for a variant that differs from a compiled one, `before`, by one more effect at a place: only
/// what that touches is compiled.
pub fn free_turning_from(model: &Model, variant: usize, before: &Variant, place: Place) -> Variant {
    let cluster_of = |closure: usize| match before.arm {
        Arm::Full => model.links[closure].cluster,
        Arm::Reduced => closure,
    };
    let touches = |kind: ResidualKind, of: usize| match place {
        Place::Cart { track, .. } if is_of_cart(kind) => of == track,
        Place::Cart { track, .. } => model.clusters[cluster_of(of)].track == Some(track),
        Place::AllCarts => true,
        Place::Link(link) => {
            !is_of_cart(kind)
                && match before.arm {
                    Arm::Full => of == link,
                    Arm::Reduced => of == model.links[link].cluster,
                }
        }
        Place::AllLinks | Place::Tcp => !is_of_cart(kind),
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
        || {
            Variant::from(&compile_some(model, variant, |kind, of| {
                !is_of_cart(kind) && touches(kind, of)
            }))
        },
    );
    adopt(&mut free, &closures, |_| true);
    adopt(&mut free, before, |instance| {
        !touches(instance.kind, instance.of)
    });
    free.instances
        .sort_by_key(|instance| (order(instance.kind), instance.of));
    free
}

/// The model with carts that turn and drift in proportion to their commands.
fn turning(model: &Model, variant: usize) -> Model {
    on_carts(model, variant, (TEXT, TURNING), 0..model.tracks.len())
}

/// The model with an effect, described by a text, on the carts of some tracks in a variant.
fn on_carts(
    model: &Model,
    variant: usize,
    (text, name): (&str, &str),
    tracks: impl IntoIterator<Item = usize>,
) -> Model {
    let mut model = with_effects(model, text);
    let effect = index_of(&model, name);
    let carts = tracks.into_iter().map(|track| EffectUse {
        effect,
        place: Place::Cart {
            track,
            source: None,
        },
        with: vec![],
    });
    model.variants[variant].effects.extend(carts);
    model
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
    (!tracks.is_empty()).then(|| on_carts(model, variant, (STRETCHES, STRETCHING), tracks))
}

/// Takes over instances of another variant whose parameters are there by the same names.
fn adopt(into: &mut Variant, from: &Variant, wanted: impl Fn(&Instance) -> bool) {
    let adopted: Vec<Instance> = from
        .instances
        .iter()
        .filter(|instance| wanted(instance))
        .map(|instance| {
            let name_of = |index: &usize| &from.parameters[*index].name;
            let mut adopted = instance.clone();
            adopted.parameters = instance
                .parameters
                .iter()
                .map(|index| into.index_of(name_of(index)))
                .collect();
            adopted
        })
        .collect();
    into.instances.extend(adopted);
}

fn is_of_cart(kind: ResidualKind) -> bool {
    matches!(kind, ResidualKind::CartPose | ResidualKind::CartPosition)
}

fn order(kind: ResidualKind) -> usize {
    match kind {
        ResidualKind::Closure => 0,
        ResidualKind::ClosureByPose => 1,
        ResidualKind::CartPose => 2,
        ResidualKind::CartPosition => 3,
    }
}

/// A model with further effects, whose text is the program's own.
pub fn with_effects(model: &Model, text: &str) -> Model {
    effects_from_text(text, model).unwrap_or_else(|errors| {
        unreachable!("the program's own effects are well-formed: {errors}")
    })
}

/// Index of an effect that is the model's.
pub fn index_of(model: &Model, name: &str) -> usize {
    let index = model.effects.iter().position(|effect| effect.name == name);
    index.unwrap_or_else(|| unreachable!("`{name}` is an effect of the model"))
}
