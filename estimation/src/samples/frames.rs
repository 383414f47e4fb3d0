//! Approximate frames of the tracker in sets 2 and 3: the fit does the rest.

use nalgebra::Vector3;
use tau_kinematics::{Machine, Pose, zyz};
use tau_robot::measurements::Folder;
use tau_robot::robot::Arm;
use tau_runtime::Owner;

use crate::machine::registration::{Line, NominalTrack, Registration, set_2, set_3};

/// Uncertainty of a track's direction (rad) and place (m) by set 1 alone: parts of the tolerances of a
/// drawing, so that targets' unknown places decide little.
const DIRECTION: f64 = 1e-3;
const OFFSET_M: f64 = 1e-3;

/// From the tracker frames to the measurement frame, as far as nominal values tell.
#[derive(Debug, Clone, Copy, Default)]
pub struct Frames {
    pub(crate) set2: Option<Frame>,
    pub(crate) set3: Option<Frame>,
}

/// A registered tracker frame.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Frame(Registration);

impl Frames {
    /// `machine` has been fitted to set 1, which settles where its tracks run.
    pub fn of(machine: &Machine, folder: &Folder) -> Self {
        let tracks = 0..machine.robot.tracks.len();
        let fitted: Vec<Option<NominalTrack>> = (tracks.clone())
            .map(|track| fitted_track(machine, track))
            .collect();
        let register = |points: &dyn Fn(usize) -> Vec<(f64, Vector3<f64>)>| {
            let lines: Vec<Option<Line>> = (tracks.clone())
                .map(|track| Line::fit(&points(track)))
                .collect();
            Registration::of(&fitted, &lines).map(Frame)
        };
        Self {
            set2: register(&|track| set_2(folder, track)),
            set3: register(&|track| set_3(folder, track)),
        }
    }
}

/// Owners of the offsets of the joints on a cart.
pub(crate) fn joints_on(machine: &Machine, track: usize) -> Vec<Owner> {
    let robot = &machine.robot;
    match machine.variant.arm {
        Arm::Full => robot
            .links_of_track(track)
            .into_iter()
            .map(Owner::Link)
            .collect(),
        Arm::Reduced => (0..robot.clusters.len())
            .filter(|&cluster| robot.clusters[cluster].track == Some(track))
            .map(Owner::Cluster)
            .collect(),
    }
}

/// A track as fitted, its path straight between its ends: the mean over the joints that ride on its cart.
pub(crate) fn fitted_track(machine: &Machine, track: usize) -> Option<NominalTrack> {
    let lines = machine.joint_lines(track);
    let count = lines.len() as f64;
    (!lines.is_empty()).then(|| NominalTrack {
        line: Line {
            origin: lines.iter().map(|line| line[0]).sum::<Vector3<f64>>() / count,
            direction: lines.iter().map(|line| line[1]).sum::<Vector3<f64>>() / count,
        },
        direction_tolerance: DIRECTION,
        offset_tolerance_m: OFFSET_M,
    })
}

impl Frame {
    pub(crate) fn carry(&self, position_m: [f64; 3], angles_rad: Option<[f64; 3]>) -> Pose {
        Pose {
            position: self.0.apply(position_m.into()),
            rotation: self.0.rotation * zyz(angles_rad.unwrap_or_default()),
        }
    }
}
