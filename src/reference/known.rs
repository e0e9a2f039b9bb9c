//! Which samples are sent fewer rays, in `f64`: what `reuses_light` in `kernels/shared/reuse.h` asks.

use glam::{DVec2, DVec3};

use crate::math::view::View;

/// Part of a lobe's width by which the reflected direction may turn for specular light to be taken for known.
pub const SAME_LOBE: f64 = 0.5;

/// What a sample sees.
#[derive(Clone, Copy, Debug)]
pub struct Sees {
    /// Its pixel.
    pub at: [u32; 2],
    /// View-space depth in metres; 0 where the background is seen.
    pub depth: f64,
    /// Unit normal in world orientation.
    pub normal: DVec3,
    /// Perceptual roughness, 0 to 1.
    pub roughness: f64,
}

/// How clearly a sample's surface was seen in the frame before: at least 0 where it is known, in widths of its pixel that its
/// plane is farther off than one, or parts of what the reflected direction may turn, below. `distance` is how far from its eye a
/// pixel of that frame saw a surface, in metres; `None` where the sample sees none, or that frame saw none there.
pub fn known(
    view: &View,
    before: &View,
    sample: &Sees,
    distance: impl Fn([u32; 2]) -> Option<f64>,
) -> Option<f64> {
    if sample.depth <= 0.0 {
        return None;
    }
    let middle = |at: [u32; 2]| DVec2::new(f64::from(at[0]) + 0.5, f64::from(at[1]) + 0.5);
    let centre = middle(sample.at);
    let (eye, old) = (view.world_from_eye, before.world_from_eye);
    let direction = eye.rotation * view.eye_direction(centre);
    let point = eye.position + direction * sample.depth;
    let pixel = before.project(old.rotation.inverse() * (point - old.position))?;
    let inside =
        pixel.x >= 0.0 && pixel.y >= 0.0 && pixel.x < before.width.into() && pixel.y < before.height.into();
    let seen = inside.then_some([pixel.x as u32, pixel.y as u32])?;
    let was =
        old.position + (old.rotation * before.eye_direction(middle(seen))).normalize() * distance(seen)?;
    let picture = view.picture();
    let across = (picture.fov.right - picture.fov.left) / f64::from(picture.width);
    let [columns, rows] =
        [(view.spacing.columns, centre.x), (view.spacing.rows, centre.y)].map(|(axis, at)| axis.width(at));
    let off = sample.normal.dot(was - point).abs() / (across * (columns * rows).sqrt() * sample.depth);
    let turned = 2.0 * ((point - old.position).normalize() - direction.normalize()).length();
    let lobe = SAME_LOBE * (sample.roughness.powi(2) + 0.01);
    Some((1.0 - off).min(1.0 - turned / lobe))
}
