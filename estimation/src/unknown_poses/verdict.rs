//! The verdict on a calibration from unknown poses.

use tau_kinematics::Sample;

use super::UnknownPoses;
use super::kinds::AXES;
use super::rows::Kind;
use crate::trust::{
    FileFit, LARGEST_MISFIT, LISTED, PoseFit, Pull, Status, Verdict, general, shorten,
};
use crate::weighing::Outlier;
/// A parameter that is pulled farther than this many tolerances has a wrong tolerance, or takes up what the model
/// lacks: of a hundred parameters, one in a hundred and fifty machines has one by chance.
const FAR_PULL: f64 = 4.0;

impl UnknownPoses {
    /// Mean length of the links at the reference (m); infinite where there is none.
    fn length_m(&self) -> f64 {
        let machine = &self.calibration.machine;
        let stated = machine.surroundings.reference.as_ref();
        let length_m = stated.and_then(|stated| {
            let sample = Sample::new(stated.into(), &stated.commands_m);
            machine.mean_length_m(&sample).ok()
        });
        length_m.unwrap_or(f64::INFINITY)
    }

    /// Residuals against noise and parameters against tolerances.
    pub fn verdict(&self) -> Verdict {
        let ratio = self.residual_over_noise();
        let mut why = vec![];
        let mut status = Status::Consistent;
        if self.is_consistent() {
            why.push(format!(
                "Residuals are {} times their noise, {} of them beyond what the fit absorbs.",
                general(ratio, 3),
                general(self.dof, 3)
            ));
        } else {
            status = Status::Inconsistent;
            why.push(format!(
                "Residuals are {} times the stated noise: the model lacks something, or the noise is larger.",
                general(ratio, 3)
            ));
            if self.widened > 1.0 {
                why.push(format!(
                    "At the stated noise the parameters do not settle: they are those at {} times that noise, where \
                     tolerances hold them.",
                    general(self.widened, 2)
                ));
            }
            if self.rank.net_rows() == self.rank.factors() + 1 {
                why.push(
                    "One residual is left beyond the factors: every effect would explain it as well as any other; measure \
                     more poses to tell what the model lacks."
                        .to_owned(),
                );
            }
        }
        let mut pulls: Vec<Pull> = (self.calibration.parameters.iter())
            .filter_map(|parameter| {
                let tolerance = parameter.tolerance?;
                Some(Pull {
                    parameter: parameter.name.clone(),
                    tolerances: (parameter.value - parameter.nominal) / tolerance,
                })
            })
            .collect();
        shorten(&mut pulls);
        if let Some(pull) = pulls
            .first()
            .filter(|pull| pull.tolerances.abs() > FAR_PULL)
        {
            status = Status::Inconsistent;
            why.push(format!(
                "`{}` lies {} tolerances off its nominal value.",
                pull.parameter,
                general(pull.tolerances.abs(), 2)
            ));
        }
        for kind in self.kinds.iter().filter(|kind| kind.kind.is_estimated()) {
            let Kind {
                file,
                quantity,
                unit,
                sigma,
                ..
            } = kind.kind;
            let own = if AXES.contains(&quantity) {
                format!("{quantity} in {file}")
            } else {
                file.to_owned()
            };
            why.push(match kind.residual_over_noise() {
                Some(_) => format!(
                    "The noise of {own} was estimated: {} {unit}.",
                    general(sigma, 2)
                ),
                None => {
                    format!("The noise of {own} could not be estimated: the fit follows its rows.")
                }
            });
        }
        let missed = self.kinds.iter().map(|kind| &kind.kind);
        let missed = missed.filter(|kind| kind.is_of_carts() && kind.excess() > 1.0);
        let missed: Vec<String> = missed
            .map(|kind| {
                let times = general(kind.excess(), 2);
                format!("{}s in {} {times} times", kind.quantity, kind.file)
            })
            .collect();
        if !missed.is_empty() {
            why.push(format!(
                "Carts miss their stated noise, and count that much less: {}.",
                missed.join(", ")
            ));
        }
        for mistake in &self.mistakes {
            status = Status::Absurd;
            why.insert(
                0,
                format!("{}: {}; {}.", mistake.file, mistake.what, mistake.mend),
            );
        }
        let kinds = self
            .kinds
            .iter()
            .filter(|kind| kind.rows > 0 && kind.kind.stated.is_some());
        let mut verdict = Verdict {
            status,
            chi2: self.chi2,
            dof: self.dof,
            residual_over_noise: ratio,
            by_file: kinds
                .map(|fit| FileFit {
                    file: fit.kind.file,
                    kind: fit.kind.quantity,
                    rows: fit.rows,
                    rms: fit.kind.sigma * (fit.squares / fit.rows as f64).sqrt(),
                    expected_rms: fit.kind.sigma / fit.kind.excess()
                        * (fit.redundancy / fit.rows as f64).max(0.0).sqrt(),
                    unit: fit.kind.unit,
                })
                .collect(),
            worst: (self.gross.iter().take(LISTED))
                .map(|row| PoseFit {
                    pose: row.place.pose,
                    sigmas: row.sigmas,
                })
                .collect(),
            pulls,
            reach: None,
            why,
            mistakes: self.mistakes.clone(),
            outliers: (self.gross.iter())
                .map(|row| Outlier {
                    file: row.place.file,
                    pose: row.place.pose,
                    sigmas: row.sigmas,
                    weight: row.weight,
                })
                .collect(),
            repeats: None,
            loss: self.loss,
        };
        verdict.refuse_pulls();
        let off = (verdict.by_file.iter()).filter(|fit| fit.unit == "m");
        let off_m = off.map(|fit| fit.rms).fold(0.0, f64::max);
        if verdict.mistakes.is_empty() && off_m > LARGEST_MISFIT * self.length_m() {
            verdict.status = Status::Absurd;
            verdict.why.push(format!(
                "Measurements are missed by {} mm: this is another machine, or commands and measurements do not belong \
                 together.",
                general(1e3 * off_m, 3)
            ));
        }
        verdict
    }
}
