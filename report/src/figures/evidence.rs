//! Evidence in the residuals for each effect that was found.

use tau::discovery::Discovery;
use tau::discovery::results::{Dimension, Evidence, FoundEffect, Pattern, Readable, Spectrum};

use super::Figure;
use super::axis::{Axis, typographic};
use super::chart::{
    self, ACCENT, Anchor, Grid, Marker, PALE, Panel, Rect, STRONG, Show, Style, WIDTH,
};
use crate::discovery::words::part;
use crate::discovery::{at, labelled, readable, readable_at};
use crate::number::general;

const POINTS: Style = Style {
    color: PALE,
    marker: Marker::Disc,
};
const MEANS: Style = Style {
    color: STRONG,
    marker: Marker::Square,
};

/// The figures of each effect, in the order in which the effects were found.
pub fn evidence(found: &Discovery) -> Vec<Figure> {
    found
        .evidence
        .iter()
        .enumerate()
        .flat_map(|(index, evidence)| {
            // A full arm stands among the effects and has none.
            let of = |effect: &&FoundEffect| {
                effect.name == evidence.name && effect.place == evidence.place
            };
            let spectrum = || {
                let effect = found.effects.iter().find(of)?;
                self::spectrum(index, effect, evidence.spectrum.as_ref()?)
            };
            [residuals(index, evidence), spectrum()]
        })
        .flatten()
        .collect()
}

/// Residuals of the samples without and with an effect, with their means.
fn residuals(index: usize, evidence: &Evidence) -> Option<Figure> {
    let patterns = &evidence.residuals;
    if patterns.is_empty() {
        return None;
    }
    let effect = at(&evidence.name, &evidence.place);
    let title = format!("What the residuals show of {effect}");
    let subtitle = "What would explain the residuals of each sample (dots), with means and two standard deviations of each";
    let grid = Grid {
        rows: patterns.len(),
        columns: 2,
        margin: [62.0, 84.0, 14.0, 44.0],
        column_gap: 22.0,
        row_gap: 66.0,
        row_height: 112.0,
    };
    let drawn = chart::draw(&title, subtitle, grid.height(), |sheet| {
        for (row, pattern) in patterns.iter().enumerate() {
            let factor = covariate_factor(pattern);
            let points = || pattern.points.iter();
            let bins = || pattern.bins.iter();
            let x = covariate(pattern);
            let reach =
                points()
                    .flat_map(|point| [point[1], point[2]])
                    .chain(bins().flat_map(|bin| {
                        [bin.before, bin.after].map(|mean| mean.abs() + 2.0 * bin.sigma)
                    }));
            let Pattern { target, unit, .. } = pattern;
            let label = format!("{}, {target} ({unit})", part(&pattern.place));
            let y = Axis::symmetric(&label, reach, 4.0);
            for (column, name) in ["without it in the model", "with it"].iter().enumerate() {
                let show = Show::new(true, column == 0);
                let panel = sheet.panel(grid.cell(row, column), &x, &y, show);
                panel.title(name);
                panel.marks(
                    points().map(|point| (factor * point[0], point[1 + column])),
                    POINTS,
                    1.6,
                );
                let mean = |bin: &tau::discovery::results::Bin| {
                    (factor * bin.at, [bin.before, bin.after][column])
                };
                for bin in bins() {
                    let (at, mean) = mean(bin);
                    let reach = 2.0 * bin.sigma;
                    panel.line([(at, mean - reach), (at, mean + reach)], STRONG, 1.6);
                }
                panel.line(bins().map(mean), STRONG, 1.2);
                panel.marks(bins().map(mean), MEANS, 3.0);
            }
        }
    });
    let caption = format!(
        "Left: without {effect} in the model, fitted anew. Right: with it.{}",
        two_values(evidence)
    );
    Some(drawn.figure(format!("discovery_residuals_{}.svg", index + 1), caption))
}

/// Remark on quantities with two values.
fn two_values(evidence: &Evidence) -> &'static str {
    let has_two = |pattern: &Pattern| pattern.bins.len() == 2;
    if evidence.residuals.iter().any(has_two) {
        " Where a quantity has two values, the effect can always take up the difference of their means: that they are \
         zero on the right is so by construction; what it brings shows in the scatter."
    } else {
        ""
    }
}

/// Factor of the unit in which a quantity is shown.
fn covariate_factor(pattern: &Pattern) -> f64 {
    pattern
        .period
        .map_or(1.0, |period| readable_at(&pattern.against, period).0)
}

/// The axis of the quantity that an effect depends on.
fn covariate(pattern: &Pattern) -> Axis {
    let factor = covariate_factor(pattern);
    let values = pattern
        .points
        .iter()
        .map(|point| point[0])
        .chain(pattern.bins.iter().map(|bin| bin.at))
        .map(|value| factor * value);
    let name = match pattern.period {
        Some(period) => {
            let (factor, unit) = readable_at(&pattern.against, period);
            format!(
                "{} within a period of {} {unit} ({unit})",
                pattern.against.name,
                general(factor * period, 4)
            )
        }
        None => labelled(&pattern.against),
    };
    if pattern.against.readable == Readable::Direction {
        let sides = [(-1.0, "\u{2212}1".to_owned()), (1.0, "+1".to_owned())];
        return Axis {
            range: (-1.5, 1.5),
            ticks: sides.into(),
            ..Axis::linear(&name, values, 2.0)
        };
    }
    Axis::linear(&name, values, 5.0)
}

/// The score over the search for a parameter, without and with the effect in the model.
fn spectrum(index: usize, effect: &FoundEffect, spectrum: &Spectrum) -> Option<Figure> {
    let curve = &spectrum.curve;
    let label = at(&effect.name, &effect.place);
    let title = format!("The search for the {} of {label}", spectrum.parameter);
    let subtitle = "Score over the search, without and with the effect in the model; the line marks what is significant";
    let place = Rect {
        left: 62.0,
        top: 84.0,
        width: WIDTH - 76.0,
        height: 118.0,
    };
    let (low, high) = curve.iter().fold((f64::INFINITY, 0.0_f64), |range, point| {
        (range.0.min(point[0]), range.1.max(point[0]))
    });
    if !(low > 0.0 && high > low) {
        return None;
    }
    let drawn = chart::draw(&title, subtitle, place.top + place.height + 44.0, |sheet| {
        sheet.box_legend(&[
            ("without it", STRONG),
            ("with it", PALE),
            ("threshold", ACCENT),
        ]);
        let x = reciprocal(&spectrum.parameter, spectrum.unit, low, high);
        let scores = curve
            .iter()
            .flat_map(|point| [point[1], point[2], spectrum.threshold]);
        let y = Axis::from_zero("√score", scores.map(|score| 1.08 * score.sqrt()), 4.0);
        let panel = sheet.panel(place, &x, &y, Show::BOTH);
        for (column, color) in [(1, STRONG), (2, PALE)] {
            let points = curve
                .iter()
                .map(|point| (point[0].recip(), point[column].sqrt()));
            panel.line(points, color, 1.3);
        }
        let threshold = spectrum.threshold.sqrt();
        let ends = [(x.range.0, threshold), (x.range.1, threshold)];
        panel.line(ends, ACCENT, 1.3);
        for alias in &effect.aliases {
            mark(&panel, curve, spectrum, *alias, "alias ");
        }
        if let Some(estimate) = effect.parameters.get(&spectrum.parameter) {
            mark(&panel, curve, spectrum, estimate.value, "");
        }
    });
    let also = if effect.aliases.is_empty() {
        "No other value fits as well; smaller peaks beside the highest are its echoes."
    } else {
        "The values marked as aliases fit as well."
    };
    let caption = format!(
        "The axis is linear in one over the {}, so that all peaks are equally wide. {also}",
        spectrum.parameter
    );
    Some(drawn.figure(format!("discovery_spectrum_{}.svg", index + 1), caption))
}

/// Names the score at a value of what was searched.
fn mark(panel: &Panel<'_>, curve: &[[f64; 3]], spectrum: &Spectrum, value: f64, prefix: &str) {
    let distance = |point: &[f64; 3]| (point[0].recip() - value.recip()).abs();
    let Some(nearest) = curve
        .iter()
        .min_by(|a, b| distance(a).total_cmp(&distance(b)))
    else {
        return;
    };
    let (factor, unit) = readable(spectrum.unit, value);
    let text = format!("{prefix}{} {unit}", general(factor * value, 4));
    // Beside the peak, on the side with more room.
    let middle = 0.5 * (curve[0][0].recip() + curve[curve.len() - 1][0].recip());
    let anchor = if value.recip() > middle {
        Anchor::Right
    } else {
        Anchor::Left
    };
    panel.label(
        &text,
        (value.recip(), nearest[1].sqrt()),
        anchor,
        chart::INK,
    );
}

/// An axis even in one over a quantity, with ticks at round values of the quantity.
fn reciprocal(name: &str, unit: Dimension, low: f64, high: f64) -> Axis {
    let (factor, shown) = readable(unit, low);
    let mut ticks: Vec<(f64, String)> = Vec::new();
    let room = 0.045 * (low.recip() - high.recip());
    let mut power = 10_f64.powf((factor * high).log10().floor());
    while power * 10.0 > factor * low {
        for digit in [8.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.5, 1.0] {
            let value: f64 = digit * power;
            let at = factor / value;
            let is_inside =
                value >= factor * low * (1.0 - 1e-9) && value <= factor * high * (1.0 + 1e-9);
            if is_inside && ticks.last().is_none_or(|last| at - last.0 > room) {
                ticks.push((at, typographic(&plain(value))));
            }
        }
        power /= 10.0;
    }
    Axis {
        name: format!("{name} ({shown})"),
        range: (high.recip(), low.recip()),
        ticks,
        grid: true,
    }
}

/// A round number without zeros at its end.
fn plain(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_axis_of_reciprocals_has_round_ticks_in_order_and_apart() {
        let axis = reciprocal("period", Dimension::LENGTH, 0.004, 0.05);
        let labels: Vec<&str> = axis.ticks.iter().map(|tick| tick.1.as_str()).collect();
        assert_eq!(labels.first(), Some(&"50"));
        assert!(
            labels.contains(&"10") && labels.contains(&"4"),
            "{labels:?}"
        );
        assert!(axis.ticks.windows(2).all(|pair| pair[0].0 < pair[1].0));
        assert_eq!(axis.name, "period (mm)");
    }
}
