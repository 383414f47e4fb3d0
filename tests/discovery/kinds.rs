//! Machines of every kind, drawn at random: what is hidden in them has its name, and nothing else has one. Here one
//! machine each; the slow tier draws many of every kind and counts.

use std::collections::BTreeSet;
use std::ops::Range;

use nalgebra::Vector3;
use rayon::prelude::*;
use tau::Robot;
use tau::discovery::{Options, Outcome, Status, discover};
use tau::kinematics::Pose;
use tau::measurements::PlateKind;
use tau::robot_file::{RobotFile, Value};
use tau::simulation::{Approach, Build, Effect, Measure, Poses, Simulation, simulate};
use tau_testkit::Random;
use tau_testkit::robots::{gantry_tau, named, prototype};

/// Machines of one kind: how one is measured, by its seed, before anything is hidden in it; what is hidden, by turns; and
/// seeds of those that the slow tier draws. A full arm that is to be found is in the machine already.
pub(crate) struct Kind(
    fn(u64) -> Simulation,
    &'static [&'static [&'static str]],
    pub(crate) Range<u64>,
);

const NOTHING: &[&[&str]] = &[&[]];

pub(crate) const KINDS: &[Kind] = &[
    Kind(gantry, NOTHING, 100..140),
    Kind(with_links_that_differ, NOTHING, 201..225),
    Kind(
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
    Kind(
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
    Kind(|seed| reduced(gantry(seed)), NOTHING, 700..708),
    // Links of a cluster that differ by thirty micrometres are found beside an effect that moves the plate by more.
    Kind(
        with_parallel_links,
        &[&["backlash(one): gap=5e-4", "full_arm(all)"]],
        720..728,
    ),
    Kind(
        |seed| reduced(with_parallel_links(seed)),
        &[&["backlash(one): gap=5e-4"]],
        720..728,
    ),
    // Readings of a visit share half of their variance, as where a machine does not repeat.
    Kind(|seed| with_visits(50, gantry(seed)), NOTHING, 900..905),
    Kind(
        |seed| with_visits(60, by_heights_and_distances(seed)),
        NOTHING,
        905..910,
    ),
    // The robot file gives no dimensions: they are the description's. One effect is of the size that a description
    // expects, the other several times as large.
    Kind(
        |seed| linear_delta(seed, "position_m = 1e-5\nrotation_rad = 4e-5", 120),
        &[
            &["backlash(c): gap=4.31e-4"],
            &["link_thermal(all): expansion=1.2e-5"],
        ],
        800..810,
    ),
    Kind(by_heights_and_distances, NOTHING, 400..416),
    Kind(
        by_heights_and_distances,
        &[
            &["backlash(a): gap=2e-4"],
            &["rack_pitch(b): sine=8e-5, period=0.019"],
        ],
        500..512,
    ),
];

/// The prototype's machine, with sets of half the size of its own.
pub(crate) fn gantry(seed: u64) -> Simulation {
    Simulation {
        poses: Poses::Grid {
            counts: [5, 5, 4],
            step_m: None,
            limit: None,
            jitter: 0.5,
        },
        random_poses: 80,
        approach: Approach::Random,
        seed,
        ..warming_by(4.0, gantry_tau(), prototype().1)
    }
}

fn warming_by(rise_k: f64, robot: Robot, file: RobotFile) -> Simulation {
    let mut simulation = Simulation::new(robot, file);
    simulation.temperature.rise_k = rise_k;
    simulation
}

fn reduced(mut simulation: Simulation) -> Simulation {
    simulation.variant = Some("Nominal".to_owned());
    simulation
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
fn linear_delta(seed: u64, noise: &str, count: usize) -> Simulation {
    let robot = named("linear_delta");
    let text = format!("robot = \"LinearDelta\"\n[noise]\n{noise}");
    let file = RobotFile::parse_for(&text, "robot.toml", &robot).unwrap();
    let file = file.completed(&robot);
    Simulation {
        variant: Some("Full".to_owned()),
        approach: Approach::Random,
        poses: Poses::Random { count },
        seed,
        ..warming_by(6.0, robot, file)
    }
}

/// Heights over a bed and distances between holes are measured, no pose.
fn by_heights_and_distances(seed: u64) -> Simulation {
    let noise = "heights = { height_m = 1e-5 }\ndistances = { distance_m = 2e-5 }";
    let mut simulation = linear_delta(seed, noise, 160);
    simulation.measures = vec![Measure::Rows(PlateKind::Height), Measure::Distances];
    simulation
}

pub(crate) fn with_effects(hidden: &[&str], mut simulation: Simulation) -> Simulation {
    let has_values = hidden.iter().filter(|effect| effect.contains(':'));
    let parsed = has_values.map(|text| Effect::parse(text, &simulation.robot, "effect").unwrap());
    simulation.effects = parsed.collect();
    simulation
}

/// The search in what is measured of a machine, and names and places of the effects that it found, in order.
pub(crate) fn searched(
    simulation: &Simulation,
    base: &str,
    options: &Options,
) -> (Outcome, Vec<String>) {
    let simulated = simulate(simulation).unwrap();
    // Of a machine that is built exactly, the drawing is another one.
    let file = match simulation.build {
        Build::Exact => prototype().1,
        Build::Drawn { .. } => simulated.file,
    };
    let (robot, folder) = (&simulation.robot, &simulated.folder);
    let found = discover(robot, base, &file, folder, options, &mut |_| {}).unwrap();
    let effects = found.discovery.effects.iter();
    let names = effects.map(|effect| format!("{}({})", effect.name, effect.place));
    let names: BTreeSet<String> = names.collect();
    (found, names.into_iter().collect())
}

impl Kind {
    /// Number of the names that the machine of a seed should have, and those that it has but should not, or should have but
    /// has not.
    pub(crate) fn wrong_names(&self, seed: u64) -> (usize, BTreeSet<String>) {
        let Self(machine, hidden, _) = self;
        let hidden = hidden[seed as usize % hidden.len()];
        let of_effect = |effect: &&str| effect.split(':').next().unwrap().to_owned();
        let expected: BTreeSet<String> = hidden.iter().map(of_effect).collect();
        let simulation = with_effects(hidden, machine(seed));
        let is_reduced = simulation.variant.as_deref() == Some("Nominal");
        let is_found_reduced = is_reduced || expected.contains("full_arm(all)");
        let base = ["Full", "Nominal"][usize::from(is_found_reduced)];
        let (found, names) = searched(&simulation, base, &Options::default());
        let mut named = BTreeSet::from_iter(names);
        if found.discovery.status == Status::UnnamedStructure {
            named.insert("unnamed".to_owned());
        }
        let wrong = named.symmetric_difference(&expected).cloned().collect();
        (expected.len().max(1), wrong)
    }
}

/// Of each kind but the first, which a trial has, the first machine with the last of what may be hidden.
#[test]
fn one_of_each_kind_has_its_names() {
    let wrong = KINDS[1..].par_iter().map(|kind| {
        let seed = kind.2.start + kind.1.len() as u64 - 1;
        (seed, kind.wrong_names(seed).1)
    });
    let wrong: Vec<_> = wrong.filter(|(_, wrong)| !wrong.is_empty()).collect();
    assert_eq!(wrong, []);
}

/// More poses than a search takes: an evenly spread part shows the same, and distances between them take part.
#[test]
fn a_part_of_many_poses_is_searched() {
    let mut options = Options::default();
    for (machine, most) in [(gantry(300), 40), (by_heights_and_distances(500), 60)] {
        let place = &machine.robot.tracks[0].clone();
        let hidden = format!("backlash({place}): gap=2e-4");
        options.constants.most_poses = f64::from(most);
        let (found, names) = searched(&with_effects(&[&hidden], machine), "Full", &options);
        assert_eq!(names, [format!("backlash({place})")]);
        let mut remarks = found.discovery.remarks.iter();
        assert!(remarks.any(|remark| remark.code == tau_codes::discovery::PART));
        let Some(unknown) = found.unknown else {
            // All of them calibrate what was found.
            assert!(found.poses.len() > 40);
            continue;
        };
        assert_eq!(unknown.counts.calibration, 80);
        assert!(unknown.rows.distances.len() > 20, "{:?}", unknown.rows);
        assert!(unknown.division.calibration.len() <= 60);
    }
}
