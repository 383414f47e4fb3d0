//! Arguments of `tau simulate`: what is written for them, and what is wrong with them.

use proptest::prelude::*;
use tau::measurements::Folder;
use tau::robot_file::RobotFile;
use tau::simulation::Effect;
use tau_testkit::{Work, robots};

proptest! {
    #![proptest_config(ProptestConfig { cases: 64, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn no_text_of_an_effect_makes_the_parser_panic(
        text in "[a-z_(): =,.0-9é\\[\\]-]{0,40}",
        name in prop::sample::select(&["rack_pitch", "cart_crosstalk", "tracker_drift", "link_thermal"][..]),
    ) {
        let robot = robots::gantry_tau();
        for text in [&text, &format!("{name}({text}")] {
            let _ = Effect::parse(text, &robot, "--effect");
        }
    }
}

#[test]
fn all_mistakes_are_named_at_once_and_nothing_is_written() {
    let work = Work::empty();
    let bare = std::fs::read_to_string(format!("{}/robot.toml", tau_testkit::PROTOTYPE)).unwrap();
    let (before, after) = bare.split_once("[payload]").unwrap();
    let after = after.split_once("\n[").map_or("", |(_, rest)| rest);
    work.write("bare.toml", format!("{before}[{after}"));
    let heights = "robot = \"LinearDelta\"\n[noise]\nheights = { height_m = 1e-5 }\n";
    work.write("delta.toml", heights);
    let mut words = String::new();
    for (arguments, expected) in [
        (
            "--variant Fulll --effect backlash(four):gap=1e-5 --effect drift(tcp):rate=1 --noise-position=-1 \
             --noise-drives 0 --outliers 1.5 --serial-noise NaN --grid 18446744073709551615,2,2",
            &[
                ("T261", "--noise-position", 0),
                ("T261", "--noise-drives", 0),
                ("T261", "--outliers", 0),
                ("T261", "--serial-noise", 0),
                ("T261", "--grid", 0),
                ("T292", "--effect", 1),
                ("T291", "--effect", 1),
                ("T263", "--variant", 0),
            ][..],
        ),
        (
            "--effect backlash --effect backlash(one):gap=0 --effect backlash(one):gap=40um",
            &[
                ("T290", "--effect", 1),
                ("T293", "--effect", 1),
                ("T217", "--effect", 1),
            ],
        ),
        ("--robot DIR/nowhere.toml", &[("T201", "nowhere.toml", 0)]),
        // What no folder may hold.
        ("--temperature 70", &[("T261", "--temperature", 0)]),
        ("--warming 45", &[("T261", "--warming", 0)]),
        ("--noise-position 0.2", &[("T261", "--noise-position", 0)]),
        ("--grid 0,2,2", &[("T261", "--grid", 0)]),
        ("--grid 2,2,2 --grid-step 50,50,50", &[("T532", "poses", 0)]),
        // Forces need a payload or a link that is pulled, and tensions a link that a drive lengthens.
        (
            "--robot DIR/bare.toml --effect link_compliance(l1):strain=1e-8",
            &[("T295", "bare.toml", 0)],
        ),
        (
            "--robot DIR/bare.toml --effect cart_compliance(all):along_compliance=1e-7",
            &[("T295", "bare.toml", 0)],
        ),
        ("--noise-force 1", &[("T262", "--noise-force", 0)]),
        (
            "--noise-force 1 --model hexapod",
            &[("T295", "--noise-force", 0)],
        ),
        // Heights need the noise of heights alone, poses a tracker.
        (
            "--robot DIR/delta.toml --measure heights,poses",
            &[("T347", "--noise-position", 0)],
        ),
        // No cart, no plate joints, and a belt whose tension is known.
        (
            "--model five_bar --effect track_thermal(left):shift=1e-6",
            &[("T292", "--effect", 1)],
        ),
        (
            "--model four_lines --effect joint_placement(a):offset=(1e-3,0,0)",
            &[("T292", "--effect", 1)],
        ),
        (
            "--model four_belts --effect pull_strain(top_left):strain=3e-6",
            &[("T292", "--effect", 1)],
        ),
    ] {
        let ran = work.run(&format!("simulate {arguments} --out MEASURED"));
        ran.refused(expected);
        assert!(!work.measured().exists(), "{arguments}");
        words += &format!("$ tau simulate {arguments}\n{}\n", ran.err);
    }
    insta::assert_snapshot!(words);
}

#[test]
fn a_request_writes_what_it_says() {
    let work = Work::empty();
    let arguments = "--effect backlash(one):gap=4e-5 --grid 2,2,2 --track-points 3 --cart-poses 4 --outliers 0.25 \
                     --noise-position 2e-5 --payload 60";
    let said = work.json(&format!("simulate {arguments} --out MEASURED"));
    let counts = ["tcp_poses", "cart_poses", "cart_positions"].map(|file| &said["rows"][file]);
    assert_eq!(counts, [8, 9, 12]);
    let effect = &said["effects"][0];
    assert_eq!([&effect["name"], &effect["place"]], ["backlash", "one"]);
    assert_eq!([&said["outliers"], &said["out_of_reach"]], [2, 0]);
    let robot = robots::gantry_tau();
    let read = Folder::read(&work.measured(), &(&robot).into()).unwrap();
    assert_eq!(read.tcp_poses.len(), 8);
    let file = RobotFile::read(&work.measured().join("robot.toml"), &robot).unwrap();
    assert_eq!(
        (file.noise.position_m, file.noise.rotation_rad),
        (2e-5, 4e-5)
    );
    assert_eq!(file.payload.unwrap().mass_kg, 60.0);
}

#[test]
fn whatever_is_written_is_read_again() {
    let extreme = "--grid 2,2,2 --track-points 3 --cart-poses 4 --temperature 59 --noise-position 0.1 \
                   --noise-rotation 0.1 --noise-scale 1e-3,1e-3,1e-3";
    let work = Work::simulated(extreme);
    let robot = robots::gantry_tau();
    Folder::read(&work.measured(), &(&robot).into()).unwrap();
    RobotFile::read(&work.measured().join("robot.toml"), &robot).unwrap();
    // Farther scattered, it would be refused.
    let work = Work::empty();
    let far = "simulate --grid 2,2,2 --noise-position 0.1 --noise-scale 1e3,1e3,1e3 --out MEASURED";
    assert!(work.run(far).says("T221"));
    assert!(!work.measured().exists());
}

/// Carts beside the plate need a tracker.
#[test]
fn what_has_no_noise_is_not_measured() {
    let heights = "robot = \"LinearDelta\"\n[noise]\nheights = { height_m = 1e-5 }\n";
    let work = Work::simulated_with(
        heights,
        "--robot DIR/robot.toml --measure heights --poses 20 --random",
    );
    assert_eq!(work.table("measured/heights.csv").rows.len(), 20);
    assert_eq!(
        work.listing("measured"),
        ["heights.csv", "robot.toml", "truth.json"]
    );
}
