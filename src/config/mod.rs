//! Typed settings: defaults, a file, `--set key=value`, flags; later ones win. Unknown keys are refused.
//! A configuration is validated once and then only read.

mod budget;
mod check;
mod devices;
mod environment;
mod exposure;
mod foveation;
mod headset;
mod layers;
pub mod preset;
mod quality;
mod reconstruction;
mod scene;
#[cfg(test)]
mod tests;
mod trace;
mod view;

pub use budget::{BudgetConfig, OperatingPoint, TRADED, TargetMs};
pub use devices::DevicesConfig;
pub use environment::EnvironmentConfig;
pub use exposure::ExposureConfig;
pub use foveation::{FoveationConfig, Samples, USUAL_SHARE};
pub use headset::{Dk1Config, Hand, HeadsetConfig, Turn, Walk};
pub use layers::Layers;
pub use quality::Quality;
pub use reconstruction::{Method, ReconstructionConfig, TimeConfig, WeightsConfig};
pub use scene::SceneConfig;
use serde::{Deserialize, Serialize};
pub use trace::{DeformConfig, HardwareRaysConfig, Indirect, TraceConfig, TraversalConfig};
pub use view::{Stereo, ViewConfig};

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

impl Config {
    /// Whether frames know of those before: only guided ones can.
    pub fn reuses(&self) -> bool {
        self.time.reuse && self.reconstruction.method == Method::Guided
    }

    /// The same for pictures that stand for themselves: none knows of those before.
    pub fn without_reuse(mut self) -> Config {
        self.time.reuse = false;
        self
    }
}
