//! Penumbras of the sun: `kernels/shared/penumbra.wgsl`.

use std::f64::consts::TAU;

use glam::{DVec2, DVec3};

use super::{Guided, Light, Surface};
use crate::layout::{BLOCKER_METRE, BLOCKER_STEPS, VisibilityRecord};

/// Share of a sample's neighbours that must see a part of the sun's disc for it to lie in a penumbra.
pub(super) const FEW: f64 = 0.01;
/// Share of a pixel's samples from which on they say that it does.
const IN_PENUMBRA: f64 = 0.05;
const POINTS: u32 = 32;
/// So many of them first: those farthest out, and some of the others.
const FIRST_POINTS: u32 = 12;
const OUTER_POINTS: u32 = 9;
const STRIDE: u32 = 7;
const GOLDEN_ANGLE: f64 = 2.399_963_2;
/// Pixels.
const WIDEST: f64 = 32.0;
const LEAST: f64 = 0.75;
const LEAST_SLOPE: f64 = 0.1;
/// Agreement, 0 to 1, from which on a pixel counts as of the same surface.
const SAME_SURFACE: f64 = 0.5;

fn has_sunlight(record: &VisibilityRecord) -> bool {
    record.normal >> 31 == 0 && record.emission != 0
}

impl Guided<'_> {
    /// How much of the sun a pixel sees, 0 to 1, by how far its samples say that what hides a part of it is.
    pub(super) fn visible(&self, at: [u32; 2], surface: &Surface, light: &Light) -> f64 {
        let record = self.record(at);
        let centre = f64::from(record.normal >> 31);
        let Some(sun) = &self.sun else { return centre };
        if light.shadow_sum <= IN_PENUMBRA * light.own || has_sunlight(record) {
            return centre;
        }
        let code = light.shadow / light.shadow_sum;
        let distance = ((code - f64::from(BLOCKER_METRE)) / f64::from(BLOCKER_STEPS)).exp2();
        // Twice the sine of half the sun's angular radius.
        let radius = distance * 2.0 * (0.5 * (1.0 - f64::from(sun.cos_radius))).sqrt();
        let towards = sun.direction.as_dvec3();
        let other = if towards.y.abs() > 0.9 { DVec3::X } else { DVec3::Y };
        let beside = towards.cross(other).normalize();
        let axes = [beside, towards.cross(beside)].map(|across| {
            let slope = surface.normal.dot(towards).max(LEAST_SLOPE);
            let way = radius * (across - towards * (surface.normal.dot(across) / slope));
            let axis = self.pixels_of(surface, way);
            axis * (WIDEST / axis.length().max(1e-6)).min(1.0)
        });
        if axes[0].length().max(axes[1].length()) < LEAST {
            return centre;
        }
        let turn = at[0].wrapping_mul(3_242_174_889).wrapping_add(at[1].wrapping_mul(2_447_445_414)) >> 8;
        let turn = f64::from(turn) / f64::from(1 << 24) * TAU;
        let (mut seen, mut sum) = (0.0, 0.0);
        for k in 0..POINTS {
            if k == FIRST_POINTS && seen == sum * centre {
                return centre;
            }
            let inner = POINTS - OUTER_POINTS;
            let i = match k.checked_sub(OUTER_POINTS) {
                None => POINTS - 1 - k,
                Some(k) => inner - 1 - k * STRIDE % inner,
            };
            let out = ((f64::from(i) + 0.5) / f64::from(POINTS)).sqrt();
            let (sin, cos) = (turn + f64::from(i) * GOLDEN_ANGLE).sin_cos();
            let place =
                DVec2::new(f64::from(at[0]), f64::from(at[1])) + out * (cos * axes[0] + sin * axes[1]);
            if let Some(bit) = self.centre_seen(place, surface) {
                seen += bit;
                sum += 1.0;
            }
        }
        if sum > 0.0 { seen / sum } else { centre }
    }

    /// Whether the pixel around a point sees the sun's centre, 0 or 1, where it is of the surface.
    fn centre_seen(&self, place: DVec2, surface: &Surface) -> Option<f64> {
        let last = DVec2::new(f64::from(self.view.width), f64::from(self.view.height)) - 1.0;
        let at = (place + 0.5).floor().clamp(DVec2::ZERO, last);
        let at = [at.x as u32, at.y as u32];
        let record = self.record(at);
        let offset = self.point_at(at, f64::from(record.depth)) - surface.point;
        let alike = self.alike(surface.normal, surface.normal, offset, surface.pixel_width);
        (record.depth > 0.0 && alike > SAME_SURFACE && !has_sunlight(record))
            .then(|| f64::from(record.normal >> 31))
    }

    /// By how many pixels of the view what lies at a pixel's surface point is seen elsewhere if it moves by a small way.
    fn pixels_of(&self, surface: &Surface, way: DVec3) -> DVec2 {
        let step = 1e-6 / way.length().max(1e-30);
        let seen = self.traced_point(surface.point + way * step) - self.traced_point(surface.point);
        seen / step
    }
}
