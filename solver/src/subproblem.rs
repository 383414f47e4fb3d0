//! One step: damping for the trust radius, active set for the bounds.

use crate::jacobian::Jacobian;
use crate::linear::LinearSolver;
use crate::vector::{dot, norm};

/// Share of the radius by which a step's length may miss it.
const RADIUS_ACCURACY: f64 = 0.1;
/// Most changes of damping in the search for a step of the radius' length.
const MAX_DAMPINGS: usize = 12;
/// Damping tried first, as a share of the most that can be needed.
const FIRST_DAMPING: f64 = 1e-2;

/// Minimises `½‖J y + r‖²` subject to `‖y‖ ≤ radius` and `lower ≤ y ≤ upper`.
///
/// The damping that keeps the step within the radius is found by secants of its reciprocal length, which is nearly linear in
/// the damping (J. J. Moré, "The Levenberg-Marquardt algorithm: implementation and theory", 1978); the bounds by the primal
/// active-set method for convex quadratic programs.
pub(crate) struct Subproblem {
    /// Distance to the bounds, in scaled parameters; infinite where there is none.
    pub(crate) lower: Vec<f64>,
    pub(crate) upper: Vec<f64>,
    /// True if some bound is finite.
    pub(crate) bounded: bool,
    held: Vec<bool>,
    /// `Jᵀr`.
    pub(crate) gradient: Vec<f64>,
    /// The step.
    pub(crate) step: Vec<f64>,
    /// Damping of the step.
    pub(crate) damping: f64,
    /// Decrease of the cost that the linear model predicts for the step.
    pub(crate) predicted: f64,
    /// Step for other residuals, damped like the last one; what a bound held stays.
    pub(crate) correction: Vec<f64>,
    target: Vec<f64>,
    /// The step's image by the Jacobian.
    image: Vec<f64>,
    /// The undamped step, and what it promises.
    newton: Vec<f64>,
    newton_predicted: f64,
}

/// A linear model with its solver.
pub(crate) struct Model<'a> {
    pub(crate) jacobian: &'a Jacobian,
    pub(crate) residuals: &'a [f64],
    pub(crate) linear: &'a mut dyn LinearSolver,
}

impl Subproblem {
    pub(crate) fn new(rows: usize, columns: usize, bounded: bool) -> Self {
        Self {
            lower: vec![f64::NEG_INFINITY; columns],
            upper: vec![f64::INFINITY; columns],
            bounded,
            held: vec![false; columns],
            gradient: vec![0.0; columns],
            step: vec![0.0; columns],
            damping: 0.0,
            predicted: 0.0,
            correction: vec![0.0; columns],
            target: vec![0.0; columns],
            image: vec![0.0; rows],
            newton: vec![0.0; columns],
            newton_predicted: 0.0,
        }
    }

    /// Takes a new linear model; [`Self::lower`], [`Self::upper`] and [`Self::gradient`] are set by the caller. Afterwards
    /// [`Self::step`] is the undamped step.
    pub(crate) fn load(&mut self, model: &mut Model) {
        model.linear.load(model.jacobian, model.residuals);
        self.solve_damped(0.0, model);
        self.predict(self.is_at_minimum(), model);
        self.newton.copy_from_slice(&self.step);
        self.newton_predicted = self.predicted;
    }

    /// Length of the gradient, without what pushes against bounds.
    pub(crate) fn gradient_norm(&self) -> f64 {
        let own = (0..self.step.len()).filter(|&j| !self.is_blocked(j));
        own.map(|j| self.gradient[j].powi(2)).sum::<f64>().sqrt()
    }

    /// Finds the step for `radius`. `damping` is where the search starts, zero if unknown.
    pub(crate) fn solve(&mut self, radius: f64, mut damping: f64, model: &mut Model) {
        let is_near = |length: f64| (length - radius).abs() <= RADIUS_ACCURACY * radius;
        let newton_length = norm(&self.newton);
        if newton_length <= radius || is_near(newton_length) {
            if self.damping != 0.0 {
                self.step.copy_from_slice(&self.newton);
                self.damping = 0.0;
                self.image_of_step(model);
            }
            self.predicted = self.newton_predicted;
            return;
        }
        // Dampings of steps that are too long and too short, with their reciprocal lengths.
        let mut below = (0.0, newton_length.recip());
        let mut above = (norm(&self.gradient) / radius, f64::INFINITY);
        if above.0 <= 0.0 {
            return;
        }
        if damping <= 0.0 || damping >= above.0 {
            damping = FIRST_DAMPING * above.0;
        }
        for _ in 0..MAX_DAMPINGS {
            self.solve_damped(damping, model);
            let length = norm(&self.step);
            if is_near(length) {
                return self.predict(self.is_at_minimum(), model);
            }
            let own = (damping, length.recip());
            let is_between = length > radius && above.1.is_finite();
            let other = if is_between { above } else { below };
            damping += (radius.recip() - own.1) * (own.0 - other.0) / (own.1 - other.1);
            if length > radius {
                below = own;
            } else {
                above = own;
            }
            if !(damping > below.0 && damping < above.0) {
                damping = f64::max(1e-3 * above.0, (below.0 * above.0).sqrt());
            }
        }
        let length = norm(&self.step);
        let is_too_long = length > radius;
        if is_too_long {
            self.step.iter_mut().for_each(|y| *y *= radius / length);
        }
        self.predict(!is_too_long && self.is_at_minimum(), model);
    }

    /// Takes the residuals of the linear model at the step from those that are there.
    pub(crate) fn subtract_model(&self, residuals: &[f64], there: &mut [f64]) {
        for ((there, image), r) in there.iter_mut().zip(&self.image).zip(residuals) {
            *there -= image + r;
        }
    }

    /// Makes the [correction](Self::correction) for other residuals. The solver is left with these.
    pub(crate) fn correct(&mut self, residuals: &[f64], model: &mut Model) {
        self.correction.fill(0.0);
        let (damping, own) = (self.damping, &mut self.correction);
        (model.linear).solve_again(model.jacobian, residuals, damping, &self.held, own);
    }

    /// Minimises the damped model within the bounds.
    fn solve_damped(&mut self, damping: f64, model: &mut Model) {
        self.damping = damping;
        self.step.fill(0.0);
        for j in 0..self.step.len() {
            self.held[j] = self.is_blocked(j);
        }
        for _ in 0..3 * self.step.len() + 3 {
            self.target.copy_from_slice(&self.step);
            model.linear.solve(damping, &self.held, &mut self.target);
            if !self.bounded {
                std::mem::swap(&mut self.step, &mut self.target);
                return;
            }
            if self.advance() {
                continue;
            }
            let Some(worst) = self.worst_multiplier(model) else {
                break;
            };
            self.held[worst] = false;
        }
    }

    /// True if no bound keeps the step of [`Self::solve_damped`] off the minimum of the damped model.
    fn is_at_minimum(&self) -> bool {
        !self.held.contains(&true)
    }

    /// Moves towards the target as far as the bounds allow; true if one of them stopped it.
    fn advance(&mut self) -> bool {
        let mut share = 1.0;
        let mut stopped = None;
        for j in (0..self.step.len()).filter(|&j| !self.held[j]) {
            let change = self.target[j] - self.step[j];
            let bound = if change < 0.0 {
                self.lower[j]
            } else {
                self.upper[j]
            };
            let room = bound - self.step[j];
            if change.abs() > room.abs() && room / change < share {
                share = room / change;
                stopped = Some((j, bound));
            }
        }
        for j in (0..self.step.len()).filter(|&j| !self.held[j]) {
            let y = self.step[j] + share * (self.target[j] - self.step[j]);
            self.step[j] = y.clamp(self.lower[j], self.upper[j]);
        }
        if let Some((j, bound)) = stopped {
            self.step[j] = bound;
            self.held[j] = true;
        }
        stopped.is_some()
    }

    /// The held parameter that most wants to leave its bound.
    fn worst_multiplier(&mut self, model: &Model) -> Option<usize> {
        self.image_of_step(model);
        let residuals = self.image.iter().zip(model.residuals);
        let residuals: Vec<f64> = residuals.map(|(image, r)| image + r).collect();
        model.jacobian.transpose_times(&residuals, &mut self.target);
        let pull = |j: &usize| {
            let pull = self.target[*j] + self.damping * self.step[*j];
            let at_lower = self.step[*j] <= self.lower[*j];
            let at_upper = self.step[*j] >= self.upper[*j];
            f64::max(
                if at_lower { -pull } else { 0.0 },
                if at_upper { pull } else { 0.0 },
            )
        };
        let held = (0..self.step.len()).filter(|&j| self.held[j]);
        let worst = held.max_by(|a, b| pull(a).total_cmp(&pull(b)));
        worst.filter(|j| pull(j) > 0.0)
    }

    fn image_of_step(&mut self, model: &Model) {
        model.jacobian.times(&self.step, &mut self.image);
    }

    fn predict(&mut self, at_minimum: bool, model: &Model) {
        self.image_of_step(model);
        let image = dot(&self.image, &self.image);
        self.predicted = if at_minimum {
            // equal to the general form at the minimum of the damped model, and free of cancellation
            0.5 * image + self.damping * dot(&self.step, &self.step)
        } else {
            -dot(&self.image, model.residuals) - 0.5 * image
        };
    }

    /// True if a parameter is at a bound through which the gradient pushes it.
    fn is_blocked(&self, j: usize) -> bool {
        let is_below = || self.lower[j] >= 0.0 && self.gradient[j] >= 0.0;
        let is_above = || self.upper[j] <= 0.0 && self.gradient[j] <= 0.0;
        self.bounded && (is_below() || is_above())
    }
}
