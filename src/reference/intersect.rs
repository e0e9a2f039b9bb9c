//! Where rays meet a scene's triangles, in `f64`.

use glam::{DVec2, DVec3};

use super::{bvh::Bvh, surface};
use crate::scene::{AlphaMode, Material, Scene};

/// A ray; its direction need not be a unit vector, and distances `t` count in lengths of it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ray {
    /// Where it starts, relative to the scene's anchor, in metres.
    pub origin: DVec3,
    /// Where it goes.
    pub direction: DVec3,
}

impl Ray {
    /// The point at distance `t`, relative to the anchor.
    pub fn at(&self, t: f64) -> DVec3 {
        self.origin + self.direction * t
    }
}

/// A meeting of a ray and a triangle.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hit {
    /// Index into the mesh's triangles.
    pub triangle: u32,
    /// Distance in lengths of the ray's direction.
    pub t: f64,
    /// Barycentric weight of the triangle's second corner.
    pub u: f64,
    /// Barycentric weight of the triangle's third corner.
    pub v: f64,
    /// The side that is seen is the one from which the corners run clockwise.
    pub back: bool,
}

/// A surface that a ray sees, and how much of what it sees is this surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Layer {
    /// The surface.
    pub hit: Hit,
    /// Its own coverage times what the layers in front let through: 0 to 1.
    pub weight: f64,
}

/// A scene prepared for rays.
#[derive(Debug)]
pub struct Tracer<'a> {
    scene: &'a Scene,
    pub(super) corners: Vec<[DVec3; 3]>,
    bvh: Bvh,
}

impl<'a> Tracer<'a> {
    /// Prepares a scene whose indices are in range and whose positions are finite.
    pub fn new(scene: &'a Scene) -> Self {
        let position = |index: u32| scene.mesh.positions[index as usize].as_dvec3();
        let corners: Vec<_> = scene.mesh.triangles.iter().map(|corner| corner.map(position)).collect();
        let bvh = Bvh::new(&corners);
        Tracer { scene, corners, bvh }
    }

    /// The scene.
    pub fn scene(&self) -> &'a Scene {
        self.scene
    }

    /// The nearest surface at `0 < t < t_max` that a camera or bounce ray sees: BLEND surfaces count
    /// wherever their alpha is above 0. Of surfaces at the same distance, the lowest index.
    pub fn closest(&self, ray: &Ray, t_max: f64) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        self.bvh.walk(ray, t_max, |triangle, far| {
            let hit = self.meet(ray, triangle).filter(|hit| hit.t < t_max && is_before(hit, best.as_ref()));
            if let Some(hit) = hit.filter(|hit| self.coverage_seen(hit) > 0.0) {
                best = Some(hit);
                return hit.t;
            }
            far
        });
        best
    }

    /// What [`Tracer::closest`] returns, found by trying every triangle.
    pub fn closest_brute(&self, ray: &Ray, t_max: f64) -> Option<Hit> {
        let mut best: Option<Hit> = None;
        for triangle in 0..self.corners.len() as u32 {
            let hit = self.meet(ray, triangle).filter(|hit| hit.t < t_max && is_before(hit, best.as_ref()));
            best = hit.filter(|hit| self.coverage_seen(hit) > 0.0).or(best);
        }
        best
    }

    /// Every surface that a camera or bounce ray sees no further than `slack` behind the nearest one, in
    /// lengths of the direction: the hits that could be confused with it. In no order.
    pub fn closest_all_within(&self, ray: &Ray, t_max: f64, slack: f64) -> Vec<Hit> {
        let Some(nearest) = self.closest(ray, t_max) else { return Vec::new() };
        let mut hits = Vec::new();
        self.bvh.walk(ray, nearest.t + slack, |triangle, far| {
            let hit = self.meet(ray, triangle).filter(|hit| hit.t <= far && hit.t < t_max);
            hits.extend(hit.filter(|hit| self.coverage_seen(hit) > 0.0));
            far
        });
        hits
    }

    /// All that a camera or bounce ray sees at `0 < t < t_max`, nearest first: BLEND surfaces, then at
    /// most one that covers the rest. What the weights lack to 1 is the share of the background.
    pub fn layers(&self, ray: &Ray, t_max: f64) -> Vec<Layer> {
        let mut seen: Vec<Layer> = Vec::new();
        self.bvh.walk(ray, t_max, |triangle, far| {
            let hit = self.meet(ray, triangle).filter(|hit| hit.t < t_max && hit.t <= far);
            let Some(hit) = hit else { return far };
            let weight = self.coverage_seen(&hit);
            if weight > 0.0 {
                seen.push(Layer { hit, weight });
            }
            if weight >= 1.0 { hit.t } else { far }
        });
        seen.sort_by(|a, b| a.hit.t.total_cmp(&b.hit.t).then(a.hit.triangle.cmp(&b.hit.triangle)));
        let mut left = 1.0;
        for layer in &mut seen {
            let coverage = layer.weight;
            layer.weight *= left;
            left *= 1.0 - coverage;
        }
        seen.retain(|layer| layer.weight > 0.0);
        seen
    }

    /// The share of light that reaches the ray's origin from `t_max`, both sides of surfaces seen: 0 behind
    /// anything opaque, the product of `1 - alpha` behind BLEND surfaces and of [`Material::clear`] behind glass.
    pub fn transmittance(&self, ray: &Ray, t_max: f64) -> f64 {
        let mut left = 1.0;
        self.bvh.walk(ray, t_max, |triangle, far| {
            if let Some(hit) = self.meet(ray, triangle).filter(|hit| hit.t < t_max) {
                left *= 1.0 - self.coverage(&hit) * (1.0 - f64::from(self.material(hit.triangle).clear()));
            }
            if left > 0.0 { far } else { -1.0 }
        });
        left
    }

    /// Whether no light at all reaches the ray's origin from `t_max`.
    pub fn occluded(&self, ray: &Ray, t_max: f64) -> bool {
        self.transmittance(ray, t_max) <= 0.0
    }

    /// The material of a triangle.
    pub fn material(&self, triangle: u32) -> &'a Material {
        &self.scene.materials[self.scene.mesh.materials[triangle as usize] as usize]
    }

    /// Whether camera and bounce rays see this side of the triangle.
    pub fn sees_side(&self, triangle: u32, back: bool) -> bool {
        !back || self.material(triangle).double_sided
    }

    fn coverage_seen(&self, hit: &Hit) -> f64 {
        if self.sees_side(hit.triangle, hit.back) { self.coverage(hit) } else { 0.0 }
    }

    /// The probability that a ray does not pass the surface; alpha comes from level 0 of its texture.
    fn coverage(&self, hit: &Hit) -> f64 {
        match self.material(hit.triangle).alpha {
            AlphaMode::Opaque => 1.0,
            AlphaMode::Mask(cutoff) => {
                f64::from(u8::from(surface::alpha(self.scene, hit) >= f64::from(cutoff)))
            }
            AlphaMode::Blend => surface::alpha(self.scene, hit),
        }
    }

    fn meet(&self, ray: &Ray, triangle: u32) -> Option<Hit> {
        let (t, u, v, back) = meet_triangle(ray, &self.corners[triangle as usize])?;
        Some(Hit { triangle, t, u, v, back })
    }
}

fn is_before(hit: &Hit, best: Option<&Hit>) -> bool {
    best.is_none_or(|best| (hit.t, hit.triangle) < (best.t, best.triangle))
}

/// `(t, u, v, back)` where a ray crosses a triangle at t > 0; edges and corners belong to the triangle.
///
/// The corners are sheared onto the plane across the direction, each in the same way for every triangle that
/// it belongs to, and the signs of the edge functions there cannot be wrong: rounding is monotonic, so a
/// difference of two rounded products has the sign of the true one or is zero. Hence no ray slips through a
/// shared edge or corner (Woop, Benthin and Wald 2013).
fn meet_triangle(ray: &Ray, corners: &[DVec3; 3]) -> Option<(f64, f64, f64, bool)> {
    let d = ray.direction;
    let size = d.abs();
    let z = if size.x >= size.y && size.x >= size.z { 0 } else { 1 + usize::from(size.z > size.y) };
    let (x, y) = if d[z] > 0.0 { ((z + 1) % 3, (z + 2) % 3) } else { ((z + 2) % 3, (z + 1) % 3) };
    let (shear_x, shear_y) = (d[x] / d[z], d[y] / d[z]);
    let shear = |corner: DVec3| {
        let p = corner - ray.origin;
        (DVec2::new(p[x] - shear_x * p[z], p[y] - shear_y * p[z]), p[z] / d[z])
    };
    let [(a, t_a), (b, t_b), (c, t_c)] = corners.map(shear);
    let side = |p: DVec2, q: DVec2| q.x * p.y - q.y * p.x;
    let (of_a, of_b, of_c) = (side(b, c), side(c, a), side(a, b));
    let front = of_a >= 0.0 && of_b >= 0.0 && of_c >= 0.0;
    let back = of_a <= 0.0 && of_b <= 0.0 && of_c <= 0.0;
    let sum = of_a + of_b + of_c;
    if !(front || back) || sum == 0.0 {
        return None;
    }
    let (u, v) = (of_b / sum, of_c / sum);
    let t = of_a / sum * t_a + u * t_b + v * t_c;
    (t > 0.0 && t.is_finite()).then_some((t, u, v, back))
}

#[cfg(test)]
mod tests {
    use glam::{Vec3, Vec4};

    use super::*;
    use crate::reference::Random;
    use crate::reference::testing::{on_sphere, quad, scene_of};

    fn soup(random: &mut Random, count: usize) -> Scene {
        let mut scene = scene_of(Material::default());
        for _ in 0..count {
            let centre = on_sphere(random) * random.uniform() * 10.0;
            let corner = |random: &mut Random| (centre + on_sphere(random)).as_vec3();
            let first = scene.mesh.positions.len() as u32;
            scene.mesh.positions.extend([corner(random), corner(random), corner(random)]);
            scene.mesh.triangles.push([first, first + 1, first + 2]);
            scene.mesh.materials.push(random.bits() as u32 % 2);
        }
        scene.materials.push(Material { double_sided: true, ..Material::default() });
        scene
    }

    #[test]
    fn hierarchy_finds_what_brute_force_finds() {
        let mut random = Random::new(1);
        let scene = soup(&mut random, 500);
        let tracer = Tracer::new(&scene);
        let mut hits = 0;
        for i in 0..2000 {
            let origin = on_sphere(&mut random) * random.uniform() * 12.0;
            let mut direction = on_sphere(&mut random);
            if i % 4 == 0 {
                direction = [DVec3::X, DVec3::NEG_Y, DVec3::Z][i % 3];
            }
            let ray = Ray { origin, direction };
            let brute = tracer.closest_brute(&ray, 20.0);
            assert_eq!(tracer.closest(&ray, 20.0), brute);
            assert_eq!(tracer.layers(&ray, 20.0).first().map(|layer| layer.hit), brute);
            hits += usize::from(brute.is_some());
            let any = (0..500).any(|i| tracer.meet(&ray, i).is_some_and(|hit| hit.t < 20.0));
            assert_eq!(tracer.occluded(&ray, 20.0), any);
        }
        assert!(hits > 500, "too few hits to tell: {hits}");
    }

    #[test]
    fn coincident_triangles_terminate_and_the_lowest_index_wins() {
        let mut scene = scene_of(Material { double_sided: true, ..Material::default() });
        for _ in 0..50 {
            quad(&mut scene, [Vec3::NEG_X, Vec3::NEG_Y, Vec3::X, Vec3::Y], 0);
        }
        let tracer = Tracer::new(&scene);
        let ray = Ray { origin: DVec3::new(0.3, 0.1, 2.0), direction: DVec3::NEG_Z };
        let hit = tracer.closest(&ray, f64::INFINITY).unwrap();
        assert_eq!(hit, tracer.closest_brute(&ray, f64::INFINITY).unwrap());
        assert!(hit.triangle < 2 && (hit.t - 2.0).abs() < 1e-12);
    }

    #[test]
    fn closed_surface_has_no_holes_at_edges_and_corners() {
        let mut scene = scene_of(Material { double_sided: true, ..Material::default() });
        let (rings, columns) = (7u32, 11u32);
        for ring in 0..=rings {
            for column in 0..columns {
                let theta = std::f32::consts::PI * ring as f32 / rings as f32;
                let phi = std::f32::consts::TAU * column as f32 / columns as f32;
                let r = if ring == 0 || ring == rings { 0.0 } else { theta.sin() };
                scene.mesh.positions.push(Vec3::new(r * phi.cos(), theta.cos(), r * phi.sin()) * 3.7);
            }
        }
        for ring in 0..rings {
            for column in 0..columns {
                let at = |r: u32, c: u32| r * columns + c % columns;
                let (a, b) = (at(ring, column), at(ring, column + 1));
                let (c, d) = (at(ring + 1, column + 1), at(ring + 1, column));
                scene.mesh.triangles.extend([[a, b, c], [a, c, d]]);
                scene.mesh.materials.extend([0, 0]);
            }
        }
        let tracer = Tracer::new(&scene);
        let mut random = Random::new(3);
        for i in 0..20_000 {
            let origin = on_sphere(&mut random) * random.uniform();
            let corners = tracer.corners[random.bits() as usize % tracer.corners.len()];
            let along = if i % 3 == 0 { 0.0 } else { random.uniform() };
            let direction = corners[0].lerp(corners[1], along) - origin;
            assert!(tracer.closest(&Ray { origin, direction }, f64::INFINITY).is_some());
            assert!(tracer.occluded(&Ray { origin, direction }, f64::INFINITY));
        }
    }

    #[test]
    fn sides_and_alpha_decide_what_is_seen() {
        let corners = [Vec3::NEG_X, Vec3::NEG_Y, Vec3::X, Vec3::Y];
        let from_front = Ray { origin: DVec3::new(0.1, 0.2, 1.0), direction: DVec3::NEG_Z };
        let from_back = Ray { origin: DVec3::new(0.1, 0.2, -1.0), direction: DVec3::Z };
        let with = |material: Material| {
            let mut scene = scene_of(material);
            quad(&mut scene, corners, 0);
            scene
        };
        let scene = with(Material::default());
        let tracer = Tracer::new(&scene);
        assert!(!tracer.closest(&from_front, 2.0).unwrap().back);
        assert_eq!(tracer.closest(&from_back, 2.0), None);
        assert!(tracer.occluded(&from_back, 2.0) && !tracer.occluded(&from_back, 0.5));

        let scene = with(Material { double_sided: true, ..Material::default() });
        assert!(Tracer::new(&scene).closest(&from_back, 2.0).unwrap().back);

        let half = Material { base_color: Vec4::new(1.0, 1.0, 1.0, 0.5), ..Material::default() };
        for (cutoff, solid) in [(0.5, true), (0.51, false)] {
            let scene = with(Material { alpha: AlphaMode::Mask(cutoff), ..half.clone() });
            assert_eq!(Tracer::new(&scene).closest(&from_front, 2.0).is_some(), solid);
            assert_eq!(Tracer::new(&scene).occluded(&from_front, 2.0), solid);
        }

        let mut scene = with(Material { alpha: AlphaMode::Blend, ..half });
        quad(&mut scene, corners.map(|corner| corner - Vec3::Z), 0);
        let tracer = Tracer::new(&scene);
        let weights: Vec<f64> = tracer.layers(&from_front, 9.0).iter().map(|layer| layer.weight).collect();
        assert_eq!(weights, [0.5, 0.25]);
        assert_eq!(tracer.transmittance(&from_front, 9.0), 0.25);
        assert_eq!(tracer.transmittance(&from_front, 1.5), 0.5);
        assert!(!tracer.occluded(&from_front, 9.0));
    }

    #[test]
    fn scene_without_triangles_is_empty() {
        let scene = Scene::default();
        let tracer = Tracer::new(&scene);
        let ray = Ray { origin: DVec3::ZERO, direction: DVec3::X };
        assert_eq!(tracer.closest(&ray, f64::INFINITY), None);
        assert!(!tracer.occluded(&ray, f64::INFINITY));
    }
}
