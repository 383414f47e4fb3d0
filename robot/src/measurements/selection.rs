//! Selection of poses: those in the measured range, split into calibration and validation.

use std::collections::BTreeSet;
use std::fmt;
use std::str::FromStr;

use super::shape::{Actuator, Shape};
use super::{Folder, visits};
use crate::input_error::{InputError, Source};
use crate::random::Random;
use crate::robot::Robot;
use crate::robot_file::RobotFile;
use tau_codes::{files, fit};

impl Folder {
    /// Lowest and highest measured value (m) of each command, where known: for a cart's command the
    /// points of set 2 on its track, or on all tracks where its own has none; otherwise `[range]`
    /// of the robot file.
    pub fn measured_range(&self, robot: &RobotFile, shape: &Shape) -> Vec<Option<(f64, f64)>> {
        let over = |track: Option<usize>| {
            self.cart_poses
                .iter()
                .filter(|pose| track.is_none_or(|track| pose.track == track))
                .map(|pose| (pose.command_m, pose.command_m))
                .reduce(|(low, high), (q, _)| (low.min(q), high.max(q)))
        };
        let drives = shape.drives.iter().enumerate();
        drives
            .map(|(command, drive)| {
                let measured = if *drive == Actuator::Cart {
                    over(Some(command)).or_else(|| over(None))
                } else {
                    None
                };
                measured.or(robot.range_m.filter(|_| !drive.is_angle()))
            })
            .collect()
    }

    /// Indices into [`Folder::tcp_poses`] of the poses whose commands all lie in the
    /// [measured range](Folder::measured_range); all poses where it is not known. Variants are
    /// compared on these poses only, since piecewise tracks end where set 2 ends (Dressler et al.
    /// 2010, section IV).
    pub fn in_range(&self, robot: &RobotFile, shape: &Shape) -> Vec<usize> {
        let range = self.measured_range(robot, shape);
        let is_inside = |commands: &[f64]| {
            commands
                .iter()
                .zip(&range)
                .all(|(q, range)| range.is_none_or(|(low, high)| (low..=high).contains(q)))
        };
        (0..self.tcp_poses.len())
            .filter(|&i| is_inside(&self.tcp_poses[i].commands_m))
            .collect()
    }
}

/// The split of poses into calibration and validation.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Split {
    /// `alternate`: the 1st, 3rd, 5th … calibrate, the 2nd, 4th, 6th … validate.
    #[default]
    Alternate,
    /// `all`: every pose does both.
    All,
    /// `first:N`: the first N calibrate, the rest validates.
    First(usize),
    /// `fraction:F` or `fraction:F:SEED`: a random share F calibrates, the rest validates.
    Fraction {
        /// Share of the poses, between 0 and 1.
        share: f64,
        /// Seed of the random choice; the same seed chooses the same poses.
        seed: u64,
    },
}

/// Poses that calibrate and poses that validate, in the order of the file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Division {
    /// Indices of the poses that calibrate.
    pub calibration: Vec<usize>,
    /// Indices of the poses that validate.
    pub validation: Vec<usize>,
}

impl Division {
    /// True if no pose does both.
    pub fn is_disjoint(&self) -> bool {
        let calibration: BTreeSet<usize> = self.calibration.iter().copied().collect();
        !self
            .validation
            .iter()
            .any(|pose| calibration.contains(pose))
    }
}

impl Folder {
    /// Divides poses of set 1, given by index. Readings at the same commands share what the model lacks there, so that one
    /// would foretell the other: they all go to the same side, and it is visits that are counted.
    pub fn divide(&self, split: Split, poses: &[usize]) -> Division {
        let readings = poses
            .iter()
            .map(|&pose| self.tcp_poses[pose].commands_m.as_slice());
        split.divide(poses, &visits(readings))
    }
}

impl Split {
    /// Divides things, given by index, that were measured at some commands, one of each: those at the same commands go to
    /// the same side.
    pub fn divide_readings<'a>(
        self,
        indices: &[usize],
        commands_m: impl Iterator<Item = &'a [f64]>,
    ) -> Division {
        self.divide(indices, &visits(commands_m))
    }

    /// Divides poses, given by index; `visits` holds the number of the visit of each, from 0 in order.
    fn divide(self, poses: &[usize], visits: &[usize]) -> Division {
        let by = |calibrates: &dyn Fn(usize) -> bool| {
            let places = |wanted: bool| {
                poses
                    .iter()
                    .zip(visits)
                    .filter(|&(_, &visit)| calibrates(visit) == wanted)
                    .map(|(&pose, _)| pose)
                    .collect()
            };
            Division {
                calibration: places(true),
                validation: places(false),
            }
        };
        match self {
            Self::Alternate => by(&|visit| visit % 2 == 0),
            Self::All => Division {
                calibration: poses.to_vec(),
                validation: poses.to_vec(),
            },
            Self::First(count) => by(&|visit| visit < count),
            Self::Fraction { share, seed } => {
                let count = visits.iter().map(|&visit| visit + 1).max().unwrap_or(0);
                let mut random = Random(seed);
                let keys: Vec<u64> = (0..count).map(|_| random.bits()).collect();
                let mut order: Vec<usize> = (0..count).collect();
                order.sort_by_key(|&i| keys[i]);
                let mut rank = vec![0; order.len()];
                for (place, &i) in order.iter().enumerate() {
                    rank[i] = place;
                }
                by(&|visit| (rank[visit] as f64) < (share * count as f64).round())
            }
        }
    }
}

impl fmt::Display for Split {
    /// As [`Split::from_str`] reads it.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Alternate => f.write_str("alternate"),
            Self::All => f.write_str("all"),
            Self::First(count) => write!(f, "first:{count}"),
            Self::Fraction { share, seed } => write!(f, "fraction:{share:?}:{seed}"),
        }
    }
}

impl FromStr for Split {
    type Err = InputError;

    fn from_str(text: &str) -> Result<Self, InputError> {
        let wrong = |found: &str, expected: &str| {
            InputError::at(
                files::OPTION_VALUE,
                Source {
                    name: "--split",
                    text,
                },
                0..text.len(),
                format!("found `{found}`, expected {expected}"),
            )
        };
        let mut parts = text.split(':');
        let kind = parts.next().unwrap_or_default();
        let arguments: Vec<&str> = parts.collect();
        match (kind, &arguments[..]) {
            ("alternate", []) => Ok(Self::Alternate),
            ("all", []) => Ok(Self::All),
            ("first", [count]) => match count.parse() {
                Ok(count) if count > 0 => Ok(Self::First(count)),
                _ => Err(wrong(count, "a number of poses")),
            },
            ("fraction", [share, seed @ ..]) if seed.len() <= 1 => {
                let seed = seed.first().map_or(Ok(0), |seed| {
                    seed.parse()
                        .map_err(|_| wrong(seed, "a seed, which is a whole number"))
                })?;
                match share.parse() {
                    Ok(share) if share > 0.0 && share < 1.0 => Ok(Self::Fraction { share, seed }),
                    _ => Err(wrong(share, "a share between 0 and 1")),
                }
            }
            _ => Err(wrong(text, "a way to split the poses")
                .help("`alternate`, `all`, `first:N`, `fraction:F` or `fraction:F:SEED`")),
        }
    }
}

/// Numbers of poses by the part that they took.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PoseCounts {
    /// In the file.
    pub total: usize,
    /// With all commands inside the range that set 2 covers.
    pub in_range: usize,
    /// Used for calibration.
    pub calibration: usize,
    /// Held out for validation: 0 where all calibrate.
    pub validation: usize,
}

/// Poses of a folder that take part.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Poses {
    /// Their numbers by the part that they took.
    pub counts: PoseCounts,
    /// Indices of those that calibrate and of those that validate.
    pub division: Division,
}

impl Poses {
    /// Selects the poses whose commands lie in the measured range, and divides them.
    ///
    /// # Errors
    /// No pose lies in the range; none is left to calibrate or to validate.
    pub fn select(
        robot: &Robot,
        file: &RobotFile,
        folder: &Folder,
        split: Split,
    ) -> Result<Self, InputError> {
        let in_range = folder.in_range(file, &Shape::from(robot));
        let division = folder.divide(split, &in_range);
        let counts = PoseCounts {
            total: folder.tcp_poses.len(),
            in_range: in_range.len(),
            calibration: division.calibration.len(),
            validation: if division.is_disjoint() {
                division.validation.len()
            } else {
                0
            },
        };
        if folder.tcp_poses.is_empty() {
            let message = "found no poses of the plate, which this command compares: `tcp_poses.csv` is missing";
            return Err(InputError::whole(fit::NO_POSES, &folder.name, message)
                .help("`tau check` and `tau calibrate` take other measurements of the plate"));
        }
        if in_range.is_empty() {
            let (of, mend) = if folder.cart_poses.is_empty() {
                (
                    "`[range]` of the robot file",
                    "correct `[range]`, or measure poses",
                )
            } else {
                ("set 2", "measure poses, or carts (`cart_poses.csv`),")
            };
            return Err(input_error!(fit::NONE_IN_RANGE, &folder.name;
                "none of the {} poses has all its commands in the range that {of} covers", counts.total;
                "{mend} over the stroke that is used"));
        }
        if division.calibration.is_empty() || division.validation.is_empty() {
            return Err(input_error!(fit::EMPTY_SPLIT, &folder.name;
                "of {} poses {} calibrate and {} validate, expected some of each",
                    counts.in_range, counts.calibration, counts.validation;
                "measure more poses, or divide them otherwise with `--split`"));
        }
        Ok(Self { counts, division })
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::measurements::{CartPose, Conditions, TcpPose};
    use crate::prototype;

    fn cart_pose(track: usize, command_m: f64) -> CartPose {
        CartPose {
            track,
            point: 1,
            command_m,
            position_m: [0.0; 3],
            angles_rad: [0.0; 3],
            conditions: Conditions::default(),
            direction: None,
        }
    }

    pub(crate) fn tcp_pose(commands_m: &[f64]) -> TcpPose {
        TcpPose {
            pose: 1,
            line: 2,
            commands_m: commands_m.to_vec(),
            position_m: [0.0; 3],
            angles_rad: [0.0; 3],
            conditions: Conditions::default(),
            directions: None,
            tensions_n: None,
            sigmas: crate::measurements::PoseSigmas::default(),
        }
    }

    #[test]
    fn the_range_of_a_command_is_that_of_its_track() {
        let robot = RobotFile {
            range_m: Some((-9.0, 9.0)),
            ..prototype::robot_file().unwrap()
        };
        let folder = Folder {
            cart_poses: [(0, -0.5), (0, 0.5), (1, 0.1), (1, 0.7)]
                .map(|(t, q)| cart_pose(t, q))
                .into(),
            tcp_poses: [
                [0.5, 0.1, 0.7, 9.0],
                [0.51, 0.1, 0.0, 0.0],
                [0.0, 0.0, 0.0, 0.0],
                [0.0, 0.5, -0.51, 0.0],
                [0.0, 0.5, 0.0, 9.1],
            ]
            .map(|q| tcp_pose(&q))
            .into(),
            ..Folder::default()
        };
        let mut shape = Shape::of_carts(3);
        shape.drives.push(Actuator::Length);
        let expected = [(-0.5, 0.5), (0.1, 0.7), (-0.5, 0.7), (-9.0, 9.0)].map(Some);
        assert_eq!(folder.measured_range(&robot, &shape), expected);
        assert_eq!(folder.in_range(&robot, &shape), [0]);
    }

    #[test]
    fn without_any_range_all_poses_take_part() {
        let robot = RobotFile {
            range_m: None,
            ..prototype::robot_file().unwrap()
        };
        let folder = Folder {
            cart_poses: Vec::new(),
            ..prototype::folder().unwrap()
        };
        assert_eq!(folder.in_range(&robot, &prototype::shape()).len(), 176);
    }

    #[test]
    fn poses_are_divided_as_asked() {
        let poses = [3, 5, 8, 9, 12];
        let divide = |text: &str| {
            text.parse::<Split>()
                .unwrap()
                .divide(&poses, &[0, 1, 2, 3, 4])
        };
        let division = |calibration: &[usize], validation: &[usize]| Division {
            calibration: calibration.to_vec(),
            validation: validation.to_vec(),
        };
        assert_eq!(divide("alternate"), division(&[3, 8, 12], &[5, 9]));
        assert_eq!(divide("all"), division(&poses, &poses));
        assert_eq!(divide("first:2"), division(&[3, 5], &[8, 9, 12]));
        assert_eq!(divide("first:99"), division(&poses, &[]));
        assert_eq!(Split::default(), Split::Alternate);
        for text in ["alternate", "all", "first:2", "fraction:0.7:3"] {
            assert_eq!(text.parse::<Split>().unwrap().to_string(), text);
        }
    }

    /// Three readings at each of six commands, in two rounds and one more.
    #[test]
    fn readings_of_a_visit_stay_together() {
        let commands = |k: usize| [0.1 * k as f64, -0.2, 0.3 + 1e-9 * k as f64];
        let rounds = [0, 1, 2, 3, 4, 5, 0, 1, 2, 3, 4, 5, 5, 4, 3, 2, 1, 0];
        let folder = Folder {
            tcp_poses: rounds.map(|k| tcp_pose(&commands(k))).into(),
            ..Folder::default()
        };
        assert_eq!(folder.visits(), rounds);
        let poses: Vec<usize> = (0..rounds.len()).collect();
        for (text, visits) in [
            ("alternate", vec![0, 2, 4]),
            ("first:8", vec![0, 1, 2, 3, 4, 5]),
            ("first:2", vec![0, 1]),
        ] {
            let division = folder.divide(text.parse().unwrap(), &poses);
            let expected: Vec<usize> = (poses.iter().copied())
                .filter(|&pose| visits.contains(&rounds[pose]))
                .collect();
            assert_eq!(division.calibration, expected, "{text}");
        }
        // Visits are counted, not readings.
        let twice = Split::First(2).divide(&[0, 1, 2, 3, 4, 5], &[0, 0, 1, 1, 2, 2]);
        assert_eq!(twice.calibration, [0, 1, 2, 3]);
        let shared = folder.divide("fraction:0.5:3".parse().unwrap(), &poses);
        let of = |poses: &[usize]| poses.iter().map(|&p| rounds[p]).collect::<BTreeSet<_>>();
        assert_eq!(of(&shared.calibration).len(), 3);
        assert!(of(&shared.calibration).is_disjoint(&of(&shared.validation)));
    }

    #[test]
    fn a_random_share_depends_on_the_seed_alone() {
        let poses: Vec<usize> = (0..100).collect();
        let divide = |text: &str| text.parse::<Split>().unwrap().divide(&poses, &poses);
        let one = divide("fraction:0.6:1");
        assert_eq!(one, divide("fraction:0.6:1"));
        assert_ne!(one, divide("fraction:0.6:2"));
        assert_eq!(divide("fraction:0.6"), divide("fraction:0.6:0"));
        assert_eq!((one.calibration.len(), one.validation.len()), (60, 40));
        let mut all = [one.calibration.clone(), one.validation].concat();
        all.sort_unstable();
        assert_eq!(all, poses);
        // By chance alone, about 30 of the 60 lie in the first half: 6 standard deviations are 15.
        let early = one.calibration.iter().filter(|&&pose| pose < 50).count();
        assert!((15..=45).contains(&early), "{early}");
    }
}
