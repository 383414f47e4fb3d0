//! Blocks of samples, and what is accumulated from them, against single samples.

use tau::robot::{Instance, ResidualKind};
use tau::runtime::{
    BlockFamily, Formulas, LANES, Lanes, NormalEquations, Pattern, ResidualFamily, Samples, Shape,
    block_count,
};
use tau_testkit::robots::described;

/// Values, and residuals with their Jacobian, one sample after the other.
type Numbers = [Vec<f64>; 3];

pub(crate) fn bits(numbers: &Numbers) -> Vec<u64> {
    numbers.iter().flatten().map(|x| x.to_bits()).collect()
}

fn unwritten(family: &dyn ResidualFamily, samples: usize) -> (Vec<f64>, Numbers) {
    let (shape, entries) = (family.shape(), family.pattern().len());
    let of = |width: usize| vec![f64::NAN; samples * width];
    let [values, residuals] = [(); 2].map(|()| of(shape.residuals));
    (of(shape.prepared), [values, residuals, of(entries)])
}

pub(crate) fn one_by_one(family: &dyn ResidualFamily, data: &[f64], x: &[f64]) -> Numbers {
    let width = family.shape().data;
    let mut all: Numbers = Default::default();
    for sample in 0..data.len().checked_div(width).unwrap_or(1) {
        let (mut prepared, mut numbers) = unwritten(family, 1);
        let [values, residuals, jacobian] = &mut numbers;
        family.prepare(&data[sample * width..(sample + 1) * width], &mut prepared);
        family.value(&prepared, x, values);
        family.linearize(&prepared, x, residuals, jacobian);
        for (all, own) in all.iter_mut().zip(numbers) {
            all.extend(own);
        }
    }
    for (value, residual) in all[0].iter().zip(&all[1]) {
        let off = (value - residual).abs();
        assert!(off <= 1e-13 * residual.abs().max(1.0), "{value} {residual}");
    }
    all
}

fn all_at_once(family: &dyn ResidualFamily, data: &[f64], x: &[f64], samples: usize) -> Numbers {
    let (mut prepared, mut numbers) = unwritten(family, samples);
    let [values, residuals, jacobian] = &mut numbers;
    family.prepare_all(data, &mut prepared);
    family.value_all(&prepared, x, values);
    family.linearize_all(&prepared, x, residuals, jacobian);
    numbers
}

fn in_blocks(family: &dyn BlockFamily, data: &[f64], x: &[f64], samples: usize) -> Numbers {
    let (shape, entries) = (family.shape(), family.pattern().len());
    let count = block_count(samples);
    let lanes = |width: usize| vec![Lanes::splat(f64::NAN); count * width];
    let mut prepared = lanes(shape.prepared);
    family.prepare_blocks(data, &mut prepared);
    let mut values = lanes(shape.residuals);
    family.value_blocks(&prepared, x, &mut values);
    let (mut residuals, mut jacobian) = (lanes(shape.residuals), lanes(entries));
    family.linearize_blocks(&prepared, x, &mut residuals, &mut jacobian);
    let apart = |lanes: &[Lanes], width: usize| -> Vec<f64> {
        (0..samples * width)
            .map(|i| lanes[i / width / LANES * width + i % width][i / width % LANES])
            .collect()
    };
    [
        apart(&values, shape.residuals),
        apart(&residuals, shape.residuals),
        apart(&jacobian, entries),
    ]
}

/// Checks that a family's blocks, of which the last is partly filled, and its many samples equal single ones bit for bit,
/// and that the normal equations are the products of what single samples give.
pub(crate) fn check_blocks(name: &str, instance: &Instance, samples: &[Vec<f64>], x: &[f64]) {
    let single: &dyn ResidualFamily = &*instance.family;
    let family = single.blocks().expect("blocks");
    let has_data = single.shape().data > 0;
    let count = if has_data { samples.len() } else { 1 };
    let data: Vec<f64> = samples[..count].concat();
    let singles = one_by_one(single, &data, x);
    let what = format!("{name}: {:?} of {}", instance.kind, instance.of);
    let blocks = in_blocks(family, &data, x, count);
    assert_eq!(bits(&blocks), bits(&singles), "{what}");
    let many = all_at_once(single, &data, x, count);
    assert_eq!(bits(&many), bits(&singles), "{what}");
    // Columns of the others are no parameters.
    if instance.kind != ResidualKind::ClosureByPose {
        check_normal_equations(&what, family, &data, x, count, &singles);
    }
}

fn check_normal_equations(
    what: &str,
    family: &dyn BlockFamily,
    data: &[f64],
    x: &[f64],
    samples: usize,
    [_, residuals, jacobian]: &Numbers,
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
    let residual = vec![1_f64.sin() - 0.5];
    let found = in_blocks(&WithoutData, &[], &[0.5], 1);
    assert_eq!(found, [residual.clone(), residual, vec![-1.0]]);

    let robot = described(
        "robot Slide {
            track one;
            cluster arm on one { link l1, l2, l3, l4, l5, l6; }
            effect longer on link { param amount: length; length += amount * sin(1); }
            variant Full { arm full; tracks linear; }
            variant Longer = Full + longer(l1);
        }",
    );
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
