//! The measurements of all sets as one list of samples.
//!
//! They own what they hold, since sets 2 and 3 are carried into another frame, and treatments change copies. Kinematics
//! takes a view ([`Sample::view`]): its iterations move a sample to another pose at every step, and most of its callers
//! have commands and nothing else. One type that owns would copy three lists at each step, 38 ns, where a pose takes 1.8
//! to 3.8 µs in a few of them, and would spare the ten lines of the view.

pub mod frames;
mod lack;
pub mod outliers;
pub mod plates;

use tau_kinematics::{self as kinematics, Forces, Machine, Missing, Pose, Statics, Surroundings};
use tau_robot::input_error::InputError;
use tau_robot::measurements::{
    CART_POSES, CART_POSITIONS, Conditions, Folder, TCP_POSES, TcpPose, visits,
};
use tau_robot::robot::{Input, Instance, Robot};

use crate::machine::error::Error;
use frames::Frames;
pub use lack::Lack;

/// A measured pose of the TCP (set 1), of a cart (set 2) or position of a cart (set 3).
#[derive(Debug, Clone)]
pub struct Sample {
    /// 1, 2 or 3.
    pub set: u8,
    /// Index of the track, in sets 2 and 3.
    pub track: Option<usize>,
    /// Number of the pose or point in the file.
    pub number: u32,
    /// Place in the order of measurement, in set 1: the line in the file.
    pub order: usize,
    /// Number of the unit that was measured together (in set 1 the readings at the same commands): its samples share
    /// their sign in null scans and their fold in confirmation.
    pub unit: usize,
    /// Commands (m).
    pub commands_m: Vec<f64>,
    /// Side of approach of each command, NaN where it is not known.
    directions: Vec<f64>,
    /// Time and temperature, where known.
    pub conditions: Conditions,
    /// Measured; in sets 2 and 3 carried near the measurement frame.
    pub pose: Pose,
    /// Pose of the plate, where there is one and it is known.
    pub plate: Option<Pose>,
    /// Forces of the arm, where they are known.
    forces: Option<Forces>,
    /// Measured tension of each link (N), NaN where it was not; empty where none was.
    tensions_n: Vec<f64>,
}

impl Sample {
    fn of_tcp(measured: &TcpPose, unit: usize) -> Self {
        let pose = Pose::from(measured);
        Self {
            set: 1,
            track: None,
            number: measured.pose,
            order: measured.line,
            unit,
            commands_m: measured.commands_m.clone(),
            directions: measured.directions.clone().unwrap_or_default(),
            conditions: measured.conditions,
            pose,
            plate: Some(pose),
            forces: None,
            tensions_n: measured.tensions_n.clone().unwrap_or_default(),
        }
    }

    /// Readings of the drives at a pose of the plate that is unknown, or known roughly.
    pub(crate) fn of_drives(
        number: u32,
        commands_m: &[f64],
        [directions, tensions_n]: [Option<&[f64]>; 2],
        conditions: Conditions,
        pose: Pose,
    ) -> Self {
        Self {
            set: 1,
            track: None,
            number,
            order: 0,
            unit: 0,
            commands_m: commands_m.to_vec(),
            directions: directions.unwrap_or_default().to_vec(),
            conditions,
            pose,
            plate: Some(pose),
            forces: None,
            tensions_n: tensions_n.unwrap_or_default().to_vec(),
        }
    }

    /// Samples of all sets: set 1 for the given poses (indices), then sets 2 and 3 where they are there
    /// and registered.
    pub fn all(robot: &Robot, folder: &Folder, poses: &[usize], frames: &Frames) -> Vec<Self> {
        let of_tcp: Vec<&TcpPose> = (poses.iter())
            .filter_map(|&pose| folder.tcp_poses.get(pose))
            .collect();
        let visits = visits(of_tcp.iter().map(|pose| pose.commands_m.as_slice()));
        let mut samples: Vec<Self> = (of_tcp.into_iter().zip(visits))
            .map(|(measured, visit)| Self::of_tcp(measured, visit))
            .collect();
        let mut unit = Self::units(&samples);
        let own_direction = |track: usize, direction: Option<f64>| {
            let mut directions = vec![f64::NAN; robot.commands];
            if let (Some(own), Some(direction)) = (directions.get_mut(track), direction) {
                *own = direction;
            }
            directions
        };
        if let Some(frame) = frames.set2 {
            // Where no arm reaches, nothing loads the carts.
            let unloaded = Forces {
                tensions_n: vec![0.0; robot.links.len()],
                loads_n: vec![[0.0; 3]; robot.tracks.len()],
                by_pull: vec![],
            };
            // Targets are turned back by how the first pose of each shows them, so that what is left to
            // fit of their rotation is small.
            let mut mounted = vec![None; robot.tracks.len()];
            for measured in &folder.cart_poses {
                let mut pose = frame.carry(measured.position_m, Some(measured.angles_rad));
                let Some(mounted) = mounted.get_mut(measured.track) else {
                    continue;
                };
                pose.rotation *= mounted.get_or_insert(pose.rotation).inverse();
                samples.push(Self {
                    set: 2,
                    track: Some(measured.track),
                    number: measured.point,
                    order: 0,
                    unit,
                    commands_m: moved_equally(robot, measured.command_m),
                    directions: own_direction(measured.track, measured.direction),
                    conditions: measured.conditions,
                    pose,
                    plate: None,
                    forces: Some(unloaded.clone()),
                    tensions_n: vec![],
                });
                unit += 1;
            }
        }
        if let Some(frame) = frames.set3 {
            let mut last = None;
            for measured in &folder.cart_positions {
                if last.is_some_and(|last| last != measured.pose) {
                    unit += 1;
                }
                last = Some(measured.pose);
                samples.push(Self {
                    set: 3,
                    track: Some(measured.track),
                    number: measured.pose,
                    order: 0,
                    unit,
                    commands_m: measured.commands_m.clone(),
                    directions: own_direction(measured.track, measured.direction),
                    conditions: measured.conditions,
                    pose: frame.carry(measured.position_m, None),
                    plate: None,
                    forces: None,
                    tensions_n: vec![],
                });
            }
        }
        samples
    }

    /// Puts samples of each set in the order of measurement: by time, the points of each cart in set 2 for
    /// themselves. Sets in which a time is missing stay in the order of the file.
    pub fn sort_by_time(samples: &mut [Self]) {
        let is_timed = [1, 2, 3].map(|set| {
            let mut own = samples.iter().filter(|sample| sample.set == set);
            own.all(|sample| sample.conditions.time_s.is_some())
        });
        let time_s = |sample: &Self| {
            let is_known = is_timed[usize::from(sample.set) - 1];
            sample.conditions.time_s.filter(|_| is_known)
        };
        samples.sort_by(|a, b| {
            let (Some(a_s), Some(b_s)) = (time_s(a), time_s(b)) else {
                return a.set.cmp(&b.set);
            };
            let cart = |sample: &Self| sample.track.filter(|_| sample.set == 2);
            (a.set, cart(a))
                .cmp(&(b.set, cart(b)))
                .then(a_s.total_cmp(&b_s))
                .then(a.track.cmp(&b.track))
        });
    }

    /// Number of samples' units.
    pub fn units(samples: &[Self]) -> usize {
        samples
            .iter()
            .map(|sample| sample.unit + 1)
            .max()
            .unwrap_or(0)
    }

    /// Side of approach of each command, NaN where it is not known; empty where none is.
    pub(crate) fn directions(&self) -> &[f64] {
        &self.directions
    }

    /// Side of approach of a command, where known.
    pub fn direction(&self, command: usize) -> Option<f64> {
        let direction = self.directions.get(command).copied();
        direction.filter(|direction| !direction.is_nan())
    }

    /// Measured tension of each link (N), NaN where it was not; empty where none was.
    pub(crate) fn tensions_n(&self) -> &[f64] {
        &self.tensions_n
    }

    /// Computes the forces of the arm, where the plate's pose is known.
    pub fn load(&mut self, statics: &Statics) {
        if let Some(plate) = &self.plate {
            self.forces = Some(statics.forces(plate, &self.commands_m));
        }
    }

    /// The sample as kinematics and residual families take it.
    pub fn view(&self) -> kinematics::Sample<'_> {
        kinematics::Sample {
            commands_m: &self.commands_m,
            pose: self.pose,
            plate: self.plate,
            forces: self.forces.as_ref(),
            tensions_n: Some(&self.tensions_n),
            directions: Some(&self.directions),
            conditions: self.conditions,
        }
    }

    /// A number that the equations take.
    ///
    /// # Errors
    /// The missing quantity, in words.
    pub fn input(&self, input: Input, surroundings: &Surroundings) -> Result<f64, Lack> {
        let mut data = Vec::with_capacity(1);
        let filled = surroundings.fill(&[input], &self.view(), &mut data);
        filled
            .map(|()| data[0])
            .map_err(|missing| Lack::from(&missing))
    }

    /// Appends the data that a residual takes.
    ///
    /// # Errors
    /// The missing quantity, with the file and the sample that lack it.
    pub fn fill(
        &self,
        machine: &Machine,
        instance: &Instance,
        data: &mut Vec<f64>,
    ) -> Result<(), Error> {
        if self.set == 1 {
            let filled = machine.fill(instance, &self.view(), data);
            return filled.map_err(|error| self.failed(machine, error));
        }
        let filled = (machine.surroundings).fill(&instance.inputs, &self.view(), data);
        filled.map_err(|missing| self.lacks(&missing))
    }

    /// Appends the data that all closures by parameters take of a pose, one after the other.
    ///
    /// # Errors
    /// As [`Self::fill`].
    pub(crate) fn fill_closures(
        &self,
        machine: &Machine,
        data: &mut Vec<f64>,
    ) -> Result<(), Error> {
        let filled = machine.fill_closures(&self.view(), data);
        filled.map_err(|error| self.failed(machine, error))
    }

    /// An error of kinematics at a sample of set 1.
    pub(crate) fn failed(&self, machine: &Machine, error: kinematics::Error) -> Error {
        Error::at_pose(self.number, machine.explained(error, &self.view()))
    }

    /// The error that something which a residual takes is missing.
    pub(crate) fn lacks(&self, missing: &Missing) -> Error {
        let files = [TCP_POSES, CART_POSES, CART_POSITIONS];
        self.lacks_in(files[usize::from(self.set.clamp(1, 3)) - 1], missing)
    }

    /// The same of a sample that a file is known of.
    pub(crate) fn lacks_in(&self, file: &str, missing: &Missing) -> Error {
        let what = match missing {
            Missing::Pull(pull) => format!("pose {} needs {pull}", self.number),
            missing => format!("sample {}: {}", self.number, Lack::from(missing)),
        };
        InputError::whole(tau_codes::kinematics::MISSING, file, what).into()
    }

    /// The same measurement under other conditions, to see what it would tell.
    #[must_use]
    pub fn under(&self, treatment: Treatment) -> Self {
        let mut other = self.clone();
        match treatment {
            Treatment::Same => {}
            Treatment::Load(factor) => {
                for tension in &mut other.tensions_n {
                    *tension *= factor;
                }
                if let Some(forces) = &mut other.forces {
                    for tension in &mut forces.tensions_n {
                        *tension *= factor;
                    }
                    for load in forces.loads_n.iter_mut().flatten() {
                        *load *= factor;
                    }
                    for by_pull in &mut forces.by_pull {
                        by_pull.pull_n *= factor;
                    }
                }
            }
            Treatment::Warmer(kelvin) => {
                other.conditions.temperature_c = other.conditions.temperature_c.map(|t| t + kelvin);
            }
            Treatment::Reversed => {
                for direction in &mut other.directions {
                    *direction = -*direction;
                }
            }
            Treatment::Later(seconds) => {
                other.conditions.time_s = other.conditions.time_s.map(|t| t + seconds);
            }
        }
        other
    }
}

/// Commands of set 2: all carts move equally, and driven lengths stand at zero.
fn moved_equally(robot: &Robot, command_m: f64) -> Vec<f64> {
    let is_cart = |command: usize| command < robot.tracks.len();
    (0..robot.commands)
        .map(|command| if is_cart(command) { command_m } else { 0.0 })
        .collect()
}

/// Conditions under which a measurement is repeated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Treatment {
    /// As it was.
    Same,
    /// With so many times the payload.
    Load(f64),
    /// Warmer by so many kelvins.
    Warmer(f64),
    /// Approached from the other side.
    Reversed,
    /// Later by so many seconds.
    Later(f64),
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::machine::Prepared;
    use tau_robot::prototype;

    /// The tracks of set 2 are measured one after the other, each from time zero.
    #[test]
    fn samples_are_put_in_the_order_of_time() {
        let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
        let folder = prototype::folder().unwrap();
        let poses: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        let file = prototype::robot_file().unwrap();
        let variant = robot.variant("Full").unwrap();
        let prepared = Prepared::new(&robot, variant, &file, Some(&folder), &poses).unwrap();
        let frames = Frames::of(&prepared.machine, &folder);
        let in_file = Sample::all(&robot, &folder, &poses, &frames);
        let key = |sample: &Sample| (sample.set, sample.track, sample.number);
        let order = |samples: &[Sample]| samples.iter().map(key).collect::<Vec<_>>();
        let count = in_file.len();
        let shuffled: Vec<Sample> = (0..count)
            .map(|k| in_file[101 * k % count].clone())
            .collect();
        assert!(order(&shuffled) != order(&in_file));
        let mut sorted = shuffled.clone();
        Sample::sort_by_time(&mut sorted);
        assert!(order(&sorted) == order(&in_file));

        // One time that is missing leaves its set as it is.
        let mut sorted = shuffled.clone();
        sorted
            .iter_mut()
            .find(|sample| sample.set == 1)
            .unwrap()
            .conditions
            .time_s = None;
        Sample::sort_by_time(&mut sorted);
        let of_set_1: Vec<Sample> = shuffled.into_iter().filter(|s| s.set == 1).collect();
        assert!(order(&sorted[..poses.len()]) == order(&of_set_1));
        assert!(order(&sorted[poses.len()..]) == order(&in_file[poses.len()..]));
    }
}
