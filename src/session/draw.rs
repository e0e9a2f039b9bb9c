//! From what is traced to the renderer's requests.

use glam::DMat4;

use super::{Part, Traced};
use crate::config::Quality;
use crate::error::Result;
use crate::frame::{FrameReport, Renderer, ViewRequest};
use crate::headset::{Canvas, Toggles};
use crate::math::pose::Pose;
use crate::reconstruct::Output;
use crate::scene::hands::HandPlaces;

/// A picture to be made.
pub struct Picture<'p> {
    /// What is traced.
    pub traced: &'p [Traced],
    /// Where each of the headset's views is drawn.
    pub canvases: &'p [Canvas],
    /// Of the frame's random numbers.
    pub seed: u32,
    /// Stops by which it is brightened beside automatic exposure.
    pub exposure: f32,
}

/// Makes the loop's pictures: the renderer, and a notebook in tests.
pub trait Draw {
    /// Makes one. `late` is asked, once a view's samples are traced, where its eye will be when the picture is seen:
    /// see [`Renderer::render_views`].
    ///
    /// # Errors
    /// Where a device fails.
    fn draw(&mut self, picture: &Picture, late: &mut dyn FnMut(usize) -> Option<Pose>)
    -> Result<FrameReport>;

    /// Makes the next ones with another quality: see [`Renderer::set_quality`].
    ///
    /// # Errors
    /// Where it cannot be used.
    fn set_quality(&mut self, quality: &Quality) -> Result<()>;

    /// The next ones show what moves where it is so many seconds after the beginning: see [`Renderer::show_at`].
    fn show_at(&mut self, seconds: f64);

    /// The next ones show the wearer's hands there: see [`Renderer::show_hands`].
    fn show_hands(&mut self, hands: &HandPlaces);

    /// The next ones show what hands can seize where they have put it: see [`Renderer::put`].
    fn put(&mut self, places: &[Option<DMat4>]);

    /// Switches what is to be switched.
    fn toggle(&mut self, toggles: Toggles);

    /// What the operator should know, each once.
    fn take_notes(&mut self) -> Vec<String>;
}

impl Draw for Renderer {
    fn draw(
        &mut self,
        picture: &Picture,
        late: &mut dyn FnMut(usize) -> Option<Pose>,
    ) -> Result<FrameReport> {
        self.render_views(&requests(picture), picture.seed, late)
    }

    fn set_quality(&mut self, quality: &Quality) -> Result<()> {
        Renderer::set_quality(self, quality)
    }

    fn show_at(&mut self, seconds: f64) {
        Renderer::show_at(self, seconds);
    }

    fn show_hands(&mut self, hands: &HandPlaces) {
        Renderer::show_hands(self, hands);
    }

    fn put(&mut self, places: &[Option<DMat4>]) {
        Renderer::put(self, places);
    }

    fn toggle(&mut self, toggles: Toggles) {
        if toggles.exposure {
            self.meter().toggle_lock();
        }
        if toggles.overlay {
            self.toggle_overlay();
        }
    }

    fn take_notes(&mut self) -> Vec<String> {
        Renderer::take_notes(self)
    }
}

/// What is traced, as the renderer takes it, with the images that it fills.
fn requests<'p>(picture: &Picture<'p>) -> Vec<ViewRequest<'p>> {
    let output = |part: &Part| {
        let Canvas { target, rect, encoding, motion } = &picture.canvases[part.view];
        let (width, height) = part.size;
        let rect = crate::gpu::vulkan::Rect { width, height, ..*rect };
        let (source, encoding, exposure) = (part.source, *encoding, picture.exposure);
        Output { target, rect, source, encoding, exposure, motion: motion.as_ref() }
    };
    let request = |traced: &Traced| ViewRequest {
        view: traced.view,
        gaze: traced.fovea.point,
        widening: traced.fovea.widening,
        hidden: traced.hidden.clone(),
        outputs: traced.parts.iter().map(output).collect(),
    };
    picture.traced.iter().map(request).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::view::{FieldOfView, View};
    use crate::session::FoveaPoint;
    use glam::DVec2;

    #[test]
    fn what_is_traced_is_sharp_where_and_as_widely_as_it_is_said() {
        let fov = FieldOfView { left: -1.2, right: 0.8, up: 1.0, down: -1.4 };
        let view =
            View { world_from_eye: Pose::IDENTITY, fov, width: 20, height: 10, spacing: Default::default() };
        let fovea = FoveaPoint { point: DVec2::new(0.2, 0.7), widening: 2.5 };
        let traced = [Traced { view, fovea, hidden: None, parts: Vec::new() }];
        let requests = requests(&Picture { traced: &traced, canvases: &[], seed: 3, exposure: 1.0 });
        assert_eq!((requests[0].view, requests[0].gaze, requests[0].widening), (view, fovea.point, 2.5));
    }
}
