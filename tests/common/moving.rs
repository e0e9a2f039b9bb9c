//! Scenes that move, for tests.

use glam::{DMat4, DQuat, DVec3};
use serde_json::{Value, json};

use super::builder::{Builder, I16, U8};

/// A tube along y whose vertices hang on a chain of joints, some of them morphed, moved in all ways there are.
pub fn tube() -> Builder {
    tube_of(33, 12)
}

/// The same of so many rings with so many sides.
pub fn tube_of(rings: usize, sides: usize) -> Builder {
    const JOINTS: usize = 8;
    let mut builder = Builder::new();
    let (mut positions, mut joints, mut weights) = (Vec::new(), Vec::new(), Vec::new());
    let (mut thicker, mut bent) = (Vec::new(), Vec::new());
    let (mut normals, mut leaning) = (Vec::new(), Vec::new());
    for ring in 0..rings {
        for side in 0..sides {
            let height = ring as f32 / (rings - 1) as f32 * JOINTS as f32;
            let angle = side as f32 / sides as f32 * std::f32::consts::TAU;
            let out = [0.3 * angle.cos(), 0.0, 0.3 * angle.sin()];
            positions.push([out[0], height, out[2]]);
            thicker.push(out);
            normals.push([angle.cos(), 0.0, angle.sin()]);
            leaning.push([0.0, -0.2 * height * angle.cos(), 0.0]);
            bent.push([0.1 * height * height, 0.0, 0.0]);
            let lower = (height as usize).min(JOINTS - 2);
            let share = (height - lower as f32).min(1.0);
            joints.extend([lower as u8, lower as u8 + 1, (lower as u8 + 2) % JOINTS as u8, 0]);
            weights.push([(1.0 - share) * 0.8, share * 0.8, 0.15, 0.05]);
        }
    }
    let mut indices = Vec::new();
    for ring in 0..rings - 1 {
        for side in 0..sides {
            let at = |ring: usize, side: usize| (ring * sides + side % sides) as u16;
            indices.extend([at(ring, side), at(ring + 1, side), at(ring, side + 1)]);
            indices.extend([at(ring, side + 1), at(ring + 1, side), at(ring + 1, side + 1)]);
        }
    }
    let bind: Vec<[f32; 16]> = (0..JOINTS)
        .map(|joint| {
            DMat4::from_translation(DVec3::new(0.0, -(joint as f64), 0.0)).to_cols_array().map(|v| v as f32)
        })
        .collect();
    let vertices = positions.len();
    let [positions, thicker, bent, normals, leaning] =
        [positions, thicker, bent, normals, leaning].map(|list| builder.floats(&list));
    let joints = builder.accessor(&joints, U8, "VEC4", vertices);
    let (weights, bind) = (builder.floats(&weights), builder.floats(&bind));
    let indices = builder.shorts(&indices);
    let mesh = builder.push(
        "meshes",
        json!({ "weights": [0.2, 0.0], "primitives": [{
            "attributes": { "POSITION": positions, "NORMAL": normals, "JOINTS_0": joints, "WEIGHTS_0": weights },
            "targets": [{ "POSITION": thicker }, { "POSITION": bent, "NORMAL": leaning }],
            "indices": indices,
        }] }),
    );
    builder.push("nodes", json!({ "mesh": mesh, "skin": 0, "translation": [50, 60, 70] }));
    for joint in 0..JOINTS {
        let children: Vec<usize> = (joint + 1 < JOINTS).then_some(joint + 2).into_iter().collect();
        let height = if joint == 0 { 0.0 } else { 1.0 };
        let mut node = json!({ "translation": [0.0, height, 0.0] });
        if !children.is_empty() {
            node["children"] = json!(children);
        }
        builder.push("nodes", node);
    }
    builder.push("skins", json!({ "joints": (1..=JOINTS).collect::<Vec<_>>(), "inverseBindMatrices": bind }));
    builder.show(0);
    builder.show(1);
    builder.json["animations"] = tube_animations(&mut builder);
    builder
}

fn tube_animations(builder: &mut Builder) -> Value {
    let turn = |axis: DVec3, angle: f64| DQuat::from_axis_angle(axis.normalize(), angle);
    let flat = |q: DQuat| q.to_array().map(|v| v as f32);
    let short = |q: DQuat| q.to_array().map(|v| (v * 32767.0).round() as i16);
    let times = builder.floats(&[[0.0], [0.4], [1.0], [1.7]]);
    let two = builder.floats(&[[0.25], [2.0]]);
    let swings: Vec<[f32; 4]> =
        [0.0, 0.5, -0.7, 0.2].map(|angle| flat(turn(DVec3::new(1.0, 0.3, 0.2), angle))).to_vec();
    let swings = builder.floats(&swings);
    let shorts: Vec<u8> = [0.3, -0.4, 0.6, 0.1]
        .iter()
        .flat_map(|&angle| short(turn(DVec3::Z, angle)))
        .flat_map(i16::to_le_bytes)
        .collect();
    let shorts = builder.accessor(&shorts, I16, "VEC4", 4);
    builder.json["accessors"][shorts]["normalized"] = json!(true);
    let splined: Vec<[f32; 4]> = [0.1, -0.8]
        .iter()
        .flat_map(|&angle| [[0.2, 0.0, 0.1, -0.1], flat(turn(DVec3::X, angle)), [-0.3, 0.1, 0.0, 0.2]])
        .collect();
    let splined = builder.floats(&splined);
    let moves = builder.floats(&[[0.0, 1.0, 0.0], [0.2, 1.1, 0.0], [0.0, 0.9, 0.3], [0.0, 1.0, 0.0]]);
    let scales = builder.floats(&[[1.0, 1.0, 1.0], [1.5, 1.0, 0.7]]);
    let weights = builder.floats(&[[0.0], [0.5], [1.0], [0.0], [0.3], [0.7], [-0.2], [0.1]]);
    let curves = [
        (times, swings, "LINEAR", 2, "rotation"),
        (times, shorts, "LINEAR", 3, "rotation"),
        (two, splined, "CUBICSPLINE", 4, "rotation"),
        (times, moves, "LINEAR", 5, "translation"),
        (two, scales, "STEP", 6, "scale"),
        (times, weights, "LINEAR", 0, "weights"),
    ];
    let samplers: Vec<Value> = curves
        .iter()
        .map(|(input, output, kind, ..)| json!({ "input": input, "output": output, "interpolation": kind }))
        .collect();
    let channels: Vec<Value> = curves
        .iter()
        .enumerate()
        .map(|(i, (.., node, path))| json!({ "sampler": i, "target": { "node": node, "path": path } }))
        .collect();
    json!([{ "name": "Sway", "samplers": samplers, "channels": channels }])
}

/// That tube, of which nothing is left at times: all joints hang on one of no size.
pub fn flattening_tube() -> Builder {
    let mut builder = tube();
    let (times, sizes) = (
        builder.floats(&[[0.0], [1.0], [1.8], [2.0]]),
        builder.floats(&[[1.0; 3], [0.0; 3], [0.0; 3], [1.0; 3]]),
    );
    animate(&mut builder, 1, "scale", times, sizes);
    builder
}

/// That tube beside a box that turns, over a floor that stays, under a lamp that slides where `has_lamp` says so.
pub fn world(has_lamp: bool) -> Builder {
    let mut builder = tube();
    let floor = quad(&mut builder, 12.0);
    builder.place(floor, json!({ "translation": [0.0, -1.0, 0.0] }));
    builder.push("materials", json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.7, 0.3, 0.2, 1.0] } }));
    let mut cube = cube(&mut builder);
    cube["material"] = json!(0);
    builder.place(cube, json!({ "translation": [3.0, 1.0, 0.0] }));
    let turning = builder.json["nodes"].as_array().unwrap().len() - 1;
    let turns: Vec<[f32; 4]> =
        [0.0, 1.5, 3.0].map(|angle: f64| DQuat::from_rotation_y(angle).to_array().map(|v| v as f32)).to_vec();
    let (times, turns) = (builder.floats(&[[0.0], [1.0], [2.0]]), builder.floats(&turns));
    animate(&mut builder, turning, "rotation", times, turns);
    if has_lamp {
        let glow = json!({ "emissiveFactor": [1.0, 0.9, 0.6], "doubleSided": true,
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 30.0 } } });
        let glow = builder.push("materials", glow);
        let mut lamp = quad(&mut builder, 0.7);
        lamp["material"] = json!(glow);
        builder.place(lamp, json!({}));
        let sliding = builder.json["nodes"].as_array().unwrap().len() - 1;
        let (times, places) =
            (builder.floats(&[[0.0], [2.0]]), builder.floats(&[[-4.0, 4.0, 1.0], [6.0, 2.5, 2.0]]));
        animate(&mut builder, sliding, "translation", times, places);
    }
    builder
}

/// That world with a mirror image of the box that slides, and vanishes after 1.6 s.
pub fn world_of_two(has_lamp: bool) -> Builder {
    let mut builder = world(has_lamp);
    let nodes = builder.json["nodes"].as_array().unwrap();
    let turning = nodes.iter().position(|node| node["translation"] == json!([3.0, 1.0, 0.0])).unwrap();
    let box_mesh = builder.json["nodes"][turning]["mesh"].clone();
    let mirrored = builder.push("nodes", json!({ "mesh": box_mesh, "rotation": [0.2, 0.1, 0.0, 0.97468] }));
    builder.show(mirrored);
    let slides = builder.floats(&[[-2.5, 1.5, 1.0], [-3.5, 2.5, 1.5], [-3.0, 1.0, 1.0]]);
    let times = builder.floats(&[[0.0], [1.0], [2.0]]);
    animate(&mut builder, mirrored, "translation", times, slides);
    let (times, sizes) = (
        builder.floats(&[[0.0], [1.6], [1.7], [2.0]]),
        builder.floats(&[[-0.7, 0.8, 0.6], [-0.7, 0.8, 0.6], [0.0; 3], [0.0; 3]]),
    );
    animate(&mut builder, mirrored, "scale", times, sizes);
    builder
}

/// The world without a lamp, whose box turns, and is turned inside out after 1 s: what was its left is its right.
pub fn mirroring_world() -> Builder {
    let mut builder = world(false);
    let nodes = builder.json["nodes"].as_array().unwrap();
    let turning = nodes.iter().position(|node| node["translation"] == json!([3.0, 1.0, 0.0])).unwrap();
    let times = builder.floats(&[[0.0], [1.0], [2.0]]);
    let sizes = builder.floats(&[[1.0; 3], [-1.0, 1.0, 1.0], [-1.2, 1.0, 1.0]]);
    animate(&mut builder, turning, "scale", times, sizes);
    let samplers = builder.json["animations"][0]["samplers"].as_array_mut().unwrap();
    samplers.last_mut().unwrap()["interpolation"] = json!("STEP");
    builder
}

/// The world without a lamp, whose box turns, and glows where that is said; it is seen from the beginning to 0.5 s, and
/// again from 1.5 s on.
pub fn blinking_world(glows: bool) -> Builder {
    let mut builder = world(false);
    if glows {
        builder.json["materials"][0]["emissiveFactor"] = json!([1.0, 0.2, 0.2]);
        builder.json["materials"][0]["extensions"] =
            json!({ "KHR_materials_emissive_strength": { "emissiveStrength": 20.0 } });
    }
    let nodes = builder.json["nodes"].as_array().unwrap();
    let turning = nodes.iter().position(|node| node["translation"] == json!([3.0, 1.0, 0.0])).unwrap();
    blink(&mut builder, turning);
    builder
}

/// The world without a lamp, whose tube is seen at those times alone.
pub fn world_of_blinking_tube() -> Builder {
    let mut builder = world(false);
    let nodes = builder.json["nodes"].as_array().unwrap();
    let skinned = nodes.iter().position(|node| !node["skin"].is_null()).unwrap();
    blink(&mut builder, skinned);
    builder
}

/// Has a node seen from the beginning to 0.5 s, and again from 1.5 s on.
fn blink(builder: &mut Builder, node: usize) {
    const UNSIGNED_BYTE: u32 = 5121;
    let times = builder.floats(&[[0.0], [0.5], [1.5], [2.0]]);
    let seen = builder.accessor(&[1, 0, 1, 1], UNSIGNED_BYTE, "SCALAR", 4);
    animate(builder, node, "pointer", times, seen);
    let animation = &mut builder.json["animations"][0];
    let last = |list: &Value| list.as_array().unwrap().len() - 1;
    let (sampler, channel) = (last(&animation["samplers"]), last(&animation["channels"]));
    animation["samplers"][sampler]["interpolation"] = json!("STEP");
    let pointer = format!("/nodes/{node}/extensions/KHR_node_visibility/visible");
    animation["channels"][channel]["target"] =
        json!({ "path": "pointer", "extensions": { "KHR_animation_pointer": { "pointer": pointer } } });
}

/// Adds a channel to the first animation.
fn animate(builder: &mut Builder, node: usize, path: &str, input: usize, output: usize) {
    let animation = &mut builder.json["animations"][0];
    let samplers = animation["samplers"].as_array_mut().unwrap();
    samplers.push(json!({ "input": input, "output": output }));
    let sampler = samplers.len() - 1;
    let channel = json!({ "sampler": sampler, "target": { "node": node, "path": path } });
    animation["channels"].as_array_mut().unwrap().push(channel);
}

/// A horizontal square, `half` of it to each side.
fn quad(builder: &mut Builder, half: f32) -> Value {
    let at = |x: f32, z: f32| [x * half, 0.0, z * half];
    let positions = builder.floats(&[at(-1.0, -1.0), at(-1.0, 1.0), at(1.0, 1.0), at(1.0, -1.0)]);
    let indices = builder.shorts(&[0, 1, 2, 0, 2, 3]);
    json!({ "attributes": { "POSITION": positions }, "indices": indices })
}

/// A cube of 2 metres without normals.
fn cube(builder: &mut Builder) -> Value {
    let corner = |i: u16| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| f32::from(bit) * 2.0 - 1.0);
    let positions = builder.floats(&(0..8).map(corner).collect::<Vec<_>>());
    let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    let indices: Vec<u16> = sides.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect();
    let indices = builder.shorts(&indices);
    json!({ "attributes": { "POSITION": positions }, "indices": indices })
}

/// Balls of about a thousand triangles in a cube, each turning on the spot at a pace of its own.
pub fn balls(count: usize) -> Builder {
    const RINGS: usize = 20;
    const SIDES: usize = 26;
    let mut builder = Builder::new();
    let point = |ring: usize, side: usize| {
        let (polar, around) = (
            std::f32::consts::PI * ring as f32 / RINGS as f32,
            std::f32::consts::TAU * side as f32 / SIDES as f32,
        );
        [polar.sin() * around.cos(), 1.3 * polar.cos(), polar.sin() * around.sin()]
    };
    let points: Vec<[f32; 3]> =
        (0..=RINGS).flat_map(|ring| (0..SIDES).map(move |side| point(ring, side))).collect();
    let at = |ring: usize, side: usize| (ring * SIDES + side % SIDES) as u16;
    let indices: Vec<u16> = (0..RINGS)
        .flat_map(|ring| (0..SIDES).map(move |side| (ring, side)))
        .flat_map(|(r, s)| {
            [at(r, s), at(r, s + 1), at(r + 1, s), at(r, s + 1), at(r + 1, s + 1), at(r + 1, s)]
        })
        .collect();
    let (positions, indices) = (builder.floats(&points), builder.shorts(&indices));
    let attributes = json!({ "POSITION": positions, "NORMAL": positions });
    builder.push("meshes", json!({ "primitives": [{ "attributes": attributes, "indices": indices }] }));
    let turns: Vec<[f32; 4]> = (0..=3)
        .map(|step| DQuat::from_rotation_z(std::f64::consts::TAU * f64::from(step) / 3.0))
        .map(|turn| turn.to_array().map(|v| v as f32))
        .collect();
    let turns = builder.floats(&turns);
    let side = (count as f64).cbrt().ceil() as usize;
    let (mut samplers, mut channels) = (Vec::new(), Vec::new());
    for ball in 0..count {
        let place = [ball % side, ball / side % side, ball / side / side].map(|i| 3.0 * i as f32);
        let node = builder.push("nodes", json!({ "mesh": 0, "translation": place }));
        builder.show(node);
        let length = 1.0 + (ball % 7) as f32;
        let times = builder.floats(&[0.0, 1.0, 2.0, 3.0].map(|step: f32| [step * length / 3.0]));
        samplers.push(json!({ "input": times, "output": turns }));
        channels.push(json!({ "sampler": ball, "target": { "node": node, "path": "rotation" } }));
    }
    builder.json["animations"] = json!([{ "samplers": samplers, "channels": channels }]);
    builder
}
