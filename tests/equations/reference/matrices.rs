//! Rotations and frames of dual numbers.

use nalgebra::{Matrix3, Vector3};
use num_dual::{Dual64, DualNum};

pub(super) type V = Vector3<Dual64>;
pub(super) type M = Matrix3<Dual64>;

/// The rotation about a coordinate axis.
fn about(axis: usize, angle: Dual64) -> M {
    let (sine, cosine) = angle.sin_cos();
    let [i, j] = [1, 2].map(|k| (axis + k) % 3);
    let mut turn = M::identity();
    (turn[(i, i)], turn[(j, j)]) = (cosine, cosine);
    (turn[(j, i)], turn[(i, j)]) = (sine, -sine);
    turn
}

/// Rz(α)·Ry(β)·Rz(γ), of a measured orientation.
pub(super) fn zyz(angles: V) -> M {
    about(2, angles[0]) * about(1, angles[1]) * about(2, angles[2])
}

/// Rz(c)·Ry(b)·Rx(a), of a calibrated orientation.
pub(super) fn zyx(angles: V) -> M {
    about(2, angles[2]) * about(1, angles[1]) * about(0, angles[0])
}

/// The matrix of the quaternion (1, r), normalised, with r half the rotation vector and a part in twelve of its square
/// more.
pub(super) fn rotated(turn: V) -> M {
    let r = turn * ((turn.dot(&turn) / 12.0 + 1.0) * 0.5);
    let w = (r.dot(&r) + 1.0).sqrt().recip();
    let [x, y, z] = (r * w).into();
    let o = Dual64::from(0.0);
    let cross = M::new(o, -z, y, z, o, -x, -y, x, o);
    M::identity() + (cross * w + cross * cross) * Dual64::from(2.0)
}

pub(super) fn mean(vectors: &[V]) -> V {
    vectors.iter().sum::<V>() / Dual64::from(vectors.len() as f64)
}

pub(super) fn norm(v: V) -> Dual64 {
    v.dot(&v).sqrt()
}

pub(super) fn unit(v: V) -> V {
    v / norm(v)
}

/// Columns v̂, ẑ × v̂ normalised (x̂ × v̂ on a steep track), and the third.
pub(super) fn frame(direction: V) -> M {
    let along = unit(direction);
    let is_steep = (along[2] * along[2]).re >= 0.82;
    let up = if is_steep { V::x() } else { V::z() };
    let horizontal = unit(up.cross(&along));
    M::from_columns(&[along, horizontal, along.cross(&horizontal)])
}

/// Least-squares small rotation; for two joints the one without spin about their line.
pub(super) fn implied(offsets: &[V], travels: &[V]) -> V {
    match offsets.len() {
        1 => V::zeros(),
        2 => {
            let (s, d) = (offsets[0] - offsets[1], travels[0] - travels[1]);
            s.cross(&d) / s.dot(&s)
        }
        _ => {
            let (centre, drift) = (mean(offsets), mean(travels));
            let (mut a, mut b) = (M::zeros(), V::zeros());
            for (offset, travel) in offsets.iter().zip(travels) {
                let (s, d) = (offset - centre, travel - drift);
                b += s.cross(&d);
                a += M::identity() * s.dot(&s) - s * s.transpose();
            }
            // Cramer's rule.
            let [x, y, z] = [0, 1, 2].map(|k| a.column(k).into_owned());
            let whole = x.dot(&y.cross(&z));
            V::new(
                b.dot(&y.cross(&z)),
                x.dot(&b.cross(&z)),
                x.dot(&y.cross(&b)),
            ) / whole
        }
    }
}
