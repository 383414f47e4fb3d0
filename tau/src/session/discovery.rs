//! The search for what a variant lacks, in the measurements of a session.

use std::path::Path;

use tau_codes::{Remark, remark};
use tau_discovery::{Options, Outcome, UNNAMED, reserved};
use tau_estimation::calibration::Error;
use tau_estimation::trust::Verdict;
use tau_model_dsl::model::Effect;
use tau_model_dsl::{self as language, Model};
use tau_robot::effects::{CATALOGUE, places};
use tau_robot::input_error;
use tau_robot::input_error::{InputError, Source, both};
use tau_robot::measurements::Split;
use tau_robot::robot::{Robot, Variant};

use super::calibrated::{Calibrated, Fit};
use super::{Session, VariantKey};

/// Effects to search for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Catalogues {
    /// Texts in the language; of effects of one name, the first counts.
    pub texts: Vec<String>,
    /// Remarks on effects that are not used.
    pub remarks: Vec<Remark>,
}

impl<R> Session<R> {
    /// The variant to search from unless another is named: `Full`, or else the last with all links and without
    /// effects.
    ///
    /// # Errors
    /// There is none.
    pub fn base(&self) -> Result<&Variant, InputError> {
        self.robot.base().ok_or_else(|| {
            input_error!(tau_codes::discovery::NO_BASE, &self.robot.name;
                "there is no variant with all links and without effects to start from")
        })
    }

    /// Searches for what a variant lacks among the effects of the catalogue that ships, on the poses that
    /// calibrate.
    ///
    /// # Errors
    /// [`Error::Input`] where these measurements can't be used; [`Error::NotConverged`] where the base does not fit.
    pub fn discover(&self, base: impl VariantKey<R>) -> Result<Outcome, Error> {
        self.discover_with(base, &Options::default(), &mut |_| {})
    }

    /// The same with options, of which the split is the session's; `progress` is told of each step in words.
    ///
    /// # Errors
    /// As [`Self::discover`]; a catalogue that can't be used.
    pub fn discover_with(
        &self,
        base: impl VariantKey<R>,
        options: &Options,
        progress: &mut (dyn FnMut(&str) + Send),
    ) -> Result<Outcome, Error> {
        let base = base.variant_of(&self.robot)?;
        let options = Options {
            split: self.split,
            ..options.clone()
        };
        let Self {
            robot,
            robot_file,
            folder,
            ..
        } = self;
        tau_discovery::discover(robot, &base.name, robot_file, folder, &options, progress)
    }

    /// The variant that was found, calibrated: with its standard deviations as the search left them, or where poses are
    /// unknown and it could be, calibrated anew. It goes by name, since no handle was declared for it.
    ///
    /// # Errors
    /// As [`Self::calibrate`].
    pub fn state_found(&self, found: &Outcome) -> Result<Calibrated, Error> {
        self.stated(found, found.discovery.fit.clone())
    }

    fn stated(&self, found: &Outcome, verdict: Option<Verdict>) -> Result<Calibrated, Error> {
        let unknown = found.unknown.as_ref();
        if let Some(fitted) = unknown.and_then(|unknown| unknown.fitted.clone()) {
            return self.judged(Fit::UnknownPoses(fitted), &self.parts()?);
        }
        if let Some(own) = &found.calibration {
            let poses: Vec<usize> = own.weighing.taking_part(&found.poses).collect();
            let widening = verdict.as_ref().map_or(1.0, Verdict::widening);
            let record = self.provenance(own, &self.folder, &poses, widening);
            let mut calibration = own.clone();
            calibration.file.calibration = Some(record);
            return Ok(Calibrated::new(Fit::Poses(calibration), verdict));
        }
        let folder = unknown.map_or(&self.folder, |unknown| &unknown.folder);
        let mut calibration = found.stated(&self.robot_file, folder)?;
        // Its covariance holds the noise that was found already.
        let record = self.provenance(&calibration, folder, &found.poses, 1.0);
        calibration.file.calibration = Some(record);
        Ok(Calibrated::new(Fit::Poses(calibration), verdict))
    }

    /// The same fitted to all poses, also those that showed the gap. What could not be calibrated anew stays as the search
    /// left it.
    ///
    /// # Errors
    /// As [`Self::calibrate`].
    pub fn refit_found(&self, found: &Outcome) -> Result<Calibrated, Error> {
        let all = self.clone().split(Split::All);
        let Some(unknown) = &found.unknown else {
            let refitted = found.refitted_to_all(&self.robot_file, &self.folder)?;
            return all.stated(&refitted, None);
        };
        if unknown.fitted.is_none() {
            return self.state_found(found);
        }
        let (file, parts) = (&self.robot_file, all.parts()?);
        let fitted = found.calibration_of_unknown_poses(file, &self.folder, &parts.rows)?;
        all.judged(Fit::UnknownPoses(fitted), &parts)
    }

    /// The effects of files, then those of the catalogue that ships; mistakes of all files are reported together.
    ///
    /// # Errors
    /// A file is missing or can't be read; mistakes of its text, each at its place; a name that is reserved.
    pub fn catalogues(&self, paths: &[impl AsRef<Path>]) -> Result<Catalogues, InputError> {
        catalogues(&self.robot, paths)
    }
}

fn catalogues(robot: &Robot, paths: &[impl AsRef<Path>]) -> Result<Catalogues, InputError> {
    let mut model = Model::clone(&robot.model);
    let known = model.effects.clone();
    let mut read = Ok((Vec::new(), Vec::new()));
    for path in paths {
        let of_path = catalogue(path.as_ref(), &model);
        read = both(read, of_path).map(|((mut texts, mut remarks), (text, more))| {
            let file = path.as_ref().display();
            let is_known =
                |known: &[Effect], own: &Effect| known.iter().any(|first| first.is_rival_of(own));
            let own = more.effects.iter();
            let twice = own.filter(|own| is_known(&model.effects, own));
            remarks.extend(twice.map(|own| {
                let name = &own.name;
                let first = if is_known(&known, own) {
                    "the description"
                } else {
                    "another file"
                };
                remark!(tau_codes::discovery::EFFECT_TWICE;
                    "effect `{name}` of {file} is not used: {first} has one of that name")
            }));
            let acts = |own: &Effect| !places(&more, own).is_empty();
            let has_namesake = |own: &Effect| {
                let mut others = more.effects.iter();
                others.any(|other| other.name == own.name && acts(other))
            };
            let idle = more.effects.iter().filter(|own| !has_namesake(own));
            remarks.extend(idle.map(|own| {
                remark!(tau_codes::discovery::LACKS_PART;
                    "effect `{}` of {file} acts nowhere on this machine", own.name)
            }));
            model.effects.extend(more.effects);
            texts.push(text);
            (texts, remarks)
        });
    }
    read.map(|(mut texts, remarks)| {
        texts.push(CATALOGUE.to_owned());
        Catalogues { texts, remarks }
    })
}

/// A catalogue's text and its effects.
fn catalogue(path: &Path, model: &Model) -> Result<(String, Model), InputError> {
    let text = input_error::read(path, "effects in the language (.tau)")?;
    let alone = Model {
        effects: vec![],
        ..model.clone()
    };
    let effects = language::effects_from_text(&text, &alone).map_err(|errors| {
        InputError::of_description(&path.display().to_string(), &text, &errors)
    })?;
    let mut names = effects.effects.iter().map(|effect| &effect.name);
    if let Some(name) = names.find(|name| name.starts_with(UNNAMED)) {
        let file = path.display().to_string();
        let source = Source::new(&file, &text);
        let at = text.find(name.as_str()).unwrap_or_default();
        let problem = format!("the name `{name}` is reserved");
        return Err(reserved(InputError::at(
            tau_codes::discovery::RESERVED_NAME,
            source,
            at..at + name.len(),
            problem,
        )));
    }
    Ok((text, effects))
}
