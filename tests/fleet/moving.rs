//! Scenes that move: each frame shows its instant, on every device the same.

use std::path::Path;

use foveate::bvh::WideBvh;
use foveate::config::{Config, DeformConfig, Indirect, Method, TraversalConfig};
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::Device;
use foveate::gpu::vulkan::Context;
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::scene::{Environment, Instancing};
use foveate::trace::{DeformedBy, MovingScene, SceneData, Traversal, deformed_bytes};
use glam::{DVec3, Vec3};

use crate::common::moving::{blinking_world, world, world_of_two};
use crate::{HEIGHT, WIDTH, are_the_same_on_two_devices, config, machine};

fn plan() -> Plan {
    let world_from_eye = Pose::look_at(DVec3::new(1.5, 5.0, 13.0), DVec3::new(1.5, 2.0, 0.0));
    let fov = FieldOfView::symmetric(60f64.to_radians(), f64::from(WIDTH) / f64::from(HEIGHT));
    Plan::mono(View { world_from_eye, fov, width: WIDTH, height: HEIGHT, spacing: Default::default() })
}

fn settings(time: f64) -> Config {
    let mut config = config(Method::Guided).without_reuse();
    (config.scene.animation, config.scene.time) = ("all".into(), time);
    config.environment.sun_elevation = 50.0;
    config
}

/// The picture as floats, and the depth of each pixel.
fn seen(renderer: &mut Renderer) -> (Vec<f32>, Vec<f32>) {
    renderer.frame(&plan(), &[], 3).unwrap();
    (bytemuck::cast_slice(&renderer.picture().unwrap()).to_vec(), renderer.depths(0))
}

/// The share of values that differ by more than a thousandth.
fn differing(a: &[f32], b: &[f32]) -> f64 {
    assert!(!a.is_empty() && a.len() == b.len());
    let differ = a.iter().zip(b).filter(|(a, b)| (*a - *b).abs() > 1e-3 * a.abs().max(b.abs()).max(0.01));
    differ.count() as f64 / a.len() as f64
}

fn mean(picture: &[f32]) -> f64 {
    picture.iter().map(|&v| f64::from(v)).sum::<f64>() / picture.len() as f64
}

fn moving(path: &Path, device: &Device, context: &Context, config: &Config) -> Renderer {
    let loaded = Loaded::moving_from_file(path, config).unwrap();
    assert!(loaded.scene.motion.is_some() && loaded.parted.is_some());
    Renderer::new(device, context, &loaded, config, Output::Radiance).unwrap().0
}

fn still(path: &Path, device: &Device, context: &Context, config: &Config) -> Renderer {
    let loaded = Loaded::from_file(path, config).unwrap();
    assert!(loaded.scene.motion.is_none() && loaded.parted.is_none());
    Renderer::new(device, context, &loaded, config, Output::Radiance).unwrap().0
}

#[test]
fn a_frame_shows_what_a_fresh_picture_of_its_instant_shows() {
    shows_its_instants(Instancing::Flat, DeformConfig::Host);
}

/// What moves as a whole, kept as a shape and placed by matrices.
#[test]
fn a_frame_of_moving_instances_shows_what_a_fresh_picture_shows() {
    shows_its_instants(Instancing::Shared, DeformConfig::Host);
}

/// What is skinned and morphed, deformed by the device, beside what the host moves.
#[test]
fn a_frame_that_its_device_deforms_shows_what_a_fresh_picture_shows() {
    shows_its_instants(Instancing::Shared, DeformConfig::Device);
}

fn shows_its_instants(instancing: Instancing, deform: DeformConfig) {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = world_of_two(false).write_glb(folder.path());
    // What a cache has kept of earlier frames is meant to differ.
    let settings = |time| {
        let mut config = settings(time);
        (config.trace.indirect, config.scene.instancing) = (Indirect::Paths, instancing);
        config.trace.deform = deform;
        config
    };
    let scene = Loaded::moving_from_file(&path, &settings(0.3)).unwrap().scene;
    let motion = scene.motion.unwrap();
    let instances = if instancing == Instancing::Shared { 2 } else { 0 };
    assert_eq!((motion.parts.len(), motion.rigid.len()), (3 - instances, instances));
    let mut renderer = moving(&path, &device, &context, &settings(0.3));
    let mut before: Vec<f32> = Vec::new();
    // Times since the beginning, which was at 0.3 s.
    for time in [0.0, 0.6, 1.45, 4.0] {
        renderer.show_at(time);
        let (picture, depths) = seen(&mut renderer);
        let (truth, right) = seen(&mut still(&path, &device, &context, &settings(0.3 + time)));
        assert!(depths.iter().filter(|&&d| d > 0.0).count() > depths.len() / 3);
        let off = [differing(&depths, &right), differing(&picture, &truth)];
        assert!(off[0] < 2e-3 && off[1] < 1e-2, "{time}: {off:?}");
        assert!(before.is_empty() || differing(&before, &depths) > 0.01, "nothing has moved");
        before = depths;
    }
}

/// A node that clips hide is in no picture, and throws no shadow, until they show it again.
#[test]
fn what_is_hidden_leaves_no_trace_and_comes_back() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = blinking_world(false).write_glb(folder.path());
    for instancing in [Instancing::Flat, Instancing::Shared] {
        // It is hidden as the scene is loaded.
        let settings = |time| {
            let mut config = settings(time);
            (config.trace.indirect, config.scene.instancing) = (Indirect::Paths, instancing);
            config
        };
        let mut renderer = moving(&path, &device, &context, &settings(0.6));
        let mut seen_so_far = Vec::new();
        for time in [0.0, 1.0, 2.2] {
            renderer.show_at(time);
            let (picture, depths) = seen(&mut renderer);
            let (truth, right) = seen(&mut still(&path, &device, &context, &settings(0.6 + time)));
            let off = [differing(&depths, &right), differing(&picture, &truth)];
            assert!(off[0] < 2e-3 && off[1] < 1e-2, "{instancing:?} {time}: {off:?}");
            // The box alone is red.
            let red = picture.chunks(4).filter(|pixel| pixel[0] > 1.5 * pixel[2]).count();
            seen_so_far.push(red > 100);
        }
        assert_eq!(seen_so_far, [false, true, false], "{instancing:?}");
    }
}

/// Nor does it shed light meanwhile.
#[test]
fn what_is_hidden_sheds_no_light() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = blinking_world(true).write_glb(folder.path());
    let settings = |time| {
        let mut config = settings(time);
        config.trace.indirect = Indirect::Paths;
        config.trace.rays = 64;
        config
    };
    let mut renderer = moving(&path, &device, &context, &settings(0.0));
    let means = [0.2, 0.9].map(|time| {
        renderer.show_at(time);
        let truth = seen(&mut still(&path, &device, &context, &settings(time))).0;
        [mean(&seen(&mut renderer).0), mean(&truth)]
    });
    assert!(means.iter().all(|[own, truth]| (own / truth - 1.0).abs() < 0.02), "{means:?}");
    assert!(means[0][0] > 1.15 * means[1][0], "it does not glow: {means:?}");
}

/// What a device deforms looks as it does where the host deforms it, frame after frame.
#[test]
fn frames_are_those_of_the_host_where_the_device_deforms() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = world_of_two(false).write_glb(folder.path());
    let mut renderers = [DeformConfig::Host, DeformConfig::Device].map(|deform| {
        let mut config = settings(0.0);
        (config.trace.indirect, config.trace.deform) = (Indirect::Paths, deform);
        moving(&path, &device, &context, &config)
    });
    for frame in 0..12 {
        let [(picture, depths), (own, reached)] = renderers.each_mut().map(|renderer| {
            renderer.show_at(f64::from(frame) * 0.15);
            seen(renderer)
        });
        let off = [differing(&depths, &reached), differing(&picture, &own)];
        assert!(off[0] < 2e-4 && off[1] < 2e-3, "frame {frame}: {off:?}");
        // Roundings tell who has done it.
        assert!(frame == 0 || picture != own, "frame {frame} is the host's to the bit");
    }
}

/// A device that has room for a scene, but not for deforming it, is refused where it would have to.
#[test]
fn devices_without_room_to_deform_are_refused() {
    let Some((mut info, context)) = machine() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = world(false).write_glb(folder.path());
    let mut config = settings(0.0);
    config.trace.traversal = TraversalConfig::Packet;
    let mut loaded = Loaded::moving_from_file(&path, &config).unwrap();
    // Maps give way where room is little.
    loaded.environment = Environment::constant(Vec3::ONE);
    let own = SceneData::pack(&loaded.scene, loaded.trees(), &loaded.environment).unwrap();
    let needed = own.bytes(Traversal::Packet.into()).into_iter();
    let needed = needed.chain(deformed_bytes(&loaded.scene, loaded.parted.as_ref().unwrap()));
    info.memory = needed.map(|buffer| buffer.bytes as u64).sum::<u64>() - 1;
    let device = Device::open(&info).unwrap();
    let mut opened = |deform| {
        config.trace.deform = deform;
        Renderer::new(&device, &context, &loaded, &config, Output::Radiance)
    };
    assert!(opened(DeformConfig::Host).is_ok());
    let refused = opened(DeformConfig::Device).err().unwrap().to_string();
    assert!(refused.contains("the scene needs") && refused.contains("leave this device out"), "{refused}");
}

#[test]
fn lamps_that_move_light_what_they_come_to() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = world(true).write_glb(folder.path());
    let mut renderer = moving(&path, &device, &context, &settings(0.3));
    for time in [0.0, 1.5] {
        renderer.show_at(time);
        renderer.light_ahead(96);
        let (picture, _) = seen(&mut renderer);
        let mut fresh = still(&path, &device, &context, &settings(0.3 + time));
        fresh.light_ahead(96);
        let (truth, _) = seen(&mut fresh);
        // Random numbers meet other emitters where trees differ: noise differs, light does not.
        let halves = [0..picture.len() / 2, picture.len() / 2..picture.len()];
        for half in halves {
            let (is, should) = (mean(&picture[half.clone()]), mean(&truth[half]));
            assert!((is / should - 1.0).abs() < 0.03, "{time}: {is} {should}");
        }
    }
}

#[test]
fn pictures_of_what_moves_do_not_depend_on_how_they_are_split() {
    is_the_same_on_two_devices(Instancing::Flat, DeformConfig::Host);
    is_the_same_on_two_devices(Instancing::Shared, DeformConfig::Host);
}

#[test]
fn devices_that_deform_keep_the_same_world() {
    is_the_same_on_two_devices(Instancing::Flat, DeformConfig::Device);
}

fn is_the_same_on_two_devices(instancing: Instancing, deform: DeformConfig) {
    let folder = tempfile::tempdir().unwrap();
    let path = world_of_two(true).write_glb(folder.path());
    let mut config = settings(0.0);
    (config.time.reuse, config.scene.instancing) = (true, instancing);
    config.trace.deform = deform;
    let loaded = Loaded::moving_from_file(&path, &config).unwrap();
    let show = |renderer: &mut Renderer, frame| renderer.show_at(f64::from(frame) * 0.2);
    are_the_same_on_two_devices(&loaded, &config, &plan(), show);
}

/// New trees are taken while frames go on, and show what the old ones did.
#[test]
fn parts_whose_trees_are_built_anew_stay_where_they_are() {
    let both = [(DeformConfig::Host, DeformedBy::Host), (DeformConfig::Device, DeformedBy::Devices)];
    both.into_iter().for_each(stay_where_they_are);
}

fn stay_where_they_are((deform, by): (DeformConfig, DeformedBy)) {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let path = world(true).write_glb(folder.path());
    let mut config = settings(0.3);
    (config.trace.indirect, config.trace.deform) = (Indirect::Paths, deform);
    let loaded = Loaded::moving_from_file(&path, &config).unwrap();
    let parted = loaded.parted.as_ref().unwrap();
    let mut scene = MovingScene::new(&loaded.scene, loaded.trees(), parted, by).unwrap();
    let mut renderer = Renderer::new(&device, &context, &loaded, &config, Output::Radiance).unwrap().0;
    assert!(!scene.is_rebuilt());
    for step in 0..130 {
        let time = f64::from(step) * 0.01;
        scene.at(0.3 + time);
        renderer.show_at(time);
    }
    assert!(scene.is_rebuilt());
    let (_, depths) = seen(&mut renderer);
    let (_, right) = seen(&mut still(&path, &device, &context, &settings(0.3 + 1.29)));
    assert!(differing(&depths, &right) < 2e-3, "{}", differing(&depths, &right));
}

#[test]
fn trees_of_a_moving_scene_are_sound() {
    let folder = tempfile::tempdir().unwrap();
    let path = world(true).write_glb(folder.path());
    let loaded = Loaded::moving_from_file(&path, &settings(0.0)).unwrap();
    let mesh = &loaded.scene.mesh;
    loaded.bvh.validate(&mesh.positions, &mesh.triangles).unwrap();
    let fresh = WideBvh::build(&mesh.positions, &mesh.triangles);
    assert!(loaded.bvh.cost().sum() < 1.6 * fresh.cost().sum() + 2.0);
}

/// Light that is reused over time does not lag behind what moves: with as many rays frames are no farther from the truth
/// with it than without, where things move and where they stay under light that moves.
#[test]
fn reuse_over_time_does_no_harm_to_what_moves() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    for instancing in [Instancing::Flat, Instancing::Shared] {
        let [_, moved, stayed, _] =
            errors_with_reuse(&device, &context, instancing, |config| config, (true, 1.0 / 30.0));
        assert!(moved <= 1.02 && stayed <= 1.02, "{instancing:?}: {moved} {stayed}");
    }
}

/// And it goes with what moves as a whole, and with a skin that bends, by both variants of the kernels.
#[test]
fn light_goes_with_what_moves_as_a_whole() {
    let Some((info, context)) = machine() else { return };
    let device = Device::open(&info).unwrap();
    for instancing in [Instancing::Flat, Instancing::Shared] {
        for traversal in [TraversalConfig::Packet, TraversalConfig::SingleRay] {
            let by = |mut config: Config| {
                config.trace.traversal = traversal;
                config
            };
            let [boxes, _, _, skin] =
                errors_with_reuse(&device, &context, instancing, by, (false, 1.0 / 150.0));
            assert!(boxes < 0.5, "{instancing:?} {traversal:?}: {boxes}");
            assert!(skin < 0.5, "{instancing:?} {traversal:?}: {skin}");
        }
    }
}

/// Of the last of a dozen frames so many seconds apart, with and without a lamp that moves: the squared error with reuse
/// over that without, where the boxes are, which move as a whole, where anything moves, where it stays,
/// and where what moves is no box: a skin.
fn errors_with_reuse(
    device: &Device,
    context: &Context,
    instancing: Instancing,
    with: impl Fn(Config) -> Config,
    (has_lamp, period): (bool, f64),
) -> [f64; 4] {
    let folder = tempfile::tempdir().unwrap();
    let path = world_of_two(has_lamp).write_glb(folder.path());
    const FRAMES: u32 = 12;
    let end = f64::from(FRAMES - 1) * period;
    let settings = |time: f64, reuse: bool, rays: u32| {
        let mut config = with(settings(time));
        (config.trace.indirect, config.time.reuse, config.trace.rays) = (Indirect::Paths, reuse, rays);
        (config.time.rays, config.scene.instancing) = (1.0, instancing);
        // Of light alone: pictures with one ray for each pixel have other edges than means over several.
        config.time.pictures = 1;
        config
    };
    let last = |reuse: bool| {
        let mut renderer = moving(&path, device, context, &settings(0.3, reuse, 8));
        for frame in 0..FRAMES {
            renderer.show_at(f64::from(frame) * period);
            renderer.frame(&plan(), &[], frame).unwrap();
        }
        let picture: Vec<f32> = bytemuck::cast_slice(&renderer.picture().unwrap()).to_vec();
        (picture, renderer.depths(0))
    };
    let (reused, depths) = last(true);
    let (single, _) = last(false);
    let (truth, _) = seen(&mut still(&path, device, context, &settings(0.3 + end, false, 1024)));
    let (_, before) = seen(&mut still(&path, device, context, &settings(0.3 + end - period, false, 8)));
    let moved: Vec<bool> =
        depths.iter().zip(&before).map(|(a, b)| (a - b).abs() > 1e-4 * a.abs().max(b.abs())).collect();
    assert!(moved.iter().filter(|&&moved| moved).count() > 300);
    // The boxes are red.
    let boxes: Vec<bool> =
        truth.chunks(4).zip(&moved).map(|(pixel, moved)| *moved && pixel[0] > 1.5 * pixel[2]).collect();
    assert!(boxes.iter().filter(|&&is_box| is_box).count() > 200);
    let stayed: Vec<bool> = moved.iter().map(|moved| !moved).collect();
    let skin: Vec<bool> = moved.iter().zip(&boxes).map(|(moved, is_box)| *moved && !is_box).collect();
    [boxes, moved, stayed, skin].map(|places| {
        let error = |picture: &[f32]| {
            let tone = |v: f32| f64::from(v / (1.0 + v));
            let pixel = |i: usize| {
                (0..3).map(|c| (tone(picture[4 * i + c]) - tone(truth[4 * i + c])).powi(2)).sum::<f64>()
            };
            (0..places.len()).filter(|&i| places[i]).map(pixel).sum::<f64>()
        };
        error(&reused) / error(&single)
    })
}
