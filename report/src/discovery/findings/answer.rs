//! The answer in short: status, what held-out measurements say of it, and the gap that it closes.

use std::fmt;

use tau::discovery::results::{Misfit, Place, Rejected};
use tau::discovery::{Discovery, Status};
use tau::trust::{FileFit, Reason as Because};
use tau_codes::{Remark, discovery as codes, remark};

use super::super::at;
use super::super::words::{self, capital};
use super::count_word;
use crate::number::{fixed, general};

/// A device that errs.
#[derive(Clone, Copy)]
pub(crate) enum Device {
    Machine,
    Tracker,
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Machine => "machine",
            Self::Tracker => "tracker",
        })
    }
}

/// The device that errs: the tracker, where all that was found is in its measurements.
pub(crate) fn device(found: &Discovery) -> Device {
    let is_of_tracker = found.effects.iter().all(|own| own.place == Place::Tcp);
    if is_of_tracker && !found.effects.is_empty() && found.unnamed.is_empty() {
        Device::Tracker
    } else {
        Device::Machine
    }
}

/// The verdict, with what speaks against it.
pub(crate) fn verdict(found: &Discovery) -> String {
    let worst = found.pulls.iter();
    let worst = worst.max_by(|a, b| a.tolerances.abs().total_cmp(&b.tolerances.abs()));
    let mut status = Remark::new(found.code(), status(found)).to_string();
    for sentence in unconfirmed(found).into_iter().chain(undecided(found)) {
        status += &format!(" {sentence}");
    }
    let Some(worst) = worst else {
        return status;
    };
    let others = match found.pulls.len() - 1 {
        0 => String::new(),
        others => format!(", and {others} more beyond chance"),
    };
    format!(
        "{status} Yet `{}` comes out {} tolerances from the robot file{others}: see below. [{}]",
        worst.parameter,
        general(worst.tolerances.abs(), 2),
        codes::FAR_FROM_DRAWING
    )
}

/// Sentence on what was found where errors on what took no part do not fall with it.
pub(crate) fn unconfirmed(found: &Discovery) -> Option<Remark> {
    let validation = &found.validation;
    let (before, after) = (validation.before.mean_um, validation.after.mean_um);
    (!is_base(found) && validation.speaks_against()).then(|| {
        remark!(codes::UNCONFIRMED;
            "{} do not confirm what was found: {} {} µm in the mean.",
                capital(validation.compared()), validation.of.subject(),
                goes([before, after].map(|um| general(um, 3)), after < before))
    })
}

/// Sentence on a significant candidate that blocks which were held out do not confirm.
fn undecided(found: &Discovery) -> Option<Remark> {
    let own = found.undecided.as_ref()?;
    let text = format!(
        "{} is significant: noise alone would show as much with probability {}. But measurements that are held out in turn \
         are not predicted better with it. About {} more poses like these would decide.",
        at(&own.name, &own.place),
        words::probability(own.p_value.value()),
        own.more_poses
    );
    Some(Remark::new(codes::NOT_CONFIRMED, text))
}

/// True if the final fit agrees with the stated noise and tolerances.
pub(crate) fn is_consistent(found: &Discovery) -> bool {
    let fit = found.fit.as_ref();
    fit.is_some_and(|fit| fit.status == tau::trust::Status::Consistent)
}

/// `falls from 12 to 11`; `stays at 12` where the digits that are shown do not change.
fn goes([before, after]: [String; 2], is_less: bool) -> String {
    if before == after {
        return format!("stays at {after}");
    }
    let how = if is_less { "falls" } else { "rises" };
    format!("{how} from {before} to {after}")
}

fn status(found: &Discovery) -> String {
    let errs = device(found);
    let base = format!("the model {}", words::variant(&found.model, &found.base));
    let count = found.effects.len();
    let errors = match count {
        1 => "one error".to_owned(),
        _ => format!("{} errors", count_word(count)),
    };
    match found.status {
        Status::NothingMissing => format!(
            "{} explains the measurements: nothing significant is missing.",
            capital(&base)
        ),
        Status::Explained => format!(
            "The {errs} shows {errors} that {base} does not contain. With {} in the model, nothing significant is \
             left.",
            if count == 1 { "it" } else { "them" }
        ),
        Status::PartlyExplained => format!(
            "The {errs} shows {errors} with a name that {base} does not contain. Something significant is left that \
             has none{}",
            left(found)
        ),
        Status::Unresolved => unresolved(found, &base),
        Status::UnnamedStructure => format!(
            "The machine shows something that {base} does not contain and no effect that these measurements can show explains. It is \
             described below, without a name."
        ),
    }
}

/// Sentences on measurements that leave open whether a base lacks anything.
fn unresolved(found: &Discovery, base: &str) -> String {
    let open = if found.undecided.is_some() {
        format!("These measurements do not decide whether {base} lacks anything.")
    } else if found.detectable.is_empty() {
        format!(
            "These measurements show no effect of a plausible size: whether {base} lacks one is open."
        )
    } else {
        format!("The search found nothing that {base} lacks.")
    };
    if is_consistent(found) {
        return open;
    }
    format!(
        "{open} Yet the fit is not consistent with the stated noise and tolerances{}",
        left(found)
    )
}

/// The end of a sentence on a fit that is not consistent: what is worst, a drive, a link, a file or a parameter.
fn left(found: &Discovery) -> String {
    if let Some(worst) = &found.worst {
        return format!(
            ". The worst is {}: {} {unit} rms, where the stated noise leaves {} {unit}.",
            place(worst),
            general(worst.rms, 3),
            general(worst.expected_rms, 3),
            unit = worst.unit
        );
    }
    let is_missed = |fit: &&tau::trust::Verdict| fit.status > tau::trust::Status::Consistent;
    let Some(fit) = found.fit.as_ref().filter(is_missed) else {
        return ".".to_owned();
    };
    let ratio = |file: &FileFit| file.rms / file.expected_rms;
    let files = fit.by_file.iter().filter(|file| file.expected_rms > 0.0);
    let worst = files.max_by(|a, b| ratio(a).total_cmp(&ratio(b)));
    let is_pulled = |reason: &Because| matches!(reason, Because::Pulled(..));
    let is_beyond = |reason: &Because| matches!(reason, Because::Beyond { .. });
    match (worst, fit.pulls.first()) {
        (_, Some(pull)) if fit.why.iter().any(is_pulled) && found.pulls.is_empty() => format!(
            ". The worst is `{}`, {} tolerances from the robot file.",
            pull.parameter,
            general(pull.tolerances.abs(), 2)
        ),
        _ if !fit.why.iter().any(is_beyond) => {
            let why = fit.why.first();
            why.map_or_else(|| ".".to_owned(), |why| format!(". {}", why.remark().text))
        }
        (Some(file), _) if ratio(file) > 1.0 => format!(
            ". The worst is {}: residuals are {} times the stated noise, everywhere alike.",
            file.file,
            general(ratio(file), 3)
        ),
        _ => ".".to_owned(),
    }
}

/// Place of a misfit in words.
fn place(misfit: &Misfit) -> String {
    match (&misfit.link, &misfit.cart) {
        (Some(link), _) => format!("link {link}"),
        (None, Some(cart)) => format!("cart {cart} in set {} ({})", misfit.set, misfit.coordinate),
        (None, None) => misfit.coordinate.clone(),
    }
}

/// Sentences on effects that held-out measurements contradict.
pub(crate) fn rejected(found: &Discovery) -> Vec<Remark> {
    let of = |own: &Rejected| {
        let change = if own.heldout_change > 0.0 {
            format!("raises it by {}", general(own.heldout_change, 3))
        } else {
            let fall = general(-own.heldout_change, 3);
            format!("lowers it by {fall} beside others with which it raises it")
        };
        remark!(codes::REJECTED;
            "{} was found and is rejected: it lowers χ² by {} where it was fitted, and {change} on {}.",
                at(&own.name, &own.place), general(own.chi2_drop, 3), found.validation.compared())
    };
    found.rejected.iter().map(of).collect()
}

/// The fall of the error at the tool, and the possible one.
pub(crate) fn gap(found: &Discovery) -> String {
    let (before, after) = (found.validation.before, found.validation.after);
    let um = |value: f64| general(value, 3);
    let [floor, ceiling] = [found.noise_floor_um, found.ceiling_um].map(um);
    let of = found.validation.compared();
    let poses = if found.validation.held_out {
        format!("On {of}, which took no part,")
    } else {
        format!("On {of}, for none were kept apart,")
    };
    let change = if is_base(found) {
        format!(
            "{poses} {} is {} µm in the mean, {} µm at most and {} µm rms.",
            found.validation.of.subject(),
            um(before.mean_um),
            um(before.max_um),
            um(before.rms_um)
        )
    } else {
        let goes = |before: f64, after: f64| goes([before, after].map(um), after < before);
        let mean = goes(before.mean_um, after.mean_um);
        // What goes the same way needs no other verb.
        let verb = mean.split_inclusive(' ').next().unwrap_or_default();
        let beside = |before: f64, after: f64| {
            let own = goes(before, after);
            own.strip_prefix(verb).unwrap_or(&own).to_owned()
        };
        format!(
            "{poses} {} {} µm in the mean, {} µm at most, and {} µm rms.",
            found.validation.of.subject(),
            mean,
            beside(before.max_um, after.max_um),
            beside(before.rms_um, after.rms_um)
        )
    };
    let closed = (before.rms_um.powi(2) - after.rms_um.powi(2)) / found.ceiling_um.powi(2);
    let share = if is_base(found) || !closed.is_finite() {
        String::new()
    } else if closed <= 0.0 {
        " None of it is gone, which speaks against what was found.".to_owned()
    } else {
        format!(
            " Of that, in the mean square, {} % is gone.",
            fixed((100.0 * closed).clamp(0.0, 100.0), 0)
        )
    };
    format!(
        "{change} The stated noise alone would show {floor} µm in the mean; beyond it, {ceiling} µm rms could be \
         removed by any method.{share}"
    )
}

/// True if nothing joined the model.
pub(crate) fn is_base(found: &Discovery) -> bool {
    found.effects.is_empty() && found.piecewise_tracks.is_empty()
}
