//! Three runs of a real four-line machine (MIT, see `fixtures/hangprinter`).

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use serde_json::Value;

use crate::support::effects;
use crate::support::{number, tau_in};

const FIXTURES: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/hangprinter");
const RUNS: [&str; 3] = ["2021-12-14", "2021-12-16", "2022-04-12"];

fn text(path: &str) -> String {
    fs::read_to_string(Path::new(FIXTURES).join(path)).unwrap()
}

/// Calibrates a folder with all of its rows.
fn calibrate(work: &Path, folder: &str, model: &str, variant: &str, more: &str) -> Value {
    let line = format!(
        "tau calibrate {folder} --model {model} --variant {variant} --split all --out DIR/out --json - {more}"
    );
    tau_in(work, &line).json()
}

/// Run 2022-04-12 with positions taken for exact, on the bed at height 0, but for a pose: closures alone have noise, and
/// nothing is known before.
fn as_exact(work: &Path, without: Option<u32>) {
    let on_bed: Vec<String> = (text("2022-04-12/heights.csv").lines().skip(1))
        .map(|line| line.split(',').next().unwrap().to_owned())
        .collect();
    let positions = text("2022-04-12/tcp_positions.csv");
    let mut rows = vec![];
    for line in positions.lines() {
        let mut cells: Vec<&str> = line.split(',').take(8).collect();
        if on_bed.iter().any(|pose| pose == cells[0]) {
            cells[7] = "0";
        }
        if without.is_none_or(|pose| pose.to_string() != cells[0]) {
            rows.push(cells.join(","));
        }
    }
    fs::create_dir_all(work.join("exact")).unwrap();
    fs::write(work.join("exact/tcp_positions.csv"), rows.join("\n")).unwrap();
    let file = "robot = \"Hangprinter\"\n[noise.tcp_positions]\nposition_m = 1e-6\n[noise.links]\nlength_m = \"estimate\"\n";
    fs::write(work.join("exact/robot.toml"), file).unwrap();
    let mut model = String::new();
    for line in text("hangprinter.tau").lines() {
        // Tolerances that say nothing.
        model += &match line.split_once(" tol ") {
            Some((before, after)) => {
                let unit = after.trim_end_matches(';').split_once(' ').unwrap().1;
                format!("{before} tol 1000000 {unit};\n")
            }
            None => format!("{line}\n"),
        };
    }
    fs::write(work.join("exact/wide.tau"), model).unwrap();
}

/// Root mean square of the closures (mm).
fn closure_rms_mm(found: &Value) -> f64 {
    let files = found["fit"]["by_file"].as_array().unwrap();
    let links = files.iter().find(|own| own["file"] == "links").unwrap();
    1e3 * number(&links["rms"])
}

/// The published data's own figures, of a fit by other hands.
#[test]
fn closures_are_met_as_well_as_they_can_be() {
    let work = tempfile::tempdir().unwrap();
    let fit = |variant: &str, more: &str| {
        calibrate(
            work.path(),
            "DIR/exact",
            "DIR/exact/wide.tau",
            variant,
            more,
        )
    };
    as_exact(work.path(), None);
    for (variant, expected) in [
        ("Anchors", 6.49),
        ("Radius", 3.32),
        ("Radii", 2.56),
        ("Full", 2.20),
    ] {
        let found = fit(variant, "--keep-outliers");
        let rms = closure_rms_mm(&found);
        assert!((rms - expected).abs() < 0.01, "{variant}: {rms}");
        if variant == "Full" {
            let parameters = found["parameters"].as_array().unwrap();
            let build_up = parameters
                .iter()
                .find(|own| own["name"] == "build_up")
                .unwrap();
            // mm² of the radius squared per mm of line.
            assert!(
                (1e3 * number(&build_up["value"]) - 0.077).abs() < 1e-3,
                "{build_up}"
            );
            assert!(
                (1e3 * number(&build_up["sigma"]) - 0.011).abs() < 1e-3,
                "{build_up}"
            );
        }
    }
    let found = fit("Full", "");
    assert_eq!(
        found["gross_rows"][0]["pose"], 18,
        "{}",
        found["gross_rows"]
    );
    as_exact(work.path(), Some(18));
    let rms = closure_rms_mm(&fit("Full", "--keep-outliers"));
    assert!((rms - 1.67).abs() < 0.01, "{rms}");
}

/// Noise (m) found, by file and kind.
fn noise(found: &Value) -> BTreeMap<(String, String), f64> {
    let kinds = found["kinds"].as_array().unwrap().iter();
    let word = |value: &Value| value.as_str().unwrap().to_owned();
    kinds
        .map(|own| {
            (
                (word(&own["file"]), word(&own["kind"])),
                number(&own["noise"]),
            )
        })
        .collect()
}

/// Positions have noise of their own, by axis and by source: about a millimetre across the camera's view and twice as
/// much along it, as much as the lines' own; a position wrong by 13 mm is left out. Most parameters of
/// two runs agree to three standard deviations, and all to eight: between runs the machine was taken down and set up.
#[test]
fn three_runs_side_by_side() {
    let work = tempfile::tempdir().unwrap();
    let mut runs = vec![];
    for run in RUNS {
        let model = format!("{FIXTURES}/hangprinter.tau");
        let found = calibrate(
            work.path(),
            &format!("{FIXTURES}/{run}"),
            &model,
            "Full",
            "",
        );
        assert_eq!(found["fit"]["status"], "consistent", "{run}");
        let noise = noise(&found);
        let of = |file: &str, kind: &str| noise[&(file.to_owned(), kind.to_owned())];
        let lines = of("links", "length");
        assert!((0.5e-3..1.1e-3).contains(&lines), "{run}: {lines}");
        for axis in ["x", "y", "z"] {
            let sigma = of("tcp_positions.csv", axis);
            assert!(sigma < 2.6e-3, "{run} {axis}: {sigma}");
        }
        if run != "2021-12-16" {
            assert!(
                of("tcp_positions.csv", "z") > of("tcp_positions.csv", "y"),
                "{run}"
            );
        }
        let parameters: BTreeMap<String, [f64; 2]> =
            (found["parameters"].as_array().unwrap().iter())
                .map(|own| {
                    let name = own["name"].as_str().unwrap().to_owned();
                    (name, [number(&own["value"]), number(&own["sigma"])])
                })
                .collect();
        if run == "2022-04-12" {
            let gross = found["gross_rows"].as_array().unwrap();
            assert_eq!(gross[0]["pose"], 18);
            assert_eq!(gross[0]["file"], "tcp_positions.csv");
        }
        runs.push((run, parameters));
    }
    let mut off = vec![];
    for (index, (_, one)) in runs.iter().enumerate() {
        for (_, other) in &runs[index + 1..] {
            off.extend(one.iter().map(|(name, [value, sigma])| {
                let [others, sigma_of_other] = other[name];
                (value - others).abs() / sigma.hypot(sigma_of_other)
            }));
        }
    }
    off.sort_by(f64::total_cmp);
    assert!(
        off[off.len() / 2] < 3.0 && off[off.len() - 1] < 8.0,
        "{off:?}"
    );
}

/// The file that one run calibrated, on all three: consistent with itself, at the noise that its calibration found; others
/// differ from it by some standard deviations of the parameters, because the machine was set up anew, and no row of theirs is left
/// out for that but the position that is wrong by 13 mm.
#[test]
fn what_a_run_says_of_the_others() {
    let work = tempfile::tempdir().unwrap();
    let model = format!("{FIXTURES}/hangprinter.tau");
    let own = "2021-12-16";
    let calibrated = calibrate(
        work.path(),
        &format!("{FIXTURES}/{own}"),
        &model,
        "Full",
        "",
    );
    let of_calibration = noise(&calibrated);
    for run in RUNS {
        let line = format!(
            "tau evaluate {FIXTURES}/{run} --model {model} --variant Full --robot DIR/out/robot.toml --json -"
        );
        let found = tau_in(work.path(), &line).json();
        let fit = &found["fit"];
        let why = fit["why"].to_string();
        if run == own {
            assert_eq!(fit["status"], "consistent", "{found:#}");
            for (kind, sigma) in noise(&found) {
                // Tolerances stand about what was found, no more about the drawing; of ten residuals beyond what poses
                // follow, a standard deviation is known to a quarter.
                let ratio = sigma / of_calibration[&kind];
                assert!((0.5..2.0).contains(&ratio), "{kind:?}: {ratio}");
            }
        } else {
            assert_eq!(fit["status"], "inconsistent", "{run}: {found:#}");
            let mut sigmas: Vec<f64> = (found["moved"].as_array().unwrap().iter())
                .map(|own| number(&own["sigmas"]).abs())
                .collect();
            sigmas.sort_by(f64::total_cmp);
            assert!(
                sigmas[sigmas.len() / 2] < 3.0 && sigmas[sigmas.len() - 1] < 8.0,
                "{run}: {sigmas:?}"
            );
            assert!(
                why.contains("Other parameters would take away"),
                "{run}: {why}"
            );
        }
        for ((file, kind), sigma) in noise(&found) {
            assert!(
                (2e-5..4e-3).contains(&sigma),
                "{run}, {file}, {kind}: {sigma}"
            );
        }
        let gross: Vec<_> = (found["gross_rows"].as_array().unwrap().iter())
            .map(|row| row["pose"].as_u64().unwrap())
            .collect();
        if run == "2022-04-12" {
            assert_eq!(gross[0], 18);
        } else {
            assert!(gross.len() <= 3, "{run}: {gross:?}");
        }
    }
}

/// From anchors alone: the radius of drums and build-up of line on them, and no stretch, though forces were measured and
/// a line of plastic may stretch a hundred times as much as a rod of steel.
#[test]
fn drums_and_what_they_wind_are_named() {
    let work = tempfile::tempdir().unwrap();
    let stretch = "effect link_compliance on link { param strain: 1/N tol 1e-4 1/N; length += length * strain * tension; }";
    fs::write(work.path().join("stretch.tau"), stretch).unwrap();
    let line = format!(
        "tau discover {FIXTURES}/2022-04-12 --model {FIXTURES}/hangprinter.tau --base Anchors --effects DIR/stretch.tau \
         --out DIR/out --json -"
    );
    let found = tau_in(work.path(), &line).json();
    assert_eq!(found["status"], "explained");
    let named = effects(&found);
    for name in ["drum_radius(all)", "line_buildup(all)"] {
        assert!(named.iter().any(|own| own == name), "{named:?}");
    }
    // Radius and build-up of single drums may differ from those of all.
    let is_of_drums = |name: &String| {
        let effects = ["drum_radius(", "line_buildup("];
        effects.iter().any(|effect| name.starts_with(effect))
    };
    assert!(named.iter().all(is_of_drums), "{named:?}");
    // A stretch by the measured forces was in sight.
    let detectable = found["detectable"].as_array().unwrap();
    assert!(
        detectable
            .iter()
            .any(|own| own["name"] == "link_compliance")
    );
    let rms = |when: &str| number(&found["validation"][when]["rms_um"]);
    assert!(rms("before") > 3.0 * rms("after"));
}

/// Cells of a table's row in the documentation that begins with some words, one for each run.
fn cells(page: &str, first: &str) -> Vec<String> {
    let mut rows = page.lines().filter_map(|line| line.strip_prefix("| "));
    let row = rows.find_map(|row| row.strip_prefix(first)?.strip_prefix(" | "));
    let row = row.unwrap_or_else(|| panic!("no row `{first}`"));
    let cells = row.trim_end_matches('|').split('|');
    cells.map(|cell| cell.trim().to_owned()).collect()
}

/// The page's table of what was found, run by run, is what the program says.
#[test]
fn what_the_page_says_was_found_is_found() {
    let page = fs::read_to_string(Path::new(FIXTURES).join("../../../docs/real-machines.md"));
    let page = page.unwrap();
    let (_, page) = page.split_once("### The same, found").unwrap();
    let work = tempfile::tempdir().unwrap();
    for (column, run) in RUNS.into_iter().enumerate() {
        let line = format!(
            "tau discover {FIXTURES}/{run} --model {FIXTURES}/hangprinter.tau --base Anchors --out DIR/{run} --json -"
        );
        let found = tau_in(work.path(), &line).json();
        assert_eq!(found["status"], "explained", "{run}");
        let mut told = vec![];
        for (name, unit, scale) in [
            ("drum_radius", " (%)", 1e2),
            ("line_buildup", " (10⁻⁶ per rad)", 1e6),
        ] {
            for place in ["all", "a", "b", "c", "d"] {
                let row = format!("`{name}({place})`{unit}");
                if !page.contains(&row) || cells(page, &row)[column] == "–" {
                    continue;
                }
                told.push(format!("{name}({place})"));
                let own = found["effects"].as_array().unwrap().iter();
                let mut own = own.filter(|own| own["name"] == name && own["place"] == place);
                let effect = own.next().unwrap_or_else(|| panic!("{run}: {row}"));
                let parameters = effect["parameters"].as_object().unwrap();
                let parameter = parameters.values().next().unwrap();
                let of = |key: &str| scale * number(&parameter[key]);
                let says = format!("{:.2} ± {:.2}", of("value"), of("sigma"));
                assert_eq!(cells(page, &row)[column], says, "{run}: {row}");
            }
        }
        told.sort();
        assert_eq!(told, effects(&found), "{run}");
        let rests = &found["validation"];
        for (row, rest_um) in [
            (
                "mean rest of held-out poses, `Anchors` (mm)",
                &rests["before"]["mean_um"],
            ),
            (
                "the same with what was found (mm)",
                &rests["after"]["mean_um"],
            ),
            ("what noise would leave (mm)", &found["noise_floor_um"]),
        ] {
            let says = format!("{:.2}", 1e-3 * number(rest_um));
            assert_eq!(cells(page, row)[column], says, "{run}: {row}");
        }
    }
}
