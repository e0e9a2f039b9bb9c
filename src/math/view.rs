//! What one eye sees: a pose, a field of view and a number of pixels.

use glam::{DVec2, DVec3};

use super::pose::Pose;
use super::spacing::Spacing;

/// A field of view as the tangents of its four half angles, like OpenXR's `XrFovf` but signed.
///
/// `left` and `down` are negative for a view that holds its own axis.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FieldOfView {
    /// Tangent of the angle to the left edge.
    pub left: f64,
    /// Tangent of the angle to the right edge.
    pub right: f64,
    /// Tangent of the angle to the upper edge.
    pub up: f64,
    /// Tangent of the angle to the lower edge.
    pub down: f64,
}

impl FieldOfView {
    /// A symmetric field of view from its vertical angle in radians and its aspect, width / height.
    pub fn symmetric(vertical: f64, aspect: f64) -> Self {
        let up = (vertical * 0.5).tan();
        FieldOfView { left: -up * aspect, right: up * aspect, up, down: -up }
    }
}

/// One view: pixels (x, y) count from the upper left corner, as in Vulkan and PNG.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct View {
    /// Where the eye is in the world; it looks along its -Z.
    pub world_from_eye: Pose,
    /// What it sees.
    pub fov: FieldOfView,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// How far apart they are.
    pub spacing: Spacing,
}

impl View {
    /// The picture that the view shows, whose pixels are even: the view itself where its own are.
    pub fn picture(&self) -> View {
        let size = |picture: f64, own: u32| if picture > 0.0 { picture as u32 } else { own };
        View {
            width: size(self.spacing.columns.picture, self.width),
            height: size(self.spacing.rows.picture, self.height),
            spacing: Spacing::EVEN,
            ..*self
        }
    }

    /// The point of [`View::picture`], in its pixels, that a point of the view in its pixels shows.
    pub fn picture_point(&self, pixel: DVec2) -> DVec2 {
        DVec2::new(self.spacing.columns.point(pixel.x), self.spacing.rows.point(pixel.y))
    }

    /// Undoes [`View::picture_point`].
    pub fn pixel_at(&self, picture: DVec2) -> DVec2 {
        DVec2::new(self.spacing.columns.pixel(picture.x), self.spacing.rows.pixel(picture.y))
    }

    /// How many of the picture's pixels one at a point of the view covers across or down, whichever is more.
    pub fn pixel_scale(&self, pixel: DVec2) -> f64 {
        self.spacing.columns.width(pixel.x).max(self.spacing.rows.width(pixel.y))
    }

    /// The same with so many more pixels at each side, to the left and right and above and below; pixels are even.
    pub fn with_margin(&self, [x, y]: [u32; 2]) -> View {
        let FieldOfView { left, right, up, down } = self.fov;
        let (across, along) = (
            f64::from(x) * (right - left) / f64::from(self.width),
            f64::from(y) * (up - down) / f64::from(self.height),
        );
        View {
            fov: FieldOfView {
                left: left - across,
                right: right + across,
                up: up + along,
                down: down - along,
            },
            width: self.width + 2 * x,
            height: self.height + 2 * y,
            ..*self
        }
    }

    /// Number of pixels.
    pub fn pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// The eye-space direction through a point of the image in pixels, with z = -1: not normalised.
    ///
    /// Pixel centres are at halves: the first pixel's is (0.5, 0.5).
    pub fn eye_direction(&self, pixel: DVec2) -> DVec3 {
        let (picture, point) = (self.picture(), self.picture_point(pixel));
        let u = point.x / f64::from(picture.width);
        let v = point.y / f64::from(picture.height);
        let x = self.fov.left + (self.fov.right - self.fov.left) * u;
        let y = self.fov.up + (self.fov.down - self.fov.up) * v;
        DVec3::new(x, y, -1.0)
    }

    /// The image point in pixels of an eye-space point; `None` behind the eye.
    pub fn project(&self, point: DVec3) -> Option<DVec2> {
        if point.z >= 0.0 {
            return None;
        }
        let (x, y) = (point.x / -point.z, point.y / -point.z);
        let u = (x - self.fov.left) / (self.fov.right - self.fov.left);
        let v = (y - self.fov.up) / (self.fov.down - self.fov.up);
        let picture = self.picture();
        Some(self.pixel_at(DVec2::new(u * f64::from(picture.width), v * f64::from(picture.height))))
    }

    /// The point of the image, in 0..1, where the eye's own axis meets it: a gaze at rest.
    pub fn optical_centre(&self) -> DVec2 {
        let x = -self.fov.left / (self.fov.right - self.fov.left);
        let y = self.fov.up / (self.fov.up - self.fov.down);
        DVec2::new(x, y)
    }
}

#[cfg(test)]
mod tests {
    use super::super::spacing::Axis;
    use super::*;

    #[test]
    fn a_margin_leaves_all_directions_where_they_are() {
        let fov = FieldOfView { left: -1.2, right: 0.9, up: 0.7, down: -1.1 };
        let view =
            View { world_from_eye: Pose::IDENTITY, fov, width: 64, height: 40, spacing: Default::default() };
        let wider = view.with_margin([3, 5]);
        assert_eq!((wider.width, wider.height), (70, 50));
        for pixel in [DVec2::ZERO, DVec2::new(64.0, 40.0), DVec2::new(10.5, 30.5)] {
            let moved = wider.eye_direction(pixel + DVec2::new(3.0, 5.0));
            assert!((view.eye_direction(pixel) - moved).length() < 1e-12);
        }
        assert_eq!(view.with_margin([0, 0]), view);
    }

    #[test]
    fn projection_undoes_direction() {
        let fov = FieldOfView { left: -1.8, right: 1.3, up: 1.9, down: -1.7 };
        let view = View {
            world_from_eye: Pose::IDENTITY,
            fov,
            width: 640,
            height: 800,
            spacing: Default::default(),
        };
        let pixel = DVec2::new(13.5, 700.25);
        let there = view.project(view.eye_direction(pixel) * 7.0).unwrap();
        assert!((there - pixel).length() < 1e-9);
        let (columns, width) = Axis::new(640, 200.0, 50.0, 0.01);
        let spaced = View { width, spacing: Spacing { columns, rows: Axis::EVEN }, ..view };
        let pixel = DVec2::new(3.5, 700.25);
        let there = spaced.project(spaced.eye_direction(pixel) * 7.0).unwrap();
        assert!((there - pixel).length() < 1e-9 && spaced.picture() == view);
        let centre = view.optical_centre() * DVec2::new(640.0, 800.0);
        assert!((view.eye_direction(centre) - DVec3::NEG_Z).length() < 1e-12);
    }
}
