//! Pixels as means over their last pictures: edges, thin things, textures and coverage are smoothed over time.
//!
//! Each picture looks at another point within every pixel ([`crate::math::spacing::Spacing::shifted`]), so that the mean
//! over some is as if each had sent as many rays (temporal antialiasing). Where nothing moves it is just that; elsewhere
//! the last mean is looked up where the surface was and held to the range of what is around it now, so that what is no
//! longer there goes at once, and holds fewer pictures the faster it moves: none but its own from a pixel a picture on,
//! where looking between pixels would soften more than it smooths. Where the eye itself is as fast all pictures look into
//! the middles of their pixels, and are what they are without means. The twin in `f64` is `src/reference/resolve.rs`.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec2};

use super::motions::PackedMotion;
use super::parameters::{PackedSpacing, Rays};
use super::reprojection::projection;
use super::{Frame, shaders};
use crate::error::Result;
use crate::gpu::vulkan::{BufferRef, Commands, ComputePipeline, Context, DeviceBuffer, HostBuffer};
use crate::layout::MAX_MOVERS;
use crate::math::view::View;

/// Bytes of a pixel's mean, and of its count.
const MEAN_BYTES: usize = 8;
const COUNT_BYTES: usize = 4;
/// Pixels by which most of a picture may move for the last mean to serve it, where things are so many metres away.
const MOST_PIXELS: f64 = 1.0;
const NEAR: f64 = 2.0;
/// After so many pictures the jitter comes again.
const JITTERS: u32 = 16;

/// The shader.
pub(super) struct Resolve {
    pipeline: ComputePipeline,
    longest: u32,
}

/// A view's last mean.
#[derive(Default)]
pub(super) struct Means {
    last: Option<Kept>,
    spare: Option<Buffers>,
    uniform: Option<HostBuffer>,
    /// Pictures since nothing was known.
    pictures: u32,
}

struct Kept {
    /// With its pixels where the mean has them.
    view: View,
    movers: Arc<[Option<DMat4>]>,
    buffers: Buffers,
}

#[derive(Clone)]
struct Buffers {
    means: BufferRef,
    counts: BufferRef,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Pictures {
    traced: PackedSpacing,
    spacing: PackedSpacing,
    last_spacing: PackedSpacing,
    x: [f32; 4],
    y: [f32; 4],
    ahead: [f32; 4],
    offset: [f32; 4],
    jitter: [f32; 4],
    size: [u32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct ResolveParameters {
    rays: Rays,
    width: u32,
    height: u32,
    longest: f32,
}

impl Means {
    /// Where within its pixels the next picture of a view looks, in pixels from their middles: in the middle where there
    /// is no mean that it could come to.
    pub fn jitter(&self, view: &View) -> DVec2 {
        match self.pictures % JITTERS {
            _ if !self.serves(view) => DVec2::ZERO,
            index => DVec2::new(radical_inverse(2, index), radical_inverse(3, index)) - 0.5,
        }
    }

    /// Whether the last mean is of a picture seen from so near that most of it serves the next one.
    fn serves(&self, view: &View) -> bool {
        self.last.as_ref().is_some_and(|kept| {
            let (now, then) = (view.world_from_eye, kept.view.world_from_eye);
            let pixel = (view.fov.right - view.fov.left) / f64::from(view.picture().width);
            let turned = now.rotation.angle_between(then.rotation);
            turned + now.position.distance(then.position) / NEAR < MOST_PIXELS * pixel
        })
    }

    /// The next picture finds nothing.
    pub fn forget(&mut self) {
        if let Some(kept) = self.last.take() {
            self.spare = Some(kept.buffers);
        }
    }

    /// A picture looked into the middles of its pixels, as no last mean serves it: the next one's mean begins with it.
    fn begin(
        &mut self,
        commands: &mut Commands,
        frame: &Frame<'_>,
        buffers: Buffers,
        shaded: &BufferRef,
    ) -> Result<BufferRef> {
        let pixels = frame.view.pixels();
        commands.copy(shaded, &buffers.means, pixels * MEAN_BYTES);
        commands.fill_zero(&buffers.counts);
        commands.barrier();
        commands.end_stage("resolve");
        self.pictures = 1;
        Ok(self.take(Kept { view: *frame.view, movers: frame.movers.clone(), buffers }))
    }

    /// Keeps a mean in place of the last one.
    fn take(&mut self, now: Kept) -> BufferRef {
        let means = now.buffers.means.clone();
        self.spare = self.last.replace(now).map(|last| last.buffers);
        means
    }

    /// Memory for the means of so many pixels that nothing reads from.
    fn buffers(&mut self, context: &Context, pixels: usize) -> Result<Buffers> {
        let device = |bytes| DeviceBuffer::new(context, bytes).map(|buffer| BufferRef::from(&buffer));
        match self.spare.take().filter(|spare| spare.means.size() >= pixels * MEAN_BYTES) {
            Some(spare) => Ok(spare),
            None => {
                Ok(Buffers { means: device(pixels * MEAN_BYTES)?, counts: device(pixels * COUNT_BYTES)? })
            }
        }
    }
}

/// The digits of a number in a base, mirrored at the point (van der Corput): 0.5 for 0, so that the middle comes first.
fn radical_inverse(base: u32, index: u32) -> f64 {
    let (mut value, mut digit, mut rest) = (0.0, 1.0 / f64::from(base), index);
    while rest > 0 {
        value += digit * f64::from(rest % base);
        rest /= base;
        digit /= f64::from(base);
    }
    if index == 0 { 0.5 } else { value }
}

impl Pictures {
    /// What leads from a frame to the last mean.
    fn new(frame: &Frame<'_>, mean: &View, last: &Kept, motions: usize) -> Pictures {
        let [x, y, ahead] = projection(&last.view).map(|row| row.as_vec3().extend(0.0).to_array());
        let offset = frame.view.world_from_eye.position - last.view.world_from_eye.position;
        let rests = *mean == last.view && !frame.light_changes;
        Pictures {
            traced: PackedSpacing::of(frame.view),
            spacing: PackedSpacing::of(mean),
            last_spacing: PackedSpacing::of(&last.view),
            x,
            y,
            ahead,
            offset: offset.as_vec3().extend(0.0).to_array(),
            jitter: [frame.jitter.x as f32, frame.jitter.y as f32, 0.0, 0.0],
            size: [last.view.width, last.view.height, motions as u32, rests.into()],
        }
    }
}

impl Resolve {
    /// Builds the shader; means hold so many pictures at most.
    pub fn new(context: &Context, longest: u32) -> Result<Self> {
        let pipeline = ComputePipeline::new(context, &shaders::RESOLVE, "resolve_pixels")?;
        Ok(Resolve { pipeline, longest })
    }

    /// Records the pass over a view's pixels, from their radiance in this picture; returns their means.
    pub fn record(
        &self,
        context: &Context,
        commands: &mut Commands,
        kept: &mut Means,
        frame: &Frame<'_>,
        (rays, visibility, shaded): (Rays, &BufferRef, &BufferRef),
    ) -> Result<BufferRef> {
        let view = View { spacing: frame.view.spacing.shifted(-frame.jitter), ..*frame.view };
        let buffers = kept.buffers(context, view.pixels())?;
        let Some(last) = kept.last.as_ref().filter(|_| kept.serves(&view)) else {
            return kept.begin(commands, frame, buffers, shaded);
        };
        let motions = PackedMotion::all(frame.view, &last.view, &last.movers, &frame.movers);
        let pictures = [Pictures::new(frame, &view, last, motions.len())];
        let uniform = match kept.uniform.take() {
            Some(buffer) => buffer,
            None => {
                HostBuffer::new(context, size_of_val(&pictures) + MAX_MOVERS * size_of::<PackedMotion>())?
            }
        };
        uniform.write(0, &pictures);
        uniform.write(size_of_val(&pictures), &motions);
        let Buffers { means, counts } = &last.buffers;
        let bound = BufferRef::from(&uniform);
        let bound = [shaded, visibility, &bound, means, counts, &buffers.means, &buffers.counts];
        let parameters =
            ResolveParameters { rays, width: view.width, height: view.height, longest: self.longest as f32 };
        let groups = [view.width.div_ceil(64), view.height, 1];
        commands.dispatch(&self.pipeline, &bound.map(Some), bytemuck::bytes_of(&parameters), groups)?;
        commands.end_stage("resolve");
        kept.uniform = Some(uniform);
        kept.pictures = kept.pictures.wrapping_add(1);
        Ok(kept.take(Kept { view, movers: frame.movers.clone(), buffers }))
    }
}

#[cfg(test)]
mod tests;
