//! Measurements of the firmware's delta calibration, as the configuration keeps them.

use nalgebra::Vector3;
use tau_codes::{Remark, files, remark};

use super::config::{Config, Entry};
use super::numbers::{Kind, finite, optional, unexpected};
use crate::input_error::{Errors, InputError};

/// Section of the saved measurements.
const SECTION: &str = "delta_calibrate";
/// Names of the measurements, each followed by a number from 0.
const NAMES: [&str; 3] = ["manual_height", "height", "distance"];
/// Units in which distances may have been written for millimetres: name and length (mm).
const UNITS: [(&str, f64); 2] = [("inches", 25.4), ("metres", 1000.0)];

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

/// Heights, those by hand first, as the firmware takes them.
pub(super) fn heights(config: &Config) -> Result<Vec<Height>, InputError> {
    let mut errors = Errors::default();
    let mut found = vec![];
    for (name, is_manual) in [("manual_height", true), ("height", false)] {
        for index in 0..number_of(config, name) {
            let key = format!("{name}{index}");
            let height = optional(config, SECTION, &key, Kind::Any);
            found.push(Height {
                height_mm: errors.keep(height).unwrap_or_default(),
                steps: errors.keep(steps(config, &format!("{key}_pos"))),
                is_manual,
            });
        }
    }
    errors.finish()?;
    Ok(found)
}

/// Distances.
pub(super) fn distances(config: &Config) -> Result<Vec<Measured>, InputError> {
    let mut errors = Errors::default();
    let mut found = vec![];
    for index in 0..number_of(config, "distance") {
        let key = format!("distance{index}");
        let distance = errors.keep(optional(config, SECTION, &key, Kind::Any));
        if let (Some(distance_mm), Some(entry)) = (distance, config.option(SECTION, &key))
            && distance_mm <= 0.0
        {
            let message = format!("found a distance of {distance_mm} mm, expected one above 0");
            let help = "a distance is that over all less the width of a pillar: these two fields were exchanged";
            errors.add(
                config
                    .wrong(files::FIRMWARE_OPTION_VALUE, entry, message)
                    .help(help),
            );
        }
        let mut at = |place: &str| errors.keep(steps(config, &format!("{key}_{place}")));
        found.push(Measured {
            steps: [at("pos1"), at("pos2")],
            distance_mm: distance.unwrap_or_default(),
        });
    }
    errors.finish()?;
    Ok(found)
}

/// Number of measurements of a name: the firmware reads up to the first number that is missing.
fn number_of(config: &Config, name: &str) -> usize {
    let is_stated = |index: &usize| config.option(SECTION, &format!("{name}{index}")).is_some();
    let most = config.entries().len();
    (0..most).take_while(is_stated).count()
}

/// Steps of the three carriages.
fn steps(config: &Config, key: &str) -> Result<[f64; 3], InputError> {
    let Some(entry) = config.option(SECTION, key) else {
        return Err(config.lacks(SECTION, key, &format!("`{key} = …`")));
    };
    let numbers: Option<Vec<f64>> = entry.setting.value.split(',').map(finite).collect();
    let three = numbers.and_then(|numbers| numbers.try_into().ok());
    three.ok_or_else(|| unexpected(config, entry, "three numbers of steps"))
}

/// Measurements that the firmware does not read because a number before theirs is missing, in words.
pub(super) fn unread(config: &Config) -> Vec<Remark> {
    let of_section = |entry: &&Entry| entry.setting.section == SECTION;
    let remark = |name: &str| {
        let next = number_of(config, name);
        let number = |entry: &Entry| {
            let rest = entry.setting.key.strip_prefix(name)?;
            let digits = rest.split('_').next()?;
            digits.parse::<usize>().ok().filter(|own| *own >= next)
        };
        let entries = config.entries().iter().filter(of_section);
        let mut unread: Vec<(usize, &Entry)> = entries
            .filter_map(|entry| Some((number(entry)?, entry)))
            .collect();
        let (_, first) = *unread.first()?;
        unread.sort_by_key(|own| own.0);
        unread.dedup_by_key(|own| own.0);
        let keys = unread.iter().map(|(number, _)| format!("`{name}{number}`"));
        let keys: Vec<String> = keys.collect();
        Some(remark!(files::FIRMWARE_UNMEASURED;
            "{}: without a value of `{name}{next}` the firmware does not read {}, which took no part",
                config.place(first), keys.join(", ")))
    };
    NAMES.into_iter().filter_map(remark).collect()
}

/// Fails at measurements that the printer can't have made with the parameters that the configuration states.
///
/// `position_mm` is the position of the nozzle (mm) at steps of the carriages.
pub(super) fn check(
    config: &Config,
    heights: &[Height],
    distances: &[Measured],
    position_mm: impl Fn(&[f64; 3]) -> Vector3<f64>,
) -> Result<(), InputError> {
    check_reach(config, heights, distances, &position_mm)?;
    check_unit(config, distances, &position_mm)
}

/// Each place measured is one at which the rods can stand.
fn check_reach(
    config: &Config,
    heights: &[Height],
    distances: &[Measured],
    position_mm: &impl Fn(&[f64; 3]) -> Vector3<f64>,
) -> Result<(), InputError> {
    let mut errors = Errors::default();
    let mut check = |key: String, steps: &[f64; 3]| {
        let is_met = position_mm(steps).iter().all(|value| value.is_finite());
        if let Some(entry) = config.option(SECTION, &key).filter(|_| !is_met) {
            let message = format!(
                "found `{}` for `{key}`, where the rods do not meet",
                entry.setting.value
            );
            let help = "radius, angles, rods, endstops and step lengths must be those with which it was measured";
            errors.add(
                config
                    .wrong(files::FIRMWARE_CONTRADICTION, entry, message)
                    .help(help),
            );
        }
    };
    let manual = heights.iter().filter(|own| own.is_manual).count();
    for (index, height) in heights.iter().enumerate() {
        let key = if height.is_manual {
            format!("manual_height{index}_pos")
        } else {
            format!("height{}_pos", index - manual)
        };
        check(key, &height.steps);
    }
    for (index, measured) in distances.iter().enumerate() {
        for (place, steps) in measured.steps.iter().enumerate() {
            check(format!("distance{index}_pos{}", place + 1), steps);
        }
    }
    errors.finish()
}

/// Distances are millimetres: their median share of those that the parameters predict is nearer to 1, as a factor, than
/// to that of another unit.
fn check_unit(
    config: &Config,
    distances: &[Measured],
    position_mm: &impl Fn(&[f64; 3]) -> Vector3<f64>,
) -> Result<(), InputError> {
    let shares = distances.iter().map(|measured| {
        let [a, b] = measured.steps.map(|steps| position_mm(&steps));
        measured.distance_mm / (a - b).norm()
    });
    let mut shares: Vec<f64> = shares.filter(|share| share.is_finite()).collect();
    shares.sort_by(f64::total_cmp);
    let Some(&median) = shares.get(shares.len() / 2) else {
        return Ok(());
    };
    let off = |unit_mm: f64| (median * unit_mm).ln().abs();
    let nearest = (UNITS.iter()).min_by(|one, other| off(one.1).total_cmp(&off(other.1)));
    let (Some(&(name, unit_mm)), Some(entry)) = (
        nearest.filter(|unit| off(unit.1) < off(1.0)),
        config.option(SECTION, "distance0"),
    ) else {
        return Ok(());
    };
    let message = format!(
        "found `{}` for `distance0`, in {name}, expected millimetres: distances are {median:.4} of those that the other \
         options give, in the median",
        entry.setting.value
    );
    Err(config
        .wrong(files::FIRMWARE_CONTRADICTION, entry, message)
        .help(format!("multiply all distances by {unit_mm}")))
}
