//! The light that arrives along a ray, estimated by path tracing or summed on a grid.
//!
//! Sampling is on purpose not the kernels': directions come from one mixture density of cosine, GGX
//! normals (Walter et al. 2007, not the visible ones) and the map's cumulative power, without MIS.

pub mod glass;

use std::f64::consts::{PI, TAU};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::brdf;
use super::intersect::{Layer, Ray, Tracer};
use super::light::{self, EnvironmentSampler};
use super::random::Random;
use super::surface::Surface;
use super::texture::TextureMode;
use crate::math::view::View;
use crate::scene::emitters::Source;
use crate::scene::{Environment, Scene, Sun};

/// A mean of independent samples, per channel.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Estimate {
    /// Linear RGB radiance.
    pub mean: DVec3,
    /// The mean's standard error; infinite for fewer than two samples.
    pub standard_error: DVec3,
    /// How many samples there were.
    pub samples: u32,
}

impl Estimate {
    /// Mean and standard error of samples (Welford's recurrence).
    pub fn of(values: impl IntoIterator<Item = DVec3>) -> Self {
        let (mut mean, mut squares, mut count) = (DVec3::ZERO, DVec3::ZERO, 0u32);
        for value in values {
            count += 1;
            let before = value - mean;
            mean += before / f64::from(count);
            squares += before * (value - mean);
        }
        let variance = squares / f64::from(count.max(1) - u32::from(count > 0));
        let standard_error =
            if count > 1 { (variance / f64::from(count)).map(f64::sqrt) } else { DVec3::INFINITY };
        Estimate { mean, standard_error, samples: count }
    }
}

/// The ray through a point of a view's image in pixels (centres at halves), relative to the scene's
/// anchor, its direction a unit vector.
pub fn camera_ray(scene: &Scene, view: &View, pixel: DVec2) -> Ray {
    let direction = (view.world_from_eye.rotation * view.eye_direction(pixel)).normalize();
    Ray { origin: view.world_from_eye.position - scene.anchor, direction }
}

/// A scene in its light.
#[derive(Debug)]
pub struct Renderer<'a> {
    /// The scene, prepared for rays.
    pub tracer: Tracer<'a>,
    /// How textures are read.
    pub texture_mode: TextureMode,
    /// Bounces after the first surface: 0 is direct light only.
    pub bounces: u32,
    environment: &'a Environment,
    map: EnvironmentSampler,
    has_emitters: bool,
    /// Nothing beyond this box is in the way of directional lights.
    lit: Option<[DVec3; 2]>,
}

impl<'a> Renderer<'a> {
    /// Direct light only and textures at level 0, until the fields say otherwise.
    pub fn new(scene: &'a Scene, environment: &'a Environment) -> Self {
        Renderer {
            tracer: Tracer::new(scene),
            texture_mode: TextureMode::Level0,
            bounces: 0,
            environment,
            map: EnvironmentSampler::new(environment),
            has_emitters: crate::scene::emitters::any(scene),
            lit: crate::scene::emitters::lit_bounds(scene).map(|lit| lit.map(|corner| corner.as_dvec3())),
        }
    }

    /// The radiance along a camera ray. BLEND layers in front are weighted exactly.
    pub fn radiance(&self, ray: &Ray, samples: u32, random: &mut Random) -> Estimate {
        let (surfaces, background) = self.seen(ray);
        Estimate::of((0..samples).map(|_| {
            let shaded = surfaces.iter().map(|(weight, surface)| *weight * self.shade(surface, 0, random));
            background + shaded.sum::<DVec3>()
        }))
    }

    /// [`Renderer::radiance`] through the centre of every pixel, rows from the top. Deterministic for a
    /// seed, however many threads there are.
    pub fn picture(&self, view: &View, samples: u32, seed: u64) -> Vec<Estimate> {
        let width = view.width as usize;
        let estimate = |pixel: usize| {
            let centre = DVec2::new((pixel % width) as f64, (pixel / width) as f64) + 0.5;
            let mut random = Random::new(seed ^ (pixel as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15));
            self.radiance(&camera_ray(self.tracer.scene(), view, centre), samples, &mut random)
        };
        (0..view.pixels()).into_par_iter().map(estimate).collect()
    }

    /// Emission and direct light along a camera ray by the midpoint rule, without chance: `grid` by
    /// `4 * grid` directions for the map (equal areas of the cosine-weighted hemisphere) and as many for
    /// the sun's disc. Only as good as the grid is fine: not for smooth metals or maps with a small sun.
    pub fn direct_by_quadrature(&self, ray: &Ray, grid: u32) -> DVec3 {
        let (surfaces, background) = self.seen(ray);
        let shade = |surface: &Surface| {
            if surface.unlit {
                return surface.base_color;
            }
            let map = midpoints(grid, |at| {
                let direction = light::around(surface.normal, (1.0 - at[0]).sqrt(), at[1] * TAU);
                self.map_arriving(surface, direction) * PI
            });
            let sun = self.environment.sun.as_ref().map_or(DVec3::ZERO, |sun| {
                midpoints(grid, |at| self.sun_arriving(surface, sun, light::towards_sun(sun, at)))
            });
            surface.emission + map + sun + self.punctual(surface) + self.emitters(surface, grid)
        };
        background + surfaces.iter().map(|(weight, surface)| *weight * shade(surface)).sum::<DVec3>()
    }

    /// The surfaces that a camera ray sees with their weights, and the background's share of its light.
    fn seen(&self, ray: &Ray) -> (Vec<(f64, Surface)>, DVec3) {
        let layers = self.tracer.layers(ray, f64::INFINITY);
        let left = (1.0 - layers.iter().map(|layer| layer.weight).sum::<f64>()).max(0.0);
        let background = light::background(self.environment, ray.direction.normalize());
        let surface =
            |layer: &Layer| (layer.weight, Surface::at(&self.tracer, ray, &layer.hit, self.texture_mode));
        (layers.iter().map(surface).collect(), background * left)
    }

    /// One sample of what a surface sends to its viewer.
    fn shade(&self, surface: &Surface, depth: u32, random: &mut Random) -> DVec3 {
        if surface.unlit {
            return surface.base_color;
        }
        let mut light = if depth == 0 { surface.emission } else { DVec3::ZERO } + self.punctual(surface);
        if self.map.is_lit() {
            let direction = self.draw(surface, Some(&self.map), random);
            if surface.faces(direction) {
                let share = surface.normal.dot(direction) / density(surface, Some(&self.map), direction);
                light += self.map_arriving(surface, direction) * share;
            }
        }
        if let Some(sun) = &self.environment.sun {
            light += self.sun_arriving(surface, sun, light::towards_sun(sun, random.pair()));
        }
        if depth < self.bounces || self.has_emitters {
            light += self.bounce(surface, depth, random);
        }
        light + self.through(surface, random)
    }

    /// One sample of what other surfaces send by way of this one: what is their own, as direct light, and what they
    /// reflect while bounces are left.
    fn bounce(&self, surface: &Surface, depth: u32, random: &mut Random) -> DVec3 {
        let direction = self.draw(surface, None, random);
        if !surface.faces(direction) {
            return DVec3::ZERO;
        }
        let ray = surface.spawn(direction);
        let mut choice = random.uniform();
        let met = self.tracer.layers(&ray, f64::INFINITY).into_iter().find(|layer| {
            choice -= layer.weight;
            choice < 0.0
        });
        let Some(layer) = met else { return DVec3::ZERO };
        let next = Surface::at(&self.tracer, &ray, &layer.hit, self.texture_mode);
        let cosine = surface.normal.dot(direction);
        let through = brdf::evaluate(surface, direction) * cosine / density(surface, None, direction);
        let own = if next.unlit { next.base_color } else { next.emission };
        let reflected = if depth < self.bounces && !next.unlit {
            self.shade(&next, depth + 1, random)
        } else {
            DVec3::ZERO
        };
        through * (own + reflected)
    }

    /// The map's light from a direction, reflected: BRDF times radiance, without the cosine.
    fn map_arriving(&self, surface: &Surface, direction: DVec3) -> DVec3 {
        if !surface.faces(direction) {
            return DVec3::ZERO;
        }
        let open = self.tracer.transmittance(&surface.spawn(direction), f64::INFINITY);
        let radiance = light::environment(self.environment, direction);
        brdf::evaluate(surface, direction) * radiance * (open * surface.occlusion)
    }

    /// The light of the whole sun, reflected, as if all of its disc were like this direction.
    fn sun_arriving(&self, surface: &Surface, sun: &Sun, direction: DVec3) -> DVec3 {
        let irradiance = sun.radiance.as_dvec3() * light::sun_solid_angle(sun);
        self.beam(surface, direction, f64::INFINITY, irradiance)
    }

    fn punctual(&self, surface: &Surface) -> DVec3 {
        let lights = self.tracer.scene().lights.iter();
        let arrivals = lights.filter_map(|light| light::punctual(light, surface.position));
        let reach = |direction: DVec3| match self.lit {
            None => f64::INFINITY,
            Some([low, high]) => {
                (0..3).filter(|&axis| direction[axis] != 0.0).fold(f64::INFINITY, |t, axis| {
                    let side = if direction[axis] > 0.0 { high[axis] } else { low[axis] };
                    t.min((side - surface.position[axis]) / direction[axis])
                })
            }
        };
        let beam = |a: light::Arrival| {
            let distance = if a.distance.is_finite() { a.distance } else { reach(a.direction) };
            self.beam(surface, a.direction, surface.distance_left(a.direction, distance), a.irradiance)
        };
        arrivals.map(beam).sum()
    }

    /// The light of triangles that emit, reflected, by the midpoint rule over their areas.
    fn emitters(&self, surface: &Surface, grid: u32) -> DVec3 {
        let triangles = crate::scene::emitters::of(self.tracer.scene()).into_iter();
        let sources = triangles.filter_map(|emitter| match emitter.source {
            Source::Triangle(index) => Some(self.tracer.corners[index as usize]),
            Source::Light(_) => None,
        });
        sources.map(|corners| midpoints(grid, |at| self.emitted_arriving(surface, corners, at))).sum()
    }

    /// The light of a whole triangle, reflected, as if all of it were like the point that uniform `at` chooses.
    fn emitted_arriving(&self, surface: &Surface, [a, b, c]: [DVec3; 3], at: [f64; 2]) -> DVec3 {
        let root = at[0].sqrt();
        let point = a + (b - a) * (root * (1.0 - at[1])) + (c - a) * (root * at[1]);
        let offset = point - surface.spawn(DVec3::ZERO).origin;
        let direction = offset.normalize_or_zero();
        let ray = surface.spawn(direction);
        let Some(hit) = self.tracer.closest(&ray, f64::INFINITY) else { return DVec3::ZERO };
        if (hit.t / offset.length() - 1.0).abs() > 1e-6 || !surface.faces(direction) {
            return DVec3::ZERO;
        }
        let source = Surface::at(&self.tracer, &ray, &hit, self.texture_mode);
        let radiance = if source.unlit { source.base_color } else { source.emission };
        let solid_angle = 0.5 * (b - a).cross(c - a).dot(direction).abs() / offset.length_squared();
        brdf::evaluate(surface, direction) * radiance * (solid_angle * surface.normal.dot(direction))
    }

    /// A beam of light that has `irradiance` across it, reflected towards the viewer.
    fn beam(&self, surface: &Surface, direction: DVec3, distance: f64, irradiance: DVec3) -> DVec3 {
        if !surface.faces(direction) {
            return DVec3::ZERO;
        }
        let open = self.tracer.transmittance(&surface.spawn(direction), distance);
        brdf::evaluate(surface, direction) * irradiance * (open * surface.normal.dot(direction))
    }

    /// A direction of the mixture whose density is [`density`].
    fn draw(&self, surface: &Surface, map: Option<&EnvironmentSampler>, random: &mut Random) -> DVec3 {
        let techniques = if map.is_some() { 3.0 } else { 2.0 };
        match ((random.uniform() * techniques) as u32, map) {
            (0, _) => {
                let [u, v] = random.pair();
                light::around(surface.normal, (1.0 - u).sqrt(), v * TAU)
            }
            (2, Some(map)) => map.sample(random),
            _ => {
                let [u, v] = random.pair();
                let square = brdf::alpha(surface).powi(2);
                let cosine = ((1.0 - u) / (1.0 + (square - 1.0) * u)).sqrt();
                let h = light::around(surface.normal, cosine, v * TAU);
                (2.0 * surface.view.dot(h) * h - surface.view).normalize()
            }
        }
    }
}

/// The density over solid angle of the directions in which light is looked for: equal parts of a cosine
/// lobe, of reflections at GGX normals, and of the map where there is one.
fn density(surface: &Surface, map: Option<&EnvironmentSampler>, direction: DVec3) -> f64 {
    let cosine = surface.normal.dot(direction).max(0.0) / PI;
    let h = (surface.view + direction).normalize_or_zero();
    let (n_h, v_h) = (surface.normal.dot(h).abs(), surface.view.dot(h).abs());
    let facets = brdf::distribution(n_h, brdf::alpha(surface)) * n_h / (4.0 * v_h.max(1e-12));
    match map {
        Some(map) => (cosine + facets + map.density(direction)) / 3.0,
        None => (cosine + facets) / 2.0,
    }
}

/// The mean of `f` at the centres of `grid` by `4 * grid` equal cells of the unit square.
fn midpoints(grid: u32, f: impl Fn([f64; 2]) -> DVec3) -> DVec3 {
    let (rows, columns) = (f64::from(grid), f64::from(4 * grid));
    let cells = (0..grid).flat_map(|i| (0..4 * grid).map(move |j| (f64::from(i) + 0.5, f64::from(j) + 0.5)));
    cells.map(|(i, j)| f([i / rows, j / columns])).sum::<DVec3>() / (rows * columns)
}

#[cfg(test)]
mod tests;
