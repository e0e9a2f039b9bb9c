//! Motion vectors, the twin of `kernels/motion.wgsl`: how far a surface point has moved between two pictures.

use glam::{DMat4, DVec2, DVec3};

use crate::math::view::View;

/// A picture as it was shown, and the part of it, in its pixels, that an output shows.
#[derive(Clone, Copy, Debug)]
pub struct Shown {
    /// From where; its pixels are those of its [`View::picture`].
    pub view: View,
    /// The output's first pixel.
    pub source: DVec2,
    /// Pixels across and down.
    pub size: DVec2,
}

impl Shown {
    /// Normalised device coordinates, as Vulkan has them, of a point of the scene, or of a direction from the eye.
    fn place(&self, seen: DVec3, nearest: f64, is_far: bool) -> DVec3 {
        let eye = self.view.world_from_eye.rotation.inverse() * seen;
        let ahead = (-eye.z).max(if is_far { 1e-6 } else { nearest });
        let (fov, picture) = (&self.view.fov, self.view.picture());
        let across = (eye.x / ahead - fov.left) / (fov.right - fov.left) * f64::from(picture.width);
        let down = (eye.y / ahead - fov.up) / (fov.down - fov.up) * f64::from(picture.height);
        let at = (DVec2::new(across, down) - self.source) / self.size * 2.0 - 1.0;
        at.extend(if is_far { 0.0 } else { nearest / ahead })
    }
}

/// The motion vector of what a pixel of a traced view sees (its centre at halves), from the last picture to this one.
/// `depth` is 0 where that is infinitely far away; `moved` leads from where a point of the scene is to where it was;
/// depths are 1 at `nearest` metres.
pub fn vector(
    traced: &View,
    pixel: DVec2,
    depth: f64,
    moved: DMat4,
    [last, now]: [&Shown; 2],
    nearest: f64,
) -> DVec3 {
    let seen = traced.world_from_eye.rotation * traced.eye_direction(pixel);
    if depth <= 0.0 {
        return now.place(seen, nearest, true) - last.place(seen, nearest, true);
    }
    let point = traced.world_from_eye.position + seen * depth;
    let of = |picture: &Shown, point: DVec3| {
        picture.place(point - picture.view.world_from_eye.position, nearest, false)
    };
    of(now, point) - of(last, moved.transform_point3(point))
}
