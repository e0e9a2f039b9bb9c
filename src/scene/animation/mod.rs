//! What moves in a scene: curves over time, clips of them, and the nodes that they turn.
//!
//! Everything is evaluated in `f64`; times are seconds from a clip's beginning, angles are in quaternions.

mod clip;
mod curve;
mod motion;
mod movers;
mod paint;
mod part;
mod rigid;
mod skeleton;

pub use clip::{Channel, Choice, Clip, ClipInfo, Property, choose};
pub use curve::{Curve, Interpolation};
pub use motion::{Instant, Motion, MovingLight, PlacedGlow};
pub use movers::Movers;
pub use paint::{Made, MovingMaterial, PLACED_TEXTURES, Paint, UvTransform};
pub use part::{Geometry, Part, Skin, Target, Vertices, blended};
pub use rigid::Rigid;
pub use skeleton::{Glow, Local, Pose, Skeleton, orientation};
