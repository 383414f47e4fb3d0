//! Blocks of samples, and what is accumulated from them, against single samples.

use tau::Robot;
use tau::robot::{Instance, ResidualKind};
use tau::runtime::{
    BlockFamily, Formulas, LANES, Lanes, NormalEquations, Pattern, ResidualFamily, Samples, Shape,
    block_count,
};

/// Blocks of a family, computed from samples of data: residuals and Jacobian, one sample after the other.
fn in_blocks(
    family: &dyn BlockFamily,
    data: &[f64],
    parameters: &[f64],
    samples: usize,
) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let (shape, entries) = (family.shape(), family.pattern().len());
    let count = block_count(samples);
    let lanes = |width: usize| vec![Lanes::splat(f64::NAN); count * width];
    let mut prepared = lanes(shape.prepared);
    family.prepare_blocks(data, &mut prepared);
    let mut values = lanes(shape.residuals);
    family.value_blocks(&prepared, parameters, &mut values);
    let (mut residuals, mut jacobian) = (lanes(shape.residuals), lanes(entries));
    family.linearize_blocks(&prepared, parameters, &mut residuals, &mut jacobian);
    let apart = |lanes: &[Lanes], width: usize| -> Vec<f64> {
        (0..samples * width)
            .map(|i| lanes[i / width / LANES * width + i % width][i / width % LANES])
            .collect()
    };
    (
        apart(&values, shape.residuals),
        apart(&residuals, shape.residuals),
        apart(&jacobian, entries),
    )
}

fn one_by_one(
    family: &dyn ResidualFamily,
    data: &[f64],
    parameters: &[f64],
    samples: usize,
) -> (Vec<f64>, Vec<f64>, Vec<f64>) {
    let (shape, entries) = (family.shape(), family.pattern().len());
    let mut prepared = vec![f64::NAN; shape.prepared];
    let (mut values, mut residuals, mut jacobian) = (Vec::new(), Vec::new(), Vec::new());
    for sample in 0..samples {
        let mut value = vec![f64::NAN; shape.residuals];
        let mut residual = value.clone();
        let mut row = vec![f64::NAN; entries];
        let data = &data[sample * shape.data..(sample + 1) * shape.data];
        family.prepare(data, &mut prepared);
        family.value(&prepared, parameters, &mut value);
        family.linearize(&prepared, parameters, &mut residual, &mut row);
        values.extend(value);
        residuals.extend(residual);
        jacobian.extend(row);
    }
    (values, residuals, jacobian)
}

/// Checks that a family's blocks, of which the last is partly filled, equal its single samples bit for
/// bit, and that the normal equations are the products of what single samples give.
pub(crate) fn check_blocks(name: &str, instance: &Instance, samples: &[Vec<f64>], x: &[f64]) {
    let single: &dyn ResidualFamily = &*instance.family;
    let family = single.blocks().expect("blocks");
    let count = if single.shape().data == 0 {
        1
    } else {
        samples.len()
    };
    let data: Vec<f64> = samples[..count].concat();
    let blocks = in_blocks(family, &data, x, count);
    let singles = one_by_one(single, &data, x, count);
    let what = format!("{name}: {:?} of {}", instance.kind, instance.of);
    for (a, b) in [
        (&blocks.0, &singles.0),
        (&blocks.1, &singles.1),
        (&blocks.2, &singles.2),
    ] {
        let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(a), bits(b), "{what}");
    }
    // Columns of the others are no parameters.
    if instance.kind != ResidualKind::ClosureByPose {
        check_normal_equations(&what, family, &data, x, count, &singles.1, &singles.2);
    }
}

fn check_normal_equations(
    what: &str,
    family: &dyn BlockFamily,
    data: &[f64],
    x: &[f64],
    samples: usize,
    residuals: &[f64],
    jacobian: &[f64],
) {
    let (shape, pattern) = (family.shape(), family.pattern());
    let sizes = NormalEquations::new(shape, pattern);
    let weight = |sample: usize, row: usize| 0.5 + ((7 * sample + 3 * row) % 5) as f64;
    let mut weights = vec![Lanes::ZERO; block_count(samples) * shape.residuals];
    for sample in 0..samples {
        for row in 0..shape.residuals {
            weights[sample / LANES * shape.residuals + row][sample % LANES] = weight(sample, row);
        }
    }
    let mut prepared = vec![Lanes::ZERO; block_count(samples) * shape.prepared];
    family.prepare_blocks(data, &mut prepared);
    let mut scratch = vec![Lanes::splat(f64::NAN); sizes.scratch()];
    let mut sums = vec![Lanes::ZERO; sizes.sums()];
    sizes.add(family, &prepared, x, &weights, &mut scratch, &mut sums);

    let n = shape.parameters;
    let mut expected = vec![0.0; sizes.sums()];
    let mut sizes_of_terms = expected.clone();
    for sample in 0..samples {
        for row in 0..shape.residuals {
            let entries = pattern.row_starts[row] as usize..pattern.row_starts[row + 1] as usize;
            let mut dense = vec![0.0; n + 1];
            for entry in entries {
                dense[pattern.columns[entry] as usize] =
                    jacobian[sample * pattern.len() + entry] * weight(sample, row);
            }
            dense[n] = residuals[sample * shape.residuals + row] * weight(sample, row);
            let mut index = 0;
            for i in 0..=n {
                for j in i..=n {
                    assert_eq!(sizes.index(i, j), index);
                    expected[index] += dense[i] * dense[j];
                    sizes_of_terms[index] += (dense[i] * dense[j]).abs();
                    index += 1;
                }
            }
        }
    }
    for ((sum, expected), size) in sums.iter().zip(&expected).zip(&sizes_of_terms) {
        let sum = sum.sum();
        assert!(
            (sum - expected).abs() <= 1e-14 * size,
            "{what}: {sum} and {expected}"
        );
    }
}

/// Residual `sin(1) − x`: nothing is measured, but something is prepared.
struct WithoutData;

impl Formulas for WithoutData {
    const SHAPE: Shape = Shape {
        data: 0,
        prepared: 1,
        parameters: 1,
        residuals: 1,
    };
    const PATTERN: Pattern<'static> = Pattern {
        row_starts: &[0, 1],
        columns: &[0],
    };

    fn prepare<S: Samples>(lane: usize, _: &[f64], prepared: &mut [S]) {
        prepared[0][lane] = 1_f64.sin();
    }

    fn value<S: Samples>(lane: usize, prepared: &[S], parameters: &[f64], residuals: &mut [S]) {
        residuals[0][lane] = prepared[0][lane] - parameters[0];
    }

    fn linearize<S: Samples>(
        lane: usize,
        prepared: &[S],
        parameters: &[f64],
        residuals: &mut [S],
        jacobian: &mut [S],
    ) {
        <Self as Formulas>::value(lane, prepared, parameters, residuals);
        jacobian[0][lane] = -1.0;
    }
}

#[test]
fn constants_are_prepared_without_data_and_beside_them() {
    let (values, _, jacobian) = in_blocks(&WithoutData, &[], &[0.5], 1);
    assert_eq!((values, jacobian), (vec![1_f64.sin() - 0.5], vec![-1.0]));

    let robot = Robot::from_text(
        "robot Slide {
            track one;
            cluster arm on one { link l1, l2, l3, l4, l5, l6; }
            effect longer on link { param amount: length; length += amount * sin(1); }
            variant Full { arm full; tracks linear; }
            variant Longer = Full + longer(l1);
        }",
    )
    .unwrap();
    let is_by_pose = |instance: &&Instance| instance.kind == ResidualKind::ClosureByPose;
    let instance = robot.variants[1].instances.iter().find(is_by_pose).unwrap();
    let shape = instance.family.shape();
    assert_eq!(shape.prepared, shape.data + 1);
    let numbers = |count: usize, step: f64| (1..=count).map(|k| step * k as f64).collect();
    let x: Vec<f64> = numbers(shape.parameters, 0.3);
    let samples: Vec<Vec<f64>> = (1..12)
        .map(|k| numbers(shape.data, 0.1 * f64::from(k)))
        .collect();
    check_blocks("Longer", instance, &samples, &x);
}
