//! What a frame is made of, and where its pixels go.

use std::sync::Arc;

use glam::{DMat4, DVec2};

use super::{MotionImage, Overlay};
use crate::gpu::vulkan::{BufferRef, Encoding, Rect, Target};
use crate::math::pose::Pose;
use crate::math::view::View;
use crate::scene::Sun;

/// Metres at which a target's depth is 1; it falls as 1/z, and is 0 infinitely far away and, without guided
/// reconstruction, everywhere. Reversed like this, floating-point depths are equally exact at all distances.
pub const NEAREST_DEPTH: f32 = 0.05;

/// What a frame's samples are made into.
#[derive(Clone)]
pub struct Frame<'a> {
    /// Where the eye is and what it sees; its size is the pattern's. Outputs show its picture: pixels that are not even
    /// are for guided reconstruction, and for views of at most [`super::Reconstruction::most_pixels`].
    pub view: &'a View,
    /// Sub-pixel jitter: where within their pixels the view's rays look, in pixels from the middles, which its spacing is
    /// shifted by. Another one in each frame where pixels are means over several ([`super::Reconstruction::jitter`]).
    pub jitter: DVec2,
    /// One [`crate::layout::SampleRecord`] for each sample of the pattern, in its order.
    pub samples: BufferRef,
    /// One [`crate::layout::VisibilityRecord`] for each pixel, row after row; needed for guided reconstruction.
    pub visibility: Option<BufferRef>,
    /// The sun whose visibility the records hold: its light is added at each pixel (guided).
    pub sun: Option<Sun>,
    /// Radiance, above 0, below which reflections that pixels expect count no more than others (guided): a small
    /// share of the environment's.
    pub least_expected: f32,
    /// Estimates at most that a sample's mean holds, at least 1, where light changes; infinite where it stays.
    pub light_holds: f32,
    /// Whether things or lights move, so that light may be other than it was in the last frame.
    pub light_changes: bool,
    /// Estimates that a sample counts as that was sent all rays, at least 1, where others are sent fewer
    /// ([`crate::layout::SAMPLE_REUSES`]) and count as one.
    pub estimates: f32,
    /// Whether view and pattern are those of the frame before, so that samples without light of this frame keep what they had;
    /// otherwise these look for it where their surface was, as others do.
    pub rests: bool,
    /// Where what moves as a whole is: `world_from_part` in metres, by the number that [`crate::layout::SURFACE_MOVER`] has
    /// of it, less one; `None` where that is not known. The same numbers are of the same things in all frames.
    pub movers: Arc<[Option<DMat4>]>,
    /// Where the eye is when the picture is seen: pixels are moved to where it sees them, by their depths
    /// (guided) or as if all were far away. `None` where that is where the view was traced from.
    pub shown_from: Option<Pose>,
    /// Stops that come to each output's own.
    pub exposure: f32,
    /// The view of the other eye, whose samples may serve this one: see [`super::Settings::reuse`].
    pub other: Option<usize>,
    /// What is drawn over the picture, and the gaze in 0..1 of it.
    pub overlay: (Overlay, DVec2),
    /// Where the pixels go: rectangles of one target do not overlap.
    pub outputs: &'a [Output<'a>],
}

/// A rectangle of a target that shows a rectangle of the view.
pub struct Output<'a> {
    /// The target.
    pub target: &'a Target,
    /// The part of the target that is written; the rest is kept.
    pub rect: Rect,
    /// The view's pixel (x, y) that comes to the rectangle's upper left corner.
    pub source: [u32; 2],
    /// What the target's numbers mean.
    pub encoding: Encoding,
    /// Exposure in EV: radiance is multiplied by two to its power before tone mapping.
    pub exposure: f32,
    /// Where motion vectors of what the rectangle shows go, if anywhere (guided).
    pub motion: Option<&'a MotionImage>,
}

impl<'a> Output<'a> {
    /// The view's upper left part over the whole target, with its format's usual encoding.
    pub fn whole(target: &'a Target, exposure: f32) -> Self {
        let rect = Rect { x: 0, y: 0, width: target.width(), height: target.height() };
        Output {
            target,
            rect,
            source: [0, 0],
            encoding: Encoding::of(target.format()),
            exposure,
            motion: None,
        }
    }
}

impl Output<'_> {
    /// Factor on radiance, with so many more stops.
    pub(super) fn factor(&self, stops: f32) -> f32 {
        (self.exposure + stops).exp2()
    }

    /// What is added to a pixel of the target for the one that it shows.
    pub(super) fn shift(&self) -> [i32; 2] {
        [self.source[0] as i32 - self.rect.x as i32, self.source[1] as i32 - self.rect.y as i32]
    }

    /// # Panics
    /// If it reaches beyond a picture of that size.
    pub(super) fn require_inside(&self, width: u32, height: u32) {
        let reach = |source: u32, size: u32| u64::from(source) + u64::from(size);
        let inside = reach(self.source[0], self.rect.width) <= u64::from(width)
            && reach(self.source[1], self.rect.height) <= u64::from(height);
        assert!(inside, "{:?} from {:?} on reaches beyond the view", self.rect, self.source);
    }
}
