//! glTF 2.0's metallic-roughness BRDF (specification, appendix B), in `f64`.
//!
//! With base colour c, metalness m, `F0 = mix(0.04, c, m)` and Schlick's `F = F0 + (1 - F0)(1 - |V·H|)⁵`:
//! diffuse `(1 - F) (1 - m) c / π`, specular `F D(N·H) G / (4 N·L N·V)` with GGX's D and Smith's
//! height-correlated G (Heitz 2014), `α = roughness²` clamped to [`MIN_ALPHA`].

use std::f64::consts::PI;

use glam::DVec3;

use super::layers;
use super::radiance::glass::reflectance;
use super::surface::Surface;

/// The smallest GGX α: smoother surfaces are treated as this smooth.
pub const MIN_ALPHA: f64 = 1e-3;

/// The smallest N·V: normal maps may turn a normal away from the viewer.
pub const MIN_COSINE: f64 = 1e-4;

/// The BRDF of a surface for light from the unit direction `light`, without the cosine.
pub fn evaluate(surface: &Surface, light: DVec3) -> DVec3 {
    if let Some(layers) = &surface.layers {
        return layers::evaluate(surface, layers, light);
    }
    let (n, v) = (surface.normal, surface.view);
    let n_l = n.dot(light);
    if n_l <= 0.0 {
        return DVec3::ZERO;
    }
    let Some(h) = (v + light).try_normalize() else { return DVec3::ZERO };
    let alpha = alpha(surface);
    let f0 = DVec3::splat(0.04).lerp(surface.base_color, surface.metallic);
    let fresnel = f0 + (1.0 - f0) * (1.0 - v.dot(h).abs().min(1.0)).powi(5);
    let fresnel =
        surface.glass.map_or(fresnel, |glass| DVec3::splat(reflectance(v.dot(h).abs(), 1.0 / glass.ior)));
    let diffuse = (1.0 - fresnel) * diffuse_color(surface) / PI;
    let specular = distribution(n.dot(h), alpha) * visibility(n_l, n.dot(v).max(MIN_COSINE), alpha);
    diffuse + fresnel * specular
}

/// What of a surface's colour reflects diffusely: none of metal or glass.
pub fn diffuse_color(surface: &Surface) -> DVec3 {
    let transmission = surface.glass.map_or(0.0, |glass| glass.transmission);
    surface.base_color * ((1.0 - surface.metallic) * (1.0 - transmission))
}

/// A surface's GGX α.
pub fn alpha(surface: &Surface) -> f64 {
    (surface.roughness * surface.roughness).max(MIN_ALPHA)
}

/// GGX's density of microfacet normals, 0 below the horizon.
pub fn distribution(n_h: f64, alpha: f64) -> f64 {
    if n_h <= 0.0 {
        return 0.0;
    }
    // cos² (α² - 1) + 1, written so that nothing cancels near the normal.
    let spread = (1.0 - n_h.min(1.0)) * (1.0 + n_h) + alpha * alpha * n_h * n_h;
    alpha * alpha / (PI * spread * spread)
}

/// `G / (4 N·L N·V)`.
fn visibility(n_l: f64, n_v: f64, alpha: f64) -> f64 {
    let square = alpha * alpha;
    let shadow = |a: f64, b: f64| a * (b * b * (1.0 - square) + square).sqrt();
    0.5 / (shadow(n_l, n_v) + shadow(n_v, n_l))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::reference::intersect::{Ray, Tracer};
    use crate::reference::testing::{floor, on_sphere};
    use crate::reference::{Random, TextureMode};
    use crate::scene::Material;

    /// A surface with normal +Y, seen from a unit direction.
    pub fn surface(metallic: f64, roughness: f64, color: f64, view: DVec3) -> Surface {
        let scene = floor(1.0, Material::default());
        let tracer = Tracer::new(&scene);
        let ray = Ray { origin: view + DVec3::new(0.1, 0.0, 0.2), direction: -view };
        let hit = tracer.closest(&ray, 9.0).unwrap();
        let mut surface = Surface::at(&tracer, &ray, &hit, TextureMode::Level0);
        surface.metallic = metallic;
        surface.roughness = roughness;
        surface.base_color = DVec3::splat(color);
        surface
    }

    fn upper(random: &mut Random) -> DVec3 {
        let direction = on_sphere(random);
        DVec3::new(direction.x, direction.y.abs().max(0.02), direction.z).normalize()
    }

    #[test]
    fn light_and_view_are_interchangeable() {
        let mut random = Random::new(5);
        for _ in 0..200 {
            let (v, l) = (upper(&mut random), upper(&mut random));
            let (metallic, roughness) = (random.uniform(), random.uniform());
            let there = evaluate(&surface(metallic, roughness, 0.7, v), l).x;
            let back = evaluate(&surface(metallic, roughness, 0.7, l), v).x;
            assert!((there - back).abs() <= 1e-6 * there.max(1e-3), "{there} {back}");
        }
    }

    #[test]
    fn microfacets_cover_their_plane() {
        // The integral of D(h) N·h over the hemisphere is 1; substituting x = N·h.
        for alpha in [MIN_ALPHA, 0.05, 0.3, 1.0] {
            let steps = 2_000_000;
            let sum: f64 = (0..steps)
                .map(|i| {
                    // Steps are dense near x = 1, where a smooth surface's facets are.
                    let s = (f64::from(i) + 0.5) / f64::from(steps);
                    let x = 1.0 - s.powi(4);
                    distribution(x, alpha) * x * 4.0 * s.powi(3) / f64::from(steps)
                })
                .sum();
            assert!((2.0 * PI * sum - 1.0).abs() < 1e-5, "{alpha}: {}", 2.0 * PI * sum);
        }
    }

    #[test]
    fn known_values() {
        // α = 1, viewed and lit from the normal: D = 1/π, G/(4..) = 1/4, F = F0.
        let dielectric = evaluate(&surface(0.0, 1.0, 0.5, DVec3::Y), DVec3::Y).x;
        assert!((dielectric - (0.96 * 0.5 + 0.04 / 4.0) / PI).abs() < 1e-12);
        let metal = evaluate(&surface(1.0, 1.0, 0.5, DVec3::Y), DVec3::Y).x;
        assert!((metal - 0.5 / 4.0 / PI).abs() < 1e-12);
        assert_eq!(evaluate(&surface(0.0, 1.0, 0.5, DVec3::Y), DVec3::NEG_Y), DVec3::ZERO);
    }
}
