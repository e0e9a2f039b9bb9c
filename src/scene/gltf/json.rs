//! The parts of a glTF document that a scene needs, as the file says them.
//!
//! These types are our own for four reasons: integers may be written as `1.0` (glTF 2.0, 2.6 "JSON
//! encoding"), indices must not be truncated, KHR_texture_transform belongs to normal and occlusion
//! textures too, and what is not glTF's (extras) or can be done without (animations) must not be able to make a
//! scene unreadable.
//! Fields have the specification's names, meanings and units. Nothing here is checked beyond its type:
//! see [`super::check`].
//!
//! **glTF types of our own** instead of the gltf crate's. Files are not trusted:
//! every index, range and count is checked before use (`src/scene/gltf/check.rs`,
//! `src/scene/gltf/accessor.rs`), and bytes come only from the scene's folder and below
//! (`src/scene/source.rs`). Files that people have need it too. gltf-json 1.4 was tried on small inputs of their
//! kinds and on the cases handed to the project, and `tests/files/types.rs` keeps what came of it:
//!
//! | file | gltf-json 1.4 | what a pass over the JSON would have to do |
//! | --- | --- | --- |
//! | `r_float_ints.glb` | refused: integers written as `1.0` | rewrite every number that is one, and no other |
//! | `r_anim_pointer.glb`, `r_anim_broken.glb` | refused: a channel without a node, a malformed animation | take animations out, and read them beside |
//! | a malformed optional extension | refused | check extensions by their types, as here, then take them out |
//! | `r_wrapped_index.glb`, `r_wrapped_code.glb` | read as other indices: cut to 32 bits without a word | find every index before |
//! | `r_bigtrans.glb` | read as 4500000 m, not 4500000.123 m: `f32` | read translations beside, for every node |
//! | `r_bom.gltf`, `r_chunk_between.glb` | refused: a byte order mark, an unknown chunk | split files here |
//!
//! Such a pass is the reader, written twice, and each of the first five is a fault where it misses a place. What the
//! cases break is then read here once; `tests/files/tolerance.rs` and `tests/files/animations/mod.rs` hold that. The
//! crate serves the tests as a second opinion.

mod animations;
mod extensions;

use std::collections::BTreeMap;
use std::fmt;

use serde::Deserialize as Derive;
use serde::de::{self, Deserialize, Deserializer};

pub use self::animations::{Animation, Channel, Keys};
use self::extensions::lenient;
pub use self::extensions::{
    Draco, Instances, MadeImage, Meshopt, PrimitiveExtensions, TextureExtensions, VariantNames,
    ViewExtensions, Visibility,
};
use super::extensions::LayerExtensions;

/// A count, an offset or an index: an integer that is not negative.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Int(pub usize);

impl<'de> Deserialize<'de> for Int {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Visitor;
        impl de::Visitor<'_> for Visitor {
            type Value = Int;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str("an integer that is not negative")
            }

            fn visit_u64<E: de::Error>(self, value: u64) -> Result<Int, E> {
                usize::try_from(value)
                    .map(Int)
                    .map_err(|_| E::invalid_value(de::Unexpected::Unsigned(value), &self))
            }

            fn visit_f64<E: de::Error>(self, value: f64) -> Result<Int, E> {
                // Beyond 2^53 a double no longer tells one integer from the next.
                if (0.0..=9_007_199_254_740_992.0).contains(&value) && value.fract() == 0.0 {
                    return Ok(Int(value as usize));
                }
                Err(E::invalid_value(de::Unexpected::Float(value), &self))
            }
        }
        deserializer.deserialize_u64(Visitor)
    }
}

/// The document's root.
#[derive(Derive, Default)]
#[serde(rename_all = "camelCase")]
pub struct Document {
    pub asset: Asset,
    #[serde(default)]
    pub extensions_used: Vec<String>,
    #[serde(default)]
    pub extensions_required: Vec<String>,
    #[serde(default)]
    pub accessors: Vec<Accessor>,
    #[serde(default, deserialize_with = "animations::each")]
    pub animations: Vec<Option<Animation>>,
    #[serde(default)]
    pub buffers: Vec<Buffer>,
    #[serde(default)]
    pub buffer_views: Vec<BufferView>,
    #[serde(default)]
    pub cameras: Vec<Camera>,
    #[serde(default)]
    pub images: Vec<Image>,
    #[serde(default)]
    pub materials: Vec<Material>,
    #[serde(default)]
    pub meshes: Vec<Mesh>,
    #[serde(default)]
    pub nodes: Vec<Node>,
    #[serde(default)]
    pub samplers: Vec<Sampler>,
    pub scene: Option<Int>,
    #[serde(default)]
    pub scenes: Vec<SceneRoots>,
    #[serde(default)]
    pub skins: Vec<Skin>,
    #[serde(default)]
    pub textures: Vec<Texture>,
    #[serde(default)]
    pub extensions: RootExtensions,
}

#[derive(Derive, Default)]
#[serde(rename_all = "camelCase")]
pub struct Asset {
    pub version: String,
    pub min_version: Option<String>,
}

#[derive(Derive, Default)]
pub struct RootExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub lights: Option<Lights>,
    #[serde(rename = "KHR_materials_variants", default, deserialize_with = "lenient")]
    pub variants: Option<VariantNames>,
}

#[derive(Derive)]
pub struct Lights {
    #[serde(default)]
    pub lights: Vec<Light>,
}

#[derive(Derive)]
pub struct Light {
    pub color: Option<[f64; 3]>,
    pub intensity: Option<f64>,
    pub range: Option<f64>,
    #[serde(rename = "type")]
    pub kind: String,
    pub spot: Option<Spot>,
}

#[derive(Derive, Default)]
#[serde(rename_all = "camelCase")]
pub struct Spot {
    pub inner_cone_angle: Option<f64>,
    pub outer_cone_angle: Option<f64>,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct Accessor {
    pub buffer_view: Option<Int>,
    #[serde(default)]
    pub byte_offset: Int,
    pub component_type: Int,
    #[serde(default)]
    pub normalized: bool,
    pub count: Int,
    #[serde(rename = "type")]
    pub kind: String,
    pub sparse: Option<Box<Sparse>>,
}

#[derive(Derive)]
pub struct Sparse {
    pub count: Int,
    pub indices: SparseIndices,
    pub values: SparseValues,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct SparseIndices {
    pub buffer_view: Int,
    #[serde(default)]
    pub byte_offset: Int,
    pub component_type: Int,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct SparseValues {
    pub buffer_view: Int,
    #[serde(default)]
    pub byte_offset: Int,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct Buffer {
    pub uri: Option<String>,
    pub byte_length: Int,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct BufferView {
    pub buffer: Int,
    #[serde(default)]
    pub byte_offset: Int,
    pub byte_length: Int,
    pub byte_stride: Option<Int>,
    #[serde(default)]
    pub extensions: ViewExtensions,
}

#[derive(Derive)]
pub struct Camera {
    pub name: Option<String>,
    pub perspective: Option<Perspective>,
    pub orthographic: Option<Orthographic>,
}

#[derive(Derive)]
pub struct Orthographic {
    pub ymag: f64,
}

#[derive(Derive)]
pub struct Perspective {
    pub yfov: f64,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct Image {
    pub name: Option<String>,
    pub uri: Option<String>,
    pub buffer_view: Option<Int>,
    /// Of scenes in other formats, which become documents in memory.
    #[serde(skip)]
    pub made: Option<MadeImage>,
}

#[derive(Derive, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct Material {
    pub name: Option<String>,
    pub pbr_metallic_roughness: MetallicRoughness,
    pub normal_texture: Option<TextureInfo>,
    pub occlusion_texture: Option<TextureInfo>,
    pub emissive_texture: Option<TextureInfo>,
    pub emissive_factor: Option<[f64; 3]>,
    pub alpha_mode: Option<String>,
    pub alpha_cutoff: Option<f64>,
    pub double_sided: bool,
    pub extensions: MaterialExtensions,
}

#[derive(Derive, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct MetallicRoughness {
    pub base_color_factor: Option<[f64; 4]>,
    pub base_color_texture: Option<TextureInfo>,
    pub metallic_factor: Option<f64>,
    pub roughness_factor: Option<f64>,
    pub metallic_roughness_texture: Option<TextureInfo>,
}

#[derive(Derive, Default)]
#[serde(default)]
pub struct MaterialExtensions {
    #[serde(rename = "KHR_materials_unlit")]
    pub unlit: Option<de::IgnoredAny>,
    #[serde(rename = "KHR_materials_emissive_strength")]
    pub emissive_strength: Option<EmissiveStrength>,
    #[serde(flatten)]
    pub layers: LayerExtensions,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct EmissiveStrength {
    pub emissive_strength: Option<f64>,
}

/// `textureInfo`, `normalTextureInfo` and `occlusionTextureInfo` in one.
#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct TextureInfo {
    pub index: Int,
    #[serde(default)]
    pub tex_coord: Int,
    /// Of normal textures only.
    pub scale: Option<f64>,
    /// Of occlusion textures only.
    pub strength: Option<f64>,
    #[serde(default)]
    pub extensions: TextureInfoExtensions,
}

#[derive(Derive, Default)]
pub struct TextureInfoExtensions {
    #[serde(rename = "KHR_texture_transform")]
    pub transform: Option<TextureTransform>,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct TextureTransform {
    pub offset: Option<[f64; 2]>,
    pub rotation: Option<f64>,
    pub scale: Option<[f64; 2]>,
    pub tex_coord: Option<Int>,
}

#[derive(Derive)]
pub struct Mesh {
    pub primitives: Vec<Primitive>,
    #[serde(default)]
    pub weights: Vec<f64>,
}

#[derive(Derive, Default)]
pub struct Primitive {
    pub attributes: BTreeMap<String, Int>,
    pub indices: Option<Int>,
    pub material: Option<Int>,
    pub mode: Option<Int>,
    #[serde(default)]
    pub targets: Vec<BTreeMap<String, Int>>,
    #[serde(default)]
    pub extensions: PrimitiveExtensions,
}

#[derive(Derive, Default)]
#[serde(default)]
pub struct Node {
    pub children: Vec<Int>,
    pub matrix: Option<Box<[f64; 16]>>,
    pub translation: Option<[f64; 3]>,
    pub rotation: Option<[f64; 4]>,
    pub scale: Option<[f64; 3]>,
    pub mesh: Option<Int>,
    pub camera: Option<Int>,
    pub skin: Option<Int>,
    pub weights: Option<Vec<f64>>,
    pub extensions: NodeExtensions,
    #[serde(deserialize_with = "lenient")]
    pub extras: Option<NodeExtras>,
}

/// What the project reads of what a file says beyond glTF.
#[derive(Derive)]
pub struct NodeExtras {
    /// Hands can seize it.
    #[serde(default)]
    pub grab: bool,
}

#[derive(Derive, Default)]
#[serde(default)]
pub struct NodeExtensions {
    #[serde(rename = "KHR_lights_punctual")]
    pub light: Option<LightRef>,
    #[serde(rename = "EXT_mesh_gpu_instancing", default, deserialize_with = "lenient")]
    pub instances: Option<Instances>,
    #[serde(rename = "KHR_node_visibility", default, deserialize_with = "lenient")]
    pub visibility: Option<Visibility>,
}

#[derive(Derive)]
pub struct LightRef {
    pub light: Int,
}

#[derive(Derive, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct Sampler {
    pub mag_filter: Option<Int>,
    pub wrap_s: Option<Int>,
    pub wrap_t: Option<Int>,
}

#[derive(Derive)]
pub struct SceneRoots {
    pub name: Option<String>,
    #[serde(default)]
    pub nodes: Vec<Int>,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct Skin {
    pub inverse_bind_matrices: Option<Int>,
    pub joints: Vec<Int>,
}

#[derive(Derive)]
pub struct Texture {
    pub sampler: Option<Int>,
    pub source: Option<Int>,
    #[serde(default)]
    pub extensions: TextureExtensions,
}
