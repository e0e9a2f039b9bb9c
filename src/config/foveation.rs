//! Where samples are, and how many.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::error::Result;
use crate::foveation::Law;

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

impl Default for FoveationConfig {
    fn default() -> Self {
        FoveationConfig { law: Law::default(), samples: Samples::Share(USUAL_SHARE), visibility_slope: 0.011 }
    }
}
