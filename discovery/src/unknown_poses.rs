//! Discovery where true poses are unknown: from redundant drives, heights, distances, a ball bar, and poses beside them.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use tau_codegen::language::Model;
use tau_codes::{Remark, discovery};
use tau_estimation::calibration;
use tau_estimation::unknown_poses::{self, EstimatedPoses, RowDivision, UnknownPoses};
use tau_kinematics::Statics;
use tau_robot::measurements::{Division, Folder, PoseCounts};
use tau_robot::robot::Robot;
use tau_robot::robot_file::keys::effect_key;
use tau_robot::robot_file::{Noise, RobotFile, Value};

use super::constants::count;
use super::results::GrossRow;
use super::{DISCOVERED, Error, Input, Options, Outcome, remark_on_part, structural, variant_of};
use tau_estimation::Setup;

/// Result of a discovery in a folder whose poses are unknown.
#[derive(Clone)]
pub struct OfUnknownPoses {
    /// The folder, estimates for its poses: one for each reading of the drives.
    pub folder: Folder,
    /// Those that calibrate, and those that are held out.
    pub division: Division,
    /// Rows that took part, and those that are held out.
    pub rows: RowDivision,
    /// Numbers of poses by whether their own measurements calibrate.
    pub counts: PoseCounts,
    /// The calibration of the discovered variant; `None` where there is none, of which a remark says why.
    pub fitted: Option<UnknownPoses>,
}

impl fmt::Debug for OfUnknownPoses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("OfUnknownPoses");
        shown
            .field("division", &self.division)
            .finish_non_exhaustive()
    }
}

/// A folder whose poses are unknown.
pub(super) struct Unknown<'a> {
    pub(super) poses: EstimatedPoses<'a>,
    /// Values of the base, by name, at which they were estimated.
    pub(super) values: BTreeMap<String, f64>,
    /// True if those that validate take no part.
    pub(super) is_held_out: bool,
    /// Reason why effects of a tracker are not seen, where they aren't.
    pub(super) hides_tracker: Option<&'static str>,
}

/// The search in a folder without poses.
pub(super) fn search(
    (robot, model, base): (&Robot, &Model, &str),
    file: &RobotFile,
    folder: &Folder,
    options: &Options,
    progress: &mut dyn FnMut(&str),
) -> Result<Outcome, Error> {
    let (folder, remark) = with_known_tensions(folder, file, robot);
    let folder = &folder;
    let all = RowDivision::of(folder, options.split);
    let thinned = all.thinned(folder, count(options.constants.most_poses));
    let part = (thinned.as_ref())
        .map(|rows| remark_on_part(all.calibration.len(), rows.calibration.len()));
    let (counts, rows) = (all.counts(), thinned.unwrap_or(all));
    let fit = calibration::Options::default();
    let variant = variant_of(robot, base)?;
    let setup = Setup::new(robot, variant, file, folder);
    let of_base = unknown_poses::calibrate(setup, &rows, &fit)?;
    if let Some(mistake) = of_base.mistakes.first() {
        return Err(mistake.clone().into());
    }
    let machine = &of_base.calibration.machine;
    let names = machine
        .variant
        .parameters
        .iter()
        .map(|own| own.name.clone());
    let values: BTreeMap<String, f64> = names.zip(machine.values.iter().copied()).collect();
    let mut known: Option<UnknownPoses> = None;
    let mut round = 0;
    loop {
        round += 1;
        let mut file = file.clone();
        if !file.noise.position_m.is_finite() {
            file.noise.position_m = known.as_ref().unwrap_or(&of_base).usual_noise_m();
        }
        // A point does not turn.
        if !file.noise.rotation_rad.is_finite() && robot.plate.is_point() {
            file.noise.rotation_rad = Noise::OF_NO_ROTATION_RAD;
        }
        let mut poses = EstimatedPoses::of(&of_base, &file, folder, &rows)?;
        if let Some(known) = &known {
            poses = poses.without(known.left_out()).with_noise_of(known);
        }
        let unknown = Unknown {
            values: values.clone(),
            is_held_out: rows.is_disjoint(),
            hides_tracker: folder.hides_tracker(),
            poses,
        };
        let (estimated, division) = unknown.poses.folder();
        let input = Input {
            robot,
            model,
            base,
            file: &file,
            folder: &estimated,
            division: &division,
            unknown: Some(&unknown),
            options,
        };
        let mut outcome = structural::search(&input, progress)?;
        progress("calibrating what was found");
        let fitted = outcome.calibration_of_unknown_poses(&file, folder, &rows);
        // Effects that a base lacks may look like gross measurements or like noise, and may hide some.
        let is_other = |fitted: &UnknownPoses| {
            fitted.left_out() != *unknown.poses.left_out()
                || unknown.poses.change_of_noise(fitted) > options.constants.other_noise
        };
        let fitted = match fitted {
            Ok(fitted) if is_other(&fitted) && round < count(options.constants.searches) => {
                known = Some(fitted);
                continue;
            }
            fitted => fitted,
        };
        let stated = match &fitted {
            Ok(fitted) => fitted.calibration.clone(),
            Err(_) => outcome.stated(&file, &estimated)?,
        };
        let found = &mut outcome.discovery;
        found.remarks.extend(remark.into_iter().chain(part));
        found.remarks.extend(
            of_base
                .one_left()
                .map(|one| Remark::new(discovery::ROWS_LEFT_OUT, one.to_string())),
        );
        let gross = match &fitted {
            Ok(fitted) => {
                let told = fitted.gross_poses.iter();
                let told = told.map(|pose| {
                    let text = format!("Of the rows that were left out, {pose}.");
                    Remark::new(discovery::ROWS_LEFT_OUT, text)
                });
                found.remarks.extend(told);
                gross_rows(fitted)
            }
            Err(error) => {
                found.remarks.push(not_calibrated(error));
                known
                    .as_ref()
                    .map_or_else(|| gross_rows(&of_base), gross_rows)
            }
        };
        let verdict = fitted.as_ref().ok().map(UnknownPoses::verdict);
        found.conclude(&stated, verdict, robot);
        found.gross_rows.extend(gross);
        (found.gross_rows)
            .sort_by(|a, b| (&a.file, a.line, &a.drive).cmp(&(&b.file, b.line, &b.drive)));
        outcome.unknown = Some(OfUnknownPoses {
            folder: estimated,
            division,
            rows,
            counts,
            fitted: fitted.ok(),
        });
        return Ok(outcome);
    }
}

/// Rows that a calibration left out.
fn gross_rows(fitted: &UnknownPoses) -> Vec<GrossRow> {
    let machine = &fitted.calibration.machine;
    let rows = fitted.gross.iter();
    rows.map(|row| GrossRow::of(row, machine)).collect()
}

/// Remark where no calibration of the model that was found succeeds.
pub(super) fn not_calibrated(error: &Error) -> Remark {
    let what = "what was found could not be calibrated anew";
    let error = error.text();
    let text =
        format!("{what}, and the robot file holds the values at which the search ended: {error}");
    Remark::new(discovery::NO_CALIBRATION, text)
}

/// The folder without rows that lack a tension which others have, where statics can't stand in for it; with a remark on
/// what was left out.
fn with_known_tensions(
    folder: &Folder,
    file: &RobotFile,
    robot: &Robot,
) -> (Folder, Option<Remark>) {
    let mut folder = folder.clone();
    if !folder.has_measured_tensions() || Statics::new(robot, file).is_some() {
        return (folder, None);
    }
    let is_known = |tensions_n: &Option<Vec<f64>>, link: usize| {
        let tensions_n = tensions_n.as_ref();
        tensions_n.is_some_and(|all| all.get(link).is_some_and(|tension| !tension.is_nan()))
    };
    let of_rows = folder.plate_rows.iter().map(|row| &row.tensions_n);
    let of_poses = folder.tcp_poses.iter().map(|pose| &pose.tensions_n);
    let all: Vec<&Option<Vec<f64>>> = of_rows.chain(of_poses).collect();
    let measured: Vec<usize> = (0..robot.links.len())
        .filter(|&link| all.iter().any(|tensions_n| is_known(tensions_n, link)))
        .collect();
    let count = all.len();
    let has_all = |tensions_n: &Option<Vec<f64>>| {
        let mut measured = measured.iter();
        measured.all(|&link| is_known(tensions_n, link))
    };
    folder.plate_rows.retain(|row| has_all(&row.tensions_n));
    folder.tcp_poses.retain(|pose| has_all(&pose.tensions_n));
    let of_rows = folder.plate_rows.iter().map(|row| row.pose);
    let of_poses = folder.tcp_poses.iter().map(|pose| pose.pose);
    let poses: BTreeSet<u32> = of_rows.chain(of_poses).collect();
    (folder.distances).retain(|row| row.poses.iter().all(|pose| poses.contains(pose)));
    let left = count - folder.plate_rows.len() - folder.tcp_poses.len();
    let remark = (left > 0).then(|| {
        let text = format!(
            "{left} of {count} rows have no measured forces, and took no part: effects that follow tensions could not \
             be told apart there"
        );
        Remark::new(discovery::ROWS_LEFT_OUT, text)
    });
    (folder, remark)
}

impl Outcome {
    /// The calibration of what was found where poses are unknown. A parameter that is searched has many minima in its
    /// range: it starts where it was found.
    ///
    /// # Errors
    /// As [`unknown_poses::calibrate`].
    pub fn calibration_of_unknown_poses(
        &self,
        file: &RobotFile,
        folder: &Folder,
        rows: &RowDivision,
    ) -> Result<UnknownPoses, Error> {
        let robot = self.robot();
        let variant = variant_of(&robot, DISCOVERED)?;
        let found: BTreeSet<String> = (self.discovery.effects.iter())
            .map(|effect| format!("{}({})", effect.name, effect.place))
            .collect();
        let mut file = file.clone();
        for parameter in &variant.parameters {
            let key = effect_key(parameter).filter(|key| found.contains(*key));
            let at = self.values.get(&parameter.name);
            let (Some(key), Some(&at), None, Some((low, high))) =
                (key, at, parameter.tolerance, parameter.search)
            else {
                continue;
            };
            let value = Value {
                value: vec![at],
                tol: high - low,
                ..Value::default()
            };
            let values = file.effects.entry(key.to_owned()).or_default();
            values.insert(parameter.quantity.clone(), value);
        }
        let setup = Setup::new(&robot, variant, &file, folder);
        unknown_poses::calibrate(setup, rows, &calibration::Options::default())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_codes::fit;

    #[test]
    fn a_result_that_could_not_be_calibrated_is_told() {
        let error = Error::NotConverged {
            variant: DISCOVERED.to_owned(),
            why: Remark::new(fit::NOT_CONVERGED, "100 steps were not enough"),
        };
        insta::assert_snapshot!(not_calibrated(&error).to_string());
    }
}
