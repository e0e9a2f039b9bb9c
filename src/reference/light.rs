//! What lights a scene: the environment map, the sun and punctual lights.

use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3};

use super::random::Random;
use crate::scene::{Environment, Light, LightKind, Sun};

/// The environment map's radiance from a unit direction, without the sun: bilinear between texel centres,
/// wrapped around horizontally, the first and the last row going on beyond their centres.
pub fn environment(map: &Environment, direction: DVec3) -> DVec3 {
    if map.texels.is_empty() {
        return DVec3::ZERO;
    }
    let (u, v) = coordinates(direction);
    let (x, y) = (u * f64::from(map.width) - 0.5, v * f64::from(map.height) - 0.5);
    let (right, down) = (x - x.floor(), y - y.floor());
    let texel = |x: f64, y: f64| {
        let column = (x as i64).rem_euclid(i64::from(map.width)) as usize;
        let row = (y as i64).clamp(0, i64::from(map.height) - 1) as usize;
        map.texels[row * map.width as usize + column].as_dvec3()
    };
    let row = |y: f64| texel(x.floor(), y).lerp(texel(x.floor() + 1.0, y), right);
    row(y.floor()).lerp(row(y.floor() + 1.0), down)
}

/// Everything seen in a unit direction where no surface is: the map, and the sun inside its disc.
pub fn background(map: &Environment, direction: DVec3) -> DVec3 {
    let disc = match &map.sun {
        Some(sun) if direction.dot(sun.direction.as_dvec3()) >= f64::from(sun.cos_radius) => {
            sun.radiance.as_dvec3()
        }
        _ => DVec3::ZERO,
    };
    environment(map, direction) + disc
}

/// Where a direction lies in the map, both in 0..1 (see [`Environment`]).
fn coordinates(direction: DVec3) -> (f64, f64) {
    let u = 0.5 + direction.x.atan2(-direction.z) / TAU;
    // Not by the arc cosine: near the poles that tells rounding.
    (u, direction.x.hypot(direction.z).atan2(direction.y) / PI)
}

/// The solid angle of the sun's disc in steradians.
pub fn sun_solid_angle(sun: &Sun) -> f64 {
    TAU * (1.0 - f64::from(sun.cos_radius))
}

/// A direction towards the sun's disc, uniform over its solid angle for uniform `at`.
pub fn towards_sun(sun: &Sun, at: [f64; 2]) -> DVec3 {
    let cosine = 1.0 - at[0] * (1.0 - f64::from(sun.cos_radius));
    around(sun.direction.as_dvec3().normalize(), cosine, at[1] * TAU)
}

/// The unit vector at an angle to a unit axis, given by its cosine, and at an azimuth in radians.
pub fn around(axis: DVec3, cosine: f64, azimuth: f64) -> DVec3 {
    let (x, y) = axis.any_orthonormal_pair();
    let sine = ((1.0 - cosine) * (1.0 + cosine)).max(0.0).sqrt();
    let local = DVec3::new(sine * azimuth.cos(), sine * azimuth.sin(), cosine);
    (DMat3::from_cols(x, y, axis) * local).normalize()
}

/// What a punctual light sends to a point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Arrival {
    /// Unit direction towards the light.
    pub direction: DVec3,
    /// Distance to the light in metres.
    pub distance: f64,
    /// Irradiance on a plane across the direction, where nothing is in between.
    pub irradiance: DVec3,
}

/// A light's arrival at a position relative to the anchor, by the formulas that KHR_lights_punctual
/// recommends: inverse square, window `max(min(1 - (d / range)⁴, 1), 0)`, squared linear fall-off between
/// a spot's cosines. `None` where it is dark or at the light itself.
pub fn punctual(light: &Light, position: DVec3) -> Option<Arrival> {
    let intensity = light.intensity.as_dvec3();
    let shines = light.direction.as_dvec3();
    let arrival = if light.kind == LightKind::Directional {
        Arrival { direction: -shines.try_normalize()?, distance: f64::INFINITY, irradiance: intensity }
    } else {
        let offset = light.position.as_dvec3() - position;
        let distance = offset.length();
        let direction = offset.try_normalize()?;
        let window = (1.0 - (distance / f64::from(light.range)).powi(4)).clamp(0.0, 1.0);
        let strength = window * cone(light, -direction) / (distance * distance);
        Arrival { direction, distance, irradiance: intensity * strength }
    };
    (arrival.irradiance.max_element() > 0.0).then_some(arrival)
}

/// The share of a spot's intensity in a direction away from it.
fn cone(light: &Light, direction: DVec3) -> f64 {
    let LightKind::Spot { cos_inner, cos_outer } = light.kind else { return 1.0 };
    let scale = 1.0 / (f64::from(cos_inner) - f64::from(cos_outer)).max(0.001);
    let cosine = light.direction.as_dvec3().normalize_or_zero().dot(direction);
    ((cosine - f64::from(cos_outer)) * scale).clamp(0.0, 1.0).powi(2)
}

/// Draws directions where the map is bright: a texel by its cumulative power, then uniformly within it.
#[derive(Debug)]
pub struct EnvironmentSampler {
    width: usize,
    height: usize,
    /// Cumulative power of texels in rows; empty when the map is black.
    cumulative: Vec<f64>,
}

impl EnvironmentSampler {
    /// Prepares a map. A texel's power counts its neighbours too, because lookups between them mix.
    pub fn new(map: &Environment) -> Self {
        let (width, height) = (map.width as usize, map.height as usize);
        let mut sum = 0.0;
        let mut cumulative = Vec::with_capacity(map.texels.len());
        for index in 0..map.texels.len() {
            let (x, y) = (index % width, index / width);
            let mut power = 0.0;
            for row in y.saturating_sub(1)..(y + 2).min(height) {
                for column in [x + width - 1, x, x + 1] {
                    power += f64::from(map.texels[row * width + column % width].element_sum());
                }
            }
            sum += power * texel_solid_angle(width, height, y);
            cumulative.push(sum);
        }
        if sum <= 0.0 {
            cumulative.clear();
        }
        EnvironmentSampler { width, height, cumulative }
    }

    /// The map sends light.
    pub fn is_lit(&self) -> bool {
        !self.cumulative.is_empty()
    }

    /// A direction; only for maps that are lit.
    pub fn sample(&self, random: &mut Random) -> DVec3 {
        let total = self.cumulative[self.cumulative.len() - 1];
        let target = random.uniform() * total;
        let texel = self.cumulative.partition_point(|&sum| sum <= target).min(self.cumulative.len() - 1);
        let (x, y) = ((texel % self.width) as f64, (texel / self.width) as f64);
        let azimuth = ((x + random.uniform()) / self.width as f64 - 0.5) * TAU;
        let (top, bottom) =
            ((y / self.height as f64 * PI).cos(), ((y + 1.0) / self.height as f64 * PI).cos());
        let up = top + (bottom - top) * random.uniform();
        let across = (1.0 - up * up).max(0.0).sqrt();
        DVec3::new(across * azimuth.sin(), up, -across * azimuth.cos())
    }

    /// The density of [`EnvironmentSampler::sample`] over solid angle.
    pub fn density(&self, direction: DVec3) -> f64 {
        let (u, v) = coordinates(direction);
        let x = ((u * self.width as f64) as usize).min(self.width - 1);
        let y = ((v * self.height as f64) as usize).min(self.height - 1);
        let texel = y * self.width + x;
        let before = if texel == 0 { 0.0 } else { self.cumulative[texel - 1] };
        let share = (self.cumulative[texel] - before) / self.cumulative[self.cumulative.len() - 1];
        share / texel_solid_angle(self.width, self.height, y)
    }
}

fn texel_solid_angle(width: usize, height: usize, row: usize) -> f64 {
    let edge = |row: usize| (row as f64 / height as f64 * PI).cos();
    TAU / width as f64 * (edge(row) - edge(row + 1))
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::reference::testing::on_sphere;

    fn map(width: u32, height: u32) -> Environment {
        let texels = (0..width * height).map(|i| Vec3::splat((i * 7 % 13) as f32)).collect();
        Environment { width, height, texels, sun: None }
    }

    #[test]
    fn directions_follow_the_convention() {
        let map = map(4, 2);
        let texel = |x: usize, y: usize| map.texels[y * 4 + x].as_dvec3();
        // The seam between columns 1 and 2 is -Z, between 2 and 3 is +X; the horizon lies between the rows.
        let middle = |a: usize, b: usize| (texel(a, 0) + texel(b, 0) + texel(a, 1) + texel(b, 1)) / 4.0;
        for (direction, expected) in [
            (DVec3::NEG_Z, middle(1, 2)),
            (DVec3::X, middle(2, 3)),
            (DVec3::Z, middle(3, 0)),
            (DVec3::NEG_X, middle(0, 1)),
            (DVec3::new(1.0, 1e9, -1.0).normalize(), texel(2, 0)),
            (DVec3::new(-1.0, -1e9, -1.0).normalize(), texel(1, 1)),
        ] {
            let found = environment(&map, direction);
            assert!(found.distance(expected) < 1e-6, "{direction}: {found}, not {expected}");
        }
    }

    #[test]
    fn sampler_integrates_a_map_and_its_density_is_its_own() {
        let map = map(8, 5);
        let sampler = EnvironmentSampler::new(&map);
        let mut random = Random::new(11);
        let n = 40_000;
        let (mut sum, mut squares, mut uniform) = (0.0, 0.0, 0.0);
        for _ in 0..n {
            let direction = sampler.sample(&mut random);
            let value = environment(&map, direction).x / sampler.density(direction);
            sum += value;
            squares += value * value;
            uniform += sampler.density(on_sphere(&mut random)) * 4.0 * PI;
        }
        let mean = sum / f64::from(n);
        let error = ((squares / f64::from(n) - mean * mean) / f64::from(n)).sqrt();
        let steps = 400;
        let mut expected = 0.0;
        for i in 0..steps {
            for j in 0..2 * steps {
                let (theta, phi) = ((f64::from(i) + 0.5) / 400.0 * PI, (f64::from(j) + 0.5) / 400.0 * PI);
                let direction = DVec3::new(theta.sin() * phi.sin(), theta.cos(), -theta.sin() * phi.cos());
                expected += environment(&map, direction).x * theta.sin() * (PI / 400.0).powi(2);
            }
        }
        // Five standard errors: a false alarm once in 1.7 million seeds.
        assert!((mean - expected).abs() < 5.0 * error, "{mean} {expected} {error}");
        assert!(error < 0.01 * expected);
        assert!((uniform / f64::from(n) - 1.0).abs() < 0.05, "the density's integral is not 1");
    }

    #[test]
    fn sun_fills_its_disc() {
        let sun = Sun { direction: Vec3::Y, cos_radius: 0.9, radiance: Vec3::splat(2.0) };
        let map = Environment { sun: Some(sun), ..map(4, 2) };
        let mut random = Random::new(2);
        let n = 10_000;
        let mean: f64 = (0..n).map(|_| towards_sun(&sun, random.pair()).y).sum::<f64>() / f64::from(n);
        assert!((mean - 0.95).abs() < 5.0 * 0.1 / 12f64.sqrt() / f64::from(n).sqrt());
        let disc = |d: DVec3| background(&map, d).x - environment(&map, d).x;
        assert_eq!(disc(DVec3::new(0.4, 0.95, 0.0).normalize()), 2.0);
        assert_eq!(disc(DVec3::new(0.5, 0.9, 0.0).normalize()), 0.0);
        assert!((sun_solid_angle(&sun) - TAU * 0.1).abs() < 1e-6);
    }

    #[test]
    fn punctual_lights_follow_the_extension() {
        let point = Light {
            kind: LightKind::Point,
            intensity: Vec3::splat(8.0),
            position: Vec3::new(0.0, 2.0, 0.0),
            direction: Vec3::ZERO,
            range: f32::INFINITY,
        };
        let arrival = punctual(&point, DVec3::ZERO).unwrap();
        assert_eq!((arrival.direction, arrival.distance), (DVec3::Y, 2.0));
        assert_eq!(arrival.irradiance.x, 2.0);
        let windowed = punctual(&Light { range: 4.0, ..point }, DVec3::ZERO).unwrap();
        assert_eq!(windowed.irradiance.x, 2.0 * (1.0 - 1.0 / 16.0));
        assert_eq!(punctual(&Light { range: 2.0, ..point }, DVec3::ZERO), None);
        assert_eq!(punctual(&point, DVec3::new(0.0, 2.0, 0.0)), None);

        let kind = LightKind::Spot { cos_inner: 1.0, cos_outer: 0.5 };
        let spot = Light { kind, direction: Vec3::NEG_Y, ..point };
        assert_eq!(punctual(&spot, DVec3::ZERO).unwrap().irradiance.x, 2.0);
        // At 45 degrees: distance² is 8, the fall-off ((√½ - 0.5) / 0.5)².
        let slanted = punctual(&spot, DVec3::new(2.0, 0.0, 0.0)).unwrap().irradiance.x;
        assert!((slanted - ((0.5f64.sqrt() - 0.5) / 0.5).powi(2)).abs() < 1e-12);
        assert_eq!(punctual(&spot, DVec3::new(9.0, 0.0, 0.0)), None);

        let sun = Light { kind: LightKind::Directional, direction: Vec3::NEG_X, ..point };
        let arrival = punctual(&sun, DVec3::splat(5.0)).unwrap();
        assert_eq!((arrival.direction, arrival.irradiance.x), (DVec3::X, 8.0));
    }
}
