//! The rays that are measured: a view's, and those that leave what its samples see.

use glam::Vec3;

use crate::bvh::Trees;
use crate::error::Result;
use crate::foveation::Pattern;
use crate::layout::HitRecord;
use crate::math::view::View;
use crate::scene::Scene;
use crate::trace::numbers::TriangleNumbers;
use crate::trace::probe::{BUNDLE, Bundles, Probe, RayKind};

/// Rays of every kind.
#[derive(Clone, Debug)]
pub struct Workload {
    /// The view whose pixels and samples are asked for.
    pub view: View,
    /// Which of its pixels are samples.
    pub pattern: Pattern,
    /// What leaves the points that samples see: a cosine distribution around the surface's normal.
    pub bundles: Bundles,
}

impl Workload {
    /// Traces the samples once with `probe` and sends rays from what they see.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device fails.
    pub fn new<'a>(
        probe: &mut Probe,
        shape: &Scene,
        trees: impl Into<Trees<'a>>,
        view: View,
        pattern: Pattern,
    ) -> Result<Self> {
        probe.look(&view, &pattern)?;
        probe.trace(RayKind::Samples)?;
        let hits = probe.hits(RayKind::Samples)?;
        let bundles =
            bundles(&TriangleNumbers::new(shape, trees.into()), shape.anchor, &view, &pattern, &hits);
        probe.send(&bundles)?;
        Ok(Workload { view, pattern, bundles })
    }

    /// Makes another probe trace the same rays.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device has no room for them.
    pub fn load(&self, probe: &mut Probe) -> Result<()> {
        probe.look(&self.view, &self.pattern)?;
        probe.send(&self.bundles)
    }
}

fn bundles(
    triangles: &TriangleNumbers,
    anchor: glam::DVec3,
    view: &View,
    pattern: &Pattern,
    hits: &[HitRecord],
) -> Bundles {
    let mut bundles = Bundles::default();
    for (index, (&pixel, hit)) in pattern.samples.iter().zip(hits).enumerate() {
        if hit.triangle == u32::MAX {
            continue;
        }
        let direction = camera_direction(view, pixel & 0xffff, pixel >> 16);
        let corners = triangles.corners(hit.triangle);
        let eye = (view.world_from_eye.position - anchor).as_vec3();
        let (origin, normal) = leave(corners, eye + direction * hit.t, direction);
        bundles.origins.push(origin.to_array());
        let (t, b) = normal.any_orthonormal_pair();
        bundles.directions.extend((0..BUNDLE as u32).map(|ray| {
            let [u, v] = sobol(ray, index as u32);
            let (radius, angle) = (u.sqrt(), v * std::f32::consts::TAU);
            let up = (1.0 - u).max(1e-6).sqrt();
            (t * (radius * angle.cos()) + b * (radius * angle.sin()) + normal * up).normalize().to_array()
        }));
    }
    bundles
}

/// The direction of the ray through a pixel's centre, in the world.
pub fn camera_direction(view: &View, x: u32, y: u32) -> Vec3 {
    let at = glam::DVec2::new(f64::from(x), f64::from(y)) + 0.5;
    (view.world_from_eye.rotation * view.eye_direction(at).normalize()).as_vec3()
}

/// Where rays start that leave a triangle towards its viewer, and its normal there. The offset is that of
/// the kernels: along the normal, the rounding of coordinates and of the triangle's size.
fn leave([a, b, c]: [Vec3; 3], at: Vec3, viewed: Vec3) -> (Vec3, Vec3) {
    let (e1, e2) = ((b - a).as_dvec3(), (c - a).as_dvec3());
    let normal = e1.cross(e2).try_normalize().map_or(-viewed, |n| n.as_vec3());
    let normal = if normal.dot(viewed) > 0.0 { -normal } else { normal };
    let size = (b - a).abs().max((c - a).abs());
    let reach = a.abs().max(b.abs()).max(c.abs()) + size;
    (at + normal * (1.5e-6 * reach.dot(normal.abs())), normal)
}

/// Point `index` of a Sobol sequence in two dimensions, scrambled by a digital shift for each `sample`:
/// any 32 in a row are stratified, and neighbours in the row are far apart, as frames' light rays are.
fn sobol(index: u32, sample: u32) -> [f32; 2] {
    let mut y = 0;
    let mut column = 1u32 << 31;
    let mut bits = index;
    while bits != 0 {
        if bits & 1 != 0 {
            y ^= column;
        }
        bits >>= 1;
        column ^= column >> 1;
    }
    let fraction = |bits: u32| (bits >> 8) as f32 / (1 << 24) as f32;
    [fraction(index.reverse_bits() ^ mix(sample)), fraction(y ^ mix(sample ^ 0x5bd1_e995))]
}

/// Mixes bits well (Wellons' lowbias32).
fn mix(mut x: u32) -> u32 {
    x = (x ^ x >> 16).wrapping_mul(0x21f0_aaad);
    x = (x ^ x >> 15).wrapping_mul(0x735a_2d97);
    x ^ x >> 15
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bundles_are_stratified_and_above_the_surface() {
        for sample in [0, 7, 12345] {
            let mut cells = [[0; 8]; 4];
            for ray in 0..32 {
                let [u, v] = sobol(ray, sample);
                cells[(u * 4.0) as usize][(v * 8.0) as usize] += 1;
            }
            assert_eq!(cells, [[1; 8]; 4], "sample {sample}");
        }
        let corners = [Vec3::ZERO, Vec3::X, Vec3::Y];
        let (origin, normal) = leave(corners, Vec3::new(0.2, 0.2, 0.0), Vec3::Z);
        assert_eq!(normal, Vec3::NEG_Z);
        assert_eq!(origin, Vec3::new(0.2, 0.2, 0.0));
        let (origin, _) = leave(corners.map(|p| p + Vec3::Z), Vec3::new(0.2, 0.2, 1.0), Vec3::Z);
        assert!(origin.z < 1.0 && origin.z > 1.0 - 1e-5);
    }
}
