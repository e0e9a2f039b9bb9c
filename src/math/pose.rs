//! Rigid transforms in double precision.

use glam::{DQuat, DVec3};

/// A rigid transform `a_from_b`: where frame b lies in frame a.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// Orientation; a unit quaternion.
    pub rotation: DQuat,
    /// Position in metres.
    pub position: DVec3,
}

impl Pose {
    /// The frame itself.
    pub const IDENTITY: Pose = Pose { rotation: DQuat::IDENTITY, position: DVec3::ZERO };

    /// A pose from a rotation that is nearly a unit quaternion and a position.
    ///
    /// Trackers send quaternions that are not quite unit; this normalises. A quaternion of length
    /// zero or with a value that is not finite becomes the identity, a position that is not finite
    /// the origin.
    pub fn new(rotation: DQuat, position: DVec3) -> Self {
        let length = rotation.length();
        let rotation =
            if length.is_finite() && length > 1e-12 { rotation * (1.0 / length) } else { DQuat::IDENTITY };
        let position = if position.is_finite() { position } else { DVec3::ZERO };
        Pose { rotation, position }
    }

    /// The pose of a camera at `eye` that looks at `target`, with +Y up as far as possible.
    pub fn look_at(eye: DVec3, target: DVec3) -> Self {
        let forward = (target - eye).try_normalize().unwrap_or(DVec3::NEG_Z);
        let up = if forward.y.abs() > 0.999_999 { DVec3::NEG_Z * forward.y.signum() } else { DVec3::Y };
        let right = forward.cross(up).normalize();
        let matrix = glam::DMat3::from_cols(right, right.cross(forward), -forward);
        Pose::new(DQuat::from_mat3(&matrix), eye)
    }

    /// `a_from_b * b_from_c` is `a_from_c`.
    pub fn then(self, b_from_c: Pose) -> Pose {
        Pose {
            rotation: (self.rotation * b_from_c.rotation).normalize(),
            position: self.position + self.rotation * b_from_c.position,
        }
    }

    /// `b_from_a`.
    pub fn inverse(self) -> Pose {
        let rotation = self.rotation.conjugate();
        Pose { rotation, position: -(rotation * self.position) }
    }

    /// Takes a point of frame b to frame a.
    pub fn transform_point(self, point: DVec3) -> DVec3 {
        self.position + self.rotation * point
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn look_at_points_minus_z_at_the_target() {
        for target in [DVec3::new(3.0, 1.0, -2.0), DVec3::Y * 5.0, DVec3::NEG_Y, DVec3::X] {
            let pose = Pose::look_at(DVec3::ZERO, target);
            let forward = pose.rotation * DVec3::NEG_Z;
            assert!(forward.dot(target.normalize()) > 1.0 - 1e-12, "{target}: {forward}");
        }
    }

    #[test]
    fn inverse_undoes() {
        let pose = Pose::new(DQuat::from_xyzw(0.1, 0.2, 0.3, 0.9), DVec3::new(1.0, 2.0, 3.0));
        let point = DVec3::new(-4.0, 5.0, 6.0);
        let back = pose.inverse().transform_point(pose.transform_point(point));
        assert!((back - point).length() < 1e-12);
    }

    #[test]
    fn bad_quaternions_become_the_identity() {
        assert_eq!(Pose::new(DQuat::from_xyzw(0.0, 0.0, 0.0, 0.0), DVec3::ZERO).rotation, DQuat::IDENTITY);
        assert_eq!(Pose::new(DQuat::from_xyzw(f64::NAN, 0.0, 0.0, 1.0), DVec3::NAN), Pose::IDENTITY);
    }
}
