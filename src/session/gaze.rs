//! Where the views are sharp, and which of their pixels nobody sees.

use std::sync::Arc;

use glam::DVec2;

use super::FoveaPoint;
use crate::foveation::{BitMask, GazeFilter, GazeSample, GazeTarget};
use crate::headset::{EyeView, Gaze, HiddenMesh};
use crate::math::view::{FieldOfView, View};

/// How far the gaze moves, in 0..1 of the image, before the pattern follows it: patterns cost time.
const STEADY: f64 = 0.01;
/// By how much the widening changes before the pattern follows it.
const STEADY_WIDENING: f64 = 0.2;

/// What each view's eye does.
#[derive(Default)]
pub struct Looks {
    /// Where the eyes look all the time, in 0..1 of the first view.
    fixed: Option<DVec2>,
    each: Vec<Look>,
}

/// Where a view is sharp, and what of it is hidden.
#[derive(Default)]
struct Look {
    filter: GazeFilter,
    fovea: Option<FoveaPoint>,
    mask: Option<(MaskKey, Option<Arc<BitMask>>)>,
}

/// A mask is made anew when one of these changes.
type MaskKey = (u64, FieldOfView, u32, u32);

impl Looks {
    /// Eyes that look at one point of the first view, in 0..1 of it, or where their trackers say.
    pub fn new(fixed: Option<DVec2>) -> Self {
        Looks { fixed, each: Vec::new() }
    }

    /// Where the views are sharp at a time, in nanoseconds: where the eyes look, or at the optical centre.
    pub fn look(
        &mut self,
        gaze: Option<Gaze>,
        eyes: &[EyeView],
        views: &[View],
        time: i64,
    ) -> Vec<FoveaPoint> {
        self.each.resize_with(views.len(), Look::default);
        if let Some(point) = self.fixed {
            let point = |view| FoveaPoint { point: toward(point, &views[0], view), widening: 1.0 };
            return views.iter().map(point).collect();
        }
        let looks = self.each.iter_mut().zip(eyes).zip(views);
        looks.map(|((look, eye), view)| look.follow(gaze, eye, view, time)).collect()
    }

    /// The hidden pixels of a view; `version` grows when its mesh has changed.
    pub fn hidden(
        &mut self,
        index: usize,
        view: &View,
        mesh: &HiddenMesh,
        version: u64,
    ) -> Option<Arc<BitMask>> {
        let key = (version, view.fov, view.width, view.height);
        let look = self.each.get_mut(index)?;
        if look.mask.as_ref().is_none_or(|(made_for, _)| *made_for != key) {
            let mask = mesh.pixels(&view.fov, view.width, view.height).map(Arc::new);
            look.mask = Some((key, mask));
        }
        look.mask.as_ref().and_then(|(_, mask)| mask.clone())
    }
}

impl Look {
    fn follow(&mut self, gaze: Option<Gaze>, eye: &EyeView, view: &View, time: i64) -> FoveaPoint {
        let seconds = |time: i64| time as f64 * 1e-9;
        if let Some(gaze) = gaze {
            let direction = eye.space_from_eye.rotation.conjugate() * gaze.direction;
            let target = GazeTarget::Direction(direction);
            self.filter.push(view, GazeSample { time: seconds(gaze.time), target, valid: gaze.valid });
        }
        let new = self.filter.at(view, seconds(time));
        let steady = |old: &FoveaPoint| {
            (old.point - new.point).length() < STEADY && (old.widening - new.widening).abs() < STEADY_WIDENING
        };
        let new = FoveaPoint { point: new.point, widening: new.widening };
        *self.fovea.insert(self.fovea.filter(steady).unwrap_or(new))
    }
}

/// The point of a view, in 0..1 of it, that lies in the direction of a point of the first one.
fn toward(point: DVec2, first: &View, view: &View) -> DVec2 {
    if view == first {
        return point;
    }
    let scale = |view: &View| DVec2::new(f64::from(view.width), f64::from(view.height));
    let direction = first.world_from_eye.rotation * first.eye_direction(point * scale(first));
    let in_eye = view.world_from_eye.rotation.conjugate() * direction;
    view.project(in_eye).map_or_else(|| view.optical_centre(), |pixel| pixel / scale(view))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use glam::{DQuat, DVec3};

    const FOV: FieldOfView = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.0 };

    fn eye() -> EyeView {
        EyeView { space_from_eye: Pose::new(DQuat::from_rotation_y(0.7), DVec3::X), fov: FOV }
    }

    fn view() -> View {
        View {
            world_from_eye: Pose::IDENTITY,
            fov: FOV,
            width: 200,
            height: 100,
            spacing: Default::default(),
        }
    }

    #[test]
    fn the_sharp_region_follows_the_gaze_and_comes_back() {
        let mut look = Look::default();
        let target = DVec2::new(0.8, 0.3);
        let seen = view().eye_direction(target * DVec2::new(200.0, 100.0));
        let direction = (eye().space_from_eye.rotation * seen).normalize();
        let at = |look: &mut Look, ms: i64, valid| {
            let time = 5_000_000_000 + ms * 1_000_000;
            look.follow(Some(Gaze { time, direction, valid }), &eye(), &view(), time)
        };
        assert!((look.follow(None, &eye(), &view(), 1).point - view().optical_centre()).length() < 1e-9);
        for ms in (0..500).step_by(10) {
            at(&mut look, ms, true);
        }
        assert!((at(&mut look, 500, true).point - target).length() < 0.02);
        for ms in (510..2000).step_by(10) {
            at(&mut look, ms, false);
        }
        assert!((at(&mut look, 2000, false).point - view().optical_centre()).length() < STEADY);
    }

    #[test]
    fn a_gaze_that_trembles_makes_no_new_patterns() {
        let mut look = Look::default();
        let mut points = Vec::new();
        for step in 0..100i64 {
            let direction = eye().space_from_eye.rotation * DVec3::new(0.003 * (step % 2) as f64, 0.0, -1.0);
            let time = 1_000_000_000 + step * 11_000_000;
            points.push(look.follow(Some(Gaze { time, direction, valid: true }), &eye(), &view(), time));
        }
        assert!(points[2..].windows(2).all(|pair| pair[0] == pair[1]), "{points:?}");
    }
}
