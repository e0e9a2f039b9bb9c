use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat4, DVec2, DVec3};

use super::*;
use crate::bvh::WideBvh;
use crate::config::EnvironmentConfig;
use crate::foveation::Law;
use crate::foveation::spaced;
use crate::frame::load::environment;
use crate::gpu::opencl::device;
use crate::layout::SampleRecord;
use crate::math::view::FieldOfView;
use crate::reference::{self, known::Sees};
use crate::scene::animation::{self, Motion};
use crate::scene::generate::demo;
use crate::scene::viewpoint::default_viewpoint;

/// Hits of all pixels, traced in blocks, and of the same pixels as samples, traced in streams.
fn hits_both_ways(tracer: &mut Tracer, view: &View, settings: Settings) -> (Vec<HitRecord>, Vec<HitRecord>) {
    let all = Pattern::new(view, &Law::default(), DVec2::splat(0.5), view.pixels());
    assert_eq!(all.samples.len(), view.pixels());
    let pattern = tracer.pattern(&all).unwrap();
    let samples = Buffer::new(&tracer.device, view.pixels()).unwrap();
    let visibility = Buffer::new(&tracer.device, view.pixels()).unwrap();

    let guided = Settings { guided: true, ..settings };
    let work = tracer.enqueue(view, &guided, &pattern, &samples, Some(&visibility)).unwrap();
    tracer.finish(work).unwrap();
    let blocks = tracer.hits.to_vec().unwrap();
    let work = tracer.enqueue(view, &settings, &pattern, &samples, None).unwrap();
    tracer.finish(work).unwrap();
    let by_sample = tracer.hits.to_vec().unwrap();
    let mut streams = blocks.clone();
    for (&at, &hit) in all.samples.iter().zip(&by_sample) {
        streams[((at >> 16) * view.width + (at & 0xffff)) as usize] = hit;
    }
    (blocks, streams)
}

/// The scene's default view, with a ragged edge of blocks, straight and turned and jittered.
fn check(scene: &Scene) {
    let Some(info) = device::list().into_iter().next() else {
        println!("not run: there is no OpenCL device");
        return;
    };
    let device = Device::open(&info).unwrap();
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let (light, _) = environment(&EnvironmentConfig::default(), 0.0).unwrap();
    let mut tracer = Tracer::new(&device, scene, &bvh, &light).unwrap();
    let eye = default_viewpoint(scene, 70.0).world_from_eye;
    for (turn, jitter) in [(0.0, false), (0.9, true)] {
        let mut world_from_eye = eye;
        world_from_eye.rotation =
            eye.rotation * glam::DQuat::from_rotation_y(turn) * glam::DQuat::from_rotation_z(turn);
        let (width, height) = (317, 203);
        let fov = FieldOfView::symmetric(1.2, f64::from(width) / f64::from(height));
        let view = View { world_from_eye, fov, width, height, spacing: Default::default() };
        let settings = Settings {
            rays: 1,
            bounces: 0,
            cached: false,
            edge_rays: 0,
            guided: false,
            seed: 5,
            jitter,
            fewer_rays: None,
            turn: Turn::ALL,
            turn_in_motion: Turn::ALL,
        };
        let (blocks, streams) = hits_both_ways(&mut tracer, &view, settings);
        assert!(blocks.iter().filter(|hit| hit.triangle != u32::MAX).count() > view.pixels() / 4);
        for (pixel, (block, stream)) in blocks.iter().zip(&streams).enumerate() {
            let place = (pixel % width as usize, pixel / width as usize);
            assert_eq!(block.t.to_bits(), stream.t.to_bits(), "{place:?}: {block:?} and {stream:?}");
            // Two triangles hit at one distance share the point.
            assert_eq!(block.triangle == u32::MAX, stream.triangle == u32::MAX, "{place:?}");
        }
        // A triangle that the tree cut has several places.
        let name = |hit: &HitRecord| bvh.order.get(hit.triangle as usize).map(|place| place.triangle);
        let same = blocks.iter().zip(&streams).filter(|(b, s)| name(b) == name(s)).count();
        assert!(same * 1000 >= view.pixels() * 999, "{same} triangles of {} are the same", view.pixels());
    }
}

/// Hits of what no device part traced are marked, and kernels that read them all the same follow none.
#[test]
fn hits_that_were_not_traced_are_marked_and_never_followed() {
    let Some(info) = device::list().into_iter().next() else {
        println!("not run: there is no OpenCL device");
        return;
    };
    let device = Device::open(&info).unwrap();
    let scene = Scene::from_glb(Path::new("demo.glb"), &demo::generate()).unwrap();
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let (light, _) = environment(&EnvironmentConfig::default(), 0.0).unwrap();
    let mut tracer = Tracer::new(&device, &scene, &bvh, &light).unwrap();
    let fov = FieldOfView::symmetric(1.2, 2.0);
    let world_from_eye = default_viewpoint(&scene, 70.0).world_from_eye;
    let view = View { world_from_eye, fov, width: 128, height: 64, spacing: Default::default() };
    let pattern = tracer.pattern(&Pattern::new(&view, &Law::Full, DVec2::splat(0.5), view.pixels())).unwrap();
    let samples = Buffer::new(&device, view.pixels()).unwrap();
    let records = Buffer::changing(&device, &vec![VisibilityRecord::default(); view.pixels()]).unwrap();
    let settings = Settings {
        rays: 4,
        bounces: 0,
        cached: false,
        edge_rays: 2,
        guided: true,
        seed: 5,
        jitter: false,
        fewer_rays: None,
        turn: Turn::ALL,
        turn_in_motion: Turn::ALL,
    };
    // Neither tiles nor their ring: edges and samples are asked for what nobody has traced.
    tracer.hits = untraced(&device, view.pixels()).unwrap();
    let camera = camera(&view, tracer.anchor, &settings);
    let shading = layout::Shading {
        guided: 1,
        hits_per_pixel: 1,
        rays: 4,
        fewer_rays: 4,
        looking: 1,
        fewer_looking: 1,
        ..tracer.scene.shading
    };
    tracer.share_edges(&camera, 2, &pattern, &pattern.whole, &records).unwrap();
    let past = (&camera, None);
    tracer.shade(None, &camera, &shading, &pattern, &pattern.whole, Some(&records), &samples, past).unwrap();
    device.finish().unwrap();
    assert!(samples.to_vec().unwrap().iter().all(|sample| sample.depth == 0.0));
    // A part leaves the rest as it was.
    let part = Part { samples: 0..0, tiles: 0..1, first_traced: 0 };
    let work =
        tracer.enqueue_parts(&view, &settings, &pattern, &[part], (&samples, Some(&records)), None).unwrap();
    tracer.finish(work).unwrap();
    let hits = tracer.hits(view.pixels()).unwrap();
    let marked = hits.iter().filter(|hit| hit.triangle == UNTRACED).count();
    assert!((view.pixels() / 2..view.pixels() - 256 + 1).contains(&marked), "{marked}");
    let known = |hit: &&HitRecord| hit.triangle < UNTRACED && hit.triangle as usize >= bvh.order.len();
    assert_eq!(hits.iter().find(known), None);
}

/// Samples that wait for their turn have what their pixels see and no light, but where that is another surface than before;
/// the others are what they are without turns.
#[test]
fn samples_wait_for_their_turn_where_they_see_what_they_saw() {
    let Some(info) = device::list().into_iter().next() else {
        println!("not run: there is no OpenCL device");
        return;
    };
    let device = Device::open(&info).unwrap();
    let scene = Scene::from_glb(Path::new("demo.glb"), &demo::generate()).unwrap();
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let (light, _) = environment(&EnvironmentConfig::default(), 0.0).unwrap();
    let features = Features::required_by(&scene, &light);
    let world_from_eye = default_viewpoint(&scene, 70.0).world_from_eye;
    let fov = FieldOfView::symmetric(1.2, 1.5);
    let view = View { world_from_eye, fov, width: 96, height: 64, spacing: Default::default() };
    let mut aside = view;
    aside.world_from_eye.position += world_from_eye.rotation * DVec3::new(0.1, 0.0, 0.0);
    let all = Pattern::new(&view, &Law::default(), DVec2::splat(0.5), view.pixels());
    for traversal in [Traversal::Packet, Traversal::SingleRay] {
        let mut tracer = Tracer::with_features(&device, &scene, &bvh, &light, &features, traversal).unwrap();
        let pattern = tracer.pattern(&all).unwrap();
        let samples = Buffer::new(&device, view.pixels()).unwrap();
        let visibility = Buffer::new(&device, view.pixels()).unwrap();
        let mut traced = |view: &View, turn: Turn| -> Vec<(SampleRecord, VisibilityRecord)> {
            let settings = Settings {
                rays: 4,
                bounces: 0,
                cached: false,
                edge_rays: 0,
                guided: true,
                seed: 5,
                jitter: false,
                fewer_rays: None,
                turn,
                turn_in_motion: Turn::ALL,
            };
            let work = tracer.enqueue(view, &settings, &pattern, &samples, Some(&visibility)).unwrap();
            tracer.finish(work).unwrap();
            let seen = visibility.to_vec().unwrap();
            let pixel = |&at: &u32| seen[((at >> 16) * view.width + (at & 0xffff)) as usize];
            samples.to_vec().unwrap().into_iter().zip(all.samples.iter().map(pixel)).collect()
        };
        let (whole, turn) = (traced(&view, Turn::ALL), Turn { number: 1, of: 3 });
        let some = traced(&view, turn);
        let waits = |index: usize| index as u32 / layout::TURN_SAMPLES % 3 != 1;
        for (index, ((was, _), (is, seen))) in whole.iter().zip(&some).enumerate() {
            if !waits(index) {
                assert_eq!(bytemuck::bytes_of(is), bytemuck::bytes_of(was), "{traversal:?}, sample {index}");
                continue;
            }
            let (first, second, depth) = ([0.0; 3], [0.0; 3], -seen.depth);
            let marked = SampleRecord { first, second, depth, toward: [layout::SAMPLE_REUSES, 0, 0], ..*is };
            assert_eq!(*is, marked, "{traversal:?}, sample {index}");
            let alike = (is.normal & 0xff_ffff, is.reflected) == (seen.normal & 0xff_ffff, seen.reflected);
            assert!(alike && is.normal >> 25 == 0, "{traversal:?}, sample {index}: {is:?} {seen:?}");
        }
        // From a step aside other surfaces are seen by some: these are shaded.
        let (mut new, mut still_wait) = (0, 0);
        for (index, ((_, before), (is, now))) in some.iter().zip(traced(&aside, turn)).enumerate() {
            let waits_now = is.toward[0] & layout::SAMPLE_REUSES != 0;
            assert!(waits(index) || !waits_now, "{traversal:?}, sample {index}");
            let other = before.depth > 1.5 * now.depth || now.depth > 1.5 * before.depth;
            new += usize::from(waits(index) && other);
            still_wait += usize::from(waits_now && now.depth > 0.0);
            assert!(!(other && waits_now), "{traversal:?}, sample {index}: {before:?} {now:?}");
        }
        assert!(new > 50 && still_wait > 500, "{traversal:?}: {new} see another surface, {still_wait} wait");
    }
}

/// Some of a mesh as a part that moves.
fn moves(triangles: Range<usize>) -> Motion {
    let (geometry, local) = (Arc::default(), DMat4::IDENTITY);
    Motion {
        parts: vec![animation::Part { geometry, node: 0, local, vertices: 0..0, triangles }],
        ..Motion::default()
    }
}

/// In motion samples are sent fewer rays whose surfaces the frame before has seen, as the reference in `f64` has it, and not where
/// they move by themselves; all find the light that so many rays find.
#[test]
fn samples_whose_surfaces_were_seen_are_sent_fewer_rays() {
    let Some(info) = device::list().into_iter().next() else {
        println!("not run: there is no OpenCL device");
        return;
    };
    let device = Device::open(&info).unwrap();
    let mut scene = Scene::from_glb(Path::new("demo.glb"), &demo::generate()).unwrap();
    // The last third of its triangles is told to move by itself, and does not.
    let triangles = scene.mesh.triangles.len();
    scene.motion = Some(moves(2 * triangles / 3..triangles).into());
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let (light, _) = environment(&EnvironmentConfig::default(), 0.0).unwrap();
    let features = Features::required_by(&scene, &light);
    let fov = FieldOfView::symmetric(1.2, 1.5);
    let world_from_eye = default_viewpoint(&scene, 70.0).world_from_eye;
    let even = View { world_from_eye, fov, width: 192, height: 128, spacing: Default::default() };
    // Two gazes, so that pixels of both frames are other ones.
    let seen_from = |gaze: DVec2, turn: f64, aside: f64| {
        let mut view = spaced(&even, gaze, 0.3, 1.0);
        assert!(!view.spacing.is_even());
        let eye = &mut view.world_from_eye;
        eye.position += eye.rotation * DVec3::new(aside, 0.0, 0.0);
        eye.rotation *= glam::DQuat::from_rotation_y(turn);
        view
    };
    let (before, now) =
        (seen_from(DVec2::new(0.4, 0.5), 0.0, 0.0), seen_from(DVec2::new(0.55, 0.5), 0.12, 0.02));
    for traversal in [Traversal::Packet, Traversal::SingleRay] {
        let mut tracer = Tracer::with_features(&device, &scene, &bvh, &light, &features, traversal).unwrap();
        let mut past = None;
        let mut traced = |view: &View,
                          (rays, fewer_rays): (u32, Option<u32>),
                          past: Option<&mut Option<Past>>,
                          turn_in_motion| {
            let all = Pattern::new(view, &Law::default(), DVec2::splat(0.5), view.pixels() / 2);
            let pattern = tracer.pattern(&all).unwrap();
            let samples = Buffer::new(&device, all.samples.len()).unwrap();
            let visibility = Buffer::new(&device, view.pixels()).unwrap();
            let settings = Settings {
                rays,
                bounces: 0,
                cached: false,
                edge_rays: 0,
                guided: true,
                seed: 5,
                jitter: false,
                fewer_rays,
                turn: Turn::ALL,
                turn_in_motion,
            };
            let (parts, records) = (std::slice::from_ref(&pattern.whole), (&samples, Some(&visibility)));
            let work = tracer.enqueue_parts(view, &settings, &pattern, parts, records, past).unwrap();
            let done = tracer.finish(work).unwrap();
            (all.samples, samples.to_vec().unwrap(), visibility.to_vec().unwrap(), done.rays)
        };
        let first = traced(&before, (64, Some(32)), Some(&mut past), Turn::ALL);
        let whole = traced(&before, (64, None), None, Turn::ALL);
        assert!(
            first.1 == whole.1 && first.3 == whole.3,
            "{traversal:?}: nothing was seen before the first frame"
        );
        let (_, _, old, _) = whole;
        let (places, some, seen, rays) = traced(&now, (64, Some(32)), Some(&mut past), Turn::ALL);
        let (_, all, _, all_rays) = traced(&now, (64, None), None, Turn::ALL);
        let (_, few, _, few_rays) = traced(&now, (32, None), None, Turn::ALL);
        traced(&before, (64, Some(32)), Some(&mut past), Turn::ALL);
        let turn = Turn { number: 1, of: 2 };
        let (_, in_turn, _, turn_rays) = traced(&now, (64, Some(32)), Some(&mut past), turn);
        assert!(turn_rays < rays, "{traversal:?}: {turn_rays} {rays}");
        assert!(few_rays < rays && rays < all_rays, "{traversal:?}: {few_rays} {rays} {all_rays}");
        let distance = |[x, y]: [u32; 2]| {
            let record = old[(y * before.width + x) as usize];
            let length = before.eye_direction(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5)).length();
            (record.depth > 0.0).then(|| f64::from(record.depth) * length)
        };
        let (mut known, mut unknown, mut undecided, mut moving, mut waiting) = (0, 0, 0, 0, 0);
        for (index, (&at, record)) in places.iter().zip(&some).enumerate() {
            let pixel = seen[((at >> 16) * now.width + (at & 0xffff)) as usize];
            let sees = Sees {
                at: [at & 0xffff, at >> 16],
                depth: pixel.depth.into(),
                normal: DVec3::from(layout::unpack_normal24(pixel.normal).map(f64::from)),
                roughness: f64::from(layout::unpack_surface([pixel.base, pixel.surface]).2),
            };
            let reuses = record.toward[0] & layout::SAMPLE_REUSES != 0;
            let moves = pixel.mapped & layout::SURFACE_MOVES != 0;
            moving += usize::from(moves);
            let clear = reference::known::known(&now, &before, &sees, distance).filter(|_| !moves);
            let is_decided = clear.is_none_or(|clear| clear.abs() > 0.05);
            undecided += usize::from(!is_decided || reuses != clear.is_some_and(|clear| clear >= 0.0));
            *(if reuses { &mut known } else { &mut unknown }) += 1;
            let mut alike = if reuses { few[index] } else { all[index] };
            alike.toward[0] |= if reuses { layout::SAMPLE_REUSES } else { 0 };
            assert_eq!(*record, alike, "{traversal:?}, sample {index}");
            let waits = reuses && index as u32 / layout::TURN_SAMPLES % turn.of != turn.number;
            waiting += usize::from(waits);
            match waits {
                true => assert!(
                    in_turn[index].depth == -pixel.depth
                        && in_turn[index].first == [0.0; 3]
                        && in_turn[index].toward == [layout::SAMPLE_REUSES, 0, 0],
                    "{traversal:?}, sample {index}"
                ),
                false => assert_eq!(in_turn[index], *record, "{traversal:?}, sample {index}"),
            }
        }
        assert!(moving > places.len() / 20, "{traversal:?}: {moving}");
        assert!(
            5 * waiting > 2 * known && 5 * waiting < 3 * known,
            "{traversal:?}: {waiting} of {known} wait"
        );
        println!(
            "{traversal:?}: {known} are known, {unknown} not, {moving} move, {undecided} differ from the reference or are close"
        );
        // A pixel whose point lies at its border is another one by rounding.
        assert!(known > places.len() / 4 && unknown > places.len() / 20, "{traversal:?}: {known} {unknown}");
        assert!(undecided * 50 < places.len(), "{traversal:?}: {undecided} of {}", places.len());
    }
}

/// Each view has the rays of its own and of the steps of the cache before it, whoever else is in the queue.
#[test]
fn rays_are_counted_for_the_view_that_sends_them() {
    let Some(info) = device::list().into_iter().next() else {
        println!("not run: there is no OpenCL device");
        return;
    };
    let device = Device::open(&info).unwrap();
    let scene = Scene::from_glb(Path::new("demo.glb"), &demo::generate()).unwrap();
    let bvh = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let (light, _) = environment(&EnvironmentConfig::default(), 0.0).unwrap();
    let mut tracer = Tracer::new(&device, &scene, &bvh, &light).unwrap();
    let fov = FieldOfView::symmetric(1.2, 2.0);
    let world_from_eye = default_viewpoint(&scene, 70.0).world_from_eye;
    let view = View { world_from_eye, fov, width: 128, height: 64, spacing: Default::default() };
    let pattern = tracer.pattern(&Pattern::new(&view, &Law::Full, DVec2::splat(0.5), view.pixels())).unwrap();
    let samples = Buffer::new(&device, view.pixels()).unwrap();
    // Rays without bounces, and whether they meet anything, do not depend on what the cache knows.
    let settings = Settings {
        rays: 4,
        bounces: 0,
        cached: false,
        edge_rays: 0,
        guided: false,
        seed: 5,
        jitter: false,
        fewer_rays: None,
        turn: Turn::ALL,
        turn_in_motion: Turn::ALL,
    };
    let mut traced = |steps: &[u64]| {
        let mut begun = Vec::new();
        let mut step = 0;
        for &count in steps {
            for _ in 0..count {
                step += 1;
                tracer.update_light(&view, &settings, &pattern, step).unwrap();
            }
            begun.push(tracer.enqueue(&view, &settings, &pattern, &samples, None).unwrap());
        }
        let done: Vec<Traced> = begun.into_iter().map(|work| tracer.finish(work).unwrap()).collect();
        done.iter().map(|done| (done.rays, done.light_rays, done.dropped)).collect::<Vec<_>>()
    };
    let (alone, rays) = (traced(&[0])[0], view.pixels() as u64);
    assert!(alone.0 > rays && alone.1 == 0 && alone.2 == 0, "{alone:?}");
    let found = traced(&[0, 2, 0, 1, 1]);
    let least = |steps: u64| steps * 3072..steps * 3072 * 64;
    assert!(found.iter().all(|found| (found.0, found.2) == (alone.0, 0)), "{found:?} beside {alone:?}");
    assert!([0, 2].iter().all(|&without| found[without].1 == 0), "{found:?}");
    assert!(
        [(1, 2), (3, 1), (4, 1)].iter().all(|&(at, steps)| least(steps).contains(&found[at].1)),
        "{found:?}"
    );
    assert!(found[1].1 * 2 > found[3].1 * 3, "two steps send more rays than one: {found:?}");
}

#[test]
fn blocks_hit_what_streams_hit_in_the_demo_scene() {
    check(&Scene::from_glb(Path::new("demo.glb"), &demo::generate()).unwrap());
}

#[test]
fn blocks_hit_what_streams_hit_in_sponza() {
    let root = std::env::var_os("FOVEATE_TEST_DATA")
        .map_or_else(|| PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../shared/data"), PathBuf::from);
    let path = root.join("scenes/sponza/Sponza.gltf");
    if !path.exists() {
        println!("not run: {} is not there; set FOVEATE_TEST_DATA to the test data", path.display());
        return;
    }
    check(&Scene::load(&path).unwrap());
}
