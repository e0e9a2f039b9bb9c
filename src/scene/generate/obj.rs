//! A scene as Wavefront OBJ with materials and pictures: for readers of that format, ours among them.

use std::collections::HashMap;
use std::fmt::Write as _;
use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec2};

use super::paint;
use crate::error::{Error, Result};
use crate::scene::{AlphaMode, Material, Scene, Texture, TextureRef};
use crate::whole_file;

/// Triangles in a group at most: files of scanned and built worlds have thousands of groups.
const GROUP: usize = 1000;

/// Writes `scene` to `path`, its materials beside it with the ending .mtl, and its pictures as PNG files whose
/// names begin as the scene's. Returns the OBJ's size in bytes.
///
/// # Errors
/// Where one of these cannot be written; the error names it.
pub fn write(path: &Path, scene: &Scene) -> Result<usize> {
    let materials = path.with_extension("mtl");
    let pictures: Vec<PathBuf> = (0..scene.textures.len()).map(|i| picture_path(path, i)).collect();
    for path in pictures.iter().chain([&materials]) {
        whole_file::check(path)?;
    }
    for (texture, path) in scene.textures.iter().zip(&pictures) {
        super::write(path, &picture(texture))?;
    }
    super::write(&materials, materials_of(scene, &pictures).as_bytes())?;
    let mut size = 0;
    whole_file::write(path, |file| {
        let mut put = |text: &str| {
            size += text.len();
            file.write_all(text.as_bytes()).map_err(|error| Error::writing(path, &error))
        };
        put(&format!("mtllib {}\n", name_of(&materials)))?;
        groups(scene, &mut put)
    })?;
    Ok(size)
}

/// The finest level of a texture as PNG.
fn picture(texture: &Texture) -> Vec<u8> {
    let (_, width, height) = texture.level(0);
    paint::png([width, height], &texture.texels[..width as usize * height as usize])
}

fn picture_path(path: &Path, index: usize) -> PathBuf {
    let stem = path.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
    path.with_file_name(format!("{stem}-{index}.png"))
}

fn name_of(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

/// Writes to a string, which cannot fail.
macro_rules! add {
    ($text:expr, $($what:tt)*) => {{ let _ = writeln!($text, $($what)*); }};
}

fn materials_of(scene: &Scene, pictures: &[PathBuf]) -> String {
    let mut text = String::new();
    for (i, material) in scene.materials.iter().enumerate() {
        let file = |texture: &TextureRef| name_of(&pictures[texture.texture as usize]);
        let [r, g, b, alpha] = material.base_color.to_array();
        add!(text, "newmtl {i}\nKd {r} {g} {b}\nPr {}\nPm {}", material.roughness, material.metallic);
        if let Some(texture) = &material.base_color_texture {
            add!(text, "map_Kd {}", file(texture));
            if material.alpha != AlphaMode::Opaque {
                add!(text, "map_d {}", file(texture));
            }
        }
        if material.alpha != AlphaMode::Opaque {
            add!(text, "d {alpha}");
        }
        if material.emissive != glam::Vec3::ZERO {
            add!(text, "Ke {} {} {}", material.emissive.x, material.emissive.y, material.emissive.z);
        }
        if let Some(texture) = &material.emissive_texture {
            add!(text, "map_Ke {}", file(texture));
        }
        if let Some(texture) = &material.normal_texture {
            add!(text, "norm {}", file(texture));
        }
    }
    text
}

/// All triangles, those of a material that follow each other in groups.
fn groups(scene: &Scene, put: &mut impl FnMut(&str) -> Result<()>) -> Result<()> {
    let mesh = &scene.mesh;
    let mut written = 0;
    let mut start = 0;
    while start < mesh.triangles.len() {
        let material = mesh.materials[start];
        let same = mesh.materials[start..].iter().take(GROUP).take_while(|m| **m == material).count();
        let mut text = format!("g {start}\nusemtl {material}\n");
        written += group(scene, start..start + same, &scene.materials[material as usize], written, &mut text);
        put(&text)?;
        start += same;
    }
    Ok(())
}

/// One group; returns how many vertices it has.
fn group(
    scene: &Scene,
    triangles: std::ops::Range<usize>,
    material: &Material,
    first: usize,
    text: &mut String,
) -> usize {
    let mesh = &scene.mesh;
    let placed = material.base_color_texture.or(material.emissive_texture).or(material.normal_texture);
    let mut numbers = HashMap::<u32, usize>::new();
    let mut faces = String::new();
    for triangle in &mesh.triangles[triangles] {
        let corners = triangle.map(|vertex| {
            let next = first + numbers.len() + 1;
            *numbers.entry(vertex).or_insert_with(|| {
                let at = scene.anchor + mesh.positions[vertex as usize].as_dvec3();
                let DVec3 { x, y, z } = at;
                let normal = mesh.normals[vertex as usize];
                let uv = placed.map_or(Vec2::ZERO, |texture| {
                    texture.matrix * mesh.uvs[texture.uv_slot as usize][vertex as usize] + texture.offset
                });
                add!(text, "v {} {} {}", x as f32, y as f32, z as f32);
                add!(text, "vt {} {}\nvn {} {} {}", uv.x, 1.0 - uv.y, normal.x, normal.y, normal.z);
                next
            })
        });
        let [a, b, c] = corners;
        add!(faces, "f {a}/{a}/{a} {b}/{b}/{b} {c}/{c}/{c}");
    }
    text.push_str(&faces);
    numbers.len()
}
