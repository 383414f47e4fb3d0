//! Outliers and repeated readings in sentences.

use crate::trust::{LEVEL, general};
use crate::weighing::lack_of_fit::ROUNDED;
use crate::weighing::{LackOfFit, Loss, Misread, Outlier, Repeats, Weighing};

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
    let misread = all.iter().filter_map(|outlier| {
        let misread = outlier.misread.as_ref()?;
        Some(misread_in_words(outlier.pose, misread))
    });
    let misread: String = misread.take(NAMED).collect();
    Some(format!(
        "{} {} ({} of {poses}) {done}: {off} times the noise off, where the largest of {poses} hardly exceeds {}.{misread}",
        if is_one { "Pose" } else { "Poses" },
        names.join(", "),
        all.len(),
        general(weighing.limit_sigmas, 2)
    ))
}

/// A command that explains an outlier.
fn misread_in_words(pose: u32, misread: &Misread) -> String {
    let off = if misread.column.ends_with("_rad") {
        format!("{} mrad", general(1e3 * misread.off.abs(), 3))
    } else {
        format!("{} mm", general(1e3 * misread.off.abs(), 3))
    };
    let direction = if misread.off > 0.0 { "much" } else { "little" };
    format!(
        " Pose {pose} is as if `{}` were {off} too {direction}.",
        misread.column
    )
}

/// Repeated readings.
pub(super) fn repeats(repeats: &Repeats) -> String {
    let subject = format!("{} readings of {} poses", repeats.readings, repeats.visits);
    let rotation = repeats.rotation_rad.map(|sigma| deviation(sigma, "rad"));
    let to = std::iter::once(deviation(repeats.position_m, "m")).chain(rotation);
    let to = to.collect::<Vec<_>>().join(" and ");
    let mut said = repeat_to(
        &subject,
        (&to, " per axis"),
        repeats.degrees as f64,
        (repeats.within_over_noise, "stated"),
        Some(("poses", &repeats.lack_of_fit)),
    );
    if repeats.shared_over_noise > 0.0 && repeats.lack_of_fit.p_value < LEVEL {
        said += " What the readings of a pose share counts once.";
    }
    said
}

/// Repeatability and lack of fit. Readings (`subject`) repeat `to` so much with some degrees of freedom, which is so much
/// over the noise, stated or estimated; and what they were taken of meets the model.
pub(crate) fn repeat_to(
    subject: &str,
    (to, each): (&str, &str),
    degrees: f64,
    (within, noise): (f64, &str),
    lack_of_fit: Option<(&str, &LackOfFit)>,
) -> String {
    let meet = lack_of_fit.map_or_else(String::new, |(of, test)| {
        format!(
            "; {of} meet the model to {} (lack of fit: F = {}, p = {})",
            general(test.over_noise, 3),
            general(test.f, 3),
            general(test.p_value, 2)
        )
    });
    let copied = if within.powi(2) <= ROUNDED {
        " They are the same to the last digit: rows that were copied, or rounded to more than they scatter, are no repeats."
    } else {
        ""
    };
    format!(
        "{subject} repeat to {to} (pooled standard deviation{each}, {degrees:.0} degrees of freedom), {} times the {noise} \
         noise{meet}.{copied}",
        general(within, 3)
    )
}

/// A standard deviation of lengths (`m`) or angles (`rad`).
pub(crate) fn deviation(sigma: f64, unit: &str) -> String {
    match unit {
        "m" => format!("{} µm", general(1e6 * sigma, 3)),
        _ => format!("{} mrad", general(1e3 * sigma, 2)),
    }
}
