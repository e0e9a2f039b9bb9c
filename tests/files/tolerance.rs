//! What is wrong with a part of a scene, and can be told, does not refuse all of it.

use foveate::scene::{AlphaMode, Scene};
use glam::Vec3;
use serde_json::json;

use crate::common;
use crate::{FREE, load_in, textured, write_png};

/// A scene whose base colour comes from this image.
fn with_image(image: serde_json::Value) -> crate::Builder {
    textured(|builder| {
        let image = builder.push("images", image);
        let texture = builder.push("textures", json!({ "source": image }));
        json!({ "pbrMetallicRoughness": { "baseColorTexture": { "index": texture } } })
    })
}

fn is_stand_in(scene: &Scene) -> bool {
    let texels = &scene.textures[0].texels;
    texels[0] == [255, 0, 255, 255] && texels[..256].contains(&[40, 40, 40, 255])
}

#[test]
fn an_unusable_image_is_told_by_its_name_and_something_visible_stands_in() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("broken.png"), b"\x89PNG\r\n\x1a\nrubbish").unwrap();
    std::fs::write(folder.path().join("text.png"), b"hello").unwrap();
    std::fs::write(folder.path().join("../outside.png"), b"hello").unwrap();
    for (image, name, reason) in [
        (json!({ "uri": "broken.png" }), "\"broken.png\"", "cannot be decoded"),
        (json!({ "uri": "text.png" }), "\"text.png\"", "neither PNG nor JPEG"),
        (json!({ "uri": "none.png" }), "\"none.png\"", "no such file"),
        (json!({ "uri": "../outside.png" }), "\"../outside.png\"", "outside the scene's folder"),
        (json!({ "uri": "http://a.org/b.png" }), "b.png", "scheme \"http\""),
        (json!({ "uri": "data:image/png;base64,&&" }), "image 0", "not base64"),
        (json!({ "name": "wood" }), "\"wood\"", "neither a URI nor a bufferView"),
    ] {
        let scene = load_in(folder.path(), &with_image(image), FREE).unwrap();
        assert_eq!(scene.mesh.triangles.len(), 1);
        assert!(is_stand_in(&scene), "{name}");
        let told = scene.warnings.join("; ");
        assert!(told.contains(name) && told.contains(reason), "{name}: {told}");
    }
}

#[test]
fn data_of_an_unusable_image_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    let builder = textured(|builder| {
        let image = builder.push("images", json!({ "uri": "none.png" }));
        let texture = builder.push("textures", json!({ "source": image }));
        let index = json!({ "index": texture });
        json!({
            "pbrMetallicRoughness": { "metallicRoughnessTexture": index },
            "normalTexture": index, "occlusionTexture": index,
            "emissiveTexture": index, "emissiveFactor": [1, 1, 1],
        })
    });
    let scene = load_in(folder.path(), &builder, FREE).unwrap();
    assert_eq!((scene.textures.len(), scene.warnings.len()), (0, 1));
    let material = &scene.materials[0];
    assert_eq!((material.metallic, material.emissive, material.alpha), (0.0, Vec3::ZERO, AlphaMode::Opaque));
}

#[test]
fn letter_case_and_backslashes_do_not_matter_where_one_file_fits() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir_all(folder.path().join("textures")).unwrap();
    write_png(&folder.path().join("textures/wood.png"), 3, 2);
    for uri in [
        "textures/wood.png",
        "Textures/Wood.PNG",
        "textures\\wood.png",
        "TEXTURES\\wood.png",
        ".\\textures\\WOOD.png",
    ] {
        let scene = load_in(folder.path(), &with_image(json!({ "uri": uri })), FREE).unwrap();
        assert_eq!((scene.textures[0].width, scene.warnings.len()), (3, 0), "{uri}: {:?}", scene.warnings);
    }
    // With two that fit, neither is meant for sure.
    write_png(&folder.path().join("textures/WOOD.png"), 5, 2);
    let ambiguous = with_image(json!({ "uri": "textures/Wood.png" }));
    assert!(is_stand_in(&load_in(folder.path(), &ambiguous, FREE).unwrap()));
    let exact = with_image(json!({ "uri": "textures/WOOD.png" }));
    assert_eq!(load_in(folder.path(), &exact, FREE).unwrap().textures[0].width, 5);
    // No way outside leads over a backslash.
    let outside = with_image(json!({ "uri": "..\\textures\\wood.png" }));
    let scene = load_in(folder.path(), &outside, FREE).unwrap();
    assert!(scene.warnings[0].contains("outside the scene's folder"), "{:?}", scene.warnings);
}

#[test]
fn a_byte_order_mark_is_skipped() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bom.gltf");
    std::fs::write(&path, "\u{FEFF}{\"asset\": {\"version\": \"2.0\"}}").unwrap();
    assert!(Scene::load(&path).unwrap().mesh.triangles.is_empty());
}

#[test]
fn formats_that_are_not_read_are_named_with_the_way() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, parts) in [
        ("a.fbx", &b"Kaydara FBX Binary  \0"[..], ["Filmbox (FBX)", "export it as glTF"]),
        ("a.usdz", b"PK\x03\x04", ["USD", "export it as glTF"]),
        ("a.blend", b"BLENDER-v300", ["Blender", "File, Export, .glb"]),
        ("a.ply", b"ply\n", ["PLY", ".glb"]),
        ("a.glb", b"BLENDER-v300", ["Blender", ".glb"]),
        ("a.zip", b"PK\x03\x04", ["ZIP", "unpack"]),
    ] {
        std::fs::write(folder.path().join(name), bytes).unwrap();
        let message = Scene::load(&folder.path().join(name)).unwrap_err().to_string();
        assert!(message.contains(name) && parts.iter().all(|part| message.contains(part)), "{message}");
    }
}

#[test]
fn the_handed_cases_load() {
    for (name, warned) in [
        ("case.glb", true),
        ("backslash.glb", true),
        ("bad_truncjpg.glb", true),
        ("bad_webp.glb", false),
        ("webp_required.glb", false),
        ("r_bom.gltf", false),
        ("r_float_ints.glb", false),
        ("r_bigtrans.glb", false),
        ("r_anim_pointer.glb", false),
        ("r_anim_broken.glb", false),
        ("r_ext_bad.glb", false),
        ("r_chunk_between.glb", false),
        ("r_normal_transform.glb", true),
    ] {
        let Some(path) = common::data(&format!("cases/{name}")) else { return };
        let scene = Scene::load(&path).unwrap();
        let told = scene.warnings.iter().any(|warning| warning.contains("not usable"));
        assert_eq!(told, warned, "{name}: {:?}", scene.warnings);
    }
    let Some(path) = common::data("cases/r_anim_broken.glb") else { return };
    let told = Scene::load(&path).unwrap().warnings;
    assert!(told.len() == 1 && told[0].contains("animation 0 is malformed"), "{told:?}");
    for name in ["r_wrapped_code.glb", "r_wrapped_index.glb"] {
        let Some(path) = common::data(&format!("cases/{name}")) else { return };
        assert!(Scene::load(&path).is_err(), "{name}");
    }
}
