//! From a configuration to the printer: parameters, and what its calibration measured.

use nalgebra::Vector3;
use tau_codes::{Remark, files};

use super::TOWERS;
use super::config::Config;
use super::measured::{self, Height, Measured};
use super::numbers::{Kind, optional, required, step};
use crate::input_error::{Errors, InputError, both};
use crate::robot::Robot;
use crate::robot_file::RobotFile;

/// Angles of the towers that the firmware takes where none is stated (deg).
const USUAL_ANGLES_DEG: [f64; 3] = [210.0, 330.0, 90.0];

/// Sine of half the angle between two towers below which they stand in one direction: a tower has a width.
const SAME_DIRECTION: f64 = 0.01;
/// Why an option of the first tower can't be left out.
const INHERITED: &str = ", which the other towers inherit,";

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
    /// Measurements that took no part, in words.
    pub unread: Vec<Remark>,
}

impl Parameters {
    /// The parameters as a robot file has them; a description fills in what the file lacks.
    ///
    /// # Errors
    /// The robot has no such parameters.
    pub fn of(robot: &Robot, file: &RobotFile) -> Result<Self, InputError> {
        let described = robot.model.parameters.iter();
        let value = |name: &str| {
            let of_file = file.parameters.get(name).map(|own| &own.value);
            let mut described = described.clone();
            let own = of_file.or_else(|| described.find(|own| own.name == name)?.nominal.as_ref());
            own.and_then(|value| value.first()).copied().ok_or_else(|| {
                let message = format!("the robot has no parameter `{name}` as the firmware has");
                InputError::whole(files::UNKNOWN_NAME, &file.robot, message)
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
        let own = Self {
            radius_mm: millimetres("radius")?,
            towers: [a?, b?, c?],
        };
        own.mistake().map_or(Ok(own), |(name, why)| {
            Err(input_error!(files::FIRMWARE_REFUSES, &file.source; "found parameter `{name}` {why}";
                "the firmware refuses this printer: calibrate it anew"))
        })
    }

    /// The first parameter that the firmware refuses: its name in the description, and why.
    fn mistake(&self) -> Option<(String, String)> {
        let radius = self.radius_mm;
        if !(radius.is_finite() && radius > 0.0) {
            return Some((
                "radius".to_owned(),
                format!("of {radius} mm, expected one above 0"),
            ));
        }
        TOWERS.iter().zip(&self.towers).find_map(|(letter, tower)| {
            let arm = tower.arm_mm;
            let (name, why) = if !(arm.is_finite() && arm > radius) {
                let why = format!("of {arm} mm, expected more than the radius, {radius} mm");
                ("arm", why)
            } else if !tower.angle_deg.is_finite() {
                ("angle", "that is no number".to_owned())
            } else if !tower.endstop_mm.is_finite() {
                ("endstop", "that is no number".to_owned())
            } else {
                return None;
            };
            Some((format!("{name}_{letter}"), why))
        })
    }
}

impl Printer {
    /// Reads a configuration.
    ///
    /// # Errors
    /// It is not of a delta printer; an option is missing, no number, or one that the firmware refuses; rods are not longer
    /// than the radius; measurements are not such as the printer can have made.
    pub fn read(config: &Config) -> Result<Self, InputError> {
        config.check_delta()?;
        let mut errors = Errors::default();
        let radius = required(config, "printer", "delta_radius", Kind::AboveZero, "");
        let radius_mm = errors.keep(radius);
        let mut towers: Vec<Tower> = vec![];
        for (tower, usual) in TOWERS.iter().zip(USUAL_ANGLES_DEG) {
            let section = format!("stepper_{tower}");
            let or_first = |key: &str, kind: Kind, first: Option<f64>| match first {
                None => required(config, &section, key, kind, INHERITED),
                Some(first) => Ok(optional(config, &section, key, kind)?.unwrap_or(first)),
            };
            let first = towers.first();
            let first_arm = first.map(|first| first.arm_mm);
            let first_endstop = first.map(|first| first.endstop_mm);
            let angle = optional(config, &section, "angle", Kind::Any);
            towers.push(Tower {
                arm_mm: errors.keep(or_first("arm_length", Kind::AboveZero, first_arm)),
                angle_deg: errors.keep(angle).unwrap_or(usual),
                endstop_mm: errors.keep(or_first("position_endstop", Kind::Any, first_endstop)),
            });
        }
        let steps = TOWERS.map(|tower| errors.keep(step(config, &format!("stepper_{tower}"))));
        let measured = both(measured::heights(config), measured::distances(config));
        let (heights, distances) = errors.keep(measured);
        errors.finish()?;
        let printer = Self {
            parameters: Parameters {
                radius_mm,
                towers: [towers[0], towers[1], towers[2]],
            },
            step_mm: steps,
            heights,
            distances,
            unread: measured::unread(config),
        };
        both(printer.check_arms(config), printer.check_angles(config))?;
        measured::check(config, &printer.heights, &printer.distances, |steps| {
            printer.position_mm(steps)
        })?;
        Ok(printer)
    }

    /// Rods are longer than the radius.
    fn check_arms(&self, config: &Config) -> Result<(), InputError> {
        let Parameters { radius_mm, towers } = &self.parameters;
        let mut errors = Errors::default();
        for (letter, tower) in TOWERS.iter().zip(towers) {
            // Where a tower inherits its rods, those of the first were named already.
            let entry = config.option(&format!("stepper_{letter}"), "arm_length");
            if let Some(entry) = entry.filter(|_| tower.arm_mm <= *radius_mm) {
                let message = format!(
                    "the rods of tower {letter} are {} mm long, expected more than the radius, {radius_mm} mm",
                    tower.arm_mm
                );
                let help = "measure radius and rods from joint to joint: the firmware refuses this printer";
                errors.add(
                    config
                        .wrong(files::FIRMWARE_REFUSES, entry, message)
                        .help(help),
                );
            }
        }
        errors.finish()
    }

    /// No two towers stand in one direction.
    fn check_angles(&self, config: &Config) -> Result<(), InputError> {
        let of = |tower: usize| self.parameters.towers[tower].angle_deg;
        for (one, other) in [(0, 1), (0, 2), (1, 2)] {
            let between = (0.5 * (of(one) - of(other)).to_radians()).sin().abs();
            let [one, other] = [one, other].map(|tower| TOWERS[tower]);
            let entry = [other, one].into_iter();
            let mut entry =
                entry.filter_map(|letter| config.option(&format!("stepper_{letter}"), "angle"));
            if let Some(entry) = entry.next().filter(|_| between < SAME_DIRECTION) {
                let message = format!(
                    "towers {one} and {other} stand at one angle, expected three directions"
                );
                let help = "angles are degrees about the middle: by default 210, 330 and 90";
                return Err(config
                    .wrong(files::FIRMWARE_REFUSES, entry, message)
                    .help(help));
            }
        }
        Ok(())
    }

    /// Commands (m) that belong to steps: the way of each carriage down from its endstop.
    pub fn commands_m(&self, steps: &[f64; 3]) -> [f64; 3] {
        [0, 1, 2].map(|k| steps[k] * self.step_mm[k] / 1000.0)
    }

    /// Position of the nozzle (mm) at steps.
    pub fn position_mm(&self, steps: &[f64; 3]) -> Vector3<f64> {
        let ways_mm = [0, 1, 2].map(|k| steps[k] * self.step_mm[k]);
        self.parameters.position_mm(ways_mm)
    }
}

impl Parameters {
    /// Position of the nozzle (mm) where carriages are so far down from their endstops (mm), as the firmware computes it: by
    /// intersection of the three spheres about their joints.
    pub fn position_mm(&self, ways_mm: [f64; 3]) -> Vector3<f64> {
        let Self { radius_mm, towers } = self;
        let centre = |k: usize| {
            let tower = &towers[k];
            let (sine, cosine) = tower.angle_deg.to_radians().sin_cos();
            let upright = (tower.arm_mm.powi(2) - radius_mm.powi(2)).sqrt();
            let height = tower.endstop_mm + upright - ways_mm[k];
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
