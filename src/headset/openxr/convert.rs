//! OpenXR's poses and angles as this crate's.

use glam::{DQuat, DVec3};
use openxr as xr;

use crate::math::pose::Pose;
use crate::math::view::FieldOfView;

/// The pose of a frame, normalised.
pub fn pose(pose: &xr::Posef) -> Pose {
    let (q, p) = (pose.orientation, pose.position);
    let rotation = DQuat::from_xyzw(q.x.into(), q.y.into(), q.z.into(), q.w.into());
    Pose::new(rotation, DVec3::new(p.x.into(), p.y.into(), p.z.into()))
}

/// The same for the runtime.
pub fn posef(pose: Pose) -> xr::Posef {
    let (q, p) = (pose.rotation.as_quat(), pose.position.as_vec3());
    xr::Posef {
        orientation: xr::Quaternionf { x: q.x, y: q.y, z: q.z, w: q.w },
        position: xr::Vector3f { x: p.x, y: p.y, z: p.z },
    }
}

/// A field of view from its four angles; `None` where they span none.
pub fn field_of_view(fov: &xr::Fovf) -> Option<FieldOfView> {
    let tangent = |angle: f32| f64::from(angle).tan();
    let within = [fov.angle_left, fov.angle_right, fov.angle_up, fov.angle_down]
        .iter()
        .all(|angle| angle.abs() < MOST_ANGLE);
    let fov = FieldOfView {
        left: tangent(fov.angle_left),
        right: tangent(fov.angle_right),
        up: tangent(fov.angle_up),
        down: tangent(fov.angle_down),
    };
    (within && fov.right - fov.left > LEAST_SPAN && fov.up - fov.down > LEAST_SPAN).then_some(fov)
}

/// The same for the runtime.
pub fn fovf(fov: &FieldOfView) -> xr::Fovf {
    let angle = |tangent: f64| tangent.atan() as f32;
    xr::Fovf {
        angle_left: angle(fov.left),
        angle_right: angle(fov.right),
        angle_up: angle(fov.up),
        angle_down: angle(fov.down),
    }
}

/// Radians from the axis that a flat picture still reaches: 89 degrees.
const MOST_ANGLE: f32 = 1.553;
/// Least width and height of a view at a distance of 1.
const LEAST_SPAN: f64 = 1e-4;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_of_view_and_poses_come_back() {
        let there = xr::Fovf { angle_left: -0.9, angle_right: 0.7, angle_up: 0.8, angle_down: -0.95 };
        let fov = field_of_view(&there).unwrap();
        let back = fovf(&fov);
        assert!((fov.left - f64::tan(-0.9)).abs() < 1e-6);
        assert!((back.angle_left + 0.9).abs() < 1e-6 && (back.angle_down + 0.95).abs() < 1e-6);
        let pose_there = Pose::new(DQuat::from_rotation_y(0.3), DVec3::new(1.0, 2.0, -3.0));
        let again = pose(&posef(pose_there));
        assert!(again.rotation.angle_between(pose_there.rotation) < 1e-3);
        assert!((again.position - pose_there.position).length() < 1e-6);
    }

    #[test]
    fn views_without_extent_are_none() {
        let fov = xr::Fovf { angle_left: -0.5, angle_right: 0.5, angle_up: 0.5, angle_down: -0.5 };
        assert!(field_of_view(&fov).is_some());
        assert!(field_of_view(&xr::Fovf { angle_right: -0.5, ..fov }).is_none());
        assert!(field_of_view(&xr::Fovf { angle_up: f32::NAN, ..fov }).is_none());
        assert!(field_of_view(&xr::Fovf { angle_left: -1.6, ..fov }).is_none());
        assert!(field_of_view(&xr::Fovf::default()).is_none());
    }
}
