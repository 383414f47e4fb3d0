//! From a configuration to the printer: parameters, and what its calibration measured.

use nalgebra::Vector3;

use super::TOWERS;
use super::config::Config;
use crate::input_error::{Errors, InputError, both};
use crate::robot::Robot;
use crate::robot_file::RobotFile;

/// Angles of the towers that the firmware takes where none is stated (deg).
const USUAL_ANGLES_DEG: [f64; 3] = [210.0, 330.0, 90.0];
/// Full steps of a turn of the motor where none are stated.
const USUAL_FULL_STEPS: f64 = 200.0;
/// Section of the saved measurements.
const SECTION: &str = "delta_calibrate";

/// A tower.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tower {
    /// Length of its rods (mm).
    pub arm_mm: f64,
    /// Direction in which it stands (deg).
    pub angle_deg: f64,
    /// Height of the nozzle over the bed when all carriages are at their endstops (mm).
    pub endstop_mm: f64,
}

/// The parameters that the firmware calibrates.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Parameters {
    /// Distance of the towers from the axis, less that of the rods' joints on the effector (mm).
    pub radius_mm: f64,
    /// Towers a, b, c.
    pub towers: [Tower; 3],
}

/// A height that was probed, or measured by hand.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Height {
    /// True height of the nozzle (mm).
    pub height_mm: f64,
    /// Steps of each carriage down from its endstop.
    pub steps: [f64; 3],
    /// True if it was measured by hand.
    pub is_manual: bool,
}

/// A distance of two places of a printed object, by caliper.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Measured {
    /// Distance (mm).
    pub distance_mm: f64,
    /// Steps of each carriage down from its endstop, at both places.
    pub steps: [[f64; 3]; 2],
}

/// A delta printer.
#[derive(Debug, Clone, PartialEq)]
pub struct Printer {
    /// Its parameters.
    pub parameters: Parameters,
    /// Way of each carriage for one step of its motor (mm).
    pub step_mm: [f64; 3],
    /// Heights, those by hand first, as the firmware takes them.
    pub heights: Vec<Height>,
    /// Distances.
    pub distances: Vec<Measured>,
}

impl Parameters {
    /// The parameters as a robot file has them; a description fills in what the file lacks.
    ///
    /// # Errors
    /// The robot has no such parameters.
    pub fn of(robot: &Robot, file: &RobotFile) -> Result<Self, InputError> {
        let described = robot.model.iter().flat_map(|model| &model.parameters);
        let value = |name: &str| {
            let of_file = file.parameters.get(name).map(|own| &own.value);
            let mut described = described.clone();
            let own = of_file.or_else(|| described.find(|own| own.name == name)?.nominal.as_ref());
            own.and_then(|value| value.first()).copied().ok_or_else(|| {
                let message = format!("the robot has no parameter `{name}` as the firmware has");
                InputError::whole(&file.robot, message)
                    .help("a description in the firmware's parameters is what `tau import klipper` writes")
            })
        };
        let millimetres = |name: &str| value(name).map(|metres| 1000.0 * metres);
        let tower = |letter: &str| {
            Ok::<Tower, InputError>(Tower {
                arm_mm: millimetres(&format!("arm_{letter}"))?,
                angle_deg: value(&format!("angle_{letter}"))?.to_degrees(),
                endstop_mm: millimetres(&format!("endstop_{letter}"))?,
            })
        };
        let [a, b, c] = TOWERS.map(tower);
        Ok(Self {
            radius_mm: millimetres("radius")?,
            towers: [a?, b?, c?],
        })
    }
}

impl Printer {
    /// Reads a configuration.
    ///
    /// # Errors
    /// It is not of a delta printer; an option is missing or no number; rods are shorter than the radius; distances are
    /// not above zero.
    pub fn read(config: &Config<'_>) -> Result<Self, InputError> {
        if let Some(entry) = config.option("printer", "kinematics")
            && entry.value != "delta"
        {
            let message = format!("found kinematics `{}`, expected `delta`", entry.value);
            return Err(config.wrong(entry, message));
        }
        let mut errors = Errors::default();
        let radius_mm = errors.keep(required(config, "printer", "delta_radius"));
        let mut towers: Vec<Tower> = vec![];
        for (tower, usual) in TOWERS.iter().zip(USUAL_ANGLES_DEG) {
            let section = format!("stepper_{tower}");
            let or_first = |key: &str, first: Option<f64>| match first {
                None => inherited(config, &section, key),
                Some(first) => Ok(optional(config, &section, key)?.unwrap_or(first)),
            };
            let first = towers.first();
            towers.push(Tower {
                arm_mm: errors.keep(or_first("arm_length", first.map(|first| first.arm_mm))),
                angle_deg: errors
                    .keep(optional(config, &section, "angle"))
                    .unwrap_or(usual),
                endstop_mm: errors.keep(or_first(
                    "position_endstop",
                    first.map(|first| first.endstop_mm),
                )),
            });
        }
        let steps = TOWERS.map(|tower| errors.keep(step(config, &format!("stepper_{tower}"))));
        let (heights, distances) = errors.keep(both(heights(config), distances(config)));
        errors.finish()?;
        let towers = [towers[0], towers[1], towers[2]];
        if let Some(tower) = (0..3).find(|&k| towers[k].arm_mm <= radius_mm) {
            let message = format!(
                "the rods of tower {} are {} mm long, expected more than the radius, {radius_mm} mm",
                TOWERS[tower], towers[tower].arm_mm
            );
            return Err(config.lacks(message));
        }
        Ok(Self {
            parameters: Parameters { radius_mm, towers },
            step_mm: steps,
            heights,
            distances,
        })
    }

    /// Commands (m) that belong to steps: the way of each carriage down from its endstop.
    pub fn commands_m(&self, steps: &[f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| steps[k] * self.step_mm[k] / 1000.0)
    }

    /// Position of the nozzle (mm) at steps, by intersection of the three spheres about the joints of the carriages.
    pub fn position_mm(&self, steps: &[f64; 3]) -> Vector3<f64> {
        let Parameters { radius_mm, towers } = &self.parameters;
        let centre = |k: usize| {
            let tower = &towers[k];
            let (sine, cosine) = tower.angle_deg.to_radians().sin_cos();
            let upright = (tower.arm_mm.powi(2) - radius_mm.powi(2)).sqrt();
            let height = tower.endstop_mm + upright - steps[k] * self.step_mm[k];
            Vector3::new(radius_mm * cosine, radius_mm * sine, height)
        };
        let [a, b, c] = [0, 1, 2].map(centre);
        let squares = towers.map(|tower| tower.arm_mm.powi(2));
        let (to_b, to_c) = (b - a, c - a);
        let first = to_b.normalize();
        let along = first.dot(&to_c);
        let second = (to_c - first * along).normalize();
        let up = first.cross(&second);
        let distance = to_b.norm();
        let across = second.dot(&to_c);
        let x = (squares[0] - squares[1] + distance * distance) / (2.0 * distance);
        let y = (squares[0] - squares[2] - x * x + (x - along).powi(2) + across * across)
            / (2.0 * across);
        let z = -(squares[0] - x * x - y * y).sqrt();
        a + first * x + second * y + up * z
    }
}

/// An option as a number, if it is there.
fn optional(config: &Config<'_>, section: &str, key: &str) -> Result<Option<f64>, InputError> {
    let Some(entry) = config.option(section, key) else {
        return Ok(None);
    };
    let number = entry
        .value
        .parse::<f64>()
        .ok()
        .filter(|value| value.is_finite());
    let wrong = || {
        let message = format!("found `{}` for `{key}`, expected a number", entry.value);
        config.wrong(entry, message)
    };
    number.map(Some).ok_or_else(wrong)
}

fn required(config: &Config<'_>, section: &str, key: &str) -> Result<f64, InputError> {
    needed(config, section, key, "")
}

/// An option that the sections of the other towers inherit.
fn inherited(config: &Config<'_>, section: &str, key: &str) -> Result<f64, InputError> {
    needed(config, section, key, ": the other towers inherit it")
}

fn needed(config: &Config<'_>, section: &str, key: &str, remark: &str) -> Result<f64, InputError> {
    optional(config, section, key)?.ok_or_else(|| {
        let error = config.lacks(format!("`{key}` of section `[{section}]` is missing"));
        let includes: Vec<&str> = config.missing_includes().collect();
        if includes.is_empty() {
            error.help(format!("write `{key} = …` in `[{section}]`{remark}"))
        } else {
            error.help(format!(
                "name the files that it includes, too: {}",
                includes.join(", ")
            ))
        }
    })
}

/// Way of a carriage for one step (mm): stated by itself in old configurations, by the turn of the motor in new ones.
fn step(config: &Config<'_>, section: &str) -> Result<f64, InputError> {
    if let Some(step) = optional(config, section, "step_distance")? {
        return Ok(step);
    }
    let rotation = required(config, section, "rotation_distance")?;
    let microsteps = required(config, section, "microsteps")?;
    let full = optional(config, section, "full_steps_per_rotation")?;
    let mut gears = 1.0;
    if let Some(entry) = config.option(section, "gear_ratio") {
        for pair in entry.value.split(',') {
            let ratio = pair.split_once(':').and_then(|(driven, driving)| {
                let number = |text: &str| text.trim().parse::<f64>().ok();
                Some(number(driven)? / number(driving)?)
            });
            let message = format!("found `{}`, expected ratios such as `80:16`", entry.value);
            gears *= ratio.ok_or_else(|| config.wrong(entry, message))?;
        }
    }
    Ok(rotation / (full.unwrap_or(USUAL_FULL_STEPS) * microsteps * gears))
}

/// Steps of the three carriages.
fn steps(config: &Config<'_>, key: &str) -> Result<[f64; 3], InputError> {
    let Some(entry) = config.option(SECTION, key) else {
        return Err(config.lacks(format!("`{key}` of section `[{SECTION}]` is missing")));
    };
    let numbers: Vec<f64> = (entry.value.split(','))
        .filter_map(|text| text.trim().parse().ok())
        .collect();
    numbers.try_into().map_err(|_| {
        let message = format!(
            "found `{}` for `{key}`, expected three numbers of steps",
            entry.value
        );
        config.wrong(entry, message)
    })
}

fn heights(config: &Config<'_>) -> Result<Vec<Height>, InputError> {
    let mut found = vec![];
    for (prefix, is_manual) in [("manual_height", true), ("height", false)] {
        for index in 0.. {
            let key = format!("{prefix}{index}");
            let Some(height_mm) = optional(config, SECTION, &key)? else {
                break;
            };
            found.push(Height {
                height_mm,
                steps: steps(config, &format!("{key}_pos"))?,
                is_manual,
            });
        }
    }
    Ok(found)
}

fn distances(config: &Config<'_>) -> Result<Vec<Measured>, InputError> {
    let mut found = vec![];
    for index in 0.. {
        let key = format!("distance{index}");
        let Some(distance_mm) = optional(config, SECTION, &key)? else {
            break;
        };
        if let Some(entry) = config.option(SECTION, &key)
            && distance_mm <= 0.0
        {
            let message = format!("found a distance of {distance_mm} mm, expected one above 0");
            let help = "a distance is that over all less the width of a pillar: these two fields were exchanged";
            return Err(config.wrong(entry, message).help(help));
        }
        let at = |place: &str| steps(config, &format!("{key}_{place}"));
        found.push(Measured {
            distance_mm,
            steps: [at("pos1")?, at("pos2")?],
        });
    }
    Ok(found)
}
