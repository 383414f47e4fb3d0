//! Order, conditions, places and files of simulated measurements.

use std::collections::BTreeSet;
use std::fs;

use tau::measurements::{Folder, PlateKind};
use tau::robot_file::{RobotFile, Value};
use tau::simulation::{Approach, Measure, Poses, Simulation, Temperature, TrackPoints};
use tau_codes::files;
use tau_testkit::Work;
use tau_testkit::robots::gantry_tau;

use super::{LISTED, V, folder, gantry, mean, noise, run, silent, with_effects};

#[test]
fn the_seed_decides_everything() {
    let mut simulation = silent();
    simulation.noise = noise(|_| ());
    let texts = |simulation: &Simulation| run(simulation).texts();
    let once = texts(&simulation);
    assert_eq!(once, texts(&simulation));
    simulation.seed = 2;
    for ((file, a), (_, b)) in once.iter().zip(&texts(&simulation)) {
        // The drawings do not depend on it.
        assert_eq!(a != b, *file != "robot.toml", "{file}");
    }
}

/// An effect leaves the machine, the poses and the noise as they were, so that two folders can be
/// compared.
#[test]
fn an_effect_changes_nothing_but_itself() {
    let [plain, moved] = [&[][..], &[LISTED[11]]].map(|effects| {
        let mut simulation = with_effects(effects);
        simulation.noise = noise(|_| ());
        folder(&simulation)
    });
    for (a, b) in plain.tcp_poses.iter().zip(&moved.tcp_poses) {
        assert_eq!((&a.commands_m, a.angles_rad), (&b.commands_m, b.angles_rad));
        let drift = V::from(b.position_m) - V::from(a.position_m);
        let wanted = V::new(1e-8, -2e-8, 5e-9) * a.conditions.time_s.unwrap();
        assert!((drift - wanted).norm() < 1e-14);
    }
    assert_eq!(plain.cart_poses, moved.cart_poses);
    assert_eq!(plain.cart_positions, moved.cart_positions);
}

#[test]
fn files_read_back_as_they_were() {
    let work = Work::empty();
    let path = work.path().join("new/folder");
    let mut simulation = with_effects(&LISTED);
    simulation.noise = noise(|own| own.outliers = 0.1);
    simulation.track_points = TrackPoints {
        count: 5,
        jitter: 0.5,
        both_ways: true,
    };
    let simulated = run(&simulation);
    simulated.write(&path).unwrap();
    let robot = gantry_tau();
    let read = Folder::read(&path, &(&robot).into()).unwrap();
    assert_eq!(read.tcp_poses, simulated.folder.tcp_poses);
    assert_eq!(read.cart_poses, simulated.folder.cart_poses);
    assert_eq!(read.cart_positions, simulated.folder.cart_positions);
    assert_eq!(read.remarks, []);
    let file = RobotFile::read(&path.join("robot.toml"), &robot).unwrap();
    assert_eq!(file, simulated.file);

    let truth: serde_json::Value =
        serde_json::from_str(&work.read("new/folder/truth.json")).unwrap();
    assert_eq!(truth["status"], serde_json::json!(["explained"]));
    let effects = tau_testkit::list(&truth["effects"]);
    assert_eq!(effects.len(), 14);
    assert_eq!(effects[0]["name"], "rack_pitch");
    assert_eq!(effects[0]["parameters"]["period"], 0.0133);
    assert_eq!(effects[10]["place"], "two,three");
    assert_eq!(tau_testkit::list(&truth["outliers"]).len(), 2);

    // Nothing besides is left, and measurements are never overwritten.
    let names = [work.listing("new/folder").len(), work.listing("new").len()];
    assert_eq!(names, [5, 1]);
    let again = simulated.write(&path).unwrap_err();
    assert_eq!(again.code(), files::ALREADY_THERE);
    let file = work.write("file", "").path().join("file");
    assert!(simulated.write(&file.join("folder")).is_err());
    assert!(simulated.write(&file).is_err());
    assert_eq!(fs::read_to_string(&file).unwrap(), "");
}

#[test]
fn sets_that_are_not_asked_for_are_not_there() {
    let simulated = run(&gantry(5));
    let texts = simulated.texts();
    let names: Vec<&str> = texts.iter().map(|(name, _)| *name).collect();
    assert_eq!(names, ["robot.toml", "truth.json", "tcp_poses.csv"]);
    assert_eq!(simulated.truth.status, ["nothing_missing"]);
}

#[test]
fn directions_are_those_of_the_moves() {
    for pair in folder(&silent()).tcp_poses.windows(2) {
        for k in 0..3 {
            let moved = pair[1].commands_m[k] - pair[0].commands_m[k];
            assert_eq!(pair[1].directions.as_ref().unwrap()[k], moved.signum());
        }
    }
    let random = folder(&Simulation {
        approach: Approach::Random,
        ..gantry(300)
    });
    let signs = random.tcp_poses.iter();
    let signs = signs.flat_map(|pose| pose.directions.clone().unwrap());
    let signs: Vec<f64> = signs.collect();
    assert!(signs.iter().all(|sign| sign.abs() == 1.0));
    // Of 900 signs the mean varies by a thirtieth.
    assert!(mean(signs).abs() < 0.12);
}

#[test]
fn conditions_follow_their_profile() {
    let folder = folder(&Simulation {
        temperature: Temperature {
            start_c: 21.0,
            rise_k: 6.0,
            time_constant_s: 200.0,
            jitter_k: 0.0,
        },
        ..silent()
    });
    for (index, pose) in folder.tcp_poses.iter().enumerate() {
        let time = pose.conditions.time_s.unwrap();
        assert_eq!(time, 30.0 * index as f64);
        let wanted = 27.0 - 6.0 * (-time / 200.0).exp();
        assert!((pose.conditions.temperature_c.unwrap() - wanted).abs() < 1e-12);
    }
    let points = folder.cart_poses.iter().map(|row| &row.conditions);
    let positions = folder.cart_positions.iter().map(|row| &row.conditions);
    let mut others = points.chain(positions);
    assert!(others.all(|conditions| conditions.temperature_c == Some(21.0)));
}

#[test]
fn points_lie_where_they_are_asked_for() {
    let plan = |track_points| {
        let mut folder = folder(&Simulation {
            track_points,
            ..silent()
        });
        folder.cart_poses.retain(|row| row.track == 1);
        folder
    };
    // From -0.65 m to 0.7 m.
    let off = |(k, command_m): (usize, f64)| (command_m + 0.65 - 0.05 * k as f64).abs();
    let folder = plan(TrackPoints::default());
    let commands = folder.cart_poses.iter().map(|row| row.command_m);
    assert_eq!(commands.len(), 28);
    assert!(commands.enumerate().all(|own| off(own) < 1e-12));
    let mut commands = folder.cart_positions.iter().flat_map(|row| &row.commands_m);
    assert!(commands.all(|q| (-0.65..=0.7).contains(q)));

    let folder = plan(TrackPoints {
        count: 28,
        jitter: 1.0,
        both_ways: true,
    });
    let (there, back) = folder.cart_poses.split_at(28);
    assert_eq!(back.len(), 28);
    assert!(there.is_sorted_by(|a, b| a.command_m < b.command_m));
    assert!(back.is_sorted_by(|a, b| a.command_m > b.command_m));
    assert!(there.iter().all(|row| row.direction == Some(1.0)));
    let commands = there.iter().map(|row| row.command_m);
    assert!((0.008..0.018).contains(&mean(commands.enumerate().map(off))));

    let at = vec![[-1.3, -4.2, 0.0], [-1.4, -4.3, 0.1]];
    let mut simulation = with_effects(&[]);
    simulation.poses = Poses::Positions(at.clone());
    for (pose, at) in run(&simulation).folder.tcp_poses.iter().zip(at) {
        // Drawings and machine differ only by what makes the carts rigid.
        assert!((V::from(pose.position_m) - V::from(at)).norm() < 5e-3);
    }
}

/// Where poses are measured beside them, distances are between the poses of the same numbers.
#[test]
fn distances_name_poses_where_each_reading_has_a_number() {
    let folder = folder(&Simulation {
        readings: 3,
        measures: vec![Measure::Poses, Measure::Distances],
        ..gantry(20)
    });
    assert_eq!((folder.tcp_poses.len(), folder.distances.len()), (60, 60));
    for distance in &folder.distances {
        let [from, to] = distance.poses.map(|number| {
            let mut poses = folder.tcp_poses.iter();
            V::from(poses.find(|pose| pose.pose == number).unwrap().position_m)
        });
        let off_m = (from - to).norm() - distance.distance_m;
        assert!(off_m.abs() < 1e-4, "{distance:?}: {off_m}");
    }
}

/// The other way round, a pair is the same.
#[test]
fn no_distance_is_measured_twice() {
    for (count, seed) in (2..8).flat_map(|count| (1..=5).map(move |seed| (count, seed))) {
        let distances = folder(&Simulation {
            measures: vec![Measure::Distances],
            seed,
            ..gantry(count)
        })
        .distances;
        let pairs = distances.iter().map(|distance| {
            let [one, other] = distance.poses;
            [one.min(other), one.max(other)]
        });
        let distinct: BTreeSet<[u32; 2]> = pairs.collect();
        assert_eq!(distinct.len(), distances.len(), "{count} poses, {seed}");
        assert!(distances.len() >= count / 2, "{count} poses, {seed}");
    }
}

/// A tracker's errors are in positions as they are in poses, by the formulas of `docs/language.md`; where it measures
/// nothing, that is said.
#[test]
fn errors_of_a_tracker_are_in_positions() {
    let effects = [
        "tracker_drift(tcp): rate=(1e-7,-2e-7,3e-7)",
        "tracker_scale(tcp): scale=2e-4",
    ];
    let simulated = |effects: &[&str], kind: PlateKind| {
        let mut simulation = with_effects(effects);
        simulation.measures = vec![Measure::Rows(kind)];
        for (name, x) in [("left", 0.3), ("right", -0.3)] {
            let target = Value {
                value: vec![x, 0.1, -0.2],
                tol: 0.0,
                sigma: None,
            };
            let targets = &mut simulation.file.measuring.targets;
            targets.insert(name.into(), target);
        }
        run(&simulation)
    };
    let plain = simulated(&[], PlateKind::Position).folder.plate_rows;
    let seen = simulated(&effects, PlateKind::Position);
    let rows = seen.folder.plate_rows;
    assert_eq!((plain.len(), rows.len()), (36, 36));
    for (plain, row) in plain.iter().zip(&rows) {
        let time_s = plain.conditions.time_s.unwrap();
        for (axis, rate) in [1e-7, -2e-7, 3e-7].into_iter().enumerate() {
            let (truly, seen) = (plain.values[axis].unwrap(), row.values[axis].unwrap());
            let expected = truly + rate * time_s + 2e-4 * truly / (1.0 - 2e-4);
            assert!((seen - expected).abs() < 1e-12, "{seen} {expected}");
        }
    }
    assert_eq!(seen.truth.remarks, []);
    let remarks = simulated(&effects, PlateKind::Height).truth.remarks;
    let codes: Vec<_> = remarks.iter().map(|remark| remark.code).collect();
    assert_eq!(codes, [files::SAYS_NOTHING; 2]);
}
