//! Materials, reduced to what is really needed of them.
//!
//! In two steps, because the second looks into the images that the first one asks for: [`Draft::new`]
//! leaves out textures that a factor makes ineffective, [`Draft::simplify`] folds what is constant over
//! an image into the factors and finds alpha that is never used.

use std::collections::HashMap;
use std::sync::Arc;

use glam::{Mat2, Vec2, Vec3, Vec4};

use super::images::Decoded;
use super::json::{self, Document, TextureInfo};
use super::{Outcome, finite};
use crate::scene::animation::{Made, PLACED_TEXTURES, Paint, UvTransform};
use crate::scene::texture::{Sampling, Wrap, srgb_to_linear};
use crate::scene::{AlphaMode, Layers, Material, TextureRef};

const BASE_COLOR: usize = 0;
const METALLIC_ROUGHNESS: usize = 1;
const NORMAL: usize = 2;
const OCCLUSION: usize = 3;
const EMISSIVE: usize = 4;
/// Where those of [`Layers`] begin, in the order of [`Layers::textures`].
const LAYERS: usize = 5;
const SPECULAR_COLOR: usize = LAYERS + 1;
const SHEEN_COLOR: usize = LAYERS + 5;
const COAT_NORMAL: usize = LAYERS + 4;
const TRANSMISSION: usize = LAYERS + 8;
const ROLES: usize = 14;

/// A use of an image that has no texture index yet.
#[derive(Clone, Copy)]
pub struct Use {
    /// Index of the document's image.
    pub image: usize,
    /// How it is read.
    pub sampling: Sampling,
    /// Which TEXCOORD set places it.
    set: usize,
    matrix: Mat2,
    offset: Vec2,
}

/// A material on its way: factors are final when simplified, textures are not yet numbered.
pub struct Draft {
    material: Material,
    uses: [Option<Use>; ROLES],
    made: Made,
}

/// A finished material, and the TEXCOORD set that each of the mesh's slots holds for it.
pub struct Finished {
    /// The material.
    pub material: Material,
    /// For each slot of the mesh: the TEXCOORD set to read it from, if any.
    pub sets: [Option<usize>; 2],
    /// What was multiplied into it beside the file's factors.
    pub made: Made,
}

impl Draft {
    /// Material `index` of the document, or the default material, with what animations have made of it.
    pub fn new(
        document: &Document,
        index: Option<usize>,
        paint: &Paint,
        warnings: &mut Vec<String>,
    ) -> Outcome<Self> {
        let made = Made::default();
        let Some(index) = index else {
            return Ok(Draft { material: Material::default(), uses: [None; ROLES], made });
        };
        let source = &document.materials[index];
        let (mut material, rest) = (factors(source, index)?, rest(source));
        paint.apply(&rest, &made, &mut material);
        let infos = infos_of(source);
        let lit = !material.unlit;
        let glossy = material.layers.as_ref().is_some_and(|layers| layers.glossy);
        let mut effective = [false; ROLES];
        effective[..LAYERS].copy_from_slice(&[
            material.base_color.truncate() != Vec3::ZERO || material.alpha != AlphaMode::Opaque,
            lit && (material.metallic > 0.0 || material.roughness > 0.0 || glossy),
            lit && material.normal_scale != 0.0,
            lit && material.occlusion_strength > 0.0,
            lit && material.emissive != Vec3::ZERO,
        ]);
        effective[LAYERS..TRANSMISSION].copy_from_slice(&effective_layers(material.layers.as_deref()));
        effective[TRANSMISSION] = material.glass.is_some();
        let mut uses = [None; ROLES];
        for (role, info) in infos.iter().enumerate().filter(|&(role, _)| effective[role]) {
            let Some(info) = info else { continue };
            // Glossiness is in the alpha of a colour.
            let glossiness = glossy && role == METALLIC_ROUGHNESS;
            let srgb = [BASE_COLOR, EMISSIVE, SPECULAR_COLOR, SHEEN_COLOR].contains(&role) || glossiness;
            uses[role] = use_of(document, info, srgb)?;
            if uses[role].is_none() {
                warnings.push(format!(
                    "texture {} has no image of a kind that is read, and was left out",
                    info.index.0
                ));
            }
            if let (Some(placed), Some(uv)) =
                (&mut uses[role], (role < PLACED_TEXTURES).then(|| paint.uv(&rest, role)).flatten())
            {
                (placed.matrix, placed.offset) = uv;
            }
        }
        Ok(Draft { material, uses, made })
    }

    /// The images that it reads.
    pub fn images(&self) -> impl Iterator<Item = usize> {
        self.uses.iter().flatten().map(|texture| texture.image)
    }

    /// Whether it may turn out to need tangents.
    pub fn needs_tangents(&self) -> bool {
        let anisotropic = self.material.layers.as_ref().is_some_and(|layers| layers.anisotropy > 0.0);
        self.uses[NORMAL].is_some() || self.uses[COAT_NORMAL].is_some() || anisotropic
    }

    /// Removes what cannot be seen, given the images and the least alpha of the vertex colours.
    pub fn simplify(&mut self, images: &HashMap<usize, Arc<Decoded>>, vertex_alpha: f32) {
        self.leave_out_unusable(images);
        self.simplify_alpha(images, vertex_alpha);
        let ranges = self.uses.map(|texture| texture.map(|texture| &*images[&texture.image]));
        let constant = |role: usize, channels: &[usize]| {
            ranges[role].filter(|d| channels.iter().all(|&c| d.low[c] == d.high[c])).map(|d| d.low)
        };
        let material = &mut self.material;
        let linear = |texel: [u8; 4]| Vec3::from([texel[0], texel[1], texel[2]].map(srgb_to_linear));
        let fraction = |value: u8| f32::from(value) / 255.0;

        let color_channels: &[usize] =
            if material.alpha == AlphaMode::Opaque { &[0, 1, 2] } else { &[0, 1, 2, 3] };
        if let Some(texel) = constant(BASE_COLOR, color_channels) {
            let color = linear(texel).extend(fraction(texel[3]));
            material.base_color *= color;
            self.made.base_color *= color;
            self.uses[BASE_COLOR] = None;
        }
        let needed: Vec<usize> = [(material.roughness, 1), (material.metallic, 2)]
            .iter()
            .filter(|f| f.0 > 0.0)
            .map(|f| f.1)
            .collect();
        let glossy = material.layers.as_ref().is_some_and(|layers| layers.glossy);
        if let Some(texel) = constant(METALLIC_ROUGHNESS, &needed).filter(|_| !glossy) {
            material.roughness *= fraction(texel[1]);
            material.metallic *= fraction(texel[2]);
            self.uses[METALLIC_ROUGHNESS] = None;
        }
        // Flat is (127.5, 127.5, 255), which eight bits cannot say; both neighbours are meant to be it.
        let flat = |texel: [u8; 4]| {
            (127..=128).contains(&texel[0]) && (127..=128).contains(&texel[1]) && texel[2] >= 254
        };
        if ranges[NORMAL].is_some_and(|d| flat(d.low) && flat(d.high)) {
            self.uses[NORMAL] = None;
        }
        if constant(OCCLUSION, &[0]).is_some_and(|texel| texel[0] == 255) {
            self.uses[OCCLUSION] = None;
        }
        if let Some(texel) = constant(EMISSIVE, &[0, 1, 2]) {
            material.emissive *= linear(texel);
            self.made.emissive *= linear(texel);
            self.uses[EMISSIVE] = None;
        }
    }

    /// Only colours show that an image is not usable; others would have to be taken for data.
    fn leave_out_unusable(&mut self, images: &HashMap<usize, Arc<Decoded>>) {
        for role in (0..self.uses.len()).filter(|&role| role != BASE_COLOR) {
            if self.uses[role].take_if(|texture| images[&texture.image].stand_in).is_none() {
                continue;
            }
            match role {
                METALLIC_ROUGHNESS => self.material.metallic = 0.0,
                EMISSIVE => (self.material.emissive, self.made.emissive) = (Vec3::ZERO, Vec3::ZERO),
                _ => {}
            }
        }
    }

    /// MASK and BLEND that never hide anything become Opaque.
    fn simplify_alpha(&mut self, images: &HashMap<usize, Arc<Decoded>>, vertex_alpha: f32) {
        let texture =
            self.uses[BASE_COLOR].map_or(1.0, |texture| f32::from(images[&texture.image].low[3]) / 255.0);
        let least = self.material.base_color.w * texture * vertex_alpha;
        let opaque = match self.material.alpha {
            AlphaMode::Opaque => true,
            AlphaMode::Mask(cutoff) => least >= cutoff,
            AlphaMode::Blend => least >= 1.0,
        };
        if opaque {
            self.material.alpha = AlphaMode::Opaque;
            if self.material.base_color.truncate() == Vec3::ZERO {
                self.uses[BASE_COLOR] = None;
            }
        }
    }

    /// Numbers the textures and gives the TEXCOORD sets to the mesh's two slots.
    pub fn finish(mut self, textures: &mut TextureTable, warnings: &mut Vec<String>) -> Finished {
        let mut sets = [None; 2];
        let mut too_many = false;
        let refs = self.uses.map(|texture| {
            let texture = texture?;
            let free = sets.iter().position(|&set| set.is_none_or(|set| set == texture.set));
            too_many |= free.is_none();
            let slot = free.unwrap_or(0);
            sets[slot].get_or_insert(texture.set);
            Some(TextureRef {
                texture: textures.number(&texture),
                uv_slot: slot as u32,
                matrix: texture.matrix,
                offset: texture.offset,
            })
        });
        if too_many {
            let name = &self.material.name;
            warnings.push(format!("material {name:?} uses more than two sets of texture coordinates; the others were replaced by its first"));
        }
        let (base, layers) = refs.split_at(LAYERS);
        self.material.base_color_texture = base[BASE_COLOR];
        self.material.metallic_roughness_texture = base[METALLIC_ROUGHNESS];
        self.material.normal_texture = base[NORMAL];
        self.material.occlusion_texture = base[OCCLUSION];
        self.material.emissive_texture = base[EMISSIVE];
        if let Some(own) = &mut self.material.layers {
            own.textures_mut().into_iter().zip(layers).for_each(|(texture, new)| *texture = *new);
        }
        if let Some(glass) = &mut self.material.glass {
            glass.texture = refs[TRANSMISSION];
        }
        Finished { material: self.material, sets, made: self.made }
    }
}

/// Numbers image uses: the same image read in the same way is one texture.
#[derive(Default)]
pub struct TextureTable {
    numbers: HashMap<(usize, Sampling), u32>,
    /// Image and sampling of each texture.
    pub list: Vec<(usize, Sampling)>,
}

impl TextureTable {
    fn number(&mut self, texture: &Use) -> u32 {
        let key = (texture.image, texture.sampling);
        *self.numbers.entry(key).or_insert_with(|| {
            self.list.push(key);
            (self.list.len() - 1) as u32
        })
    }
}

/// The textures of a material by their roles. Specular-glossiness takes the place of metallic-roughness.
fn infos_of(source: &json::Material) -> [Option<&TextureInfo>; ROLES] {
    let (pbr, layers) = (&source.pbr_metallic_roughness, &source.extensions.layers);
    let mut infos = [None; ROLES];
    infos[BASE_COLOR] = pbr.base_color_texture.as_ref();
    infos[METALLIC_ROUGHNESS] = pbr.metallic_roughness_texture.as_ref();
    if let Some(glossiness) = &layers.glossiness {
        infos[BASE_COLOR] = glossiness.diffuse_texture.as_ref();
        infos[METALLIC_ROUGHNESS] = glossiness.specular_glossiness_texture.as_ref();
    }
    infos[NORMAL] = source.normal_texture.as_ref();
    infos[OCCLUSION] = source.occlusion_texture.as_ref();
    infos[EMISSIVE] = source.emissive_texture.as_ref();
    infos[LAYERS..TRANSMISSION].copy_from_slice(&layers.textures());
    infos[TRANSMISSION] = layers.transmission_texture();
    infos
}

/// Which textures of layers change something, in the order of [`Layers::textures`].
fn effective_layers(layers: Option<&Layers>) -> [bool; TRANSMISSION - LAYERS] {
    let Some(layers) = layers else { return [false; TRANSMISSION - LAYERS] };
    let specular = layers.specular > 0.0;
    let (coat, sheen) = (layers.coat > 0.0, layers.sheen_color != Vec3::ZERO);
    let colored = specular && layers.dielectric != Vec3::ZERO;
    let rough = sheen && layers.sheen_roughness > 0.0;
    [specular, colored, coat, coat, coat, sheen, rough, layers.anisotropy > 0.0]
}

fn factors(source: &json::Material, index: usize) -> Outcome<Material> {
    let mut material = metallic_roughness(source, index)?;
    if material.unlit {
        return Ok(material);
    }
    material.layers = source.extensions.layers.layers();
    material.glass = source.extensions.layers.glass();
    // Rays meet the far side of what is solid from inside.
    material.double_sided |= material.glass.is_some_and(|glass| glass.solid);
    if let Some(glossiness) = &source.extensions.layers.glossiness {
        let fraction = |value: f64| finite(value.clamp(0.0, 1.0));
        material.base_color = glossiness.diffuse_factor.unwrap_or([1.0; 4]).map(fraction).into();
        material.metallic = 0.0;
        material.roughness = 1.0 - fraction(glossiness.glossiness_factor.unwrap_or(1.0));
    }
    Ok(material)
}

fn metallic_roughness(source: &json::Material, index: usize) -> Outcome<Material> {
    let pbr = &source.pbr_metallic_roughness;
    let fraction = |value: Option<f64>| finite(value.unwrap_or(1.0).clamp(0.0, 1.0));
    let unlit = source.extensions.unlit.is_some();
    let strength =
        source.extensions.emissive_strength.as_ref().and_then(|e| e.emissive_strength).unwrap_or(1.0);
    let emissive = source.emissive_factor.unwrap_or([0.0; 3]).map(|value| finite(value * strength).max(0.0));
    let alpha = match source.alpha_mode.as_deref() {
        None | Some("OPAQUE") => AlphaMode::Opaque,
        Some("MASK") => AlphaMode::Mask(finite(source.alpha_cutoff.unwrap_or(0.5))),
        Some("BLEND") => AlphaMode::Blend,
        Some(other) => {
            return Err(format!(
                "material {index} has the unknown alpha mode {other:?}; export the scene again"
            ));
        }
    };
    Ok(Material {
        name: source.name.clone().unwrap_or_default(),
        base_color: Vec4::from(pbr.base_color_factor.unwrap_or([1.0; 4]).map(|value| fraction(Some(value)))),
        metallic: fraction(pbr.metallic_factor),
        roughness: fraction(pbr.roughness_factor),
        normal_scale: finite(source.normal_texture.as_ref().and_then(|t| t.scale).unwrap_or(1.0)),
        occlusion_strength: fraction(source.occlusion_texture.as_ref().and_then(|t| t.strength)),
        emissive: if unlit { Vec3::ZERO } else { emissive.into() },
        alpha,
        double_sided: source.double_sided,
        unlit,
        ..Material::default()
    })
}

fn use_of(document: &Document, info: &TextureInfo, srgb: bool) -> Outcome<Option<Use>> {
    let texture = &document.textures[info.index.0];
    let Some(image) = texture.image() else { return Ok(None) };
    let sampling = match texture.sampler {
        Some(sampler) => sampling(&document.samplers[sampler.0], sampler.0, srgb)?,
        None => Sampling { srgb, wrap: [Wrap::Repeat; 2], nearest: false },
    };
    let transform = info.extensions.transform.as_ref();
    let set = transform.and_then(|t| t.tex_coord).unwrap_or(info.tex_coord).0;
    let (matrix, offset) = uv_transform(info).matrix();
    Ok(Some(Use { image, sampling, set, matrix, offset }))
}

/// Where a texture lies.
fn uv_transform(info: &TextureInfo) -> UvTransform {
    info.extensions.transform.as_ref().map_or_else(UvTransform::default, |transform| UvTransform {
        offset: transform.offset,
        rotation: transform.rotation,
        scale: transform.scale,
    })
}

/// What the file says of what animations may change.
pub fn rest(source: &json::Material) -> Paint {
    let infos = infos_of(source);
    let strength = source.extensions.emissive_strength.as_ref().and_then(|e| e.emissive_strength);
    let has_base = source.extensions.layers.glossiness.is_none();
    Paint {
        base_color: has_base.then(|| source.pbr_metallic_roughness.base_color_factor.unwrap_or([1.0; 4])),
        emissive: source.emissive_factor,
        strength,
        textures: std::array::from_fn(|role| infos[role].map(uv_transform).unwrap_or_default()),
    }
}

fn sampling(sampler: &json::Sampler, index: usize, srgb: bool) -> Outcome<Sampling> {
    let unknown = |what: &str, code: usize| {
        format!("sampler {index} has the unknown {what} {code}; export the scene again")
    };
    let wrap = |code: Option<json::Int>| match code.map_or(10_497, |code| code.0) {
        10_497 => Ok(Wrap::Repeat),
        33_071 => Ok(Wrap::ClampToEdge),
        33_648 => Ok(Wrap::MirroredRepeat),
        other => Err(unknown("wrap mode", other)),
    };
    let nearest = match sampler.mag_filter.map(|code| code.0) {
        None | Some(9729) => false,
        Some(9728) => true,
        Some(other) => return Err(unknown("magnification filter", other)),
    };
    Ok(Sampling { srgb, wrap: [wrap(sampler.wrap_s)?, wrap(sampler.wrap_t)?], nearest })
}
