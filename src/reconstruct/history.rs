//! What a view's frames keep for the next one and for the other eye: light found before is carried to new samples.
//!
//! Light is carried at samples, not at pixels: a frame has twenty times fewer of them, and what is carried is
//! smooth once the surface's own colours are divided out. Each sample's point is projected into the last
//! frame's view; the samples nearest to that pixel which agree in normal and plane are averaged by distance,
//! and the new estimate joins their mean, which holds `time.frames` estimates at most. Demodulated diffuse
//! and specular light have ages of their own: the latter loses history as the reflected direction turns
//! relative to the lobe's width. How far what hides a part of the sun is, which makes penumbras, is carried for some
//! frames after it was found. The other eye lends what it has just traced, not what it has accumulated, so no estimate
//! counts twice. Changes of light are told from noise by the mean brightness of twelve neighbours: where its
//! quick mean leaves its slow one by more than three standard deviations and three hundredths, all estimates
//! begin anew. What moves as a whole is looked up where it was (`src/reconstruct/motions.rs`), and keeps less where it turns or
//! light glides over it. A frame that finds one before it, seen from nearly the same place, sends `time.rays` of the
//! light rays, by default half: at rest history makes up for more than that within a few frames. In motion samples whose
//! surfaces the frame before has seen are sent `time.rays_in_motion` of them, and others all, which count as several
//! estimates; of the former `time.samples_in_motion` are shaded, in turn, and the others have what is found where their surface was. Where view, things and light have rested for longer, samples take turns: `time.samples` of them are shaded, in
//! groups that follow each other in the list, and those of the others that see the surface
//! that they saw keep their means and ages ([`crate::layout::SAMPLE_REUSES`]). A surface that comes into view has no history there; it
//! is filtered as a first frame is. `Renderer::forget` drops everything: after a cut, and between pictures
//! that stand for themselves. The twin in `f64` is `src/reference/accumulate.rs`.

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3};

use super::motions::PackedMotion;
use super::parameters::{PackedSpacing, Rays, rays};
use super::reprojection::projection;
use super::shaders;
use super::tables::Tables;
use crate::error::Result;
use crate::gpu::vulkan::{BufferRef, Commands, ComputePipeline, Context, DeviceBuffer, HostBuffer};
use crate::layout::{MAX_MOVERS, SampleRecord};
use crate::math::view::View;
use crate::trace::pattern_maker::Neighbours;

/// Bytes of a sample's ages and means, as `kernels/accumulate.wgsl` has them.
const HISTORY_BYTES: usize = 32;
/// Neighbours whose mean brightness tells whether light has changed.
const CHANGE_NEIGHBOURS: u32 = 12;

/// What is reused, and for how long.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Reuse {
    /// Estimates at most that the mean of a sample's light holds, 1 to 256.
    pub frames: u32,
    /// Whether samples of one eye serve the other.
    pub eyes: bool,
    /// Pictures at most that the mean of a pixel holds, 1 to 64, where pixels are wider than the picture's; 1: none.
    pub pictures: u32,
}

/// Carries light to a frame's samples.
pub(super) struct Accumulate {
    pipeline: ComputePipeline,
    reuse: Reuse,
}

/// A view's memory of its frames.
#[derive(Default)]
pub(super) struct History {
    /// What the last frame has left, and memory that the next one may use.
    last: Option<Kept>,
    /// Frames up to the last one that rested: see [`History::rests`].
    rested: u32,
    spare: Option<Buffers>,
    sources: Option<HostBuffer>,
}

/// From frame to frame a view has hardly moved within so many metres and radians: less than 20 degrees a second at 90 Hz.
const NEAR: (f64, f64) = (2e-3, 3.5e-3);

/// It rests within a tenth of that: what comes into sight is seen by few samples.
const RESTING: (f64, f64) = (NEAR.0 / 10.0, NEAR.1 / 10.0);

/// A frame's samples as they are looked up later.
#[derive(Clone)]
struct Kept {
    view: View,
    /// Samples that are known to be nearest to each pixel.
    k: u32,
    buffers: Buffers,
    positions: BufferRef,
    indices: BufferRef,
    /// Who lends their memory.
    _lent: Option<Arc<Neighbours>>,
    /// See [`super::Frame::movers`].
    movers: Arc<[Option<DMat4>]>,
}

#[derive(Clone)]
struct Buffers {
    /// Records as they were traced, with accumulated light, and their histories.
    fresh: BufferRef,
    records: BufferRef,
    histories: BufferRef,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Source {
    rays: Rays,
    spacing: PackedSpacing,
    offset: [f32; 4],
    x: [f32; 4],
    y: [f32; 4],
    ahead: [f32; 4],
    size: [u32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct AccumulateParameters {
    rays: Rays,
    spacing: PackedSpacing,
    count: u32,
    neighbours: u32,
    normal_power: f32,
    plane_tolerance: f32,
    pixel_width: f32,
    width: u32,
    longest: f32,
    light_changes: u32,
    estimates: f32,
    rests: u32,
}

/// What a frame brings along.
pub(super) struct Fresh<'a> {
    pub view: &'a View,
    /// See [`super::Frame::movers`].
    pub movers: &'a Arc<[Option<DMat4>]>,
    pub samples: &'a BufferRef,
    /// One visibility record for each pixel.
    pub visibility: &'a BufferRef,
    pub rays: Rays,
    pub pixel_width: f32,
    pub normal_power: f32,
    pub plane_tolerance: f32,
    /// See [`super::Frame::light_holds`].
    pub longest: f32,
    /// See [`super::Frame::light_changes`].
    pub light_changes: bool,
    /// See [`super::Frame::estimates`].
    pub estimates: f32,
    /// See [`super::Frame::rests`].
    pub rests: bool,
}

impl Source {
    /// Looks points of `view` up in what was kept; nothing where there is none.
    fn new(view: &View, kept: Option<&Kept>) -> Source {
        let Some(kept) = kept else { return Source::zeroed() };
        let offset: DVec3 = view.world_from_eye.position - kept.view.world_from_eye.position;
        let [x, y, ahead] = projection(&kept.view).map(|row| row.as_vec3().extend(0.0).to_array());
        Source {
            rays: rays(&kept.view, None),
            spacing: PackedSpacing::of(&kept.view),
            offset: offset.as_vec3().extend(1.0).to_array(),
            x,
            y,
            ahead,
            size: [kept.view.width, kept.view.height, kept.k, 0],
        }
    }
}

impl Accumulate {
    /// Builds the shader.
    pub fn new(context: &Context, reuse: Reuse) -> Result<Self> {
        Ok(Accumulate {
            pipeline: ComputePipeline::new(context, &shaders::ACCUMULATE, "accumulate_samples")?,
            reuse,
        })
    }

    /// Records the pass for a frame of a view, whose memory is `history`; returns the records with what was
    /// found before. `other` is the other eye's memory.
    pub fn record(
        &self,
        context: &Context,
        commands: &mut Commands,
        tables: &Tables,
        history: &mut History,
        other: Option<&Other>,
        fresh: &Fresh<'_>,
    ) -> Result<BufferRef> {
        let other = other.filter(|_| self.reuse.eyes).map(|other| &other.0);
        let motions = history.last.as_ref().map_or_else(Vec::new, |last| {
            PackedMotion::all(fresh.view, &last.view, &last.movers, fresh.movers)
        });
        let mut sources = [Source::new(fresh.view, history.last.as_ref()), Source::new(fresh.view, other)];
        sources[0].size[3] = motions.len() as u32;
        let uniform = match history.sources.take() {
            Some(buffer) => buffer,
            None => HostBuffer::new(context, size_of_val(&sources) + MAX_MOVERS * size_of::<PackedMotion>())?,
        };
        uniform.write(0, &sources);
        uniform.write(size_of_val(&sources), &motions);
        let buffers = history.buffers(context, tables.count)?;
        commands.copy(fresh.samples, &buffers.fresh, tables.count * size_of::<SampleRecord>());
        commands.barrier();
        let parameters = AccumulateParameters {
            rays: fresh.rays,
            spacing: PackedSpacing::of(fresh.view),
            count: tables.count as u32,
            neighbours: tables.nearest().map_or(0, |_| tables.neighbours.min(CHANGE_NEIGHBOURS)),
            normal_power: fresh.normal_power,
            plane_tolerance: fresh.plane_tolerance,
            pixel_width: fresh.pixel_width,
            width: tables.width,
            longest: fresh.longest.min(self.reuse.frames as f32),
            light_changes: fresh.light_changes.into(),
            estimates: fresh.estimates,
            rests: fresh.rests.into(),
        };
        history.rested = match history.is_within(fresh.view, RESTING) && !fresh.light_changes {
            true => history.rested.saturating_add(1),
            false => 0,
        };
        let now = Kept {
            view: *fresh.view,
            k: tables.k,
            buffers,
            positions: tables.positions().clone(),
            indices: tables.bands()[0].indices.clone(),
            _lent: tables.bands()[0].lent.clone(),
            movers: fresh.movers.clone(),
        };
        let (last, lent) = (history.last.as_ref().unwrap_or(&now), other.unwrap_or(&now));
        let sources = BufferRef::from(&uniform);
        let bound = [
            &now.buffers.fresh,
            &now.positions,
            tables.nearest().unwrap_or(&now.positions),
            fresh.visibility,
            &now.buffers.records,
            &now.buffers.histories,
            &sources,
            &last.buffers.records,
            &last.buffers.histories,
            &last.positions,
            &last.indices,
            &lent.buffers.fresh,
            &lent.positions,
            &lent.indices,
        ];
        let groups = [parameters.count.div_ceil(64), 1, 1];
        commands.dispatch(&self.pipeline, &bound.map(Some), bytemuck::bytes_of(&parameters), groups)?;
        let records = now.buffers.records.clone();
        history.spare = history.last.replace(now).map(|kept| kept.buffers);
        history.sources = Some(uniform);
        Ok(records)
    }
}

/// What one eye's newest frame lends to the other.
pub(super) struct Other(Kept);
impl History {
    /// Whether the next frame finds one before it.
    pub fn is_there(&self) -> bool {
        self.last.is_some()
    }

    /// Whether the next frame of a view finds one before it, seen from nearly the same place.
    pub fn is_near(&self, view: &View) -> bool {
        self.is_within(view, NEAR)
    }

    /// Whether so many frames have rested before the next one of a view, and it does: with one pattern, seen from the same
    /// place, in light that stays.
    pub fn rests(&self, view: &View, frames: u32) -> bool {
        self.rested >= frames && self.is_within(view, RESTING)
    }

    /// The next frame has another pattern.
    pub fn stir(&mut self) {
        self.rested = 0;
    }

    fn is_within(&self, view: &View, (metres, radians): (f64, f64)) -> bool {
        self.last.as_ref().is_some_and(|kept| {
            let (now, then) = (view.world_from_eye, kept.view.world_from_eye);
            now.position.distance(then.position) < metres
                && now.rotation.angle_between(then.rotation) < radians
        })
    }

    /// The next frame finds nothing.
    pub fn forget(&mut self) {
        self.rested = 0;
        if let Some(kept) = self.last.take() {
            self.spare = Some(kept.buffers);
        }
    }

    /// What the other eye may look up.
    pub fn lend(&self) -> Option<Other> {
        self.last.clone().map(Other)
    }

    /// Memory for a frame of so many samples that nothing reads from.
    fn buffers(&mut self, context: &Context, count: usize) -> Result<Buffers> {
        let device = |bytes| DeviceBuffer::new(context, bytes).map(|buffer| BufferRef::from(&buffer));
        match self.spare.take().filter(|spare| spare.histories.size() >= count * HISTORY_BYTES) {
            Some(spare) => Ok(spare),
            None => Ok(Buffers {
                fresh: device(count * size_of::<SampleRecord>())?,
                records: device(count * size_of::<SampleRecord>())?,
                histories: device(count * HISTORY_BYTES)?,
            }),
        }
    }
}

#[cfg(test)]
mod tests;
