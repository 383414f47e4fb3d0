//! Refusals before a fit.

use tau_codes::fit;
use tau_kinematics::{Machine, Sample};
use tau_robot::input_error::InputError;
use tau_robot::measurements::{Folder, SAME_POSE};

use super::Rank;
use super::elimination::Reduced;
use super::fit::Fit;
use super::rows::CLOSURES;
use crate::machine::Error;
use crate::trust::hypothesis::{Hypothesis, UNITS};
use crate::trust::{Mistake, words};
use crate::weighing::Treatment;

/// Lengths that are farther off than this (m) by half of their rows are no measurement of a machine whose drawing is
/// known to centimetres.
const UNIT_M: f64 = 1.0;
/// Lengths that are this many times nearer in another unit are in that.
const UNIT_OFF: f64 = 10.0;
/// Links that are this many times as long as at the reference are none of the machine, if their drives turn: degrees pay out
/// fifty times as much. Half and double refuse the same folders.
const LONG: f64 = 3.0;

impl Fit<'_> {
    /// Refuses measurements that see nothing, as many factors as points, and a scale that nothing determines.
    pub(super) fn refuse_rank(&self, rank: &Rank, free_scale: bool) -> Result<(), Error> {
        let Some(why) = rank
            .why_not()
            .filter(|_| !rank.is_seen || rank.is_saturated() || !free_scale)
        else {
            return Ok(());
        };
        let help = if !rank.is_seen {
            "measure something else: `tau robots` lists what tells of the standard robots"
                .to_owned()
        } else if rank.is_saturated() {
            self.more_poses(rank.poses_needed())
        } else {
            "measure a distance, or take a variant that holds what lengths are counted by, such as radii of drums; `--free-scale` fits it all the same, with the size of the tolerances".to_owned()
        };
        Err(InputError::whole(why.code, &self.folder.name, why.text)
            .help(help)
            .into())
    }

    /// Refuses a treatment of gross measurements where none can be told to be one, so that it would change nothing.
    pub(super) fn refuse_treatment(&self, treatment: Treatment) -> Result<(), Error> {
        let can_be_told = (0..self.blocks.len()).any(|block| self.can_be_gross(block));
        if can_be_told || treatment == Treatment::default() {
            return Ok(());
        }
        let why = "no single reading can be told to be off: a drive moves several links at once, and nothing but drives was \
                   measured";
        let help = "state what links scatter by under `[noise.links]`, or leave out `--loss` and `--keep-outliers`, which would \
                    change nothing";
        Err(
            InputError::whole(fit::NO_SINGLE_READING, &self.folder.name, why)
                .help(help)
                .into(),
        )
    }

    /// Remedy where so many poses would have to calibrate.
    fn more_poses(&self, needed: usize) -> String {
        let (calibrate, validate) = (&self.division.calibration, &self.division.validation);
        let poses = calibrate.union(validate).count();
        if poses == calibrate.len() {
            return format!("measure at least {needed} poses like these");
        }
        let all = (needed * poses).div_ceil(calibrate.len().max(1));
        format!(
            "measure at least {all} poses like these, of which {needed} calibrate, or {needed} with `--split all`"
        )
    }

    /// Refuses lengths in another unit than metres that are plausible in themselves, by the residuals at the start.
    pub(super) fn refuse_units(&self, reduced: &Reduced) -> Result<(), Error> {
        for (rows, residuals) in self
            .blocks
            .iter()
            .zip(&reduced.residuals)
            .skip(CLOSURES + 1)
        {
            if rows.kinds.len() != 1 {
                continue;
            }
            let measured = rows.data.chunks_exact(rows.family.shape().data);
            let off = |divisor: f64| {
                let pairs = residuals.iter().zip(&rows.weights).zip(measured.clone());
                let mut off: Vec<f64> = pairs
                    .map(|((residual, weight), data)| {
                        let sigma = self.assembly.kinds[rows.kinds[0]].sigma;
                        let measured = data[data.len() - 1];
                        let predicted = residual * sigma / weight + measured;
                        (predicted - measured / divisor).abs()
                    })
                    .collect();
                off.sort_by(f64::total_cmp);
                off[off.len() / 2]
            };
            let as_is = off(1.0);
            let tried = UNITS.into_iter().filter_map(|unit| match unit {
                Hypothesis::Unit(of_metre) => Some((off(of_metre), unit)),
                _ => None,
            });
            let nearest = tried.min_by(|a, b| a.0.total_cmp(&b.0));
            let (as_unit, unit) = nearest.unwrap_or((as_is, Hypothesis::Unit(1.0)));
            let file = self.assembly.kinds[rows.kinds[0]].of.file();
            let mistake = words::of_measurements(&self.machine.robot, &unit, file);
            if as_is > UNIT_OFF * as_unit
                && as_is > UNIT_M
                && let Some(Mistake { what, mend, .. }) = mistake
            {
                let message = format!(
                    "the lengths are {as_is:.3} m off what the machine would have them, {as_unit:.3} m if {what}"
                );
                return Err(
                    InputError::whole(fit::LENGTH_UNIT, rows.label.clone(), message)
                        .help(mend)
                        .into(),
                );
            }
        }
        Ok(())
    }
}

/// Refuses angles in degrees: most rows have links many times as long as at the reference, and radians mend that.
pub(super) fn refuse_commands(machine: &Machine, folder: &Folder) -> Result<(), Error> {
    let turns = (0..machine.robot.commands).any(|command| machine.robot.is_angle(command));
    let Some(stated) = machine.surroundings.reference.as_ref().filter(|_| turns) else {
        return Ok(());
    };
    let length_m = |commands_m: &[f64]| {
        let sample = Sample::new(stated.into(), commands_m);
        machine.mean_length_m(&sample).ok()
    };
    let Some(usual_m) = length_m(&stated.commands_m) else {
        return Ok(());
    };
    let of_rows = folder
        .plate_rows
        .iter()
        .map(|row| (row.pose, &row.commands_m));
    let of_poses = (folder.tcp_poses.iter()).map(|pose| (pose.pose, &pose.commands_m));
    let all: Vec<(u32, &Vec<f64>)> = of_rows.chain(of_poses).collect();
    let is_long = |commands_m: &[f64]| length_m(commands_m).is_some_and(|own| own > LONG * usual_m);
    let long: Vec<_> = all.iter().filter(|(_, own)| is_long(own)).collect();
    let Some((pose, commands_m)) = long.first().filter(|_| 2 * long.len() > all.len()) else {
        return Ok(());
    };
    let in_radians = |(command, &value): (usize, &f64)| {
        if machine.robot.is_angle(command) {
            value.to_radians()
        } else {
            value
        }
    };
    let as_degrees: Vec<f64> = commands_m.iter().enumerate().map(in_radians).collect();
    if is_long(&as_degrees) {
        return Ok(());
    }
    let message = format!(
        "at the commands of pose {pose} links are {:.1} m long in the mean, at those of the reference {usual_m:.1} m",
        length_m(commands_m).unwrap_or_default(),
    );
    let error = InputError::whole(fit::COMMAND_UNIT, &folder.name, message);
    Err(error
        .help("the commands look like degrees: multiply by pi/180")
        .into())
}

/// Refuses rows of one pose at other commands where drives are exact: they can't both be where the plate stood.
pub(super) fn refuse_contradictions(fit: &Fit<'_>) -> Result<(), Error> {
    let has_noise = |command| fit.file.noise_of_drive(command).is_some();
    let is_noisy = (0..fit.machine.robot.commands).any(has_noise);
    if is_noisy || fit.file.noise_of_links().is_some() {
        return Ok(());
    }
    let mut ranges = vec![(f64::INFINITY, f64::NEG_INFINITY); fit.machine.robot.commands];
    for commands in fit.assembly.commands() {
        for ((low, high), &command) in ranges.iter_mut().zip(commands) {
            (*low, *high) = (low.min(command), high.max(command));
        }
    }
    for pose in &fit.assembly.poses {
        let [first, others @ ..] = &pose.readings[..] else {
            continue;
        };
        for other in others {
            let pairs = first.commands_m.iter().zip(&other.commands_m).enumerate();
            let mut differing = pairs.filter(|(command, (a, b))| {
                let (low, high) = ranges[*command];
                (*a - *b).abs() > SAME_POSE * (high - low)
            });
            let Some((command, (expected, found))) = differing.next() else {
                continue;
            };
            let (place, before) = (other.place, first.place);
            let message = format!(
                "found {found} in `{}` at pose {}, expected {expected} as in line {} of {}: drives without noise stand still \
                 at a pose",
                fit.machine.robot.command_column(command),
                pose.number,
                before.line,
                before.file
            );
            let help = "correct it, give the row a pose of its own, or state the noise of the drives in `[drives]`";
            let source = format!("{}:{}", place.file, place.line);
            return Err(InputError::whole(fit::CONTRADICTION, source, message)
                .help(help)
                .into());
        }
    }
    Ok(())
}
