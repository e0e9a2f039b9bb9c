//! Shapes that are kept once, against the same scene with every triangle in its place: rays hit the same triangles at the
//! same distances to the last bit, since both are computed from the same rounded corners, and pictures are the same.

use std::sync::Arc;

use foveate::bench::workload::Workload;
use foveate::bvh::instances::over_instances;
use foveate::bvh::{Trees, WideBvh};
use foveate::gpu::opencl::Device;
use foveate::math::view::View;
use foveate::reference::Random;
use foveate::scene::instanced::{Instance, Instanced, InstancedShape};
use foveate::scene::{AlphaMode, Environment, Features, Material, Scene, Sun};
use foveate::trace::numbers::{Named, TriangleNumbers};
use foveate::trace::probe::{Probe, RayKind, shape_of};
use foveate::trace::{Settings, Traversal};
use glam::{DMat4, DQuat, DVec3, Vec2, Vec3};

use crate::bench::{Bench, EVERYTHING, PLAIN, all_pixels, on_every_device, view};
use crate::scenes::{self, on_sphere};

/// The trees of a scene.
struct Grown {
    world: WideBvh,
    shapes: Vec<WideBvh>,
}

impl Grown {
    fn of(scene: &Scene) -> Self {
        let still = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
        let Some(instanced) = &scene.instanced else { return Grown { world: still, shapes: Vec::new() } };
        let mesh = &instanced.mesh;
        let tree = |shape: &InstancedShape| {
            WideBvh::build(&mesh.positions, &mesh.triangles[shape.triangles.clone()])
        };
        Grown {
            world: over_instances(still, &instanced.boxes()),
            shapes: instanced.shapes.iter().map(tree).collect(),
        }
    }

    fn trees(&self) -> Trees<'_> {
        Trees { world: &self.world, shapes: &self.shapes }
    }
}

/// Places of any turn, of sizes that differ from axis to axis.
fn places(random: &mut Random, shapes: u32, count: u32, spread: f64) -> Vec<Instance> {
    let place = |number: u32, random: &mut Random| {
        let turn = DQuat::from_axis_angle(on_sphere(random), random.uniform() * 6.0);
        let size = DVec3::new(random.uniform(), random.uniform(), random.uniform()) * 1.5 + 0.2;
        let at = on_sphere(random) * spread * random.uniform().cbrt();
        let matrix = DMat4::from_scale_rotation_translation(size, turn, at);
        let row = |axis: usize| matrix.row(axis).as_vec4().to_array();
        Instance { shape: number % shapes, anchor_from_shape: [row(0), row(1), row(2)] }
    };
    (0..count).map(|number| place(number, random)).collect()
}

/// What `world` has beside shapes at places.
fn instanced(world: Scene, shapes: &[Scene], instances: Vec<Instance>) -> Scene {
    let mut kept = Instanced { instances, ..Instanced::default() };
    for shape in shapes {
        let (first, vertices) = (kept.mesh.triangles.len(), kept.mesh.positions.len());
        let (mesh, from) = (&mut kept.mesh, &shape.mesh);
        mesh.positions.extend(&from.positions);
        mesh.normals.extend(&from.normals);
        mesh.tangents.extend(&from.tangents);
        mesh.uvs[0].extend(&from.uvs[0]);
        mesh.triangles.extend(from.triangles.iter().map(|t| t.map(|corner| corner + vertices as u32)));
        mesh.materials.extend(&from.materials);
        kept.shapes.push(InstancedShape {
            triangles: first..mesh.triangles.len(),
            vertices: vertices..mesh.positions.len(),
        });
    }
    Scene { instanced: Some(Arc::new(kept)), ..world }
}

/// All that rays of every kind find: triangles and distances, and what is hidden.
fn found(probe: &Probe) -> (Vec<(u32, u32)>, Vec<u32>) {
    let kinds = [RayKind::Pixels, RayKind::Samples, RayKind::Occlusion, RayKind::Bounce];
    for &kind in &kinds {
        probe.trace(kind).unwrap();
    }
    let hits = kinds.iter().flat_map(|&kind| probe.hits(kind).unwrap());
    (hits.map(|hit| (hit.triangle, hit.t.to_bits())).collect(), probe.hidden().unwrap())
}

/// Index in the flattened scene's mesh.
fn flat_index(scene: &Scene, named: Named) -> usize {
    match (named, &scene.instanced) {
        (Named::Instance(instance, triangle), Some(instanced)) => {
            let count = |i: &Instance| instanced.shapes[i.shape as usize].triangles.len();
            let before: usize = instanced.instances[..instance].iter().map(count).sum();
            let shape = &instanced.shapes[instanced.instances[instance].shape as usize];
            scene.mesh.triangles.len() + before + triangle - shape.triangles.start
        }
        (Named::World(triangle) | Named::Instance(_, triangle), _) => triangle,
    }
}

/// Counts rays that find something else than in the flattened scene.
fn compare(device: &Device, name: &str, scene: &Scene, view: &View) {
    let flat = scene.flattened();
    let (grown, whole) = (Grown::of(scene), Grown::of(&flat));
    let pattern = foveate::foveation::Pattern::new(
        view,
        &foveate::foveation::Law::default(),
        glam::DVec2::splat(0.5),
        view.pixels() / 8,
    );
    for traversal in Traversal::ALL {
        let mut expected = Probe::new(device, &flat, &whole.world, traversal).unwrap();
        let work = Workload::new(&mut expected, &flat, &whole.world, *view, pattern.clone()).unwrap();
        let mut probe = Probe::new(device, scene, grown.trees(), traversal).unwrap();
        work.load(&mut probe).unwrap();
        let ((truth, shadows), (hits, hidden)) = (found(&expected), found(&probe));
        let numbers = TriangleNumbers::new(scene, grown.trees());
        let flat_numbers = TriangleNumbers::new(&flat, whole.trees());
        let (mut hit, mut others) = (0, 0);
        for (ray, (&(found, at), &(wanted, t))) in hits.iter().zip(&truth).enumerate() {
            assert_eq!(at, t, "{name}, {}: ray {ray}", traversal.name());
            if wanted == u32::MAX {
                continue;
            }
            hit += 1;
            let Named::World(triangle) = flat_numbers.of(wanted) else { unreachable!("it is flat") };
            others += usize::from(flat_index(scene, numbers.of(found)) != triangle);
        }
        println!(
            "{name}, {}: {} rays, {hit} hits, {others} of the other of two",
            traversal.name(),
            hits.len()
        );
        assert!(hit > hits.len() / 8, "{name}: too few hits to tell");
        // Where two meet at an edge, either may come first.
        assert!(others <= hit / 200, "{name}: {others} of {hit} are of another triangle");
        assert_eq!(hidden, shadows, "{name}, {}: shadows", traversal.name());
    }
}

#[test]
fn instances_are_hit_as_their_flattened_triangles_are() {
    on_every_device(|device| {
        let mut random = Random::new(3);
        for (name, scale) in [("instances", 1.0), ("small instances", 1e-5), ("large instances", 1e5)] {
            let shapes = [scenes::soup(8, 400, 0.3), scenes::slivers(9, 300), scenes::soup(10, 3, 0.5)];
            let mut places = places(&mut random, 3, 90, 12.0);
            for row in places.iter_mut().flat_map(|place| &mut place.anchor_from_shape) {
                row.iter_mut().for_each(|entry| *entry *= scale);
            }
            let mut world = scenes::scene_of(vec![scenes::matt(0.5)]);
            scenes::floor(&mut world, 30.0 * scale, -6.0 * scale, 0);
            let scene = shape_of(instanced(world, &shapes, places));
            let reach = f64::from(scale);
            let eye = DVec3::new(7.0, 4.0, 13.0) * reach;
            compare(device, name, &scene, &view(eye, DVec3::ZERO, 80.0, (96, 72)));
            // From among them.
            compare(device, name, &scene, &view(DVec3::ONE * reach, eye, 110.0, (96, 72)));
        }
    });
}

#[test]
fn instances_alone_and_far_from_the_anchor_are_hit_as_well() {
    on_every_device(|device| {
        let mut random = Random::new(4);
        let shapes = [scenes::soup(8, 400, 0.3)];
        let mut places = places(&mut random, 1, 40, 6.0);
        places.iter_mut().for_each(|place| place.anchor_from_shape[0][3] += 3000.0);
        let scene = shape_of(instanced(scenes::scene_of(vec![scenes::matt(0.5)]), &shapes, places));
        let at = DVec3::X * 3000.0;
        compare(device, "far", &scene, &view(at + DVec3::new(3.0, 2.0, 9.0), at, 70.0, (96, 72)));
    });
}

/// Balls with relief, colours and holes, and a floor.
fn gallery() -> Scene {
    let cut = Material {
        base_color_texture: scenes::mapped(0, 3.0),
        normal_texture: scenes::mapped(1, 2.0),
        normal_scale: 1.0,
        alpha: AlphaMode::Mask(0.5),
        double_sided: true,
        ..scenes::matt(0.8)
    };
    let mut ball = scenes::sphere(2, Vec3::ZERO, 0.7, cut.clone());
    let mesh = &mut ball.mesh;
    for (i, at) in mesh.positions.iter().enumerate() {
        mesh.normals[i] = at.normalize();
        mesh.tangents[i] = at.normalize().any_orthonormal_vector().extend(1.0);
        mesh.uvs[0][i] = Vec2::new(at.x, at.y + at.z);
    }
    mesh.materials.fill(1);
    // Seen from outside.
    mesh.triangles.iter_mut().for_each(|triangle| triangle.swap(1, 2));
    let mut world = Scene {
        textures: vec![
            scenes::texture(true, |i| [40 + 13 * i as u8, 200, 90, if i % 5 == 0 { 0 } else { 255 }]),
            scenes::texture(false, |i| [108 + 5 * (i % 8) as u8, 150 - 3 * i as u8, 245, 255]),
        ],
        ..scenes::scene_of(vec![scenes::matt(0.6), cut])
    };
    scenes::floor(&mut world, 8.0, -1.2, 0);
    instanced(world, &[ball], places(&mut Random::new(12), 1, 14, 3.0))
}

#[test]
fn pictures_of_instances_are_those_of_the_flattened_scene() {
    on_every_device(|device| {
        let scene = gallery();
        let flat = scene.flattened();
        let light = Environment {
            sun: Some(Sun {
                direction: Vec3::new(0.3, 0.8, 0.4).normalize(),
                radiance: Vec3::splat(40_000.0),
                cos_radius: 0.99998,
            }),
            ..Environment::constant(Vec3::splat(0.7))
        };
        let view = view(DVec3::new(1.0, 1.5, 5.5), DVec3::ZERO, 60.0, (96, 72));
        let settings = Settings { guided: true, edge_rays: 2, ..PLAIN };
        let (grown, whole) = (Grown::of(&scene), Grown::of(&flat));
        let features = Features { emitters: false, instances: true, ..EVERYTHING };
        for traversal in Traversal::ALL {
            let mut bench = Bench::grown(device, &scene, &light, &features, traversal, grown.trees());
            let found = bench.trace(&view, &settings, &all_pixels(&view));
            let plain = Features { instances: false, ..features };
            let mut bench = Bench::grown(device, &flat, &light, &plain, traversal, whole.trees());
            let truth = bench.trace(&view, &settings, &all_pixels(&view));
            let mut far = 0;
            for (a, b) in found.visibility.iter().zip(&truth.visibility) {
                let turned = |a: u32, b: u32| {
                    let [a, b] = [a, b].map(|n| Vec3::from(foveate::layout::unpack_normal24(n & 0xff_ffff)));
                    a.dot(b) < 0.9999
                };
                let lit = (a.normal ^ b.normal) & foveate::layout::SUN_VISIBLE != 0;
                far += usize::from(
                    a.depth.to_bits() != b.depth.to_bits()
                        || lit
                        || turned(a.normal, b.normal)
                        || turned(a.mapped, b.mapped)
                        || a.base != b.base,
                );
            }
            let mean = |picture: &crate::bench::Picture| {
                picture.samples.iter().map(|s| f64::from(s.first.iter().sum::<f32>())).sum::<f64>()
            };
            let (ours, wanted) = (mean(&found), mean(&truth));
            println!(
                "{}: {far} pixels of {} differ, light {ours} for {wanted}",
                traversal.name(),
                view.pixels()
            );
            assert!(far <= view.pixels() / 500, "{}: {far}", traversal.name());
            assert!((ours / wanted - 1.0).abs() < 1e-3 && wanted > 0.0, "{ours} {wanted}");
        }
    });
}
