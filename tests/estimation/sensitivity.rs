//! Table III of the paper, from its own Table II at the prototype's poses.

use tau::Setup;
use tau::calibration::{Options, calibrate, machine_from_file};
use tau::measurements::{Poses, Split};
use tau::sensitivity::{PAPER_STEP, analyse};
use tau_testkit::{Table, Work, number, robots};

/// Its poses were never published: those of the prototype fill the same workspace.
#[test]
fn table_iii_is_the_papers() {
    let printed = Table::parse(include_str!(
        "../equations/reference/table3_sensitivity.csv"
    ));
    let robot = robots::gantry_tau();
    let (folder, file) = robots::prototype();
    let poses = Poses::select(&robot, &file, &folder, Split::Alternate).unwrap();
    let full = robot.variant("Full").unwrap();
    let machine = machine_from_file(&robot, full, &robots::paper_file(), None, &[]).unwrap();
    let sensitivity = analyse(&machine, &folder, &poses.division.validation, PAPER_STEP).unwrap();
    assert_eq!(sensitivity.poses, 60);
    let mut deviations = Vec::new();
    for link in &sensitivity.links {
        let rows = link.parameters.iter();
        for row in rows.filter(|row| !row.parameter.starts_with("Orient")) {
            // Printed in mm and in rad.
            let mut deviation = |quantity: &str, found: f64| {
                let mut rows = printed.rows.iter();
                let row = rows.position(|own| own[0] == quantity && own[1] == row.parameter);
                let expected = printed.number(row.unwrap() + 1, &link.link);
                deviations.push((found / expected - 1.0).abs());
            };
            deviation("position", row.position_mm);
            // Link 1 decides where the plate is along its track, not how it is turned.
            if link.link == "l1" {
                assert!(row.orientation_rad < 1e-4);
            } else {
                deviation("orientation", row.orientation_rad);
            }
        }
    }
    deviations.sort_by(f64::total_cmp);
    assert_eq!(deviations.len(), 6 * 7 + 5 * 7);
    assert!(deviations[38] <= 0.10, "median {}", deviations[38]);
    assert!(deviations[76] <= 0.30, "largest {}", deviations[76]);

    // A step of a length changes every closure by 2·L·step: twice (2·L·step)² over the poses, once the
    // calibrated residuals are small beside it.
    let lengthened = 2.0 * 2.04422 * PAPER_STEP;
    let expected = 2.0 * 60.0 * lengthened * lengthened;
    let row = &sensitivity.links[0].parameters[0];
    assert_eq!(row.parameter, "L");
    assert!(row.cost_m4 >= 0.99 * expected, "{} {expected}", row.cost_m4);
}

#[test]
fn steps_and_implicit_differentiation_agree_in_every_variant() {
    let robot = robots::gantry_tau();
    let (folder, file) = robots::prototype();
    let poses = Poses::select(&robot, &file, &folder, Split::Alternate).unwrap();
    let few = &poses.division.validation[..10];
    for variant in robot.variants.iter().filter(|own| own.effects.is_empty()) {
        let setup = Setup::new(&robot, variant, &file, &folder);
        let found = calibrate(setup, &poses.division.calibration, &Options::default()).unwrap();
        let sensitivity = analyse(&found.machine, &folder, few, PAPER_STEP).unwrap();
        let disagreement = sensitivity.disagreement;
        assert!(disagreement < 1e-5, "{}: {disagreement}", variant.name);
        let is_reduced = ["Nominal", "Piecewise"].contains(&variant.name.as_str());
        for link in &sensitivity.links {
            assert_eq!(link.parameters.len(), if is_reduced { 7 } else { 10 });
            for row in &link.parameters {
                assert!(row.position_mm > 0.0 && row.by_pose_um.len() == 10);
            }
        }
    }
}

/// On level plates Euler angles are singular: errors are of the size of the noise, and the two ways of Table III agree.
#[test]
fn level_plates_have_orientation_errors_of_the_size_of_the_noise() {
    let with = "--model hexapod --variant Full";
    let work = Work::simulated("--model hexapod --variant Full --exact --random --poses 60");
    let found = work.json(&format!("evaluate MEASURED {with}"));
    for axis in 0..3 {
        let largest = number(&found["orientation_rad"]["max_abs"][axis]);
        // Of at most 60 draws of 40 µrad, with what 10 µm of the joints' positions turn a small plate by.
        assert!((1e-5..4e-4).contains(&largest), "{largest}");
    }
    let found = work.json(&format!("sensitivity MEASURED {with}"));
    let disagreement = number(&found["disagreement"]);
    assert!(disagreement < 1e-3, "{disagreement}");
    assert_eq!(found["orientation_as"], "rotation_vector");
    let found = work.json("sensitivity --variant Full");
    assert_eq!(found["orientation_as"], "zyz_angles");
}

/// Links of a crank have no direction of a track, and a plate in its plane moves along no z, but by the square of a step.
#[test]
fn links_of_unlike_parameters_stand_in_one_table() {
    let work = Work::simulated("--model ROBOTS/two_cranks_rail.tau --seed 1 --random --poses 20");
    let line = "sensitivity MEASURED --model ROBOTS/two_cranks_rail.tau --variant Full";
    let said = work.run(line).done();
    let mut lines = said
        .lines()
        .map(|line| line.split_whitespace().collect::<Vec<_>>());
    let heading = lines.find(|line| line.first() == Some(&"Link")).unwrap();
    let names = ["L", "Px", "Py", "Pz", "Cx", "Cy", "Cz", "O1", "O2", "O3"];
    assert_eq!(heading[1..], names);
    let rows: Vec<Vec<&str>> = lines.skip(1).take(3).collect();
    assert!(
        rows.iter().all(|row| row.len() == heading.len()),
        "{rows:?}"
    );
    let of = |link: &str| rows.iter().find(|row| row[0] == link).unwrap();
    assert_eq!(of("l")[5..], ["–"; 6]);
    assert!(of("t")[8..].iter().all(|cell| *cell != "–"));
    assert_eq!([of("t")[4], of("t")[7], of("t")[10]], ["0.00"; 3]);
}
