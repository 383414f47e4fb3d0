//! The 35 problems of J. J. Moré, B. S. Garbow and K. E. Hillstrom, "Testing Unconstrained Optimization
//! Software", ACM Transactions on Mathematical Software 7 (1981), numbered as there.

use std::f64::consts::PI;

use tau_runtime::ResidualFamily;
use tau_solver::{Method, Options, solve};

use crate::family::{Family, Model, finite_difference_error, problem};
use crate::scalar::Scalar;

/// A problem: its number in the paper and its sizes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Problem {
    number: usize,
    parameters: usize,
    residuals: usize,
}

/// Number, parameters, residuals, sums of squares at the known local minima.
type Case = (usize, usize, usize, &'static [f64]);

const CASES: [Case; 41] = [
    (1, 2, 2, &[0.0]),
    (2, 2, 2, &[0.0, 48.984_253_679_240_01]),
    (3, 2, 2, &[0.0]),
    (4, 2, 3, &[0.0]),
    (5, 2, 3, &[0.0]),
    (6, 2, 10, &[124.362]),
    (7, 3, 3, &[0.0]),
    (8, 3, 15, &[8.21487e-3]),
    (9, 3, 15, &[1.12793e-8]),
    (10, 3, 16, &[87.9458]),
    (11, 3, 99, &[0.0]),
    (12, 3, 10, &[0.0]),
    (13, 4, 4, &[0.0]),
    (14, 4, 6, &[0.0]),
    (15, 4, 11, &[3.07505e-4]),
    (16, 4, 20, &[85822.2]),
    (17, 5, 33, &[5.46489e-5]),
    (18, 6, 13, &[0.0, 5.65565e-3]),
    (19, 11, 65, &[4.01377e-2]),
    (20, 6, 31, &[2.28767e-3]),
    (20, 9, 31, &[1.39976e-6]),
    (20, 12, 31, &[4.72238e-10]),
    (21, 10, 10, &[0.0]),
    (22, 12, 12, &[0.0]),
    (23, 4, 5, &[2.24997e-5]),
    (23, 10, 11, &[7.08765e-5]),
    (24, 4, 8, &[9.37629e-6]),
    (24, 10, 20, &[2.93660e-4]),
    (25, 10, 12, &[0.0]),
    (26, 10, 10, &[0.0, 2.79506e-5]),
    (27, 10, 10, &[0.0, 1.0]),
    (28, 10, 10, &[0.0]),
    (29, 10, 10, &[0.0]),
    (30, 10, 10, &[0.0]),
    (31, 10, 10, &[0.0]),
    (32, 10, 20, &[10.0]),
    (33, 10, 20, &[20.0 * 19.0 / (2.0 * 41.0)]),
    (34, 10, 20, &[(400.0 + 60.0 - 6.0) / (2.0 * 37.0)]),
    (35, 8, 8, &[3.51687e-3]),
    (35, 9, 9, &[0.0]),
    (35, 10, 10, &[6.50395e-3]),
];

const BARD: [f64; 15] = [
    0.14, 0.18, 0.22, 0.25, 0.29, 0.32, 0.35, 0.39, 0.37, 0.58, 0.73, 0.96, 1.34, 2.10, 4.39,
];
const GAUSSIAN: [f64; 8] = [
    0.0009, 0.0044, 0.0175, 0.0540, 0.1295, 0.2420, 0.3521, 0.3989,
];
const MEYER: [f64; 16] = [
    34780.0, 28610.0, 23650.0, 19630.0, 16370.0, 13720.0, 11540.0, 9744.0, 8261.0, 7030.0, 6005.0,
    5147.0, 4427.0, 3820.0, 3307.0, 2872.0,
];
const KOWALIK: [(f64, f64); 11] = [
    (4.0, 0.1957),
    (2.0, 0.1947),
    (1.0, 0.1735),
    (0.5, 0.1600),
    (0.25, 0.0844),
    (0.167, 0.0627),
    (0.125, 0.0456),
    (0.1, 0.0342),
    (0.0833, 0.0323),
    (0.0714, 0.0235),
    (0.0625, 0.0246),
];
const OSBORNE_1: [f64; 33] = [
    0.844, 0.908, 0.932, 0.936, 0.925, 0.908, 0.881, 0.850, 0.818, 0.784, 0.751, 0.718, 0.685,
    0.658, 0.628, 0.603, 0.580, 0.558, 0.538, 0.522, 0.506, 0.490, 0.478, 0.467, 0.457, 0.448,
    0.438, 0.431, 0.424, 0.420, 0.414, 0.411, 0.406,
];
const OSBORNE_2: [f64; 65] = [
    1.366, 1.191, 1.112, 1.013, 0.991, 0.885, 0.831, 0.847, 0.786, 0.725, 0.746, 0.679, 0.608,
    0.655, 0.616, 0.606, 0.602, 0.626, 0.651, 0.724, 0.649, 0.649, 0.694, 0.644, 0.624, 0.661,
    0.612, 0.558, 0.533, 0.495, 0.500, 0.423, 0.395, 0.375, 0.372, 0.391, 0.396, 0.405, 0.428,
    0.429, 0.523, 0.562, 0.607, 0.653, 0.672, 0.708, 0.633, 0.668, 0.645, 0.632, 0.591, 0.559,
    0.597, 0.625, 0.739, 0.710, 0.729, 0.720, 0.636, 0.581, 0.428, 0.292, 0.162, 0.098, 0.054,
];

impl Problem {
    fn start(self) -> Vec<f64> {
        let n = self.parameters;
        let ratio = |j: usize| j as f64 / (n + 1) as f64;
        let repeat = |pattern: &[f64]| pattern.iter().copied().cycle().take(n).collect();
        match self.number {
            1 | 21 => repeat(&[-1.2, 1.0]),
            2 => vec![0.5, -2.0],
            3 => vec![0.0, 1.0],
            4 | 5 => vec![1.0, 1.0],
            6 => vec![0.3, 0.4],
            7 => vec![-1.0, 0.0, 0.0],
            9 => vec![0.4, 1.0, 0.0],
            10 => vec![0.02, 4000.0, 250.0],
            11 => vec![5.0, 2.5, 0.15],
            12 => vec![0.0, 10.0, 20.0],
            13 | 22 => repeat(&[3.0, -1.0, 0.0, 1.0]),
            14 => vec![-3.0, -1.0, -3.0, -1.0],
            15 => vec![0.25, 0.39, 0.415, 0.39],
            16 => vec![25.0, 5.0, -5.0, -1.0],
            17 => vec![0.5, 1.5, -1.0, 0.01, 0.02],
            18 => vec![1.0, 2.0, 1.0, 1.0, 1.0, 1.0],
            19 => vec![1.3, 0.65, 0.65, 0.7, 0.6, 3.0, 5.0, 7.0, 2.0, 4.5, 5.5],
            20 => vec![0.0; n],
            23 => (1..=n).map(|j| j as f64).collect(),
            24 | 27 => vec![0.5; n],
            25 => (1..=n).map(|j| 1.0 - j as f64 / n as f64).collect(),
            26 => vec![1.0 / n as f64; n],
            28 | 29 => (1..=n).map(|j| ratio(j) * (ratio(j) - 1.0)).collect(),
            30 | 31 => vec![-1.0; n],
            35 => (1..=n).map(ratio).collect(),
            _ => vec![1.0; n],
        }
    }
}

fn sum<T: Scalar>(terms: impl Iterator<Item = T>) -> T {
    terms.fold(T::from(0.0), |total, term| total + term)
}

impl Model for Problem {
    fn sizes(&self) -> (usize, usize, usize) {
        (0, self.parameters, self.residuals)
    }

    fn residuals<T: Scalar>(&self, _: &[f64], x: &[T], out: &mut [T]) {
        let n = self.parameters;
        let m = self.residuals;
        let one = T::from(1.0);
        // One-based residual number as a real number.
        let mut each = |f: &dyn Fn(f64) -> T| {
            for (i, out) in out.iter_mut().enumerate() {
                *out = f((i + 1) as f64);
            }
        };
        match self.number {
            2 => {
                out[0] = x[0] + ((-x[1] + 5.0) * x[1] - 2.0) * x[1] - 13.0;
                out[1] = x[0] + ((x[1] + 1.0) * x[1] - 14.0) * x[1] - 29.0;
            }
            3 => {
                out[0] = x[0] * x[1] * 1e4 - 1.0;
                out[1] = (-x[0]).exp() + (-x[1]).exp() - 1.0001;
            }
            4 => {
                out[0] = x[0] - 1e6;
                out[1] = x[1] - 2e-6;
                out[2] = x[0] * x[1] - 2.0;
            }
            5 => {
                let mut power = one;
                for (out, y) in out.iter_mut().zip([1.5, 2.25, 2.625]) {
                    power = power * x[1];
                    *out = -x[0] * (one - power) + y;
                }
            }
            6 => each(&|i| -((x[0] * i).exp() + (x[1] * i).exp()) + (2.0 + 2.0 * i)),
            7 => {
                let angle = (x[1] / x[0]).atan() / (2.0 * PI);
                let angle = if x[0].value() < 0.0 {
                    angle + 0.5
                } else {
                    angle
                };
                out[0] = (x[2] - angle * 10.0) * 10.0;
                out[1] = ((x[0].square() + x[1].square()).sqrt() - 1.0) * 10.0;
                out[2] = x[2];
            }
            8 => {
                for (i, (out, y)) in out.iter_mut().zip(BARD).enumerate() {
                    let u = (i + 1) as f64;
                    let v = 16.0 - u;
                    *out = -(x[0] + T::from(u) / (x[1] * v + x[2] * u.min(v))) + y;
                }
            }
            9 => {
                for (i, out) in out.iter_mut().enumerate() {
                    let t = (7.0 - i as f64) / 2.0;
                    let y = GAUSSIAN[i.min(14 - i)];
                    *out = x[0] * (x[1] * (-x[2] + t).square() * -0.5).exp() - y;
                }
            }
            10 => {
                for (i, (out, y)) in out.iter_mut().zip(MEYER).enumerate() {
                    *out = x[0] * (x[1] / (x[2] + (50.0 + 5.0 * i as f64))).exp() - y;
                }
            }
            11 => each(&|i| {
                let t = i / 100.0;
                let y = 25.0 + (-50.0 * t.ln()).powf(2.0 / 3.0);
                let distance = -x[1] + y;
                let distance = if distance.value() < 0.0 {
                    -distance
                } else {
                    distance
                };
                (-distance.pow(x[2]) / x[0]).exp() - t
            }),
            12 => each(&|i| {
                let t = 0.1 * i;
                (x[0] * -t).exp() - (x[1] * -t).exp() - x[2] * ((-t).exp() - (-10.0 * t).exp())
            }),
            13 | 22 => {
                for (out, x) in out.chunks_mut(4).zip(x.chunks(4)) {
                    out[0] = x[0] + x[1] * 10.0;
                    out[1] = (x[2] - x[3]) * 5.0_f64.sqrt();
                    out[2] = (x[1] - x[2] * 2.0).square();
                    out[3] = (x[0] - x[3]).square() * 10.0_f64.sqrt();
                }
            }
            14 => {
                out[0] = (x[1] - x[0].square()) * 10.0;
                out[1] = one - x[0];
                out[2] = (x[3] - x[2].square()) * 90.0_f64.sqrt();
                out[3] = one - x[2];
                out[4] = (x[1] + x[3] - 2.0) * 10.0_f64.sqrt();
                out[5] = (x[1] - x[3]) / 10.0_f64.sqrt();
            }
            15 => {
                for (out, (u, y)) in out.iter_mut().zip(KOWALIK) {
                    let ratio = (x[1] * u + u * u) / (x[2] * u + x[3] + u * u);
                    *out = -x[0] * ratio + y;
                }
            }
            16 => each(&|i| {
                let t = i / 5.0;
                (x[0] + x[1] * t - t.exp()).square() + (x[2] + x[3] * t.sin() - t.cos()).square()
            }),
            17 => {
                for (i, (out, y)) in out.iter_mut().zip(OSBORNE_1).enumerate() {
                    let t = 10.0 * i as f64;
                    *out = -(x[0] + x[1] * (x[3] * -t).exp() + x[2] * (x[4] * -t).exp()) + y;
                }
            }
            18 => each(&|i| {
                let t = 0.1 * i;
                let y = (-t).exp() - 5.0 * (-10.0 * t).exp() + 3.0 * (-4.0 * t).exp();
                x[2] * (x[0] * -t).exp() - x[3] * (x[1] * -t).exp() + x[5] * (x[4] * -t).exp() - y
            }),
            19 => {
                for (i, (out, y)) in out.iter_mut().zip(OSBORNE_2).enumerate() {
                    let t = i as f64 / 10.0;
                    let bell = |k: usize| x[k] * (-(-x[k + 7] + t).square() * x[k + 4]).exp();
                    *out = -(x[0] * (x[4] * -t).exp() + bell(1) + bell(2) + bell(3)) + y;
                }
            }
            20 => {
                for (i, out) in out[..29].iter_mut().enumerate() {
                    let t = (i + 1) as f64 / 29.0;
                    let power = |j: usize| t.powi(i32::try_from(j).unwrap());
                    let slope = sum((1..n).map(|j| x[j] * (j as f64 * power(j - 1))));
                    let value = sum((0..n).map(|j| x[j] * power(j)));
                    *out = slope - value.square() - 1.0;
                }
                out[29] = x[0];
                out[30] = x[1] - x[0].square() - 1.0;
            }
            23 => {
                for (out, &x) in out.iter_mut().zip(x) {
                    *out = (x - 1.0) * 1e-5_f64.sqrt();
                }
                out[n] = sum(x.iter().map(|x| x.square())) - 0.25;
            }
            24 => {
                let root = 1e-5_f64.sqrt();
                let e = |j: usize| (x[j] / 10.0).exp();
                out[0] = x[0] - 0.2;
                for i in 1..n {
                    let y = ((i + 1) as f64 / 10.0).exp() + (i as f64 / 10.0).exp();
                    out[i] = (e(i) + e(i - 1) - y) * root;
                    out[n + i - 1] = (e(i) - (-0.1_f64).exp()) * root;
                }
                out[2 * n - 1] = sum((0..n).map(|j| x[j].square() * (n - j) as f64)) - 1.0;
            }
            25 => {
                let weighted = sum((0..n).map(|j| (x[j] - 1.0) * (j + 1) as f64));
                for (out, &x) in out.iter_mut().zip(x) {
                    *out = x - 1.0;
                }
                out[n] = weighted;
                out[n + 1] = weighted.square();
            }
            26 => {
                let cosines = sum(x.iter().map(|x| x.cos()));
                for (i, out) in out.iter_mut().enumerate() {
                    let number = (i + 1) as f64;
                    *out = -cosines + n as f64 + (one - x[i].cos()) * number - x[i].sin();
                }
            }
            27 => {
                let total = sum(x.iter().copied());
                for (out, &x) in out.iter_mut().zip(x) {
                    *out = x + total - (n + 1) as f64;
                }
                out[n - 1] = x.iter().fold(one, |product, &x| product * x) - 1.0;
            }
            28 | 29 => {
                let h = 1.0 / (n + 1) as f64;
                let t = |j: usize| (j + 1) as f64 * h;
                let cube = |j: usize| {
                    let base = x[j] + (t(j) + 1.0);
                    base.square() * base
                };
                for i in 0..n {
                    out[i] = if self.number == 28 {
                        let before = if i > 0 { x[i - 1] } else { T::from(0.0) };
                        let after = if i + 1 < n { x[i + 1] } else { T::from(0.0) };
                        x[i] * 2.0 - before - after + cube(i) * (h * h / 2.0)
                    } else {
                        let left = sum((0..=i).map(|j| cube(j) * t(j)));
                        let right = sum((i + 1..n).map(|j| cube(j) * (1.0 - t(j))));
                        x[i] + (left * (1.0 - t(i)) + right * t(i)) * (h / 2.0)
                    };
                }
            }
            30 => {
                for i in 0..n {
                    let before = if i > 0 { x[i - 1] } else { T::from(0.0) };
                    let after = if i + 1 < n { x[i + 1] } else { T::from(0.0) };
                    out[i] = (-x[i] * 2.0 + 3.0) * x[i] - before - after * 2.0 + 1.0;
                }
            }
            31 => {
                for i in 0..n {
                    let band = (i.saturating_sub(5)..(i + 2).min(n)).filter(|&j| j != i);
                    let others = sum(band.map(|j| x[j] * (x[j] + 1.0)));
                    out[i] = x[i] * (x[i].square() * 5.0 + 2.0) + 1.0 - others;
                }
            }
            32 => {
                let total = sum(x.iter().copied()) * (2.0 / m as f64);
                for (i, out) in out.iter_mut().enumerate() {
                    let own = if i < n { x[i] } else { T::from(0.0) };
                    *out = own - total - 1.0;
                }
            }
            33 => {
                let total = sum((0..n).map(|j| x[j] * (j + 1) as f64));
                each(&|i| total * i - 1.0);
            }
            34 => {
                let total = sum((1..n - 1).map(|j| x[j] * (j + 1) as f64));
                each(&|i| total * (i - 1.0) - 1.0);
                out[m - 1] = T::from(-1.0);
            }
            35 => {
                out.fill(T::from(0.0));
                for &x in x {
                    let argument = x * 2.0 - 1.0;
                    let (mut before, mut polynomial) = (one, argument);
                    for out in out.iter_mut() {
                        *out = *out + polynomial / n as f64;
                        let next = argument * polynomial * 2.0 - before;
                        (before, polynomial) = (polynomial, next);
                    }
                }
                for i in (2..=n).step_by(2) {
                    out[i - 1] = out[i - 1] + 1.0 / ((i * i) as f64 - 1.0);
                }
            }
            _ => {
                // 1 and 21, Rosenbrock
                for (out, x) in out.chunks_mut(2).zip(x.chunks(2)) {
                    out[0] = (x[1] - x[0].square()) * 10.0;
                    out[1] = one - x[0];
                }
            }
        }
    }
}

fn families() -> impl Iterator<Item = (Case, Problem, Family<Problem>)> {
    CASES.into_iter().map(|case| {
        let problem = Problem {
            number: case.0,
            parameters: case.1,
            residuals: case.2,
        };
        (case, problem, Family::new(problem))
    })
}

#[test]
fn jacobians_agree_with_finite_differences() {
    for (case, test, family) in families() {
        let point: Vec<f64> = test
            .start()
            .iter()
            .enumerate()
            .map(|(i, x)| x * 1.05 + 0.01 * (i + 1) as f64)
            .collect();
        let error = finite_difference_error(&family, &[], &point);
        assert!(error < 1e-6, "{case:?}: {error:e}");
    }
}

#[test]
fn published_minima_are_reached_by_every_method() {
    for (case, test, family) in families() {
        for method in [Method::Dense, Method::Sparse, Method::Elimination] {
            let options = Options {
                method,
                ..Options::default()
            };
            let solution = solve(&problem(&family, &[], &test.start()), &options).unwrap();
            let found = 2.0 * solution.cost;
            // Where the Jacobian becomes singular at the minimum (Powell), normal equations creep.
            let creeps =
                matches!(case.0, 13 | 22) && matches!(method, Method::Sparse | Method::Elimination);
            assert!(solution.converged() || creeps, "{case:?} {method:?}");
            let known = case.3.iter().any(|&minimum| {
                if minimum == 0.0 {
                    found < 1e-20
                } else {
                    (found / minimum - 1.0).abs() < 5e-6
                }
            });
            assert!(known, "{case:?} {method:?}: {found:e}");
        }
    }
}

#[test]
fn minima_are_stationary() {
    let mut checked = 0;
    for (case, test, family) in families() {
        let solution = solve(&problem(&family, &[], &test.start()), &Options::default()).unwrap();
        if solution.cost < 1e-20 {
            continue; // residuals of zero are stationary, and their direction is rounding
        }
        checked += 1;
        let (n, m) = (case.1, case.2);
        let mut residuals = vec![0.0; m];
        let mut jacobian = vec![0.0; m * n];
        family.linearize(&[], &solution.parameters, &mut residuals, &mut jacobian);
        let size = residuals.iter().map(|r| r * r).sum::<f64>().sqrt();
        let column = |j: usize| (0..m).map(move |i| i * n + j);
        let lengths: Vec<f64> = (0..n)
            .map(|j| column(j).map(|k| jacobian[k].powi(2)).sum::<f64>().sqrt())
            .collect();
        // Rounding of the residuals: that of the terms they are sums of.
        let terms: f64 = lengths
            .iter()
            .zip(&solution.parameters)
            .map(|(length, x)| length * x.abs())
            .sum();
        let noise = 8.0 * f64::EPSILON * (size + terms);
        for (j, length) in lengths.iter().enumerate() {
            let slope: f64 = column(j)
                .zip(&residuals)
                .map(|(k, r)| jacobian[k] * r)
                .sum();
            assert!(
                slope.abs() <= length * (1e-10 * size + noise),
                "{case:?}: parameter {j}, cosine {:e}",
                slope / (length * size)
            );
        }
    }
    assert!(checked >= 18, "{checked} minima with residuals");
}
