//! What single rays visit, as the benchmark of busy lanes has it counted.

use foveate::bvh::WideBvh;
use foveate::reference::Random;
use foveate::trace::Traversal;
use foveate::trace::probe::{Bundles, CountingProbe, Probe, RayKind};
use glam::Vec3;

use crate::bench::on_every_device;
use crate::scenes::{on_sphere, shape, soup};

/// 32 rays from a point towards points.
fn bundle(from: Vec3, towards: impl Fn(usize) -> Vec3) -> Bundles {
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
            let tests = counting.tests(nearest).unwrap();
            let expected: Vec<Vec<u8>> = (0..32).map(|ray| vec![u8::from(ray % 3 < 2)]).collect();
            assert_eq!(tests, expected, "nearest {nearest}");
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
        let sum = |tests: &[u8]| tests.iter().map(|&tests| u32::from(tests)).sum::<u32>();
        let [any, nearest] = [false, true].map(|nearest| counting.tests(nearest).unwrap());
        for (ray, (any, nearest)) in any.iter().zip(&nearest).enumerate() {
            // What any hit visits is the beginning of what the nearest one does, up to its first hit.
            let same = any.len() <= nearest.len() && any[..any.len() - 1] == nearest[..any.len() - 1];
            assert!(same && sum(any) <= sum(nearest), "ray {ray}: {any:?}, {nearest:?}");
        }
        let most = nearest.iter().map(Vec::len).max().unwrap();
        assert!(most > 5 && any.iter().map(Vec::len).sum::<usize>() < nearest.iter().map(Vec::len).sum());
    });
}
