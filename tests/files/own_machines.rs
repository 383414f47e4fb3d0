//! Machines that users describe themselves: what does not fit the plate, the links or the drives is said.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use crate::support::{Ran, number, tau_in};

/// A plate in the plane on three sliders.
const PLANAR: &str = "robot Planar {
    plate body in plane;
    track one, two, three;
    cluster on_one on one { link l1 { length = LENGTH tol 0.3 mm; plate_joint = (24, -76, 0) mm tol 0.3 mm; \
    track_offset = (-150, -450, 0) mm tol 5 mm; track_direction = (1, 0, 0) tol 0.01; } }
    cluster on_two on two { link l2 { length = 412 mm tol 0.3 mm; plate_joint = (54, 59, 0) mm tol 0.3 mm; \
    track_offset = (465, 95, 0) mm tol 5 mm; track_direction = (-0.5, 0.866, 0) tol 0.01; } }
    cluster on_three on three { link l3 { length = 412 mm tol 0.3 mm; plate_joint = (-78, 18, 0) mm tol 0.3 mm; \
    track_offset = (-315, 355, 0) mm tol 5 mm; track_direction = (-0.5, -0.866, 0) tol 0.01; } }
    reference { position = (0, 0, 0) m; }
    variant Full { arm full; tracks linear per link; }
}";

/// A point in the plane on two sliders.
const POINT: &str = "robot Pair {
    plate point in plane;
    track one, two;
    cluster a on one { link l1 { length = 0.4 m tol 0.3 mm; track_offset = (-0.2, 0, 0) m tol 5 mm; \
    track_direction = (-1, 0, 0) tol 0.01; } }
    cluster b on two { link l2 { length = 0.4 m tol 0.3 mm; track_offset = (0.2, 0, 0) m tol 5 mm; \
    track_direction = (1, 0, 0) tol 0.01; } }
    reference { position = (0, 0.346, 0) m; }
    variant Full { arm full; tracks linear; }
}";

/// Three legs drive it, three hold it: it lifts and tilts.
const TRIPOD: &str = "robot Tripod {
    plate body;
    cluster legs on base {
        link d1 actuated length { length = 0.7 m tol 1 mm; track_offset = (0.5, 0, 0) m tol 3 mm; \
    plate_joint = (0.15, 0, 0) m tol 0.3 mm; }
        link d2 actuated length { length = 0.7 m tol 1 mm; track_offset = (-0.25, 0.433, 0) m tol 3 mm; \
    plate_joint = (-0.075, 0.13, 0) m tol 0.3 mm; }
        link d3 actuated length { length = 0.7 m tol 1 mm; track_offset = (-0.25, -0.433, 0) m tol 3 mm; \
    plate_joint = (-0.075, -0.13, 0) m tol 0.3 mm; }
    }
    cluster stays on base {
        link s1 { length = 0.6 m tol 0.3 mm; track_offset = (0.6, 0.1, 0.6) m tol 3 mm; \
    plate_joint = (0, 0.1, 0) m tol 0.3 mm; }
        link s2 { length = 0.6 m tol 0.3 mm; track_offset = (0.6, -0.1, 0.6) m tol 3 mm; \
    plate_joint = (0, -0.1, 0) m tol 0.3 mm; }
        link s3 { length = 0.6 m tol 0.3 mm; track_offset = (-0.05, 0.6, 0.6) m tol 3 mm; \
    plate_joint = (-0.05, 0, 0) m tol 0.3 mm; }
    }
    reference { position = (0, 0, 0.606) m; }
    variant Full { arm full; }
}";

fn planar() -> String {
    PLANAR.replace("LENGTH", "412 mm")
}

/// A folder with a description as `own.tau`.
fn described(text: &str) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("own.tau"), text).unwrap();
    folder
}

fn refused(folder: &Path, line: &str, words: &[&str]) {
    let Ran { code, err, .. } = tau_in(folder, line);
    assert_eq!(code, 2, "{line}: {err}");
    for word in words {
        assert!(err.contains(word), "{line}: no `{word}` in {err}");
    }
}

#[test]
fn poses_outside_the_plane_are_refused() {
    let folder = described(&planar());
    let inverse = "tau kinematics inverse --model DIR/own.tau --variant Full";
    for pose in ["0.02,0.01,0.25,0.05,0,0", "0.02,0.01,0,0.05,0.2,0"] {
        let line = format!("{inverse} --pose {pose}");
        refused(
            folder.path(),
            &line,
            &["body in plane stays at z = 0", "x, y and alpha"],
        );
    }
    let header = "x_m,y_m,alpha_rad,beta_rad\n";
    fs::write(
        folder.path().join("path.csv"),
        format!("{header}0.02,0.01,0.05,0\n0.02,0.01,0.05,0.2\n"),
    )
    .unwrap();
    let line = format!("{inverse} --poses DIR/path.csv");
    refused(folder.path(), &line, &["path.csv:3", "`beta_rad`"]);
    let line = "tau kinematics forward --model DIR/own.tau --variant Full --commands 0,0,0 --start 0,0,0.1,0,0,0";
    refused(folder.path(), line, &["--start", "`z_m` of 0.1"]);

    // The plate's pose, and the same as all six.
    let commands =
        |pose: &str| tau_in(folder.path(), &format!("{inverse} --pose {pose} -q")).done();
    let all = commands("0.02,0.01,0,0.05,0,0");
    assert_eq!(commands("0.02,0.01,0.05"), all);
    assert_eq!(
        commands("0.02,0.01,0,0.03,0,0.02").split(',').nth(18),
        all.split(',').nth(18)
    );

    let folder = described(POINT);
    let commands =
        |pose: &str| tau_in(folder.path(), &format!("{inverse} --pose {pose} -q")).done();
    assert_eq!(commands("0.02,0.35"), commands("0.02,0.35,0"));
    let line = format!("{inverse} --pose 0.02,0.35,0,1,0.5,0");
    refused(folder.path(), &line, &["no orientation"]);
    let reference = "robot = \"Pair\"\n[noise]\nposition_m = 1e-5\nrotation_rad = 4e-5\n[reference]\n\
                     commands_m = [0, 0]\nposition_m = [0, 0.346, 0.1]\n";
    fs::write(folder.path().join("robot.toml"), reference).unwrap();
    let line = format!("{inverse} --robot DIR/robot.toml --pose 0.02,0.35");
    refused(
        folder.path(),
        &line,
        &["does not fit the plate", "robot.toml:7"],
    );
}

/// Trackers measure all six coordinates. Those that the plate lacks take no part, and it is said how large they were.
#[test]
fn measured_heights_over_the_plane_take_no_part() {
    let folder = described(&planar());
    let path = folder.path();
    tau_in(
        path,
        "tau simulate --model DIR/own.tau --random --poses 60 --out DIR/measured",
    )
    .done();
    let evaluate = "tau evaluate DIR/measured --model DIR/own.tau --variant Full --json -";
    let plain = tau_in(path, evaluate).json();
    let csv = path.join("measured/tcp_poses.csv");
    let text = fs::read_to_string(&csv).unwrap();
    let mut with_heights = String::new();
    for (index, line) in text.lines().enumerate() {
        let more = if index == 0 {
            "z_m,beta_rad"
        } else {
            "0.25,0.1"
        };
        writeln!(with_heights, "{line},{more}").unwrap();
    }
    fs::write(&csv, with_heights).unwrap();
    let ran = tau_in(
        path,
        "tau evaluate DIR/measured --model DIR/own.tau --variant Full",
    );
    for word in [
        "`z_m` (up to 2.50e-1)",
        "`beta_rad` (up to 1.00e-1)",
        "no part",
    ] {
        assert!(
            ran.err.contains(word) || ran.out.contains(word),
            "{}{}",
            ran.err,
            ran.out
        );
    }
    let again = tau_in(path, evaluate).json();
    assert_eq!(again["position_um"], plain["position_um"]);
}

#[test]
fn a_link_that_does_not_reach_is_named() {
    for (length, has) in [("112 mm", "has 112.0 mm"), ("41.2 m", "has 41200.0 mm")] {
        let folder = described(&PLANAR.replace("LENGTH", length));
        for asked in ["inverse --pose 0.02,0.01,0", "forward --commands 0.01,0,0"] {
            let line = format!("tau kinematics {asked} --model DIR/own.tau --variant Full");
            refused(
                folder.path(),
                &line,
                &["`l1` would have to be", has, "in metres"],
            );
        }
    }
}

#[test]
fn a_machine_that_lifts_and_tilts_is_measured_at_random_commands() {
    let folder = described(TRIPOD);
    let path = folder.path();
    for (out, how) in [("grid", ""), ("random", "--random")] {
        let line =
            format!("tau simulate --model DIR/own.tau --out DIR/{out} --poses 60 {how} --json -");
        assert_eq!(
            number(&tau_in(path, &line).json()["rows"]["tcp_poses"]),
            60.0
        );
    }
    let ran = tau_in(
        path,
        "tau simulate --model DIR/own.tau --out DIR/measured --poses 60",
    );
    assert!(ran.err.contains("at random commands"), "{}", ran.err);
    let calibrated = tau_in(
        path,
        "tau calibrate DIR/measured --model DIR/own.tau --variant Full --out DIR/c --json -",
    );
    assert_eq!(calibrated.json()["fit"]["status"], "consistent");
    let line = "tau simulate --model DIR/own.tau --out DIR/measured --tilt 0.1";
    refused(path, line, &["--tilt", "follows from its position"]);
}

#[test]
fn what_would_stay_within_reach_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path();
    let ran = tau_in(path, "tau simulate --model rotary_delta --out DIR/far");
    let (_, rest) = ran.err.split_once("--grid-step ").expect(&ran.err);
    let steps = rest.split(", or ").next().unwrap();
    let line = format!(
        "tau simulate --model rotary_delta --out DIR/whole --exact --poses 180 --grid-step {steps} --json -"
    );
    let made = tau_in(path, &line).json();
    assert_eq!(number(&made["rows"]["tcp_poses"]), 180.0, "{steps}");
    // Half of the steps would not do.
    let folder = described(&planar());
    let ran = tau_in(
        folder.path(),
        "tau simulate --model DIR/own.tau --out DIR/measured",
    );
    assert!(ran.err.contains("at random with --random"), "{}", ran.err);
    assert!(!ran.err.contains("--grid-step"), "{}", ran.err);
}

#[test]
fn a_hexapod_is_tilted_when_asked() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model hexapod --out DIR/tilted --tilt 0.1 --json -";
    let made = tau_in(folder.path(), line).json();
    assert!(number(&made["rows"]["tcp_poses"]) > 150.0, "{made}");
    let truth = fs::read_to_string(folder.path().join("tilted/tcp_poses.csv")).unwrap();
    let column = truth
        .lines()
        .next()
        .unwrap()
        .split(',')
        .position(|name| name == "beta_rad")
        .unwrap();
    let largest = truth
        .lines()
        .skip(1)
        .map(|line| line.split(',').nth(column).unwrap().parse::<f64>().unwrap());
    let largest = largest.fold(0.0, |most: f64, beta| most.max(beta.abs()));
    assert!((0.05..0.15).contains(&largest), "{largest}");
}

#[test]
fn what_says_nothing_is_said() {
    let folder = described(&planar());
    let path = folder.path();
    for (index, (asked, words)) in [
        ("--measure heights", "say nothing"),
        ("--measure readings", "say nothing of the machine"),
        (
            "--payload=5 --effect=link_compliance(all):strain=1e-8",
            "no forces act",
        ),
    ]
    .into_iter()
    .enumerate()
    {
        let line = format!("tau simulate --model DIR/own.tau --random --out DIR/{index} {asked}");
        let ran = tau_in(path, &line);
        assert!(
            ran.code == 0 && ran.err.contains(words),
            "{line}: {}",
            ran.err
        );
    }
    // Nothing could be seen where a calibration would mean nothing.
    tau_in(
        path,
        "tau simulate --model DIR/own.tau --random --out DIR/measured --measure readings",
    )
    .done();
    let ran = tau_in(path, "tau check DIR/measured --model DIR/own.tau");
    assert!(
        ran.code == 1 && !ran.out.contains("could be seen"),
        "{}",
        ran.out
    );
    let huge = described(&planar().replace("tol 0.3 mm", "tol 300 mm"));
    let line = "tau simulate --model DIR/own.tau --grid-step 0.02,0.02,0.02 --out DIR/measured";
    refused(huge.path(), line, &["tolerances", "--exact"]);
}

/// So many tracks have more numberings than memory has room for: none is tried, and the machine calibrates.
#[test]
fn a_machine_of_eleven_tracks_is_calibrated() {
    let tracks: Vec<String> = (0..11).map(|track| format!("t{track}")).collect();
    let mut text = format!("robot Many {{ track {};\n", tracks.join(", "));
    for (k, track) in tracks.iter().enumerate() {
        let angle = std::f64::consts::TAU * k as f64 / 11.0;
        let side = if k % 2 == 0 { 0.2 } else { -0.2 };
        let (sin, cos) = angle.sin_cos();
        let (joint_sin, joint_cos) = (angle + side).sin_cos();
        let _ = writeln!(
            text,
            "cluster c{k} on {track} {{ link l{k} {{ length = 700 mm tol 0.3 mm; \
             plate_joint = ({}, {}, {}) mm tol 0.3 mm; track_offset = ({}, {}, 0) mm tol 5 mm; \
             track_direction = (0, 0, 1) tol 0.01; }} }}",
            60.0 * joint_cos,
            60.0 * joint_sin,
            10 * (k % 3),
            400.0 * cos,
            400.0 * sin,
        );
    }
    text += "reference { position = (0, 0, -606) mm; }
        variant Full { arm full; tracks linear per link; } }";
    let folder = described(&text);
    let folder = folder.path();
    let line = "tau simulate --model DIR/own.tau --out DIR/measured --random --seed 1";
    tau_in(folder, line).done();
    let line =
        "tau calibrate DIR/measured --model DIR/own.tau --variant Full --out DIR/out --json -";
    let found = tau_in(folder, line).json();
    assert_eq!(found["fit"]["status"], "consistent", "{}", found["fit"]);
}

/// Beside noise that is to be estimated, heights of the other sign fit somewhere, too: they are not suspected where those that
/// were measured fit.
#[test]
fn rows_that_fit_are_not_suspected_where_noise_is_estimated() {
    let fixtures = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/struts");
    let folder = tempfile::tempdir().unwrap();
    let found = tau_in(
        folder.path(),
        &format!(
            "tau calibrate {fixtures} --model {fixtures}/struts.tau --variant Full --split all --out DIR/out --json -"
        ),
    )
    .json();
    let fit = &found["fit"];
    assert_eq!(fit["status"], "consistent", "{fit}");
    assert!(fit["mistakes"].as_array().unwrap().is_empty(), "{fit}");
    // Poses that are met worst stand in the order of their residuals.
    let worst = fit["worst"].as_array().unwrap();
    assert_eq!(worst.len(), 5, "{fit}");
    let sigmas: Vec<f64> = worst.iter().map(|own| number(&own["sigmas"])).collect();
    assert!(sigmas.is_sorted_by(|a, b| a >= b), "{sigmas:?}");
}
