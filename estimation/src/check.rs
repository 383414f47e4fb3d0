//! Contents of a folder and parameters that it determines, before anything is fitted.

use std::collections::BTreeSet;

use serde::Serialize;
use tau_codes::{Remark, fit};
use tau_robot::measurements::set::POSITION;
use tau_robot::measurements::{
    CART_POSES, CART_POSITIONS, Conditions, DISTANCES, Division, Folder, PlateKind, TCP_POSES,
    TcpPose, visits,
};
use tau_robot::robot::{ResidualKind, Robot, Variant};
use tau_robot::robot_file::RobotFile;

use crate::calibration::known::Known;
use crate::calibration::{Combination, check_places, check_poses};
use crate::machine::error::unsolved;
use crate::machine::{Error, Prepared};
use crate::numerics::spread::spread;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::setup::Setup;
use crate::trust::numbering;
use crate::trust::observability::{Gap, Observability, missing, observabilities};
use crate::trust::of_folder::looked_at as of_poses;
use crate::trust::of_folder::plain;
use crate::trust::{Mistake, Reach, Reason};
use crate::uncertainty::Uncertainty;
use crate::unknown_poses::{self, Rank, RowDivision};

/// More poses than these are looked at by as many of them: what these determine all do, and what they leave is known to a
/// percent.
const MOST_POSES: usize = 4000;

/// A column's range.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Range {
    /// Name of the column.
    pub column: String,
    /// Lowest value, SI.
    pub low: f64,
    /// Highest value.
    pub high: f64,
    /// The widest stretch between two neighbouring values.
    pub widest_gap: (f64, f64),
}

/// A file of a folder.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FileFacts {
    /// Name of the file.
    pub file: &'static str,
    /// Measured quantity.
    pub kind: &'static str,
    /// Number of rows.
    pub rows: usize,
    /// Commands and positions.
    pub ranges: Vec<Range>,
    /// Rows at the commands of a row before: readings that tell of repeatability, not of the machine.
    pub repeats: usize,
    /// Numbers that are missing between the first and the last.
    pub missing_numbers: usize,
    /// Optional columns that are there.
    pub optional: Vec<&'static str>,
}

/// A variant, and what the measurements determine of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Checked {
    /// Its name.
    pub variant: String,
    /// Number of residuals that calibrate.
    pub rows: usize,
    /// Number of its parameters that they depend on.
    pub parameters: usize,
    /// Number of combinations of these that the data determine at all.
    pub rank: usize,
    /// Combinations that the data leave to the tolerances, worst first.
    pub undetermined: Vec<Combination>,
    /// Knowledge of the position at the poses and elsewhere that a calibration would bring.
    pub reach: Option<Reach>,
    /// Combinations that no residual sees, where poses are unknown.
    pub gauge: Option<Rank>,
    /// Why a calibration would mean nothing, if so.
    pub why_not: Option<Remark>,
}

/// Facts known before a fit.
#[derive(Debug, Clone, PartialEq)]
pub struct Check {
    /// Files that are there.
    pub files: Vec<FileFacts>,
    /// Those in which carts that exchange their numbers would go unnoticed.
    pub exchange_unnoticed: Vec<&'static str>,
    /// Variants.
    pub variants: Vec<Checked>,
    /// Effects of the catalogue.
    pub effects: Vec<Observability>,
    /// Files and columns that are missing.
    pub missing: Vec<Gap>,
    /// Mistakes that were recognised.
    pub mistakes: Vec<Mistake>,
    /// Residuals over the stated noise, where no mistake explains them and they exceed it significantly.
    pub misfit: Option<f64>,
}

impl Check {
    /// True if a calibration of one of the variants means anything.
    pub fn is_meaningful(&self) -> bool {
        !self.mistakes.iter().any(|mistake| mistake.is_absurd)
            && self
                .variants
                .iter()
                .any(|variant| variant.why_not.is_none())
    }
}

/// Why a variant can't be calibrated that no fit reaches, though its rows determine it.
const WITHOUT_FIT: &str = "no calibration from these values converges, and no mistake that was tried explains it: look for columns, \
    units or dimensions that are far off";

/// Looks at the measurements of a robot: `variants` are those that are asked for. The poses of `division` calibrate, or, where poses are unknown, the rows of the other.
///
/// # Errors
/// Columns or values that all variants need are missing.
pub fn check(
    robot: &Robot,
    variants: &[&Variant],
    file: &RobotFile,
    folder: &Folder,
    division: &Division,
    rows: Option<&RowDivision>,
) -> Result<Check, Error> {
    let effects = observabilities(robot, file, folder);
    let poses = &division.calibration;
    let setups: Vec<Setup<'_>> = (variants.iter())
        .map(|variant| Setup::new(robot, variant, file, folder))
        .collect();
    let mut checked: Vec<Checked> = (setups.iter())
        .map(|&setup| checked(setup, poses, rows))
        .collect();
    // A variant that is too simple has a misfit that is no mistake. Measured poses are judged by tolerances, however few they
    // are; of others, no fit tells a mistake where they can't calibrate.
    let tells = |own: &Checked| rows.is_none() || own.why_not.is_none();
    let telling = setups.iter().zip(&checked).filter(|(_, own)| tells(own));
    let largest = telling.max_by_key(|(_, own)| own.parameters);
    let looked_at = largest.map(|(setup, _)| setup).or(setups.first());
    let found = looked_at.map(|&setup| match rows {
        None => of_poses(setup, poses),
        Some(rows) => {
            let variant = plain(robot, setup.variant, folder);
            unknown_poses::recognised(Setup { variant, ..setup }, rows)
        }
    });
    // Where a variant can't be fitted for want of something, that is said of the variant.
    let found = found.and_then(Result::ok).unwrap_or_default();
    for (own, variant) in checked.iter_mut().zip(variants) {
        let is_without_fit = found.is_without_fit
            && looked_at.is_some_and(|setup| setup.variant.name == variant.name);
        let without_fit = is_without_fit.then(|| Remark::new(fit::NOT_CONVERGED, WITHOUT_FIT));
        let why_not = own
            .why_not
            .take()
            .or(found.another_machine.as_ref().map(Reason::remark));
        own.why_not = why_not.or(without_fit);
    }
    let drawn = (variants.first())
        .and_then(|variant| Prepared::new(robot, variant, file, Some(folder), &[]).ok());
    Ok(Check {
        files: files(robot, folder),
        exchange_unnoticed: drawn.map_or_else(Vec::new, |drawn| {
            numbering::unnoticed(&drawn.machine, folder)
        }),
        variants: checked,
        missing: missing(robot, folder, &effects),
        effects,
        mistakes: found.mistakes,
        misfit: found.misfit,
    })
}

fn range(column: String, values: impl Iterator<Item = f64>) -> Option<Range> {
    let mut sorted: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    sorted.sort_by(f64::total_cmp);
    let (&low, &high) = (sorted.first()?, sorted.last()?);
    let gap = sorted
        .windows(2)
        .map(|pair| (pair[0], pair[1]))
        .max_by(|a, b| (a.1 - a.0).total_cmp(&(b.1 - b.0)));
    Some(Range {
        column,
        low,
        high,
        widest_gap: gap.unwrap_or((low, low)),
    })
}

/// Rows whose numbers agree with those of a row before.
fn repeats<'a>(rows: impl Iterator<Item = &'a [f64]>) -> usize {
    let visits = visits(rows);
    visits.len() - visits.iter().max().map_or(0, |last| last + 1)
}

fn missing_numbers(numbers: impl Iterator<Item = u32>) -> usize {
    let numbers: BTreeSet<u32> = numbers.collect();
    match (numbers.first(), numbers.last()) {
        (Some(first), Some(last)) => (last - first) as usize + 1 - numbers.len(),
        _ => 0,
    }
}

/// A row of a file.
struct Row<'a> {
    number: u32,
    /// Of a row of one cart.
    track: Option<usize>,
    commands_m: &'a [f64],
    measured: [Option<f64>; 3],
    conditions: Conditions,
    has_direction: bool,
}

/// A file with its kind; `None` where it has no rows. `columns` are those of commands, and, by place, of what is measured.
fn facts<'a>(
    file: &'static str,
    kind: &'static str,
    (commands, measured): (&[String], &[(usize, &str)]),
    rows: impl Iterator<Item = Row<'a>>,
) -> Option<FileFacts> {
    let rows: Vec<Row<'_>> = rows.collect();
    let directions = (rows.first()?.track).map_or("dir1, dir2, …", |_| "dir");
    let of_command = |(k, column): (usize, &String)| {
        range(column.clone(), rows.iter().map(|row| row.commands_m[k]))
    };
    let of_measured = |&(k, column): &(usize, &str)| {
        range(
            column.to_owned(),
            rows.iter().filter_map(|row| row.measured[k]),
        )
    };
    let commands = commands.iter().enumerate().filter_map(of_command);
    let key = |row: &Row<'_>| -> Vec<f64> {
        let track = row.track.map(|track| track as f64).into_iter();
        track.chain(row.commands_m.iter().copied()).collect()
    };
    let keys: Vec<Vec<f64>> = rows.iter().map(key).collect();
    let all = |is: fn(&Row<'_>) -> bool| rows.iter().all(is);
    let optional = [
        ("time_s", all(|row| row.conditions.time_s.is_some())),
        (
            "temperature_c",
            all(|row| row.conditions.temperature_c.is_some()),
        ),
        (directions, all(|row| row.has_direction)),
    ];
    let optional = optional.into_iter().filter(|(_, is)| *is);
    Some(FileFacts {
        file,
        kind,
        rows: rows.len(),
        ranges: commands
            .chain(measured.iter().filter_map(of_measured))
            .collect(),
        repeats: repeats(keys.iter().map(Vec::as_slice)),
        missing_numbers: missing_numbers(rows.iter().map(|row| row.number)),
        optional: optional.map(|(name, _)| name).collect(),
    })
}

fn files(robot: &Robot, folder: &Folder) -> Vec<FileFacts> {
    let commands = robot.command_columns();
    let free = robot.plate.freedoms_of_tcp().iter();
    let position: Vec<(usize, &str)> = free.map(|&k| (k, POSITION[k])).collect();
    let poses = folder.tcp_poses.iter().map(|pose| Row {
        number: pose.pose,
        track: None,
        commands_m: &pose.commands_m,
        measured: pose.position_m.map(Some),
        conditions: pose.conditions,
        has_direction: pose.directions.is_some(),
    });
    let along_tracks = folder.cart_poses.iter().map(|cart| Row {
        number: cart.point,
        track: Some(cart.track),
        commands_m: std::slice::from_ref(&cart.command_m),
        measured: cart.position_m.map(Some),
        conditions: cart.conditions,
        has_direction: cart.direction.is_some(),
    });
    let at_poses = folder.cart_positions.iter().map(|cart| Row {
        number: cart.pose,
        track: Some(cart.track),
        commands_m: &cart.commands_m,
        measured: cart.position_m.map(Some),
        conditions: cart.conditions,
        has_direction: cart.direction.is_some(),
    });
    let (of_poses, of_track) = ((&commands[..], &position[..]), ["q_m".to_owned()]);
    let mut files = vec![
        facts(TCP_POSES, "poses of the plate", of_poses, poses),
        facts(
            CART_POSES,
            "poses of the carts along their tracks",
            (&of_track, &position),
            along_tracks,
        ),
        facts(
            CART_POSITIONS,
            "positions of the carts at random poses",
            of_poses,
            at_poses,
        ),
    ];
    files.extend(PlateKind::ALL.map(|kind| {
        let of_kind = match kind {
            PlateKind::Position => "positions of the TCP or of targets on the plate",
            PlateKind::Height => "distances of the TCP from a plane",
            PlateKind::BallBar => "distances of the TCP from a fixed ball",
            PlateKind::Reading => "readings of the drives alone",
        };
        let measured: Vec<(usize, &str)> = kind.columns().iter().copied().enumerate().collect();
        let rows = folder.rows_of(kind).map(|row| Row {
            number: row.pose,
            track: None,
            commands_m: &row.commands_m,
            measured: row.values,
            conditions: row.conditions,
            has_direction: row.directions.is_some(),
        });
        facts(kind.file(), of_kind, (&commands, &measured), rows)
    }));
    let mut files: Vec<FileFacts> = files.into_iter().flatten().collect();
    if !folder.distances.is_empty() {
        let values = folder.distances.iter().map(|row| row.distance_m);
        files.push(FileFacts {
            file: DISTANCES,
            kind: "distances between positions of the TCP",
            rows: folder.distances.len(),
            ranges: range("distance_m".to_owned(), values).into_iter().collect(),
            repeats: 0,
            missing_numbers: 0,
            optional: vec![],
        });
    }
    files
}

fn checked(setup: Setup<'_>, poses: &[usize], rows: Option<&RowDivision>) -> Checked {
    let mut checked = Checked {
        variant: setup.variant.name.clone(),
        rows: 0,
        parameters: 0,
        rank: 0,
        undetermined: vec![],
        reach: None,
        gauge: None,
        why_not: None,
    };
    let found = match rows {
        Some(rows) => by_rows(&mut checked, setup, rows),
        None => determine(&mut checked, setup, poses),
    };
    if let Err(error) = found {
        let code = error.code();
        let text = match error {
            Error::Input(error) => error.with_help(),
            error => error.text(),
        };
        checked.why_not = Some(Remark::new(code, text));
    }
    checked
}

/// Rank and gauge of rows of unknown poses.
fn by_rows(checked: &mut Checked, setup: Setup<'_>, rows: &RowDivision) -> Result<(), Error> {
    let (rank, weak) = unknown_poses::observability(setup, rows)?;
    checked.undetermined = weak;
    checked.rows = rank.rows;
    checked.parameters = rank.unknowns;
    checked.rank = rank.unknowns - rank.open.len().min(rank.unknowns);
    checked.why_not = rank.why_not();
    checked.gauge = Some(rank);
    Ok(())
}

fn determine(checked: &mut Checked, setup: Setup<'_>, poses: &[usize]) -> Result<(), Error> {
    let Setup {
        robot,
        variant,
        file,
        folder,
    } = setup;
    let file = &file.completed(robot);
    let prepared = Setup { file, ..setup }.prepared(poses)?;
    let machine = &prepared.machine;
    // Of many poses, some tell what all do: each counts for as many as it stands for.
    let some: Vec<usize> = (spread(poses.len(), MOST_POSES).into_iter())
        .map(|place| poses[place])
        .collect();
    let counted = poses.len() as f64 / some.len().max(1) as f64;
    let samples = Sample::all(robot, folder, &some, &Frames::default());
    let weights = vec![counted; samples.len()];
    let known = Known::at(&prepared, None, (&samples, file.noise), &weights, 1.0)?.of_parameters();
    let used = &known.used;
    let of_pose = variant.instances_of(ResidualKind::Closure).count();
    checked.rows = of_pose * poses.len();
    checked.parameters = used.len();
    let failed = |error: tau_solver::Error| Error::NotConverged {
        variant: variant.name.clone(),
        why: unsolved(&error),
    };
    let found = known
        .undetermined(variant, &machine.values)
        .map_err(failed)?;
    (checked.rank, checked.undetermined) = found;
    let is_stated = |(name, _): &(String, f64)| {
        let parameter = variant.parameters.iter().position(|own| own.name == *name);
        parameter.is_some_and(|index| prepared.nominal[index].sigma().is_some())
    };
    let open = checked.undetermined.iter().find(|combination| {
        combination.data_over_prior.is_infinite() && !combination.terms.iter().any(is_stated)
    });
    check_places(setup, poses, true)?;
    checked.why_not = open.map(|open| {
        let terms = open.terms.iter().take(4);
        let names: Vec<String> = terms.map(|term| term.0.clone()).collect();
        let text = format!(
            "nothing determines {}, and there are no tolerances for them",
            names.join(", ")
        );
        Remark::new(fit::UNDETERMINED, text)
    });
    if checked.why_not.is_none() {
        check_poses(setup, poses, true)?;
        let factor = known.factor(&known.posterior(), &prepared.track_scales);
        let known = factor.map(|factor| {
            Uncertainty::new(variant, used, &factor)
                .with_path_noise(file.noise.position_m)
                .with_track_scales(machine, used.len(), prepared.names_of_track_scales())
        });
        let measured: Vec<&TcpPose> = (poses.iter())
            .map(|&pose| &folder.tcp_poses[pose])
            .collect();
        checked.reach = known.and_then(|known| Reach::new(machine, &known, &measured, file.noise));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn repeats_are_rows_that_were_there_before() {
        let rows = [[0.1, 0.2], [0.1, 0.2 + 1e-9], [0.2, 0.1], [0.1, 0.2]];
        assert_eq!(repeats(rows.iter().map(<[f64; 2]>::as_slice)), 2);
        assert_eq!(missing_numbers([3, 4, 7, 9].into_iter()), 3);
        assert_eq!(missing_numbers(std::iter::empty()), 0);
    }

    /// Poses that all stand there twice tell as much as those of half the noise squared, be they looked at by a half.
    #[test]
    fn of_many_poses_each_that_is_looked_at_counts_for_others() {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let file = tau_robot::prototype::robot_file().unwrap();
        let prototype = tau_robot::prototype::folder().unwrap();
        let looked_at = |times: usize, readings: usize| {
            let mut folder = prototype.clone();
            let measured = prototype.tcp_poses.iter().cycle().take(times);
            let again = measured.flat_map(|pose| std::iter::repeat_n(pose, readings));
            folder.tcp_poses = again.cloned().collect();
            let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
            let variant = robot.variant("Full").unwrap();
            checked(Setup::new(&robot, variant, &file, &folder), &all, None)
        };
        let (once, twice) = (looked_at(MOST_POSES, 1), looked_at(MOST_POSES, 2));
        assert_eq!((2 * once.rows, once.rank), (twice.rows, twice.rank));
        assert!(!twice.undetermined.is_empty());
        for (own, other) in twice.undetermined.iter().zip(&once.undetermined) {
            let ratio = other.data_over_prior / own.data_over_prior;
            assert!((ratio - 2.0_f64.sqrt()).abs() < 1e-6, "{ratio}");
        }
        let [one, other] = [once, twice].map(|own| own.reach.unwrap().poses_m);
        assert!((one / other - 2.0_f64.sqrt()).abs() < 0.1, "{one} {other}");
    }

    #[test]
    fn the_widest_gap_is_found() {
        let found = range("q1_m".to_owned(), [0.5, -1.0, 0.4, f64::NAN].into_iter()).unwrap();
        assert_eq!((found.low, found.high), (-1.0, 0.5));
        assert_eq!(found.widest_gap, (-1.0, 0.4));
    }
}
