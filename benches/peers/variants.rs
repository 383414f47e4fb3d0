//! Fits of the five variants of the paper on the prototype's measurements, against Ceres Solver.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;
use std::sync::{Arc, Mutex};

use tau::calibration::{self, Calibration, calibrate};
use tau::measurements::{Poses, Split};
use tau::prototype;
use tau::robot::{Robot, Variant};
use tau_generated::gantry_tau::ROBOT;
use tau_runtime::{Pattern, ResidualFamily, ResidualKind, Shape};
use tau_solver::{Block, Options, Parameter, Problem, solve};

use crate::comparison::{AGREEMENT, SIGMA, TOLERANCE, line};
use crate::program::Program;
use crate::{least_seconds, setup};
use tau::Setup;

/// The five variants of Dressler et al. 2010.
const VARIANTS: [&str; 5] = [
    "Nominal",
    "Piecewise",
    "Full",
    "FullPiecewise",
    "BestPerLink",
];
const TURNS: usize = 60;

/// A family that keeps the data that it is given.
struct Recorder {
    family: Arc<dyn ResidualFamily>,
    data: Arc<Mutex<Vec<f64>>>,
}

impl ResidualFamily for Recorder {
    fn shape(&self) -> Shape {
        self.family.shape()
    }

    fn pattern(&self) -> Pattern<'_> {
        self.family.pattern()
    }

    fn prepare(&self, data: &[f64], prepared: &mut [f64]) {
        self.data.lock().expect("no panic").extend(data);
        self.family.prepare(data, prepared);
    }

    fn value(&self, prepared: &[f64], parameters: &[f64], residuals: &mut [f64]) {
        self.family.value(prepared, parameters, residuals);
    }

    fn linearize(
        &self,
        prepared: &[f64],
        parameters: &[f64],
        residuals: &mut [f64],
        jacobian: &mut [f64],
    ) {
        self.family
            .linearize(prepared, parameters, residuals, jacobian);
    }
}

/// One closure of a variant.
struct Closure {
    family: Arc<dyn ResidualFamily>,
    /// Index of each of its parameters among those of the fit.
    parameters: Vec<usize>,
    data: Vec<f64>,
    with_plate_joint: bool,
    piecewise: bool,
}

/// The closures of a variant, with the data that a calibration gives them.
fn closures(
    variant: &Variant,
    poses: usize,
    fitted: &Calibration,
    calibrate: impl Fn(&Variant),
) -> Vec<Closure> {
    let mut recorded = variant.clone();
    let mut data = Vec::new();
    for instance in &mut recorded.instances {
        if instance.kind == ResidualKind::Closure {
            let kept = Arc::new(Mutex::new(Vec::new()));
            data.push(Arc::clone(&kept));
            instance.family = Arc::new(Recorder {
                family: Arc::clone(&instance.family),
                data: kept,
            });
        }
    }
    calibrate(&recorded);
    let instances = variant.instances_of(ResidualKind::Closure);
    let index = |&p: &usize| {
        let name = &variant.parameters[p].name;
        let mut fitted = fitted.parameters.iter();
        fitted
            .position(|fitted| fitted.name == *name)
            .expect("a fitted parameter")
    };
    instances
        .zip(data)
        .map(|(instance, data)| {
            let shape = instance.family.shape();
            let data = data.lock().expect("no panic");
            Closure {
                family: Arc::clone(&instance.family),
                parameters: instance.parameters.iter().map(index).collect(),
                // The fit prepares its samples first; what is evaluated after it is not wanted.
                data: data[..poses * shape.data].to_vec(),
                with_plate_joint: shape.parameters == 10,
                piecewise: shape.data >= 12,
            }
        })
        .collect()
}

fn problem<'a>(fitted: &Calibration, closures: &'a [Closure], poses: usize) -> Problem<'a> {
    let parameters = fitted.parameters.iter().map(|estimate| {
        let parameter = Parameter::new(&estimate.name, estimate.nominal);
        match estimate.tolerance {
            Some(sigma) => parameter.with_prior(estimate.nominal, sigma),
            None => parameter,
        }
    });
    let blocks = closures.iter().map(|closure| {
        let indices = closure.parameters.clone();
        Block::new("closure", &*closure.family, indices, &closure.data)
            .with_weights(vec![1.0 / SIGMA; poses])
    });
    Problem {
        parameters: parameters.collect(),
        blocks: blocks.collect(),
    }
}

/// The problem as the peer reads it: number of closures, poses, weight, tolerance; for each closure whether
/// it has a plate joint, whether its track is piecewise, numbers of parameters and data; starts and means of its
/// parameters, their standard deviations (zero for none), data.
fn text(fitted: &Calibration, closures: &[Closure], poses: usize) -> String {
    let mut text = format!(
        "{} {poses} {:e} {TOLERANCE:e}\n",
        closures.len(),
        1.0 / SIGMA
    );
    for closure in closures {
        let (plate, piecewise) = (closure.with_plate_joint, closure.piecewise);
        let (plate, piecewise) = (u8::from(plate), u8::from(piecewise));
        let width = closure.data.len() / poses;
        let _ = writeln!(
            text,
            "{plate} {piecewise} {} {width}",
            closure.parameters.len()
        );
        let own = || closure.parameters.iter().map(|&p| &fitted.parameters[p]);
        line(&mut text, &own().map(|p| p.nominal).collect::<Vec<_>>());
        line(
            &mut text,
            &own()
                .map(|p| p.tolerance.unwrap_or(0.0))
                .collect::<Vec<_>>(),
        );
        closure
            .data
            .chunks(width)
            .for_each(|sample| line(&mut text, sample));
    }
    text
}

/// Calibrates each variant on the prototype's measurements, from nominal values.
pub(crate) fn print(ceres: Option<&Path>) {
    let robot = Robot::from(&ROBOT);
    let (file, folder) = (prototype::robot_file(), prototype::folder());
    let (file, folder) = (file.expect("a robot file"), folder.expect("measurements"));
    let poses = Poses::select(&robot, &file, &folder, Split::Alternate).expect("poses");
    let poses = poses.division.calibration;
    println!(
        "The five variants on the prototype's {} calibration poses, from nominal values. *Calibration* is the \
         whole of it: weights of the residuals, covariance, undetermined combinations. The other columns are the \
         fit alone, with the same weight for every residual: Ceres Solver (one thread, closure by closure) from \
         its built problems on.\n\n\
         | variant | parameters | calibration, ms | fit, ms | Ceres DENSE_QR, ms | tau = 1 | Ceres \
         DENSE_NORMAL_CHOLESKY, ms | tau = 1 | final cost |\n\
         | --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |",
        poses.len()
    );
    let options = calibration::Options::default();
    let mut total = 0.0;
    for name in VARIANTS {
        let variant = robot.variant(name).expect("a variant");
        let calibrated = |variant: &Variant| {
            calibrate(
                Setup::new(&robot, variant, &file, &folder),
                &poses,
                &options,
            )
            .expect("a calibration")
        };
        let fitted = calibrated(variant);
        let closures = closures(variant, poses.len(), &fitted, |variant| {
            calibrated(variant);
        });
        let file = setup::folder().join("variant.txt");
        fs::write(&file, text(&fitted, &closures, poses.len())).expect("a file of samples");
        let mut peer = ceres.and_then(|program| Program::start(program, &["variant"], &file));
        let (mut whole, mut fit) = (f64::INFINITY, f64::INFINITY);
        let mut cost = 0.0;
        let mut peers: Vec<(f64, f64)> = Vec::new();
        let options = Options {
            cost_tolerance: TOLERANCE,
            ..Options::default()
        };
        for _ in 0..TURNS {
            whole = whole.min(least_seconds(1, || {
                calibrated(variant);
            }));
            fit = fit.min(least_seconds(1, || {
                let problem = problem(&fitted, &closures, poses.len());
                let solution = solve(&problem, &options).expect("a solution");
                assert!(solution.converged(), "{}", solution.termination);
                cost = solution.cost;
            }));
            let turns = peer.as_mut().map(Program::turn).unwrap_or_default();
            peers.resize(turns.len().max(peers.len()), (f64::INFINITY, 0.0));
            for (peer, turn) in peers.iter_mut().zip(turns) {
                *peer = (peer.0.min(turn.seconds), turn.result);
            }
        }
        total += whole;
        let mut columns = String::new();
        for (seconds, other) in peers {
            let differ = (other / cost - 1.0).abs();
            assert!(differ <= AGREEMENT, "{name}: costs differ by {differ:e}");
            let _ = write!(columns, "{:.3} | {:.1} | ", 1e3 * seconds, seconds / fit);
        }
        if columns.is_empty() {
            "– | – | – | – | ".clone_into(&mut columns);
        }
        println!(
            "| `{name}` | {} | {:.3} | {:.3} | {columns}{cost:.9e} |",
            fitted.parameters.len(),
            1e3 * whole,
            1e3 * fit,
        );
    }
    println!("| all five | | {:.3} | | | | | | |\n", 1e3 * total);
}
