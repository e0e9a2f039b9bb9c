//! Materials that generated scenes have in common.

use glam::Vec3;
use serde_json::{Value, json};

use super::glb::Glb;

/// An sRGB colour from `0xrrggbb`.
pub fn rgb(hex: u32) -> Vec3 {
    Vec3::new((hex >> 16 & 255) as f32, (hex >> 8 & 255) as f32, (hex & 255) as f32) / 255.0
}

/// A material of one sRGB colour.
pub fn plain(glb: &mut Glb, name: &str, colour: u32, metallic: f32, roughness: f32) -> usize {
    let linear = rgb(colour).powf(2.2);
    glb.material(json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorFactor": [linear.x, linear.y, linear.z, 1.0],
            "metallicFactor": metallic, "roughnessFactor": roughness,
        },
    }))
}

/// A use of a texture that covers `metres` along each axis.
pub fn repeated(texture: usize, metres: f32) -> Value {
    let scale = 1.0 / metres;
    json!({ "index": texture, "extensions": { "KHR_texture_transform": { "scale": [scale, scale] } } })
}

/// A dielectric with a base colour picture and, where there is one, a normal map; both cover `metres`.
pub fn textured(
    glb: &mut Glb,
    name: &str,
    colour: &[u8],
    normals: Option<&[u8]>,
    metres: f32,
    roughness: f32,
) -> usize {
    let colour = glb.texture(name, colour, false);
    let mut material = json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorTexture": repeated(colour, metres), "metallicFactor": 0.0, "roughnessFactor": roughness,
        },
    });
    if let Some(normals) = normals {
        let normals = glb.texture(&format!("{name} normals"), normals, false);
        material["normalTexture"] = repeated(normals, metres);
    }
    glb.material(material)
}
