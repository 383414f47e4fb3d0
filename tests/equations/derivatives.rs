//! Residuals and Jacobians of every family, against dual numbers; interpreter against generated code.

use std::collections::{BTreeMap, BTreeSet};

use proptest::prelude::*;
use tau::Robot;
use tau::kinematics::zyz;
use tau::robot::Plate;
use tau::robot::{Input, Instance, Owner, ResidualKind, Variant};
use tau_estimation::numerics::distribution::Random;
use tau_model_dsl::Model;

use crate::blocks::check_blocks;
use crate::reference::{By, Point, residuals};

fn random_point(robot: &Robot, variant: &Variant, seed: u64) -> Point {
    let mut random = Random(seed);
    let mut uniform = |low: f64, high: f64| low + (high - low) * random.uniform();
    let mut inputs: BTreeSet<Input> = variant
        .instances
        .iter()
        .flat_map(|i| i.inputs.clone())
        .collect();
    inputs.extend((0..robot.commands).map(Input::Command));
    inputs.extend((0..3).flat_map(|i| [Input::Position(i), Input::Angle(i)]));
    // The rotation follows from the angles.
    inputs.retain(|input| !matches!(input, Input::Rotation(_)));
    let mut data: BTreeMap<Input, f64> = inputs
        .into_iter()
        .map(|input| {
            let value = match input {
                Input::Angle(_) => uniform(-3.0, 3.0),
                Input::Time => uniform(0.0, 4.0),
                Input::Temperature => uniform(15.0, 30.0),
                Input::Direction(_) => uniform(-1.0, 1.0).signum(),
                // Belts that slope are no shorter than the height.
                Input::Command(_) => uniform(0.2, 2.0) * uniform(-1.0, 1.0).signum(),
                _ => uniform(-2.0, 2.0),
            };
            (input, value)
        })
        .collect();
    let angles = [0, 1, 2].map(|k| data[&Input::Angle(k)]);
    let rotation = zyz(match robot.plate {
        Plate::BodyInPlane => [angles[0], 0.0, angles[2]],
        _ => angles,
    });
    data.extend((0..9).map(|k| (Input::Rotation(k), rotation[(k / 3, k % 3)])));
    // Segments have a positive length.
    let starts: Vec<(usize, f64)> = data
        .iter()
        .filter_map(|(input, &value)| match input {
            Input::SegmentStartCommand(track) => Some((*track, value)),
            _ => None,
        })
        .collect();
    for (track, start) in starts {
        data.insert(Input::SegmentEndCommand(track), start + uniform(0.5, 1.5));
    }
    let parameters: Vec<f64> = variant
        .parameters
        .iter()
        .map(|parameter| match (parameter.search, parameter.owner) {
            (Some((low, high)), _) => uniform(low.max(high / 3.0), high),
            // Formulas of the machine's parameters have a meaning near their values: an arm is longer than a radius.
            (None, Owner::Robot) => {
                let nominal = parameter.nominal.unwrap_or_default();
                nominal * uniform(0.9, 1.1) + 0.01 * uniform(-1.0, 1.0)
            }
            (None, _) => uniform(0.2, 2.0) * uniform(-1.0, 1.0).signum(),
        })
        .collect();
    // Those that the variant holds come as data.
    for (input, value) in &mut data {
        if let Input::Held(index) = *input {
            *value = parameters[index];
        }
    }
    Point { data, parameters }
}

/// Data and parameters as the family's slices want them.
fn slices(instance: &Instance, point: &Point) -> (Vec<f64>, Vec<f64>) {
    let data = instance
        .inputs
        .iter()
        .map(|input| point.data[input])
        .collect();
    let parameters = instance.parameters.iter();
    let parameters = parameters.map(|&index| point.parameters[index]);
    (data, parameters.collect())
}

fn columns(instance: &Instance) -> Vec<By> {
    if instance.kind == ResidualKind::ClosureByPose {
        let pose = (0..3).map(By::Translation).chain((0..3).map(By::Rotation));
        let commands = instance.inputs.iter().filter_map(|input| match input {
            Input::Command(command) => Some(By::Command(*command)),
            _ => None,
        });
        pose.chain(commands).collect()
    } else {
        instance
            .parameters
            .iter()
            .map(|&index| By::Parameter(index))
            .collect()
    }
}

/// Residuals, then the Jacobian's entries.
fn evaluate(instance: &Instance, point: &Point) -> (Vec<f64>, Vec<f64>) {
    let (data, parameters) = slices(instance, point);
    let family = &instance.family;
    let shape = family.shape();
    assert_eq!(
        (shape.data, shape.parameters),
        (data.len(), parameters.len())
    );
    let mut prepared = vec![0.0; shape.prepared];
    family.prepare(&data, &mut prepared);
    let mut value = vec![0.0; shape.residuals];
    family.value(&prepared, &parameters, &mut value);
    let mut residuals = vec![0.0; shape.residuals];
    let mut jacobian = vec![0.0; family.pattern().len()];
    family.linearize(&prepared, &parameters, &mut residuals, &mut jacobian);
    for (a, b) in value.iter().zip(&residuals) {
        assert!(
            (a - b).abs() <= 1e-13 * b.abs().max(1.0),
            "value {a} and linearize {b} differ"
        );
    }
    (residuals, jacobian)
}

/// Compares one instance with the reference: values and every derivative, zeros included.
fn check_instance(model: &Model, variant: &Variant, instance: &Instance, point: &Point) {
    let (values, jacobian) = evaluate(instance, point);
    let pattern = instance.family.pattern();
    let columns = columns(instance);
    let mut dense = vec![vec![0.0; columns.len()]; values.len()];
    for (row, dense) in dense.iter_mut().enumerate() {
        let entries = pattern.row_starts[row] as usize..pattern.row_starts[row + 1] as usize;
        for entry in entries {
            dense[pattern.columns[entry] as usize] = jacobian[entry];
        }
    }
    let by_column: Vec<Vec<num_dual::Dual64>> = columns
        .iter()
        .map(|&by| residuals(model, variant, instance, point, by))
        .collect();
    for row in 0..values.len() {
        let scale = by_column
            .iter()
            .map(|c| c[row].eps.abs())
            .fold(1.0, f64::max);
        let reference = by_column.first().map_or_else(
            || residuals(model, variant, instance, point, By::Command(usize::MAX))[row].re,
            |column| column[row].re,
        );
        assert!(
            (values[row] - reference).abs() <= 1e-12 * scale.max(reference.abs()),
            "{} {:?} of {}: residual {row} is {}, by hand {reference}",
            variant.name,
            instance.kind,
            instance.of,
            values[row],
        );
        for (column, by) in columns.iter().enumerate() {
            let expected = by_column[column][row].eps;
            assert!(
                (dense[row][column] - expected).abs() <= 1e-12 * scale,
                "{} {:?} of {}: derivative of residual {row} by {by:?} is {}, by dual numbers {expected}",
                variant.name,
                instance.kind,
                instance.of,
                dense[row][column],
            );
        }
    }
}

/// One block and a part of a second.
fn check_variant_in_blocks(robot: &Robot, variant: &Variant, seed: u64) {
    let points: Vec<Point> = (seed..seed + 11)
        .map(|seed| random_point(robot, variant, seed))
        .collect();
    for instance in &variant.instances {
        let samples: Vec<Vec<f64>> = points
            .iter()
            .map(|point| slices(instance, point).0)
            .collect();
        let parameters = slices(instance, &points[0]).1;
        check_blocks(&variant.name, instance, &samples, &parameters);
    }
}

pub(crate) fn check_robot(robot: &Robot, model: &Model, seeds: std::ops::Range<u64>) {
    for variant in robot.variants.iter() {
        for seed in seeds.clone() {
            let point = random_point(robot, variant, seed);
            for instance in &variant.instances {
                check_instance(model, variant, instance, &point);
            }
        }
        check_variant_in_blocks(robot, variant, seeds.start);
    }
}

#[test]
fn generated_gantry_tau_agrees_with_dual_numbers() {
    let robot = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let model = tau_model_dsl::check_text(&robot.description).unwrap();
    check_robot(&robot, &model, 0..8);
}

#[test]
fn robots_of_other_layouts_agree_with_dual_numbers() {
    for text in [
        include_str!("../robots/linear_delta.tau"),
        include_str!("../robots/hexaglide.tau"),
        include_str!("../robots/four_track.tau"),
        include_str!("../robots/stewart.tau"),
    ] {
        let robot = Robot::from_text(text).unwrap_or_else(|errors| panic!("{errors:?}"));
        let model = tau_model_dsl::check_text(text).unwrap();
        check_robot(&robot, &model, 0..3);
    }
}

/// A body in the plane has families of its own, with a full arm and with a reduced one.
#[test]
fn a_body_in_the_plane_agrees_with_dual_numbers() {
    let text = "robot Planar {
    plate body in plane;
    param size: length = 0.2 m tol 1 mm;
    param corner[3]: length = (0.1, -0.05, 0.02) m tol 1 mm;
    track one, two;
    cluster a on one { link a1; link a2 { plate_joint = corner; } }
    cluster b on two { link b1 { plate_joint = (size, -size / 2, 0 m); } }
    effect placement on link { param offset[3]: length; joint += offset; }
    effect swing on cart { param yaw1: rad/m; yaw += yaw1 * q; }
    effect drift on tcp { param rate[3]: m/s; position += rate * time; }
    variant Full { arm full; tracks linear per link; }
    variant Bent = Full + placement(a1) + swing(one) + drift(tcp);
    variant Held = Full hold corner, size, all.plate_joint;
}";
    let reduced = "robot Sliders {
    plate body in plane;
    track one, two, three;
    cluster a on one { link a1; }
    cluster b on two { link b1; }
    cluster c on three { link c1; }
    variant Reduced { arm reduced; tracks linear; }
    variant Full { arm full; tracks piecewise; }
}";
    for text in [text, reduced] {
        let robot = Robot::from_text(text).unwrap_or_else(|errors| panic!("{errors}"));
        let model = tau_model_dsl::check_text(text).unwrap();
        check_robot(&robot, &model, 0..4);
    }
}

#[test]
fn interpreter_agrees_with_generated_code_bit_for_bit() {
    let generated = Robot::from(&tau_generated::gantry_tau::ROBOT);
    let interpreted = Robot::from_text(&generated.description).unwrap();
    check_bit_for_bit(&generated, &interpreted);
}

/// Two robots of one description give the same numbers.
pub(crate) fn check_bit_for_bit(generated: &Robot, interpreted: &Robot) {
    for (a, b) in generated.variants.iter().zip(interpreted.variants.iter()) {
        assert_eq!(a.parameters, b.parameters);
        for seed in 0..8 {
            let point = random_point(generated, a, seed);
            for (x, y) in a.instances.iter().zip(&b.instances) {
                assert_eq!((x.kind, x.of, &x.inputs), (y.kind, y.of, &y.inputs));
                let bits = |(residuals, jacobian): (Vec<f64>, Vec<f64>)| -> Vec<u64> {
                    residuals
                        .iter()
                        .chain(&jacobian)
                        .map(|value| value.to_bits())
                        .collect()
                };
                assert_eq!(
                    bits(evaluate(x, &point)),
                    bits(evaluate(y, &point)),
                    "{} {:?} of {}",
                    a.name,
                    x.kind,
                    x.of,
                );
            }
        }
    }
}

#[test]
fn many_samples_equal_single_samples() {
    let robot = Robot::from_text(tau_generated::gantry_tau::ROBOT.description).unwrap();
    let variant = robot.variant("FullRack").unwrap();
    for instance in variant.instances_of(ResidualKind::CartPosition) {
        let shape = instance.family.shape();
        let samples = 37; // Two blocks and a rest.
        let parameters = slices(instance, &random_point(&robot, variant, 0)).1;
        let mut data = Vec::new();
        let mut single = Vec::new();
        for seed in 0..samples {
            let mut point = random_point(&robot, variant, seed);
            point.parameters = random_point(&robot, variant, 0).parameters;
            data.extend(slices(instance, &point).0);
            single.push(evaluate(instance, &point));
        }
        let mut prepared = vec![0.0; shape.prepared * samples as usize];
        instance.family.prepare_all(&data, &mut prepared);
        let mut residuals = vec![0.0; shape.residuals * samples as usize];
        let mut jacobian = vec![0.0; instance.family.pattern().len() * samples as usize];
        instance
            .family
            .linearize_all(&prepared, &parameters, &mut residuals, &mut jacobian);
        assert_eq!(
            residuals,
            single.iter().flat_map(|s| s.0.clone()).collect::<Vec<_>>()
        );
        assert_eq!(
            jacobian,
            single.iter().flat_map(|s| s.1.clone()).collect::<Vec<_>>()
        );
        let mut values = vec![0.0; residuals.len()];
        instance
            .family
            .value_all(&prepared, &parameters, &mut values);
        for (a, b) in values.iter().zip(&residuals) {
            assert!((a - b).abs() < 1e-13 * b.abs().max(1.0));
        }
    }
}

/// A description with a random layout, random variants and random effects.
fn description() -> impl Strategy<Value = String> {
    let scalar = prop_oneof![
        Just("q / period"),
        Just("sin(2*pi*q/period)"),
        Just("cos(q/period) * (q/period)^2"),
        Just("abs(q) / period"),
        Just("min(q, period) / period"),
        Just("max(q, period)^3 / period^3"),
        Just("sign(q)"),
        Just("tanh(q/period)"),
        Just("atan(q/period) / 1 rad"),
        Just("exp(-(q/period)^2)"),
        Just("ln(1 + (q/period)^2)"),
        Just("sqrt(1 + (q/period)^2)"),
        Just("direction"),
        Just("time / 1 s"),
        Just("(temperature - 20 K) / 1 K"),
        Just("load_along / 1 N"),
        Just("load_vertical / (2 N)"),
        Just("(x + y - 2*z) / period"),
        Just("1 - (q/period - 2)^2"),
    ];
    let target = prop_oneof![Just("along"), Just("horizontal"), Just("vertical"),];
    let turn = prop_oneof![Just("roll"), Just("pitch"), Just("yaw")];
    // Links beyond the first on a cart take freedoms of the plate, which has six.
    let moves = |clusters: &Vec<usize>| clusters.iter().map(|links| links - 1).sum::<usize>() < 6;
    let clusters = prop::collection::vec(1_usize..=4, 1..=4);
    let clusters = clusters.prop_filter("the plate moves", moves);
    (
        clusters,
        scalar.clone(),
        scalar,
        target,
        turn,
        any::<[bool; 4]>(),
    )
        .prop_map(|(clusters, first, second, target, turn, flags)| {
            let mut text = String::from("robot Random {\n");
            let mut link = 0;
            // Six links hold a plate: the last cluster has those that are missing.
            let missing = 6_usize.saturating_sub(clusters.iter().sum());
            for (index, count) in clusters.iter().enumerate() {
                let count = &(count
                    + if index + 1 == clusters.len() {
                        missing
                    } else {
                        0
                    });
                let links: Vec<String> = (0..*count).map(|i| format!("l{}", link + i)).collect();
                link += count;
                text += &format!(
                    "track t{index};\ncluster c{index} on t{index} {{ link {}; }}\n",
                    links.join(", ")
                );
            }
            let per_link = if flags[0] { " per link" } else { "" };
            let last = if flags[1] { "piecewise" } else { "linear" };
            text += &format!(
                "variant Reduced {{ arm reduced; tracks {last}; }}
                 variant Full {{ arm full; tracks linear{per_link}; track t0 {last}{per_link}; }}
                 effect shift on cart {{
                     param a, b: length;
                     search period: length in 1 m ..= 3 m;
                     {target} += a * ({first}) * cos(q/period) + b * ({second});
                 }}
                 effect swing on cart {{ param angle: angle; {turn} += angle * ({period}); }}
                 effect stretch on link {{
                     param strain: 1/N;
                     param offset[3]: length;
                     length += length * strain * tension;
                     joint += offset * 2;
                 }}
                 effect drift on tcp {{
                     param rate[3]: m/s;
                     param scale: 1;
                     position += rate * time + scale * (x, y, z);
                 }}
                 effect talk on cart from source {{ param gain: 1; along += gain * q(source); }}\n",
                period = second.replace("period", "(2 m)"),
            );
            text += "variant Moved = Full + shift(t0) + swing(t0) + drift(tcp);\n";
            text += "variant Stretched = Full + stretch(l0) + drift(tcp);\n";
            text += "variant Common = Reduced + shift(all) + drift(tcp);\n";
            if clusters.len() > 1 {
                text += "variant Talking = Moved + talk(t1, t0) + stretch(all);\n";
            }
            text += "}\n";
            text
        })
}

/// A description of a random machine: of any plate, with driven lengths, a drum, a crank and a track, formulas and `hold`.
fn machine() -> impl Strategy<Value = String> {
    const PLATES: [(&str, usize); 4] = [
        ("body", 6),
        ("point", 3),
        ("body in plane", 3),
        ("point in plane", 2),
    ];
    (
        prop::sample::select(&PLATES[..]),
        0_usize..=1,
        any::<[bool; 4]>(),
    )
        .prop_map(|((plate, freedoms), more, flags)| {
            let is_body = plate.starts_with("body");
            let choose = |flag: usize, yes: &'static str, no: &'static str| {
                if flags[flag] { yes } else { no }
            };
            // One link each on the track, the crank, the drum and the first leg.
            let legs: Vec<String> = (1..(freedoms + more).saturating_sub(3))
                .map(|k| format!("l{k}"))
                .collect();
            let legs = if legs.is_empty() {
                String::new()
            } else {
                format!("link {} actuated length;", legs.join(", "))
            };
            let joint = if is_body {
                choose(0, "plate_joint = 0.3 * place + (0 m, zero, 0 m);", "")
            } else {
                ""
            };
            let axis = if plate.ends_with("plane") {
                "axis = (0, 0, 1) exact;"
            } else {
                choose(1, "axis = (0.6, 0, 0.8) exact;", "")
            };
            let centre = choose(2, "centre = 0.5 * place;", "");
            let rod = choose(3, "length = norm(track_offset) + 0.2 * zero;", "");
            let placement = if is_body { " + placement(k)" } else { "" };
            format!(
                "robot Random {{
    plate {plate};
    param zero: length = 1.5 m tol 1 mm;
    param scale: ratio = 0.1 tol 100 ppm;
    param radius: m/rad = 0.2 m/rad tol 1 mm/rad;
    param place[3]: length = (0.3, -0.2, 0.1) m tol 1 mm;
    track t;
    crank c {{ {axis} {centre} }}
    cluster on_base on base {{
        link l0 actuated length {{
            length = zero + (1 + scale) * q;
            track_offset = place + (0 m, 1 m, 0.5 * zero);
        }}
        {legs}
        link d actuated angle {{ length = norm(track_offset) + radius * q; }}
    }}
    cluster on_crank on c {{ link k {{ {rod} {joint} }} }}
    cluster on_track on t {{ link m; }}
    effect warm on link {{
        param expansion: 1/K tol 1 ppm/K;
        length += length * expansion * (temperature - 20 K);
    }}
    effect counted on driven link {{ param offset: length; length += offset * tanh(q / (1 m)); }}
    effect wound on link actuated angle {{ param share: ratio; length += share * paid_out; }}
    effect placement on link {{ param offset[3]: length; joint += offset; }}
    effect drift on tcp {{ param rate[3]: m/s; position += rate * time; }}
    effect rack on cart {{ param bend: 1/m; along += bend * q^2; horizontal += 2 * bend * q^2; }}
    variant Full {{ arm full; tracks linear; }}
    variant Held = Full hold zero, place, all.track_offset;
    variant Wrong = Full + warm(all) + counted(l0) + wound(d) + drift(tcp) + rack(t){placement};
    variant Both = Wrong hold scale, m.length, m.track_offset;
}}"
            )
        })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_descriptions_agree_with_dual_numbers(text in description(), seed in any::<u64>()) {
        let robot = Robot::from_text(&text)
            .unwrap_or_else(|errors| panic!("{errors:?}\n{text}"));
        let model = tau_model_dsl::check_text(&text).unwrap();
        let seed = seed % 1_000_000;
        check_robot(&robot, &model, seed..seed + 1);
    }

    #[test]
    fn random_machines_agree_with_dual_numbers(text in machine(), seed in 0_u64..1_000_000) {
        let robot = Robot::from_text(&text)
            .unwrap_or_else(|errors| panic!("{errors}\n{text}"));
        let model = tau_model_dsl::check_text(&text).unwrap();
        check_robot(&robot, &model, seed..seed + 1);
    }
}
