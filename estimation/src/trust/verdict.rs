//! The verdict on a fit or a prediction.

use serde::Serialize;
use std::fmt;

use tau_robot::measurements::{Folder, TcpPose};
use tau_robot::robot_file::RobotFile;

use crate::calibration::{Calibration, Carts, ParameterEstimate, Serial};
use crate::joint::judged::Judged;
use crate::machine::{Error, Prepared};
use crate::numerics::distribution::{chi2_survival, exceeds_noise};
use crate::numerics::order::largest_first;
use crate::numerics::parallel;
use crate::numerics::spread::spread;
use crate::setup::Setup;
use crate::trust::hypothesis::Case;
use crate::trust::mistake::{Mistake, MistakeKind};
use crate::trust::of_folder::{self, of_case};
use crate::trust::pull::Pull;
use crate::trust::reach::Reach;
use crate::trust::reason::{Reason, Repeated, Size};
use crate::trust::status::Status;
use crate::trust::tried::{self, ITERATIONS};
use crate::trust::{LARGEST_MISFIT, LEVEL, LISTED, numbering, wide};
use crate::uncertainty::Uncertainty;
use crate::weighing::{self, Loss, MOST_POSES, Outlier, Repeats, Weighing};

/// Residuals below this share of the stated noise make it suspect: by chance even twenty of them are never so small.
pub(super) const LEAST_RATIO: f64 = 1.0 / 3.0;

/// A kind of measurement in a file, and how it is met.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FileFit {
    /// Name of the file.
    pub file: &'static str,
    /// Kind of residual: `closure` (errors of link lengths), `position` or `rotation` of carts.
    pub kind: &'static str,
    /// Number of residuals.
    pub rows: usize,
    /// Root mean square, in `unit`.
    pub rms: f64,
    /// That to be expected of the stated noise, with what the fit absorbs.
    pub expected_rms: f64,
    /// `m` or `rad`.
    pub unit: &'static str,
}

/// A pose, and how it is met.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct PoseFit {
    /// Number in the file.
    pub pose: u32,
    /// Root mean square of its residuals over the stated noise.
    pub sigmas: f64,
}

impl PoseFit {
    /// The worst of poses by their number, worst first.
    pub(crate) fn worst(all: impl Iterator<Item = (u32, f64)>) -> Vec<Self> {
        let mut all: Vec<Self> = all.map(|(pose, sigmas)| Self { pose, sigmas }).collect();
        largest_first(&mut all, |pose| pose.sigmas);
        all.truncate(LISTED);
        all
    }
}

/// The verdict on a fit or a prediction, with its reasons.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Verdict {
    /// In one word.
    pub status: Status,
    /// Sum of squares of the residuals, in units of the stated noise.
    pub chi2: f64,
    /// Its expectation: residuals less what the fit absorbs.
    pub dof: f64,
    /// √(chi2/dof).
    pub residual_over_noise: f64,
    /// By file and kind of measurement.
    pub by_file: Vec<FileFit>,
    /// The worst poses, worst first.
    pub worst: Vec<PoseFit>,
    /// The parameters furthest from nominal, in tolerances, furthest first.
    pub pulls: Vec<Pull>,
    /// Knowledge of the position at the poses and elsewhere, of a calibration.
    pub reach: Option<Reach>,
    /// Reasons, and what else is to be known.
    pub why: Vec<Reason>,
    /// Mistakes that explain it.
    pub mistakes: Vec<Mistake>,
    /// Poses far off all others, by number; the figures above are of the others where these were left out.
    pub outliers: Vec<Outlier>,
    /// Repeated readings, if there are any.
    pub repeats: Option<Repeats>,
    /// Residuals of the means of repeated readings over the noise of these means, the largest of kinds where the model misses
    /// them, poses being unknown; 0 without.
    pub means_over_noise: f64,
    /// Loss of the fit, if it is not least squares.
    pub loss: Option<Loss>,
    /// Correlation of the noise of poses that follow each other, if there is any.
    pub serial: Option<Serial>,
}

impl Verdict {
    /// Factor by which standard deviations are too small where the misfit is one of noise: √(chi2/dof) where that is
    /// inconsistent with the stated noise, else 1 (R. T. Birge, Phys. Rev. 40, 1932). Where readings are repeated, what
    /// those of a visit share is in the standard deviations already, and the ratio is that of what is left between visits;
    /// where poses are unknown, it is not, and the ratio is at least that of the means.
    pub fn widening(&self) -> f64 {
        let of_readings = if exceeds_noise(self.chi2, self.dof) {
            let ratio = self.repeats.map(|repeats| repeats.excess);
            ratio.unwrap_or(self.residual_over_noise)
        } else {
            1.0
        };
        of_readings.max(self.means_over_noise).max(1.0)
    }

    /// The verdict where mistakes of the input leave no fit, for a reason: its figures are not numbers.
    pub fn without_fit(mistakes: Vec<Mistake>, reason: &str) -> Self {
        let mut verdict = Self {
            status: Status::Absurd,
            chi2: f64::NAN,
            dof: f64::NAN,
            residual_over_noise: f64::NAN,
            ..Self::default()
        };
        verdict.blame(mistakes);
        verdict.why.push(Reason::NoFit(reason.to_owned()));
        verdict
    }

    /// One line: the status, and why.
    pub fn line(&self) -> String {
        format!("{}: {}", self.status.name(), self.reasons())
    }

    /// The reasons in sentences, each with its code.
    pub fn reasons(&self) -> String {
        let why: Vec<String> = self.why.iter().map(Reason::coded).collect();
        why.join(" ")
    }

    /// Takes over how the carts of sets 2 and 3 are met.
    fn meet_carts(&mut self, carts: Option<&Carts>, file: &RobotFile) {
        let mut missed = vec![];
        for group in carts.iter().flat_map(|carts| &carts.groups) {
            let component = group.group;
            let (file_name, kind) = (component.file(), component.quantity());
            let sigma = component.stated(file.noise);
            self.by_file.push(FileFit {
                file: file_name,
                kind,
                rows: group.residuals,
                rms: group.rms * sigma,
                expected_rms: sigma,
                unit: component.unit(),
            });
            if group.noise_factor > 1.0 {
                missed.push((kind, file_name, group.rms));
            }
        }
        if !missed.is_empty() {
            self.say(Status::Inconsistent, Reason::CartsMissed(missed));
        }
        self.outliers.extend(
            carts
                .iter()
                .flat_map(|carts| carts.outliers.iter().cloned()),
        );
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.line())
    }
}

/// The verdict on a calibration with the poses that it was made of and the robot file that it started from. Mistakes of the
/// input are those of all variants; they are looked for unless `known`.
///
/// # Errors
/// It was made of other poses; data that the variant takes are missing.
pub fn of_calibration(
    calibration: &Calibration,
    file: &RobotFile,
    folder: &Folder,
    poses: &[usize],
    known: Option<&[Mistake]>,
) -> Result<Verdict, Error> {
    let machine = &calibration.machine;
    let robot = &machine.robot;
    let weighing = &calibration.weighing;
    calibration.refuse_others(folder, poses)?;
    let counted: Vec<usize> = (0..poses.len())
        .filter(|&index| weighing.judged.get(index).copied().unwrap_or(true))
        .collect();
    let kept: Vec<usize> = counted.iter().map(|&index| poses[index]).collect();
    let poses = kept.as_slice();
    let spread = spread(poses.len(), MOST_POSES);
    let some: Vec<usize> = spread.iter().map(|&k| poses[k]).collect();
    let setup = Setup::new(robot, &machine.variant, file, folder);
    let case = of_folder::case(setup, &some);
    let own;
    let judged = match calibration.judged() {
        Some(known) => known,
        None => {
            let inflation: Vec<f64> = (spread.iter())
                .map(|&k| weighing.inflation.get(counted[k]).copied().unwrap_or(1.0))
                .collect();
            let at_found = Prepared {
                machine: machine.clone(),
                ..case.prepared()?
            };
            let (samples, noise) = (case.samples(), case.file.noise);
            let beside_carts = calibration.factor.as_ref();
            let beside_carts = beside_carts.filter(|_| calibration.carts.is_some());
            own = match beside_carts {
                Some(factor) => Judged::held(&at_found, &samples, noise, &inflation, factor),
                None => {
                    let start = (inflation.as_slice(), ITERATIONS);
                    Judged::new(&at_found, &machine.values, &samples, noise, start)
                }
            }?;
            &own
        }
    };
    let deviations = judged.deviations();
    let mut verdict = measured(&case, judged, Pull::largest(calibration.pulls()));
    verdict.know(weighing, folder);
    let beyond = tried::beyond_tolerance(&deviations, verdict.residual_over_noise);
    let beyond = beyond.map(|own| Pull::of(&own, &machine.variant));
    verdict.judge(beyond.as_ref());
    let is_off =
        tried::is_beyond_noise(&judged.misfit()) || verdict.residual_over_noise < LEAST_RATIO;
    let nominal = &case.prepared()?.nominal;
    let suspect = verdict.status > Status::Consistent
        || is_off
        || wide::widest_m(&machine.variant, nominal) > LARGEST_MISFIT * case.mean_length_m();
    let plain = of_folder::plain(robot, &machine.variant, folder);
    let fit = (calibration.judged())
        .filter(|_| plain.name == machine.variant.name && weighing.outliers.is_empty())
        .filter(|_| calibration.serial.is_none());
    let found = || match known {
        Some(known) => Ok(known.to_vec()),
        None => {
            let variant = plain;
            let case = of_folder::case(Setup { variant, ..setup }, poses);
            of_case(&case, fit, folder).map(|found| found.mistakes)
        }
    };
    let found = || suspect.then(found).transpose();
    let reach = || {
        let measured: Vec<&TcpPose> = case.folder.tcp_poses.iter().collect();
        let known = Uncertainty::of_calibration(calibration)?;
        Reach::new(machine, &known, &measured, file.noise)
    };
    let (found, reach) = parallel::both(found, reach);
    if let Some(mut found) = found? {
        // Residuals as large as the noise tell that it is stated rightly, whatever a variant without effects leaves.
        let is_noise = |mistake: &Mistake| mistake.kind == MistakeKind::Noise;
        found.retain(|own| is_off || !is_noise(own));
        verdict.blame(found);
    } else {
        verdict.blame(
            numbering::mistake(machine, folder, file.noise.rotation_rad)
                .into_iter()
                .collect(),
        );
    }
    let furthest = || {
        let own = tried::furthest(judged, &case, &case.prepared().ok()?, None)?;
        Some(Pull::of(&own, &machine.variant))
    };
    verdict.conclude(&case, false, furthest().as_ref());
    verdict.tell(weighing);
    verdict.meet_carts(calibration.carts.as_ref(), file);
    verdict.serial = calibration.serial;
    verdict.why.extend(calibration.serial.map(Reason::Serial));
    if verdict.status != Status::Absurd {
        verdict.reach = reach;
        let warning = verdict.reach.and_then(|reach| reach.warning());
        verdict.why.extend(warning);
    }
    Ok(verdict)
}

impl Calibration {
    /// Parameters by how far they lie off their nominal values, in tolerances.
    pub(crate) fn pulls(&self) -> impl Iterator<Item = Pull> {
        let of = |parameter: &ParameterEstimate| {
            Some(Pull {
                parameter: parameter.name.clone(),
                tolerances: (parameter.value - parameter.nominal) / parameter.tolerance?,
            })
        };
        let pulls = self.parameters.iter().filter_map(of);
        pulls.filter(|pull| pull.tolerances.is_finite())
    }
}

/// The figures of a fit, before they are judged.
pub(super) fn measured(case: &Case<'_>, judged: &Judged, pulls: Vec<Pull>) -> Verdict {
    let samples = case.samples();
    let misfit = judged.misfit();
    let (rms, expected_rms) = judged.closure_rms_m(&samples);
    let by_sample = judged.by_sample(samples.len()).into_iter();
    let numbers = samples.iter().map(|sample| sample.number);
    Verdict {
        status: Status::Consistent,
        chi2: misfit.chi2,
        dof: misfit.dof,
        residual_over_noise: misfit.ratio(),
        by_file: vec![FileFit {
            file: case.folder.poses_file(),
            kind: "closure",
            rows: misfit.rows,
            rms,
            expected_rms,
            unit: "m",
        }],
        worst: PoseFit::worst(numbers.zip(by_sample)),
        pulls,
        ..Verdict::default()
    }
}

impl Verdict {
    /// Takes over what the weighing of the poses of a folder found.
    pub(super) fn know(&mut self, weighing: &Weighing, folder: &Folder) {
        self.outliers.clone_from(&weighing.outliers);
        for outlier in &mut self.outliers {
            let mut poses = folder.tcp_poses.iter();
            let measured = poses.find(|measured| measured.pose == outlier.pose);
            outlier.file = folder.poses_file();
            outlier.line = measured.map(|measured| measured.line);
        }
        self.repeats = weighing.repeats;
        self.loss = weighing.loss;
    }

    /// Says what the weighing of the poses found.
    pub(super) fn tell(&mut self, weighing: &Weighing) {
        let all = &self.outliers;
        let outliers = (!all.is_empty()).then(|| Reason::Outliers {
            all: all.clone(),
            poses: weighing.fit.len(),
            loss: weighing.loss,
            limit_sigmas: weighing.limit_sigmas,
        });
        let kept = (weighing.kept_because.clone()).filter(|_| self.mistakes.is_empty());
        let kept = kept.map(Reason::Kept);
        let unsettled = (weighing.is_unsettled).then_some(Reason::Unsettled(weighing::ROUNDS));
        let repeats = weighing.repeats.as_ref().map(Repeats::reason);
        let all = [outliers, kept, unsettled, repeats];
        self.why.extend(all.into_iter().flatten());
    }

    /// Tests residuals, and tells of a parameter that is beyond its tolerance.
    pub(super) fn judge(&mut self, beyond: Option<&Pull>) {
        if exceeds_noise(self.chi2, self.dof) {
            let residuals = Reason::Beyond {
                over_noise: self.residual_over_noise,
                squares: [self.chi2, self.dof],
                is_unexplained: false,
            };
            self.say(Status::Inconsistent, residuals);
        }
        if let Some(pull) = beyond {
            let pulled = Reason::Pulled(pull.clone(), pull.tolerances);
            self.say(Status::Inconsistent, pulled);
        }
    }

    /// Takes over a reason that leaves the status no better than one.
    pub fn say(&mut self, status: Status, why: Reason) {
        self.status = self.status.max(status);
        self.why.push(why);
    }

    /// Takes over mistakes that were recognised, which are said after the reasons so far.
    pub(super) fn blame(&mut self, mistakes: Vec<Mistake>) {
        for mistake in mistakes {
            self.say(mistake.status(), Reason::Mistake(mistake.clone()));
            self.mistakes.push(mistake);
        }
    }

    /// Takes over mistakes of rows that it does not hold yet, which are said before the reasons so far.
    pub fn blame_rows(&mut self, mistakes: &[Mistake]) {
        for mistake in mistakes {
            if !self.mistakes.contains(mistake) {
                self.blame(vec![mistake.clone()]);
                self.why.rotate_right(1);
            }
        }
    }

    /// Takes over refusals of what no machine is like, unless a mistake tells why.
    pub(crate) fn refuse(&mut self, refusals: [Option<Reason>; 2]) {
        if self.mistakes.is_empty() {
            for why in refusals.into_iter().flatten() {
                self.say(Status::Absurd, why);
            }
        }
    }

    /// Says the rest: what is absurd without a name, and what it means for standard deviations where nothing explains the
    /// residuals.
    pub(super) fn conclude(
        &mut self,
        case: &Case<'_>,
        is_explained: bool,
        furthest: Option<&Pull>,
    ) {
        let off_m = self.by_file.first().map_or(0.0, |fit| fit.rms);
        self.refuse([
            case.another_machine(off_m),
            furthest.and_then(Pull::refusal),
        ]);
        let widening = self.widening();
        let is_explained = is_explained || !self.mistakes.is_empty();
        if self.status == Status::Inconsistent && widening > 1.0 && !is_explained {
            self.why.push(Reason::Lacks(widening));
        }
        if self.status == Status::Consistent {
            // Readings that share an error stay below noise that holds it.
            let is_shared = (self.repeats).is_some_and(|own| own.lack_of_fit.p_value < LEVEL);
            let is_small = chi2_survival(self.chi2, self.dof) > 1.0 - LEVEL;
            self.meet_noise(Reason::Within {
                over_noise: self.residual_over_noise,
                left: None,
                size: match (is_small, is_shared) {
                    (true, false) => Size::TooLarge,
                    (true, true) => Size::Unsaid,
                    (false, _) => Size::Chance,
                },
            });
        }
    }

    /// Takes over that residuals do not exceed the noise. Noise that is stated by far too large is not consistent with them:
    /// it hides what a model lacks.
    pub(crate) fn meet_noise(&mut self, why: Reason) {
        if why.is_noise_too_large() && self.residual_over_noise < LEAST_RATIO {
            self.say(Status::Inconsistent, why);
        } else {
            self.why.push(why);
        }
    }
}

impl Repeats {
    fn reason(&self) -> Reason {
        let rotation = self.rotation_rad.map(|sigma| (sigma, "rad"));
        let position = (self.position_m, "m");
        Reason::Repeats(Repeated {
            of: None,
            readings: self.readings,
            quantities: self.visits,
            sigmas: std::iter::once(position).chain(rotation).collect(),
            degrees: self.degrees as f64,
            over_noise: self.within_over_noise,
            is_estimated: false,
            is_shared: self.shared_over_noise > 0.0 && self.lack_of_fit.p_value < LEVEL,
            lack_of_fit: Some(self.lack_of_fit),
        })
    }
}
