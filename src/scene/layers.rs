//! What a material may have beside metallic-roughness.

use glam::Vec3;

use super::material::TextureRef;

/// KHR_materials_specular, _ior, _clearcoat, _sheen and _anisotropy; and _pbrSpecularGlossiness, which becomes a
/// dielectric with a coloured specular reflection. Factors are linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Layers {
    /// The dielectric's F0 before its weight: ((ior - 1) / (ior + 1))² times the specular colour.
    pub dielectric: Vec3,
    /// Specular colour texture (sRGB).
    pub specular_color_texture: Option<TextureRef>,
    /// Weight of the dielectric's specular reflection, 0 to 1.
    pub specular: f32,
    /// Its texture, in A.
    pub specular_texture: Option<TextureRef>,
    /// The metallic-roughness texture has glossiness in A instead, and [`super::Material::roughness`] is 1 less the
    /// glossiness factor.
    pub glossy: bool,
    /// Clearcoat's weight, 0 to 1.
    pub coat: f32,
    /// Its texture, in R.
    pub coat_texture: Option<TextureRef>,
    /// Clearcoat's perceptual roughness.
    pub coat_roughness: f32,
    /// Its texture, in G.
    pub coat_roughness_texture: Option<TextureRef>,
    /// Clearcoat's own normal map; without one it has the vertices' normals.
    pub coat_normal_texture: Option<TextureRef>,
    /// Scale of that map's x and y.
    pub coat_normal_scale: f32,
    /// Sheen's colour; black is none.
    pub sheen_color: Vec3,
    /// Its texture (sRGB).
    pub sheen_color_texture: Option<TextureRef>,
    /// Sheen's perceptual roughness.
    pub sheen_roughness: f32,
    /// Its texture, in A.
    pub sheen_roughness_texture: Option<TextureRef>,
    /// Anisotropy's strength, 0 to 1.
    pub anisotropy: f32,
    /// Radians from the tangent, counter-clockwise, to the direction along which highlights are stretched.
    pub anisotropy_rotation: f32,
    /// Direction in RG, strength in B.
    pub anisotropy_texture: Option<TextureRef>,
}

impl Default for Layers {
    /// What a material without any of the extensions has.
    fn default() -> Self {
        Layers {
            dielectric: Vec3::splat(0.04),
            specular_color_texture: None,
            specular: 1.0,
            specular_texture: None,
            glossy: false,
            coat: 0.0,
            coat_texture: None,
            coat_roughness: 0.0,
            coat_roughness_texture: None,
            coat_normal_texture: None,
            coat_normal_scale: 1.0,
            sheen_color: Vec3::ZERO,
            sheen_color_texture: None,
            sheen_roughness: 0.0,
            sheen_roughness_texture: None,
            anisotropy: 0.0,
            anisotropy_rotation: 0.0,
            anisotropy_texture: None,
        }
    }
}

impl Layers {
    /// Whether the specular reflection has a colour. What passes it then has the least of the channels' shares, so
    /// that it does not take the complementary colour (KHR_materials_specular).
    pub fn is_tinted(&self) -> bool {
        self.specular_color_texture.is_some()
            || self.dielectric.min_element() != self.dielectric.max_element()
    }

    /// The textures, in the order of the kernels' names for them.
    pub fn textures(&self) -> [Option<TextureRef>; 8] {
        [
            self.specular_texture,
            self.specular_color_texture,
            self.coat_texture,
            self.coat_roughness_texture,
            self.coat_normal_texture,
            self.sheen_color_texture,
            self.sheen_roughness_texture,
            self.anisotropy_texture,
        ]
    }

    /// The same to be set.
    pub fn textures_mut(&mut self) -> [&mut Option<TextureRef>; 8] {
        [
            &mut self.specular_texture,
            &mut self.specular_color_texture,
            &mut self.coat_texture,
            &mut self.coat_roughness_texture,
            &mut self.coat_normal_texture,
            &mut self.sheen_color_texture,
            &mut self.sheen_roughness_texture,
            &mut self.anisotropy_texture,
        ]
    }
}
