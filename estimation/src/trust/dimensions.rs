//! Dimensions that may be far off: hypotheses for recognition.
//!
//! A closure is a polynomial of second degree in each of its dimensions, so its sum of squares is one of fourth degree:
//! three residuals a pose give it, and its minima are found wherever they are.
//!
//! One that changes residuals only by its square is no hypothesis: at every pose alike, that is what a length does, and
//! evidence would prefer it for being known less well. Heights of joints of a machine that moves in a plane are such.

use tau_robot::robot::ResidualKind;

use crate::joint::judged::{Deviation, Judged};
use crate::numerics::order::{largest_first, smallest_first};
use crate::numerics::roots;
use crate::problem::{Closures, Part, Residuals};
use crate::trust::ODDS;
use crate::trust::hypothesis::{Case, Hypothesis};

/// Dimensions that are set free of either kind, the most suspect first: each costs a whole fit.
const MOST: usize = 6;
/// A closure whose square exceeds the mean of the others so many times, three of their standard deviations, is looked at
/// for one wrong dimension.
const CLEARLY: f64 = 9.0;
/// Share of the links' length within which closures are followed.
pub(crate) const STEP: f64 = 0.1;

/// Dimensions that may be far off: those whose deviation from nominal in the fit as given is worst, and those of a closure
/// that misses by far more than the others.
pub(super) fn suspects(case: &Case<'_>, given: Option<&Judged>) -> Vec<Hypothesis> {
    let Some(curves) = Curves::new(case) else {
        return vec![];
    };
    let mut starts: Vec<(usize, f64)> = Vec::new();
    if let Some(given) = given {
        let (values, deviations) = (given.values(), given.deviations());
        // Set free, a parameter lets χ² fall by the square of this deviation.
        let falls = |d: &Deviation| (d.deleted / given.misfit().ratio().max(1.0)).powi(2);
        let mut worst: Vec<&Deviation> = (deviations.iter())
            .filter(|deviation| falls(deviation) > 2.0 * ODDS.ln())
            .filter(|deviation| curves.see(deviation.parameter))
            .collect();
        largest_first(&mut worst, |deviation| deviation.deleted.abs());
        let worst = worst.into_iter().take(MOST);
        starts.extend(worst.map(|d| (d.parameter, values[d.parameter])));
    }
    starts.extend(curves.far_off());
    let of = |(parameter, start)| Hypothesis::Dimension { parameter, start };
    starts.into_iter().map(of).collect()
}

/// Closures at the drawing, along each of their parameters.
struct Curves {
    parts: Vec<Part>,
    /// Indices in the variant of what the parts depend on, and values.
    used: Vec<usize>,
    at: Vec<f64>,
    /// Half of the stretch by which curves are told.
    step: f64,
}

/// A closure at all poses, along one parameter.
struct Curve {
    /// Coefficients of its sum of squares by the change.
    sums: [f64; 5],
    /// Sum of the squares of its first derivatives, in units of the noise.
    slope: f64,
}

impl Curve {
    /// True if a step changes the closure by more than the noise, to first order.
    fn is_steep(&self, step: f64) -> bool {
        self.slope * step.powi(2) > 1.0
    }
}

impl Curves {
    /// `None` where the case lacks what closures take.
    fn new(case: &Case<'_>) -> Option<Self> {
        let prepared = case.prepared().ok()?;
        let samples = case.samples();
        let (machine, nominal) = (&prepared.machine, &prepared.nominal);
        let noise = case.file.noise;
        let residuals = Residuals::new(machine, nominal, &samples, noise, Closures::Apart).ok()?;
        let closures = machine.variant.instances_of(ResidualKind::Closure).count();
        let mut parts = residuals.parts;
        parts.truncate(closures);
        Some(Self {
            parts,
            at: residuals.used.iter().map(|&p| machine.values[p]).collect(),
            used: residuals.used,
            step: STEP * case.mean_length_m(),
        })
    }

    /// A part where one of its parameters is another.
    fn moved(&self, part: &Part, column: usize, by: f64) -> Vec<f64> {
        let mut moved = self.at.clone();
        moved[column] += by;
        part.values(&moved)
    }

    fn curve(&self, part: &Part, column: usize) -> Curve {
        let step = self.step;
        let [low, middle, high] = [-step, 0.0, step].map(|by| self.moved(part, column, by));
        // Sums over poses of products of a, b and c of a + b·δ + c·δ².
        let (mut sums, mut slope) = ([0.0; 5], 0.0);
        let values = low.iter().zip(&middle).zip(&high);
        for (((low, &a), high), weight) in values.zip(&part.weights) {
            let b = (high - low) / (2.0 * step);
            let c = (high - 2.0 * a + low) / (2.0 * step * step);
            for (sum, term) in
                sums.iter_mut()
                    .zip([a * a, 2.0 * a * b, b * b + 2.0 * a * c, 2.0 * b * c, c * c])
            {
                *sum += term;
            }
            slope += (weight * b).powi(2);
        }
        Curve { sums, slope }
    }

    /// True if closures change by a parameter of the variant, to first order.
    fn see(&self, parameter: usize) -> bool {
        let Some(column) = self.used.iter().position(|&used| used == parameter) else {
            return false;
        };
        let parts = self.parts.iter();
        let own = parts.filter(|part| part.parameters.contains(&column));
        let mut curves = own.map(|part| self.curve(part, column));
        curves.any(|curve| curve.is_steep(self.step))
    }

    /// Parameters of closures that miss by far, with values at which they would not, best first.
    fn far_off(&self) -> Vec<(usize, f64)> {
        let square = |values: &[f64]| values.iter().map(|r| r * r).sum::<f64>();
        let misfits: Vec<f64> = (self.parts.iter())
            .map(|part| square(&part.values(&self.at)))
            .collect();
        let mut sorted = misfits.clone();
        sorted.sort_by(f64::total_cmp);
        let Some(&usual) = sorted.get((sorted.len().max(1) - 1) / 2) else {
            return vec![];
        };
        let mut found = Vec::new();
        for (part, &misfit) in self.parts.iter().zip(&misfits) {
            if misfit < CLEARLY * usual {
                continue;
            }
            for &column in &part.parameters {
                let curve = self.curve(part, column);
                if !curve.is_steep(self.step) {
                    continue;
                }
                let [_, one, two, three, four] = curve.sums;
                for shift in roots::of_cubic([one, 2.0 * two, 3.0 * three, 4.0 * four]) {
                    let left = square(&self.moved(part, column, shift));
                    if CLEARLY * left < misfit {
                        found.push((left, self.used[column], self.at[column] + shift));
                    }
                }
            }
        }
        smallest_first(&mut found, |own| own.0);
        found.truncate(MOST);
        let of = found.into_iter();
        of.map(|(_, parameter, value)| (parameter, value)).collect()
    }
}
