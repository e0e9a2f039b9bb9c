//! Typed settings: defaults, a file, `--set key=value`, flags; later ones win. Unknown keys are refused.
//! A configuration is validated once and then only read.

mod budget;
mod exposure;
pub mod preset;
mod scene;

use std::path::{Path, PathBuf};

pub use budget::{BudgetConfig, OperatingPoint, TRADED, TargetMs};
pub use exposure::ExposureConfig;
pub use scene::SceneConfig;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use toml::{Table, Value};

use crate::bench::Choice;
use crate::error::{Error, Result};
use crate::foveation::Law;
use crate::gpu::opencl::Device;
use crate::metrics::picture::MAX_PIXELS;
use crate::reconstruct::Overlay;
use crate::scene::sky::Sky;
use crate::trace;

/// Everything that can be set. [`Config::default`] is the truth; `configs/default.toml` repeats it with
/// comments, and a test compares the two.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Config {
    /// What is shown of a scene's file.
    pub scene: SceneConfig,
    /// The picture.
    pub view: ViewConfig,
    /// Where samples are.
    pub foveation: FoveationConfig,
    /// How samples are traced.
    pub trace: TraceConfig,
    /// How samples become pixels.
    pub reconstruction: ReconstructionConfig,
    /// What frames know of each other.
    pub time: TimeConfig,
    /// Light from infinitely far.
    pub environment: EnvironmentConfig,
    /// How long a frame may take.
    pub budget: BudgetConfig,
    /// Which devices are used.
    pub devices: DevicesConfig,
    /// The Rift DK1.
    pub dk1: Dk1Config,
    /// What is done in a headset.
    pub headset: HeadsetConfig,
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
    /// How bright displayed pictures are; linear EXR pictures are not changed.
    pub exposure: ExposureConfig,
    /// The least and the most stops of automatic exposure.
    pub exposure_range: [f64; 2],
    /// What is drawn over the picture to show how it is made.
    pub overlay: Overlay,
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
    /// How many there are in each traced view; by default at most as many as it has pixels.
    pub samples: Samples,
    /// How fast the angle that camera rays may be apart grows with eccentricity, in degrees per degree: see
    /// [`crate::foveation::spaced`]. 0: a ray for each pixel.
    pub visibility_slope: f64,
}

/// Shaded samples by default, as a share of the pixels: the paper's 55,000 for 1280 x 800.
pub const USUAL_SHARE: f64 = 0.054;

/// A number of samples.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Samples {
    /// One at each pixel.
    Full,
    /// This many.
    Count(usize),
    /// This share of the pixels, above 0 and up to 1.
    Share(f64),
}

impl Samples {
    /// How many there are in a view with so many pixels: at least 1.
    pub fn of(self, pixels: usize) -> usize {
        match self {
            Samples::Full => pixels,
            Samples::Count(count) => count.min(pixels).max(1),
            Samples::Share(share) => ((pixels as f64 * share).round() as usize).min(pixels).max(1),
        }
    }
}

impl Serialize for Samples {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Samples::Full => serializer.serialize_str("full"),
            Samples::Count(count) => serializer.serialize_u64(*count as u64),
            Samples::Share(share) => serializer.serialize_f64(*share),
        }
    }
}

impl<'de> Deserialize<'de> for Samples {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Raw {
            Count(u64),
            Share(f64),
            Name(String),
        }
        match Raw::deserialize(deserializer) {
            Ok(Raw::Count(count)) if count > 0 => Ok(Samples::Count(count as usize)),
            Ok(Raw::Share(share)) => Ok(Samples::Share(share)),
            Ok(Raw::Name(name)) if name == "full" => Ok(Samples::Full),
            _ => Err(serde::de::Error::custom(
                "give a number of samples above 0, a share of the pixels such as 0.05, or \"full\"",
            )),
        }
    }
}

/// How samples are traced.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TraceConfig {
    /// Light rays per sample.
    pub rays: u32,
    /// Further bounces of light by paths.
    pub bounces: u32,
    /// Where light of further bounces comes from.
    pub indirect: Indirect,
    /// More camera rays in each pixel where guided reconstruction finds an edge; 0 leaves edges jagged.
    pub edge_rays: u32,
    /// Seed of the random numbers: the same picture for the same seed on the same device.
    pub seed: u32,
    /// Which variant of the kernels is used.
    pub traversal: TraversalConfig,
}

/// Where light comes from that surfaces have reflected.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Indirect {
    /// A cache that is kept over frames, with guided reconstruction of fewer samples than pixels and no bounces.
    Cache,
    /// Paths alone, of as many bounces as are given.
    Paths,
}

/// A variant of the kernels, or the fastest ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum TraversalConfig {
    /// The fastest for each kind of ray, by a measurement at the device's first start.
    Auto,
    /// Rays that belong together share a work-item.
    Packet,
    /// A work-item follows one ray after the other.
    SingleRay,
}

impl TraversalConfig {
    /// The variant that is forced, if any is.
    pub fn forced(self) -> Option<trace::Traversal> {
        match self {
            TraversalConfig::Auto => None,
            TraversalConfig::Packet => Some(trace::Traversal::Packet),
            TraversalConfig::SingleRay => Some(trace::Traversal::SingleRay),
        }
    }

    /// The variants on a device: measured at its first start, where none is forced.
    pub fn on(self, device: &Device) -> Choice {
        self.forced().map_or_else(|| Choice::of(device), Choice::forced)
    }
}

impl From<trace::Traversal> for TraversalConfig {
    fn from(traversal: trace::Traversal) -> TraversalConfig {
        match traversal {
            trace::Traversal::Packet => TraversalConfig::Packet,
            trace::Traversal::SingleRay => TraversalConfig::SingleRay,
        }
    }
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

impl Config {
    /// The same for pictures that stand for themselves: none knows of those before.
    pub fn without_reuse(mut self) -> Config {
        self.time.reuse = false;
        self
    }
}

/// What frames know of each other.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TimeConfig {
    /// Carry light that earlier frames have found to the next ones (guided only).
    pub reuse: bool,
    /// Estimates of a sample's light at most that its mean holds.
    pub frames: u32,
    /// Let samples of one eye serve the other, too.
    pub eyes: bool,
    /// Of [`TraceConfig::rays`], the part that a frame sends where one before it has left light and the view has hardly moved.
    pub rays: f64,
}

impl Default for TimeConfig {
    fn default() -> Self {
        TimeConfig { reuse: true, frames: 32, eyes: true, rays: 0.5 }
    }
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

/// Which devices are used.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DevicesConfig {
    /// OpenCL devices that trace, separated by commas: their numbers in `foveate devices`, their UUIDs, or
    /// parts of their names. Empty: all that work.
    pub opencl: String,
    /// Compute units of the parts that each processor among them is divided into; what is left over stays
    /// free for other programs. Empty: it is used whole.
    pub subdivide: Vec<u32>,
    /// Vulkan device that reconstructs: a part of its name. Empty: the best.
    pub vulkan: String,
}

/// The Rift DK1.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Dk1Config {
    /// Pixels of the undistorted pictures for one of the panel's at the lenses' centres.
    pub resolution: f64,
    /// The folder where what is learned of each tracker is kept; empty for the user's state folder.
    pub memory: PathBuf,
}

impl Default for Dk1Config {
    fn default() -> Self {
        Dk1Config { resolution: 1.0, memory: PathBuf::new() }
    }
}

/// What is done in a headset.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeadsetConfig {
    /// Move pixels to where they are seen from the newest pose, by their depths, just before they are shown.
    pub late_correction: bool,
    /// How much more than is shown is traced at each side, as a share of the view's width and height, so that
    /// the late correction finds something there.
    pub margin: f64,
    /// Let the sharp region follow the eyes where a tracker tells where they look.
    pub eye_tracking: bool,
    /// Use a sharp inset for each eye where the headset has one.
    pub insets: bool,
    /// Pictures a second to ask the headset for; 0 for its own choice.
    pub refresh_hz: f64,
    /// The hand that points and turns; the other one goes.
    pub hand: Hand,
    /// How controllers move the wearer.
    pub walk: Walk,
    /// Metres per second of a smooth walk.
    pub speed: f64,
    /// How controllers turn the wearer.
    pub turn: Turn,
    /// Degrees of a snap turn, or per second of a smooth one.
    pub turn_degrees: f64,
    /// Let the terminal's keys move the wearer too.
    pub keyboard: bool,
    /// Hand over pictures' depths where the runtime takes them, for its own reprojection.
    pub depth: bool,
}

/// The hand that points and turns.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Hand {
    /// As bindings usually are.
    Right,
    /// Everything is bound to the other hand.
    Left,
}

/// How controllers move the wearer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Walk {
    /// To where the hand points that does.
    Teleport,
    /// As the other hand's stick is pushed.
    Smooth,
    /// Not at all.
    Off,
}

/// How controllers turn the wearer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Turn {
    /// By a fixed angle at each push of the stick in the hand that points.
    Snap,
    /// As long as that stick is pushed.
    Smooth,
    /// Not at all.
    Off,
}

impl Default for HeadsetConfig {
    fn default() -> Self {
        HeadsetConfig {
            late_correction: true,
            margin: 0.0,
            eye_tracking: true,
            insets: true,
            refresh_hz: 0.0,
            hand: Hand::Right,
            walk: Walk::Teleport,
            speed: 2.0,
            turn: Turn::Snap,
            turn_degrees: 30.0,
            keyboard: true,
            depth: true,
        }
    }
}

impl Default for ViewConfig {
    fn default() -> Self {
        ViewConfig {
            width: 1280,
            height: 800,
            stereo: Stereo::Mono,
            ipd: 0.064,
            fov_y: 70.0,
            exposure: ExposureConfig::default(),
            exposure_range: [-20.0, 10.0],
            overlay: Overlay::default(),
        }
    }
}

impl Default for FoveationConfig {
    fn default() -> Self {
        FoveationConfig { law: Law::default(), samples: Samples::Share(USUAL_SHARE), visibility_slope: 0.011 }
    }
}

impl Default for TraceConfig {
    fn default() -> Self {
        let indirect = Indirect::Cache;
        TraceConfig {
            rays: 32,
            bounces: 0,
            indirect,
            edge_rays: 2,
            seed: 0,
            traversal: TraversalConfig::Auto,
        }
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

/// Layers of settings before they are typed: starts with defaults.
#[derive(Clone, Debug)]
pub struct Layers {
    table: Table,
    /// What was laid over the defaults.
    given: Table,
}

impl Default for Layers {
    fn default() -> Self {
        Layers::over(Config::default())
    }
}

impl Layers {
    /// Layers over other defaults than the usual ones.
    pub fn over(defaults: Config) -> Self {
        let table = Table::try_from(defaults).expect("a configuration is a table");
        Layers { table, given: Table::new() }
    }

    /// Lays a preset over what is there.
    ///
    /// # Errors
    /// Where there is none of that name.
    pub fn preset(&mut self, name: &str) -> Result<()> {
        self.text(preset::text(name)?, &Path::new("configs/quality").join(format!("{name}.toml")))
    }

    /// Lays a TOML file over what is there.
    ///
    /// # Errors
    /// Where it cannot be read, is not TOML, names a key that does not exist, or has a value that does
    /// not fit.
    pub fn file(&mut self, path: &Path) -> Result<()> {
        self.text(&read_text(path)?, path)
    }

    /// Lays a file's text over what is there.
    fn text(&mut self, text: &str, path: &Path) -> Result<()> {
        let table: Table = text.parse().map_err(|e: toml::de::Error| Error::File {
            path: path.to_path_buf(),
            problem: format!("it is not a TOML file: {}; see configs/default.toml", e.message()),
        })?;
        let laid = table.into_iter().try_for_each(|(key, value)| self.lay(key, value));
        laid.and_then(|()| self.typed()?.check_keys()).map_err(|e| match e {
            Error::Setting { key, problem } => {
                Error::File { path: path.to_path_buf(), problem: format!("{key}: {problem}") }
            }
            other => other,
        })
    }

    /// Sets every key of a section by itself, so that messages name it. A law's parameters belong together.
    fn lay(&mut self, key: String, value: Value) -> Result<()> {
        match value {
            Value::Table(section) if !section.is_empty() && !key.ends_with(".law") => {
                section.into_iter().try_for_each(|(name, value)| self.lay(format!("{key}.{name}"), value))
            }
            value => self.set(&key, value),
        }
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
            .filter(|table| table.len() == 1)
            .and_then(|mut table| table.remove("v"))
            .unwrap_or_else(|| Value::String(text.to_string()));
        self.set(key.trim(), value)
    }

    /// Sets one dotted key.
    ///
    /// # Errors
    /// Where there is no such key, or the value does not fit.
    pub fn set(&mut self, key: &str, value: impl Into<Value>) -> Result<()> {
        if key.split('.').count() > MAX_DEPTH {
            // The key is not repeated: it may be as long as a command line.
            return Err(Error::setting(
                "a key",
                "no key has so many dots; configs/default.toml lists every key",
            ));
        }
        if let Some((_, now)) = RENAMED.iter().find(|(old, _)| *old == key) {
            return Err(Error::setting(key, format!("it is called {now} now")));
        }
        let nested = key
            .rsplit('.')
            .fold(value.into(), |inner, part| Value::Table(Table::from_iter([(part.to_string(), inner)])));
        let Value::Table(layer) = nested else { return Err(Error::setting(key, "there is no such key")) };
        overlay(&mut self.table, layer.clone());
        overlay(&mut self.given, layer);
        let checked: Result<Config, _> = self.table.clone().try_into();
        checked.map(drop).map_err(|e| refused(key, &e))
    }

    /// Whether a dotted key was given a value, or has its default.
    pub fn gives(&self, key: &str) -> bool {
        let mut parts = key.split('.');
        let first = parts.next().and_then(|part| self.given.get(part));
        parts.try_fold(first, |inner, part| inner.map(|v| v.get(part))).flatten().is_some()
    }

    /// Has frames keep up with a display, where nothing else was said: no time to hold, and none of the settings
    /// that would be moved for it ([`TRADED`]). Where one of those was given, they stay, and its key is answered.
    pub fn keep_up(&mut self) -> Option<&'static str> {
        if self.gives("budget.target_ms") {
            return None;
        }
        let fixed = TRADED.into_iter().find(|key| self.gives(key));
        if fixed.is_none() {
            let budget = Table::from_iter([("target_ms".to_string(), "display".into())]);
            overlay(&mut self.table, Table::from_iter([("budget".to_string(), budget.into())]));
        }
        fixed
    }

    /// Has pictures on a display exposed by what is seen, where no exposure was given.
    pub fn expose(&mut self) {
        if !self.gives("view.exposure") {
            let view = Table::from_iter([("exposure".to_string(), "auto".into())]);
            overlay(&mut self.table, Table::from_iter([("view".to_string(), view.into())]));
        }
    }

    /// The typed, validated configuration.
    ///
    /// # Errors
    /// [`Error::Setting`] about the first key that does not exist or has a value that does not fit.
    pub fn finish(&self) -> Result<Config> {
        let config = self.typed()?;
        config.check_keys()?;
        config.check_size()?;
        if self.gives("foveation.samples") {
            config.check_samples()?;
        }
        Ok(config)
    }

    /// Refuses the first key whose value is out of its range.
    ///
    /// # Errors
    /// [`Error::Setting`] that names it.
    pub fn check(&self) -> Result<()> {
        self.typed()?.check_keys()
    }

    fn typed(&self) -> Result<Config> {
        self.table.clone().try_into().map_err(|e: toml::de::Error| refused("configuration", &e))
    }
}

/// Keys of earlier versions, and what they are called now.
const RENAMED: [(&str, &str); 1] =
    [("trace.walk", "trace.traversal, with the values \"auto\", \"packet\" and \"single-ray\"")];

/// Parts of a key at most.
const MAX_DEPTH: usize = 8;

/// Bytes of a configuration file at most.
const MAX_FILE: u64 = 1 << 20;

fn read_text(path: &Path) -> Result<String> {
    let fail = |problem: &str| Error::File { path: path.to_path_buf(), problem: problem.to_string() };
    let metadata = std::fs::metadata(path).map_err(|e| Error::io(path, &e))?;
    if !metadata.is_file() {
        return Err(fail("it is not a regular file; give the path of a file"));
    }
    if metadata.len() > MAX_FILE {
        return Err(fail("it is larger than 1 MiB; give a file like configs/default.toml"));
    }
    std::fs::read_to_string(path).map_err(|e| match e.kind() {
        std::io::ErrorKind::InvalidData => {
            fail("it is not text in UTF-8; give a file like configs/default.toml")
        }
        _ => Error::io(path, &e),
    })
}

/// What is wrong with a value, in words of TOML and not of Rust.
fn refused(key: &str, error: &toml::de::Error) -> Error {
    const WORDS: [(&str, &str); 18] = [
        ("invalid type: unit variant, expected string only", "expected one of its names as text"),
        ("expected u32", "expected a whole number, 0 or more"),
        ("expected u64", "expected a whole number, 0 or more"),
        ("expected usize", "expected a whole number, 0 or more"),
        ("expected f32", "expected a number"),
        ("expected f64", "expected a number"),
        ("expected path string", "expected a path as text"),
        ("expected a sequence", "expected a list"),
        ("invalid type: sequence", "invalid type: a list"),
        ("invalid type: map", "invalid type: a section"),
        ("invalid type: boolean", "invalid type: the value"),
        ("expected internally tagged enum Law", "expected a law's name, or a section with it"),
        ("invalid type: floating point", "invalid type: the number"),
        ("invalid type: integer", "invalid type: the number"),
        ("invalid type: string", "invalid type: the text"),
        ("expected a boolean", "expected true or false"),
        ("expected a string", "expected text"),
        ("invalid value: integer", "invalid value:"),
    ];
    let message = error.message().trim_end().to_string();
    let what = WORDS.iter().fold(message, |what, (from, to)| what.replace(from, to));
    // Their names follow, which are Rust's.
    let what = what
        .split_once("expected struct ")
        .map_or(what.clone(), |(before, _)| format!("{before}expected a section"));
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
    /// Whether frames look reflected light up in the cache: guided ones of fewer samples than pixels, without bounces.
    pub fn uses_cache(&self) -> bool {
        self.trace.indirect == Indirect::Cache
            && self.trace.bounces == 0
            && self.reconstruction.method == Method::Guided
            && self.foveation.samples != Samples::Full
    }

    /// Each key by itself.
    fn check_keys(&self) -> Result<()> {
        let whole = |key: &str, value: u32, least: u32, most: u32| {
            range(key, f64::from(value), f64::from(least), f64::from(most))
        };
        self.scene.check()?;
        let view = &self.view;
        whole("view.width", view.width, 1, MAX_SIDE)?;
        whole("view.height", view.height, 1, MAX_SIDE)?;
        range("view.ipd", view.ipd, 0.0, 1.0)?;
        range("view.fov_y", view.fov_y, 1.0, 175.0)?;
        range("view.exposure", view.exposure.fixed(), -40.0, 40.0)?;
        let [least, most] = view.exposure_range;
        range("view.exposure_range", least, -40.0, 40.0)?;
        range("view.exposure_range", most, least, 40.0)?;
        self.foveation.law.validate()?;
        let slope = self.foveation.visibility_slope;
        if !(0.0..=1.0).contains(&slope) {
            let problem = format!("it is {slope}, and has to be from 0 to 1 degree per degree");
            return Err(Error::setting("foveation.visibility_slope", problem));
        }
        if let Samples::Share(share) = self.foveation.samples {
            budget::check_share("foveation.samples", share)?;
        }
        self.budget.check()?;
        whole("trace.rays", self.trace.rays, 1, 4096)?;
        whole("trace.bounces", self.trace.bounces, 0, 4)?;
        whole("trace.edge_rays", self.trace.edge_rays, 0, 8)?;
        whole("reconstruction.k", self.reconstruction.k, 1, 16)?;
        whole("time.frames", self.time.frames, 1, 256)?;
        range("time.rays", self.time.rays, 0.01, 1.0)?;
        let environment = &self.environment;
        range("environment.exposure", environment.exposure, -40.0, 40.0)?;
        range("environment.sun_elevation", f64::from(environment.sun_elevation), -10.0, 90.0)?;
        range("environment.sun_azimuth", f64::from(environment.sun_azimuth), -360.0, 360.0)?;
        range("environment.turbidity", f64::from(environment.turbidity), 1.0, 10.0)?;
        range("dk1.resolution", self.dk1.resolution, 0.05, 2.0)?;
        range("headset.margin", self.headset.margin, 0.0, 0.25)?;
        range("headset.refresh_hz", self.headset.refresh_hz, 0.0, 1000.0)?;
        range("headset.speed", self.headset.speed, 0.0, 100.0)?;
        range("headset.turn_degrees", self.headset.turn_degrees, 0.0, 360.0)
    }

    /// Memory for pixels is reserved before anything is traced, so absurd numbers are refused first.
    fn check_size(&self) -> Result<()> {
        let ViewConfig { width, height, stereo, .. } = self.view;
        if width as usize * height as usize > MAX_PIXELS {
            let problem =
                format!("{width}x{height} are more than {MAX_PIXELS} pixels; give a smaller picture");
            return Err(Error::setting("view.width", problem));
        }
        if stereo != Stereo::Mono && !width.is_multiple_of(2) {
            return Err(Error::setting("view.width", "both eyes share it with stereo; give an even number"));
        }
        Ok(())
    }

    fn check_samples(&self) -> Result<()> {
        let ViewConfig { width, height, stereo, .. } = self.view;
        let (across, whose) = if stereo == Stereo::Mono { (width, "") } else { (width / 2, " of each eye") };
        let pixels = across as usize * height as usize;
        match self.foveation.samples {
            Samples::Count(count) if count > pixels => Err(Error::setting(
                "foveation.samples",
                format!("{count} are more than the {pixels} pixels{whose}; give at most that, or full"),
            )),
            _ => Ok(()),
        }
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
    fn old_keys_are_answered_by_the_new_ones() {
        for (old, _) in RENAMED {
            let told = Layers::default().assign(&format!("{old}=alone")).unwrap_err().to_string();
            assert!(told.contains(old) && told.contains("trace.traversal"), "{told}");
            assert!(!Layers::default().gives(old));
        }
        let mut layers = Layers::default();
        layers.assign("trace.traversal=single-ray").unwrap();
        assert_eq!(layers.finish().unwrap().trace.traversal, TraversalConfig::SingleRay);
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
            ("view=3", "view"),
            ("a.b.c.d.e.f.g.h.i=3", "so many dots"),
            ("trace.rays=16\nview.width=8", "trace.rays"),
            ("view.exposure=nan", "out of range"),
            ("view.exposure=bright", "\"auto\""),
            ("view.exposure_range=[2, 1]", "exposure_range"),
            ("foveation.samples=1024001", "more than the 1024000 pixels"),
        ] {
            let mut layers = Layers::default();
            let result = layers.assign(assignment).and_then(|()| layers.finish());
            let message = result.expect_err(assignment).to_string();
            assert!(message.contains(part), "{assignment}: {message}");
        }
    }

    #[test]
    fn the_default_number_of_samples_fits_any_picture_and_a_given_one_must_fit() {
        let mut layers = Layers::default();
        layers.assign("view.width=96").unwrap();
        layers.assign("view.height=64").unwrap();
        assert!(
            !layers.gives("foveation.samples") && layers.gives("view.width") && !layers.gives("view.no.such")
        );
        layers.finish().unwrap();
        layers.assign("foveation.samples=6144").unwrap();
        layers.finish().unwrap();
        layers.assign("view.stereo=per-eye").unwrap();
        assert!(layers.finish().unwrap_err().to_string().contains("3072 pixels of each eye"));
    }

    #[test]
    fn fronts_give_what_is_traded_and_nothing_else() {
        let point = OperatingPoint {
            frame_ms: 1.0,
            score: 1.0,
            samples: 0.5,
            rays: 3,
            bounces: 3,
            edge_rays: 3,
            method: Method::KNearest,
            k: 3,
            weights: WeightsConfig::Inverse,
            law: Law::Uniform,
        };
        let tables = [Config::default(), point.applied_to(&Config::default())];
        let [before, after] = tables.map(|config| Table::try_from(config).unwrap());
        for (section, values) in &before {
            for (key, value) in values.as_table().unwrap() {
                let name = format!("{section}.{key}");
                assert_eq!(*value != after[section][key], TRADED.contains(&name.as_str()), "{name}");
            }
        }
    }

    #[test]
    fn frames_keep_up_with_a_display_unless_settings_say_otherwise() {
        let mut none = Config::default();
        none.budget.target_ms = TargetMs::None;
        let keeping_up = |assignments: &[&str]| {
            let mut layers = Layers::over(none.clone());
            assignments.iter().for_each(|assignment| layers.assign(assignment).unwrap());
            let fixed = layers.keep_up();
            (layers.finish().unwrap().budget.target_ms, fixed)
        };
        assert_eq!(keeping_up(&[]), (TargetMs::Display, None));
        assert_eq!(keeping_up(&["trace.seed=3", "view.width=640"]), (TargetMs::Display, None));
        assert_eq!(keeping_up(&["budget.target_score=7"]), (TargetMs::Display, None));
        assert_eq!(keeping_up(&["trace.rays=32"]), (TargetMs::None, Some("trace.rays")));
        assert_eq!(keeping_up(&["foveation.law=uniform"]), (TargetMs::None, Some("foveation.law")));
        assert_eq!(keeping_up(&["foveation.law.exponent=-1"]), (TargetMs::None, Some("foveation.law")));
        assert_eq!(keeping_up(&["trace.rays=32", "budget.target_ms=20"]), (TargetMs::Ms(20.0), None));
        assert_eq!(keeping_up(&["budget.target_ms=none"]), (TargetMs::None, None));
        for name in preset::names() {
            let mut layers = Layers::over(none.clone());
            layers.preset(name).unwrap();
            assert_eq!(layers.keep_up(), Some("foveation.law"), "a preset's settings are settings");
        }
    }

    #[test]
    fn displays_expose_by_what_is_seen_unless_stops_are_given() {
        let exposing = |assignments: &[&str]| {
            let mut layers = Layers::default();
            assignments.iter().for_each(|assignment| layers.assign(assignment).unwrap());
            layers.expose();
            layers.finish().unwrap().view.exposure
        };
        assert_eq!(exposing(&["view.width=640"]), ExposureConfig::Auto);
        assert_eq!(exposing(&["view.exposure=0"]), ExposureConfig::Stops(0.0));
        assert_eq!(exposing(&["view.exposure=auto"]), ExposureConfig::Auto);
        assert_eq!(Layers::default().finish().unwrap().view.exposure, ExposureConfig::Stops(0.0));
    }

    #[test]
    fn large_pictures_are_refused_before_they_are_allocated() {
        let mut layers = Layers::default();
        layers.assign("view.width=16384").unwrap();
        layers.assign("view.height=2048").unwrap();
        layers.finish().unwrap();
        layers.assign("view.height=2049").unwrap();
        assert!(layers.finish().unwrap_err().to_string().contains("more than"));
    }

    #[test]
    fn files_are_refused_by_their_name_and_the_keys() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings.toml");
        for (text, part) in [
            ("trace = {", "not a TOML file"),
            ("[trace]\nrays = 'many'", "trace.rays: "),
            ("[trace]\nrayz = 3", "rayz"),
            ("[view]\nfov_y = 180.0", "view.fov_y: 180 is out of range"),
            ("[tracer]", "tracer"),
            ("view = 3", "view"),
            ("[foveation]\nlaw = 'spiral'", "spiral"),
        ] {
            std::fs::write(&path, text).unwrap();
            let message = Layers::default().file(&path).expect_err(text).to_string();
            assert!(
                message.starts_with(path.to_str().unwrap()) && message.contains(part),
                "{text}: {message}"
            );
        }
        std::fs::write(&path, [0xff, 0xfe]).unwrap();
        assert!(Layers::default().file(&path).unwrap_err().to_string().contains("UTF-8"));
        std::fs::write(&path, "#".repeat(1 << 21)).unwrap();
        assert!(Layers::default().file(&path).unwrap_err().to_string().contains("1 MiB"));
        assert!(
            Layers::default().file(folder.path()).unwrap_err().to_string().contains("not a regular file")
        );
    }

    #[test]
    fn a_files_values_and_its_law_are_taken() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("settings.toml");
        // More samples than the default picture has pixels: the size may still come.
        let text = "[foveation]\nsamples = 2000000\n[foveation.law]\nname = 'log-polar'\nalpha = 2.0";
        std::fs::write(&path, text).unwrap();
        let mut layers = Layers::default();
        layers.file(&path).unwrap();
        assert!(layers.finish().is_err());
        layers.assign("view.width=4096").unwrap();
        let config = layers.finish().unwrap();
        assert_eq!(
            config.foveation,
            FoveationConfig {
                law: Law::LogPolar { alpha: 2.0 },
                samples: Samples::Count(2_000_000),
                visibility_slope: 0.011
            }
        );
    }

    #[test]
    fn values_of_wrong_types_are_told_in_words_of_toml() {
        fn keys(table: &Table, prefix: &str, found: &mut Vec<String>) {
            for (key, value) in table {
                let key = if prefix.is_empty() { key.clone() } else { format!("{prefix}.{key}") };
                match value {
                    Value::Table(section) => keys(section, &key, found),
                    _ => found.push(key),
                }
            }
        }
        let mut found = Vec::new();
        keys(&Table::try_from(Config::default()).unwrap(), "", &mut found);
        assert!(found.len() > 20, "{found:?}");
        let mut refused = 0;
        for key in &found {
            for value in ["'x?y'", "-3", "1.5", "[1, 2]", "true", "{ a = 1 }"] {
                let Err(error) = Layers::default().assign(&format!("{key}={value}")) else { continue };
                let message = error.to_string();
                refused += 1;
                for word in message.replace(key, "").split(|c: char| !c.is_ascii_alphanumeric()) {
                    let rust = [
                        "u8", "u32", "u64", "usize", "i64", "f32", "f64", "bool", "struct", "enum",
                        "sequence", "map", "untagged", "newtype", "tuple", "unit",
                    ];
                    assert!(!rust.contains(&word), "{key}={value}: {message}");
                }
            }
        }
        assert!(refused > 60, "{refused}");
    }
}
