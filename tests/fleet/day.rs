//! A sun that moves: each frame shows its own time of the day, on every device the same.

use std::path::Path;

use foveate::config::{Config, Indirect, Method};
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::Device;
use foveate::gpu::vulkan::Context;
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::scene::sky::Sky;
use foveate::scene::sky::day::DayCycle;
use glam::DVec3;
use serde_json::{Value, json};

use crate::common::builder::Builder;
use crate::{HEIGHT, WIDTH, are_the_same_on_two_devices, config, machine};

/// Seconds of a day.
const DAY: f64 = 60.0;
/// Height of a thin plate's upper edge, which throws a shadow.
const POLE: f64 = 1.0;
/// Half of what is seen of the ground from above, in metres.
const SEEN: f64 = 4.0;

/// A white floor with a pole on it, and a mirror far away.
fn world() -> Builder {
    let mut builder = Builder::new();
    let square = |builder: &mut Builder, half: [f32; 3]| -> Value {
        let corner = |i: u16| [i & 1, i >> 1 & 1, i >> 2 & 1].map(|bit| f32::from(bit) * 2.0 - 1.0);
        let corners: Vec<[f32; 3]> =
            (0..8).map(corner).map(|c| [c[0] * half[0], c[1] * half[1], c[2] * half[2]]).collect();
        let positions = builder.floats(&corners);
        let sides = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        let indices: Vec<u16> = sides.iter().flat_map(|[a, b, c, d]| [*a, *b, *c, *a, *c, *d]).collect();
        let indices = builder.shorts(&indices);
        json!({ "attributes": { "POSITION": positions }, "indices": indices })
    };
    builder.push(
        "materials",
        json!({ "pbrMetallicRoughness": { "baseColorFactor": [0.8, 0.8, 0.8, 1.0], "metallicFactor": 0.0 } }),
    );
    builder.push("materials", json!({ "pbrMetallicRoughness": { "roughnessFactor": 0.2 } }));
    let shapes = [
        ([20.0, 0.5, 20.0], 0, [0.0, -0.5, 0.0]),
        ([0.1, 0.5, 0.1], 0, [0.0, 0.5, 0.0]),
        ([0.4, 0.4, 0.4], 1, [-3.0, 0.4, -3.0]),
    ];
    for (half, material, place) in shapes {
        let mut shape = square(&mut builder, half);
        shape["material"] = json!(material);
        builder.place(shape, json!({ "translation": place }));
    }
    builder
}

/// From above: +X is to the right, +Z down.
fn plan() -> Plan {
    let eye = DVec3::new(0.0, 40.0, 0.2);
    let fov = FieldOfView::symmetric(2.0 * (SEEN / 40.0).atan(), f64::from(WIDTH) / f64::from(HEIGHT));
    let world_from_eye = Pose::look_at(eye, DVec3::ZERO);
    Plan::mono(View { world_from_eye, fov, width: WIDTH, height: HEIGHT, spacing: Default::default() })
}

fn settings(time: f64) -> Config {
    let mut config = config(Method::Guided).without_reuse();
    (config.trace.indirect, config.scene.time) = (Indirect::Paths, time);
    config.environment.day_length = DAY;
    config
}

fn renderer(path: &Path, device: &Device, context: &Context, config: &Config, moves: bool) -> Renderer {
    let load = if moves { Loaded::moving_from_file } else { Loaded::from_file };
    let loaded = load(path, config).unwrap();
    assert!(loaded.day.is_some() == moves && loaded.environment.sun.is_some());
    Renderer::new(device, context, &loaded, config, Output::Radiance).unwrap().0
}

fn seen(renderer: &mut Renderer) -> Vec<f32> {
    renderer.frame(&plan(), &[], 3).unwrap();
    bytemuck::cast_slice(&renderer.picture().unwrap()).to_vec()
}

/// What is seen at a place of the ground: green.
fn at(picture: &[f32], x: f64, z: f64) -> f32 {
    let scale = f64::from(HEIGHT) / 2.0 / SEEN;
    let (column, row) = (f64::from(WIDTH) / 2.0 + x * scale, f64::from(HEIGHT) / 2.0 + z * scale);
    picture[(row as usize * WIDTH as usize + column as usize) * 4 + 1]
}

#[test]
fn shadows_go_where_the_sun_goes() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = world().write_glb(folder.path());
    let mut renderer = renderer(&path, &device, &context, &settings(2.0), true);
    let cycle = DayCycle { sky: Sky::default(), seconds: DAY, scale: 1.0 };
    // Times since the beginning, which was at 2 s; suns of some height.
    for time in [0.0, 6.0, 8.5, 52.0, 57.0] {
        renderer.show_at(time);
        let picture = seen(&mut renderer);
        let sun = cycle.at(2.0 + time).sun_direction();
        assert!(sun.y > 0.3, "{time}");
        // The middle of the shadow, and the same place on the other side and a quarter round.
        let tip = -sun / sun.y * POLE;
        let place = |turn: f64, share: f64| {
            let (sin, cos) = turn.to_radians().sin_cos();
            at(&picture, (tip.x * cos - tip.z * sin) * share, (tip.x * sin + tip.z * cos) * share)
        };
        let (dark, lit) = (place(0.0, 0.6), [60.0, 120.0, 180.0, 240.0, 300.0].map(|turn| place(turn, 0.6)));
        assert!(lit.iter().all(|&light| dark < 0.6 * light), "{time}: {dark} {lit:?}");
        // It ends where the sun's height says: half a radius of the pole beside its end it is light again.
        let (before, behind) = (place(0.0, 0.85), place(0.0, 1.0 + 0.25 / tip.length()));
        assert!(before < 0.7 * behind, "{time}: {before} {behind}");
    }
}

#[test]
fn frames_of_a_day_are_pictures_of_their_time() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = world().write_glb(folder.path());
    let mut moving = renderer(&path, &device, &context, &settings(0.0), true);
    for time in [0.0, 11.0, 16.5, 30.0, 51.0] {
        moving.show_at(time);
        let picture = seen(&mut moving);
        let loaded = Loaded::from_file(&path, &settings(time)).unwrap();
        let mut still =
            Renderer::new(&device, &context, &loaded, &settings(time), Output::Radiance).unwrap().0;
        let truth = seen(&mut still);
        assert!(picture.iter().all(|value| value.is_finite()));
        let mean =
            |picture: &[f32]| picture.iter().map(|&v| f64::from(v)).sum::<f64>() / picture.len() as f64;
        let off: f64 = picture.iter().zip(&truth).map(|(a, b)| f64::from((a - b).abs())).sum();
        let off = off / picture.len() as f64 / mean(&truth);
        // Directions are drawn from another table: noise differs, light and shadows do not.
        assert!(
            (mean(&picture) / mean(&truth) - 1.0).abs() < 0.03 && off < 0.08,
            "{time}: {off} {} {}",
            mean(&picture),
            mean(&truth)
        );
    }
}

#[test]
fn pictures_of_a_day_do_not_depend_on_how_they_are_split() {
    let folder = tempfile::tempdir().unwrap();
    let path = world().write_glb(folder.path());
    let mut config = settings(10.0);
    (config.time.reuse, config.trace.indirect) = (true, Indirect::Cache);
    let loaded = Loaded::moving_from_file(&path, &config).unwrap();
    let show = |renderer: &mut Renderer, frame| renderer.show_at(f64::from(frame) * 0.7);
    are_the_same_on_two_devices(&loaded, &config, &plan(), show);
}

/// Light that is reused and cached follows the sun: pictures are as bright as fresh ones.
#[test]
fn light_that_was_found_is_forgotten_as_the_sun_goes() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = world().write_glb(folder.path());
    let mut config = settings(15.0);
    (config.time.reuse, config.trace.indirect) = (true, Indirect::Cache);
    let mut moving = renderer(&path, &device, &context, &config, true);
    let last = 24u32;
    let mut picture = Vec::new();
    for frame in 0..=last {
        moving.show_at(f64::from(frame) * 0.1);
        moving.frame(&plan(), &[], frame).unwrap();
        picture = bytemuck::cast_slice::<u8, f32>(&moving.picture().unwrap()).to_vec();
    }
    config.scene.time = 15.0 + f64::from(last) * 0.1;
    let mut still = renderer(&path, &device, &context, &config, true);
    still.light_ahead(96);
    still.frame(&plan(), &[], 3).unwrap();
    let truth = bytemuck::cast_slice::<u8, f32>(&still.picture().unwrap()).to_vec();
    let mean = |picture: &[f32]| picture.iter().skip(1).step_by(4).map(|&v| f64::from(v)).sum::<f64>();
    assert!((mean(&picture) / mean(&truth) - 1.0).abs() < 0.06, "{} {}", mean(&picture), mean(&truth));
}
