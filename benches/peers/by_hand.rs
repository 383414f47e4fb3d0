//! The closure equation as an expert writes it, and as forward and numeric differentiation have it.

use nalgebra::{U1, U10};
use num_dual::{Dual64, DualNum, DualSVec64};
use tau_runtime::{Kernel, LANES, Lanes, block_count, vectorized};

use crate::samples::{PARAMETERS, WIDTH};

/// Operations of [`plain`], trigonometry included.
pub(crate) const PLAIN_OPERATIONS: usize = 70;
/// Operations of [`staged`] and [`in_blocks`].
pub(crate) const STAGED_OPERATIONS: usize = 59;
/// Numbers that [`prepare`] makes of a sample: q, T and R, row by row.
pub(crate) const PREPARED: usize = 13;

/// Residual and derivatives with the trigonometry inside: three plane rotations out, three back.
pub(crate) fn plain(data: &[f64], parameters: &[f64; 10], r: &mut [f64], j: &mut [f64]) {
    let [length, px, py, pz, ox, oy, oz, vx, vy, vz] = *parameters;
    let (samples, _) = data.as_chunks::<WIDTH>();
    let (rows, _) = j.as_chunks_mut::<10>();
    for ((&[q, x, y, z, alpha, beta, gamma], r), row) in samples.iter().zip(r).zip(rows) {
        let ((sa, ca), (sb, cb), (sg, cg)) = (alpha.sin_cos(), beta.sin_cos(), gamma.sin_cos());
        let (u, v) = (cg * px - sg * py, sg * px + cg * py);
        let (w, k) = (cb * u + sb * pz, cb * pz - sb * u);
        let dx = x + ca * w - sa * v - ox - q * vx;
        let dy = y + sa * w + ca * v - oy - q * vy;
        let dz = z + k - oz - q * vz;
        let (ex, ey, ez) = (2.0 * dx, 2.0 * dy, 2.0 * dz);
        let (a, b) = (ca * ex + sa * ey, ca * ey - sa * ex);
        let (c, d) = (sb * ez - cb * a, sb * a + cb * ez);
        *r = length * length - dx * dx - dy * dy - dz * dz;
        *row = [
            2.0 * length,
            cg * c - sg * b,
            -sg * c - cg * b,
            -d,
            ex,
            ey,
            ez,
            q * ex,
            q * ey,
            q * ez,
        ];
    }
}

/// The part of a sample's residual that does not depend on parameters.
pub(crate) fn prepare(sample: &[f64; WIDTH]) -> [f64; PREPARED] {
    let [q, x, y, z, alpha, beta, gamma] = *sample;
    let ((sa, ca), (sb, cb), (sg, cg)) = (alpha.sin_cos(), beta.sin_cos(), gamma.sin_cos());
    let rotation = [
        [ca * cb * cg - sa * sg, -ca * cb * sg - sa * cg, ca * sb],
        [sa * cb * cg + ca * sg, -sa * cb * sg + ca * cg, sa * sb],
        [-sb * cg, sb * sg, cb],
    ];
    let [[a, b, c], [d, e, f], [g, h, i]] = rotation;
    [q, x, y, z, a, b, c, d, e, f, g, h, i]
}

/// [`prepare`] for all samples.
pub(crate) fn prepare_all(data: &[f64]) -> Vec<[f64; PREPARED]> {
    let (samples, _) = data.as_chunks::<WIDTH>();
    samples.iter().map(prepare).collect()
}

/// Residual and derivatives of a prepared sample.
#[inline(always)]
fn closure(prepared: [f64; PREPARED], parameters: &[f64; 10]) -> (f64, [f64; 10]) {
    let [length, px, py, pz, ox, oy, oz, vx, vy, vz] = *parameters;
    let [q, x, y, z, a, b, c, d, e, f, g, h, i] = prepared;
    let dx = a * px + b * py + c * pz + x - ox - q * vx;
    let dy = d * px + e * py + f * pz + y - oy - q * vy;
    let dz = g * px + h * py + i * pz + z - oz - q * vz;
    let (ex, ey, ez) = (2.0 * dx, 2.0 * dy, 2.0 * dz);
    let residual = length * length - dx * dx - dy * dy - dz * dz;
    let row = [
        2.0 * length,
        -(a * ex + d * ey + g * ez),
        -(b * ex + e * ey + h * ez),
        -(c * ex + f * ey + i * ez),
        ex,
        ey,
        ez,
        q * ex,
        q * ey,
        q * ez,
    ];
    (residual, row)
}

/// Residual and derivatives with the rotation matrix hoisted.
pub(crate) fn staged(
    prepared: &[[f64; PREPARED]],
    parameters: &[f64; 10],
    r: &mut [f64],
    j: &mut [f64],
) {
    let (rows, _) = j.as_chunks_mut::<10>();
    for ((&prepared, r), row) in prepared.iter().zip(r).zip(rows) {
        (*r, *row) = closure(prepared, parameters);
    }
}

/// Prepared samples in blocks, the last one filled up with the last sample.
pub(crate) fn prepare_blocks(data: &[f64]) -> Vec<Lanes> {
    let prepared = prepare_all(data);
    (0..block_count(prepared.len()))
        .flat_map(|block| {
            let lane = |lane: usize| prepared[(block * LANES + lane).min(prepared.len() - 1)];
            let lanes: [[f64; PREPARED]; LANES] = std::array::from_fn(lane);
            (0..PREPARED).map(move |number| Lanes(lanes.map(|sample| sample[number])))
        })
        .collect()
}

/// Residual and derivatives of blocks of eight samples, with the instruction set of the machine.
pub(crate) fn in_blocks(
    prepared: &[Lanes],
    parameters: &[f64; 10],
    r: &mut [Lanes],
    j: &mut [Lanes],
) {
    vectorized(Blocks, prepared, parameters, r, j);
}

/// The same with the instructions that every machine has.
pub(crate) fn in_blocks_anywhere(
    prepared: &[Lanes],
    parameters: &[f64; 10],
    r: &mut [Lanes],
    j: &mut [Lanes],
) {
    Blocks.run(prepared, parameters, r, j);
}

struct Blocks;

impl Kernel for Blocks {
    #[inline(always)]
    fn run(self, prepared: &[Lanes], parameters: &[f64], r: &mut [Lanes], j: &mut [Lanes]) {
        let parameters: &[f64; 10] = parameters.try_into().expect("ten parameters");
        let (blocks, _) = prepared.as_chunks::<PREPARED>();
        let (rows, _) = j.as_chunks_mut::<10>();
        for ((block, r), row) in blocks.iter().zip(r).zip(rows) {
            for lane in 0..LANES {
                let sample: [f64; PREPARED] = std::array::from_fn(|number| block[number].0[lane]);
                let (residual, derivatives) = closure(sample, parameters);
                r[lane] = residual;
                for (lanes, derivative) in row.iter_mut().zip(derivatives) {
                    lanes[lane] = derivative;
                }
            }
        }
    }
}

/// The residual alone, over any numbers.
#[inline(always)]
fn residual<D: DualNum<Primitive = f64> + Copy>(sample: &[f64; WIDTH], p: &[D; 10]) -> D {
    let [q, x, y, z, alpha, beta, gamma] = *sample;
    let ((sa, ca), (sb, cb), (sg, cg)) = (alpha.sin_cos(), beta.sin_cos(), gamma.sin_cos());
    let (u, v) = (p[1] * cg - p[2] * sg, p[1] * sg + p[2] * cg);
    let (w, k) = (u * cb + p[3] * sb, p[3] * cb - u * sb);
    let dx = w * ca - v * sa - p[4] - p[7] * q + x;
    let dy = w * sa + v * ca - p[5] - p[8] * q + y;
    let dz = k - p[6] - p[9] * q + z;
    p[0] * p[0] - dx * dx - dy * dy - dz * dz
}

/// Ten derivatives at once by forward dual numbers.
pub(crate) fn dual_numbers(data: &[f64], parameters: &[f64; 10], r: &mut [f64], j: &mut [f64]) {
    let (samples, _) = data.as_chunks::<WIDTH>();
    let seeds: [DualSVec64<10>; 10] =
        std::array::from_fn(|i| DualSVec64::from_re(parameters[i]).derivative(i));
    for ((sample, r), row) in samples.iter().zip(r).zip(j.chunks_exact_mut(10)) {
        let dual = residual(sample, &seeds);
        *r = dual.re;
        let derivatives = dual.eps.unwrap_generic(U10, U1);
        row.copy_from_slice(derivatives.as_slice());
    }
}

/// Ten derivatives by forward dual numbers, one after the other.
pub(crate) fn dual_passes(data: &[f64], parameters: &[f64; 10], r: &mut [f64], j: &mut [f64]) {
    let (samples, _) = data.as_chunks::<WIDTH>();
    for ((sample, r), row) in samples.iter().zip(r).zip(j.chunks_exact_mut(10)) {
        for (seed, derivative) in row.iter_mut().enumerate() {
            let seeded = |i: usize| Dual64::new(parameters[i], f64::from(i == seed));
            let dual = residual(sample, &std::array::from_fn(seeded));
            (*r, *derivative) = (dual.re, dual.eps);
        }
    }
}

/// Ten derivatives by central differences of the residual.
pub(crate) fn numeric(data: &[f64], parameters: &[f64; 10], r: &mut [f64], j: &mut [f64]) {
    /// Of order the cube root of the rounding error.
    const STEP: f64 = 1e-5;
    let (samples, _) = data.as_chunks::<WIDTH>();
    for ((sample, r), row) in samples.iter().zip(r).zip(j.chunks_exact_mut(10)) {
        *r = residual(sample, parameters);
        for (i, derivative) in row.iter_mut().enumerate() {
            let at = |step: f64| {
                let mut moved = *parameters;
                moved[i] += step;
                residual(sample, &moved)
            };
            *derivative = (at(STEP) - at(-STEP)) / (2.0 * STEP);
        }
    }
}

/// The parameters, kept from the compiler.
pub(crate) fn parameters() -> [f64; 10] {
    std::hint::black_box(PARAMETERS)
}
