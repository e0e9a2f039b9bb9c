//! What is to be seen along a course: references of the frames that are judged, and what comes into sight in them.

use glam::DVec2;

use super::Course;
use crate::config::{Config, Stereo};
use crate::error::Result;
use crate::frame::Renderer;
use crate::math::view::View;
use crate::metrics::pairs::{Match, matches};
use crate::metrics::uncovered::{AGES, Ages};
use crate::tradeoff::judge::split;
use crate::tradeoff::reference::{Making, Reference, distances, obtain};
use crate::tradeoff::rivals::plan;
use crate::tradeoff::store::Store;

use super::Motion;

/// A course with what its pictures should be.
pub(in crate::tradeoff) struct Scenery {
    pub course: Course,
    /// The eyes in each frame.
    pub eyes: Vec<Vec<View>>,
    /// Of each frame that is judged; one alone where nothing moves.
    references: Vec<Reference>,
    /// Of the first eye, in each frame that is judged, where the head goes past something.
    pub ages: Option<Vec<Ages>>,
    /// Pixels of both eyes that show the same in the last frame.
    pub matches: Vec<Match>,
}

impl Scenery {
    /// What a frame that is judged should be, the first being 0.
    pub fn reference(&self, judged: usize) -> &Reference {
        &self.references[judged.min(self.references.len() - 1)]
    }
}

/// Loads or renders what is to be seen. `tick` is called for each pass, with whether it was made now.
pub(in crate::tradeoff) fn prepare(
    renderer: &mut Renderer,
    course: Course,
    views: &dyn Fn(crate::math::pose::Pose) -> Vec<View>,
    making: &Making<'_>,
    store: &Store,
    tick: &mut dyn FnMut(bool),
) -> Result<Scenery> {
    let eyes: Vec<Vec<View>> = course.heads.iter().map(|head| views(*head)).collect();
    let judged = course.judged();
    let wanted = if course.rests() { judged.start..judged.start + 1 } else { judged.clone() };
    let mut references = Vec::new();
    for frame in wanted {
        renderer.show_at(course.times[frame]);
        let plan = plan(&eyes[frame], Stereo::PerEye)?;
        let name = format!("reference {} {frame}", course.motion.key());
        let reference = obtain(renderer, &plan, making, store, &name, tick)?;
        let left = split(&reference.display, &eyes[frame]).swap_remove(0);
        left.write_png(&store.frame("reference", course.motion.key(), frame - judged.start)?)?;
        references.push(reference);
    }
    let last = judged.end - 1;
    let matches = match eyes[last].as_slice() {
        [left, right] => {
            let seen = [distances(renderer, left, making.base)?, distances(renderer, right, making.base)?];
            matches([left, right], [&seen[0], &seen[1]])
        }
        _ => Vec::new(),
    };
    let ages = match course.motion {
        Motion::Walk => Some(uncovered(renderer, &course, &eyes, making.base)?),
        _ => None,
    };
    Ok(Scenery { course, eyes, references, ages, matches })
}

/// Ages of the first eye's pixels in each frame that is judged. Frames before tell what was hidden then.
fn uncovered(
    renderer: &mut Renderer,
    course: &Course,
    eyes: &[Vec<View>],
    base: &Config,
) -> Result<Vec<Ages>> {
    let judged = course.judged();
    let first = judged.start.saturating_sub(AGES);
    let mut before = distances(renderer, &eyes[first][0], base)?;
    let mut ages = Ages::new(before.len());
    let mut list = if first == judged.start { vec![ages.clone()] } else { Vec::new() };
    for frame in first + 1..judged.end {
        let now = distances(renderer, &eyes[frame][0], base)?;
        ages.advance([&eyes[frame - 1][0], &eyes[frame][0]], [&before, &now]);
        if frame >= judged.start {
            list.push(ages.clone());
        }
        before = now;
    }
    Ok(list)
}

/// Where the eyes look along a course, in 0..1 of the first one's picture: straight ahead in what turns with the head.
pub(in crate::tradeoff) const GAZE: DVec2 = DVec2::splat(0.5);
