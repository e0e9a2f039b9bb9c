//! Flags that every rendering command takes, laid over the configuration.

use std::path::PathBuf;

use glam::{DVec2, DVec3};

use crate::config::{Config, Layers, Method, Samples, Stereo};
use crate::error::{Error, Result};
use crate::math::pose::Pose;
use crate::math::view::FieldOfView;
use crate::scene::Scene;
use crate::scene::viewpoint::default_viewpoint;

/// Settings from files and `--set`.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ConfigOptions {
    /// Settings from a TOML file like configs/default.toml.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// One setting, such as trace.rays=16. May be given many times.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// Print one JSON object on standard output instead of text.
    #[arg(long)]
    pub json: bool,
}

impl ConfigOptions {
    /// The defaults under files under assignments.
    pub fn layers(&self, mut layers: Layers) -> Result<Layers> {
        self.config.iter().try_for_each(|path| layers.file(path))?;
        self.set.iter().try_for_each(|assignment| layers.assign(assignment))?;
        Ok(layers)
    }
}

/// What a picture shows and how it is made.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct RenderOptions {
    #[command(flatten)]
    pub config: ConfigOptions,
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
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, help_heading = "Picture")]
    position: Option<String>,
    /// What the eye looks at, in the scene's metres.
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, help_heading = "Picture")]
    look_at: Option<String>,
    /// Vertical field of view in degrees.
    #[arg(long, value_name = "DEG", help_heading = "Picture")]
    fov_y: Option<f64>,
    /// One eye, both from one wider view (the paper's way), or both from their own viewpoints.
    #[arg(long, value_enum, help_heading = "Picture")]
    stereo: Option<Stereo>,
    /// Stops by which a displayed picture is brightened.
    #[arg(long, value_name = "EV", allow_hyphen_values = true, help_heading = "Picture")]
    exposure: Option<f64>,
    /// How sample density falls off: paper, linear-mar, log-polar, uniform, full.
    #[arg(long, value_name = "NAME", help_heading = "Foveation")]
    law: Option<String>,
    /// Shaded samples in each traced view, or "full": one at each pixel.
    #[arg(long, value_name = "full|N", help_heading = "Foveation")]
    samples: Option<String>,
    /// Where the eye looks, in 0..1 of the picture from its upper left corner.
    #[arg(long, value_name = "X,Y", allow_hyphen_values = true, help_heading = "Foveation")]
    gaze: Option<String>,
    /// How samples become pixels.
    #[arg(long, value_enum, help_heading = "Foveation")]
    reconstruct: Option<Method>,
    /// Nearest samples that each pixel averages.
    #[arg(long, help_heading = "Foveation")]
    k: Option<u32>,
    /// Light rays per sample.
    #[arg(long, help_heading = "Tracing")]
    rays: Option<u32>,
    /// Further bounces of light, 0 to 4.
    #[arg(long, help_heading = "Tracing")]
    bounces: Option<u32>,
    /// Seed of the random numbers.
    #[arg(long, help_heading = "Tracing")]
    seed: Option<u32>,
    /// OpenCL device that traces: its number in `foveate devices`, or a part of its name.
    #[arg(long, value_name = "NAME", help_heading = "Tracing")]
    device: Option<String>,
}

impl RenderOptions {
    /// The effective configuration.
    pub fn config(&self) -> Result<Config> {
        self.config_over(Layers::default())
    }

    /// The same over other defaults than the usual ones.
    pub fn config_over(&self, layers: Layers) -> Result<Config> {
        let mut layers = self.config.layers(layers)?;
        let mut flag = |name: &str, key: &str, value: Option<toml::Value>| match value {
            Some(value) => layers.set(key, value).map_err(|e| renamed(e, name)),
            None => Ok(()),
        };
        let text = |value: &Option<String>| value.clone().map(toml::Value::String);
        let whole = |value: Option<u32>| value.map(|v| toml::Value::Integer(v.into()));
        let float = |value: Option<f64>| value.map(toml::Value::Float);
        flag("--environment", "environment.map", path_value(&self.environment)?)?;
        flag("--width", "view.width", whole(self.width))?;
        flag("--height", "view.height", whole(self.height))?;
        flag("--fov-y", "view.fov_y", float(self.fov_y))?;
        flag("--stereo", "view.stereo", named(self.stereo))?;
        flag("--exposure", "view.exposure", float(self.exposure))?;
        flag("--law", "foveation.law", text(&self.law))?;
        flag("--samples", "foveation.samples", self.samples.as_deref().map(count_or_name))?;
        flag("--reconstruct", "reconstruction.method", named(self.reconstruct))?;
        flag("--k", "reconstruction.k", whole(self.k))?;
        flag("--rays", "trace.rays", whole(self.rays))?;
        flag("--bounces", "trace.bounces", whole(self.bounces))?;
        flag("--seed", "trace.seed", whole(self.seed))?;
        flag("--device", "devices.opencl", text(&self.device))?;
        let config = layers.finish()?;
        check_samples(&config)?;
        Ok(config)
    }

    /// Where the eye is and its vertical field of view in radians: from flags, else from the scene.
    pub fn viewpoint(&self, scene: &Scene, config: &Config) -> Result<(Pose, f64)> {
        let default = default_viewpoint(scene, config.view.fov_y);
        let position = self.position.as_deref().map(|t| vector("--position", t)).transpose()?;
        let target = self.look_at.as_deref().map(|t| vector("--look-at", t)).transpose()?;
        let fov_y = if self.fov_y.is_some() { config.view.fov_y.to_radians() } else { default.fov_y };
        let eye = position.unwrap_or(default.world_from_eye.position);
        let pose = match target {
            Some(target) if target == eye => {
                return Err(Error::setting("--look-at", "it is where the eye is; give another point"));
            }
            Some(target) => Pose::look_at(eye, target),
            None => Pose::new(default.world_from_eye.rotation, eye),
        };
        Ok((pose, fov_y))
    }

    /// The gaze from `--gaze`, in 0..1 of the picture.
    pub fn gaze(&self) -> Result<Option<DVec2>> {
        let Some(text) = &self.gaze else { return Ok(None) };
        let [x, y] = numbers("--gaze", text, "two numbers, such as 0.5,0.5")?;
        Ok(Some(DVec2::new(x, y)))
    }
}

/// The field of view of one eye of a picture.
pub fn eye_fov(fov_y: f64, width: u32, height: u32) -> FieldOfView {
    FieldOfView::symmetric(fov_y, f64::from(width) / f64::from(height))
}

/// Memory for samples is reserved before anything is traced, so absurd numbers are refused first.
fn check_samples(config: &Config) -> Result<()> {
    let pixels = config.view.width as usize * config.view.height as usize;
    match config.foveation.samples {
        Samples::Count(count) if count > pixels => Err(Error::setting(
            "--samples",
            format!("{count} are more than the {pixels} pixels; give at most that, or full"),
        )),
        _ => Ok(()),
    }
}

fn renamed(error: Error, flag: &str) -> Error {
    match error {
        Error::Setting { problem, .. } => Error::setting(flag, problem),
        other => other,
    }
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

fn count_or_name(text: &str) -> toml::Value {
    text.parse().map_or_else(|_| toml::Value::String(text.to_string()), toml::Value::Integer)
}

fn vector(flag: &str, text: &str) -> Result<DVec3> {
    numbers(flag, text, "three numbers, such as 0,1.6,-2").map(DVec3::from_array)
}

fn numbers<const N: usize>(flag: &str, text: &str, form: &str) -> Result<[f64; N]> {
    let parts: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|v: &f64| v.is_finite())).collect();
    parts
        .and_then(|parts| <[f64; N]>::try_from(parts).ok())
        .ok_or_else(|| Error::setting(flag, format!("{text:?} is not {form}")))
}
