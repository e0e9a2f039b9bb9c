//! How many samples and camera rays there are in a degree, at an eccentricity: laws as the field speaks of them.

use glam::{DQuat, DVec2, DVec3};
use rayon::prelude::*;

use super::Density;
use super::density::usable_gaze;
use super::law::Law;
use crate::math::view::View;

/// Pixels between two points at which a law is summed up.
const STRIDE: u32 = 4;

/// A law's samples of a view, in degrees.
#[derive(Clone, Copy, Debug)]
pub struct Acuity {
    picture: View,
    view: View,
    density: Density,
    /// Samples per pixel of the picture where the law's relative density is 1, up to one.
    scale: f64,
    gaze: DVec3,
}

impl Acuity {
    /// Of `samples` samples of a view, whose pixels may be uneven, with a gaze in 0..1 of its picture.
    pub fn new(view: &View, law: &Law, gaze: DVec2, samples: usize) -> Acuity {
        let picture = view.picture();
        let density = Density::new(law, &picture, gaze);
        let size = DVec2::new(f64::from(picture.width), f64::from(picture.height));
        let gaze = picture.eye_direction(usable_gaze(&picture, gaze) * size).normalize();
        let densities: Vec<f64> = (0..picture.height.div_ceil(STRIDE))
            .into_par_iter()
            .flat_map_iter(|row| {
                let centre = |index: u32| (f64::from(index) + 0.5) * f64::from(STRIDE);
                let columns = 0..picture.width.div_ceil(STRIDE);
                columns.map(move |column| density.at(DVec2::new(centre(column), centre(row)).min(size - 0.5)))
            })
            .collect();
        let share = samples as f64 / picture.pixels().max(1) as f64;
        let mean = |scale: f64| {
            densities.iter().map(|density| (density * scale).min(1.0)).sum::<f64>() / densities.len() as f64
        };
        // Where the law asks for more than one sample a pixel, the rest goes elsewhere: the share grows with the scale.
        let (mut least, mut most) = (0.0, 1.0);
        while mean(most) < share.min(1.0) * (1.0 - 1e-9) && most < 1e12 {
            most *= 2.0;
        }
        for _ in 0..60 {
            let middle = (least + most) * 0.5;
            *(if mean(middle) < share { &mut least } else { &mut most }) = middle;
        }
        Acuity { picture, view: *view, density, scale: most, gaze }
    }

    /// The point of the picture at so many degrees from the gaze, in the direction of an angle in radians,
    /// counterclockwise from the right; `None` where that is not in the picture.
    fn point(&self, degrees: f64, angle: f64) -> Option<DVec2> {
        let up = (DVec3::Y - self.gaze * self.gaze.y).normalize();
        let axis = DQuat::from_axis_angle(self.gaze, angle) * up;
        let at = self.picture.project(DQuat::from_axis_angle(axis, -degrees.to_radians()) * self.gaze)?;
        let size = DVec2::new(f64::from(self.picture.width), f64::from(self.picture.height));
        (at.cmpge(DVec2::ZERO).all() && at.cmplt(size).all()).then_some(at)
    }

    /// The square degrees of a pixel of the picture.
    fn pixel(&self, at: DVec2) -> f64 {
        let fov = &self.picture.fov;
        let area = (fov.right - fov.left) * (fov.up - fov.down) / self.picture.pixels() as f64;
        // At tangents (x, y) a plane picture fills a solid angle of (1 + x² + y²)^(-3/2) of its area.
        area * self.picture.eye_direction(at).length_squared().powf(-1.5) * 1f64.to_degrees().powi(2)
    }

    /// Samples in a degree, the root of those in a square degree, at so many degrees from the gaze in the direction of
    /// an angle in radians, counterclockwise from the right. `None` where that is not in the picture.
    pub fn samples_per_degree(&self, degrees: f64, angle: f64) -> Option<f64> {
        let at = self.point(degrees, angle)?;
        Some(((self.density.at(at) * self.scale).min(1.0) / self.pixel(at)).sqrt())
    }

    /// The same for camera rays of guided reconstruction, one for each of the view's pixels.
    pub fn rays_per_degree(&self, degrees: f64, angle: f64) -> Option<f64> {
        let at = self.point(degrees, angle)?;
        let pixel = self.view.pixel_at(at);
        let covered = self.view.spacing.columns.width(pixel.x) * self.view.spacing.rows.width(pixel.y);
        Some((1.0 / covered / self.pixel(at)).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::foveation::{Pattern, spaced};
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    fn view() -> View {
        let fov = FieldOfView { left: -1.1, right: 1.1, up: 0.7, down: -0.7 };
        View { world_from_eye: Pose::IDENTITY, fov, width: 660, height: 420, spacing: Default::default() }
    }

    #[test]
    fn a_law_in_degrees_is_what_patterns_have() {
        let view = view();
        for law in ["paper", "linear-mar", "log-polar", "uniform"] {
            let law: Law = law.parse().unwrap();
            let acuity = Acuity::new(&view, &law, DVec2::splat(0.5), 20_000);
            let pattern = Pattern::new(&view, &law, DVec2::splat(0.5), 20_000);
            for degrees in [8.0, 16.0, 24.0] {
                // Samples in a ring of four degrees around it, and its square degrees, all within the picture.
                let inside = |at: DVec2| {
                    let direction = view.eye_direction(at);
                    ((-direction.z / direction.length()).acos().to_degrees() - degrees).abs() < 2.0
                };
                let samples =
                    pattern.samples.iter().map(|s| DVec2::new((s & 0xffff).into(), (s >> 16).into()) + 0.5);
                let found = samples.filter(|&at| inside(at)).count() as f64;
                let ring = |d: f64| 1.0 - d.to_radians().cos();
                let area = std::f64::consts::TAU
                    * (ring(degrees + 2.0) - ring(degrees - 2.0))
                    * 1f64.to_degrees().powi(2);
                let told: f64 = (0..8)
                    .map(|i| acuity.samples_per_degree(degrees, f64::from(i)).unwrap().powi(2))
                    .sum::<f64>()
                    / 8.0;
                assert!((found / area / told - 1.0).abs() < 0.06, "{law} {degrees}: {} {told}", found / area);
            }
        }
    }

    #[test]
    fn rays_have_the_angle_that_the_eye_needs() {
        let even = Acuity::new(&view(), &Law::default(), DVec2::splat(0.5), 1000);
        let coarse = spaced(&view(), DVec2::splat(0.5), 0.022, 1.0);
        let spaced = Acuity::new(&coarse, &Law::default(), DVec2::splat(0.5), 1000);
        // 660 pixels across 2.2 in tangents: 300 a radian in the middle.
        let middle = even.rays_per_degree(0.0, 0.0).unwrap();
        assert!((middle / (300.0 * 1f64.to_radians()) - 1.0).abs() < 1e-6, "{middle}");
        assert_eq!(spaced.rays_per_degree(3.0, 0.0), even.rays_per_degree(3.0, 0.0));
        let (fine, few) =
            (even.rays_per_degree(40.0, 0.0).unwrap(), spaced.rays_per_degree(40.0, 0.0).unwrap());
        assert!(few < 0.8 * fine && few > 1.0 / (1.0 / 48.0 + 0.022 * 38.0), "{fine} {few}");
        assert_eq!(even.samples_per_degree(80.0, 0.0), None);
    }
}
