//! Shapes that are kept once: what a file's instances are, beside the same file with every triangle in its place.

use foveate::scene::budget::Budget;
use foveate::scene::pick;
use foveate::scene::{Instancing, LoadOptions, Scene};
use glam::DVec3;
use serde_json::{Value, json};

use crate::common::builder::Builder;

/// A quad with a corner bent up, and its places.
fn quads(nodes: impl IntoIterator<Item = Value>, material: Value) -> Builder {
    let mut builder = Builder::new();
    let positions = [[10.0, 0.0, 0.0], [11.0, 0.0, 0.0], [11.0, 0.5, 1.0], [10.0, 0.0, 1.0]];
    let normals = [[0.0, 1.0, 0.0], [0.0, 1.0, 0.0], [0.6, 0.8, 0.0], [0.0, 1.0, 0.0]];
    let (positions, normals) = (builder.floats(&positions), builder.floats(&normals));
    let indices = builder.shorts(&[0, 1, 2, 0, 2, 3]);
    let material = builder.push("materials", material);
    let attributes = json!({ "POSITION": positions, "NORMAL": normals });
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": material });
    let mut nodes = nodes.into_iter();
    builder.place(primitive, nodes.next().unwrap());
    for mut node in nodes {
        node["mesh"] = json!(0);
        let node = builder.push("nodes", node);
        builder.show(node);
    }
    builder
}

fn load(builder: &Builder, instancing: Instancing) -> Scene {
    let folder = tempfile::tempdir().unwrap();
    let path = builder.write_glb(folder.path());
    Scene::load_with(&path, &LoadOptions { instancing, ..LoadOptions::default() }).unwrap()
}

fn turned(degrees: f64) -> Value {
    let half = degrees.to_radians() * 0.5;
    json!([0.0, half.sin(), 0.0, half.cos()])
}

/// All triangles by their corners in the world, with the normals there, in an order of their own.
fn corners(scene: &Scene) -> Vec<[[i64; 6]; 3]> {
    let mesh = &scene.mesh;
    let corner = |index: u32| {
        let at = scene.anchor + mesh.positions[index as usize].as_dvec3();
        let n = mesh.normals[index as usize].as_dvec3();
        [at.x, at.y, at.z, n.x, n.y, n.z].map(|value| (value * 1e4).round() as i64)
    };
    let mut all: Vec<[[i64; 6]; 3]> = mesh.triangles.iter().map(|triangle| triangle.map(corner)).collect();
    all.iter_mut().for_each(|triangle| {
        let least = (0..3).min_by_key(|&i| triangle[i]).unwrap();
        triangle.rotate_left(least);
    });
    all.sort_unstable();
    all
}

#[test]
fn a_shape_that_is_kept_once_is_where_its_flattened_triangles_are() {
    let nodes = [
        json!({ "translation": [0.0, 0.0, 5.0] }),
        json!({ "translation": [20.0, 1.0, -3.0], "rotation": turned(40.0), "scale": [1.0, 3.0, 0.5] }),
        json!({ "translation": [0.0, -2.0, 0.0], "scale": [-2.0, 1.0, 1.0] }),
        json!({ "rotation": turned(170.0), "scale": [1.0, 1.0, -1.5] }),
        // This one is flat: its triangles have no frame to be kept in.
        json!({ "translation": [3.0, 0.0, 0.0], "scale": [1.0, 0.0, 1.0] }),
    ];
    let builder = quads(nodes, json!({}));
    let (flat, shared) = (load(&builder, Instancing::Flat), load(&builder, Instancing::Shared));
    assert!(flat.instanced.is_none());
    let kept = shared.instanced.as_ref().unwrap();
    assert_eq!((kept.shapes.len(), kept.mesh.triangles.len(), kept.instances.len()), (2, 4, 4));
    assert_eq!((shared.mesh.triangles.len(), shared.triangles(), shared.instances), (2, 10, 5));
    let whole = shared.flattened();
    for (found, wanted) in
        corners(&whole).iter().flatten().flatten().zip(corners(&flat).iter().flatten().flatten())
    {
        assert!(found.abs_diff(*wanted) <= 1, "{found} {wanted}");
    }
    assert_eq!(whole.mesh.triangles.len(), 10);
    let (bounds, tight) = (shared.bounds().unwrap(), flat.bounds().unwrap());
    let shift = (flat.anchor - shared.anchor).as_vec3();
    assert!(bounds.0.cmple(tight.0 + shift + 1e-4).all() && bounds.1.cmpge(tight.1 + shift - 1e-4).all());
    // What a hand points at.
    for target in flat.mesh.triangles.iter().map(|triangle| {
        triangle.iter().map(|&i| flat.mesh.positions[i as usize].as_dvec3()).sum::<DVec3>() / 3.0
    }) {
        let from = flat.anchor + target + DVec3::new(0.3, 6.0, 0.2);
        let way = (flat.anchor + target - from).normalize();
        let point = |scene: &Scene| pick::nearest(scene, from - scene.anchor, way).unwrap().0 + scene.anchor;
        assert!(point(&flat).distance(point(&shared)) < 1e-4, "{} {}", point(&flat), point(&shared));
    }
}

#[test]
fn what_shines_and_what_is_placed_once_is_flattened() {
    let nodes = || (0..3).map(|i| json!({ "translation": [3.0 * i as f64, 0.0, 0.0] }));
    let lamps = load(&quads(nodes(), json!({ "emissiveFactor": [1, 1, 1] })), Instancing::Shared);
    assert!(lamps.instanced.is_none());
    assert_eq!(lamps.mesh.triangles.len(), 6);
    let once = load(&quads(nodes().take(1), json!({})), Instancing::Shared);
    assert!(once.instanced.is_none());
    // A small scene is flattened unless that is asked for.
    let few = load(&quads(nodes(), json!({})), Instancing::Auto);
    assert!(few.instanced.is_none());
    let asked = load(&quads(nodes(), json!({})), Instancing::Shared);
    assert_eq!(asked.instanced.as_ref().unwrap().instances.len(), 3);
}

/// A quad at places that an extension lists.
fn listed(count: usize) -> Builder {
    let mut builder = quads([json!({})], json!({}));
    let places: Vec<[f32; 3]> = (0..count).map(|i| [(i % 1000) as f32, 0.0, (i / 1000) as f32]).collect();
    let places = builder.floats(&places);
    let list = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": places } } });
    builder.json["nodes"][0]["extensions"] = list;
    builder
}

#[test]
fn many_instances_take_no_more_memory_than_one_shape_and_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let within = |count: usize, free: u64, instancing: Instancing| {
        let path = listed(count).write_glb(folder.path());
        let options = LoadOptions { budget: Budget::with_free(free), instancing, ..LoadOptions::default() };
        Scene::load_with(&path, &options)
    };
    // 100,000 quads take 96 MB of triangles, or 200 MB of places at most.
    let shared = within(100_000, 300_000_000, Instancing::Shared).unwrap();
    assert_eq!((shared.triangles(), shared.instanced.unwrap().mesh.triangles.len()), (200_000, 2));
    let refusal = within(100_000, 150_000_000, Instancing::Shared).unwrap_err().to_string();
    assert!(refusal.contains("GB for instances"), "{refusal}");
    let refusal = within(100_000, 250_000_000, Instancing::Flat).unwrap_err().to_string();
    assert!(refusal.contains("GB for triangles"), "{refusal}");
}

#[test]
fn instances_that_a_file_only_counts_are_refused_before_they_are_made() {
    let mut builder = listed(1);
    // An accessor without a buffer is zeros, as many as it says.
    let count = 400_000_000;
    let zeros = json!({ "componentType": 5126, "count": count, "type": "VEC3" });
    let accessor = builder.push("accessors", zeros);
    builder.json["nodes"][0]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["TRANSLATION"] =
        json!(accessor);
    let folder = tempfile::tempdir().unwrap();
    let path = builder.write_glb(folder.path());
    let options = LoadOptions { budget: Budget::with_free(16_000_000_000), ..LoadOptions::default() };
    let refusal = Scene::load_with(&path, &options).unwrap_err().to_string();
    assert!(refusal.contains("800.00 GB for instances"), "{refusal}");
}
