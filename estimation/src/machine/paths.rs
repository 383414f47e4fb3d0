//! Measured paths of the carts: from set 2 of a folder, or as a robot file holds them.

use std::borrow::Cow;
use std::collections::BTreeMap;

use nalgebra::Vector3;
use tau_codes::fit;
use tau_kinematics::Path;
use tau_robot::input_error::InputError;
use tau_robot::measurements::{CartPose, Conditions, Folder};
use tau_robot::robot::{Robot, TrackShape, Variant};
use tau_robot::robot_file::{LinkValues, MeasuredPath, RobotFile};

use super::registration::{Registration, set_2};

/// The path of each cart, in the measurement frame.
pub(super) fn registered(
    robot: &Robot,
    variant: &Variant,
    file: &RobotFile,
    folder: Option<&Folder>,
    registration: Option<&Registration>,
) -> Result<Vec<Option<Path>>, InputError> {
    (0..robot.tracks.len())
        .map(|track| {
            let path = folder
                .zip(registration)
                .and_then(|(folder, registration)| {
                    Some(Path::new(&set_2(folder, track))?.turned(&registration.rotation))
                });
            let is_needed =
                variant.tracks.get(track).is_some_and(|model| model.shape == TrackShape::Piecewise);
            if path.is_none() && is_needed {
                let own = &file.source.0;
                let measured = folder.map(|folder| &folder.name).filter(|name| *name != own);
                let help = match measured {
                    Some(_) => "measure `cart_poses.csv`, or choose a variant with linear tracks",
                    None => {
                        "name a measurement FOLDER with `cart_poses.csv`, or a robot file that was calibrated with this \
                         variant, or choose one with linear tracks"
                    }
                };
                return Err(InputError::whole(fit::NO_PATH,
                    measured.unwrap_or(own),
                    format!(
                        "variant `{}` needs the path of cart {} (track `{}`): at least two points of set 2 at \
                         different commands",
                        variant.name,
                        track + 1,
                        robot.tracks[track]
                    ),
                )
                .help(help));
            }
            Ok(path)
        })
        .collect()
}

/// The paths of a variant's piecewise tracks in the frame of their tracker; points at one command are averaged.
pub(super) fn of_piecewise_tracks(
    robot: &Robot,
    variant: &Variant,
    folder: &Folder,
) -> BTreeMap<String, MeasuredPath> {
    let tracks = robot.tracks.iter().zip(&variant.tracks).enumerate();
    tracks
        .filter(|(_, (_, model))| model.shape == TrackShape::Piecewise)
        .map(|(track, (name, _))| (name.clone(), averaged(&set_2(folder, track))))
        .collect()
}

fn averaged(measured: &[(f64, Vector3<f64>)]) -> MeasuredPath {
    let (commands_m, points) = Path::averaged(measured);
    MeasuredPath {
        commands_m,
        points_m: points.into_iter().map(<[f64; 3]>::from).collect(),
    }
}

/// The folder with the file's paths in place of set 2; `None` where the file holds none.
pub(super) fn as_measured(
    robot: &Robot,
    file: &RobotFile,
    folder: Option<&Folder>,
) -> Option<Folder> {
    if file.paths.is_empty() {
        return None;
    }
    let cart_poses = robot.tracks.iter().enumerate().flat_map(|(track, name)| {
        let path = file.paths.get(name);
        let points = path.map_or(&[][..], |path| &path.points_m);
        let commands = path.map_or(&[][..], |path| &path.commands_m);
        commands
            .iter()
            .zip(points)
            .zip(1..)
            .map(move |((&command_m, &position_m), point)| CartPose {
                track,
                point,
                command_m,
                position_m,
                angles_rad: [0.0; 3],
                conditions: Conditions::default(),
                direction: None,
            })
    });
    let named = || Folder {
        name: file.source.0.clone(),
        ..Folder::default()
    };
    Some(Folder {
        cart_poses: cart_poses.collect(),
        ..folder.cloned().unwrap_or_else(named)
    })
}

/// The file without rotations of tracks that refer to the frame of another tracker than that of the folder's set 2.
pub(super) fn without_foreign_rotations<'a>(
    robot: &Robot,
    file: &'a RobotFile,
    folder: Option<&Folder>,
) -> Cow<'a, RobotFile> {
    let is_foreign = |folder: &Folder| {
        !folder.cart_poses.is_empty()
            && robot.tracks.iter().enumerate().any(|(track, name)| {
                let own = file.paths.get(name);
                own.is_some_and(|own| *own != averaged(&set_2(folder, track)))
            })
    };
    if !folder.is_some_and(is_foreign) {
        return Cow::Borrowed(file);
    }
    let mut file = file.clone();
    let all = (file.links.values_mut())
        .chain(file.clusters.values_mut())
        .chain(file.tracks.values_mut());
    all.for_each(|values: &mut LinkValues| values.track_rotation = None);
    Cow::Owned(file)
}
