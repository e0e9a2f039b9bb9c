//! Textures compressed by Basis Universal, beside what its own decoder makes of them
//! (scripts/compress-textures.mjs).

use foveate::scene::{Scene, Texture};
use serde_json::json;

use crate::common::builder::{glb, split_glb};
use crate::extensions::scene_file;

fn textures(name: &str) -> Vec<Texture> {
    let scene = Scene::load(&scene_file(name)).unwrap();
    assert_eq!(scene.warnings, Vec::<String>::new(), "{name}");
    scene.textures
}

#[test]
fn compressed_textures_are_what_basis_universal_makes_of_them() {
    for name in ["etc1s", "uastc"] {
        let (read, truth) = (textures(&format!("{name}.glb")), textures(&format!("{name}-decoded.glb")));
        assert!(read.len() >= 12 && read.len() == truth.len(), "{name}: {}", read.len());
        for (i, (read, truth)) in read.iter().zip(&truth).enumerate() {
            assert!(read == truth, "{name}: texture {i}");
        }
        assert!(read.iter().any(|texture| texture.texels.iter().any(|texel| texel[3] < 255)), "{name}");
    }
    // Of one picture UASTC makes another than ETC1S.
    assert!(textures("etc1s.glb") != textures("uastc.glb"));
}

#[test]
fn damaged_textures_are_told_and_the_scene_is_shown() {
    for name in ["etc1s.glb", "uastc.glb"] {
        let (json, mut bin) = split_glb(&std::fs::read(scene_file(name)).unwrap());
        let view = json["images"][0]["bufferView"].as_u64().unwrap() as usize;
        let view = &json["bufferViews"][view];
        let [start, length] =
            ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap_or(0) as usize);
        // Behind the header, the levels' places and the description of the format.
        bin[start + 260..start + length].iter_mut().step_by(2).for_each(|byte| *byte ^= 0x5A);
        let scene = Scene::from_glb("a.glb".as_ref(), &glb(&json, &bin)).unwrap();
        let told: Vec<_> = scene.warnings.iter().filter(|told| told.contains("checkerboard")).collect();
        assert!(told.len() == 1 && told[0].contains("image 0"), "{name}: {:?}", scene.warnings);
    }
}

#[test]
fn the_picture_of_the_extension_is_read_rather_than_the_other() {
    let (mut json, bin) = split_glb(&std::fs::read(scene_file("uastc.glb")).unwrap());
    // For readers that lack the extension: a picture that is none.
    let images = json["images"].as_array_mut().unwrap();
    images.push(json!({ "uri": "nowhere.png" }));
    let other = images.len() - 1;
    json["textures"][1]["source"] = json!(other);
    let scene = Scene::from_glb("a.glb".as_ref(), &glb(&json, &bin)).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    json["textures"][1]["extensions"]["KHR_texture_basisu"]["source"] = json!(99);
    let message = Scene::from_glb("a.glb".as_ref(), &glb(&json, &bin)).unwrap_err().to_string();
    assert!(message.contains("texture 1") && message.contains("99"), "{message}");
}
