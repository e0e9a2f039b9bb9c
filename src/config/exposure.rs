//! The setting that says how bright pictures are shown.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// How bright pictures are shown; linear EXR pictures are not changed by it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ExposureConfig {
    /// By what is seen.
    Auto,
    /// By so many stops.
    Stops(f64),
}

impl ExposureConfig {
    /// The stops by which all pictures are brightened: none where exposure is automatic.
    pub fn fixed(self) -> f64 {
        match self {
            ExposureConfig::Auto => 0.0,
            ExposureConfig::Stops(stops) => stops,
        }
    }
}

impl Default for ExposureConfig {
    fn default() -> Self {
        ExposureConfig::Stops(0.0)
    }
}

impl Serialize for ExposureConfig {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            ExposureConfig::Auto => serializer.serialize_str("auto"),
            ExposureConfig::Stops(stops) => serializer.serialize_f64(*stops),
        }
    }
}

impl<'de> Deserialize<'de> for ExposureConfig {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Raw {
            Stops(f64),
            Name(String),
        }
        match Raw::deserialize(deserializer) {
            Ok(Raw::Stops(stops)) => Ok(ExposureConfig::Stops(stops)),
            Ok(Raw::Name(name)) if name == "auto" => Ok(ExposureConfig::Auto),
            _ => Err(serde::de::Error::custom("give stops, such as 1.5, or \"auto\"")),
        }
    }
}
