//! Light from infinitely far.

use std::path::PathBuf;

use serde::{Deserialize, Serialize};

use crate::error::{Error, Result};
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
    /// Seconds in which the sky turns once: its sun stands as above at time 0, and where that has brought it later. 0: it
    /// stands still.
    pub day_length: f64,
}

impl EnvironmentConfig {
    /// # Errors
    /// Where the day is too short or too long, or a map should turn.
    pub fn check_day(&self) -> Result<()> {
        let refuse = |problem: String| Err(Error::setting("environment.day_length", problem));
        let length = self.day_length;
        if length != 0.0 && !(SHORTEST_DAY..=LONGEST_DAY).contains(&length) {
            return refuse(format!(
                "{length} is no length of a day; give {SHORTEST_DAY} to {LONGEST_DAY} seconds, or 0 for a sun that stands still"
            ));
        }
        if length != 0.0 && !self.map.as_os_str().is_empty() {
            return refuse("the light of a map stands still; give no map with it, or 0".into());
        }
        Ok(())
    }
}

/// Seconds of a day.
const SHORTEST_DAY: f64 = 1.0;
const LONGEST_DAY: f64 = 1e9;

impl Default for EnvironmentConfig {
    fn default() -> Self {
        let sky = Sky::default();
        EnvironmentConfig {
            map: PathBuf::new(),
            exposure: 0.0,
            sun_elevation: sky.sun_elevation_deg,
            sun_azimuth: sky.sun_azimuth_deg,
            turbidity: sky.turbidity,
            day_length: 0.0,
        }
    }
}
