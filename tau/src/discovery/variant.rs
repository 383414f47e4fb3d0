//! Variants as discovery fits them: as described, but for how sets 2 and 3 see the carts turn.

use tau_codegen::compile::compile_kinds;
use tau_codegen::language::effects_from_text;
use tau_codegen::language::model::{EffectUse, Model, Place};
use tau_runtime::ResidualKind;

use crate::robot::Variant;

/// Name of the effect that turns carts, and its parameters about the axes of the track.
pub(super) const TURNING: &str = "unnamed_turning";
pub(super) const TURNING_RATES: [&str; 3] = ["roll_rate", "pitch_rate", "yaw_rate"];

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

/// The variant of a model (by index), its carts turning freely in sets 2 and 3. `closures` is the same
/// variant where its closures have been compiled already.
pub(super) fn free_turning(model: &Model, variant: usize, closures: Option<&Variant>) -> Variant {
    let compiled;
    let closures = if let Some(closures) = closures {
        closures
    } else {
        let kinds = [ResidualKind::Closure, ResidualKind::ClosureByPose];
        compiled = Variant::from(&compile_kinds(model, variant, &kinds));
        &compiled
    };
    let mut model = with_effects(model, TEXT);
    let effect = index_of(&model, TURNING);
    let carts = (0..model.tracks.len()).map(|track| EffectUse {
        effect,
        place: Place::Cart { track, source: None },
    });
    model.variants[variant].effects.extend(carts);
    let kinds = [ResidualKind::CartPose, ResidualKind::CartPosition];
    let mut free = Variant::from(&compile_kinds(&model, variant, &kinds));
    let own = closures.instances.iter().filter(|instance| {
        matches!(instance.kind, ResidualKind::Closure | ResidualKind::ClosureByPose)
    });
    let renamed: Vec<_> = own
        .cloned()
        .map(|mut instance| {
            for index in &mut instance.parameters {
                let name = &closures.parameters[*index].name;
                *index = free.parameters.iter().position(|p| p.name == *name).unwrap_or_default();
            }
            instance
        })
        .collect();
    free.instances.extend(renamed);
    free
}

/// A model with further effects, whose text is the program's own.
pub(super) fn with_effects(model: &Model, text: &str) -> Model {
    effects_from_text(text, model).unwrap_or_else(|errors| {
        unreachable!("the program's own effects are well-formed: {errors}")
    })
}

/// Index of an effect of the model.
pub(super) fn index_of(model: &Model, name: &str) -> usize {
    model.effects.iter().position(|effect| effect.name == name).unwrap_or_default()
}
