//! Blocks of samples, and what is accumulated from them, against single samples.

use tau::robot::Instance;
use tau::runtime::{BlockFamily, LANES, Lanes, NormalEquations, ResidualFamily, block_count};

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
    check_normal_equations(&what, family, &data, x, count, &singles.1, &singles.2);
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
