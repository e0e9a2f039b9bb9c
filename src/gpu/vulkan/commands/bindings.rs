//! Sets of bindings, kept from one submission to the next: frames bind the same buffers again and again, and drivers
//! take longer to make a set than to record the commands that use it.
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
/// Submissions that a set is kept for without being used: what is read in one frame and written in the next is bound by
/// every other one.
const KEPT: u32 = 2;

/// The sets of one command buffer.
pub(super) struct Bindings {
    context: Context,
    pool: vk::DescriptorPool,
    sets: Vec<Set>,
    submission: u32,
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
        let flags = vk::DescriptorPoolCreateFlags::FREE_DESCRIPTOR_SET;
        let info = vk::DescriptorPoolCreateInfo::default().flags(flags).max_sets(SETS).pool_sizes(kinds);
        // SAFETY: the info is valid; the pool is destroyed by the struct's drop.
        let pool = unsafe { context.0.device.create_descriptor_pool(&info, None) }
            .map_err(|code| context.refused("a descriptor pool", code))?;
        Ok(Bindings { context: context.clone(), pool, sets: Vec::new(), submission: 0 })
    }

    /// Begins another submission, once the one before is done; gives up sets that the last ones have not used.
    ///
    /// # Errors
    /// [`crate::Error::Device`] if the device is lost.
    pub fn begin(&mut self) -> Result<()> {
        self.submission = self.submission.wrapping_add(1);
        self.give_up(KEPT)
    }

    /// Gives up sets that this submission and so many before it have not used.
    fn give_up(&mut self, kept: u32) -> Result<()> {
        let now = self.submission;
        let old = self.sets.extract_if(.., |set| now.wrapping_sub(set.used) > kept);
        let old: Vec<vk::DescriptorSet> = old.map(|set| set.handle).collect();
        if old.is_empty() {
            return Ok(());
        }
        // SAFETY: submissions that have used them are done.
        unsafe { self.context.0.device.free_descriptor_sets(self.pool, &old) }
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
        let handle = self.allocate(pipeline)?;
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

    /// A new set. Where the pool has no more, those of earlier submissions make room.
    fn allocate(&mut self, pipeline: &Pipeline) -> Result<vk::DescriptorSet> {
        let bindings: usize = self.sets.iter().map(|set| set.buffers.len()).sum();
        let wanted = bindings + pipeline.layout.buffers as usize;
        if wanted > BINDINGS as usize || self.sets.len() >= SETS as usize {
            self.give_up(0)?;
        }
        let layouts = [pipeline.layout.set];
        let info = vk::DescriptorSetAllocateInfo::default().descriptor_pool(self.pool).set_layouts(&layouts);
        // SAFETY: pool and layout belong to the device and live.
        unsafe { self.context.0.device.allocate_descriptor_sets(&info) }
            .map(|sets| sets[0])
            .map_err(|code| self.context.refused("binding buffers", code))
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
        // SAFETY: the set is new, and what is written lives.
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
mod tests {
    use super::*;
    use crate::gpu::vulkan::{Commands, ComputePipeline, HostBuffer, Shader, testing};

    const SHADER: Shader = Shader {
        name: "filter.wgsl",
        words: include_bytes!(concat!(env!("OUT_DIR"), "/filter.spv")),
        buffers: 5,
        push: PUSH as u32,
    };
    const PUSH: usize = 112;
    /// Where its push constants tell how many samples there are.
    const COUNT: usize = 80;

    /// A sample whose three words of radiance are this.
    fn sample(context: &Context, radiance: f32) -> HostBuffer {
        let buffer = HostBuffer::new(context, 48).unwrap();
        buffer.write(0, &[radiance; 12]);
        buffer
    }

    /// What the shader makes of it: twice in one submission, to the same place.
    fn run(
        commands: &mut Commands,
        pipeline: &ComputePipeline,
        sample: &HostBuffer,
        rest: [&HostBuffer; 2],
    ) -> [u32; 2] {
        let mut push = [0u8; PUSH];
        push[COUNT] = 1;
        let [from, to, dropped] = [sample.into(), rest[0].into(), rest[1].into()];
        let buffers: [Option<&BufferRef>; 5] = [Some(&from), Some(&to), Some(&dropped), None, None];
        commands.begin().unwrap();
        for _ in 0..2 {
            commands.dispatch(pipeline, &buffers, &push, [1, 1, 1]).unwrap();
            commands.barrier();
        }
        commands.submit().unwrap();
        commands.wait().unwrap();
        rest[0].read(0, 2).try_into().unwrap()
    }

    /// Sets are used again for the same buffers and for no others, though these may lie where others lay, and go when
    /// nobody asks for them any more.
    #[test]
    fn sets_are_kept_for_what_they_bind() {
        let Some(context) = testing::context() else { return };
        let pipeline = ComputePipeline::new(&context, &SHADER, "take_radiance").unwrap();
        let mut commands = Commands::new(&context).unwrap();
        let (to, dropped) = (sample(&context, 0.0), sample(&context, 0.0));
        let rest = [&to, &dropped];
        let mut samples = [1.0, 2.0].map(|radiance| sample(&context, radiance));
        let first: Vec<_> =
            samples.iter().map(|sample| run(&mut commands, &pipeline, sample, rest)).collect();
        assert_ne!(first[0], first[1]);
        let handles: Vec<_> = commands.bindings.sets.iter().map(|set| set.handle).collect();
        assert_eq!(handles.len(), 2, "one for each");
        for turn in 0..6 {
            assert_eq!(run(&mut commands, &pipeline, &samples[turn % 2], rest), first[turn % 2]);
        }
        assert!(commands.bindings.sets.iter().map(|set| set.handle).eq(handles), "the same ones");
        for radiance in [3.0, 4.0, 5.0] {
            samples[0] = sample(&context, radiance);
            let fresh = run(&mut commands, &pipeline, &samples[0], rest);
            assert!(!first.contains(&fresh), "{radiance}: {fresh:?}");
        }
        for _ in 0..=KEPT {
            run(&mut commands, &pipeline, &samples[0], rest);
        }
        assert_eq!(commands.bindings.sets.len(), 1, "others were not asked for any more");
        drop(commands);
        testing::assert_valid(&context);
    }

    /// A pool that is full of sets of earlier submissions has room again.
    #[test]
    fn sets_make_room_for_others() {
        let Some(context) = testing::context() else { return };
        let pipeline = ComputePipeline::new(&context, &SHADER, "take_radiance").unwrap();
        let mut bindings = Bindings::new(&context).unwrap();
        let buffer = HostBuffer::new(&context, 1 << 20).unwrap();
        let all = BufferRef::from(&buffer);
        let parts: Vec<BufferRef> =
            (0..BINDINGS as usize / 5).map(|part| all.part(part * 1024, 48)).collect();
        for _ in 0..2 {
            bindings.begin().unwrap();
            for part in &parts {
                bindings.set(&pipeline.0, &[Some(part), None, None, None, None], None).unwrap();
            }
            assert_eq!(bindings.sets.len(), parts.len());
        }
        bindings.begin().unwrap();
        bindings.set(&pipeline.0, &[None, Some(&parts[0]), None, None, None], None).unwrap();
        assert_eq!(bindings.sets.len(), 1, "the pool had no room for one more");
        // SAFETY: nothing was submitted.
        unsafe { bindings.destroy() };
        testing::assert_valid(&context);
    }
}
