//! Materials with more than metallic-roughness, in `f64`: KHR_materials_specular, _ior, _clearcoat, _sheen and
//! _anisotropy by their specifications.
//!
//! With the dielectric's F0 f, weight w, and the half vector's cosine c to the view: `F = mix(f, base, m) +
//! (mix(w, 1, m) - mix(f, base, m)) (1 - c)⁵`. Diffuse gets what F leaves: of each channel, or, where the specular
//! reflection has a colour, what its largest channel leaves. Sheen is Charlie's distribution (Estevez and Kulla
//! 2017) with Neubelt's visibility; what is below it is scaled by `1 - max(colour) max(E(N·V), E(N·L))`, E the
//! share of light that white sheen reflects. A coat with weight k reflects `k (0.04 + 0.96 (1 - N·V)⁵)` and lets the rest through, emission too.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::brdf::{MIN_ALPHA, MIN_COSINE, diffuse_color};
use super::radiance::glass::reflectance;
use super::surface::Surface;

/// What a surface has beside metallic-roughness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SurfaceLayers {
    /// The dielectric's F0, its weight included.
    pub dielectric: DVec3,
    /// The dielectric's F90: the weight of its specular reflection.
    pub specular: f64,
    /// The specular reflection has a colour.
    pub tinted: bool,
    /// Unit tangent, across the shading normal.
    pub tangent: DVec3,
    /// GGX alphas along the tangent and across it.
    pub alphas: DVec2,
    /// Clearcoat's weight.
    pub coat: f64,
    /// Its GGX alpha.
    pub coat_alpha: f64,
    /// Its unit shading normal.
    pub coat_normal: DVec3,
    /// Sheen's colour.
    pub sheen: DVec3,
    /// Sheen's perceptual roughness.
    pub sheen_roughness: f64,
}

/// The share of light that a coat reflects instead of letting it through.
pub fn coat_share(coat: f64, normal: DVec3, view: DVec3) -> f64 {
    coat * (0.04 + 0.96 * (1.0 - normal.dot(view).clamp(0.0, 1.0)).powi(5))
}

/// The BRDF for light from the unit direction `light`, without the cosine of the shading normal.
pub fn evaluate(surface: &Surface, layers: &SurfaceLayers, light: DVec3) -> DVec3 {
    let (n, v) = (surface.normal, surface.view);
    let n_l = n.dot(light);
    if n_l <= 0.0 {
        return DVec3::ZERO;
    }
    let Some(h) = (v + light).try_normalize() else { return DVec3::ZERO };
    let n_v = n.dot(v).max(MIN_COSINE);
    let f0 = layers.dielectric.lerp(surface.base_color, surface.metallic);
    let f90 = layers.specular + (1.0 - layers.specular) * surface.metallic;
    let fresnel = f0 + (f90 - f0) * (1.0 - v.dot(h).abs().min(1.0)).powi(5);
    let fresnel = surface.glass.map_or(fresnel, |glass| {
        DVec3::splat(layers.specular * reflectance(v.dot(h).abs(), 1.0 / glass.ior))
    });
    let passed = if layers.tinted { DVec3::splat(1.0 - fresnel.max_element()) } else { 1.0 - fresnel };
    let diffuse = passed * diffuse_color(surface) / PI;
    let across = n.cross(layers.tangent);
    let mut sum = diffuse + fresnel * microfacets([layers.tangent, across, n], layers.alphas, v, light);
    let sheen = layers.sheen.max_element();
    if sheen > 0.0 {
        let albedo = sheen_albedo(layers.sheen_roughness, n_v).max(sheen_albedo(layers.sheen_roughness, n_l));
        sum *= (1.0 - sheen * albedo).max(0.0);
        sum += layers.sheen * charlie(layers.sheen_roughness, n.dot(h)) / (4.0 * (n_l + n_v - n_l * n_v));
    }
    if layers.coat > 0.0 {
        let share = coat_share(layers.coat, layers.coat_normal, v);
        let (x, y) = layers.coat_normal.any_orthonormal_pair();
        let lobe = microfacets([x, y, layers.coat_normal], DVec2::splat(layers.coat_alpha), v, light);
        sum = sum * (1.0 - share) + share * lobe * layers.coat_normal.dot(light).max(0.0) / n_l;
    }
    sum
}

/// A GGX alpha of a perceptual roughness.
pub fn alpha_of(roughness: f64) -> f64 {
    (roughness * roughness).max(MIN_ALPHA)
}

/// GGX with an alpha for each axis of a frame whose last is the normal: `D G / (4 N·L N·V)` (Heitz 2014).
fn microfacets(frame: [DVec3; 3], alphas: DVec2, view: DVec3, light: DVec3) -> f64 {
    let into = |d: DVec3| DVec3::new(d.dot(frame[0]), d.dot(frame[1]), d.dot(frame[2]));
    let (mut v, l, h) = (into(view), into(light), into((view + light).normalize()));
    v.z = v.z.max(MIN_COSINE);
    if l.z <= 0.0 || h.z <= 0.0 {
        return 0.0;
    }
    let stretched = (h.x / alphas.x).powi(2) + (h.y / alphas.y).powi(2) + h.z * h.z;
    let distribution = 1.0 / (PI * alphas.x * alphas.y * stretched * stretched);
    let lambda = |w: DVec3| {
        let slope = ((alphas.x * w.x).powi(2) + (alphas.y * w.y).powi(2)) / (w.z * w.z);
        ((1.0 + slope).sqrt() - 1.0) / 2.0
    };
    distribution / ((1.0 + lambda(v) + lambda(l)) * 4.0 * v.z * l.z)
}

/// Sheen's distribution of normals.
fn charlie(roughness: f64, n_h: f64) -> f64 {
    let inverse = 1.0 / (roughness * roughness).max(1e-3);
    let sine = (1.0 - n_h.clamp(0.0, 1.0).powi(2)).max(0.0).sqrt();
    (2.0 + inverse) * sine.powf(inverse) / (2.0 * PI)
}

/// The share of light from a direction that white sheen reflects, at most 1: integrals of its lobe for perceptual
/// roughness 0.1 to 1 (rows) and roots of the cosine 0 to 1 (columns).
const SHEEN_ALBEDO: [[f64; 8]; 8] = [
    [1.0000, 1.0000, 1.0000, 0.2974, 0.0359, 0.0011, 0.0000, 0.0000],
    [1.0000, 1.0000, 0.9803, 0.5472, 0.2431, 0.0755, 0.0116, 0.0001],
    [1.0000, 1.0000, 0.7979, 0.5454, 0.3296, 0.1656, 0.0586, 0.0056],
    [0.9482, 0.8519, 0.6846, 0.5135, 0.3557, 0.2192, 0.1087, 0.0279],
    [0.8087, 0.7373, 0.6130, 0.4843, 0.3617, 0.2490, 0.1480, 0.0600],
    [0.7243, 0.6664, 0.5659, 0.4617, 0.3612, 0.2663, 0.1767, 0.0918],
    [0.6696, 0.6197, 0.5337, 0.4448, 0.3589, 0.2768, 0.1976, 0.1192],
    [0.6322, 0.5875, 0.5109, 0.4322, 0.3564, 0.2837, 0.2129, 0.1414],
];

/// [`SHEEN_ALBEDO`] between its entries.
fn sheen_albedo(roughness: f64, cosine: f64) -> f64 {
    let place = |x: f64| {
        let x = x.clamp(0.0, 1.0) * 7.0;
        let low = (x as usize).min(6);
        (low, x - low as f64)
    };
    let ((i, down), (j, right)) = (place((roughness - 0.1) / 0.9), place(cosine.clamp(0.0, 1.0).sqrt()));
    let row = |i: usize| SHEEN_ALBEDO[i][j] * (1.0 - right) + SHEEN_ALBEDO[i][j + 1] * right;
    row(i) * (1.0 - down) + row(i + 1) * down
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference::testing::on_sphere;
    use crate::reference::{Random, brdf};

    fn plain(alphas: DVec2) -> SurfaceLayers {
        SurfaceLayers {
            dielectric: DVec3::splat(0.04),
            specular: 1.0,
            tinted: false,
            tangent: DVec3::X,
            alphas,
            coat: 0.0,
            coat_alpha: 0.1,
            coat_normal: DVec3::Y,
            sheen: DVec3::ZERO,
            sheen_roughness: 0.5,
        }
    }

    /// Light reflected from an even sky by a unit view at an angle to the normal +Y, in all channels.
    fn reflected(layers: &SurfaceLayers, base: f64, metallic: f64, view: DVec3) -> DVec3 {
        let surface = brdf::tests::surface(metallic, 0.5, base, view);
        let mut random = Random::new(3);
        let n = 60_000;
        let one = |_| {
            let direction = on_sphere(&mut random);
            let light = DVec3::new(direction.x, direction.y.abs(), direction.z);
            evaluate(&surface, layers, light) * light.y * 2.0 * PI
        };
        (0..n).map(one).sum::<DVec3>() / f64::from(n)
    }

    #[test]
    fn without_anything_it_is_metallic_roughness() {
        let mut random = Random::new(9);
        for _ in 0..200 {
            let up = |d: DVec3| DVec3::new(d.x, d.y.abs().max(0.02), d.z).normalize();
            let (v, l) = (up(on_sphere(&mut random)), up(on_sphere(&mut random)));
            let surface = brdf::tests::surface(random.uniform(), 0.6, 0.7, v);
            let (with, without) =
                (evaluate(&surface, &plain(DVec2::splat(0.36)), l), brdf::evaluate(&surface, l));
            assert!((with - without).abs().max_element() < 1e-9 * without.max_element(), "{with} {without}");
        }
    }

    #[test]
    fn anisotropic_facets_cover_their_plane_and_stretch_along_the_tangent() {
        let alphas = DVec2::new(0.3, 0.05);
        // A white metal reflects nearly all light, as far as single scattering does.
        let metal = |alphas| reflected(&plain(alphas), 1.0, 1.0, DVec3::Y).x;
        assert!((metal(alphas) - 0.95).abs() < 0.06, "{}", metal(alphas));
        let frame = [DVec3::X, DVec3::Z, DVec3::Y];
        let lobe = |l: DVec3| microfacets(frame, alphas, DVec3::Y, l.normalize());
        assert!(lobe(DVec3::new(0.5, 1.0, 0.0)) > 5.0 * lobe(DVec3::new(0.0, 1.0, 0.5)));
    }

    #[test]
    fn nothing_reflects_more_than_it_gets() {
        for cosine in [0.2f64, 0.6, 1.0] {
            let view = DVec3::new((1.0 - cosine * cosine).sqrt(), cosine, 0.0);
            let coated = SurfaceLayers { coat: 1.0, ..plain(DVec2::splat(0.3)) };
            let velvet =
                SurfaceLayers { sheen: DVec3::ONE, sheen_roughness: 0.4, ..plain(DVec2::splat(0.9)) };
            let tinted = SurfaceLayers {
                dielectric: DVec3::new(0.9, 0.1, 0.05),
                tinted: true,
                ..plain(DVec2::splat(0.3))
            };
            for (name, layers) in [("coat", coated), ("sheen", velvet), ("tint", tinted)] {
                let all = reflected(&layers, 1.0, 0.0, view).max_element();
                assert!(all < 1.06, "{name} at {cosine}: {all}");
                assert!(all > 0.5, "{name} at {cosine}: {all}");
            }
        }
    }

    #[test]
    fn sheens_albedo_is_that_of_its_lobe() {
        for roughness in [0.3, 0.5, 1.0] {
            for cosine in [0.3f64, 0.7, 1.0] {
                let view = DVec3::new((1.0 - cosine * cosine).sqrt(), cosine, 0.0);
                let sheen = SurfaceLayers {
                    sheen: DVec3::ONE,
                    sheen_roughness: roughness,
                    dielectric: DVec3::ZERO,
                    specular: 0.0,
                    ..plain(DVec2::splat(0.3))
                };
                let (lobe, fit) = (reflected(&sheen, 0.0, 0.0, view).x, sheen_albedo(roughness, cosine));
                assert!((lobe - fit).abs() < 0.05, "{roughness} {cosine}: {lobe} {fit}");
            }
        }
    }
}
