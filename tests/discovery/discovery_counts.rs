//! Discovery over many machines: shares of right and false answers, held against bounds that a right program breaks
//! once in a thousand runs.

use std::collections::BTreeSet;

use nalgebra::Vector3;
use rayon::prelude::*;
use tau::Robot;
use tau::discovery::{Discovery, Options, Outcome, Status, discover};
use tau::kinematics::Pose;
use tau::measurements::PlateKind;
use tau::robot_file::{RobotFile, Value};
use tau::simulation::{Approach, Build, Effect, Measure, Poses, Simulation, Temperature, simulate};

use crate::support::{Random, gantry_tau, prototype};

/// The chance that a right program's answers exceed a bound.
const RARE: f64 = 1e-3;

/// Measurements of a machine; sets are of half the prototype's size.
fn measurements(seed: u64, file: &RobotFile) -> Simulation {
    Simulation {
        poses: Poses::Grid {
            counts: [5, 5, 4],
            step_m: None,
            limit: None,
            jitter: 0.5,
        },
        random_poses: 80,
        approach: Approach::Random,
        temperature: Temperature {
            rise_k: 4.0,
            ..Temperature::default()
        },
        seed,
        ..Simulation::new(gantry_tau(), file.clone())
    }
}

/// The answer of discovery on a machine with effects.
fn searched(seed: u64, file: &RobotFile, build: Build, effects: &[&str]) -> Discovery {
    let (robot, (_, drawing)) = (gantry_tau(), prototype());
    let simulation = Simulation {
        build,
        effects: (effects.iter())
            .map(|effect| Effect::parse(effect, &robot, "effect").unwrap())
            .collect(),
        ..measurements(seed, file)
    };
    let folder = simulate(&simulation).unwrap().folder;
    let options = Options::default();
    discover(&robot, "Full", &drawing, &folder, &options, &mut |_| {})
        .unwrap()
        .discovery
}

/// The largest count that a right program exceeds more rarely than [`RARE`], of `trials` with a chance each.
pub(crate) fn bound(trials: u32, chance: f64) -> usize {
    let mut mass = (1.0 - chance).powi(trials.cast_signed());
    let mut sum = mass;
    let mut count = 0;
    while 1.0 - sum > RARE {
        mass *= f64::from(trials - count) / f64::from(count + 1) * chance / (1.0 - chance);
        sum += mass;
        count += 1;
    }
    count as usize
}

#[test]
fn bounds_are_those_of_the_binomial_distribution() {
    // Ten throws of a coin: eleven of 1024 outcomes have nine heads or ten.
    assert_eq!(bound(10, 0.5), 9);
    assert_eq!(bound(1, 0.5), 1);
    assert_eq!(bound(100, 0.0), 0);
}

/// Nothing is hidden: names are false in one machine of twenty.
#[test]
fn false_names_are_as_rare_as_the_level() {
    let (_, file) = prototype();
    let seeds: Vec<u64> = (100..140).collect();
    let false_names = (seeds.par_iter())
        .filter(|&&seed| {
            !searched(seed, &file, Build::default(), &[])
                .effects
                .is_empty()
        })
        .count();
    assert!(false_names <= bound(40, 0.05), "{false_names} of 40");
}

/// Joints of one cart may run along directions that differ by as much as the drawing tolerates.
#[test]
fn links_of_a_cart_may_run_in_different_directions() {
    let (_, file) = prototype();
    let seeds: Vec<u64> = (200..224).collect();
    let wrong = seeds.par_iter().filter(|&&seed| {
        let mut file = file.clone();
        let mut random = Random(seed);
        for link in file.links.values_mut() {
            let direction = link.track_direction.as_mut().unwrap();
            for component in &mut direction.value {
                *component += direction.tol * random.normal();
            }
        }
        let found = searched(seed, &file, Build::Exact, &[]);
        found.status != Status::NothingMissing
    });
    let wrong = wrong.count();
    assert!(wrong <= bound(24, 0.05), "{wrong} of 24");
}

/// Effects well above the noise have their names, and nothing else has one.
#[test]
fn clear_effects_have_their_names() {
    let hidden = [
        ("backlash(two): gap=6e-5", "backlash", "two"),
        (
            "rack_pitch(one): sine=6e-5, period=0.0133",
            "rack_pitch",
            "one",
        ),
        (
            "cart_crosstalk(three, one): gain=4e-5",
            "cart_crosstalk",
            "three,one",
        ),
        ("link_thermal(l2b): expansion=2e-5", "link_thermal", "l2b"),
        // So strong that it bends by more than noise, which families with many columns follow.
        ("backlash(one): gap=5e-4", "backlash", "one"),
    ];
    let (_, file) = prototype();
    let seeds: Vec<u64> = (300..325).collect();
    let wrong: Vec<(u64, Vec<(String, String)>)> = (seeds.par_iter())
        .filter_map(|&seed| {
            let (effect, name, place) = hidden[seed as usize % hidden.len()];
            let found = searched(seed, &file, Build::default(), &[effect]);
            let names: Vec<(String, String)> = (found.effects.into_iter())
                .map(|effect| (effect.name, effect.place.to_string()))
                .collect();
            (names != [(name.to_owned(), place.to_owned())]).then_some((seed, names))
        })
        .collect();
    assert!(wrong.len() <= bound(25, 0.05), "{wrong:?}");
}

/// Two carts with one effect look like the effect on all carts and its opposite on the third, three with one effect each
/// like all in common; and while one of several effects is not yet known, others stand in for it.
#[test]
fn several_clear_effects_have_their_names() {
    let hidden: [&[&str]; 3] = [
        &["backlash(one): gap=6e-5", "backlash(three): gap=5e-5"],
        &["backlash(all): gap=5e-5"],
        &[
            "rack_pitch(two): sine=5e-5, period=0.0133, second_sine=2.5e-5",
            "backlash(one): gap=6e-5",
            "backlash(three): gap=5e-5",
            "link_thermal(all): expansion=2.4e-5",
        ],
    ];
    let (_, file) = prototype();
    let seeds: Vec<u64> = (600..612).collect();
    let answers: Vec<(u64, usize, BTreeSet<String>)> = (seeds.par_iter())
        .map(|&seed| {
            let effects = hidden[seed as usize % hidden.len()];
            let found = searched(seed, &file, Build::default(), effects);
            let named = found.effects.iter();
            let named: BTreeSet<String> = named
                .map(|effect| format!("{}({})", effect.name, effect.place))
                .collect();
            let of_effect = |effect: &&str| effect.split(':').next().unwrap().to_owned();
            let expected: BTreeSet<String> = effects.iter().map(of_effect).collect();
            let wrong = named.symmetric_difference(&expected).cloned().collect();
            (seed, expected.len(), wrong)
        })
        .collect();
    let names: usize = answers.iter().map(|(_, names, _)| names).sum();
    let wrong: usize = answers.iter().map(|(.., wrong)| wrong.len()).sum();
    assert!(
        wrong <= bound(names as u32, 0.05),
        "{wrong} of {names}: {answers:?}"
    );
}

/// Links of one cart that are parallel and of one length need no full arm, and the test for it costs nothing.
#[test]
fn machines_with_a_reduced_arm_lack_nothing() {
    let (robot, (_, file)) = (gantry_tau(), prototype());
    let seeds: Vec<u64> = (700..708).collect();
    let wrong = seeds.par_iter().filter(|&&seed| {
        let simulated = simulate(&Simulation {
            variant: Some("Nominal".into()),
            ..measurements(seed, &file)
        });
        let simulated = simulated.unwrap();
        let (file, folder) = (&simulated.file, &simulated.folder);
        let options = Options::default();
        let found = discover(&robot, "Nominal", file, folder, &options, &mut |_| {}).unwrap();
        !found.discovery.effects.is_empty()
    });
    let wrong = wrong.count();
    assert!(wrong <= bound(8, 0.05), "{wrong} of 8");
}

/// Links of a cluster that differ by thirty micrometres are found beside an effect that moves the plate by more, and none are
/// where they do not differ.
#[test]
fn a_strong_effect_hides_no_full_arm() {
    let robot = gantry_tau();
    let file = with_parallel_links(&robot, 3e-5);
    let effects = vec![Effect::parse("backlash(one): gap=5e-4", &robot, "effect").unwrap()];
    for (variant, expected) in [
        ("Full", &["full_arm", "backlash"][..]),
        ("Nominal", &["backlash"]),
    ] {
        let seeds: Vec<u64> = (720..728).collect();
        let answers = seeds.par_iter().map(|&seed| {
            let simulated = simulate(&Simulation {
                variant: Some(variant.into()),
                effects: effects.clone(),
                ..measurements(seed, &file)
            });
            let simulated = simulated.unwrap();
            let (file, folder) = (&simulated.file, &simulated.folder);
            let options = Options::default();
            let found = discover(&robot, "Nominal", file, folder, &options, &mut |_| {}).unwrap();
            let effects = found.discovery.effects.into_iter();
            effects.map(|effect| effect.name).collect()
        });
        let wrong = answers.filter(|names: &Vec<String>| names != expected);
        let wrong: Vec<Vec<String>> = wrong.collect();
        assert!(wrong.len() <= bound(8, 0.05), "{variant}: {wrong:?}");
    }
}

/// The prototype in its Tau configuration: the links of each cluster are parallel and of one length, to a tolerance (m).
fn with_parallel_links(robot: &Robot, tolerance_m: f64) -> RobotFile {
    let (_, mut file) = prototype();
    let reference = file.reference.clone().unwrap();
    let at_reference = Pose::from_zyz(reference.position_m, reference.orientation_rad);
    let point = |value: &Value| Vector3::from_column_slice(&value.value);
    for cluster in 0..robot.clusters.len() {
        let links = robot.links_of_cluster(cluster);
        let first = file.links[&robot.links[links[0]].name].clone();
        let joint_and_offset = first.plate_joint.as_ref().zip(first.track_offset.as_ref());
        let (joint, offset) = joint_and_offset.map(|(a, b)| (point(a), point(b))).unwrap();
        for link in links {
            let own = file.links.get_mut(&robot.links[link].name).unwrap();
            let apart = point(own.plate_joint.as_ref().unwrap()) - joint;
            let at = offset + at_reference.rotation * apart;
            own.length.clone_from(&first.length);
            own.track_direction.clone_from(&first.track_direction);
            own.track_offset.as_mut().unwrap().value = at.as_slice().to_vec();
            let geometry = [&mut own.length, &mut own.plate_joint, &mut own.track_offset];
            let geometry = geometry.into_iter().chain([&mut own.track_direction]);
            geometry.flatten().for_each(|value| value.tol = tolerance_m);
        }
    }
    file
}

/// A linear delta with poses, whose robot file gives no dimensions: they are the description's. One effect is of the
/// size that a description expects, the other several times as large.
#[test]
fn on_a_linear_delta_clear_effects_have_their_names() {
    let robot = Robot::from(&tau_generated::linear_delta::ROBOT);
    let text = "robot = \"LinearDelta\"
        [noise]
        position_m = 1e-5
        rotation_rad = 4e-5";
    let file = RobotFile::parse_for(text, "robot.toml", &robot).unwrap();
    let hidden = [
        ("backlash(c): gap=4.31e-4", "backlash", "c"),
        ("link_thermal(all): expansion=1.2e-5", "link_thermal", "all"),
    ];
    let seeds: Vec<u64> = (800..810).collect();
    let wrong: Vec<(u64, Vec<(String, String)>)> = (seeds.par_iter())
        .filter_map(|&seed| {
            let (effect, name, place) = hidden[seed as usize % hidden.len()];
            let simulation = Simulation {
                // Values that a variant holds the machine has as drawn.
                variant: Some("Full".to_owned()),
                effects: vec![Effect::parse(effect, &robot, "effect").unwrap()],
                poses: Poses::Random { count: 120 },
                approach: Approach::Random,
                temperature: Temperature {
                    rise_k: 6.0,
                    ..Temperature::default()
                },
                seed,
                ..Simulation::new(robot.clone(), file.completed(&robot))
            };
            let measured = simulate(&simulation).unwrap();
            let (file, folder) = (&measured.file, &measured.folder);
            let options = Options::default();
            let found = discover(&robot, "Full", file, folder, &options, &mut |_| {}).unwrap();
            let effects = found.discovery.effects.into_iter();
            let names: Vec<(String, String)> = effects
                .map(|effect| (effect.name, effect.place.to_string()))
                .collect();
            (names != [(name.to_owned(), place.to_owned())]).then_some((seed, names))
        })
        .collect();
    assert!(wrong.len() <= bound(10, 0.05), "{wrong:?}");
}

/// A linear delta of which heights over a bed and distances between holes are measured, no pose.
fn by_heights_and_distances(seed: u64, robot: &Robot, effects: &[&str]) -> Simulation {
    let text = "robot = \"LinearDelta\"
        [noise]
        heights = { height_m = 1e-5 }
        distances = { distance_m = 2e-5 }";
    let file = RobotFile::parse_for(text, "robot.toml", robot).unwrap();
    Simulation {
        // Values that a variant holds the machine has as drawn.
        variant: Some("Full".to_owned()),
        effects: (effects.iter())
            .map(|effect| Effect::parse(effect, robot, "effect").unwrap())
            .collect(),
        poses: Poses::Random { count: 160 },
        measures: vec![Measure::Rows(PlateKind::Height), Measure::Distances],
        approach: Approach::Random,
        seed,
        ..Simulation::new(robot.clone(), file.completed(robot))
    }
}

/// Discovery there.
fn found_by_heights_and_distances(seed: u64, effects: &[&str], options: &Options) -> Outcome {
    let robot = Robot::from(&tau_generated::linear_delta::ROBOT);
    let measured = simulate(&by_heights_and_distances(seed, &robot, effects)).unwrap();
    assert!(measured.folder.tcp_poses.is_empty() && measured.folder.cart_poses.is_empty());
    let (file, folder) = (&measured.file, &measured.folder);
    discover(&robot, "Full", file, folder, options, &mut |_| {}).unwrap()
}

/// Nothing is hidden, but readings of a visit share half of their variance, as where a machine does not repeat: with the
/// poses measured and without, names are as rare as where it does.
#[test]
fn what_readings_of_a_visit_share_has_no_name() {
    let (_, file) = prototype();
    let mut wrong: Vec<u64> = (900..905_u64)
        .into_par_iter()
        .filter(|&seed| {
            let mut simulation = Simulation {
                poses: Poses::Random { count: 50 },
                readings: 4,
                ..measurements(seed, &file)
            };
            simulation.noise.visit = 0.5;
            let folder = simulate(&simulation).unwrap().folder;
            let (robot, options) = (gantry_tau(), Options::default());
            let found = discover(&robot, "Full", &file, &folder, &options, &mut |_| {});
            !found.unwrap().discovery.effects.is_empty()
        })
        .collect();
    let robot = Robot::from(&tau_generated::linear_delta::ROBOT);
    let of_rows = (905..910_u64).into_par_iter().filter(|&seed| {
        let mut simulation = Simulation {
            poses: Poses::Random { count: 60 },
            readings: 4,
            ..by_heights_and_distances(seed, &robot, &[])
        };
        simulation.noise.visit = 0.5;
        let measured = simulate(&simulation).unwrap();
        let (file, folder) = (&measured.file, &measured.folder);
        let options = Options::default();
        let found = discover(&robot, "Full", file, folder, &options, &mut |_| {});
        !found.unwrap().discovery.effects.is_empty()
    });
    wrong.extend(of_rows.collect::<Vec<u64>>());
    assert!(wrong.len() <= bound(10, 0.05), "{wrong:?}");
}

/// The names that it gives.
fn named_by_heights_and_distances(seed: u64, effects: &[&str]) -> Vec<(String, String)> {
    let found = found_by_heights_and_distances(seed, effects, &Options::default());
    let effects = found.discovery.effects.into_iter();
    effects
        .map(|effect| (effect.name, effect.place.to_string()))
        .collect()
}

/// More poses than a search takes: an evenly spread part shows the same, and distances between them take part.
#[test]
fn a_part_of_many_unknown_poses_is_searched() {
    let mut options = Options::default();
    options.constants.most_poses = 60.0;
    let found = found_by_heights_and_distances(500, &["backlash(a): gap=2e-4"], &options);
    let remarks = &found.discovery.remarks;
    let of_all =
        |remark: &tau::codes::Remark| remark.text.starts_with("of 80 poses that calibrate");
    assert!(remarks.iter().any(of_all), "{remarks:?}");
    let names: Vec<String> = (found.discovery.effects.iter())
        .map(|effect| format!("{}({})", effect.name, effect.place))
        .collect();
    assert_eq!(names, ["backlash(a)"]);
    let unknown = found.unknown.unwrap();
    assert_eq!(unknown.counts.calibration, 80);
    assert!(unknown.rows.distances.len() > 20, "{:?}", unknown.rows);
    assert!(unknown.division.calibration.len() <= 60);
}

#[test]
fn without_poses_false_names_are_as_rare_as_the_level() {
    let seeds: Vec<u64> = (400..416).collect();
    let false_names = seeds
        .par_iter()
        .filter(|&&seed| !named_by_heights_and_distances(seed, &[]).is_empty())
        .count();
    assert!(false_names <= bound(16, 0.05), "{false_names} of 16");
}

#[test]
fn without_poses_clear_effects_have_their_names() {
    let hidden = [
        ("backlash(a): gap=2e-4", "backlash", "a"),
        ("rack_pitch(b): sine=8e-5, period=0.019", "rack_pitch", "b"),
    ];
    let seeds: Vec<u64> = (500..512).collect();
    let wrong: Vec<(u64, Vec<(String, String)>)> = (seeds.par_iter())
        .filter_map(|&seed| {
            let (effect, name, place) = hidden[seed as usize % hidden.len()];
            let names = named_by_heights_and_distances(seed, &[effect]);
            (names != [(name.to_owned(), place.to_owned())]).then_some((seed, names))
        })
        .collect();
    assert!(wrong.len() <= bound(12, 0.05), "{wrong:?}");
}
