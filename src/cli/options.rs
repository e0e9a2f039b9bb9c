//! Flags that commands share, laid over the configuration. Each command takes what it obeys and nothing else.

mod flags;

use std::path::PathBuf;

use crate::config::{Config, Layers, Method, ReconstructionConfig, Samples};
use crate::error::{Error, Result};
use crate::math::view::FieldOfView;

use flags::{Flag, lay};
pub use flags::{GazeFlag, LightFlags, SampleFlags, SceneFlags, SpeedFlag, TargetFlags, ViewFlags};

/// Settings from files and `--set`.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct Overrides {
    /// Settings from a TOML file like configs/default.toml.
    #[arg(long, value_name = "FILE")]
    config: Vec<PathBuf>,
    /// One setting, such as trace.rays=16. May be given many times.
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

impl Overrides {
    /// The defaults under files under assignments.
    ///
    /// # Errors
    /// That names the file or the key.
    pub fn layers(&self, mut layers: Layers) -> Result<Layers> {
        self.config.iter().try_for_each(|path| layers.file(path))?;
        self.set.iter().try_for_each(|assignment| layers.assign(assignment))?;
        Ok(layers)
    }
}

/// Settings from files and `--set`, devices, and how results are printed.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct ConfigOptions {
    #[command(flatten)]
    overrides: Overrides,
    /// OpenCL devices that trace, separated by commas: numbers in `foveate devices`, UUIDs, or parts of names;
    /// all that work by default.
    #[arg(long, visible_alias = "device", value_name = "NAME,...")]
    devices: Option<String>,
    /// Print one JSON object on standard output instead of text, and errors as one on standard error.
    #[arg(long)]
    pub json: bool,
}

impl ConfigOptions {
    /// The defaults under files under assignments.
    ///
    /// # Errors
    /// That names the file, the key or the flag.
    pub fn layers(&self, layers: Layers) -> Result<Layers> {
        let mut layers = self.overrides.layers(layers)?;
        if let Some(devices) = &self.devices {
            if devices.split(',').all(|name| name.trim().is_empty()) {
                let problem =
                    "it names none; give numbers or names that `foveate devices` lists, or leave it out";
                return Err(Error::setting("--devices", problem));
            }
            layers.set("devices.opencl", devices.as_str()).map_err(|e| renamed(e, "--devices"))?;
        }
        Ok(layers)
    }
}

/// Settings that come with the program, under all others.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct PresetFlag {
    /// Settings that come with the program, measured on several scenes: fast, balanced or accurate.
    #[arg(long, value_name = "NAME")]
    preset: Option<String>,
}

/// What a command takes that makes pictures or rays.
pub trait Options {
    /// Presets, files and assignments.
    fn sources(&self) -> (&PresetFlag, &ConfigOptions);
    /// The flags for frame times that were given.
    fn targets(&self) -> Vec<Flag> {
        Vec::new()
    }
    /// The flags for single settings that were given.
    ///
    /// # Errors
    /// Where one cannot be a setting.
    fn flags(&self) -> Result<Vec<Flag>>;

    /// The defaults under a preset, files, assignments and flags.
    ///
    /// # Errors
    /// That names the file, the key or the flag.
    fn layers(&self, mut layers: Layers) -> Result<Layers> {
        let (preset, config) = self.sources();
        preset.preset.iter().try_for_each(|name| layers.preset(name))?;
        let mut layers = config.layers(layers)?;
        lay(&mut layers, &self.targets(), true)?;
        lay(&mut layers, &self.flags()?, false)?;
        Ok(layers)
    }

    /// The settings; what is wrong is named as the operator wrote it.
    ///
    /// # Errors
    /// That names the key or the flag.
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

    /// The effective configuration over these defaults.
    ///
    /// # Errors
    /// That names the file, the key or the flag.
    fn config_over(&self, layers: Layers) -> Result<Config> {
        self.finished(&self.layers(layers)?)
    }

    /// The same for one picture, which is looked at everywhere: each pixel has its camera ray, unless settings say
    /// otherwise, and a sample at each pixel is shown as it is, unless a reconstruction is asked for.
    ///
    /// # Errors
    /// As [`Options::config_over`].
    fn config_for_picture(&self) -> Result<Config> {
        let mut defaults = Config::default();
        defaults.foveation.visibility_slope = 0.0;
        let layers = self.layers(Layers::over(defaults))?;
        let mut config = self.finished(&layers)?;
        let reconstructed = ["reconstruction.method", "reconstruction.k"].iter().any(|key| layers.gives(key));
        if config.foveation.samples == Samples::Full && !reconstructed {
            config.reconstruction =
                ReconstructionConfig { method: Method::KNearest, k: 1, ..config.reconstruction };
        }
        Ok(config)
    }

    /// The same for a display, and notes: frames keep up with it, unless settings say otherwise.
    ///
    /// # Errors
    /// As [`Options::config_over`].
    #[cfg(feature = "openxr")]
    fn config_for_display(&self, layers: Layers) -> Result<(Config, Vec<String>)> {
        let mut layers = self.layers(layers)?;
        let notes = keep_up(&mut layers);
        Ok((self.finished(&layers)?, notes))
    }

    /// Pixels across and down where flags or settings give them.
    ///
    /// # Errors
    /// As [`Options::config_over`].
    #[cfg(feature = "openxr")]
    fn given_size(&self) -> Result<[Option<u32>; 2]> {
        let layers = self.layers(Layers::default())?;
        let view = self.finished(&layers)?.view;
        let given = |key, value| layers.gives(key).then_some(value);
        Ok([given("view.width", view.width), given("view.height", view.height)])
    }
}

/// What pictures show and how they are made.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct PictureOptions {
    #[command(flatten)]
    preset: PresetFlag,
    #[command(flatten)]
    pub config: ConfigOptions,
    #[command(flatten)]
    pub scene: SceneFlags,
    #[command(flatten)]
    pub view: ViewFlags,
    #[command(flatten)]
    samples: SampleFlags,
    #[command(flatten)]
    light: LightFlags,
}

impl Options for PictureOptions {
    fn sources(&self) -> (&PresetFlag, &ConfigOptions) {
        (&self.preset, &self.config)
    }

    fn flags(&self) -> Result<Vec<Flag>> {
        Ok([self.scene.given(), self.view.given()?, self.samples.given(), self.light.given()].concat())
    }
}

/// The same with a gaze, and frame times to hold: where pictures are measured, both are the measurement's own.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct RenderOptions {
    #[command(flatten)]
    pub picture: PictureOptions,
    #[command(flatten)]
    targets: TargetFlags,
    #[command(flatten)]
    pub look: GazeFlag,
}

impl Options for RenderOptions {
    fn sources(&self) -> (&PresetFlag, &ConfigOptions) {
        self.picture.sources()
    }

    fn targets(&self) -> Vec<Flag> {
        self.targets.given()
    }

    fn flags(&self) -> Result<Vec<Flag>> {
        self.picture.flags()
    }
}

/// What is measured by rays alone, which make no picture.
#[derive(Clone, Debug, Default, clap::Args)]
pub struct RayOptions {
    #[command(flatten)]
    preset: PresetFlag,
    #[command(flatten)]
    pub config: ConfigOptions,
    #[command(flatten)]
    pub scene: SceneFlags,
    #[command(flatten)]
    pub view: ViewFlags,
    #[command(flatten)]
    samples: SampleFlags,
    #[command(flatten)]
    pub look: GazeFlag,
}

impl Options for RayOptions {
    fn sources(&self) -> (&PresetFlag, &ConfigOptions) {
        (&self.preset, &self.config)
    }

    fn flags(&self) -> Result<Vec<Flag>> {
        Ok([self.scene.given(), self.view.given()?, self.samples.given()].concat())
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

fn count_or_name(text: &str) -> toml::Value {
    text.parse().map_or_else(|_| number_or_name(text), toml::Value::Integer)
}

fn number_or_name(text: &str) -> toml::Value {
    text.parse().map_or_else(|_| toml::Value::String(text.to_string()), toml::Value::Float)
}
