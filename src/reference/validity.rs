//! Whether another tracer's answer is right, given that it rounds.

use glam::DVec3;

use super::intersect::{Ray, Tracer};

/// Rays around the original one; the tube's wall is sampled at this many angles.
const AROUND: usize = 12;

impl Tracer<'_> {
    /// Whether a tracer that rounds may say that `ray` first meets `triangle` at distance `t`.
    ///
    /// Rounding moves a ray sideways within a tube of radius `tolerance` metres. The claim is valid
    /// if its point lies within the tube's radius of the triangle, the triangle shows a side that
    /// can be seen, and some ray of the tube meets its nearest surface where the claim says. So
    /// either triangle at a shared edge is valid, either of two coplanar ones, and either side of
    /// a silhouette; a surface seen through a crack of a closed one is not.
    pub fn is_valid_hit(&self, ray: &Ray, triangle: u32, t: f64, tolerance: f64) -> bool {
        let Some(corners) = self.corners.get(triangle as usize) else { return false };
        if !(t > 0.0 && t.is_finite() && distance_to_triangle(ray.at(t), corners) <= tolerance) {
            return false;
        }
        let along = ray.direction.normalize().dot(normal(corners));
        // A sideways move of one tolerance tilts the side that is seen only where it is seen edge-on.
        let size = (corners[1] - corners[0]).length().max((corners[2] - corners[0]).length());
        let edge_on = along.abs() <= tolerance / size.max(tolerance);
        if !(edge_on || self.sees_side(triangle, along > 0.0)) {
            return false;
        }
        self.tube(ray, tolerance).any(|near| {
            self.closest(&near, f64::INFINITY).is_some_and(|hit| {
                let cosine = near.direction.normalize().dot(normal(&self.corners[hit.triangle as usize]));
                let slack = tolerance * (2.0 + 2.0 / cosine.abs().max(1e-6));
                (hit.t - t).abs() * ray.direction.length() <= slack
            })
        })
    }

    /// Whether a tracer that rounds may say that `ray` meets nothing before `t_max`: some ray of
    /// the tube of radius `tolerance` metres around it does not.
    pub fn is_valid_miss(&self, ray: &Ray, t_max: f64, tolerance: f64) -> bool {
        self.tube(ray, tolerance).any(|near| self.closest(&near, t_max).is_none())
    }

    /// Distance in metres from a point, relative to the anchor, to the nearest point of a triangle.
    ///
    /// # Panics
    /// If there is no such triangle.
    pub fn distance(&self, triangle: u32, point: DVec3) -> f64 {
        distance_to_triangle(point, &self.corners[triangle as usize])
    }

    fn tube(&self, ray: &Ray, radius: f64) -> impl Iterator<Item = Ray> {
        let (x, y) = ray.direction.normalize().any_orthonormal_pair();
        let ring = (0..AROUND).map(move |i| {
            let (sin, cos) = (i as f64 * std::f64::consts::TAU / AROUND as f64).sin_cos();
            (x * cos + y * sin) * radius
        });
        let ray = *ray;
        std::iter::once(DVec3::ZERO)
            .chain(ring)
            .map(move |offset| Ray { origin: ray.origin + offset, direction: ray.direction })
    }
}

fn normal(corners: &[DVec3; 3]) -> DVec3 {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).normalize_or_zero()
}

/// Distance from a point to the nearest point of a triangle, its inside included.
fn distance_to_triangle(point: DVec3, corners: &[DVec3; 3]) -> f64 {
    let n = normal(corners);
    let edges = [(0, 1), (1, 2), (2, 0)].map(|(i, j)| (corners[i], corners[j]));
    let inside = n != DVec3::ZERO && edges.iter().all(|(a, b)| n.dot((b - a).cross(point - a)) >= 0.0);
    if inside {
        return n.dot(point - corners[0]).abs();
    }
    edges.iter().map(|&(a, b)| distance_to_segment(point, a, b)).fold(f64::INFINITY, f64::min)
}

fn distance_to_segment(point: DVec3, a: DVec3, b: DVec3) -> f64 {
    let edge = b - a;
    let along = if edge == DVec3::ZERO { 0.0 } else { (point - a).dot(edge) / edge.length_squared() };
    (a + edge * along.clamp(0.0, 1.0) - point).length()
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::reference::testing::{floor, quad};
    use crate::scene::Material;

    /// Two quads of 2x2 m: triangles 0 and 1 at y = 0, then 2 and 3 below them at y = -1, wider.
    fn two_floors() -> crate::scene::Scene {
        let mut scene = floor(1.0, Material::default());
        let corner = |x: f32, z: f32| Vec3::new(x * 3.0, -1.0, z * 3.0);
        quad(&mut scene, [corner(-1.0, -1.0), corner(-1.0, 1.0), corner(1.0, 1.0), corner(1.0, -1.0)], 0);
        scene
    }

    fn down(x: f64, z: f64) -> Ray {
        Ray { origin: DVec3::new(x, 2.0, z), direction: DVec3::NEG_Y }
    }

    #[test]
    fn both_triangles_at_a_shared_edge_are_valid_and_what_lies_behind_is_not() {
        let scene = two_floors();
        let tracer = Tracer::new(&scene);
        let ray = down(0.25, 0.25);
        assert!(tracer.is_valid_hit(&ray, 0, 2.0, 1e-5) && tracer.is_valid_hit(&ray, 1, 2.0, 1e-5));
        assert_eq!(tracer.closest_all_within(&ray, 9.0, 1e-5).len(), 2);
        assert!(!tracer.is_valid_hit(&ray, 2, 3.0, 1e-5), "a crack must be noticed");
        assert!(!tracer.is_valid_hit(&ray, 0, 2.001, 1e-5), "a wrong distance must be noticed");
        assert!(!tracer.is_valid_hit(&ray, 9, 2.0, 1e-5), "an index out of range must be noticed");
        assert!(!tracer.is_valid_miss(&ray, 9.0, 1e-5), "a false miss must be noticed");
        let inside = down(0.25, 0.5);
        let right = tracer.closest(&inside, 9.0).unwrap().triangle;
        assert!(!tracer.is_valid_hit(&inside, 1 - right, 2.0, 1e-5), "a wrong triangle must be noticed");
    }

    #[test]
    fn either_side_of_a_silhouette_is_valid_within_the_tube_only() {
        let scene = two_floors();
        let tracer = Tracer::new(&scene);
        for (x, valid) in [(1.0 - 1e-6, true), (1.0 + 1e-6, true), (1.0 - 1e-4, false)] {
            let below = (2..4).any(|triangle| tracer.is_valid_hit(&down(x, 0.3), triangle, 3.0, 1e-5));
            assert_eq!(below, valid, "{x}");
        }
        assert!(tracer.is_valid_miss(&down(3.0, 0.0), 9.0, 1e-5));
    }

    #[test]
    fn back_of_a_single_sided_triangle_is_no_hit() {
        let scene = floor(1.0, Material::default());
        let tracer = Tracer::new(&scene);
        let up = Ray { origin: DVec3::new(0.1, -2.0, 0.3), direction: DVec3::Y };
        assert!((0..2).all(|triangle| !tracer.is_valid_hit(&up, triangle, 2.0, 1e-5)));
        assert!(tracer.is_valid_miss(&up, 9.0, 1e-5));
    }
}
