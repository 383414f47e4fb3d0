//! ZYZ Euler angles.

use std::f64::consts::TAU;

use nalgebra::{Rotation3, UnitQuaternion, Vector3};

/// The rotation Rz(alpha)·Ry(beta)·Rz(gamma).
pub(crate) fn zyz([alpha, beta, gamma]: [f64; 3]) -> Rotation3<f64> {
    let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
    about(Vector3::z_axis(), alpha)
        * about(Vector3::y_axis(), beta)
        * about(Vector3::z_axis(), gamma)
}

/// ZYZ Euler angles (rad) of a rotation, the middle one in [0, π].
///
/// Half their sum and half their difference are angles of the quaternion's parts along and across z, so
/// that none of the rotation is lost near the poles, where the angles themselves mean little.
pub(crate) fn zyz_angles(rotation: &Rotation3<f64>) -> [f64; 3] {
    let q = UnitQuaternion::from_rotation_matrix(rotation);
    let (along, across) = (q.w.hypot(q.k), q.i.hypot(q.j));
    let half_sum = q.k.atan2(q.w);
    // Exactly level, any difference will do: the one that makes the last angle zero.
    let half_difference = if across > 0.0 {
        (-q.i).atan2(q.j)
    } else {
        half_sum
    };
    let wrapped = |angle: f64| angle - TAU * (angle / TAU).round();
    [
        wrapped(half_sum + half_difference),
        2.0 * across.atan2(along),
        wrapped(half_sum - half_difference),
    ]
}

#[cfg(test)]
mod tests {
    use super::super::random::Random;
    use super::*;

    #[test]
    fn euler_angles_lose_nothing_near_the_poles() {
        use std::f64::consts::PI;
        let about = |axis, angle| Rotation3::from_axis_angle(&axis, angle);
        let mut random = Random::new(1, "rotations");
        for exponent in 0..36 {
            for pole in [0.0, PI] {
                let tilt = 10_f64.powf(-0.5 * f64::from(exponent));
                let turned = about(Vector3::z_axis(), random.uniform(-PI, PI));
                let heading = random.uniform(-PI, PI);
                let axis = Vector3::new(heading.cos(), heading.sin(), 0.0);
                let rotation =
                    Rotation3::new(axis * tilt) * about(Vector3::x_axis(), pole) * turned;
                let [alpha, beta, gamma] = zyz_angles(&rotation);
                let again = about(Vector3::z_axis(), alpha)
                    * about(Vector3::y_axis(), beta)
                    * about(Vector3::z_axis(), gamma);
                let off = (again.matrix() - rotation.matrix()).amax();
                assert!(off < 2e-15, "{tilt:e} {pole}: {off:e}");
                assert!((0.0..=PI).contains(&beta));
            }
        }
        let level = zyz_angles(&about(Vector3::z_axis(), 0.7));
        assert!(
            (level[0] - 0.7).abs() < 1e-15 && level[1..] == [0.0, 0.0],
            "{level:?}"
        );
    }
}
