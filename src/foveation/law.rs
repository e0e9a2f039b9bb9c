//! Laws of sample density over the image.
//!
//! A law gives a relative density: only ratios between pixels count, since the number of samples is
//! given apart from it. `docs/foveation.md` tells where each law comes from.

use std::str::FromStr;

use glam::DVec2;
use serde::{Deserialize, Serialize};

use super::density::Density;
use crate::error::{Error, Result};
use crate::math::view::View;

/// How sample density falls off with distance from the gaze.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "name", rename_all = "kebab-case", deny_unknown_fields)]
pub enum Law {
    /// Fujita and Harada 2014: θ^exponent, with θ the distance from the gaze in pixels of the image
    /// plane, and uniform within a disc around the gaze.
    Paper {
        /// Power of the distance, -4 to 0. -2/3 is the paper's number read as a density over the
        /// area; -5/3 is the same number read as the density of the radii.
        #[serde(default = "paper_exponent")]
        exponent: f64,
        /// Area of the uniform disc over that of the image, 0 to 1.
        #[serde(default = "paper_centre_area")]
        centre_area: f64,
    },
    /// Guenter et al. 2012: the minimum angle of resolution grows linearly with eccentricity,
    /// ω = w0 + slope e; density per solid angle is proportional to ω^-2.
    LinearMar {
        /// Degrees of resolution lost per degree of eccentricity, 0 to 1.
        #[serde(default = "guenter_slope")]
        slope: f64,
        /// Minimum angle of resolution at the gaze in degrees, 0.001 to 10.
        #[serde(default = "guenter_w0")]
        w0: f64,
    },
    /// Meng et al. 2018: the pixel density of a log-polar buffer with kernel function K(x) = x^alpha.
    LogPolar {
        /// Power of the kernel function, 1 to 16; 1 is the classic log-polar mapping.
        #[serde(default = "meng_alpha")]
        alpha: f64,
    },
    /// The same density everywhere.
    Uniform,
    /// One sample at each pixel, whatever number is asked for: the naive method.
    Full,
}

fn paper_exponent() -> f64 {
    -2.0 / 3.0
}

fn paper_centre_area() -> f64 {
    1.0 / 15.0
}

/// The conservative slope of Guenter's user study: 1.32 arc minutes per degree.
fn guenter_slope() -> f64 {
    0.022
}

/// Foveal resolution of a healthy adult as Guenter takes it: 1/48 degree.
fn guenter_w0() -> f64 {
    1.0 / 48.0
}

/// The kernel power that Meng's user study found best.
fn meng_alpha() -> f64 {
    4.0
}

impl Default for Law {
    fn default() -> Self {
        Law::Paper { exponent: paper_exponent(), centre_area: paper_centre_area() }
    }
}

impl FromStr for Law {
    type Err = Error;

    /// The law of a name, with its default parameters.
    fn from_str(name: &str) -> Result<Self> {
        let laws = [
            Law::default(),
            Law::LinearMar { slope: guenter_slope(), w0: guenter_w0() },
            Law::LogPolar { alpha: meng_alpha() },
            Law::Uniform,
            Law::Full,
        ];
        laws.into_iter().find(|law| law.name() == name).ok_or_else(|| {
            let names = laws.map(|law| law.name()).join(", ");
            Error::setting("law", format!("there is no law {name:?}; choose one of {names}"))
        })
    }
}

impl std::fmt::Display for Law {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl Law {
    /// The name by which the law is chosen.
    pub fn name(&self) -> &'static str {
        match self {
            Law::Paper { .. } => "paper",
            Law::LinearMar { .. } => "linear-mar",
            Law::LogPolar { .. } => "log-polar",
            Law::Uniform => "uniform",
            Law::Full => "full",
        }
    }

    /// Refuses parameters outside their ranges, naming the parameter.
    pub fn validate(&self) -> Result<()> {
        let within = |key: &str, value: f64, least: f64, most: f64| {
            if (least..=most).contains(&value) {
                return Ok(());
            }
            let key = format!("law.{key}");
            Err(Error::setting(key, format!("{value} is out of range; give {least} to {most}")))
        };
        match *self {
            Law::Paper { exponent, centre_area } => {
                within("exponent", exponent, -4.0, 0.0)?;
                within("centre_area", centre_area, 0.0, 1.0)
            }
            Law::LinearMar { slope, w0 } => {
                within("slope", slope, 0.0, 1.0)?;
                within("w0", w0, 0.001, 10.0)
            }
            Law::LogPolar { alpha } => within("alpha", alpha, 1.0, 16.0),
            Law::Uniform | Law::Full => Ok(()),
        }
    }

    /// The law with a region of full density that is `factor` times as wide, for a gaze that is less
    /// certain. Laws without such a region stay as they are.
    pub fn widened(self, factor: f64) -> Law {
        match self {
            Law::Paper { exponent, centre_area } => {
                Law::Paper { exponent, centre_area: (centre_area * factor * factor).clamp(0.0, 1.0) }
            }
            Law::LinearMar { slope, w0 } => Law::LinearMar { slope, w0: (w0 * factor).clamp(0.001, 10.0) },
            other => other,
        }
    }

    /// Relative density of samples at a point of the image in pixels, above 0.
    ///
    /// `gaze` is in 0..1 of the image and may lie outside. For many pixels see [`Density`].
    pub fn density(&self, view: &View, gaze: DVec2, pixel: DVec2) -> f64 {
        Density::new(self, view, gaze).at(pixel)
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    const NAMES: [&str; 5] = ["paper", "linear-mar", "log-polar", "uniform", "full"];

    fn view() -> View {
        let fov = FieldOfView { left: -1.4, right: 1.1, up: 0.9, down: -0.8 };
        View { world_from_eye: Pose::IDENTITY, fov, width: 700, height: 500, spacing: Default::default() }
    }

    #[test]
    fn laws_are_known_by_name() {
        for name in NAMES {
            let law: Law = name.parse().unwrap();
            assert_eq!(law.to_string(), name);
            law.validate().unwrap();
            assert_eq!(toml::from_str::<Law>(&format!("name = {name:?}")).unwrap(), law);
            assert_eq!(serde_json::from_str::<Law>(&serde_json::to_string(&law).unwrap()).unwrap(), law);
        }
        let message = "papers".parse::<Law>().unwrap_err().to_string();
        assert!(message.contains("papers") && message.contains("linear-mar"), "{message}");
        assert!(toml::from_str::<Law>("name = \"paper\"\nexponents = 1").is_err());
    }

    #[test]
    fn parameters_out_of_range_are_refused_by_name() {
        let wrong = [
            ("law.exponent", Law::Paper { exponent: 0.1, centre_area: 0.1 }),
            ("law.exponent", Law::Paper { exponent: f64::NAN, centre_area: 0.1 }),
            ("law.centre_area", Law::Paper { exponent: -1.0, centre_area: 1.1 }),
            ("law.slope", Law::LinearMar { slope: -0.1, w0: 0.02 }),
            ("law.w0", Law::LinearMar { slope: 0.022, w0: 0.0 }),
            ("law.alpha", Law::LogPolar { alpha: 0.5 }),
        ];
        for (key, law) in wrong {
            let message = law.validate().unwrap_err().to_string();
            assert!(message.starts_with(key), "{message}");
        }
    }

    #[test]
    fn the_paper_law_is_level_in_its_centre_and_a_power_outside() {
        let (view, law) = (view(), Law::default());
        let radius = (700.0 * 500.0 / 15.0 / std::f64::consts::PI).sqrt();
        let at = |r: f64| law.density(&view, DVec2::splat(0.5), DVec2::new(350.0 + r, 250.0));
        assert_eq!(at(0.0), at(radius * 0.999));
        assert!((at(radius * 8.0) / at(radius) - 0.25).abs() < 1e-12);
    }

    #[test]
    fn linear_mar_density_per_solid_angle_is_a_quarter_where_resolution_is_half() {
        // Straight ahead a pixel's solid angle is that of the gaze; with w0 = slope e the angle of
        // resolution is twice that at the gaze. Aside, the pixel is smaller by cos³.
        let (view, law) = (view(), Law::LinearMar { slope: 0.02, w0: 0.4 });
        let gaze = view.optical_centre();
        let pixel = view.project(DVec3::new(20f64.to_radians().tan(), 0.0, -1.0)).unwrap();
        let size = DVec2::new(700.0, 500.0);
        let ratio = law.density(&view, gaze, pixel) / law.density(&view, gaze, gaze * size);
        assert!((ratio - 0.25 * 20f64.to_radians().cos().powi(3)).abs() < 1e-12, "{ratio}");
    }

    #[test]
    fn a_widened_law_is_level_further_out() {
        let (view, gaze) = (view(), DVec2::splat(0.5));
        for name in ["paper", "linear-mar"] {
            let law: Law = name.parse().unwrap();
            let fall = |law: Law| {
                law.density(&view, gaze, DVec2::new(550.0, 250.0))
                    / law.density(&view, gaze, DVec2::new(350.0, 250.0))
            };
            assert!(fall(law.widened(2.0)) > fall(law) * 1.1, "{name}");
            law.widened(1e9).validate().unwrap();
            assert_eq!(law.widened(1.0), law);
        }
    }
}
