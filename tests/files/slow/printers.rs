//! Runs of real printers, which the project does not ship: `TAU_KLIPPER_RUNS` names their folder, or they stand beside the
//! checkout. Each run is compared with what its firmware recorded.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;
use tau_testkit::{Table, list, number};

use crate::klipper::{NAMES, Printer, position, wrong_distances_are_named};

/// Parameters that the firmware calibrates from heights alone, and with distances.
const BASIC: &[usize] = &[0, 1, 2, 4, 5, 6];
const EXTENDED: &[usize] = &[0, 1, 2, 4, 5, 6, 7, 8, 9];

impl Printer {
    /// The firmware's cost.
    fn cost(&self, values: &[f64]) -> f64 {
        let at = |steps: &[f64; 3]| position(values, self.step, steps);
        let heights = self.heights.iter();
        let heights = heights.map(|(height, steps)| self.weight() * (at(steps).z - height).powi(2));
        let distances = self.distances.iter();
        let distances = distances.map(|(own, [a, b])| ((at(a) - at(b)).norm() - own).powi(2));
        heights.chain(distances).sum()
    }
}

/// A run as recorded.
fn run(found: &Value) -> Printer {
    let mut values = [number(&found["delta_radius"]); 10];
    for (k, tower) in ["a", "b", "c"].into_iter().enumerate() {
        let tower = &found["towers"][tower];
        for (group, key) in ["angle", "position_endstop", "arm_length"]
            .iter()
            .enumerate()
        {
            values[1 + 3 * group + k] = number(&tower[key]);
        }
    }
    let steps = |value: &Value| [0, 1, 2].map(|k| number(&value[k]));
    let height = |own: &Value| (number(&own["z"]), steps(&own["pos_steps"]));
    let ends = |own: &Value| [steps(&own["pos1_steps"]), steps(&own["pos2_steps"])];
    let distances = list(&found["distances"]).iter();
    Printer {
        values,
        step: number(&found["step_dist_mm"][0]),
        heights: list(&found["heights"]).iter().map(height).collect(),
        distances: distances
            .map(|own| (number(&own["d"]), ends(own)))
            .collect(),
    }
}

/// All eight with their names, and the table of what their firmware found; nothing where they are not at hand.
fn runs() -> Option<(Vec<(String, Printer)>, Table)> {
    let beside = concat!(env!("CARGO_MANIFEST_DIR"), "/../../shared/data/klipper");
    let folder = std::env::var_os("TAU_KLIPPER_RUNS").map_or(beside.into(), PathBuf::from);
    if !folder.is_dir() {
        println!("skipped: TAU_KLIPPER_RUNS names no folder with runs of real printers");
        return None;
    }
    let text = |name: &str| fs::read_to_string(folder.join(name)).unwrap();
    let expected = Table::parse(&text("expected.csv"));
    assert_eq!(expected.rows.len(), 8);
    let runs = expected.rows.iter().map(|row| {
        let printer = run(&serde_json::from_str(&text(&row[1])).unwrap());
        (row[1].clone(), printer)
    });
    Some((runs.collect(), expected))
}

/// Half of the last digit in which a number is written.
fn rounding(text: &str) -> f64 {
    let digits = text.split_once('.').map_or(0, |(_, digits)| digits.len());
    0.5 * 0.1_f64.powi(i32::try_from(digits).unwrap())
}

/// At the printers' own weights, without priors: cost and parameters that their firmware recorded.
#[test]
fn the_printers_own_calibrations_are_reached() {
    let Some((runs, expected)) = runs() else {
        return;
    };
    for (row, (name, printer)) in runs.iter().enumerate() {
        let (found, _) = printer.calibrated(&printer.as_the_firmware(), "--keep-outliers");
        let cost = printer.cost(&found);
        let recorded = expected.cell(row + 1, "cost");
        let off = (cost - expected.number(row + 1, "cost")).abs();
        assert!(
            off < 1e-6 * cost + rounding(recorded),
            "{name}: {cost}, {recorded}"
        );
        let free = if printer.distances.is_empty() {
            BASIC
        } else {
            EXTENDED
        };
        for &index in free {
            // Fields are filled up with zeros to six digits; four are known.
            let off = (found[index] - expected.number(row + 1, NAMES[index])).abs();
            assert!(off < 1.5e-4, "{name} {}: {off}", NAMES[index]);
        }
    }
}

#[test]
fn a_wrong_distance_hardly_moves_the_edge_of_real_beds() {
    let Some((runs, _)) = runs() else { return };
    let with_distances = runs.iter().filter(|own| !own.1.distances.is_empty());
    let with_distances: Vec<_> = with_distances.collect();
    assert_eq!(with_distances.len(), 3);
    for (_, printer) in with_distances {
        let rows = 0..printer.distances.len();
        let wrong: Vec<_> = rows
            .map(|row| (row, if row % 2 == 0 { 1.0 } else { -1.0 }))
            .collect();
        wrong_distances_are_named(printer, &["", "--loss cauchy", "--loss tukey"], &wrong);
    }
}

/// With tolerances and the noise of a probe and a caliper: standard deviations, and of the basic fits, which leave one
/// residual, a word that it tells nothing where it is too large.
#[test]
fn real_printers_have_standard_deviations_and_a_verdict() {
    let Some((runs, _)) = runs() else { return };
    for (name, printer) in runs {
        let (_, found) = printer.calibrated(&printer.imported(), "");
        for parameter in list(&found["parameters"]) {
            let [sigma, tolerance] = ["sigma", "tolerance"].map(|key| number(&parameter[key]));
            assert!(0.0 < sigma && sigma < tolerance, "{name}: {parameter}");
        }
        let reasons = list(&found["fit"]["reasons"]).iter();
        let tells_nothing = reasons.filter(|reason| reason["code"] == "T376").count() > 0;
        let consistent = found["fit"]["status"] == "consistent";
        let expected = printer.distances.is_empty() && !consistent;
        assert_eq!(tells_nothing, expected, "{name}: {}", found["fit"]);
    }
}
