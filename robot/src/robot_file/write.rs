//! From values to the text of a `robot.toml`.

use std::fmt::{self, Write};

use super::{LinkValues, RobotFile, Value};
use crate::robot::LinkKey;

impl RobotFile {
    /// The text of a file that [`RobotFile::parse`] reads again bit for bit.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        // Writing into a string can't fail.
        let _ = self.write(&mut text);
        text
    }

    fn write(&self, out: &mut String) -> fmt::Result {
        writeln!(
            out,
            "# Parameters in SI units: lengths in m, angles in rad."
        )?;
        writeln!(
            out,
            "# tol is one standard deviation of the prior, sigma of the calibrated value."
        )?;
        writeln!(out, "robot = {}", string(&self.robot))?;
        writeln!(
            out,
            "\n[noise]  # of the measurement, one standard deviation per axis"
        )?;
        for (key, noise) in [
            ("position_m", self.noise.position_m),
            ("rotation_rad", self.noise.rotation_rad),
        ] {
            if noise.is_finite() && noise < super::Noise::OF_NO_ROTATION_RAD {
                writeln!(out, "{key} = {noise:?}")?;
            }
        }
        self.measuring.write(out)?;
        if let Some(payload) = &self.payload {
            writeln!(
                out,
                "\n[payload]  # centre in TCP coordinates, gravity in the measurement frame"
            )?;
            writeln!(out, "mass_kg = {:?}", payload.mass_kg)?;
            writeln!(out, "centre_m = {:?}", payload.centre_m)?;
            writeln!(out, "gravity_m_s2 = {:?}", payload.gravity_m_s2)?;
        }
        if let Some((low, high)) = self.range_m {
            writeln!(out, "\n[range]  # of the commands, where set 2 is missing")?;
            writeln!(out, "q_m = {:?}", [low, high])?;
        }
        if let Some(reference) = &self.reference {
            writeln!(
                out,
                "\n[reference]  # where the machine stands at these commands: how the arm is assembled; ZYZ angles"
            )?;
            writeln!(out, "{} = {:?}", reference.key(), reference.commands_m)?;
            writeln!(out, "position_m = {:?}", reference.position_m)?;
            writeln!(out, "orientation_rad = {:?}", reference.orientation_rad)?;
        }
        if let Some(calibration) = &self.calibration {
            calibration.write(out, string)?;
        }
        for (section, entries) in [
            ("links", &self.links),
            ("clusters", &self.clusters),
            ("tracks", &self.tracks),
        ] {
            for (name, values) in entries {
                writeln!(out, "\n[{section}.{}]", key(name))?;
                write_values(out, values)?;
            }
        }
        for (name, values) in &self.cranks {
            writeln!(out, "\n[cranks.{}]", key(name))?;
            for (value_key, value) in values {
                writeln!(out, "{value_key} = {}", inline(value))?;
            }
        }
        if !self.parameters.is_empty() {
            writeln!(out, "\n[parameters]  # of the whole machine")?;
        }
        for (parameter, value) in &self.parameters {
            writeln!(out, "{} = {}", key(parameter), inline(value))?;
        }
        for (name, path) in &self.paths {
            writeln!(
                out,
                "\n[paths.{}]  # measured by set 2, in the frame of its tracker",
                key(name)
            )?;
            path.write(out)?;
        }
        for (name, parameters) in &self.effects {
            let remark = if name.ends_with("(tcp)") {
                "  # of the tracker, not of the machine: left out of kinematics"
            } else {
                ""
            };
            writeln!(out, "\n[effects.{}]{remark}", key(name))?;
            for (parameter, value) in parameters {
                writeln!(out, "{} = {}", key(parameter), inline(value))?;
            }
        }
        if let Some(covariance) = &self.covariance {
            covariance.write(out, string)?;
        }
        Ok(())
    }
}

fn write_values(out: &mut String, values: &LinkValues) -> fmt::Result {
    for key in LinkKey::ALL {
        if let Some(value) = values.get(key) {
            writeln!(out, "{} = {}", key.key(), inline(value))?;
        }
    }
    Ok(())
}

pub(super) fn inline(value: &Value) -> String {
    let sigma = value
        .sigma
        .as_ref()
        .map(|sigma| format!(", sigma = {}", components(sigma)))
        .unwrap_or_default();
    format!(
        "{{ value = {}, tol = {}{sigma} }}",
        components(&value.value),
        components(&[value.tol])
    )
}

/// TOML spells what is not a number otherwise than Rust does.
fn components(components: &[f64]) -> String {
    let text = match components {
        [scalar] => format!("{scalar:?}"),
        vector => format!("{vector:?}"),
    };
    text.replace("NaN", "nan")
}

pub(super) fn key(name: &str) -> String {
    let is_bare = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    if !name.is_empty() && name.chars().all(is_bare) {
        name.to_owned()
    } else {
        string(name)
    }
}

pub(super) fn string(text: &str) -> String {
    let mut quoted = String::from('"');
    for c in text.chars() {
        match c {
            '"' | '\\' => quoted.extend(['\\', c]),
            c if c.is_control() => {
                let _ = write!(quoted, "\\u{:04X}", u32::from(c));
            }
            c => quoted.push(c),
        }
    }
    quoted.push('"');
    quoted
}
