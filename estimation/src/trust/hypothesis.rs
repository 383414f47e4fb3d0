//! Mistakes that a folder or a robot file may hold, as changes that would mend them.

use std::sync::Arc;

use nalgebra::{Matrix3, Rotation3, Unit, Vector3};
use tau_kinematics::{Pose, nearest_rotation, zyz};
use tau_robot::measurements::{Folder, TCP_POSES, TcpPose};
use tau_robot::robot::{Owner, Parameter, Plate, Robot, Variant};
use tau_robot::robot_file::RobotFile;
use tau_robot::robot_file::keys::WIDE;

use crate::machine::{Error, Prepared};
use crate::numerics::spread::spread;
use crate::samples::Sample;
use crate::samples::frames::Frames;
use crate::trust::LARGEST_MISFIT;
use crate::trust::reason::Reason;

/// Measurements and parameters, as given or mended.
#[derive(Clone)]
pub(crate) struct Case<'a> {
    pub(crate) robot: &'a Robot,
    pub(crate) variant: &'a Variant,
    /// Completed from the description; most hypotheses share it.
    pub(crate) file: Arc<RobotFile>,
    /// TCP poses, which all take part, and set 2 where the variant takes it; nothing else.
    pub(crate) folder: Folder,
    /// All rows that the file of the poses has, and where among them each of these stands.
    pub(crate) rows: &'a [TcpPose],
    pub(crate) places: Vec<usize>,
    /// Tolerances, where they are not as given.
    pub(crate) tolerances: Option<Hypothesis>,
}

/// Something done instead of what the documentation of the files asks for.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Hypothesis {
    /// Columns of commands are exchanged: for each command, the column that holds it.
    Commands(Vec<usize>),
    /// Commands count the other way.
    Signs(Vec<usize>),
    /// A command counts from another zero, so far (m or rad) from that of the drawing.
    Zero { command: usize, by: f64 },
    /// Commands of these drives, which turn, are in degrees.
    CommandsInDegrees(Vec<usize>),
    /// Measured values belong so many rows below the one that they stand in, or above.
    Shifted(isize),
    /// Heights count the other way.
    Heights,
    /// Carts of set 2 are numbered otherwise: for each track, the cart that runs on it.
    Carts(Vec<usize>),
    /// Axes of the measured positions are exchanged or mirrored: for each axis, the column that holds it, and its sign;
    /// where `turned`, those of the measured rotations, too.
    Axes {
        columns: [usize; 3],
        signs: [f64; 3],
        turned: bool,
    },
    /// Angles are about other axes, which stand still where `fixed` or else turn with the plate; where `transposed`, the
    /// rotation is that of the measurement frame against the plate.
    Angles {
        axes: [usize; 3],
        fixed: bool,
        transposed: bool,
    },
    /// Poses are those of another frame, which a rotation and then a shift (m) carry to that of the drawing.
    Frame {
        rotation: Rotation3<f64>,
        shift: Vector3<f64>,
    },
    /// Lengths that were measured are in a unit of which a metre has so many.
    Unit(f64),
    /// An angle of the measured rotations counts the other way.
    AngleSign(usize),
    /// Angles are in degrees.
    Degrees,
    /// The stated noise of positions and rotations is off by factors.
    Noise { position: f64, rotation: f64 },
    /// Tolerances are off by a factor: all of them, or those of lengths, from so many metres on.
    Tolerances {
        factor: f64,
        lengths_only: bool,
        from_m: f64,
    },
    /// A parameter of the variant, by index, is far off its nominal value; the search starts at another.
    Dimension { parameter: usize, start: f64 },
}

/// Of thousands, the factor between units of SI and those of drawings and trackers.
pub(crate) const THOUSAND: f64 = 1e3;
/// An inch, in millimetres.
pub(crate) const INCH_MM: f64 = 25.4;
/// Units of a metre that lengths are written in by mistake: millimetres, centimetres, inches, and inches taken for
/// millimetres.
pub(crate) const UNITS: [Hypothesis; 4] = [
    Hypothesis::Unit(THOUSAND),
    Hypothesis::Unit(1e2),
    Hypothesis::Unit(THOUSAND / INCH_MM),
    Hypothesis::Unit(1.0 / INCH_MM),
];

/// Commands of drives that may count the other way: one of them, or all.
pub(crate) fn signs(robot: &Robot, has_sign: impl Fn(usize) -> bool) -> Vec<Hypothesis> {
    let told: Vec<usize> = (0..robot.commands)
        .filter(|&command| has_sign(command))
        .collect();
    let all = (told.len() > 1).then(|| (0..robot.commands).collect());
    let one = told.into_iter().map(|command| vec![command]);
    one.chain(all).map(Hypothesis::Signs).collect()
}

impl Case<'_> {
    /// The variant with its nominal values.
    pub(crate) fn prepared(&self) -> Result<Prepared, Error> {
        let poses: Vec<usize> = (0..self.folder.tcp_poses.len()).collect();
        let folder = Some(&self.folder);
        let mut prepared = Prepared::new(self.robot, self.variant, &self.file, folder, &poses)?;
        if let Some(hypothesis) = &self.tolerances {
            hypothesis.restate(&mut prepared);
        }
        Ok(prepared)
    }

    /// Its poses.
    pub(crate) fn samples(&self) -> Vec<Sample> {
        let poses: Vec<usize> = (0..self.folder.tcp_poses.len()).collect();
        Sample::all(self.robot, &self.folder, &poses, &Frames::default())
    }

    /// Mean nominal length of the links (m): as stated, or where formulas say it at the first pose; zero where nothing
    /// does.
    pub(crate) fn mean_length_m(&self) -> f64 {
        let stated = self.file.links.values().chain(self.file.clusters.values());
        let stated: Vec<f64> = stated
            .filter_map(|values| values.length.as_ref()?.value.first().copied())
            .collect();
        let lengths = if stated.is_empty() {
            self.lengths_by_pose_m().unwrap_or_default()
        } else {
            stated
        };
        lengths.iter().sum::<f64>() / lengths.len().max(1) as f64
    }

    /// A refusal of links that miss their lengths by so much (m, rms) as those of another machine.
    pub(super) fn another_machine(&self, off_m: f64) -> Option<Reason> {
        let length_m = self.mean_length_m();
        (length_m > 0.0 && off_m > LARGEST_MISFIT * length_m)
            .then_some(Reason::AnotherMachine(Some(TCP_POSES), off_m))
    }

    fn lengths_by_pose_m(&self) -> Option<Vec<f64>> {
        let measured = self.folder.tcp_poses.first()?;
        let pose = Pose::from(measured);
        let machine = self.prepared().ok()?.machine;
        let layout = machine.layout(&pose, &measured.commands_m, &[]);
        let length =
            |[start, end]: [[f64; 3]; 2]| (Vector3::from(end) - Vector3::from(start)).norm();
        Some(
            layout
                .links
                .iter()
                .map(|link| length(link.ends_m))
                .collect(),
        )
    }

    /// The same with so many of its poses, evenly spread.
    pub(crate) fn thinned(&self, poses: usize) -> Self {
        self.of_poses(&spread(self.folder.tcp_poses.len(), poses))
    }

    /// The same with some of its poses.
    pub(crate) fn of_poses(&self, poses: &[usize]) -> Self {
        let all = &self.folder.tcp_poses;
        Self {
            file: Arc::clone(&self.file),
            places: poses.iter().map(|&pose| self.places[pose]).collect(),
            folder: Folder {
                name: self.folder.name.clone(),
                tcp_poses: poses.iter().map(|&pose| all[pose].clone()).collect(),
                has_positions_for_poses: self.folder.has_positions_for_poses,
                cart_poses: self.folder.cart_poses.clone(),
                ..Folder::default()
            },
            tolerances: self.tolerances.clone(),
            ..*self
        }
    }

    /// The case as it would be without a mistake.
    pub(crate) fn mended(&self, hypothesis: &Hypothesis) -> Self {
        let mut case = self.clone();
        match hypothesis {
            Hypothesis::Carts(carts) => {
                for cart in &mut case.folder.cart_poses {
                    let runs_on = carts.iter().position(|own| *own == cart.track);
                    cart.track = runs_on.unwrap_or(cart.track);
                }
            }
            Hypothesis::Shifted(by) => {
                for (pose, place) in case.folder.tcp_poses.iter_mut().zip(&self.places) {
                    if let Some(row) = neighbour(self.rows, *place, *by) {
                        pose.position_m = row.position_m;
                        pose.angles_rad = row.angles_rad;
                        pose.sigmas = row.sigmas;
                    } else if let Some(row) = neighbour(self.rows, *place, -*by) {
                        // Of the row at the end nothing is known; what it holds was measured there.
                        pose.commands_m.clone_from(&row.commands_m);
                        pose.directions.clone_from(&row.directions);
                        pose.conditions = row.conditions;
                        pose.tensions_n.clone_from(&row.tensions_n);
                    }
                }
            }
            Hypothesis::Noise { position, rotation } => {
                let noise = &mut Arc::make_mut(&mut case.file).noise;
                noise.position_m *= position;
                noise.rotation_rad *= rotation;
            }
            Hypothesis::Tolerances { .. } => case.tolerances = Some(hypothesis.clone()),
            Hypothesis::Dimension { .. } => {}
            of_poses => of_poses.mend_poses(&mut case.folder.tcp_poses),
        }
        case
    }
}

impl Hypothesis {
    /// Commands and sides of approach of a row as they would be without a mistake of columns.
    pub(crate) fn mend_commands(
        &self,
        commands_m: &mut Vec<f64>,
        directions: Option<&mut Vec<f64>>,
    ) {
        match self {
            Self::Commands(columns) => {
                for row in std::iter::once(commands_m).chain(directions) {
                    *row = columns.iter().map(|&column| row[column]).collect();
                }
            }
            Self::Signs(commands) => {
                for &command in commands {
                    commands_m[command] = -commands_m[command];
                }
            }
            Self::Zero { command, by } => commands_m[*command] += by,
            Self::CommandsInDegrees(commands) => {
                for &command in commands {
                    commands_m[command] = commands_m[command].to_radians();
                }
            }
            Self::Shifted(_)
            | Self::Heights
            | Self::Carts(_)
            | Self::Axes { .. }
            | Self::Angles { .. }
            | Self::Frame { .. }
            | Self::Unit(_)
            | Self::AngleSign(_)
            | Self::Degrees
            | Self::Noise { .. }
            | Self::Tolerances { .. }
            | Self::Dimension { .. } => {}
        }
    }

    /// The rotation that angles of a file mean.
    pub(crate) fn rotation(&self, mut angles_rad: [f64; 3]) -> Rotation3<f64> {
        match self {
            Self::Angles {
                axes,
                fixed,
                transposed,
            } => {
                let rotation = about_axes(*axes, *fixed, angles_rad);
                if *transposed {
                    rotation.inverse()
                } else {
                    rotation
                }
            }
            Self::AngleSign(angle) => {
                angles_rad[*angle] = -angles_rad[*angle];
                zyz(angles_rad)
            }
            _ => zyz(angles_rad),
        }
    }

    /// Measured poses as they would be without a mistake of columns.
    pub(crate) fn mend_poses(&self, poses: &mut [TcpPose]) {
        match self {
            Self::Axes {
                columns,
                signs,
                turned,
            } => change_poses(poses, |pose, _| {
                let mut map = Matrix3::zeros();
                for axis in 0..3 {
                    map[(axis, columns[axis])] = signs[axis];
                }
                let rotation = pose.rotation.matrix();
                Pose {
                    position: map * pose.position,
                    rotation: if *turned {
                        // A frame of the other hand sees the rotation with the axes of the plate mirrored, too.
                        nearest_rotation(map * rotation * map.transpose())
                    } else {
                        pose.rotation
                    },
                }
            }),
            Self::Angles { .. } | Self::AngleSign(_) => {
                change_poses(poses, |pose, angles| Pose {
                    rotation: self.rotation(angles),
                    ..pose
                });
            }
            Self::Frame { rotation, shift } => change_poses(poses, |pose, _| Pose {
                position: rotation * pose.position + shift,
                rotation: rotation * pose.rotation,
            }),
            Self::Unit(of_metre) => change_poses(poses, |pose, _| Pose {
                position: pose.position / *of_metre,
                ..pose
            }),
            Self::Degrees => change_poses(poses, |pose, angles| Pose {
                rotation: zyz(angles.map(f64::to_radians)),
                ..pose
            }),
            Self::Commands(_) | Self::Signs(_) | Self::Zero { .. } | Self::CommandsInDegrees(_) => {
                for pose in poses {
                    self.mend_commands(&mut pose.commands_m, pose.directions.as_mut());
                }
            }
            Self::Shifted(_)
            | Self::Heights
            | Self::Carts(_)
            | Self::Noise { .. }
            | Self::Tolerances { .. }
            | Self::Dimension { .. } => {}
        }
    }
}

/// The row of which the measured values belong to that at a place.
pub(crate) fn neighbour<T>(rows: &[T], place: usize, by: isize) -> Option<&T> {
    rows.get(place.checked_add_signed(-by)?)
}

fn change_poses(poses: &mut [TcpPose], change: impl Fn(Pose, [f64; 3]) -> Pose) {
    for measured in poses {
        let pose = Pose::from(&*measured);
        let changed = change(pose, measured.angles_rad);
        measured.position_m = changed.position_m();
        measured.angles_rad = changed.angles_rad();
    }
}

/// The rotation by three angles about axes one after the other, which stand still or turn with the body.
pub(crate) fn about_axes(axes: [usize; 3], fixed: bool, angles: [f64; 3]) -> Rotation3<f64> {
    let turn = |k: usize| {
        let axis = Unit::new_unchecked(Vector3::ith(axes[k], 1.0));
        Rotation3::from_axis_angle(&axis, angles[k])
    };
    if fixed {
        turn(2) * turn(1) * turn(0)
    } else {
        turn(0) * turn(1) * turn(2)
    }
}

impl Hypothesis {
    /// States the tolerances of a variant anew.
    pub(crate) fn restate(&self, prepared: &mut Prepared) {
        let parameters = prepared.machine.variant.parameters.iter();
        for (parameter, nominal) in parameters.zip(&mut prepared.nominal) {
            let given = nominal.tolerance;
            nominal.tolerance = given.map(|given| self.tolerance(parameter, given));
        }
    }

    /// Tolerance of a parameter that has one as given: those of all sections of a robot file alike.
    pub(crate) fn tolerance(&self, parameter: &Parameter, given: f64) -> f64 {
        let Self::Tolerances {
            factor,
            lengths_only,
            from_m,
        } = self
        else {
            return given;
        };
        // Radii of drums are lengths, too: those by a radian.
        let is_length = parameter.unit == LENGTH || parameter.unit.starts_with("m/rad");
        let is_scaled = !lengths_only || (is_length && given >= *from_m);
        if is_scaled && is_stated(parameter, given) {
            factor * given
        } else {
            given
        }
    }
}

/// Unit of lengths.
pub(crate) const LENGTH: &str = "m";
/// A tolerance from which on it stands for none.
const NONE: f64 = 0.5 * WIDE;

/// True of a tolerance that a robot file states. No file states those of frames and of targets on carts.
pub(super) fn is_stated(parameter: &Parameter, tolerance: f64) -> bool {
    let has_section = !matches!(parameter.owner, Owner::Frame(_) | Owner::Target { .. });
    has_section && tolerance < NONE
}

/// Mirrored axes and pairs of exchanged ones, among those along which the plate moves: of positions alone and, where it
/// turns, of rotations, too.
pub(crate) fn axes(plate: Plate) -> Vec<Hypothesis> {
    let along = plate.freedoms_of_tcp();
    let turned: &[bool] = if plate.turning_axes().is_empty() {
        &[false]
    } else {
        &[false, true]
    };
    let mut all = Vec::new();
    for &turned in turned {
        for &axis in along {
            let mut signs = [1.0; 3];
            signs[axis] = -1.0;
            all.push(Hypothesis::Axes {
                columns: [0, 1, 2],
                signs,
                turned,
            });
        }
        for (one, other) in [(0, 1), (1, 2), (0, 2)] {
            if !along.contains(&other) {
                continue;
            }
            let mut columns = [0, 1, 2];
            columns.swap(one, other);
            all.push(Hypothesis::Axes {
                columns,
                signs: [1.0; 3],
                turned,
            });
        }
    }
    all
}

/// Commands in degrees, where drives turn.
pub(crate) fn commands_in_degrees(robot: &Robot) -> Option<Hypothesis> {
    let turning = (0..robot.commands).filter(|&command| robot.is_angle(command));
    let turning: Vec<usize> = turning.collect();
    (!turning.is_empty()).then_some(Hypothesis::CommandsInDegrees(turning))
}

/// Each angle counted the other way; the twelve sequences of axes, about fixed and about turning ones, and their inverses,
/// but for what is asked for; a plate in the plane has one angle, which may be that of the inverse.
///
/// The most usual come first, so that of those that mean the same rotation the best known is named.
pub(crate) fn angles(plate: Plate) -> Vec<Hypothesis> {
    match plate.turning_axes() {
        [] => return vec![],
        [_] => {
            return vec![Hypothesis::Angles {
                axes: [2, 1, 2],
                fixed: false,
                transposed: true,
            }];
        }
        _ => {}
    }
    let usual = [[2, 1, 0], [0, 1, 2], [2, 0, 2], [2, 1, 2]];
    let every = (0..27).map(|code| [code / 9, code / 3 % 3, code % 3]);
    let distinct = |axes: &[usize; 3]| axes[0] != axes[1] && axes[1] != axes[2];
    let rest = every.filter(|axes| distinct(axes) && !usual.contains(axes));
    let mut all: Vec<Hypothesis> = (0..3).map(Hypothesis::AngleSign).collect();
    for axes in usual.into_iter().chain(rest) {
        for (fixed, transposed) in [(false, false), (true, false), (false, true), (true, true)] {
            if axes != [2, 1, 2] || fixed || transposed {
                all.push(Hypothesis::Angles {
                    axes,
                    fixed,
                    transposed,
                });
            }
        }
    }
    all
}

/// Tolerances that are too small: by a thousand, all of them or those of lengths.
pub(crate) fn small_tolerances() -> Vec<Hypothesis> {
    [false, true]
        .map(|lengths_only| Hypothesis::Tolerances {
            factor: THOUSAND,
            lengths_only,
            from_m: 0.0,
        })
        .into()
}

/// Stated noise that is off by a thousand, of positions and, where the plate turns, of rotations or both.
pub(crate) fn noise(plate: Plate) -> Vec<Hypothesis> {
    let mut all = Vec::new();
    for factor in [THOUSAND.recip(), THOUSAND] {
        let wrong = [(factor, 1.0), (factor, factor), (1.0, factor)];
        let told = if plate.turning_axes().is_empty() {
            1
        } else {
            3
        };
        for (position, rotation) in wrong.into_iter().take(told) {
            all.push(Hypothesis::Noise { position, rotation });
        }
    }
    all
}

/// Noise larger than stated, of positions and of rotations each as stated, a thousand times as large or halfway between:
/// those of the nine that are not among [`noise`].
pub(crate) fn noise_between(plate: Plate) -> Vec<Hypothesis> {
    let steps = [1.0, THOUSAND.sqrt(), THOUSAND];
    let turns = !plate.turning_axes().is_empty();
    let of_rotations = if turns { &steps[..] } else { &steps[..1] };
    let all = steps.iter().flat_map(|&position| {
        let pairs = of_rotations.iter();
        pairs.map(move |&rotation| (position, rotation))
    });
    let is_between = |&(position, rotation): &(f64, f64)| {
        let between = [position, rotation].contains(&steps[1]);
        between || (position, rotation) == (1.0, 1.0)
    };
    all.filter(is_between)
        .map(|(position, rotation)| Hypothesis::Noise { position, rotation })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use tau_kinematics::xyz;

    #[test]
    fn conventions_are_those_of_their_names() {
        let angles_rad = [0.3, -0.4, 1.1];
        let same = |a: Rotation3<f64>, b: Rotation3<f64>| (a.matrix() - b.matrix()).norm() < 1e-12;
        assert!(same(
            about_axes([2, 1, 2], false, angles_rad),
            zyz(angles_rad)
        ));
        // Rz(c)·Ry(b)·Rx(a): about fixed axes x, y, z.
        assert!(same(
            about_axes([0, 1, 2], true, angles_rad),
            xyz(angles_rad)
        ));
        let [a, b, c] = angles_rad;
        assert!(same(
            about_axes([2, 1, 0], false, [c, b, a]),
            xyz(angles_rad)
        ));
    }

    /// Twelve sequences, about fixed and turning axes, each with its inverse, less the one that is asked for.
    #[test]
    fn all_conventions_are_tried_once() {
        let all = angles(Plate::Body);
        assert_eq!(all.len(), 50);
        for (index, one) in all.iter().enumerate() {
            assert!(!all[index + 1..].contains(one));
        }
    }

    /// Motions that a plate lacks have no column that could hold something else.
    #[test]
    fn hypotheses_are_of_what_the_plate_does() {
        let counts = |plate| [axes(plate).len(), angles(plate).len(), noise(plate).len()];
        assert_eq!(counts(Plate::Body), [12, 50, 6]);
        assert_eq!(counts(Plate::Point), [6, 0, 2]);
        assert_eq!(counts(Plate::BodyInPlane), [6, 1, 6]);
        assert_eq!(counts(Plate::PointInPlane), [3, 0, 2]);
    }
}
