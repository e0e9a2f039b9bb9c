//! How far what a picture shows has moved since the last one, for runtimes that make pictures in between.
//!
//! The vectors are differences of normalised device coordinates, now less last, of the same surface point: what the eye
//! does counts as well as what moves. Both pictures are taken as they are shown, after late corrections. What moves as a
//! whole is where its number says; a skin's triangles follow their leading joints. The twin in `f64` is
//! `src/reference/motion.rs`.

use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DVec3};

use super::motions::PackedMotion;
use super::parameters::Rays;
use super::pixels::visible_rows;
use super::reprojection::projection;
use super::tables::{Band, Tables};
use super::{Frame, Mode, NEAREST_DEPTH, Output, Settings, shaders};
use crate::error::Result;
use crate::gpu::vulkan::{Attachments, BufferRef, Commands, Context, HostBuffer, PassPipeline, Rect, Target};
use crate::layout::MAX_MOVERS;
use crate::math::pose::Pose;
use crate::math::view::View;

/// An image for motion vectors, of any size, over all that an output shows; its depths become the output's.
#[derive(Clone)]
pub struct MotionImage {
    /// Of a floating-point format: the vectors' X, Y and Z, in normalised device coordinates from -1 to 1, and from 0 to
    /// 1 for Z, which falls with the distance as depths do.
    pub target: Target,
    /// Y goes up, as in OpenGL, and not down, as in Vulkan.
    pub y_up: bool,
}

/// The shader.
#[derive(Default)]
pub(super) struct MotionPasses {
    passes: HashMap<Attachments, PassPipeline>,
}

/// What a view's pictures keep for the next one's motion vectors.
#[derive(Default)]
pub(super) struct LastPicture {
    shown: Option<Shown>,
    uniform: Option<HostBuffer>,
}

/// A picture as it was shown.
#[derive(Clone)]
struct Shown {
    view: View,
    movers: Arc<[Option<DMat4>]>,
    /// Of each output the first pixel of the view's picture, and pixels across and down.
    parts: Vec<([u32; 2], [u32; 2])>,
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
struct Projection {
    x: [f32; 4],
    y: [f32; 4],
    ahead: [f32; 4],
    offset: [f32; 4],
}

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct MotionParameters {
    rays: Rays,
    shift: [f32; 2],
    step: [f32; 2],
    width: u32,
    first_row: u32,
    rows: u32,
    nearest_depth: f32,
    now_scale: [f32; 2],
    last_scale: [f32; 2],
    last_shift: [f32; 2],
    motions: u32,
}

impl Projection {
    /// Of a picture for points relative to an eye.
    fn new(picture: &View, eye: DVec3) -> Projection {
        let [x, y, ahead] = projection(picture).map(|row| row.as_vec3().extend(0.0).to_array());
        let offset = (eye - picture.world_from_eye.position).as_vec3().extend(0.0).to_array();
        Projection { x, y, ahead, offset }
    }
}

impl Shown {
    fn of(frame: &Frame<'_>) -> Shown {
        let part = |output: &Output<'_>| (output.source, [output.rect.width, output.rect.height]);
        Shown {
            view: shown_view(frame.view, frame.shown_from),
            movers: frame.movers.clone(),
            parts: frame.outputs.iter().map(part).collect(),
        }
    }
}

fn shown_view(traced: &View, shown_from: Option<Pose>) -> View {
    View { world_from_eye: shown_from.unwrap_or(traced.world_from_eye), ..*traced }
}

impl MotionPasses {
    /// Builds the shader for such targets.
    pub fn require(&mut self, context: &Context, to: Attachments) -> Result<()> {
        if let Entry::Vacant(missing) = self.passes.entry(to) {
            missing.insert(PassPipeline::new(context, &shaders::MOTION, "cover", "motion_vectors", to)?);
        }
        Ok(())
    }

    /// Records the passes for a frame's outputs that have motion vectors, with the view's `warp`. The first picture's are
    /// those of a scene and an eye at rest.
    pub fn record(
        &self,
        context: &Context,
        commands: &mut Commands,
        (tables, settings): (&Tables, &Settings),
        last: &mut LastPicture,
        frame: &Frame<'_>,
        (rays, warp): (Rays, &BufferRef),
    ) -> Result<()> {
        let is_guided = settings.mode != Mode::KNearest;
        if !is_guided || frame.outputs.iter().all(|output| output.motion.is_none()) {
            last.shown = None;
            return Ok(());
        }
        let now = Shown::of(frame);
        let before = last.shown.take().filter(|last| last.parts.len() == now.parts.len());
        let before = before.as_ref().unwrap_or(&now);
        let motions = PackedMotion::all(frame.view, &before.view, &before.movers, &now.movers);
        let eye = frame.view.world_from_eye.position;
        let pictures = [Projection::new(&now.view, eye), Projection::new(&before.view, eye)];
        let uniform = last.uniform(context, &pictures, &motions)?;
        for (index, output) in frame.outputs.iter().enumerate() {
            let Some(image) = output.motion else { continue };
            let parameters = MotionParameters {
                width: tables.width,
                motions: motions.len() as u32,
                ..MotionParameters::new(rays, image, output, before.parts[index])
            };
            let pass = &self.passes[&image.target.attachments()];
            for band in tables.bands() {
                let Some(rect) = rows_of(band, output, &image.target, tables.bands().len()) else { continue };
                let visibility = visible_rows(frame, settings, tables, band)?;
                let parameters =
                    MotionParameters { first_row: band.first_row, rows: band.rows, ..parameters };
                let buffers = [visibility.as_ref(), Some(warp), Some(&uniform)];
                commands.draw(pass, &image.target, rect, &buffers, bytemuck::bytes_of(&parameters))?;
            }
        }
        last.shown = Some(now);
        Ok(())
    }
}

impl LastPicture {
    /// The buffer that the shader reads pictures and motions from.
    fn uniform(
        &mut self,
        context: &Context,
        pictures: &[Projection; 2],
        motions: &[PackedMotion],
    ) -> Result<BufferRef> {
        let bytes = size_of_val(pictures) + MAX_MOVERS * size_of::<PackedMotion>();
        let buffer = match self.uniform.take() {
            Some(buffer) => buffer,
            None => HostBuffer::new(context, bytes)?,
        };
        buffer.write(0, pictures);
        buffer.write(size_of_val(pictures), motions);
        Ok(BufferRef::from(self.uniform.insert(buffer) as &HostBuffer))
    }
}

impl MotionParameters {
    /// Of an output whose image is drawn, and what it showed of the last picture, without what is the view's.
    fn new(rays: Rays, image: &MotionImage, output: &Output<'_>, last: ([u32; 2], [u32; 2])) -> Self {
        let (target, size) = (&image.target, [output.rect.width, output.rect.height]);
        let step = |all: u32, pixels: u32| all as f32 / pixels as f32;
        let first = |source: [u32; 2]| source.map(|first| first as f32);
        let scale = |[width, height]: [u32; 2]| {
            [2.0 / width as f32, if image.y_up { -2.0 } else { 2.0 } / height as f32]
        };
        MotionParameters {
            rays,
            shift: first(output.source),
            step: [step(size[0], target.width()), step(size[1], target.height())],
            width: 0,
            first_row: 0,
            rows: 0,
            nearest_depth: NEAREST_DEPTH,
            now_scale: scale(size),
            last_scale: scale(last.1),
            last_shift: first(last.0),
            motions: 0,
        }
    }
}

/// The rows of an image whose middles lie in a band of the view's, of so many; all in the only one.
fn rows_of(band: &Band, output: &Output<'_>, target: &Target, bands: usize) -> Option<Rect> {
    let (width, height) = (target.width(), target.height());
    if bands == 1 {
        return Some(Rect { x: 0, y: 0, width, height });
    }
    let step = output.rect.height as f32 / height as f32;
    let row = |y: u32| output.source[1] + ((y as f32 + 0.5) * step).floor() as u32;
    let before = |end: u32| (0..height).take_while(|&y| row(y) < end).count() as u32;
    let (first, end) = (before(band.first_row), before(band.first_row + band.rows));
    (first < end).then(|| Rect { x: 0, y: first, width, height: end - first })
}

#[cfg(test)]
mod tests;
