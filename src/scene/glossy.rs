//! The environment as surfaces of some roughness mirror it: what pixels of glossy surfaces look up.
//!
//! **What pixels expect, and what samples say of it.** Reflections of smooth surfaces, and light on normal
//! maps, change faster than samples lie. So each pixel of a glossy material (`Material::is_glossy`) has an
//! expectation of its own (`kernels/shared/glossy.h`): the environment, filtered once for eight roughnesses
//! (`src/scene/glossy.rs`), in the direction that its mapped normal mirrors, times Karis's fit of the BRDF's
//! integral; where the surface is smooth and reflects much, a ray finds out what it meets, and four do in the lobe of
//! metals that are less smooth.
//! Samples are traced as everywhere else. What is averaged between them is not their specular light but its
//! ratio to what their own pixels expected, which each pixel multiplies with its own expectation: the ratio
//! estimator of Heitz et al. 2018. It changes slowly, so it is averaged more widely than specular light by
//! itself, and what expectation misses (Fresnel's and shadowing's exact form, what hides the environment,
//! punctual lights) comes from the samples. A fiftieth of the environment's mean is added to both before
//! dividing and taken off afterwards, so that light that no pixel expects is added rather than multiplied.
//! Diffuse light on a surface with a normal map goes with the mean direction of red, green and blue light
//! (first-order spherical harmonics, resolved as by Hazel 2017): each sample divides by what that gives its
//! own normal, each pixel multiplies by what it gives its own.

use std::f32::consts::{PI, TAU};

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::environment::{Environment, direction_from_uv};

/// Perceptual roughness of each level, and texels across; it is half as high. Texels are about as wide as half the
/// lobe. `kernels/shared/glossy.h` has the same numbers; below the first level the map itself counts more and more.
pub const LEVELS: [(f32, u32); 7] =
    [(0.1, 512), (0.2, 256), (0.3, 128), (0.45, 64), (0.6, 64), (0.8, 32), (1.0, 32)];

/// Directions that a texel averages: more where a lobe is wide, since each reads a map that is as coarse as they are
/// sparse, and too coarse a map widens the lobe.
fn directions(roughness: f32) -> u32 {
    match roughness {
        r if r < 0.15 => 64,
        r if r < 0.25 => 128,
        r if r < 0.4 => 256,
        _ => 1024,
    }
}

/// All levels one after the other, row by row: the radiance that a surface of that roughness, seen along its
/// normal, reflects of the map where nothing hides it (Karis 2013), without the sun. Directions follow GGX's
/// normals; each reads a level of the map as coarse as directions are sparse there (Křivánek and Colbert 2008).
pub fn prefiltered(map: &Environment) -> Vec<[f32; 4]> {
    let pyramid = Pyramid::new(map);
    let mut texels = Vec::new();
    for (roughness, width) in LEVELS {
        let lobe = lobe(roughness);
        let texel = |at: u32| {
            let uv = Vec2::new((at % width) as f32 + 0.5, 2.0 * ((at / width) as f32 + 0.5)) / width as f32;
            average(&pyramid, direction_from_uv(uv), &lobe).extend(0.0).to_array()
        };
        texels.par_extend((0..width * width / 2).into_par_iter().map(texel));
    }
    texels
}

/// What [`prefiltered`] makes of a map that is the same to the left and to the right of its centre column: of each level
/// the left half alone, and no level wider than `most` texels. With its width each.
pub fn prefiltered_halves(map: &Environment, most: u32) -> Vec<(u32, Vec<Vec3>)> {
    let pyramid = Pyramid::new(map);
    let level = |(roughness, width): (f32, u32)| {
        let (width, lobe) = (width.min(most), lobe(roughness));
        let half = width / 2;
        let texel = |at: u32| {
            let uv = Vec2::new((at % half) as f32 + 0.5, 2.0 * ((at / half) as f32 + 0.5)) / width as f32;
            average(&pyramid, direction_from_uv(uv), &lobe)
        };
        (width, (0..half * half).into_par_iter().map(texel).collect())
    };
    LEVELS.into_iter().map(level).collect()
}

/// Directions around +Z, each with its weight and the level of the map that is as coarse as they are sparse there.
fn lobe(roughness: f32) -> Vec<(Vec3, f32, f32)> {
    let (square, count) = (roughness.powi(4), directions(roughness));
    let direction = |i: u32| {
        // A Hammersley set of GGX's normals h, mirrored: l = 2 (z.h) h - z.
        let u = (i as f32 + 0.5) / count as f32;
        let phi = TAU * (i.reverse_bits() as f32 / 4_294_967_296.0);
        let cos = ((1.0 - u) / (1.0 + (square - 1.0) * u)).sqrt();
        let sin = (1.0 - cos * cos).max(0.0).sqrt();
        let h = Vec3::new(sin * phi.cos(), sin * phi.sin(), cos);
        let density = square / (PI * (1.0 + (square - 1.0) * cos * cos).powi(2)) / 4.0;
        let l = h * (2.0 * h.z) - Vec3::Z;
        (l, l.z, Pyramid::level(1.0 / (count as f32 * density)))
    };
    (0..count).map(direction).filter(|&(_, weight, _)| weight > 0.0).collect()
}

fn average(pyramid: &Pyramid, axis: Vec3, lobe: &[(Vec3, f32, f32)]) -> Vec3 {
    let (x, y) = axis.any_orthonormal_pair();
    let mut sum = Vec3::ZERO;
    let mut weights = 0.0;
    for &(l, weight, level) in lobe {
        sum += pyramid.read(x * l.x + y * l.y + axis * l.z, level) * weight;
        weights += weight;
    }
    sum / weights
}

/// The map, and half as many texels each way at each further level.
struct Pyramid {
    levels: Vec<Level>,
    /// For each row of the map: the level, and its share, whose texels there are as large as one steradian.
    steradian: Vec<f32>,
}

struct Level {
    width: usize,
    height: usize,
    texels: Vec<Vec3>,
}

impl Pyramid {
    fn new(map: &Environment) -> Pyramid {
        let (width, height) = (map.width as usize, map.height as usize);
        let mut levels = vec![Level { width, height, texels: map.texels.clone() }];
        while let Some(last) = levels.last()
            && last.width * last.height > 1
        {
            levels.push(halved(last));
        }
        let texel = TAU / width as f32 * (PI / height as f32);
        let steradian = |row: usize| {
            let sine = ((row as f32 + 0.5) / height as f32 * PI).sin();
            -0.5 * (texel * sine).log2()
        };
        Pyramid { levels, steradian: (0..height).map(steradian).collect() }
    }

    /// The level whose texels are as large as so many steradians, beside that of one steradian. One level finer than
    /// directions are sparse leaves gaps; one coarser does not.
    fn level(solid_angle: f32) -> f32 {
        0.5 * solid_angle.log2() + 1.0
    }

    /// The radiance from a direction, averaged over texels of a level that [`Pyramid::level`] tells.
    fn read(&self, direction: Vec3, level: f32) -> Vec3 {
        let uv = near_uv(direction);
        let row = ((uv.y * self.levels[0].height as f32) as usize).min(self.levels[0].height - 1);
        let level = (level + self.steradian[row]).clamp(0.0, (self.levels.len() - 1) as f32);
        self.levels[(level + 0.5) as usize].bilinear(uv)
    }
}

impl Level {
    /// Between the four nearest texels; around the poles' axis they repeat. Tens of millions are asked for: neither a
    /// division nor a call.
    fn bilinear(&self, uv: Vec2) -> Vec3 {
        // From the texel before the first one, so that nothing is negative.
        let (x, y) = (uv.x * self.width as f32 + 0.5, uv.y * self.height as f32 + 0.5);
        let (right, below) = (x as usize, y as usize);
        let (across, down) = (x - right as f32, y - below as f32);
        let left = if right == 0 { self.width - 1 } else { right - 1 };
        let right = if right >= self.width { right - self.width } else { right };
        let row = |row: usize| {
            let row = &self.texels[row * self.width..][..self.width];
            row[left.min(self.width - 1)].lerp(row[right.min(self.width - 1)], across)
        };
        row(below.saturating_sub(1).min(self.height - 1)).lerp(row(below.min(self.height - 1)), down)
    }
}

/// As [`super::environment::uv_from_direction`], a tenth of a row of 4096 across beside it at most, and far faster:
/// by the polynomials 4.4.45 (acos) and 4.4.49 (atan) of Abramowitz and Stegun's handbook.
fn near_uv(direction: Vec3) -> Vec2 {
    let up = direction.y.abs().min(1.0);
    let angle = (1.0 - up).sqrt() * (1.570_728_8 + up * (-0.212_114_4 + up * (0.074_261 - 0.018_729_3 * up)));
    let v = if direction.y < 0.0 { PI - angle } else { angle } / PI;
    let (x, z) = (direction.x.abs(), direction.z.abs());
    let ratio = x.min(z) / x.max(z).max(f32::MIN_POSITIVE);
    let square = ratio * ratio;
    let octant = ratio
        * (0.999_866
            + square * (-0.330_299_5 + square * (0.180_141 + square * (-0.085_133 + 0.020_835_1 * square))));
    let quadrant = if x > z { PI / 2.0 - octant } else { octant };
    let half = if direction.z > 0.0 { PI - quadrant } else { quadrant };
    Vec2::new(0.5 + half.copysign(direction.x) / TAU, v)
}

/// Two by two texels to one, by their solid angles; an odd one out is left to itself.
fn halved(of: &Level) -> Level {
    let Level { width, height, ref texels } = *of;
    let (half_width, half_height) = (width.div_ceil(2), height.div_ceil(2));
    let weight = |row: usize| ((row as f32 + 0.5) / height as f32 * PI).sin();
    let texel = |at: usize| {
        let (left, top) = (at % half_width * 2, at / half_width * 2);
        let mut sum = Vec3::ZERO;
        let mut weights = 0.0;
        for y in top..(top + 2).min(height) {
            for x in left..(left + 2).min(width) {
                sum += texels[y * width + x] * weight(y);
                weights += weight(y);
            }
        }
        sum / weights
    };
    let texels = (0..half_width * half_height).map(texel).collect();
    Level { width: half_width, height: half_height, texels }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::environment::uv_from_direction;

    fn map(width: u32, radiance: impl Fn(Vec3) -> Vec3) -> Environment {
        let height = width / 2;
        let uv =
            |i: u32| Vec2::new((i % width) as f32 + 0.5, 2.0 * ((i / width) as f32 + 0.5)) / width as f32;
        let texels = (0..width * height).map(|i| radiance(direction_from_uv(uv(i)))).collect();
        Environment { width, height, texels, ..Environment::constant(Vec3::ZERO) }
    }

    /// What a level holds for a direction, between its four nearest texels.
    fn look(texels: &[[f32; 4]], level: usize, direction: Vec3) -> Vec3 {
        let before: u32 = LEVELS[..level].iter().map(|(_, width)| width * width / 2).sum();
        let width = LEVELS[level].1;
        let at = uv_from_direction(direction) * Vec2::new(width as f32, (width / 2) as f32) - 0.5;
        let (base, share) = (at.floor(), at - at.floor());
        let texel = |x: f32, y: f32| {
            let row = (y.max(0.0) as u32).min(width / 2 - 1);
            let column = (x as i32).rem_euclid(width as i32) as u32;
            Vec3::from_slice(&texels[(before + row * width + column) as usize][..3])
        };
        let row = |y: f32| texel(base.x, y).lerp(texel(base.x + 1.0, y), share.x);
        row(base.y).lerp(row(base.y + 1.0), share.y)
    }

    #[test]
    fn places_are_found_nearly() {
        for i in 0..10_000u32 {
            let (u, v) = ((i as f32 + 0.5) / 10_000.0, (i.reverse_bits() as f32 + 0.5) / 4_294_967_296.0);
            let direction = direction_from_uv(Vec2::new(u, v));
            let (found, right) = (near_uv(direction), uv_from_direction(direction));
            let across = (found.x - right.x).abs();
            assert!(across.min(1.0 - across) < 5e-6 && (found.y - right.y).abs() < 2.5e-5, "{direction}");
        }
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for direction in [axis, -axis] {
                let (found, right) = (near_uv(direction), uv_from_direction(direction));
                let across = (found.x - right.x).abs();
                let pole = direction.y != 0.0;
                assert!((pole || across.min(1.0 - across) < 5e-6) && (found.y - right.y).abs() < 2.5e-5);
            }
        }
    }

    #[test]
    fn a_constant_stays_constant() {
        for width in [2, 64] {
            let texels = prefiltered(&map(width, |_| Vec3::new(0.5, 3.0, 700.0)));
            assert_eq!(texels.len() as u32, LEVELS.iter().map(|(_, width)| width * width / 2).sum::<u32>());
            for texel in texels {
                assert!(Vec3::from_slice(&texel[..3]).abs_diff_eq(Vec3::new(0.5, 3.0, 700.0), 1e-3 * 700.0));
            }
        }
        assert_eq!(prefiltered(&Environment::constant(Vec3::ONE))[0], [1.0, 1.0, 1.0, 0.0]);
    }

    /// Against an integral over all normals, for light that changes slowly and for a bright disc.
    #[test]
    fn levels_are_the_lobes_integrals() {
        let toward = Vec3::new(0.6, 0.64, -0.48);
        let lights: [(f32, &(dyn Fn(Vec3) -> Vec3 + Sync)); 2] = [
            (0.03, &|d| Vec3::ONE + d * 0.9),
            (0.2, &|d| Vec3::splat(if d.dot(toward) > 0.95 { 20.0 } else { 0.3 })),
        ];
        for (allowed, light) in lights {
            let texels = prefiltered(&map(256, light));
            for (level, (roughness, _)) in LEVELS.into_iter().enumerate() {
                for axis in [toward, Vec3::new(0.0, 0.8, -0.6), Vec3::new(-0.6, -0.64, 0.48)] {
                    let (x, y) = axis.any_orthonormal_pair();
                    let square = roughness.powi(4);
                    let (mut sum, mut weights) = (Vec3::ZERO, 0.0);
                    for i in 0..256 * 64 {
                        let (u, phi) = (((i / 64) as f32 + 0.5) / 256.0, TAU * (i % 64) as f32 / 64.0);
                        let cos = ((1.0 - u) / (1.0 + (square - 1.0) * u)).sqrt();
                        let sin = (1.0 - cos * cos).sqrt();
                        let h = x * (sin * phi.cos()) + y * (sin * phi.sin()) + axis * cos;
                        let l = h * (2.0 * cos) - axis;
                        let weight = l.dot(axis).max(0.0);
                        sum += light(l) * weight;
                        weights += weight;
                    }
                    let (found, right) = (look(&texels, level, axis), sum / weights);
                    let off = (found - right).abs().max_element() / right.max_element();
                    assert!(off < allowed, "{roughness} {axis}: {found} is not {right}");
                }
            }
        }
    }
}
