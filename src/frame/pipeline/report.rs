//! What a frame did, and what its picture's numbers are.

use crate::frame::scheduler::DeviceShare;

/// What the finished picture's numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// Tone-mapped sRGB, four bytes a pixel.
    Display,
    /// Linear radiance, four floats a pixel.
    Radiance,
}

/// Milliseconds of each stage of a frame, summed over its views.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct StageMs {
    /// Bringing what moves to the frame's instant, before its first view.
    #[serde(default)]
    pub motion: f64,
    /// Camera rays and, for guided reconstruction, what pixels see: device time of the slowest device.
    pub trace: f64,
    /// Shading with all light rays: device time of the slowest device.
    pub shade: f64,
    /// Keeping the cache of light: device time of the slowest device.
    #[serde(default)]
    pub light: f64,
    /// Getting samples from OpenCL to Vulkan, on the slowest device.
    pub share: f64,
    /// Samples to pixels: device time.
    pub reconstruct: f64,
}

/// What a frame did.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize)]
pub struct FrameReport {
    /// Samples of all views.
    pub samples: usize,
    /// Whether some of them waited for their turn to be shaded ([`crate::config::TimeConfig::samples`]): then the frame tells
    /// nothing of what others take.
    pub rests: bool,
    /// Traced rays.
    pub rays: u64,
    /// Samples dropped since their estimate was not finite.
    pub dropped: u32,
    /// New sample patterns that the frame made, since gaze or view had changed: milliseconds on the host, and of finding
    /// neighbours on the presenting device, which goes on beside tracing.
    pub pattern_ms: f64,
    /// Wall time from start to finished pixels, with what bringing things that move to its instant took before.
    pub frame_ms: f64,
    /// Stops by which its pictures were brightened, where exposure is automatic.
    pub exposure: Option<f64>,
    /// Where it went.
    pub stages: StageMs,
    /// What each OpenCL device did, in the order in which they were given.
    pub devices: Vec<DeviceShare>,
}
