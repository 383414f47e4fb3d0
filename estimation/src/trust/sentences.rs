//! Reasons of verdicts in sentences.

use std::fmt;

use tau_codes::Remark;

use crate::trust::general;
use crate::trust::mistake::Mistake;
use crate::trust::reach::Reach;
use crate::trust::reason::{Estimate, HeldBy, Reason, Repeated, Size};
use crate::weighing::{Kept, Loss, Misread, Outlier};

/// Outliers that are named one by one.
const NAMED: usize = 8;

impl Reason {
    /// The sentence, apart from its code.
    pub fn remark(&self) -> Remark {
        Remark::new(self.code(), self.to_string())
    }

    /// The sentence with its code; each sentence of several with its own.
    pub fn coded(&self) -> String {
        match self {
            Self::OfHeld(all, is_held_out) => held(all.iter().map(Self::coded), *is_held_out),
            _ => self.remark().to_string(),
        }
    }
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&sentence(self))
    }
}

fn sentence(reason: &Reason) -> String {
    match reason {
        Reason::NoFit(why) => format!("There is no fit: {why}."),
        Reason::NoOther(variant, why) => {
            format!("`{variant}` was not calibrated: {why}.")
        }
        Reason::Mistake(Mistake {
            file, what, mend, ..
        }) => format!("In {file}, {what}: {mend}."),
        Reason::Beyond {
            over_noise,
            squares,
            is_unexplained,
        } => {
            let causes = if *is_unexplained {
                ": the model lacks something, or the noise is larger"
            } else {
                ""
            };
            format!(
                "Residuals are {} times what the stated noise allows ({}){causes}.",
                general(*over_noise, 3),
                squares_to(*squares)
            )
        }
        Reason::Within {
            over_noise,
            left,
            size,
        } => {
            let noise = match left {
                None => "what the stated noise makes them".to_owned(),
                Some(left) => format!(
                    "their noise, {} of them beyond what the fit absorbs",
                    general(*left, 3)
                ),
            };
            format!(
                "Residuals are {} times {noise}{}.",
                general(*over_noise, 3),
                compared(*size)
            )
        }
        Reason::Held {
            over_noise,
            squares,
            by,
            size,
        } => {
            let by = match by {
                HeldBy::Noise => "noise makes",
                HeldBy::NoiseAndParameters => "noise and what is not known of the parameters make",
                HeldBy::Fit => "noise leaves in a fit to",
            };
            format!(
                "With the parameters held, residuals are {} times what {by} them{} ({}).",
                general(*over_noise, 3),
                compared(*size),
                squares_to(*squares)
            )
        }
        Reason::BeyondChance(all) => {
            let all = all
                .iter()
                .map(|(of, ratio)| format!("{of} {} times", general(*ratio, 3)));
            format!("Beyond chance are those of {}.", listed(all, ", "))
        }
        Reason::Changed([squares, degrees]) => format!(
            "Other parameters would take away {} of χ², for {} expected: the machine has changed, or its parameters are known \
             less well than the file says.",
            general(*squares, 3),
            general(*degrees, 3)
        ),
        Reason::Alone {
            parameter,
            squares,
            change,
            unit,
        } => format!(
            "`{parameter}` alone would take away {}, changed by {} {unit}.",
            general(*squares, 3),
            general(*change, 2)
        ),
        Reason::NotTaken([squares, degrees]) => format!(
            "No parameters take away {} of χ², where {} is expected: the model lacks something (`tau discover` looks for it), \
             or the noise is larger than stated.",
            general(*squares, 4),
            general(*degrees, 4)
        ),
        Reason::Pulled(pull, freed) => {
            let [off, freed] = [pull.tolerances, *freed].map(|own| general(own.abs(), 3));
            let held = if freed == off {
                String::new()
            } else {
                format!(", {freed} where its own did not hold it back")
            };
            format!(
                "`{}` is pulled {off} tolerances off its nominal value{held}.",
                pull.parameter
            )
        }
        Reason::Implausible(pull) => format!(
            "No machine is {} tolerances off its drawing, as `{}` would be.",
            general(pull.tolerances.abs(), 3),
            pull.parameter
        ),
        Reason::AnotherMachine(file, off_m) => format!(
            "Measurements{} are missed by {} mm: this is another machine, or commands and measurements do not belong together.",
            file.map_or_else(String::new, |file| format!(" in {file}")),
            general(1e3 * off_m, 3)
        ),
        Reason::Lacks(widening) => format!(
            "The model lacks something (`tau discover` looks for it) or the noise is more than stated; standard deviations are \
             up to {} times as large if it is noise.",
            general(*widening, 3)
        ),
        Reason::CartsMissed(all) => {
            let all = all
                .iter()
                .map(|(kind, file, times)| format!("{kind}s in {file} {} times", general(*times, 2)));
            format!(
                "Carts miss their stated noise, and count that much less: {}.",
                listed(all, ", ")
            )
        }
        Reason::Outliers {
            all,
            poses,
            loss,
            limit_sigmas,
        } => outliers(all, *poses, *loss, *limit_sigmas),
        Reason::Kept(Kept::TooMany {
            far,
            poses,
            are_all_kept,
        }) => format!(
            "{far} of {poses} poses lie further off than most of them let expect: too many to be outliers, so that {} kept.",
            if *are_all_kept { "they are" } else { "most are" }
        ),
        Reason::Kept(Kept::Needed(error)) => format!("Outliers are kept: without them, {error}."),
        Reason::Unsettled(rounds) => format!(
            "What takes part, and by how much, still changed after {rounds} rounds of fit and weights."
        ),
        Reason::Repeats(own) => repeats(own),
        Reason::NoiseTooSmall(of, sigma, unit) => format!(
            "The stated noise of {of} is too small: readings of one value scatter by {}.",
            deviation(*sigma, unit)
        ),
        Reason::MeansMissed {
            of,
            scatter_and_missed,
            unit,
            or_noise_of,
        } => {
            let [scatter, missed] = scatter_and_missed.map(|own| deviation(own, unit));
            let or_noise = if or_noise_of.is_empty() {
                String::new()
            } else {
                format!(", or the noise of {} is larger", or_noise_of.join(" and "))
            };
            format!(
                "Readings of {of} repeat to {scatter}, the model misses their means by {missed}: it lacks something{or_noise}."
            )
        }
        Reason::MeansMissedWithinNoise(of, factor) => format!(
            "The model misses means of repeated readings of {} by more than these scatter by, though within the stated noise: \
             it lacks something, and standard deviations, for which each reading has errors of its own, are up to {} times \
             as large.",
            of.join(" and "),
            general(*factor, 3)
        ),
        Reason::DrivesContradict => {
            "The drives are stated to be exact, but they contradict each other, and were taken for as noisy as what was \
             measured: state their noise as `noise_m` of `[drives]`, or \"estimate\" there."
                .to_owned()
        }
        Reason::OrDrives => {
            "Or the drives do not repeat as well as readings at one place: then state their noise or have it estimated \
             (`[drives] noise_m = \"estimate\"`)."
                .to_owned()
        }
        Reason::Widened(times) => format!(
            "At that noise what is missed would drive parameters beyond their tolerances: they are those at {} times that \
             noise, where tolerances hold them.",
            general(*times, 3)
        ),
        Reason::Serial(own) => format!(
            "Noise of poses that follow each other has a correlation of {}.",
            general(own.rho, 3)
        ),
        Reason::OneLeft => {
            "One residual is left beyond the factors: every effect would explain it as well as any other; measure more poses \
             to tell what the model lacks."
                .to_owned()
        }
        Reason::Estimated(of, estimate, unit) => estimated(of, *estimate, unit),
        Reason::NotJudged(of, left, rows) => format!(
            "{of} can't be judged: poses and places follow all but {} of {rows}.",
            general(*left, 2)
        ),
        Reason::WithinTolerances => {
            "Parameters of a drawing may lie anywhere within their tolerances, and this is the fit there: how well the drawing \
             predicts as it is, its errors say."
                .to_owned()
        }
        Reason::ParametersExact => {
            "The robot file does not say how well its parameters are known: they count as exact."
                .to_owned()
        }
        Reason::Reach(reach) => of_reach(reach),
        Reason::OfHeld(all, is_held_out) => {
            held(all.iter().map(ToString::to_string), *is_held_out)
        }
    }
}

/// Sentences on measurements with the parameters held.
fn held(all: impl Iterator<Item = String>, is_held_out: bool) -> String {
    let all = listed(all, " ");
    if is_held_out {
        format!("Of what was held out: {all}")
    } else {
        all
    }
}

fn listed(all: impl Iterator<Item = String>, between: &str) -> String {
    all.collect::<Vec<_>>().join(between)
}

fn squares_to(of: [f64; 2]) -> String {
    let [found, expected] = of.map(|own| general(own, 4));
    format!("χ² {found} where {expected} is expected")
}

fn compared(size: Size) -> &'static str {
    match size {
        Size::Chance => ", as chance allows",
        Size::Unsaid => "",
        Size::TooLarge => ": the noise is stated too large",
    }
}

fn estimated(of: &str, estimate: Estimate, unit: &str) -> String {
    let (sigma, of_what) = match estimate {
        Estimate::Unknown => {
            return format!("The noise of {of} could not be estimated: the fit follows its rows.");
        }
        Estimate::AtMost(sigma) => {
            let sigma = general(sigma, 2);
            return format!("The noise of {of} was estimated to be no more than {sigma} {unit}.");
        }
        Estimate::OfResiduals(sigma) => (
            sigma,
            "that is the size of its residuals, which says nothing of the model",
        ),
        Estimate::BesideRepeats(sigma) => (
            sigma,
            "of the model its repeated readings tell, not the size of its residuals",
        ),
    };
    let sigma = general(sigma, 2);
    format!("The noise of {of} was estimated: {sigma} {unit}; {of_what}.")
}

fn of_reach(reach: &Reach) -> String {
    let freedoms = reach.plate.freedoms_of_tcp().len();
    let along = reach.spread_m.iter().take(freedoms);
    let turn = if reach.plate.turning_axes().is_empty() {
        String::new()
    } else {
        format!(" and turn by {} mrad", general(1e3 * reach.turn_rad, 2))
    };
    format!(
        "The poses cannot speak for the rest of the workspace: where the commands are combined otherwise the position is known \
         to {} µm, while poses like these show errors of {} µm. They spread over {} mm{turn}; measure where they do not.",
        general(1e6 * reach.elsewhere_m, 2),
        general(1e6 * reach.shown_m, 2),
        listed(along.map(|length| general(1e3 * length, 2)), " by ")
    )
}

/// The outliers among so many poses.
fn outliers(all: &[Outlier], poses: usize, loss: Option<Loss>, limit_sigmas: f64) -> String {
    let mut names: Vec<String> = (all.iter().take(NAMED))
        .map(|outlier| outlier.pose.to_string())
        .collect();
    if all.len() > NAMED {
        names.push(format!("{} more", all.len() - NAMED));
    }
    let is_one = all.len() == 1;
    let are_left_out = all.iter().all(Outlier::is_left_out);
    let by = |loss: Loss| loss.name();
    let done = match (loss, is_one) {
        (Some(loss), true) => format!("loses its pull by the loss `{}`, as an outlier", by(loss)),
        (Some(loss), false) => format!("lose their pull by the loss `{}`, as outliers", by(loss)),
        (None, true) if are_left_out => "is left out as an outlier".to_owned(),
        (None, true) => "is kept, though an outlier".to_owned(),
        (None, false) if are_left_out => "are left out as outliers".to_owned(),
        (None, false) => "are kept, though outliers".to_owned(),
    };
    let sigmas = || all.iter().map(|outlier| outlier.sigmas);
    let [least, most] = [sigmas().reduce(f64::min), sigmas().reduce(f64::max)];
    let [least, most] = [least, most].map(|own| general(own.unwrap_or(f64::NAN), 2));
    let off = if is_one {
        most
    } else {
        format!("{least} to {most}")
    };
    let misread = all.iter().filter_map(|outlier| {
        let misread = outlier.misread.as_ref()?;
        Some(misread_in_words(outlier.pose, misread))
    });
    let misread: String = misread.take(NAMED).collect();
    format!(
        "{} {} ({} of {poses}) {done}: {off} times the noise off, where the largest of {poses} hardly exceeds {}.{misread}",
        if is_one { "Pose" } else { "Poses" },
        names.join(", "),
        all.len(),
        general(limit_sigmas, 2)
    )
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

fn repeats(own: &Repeated) -> String {
    let (subject, each, noun) = match &own.of {
        None => (String::new(), " per axis", "poses"),
        Some(of) => (format!("Of {of}, "), "", "values"),
    };
    let to = own.sigmas.iter();
    let to = listed(to.map(|&(sigma, unit)| deviation(sigma, unit)), " and ");
    let noise = if own.is_estimated {
        "estimated"
    } else {
        "stated"
    };
    let meet = own.lack_of_fit.map_or_else(String::new, |test| {
        format!(
            "; {noun} meet the model to {} (lack of fit: F = {}, p = {})",
            general(test.over_noise, 3),
            general(test.f, 3),
            general(test.p_value, 2)
        )
    });
    let copied = if own.are_copied() {
        " They are the same to the last digit: rows that were copied, or rounded to more than they scatter, are no repeats."
    } else {
        ""
    };
    let shared = if own.is_shared {
        " What the readings of a pose share counts once."
    } else {
        ""
    };
    format!(
        "{subject}{} readings of {} {noun} repeat to {to} (pooled standard deviation{each}, {:.0} degrees of freedom), {} times \
         the {noise} noise{meet}.{copied}{shared}",
        own.readings,
        own.quantities,
        own.degrees,
        general(own.over_noise, 3)
    )
}

/// A standard deviation of lengths (`m`) or angles (`rad`).
fn deviation(sigma: f64, unit: &str) -> String {
    match unit {
        "m" => format!("{} µm", general(1e6 * sigma, 3)),
        _ => format!("{} mrad", general(1e3 * sigma, 2)),
    }
}
