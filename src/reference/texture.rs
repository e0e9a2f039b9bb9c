//! Texture lookups in `f64`: wrap, decode, then filter.

use glam::{DVec2, DVec4};

use crate::scene::texture::{Texture, Wrap};

/// Which level of textures is read.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum TextureMode {
    /// The full image, bilinear (or the nearest texel where the file asks for it).
    #[default]
    Level0,
    /// Trilinear at this level of detail, for every texture of a hit; see [`sample`].
    Level(f64),
}

impl TextureMode {
    fn level(self) -> f64 {
        match self {
            TextureMode::Level0 => 0.0,
            TextureMode::Level(level) => level,
        }
    }
}

/// The linear RGBA of a texture at `uv`; (0, 0) is the upper left corner of the first texel.
///
/// Texels are decoded before they are filtered. At levels above 0 two bilinear lookups are mixed; at 0 and
/// below a texture that asks for NEAREST gives the texel that holds `uv`.
pub fn sample(texture: &Texture, uv: DVec2, mode: TextureMode) -> DVec4 {
    let level = mode.level().clamp(0.0, f64::from(texture.levels() - 1));
    if level == 0.0 && texture.nearest {
        return nearest(texture, uv);
    }
    let lower = level.floor();
    let finer = bilinear(texture, uv, lower as u32);
    if level == lower {
        return finer;
    }
    finer.lerp(bilinear(texture, uv, lower as u32 + 1), level - lower)
}

/// The linear value of an sRGB code in 0..1 (IEC 61966-2-1).
pub fn linear_from_srgb(code: f64) -> f64 {
    if code <= 0.04045 { code / 12.92 } else { ((code + 0.055) / 1.055).powf(2.4) }
}

fn nearest(texture: &Texture, uv: DVec2) -> DVec4 {
    let size = level_size(texture, 0);
    let place = uv * DVec2::new(size.0 as f64, size.1 as f64);
    texel(texture, 0, place.x.floor() as i64, place.y.floor() as i64)
}

fn bilinear(texture: &Texture, uv: DVec2, level: u32) -> DVec4 {
    let size = level_size(texture, level);
    let place = uv * DVec2::new(size.0 as f64, size.1 as f64) - 0.5;
    let (x, y) = (place.x.floor() as i64, place.y.floor() as i64);
    let (right, down) = (place.x - place.x.floor(), place.y - place.y.floor());
    let row = |y: i64| texel(texture, level, x, y).lerp(texel(texture, level, x + 1, y), right);
    row(y).lerp(row(y + 1), down)
}

fn level_size(texture: &Texture, level: u32) -> (usize, usize) {
    ((texture.width >> level).max(1) as usize, (texture.height >> level).max(1) as usize)
}

fn texel(texture: &Texture, level: u32, x: i64, y: i64) -> DVec4 {
    let (width, height) = level_size(texture, level);
    let before: usize = (0..level).map(|finer| level_size(texture, finer)).map(|(w, h)| w * h).sum();
    let (x, y) = (wrapped(x, width, texture.wrap[0]), wrapped(y, height, texture.wrap[1]));
    let code = texture.texels[before + y * width + x].map(|byte| f64::from(byte) / 255.0);
    let rgba = DVec4::from_array(code);
    if texture.srgb { rgba.truncate().map(linear_from_srgb).extend(rgba.w) } else { rgba }
}

fn wrapped(index: i64, size: usize, wrap: Wrap) -> usize {
    let size = size as i64;
    let index = match wrap {
        Wrap::Repeat => index.rem_euclid(size),
        Wrap::ClampToEdge => index.clamp(0, size - 1),
        Wrap::MirroredRepeat => {
            let index = index.rem_euclid(2 * size);
            index.min(2 * size - 1 - index)
        }
    };
    index as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Four grey columns 0, 51, 102, 255 in one row, then its levels.
    fn ramp(wrap: Wrap) -> Texture {
        let texels = [0u8, 51, 102, 255, 25, 178, 101].map(|grey| [grey, grey, grey, 255]).to_vec();
        Texture { texels: texels.into(), width: 4, height: 1, srgb: false, wrap: [wrap; 2], nearest: false }
    }

    fn red(texture: &Texture, u: f64, mode: TextureMode) -> f64 {
        sample(texture, DVec2::new(u, 0.3), mode).x * 255.0
    }

    #[test]
    fn centres_give_texels_and_wraps_differ_outside() {
        use Wrap::{ClampToEdge, MirroredRepeat, Repeat};
        for (wrap, u, expected) in [
            (Repeat, 0.375, 51.0),
            (Repeat, 0.5, 76.5),
            (Repeat, 0.0, 127.5),
            (Repeat, -0.625, 51.0),
            (ClampToEdge, -3.0, 0.0),
            (ClampToEdge, 1.0, 255.0),
            (MirroredRepeat, 1.125, 255.0),
            (MirroredRepeat, 1.375, 102.0),
            (MirroredRepeat, -0.375, 51.0),
        ] {
            let found = red(&ramp(wrap), u, TextureMode::Level0);
            assert!((found - expected).abs() < 1e-9, "{wrap:?} {u}: {found}");
        }
    }

    #[test]
    fn levels_are_mixed_and_clamped() {
        let texture = ramp(Wrap::Repeat);
        assert!((red(&texture, 0.25, TextureMode::Level(1.0)) - 25.0).abs() < 1e-9);
        assert!((red(&texture, 0.25, TextureMode::Level(1.25)) - (25.0 * 0.75 + 101.0 * 0.25)).abs() < 1e-9);
        assert!((red(&texture, 0.25, TextureMode::Level(99.0)) - 101.0).abs() < 1e-9);
    }

    #[test]
    fn srgb_is_decoded_before_filtering_and_alpha_is_not_decoded() {
        let texture = Texture { srgb: true, ..ramp(Wrap::Repeat) };
        let found = sample(&texture, DVec2::new(0.75, 0.5), TextureMode::Level0);
        // 102/255 = 0.4 is 0.132868 in linear light.
        assert!((found.x - (0.132_868_3 + 1.0) / 2.0).abs() < 1e-6, "{found}");
        assert_eq!(found.w, 1.0);
    }

    #[test]
    fn nearest_texture_is_not_filtered_when_magnified() {
        let texture = Texture { nearest: true, ..ramp(Wrap::Repeat) };
        assert!((red(&texture, 0.49, TextureMode::Level0) - 51.0).abs() < 1e-9);
        assert!((red(&texture, 1.76, TextureMode::Level0) - 255.0).abs() < 1e-9);
    }
}
