//! Malformed and unsupported scenes: each loads or is refused in one clear sentence that names it,
//! without a panic and within 1 GiB.

mod common;

use std::fs;
use std::path::{Path, PathBuf};

use common::builder::{glb, split_glb};
use foveate::scene::Scene;
use serde_json::{Value, json};

/// All scene files below a folder.
fn scenes_below(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "gltf" || extension == "glb") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

/// The refusal of a file, or `None` when it loads.
fn refusal(path: &Path) -> Option<String> {
    let outcome = std::panic::catch_unwind(|| Scene::load(path));
    let outcome = outcome.unwrap_or_else(|_| panic!("{} makes the loader panic", path.display()));
    match outcome {
        Ok(scene) => {
            assert_finite(&scene);
            None
        }
        Err(error) => Some(error.to_string()),
    }
}

fn assert_finite(scene: &Scene) {
    let mesh = &scene.mesh;
    assert!(scene.anchor.is_finite());
    assert!(mesh.positions.iter().chain(&mesh.normals).all(|v| v.is_finite()));
    assert!(mesh.tangents.iter().chain(&mesh.colors).all(|v| v.is_finite()));
    assert!(mesh.uvs.iter().flatten().all(|v| v.is_finite()));
    assert!(mesh.triangles.iter().flatten().all(|&i| (i as usize) < mesh.positions.len()));
    assert!(mesh.materials.iter().all(|&m| (m as usize) < scene.materials.len()));
    assert_eq!(mesh.materials.len(), mesh.triangles.len());
    assert_eq!(mesh.normals.len(), mesh.positions.len());
}

fn assert_one_sentence(path: &Path, message: &str) {
    let name = path.file_name().unwrap().to_string_lossy();
    assert!(message.contains(name.as_ref()), "{message:?} does not name {name}");
    assert!(!message.contains('\n') && message.len() < 600, "{message:?} is no clear sentence");
}

/// A copy of a `.gltf` file, in a folder with copies of its neighbours, in which nodes place all meshes.
fn with_meshes_placed(path: &Path, folder: &Path) -> Option<PathBuf> {
    let mut json: Value = serde_json::from_slice(&fs::read(path).ok()?).ok()?;
    let meshes = json.get("meshes")?.as_array()?.len();
    json["nodes"] = (0..meshes).map(|mesh| json!({ "mesh": mesh })).collect();
    json["scenes"] = json!([{ "nodes": (0..meshes).collect::<Vec<_>>() }]);
    for neighbour in fs::read_dir(path.parent()?).ok()?.flatten() {
        if neighbour.path().extension().is_some_and(|extension| extension == "bin") {
            fs::copy(neighbour.path(), folder.join(neighbour.file_name())).ok()?;
        }
    }
    let copy = folder.join(path.file_name()?);
    fs::write(&copy, json.to_string()).ok()?;
    Some(copy)
}

/// The peak of resident memory of this process, in bytes; `None` where the system does not tell.
fn peak_memory() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|line| line.starts_with("VmHWM:"))?;
    Some(line.split_whitespace().nth(1)?.parse::<u64>().ok()? * 1024)
}

fn assert_within_a_gibibyte() {
    let peak = peak_memory();
    assert!(peak.is_none_or(|bytes| bytes < 1 << 30), "{peak:?} bytes");
}

/// Loads every file, `prepare`d, and returns the names of those that were refused.
fn refused_of(folder: &Path, prepare: impl Fn(&Path, &Path) -> Option<PathBuf>) -> Vec<String> {
    let mut refused = Vec::new();
    for path in scenes_below(folder) {
        let copies = tempfile::tempdir().unwrap();
        let Some(copy) = prepare(&path, copies.path()) else { continue };
        if let Some(message) = refusal(&copy) {
            assert_one_sentence(&path, &message);
            refused.push(path.strip_prefix(folder).unwrap().to_string_lossy().into_owned());
        }
    }
    assert_within_a_gibibyte();
    refused
}

#[test]
fn the_whole_corpus_loads_or_is_refused_with_a_reason() {
    let Some(folder) = common::data("bad_gltf/data") else { return };
    assert!(scenes_below(&folder).len() > 110, "there are few files in {}", folder.display());
    let refused = refused_of(&folder, |path, _| Some(path.to_path_buf()));
    let must_load = [
        "accessor/valid.gltf",
        "buffer/valid.glb",
        "buffer/valid.gltf",
        "buffer/data_uri.glb",
        "buffer/extra_padding.glb",
        "buffer_view/valid.gltf",
        "glb/extra_data.glb",
        "glb/two_images.glb",
        "glb/valid.glb",
        "glb/valid_buffer.glb",
        "json/bom.gltf",
        "json/integer_written_as_float.gltf",
        "mesh/valid.gltf",
    ];
    for name in must_load {
        assert!(!refused.iter().any(|refused| refused == name), "{name} is refused");
    }
    let must_fail = [
        "accessor/unresolved_bufferviews.gltf",
        "buffer/non_relative_uri.gltf",
        "buffer/not_found.gltf",
        "buffer/wrong_bytelength.glb",
        "buffer_view/unresolved_buffer.gltf",
        "glb/chunk_too_big.glb",
        "glb/empty_file.glb",
        "glb/invalid_magic.glb",
        "glb/length_mismatch.glb",
        "glb/truncated_chunk_data.glb",
        "glb/zero_length.glb",
        "json/invalid_syntax.gltf",
        "mesh/unresolved_material.gltf",
    ];
    for name in must_fail {
        assert!(refused.iter().any(|refused| refused == name), "{name} loads");
    }
}

#[test]
fn the_corpus_with_its_meshes_in_use_loads_or_is_refused_with_a_reason() {
    let Some(folder) = common::data("bad_gltf/data") else { return };
    let refused = refused_of(&folder, with_meshes_placed);
    let must_fail = [
        "mesh/accessor_unequal_count.gltf",
        "mesh/indices_invalid_format.gltf",
        "mesh/position_accessor_invalid_format.gltf",
        "mesh_data/index_buffer_oob.gltf",
        "mesh_data/index_buffer_primitive_restart.gltf",
    ];
    for name in must_fail {
        assert!(refused.iter().any(|refused| refused == name), "{name} loads");
    }
    assert!(!refused.iter().any(|name| name == "mesh_data/index_buffer_degenerate_triangle.gltf"));
}

/// Marsaglia's xorshift: the same damage in every run.
struct Damage(u64);

impl Damage {
    fn below(&mut self, n: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 % n as u64) as usize
    }

    /// Replaces one number of a document by one that is likely to hurt.
    fn hurt(&mut self, json: &mut Value) {
        let mut numbers = Vec::new();
        collect_numbers(json, &mut numbers);
        let at = self.below(numbers.len());
        let hurtful = [0.0, 1.0, 2.0, 3.0, -1.0, 4.0, 255.0, 65_536.0, 4_294_967_295.0, 9.0e15, 1.0e300, 0.5];
        *numbers.swap_remove(at) = json!(hurtful[self.below(hurtful.len())]);
    }
}

fn collect_numbers<'a>(json: &'a mut Value, numbers: &mut Vec<&'a mut Value>) {
    match json {
        Value::Number(_) => numbers.push(json),
        Value::Array(list) => list.iter_mut().for_each(|value| collect_numbers(value, numbers)),
        Value::Object(map) => map.values_mut().for_each(|value| collect_numbers(value, numbers)),
        _ => {}
    }
}

#[test]
fn damaged_scenes_do_no_harm() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.glb");
    let mut damage = Damage(0x9E37_79B9_7F4A_7C15);
    for sample in ["BoxTextured", "CesiumMilkTruck", "UnlitTest", "VertexColorTest"] {
        let Some(original) = common::data(&format!("scenes/khronos/{sample}/{sample}.glb")) else { return };
        let bytes = fs::read(original).unwrap();
        let (json, bin) = split_glb(&bytes);
        // Images decode slowly and are damaged with the box's.
        let rounds = if bytes.len() > 50_000 { 40 } else { 400 };
        for round in 0..rounds {
            let damaged = if round % 2 == 0 {
                let mut json = json.clone();
                (0..1 + damage.below(3)).for_each(|_| damage.hurt(&mut json));
                glb(&json, &bin)
            } else {
                let mut bytes = bytes.clone();
                (0..1 + damage.below(8)).for_each(|_| {
                    let at = damage.below(bytes.len());
                    bytes[at] = damage.below(256) as u8;
                });
                bytes
            };
            fs::write(&path, damaged).unwrap();
            if let Some(message) = refusal(&path) {
                assert_one_sentence(&path, &message);
            }
        }
    }
    assert_within_a_gibibyte();
}
