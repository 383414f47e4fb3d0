//! Models that leave nothing free: there is nothing to fit, but everything to judge.

use std::fs;

use crate::support::tau_in;

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
    let folder = tempfile::tempdir().unwrap();
    let printer = include_str!("../../generated/models/linear_delta.tau");
    let held =
        "variant Held = Basic hold radius, angle_a, angle_b, endstop_a, endstop_b, endstop_c;\n}";
    let printer = format!("{}{held}", printer.trim_end().trim_end_matches('}'));
    for (model, text, variant, kinds) in [
        ("exact", EXACT, "Full", ["poses", "positions", "heights"]),
        (
            "printer",
            &printer,
            "Held",
            ["poses", "positions", "heights"],
        ),
    ] {
        fs::write(folder.path().join(format!("{model}.tau")), text).unwrap();
        for kind in kinds {
            let line = format!(
                "tau simulate --model DIR/{model}.tau --exact --measure {kind} --poses 30 --seed 3 \
                 --noise-position 1e-5 --noise-rotation 4e-5 --out DIR/{model}-{kind}"
            );
            tau_in(folder.path(), &line).done();
            let at = format!("DIR/{model}-{kind} --model DIR/{model}.tau");
            for line in [
                format!("tau check {at}"),
                format!("tau evaluate {at} --variant {variant}"),
                format!("tau calibrate {at} --variant {variant} --out DIR/calibrated"),
                format!("tau discover {at} --base {variant} --out DIR/discovered"),
                format!("tau study {at} --out DIR/study"),
            ] {
                let out = tau_in(folder.path(), &line).done();
                assert!(!out.contains("inconsistent"), "{line}: {out}");
            }
        }
    }
}
