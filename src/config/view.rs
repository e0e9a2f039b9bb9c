//! The picture: size, camera, stereo, exposure.

use serde::{Deserialize, Serialize};

use super::ExposureConfig;
use crate::reconstruct::Overlay;

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
