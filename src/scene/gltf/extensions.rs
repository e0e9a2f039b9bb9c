//! The extensions of materials that add to metallic-roughness, as a file says them, and what becomes of them.

use glam::Vec3;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Deserializer};
use serde_json::Value;

use super::finite;
use super::json::TextureInfo;
use crate::scene::{Glass, Layers};

/// KHR_materials_specular.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct Specular {
    pub specular_factor: Option<f64>,
    pub specular_texture: Option<TextureInfo>,
    pub specular_color_factor: Option<[f64; 3]>,
    pub specular_color_texture: Option<TextureInfo>,
}

/// KHR_materials_ior.
#[derive(Deserialize, Default)]
#[serde(default)]
pub struct Ior {
    pub ior: Option<f64>,
}

/// KHR_materials_clearcoat.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct Clearcoat {
    pub clearcoat_factor: f64,
    pub clearcoat_texture: Option<TextureInfo>,
    pub clearcoat_roughness_factor: f64,
    pub clearcoat_roughness_texture: Option<TextureInfo>,
    pub clearcoat_normal_texture: Option<TextureInfo>,
}

/// KHR_materials_sheen.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct Sheen {
    pub sheen_color_factor: [f64; 3],
    pub sheen_color_texture: Option<TextureInfo>,
    pub sheen_roughness_factor: f64,
    pub sheen_roughness_texture: Option<TextureInfo>,
}

/// KHR_materials_anisotropy.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct Anisotropy {
    pub anisotropy_strength: f64,
    pub anisotropy_rotation: f64,
    pub anisotropy_texture: Option<TextureInfo>,
}

/// KHR_materials_pbrSpecularGlossiness.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct SpecularGlossiness {
    pub diffuse_factor: Option<[f64; 4]>,
    pub diffuse_texture: Option<TextureInfo>,
    pub specular_factor: Option<[f64; 3]>,
    pub glossiness_factor: Option<f64>,
    pub specular_glossiness_texture: Option<TextureInfo>,
}

/// KHR_materials_transmission.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct Transmission {
    pub transmission_factor: f64,
    pub transmission_texture: Option<TextureInfo>,
}

/// KHR_materials_volume. Rays find out by themselves how thick it is.
#[derive(Deserialize, Default)]
#[serde(rename_all = "camelCase", default)]
pub struct Volume {
    pub thickness_factor: f64,
    pub attenuation_distance: Option<f64>,
    pub attenuation_color: Option<[f64; 3]>,
}

/// All of them that a material has.
#[derive(Deserialize, Default)]
#[serde(default)]
pub struct LayerExtensions {
    #[serde(deserialize_with = "lenient", rename = "KHR_materials_specular")]
    pub specular: Option<Specular>,
    #[serde(deserialize_with = "lenient", rename = "KHR_materials_ior")]
    pub ior: Option<Ior>,
    #[serde(deserialize_with = "lenient", rename = "KHR_materials_clearcoat")]
    pub clearcoat: Option<Clearcoat>,
    #[serde(deserialize_with = "lenient", rename = "KHR_materials_sheen")]
    pub sheen: Option<Sheen>,
    #[serde(deserialize_with = "lenient", rename = "KHR_materials_anisotropy")]
    pub anisotropy: Option<Anisotropy>,
    #[serde(deserialize_with = "lenient", rename = "KHR_materials_pbrSpecularGlossiness")]
    pub glossiness: Option<SpecularGlossiness>,
    #[serde(deserialize_with = "lenient", rename = "KHR_materials_transmission")]
    pub transmission: Option<Transmission>,
    #[serde(deserialize_with = "lenient", rename = "KHR_materials_volume")]
    pub volume: Option<Volume>,
}

/// An extension that is malformed is as good as none: the material is shown without it.
fn lenient<'de, D: Deserializer<'de>, T: DeserializeOwned>(deserializer: D) -> Result<Option<T>, D::Error> {
    Ok(serde_json::from_value(Value::deserialize(deserializer)?).ok())
}

impl LayerExtensions {
    /// The textures in the order of [`Layers::textures`].
    pub fn textures(&self) -> [Option<&TextureInfo>; 8] {
        let glossiness = self.glossiness.as_ref().and_then(|g| g.specular_glossiness_texture.as_ref());
        let (specular, coat) = (self.specular.as_ref(), self.clearcoat.as_ref());
        let sheen = self.sheen.as_ref();
        [
            specular.and_then(|s| s.specular_texture.as_ref()),
            glossiness.or(specular.and_then(|s| s.specular_color_texture.as_ref())),
            coat.and_then(|c| c.clearcoat_texture.as_ref()),
            coat.and_then(|c| c.clearcoat_roughness_texture.as_ref()),
            coat.and_then(|c| c.clearcoat_normal_texture.as_ref()),
            sheen.and_then(|s| s.sheen_color_texture.as_ref()),
            sheen.and_then(|s| s.sheen_roughness_texture.as_ref()),
            self.anisotropy.as_ref().and_then(|a| a.anisotropy_texture.as_ref()),
        ]
    }

    /// Every texture that they refer to.
    pub fn all_textures(&self) -> impl Iterator<Item = &TextureInfo> {
        let diffuse = self.glossiness.as_ref().and_then(|g| g.diffuse_texture.as_ref());
        self.textures().into_iter().flatten().chain(diffuse).chain(self.transmission_texture())
    }

    /// The texture of a glass's transmission.
    pub fn transmission_texture(&self) -> Option<&TextureInfo> {
        self.transmission.as_ref().and_then(|transmission| transmission.transmission_texture.as_ref())
    }

    /// The glass without its texture, where there is any.
    pub fn glass(&self) -> Option<Glass> {
        let transmission = finite(self.transmission.as_ref()?.transmission_factor.clamp(0.0, 1.0));
        let ior = self.ior.as_ref().and_then(|ior| ior.ior).unwrap_or(1.5);
        // An index of 0 stands for a mirror, which nothing passes.
        if transmission <= 0.0 || ior <= 0.0 {
            return None;
        }
        let volume = self.volume.as_ref().filter(|volume| volume.thickness_factor > 0.0);
        let absorbed = |volume: &Volume| {
            let distance =
                volume.attenuation_distance.filter(|distance| *distance > 0.0).unwrap_or(f64::INFINITY);
            let color = volume.attenuation_color.unwrap_or([1.0; 3]);
            Vec3::from(color.map(|c| finite(-c.clamp(1e-6, 1.0).ln() / distance)))
        };
        Some(Glass {
            transmission,
            texture: None,
            ior: finite(ior).max(1.0),
            solid: volume.is_some(),
            attenuation: volume.map_or(Vec3::ZERO, absorbed),
        })
    }

    /// The layers without their textures; `None` where they change nothing.
    pub fn layers(&self) -> Option<Box<Layers>> {
        let fraction = |value: f64| finite(value.clamp(0.0, 1.0));
        let color = |value: [f64; 3]| Vec3::from(value.map(|v| finite(v).max(0.0)));
        let mut layers = Layers::default();
        if let Some(ior) = self.ior.as_ref().and_then(|ior| ior.ior) {
            layers.dielectric = Vec3::splat(f0_of(ior));
        }
        if let Some(specular) = &self.specular {
            layers.specular = fraction(specular.specular_factor.unwrap_or(1.0));
            layers.dielectric *= color(specular.specular_color_factor.unwrap_or([1.0; 3]));
        }
        if let Some(coat) = &self.clearcoat {
            layers.coat = fraction(coat.clearcoat_factor);
            layers.coat_roughness = fraction(coat.clearcoat_roughness_factor);
            let scale = coat.clearcoat_normal_texture.as_ref().and_then(|t| t.scale);
            layers.coat_normal_scale = finite(scale.unwrap_or(1.0));
        }
        if let Some(sheen) = &self.sheen {
            layers.sheen_color = color(sheen.sheen_color_factor).min(Vec3::ONE);
            layers.sheen_roughness = fraction(sheen.sheen_roughness_factor);
        }
        if let Some(anisotropy) = &self.anisotropy {
            layers.anisotropy = fraction(anisotropy.anisotropy_strength);
            layers.anisotropy_rotation = finite(anisotropy.anisotropy_rotation);
        }
        if let Some(glossiness) = &self.glossiness {
            layers.dielectric = color(glossiness.specular_factor.unwrap_or([1.0; 3])).min(Vec3::ONE);
            layers.glossy = glossiness.specular_glossiness_texture.is_some();
        }
        (layers != Layers::default()).then(|| Box::new(layers))
    }
}

/// Reflection along the normal of a dielectric in air. An index of 0 stands for a mirror (KHR_materials_ior).
fn f0_of(ior: f64) -> f32 {
    if ior <= 0.0 { 1.0 } else { finite(((ior - 1.0) / (ior + 1.0)).powi(2)) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layers(json: &str) -> Option<Box<Layers>> {
        serde_json::from_str::<LayerExtensions>(json).unwrap().layers()
    }

    #[test]
    fn defaults_add_nothing() {
        assert_eq!(layers("{}"), None);
        for name in ["specular", "ior", "clearcoat", "sheen", "anisotropy"] {
            assert_eq!(layers(&format!(r#"{{"KHR_materials_{name}": {{}}}}"#)), None, "{name}");
        }
        assert_eq!(layers(r#"{"KHR_materials_ior": {"ior": 1.5}}"#), None);
        assert_eq!(layers(r#"{"KHR_materials_ior": {"ior": "glass"}, "KHR_materials_sheen": 3}"#), None);
    }

    #[test]
    fn indices_and_colours_make_the_reflection() {
        let water = layers(r#"{"KHR_materials_ior": {"ior": 1.33}}"#).unwrap();
        assert!((water.dielectric.x - 0.02006).abs() < 1e-4 && !water.is_tinted());
        assert_eq!(layers(r#"{"KHR_materials_ior": {"ior": 0}}"#).unwrap().dielectric, Vec3::ONE);
        let tinted = layers(
            r#"{"KHR_materials_ior": {"ior": 2}, "KHR_materials_specular":
                {"specularFactor": 0.5, "specularColorFactor": [1, 0.5, 9]}}"#,
        )
        .unwrap();
        assert!((tinted.dielectric * 9.0 - Vec3::new(1.0, 0.5, 9.0)).abs().max_element() < 1e-5);
        assert!(tinted.is_tinted() && tinted.specular == 0.5);
        let gold = r#"{"KHR_materials_pbrSpecularGlossiness": {"specularFactor": [1, 0.7, 0.3]}}"#;
        assert_eq!(layers(gold).unwrap().dielectric, Vec3::new(1.0, 0.7, 0.3));
    }

    #[test]
    fn glass_is_thin_unless_it_has_a_thickness() {
        let glass = |json: &str| serde_json::from_str::<LayerExtensions>(json).unwrap().glass();
        assert_eq!(glass(r#"{"KHR_materials_transmission": {}}"#), None);
        let thin = glass(
            r#"{"KHR_materials_transmission": {"transmissionFactor": 0.5},
                             "KHR_materials_volume": {"attenuationDistance": 1}}"#,
        )
        .unwrap();
        assert_eq!(
            (thin.transmission, thin.ior, thin.solid, thin.attenuation),
            (0.5, 1.5, false, Vec3::ZERO)
        );
        let solid = glass(r#"{"KHR_materials_transmission": {"transmissionFactor": 1}, "KHR_materials_ior": {"ior": 2.4},
                "KHR_materials_volume": {"thicknessFactor": 1, "attenuationDistance": 2, "attenuationColor": [1, 0.5, 0]}}"#).unwrap();
        assert!(solid.solid && solid.ior == 2.4 && solid.attenuation.x == 0.0);
        // After the distance, the colour is left.
        assert!(((-solid.attenuation.y * 2.0).exp() - 0.5).abs() < 1e-6 && solid.attenuation.z > 5.0);
    }
}
