//! An analytic clear sky: a physical atmosphere, baked to a map, and its sun apart from it.

mod atmosphere;
pub mod day;

use std::f64::consts::{PI, TAU};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::environment::{Environment, Sun};
use atmosphere::Atmosphere;

/// A clear sky. Values out of range are clamped to it; values that are no numbers become the default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sky {
    /// The sun's centre above the horizon in degrees, -10 to 90. Once the sun is a radius below the
    /// horizon only its twilight is left; while it touches it, it has the light of its part above.
    pub sun_elevation_deg: f32,
    /// Its direction in degrees clockwise seen from above: 0 is -Z, 90 is +X.
    pub sun_azimuth_deg: f32,
    /// Optical thickness of air and haze over that of air alone (Preetham et al. 1999), 1 to 10: 2 is a
    /// very clear day, 6 a hazy one.
    pub turbidity: f32,
    /// Diffuse reflectance of the ground below the horizon, 0 to 1.
    pub ground_albedo: f32,
}

impl Default for Sky {
    fn default() -> Self {
        Sky { sun_elevation_deg: 55.0, sun_azimuth_deg: 30.0, turbidity: 2.5, ground_albedo: 0.25 }
    }
}

/// Angular radius of the sun in degrees.
const SUN_RADIUS_DEG: f64 = 0.2665;

/// Height of the eye above the ground in km. Enough for haze to soften the horizon from both sides.
const EYE_HEIGHT: f64 = 0.2;

/// Radiance per unit of solar irradiance above the atmosphere: makes the radiance that a white diffuse
/// horizontal surface reflects, under sun and sky, 1 for the default sky with the sun at 45 degrees. It is
/// the same for all skies, so that evenings are darker than noons; a test holds it.
const SCALE: f64 = 5.054;

const WIDTH: u32 = 512;
const HEIGHT: u32 = 256;

/// Columns of the table over the angle between view and sun azimuth, 0 to π inclusive.
const AZIMUTHS: usize = 129;

impl Sky {
    /// The map, 512x256, with the sun apart ([`Environment::sun`]; `None` once it is below the horizon).
    ///
    /// The model is single scattering by air and aerosols (Nishita et al., "Display of the Earth Taking
    /// into Account Atmospheric Scattering", 1993), with absorption by ozone, plus light scattered more
    /// than once as in Hillaire, "A Scalable and Production Ready Sky and Atmosphere Rendering
    /// Technique", 2020, section 5.5: without it horizons are too dark and too orange. Below the horizon is
    /// diffuse ground, seen through the air in front of it. Scaled so that a horizontal white diffuse surface
    /// reflects a radiance of 1 at 45 degrees of sun elevation.
    pub fn bake(&self) -> Environment {
        let sky = self.sanitised();
        let atmosphere = sky.atmosphere();
        Environment {
            width: WIDTH,
            height: HEIGHT,
            texels: unroll(&sky.rows(&atmosphere), f64::from(sky.sun_azimuth_deg).to_radians()),
            sun: sky.sun(&atmosphere),
        }
    }

    fn atmosphere(&self) -> Atmosphere {
        Atmosphere::new(f64::from(self.turbidity), f64::from(self.ground_albedo))
    }

    /// For each row of the map the radiance at [`AZIMUTHS`] angles from the sun's azimuth, before [`SCALE`].
    fn rows(&self, atmosphere: &Atmosphere) -> Vec<Vec<DVec3>> {
        let sun = self.sun_direction();
        let upper = table_rows(atmosphere, sun, 0..HEIGHT / 2, DVec3::ZERO);
        let sky_irradiance = horizontal_irradiance(&upper);
        let sun_irradiance = atmosphere.transmittance(0.0, sun.y) * sun.y.max(0.0);
        let ground = (sky_irradiance + sun_irradiance) * f64::from(self.ground_albedo) / PI;
        let lower = table_rows(atmosphere, sun, HEIGHT / 2..HEIGHT, ground);
        upper.into_iter().chain(lower).collect()
    }

    /// Unit direction towards the sun's centre.
    pub fn sun_direction(&self) -> DVec3 {
        let (sin_el, cos_el) = f64::from(self.sun_elevation_deg).to_radians().sin_cos();
        let (sin_az, cos_az) = f64::from(self.sun_azimuth_deg).to_radians().sin_cos();
        DVec3::new(cos_el * sin_az, sin_el, -cos_el * cos_az)
    }

    fn sanitised(&self) -> Sky {
        let sane = |value: f32, default: f32, low: f32, high: f32| {
            if value.is_finite() { value.clamp(low, high) } else { default }
        };
        let default = Sky::default();
        Sky {
            sun_elevation_deg: sane(self.sun_elevation_deg, default.sun_elevation_deg, -10.0, 90.0),
            sun_azimuth_deg: sane(self.sun_azimuth_deg, default.sun_azimuth_deg, -1e4, 1e4),
            turbidity: sane(self.turbidity, default.turbidity, 1.0, 10.0),
            ground_albedo: sane(self.ground_albedo, default.ground_albedo, 0.0, 1.0),
        }
    }

    /// The sun as seen through the atmosphere.
    fn sun(&self, atmosphere: &Atmosphere) -> Option<Sun> {
        if f64::from(self.sun_elevation_deg) <= -SUN_RADIUS_DEG {
            return None;
        }
        // A sun that touches the horizon is lit like its upper part.
        let sine = self.sun_direction().y.max(SUN_RADIUS_DEG.to_radians() / 2.0);
        let risen = risen(f64::from(self.sun_elevation_deg) / SUN_RADIUS_DEG);
        let mut sun = Sun {
            direction: self.sun_direction().as_vec3().normalize(),
            cos_radius: SUN_RADIUS_DEG.to_radians().cos() as f32,
            radiance: Vec3::ZERO,
        };
        sun.radiance = (atmosphere.transmittance(0.0, sine) * risen * SCALE / sun.solid_angle()).as_vec3();
        Some(sun)
    }
}

/// The part of a disc above a line that its centre is so many radii above: a circle's segment.
fn risen(radii: f64) -> f64 {
    let x = radii.clamp(-1.0, 1.0);
    1.0 - (x.acos() - x * (1.0 - x * x).sqrt()) / PI
}

/// Sine of the elevation of the centres of the map's row `y`.
fn row_sine(y: u32) -> f64 {
    (PI * (f64::from(y) + 0.5) / f64::from(HEIGHT)).cos()
}

/// Radiance for each row and each of [`AZIMUTHS`] angles from the sun's azimuth; `ground` is the radiance
/// of the ground.
fn table_rows(
    atmosphere: &Atmosphere,
    sun: DVec3,
    rows: std::ops::Range<u32>,
    ground: DVec3,
) -> Vec<Vec<DVec3>> {
    let sun = DVec3::new((1.0 - sun.y * sun.y).max(0.0).sqrt(), sun.y, 0.0);
    rows.into_par_iter()
        .map(|y| {
            let sine = row_sine(y);
            let cosine = (1.0 - sine * sine).max(0.0).sqrt();
            let column = |i: usize| {
                let (sin, cos) = (PI * i as f64 / (AZIMUTHS - 1) as f64).sin_cos();
                atmosphere.radiance(EYE_HEIGHT, DVec3::new(cosine * cos, sine, cosine * sin), sun, ground)
            };
            (0..AZIMUTHS).map(column).collect()
        })
        .collect()
}

/// Irradiance of a horizontal surface by the upper half of the sky.
fn horizontal_irradiance(upper: &[Vec<DVec3>]) -> DVec3 {
    let edge = |y: usize| (PI * y as f64 / f64::from(HEIGHT)).cos();
    let mut sum = DVec3::ZERO;
    for (y, row) in upper.iter().enumerate() {
        // The mean over azimuth by the trapezoidal rule: both ends count half.
        let inner: DVec3 = row[1..AZIMUTHS - 1].iter().sum();
        let mean = (inner + (row[0] + row[AZIMUTHS - 1]) * 0.5) / (AZIMUTHS - 1) as f64;
        sum += mean * TAU * row_sine(y as u32) * (edge(y) - edge(y + 1));
    }
    sum
}

/// The map's texels from the table, which only knows angles from the sun's azimuth.
fn unroll(rows: &[Vec<DVec3>], sun_azimuth: f64) -> Vec<Vec3> {
    let columns: Vec<(usize, f64)> = (0..WIDTH)
        .map(|x| {
            let azimuth = ((f64::from(x) + 0.5) / f64::from(WIDTH) - 0.5) * TAU;
            let apart = (azimuth - sun_azimuth + PI).rem_euclid(TAU) - PI;
            let position = apart.abs() / PI * (AZIMUTHS - 1) as f64;
            let index = (position as usize).min(AZIMUTHS - 2);
            (index, position - index as f64)
        })
        .collect();
    let texel = |row: &[DVec3], (i, t): (usize, f64)| (row[i].lerp(row[i + 1], t) * SCALE).as_vec3();
    rows.iter().flat_map(|row| columns.iter().map(|&c| texel(row, c))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(elevation: f32) -> Sky {
        Sky { sun_elevation_deg: elevation, ..Sky::default() }
    }

    /// What a white diffuse surface facing up reflects under `environment`.
    fn reflected(environment: &Environment) -> DVec3 {
        let mut sum = DVec3::ZERO;
        for y in 0..environment.height / 2 {
            let weight = environment.texel_solid_angle(y) * row_sine(y);
            for x in 0..environment.width {
                sum += environment.texel(i64::from(x), i64::from(y)).as_dvec3() * weight;
            }
        }
        if let Some(sun) = environment.sun {
            sum += sun.radiance.as_dvec3() * sun.solid_angle() * f64::from(sun.direction.y.max(0.0));
        }
        sum / PI
    }

    fn up(environment: &Environment) -> Vec3 {
        environment.radiance(Vec3::Y)
    }

    #[test]
    fn white_reflects_one_at_45_degrees() {
        let grey = super::super::environment::luminance(reflected(&at(45.0).bake()).as_vec3());
        assert!((grey - 1.0).abs() < 0.01, "{grey}");
    }

    #[test]
    fn texels_are_light_whatever_the_parameters() {
        for elevation in [-90.0, -6.0, 0.0, 1.0, 90.0, f32::NAN] {
            for turbidity in [0.0, 1.0, 10.0, f32::INFINITY] {
                let map = Sky { sun_elevation_deg: elevation, turbidity, ..Sky::default() }.bake();
                assert!(map.texels.iter().all(|t| t.is_finite() && t.min_element() >= 0.0));
            }
        }
    }

    #[test]
    fn the_zenith_is_blue_and_the_horizon_bright() {
        let map = at(55.0).bake();
        let zenith = up(&map);
        assert!(zenith.z > 1.5 * zenith.x, "{zenith}");
        let horizon = map.radiance(Vec3::new(-0.5, 0.05, 0.9).normalize());
        assert!(horizon.element_sum() > 1.3 * zenith.element_sum(), "{horizon} {zenith}");
        assert!(horizon.z / horizon.x < 0.75 * zenith.z / zenith.x, "{horizon} {zenith}");
    }

    #[test]
    fn a_low_sun_is_warm_and_dim_and_a_sun_below_the_horizon_is_gone() {
        let (high, low) = (at(60.0).bake().sun.unwrap(), at(3.0).bake().sun.unwrap());
        assert!(low.radiance.x > 2.0 * low.radiance.z && high.radiance.x < 1.5 * high.radiance.z);
        assert!(low.radiance.x < high.radiance.x);
        assert!(at(-2.0).bake().sun.is_none());
        let grey = |elevation| reflected(&at(elevation).bake()).element_sum();
        assert!(grey(60.0) > grey(30.0) && grey(30.0) > grey(5.0) && grey(5.0) > grey(-5.0));
    }

    #[test]
    fn the_sun_is_where_the_map_is_brightest() {
        for azimuth in [-120.0, 30.0, 250.0] {
            let sky = Sky { sun_azimuth_deg: azimuth, sun_elevation_deg: 30.0, ..Sky::default() };
            let map = sky.bake();
            let sun = map.sun.unwrap();
            assert!((sun.direction.length() - 1.0).abs() < 1e-6);
            let mirrored = sun.direction * Vec3::new(-1.0, 1.0, -1.0);
            assert!(map.radiance(sun.direction).x > 2.0 * map.radiance(mirrored).x);
            assert!((sun.solid_angle() / 6.797e-5 - 1.0).abs() < 0.02, "{}", sun.solid_angle());
        }
    }

    #[test]
    fn the_ground_reflects_by_its_albedo_and_meets_the_sky_softly() {
        let down = Vec3::NEG_Y;
        let dark = Sky { ground_albedo: 0.0, ..Sky::default() }.bake();
        let bright = Sky { ground_albedo: 0.8, ..Sky::default() }.bake();
        assert!(dark.radiance(down).x < 0.1 && bright.radiance(down).x > 0.5);
        let map = Sky::default().bake();
        let column: Vec<f32> = (96..160).map(|y| map.texel(0, y).y).collect();
        let brightest = column.iter().fold(0.0f32, |a, &b| a.max(b));
        assert!(column.windows(2).all(|w| (w[0] - w[1]).abs() < 0.3 * brightest), "{column:?}");
    }
}
