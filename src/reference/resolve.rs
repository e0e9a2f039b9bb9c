//! Pixels as means over their last pictures, the twin of `kernels/resolve.wgsl`.

use glam::{DMat4, DVec2, DVec3};

use crate::layout::VisibilityRecord;
use crate::math::view::View;

/// The mean of a view's pixels, row after row.
#[derive(Clone, Debug)]
pub struct Mean {
    /// With its pixels where they look on average.
    pub view: View,
    /// Radiance.
    pub radiance: Vec<DVec3>,
    /// Pictures in each.
    pub counts: Vec<f64>,
}

/// A picture that comes to a mean.
pub struct Picture<'p> {
    /// As it was traced.
    pub traced: &'p View,
    /// As the mean has it.
    pub view: &'p View,
    /// Where within its pixels it looks, in pixels from the middles.
    pub jitter: DVec2,
    /// Radiance, row after row.
    pub radiance: &'p [DVec3],
    /// What its pixels see.
    pub visibility: &'p [VisibilityRecord],
    /// Neither eye nor things nor light have moved since the last one.
    pub is_still: bool,
    /// Leads from where a point of the scene is to where it was, by what records have of its motion.
    pub moved: &'p dyn Fn(u32) -> DMat4,
    /// Pictures at most that a mean holds.
    pub longest: f64,
}

impl Picture<'_> {
    fn place(&self, at: [u32; 2]) -> usize {
        (at[1] * self.view.width + at[0]) as usize
    }

    fn around(&self, [x, y]: [u32; 2]) -> impl Iterator<Item = [u32; 2]> + use<> {
        let (columns, rows) = (self.view.width - 1, self.view.height - 1);
        (y.max(1) - 1..=(y + 1).min(rows))
            .flat_map(move |y| (x.max(1) - 1..=(x + 1).min(columns)).map(move |x| [x, y]))
    }

    /// The nearest of the pixels around one, the sky last; itself where none is nearer.
    fn nearest(&self, at: [u32; 2]) -> [u32; 2] {
        let depth = |at: [u32; 2]| {
            let depth = f64::from(self.visibility[self.place(at)].depth);
            if depth > 0.0 { depth } else { f64::INFINITY }
        };
        self.around(at).fold(at, |best, other| if depth(other) < depth(best) { other } else { best })
    }

    /// Where the last picture, in its pixels, showed what a pixel sees.
    fn seen_before(&self, at: [u32; 2], last: &View) -> Option<DVec2> {
        let record = &self.visibility[self.place(at)];
        let centre = DVec2::new(f64::from(at[0]), f64::from(at[1])) + 0.5;
        let seen = self.traced.world_from_eye.rotation * self.traced.eye_direction(centre);
        let relative = if record.depth > 0.0 {
            let point = self.traced.world_from_eye.position + seen * f64::from(record.depth);
            (self.moved)(record.mapped).transform_point3(point) - last.world_from_eye.position
        } else {
            seen
        };
        last.picture().project(last.world_from_eye.rotation.inverse() * relative)
    }

    /// The mean with this picture.
    pub fn resolve(&self, last: Option<&Mean>) -> Mean {
        let pixels = (0..self.view.height).flat_map(|y| (0..self.view.width).map(move |x| [x, y]));
        let (radiance, counts) = pixels.map(|at| self.pixel(at, last)).unzip();
        Mean { view: *self.view, radiance, counts }
    }

    /// What the picture shows in the middle of a pixel.
    fn middle(&self, at: [u32; 2]) -> DVec3 {
        let size = DVec2::new(f64::from(self.view.width), f64::from(self.view.height));
        let at = DVec2::new(f64::from(at[0]), f64::from(at[1])) - self.jitter;
        bilinear(self.radiance, size, at.clamp(DVec2::ZERO, size - 1.0))
    }

    fn pixel(&self, at: [u32; 2], last: Option<&Mean>) -> (DVec3, f64) {
        let own = self.radiance[self.place(at)];
        let Some(last) = last else { return (self.middle(at), 1.0) };
        let centre = DVec2::new(f64::from(at[0]), f64::from(at[1])) + 0.5;
        let (mut longest, mut sharpness) = (self.longest, 1.0);
        let before = if self.is_still {
            centre
        } else {
            let nearest = self.nearest(at);
            let now = DVec2::new(f64::from(nearest[0]), f64::from(nearest[1])) + 0.5;
            let Some(there) = self.seen_before(nearest, &last.view) else { return (self.middle(at), 1.0) };
            let moved = there - self.traced.picture_point(now);
            // One picture at a pixel a picture, two at half of that.
            let pixels = moved.length() / self.view.pixel_scale(centre);
            longest = (1.0 / pixels.max(1e-6)).clamp(1.0, longest);
            let before = last.view.pixel_at(self.view.picture_point(centre) + moved);
            // A mean of pixels twice as wide holds a sixteenth as many pictures.
            let widths = self.view.pixel_scale(centre) / last.view.pixel_scale(before);
            sharpness = widths.min(1.0).powi(4);
            before
        };
        let size = DVec2::new(f64::from(last.view.width), f64::from(last.view.height));
        if before.cmple(DVec2::ZERO).any() || before.cmpge(size).any() {
            return (self.middle(at), 1.0);
        }
        let before = (before - 0.5).clamp(DVec2::ZERO, size - 1.0);
        let nearest = (before + 0.5).floor();
        let count = last.counts[(nearest.y * size.x + nearest.x) as usize] * sharpness + 1.0;
        let count = count.min(longest);
        let mut mean = bicubic(&last.radiance, size, before);
        if !self.is_still {
            let shown = || self.around(at).map(|at| self.radiance[self.place(at)]);
            let low = shown().fold(own, DVec3::min);
            mean = mean.clamp(low, shown().fold(own, DVec3::max));
        }
        let aside = if self.is_still { 1.0 } else { ((count - 1.0) / 3.0).min(1.0) };
        (mean.lerp(self.middle(at).lerp(own, aside), 1.0 / count), count)
    }
}

fn bilinear(values: &[DVec3], size: DVec2, at: DVec2) -> DVec3 {
    let (first, part) = (at.floor(), at.fract());
    let value = |across: f64, down: f64| {
        let at = (first + DVec2::new(across, down)).min(size - 1.0);
        values[(at.y * size.x + at.x) as usize]
    };
    let upper = value(0.0, 0.0).lerp(value(1.0, 0.0), part.x);
    upper.lerp(value(0.0, 1.0).lerp(value(1.0, 1.0), part.x), part.y)
}

/// Catmull and Rom 1974, across and down.
fn bicubic(values: &[DVec3], size: DVec2, at: DVec2) -> DVec3 {
    let (first, part) = (at.floor(), at.fract());
    let weights = |t: f64| {
        let (t2, t3) = (t * t, t * t * t);
        [2.0 * t2 - t - t3, 2.0 - 5.0 * t2 + 3.0 * t3, t + 4.0 * t2 - 3.0 * t3, t3 - t2].map(|w| 0.5 * w)
    };
    let (across, down) = (weights(part.x), weights(part.y));
    let mut sum = DVec3::ZERO;
    for (j, down) in down.iter().enumerate() {
        for (i, across) in across.iter().enumerate() {
            let at = (first + DVec2::new(i as f64, j as f64) - 1.0).clamp(DVec2::ZERO, size - 1.0);
            sum += values[(at.y * size.x + at.x) as usize] * (across * down);
        }
    }
    sum.max(DVec3::ZERO)
}
