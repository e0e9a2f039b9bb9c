//! Everything that reads bytes of others, one function for each kind: `fuzz/` feeds them with what coverage finds,
//! and the tests beside this file with the saved inputs. Each tells whether it has taken the bytes for what they claim
//! to be; what it must not do is panic, hang, or take memory without bounds.

use std::cell::RefCell;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use foveate::bvh::cache::TreeCache;
use foveate::bvh::{TreeFor, WideBvh};
use foveate::config::{Config, Layers, Quality};
use foveate::frame::budget;
use foveate::headset::rift_dk1::fusion::Fusion;
use foveate::headset::rift_dk1::optics::{Eye, Optics};
use foveate::headset::rift_dk1::recording::Reader;
use foveate::headset::rift_dk1::report::{
    Calibration, Configuration, DisplayInfo, KeepAlive, Range, SensorReport, SerialNumber,
};
use foveate::scene::budget::Budget;
use foveate::scene::{Environment, LoadOptions, Scene};
use foveate::tradeoff::Point;
use glam::Vec3;
use serde_json::json;

/// A function that reads bytes; true where they were what they should be.
pub type Entry = fn(&[u8]) -> bool;

/// All of them by name, which is also that of the fuzz target and of its corpus' folder.
pub const ENTRIES: [(&str, Entry); 20] = [
    ("gltf", |bytes| scene("scene.gltf", bytes)),
    ("glb", |bytes| scene("scene.glb", bytes)),
    ("obj", obj),
    ("png", |bytes| picture("png", bytes)),
    ("jpeg", |bytes| picture("jpg", bytes)),
    ("webp", |bytes| picture("webp", bytes)),
    ("bmp", |bytes| picture("bmp", bytes)),
    ("tga", |bytes| picture("tga", bytes)),
    ("ktx2", |bytes| picture("ktx2", bytes)),
    ("hdr", |bytes| Environment::load(&written("map.hdr", bytes)).is_ok()),
    ("exr", |bytes| Environment::load(&written("map.exr", bytes)).is_ok()),
    ("draco", draco),
    ("meshopt", meshopt),
    ("config", config),
    ("front", front),
    ("recording", recording),
    ("report", report),
    ("feature_report", feature_report),
    ("tree", tree),
    ("measurement", |bytes| serde_json::from_slice::<Point>(bytes).is_ok()),
];

/// Bytes of memory that a scene may ask for.
const FREE: u64 = 600_000_000;

/// A file of that name in this thread's own folder.
fn written(name: &str, bytes: &[u8]) -> PathBuf {
    thread_local! {
        static FOLDER: RefCell<Option<tempfile::TempDir>> = const { RefCell::new(None) };
    }
    FOLDER.with_borrow_mut(|folder| {
        let folder = folder.get_or_insert_with(|| tempfile::tempdir().expect("a folder for inputs"));
        let path = folder.path().join(name);
        std::fs::write(&path, bytes).expect("an input is written");
        path
    })
}

/// Whether something of the scene is left to be shown, and nothing that was asked for is missing.
fn load(path: &Path) -> Option<Scene> {
    let options = LoadOptions { budget: Budget::with_free(FREE), ..LoadOptions::default() };
    Scene::load_with(path, &options).ok()
}

fn scene(name: &str, bytes: &[u8]) -> bool {
    load(&written(name, bytes)).is_some_and(|scene| !scene.mesh.triangles.is_empty())
}

/// A file and its materials, with a zero byte between.
fn obj(bytes: &[u8]) -> bool {
    let cut = bytes.iter().position(|&byte| byte == 0).unwrap_or(bytes.len());
    written("scene.mtl", bytes.get(cut + 1..).unwrap_or_default());
    scene("scene.obj", &[b"mtllib scene.mtl\n", &bytes[..cut]].concat())
}

/// A picture as a material's texture.
fn picture(kind: &str, bytes: &[u8]) -> bool {
    let name = format!("picture.{kind}");
    written(&name, bytes);
    written("scene.mtl", format!("newmtl a\nmap_Kd {name}\n").as_bytes());
    let triangle =
        "mtllib scene.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nusemtl a\nf 1/1 2/2 3/3\n";
    load(&written("scene.obj", triangle.as_bytes())).is_some_and(|scene| scene.warnings.is_empty())
}

/// A binary glTF file of a document and its buffer.
pub fn glb(document: &serde_json::Value, buffer: &[u8]) -> Vec<u8> {
    let mut text = document.to_string().into_bytes();
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut buffer = buffer.to_vec();
    buffer.resize(buffer.len().next_multiple_of(4), 0);
    let words = |words: &[u32]| words.iter().flat_map(|word| word.to_le_bytes()).collect::<Vec<u8>>();
    let length = 28 + text.len() + buffer.len();
    [
        b"glTF".to_vec(),
        words(&[2, length as u32, text.len() as u32]),
        b"JSON".to_vec(),
        text,
        words(&[buffer.len() as u32]),
        b"BIN\0".to_vec(),
        buffer,
    ]
    .concat()
}

/// A mesh of three vertices and one triangle, the way all that is compressed comes into a file.
fn document(buffer: usize, views: serde_json::Value, extension: &str) -> serde_json::Value {
    json!({
        "asset": { "version": "2.0" },
        "extensionsUsed": [extension], "extensionsRequired": [extension],
        "scene": 0, "scenes": [{ "nodes": [0] }], "nodes": [{ "mesh": 0 }],
        "buffers": [{ "byteLength": buffer }], "bufferViews": views,
    })
}

/// A Draco buffer. Before it are the numbers of vertices and of indices that the document promises (u16 each), and the
/// positions' number in the buffer.
fn draco(bytes: &[u8]) -> bool {
    let Some((head, data)) = bytes.split_first_chunk::<5>() else { return false };
    let vertices = u16::from_le_bytes([head[0], head[1]]);
    let indices = u16::from_le_bytes([head[2], head[3]]);
    let mut document = document(
        data.len(),
        json!([{ "buffer": 0, "byteLength": data.len() }]),
        "KHR_draco_mesh_compression",
    );
    document["accessors"] = json!([
        { "componentType": 5126, "type": "VEC3", "count": vertices, "min": [-1, -1, -1], "max": [1, 1, 1] },
        { "componentType": 5125, "type": "SCALAR", "count": indices },
    ]);
    let compressed =
        json!({ "KHR_draco_mesh_compression": { "bufferView": 0, "attributes": { "POSITION": head[4] } } });
    let primitive = json!({ "attributes": { "POSITION": 0 }, "indices": 1, "extensions": compressed });
    document["meshes"] = json!([{ "primitives": [primitive] }]);
    scene("scene.glb", &glb(&document, data))
}

/// A meshopt buffer of positions. Its first three bytes are the number of vertices, the mode and the filter.
fn meshopt(bytes: &[u8]) -> bool {
    let Some(([vertices, mode, filter], data)) = bytes.split_first_chunk::<3>() else { return false };
    let mode = ["ATTRIBUTES", "TRIANGLES", "INDICES"][usize::from(*mode) % 3];
    let filter = ["NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL"][usize::from(*filter) % 4];
    let (count, stride) = (u32::from(*vertices), if mode == "ATTRIBUTES" { 12 } else { 4 });
    let compressed = json!({
        "buffer": 0, "byteLength": data.len(), "byteStride": stride, "count": count, "mode": mode, "filter": filter,
    });
    let fallback = json!([{
        "buffer": 1, "byteLength": count * stride, "extensions": { "EXT_meshopt_compression": compressed },
    }]);
    let mut document = document(data.len(), fallback, "EXT_meshopt_compression");
    let promise = json!({ "byteLength": count * stride, "extensions": { "EXT_meshopt_compression": { "fallback": true } } });
    document["buffers"] = json!([{ "byteLength": data.len() }, promise]);
    let kind = if mode == "ATTRIBUTES" { (5126, "VEC3") } else { (5125, "SCALAR") };
    document["accessors"] = json!([
        { "bufferView": 0, "componentType": kind.0, "type": kind.1, "count": count },
        { "componentType": 5126, "type": "VEC3", "count": 3, "sparse": {
            "count": 0, "indices": { "bufferView": 0, "componentType": 5121 }, "values": { "bufferView": 0 } } },
    ]);
    let primitive = match mode {
        "ATTRIBUTES" => json!({ "attributes": { "POSITION": 0 } }),
        _ => json!({ "attributes": { "POSITION": 1 }, "indices": 0 }),
    };
    document["meshes"] = json!([{ "primitives": [primitive] }]);
    scene("scene.glb", &glb(&document, data))
}

fn config(bytes: &[u8]) -> bool {
    read_settings(bytes).is_some()
}

fn read_settings(bytes: &[u8]) -> Option<Config> {
    let mut layers = Layers::default();
    layers.file(&written("settings.toml", bytes)).ok()?;
    layers.finish().ok()
}

/// Settings with a front, along which frames are held.
fn front(bytes: &[u8]) -> bool {
    let Some(config) = read_settings(bytes) else { return false };
    let points = config.budget.front.len();
    if let Ok(Some(mut controller)) = budget::controller(&config, Some(1000.0 / 90.0)) {
        for frame_ms in [1.0, 50.0, 0.0, 1e9] {
            controller.observe(frame_ms, 0.0);
            let _ = controller.quality(Quality::of(&config));
        }
    }
    points > 0
}

fn recording(bytes: &[u8]) -> bool {
    let Ok(reader) = Reader::open(&written("head.rec", bytes)) else { return false };
    let mut fusion = Fusion::new();
    let mut good = 0;
    for entry in reader.map_while(Result::ok) {
        if let Ok(report) = SensorReport::decode(&entry.bytes) {
            fusion.update(&report, entry.host);
            good += 1;
        }
    }
    assert!(fusion.orientation().is_finite() && fusion.predicted(0.04).is_finite());
    good > 0
}

/// Reports one after the other, as a tracker sends them.
fn report(bytes: &[u8]) -> bool {
    let mut fusion = Fusion::new();
    let mut good = 0;
    for (place, bytes) in bytes.chunks(62).enumerate() {
        if let Ok(report) = SensorReport::decode(bytes) {
            fusion.update(&report, Some(place as f64 * 0.002));
            good += 1;
        }
    }
    assert!(fusion.orientation().is_finite() && fusion.angular_velocity().is_finite());
    good > 0
}

fn feature_report(bytes: &[u8]) -> bool {
    let plain = [
        Configuration::decode(bytes).is_ok(),
        Calibration::decode(bytes).is_ok(),
        Range::decode(bytes).is_ok(),
        KeepAlive::decode(bytes).is_ok(),
        SerialNumber::decode(bytes).is_ok(),
    ];
    let Ok(info) = DisplayInfo::decode(bytes) else { return plain.contains(&true) };
    let optics = Optics::of_device(&info);
    for eye in [Eye::Left, Eye::Right] {
        let fov = optics.field_of_view(eye);
        assert!([fov.left, fov.right, fov.up, fov.down].iter().all(|angle| angle.is_finite()), "{fov:?}");
    }
    let size = optics.picture_size(1.0);
    assert!(size.iter().all(|&pixels| (1..=16384).contains(&pixels)), "{size:?}");
    true
}

/// A mesh of which trees are kept, its cache, the file of its tree and that file's bytes.
struct Kept {
    positions: Vec<Vec3>,
    triangles: Vec<[u32; 3]>,
    _folder: tempfile::TempDir,
    cache: TreeCache,
    path: PathBuf,
    bytes: Vec<u8>,
    tree: WideBvh,
}

fn kept() -> &'static Kept {
    static KEPT: OnceLock<Kept> = OnceLock::new();
    KEPT.get_or_init(|| {
        const SIDE: u32 = 160;
        let height = |x: u32, y: u32| (x * 7 + y * 13) as f32 % 3.0;
        let positions: Vec<Vec3> = (0..=SIDE)
            .flat_map(|y| (0..=SIDE).map(move |x| Vec3::new(x as f32, height(x, y), y as f32)))
            .collect();
        let triangles: Vec<[u32; 3]> = (0..SIDE * SIDE)
            .flat_map(|square| {
                let corner = square / SIDE * (SIDE + 1) + square % SIDE;
                let across = corner + SIDE + 1;
                [[corner, corner + 1, across], [corner + 1, across + 1, across]]
            })
            .collect();
        let folder = tempfile::tempdir().expect("a folder for trees");
        let cache = TreeCache::in_folder(folder.path().join("trees"));
        let build = || WideBvh::build(&positions, &triangles);
        let (tree, _) = cache.find_or(TreeFor::Packets, &positions, &triangles, build);
        let files = std::fs::read_dir(folder.path().join("trees")).expect("the cache's folder");
        let path = files
            .flatten()
            .map(|file| file.path())
            .find(|path| path.extension().is_some_and(|e| e == "tree"));
        let path = path.expect("a tree was kept");
        let bytes = std::fs::read(&path).expect("the kept tree");
        Kept { positions, triangles, _folder: folder, cache, path, bytes, tree }
    })
}

/// Bytes of a tree's file before those that its checksum is of.
const HEAD: usize = 24;

/// A kept tree with changes, five bytes each: a place (u32) and the byte that is added there. The checksum is right
/// again afterwards, unless the first byte of all is odd. What is taken for a tree must be a sound one.
fn tree(bytes: &[u8]) -> bool {
    static ONE_AT_A_TIME: std::sync::Mutex<()> = std::sync::Mutex::new(());
    let _alone = ONE_AT_A_TIME.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let Some((first, changes)) = bytes.split_first() else { return false };
    let kept = kept();
    let mut file = kept.bytes.clone();
    for change in changes.chunks_exact(5) {
        let place = u32::from_le_bytes([change[0], change[1], change[2], change[3]]) as usize % file.len();
        file[place] = file[place].wrapping_add(change[4]);
    }
    if first % 2 == 0 {
        let sum = xxhash_rust::xxh3::xxh3_128(&file[HEAD..]).to_le_bytes();
        file[HEAD - sum.len()..HEAD].copy_from_slice(&sum);
    }
    std::fs::write(&kept.path, &file).expect("the changed tree is written");
    let (tree, found) = {
        let whole = || kept.tree.clone();
        kept.cache.find_or(TreeFor::Packets, &kept.positions, &kept.triangles, whole)
    };
    assert!(!found || tree.is_sound(&kept.positions, &kept.triangles));
    found
}
