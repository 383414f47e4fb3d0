//! Mistakes of rows whose poses are unknown, as hypotheses with the rows as they would be without them.

use std::borrow::Cow;
use std::collections::BTreeSet;

use nalgebra::Vector3;
use tau_robot::measurements::{DISTANCES, Folder, PlateKind, PlateRow, TCP_POSES};

use super::RowDivision;
use super::fit::Fit;
use super::frames::{self, files_of_places};
use crate::calibration;
use crate::machine::Nominal;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::setup::Setup;
use crate::trust::exchanged::orders;
use crate::trust::hypothesis::{
    Hypothesis, UNITS, angles, axes, commands_in_degrees, neighbour, signs,
};
use crate::trust::recognise::{differ, has_sign};

/// Measurements and the robot that they are of.
#[derive(Clone, Copy)]
pub(super) struct Case<'a> {
    pub(super) setup: Setup<'a>,
    pub(super) division: &'a RowDivision,
    pub(super) options: &'a calibration::Options,
    /// Tolerances, where they are not as stated.
    pub(super) tolerances: Option<&'a Hypothesis>,
}

/// Parameters that may be far off, of a machine with links of some length.
#[derive(Default)]
pub(super) struct Dimensions {
    pub(super) nominal: Vec<Nominal>,
    pub(super) seen: Vec<usize>,
    pub(super) length_m: f64,
}

/// A mistake of rows, in one file or in all that have what it is about, or a dimension far off.
pub(super) struct Trial<'a> {
    pub(super) hypothesis: Hypothesis,
    /// The file; `None` for all.
    pub(super) file: Option<&'static str>,
    pub(super) folder: Cow<'a, Folder>,
}

impl Trial<'_> {
    /// The parameter that it sets free.
    pub(super) fn freed(&self) -> Option<usize> {
        match self.hypothesis {
            Hypothesis::Dimension { parameter, .. } => Some(parameter),
            _ => None,
        }
    }
}

impl<'a> Case<'a> {
    /// All hypotheses.
    pub(super) fn trials(&self, dimensions: &Dimensions) -> Vec<Trial<'a>> {
        let Setup { robot, folder, .. } = self.setup;
        let of_rows: BTreeSet<&str> = folder
            .plate_rows
            .iter()
            .map(|row| row.kind.file())
            .collect();
        let of_poses = (!folder.tcp_poses.is_empty()).then_some(TCP_POSES);
        let files: Vec<&'static str> = (PlateKind::ALL.iter().map(|kind| kind.file()))
            .filter(|file| of_rows.contains(file))
            .chain(of_poses)
            .collect();
        let of_distances = (!folder.distances.is_empty()).then_some(DISTANCES);
        let mut scopes: Vec<Option<&'static str>> = vec![None];
        if files.len() > 1 {
            scopes.extend(files.iter().copied().map(Some));
        }
        let commands = orders(robot.commands).into_iter().map(Hypothesis::Commands);
        let file = &self.setup.file.completed(robot);
        let fit = Fit::new(Setup { file, ..self.setup }, self.division);
        let signs = signs(robot, |command| {
            // Poses that the drawing can't take say nothing against it.
            fit.as_ref().map_or(true, |fit| {
                let (samples, length_m) = (fit.assembly.samples(), fit.mean_length_m());
                has_sign(&fit.machine, samples, command, length_m)
            })
        });
        let of_commands: Vec<Hypothesis> = commands
            .chain(signs)
            .chain(commands_in_degrees(robot))
            .collect();
        let turns_in_degrees = fit.as_ref().map_or(true, |fit| {
            let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
            let of = |folder: &Folder| Sample::all(robot, folder, &all, &Frames::default());
            let mended = mended(folder, &Hypothesis::Degrees, Some(TCP_POSES));
            let pairs = of(folder).into_iter().zip(of(&mended));
            differ(&fit.machine, pairs, fit.mean_length_m())
        });
        let of_files = files.iter().copied().chain(of_distances).flat_map(|file| {
            let shifted = [1, -1].map(Hypothesis::Shifted).into_iter();
            let is_height = file == PlateKind::Height.file();
            let has_lengths = file != PlateKind::Reading.file();
            let own = shifted
                .chain(is_height.then_some(Hypothesis::Heights))
                .chain(UNITS.into_iter().filter(move |_| has_lengths));
            own.map(move |own| (own, Some(file)))
        });
        let of_places = files.iter().filter(|file| files_of_places().contains(file));
        let of_places = of_places.flat_map(|file| {
            let turns = *file == TCP_POSES;
            let is_told = move |own: &Hypothesis| match own {
                Hypothesis::Axes { turned, .. } => turns || !turned,
                Hypothesis::Degrees => turns && turns_in_degrees,
                _ => turns,
            };
            let own = axes(robot.plate)
                .into_iter()
                .chain(angles(robot.plate))
                .chain([Hypothesis::Degrees]);
            own.filter(is_told).map(|own| (own, Some(*file)))
        });
        let of_commands = scopes.iter().flat_map(|&file| {
            let own = of_commands.iter().cloned();
            own.map(move |own| (own, file))
        });
        let mut frames: Vec<Option<&'static str>> = (files
            .iter()
            .copied()
            .filter(|file| files_of_places().contains(file)))
        .map(Some)
        .collect();
        if frames.len() > 1 {
            frames.push(None);
        }
        let is_whole = frames::are_whole(folder, robot.plate.freedoms_of_tcp());
        let drawn = fit.as_ref().ok().filter(|_| is_whole);
        let of_frames = frames
            .into_iter()
            .filter_map(|file| Some((drawn?.frame(file)?, file)));
        let of_zeros = drawn.map_or_else(Vec::new, Fit::zeros);
        let of_zeros = of_zeros.into_iter().map(|zero| (zero, None));
        let of_rows = of_commands
            .chain(of_files)
            .chain(of_places)
            .chain(of_frames)
            .chain(of_zeros);
        let of_rows = of_rows.map(|(hypothesis, file)| Trial {
            folder: Cow::Owned(mended(folder, &hypothesis, file)),
            hypothesis,
            file,
        });
        of_rows.chain(dimensions.freed_of(folder)).collect()
    }
}

impl Dimensions {
    /// Each of them set free.
    pub(super) fn freed_of<'f>(&self, folder: &'f Folder) -> impl Iterator<Item = Trial<'f>> {
        self.seen.iter().map(|&parameter| Trial {
            folder: Cow::Borrowed(folder),
            hypothesis: Hypothesis::Dimension {
                parameter,
                start: self.nominal[parameter].value,
            },
            file: None,
        })
    }
}

/// The rows as they would be without a mistake.
fn mended(folder: &Folder, hypothesis: &Hypothesis, file: Option<&str>) -> Folder {
    let given = folder;
    let mut folder = folder.clone();
    let is_meant = |own: &str| file.is_none_or(|file| file == own);
    if let Hypothesis::Shifted(by) = hypothesis {
        let known: BTreeSet<u32> = given.plate_poses().into_iter().map(|own| own.0).collect();
        let shifted = |pose: u32| pose.checked_add_signed(i32::try_from(-by).ok()?);
        for row in (folder.distances.iter_mut()).filter(|_| is_meant(DISTANCES)) {
            let own = row
                .poses
                .map(|pose| shifted(pose).filter(|pose| known.contains(pose)));
            if let [Some(a), Some(b)] = own {
                row.poses = [a, b];
            }
        }
        let of_file = |row: &&PlateRow| is_meant(row.kind.file());
        let rows: Vec<&PlateRow> = given.plate_rows.iter().filter(of_file).collect();
        let own = folder.plate_rows.iter_mut();
        for (place, row) in own.filter(|row| is_meant(row.kind.file())).enumerate() {
            if let Some(other) = neighbour(&rows, place, *by) {
                row.values = other.values;
                row.sigmas = other.sigmas;
                row.of.clone_from(&other.of);
            } else if let Some(other) = neighbour(&rows, place, -*by) {
                // Of the row at the end nothing is known; what it holds was measured there.
                row.commands_m.clone_from(&other.commands_m);
                row.directions.clone_from(&other.directions);
                row.conditions = other.conditions;
                row.tensions_n.clone_from(&other.tensions_n);
            }
        }
        let poses = folder.tcp_poses.iter_mut();
        for (place, pose) in poses.enumerate().filter(|_| is_meant(TCP_POSES)) {
            if let Some(other) = neighbour(&given.tcp_poses, place, *by) {
                pose.position_m = other.position_m;
                pose.angles_rad = other.angles_rad;
                pose.sigmas = other.sigmas;
            } else if let Some(other) = neighbour(&given.tcp_poses, place, -*by) {
                pose.commands_m.clone_from(&other.commands_m);
                pose.directions.clone_from(&other.directions);
                pose.conditions = other.conditions;
                pose.tensions_n.clone_from(&other.tensions_n);
            }
        }
        return folder;
    }
    for row in (folder.plate_rows.iter_mut()).filter(|row| is_meant(row.kind.file())) {
        match hypothesis {
            Hypothesis::Heights => row.values = row.values.map(|value| Some(-value?)),
            Hypothesis::Axes { columns, signs, .. } => {
                let given = row.values;
                row.values = [0, 1, 2].map(|axis| Some(signs[axis] * given[columns[axis]]?));
            }
            Hypothesis::Unit(of_metre) => {
                row.values = row.values.map(|value| Some(value? / of_metre));
            }
            Hypothesis::Frame { rotation, shift } if row.kind == PlateKind::Position => {
                let given = row.values;
                let at = rotation * Vector3::from(given.map(Option::unwrap_or_default)) + shift;
                row.values = [0, 1, 2].map(|axis| given[axis].map(|_| at[axis]));
            }
            own => own.mend_commands(&mut row.commands_m, row.directions.as_mut()),
        }
    }
    if let (Hypothesis::Unit(of_metre), true) = (hypothesis, is_meant(DISTANCES)) {
        let rows = folder.distances.iter_mut();
        rows.for_each(|row| row.distance_m /= of_metre);
    }
    if is_meant(TCP_POSES) {
        hypothesis.mend_poses(&mut folder.tcp_poses);
    }
    folder
}
