//! Promises of a session: the numbers do not depend on how the robot was compiled, names are typed, and what is found is
//! calibrated like what was declared.

use tau::kinematics::Sample;
use tau::{Error, Robot, Session};

use crate::{FOLDER, Gantry, gantry};

#[test]
fn compiled_in_and_read_at_run_time_the_numbers_are_the_same() -> Result<(), Error> {
    let compiled_in = Session::<Gantry>::open(FOLDER)?;
    let at_run_time =
        Session::open_with_robot(Robot::from_text(Gantry::ROBOT.description)?, FOLDER)?;
    let one = compiled_in.calibrate(Gantry::RUNOUT)?;
    let other = at_run_time.calibrate("Runout")?;

    let bits = |values: &[f64]| -> Vec<u64> { values.iter().map(|own| own.to_bits()).collect() };
    assert_eq!(bits(&one.machine.values), bits(&other.machine.values));
    assert_eq!(one.parameters, other.parameters);
    let period = one.estimate(gantry::runout::RUNOUT_TWO_PERIOD)?;
    assert_eq!(period, other.estimate("runout(two).period")?);
    let errors = compiled_in.evaluate(&one.machine)?;
    assert_eq!(errors, at_run_time.evaluate(&other.machine)?);

    let start = Sample::from(&compiled_in.folder().tcp_poses[2]);
    let poses = [&one.machine, &other.machine].map(|machine| machine.forward(&start));
    assert!(poses[0].is_ok());
    assert_eq!(poses[0], poses[1]);
    Ok(())
}

#[test]
fn a_parameter_of_another_variant_has_no_estimate() -> Result<(), Error> {
    let session = Session::<Gantry>::open(FOLDER)?;
    let shared = session.calibrate(Gantry::SHARED)?;
    let length = shared.estimate(gantry::shared::L1_LENGTH)?;
    assert!((length.value - 2.0).abs() < 0.5, "{}", length.value);
    let refused = [
        shared.estimate(gantry::runout::RUNOUT_TWO_SINE).err(),
        shared.estimate("l1.lenght").err(),
    ];
    let codes = refused.map(|error| error.expect("no estimate").code().to_string());
    assert_eq!(codes, ["T338", "T248"]);
    let error = session.calibrate("Runaut").err().map(|own| own.code());
    assert_eq!(error.map(|code| code.to_string()).as_deref(), Some("T263"));
    Ok(())
}

#[test]
fn what_a_variant_lacks_is_found_and_calibrated() -> Result<(), Error> {
    let session = Session::<Gantry>::open(FOLDER)?;
    let shared = session.calibrate(Gantry::SHARED)?;
    let without_um = session.evaluate(&shared.machine)?.position_um.mean;
    let found = session.discover(Gantry::SHARED)?;
    assert_eq!(found.discovery.base, Gantry::SHARED.name());
    let calibrated = session.state_found(&found)?;
    let with_um = session.evaluate(&calibrated.machine)?.position_um.mean;
    assert!(with_um < 0.5 * without_um, "{with_um} of {without_um}");
    Ok(())
}
