//! Gross readings among measurements that are held out.

use std::fs;

use serde_json::{Value, json};
use tau::calibration::Options;
use tau::measurements::{Folder, PlateKind, Split};
use tau::simulation::{Measure, Simulation, simulate};
use tau::unknown_poses::{HeldOut, RowDivision, calibrate};

use crate::support::CABLES;
use crate::support::{robot, simulation};
use crate::support::{spoil, tau_in};
use tau::Setup;

const NOISE_M: f64 = 1e-5;

/// Measurements of a simulated folder that are held out, and the lines of its gross rows.
fn held_out(
    (name, variant, more): (&str, &str, &str),
    kind: PlateKind,
    seed: u64,
    spoil: impl FnOnce(&mut Folder, &RowDivision) -> usize,
) -> (HeldOut, usize) {
    let (robot, file) = robot(name, more);
    let measures = [Measure::Rows(kind)];
    let simulated = simulate(&Simulation {
        seed,
        ..simulation(&robot, &file, variant, &measures, 60)
    });
    let mut folder = simulated.unwrap().folder;
    let division = RowDivision::of(&folder, Split::Alternate);
    let line = spoil(&mut folder, &division);
    let variant = robot.variant(variant).unwrap();
    let options = Options::default();
    let found = calibrate(
        Setup::new(&robot, variant, &file, &folder),
        &division,
        &options,
    )
    .unwrap();
    assert!(found.gross.is_empty(), "{:?}", found.gross);
    (found.held_out.unwrap(), line)
}

#[test]
fn a_gross_height_is_named_and_figures_are_also_without_it() {
    let (found, line) = held_out(
        ("linear_delta", "Nominal", ""),
        PlateKind::Height,
        1,
        |folder, division| {
            let is_new = |pose: &u32| division.validation.contains(pose);
            let mut rows = folder.plate_rows.iter_mut();
            let row = rows.rfind(|row| is_new(&row.pose)).unwrap();
            *row.values[0].as_mut().unwrap() += 1e-3;
            row.line
        },
    );
    let named: Vec<(&str, usize)> = (found.gross.iter())
        .map(|row| (row.place.file, row.place.line))
        .collect();
    assert_eq!(named, [("heights.csv", line)]);
    // A hundred standard deviations, less what the parameters leave open.
    assert!(found.gross[0].sigmas > 30.0, "{:?}", found.gross);
    let [all] = &found.all.predicted[..] else {
        panic!("{found:?}")
    };
    let without = found.without_gross.unwrap();
    let [others] = &without.predicted[..] else {
        panic!("{without:?}")
    };
    assert_eq!((all.rows, others.rows), (30, 29));
    assert!(all.max > 9e-4 && all.rms > 1e-4, "{all:?}");
    assert!(
        others.max < 2e-4 && others.rms < 5.0 * NOISE_M,
        "{others:?}"
    );
}

/// Of a pose with a misread drive nothing is foretold.
#[test]
fn a_misread_drive_is_named_by_its_link() {
    let (found, line) = held_out(
        ("stewart", "Full", "[drives]\nnoise_m = 1e-5\n"),
        PlateKind::Position,
        2,
        |folder, division| {
            let is_new = |pose: &u32| division.validation.contains(pose);
            let mut rows = folder.plate_rows.iter_mut();
            let row = rows.rfind(|row| is_new(&row.pose)).unwrap();
            row.commands_m[2] += 1e-3;
            row.line
        },
    );
    let named: Vec<(usize, Option<usize>)> = (found.gross.iter())
        .map(|row| (row.place.line, row.place.drive))
        .collect();
    assert_eq!(named, [(line, Some(2))]);
    let without = found.without_gross.unwrap();
    let rows = [found.all, without].map(|own| own.predicted[0].rows);
    assert_eq!(rows, [90, 87]);
}

/// Where nothing is gross nothing is named, but in one folder of a hundred.
#[test]
fn clean_rows_are_not_named() {
    let nothing = |_: &mut Folder, _: &RowDivision| 0;
    let named = (0..40).filter(|seed| {
        let robot = ("linear_delta", "Nominal", "");
        let (found, _) = held_out(robot, PlateKind::Height, 100 + seed, nothing);
        assert_eq!(found.gross.is_empty(), found.without_gross.is_none());
        !found.gross.is_empty()
    });
    // More than three of forty once in a thousand runs.
    assert!(named.count() <= 3);
}

/// From files to the screen and the JSON.
#[test]
fn the_command_lists_them() {
    let folder = tempfile::tempdir().unwrap();
    let model = "--model ROBOTS/linear_delta.tau --variant Nominal";
    tau_in(
        folder.path(),
        &format!(
            "tau simulate {model} --measure heights --poses 60 --random --track-points 0 --cart-poses 0 --out DIR/measured"
        ),
    )
    .done();
    let calibrate = format!("tau calibrate DIR/measured {model} --out DIR/out");
    let found = || tau_in(folder.path(), &format!("{calibrate} --json - -q")).json();
    let clean = found();
    assert_eq!(clean["held_out"]["gross_rows"], json!([]));
    assert!(clean["held_out"]["without_gross_rows"].is_null());
    // One of two neighbours is held out.
    spoil(folder.path(), "heights.csv", 20, "height_m", 1e-3);
    let mut spoilt = found();
    if spoilt["gross_rows"] != json!([]) {
        spoil(folder.path(), "heights.csv", 20, "height_m", -1e-3);
        spoil(folder.path(), "heights.csv", 21, "height_m", 1e-3);
        spoilt = found();
    }
    let found = spoilt;
    let gross = found["held_out"]["gross_rows"].as_array().unwrap();
    assert_eq!(gross.len(), 1, "{found:#}");
    assert_eq!(gross[0]["file"], "heights.csv");
    let rms = |own: &Value| own["predicted"][0]["rms_m"].as_f64().unwrap();
    let held_out = &found["held_out"];
    assert!(rms(&held_out["without_gross_rows"]) < 0.5 * rms(held_out));
    let said = tau_in(folder.path(), &calibrate).done();
    let line = gross[0]["line"].as_u64().unwrap();
    let (_, said) = said.split_once("Held-out rows far off").expect(&said);
    assert!(
        said.contains(&format!("heights.csv line {line}, pose")),
        "{said}"
    );
}

/// A drive that counts wrongly is far off at most poses: more than a tenth of its readings are no gross ones, however few they
/// are of all, and what the model lacks is seen.
#[test]
fn what_a_tenth_of_a_drives_readings_share_is_not_gross() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("cables.tau"), CABLES).unwrap();
    let line = "tau simulate --model DIR/cables.tau --out DIR/measured --random --random-approach --poses 100 --seed 52 \
                --noise-drives 1e-5 --effect length_scale(a):scale=1e-3";
    tau_in(folder.path(), line).done();
    let line =
        "tau calibrate DIR/measured --model DIR/cables.tau --variant Full --out DIR/out --json -";
    let found = tau_in(folder.path(), line).json();
    assert_eq!(found["fit"]["status"], "inconsistent", "{}", found["fit"]);
    let gross = found["gross_rows"].as_array().unwrap();
    assert!(gross.len() <= 5, "{gross:?}");
}
