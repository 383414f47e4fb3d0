//! Residual and ten derivatives of the closure equation: generated (for single samples, in blocks, fused into
//! normal equations), interpreted, by hand, by dual numbers.
//!
//! `cargo bench -p tau-benches --bench linearize`. Every contender computes the same 2 000 samples in the
//! same run, and agrees with the first before anything is timed: compare rows, not runs.

use divan::{Bencher, counter::ItemsCount};
use num_dual::{Dual64, DualNum};
use tau_generated::gantry_tau::ROBOT;
use tau_runtime::{LANES, Lanes, NormalEquations, ResidualFamily, ResidualKind, block_count};

const SAMPLES: usize = 2000;
const PARAMETERS: [f64; 10] = [
    2.044, -0.0487, -0.0536, -0.1036, -3.185, -4.968, 0.778, 0.9977, -0.0664, -0.0054,
];

fn main() {
    let reference = sums(&linearized(generated()));
    for (name, other) in [
        ("blocks", sums(&linearized_in_blocks(generated()))),
        ("interpreted", sums(&linearized(&*interpreted()))),
        (
            "interpreted blocks",
            sums(&linearized_in_blocks(&*interpreted())),
        ),
        ("by hand", sums(&by_hand(&data()))),
        ("dual numbers", sums(&by_dual_numbers(&data()))),
    ] {
        for (a, b) in reference.iter().zip(&other) {
            assert!(
                (a - b).abs() <= 1e-10 * a.abs().max(1.0),
                "{name}: {a} and {b}"
            );
        }
    }
    divan::main();
}

/// The closure family of the variant `Full`.
fn generated() -> &'static dyn ResidualFamily {
    let full = ROBOT
        .variants
        .iter()
        .find(|variant| variant.name == "Full")
        .expect("a variant");
    let closure = |i: &&tau_runtime::Instance| i.kind == ResidualKind::Closure;
    full.instances
        .iter()
        .find(closure)
        .expect("an instance")
        .family
}

fn interpreted() -> std::sync::Arc<dyn ResidualFamily> {
    let model = tau_codegen::language::check_text(ROBOT.description).expect("a description");
    let index = model
        .variants
        .iter()
        .position(|variant| variant.name == "Full")
        .expect("a variant");
    let variant = tau_codegen::compile::compile_some(&model, index, |_, _| true);
    let family = variant
        .families
        .iter()
        .find(|family| family.kind == ResidualKind::Closure);
    family.expect("a family").interpreted()
}

/// Samples of q, x, y, z, alpha, beta, gamma, as the family orders them.
fn data() -> Vec<f64> {
    let mut state = 1_u64;
    let mut uniform = move || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 11) as f64 / (1_u64 << 53) as f64
    };
    (0..SAMPLES)
        .flat_map(|_| {
            let q = uniform() - 0.5;
            let position = [-1.9 + q, -4.7 + 0.5 * uniform(), 0.3 * uniform()];
            let angles = [1.48 + 0.01 * uniform(), 1.76 + 0.01 * uniform(), -1.54];
            [
                q,
                position[0],
                position[1],
                position[2],
                angles[0],
                angles[1],
                angles[2],
            ]
        })
        .collect()
}

fn prepared(family: &dyn ResidualFamily) -> Vec<f64> {
    let mut prepared = vec![0.0; SAMPLES * family.shape().prepared];
    family.prepare_all(&data(), &mut prepared);
    prepared
}

/// Rows of residual and ten derivatives.
fn linearized(family: &dyn ResidualFamily) -> Vec<f64> {
    let (mut residuals, mut jacobian) = (vec![0.0; SAMPLES], vec![0.0; SAMPLES * 10]);
    family.linearize_all(
        &prepared(family),
        &PARAMETERS,
        &mut residuals,
        &mut jacobian,
    );
    rows(&residuals, &jacobian)
}

fn blocks_of(width: usize) -> Vec<Lanes> {
    vec![Lanes::ZERO; block_count(SAMPLES) * width]
}

fn prepared_blocks(family: &dyn ResidualFamily) -> Vec<Lanes> {
    let mut prepared = blocks_of(family.shape().prepared);
    let family = family.blocks().expect("blocks");
    family.prepare_blocks(&data(), &mut prepared);
    prepared
}

/// Rows of residual and ten derivatives, from blocks.
fn linearized_in_blocks(family: &dyn ResidualFamily) -> Vec<f64> {
    let prepared = prepared_blocks(family);
    let (mut residuals, mut jacobian) = (blocks_of(1), blocks_of(10));
    let family = family.blocks().expect("blocks");
    family.linearize_blocks(&prepared, &PARAMETERS, &mut residuals, &mut jacobian);
    (0..SAMPLES)
        .flat_map(|sample| {
            let (block, lane) = (sample / LANES, sample % LANES);
            let derivatives = jacobian[block * 10..(block + 1) * 10].iter();
            std::iter::once(&residuals[block])
                .chain(derivatives)
                .map(move |lanes| lanes[lane])
                .collect::<Vec<_>>()
        })
        .collect()
}

fn rows(residuals: &[f64], jacobian: &[f64]) -> Vec<f64> {
    residuals
        .iter()
        .zip(jacobian.chunks(10))
        .flat_map(|(r, j)| std::iter::once(*r).chain(j.iter().copied()))
        .collect()
}

fn sums(rows: &[f64]) -> Vec<f64> {
    (0..11)
        .map(|column| rows.iter().skip(column).step_by(11).sum())
        .collect()
}

/// Residual and derivatives as an engineer writes them, trigonometry inside.
fn by_hand(data: &[f64]) -> Vec<f64> {
    let [length, px, py, pz, ox, oy, oz, vx, vy, vz] = PARAMETERS;
    let mut rows = Vec::with_capacity(SAMPLES * 11);
    for sample in data.chunks_exact(7) {
        let &[q, x, y, z, alpha, beta, gamma] = sample else {
            unreachable!()
        };
        let ((sa, ca), (sb, cb), (sg, cg)) = (alpha.sin_cos(), beta.sin_cos(), gamma.sin_cos());
        let (u, v) = (cg * px - sg * py, sg * px + cg * py);
        let (w, k) = (cb * u + sb * pz, cb * pz - sb * u);
        let dx = x + ca * w - sa * v - ox - q * vx;
        let dy = y + sa * w + ca * v - oy - q * vy;
        let dz = z + k - oz - q * vz;
        let (ex, ey, ez) = (2.0 * dx, 2.0 * dy, 2.0 * dz);
        let (a, b) = (ca * ex + sa * ey, ca * ey - sa * ex);
        let (c, d) = (cb * a - sb * ez, sb * a + cb * ez);
        rows.extend([
            length * length - dx * dx - dy * dy - dz * dz,
            2.0 * length,
            -(cg * c + sg * b),
            sg * c - cg * b,
            -d,
            ex,
            ey,
            ez,
            q * ex,
            q * ey,
            q * ez,
        ]);
    }
    rows
}

/// The residual alone, differentiated by forward dual numbers, one parameter at a time.
fn by_dual_numbers(data: &[f64]) -> Vec<f64> {
    let mut rows = Vec::with_capacity(SAMPLES * 11);
    for sample in data.chunks_exact(7) {
        let &[q, x, y, z, alpha, beta, gamma] = sample else {
            unreachable!()
        };
        let ((sa, ca), (sb, cb), (sg, cg)) = (alpha.sin_cos(), beta.sin_cos(), gamma.sin_cos());
        let mut row = [0.0; 11];
        for seed in 0..10 {
            let p: [Dual64; 10] = std::array::from_fn(|i| {
                Dual64::new(PARAMETERS[i], if i == seed { 1.0 } else { 0.0 })
            });
            let (u, v) = (p[1] * cg - p[2] * sg, p[1] * sg + p[2] * cg);
            let (w, k) = (u * cb + p[3] * sb, p[3] * cb - u * sb);
            let dx = w * ca - v * sa - p[4] - p[7] * q + x;
            let dy = w * sa + v * ca - p[5] - p[8] * q + y;
            let dz = k - p[6] - p[9] * q + z;
            let r = p[0].powi(2) - dx * dx - dy * dy - dz * dz;
            row[0] = r.re;
            row[1 + seed] = r.eps;
        }
        rows.extend(row);
    }
    rows
}

fn family_bench(bencher: Bencher, family: &dyn ResidualFamily, prepare: bool) {
    let data = data();
    let mut prepared = prepared(family);
    let (mut residuals, mut jacobian) = (vec![0.0; SAMPLES], vec![0.0; SAMPLES * 10]);
    bencher.counter(ItemsCount::new(SAMPLES)).bench_local(|| {
        if prepare {
            family.prepare_all(&data, &mut prepared);
        }
        family.linearize_all(&prepared, &PARAMETERS, &mut residuals, &mut jacobian);
        jacobian[3]
    });
}

fn blocks_bench(bencher: Bencher, family: &dyn ResidualFamily) {
    let prepared = prepared_blocks(family);
    let (mut residuals, mut jacobian) = (blocks_of(1), blocks_of(10));
    let family = family.blocks().expect("blocks");
    bencher.counter(ItemsCount::new(SAMPLES)).bench_local(|| {
        family.linearize_blocks(&prepared, &PARAMETERS, &mut residuals, &mut jacobian);
        jacobian[3]
    });
}

fn values_bench(bencher: Bencher, family: &dyn ResidualFamily) {
    let prepared = prepared_blocks(family);
    let mut residuals = blocks_of(1);
    let family = family.blocks().expect("blocks");
    bencher.counter(ItemsCount::new(SAMPLES)).bench_local(|| {
        family.value_blocks(&prepared, &PARAMETERS, &mut residuals);
        residuals[3]
    });
}

/// Residual, derivatives and their products, summed up.
fn fused_bench(bencher: Bencher, family: &dyn ResidualFamily) {
    let prepared = prepared_blocks(family);
    let weights = vec![Lanes::splat(1.0); block_count(SAMPLES)];
    let sizes = NormalEquations::new(family.shape(), family.pattern());
    let mut scratch = vec![Lanes::ZERO; sizes.scratch()];
    let family = family.blocks().expect("blocks");
    bencher.counter(ItemsCount::new(SAMPLES)).bench_local(|| {
        let mut sums = vec![Lanes::ZERO; sizes.sums()];
        sizes.add(
            family,
            &prepared,
            &PARAMETERS,
            &weights,
            &mut scratch,
            &mut sums,
        );
        sums[3]
    });
}

/// Preparation and linearisation, sample by sample: nothing staged.
#[divan::bench]
fn generated_with_preparation(bencher: Bencher) {
    family_bench(bencher, generated(), true);
}

/// Sample by sample, prepared before.
#[divan::bench]
fn generated_staged(bencher: Bencher) {
    family_bench(bencher, generated(), false);
}

#[divan::bench]
fn generated_preparation_of_blocks(bencher: Bencher) {
    let data = data();
    let family = generated();
    let mut prepared = blocks_of(family.shape().prepared);
    let family = family.blocks().expect("blocks");
    bencher
        .counter(ItemsCount::new(SAMPLES))
        .bench_local(|| family.prepare_blocks(&data, &mut prepared));
}

#[divan::bench]
fn generated_blocks(bencher: Bencher) {
    blocks_bench(bencher, generated());
}

#[divan::bench]
fn generated_blocks_values_only(bencher: Bencher) {
    values_bench(bencher, generated());
}

#[divan::bench]
fn generated_normal_equations(bencher: Bencher) {
    fused_bench(bencher, generated());
}

#[divan::bench]
fn interpreted_blocks(bencher: Bencher) {
    blocks_bench(bencher, &*interpreted());
}

#[divan::bench]
fn interpreted_blocks_values_only(bencher: Bencher) {
    values_bench(bencher, &*interpreted());
}

#[divan::bench]
fn interpreted_normal_equations(bencher: Bencher) {
    fused_bench(bencher, &*interpreted());
}

#[divan::bench]
fn hand_written(bencher: Bencher) {
    let data = data();
    bencher
        .counter(ItemsCount::new(SAMPLES))
        .bench_local(|| by_hand(&data));
}

#[divan::bench]
fn dual_numbers(bencher: Bencher) {
    let data = data();
    bencher
        .counter(ItemsCount::new(SAMPLES))
        .bench_local(|| by_dual_numbers(&data));
}
