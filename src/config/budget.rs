//! Settings about the frame's time: what to hold, and the points among which to choose.

use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::check::range;
use super::{Config, Method, Quality, Samples, WeightsConfig};
use crate::error::{Error, Result};
use crate::foveation::Law;

/// How long a frame may take, and what may be traded for it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct BudgetConfig {
    /// The frame time to hold.
    pub target_ms: TargetMs,
    /// The foveated score to stay at where the time allows it, 0 to 10; 10 is as good as possible.
    pub target_score: f64,
    /// Points among which frames choose, in any order: the Pareto front that `foveate measure` found.
    pub front: Vec<OperatingPoint>,
}

/// A frame time to hold.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum TargetMs {
    /// None: settings stay as they are.
    None,
    /// The display's period, less a margin; none where nothing is displayed.
    #[default]
    Display,
    /// So many milliseconds.
    Ms(f64),
}

/// Keys of the settings that every point of a front gives: what is traded for time.
pub const TRADED: [&str; 8] = [
    "foveation.law",
    "foveation.samples",
    "trace.rays",
    "trace.bounces",
    "trace.edge_rays",
    "reconstruction.method",
    "reconstruction.k",
    "reconstruction.weights",
];

impl Serialize for TargetMs {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            TargetMs::None => serializer.serialize_str("none"),
            TargetMs::Display => serializer.serialize_str("display"),
            TargetMs::Ms(ms) => serializer.serialize_f64(*ms),
        }
    }
}

impl<'de> Deserialize<'de> for TargetMs {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Raw {
            Ms(f64),
            Name(String),
        }
        match Raw::deserialize(deserializer) {
            Ok(Raw::Ms(ms)) => Ok(TargetMs::Ms(ms)),
            Ok(Raw::Name(name)) if name == "none" => Ok(TargetMs::None),
            Ok(Raw::Name(name)) if name == "display" => Ok(TargetMs::Display),
            _ => Err(serde::de::Error::custom("give milliseconds, \"display\" or \"none\"")),
        }
    }
}

/// Settings with what they cost and reach where they were measured.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct OperatingPoint {
    /// Milliseconds of a frame, the median.
    pub frame_ms: f64,
    /// The foveated score, 0 to 10.
    pub score: f64,
    /// Samples as a share of the pixels, above 0 and up to 1.
    pub samples: f64,
    /// Light rays per sample.
    pub rays: u32,
    /// Further bounces.
    pub bounces: u32,
    /// More camera rays where pixels have edges; as by default where a point does not say.
    #[serde(default = "usual_edge_rays")]
    pub edge_rays: u32,
    /// How samples become pixels.
    pub method: Method,
    /// Nearest samples that each pixel averages.
    pub k: u32,
    /// How their weight falls off.
    pub weights: WeightsConfig,
    /// How density falls off.
    pub law: Law,
}

impl OperatingPoint {
    /// Whether two points differ in numbers of samples and rays alone, apart from what they cost and reach.
    pub fn same_family(&self, other: &OperatingPoint) -> bool {
        let family = |p: &OperatingPoint| (p.law, p.bounces, p.edge_rays, p.method, p.k, p.weights);
        family(self) == family(other)
    }

    /// Its quality, with light of further bounces from where it came `before`.
    pub fn quality(&self, before: Quality) -> Quality {
        let OperatingPoint { law, rays, bounces, edge_rays, method, k, weights, .. } = *self;
        Quality {
            law,
            samples: Samples::Share(self.samples),
            rays,
            bounces,
            edge_rays,
            method,
            k,
            weights,
            ..before
        }
    }

    /// The settings of a configuration whose views have so many pixels, with a cost and a score.
    pub fn of(config: &Config, pixels: usize, frame_ms: f64, score: f64) -> OperatingPoint {
        OperatingPoint {
            frame_ms,
            score,
            samples: config.foveation.samples.of(pixels) as f64 / pixels.max(1) as f64,
            rays: config.trace.rays,
            bounces: config.trace.bounces,
            edge_rays: config.trace.edge_rays,
            method: config.reconstruction.method,
            k: config.reconstruction.k,
            weights: config.reconstruction.weights,
            law: config.foveation.law,
        }
    }

    fn check(&self) -> Result<()> {
        range("budget.front.frame_ms", self.frame_ms, 1e-6, 1e9)?;
        range("budget.front.score", self.score, 0.0, 10.0)?;
        check_share("budget.front.samples", self.samples)?;
        range("budget.front.rays", f64::from(self.rays), 1.0, 4096.0)?;
        range("budget.front.bounces", f64::from(self.bounces), 0.0, 4.0)?;
        range("budget.front.edge_rays", f64::from(self.edge_rays), 0.0, 8.0)?;
        range("budget.front.k", f64::from(self.k), 1.0, 16.0)?;
        self.law.validate()
    }
}

fn usual_edge_rays() -> u32 {
    Config::default().trace.edge_rays
}

/// Refuses shares of the pixels that are not above 0 and up to 1.
pub(super) fn check_share(key: &str, share: f64) -> Result<()> {
    if share > 0.0 && share <= 1.0 {
        return Ok(());
    }
    Err(Error::setting(key, format!("{share} is no share of the pixels; give one above 0 and up to 1.0")))
}

/// Points of a front at most.
const MAX_POINTS: usize = 4096;

impl BudgetConfig {
    pub(super) fn check(&self) -> Result<()> {
        if let TargetMs::Ms(ms) = self.target_ms {
            range("budget.target_ms", ms, 0.1, 1e6)?;
        }
        range("budget.target_score", self.target_score, 0.0, 10.0)?;
        range("budget.front", self.front.len() as f64, 0.0, MAX_POINTS as f64)?;
        self.front.iter().try_for_each(OperatingPoint::check)
    }
}
