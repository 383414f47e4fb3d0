//! Folders in which true poses are unknown.

use std::borrow::Cow;

use tau_estimation::unknown_poses;
use tau_robot::measurements::{Folder, PlateKind, PlateRow, TcpPose};
use tau_robot::robot::Robot;
use tau_robot::robot_file::RobotFile;

/// The folder as its rows were measured, if [true poses are unknown](unknown_poses::are_unknown) in it.
pub(super) fn with_unknown_poses<'a>(
    folder: &'a Folder,
    file: &RobotFile,
    robot: &Robot,
) -> Option<Cow<'a, Folder>> {
    unknown_poses::are_unknown(robot, file, folder).then(|| {
        if !are_positions(folder) {
            return Cow::Borrowed(folder);
        }
        // Positions that stand for poses are rows still.
        let mut folder = folder.clone();
        folder.tcp_poses.clear();
        Cow::Owned(folder)
    })
}

/// True if the poses are positions of a plate that is a point, taken for poses.
fn are_positions(folder: &Folder) -> bool {
    let is_position = |pose: &TcpPose| {
        let same = |row: &PlateRow| {
            let values = row.values.map(Option::unwrap_or_default);
            row.pose == pose.pose && row.line == pose.line && values == pose.position_m
        };
        folder.rows_of(PlateKind::Position).any(same)
    };
    folder.tcp_poses.iter().all(is_position)
}

#[cfg(test)]
mod tests {
    use super::with_unknown_poses;
    use tau_robot::measurements::{Distance, Folder};
    use tau_robot::prototype;
    use tau_robot::robot::Robot;
    use tau_robot::robot_file::RobotFile;

    fn case() -> (Folder, RobotFile, Robot) {
        let folder = prototype::folder().unwrap();
        let file = prototype::robot_file().unwrap();
        (folder, file, Robot::from(&tau_generated::gantry_tau::ROBOT))
    }

    #[test]
    fn poses_alone_are_known() {
        let (folder, file, robot) = case();
        assert!(with_unknown_poses(&folder, &file, &robot).is_none());
    }

    #[test]
    fn poses_are_unknown_beside_distances() {
        let (mut folder, file, robot) = case();
        let poses = [folder.tcp_poses[0].pose, folder.tcp_poses[1].pose];
        folder.distances.push(Distance {
            line: 2,
            poses,
            distance_m: 0.1,
            sigma_m: None,
        });
        let found = with_unknown_poses(&folder, &file, &robot).unwrap();
        assert_eq!(found.tcp_poses.len(), folder.tcp_poses.len());
    }

    #[test]
    fn poses_are_unknown_where_rows_state_their_noise() {
        let (mut folder, file, robot) = case();
        folder.tcp_poses[3].sigmas.position_m[1] = Some(1e-4);
        assert!(with_unknown_poses(&folder, &file, &robot).is_some());
    }
}
