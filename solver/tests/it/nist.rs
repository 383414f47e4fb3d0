//! The 27 nonlinear regression problems of NIST's Statistical Reference Datasets, from both starts.
//!
//! Scored as in Ceres Solver's `examples/nist.cc`: the log relative error of a run is the number of
//! correct digits of its worst parameter, between 0 and 11.
//!
//! `cargo test -p tau-solver nist -- --nocapture` prints the table.

use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::Path;

use tau_solver::{Options, solve};

use crate::family::{Family, Model, finite_difference_error, problem};
use crate::scalar::Scalar;

/// The folder of the 27 files.
const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/nist");

/// The collection: names of the data sets and their formulas.
const COLLECTION: [(&str, Formula); 27] = [
    ("Bennett5", Formula::Bennett5),
    ("BoxBOD", Formula::Misra1a),
    ("Chwirut1", Formula::Chwirut),
    ("Chwirut2", Formula::Chwirut),
    ("DanWood", Formula::DanWood),
    ("ENSO", Formula::Enso),
    ("Eckerle4", Formula::Eckerle4),
    ("Gauss1", Formula::Gauss),
    ("Gauss2", Formula::Gauss),
    ("Gauss3", Formula::Gauss),
    ("Hahn1", Formula::Hahn),
    ("Kirby2", Formula::Kirby2),
    ("Lanczos1", Formula::Lanczos),
    ("Lanczos2", Formula::Lanczos),
    ("Lanczos3", Formula::Lanczos),
    ("MGH09", Formula::Mgh09),
    ("MGH10", Formula::Mgh10),
    ("MGH17", Formula::Mgh17),
    ("Misra1a", Formula::Misra1a),
    ("Misra1b", Formula::Misra1b),
    ("Misra1c", Formula::Misra1c),
    ("Misra1d", Formula::Misra1d),
    ("Nelson", Formula::Nelson),
    ("Rat42", Formula::Rat42),
    ("Rat43", Formula::Rat43),
    ("Roszman1", Formula::Roszman1),
    ("Thurber", Formula::Hahn),
];

/// Formulas of the problems; some data sets share one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Formula {
    Bennett5,
    Chwirut,
    DanWood,
    Eckerle4,
    Enso,
    Gauss,
    Hahn,
    Kirby2,
    Lanczos,
    Mgh09,
    Mgh10,
    Mgh17,
    Misra1a,
    Misra1b,
    Misra1c,
    Misra1d,
    Nelson,
    Rat42,
    Rat43,
    Roszman1,
}

impl Formula {
    fn predict<T: Scalar>(self, x: &[f64], b: &[T]) -> T {
        let one = T::from(1.0);
        let t = x[0];
        let cubic = |c: &[T]| c[0] + c[1] * t + c[2] * (t * t) + c[3] * (t * t * t);
        let bell =
            |height: T, center: T, width: T| height * (-((-center + t) / width).square()).exp();
        let wave = |cosine: T, sine: T, period: T| {
            let phase = T::from(2.0 * PI * t) / period;
            cosine * phase.cos() + sine * phase.sin()
        };
        match self {
            Self::Bennett5 => b[0] * (b[1] + t).pow(-one / b[2]),
            Self::Chwirut => (-b[0] * t).exp() / (b[1] + b[2] * t),
            Self::DanWood => b[0] * (b[1] * t.ln()).exp(),
            Self::Eckerle4 => b[0] / b[1] * (((-b[2] + t) / b[1]).square() * -0.5).exp(),
            Self::Enso => {
                b[0] + wave(b[1], b[2], T::from(12.0))
                    + wave(b[4], b[5], b[3])
                    + wave(b[7], b[8], b[6])
            }
            Self::Gauss => {
                b[0] * (-b[1] * t).exp() + bell(b[2], b[3], b[4]) + bell(b[5], b[6], b[7])
            }
            Self::Hahn => cubic(b) / cubic(&[one, b[4], b[5], b[6]]),
            Self::Kirby2 => (b[0] + b[1] * t + b[2] * (t * t)) / (one + b[3] * t + b[4] * (t * t)),
            Self::Lanczos => {
                b[0] * (-b[1] * t).exp() + b[2] * (-b[3] * t).exp() + b[4] * (-b[5] * t).exp()
            }
            Self::Mgh09 => b[0] * (b[1] * t + t * t) / (b[2] * t + b[3] + t * t),
            Self::Mgh10 => b[0] * (b[1] / (b[2] + t)).exp(),
            Self::Mgh17 => b[0] + b[1] * (-b[3] * t).exp() + b[2] * (-b[4] * t).exp(),
            Self::Misra1a => b[0] * (one - (-b[1] * t).exp()),
            Self::Misra1b => b[0] * (one - one / (b[1] * (t / 2.0) + 1.0).square()),
            Self::Misra1c => b[0] * (one - (b[1] * (2.0 * t) + 1.0).powf(-0.5)),
            Self::Misra1d => b[0] * b[1] * t / (b[1] * t + 1.0),
            Self::Nelson => b[0] - b[1] * t * (-b[2] * x[1]).exp(),
            Self::Rat42 => b[0] / (one + (b[1] - b[2] * t).exp()),
            Self::Rat43 => b[0] / (one + (b[1] - b[2] * t).exp()).pow(one / b[3]),
            // The certified b1 goes with the angle between 0 and pi, as of atan2(b3, x - b4).
            Self::Roszman1 => b[0] - b[1] * t + ((-b[3] + t) / b[2]).atan() / PI - 0.5,
        }
    }
}

/// A data set as read from its file.
struct DataSet {
    name: &'static str,
    formula: Formula,
    starts: [Vec<f64>; 2],
    certified: Vec<f64>,
    certified_sum_of_squares: f64,
    predictors: usize,
    /// Response and predictors, sample by sample.
    data: Vec<f64>,
}

impl Model for &DataSet {
    fn sizes(&self) -> (usize, usize, usize) {
        (1 + self.predictors, self.certified.len(), 1)
    }

    fn residuals<T: Scalar>(&self, data: &[f64], x: &[T], out: &mut [T]) {
        let response = if self.formula == Formula::Nelson {
            data[0].ln()
        } else {
            data[0]
        };
        out[0] = -self.formula.predict(&data[1..], x) + response;
    }
}

/// Reads a file of the collection: parameter lines are `bN = start1 start2 value deviation`, the data
/// follow the second line that starts with `Data:`.
fn read(name: &'static str, formula: Formula) -> DataSet {
    let path = Path::new(FOLDER).join(name).with_extension("dat");
    let text = std::fs::read_to_string(&path)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let numbers = |line: &str| -> Vec<f64> {
        line.split_whitespace()
            .map_while(|w| w.parse().ok())
            .collect()
    };
    let mut set = DataSet {
        name,
        formula,
        starts: [Vec::new(), Vec::new()],
        certified: Vec::new(),
        certified_sum_of_squares: f64::NAN,
        predictors: 0,
        data: Vec::new(),
    };
    let mut data_lines = 0;
    let mut observations = 0;
    for line in text.lines() {
        if line.starts_with("Data:") {
            data_lines += 1;
        } else if data_lines == 2 {
            let sample = numbers(line);
            if !sample.is_empty() {
                set.predictors = sample.len() - 1;
                set.data.extend(sample);
            }
        } else if let Some((label, values)) = line.split_once('=')
            && label
                .trim()
                .strip_prefix('b')
                .is_some_and(|n| n.parse::<usize>().is_ok())
            && let [first, second, certified, _] = numbers(values)[..]
        {
            set.starts[0].push(first);
            set.starts[1].push(second);
            set.certified.push(certified);
        } else if let Some(value) = line.strip_prefix("Residual Sum of Squares:") {
            set.certified_sum_of_squares = value.trim().parse().unwrap();
        } else if let Some(count) = line.trim().strip_suffix("Observations") {
            observations = count.trim().parse().unwrap();
        }
    }
    assert_eq!(
        set.data.len(),
        observations * (1 + set.predictors),
        "{name}"
    );
    set
}

/// Correct digits of the worst parameter, from 0 to 11.
fn log_relative_error(found: &[f64], certified: &[f64]) -> f64 {
    assert!(!certified.is_empty() && found.len() == certified.len());
    assert!(found.iter().all(|value| value.is_finite()));
    found
        .iter()
        .zip(certified)
        .map(|(f, c)| (-((f - c).abs() / c.abs()).log10()).clamp(0.0, 11.0))
        .fold(11.0, f64::min)
}

#[test]
fn nist_reference_problems() {
    let mut table = String::new();
    let mut errors = Vec::new();
    for (name, formula) in COLLECTION {
        let set = read(name, formula);
        let family = Family::new(&set);
        for (start, values) in set.starts.iter().enumerate() {
            let problem = problem(&family, &set.data, values);
            let solution = solve(&problem, &Options::default()).unwrap();
            let digits = log_relative_error(&solution.parameters, &set.certified);
            let sum_of_squares = 2.0 * solution.cost;
            writeln!(
                table,
                "{:<10} {} {digits:5.1} {:5} {:.10e} {:.10e} {}",
                set.name,
                start + 1,
                solution.iterations,
                sum_of_squares,
                set.certified_sum_of_squares,
                solution.termination,
            )
            .unwrap();
            // A wrong optimum would have another sum of squares; below 1e-20 (Lanczos1) it is rounding.
            let certified = set.certified_sum_of_squares;
            let excess = (sum_of_squares - certified).abs();
            let label = format!("{} from start {}", set.name, start + 1);
            assert!(solution.converged(), "{label}: {}", solution.termination);
            assert!(
                excess < 1e-8 * certified + 1e-20,
                "{label}: {sum_of_squares:e}"
            );
            assert!(digits >= 10.0, "{label}: {digits} digits");
            errors.push(digits);
        }
    }
    println!("{table}");
    let mean = errors.iter().sum::<f64>() / errors.len() as f64;
    let reaching = |digits: f64| errors.iter().filter(|&&e| e >= digits).count();
    println!(
        "mean {mean:.1}; at least 10 digits {}, 10.5 digits {} of {}",
        reaching(10.0),
        reaching(10.5),
        errors.len()
    );
    // As README.md and docs/solver.md state.
    assert_eq!(errors.len(), 54);
    assert!(mean >= 10.65, "mean log relative error {mean}");
}

#[test]
fn nist_jacobians_agree_with_finite_differences() {
    for (name, formula) in COLLECTION {
        let set = read(name, formula);
        let family = Family::new(&set);
        let error = finite_difference_error(&family, &set.data, &set.starts[1]);
        assert!(error < 1e-6, "{}: {error:e}", set.name);
    }
}
