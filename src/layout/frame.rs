//! What a frame's kernels are given and leave: views, how samples are shaded, hits.

use super::kernel_type::shared_structs;

shared_structs! {

/// A camera ray's first hit: 8 bytes.
pub struct HitRecord {
    /// Place of the triangle in leaf order, for one of an instance as [`super::Instance`] has it; `u32::MAX` for a miss, [`super::UNTRACED`] where no ray was traced yet.
    pub triangle: u32,
    /// Distance along the normalised ray in metres.
    pub t: f32,
}

/// A view as the kernels see it, relative to the scene's anchor.
pub struct Camera {
    /// Columns of `world_from_eye`'s rotation: right, up, back; each padded to four floats.
    pub rotation: [[f32; 4]; 3],
    /// The eye's position relative to the anchor, rounded.
    pub origin: [f32; 4],
    /// What the rounding of `origin` left out.
    pub origin_low: [f32; 4],
    /// Eye-space direction of the image's upper left corner at z = -1, then its change per pixel.
    pub corner: [f32; 2],
    /// See `corner`: x grows to the right, y falls downwards.
    pub step: [f32; 2],
    /// How far apart its pixels are, across and down: [`crate::math::spacing::Axis::packed`], all 0 where even.
    pub spacing: [[f32; 4]; 2],
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Seed of this frame's random numbers.
    pub seed: u32,
    /// 1: camera rays go through a random point of their pixel instead of its centre.
    pub jitter: u32,
}

/// A law of sample density for a view and a gaze, in single precision: see `src/foveation/density.rs`.
pub struct SampleLaw {
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Pixels across the picture that the view shows.
    pub picture_width: u32,
    /// [`super::LAW_POWER`] and those beside it.
    pub form: u32,
    /// Searches have samples in cells that are two to its power pixels wide.
    pub cell_shift: u32,
    /// Squared distances from the gaze are at least this.
    pub least: f32,
    /// What they are multiplied by before the power.
    pub scale: f32,
    /// The power; for laws of angles the loss of resolution per radian.
    pub power: f32,
    /// What columns begin with: for laws of angles the first direction, behind a lens the distance to its centre.
    pub start: f32,
    /// For laws of angles directions' change per pixel, behind a lens the steps of its table for a squared pixel.
    pub step: f32,
    /// The gaze: a column, behind a lens a point of the panel from its centre, for laws of angles a unit vector.
    pub gaze: [f32; 3],
}

/// How samples are shaded.
pub struct Shading {
    /// Light rays per sample.
    pub rays: u32,
    /// The same of samples whose surfaces were seen in the frame before; as many as of others, where that is not asked.
    pub fewer_rays: u32,
    /// Further bounces.
    pub bounces: u32,
    /// 1: what surfaces send is looked up in the cache of light.
    pub cached: u32,
    /// Of four reflected rays so many look for surfaces there, 1 to 4, and the others for the sky alone.
    pub looking: u32,
    /// The same of samples that are sent fewer rays.
    pub fewer_looking: u32,
    /// 1: [`super::SampleRecord`] for guided reconstruction, 0: for k-NN.
    pub guided: u32,
    /// 1: hits are stored per pixel, 0: per sample.
    pub hits_per_pixel: u32,
    /// Of so many groups of [`super::TURN_SAMPLES`] samples that follow each other one is shaded, the others wait for their
    /// turn; 1: all are shaded.
    pub turns: u32,
    /// Which one of them.
    pub turn: u32,
    /// The same of samples that are sent fewer rays.
    pub turns_in_motion: u32,
    /// Which one of them.
    pub turn_in_motion: u32,
    /// Punctual lights that are all asked; those that are chosen among come after them.
    pub lights: u32,
    /// Environment texels across.
    pub environment_width: u32,
    /// Environment texels down.
    pub environment_height: u32,
    /// Cells of the table of directions across.
    pub directions_width: u32,
    /// Cells of the table of directions down.
    pub directions_height: u32,
    /// Share of the light rays that aim at the sun.
    pub sun_share: f32,
    /// The same of samples that are sent fewer rays.
    pub fewer_sun_share: f32,
    /// Share of the light rays that aim at the environment map; the rest follow the surface's reflection.
    pub environment_share: f32,
    /// What an open sky without its sun brings to a surface, as luminance.
    pub environment_irradiance: f32,
    /// Nodes of the tree over what is aimed at; 0: nothing is.
    pub light_nodes: u32,
    /// Triangles among the emitters, which come first.
    pub emitters: u32,
    /// 1: some surfaces let a part of the light pass, as BLEND and glass do.
    pub translucent: u32,
    /// The sun: direction towards it.
    pub sun_direction: [f32; 3],
    /// The sun's radiance.
    pub sun_radiance: [f32; 3],
    /// 1 - cos of the sun's angular radius.
    pub sun_one_minus_cos: f32,
    /// Nothing beyond this box is in the way of directional lights: lower corner; infinite where there is none.
    pub lit_lower: [f32; 3],
    /// Its upper corner.
    pub lit_upper: [f32; 3],
}
}
