//! Small files that unfold to more than memory holds are refused before they do.

use std::sync::Arc;

use foveate::scene::budget::Budget;
use foveate::scene::{Instancing, LoadOptions, Scene};
use serde_json::json;

use crate::common::builder::{Builder, FLOAT};
use crate::{FREE, load_in, load_within, textured, write_png};

const MEGABYTE: u64 = 1_000_000;

#[test]
fn samplers_on_one_image_share_its_texels() {
    let folder = tempfile::tempdir().unwrap();
    write_png(&folder.path().join("big.png"), 512, 256);
    let mut builder = Builder::new();
    let positions = builder.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let uvs = builder.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let wraps = [10_497, 33_071, 33_648];
    for i in 0..18 {
        // Twice as many images as files: the same picture by two names.
        let name = ["big.png", "./big.png"][i % 2];
        let image = builder.push("images", json!({ "uri": name }));
        let [s, t, filter] = [wraps[i % 3], wraps[i / 3 % 3], 9728 + i / 9];
        let sampler = json!({ "wrapS": s, "wrapT": t, "magFilter": filter });
        let sampler = builder.push("samplers", sampler);
        let texture = builder.push("textures", json!({ "source": image, "sampler": sampler }));
        let pbr = json!({ "baseColorTexture": { "index": texture } });
        let material = builder.push("materials", json!({ "pbrMetallicRoughness": pbr }));
        let attributes = json!({ "POSITION": positions, "TEXCOORD_0": uvs });
        builder.place(json!({ "attributes": attributes, "material": material }), json!({}));
    }
    let scene = load_in(folder.path(), &builder, 4 * MEGABYTE).unwrap();
    let first = &scene.textures[0].texels;
    assert_eq!(scene.textures.len(), 18);
    assert!(scene.textures.iter().all(|texture| Arc::ptr_eq(&texture.texels, first)));
}

#[test]
fn textures_that_do_not_fit_are_scaled_down_with_a_word() {
    let folder = tempfile::tempdir().unwrap();
    write_png(&folder.path().join("a.png"), 600, 400);
    let builder = textured(|builder| {
        let image = builder.push("images", json!({ "uri": "a.png" }));
        let texture = builder.push("textures", json!({ "source": image }));
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } })
    });
    let size = |free: u64| {
        let scene = load_in(folder.path(), &builder, free).unwrap();
        let told = scene.warnings.iter().any(|warning| warning.contains("scaled down"));
        (scene.textures[0].width, scene.textures[0].height, told)
    };
    assert_eq!(size(8 * MEGABYTE), (600, 400, false));
    assert_eq!(size(MEGABYTE), (300, 200, true));
    let refusal = load_in(folder.path(), &builder, 20_000).unwrap_err().to_string();
    assert!(refusal.contains("of memory"), "{refusal}");
}

#[test]
fn buffers_of_one_file_are_read_once() {
    let folder = tempfile::tempdir().unwrap();
    let length = MEGABYTE as usize;
    std::fs::write(folder.path().join("big.bin"), vec![0; length]).unwrap();
    std::fs::write(folder.path().join("other.bin"), vec![0; length]).unwrap();
    let names = |names: &[&str]| {
        let document = json!({
            "asset": { "version": "2.0" },
            "buffers": names.iter().map(|uri| json!({ "uri": uri, "byteLength": length })).collect::<Vec<_>>(),
        });
        let path = folder.path().join("many.gltf");
        std::fs::write(&path, document.to_string()).unwrap();
        load_within(&path, 2 * MEGABYTE)
    };
    names(&["big.bin", "./big.bin"].repeat(200)).unwrap();
    let refusal = names(&["big.bin", "other.bin"]).unwrap_err().to_string();
    assert!(refusal.contains("for buffers"), "{refusal}");
}

#[test]
fn images_that_are_padded_are_not_all_held_at_once() {
    let folder = tempfile::tempdir().unwrap();
    write_png(&folder.path().join("pad.bin"), 8, 8);
    let file = std::fs::OpenOptions::new().append(true).open(folder.path().join("pad.bin")).unwrap();
    file.set_len(200 * MEGABYTE).unwrap();
    let builder = textured(|builder| {
        let infos: Vec<_> = (0..400)
            .map(|_| {
                let image = builder.push("images", json!({ "uri": "pad.bin" }));
                json!({ "index": builder.push("textures", json!({ "source": image })) })
            })
            .collect();
        infos.iter().for_each(|info| {
            builder.push("materials", json!({ "emissiveTexture": info, "emissiveFactor": [1, 1, 1] }));
        });
        json!({ "pbrMetallicRoughness": { "baseColorTexture": infos[0] }, "emissiveTexture": infos[399], "emissiveFactor": [1, 1, 1] })
    });
    let scene = load_in(folder.path(), &builder, FREE).unwrap();
    assert!(Arc::ptr_eq(&scene.textures[0].texels, &scene.textures[1].texels) || scene.textures.len() == 1);
}

#[test]
fn empty_materials_and_nodes_weigh_before_they_are_made() {
    let folder = tempfile::tempdir().unwrap();
    for list in ["materials", "nodes"] {
        let text = format!(
            "{{\"asset\": {{\"version\": \"2.0\"}}, \"{list}\": [{}]}}",
            vec!["{}"; 100_000].join(",")
        );
        let path = folder.path().join("lists.gltf");
        std::fs::write(&path, text).unwrap();
        let refusal = load_within(&path, 40 * MEGABYTE);
        let refusal = refusal.unwrap_err().to_string();
        assert!(refusal.contains("lists of nodes and materials"), "{refusal}");
    }
}

#[test]
fn triangles_of_instances_are_counted_before_they_are_placed() {
    let folder = tempfile::tempdir().unwrap();
    let mut builder = Builder::new();
    builder.push("accessors", json!({ "componentType": FLOAT, "type": "VEC3", "count": 30_000 }));
    builder.push("meshes", json!({ "primitives": [{ "attributes": { "POSITION": 0 } }] }));
    for _ in 0..3000 {
        let node = builder.push("nodes", json!({ "mesh": 0 }));
        builder.show(node);
    }
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, builder.document().to_string()).unwrap();
    let budget = Budget::with_free(12_000 * MEGABYTE);
    let options = LoadOptions { budget, instancing: Instancing::Flat, ..LoadOptions::default() };
    let refusal = Scene::load_with(&path, &options).unwrap_err().to_string();
    assert!(refusal.contains("14.40 GB for triangles") && refusal.contains("show less of it"), "{refusal}");
}
