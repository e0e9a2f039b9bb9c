//! What extensions add to a document, apart from materials.

use std::collections::BTreeMap;

use serde::Deserialize as Derive;
use serde::de::{self, Deserializer};

use super::{Int, Texture};

#[derive(Derive)]
pub struct VariantNames {
    pub variants: Vec<Named>,
}

#[derive(Derive)]
pub struct Named {
    pub name: String,
}

/// What an extension says, or nothing where it is malformed: that must not refuse a scene that can do without.
pub(super) fn lenient<'de, D: Deserializer<'de>, T: de::DeserializeOwned>(
    deserializer: D,
) -> Result<Option<T>, D::Error> {
    let value = serde_json::Value::deserialize(deserializer)?;
    Ok(serde_json::from_value(value).ok())
}

#[derive(Derive, Default)]
pub struct ViewExtensions {
    #[serde(rename = "KHR_meshopt_compression")]
    khronos: Option<Meshopt>,
    #[serde(rename = "EXT_meshopt_compression")]
    older: Option<Meshopt>,
}

impl ViewExtensions {
    /// How the view is compressed; by the newer codec where both are there.
    pub fn meshopt(&self) -> Option<&Meshopt> {
        self.khronos.as_ref().or(self.older.as_ref())
    }
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct Meshopt {
    pub buffer: Int,
    #[serde(default)]
    pub byte_offset: Int,
    pub byte_length: Int,
    pub byte_stride: Int,
    pub count: Int,
    pub mode: String,
    pub filter: Option<String>,
}

/// An image that is put together from files.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct MadeImage {
    /// Where its colours are, relative to the scene's folder.
    pub file: String,
    /// Where its coverage is.
    pub alpha: Option<String>,
    /// It is white; only its coverage is in files.
    pub white: bool,
    /// It holds heights, if it is grey, which become normals; the bits of how high they are.
    pub height: Option<u64>,
}

impl MadeImage {
    /// An image as it is in a file.
    pub fn of(file: String) -> Self {
        MadeImage { file, ..MadeImage::default() }
    }
}

#[derive(Derive, Default)]
pub struct PrimitiveExtensions {
    #[serde(rename = "KHR_draco_mesh_compression")]
    pub draco: Option<Draco>,
    #[serde(rename = "KHR_materials_variants", default, deserialize_with = "lenient")]
    pub variants: Option<Mappings>,
}

#[derive(Derive)]
#[serde(rename_all = "camelCase")]
pub struct Draco {
    pub buffer_view: Int,
    pub attributes: BTreeMap<String, Int>,
}

#[derive(Derive)]
pub struct Mappings {
    pub mappings: Vec<Mapping>,
}

/// The material of some of the variants.
#[derive(Derive)]
pub struct Mapping {
    pub material: Int,
    pub variants: Vec<Int>,
}

#[derive(Derive)]
pub struct Instances {
    pub attributes: BTreeMap<String, Int>,
}

#[derive(Derive)]
pub struct Visibility {
    pub visible: Option<bool>,
}

#[derive(Derive, Default)]
pub struct TextureExtensions {
    #[serde(rename = "EXT_texture_webp", default, deserialize_with = "lenient")]
    pub webp: Option<OtherSource>,
    #[serde(rename = "KHR_texture_basisu", default, deserialize_with = "lenient")]
    pub basis: Option<OtherSource>,
}

/// An image of another kind than PNG and JPEG.
#[derive(Derive)]
pub struct OtherSource {
    pub source: Option<Int>,
}

impl Texture {
    /// The image to read: one of an extension before the one for readers that lack it.
    pub fn image(&self) -> Option<usize> {
        self.other_sources().next().or(self.source).map(|source| source.0)
    }

    /// Its images of extensions.
    pub fn other_sources(&self) -> impl Iterator<Item = Int> + '_ {
        [&self.extensions.webp, &self.extensions.basis].into_iter().flatten().filter_map(|other| other.source)
    }
}
