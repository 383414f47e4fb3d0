//! The normal equations of the closure equation as arael generates them, with the rotation inside and with the
//! rotation as data.
//!
//! Usage: tau-arael DATA. The formats of DATA and of the answers are those of `samples::text` and `Program` in
//! the benchmark's own modules; the result is the largest difference of JᵀJ and Jᵀr from the reference, each
//! relative to the largest number in its row and column.

use std::hint::black_box;
use std::io::{BufRead, Write};
use std::time::Instant;

use arael::prelude::*;

/// Calls of which a turn takes the fastest.
const CALLS: usize = 5;
const PARAMETERS: usize = 10;

#[arael::model]
struct Angles {
    q: f64,
    x: f64,
    y: f64,
    z: f64,
    alpha: f64,
    beta: f64,
    gamma: f64,
}

#[arael::model]
#[arael(fit64(samples, |s| {
    let ux = cos(s.gamma) * px - sin(s.gamma) * py;
    let vy = sin(s.gamma) * px + cos(s.gamma) * py;
    let wx = cos(s.beta) * ux + sin(s.beta) * pz;
    let kz = cos(s.beta) * pz - sin(s.beta) * ux;
    let dx = s.x + cos(s.alpha) * wx - sin(s.alpha) * vy - ox - s.q * vx0;
    let dy = s.y + sin(s.alpha) * wx + cos(s.alpha) * vy - oy - s.q * vy0;
    let dz = s.z + kz - oz - s.q * vz0;
    length * length - dx * dx - dy * dy - dz * dz
}))]
struct Plain {
    length: Param<f64>,
    px: Param<f64>,
    py: Param<f64>,
    pz: Param<f64>,
    ox: Param<f64>,
    oy: Param<f64>,
    oz: Param<f64>,
    vx0: Param<f64>,
    vy0: Param<f64>,
    vz0: Param<f64>,
    samples: Vec<Angles>,
}

#[arael::model]
struct Rotation {
    q: f64,
    x: f64,
    y: f64,
    z: f64,
    a: f64,
    b: f64,
    c: f64,
    d: f64,
    e: f64,
    f: f64,
    g: f64,
    h: f64,
    i: f64,
}

#[arael::model]
#[arael(fit64(samples, |s| {
    let dx = s.a * px + s.b * py + s.c * pz + s.x - ox - s.q * vx0;
    let dy = s.d * px + s.e * py + s.f * pz + s.y - oy - s.q * vy0;
    let dz = s.g * px + s.h * py + s.i * pz + s.z - oz - s.q * vz0;
    length * length - dx * dx - dy * dy - dz * dz
}))]
struct Staged {
    length: Param<f64>,
    px: Param<f64>,
    py: Param<f64>,
    pz: Param<f64>,
    ox: Param<f64>,
    oy: Param<f64>,
    oz: Param<f64>,
    vx0: Param<f64>,
    vy0: Param<f64>,
    vz0: Param<f64>,
    samples: Vec<Rotation>,
}

/// Samples, parameters and results to agree with.
struct Data {
    parameters: [f64; PARAMETERS],
    samples: Vec<[f64; 7]>,
    /// Residual and derivatives of each.
    reference: Vec<[f64; 11]>,
}

impl Data {
    fn read(path: &str) -> Self {
        let text = std::fs::read_to_string(path).expect("the data");
        let mut numbers = text.split_whitespace().map(|n| n.parse().expect("a number"));
        let mut next = || numbers.next().expect("more numbers");
        let count: f64 = next();
        let parameters = std::array::from_fn(|_| next());
        let (mut samples, mut reference) = (Vec::new(), Vec::new());
        for _ in 0..count as usize {
            samples.push(std::array::from_fn(|_| next()));
            reference.push(std::array::from_fn(|_| next()));
        }
        Self { parameters, samples, reference }
    }

    /// Largest difference of a gradient and a Hessian, both twice those of least squares, from the reference.
    fn difference(&self, gradient: &[f64], hessian: &[f64]) -> f64 {
        let product = |a: usize, b: usize| -> f64 { self.reference.iter().map(|row| row[a] * row[b]).sum() };
        let scale: Vec<f64> = (0..11).map(|a| product(a, a).sqrt()).collect();
        let mut largest = 0.0_f64;
        for a in 0..PARAMETERS {
            let of = |found: f64, b: usize| (found / 2.0 - product(a + 1, b)).abs() / scale[a + 1] / scale[b];
            largest = largest.max(of(gradient[a], 0));
            for b in 0..PARAMETERS {
                largest = largest.max(of(hessian[a * PARAMETERS + b], b + 1));
            }
        }
        largest
    }
}

type Contender = (&'static str, Box<dyn FnMut()>, f64);

fn contender(name: &'static str, data: &Data, mut problem: impl LmProblem<f64> + 'static) -> Contender {
    let (mut gradient, mut hessian) = (vec![0.0; PARAMETERS], vec![0.0; PARAMETERS * PARAMETERS]);
    let parameters = data.parameters;
    problem.calc_grad_hessian_dense(&parameters, &mut gradient, &mut hessian);
    let difference = data.difference(&gradient, &hessian);
    let run = move || {
        gradient.fill(0.0);
        hessian.fill(0.0);
        problem.calc_grad_hessian_dense(&black_box(parameters), &mut gradient, &mut hessian);
        black_box((&mut gradient, &mut hessian));
    };
    (name, Box::new(run), difference)
}

fn rotation(&[q, x, y, z, alpha, beta, gamma]: &[f64; 7]) -> Rotation {
    let ((sa, ca), (sb, cb), (sg, cg)) = (alpha.sin_cos(), beta.sin_cos(), gamma.sin_cos());
    Rotation {
        q,
        x,
        y,
        z,
        a: ca * cb * cg - sa * sg,
        b: -ca * cb * sg - sa * cg,
        c: ca * sb,
        d: sa * cb * cg + ca * sg,
        e: -sa * cb * sg + ca * cg,
        f: sa * sb,
        g: -sb * cg,
        h: sb * sg,
        i: cb,
    }
}

fn main() {
    let data = Data::read(&std::env::args().nth(1).expect("a file of data"));
    let [length, px, py, pz, ox, oy, oz, vx0, vy0, vz0] = data.parameters.map(Param::new);
    let angles = |&[q, x, y, z, alpha, beta, gamma]: &[f64; 7]| Angles { q, x, y, z, alpha, beta, gamma };
    let plain = Plain {
        length: length.clone(),
        px: px.clone(),
        py: py.clone(),
        pz: pz.clone(),
        ox: ox.clone(),
        oy: oy.clone(),
        oz: oz.clone(),
        vx0: vx0.clone(),
        vy0: vy0.clone(),
        vz0: vz0.clone(),
        samples: data.samples.iter().map(angles).collect(),
    };
    let samples = data.samples.iter().map(rotation).collect();
    let staged = Staged { length, px, py, pz, ox, oy, oz, vx0, vy0, vz0, samples };
    let mut contenders = [
        contender("arael", &data, plain),
        contender("arael staged", &data, staged),
    ];
    let mut output = std::io::stdout().lock();
    for _ in std::io::stdin().lock().lines().map_while(Result::ok) {
        for (name, run, result) in &mut contenders {
            let least = (0..CALLS)
                .map(|_| {
                    let started = Instant::now();
                    run();
                    started.elapsed().as_secs_f64()
                })
                .fold(f64::INFINITY, f64::min);
            writeln!(output, "{name}\t{least:e}\t{result:e}").expect("a listener");
        }
        writeln!(output).and_then(|()| output.flush()).expect("a listener");
    }
}
