//! What is shown of a scene's file, where it offers a choice.

use serde::{Deserialize, Serialize};

use super::check::range;
use crate::error::Result;
use crate::scene::animation::Choice;
use crate::scene::{Instancing, LoadOptions, Progress};

/// A choice among what a scene's file holds; `foveate scene info` lists it. Empty names leave it to the file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SceneConfig {
    /// The scene, by name or by number from 0.
    pub name: String,
    /// The camera that views start from, by name or by number from 0.
    pub camera: String,
    /// The variant of materials, by name or by number from 0.
    pub variant: String,
    /// Which shapes are kept once, with a tree of their own, however often they are placed: "auto" (those placed often, in
    /// scenes of more than four million triangles, and all that move as a whole, where they have more than 40,000), "shared" (all
    /// that are placed more than once or move as a whole), or "flat" (none).
    pub instancing: Instancing,
    /// Metres that a unit of the file is.
    pub scale: f64,
    /// The animations that play: "auto" (each that moves nothing which an earlier one moves), "all", "none", or one by
    /// name or by number from 0.
    pub animation: String,
    /// Seconds for which they have played: in a picture; in the first frame where they play on.
    pub time: f64,
    /// How many times as fast they play on; negative: backwards.
    pub speed: f64,
}

impl Default for SceneConfig {
    fn default() -> Self {
        let empty = String::new;
        SceneConfig {
            name: empty(),
            camera: empty(),
            variant: empty(),
            instancing: Instancing::Auto,
            scale: 1.0,
            animation: "auto".into(),
            time: 0.0,
            speed: 1.0,
        }
    }
}

impl SceneConfig {
    /// # Errors
    /// Where a number is out of its range.
    pub fn check(&self) -> Result<()> {
        range("scene.scale", self.scale, 1e-9, 1e9)?;
        range("scene.time", self.time, -1e9, 1e9)?;
        range("scene.speed", self.speed, -1e3, 1e3)
    }

    /// How a file is loaded with these choices; `progress` is told how far that is.
    pub fn load_options(&self, progress: Progress) -> LoadOptions {
        let given = |name: &String| (!name.is_empty()).then(|| name.clone());
        LoadOptions {
            scene: given(&self.name),
            camera: given(&self.camera),
            variant: given(&self.variant),
            instancing: self.instancing,
            scale: self.scale,
            animation: Choice::new(&self.animation),
            time: self.time,
            progress,
            ..LoadOptions::default()
        }
    }
}
