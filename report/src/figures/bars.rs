//! Mean and largest errors as bars, a row each.

use super::axis::Axis;
use super::chart::{self, ACCENT, Anchor, Drawn, PALE, Rect, STRONG, Show, WIDTH};
use super::length_unit;
use crate::number::{fixed, largest, shared_decimals};

/// Longest label that is given room (characters).
const LONGEST: usize = 48;

/// Rows of bars, from the top: what each is called, its mean and its largest position error (µm). A line marks the
/// mean of the noise, where that is given (µm).
pub(super) fn draw(
    (title, subtitle): (&str, &str),
    rows: &[(String, [f64; 2])],
    noise_um: Option<f64>,
) -> Drawn {
    let values = || rows.iter().flat_map(|(_, errors)| *errors);
    let (factor, unit) = length_unit(largest(values()));
    let decimals = shared_decimals(values().map(|value| factor * value));
    let lengths = rows.iter().map(|(label, _)| label.chars().count());
    let longest = lengths.max().unwrap_or(0).min(LONGEST);
    let left = 24.0 + 6.4 * longest as f64;
    let place = Rect {
        left,
        top: 74.0,
        width: WIDTH - left - 30.0,
        height: 36.0 * rows.len() as f64,
    };
    chart::draw(title, subtitle, place.top + place.height + 44.0, |sheet| {
        let legend = [("mean", STRONG), ("largest", PALE), ("noise", ACCENT)];
        let shown = if noise_um.is_some() { 3 } else { 2 };
        sheet.box_legend(&legend[..shown]);
        let noise = noise_um.map(|noise_um| factor * noise_um);
        let reach = values().map(|value| 1.06 * factor * value).chain(noise);
        let x = Axis::from_zero(&format!("position error ({unit})"), reach, 8.0);
        let mut y = Axis::names("", rows.iter().map(|(label, _)| label.clone()));
        // The first row stands on top.
        let top = y.range.1;
        for tick in &mut y.ticks {
            tick.0 = top - tick.0;
        }
        let panel = sheet.panel(place, &x, &y, Show::BOTH);
        for ((_, [mean, largest]), (centre, _)) in rows.iter().zip(&y.ticks) {
            let bars = [(mean, 0.02, 0.34, STRONG), (largest, -0.34, -0.02, PALE)];
            for (error, low, high, color) in bars {
                let error = factor * error;
                panel.bar((0.0, centre + low), (error, centre + high), color);
                let at = (error, centre + 0.5 * (low + high));
                panel.label(&fixed(error, decimals), at, Anchor::Left, chart::INK);
            }
        }
        if let Some(noise) = noise {
            panel.line([(noise, 0.0), (noise, top)], ACCENT, 1.5);
        }
    })
}
