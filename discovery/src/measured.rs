//! Measurements beside poses, and folders in which these make true poses unknown.

use std::borrow::Cow;

use tau_robot::measurements::{Folder, PlateKind, PlateRow, PoseSigmas, TcpPose};
use tau_robot::robot::Robot;
use tau_robot::robot_file::{RobotFile, StatedNoise};

/// The folder as its rows were measured, if true poses are unknown in it: there are no measured ones, something else of the
/// plate was measured beside them, or rows have noise of their own, which a fit to poses as they are would not see.
pub(super) fn with_unknown_poses<'a>(
    folder: &'a Folder,
    file: &RobotFile,
    robot: &Robot,
) -> Option<Cow<'a, Folder>> {
    if folder.tcp_poses.is_empty() {
        return Some(Cow::Borrowed(folder));
    }
    if are_positions(folder) {
        let is_unknown = has_more(folder, robot) || states_own_noise(folder, file);
        // Positions that stand for poses are rows still.
        return is_unknown.then(|| {
            let mut folder = folder.clone();
            folder.tcp_poses.clear();
            Cow::Owned(folder)
        });
    }
    let has_positions = folder.rows_of(PlateKind::Position).next().is_some();
    let is_unknown = has_positions || has_more(folder, robot) || has_sigmas(folder);
    is_unknown.then_some(Cow::Borrowed(folder))
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

/// True if more than poses, or than the positions that stand for them, was measured.
fn has_more(folder: &Folder, robot: &Robot) -> bool {
    let has = |kind: PlateKind| folder.rows_of(kind).next().is_some();
    let positions = folder.rows_of(PlateKind::Position).count();
    let has_more_positions = are_positions(folder) && positions > folder.tcp_poses.len();
    has(PlateKind::Height)
        || has(PlateKind::BallBar)
        || (has(PlateKind::Reading) && robot.is_redundant())
        || !folder.distances.is_empty()
        || has_more_positions
}

/// True if rows of poses state their noise.
fn has_sigmas(folder: &Folder) -> bool {
    let none = PoseSigmas::default();
    folder.tcp_poses.iter().any(|pose| pose.sigmas != none)
}

/// True if positions have another noise than `position_m` of `[noise]`.
fn states_own_noise(folder: &Folder, file: &RobotFile) -> bool {
    let general = Some(StatedNoise::Known(file.noise.position_m));
    let is_other = file.noise_of(PlateKind::Position.file()) != general;
    has_sigmas(folder) || file.noise_of_axes().is_some() || is_other
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
