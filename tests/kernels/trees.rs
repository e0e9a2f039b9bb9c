//! Damaged trees through the real kernels: what passes the check before use must be walked to its end, with the hits of
//! the tree that was built.

use foveate::bvh::WideBvh;
use foveate::foveation::{Law, Pattern};
use foveate::math::pose::Pose;
use foveate::math::view::{FieldOfView, View};
use foveate::reference::Random;
use foveate::scene::Scene;
use foveate::trace::Traversal;
use foveate::trace::probe::{Bundles, Probe, RayKind};
use glam::{DVec2, DVec3, Vec3};

use crate::bench::on_every_device;
use crate::scenes::{on_sphere, shape};

/// Changed trees that are checked, for each that a device walks.
const CHECKED: usize = 400;

fn heap() -> Scene {
    let mut random = Random::new(5);
    let triangles: Vec<[Vec3; 3]> = (0..600)
        .map(|_| {
            let at = on_sphere(&mut random) * 3.0 * random.uniform();
            [0, 1, 2].map(|_| (at + on_sphere(&mut random) * 0.4).as_vec3())
        })
        .collect();
    shape(triangles)
}

fn view() -> View {
    View {
        world_from_eye: Pose::look_at(DVec3::new(0.0, 0.0, 6.0), DVec3::ZERO),
        fov: FieldOfView::symmetric(0.6, 0.6),
        width: 32,
        height: 32,
        spacing: Default::default(),
    }
}

/// Everything that rays of all kinds find, as distances: a box that is larger than it must be may change which of two
/// equal hits comes first.
fn found(probe: &Probe) -> Vec<u32> {
    let kinds = [RayKind::Pixels, RayKind::Samples, RayKind::Occlusion, RayKind::Bounce];
    for kind in kinds {
        probe.trace(kind).unwrap();
    }
    let hits = kinds.iter().flat_map(|&kind| probe.hits(kind).unwrap());
    let distances = hits.map(|hit| if hit.triangle == u32::MAX { 0 } else { hit.t.to_bits() });
    distances.chain(probe.hidden().unwrap()).collect()
}

fn pick(random: &mut Random, count: usize) -> usize {
    (random.uniform() * count as f64) as usize % count
}

/// Changes a tree somewhere: links, boxes, the order of triangles; some changes are harmless.
fn damage(tree: &mut WideBvh, random: &mut Random) {
    for _ in 0..=pick(random, 3) {
        let (index, slot, axis) = (pick(random, tree.nodes.len()), pick(random, 8), pick(random, 3));
        let other = tree.nodes[pick(random, tree.nodes.len())].children[pick(random, 8)];
        let node = &mut tree.nodes[index];
        match pick(random, 10) {
            0 => node.children[slot] ^= 1 << pick(random, 32),
            1 => node.children[slot] = other,
            2 => node.children.swap(slot, pick(random, 8)),
            3 => node.upper[axis][slot] += 0.01 * random.uniform() as f32,
            4 => node.lower[axis][slot] -= 0.01 * random.uniform() as f32,
            5 => node.upper[axis][slot] = f32::from_bits(random.bits() as u32),
            6 | 7 => {
                // As far as the parent's box, or one beside it, reaches.
                let from = pick(random, 8);
                node.upper[axis][slot] = node.upper[axis][slot].max(node.upper[axis][from]);
                node.lower[axis][slot] = node.lower[axis][slot].min(node.lower[axis][from]);
            }
            _ => {
                let place = pick(random, tree.order.len());
                let next = (place + 1) % tree.order.len();
                let other = tree.order[next].triangle;
                tree.order[next].triangle = tree.order[place].triangle;
                tree.order[place].triangle = other;
            }
        }
    }
}

fn walk_damaged_trees(wanted: usize, seed: u64) {
    let scene = heap();
    let (positions, triangles) = (&scene.mesh.positions, &scene.mesh.triangles);
    let tree = WideBvh::build(positions, triangles);
    let view = view();
    let pattern = Pattern::new(&view, &Law::default(), DVec2::splat(0.5), 200);
    let mut random = Random::new(seed);
    let mut bundles = Bundles::default();
    for _ in 0..8 {
        bundles.origins.push((on_sphere(&mut random) * 2.0).as_vec3().to_array());
        bundles.directions.extend((0..32).map(|_| on_sphere(&mut random).as_vec3().to_array()));
    }
    on_every_device(|device| {
        for traversal in Traversal::ALL {
            let trace = |tree: &WideBvh| {
                let mut probe = Probe::new(device, &scene, tree, traversal).unwrap();
                probe.look(&view, &pattern).unwrap();
                probe.send(&bundles).unwrap();
                found(&probe)
            };
            let truth = trace(&tree);
            assert!(truth.iter().filter(|&&bits| bits != 0).count() > 300);
            let (mut random, mut walked, mut checked) = (Random::new(seed), 0, 0);
            while walked < wanted {
                let mut damaged = tree.clone();
                damage(&mut damaged, &mut random);
                checked += 1;
                if damaged != tree && damaged.is_sound(positions, triangles) {
                    walked += 1;
                    assert!(trace(&damaged) == truth, "{}: tree {checked} of seed {seed}", traversal.name());
                }
                assert!(checked < wanted * CHECKED, "hardly any change is harmless: the test tests nothing");
            }
            println!("{}: {walked} of {checked} changed trees are sound, and walked", traversal.name());
        }
    });
}

#[test]
fn what_passes_the_check_is_walked_with_the_same_hits() {
    walk_damaged_trees(20, 1);
}

/// 10,000 trees that the kernels walk, drawn from many times as many.
#[test]
#[ignore = "takes long"]
fn long_fuzzed_trees() {
    walk_damaged_trees(10_000, 2);
}
