//! An independent tracer and reconstruction in `f64` on the host: the oracle for kernels and pictures.
//!
//! It shares scene types and views with the kernels and nothing else; its sampling is deliberately
//! different from theirs. Positions are relative to [`Scene::anchor`](crate::scene::Scene::anchor).
//! What both sides compute is this definition:
//!
//! - Camera and bounce rays pass through back faces of materials that are not double-sided; occlusion
//!   rays are stopped by both sides. A MASK surface exists where its alpha is at least the cutoff; a
//!   BLEND surface is met with probability alpha, so that it lets `1 - alpha` of the light through.
//! - Back hits of double-sided surfaces reverse the whole normal, normal map included. A shading normal n
//!   whose cosine c with the direction v towards the viewer is below 0.01 is bent towards the viewer:
//!   n + (0.01 - c) v, normalised. Light arrives only from directions above both the geometric surface (on the viewer's side) and the shading normal.
//! - Where the corners' normals describe a surface that is round on the viewer's side, rays leave from as high above the
//!   triangle as that surface is about ([`surface`]), and light arrives from above the interpolated normal: the triangles
//!   of one surface do not shadow each other where it is lit.
//! - The BRDF is glTF 2.0's metallic-roughness model, see [`brdf`], with what extensions add, see [`layers`]. An unlit surface shows its base colour
//!   and nothing else. What is seen through glass is in [`radiance::glass`]. Emission is added at every surface that a camera or bounce ray meets.
//! - Light is the environment map (dimmed by the occlusion texture), the sun's disc and the punctual
//!   lights (neither dimmed), with hard visibility; then up to four further bounces, each of which gathers
//!   the light that other surfaces send, the direct light of those surfaces included.
//! - Camera rays that meet nothing see the map, and the sun where they are inside its disc.

pub mod accumulate;
pub mod brdf;
mod bvh;
pub mod guided;
pub mod intersect;
pub mod known;
pub mod layers;
pub mod light;
pub mod motion;
pub mod radiance;
pub mod random;
pub mod reconstruct;
pub mod resolve;
pub mod surface;
#[cfg(test)]
mod testing;
pub mod texture;
mod validity;

pub use intersect::{Hit, Layer, Ray, Tracer};
pub use radiance::{Estimate, Renderer, camera_ray};
pub use random::Random;
pub use surface::Surface;
pub use texture::TextureMode;
