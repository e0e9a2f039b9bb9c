//! What the mock headset claims to be.

use glam::{DQuat, DVec3};

use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};

/// Both eyes' displays and where they are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// By which it is chosen.
    pub name: &'static str,
    /// Pixels across for each eye.
    pub eye_width: u32,
    /// Pixels down for each eye.
    pub eye_height: u32,
    /// What the left eye sees.
    pub fov_left: FieldOfView,
    /// What the right eye sees.
    pub fov_right: FieldOfView,
    /// Distance between the eyes in metres.
    pub ipd: f64,
    /// Pictures a second.
    pub refresh_hz: f64,
}

impl Profile {
    /// The Oculus Rift DK1: 1280x800 for both eyes, with the undistorted view of its lenses as LibOVR
    /// 0.2.x computes it: projection centre off by 1 - 2 * 0.0635 / 0.14976, scale 1.714606, the eye 41 mm
    /// from a panel of 149.76 mm by 93.6 mm.
    pub fn dk1() -> Self {
        let fov_left = FieldOfView { left: -1.803682, right: 1.327774, up: 1.957160, down: -1.957160 };
        Profile {
            name: "dk1",
            eye_width: 640,
            eye_height: 800,
            fov_left,
            fov_right: mirrored(fov_left),
            ipd: 0.064,
            refresh_hz: 60.0,
        }
    }

    /// A plain headset: 90 degrees both ways with the axis in the centre.
    pub fn generic() -> Self {
        let fov = FieldOfView { left: -1.0, right: 1.0, up: 1.0, down: -1.0 };
        Profile {
            name: "generic",
            eye_width: 960,
            eye_height: 960,
            fov_left: fov,
            fov_right: fov,
            ipd: 0.064,
            refresh_hz: 90.0,
        }
    }

    /// All profiles, the default first.
    pub fn all() -> [Profile; 2] {
        [Profile::dk1(), Profile::generic()]
    }

    /// The profile of that name.
    pub fn named(name: &str) -> Option<Self> {
        Profile::all().into_iter().find(|profile| profile.name == name)
    }

    /// The same headset with other displays. The horizontal field of view stays; the vertical one grows
    /// and shrinks with the height, so that pixels keep their shape.
    pub fn resized(mut self, eye_width: u32, eye_height: u32) -> Self {
        let aspect = |width: u32, height: u32| f64::from(height) / f64::from(width);
        let factor = aspect(eye_width, eye_height) / aspect(self.eye_width, self.eye_height);
        for fov in [&mut self.fov_left, &mut self.fov_right] {
            fov.up *= factor;
            fov.down *= factor;
        }
        Profile { eye_width, eye_height, ..self }
    }

    /// The same headset with lenses of another strength: all of the field of view grows and shrinks with
    /// the vertical one, which is `2 atan` of half the sum of its two tangents, in radians.
    pub fn with_vertical_fov(mut self, fov_y: f64) -> Self {
        let factor = 2.0 * (fov_y / 2.0).tan() / (self.fov_left.up - self.fov_left.down);
        for fov in [&mut self.fov_left, &mut self.fov_right] {
            for tangent in [&mut fov.left, &mut fov.right, &mut fov.up, &mut fov.down] {
                *tangent *= factor;
            }
        }
        self
    }

    /// The left and the right eye's view with the head (the point between the eyes) at `world_from_head`.
    /// The eyes are half the distance between them to both sides along the head's X, and parallel.
    pub fn views(&self, world_from_head: Pose) -> [View; 2] {
        [(-0.5, self.fov_left), (0.5, self.fov_right)].map(|(side, fov)| {
            let head_from_eye = Pose { rotation: DQuat::IDENTITY, position: DVec3::X * (side * self.ipd) };
            View {
                world_from_eye: world_from_head.then(head_from_eye),
                fov,
                width: self.eye_width,
                height: self.eye_height,
                spacing: Default::default(),
            }
        })
    }
}

/// The other eye's field of view.
fn mirrored(fov: FieldOfView) -> FieldOfView {
    FieldOfView { left: -fov.right, right: -fov.left, ..fov }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_dk1_is_what_its_optics_say() {
        // Re-derived from the device's facts: LibOVR 0.2.x with the fit point at the viewport's left edge.
        let (width, height, lenses, eye_to_screen): (f64, f64, f64, f64) = (0.14976, 0.0936, 0.0635, 0.041);
        let offset = 1.0 - 2.0 * lenses / width;
        let radius = 1.0 + offset;
        let scale = 1.0 + 0.22 * radius.powi(2) + 0.24 * radius.powi(4);
        let up = scale * height / 2.0 / eye_to_screen;
        let across = up * 640.0 / 800.0;
        let fov = Profile::dk1().fov_left;
        let expected =
            FieldOfView { left: -across * (1.0 + offset), right: across * (1.0 - offset), up, down: -up };
        for (is, should) in
            [(fov.left, expected.left), (fov.right, expected.right), (fov.up, up), (fov.down, -up)]
        {
            assert!((is - should).abs() < 2e-5, "{fov:?}, derived {expected:?}");
        }
    }

    #[test]
    fn eyes_are_mirror_images_on_the_heads_axis() {
        for profile in Profile::all() {
            let head = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(-4.0, 1.0, 2.5));
            let [left, right] = profile.views(head);
            let apart = right.world_from_eye.position - left.world_from_eye.position;
            assert!((apart - head.rotation * DVec3::X * profile.ipd).length() < 1e-12);
            let between = (right.world_from_eye.position + left.world_from_eye.position) * 0.5;
            assert!((between - head.position).length() < 1e-12);
            assert_eq!((left.fov.left, left.fov.right), (-right.fov.right, -right.fov.left));
            assert_eq!((left.width, left.height), (profile.eye_width, profile.eye_height));
            assert_eq!(Profile::named(profile.name), Some(profile));
        }
        assert_eq!(Profile::named("dk9"), None);
    }

    #[test]
    fn the_vertical_field_of_view_is_met_and_pixels_keep_their_shape() {
        for profile in Profile::all() {
            let wide = profile.resized(300, 200).with_vertical_fov(1.2);
            for fov in [wide.fov_left, wide.fov_right] {
                assert!((fov.up - 0.6f64.tan()).abs() < 1e-12 && (fov.down + 0.6f64.tan()).abs() < 1e-12);
            }
            let (old, new) = (profile.resized(300, 200).fov_left, wide.fov_left);
            assert!((new.left / old.left - new.up / old.up).abs() < 1e-12);
        }
    }
}
