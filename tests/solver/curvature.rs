//! Standard deviations along motions that measurements leave to the tolerances.

use tau::Setup;
use tau::calibration::Options;
use tau::measurements::Split;
use tau::robot_file::RobotFile;
use tau::simulation::{Measure, simulate};
use tau::unknown_poses::{RowDivision, calibrate};
use tau_testkit::robots::{described, measured_at_random, text};

/// Distances do not tell how a delta is tilted, and tell the length of a direction (0, 0, 1). So with x and y of covariance C
/// its third component is short of that length by (x² + y²)/2, normal deviates, which has the mean tr C/2 and the variance
/// tr C²/2.
#[test]
fn a_tilt_shortens_what_is_upright() {
    let robot = described(&text("linear_delta"));
    let noise = "[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n";
    let file = format!("robot = \"{}\"\n{noise}", robot.name);
    let file = RobotFile::parse_for(&file, "robot.toml", &robot).unwrap();
    let file = file.completed(&robot);
    let measures = [Measure::Distances];
    let simulation = measured_at_random(&robot, &file, "Nominal", &measures, 40);
    let folder = simulate(&simulation).unwrap().folder;
    let division = RowDivision::of(&folder, Split::All);
    let variant = robot.variant("Nominal").unwrap();
    let setup = Setup::new(&robot, variant, &file, &folder);
    let found = calibrate(setup, &division, &Options::default()).unwrap();
    let fitted = &found.calibration;
    let place = |name: &str| {
        let mut parameters = fitted.parameters.iter();
        parameters.position(|own| own.name == name).unwrap()
    };
    for cluster in ["arm_a", "arm_b", "arm_c"] {
        let [x, y, z] =
            ["x", "y", "z"].map(|axis| place(&format!("{cluster}.track_direction.{axis}")));
        let of = |a: usize, b: usize| fitted.covariance[a][b];
        let mean = of(x, x).midpoint(of(y, y));
        let variance = (of(x, x).powi(2) + of(y, y).powi(2) + 2.0 * of(x, y).powi(2)) / 2.0;
        let beyond = fitted.parameters[z].sigma.powi(2) - of(z, z);
        let expected = mean * mean + variance;
        assert!(expected > 0.1 * of(z, z), "{cluster}: {expected}");
        // The direction is some hundredths off (0, 0, 1).
        let ratio = beyond / expected;
        assert!((ratio - 1.0).abs() < 0.1, "{cluster}: {ratio}");
        // Along itself the motion is straight.
        let sideways = fitted.parameters[x].sigma.powi(2) / of(x, x);
        assert!((sideways - 1.0).abs() < 1e-2, "{cluster}: {sideways}");
    }
}
