//! Rays that ray queries of Vulkan trace, against those of the kernels and of the reference: hits, samples and pixels, whole
//! frames of both eyes, and what settings and scenes keep from them.

use std::sync::Arc;

use foveate::bvh::instances::over_instances;
use foveate::bvh::{Trees, WideBvh};
use foveate::config::{Config, HardwareRaysConfig, Samples, Stereo};
use foveate::foveation::Workload;
use foveate::frame::stereo::parallel_eyes;
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::interop::{self, Shared, Sharing};
use foveate::gpu::opencl::Device;
use foveate::gpu::vulkan::{Context, ContextOptions};
use foveate::layout::HitRecord;
use foveate::math::view::{FieldOfView, View};
use foveate::reference::Random;
use foveate::scene::generate::{demo, voxel_town};
use foveate::scene::instanced::{Instance, Instanced, InstancedShape};
use foveate::scene::{Environment, Scene, default_viewpoint};
use foveate::trace::probe::shape_of;
use foveate::trace::{
    DeviceWorker, Fleet, Job, RayQueryDevice, SampleTarget, SceneData, Settings, Traversal, Worker,
};
use glam::{DMat4, DQuat, DVec3, Vec3};

use crate::bench::{Bench, EVERYTHING, PLAIN, Picture, all_pixels, on_every_device, view};
use crate::common;
use crate::guided::{eye, light};
use crate::hits::disagreements;
use crate::scenes::soup;
use crate::variants::{alike, everything};

/// Runs a test on every OpenCL device that shares memory with a Vulkan device that has ray queries, under the validation
/// layer; that one does so is promised where CI=true.
pub fn on_shared_memory(test: impl Fn(&Device, &Context)) {
    let Some(context) = common::ray_queries() else { return };
    let ran = std::cell::Cell::new(false);
    on_every_device(|device| match interop::explain(device, &context) {
        (Sharing::ZeroCopy, _) => {
            test(device, &context);
            ran.set(true);
        }
        (Sharing::Staged, why) => println!("not run: {}: {why}", device.info().name),
    });
    assert!(ran.get() || std::env::var("CI").as_deref() != Ok("true"), "no devices share memory");
    assert_eq!(context.validation_messages(), Vec::<String>::new());
}

fn demo_scene() -> Scene {
    Scene::from_glb(std::path::Path::new("demo.glb"), &demo::generate()).unwrap()
}

/// A block town, and a view over it.
fn town() -> (Scene, View) {
    let bytes = voxel_town::generate(20_000, 1).unwrap();
    let town = Scene::from_glb(std::path::Path::new("town.glb"), &bytes).unwrap();
    let (low, high) = town.mesh.bounds().unwrap();
    let (low, high) = (low.as_dvec3() + town.anchor, high.as_dvec3() + town.anchor);
    let middle = (low + high) * 0.5;
    let over = view(middle + (high - low) * DVec3::new(0.45, 0.6, 0.55), middle, 50.0, (240, 150));
    (town, over)
}

fn lookout(scene: &Scene) -> View {
    let viewpoint = default_viewpoint(scene, 60.0);
    let fov = FieldOfView::symmetric(viewpoint.fov_y, 1.6);
    View {
        world_from_eye: viewpoint.world_from_eye,
        fov,
        width: 240,
        height: 150,
        spacing: Default::default(),
    }
}

/// Whether two hits are of different surfaces.
pub fn differ(a: &HitRecord, b: &HitRecord) -> bool {
    let (hit, other) = (a.triangle != u32::MAX, b.triangle != u32::MAX);
    hit != other || hit && (a.t - b.t).abs() > 1e-4 * a.t
}

/// Both pictures of a scene: by the kernels, and by ray queries.
pub fn both(
    (device, context): (&Device, &Context),
    scene: &Scene,
    environment: &Environment,
    view: &View,
    settings: &Settings,
) -> [Picture; 2] {
    let pattern = all_pixels(view);
    let mut kernels = Bench::walking(device, scene, environment, &EVERYTHING, Traversal::SingleRay);
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let mut queries =
        Bench::by_ray_queries(device, context, scene, environment, (&bvh).into(), Some(bvh.clone()));
    [&mut kernels, &mut queries].map(|bench| {
        if settings.cached {
            bench.light(view, settings, &pattern, 0..6);
        }
        let picture = bench.trace(view, settings, &pattern);
        assert_eq!(picture.dropped, 0);
        picture
    })
}

#[test]
fn camera_rays_hit_what_those_of_the_kernels_hit() {
    on_shared_memory(|device, context| {
        let (town, above) = town();
        let demo = demo_scene();
        let shape = shape_of(demo.clone());
        let dark = Environment::constant(Vec3::ZERO);
        // What the reference can judge, and what has cut-outs, glass and what is turned away.
        for (name, scene, view, opaque) in [
            ("town", &town, above, true),
            ("the demo scene's shape", &shape, lookout(&shape), true),
            ("the demo scene", &demo, lookout(&demo), false),
        ] {
            for guided in [false, true] {
                let settings = Settings { rays: 1, guided, ..PLAIN };
                let [kernels, queries] = both((device, context), scene, &dark, &view, &settings);
                let pixels = view.pixels();
                let off = kernels.hits.iter().zip(&queries.hits).filter(|(a, b)| differ(a, b)).count();
                let hits = kernels.hits.iter().filter(|hit| hit.triangle != u32::MAX).count();
                let of = |picture: &Picture| disagreements(scene, &view, picture).1.len();
                let wrong = opaque.then(|| [&kernels, &queries].map(of));
                println!("{name}: {off} of {pixels} camera rays differ, {hits} hits; not allowed: {wrong:?}");
                assert!(hits * 3 > pixels && off * 2000 <= pixels, "{name}: {off} of {pixels} differ");
                assert!(wrong.is_none_or(|[_, queries]| queries * 5000 <= pixels), "{name}: {wrong:?}");
            }
        }
    });
}

/// A shape of one-sided triangles at places of any turn and size, beside triangles of the world.
#[test]
fn instances_are_hit_where_the_kernels_hit_them() {
    on_shared_memory(|device, context| {
        let (mut random, shape) = (Random::new(5), soup(7, 400, 1.0));
        let (positions, count) = (shape.mesh.positions.len(), shape.mesh.triangles.len());
        let place = |number: usize| {
            let turn =
                DQuat::from_rotation_y(1.3 * number as f64) * DQuat::from_rotation_x(0.7 * number as f64);
            let size = DVec3::new(0.6 + random.uniform(), 0.6 + random.uniform(), 0.8);
            let at = DVec3::new(number as f64 % 3.0 - 1.0, number as f64 / 3.0 - 1.0, 0.0) * 1.6;
            Instance::new(0, &DMat4::from_scale_rotation_translation(size, turn, at))
        };
        let instances: Vec<Instance> = (0..9).map(place).collect();
        let instanced = Instanced {
            shapes: vec![InstancedShape { triangles: 0..count, vertices: 0..positions }],
            mesh: shape.mesh.clone(),
            instances,
        };
        let scene =
            Scene { mesh: soup(8, 50, 3.0).mesh, instanced: Some(Arc::new(instanced)), ..shape.clone() };
        let still = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
        let instanced = scene.instanced.as_ref().unwrap();
        let world = over_instances(still, &instanced.boxes());
        let shapes = [WideBvh::build(&shape.mesh.positions, &shape.mesh.triangles)];
        let trees = Trees { world: &world, shapes: &shapes };
        let features = foveate::scene::Features { instances: true, ..EVERYTHING };
        let (dark, view) = (
            Environment::constant(Vec3::ZERO),
            view(DVec3::new(0.4, 0.7, 6.0), DVec3::ZERO, 60.0, (240, 150)),
        );
        let mut kernels = Bench::grown(device, &scene, &dark, &features, Traversal::SingleRay, trees);
        let mut queries = Bench::by_ray_queries(device, context, &scene, &dark, trees, None);
        let settings = Settings { rays: 1, guided: true, ..PLAIN };
        let [kernels, queries] =
            [&mut kernels, &mut queries].map(|bench| bench.trace(&view, &settings, &all_pixels(&view)).hits);
        let off = kernels.iter().zip(&queries).filter(|(a, b)| differ(a, b)).count();
        let named = kernels.iter().zip(&queries).filter(|(a, b)| a.triangle == b.triangle).count();
        let hits = kernels.iter().filter(|hit| hit.triangle != u32::MAX).count();
        println!(
            "instances: {off} of {} camera rays differ, {hits} hits, {named} of the same name",
            view.pixels()
        );
        assert!(hits * 4 > view.pixels() && off * 500 <= view.pixels(), "{off} differ");
        assert!(named * 1000 >= view.pixels() * 995, "{named} have the same name");
    });
}

/// What samples' light is, on the whole.
fn mean(picture: &Picture) -> f64 {
    let light =
        picture.samples.iter().map(|s| s.first.iter().chain(&s.second).map(|&v| f64::from(v)).sum::<f64>());
    light.sum::<f64>() / picture.samples.len() as f64
}

/// Rays leave surfaces a little farther away for ray queries, so that those aimed at lamps have other last digits: whether
/// these pass glass is decided anew by chance. So samples beside glass are held to their mean.
#[test]
fn samples_and_pixels_are_those_of_the_kernels() {
    on_shared_memory(|device, context| {
        let (glassy, light, view) = (everything(), light(), eye());
        let mut opaque = glassy.clone();
        opaque.materials.iter_mut().for_each(|material| material.glass = None);
        let guided = Settings { guided: true, ..PLAIN };
        for (name, settings) in [
            ("rays alone", Settings { rays: 32, ..PLAIN }),
            ("paths, more rays than go together", Settings { rays: 80, bounces: 2, ..PLAIN }),
            ("guided paths, few rays", Settings { rays: 8, bounces: 1, ..guided }),
            ("guided, a cache of light, edges", Settings { rays: 32, cached: true, edge_rays: 2, ..guided }),
        ] {
            for (of, scene, most) in [("without glass", &opaque, 0.02), ("with glass", &glassy, 0.3)] {
                let [kernels, queries] = both((device, context), scene, &light, &view, &settings);
                let lit = kernels.samples.iter().filter(|record| record.depth > 0.0).count();
                let off = kernels.samples.iter().zip(&queries.samples).filter(|(a, b)| !alike(a, b)).count();
                let seen = kernels.visibility.iter().zip(&queries.visibility);
                let described = seen.filter(|(a, b)| a.normal != b.normal).count();
                let (rays, means) = ([kernels.rays, queries.rays], [mean(&kernels), mean(&queries)]);
                println!(
                    "{name}, {of}: {off} of {lit} samples and {described} pixels differ, {rays:?} rays, means {means:?}"
                );
                assert!(lit > 2000 && off as f64 <= most * lit as f64, "{name}, {of}: {off} of {lit} differ");
                assert!(described * 200 <= view.pixels(), "{name}, {of}: {described} pixels differ");
                assert!(rays[0].abs_diff(rays[1]) * 100 <= rays[0], "{name}, {of}: {rays:?} rays");
                assert!((means[1] / means[0] - 1.0).abs() < 0.005, "{name}, {of}: {means:?}");
            }
        }
    });
}

/// Level floors and walls, from which rays are lifted by next to nothing.
#[test]
fn rays_do_not_meet_the_surfaces_that_they_leave() {
    on_shared_memory(|device, context| {
        let (town, over) = town();
        let view = View { width: 96, height: 60, ..over };
        for settings in [Settings { rays: 32, ..PLAIN }, Settings { rays: 32, guided: true, ..PLAIN }] {
            let [kernels, queries] = both((device, context), &town, &light(), &view, &settings);
            let lit = kernels.samples.iter().filter(|record| record.depth > 0.0).count();
            let off = kernels.samples.iter().zip(&queries.samples).filter(|(a, b)| !alike(a, b)).count();
            let seen = kernels.visibility.iter().zip(&queries.visibility);
            let described = seen.filter(|(a, b)| a.normal != b.normal).count();
            let means = [mean(&kernels), mean(&queries)];
            println!("town: {off} of {lit} samples and {described} pixels differ, means {means:?}");
            assert!(lit > 2000 && off * 50 <= lit && described * 500 <= view.pixels(), "{off}, {described}");
            assert!((means[1] / means[0] - 1.0).abs() < 0.002, "{means:?}");
        }
    });
}

fn config(hardware_rays: HardwareRaysConfig) -> Config {
    let mut config = Config::default();
    config.foveation.samples = Samples::Count(3000);
    config.trace.hardware_rays = hardware_rays;
    config.trace.traversal = Traversal::SingleRay.into();
    config
}

/// The demo scene with its cut-outs, glass, emitters and sun, in both eyes.
#[test]
fn frames_are_those_of_the_kernels() {
    on_shared_memory(|device, context| {
        let loaded = Loaded::from_glb("demo", &demo::generate(), &Config::default()).unwrap();
        let eye = default_viewpoint(&loaded.scene, 60.0);
        let eyes = parallel_eyes(eye.world_from_eye, 0.064, FieldOfView::symmetric(1.0, 1.0), 128, 128);
        let plan = Plan::stereo(eyes, Stereo::PerEye).unwrap();
        let [kernels, queries] = [HardwareRaysConfig::Off, HardwareRaysConfig::On].map(|by| {
            let made = Renderer::new(device, context, &loaded, &config(by), Output::Display);
            let mut renderer = made.unwrap().0;
            let reports = [0, 1].map(|seed| renderer.frame(&plan, &[], seed).unwrap());
            assert_eq!(renderer.take_notes(), Vec::<String>::new());
            assert!(reports.iter().all(|report| report.dropped == 0));
            (renderer.picture().unwrap(), reports[1].rays)
        });
        let apart = |(a, b): (&[u8], &[u8])| a.iter().zip(b).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
        let pixels = kernels.0.chunks_exact(4).zip(queries.0.chunks_exact(4)).map(apart);
        let apart: Vec<u8> = pixels.collect();
        let above = |limit: u8| apart.iter().filter(|&&apart| apart > limit).count();
        let told = [0, 2, 8, 32].map(above);
        println!("of {} pixels {told:?} differ by more than 0, 2, 8 and 32 of 255", apart.len());
        assert!(told[2] * 100 <= apart.len() && told[3] * 1000 <= apart.len(), "{told:?}");
        assert!(kernels.1.abs_diff(queries.1) * 500 <= kernels.1, "{} and {} rays", kernels.1, queries.1);
    });
}

#[test]
fn what_keeps_ray_queries_from_tracing_is_told() {
    on_shared_memory(|device, context| {
        use HardwareRaysConfig::On;
        let still = Loaded::from_glb("demo", &demo::generate(), &Config::default()).unwrap();
        let make = |context: &Context, loaded: &Loaded, by| {
            Renderer::new(device, context, loaded, &config(by), Output::Display).map(|made| made.0)
        };
        // A context that was opened without them, and memory that is not shared.
        let plain = Context::new(&ContextOptions::default()).unwrap();
        let refused = make(&plain, &still, On).err().unwrap().to_string();
        assert!(refused.contains("trace.hardware_rays") && refused.contains("opened without"), "{refused}");
        let on = config(On);
        let staged = Renderer::with_sharing(device, context, &still, &on, Output::Display, Sharing::Staged);
        let refused = staged.err().unwrap().to_string();
        assert!(refused.contains("trace.hardware_rays") && refused.contains("does not share"), "{refused}");
    });
}

fn packed(scene: &Scene) -> SceneData {
    let tree = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    SceneData::pack(scene, &tree, &Environment::constant(Vec3::ONE)).unwrap()
}

/// As where there is no room for acceleration structures.
#[test]
fn what_ray_queries_cannot_take_the_kernels_trace_unless_these_are_wanted() {
    let Ok(context) = Context::new(&ContextOptions::default()) else {
        assert!(std::env::var("CI").as_deref() != Ok("true"), "no Vulkan device");
        println!("not run: no Vulkan device");
        return;
    };
    let data = Arc::new(packed(&demo_scene()));
    on_every_device(|device| {
        let tried = [(device.clone(), Ok(Traversal::SingleRay.into()))];
        let fleet = |required| {
            let rays = RayQueryDevice { context: context.clone(), required };
            Fleet::of_tried(&tried, &data, true, Some(&rays))
        };
        let notes = fleet(false).unwrap().take_notes();
        let told = "the kernels trace all rays, since ray queries could not take this scene: ";
        assert!(notes.len() == 1 && notes[0].starts_with(told), "{notes:?}");
        let refused = fleet(true).err().unwrap().to_string();
        assert!(refused.ends_with("; or set trace.hardware_rays=off"), "{refused}");
    });
}

/// Whoever waits for the first view need not wait for the rays of the second.
#[test]
fn the_first_view_is_told_before_the_second_begins() {
    on_shared_memory(|device, context| {
        let scene = demo_scene();
        let (data, view) = (packed(&scene), lookout(&scene));
        let settings = Settings { rays: 1, guided: false, ..PLAIN };
        let work = [0, 1].map(|index| {
            let pattern = Arc::new(all_pixels(&view));
            let workload = Arc::new(Workload::new(&pattern, settings.guided));
            let samples = Shared::new(Some(device), context, pattern.samples.len()).unwrap();
            let sample_target = Arc::new(SampleTarget { samples, visibility: None });
            let part = workload.whole();
            let (light, state, sky, direct, timed_apart) = (0, None, None, false, false);
            let job = Job {
                index,
                view,
                settings,
                light,
                state,
                sky,
                pattern,
                workload,
                sample_target,
                direct,
                timed_apart,
                light_restarts: 0,
            };
            (Arc::new(job), part)
        });
        // Devices hold the patterns of views that they have begun with.
        let holders = || Arc::strong_count(&work[1].0.pattern);
        let begun = |mut worker: DeviceWorker| {
            let (before, mut found) = (holders(), Vec::new());
            worker.trace_all(&work, &mut |done| {
                done.unwrap();
                found.push(holders() > before);
            });
            found
        };
        let rays = RayQueryDevice { context: context.clone(), required: true };
        let single = Traversal::SingleRay.into();
        let queries = DeviceWorker::with_hardware_rays(device, &data, &rays, single).unwrap();
        assert_eq!(begun(queries), [false, true]);
        // The kernels' rays wait in the queue: both views begin before any is waited for.
        assert_eq!(begun(DeviceWorker::new(device, &data, single, true).unwrap()), [true, true]);
    });
}
