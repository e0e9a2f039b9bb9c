//! Light from infinitely far.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::scene::sky::Sky;

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
