//! The normal equations of the closure equation as arael generates them, with the rotation inside and with the
//! rotation as data.
//!
//! Usage: tau-arael DATA. The formats of DATA and of the answers are those of `samples::text` and `Program` in
//! the benchmark's own modules; the result is the largest difference of JᵀJ and Jᵀr from the reference, each
//! relative to the largest number in its row and column.

#[path = "../../rust/src/answers.rs"]
mod answers;

use std::hint::black_box;

use answers::{Contender, Data, answer};
use arael::prelude::*;

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

impl Data {
    /// Largest difference of a gradient and a Hessian, both twice those of least squares, from the reference.
    fn difference(&self, gradient: &[f64], hessian: &[f64]) -> f64 {
        let product =
            |a: usize, b: usize| -> f64 { self.reference.iter().map(|row| row[a] * row[b]).sum() };
        let scale: Vec<f64> = (0..11).map(|a| product(a, a).sqrt()).collect();
        let mut largest = 0.0_f64;
        for a in 0..PARAMETERS {
            let of = |found: f64, b: usize| {
                (found / 2.0 - product(a + 1, b)).abs() / scale[a + 1] / scale[b]
            };
            largest = largest.max(of(gradient[a], 0));
            for b in 0..PARAMETERS {
                largest = largest.max(of(hessian[a * PARAMETERS + b], b + 1));
            }
        }
        largest
    }
}

fn contender(
    name: &'static str,
    data: &Data,
    mut problem: impl LmProblem<f64> + 'static,
) -> Contender {
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
    let angles = |&[q, x, y, z, alpha, beta, gamma]: &[f64; 7]| Angles {
        q,
        x,
        y,
        z,
        alpha,
        beta,
        gamma,
    };
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
    let staged = Staged {
        length,
        px,
        py,
        pz,
        ox,
        oy,
        oz,
        vx0,
        vy0,
        vz0,
        samples,
    };
    answer(vec![
        contender("arael", &data, plain),
        contender("arael staged", &data, staged),
    ]);
}
