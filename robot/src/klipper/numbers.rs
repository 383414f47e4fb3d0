//! Options as numbers, within the bounds that the firmware sets.

use super::config::{Config, Entry};
use crate::input_error::InputError;
use tau_codes::files;

/// Numbers that an option takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Any,
    AboveZero,
    /// A whole number above zero.
    Count,
}

impl Kind {
    fn words(self) -> &'static str {
        match self {
            Self::Any => "a number",
            Self::AboveZero => "a number above 0",
            Self::Count => "a whole number above 0",
        }
    }

    fn read(self, text: &str) -> Option<f64> {
        match self {
            Self::Any => finite(text),
            Self::AboveZero => finite(text).filter(|&value| value > 0.0),
            Self::Count => text
                .parse::<u32>()
                .ok()
                .filter(|&count| count > 0)
                .map(f64::from),
        }
    }
}

/// A number that is one.
pub(super) fn finite(text: &str) -> Option<f64> {
    let number = text.trim().parse::<f64>().ok();
    number.filter(|value| value.is_finite())
}

/// An option as a number, if it is there.
pub(super) fn optional(
    config: &Config,
    section: &str,
    key: &str,
    kind: Kind,
) -> Result<Option<f64>, InputError> {
    let Some(entry) = config.option(section, key) else {
        return Ok(None);
    };
    let number = kind.read(&entry.setting.value);
    number
        .map(Some)
        .ok_or_else(|| unexpected(config, entry, kind.words()))
}

/// An option as a number; `remark` says why it can't be left out.
pub(super) fn required(
    config: &Config,
    section: &str,
    key: &str,
    kind: Kind,
    remark: &str,
) -> Result<f64, InputError> {
    let lacks = || config.lacks(section, key, &format!("`{key} = …`{remark}"));
    optional(config, section, key, kind)?.ok_or_else(lacks)
}

/// A mistake at the value of an option, with what was expected.
pub(super) fn unexpected(config: &Config, entry: &Entry, expected: &str) -> InputError {
    let value = entry.setting.value.replace('\n', " ");
    let message = format!(
        "found `{value}` for `{}`, expected {expected}",
        entry.setting.key
    );
    config.wrong(files::FIRMWARE_OPTION_VALUE, entry, message)
}

/// Way of a carriage for one step (mm): by the turn of the motor, which counts where both are stated, or by itself in old
/// configurations.
pub(super) fn step(config: &Config, section: &str) -> Result<f64, InputError> {
    let has_rotation = config.option(section, "rotation_distance").is_some();
    if !has_rotation
        && let Some(step) = optional(config, section, "step_distance", Kind::AboveZero)?
    {
        return Ok(step);
    }
    let rotation = required(config, section, "rotation_distance", Kind::AboveZero, "")?;
    let microsteps = required(config, section, "microsteps", Kind::Count, "")?;
    let full = optional(config, section, "full_steps_per_rotation", Kind::Count)?;
    Ok(rotation / (full.unwrap_or(USUAL_FULL_STEPS) * microsteps * gears(config, section)?))
}

/// Full steps of a turn of the motor where none are stated.
const USUAL_FULL_STEPS: f64 = 200.0;

/// Turns of the motor for one of the pulley.
fn gears(config: &Config, section: &str) -> Result<f64, InputError> {
    let Some(entry) = config.option(section, "gear_ratio") else {
        return Ok(1.0);
    };
    let ratio = |pair: &str| {
        let (driven, driving) = pair.split_once(':')?;
        let number = |text: &str| Kind::AboveZero.read(text);
        Some(number(driven)? / number(driving)?)
    };
    let pairs = entry.setting.value.split(',');
    let ratios = pairs.filter(|pair| !pair.trim().is_empty()).map(ratio);
    let all: Option<f64> = ratios.product();
    all.ok_or_else(|| unexpected(config, entry, "ratios above 0 such as `80:16`"))
}
