//! Measured forces: tensions of the links that drives lengthen, as load cells or motor currents give them.

use tau_codes::files;
use tau_robot::input_error;
use tau_robot::input_error::InputError;
use tau_robot::measurements::Shape;

use super::machine::{Machine, State};
use super::noise::Noise;
use super::plan::Stop;
use super::random::Random;

/// Refuses to measure forces where no drive lengthens a link, or where none act in the arm.
pub(super) fn check(machine: &Machine) -> Result<(), InputError> {
    const OPTION: &str = "--noise-force";
    if !machine.rods.iter().any(|rod| rod.actuated_by.is_some()) {
        return Err(input_error!(files::OPTION_WITHOUT_USE, OPTION;
            "found no link that a drive lengthens, expected some, of which tensions are measured";
            "leave the option out"));
    }
    if !machine.is_loaded() {
        return Err(input_error!(files::NO_FORCES, OPTION;
            "found neither `[payload]` nor a link that is pulled, expected forces in the arm";
            "add `[payload]` to the robot file, or give its mass with `--payload`"));
    }
    Ok(())
}

/// Measures tensions at stops with their true states: once at each, with noise of a standard deviation (N).
pub(super) fn measure(
    machine: &Machine,
    stops: &mut [Stop],
    states: &[State],
    noise: &Noise,
    sigma_n: f64,
    seed: u64,
) {
    let mut random = Random::new(seed, "forces");
    for (stop, state) in stops.iter_mut().zip(states) {
        let links = machine.rods.iter().zip(&state.tensions_n);
        let measured = links.map(|(rod, true_n)| match rod.actuated_by {
            Some(_) => true_n + sigma_n * noise.deviate(&mut random),
            None => f64::NAN,
        });
        stop.tensions_n = Some(measured.collect());
    }
}

/// Links with a column `force1_N`, …, in the order of [`Shape::force_names`].
pub(super) fn links(shape: &Shape) -> impl Iterator<Item = usize> {
    let drives = shape.links.iter().enumerate();
    drives.filter_map(|(link, drive)| drive.map(|_| link))
}
