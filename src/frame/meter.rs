//! Automatic exposure of a renderer's frames: what their samples see, read from where they are handed to
//! Vulkan.
//!
//! [`Meter`] looks at some of the samples, and `Exposure` (`src/frame/exposure.rs`) makes of that how bright
//! the next frame is shown: docs/light.md.

use std::collections::VecDeque;
use std::time::Instant;

use glam::Vec3;

use super::exposure::{Exposure, stops_for};
use super::pipeline::Output;
use crate::config::{ExposureConfig, ViewConfig};
use crate::layout::{
    SAMPLE_REUSES, SUN_VISIBLE, SampleRecord, VisibilityRecord, unpack_emission, unpack_normal24,
    unpack_surface,
};
use crate::scene::Sun;
use crate::scene::environment::luminance;
use crate::trace::SampleTarget;

/// Samples that a view is metered by: enough that their noise is a few hundredths of a stop.
const METERED: usize = 1024;

/// Exposes frames by what they see, where that is asked for.
#[derive(Debug)]
pub struct Meter {
    exposure: Option<Exposure>,
    /// Luminances of some samples in the last frame, and in those before it while samples took turns.
    seen: VecDeque<Vec<f32>>,
    last: Option<Instant>,
    /// Seconds between the last two frames.
    passed: f64,
    pace: Option<f64>,
}

/// A view's samples.
pub(super) struct Metered<'a> {
    /// Where they are.
    pub sample_target: &'a SampleTarget,
    /// The positions of their pixels, `x | y << 16`.
    pub samples: &'a [u32],
    /// Pixels across.
    pub width: u32,
    /// Of so many groups of samples one is shaded; 1: all are.
    pub turns: usize,
}

impl Meter {
    /// Does nothing where exposure is fixed, or pictures hold radiance.
    pub(super) fn new(view: &ViewConfig, output: Output) -> Self {
        let wanted = view.exposure == ExposureConfig::Auto && output == Output::Display;
        let exposure = wanted.then(|| Exposure::within(view.exposure_range));
        Meter { exposure, seen: VecDeque::new(), last: None, passed: 0.0, pace: None }
    }

    /// The stops for the next picture; `None` where exposure is fixed, or nothing was metered yet.
    pub fn stops(&self) -> Option<f64> {
        self.exposure.as_ref().and_then(Exposure::shown)
    }

    /// Frames are shown so many seconds apart from now on, however long they take.
    pub fn set_pace(&mut self, seconds: f64) {
        self.pace = Some(seconds);
    }

    /// The exposure stays as it is from now on, or follows again; tells which. Nothing where it is fixed.
    pub fn toggle_lock(&mut self) -> Option<bool> {
        let exposure = self.exposure.as_mut()?;
        exposure.lock(!exposure.is_locked());
        Some(exposure.is_locked())
    }

    /// A frame begins.
    pub(super) fn begin(&mut self, now: Instant) {
        let last = self.last.replace(now);
        let passed = last.map_or(0.0, |last| now.duration_since(last).as_secs_f64());
        self.passed = self.pace.unwrap_or(passed);
    }

    /// Meters what views see, for the pictures to come: where samples take turns, by as many frames as each of them needs to
    /// have its own.
    pub(super) fn observe<'a>(&mut self, views: impl Iterator<Item = Metered<'a>>, sun: Option<Sun>) {
        let Some(exposure) = &mut self.exposure else { return };
        let views: Vec<Metered> = views.collect();
        let turns = views.iter().map(|view| view.turns).max().unwrap_or(1);
        self.seen.truncate(turns - 1);
        self.seen.push_front(views.iter().flat_map(|view| view.luminances(sun)).collect());
        exposure.observe(stops_for(self.seen.iter().flatten().copied().collect()), self.passed);
    }
}

impl Metered<'_> {
    /// Luminances of some samples, evenly from all of them, which lie as densely as the wearer sees.
    fn luminances(&self, sun: Option<Sun>) -> Vec<f32> {
        let step = self.samples.len().div_ceil(METERED).max(1);
        let records = self.sample_target.samples.sparse(self.samples.len(), step);
        let radiances: Vec<Vec3> = match &self.sample_target.visibility {
            None => records.iter().map(|record| Vec3::from(record.first)).collect(),
            Some(visibility) => {
                let pixel = |at: &u32| (at >> 16) as usize * self.width as usize + (at & 0xffff) as usize;
                let seen = visibility.at(self.samples.iter().step_by(step).map(pixel));
                let shaded = records.iter().zip(&seen).filter(|(sample, _)| is_shaded(sample));
                shaded.map(|(sample, seen)| guided(sample, seen, sun)).collect()
            }
        };
        radiances.into_iter().map(|radiance| luminance(radiance) as f32).collect()
    }
}

/// Whether it is one that this frame has found light for, and not one that waits for its turn ([`SAMPLE_REUSES`]).
fn is_shaded(sample: &SampleRecord) -> bool {
    sample.toward[0] & SAMPLE_REUSES == 0 || sample.depth > 0.0
}

/// The radiance of a guided sample at its own pixel, with what it reflects of the sun diffusely: highlights would
/// not count.
fn guided(sample: &SampleRecord, seen: &VisibilityRecord, sun: Option<Sun>) -> Vec3 {
    let emission = Vec3::from(unpack_emission(seen.emission));
    if seen.depth <= 0.0 {
        return emission;
    }
    let (base, metallic, _) = unpack_surface([seen.base, seen.surface]);
    let (diffuse, f0) = (Vec3::from(base) * (1.0 - metallic), Vec3::splat(0.04).lerp(base.into(), metallic));
    let reflected = diffuse * Vec3::from(sample.first) + f0 * Vec3::from(sample.second) + emission;
    match sun {
        Some(sun) if seen.normal & SUN_VISIBLE != 0 => {
            let cosine = Vec3::from(unpack_normal24(seen.mapped)).dot(sun.direction).max(0.0);
            let irradiance = sun.radiance * sun.solid_angle() as f32 * cosine;
            reflected + diffuse * irradiance / std::f32::consts::PI
        }
        _ => reflected,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::layout::{pack_emission, pack_normal24, pack_surface};

    #[test]
    fn samples_that_wait_for_their_turn_are_not_metered() {
        let of =
            |mark: u32, depth: f32| SampleRecord { toward: [mark, 0, 0], depth, ..SampleRecord::default() };
        assert!(is_shaded(&of(0, 2.0)) && is_shaded(&of(0, 0.0)), "what sees the background has its light");
        assert!(is_shaded(&of(SAMPLE_REUSES, 2.0)), "what is sent fewer rays has light");
        assert!(!is_shaded(&of(SAMPLE_REUSES, -2.0)));
    }

    #[test]
    fn guided_samples_are_metered_with_their_sun() {
        let sample =
            SampleRecord { first: [1.0; 3], second: [2.0; 3], depth: 1.0, ..SampleRecord::default() };
        let [base, surface] = pack_surface([0.25; 3], 0.4, 0.5);
        let seen = VisibilityRecord {
            normal: pack_normal24([0.0, 1.0, 0.0]) | SUN_VISIBLE,
            depth: 1.0,
            base,
            surface,
            emission: pack_emission([0.5; 3]),
            mapped: pack_normal24([0.0, 0.6, 0.8]),
            reflected: 0,
        };
        let sun =
            Sun { direction: Vec3::new(0.0, 0.0, 1.0), cos_radius: 0.999, radiance: Vec3::splat(100.0) };
        let plain = 0.15 + 2.0 * (0.04 * 0.6 + 0.25 * 0.4) + 0.5;
        let sunlit = plain + 0.15 * 100.0 * sun.solid_angle() as f32 * 0.8 / std::f32::consts::PI;
        let close = |found: Vec3, expected: f32| assert!((found.x / expected - 1.0).abs() < 5e-3, "{found}");
        close(guided(&sample, &seen, None), plain);
        close(guided(&sample, &seen, Some(sun)), sunlit);
        let shadow = VisibilityRecord { normal: seen.normal ^ SUN_VISIBLE, ..seen };
        close(guided(&sample, &shadow, Some(sun)), plain);
        close(guided(&sample, &VisibilityRecord { depth: 0.0, ..seen }, Some(sun)), 0.5);
    }
}
