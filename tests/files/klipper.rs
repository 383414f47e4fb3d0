//! Delta printers: their firmware's files, read, calibrated and written back.

mod export;
mod import;
mod reader;

use std::fmt::Write as _;

use nalgebra::{Matrix2, Vector2, Vector3};
use serde_json::{Value, json};
use tau_testkit::{Ran, Work, list, number};

/// Parameters in the order of [`Printer::values`].
pub(crate) const NAMES: [&str; 10] = [
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

/// A printer and its measurements, mm and degrees.
#[derive(Clone)]
pub(crate) struct Printer {
    pub(crate) values: [f64; 10],
    pub(crate) step: f64,
    pub(crate) heights: Vec<(f64, [f64; 3])>,
    pub(crate) distances: Vec<(f64, [[f64; 3]; 2])>,
}

/// Where the nozzle stands (mm): the spheres about the joints of the carriages meet, of two points in the lower one.
/// Differences of the spheres' equations are linear, which leaves one equation of second degree in z.
pub(crate) fn position(values: &[f64], step: f64, steps: &[f64; 3]) -> Vector3<f64> {
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
    /// Weight of the square of a height against that of a distance in the firmware's cost.
    pub(crate) fn weight(&self) -> f64 {
        match self.distances.len() {
            0 => 1.0,
            distances => distances as f64 / (0.5 * self.heights.len() as f64),
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

    /// A folder whose measurements the program made of the configuration, which is `DIR/printer.cfg`.
    pub(crate) fn imported(&self) -> Work {
        let work = Work::empty();
        work.write("printer.cfg", self.config());
        work.run("import klipper DIR/printer.cfg --out MEASURED")
            .done();
        work
    }

    /// The same as the firmware takes them: no tolerances, heights and distances by its weights.
    pub(crate) fn as_the_firmware(&self) -> Work {
        let work = self.imported();
        let text = work.read("measured/printer.tau");
        let lines = text.lines().map(|line| match line.split_once(" tol ") {
            Some((value, tol)) if tol.ends_with("mm;") => format!("{value} tol 1 km;\n"),
            Some((value, _)) => format!("{value} tol 3 rad;\n"),
            None => format!("{line}\n"),
        });
        work.write("measured/printer.tau", lines.collect::<String>());
        let [heights, distances] = [1e-4 / self.weight().sqrt(), 1e-4];
        let noise = format!(
            "robot = \"Printer\"\n[noise.heights]\nheight_m = {heights:?}\n[noise.distances]\ndistance_m = {distances:?}\n"
        );
        work.write("measured/robot.toml", noise);
        work
    }

    /// Parameters (mm, degrees) of a calibration, and its JSON.
    pub(crate) fn calibrated(&self, work: &Work, more: &str) -> (Vec<f64>, Value) {
        let variant = match self.distances.len() {
            0 => "Basic",
            _ => "Extended",
        };
        let line = format!(
            "calibrate MEASURED --model MEASURED/printer.tau --variant {variant} --split all --out DIR/found --json - {more}"
        );
        let found = work.run(&line).json();
        let mut values = self.values.to_vec();
        for parameter in list(&found["parameters"]) {
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
    let (found, _) = printer.calibrated(&printer.as_the_firmware(), "");
    for ((name, found), truth) in NAMES.iter().zip(found).zip(truth) {
        assert!((found - truth).abs() < 1e-4, "{name}: {found}");
    }
}

#[test]
fn seven_factors_on_seven_points_are_refused() {
    let (mut printer, _) = imagined();
    printer.distances.clear();
    let work = printer.imported();
    let seven = "variant Seven = Extended hold arm_b, arm_c;\n    variant Basic";
    let text = work.read("measured/printer.tau");
    work.write("measured/printer.tau", text.replace("variant Basic", seven));
    let line = "MEASURED --model MEASURED/printer.tau --variant Seven --split all";
    let refused = work.run(&format!("calibrate {line} --out DIR/found"));
    refused.refused(&[("T341", "measured", 0)]);
    insta::assert_snapshot!(refused.err);
    assert_eq!(work.run(&format!("check {line}")).code, 1);
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

/// Makes distances wrong by so many mm: the edge of the bed moves by no more than 1.2 mm, and by default the row is named
/// first and left out. Under a loss that lets rows go, another may stand further off.
pub(crate) fn wrong_distances_are_named(
    printer: &Printer,
    losses: &[&str],
    wrong: &[(usize, f64)],
) {
    for more in losses {
        let fit = |printer: &Printer| printer.calibrated(&printer.imported(), more);
        let (before, _) = fit(printer);
        for &(row, off) in wrong {
            let mut printer = printer.clone();
            printer.distances[row].0 += off;
            let (after, found) = fit(&printer);
            let moved = moved_edge(&before, &after, printer.step);
            assert!(moved <= 1.2, "{more} {row} {off}: {moved} mm");
            if more.is_empty() {
                let worst = &found["gross_rows"][0];
                assert_eq!(worst["file"], "distances.csv", "{row} {off}");
                assert_eq!(worst["line"], row + 2, "{off}");
                assert!(number(&worst["weight"]) < 0.1, "{row} {off}: {worst}");
            }
        }
    }
}

#[test]
fn a_wrong_distance_hardly_moves_the_edge_of_the_bed() {
    let losses = ["", "--loss tukey"];
    wrong_distances_are_named(&imagined().0, &losses, &[(2, 1.0), (7, -1.0)]);
}

#[test]
fn exchanged_distances_are_found_before_the_fit() {
    let (mut printer, truth) = imagined();
    // A smaller object beside the other, so that distances differ.
    for row in 6..12 {
        let ends = printer.distances[row].1;
        let [a, b] = ends.map(|steps| position(&truth, printer.step, &steps));
        let b = a + (b - a) * 0.8;
        let ends = [a, b].map(|at| steps_at(&truth, printer.step, at));
        printer.distances[row] = ((a - b).norm(), ends);
    }
    let line = "MEASURED --model MEASURED/printer.tau --variant Extended --split all --json -";
    for is_exchanged in [false, true] {
        let mut own = printer.clone();
        if is_exchanged {
            own.distances[2].0 = printer.distances[9].0;
            own.distances[9].0 = printer.distances[2].0;
        }
        let work = own.imported();
        let told = |ran: Ran| {
            assert_eq!(ran.code, u8::from(is_exchanged), "{}", ran.err);
            let found = ran.printed();
            let mistakes = [&found, &found["fit"]].map(|of| of["mistakes"].as_array().cloned());
            let mistakes = mistakes.into_iter().flatten().flatten();
            let told = mistakes.map(|own| json!([own["code"], own["lines"]]));
            told.collect::<Vec<Value>>()
        };
        let expected = vec![json!(["T417", [4, 11]]); usize::from(is_exchanged)];
        assert_eq!(told(work.run(&format!("check {line}"))), expected);
        let calibrate = work.run(&format!("calibrate {line} --out DIR/found"));
        assert_eq!(told(calibrate), expected);
        let is_written = work.listing("").contains(&"found".to_owned());
        assert_eq!(is_written, !is_exchanged);
    }
}
