//! The light from infinitely far: a latitude-longitude map, and a sun apart from it.

use glam::Vec3;

/// Distant light. Directions map to the picture as in most HDR collections: the top row is +Y, the
/// centre column is -Z, and u grows to the right as seen from inside:
/// `u = 0.5 + atan2(d.x, -d.z) / 2π`, `v = acos(d.y) / π`.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Linear radiance, rows from the top; finite and not negative.
    pub texels: Vec<Vec3>,
    /// A sun, when it is not part of the map.
    pub sun: Option<Sun>,
}

/// A disc of constant radiance infinitely far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit direction towards its centre.
    pub direction: Vec3,
    /// Cosine of its angular radius.
    pub cos_radius: f32,
    /// Radiance of the disc.
    pub radiance: Vec3,
}
