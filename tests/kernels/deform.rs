//! Moving parts that devices deform, beside those that the host deforms in `f64`: the same places within roundings of
//! `f32`, and trees that hold what is there to the last bit.

use std::sync::Arc;

use foveate::bvh::compact::compact_nodes;
use foveate::bvh::wide::{EMPTY, LEAF, leaf_range};
use foveate::config::Config;
use foveate::frame::Loaded;
use foveate::gpu::opencl::Device;
use foveate::layout::{WideNode, unpack_normal};
use foveate::scene::Features;
use foveate::trace::{
    DeformedBy, MovingScene, SceneContents, SceneData, Tracer, Traversal, Traversals, deformed_bytes,
};
use glam::{Vec3, Vec4};

use crate::bench::on_every_device;
use crate::common::builder::Builder;
use crate::common::moving::{flattening_tube, world_of_two};

const TIMES: [f64; 5] = [0.0, 0.37, 1.2, 1.69, 7.7];

fn load(world: Builder) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    let mut config = Config::default();
    config.scene.animation = "all".into();
    Loaded::moving_from_file(&world.write_glb(folder.path()), &config).unwrap()
}

/// Gives what is skinned tangents, which morph targets bend, and a material for which kernels read them.
fn with_tangents(loaded: &mut Loaded) {
    let scene = &mut loaded.scene;
    scene.materials.iter_mut().for_each(|material| material.layers = Some(Default::default()));
    scene.mesh.tangents = vec![Vec4::new(1.0, 0.0, 0.0, 1.0); scene.mesh.positions.len()];
    let motion = Arc::make_mut(scene.motion.as_mut().unwrap());
    let part = motion.parts.iter_mut().find(|part| part.geometry.skin.is_some()).unwrap();
    let geometry = Arc::make_mut(&mut part.geometry);
    let across = |n: &Vec3| Vec3::new(-n.z, 0.3, n.x).normalize();
    let sign = |index: usize| if index.is_multiple_of(3) { -1.0 } else { 1.0 };
    geometry.tangents = geometry.normals.iter().enumerate().map(|(i, n)| across(n).extend(sign(i))).collect();
    geometry.targets[1].tangents = geometry.normals.iter().map(|n| n.cross(Vec3::Y) * 0.4).collect();
}

/// A device with wide nodes and compact ones.
fn tracer(device: &Device, loaded: &Loaded) -> Tracer {
    let features = Features::required_by(&loaded.scene, &loaded.environment);
    let both = Traversals { pixels: Traversal::Packet, bundles: Traversal::SingleRay };
    Tracer::with_features(device, &loaded.scene, loaded.trees(), &loaded.environment, &features, both)
        .unwrap()
}

/// What the host's state and the devices' own deformation leave on a device at each of some instants.
fn at_instants(device: &Device, loaded: &Loaded, check: impl Fn(f64, &SceneContents, &SceneContents)) {
    let parted = loaded.parted.as_ref().unwrap();
    let mut sides = [DeformedBy::Host, DeformedBy::Devices].map(|by| {
        (MovingScene::new(&loaded.scene, loaded.trees(), parted, by).unwrap(), tracer(device, loaded))
    });
    for time in TIMES {
        let [host, own] = &mut sides;
        let [host, own] = [host, own].map(|(scene, tracer)| {
            tracer.move_to(&scene.at(time)).unwrap();
            tracer.scene().contents().unwrap()
        });
        check(time, &host, &own);
    }
}

fn size(loaded: &Loaded) -> f32 {
    let (low, high) = loaded.scene.mesh.bounds().unwrap();
    (high - low).max_element()
}

fn farthest(a: &[f32], b: &[f32]) -> f32 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).fold(0.0, |most, (a, b)| most.max((a - b).abs()))
}

type Corners = (Vec3, Vec3);

fn around(a: Corners, b: Corners) -> Corners {
    (a.0.min(b.0), a.1.max(b.1))
}

const NOTHING: Corners = (Vec3::INFINITY, Vec3::NEG_INFINITY);

fn corner(leaves: &[f32], (first, count): (usize, usize), corner: usize, lane: usize) -> Vec3 {
    let at = |axis: usize| leaves[first * 9 + (corner * 3 + axis) * count + lane];
    Vec3::new(at(0), at(1), at(2))
}

/// The box around all below a node; each child's is asked to be the tightest there is. Counts triangles.
fn tight(nodes: &[WideNode], leaves: &[f32], index: usize, triangles: &mut usize) -> Corners {
    let node = &nodes[index];
    let mut all = NOTHING;
    for (slot, &child) in node.children.iter().enumerate().filter(|(_, child)| **child != EMPTY) {
        let own = if child & LEAF != 0 {
            let range = leaf_range(child);
            *triangles += range.1;
            let places = (0..3).flat_map(|c| (0..range.1).map(move |lane| (c, lane)));
            places.map(|(c, lane)| corner(leaves, range, c, lane)).fold(NOTHING, |all, p| around(all, (p, p)))
        } else {
            tight(nodes, leaves, child as usize, triangles)
        };
        let told = [&node.lower, &node.upper].map(|rows| Vec3::from_array(rows.map(|row| row[slot])));
        assert_eq!((told[0], told[1]), own, "child {slot} of node {index}");
        all = around(all, own);
    }
    all
}

/// The tree holds its triangles, as tightly as can be, and says the same in both layouts.
fn is_sound(contents: &SceneContents, name: &str) {
    let (wide, compact) = (contents.wide.as_ref().unwrap(), contents.compact.as_ref().unwrap());
    let mut triangles = 0;
    tight(wide, &contents.leaves, 0, &mut triangles);
    assert_eq!(triangles, contents.triangles.len(), "{name}");
    for (index, (own, expected)) in compact.iter().zip(compact_nodes(wide)).enumerate() {
        assert_eq!(*own, expected, "{name}: node {index}");
    }
}

#[test]
fn devices_deform_as_the_host_does() {
    let mut loaded = load(world_of_two(true));
    with_tangents(&mut loaded);
    let most = 5e-7 * size(&loaded);
    on_every_device(|device| {
        at_instants(device, &loaded, |time, host, own| {
            assert_eq!(host.triangles, own.triangles);
            let off = farthest(&host.leaves, &own.leaves);
            assert!(off < most, "{time}: {off}");
            assert!(time == 0.0 || off > 0.0, "nothing was deformed by the device");
            let normals = host.normals.iter().zip(&own.normals);
            let off = normals.map(|(a, b)| farthest(&unpack_normal(*a), &unpack_normal(*b)));
            assert!(off.fold(0.0, f32::max) < 2e-4, "{time}: normals");
            let [a, b] = [host, own].map(|contents| contents.tangents.as_ref().unwrap());
            let off = farthest(bytemuck::cast_slice(a), bytemuck::cast_slice(b));
            assert!(off < 1e-4, "{time}: tangents, {off}");
            assert!(a.iter().any(|t| t[3] < 0.0) && a.iter().any(|t| t[3] > 0.0));
            is_sound(host, "host");
            is_sound(own, "device");
        });
    });
}

/// Joints of no size: no triangle is left without an area, which rays would take for one that they miss.
#[test]
fn what_joints_flatten_keeps_an_area() {
    let loaded = load(flattening_tube());
    let most = 5e-6 * size(&loaded);
    on_every_device(|device| {
        at_instants(device, &loaded, |time, host, own| {
            let off = farthest(&host.leaves, &own.leaves);
            assert!(off < most, "{time}: {off}");
            is_sound(own, "device");
            let flat = |contents: &SceneContents| {
                let slots = contents.triangles.iter().enumerate();
                let area = |(place, triangle): (usize, &foveate::layout::Triangle)| {
                    let (lane, count) =
                        ((triangle.packed >> 16 & 7) as usize, (triangle.packed >> 19 & 7) as usize + 1);
                    let [a, b, c] = [0, 1, 2]
                        .map(|c| corner(&contents.leaves, (place - lane, count), c, lane).as_dvec3());
                    (b - a).cross(c - a).length()
                };
                slots.map(area).fold(f64::INFINITY, f64::min)
            };
            assert!(flat(host) > 0.0 && flat(own) > 0.0, "{time}: {} {}", flat(host), flat(own));
        });
    });
}

/// A device that has missed instants has what one has that has not.
#[test]
fn the_newest_state_is_enough() {
    let loaded = load(world_of_two(false));
    on_every_device(|device| {
        let parted = loaded.parted.as_ref().unwrap();
        let mut scene = MovingScene::new(&loaded.scene, loaded.trees(), parted, DeformedBy::Devices).unwrap();
        let (mut steady, mut late) = (tracer(device, &loaded), tracer(device, &loaded));
        let mut rebuilt = 0;
        for step in 0..120 {
            let state = scene.at(f64::from(step) * 0.02);
            steady.move_to(&state).unwrap();
            rebuilt += u32::from(scene.is_rebuilt());
            if step == 119 {
                late.move_to(&state).unwrap();
            }
        }
        assert!(rebuilt > 0, "no tree was built anew");
        let [steady, late] = [steady, late].map(|tracer| tracer.scene().contents().unwrap());
        assert!(steady == late);
        is_sound(&late, "late");
    });
}

/// The tube without its joints, morphed alone.
fn without_skin() -> Loaded {
    let mut loaded = load(world_of_two(true));
    let motion = Arc::make_mut(loaded.scene.motion.as_mut().unwrap());
    let part = motion.parts.iter_mut().find(|part| part.geometry.skin.is_some()).unwrap();
    Arc::make_mut(&mut part.geometry).skin = None;
    loaded
}

/// The tube as a lamp, which the host deforms.
fn shining() -> Loaded {
    let mut loaded = load(flattening_tube());
    loaded.scene.materials.iter_mut().for_each(|material| material.emissive = Vec3::ONE);
    loaded
}

/// What is told to be needed is what is taken, and devices without room for it are refused.
#[test]
fn what_devices_need_to_deform_is_counted() {
    let scenes = [load(world_of_two(true)), load(flattening_tube()), without_skin(), shining()];
    for (index, loaded) in scenes.iter().enumerate() {
        let parted = loaded.parted.as_ref().unwrap();
        let counted: usize = deformed_bytes(&loaded.scene, parted).iter().map(|buffer| buffer.bytes).sum();
        assert_eq!(counted > 0, index < 3);
        let mut data = SceneData::pack(&loaded.scene, loaded.trees(), &loaded.environment).unwrap();
        on_every_device(|device| {
            let mut tracer = tracer(device, loaded);
            let by = DeformedBy::Devices;
            let mut scene = MovingScene::new(&loaded.scene, loaded.trees(), parted, by).unwrap();
            assert_eq!(tracer.scene().deformed_bytes(), 0);
            tracer.move_to(&scene.at(0.5)).unwrap();
            assert_eq!(tracer.scene().deformed_bytes(), counted, "scene {index}");
        });
        let packet = Traversals::from(Traversal::Packet);
        let rest: usize = data.bytes(packet).iter().map(|buffer| buffer.bytes).sum();
        data.expect_deformation(&loaded.scene, parted);
        on_every_device(|device| {
            for (memory, fits) in [(rest + counted, true), (rest + counted - 1, false)] {
                let mut info = device.info().clone();
                info.memory = memory as u64;
                let fit = data.check_fit(&Device::open(&info).unwrap(), packet);
                assert_eq!(fit.is_ok(), fits, "scene {index}: {fit:?}");
            }
        });
    }
}
