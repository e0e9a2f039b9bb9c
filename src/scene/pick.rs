//! What a single ray meets, by brute force: for a hand that points now and then.

use glam::DVec3;
use rayon::prelude::*;

use super::Mesh;

/// The nearest triangle that a ray meets: the point, relative to what positions are relative to, and the
/// triangle's unit normal on the side that the ray comes from. Surfaces with holes count as whole.
pub fn nearest(mesh: &Mesh, origin: DVec3, direction: DVec3) -> Option<(DVec3, DVec3)> {
    let hit = |triangle: &[u32; 3]| {
        let [a, b, c] = triangle.map(|index| mesh.positions[index as usize].as_dvec3());
        let normal = (b - a).cross(c - a);
        let t = (a - origin).dot(normal) / direction.dot(normal);
        let point = origin + direction * t;
        let inside = [(a, b), (b, c), (c, a)]
            .iter()
            .all(|(from, to)| (*to - *from).cross(point - *from).dot(normal) >= 0.0);
        (t > 0.0 && t.is_finite() && inside).then_some((t, normal))
    };
    let (t, normal) = mesh.triangles.par_iter().filter_map(hit).min_by(|(a, _), (b, _)| a.total_cmp(b))?;
    let towards = if normal.dot(direction) > 0.0 { -normal } else { normal };
    Some((origin + direction * t, towards.try_normalize()?))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::Scene;
    use crate::scene::generate;

    #[test]
    fn a_ray_downwards_finds_the_ground_and_one_upwards_the_sky() {
        let scene = Scene::from_glb(std::path::Path::new("demo"), &generate::demo::generate()).unwrap();
        let (low, high) = scene.mesh.bounds().unwrap();
        let from = ((low + high) * 0.5).as_dvec3().with_y(f64::from(high.y) + 1.0);
        let (point, normal) = nearest(&scene.mesh, from, DVec3::new(0.01, -1.0, 0.02)).unwrap();
        assert!(normal.y > 0.0 && point.y >= f64::from(low.y) - 1e-3 && point.y <= f64::from(high.y) + 1e-3);
        assert!(nearest(&scene.mesh, from, DVec3::Y).is_none());
    }
}
