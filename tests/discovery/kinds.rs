//! Machines of every kind, drawn at random: what is hidden in them has its name, and nothing else has one.
//!
//! Here one machine each, or a few; the slow tier draws many of every kind and counts.

use std::collections::BTreeSet;
use std::ops::Range;

use nalgebra::Vector3;
use rayon::prelude::*;
use tau::Robot;
use tau::discovery::{Options, Status};
use tau::kinematics::Pose;
use tau::measurements::PlateKind;
use tau::robot_file::{RobotFile, Value};
use tau::simulation::{Approach, Build, Effect, Measure, Poses, Simulation, Temperature, simulate};
use tau_testkit::Random;
use tau_testkit::robots::{gantry_tau, named, prototype};

use crate::search::{names, searched};

/// Machines of one kind.
pub(crate) struct Kind {
    /// What they have in common.
    pub(crate) name: &'static str,
    /// Measurements of one, by its seed, before anything is hidden in it.
    machine: fn(u64) -> Simulation,
    /// The variant from which the search starts.
    base: &'static str,
    /// What is hidden, by turns; what has no values is in the machine already.
    hidden: &'static [&'static [&'static str]],
    /// Seeds of those that the slow tier draws.
    pub(crate) seeds: Range<u64>,
}

const fn kind(
    name: &'static str,
    machine: fn(u64) -> Simulation,
    hidden: &'static [&'static [&'static str]],
    seeds: Range<u64>,
) -> Kind {
    let base = "Full";
    Kind {
        name,
        machine,
        base,
        hidden,
        seeds,
    }
}

const fn from_nominal(kind: Kind) -> Kind {
    Kind {
        base: "Nominal",
        ..kind
    }
}

pub(crate) const KINDS: &[Kind] = &[
    kind("nothing is hidden", gantry, &[&[]], 100..140),
    kind(
        "links of a cart differ in direction",
        with_links_that_differ,
        &[&[]],
        200..224,
    ),
    kind(
        "a clear effect",
        gantry,
        &[
            &["backlash(two): gap=6e-5"],
            &["rack_pitch(one): sine=6e-5, period=0.0133"],
            &["link_thermal(l2b): expansion=2e-5"],
            // So strong that it bends by more than noise, which families with many columns follow.
            &["backlash(one): gap=5e-4"],
            &["cart_crosstalk(three,one): gain=4e-5"],
        ],
        300..325,
    ),
    // Two carts with one effect look like the effect on all carts and its opposite on the third, three with one effect
    // each like all in common; and while one of several effects is not yet known, others stand in for it.
    kind(
        "several clear effects",
        gantry,
        &[
            &["backlash(one): gap=6e-5", "backlash(three): gap=5e-5"],
            &["backlash(all): gap=5e-5"],
            &[
                "rack_pitch(two): sine=5e-5, period=0.0133, second_sine=2.5e-5",
                "backlash(one): gap=6e-5",
                "backlash(three): gap=5e-5",
                "link_thermal(all): expansion=2.4e-5",
            ],
        ],
        600..612,
    ),
    // Links of one cart that are parallel and of one length need no full arm, and the test for it costs nothing.
    from_nominal(kind(
        "a reduced arm",
        |seed| of_variant("Nominal", gantry(seed)),
        &[&[]],
        700..708,
    )),
    // Links of a cluster that differ by thirty micrometres are found beside an effect that moves the plate by more.
    from_nominal(kind(
        "a strong effect and a full arm",
        |seed| of_variant("Full", with_parallel_links(seed)),
        &[&["backlash(one): gap=5e-4", "full_arm(all)"]],
        720..728,
    )),
    from_nominal(kind(
        "a strong effect and a reduced arm",
        |seed| of_variant("Nominal", with_parallel_links(seed)),
        &[&["backlash(one): gap=5e-4"]],
        720..728,
    )),
    // Readings of a visit share half of their variance, as where a machine does not repeat.
    kind(
        "visits differ",
        |seed| with_visits(50, gantry(seed)),
        &[&[]],
        900..905,
    ),
    kind(
        "visits differ, no pose is measured",
        |seed| with_visits(60, by_heights_and_distances(seed)),
        &[&[]],
        905..910,
    ),
    // The robot file gives no dimensions: they are the description's. One effect is of the size that a description
    // expects, the other several times as large.
    kind(
        "a linear delta",
        delta,
        &[
            &["backlash(c): gap=4.31e-4"],
            &["link_thermal(all): expansion=1.2e-5"],
        ],
        800..810,
    ),
    kind(
        "no pose is measured, nothing hidden",
        by_heights_and_distances,
        &[&[]],
        400..416,
    ),
    kind(
        "no pose is measured",
        by_heights_and_distances,
        &[
            &["backlash(a): gap=2e-4"],
            &["rack_pitch(b): sine=8e-5, period=0.019"],
        ],
        500..512,
    ),
];

/// The prototype's machine, with sets of half the size of its own.
fn gantry(seed: u64) -> Simulation {
    Simulation {
        poses: Poses::Grid {
            counts: [5, 5, 4],
            step_m: None,
            limit: None,
            jitter: 0.5,
        },
        random_poses: 80,
        approach: Approach::Random,
        temperature: warming_by(4.0),
        seed,
        ..Simulation::new(gantry_tau(), prototype().1)
    }
}

fn warming_by(rise_k: f64) -> Temperature {
    Temperature {
        rise_k,
        ..Temperature::default()
    }
}

fn of_variant(name: &str, simulation: Simulation) -> Simulation {
    Simulation {
        variant: Some(name.to_owned()),
        ..simulation
    }
}

fn with_links_that_differ(seed: u64) -> Simulation {
    let mut simulation = gantry(seed);
    simulation.build = Build::Exact;
    let mut random = Random(seed);
    for link in simulation.file.links.values_mut() {
        let direction = link.track_direction.as_mut().unwrap();
        for component in &mut direction.value {
            *component += direction.tol * random.normal();
        }
    }
    simulation
}

/// The prototype in its Tau configuration: the links of each cluster are parallel and of one length, to thirty micrometres.
fn with_parallel_links(seed: u64) -> Simulation {
    let mut simulation = gantry(seed);
    let (robot, file) = (&simulation.robot, &mut simulation.file);
    let reference = file.reference.clone().unwrap();
    let at_reference = Pose::from_zyz(reference.position_m, reference.orientation_rad);
    let point = |value: &Option<Value>| Vector3::from_column_slice(&value.as_ref().unwrap().value);
    for cluster in 0..robot.clusters.len() {
        let links = robot.links_of_cluster(cluster);
        let first = file.links[&robot.links[links[0]].name].clone();
        let [joint, offset] = [&first.plate_joint, &first.track_offset].map(point);
        for link in links {
            let own = file.links.get_mut(&robot.links[link].name).unwrap();
            let apart = at_reference.rotation * (point(&own.plate_joint) - joint);
            own.length.clone_from(&first.length);
            own.track_direction.clone_from(&first.track_direction);
            own.track_offset.as_mut().unwrap().value = (offset + apart).as_slice().to_vec();
            let geometry = [&mut own.length, &mut own.plate_joint, &mut own.track_offset];
            let geometry = geometry.into_iter().chain([&mut own.track_direction]);
            geometry.flatten().for_each(|value| value.tol = 3e-5);
        }
    }
    simulation
}

fn with_visits(count: usize, mut simulation: Simulation) -> Simulation {
    simulation.poses = Poses::Random { count };
    simulation.readings = 4;
    simulation.noise.visit = 0.5;
    simulation
}

/// A linear delta whose robot file gives the noise alone. Values that its variant holds the machine has as drawn.
fn linear_delta(seed: u64, noise: &str) -> Simulation {
    let robot = named("linear_delta");
    let text = format!("robot = \"LinearDelta\"\n[noise]\n{noise}");
    let file = RobotFile::parse_for(&text, "robot.toml", &robot).unwrap();
    let file = file.completed(&robot);
    let simulation = Simulation {
        approach: Approach::Random,
        seed,
        ..Simulation::new(robot, file)
    };
    of_variant("Full", simulation)
}

fn delta(seed: u64) -> Simulation {
    Simulation {
        poses: Poses::Random { count: 120 },
        temperature: warming_by(6.0),
        ..linear_delta(seed, "position_m = 1e-5\nrotation_rad = 4e-5")
    }
}

/// Of which heights over a bed and distances between holes are measured, no pose.
fn by_heights_and_distances(seed: u64) -> Simulation {
    let noise = "heights = { height_m = 1e-5 }\ndistances = { distance_m = 2e-5 }";
    Simulation {
        poses: Poses::Random { count: 160 },
        measures: vec![Measure::Rows(PlateKind::Height), Measure::Distances],
        ..linear_delta(seed, noise)
    }
}

fn with_effects(hidden: &[&str], simulation: Simulation) -> Simulation {
    let has_values = hidden.iter().filter(|effect| effect.contains(':'));
    let parsed = has_values.map(|text| Effect::parse(text, &simulation.robot, "effect").unwrap());
    Simulation {
        effects: parsed.collect(),
        ..simulation
    }
}

impl Kind {
    /// Number of the names that the machine of a seed should have, and those that it has but should not, or should have but
    /// has not.
    pub(crate) fn wrong_names(&self, seed: u64) -> (usize, BTreeSet<String>) {
        let hidden = self.hidden[seed as usize % self.hidden.len()];
        let simulation = with_effects(hidden, (self.machine)(seed));
        let simulated = simulate(&simulation).unwrap();
        // Of a machine that is built exactly, the drawing is another one.
        let file = match simulation.build {
            Build::Exact => prototype().1,
            Build::Drawn { .. } => simulated.file,
        };
        let start = (&simulation.robot, self.base);
        let found = searched(start, &file, &simulated.folder, &Options::default()).discovery;
        let mut named: BTreeSet<String> = names(&found).into_iter().collect();
        if found.status == Status::UnnamedStructure {
            named.insert("unnamed".to_owned());
        }
        let of_effect = |effect: &&str| effect.split(':').next().unwrap().to_owned();
        let expected: BTreeSet<String> = hidden.iter().map(of_effect).collect();
        let wrong = named.symmetric_difference(&expected).cloned().collect();
        (expected.len().max(1), wrong)
    }
}

/// Of each kind the first machine with the last of what may be hidden.
#[test]
fn one_of_each_kind_has_its_names() {
    let wrong = (KINDS.par_iter()).map(|kind| {
        let seed = kind.seeds.start + kind.hidden.len() as u64 - 1;
        (kind.name, kind.wrong_names(seed).1)
    });
    let wrong: Vec<_> = wrong.filter(|(_, wrong)| !wrong.is_empty()).collect();
    assert_eq!(wrong, []);
}

/// More poses than a search takes: an evenly spread part shows the same, and distances between them take part.
#[test]
fn a_part_of_many_unknown_poses_is_searched() {
    let simulation = by_heights_and_distances(500);
    let simulation = with_effects(&["backlash(a): gap=2e-4"], simulation);
    let measured = simulate(&simulation).unwrap();
    assert!(measured.folder.tcp_poses.is_empty() && measured.folder.cart_poses.is_empty());
    let mut options = Options::default();
    options.constants.most_poses = 60.0;
    let robot: &Robot = &simulation.robot;
    let found = searched((robot, "Full"), &measured.file, &measured.folder, &options);
    assert_eq!(names(&found.discovery), ["backlash(a)"]);
    let mut remarks = found.discovery.remarks.iter();
    assert!(remarks.any(|remark| remark.code == tau_codes::discovery::PART));
    let unknown = found.unknown.unwrap();
    assert_eq!(unknown.counts.calibration, 80);
    assert!(unknown.rows.distances.len() > 20, "{:?}", unknown.rows);
    assert!(unknown.division.calibration.len() <= 60);
}
