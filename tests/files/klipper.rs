//! Delta printers: their firmware's files, read, calibrated and written back.

mod export;
mod import;
mod reader;
mod real;

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use nalgebra::{DMatrix, DVector, Matrix2, Vector2, Vector3};
use serde_json::Value;

use crate::support::{number, tau_in};

/// Parameters in the order of [`Printer::values`].
const NAMES: [&str; 10] = [
    "radius",
    "angle_a",
    "angle_b",
    "angle_c",
    "endstop_a",
    "endstop_b",
    "endstop_c",
    "arm_a",
    "arm_b",
    "arm_c",
];
/// Those that the firmware calibrates from heights alone.
const BASIC: [usize; 6] = [0, 1, 2, 4, 5, 6];
/// Those that it calibrates with distances.
const EXTENDED: [usize; 9] = [0, 1, 2, 4, 5, 6, 7, 8, 9];
/// Weight of a height against a distance in the firmware's cost.
const MEASURE_WEIGHT: f64 = 0.5;

/// A printer and its measurements, mm and degrees.
#[derive(Clone)]
struct Printer {
    values: [f64; 10],
    step: f64,
    heights: Vec<(f64, [f64; 3])>,
    distances: Vec<(f64, [[f64; 3]; 2])>,
}

/// Where the nozzle stands (mm): the spheres about the joints of the carriages meet, of two points in the lower one.
/// Differences of the spheres' equations are linear, which leaves one equation of second degree in z.
fn position(values: &[f64], step: f64, steps: &[f64; 3]) -> Vector3<f64> {
    let radius = values[0];
    let joints = [0, 1, 2].map(|k| {
        let (angle, endstop, arm) = (values[1 + k].to_radians(), values[4 + k], values[7 + k]);
        let height = endstop + (arm * arm - radius * radius).sqrt() - steps[k] * step;
        Vector3::new(radius * angle.cos(), radius * angle.sin(), height)
    });
    let square = |k: usize| joints[k].norm_squared() - values[7 + k] * values[7 + k];
    let row = |k: usize| 2.0 * (joints[k] - joints[0]);
    let left = Matrix2::new(row(1).x, row(1).y, row(2).x, row(2).y)
        .try_inverse()
        .unwrap();
    // (x, y) = foot + slope·z.
    let foot = left * Vector2::new(square(1) - square(0), square(2) - square(0));
    let slope = left * Vector2::new(-row(1).z, -row(2).z);
    let off = foot - joints[0].xy();
    let a = slope.norm_squared() + 1.0;
    let b = slope.dot(&off) - joints[0].z;
    let c = off.norm_squared() + joints[0].z.powi(2) - values[7].powi(2);
    let z = (-b - (b * b - a * c).sqrt()) / a;
    let flat = foot + slope * z;
    Vector3::new(flat.x, flat.y, z)
}

/// Steps at which the nozzle stands at a position.
fn steps_at(values: &[f64], step: f64, at: Vector3<f64>) -> [f64; 3] {
    [0, 1, 2].map(|k| {
        let (radius, arm) = (values[0], values[7 + k]);
        let (sine, cosine) = values[1 + k].to_radians().sin_cos();
        let across = (radius * cosine - at.x).powi(2) + (radius * sine - at.y).powi(2);
        let top = values[4 + k] + (arm * arm - radius * radius).sqrt();
        (top - at.z - (arm * arm - across).sqrt()) / step
    })
}

impl Printer {
    /// Weight of the square of a height against that of a distance.
    fn weight(&self) -> f64 {
        let (heights, distances) = (self.heights.len() as f64, self.distances.len() as f64);
        if distances > 0.0 {
            distances / (MEASURE_WEIGHT * heights)
        } else {
            1.0
        }
    }

    /// Residuals of the firmware's cost.
    fn residuals(&self, values: &[f64]) -> DVector<f64> {
        let at = |steps: &[f64; 3]| position(values, self.step, steps);
        let weight = self.weight().sqrt();
        let heights = self
            .heights
            .iter()
            .map(|(height, steps)| weight * (at(steps).z - height));
        let distances = self.distances.iter();
        let distances = distances.map(|(distance, [a, b])| (at(a) - at(b)).norm() - distance);
        DVector::from_iterator(
            self.heights.len() + self.distances.len(),
            heights.chain(distances),
        )
    }

    fn cost(&self, values: &[f64]) -> f64 {
        self.residuals(values).norm_squared()
    }

    /// Parameters at the least cost, by Gauss and Newton's method with differences.
    fn optimum(&self, free: &[usize]) -> Vec<f64> {
        let mut values = self.values.to_vec();
        for _ in 0..20 {
            let base = self.residuals(&values);
            let columns: Vec<DVector<f64>> = (free.iter())
                .map(|&index| {
                    let at = |step: f64| {
                        let mut moved = values.clone();
                        moved[index] += step;
                        self.residuals(&moved)
                    };
                    (at(1e-4) - at(-1e-4)) / 2e-4
                })
                .collect();
            let move_by = DMatrix::from_columns(&columns)
                .svd(true, true)
                .solve(&base, 1e-12)
                .unwrap();
            for (&index, step) in free.iter().zip(move_by.iter()) {
                values[index] -= step;
            }
        }
        values
    }

    /// Factors that its firmware fits.
    fn free(&self) -> &'static [usize] {
        if self.distances.is_empty() {
            &BASIC
        } else {
            &EXTENDED
        }
    }

    /// The configuration as the firmware keeps it: parameters and measurements in the saved block.
    fn config(&self) -> String {
        let value = |name: &str| self.values[NAMES.iter().position(|own| *own == name).unwrap()];
        let mut text = "[printer]\nkinematics: delta\nmax_velocity: 300  # mm/s\n".to_owned();
        for tower in ["a", "b", "c"] {
            let _ = write!(
                text,
                "\n[stepper_{tower}]\nstep_pin: PE3\nmicrosteps: 16\nrotation_distance: {}\n",
                3200.0 * self.step
            );
        }
        text += "\n[delta_calibrate]\nradius: 140\n\n\
            #*# <---------------------- SAVE_CONFIG ---------------------->\n\
            #*# DO NOT EDIT THIS BLOCK OR BELOW. The contents are auto-generated.\n#*#\n";
        let _ = writeln!(
            text,
            "#*# [printer]\n#*# delta_radius = {:.6}",
            value("radius")
        );
        for tower in ["a", "b", "c"] {
            let _ = writeln!(
                text,
                "#*#\n#*# [stepper_{tower}]\n#*# angle = {:.6}\n#*# arm_length = {:.6}\n#*# position_endstop = {:.6}",
                value(&format!("angle_{tower}")),
                value(&format!("arm_{tower}")),
                value(&format!("endstop_{tower}"))
            );
        }
        text += "#*#\n#*# [delta_calibrate]\n";
        let list = |steps: &[f64; 3]| format!("{:.3},{:.3},{:.3}", steps[0], steps[1], steps[2]);
        for (index, (height, steps)) in self.heights.iter().enumerate() {
            let own = list(steps);
            let _ = writeln!(
                text,
                "#*# height{index} = {height}\n#*# height{index}_pos = {own}"
            );
        }
        for (index, (distance, [a, b])) in self.distances.iter().enumerate() {
            let _ = writeln!(
                text,
                "#*# distance{index} = {distance}\n#*# distance{index}_pos1 = {}\n#*# distance{index}_pos2 = {}",
                list(a),
                list(b)
            );
        }
        text
    }

    /// The printer's folder `DIR/printer`, made of its configuration by the program.
    fn import(&self, folder: &Path) {
        fs::write(folder.join("printer.cfg"), self.config()).unwrap();
        tau_in(
            folder,
            "tau import klipper DIR/printer.cfg --out DIR/printer",
        )
        .done();
    }

    /// Makes the folder's problem that of the firmware: no tolerances, heights and distances by its weights.
    fn as_the_firmware(&self, folder: &Path) {
        let path = folder.join("printer/printer.tau");
        let text = fs::read_to_string(&path).unwrap();
        let mut words: Vec<String> = vec![];
        for line in text.lines() {
            words.push(match line.find(" tol ") {
                Some(at) if line.ends_with("mm;") => format!("{} tol 1 km;", &line[..at]),
                Some(at) => format!("{} tol 3 rad;", &line[..at]),
                None => line.to_owned(),
            });
        }
        fs::write(path, words.join("\n")).unwrap();
        let noise = 1e-4;
        let heights = noise / self.weight().sqrt();
        let text = format!(
            "robot = \"Printer\"\n[noise.heights]\nheight_m = {heights:?}\n[noise.distances]\ndistance_m = {noise:?}\n"
        );
        fs::write(folder.join("printer/robot.toml"), text).unwrap();
    }

    /// Parameters (mm, degrees) of a calibration, and its JSON.
    fn calibrate(&self, folder: &Path, more: &str) -> (Vec<f64>, Value) {
        let variant = if self.distances.is_empty() {
            "Basic"
        } else {
            "Extended"
        };
        let line = format!(
            "tau calibrate DIR/printer --model DIR/printer/printer.tau --variant {variant} --split all --out DIR/found \
             --json - {more}"
        );
        let found = tau_in(folder, &line).json();
        let mut values = self.values.to_vec();
        for parameter in found["parameters"].as_array().unwrap() {
            let name = parameter["name"].as_str().unwrap();
            let own = number(&parameter["value"]);
            let index = NAMES.iter().position(|known| *known == name).unwrap();
            values[index] = if parameter["unit"] == "m" {
                1000.0 * own
            } else {
                own.to_degrees()
            };
        }
        (values, found)
    }
}

/// A printer that does not exist, with seven heights and twelve distances about the middle, and the parameters by which
/// it knows itself off from those it has.
fn imagined() -> (Printer, [f64; 10]) {
    let truth = [
        161.3, 210.08, 329.85, 90.0, 419.6, 420.4, 418.9, 344.6, 345.2, 344.9,
    ];
    let known = [
        162.0, 210.0, 330.0, 90.0, 419.0, 420.0, 419.5, 345.0, 345.0, 345.0,
    ];
    let step = 0.0125;
    let on_circle = |radius: f64, degrees: f64| {
        let (sine, cosine) = degrees.to_radians().sin_cos();
        Vector3::new(radius * cosine, radius * sine, 0.0)
    };
    let at = |place: Vector3<f64>| steps_at(&truth, step, place);
    let mut heights = vec![(0.0, at(Vector3::zeros()))];
    for (index, share) in [0.95, 0.9, 0.85, 0.7, 0.75, 0.8].iter().enumerate() {
        heights.push((
            0.0,
            at(on_circle(140.0 * share, 90.0 + 60.0 * index as f64)),
        ));
    }
    let mut distances = vec![];
    for index in 0..6 {
        let degrees = 210.0 + 60.0 * f64::from(index);
        let ends = [on_circle(4.5, degrees), on_circle(69.5, degrees)];
        let beside = on_circle(65.0, degrees);
        let across = [4.5, 69.5].map(|radius| beside + on_circle(radius, degrees + 120.0));
        for [a, b] in [ends, across] {
            distances.push(((a - b).norm(), [at(a), at(b)]));
        }
    }
    let printer = Printer {
        values: known,
        step,
        heights,
        distances,
    };
    (printer, truth)
}

/// Steps are written to a thousandth, 12.5 nm, so that the truth comes back to some thousand of these.
#[test]
fn an_imagined_printer_is_found_from_its_firmwares_file() {
    let (printer, truth) = imagined();
    let folder = tempfile::tempdir().unwrap();
    printer.import(folder.path());
    printer.as_the_firmware(folder.path());
    let (found, _) = printer.calibrate(folder.path(), "");
    for (index, name) in NAMES.iter().enumerate() {
        assert!(
            (found[index] - truth[index]).abs() < 1e-4,
            "{name}: {}",
            found[index]
        );
    }
}

/// Step lengths stand by themselves in old configurations, and nothing is saved.
#[test]
fn old_configurations_are_read() {
    let (printer, _) = imagined();
    let folder = tempfile::tempdir().unwrap();
    let text: Vec<String> = (printer.config().lines())
        .filter(|line| !line.contains("SAVE_CONFIG") && !line.contains("DO NOT EDIT"))
        .filter(|line| !line.starts_with("microsteps"))
        .map(|line| line.trim_start_matches("#*#").trim_start().to_owned())
        .map(|line| line.replace("rotation_distance: 40", "step_distance: 0.0125"))
        .collect();
    fs::write(folder.path().join("old.cfg"), text.join("\n")).unwrap();
    fs::write(folder.path().join("new.cfg"), printer.config()).unwrap();
    for name in ["old", "new"] {
        tau_in(
            folder.path(),
            &format!("tau import klipper DIR/{name}.cfg --out DIR/{name}"),
        )
        .done();
    }
    for file in ["heights.csv", "distances.csv", "readings.csv", "robot.toml"] {
        let of = |name: &str| fs::read_to_string(folder.path().join(name).join(file)).unwrap();
        assert_eq!(of("old"), of("new"), "{file}");
    }
}

#[test]
fn seven_factors_on_seven_points_are_refused() {
    let (mut printer, _) = imagined();
    printer.distances.clear();
    let folder = tempfile::tempdir().unwrap();
    printer.import(folder.path());
    let path = folder.path().join("printer/printer.tau");
    let text = fs::read_to_string(&path).unwrap();
    let seven = "variant Seven = Extended hold arm_b, arm_c;\n    variant Basic";
    fs::write(&path, text.replace("variant Basic", seven)).unwrap();
    let line = "DIR/printer --model DIR/printer/printer.tau --variant Seven --split all";
    let refused = tau_in(
        folder.path(),
        &format!("tau calibrate {line} --out DIR/found"),
    );
    assert_eq!(refused.code, 2);
    let message = "7 residuals of 7 poses for 7 factors: the fit would repeat its input";
    assert!(refused.err.contains(message), "{}", refused.err);
    assert!(
        refused.err.contains("measure at least 8 poses"),
        "{}",
        refused.err
    );
    assert_eq!(tau_in(folder.path(), &format!("tau check {line}")).code, 1);
}

/// Largest way (mm) by which the edge of the bed moves between two sets of parameters: where one takes it to be, the other
/// puts it elsewhere.
fn moved_edge(from: &[f64], to: &[f64], step: f64) -> f64 {
    let around = (0..24).map(|k| {
        let (sine, cosine) = (15.0 * f64::from(k)).to_radians().sin_cos();
        let at = Vector3::new(140.0 * cosine, 140.0 * sine, 0.0);
        (position(to, step, &steps_at(from, step, at)) - at).norm()
    });
    around.fold(0.0, f64::max)
}

/// Makes each distance wrong by 1 mm, either way: the edge of the bed moves by no more than 1.2 mm, and by default the row
/// is named first and left out. Under a loss that lets rows go, another may stand further off.
fn wrong_distances_are_named(printer: &Printer, rows: &[usize]) {
    let work = tempfile::tempdir().unwrap();
    let fit = |printer: &Printer, more: &str| {
        for name in ["printer", "found"] {
            let _ = fs::remove_dir_all(work.path().join(name));
        }
        printer.import(work.path());
        printer.calibrate(work.path(), more)
    };
    for more in ["", "--loss cauchy", "--loss tukey"] {
        let (before, _) = fit(printer, more);
        for &row in rows {
            for off in [1.0, -1.0] {
                let mut wrong = printer.clone();
                wrong.distances[row].0 += off;
                let (after, found) = fit(&wrong, more);
                let moved = moved_edge(&before, &after, printer.step);
                assert!(moved <= 1.2, "{more} {row} {off}: {moved} mm");
                if !more.is_empty() {
                    continue;
                }
                let worst = &found["gross_rows"][0];
                assert_eq!(worst["file"], "distances.csv", "{more} {row} {off}");
                assert_eq!(worst["line"], row + 2, "{more} {row} {off}");
                let counts = number(&worst["weight"]);
                assert!(counts < 0.1, "{more} {row} {off}: {counts}");
            }
        }
    }
}

#[test]
fn a_wrong_distance_hardly_moves_the_edge_of_the_bed() {
    wrong_distances_are_named(&imagined().0, &[2, 7]);
}

#[test]
fn exchanged_distances_are_found_before_the_fit() {
    let (mut printer, truth) = imagined();
    // A smaller object beside the other, so that distances differ.
    for row in 6..12 {
        let [a, b] = printer.distances[row]
            .1
            .map(|steps| position(&truth, printer.step, &steps));
        let b = a + (b - a) * 0.8;
        printer.distances[row] = (
            (a - b).norm(),
            [a, b].map(|at| steps_at(&truth, printer.step, at)),
        );
    }
    let model = "--model DIR/printer/printer.tau --variant Extended --split all";
    for is_exchanged in [false, true] {
        let mut own = printer.clone();
        if is_exchanged {
            own.distances[2].0 = printer.distances[9].0;
            own.distances[9].0 = printer.distances[2].0;
        }
        let folder = tempfile::tempdir().unwrap();
        own.import(folder.path());
        let check = tau_in(folder.path(), &format!("tau check DIR/printer {model}"));
        let fit = tau_in(
            folder.path(),
            &format!("tau calibrate DIR/printer {model} --out DIR/found"),
        );
        let says = "the distances of lines 4 and 11 are exchanged";
        for (what, ran) in [("check", check), ("calibrate", fit)] {
            assert_eq!(
                ran.code == 1,
                is_exchanged,
                "{what}: {}{}",
                ran.out,
                ran.err
            );
            assert_eq!((ran.out + &ran.err).contains(says), is_exchanged, "{what}");
        }
        assert_eq!(
            folder.path().join("found/robot.toml").exists(),
            !is_exchanged
        );
    }
}
