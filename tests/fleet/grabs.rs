//! Things that hands have put elsewhere: as if they had always been there.

use std::path::{Path, PathBuf};

use foveate::config::{Config, Method};
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::Device;
use foveate::scene::Instancing;
use foveate::scene::grab::Grab;
use glam::{DMat4, DVec3};
use serde_json::{Value, json};

use crate::common::builder::Builder;
use crate::worn::{settings, view};
use crate::{are_the_same_on_two_devices, config, machine};

/// Where the thing is in its file, and where it is put.
const FILED: DVec3 = DVec3::new(-0.4, 0.3, 0.0);
const PUT: DVec3 = DVec3::new(0.3, 0.5, 0.1);

/// A floor, a mirror that stands on it, and a red cube that hangs on a node with these extras.
fn room(folder: &Path, place: DVec3, extras: Value) -> PathBuf {
    let mut builder = Builder::new();
    let color = |[r, g, b]: [f64; 3], metallic: f64, roughness: f64| {
        json!({ "doubleSided": true, "pbrMetallicRoughness": {
            "baseColorFactor": [r, g, b, 1.0], "metallicFactor": metallic, "roughnessFactor": roughness } })
    };
    let square = builder.floats(&[[-1.0, 0.0, -1.0], [-1.0, 0.0, 1.0], [1.0, 0.0, 1.0], [1.0, 0.0, -1.0]]);
    let indices = builder.shorts(&[0, 1, 2, 0, 2, 3]);
    let half = 0.5f64.sqrt();
    for (finish, node) in [
        (color([0.8; 3], 0.0, 1.0), json!({ "scale": [9, 1, 9] })),
        (color([0.9; 3], 1.0, 0.02), json!({ "translation": [0, 0, -0.8], "rotation": [half, 0, 0, half] })),
    ] {
        let material = builder.push("materials", finish);
        let attributes = json!({ "POSITION": square });
        builder.place(json!({ "attributes": attributes, "indices": indices, "material": material }), node);
    }
    let corners: Vec<[f32; 3]> =
        (0..8).map(|i| [0, 1, 2].map(|axis| if i >> axis & 1 == 1 { 0.12 } else { -0.12 })).collect();
    let sides = [0, 2, 3, 0, 3, 1, 4, 5, 7, 4, 7, 6, 0, 1, 5, 0, 5, 4, 2, 6, 7, 2, 7, 3, 0, 4, 6, 0, 6, 2];
    let sides = [&sides[..], &[1, 3, 7, 1, 7, 5]].concat();
    let (positions, indices) = (builder.floats(&corners), builder.shorts(&sides));
    let material = builder.push("materials", color([0.8, 0.1, 0.1], 0.0, 0.9));
    let attributes = json!({ "POSITION": positions });
    let primitive = json!({ "attributes": attributes, "indices": indices, "material": material });
    let mesh = builder.push("meshes", json!({ "primitives": [primitive] }));
    let child = builder.push("nodes", json!({ "mesh": mesh }));
    let thing = json!({ "translation": place.to_array(), "children": [child], "extras": extras });
    let thing = builder.push("nodes", thing);
    builder.show(thing);
    builder.write_glb(folder)
}

fn worn(folder: &Path, place: DVec3, config: &Config) -> Loaded {
    Loaded::worn_from_file(&room(folder, place, json!({ "grab": true })), config).unwrap()
}

fn seen(renderer: &mut Renderer, put: &[Option<DMat4>]) -> Vec<f32> {
    renderer.put(put);
    renderer.show_at(0.0);
    renderer.frame(&Plan::mono(view()), &[], 3).unwrap();
    bytemuck::cast_slice(&renderer.picture().unwrap()).to_vec()
}

/// The share of values that differ by more than a fiftieth.
fn differing(a: &[f32], b: &[f32]) -> f64 {
    assert!(!a.is_empty() && a.len() == b.len());
    let differ = a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 0.02 * a.abs().max(b.abs()).max(0.01));
    differ.count() as f64 / a.len() as f64
}

#[test]
fn what_is_put_elsewhere_is_lit_mirrored_and_in_the_shadow_as_if_it_had_been_there() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for instancing in [Instancing::Flat, Instancing::Shared] {
        let mut config = settings();
        config.scene.instancing = instancing;
        let renderer = |place| {
            let loaded = worn(folder.path(), place, &config);
            let motion = loaded.scene.motion.as_ref().unwrap();
            assert_eq!((motion.grabbable.len(), motion.grabbable[0].boxes.len()), (1, 1));
            assert_eq!(motion.rigid.len(), usize::from(instancing == Instancing::Shared));
            Renderer::new(&device, &context, &loaded, &config, Output::Radiance).unwrap().0
        };
        let (mut filed, mut there) = (renderer(FILED), renderer(PUT));
        let (before, truth) = (seen(&mut filed, &[None]), seen(&mut there, &[None]));
        let moved = differing(&before, &truth);
        assert!(moved > 0.03, "{moved}");
        let put = seen(&mut filed, &[Some(DMat4::from_translation(PUT))]);
        assert!(differing(&put, &truth) < 0.1 * moved, "{}, {moved}", differing(&put, &truth));
        // A place that is none leaves it where it was.
        let lost = seen(&mut filed, &[Some(DMat4::from_translation(DVec3::NAN))]);
        assert!(differing(&lost, &put) < 0.1 * moved);
    }
}

#[test]
fn pictures_of_what_hands_carry_do_not_depend_on_how_they_are_split() {
    let folder = tempfile::tempdir().unwrap();
    let config = config(Method::Guided);
    let loaded = worn(folder.path(), FILED, &config);
    let show = |renderer: &mut Renderer, frame: u32| {
        let place = FILED + DVec3::X * (0.1 * f64::from(frame));
        renderer.put(&[(frame > 0).then_some(DMat4::from_translation(place))]);
        renderer.show_at(f64::from(frame) * 0.01);
    };
    are_the_same_on_two_devices(&loaded, &config, &Plan::mono(view()), show);
}

#[test]
fn only_marked_nodes_move_and_only_where_there_are_hands() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = Config::default();
    config.headset.show_hands = false;
    let things = |extras: Value, config: &Config| {
        let loaded = Loaded::worn_from_file(&room(folder.path(), FILED, extras), config).unwrap();
        loaded.scene.motion.as_ref().map_or(0, |motion| motion.grabbable.len())
    };
    assert_eq!(things(json!({ "grab": true }), &config), 1);
    for other in [json!({ "grab": false }), json!({ "grab": "yes" }), json!({}), json!(3), json!(null)] {
        assert_eq!(things(other, &config), 0);
    }
    let marked = room(folder.path(), FILED, json!({ "grab": true, "more": [1] }));
    assert!(Loaded::moving_from_file(&marked, &config).unwrap().scene.motion.is_none());
    config.headset.grab = Grab::None;
    assert!(Loaded::worn_from_file(&marked, &config).unwrap().scene.motion.is_none());
}
