//! Sets of bindings, kept from one submission to the next: frames bind the same buffers again and again, and drivers
//! take longer to make a set than to record the commands that use it.
//!
//! A pool whose sets are given back one by one, and have different layouts, may have holes that no other set fits. So none is
//! given back: those that are not asked for any more are written anew for the next bindings of their pipeline, and a pool that
//! has little room left is emptied between two submissions.
#![allow(unsafe_code)]

use std::sync::{Arc, Weak};

use ash::vk;

use crate::error::Result;
use crate::gpu::vulkan::acceleration::{Structure, TopLevel};
use crate::gpu::vulkan::context::Context;
use crate::gpu::vulkan::memory::{Allocation, BufferRef};
use crate::gpu::vulkan::pipeline::Pipeline;

/// Bindings of buffers in one pool, and sets of them.
const BINDINGS: u32 = 4096;
const SETS: u32 = 1024;
/// A pool of which this share is taken is emptied before the next submission, which may need the rest.
const FULL: (u32, u32) = (SETS / 2, BINDINGS / 2);
/// Submissions that a set is kept for without being used: what is read in one frame and written in the next is bound by
/// every other one.
const KEPT: u32 = 2;

/// The sets of one command buffer.
pub(super) struct Bindings {
    context: Context,
    pool: vk::DescriptorPool,
    sets: Vec<Set>,
    /// Sets that nobody asks for any more.
    spare: Vec<Spare>,
    /// Sets and bindings of buffers that the pool has given, whoever has them.
    taken: (u32, u32),
    submission: u32,
}

/// A set that binds something else before it is used again.
struct Spare {
    handle: vk::DescriptorSet,
    /// Whose layout it has.
    pipeline: Weak<Pipeline>,
}

/// A set of bindings. What it names may be gone: then nobody asks for it again.
struct Set {
    handle: vk::DescriptorSet,
    pipeline: Weak<Pipeline>,
    buffers: Vec<Option<Bound>>,
    structure: Option<Weak<Structure>>,
    /// The last submission that has used it.
    used: u32,
}

/// A range of memory. As long as this lives, no other memory has the same address for its [`Weak`].
struct Bound {
    allocation: Weak<Allocation>,
    offset: u64,
    size: u64,
}

impl Bound {
    fn of(buffer: &BufferRef) -> Self {
        Bound { allocation: Arc::downgrade(&buffer.allocation), offset: buffer.offset, size: buffer.size }
    }

    fn is(&self, buffer: &BufferRef) -> bool {
        std::ptr::eq(self.allocation.as_ptr(), Arc::as_ptr(&buffer.allocation))
            && (self.offset, self.size) == (buffer.offset, buffer.size)
    }
}

impl Set {
    fn binds(
        &self,
        pipeline: &Arc<Pipeline>,
        buffers: &[Option<&BufferRef>],
        structure: Option<&TopLevel>,
    ) -> bool {
        let is_same = |(own, wanted): (&Option<Bound>, &Option<&BufferRef>)| match (own, wanted) {
            (Some(own), Some(wanted)) => own.is(wanted),
            (own, wanted) => own.is_none() && wanted.is_none(),
        };
        std::ptr::eq(self.pipeline.as_ptr(), Arc::as_ptr(pipeline))
            && self.structure.as_ref().map(Weak::as_ptr) == structure.map(|wanted| Arc::as_ptr(&wanted.0))
            && self.buffers.iter().zip(buffers).all(is_same)
    }
}

impl Bindings {
    /// None yet.
    ///
    /// # Errors
    /// [`crate::Error::Device`] without memory.
    pub fn new(context: &Context) -> Result<Self> {
        let size = |kind, count| vk::DescriptorPoolSize::default().ty(kind).descriptor_count(count);
        let sizes = [
            size(vk::DescriptorType::STORAGE_BUFFER, BINDINGS),
            size(vk::DescriptorType::ACCELERATION_STRUCTURE_KHR, SETS),
        ];
        let kinds = if context.traces_rays() { &sizes[..] } else { &sizes[..1] };
        let info = vk::DescriptorPoolCreateInfo::default().max_sets(SETS).pool_sizes(kinds);
        // SAFETY: the info is valid; the pool is destroyed by the struct's drop.
        let pool = unsafe { context.0.device.create_descriptor_pool(&info, None) }
            .map_err(|code| context.refused("a descriptor pool", code))?;
        let (sets, spare) = (Vec::new(), Vec::new());
        Ok(Bindings { context: context.clone(), pool, sets, spare, taken: (0, 0), submission: 0 })
    }

    /// Begins another submission, once the one before is done; gives up sets that the last ones have not used.
    ///
    /// # Errors
    /// [`crate::Error::Device`] if the device is lost.
    pub fn begin(&mut self) -> Result<()> {
        self.submission = self.submission.wrapping_add(1);
        if self.taken.0 >= FULL.0 || self.taken.1 >= FULL.1 {
            return self.empty();
        }
        let now = self.submission;
        let old = self.sets.extract_if(.., |set| now.wrapping_sub(set.used) > KEPT);
        self.spare.extend(old.map(|set| Spare { handle: set.handle, pipeline: set.pipeline }));
        Ok(())
    }

    /// Gives all sets back.
    fn empty(&mut self) -> Result<()> {
        self.sets.clear();
        self.spare.clear();
        self.taken = (0, 0);
        let flags = vk::DescriptorPoolResetFlags::empty();
        // SAFETY: submissions that have used its sets are done, and the sets are forgotten.
        unsafe { self.context.0.device.reset_descriptor_pool(self.pool, flags) }
            .map_err(|code| self.context.refused("giving up bindings", code))
    }

    /// A set for a pipeline that binds these.
    ///
    /// # Errors
    /// [`crate::Error::Device`] without memory.
    pub fn set(
        &mut self,
        pipeline: &Arc<Pipeline>,
        buffers: &[Option<&BufferRef>],
        structure: Option<&TopLevel>,
    ) -> Result<vk::DescriptorSet> {
        let now = self.submission;
        if let Some(set) = self.sets.iter_mut().find(|set| set.binds(pipeline, buffers, structure)) {
            set.used = now;
            return Ok(set.handle);
        }
        let handle = self.take_spare(pipeline).map_or_else(|| self.allocate(pipeline), Ok)?;
        self.write(handle, pipeline, buffers, structure);
        self.sets.push(Set {
            handle,
            pipeline: Arc::downgrade(pipeline),
            buffers: buffers.iter().map(|buffer| buffer.map(Bound::of)).collect(),
            structure: structure.map(|structure| Arc::downgrade(&structure.0)),
            used: now,
        });
        Ok(handle)
    }

    /// A set of the pipeline's layout that binds something else.
    fn take_spare(&mut self, pipeline: &Arc<Pipeline>) -> Option<vk::DescriptorSet> {
        let fits = |spare: &Spare| std::ptr::eq(spare.pipeline.as_ptr(), Arc::as_ptr(pipeline));
        let at = self.spare.iter().position(fits)?;
        Some(self.spare.swap_remove(at).handle)
    }

    /// A new set.
    fn allocate(&mut self, pipeline: &Pipeline) -> Result<vk::DescriptorSet> {
        let layouts = [pipeline.layout.set];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pool).set_layouts(&layouts);
        // SAFETY: pool and layout belong to the device and live.
        let sets = unsafe { self.context.0.device.allocate_descriptor_sets(&info) }
            .map_err(|code| self.context.refused("binding buffers", code))?;
        self.taken = (self.taken.0 + 1, self.taken.1 + pipeline.layout.buffers);
        Ok(sets[0])
    }

    fn write(
        &self,
        set: vk::DescriptorSet,
        pipeline: &Pipeline,
        buffers: &[Option<&BufferRef>],
        structure: Option<&TopLevel>,
    ) {
        let bound = || buffers.iter().enumerate().filter_map(|(binding, buffer)| Some((binding, (*buffer)?)));
        let infos: Vec<_> = bound()
            .map(|(_, buffer)| {
                [vk::DescriptorBufferInfo::default()
                    .buffer(buffer.allocation.buffer)
                    .offset(buffer.offset)
                    .range(buffer.size)]
            })
            .collect();
        let handles: Vec<_> = structure.iter().map(|structure| structure.0.handle).collect();
        let mut handles =
            vk::WriteDescriptorSetAccelerationStructureKHR::default().acceleration_structures(&handles);
        let of_structure = structure.map(|_| {
            vk::WriteDescriptorSet::default()
                .dst_set(set)
                .dst_binding(pipeline.layout.buffers)
                .descriptor_type(vk::DescriptorType::ACCELERATION_STRUCTURE_KHR)
                .descriptor_count(1)
                .push_next(&mut handles)
        });
        let writes: Vec<_> = bound()
            .zip(&infos)
            .map(|((binding, _), info)| {
                vk::WriteDescriptorSet::default()
                    .dst_set(set)
                    .dst_binding(binding as u32)
                    .descriptor_type(vk::DescriptorType::STORAGE_BUFFER)
                    .buffer_info(info)
            })
            .chain(of_structure)
            .collect();
        // SAFETY: no submission uses the set yet, or those that have are done, and what is written lives.
        unsafe { self.context.0.device.update_descriptor_sets(&writes, &[]) };
    }

    /// Destroys the sets.
    ///
    /// # Safety
    /// Submissions that use them are done, and nothing is called after it.
    pub unsafe fn destroy(&mut self) {
        // SAFETY: by this function's contract.
        unsafe { self.context.0.device.destroy_descriptor_pool(self.pool, None) };
    }
}

#[cfg(test)]
mod tests;
