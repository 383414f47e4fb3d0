//! The columns that the measurements of a robot have.

use tau_model_dsl::model::Plate;

use crate::robot::{Robot, command_column};

/// Column of the side of approach.
pub const DIRECTION: &str = "dir";
/// Columns of a position.
pub const POSITION: [&str; 3] = ["x_m", "y_m", "z_m"];
/// Columns of angles.
pub const ANGLES: [&str; 3] = ["alpha_rad", "beta_rad", "gamma_rad"];

/// A drive, by what its command is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Actuator {
    /// Travel of a cart on its track (m).
    Cart,
    /// Angle of a crank (rad).
    Crank,
    /// Length of a link, or what changes it (m).
    Length,
    /// Angle of a drum or a motor that changes a link's length (rad).
    Drum,
}

impl Actuator {
    /// True if its command is an angle (rad), false for a length (m).
    pub fn is_angle(self) -> bool {
        matches!(self, Self::Crank | Self::Drum)
    }
}

/// Name of the column of a drive's measured force.
pub fn force_name(drive: usize) -> String {
    format!("force{}_N", drive + 1)
}

/// Drives and plate of a robot, which its measurements must fit.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shape {
    /// One per command; carts and cranks come first, and carry the numbers of carts, from 1.
    pub drives: Vec<Actuator>,
    /// Freedoms of the plate.
    pub plate: Plate,
    /// Of each link the drive that lengthens it, where there is one.
    pub links: Vec<Option<usize>>,
}

impl Shape {
    /// A body on carts alone.
    pub fn of_carts(carts: usize) -> Self {
        Self {
            drives: vec![Actuator::Cart; carts],
            plate: Plate::Body,
            links: vec![],
        }
    }

    /// Names of the columns of measured forces, `force1_N`, of the drives that lengthen links.
    pub fn force_names(&self) -> Vec<String> {
        let drives = self.links.iter().flatten();
        drives.map(|drive| force_name(*drive)).collect()
    }

    /// Number of commands.
    pub fn commands(&self) -> usize {
        self.drives.len()
    }

    /// Number of tracks and cranks.
    pub fn tracks(&self) -> usize {
        let carriers = self.drives.iter();
        carriers
            .filter(|drive| matches!(drive, Actuator::Cart | Actuator::Crank))
            .count()
    }

    /// True if a track of an index carries a cart.
    pub fn has_cart(&self, track: usize) -> bool {
        self.drives.get(track) == Some(&Actuator::Cart)
    }

    /// True if there are carts to measure.
    pub fn has_carts(&self) -> bool {
        self.drives.contains(&Actuator::Cart)
    }

    /// Names of the columns of commands, `q1_m` or `q1_rad`.
    pub fn command_names(&self) -> Vec<String> {
        let drives = self.drives.iter().enumerate();
        drives
            .map(|(command, drive)| command_column(command, drive.is_angle()))
            .collect()
    }

    /// Names of the columns of directions, one per command.
    pub fn direction_names(&self) -> Vec<String> {
        (1..=self.commands())
            .map(|n| format!("{DIRECTION}{n}"))
            .collect()
    }

    /// Names of the columns of a pose that its plate can take, of [`POSITION`] and [`ANGLES`]: a point has no
    /// orientation, and a body in the plane turns about z alone, by alpha.
    pub fn pose_names(&self) -> Vec<&'static str> {
        let names = POSITION.into_iter().chain(ANGLES).enumerate();
        let is_free = |column: usize| match self.plate {
            Plate::Body => true,
            Plate::Point => column < 3,
            Plate::BodyInPlane => [0, 1, 3].contains(&column),
            Plate::PointInPlane => column < 2,
        };
        names
            .filter(|(column, _)| is_free(*column))
            .map(|(_, name)| name)
            .collect()
    }

    /// Names of the columns of a pose that say nothing of its plate: a point has no orientation, and in the plane z = 0
    /// plates stand upright. Beside a beta of zero, gamma turns a body there as alpha does.
    pub fn idle_names(&self) -> &'static [&'static str] {
        match self.plate {
            Plate::Body => &[],
            Plate::Point => &ANGLES,
            Plate::BodyInPlane => &[POSITION[2], ANGLES[1]],
            Plate::PointInPlane => &[POSITION[2], ANGLES[0], ANGLES[1], ANGLES[2]],
        }
    }
}

impl From<&Robot> for Shape {
    fn from(robot: &Robot) -> Self {
        let drive = |command: usize| {
            let carries = command < robot.tracks.len();
            match (carries, robot.is_angle(command)) {
                (true, false) => Actuator::Cart,
                (true, true) => Actuator::Crank,
                (false, false) => Actuator::Length,
                (false, true) => Actuator::Drum,
            }
        };
        Self {
            drives: (0..robot.commands).map(drive).collect(),
            plate: robot.plate,
            links: robot.links.iter().map(|link| link.actuated_by).collect(),
        }
    }
}
