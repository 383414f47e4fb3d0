//! Requests as they are typed, and what is wrong with them.

use std::collections::BTreeSet;
use std::fs;

use serde_json::Value;
use tau::InputError;
use tau::measurements::PlateKind;
use tau::simulation::{Effect, Measure, Poses, Request, Simulation, TrackPoints};

use super::{drawings, run, with_effects};
use crate::support::tau_in;

/// Message and help of the one mistake in an effect, with what is marked.
fn mistake(text: &str) -> (String, String, String) {
    let error = Effect::parse(text, &drawings().0, "--effect").unwrap_err();
    let [problem] = error.problems() else {
        panic!("{error}")
    };
    let marked = text[problem.place.as_ref().unwrap().span.clone()].to_owned();
    (
        problem.message.clone(),
        problem.help.clone().unwrap_or_default(),
        marked,
    )
}

#[test]
fn effects_are_read_with_their_place_and_parameters() {
    let robot = drawings().0;
    let read = |text: &str| Effect::parse(text, &robot, "--effect").unwrap().parameters;
    let rack = read(" rack_pitch( two ) :sine=8e-5,period = 0.0133 ");
    let expected = [
        ("sine", vec![8e-5]),
        ("cosine", vec![0.0]),
        ("second_sine", vec![0.0]),
        ("second_cosine", vec![0.0]),
        ("period", vec![0.0133]),
    ];
    assert_eq!(
        rack,
        expected.map(|(name, values)| (name.to_owned(), values))
    );
    for text in [
        "tracker_drift(tcp): rate=(1e-8, 0, -2e-8)",
        "tracker_drift(tcp): rate=[1e-8,0,-2e-8]",
    ] {
        assert_eq!(read(text), [("rate".to_owned(), vec![1e-8, 0.0, -2e-8])]);
    }
}

#[test]
fn mistakes_in_effects_are_marked_and_mended() {
    for (text, message, help, marked) in [
        (
            "rack_pich(two): sine=8e-5",
            "unknown effect `rack_pich`",
            "did you mean `rack_pitch`?",
            "rack_pich",
        ),
        (
            "rack_pitch(tow): sine=8e-5, period=0.01",
            "`rack_pitch` acts on a track's cart, and `tow` is none",
            "did you mean `two`?",
            "tow",
        ),
        (
            "rack_pitch(two): sin=8e-5, period=0.01",
            "`rack_pitch` has no parameter `sin`",
            "did you mean `sine`?",
            "sin",
        ),
        (
            "backlash(one): gap=40um",
            "`40um` is not a number",
            "write `gap=…` in m",
            "40um",
        ),
        (
            "backlash(one)",
            "`backlash` has no parameters here",
            "add them after a colon: `gap=…` in m",
            "backlash(one)",
        ),
        (
            "backlash(one): gap=0",
            "all amplitudes of `backlash` are zero, so that it does nothing",
            "",
            "gap=0",
        ),
        (
            "rack_pitch(one): sine=1e-5",
            "`rack_pitch` needs a period above zero",
            "add `period=…`",
            "sine=1e-5",
        ),
        (
            "backlash(one): gap=1e-5, gap=2e-5",
            "`gap` is given twice",
            "",
            "gap",
        ),
        (
            "cart_crosstalk(one): gain=1e-5",
            "`cart_crosstalk` acts at 2 places",
            "name the cart that moves and the one it follows: `(one, two)`",
            "one",
        ),
        (
            "cart_crosstalk(one, one): gain=1e-5",
            "a cart is not its own source",
            "",
            "one",
        ),
        (
            "tracker_scale(two): scale=1e-5",
            "`tracker_scale` acts on the tracker's target",
            "its place is `tcp`",
            "two",
        ),
        (
            "joint_placement(l2b): offset=1e-4",
            "`offset` has 3 components, found 1",
            "write `offset=(…, …, …)` in m",
            "1e-4",
        ),
        (
            "link_thermal(l2): expansion=1e-5",
            "`link_thermal` acts on a link, and `l2` is none",
            "expected one of `l1`, `l2a`, `l2b`, `l3a`, `l3b`, `l3c`",
            "l2",
        ),
        (
            "backlash",
            "expected an effect with its place and parameters",
            "write it as `rack_pitch(two): sine=8e-5, period=0.0133`",
            "backlash",
        ),
        (
            "backlash(one: gap=1e-5",
            "the parenthesis about the place is not closed",
            "write it as `rack_pitch(two): sine=8e-5, period=0.0133`",
            "backlash(one",
        ),
    ] {
        assert_eq!(
            mistake(text),
            (message.to_owned(), help.to_owned(), marked.to_owned()),
            "{text}"
        );
    }
}

proptest::proptest! {
    #[test]
    fn no_text_makes_the_parser_panic(text in "[a-z_(): =,.0-9é\\[\\]-]{0,40}", name in 0..14_usize) {
        let robot = drawings().0;
        let _ = Effect::parse(&text, &robot, "--effect");
        let listed = super::LISTED[name].split('(').next().unwrap();
        let _ = Effect::parse(&format!("{listed}({text}"), &robot, "--effect");
    }
}

fn refused(request: &Request) -> InputError {
    match request.simulation(&drawings().0) {
        Ok(_) => panic!("{request:?} was taken"),
        Err(error) => error,
    }
}

#[test]
fn all_mistakes_of_a_request_are_named_at_once() {
    let request = Request {
        variant: Some("Fulll".into()),
        effects: vec![
            "backlash(four): gap=1e-5".into(),
            "drift(tcp): rate=1".into(),
        ],
        noise_position_m: Some(-1.0),
        noise_drives: Some(0.0),
        outliers: 1.5,
        serial_noise: f64::NAN,
        grid: [usize::MAX, 2, 2],
        ..Request::default()
    };
    let error = refused(&request);
    let sources: Vec<&str> = error
        .problems()
        .iter()
        .map(|problem| problem.source.as_str())
        .collect();
    assert_eq!(
        sources,
        [
            "--noise-position",
            "--noise-drives",
            "--outliers",
            "--serial-noise",
            "--grid",
            "--effect",
            "--effect",
            "--variant"
        ]
    );
}

#[test]
fn a_robot_file_that_is_not_there_is_named() {
    let request = Request {
        robot: Some("nowhere/robot.toml".into()),
        ..Request::default()
    };
    assert!(refused(&request).to_string().contains("nowhere/robot.toml"));
}

#[test]
fn a_request_writes_what_it_says() {
    let parent = tempfile::tempdir().unwrap();
    let folder = parent.path().join("trial");
    let request = Request {
        effects: vec!["backlash(one): gap=4e-5".into()],
        grid: [2, 2, 2],
        track_points: 3,
        cart_poses: 4,
        outliers: 0.25,
        noise_position_m: Some(2e-5),
        payload_mass_kg: Some(60.0),
        ..Request::default()
    };
    let robot = drawings().0;
    let summary = request.run(&robot, &folder).unwrap();
    assert_eq!(summary.rows, [8, 9, 12]);
    assert_eq!(summary.effects, [("backlash".to_owned(), "one".to_owned())]);
    assert_eq!((summary.outliers, summary.out_of_reach), (2, 0));
    let read = tau::measurements::Folder::read(&folder, &(&robot).into()).unwrap();
    assert_eq!(read.tcp_poses.len(), 8);
    let file = tau::robot_file::RobotFile::read(&folder.join("robot.toml"), &robot).unwrap();
    assert_eq!(
        (file.noise.position_m, file.noise.rotation_rad),
        (2e-5, 4e-5)
    );
    assert_eq!(file.payload.unwrap().mass_kg, 60.0);
}

#[test]
fn a_grid_out_of_reach_is_refused() {
    let request = Request {
        grid_step_m: Some([50.0, 50.0, 50.0]),
        grid: [2, 2, 2],
        ..Request::default()
    };
    let simulation = request.simulation(&drawings().0).unwrap();
    let error = tau::simulation::simulate(&simulation)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("fewer than two poses are within reach"),
        "{error}"
    );
}

/// Reason for which a request is refused: option and message.
fn refusal(request: &Request) -> (String, String) {
    let error = refused(request);
    let problem = &error.problems()[0];
    (problem.source.clone(), problem.message.clone())
}

#[test]
fn what_no_folder_may_hold_is_refused_with_what_was_found() {
    let with = |change: fn(&mut Request)| {
        let mut request = Request::default();
        change(&mut request);
        refusal(&request)
    };
    for (found, option, message) in [
        (
            with(|r| r.temperature_c = 70.0),
            "--temperature",
            "found 70.0, expected a temperature between -49 and 59 °C",
        ),
        (
            with(|r| r.warming_k = 45.0),
            "--warming",
            "found 45.0, expected a rise of the temperature, in K, that ends between -49 and 59 °C",
        ),
        (
            with(|r| r.noise_position_m = Some(0.2)),
            "--noise-position",
            "found 0.2, expected a length above zero, in m, and at most 0.1",
        ),
        (
            with(|r| r.grid = [0, 2, 2]),
            "--grid",
            "found [0, 2, 2], expected three counts above zero, of together at most 100000 points",
        ),
    ] {
        assert_eq!(found, (option.to_owned(), message.to_owned()));
    }
}

#[test]
fn whatever_is_written_is_read_again() {
    let parent = tempfile::tempdir().unwrap();
    let robot = drawings().0;
    let extreme = Request {
        grid: [2, 2, 2],
        track_points: 3,
        cart_poses: 4,
        temperature_c: 59.0,
        noise_position_m: Some(0.1),
        noise_rotation_rad: Some(0.1),
        noise_scale: [1e-3; 3],
        ..Request::default()
    };
    let folder = parent.path().join("extreme");
    extreme.run(&robot, &folder).unwrap();
    tau::measurements::Folder::read(&folder, &(&robot).into()).unwrap();
    tau::robot_file::RobotFile::read(&folder.join("robot.toml"), &robot).unwrap();

    let folder = parent.path().join("scattered");
    let scattered = Request {
        noise_scale: [1e3; 3],
        ..extreme
    };
    let error = scattered.run(&robot, &folder).unwrap_err();
    assert!(error.to_string().contains("tcp_poses.csv"), "{error}");
    assert!(!folder.exists());
}

#[test]
fn an_effect_of_forces_needs_a_payload() {
    let (robot, mut file) = drawings();
    file.payload = None;
    for effect in [
        "cart_compliance(all): along_compliance=1e-7",
        "link_compliance(l1): strain=1e-8",
    ] {
        let simulation = tau::simulation::Simulation {
            effects: vec![super::parsed(effect, &robot)],
            ..tau::simulation::Simulation::new(robot.clone(), file.clone())
        };
        let error = tau::simulation::simulate(&simulation)
            .unwrap_err()
            .to_string();
        assert!(error.contains("found no `[payload]`"), "{error}");
    }
}

/// Heights need the noise of heights alone; poses, and carts beside them, a tracker.
#[test]
fn what_has_no_noise_is_not_measured() {
    let parent = tempfile::tempdir().unwrap();
    let robot = tau::Robot::from(&tau_generated::linear_delta::ROBOT);
    let file = parent.path().join("delta.toml");
    let text = "robot = \"LinearDelta\"\n[noise]\nheights = { height_m = 1e-5 }\n";
    std::fs::write(&file, text).unwrap();
    let of_heights = Request {
        robot: Some(file),
        measures: vec!["heights".to_owned()],
        poses: Some(20),
        random: true,
        ..Request::default()
    };
    let folder = parent.path().join("measured");
    of_heights.run(&robot, &folder).unwrap();
    let read = tau::measurements::Folder::read(&folder, &(&robot).into()).unwrap();
    let rows = [
        read.plate_rows.len(),
        read.tcp_poses.len(),
        read.cart_poses.len(),
    ];
    assert_eq!(rows, [20, 0, 0]);
    let of_poses = Request {
        measures: vec!["heights".to_owned(), "poses".to_owned()],
        ..of_heights
    };
    let error = of_poses.simulation(&robot).err().unwrap().to_string();
    assert!(
        error.contains("--noise-position") && error.contains("has no `position_m`"),
        "{error}"
    );
}

/// Without a variant the machine is one of the ordinary variant: what `Full` holds is as in the description, all else is drawn,
/// and a search finds nothing missing. These seeds, with the scale drawn, had a `tracker_scale` named.
#[test]
fn without_a_variant_the_machine_is_that_of_the_ordinary_one() {
    for (model, seed) in [("linear_delta", 1), ("four_belts", 3)] {
        let work = tempfile::tempdir().unwrap();
        let simulated = |folder: &str, variant: &str| {
            let line = format!(
                "tau simulate --model {model} {variant} --poses 40 --random --seed {seed} --out DIR/{folder}"
            );
            tau_in(work.path(), &line).done();
            let read =
                |file: &str| fs::read_to_string(work.path().join(folder).join(file)).unwrap();
            let truth: Value = serde_json::from_str(&read("truth.json")).unwrap();
            (truth["parameters"].clone(), read("tcp_poses.csv"))
        };
        let plain = simulated("plain", "");
        // As a condition, since folders are long to print.
        assert!(plain == simulated("full", "--variant Full"), "{model}");
        let free = simulated("free", "--variant Scaled").0;
        let names = plain.0.as_object().unwrap().keys();
        let held: Vec<&String> = names.filter(|name| plain.0[*name] != free[*name]).collect();
        assert_eq!(held, ["scale"], "{model}");
        assert_eq!(
            (&plain.0["scale"], &free["scale"] == 0.0),
            (&0.0.into(), false)
        );

        let line = format!("tau discover DIR/plain --model {model} --out DIR/out --json -");
        let found = tau_in(work.path(), &line).json();
        assert_eq!(
            found["status"], "nothing_missing",
            "{model}: {}",
            found["effects"]
        );
    }
}

/// A tracker's errors are in positions as they are in poses, by the formulas of `docs/language.md`; where it measures
/// nothing, that is said.
#[test]
fn errors_of_a_tracker_are_in_positions() {
    let rate = [1e-7, -2e-7, 3e-7];
    let texts = [
        "tracker_drift(tcp): rate=(1e-7,-2e-7,3e-7)",
        "tracker_scale(tcp): scale=2e-4",
    ];
    let simulated = |effects: &[&str], kind: PlateKind| {
        let mut simulation = with_effects(effects);
        simulation.measures = vec![Measure::Rows(kind)];
        let target = |x: f64| tau::robot_file::Value {
            value: vec![x, 0.1, -0.2],
            tol: 0.0,
            sigma: None,
        };
        simulation.file.measuring.targets =
            [("left".into(), target(0.3)), ("right".into(), target(-0.3))].into();
        run(&simulation)
    };
    let plain = simulated(&[], PlateKind::Position).folder.plate_rows;
    let errs = simulated(&texts, PlateKind::Position).folder.plate_rows;
    assert_eq!((plain.len(), errs.len()), (36, 36));
    for (plain, errs) in plain.iter().zip(&errs) {
        let time_s = plain.conditions.time_s.unwrap();
        for (axis, rate) in rate.iter().enumerate() {
            let (truly, seen) = (plain.values[axis].unwrap(), errs.values[axis].unwrap());
            let expected = truly + rate * time_s + 2e-4 * truly / (1.0 - 2e-4);
            assert!((seen - expected).abs() < 1e-12, "{seen} {expected}");
        }
    }
    let says = |kind: PlateKind| {
        let remarks = simulated(&texts, kind).truth.remarks;
        let remarks: Vec<&str> = remarks.iter().map(|remark| remark.text.as_str()).collect();
        remarks.join("\n")
    };
    assert_eq!(says(PlateKind::Position), "");
    let heights = says(PlateKind::Height);
    for effect in ["tracker_drift", "tracker_scale"] {
        let expected = format!("`{effect}` does nothing: no tracker measures");
        assert!(heights.contains(&expected), "{heights}");
    }
}

/// The other way round, a pair is the same.
#[test]
fn no_distance_is_measured_twice() {
    let (robot, file) = drawings();
    for (count, seed) in (2..8).flat_map(|count| (1..=10).map(move |seed| (count, seed))) {
        let simulation = Simulation {
            poses: Poses::Random { count },
            measures: vec![Measure::Distances],
            track_points: TrackPoints {
                count: 0,
                ..TrackPoints::default()
            },
            random_poses: 0,
            seed,
            ..Simulation::new(robot.clone(), file.clone())
        };
        let distances = run(&simulation).folder.distances;
        let pairs = distances.iter().map(|distance| {
            let [one, other] = distance.poses;
            [one.min(other), one.max(other)]
        });
        let distinct: BTreeSet<[u32; 2]> = pairs.collect();
        assert_eq!(distinct.len(), distances.len(), "{count} poses, {seed}");
        assert!(distances.len() >= count / 2, "{count} poses, {seed}");
    }
}
