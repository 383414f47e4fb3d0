//! Work on a block of samples at a time, with the widest instruction set of the machine.
//!
//! Systems stand by columns: derivatives of all closures by each unknown, then the closures.

use tau_runtime::{Kernel, Lanes};

use crate::pose::POSE_COLUMNS;

/// Divides the rows of systems by the lengths of their gradients by translation; norms of the right-hand sides.
pub(super) struct Scale {
    pub(super) rows: usize,
    pub(super) shifts: usize,
}

impl Kernel for Scale {
    #[inline(always)]
    fn run(self, _: &[Lanes], _: &[f64], system: &mut [Lanes], norms: &mut [Lanes]) {
        let Self { rows, shifts } = self;
        let [norms] = norms else { return };
        for row in 0..rows {
            let mut scale = Lanes::ZERO;
            for entry in system[..shifts * rows].iter().skip(row).step_by(rows) {
                each(&mut scale, |lane, sum| *sum += entry[lane] * entry[lane]);
            }
            each(&mut scale, |_, square| {
                let slope = square.sqrt();
                *square = if slope > 0.0 { 1.0 / slope } else { 1.0 };
            });
            for entry in system.iter_mut().skip(row).step_by(rows) {
                each(entry, |lane, value| *value *= scale[lane]);
            }
            let last = system[system.len() - rows + row];
            each(norms, |lane, sum| *sum += last[lane] * last[lane]);
        }
        each(norms, |_, norm| *norm = norm.sqrt());
    }
}

/// Least-squares solutions of systems by orthogonal columns (modified Gram-Schmidt: Å. Björck, Numerical Methods for
/// Least Squares Problems, 1996, section 2.4), each with its longest part: infinite where one is no number.
pub(super) struct Step {
    pub(super) rows: usize,
    /// Unknowns, those from `shifts` on turns.
    pub(super) width: usize,
    pub(super) shifts: usize,
}

impl Step {
    /// Numbers of the factors: orthogonal columns, triangle, sum of squares of the levers.
    pub(super) fn room(rows: usize, width: usize) -> usize {
        (rows + width) * (width + 1) + 1
    }
}

impl Kernel for Step {
    #[inline(always)]
    fn run(self, system: &[Lanes], _: &[f64], step: &mut [Lanes], factors: &mut [Lanes]) {
        let Self {
            rows,
            width,
            shifts,
        } = self;
        let (columns, factors) = factors.split_at_mut(system.len());
        let (triangle, lever) = factors.split_at_mut(width * (width + 1));
        columns.copy_from_slice(system);
        let mut levers = Lanes::ZERO;
        for entry in &system[shifts * rows..width * rows] {
            each(&mut levers, |lane, sum| *sum += entry[lane] * entry[lane]);
        }
        lever.fill(levers);
        for k in 0..width {
            let (done, later) = columns.split_at_mut((k + 1) * rows);
            let own = &mut done[k * rows..];
            let mut size = Lanes::ZERO;
            for entry in own.iter() {
                each(&mut size, |lane, sum| *sum += entry[lane] * entry[lane]);
            }
            each(&mut size, |_, size| *size = 1.0 / size.sqrt());
            for entry in own.iter_mut() {
                each(entry, |lane, value| *value *= size[lane]);
            }
            // The reciprocal of the diagonal is what is needed.
            triangle[k * (width + 1) + k] = size;
            for (j, other) in later.chunks_exact_mut(rows).enumerate() {
                let mut share = Lanes::ZERO;
                for (own, other) in own.iter().zip(other.iter()) {
                    each(&mut share, |lane, sum| *sum += own[lane] * other[lane]);
                }
                for (own, other) in own.iter().zip(other.iter_mut()) {
                    each(other, |lane, value| *value -= share[lane] * own[lane]);
                }
                triangle[k * (width + 1) + k + 1 + j] = share;
            }
        }
        // The last column of the triangle is the right-hand side.
        substitute(triangle, width, width, step);
        let (mut longest, mut sum) = (Lanes::ZERO, Lanes::ZERO);
        for part in &step[..width] {
            each(&mut longest, |lane, longest| {
                let size = part[lane].abs();
                *longest = if size > *longest { size } else { *longest };
            });
            // Unlike a maximum, a sum keeps what is no number.
            each(&mut sum, |lane, sum| *sum += part[lane].abs());
        }
        each(&mut longest, |lane, longest| {
            *longest = if sum[lane] < f64::INFINITY {
                *longest
            } else {
                f64::INFINITY
            };
        });
        step[width] = longest;
    }
}

/// Norms of the inverses of the systems that [`Step`] left factors of, turns scaled by the mean square of their levers.
pub(super) struct InverseNorm {
    pub(super) rows: usize,
    pub(super) width: usize,
    pub(super) shifts: usize,
}

impl Kernel for InverseNorm {
    #[inline(always)]
    fn run(self, factors: &[Lanes], _: &[f64], inverse: &mut [Lanes], norms: &mut [Lanes]) {
        let Self {
            rows,
            width,
            shifts,
        } = self;
        let [norms] = norms else { return };
        let factors = &factors[rows * (width + 1)..];
        let (triangle, lever) = factors.split_at(width * (width + 1));
        let mut lever = lever[0];
        each(&mut lever, |_, lever| {
            *lever = if *lever > 0.0 {
                *lever / rows as f64
            } else {
                1.0
            };
        });
        for column in 0..width {
            substitute(triangle, width, column, inverse);
            for (k, value) in inverse[..=column].iter().enumerate() {
                each(norms, |lane, sum| {
                    let scale = if k < shifts { 1.0 } else { lever[lane] };
                    *sum += value[lane] * value[lane] * scale;
                });
            }
        }
        each(norms, |_, norm| *norm = norm.sqrt());
    }
}

/// Solves triangles that hold the reciprocals of their diagonals: for a column of the unit matrix, or, with `column` =
/// `width`, for the right-hand sides, which are their last columns.
#[inline(always)]
fn substitute(triangle: &[Lanes], width: usize, column: usize, solution: &mut [Lanes]) {
    let top = column.min(width - 1);
    for k in (0..=top).rev() {
        let row = &triangle[k * (width + 1)..][..=width];
        let mut value = match (column == width, column == k) {
            (true, _) => row[width],
            (_, true) => Lanes::splat(1.0),
            _ => Lanes::ZERO,
        };
        for (of_row, known) in row[k + 1..=top].iter().zip(&solution[k + 1..]) {
            each(&mut value, |lane, value| {
                *value -= of_row[lane] * known[lane];
            });
        }
        each(&mut value, |lane, value| *value *= row[k][lane]);
        solution[k] = value;
    }
}

/// Moves poses (position, then rotation matrix by rows) by shares of a step in some unknowns; by none where the share is
/// zero, whatever the step.
///
/// A rotation matrix is turned by Rodrigues parameters tan(ω/2) of the rotation vector ω (rad), of which the series is
/// taken to the third power: the matrix stays orthogonal to rounding, and the angle is off by ω⁵/120, which the next step
/// makes up for.
pub(super) struct Advance<'a> {
    /// Columns of the closures' Jacobian, one per part of the step.
    pub(super) unknowns: &'a [usize],
}

impl Kernel for Advance<'_> {
    #[inline(always)]
    fn run(self, step: &[Lanes], _: &[f64], pose: &mut [Lanes], shares: &mut [Lanes]) {
        let [shares] = shares else { return };
        let mut motion = [Lanes::ZERO; POSE_COLUMNS];
        for (&unknown, step) in self.unknowns.iter().zip(step) {
            each(&mut motion[unknown], |lane, to| {
                let share = shares[lane];
                *to = if share > 0.0 {
                    -share * step[lane]
                } else {
                    0.0
                };
            });
        }
        let [shift @ .., x, y, z] = motion;
        let (position, rotation) = pose.split_at_mut(3);
        for (position, shift) in position.iter_mut().zip(shift) {
            each(position, |lane, to| *to += shift[lane]);
        }
        let mut turn = [x, y, z];
        let mut scale = square(&turn);
        let mut factor = Lanes::ZERO;
        each(&mut factor, |lane, factor| {
            *factor = 0.5 + scale[lane] / 24.0;
        });
        for component in &mut turn {
            each(component, |lane, value| *value *= factor[lane]);
        }
        let parameters = square(&turn);
        each(&mut scale, |lane, scale| {
            *scale = 2.0 / (1.0 + parameters[lane]);
        });
        for column in 0..3 {
            let rows = [column, 3 + column, 6 + column];
            let first = cross(&turn, &rows.map(|row| rotation[row]));
            let second = cross(&turn, &first);
            for (row, (first, second)) in rows.into_iter().zip(first.iter().zip(&second)) {
                each(&mut rotation[row], |lane, value| {
                    *value += scale[lane] * (first[lane] + second[lane]);
                });
            }
        }
    }
}

#[inline(always)]
fn each(lanes: &mut Lanes, of_lane: impl Fn(usize, &mut f64)) {
    for (lane, value) in lanes.0.iter_mut().enumerate() {
        of_lane(lane, value);
    }
}

#[inline(always)]
fn square([x, y, z]: &[Lanes; 3]) -> Lanes {
    let mut square = Lanes::ZERO;
    each(&mut square, |lane, square| {
        *square = x[lane] * x[lane] + y[lane] * y[lane] + z[lane] * z[lane];
    });
    square
}

#[inline(always)]
fn cross(a: &[Lanes; 3], b: &[Lanes; 3]) -> [Lanes; 3] {
    [(1, 2), (2, 0), (0, 1)].map(|(i, j)| {
        let mut component = Lanes::ZERO;
        each(&mut component, |lane, value| {
            *value = a[i][lane] * b[j][lane] - a[j][lane] * b[i][lane];
        });
        component
    })
}
