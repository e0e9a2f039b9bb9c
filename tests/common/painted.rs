//! A scene whose materials change, for tests.

use serde_json::{Value, json};

use super::builder::Builder;

/// A floor of two colours whose texture slides, under a lamp that begins dark, beside a wall that changes its colour; keys
/// are at 0 and 2 s.
pub fn painted() -> Builder {
    let mut builder = Builder::new();
    let stripes = builder.texture(&[[230, 230, 230, 255], [30, 60, 90, 255]]);
    let plain = builder.texture(&[[188, 255, 255, 255]]);
    builder.push(
        "materials",
        json!({ "pbrMetallicRoughness": { "metallicFactor": 0.0, "baseColorTexture": { "index": stripes,
            "extensions": { "KHR_texture_transform": { "scale": [0.5, 0.25] } } } } }),
    );
    builder.push(
        "materials",
        json!({ "emissiveFactor": [0.0, 0.0, 0.0], "doubleSided": true,
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 5.0 } } }),
    );
    builder.push(
        "materials",
        json!({ "alphaMode": "BLEND", "pbrMetallicRoughness": { "metallicFactor": 0.0,
            "baseColorFactor": [0.2, 0.3, 0.4, 1.0], "baseColorTexture": { "index": plain } } }),
    );
    for (material, rows) in [
        (0, [[-6.0, 0.0, -6.0], [-6.0, 0.0, 6.0], [6.0, 0.0, 6.0], [6.0, 0.0, -6.0]]),
        (1, [[-1.0, 4.0, -1.0], [-1.0, 4.0, 1.0], [1.0, 4.0, 1.0], [1.0, 4.0, -1.0]]),
        (2, [[-6.0, 0.0, -5.0], [6.0, 0.0, -5.0], [6.0, 5.0, -5.0], [-6.0, 5.0, -5.0]]),
    ] {
        let positions = builder.floats(&rows);
        let uvs = builder.floats(&[[0.0, 0.0], [0.0, 1.0], [1.0, 1.0], [1.0, 0.0]]);
        let indices = builder.shorts(&[0, 1, 2, 0, 2, 3]);
        let attributes = json!({ "POSITION": positions, "TEXCOORD_0": uvs });
        builder
            .place(json!({ "attributes": attributes, "indices": indices, "material": material }), json!({}));
    }
    builder.json["extensionsUsed"] =
        json!(["KHR_animation_pointer", "KHR_materials_emissive_strength", "KHR_texture_transform"]);
    let uv = "pbrMetallicRoughness/baseColorTexture/extensions/KHR_texture_transform";
    let emits = builder.floats(&[[0.0, 0.0, 0.0], [1.0, 0.5, 0.25]]);
    let strength = builder.floats(&[[5.0], [25.0]]);
    let color = builder.floats(&[[0.2, 0.3, 0.4, 1.0], [1.0, 0.9, 0.0, 0.5]]);
    let offset = builder.floats(&[[0.0, 0.0], [1.0, 0.0]]);
    let rotation = builder.floats(&[[0.0], [1.0]]);
    point(&mut builder, "/materials/1/emissiveFactor", emits);
    let path = "/materials/1/extensions/KHR_materials_emissive_strength/emissiveStrength";
    point(&mut builder, path, strength);
    point(&mut builder, "/materials/2/pbrMetallicRoughness/baseColorFactor", color);
    point(&mut builder, &format!("/materials/0/{uv}/offset"), offset);
    point(&mut builder, &format!("/materials/0/{uv}/rotation"), rotation);
    builder
}

/// Adds a channel that changes what a pointer names, by values at 0 and 2 s.
pub fn point(builder: &mut Builder, pointer: &str, values: usize) {
    if builder.json.get("animations").is_none() {
        builder.json["animations"] = json!([{ "name": "Paint", "samplers": [], "channels": [] }]);
    }
    let times = builder.floats(&[[0.0], [2.0]]);
    let animation = &mut builder.json["animations"][0];
    let samplers = animation["samplers"].as_array_mut().unwrap();
    samplers.push(json!({ "input": times, "output": values }));
    let sampler = samplers.len() - 1;
    let extension = json!({ "KHR_animation_pointer": { "pointer": pointer } });
    let target: Value = json!({ "path": "pointer", "extensions": extension });
    animation["channels"].as_array_mut().unwrap().push(json!({ "sampler": sampler, "target": target }));
}
