//! A view as kernels see it.

use super::Settings;
use crate::layout;
use crate::math::view::View;

/// A view as kernels see it. The eye's position is split in two floats, so that a head far from the
/// anchor still moves smoothly.
pub fn camera(view: &View, anchor: glam::DVec3, settings: &Settings) -> layout::Camera {
    let rotation = glam::DMat3::from_quat(view.world_from_eye.rotation);
    let eye = view.world_from_eye.position - anchor;
    let high = eye.as_vec3();
    let low = (eye - high.as_dvec3()).as_vec3();
    let picture = view.picture();
    let corner = picture.eye_direction(glam::DVec2::ZERO);
    let far = picture.eye_direction(glam::DVec2::new(f64::from(picture.width), f64::from(picture.height)));
    let pad = |v: glam::Vec3| [v.x, v.y, v.z, 0.0];
    layout::Camera {
        rotation: [rotation.x_axis, rotation.y_axis, rotation.z_axis].map(|axis| pad(axis.as_vec3())),
        origin: pad(high),
        origin_low: pad(low),
        corner: [corner.x as f32, corner.y as f32],
        step: [
            ((far.x - corner.x) / f64::from(picture.width)) as f32,
            ((far.y - corner.y) / f64::from(picture.height)) as f32,
        ],
        spacing: [view.spacing.columns.packed(0.0), view.spacing.rows.packed(0.0)],
        width: view.width,
        height: view.height,
        seed: settings.seed,
        jitter: u32::from(settings.jitter),
    }
}
