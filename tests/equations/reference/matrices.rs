//! Vectors, matrices and frames of dual numbers.

use num_dual::{Dual64, DualNum};

pub(super) type V = [Dual64; 3];
pub(super) type M = [[Dual64; 3]; 3];

pub(super) fn about_x(angle: Dual64) -> M {
    let (s, c, o, i) = (
        angle.sin(),
        angle.cos(),
        Dual64::from(0.0),
        Dual64::from(1.0),
    );
    [[i, o, o], [o, c, -s], [o, s, c]]
}

pub(super) fn about_y(angle: Dual64) -> M {
    let (s, c, o, i) = (
        angle.sin(),
        angle.cos(),
        Dual64::from(0.0),
        Dual64::from(1.0),
    );
    [[c, o, s], [o, i, o], [-s, o, c]]
}

pub(super) fn about_z(angle: Dual64) -> M {
    let (s, c, o, i) = (
        angle.sin(),
        angle.cos(),
        Dual64::from(0.0),
        Dual64::from(1.0),
    );
    [[c, -s, o], [s, c, o], [o, o, i]]
}

pub(super) fn product(a: &M, b: &M) -> M {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| a[i][0] * b[0][j] + a[i][1] * b[1][j] + a[i][2] * b[2][j]))
}

pub(super) fn transpose(a: &M) -> M {
    [0, 1, 2].map(|i| [0, 1, 2].map(|j| a[j][i]))
}

/// The matrix whose columns are the given vectors.
pub(super) fn columns(vectors: &[V; 3]) -> M {
    transpose(vectors)
}

pub(super) fn apply(a: &M, v: V) -> V {
    [0, 1, 2].map(|i| a[i][0] * v[0] + a[i][1] * v[1] + a[i][2] * v[2])
}

pub(super) fn plus(a: V, b: V) -> V {
    [0, 1, 2].map(|i| a[i] + b[i])
}

pub(super) fn minus(a: V, b: V) -> V {
    [0, 1, 2].map(|i| a[i] - b[i])
}

pub(super) fn dot(a: V, b: V) -> Dual64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(super) fn cross(a: V, b: V) -> V {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}

/// The matrix of the quaternion (1, r), normalised, with r half the rotation vector and a part in twelve of its square
/// more.
pub(super) fn rotated(turn: V) -> M {
    let r = turn.map(|component| component * 0.5 * (dot(turn, turn) / 12.0 + 1.0));
    let w = (dot(r, r) + 1.0).sqrt().recip();
    let [x, y, z] = r.map(|component| component * w);
    [
        [
            (y * y + z * z) * -2.0 + 1.0,
            (x * y - z * w) * 2.0,
            (x * z + y * w) * 2.0,
        ],
        [
            (x * y + z * w) * 2.0,
            (x * x + z * z) * -2.0 + 1.0,
            (y * z - x * w) * 2.0,
        ],
        [
            (x * z - y * w) * 2.0,
            (y * z + x * w) * 2.0,
            (x * x + y * y) * -2.0 + 1.0,
        ],
    ]
}

pub(super) fn mean(vectors: &[V]) -> V {
    [0, 1, 2].map(|i| {
        vectors
            .iter()
            .map(|v| v[i])
            .fold(Dual64::from(0.0), |a, b| a + b)
            / vectors.len() as f64
    })
}

pub(super) fn unit(v: V) -> V {
    let length = dot(v, v).sqrt();
    v.map(|component| component / length)
}

/// v̂, ẑ × v̂ normalised (x̂ × v̂ on a steep track), and the third.
pub(super) fn frame(direction: V) -> [V; 3] {
    let (zero, one) = (Dual64::from(0.0), Dual64::from(1.0));
    let along = unit(direction);
    let steep = (along[2] * along[2]).re >= 0.82;
    let up = if steep {
        [one, zero, zero]
    } else {
        [zero, zero, one]
    };
    let horizontal = unit(cross(up, along));
    [along, horizontal, cross(along, horizontal)]
}

/// Least-squares small rotation by Cramer's rule; for two joints the one without spin about their line.
pub(super) fn implied(offsets: &[V], travels: &[V]) -> V {
    let zero = Dual64::from(0.0);
    match offsets.len() {
        1 => [zero; 3],
        2 => {
            let (s, d) = (minus(offsets[0], offsets[1]), minus(travels[0], travels[1]));
            cross(s, d).map(|component| component / dot(s, s))
        }
        _ => {
            let (centre, drift) = (mean(offsets), mean(travels));
            let mut a = [[zero; 3]; 3];
            let mut b = [zero; 3];
            for (offset, travel) in offsets.iter().zip(travels) {
                let (s, d) = (minus(*offset, centre), minus(*travel, drift));
                b = plus(b, cross(s, d));
                for i in 0..3 {
                    for j in 0..3 {
                        let diagonal = if i == j { dot(s, s) } else { zero };
                        a[i][j] += diagonal - s[i] * s[j];
                    }
                }
            }
            let determinant = |m: &M| dot(m[0], cross(m[1], m[2]));
            let whole = determinant(&a);
            [0, 1, 2].map(|column| {
                let mut replaced = a;
                for row in 0..3 {
                    replaced[row][column] = b[row];
                }
                determinant(&replaced) / whole
            })
        }
    }
}
