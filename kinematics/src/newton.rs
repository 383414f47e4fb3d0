//! Damped Newton iteration on the closures, in the pose, the commands, or parts of both.

use nalgebra::{Cholesky, DMatrix, DVector, Matrix6, Vector3};

use super::inputs::Sample;
use super::least_norm::least_norm;
use super::machine::{Closures, Machine, Scratch};
use super::pose::POSE_COLUMNS;
use super::{Error, Pose};

/// Steps, the longest of which lead 30 m or rad away in so many: farther than a pose may be from a start.
const MAX_ITERATIONS: usize = 60;
/// Steps by the tangent after which those of closures that contradict each other take account of how these bend.
const STEPS_BY_TANGENT: usize = 10;
/// Motion (m, rad) by which the change of the tangent is measured: its own error and that of rounding are as small.
const BEND: f64 = 1e-5;
/// Least share of the fall that the tangent lets expect which a step must bring (L. Armijo, Pacific J. Math. 16, 1966).
const LEAST_FALL: f64 = 1e-4;
/// A mismatch of link lengths (m) that is rounding.
const ROUNDING_M: f64 = 1e-13;
/// A step (m, rad) after which nothing moves any more.
const SETTLED: f64 = 1e-11;
/// Longest step: the closures are quadratic, beyond this the tangent says nothing.
pub(crate) const LONGEST_STEP: f64 = 0.5;

/// Root mean square of what closures miss, as a share of the distances that they bridge, beyond which links are those of
/// another machine.
const MOST_MISFIT: f64 = 0.1;

/// A solution of the closures.
#[derive(Debug, Clone)]
pub(crate) struct Settled {
    pub(crate) pose: Pose,
    pub(crate) commands_m: Vec<f64>,
    /// Root of the sum of squared mismatches (m); zero up to rounding unless overdetermined.
    pub(crate) mismatch_m: f64,
    /// The closures there.
    pub(crate) closures: Closures,
}

/// Solves the closures in the columns of [`Closures::jacobian`](super::machine::Closures) that are
/// listed, from the pose and commands of `start`. With more closures than unknowns the sum of squares
/// is least; with fewer, each step is the shortest.
///
/// Where closures contradict each other, what they are left off by times how they bend outweighs the tangent along motions
/// that hardly change them: steps by the tangent alone then gain little each, or overshoot, and those of Newton's method
/// for the sum of squares take over (Å. Björck, *Numerical Methods for Least Squares Problems*, 1996, section 9.3).
pub(crate) fn solve(
    machine: &Machine,
    start: &Sample<'_>,
    unknowns: &[usize],
) -> Result<Settled, Error> {
    solve_to(machine, start, unknowns, SETTLED)
}

/// The same, but for an end at the first step (m, rad) that is shorter than `settled`, or, roughly and with more closures
/// than unknowns, after as many steps as are tried: where closures contradict each other, each step may gain little.
pub(crate) fn solve_to(
    machine: &Machine,
    start: &Sample<'_>,
    unknowns: &[usize],
    settled: f64,
) -> Result<Settled, Error> {
    let mut pose = start.pose;
    let mut commands = start.commands_m.to_vec();
    let mut scratch = Scratch::default();
    let mut at = |closures: &mut Closures, pose: Pose, commands: &[f64]| {
        closures.fill(machine, &there(start, pose, commands), &mut scratch)
    };
    let (mut closures, mut next) = (Closures::default(), Closures::default());
    at(&mut closures, pose, &commands)?;
    let mut mismatch = closures.residuals.norm();
    for iteration in 0..MAX_ITERATIONS {
        let square = closures.jacobian.nrows() == unknowns.len();
        if square && mismatch < ROUNDING_M {
            return Ok(Settled {
                pose,
                commands_m: commands,
                mismatch_m: mismatch,
                closures,
            });
        }
        let is_slow = closures.jacobian.nrows() > unknowns.len() && iteration >= STEPS_BY_TANGENT;
        let bent = is_slow.then(|| {
            bent_step(&closures, unknowns, |step, share| {
                let (pose, commands) = advance(&pose, &commands, unknowns, step, share);
                at(&mut next, pose, &commands).ok()?;
                Some(slope(&next, unknowns))
            })
        });
        let step = bent.flatten().or_else(|| newton_step(&closures, unknowns));
        let step = step.ok_or_else(|| {
            not_converged(
                machine,
                iteration,
                &closures,
                &there(start, pose, &commands),
            )
        })?;
        let longest = step.amax();
        if !longest.is_finite() {
            return Err(not_converged(
                machine,
                iteration,
                &closures,
                &there(start, pose, &commands),
            ));
        }
        // Of more links than hold the plate a rest remains: a step can gain but what it changes to first order.
        let gain = if square {
            mismatch * mismatch
        } else {
            (closures.jacobian.select_columns(unknowns) * &step).norm_squared()
        };
        let mut share = (LONGEST_STEP / longest).min(1.0);
        let moved = loop {
            let (next_pose, next_commands) = advance(&pose, &commands, unknowns, &step, share);
            match at(&mut next, next_pose, &next_commands) {
                Ok(()) => {
                    let norm = next.residuals.norm();
                    let most = mismatch * mismatch - 2.0 * LEAST_FALL * share * gain;
                    if norm * norm < most || norm < ROUNDING_M {
                        (pose, commands) = (next_pose, next_commands);
                        std::mem::swap(&mut closures, &mut next);
                        mismatch = norm;
                        break true;
                    }
                }
                // A step can be too long for a formula, as for a root of what it makes negative.
                Err(Error::NotFinite { .. }) => {}
                Err(error) => return Err(error),
            }
            // At the end of the iteration rounding alone decides whether a full step gains anything.
            if longest * share < settled {
                break false;
            }
            share /= 2.0;
        };
        if !moved || longest < settled {
            let is_solution = !square || mismatch < 1e3 * ROUNDING_M;
            return if is_solution {
                Ok(Settled {
                    pose,
                    commands_m: commands,
                    mismatch_m: mismatch,
                    closures,
                })
            } else {
                Err(not_converged(
                    machine,
                    iteration,
                    &closures,
                    &there(start, pose, &commands),
                ))
            };
        }
    }
    let count = closures.slopes.len() as f64;
    // A closure is the square of a length less that of a distance, by which its slope is twice the distance.
    let is_near = mismatch / count.sqrt() < MOST_MISFIT * closures.slopes.mean() / 2.0;
    if settled > SETTLED && closures.jacobian.nrows() > unknowns.len() && is_near {
        return Ok(Settled {
            pose,
            commands_m: commands,
            mismatch_m: mismatch,
            closures,
        });
    }
    Err(not_converged(
        machine,
        MAX_ITERATIONS,
        &closures,
        &there(start, pose, &commands),
    ))
}

/// A sample with other commands at another pose.
fn there<'a>(sample: &Sample<'a>, pose: Pose, commands_m: &'a [f64]) -> Sample<'a> {
    Sample {
        commands_m,
        ..sample.at(pose)
    }
}

fn not_converged(
    machine: &Machine,
    iterations: usize,
    closures: &Closures,
    at: &Sample<'_>,
) -> Error {
    let span = machine.farthest(closures, at);
    let excess_m = span.as_ref().map(|span| span.length_m - span.distance_m);
    Error::NotConverged {
        iterations,
        closure: span.map_or_else(String::new, |span| span.closure),
        excess_m: excess_m.unwrap_or_default(),
    }
}

fn newton_step(closures: &Closures, unknowns: &[usize]) -> Option<DVector<f64>> {
    let (jacobian, residuals) = (&closures.jacobian, &closures.residuals);
    // A whole pose of as many links, as of most machines, is found without a trip to the heap.
    if jacobian.nrows() == POSE_COLUMNS && unknowns.iter().copied().eq(0..POSE_COLUMNS) {
        let square: Matrix6<f64> = jacobian
            .fixed_view::<POSE_COLUMNS, POSE_COLUMNS>(0, 0)
            .into();
        let step = square.lu().solve(&residuals.fixed_rows::<POSE_COLUMNS>(0));
        if let Some(step) = step.filter(|step| step.iter().all(|value| value.is_finite())) {
            return Some(DVector::from_column_slice((-step).as_slice()));
        }
    }
    let right = DMatrix::from_column_slice(residuals.len(), 1, residuals.as_slice());
    let step = least_norm(&jacobian.select_columns(unknowns), &right)?;
    Some(-step.column(0))
}

/// Derivatives of half the sum of squares by the unknowns.
fn slope(closures: &Closures, unknowns: &[usize]) -> DVector<f64> {
    let jacobian = closures.jacobian.select_columns(unknowns);
    jacobian.tr_mul(&closures.residuals)
}

/// Step to where these derivatives vanish, with their own derivatives by differences of `moved`: those a share of a motion
/// away. `None` where the sum of squares is no bowl.
fn bent_step(
    closures: &Closures,
    unknowns: &[usize],
    mut moved: impl FnMut(&DVector<f64>, f64) -> Option<DVector<f64>>,
) -> Option<DVector<f64>> {
    let count = unknowns.len();
    let mut bends = DMatrix::zeros(count, count);
    for k in 0..count {
        let mut motion = DVector::zeros(count);
        motion[k] = 1.0;
        let change = moved(&motion, BEND)? - moved(&motion, -BEND)?;
        bends.set_column(k, &(change / (2.0 * BEND)));
    }
    let bowl = Cholesky::new((&bends + bends.transpose()) / 2.0)?;
    Some(-bowl.solve(&slope(closures, unknowns)))
}

fn advance(
    pose: &Pose,
    commands: &[f64],
    unknowns: &[usize],
    step: &DVector<f64>,
    share: f64,
) -> (Pose, Vec<f64>) {
    let mut motion = [0.0; POSE_COLUMNS];
    let mut commands = commands.to_vec();
    for (&unknown, change) in unknowns.iter().zip(step.iter()) {
        match unknown.checked_sub(POSE_COLUMNS) {
            None => motion[unknown] = share * change,
            Some(command) => commands[command] += share * change,
        }
    }
    let [x, y, z, a, b, c] = motion;
    (
        pose.moved(Vector3::new(x, y, z), Vector3::new(a, b, c)),
        commands,
    )
}
