//! Materials of the town: 16x16 texels each, shown as squares.

use glam::{Vec2, Vec3};
use serde_json::json;

use crate::scene::generate::glb::Glb;
use crate::scene::generate::paint::{bond, cell, picture};

/// How a material's texture is drawn.
enum Pattern {
    /// Texels of varying brightness.
    Grain,
    /// Bricks: columns and rows.
    Bricks(i64, i64),
    /// Planks across.
    Planks,
    /// Grain with holes.
    Leaves,
    /// A window's frame and panes.
    Pane,
}

/// Name, sRGB colour, strength of the grain, pattern, roughness, emitted radiance.
type Entry = (&'static str, [u8; 3], f32, Pattern, f32, f32);

/// Number of materials.
pub(super) const COUNT: usize = 16;

/// In the order of the blocks.
const MATERIALS: [Entry; COUNT] = [
    ("grass", [96, 136, 58], 0.22, Pattern::Grain, 1.0, 0.0),
    ("dirt", [118, 88, 62], 0.2, Pattern::Grain, 1.0, 0.0),
    ("cobble", [136, 132, 126], 0.2, Pattern::Bricks(4, 4), 0.85, 0.0),
    ("stone", [160, 155, 145], 0.1, Pattern::Bricks(2, 4), 0.8, 0.0),
    ("white plaster", [226, 218, 202], 0.05, Pattern::Grain, 0.9, 0.0),
    ("ochre plaster", [214, 170, 104], 0.07, Pattern::Grain, 0.9, 0.0),
    ("brick", [158, 82, 64], 0.14, Pattern::Bricks(2, 4), 0.85, 0.0),
    ("timber", [88, 62, 40], 0.18, Pattern::Planks, 0.8, 0.0),
    ("planks", [170, 128, 80], 0.12, Pattern::Planks, 0.7, 0.0),
    ("roof tiles", [176, 84, 54], 0.18, Pattern::Bricks(4, 4), 0.75, 0.0),
    ("slate", [84, 92, 106], 0.15, Pattern::Bricks(4, 4), 0.5, 0.0),
    ("water", [36, 84, 104], 0.05, Pattern::Grain, 0.06, 0.0),
    ("leaves", [64, 112, 44], 0.35, Pattern::Leaves, 0.9, 0.0),
    ("glass", [70, 96, 116], 0.06, Pattern::Pane, 0.08, 0.0),
    ("sand", [216, 200, 156], 0.1, Pattern::Grain, 1.0, 0.0),
    ("lamp", [255, 214, 140], 0.04, Pattern::Pane, 0.6, 6.0),
];

/// Adds all materials; returns their indices.
pub(super) fn add(glb: &mut Glb) -> Vec<usize> {
    MATERIALS.iter().enumerate().map(|(i, entry)| add_one(glb, i as u64, entry)).collect()
}

fn add_one(glb: &mut Glb, seed: u64, (name, colour, grain, pattern, roughness, emitted): &Entry) -> usize {
    let colour = Vec3::from(colour.map(|c| f32::from(c) / 255.0));
    let png = picture(16, |uv| texel(uv, colour, *grain, pattern, seed));
    let texture = glb.texture(name, &png, true);
    let mut material = json!({
        "name": name,
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": texture }, "metallicFactor": 0.0, "roughnessFactor": roughness,
        },
    });
    if matches!(pattern, Pattern::Leaves) {
        material["alphaMode"] = json!("MASK");
        material["doubleSided"] = json!(true);
    }
    if *emitted > 0.0 {
        glb.extension("KHR_materials_emissive_strength", false);
        material["emissiveTexture"] = json!({ "index": texture });
        material["emissiveFactor"] = json!([1.0, 1.0, 1.0]);
        material["extensions"] =
            json!({ "KHR_materials_emissive_strength": { "emissiveStrength": emitted } });
    }
    glb.material(material)
}

fn texel(uv: Vec2, colour: Vec3, grain: f32, pattern: &Pattern, seed: u64) -> [f32; 4] {
    let [x, y] = (uv * 16.0).to_array().map(|c| c as i64);
    let speckle = cell(x, y, seed);
    let mut shade = 1.0 + grain * (speckle - 0.5) * 2.0;
    let mut alpha = 1.0;
    match *pattern {
        Pattern::Grain => {}
        Pattern::Bricks(columns, rows) => {
            let bond = bond(uv, columns, rows);
            let joint = bond.edge * 16.0 / (rows as f32) < 0.6;
            shade *= if joint { 0.68 } else { 0.9 + 0.2 * cell(bond.brick[0], bond.brick[1], seed) };
        }
        Pattern::Planks => {
            shade *= if y % 4 == 3 { 0.66 } else { 0.9 + 0.2 * cell(0, y / 4, seed) };
        }
        Pattern::Leaves => alpha = if cell(x / 2, y / 2, seed + 99) < 0.3 { 0.0 } else { 1.0 },
        Pattern::Pane => {
            let frame = [x, y].iter().any(|&c| c == 0 || c == 15 || c == 7);
            shade *= if frame { 0.45 } else { 1.0 };
        }
    }
    let c = colour * shade;
    [c.x, c.y, c.z, alpha]
}
