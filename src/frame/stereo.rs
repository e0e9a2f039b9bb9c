//! Which views are traced for the eyes, and which part of each becomes which eye's picture.

use glam::DVec2;

use crate::config::Stereo;
use crate::error::{Error, Result};
use crate::gpu::vulkan::Rect;
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};

/// A part of a traced view that becomes a part of the picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Upper left pixel in the traced view.
    pub source: [u32; 2],
    /// The part of the picture.
    pub rect: Rect,
}

/// The views to trace. With stereo the picture shows the left eye at its left.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// Size of the whole picture.
    pub width: u32,
    /// See `width`.
    pub height: u32,
    /// Each traced view with the parts of the picture that it fills.
    pub views: Vec<(View, Vec<Cut>)>,
}

impl Plan {
    /// One view that fills the picture.
    pub fn mono(view: View) -> Plan {
        let rect = Rect { x: 0, y: 0, width: view.width, height: view.height };
        Plan {
            width: view.width,
            height: view.height,
            views: vec![(view, vec![Cut { source: [0, 0], rect }])],
        }
    }

    /// Both eyes, traced as `stereo` says.
    ///
    /// # Errors
    /// [`Error::Setting`] where one view cannot serve both eyes.
    pub fn stereo(eyes: [View; 2], stereo: Stereo) -> Result<Plan> {
        match stereo {
            Stereo::Mono => Ok(Plan::mono(eyes[0])),
            Stereo::PerEye => Ok(Plan::per_eye(eyes)),
            Stereo::Shared => Plan::shared(eyes),
        }
    }

    /// The point of each traced view, in 0..1 of it, that lies in the direction of a point of the
    /// first eye's picture, in 0..1 of that: both eyes look at the same thing, if it is far away.
    pub fn gaze_points(&self, gaze: DVec2) -> Vec<DVec2> {
        let size = |view: &View| DVec2::new(f64::from(view.width), f64::from(view.height));
        let (first, cuts) = &self.views[0];
        let Cut { source, rect } = cuts[0];
        let corner = DVec2::new(f64::from(source[0]), f64::from(source[1]));
        let at = corner + gaze * DVec2::new(f64::from(rect.width), f64::from(rect.height));
        let direction = first.world_from_eye.rotation * first.eye_direction(at);
        let seen = |(view, _): &(View, Vec<Cut>)| {
            let in_eye = view.world_from_eye.rotation.conjugate() * direction;
            view.project(in_eye).map_or_else(|| view.optical_centre(), |pixel| pixel / size(view))
        };
        self.views.iter().map(seen).collect()
    }

    fn per_eye(eyes: [View; 2]) -> Plan {
        let [left, right] = eyes;
        let whole = |view: View, x| {
            let rect = Rect { x, y: 0, width: view.width, height: view.height };
            (view, vec![Cut { source: [0, 0], rect }])
        };
        Plan {
            width: left.width + right.width,
            height: left.height.max(right.height),
            views: vec![whole(left, 0), whole(right, left.width)],
        }
    }

    /// One wider view from the point between the eyes (Fujita and Harada 2014): it spans both fields
    /// of view, with pixels as large as the eyes' own. Exact for what is infinitely far away.
    fn shared(eyes: [View; 2]) -> Result<Plan> {
        let [left, right] = eyes;
        let refuse = |why: &str| {
            let next = "choose per-eye stereo";
            Err(Error::setting(
                "view.stereo",
                format!("one view cannot serve both eyes, since {why}; {next}"),
            ))
        };
        let turn = left.world_from_eye.rotation.angle_between(right.world_from_eye.rotation);
        if turn > 1e-4 {
            return refuse("they do not look in parallel");
        }
        let step = |v: &View| (v.fov.right - v.fov.left) / f64::from(v.width);
        let close = |a: f64, b: f64| (a - b).abs() <= 1e-6 * a.abs().max(b.abs()).max(1e-6);
        if left.height != right.height
            || !close(left.fov.up, right.fov.up)
            || !close(left.fov.down, right.fov.down)
        {
            return refuse("their pictures differ in height");
        }
        if !close(step(&left), step(&right)) {
            return refuse("their pixels differ in width");
        }
        let start = left.fov.left.min(right.fov.left);
        let offset = |v: &View| ((v.fov.left - start) / step(v)).round() as u32;
        let width = (offset(&left) + left.width).max(offset(&right) + right.width);
        let middle = (left.world_from_eye.position + right.world_from_eye.position) * 0.5;
        let view = View {
            world_from_eye: Pose::new(left.world_from_eye.rotation, middle),
            fov: FieldOfView { left: start, right: start + step(&left) * f64::from(width), ..left.fov },
            width,
            height: left.height,
            spacing: Default::default(),
        };
        let cut = |eye: &View, x| Cut {
            source: [offset(eye), 0],
            rect: Rect { x, y: 0, width: eye.width, height: eye.height },
        };
        Ok(Plan {
            width: left.width + right.width,
            height: left.height,
            views: vec![(view, vec![cut(&left, 0), cut(&right, left.width)])],
        })
    }
}

/// Two parallel eyes, `ipd` metres apart, that share a head pose and a field of view.
pub fn parallel_eyes(head: Pose, ipd: f64, fov: FieldOfView, width: u32, height: u32) -> [View; 2] {
    [-0.5, 0.5].map(|side| {
        let offset = Pose { position: glam::DVec3::X * (side * ipd), ..Pose::IDENTITY };
        View { world_from_eye: head.then(offset), fov, width, height, spacing: Default::default() }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    fn dk1_eyes() -> [View; 2] {
        let left = FieldOfView { left: -1.803682, right: 1.327774, up: 1.957160, down: -1.957160 };
        let right = FieldOfView { left: -left.right, right: -left.left, ..left };
        let [l, r] = parallel_eyes(Pose::IDENTITY, 0.064, left, 640, 800);
        [l, View { fov: right, ..r }]
    }

    #[test]
    fn the_shared_view_shows_each_eye_the_same_directions() {
        let eyes = dk1_eyes();
        let plan = Plan::stereo(eyes, Stereo::Shared).unwrap();
        let (view, cuts) = &plan.views[0];
        for (eye, cut) in eyes.iter().zip(cuts) {
            for pixel in [DVec2::new(0.5, 0.5), DVec2::new(639.5, 799.5), DVec2::new(100.0, 400.0)] {
                let moved = pixel + DVec2::new(f64::from(cut.source[0]), 0.0);
                let apart = eye.eye_direction(pixel) - view.eye_direction(moved);
                // At most half a pixel: the offset is rounded to whole ones.
                assert!(apart.length() <= 0.51 * 3.131456 / 640.0, "{apart}");
            }
            assert!(cut.source[0] + cut.rect.width <= view.width);
        }
    }

    #[test]
    fn both_eyes_gaze_in_one_direction() {
        let eyes = dk1_eyes();
        for stereo in [Stereo::PerEye, Stereo::Shared] {
            let plan = Plan::stereo(eyes, stereo).unwrap();
            let points = plan.gaze_points(DVec2::new(0.3, 0.6));
            let wanted = eyes[0].eye_direction(DVec2::new(0.3 * 640.0, 0.6 * 800.0));
            for ((view, _), point) in plan.views.iter().zip(points) {
                let size = DVec2::new(f64::from(view.width), f64::from(view.height));
                assert!((view.eye_direction(point * size) - wanted).length() < 0.004, "{stereo:?} {point}");
            }
        }
    }

    #[test]
    fn canted_eyes_are_refused_one_view() {
        let mut eyes = dk1_eyes();
        eyes[1].world_from_eye.rotation = DQuat::from_rotation_y(0.05);
        let error = Plan::stereo(eyes, Stereo::Shared).unwrap_err().to_string();
        assert!(error.contains("parallel") && error.contains("per-eye"), "{error}");
        assert!(Plan::stereo(eyes, Stereo::PerEye).is_ok());
    }
}
