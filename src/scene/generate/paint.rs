//! Procedural pictures that tile: noise, patterns, and normal maps from heights.

use glam::{Vec2, Vec3};
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use rayon::prelude::*;

use super::hash;

/// A square picture of `size` texels; `texel` gets coordinates in 0..1, v down, and returns RGBA in 0..1 as
/// it is to be stored (sRGB-encoded for colours).
pub fn picture(size: usize, texel: impl Fn(Vec2) -> [f32; 4] + Sync) -> Vec<u8> {
    let at = |i: usize| Vec2::new((i % size) as f32 + 0.5, (i / size) as f32 + 0.5) / size as f32;
    let byte = |c: f32| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
    let texels: Vec<[u8; 4]> = (0..size * size).into_par_iter().map(|i| texel(at(i)).map(byte)).collect();
    png([size as u32; 2], &texels)
}

/// A normal map (+Y up, as in glTF) of a surface that is `height(uv)` high, in units of the picture's edge.
pub fn normal_map(size: usize, height: impl Fn(Vec2) -> f32 + Sync) -> Vec<u8> {
    let at = |x: usize, y: usize| Vec2::new(x as f32 + 0.5, y as f32 + 0.5) / size as f32;
    let heights: Vec<f32> =
        (0..size * size).into_par_iter().map(|i| height(at(i % size, i / size))).collect();
    let read = |x: usize, y: usize| heights[(y % size) * size + x % size];
    picture(size, |uv| {
        let (x, y) = ((uv.x * size as f32) as usize, (uv.y * size as f32) as usize);
        let slope = size as f32 / 2.0;
        let dx = (read(x + 1, y) - read(x + size - 1, y)) * slope;
        let dy = (read(x, y + 1) - read(x, y + size - 1)) * slope;
        let normal = Vec3::new(-dx, dy, 1.0).normalize() * 0.5 + 0.5;
        [normal.x, normal.y, normal.z, 1.0]
    })
}

/// Encodes RGBA texels of a width and height; without alpha where all of them are opaque.
pub fn png([width, height]: [u32; 2], texels: &[[u8; 4]]) -> Vec<u8> {
    let mut bytes = Vec::new();
    let encoder = PngEncoder::new_with_quality(&mut bytes, CompressionType::Fast, FilterType::Adaptive);
    let opaque = texels.iter().all(|t| t[3] == 255);
    let rgb: Vec<u8>;
    let (data, kind) = if opaque {
        rgb = texels.iter().flat_map(|t| [t[0], t[1], t[2]]).collect();
        (rgb.as_slice(), ExtendedColorType::Rgb8)
    } else {
        (bytemuck::cast_slice(texels), ExtendedColorType::Rgba8)
    };
    encoder
        .write_image(data, width, height, kind)
        .expect("memory takes every byte, and the sizes fit by construction");
    bytes
}

/// A random number in 0..1 for a cell of a grid. Pictures ask for tens of millions of these, so one mixing
/// serves all three numbers.
pub fn cell(x: i64, y: i64, seed: u64) -> f32 {
    let place = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f).rotate_left(23)
        ^ seed.wrapping_mul(0x1656_67b1_9e37_79f9).rotate_left(43);
    (hash(&[place]) >> 40) as f32 / 16_777_216.0
}

/// Smooth noise in 0..1 with `cells` cells across the picture, repeating at its edges.
pub fn noise(uv: Vec2, cells: [i64; 2], seed: u64) -> f32 {
    let ([left, right], x) = between(uv.x * cells[0] as f32, cells[0]);
    let ([upper, lower], y) = between(uv.y * cells[1] as f32, cells[1]);
    let row = |row: i64| {
        let first = cell(left, row, seed);
        first + (cell(right, row, seed) - first) * x
    };
    let top = row(upper);
    top + (row(lower) - top) * y
}

/// The two of `cells` that repeat which a position lies between, and its smooth share of the second. Pictures ask for
/// tens of millions of these: neither a division nor a call where none is needed.
fn between(position: f32, cells: i64) -> ([i64; 2], f32) {
    let towards_zero = i64::from(position as i32);
    let floor = towards_zero - i64::from(towards_zero as f32 > position);
    let first = if (0..cells).contains(&floor) { floor } else { floor.rem_euclid(cells) };
    let second = if first + 1 == cells { 0 } else { first + 1 };
    let share = position - floor as f32;
    ([first, second], share * share * (3.0 - 2.0 * share))
}

/// Noise of `octaves`, each twice as fine and half as strong as the last; 0..1.
pub fn clouds(uv: Vec2, cells: i64, octaves: u32, seed: u64) -> f32 {
    let (mut sum, mut weight) = (0.0, 0.0);
    for octave in 0..octaves {
        let strength = 0.5f32.powi(octave as i32);
        sum += strength * noise(uv, [cells << octave; 2], seed + u64::from(octave));
        weight += strength;
    }
    sum / weight
}

/// Where `uv` lies in a bond of `columns` x `rows` bricks, odd rows moved by half a brick: the brick's
/// number, the distance to its edge in parts of its height, and the position in it.
pub struct Bond {
    /// Column and row.
    pub brick: [i64; 2],
    /// 0 at the edge, 0.5 in the middle of a brick's height.
    pub edge: f32,
    /// 0..1 across the brick.
    pub inside: Vec2,
}

/// See [`Bond`]. `rows` must be even for the picture to tile.
pub fn bond(uv: Vec2, columns: i64, rows: i64) -> Bond {
    let y = uv.y * rows as f32;
    let row = y.floor();
    let x = uv.x * columns as f32 + if row as i64 % 2 == 0 { 0.0 } else { 0.5 };
    let inside = Vec2::new(x - x.floor(), y - row);
    let aspect = rows as f32 / columns as f32;
    let edge = (inside.x.min(1.0 - inside.x) * aspect).min(inside.y.min(1.0 - inside.y));
    Bond { brick: [(x.floor() as i64).rem_euclid(columns), row as i64], edge, inside }
}

/// 0 below `low`, 1 above `high`, smooth between.
pub fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// Blends two colours, opaque.
pub fn mix(a: Vec3, b: Vec3, t: f32) -> Vec3 {
    a + (b - a) * t
}

/// A colour as an opaque texel.
pub fn opaque(colour: Vec3) -> [f32; 4] {
    [colour.x, colour.y, colour.z, 1.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_tiles_and_stays_in_range() {
        for i in 0..100 {
            let t = i as f32 / 100.0;
            let (left, right) =
                (clouds(Vec2::new(0.0, t), 4, 5, 1), clouds(Vec2::new(0.999_999, t), 4, 5, 1));
            assert!((left - right).abs() < 1e-3 && (0.0..=1.0).contains(&left), "{left} {right}");
        }
    }

    #[test]
    fn positions_lie_between_cells_that_repeat() {
        for (position, cells, share) in [
            (0.5, [0, 1], 0.5),
            (3.0, [3, 0], 0.0),
            (4.5, [0, 1], 0.5),
            (-0.5, [3, 0], 0.5),
            (-4.0, [0, 1], 0.0),
            (-4.25, [3, 0], 0.84375),
        ] {
            assert_eq!(between(position, 4), (cells, share), "{position}");
        }
    }

    #[test]
    fn a_flat_height_has_a_straight_normal() {
        let bytes = normal_map(8, |_| 0.3);
        let texels = image::load_from_memory(&bytes).unwrap().into_rgb8();
        assert!(texels.pixels().all(|p| p.0 == [128, 128, 255]));
    }

    #[test]
    fn slopes_turn_normals_away() {
        // Higher to the right: the normal leans left. Higher to the bottom: it leans up.
        let texel = |height: fn(Vec2) -> f32| {
            image::load_from_memory(&normal_map(16, height)).unwrap().into_rgb8().get_pixel(8, 8).0
        };
        assert!(texel(|uv| uv.x)[0] < 60);
        assert!(texel(|uv| uv.y)[1] > 190);
    }
}
