//! What is traced for a headset's views, and which parts of it become which view's picture.

use std::sync::Arc;

use glam::DVec2;

use crate::config::Stereo;
use crate::error::{Error, Result};
use crate::foveation::BitMask;
use crate::frame::Plan;
use crate::math::view::View;

/// Where a view is sharp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FoveaPoint {
    /// In 0..1 of the view.
    pub point: DVec2,
    /// Factor for the width of the region of full density.
    pub widening: f64,
}

/// A view that is traced.
#[derive(Clone, Debug, PartialEq)]
pub struct Traced {
    /// The view, with what it has beyond what is shown.
    pub view: View,
    /// Where it is sharp.
    pub fovea: FoveaPoint,
    /// Pixels of it that nobody sees.
    pub hidden: Option<Arc<BitMask>>,
    /// The pictures that it becomes.
    pub parts: Vec<Part>,
}

/// A part of a traced view that fills a headset's view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Part {
    /// The headset's view, by its index.
    pub view: usize,
    /// The upper left pixel in the traced view.
    pub source: [u32; 2],
    /// Pixels across and down.
    pub size: (u32, u32),
}

impl Traced {
    /// What is traced for a headset's views, each sharp where `sharp` says, as `stereo` says. Views that are
    /// traced alone get `margin`, as a share of their size at each side, beyond what is shown.
    ///
    /// # Errors
    /// [`Error::Setting`] where one view cannot serve them.
    pub fn for_views(
        views: &[View],
        fovea: &[FoveaPoint],
        stereo: Stereo,
        margin: f64,
    ) -> Result<Vec<Traced>> {
        match (stereo, views) {
            (Stereo::PerEye, _) => {
                let each = views.iter().zip(fovea).enumerate();
                Ok(each.map(|(index, (view, fovea))| Traced::alone(index, view, *fovea, margin)).collect())
            }
            (Stereo::Mono, [first, ..]) => {
                if views.iter().any(|view| size(view) != size(first)) {
                    return Err(per_eye("its views differ in size"));
                }
                let part = |view| Part { view, source: [0, 0], size: size(first) };
                let parts = (0..views.len()).map(part).collect();
                Ok(vec![Traced { view: *first, fovea: fovea[0], hidden: None, parts }])
            }
            (Stereo::Shared, [left, right]) => {
                let plan = Plan::stereo([*left, *right], Stereo::Shared)?;
                let (view, cuts) = &plan.views[0];
                let part = |(view, cut): (usize, &crate::frame::Cut)| Part {
                    view,
                    source: cut.source,
                    size: (cut.rect.width, cut.rect.height),
                };
                let point = plan.gaze_points(fovea[0].point)[0];
                let parts = cuts.iter().enumerate().map(part).collect();
                Ok(vec![Traced { view: *view, fovea: FoveaPoint { point, ..fovea[0] }, hidden: None, parts }])
            }
            _ => Err(per_eye("it has more than two views")),
        }
    }

    fn alone(index: usize, view: &View, fovea: FoveaPoint, margin: f64) -> Traced {
        let pixels = |size: u32| (f64::from(size) * margin).ceil() as u32;
        let margin = [pixels(view.width), pixels(view.height)];
        let parts = vec![Part { view: index, source: margin, size: size(view) }];
        if margin == [0, 0] {
            return Traced { view: *view, fovea, hidden: None, parts };
        }
        let larger = view.with_margin(margin);
        let scale = |view: &View| DVec2::new(f64::from(view.width), f64::from(view.height));
        let added = (scale(&larger) - scale(view)) * 0.5;
        let point = (fovea.point * scale(view) + added) / scale(&larger);
        Traced { view: larger, fovea: FoveaPoint { point, ..fovea }, hidden: None, parts }
    }
}

fn size(view: &View) -> (u32, u32) {
    (view.width, view.height)
}

fn per_eye(why: &str) -> Error {
    Error::setting("view.stereo", format!("one view cannot serve this headset, since {why}; choose per-eye"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;
    use crate::math::view::FieldOfView;
    use glam::{DQuat, DVec3};

    /// Two eyes whose fields of view mirror each other.
    fn eyes() -> [View; 2] {
        let fov = FieldOfView { left: -1.4, right: 0.7, up: 1.0, down: -1.1 };
        let mirrored = FieldOfView { left: -0.7, right: 1.4, ..fov };
        let eye = |x, fov| View {
            world_from_eye: Pose::new(DQuat::from_rotation_y(0.3), DVec3::new(x, 1.6, 0.0)),
            fov,
            width: 210,
            height: 160,
            spacing: Default::default(),
        };
        [eye(-0.2, fov), eye(0.2, mirrored)]
    }

    const LOOKS: [FoveaPoint; 2] = [
        FoveaPoint { point: DVec2::new(0.3, 0.6), widening: 1.0 },
        FoveaPoint { point: DVec2::new(0.1, 0.6), widening: 2.5 },
    ];

    /// The direction of a point, in 0..1 of a view, in the world.
    fn direction(view: &View, point: DVec2) -> DVec3 {
        let scale = DVec2::new(f64::from(view.width), f64::from(view.height));
        (view.world_from_eye.rotation * view.eye_direction(point * scale)).normalize()
    }

    /// Each view's picture shows what the view sees: pixels of its part look where its own do.
    fn assert_shown(traced: &[Traced], views: &[View]) {
        let mut shown = vec![0; views.len()];
        for (one, part) in traced.iter().flat_map(|one| one.parts.iter().map(move |part| (one, part))) {
            let view = &views[part.view];
            shown[part.view] += 1;
            assert_eq!(part.size, size(view));
            for (x, y) in [(0.5, 0.5), (100.5, 31.5), (209.5, 159.5)] {
                let source = DVec2::new(f64::from(part.source[0]), f64::from(part.source[1]));
                let through =
                    one.view.world_from_eye.rotation * one.view.eye_direction(source + DVec2::new(x, y));
                let own = view.world_from_eye.rotation * view.eye_direction(DVec2::new(x, y));
                assert!(
                    through.normalize().dot(own.normalize()) > 1.0 - 1e-9,
                    "view {} at {x} {y}",
                    part.view
                );
            }
        }
        assert_eq!(shown, vec![1; views.len()]);
    }

    #[test]
    fn every_view_shows_what_it_sees_and_no_other() {
        let views = eyes();
        for stereo in [Stereo::PerEye, Stereo::Shared] {
            for margin in [0.0, 0.05] {
                let traced = Traced::for_views(&views, &LOOKS, stereo, margin).unwrap();
                assert_shown(&traced, &views);
                let exchanged = [views[1], views[0]];
                let wrong = std::panic::catch_unwind(|| assert_shown(&traced, &exchanged));
                assert!(wrong.is_err(), "{stereo:?}: the comparer takes eyes that are exchanged");
            }
        }
        // Each eye's picture is taken from where that eye is.
        let alone = Traced::for_views(&views, &LOOKS, Stereo::PerEye, 0.02).unwrap();
        for (traced, view) in alone.iter().zip(&views) {
            assert_eq!(traced.view.world_from_eye, view.world_from_eye);
        }
    }

    #[test]
    fn a_margin_leaves_the_gaze_where_it_is() {
        for margin in [0.0, 0.03, 0.2] {
            for (traced, (view, look)) in Traced::for_views(&eyes(), &LOOKS, Stereo::PerEye, margin)
                .unwrap()
                .iter()
                .zip(eyes().iter().zip(LOOKS))
            {
                let (there, here) =
                    (direction(&traced.view, traced.fovea.point), direction(view, look.point));
                assert!(there.dot(here) > 1.0 - 1e-9, "{margin}");
                assert!(traced.view.width >= view.width && traced.fovea.widening == look.widening);
            }
        }
    }

    #[test]
    fn one_view_for_both_eyes_is_sharp_where_the_first_looks() {
        let looks = [LOOKS[1], LOOKS[0]];
        let shared = &Traced::for_views(&eyes(), &looks, Stereo::Shared, 0.1).unwrap()[0];
        let (there, here) =
            (direction(&shared.view, shared.fovea.point), direction(&eyes()[0], looks[0].point));
        assert!(there.dot(here) > 1.0 - 1e-9 && shared.fovea.widening == looks[0].widening);
        let mono = &Traced::for_views(&eyes(), &looks, Stereo::Mono, 0.1).unwrap()[0];
        assert_eq!((mono.fovea, mono.parts.len()), (looks[0], 2));
        let four = [eyes(), eyes()].concat();
        assert!(Traced::for_views(&four, &LOOKS, Stereo::Shared, 0.0).is_err());
    }
}
