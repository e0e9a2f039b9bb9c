//! The glade's materials, their pictures painted by formula.

use glam::{Vec2, Vec3};
use serde_json::json;

use crate::scene::generate::demo::materials::bark;
use crate::scene::generate::glb::Glb;
use crate::scene::generate::material::{plain, rgb, textured};
use crate::scene::generate::paint::{clouds, mix, noise, normal_map, opaque, picture, smoothstep};

/// Indices of the materials.
pub struct Materials {
    pub soil: usize,
    pub rock: usize,
    pub bark: usize,
    pub leaves: usize,
    pub autumn: usize,
    pub needles: usize,
    pub fern: usize,
    pub grass: usize,
    pub water: usize,
    pub stem: usize,
    pub cap: usize,
}

impl Materials {
    pub fn add(glb: &mut Glb) -> Self {
        glb.extension("KHR_texture_transform", false);
        Materials {
            soil: soil(glb),
            rock: rock(glb),
            bark: bark(glb),
            leaves: green(glb, "leaves", [0x3d6423, 0x5f8a2c, 0x9ab03f], 0.5),
            autumn: green(glb, "autumn leaves", [0x9a5a1c, 0xc98a24, 0x8a8f2e], 0.5),
            needles: green(glb, "needles", [0x24442a, 0x35603a, 0x527a42], 0.6),
            fern: green(glb, "fern", [0x3f7030, 0x5c9038, 0x7fae4c], 0.55),
            grass: green(glb, "grass", [0x55702c, 0x77913c, 0xb0ae62], 0.6),
            water: plain(glb, "water", 0x16302c, 0.0, 0.03),
            stem: plain(glb, "mushroom stems", 0xe8dcc4, 0.0, 0.8),
            cap: plain(glb, "mushroom caps", 0xa8341e, 0.0, 0.25),
        }
    }
}

/// Leaves seen from both sides: tones along u, from the stalk to the tip along v.
fn green(glb: &mut Glb, name: &str, tones: [u32; 3], roughness: f32) -> usize {
    let colour = picture(64, |uv| {
        let [low, middle, high] = tones.map(rgb);
        let tone =
            if uv.x < 0.5 { mix(low, middle, 2.0 * uv.x) } else { mix(middle, high, 2.0 * uv.x - 1.0) };
        opaque(tone * (0.7 + 0.4 * smoothstep(0.0, 0.7, uv.y)))
    });
    let texture = glb.texture(name, &colour, false);
    glb.material(json!({
        "name": name, "doubleSided": true,
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": texture }, "metallicFactor": 0.0, "roughnessFactor": roughness,
        },
    }))
}

/// Moss, earth and fallen leaves.
fn soil(glb: &mut Glb) -> usize {
    let litter = |uv: Vec2| smoothstep(0.55, 0.7, noise(uv, [70, 90], 401)) * noise(uv, [40, 40], 402);
    let colour = picture(512, |uv| {
        let moss = smoothstep(0.35, 0.6, clouds(uv, 6, 5, 403));
        let ground = mix(rgb(0x4a3826), rgb(0x5d7030), moss) * (0.7 + 0.5 * clouds(uv, 64, 3, 404));
        opaque(mix(ground, rgb(0x9a6a34), 0.6 * litter(uv)))
    });
    let normals = normal_map(512, |uv| 0.012 * clouds(uv, 40, 3, 405) + 0.004 * litter(uv));
    textured(glb, "forest floor", &colour, Some(&normals), 3.0, 1.0)
}

/// Grey stone with lichen.
fn rock(glb: &mut Glb) -> usize {
    let colour = picture(512, |uv| {
        let body = mix(rgb(0x6d6860), rgb(0x9a948a), clouds(uv, 5, 6, 411));
        let lichen = smoothstep(0.6, 0.68, clouds(uv, 9, 4, 412));
        let speck = smoothstep(0.75, 0.8, noise(uv, [120, 120], 413));
        opaque(mix(mix(body, rgb(0xa3a878), 0.7 * lichen), Vec3::splat(0.25), 0.5 * speck))
    });
    let normals = normal_map(512, |uv| 0.02 * clouds(uv, 14, 5, 414));
    textured(glb, "rock", &colour, Some(&normals), 1.1, 0.85)
}
