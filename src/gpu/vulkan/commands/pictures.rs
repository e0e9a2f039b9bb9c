//! Pictures as commands treat them: cleared, copied, brought to another layout.
#![allow(unsafe_code)]

use std::any::Any;
use std::sync::Arc;

use ash::vk;

use super::Commands;
use crate::gpu::vulkan::image::{Target, color_range};
use crate::gpu::vulkan::memory::BufferRef;

impl Commands {
    pub(in crate::gpu::vulkan) fn transition(
        &self,
        image: vk::Image,
        from: vk::ImageLayout,
        to: vk::ImageLayout,
    ) {
        let all = vk::AccessFlags::MEMORY_READ | vk::AccessFlags::MEMORY_WRITE;
        let barrier = [vk::ImageMemoryBarrier::default()
            .src_access_mask(all)
            .dst_access_mask(all)
            .old_layout(from)
            .new_layout(to)
            .src_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .dst_queue_family_index(vk::QUEUE_FAMILY_IGNORED)
            .image(image)
            .subresource_range(color_range(0))];
        let stages = vk::PipelineStageFlags::ALL_COMMANDS;
        let flags = vk::DependencyFlags::empty();
        // SAFETY: the command buffer is being recorded, outside a render pass; the image is in `from`.
        unsafe {
            self.context.0.device.cmd_pipeline_barrier(
                self.buffer,
                stages,
                stages,
                flags,
                &[],
                &[],
                &barrier,
            );
        }
    }

    /// Makes a target of one's own black, whatever it held before.
    pub(in crate::gpu::vulkan) fn clear(&mut self, target: &Target) {
        let image = target.0.image;
        let layout = vk::ImageLayout::TRANSFER_DST_OPTIMAL;
        self.transition(image, vk::ImageLayout::UNDEFINED, layout);
        let black = vk::ClearColorValue { float32: [0.0; 4] };
        // SAFETY: the image is in that layout and is held until the commands are done.
        unsafe {
            self.context.0.device.cmd_clear_color_image(
                self.buffer,
                image,
                layout,
                &black,
                &[color_range(0)],
            );
        }
        self.transition(image, layout, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL);
        self.held.push(target.0.clone());
    }

    /// Copies a target of one's own to a buffer, row after row, without padding.
    ///
    /// # Panics
    /// If the buffer is too small, or pixels of the target's format have no known size.
    pub fn copy_target(&mut self, target: &Target, to: &BufferRef) {
        assert!(target.bytes().is_some_and(|bytes| bytes <= to.size()), "the buffer holds the picture");
        let image = target.0.image;
        let layout = vk::ImageLayout::TRANSFER_SRC_OPTIMAL;
        self.transition(image, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL, layout);
        let region = [vk::BufferImageCopy::default()
            .buffer_offset(to.offset)
            .image_subresource(vk::ImageSubresourceLayers {
                aspect_mask: vk::ImageAspectFlags::COLOR,
                mip_level: 0,
                base_array_layer: 0,
                layer_count: 1,
            })
            .image_extent(vk::Extent3D { width: target.width(), height: target.height(), depth: 1 })];
        // SAFETY: image and buffer are held until the commands are done; the buffer is large enough.
        unsafe {
            let device = &self.context.0.device;
            let handle = to.allocation.buffer;
            device.cmd_copy_image_to_buffer(self.buffer, image, layout, handle, &region);
        }
        self.transition(image, layout, vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL);
        self.held.push(target.0.clone());
        self.hold_buffers(&[to]);
    }

    /// Copies a picture to another of the same size, of whatever format: light stays what it is where an sRGB format
    /// encodes it.
    ///
    /// # Panics
    /// If the sizes differ.
    pub fn blit(&mut self, from: &Target, to: &Target) {
        assert_eq!((from.width(), from.height()), (to.width(), to.height()), "pictures of one size");
        let (source, sink) = (vk::ImageLayout::TRANSFER_SRC_OPTIMAL, vk::ImageLayout::TRANSFER_DST_OPTIMAL);
        let resting = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
        self.transition(from.0.image, resting, source);
        self.transition(to.0.image, resting, sink);
        let layers = vk::ImageSubresourceLayers {
            aspect_mask: vk::ImageAspectFlags::COLOR,
            mip_level: 0,
            base_array_layer: 0,
            layer_count: 1,
        };
        let corner = vk::Offset3D { x: from.width() as i32, y: from.height() as i32, z: 1 };
        let whole = [vk::Offset3D::default(), corner];
        let region = [vk::ImageBlit {
            src_subresource: layers,
            src_offsets: whole,
            dst_subresource: layers,
            dst_offsets: whole,
        }];
        let (from_image, to_image) = (from.0.image, to.0.image);
        let nearest = vk::Filter::NEAREST;
        // SAFETY: both images are in these layouts, as large as the region, and held until the commands are done.
        unsafe {
            let device = &self.context.0.device;
            device.cmd_blit_image(self.buffer, from_image, source, to_image, sink, &region, nearest);
        }
        self.transition(from.0.image, source, resting);
        self.transition(to.0.image, sink, resting);
        self.held.extend([from.0.clone() as Arc<dyn Any + Send + Sync>, to.0.clone()]);
    }
}
