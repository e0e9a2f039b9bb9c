//! What is refused: values out of range, pictures too large, more samples than pixels.

use super::{Config, Samples, Stereo, ViewConfig, budget};
use crate::error::{Error, Result};
use crate::metrics::picture::MAX_PIXELS;

/// Pixels along a side of a picture at most.
const MAX_SIDE: u32 = 16_384;

impl Config {
    /// Each key by itself.
    pub(super) fn check_keys(&self) -> Result<()> {
        let whole = |key: &str, value: u32, least: u32, most: u32| {
            range(key, f64::from(value), f64::from(least), f64::from(most))
        };
        self.scene.check()?;
        let view = &self.view;
        whole("view.width", view.width, 1, MAX_SIDE)?;
        whole("view.height", view.height, 1, MAX_SIDE)?;
        range("view.ipd", view.ipd, 0.0, 1.0)?;
        range("view.fov_y", view.fov_y, 1.0, 175.0)?;
        range("view.exposure", view.exposure.fixed(), -40.0, 40.0)?;
        let [least, most] = view.exposure_range;
        range("view.exposure_range", least, -40.0, 40.0)?;
        range("view.exposure_range", most, least, 40.0)?;
        self.foveation.law.validate()?;
        let slope = self.foveation.visibility_slope;
        if !(0.0..=1.0).contains(&slope) {
            let problem = format!("it is {slope}, and has to be from 0 to 1 degree per degree");
            return Err(Error::setting("foveation.visibility_slope", problem));
        }
        if let Samples::Share(share) = self.foveation.samples {
            budget::check_share("foveation.samples", share)?;
        }
        self.budget.check()?;
        whole("trace.rays", self.trace.rays, 1, 4096)?;
        whole("trace.bounces", self.trace.bounces, 0, 4)?;
        whole("trace.edge_rays", self.trace.edge_rays, 0, 8)?;
        self.trace.check()?;
        whole("reconstruction.k", self.reconstruction.k, 1, 16)?;
        whole("time.frames", self.time.frames, 1, 256)?;
        whole("time.pictures", self.time.pictures, 1, 64)?;
        range("time.rays", self.time.rays, 0.01, 1.0)?;
        range("time.rays_in_motion", self.time.rays_in_motion, 0.01, 1.0)?;
        range("time.samples_in_motion", self.time.samples_in_motion, 0.1, 1.0)?;
        range("time.samples", self.time.samples, 0.01, 1.0)?;
        let environment = &self.environment;
        range("environment.exposure", environment.exposure, -40.0, 40.0)?;
        range("environment.sun_elevation", f64::from(environment.sun_elevation), -10.0, 90.0)?;
        range("environment.sun_azimuth", f64::from(environment.sun_azimuth), -360.0, 360.0)?;
        range("environment.turbidity", f64::from(environment.turbidity), 1.0, 10.0)?;
        environment.check_day()?;
        range("dk1.resolution", self.dk1.resolution, 0.05, 2.0)?;
        range("headset.margin", self.headset.margin, 0.0, 0.25)?;
        range("headset.refresh_hz", self.headset.refresh_hz, 0.0, 1000.0)?;
        range("headset.speed", self.headset.speed, 0.0, 100.0)?;
        range("headset.turn_degrees", self.headset.turn_degrees, 0.0, 360.0)
    }

    /// Memory for pixels is reserved before anything is traced, so absurd numbers are refused first.
    pub(super) fn check_size(&self) -> Result<()> {
        let ViewConfig { width, height, stereo, .. } = self.view;
        if width as usize * height as usize > MAX_PIXELS {
            let problem =
                format!("{width}x{height} are more than {MAX_PIXELS} pixels; give a smaller picture");
            return Err(Error::setting("view.width", problem));
        }
        if stereo != Stereo::Mono && !width.is_multiple_of(2) {
            return Err(Error::setting("view.width", "both eyes share it with stereo; give an even number"));
        }
        Ok(())
    }

    pub(super) fn check_samples(&self) -> Result<()> {
        let ViewConfig { width, height, stereo, .. } = self.view;
        let (across, whose) = if stereo == Stereo::Mono { (width, "") } else { (width / 2, " of each eye") };
        let pixels = across as usize * height as usize;
        match self.foveation.samples {
            Samples::Count(count) if count > pixels => Err(Error::setting(
                "foveation.samples",
                format!("{count} are more than the {pixels} pixels{whose}; give at most that, or full"),
            )),
            _ => Ok(()),
        }
    }
}

pub(super) fn range(key: &str, value: f64, least: f64, most: f64) -> Result<()> {
    if (least..=most).contains(&value) {
        return Ok(());
    }
    Err(Error::setting(key, format!("{value} is out of range; give {least} to {most}")))
}
