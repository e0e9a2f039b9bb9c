//! Typed settings: defaults, a file, `--set key=value`, flags; later ones win. Unknown keys are refused.
//! A configuration is validated once and then only read.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::{Table, Value};

use crate::error::{Error, Result};
use crate::foveation::Law;
use crate::scene::sky::Sky;

/// Everything that can be set. [`Config::default`] is the truth; `configs/default.toml` repeats it with
/// comments, and a test compares the two.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// The picture.
    pub view: ViewConfig,
    /// Where samples are.
    pub foveation: FoveationConfig,
    /// How samples are traced.
    pub trace: TraceConfig,
    /// How samples become pixels.
    pub reconstruction: ReconstructionConfig,
    /// Light from infinitely far.
    pub environment: EnvironmentConfig,
    /// Which devices are used.
    pub devices: DevicesConfig,
}

/// The picture: size, camera, stereo, exposure.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ViewConfig {
    /// Pixels across; with stereo both eyes side by side.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// One view, one wider view for both eyes, or two.
    pub stereo: Stereo,
    /// Distance between the eyes in metres.
    pub ipd: f64,
    /// Vertical field of view in degrees of a camera that brings none.
    pub fov_y: f64,
    /// Stops by which displayed pictures are brightened; linear EXR pictures are not.
    pub exposure: f64,
}

/// How both eyes get their pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Stereo {
    /// One eye.
    Mono,
    /// One wider view from the point between the eyes, split for both: the paper's way.
    Shared,
    /// Two true viewpoints.
    PerEye,
}

/// Where samples are.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FoveationConfig {
    /// How their density falls off with distance from the gaze.
    pub law: Law,
    /// How many there are in each traced view.
    pub samples: Samples,
}

/// A number of samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Samples {
    /// One at each pixel.
    Full,
    /// This many.
    Count(usize),
}

impl Serialize for Samples {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Samples::Full => serializer.serialize_str("full"),
            Samples::Count(count) => serializer.serialize_u64(*count as u64),
        }
    }
}

impl<'de> Deserialize<'de> for Samples {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Raw {
            Count(u64),
            Name(String),
        }
        match Raw::deserialize(deserializer) {
            Ok(Raw::Count(count)) if count > 0 => Ok(Samples::Count(count as usize)),
            Ok(Raw::Name(name)) if name == "full" => Ok(Samples::Full),
            _ => Err(serde::de::Error::custom("give a number of samples above 0, or \"full\"")),
        }
    }
}

/// How samples are traced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TraceConfig {
    /// Light rays per sample.
    pub rays: u32,
    /// Further bounces of light.
    pub bounces: u32,
    /// Seed of the random numbers: the same picture for the same seed on the same device.
    pub seed: u32,
}

/// How samples become pixels.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ReconstructionConfig {
    /// The paper's average of the nearest samples, or the same under guidance of what pixels see.
    pub method: Method,
    /// Nearest samples that each pixel averages.
    pub k: u32,
    /// How their weight falls off with distance.
    pub weights: WeightsConfig,
}

/// The two reconstructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Method {
    /// The weighted average of the k nearest samples.
    #[value(name = "k-nn")]
    #[serde(rename = "k-nn")]
    KNearest,
    /// Sparse shading, interpolated along what every pixel sees.
    Guided,
}

/// Weight kinds of the nearest samples.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum WeightsConfig {
    /// Modified Shepard: zero where a sample stops being among the k nearest, so that nothing jumps.
    Shepard,
    /// A Gaussian of the distance.
    Gaussian,
    /// The inverse distance.
    Inverse,
}

/// Light from infinitely far: a map, or a clear sky with a sun.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct EnvironmentConfig {
    /// A `.hdr` or `.exr` latitude-longitude map; empty for the analytic sky.
    pub map: PathBuf,
    /// Stops by which the environment is brightened.
    pub exposure: f64,
    /// The sky's sun above the horizon, degrees.
    pub sun_elevation: f32,
    /// The sky's sun, degrees clockwise from -Z seen from above.
    pub sun_azimuth: f32,
    /// Haze of the sky, 1 to 10.
    pub turbidity: f32,
}

/// Which devices are used. Empty: the best one that works.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DevicesConfig {
    /// OpenCL device that traces: its number in `foveate devices`, or a part of its name.
    pub opencl: String,
    /// Vulkan device that reconstructs: a part of its name.
    pub vulkan: String,
}

impl Default for ViewConfig {
    fn default() -> Self {
        ViewConfig { width: 1280, height: 800, stereo: Stereo::Mono, ipd: 0.064, fov_y: 70.0, exposure: 0.0 }
    }
}

impl Default for FoveationConfig {
    fn default() -> Self {
        FoveationConfig { law: Law::default(), samples: Samples::Count(55_000) }
    }
}

impl Default for TraceConfig {
    fn default() -> Self {
        TraceConfig { rays: 32, bounces: 0, seed: 0 }
    }
}

impl Default for ReconstructionConfig {
    fn default() -> Self {
        ReconstructionConfig { method: Method::Guided, k: 4, weights: WeightsConfig::Shepard }
    }
}

impl Default for EnvironmentConfig {
    fn default() -> Self {
        let sky = Sky::default();
        EnvironmentConfig {
            map: PathBuf::new(),
            exposure: 0.0,
            sun_elevation: sky.sun_elevation_deg,
            sun_azimuth: sky.sun_azimuth_deg,
            turbidity: sky.turbidity,
        }
    }
}

/// Layers of settings before they are typed: starts with the defaults.
#[derive(Clone, Debug)]
pub struct Layers {
    table: Table,
}

impl Default for Layers {
    fn default() -> Self {
        Layers { table: Table::try_from(Config::default()).expect("the defaults are a table") }
    }
}

impl Layers {
    /// Lays a TOML file over what is there.
    ///
    /// # Errors
    /// Where it cannot be read, is not TOML, or names a key that does not exist.
    pub fn file(&mut self, path: &Path) -> Result<()> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, &e))?;
        let table: Table = text.parse().map_err(|e: toml::de::Error| Error::File {
            path: path.to_path_buf(),
            problem: format!("it is not a TOML file: {}; see configs/default.toml", e.message()),
        })?;
        overlay(&mut self.table, table);
        self.finish().map(drop).map_err(|e| match e {
            Error::Setting { key, problem } => {
                Error::File { path: path.to_path_buf(), problem: format!("{key}: {problem}") }
            }
            other => other,
        })
    }

    /// Lays one `key=value` over what is there. The value is TOML; a bare word is text.
    ///
    /// # Errors
    /// Where there is no `=`, no such key, or the value does not fit.
    pub fn assign(&mut self, assignment: &str) -> Result<()> {
        let Some((key, text)) = assignment.split_once('=') else {
            return Err(Error::setting(
                "--set",
                format!("{assignment:?} is not key=value, such as trace.rays=16"),
            ));
        };
        let value = format!("v = {text}")
            .parse::<Table>()
            .ok()
            .and_then(|mut table| table.remove("v"))
            .unwrap_or_else(|| Value::String(text.to_string()));
        self.set(key.trim(), value)
    }

    /// Sets one dotted key.
    ///
    /// # Errors
    /// Where there is no such key, or the value does not fit.
    pub fn set(&mut self, key: &str, value: impl Into<Value>) -> Result<()> {
        let nested = key
            .rsplit('.')
            .fold(value.into(), |inner, part| Value::Table(Table::from_iter([(part.to_string(), inner)])));
        let Value::Table(layer) = nested else { return Err(Error::setting(key, "there is no such key")) };
        overlay(&mut self.table, layer);
        let checked: Result<Config, _> = self.table.clone().try_into();
        checked.map(drop).map_err(|e| refused(key, &e))
    }

    /// The typed, validated configuration.
    ///
    /// # Errors
    /// [`Error::Setting`] about the first key that does not exist or has a value that does not fit.
    pub fn finish(&self) -> Result<Config> {
        let config: Config =
            self.table.clone().try_into().map_err(|e: toml::de::Error| refused("configuration", &e))?;
        config.validate()?;
        Ok(config)
    }
}

fn refused(key: &str, error: &toml::de::Error) -> Error {
    let what = error.message().trim_end();
    Error::setting(key, format!("{what}; configs/default.toml lists every key"))
}

/// Lays `top` over `base`, key by key. A law given anew, by name, brings its own parameters.
fn overlay(base: &mut Table, top: Table) {
    for (key, value) in top {
        let named = |v: &Value| v.as_str().map(|name| Table::from_iter([("name".to_string(), name.into())]));
        match (base.get_mut(&key), value) {
            (Some(old), value) if key == "law" && value.is_str() => {
                *old = Value::Table(named(&value).expect("it is a string"));
            }
            (Some(old), Value::Table(new)) if key == "law" && new.contains_key("name") => {
                *old = Value::Table(new)
            }
            (Some(Value::Table(old)), Value::Table(new)) => overlay(old, new),
            (_, value) => drop(base.insert(key, value)),
        }
    }
}

/// Pixels along a side of a picture at most.
const MAX_SIDE: u32 = 16_384;

impl Config {
    fn validate(&self) -> Result<()> {
        let whole = |key: &str, value: u32, least: u32, most: u32| {
            range(key, f64::from(value), f64::from(least), f64::from(most))
        };
        let view = &self.view;
        whole("view.width", view.width, 1, MAX_SIDE)?;
        whole("view.height", view.height, 1, MAX_SIDE)?;
        if view.stereo != Stereo::Mono && !view.width.is_multiple_of(2) {
            return Err(Error::setting("view.width", "both eyes share it with stereo; give an even number"));
        }
        range("view.ipd", view.ipd, 0.0, 1.0)?;
        range("view.fov_y", view.fov_y, 1.0, 175.0)?;
        range("view.exposure", view.exposure, -40.0, 40.0)?;
        self.foveation.law.validate()?;
        whole("trace.rays", self.trace.rays, 1, 4096)?;
        whole("trace.bounces", self.trace.bounces, 0, 4)?;
        whole("reconstruction.k", self.reconstruction.k, 1, 16)?;
        let environment = &self.environment;
        range("environment.exposure", environment.exposure, -40.0, 40.0)?;
        range("environment.sun_elevation", f64::from(environment.sun_elevation), -10.0, 90.0)?;
        range("environment.sun_azimuth", f64::from(environment.sun_azimuth), -360.0, 360.0)?;
        range("environment.turbidity", f64::from(environment.turbidity), 1.0, 10.0)
    }
}

fn range(key: &str, value: f64, least: f64, most: f64) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(Error::setting(key, format!("{value} is out of range; give {least} to {most}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_commented_file_is_the_default() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/default.toml");
        let text = std::fs::read_to_string(path).unwrap();
        let table: Table = text.parse().unwrap();
        assert_eq!(table, Table::try_from(Config::default()).unwrap());
    }

    #[test]
    fn later_layers_win() {
        let mut layers = Layers::default();
        layers.assign("trace.rays=16").unwrap();
        layers.assign("foveation.samples=full").unwrap();
        layers.assign("foveation.law=uniform").unwrap();
        layers.assign("trace.rays=8").unwrap();
        let config = layers.finish().unwrap();
        assert_eq!(config.trace.rays, 8);
        assert_eq!(config.foveation.samples, Samples::Full);
        assert_eq!(config.foveation.law, Law::Uniform);
    }

    #[test]
    fn parameters_of_a_law_can_be_set_alone() {
        let mut layers = Layers::default();
        layers.assign("foveation.law.exponent=-1.5").unwrap();
        let Law::Paper { exponent, .. } = layers.finish().unwrap().foveation.law else { panic!() };
        assert_eq!(exponent, -1.5);
    }

    #[test]
    fn wrong_settings_are_refused_by_name() {
        for (assignment, part) in [
            ("trace.rays", "not key=value"),
            ("trace.rayz=3", "rayz"),
            ("trace.rays=0", "trace.rays"),
            ("trace.rays=many", "trace.rays"),
            ("view.fov_y=180", "view.fov_y"),
            ("foveation.law=spiral", "spiral"),
            ("foveation.samples=0", "samples"),
            ("", "not key=value"),
            ("=3", "configs/default.toml"),
        ] {
            let mut layers = Layers::default();
            let result = layers.assign(assignment).and_then(|()| layers.finish());
            let message = result.expect_err(assignment).to_string();
            assert!(message.contains(part), "{assignment}: {message}");
        }
    }
}
