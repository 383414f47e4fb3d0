//! Measurements of the plate that tell less than its whole pose.

use std::collections::{BTreeMap, BTreeSet};

use tau_model_dsl::model::Plate;

use super::{Conditions, Folder, PoseSigmas, TCP_POSES, TcpPose};
use crate::fingerprint;

/// A kind of measurement of the plate, with a file of its own.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PlateKind {
    /// Some or all coordinates of the TCP or of a target on the plate.
    Position,
    /// Distance of the TCP from a plane.
    Height,
    /// Distance of the TCP from a fixed ball (ISO 230-4).
    BallBar,
    /// Nothing but the drives, which measure each other where there are more of them than freedoms.
    Reading,
}

impl PlateKind {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Position, Self::Height, Self::BallBar, Self::Reading];

    /// Name of the file.
    pub fn file(self) -> &'static str {
        match self {
            Self::Position => "tcp_positions.csv",
            Self::Height => "heights.csv",
            Self::BallBar => "ball_bar.csv",
            Self::Reading => "readings.csv",
        }
    }

    /// Columns of the measured values, of which at least one is there.
    pub fn columns(self) -> &'static [&'static str] {
        match self {
            Self::Position => &["x_m", "y_m", "z_m"],
            Self::Height => &["height_m"],
            Self::BallBar => &["distance_m"],
            Self::Reading => &[],
        }
    }

    /// Kind of the objects that are measured, or from which.
    pub fn object(self) -> Option<ObjectKind> {
        match self {
            Self::Position => Some(ObjectKind::Target),
            Self::Height => Some(ObjectKind::Surface),
            Self::BallBar => Some(ObjectKind::Ball),
            Self::Reading => None,
        }
    }
}

/// A kind of objects that the plate is measured by.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObjectKind {
    /// A point on the plate.
    Target,
    /// A plane in space.
    Surface,
    /// The centre of a ball in space.
    Ball,
}

impl ObjectKind {
    /// Optional column of measurements that names one.
    pub fn column(self) -> &'static str {
        match self {
            Self::Target => "target",
            Self::Surface => "surface",
            Self::Ball => "ball",
        }
    }

    /// Section of the robot file that places them.
    pub fn section(self) -> &'static str {
        match self {
            Self::Target => "targets",
            Self::Surface => "surfaces",
            Self::Ball => "balls",
        }
    }
}

/// A row of such a file.
#[derive(Debug, Clone, PartialEq)]
pub struct PlateRow {
    /// The kind of measurement.
    pub kind: PlateKind,
    /// Line in the file, from 1.
    pub line: usize,
    /// Number of the pose. Rows of one number, in whichever files, were taken at one true pose.
    pub pose: u32,
    /// Commands, or what the drives read (m), one per command of the robot.
    pub commands_m: Vec<f64>,
    /// Time and temperature.
    pub conditions: Conditions,
    /// Sign of the last move, one per command (±1), where the file has the columns.
    pub directions: Option<Vec<f64>>,
    /// Measured tension of each link (N), NaN where it was not; `None` where none was.
    pub tensions_n: Option<Vec<f64>>,
    /// Measured values (m) in the order of [`PlateKind::columns`]; `None` where not measured.
    pub values: [Option<f64>; 3],
    /// Standard deviations of the values (m), where the row states them.
    pub sigmas: [Option<f64>; 3],
    /// Name of the target, the surface or the ball; `None`: the TCP, the plane z = 0, the only ball.
    pub of: Option<String>,
}

/// A measured distance between two positions of the TCP.
#[derive(Debug, Clone, PartialEq)]
pub struct Distance {
    /// Line in the file, from 1.
    pub line: usize,
    /// Numbers of the two poses.
    pub poses: [u32; 2],
    /// Distance (m).
    pub distance_m: f64,
    /// Its standard deviation (m), where the row states it.
    pub sigma_m: Option<f64>,
}

/// Reason why effects of a tracker are not seen.
pub const NO_TRACKER: &str = "no tracker has measured the plate";

/// Name of the file of [`Distance`]s.
pub const DISTANCES: &str = "distances.csv";

impl Distance {
    /// Fingerprint of the distance and the numbers of its poses.
    pub fn fingerprint(&self) -> String {
        let poses = self.poses.map(f64::from);
        fingerprint::of_numbers([poses[0], poses[1], self.distance_m])
    }
}

impl Folder {
    /// True if the folder holds measurements beside those of whole poses, or poses with noise of their own, so that true
    /// poses are unknown.
    pub fn has_partial_poses(&self) -> bool {
        let of_rows = self.tcp_poses.iter().any(|pose| pose.sigmas.are_stated());
        of_rows || !self.plate_rows.is_empty() || !self.distances.is_empty()
    }

    /// Fingerprints of what was measured of poses, by the poses' numbers: of the commands and of lengths, so that a position
    /// is the same whether it counts as a pose or not. A row without either measures nothing.
    pub fn fingerprints(&self) -> impl Iterator<Item = (u32, String)> {
        let of_poses = self.tcp_poses.iter().map(|own| {
            let numbers = own.commands_m.iter().chain(&own.position_m);
            (own.pose, fingerprint::of_numbers(numbers.copied()))
        });
        let of_rows = self.plate_rows.iter().map(|own| {
            let values = own.values.iter().flatten();
            let numbers = own.commands_m.iter().chain(values);
            (own.pose, fingerprint::of_numbers(numbers.copied()))
        });
        of_poses.chain(of_rows)
    }

    /// Takes positions of a plate that is a point for its poses, where all its coordinates were measured at the TCP and
    /// there are no other poses: of rows of one pose the first; the others stay what they are. True if there are such.
    pub fn take_positions_for_poses(&mut self, plate: Plate) -> bool {
        if !plate.is_point() || !self.tcp_poses.is_empty() {
            return false;
        }
        let freedoms = plate.freedoms();
        let mut known = BTreeSet::new();
        let (positions, others) = (self.plate_rows.drain(..)).partition(|row: &PlateRow| {
            let is_whole = freedoms.iter().all(|&axis| row.values[axis].is_some());
            let is_position = row.kind == PlateKind::Position && row.of.is_none();
            is_position && is_whole && known.insert(row.pose)
        });
        self.plate_rows = others;
        let pose = |row: PlateRow| TcpPose {
            pose: row.pose,
            line: row.line,
            commands_m: row.commands_m,
            position_m: row.values.map(Option::unwrap_or_default),
            angles_rad: [0.0; 3],
            conditions: row.conditions,
            directions: row.directions,
            tensions_n: row.tensions_n,
            sigmas: PoseSigmas {
                position_m: row.sigmas,
                rotation_rad: None,
            },
        };
        self.tcp_poses = Vec::into_iter(positions).map(pose).collect();
        self.has_positions_for_poses = !self.tcp_poses.is_empty();
        self.has_positions_for_poses
    }

    /// The file that poses stand in.
    pub fn poses_file(&self) -> &'static str {
        if self.has_positions_for_poses {
            PlateKind::Position.file()
        } else {
            TCP_POSES
        }
    }

    /// A file of what was measured of the plate, where no tracker measured any of it.
    pub fn measured_without_tracker(&self) -> Option<&'static str> {
        let has = |kind: PlateKind| self.rows_of(kind).next().is_some();
        if !self.tcp_poses.is_empty() || has(PlateKind::Position) {
            return None;
        }
        let others = [PlateKind::Height, PlateKind::BallBar];
        let file = others.into_iter().find(|kind| has(*kind));
        let file = file.map(PlateKind::file);
        let file = file.or((!self.distances.is_empty()).then_some(DISTANCES));
        Some(file.unwrap_or(PlateKind::Reading.file()))
    }

    /// [`NO_TRACKER`], where that is so.
    pub fn hides_tracker(&self) -> Option<&'static str> {
        let hidden = self.measured_without_tracker();
        hidden.map(|_| NO_TRACKER)
    }

    /// True if the tension of a link was measured anywhere.
    pub fn has_measured_tensions(&self) -> bool {
        let of_poses = self.tcp_poses.iter().map(|pose| &pose.tensions_n);
        let mut all = of_poses.chain(self.plate_rows.iter().map(|row| &row.tensions_n));
        all.any(Option::is_some)
    }

    /// Gives rows that lack tensions those of another row of the same pose at the same commands.
    pub(super) fn share_tensions(&mut self) {
        let key = |pose: u32, commands_m: &[f64]| {
            let bits: Vec<u64> = commands_m.iter().map(|q| q.to_bits()).collect();
            (pose, bits)
        };
        let of_poses =
            (self.tcp_poses.iter()).map(|row| (row.pose, &row.commands_m, &row.tensions_n));
        let of_rows =
            (self.plate_rows.iter()).map(|row| (row.pose, &row.commands_m, &row.tensions_n));
        let known: BTreeMap<_, Vec<f64>> = (of_poses.chain(of_rows))
            .filter_map(|(pose, commands_m, own)| Some((key(pose, commands_m), own.clone()?)))
            .collect();
        let shared = |pose: u32, commands_m: &[f64]| known.get(&key(pose, commands_m)).cloned();
        for row in self
            .plate_rows
            .iter_mut()
            .filter(|row| row.tensions_n.is_none())
        {
            row.tensions_n = shared(row.pose, &row.commands_m);
        }
        for row in self
            .tcp_poses
            .iter_mut()
            .filter(|row| row.tensions_n.is_none())
        {
            row.tensions_n = shared(row.pose, &row.commands_m);
        }
    }

    /// Rows of each kind, as many as there are.
    pub fn rows_of(&self, kind: PlateKind) -> impl Iterator<Item = &PlateRow> {
        self.plate_rows.iter().filter(move |row| row.kind == kind)
    }

    /// Numbers of all poses of the plate with the commands (m) of their first row, in the order of the files.
    pub fn plate_poses(&self) -> Vec<(u32, &[f64])> {
        let of_poses = self.tcp_poses.iter();
        let of_poses = of_poses.map(|pose| (pose.pose, pose.commands_m.as_slice()));
        let of_rows = self.plate_rows.iter();
        let of_rows = of_rows.map(|row| (row.pose, row.commands_m.as_slice()));
        let mut known = BTreeSet::new();
        let all = of_poses.chain(of_rows);
        all.filter(|(pose, _)| known.insert(*pose)).collect()
    }
}
