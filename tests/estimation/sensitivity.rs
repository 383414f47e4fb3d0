//! Table III of the paper, from its own Table II at the prototype's poses.

use tau::calibration::{Options, calibrate, machine_from_file};
use tau::measurements::{Poses, Split};
use tau::sensitivity::Sensitivity;
use tau::sensitivity::{PAPER_STEP, analyse};

use crate::support::{gantry_tau, number, paper_file, prototype, tau_in};
use tau::Setup;

/// Printed value of a quantity (`position` in mm, `orientation` in rad) for a parameter and a link.
fn printed(quantity: &str, parameter: &str, link: &str) -> f64 {
    let mut lines = include_str!("../equations/reference/table3_sensitivity.csv").lines();
    let header: Vec<&str> = lines.next().unwrap().split(',').collect();
    let column = header.iter().position(|name| *name == link).unwrap();
    lines
        .map(|line| line.split(',').collect::<Vec<_>>())
        .find(|row| row[0] == quantity && row[1] == parameter)
        .and_then(|row| row[column].parse().ok())
        .unwrap()
}

fn paper_sensitivity() -> Sensitivity {
    let robot = gantry_tau();
    let (folder, file) = prototype();
    let poses = Poses::select(&robot, &file, &folder, Split::Alternate).unwrap();
    let full = robot.variant("Full").unwrap();
    let machine = machine_from_file(&robot, full, &paper_file(), None, &[]).unwrap();
    analyse(&machine, &folder, &poses.division.validation, PAPER_STEP).unwrap()
}

#[test]
fn table_iii_is_the_papers() {
    // Its poses were never published: those of the prototype fill the same workspace.
    let sensitivity = paper_sensitivity();
    assert_eq!(sensitivity.poses, 60);
    let mut deviations = Vec::new();
    for link in &sensitivity.links {
        let rows = link
            .parameters
            .iter()
            .filter(|row| !row.parameter.starts_with("Orient"));
        for row in rows {
            let deviation = |quantity: &str, found: f64| {
                (found / printed(quantity, &row.parameter, &link.link) - 1.0).abs()
            };
            deviations.push(deviation("position", row.position_mm));
            // Link 1 decides where the plate is along its track, not how it is turned.
            if link.link == "l1" {
                assert!(row.orientation_rad < 1e-4);
            } else {
                deviations.push(deviation("orientation", row.orientation_rad));
            }
        }
    }
    deviations.sort_by(f64::total_cmp);
    assert_eq!(deviations.len(), 6 * 7 + 5 * 7);
    assert!(deviations[38] <= 0.10, "median {}", deviations[38]);
    assert!(deviations[76] <= 0.30, "largest {}", deviations[76]);
}

#[test]
fn steps_and_implicit_differentiation_agree_in_every_variant() {
    let robot = gantry_tau();
    let (folder, file) = prototype();
    let poses = Poses::select(&robot, &file, &folder, Split::Alternate).unwrap();
    for variant in robot
        .variants
        .iter()
        .filter(|variant| variant.effects.is_empty())
    {
        let calibration = calibrate(
            Setup::new(&robot, variant, &file, &folder),
            &poses.division.calibration,
            &Options::default(),
        )
        .unwrap();
        let few = &poses.division.validation[..10];
        let sensitivity = analyse(&calibration.machine, &folder, few, PAPER_STEP).unwrap();
        assert!(
            sensitivity.disagreement < 1e-5,
            "{}: {}",
            variant.name,
            sensitivity.disagreement
        );
        let rows = if variant.name == "Nominal" || variant.name == "Piecewise" {
            7
        } else {
            10
        };
        for link in &sensitivity.links {
            assert_eq!(link.parameters.len(), rows);
            for row in &link.parameters {
                assert!(row.position_mm > 0.0 && row.by_pose_um.len() == 10);
            }
        }
    }
}

#[test]
fn the_cost_changes_by_the_square_of_the_step() {
    // A step of a length changes every closure by 2·L·step: twice (2·L·step)² over the poses, once the
    // calibrated residuals are small beside it.
    let sensitivity = paper_sensitivity();
    let lengthened = 2.0 * 2.04422 * PAPER_STEP;
    let expected = 2.0 * 60.0 * lengthened * lengthened;
    let row = &sensitivity.links[0].parameters[0];
    assert_eq!(row.parameter, "L");
    assert!(row.cost_m4 >= 0.99 * expected, "{} {expected}", row.cost_m4);
}

/// On level plates Euler angles are singular. For deltas and hexapods alike, errors are of the size of the noise, and
/// the two ways of Table III agree.
#[test]
fn level_plates_have_orientation_errors_of_the_size_of_the_noise() {
    let folder = tempfile::tempdir().unwrap();
    let plain = "robot = \"R\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    std::fs::write(folder.path().join("plain.toml"), plain).unwrap();
    for name in ["linear_delta", "stewart"] {
        let with = format!("--model ROBOTS/{name}.tau --robot DIR/plain.toml");
        let line = format!("tau simulate --exact --random --poses 60 --out DIR/{name} {with} -q");
        tau_in(folder.path(), &line).done();
        let line = format!("tau evaluate DIR/{name} {with} --variant Full --json -");
        let found = tau_in(folder.path(), &line).json();
        for axis in 0..3 {
            let largest = number(&found["orientation_rad"]["max_abs"][axis]);
            // Of at most 60 draws of 40 µrad, with what 10 µm of the joints' positions turn a small plate by.
            assert!((1e-5..4e-4).contains(&largest), "{name}: {largest}");
        }
        let line = format!("tau sensitivity DIR/{name} {with} --variant Full --json -");
        let found = tau_in(folder.path(), &line).json();
        let disagreement = number(&found["disagreement"]);
        assert!(disagreement < 1e-3, "{name}: {disagreement}");
        assert_eq!(found["orientation_as"], "rotation_vector");
        let line = format!("tau study DIR/{name} {with} --no-discover --out DIR/{name}-study");
        let text = tau_in(folder.path(), &line).done();
        assert!(text.contains("Euler angles mean nothing"), "{text}");
    }
    let found = tau_in(folder.path(), "tau sensitivity --variant Full --json -").json();
    assert_eq!(found["orientation_as"], "zyz_angles");
}

/// Links of a crank have no direction of a track, and a plate in its plane moves along no z, but by the square of a step.
#[test]
fn links_of_unlike_parameters_stand_in_one_table() {
    let folder = tau_testkit::Work::simulated(
        "--model ROBOTS/two_cranks_rail.tau --seed 1 --random --poses 20",
    );
    let line = "tau sensitivity DIR/measured --model ROBOTS/two_cranks_rail.tau --robot DIR/measured/robot.toml \
                --variant Full";
    let ran = tau_in(folder.path(), line);
    assert_eq!(ran.code, 0, "{}", ran.err);
    let mut lines = ran.out.lines().skip_while(|line| !line.starts_with("Link"));
    let heading: Vec<&str> = lines.next().unwrap().split_whitespace().collect();
    let names = [
        "Link", "L", "Px", "Py", "Pz", "Cx", "Cy", "Cz", "O1", "O2", "O3",
    ];
    assert_eq!(heading, names);
    let rows: Vec<Vec<&str>> = (lines.skip(1).take(3))
        .map(|line| line.split_whitespace().collect())
        .collect();
    assert!(
        rows.iter().all(|row| row.len() == heading.len()),
        "{rows:?}"
    );
    let of = |link: &str| rows.iter().find(|row| row[0] == link).unwrap();
    assert_eq!(of("l")[5..], ["–"; 6]);
    assert!(of("t")[8..].iter().all(|cell| *cell != "–"));
    assert_eq!([of("t")[4], of("t")[7], of("t")[10]], ["0.00"; 3]);
}
