//! Light in a spherical atmosphere of air, aerosols and ozone. Lengths are in km; light is per unit of
//! solar irradiance above the atmosphere.
//!
//! Coefficients of air and ozone at 680, 550 and 440 nm as in Hillaire 2020, table 1 (after Bruneton and
//! Neyret 2008). Aerosols get what turbidity demands at 550 nm, and the Ångström exponent 1.3.

use std::f64::consts::PI;

use glam::DVec3;
use rayon::prelude::*;

const GROUND: f64 = 6360.0;
const THICKNESS: f64 = 100.0;
const AIR_HEIGHT: f64 = 8.0;
const HAZE_HEIGHT: f64 = 1.2;
const AIR_SCATTERING: DVec3 = DVec3::new(5.802e-3, 13.558e-3, 33.1e-3);
const OZONE_ABSORPTION: DVec3 = DVec3::new(0.650e-3, 1.881e-3, 0.085e-3);
/// (wavelength / 550 nm)^-1.3.
const HAZE_COLOUR: DVec3 = DVec3::new(0.759, 1.0, 1.336);
/// Part of the light that haze takes out and scatters; the rest is absorbed.
const HAZE_ALBEDO: f64 = 0.92;
/// Mean cosine of scattering by haze.
const HAZE_ASYMMETRY: f64 = 0.78;

const VIEW_STEPS: usize = 32;

/// Scattering and extinction at one height.
struct Medium {
    air: DVec3,
    haze: DVec3,
    extinction: DVec3,
}

/// A table over height and the cosine of the sun's zenith angle, bilinear between its entries.
#[derive(Default)]
struct Table {
    heights: usize,
    cosines: usize,
    entries: Vec<DVec3>,
}

impl Table {
    /// Heights grow quadratically from the ground; cosines run from [`Table::LOWEST`] to 1.
    const LOWEST: f64 = -0.2;

    fn new(heights: usize, cosines: usize, entry: impl Fn(f64, f64) -> DVec3 + Sync) -> Self {
        let height = |i: usize| THICKNESS * (i as f64 / (heights - 1) as f64).powi(2);
        let cosine = |i: usize| Self::LOWEST + (1.0 - Self::LOWEST) * i as f64 / (cosines - 1) as f64;
        let entries = (0..heights * cosines)
            .into_par_iter()
            .map(|i| entry(height(i / cosines), cosine(i % cosines)))
            .collect();
        Table { heights, cosines, entries }
    }

    fn read(&self, height: f64, cosine: f64) -> DVec3 {
        let cell = |position: f64, count: usize| {
            let scaled = position.clamp(0.0, 1.0) * (count - 1) as f64;
            let index = (scaled as usize).min(count - 2);
            (index, scaled - index as f64)
        };
        let (y, fy) = cell((height.max(0.0) / THICKNESS).sqrt(), self.heights);
        let (x, fx) = cell((cosine - Self::LOWEST) / (1.0 - Self::LOWEST), self.cosines);
        let row = |y: usize| {
            let at = y * self.cosines + x;
            self.entries[at].lerp(self.entries[at + 1], fx)
        };
        row(y).lerp(row(y + 1), fy)
    }
}

/// An atmosphere over ground of one albedo.
pub(super) struct Atmosphere {
    haze: DVec3,
    albedo: f64,
    /// Transmittance from a height to space; 0 behind the planet.
    to_space: Table,
    /// Radiance from light scattered more than once, per unit of scattering coefficient.
    multiple: Table,
}

impl Atmosphere {
    pub(super) fn new(turbidity: f64, albedo: f64) -> Self {
        // Turbidity 1 is air alone; vertical optical thickness is coefficient times scale height.
        let haze = (turbidity - 1.0) * AIR_SCATTERING.y * AIR_HEIGHT / HAZE_HEIGHT;
        let mut made = Atmosphere {
            haze: haze * HAZE_COLOUR,
            albedo,
            to_space: Table::default(),
            multiple: Table::default(),
        };
        made.to_space = Table::new(48, 128, |height, cosine| made.march_to_space(height, cosine));
        made.multiple = Table::new(12, 24, |height, cosine| made.scattered_often(height, cosine));
        made
    }

    /// Part of the sun's light that arrives at `height` when its zenith angle has this cosine.
    pub(super) fn transmittance(&self, height: f64, cosine: f64) -> DVec3 {
        self.march_to_space(height, cosine)
    }

    /// Radiance that arrives at `height` from the unit vector `view` (+Y is up); `sun` is the unit vector
    /// towards the sun, `ground` the radiance of the ground.
    pub(super) fn radiance(&self, height: f64, view: DVec3, sun: DVec3, ground: DVec3) -> DVec3 {
        let cosine = view.dot(sun);
        let phases = (air_phase(cosine), haze_phase(cosine));
        let mut sum = DVec3::ZERO;
        let through = self.march(height, view, VIEW_STEPS, |medium, height, up, weight| {
            let cosine = up.dot(sun);
            let direct =
                self.to_space.read(height, cosine) * (medium.air * phases.0 + medium.haze * phases.1);
            let often = self.multiple.read(height, cosine) * (medium.air + medium.haze);
            sum += (direct + often) * weight;
        });
        if ground_distance(height, view.y).is_some() { sum + through * ground } else { sum }
    }

    fn medium(&self, height: f64) -> Medium {
        let air = AIR_SCATTERING * (-height / AIR_HEIGHT).exp();
        let haze = self.haze * (-height / HAZE_HEIGHT).exp();
        let ozone = OZONE_ABSORPTION * (1.0 - (height - 25.0).abs() / 15.0).max(0.0);
        Medium { air, haze: haze * HAZE_ALBEDO, extinction: air + haze + ozone }
    }

    /// Walks from `height` along `view` to the ground or to space. `visit` gets the medium, the height, the
    /// local up and the weight of light scattered there: transmittance integrated over the step (Hillaire
    /// 2015). Returns the transmittance of the whole way.
    fn march(
        &self,
        height: f64,
        view: DVec3,
        steps: usize,
        mut visit: impl FnMut(&Medium, f64, DVec3, DVec3),
    ) -> DVec3 {
        let length = ground_distance(height, view.y)
            .unwrap_or_else(|| sphere_exit(height, view.y, GROUND + THICKNESS));
        let start = DVec3::Y * (GROUND + height);
        let mut through = DVec3::ONE;
        // The air is thickest near the eye: steps grow with distance.
        let at = |i: f64| length * (i / steps as f64).powi(2);
        for i in 0..steps {
            let (step, middle) = (at(i as f64 + 1.0) - at(i as f64), at(i as f64 + 0.5));
            let position = start + view * middle;
            let radius = position.length();
            let height = (radius - GROUND).max(0.0);
            let medium = self.medium(height);
            let passed = (medium.extinction * -step).exp();
            visit(
                &medium,
                height,
                position / radius,
                through * (1.0 - passed) / medium.extinction.max(DVec3::splat(1e-12)),
            );
            through *= passed;
        }
        through
    }

    fn march_to_space(&self, height: f64, cosine: f64) -> DVec3 {
        if ground_distance(height, cosine).is_some() {
            return DVec3::ZERO;
        }
        let direction = DVec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), cosine, 0.0);
        self.march(height, direction, 40, |_, _, _, _| {})
    }

    /// Hillaire 2020, section 5.5: light scattered twice, times the sum of the series of all further
    /// bounces, both taken as coming evenly from all sides.
    fn scattered_often(&self, height: f64, cosine: f64) -> DVec3 {
        const DIRECTIONS: usize = 8;
        let sun = DVec3::new((1.0 - cosine * cosine).max(0.0).sqrt(), cosine, 0.0);
        let (mut second, mut again) = (DVec3::ZERO, DVec3::ZERO);
        for i in 0..DIRECTIONS * DIRECTIONS {
            let y = 1.0 - 2.0 * ((i / DIRECTIONS) as f64 + 0.5) / DIRECTIONS as f64;
            let (sin, cos) = (2.0 * PI * ((i % DIRECTIONS) as f64 + 0.5) / DIRECTIONS as f64).sin_cos();
            let across = (1.0 - y * y).sqrt();
            let view = DVec3::new(across * cos, y, across * sin);
            let through = self.march(height, view, 16, |medium, height, up, weight| {
                let scattering = medium.air + medium.haze;
                second += self.to_space.read(height, up.dot(sun)) * scattering * weight / (4.0 * PI);
                again += scattering * weight;
            });
            if let Some(distance) = ground_distance(height, view.y) {
                let up = (DVec3::Y * (GROUND + height) + view * distance).normalize();
                let cosine = up.dot(sun);
                second += through * self.to_space.read(0.0, cosine) * cosine.max(0.0) * self.albedo / PI;
            }
        }
        let count = (DIRECTIONS * DIRECTIONS) as f64;
        second / count / (1.0 - again / count)
    }
}

/// Distance from `height` to the ground along a direction with this cosine to the zenith.
fn ground_distance(height: f64, cosine: f64) -> Option<f64> {
    let radius = GROUND + height;
    let root = radius * radius * (cosine * cosine - 1.0) + GROUND * GROUND;
    (cosine < 0.0 && root >= 0.0).then(|| -radius * cosine - root.sqrt())
}

/// Distance from a point inside a sphere of radius `outer` to the sphere.
fn sphere_exit(height: f64, cosine: f64, outer: f64) -> f64 {
    let radius = GROUND + height;
    let root = radius * radius * (cosine * cosine - 1.0) + outer * outer;
    -radius * cosine + root.max(0.0).sqrt()
}

/// Rayleigh's phase function.
fn air_phase(cosine: f64) -> f64 {
    3.0 / (16.0 * PI) * (1.0 + cosine * cosine)
}

/// Cornette and Shanks's phase function, 1992.
fn haze_phase(cosine: f64) -> f64 {
    let g = HAZE_ASYMMETRY;
    3.0 / (8.0 * PI) * (1.0 - g * g) * (1.0 + cosine * cosine)
        / ((2.0 + g * g) * (1.0 + g * g - 2.0 * g * cosine).powf(1.5))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn phase_functions_integrate_to_one() {
        for phase in [air_phase, haze_phase] {
            let n = 20_000;
            let mean = |i: i32| phase(-1.0 + 2.0 * (f64::from(i) + 0.5) / f64::from(n));
            let total: f64 = (0..n).map(mean).sum::<f64>() * 4.0 * PI / f64::from(n);
            assert!((total - 1.0).abs() < 1e-4, "{total}");
        }
    }

    #[test]
    fn vertical_transmittance_is_the_closed_form() {
        let atmosphere = Atmosphere::new(1.0, 0.0);
        // The whole column: exponential air without the part above the top, and the ozone's triangle.
        let air = AIR_SCATTERING * AIR_HEIGHT * (1.0 - (-THICKNESS / AIR_HEIGHT).exp());
        let expected = (-(air + OZONE_ABSORPTION * 15.0)).exp();
        let got = atmosphere.transmittance(0.0, 1.0);
        assert!((got - expected).abs().max_element() < 2e-3, "{got} {expected}");
    }

    #[test]
    fn no_light_passes_the_planet() {
        let atmosphere = Atmosphere::new(2.0, 0.3);
        assert_eq!(atmosphere.transmittance(0.0, -0.1), DVec3::ZERO);
        assert!(atmosphere.transmittance(60.0, -0.05).max_element() > 0.0);
    }
}
