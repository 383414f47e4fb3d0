//! Limits beyond which a calibration from unknown poses means nothing.

use std::fs;

use serde_json::Value;

use crate::support::{Ran, number, tau_in};

/// Neither fits nor parameters tell of a mistake here: residuals are as large as the stated noise. Yet no belts of 1.9 m,
/// as at the reference, are missed by more than a hundredth, 18.5 mm, by a machine that is the right one.
#[test]
fn measurements_missed_by_more_than_a_hundredth_of_the_machine_are_absurd() {
    let calibrated = |noise_m: f64| -> Ran {
        let work = tempfile::tempdir().unwrap();
        let line = format!(
            "tau simulate --model four_belts --variant Full --measure readings --poses 60 --random --noise-drives {noise_m} \
             --seed 5 --out DIR/measured"
        );
        tau_in(work.path(), &line).done();
        let line =
            "tau calibrate DIR/measured --model four_belts --variant Full --out DIR/out --json -";
        tau_in(work.path(), line)
    };
    // Of 120 readings the fit leaves 57: their rms is 0.7 of the noise.
    let near = calibrated(0.02).json();
    assert_eq!(
        near["fit"]["status"], "consistent",
        "{}",
        near["fit"]["why"]
    );
    let rms = number(&near["fit"]["by_file"][0]["rms"]);
    assert!((0.012..0.016).contains(&rms), "{rms}");
    let far = calibrated(0.03);
    assert_eq!(far.code, 1);
    let expected = "this is another machine, or commands and measurements do not belong together";
    assert!(
        far.err.contains("absurd") && far.err.contains(expected),
        "{}",
        far.err
    );
}

/// The measurements tell the endstop to 3 µm, whatever the drawing says: at 30 of its tolerances, 0.1 mm, that is no drawing
/// of this machine.
#[test]
fn a_dimension_thirty_tolerances_off_is_absurd() {
    let work = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --variant Full --measure positions --poses 60 --random --seed 5 \
                --out DIR/measured";
    tau_in(work.path(), line).done();
    let [file, truth] =
        ["robot.toml", "truth.json"].map(|name| work.path().join("measured").join(name));
    let truth: Value = serde_json::from_slice(&fs::read(truth).unwrap()).unwrap();
    let truth = number(&truth["parameters"]["endstop_a"]);
    let drawing = fs::read_to_string(&file).unwrap();
    let calibrated = |tolerances: f64| {
        let value = truth + tolerances * 1e-4;
        let stated =
            format!("{drawing}\n[parameters]\nendstop_a = {{ value = {value}, tol = 1e-4 }}\n");
        fs::write(&file, stated).unwrap();
        let line =
            "tau calibrate DIR/measured --model linear_delta --variant Full --out DIR/out --json -";
        tau_in(work.path(), line)
    };
    let near = calibrated(28.0).json();
    assert_eq!(
        near["fit"]["status"], "inconsistent",
        "{}",
        near["fit"]["why"]
    );
    let far = calibrated(32.0);
    assert_eq!(far.code, 1);
    let expected = "`endstop_a` is 32.0 tolerances off: ";
    assert!(
        far.err.contains("absurd") && far.err.contains(expected),
        "{}",
        far.err
    );
}
