//! Errors in variables with tiny-solver: the problem of `benches/errors_in_variables.rs`, from the same file as
//! `benches/peers/ceres.cpp` and with the same residuals.
//!
//! Usage: `tau-tiny-solver DATA TOLERANCE`. Prints "result SECONDS ITERATIONS COST PEAK_MIB"; the time is that of
//! the optimiser, which does not tell its iterations: "-".

use std::collections::HashMap;
use std::time::Instant;
use std::{env, fs};

use nalgebra::{DVector, RealField, dvector};
use tiny_solver::factors::Factor;
use tiny_solver::{LevenbergMarquardtOptimizer, Optimizer, Problem};

/// Quantities of a link in the order in which its parameter block holds them.
const QUANTITIES: [&str; 10] = [
    "length",
    "plate_joint.x",
    "plate_joint.y",
    "plate_joint.z",
    "track_offset.x",
    "track_offset.y",
    "track_offset.z",
    "track_direction.x",
    "track_direction.y",
    "track_direction.z",
];
/// The problem is nearly linear: a radius that does not bind saves it steps.
const RADIUS: f64 = 1e16;

/// L² − ‖T + R P − C(q)‖² of a link at the true pose, over its standard deviation.
#[derive(Clone)]
struct Closure {
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    command: f64,
    weight: f64,
}

impl<T: RealField> Factor<T> for Closure {
    fn residual_func(&self, parameters: &[DVector<T>]) -> DVector<T> {
        let (link, unknowns) = (&parameters[0], &parameters[1]);
        let number = |value: f64| T::from_f64(value).expect("a number");
        let turned = self.rotation.map(|row| {
            link[1].clone() * number(row[0])
                + link[2].clone() * number(row[1])
                + link[3].clone() * number(row[2])
        });
        let joint = rotate([3, 4, 5].map(|i| unknowns[i].clone()), &turned);
        let mut square = T::zero();
        for (i, joint) in joint.into_iter().enumerate() {
            let difference = joint + unknowns[i].clone() + number(self.position[i])
                - link[4 + i].clone()
                - link[7 + i].clone() * number(self.command);
            square += difference.clone() * difference;
        }
        dvector![(link[0].clone() * link[0].clone() - square) * number(self.weight)]
    }
}

/// Turns a point by a rotation vector.
fn rotate<T: RealField>(vector: [T; 3], point: &[T; 3]) -> [T; 3] {
    let cross = |a: &[T; 3], b: &[T; 3]| {
        [(1, 2), (2, 0), (0, 1)]
            .map(|(i, j)| a[i].clone() * b[j].clone() - a[j].clone() * b[i].clone())
    };
    let dot = |a: &[T; 3], b: &[T; 3]| {
        a[0].clone() * b[0].clone() + a[1].clone() * b[1].clone() + a[2].clone() * b[2].clone()
    };
    let square = dot(&vector, &vector);
    if square <= T::zero() {
        let moved = cross(&vector, point);
        return [0, 1, 2].map(|i| point[i].clone() + moved[i].clone());
    }
    let angle = square.sqrt();
    let axis = vector.map(|component| component / angle.clone());
    let (sine, cosine) = (angle.clone().sin(), angle.cos());
    let moved = cross(&axis, point);
    let along = dot(&axis, point) * (T::one() - cosine.clone());
    [0, 1, 2].map(|i| {
        point[i].clone() * cosine.clone()
            + moved[i].clone() * sine.clone()
            + axis[i].clone() * along.clone()
    })
}

/// Differences from a mean, over standard deviations.
#[derive(Clone)]
struct Prior {
    mean: Vec<f64>,
    sigma: Vec<f64>,
}

impl<T: RealField> Factor<T> for Prior {
    fn residual_func(&self, parameters: &[DVector<T>]) -> DVector<T> {
        let number = |value: f64| T::from_f64(value).expect("a number");
        DVector::from_fn(self.mean.len(), |i, _| {
            (parameters[0][i].clone() - number(self.mean[i])) / number(self.sigma[i])
        })
    }
}

fn zyz([a, b, c]: [f64; 3]) -> [[f64; 3]; 3] {
    let ((sa, ca), (sb, cb), (sc, cc)) = (a.sin_cos(), b.sin_cos(), c.sin_cos());
    [
        [ca * cb * cc - sa * sc, -ca * cb * sc - sa * cc, ca * sb],
        [sa * cb * cc + ca * sc, -sa * cb * sc + ca * cc, sa * sb],
        [-sb * cc, sb * sc, cb],
    ]
}

fn main() {
    let arguments: Vec<String> = env::args().collect();
    let [_, data, tolerance] = arguments.as_slice() else {
        panic!("usage: tau-tiny-solver DATA TOLERANCE");
    };
    let text = fs::read_to_string(data).expect("a file");
    let mut words = text.split_whitespace();
    let mut word = || words.next().expect("a word");
    let mut count = || word().parse::<usize>().expect("a count");
    let (links, shared, poses) = (count(), count(), count());
    let mut number = || word().parse::<f64>().expect("a number");
    let (position_noise, rotation_noise) = (number(), number());
    let tracks: Vec<usize> = (0..links).map(|_| number() as usize).collect();
    let mut start = HashMap::new();
    let mut closures: Vec<(Closure, [String; 2])> = Vec::with_capacity(links * poses);
    let mut priors: Vec<(Prior, String)> = Vec::with_capacity(links + poses);
    let mut names: Vec<String> = Vec::new();
    let mut blocks = vec![(DVector::zeros(10), vec![0.0; 10], vec![0.0; 10]); links];
    for _ in 0..shared {
        let (name, quantity) = word().split_once('.').expect("a link and its quantity");
        let link = names
            .iter()
            .position(|other| other == name)
            .unwrap_or_else(|| {
                names.push(name.to_owned());
                names.len() - 1
            });
        let i = QUANTITIES
            .iter()
            .position(|&other| other == quantity)
            .expect("a quantity");
        let mut number = || word().parse::<f64>().expect("a number");
        (blocks[link].0[i], blocks[link].1[i], blocks[link].2[i]) = (number(), number(), number());
    }
    for (link, (value, mean, sigma)) in blocks.into_iter().enumerate() {
        let name = format!("link{link}");
        start.insert(name.clone(), value);
        priors.push((Prior { mean, sigma }, name));
    }
    let mut number = || word().parse::<f64>().expect("a number");
    let commands = 1 + tracks.iter().max().expect("a track");
    for pose in 0..poses {
        let command: Vec<f64> = (0..commands).map(|_| number()).collect();
        let position = [number(), number(), number()];
        let rotation = zyz([number(), number(), number()]);
        let name = format!("pose{pose}");
        for (link, &track) in tracks.iter().enumerate() {
            let closure = Closure {
                position,
                rotation,
                command: command[track],
                weight: number(),
            };
            closures.push((closure, [format!("link{link}"), name.clone()]));
        }
        start.insert(name.clone(), DVector::zeros(6));
        let (p, r) = (position_noise, rotation_noise);
        let prior = Prior {
            mean: vec![0.0; 6],
            sigma: vec![p, p, p, r, r, r],
        };
        priors.push((prior, name));
    }

    let mut problem = Problem::new();
    for (prior, name) in &priors {
        problem.add_residual_block(prior.mean.len(), &[name], Box::new(prior.clone()), None);
    }
    for (closure, [link, pose]) in &closures {
        problem.add_residual_block(1, &[link, pose], Box::new(closure.clone()), None);
    }
    let options = tiny_solver::OptimizerOptions {
        max_iteration: 200,
        min_abs_error_decrease_threshold: 0.0,
        min_rel_error_decrease_threshold: tolerance.parse().expect("a tolerance"),
        min_error_threshold: 0.0,
        ..Default::default()
    };
    let optimizer = LevenbergMarquardtOptimizer::new(1e-6, 1e32, RADIUS);
    let started = Instant::now();
    let found = optimizer
        .optimize(&problem, &start, Some(options))
        .expect("a solution");
    let seconds = started.elapsed().as_secs_f64();
    let square = |residuals: DVector<f64>| residuals.norm_squared();
    let closures = closures.iter().map(|(closure, [link, pose])| {
        square(closure.residual_func(&[found[link].clone(), found[pose].clone()]))
    });
    let priors = priors
        .iter()
        .map(|(prior, name)| square(prior.residual_func(&[found[name].clone()])));
    let cost = 0.5 * closures.chain(priors).sum::<f64>();
    println!("result {seconds:.6} - {cost:.17e} {:.1}", peak_memory_mib());
}

/// Peak resident memory of this process (MiB); zero where the system does not tell.
fn peak_memory_mib() -> f64 {
    let status = fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:"));
    line.and_then(|line| line.split_whitespace().nth(1)?.parse::<f64>().ok())
        .map_or(0.0, |kib| kib / 1024.0)
}
