//! Discovery on measurements in which effects are hidden. What was hidden is read by the test alone.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde_json::Value;
use tau::Robot;
use tau::discovery::results::Place;
use tau::discovery::{Discovery, Options, Status, discover};
use tau::measurements::{Folder, Shape};
use tau::robot_file::RobotFile;
use tau::simulation::{Effect, Simulation, simulate};

use crate::support::{gantry_tau, prototype};

fn trial(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../data/trials")
        .join(name)
}

fn discovered(folder: &Path) -> Discovery {
    let robot = gantry_tau();
    let measured = Folder::read(folder, &Shape::from(&robot)).unwrap();
    let file = RobotFile::read(&folder.join("robot.toml"), &robot).unwrap();
    let options = Options::default();
    discover(&robot, "Full", &file, &measured, &options, &mut |_| {})
        .unwrap()
        .discovery
}

/// Names with places, sorted, of what was found and of what was hidden; the verdict and those allowed.
fn check(name: &str) {
    let folder = trial(name);
    let found = discovered(&folder);
    let truth = std::fs::read_to_string(folder.join("truth.json")).unwrap();
    let truth: Value = serde_json::from_str(&truth).unwrap();
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let hidden: BTreeSet<(String, String)> = truth["effects"]
        .as_array()
        .unwrap()
        .iter()
        .map(|effect| (text(&effect["name"]), text(&effect["place"])))
        .collect();
    let named: BTreeSet<(String, String)> = found
        .effects
        .iter()
        .map(|effect| (effect.name.clone(), effect.place.to_string()))
        .collect();
    assert_eq!(named, hidden, "trial {name}");
    let status = serde_json::to_value(found.status).unwrap();
    assert!(
        truth["status"].as_array().unwrap().contains(&status),
        "trial {name}: {status}"
    );
}

macro_rules! trials {
    ($($test:ident = $name:literal;)*) => {
        $(
            #[test]
            fn $test() {
                check($name);
            }
        )*
    };
}

trials! {
    nothing_is_found_where_nothing_is = "01";
    a_rack_is_found = "02";
    backlash_is_found = "03";
    a_yielding_cart_is_found = "04";
    angular_motion_is_found = "05";
    thermal_expansion_of_links_is_found = "06";
    drift_of_the_tracker_is_found = "07";
    crooked_guideways_are_found = "08";
    two_effects_are_found = "09";
    outliers_are_no_effect = "10";
    what_no_catalogue_lists_gets_no_name = "11";
}

/// Structure without a name may have a place in the model: the points of the track through which the cart goes.
#[test]
fn a_track_with_a_bump_follows_its_points_without_a_name() {
    for (base, effects) in [("Full", vec![]), ("Nominal", vec!["full_arm(all)"])] {
        let found = from_base("11", base, &[1, 2, 3]);
        assert_eq!(names(&found), effects, "{base}");
        let two = Place::Cart("two".to_owned());
        let places: Vec<&Place> = found.piecewise_tracks.iter().map(|t| &t.place).collect();
        assert_eq!(places, [&two], "{base}");
        assert!(!found.unnamed.is_empty(), "{base}");
        assert!(found.unnamed.iter().all(|unnamed| unnamed.place == two));
        assert_eq!(found.base, base);
        assert_eq!(
            found.steps[0].model.to_string(),
            format!("variant Discovered = {base};")
        );
        let gaps: Vec<f64> = found.steps.iter().map(|step| step.gap.mean_um).collect();
        assert!(
            gaps.windows(2).all(|pair| pair[1] < pair[0]),
            "{base}: {gaps:?}"
        );
        assert!(
            found.validation.after.mean_um < 1.2 * found.noise_floor_um,
            "{base}"
        );
    }
}

/// The search on some sets of a trial, from a base.
fn from_base(name: &str, base: &str, sets: &[u8]) -> Discovery {
    let robot = gantry_tau();
    let folder = trial(name);
    let mut measured = Folder::read(&folder, &Shape::from(&robot)).unwrap();
    let file = RobotFile::read(&folder.join("robot.toml"), &robot).unwrap();
    if !sets.contains(&2) {
        measured.cart_poses.clear();
    }
    if !sets.contains(&3) {
        measured.cart_positions.clear();
    }
    let options = Options::default();
    discover(&robot, base, &file, &measured, &options, &mut |_| {})
        .unwrap()
        .discovery
}

/// The joints of these robots lie off the Tau configuration, so a reduced arm lacks the full one first.
#[test]
fn a_reduced_arm_lacks_the_full_one() {
    let found = from_base("02", "Nominal", &[1, 2, 3]);
    let names: Vec<&str> = found.effects.iter().map(|e| e.name.as_str()).collect();
    assert_eq!(names, ["full_arm", "rack_pitch"]);
    assert_eq!(found.base, "Nominal");
    let first = found.steps[0].model.to_string();
    assert_eq!(first, "variant Discovered = Nominal;");
    let gaps: Vec<f64> = found.steps.iter().map(|step| step.gap.mean_um).collect();
    assert!(gaps.windows(2).all(|pair| pair[1] < pair[0]), "{gaps:?}");
    assert!((gaps[2] - found.validation.after.mean_um).abs() < 1e-9);
    // Removed and remaining errors add up to those that any method could remove.
    let removed = found.validation.before.rms_um.hypot(found.remaining_um);
    let removable = (removed.powi(2) - found.validation.after.rms_um.powi(2)).sqrt();
    assert!(
        (found.ceiling_um / removable - 1.0).abs() < 0.02,
        "{removable}"
    );
}

/// A stretch of links needs a full arm. Beside a reduced one it stays without a name, with the advice that leads to it.
#[test]
fn what_needs_a_full_arm_is_found_from_the_variant_that_is_advised() {
    let (robot, file) = (gantry_tau(), prototype().1);
    let text = "link_compliance(l1): strain=1e-6";
    let simulated = simulate(&Simulation {
        variant: Some("Nominal".to_owned()),
        effects: vec![Effect::parse(text, &robot, "test").unwrap()],
        ..Simulation::new(robot.clone(), file)
    })
    .unwrap();
    let found = |base: &str| {
        let (file, folder) = (&simulated.file, &simulated.folder);
        let options = Options::default();
        let found = discover(&robot, base, file, folder, &options, &mut |_| {});
        found.unwrap().discovery
    };
    let from_reduced = found("Nominal");
    assert_eq!(from_reduced.status, Status::UnnamedStructure);
    let advice = "search from a variant that has one, such as `Full`";
    let mut remarks = from_reduced.remarks.iter();
    assert!(remarks.any(|remark| remark.text.contains(advice)));
    assert_eq!(names(&found("Full")), ["link_compliance(l1)"]);
}

/// If nothing is hidden, points that carry noise get no name, nor do carts that turn as they go; and the
/// residuals are as large as the stated noise says.
#[test]
fn the_noise_of_measured_points_gets_no_name() {
    for (base, expected) in [
        ("BestPerLink", vec![]),
        ("Piecewise", vec!["full_arm(all)"]),
    ] {
        let found = from_base("01", base, &[1, 2, 3]);
        assert_eq!(names(&found), expected, "{base}");
        assert!(found.unnamed.is_empty(), "{base}");
        for noise in &found.noise {
            assert!((noise.factor - 1.0).abs() < 0.1, "{base}: {noise:?}");
        }
    }
}

/// A held-out stretch of a measured path, which other blocks hardly determine, does not hide what they tell of an
/// effect.
#[test]
fn an_effect_is_confirmed_beside_measured_points() {
    let found = from_base("03", "BestPerLink", &[1, 2, 3]);
    assert_eq!(names(&found), ["backlash(one)"]);
    assert_eq!(found.status, Status::Explained);
    assert!(found.validation.after.mean_um < 20.0);
}

/// Poses that lie off in one stretch of a track are no mistakes of the measurement.
#[test]
fn what_is_local_is_not_taken_for_outliers() {
    for sets in [&[1][..], &[1, 2]] {
        let found = from_base("11", "Full", sets);
        let status = serde_json::to_value(found.status).unwrap();
        assert!(
            ["unnamed_structure", "partly_explained"].contains(&status.as_str().unwrap()),
            "{sets:?}: {status}"
        );
    }
}

/// Measurements of a trial.
fn measured(name: &str) -> (Folder, RobotFile) {
    let (robot, folder) = (gantry_tau(), trial(name));
    (
        Folder::read(&folder, &Shape::from(&robot)).unwrap(),
        RobotFile::read(&folder.join("robot.toml"), &robot).unwrap(),
    )
}

fn names(found: &Discovery) -> Vec<String> {
    let mut names: Vec<String> = found
        .effects
        .iter()
        .map(|effect| format!("{}({})", effect.name, effect.place))
        .collect();
    names.sort();
    names
}

fn search(folder: &Folder, file: &RobotFile, options: &Options) -> Discovery {
    let robot = gantry_tau();
    discover(&robot, "Full", file, folder, options, &mut |_| {})
        .unwrap()
        .discovery
}

/// The five effects hidden in the prototype, and the gap on poses that took no part.
#[test]
fn the_prototypes_error_falls_to_its_noise() {
    let (folder, file) = prototype();
    let robot = gantry_tau();
    let options = Options::default();
    let outcome = discover(&robot, "Full", &file, &folder, &options, &mut |_| {}).unwrap();
    let found = &outcome.discovery;
    let expected = [
        "cart_compliance(two)",
        "pinion_eccentricity(two)",
        "rack_pitch(one)",
        "rack_pitch(three)",
        "rack_pitch(two)",
    ];
    assert_eq!(names(found), expected);
    let (before, after) = (found.validation.before, found.validation.after);
    assert!(before.mean_um > 100.0, "{before:?}");
    assert!(after.mean_um < 20.0, "{after:?}");
    assert!((after.mean_um / found.noise_floor_um - 1.0).abs() < 0.25);
    assert_eq!(found.steps.len(), 6);
    assert!(
        found
            .steps
            .windows(2)
            .all(|pair| pair[1].gap.mean_um < pair[0].gap.mean_um)
    );

    // The result is a robot like any other, with the values that are reported.
    let written = outcome.robot();
    let calibrated = outcome.calibration(&written, &file, &folder).unwrap();
    for effect in &found.effects {
        for (name, reported) in &effect.parameters {
            let name = format!("{}({}).{name}", effect.name, effect.place);
            let mut parameters = calibrated.parameters.iter();
            let written = parameters.find(|own| own.name == name);
            let written = written.unwrap_or_else(|| panic!("no parameter {name}"));
            assert_eq!(written.value, reported.value, "{name}");
            assert!(
                (written.sigma / reported.sigma - 1.0).abs() < 1e-9,
                "{name}"
            );
        }
    }
    let shape = Shape::from(&written);
    let poses = folder.divide(options.split, &folder.in_range(&file, &shape));
    let errors =
        tau::evaluation::evaluate(&calibrated.machine, &folder, &poses.validation).unwrap();
    assert!(errors.position_um.mean < 22.0, "{:?}", errors.position_um);
}

/// A second harmonic joins the rack's pitch error where there is one, and only there.
#[test]
fn a_second_harmonic_earns_its_place() {
    let (robot, file) = (gantry_tau(), prototype().1);
    for second in [0.0, 1.5e-5] {
        let text = format!(
            "rack_pitch(two): sine=2.5e-5, cosine=1e-5, period=0.02, second_sine={second:e}"
        );
        let simulated = simulate(&Simulation {
            effects: vec![Effect::parse(&text, &robot, "test").unwrap()],
            seed: 4,
            ..Simulation::new(robot.clone(), file.clone())
        })
        .unwrap();
        let found = search(&simulated.folder, &file, &Options::default());
        assert_eq!(names(&found), ["rack_pitch(two)"]);
        assert_eq!(found.status, Status::Explained);
        let line = "variant Discovered = Full + rack_pitch(two)";
        let parameters = &found.effects[0].parameters;
        if second == 0.0 {
            assert!(found.model_text.contains(&format!("{line} tol * 10;")));
            assert_eq!(parameters.len(), 3);
            continue;
        }
        assert!(
            found
                .model_text
                .contains(&format!("{line} with second_sine, second_cosine tol * 10;"))
        );
        for (name, hidden) in [
            ("sine", 2.5e-5),
            ("cosine", 1e-5),
            ("second_sine", second),
            ("second_cosine", 0.0),
            ("period", 0.02),
        ] {
            let estimate = &parameters[name];
            let off = (estimate.value - hidden).abs() / estimate.sigma;
            assert!(off < 4.0, "{name}: {off} standard deviations");
        }
        let written = Robot::from_text(&found.model_text).unwrap();
        let variant = written.variant("Discovered").unwrap();
        let is_second = |p: &&tau::robot::Parameter| p.quantity.starts_with("second_");
        assert_eq!(variant.parameters.iter().filter(is_second).count(), 2);
    }
}

/// Gross errors were put into three poses of trial 10.
#[test]
fn outliers_are_listed_by_their_number() {
    let found = discovered(&trial("10"));
    assert_eq!(found.outliers, [33, 91, 125]);
    assert!(found.left_out.iter().all(|out| out.set == 1));
}

/// More poses than a search takes: an evenly spread part of them shows the same.
#[test]
fn a_part_of_many_poses_is_searched() {
    let (folder, file) = measured("03");
    let mut options = Options::default();
    options.constants.most_poses = 50.0;
    let robot = gantry_tau();
    let found = discover(&robot, "Full", &file, &folder, &options, &mut |_| {}).unwrap();
    assert_eq!(names(&found.discovery), ["backlash(one)"]);
    assert_eq!(found.poses.len(), 50);
    let of_all = "of 61 poses that calibrate 50";
    let remarks = &found.discovery.remarks;
    assert!(
        remarks.iter().any(|remark| remark.text.starts_with(of_all)),
        "{remarks:?}"
    );
}

#[test]
fn sets_that_are_missing_are_missed_in_words() {
    let (mut folder, file) = measured("06");
    folder.cart_poses.clear();
    folder.cart_positions.clear();
    let found = search(&folder, &file, &Options::default());
    assert_eq!(names(&found), ["link_thermal(all)"]);
    for set in ["set 2", "set 3"] {
        assert!(
            found
                .remarks
                .iter()
                .any(|remark| remark.text.starts_with(set))
        );
    }
}

/// An effect that no catalogue lists, in a user's own words, on equal terms with those that ship.
#[test]
fn a_users_own_effect_is_found_and_written_down() {
    const OWN: &str = "/// The cart rests on the flank that its last move left it on.\n\
        effect lost_motion on cart { param width: length tol 0.1 mm; along += width * direction / 2; }";
    let (folder, file) = measured("03");
    let others = tau::effects::CATALOGUE.replace("effect backlash", "effect lost_motion");
    let options = Options {
        catalogues: vec![OWN.to_owned(), others],
        ..Options::default()
    };
    let found = search(&folder, &file, &options);
    assert_eq!(names(&found), ["lost_motion(one)"]);
    assert!((found.effects[0].parameters["width"].value - 119e-6).abs() < 5e-6);
    let text = &found.model_text;
    assert!(text.contains("the flank that its last move"), "{text}");
    assert!(
        text.contains("variant Discovered = Full + lost_motion(one) tol * 10;"),
        "{text}"
    );
    tau_codegen::language::check_text(text).unwrap();
}

/// With the true effect withheld nothing else takes its name.
#[test]
fn a_withheld_effect_stays_without_a_name() {
    let (folder, file) = measured("03");
    let start = tau::effects::CATALOGUE.find("/// Reversal error").unwrap();
    let end = tau::effects::CATALOGUE[start..].find("}\n").unwrap() + start + 2;
    let without = [
        &tau::effects::CATALOGUE[..start],
        &tau::effects::CATALOGUE[end..],
    ]
    .concat();
    let options = Options {
        catalogues: vec![without],
        ..Options::default()
    };
    let found = search(&folder, &file, &options);
    assert_eq!(names(&found), Vec::<String>::new());
    let unnamed = &found.unnamed[0];
    let described = format!(
        "{} {} {}",
        unnamed.place, unnamed.direction, unnamed.against.name
    );
    assert_eq!(described, "one along direction");
    // Half of the gap of 119 µm on either side.
    assert!((unnamed.rms_um - 59.5).abs() < 5.0, "{}", unnamed.rms_um);
}

#[test]
fn carts_numbered_wrongly_are_recognised() {
    let (mut folder, file) = measured("01");
    for pose in &mut folder.cart_poses {
        pose.track = [1, 0, 2][pose.track];
    }
    let robot = gantry_tau();
    let options = Options::default();
    let error = discover(&robot, "Full", &file, &folder, &options, &mut |_| {}).unwrap_err();
    let message = error.to_string();
    assert!(message.contains("cart_poses.csv"), "{message}");
    assert!(
        message.contains("cart 2 on `one`, cart 1 on `two`"),
        "{message}"
    );
}
