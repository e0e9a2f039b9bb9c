//! The obvhs crate's own tree and traversal: eight wide and compressed, one ray at a time.

use std::time::{Duration, Instant};

use foveate::bench::Workload;
use foveate::bench::workload::camera_direction;
use foveate::bvh::wide::Cost;
use foveate::scene::Scene;
use foveate::trace::probe::{BUNDLE, RayKind};
use glam::{Vec3, Vec3A};
use obvhs::BvhBuildParams;
use obvhs::cwbvh::{CwBvh, builder::build_cwbvh_from_tris};
use obvhs::ray::{Ray, RayHit};
use obvhs::triangle::Triangle;
use rayon::prelude::*;

/// A tree with its triangles in its own order.
pub struct Obvhs {
    tree: CwBvh,
    triangles: Vec<Triangle>,
    anchor: glam::DVec3,
    /// Wall time of the build.
    pub build_ms: f64,
    /// What rays visit.
    pub cost: Cost,
}

impl Obvhs {
    pub fn build(shape: &Scene) -> Obvhs {
        let corner = |index: u32| Vec3A::from(shape.mesh.positions[index as usize]);
        let all: Vec<Triangle> = shape
            .mesh
            .triangles
            .iter()
            .map(|t| Triangle { v0: corner(t[0]), v1: corner(t[1]), v2: corner(t[2]) })
            .collect();
        let start = Instant::now();
        let tree = build_cwbvh_from_tris(&all, BvhBuildParams::slow_build(), &mut Duration::default());
        let build_ms = start.elapsed().as_secs_f64() * 1e3;
        let triangles = tree.primitive_indices.iter().map(|&index| all[index as usize]).collect();
        Obvhs { cost: cost(&tree), tree, triangles, anchor: shape.anchor, build_ms }
    }

    /// Traces all rays of a kind on all cores.
    pub fn trace(&self, kind: RayKind, work: &Workload) {
        let (view, bundles) = (&work.view, &work.bundles);
        let eye = (view.world_from_eye.position - self.anchor).as_vec3();
        let hits: usize = match kind {
            RayKind::Pixels => (0..view.pixels() as u32)
                .into_par_iter()
                .with_min_len(1024)
                .filter(|i| self.hits(eye, camera_direction(view, i % view.width, i / view.width)))
                .count(),
            RayKind::Samples => (work.pattern.samples.par_iter().with_min_len(1024))
                .filter(|&pixel| self.hits(eye, camera_direction(view, pixel & 0xffff, pixel >> 16)))
                .count(),
            RayKind::Bounce => (bundles.directions.par_iter().enumerate().with_min_len(1024))
                .filter(|(i, d)| self.hits(Vec3::from(bundles.origins[i / BUNDLE]), Vec3::from(**d)))
                .count(),
            RayKind::Occlusion => (bundles.directions.par_iter().enumerate().with_min_len(1024))
                .filter(|(i, d)| {
                    let ray = Ray::new_inf(Vec3A::from(bundles.origins[i / BUNDLE]), Vec3A::from(**d));
                    !self.tree.ray_traverse_miss(ray, |ray, place| self.triangles[place].intersect(ray))
                })
                .count(),
        };
        std::hint::black_box(hits);
    }

    fn hits(&self, origin: Vec3, direction: Vec3) -> bool {
        let mut hit = RayHit::none();
        let ray = Ray::new_inf(origin.into(), direction.into());
        self.tree.ray_traverse(ray, &mut hit, |ray, place| self.triangles[place].intersect(ray))
    }
}

/// Nodes and leaf boxes, weighted by their surfaces.
fn cost(tree: &CwBvh) -> Cost {
    let root = f64::from(tree.total_aabb.half_area());
    let mut cost = Cost { nodes: 1.0, leaves: 0.0, triangles: 0.0 };
    for node in &tree.nodes {
        for child in (0..8).filter(|&child| !node.is_child_empty(child)) {
            let share = f64::from(node.child_aabb(child).half_area()) / root;
            if node.is_leaf(child) {
                cost.leaves += share;
                cost.triangles += share * f64::from((node.child_meta[child] >> 5).count_ones());
            } else {
                cost.nodes += share;
            }
        }
    }
    cost
}
