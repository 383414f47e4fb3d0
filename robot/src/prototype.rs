//! The measurement folder that ships with the library: a simulated Gantry-Tau prototype.

pub use tau_prototype::{CART_POSES, CART_POSITIONS, ROBOT, TCP_POSES};

use crate::input_error::InputError;
use crate::measurements::{Folder, Shape, Texts};
use crate::robot::Robot;
use crate::robot_file::RobotFile;

/// Name under which the folder appears in reports and errors.
pub const NAME: &str = "prototype";
/// Name of the robot that was measured.
pub const ROBOT_NAME: &str = "GantryTau";
/// Its three tracks, one command each, and six rods.
pub fn shape() -> Shape {
    Shape {
        links: vec![None; 6],
        ..Shape::of_carts(3)
    }
}

/// The measurements.
///
/// # Errors
/// None with the data that ship.
pub fn folder() -> Result<Folder, InputError> {
    let texts = Texts {
        tcp_poses: Some(TCP_POSES),
        cart_poses: Some(CART_POSES),
        cart_positions: Some(CART_POSITIONS),
        ..Texts::default()
    };
    Folder::from_texts(NAME, texts, &shape())
}

/// Nominal parameters, tolerances and noise.
///
/// # Errors
/// None with the data that ship.
pub fn robot_file() -> Result<RobotFile, InputError> {
    RobotFile::parse(ROBOT, "prototype/robot.toml")
}

/// Parameters of a robot where no file is named: what its description gives by itself, or else, for the robot of the
/// [measurements](folder) that ship, theirs.
///
/// # Errors
/// The description lacks values, which are listed.
pub fn parameters_of(robot: &Robot) -> Result<RobotFile, InputError> {
    match RobotFile::described(robot) {
        Err(_) if is_of(robot) => RobotFile::parse_for(ROBOT, "prototype/robot.toml", robot),
        found => found,
    }
}

/// True for the robot that was measured, with whatever variants and effects.
pub fn is_of(robot: &Robot) -> bool {
    robot.name == ROBOT_NAME
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measurements::{Conditions, Split, TcpPose};

    #[test]
    fn the_prototype_has_the_poses_of_its_readme() {
        let folder = folder().unwrap();
        let robot = robot_file().unwrap();
        let lengths = [
            folder.tcp_poses.len(),
            folder.cart_poses.len(),
            folder.cart_positions.len(),
        ];
        assert_eq!(lengths, [176, 3 * 28, 3 * 150]);
        assert!(folder.remarks.is_empty(), "{:?}", folder.remarks);
        assert_eq!(robot.links.len(), 6);
        let in_range = folder.in_range(&robot, &shape());
        assert_eq!(in_range.len(), 121);
        let division = folder.divide(Split::Alternate, &in_range);
        assert_eq!(
            (division.calibration.len(), division.validation.len()),
            (61, 60)
        );
    }

    #[test]
    fn the_prototype_fits_the_standard_gantry_tau() {
        let robot = crate::Robot::from(&tau_generated::gantry_tau::ROBOT);
        assert_eq!(crate::measurements::Shape::from(&robot), shape());
        let file = RobotFile::parse_for(ROBOT, "robot.toml", &robot).unwrap();
        let folder = folder().unwrap();
        let poses = folder.in_range(&file, &shape());
        folder.check_reach(&poses, &robot, &file).unwrap();
        let lengths = ROBOT.replace("length_m", "# length_m");
        let error = RobotFile::parse_for(&lengths, "robot.toml", &robot).unwrap_err();
        assert_eq!(error.problems().len(), 6, "each link lacks its length");
    }

    #[test]
    fn values_are_those_of_the_files() {
        let folder = folder().unwrap();
        let expected = TcpPose {
            pose: 1,
            line: 2,
            commands_m: vec![-0.507_175_4, -0.063_918_8, -0.785_616_7],
            position_m: [-1.903_438_3, -4.718_931_7, -0.369_854_0],
            angles_rad: [1.483_713_3, 1.765_194_2, -1.545_739_4],
            conditions: Conditions {
                time_s: Some(0.0),
                temperature_c: Some(20.002_979_0),
            },
            directions: Some(vec![1.0, 1.0, 1.0]),
            tensions_n: None,
            sigmas: crate::measurements::PoseSigmas::default(),
        };
        assert_eq!(folder.tcp_poses[0], expected);
        assert_eq!(folder.cart_positions[1].track, 1);
        let link = &robot_file().unwrap().links["l2b"];
        assert_eq!(link.length.as_ref().unwrap().value, [2.043_10]);
    }
}
