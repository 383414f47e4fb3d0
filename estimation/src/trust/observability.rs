//! Effects that the measurements of a folder could show, and what they lack.

use std::collections::BTreeSet;

use tau_codegen::language::model::{Effect, Link, Readable, Subject, Target};
use tau_codegen::language::{self, Model};
use tau_codes::{Code, discovery as codes};
use tau_robot::effects::CATALOGUE;
use tau_robot::measurements::{CART_POSES, CART_POSITIONS, Folder, NO_TRACKER, PlateKind, Shape};
use tau_robot::robot::{Robot, TrackShape, Variant};
use tau_robot::robot_file::RobotFile;

/// Something that an effect needs to be seen, in the order of its words.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Need {
    /// The mass that the plate carries, in the robot file.
    Payload,
    /// A cart, of which the machine has none: no measurement would show the effect.
    Cart,
    /// A crank, of which the machine has none.
    Crank,
    /// A joint on the fixed base or a crank, of which the machine has none.
    BaseJoint,
    /// The file of set 2.
    CartPoses,
    /// Temperatures.
    Temperature,
    /// Times.
    Time,
    /// Directions of approach.
    Directions,
    /// Tensions, where a drive keeps one that is not known.
    Tensions,
    /// Links of the kind that the effect acts on, of which the machine has none.
    Link,
    /// Measurements by a tracker.
    Tracker,
    /// Joints of the plate, of which the machine has none.
    PlateJoints,
}

impl Need {
    /// The file, column or part.
    pub fn words(self) -> &'static str {
        match self {
            Self::Payload => "[payload] in robot.toml",
            Self::Cart => "a cart: the machine has none",
            Self::Crank => "a crank: the machine has none",
            Self::BaseJoint => "joints on the fixed base: the machine has none",
            Self::CartPoses => CART_POSES,
            Self::Temperature => "column temperature_c",
            Self::Time => "column time_s",
            Self::Directions => "columns dir1, dir2, …",
            Self::Tensions => "columns force1_N, …, or `pulled = … N` of the links that pull",
            Self::Link => "links of the kind that it acts on: the machine has none",
            Self::Tracker => NO_TRACKER,
            Self::PlateJoints => "plate joints: links meet in a point",
        }
    }

    /// Its code.
    pub fn code(self) -> Code {
        match self {
            Self::Temperature | Self::Time | Self::Directions => codes::LACKS_COLUMN,
            Self::Payload | Self::Tensions => codes::LACKS_VALUE,
            Self::CartPoses => codes::LACKS_FILE,
            Self::Tracker => codes::LACKS_TRACKER,
            Self::Cart | Self::Crank | Self::BaseJoint | Self::Link | Self::PlateJoints => {
                codes::LACKS_PART
            }
        }
    }

    /// True of parts that the machine has not.
    fn is_of_machine(self) -> bool {
        matches!(
            self,
            Self::Cart | Self::Crank | Self::BaseJoint | Self::Link | Self::PlateJoints
        )
    }

    /// True of columns and values, which files that are there could hold.
    fn is_in_files(self) -> bool {
        match self {
            Self::Payload | Self::Temperature | Self::Time | Self::Directions | Self::Tensions => {
                true
            }
            Self::Cart
            | Self::Crank
            | Self::BaseJoint
            | Self::CartPoses
            | Self::Link
            | Self::Tracker
            | Self::PlateJoints => false,
        }
    }
}

/// An effect of the catalogue, with what the measurements lack to show it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Observability {
    /// Name of the effect.
    pub name: String,
    /// Files and columns that it needs and that are missing; empty where it could be seen.
    pub lacks: Vec<Need>,
}

/// Something that is not there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Gap {
    /// Its code.
    pub code: Code,
    /// The file or column.
    pub what: &'static str,
    /// Its use.
    pub brings: String,
}

/// Columns and files that an effect needs and that are missing.
pub(crate) fn observabilities(
    robot: &Robot,
    file: &RobotFile,
    folder: &Folder,
) -> Vec<Observability> {
    let model = &*robot.model;
    // The shipped catalogue compiles beside any description; its own effects go before.
    let extended = language::effects_from_text(CATALOGUE, model);
    let model = extended.as_ref().unwrap_or(model);
    let of = |effect: &Effect| Observability {
        name: effect.name.clone(),
        lacks: lacks(effect, model, file, folder),
    };
    let mut found: Vec<Observability> = Vec::new();
    for own in model.effects.iter().map(of) {
        let lacks_part = |own: &Observability| own.lacks.iter().any(|need| need.is_of_machine());
        match found.iter_mut().find(|first| first.name == own.name) {
            // Of effects of one name those count that have something to act on.
            Some(first) if lacks_part(first) => *first = own,
            Some(_) if lacks_part(&own) => {}
            Some(first) => {
                first.lacks.extend(own.lacks);
                first.lacks.sort_unstable();
                first.lacks.dedup();
            }
            None => found.push(own),
        }
    }
    found
}

fn lacks(effect: &Effect, model: &Model, file: &RobotFile, folder: &Folder) -> Vec<Need> {
    let mut lacks = BTreeSet::new();
    let poses = &folder.tcp_poses;
    if effect.subject == Subject::Tcp {
        lacks.extend(folder.hides_tracker().map(|_| Need::Tracker));
    }
    let has_cart = model.guideways().next().is_some();
    let has_crank = model.cranks().next().is_some();
    let has_base_joint = has_crank || model.links_on_base().next().is_some();
    lacks.extend(match effect.subject {
        Subject::Cart | Subject::CartFromSource if !has_cart => Some(Need::Cart),
        Subject::Crank if !has_crank => Some(Need::Crank),
        Subject::BaseJoint if !has_base_joint => Some(Need::BaseJoint),
        _ => None,
    });
    if effect.lacks_plate_joints(model.plate).is_some() {
        lacks.insert(Need::PlateJoints);
    }
    if effect.subject.is_link() && !model.links.iter().any(|link| effect.subject.admits(link)) {
        lacks.insert(Need::Link);
    }
    let pulls = model.links.iter().any(|link| link.pull.is_some());
    let is_unloaded = file.payload.is_none() && !pulls;
    let has_forces = folder.has_measured_tensions();
    let is_unknown = |link: &Link| link.pull.as_ref().is_some_and(|pull| pull.value.is_none());
    if effect.reads_forces() && !has_forces && model.links.iter().any(is_unknown) {
        lacks.insert(Need::Tensions);
    }
    for quantity in effect.quantities() {
        let missing = match quantity {
            Readable::Direction => poses
                .iter()
                .any(|pose| pose.directions.is_none())
                .then_some(Need::Directions),
            Readable::Time => poses
                .iter()
                .any(|pose| pose.conditions.time_s.is_none())
                .then_some(Need::Time),
            Readable::Temperature => poses
                .iter()
                .any(|pose| pose.conditions.temperature_c.is_none())
                .then_some(Need::Temperature),
            Readable::LoadAlong
            | Readable::LoadHorizontal
            | Readable::LoadVertical
            | Readable::Tension => {
                let is_measured = quantity == Readable::Tension && has_forces;
                (is_unloaded && !is_measured).then_some(Need::Payload)
            }
            Readable::Command
            | Readable::Travel
            | Readable::CommandOf(_)
            | Readable::SourceCommand
            | Readable::Length
            | Readable::PaidOut
            | Readable::Position(_)
            | Readable::Base(_) => None,
        };
        lacks.extend(missing);
    }
    let turns = |target| matches!(target, Target::Roll | Target::Pitch | Target::Yaw);
    if folder.cart_poses.is_empty() && effect.terms.iter().any(|term| turns(term.target)) {
        lacks.insert(Need::CartPoses);
    }
    lacks.into_iter().collect()
}

/// Files and columns that are not there.
pub(crate) fn missing(robot: &Robot, folder: &Folder, effects: &[Observability]) -> Vec<Gap> {
    let mut missing = Vec::new();
    // Where nothing tells poses, sets 2 and 3 take no part.
    let tells_poses =
        !folder.tcp_poses.is_empty() || folder.rows_of(PlateKind::Position).next().is_some();
    let has_carts = Shape::from(robot).has_carts() && (tells_poses || !folder.has_partial_poses());
    if has_carts && folder.cart_poses.is_empty() {
        let is_piecewise = |variant: &&Variant| {
            let mut tracks = variant.tracks.iter();
            tracks.any(|track| track.shape == TrackShape::Piecewise)
        };
        let variants: Vec<&str> = robot
            .variants
            .iter()
            .filter(is_piecewise)
            .map(|v| v.name.as_str())
            .collect();
        let of_variants = if variants.is_empty() {
            String::new()
        } else {
            format!(", and the variants {}", variants.join(", "))
        };
        missing.push(Gap {
            code: codes::LACKS_FILE,
            what: CART_POSES,
            brings: format!(
                "the shape of each track and how its cart turns, apart from the arm{of_variants}"
            ),
        });
    }
    if has_carts && folder.cart_positions.is_empty() {
        missing.push(Gap {
            code: codes::LACKS_FILE,
            what: CART_POSITIONS,
            brings:
                "where carts are while the arm loads them: what tracks do, told from what links do"
                    .to_owned(),
        });
    }
    let within_reach = || {
        let effects = effects.iter();
        effects.filter(|effect| !effect.lacks.iter().any(|need| need.is_of_machine()))
    };
    let lacking: BTreeSet<Need> = within_reach()
        .flat_map(|effect| effect.lacks.iter().copied())
        .filter(|need| need.is_in_files())
        .collect();
    for need in lacking {
        let names: Vec<&str> = within_reach()
            .filter(|effect| effect.lacks.contains(&need))
            .map(|effect| effect.name.as_str())
            .collect();
        missing.push(Gap {
            code: need.code(),
            what: need.words(),
            brings: format!("sight of {}", names.join(", ")),
        });
    }
    missing
}
