//! Estimates of poses that are unknown, and the residuals that they leave: for what looks for effects, which depend on
//! where the machine stands.

use std::collections::{BTreeMap, BTreeSet};

use nalgebra::{DMatrix, DVector, Vector3};
use tau_kinematics::Machine;
use tau_robot::measurements::{Division, Folder, PoseSigmas, TcpPose};
use tau_robot::robot::{Instance, ResidualKind};
use tau_robot::robot_file::RobotFile;

use super::assembly::{Assembly, Chosen};
use super::directions::{lined_up, pivoted};
use super::elimination::{Elimination, Raw};
use super::outcome::{RowDivision, UnknownPoses};
use super::rows::{CLOSURES, Kind, RowPlace, Rows};
use crate::machine::error::Error;
use crate::machine::nominal::Nominal;
use crate::numerics::order::place;
use crate::problem::{Eliminated, Origin, POSE_UNKNOWNS, by_pose, gradient};
use crate::samples::Sample;

/// Rounds in which poses follow a machine; steps are those of Gauss and Newton, so that a handful is enough.
const ROUNDS: usize = 12;
/// Moves of a pose (m, rad) below which it has arrived: far below all noise.
const ARRIVED: f64 = 1e-7;

/// The measurements of a folder whose poses are unknown, with estimates of the poses.
#[derive(Debug, Clone)]
pub struct EstimatedPoses<'a> {
    calibration: Rowset<'a>,
    held_out: Rowset<'a>,
    left_out: BTreeSet<RowPlace>,
    /// Estimates of the unknowns of targets, surfaces and balls.
    objects: Vec<f64>,
}

/// Measurements that take part together.
#[derive(Debug, Clone)]
struct Rowset<'a> {
    assembly: Assembly<'a>,
    poses: BTreeSet<u32>,
    distances: BTreeSet<usize>,
}

/// Measurements that calibrate, or that are held out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Those that calibrate.
    Calibration,
    /// Those that are held out.
    HeldOut,
}

/// Samples where a machine puts them, and their residuals.
#[derive(Debug)]
pub struct Placed {
    /// The samples given, those of set 1 at poses that the measurements have there.
    pub samples: Vec<Sample>,
    /// The residuals.
    pub groups: Vec<Eliminated>,
}

impl<'a> EstimatedPoses<'a> {
    /// Those of a calibration; rows that it left out stay out.
    ///
    /// # Errors
    /// A pose can't be found from the drives.
    pub fn of(
        found: &UnknownPoses,
        file: &'a RobotFile,
        folder: &'a Folder,
        division: &RowDivision,
    ) -> Result<Self, Error> {
        let machine = &found.calibration.machine;
        let calibrates = |pose: &u32| division.calibration.contains(pose);
        let is_open = division.validation.iter().all(calibrates);
        let new: BTreeSet<u32> = (division.validation.iter())
            .filter(|pose| is_open || !calibrates(pose))
            .copied()
            .collect();
        let rowset = |poses: &BTreeSet<u32>, distances: &BTreeSet<usize>| {
            let nothing = BTreeSet::new();
            let chosen = Chosen {
                poses,
                distances,
                left_out: &nothing,
            };
            let mut assembly = Assembly::new(machine, file, folder, &chosen)?;
            assembly.kinds = found.kinds.iter().map(|kind| kind.kind).collect();
            assembly.objects.clone_from(&found.unknown_objects);
            Ok::<_, Error>(Rowset {
                assembly,
                poses: poses.clone(),
                distances: distances.clone(),
            })
        };
        Ok(Self {
            calibration: rowset(&division.calibration, &division.distances)?,
            held_out: rowset(&new, &division.held_out_distances)?,
            left_out: found.left_out(),
            objects: found.objects.iter().map(|object| object.value).collect(),
        })
    }

    /// Leaves a measurement out.
    pub fn leave_out(&mut self, place: RowPlace) {
        self.left_out.insert(place);
    }

    /// The same without some measurements, and with all others.
    #[must_use]
    pub fn without(&self, left_out: BTreeSet<RowPlace>) -> Self {
        Self {
            left_out,
            ..self.clone()
        }
    }

    /// The same with the noise that another calibration of the same measurements found. Drives that contradict each other
    /// stay loose: those that a model reconciles say nothing of one that does not.
    #[must_use]
    pub fn with_noise_of(mut self, found: &UnknownPoses) -> Self {
        for rowset in [&mut self.calibration, &mut self.held_out] {
            let kinds = rowset.assembly.kinds.iter_mut().zip(&found.kinds);
            for (own, found) in kinds.filter(|(own, _)| !own.is_loose) {
                *own = found.kind;
            }
        }
        self
    }

    /// Largest change of an estimated standard deviation to that which another calibration of the same measurements
    /// found, as a share.
    pub fn change_of_noise(&self, found: &UnknownPoses) -> f64 {
        let kinds = self.calibration.assembly.kinds.iter();
        let pairs = kinds.zip(found.kinds.iter().map(|kind| kind.kind));
        let changes = pairs
            .filter(|(kind, _)| kind.is_estimated())
            .map(|(before, after)| (after.sigma / before.sigma - 1.0).abs());
        changes.fold(0.0, f64::max)
    }

    /// Measurements that are left out.
    pub fn left_out(&self) -> &BTreeSet<RowPlace> {
        &self.left_out
    }

    fn rowset(&self, side: Side) -> &Rowset<'a> {
        match side {
            Side::Calibration => &self.calibration,
            Side::HeldOut => &self.held_out,
        }
    }

    /// The folder with the estimates for its poses, one for each reading of the drives, and those that calibrate and are
    /// held out.
    pub fn folder(&self) -> (Folder, Division) {
        let mut folder = self.calibration.assembly.folder.clone();
        let of_rowset = |rowset: &Rowset<'_>| {
            let samples = rowset.assembly.samples();
            samples.map(pose_of).collect::<Vec<TcpPose>>()
        };
        folder.tcp_poses = of_rowset(&self.calibration);
        let first = folder.tcp_poses.len();
        folder.tcp_poses.extend(of_rowset(&self.held_out));
        for (index, pose) in folder.tcp_poses.iter_mut().enumerate() {
            pose.line = index + 2;
        }
        let division = Division {
            calibration: (0..first).collect(),
            validation: (first..folder.tcp_poses.len()).collect(),
        };
        (folder, division)
    }

    /// Priors of the unknowns of targets, surfaces and balls, as displacements from the estimates.
    pub fn objects(&self) -> Vec<Nominal> {
        let unknowns = self.calibration.assembly.object_unknowns();
        let displaced = unknowns.zip(&self.objects).map(|(unknown, at)| {
            let prior = unknown.prior;
            Nominal::new(
                prior.map_or(0.0, |(mean, _)| mean - at),
                prior.map(|(_, sigma)| sigma),
            )
        });
        displaced.collect()
    }

    /// The samples where a machine, with objects displaced from the estimates, has them, and their residuals;
    /// directions of these are lined up with a reference, where there is one.
    ///
    /// # Errors
    /// A pose lacks what its closures read.
    pub fn placed(
        &self,
        side: Side,
        machine: &Machine,
        displaced: &[f64],
        samples: &[Sample],
        reference: &[Eliminated],
    ) -> Result<Placed, Error> {
        let mut rowset = self.rowset(side).clone();
        let mut shared = machine.values.clone();
        let objects = self.objects.iter().enumerate();
        shared.extend(objects.map(|(k, at)| at + displaced.get(k).copied().unwrap_or(0.0)));
        // Parameters keep the numbers that they have in the variant.
        let used: Vec<usize> = (0..machine.values.len()).collect();
        let chosen = Chosen {
            poses: &rowset.poses,
            distances: &rowset.distances,
            left_out: &self.left_out,
        };
        let assembly = &mut rowset.assembly;
        let own = vec![0.0; POSE_UNKNOWNS * assembly.poses.len()];
        let mut blocks = assembly.rows(machine, &used, &chosen)?;
        for _ in 0..ROUNDS {
            let steps = Elimination::new(&blocks, assembly, &shared, &own).steps();
            let largest = steps
                .iter()
                .fold(0.0, |most: f64, step| most.max(step.abs()));
            assembly.move_by(&steps);
            blocks = assembly.rows(machine, &used, &chosen)?;
            if largest < ARRIVED {
                break;
            }
        }
        let mut samples = samples.to_vec();
        let index = placed_samples(assembly, machine, &mut samples);
        let known: BTreeMap<&[usize], &Eliminated> = reference
            .iter()
            .map(|group| (group.samples.as_slice(), group))
            .collect();
        let tracked = assembly.tracked();
        let elimination = Elimination::new(&blocks, assembly, &shared, &own);
        let mut groups = elimination
            .raw_clusters()
            .into_iter()
            .map(|raw| {
                let raw = Grouped {
                    raw: &raw,
                    blocks: &blocks,
                    assembly,
                    index: &index,
                };
                let objects = (displaced, self.objects.len());
                raw.eliminated(machine, &samples, &tracked, objects, &known)
            })
            .collect::<Result<Vec<Eliminated>, Error>>()?;
        groups.retain(|group| group.by_closure.nrows() > 0);
        Ok(Placed { samples, groups })
    }
}

/// Puts samples of set 1 where their poses are; the index of the sample of each reading, in the order of the closures. All
/// readings have one: the [folder](EstimatedPoses::folder) of which the samples are lists them.
fn placed_samples(
    assembly: &Assembly<'_>,
    machine: &Machine,
    samples: &mut [Sample],
) -> Vec<usize> {
    let key = |sample: &Sample| {
        let commands = sample.commands_m.iter().map(|command| command.to_bits());
        (sample.number, commands.collect::<Vec<u64>>())
    };
    let mut places = BTreeMap::new();
    for (place, sample) in samples.iter().enumerate() {
        if sample.set == 1 {
            places.entry(key(sample)).or_insert(place);
        }
    }
    let mut index = vec![];
    for reading in assembly.samples() {
        let Some(&place) = places.get(&key(&reading)) else {
            continue;
        };
        let sample = &mut samples[place];
        sample.pose = reading.pose;
        sample.plate = Some(reading.pose);
        if let Some(statics) = &machine.surroundings.statics {
            sample.load(statics);
        }
        index.push(place);
    }
    index
}

fn pose_of(sample: Sample) -> TcpPose {
    let (directions, tensions_n) = (sample.directions(), sample.tensions_n());
    TcpPose {
        pose: sample.number,
        line: 0,
        position_m: sample.pose.position.into(),
        angles_rad: sample.pose.angles_rad(),
        conditions: sample.conditions,
        directions: (!directions.is_empty()).then(|| directions.to_vec()),
        tensions_n: (!tensions_n.is_empty()).then(|| tensions_n.to_vec()),
        sigmas: PoseSigmas::default(),
        commands_m: sample.commands_m,
    }
}

/// The rows of poses that belong together, with what they are rows of.
pub(super) struct Grouped<'b> {
    pub(super) raw: &'b Raw,
    pub(super) blocks: &'b [Rows],
    pub(super) assembly: &'b Assembly<'b>,
    /// Index of the sample of each reading.
    index: &'b [usize],
}

impl Grouped<'_> {
    fn eliminated(
        &self,
        machine: &Machine,
        samples: &[Sample],
        tracked: &BTreeMap<RowPlace, Sample>,
        (displaced, objects): (&[f64], usize),
        known: &BTreeMap<&[usize], &Eliminated>,
    ) -> Result<Eliminated, Error> {
        let raw = self.raw;
        let readings = raw.rows.iter().filter(|(block, _, _)| *block == CLOSURES);
        let mut own: Vec<usize> = readings.map(|&(_, reading, _)| reading).collect();
        own.dedup();
        let of_samples: Vec<usize> = own.iter().map(|&reading| self.index[reading]).collect();
        let outside = raw.complement();
        let mut origins = self.origins(samples, &of_samples);
        let reference = known.get(of_samples.as_slice());
        let is_closure = |row: usize| raw.rows[row].0 == CLOSURES;
        let are_exact = self.assembly.kinds.iter().any(Kind::is_exact);
        let (basis, owners, exact) = reference
            .and_then(|known| {
                let basis = lined_up(&outside, &known.basis)?;
                Some((basis, known.owners.clone(), known.exact))
            })
            .unwrap_or_else(|| {
                let first = |row: usize| are_exact && !is_closure(row);
                let (basis, pivots, rest) = pivoted(&outside, raw.free_rows(), first);
                let owners = pivots.iter().map(|&row| origins[row].sample);
                (basis, owners.collect(), if are_exact { rest } else { 0 })
            });
        let shares = self.closure_shares(machine, samples, &own)?;
        self.angles_to_lengths(machine, samples, &own, &shares, &mut origins)?;
        let (tracked, by_tracker, errors) =
            self.tracked(machine, tracked, samples, &of_samples, &origins);
        let measured = DVector::from_fn(raw.rows.len(), |row, _| {
            if is_closure(row) {
                0.0
            } else {
                raw.residuals[row] - errors[row]
            }
        });
        let width = raw.by_shared.ncols();
        let by_object = basis.tr_mul(&raw.by_shared.columns(width - objects, objects));
        let displaced = DVector::from_fn(objects, |k, _| displaced.get(k).copied().unwrap_or(0.0));
        Ok(Eliminated {
            by_closure: basis.tr_mul(&shares),
            by_tracker: basis.tr_mul(&by_tracker),
            tracked,
            exact,
            constants: basis.tr_mul(&measured) - &by_object * displaced,
            by_object,
            samples: of_samples,
            basis,
            origins,
            owners,
        })
    }

    fn origins(&self, samples: &[Sample], own: &[usize]) -> Vec<Origin> {
        let mut quantities = BTreeMap::new();
        let rows = self.raw.rows.iter();
        rows.map(|&(block, sample, residual)| {
            let of = &self.blocks[block];
            let next = quantities.len();
            let quantity = (block, residual, of.ends_of(sample));
            let kind = &self.assembly.kinds[of.kinds[residual]];
            let weight = of.weights[sample * of.kinds.len() + residual];
            let owner = if block == CLOSURES {
                self.index[sample]
            } else {
                let number = self.assembly.number_of(of.places[sample].pose);
                let mut own = own.iter().copied();
                own.find(|&own| Some(samples[own].number) == number)
                    .unwrap_or_default()
            };
            Origin {
                sample: owner,
                place: RowPlace {
                    drive: (block == CLOSURES).then_some(residual),
                    ..of.places[sample]
                },
                quantity: *quantities.entry(quantity).or_insert(next),
                kind: kind.of.file(),
                sigma: kind.sigma / weight,
                is_angle: kind.of.is_angle(),
                is_stated: !kind.is_estimated(),
            }
        })
        .collect()
    }

    /// Tells rows of drives whose noise is an angle as what it makes of the lengths of their links, so that they compare
    /// with everything else that was measured.
    fn angles_to_lengths(
        &self,
        machine: &Machine,
        samples: &[Sample],
        readings: &[usize],
        shares: &DMatrix<f64>,
        origins: &mut [Origin],
    ) -> Result<(), Error> {
        let kinds = &self.blocks[CLOSURES].kinds;
        let kind = &self.assembly.kinds[kinds[0]];
        if !kind.of.is_angle() {
            return Ok(());
        }
        let closures = closures_of(machine);
        for (row, &(block, reading, residual)) in self.raw.rows.iter().enumerate() {
            if block != CLOSURES {
                continue;
            }
            let place = place(readings, &reading);
            let by_length = shares[(row, place * kinds.len() + residual)]
                * slope(machine, closures[residual], &samples[self.index[reading]])?;
            if by_length > 0.0 {
                origins[row].sigma = by_length.recip();
                origins[row].is_angle = false;
            }
        }
        Ok(())
    }

    /// Share of each closure (m²) of the readings in each row.
    fn closure_shares(
        &self,
        machine: &Machine,
        samples: &[Sample],
        readings: &[usize],
    ) -> Result<DMatrix<f64>, Error> {
        let of = &self.blocks[CLOSURES];
        let count = of.kinds.len();
        let are_lengths = of.coupled.is_none() && self.assembly.file.noise_of_links().is_some();
        let closures = closures_of(machine);
        let mut shares = DMatrix::zeros(self.raw.rows.len(), readings.len() * count);
        for (row, &(block, reading, residual)) in self.raw.rows.iter().enumerate() {
            if block != CLOSURES {
                continue;
            }
            let place = place(readings, &reading);
            let sigma = self.assembly.kinds[of.kinds[residual]].sigma;
            let weight = of.weights[reading * count + residual] / sigma;
            let slope = if are_lengths {
                slope(machine, closures[residual], &samples[self.index[reading]])?
            } else {
                1.0
            };
            for closure in 0..=residual {
                let factor = of.factor(reading, residual, closure);
                shares[(row, place * count + closure)] = weight * factor / slope;
            }
        }
        Ok(shares)
    }
}

/// Derivatives of the closures of a variant by the pose.
fn closures_of(machine: &Machine) -> Vec<&Instance> {
    let closures = machine.variant.instances_of(ResidualKind::Closure);
    closures
        .filter_map(|closure| by_pose(machine, closure))
        .collect()
}

/// Derivative of a closure (m²) by the length of its link (m).
fn slope(machine: &Machine, closure: &Instance, sample: &Sample) -> Result<f64, Error> {
    let [x, y, z, ..] = gradient(machine, closure, sample)?;
    Ok((x * x + y * y + z * z).sqrt())
}

impl Assembly<'_> {
    /// Readings of the drives as samples at the poses where they are taken to be, in the order of the closures.
    pub(super) fn samples(&self) -> impl Iterator<Item = Sample> {
        self.poses
            .iter()
            .flat_map(super::pose::UnknownPose::samples)
    }

    /// Moves the poses by steps of all their unknowns.
    pub(super) fn move_by(&mut self, steps: &[f64]) {
        for (pose, own) in self.poses.iter_mut().zip(steps.chunks_exact(POSE_UNKNOWNS)) {
            let vector = |k: usize| Vector3::new(own[k], own[k + 1], own[k + 2]);
            pose.base = pose.base.moved(vector(0), vector(3));
        }
    }
}
