//! Outliers and repeated readings in sentences.

use crate::trust::{LEVEL, general};
use crate::weighing::{Loss, Outlier, Repeats, Weighing};

/// Outliers that are named one by one.
const NAMED: usize = 8;

/// The outliers among the poses, if there are any.
pub(super) fn outliers(weighing: &Weighing) -> Option<String> {
    let all = &weighing.outliers;
    let (first, poses) = (all.first()?, weighing.fit.len());
    let mut names: Vec<String> = (all.iter().take(NAMED))
        .map(|outlier| outlier.pose.to_string())
        .collect();
    if all.len() > NAMED {
        names.push(format!("{} more", all.len() - NAMED));
    }
    let is_one = all.len() == 1;
    let by = |loss: Loss| loss.name();
    let done = match (weighing.loss, is_one) {
        (Some(loss), true) => format!("loses its pull by the loss `{}`, as an outlier", by(loss)),
        (Some(loss), false) => format!("lose their pull by the loss `{}`, as outliers", by(loss)),
        (None, true) if first.is_left_out() => "is left out as an outlier".to_owned(),
        (None, true) => "is kept, though an outlier".to_owned(),
        (None, false) if all.iter().all(Outlier::is_left_out) => {
            "are left out as outliers".to_owned()
        }
        (None, false) => "are kept, though outliers".to_owned(),
    };
    let (least, most) = all
        .iter()
        .fold((first.sigmas, first.sigmas), |(a, b), outlier| {
            (a.min(outlier.sigmas), b.max(outlier.sigmas))
        });
    let off = if is_one {
        general(most, 2)
    } else {
        format!("{} to {}", general(least, 2), general(most, 2))
    };
    Some(format!(
        "{} {} ({} of {poses}) {done}: {off} times the noise off, where the largest of {poses} hardly exceeds {}.",
        if is_one { "Pose" } else { "Poses" },
        names.join(", "),
        all.len(),
        general(weighing.limit_sigmas, 2)
    ))
}

/// Repeated readings.
pub(super) fn repeats(repeats: &Repeats) -> String {
    let mut said = format!(
        "{} readings of {} poses repeat to {} µm and {} mrad (pooled standard deviation per axis, {} degrees of \
         freedom), {} times the stated noise; poses meet the model to {} (lack of fit: F = {}, p = {}).",
        repeats.readings,
        repeats.visits,
        general(1e6 * repeats.position_m, 3),
        general(1e3 * repeats.rotation_rad, 2),
        repeats.degrees,
        general(repeats.within_over_noise, 3),
        general(repeats.between_over_noise, 3),
        general(repeats.lack_of_fit, 3),
        general(repeats.p_value, 2),
    );
    if repeats.shared_over_noise > 0.0 && repeats.p_value < LEVEL {
        said += " What the readings of a pose share counts once.";
    }
    said
}
