//! The demo scene's materials, their pictures painted by formula.

use glam::Vec2;
use serde_json::json;

use crate::scene::generate::glb::Glb;
use crate::scene::generate::material::{plain, repeated, rgb, textured};
use crate::scene::generate::paint::{
    bond, cell, clouds, mix, noise, normal_map, opaque, picture, smoothstep,
};

/// Indices of the materials.
pub(super) struct Materials {
    pub(super) floor: usize,
    pub(super) brick: usize,
    pub(super) stone: usize,
    pub(super) marble: usize,
    pub(super) plaster: usize,
    pub(super) tiles: usize,
    pub(super) wood: usize,
    pub(super) bark: usize,
    pub(super) leaves: usize,
    pub(super) grass: usize,
    pub(super) fabric: usize,
    pub(super) iron: usize,
    pub(super) rust: usize,
    pub(super) gold: usize,
    pub(super) copper: usize,
    pub(super) chrome: usize,
    pub(super) brass: usize,
    pub(super) red: usize,
    pub(super) white: usize,
    pub(super) blue: usize,
    pub(super) clay: usize,
    pub(super) agave: usize,
    pub(super) water: usize,
    pub(super) lamp: usize,
    pub(super) bulb: usize,
}

impl Materials {
    pub(super) fn add(glb: &mut Glb) -> Self {
        glb.extension("KHR_texture_transform", false);
        glb.extension("KHR_materials_emissive_strength", false);
        Materials {
            floor: floor(glb),
            brick: brick(glb),
            stone: stone(glb),
            marble: marble(glb),
            plaster: plaster(glb),
            tiles: tiles(glb),
            wood: wood(glb),
            bark: bark(glb),
            leaves: leaves(glb),
            grass: grass(glb),
            fabric: fabric(glb),
            iron: plain(glb, "wrought iron", 0x2b2b2e, 1.0, 0.45),
            rust: rust(glb),
            gold: plain(glb, "gold", 0xffe29b, 1.0, 0.16),
            copper: plain(glb, "copper", 0xfad0c0, 1.0, 0.38),
            chrome: plain(glb, "chrome", 0xf0f0f0, 1.0, 0.02),
            brass: plain(glb, "brass", 0xe9cf87, 1.0, 0.26),
            red: plain(glb, "red lacquer", 0xb0171d, 0.0, 0.06),
            white: plain(glb, "porcelain", 0xf2efe8, 0.0, 0.18),
            blue: plain(glb, "blue glaze", 0x1c4a8c, 0.0, 0.1),
            clay: plain(glb, "terracotta", 0xb5623c, 0.0, 0.85),
            agave: plain(glb, "agave", 0x5f8a5a, 0.0, 0.45),
            water: plain(glb, "water", 0x1f4a48, 0.0, 0.03),
            lamp: light(glb, "lamp", [1.0, 0.66, 0.3], 9.0),
            bulb: light(glb, "bulb", [1.0, 0.8, 0.5], 16.0),
        }
    }
}

fn light(glb: &mut Glb, name: &str, colour: [f32; 3], strength: f32) -> usize {
    glb.material(json!({
        "name": name,
        "pbrMetallicRoughness": { "baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0 },
        "emissiveFactor": colour,
        "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": strength } },
    }))
}

/// Polished terrazzo slabs in two tones; joints and some chips are rougher.
fn floor(glb: &mut Glb) -> usize {
    const SLABS: f32 = 4.0;
    let joint = |uv: Vec2| {
        let inside = (uv * SLABS).fract();
        let edge = inside.min(1.0 - inside).min_element();
        1.0 - smoothstep(0.006, 0.014, edge)
    };
    // Chips: cells of a jittered grid, each with a stone of its own size and colour.
    let chip = |uv: Vec2| {
        let p = uv * 128.0;
        let base = p.floor();
        let mut best = (0.0f32, 0i64, 0i64);
        for (dx, dy) in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| (dx, dy))) {
            let (x, y) = ((base.x as i64 + dx).rem_euclid(128), (base.y as i64 + dy).rem_euclid(128));
            let centre = base + Vec2::new(dx as f32 + cell(x, y, 1), dy as f32 + cell(x, y, 2));
            let cover = 0.15 + 0.5 * cell(x, y, 3) - p.distance(centre);
            if cover > best.0 {
                best = (cover, x, y);
            }
        }
        (smoothstep(0.0, 0.06, best.0), best.1, best.2)
    };
    let colour = picture(1024, |uv| {
        let slab = (uv * SLABS).floor();
        let dark = (slab.x + slab.y) as i64 % 2 == 0;
        let ground = if dark { rgb(0x8c5a48) } else { rgb(0xd9cdb8) };
        let tones = [0xf0e8da, 0x6f6a62, 0xb98f6a, 0x3f4a48];
        let (cover, x, y) = chip(uv);
        let stone = rgb(tones[(cell(x, y, 4) * 4.0) as usize % 4]);
        let body = mix(ground, stone, cover * 0.55) * (0.9 + 0.2 * clouds(uv, 6, 4, 5));
        opaque(mix(body, rgb(0x5a554e), joint(uv)))
    });
    let finish = picture(512, |uv| {
        let worn = 0.12 + 0.3 * smoothstep(0.45, 0.7, clouds(uv, 4, 5, 8)) + 0.5 * joint(uv);
        [0.0, worn, 0.0, 1.0]
    });
    let colour = glb.texture("terrazzo", &colour, false);
    let finish = glb.texture("terrazzo finish", &finish, false);
    glb.material(json!({
        "name": "terrazzo",
        "pbrMetallicRoughness": {
            "baseColorTexture": repeated(colour, 3.2), "metallicRoughnessTexture": repeated(finish, 3.2),
        },
    }))
}

fn brick(glb: &mut Glb) -> usize {
    let wobble = |uv: Vec2| uv + 0.004 * Vec2::new(noise(uv, [24, 24], 11), noise(uv, [24, 24], 12));
    let height = move |uv: Vec2| {
        let bond = bond(wobble(uv).fract(), 6, 16);
        let face = smoothstep(0.05, 0.16, bond.edge);
        0.008 * face * (0.8 + 0.2 * cell(bond.brick[0], bond.brick[1], 3)) + 0.004 * clouds(uv, 24, 3, 13)
    };
    let colour = picture(512, |uv| {
        let bond = bond(wobble(uv).fract(), 6, 16);
        let tone = cell(bond.brick[0], bond.brick[1], 7);
        let body = mix(rgb(0x9c4f38), rgb(0xc27a56), tone) * (0.75 + 0.5 * clouds(uv, 16, 4, 14));
        opaque(mix(rgb(0xb9aa94), body, smoothstep(0.04, 0.1, bond.edge)))
    });
    textured(glb, "brick", &colour, Some(&normal_map(512, height)), 1.4, 0.9)
}

fn stone(glb: &mut Glb) -> usize {
    let colour = picture(512, |uv| {
        let veins = clouds(uv, 4, 6, 21);
        let pores = smoothstep(0.68, 0.78, noise(uv, [96, 96], 22));
        opaque(mix(rgb(0xcbb894), rgb(0xe9dec6), veins) * (1.0 - 0.25 * pores))
    });
    let height =
        |uv: Vec2| 0.006 * clouds(uv, 12, 4, 23) - 0.004 * smoothstep(0.68, 0.78, noise(uv, [96, 96], 22));
    textured(glb, "sandstone", &colour, Some(&normal_map(512, height)), 1.2, 0.8)
}

fn marble(glb: &mut Glb) -> usize {
    let colour = picture(512, |uv| {
        let bent = clouds(uv, 4, 5, 31);
        let vein = 1.0 - ((clouds(uv, 3, 5, 33) + 0.3 * bent) * 14.0).sin().abs();
        opaque(mix(rgb(0xf1ede6), rgb(0x7f8289), 0.75 * smoothstep(0.72, 1.0, vein)))
    });
    textured(glb, "marble", &colour, None, 0.9, 0.15)
}

fn plaster(glb: &mut Glb) -> usize {
    let colour = picture(512, |uv| {
        let stain = smoothstep(0.5, 0.75, clouds(uv, 3, 5, 41));
        opaque(mix(rgb(0xe6c48f), rgb(0xcfa06a), stain) * (0.94 + 0.1 * clouds(uv, 48, 2, 42)))
    });
    textured(glb, "plaster", &colour, Some(&normal_map(512, |uv| 0.004 * clouds(uv, 20, 4, 43))), 2.5, 0.95)
}

fn tiles(glb: &mut Glb) -> usize {
    let colour = picture(512, |uv| {
        let bond = bond(uv, 8, 6);
        let tone = cell(bond.brick[0], bond.brick[1], 51);
        let shade = 0.55 + 0.45 * (bond.inside.x * std::f32::consts::PI).sin();
        let lip = 1.0 - 0.5 * smoothstep(0.9, 1.0, bond.inside.y);
        opaque(mix(rgb(0xa84f32), rgb(0xd0805a), tone) * shade * lip * (0.85 + 0.3 * clouds(uv, 16, 3, 52)))
    });
    let height = |uv: Vec2| {
        let bond = bond(uv, 8, 6);
        0.03 * (bond.inside.x * std::f32::consts::PI).sin() + 0.012 * bond.inside.y
    };
    textured(glb, "roof tiles", &colour, Some(&normal_map(512, height)), 1.8, 0.8)
}

/// Planks along v.
fn wood(glb: &mut Glb) -> usize {
    const PLANKS: f32 = 4.0;
    let gap = |uv: Vec2| {
        let x = (uv.x * PLANKS).fract();
        1.0 - smoothstep(0.01, 0.03, x.min(1.0 - x))
    };
    let grain = |uv: Vec2| {
        let plank = (uv.x * PLANKS).floor() as i64;
        let moved = Vec2::new(uv.x, (uv.y + cell(plank, 0, 61)).fract());
        let bent = noise(moved, [8, 3], 62);
        0.5 + 0.5 * ((uv.x * 60.0 + bent * 9.0) + 4.0 * noise(moved, [64, 4], 63)).sin()
    };
    let colour = picture(512, |uv| {
        let plank = (uv.x * PLANKS).floor() as i64;
        let tone = 0.8 + 0.35 * cell(plank, 1, 64);
        let body = mix(rgb(0x6e4526), rgb(0xa8733f), grain(uv)) * tone;
        opaque(body * (1.0 - 0.8 * gap(uv)) * (0.9 + 0.2 * noise(uv, [128, 8], 65)))
    });
    let normals = normal_map(512, |uv| 0.0012 * grain(uv) - 0.006 * gap(uv));
    textured(glb, "oak", &colour, Some(&normals), 0.6, 0.42)
}

pub(in crate::scene::generate) fn bark(glb: &mut Glb) -> usize {
    let ridge =
        |uv: Vec2| 1.0 - (2.0 * noise(uv, [12, 4], 71) - 1.0).abs() * 0.7 - 0.3 * clouds(uv, 16, 3, 72);
    let colour = picture(256, |uv| opaque(mix(rgb(0x3a2b20), rgb(0x85694f), ridge(uv))));
    textured(glb, "bark", &colour, Some(&normal_map(256, |uv| 0.04 * ridge(uv))), 0.7, 0.95)
}

/// A spray of leaves on a card, with holes between.
fn leaves(glb: &mut Glb) -> usize {
    let colour = picture(256, |uv| {
        let mut best = (0.0f32, 0usize);
        for i in 0..9 {
            let (sin, cos) = (i as f32 * 2.4).sin_cos();
            let centre = Vec2::splat(0.5) + Vec2::new(cos, sin) * 0.11 * (i as f32).sqrt();
            let p = uv - centre;
            let (along, across) = (p.x * cos + p.y * sin, p.y * cos - p.x * sin);
            let cover = 1.0 - (along / 0.16).powi(2) - (across.abs() / 0.075);
            if cover > best.0 {
                best = (cover, i);
            }
        }
        let tone = cell(best.1 as i64, 0, 81);
        let body = mix(rgb(0x3f6b25), rgb(0x86a83c), tone)
            * (0.8 + 0.3 * best.0)
            * (0.85 + 0.3 * noise(uv, [32, 32], 82));
        [body.x, body.y, body.z, if best.0 > 0.0 { 1.0 } else { 0.0 }]
    });
    let texture = glb.texture("leaves", &colour, false);
    glb.material(json!({
        "name": "leaves", "alphaMode": "MASK", "alphaCutoff": 0.5, "doubleSided": true,
        "pbrMetallicRoughness": {
            "baseColorTexture": { "index": texture }, "metallicFactor": 0.0, "roughnessFactor": 0.6,
        },
    }))
}

fn grass(glb: &mut Glb) -> usize {
    let colour = picture(512, |uv| {
        let blades = noise(uv, [160, 90], 91);
        let patch = clouds(uv, 5, 4, 92);
        opaque(mix(rgb(0x55702c), rgb(0x9aa24e), patch) * (0.65 + 0.6 * blades))
    });
    textured(glb, "grass", &colour, None, 5.0, 1.0)
}

/// A woven cloth with stripes.
fn fabric(glb: &mut Glb) -> usize {
    let weave = |uv: Vec2| {
        let p = uv * 64.0;
        let over = (p.x.floor() + p.y.floor()) as i64 % 2 == 0;
        let inside = p.fract() - 0.5;
        let across = if over { inside.y } else { inside.x };
        (across * std::f32::consts::PI).cos()
    };
    let colour = picture(512, |uv| {
        let band = (uv.x * 8.0).floor() as i64;
        let tones = [0x8c1f2b, 0xe8dcc0, 0x8c1f2b, 0x8c1f2b, 0x1f3554, 0xe8dcc0, 0x1f3554, 0x8c1f2b];
        opaque(rgb(tones[band as usize % 8]) * (0.55 + 0.45 * weave(uv)))
    });
    let normals = normal_map(512, |uv| 0.004 * weave(uv));
    let material = textured(glb, "woven cloth", &colour, Some(&normals), 0.5, 0.95);
    glb.double_sided(material);
    material
}

/// Iron with patches of rust: a metallic-roughness picture.
fn rust(glb: &mut Glb) -> usize {
    let rusty = |uv: Vec2| smoothstep(0.45, 0.58, clouds(uv, 4, 6, 101));
    let colour = picture(512, |uv| {
        let brown = mix(rgb(0x6e3417), rgb(0xa8602c), clouds(uv, 24, 3, 102));
        opaque(mix(rgb(0xa7a9ac), brown, rusty(uv)))
    });
    let finish = picture(512, |uv| [0.0, 0.25 + 0.65 * rusty(uv), 1.0 - rusty(uv), 1.0]);
    let colour = glb.texture("rusty iron", &colour, false);
    let finish = glb.texture("rusty iron finish", &finish, false);
    glb.material(json!({
        "name": "rusty iron",
        "pbrMetallicRoughness": {
            "baseColorTexture": repeated(colour, 0.6), "metallicRoughnessTexture": repeated(finish, 0.6),
        },
    }))
}
