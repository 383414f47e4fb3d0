//! From a printer to a measurement folder with a description of its own.

use std::fmt::Write;

use super::TOWERS;
use super::printer::{Parameters, Printer, Tower};

/// Name of the description in the folder.
pub const DESCRIPTION: &str = "printer.tau";

/// Tolerance of the radius: of the places of towers and of joints on the effector, together.
const RADIUS_MM: f64 = 1.0;
/// Tolerance of a tower's angle: 1.3 mm at the foot of a tower that stands 150 mm off the axis.
const ANGLE_DEG: f64 = 0.5;
/// Tolerance of an endstop: belts stretch, switches are moved.
const ENDSTOP_MM: f64 = 2.0;
/// Tolerance of the rods: they are sold to half a millimetre.
const ARM_MM: f64 = 0.5;
/// Noise of a probed height (m): the firmware's manual asks of probes to repeat within 25 µm.
const HEIGHT_M: f64 = 2e-5;
/// Noise of a distance by caliper (m): DIN 862 allows 30 µm, the edges of a print add to it.
const DISTANCE_M: f64 = 5e-5;

/// The files of a folder, by name.
pub fn folder(printer: &Printer, origin: &str) -> Vec<(&'static str, String)> {
    let mut files = vec![
        (DESCRIPTION, description(printer, origin)),
        ("robot.toml", robot(printer)),
    ];
    let commands = |steps: &[f64; 3]| {
        let [a, b, c] = printer.commands_m(steps);
        format!("{a:?},{b:?},{c:?}")
    };
    let mut pose = 0;
    let mut heights = "pose,q1_m,q2_m,q3_m,height_m\n".to_owned();
    for height in &printer.heights {
        pose += 1;
        let own = commands(&height.steps);
        let _ = writeln!(heights, "{pose},{own},{:?}", height.height_mm / 1000.0);
    }
    let mut readings = "pose,q1_m,q2_m,q3_m\n".to_owned();
    let mut distances = "pose_a,pose_b,distance_m\n".to_owned();
    for measured in &printer.distances {
        for steps in &measured.steps {
            pose += 1;
            let _ = writeln!(readings, "{pose},{}", commands(steps));
        }
        let own = measured.distance_mm / 1000.0;
        let _ = writeln!(distances, "{},{pose},{own:?}", pose - 1);
    }
    if !printer.heights.is_empty() {
        files.push(("heights.csv", heights));
    }
    if !printer.distances.is_empty() {
        files.push(("readings.csv", readings));
        files.push(("distances.csv", distances));
    }
    files
}

/// Noise of what was measured; parameters are those of the description.
fn robot(printer: &Printer) -> String {
    let mut text = "robot = \"Printer\"\n".to_owned();
    if !printer.heights.is_empty() {
        let _ = write!(
            text,
            "\n[noise.heights]\nheight_m = {HEIGHT_M:?}  # of the probe\n"
        );
    }
    if !printer.distances.is_empty() {
        let _ = write!(
            text,
            "\n[noise.distances]\ndistance_m = {DISTANCE_M:?}  # of the caliper\n"
        );
    }
    text
}

fn description(printer: &Printer, origin: &str) -> String {
    let Parameters { radius_mm, towers } = &printer.parameters;
    let mut text = format!(
        "/// A delta printer in the parameters of its firmware, Klipper, from {origin}.\n\
         ///\n\
         /// A command is the way of its carriage down from the endstop. `endstop_…` is the height of the nozzle over the\n\
         /// bed, z = 0, when all carriages are at their endstops.\n\
         pub robot Printer {{\n    \
         plate point;\n    \
         param radius: length = {radius_mm} mm tol {RADIUS_MM} mm;\n"
    );
    let mut each =
        |name: &str, of: &dyn Fn(&Tower) -> f64, dimension: &str, unit: &str, tol: f64| {
            for (letter, tower) in TOWERS.iter().zip(towers) {
                let value = of(tower);
                // The third tower says where the x axis lies.
                let tolerance = if name == "angle" && *letter == "c" {
                    "exact".to_owned()
                } else {
                    format!("tol {tol} {unit}")
                };
                let _ = writeln!(
                    text,
                    "    param {name}_{letter}: {dimension} = {value} {unit} {tolerance};"
                );
            }
        };
    each("angle", &|tower| tower.angle_deg, "angle", "deg", ANGLE_DEG);
    each(
        "endstop",
        &|tower| tower.endstop_mm,
        "length",
        "mm",
        ENDSTOP_MM,
    );
    each("arm", &|tower| tower.arm_mm, "length", "mm", ARM_MM);
    let _ = writeln!(text, "    track {};", TOWERS.join(", "));
    for letter in TOWERS {
        let _ = write!(
            text,
            "    cluster on_{letter} on {letter} {{\n        \
             link rods_{letter} {{\n            \
             length = arm_{letter};\n            \
             track_offset = (radius * cos(angle_{letter}), radius * sin(angle_{letter}), \
             endstop_{letter} + sqrt(arm_{letter}^2 - radius^2));\n            \
             track_direction = (0, 0, -1) exact;\n        }}\n    }}\n"
        );
    }
    let [a, b, c] = towers.map(|tower| tower.endstop_mm / 1000.0);
    let _ = write!(
        text,
        "\n    reference {{\n        commands = ({a}, {b}, {c}) m;\n        position = (0, 0, 0) m;\n    }}\n\n    \
         /// With distances, as the firmware's extended calibration: rods, too.\n    \
         variant Extended {{ tracks linear; }}\n    \
         /// From heights alone, as the firmware's basic calibration: radius, two angles, endstops.\n    \
         variant Basic = Extended hold arm_a, arm_b, arm_c;\n}}\n"
    );
    text
}
