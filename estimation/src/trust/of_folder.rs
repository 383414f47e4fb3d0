//! Mistakes of a folder and its robot file whose poses were measured.

use std::sync::Arc;

use tau_robot::input_error::InputError;
use tau_robot::measurements::Folder;
use tau_robot::robot::{Arm, Robot, TrackShape, Variant};

use crate::joint::judged::Judged;
use crate::machine::Error;
use crate::setup::Setup;
use crate::trust::hypothesis::Case;
use crate::trust::mistake::{Mistake, MistakeKind};
use crate::trust::numbering;
use crate::trust::recognise::{self, Recognised};

/// Mistakes of the input that explain why a variant does not fit the given poses; none where it does.
///
/// # Errors
/// Values or columns that the variant needs are missing.
pub fn mistakes(setup: Setup<'_>, poses: &[usize]) -> Result<Vec<Mistake>, Error> {
    Ok(looked_at(setup, poses)?.mistakes)
}

/// The same, and the misfit where none explains it.
///
/// # Errors
/// As [`mistakes`].
pub(crate) fn looked_at(setup: Setup<'_>, poses: &[usize]) -> Result<Recognised, Error> {
    let variant = plain(setup.robot, setup.variant, setup.folder);
    let case = case(Setup { variant, ..setup }, poses);
    of_case(&case, None, setup.folder)
}

/// Mistakes of a case and in how the carts of its folder are numbered. These are compared with where tracks run once
/// other mistakes are mended: on a machine that fits none, any numbering may look right.
pub(crate) fn of_case(
    case: &Case<'_>,
    known: Option<&Judged>,
    folder: &Folder,
) -> Result<Recognised, Error> {
    let mut found = recognise::recognised(case, known)?;
    let mut mistakes = found.mistakes.iter();
    if mistakes.all(|mistake| mistake.kind != MistakeKind::Carts) {
        let machine = found.machine.as_ref();
        let of_carts = machine
            .and_then(|machine| numbering::mistake(machine, folder, case.file.noise.rotation_rad));
        found.mistakes.extend(of_carts);
    }
    if !found.mistakes.is_empty() {
        (found.misfit, found.another_machine) = (None, None);
    }
    Ok(found)
}

/// Refuses measurements with a mistake that leaves nothing to be learnt from them: of set 1, or in how the carts of sets
/// 2 and 3 are numbered. Noise, tolerances and dimensions are not refused: an effect that the model lacks looks like
/// them.
///
/// # Errors
/// The first mistake, with its mend.
pub fn refuse(setup: Setup<'_>, poses: &[usize]) -> Result<(), Error> {
    match mistakes(setup, poses)?
        .into_iter()
        .find(|mistake| mistake.is_absurd && mistake.is_of_measurements())
    {
        Some(mistake) => Err(mistake.into()),
        None => Ok(()),
    }
}

/// A case of the given poses; files as read.
pub(crate) fn case<'a>(setup: Setup<'a>, poses: &[usize]) -> Case<'a> {
    let Setup {
        robot,
        variant,
        file,
        folder,
    } = setup;
    let tcp_poses = poses.iter().filter_map(|&pose| folder.tcp_poses.get(pose));
    let with_paths = variant
        .tracks
        .iter()
        .any(|track| track.shape == TrackShape::Piecewise);
    Case {
        robot,
        variant,
        file: Arc::new(file.completed(robot)),
        folder: Folder {
            name: folder.name.clone(),
            tcp_poses: tcp_poses.cloned().collect(),
            has_positions_for_poses: folder.has_positions_for_poses,
            cart_poses: if with_paths {
                folder.cart_poses.clone()
            } else {
                vec![]
            },
            ..Folder::default()
        },
        rows: &folder.tcp_poses,
        places: (poses.iter().copied())
            .filter(|&pose| pose < folder.tcp_poses.len())
            .collect(),
        tolerances: None,
    }
}

/// The variant by which mistakes of the input are looked for: the given one where it has all links, straight tracks and
/// nothing else, or else the robot's of its name where that has, or else the last such; where there is none, the last with all links and measured paths, if there are any.
/// A misfit of a variant that is too simple is no mistake.
pub(crate) fn plain<'a>(robot: &'a Robot, variant: &'a Variant, folder: &Folder) -> &'a Variant {
    let has_all_links = |variant: &&Variant| variant.arm == Arm::Full && variant.effects.is_empty();
    let is_plain = |variant: &&Variant| {
        let is_linear = |track: &tau_robot::robot::TrackModel| track.shape != TrackShape::Piecewise;
        has_all_links(variant) && variant.tracks.iter().all(is_linear)
    };
    if is_plain(&variant) {
        return variant;
    }
    let all = || robot.variants.iter().rev();
    let with_paths = || {
        all()
            .find(has_all_links)
            .filter(|_| !folder.cart_poses.is_empty())
    };
    let of_its_name = robot.variant(&variant.name).filter(is_plain);
    let found = of_its_name.or_else(|| all().find(is_plain));
    found.or_else(with_paths).unwrap_or(variant)
}

impl From<Mistake> for Error {
    fn from(mistake: Mistake) -> Self {
        InputError::whole(mistake.kind.code(), mistake.file, mistake.what)
            .help(mistake.mend)
            .into()
    }
}
