//! Files of a measurement folder, by name, and their texts.

use tau_codes::files;

use super::plate::{DISTANCES, PlateKind};
use crate::fingerprint::fingerprint;
use crate::input_error::InputError;

/// Name of the file of poses of the plate that are measured fully.
pub const TCP_POSES: &str = "tcp_poses.csv";
/// Name of the file of set 2.
pub const CART_POSES: &str = "cart_poses.csv";
/// Name of the file of set 3.
pub const CART_POSITIONS: &str = "cart_positions.csv";

/// Names of the files that a folder may hold, in the order of [`Texts`].
pub const FILES: [&str; 8] = [
    TCP_POSES,
    CART_POSES,
    CART_POSITIONS,
    "tcp_positions.csv",
    "heights.csv",
    "ball_bar.csv",
    "readings.csv",
    DISTANCES,
];

/// The texts of a measurement folder, those that are there.
#[derive(Debug, Clone, Copy, Default)]
pub struct Texts<'a> {
    /// Set 1.
    pub tcp_poses: Option<&'a str>,
    /// Set 2.
    pub cart_poses: Option<&'a str>,
    /// Set 3.
    pub cart_positions: Option<&'a str>,
    /// `tcp_positions.csv`.
    pub tcp_positions: Option<&'a str>,
    /// `heights.csv`.
    pub heights: Option<&'a str>,
    /// `ball_bar.csv`.
    pub ball_bar: Option<&'a str>,
    /// `readings.csv`.
    pub readings: Option<&'a str>,
    /// `distances.csv`.
    pub distances: Option<&'a str>,
}

impl<'a> Texts<'a> {
    /// From what gives the text of a file by its name.
    pub fn of(text: impl Fn(&str) -> Option<&'a str>) -> Self {
        let [
            tcp_poses,
            cart_poses,
            cart_positions,
            tcp_positions,
            heights,
            ball_bar,
            readings,
            distances,
        ] = FILES.map(text);
        Self {
            tcp_poses,
            cart_poses,
            cart_positions,
            tcp_positions,
            heights,
            ball_bar,
            readings,
            distances,
        }
    }

    /// Those of these files alone; all where none is named.
    ///
    /// # Errors
    /// A file that is not there.
    pub fn only(&self, names: &[String]) -> Result<Self, InputError> {
        let is_there = |name: &&String| self.files().any(|(own, _)| own == **name);
        if let Some(name) = names.iter().find(|name| !is_there(name)) {
            let there: Vec<&str> = self.files().map(|(name, _)| name).collect();
            let message = format!("found no measurements `{name}` in the folder");
            return Err(InputError::whole(files::NO_SUCH_FILE, "--files", message)
                .help(format!("the folder holds {}", there.join(", "))));
        }
        let is_named = |name: &str| names.is_empty() || names.iter().any(|own| own == name);
        let own = |name: &str| self.files().find(|(own, _)| *own == name && is_named(own));
        Ok(Self::of(|name| Some(own(name)?.1)))
    }

    /// The files that are there, by their names.
    pub fn files(&self) -> impl Iterator<Item = (&'a str, &'a str)> + use<'a> {
        let files = FILES.into_iter().zip(self.all());
        files.filter_map(|(name, text)| Some((name, text?)))
    }

    /// In the order of [`FILES`].
    fn all(&self) -> [Option<&'a str>; 8] {
        [
            self.tcp_poses,
            self.cart_poses,
            self.cart_positions,
            self.tcp_positions,
            self.heights,
            self.ball_bar,
            self.readings,
            self.distances,
        ]
    }

    pub(super) fn of_kind(&self, kind: PlateKind) -> Option<&'a str> {
        match kind {
            PlateKind::Position => self.tcp_positions,
            PlateKind::Height => self.heights,
            PlateKind::BallBar => self.ball_bar,
            PlateKind::Reading => self.readings,
        }
    }

    /// True if nothing is measured of the plate.
    pub(super) fn lack_the_plate(&self) -> bool {
        let of_kinds = PlateKind::ALL.into_iter();
        self.tcp_poses.is_none()
            && of_kinds
                .map(|kind| self.of_kind(kind))
                .all(|text| text.is_none())
    }

    /// Fingerprint of the measurements, the robot file apart.
    pub(super) fn fingerprint(&self) -> String {
        fingerprint(self.files())
    }
}
