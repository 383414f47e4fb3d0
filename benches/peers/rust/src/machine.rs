//! The machine's own speed.

use std::hint::black_box;

use crate::answers::Contender;

/// Independent sums: enough to hide the latency of a multiply-add, few enough for the registers.
const SUMS: usize = 10;
/// Numbers in a register.
const LANES: usize = if cfg!(target_feature = "avx512f") {
    8
} else {
    4
};
/// Multiply-adds of each number per call.
const STEPS: usize = 20_000;
/// Numbers per array of the triad that lies in the second cache, and of the one that lies in memory.
const CACHED: usize = 2_000 * 24 / 3;
const LARGE: usize = 8 << 20;

/// Names end in the amount of work per call: floating-point operations or bytes.
pub(crate) fn contenders() -> Vec<Contender> {
    let mut sums = [[1.0_f64; LANES]; SUMS];
    let peak: Contender = (
        "peak",
        Box::new(move || {
            let (a, b) = (black_box(0.999_999), black_box(1e-6));
            let mut local = sums;
            for _ in 0..STEPS {
                for sum in &mut local {
                    for x in sum {
                        *x = x.mul_add(a, b);
                    }
                }
            }
            sums = black_box(local);
        }),
        (2 * SUMS * LANES * STEPS) as f64,
    );
    [("triad in cache", CACHED), ("triad in memory", LARGE)]
        .into_iter()
        .map(|(name, length)| {
            let (b, c) = (vec![1.0_f64; length], vec![2.0_f64; length]);
            let mut a = vec![0.0_f64; length];
            let run: Box<dyn FnMut()> = Box::new(move || {
                let factor = black_box(3.0);
                for ((a, b), c) in a.iter_mut().zip(&b).zip(&c) {
                    *a = b + factor * c;
                }
                black_box(&mut a);
            });
            (name, run, (24 * length) as f64)
        })
        .chain([peak])
        .collect()
}
