//! The trust-region subproblem: the best step of the linear model within radius and bounds.

use crate::jacobian::Jacobian;
use crate::linear::LinearSolver;
use crate::vector::{at_once, dot, norm, on_each, zeros};

/// Share of the radius by which a step's length may miss it.
const RADIUS_ACCURACY: f64 = 0.1;
/// Most changes of damping in the search for a step of the radius' length.
const MAX_DAMPINGS: usize = 12;

/// Minimises `½‖J y + r‖²` subject to `‖y‖ ≤ radius` and `lower ≤ y ≤ upper`.
///
/// The damping that keeps the step within the radius is found by Newton's method on the secular
/// equation (J. J. Moré, "The Levenberg-Marquardt algorithm: implementation and theory", 1978); the
/// bounds by the primal active-set method for convex quadratic programs.
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
    target: Vec<f64>,
    image: Vec<f64>,
    /// True if the image is that of the step by the Jacobian, and if the step is the undamped one.
    has_image: bool,
    is_newton: bool,
    multipliers: Vec<f64>,
    newton: Newton,
}

/// The undamped step.
struct Newton {
    step: Vec<f64>,
    predicted: f64,
    /// True if its rank is full.
    is_full_rank: bool,
    /// Lower limit of the damping per relative excess of its length, zero if unknown; `None` until it is asked for.
    inverse_form: Option<f64>,
}

impl Subproblem {
    pub(crate) fn new(rows: usize, columns: usize, bounded: bool) -> Self {
        Self {
            lower: vec![f64::NEG_INFINITY; columns],
            upper: vec![f64::INFINITY; columns],
            bounded,
            held: vec![false; columns],
            gradient: zeros(columns),
            step: zeros(columns),
            damping: 0.0,
            predicted: 0.0,
            target: zeros(columns),
            image: zeros(rows),
            has_image: false,
            is_newton: false,
            multipliers: zeros(columns),
            newton: Newton {
                step: zeros(columns),
                predicted: 0.0,
                is_full_rank: false,
                inverse_form: None,
            },
        }
    }

    /// Takes a new linear model; [`Self::lower`], [`Self::upper`] and [`Self::gradient`] are set by the caller. Afterwards
    /// [`Self::step`] is the undamped step.
    pub(crate) fn load(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        linear: &mut dyn LinearSolver,
    ) {
        linear.load(jacobian, residuals);
        self.newton.is_full_rank = self.solve_damped(0.0, jacobian, residuals, linear);
        self.predict(self.is_at_minimum(), jacobian, residuals);
        self.newton.step.copy_from_slice(&self.step);
        self.newton.predicted = self.predicted;
        self.newton.inverse_form = None;
        self.is_newton = true;
    }

    /// [`Newton::inverse_form`] of the undamped step, which `linear` solved for last if it was not asked for before.
    fn newton_form(&mut self, linear: &mut dyn LinearSolver) -> f64 {
        if let Some(known) = self.newton.inverse_form {
            return known;
        }
        // Without full rank or with bounds the length is no convex function of the damping.
        let form = if self.newton.is_full_rank && !self.bounded {
            self.direction_form(linear)
        } else {
            0.0
        };
        self.newton.inverse_form = Some(form);
        form
    }

    /// Length of the gradient, without what pushes against bounds.
    pub(crate) fn gradient_norm(&self) -> f64 {
        if !self.bounded {
            return norm(&self.gradient);
        }
        (0..self.step.len())
            .filter(|&j| !self.is_blocked(j))
            .map(|j| self.gradient[j] * self.gradient[j])
            .sum::<f64>()
            .sqrt()
    }

    /// Finds the step for `radius`. `damping` is where the search starts, zero if unknown.
    pub(crate) fn solve(
        &mut self,
        radius: f64,
        damping: f64,
        jacobian: &Jacobian,
        residuals: &[f64],
        linear: &mut dyn LinearSolver,
    ) {
        if !self.is_newton {
            self.step.copy_from_slice(&self.newton.step);
            (self.is_newton, self.has_image) = (true, false);
        }
        self.predicted = self.newton.predicted;
        self.damping = 0.0;
        let mut excess = norm(&self.step) - radius;
        if excess <= RADIUS_ACCURACY * radius {
            return;
        }
        let form = self.newton_form(linear);
        let mut least = if form > 0.0 {
            excess / radius / form
        } else {
            0.0
        };
        let mut most = norm(&self.gradient) / radius;
        if most <= 0.0 {
            return;
        }
        let mut damping = damping.clamp(least.min(most), most);
        if damping <= 0.0 {
            damping = norm(&self.gradient) / norm(&self.step);
        }
        for _ in 0..MAX_DAMPINGS {
            if damping <= 0.0 {
                damping = f64::max(1e-3 * most, (least * most).sqrt());
            }
            self.solve_damped(damping, jacobian, residuals, linear);
            excess = norm(&self.step) - radius;
            if excess.abs() <= RADIUS_ACCURACY * radius {
                self.predict(self.is_at_minimum(), jacobian, residuals);
                return;
            }
            if excess > 0.0 {
                least = least.max(damping);
            } else {
                most = most.min(damping);
            }
            let form = self.direction_form(linear);
            let change = if form > 0.0 {
                excess / radius / form
            } else {
                0.0
            };
            damping = f64::max(least, damping + change);
            if damping >= most {
                damping = (least * most).sqrt();
            }
        }
        let is_too_long = excess > 0.0;
        if is_too_long {
            let shrink = radius / (radius + excess);
            self.step.iter_mut().for_each(|y| *y *= shrink);
            self.has_image = false;
        }
        let at_minimum = !is_too_long && self.is_at_minimum();
        self.predict(at_minimum, jacobian, residuals);
    }

    /// Takes the residuals of the linear model at the step from those that are there.
    pub(crate) fn subtract_model(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        there: &mut [f64],
    ) {
        self.make_image(jacobian);
        let length = at_once(there.len());
        let known = self.image.chunks(length).zip(residuals.chunks(length));
        let rows = there.len();
        on_each(
            rows,
            there.chunks_mut(length).zip(known),
            |(there, (image, residuals))| {
                for ((there, image), r) in there.iter_mut().zip(image).zip(residuals) {
                    *there -= image + r;
                }
            },
        );
    }

    /// The step for other residuals, damped like the last one; what a bound held stays. `linear` is left with these.
    pub(crate) fn correction(
        &mut self,
        jacobian: &Jacobian,
        residuals: &[f64],
        linear: &mut dyn LinearSolver,
    ) -> &[f64] {
        self.target.fill(0.0);
        let target = &mut self.target;
        linear.solve_again(jacobian, residuals, self.damping, &self.held, target);
        &self.target
    }

    /// `vᵀ (JᵀJ + damping I)⁻¹ v` for the step's direction v among the parameters not held: the
    /// relative change of the step's length per change of the damping.
    fn direction_form(&mut self, linear: &mut dyn LinearSolver) -> f64 {
        let length = norm(&self.step);
        let chunk = at_once(self.step.len());
        let own = self.step.chunks(chunk).zip(self.held.chunks(chunk));
        let parts = self.target.chunks_mut(chunk).zip(own);
        on_each(self.step.len(), parts, |(target, (step, held))| {
            for ((target, step), held) in target.iter_mut().zip(step).zip(held) {
                *target = if !held && length > 0.0 {
                    step / length
                } else {
                    0.0
                };
            }
        });
        linear.inverse_form(&self.target)
    }

    /// Minimises the damped model within the bounds. Returns whether its rank is full.
    fn solve_damped(
        &mut self,
        damping: f64,
        jacobian: &Jacobian,
        residuals: &[f64],
        linear: &mut dyn LinearSolver,
    ) -> bool {
        self.damping = damping;
        (self.is_newton, self.has_image) = (false, false);
        if !self.bounded {
            self.target.fill(0.0);
            let full_rank = linear.solve(damping, &self.held, &mut self.target);
            std::mem::swap(&mut self.step, &mut self.target);
            return full_rank;
        }
        self.step.fill(0.0);
        for j in 0..self.step.len() {
            self.held[j] = self.is_blocked(j);
        }
        let mut full_rank = true;
        for _ in 0..3 * self.step.len() + 3 {
            self.target.copy_from_slice(&self.step);
            full_rank = linear.solve(damping, &self.held, &mut self.target);
            if self.advance() {
                continue;
            }
            self.model_gradient(jacobian, residuals);
            let Some(worst) = self.worst_multiplier() else {
                break;
            };
            self.held[worst] = false;
        }
        full_rank
    }

    /// True if no bound keeps the step of [`Self::solve_damped`] off the minimum of the damped model.
    fn is_at_minimum(&self) -> bool {
        !self.held.contains(&true)
    }

    /// Moves towards the target as far as the bounds allow; true if one of them stopped it.
    fn advance(&mut self) -> bool {
        let mut share = 1.0;
        let mut stopped = None;
        for j in 0..self.step.len() {
            let change = self.target[j] - self.step[j];
            let bound = if change < 0.0 {
                self.lower[j]
            } else {
                self.upper[j]
            };
            let room = bound - self.step[j];
            if !self.held[j] && change.abs() > room.abs() && room / change < share {
                share = room / change;
                stopped = Some((j, bound));
            }
        }
        for j in 0..self.step.len() {
            if !self.held[j] {
                let y = self.step[j] + share * (self.target[j] - self.step[j]);
                self.step[j] = y.clamp(self.lower[j], self.upper[j]);
            }
        }
        if let Some((j, bound)) = stopped {
            self.step[j] = bound;
            self.held[j] = true;
        }
        stopped.is_some()
    }

    /// The held parameter that most wants to leave its bound.
    fn worst_multiplier(&self) -> Option<usize> {
        let mut worst = None;
        let mut most = 0.0;
        for j in 0..self.step.len() {
            if self.held[j] {
                let at_lower = self.step[j] <= self.lower[j];
                let at_upper = self.step[j] >= self.upper[j];
                let pull = self.multipliers[j];
                if (at_lower && -pull > most) || (at_upper && pull > most) {
                    (worst, most) = (Some(j), pull.abs());
                }
            }
        }
        worst
    }

    fn model_gradient(&mut self, jacobian: &Jacobian, residuals: &[f64]) {
        jacobian.times(&self.step, &mut self.image);
        self.has_image = false;
        for (image, r) in self.image.iter_mut().zip(residuals) {
            *image += r;
        }
        jacobian.transpose_times(&self.image, &mut self.multipliers);
        for (multiplier, y) in self.multipliers.iter_mut().zip(&self.step) {
            *multiplier += self.damping * y;
        }
    }

    fn make_image(&mut self, jacobian: &Jacobian) {
        if !self.has_image {
            jacobian.times(&self.step, &mut self.image);
            self.has_image = true;
        }
    }

    fn predict(&mut self, at_minimum: bool, jacobian: &Jacobian, residuals: &[f64]) {
        self.make_image(jacobian);
        let image = dot(&self.image, &self.image);
        self.predicted = if at_minimum {
            // equal to the general form at the minimum of the damped model, and free of cancellation
            0.5 * image + self.damping * dot(&self.step, &self.step)
        } else {
            -dot(&self.image, residuals) - 0.5 * image
        };
    }

    /// True if a parameter is at a bound through which the gradient pushes it.
    fn is_blocked(&self, j: usize) -> bool {
        let is_below = || self.lower[j] >= 0.0 && self.gradient[j] >= 0.0;
        let is_above = || self.upper[j] <= 0.0 && self.gradient[j] <= 0.0;
        self.bounded && (is_below() || is_above())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::jacobian::JacobianPattern;
    use crate::linear::{Method, new_solver};

    #[test]
    fn a_step_depends_on_its_radius_and_not_on_those_before() {
        let mut pattern = JacobianPattern::new(2);
        (0..3).for_each(|_| pattern.push_rows(&[0, 1], &[2]));
        let mut jacobian = pattern.into_jacobian();
        jacobian
            .values
            .copy_from_slice(&[3.0, 1.0, 0.5, 2.0, -1.0, 1.0]);
        let residuals = [1.0, -2.0, 0.3];
        let fresh = |radii: &[f64]| {
            let (_, mut linear) = new_solver(Method::DenseQr, &jacobian).expect("a small matrix");
            let mut subproblem = Subproblem::new(3, 2, false);
            jacobian.transpose_times(&residuals, &mut subproblem.gradient);
            subproblem.load(&jacobian, &residuals, &mut *linear);
            for &radius in radii {
                subproblem.solve(radius, 0.0, &jacobian, &residuals, &mut *linear);
            }
            // What residuals that are those of the model miss of it is nothing.
            let mut there = [0.0; 3];
            jacobian.times(&subproblem.step, &mut there);
            there
                .iter_mut()
                .zip(residuals)
                .for_each(|(own, r)| *own += r);
            subproblem.subtract_model(&jacobian, &residuals, &mut there);
            assert!(there.iter().all(|missed| missed.abs() < 1e-14), "{there:?}");
            subproblem.step
        };
        let length = norm(&fresh(&[1e3]));
        for radius in [0.2 * length, 0.6 * length, 2.0 * length] {
            let alone = fresh(&[radius]);
            assert!(norm(&alone) <= (1.0 + RADIUS_ACCURACY) * radius);
            for before in [0.1 * length, 0.5 * length, 3.0 * length] {
                assert_eq!(fresh(&[before, radius]), alone);
            }
        }
    }
}
