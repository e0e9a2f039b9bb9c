//! Why documents have types of our own: what the gltf crate's cannot hold, each of which people's files have
//! (src/scene/gltf/json.rs). Should one of these fail after an update of the crate, look there again.

use gltf::json::Root;
use serde_json::{Value, json};

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
