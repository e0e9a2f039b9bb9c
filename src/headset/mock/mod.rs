//! A headset that is not there: poses and gazes by formula, pictures into files.

mod animation;
mod headset;
mod preview;
pub mod profile;
pub mod script;
pub mod sink;

pub use headset::{MockHands, MockHeadset};
pub use profile::Profile;
pub use script::Script;
pub use sink::{Files, PictureSink};
