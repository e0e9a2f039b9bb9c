//! Where pictures are judged: a pose, in frames that follow each other.

use glam::DVec2;

use crate::math::view::View;
use crate::metrics::pairs::Match;
use crate::tradeoff::rivals::Sight;

/// A pose with what it is judged by.
pub(super) struct Place {
    /// Before the first step, and at each of both.
    pub eyes: Vec<Vec<View>>,
    /// Of the first step.
    pub matches: Vec<Match>,
}

impl Place {
    /// The eyes at a step that is judged.
    pub fn at(&self, step: usize) -> &[View] {
        &self.eyes[self.run_up() + step]
    }

    /// Frames before the first step.
    pub fn run_up(&self) -> usize {
        self.eyes.len() - 2
    }

    pub fn sight(&self, step: usize, gaze: [f64; 2]) -> Sight<'_> {
        self.seen(self.run_up() + step, gaze)
    }

    /// What is seen in a frame, from the second one before the first step on.
    pub fn seen(&self, frame: usize, gaze: [f64; 2]) -> Sight<'_> {
        Sight { eyes: &self.eyes[frame], before: &self.eyes[frame - 1], gaze: DVec2::from_array(gaze) }
    }
}
