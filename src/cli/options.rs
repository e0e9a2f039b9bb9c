//! Flags that every rendering command takes, laid over the configuration.

use std::path::PathBuf;

use glam::{DVec2, DVec3};

use crate::config::{Config, Layers, Method, ReconstructionConfig, Samples, Stereo};
use crate::error::{Error, Result};
use crate::math::pose::Pose;
use crate::math::view::FieldOfView;
use crate::scene::Scene;
use crate::scene::viewpoint::default_viewpoint;

/// Settings from files and `--set`.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Overrides {
    /// Settings from a TOML file like configs/default.toml.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// One setting, such as trace.rays=16. May be given many times.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
    /// OpenCL devices that trace, separated by commas: numbers in `foveate devices`, UUIDs, or parts of names;
    /// all that work by default.
    #[arg(long, visible_alias = "device", value_name = "NAME,...")]
    devices: Option<String>,
}

/// Settings from presets, files and `--set`, frame times to hold, and how results are printed.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ConfigOptions {
    /// Settings that come with the program, measured on several scenes: fast, balanced or accurate.
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
    #[command(flatten)]
    overrides: Overrides,
    /// Hold this frame time: milliseconds, "display" (its period less a margin) or "none". Windows and headsets
    /// hold their display's by default, unless --preset, --samples, --rays or another setting that is traded for
    /// time is given. One picture takes the point of the front that is expected to meet it.
    #[arg(long, value_name = "MS|display|none")]
    target_ms: Option<String>,
    /// Stay at this foveated score, 0 to 10, where the frame time allows it.
    #[arg(long, value_name = "SCORE")]
    target_score: Option<f64>,
    /// Print one JSON object on standard output instead of text.
    #[arg(long)]
    pub json: bool,
}

impl ConfigOptions {
    /// The defaults under a preset under files under assignments.
    pub fn layers(&self, mut layers: Layers) -> Result<Layers> {
        self.preset.iter().try_for_each(|name| layers.preset(name))?;
        let mut layers = self.overrides.layers(layers)?;
        let target_ms = self.target_ms.as_deref().map(number_or_name);
        let target_score = self.target_score.map(toml::Value::Float);
        let flags = [
            ("--target-ms", "budget.target_ms", target_ms),
            ("--target-score", "budget.target_score", target_score),
        ];
        for (flag, key, value) in flags {
            let Some(value) = value else { continue };
            layers.set(key, value).and_then(|()| layers.check()).map_err(|e| renamed(e, flag))?;
        }
        Ok(layers)
    }
}

impl Overrides {
    /// The defaults under files under assignments.
    pub fn layers(&self, mut layers: Layers) -> Result<Layers> {
        self.config.iter().try_for_each(|path| layers.file(path))?;
        self.set.iter().try_for_each(|assignment| layers.assign(assignment))?;
        if let Some(devices) = &self.devices {
            layers.set("devices.opencl", devices.as_str()).map_err(|e| renamed(e, "--devices"))?;
        }
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
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, help_heading = "Picture")]
    position: Option<DVec3>,
    /// What the eye looks at, in the scene's metres.
    #[arg(long, value_name = "X,Y,Z", value_parser = point, allow_hyphen_values = true, help_heading = "Picture")]
    look_at: Option<DVec3>,
    /// Vertical field of view in degrees, 1 to 175.
    #[arg(long, value_name = "DEG", help_heading = "Picture")]
    fov_y: Option<f64>,
    /// One eye, both from one wider view (the paper's way), or both from their own viewpoints.
    #[arg(long, value_enum, help_heading = "Picture")]
    stereo: Option<Stereo>,
    /// Stops by which a displayed picture is brightened, or "auto": by what is seen.
    #[arg(long, value_name = "EV|auto", allow_hyphen_values = true, help_heading = "Picture")]
    exposure: Option<String>,
    /// How sample density falls off: paper, linear-mar, log-polar, uniform, full.
    #[arg(long, value_name = "NAME", help_heading = "Foveation")]
    law: Option<String>,
    /// Shaded samples in each traced view: a number, a share of the pixels such as 0.05, or "full".
    #[arg(long, value_name = "full|N", help_heading = "Foveation")]
    samples: Option<String>,
    /// Where the eye looks, in 0..1 of the picture (with stereo, of one eye's) from its upper left corner;
    /// the centre by default. It may lie outside.
    #[arg(long, value_name = "X,Y", value_parser = gaze, allow_hyphen_values = true, help_heading = "Foveation")]
    gaze: Option<DVec2>,
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

impl RenderOptions {
    /// The effective configuration.
    pub fn config(&self) -> Result<Config> {
        self.config_over(Layers::default())
    }

    /// The same for one picture: a sample at each pixel is shown as it is, unless a reconstruction is asked for.
    pub fn config_for_picture(&self) -> Result<Config> {
        let layers = self.layers(Layers::default())?;
        let mut config = self.finished(&layers)?;
        let reconstructed = ["reconstruction.method", "reconstruction.k"].iter().any(|key| layers.gives(key));
        if config.foveation.samples == Samples::Full && !reconstructed {
            config.reconstruction =
                ReconstructionConfig { method: Method::KNearest, k: 1, ..config.reconstruction };
        }
        Ok(config)
    }

    /// The same over other defaults than the usual ones.
    pub fn config_over(&self, layers: Layers) -> Result<Config> {
        self.finished(&self.layers(layers)?)
    }

    /// The same for a display, and notes: frames keep up with it, unless settings say otherwise.
    pub fn config_for_display(&self, layers: Layers) -> Result<(Config, Vec<String>)> {
        let mut layers = self.layers(layers)?;
        let notes = keep_up(&mut layers);
        Ok((self.finished(&layers)?, notes))
    }

    /// The defaults under everything that was given.
    fn layers(&self, layers: Layers) -> Result<Layers> {
        let mut layers = self.config.layers(layers)?;
        for (flag, key, value) in self.flags()? {
            layers.set(key, value).map_err(|e| renamed(e, flag))?;
        }
        Ok(layers)
    }

    /// What is wrong is named as the operator wrote it.
    fn finished(&self, layers: &Layers) -> Result<Config> {
        let flags = self.flags()?;
        layers.finish().map_err(|error| match &error {
            Error::Setting { key, .. } => match flags.iter().find(|(_, k, _)| k == key) {
                Some((flag, ..)) => renamed(error, flag),
                None => error,
            },
            _ => error,
        })
    }

    /// The flags that were given, with their keys and values.
    fn flags(&self) -> Result<Vec<(&'static str, &'static str, toml::Value)>> {
        let text = |value: &Option<String>| value.clone().map(toml::Value::String);
        let whole = |value: Option<u32>| value.map(|v| toml::Value::Integer(v.into()));
        let float = |value: Option<f64>| value.map(toml::Value::Float);
        let flags = [
            ("--environment", "environment.map", path_value(&self.environment)?),
            ("--width", "view.width", whole(self.width)),
            ("--height", "view.height", whole(self.height)),
            ("--fov-y", "view.fov_y", float(self.fov_y)),
            ("--stereo", "view.stereo", named(self.stereo)),
            ("--exposure", "view.exposure", self.exposure.as_deref().map(number_or_name)),
            ("--law", "foveation.law", text(&self.law)),
            ("--samples", "foveation.samples", self.samples.as_deref().map(count_or_name)),
            ("--reconstruct", "reconstruction.method", named(self.reconstruct)),
            ("--k", "reconstruction.k", whole(self.k)),
            ("--rays", "trace.rays", whole(self.rays)),
            ("--bounces", "trace.bounces", whole(self.bounces)),
            ("--seed", "trace.seed", whole(self.seed)),
        ];
        Ok(flags.into_iter().filter_map(|(flag, key, value)| Some((flag, key, value?))).collect())
    }

    /// Where the eye is and its vertical field of view in radians: from flags, else from the scene.
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

    /// Pixels across and down where flags or settings give them.
    pub fn given_size(&self) -> Result<[Option<u32>; 2]> {
        let layers = self.layers(Layers::default())?;
        let view = self.finished(&layers)?.view;
        let given = |key, value| layers.gives(key).then_some(value);
        Ok([given("view.width", view.width), given("view.height", view.height)])
    }

    /// `--fov-y` in radians.
    pub fn fov_y(&self) -> Option<f64> {
        self.fov_y.map(f64::to_radians)
    }

    /// `--gaze`, in 0..1 of the picture.
    pub fn gaze(&self) -> Option<DVec2> {
        self.gaze
    }
}

/// Has frames keep up with a display and exposed by what is seen, unless settings say otherwise; notes, where these
/// do not say so aloud.
pub fn keep_up(layers: &mut Layers) -> Vec<String> {
    layers.expose();
    let note = |key: &str| {
        format!(
            "{key} is given, so settings stay as they are, however long frames take; --target-ms display holds \
             the display's period instead"
        )
    };
    layers.keep_up().map(note).into_iter().collect()
}

/// The field of view of one eye of a picture.
pub fn eye_fov(fov_y: f64, width: u32, height: u32) -> FieldOfView {
    FieldOfView::symmetric(fov_y, f64::from(width) / f64::from(height))
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
    text.parse().map_or_else(|_| number_or_name(text), toml::Value::Integer)
}

fn number_or_name(text: &str) -> toml::Value {
    text.parse().map_or_else(|_| toml::Value::String(text.to_string()), toml::Value::Float)
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
