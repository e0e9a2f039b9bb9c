//! Files as people have them: with a fault that need not matter, in other formats, or larger than memory.

mod animations;
mod budget;
#[path = "../common/mod.rs"]
mod common;
mod damaged;
mod extensions;
mod instancing;
mod obj;
mod textures;
mod tolerance;
mod types;

use std::path::Path;

use common::builder::Builder;
use foveate::scene::budget::Budget;
use foveate::scene::{LoadOptions, Scene};
use serde_json::json;

/// A triangle with coordinates and one material.
fn textured(material: impl FnOnce(&mut Builder) -> serde_json::Value) -> Builder {
    let mut builder = Builder::new();
    let positions = builder.floats(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
    let uvs = builder.floats(&[[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]);
    let material = material(&mut builder);
    let material = builder.push("materials", material);
    let attributes = json!({ "POSITION": positions, "TEXCOORD_0": uvs });
    builder.place(json!({ "attributes": attributes, "material": material }), json!({}));
    builder
}

/// Memory enough for whatever these tests load.
const FREE: u64 = 4_000_000_000;

/// Loads a file where so many bytes are free.
fn load_within(path: &Path, free: u64) -> foveate::Result<Scene> {
    Scene::load_with(path, &LoadOptions { budget: Budget::with_free(free), ..LoadOptions::default() })
}

/// Writes a document and loads it where so many bytes are free.
fn load_in(folder: &Path, builder: &Builder, free: u64) -> foveate::Result<Scene> {
    let path = folder.join("scene.gltf");
    std::fs::write(&path, builder.document().to_string()).unwrap();
    load_within(&path, free)
}

fn write_png(path: &Path, width: u32, height: u32) {
    let picture = image::RgbImage::from_fn(width, height, |x, y| image::Rgb([x as u8, y as u8, 7]));
    picture.save_with_format(path, image::ImageFormat::Png).unwrap();
}
