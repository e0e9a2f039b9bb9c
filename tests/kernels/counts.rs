//! What single rays visit, as the benchmark of busy lanes has it counted.

use foveate::bench::simt::{AT_NODE, AT_TRIANGLE};
use foveate::bvh::{TreeFor, WideBvh};
use foveate::reference::Random;
use foveate::trace::Traversal;
use foveate::trace::probe::{Bundles, CountingProbe, Probe, RayKind};
use glam::Vec3;

use crate::bench::on_every_device;
use crate::scenes::{on_sphere, shape, soup};

/// 32 rays from a point towards points.
fn bundle(from: Vec3, mut towards: impl FnMut(usize) -> Vec3) -> Bundles {
    let directions = (0..32).map(|ray| (towards(ray) - from).normalize().to_array()).collect();
    Bundles { origins: vec![from.to_array()], directions }
}

#[test]
fn a_lone_triangle_is_tested_by_the_rays_that_enter_its_box() {
    let scene = shape([[Vec3::ZERO, Vec3::X, Vec3::new(0.0, 1.0, 0.2)]]);
    let tree = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    // Through the triangle, through the other half of its box, and past it.
    let places = [Vec3::new(0.2, 0.2, 0.05), Vec3::new(0.9, 0.9, 0.1), Vec3::new(3.0, 0.2, 0.0)];
    let bundles = bundle(Vec3::new(0.1, 0.1, 5.0), |ray| places[ray % 3]);
    on_every_device(|device| {
        let mut counting = CountingProbe::new(device, &scene, &tree).unwrap();
        counting.probe.send(&bundles).unwrap();
        for nearest in [false, true] {
            let steps = counting.steps(nearest).unwrap();
            // At the root, and at the triangle in the same step.
            let expected: Vec<Vec<u8>> =
                (0..32).map(|ray| vec![AT_NODE | if ray % 3 < 2 { AT_TRIANGLE } else { 0 }]).collect();
            assert_eq!(steps, expected, "nearest {nearest}");
        }
    });
}

#[test]
fn rays_that_ask_for_any_hit_visit_no_more_and_what_is_counted_is_traced() {
    let scene = soup(8, 900, 0.4);
    let mut random = Random::new(8);
    let tree = WideBvh::build(&scene.mesh.positions, &scene.mesh.triangles);
    let aims: Vec<Vec3> = (0..32).map(|_| on_sphere(&mut random).as_vec3() * 9.0).collect();
    let bundles = bundle(Vec3::new(0.1, 0.2, 0.3), |ray| aims[ray]);
    on_every_device(|device| {
        let mut counting = CountingProbe::new(device, &scene, &tree).unwrap();
        let mut plain = Probe::new(device, &scene, &tree, Traversal::SingleRay).unwrap();
        for probe in [&mut counting.probe, &mut plain] {
            probe.send(&bundles).unwrap();
            probe.trace(RayKind::Bounce).unwrap();
        }
        assert_eq!(
            counting.probe.hits(RayKind::Bounce).unwrap(),
            plain.hits(RayKind::Bounce).unwrap(),
            "counting changes no hit"
        );
        let [any, nearest] = [false, true].map(|nearest| counting.steps(nearest).unwrap());
        for (ray, (any, nearest)) in any.iter().zip(&nearest).enumerate() {
            // What any hit visits is the beginning of what the nearest one does, up to its first hit.
            assert!(nearest.starts_with(any), "ray {ray}: {any:?}, {nearest:?}");
        }
        let most = nearest.iter().map(Vec::len).max().unwrap();
        assert!(most > 5 && any.iter().map(Vec::len).sum::<usize>() < nearest.iter().map(Vec::len).sum());
        // Rays visit nodes while leaves wait, and wait only while a triangle is tested.
        let all = || nearest.iter().flatten();
        assert!(all().any(|&step| step == AT_NODE | AT_TRIANGLE) && all().any(|&step| step == AT_TRIANGLE));
    });
}

#[test]
fn both_kinds_of_trees_have_the_same_hits() {
    let scene = soup(9, 1500, 0.5);
    let (positions, triangles) = (&scene.mesh.positions, &scene.mesh.triangles);
    let trees = [TreeFor::Packets, TreeFor::SingleRays]
        .map(|tree_for| WideBvh::build_for(tree_for, positions, triangles, &|_| ()));
    assert_ne!(trees[0], trees[1]);
    let mut random = Random::new(9);
    let mut bundles = Bundles::default();
    for _ in 0..64 {
        let from = on_sphere(&mut random).as_vec3() * 2.0;
        let own = bundle(from, |_| from + on_sphere(&mut random).as_vec3());
        bundles.origins.extend(own.origins);
        bundles.directions.extend(own.directions);
    }
    on_every_device(|device| {
        for traversal in Traversal::ALL {
            let [packets, single] = trees.each_ref().map(|tree| {
                let mut probe = Probe::new(device, &scene, tree, traversal).unwrap();
                probe.send(&bundles).unwrap();
                probe.trace(RayKind::Bounce).unwrap();
                probe.trace(RayKind::Occlusion).unwrap();
                let hits = probe.hits(RayKind::Bounce).unwrap();
                // Triangles are places in leaf order.
                let triangle = |place: u32| tree.order.get(place as usize).map(|slot| slot.triangle);
                let hits: Vec<_> = hits.iter().map(|hit| (triangle(hit.triangle), hit.t.to_bits())).collect();
                (hits, probe.hidden().unwrap())
            });
            assert_eq!(packets, single, "{traversal:?}");
            assert!(packets.0.iter().filter(|hit| hit.0.is_some()).count() > 500);
        }
    });
}
