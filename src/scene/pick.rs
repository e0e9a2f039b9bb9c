//! What a single ray meets, by brute force: for a hand that points now and then.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::{Mesh, Scene};

/// The nearest triangle that a ray meets: the point, relative to what positions are relative to, and the
/// triangle's unit normal on the side that the ray comes from. Surfaces with holes count as whole.
pub fn nearest(scene: &Scene, origin: DVec3, direction: DVec3) -> Option<(DVec3, DVec3)> {
    let least = |a: &(f64, DVec3), b: &(f64, DVec3)| a.0.total_cmp(&b.0);
    // Nobody points at their own hands, or stands on them.
    let given = scene.motion.as_ref().and_then(|motion| motion.parts.get(motion.parts_before_given()));
    let own = given.map_or(scene.mesh.triangles.len(), |part| part.triangles.start);
    let world = in_mesh(&scene.mesh, &scene.mesh.triangles[..own], |p| p, origin, direction);
    let instanced = scene.instanced.iter().filter_map(|instanced| {
        let boxes = instanced.boxes();
        let near =
            instanced.instances.par_iter().zip(&boxes).filter(|(_, bounds)| meets(bounds, origin, direction));
        let hits = near.filter_map(|(instance, _)| {
            let triangles =
                &instanced.mesh.triangles[instanced.shapes[instance.shape as usize].triangles.clone()];
            in_mesh(&instanced.mesh, triangles, |p| instance.place(p), origin, direction)
        });
        hits.min_by(least)
    });
    let (t, normal) = world.into_iter().chain(instanced).min_by(least)?;
    let towards = if normal.dot(direction) > 0.0 { -normal } else { normal };
    Some((origin + direction * t, towards.try_normalize()?))
}

/// Whether a ray meets a box.
fn meets((low, high): &(Vec3, Vec3), origin: DVec3, direction: DVec3) -> bool {
    let (a, b) = ((low.as_dvec3() - origin) / direction, (high.as_dvec3() - origin) / direction);
    // Beside a slab that the ray runs along one end is not a number, and does not count.
    let enter = [a.min(b).x, a.min(b).y, a.min(b).z].into_iter().fold(0.0, f64::max);
    let leave = [a.max(b).x, a.max(b).y, a.max(b).z].into_iter().fold(f64::INFINITY, f64::min);
    enter <= leave
}

/// The nearest of a mesh's triangles, with its normal (not a unit one).
fn in_mesh(
    mesh: &Mesh,
    triangles: &[[u32; 3]],
    place: impl Fn(Vec3) -> Vec3 + Sync,
    origin: DVec3,
    direction: DVec3,
) -> Option<(f64, DVec3)> {
    let hit = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|index| place(mesh.positions[index as usize]).as_dvec3());
        let normal = (b - a).cross(c - a);
        let t = (a - origin).dot(normal) / direction.dot(normal);
        let point = origin + direction * t;
        let inside = [(a, b), (b, c), (c, a)]
            .iter()
            .all(|(from, to)| (*to - *from).cross(point - *from).dot(normal) >= 0.0);
        (t > 0.0 && t.is_finite() && inside).then_some((t, normal))
    };
    triangles.par_iter().filter_map(hit).min_by(|(a, _), (b, _)| a.total_cmp(b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::generate;

    #[test]
    fn a_ray_downwards_finds_the_ground_and_one_upwards_the_sky() {
        let scene = Scene::from_glb(std::path::Path::new("demo"), &generate::demo::generate()).unwrap();
        let (low, high) = scene.mesh.bounds().unwrap();
        let from = ((low + high) * 0.5).as_dvec3().with_y(f64::from(high.y) + 1.0);
        let (point, normal) = nearest(&scene, from, DVec3::new(0.01, -1.0, 0.02)).unwrap();
        assert!(normal.y > 0.0 && point.y >= f64::from(low.y) - 1e-3 && point.y <= f64::from(high.y) + 1e-3);
        assert!(nearest(&scene, from, DVec3::Y).is_none());
    }
}
