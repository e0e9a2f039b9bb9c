//! What of the settings moves from frame to frame, where a time is held.

use super::{Config, Indirect, Method, Samples, WeightsConfig};
use crate::foveation::Law;

/// How finely a frame is sampled, and how its samples become pixels: the settings of the same names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// How the density of samples falls off with the angle from the gaze.
    pub law: Law,
    /// Samples of each view.
    pub samples: Samples,
    /// Light rays of each sample.
    pub rays: u32,
    /// Further bounces of light by paths.
    pub bounces: u32,
    /// Where light of further bounces comes from.
    pub indirect: Indirect,
    /// More camera rays in each pixel at an edge.
    pub edge_rays: u32,
    /// How samples become pixels.
    pub method: Method,
    /// Nearest samples that each pixel averages.
    pub k: u32,
    /// How their weight falls off with distance.
    pub weights: WeightsConfig,
}

impl Quality {
    /// What a configuration asks for.
    pub fn of(config: &Config) -> Quality {
        Quality {
            law: config.foveation.law,
            samples: config.foveation.samples,
            rays: config.trace.rays,
            bounces: config.trace.bounces,
            indirect: config.trace.indirect,
            edge_rays: config.trace.edge_rays,
            method: config.reconstruction.method,
            k: config.reconstruction.k,
            weights: config.reconstruction.weights,
        }
    }

    /// The configuration with this quality.
    pub fn applied_to(&self, config: &Config) -> Config {
        let mut config = config.clone();
        config.foveation.law = self.law;
        config.foveation.samples = self.samples;
        config.trace.rays = self.rays;
        config.trace.bounces = self.bounces;
        config.trace.indirect = self.indirect;
        config.trace.edge_rays = self.edge_rays;
        config.reconstruction.method = self.method;
        config.reconstruction.k = self.k;
        config.reconstruction.weights = self.weights;
        config
    }

    /// Whether frames look reflected light up in the cache: guided ones of fewer samples than pixels, without bounces.
    pub fn uses_cache(&self) -> bool {
        self.indirect == Indirect::Cache
            && self.bounces == 0
            && self.method == Method::Guided
            && self.samples != Samples::Full
    }
}
