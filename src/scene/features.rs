//! What a scene requires of the kernels: one pure function, a handful of flags. Emission that is only seen
//! and a few punctual lights have none, since kernels without them were no faster and no smaller
//! (`benches/features.rs`).
//!
//! `Features::required_by` folds scene and environment into ten flags; each gains by being off
//! (`docs/measurements.md`), which emission that is only seen and a few punctual lights did not. Each becomes
//! `-D NAME=0` or `1` (`src/trace/source.rs`), always all of them; buffers for what is off do not exist.
//! Loading helps: a texture of one colour becomes a factor, alpha that is always one becomes opaque.

use super::{AlphaMode, Environment, Scene, emitters};

/// Kernel features; each becomes `-D NAME=0|1`, and buffers exist only for those that are on.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
pub struct Features {
    /// Some material reads a texture.
    pub textures: bool,
    /// Some material has a normal map.
    pub normal_maps: bool,
    /// Some material is MASK, BLEND or glass, so a hit may be a miss.
    pub alpha: bool,
    /// There are vertex colours.
    pub vertex_colors: bool,
    /// The environment has a sun of its own.
    pub sun: bool,
    /// There is something to aim at that lights others: see [`emitters::any`].
    pub emitters: bool,
    /// Some material has more than metallic-roughness: see [`super::Layers`].
    pub layers: bool,
    /// Some material is glass.
    pub glass: bool,
    /// Some material's reflections are sharp ([`super::Material::is_glossy`]).
    pub glossy: bool,
    /// Shapes are kept once and shown at many places ([`super::Instanced`]).
    pub instances: bool,
}

impl Features {
    /// What `scene` under `environment` requires.
    pub fn required_by(scene: &Scene, environment: &Environment) -> Self {
        let any = |f: &dyn Fn(&super::Material) -> bool| scene.materials.iter().any(f);
        Features {
            textures: !scene.textures.is_empty(),
            normal_maps: any(&has_normal_map),
            alpha: any(&|m| m.alpha != AlphaMode::Opaque || m.glass.is_some()),
            vertex_colors: scene.meshes().any(|mesh| !mesh.colors.is_empty()),
            sun: environment.sun.is_some(),
            emitters: emitters::any(scene),
            layers: any(&|m| m.layers.is_some()),
            glass: any(&|m| m.glass.is_some()),
            glossy: any(&|m| m.is_glossy(&scene.textures)),
            instances: scene.instanced.is_some(),
        }
    }

    /// Every feature with its kernel name, in a fixed order.
    pub fn defines(&self) -> [(&'static str, bool); 10] {
        [
            ("HAS_TEXTURES", self.textures),
            ("HAS_NORMAL_MAPS", self.normal_maps),
            ("HAS_ALPHA", self.alpha),
            ("HAS_VERTEX_COLORS", self.vertex_colors),
            ("HAS_SUN", self.sun),
            ("HAS_EMITTERS", self.emitters),
            ("HAS_LAYERS", self.layers),
            ("HAS_GLASS", self.glass),
            ("HAS_GLOSSY", self.glossy),
            ("HAS_INSTANCES", self.instances),
        ]
    }
}

fn has_normal_map(material: &super::Material) -> bool {
    let coat = material.layers.as_ref().and_then(|layers| layers.coat_normal_texture);
    material.normal_texture.is_some() || coat.is_some()
}
