//! Pictures that follow each other: what earlier frames are worth, at rest and in motion.
//!
//! The sweep judges frames one by one. An eye sees more than any one of them shows: noise that boils, ghosts of what
//! stood before, light that lags. So some variants of the settings are run along motions ([`Motion`]), and the last
//! frames of each are compared with references of their own. Frames are judged at each display beat, however long they
//! take here.

mod course;
mod measured;
mod scenery;
mod table;

pub use course::{Course, Motion};
pub(super) use measured::{judge, run, variants};
pub(super) use scenery::prepare;
pub(super) use table::{csv, html};

use serde::{Deserialize, Serialize};

use crate::metrics::temporal::BANDS;
use crate::metrics::uncovered::AGES;

/// How pictures of one motion are, made in one way: means over the frames that are judged.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Sequence {
    /// How they are made.
    pub name: String,
    /// The motion.
    pub motion: Motion,
    /// Frames before the first that is judged: so long is their past.
    pub history: u32,
    /// Frames that are judged.
    pub frames: u32,
    /// Median milliseconds of these.
    pub frame_ms: f64,
    /// Rays of one, for pixels and for light.
    pub rays: u64,
    /// Score of the foveated difference, which knows no time.
    pub foveated_score: f64,
    /// PSNR of what a screen shows, decibels.
    pub psnr_display: f64,
    /// [`crate::metrics::temporal::low_pass_flicker`], sRGB codes of 0..255.
    pub low_pass_flicker: f64,
    /// [`crate::metrics::temporal::flicker_by_eccentricity`], in the first eye's picture.
    pub flicker_by_eccentricity: [Option<f64>; BANDS.len()],
    /// [`crate::metrics::uncovered::error_by_age`] in the first eye's picture; absent where nothing is uncovered.
    pub uncovered: Option<[Option<f64>; AGES + 1]>,
    /// [`crate::metrics::temporal::lag`], frames; absent where the scene stands still or nothing is reused.
    pub lag: Option<f64>,
    /// Difference of both eyes' errors in sRGB codes of 0..1; absent for one eye.
    pub disagreement: Option<f64>,
}
