//! Guided reconstruction in double precision: the stages of `kernels/filter.wgsl` and `kernels/reconstruct.wgsl` under
//! their names, from the records that devices hand over.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

mod denoise;
mod mirrored;
mod penumbra;

use denoise::Spread;

use super::reconstruct::{WeightKind, nearest, weights};
use crate::layout::{
    IS_MAPPED, NOISE_UNLIT, SampleRecord, VisibilityRecord, noise_code, noise_variance, unpack_emission,
    unpack_normal24,
};
use crate::math::pose::Pose;
use crate::math::view::View;
use crate::scene::Sun;

/// What is chosen about it: see `GuidedSettings`.
#[derive(Clone, Copy, Debug)]
pub struct Choices {
    /// Samples that each sample is averaged with, itself included.
    pub neighbours: usize,
    /// Exponent of the cosine between normals.
    pub normal_power: f64,
    /// Sine of the angle out of a surface's plane at which a weight has fallen to 1/e.
    pub plane_tolerance: f64,
    /// Deviations of diffuse and of specular weights by distance, relative to the farthest neighbour's.
    pub deviations: [f64; 2],
    /// Samples that a pixel averages.
    pub k: usize,
    /// Their weights by distance.
    pub weights: WeightKind,
    /// What is added to light and expectation before one is divided by the other.
    pub least_expected: f64,
}

/// A sample after [`Guided::filter_samples`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prepared {
    /// Diffuse light over albedo and over its direction's share.
    pub first: DVec3,
    /// Specular light over F0, or over what was expected.
    pub second: DVec3,
    /// Whether it is over what was expected.
    pub expects: bool,
    /// Metres; negative where values are borrowed, 0 where there are none.
    pub depth: f64,
    /// World-space normal without its map.
    pub normal: DVec3,
    /// How far what hides a part of the sun's disc is, as [`SampleRecord::normal`] has it; 0 where nothing does.
    pub blocker: f64,
    /// Mean directions of red, green and blue light, where they are known.
    pub toward: Option<[DVec3; 3]>,
    /// Variances of the luminances of `first` and `second` that noise has at most; negative where no light falls.
    pub noise: [f64; 2],
}

/// One view's records.
pub struct Guided<'a> {
    /// Where the pixels look.
    pub view: &'a View,
    /// Each sample's pixel.
    pub positions: &'a [[u32; 2]],
    /// One for each pixel, row after row.
    pub visibility: &'a [VisibilityRecord],
    /// The sun whose visibility they hold.
    pub sun: Option<Sun>,
    /// What is chosen.
    pub choices: Choices,
}

/// With less weight than this on its own surface, a pixel looks at every sixth neighbour of its nearest sample.
const ENOUGH: f64 = 0.01;
const STRIDE: usize = 6;
/// Shares of samples that are on other surfaces: with alike normals (then only), any, and holes.
const OTHERS: [f64; 3] = [1e-3, 1e-7, 1e-10];

#[derive(Default)]
struct Light {
    first: DVec3,
    second: DVec3,
    sum: f64,
    second_sum: f64,
    own: f64,
    shadow: f64,
    shadow_sum: f64,
}

/// A pixel's record, unpacked.
struct Surface {
    normal: DVec3,
    mapped: DVec3,
    point: DVec3,
    pixel_width: f64,
    expects: bool,
    diffuse: DVec3,
    f0: DVec3,
    roughness: f64,
}

fn normal24(packed: u32) -> DVec3 {
    DVec3::from(unpack_normal24(packed & 0xff_ffff).map(f64::from)).normalize()
}

fn emission(packed: u32) -> DVec3 {
    DVec3::from(unpack_emission(packed).map(f64::from))
}

/// Where a sample's light comes from, for each colour, as [`SampleRecord::toward`] has it; none where that is not known.
pub fn toward(packed: [u32; 3]) -> Option<[DVec3; 3]> {
    let axis = |packed: u32, shift: u32| f64::from((packed << shift) as i32 >> 22) / 511.0;
    let vector = |packed: u32| DVec3::new(axis(packed, 22), axis(packed, 12), axis(packed, 2));
    (packed[0] & IS_MAPPED != 0).then(|| packed.map(vector))
}

fn finite(record: &SampleRecord) -> bool {
    record.first.iter().chain(&record.second).chain([&record.depth]).all(|v| v.is_finite())
}

fn is_unlit(record: &SampleRecord) -> bool {
    noise_code(record.toward) == NOISE_UNLIT
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from(v.map(f64::from))
}

/// By how much more light of one colour falls on a surface than on one that faces nowhere (Hazel 2017), for the mean
/// of its directions.
pub fn directional_share(toward: DVec3, normal: DVec3) -> f64 {
    let length = toward.length().min(1.0);
    if length == 0.0 {
        return 1.0;
    }
    let q = (0.5 * (1.0 + toward.normalize().dot(normal))).clamp(0.0, 1.0);
    let even = (1.0 - length) / (1.0 + length);
    let power = 1.0 + 2.0 * length;
    (even + (1.0 - even) * (power + 1.0) * q.powf(power)).max(0.1)
}

impl Guided<'_> {
    fn toward_pixel(&self, x: f64, y: f64) -> DVec3 {
        self.view.world_from_eye.rotation * self.view.eye_direction(DVec2::new(x + 0.5, y + 0.5))
    }

    fn point_at(&self, [x, y]: [u32; 2], depth: f64) -> DVec3 {
        self.toward_pixel(f64::from(x), f64::from(y)) * depth
    }

    /// The width of a pixel at depth 1 metre, across or down, whichever is more.
    fn pixel_width(&self, [x, y]: [u32; 2]) -> f64 {
        let step = (self.view.fov.right - self.view.fov.left) / f64::from(self.view.picture().width);
        step * self.view.pixel_scale(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5))
    }

    /// How well a point agrees to lie on a surface, 0 to 1.
    fn alike(&self, normal: DVec3, other: DVec3, offset: DVec3, pixel_width: f64) -> f64 {
        let by_normal = (self.choices.normal_power * (normal.dot(other) - 1.0)).exp();
        let forgiven = self.choices.plane_tolerance.powi(2) * offset.length_squared() + pixel_width.powi(2);
        by_normal * (-normal.dot(offset).powi(2) / forgiven).exp()
    }

    /// Each sample, averaged with its neighbours on its surface.
    pub fn filter_samples(&self, samples: &[SampleRecord]) -> Vec<Prepared> {
        (0..samples.len()).map(|index| self.filter_sample(samples, index)).collect()
    }

    fn filter_sample(&self, samples: &[SampleRecord], index: usize) -> Prepared {
        let own = &samples[index];
        let least = self.choices.least_expected;
        let hole = !finite(own) || own.depth <= 0.0;
        let expects = !hole && own.reflected != 0;
        let (normal, depth) = (normal24(own.normal), f64::from(own.depth));
        let point = self.point_at(self.positions[index], depth);
        let width = self.pixel_width(self.positions[index]) * depth;
        let near = nearest(self.positions, self.positions[index], self.choices.neighbours);
        let reach = near.last().map_or(1.0, |n| n.distance).max(1.0);
        let [wide, narrow] = self.choices.deviations;
        let by_distance = |distance: f64, square: f64| (-0.5 * (distance / reach).powi(2) / square).exp();
        let (mut first, mut first_sum) = (DVec3::ZERO, 0.0);
        let (mut second, mut second_sum) = (DVec3::ZERO, DVec3::ZERO);
        let (mut shadow, mut shadow_sum) = (0.0, 0.0);
        let (mut directions, mut direction_sum) = ([DVec3::ZERO; 3], DVec3::ZERO);
        let mut spreads = [Spread::default(); 2];
        for neighbour in near {
            let other = &samples[neighbour.sample];
            if !finite(other) || other.depth <= 0.0 {
                continue;
            }
            let offset = self.point_at(self.positions[neighbour.sample], f64::from(other.depth)) - point;
            let guide = if hole || neighbour.sample == index {
                1.0
            } else if is_unlit(other) && !is_unlit(own) {
                0.0
            } else {
                self.alike(normal, normal24(other.normal), offset, width)
            };
            let [first_weight, second_weight, expected_weight] =
                [wide * wide, narrow * narrow, wide * narrow]
                    .map(|s| guide * by_distance(neighbour.distance, s));
            first += vector(other.first) * first_weight;
            first_sum += first_weight;
            let noise = noise_variance(noise_code(other.toward));
            spreads[0].add(first_weight, vector(other.first), DVec3::ONE, noise);
            if expects && other.reflected != 0 {
                second += (vector(other.second) + least) * expected_weight;
                second_sum += (emission(other.reflected) + least) * expected_weight;
                let (light, expected) = (vector(other.second) + least, emission(other.reflected) + least);
                spreads[1].add(expected_weight, light, expected, noise);
            } else if !expects && (hole || other.reflected == 0) {
                second += vector(other.second) * second_weight;
                second_sum += second_weight;
                spreads[1].add(second_weight, vector(other.second), DVec3::ONE, noise);
            }
            if let (Some(_), Some(from)) = (toward(own.toward), toward(other.toward)) {
                let weight = vector(other.first) * first_weight;
                [0, 1, 2].into_iter().for_each(|c| directions[c] += from[c] * weight[c]);
                direction_sum += weight;
            }
            if other.normal >> 25 > 0 {
                shadow += first_weight * f64::from(other.normal >> 25);
                shadow_sum += first_weight;
            }
        }
        let found = first_sum > 0.0;
        Prepared {
            first: if found { first / first_sum } else { DVec3::ZERO },
            second: if second_sum.x > 0.0 { second / second_sum } else { DVec3::ZERO },
            expects,
            depth: match (hole, found) {
                (false, _) => depth,
                (true, true) => -1.0,
                (true, false) => 0.0,
            },
            normal,
            blocker: if shadow_sum > penumbra::FEW * first_sum { (shadow / shadow_sum).round() } else { 0.0 },
            toward: toward(own.toward)
                .filter(|_| !hole)
                .map(|_| [0, 1, 2].map(|c| directions[c] / direction_sum[c].max(1e-30))),
            noise: if is_unlit(own) && !hole { [-1.0; 2] } else { spreads.map(|s| s.variance_of_mean()) },
        }
    }

    fn record(&self, [x, y]: [u32; 2]) -> &VisibilityRecord {
        &self.visibility[(y * self.view.width + x) as usize]
    }

    fn surface(&self, at: [u32; 2]) -> Surface {
        let record = self.record(at);
        let root = [record.base >> 4, record.base >> 20, record.surface];
        let base = DVec3::from_array(root.map(|code| (f64::from(code & 0xfff) / 4095.0).powi(2)));
        let metalness = f64::from(record.surface >> 12 & 255) / 255.0;
        let depth = f64::from(record.depth);
        Surface {
            normal: normal24(record.normal),
            mapped: normal24(record.mapped),
            point: self.point_at(at, depth),
            pixel_width: self.pixel_width(at) * depth,
            expects: record.reflected != 0,
            diffuse: base * (1.0 - metalness),
            f0: DVec3::splat(0.04).lerp(base, metalness).max(DVec3::splat(1e-3)),
            roughness: f64::from(record.surface >> 20) / 4095.0,
        }
    }

    fn add(
        &self,
        light: &mut Light,
        surface: &Surface,
        index: usize,
        sample: &Prepared,
        near: f64,
        relaxed: f64,
    ) {
        let point = self.point_at(self.positions[index], sample.depth);
        let by_normal = (self.choices.normal_power * (surface.normal.dot(sample.normal) - 1.0)).exp();
        let (own, other) = if sample.depth > 0.0 {
            let own = self.alike(surface.normal, sample.normal, point - surface.point, surface.pixel_width);
            (own, OTHERS[1] + relaxed * by_normal)
        } else {
            (0.0, if sample.depth == 0.0 { 0.0 } else { OTHERS[2] })
        };
        let weight = near * (own + other);
        let share = sample.toward.map_or(DVec3::ONE, |toward| {
            DVec3::from_array(toward.map(|toward| directional_share(toward, surface.mapped)))
        });
        light.first += sample.first * share * weight;
        light.sum += weight;
        light.own += near * own;
        if sample.expects == surface.expects {
            light.second += sample.second * weight;
            light.second_sum += weight;
        }
        if sample.blocker > 0.0 {
            light.shadow += near * own * sample.blocker;
            light.shadow_sum += near * own;
        }
    }

    /// The radiance of what a pixel's own record describes.
    pub fn guided_radiance(&self, prepared: &[Prepared], at: [u32; 2], stride: usize) -> DVec3 {
        let record = self.record(at);
        if record.depth.is_nan() || record.depth <= 0.0 {
            return emission(record.emission);
        }
        let surface = self.surface(at);
        let mut light = Light::default();
        let choices = &self.choices;
        for (index, weight) in weights(self.positions, at, choices.k, choices.weights) {
            self.add(&mut light, &surface, index, &prepared[index], weight, 0.0);
        }
        if stride > 0 && light.own < ENOUGH && choices.neighbours > 1 && !self.is_full() {
            let needed = 1.0 - light.own / ENOUGH;
            let first = nearest(self.positions, at, 1)[0].sample;
            let around = nearest(self.positions, self.positions[first], choices.neighbours);
            for neighbour in around.iter().step_by(stride) {
                let [x, y] = self.positions[neighbour.sample];
                let squared =
                    (f64::from(x) - f64::from(at[0])).powi(2) + (f64::from(y) - f64::from(at[1])).powi(2);
                let near = needed / (1.0 + squared);
                self.add(
                    &mut light,
                    &surface,
                    neighbour.sample,
                    &prepared[neighbour.sample],
                    near,
                    OTHERS[0],
                );
            }
        }
        let first = if light.sum > 0.0 { light.first / light.sum } else { DVec3::ZERO };
        let known = light.second_sum > 0.0;
        let second = if known { light.second / light.second_sum } else { first };
        let visible = self.visible(at, &surface, &light);
        surface.diffuse * first
            + surface.f0 * self.mirrored(record, &surface, second, known)
            + self.sunlight(&surface, visible)
            + emission(record.emission)
    }

    /// glTF's BRDF for the sun, as `src/reference/brdf.rs` has it, under a lobe that its disc widens.
    fn sunlight(&self, surface: &Surface, visible: f64) -> DVec3 {
        let Some(sun) = &self.sun else { return DVec3::ZERO };
        let towards = sun.direction.as_dvec3();
        let cosine = surface.mapped.dot(towards);
        if visible * cosine <= 0.0 {
            return DVec3::ZERO;
        }
        let view = -surface.point.normalize();
        let half = (view + towards).normalize();
        let n_v = surface.mapped.dot(view).max(1e-4);
        let n_h = surface.mapped.dot(half).clamp(0.0, 1.0);
        let widening = 0.5 * (1.0 - f64::from(sun.cos_radius));
        let square = (surface.roughness.powi(2).max(1e-3).powi(2) + widening).min(1.0);
        let fresnel = surface.f0 + (DVec3::ONE - surface.f0) * (1.0 - view.dot(half).clamp(0.0, 1.0)).powi(5);
        let facets = square / (PI * (n_h * n_h * (square - 1.0) + 1.0).powi(2));
        let lambda = |c: f64| (c * c * (1.0 - square) + square).sqrt();
        let smith = cosine * lambda(n_v) + n_v * lambda(cosine);
        let brdf = surface.diffuse * (DVec3::ONE - fresnel) / PI + fresnel * (0.5 * facets / smith);
        brdf * sun.radiance.as_dvec3() * (sun.solid_angle() * visible * cosine)
    }

    /// A pixel with what its neighbours share of it.
    pub fn guided_color(&self, prepared: &[Prepared], at: [u32; 2]) -> DVec3 {
        let (normal, base) = (self.record(at).normal, self.record(at).base);
        let blends = (base | base >> 16) & 15 != 0;
        let own = self.guided_radiance(prepared, at, if blends { 1 } else { STRIDE });
        let neighbour = normal >> 24 & 7;
        let place = neighbour + u32::from(neighbour > 3);
        let (column, row) = ((at[0] + place % 3).wrapping_sub(1), (at[1] + place / 3).wrapping_sub(1));
        let shared = |beside: [u32; 2], code: u32| match code & 15 {
            0 => DVec3::ZERO,
            _ if beside[1] >= self.view.height => DVec3::ZERO,
            code => {
                (self.guided_radiance(prepared, beside, usize::from(blends)) - own) * (f64::from(code) / 15.0)
            }
        };
        own + shared([column, row], normal >> 27)
            + shared([column, at[1]], base)
            + shared([at[0], row], base >> 16)
    }

    /// A pixel of the picture of a view whose pixels are farther apart: bilinear between these, shown from where the view
    /// was traced or from another pose.
    pub fn magnified(&self, prepared: &[Prepared], shown_from: Option<(Pose, u32)>, at: [u32; 2]) -> DVec3 {
        let last = DVec2::new(f64::from(self.view.width), f64::from(self.view.height)) - 1.0;
        let seen = match shown_from {
            Some((pose, steps)) => self.warped_point(pose, at, steps),
            None => self.view.pixel_at(DVec2::new(f64::from(at[0]), f64::from(at[1])) + 0.5),
        };
        let seen = (seen - 0.5).clamp(DVec2::ZERO, last);
        let (first, part) = (seen.floor(), seen.fract());
        let color = |across: f64, down: f64| {
            let at = (first + DVec2::new(across, down)).min(last);
            self.guided_color(prepared, [at.x as u32, at.y as u32])
        };
        let upper = color(0.0, 0.0).lerp(color(1.0, 0.0), part.x);
        upper.lerp(color(0.0, 1.0).lerp(color(1.0, 1.0), part.x), part.y)
    }

    /// The traced pixel that a pixel of the picture sees, shown from another pose: a fixed point along its ray, from
    /// infinitely far away on (Bowles et al. 2012).
    pub fn warped(&self, shown_from: Pose, at: [u32; 2], steps: u32) -> [u32; 2] {
        self.pixel_around(self.warped_point(shown_from, at, steps))
    }

    fn warped_point(&self, shown_from: Pose, [x, y]: [u32; 2], steps: u32) -> DVec2 {
        let shown = View { world_from_eye: shown_from, ..self.view.picture() };
        let direction =
            shown_from.rotation * shown.eye_direction(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5));
        let ahead = shown_from.rotation * DVec3::NEG_Z;
        let offset = shown_from.position - self.view.world_from_eye.position;
        let mut found = self.traced_point(direction);
        for _ in 0..steps {
            let pixel = self.pixel_around(found);
            let depth = f64::from(self.record(pixel).depth);
            if depth.is_nan() || depth <= 0.0 {
                return found;
            }
            let along = ahead.dot(self.point_at(pixel, depth) - offset).max(1e-3);
            found = self.traced_point(offset + direction * along);
        }
        found
    }

    /// The pixel around a point of the view, or the nearest one.
    fn pixel_around(&self, point: DVec2) -> [u32; 2] {
        let size = DVec2::new(f64::from(self.view.width), f64::from(self.view.height));
        let at = point.clamp(DVec2::ZERO, size - 1.0);
        [at.x as u32, at.y as u32]
    }

    /// The point of the view in which a point relative to the traced eye is seen.
    fn traced_point(&self, point: DVec3) -> DVec2 {
        let eye = self.view.world_from_eye.rotation.inverse() * point;
        let tangent = DVec2::new(eye.x, eye.y) / (-eye.z).max(1e-6);
        let (fov, picture) = (&self.view.fov, self.view.picture());
        let size = DVec2::new(f64::from(picture.width), f64::from(picture.height));
        let at = (tangent - DVec2::new(fov.left, fov.up))
            / DVec2::new(fov.right - fov.left, fov.down - fov.up)
            * size;
        self.view.pixel_at(at)
    }
}
