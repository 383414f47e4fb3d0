//! Reasons of verdicts as codes, places and numbers, for programs.

use tau_codes::{Code, fit};

use crate::trust::Pull;
use crate::trust::mistake::Mistake;
use crate::trust::reason::{Estimate, Reason, Repeated, Size};
use crate::weighing::lack_of_fit::ROUNDED;
use crate::weighing::{Kept, Loss, Outlier};

/// A reason for programs.
#[derive(Debug, Clone, PartialEq)]
pub struct Fact {
    /// Its code.
    pub code: Code,
    /// Its sentence, without the code.
    pub text: String,
    /// The file that it is about.
    pub file: Option<String>,
    /// The line of the file.
    pub line: Option<usize>,
    /// The parameter, pose, kind of measurement or variant that it is about.
    pub place: Option<String>,
    /// Its numbers, by names with their units; in SI units.
    pub values: Vec<(String, f64)>,
    /// True of measurements that were held out.
    pub is_held_out: bool,
}

/// Where something is, and how large.
#[derive(Default)]
struct Subject {
    file: Option<String>,
    line: Option<usize>,
    place: Option<String>,
    values: Vec<(String, f64)>,
}

impl Subject {
    /// Of a parameter, pose, kind of measurement or variant.
    fn at(place: impl Into<String>) -> Self {
        Self {
            place: Some(place.into()),
            ..Self::default()
        }
    }

    /// Of measurements as [`Reason`] names them: a file, or a quantity in one.
    fn of(measurements: &str) -> Self {
        let (place, file) = match measurements.split_once(" in ") {
            Some((quantity, file)) => (Some(quantity), Some(file)),
            None if measurements.contains('.') => (None, Some(measurements)),
            // Drives and links have no file.
            None => (Some(measurements), None),
        };
        Self {
            file: file.map(str::to_owned),
            place: place.map(str::to_owned),
            ..Self::default()
        }
    }

    /// Of several measurements: of the one where there is one.
    fn of_all(mut all: impl ExactSizeIterator<Item = String>) -> Self {
        if all.len() == 1 {
            all.next().map_or_else(Self::default, |own| Self::of(&own))
        } else {
            Self::at(all.collect::<Vec<_>>().join(", "))
        }
    }

    fn with<const N: usize>(mut self, values: [(&str, f64); N]) -> Self {
        let values = values.map(|(name, value)| (name.to_owned(), value));
        self.values.extend(values);
        self
    }

    fn pull(pull: &Pull) -> Self {
        Self::at(&pull.parameter).with([("tolerances", pull.tolerances)])
    }
}

impl Reason {
    /// Its code.
    pub fn code(&self) -> Code {
        match self {
            Self::NoFit(_) => fit::NO_FIT,
            Self::NoOther(..) => fit::NO_OTHER,
            Self::Mistake(mistake) => mistake.kind.code(),
            Self::Beyond {
                is_unexplained: false,
                ..
            } => fit::BEYOND_NOISE,
            Self::Beyond { .. } => fit::UNEXPLAINED,
            Self::Within {
                size: Size::TooLarge,
                ..
            }
            | Self::Held {
                size: Size::TooLarge,
                ..
            } => fit::NOISE_TOO_LARGE,
            Self::Within { .. } => fit::WITHIN_NOISE,
            Self::Held {
                size: Size::Chance, ..
            } => fit::HELD_BY_CHANCE,
            Self::Held { .. } => fit::HELD,
            Self::BeyondChance(_) => fit::BEYOND_CHANCE,
            Self::Changed(_) => fit::CHANGED,
            Self::Alone { .. } => fit::CHANGED_ALONE,
            Self::NotTaken(_) => fit::NO_PARAMETERS,
            Self::Pulled(..) => fit::PULLED,
            Self::Implausible(_) => fit::IMPLAUSIBLE,
            Self::AnotherMachine(..) => fit::ANOTHER_MACHINE,
            Self::Lacks(_) => fit::LACKS,
            Self::CartsMissed(_) => fit::CARTS_MISSED,
            Self::Outliers { all, loss, .. } => of_outliers(all, *loss),
            Self::Kept(Kept::TooMany { .. }) => fit::TOO_MANY_OUTLIERS,
            Self::Kept(Kept::Needed(_)) => fit::OUTLIERS_NEEDED,
            Self::Unsettled(_) => fit::UNSETTLED,
            Self::Repeats(own) if own.are_copied() => fit::COPIED_READINGS,
            Self::Repeats(_) => fit::REPEATS,
            Self::NoiseTooSmall(..) => fit::NOISE_TOO_SMALL,
            Self::MeansMissed { .. } => fit::MEANS_MISSED,
            Self::MeansMissedWithinNoise(..) => fit::MEANS_MISSED_WITHIN_NOISE,
            Self::DrivesContradict => fit::DRIVES_CONTRADICT,
            Self::OrDrives => fit::DRIVES_NOT_REPEATING,
            Self::Widened(_) => fit::WIDENED,
            Self::Serial(_) => fit::SERIAL,
            Self::OneLeft => fit::ONE_LEFT,
            Self::Estimated(_, estimate, _) => match estimate {
                Estimate::Unknown => fit::NOISE_UNKNOWN,
                Estimate::AtMost(_) => fit::NOISE_AT_MOST,
                Estimate::OfResiduals(_) => fit::NOISE_OF_RESIDUALS,
                Estimate::BesideRepeats(_) => fit::NOISE_BESIDE_REPEATS,
            },
            Self::NotJudged(..) => fit::NOT_JUDGED,
            Self::WithinTolerances => fit::WITHIN_TOLERANCES,
            Self::ParametersExact => fit::PARAMETERS_EXACT,
            Self::Reach(_) => fit::REACH,
            Self::OfHeld(..) => fit::HELD_OUT,
        }
    }

    /// The same for programs: one fact, or those of the measurements that were held.
    pub fn facts(&self) -> Vec<Fact> {
        if let Self::OfHeld(all, is_held_out) = self {
            let mut facts: Vec<Fact> = all.iter().flat_map(Self::facts).collect();
            for fact in &mut facts {
                fact.is_held_out = *is_held_out;
            }
            return facts;
        }
        let Subject {
            file,
            line,
            place,
            values,
        } = self.subject();
        vec![Fact {
            code: self.code(),
            text: self.to_string(),
            file,
            line,
            place,
            values,
            is_held_out: false,
        }]
    }

    fn subject(&self) -> Subject {
        let none = Subject::default;
        match self {
            Self::NoOther(variant, _) => Subject::at(variant),
            Self::Mistake(Mistake {
                kind, file, lines, ..
            }) => Subject {
                file: Some((*file).to_owned()),
                line: lines.first().copied(),
                ..Subject::at(kind.name())
            },
            Self::Beyond {
                over_noise,
                squares,
                ..
            }
            | Self::Held {
                over_noise,
                squares,
                ..
            } => none().with([
                ("over_noise", *over_noise),
                ("chi2", squares[0]),
                ("expected", squares[1]),
            ]),
            Self::Within {
                over_noise, left, ..
            } => {
                let place = none().with([("over_noise", *over_noise)]);
                match left {
                    Some(left) => place.with([("dof", *left)]),
                    None => place,
                }
            }
            Self::BeyondChance(all) => {
                let place = Subject::of_all(all.iter().map(|own| own.0.clone()));
                over_noise(place, all.iter().map(|own| (own.0.clone(), own.1)))
            }
            Self::Changed([squares, expected]) => {
                none().with([("chi2_drop", *squares), ("expected", *expected)])
            }
            Self::Alone {
                parameter,
                squares,
                change,
                unit,
            } => Subject::at(parameter)
                .with([("chi2_drop", *squares), (&named("change", unit), *change)]),
            Self::NotTaken([squares, expected]) => {
                none().with([("chi2", *squares), ("expected", *expected)])
            }
            Self::Pulled(pull, freed) => Subject::pull(pull).with([("tolerances_freed", *freed)]),
            Self::Implausible(pull) => Subject::pull(pull),
            Self::AnotherMachine(file, off_m) => Subject {
                file: file.map(str::to_owned),
                ..none().with([("off_m", *off_m)])
            },
            Self::Lacks(widening) => none().with([("widening", *widening)]),
            Self::CartsMissed(all) => {
                let named = |(kind, file, _): &(&str, &str, f64)| format!("{kind} in {file}");
                let place = Subject::of_all(all.iter().map(named));
                over_noise(place, all.iter().map(|own| (named(own), own.2)))
            }
            Self::Outliers {
                all,
                poses,
                limit_sigmas,
                ..
            } => outliers(all, *poses, *limit_sigmas),
            Self::Kept(Kept::TooMany { far, poses, .. }) => {
                none().with([("far", *far as f64), ("poses", *poses as f64)])
            }
            Self::Unsettled(rounds) => none().with([("rounds", *rounds as f64)]),
            Self::Repeats(own) => repeats(own),
            Self::NoiseTooSmall(of, sigma, unit) => {
                Subject::of(of).with([(&named("sigma", unit), *sigma)])
            }
            Self::MeansMissed {
                of,
                scatter_and_missed: [scatter, missed],
                unit,
                ..
            } => Subject::of(of).with([
                (&named("scatter", unit), *scatter),
                (&named("missed", unit), *missed),
            ]),
            Self::MeansMissedWithinNoise(of, widening) => {
                Subject::of_all(of.iter().cloned()).with([("widening", *widening)])
            }
            Self::Widened(times) => none().with([("noise_factor", *times)]),
            Self::Serial(own) => none().with([("rho", own.rho), ("p_value", own.p_value)]),
            Self::Estimated(of, estimate, unit) => match estimate {
                Estimate::Unknown => Subject::of(of),
                Estimate::AtMost(sigma)
                | Estimate::OfResiduals(sigma)
                | Estimate::BesideRepeats(sigma) => {
                    Subject::of(of).with([(&named("sigma", unit), *sigma)])
                }
            },
            Self::NotJudged(of, left, rows) => {
                Subject::of(of).with([("dof", *left), ("rows", *rows as f64)])
            }
            Self::Reach(reach) => none().with([
                ("elsewhere_m", reach.elsewhere_m),
                ("shown_m", reach.shown_m),
                ("turn_rad", reach.turn_rad),
            ]),
            Self::NoFit(_)
            | Self::Kept(Kept::Needed(_))
            | Self::DrivesContradict
            | Self::OrDrives
            | Self::OneLeft
            | Self::WithinTolerances
            | Self::ParametersExact
            | Self::OfHeld(..) => none(),
        }
    }
}

impl Repeated {
    /// True if readings agree to the last digit.
    pub(super) fn are_copied(&self) -> bool {
        self.over_noise.powi(2) <= ROUNDED
    }
}

/// A name with an SI unit, where that is one word.
fn named(name: &str, unit: &str) -> String {
    if !unit.is_empty() && unit.chars().all(char::is_alphabetic) {
        format!("{name}_{unit}")
    } else {
        name.to_owned()
    }
}

/// Ratios to the noise: that of one, or those of several by the names of the measurements.
fn over_noise(mut place: Subject, all: impl ExactSizeIterator<Item = (String, f64)>) -> Subject {
    let is_one = all.len() == 1;
    place.values.extend(all.map(|(name, ratio)| {
        let name = if is_one {
            "over_noise".to_owned()
        } else {
            name
        };
        (name, ratio)
    }));
    place
}

fn of_outliers(all: &[Outlier], loss: Option<Loss>) -> Code {
    if loss.is_some() {
        fit::DOWN_WEIGHTED
    } else if all.iter().all(Outlier::is_left_out) {
        fit::LEFT_OUT
    } else {
        fit::KEPT
    }
}

fn outliers(all: &[Outlier], poses: usize, limit_sigmas: f64) -> Subject {
    let numbers: Vec<String> = all.iter().map(|own| own.pose.to_string()).collect();
    let is_one = all.len() == 1;
    let noun = if is_one { "pose" } else { "poses" };
    let sigmas = all.iter().map(|own| own.sigmas);
    let mut place = Subject {
        file: all.first().map(|own| own.file.to_owned()),
        line: all.first().filter(|_| is_one).and_then(|own| own.line),
        ..Subject::at(format!("{noun} {}", numbers.join(", ")))
    }
    .with([
        ("outliers", all.len() as f64),
        ("poses", poses as f64),
        ("largest_over_noise", sigmas.fold(0.0, f64::max)),
        ("limit_over_noise", limit_sigmas),
    ]);
    if let [
        Outlier {
            misread: Some(misread),
            ..
        },
    ] = all
    {
        let unit = if misread.column.ends_with("_rad") {
            "rad"
        } else {
            "m"
        };
        place = place.with([(&named("misread", unit), misread.off)]);
    }
    place
}

fn repeats(own: &Repeated) -> Subject {
    let mut place = own.of.as_deref().map_or_else(Subject::default, Subject::of);
    place = place.with([
        ("readings", own.readings as f64),
        ("quantities", own.quantities as f64),
        ("dof", own.degrees),
        ("over_noise", own.over_noise),
    ]);
    for (sigma, unit) in &own.sigmas {
        place = place.with([(&named("sigma", unit), *sigma)]);
    }
    if let Some(test) = own.lack_of_fit {
        place = place.with([
            ("means_over_noise", test.over_noise),
            ("f", test.f),
            ("p_value", test.p_value),
        ]);
    }
    place
}
