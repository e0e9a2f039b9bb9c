//! Why documents have types of our own: what the gltf crate's cannot hold, each of which people's files have
//! (src/scene/gltf/json.rs). Should one of these fail after an update of the crate, look there again.

use gltf::json::Root;
use serde_json::{Value, json};

use crate::common;

fn root(parts: Value) -> Result<Root, gltf::json::Error> {
    let mut document = json!({ "asset": { "version": "2.0" } });
    document.as_object_mut().unwrap().extend(parts.as_object().unwrap().clone());
    Root::from_str(&document.to_string())
}

#[test]
fn integers_written_as_floats_are_refused() {
    assert!(root(json!({ "buffers": [{ "byteLength": 4 }] })).is_ok());
    assert!(root(json!({ "buffers": [{ "byteLength": 4.0 }] })).is_err());
}

#[test]
fn animations_that_nobody_reads_refuse_the_scene() {
    let channel = json!({ "sampler": 0, "target": { "path": "pointer" } });
    let sampler = json!({ "input": 0, "output": 0 });
    assert!(root(json!({ "animations": [{ "channels": [channel], "samplers": [sampler] }] })).is_err());
}

#[test]
fn malformed_extensions_refuse_the_scene() {
    let info = json!({ "index": 0, "extensions": { "KHR_texture_transform": "x" } });
    let material = json!({ "pbrMetallicRoughness": { "baseColorTexture": info } });
    assert!(root(json!({ "materials": [material] })).is_err());
}

#[test]
fn indices_are_cut_without_a_word() {
    let root = root(json!({ "nodes": [{ "mesh": 4_294_967_296_u64 }] })).unwrap();
    assert_eq!(root.nodes[0].mesh.unwrap().value(), 0);
}

#[test]
fn places_lose_their_digits() {
    let root = root(json!({ "nodes": [{ "translation": [4_500_000.123, 0, 0] }] })).unwrap();
    assert!((f64::from(root.nodes[0].translation.unwrap()[0]) - 4_500_000.123).abs() > 0.1);
}

/// What the crate makes of the handed cases, all of which open here or are refused for what they break.
#[test]
fn handed_cases_that_need_types_of_our_own() {
    let text = |name: &str| {
        let bytes = std::fs::read(common::data(&format!("cases/{name}"))?).unwrap();
        let length = || u32::from_le_bytes(bytes[12..16].try_into().unwrap()) as usize;
        let json = if bytes.starts_with(b"glTF") { bytes[20..20 + length()].to_vec() } else { bytes };
        Some(String::from_utf8(json).unwrap())
    };
    for (name, reason) in [
        ("r_float_ints.glb", "floating point"),
        ("r_anim_pointer.glb", "missing field `node`"),
        ("r_anim_broken.glb", "expected a sequence"),
        ("r_bom.gltf", "expected value"),
    ] {
        let Some(text) = text(name) else { return };
        let refused = Root::from_str(&text).unwrap_err().to_string();
        assert!(refused.contains(reason), "{name}: {refused}");
    }
    for (name, number) in [("r_wrapped_index.glb", "4294967296"), ("r_wrapped_code.glb", "4294972422")] {
        let Some(text) = text(name) else { return };
        assert!(text.contains(number) && Root::from_str(&text).is_ok(), "{name}");
    }
    let Some(path) = common::data("cases/r_chunk_between.glb") else { return };
    let refused = gltf::binary::Glb::from_slice(&std::fs::read(path).unwrap()).unwrap_err().to_string();
    assert!(refused.contains("unknown chunk"), "{refused}");
    let Some(text) = text("r_bigtrans.glb") else { return };
    let moved = Root::from_str(&text).unwrap().nodes[0].translation.unwrap();
    assert_eq!(moved[0], 4_500_000.0, "of the 4500000.123 that the file says");
}
