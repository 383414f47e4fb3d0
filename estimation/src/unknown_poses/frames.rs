//! Frames in which places of the plate may be measured, where poses are unknown, and zeros from which commands may count:
//! those of instruments and drives, not of the drawing.

use nalgebra::Vector3;
use tau_kinematics::Pose;
use tau_robot::measurements::{Folder, PlateKind, PlateRow, TCP_POSES};

use super::fit::Fit;
use super::pose::UnknownPose;
use crate::numerics::spread::spread;
use crate::samples::Sample;
use crate::trust::LARGEST_MISFIT;
use crate::trust::drawing::{self, Place, as_drawn, carrying};
use crate::trust::hypothesis::Hypothesis;
use crate::trust::recognise::{FEW_POSES, POSES};

/// Files of places of the plate in a common frame.
pub(super) fn files_of_places() -> [&'static str; 2] {
    [PlateKind::Position.file(), TCP_POSES]
}

impl Fit<'_> {
    /// The motion that carries what was measured, in a file or in all that hold places, to where the machine as drawn stands
    /// at its commands; `None` where it moves them by less than makes another machine, as other parameters would.
    pub(super) fn frame(&self, file: Option<&str>) -> Option<Hypothesis> {
        let all = self.read(POSES);
        let places = all.into_iter().filter_map(|(pose, sample)| {
            let drawn = as_drawn(&self.machine, &sample)?;
            Some(self.places(pose, drawn, file))
        });
        let places: Vec<Place> = places.flatten().collect();
        let found = carrying(&places, self.machine.robot.plate)?;
        let Hypothesis::Frame { rotation, shift } = &found else {
            return None;
        };
        let moved_m = places.iter().map(|place| {
            let measured = place.measured.position;
            (rotation * measured + shift - measured).norm()
        });
        let is_other = moved_m.fold(0.0, f64::max) > LARGEST_MISFIT * self.mean_length_m();
        is_other.then_some(found)
    }

    /// The zero of each command with which the drawing comes nearest to the measured places, where that is another.
    pub(super) fn zeros(&self) -> Vec<Hypothesis> {
        let all = self.read(FEW_POSES).into_iter();
        let all = all.map(|(pose, sample)| (pose, as_drawn(&self.machine, &sample), sample));
        let all: Vec<_> = all.collect();
        let moved = |command: usize, by: f64| {
            let places = all.iter().map(|(pose, drawn, sample)| {
                let moved = drawing::moved(&self.machine, sample, (*drawn)?, command, by)?;
                Some(self.places(pose, moved, None))
            });
            places.map(Option::unwrap_or_default).collect()
        };
        let zero = |command| drawing::zero(command, |by| moved(command, by));
        let first = self.assembly.poses.first();
        let first = first.and_then(UnknownPose::first_sample);
        let sigmas = first.and_then(|first| drawing::sigmas(&self.prepared, self.file, &first));
        let found = (0..self.machine.robot.commands).filter_map(zero);
        found
            .filter(|own| drawing::is_another(own, sigmas.as_deref()))
            .collect()
    }

    /// So many poses with readings of the drives.
    fn read(&self, poses: usize) -> Vec<(&UnknownPose, Sample)> {
        let all = &self.assembly.poses;
        let chosen = spread(all.len(), poses)
            .into_iter()
            .map(|index| &all[index]);
        let chosen = chosen.filter_map(|pose| Some((pose, pose.first_sample()?)));
        chosen.collect()
    }

    /// Measured places of a pose, in a file or in all, beside those that the drawing gives it.
    fn places(&self, pose: &UnknownPose, drawn: Pose, file: Option<&str>) -> Vec<Place> {
        let is_meant = |own: &str| file.is_none_or(|file| file == own);
        let lever_m = if self.machine.turns() {
            self.mean_length_m()
        } else {
            0.0
        };
        let is_there = |number: u32| self.assembly.number_of(number) == Some(pose.number);
        let of_poses = self.folder.tcp_poses.iter();
        let of_poses = of_poses.filter(|row| is_there(row.pose) && is_meant(TCP_POSES));
        let of_poses = of_poses.map(|row| Place {
            measured: Pose::from_zyz(row.position_m, row.angles_rad),
            drawn,
            lever_m,
        });
        let of_positions = self.folder.rows_of(PlateKind::Position);
        let of_positions =
            of_positions.filter(|row| is_there(row.pose) && is_meant(row.kind.file()));
        let of_positions = of_positions.map(|row| {
            let target = self.drawn_target(row);
            let position = drawn.position + drawn.rotation * target;
            Place {
                measured: Pose {
                    position: row.values.map(Option::unwrap_or_default).into(),
                    ..drawn
                },
                drawn: Pose { position, ..drawn },
                lever_m: 0.0,
            }
        });
        of_poses.chain(of_positions).collect()
    }

    /// Place on the plate (m) of what a row was measured of.
    fn drawn_target(&self, row: &PlateRow) -> Vector3<f64> {
        let object = self
            .assembly
            .object_of(row.kind, row.of.as_deref().unwrap_or(""));
        let unknowns = object.map_or(&[][..], |object| &object.unknowns);
        Vector3::from_iterator(unknowns.iter().map(|own| own.start).chain([0.0; 3]).take(3))
    }
}

/// True if all places of a folder have all coordinates along which the plate moves: a turned frame mixes them.
pub(super) fn are_whole(folder: &Folder, freedoms: &[usize]) -> bool {
    let mut rows = folder.rows_of(PlateKind::Position);
    rows.all(|row| freedoms.iter().all(|&axis| row.values[axis].is_some()))
}
