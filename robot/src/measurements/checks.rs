//! Checks of a folder against a robot: enough poses, within the reach of its links.

use std::collections::BTreeSet;
use std::path::Path;

use nalgebra::{Rotation3, Vector3};
use tau_codes::{files, fit};

use super::plausible::{self, no_direction};
use super::{Folder, TcpPose};
use crate::input_error::{Errors, InputError};
use crate::robot::Robot;
use crate::robot_file::{Dimensions, Joints, RobotFile};

/// A link that would have to be longer or shorter than it is by this share is not meant: nominal
/// values, and measurements in the right unit and frame, are far better.
const LARGEST_MISFIT: f64 = 0.5;

impl Folder {
    /// Lowest and highest value of each command (m or rad) in all files; empty where none holds all of them.
    pub fn travel(&self, commands: usize) -> Vec<[f64; 2]> {
        let mut travel = vec![[f64::INFINITY, f64::NEG_INFINITY]; commands];
        let mut take = |command: usize, value: f64| {
            if let Some([low, high]) = travel.get_mut(command) {
                (*low, *high) = (low.min(value), high.max(value));
            }
        };
        let of_poses = self.tcp_poses.iter().map(|own| &own.commands_m);
        let of_rows = self.plate_rows.iter().map(|own| &own.commands_m);
        let of_carts = self.cart_positions.iter().map(|own| &own.commands_m);
        for row in of_poses.chain(of_rows).chain(of_carts) {
            for (command, &value) in row.iter().enumerate() {
                take(command, value);
            }
        }
        for point in &self.cart_poses {
            take(point.track, point.command_m);
        }
        if travel.iter().any(|[low, high]| low > high) {
            travel.clear();
        }
        travel
    }

    /// Checks measurements in memory of a robot with so many commands: what the reader of files refuses in a row.
    ///
    /// # Errors
    /// The first row with another number of commands, a number that is not finite, or a direction that is none.
    pub fn check(&self, commands: usize) -> Result<(), InputError> {
        let refused = |code, message: String| Err(InputError::whole(code, &self.name, message));
        let poses = self.tcp_poses.iter().map(|pose| {
            let measured = [pose.position_m, pose.angles_rad].concat();
            (pose.pose, &pose.commands_m, &pose.directions, measured)
        });
        let rows = self.plate_rows.iter().map(|row| {
            let measured = row.values.iter().flatten().copied().collect();
            (row.pose, &row.commands_m, &row.directions, measured)
        });
        for (pose, commands_m, directions, measured) in poses.chain(rows) {
            let found = commands_m.len();
            if found != commands {
                let message = format!("pose {pose} has {found} commands, expected {commands}");
                return refused(fit::BAD_OBSERVATION, message);
            }
            if !measured.iter().chain(commands_m).all(|own| own.is_finite()) {
                let message = format!("pose {pose} has a number that is not finite");
                return refused(fit::BAD_OBSERVATION, message);
            }
            let mut directions = directions.iter().flatten();
            if let Some(message) = directions.find_map(|&own| no_direction(own)) {
                return refused(files::OUT_OF_BOUNDS, format!("pose {pose}: {message}"));
            }
        }
        let carts = self.cart_poses.iter().map(|cart| cart.direction);
        let carts = carts.chain(self.cart_positions.iter().map(|cart| cart.direction));
        match carts.flatten().find_map(no_direction) {
            Some(message) => refused(files::OUT_OF_BOUNDS, message),
            None => Ok(()),
        }
    }

    /// Checks that so many poses calibrate as leave residuals by which a fit is judged, some `degrees` of them beside the
    /// `parameters` that are found: each pose gives one closure equation per link.
    ///
    /// # Errors
    /// Fewer calibrate.
    pub fn check_pose_count(
        &self,
        calibration_poses: usize,
        (enough, degrees): (usize, usize),
        (parameters, variant): (usize, &str),
    ) -> Result<(), InputError> {
        if calibration_poses >= enough {
            return Ok(());
        }
        Err(input_error!(fit::TOO_FEW_POSES, self.tcp_poses_name();
            "{calibration_poses} of {} poses calibrate, expected at least {enough}, which leave {degrees} residuals to \
             judge the fit by, beside the {parameters} parameters of variant `{variant}`", self.tcp_poses.len();
            "measure more poses, or let more of them calibrate with `--split`"))
    }

    /// Checks that the links of the robot, with the values of its file, reach from the cart at its
    /// command to the plate at its measured pose.
    ///
    /// # Errors
    /// A link that most poses are out of the reach of, with what would bring them into reach if it is
    /// the unit or the sign of the command; otherwise each pose out of reach.
    pub fn check_reach(
        &self,
        poses: &[usize],
        robot: &Robot,
        file: &RobotFile,
    ) -> Result<(), InputError> {
        let poses: Vec<&TcpPose> = poses
            .iter()
            .filter_map(|&index| self.tcp_poses.get(index))
            .collect();
        let rotations: Vec<Rotation3<f64>> = poses.iter().map(|pose| rotation(pose)).collect();
        let mut errors = Errors::default();
        let mut blamed = BTreeSet::new();
        for reach in Reach::of_links(robot, file) {
            let turned = poses.iter().copied().zip(&rotations);
            let beyond = turned.filter(|&(pose, rotation)| {
                !reach.reaches_turned(pose, rotation, reach.driving_command(pose))
            });
            let beyond: Vec<&TcpPose> = beyond.map(|(pose, _)| pose).collect();
            if 2 * beyond.len() > poses.len() {
                errors.add(self.most_beyond(&reach, &beyond));
                continue;
            }
            for pose in beyond.into_iter().filter(|pose| blamed.insert(pose.pose)) {
                errors.add(input_error!(tau_codes::kinematics::OUT_OF_REACH, self.tcp_poses_name();
                    "pose {} is out of reach: {}", pose.pose, reach.describe(pose);
                    "compare its commands and position with the record of the measurement, or remove its row"));
            }
        }
        errors.finish()
    }

    fn most_beyond(&self, reach: &Reach<'_>, poses: &[&TcpPose]) -> InputError {
        let error = input_error!(tau_codes::kinematics::MOST_OUT_OF_REACH, self.tcp_poses_name();
            "{} of {} poses are out of reach: {} at pose {}",
                poses.len(), self.tcp_poses.len(), reach.describe(poses[0]), poses[0].pose);
        let fits = |command: &dyn Fn(&TcpPose) -> f64| {
            let fitting = poses
                .iter()
                .filter(|pose| reach.reaches(pose, command(pose)))
                .count();
            2 * fitting > poses.len()
        };
        let is_large = poses
            .iter()
            .any(|pose| reach.driving_command(pose).abs() > LARGE_COMMAND_M)
            && !reach.is_angle();
        let in_unit = |of_metre: f64| fits(&|pose| reach.driving_command(pose) / of_metre);
        error.help(
            if reach.is_angle() && fits(&|pose| reach.driving_command(pose).to_radians()) {
                "the commands look like degrees: multiply by pi/180".to_owned()
            } else if is_large && plausible::is_in_unit(in_unit) {
                plausible::unit_advice("the commands", in_unit)
            } else if fits(&|pose| -reach.driving_command(pose)) {
                "with the opposite sign of the command they are in reach".to_owned()
            } else {
                FRAME_ADVICE.to_owned()
            },
        )
    }

    fn tcp_poses_name(&self) -> String {
        Path::new(&self.name)
            .join("tcp_poses.csv")
            .display()
            .to_string()
    }
}

/// A command that may be in millimetres where a thousandth of it would fit.
const LARGE_COMMAND_M: f64 = 20.0;

const FRAME_ADVICE: &str = "are the poses in the frame, and in the units, in which the robot file or the description gives the joints?";

/// Nominal dimensions from which the reach of a link follows.
struct Reach<'a> {
    robot: &'a Robot,
    dimensions: Dimensions<'a>,
    link: usize,
    joints: Joints,
    command: Option<usize>,
}

impl<'a> Reach<'a> {
    /// Of the links whose values are known.
    fn of_links(robot: &'a Robot, file: &'a RobotFile) -> Vec<Self> {
        let dimensions = Dimensions::new(robot, file);
        let of_link = |link: usize| {
            let joints = dimensions.joints(link)?;
            Some(Self {
                command: robot.links[link].actuated_by.or(joints.track),
                joints,
                robot,
                dimensions,
                link,
            })
        };
        (0..robot.links.len()).filter_map(of_link).collect()
    }

    fn driving_command(&self, pose: &TcpPose) -> f64 {
        self.command
            .and_then(|command| pose.commands_m.get(command).copied())
            .unwrap_or(0.0)
    }

    /// Length (m) of the link at a command of its drive; not a number where it has none.
    fn length_m(&self, command: f64) -> f64 {
        let mut commands = vec![0.0; self.robot.commands];
        if let Some(own) = self.command.and_then(|own| commands.get_mut(own)) {
            *own = command;
        }
        let length = self.dimensions.length_m(self.link, &commands);
        length.unwrap_or(f64::NAN)
    }

    /// Distance (m) between the two joints that the link connects, at a pose so turned.
    fn distance_m(&self, pose: &TcpPose, rotation: &Rotation3<f64>, command: f64) -> f64 {
        let plate = Vector3::from(pose.position_m) + rotation * self.joints.plate;
        (plate - self.joints.at(command)).norm()
    }

    fn reaches(&self, pose: &TcpPose, command: f64) -> bool {
        self.reaches_turned(pose, &rotation(pose), command)
    }

    fn reaches_turned(&self, pose: &TcpPose, rotation: &Rotation3<f64>, command: f64) -> bool {
        let length = self.length_m(command);
        let distance = self.distance_m(pose, rotation, command);
        (distance - length).abs() <= LARGEST_MISFIT * length.abs()
    }

    fn is_angle(&self) -> bool {
        (self.command).is_some_and(|command| self.robot.is_angle(command))
    }

    fn describe(&self, pose: &TcpPose) -> String {
        let command = self.driving_command(pose);
        let with = match self.command {
            Some(index) => format!(" with {} = {command}", self.robot.command_column(index)),
            None => String::new(),
        };
        format!(
            "link `{}` is {:.3} m long, its joints are {:.3} m apart{with}",
            self.robot.links[self.link].name,
            self.length_m(command),
            self.distance_m(pose, &rotation(pose), command)
        )
    }
}

fn rotation(pose: &TcpPose) -> Rotation3<f64> {
    let [alpha, beta, gamma] = pose.angles_rad;
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    about(Vector3::z_axis(), alpha)
        * about(Vector3::y_axis(), beta)
        * about(Vector3::z_axis(), gamma)
}

#[cfg(test)]
mod tests {
    use tau_codes::kinematics::MOST_OUT_OF_REACH;

    use super::*;
    use crate::prototype;
    use crate::robot::{Cluster, Link};

    fn gantry_tau() -> Robot {
        let cluster = |name: &str, track| Cluster {
            name: name.into(),
            track: Some(track),
        };
        let link = |name: &str, cluster| Link {
            name: name.into(),
            cluster,
            ..Link::default()
        };
        Robot {
            name: "GantryTau".into(),
            description: String::new(),
            tracks: ["one", "two", "three"].map(String::from).into(),
            clusters: vec![cluster("arm1", 0), cluster("arm2", 1), cluster("arm3", 2)],
            links: vec![
                link("l1", 0),
                link("l2a", 1),
                link("l2b", 1),
                link("l3a", 2),
                link("l3b", 2),
                link("l3c", 2),
            ],
            commands: 3,
            ..Robot::default()
        }
    }

    fn check(change: impl Fn(&mut TcpPose)) -> Result<(), InputError> {
        let mut folder = prototype::folder()?;
        folder.tcp_poses.iter_mut().for_each(change);
        let all: Vec<usize> = (0..folder.tcp_poses.len()).collect();
        folder.check_reach(&all, &gantry_tau(), &prototype::robot_file()?)
    }

    #[test]
    fn the_prototype_is_in_reach() {
        check(|_| {}).unwrap();
    }

    #[test]
    fn a_single_wrong_command_is_named_by_its_pose() {
        let error = check(|pose| {
            if pose.pose == 17 {
                pose.commands_m[0] += 5.0;
            }
        })
        .unwrap_err();
        assert_eq!(error.problems().len(), 1);
        let problem = &error.problems()[0];
        assert_eq!(problem.code, tau_codes::kinematics::OUT_OF_REACH);
        assert!(problem.message.contains("17") && problem.message.contains("`l1`"));
    }

    #[test]
    fn commands_out_of_every_reach_are_explained() {
        let millimetres = check(|pose| pose.commands_m.iter_mut().for_each(|q| *q *= 1000.0));
        let millimetres = millimetres.unwrap_err();
        let mirrored = check(|pose| pose.commands_m[0] = -3.0).unwrap_err();
        let [millimetres, mirrored] = [&millimetres, &mirrored].map(|error| &error.problems()[0]);
        assert_eq!(millimetres.code, MOST_OUT_OF_REACH);
        assert_eq!(mirrored.code, MOST_OUT_OF_REACH);
        assert_ne!(millimetres.help, mirrored.help);
        let shifted = check(|pose| pose.commands_m[2] += 40.0).unwrap_err();
        assert_eq!(shifted.problems().len(), 3, "the links of cart 3");
        let first = &shifted.problems()[0];
        assert_eq!(first.code, MOST_OUT_OF_REACH);
        assert!(first.message.starts_with("176 of 176 ") && first.message.contains("`l3a`"));
    }

    #[test]
    fn poses_in_another_frame_are_out_of_reach() {
        let error = check(|pose| pose.position_m[1] += 30.0).unwrap_err();
        assert_eq!(error.problems().len(), 6);
        assert_eq!(error.problems()[0].help.as_deref(), Some(FRAME_ADVICE));
    }

    #[test]
    fn as_many_poses_as_leave_residuals_suffice() {
        let folder = prototype::folder().unwrap();
        let counted = |poses| folder.check_pose_count(poses, (11, 6), (60, "Full"));
        counted(11).unwrap();
        let error = counted(10).unwrap_err();
        assert_eq!(error.problems()[0].code, fit::TOO_FEW_POSES);
    }
}
