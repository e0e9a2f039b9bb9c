//! How samples become pixels, and what frames know of each other.

use serde::{Deserialize, Serialize};

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

impl Default for ReconstructionConfig {
    fn default() -> Self {
        ReconstructionConfig { method: Method::Guided, k: 4, weights: WeightsConfig::Shepard }
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
    /// Pictures at most that the mean of a pixel holds, where samples are fewer than pixels.
    pub pictures: u32,
    /// Of [`super::TraceConfig::rays`], the part that a frame sends where one before it has left light and the view has hardly moved.
    pub rays: f64,
    /// The same of samples whose surfaces the frame before has seen, while the view moves more.
    pub rays_in_motion: f64,
    /// Of those samples the part that a frame shades, in turn: one in a whole number of them, 1 to 10.
    pub samples_in_motion: f64,
    /// The part of the samples that a frame shades, in turn, where view and light have rested for a while: one in a whole number
    /// of them, at most half of `frames`.
    pub samples: f64,
}

impl Default for TimeConfig {
    fn default() -> Self {
        TimeConfig {
            reuse: true,
            frames: 32,
            eyes: true,
            pictures: 16,
            rays: 0.5,
            rays_in_motion: 0.2,
            samples_in_motion: 0.5,
            samples: 0.25,
        }
    }
}
