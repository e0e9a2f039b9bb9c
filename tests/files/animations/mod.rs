//! Animations, skins and morph targets: where they put every vertex, and what is wrong with some.

mod oracle;
mod paint;
mod rigid;

use std::path::Path;

use base64::Engine;
use foveate::scene::animation::Choice;
use foveate::scene::{LoadOptions, Scene};
use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use crate::common::{
    self,
    builder::Builder,
    moving::{tube, world},
};

pub const TRIANGLE: [[f32; 3]; 3] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];

fn at(path: &Path, animation: &str, time: f64) -> foveate::Result<Scene> {
    Scene::load_with(path, &LoadOptions { animation: Choice::new(animation), time, ..LoadOptions::default() })
}

fn load_at(builder: &Builder, animation: &str, time: f64) -> foveate::Result<Scene> {
    let folder = tempfile::tempdir().unwrap();
    at(&builder.write_glb(folder.path()), animation, time)
}

fn corners(scene: &Scene) -> Vec<DVec3> {
    let world = |&i: &u32| scene.anchor + scene.mesh.positions[i as usize].as_dvec3();
    scene.mesh.triangles.iter().flatten().map(world).collect()
}

/// The first corner of the first triangle.
fn first(builder: &Builder, animation: &str, time: f64) -> DVec3 {
    corners(&load_at(builder, animation, time).unwrap())[0]
}

/// The farthest that a point of one list lies from the nearest of the other, both ways.
fn difference(a: &[DVec3], b: &[DVec3]) -> f64 {
    assert!(!a.is_empty() && a.len() == b.len(), "{} {}", a.len(), b.len());
    let one_way = |from: &[DVec3], to: &[DVec3]| {
        let mut sorted = to.to_vec();
        sorted.sort_by(|p, q| p.x.total_cmp(&q.x));
        let nearest = |p: &DVec3| {
            const REACH: f64 = 0.05;
            let start = sorted.partition_point(|q| q.x < p.x - REACH);
            let near = sorted[start..].iter().take_while(|q| q.x <= p.x + REACH);
            near.map(|q| q.distance(*p)).fold(f64::INFINITY, f64::min)
        };
        from.iter().map(nearest).fold(0.0, f64::max)
    };
    one_way(a, b).max(one_way(b, a))
}

/// Compares a file with what the gltf crate reads of it, at many times; all within 1e-5 of the scene's size.
fn check(path: &Path, times: &[f64]) {
    let file = gltf::Gltf::from_slice_without_validation(&std::fs::read(path).unwrap()).unwrap();
    let decode = |uri: &str| {
        let data = uri
            .split_once(";base64,")
            .map(|(_, data)| base64::engine::general_purpose::STANDARD.decode(data));
        data.unwrap_or_else(|| Ok(std::fs::read(path.with_file_name(uri)).unwrap())).unwrap()
    };
    let buffers: Vec<Vec<u8>> = file
        .buffers()
        .map(|buffer| match buffer.source() {
            gltf::buffer::Source::Bin => file.blob.clone().unwrap(),
            gltf::buffer::Source::Uri(uri) => decode(uri),
        })
        .collect();
    let mut moved = false;
    let mut before = Vec::new();
    for &time in times {
        let should = oracle::corners(&file, &buffers, time);
        let low = should.iter().copied().reduce(DVec3::min).unwrap();
        let size = (should.iter().copied().reduce(DVec3::max).unwrap() - low).length();
        let is = corners(&at(path, "all", time).unwrap());
        let off = difference(&is, &should);
        assert!(off < 1e-5 * size, "{} at {time} s: {off} of {size}", path.display());
        moved |= !before.is_empty() && difference(&before, &should) > 1e-3 * size;
        before = should;
    }
    assert!(moved, "{} stands still", path.display());
}

#[test]
fn a_sample_moves_as_the_gltf_crate_says() {
    let Some(truck) = common::data("scenes/khronos/CesiumMilkTruck/CesiumMilkTruck.glb") else { return };
    check(&truck, &[0.0, 0.3, 0.77, 1.1, 2.9, -0.4]);
    let told = Scene::load(&truck).unwrap().animations;
    assert_eq!((told.len(), told[0].name.as_str(), told[0].channels, told[0].plays), (1, "", 2, false));
    assert!((told[0].seconds - 1.25).abs() < 1e-4, "{told:?}");
}

#[test]
fn skins_and_morph_targets_move_as_the_gltf_crate_says() {
    let folder = tempfile::tempdir().unwrap();
    let path = tube().write_glb(folder.path());
    check(&path, &[0.0, 0.1, 0.25, 0.39, 0.4, 0.8, 1.3, 1.95, 2.0, 2.6, 7.9, -0.5]);
}

/// A scene that moves on shows at each time what the file shows that is loaded for it.
#[test]
fn what_moves_on_is_where_the_file_says() {
    let folder = tempfile::tempdir().unwrap();
    let mut builder = world(true);
    let light = builder.push("nodes", json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
    builder.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [{ "type": "spot" }] } });
    builder.json["nodes"][3]["children"].as_array_mut().unwrap().push(json!(light));
    let path = builder.write_glb(folder.path());
    let options =
        LoadOptions { animation: Choice::All, time: 0.2, keeps_motion: true, ..LoadOptions::default() };
    let mut scene = Scene::load_with(&path, &options).unwrap();
    let motion = scene.motion.clone().unwrap();
    // The floor stays.
    assert_eq!((motion.first_triangle(&scene.mesh), motion.parts.len(), motion.lights.len()), (2, 3, 1));
    let own = motion.own_triangles(&scene.mesh);
    for time in [0.2, 0.0, 0.9, 1.6, 2.0, 5.3] {
        motion.at(time, scene.anchor, &own).apply(&motion, &mut scene.mesh, &mut scene.lights);
        let still = at(&path, "all", time).unwrap();
        let (mesh, fresh) = (&scene.mesh, &still.mesh);
        let world =
            |scene: &Scene, corner: &u32| scene.anchor + scene.mesh.positions[*corner as usize].as_dvec3();
        assert!(difference(&corners(&scene), &corners(&still)) < 1e-5, "{time}");
        // Triangle by triangle, since surfaces that touch have several normals at a place.
        for (triangle, number) in fresh.triangles.iter().zip(0..) {
            let middle = triangle.iter().map(|corner| world(&still, corner)).sum::<DVec3>() / 3.0;
            let same = mesh.triangles.iter().find(|t| {
                (t.iter().map(|corner| world(&scene, corner)).sum::<DVec3>() / 3.0).distance(middle) < 1e-4
            });
            let same = same.unwrap_or_else(|| panic!("triangle {number} at {time}"));
            let normal = |mesh: &foveate::scene::Mesh, t: &[u32; 3]| -> glam::Vec3 {
                t.iter().map(|&corner| mesh.normals[corner as usize]).sum()
            };
            assert!(
                normal(mesh, same).distance(normal(fresh, triangle)) < 2e-3,
                "triangle {number} at {time}"
            );
        }
        assert!(
            scene.lights[0]
                .position
                .as_dvec3()
                .distance(still.lights[0].position.as_dvec3() + still.anchor - scene.anchor)
                < 1e-5
        );
        assert!(scene.lights[0].direction.distance(still.lights[0].direction) < 1e-5);
    }
}

/// A part of which something is not finite at an instant stays where it was.
#[test]
fn what_is_not_finite_stays() {
    let builder = moved(|b| {
        let (input, output) = (b.floats(&[[0.0], [1.0]]), b.floats(&[[1.0; 3], [3e38, 3e38, 3e38]]));
        b.json["animations"][0]["samplers"][0] = json!({ "input": input, "output": output });
        b.json["animations"][0]["channels"][0]["target"]["path"] = json!("scale");
        b.json["nodes"][0]["children"] = json!([1]);
        b.json["nodes"].as_array_mut().unwrap().push(json!({ "mesh": 0, "scale": [2, 2, 2] }));
    });
    let folder = tempfile::tempdir().unwrap();
    let options = LoadOptions { animation: Choice::All, keeps_motion: true, ..LoadOptions::default() };
    let mut scene = Scene::load_with(&builder.write_glb(folder.path()), &options).unwrap();
    let (motion, before) = (scene.motion.clone().unwrap(), scene.mesh.positions.clone());
    let own = motion.own_triangles(&scene.mesh);
    let instant = motion.at(1.0, scene.anchor, &own);
    assert_eq!(instant.parts.iter().filter(|part| part.is_none()).count(), 1);
    instant.apply(&motion, &mut scene.mesh, &mut scene.lights);
    assert!(scene.mesh.positions.iter().all(|p| p.is_finite()));
    assert_eq!(scene.mesh.positions[3..], before[3..]);
}

/// A triangle that an animation moves; `change` may spoil the document.
pub fn moved(change: impl FnOnce(&mut Builder)) -> Builder {
    let mut builder = Builder::new();
    let positions = builder.floats(&TRIANGLE);
    builder.place(json!({ "attributes": { "POSITION": positions } }), json!({}));
    let (times, values) = (builder.floats(&[[0.0], [2.0]]), builder.floats(&[[0.0; 3], [4.0, 0.0, 0.0]]));
    builder.json["animations"] = json!([{
        "name": "Slide",
        "samplers": [{ "input": times, "output": values }],
        "channels": [{ "sampler": 0, "target": { "node": 0, "path": "translation" } }],
    }]);
    change(&mut builder);
    builder
}

#[test]
fn the_rest_pose_is_shown_without_an_animation() {
    let builder = moved(|b| b.json["nodes"][0]["translation"] = json!([9, 0, 0]));
    assert_eq!(first(&builder, "none", 1.0).x, 9.0);
    assert_eq!(["auto", "all", "Slide", "0"].map(|name| first(&builder, name, 1.0).x), [2.0; 4]);
    assert_eq!([0.0, 2.0, 3.0].map(|time| first(&builder, "auto", time).x), [0.0, 4.0, 2.0]);
    let refusal = load_at(&builder, "Glide", 0.0).unwrap_err().to_string();
    assert!(refusal.contains("no animation \"Glide\"") && refusal.contains("\"Slide\""), "{refusal}");
}

/// What one warning says of a spoiled animation; all else is shown as it is.
fn warning(change: impl FnOnce(&mut Builder)) -> String {
    let scene = load_at(&moved(change), "all", 1.0).unwrap();
    assert_eq!(scene.mesh.triangles.len(), 1);
    assert!(scene.mesh.positions.iter().all(|p| p.is_finite()));
    assert_eq!(scene.warnings.len(), 1, "{:?}", scene.warnings);
    assert!(!scene.warnings[0].contains('\n'));
    scene.warnings[0].clone()
}

#[test]
fn what_is_wrong_with_an_animation_is_told_and_left_out() {
    let keys = |times: [f32; 2], x: f32| {
        move |b: &mut Builder| {
            let input = b.floats(&[[times[0]], [times[1]]]);
            let output = b.floats(&[[0.0; 3], [x, 0.0, 0.0]]);
            b.json["animations"][0]["samplers"][0] = json!({ "input": input, "output": output });
        }
    };
    let channel = |value: Value| move |b: &mut Builder| b.json["animations"][0]["channels"][0] = value;
    let sampler = |value: Value| move |b: &mut Builder| b.json["animations"][0]["samplers"][0] = value;
    let cases: [(&str, String); 12] = [
        ("not finite", warning(keys([0.0, f32::NAN], 1.0))),
        ("not finite", warning(keys([0.0, 1.0], f32::INFINITY))),
        ("not in the order", warning(keys([1.0, 0.5], 1.0))),
        (
            "node 7, which is not there",
            warning(channel(json!({ "sampler": 0, "target": { "node": 7, "path": "scale" } }))),
        ),
        ("no sampler 3", warning(channel(json!({ "sampler": 3, "target": { "node": 0, "path": "scale" } })))),
        ("is malformed", warning(channel(json!({ "sampler": "first" })))),
        ("moves \"pointer\"", warning(channel(json!({ "sampler": 0, "target": { "path": "pointer" } })))),
        (
            "weights of node 0, which has none",
            warning(channel(json!({ "sampler": 0, "target": { "node": 0, "path": "weights" } }))),
        ),
        ("accessor 99, which is not there", warning(sampler(json!({ "input": 99, "output": 1 })))),
        (
            "unknown interpolation \"SMOOTH\"",
            warning(sampler(json!({ "input": 1, "output": 2, "interpolation": "SMOOTH" }))),
        ),
        (
            "2 keys but 6 numbers",
            warning(sampler(json!({ "input": 1, "output": 2, "interpolation": "CUBICSPLINE" }))),
        ),
        (
            "which has a matrix",
            warning(|b| b.json["nodes"][0]["matrix"] = json!(DMat4::IDENTITY.to_cols_array())),
        ),
    ];
    for (part, is) in cases {
        assert!(is.contains("animation 0 \"Slide\"") && is.contains(part), "{part}: {is}");
    }
    let malformed = warning(|b| b.json["animations"][0] = json!(7));
    assert!(malformed.contains("animation 0 is malformed"), "{malformed}");
    // Without a node it is for an extension that is not there, and says nothing.
    let quiet = moved(channel(json!({ "sampler": 0, "target": { "path": "translation" } })));
    assert!(load_at(&quiet, "all", 1.0).unwrap().warnings.is_empty());
}

#[test]
fn animations_without_length_hold_their_one_pose() {
    let builder = moved(|b| {
        let (input, output) = (b.floats(&[[0.0]]), b.floats(&[[5.0, 0.0, 0.0]]));
        b.json["animations"][0]["samplers"][0] = json!({ "input": input, "output": output });
    });
    assert_eq!([0.0, 0.5, 9.0].map(|time| first(&builder, "auto", time).x), [5.0; 3]);
}

#[test]
fn a_million_keys_are_read_and_more_than_memory_holds_are_refused() {
    let many = |count: usize| {
        moved(|b| {
            // Accessors without data are zeros: a short file that claims much.
            let claim = |kind: &str| json!({ "componentType": 5126, "type": kind, "count": count });
            let (input, output) = (b.push("accessors", claim("SCALAR")), b.push("accessors", claim("VEC3")));
            b.json["animations"][0]["samplers"][0] = json!({ "input": input, "output": output });
        })
    };
    let scene = load_at(&many(1_000_000), "all", 0.0).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let folder = tempfile::tempdir().unwrap();
    let refusal = crate::load_within(&many(1 << 23).write_glb(folder.path()), 100_000_000);
    assert!(refusal.unwrap_err().to_string().contains("for buffers"));
}

#[test]
fn joints_without_size_and_skins_of_themselves_harm_nothing() {
    let mut flat = tube();
    let (input, output) = (flat.floats(&[[0.0]]), flat.floats(&[[0.0; 3]]));
    flat.json["animations"] = json!([{
        "samplers": [{ "input": input, "output": output }],
        "channels": [{ "sampler": 0, "target": { "node": 1, "path": "scale" } }],
    }]);
    let scene = load_at(&flat, "all", 0.0).unwrap();
    assert!(scene.mesh.triangles.is_empty() && scene.left_out.no_area > 0, "{:?}", scene.left_out);

    // A mesh may be its own joint, or hang on one: only its joints place it.
    let mut own = tube();
    own.json["skins"][0]["joints"][3] = json!(0);
    let scene = load_at(&own, "all", 1.0).unwrap();
    assert!(scene.mesh.positions.iter().all(|p| p.is_finite()) && !scene.mesh.triangles.is_empty());
    let mut circle = tube();
    circle.json["nodes"][8]["children"] = json!([1]);
    assert!(load_at(&circle, "all", 1.0).unwrap_err().to_string().contains("form a cycle"));
}

/// KHR_animation_pointer, as far as it is played: nodes and lights.
#[test]
fn pointers_move_nodes_and_change_lights() {
    let pointing = |pointer: &str, values: &[f32]| {
        moved(|b| {
            let output = match values.len() {
                2 => b.floats(&[[values[0]], [values[1]]]),
                _ => b.floats(&[[values[0], values[1], values[2]], [values[3], values[4], values[5]]]),
            };
            b.json["extensionsUsed"] = json!(["KHR_animation_pointer", "KHR_lights_punctual"]);
            b.json["extensionsRequired"] = json!(["KHR_animation_pointer"]);
            let light = json!({ "type": "point", "intensity": 2.0, "color": [1.0, 0.5, 0.0] });
            b.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
            let node = b.push("nodes", json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
            b.show(node);
            b.json["animations"][0]["samplers"][0]["output"] = json!(output);
            let extension = json!({ "KHR_animation_pointer": { "pointer": pointer } });
            b.json["animations"][0]["channels"][0]["target"] =
                json!({ "path": "pointer", "extensions": extension });
        })
    };
    let slides = pointing("/nodes/0/translation", &[0.0, 0.0, 0.0, 4.0, 0.0, 0.0]);
    assert_eq!(first(&slides, "all", 1.0).x, 2.0);

    // Dark at first: it is there all the same, and brightens.
    let path = "/extensions/KHR_lights_punctual/lights/0";
    let dimmed = pointing(&format!("{path}/intensity"), &[0.0, 8.0]);
    let lit = |time: f64| load_at(&dimmed, "all", time).unwrap().lights[0].intensity.to_array();
    assert_eq!([lit(0.0), lit(1.0)], [[0.0; 3], [4.0, 2.0, 0.0]]);
    let folder = tempfile::tempdir().unwrap();
    let options = LoadOptions { animation: Choice::All, keeps_motion: true, ..LoadOptions::default() };
    let mut scene = Scene::load_with(&dimmed.write_glb(folder.path()), &options).unwrap();
    let motion = scene.motion.clone().unwrap();
    motion.at(1.0, scene.anchor, &[]).apply(&motion, &mut scene.mesh, &mut scene.lights);
    assert_eq!(scene.lights[0].intensity.to_array(), [4.0, 2.0, 0.0]);
    let colored = pointing(&format!("{path}/color"), &[1.0, 0.5, 0.0, 0.0, 0.5, 1.0]);
    assert_eq!(load_at(&colored, "all", 1.0).unwrap().lights[0].intensity.to_array(), [1.0, 1.0, 1.0]);
    assert_eq!(load_at(&colored, "none", 1.0).unwrap().lights[0].intensity.to_array(), [2.0, 1.0, 0.0]);

    let elsewhere = load_at(&pointing("/materials/0/alphaCutoff", &[0.0; 2]), "all", 0.0).unwrap().warnings;
    assert!(
        elsewhere[0].contains("moves \"/materials/0/alphaCutoff\", which is not played"),
        "{elsewhere:?}"
    );
    let gone = load_at(&pointing("/extensions/KHR_lights_punctual/lights/7/color", &[0.0; 6]), "all", 0.0);
    assert!(gone.unwrap().warnings[0].contains("a light that is not there"));
}

/// KHR_node_visibility by pointer: a node, what is below it, and the light on it come and go.
#[test]
fn pointers_show_and_hide_nodes() {
    let blinks = |interpolation: &str| {
        moved(|b| {
            b.json["extensionsUsed"] =
                json!(["KHR_animation_pointer", "KHR_node_visibility", "KHR_lights_punctual"]);
            let light = json!({ "type": "point", "intensity": 2.0 });
            b.json["extensions"] = json!({ "KHR_lights_punctual": { "lights": [light] } });
            let lamp = b.push("nodes", json!({ "extensions": { "KHR_lights_punctual": { "light": 0 } } }));
            b.json["nodes"][0]["children"] = json!([lamp]);
            b.json["nodes"][0]["extensions"] = json!({ "KHR_node_visibility": { "visible": false } });
            const UNSIGNED_BYTE: u32 = 5121;
            let seen = b.accessor(&[1, 0, 1], UNSIGNED_BYTE, "SCALAR", 3);
            let times = b.floats(&[[0.0], [1.0], [2.0]]);
            b.json["animations"][0]["samplers"][0] =
                json!({ "input": times, "output": seen, "interpolation": interpolation });
            let pointer = "/nodes/0/extensions/KHR_node_visibility/visible";
            let extension = json!({ "KHR_animation_pointer": { "pointer": pointer } });
            b.json["animations"][0]["channels"][0]["target"] =
                json!({ "path": "pointer", "extensions": extension });
        })
    };
    let steps = blinks("STEP");
    let seen = |clip: &str, time: f64| {
        let scene = load_at(&steps, clip, time).unwrap();
        (scene.triangles() > 0, scene.lights.len())
    };
    assert_eq!([seen("all", 0.5), seen("all", 1.5), seen("none", 0.5)], [(true, 1), (false, 0), (false, 0)]);
    let folder = tempfile::tempdir().unwrap();
    let options = LoadOptions { animation: Choice::All, keeps_motion: true, ..LoadOptions::default() };
    let scene = Scene::load_with(&steps.write_glb(folder.path()), &options).unwrap();
    let motion = scene.motion.unwrap();
    let at = |time: f64| {
        let instant = motion.at(time, scene.anchor, &motion.own_triangles(&scene.mesh));
        let hidden = motion.hidden_triangles(&instant.pose).len();
        (hidden, instant.lights[0].unwrap().intensity.x)
    };
    assert_eq!((motion.parts.len(), at(0.5), at(1.5)), (1, (0, 2.0), (1, 0.0)));
    let told = load_at(&blinks("LINEAR"), "all", 0.0).unwrap().warnings;
    assert!(told[0].contains("shows and hides node 0 other than by steps"), "{told:?}");
}
