//! Models that leave nothing free: there is nothing to fit, but everything to judge.

use tau_testkit::{OWN, Work, robots};

/// A point in a plane on three driven lines, one more than it has freedoms; all of it exact.
const EXACT: &str = "robot Exact {
    plate point in plane;
    cluster lines on base {
        link a actuated length { length = q; track_offset = (0, 2, 0) m exact; }
        link b actuated length { length = q; track_offset = (3, 2, 0) m exact; }
        link c actuated length { length = q; track_offset = (1.5, 0, 0) m exact; }
    }
    reference { commands = (1.8, 1.8, 1.0) m; position = (1.5, 1, 0) m; }
    variant Full { arm full; }
}";

/// Every command on poses, on what stands for them and on less: residuals are judged, effects found on top.
#[test]
fn a_model_without_free_parameters_is_judged() {
    let printer = include_str!("../../generated/models/linear_delta.tau");
    let held =
        "variant Held = Basic hold radius, angle_a, angle_b, endstop_a, endstop_b, endstop_c;";
    let printer = robots::extended(printer, held);
    // The first two commands, or all.
    for (text, variant, kind, commands) in [
        (EXACT, "Full", "poses", 4),
        (&printer, "Held", "heights", 2),
    ] {
        let work = Work::described(text).with_measured(&format!(
            "--exact --measure {kind} --poses 30 --seed 3 --noise-position 1e-5 --noise-rotation 4e-5"
        ));
        let check = work.run(&format!("check MEASURED {OWN} --json -"));
        assert_eq!(check.json()["meaningful"], true);
        let all = [
            format!("evaluate MEASURED --variant {variant}"),
            format!("calibrate MEASURED --variant {variant} --out DIR/calibrated"),
            format!("discover MEASURED --base {variant} --out DIR/discovered"),
            "study MEASURED --no-discover --out DIR/study".to_owned(),
        ];
        for command in &all[..commands] {
            let found = work.json(&format!("{command} {OWN}"));
            let status = found.pointer("/fit/status").unwrap_or(&found["status"]);
            let right = ["consistent", "nothing_missing"];
            assert!(right.iter().any(|own| status == own), "{command}: {status}");
        }
    }
}
