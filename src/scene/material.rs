//! glTF's metallic-roughness material, as the kernels need it.

use glam::{Mat2, Vec2, Vec3, Vec4};

use super::layers::Layers;

/// A use of a texture by a material.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureRef {
    /// Index into [`crate::scene::Scene::textures`].
    pub texture: u32,
    /// Which of the mesh's two texture coordinate slots.
    pub uv_slot: u32,
    /// KHR_texture_transform: uv' = matrix * uv + offset.
    pub matrix: Mat2,
    /// See `matrix`.
    pub offset: Vec2,
}

/// glTF's alpha modes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum AlphaMode {
    /// Alpha is ignored.
    Opaque,
    /// Visible where alpha is at least the cutoff.
    Mask(f32),
    /// Covers a fraction alpha of what is behind.
    Blend,
}

/// A metallic-roughness material. Factors are linear.
#[derive(Clone, Debug, PartialEq)]
pub struct Material {
    /// The file's name for it, or empty.
    pub name: String,
    /// Base colour and alpha factor.
    pub base_color: Vec4,
    /// Base colour texture (sRGB, alpha in A).
    pub base_color_texture: Option<TextureRef>,
    /// Metalness factor.
    pub metallic: f32,
    /// Perceptual roughness factor; the GGX alpha is its square.
    pub roughness: f32,
    /// Roughness in G, metalness in B (linear).
    pub metallic_roughness_texture: Option<TextureRef>,
    /// Tangent-space normals (linear).
    pub normal_texture: Option<TextureRef>,
    /// Scale of the normal map's x and y.
    pub normal_scale: f32,
    /// Ambient occlusion in R (linear); dims environment light only.
    pub occlusion_texture: Option<TextureRef>,
    /// 0: the occlusion texture does nothing; 1: all of it.
    pub occlusion_strength: f32,
    /// Emitted radiance factor, KHR_materials_emissive_strength multiplied in.
    pub emissive: Vec3,
    /// Emission texture (sRGB).
    pub emissive_texture: Option<TextureRef>,
    /// How alpha is used.
    pub alpha: AlphaMode,
    /// Seen from both sides.
    pub double_sided: bool,
    /// KHR_materials_unlit: the base colour is what is seen.
    pub unlit: bool,
    /// What extensions add; none in most materials.
    pub layers: Option<Box<Layers>>,
    /// It is glass.
    pub glass: Option<Glass>,
}

/// KHR_materials_transmission, with KHR_materials_volume where there is an inside.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glass {
    /// How much light passes instead of being reflected diffusely, 0 to 1.
    pub transmission: f32,
    /// Its texture, in R.
    pub texture: Option<TextureRef>,
    /// Index of refraction (KHR_materials_ior), 1 or more.
    pub ior: f32,
    /// There is an inside (KHR_materials_volume's thickness is above 0): light is refracted. Thin glass lets it go
    /// on straight. The loader makes what is solid double-sided.
    pub solid: bool,
    /// What the inside absorbs, a metre.
    pub attenuation: Vec3,
}

impl Material {
    /// The share of light for other surfaces that passes this one straight: what glass lets through along its
    /// normal, without its textures. Light that glass bundles is not looked for.
    pub fn clear(&self) -> f32 {
        let Some(glass) = &self.glass else { return 0.0 };
        let base = self.base_color;
        let color = 0.2126 * base.x + 0.7152 * base.y + 0.0722 * base.z;
        let passed = if glass.solid { color.max(0.0).sqrt() } else { color };
        let reflected = ((glass.ior - 1.0) / (glass.ior + 1.0)).powi(2);
        (glass.transmission * (1.0 - self.metallic) * (1.0 - reflected) * passed).clamp(0.0, 1.0)
    }
}

/// Below this roughness reflections differ from pixel to pixel.
const GLOSSY_ROUGHNESS: f32 = 0.5;
/// The part of a material that has to be so smooth.
const GLOSSY_PART: f32 = 0.2;

impl Material {
    /// Whether it covers what is behind in part only, so that some of the light passes.
    pub fn lets_light_pass(&self) -> bool {
        self.alpha == AlphaMode::Blend || self.glass.is_some()
    }

    /// Whether samples are too sparse for its reflections: a good part of it is smooth, or it is a bumpy metal. Layers and glass are not: what pixels expect is a single lobe over an opaque base.
    pub fn is_glossy(&self, textures: &[super::Texture]) -> bool {
        if self.unlit || self.layers.is_some() || self.glass.is_some() {
            return false;
        }
        let finest = self.metallic_roughness_texture.and_then(|t| textures.get(t.texture as usize));
        // Single texels do not count.
        let of_texture = |channel: usize, share: f32| {
            finest.map_or(1.0, |texture| {
                let mut codes = [0usize; 256];
                let (first, width, height) = texture.level(0);
                let texels = &texture.texels[first..first + width as usize * height as usize];
                texels.iter().for_each(|texel| codes[texel[channel] as usize] += 1);
                let (mut sum, wanted) = (0, (texels.len() as f32 * share) as usize);
                let code = codes.iter().position(|&count| {
                    sum += count;
                    sum > wanted
                });
                code.unwrap_or(255) as f32 / 255.0
            })
        };
        let bumpy = self.normal_texture.is_some();
        let smooth = self.roughness * of_texture(1, GLOSSY_PART);
        let metallest = self.metallic * of_texture(2, 0.99);
        smooth < GLOSSY_ROUGHNESS || bumpy && metallest > 0.5
    }
}

impl Default for Material {
    /// glTF's default material.
    fn default() -> Self {
        Material {
            name: String::new(),
            base_color: Vec4::ONE,
            base_color_texture: None,
            metallic: 1.0,
            roughness: 1.0,
            metallic_roughness_texture: None,
            normal_texture: None,
            normal_scale: 1.0,
            occlusion_texture: None,
            occlusion_strength: 1.0,
            emissive: Vec3::ZERO,
            emissive_texture: None,
            alpha: AlphaMode::Opaque,
            double_sided: false,
            unlit: false,
            layers: None,
            glass: None,
        }
    }
}
