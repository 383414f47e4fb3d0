//! Measurements that someone spoiled: what leaves them out, or can't foretell them, says which they are.

use serde_json::{Value, json};
use tau_testkit::robots::CABLES;
use tau_testkit::{Random, Table, Work, list, number};

/// Readings alone, of which two of four tell where the sled is.
const BELTS: &str = "--model four_belts --variant Full --measure readings --poses 60 --random --noise-drives 1e-4 --seed 5";
const DISTANCES: &str =
    "--model linear_delta --variant Full --measure heights,distances --poses 20 --random --seed 5";
const SPLIT_ALL: &str = "--variant Full --split all";

/// File, line, pose and drive of rows that are far off.
fn places(rows: &Value) -> Vec<(&str, u64, u64, Option<&str>)> {
    let place = |row| {
        let row: &Value = row;
        let [line, pose] = ["line", "pose"].map(|key| row[key].as_u64().unwrap());
        let drive = row["link"].as_str().or(row["drive"].as_str());
        (row["file"].as_str().unwrap(), line, pose, drive)
    };
    list(rows).iter().map(place).collect()
}

/// A reading that calibrates and one that is held out, 20 mm off at a noise of 0.1 mm: a search names both, on the screen, in
/// the report and for programs, and the calibration of the same model the one that it has.
#[test]
fn readings_that_are_far_off_are_named_with_their_drives() {
    let work = Work::simulated(BELTS);
    work.edit("readings.csv", |table| {
        table.add(20, "q2_m", 0.02);
        table.add(21, "q4_m", -0.02);
    });
    let said = work
        .run("discover MEASURED --out DIR/out --json DIR/found.json")
        .done();
    let found: Value = serde_json::from_str(&work.read("found.json")).unwrap();
    let expected = [
        ("readings.csv", 21, 20, Some("top_right")),
        ("readings.csv", 22, 21, Some("bottom_right")),
    ];
    assert_eq!(places(&found["gross_rows"]), expected);
    for text in [said, work.read("out/report.html")] {
        for place in [
            "readings.csv line 21, pose 20",
            "readings.csv line 22, pose 21",
        ] {
            assert!(text.contains(place), "{place}");
        }
    }
    // What the other two readings leave of an error is some of its two hundred standard deviations.
    for row in list(&found["gross_rows"]) {
        let sigmas = number(&row["sigmas"]);
        assert!((50.0..=200.0).contains(&sigmas), "{row}");
    }
    let found = work.calibrated("--variant Full");
    let named = places(&found["gross_rows"]);
    assert!(
        named.len() == 1 && expected.contains(&named[0]),
        "{named:?}"
    );
}

/// A height that is 3 mm off has a line and a pose, and no drive; lines are those of the file, blank ones among them. A command
/// of exact drives is named with its drive, and the others agree again.
#[test]
fn rows_that_are_far_off_are_named() {
    type Expected = (&'static str, u64, u64, Option<&'static str>);
    let cases: [(&str, &str, &str, f64, Expected); 2] = [
        (
            DISTANCES,
            "heights.csv",
            "height_m",
            0.003,
            ("heights.csv", 13, 11, None),
        ),
        (
            "--model four_belts --poses 60 --random --seed 1",
            "tcp_poses.csv",
            "q4_m",
            5e-3,
            ("tcp_poses.csv", 13, 11, Some("bottom_right")),
        ),
    ];
    for (simulated, file, column, by, expected) in cases {
        let work = Work::simulated(simulated);
        work.edit(file, |table| table.add(11, column, by));
        let text = work.read(&format!("measured/{file}"));
        work.write(&format!("measured/{file}"), text.replacen('\n', "\n\n", 1));
        let found = work.calibrated(SPLIT_ALL);
        assert_eq!(places(&found["gross_rows"]), [expected], "{simulated}");
        if expected.3.is_some() {
            assert_eq!(found["fit"]["status"], "consistent", "{simulated}");
            // The noise of drives is none: they are exact again.
            let kinds = list(&found["kinds"]).iter();
            let drives: Vec<&Value> = kinds.filter(|kind| kind["kind"] == "drives").collect();
            assert!(
                drives.iter().all(|kind| kind["estimated"] == false),
                "{drives:?}"
            );
        }
    }
}

/// Of a reading that is 20 mm off, an ordinary fit is rid, and one with a loss nearly; one that keeps it can't be right.
#[test]
fn readings_alone_are_treated_as_was_asked() {
    let work = Work::simulated(BELTS);
    work.edit("readings.csv", |table| table.add(21, "q2_m", 0.02));
    let treated = |asked: &str, status: &str| {
        let found = work.calibrated(&format!("--variant Full {asked}"));
        let expected = [("readings.csv", 22, 21, Some("top_right"))];
        assert_eq!(places(&found["gross_rows"]), expected, "{asked}");
        assert_eq!(found["fit"]["status"], status, "{asked}");
        number(&found["gross_rows"][0]["weight"])
    };
    assert_eq!(treated("", "consistent"), 0.0);
    let [huber, cauchy, tukey] =
        ["huber", "cauchy", "tukey"].map(|loss| treated(&format!("--loss {loss}"), "consistent"));
    assert!(huber > cauchy && cauchy > tukey && tukey == 0.0 && huber < 0.02);
    assert_eq!(treated("--keep-outliers", "inconsistent"), 1.0);

    for (asked, is_said) in [("", false), ("--keep-outliers", true)] {
        let line = format!("study MEASURED --out DIR/study --json - -q {asked}");
        let found = work.run(&line).json();
        let codes = list(&found["remark_codes"]);
        assert_eq!(
            codes.contains(&OTHER_TREATMENT.into()),
            is_said,
            "{codes:?}"
        );
    }
}

/// The search for effects leaves outliers out, whatever was asked.
const OTHER_TREATMENT: &str = "T645";

/// Half of the heights state 30 µm and half 40 µm: what they are weighed by is 35.4 µm rms, and not the 10 µm of
/// `[noise]`.
#[test]
fn noise_of_rows_is_what_they_state() {
    let work = Work::simulated(
        "--model linear_delta --variant Full --measure positions,heights --poses 60 --random --cart-poses 0",
    );
    work.edit("heights.csv", |table| {
        table.append_column("sigma_height_m", |row| ["3e-5", "4e-5"][row / 2 % 2]);
    });
    let found = work.calibrated("--variant Full");
    for (file, expected) in [
        ("heights.csv", 12.5e-10_f64.sqrt()),
        ("tcp_positions.csv", 1e-5),
    ] {
        let noise = noise_of(&found, file)[0];
        assert!((noise / expected - 1.0).abs() < 1e-9, "{file}: {noise}");
    }
}

/// Noise by which rows of a file are weighed, by quantity.
fn noise_of(found: &Value, file: &str) -> Vec<f64> {
    let kinds = list(&found["kinds"]).iter();
    let own = kinds.filter(|kind| kind["file"] == file);
    own.map(|kind| number(&kind["noise_of_rows"])).collect()
}

/// Rows that state their noise keep it where that of the others is estimated: 20 of 100 are a hundred times as rough.
#[test]
fn rows_that_state_their_noise_keep_it() {
    let work = Work::simulated(
        "--model linear_delta --measure positions --noise-drives 2e-6 --poses 100 --random --seed 4",
    );
    work.edit("tcp_positions.csv", |table| {
        let mut random = Random(4);
        for row in (5..=100).step_by(5) {
            table.add(row, "x_m", 1e-3 * random.normal());
        }
        let is_rough = |row: usize| row.is_multiple_of(5);
        table.append_column("sigma_x_m", |row| if is_rough(row) { "1e-3" } else { "" });
    });
    work.state("[noise.tcp_positions]\nposition_m = \"estimate\"\n");
    let found = work.calibrated(SPLIT_ALL);
    assert_eq!(found["gross_rows"], json!([]));
    let noise = noise_of(&found, "tcp_positions.csv");
    // Of 280 residuals, a third of which the poses take, the noise is known to 7 %.
    assert!((noise[0] / 1e-5 - 1.0).abs() < 0.3, "{noise:?}");
    assert!((noise[1] / 1e-3 - 1.0).abs() < 1e-9, "{noise:?}");
}

/// A play of 150 µm that the model lacks, at noise of some micrometres, makes no row gross: all of a file scatter so.
#[test]
fn what_a_model_lacks_makes_no_row_gross() {
    play_makes_no_row_gross(1);
}

#[track_caller]
pub(crate) fn play_makes_no_row_gross(seed: u32) {
    let found = Work::simulated(&format!(
        "--model linear_delta --random --measure heights,distances,ball-bar --random-approach \
         --effect backlash(all):gap=1.5e-4 --seed {seed}"
    ))
    .calibrated("--variant Full --force");
    assert_eq!(found["fit"]["status"], "inconsistent");
    assert_eq!(found["gross_rows"], json!([]), "{seed}");
}

/// A drive that counts wrongly is far off at most poses: more than a tenth of its readings are no gross ones, however few they
/// are of all, and what the model lacks is seen.
#[test]
fn what_a_tenth_of_a_drives_readings_share_is_not_gross() {
    let work = Work::described(CABLES).with_measured("--random --random-approach --poses 60 --seed 52 --noise-drives 1e-5 --effect length_scale(a):scale=1e-3",
    );
    let found = work.calibrated("--model DIR/own.tau --variant Full");
    assert_eq!(found["fit"]["status"], "inconsistent", "{}", found["fit"]);
    let gross = list(&found["gross_rows"]);
    assert!(gross.len() <= 5, "{gross:?}");
}

/// Of a command that is 10 mm off, exact drives make all distances from there and the height look wrong: they agree with each
/// other, and that is said. A distance that is wrong by itself is not told as a pose.
#[test]
fn a_wrong_command_is_told_by_all_the_rows_of_its_pose() {
    let simulated = "--model linear_delta --variant Full --measure heights,distances --poses 40 --random \
                     --noise-position 1e-4 --seed 13";
    let work = Work::simulated(simulated);
    let distances = work.table("measured/distances.csv");
    let [ones, others] = ["pose_a", "pose_b"].map(|column| distances.numbers(column));
    let ends: Vec<[f64; 2]> = ones.into_iter().zip(others).map(|(a, b)| [a, b]).collect();
    let count = |pose: usize| {
        ends.iter()
            .filter(|own| own.contains(&(pose as f64)))
            .count()
    };
    let pose = (1..=40).max_by_key(|&pose| count(pose)).unwrap();

    let known = ends
        .iter()
        .position(|own| !own.contains(&(pose as f64)))
        .unwrap();
    work.edit("distances.csv", |table| {
        table.add(known + 1, "distance_m", 0.01);
    });
    let found = work.calibrated(SPLIT_ALL);
    let row = &found["gross_rows"][0];
    assert_eq!(
        (&row["file"], &row["line"]),
        (&"distances.csv".into(), &(known + 2).into())
    );
    assert_eq!(
        [number(&row["pose"]), number(&row["other_pose"])],
        ends[known]
    );
    assert_eq!(list(&found["gross_rows"]).len(), 1);
    assert_eq!(found["gross_poses"], json!([]));

    let work = Work::simulated(simulated);
    work.edit("heights.csv", |table| table.add(pose, "q2_m", 0.01));
    let found = work.calibrated(SPLIT_ALL);
    let [told] = list(&found["gross_poses"]) else {
        panic!("{}", found["gross_poses"])
    };
    assert_eq!(
        (&told["file"], &told["line"]),
        (&"heights.csv".into(), &(pose + 1).into())
    );
    assert_eq!(
        (&told["pose"], &told["rows"]),
        (&pose.into(), &(count(pose) + 1).into())
    );
}

/// A calibration with the last row of a file that is held out changed, and the line of that.
fn held_out(
    simulated: &str,
    file: &str,
    variant: &str,
    change: impl Fn(&mut Table, usize),
) -> (Value, u64) {
    let clean = Work::simulated(simulated);
    let rows = clean.table(&format!("measured/{file}")).rows.len();
    // One of two neighbours is held out.
    for row in [rows, rows - 1] {
        let work = Work::simulated(simulated);
        work.edit(file, |table| change(table, row));
        let found = work.calibrated(variant);
        if found["gross_rows"] == json!([]) {
            return (found["held_out"].clone(), row as u64 + 1);
        }
    }
    panic!("both are left out")
}

#[test]
fn a_gross_height_is_named_and_figures_are_also_without_it() {
    let simulated =
        "--model linear_delta --measure heights --poses 60 --random --cart-poses 0 --seed 1";
    let clean = &Work::simulated(simulated).calibrated("--variant Full")["held_out"];
    assert_eq!(clean["gross_rows"], json!([]));
    assert!(clean["without_gross_rows"].is_null());
    let spoil = |table: &mut Table, row| table.add(row, "height_m", 1e-3);
    let (found, line) = held_out(simulated, "heights.csv", "--variant Full", spoil);
    assert_eq!(
        places(&found["gross_rows"]),
        [("heights.csv", line, line - 1, None)]
    );
    // A hundred standard deviations, less what the parameters leave open.
    assert!(
        number(&found["gross_rows"][0]["sigmas"]) > 30.0,
        "{found:#}"
    );
    let [all, others] = [&found, &found["without_gross_rows"]].map(|own| &own["predicted"][0]);
    assert_eq!(
        (number(&all["rows"]), number(&others["rows"])),
        (30.0, 29.0)
    );
    assert!(
        number(&all["max_m"]) > 9e-4 && number(&all["rms_m"]) > 1e-4,
        "{all}"
    );
    assert!(
        number(&others["max_m"]) < 2e-4 && number(&others["rms_m"]) < 5e-5,
        "{others}"
    );
}

/// Of a pose with a misread drive nothing is foretold.
#[test]
fn a_misread_drive_is_named_by_its_link() {
    let simulated = "--model hexapod --measure positions --poses 60 --random --cart-poses 0 --noise-drives 1e-5 --seed 2";
    let spoil = |table: &mut Table, row| table.add(row, "q3_m", 1e-3);
    let (found, line) = held_out(simulated, "tcp_positions.csv", "--variant Full", spoil);
    assert_eq!(
        places(&found["gross_rows"]),
        [("tcp_positions.csv", line, line - 1, Some("leg3"))]
    );
    let rows =
        [&found, &found["without_gross_rows"]].map(|own| number(&own["predicted"][0]["rows"]));
    assert_eq!(rows, [90.0, 87.0]);
}
