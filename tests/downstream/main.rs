//! What a user's crate looks like: it depends on `tau` alone, declares its robot with a variant and an
//! effect of its own, calibrates it on a measurement folder, and reads the result.

use std::path::{Path, PathBuf};

use tau::calibration::{Calibration, Error, Options, calibrate};
use tau::evaluation::evaluate;
use tau::kinematics::Sample;
use tau::measurements::{Folder, Shape, Split};
use tau::robot_file::RobotFile;
use tau::{Robot, tau_model};

tau_model! {
    /// A Gantry-Tau with a pinion that runs out of true on its second track.
    pub robot Gantry {
        track one, two, three;
        cluster arm1 on one   { link l1; }
        cluster arm2 on two   { link l2a, l2b; }
        cluster arm3 on three { link l3a, l3b, l3c; }

        /// Every link with its own joints; the links of a cart share its straight path.
        variant Shared { arm full; tracks linear; }

        /// The cart gets ahead of its command and falls behind once a turn of the pinion.
        effect runout on cart {
            param sine, cosine: length tol 100 um;
            search period: length in 350 mm ..= 500 mm;
            along += sine * sin(2*pi*q/period) + cosine * cos(2*pi*q/period);
        }
        variant Runout = Shared + runout(two);
    }
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/prototype")
}

/// Calibrates a variant on every other pose of the folder, and returns the mean position error (µm) at
/// the others with it.
fn calibrated(robot: &Robot, variant: &str) -> Result<(Calibration, f64), Error> {
    let shape = Shape::from(robot);
    let measured = Folder::read(&folder(), shape)?;
    let nominal = RobotFile::read(&folder().join("robot.toml"), robot)?;
    let poses = Split::Alternate.divide(&measured.in_range(&nominal, shape));

    let variant = robot.variant(variant).expect("declared above");
    let options = Options::default();
    let calibration = calibrate(
        robot,
        variant,
        &nominal,
        &measured,
        &poses.calibration,
        &options,
    )?;
    let evaluation = evaluate(&calibration.machine, &measured, &poses.validation)?;
    Ok((calibration, evaluation.position_um.mean))
}

#[test]
fn an_effect_of_ones_own_is_found_and_closes_the_gap() -> Result<(), Error> {
    let robot = Robot::from(Gantry::ROBOT);
    let (_, without_um) = calibrated(&robot, "Shared")?;
    let (calibration, with_um) = calibrated(&robot, "Runout")?;

    let estimate = |name: &str| {
        let mut estimates = calibration.parameters.iter();
        estimates
            .find(|estimate| estimate.name == name)
            .expect("a parameter of the variant")
    };
    let (period, sine) = (estimate("runout(two).period"), estimate("runout(two).sine"));
    println!(
        "position error {without_um:.0} µm without the effect, {with_um:.0} µm with a pinion of \
         {:.1} ± {:.1} mm",
        period.value * 1e3,
        period.sigma * 1e3
    );
    assert!(sine.value.abs() > 10.0 * sine.sigma);
    assert_eq!(period.unit, "m");
    assert!(period.sigma < 5e-3);
    assert!(with_um < 0.9 * without_um);
    Ok(())
}

#[test]
fn a_calibrated_robot_is_written_and_read_again() -> Result<(), Error> {
    let robot = Robot::from(Gantry::ROBOT);
    let (calibration, _) = calibrated(&robot, "Runout")?;
    let text = calibration.file.to_toml();
    let again = RobotFile::parse_for(&text, "robot.toml", &robot)?;
    assert_eq!(again, calibration.file);
    Ok(())
}

#[test]
fn compiled_in_and_read_at_run_time_the_numbers_are_the_same() -> Result<(), Error> {
    let compiled_in = Robot::from(Gantry::ROBOT);
    let at_run_time = Robot::from_text(Gantry::ROBOT.description).expect("the same text");
    let (one, one_um) = calibrated(&compiled_in, "Runout")?;
    let (other, other_um) = calibrated(&at_run_time, "Runout")?;

    let bits =
        |values: &[f64]| -> Vec<u64> { values.iter().map(|value| value.to_bits()).collect() };
    assert_eq!(bits(&one.machine.values), bits(&other.machine.values));
    assert_eq!(one.parameters, other.parameters);
    assert_eq!(one_um.to_bits(), other_um.to_bits());

    let measured = Folder::read(&folder(), Shape::from(&compiled_in))?;
    let start = Sample::from(&measured.tcp_poses[2]);
    let poses = [&one, &other].map(|calibration| calibration.machine.forward(&start));
    assert!(poses[0].is_ok());
    assert_eq!(poses[0], poses[1]);
    Ok(())
}
