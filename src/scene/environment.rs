//! The light from infinitely far: a latitude-longitude map, and a sun apart from it.

mod files;

use std::f32::consts::{PI, TAU};
use std::path::Path;

use glam::{Vec2, Vec3};

use crate::error::Result;

/// Distant light. Directions map to the picture as in most HDR collections: the top row is +Y, the
/// centre column is -Z, and u grows to the right as seen from inside:
/// `u = 0.5 + atan2(d.x, -d.z) / 2π`, `v = acos(d.y) / π`.
///
/// The centre of texel (x, y) is at `u = (x + 0.5) / width`, `v = (y + 0.5) / height`.
#[derive(Clone, Debug, PartialEq)]
pub struct Environment {
    /// Texels across.
    pub width: u32,
    /// Texels down.
    pub height: u32,
    /// Linear radiance, rows from the top; finite and not negative.
    pub texels: Vec<Vec3>,
    /// A sun, when it is not part of the map.
    pub sun: Option<Sun>,
}

/// A disc of constant radiance infinitely far away.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sun {
    /// Unit direction towards its centre.
    pub direction: Vec3,
    /// Cosine of its angular radius.
    pub cos_radius: f32,
    /// Radiance of the disc.
    pub radiance: Vec3,
}

impl Sun {
    /// Solid angle in steradians, from the rounded cosine that every reader of this record uses, so that
    /// radiance times solid angle is the same irradiance everywhere.
    pub fn solid_angle(&self) -> f64 {
        std::f64::consts::TAU * (1.0 - f64::from(self.cos_radius))
    }
}

/// The unit direction at `(u, v)` of a latitude-longitude map; see [`Environment`].
pub fn direction_from_uv(uv: Vec2) -> Vec3 {
    let (sin_phi, cos_phi) = ((uv.x - 0.5) * TAU).sin_cos();
    let (sin_theta, cos_theta) = (uv.y * PI).sin_cos();
    Vec3::new(sin_theta * sin_phi, cos_theta, -sin_theta * cos_phi)
}

/// The `(u, v)` at which a latitude-longitude map shows the unit vector `direction`, both in 0..=1; see
/// [`Environment`].
pub fn uv_from_direction(direction: Vec3) -> Vec2 {
    Vec2::new(0.5 + direction.x.atan2(-direction.z) / TAU, direction.y.clamp(-1.0, 1.0).acos() / PI)
}

impl Environment {
    /// The same radiance from everywhere, and no sun. Components that are not finite or are negative
    /// become 0.
    pub fn constant(radiance: Vec3) -> Self {
        let mut texels = vec![radiance];
        files::repair(&mut texels);
        Environment { width: 1, height: 1, texels, sun: None }
    }

    /// Reads a Radiance `.hdr` or an OpenEXR `.exr` file (channels R, G, B). The map stays as it is: a
    /// sun in it is not taken out, so [`Environment::sun`] is `None`.
    ///
    /// Maps wider than [`Environment::MAX_WIDTH`] texels are averaged down in linear light by the
    /// smallest whole factor that makes them fit. Channels that are not finite or are negative become 0.
    /// What a `.hdr` file's EXPOSURE and COLORCORR lines say it was multiplied by is taken back.
    /// Also returned: a sentence on each repair, and one where the map is not twice as wide as high.
    ///
    /// Errors, each naming the file: it cannot be read, is neither format by its name, is damaged, or is
    /// larger than [`Environment::MAX_FILE_SIZE`] (checked before the pixels are allocated).
    pub fn load(path: &Path) -> Result<(Self, Vec<String>)> {
        files::load(path)
    }

    /// Maps that are wider are averaged down when they are read.
    pub const MAX_WIDTH: u32 = 4096;

    /// Width and height above which a file is refused.
    pub const MAX_FILE_SIZE: [u32; 2] = [16384, 8192];

    /// The map with `factor` times `factor` texels averaged into one, and the same sun.
    pub fn reduced(&self, factor: usize) -> Self {
        files::reduced(self, factor)
    }

    /// The texel at `(x, y)`; x wraps round, y is clamped to the map.
    pub fn texel(&self, x: i64, y: i64) -> Vec3 {
        let x = x.rem_euclid(i64::from(self.width));
        let y = y.clamp(0, i64::from(self.height) - 1);
        self.texels[(y * i64::from(self.width) + x) as usize]
    }

    /// Index into [`Environment::texels`] of the texel that contains the unit vector `direction`.
    pub fn texel_index(&self, direction: Vec3) -> usize {
        let uv = uv_from_direction(direction);
        let x = ((uv.x * self.width as f32) as u32).min(self.width - 1);
        let y = ((uv.y * self.height as f32) as u32).min(self.height - 1);
        y as usize * self.width as usize + x as usize
    }

    /// Radiance of the texel that contains the unit vector `direction`. The sun is not included.
    pub fn radiance_nearest(&self, direction: Vec3) -> Vec3 {
        self.texels[self.texel_index(direction)]
    }

    /// Radiance from the unit vector `direction`, bilinear between texel centres: u wraps round, v is
    /// clamped. The sun is not included.
    pub fn radiance(&self, direction: Vec3) -> Vec3 {
        let uv = uv_from_direction(direction);
        let (x, y) = (uv.x * self.width as f32 - 0.5, uv.y * self.height as f32 - 0.5);
        let (fx, fy) = (x - x.floor(), y - y.floor());
        let (x, y) = (x.floor() as i64, y.floor() as i64);
        let top = self.texel(x, y).lerp(self.texel(x + 1, y), fx);
        let bottom = self.texel(x, y + 1).lerp(self.texel(x + 1, y + 1), fx);
        top.lerp(bottom, fy)
    }

    /// Luminance of the irradiance that a surface has from the map, averaged over the ways it may face.
    pub fn irradiance(&self) -> f32 {
        let row = |y: u32| {
            let first = (y * self.width) as usize;
            let texels = &self.texels[first..first + self.width as usize];
            texels.iter().map(|&texel| luminance(texel)).sum::<f64>() * self.texel_solid_angle(y)
        };
        // pi times the mean radiance, which is a sum over 4 pi steradians.
        ((0..self.height).map(row).sum::<f64>() / 4.0) as f32
    }

    /// A fiftieth of the mean of the map's texels, within what reconstruction can do with: the least radiance that
    /// glossy surfaces expect of it.
    pub fn least_expected(&self) -> f32 {
        let sum: f64 = self.texels.iter().map(|texel| f64::from(texel.element_sum())).sum();
        ((sum / (150 * self.texels.len().max(1)) as f64) as f32).clamp(1e-6, 1e6)
    }

    /// Solid angle in steradians of each texel of row `y`, exactly.
    pub fn texel_solid_angle(&self, y: u32) -> f64 {
        let edge = |row: u32| (std::f64::consts::PI * f64::from(row) / f64::from(self.height)).cos();
        std::f64::consts::TAU / f64::from(self.width) * (edge(y) - edge(y + 1))
    }
}

/// Luminance of linear Rec. 709 RGB.
pub fn luminance(rgb: Vec3) -> f64 {
    0.2126 * f64::from(rgb.x) + 0.7152 * f64::from(rgb.y) + 0.0722 * f64::from(rgb.z)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_named_directions_are_where_the_documentation_says() {
        let near = |d: Vec3, u: f32, v: f32| {
            assert!(uv_from_direction(d).distance(Vec2::new(u, v)) < 1e-6, "{d}");
        };
        near(Vec3::NEG_Z, 0.5, 0.5);
        near(Vec3::X, 0.75, 0.5);
        near(Vec3::NEG_X, 0.25, 0.5);
        assert!(uv_from_direction(Vec3::Y).y < 1e-6);
        assert!(uv_from_direction(Vec3::NEG_Y).y > 1.0 - 1e-6);
    }

    #[test]
    fn directions_and_coordinates_undo_each_other() {
        for y in 1..64 {
            for x in 0..64 {
                let uv = Vec2::new((x as f32 + 0.5) / 64.0, y as f32 / 64.0);
                let direction = direction_from_uv(uv);
                assert!((direction.length() - 1.0).abs() < 1e-6);
                assert!(uv_from_direction(direction).distance(uv) < 2e-5, "{uv}");
            }
        }
    }

    #[test]
    fn bilinear_lookups_meet_texel_centres_wrap_and_clamp() {
        let texels: Vec<Vec3> = (0..32).map(|i| Vec3::splat(i as f32)).collect();
        let map = Environment { width: 8, height: 4, texels, sun: None };
        for y in 0..4 {
            for x in 0..8 {
                let uv = Vec2::new((x as f32 + 0.5) / 8.0, (y as f32 + 0.5) / 4.0);
                let direction = direction_from_uv(uv);
                let expected = (y * 8 + x) as f32;
                assert!((map.radiance(direction).x - expected).abs() < 1e-3);
                assert_eq!(map.radiance_nearest(direction).x, expected);
            }
        }
        // At u = 0 the first and the last column meet: row 1 holds 8 and 15.
        let seam = map.radiance(direction_from_uv(Vec2::new(0.0, 1.5 / 4.0)));
        assert!((seam.x - 11.5).abs() < 1e-3, "{seam}");
        // Above the first row's centre only the first row counts.
        let pole = map.radiance(direction_from_uv(Vec2::new(2.5 / 8.0, 0.01)));
        assert!((pole.x - 2.0).abs() < 1e-2, "{pole}");
    }

    #[test]
    fn solid_angles_add_up_to_the_sphere() {
        let map = Environment { width: 32, height: 16, texels: vec![Vec3::ONE; 512], sun: None };
        let total: f64 = (0..16).map(|y| 32.0 * map.texel_solid_angle(y)).sum();
        assert!((total - 4.0 * std::f64::consts::PI).abs() < 1e-12);
    }

    #[test]
    fn a_constant_map_lights_surfaces_by_pi_times_its_radiance() {
        let map = Environment::constant(Vec3::splat(0.7));
        assert!((map.irradiance() - 0.7 * PI).abs() < 1e-5, "{}", map.irradiance());
    }

    #[test]
    fn a_constant_map_is_the_same_everywhere_and_sane() {
        let map = Environment::constant(Vec3::new(1.0, -2.0, f32::NAN));
        assert_eq!(map.radiance(Vec3::X), Vec3::X);
        assert_eq!(map.radiance(Vec3::NEG_Y), Vec3::X);
    }
}
