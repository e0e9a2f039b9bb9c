//! Flags for single settings, in groups: each command takes those that it obeys.

use std::path::PathBuf;

use glam::{DVec2, DVec3};

use super::{count_or_name, number_or_name, renamed};
use crate::config::{Config, Layers, Method, Stereo};
use crate::error::{Error, Result};
use crate::math::pose::Pose;
use crate::scene::Scene;
use crate::scene::viewpoint::default_viewpoint;

/// A flag that was given, its key in the settings and its value.
pub(super) type Flag = (&'static str, &'static str, toml::Value);

/// What of a file is shown.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct SceneFlags {
    /// The camera to look through, by name or by number from 0; `foveate scene info` lists them.
    #[arg(long, value_name = "NAME|N", help_heading = "Scene")]
    camera: Option<String>,
    /// The scene of the file to show, by name or by number from 0.
    #[arg(long = "scene", value_name = "NAME|N", help_heading = "Scene")]
    scene_name: Option<String>,
    /// The variant of the file's materials, by name or by number from 0.
    #[arg(long, value_name = "NAME|N", help_heading = "Scene")]
    variant: Option<String>,
    /// The animations that play: auto (each that moves nothing which an earlier one moves), all, none, or one by name or
    /// by number from 0.
    #[arg(long, value_name = "NAME|N|all|none", help_heading = "Scene")]
    animation: Option<String>,
    /// Seconds for which animations have played; 0 by default.
    #[arg(long, value_name = "SECONDS", allow_hyphen_values = true, help_heading = "Scene")]
    time: Option<f64>,
    /// Metres that a unit of the file is, such as 0.01 for one in centimetres.
    #[arg(long, value_name = "METRES", help_heading = "Scene")]
    scale: Option<f64>,
}

impl SceneFlags {
    pub(super) fn given(&self) -> Vec<Flag> {
        let text = |value: &Option<String>| value.clone().map(toml::Value::String);
        present([
            ("--camera", "scene.camera", text(&self.camera)),
            ("--scene", "scene.name", text(&self.scene_name)),
            ("--variant", "scene.variant", text(&self.variant)),
            ("--animation", "scene.animation", text(&self.animation)),
            ("--time", "scene.time", float(self.time)),
            ("--scale", "scene.scale", float(self.scale)),
        ])
    }

    /// Adds them to settings from files.
    ///
    /// # Errors
    /// That names the flag.
    pub fn lay(&self, layers: &mut Layers) -> Result<()> {
        lay(layers, &self.given(), true)
    }

    /// Refuses those that choose in a file, where there is none.
    ///
    /// # Errors
    /// That names the first flag.
    pub fn refuse(&self, why: &str) -> Result<()> {
        const ANIMATION: [&str; 2] = ["--animation", "--time"];
        let given = self.given();
        let first = given.iter().find(|(flag, ..)| !ANIMATION.contains(flag));
        first.map_or(Ok(()), |(flag, ..)| Err(Error::setting(*flag, why)))
    }
}

/// What is seen from where.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ViewFlags {
    /// Light the scene with a .hdr or .exr latitude-longitude map instead of the sky.
    #[arg(long, value_name = "FILE", help_heading = "Picture")]
    environment: Option<PathBuf>,
    /// Pixels across; with stereo both eyes side by side.
    #[arg(long, help_heading = "Picture")]
    width: Option<u32>,
    /// Pixels down.
    #[arg(long, help_heading = "Picture")]
    height: Option<u32>,
    /// Where the eye is, in the scene's metres.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, help_heading = "Picture")]
    position: Option<DVec3>,
    /// What the eye looks at, in the scene's metres.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, help_heading = "Picture")]
    look_at: Option<DVec3>,
    /// Vertical field of view in degrees, 1 to 175.
    #[arg(long, value_name = "DEG", help_heading = "Picture")]
    fov_y: Option<f64>,
}

impl ViewFlags {
    pub(super) fn given(&self) -> Result<Vec<Flag>> {
        Ok(present([
            ("--environment", "environment.map", path_value(&self.environment)?),
            ("--width", "view.width", whole(self.width)),
            ("--height", "view.height", whole(self.height)),
            ("--fov-y", "view.fov_y", float(self.fov_y)),
        ]))
    }

    /// Where the eye is and its vertical field of view in radians: from flags, else from the scene.
    ///
    /// # Errors
    /// Where it looks at itself.
    pub fn viewpoint(&self, scene: &Scene, config: &Config) -> Result<(Pose, f64)> {
        let default = default_viewpoint(scene, config.view.fov_y);
        let fov_y = self.fov_y().unwrap_or(default.fov_y);
        let eye = self.position.unwrap_or(default.world_from_eye.position);
        let pose = match self.look_at {
            Some(target) if target == eye => {
                return Err(Error::setting("--look-at", "it is where the eye is; give another point"));
            }
            Some(target) => Pose::look_at(eye, target),
            None => Pose::new(default.world_from_eye.rotation, eye),
        };
        Ok((pose, fov_y))
    }

    /// `--fov-y` in radians.
    pub fn fov_y(&self) -> Option<f64> {
        self.fov_y.map(f64::to_radians)
    }

    /// Refuses where the eye is to be, where that is not for flags to say.
    ///
    /// # Errors
    /// That names the flag.
    pub fn refuse_pose(&self, why: &str) -> Result<()> {
        let given = [
            ("--position", self.position.is_some()),
            ("--look-at", self.look_at.is_some()),
            ("--fov-y", self.fov_y.is_some()),
        ];
        given.into_iter().find(|flag| flag.1).map_or(Ok(()), |(flag, _)| Err(Error::setting(flag, why)))
    }
}

/// How many samples there are, and how they lie.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct SampleFlags {
    /// How sample density falls off: paper, linear-mar, log-polar, uniform, full.
    #[arg(long, value_name = "NAME", help_heading = "Foveation")]
    law: Option<String>,
    /// Shaded samples in each traced view: a share of the pixels such as 0.054, a number, or "full".
    #[arg(long, value_name = "full|N", help_heading = "Foveation")]
    samples: Option<String>,
}

impl SampleFlags {
    pub(super) fn given(&self) -> Vec<Flag> {
        present([
            ("--law", "foveation.law", self.law.clone().map(toml::Value::String)),
            ("--samples", "foveation.samples", self.samples.as_deref().map(count_or_name)),
        ])
    }
}

/// Where the eye looks.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct GazeFlag {
    /// Where the eye looks, in 0..1 of the picture (with stereo, of one eye's) from its upper left corner;
    /// the centre by default. It may lie outside.
    #[arg(long, value_name = "X,Y", value_parser = gaze, allow_hyphen_values = true, help_heading = "Foveation")]
    pub gaze: Option<DVec2>,
}

impl GazeFlag {
    /// Refuses it, where it is not for a flag to say.
    ///
    /// # Errors
    /// That names the flag.
    pub fn refuse(&self, why: &str) -> Result<()> {
        self.gaze.map_or(Ok(()), |_| Err(Error::setting("--gaze", why)))
    }
}

/// How pictures are made of samples.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct LightFlags {
    /// One eye, both from one wider view (the paper's way), or both from their own viewpoints.
    #[arg(long, value_enum, help_heading = "Picture")]
    stereo: Option<Stereo>,
    /// Stops by which a displayed picture is brightened, or "auto": by what is seen.
    #[arg(long, value_name = "EV|auto", allow_hyphen_values = true, help_heading = "Picture")]
    exposure: Option<String>,
    /// What is drawn over the picture to show how it is made: gaze, samples, rays, with commas between.
    #[arg(long, value_name = "LIST", help_heading = "Picture")]
    overlay: Option<String>,
    /// How samples become pixels.
    #[arg(long, value_enum, help_heading = "Foveation")]
    reconstruct: Option<Method>,
    /// Nearest samples that each pixel averages, 1 to 16.
    #[arg(long, help_heading = "Foveation")]
    k: Option<u32>,
    /// Light rays per sample, 1 to 4096.
    #[arg(long, help_heading = "Tracing")]
    rays: Option<u32>,
    /// Further bounces of light, 0 to 4.
    #[arg(long, help_heading = "Tracing")]
    bounces: Option<u32>,
    /// Seed of the random numbers: the same one gives the same picture on the same device.
    #[arg(long, help_heading = "Tracing")]
    seed: Option<u32>,
}

impl LightFlags {
    pub(super) fn given(&self) -> Vec<Flag> {
        present([
            ("--stereo", "view.stereo", named(self.stereo)),
            ("--exposure", "view.exposure", self.exposure.as_deref().map(number_or_name)),
            ("--overlay", "view.overlay", self.overlay.as_deref().map(|list| list.into())),
            ("--reconstruct", "reconstruction.method", named(self.reconstruct)),
            ("--k", "reconstruction.k", whole(self.k)),
            ("--rays", "trace.rays", whole(self.rays)),
            ("--bounces", "trace.bounces", whole(self.bounces)),
            ("--seed", "trace.seed", whole(self.seed)),
        ])
    }
}

/// How fast animations play on.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct SpeedFlag {
    /// How many times as fast animations play on; negative: backwards.
    #[arg(long, value_name = "FACTOR", allow_hyphen_values = true, help_heading = "Scene")]
    speed: Option<f64>,
}

impl SpeedFlag {
    /// Settings with that speed, where it is given.
    ///
    /// # Errors
    /// That names the flag.
    pub fn over(&self, mut config: Config) -> Result<Config> {
        if let Some(speed) = self.speed {
            config.scene.speed = speed;
            config.scene.check().map_err(|error| renamed(error, "--speed"))?;
        }
        Ok(config)
    }
}

/// Frame times to hold.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct TargetFlags {
    /// Hold this frame time: milliseconds, "display" (its period less a margin) or "none". Windows and headsets
    /// hold their display's by default, unless --preset, --samples, --rays or another setting that is traded for
    /// time is given. One picture takes the point of the front that is expected to meet it.
    #[arg(long, value_name = "MS|display|none")]
    target_ms: Option<String>,
    /// Stay at this foveated score, 0 to 10, where the frame time allows it.
    #[arg(long, value_name = "SCORE")]
    target_score: Option<f64>,
}

impl TargetFlags {
    pub(super) fn given(&self) -> Vec<Flag> {
        present([
            ("--target-ms", "budget.target_ms", self.target_ms.as_deref().map(number_or_name)),
            ("--target-score", "budget.target_score", float(self.target_score)),
        ])
    }
}

/// Lays flags over settings, and says which one is wrong as it was written.
pub(super) fn lay(layers: &mut Layers, flags: &[Flag], check: bool) -> Result<()> {
    for (flag, key, value) in flags {
        let set = layers.set(key, value.clone());
        let checked = if check { set.and_then(|()| layers.check()) } else { set };
        checked.map_err(|error| renamed(error, flag))?;
    }
    Ok(())
}

fn present<const N: usize>(flags: [(&'static str, &'static str, Option<toml::Value>); N]) -> Vec<Flag> {
    flags.into_iter().filter_map(|(flag, key, value)| Some((flag, key, value?))).collect()
}

fn whole(value: Option<u32>) -> Option<toml::Value> {
    value.map(|value| toml::Value::Integer(value.into()))
}

fn float(value: Option<f64>) -> Option<toml::Value> {
    value.map(toml::Value::Float)
}

fn path_value(path: &Option<PathBuf>) -> Result<Option<toml::Value>> {
    let Some(path) = path else { return Ok(None) };
    match path.to_str() {
        Some(text) => Ok(Some(toml::Value::String(text.to_string()))),
        None => Err(Error::setting("--environment", "its name is not UTF-8; rename the file")),
    }
}

fn named<T: clap::ValueEnum>(value: Option<T>) -> Option<toml::Value> {
    value.and_then(|v| v.to_possible_value()).map(|v| toml::Value::String(v.get_name().to_string()))
}

fn point(text: &str) -> Result<DVec3, String> {
    numbers(text, "three numbers, such as 0,1.6,-2").map(DVec3::from_array)
}

fn gaze(text: &str) -> Result<DVec2, String> {
    numbers(text, "two numbers, such as 0.5,0.5").map(DVec2::from_array)
}

fn numbers<const N: usize>(text: &str, form: &str) -> Result<[f64; N], String> {
    let parts: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    parts.and_then(|parts| <[f64; N]>::try_from(parts).ok()).ok_or_else(|| format!("give {form}"))
}
