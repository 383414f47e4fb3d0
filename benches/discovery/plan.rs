//! The list of trials.

use tau::simulation::{Noise, Tails};
use tau_codegen::language::Model;
use tau_codegen::language::model::Effect;
use tau_robot::effects::places;

use crate::hidden::UNLISTED;

/// A part of the benchmark.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    serde::Serialize,
    serde::Deserialize,
    clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub(crate) enum Section {
    /// Nothing is hidden, under noise of several kinds.
    Nulls,
    /// One effect of the catalogue.
    Single,
    /// Two to four effects of the catalogue.
    Several,
    /// One effect of the catalogue at two places.
    Places,
    /// One effect that the catalogue lacks.
    Withheld,
}

impl Section {
    pub(crate) const ALL: [Self; 5] = [
        Self::Nulls,
        Self::Single,
        Self::Several,
        Self::Places,
        Self::Withheld,
    ];

    /// Trials of each kind where none are asked for: together some half an hour.
    fn trials(self) -> usize {
        match self {
            Self::Nulls => 40,
            Self::Several => 20,
            Self::Single => 12,
            Self::Places | Self::Withheld => 8,
        }
    }

    /// Non-centralities where none are asked for.
    fn noncentralities(self) -> &'static [f64] {
        match self {
            Self::Nulls => &[0.0],
            Self::Single => &[15.0, 30.0, 60.0, 120.0, 240.0],
            Self::Several | Self::Places => &[30.0, 60.0, 120.0],
            Self::Withheld => &[60.0, 120.0, 240.0],
        }
    }
}

/// The hidden effects.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Subject {
    /// Nothing.
    Nothing,
    /// An effect of the catalogue, by name.
    Listed(String),
    /// So many effects of the catalogue, of different names.
    Several(usize),
    /// An effect of the catalogue at two places, with amplitudes of its own at each.
    AtTwo(String),
    /// An effect of the catalogue that is taken out of it.
    Withheld(String),
    /// An effect that no catalogue lists.
    Unlisted(&'static str),
}

/// One trial.
#[derive(Debug, Clone)]
pub(crate) struct Case {
    pub(crate) section: Section,
    /// The kind of noise, or what is hidden.
    pub(crate) kind: String,
    pub(crate) subject: Subject,
    pub(crate) noise: Noise,
    pub(crate) noncentrality: f64,
    /// Its number among trials of its kind.
    pub(crate) index: usize,
}

/// The trials asked for.
pub(crate) struct Plan {
    pub(crate) sections: Vec<Section>,
    pub(crate) trials: Option<usize>,
    pub(crate) noncentralities: Vec<f64>,
    pub(crate) kinds: Vec<String>,
}

impl Plan {
    /// All trials, in order.
    pub(crate) fn cases(&self, model: &Model) -> Vec<Case> {
        let mut cases = Vec::new();
        for &section in &self.sections {
            let trials = self.trials.unwrap_or(section.trials());
            let noncentralities = if self.noncentralities.is_empty() || section == Section::Nulls {
                section.noncentralities()
            } else {
                &self.noncentralities
            };
            for (kind, subject, noise) in kinds(section, model) {
                if !self.kinds.is_empty() && !self.kinds.contains(&kind) {
                    continue;
                }
                for &noncentrality in noncentralities {
                    cases.extend((0..trials).map(|index| Case {
                        section,
                        kind: kind.clone(),
                        subject: subject.clone(),
                        noise: noise(index),
                        noncentrality,
                        index,
                    }));
                }
            }
        }
        cases
    }
}

/// Noise of a trial by its number.
type OfIndex = fn(usize) -> Noise;

/// Effects of the catalogue that the machine can have somewhere.
pub(crate) fn possible(model: &Model) -> impl Iterator<Item = &Effect> {
    let effects = model.effects.iter();
    effects.filter(|effect| !places(model, effect).is_empty())
}

fn kinds(section: Section, model: &Model) -> Vec<(String, Subject, OfIndex)> {
    let stated: OfIndex = |_| Noise::default();
    let names = possible(model).map(|effect| effect.name.clone());
    match section {
        Section::Nulls => regimes()
            .into_iter()
            .map(|(name, noise)| (name.to_owned(), Subject::Nothing, noise))
            .collect(),
        Section::Single => names
            .map(|name| (name.clone(), Subject::Listed(name), stated))
            .collect(),
        Section::Several => (2..=4)
            .map(|count| (format!("{count} effects"), Subject::Several(count), stated))
            .collect(),
        Section::Places => model
            .effects
            .iter()
            .filter(|effect| places(model, effect).len() > 2)
            .map(|effect| {
                (
                    effect.name.clone(),
                    Subject::AtTwo(effect.name.clone()),
                    stated,
                )
            })
            .collect(),
        Section::Withheld => names
            .map(|name| (name.clone(), Subject::Withheld(name), stated))
            .chain(
                UNLISTED
                    .iter()
                    .map(|&name| (name.to_owned(), Subject::Unlisted(name), stated)),
            )
            .collect(),
    }
}

/// The kinds of noise; what they have besides is what the robot file states.
fn regimes() -> [(&'static str, OfIndex); 6] {
    [
        ("as stated", |_| Noise::default()),
        ("25 % wrong", |index| Noise {
            scale: [[1.25, 0.75][index % 2]; 3],
            ..Noise::default()
        }),
        ("one set 1.5 times", |index| {
            let mut scale = [1.0; 3];
            scale[index % 3] = 1.5;
            Noise {
                scale,
                ..Noise::default()
            }
        }),
        ("heavy tails, outliers", |_| Noise {
            tails: Tails::Heavy,
            outliers: 0.02,
            ..Noise::default()
        }),
        ("common to a pose", |_| Noise {
            common: 0.3,
            ..Noise::default()
        }),
        ("serial", |_| Noise {
            serial: 0.5,
            ..Noise::default()
        }),
    ]
}
