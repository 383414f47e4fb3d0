//! Real printers: runs that the project does not ship.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use super::{NAMES, Printer, wrong_distances_are_named};
use crate::support::number;

/// The folder of runs of real printers, which the project does not ship.
fn real_runs() -> Option<PathBuf> {
    let named = std::env::var_os("TAU_KLIPPER_RUNS").map(PathBuf::from);
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/klipper");
    let found = named.unwrap_or_else(|| beside.into());
    if found.is_dir() {
        return Some(found);
    }
    println!("skipped: TAU_KLIPPER_RUNS names no folder with runs of real printers");
    None
}

/// A run as recorded.
fn run(path: &Path) -> Printer {
    let found: Value = serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap();
    let towers = ["a", "b", "c"].map(|tower| found["towers"][tower].clone());
    let mut values = [number(&found["delta_radius"]); 10];
    for (k, tower) in towers.iter().enumerate() {
        values[1 + k] = number(&tower["angle"]);
        values[4 + k] = number(&tower["position_endstop"]);
        values[7 + k] = number(&tower["arm_length"]);
    }
    let steps = |value: &Value| [0, 1, 2].map(|k| number(&value[k]));
    let list = |key: &str| found[key].as_array().unwrap().clone();
    Printer {
        values,
        step: number(&found["step_dist_mm"][0]),
        heights: (list("heights").iter())
            .map(|own| (number(&own["z"]), steps(&own["pos_steps"])))
            .collect(),
        distances: (list("distances").iter())
            .map(|own| {
                let ends = [steps(&own["pos1_steps"]), steps(&own["pos2_steps"])];
                (number(&own["d"]), ends)
            })
            .collect(),
    }
}

/// A file's name, its printer, and its row of `expected.csv` by column.
type Run = (String, Printer, Vec<(String, String)>);

/// All eight.
fn runs(folder: &Path) -> Vec<Run> {
    let table = fs::read_to_string(folder.join("expected.csv")).unwrap();
    let mut lines = table.lines().map(|line| line.split(','));
    let header: Vec<&str> = lines.next().unwrap().collect();
    let rows = lines.map(|fields| {
        let own = header.iter().zip(fields);
        own.map(|(name, field)| ((*name).to_owned(), field.to_owned()))
            .collect::<Vec<_>>()
    });
    let all = rows.map(|row| (row[1].1.clone(), run(&folder.join(&row[1].1)), row));
    all.collect()
}

/// Half of the last digit in which a number is written.
fn rounding(text: &str) -> f64 {
    let digits = text.split_once('.').map_or(0, |(_, digits)| digits.len());
    0.5 * 0.1_f64.powi(i32::try_from(digits).unwrap())
}

/// At the printers' own weights, without priors: the least cost, by an independent fit to 1e-6 and by their own records
/// to their last digit, with parameters to 1e-4 mm and degrees.
#[test]
fn the_printers_own_calibrations_are_reached() {
    let Some(folder) = real_runs() else { return };
    let all = runs(&folder);
    assert_eq!(all.len(), 8);
    for (name, printer, expected) in all {
        let folder = tempfile::tempdir().unwrap();
        printer.import(folder.path());
        printer.as_the_firmware(folder.path());
        let (found, _) = printer.calibrate(folder.path(), "--keep-outliers");
        let optimum = printer.optimum(printer.free());
        let (cost, least) = (printer.cost(&found), printer.cost(&optimum));
        assert!((cost / least - 1.0).abs() < 1e-6, "{name}: {cost}, {least}");
        let of = |key: &str| expected.iter().find(|own| own.0 == key).unwrap().1.clone();
        let recorded = of("cost");
        let off = (cost - recorded.parse::<f64>().unwrap()).abs();
        assert!(
            off < 1e-6 * cost + rounding(&recorded),
            "{name}: {cost}, {recorded}"
        );
        for &index in printer.free() {
            let off = (found[index] - optimum[index]).abs();
            assert!(off < 1e-4, "{name} {}: {off}", NAMES[index]);
            let recorded = of(NAMES[index]);
            // Fields are filled up with zeros to six digits; four are known.
            let off = (found[index] - recorded.parse::<f64>().unwrap()).abs();
            assert!(off < 1e-4 + 5e-5, "{name} {}: {off}", NAMES[index]);
        }
    }
}

#[test]
fn a_wrong_distance_hardly_moves_the_edge_of_real_beds() {
    let Some(folder) = real_runs() else { return };
    let with_distances = runs(&folder)
        .into_iter()
        .filter(|own| !own.1.distances.is_empty());
    let all: Vec<_> = with_distances.collect();
    assert_eq!(all.len(), 3);
    for (_, printer, _) in all {
        let rows: Vec<usize> = (0..printer.distances.len()).collect();
        wrong_distances_are_named(&printer, &rows);
    }
}

/// With tolerances and the noise of a probe and a caliper: standard deviations, and of the basic fits, which leave one
/// residual, a word that it tells nothing where it is too large.
#[test]
fn real_printers_have_standard_deviations_and_a_verdict() {
    let Some(folder) = real_runs() else { return };
    for (name, printer, _) in runs(&folder) {
        let work = tempfile::tempdir().unwrap();
        printer.import(work.path());
        let (_, found) = printer.calibrate(work.path(), "");
        for parameter in found["parameters"].as_array().unwrap() {
            let (sigma, tolerance) = (number(&parameter["sigma"]), number(&parameter["tolerance"]));
            assert!(
                sigma > 0.0 && sigma < tolerance,
                "{name} {}: {sigma}",
                parameter["name"]
            );
        }
        let consistent = found["fit"]["status"] == "consistent";
        let why = found["fit"]["why"].to_string();
        let says = why.contains("every effect would explain it as well as any other");
        assert_eq!(
            says,
            printer.distances.is_empty() && !consistent,
            "{name}: {why}"
        );
    }
}
