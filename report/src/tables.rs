//! The tables of the report, as text cells: terminal and HTML print the same digits from here.

use tau::assumptions::{OrientationPoint, PathDeviation};
use tau::calibration::{Combination, LinkResult, LinkSigma, ParameterEstimate, Source};
use tau::robot::{Architecture, Arm, Owner};
use tau::sensitivity::{ParameterSensitivity, Sensitivity, Turn};
use tau::session::Calibrated;
use tau::study::results::{Study, VariantResult};

use super::findings;
use super::measured;
use super::number::{
    concise, decimals, fixed, general, largest, rms, scientific, shared_decimals, with_sigma,
};
use super::parts;
use super::table::{Cell, Column, Table, columns, number, text};

/// Errors of each variant, or, where poses were not measured, those of measurements that were held out.
pub(super) fn errors(study: &Study) -> Table {
    if study.setting.rows.is_some() {
        return measured::of_study(study);
    }
    let positions = study.variants.iter().flat_map(|variant| {
        let position = variant.evaluation.position_um;
        [position.mean, position.max, position.rms]
    });
    let axes = study.setting.architecture.plate.turning_axes();
    let angles_mrad = |variant: &VariantResult| {
        let about = variant.evaluation.orientation_rad_max_abs;
        about
            .map(|about| parts::turning(study.setting.architecture, about.map(|angle| 1e3 * angle)))
    };
    let all_angles = study.variants.iter().filter_map(angles_mrad).flatten();
    let decimals = shared_decimals(positions);
    let angle_decimals = shared_decimals(all_angles);
    let rows = study
        .variants
        .iter()
        .map(|variant| {
            let position = variant.evaluation.position_um;
            let mut row = vec![text(&variant.name)];
            row.extend(
                [position.mean, position.max, position.rms].map(|value| number(value, decimals)),
            );
            match angles_mrad(variant) {
                Some(angles) => row.extend(angles.into_iter().map(|a| number(a, angle_decimals))),
                None => row.extend(axes.iter().map(|_| Cell::Empty)),
            }
            row
        })
        .collect();
    Table {
        title: format!("Errors at the {}", findings::compared(&study.setting).1),
        columns: columns(&[
            ("", &["Variant"]),
            ("Position error (µm)", &["mean", "max", "rms"]),
            (
                "Largest orientation error (mrad)",
                &parts::turning(study.setting.architecture, ["|ωx|", "|ωy|", "|ωz|"]),
            ),
        ]),
        rows,
    }
    .without_empty_columns()
}

/// Digits of a quantity with standard deviations, in all its rows.
struct Digits(usize);

impl Digits {
    /// Those that leave two of the smallest standard deviation, from the hundredth of a millimetre to the tenth of a
    /// micrometre.
    fn of(sigmas: impl Iterator<Item = f64>) -> Self {
        let smallest = sigmas
            .filter(|&sigma| sigma > 0.0)
            .fold(f64::INFINITY, f64::min);
        Self(decimals(smallest, 2).clamp(5, 7))
    }

    fn cell(&self, value: f64, sigma: f64) -> Cell {
        if value.is_nan() {
            return Cell::Empty;
        }
        Cell::Number(concise(value, sigma, self.0))
    }

    fn three(&self, values: Option<[f64; 3]>, sigmas: [f64; 3]) -> [Cell; 3] {
        let cell = |k: usize| values.map_or(Cell::Empty, |values| self.cell(values[k], sigmas[k]));
        [0, 1, 2].map(cell)
    }
}

/// The calibrated geometry of each link or cluster.
pub(super) fn geometry(variant: &VariantResult, of: Architecture) -> Table {
    let links = &variant.links;
    let any = |present: fn(&LinkResult) -> bool| links.iter().any(present);
    let plate = any(|link| link.plate_joint_m.is_some());
    let direction = any(|link| link.track_direction.is_some());
    let rotation = any(|link| link.track_rotation_rad.is_some());
    let mut groups: Vec<(&str, &[&str])> = vec![
        (
            "",
            match variant.arm {
                Arm::Full => &["Link"],
                Arm::Reduced => &["Cluster"],
            },
        ),
        ("Length (m)", &["L"]),
    ];
    if plate {
        groups.push(("Plate joint P (m)", &["x", "y", "z"]));
    }
    groups.push((parts::joint_heading(of), &["x", "y", "z"]));
    match (direction, rotation) {
        (false, false) => {}
        (true, true) => {
            groups.push(("", &["Track"]));
            groups.push(("Direction v or rotation (rad)", &["x", "y", "z"]));
        }
        (false, true) => groups.push(("Track rotation (rad)", &["x", "y", "z"])),
        _ => groups.push(("Track direction v", &["x", "y", "z"])),
    }
    let cost = any(|link| link.cost_m4.is_finite());
    if cost {
        groups.push(("Cost (m⁴)", &["Σ r²"]));
    }
    let widening = variant.widening();
    let sigmas: Vec<LinkSigma> = (links.iter())
        .map(|link| link.sigma_widened(widening))
        .collect();
    let lengths = Digits::of(sigmas.iter().map(|sigma| sigma.length_m));
    let joints = Digits::of(sigmas.iter().flat_map(|sigma| sigma.plate_joint_m));
    let offsets = Digits::of(sigmas.iter().flat_map(|sigma| sigma.track_offset_m));
    let tracks = Digits::of(sigmas.iter().flat_map(|sigma| sigma.track));
    let marked = |link: &LinkResult, quantity: &str, cells: [Cell; 3]| {
        let mut axes = ["x", "y", "z"].into_iter();
        cells.map(|cell| {
            let axis = axes.next().unwrap_or_default();
            cell.marked(is_drawn(
                variant,
                &format!("{}.{quantity}.{axis}", link.name),
            ))
        })
    };
    let rows = links
        .iter()
        .zip(&sigmas)
        .map(|(link, sigma)| {
            let length = lengths.cell(link.length_m, sigma.length_m);
            let mut row = vec![
                text(&link.name),
                length.marked(is_drawn(variant, &format!("{}.length", link.name))),
            ];
            if plate {
                let cells = joints.three(link.plate_joint_m, sigma.plate_joint_m);
                row.extend(marked(link, "plate_joint", cells));
            }
            let cells = offsets.three(Some(link.track_offset_m), sigma.track_offset_m);
            row.extend(marked(link, "track_offset", cells));
            if direction && rotation {
                let linear = link.track_direction.is_some();
                row.push(text(if linear { "linear" } else { "piecewise" }));
            }
            if direction || rotation {
                let track = link.track_direction.or(link.track_rotation_rad);
                row.extend(tracks.three(track, sigma.track));
            }
            if cost {
                row.push(Cell::Number(scientific(link.cost_m4, 3)));
            }
            row
        })
        .collect();
    Table {
        title: format!("Calibrated geometry, {}", variant.name),
        columns: columns(&groups),
        rows,
    }
    .without_empty_columns()
}

/// True of a parameter whose value is that of the drawing, by its tolerance, rather than of the data.
fn is_drawn(variant: &VariantResult, name: &str) -> bool {
    let mut own = variant.parameters.iter();
    own.any(|own| own.name == name && own.source() == Source::Tolerance)
}

/// Parameters of the whole machine and of its cranks, which belong to no link; `None` where there are none.
pub(super) fn machine(variant: &VariantResult) -> Option<Table> {
    let is_own = |own: &&ParameterEstimate| matches!(own.owner, Owner::Crank(_) | Owner::Robot);
    let own: Vec<_> = variant.parameters.iter().filter(is_own).collect();
    let widening = variant.widening();
    let rows = own.iter().map(|parameter| {
        let sigma = parameter.sigma_widened(widening);
        let value = concise(parameter.value, sigma, decimals(sigma, 2));
        vec![
            text(&parameter.name),
            Cell::Number(value).marked(parameter.source() == Source::Tolerance),
            text(&parameter.unit),
        ]
    });
    (!own.is_empty()).then(|| Table {
        title: format!("Calibrated machine, {}", variant.name),
        columns: columns(&[("", &["Parameter", "Value", "Unit"])]),
        rows: rows.collect(),
    })
}

/// Sum of the components of a change of orientation.
pub(super) fn turn(turn: Turn) -> &'static str {
    match turn {
        Turn::EulerAngles => "|Δα| + |Δβ| + |Δγ|",
        Turn::RotationVector => "|Δωx| + |Δωy| + |Δωz|",
    }
}

/// Sensitivities: position, orientation where the plate turns, and cost, one table each; none where no parameter is a link's.
pub(super) fn sensitivity(sensitivity: &Sensitivity, of: Architecture) -> Vec<Table> {
    type Quantity = fn(&ParameterSensitivity) -> f64;
    let orientation = format!("orientation, Σ({}) in rad", turn(sensitivity.turn));
    let turns = !of.plate.turning_axes().is_empty();
    let quantities: [(bool, &str, Quantity); 3] = [
        (
            true,
            "position, Σ(‖ΔT⁺‖ + ‖ΔT⁻‖) in mm",
            |parameter| parameter.position_mm,
        ),
        (turns, &orientation, |parameter| parameter.orientation_rad),
        (true, "change of the cost in m⁴", |parameter| {
            parameter.cost_m4
        }),
    ];
    let names = sensitivity.parameters();
    if names.is_empty() {
        return Vec::new();
    }
    let mut headings = columns(&[("", &["Link"])]);
    headings.extend(names.iter().map(|name| Column {
        group: String::new(),
        name: name.replace("Offset_", "C").replace("Orient_", "O"),
    }));
    quantities
        .into_iter()
        .filter(|(is_there, ..)| *is_there)
        .map(|(_, quantity, value)| {
            let entries = || {
                sensitivity
                    .links
                    .iter()
                    .flat_map(|link| &link.parameters)
                    .map(value)
            };
            let top = largest(entries());
            let cell = |value: f64| {
                if top < 1e-2 {
                    Cell::Number(scientific(value, 2))
                } else {
                    number(
                        value,
                        shared_decimals([top]).max(if top < 100.0 { 2 } else { 1 }),
                    )
                }
            };
            let rows = sensitivity.links.iter().map(|link| {
                let entry = |name: &&str| {
                    let mut own = link.parameters.iter();
                    let own = own.find(|own| own.parameter == *name);
                    own.map_or(Cell::Empty, |own| cell(value(own)))
                };
                let entries = names.iter().map(entry);
                [text(&link.link)].into_iter().chain(entries).collect()
            });
            Table {
                title: format!("Sensitivity: {quantity}"),
                columns: headings.clone(),
                rows: rows.collect(),
            }
        })
        .collect()
}

/// End of the solver for each variant.
pub(super) fn solver(study: &Study) -> Table {
    let count = |count: usize| Cell::Number(count.to_string());
    let rows = study
        .variants
        .iter()
        .map(|variant| {
            vec![
                text(&variant.name),
                count(variant.parameters.len()),
                count(variant.iterations),
                text(&variant.termination),
            ]
        })
        .collect();
    Table {
        title: "Solver".to_owned(),
        columns: columns(&[(
            "",
            &["Variant", "Parameters", "Iterations", "Ended because"],
        )]),
        rows,
    }
}

/// Deviation of the orientation over the grid: one row an axis about which the plate turns.
fn orientation(points: &[OrientationPoint], of: Architecture) -> Option<Table> {
    let axes = of.plate.turning_axes();
    if points.is_empty() || axes.is_empty() {
        return None;
    }
    let rows = axes
        .iter()
        .map(|&axis| {
            let values = || points.iter().map(|point| 1e3 * point.deviation_rad[axis]);
            vec![
                text(["ωx", "ωy", "ωz"][axis]),
                number(rms(values()), 3),
                number(largest(values()), 3),
            ]
        })
        .collect();
    Some(Table {
        title: "Orientation over the grid, deviation from the mean".to_owned(),
        columns: columns(&[
            ("", &["Rotation"]),
            ("Deviation (mrad)", &["rms", "largest"]),
        ]),
        rows,
    })
}

/// Deviations of cart paths: one row a track, rms and largest of each direction.
pub(super) fn paths<'a>(
    title: &str,
    tracks: impl IntoIterator<Item = (&'a str, &'a [PathDeviation])>,
) -> Option<Table> {
    let rows: Vec<_> = tracks
        .into_iter()
        .filter(|(_, points)| !points.is_empty())
        .map(|(track, points)| {
            let mut row = vec![text(track)];
            let directions: [fn(&PathDeviation) -> f64; 3] = [
                |point| point.parallel_um,
                |point| point.horizontal_um,
                |point| point.vertical_um,
            ];
            for direction in directions {
                let values = || points.iter().map(direction);
                row.extend([number(rms(values()), 1), number(largest(values()), 1)]);
            }
            row
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: title.to_owned(),
        columns: columns(&[
            ("", &["Track"]),
            ("Along (µm)", &["rms", "largest"]),
            ("Horizontal (µm)", &["rms", "largest"]),
            ("Vertical (µm)", &["rms", "largest"]),
        ]),
        rows,
    })
}

/// The checks of what the models assume, as far as there are data.
pub(super) fn assumptions(study: &Study) -> Vec<Table> {
    let assumptions = &study.assumptions;
    let linearity = assumptions
        .linearity
        .iter()
        .map(|t| (t.track.as_str(), t.points.as_slice()));
    let sets = assumptions
        .sets
        .iter()
        .map(|t| (t.track.as_str(), t.points.as_slice()));
    [
        orientation(&assumptions.orientation, study.setting.architecture),
        paths(
            "Linearity of the tracks, deviation from a straight line with even scale",
            linearity,
        ),
        paths("Set 3 against the paths of set 2", sets),
    ]
    .into_iter()
    .flatten()
    .collect()
}

/// Parameters that moved most in a calibration that are listed.
const MOVED: usize = 12;

/// The parameters of a calibration that moved most, and what it found besides them, such as places of targets.
pub(super) fn moved(found: &Calibrated) -> Table {
    let tolerances = |own: &ParameterEstimate| {
        own.tolerance
            .map_or(0.0, |tolerance| (own.value - own.nominal).abs() / tolerance)
    };
    let mut moved = found.parameters.clone();
    moved.sort_by(|a, b| tolerances(b).total_cmp(&tolerances(a)));
    moved.truncate(MOVED);
    let objects = found.unknown_poses().map_or(&[][..], |own| &own.objects);
    moved.extend(objects.iter().map(|own| ParameterEstimate {
        name: own.name.clone(),
        owner: Owner::Robot,
        unit: own.unit.to_owned(),
        nominal: f64::NAN,
        tolerance: own.tolerance,
        value: own.value,
        sigma: own.sigma,
    }));
    parameters("Parameters that moved most", &moved, found.widening())
}

/// Parameters with their standard deviations.
pub(super) fn parameters(title: &str, all: &[ParameterEstimate], widening: f64) -> Table {
    let ratio = |value: f64, tolerance: Option<f64>| match tolerance {
        Some(tolerance) if tolerance > 0.0 && value.is_finite() => number(value / tolerance, 2),
        _ => Cell::Empty,
    };
    let row = |parameter: &ParameterEstimate| {
        let sigma = parameter.sigma_widened(widening);
        let (value, shown) = with_sigma(parameter.value, sigma);
        let decimals = value.split_once('.').map_or(0, |(_, digits)| digits.len());
        let nominal = number(parameter.nominal, decimals.min(6));
        vec![
            text(&parameter.name),
            text(if parameter.unit.is_empty() {
                "1"
            } else {
                &parameter.unit
            }),
            Some(nominal)
                .filter(|_| parameter.nominal.is_finite())
                .unwrap_or(Cell::Empty),
            parameter
                .tolerance
                .map_or(Cell::Empty, |tolerance| Cell::Number(general(tolerance, 2))),
            Cell::Number(value),
            Cell::Number(shown),
            ratio(parameter.value - parameter.nominal, parameter.tolerance),
            ratio(sigma, parameter.tolerance),
        ]
    };
    Table {
        title: title.to_owned(),
        columns: columns(&[
            ("", &["Parameter", "Unit"]),
            ("Before", &["nominal", "tolerance"]),
            ("Calibrated", &["value", "σ"]),
            ("In tolerances", &["change", "σ"]),
        ]),
        rows: all.iter().map(row).collect(),
    }
}

/// A combination as a sum of at most `count` terms, small shares left out; dots stand for what is more
/// than a fiftieth of its square.
pub(super) fn combination(combination: &Combination, count: usize) -> String {
    let top = largest(combination.terms.iter().map(|(_, share)| *share));
    let notable: Vec<_> = combination
        .terms
        .iter()
        .filter(|(_, share)| share.abs() >= 0.1 * top)
        .collect();
    let mut sum = String::new();
    for (index, (name, share)) in notable.iter().take(count).enumerate() {
        let sign = match (index, *share < 0.0) {
            (0, false) => "",
            (0, true) => "−",
            (_, false) => " + ",
            (_, true) => " − ",
        };
        sum.extend([sign, &fixed(share.abs(), 2), " ", name]);
    }
    let square =
        |terms: &mut dyn Iterator<Item = f64>| terms.map(|share| share * share).sum::<f64>();
    let shown = square(&mut notable.iter().take(count).map(|(_, share)| *share));
    let all = square(&mut combination.terms.iter().map(|(_, share)| *share));
    if shown < 0.98 * all {
        sum += " + …";
    }
    sum
}

/// Combinations of which the tolerances say more than the data.
pub(super) fn undetermined(variant: &VariantResult) -> Option<Table> {
    let rows: Vec<_> = variant
        .undetermined
        .iter()
        .map(|found| {
            vec![
                Cell::Text(combination(found, 6)),
                Cell::Number(general(found.data_over_prior, 2)),
            ]
        })
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: variant.name.clone(),
        columns: columns(&[(
            "",
            &["Combination (shares in tolerances)", "σ data / σ prior"],
        )]),
        rows,
    })
}

/// A correlation, with enough digits to tell it from one.
pub(super) fn correlation(value: f64) -> String {
    fixed(value, decimals(1.0 - value.abs(), 1).clamp(3, 9))
}

/// The largest correlations of a variant, at most `count`.
pub(super) fn correlations(variant: &VariantResult, count: usize) -> Option<Table> {
    let rows: Vec<_> = variant
        .correlations
        .iter()
        .take(count)
        .map(|(one, other, value)| vec![text(one), text(other), Cell::Number(correlation(*value))])
        .collect();
    (!rows.is_empty()).then(|| Table {
        title: variant.name.clone(),
        columns: columns(&[("", &["Parameter", "and", "correlation"])]),
        rows,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn correlations_are_told_from_one() {
        assert_eq!(correlation(0.9771), "0.977");
        assert_eq!(correlation(-0.999_83), "-0.9998");
        assert_eq!(correlation(-0.999_999_6), "-0.9999996");
    }

    #[test]
    fn combinations_say_when_something_is_left_out() {
        let sum = |shares: &[f64], count| {
            let terms = shares
                .iter()
                .zip('a'..)
                .map(|(share, name)| (name.to_string(), *share));
            combination(
                &Combination {
                    terms: terms.collect(),
                    data_over_prior: 3.0,
                },
                count,
            )
        };
        assert_eq!(sum(&[0.71, -0.70, 0.05], 6), "0.71 a − 0.70 b");
        assert_eq!(sum(&[-0.58, 0.58, 0.57], 2), "−0.58 a + 0.58 b + …");
        assert_eq!(sum(&[], 3), "");
    }
}
