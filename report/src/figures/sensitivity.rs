//! Sensitivity of the pose to each parameter.

use tau::robot::Architecture;
use tau::sensitivity::{ParameterSensitivity, Sensitivity};
use tau::study::results::Study;

use super::axis::{Axis, typographic};
use super::chart::{self, Grid, STRONG, Show, Style, series};
use super::{Figure, angle_unit, length_unit};
use crate::number::{general, largest};
use crate::parts;
use crate::tables::turn;

/// Change of the TCP position for a step in each parameter of each link.
pub fn position_sensitivity(study: &Study) -> Option<Figure> {
    let sensitivity = study.sensitivity.as_ref()?;
    let values: fn(&ParameterSensitivity) -> &[f64] = |parameter| &parameter.by_pose_um;
    let (factor, unit) = length_unit(largest_of(sensitivity, values));
    draw(
        (sensitivity, study.setting.architecture),
        "sensitivity_position.svg",
        "Sensitivity of the position",
        values,
        (factor, &format!("‖ΔT‖ ({unit})")),
    )
}

/// Change of the orientation for a step in each parameter of each link.
pub fn orientation_sensitivity(study: &Study) -> Option<Figure> {
    let turns = !study.setting.architecture.plate.turning_axes().is_empty();
    let sensitivity = study.sensitivity.as_ref().filter(|_| turns)?;
    let values: fn(&ParameterSensitivity) -> &[f64] = |parameter| &parameter.by_pose_rad;
    let (factor, unit) = angle_unit(largest_of(sensitivity, values));
    draw(
        (sensitivity, study.setting.architecture),
        "sensitivity_orientation.svg",
        "Sensitivity of the orientation",
        values,
        (
            factor,
            &format!("{} ({unit})", turn(sensitivity.turn).replace(' ', "")),
        ),
    )
}

fn largest_of(sensitivity: &Sensitivity, values: fn(&ParameterSensitivity) -> &[f64]) -> f64 {
    let parameters = sensitivity.links.iter().flat_map(|link| &link.parameters);
    largest(parameters.flat_map(|parameter| values(parameter).iter().copied()))
}

/// Short form of a parameter's name, for ticks.
fn short(parameter: &str) -> String {
    parameter.replace("Offset_", "C").replace("Orient_", "O")
}

fn draw(
    (sensitivity, architecture): (&Sensitivity, Architecture),
    file_name: &str,
    title: &str,
    values: fn(&ParameterSensitivity) -> &[f64],
    (factor, quantity): (f64, &str),
) -> Option<Figure> {
    let links = &sensitivity.links;
    let any = links
        .iter()
        .flat_map(|link| &link.parameters)
        .any(|parameter| !values(parameter).is_empty());
    let letters = parts::letters(sensitivity, architecture).filter(|_| any)?;
    let step = typographic(&general(sensitivity.step, 1));
    let subtitle = format!(
        "Effect of a step of +{step} (SI units) in each parameter at {} poses: mean (disc) and range (bar)",
        sensitivity.poses
    );
    let columns = links.len().clamp(1, 3);
    let grid = Grid {
        rows: links.len().div_ceil(columns),
        columns,
        margin: [62.0, 74.0, 14.0, 32.0],
        column_gap: 14.0,
        row_gap: 48.0,
        row_height: 150.0,
    };
    let drawn = chart::draw(title, &subtitle, grid.height(), |sheet| {
        let all = links.iter().flat_map(|link| &link.parameters);
        let y = Axis::from_zero(
            quantity,
            all.flat_map(|p| values(p).iter().map(|value| factor * value)),
            6.0,
        );
        for (index, link) in links.iter().enumerate() {
            let (row, column) = (index / columns, index % columns);
            let x = Axis::names("", link.parameters.iter().map(|p| short(&p.parameter)));
            let panel = sheet.panel(grid.cell(row, column), &x, &y, Show::new(true, column == 0));
            panel.title(&format!("link {}", link.link));
            for (parameter, (centre, _)) in link.parameters.iter().zip(&x.ticks) {
                let finite = || {
                    values(parameter)
                        .iter()
                        .map(|value| factor * value)
                        .filter(|v| v.is_finite())
                };
                let count = finite().count();
                if count == 0 {
                    continue;
                }
                let low = finite().fold(f64::INFINITY, f64::min);
                let high = finite().fold(0.0, f64::max);
                let mean = finite().sum::<f64>() / count as f64;
                panel.bar((centre - 0.16, low), (centre + 0.16, high), chart::PALE);
                panel.marks(
                    [(*centre, mean)],
                    Style {
                        color: STRONG,
                        ..series(0)
                    },
                    3.2,
                );
            }
        }
    });
    let caption = format!(
        "Variant {}; one panel a link, all on one scale. {letters} The tables of sensitivity sum these effects over \
             the poses, with steps both ways.",
        sensitivity.variant,
    );
    Some(drawn.figure(file_name, caption))
}
