//! Recording, submitting and timing.
#![allow(unsafe_code)]

mod bindings;
mod pictures;
mod rays;

use std::any::Any;
use std::sync::Arc;
use std::time::Instant;

use ash::vk;

use self::bindings::Bindings;
use super::acceleration::TopLevel;
use super::context::Context;
use super::image::Target;
use super::memory::BufferRef;
use super::pipeline::{ComputePipeline, PassPipeline, Pipeline};
use crate::error::Result;
use crate::waiting::Limits;

/// Stages that one submission can time.
const TIMESTAMPS: u32 = 16;

/// A rectangle of pixels.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rect {
    /// Pixels from the left edge.
    pub x: u32,
    /// Pixels from the upper edge.
    pub y: u32,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
}

impl Rect {
    fn to_vk(self) -> vk::Rect2D {
        vk::Rect2D {
            offset: vk::Offset2D { x: self.x as i32, y: self.y as i32 },
            extent: vk::Extent2D { width: self.width, height: self.height },
        }
    }
}

/// How long a stage of a submission took.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StageTime {
    /// The stage's name.
    pub stage: &'static str,
    /// Milliseconds on the device.
    pub ms: f64,
}

/// Something that commands use.
pub(super) type Held = Arc<dyn Any + Send + Sync>;

/// One command buffer, recorded anew for each submission.
///
/// [`Commands::begin`], record, [`Commands::submit`], [`Commands::wait`]. What is recorded runs in
/// order after [`Commands::barrier`]s only.
pub struct Commands {
    context: Context,
    pool: vk::CommandPool,
    buffer: vk::CommandBuffer,
    bindings: Bindings,
    queries: vk::QueryPool,
    fence: vk::Fence,
    /// Names of the stages timed: stage i lies between queries i and i + 1.
    stages: Vec<&'static str>,
    submitted: Option<Instant>,
    /// The submission was waited for in vain, and the device may still work on it.
    stuck: bool,
    /// What the submission uses.
    held: Vec<Held>,
}

impl Commands {
    /// An empty command buffer.
    ///
    /// # Errors
    /// [`crate::Error::Device`] without memory.
    pub fn new(context: &Context) -> Result<Self> {
        let device = &context.0.device;
        let mut commands = Commands {
            context: context.clone(),
            pool: vk::CommandPool::null(),
            buffer: vk::CommandBuffer::null(),
            bindings: Bindings::new(context)?,
            queries: vk::QueryPool::null(),
            fence: vk::Fence::null(),
            stages: Vec::new(),
            submitted: None,
            stuck: false,
            held: Vec::new(),
        };
        let refused = |code| context.refused("a command buffer", code);
        let pool = vk::CommandPoolCreateInfo::default().queue_family_index(context.0.queue_family);
        let queries = vk::QueryPoolCreateInfo::default()
            .query_type(vk::QueryType::TIMESTAMP)
            .query_count(TIMESTAMPS + 1);
        // SAFETY: the infos are valid; what is made is destroyed by the struct's drop.
        unsafe {
            commands.pool = device.create_command_pool(&pool, None).map_err(refused)?;
            let info = vk::CommandBufferAllocateInfo::default()
                .command_pool(commands.pool)
                .level(vk::CommandBufferLevel::PRIMARY)
                .command_buffer_count(1);
            commands.buffer = device.allocate_command_buffers(&info).map_err(refused)?[0];
            commands.fence = device.create_fence(&vk::FenceCreateInfo::default(), None).map_err(refused)?;
            if context.0.timestamps {
                commands.queries = device.create_query_pool(&queries, None).map_err(refused)?;
            }
        }
        Ok(commands)
    }

    /// Begins anew, after what was submitted before is done.
    ///
    /// # Errors
    /// [`crate::Error::Device`] if the device is lost.
    pub fn begin(&mut self) -> Result<()> {
        self.wait()?;
        self.stages.clear();
        self.bindings.begin()?;
        let device = &self.context.0.device;
        let refused = |code| self.context.refused("recording commands", code);
        let info = vk::CommandBufferBeginInfo::default().flags(vk::CommandBufferUsageFlags::ONE_TIME_SUBMIT);
        // SAFETY: nothing of the pools is in use any more.
        unsafe {
            device.reset_command_pool(self.pool, vk::CommandPoolResetFlags::empty()).map_err(refused)?;
            device.begin_command_buffer(self.buffer, &info).map_err(refused)?;
            if self.context.0.timestamps {
                device.cmd_reset_query_pool(self.buffer, self.queries, 0, TIMESTAMPS + 1);
            }
        }
        self.barrier();
        self.timestamp(0);
        Ok(())
    }

    fn timestamp(&self, query: u32) {
        if self.context.0.timestamps && query <= TIMESTAMPS {
            let stage = vk::PipelineStageFlags::BOTTOM_OF_PIPE;
            // SAFETY: the query lies in the pool and is written once after its reset.
            unsafe {
                self.context.0.device.cmd_write_timestamp(self.buffer, stage, self.queries, query);
            }
        }
    }

    /// Ends a stage that began at the last one's end: its time is in [`Commands::wait`]'s answer.
    pub fn end_stage(&mut self, stage: &'static str) {
        self.barrier();
        if self.stages.len() < TIMESTAMPS as usize {
            self.stages.push(stage);
            self.timestamp(self.stages.len() as u32);
        }
    }

    /// Everything recorded or submitted before, and everything written by the host, is seen by what follows.
    pub fn barrier(&self) {
        let all = vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE;
        let memory = [vk::MemoryBarrier::default().src_access_mask(all).dst_access_mask(all)];
        let stages = vk::PipelineStageFlags::ALL_COMMANDS | vk::PipelineStageFlags::HOST;
        let flags = vk::DependencyFlags::empty();
        // SAFETY: the command buffer is being recorded, outside a render pass.
        unsafe {
            self.context.0.device.cmd_pipeline_barrier(self.buffer, stages, stages, flags, &memory, &[], &[]);
        }
    }

    /// Copies bytes from the start of one buffer to the start of another.
    ///
    /// # Panics
    /// If they do not fit.
    pub fn copy(&mut self, from: &BufferRef, to: &BufferRef, size: usize) {
        assert!(size <= from.size() && size <= to.size(), "{size} bytes do not fit both buffers");
        let region =
            [vk::BufferCopy::default().src_offset(from.offset).dst_offset(to.offset).size(size as u64)];
        // SAFETY: the region lies in both buffers, which are held until the copy is done.
        unsafe {
            self.context.0.device.cmd_copy_buffer(
                self.buffer,
                from.allocation.buffer,
                to.allocation.buffer,
                &region,
            );
        }
        self.hold_buffers(&[from, to]);
    }

    /// Fills a buffer with zeros, in whole words of four bytes.
    pub fn fill_zero(&mut self, buffer: &BufferRef) {
        let size = buffer.size / 4 * 4;
        // SAFETY: the range lies in the buffer, which is held until the commands are done.
        unsafe {
            let handle = buffer.allocation.buffer;
            self.context.0.device.cmd_fill_buffer(self.buffer, handle, buffer.offset, size, 0);
        }
        self.hold_buffers(&[buffer]);
    }

    /// Runs a compute shader on groups of its work-group size. `buffers` go to the bindings from 0 on;
    /// a `None` is a binding that the entry point does not use.
    ///
    /// # Panics
    /// If buffers or push constants are not as many as the shader has.
    pub fn dispatch(
        &mut self,
        pipeline: &ComputePipeline,
        buffers: &[Option<&BufferRef>],
        push: &[u8],
        groups: [u32; 3],
    ) -> Result<()> {
        let point = vk::PipelineBindPoint::COMPUTE;
        self.bind(&pipeline.0, point, buffers, None, push)?;
        // SAFETY: pipeline, bindings and push constants are in place.
        unsafe {
            self.context.0.device.cmd_dispatch(self.buffer, groups[0], groups[1], groups[2]);
        }
        Ok(())
    }

    /// Runs a fragment shader on each pixel of a rectangle of a target.
    ///
    /// # Panics
    /// As [`Commands::dispatch`], or if the rectangle reaches beyond the target.
    pub fn draw(
        &mut self,
        pipeline: &PassPipeline,
        target: &Target,
        rect: Rect,
        buffers: &[Option<&BufferRef>],
        push: &[u8],
    ) -> Result<()> {
        let (right, lower) = (rect.x.checked_add(rect.width), rect.y.checked_add(rect.height));
        let fits = right.is_some_and(|right| right <= target.width())
            && lower.is_some_and(|lower| lower <= target.height());
        assert!(fits && rect.width > 0 && rect.height > 0, "{rect:?} does not lie in the target");
        self.bind(&pipeline.0, vk::PipelineBindPoint::GRAPHICS, buffers, None, push)?;
        let device = &self.context.0.device;
        let info = vk::RenderPassBeginInfo::default()
            .render_pass(pipeline.0.pass)
            .framebuffer(target.0.framebuffer)
            .render_area(rect.to_vk());
        let viewport = [vk::Viewport {
            x: 0.0,
            y: 0.0,
            width: target.width() as f32,
            height: target.height() as f32,
            min_depth: 0.0,
            max_depth: 1.0,
        }];
        // SAFETY: the rectangle lies in the framebuffer, whose pass is compatible with the pipeline's
        // (the same format); all is held until the commands are done.
        unsafe {
            device.cmd_begin_render_pass(self.buffer, &info, vk::SubpassContents::INLINE);
            device.cmd_set_viewport(self.buffer, 0, &viewport);
            device.cmd_set_scissor(self.buffer, 0, &[rect.to_vk()]);
            device.cmd_draw(self.buffer, 3, 1, 0, 0);
            device.cmd_end_render_pass(self.buffer);
        }
        self.held.push(target.0.clone());
        Ok(())
    }

    fn bind(
        &mut self,
        pipeline: &Arc<Pipeline>,
        point: vk::PipelineBindPoint,
        buffers: &[Option<&BufferRef>],
        structure: Option<&TopLevel>,
        push: &[u8],
    ) -> Result<()> {
        let layout = &pipeline.layout;
        assert_eq!(buffers.len(), layout.buffers as usize, "bindings of the shader");
        assert_eq!(push.len(), layout.push as usize, "push constants of the shader");
        let set = self.bindings.set(pipeline, buffers, structure)?;
        let device = &self.context.0.device;
        // SAFETY: buffers and pipeline are held until the commands are done; the push constants are exactly the layout's
        // range.
        unsafe {
            device.cmd_bind_pipeline(self.buffer, point, pipeline.handle);
            device.cmd_bind_descriptor_sets(self.buffer, point, layout.pipeline, 0, &[set], &[]);
            device.cmd_push_constants(self.buffer, layout.pipeline, layout.stages, 0, push);
        }
        let buffers: Vec<_> = buffers.iter().copied().flatten().collect();
        self.hold_buffers(&buffers);
        self.held.push(pipeline.clone());
        if let Some(structure) = structure {
            self.held.push(structure.0.clone());
        }
        Ok(())
    }

    fn hold_buffers(&mut self, buffers: &[&BufferRef]) {
        for buffer in buffers {
            self.held.push(buffer.allocation.clone());
        }
    }

    /// What follows waits until an event is set.
    #[cfg(test)]
    pub(super) fn await_event(&self, event: vk::Event) {
        let (host, all) = (vk::PipelineStageFlags::HOST, vk::PipelineStageFlags::ALL_COMMANDS);
        // SAFETY: the command buffer is being recorded; the event outlives the submission.
        unsafe { self.context.0.device.cmd_wait_events(self.buffer, &[event], host, all, &[], &[], &[]) };
    }

    /// Whether what was submitted is done, without waiting for it.
    ///
    /// # Errors
    /// [`crate::Error::Device`] if the device is lost.
    pub fn is_done(&self) -> Result<bool> {
        if self.submitted.is_none() {
            return Ok(true);
        }
        // SAFETY: the fence belongs to the device.
        unsafe { self.context.0.device.get_fence_status(self.fence) }
            .map_err(|code| self.context.refused("waiting for the device", code))
    }

    /// Submits what was recorded.
    ///
    /// # Errors
    /// [`crate::Error::Device`] if the device is lost.
    pub fn submit(&mut self) -> Result<()> {
        self.barrier();
        let device = &self.context.0.device;
        let refused = |code| self.context.refused("submitting commands", code);
        let buffers = [self.buffer];
        let info = [vk::SubmitInfo::default().command_buffers(&buffers)];
        // SAFETY: the buffer was begun; the fence is not in use; the queue's lock is held.
        unsafe {
            device.end_command_buffer(self.buffer).map_err(refused)?;
            device.reset_fences(&[self.fence]).map_err(refused)?;
            let queue = self.context.queue();
            device.queue_submit(*queue, &info, self.fence).map_err(refused)?;
        }
        self.submitted = Some(Instant::now());
        Ok(())
    }

    /// Waits for the submission, and says how long its stages took. Where the device has no clock, the
    /// first stage is given the time since the submission. Empty if nothing was submitted.
    ///
    /// # Errors
    /// [`crate::Error::Device`] if the device is lost, or does not answer for a minute.
    pub fn wait(&mut self) -> Result<Vec<StageTime>> {
        self.wait_within(Limits::MOMENTS)
    }

    /// As [`Commands::wait`], for what takes drivers longer.
    pub(crate) fn wait_within(&mut self, limits: Limits) -> Result<Vec<StageTime>> {
        let Some(since) = self.submitted else { return Ok(Vec::new()) };
        // SAFETY: the fence was submitted.
        if let Err(error) = unsafe { self.context.await_fence(self.fence, limits) } {
            // SAFETY: the fence belongs to the device. A lost device is done, too.
            self.stuck = unsafe { self.context.0.device.get_fence_status(self.fence) } == Ok(false);
            return Err(error);
        }
        (self.submitted, self.stuck) = (None, false);
        let device = &self.context.0.device;
        self.held.clear();
        if !self.context.0.timestamps {
            let ms = since.elapsed().as_secs_f64() * 1e3;
            return Ok(self.stages.first().map(|&stage| StageTime { stage, ms }).into_iter().collect());
        }
        let mut ticks = vec![0u64; self.stages.len() + 1];
        let flags = vk::QueryResultFlags::TYPE_64 | vk::QueryResultFlags::WAIT;
        // SAFETY: the queries were written by the submission, which is done.
        unsafe { device.get_query_pool_results(self.queries, 0, &mut ticks, flags) }
            .map_err(|code| self.context.refused("reading the device's clock", code))?;
        let ms = f64::from(self.context.0.limits.timestamp_period) * 1e-6;
        let times = ticks.windows(2).map(|pair| pair[1].saturating_sub(pair[0]) as f64 * ms);
        Ok(self.stages.iter().zip(times).map(|(&stage, ms)| StageTime { stage, ms }).collect())
    }
}

impl Drop for Commands {
    fn drop(&mut self) {
        if !self.stuck {
            let _ = self.wait();
        }
        if self.stuck {
            // The device may work on it for ever: nothing that it uses is destroyed, and so neither is the device.
            std::mem::forget((std::mem::take(&mut self.held), self.context.clone()));
            return;
        }
        let device = &self.context.0.device;
        // SAFETY: the submission is done; null handles are ignored.
        unsafe {
            device.destroy_query_pool(self.queries, None);
            device.destroy_fence(self.fence, None);
            self.bindings.destroy();
            device.destroy_command_pool(self.pool, None);
        }
    }
}
