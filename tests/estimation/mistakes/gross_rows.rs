//! Measurements that someone spoiled: what leaves them out says which they are.

use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::{Random, number, spoil, tau_in};

/// Lines under the title of rows that were left out, each a measurement.
fn left_out(said: &str) -> Vec<&str> {
    rows_under(said, "Rows left out")
}

fn rows_under<'a>(said: &'a str, title: &str) -> Vec<&'a str> {
    let lines = said.lines().skip_while(|line| *line != title);
    let rows = lines.skip(1).take_while(|line| line.starts_with("  "));
    rows.map(str::trim).collect()
}

/// Screen, page and JSON of `tau discover`.
fn discovered(folder: &Path, model: &str) -> (String, String, Value) {
    let line = format!("tau discover DIR/measured --model {model} --out DIR/out --json DIR/f.json");
    let said = tau_in(folder, &line).done();
    let page = fs::read_to_string(folder.join("out/report.html")).unwrap();
    let json = fs::read(folder.join("f.json")).unwrap();
    (said, page, serde_json::from_slice(&json).unwrap())
}

/// A reading that calibrates and one that is held out, 20 mm off at a noise of 0.1 mm.
#[test]
fn readings_that_are_far_off_are_named_with_their_drives() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path();
    let line = "tau simulate --model four_belts --variant Full --measure readings --poses 60 --random \
                --noise-drives 1e-4 --seed 5 --out DIR/measured";
    tau_in(folder, line).done();
    spoil(folder, "readings.csv", 21, "q2_m", 0.02);
    spoil(folder, "readings.csv", 22, "q4_m", -0.02);

    let (said, page, json) = discovered(folder, "four_belts");
    let named = left_out(&said);
    // Two readings of four tell where the sled is: what the other two leave of an error is some of it.
    let named_with = |place: &str| {
        let own = named.iter().find_map(|row| row.strip_prefix(place));
        let sigmas = own.and_then(|own| own.strip_suffix(" times its noise"));
        let sigmas: f64 = sigmas.expect(place).parse().unwrap();
        assert!((50.0..=200.0).contains(&sigmas), "{named:?}");
    };
    named_with("readings.csv line 21, pose 20, drive of top_right: ");
    named_with("readings.csv line 22, pose 21, drive of bottom_right: ");
    assert_eq!(named.len(), 2, "{named:?}");
    for row in &named {
        assert!(page.contains(&format!("<li>{row}</li>")), "{row}");
    }
    let rows = json["gross_rows"].as_array().unwrap();
    let places = rows
        .iter()
        .map(|row| (row["line"].as_u64().unwrap(), row["drive"].as_str()));
    let expected = [(21, Some("top_right")), (22, Some("bottom_right"))];
    assert!(places.eq(expected), "{rows:?}");

    // The calibration of the same model names the one that it has, in the same words.
    let line = "tau calibrate DIR/measured --model four_belts --variant Full --out DIR/calibrated";
    let calibrated = tau_in(folder, line).done();
    let rows = left_out(&calibrated);
    assert!(
        rows.len() == 1 && named.contains(&rows[0]),
        "{rows:?} {named:?}"
    );
}

/// A height that is 3 mm off has a line and a pose, and no drive.
#[test]
fn heights_that_are_far_off_are_named() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path();
    let line = "tau simulate --model linear_delta --variant Full --measure heights,distances --poses 60 --random \
                --seed 5 --out DIR/measured";
    tau_in(folder, line).done();
    spoil(folder, "heights.csv", 12, "height_m", 0.003);
    let (said, _, json) = discovered(folder, "linear_delta");
    let named = left_out(&said);
    assert_eq!(named.len(), 1, "{said}");
    assert!(
        named[0].starts_with("heights.csv line 12, pose 11: "),
        "{named:?}"
    );
    assert_eq!(json["gross_rows"].as_array().unwrap().len(), 1);
}

/// Poses that a tracker measured are outliers, by their numbers.
#[test]
fn poses_that_are_far_off_are_named() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path();
    let line = "tau simulate --model linear_delta --variant Full --poses 40 --random --seed 5 \
                --out DIR/measured";
    tau_in(folder, line).done();
    spoil(folder, "tcp_poses.csv", 12, "x_m", 0.003);
    let (said, _, json) = discovered(folder, "linear_delta");
    assert!(said.contains("Left out as outliers: set 1: 11."), "{said}");
    assert_eq!(left_out(&said), Vec::<&str>::new());
    assert_eq!(json["outliers"], serde_json::json!([11]));
}

/// Of a reading that is 20 mm off, an ordinary fit is rid, and one with a loss nearly; one that keeps it can't be right.
#[test]
fn readings_alone_are_treated_as_was_asked() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path();
    let line = "tau simulate --model four_belts --variant Full --measure readings --poses 60 --random \
                --noise-drives 1e-4 --seed 5 --out DIR/measured";
    tau_in(folder, line).done();
    spoil(folder, "readings.csv", 22, "q2_m", 0.02);
    let place = "readings.csv line 22, pose 21, drive of top_right: ";
    let treated = |asked: &str, title: &str, status: &str| {
        let line = format!(
            "tau calibrate DIR/measured --model four_belts --variant Full --out DIR/out --json DIR/j.json {asked}"
        );
        let said = tau_in(folder, &line).done();
        let rows = rows_under(&said, title);
        assert!(
            rows.len() == 1 && rows[0].starts_with(place),
            "{asked}: {said}"
        );
        let json: Value =
            serde_json::from_slice(&fs::read(folder.join("j.json")).unwrap()).unwrap();
        assert_eq!(json["fit"]["status"], status, "{asked}");
        number(&json["gross_rows"][0]["weight"])
    };
    assert_eq!(treated("", "Rows left out", "consistent"), 0.0);
    let less = "Rows far off, which count less";
    let huber = treated("--loss huber", less, "consistent");
    let cauchy = treated("--loss cauchy", less, "consistent");
    let tukey = treated("--loss tukey", less, "consistent");
    assert!(huber > cauchy && cauchy > tukey && tukey == 0.0 && huber < 0.02);
    let kept = "Rows far off, which count like the others";
    assert_eq!(treated("--keep-outliers", kept, "inconsistent"), 1.0);

    let study = "tau study DIR/measured --model four_belts --out DIR/study --json - -q";
    let remark = "the search for effects leaves outliers out";
    for (asked, is_said) in [("", false), ("--keep-outliers", true)] {
        let json = tau_in(folder, &format!("{study} {asked}")).json();
        assert_eq!(json["remarks"].to_string().contains(remark), is_said);
    }
}

/// Half of the heights state 30 µm and half 40 µm: what they are weighed by is 35.4 µm rms, and not the 10 µm of
/// `[noise]`.
#[test]
fn noise_of_rows_is_what_they_state() {
    let folder = tempfile::tempdir().unwrap();
    let line = "tau simulate --model linear_delta --variant Full --measure positions,heights --poses 60 --random \
                --track-points 0 --cart-poses 0 --out DIR/measured";
    tau_in(folder.path(), line).done();
    let path = folder.path().join("measured/heights.csv");
    let text = std::fs::read_to_string(&path).unwrap();
    let stated = (text.lines().enumerate()).map(|(index, line)| match index {
        0 => format!("{line},sigma_height_m\n"),
        index => format!("{line},{}\n", ["3e-5", "4e-5"][index / 2 % 2]),
    });
    std::fs::write(&path, stated.collect::<String>()).unwrap();
    let line = "tau calibrate DIR/measured --variant Full --out DIR/c";
    let shown = tau_in(folder.path(), line).done();
    let row = shown.lines().find(|line| line.contains("heights.csv"));
    assert!(row.unwrap().contains("35.4 µm"), "{shown}");
    let found = tau_in(folder.path(), &format!("{line}2 --json -")).json();
    let kinds = found["kinds"].as_array().unwrap();
    for (file, expected) in [
        ("heights.csv", 12.5e-10_f64.sqrt()),
        ("tcp_positions.csv", 1e-5),
    ] {
        let kind = kinds.iter().find(|kind| kind["file"] == file).unwrap();
        let noise = kind["noise_of_rows"].as_f64().unwrap();
        assert!((noise / expected - 1.0).abs() < 1e-9, "{file}: {noise}");
    }
}

/// Lines are those of the file, blank ones among them.
#[test]
fn lines_of_poses_count_blank_ones() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path();
    let line = "tau simulate --model hexapod --measure poses,heights --poses 40 --random --seed 5 --out DIR/measured";
    tau_in(folder, line).done();
    spoil(folder, "tcp_poses.csv", 21, "z_m", 5e-3);
    let path = folder.join("measured/tcp_poses.csv");
    let text = fs::read_to_string(&path).unwrap();
    fs::write(&path, text.replacen('\n', "\n\n", 1)).unwrap();
    let line = "tau calibrate DIR/measured --model hexapod --variant Full --split all --out DIR/out --json -";
    let found = tau_in(folder, line).json();
    let rows = found["gross_rows"].as_array().unwrap();
    let of_poses = rows.iter().filter(|row| row["file"] == "tcp_poses.csv");
    let lines: Vec<_> = of_poses.map(|row| row["line"].as_u64()).collect();
    assert!(!lines.is_empty(), "{rows:?}");
    assert!(lines.iter().all(|line| *line == Some(22)), "{rows:?}");
}

/// A play of 150 µm that the model lacks, at noise of some micrometres, makes no row gross: all of a file scatter so.
#[test]
fn what_a_model_lacks_makes_no_row_gross() {
    for seed in 1..=4 {
        let folder = tempfile::tempdir().unwrap();
        let simulate = format!(
            "tau simulate --model linear_delta --random --measure heights,distances,ball-bar --random-approach \
             --effect backlash(all):gap=1.5e-4 --seed {seed} --out DIR/measured"
        );
        tau_in(folder.path(), &simulate).done();
        let calibrate = "tau calibrate DIR/measured --variant Full --out DIR/c --force --json -";
        let found = tau_in(folder.path(), calibrate).json();
        assert_eq!(found["fit"]["status"], "inconsistent");
        assert_eq!(found["gross_rows"], serde_json::json!([]), "{seed}");
    }
}

/// Exact drives contradict each other where one was written down wrongly: that one is named, and the others agree again.
#[test]
fn a_wrong_command_of_exact_drives_is_named() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path();
    let line = "tau simulate --model four_belts --poses 60 --random --seed 1 --out DIR/measured";
    tau_in(folder, line).done();
    spoil(folder, "tcp_poses.csv", 6, "q4_m", 5e-3);
    let line = "tau calibrate DIR/measured --model four_belts --variant Full --split all --out DIR/calibrated";
    let said = tau_in(folder, line).done();
    let rows = left_out(&said);
    let place = "tcp_poses.csv line 6, pose 5, drive of bottom_right: ";
    assert!(rows.len() == 1 && rows[0].starts_with(place), "{rows:?}");
    let mut lines = said.lines();
    let drives = lines.find(|line| line.trim().starts_with("drives"));
    assert!(drives.unwrap().contains("exact"), "{said}");
    assert!(said.contains("Verdict: consistent"), "{said}");
}

/// Of a command that is 10 mm off, exact drives make all distances from there and the height look wrong: they agree with each
/// other, and that is said first. A distance that is wrong by itself is not told as a pose.
#[test]
fn a_wrong_command_is_told_by_all_the_rows_of_its_pose() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path();
    let line = "tau simulate --model linear_delta --variant Full --measure heights,distances --poses 40 --random \
                --noise-position 1e-4 --seed 13 --out DIR/measured";
    tau_in(folder, line).done();
    let distances = fs::read_to_string(folder.join("measured/distances.csv")).unwrap();
    let ends: Vec<[usize; 2]> = (distances.lines().skip(1))
        .map(|line| {
            let mut cells = line.split(',').map(|cell| cell.parse().unwrap_or(0));
            [cells.next().unwrap(), cells.next().unwrap()]
        })
        .collect();
    let count = |pose: usize| ends.iter().filter(|own| own.contains(&pose)).count();
    let pose = (1..=40).max_by_key(|&pose| count(pose)).unwrap();
    let rows = count(pose) + 1;
    let calibrate =
        "tau calibrate DIR/measured --variant Full --split all --out DIR/c --json DIR/j.json";
    let calibrated = || {
        let said = tau_in(folder, calibrate).done();
        let json = fs::read(folder.join("j.json")).unwrap();
        (said, serde_json::from_slice::<Value>(&json).unwrap())
    };

    let known = 1 + ends.iter().position(|own| !own.contains(&pose)).unwrap();
    spoil(folder, "distances.csv", known + 1, "distance_m", 0.01);
    let (said, json) = calibrated();
    let [one, other] = ends[known - 1];
    let place = format!(
        "distances.csv line {}, poses {one} and {other}: ",
        known + 1
    );
    let named = left_out(&said);
    assert!(named.len() == 1 && named[0].starts_with(&place), "{said}");
    assert_eq!(json["gross_rows"][0]["other_pose"], other);
    assert_eq!(json["gross_poses"], serde_json::json!([]));
    spoil(folder, "distances.csv", known + 1, "distance_m", -0.01);

    spoil(folder, "heights.csv", pose + 1, "q2_m", 0.01);
    let (said, json) = calibrated();
    let told = &json["gross_poses"][0];
    assert_eq!(told["pose"], pose, "{said}");
    assert_eq!(told["file"], "heights.csv");
    assert_eq!(told["line"], pose + 1);
    assert_eq!(told["rows"], rows, "{said}");
    assert_eq!(json["gross_poses"].as_array().unwrap().len(), 1);
    let first = left_out(&said)[0];
    assert!(
        first.contains(&format!(
            "rows of pose {pose} (heights.csv line {}): ",
            pose + 1
        )),
        "{first}"
    );
}

/// Rows that state their noise keep it where that of the others is estimated: 20 of 100 are a hundred times as rough.
#[test]
fn rows_that_state_their_noise_keep_it() {
    let work = tempfile::tempdir().unwrap();
    let folder = work.path();
    let line = "tau simulate --model linear_delta --measure positions --noise-drives 2e-6 --poses 100 --random --seed 4 \
                --out DIR/measured";
    tau_in(folder, line).done();
    let path = folder.join("measured/tcp_positions.csv");
    let text = fs::read_to_string(&path).unwrap();
    let column = text
        .lines()
        .next()
        .unwrap()
        .split(',')
        .position(|name| name == "x_m");
    let mut random = Random(4);
    let rough = text.lines().enumerate().map(|(index, line)| {
        if index == 0 {
            return format!("{line},sigma_x_m\n");
        }
        if index % 5 > 0 {
            return format!("{line},\n");
        }
        let off_m = 1e-3 * random.normal();
        let mut cells: Vec<String> = line.split(',').map(str::to_owned).collect();
        let cell = &mut cells[column.unwrap()];
        *cell = (cell.parse::<f64>().unwrap() + off_m).to_string();
        format!("{},1e-3\n", cells.join(","))
    });
    let rough: String = rough.collect();
    fs::write(&path, rough).unwrap();
    let robot = folder.join("measured/robot.toml");
    let stated = fs::read_to_string(&robot).unwrap();
    let estimated = format!("{stated}\n[noise.tcp_positions]\nposition_m = \"estimate\"\n");
    fs::write(&robot, estimated).unwrap();
    let line =
        "tau calibrate DIR/measured --variant Full --split all --out DIR/calibrated --json -";
    let found = tau_in(folder, line).json();
    assert_eq!(
        found["gross_rows"].as_array().map_or(0, Vec::len),
        0,
        "{}",
        found["gross_rows"]
    );
    let kinds = found["kinds"].as_array().unwrap();
    let of_file = kinds
        .iter()
        .filter(|kind| kind["file"] == "tcp_positions.csv");
    let noise: Vec<f64> = of_file.map(|kind| number(&kind["noise_of_rows"])).collect();
    // Of 280 residuals, a third of which the poses take, the noise is known to 7 %.
    assert!((noise[0] / 1e-5 - 1.0).abs() < 0.3, "{noise:?}");
    assert!((noise[1] / 1e-3 - 1.0).abs() < 1e-9, "{noise:?}");
}
