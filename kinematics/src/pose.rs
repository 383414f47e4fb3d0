//! Poses of the plate.

use nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use tau_robot::measurements::TcpPose;

/// Columns of a pose in derivatives: translation, then rotation vector.
pub const POSE_COLUMNS: usize = 6;

/// Position T and rotation R of the TCP frame in the measurement frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pose {
    /// T (m).
    pub position: Vector3<f64>,
    /// R.
    pub rotation: Rotation3<f64>,
}

impl From<&TcpPose> for Pose {
    fn from(measured: &TcpPose) -> Self {
        Self::from_zyz(measured.position_m, measured.angles_rad)
    }
}

impl Pose {
    /// From a position (m) and ZYZ Euler angles alpha, beta, gamma (rad): R = Rz(alpha)·Ry(beta)·Rz(gamma).
    pub fn from_zyz(position_m: [f64; 3], angles_rad: [f64; 3]) -> Self {
        Self {
            position: position_m.into(),
            rotation: zyz(angles_rad),
        }
    }

    /// T (m).
    pub fn position_m(&self) -> [f64; 3] {
        self.position.into()
    }

    /// ZYZ Euler angles of R (rad), beta in [0, π]; gamma is 0 where beta is 0 or π and only the sum or
    /// the difference of the other two is determined. They give R again up to rounding.
    pub fn angles_rad(&self) -> [f64; 3] {
        let r = self.rotation.matrix();
        let sine = r[(0, 2)].hypot(r[(1, 2)]);
        // Near beta = 0 rounding decides on alpha and on gamma, but not on their sum; near π not on
        // their difference. So one of those is found first, and gamma follows from it.
        let (turn, sign) = if r[(2, 2)] >= 0.0 {
            let sum = (r[(1, 0)] - r[(0, 1)]).atan2(r[(0, 0)] + r[(1, 1)]);
            (sum, 1.0)
        } else {
            let difference = -(r[(1, 0)] + r[(0, 1)]).atan2(r[(1, 1)] - r[(0, 0)]);
            (difference, -1.0)
        };
        let alpha = if sine > f64::EPSILON {
            r[(1, 2)].atan2(r[(0, 2)])
        } else {
            turn
        };
        let gamma = wrapped(sign * (turn - alpha));
        [alpha, sine.atan2(r[(2, 2)]), gamma]
    }

    /// Those ZYZ Euler angles of R (rad) that lie nearest to others: of the two triples that describe a
    /// rotation, with whole turns added.
    pub fn angles_near(&self, reference_rad: [f64; 3]) -> [f64; 3] {
        use std::f64::consts::PI;
        let [alpha, beta, gamma] = self.angles_rad();
        [[alpha, beta, gamma], [alpha + PI, -beta, gamma + PI]]
            .map(|angles| {
                let near = |k: usize| reference_rad[k] + wrapped(angles[k] - reference_rad[k]);
                [near(0), near(1), near(2)]
            })
            .into_iter()
            .min_by(|a, b| distance(a, &reference_rad).total_cmp(&distance(b, &reference_rad)))
            .unwrap_or([alpha, beta, gamma])
    }

    /// The rotation vector in the measurement frame (rad) that turns R into another rotation: `log(other·Rᵀ)`, at most half
    /// a turn. Unlike differences of Euler angles it means the same at every R.
    pub fn turn_to(&self, other: &Rotation3<f64>) -> Vector3<f64> {
        // Of small turns the matrix alone would keep half of the digits.
        UnitQuaternion::from_rotation_matrix(&(other * self.rotation.inverse())).scaled_axis()
    }

    /// Moved by a translation (m) and turned by a rotation vector (rad), both in the measurement frame.
    #[must_use]
    pub fn moved(&self, translation: Vector3<f64>, rotation_vector: Vector3<f64>) -> Self {
        Self {
            position: self.position + translation,
            rotation: Rotation3::new(rotation_vector) * self.rotation,
        }
    }
}

/// Rates of the ZYZ Euler angles (alpha, beta, gamma) per rate of the rotation vector in the
/// measurement frame; infinite entries where beta is 0 or π.
pub fn angle_rates([alpha, beta, _]: [f64; 3]) -> Matrix3<f64> {
    let (sa, ca) = alpha.sin_cos();
    let (sb, cb) = beta.sin_cos();
    Matrix3::new(
        -ca * cb / sb,
        -sa * cb / sb,
        1.0, //
        -sa,
        ca,
        0.0, //
        ca / sb,
        sa / sb,
        0.0,
    )
}

/// The rotation Rz(alpha)·Ry(beta)·Rz(gamma).
pub fn zyz([alpha, beta, gamma]: [f64; 3]) -> Rotation3<f64> {
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    about(Vector3::z_axis(), alpha)
        * about(Vector3::y_axis(), beta)
        * about(Vector3::z_axis(), gamma)
}

/// The rotation Rz(c)·Ry(b)·Rx(a) of angles (a, b, c) about x, y and z (rad).
pub fn xyz([a, b, c]: [f64; 3]) -> Rotation3<f64> {
    Rotation3::from_euler_angles(a, b, c)
}

/// The angles (a, b, c) of Rz(c)·Ry(b)·Rx(a) (rad).
pub fn xyz_angles(rotation: &Rotation3<f64>) -> [f64; 3] {
    let (a, b, c) = rotation.euler_angles();
    [a, b, c]
}

/// The rotation nearest to a matrix (Frobenius norm); by singular values, never a reflection.
pub fn nearest_rotation(matrix: Matrix3<f64>) -> Rotation3<f64> {
    let svd = matrix.svd(true, true);
    let (Some(u), Some(v_t)) = (svd.u, svd.v_t) else {
        return Rotation3::identity();
    };
    let mut signs = Matrix3::identity();
    let smallest = svd.singular_values.imin();
    signs[(smallest, smallest)] = (u * v_t).determinant().signum();
    Rotation3::from_matrix_unchecked(u * signs * v_t)
}

/// An angle brought into (−π, π]; one that lies there stays as it is, to the last bit.
fn wrapped(angle: f64) -> f64 {
    use std::f64::consts::TAU;
    angle - TAU * (angle / TAU - 0.5).ceil()
}

fn distance(a: &[f64; 3], b: &[f64; 3]) -> f64 {
    a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rotations all over, and ones that are level or overturned up to a tilt of any size.
    fn rotations() -> impl Iterator<Item = Rotation3<f64>> {
        use std::f64::consts::PI;
        // Steps of the golden ratio spread evenly without any pattern.
        let spread = |k: u32, multiple: f64| {
            let share = (f64::from(k) * multiple * 0.618_033_988_749_895).fract();
            (2.0 * share - 1.0) * PI
        };
        let tilts = (0..40)
            .map(|exponent| 10_f64.powf(-0.5 * f64::from(exponent)))
            .chain([0.0]);
        let nearly = tilts.enumerate().flat_map(move |(k, tilt)| {
            (0..50).flat_map(move |n| {
                let n = 50 * k as u32 + n;
                let heading = spread(n, 1.0);
                let axis = Vector3::new(heading.cos(), heading.sin(), 0.0);
                let level = Rotation3::new(axis * tilt)
                    * Rotation3::from_axis_angle(&Vector3::z_axis(), spread(n, 7.0));
                let over = Rotation3::from_axis_angle(&Vector3::x_axis(), PI);
                [level, level * over]
            })
        });
        let anywhere =
            (0..2000).map(move |k| zyz([spread(k, 1.0), spread(k, 3.0), spread(k, 11.0)]));
        nearly.chain(anywhere)
    }

    #[test]
    fn angles_describe_the_rotation_that_they_were_taken_from() {
        for rotation in rotations() {
            let pose = Pose {
                position: Vector3::zeros(),
                rotation,
            };
            let angles = pose.angles_rad();
            let off = (zyz(angles).matrix() - rotation.matrix()).amax();
            assert!(off < 1e-15, "{angles:?}: {off:e}");
            assert!(
                angles
                    .iter()
                    .all(|angle| angle.abs() <= std::f64::consts::PI)
            );
        }
    }

    #[test]
    fn level_and_overturned_plates_have_no_gamma() {
        let level = Pose::from_zyz([0.0; 3], [0.4, 0.0, 0.3]).angles_rad();
        assert!((level[0] - 0.7).abs() < 1e-15, "{level:?}");
        assert_eq!(level[1..], [0.0, 0.0]);
        let over = Pose::from_zyz([0.0; 3], [0.4, std::f64::consts::PI, 0.3]).angles_rad();
        assert!((over[0] - 0.1).abs() < 1e-15, "{over:?}");
        assert!((over[1] - std::f64::consts::PI).abs() < 1e-15 && over[2] == 0.0);
    }

    #[test]
    fn the_nearest_angles_are_found_across_turns_and_the_other_triple() {
        let pose = Pose::from_zyz([0.0; 3], [3.1, -0.7, -3.1]);
        let near = pose.angles_near([-3.1, -0.7, 3.1]);
        assert!(
            distance(
                &near,
                &[
                    3.1 - std::f64::consts::TAU,
                    -0.7,
                    std::f64::consts::TAU - 3.1
                ]
            ) < 1e-12
        );
    }

    #[test]
    fn the_turn_between_rotations_is_the_one_that_was_made() {
        for rotation in rotations().step_by(7) {
            for exponent in 0..12 {
                let turn = Vector3::new(0.3, -0.5, 0.8) * 10_f64.powi(-exponent);
                let pose = Pose {
                    position: Vector3::zeros(),
                    rotation,
                };
                let found = pose.turn_to(&pose.moved(Vector3::zeros(), turn).rotation);
                assert!((found - turn).norm() < 1e-14, "{found} {turn}");
            }
        }
    }

    #[test]
    fn angle_rates_are_those_of_a_small_turn() {
        let angles = [1.5, 1.8, -1.5];
        let pose = Pose::from_zyz([0.0; 3], angles);
        for axis in 0..3 {
            let mut turn = Vector3::zeros();
            turn[axis] = 1e-6;
            let forward = pose.moved(Vector3::zeros(), turn).angles_near(angles);
            let backward = pose.moved(Vector3::zeros(), -turn).angles_near(angles);
            for k in 0..3 {
                let rate = (forward[k] - backward[k]) / 2e-6;
                assert!((rate - angle_rates(angles)[(k, axis)]).abs() < 1e-8);
            }
        }
    }

    #[test]
    fn a_reflection_is_never_returned() {
        let mirrored = Matrix3::from_diagonal(&Vector3::new(1.0, 2.0, -0.1));
        assert!((nearest_rotation(mirrored).matrix() - Matrix3::identity()).norm() < 1e-12);
    }
}
