//! Discovery where no pose was measured: from redundant drives, heights, distances, a ball bar.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;
use std::time::Instant;

use tau_codegen::language::Model;
use tau_estimation::calibration;
use tau_estimation::unknown_poses::{self, EstimatedPoses, RowDivision, UnknownPoses};
use tau_robot::measurements::{Division, Folder, PoseCounts};
use tau_robot::robot::Robot;
use tau_robot::robot_file::{RobotFile, Value};
use tau_runtime::Owner;

use super::{Constants, DISCOVERED, Error, Input, Options, Outcome, searched, variant_of};

/// Result of a discovery in a folder whose poses are unknown.
#[derive(Clone)]
pub struct OfUnknownPoses {
    /// The folder, estimates for its poses: one for each reading of the drives.
    pub folder: Folder,
    /// Those that calibrate, and those that are held out.
    pub division: Division,
    /// The calibration of the discovered variant.
    pub fitted: UnknownPoses,
}

impl fmt::Debug for OfUnknownPoses {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut shown = f.debug_struct("OfUnknownPoses");
        shown
            .field("division", &self.division)
            .finish_non_exhaustive()
    }
}

impl OfUnknownPoses {
    /// Numbers of poses.
    pub fn counts(&self) -> PoseCounts {
        let total = self.folder.tcp_poses.len();
        PoseCounts {
            total,
            in_range: total,
            calibration: self.division.calibration.len(),
            validation: self.division.validation.len(),
        }
    }
}

/// A folder whose poses are unknown.
pub(super) struct Unknown<'a> {
    pub(super) poses: EstimatedPoses<'a>,
    /// Values of the base, by name, at which they were estimated.
    pub(super) values: BTreeMap<String, f64>,
}

/// The search in a folder without poses.
pub(super) fn search(
    (robot, model, base): (&Robot, &Model, &str),
    file: &RobotFile,
    folder: &Folder,
    options: &Options,
    started: Instant,
    progress: &mut dyn FnMut(&str),
) -> Result<Outcome, Error> {
    let rows = RowDivision::of(folder, options.split);
    let fit = calibration::Options::default();
    let variant = variant_of(robot, base)?;
    let fitted = unknown_poses::calibrate(robot, variant, file, folder, &rows, &fit)?;
    let machine = &fitted.calibration.machine;
    let names = machine
        .variant
        .parameters
        .iter()
        .map(|own| own.name.clone());
    let mut file = file.clone();
    if !file.noise.position_m.is_finite() {
        file.noise.position_m = fitted.usual_noise_m();
    }
    let mut unknown = Unknown {
        values: names.zip(machine.values.iter().copied()).collect(),
        poses: EstimatedPoses::of(&fitted, &file, folder, &rows)?,
    };
    let (estimated, division) = unknown.poses.folder();
    let mut is_last = false;
    loop {
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
        let mut outcome = searched(&input, started, progress)?;
        progress("calibrating what was found");
        let fitted = stated(
            &outcome,
            (robot, base),
            &file,
            folder,
            &rows,
            &options.constants,
        )?;
        // What a base lacks may look like gross measurements, and may hide some.
        let gross = fitted.left_out();
        if !is_last && gross != *unknown.poses.left_out() {
            unknown.poses = unknown.poses.without(gross);
            is_last = true;
            continue;
        }
        outcome.unknown = Some(OfUnknownPoses {
            folder: estimated,
            division,
            fitted,
        });
        return Ok(outcome);
    }
}

/// The calibration of what was found where poses are unknown, under the priors of the search: those of effects keep
/// within what is plausible, and do not pull back what the data say.
fn stated(
    outcome: &Outcome,
    (robot, base): (&Robot, &str),
    file: &RobotFile,
    folder: &Folder,
    rows: &RowDivision,
    constants: &Constants,
) -> Result<UnknownPoses, Error> {
    let found = outcome.robot();
    let variant = variant_of(&found, DISCOVERED)?;
    let known: BTreeSet<&str> = (variant_of(robot, base)?.parameters.iter())
        .map(|parameter| parameter.name.as_str())
        .collect();
    let mut wide = file.clone();
    let mut tolerances = vec![];
    for parameter in &variant.parameters {
        let key = parameter
            .name
            .split_once(").")
            .map(|(key, _)| format!("{key})"));
        let (Some(key), Some(tol)) = (key, parameter.tolerance) else {
            continue;
        };
        if matches!(parameter.owner, Owner::Effect(_)) && !known.contains(parameter.name.as_str()) {
            let values = wide.effects.entry(key.clone()).or_default();
            let value = values
                .entry(parameter.quantity.clone())
                .or_insert_with(|| Value {
                    value: vec![],
                    tol: constants.implausible * tol,
                    sigma: None,
                });
            value.value.push(parameter.nominal.unwrap_or_default());
            tolerances.push((key, parameter.quantity.clone(), tol));
        }
    }
    let options = calibration::Options::default();
    let mut fitted = unknown_poses::calibrate(&found, variant, &wide, folder, rows, &options)?;
    let effects = &mut fitted.calibration.file.effects;
    for (key, quantity, tol) in tolerances {
        let value = effects
            .get_mut(&key)
            .and_then(|values| values.get_mut(&quantity));
        if let Some(value) = value {
            value.tol = tol;
        }
    }
    Ok(fitted)
}
