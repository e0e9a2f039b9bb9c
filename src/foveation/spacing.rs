//! How far apart camera rays may be: what the eye resolves around its gaze, set against a picture's pixels.

use glam::DVec2;

use super::density::usable_gaze;
use crate::math::spacing::{Axis, Spacing};
use crate::math::view::View;

/// The eye's minimum angle of resolution at its gaze, in degrees.
const LEAST_MAR: f64 = 1.0 / 48.0;
/// Degrees from the gaze within which it stays so.
const SHARP: f64 = 2.0;
/// The part of that angle which a pixel may cover.
const PIXELS_PER_MAR: f64 = 2.0;
/// Points of an axis at which the law is looked up.
const STEPS: u32 = 192;

/// The pixels that visibility needs of a view whose pixels are even: the picture's own around the gaze, and farther out
/// as wide as half the minimum angle of resolution, 1/48 degree + `slope` (e - 2 degrees), at `widening` times an
/// eccentricity of e; never wider along the axes through the gaze, and at least as fine elsewhere.
///
/// `gaze` is in 0..1 of the picture and may lie outside; `slope` is in degrees per degree, 0 for the picture's own pixels.
pub fn spaced(view: &View, gaze: DVec2, slope: f64, widening: f64) -> View {
    if slope.is_nan() || slope <= 0.0 || view.width == 0 || view.height == 0 {
        return *view;
    }
    let size = DVec2::new(f64::from(view.width), f64::from(view.height));
    let gaze = (usable_gaze(view, gaze) * size).clamp(-2.0 * size, 3.0 * size);
    let mar = |degrees: f64| LEAST_MAR + slope * (degrees / widening.max(1.0) - SHARP).max(0.0);
    let centre = view.eye_direction(gaze).normalize();
    // How many of the picture's pixels one may cover at a point, along an axis.
    let allowed = |at: DVec2, along: DVec2| {
        let direction = view.eye_direction(at);
        let step = (view.eye_direction(at + along) - direction).length();
        let away = direction.dot(along.x.abs() * glam::DVec3::Y + along.y.abs() * glam::DVec3::X);
        // A step across a plane at unit distance, seen from the eye at a slant.
        let pixel = step * (1.0 + away * away).sqrt() / direction.length_squared();
        mar(direction.normalize().angle_between(centre).to_degrees()).to_radians() / PIXELS_PER_MAR / pixel
    };
    // Lines along the axes: through the gaze, and where pixels are largest in angle.
    let lines = [gaze.clamp(DVec2::ZERO, size), view.optical_centre().clamp(DVec2::ZERO, DVec2::ONE) * size];
    let axis = |along: DVec2, pixels: u32| {
        let from = gaze.dot(along);
        let on = |line: DVec2, point: f64| allowed(line + along * (point - line.dot(along)), along);
        let at = |point: f64| on(lines[0], point).min(on(lines[1], point));
        let (radius, growth) = fit(f64::from(pixels), from, &at);
        Axis::new(pixels, from, radius, growth)
    };
    let ((columns, width), (rows, height)) = (axis(DVec2::X, view.width), axis(DVec2::Y, view.height));
    View { width, height, spacing: Spacing { columns, rows }, ..*view }
}

/// Radius and growth of the fastest [`Axis`] of so many pixels around a gaze whose pixels are nowhere wider than `allowed`.
fn fit(pixels: f64, gaze: f64, allowed: &dyn Fn(f64) -> f64) -> (f64, f64) {
    let points = |end: f64| {
        let start = gaze.clamp(0.0, pixels);
        (1..=STEPS).map(move |i| start + (end - start) * f64::from(i) / f64::from(STEPS))
    };
    let reach = |end: f64| {
        let start = gaze.clamp(0.0, pixels);
        let Some(beyond) = points(end).find(|&point| allowed(point) > 1.0) else { return (end - gaze).abs() };
        let (mut within, mut beyond) = (start, beyond);
        for _ in 0..40 {
            let middle = (within + beyond) * 0.5;
            *(if allowed(middle) > 1.0 { &mut beyond } else { &mut within }) = middle;
        }
        (within - gaze).abs()
    };
    let radius = reach(0.0).max(reach(pixels));
    let growth = points(0.0).chain(points(pixels)).filter_map(|point| {
        let beyond = (point - gaze).abs() - radius;
        (beyond > 1.0).then(|| (allowed(point).max(1.0).sqrt() - 1.0) / beyond)
    });
    (radius, growth.fold(f64::INFINITY, f64::min).min(1.0))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;

    fn view(width: u32, height: u32) -> View {
        let fov = FieldOfView::symmetric(
            2.0 * (1.11f64 * f64::from(height) / f64::from(width)).atan(),
            f64::from(width) / f64::from(height),
        );
        View { world_from_eye: Pose::IDENTITY, fov, width, height, spacing: Spacing::EVEN }
    }

    fn share(view: &View, gaze: DVec2, slope: f64) -> f64 {
        spaced(view, gaze, slope, 1.0).pixels() as f64 / view.pixels() as f64
    }

    #[test]
    fn pixels_fall_with_resolution() {
        let middle = DVec2::splat(0.5);
        let (small, large) =
            (share(&view(1280, 800), middle, 0.011), share(&view(2304, 1440), middle, 0.011));
        assert!((0.38..0.47).contains(&small) && (0.2..0.28).contains(&large), "{small} {large}");
        let aside = share(&view(1280, 800), DVec2::new(0.2, 0.35), 0.011);
        assert!((0.2..0.6).contains(&aside), "{aside}");
        assert!(share(&view(1280, 800), middle, 0.022) < 0.6 * small);
    }

    #[test]
    fn no_pixel_is_wider_than_the_eye_allows() {
        for (gaze, slope) in
            [(DVec2::splat(0.5), 0.011), (DVec2::new(0.2, 0.35), 0.02), (DVec2::new(-0.3, 1.4), 0.011)]
        {
            let view = view(1280, 800);
            let coarse = spaced(&view, gaze, slope, 1.0);
            assert!(!coarse.spacing.is_even());
            let centre = view.eye_direction(gaze * DVec2::new(1280.0, 800.0)).normalize();
            for i in 0..coarse.width * coarse.height / 97 {
                let (x, y) = (i * 97 % coarse.width, i * 97 / coarse.width);
                let corner = DVec2::new(f64::from(x), f64::from(y));
                let directions = [DVec2::ZERO, DVec2::X, DVec2::Y]
                    .map(|step| coarse.eye_direction(corner + step).normalize());
                let seen =
                    directions[0].angle_between(centre).max(directions[1].angle_between(centre)).to_degrees();
                let most = (LEAST_MAR + slope * (seen - SHARP).max(0.0)) * 0.5;
                let plain = [DVec2::X, DVec2::Y].map(|step| {
                    let at = coarse.picture_point(corner);
                    view.eye_direction(at)
                        .normalize()
                        .angle_between(view.eye_direction(at + step).normalize())
                        .to_degrees()
                });
                for axis in 0..2 {
                    let own = directions[0].angle_between(directions[axis + 1]).to_degrees();
                    assert!(
                        own <= (1.06 * most).max(1.03 * plain[axis]),
                        "{gaze} {corner} {axis}: {own} {most}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_the_eye_resolves_everywhere_stays_as_it_is() {
        let coarse = view(160, 100);
        assert_eq!(spaced(&coarse, DVec2::splat(0.5), 0.011, 1.0), coarse);
        let fine = view(1280, 800);
        assert_eq!(spaced(&fine, DVec2::splat(0.5), 0.0, 1.0), fine);
        assert!(
            spaced(&fine, DVec2::NAN, 0.011, 1.0).pixels()
                == spaced(&fine, DVec2::splat(0.5), 0.011, 1.0).pixels()
        );
    }

    #[test]
    fn a_wide_gaze_needs_more_pixels() {
        let fine = view(1280, 800);
        let [narrow, wide] =
            [1.0, 1.5].map(|widening| spaced(&fine, DVec2::splat(0.5), 0.011, widening).pixels());
        assert!(wide > narrow);
    }
}
