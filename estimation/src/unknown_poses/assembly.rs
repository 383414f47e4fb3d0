//! From a folder to the unknowns of a calibration whose poses are unknown, and its residuals.

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

use nalgebra::Vector3;
use tau_kinematics::{Machine, Pose};
use tau_robot::measurements::{DISTANCES, Folder, PlateKind, PlateRow, TCP_POSES};
use tau_robot::robot_file::{RobotFile, StatedNoise};

use super::kinds::kinds_of_noise;
use super::measurand::Measurand;
use super::objects::{Object, ObjectUnknown, collect_objects};
use super::pose::{DriveReading, UnknownPose};
use super::quantity::{Measured, Quantity, base};
use super::rows::{Kind, RowPlace, Rows};
use super::tracker::{TrackerErrors, pose_sample, position_sample};
use crate::machine::error::Error;
use crate::numerics::parallel;
use crate::problem::POSE_UNKNOWNS;
use crate::problem::used_by_plate;

/// A step of Newton's method (m, rad) that moves a pose by less than a drawing leaves open of it.
const ROUGH_STEP: f64 = 1e-3;
/// Poses, clusters or samples that a thread takes at once: fewer are done before another thread has woken. Chunks are put
/// together in their order, so that nothing depends on the number of threads.
pub(super) const CHUNK: usize = 512;

/// Rows that take part.
pub(super) struct Chosen<'a> {
    /// Numbers of the poses whose own rows do.
    pub(super) poses: &'a BTreeSet<u32>,
    /// Lines of `distances.csv` that do.
    pub(super) distances: &'a BTreeSet<usize>,
    /// Rows that are left out all the same.
    pub(super) left_out: &'a BTreeSet<RowPlace>,
}

impl Chosen<'_> {
    fn takes(&self, place: &RowPlace) -> bool {
        let chosen = match place.other_pose {
            Some(_) => self.distances.contains(&place.line),
            None => self.poses.contains(&place.pose),
        };
        chosen && !self.left_out.contains(place)
    }
}

/// The measurements of a folder, with what they are taken of, and the poses.
#[derive(Debug, Clone)]
pub(super) struct Assembly<'a> {
    pub(super) folder: &'a Folder,
    pub(super) file: &'a RobotFile,
    pub(super) poses: Vec<UnknownPose>,
    /// Index of the pose of each number; readings of one dwell are of one pose.
    pub(super) index: BTreeMap<u32, usize>,
    pub(super) objects: Vec<Object>,
    pub(super) kinds: Vec<Kind>,
    /// Coordinates of a pose that are free.
    pub(super) free: &'static [usize],
}

impl<'a> Assembly<'a> {
    /// Poses that chosen rows are of, where the machine puts them, or where they were measured; roughly where drives are
    /// redundant, which contradict each other until the machine is known.
    pub(super) fn new(
        machine: &Machine,
        file: &'a RobotFile,
        folder: &'a Folder,
        chosen: &Chosen<'_>,
    ) -> Result<Self, Error> {
        let used = used_by_plate(machine);
        Ok(Self::with_closures(machine, &used, file, folder, chosen)?.0)
    }

    /// The same, and the closures at these poses if they were looked at; `used` are as in [`rows`](Self::rows).
    pub(super) fn with_closures(
        machine: &Machine,
        used: &[usize],
        file: &'a RobotFile,
        folder: &'a Folder,
        chosen: &Chosen<'_>,
    ) -> Result<(Self, Option<Rows>), Error> {
        let mut assembly = Self {
            folder,
            file,
            poses: vec![],
            index: BTreeMap::new(),
            objects: vec![],
            kinds: vec![],
            free: machine.pose_unknowns(),
        };
        assembly.collect_poses(chosen);
        assembly.kinds = kinds_of_noise(folder, file, machine)?;
        let is_redundant = machine.closure_count() > machine.pose_unknowns().len();
        let closures = match &machine.surroundings.reference {
            Some(stated) if is_redundant => {
                assembly.place_roughly(machine, stated.into())?;
                let closures = assembly.closures(machine, used, chosen)?;
                assembly.turn_to_closures(machine, used, closures)
            }
            _ => {
                assembly.place(machine)?;
                None
            }
        };
        let at = |(number, pose): (&u32, &usize)| (*number, assembly.poses[*pose].base.position);
        let poses = assembly.index.iter().map(at).collect();
        assembly.objects = collect_objects(folder, &file.measuring, &poses)?;
        Ok((assembly, closures))
    }

    /// Commands of every reading.
    pub(super) fn commands(&self) -> impl Iterator<Item = &[f64]> {
        let readings = self.poses.iter().flat_map(|pose| &pose.readings);
        readings.map(|reading| reading.commands_m.as_slice())
    }

    /// Unknowns of the objects.
    pub(super) fn object_unknowns(&self) -> impl Iterator<Item = &ObjectUnknown> {
        self.objects.iter().flat_map(|object| &object.unknowns)
    }

    fn collect_poses(&mut self, chosen: &Chosen<'_>) {
        let in_distances: BTreeSet<u32> = (self.folder.distances.iter())
            .filter(|row| chosen.distances.contains(&row.line))
            .flat_map(|row| row.poses)
            .collect();
        let takes = |pose: u32| chosen.poses.contains(&pose) || in_distances.contains(&pose);
        let dwells = self.folder.dwells();
        let mut numbers = BTreeMap::new();
        for (pose, dwell) in self.folder.tcp_poses.iter().zip(dwells) {
            if takes(pose.pose) {
                let number = *numbers.entry(dwell).or_insert(pose.pose);
                let reading = DriveReading {
                    commands_m: pose.commands_m.clone(),
                    directions: pose.directions.clone(),
                    tensions_n: pose.tensions_n.clone(),
                    conditions: pose.conditions,
                    place: RowPlace {
                        file: TCP_POSES,
                        line: pose.line,
                        pose: pose.pose,
                        other_pose: None,
                        drive: None,
                    },
                };
                let index = self.add(number, reading);
                self.index.insert(pose.pose, index);
            }
        }
        for row in &self.folder.plate_rows {
            if takes(row.pose) {
                let reading = DriveReading {
                    commands_m: row.commands_m.clone(),
                    directions: row.directions.clone(),
                    tensions_n: row.tensions_n.clone(),
                    conditions: row.conditions,
                    place: place_of(row),
                };
                self.add(row.pose, reading);
            }
        }
    }

    /// Adds readings of the drives at the pose of a number; its index.
    fn add(&mut self, number: u32, reading: DriveReading) -> usize {
        let next = self.poses.len();
        let index = *self.index.entry(number).or_insert(next);
        if index == next {
            self.poses.push(UnknownPose {
                number,
                base: Pose::from_zyz([0.0; 3], [0.0; 3]),
                readings: vec![],
            });
        }
        let readings = &mut self.poses[index].readings;
        // Drives that read the same were left where they were: that tells nothing twice.
        if readings
            .iter()
            .all(|known| known.commands_m != reading.commands_m)
        {
            readings.push(reading);
        }
        index
    }

    /// Number that the pose of a number has in [`Self::poses`].
    pub(super) fn number_of(&self, number: u32) -> Option<u32> {
        Some(self.poses[*self.index.get(&number)?].number)
    }

    /// Puts poses where the machine stands at their commands, whatever was measured.
    pub(super) fn place_by_drives(&mut self, machine: &Machine) -> Result<(), Error> {
        for pose in &mut self.poses {
            let Some(sample) = pose.first_sample() else {
                continue;
            };
            let view = sample.view();
            let reached = machine.forward_fitted(&view);
            let reached = reached.map_err(|error| pose.failed(machine.explained(error, &view)))?;
            pose.base = reached.pose;
        }
        Ok(())
    }

    /// Puts poses where they were measured, or where redundant links miss their lengths least, sought from where the
    /// machine is stated to stand. Ways between poses, along which all links keep their lengths, these have none.
    fn place_roughly(&mut self, machine: &Machine, stated: Pose) -> Result<(), Error> {
        let measured = self.measured_poses();
        let place = |poses: &mut [UnknownPose]| {
            for pose in poses {
                if let Some(&base) = measured.get(&pose.number) {
                    pose.base = base;
                } else if let Some(sample) = pose.first_sample() {
                    let view = sample.view();
                    let reached = machine.forward_roughly(&view.at(stated), ROUGH_STEP);
                    pose.base =
                        reached.map_err(|error| pose.failed(machine.explained(error, &view)))?;
                }
            }
            Ok(())
        };
        let chunks = self.poses.chunks_mut(CHUNK).collect();
        // The first error in order, whatever thread is faster.
        parallel::map_owned(chunks, place).into_iter().collect()
    }

    /// Moves poses to the other minimum of what their closures leave where that is less; the closures where none was moved.
    fn turn_to_closures(
        &mut self,
        machine: &Machine,
        used: &[usize],
        closures: Rows,
    ) -> Option<Rows> {
        let blocks = [closures];
        let shared: Vec<f64> = used.iter().map(|&index| machine.values[index]).collect();
        let mut own = vec![0.0; POSE_UNKNOWNS * self.poses.len()];
        if !self.revisit(&blocks, &shared, &mut own, self.mean_length_m(machine)) {
            return blocks.into_iter().next();
        }
        let measured = self.measured_poses();
        for (pose, own) in self.poses.iter().zip(own.chunks_exact_mut(POSE_UNKNOWNS)) {
            if measured.contains_key(&pose.number) {
                own.fill(0.0);
            }
        }
        self.move_by(&own);
        None
    }

    /// True if a pose takes part.
    pub(super) fn has_pose(&self, number: u32) -> bool {
        self.index.contains_key(&number)
    }

    /// Of each pose the first one at the same commands.
    pub(super) fn places(&self) -> Vec<usize> {
        let mut first_of: HashMap<Vec<u64>, usize> = HashMap::with_capacity(self.poses.len());
        let first = |(index, pose): (usize, &UnknownPose)| {
            let Some(reading) = pose.readings.first() else {
                return index;
            };
            let commands = reading.commands_m.iter().map(|command| command.to_bits());
            *first_of.entry(commands.collect()).or_insert(index)
        };
        self.poses.iter().enumerate().map(first).collect()
    }

    /// Mean length of the links at the first reading (m), 0 where there is none.
    pub(super) fn mean_length_m(&self, machine: &Machine) -> f64 {
        let first = self.poses.first().and_then(UnknownPose::first_sample);
        let length_m = first.and_then(|sample| machine.mean_length_m(&sample.view()).ok());
        length_m.unwrap_or_default()
    }

    fn measured_poses(&self) -> BTreeMap<u32, Pose> {
        let poses = self.folder.tcp_poses.iter();
        poses
            .map(|pose| (pose.pose, Pose::from_zyz(pose.position_m, pose.angles_rad)))
            .collect()
    }

    /// Puts poses where they were measured, or where the machine stands at the commands.
    fn place(&mut self, machine: &Machine) -> Result<(), Error> {
        let measured = self.measured_poses();
        let mut before: Option<(Vec<f64>, Pose)> = None;
        for pose in &mut self.poses {
            if let Some(&base) = measured.get(&pose.number) {
                pose.base = base;
                let commands = pose
                    .readings
                    .first()
                    .map(|reading| reading.commands_m.clone());
                before = commands.map(|commands| (commands, base));
                continue;
            }
            let Some(sample) = pose.first_sample() else {
                continue;
            };
            let view = sample.view();
            let from_reference = || {
                let known = machine.at_reference(&view)?;
                let reached = machine.forward_along(&known.commands_m, &view.at(known.pose));
                reached.or_else(|_| machine.forward_fitted(&view.at(known.pose)))
            };
            let along = |(commands, near): &(Vec<f64>, Pose)| {
                machine.forward_along(commands, &view.at(*near))
            };
            let reached = match &before {
                // A pose that a sketch does not reach from one it hardly reaches from another.
                Some(before) if machine.surroundings.is_sketch => along(before),
                Some(before) => (along(before).or_else(|_| from_reference()))
                    .or_else(|_| machine.forward_fitted(&view.at(before.1))),
                None => from_reference(),
            };
            let failed = |error| pose.failed(machine.explained(error, &view));
            let stated = machine.surroundings.reference.as_ref().map(Pose::from);
            let near = before.as_ref().map(|(_, near)| *near).or(stated);
            pose.base = match (reached, near) {
                // A machine as a sketch has it may not reach what the true one does: the fit finds both.
                (Err(_), Some(near)) if machine.surroundings.is_sketch => near,
                (reached, _) => reached.map_err(failed)?.pose,
            };
            before = Some((sample.commands_m.clone(), pose.base));
        }
        Ok(())
    }

    /// The residuals of chosen rows about the poses' bases; `used` are the indices in the variant of its parameters
    /// among the shared unknowns.
    pub(super) fn rows(
        &self,
        machine: &Machine,
        used: &[usize],
        chosen: &Chosen<'_>,
    ) -> Result<Vec<Rows>, Error> {
        self.beside(self.closures(machine, used, chosen)?, machine, used, chosen)
    }

    /// The same beside closures that are known.
    pub(super) fn beside(
        &self,
        closures: Rows,
        machine: &Machine,
        used: &[usize],
        chosen: &Chosen<'_>,
    ) -> Result<Vec<Rows>, Error> {
        let mut rows = vec![closures];
        let shared = used.len();
        let errors = TrackerErrors::of(&machine.variant).map(Arc::new);
        let tracker = (errors.as_ref(), used);
        let of_rows = |kind: PlateKind| {
            let own = self.folder.rows_of(kind);
            own.filter(|row| chosen.takes(&place_of(row)))
        };
        if let Some(kind) = self.kind(|of| of == Measurand::PosePosition) {
            rows.extend(self.poses_measured(kind, machine, tracker, chosen)?);
        }
        for kind in [PlateKind::Position, PlateKind::Height, PlateKind::BallBar] {
            let Some(component) = self.kind(|of| of.plate() == Some(kind)) else {
                continue;
            };
            let by_axis = matches!(self.kinds[component].of, Measurand::Coordinate(_));
            let mut alike: BTreeMap<(&str, Vec<usize>), Vec<&PlateRow>> = BTreeMap::new();
            for row in of_rows(kind) {
                let own = row.sigmas.iter().enumerate();
                let kinds = own.map(|(axis, sigma)| {
                    let kind = component + if by_axis { axis } else { 0 };
                    self.kind_by(kind, sigma.is_some())
                });
                let name = row.of.as_deref().unwrap_or("");
                alike.entry((name, kinds.collect())).or_default().push(row);
            }
            for ((name, kinds), own) in alike {
                let object = self.object_of(kind, name);
                let quantity = match (kind, object) {
                    (PlateKind::Position, None) => Quantity::Tcp,
                    (PlateKind::Position, Some(_)) => Quantity::Target,
                    (PlateKind::Height, None) => Quantity::Height {
                        normal: Vector3::z(),
                        offset_m: 0.0,
                    },
                    (PlateKind::Height, Some(object)) => Quantity::HeightOver {
                        normal: object.normal,
                    },
                    _ => Quantity::Ball,
                };
                let first = shared + object.map_or(0, |object| object.first);
                let has_errors = kind == PlateKind::Position;
                let mut measured = Rows::of_tracker(
                    (kind.file(), Measured::new(quantity)),
                    first..first + quantity.shared(),
                    kinds.into_iter().take(quantity.residuals()).collect(),
                    (errors.as_ref().filter(|_| has_errors), used),
                );
                for row in own {
                    self.measured(machine, row, quantity, &mut measured)?;
                }
                rows.push(measured);
            }
        }
        if let Some(kind) = self.kind(|of| of == Measurand::Distance) {
            let family = Arc::new(Measured::new(Quantity::Distance));
            let stating = self.kind_by(kind, true);
            let mut of_all = [kind, stating]
                .map(|kind| Rows::new(DISTANCES, Arc::clone(&family) as _, vec![], vec![kind]));
            for row in &self.folder.distances {
                let states_own = stating != kind && row.sigma_m.is_some();
                let measured = &mut of_all[usize::from(states_own)];
                let place = RowPlace {
                    file: DISTANCES,
                    line: row.line,
                    pose: row.poses[0],
                    other_pose: Some(row.poses[1]),
                    drive: None,
                };
                if !chosen.takes(&place) {
                    continue;
                }
                for number in row.poses {
                    let index = self.index[&number];
                    measured
                        .own
                        .extend((0..3).map(|axis| POSE_UNKNOWNS * index + axis));
                    measured.data.extend(self.poses[index].base.position_m());
                }
                measured.data.push(row.distance_m);
                measured
                    .weights
                    .push(self.relative(measured.kinds[0], row.sigma_m));
                measured.places.push(place);
            }
            rows.extend(of_all);
        }
        rows.retain(|rows| !rows.places.is_empty());
        Ok(rows)
    }

    /// Index of the first kind of such a measurand.
    pub(super) fn kind(&self, is_meant: impl Fn(Measurand) -> bool) -> Option<usize> {
        self.kinds.iter().position(|kind| is_meant(kind.of))
    }

    pub(super) fn object_of(&self, kind: PlateKind, name: &str) -> Option<&Object> {
        let kind = kind.object()?;
        let mut objects = self.objects.iter();
        objects.find(|object| object.kind == kind && object.name == name)
    }

    /// Kind of a row, of those of its measurand: the last one where it states its own noise.
    fn kind_by(&self, kind: usize, states_own: bool) -> usize {
        let of = self.kinds[kind].of;
        let last = self.kinds.iter().rposition(|own| own.of == of);
        last.filter(|_| states_own).unwrap_or(kind)
    }

    /// Weight of a row in units of its kind's.
    fn relative(&self, kind: usize, sigma_m: Option<f64>) -> f64 {
        match (self.kinds[kind].stated, sigma_m) {
            (Some(StatedNoise::Known(of_kind)), Some(sigma)) => of_kind / sigma,
            _ => 1.0,
        }
    }

    fn measured(
        &self,
        machine: &Machine,
        row: &PlateRow,
        quantity: Quantity,
        to: &mut Rows,
    ) -> Result<(), Error> {
        let index = self.index[&row.pose];
        to.begin(machine, row.kind.file(), || {
            position_sample(row, self.poses[index].base)
        })?;
        to.own
            .extend((0..quantity.own()).map(|axis| POSE_UNKNOWNS * index + axis));
        to.data.extend(base(&self.poses[index].base));
        for axis in 0..quantity.residuals() {
            let value = row.values[axis];
            to.data.push(value.unwrap_or(0.0));
            let weight = self.relative(to.kinds[axis], row.sigmas[axis]);
            to.weights.push(if value.is_some() { weight } else { 0.0 });
        }
        to.places.push(place_of(row));
        Ok(())
    }

    fn poses_measured(
        &self,
        kind: usize,
        machine: &Machine,
        tracker: (Option<&Arc<TrackerErrors>>, &[usize]),
        chosen: &Chosen<'_>,
    ) -> Result<Option<Rows>, Error> {
        let kinds = vec![kind, kind, kind, kind + 1, kind + 1, kind + 1];
        let of = (TCP_POSES, Measured::new(Quantity::Pose));
        let mut rows = Rows::of_tracker(of, 0..0, kinds, tracker);
        for measured in &self.folder.tcp_poses {
            let place = RowPlace {
                file: TCP_POSES,
                line: measured.line,
                pose: measured.pose,
                other_pose: None,
                drive: None,
            };
            if !chosen.takes(&place) {
                continue;
            }
            let pose = self.index[&measured.pose];
            rows.begin(machine, TCP_POSES, || pose_sample(measured))?;
            rows.own
                .extend((0..POSE_UNKNOWNS).map(|axis| POSE_UNKNOWNS * pose + axis));
            rows.data.extend(base(&self.poses[pose].base));
            rows.data.extend(base(&Pose::from_zyz(
                measured.position_m,
                measured.angles_rad,
            )));
            // A coordinate that the plate can't move along says nothing.
            let weight = |axis: usize| {
                let stated = match measured.sigmas.position_m.get(axis) {
                    Some(sigma) => self.relative(kind, *sigma),
                    None => self.relative(kind + 1, measured.sigmas.rotation_rad),
                };
                if self.free.contains(&axis) {
                    stated
                } else {
                    0.0
                }
            };
            rows.weights.extend((0..POSE_UNKNOWNS).map(weight));
            rows.places.push(place);
        }
        Ok((!rows.places.is_empty()).then_some(rows))
    }
}

pub(super) fn place_of(row: &PlateRow) -> RowPlace {
    RowPlace {
        file: row.kind.file(),
        line: row.line,
        pose: row.pose,
        other_pose: None,
        drive: None,
    }
}
