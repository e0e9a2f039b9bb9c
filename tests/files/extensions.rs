//! Extensions that scenes come with: compressed geometry, instances, hidden nodes, variants, cameras.

use std::path::{Path, PathBuf};

use foveate::scene::generate::voxel_town;
use foveate::scene::{LoadOptions, Scene};
use glam::DVec3;
use serde_json::{Value, json};

use crate::common;
use crate::common::builder::{Builder, glb, split_glb};

pub fn scene_file(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/files/scenes").join(name)
}

fn surface(scene: &Scene) -> f64 {
    let mesh = &scene.mesh;
    let area = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|i| mesh.positions[i as usize].as_dvec3());
        (b - a).cross(c - a).length() * 0.5
    };
    mesh.triangles.iter().map(area).sum()
}

fn bounds(scene: &Scene) -> [DVec3; 2] {
    let (low, high) = scene.mesh.bounds().unwrap();
    [low, high].map(|corner| scene.anchor + corner.as_dvec3())
}

/// The town from which scripts/compress-scenes.sh made the files.
fn town() -> Scene {
    Scene::from_glb(Path::new("town.glb"), &voxel_town::generate(10_000, 1).unwrap()).unwrap()
}

fn assert_same(scene: &Scene, truth: &Scene, tolerance: f64) {
    assert_eq!(scene.mesh.triangles.len(), truth.mesh.triangles.len());
    assert_eq!(scene.materials.len(), truth.materials.len());
    assert!((surface(scene) / surface(truth) - 1.0).abs() < tolerance);
    for (a, b) in bounds(scene).into_iter().zip(bounds(truth)) {
        assert!((a - b).length() < tolerance * 100.0, "{a} {b}");
    }
    let mean = |scene: &Scene| {
        scene.mesh.uvs[0].iter().map(|uv| f64::from(uv.x.fract().abs())).sum::<f64>()
            / scene.mesh.uvs[0].len() as f64
    };
    assert!((mean(scene) - mean(truth)).abs() < 0.05, "{} {}", mean(scene), mean(truth));
}

#[test]
fn compressed_towns_are_the_town() {
    let truth = town();
    for name in ["draco.glb", "meshopt.glb"] {
        let scene = Scene::load(&scene_file(name)).unwrap();
        assert_eq!(scene.warnings, Vec::<String>::new(), "{name}");
        assert_same(&scene, &truth, 1e-2);
    }
}

#[test]
fn meshopts_second_name_is_read_too() {
    let (json, bin) = split_glb(&std::fs::read(scene_file("meshopt.glb")).unwrap());
    let renamed = json.to_string().replace("EXT_meshopt_compression", "KHR_meshopt_compression");
    let scene =
        Scene::from_glb(Path::new("a.glb"), &glb(&serde_json::from_str(&renamed).unwrap(), &bin)).unwrap();
    assert_eq!(scene.mesh.triangles.len(), town().mesh.triangles.len());
}

#[test]
fn damaged_compression_is_told() {
    for (name, part) in [("draco.glb", "Draco"), ("meshopt.glb", "bufferView")] {
        let (json, mut bin) = split_glb(&std::fs::read(scene_file(name)).unwrap());
        bin.iter_mut().step_by(3).for_each(|byte| *byte ^= 0x5A);
        let message = Scene::from_glb(Path::new("a.glb"), &glb(&json, &bin)).unwrap_err().to_string();
        assert!(message.contains(part) && message.contains("a.glb"), "{message}");
    }
}

#[test]
fn the_handed_compressed_scenes_open() {
    for (name, triangles) in [("Box.gltf", 12), ("BoxTextured_meshopt.glb", 12)] {
        let Some(path) = common::data(&format!("scenes/unsupported/{name}")) else { return };
        let scene = Scene::load(&path).unwrap();
        assert_eq!(scene.mesh.triangles.len(), triangles, "{name}");
        let [low, high] = bounds(&scene);
        assert!(((high - low) - DVec3::ONE).length() < 0.01, "{name}: {low} {high}");
    }
}

/// A triangle that a node with these properties places.
fn triangle(node: Value) -> Builder {
    let mut builder = Builder::new();
    let positions = builder.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    builder.place(json!({ "attributes": { "POSITION": positions } }), node);
    builder
}

#[test]
fn instances_are_placed_under_their_node() {
    let mut builder = triangle(json!({ "translation": [0, 0, 5] }));
    let translations = builder.floats(&[[0.0, 0.0, 0.0], [10.0, 0.0, 0.0], [0.0, 20.0, 0.0]]);
    let quarter = 0.5_f32.sqrt();
    let rotations =
        builder.floats(&[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, quarter, quarter], [0.0, 0.0, 0.0, 2.0]]);
    let scales = builder.floats(&[[1.0; 3], [1.0; 3], [2.0; 3]]);
    let attributes =
        json!({ "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales, "_ID": scales });
    builder.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": attributes } });
    let scene = builder.load().unwrap();
    assert_eq!((scene.mesh.triangles.len(), scene.instances), (3, 3));
    let corner = |triangle: usize, corner: usize| {
        scene.anchor + scene.mesh.positions[scene.mesh.triangles[triangle][corner] as usize].as_dvec3()
    };
    assert!((corner(1, 0) - DVec3::new(10.0, 0.0, 5.0)).length() < 1e-5);
    assert!((corner(1, 1) - DVec3::new(10.0, 1.0, 5.0)).length() < 1e-5, "turned by a quarter");
    assert!((corner(2, 1) - DVec3::new(2.0, 20.0, 5.0)).length() < 1e-5, "twice as large");
    // A malformed extension is as good as none.
    builder.json["nodes"][0]["extensions"] = json!({ "EXT_mesh_gpu_instancing": 3 });
    assert_eq!(builder.load().unwrap().instances, 1);
    builder.json["nodes"][0]["extensions"] =
        json!({ "EXT_mesh_gpu_instancing": { "attributes": { "SCALE": 99 } } });
    assert!(builder.load().unwrap_err().to_string().contains("accessor 99"));
}

#[test]
fn hidden_nodes_hide_what_is_below_them() {
    let hidden = json!({ "KHR_node_visibility": { "visible": false } });
    let mut builder = triangle(json!({ "extensions": hidden }));
    let child = builder.push("nodes", json!({ "mesh": 0 }));
    builder.json["nodes"][0]["children"] = json!([child]);
    assert!(builder.load().unwrap().mesh.triangles.is_empty());
    builder.json["nodes"][0]["extensions"]["KHR_node_visibility"]["visible"] = json!(true);
    assert_eq!(builder.load().unwrap().instances, 2);
}

fn load_with(builder: &Builder, options: &LoadOptions) -> foveate::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("scene.gltf");
    std::fs::write(&path, builder.document().to_string()).unwrap();
    Scene::load_with(&path, options)
}

#[test]
fn variants_choose_materials_by_name_or_number() {
    let mut builder = triangle(json!({}));
    for name in ["plain", "red", "blue"] {
        builder.push("materials", json!({ "name": name }));
    }
    let names = json!([{ "name": "Ruby" }, { "name": "Sapphire" }]);
    builder.json["extensions"] = json!({ "KHR_materials_variants": { "variants": names } });
    builder.json["meshes"][0]["primitives"][0]["material"] = json!(0);
    let mappings = json!([{ "material": 1, "variants": [0] }, { "material": 2, "variants": [1] }]);
    builder.json["meshes"][0]["primitives"][0]["extensions"] =
        json!({ "KHR_materials_variants": { "mappings": mappings } });
    let with = |variant: Option<&str>| {
        let options = LoadOptions { variant: variant.map(String::from), ..LoadOptions::default() };
        load_with(&builder, &options).map(|scene| scene.materials[0].name.clone())
    };
    assert_eq!(with(None).unwrap(), "plain");
    assert_eq!((with(Some("Ruby")).unwrap().as_str(), with(Some("1")).unwrap().as_str()), ("red", "blue"));
    let message = with(Some("Emerald")).unwrap_err().to_string();
    assert!(
        message.contains("no variant \"Emerald\"; give one of 0 (\"Ruby\"), 1 (\"Sapphire\")"),
        "{message}"
    );
    assert_eq!(builder.load().unwrap().variants, ["Ruby", "Sapphire"]);
}

#[test]
fn scenes_and_cameras_are_chosen_by_name_or_number() {
    let mut builder = triangle(json!({ "name": "one" }));
    let camera = |name: &str| json!({ "name": name, "type": "perspective", "perspective": { "yfov": 0.5, "znear": 0.1 } });
    builder.push("cameras", camera("front"));
    builder.push(
        "cameras",
        json!({ "name": "map", "type": "orthographic", "orthographic": { "xmag": 1, "ymag": 3 } }),
    );
    for index in 0..2 {
        let node = builder.push("nodes", json!({ "camera": index }));
        builder.show(node);
    }
    builder.json["scenes"].as_array_mut().unwrap().push(json!({ "name": "empty", "nodes": [] }));
    let with = |scene: Option<&str>, camera: Option<&str>| {
        let [scene, camera] = [scene, camera].map(|name| name.map(String::from));
        load_with(&builder, &LoadOptions { scene, camera, ..LoadOptions::default() })
    };
    let scene = with(None, Some("map")).unwrap();
    assert_eq!((scene.camera, scene.cameras[1].half_height, scene.scenes.len()), (Some(1), Some(3.0), 2));
    assert_eq!(with(None, Some("0")).unwrap().camera, Some(0));
    assert!(with(Some("empty"), None).unwrap().mesh.triangles.is_empty());
    assert!(
        with(None, Some("back"))
            .unwrap_err()
            .to_string()
            .contains("no camera \"back\"; give one of 0 (\"front\")")
    );
    assert!(with(Some("7"), None).unwrap_err().to_string().contains("no scene \"7\""));
}

#[test]
fn the_handed_cases_show_what_they_are_made_to_show() {
    let load = |name: &str| common::data(&format!("cases/{name}")).map(|path| Scene::load(&path).unwrap());
    let (Some(instances), Some(hidden), Some(ortho)) =
        (load("x_instancing.glb"), load("x_visibility.glb"), load("x_ortho.glb"))
    else {
        return;
    };
    assert!(instances.instances > 1, "{}", instances.instances);
    assert_eq!(hidden.instances, 1);
    assert_eq!(ortho.cameras[0].half_height, Some(2.0));
}
