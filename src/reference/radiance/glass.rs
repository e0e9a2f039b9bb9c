//! Light through glass (KHR_materials_transmission, _volume), in `f64`.
//!
//! An interface of index n reflects what Fresnel's equations say of light without polarisation, at microfacets by
//! GGX (Walter et al. 2007); the rest goes on refracted, or, through thin glass, straight as far as roughness lets
//! it. Thin glass multiplies it by its base colour once, solid glass by the root at each side, and by
//! exp(-attenuation · distance) inside. Rays that see something through glass meet other glass; light that falls
//! on surfaces passes glass straight: [`Material::clear`](crate::scene::Material::clear).

use glam::DVec3;
use std::f64::consts::TAU;

use super::Renderer;
use crate::reference::brdf::{self, MIN_COSINE};
use crate::reference::intersect::Ray;
use crate::reference::light;
use crate::reference::random::Random;
use crate::reference::surface::{Surface, SurfaceGlass};

/// Interfaces that a path crosses at most.
const STEPS: u32 = 16;

impl Renderer<'_> {
    /// One sample of what is seen through a surface.
    pub(super) fn through(&self, surface: &Surface, random: &mut Random) -> DVec3 {
        let Some(mut glass) = surface.glass else { return DVec3::ZERO };
        let (mut at, mut throughput, mut choice) = (*surface, DVec3::splat(glass.transmission), 1.0);
        for _ in 0..STEPS {
            let Some((ray, weight)) = cross(&at, &glass, choice, random) else { return DVec3::ZERO };
            throughput *= weight;
            let inside = glass.solid && (ray.direction.dot(at.geometric_normal) < 0.0) != glass.back;
            let mut pick = random.uniform();
            let met = self.tracer.layers(&ray, f64::INFINITY).into_iter().find(|layer| {
                pick -= layer.weight;
                pick < 0.0
            });
            let Some(layer) = met else {
                return throughput * light::background(self.environment, ray.direction);
            };
            if inside {
                throughput *= (-glass.attenuation * layer.hit.t).exp();
            }
            let next = Surface::at(&self.tracer, &ray, &layer.hit, self.texture_mode);
            match next.glass {
                Some(other) if random.uniform() < other.transmission => {
                    (at, glass, choice) = (next, other, random.uniform());
                }
                _ => return throughput * self.shade(&next.without_glass(), 0, random),
            }
        }
        DVec3::ZERO
    }
}

/// A ray that goes on from a surface of glass, and its weight. It is reflected where `choice` is below the
/// reflectance; a choice of 1 never is, and then what is reflected is missing in the weight.
fn cross(surface: &Surface, glass: &SurfaceGlass, choice: f64, random: &mut Random) -> Option<(Ray, DVec3)> {
    let (n, v) = (surface.normal, surface.view);
    let [u, azimuth] = random.pair();
    let square = brdf::alpha(surface).powi(2);
    let cosine = ((1.0 - u) / (1.0 + (square - 1.0) * u)).sqrt();
    let h = light::around(n, cosine, azimuth * TAU);
    let v_h = v.dot(h);
    if v_h <= 0.0 {
        return None;
    }
    let eta = if glass.back { glass.ior } else { 1.0 / glass.ior };
    let reflectance = reflectance(v_h, if glass.solid { eta } else { 1.0 / glass.ior });
    let reflects = choice < reflectance;
    let mirrored = 2.0 * v_h * h - v;
    let direction = match (reflects, glass.solid) {
        (true, _) => mirrored,
        (false, true) => refracted(v, h, eta)?,
        (false, false) => mirrored - 2.0 * mirrored.dot(n) * n,
    };
    if (direction.dot(surface.geometric_normal) > 0.0) != reflects {
        return None;
    }
    let masked = |cosine: f64| {
        let cosine = cosine.abs().max(MIN_COSINE);
        2.0 * cosine / (cosine + (cosine * cosine * (1.0 - square) + square).sqrt())
    };
    let n_v = n.dot(v).max(MIN_COSINE);
    let facets = masked(n_v) * masked(n.dot(direction)) * v_h / (n_v * cosine);
    let passed = if glass.solid { surface.base_color.map(f64::sqrt) } else { surface.base_color };
    let passed = passed * if choice >= 1.0 { 1.0 - reflectance } else { 1.0 };
    let weight = if reflects { DVec3::ONE } else { passed } * facets;
    let ray = if reflects { surface.spawn(direction) } else { surface.spawn_behind(direction) };
    Some((ray, weight))
}

/// The direction behind an interface for a view v at a microfacet h on its side; none where all is reflected.
fn refracted(v: DVec3, h: DVec3, eta: f64) -> Option<DVec3> {
    let cosine = v.dot(h);
    let squared = 1.0 - eta * eta * (1.0 - cosine * cosine);
    (squared >= 0.0).then(|| -v * eta + h * (eta * cosine - squared.sqrt()))
}

/// Fresnel's reflectance; `eta` is the index on the light's side over that behind.
pub fn reflectance(cosine: f64, eta: f64) -> f64 {
    let squared = eta * eta * (1.0 - cosine * cosine);
    if squared >= 1.0 {
        return 1.0;
    }
    let behind = (1.0 - squared).sqrt();
    let across = (cosine * eta - behind) / (cosine * eta + behind);
    let along = (cosine - behind * eta) / (cosine + behind * eta);
    (across * across + along * along) / 2.0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fresnel_has_its_known_values() {
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-4, "{a} {b}");
        close(reflectance(1.0, 1.0 / 1.5), 0.04);
        close(reflectance(1.0, 1.5), 0.04);
        close(reflectance(60f64.to_radians().cos(), 1.0 / 1.5), 0.0892);
        close(reflectance(1e-9, 1.0 / 1.5), 1.0);
        // Beyond the critical angle of 41.8 degrees.
        assert_eq!(reflectance(42f64.to_radians().cos(), 1.5), 1.0);
        // At Brewster's angle, atan 1.5, only half of the light is reflected at all.
        close(reflectance(1.5f64.atan().cos(), 1.0 / 1.5), 0.0740);
    }

    #[test]
    fn refraction_obeys_snell() {
        let (n, angle) = (DVec3::Y, 50f64.to_radians());
        let v = DVec3::new(angle.sin(), angle.cos(), 0.0);
        let through = refracted(v, n, 1.0 / 1.5).unwrap();
        assert!((through.length() - 1.0).abs() < 1e-12 && through.y < 0.0 && through.x < 0.0);
        assert!((through.x.abs() * 1.5 - angle.sin()).abs() < 1e-12);
        assert_eq!(refracted(v, n, 1.5), None);
    }
}
