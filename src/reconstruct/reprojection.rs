//! Pictures seen from elsewhere than they were traced from.

use bytemuck::{Pod, Zeroable};
use glam::{DVec2, DVec3};

use super::Overlay;
use super::parameters::{PackedSpacing, Rays, rays};
use crate::math::pose::Pose;
use crate::math::view::View;

/// As `kernels/reconstruct.wgsl` has it.
#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub struct Reprojection {
    rays: Rays,
    offset: [f32; 4],
    x: [f32; 4],
    y: [f32; 4],
    ahead: [f32; 4],
    spacing: PackedSpacing,
    overlay: [f32; 4],
}

impl Reprojection {
    /// From a picture shown at one pose to a view that was traced at another; nothing is moved without one.
    pub fn new(traced: &View, shown_from: Option<Pose>) -> Reprojection {
        let shown = View { world_from_eye: shown_from.unwrap_or(traced.world_from_eye), ..*traced };
        let mut shown_rays = rays(&shown, None);
        let axis = (shown.world_from_eye.rotation * DVec3::NEG_Z).as_vec3();
        (shown_rays.corner[3], shown_rays.across[3], shown_rays.down[3]) = (axis.x, axis.y, axis.z);
        let offset = (shown.world_from_eye.position - traced.world_from_eye.position).as_vec3();
        let [x, y, ahead] = projection(traced).map(|row| row.as_vec3().extend(0.0).to_array());
        let offset = offset.extend(f32::from(u8::from(shown_from.is_some()))).to_array();
        Reprojection {
            rays: shown_rays,
            offset,
            x,
            y,
            ahead,
            spacing: PackedSpacing::of(traced),
            overlay: [0.0; 4],
        }
    }

    /// The same with what is drawn over the picture, for a gaze in 0..1 of it.
    pub fn with(self, traced: &View, (overlay, gaze): (Overlay, DVec2)) -> Reprojection {
        let picture = traced.picture();
        let at = gaze * DVec2::new(f64::from(picture.width), f64::from(picture.height)) - 0.5;
        Reprojection { overlay: [at.x as f32, at.y as f32, f32::from(overlay.bits()), 0.0], ..self }
    }
}

/// Three vectors in world orientation: a point p relative to the eye is seen in [`View::picture`], in pixels, at
/// `(x . p, y . p) / (ahead . p)`, as its [`View::project`] has it.
pub(super) fn projection(view: &View) -> [DVec3; 3] {
    let view = &view.picture();
    let axis = |v: DVec3| view.world_from_eye.rotation * v;
    let ahead = axis(DVec3::NEG_Z);
    let fov = &view.fov;
    let step = DVec2::new(
        f64::from(view.width) / (fov.right - fov.left),
        f64::from(view.height) / (fov.down - fov.up),
    );
    let x = (axis(DVec3::X) - ahead * fov.left) * step.x;
    let y = (axis(DVec3::Y) - ahead * fov.up) * step.y;
    [x, y, ahead]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::view::FieldOfView;

    #[test]
    fn points_are_projected_as_by_the_view() {
        let fov = FieldOfView { left: -1.2, right: 0.9, up: 0.7, down: -1.1 };
        let pose = Pose::look_at(DVec3::new(3.0, 1.0, -2.0), DVec3::new(1.0, 0.5, 4.0));
        let view = View { world_from_eye: pose, fov, width: 640, height: 480, spacing: Default::default() };
        let [x, y, ahead] = projection(&view);
        for pixel in [DVec2::new(0.5, 0.5), DVec2::new(600.0, 100.0), DVec2::new(320.0, 470.0)] {
            let point = pose.rotation * view.eye_direction(pixel) * 3.5;
            let found = DVec2::new(x.dot(point), y.dot(point)) / ahead.dot(point);
            assert!((found - pixel).length() < 1e-9, "{found} {pixel}");
        }
    }

    #[test]
    fn without_a_pose_nothing_is_moved() {
        let fov = FieldOfView::symmetric(1.0, 1.0);
        let view =
            View { world_from_eye: Pose::IDENTITY, fov, width: 8, height: 8, spacing: Default::default() };
        assert_eq!(Reprojection::new(&view, None).offset, [0.0; 4]);
        let moved = Pose { position: DVec3::new(0.1, 0.0, -0.2), ..Pose::IDENTITY };
        let warp = Reprojection::new(&view, Some(moved));
        assert_eq!(warp.offset, [0.1, 0.0, -0.2, 1.0]);
        assert_eq!([warp.rays.corner[3], warp.rays.across[3], warp.rays.down[3]], [0.0, 0.0, -1.0]);
    }
}
