//! Rays that ray queries trace through scenes that move, against those of the kernels at the same instants: instances that are
//! placed, parts that the host or the device deforms, what is hidden, mirrored or flattened for a while, and whole frames.

use std::ops::Range;

use foveate::config::{Config, DeformConfig, HardwareRaysConfig, Samples};
use foveate::foveation::Pattern;
use foveate::frame::{Loaded, Output, Plan, Renderer};
use foveate::gpu::opencl::Device;
use foveate::gpu::vulkan::Context;
use foveate::layout::HitRecord;
use foveate::math::view::View;
use foveate::scene::animation::Part;
use foveate::scene::{AlphaMode, Instancing};
use foveate::trace::DeformedBy::{Devices, Host};
use foveate::trace::{DeformedBy, MovingScene, SceneData, SceneState, Settings, Tracer, Traversal};
use glam::DVec3;

use crate::bench::{Bench, PLAIN, Picture, all_pixels, view};
use crate::common::builder::Builder;
use crate::common::moving::{balls, blinking_world, mirroring_world, world_of_blinking_tube, world_of_two};
use crate::guided::light;
use crate::hardware::{differ, on_shared_memory};
use crate::variants::{alike, mirrored_apart};

/// 32 rays a sample, and what the sun does to pixels.
const GUIDED: Settings = Settings { guided: true, ..PLAIN };

fn load(world: Builder, instancing: Instancing) -> Loaded {
    let folder = tempfile::tempdir().unwrap();
    let mut config = Config::default();
    config.scene.animation = "all".into();
    config.scene.instancing = instancing;
    Loaded::moving_from_file(&world.write_glb(folder.path()), &config).unwrap()
}

/// A scene that moves, traced both ways.
struct Both {
    scene: MovingScene,
    /// By the kernels, and by ray queries.
    benches: [Bench; 2],
    view: View,
    pattern: Pattern,
    settings: Settings,
    name: String,
}

impl Both {
    fn new((device, context): (&Device, &Context), loaded: &Loaded, by: DeformedBy, name: &str) -> Self {
        let parted = loaded.parted.as_ref().unwrap();
        let scene = MovingScene::new(&loaded.scene, loaded.trees(), parted, by).unwrap();
        let mut data = SceneData::pack(&loaded.scene, loaded.trees(), &light()).unwrap();
        data.depth = loaded.depth();
        let kernels = Tracer::open(device, &data, Traversal::SingleRay.into()).unwrap();
        let queries = Tracer::with_hardware_rays(device, &data, context).unwrap();
        let benches = [kernels, queries].map(|tracer| Bench::of(device, tracer));
        let (low, high) = loaded.scene.bounds().unwrap();
        let middle = (low + high).as_dvec3() * 0.5 + loaded.scene.anchor;
        let eye = middle + DVec3::new(2.0, 3.0, 9.0);
        let view = view(eye, middle, 60.0, (160, 120));
        Both { scene, benches, view, pattern: all_pixels(&view), settings: GUIDED, name: name.into() }
    }

    /// What both find where the scene is at a time, which is held to be the same.
    fn at(&mut self, time: f64) -> [Picture; 2] {
        let state = self.scene.at(time);
        self.of(&state, time)
    }

    fn of(&mut self, state: &SceneState, time: f64) -> [Picture; 2] {
        let pictures = self.benches.each_mut().map(|bench| {
            bench.move_to(state);
            bench.trace(&self.view, &self.settings, &self.pattern)
        });
        self.agree(&pictures, &format!("{} at {time}", self.name));
        pictures
    }

    fn agree(&self, [kernels, queries]: &[Picture; 2], name: &str) {
        let pixels = self.view.pixels();
        let off = differing(&kernels.hits, &queries.hits);
        let named = kernels.hits.iter().zip(&queries.hits).filter(|(a, b)| a.triangle == b.triangle).count();
        let hits = kernels.hits.iter().filter(|hit| hit.triangle != u32::MAX).count();
        let lit = kernels.samples.iter().filter(|record| record.depth > 0.0).count();
        let samples = kernels.samples.iter().zip(&queries.samples).filter(|(a, b)| !alike(a, b)).count();
        let seen = kernels.visibility.iter().zip(&queries.visibility);
        let described = seen.filter(|(a, b)| a.normal != b.normal || a.reflected != b.reflected).count();
        println!(
            "{name}: {off} of {pixels} camera rays differ, {hits} hits, {} of other names; {samples} of {lit} samples \
             and {described} pixels",
            pixels - named
        );
        assert!(hits * 6 > pixels && off * 2000 <= pixels, "{name}: {off} of {pixels} differ");
        assert!((pixels - named) * 500 <= pixels, "{name}: {named} have the same name");
        assert!(lit * 6 > pixels && samples * 50 <= lit, "{name}: {samples} of {lit} samples differ");
        assert!(described * 200 <= pixels, "{name}: {described} pixels differ");
    }
}

fn differing(a: &[HitRecord], b: &[HitRecord]) -> usize {
    a.iter().zip(b).filter(|(a, b)| differ(a, b)).count()
}

/// How many hits are of these triangles.
fn hits_of(picture: &Picture, triangles: &Range<u32>) -> usize {
    picture.hits.iter().filter(|hit| triangles.contains(&hit.triangle)).count()
}

/// What hits call the triangles of what keeps its form: those of the first such part, or of all instances.
fn rigid(loaded: &Loaded) -> Range<u32> {
    let instances = loaded.bvh.order.len() as u32..u32::MAX;
    places(loaded, |part| part.geometry.skin.is_none()).unwrap_or(instances)
}

/// What hits call the triangles of the first such part, if there is one.
fn places(loaded: &Loaded, is_it: impl Fn(&Part) -> bool) -> Option<Range<u32>> {
    let (motion, parted) = (loaded.scene.motion.as_ref().unwrap(), loaded.parted.as_ref().unwrap());
    let own = &parted.parts[motion.parts.iter().position(is_it)?];
    Some(own.first_place as u32..(own.first_place + own.order.len()) as u32)
}

const EITHER_WAY: [(Instancing, DeformedBy); 3] =
    [(Instancing::Flat, Host), (Instancing::Flat, Devices), (Instancing::Shared, Devices)];

/// A tube of joints and morph targets, and boxes that turn, slide, and shrink to nothing; and back to where they were.
#[test]
fn what_moves_is_hit_where_the_kernels_hit_it() {
    on_shared_memory(|device, context| {
        for (instancing, by) in EITHER_WAY {
            let loaded = load(world_of_two(false), instancing);
            let instances = loaded.scene.motion.as_ref().unwrap().rigid.len();
            assert_eq!(instances, if instancing == Instancing::Shared { 2 } else { 0 });
            let mut both = Both::new((device, context), &loaded, by, &format!("{instancing:?}, {by:?}"));
            let found = [0.0, 0.6, 1.2, 1.75, 0.0].map(|time| both.at(time));
            let queries = found.each_ref().map(|[_, queries]| &queries.hits);
            for pair in queries.windows(2) {
                let moved = differing(pair[0], pair[1]);
                assert!(moved * 50 > both.view.pixels(), "{moved} pixels see something else");
            }
            assert_eq!(differing(queries[0], queries[4]), 0, "it is not where it was");
        }
    });
}

/// Rays pass what is hidden, and shadows with it.
#[test]
fn what_is_hidden_is_not_hit() {
    on_shared_memory(|device, context| {
        for instancing in [Instancing::Flat, Instancing::Shared] {
            let loaded = load(blinking_world(false), instancing);
            let own = rigid(&loaded);
            let mut both = Both::new((device, context), &loaded, Host, &format!("{instancing:?}"));
            for (time, is_seen) in [(1.0, false), (0.2, true), (0.9, false), (1.8, true)] {
                let counts = both.at(time).map(|picture| hits_of(&picture, &own));
                assert!(counts.iter().all(|&count| (count > 100) == is_seen), "{time}: {counts:?}");
                assert!(is_seen || counts == [0; 2], "{time}: {counts:?}");
            }
        }
    });
}

/// The same of what is deformed, whoever does that: meanwhile it moves on.
#[test]
fn what_is_deformed_and_hidden_is_not_hit() {
    on_shared_memory(|device, context| {
        for by in [Host, Devices] {
            let loaded = load(world_of_blinking_tube(), Instancing::Flat);
            let own = places(&loaded, |part| part.geometry.skin.is_some()).unwrap();
            let mut both = Both::new((device, context), &loaded, by, &format!("{by:?}"));
            for (time, is_seen) in [(0.2, true), (1.0, false), (1.8, true), (0.9, false), (1.6, true)] {
                let counts = both.at(time).map(|picture| hits_of(&picture, &own));
                assert!(counts.iter().all(|&count| (count > 100) == is_seen), "{by:?} {time}: {counts:?}");
                assert!(is_seen || counts == [0; 2], "{by:?} {time}: {counts:?}");
            }
        }
    });
}

/// What motion turns inside out is seen from its other side.
#[test]
fn what_is_mirrored_has_its_fronts_where_the_kernels_see_them() {
    on_shared_memory(|device, context| {
        for instancing in [Instancing::Flat, Instancing::Shared] {
            let loaded = load(mirroring_world(), instancing);
            assert!(loaded.scene.materials.iter().all(|material| !material.double_sided));
            let own = rigid(&loaded);
            let mut both = Both::new((device, context), &loaded, Host, &format!("{instancing:?}"));
            for time in [0.3, 1.3, 0.3] {
                let counts = both.at(time).map(|picture| hits_of(&picture, &own));
                assert!(counts.iter().all(|&count| count > 100), "{time}: {counts:?}");
            }
        }
    });
}

/// Moving things that let some rays pass, seen from both sides.
#[test]
fn what_moves_and_has_alpha_is_left_to_the_kernels() {
    on_shared_memory(|device, context| {
        for instancing in [Instancing::Flat, Instancing::Shared] {
            let mut loaded = load(world_of_two(false), instancing);
            let material = &mut loaded.scene.materials[0];
            (material.alpha, material.base_color.w, material.double_sided) = (AlphaMode::Blend, 0.5, true);
            let own = rigid(&loaded);
            let mut both = Both::new((device, context), &loaded, Host, &format!("{instancing:?}"));
            for time in [0.0, 1.2] {
                let counts = both.at(time).map(|picture| hits_of(&picture, &own));
                assert!(counts.iter().all(|&count| count > 50), "{time}: {counts:?}");
            }
        }
    });
}

/// All of it is metal that mirrors: things that are elsewhere at each instant show each other, as far as the sun reaches them.
#[test]
fn mirrors_that_move_show_what_moves() {
    on_shared_memory(|device, context| {
        for instancing in [Instancing::Flat, Instancing::Shared] {
            let mut loaded = load(world_of_two(false), instancing);
            for material in &mut loaded.scene.materials {
                (material.metallic, material.roughness) = (1.0, 0.02);
            }
            let mut both = Both::new((device, context), &loaded, Host, &format!("mirrors, {instancing:?}"));
            both.settings = Settings { bounces: 1, rays: 8, ..GUIDED };
            let [first, last] = [0.0, 1.2].map(|time| both.at(time)[1].visibility.clone());
            let (apart, shown) = mirrored_apart(&first, &last);
            assert!(shown * 6 > both.view.pixels() && apart * 5 > shown, "{apart} of {shown} have changed");
        }
    });
}

/// A part that has another tree has its triangles at other places.
#[test]
fn hits_have_the_names_of_trees_that_are_built_anew() {
    on_shared_memory(|device, context| {
        for by in [Host, Devices] {
            let loaded = load(world_of_two(false), Instancing::Flat);
            let mut both = Both::new((device, context), &loaded, by, &format!("{by:?}"));
            let mut state = both.scene.at(0.0);
            for step in 1..130 {
                state = both.scene.at(f64::from(step) * 0.01);
                both.benches.iter_mut().for_each(|bench| bench.move_to(&state));
            }
            assert!(both.scene.is_rebuilt());
            both.of(&state, 1.29);
        }
    });
}

/// Many things that move by themselves, each a bottom level or an instance of one.
#[test]
fn many_moving_things_are_hit_where_the_kernels_hit_them() {
    on_shared_memory(|device, context| {
        for instancing in [Instancing::Flat, Instancing::Shared] {
            let loaded = load(balls(64), instancing);
            let mut both = Both::new((device, context), &loaded, Host, &format!("64 balls, {instancing:?}"));
            for time in [0.4, 2.1] {
                both.at(time);
            }
        }
    });
}

/// Frames, by the settings.
#[test]
fn frames_of_what_moves_are_those_of_the_kernels() {
    on_shared_memory(|device, context| {
        let loaded = load(world_of_two(true), Instancing::Shared);
        let (low, high) = loaded.scene.bounds().unwrap();
        let middle = (low + high).as_dvec3() * 0.5 + loaded.scene.anchor;
        let eye = middle + DVec3::new(3.0, 4.0, 9.0);
        let plan = Plan::mono(view(eye, middle, 60.0, (128, 128)));
        for deform in [DeformConfig::Host, DeformConfig::Device] {
            let [kernels, queries] = [HardwareRaysConfig::Off, HardwareRaysConfig::On].map(|by| {
                let mut config = Config::default();
                config.foveation.samples = Samples::Count(3000);
                (config.trace.hardware_rays, config.trace.deform) = (by, deform);
                config.trace.traversal = Traversal::SingleRay.into();
                let mut renderer =
                    Renderer::new(device, context, &loaded, &config, Output::Display).unwrap().0;
                let pictures = [0.2, 0.9, 1.75].map(|seconds| {
                    renderer.show_at(seconds);
                    assert_eq!(renderer.frame(&plan, &[], 1).unwrap().dropped, 0);
                    renderer.picture().unwrap()
                });
                assert_eq!(renderer.take_notes(), Vec::<String>::new());
                pictures
            });
            let above = |a: &[u8], b: &[u8], limit: u8| {
                let apart = |(a, b): (&[u8], &[u8])| a.iter().zip(b).any(|(a, b)| a.abs_diff(*b) > limit);
                a.chunks_exact(4).zip(b.chunks_exact(4)).filter(|pair| apart(*pair)).count()
            };
            let pixels = kernels[0].len() / 4;
            let moved = above(&queries[0], &queries[1], 8);
            assert!(moved * 20 > pixels, "{moved} of {pixels} pixels have changed");
            for (kernels, queries) in kernels.iter().zip(&queries) {
                let told = [0, 8, 32].map(|limit| above(kernels, queries, limit));
                println!("{deform:?}: of {pixels} pixels {told:?} differ by more than 0, 8 and 32 of 255");
                assert!(told[1] * 100 <= pixels && told[2] * 1000 <= pixels, "{told:?}");
            }
        }
    });
}
