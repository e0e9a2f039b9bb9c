//! The first inputs of each fuzz target, made here: good ones that are taken, and bad ones that went wrong once.

use std::io::Cursor;

use base64::Engine;
use foveate::headset::rift_dk1::report::{DisplayInfo, KeepAlive, Range, RawSample, SensorReport};
use serde_json::json;

use crate::entries::glb;

/// The entry, the file's name and its bytes.
type Seed = (&'static str, &'static str, Vec<u8>);

/// All of them.
pub fn all() -> Vec<Seed> {
    [scenes(), pictures(), textures(), compressed(), settings(), tracker(), features(), others()].concat()
}

/// A triangle with a texture: positions, texture coordinates, and a picture of its own.
fn triangle() -> (serde_json::Value, Vec<u8>) {
    let numbers: [f32; 15] = [0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 0., 1., 0., 0., 1.];
    let mut buffer: Vec<u8> = numbers.iter().flat_map(|number| number.to_le_bytes()).collect();
    let picture = picture(image::ImageFormat::Png);
    let document = json!({
        "asset": { "version": "2.0" }, "scene": 0, "scenes": [{ "nodes": [0] }],
        "nodes": [{ "mesh": 0, "children": [1], "rotation": [0, 0.6, 0, 0.8] }, { "camera": 0, "translation": [0, 0, 3] }],
        "cameras": [{ "type": "perspective", "perspective": { "yfov": 0.8, "znear": 0.1 } }],
        "buffers": [{ "byteLength": buffer.len() + picture.len() }],
        "bufferViews": [
            { "buffer": 0, "byteLength": 36 }, { "buffer": 0, "byteOffset": 36, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 60, "byteLength": picture.len() },
        ],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "type": "VEC3", "count": 3, "min": [0, 0, 0], "max": [1, 1, 0] },
            { "bufferView": 1, "componentType": 5126, "type": "VEC2", "count": 3 },
        ],
        "images": [{ "bufferView": 2, "mimeType": "image/png" }], "textures": [{ "source": 0 }],
        "materials": [{ "pbrMetallicRoughness": { "baseColorTexture": { "index": 0 } }, "alphaMode": "MASK",
            "extensions": { "KHR_materials_transmission": { "transmissionFactor": 0.5 } } }],
        "extensionsUsed": ["KHR_materials_transmission", "KHR_lights_punctual"],
        "extensions": { "KHR_lights_punctual": { "lights": [{ "type": "spot", "spot": {} }] } },
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "material": 0 }] }],
    });
    buffer.extend(picture);
    (document, buffer)
}

fn scenes() -> Vec<Seed> {
    let (mut document, buffer) = triangle();
    let binary = glb(&document, &buffer);
    let data = base64::engine::general_purpose::STANDARD.encode(&buffer);
    document["buffers"][0]["uri"] = json!(format!("data:application/octet-stream;base64,{data}"));
    let text = document.to_string().into_bytes();
    // Materials without end: two bytes each in the file, hundreds in memory.
    let materials = format!(r#"{{"asset":{{"version":"2.0"}},"materials":[{}{{}}]}}"#, "{},".repeat(20_000));
    let obj = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 1 1 0\nvt 0 0\nvn 0 0 1\nusemtl a\nf 1/1/1 2//1 -2\nf 1 2 4 3\n\0newmtl a\n\
        Kd 0.5 0.5 0.5\nKs 1 1 1\nNs 50\nd 0.5\nillum 2\nmap_Kd none.png\n";
    vec![
        ("gltf", "good-triangle", text),
        ("gltf", "bad-materials", materials.into_bytes()),
        ("glb", "good-triangle", binary),
        ("obj", "good-polygons", obj.to_vec()),
    ]
}

/// A small picture with many colours.
fn picture(format: image::ImageFormat) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let rgb =
        image::RgbImage::from_fn(9, 7, |x, y| image::Rgb([(x * 28) as u8, (y * 36) as u8, (x * y) as u8]));
    image::DynamicImage::from(rgb).write_to(&mut bytes, format).unwrap();
    bytes.into_inner()
}

fn pictures() -> Vec<Seed> {
    use image::ImageFormat;
    let floats = image::Rgb32FImage::from_fn(8, 4, |x, y| image::Rgb([x as f32, y as f32 * 0.1, 50.0]));
    let mut hdr = Cursor::new(Vec::new());
    image::DynamicImage::from(floats).write_to(&mut hdr, ImageFormat::Hdr).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("map.exr");
    exr::prelude::write_rgb_file(&path, 8, 4, |x, y| (x as f32, y as f32 * 0.1, 50.0f32)).unwrap();
    vec![
        ("png", "good-picture", picture(ImageFormat::Png)),
        ("jpeg", "good-picture", picture(ImageFormat::Jpeg)),
        ("webp", "good-picture", picture(ImageFormat::WebP)),
        ("bmp", "good-picture", picture(ImageFormat::Bmp)),
        ("tga", "good-picture", picture(ImageFormat::Tga)),
        ("hdr", "good-map", hdr.into_inner()),
        ("exr", "good-map", std::fs::read(path).unwrap()),
    ]
}

/// The part of a scene of tests/files/scenes that is its picture of that number.
fn picture_of(scene: &str, number: usize) -> Vec<u8> {
    let path = format!("{}/tests/files/scenes/{scene}", env!("CARGO_MANIFEST_DIR"));
    let scene = std::fs::read(path).unwrap();
    let length = u32::from_le_bytes(scene[12..16].try_into().unwrap()) as usize;
    let document: serde_json::Value = serde_json::from_slice(&scene[20..20 + length]).unwrap();
    let view = document["images"][number]["bufferView"].as_u64().unwrap() as usize;
    let view = &document["bufferViews"][view];
    let [offset, size] = ["byteOffset", "byteLength"].map(|key| view[key].as_u64().unwrap_or(0) as usize);
    scene[28 + length + offset..][..size].to_vec()
}

/// Pictures compressed by Basis Universal: with coverage, with and without Zstandard, and with places and lengths
/// that lie.
fn textures() -> Vec<Seed> {
    const LEAVES: usize = 9;
    let [etc1s, zstd, plain] = [("etc1s.glb", LEAVES), ("uastc.glb", 0), ("uastc.glb", LEAVES)]
        .map(|(scene, number)| picture_of(scene, number));
    let with = |file: &[u8], place: usize, bytes: &[u8]| {
        let mut file = file.to_vec();
        file[place..place + bytes.len()].copy_from_slice(bytes);
        file
    };
    let far = (u64::MAX - 5).to_le_bytes();
    vec![
        ("ktx2", "bad-global-place", with(&etc1s, 64, &far)),
        ("ktx2", "bad-level-place", with(&plain, 80, &far)),
        ("ktx2", "bad-size", with(&zstd, 20, &[0, 64, 0, 0, 0, 64])),
        ("ktx2", "bad-zstd-length", with(&zstd, 96, &far)),
        ("ktx2", "good-etc1s", etc1s),
        // The last note ends without the bytes that would fill its word.
        ("ktx2", "good-notes", with(&plain, 60, &[33])),
        ("ktx2", "good-uastc", plain),
        ("ktx2", "good-uastc-zstd", zstd),
    ]
}

fn compressed() -> Vec<Seed> {
    let positions: [[f32; 3]; 3] = [[0., 0., 0.], [1., 0., 0.], [0., 1., 0.]];
    let encoded = meshopt::encode_vertex_buffer(&positions).unwrap();
    let scene = std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/tests/files/scenes/draco.glb")).unwrap();
    let length = u32::from_le_bytes(scene[12..16].try_into().unwrap()) as usize;
    let document: serde_json::Value = serde_json::from_slice(&scene[20..20 + length]).unwrap();
    let number = |value: &serde_json::Value| value.as_u64().unwrap_or(0) as usize;
    let view_of = |primitive: &serde_json::Value| {
        let view = number(&primitive["extensions"]["KHR_draco_mesh_compression"]["bufferView"]);
        let view = &document["bufferViews"][view];
        let start = 28 + length + number(&view["byteOffset"]);
        start..start + number(&view["byteLength"])
    };
    let meshes = document["meshes"].as_array().unwrap();
    let primitives = meshes.iter().flat_map(|mesh| mesh["primitives"].as_array().unwrap());
    let primitive = primitives.min_by_key(|primitive| view_of(primitive).len()).unwrap();
    let count =
        |accessor: &serde_json::Value| number(&document["accessors"][number(accessor)]["count"]) as u16;
    let place = &primitive["extensions"]["KHR_draco_mesh_compression"]["attributes"]["POSITION"];
    let counts = [count(&primitive["attributes"]["POSITION"]), count(&primitive["indices"])];
    let head = [&counts.map(u16::to_le_bytes).concat()[..], &[number(place) as u8]].concat();
    let data = &scene[view_of(primitive)];
    vec![
        ("draco", "good-mesh", [&head[..], data].concat()),
        ("meshopt", "good-triangle", [&[3, 0, 0][..], &encoded].concat()),
        ("meshopt", "bad-filter", [&[3, 0, 1][..], &encoded].concat()),
    ]
}

fn settings() -> Vec<Seed> {
    let read = |path: &str| std::fs::read(format!("{}/{path}", env!("CARGO_MANIFEST_DIR"))).unwrap();
    vec![
        ("config", "good-defaults", read("configs/default.toml")),
        ("config", "bad-number", b"[trace]\nrays = -1e999\n".to_vec()),
        ("front", "good-preset", read("configs/quality/balanced.toml")),
        ("front", "bad-point", b"[[budget.front]]\nframe_ms = nan\nscore = 1\n".to_vec()),
    ]
}

fn tracker() -> Vec<Seed> {
    let sample = RawSample { accel: [0, 98_066, 0], gyro: [0, 1000, 0] };
    let report = |timestamp: u16| {
        let report = SensorReport {
            sample_count: 1,
            timestamp,
            last_command_id: 0,
            temperature: 3000,
            samples: [sample; 3],
            mag: [2500, 4300, 0],
        };
        report.encode().to_vec()
    };
    let reports: Vec<Vec<u8>> = (0..5).map(report).collect();
    let timed = reports
        .iter()
        .enumerate()
        .flat_map(|(i, report)| [&(i as u64 * 1_000_000).to_le_bytes()[..], report].concat());
    vec![
        ("report", "good-reports", reports.concat()),
        ("recording", "good-bare", reports.concat()),
        ("recording", "good-timed", b"foveate dk1 1.0\n".iter().copied().chain(timed).collect()),
        ("recording", "bad-scene", glb(&triangle().0, &triangle().1)),
    ]
}

fn features() -> Vec<Seed> {
    let display = |distortion: [f32; 6]| DisplayInfo {
        command_id: 1,
        distortion_type: 2,
        resolution: [1280, 800],
        size: [149_760, 93_600],
        vertical_centre: 46_800,
        lens_separation: 63_500,
        lens_distance: [49_800; 2],
        distortion,
    };
    let range = Range { command_id: 1, accel: 4, gyro: 1000, mag: 1300 };
    vec![
        ("feature_report", "good-range", range.encode().to_vec()),
        (
            "feature_report",
            "good-keep-alive",
            KeepAlive { command_id: 1, interval: 10_000 }.encode().to_vec(),
        ),
        ("feature_report", "good-display", display([1.0, 0.22, 0.24, 0.0, 0.0, 0.0]).encode().to_vec()),
        // An eye's picture of 4294967295 pixels across, once.
        (
            "feature_report",
            "good-display-unbounded",
            display([1.0, -1e30, 1e38, 0.0, -1e38, 1e30]).encode().to_vec(),
        ),
        ("feature_report", "bad-empty", Vec::new()),
    ]
}

fn others() -> Vec<Seed> {
    let point = json!({
        "name": "given", "axis": "given", "config": { "trace": { "rays": 32 } }, "frame_ms": 60.5,
        "frame_ms_p10": 58.0, "frame_ms_p90": 70.0, "frames": 8, "pulse_ms": 60.0, "pattern_ms": 12.0,
        "samples": 55_296, "rays": 1_800_000, "psnr": 31.5, "psnr_display": 30.0, "relmse": 0.01, "flip": 0.05,
        "foveated_score": 8.5, "foveated_thresholds": 1.2, "foveated_scores": [8.4, 8.6],
        "foveated_score_error": 0.1, "flicker": 0.01, "disagreement": null, "on_front": true, "operating": null,
    });
    vec![
        ("measurement", "good-point", point.to_string().into_bytes()),
        ("measurement", "bad-part", b"{\"name\": \"given\", \"frame_ms\": 1e999".to_vec()),
        ("tree", "good-unchanged", vec![0]),
        ("tree", "bad-count", vec![0, 24, 0, 0, 0, 1]),
        ("tree", "bad-checksum", vec![1, 0, 1, 0, 0, 1]),
    ]
}
