//! Residuals and Jacobians of every family, against dual numbers; generated code against the interpreter.

mod descriptions;

use std::collections::{BTreeMap, BTreeSet};
use std::fs;

use num_dual::Dual64;
use proptest::prelude::*;
use tau::Robot;
use tau::kinematics::zyz;
use tau::robot::{Input, Instance, Owner, Plate, ResidualKind, Variant};
use tau_model_dsl::Model;
use tau_testkit::robots::described;
use tau_testkit::{ROBOTS, Random};

use crate::blocks::{bits, check_blocks, one_by_one};
use crate::reference::{By, Point, residuals};

fn random_point(robot: &Robot, variant: &Variant, seed: u64) -> Point {
    let mut random = Random(seed);
    let mut uniform = |low: f64, high: f64| low + (high - low) * random.uniform();
    let instances = variant.instances.iter();
    let mut inputs: BTreeSet<Input> = instances.flat_map(|i| i.inputs.clone()).collect();
    inputs.extend((0..robot.commands).map(Input::Command));
    inputs.extend((0..3).flat_map(|i| [Input::Position(i), Input::Angle(i)]));
    // The rotation follows from the angles.
    inputs.retain(|input| !matches!(input, Input::Rotation(_)));
    let mut data = BTreeMap::new();
    for input in inputs {
        let value = match input {
            Input::Angle(_) => uniform(-3.0, 3.0),
            Input::Time => uniform(0.0, 4.0),
            Input::Temperature => uniform(15.0, 30.0),
            Input::Direction(_) => uniform(-1.0, 1.0).signum(),
            Input::TravelHalf(_) => uniform(0.3, 2.0),
            // Belts that slope are no shorter than the height.
            Input::Command(_) => uniform(0.2, 2.0) * uniform(-1.0, 1.0).signum(),
            _ => uniform(-2.0, 2.0),
        };
        data.insert(input, value);
    }
    let mut angles = [0, 1, 2].map(|k| data[&Input::Angle(k)]);
    if robot.plate == Plate::BodyInPlane {
        angles[1] = 0.0;
    }
    let rotation = zyz(angles);
    data.extend((0..9).map(|k| (Input::Rotation(k), rotation[(k / 3, k % 3)])));
    // Segments have a positive length.
    for track in 0..robot.tracks.len() {
        if let Some(&start) = data.get(&Input::SegmentStartCommand(track)) {
            data.insert(Input::SegmentEndCommand(track), start + uniform(0.5, 1.5));
        }
    }
    let mut parameters = Vec::new();
    for parameter in &variant.parameters {
        parameters.push(match (parameter.search, parameter.owner) {
            (Some((low, high)), _) => uniform(low.max(high / 3.0), high),
            // Formulas of the machine's parameters have a meaning near their values: an arm is longer than a radius.
            (None, Owner::Robot) => {
                let nominal = parameter.nominal.unwrap_or_default();
                nominal * uniform(0.9, 1.1) + 0.01 * uniform(-1.0, 1.0)
            }
            (None, _) => uniform(0.2, 2.0) * uniform(-1.0, 1.0).signum(),
        });
    }
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
    let data = instance.inputs.iter().map(|input| point.data[input]);
    let parameters = instance.parameters.iter();
    let parameters = parameters.map(|&index| point.parameters[index]);
    (data.collect(), parameters.collect())
}

fn columns(instance: &Instance) -> Vec<By> {
    if instance.kind != ResidualKind::ClosureByPose {
        let parameters = instance.parameters.iter();
        return parameters.map(|&index| By::Parameter(index)).collect();
    }
    let pose = (0..3).map(By::Translation).chain((0..3).map(By::Rotation));
    let commands = instance.inputs.iter().filter_map(|input| match input {
        Input::Command(command) => Some(By::Command(*command)),
        _ => None,
    });
    pose.chain(commands).collect()
}

/// Share by which numbers may differ: waves pass hundreds of radians, which code and reference round differently.
const ROUNDED: f64 = 4e-12;

/// Compares one instance with the reference: values and every derivative, zeros included.
fn check_instance(model: &Model, variant: &Variant, instance: &Instance, point: &Point) {
    let (data, parameters) = slices(instance, point);
    let [_, values, jacobian] = one_by_one(&*instance.family, &data, &parameters);
    let pattern = instance.family.pattern();
    let columns = columns(instance);
    let by = |by: By| residuals(model, variant, instance, point, by);
    let by_column: Vec<Vec<Dual64>> = columns.iter().map(|&column| by(column)).collect();
    let plain = by(By::Command(usize::MAX));
    for (row, value) in values.into_iter().enumerate() {
        let what = || format!("{} {:?} {}", variant.name, instance.kind, instance.of);
        let mut dense = vec![0.0; columns.len()];
        let entries = pattern.row_starts[row] as usize..pattern.row_starts[row + 1] as usize;
        for entry in entries {
            dense[pattern.columns[entry] as usize] = jacobian[entry];
        }
        let derivatives = by_column.iter().map(|column| column[row].eps);
        let scale = derivatives.clone().map(f64::abs).fold(1.0, f64::max);
        let reference = plain[row].re;
        assert!(
            (value - reference).abs() <= ROUNDED * scale.max(reference.abs()),
            "{}: residual {row} is {value}, by hand {reference}",
            what()
        );
        for ((found, expected), by) in dense.into_iter().zip(derivatives).zip(&columns) {
            assert!(
                (found - expected).abs() <= ROUNDED * scale,
                "{}: derivative of residual {row} by {by:?} is {found}, by dual numbers {expected}",
                what()
            );
        }
    }
}

/// As many samples in blocks, from a seed on.
fn check_variant_in_blocks(robot: &Robot, variant: &Variant, seed: u64, samples: u64) {
    let seeds = seed..seed + samples;
    let points = seeds.map(|seed| random_point(robot, variant, seed));
    let points: Vec<Point> = points.collect();
    for instance in &variant.instances {
        let samples = points.iter().map(|point| slices(instance, point).0);
        let samples: Vec<Vec<f64>> = samples.collect();
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
        // One block and a part of a second.
        check_variant_in_blocks(robot, variant, seeds.start, 11);
    }
}

pub(crate) fn check_description(text: &str, seeds: std::ops::Range<u64>) {
    let model = tau_model_dsl::check_text(text).unwrap_or_else(|errors| panic!("{errors}\n{text}"));
    check_robot(&described(text), &model, seeds);
}

#[test]
fn equations_of_standard_robots_agree_with_dual_numbers() {
    for (_, robot) in tau_generated::ROBOTS {
        let robot = Robot::from(robot);
        let model = tau_model_dsl::check_text(&robot.description).unwrap();
        check_robot(&robot, &model, 0..3);
    }
}

#[test]
fn robots_of_other_layouts_agree_with_dual_numbers() {
    let own = concat!(env!("CARGO_MANIFEST_DIR"), "/equations/robots");
    for folder in [ROBOTS, own] {
        for entry in fs::read_dir(folder).unwrap() {
            let text = fs::read_to_string(entry.unwrap().path()).unwrap();
            check_description(&text, 0..3);
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig {
        cases: if cfg!(feature = "slow") { 250 } else { 12 }, failure_persistence: None, ..ProptestConfig::default()
    })]

    #[test]
    fn random_carts_agree_with_dual_numbers(text in descriptions::carts(), seed in 0_u64..1_000_000) {
        check_description(&text, seed..seed + 1);
    }

    #[test]
    fn random_machines_agree_with_dual_numbers(text in descriptions::machines(), seed in 0_u64..1_000_000) {
        check_description(&text, seed..seed + 1);
    }
}

#[test]
fn generated_code_of_standard_robots_is_the_interpreters_bit_for_bit() {
    for (name, robot) in tau_generated::ROBOTS {
        let generated = Robot::from(robot);
        let interpreted = described(&generated.description);
        assert_eq!(generated.plate, interpreted.plate, "{name}");
        assert_eq!(generated.drives, interpreted.drives, "{name}");
        for (a, b) in generated.variants.iter().zip(interpreted.variants.iter()) {
            assert_eq!(a.parameters, b.parameters);
            let points = (0..4).map(|seed| random_point(&generated, a, seed));
            let points: Vec<Point> = points.collect();
            for (x, y) in a.instances.iter().zip(&b.instances) {
                assert_eq!((x.kind, x.of, &x.inputs), (y.kind, y.of, &y.inputs));
                for (data, parameters) in points.iter().map(|point| slices(x, point)) {
                    let of = |own: &Instance| bits(&one_by_one(&*own.family, &data, &parameters));
                    assert_eq!(of(x), of(y), "{} {:?} of {}", a.name, x.kind, x.of);
                }
            }
        }
    }
}

/// The interpreter takes them in batches: two blocks and a rest.
#[test]
fn many_samples_equal_single_samples() {
    let robot = described(tau_generated::gantry_tau::ROBOT.description);
    let variant = robot.variant("FullRack").unwrap();
    check_variant_in_blocks(&robot, variant, 0, 37);
}
