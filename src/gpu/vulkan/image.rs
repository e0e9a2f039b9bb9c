//! Colour targets.
#![allow(unsafe_code)]

use std::sync::Arc;

use ash::vk;

use super::commands::Commands;
use super::context::Context;
use super::memory::{BufferRef, HostBuffer, allocate};
use super::pipeline::{Attachments, render_pass};
use crate::error::{Error, Result};

/// What a target's numbers mean.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Encoding {
    /// Linear radiance, without exposure.
    Radiance,
    /// Tone-mapped, linear: the hardware encodes (SRGB formats), or the presenter does.
    DisplayLinear,
    /// Tone-mapped and sRGB encoded by the shader.
    DisplaySrgb,
}

impl Encoding {
    /// What a format is usually meant for: floats hold radiance, SRGB formats encode by themselves,
    /// everything else is encoded.
    pub fn of(format: vk::Format) -> Self {
        match format {
            vk::Format::R16G16B16A16_SFLOAT | vk::Format::R32G32B32A32_SFLOAT => Encoding::Radiance,
            vk::Format::R8G8B8A8_SRGB | vk::Format::B8G8R8A8_SRGB | vk::Format::A8B8G8R8_SRGB_PACK32 => {
                Encoding::DisplayLinear
            }
            _ => Encoding::DisplaySrgb,
        }
    }
}

/// Bytes of a pixel of the formats that are read back.
fn pixel_bytes(format: vk::Format) -> Option<usize> {
    match format {
        vk::Format::R32G32B32A32_SFLOAT => Some(16),
        vk::Format::R16G16B16A16_SFLOAT => Some(8),
        vk::Format::R8G8B8A8_UNORM
        | vk::Format::R8G8B8A8_SRGB
        | vk::Format::B8G8R8A8_UNORM
        | vk::Format::B8G8R8A8_SRGB => Some(4),
        _ => None,
    }
}

pub(super) struct TargetInner {
    context: Context,
    /// The memory of an image of one's own; null for images of a swapchain.
    memory: vk::DeviceMemory,
    pub image: vk::Image,
    view: vk::ImageView,
    depth_view: vk::ImageView,
    pass: vk::RenderPass,
    pub framebuffer: vk::Framebuffer,
    pub attachments: Attachments,
    pub extent: vk::Extent2D,
}

impl Drop for TargetInner {
    fn drop(&mut self) {
        let device = &self.context.0.device;
        // SAFETY: commands hold their targets until they are done; null handles are ignored, and an
        // image without memory here belongs to its swapchain.
        unsafe {
            device.destroy_framebuffer(self.framebuffer, None);
            device.destroy_render_pass(self.pass, None);
            device.destroy_image_view(self.view, None);
            device.destroy_image_view(self.depth_view, None);
            if self.memory != vk::DeviceMemory::null() {
                device.destroy_image(self.image, None);
                device.free_memory(self.memory, None);
            }
        }
    }
}

/// One layer of an image that pictures are drawn into, in the layout COLOR_ATTACHMENT_OPTIMAL, and, where
/// there is one, of an image for their depths. Clones are the same target.
#[derive(Clone)]
pub struct Target(pub(super) Arc<TargetInner>);

impl Target {
    /// A layer of an image made elsewhere, such as a swapchain's.
    ///
    /// # Safety
    /// The image was made on the context's device as a colour attachment with this format, size and
    /// layer; it outlives the target and all commands that draw into it, and it is in the layout
    /// COLOR_ATTACHMENT_OPTIMAL whenever they run.
    pub unsafe fn from_raw(
        context: &Context,
        image: vk::Image,
        format: vk::Format,
        width: u32,
        height: u32,
        layer: u32,
    ) -> Result<Self> {
        Self::with_image(context, image, vk::DeviceMemory::null(), format, None, (width, height), layer)
    }

    /// The first layers of two images made elsewhere, each with its format: for colours and for depths.
    ///
    /// # Safety
    /// As [`Target::from_raw`] for both; the second was made as a depth attachment, and is in the layout
    /// DEPTH_STENCIL_ATTACHMENT_OPTIMAL whenever commands draw.
    pub unsafe fn from_raw_with_depth(
        context: &Context,
        (image, format): (vk::Image, vk::Format),
        depth: (vk::Image, vk::Format),
        size: (u32, u32),
    ) -> Result<Self> {
        Self::with_image(context, image, vk::DeviceMemory::null(), format, Some(depth), size, 0)
    }

    fn with_image(
        context: &Context,
        image: vk::Image,
        memory: vk::DeviceMemory,
        format: vk::Format,
        depth: Option<(vk::Image, vk::Format)>,
        (width, height): (u32, u32),
        layer: u32,
    ) -> Result<Self> {
        let device = &context.0.device;
        let mut target = TargetInner {
            context: context.clone(),
            memory,
            image,
            view: vk::ImageView::null(),
            depth_view: vk::ImageView::null(),
            pass: vk::RenderPass::null(),
            framebuffer: vk::Framebuffer::null(),
            attachments: Attachments { color: format, depth: depth.map(|(_, format)| format) },
            extent: vk::Extent2D { width, height },
        };
        let view = |image, format, range| {
            let info = vk::ImageViewCreateInfo::default()
                .image(image)
                .view_type(vk::ImageViewType::TYPE_2D)
                .format(format)
                .subresource_range(range);
            // SAFETY: the image is a valid attachment, by the callers' contract.
            unsafe { device.create_image_view(&info, None) }
                .map_err(|code| context.refused("an image view", code))
        };
        target.pass = render_pass(context, target.attachments)?;
        target.view = view(image, format, color_range(layer))?;
        let mut views = vec![target.view];
        if let Some((image, format)) = depth {
            let range = color_range(layer);
            let range = vk::ImageSubresourceRange { aspect_mask: vk::ImageAspectFlags::DEPTH, ..range };
            target.depth_view = view(image, format, range)?;
            views.push(target.depth_view);
        }
        // SAFETY: the views and the pass fit each other.
        unsafe {
            let info = vk::FramebufferCreateInfo::default()
                .render_pass(target.pass)
                .attachments(&views)
                .width(width)
                .height(height)
                .layers(1);
            target.framebuffer = device
                .create_framebuffer(&info, None)
                .map_err(|code| context.refused("a framebuffer", code))?;
        }
        Ok(Target(Arc::new(target)))
    }

    /// Pixels across.
    pub fn width(&self) -> u32 {
        self.0.extent.width
    }

    /// Pixels down.
    pub fn height(&self) -> u32 {
        self.0.extent.height
    }

    /// Bytes of all pixels, of formats that are read back.
    pub fn bytes(&self) -> Option<usize> {
        Some(pixel_bytes(self.format())? * self.width() as usize * self.height() as usize)
    }

    /// The pixels' format.
    pub fn format(&self) -> vk::Format {
        self.0.attachments.color
    }

    /// The formats of colours and depths.
    pub fn attachments(&self) -> Attachments {
        self.0.attachments
    }
}

pub(super) fn color_range(layer: u32) -> vk::ImageSubresourceRange {
    vk::ImageSubresourceRange {
        aspect_mask: vk::ImageAspectFlags::COLOR,
        base_mip_level: 0,
        level_count: 1,
        base_array_layer: layer,
        layer_count: 1,
    }
}

/// A picture of one's own that can be drawn into and read back.
pub struct Image {
    context: Context,
    target: Target,
    pixel_bytes: usize,
}

impl Image {
    /// A black picture.
    ///
    /// # Errors
    /// [`Error::Setting`] for a size that the device does not offer, [`Error::Device`] for a format
    /// that it cannot draw into or this program cannot read back, or without memory.
    pub fn new(context: &Context, format: vk::Format, width: u32, height: u32) -> Result<Self> {
        let limit = context.image_size_limit();
        if width == 0 || height == 0 || width > limit || height > limit {
            let problem = format!("{width}x{height} pixels cannot be drawn; from 1 to {limit} can");
            return Err(Error::setting("size", problem));
        }
        let bytes = pixel_bytes(format).ok_or_else(|| Error::Device {
            device: context.report().name.clone(),
            problem: format!("pictures of format {format:?} cannot be read back; choose another format"),
        })?;
        let (image, memory) = create_image(context, format, width, height)?;
        let target = Target::with_image(context, image, memory, format, None, (width, height), 0)?;
        let mut commands = Commands::new(context)?;
        commands.begin()?;
        commands.clear(&target);
        commands.submit()?;
        commands.wait()?;
        Ok(Image { context: context.clone(), target, pixel_bytes: bytes })
    }

    /// Where to draw.
    pub fn target(&self) -> &Target {
        &self.target
    }

    /// Bytes of the whole picture, as [`Image::read`] gives it.
    pub fn size(&self) -> usize {
        self.pixel_bytes * self.target.width() as usize * self.target.height() as usize
    }

    /// The picture's bytes, row after row, without padding; waits for what draws into it.
    ///
    /// # Errors
    /// [`Error::Device`] without memory or if the device is lost.
    pub fn read(&self) -> Result<Vec<u8>> {
        let buffer = HostBuffer::new(&self.context, self.size())?;
        let mut commands = Commands::new(&self.context)?;
        commands.begin()?;
        commands.copy_target(&self.target, &BufferRef::from(&buffer));
        commands.submit()?;
        commands.wait()?;
        Ok(buffer.read(0, self.size()))
    }
}

fn create_image(
    context: &Context,
    format: vk::Format,
    width: u32,
    height: u32,
) -> Result<(vk::Image, vk::DeviceMemory)> {
    let device = &context.0.device;
    let info = vk::ImageCreateInfo::default()
        .image_type(vk::ImageType::TYPE_2D)
        .format(format)
        .extent(vk::Extent3D { width, height, depth: 1 })
        .mip_levels(1)
        .array_layers(1)
        .samples(vk::SampleCountFlags::TYPE_1)
        .tiling(vk::ImageTiling::OPTIMAL)
        .usage(
            vk::ImageUsageFlags::COLOR_ATTACHMENT
                | vk::ImageUsageFlags::TRANSFER_SRC
                | vk::ImageUsageFlags::TRANSFER_DST,
        );
    // SAFETY: only the physical device is asked.
    let offered = unsafe {
        context.0.instance.get_physical_device_image_format_properties(
            context.0.physical_device,
            format,
            info.image_type,
            info.tiling,
            info.usage,
            info.flags,
        )
    };
    let _ = offered.map_err(|code| context.refused(&format!("drawing into format {format:?}"), code))?;
    // SAFETY: the device draws into the format, the size was checked, and what is made is destroyed
    // again if a later step fails.
    unsafe {
        let image = device
            .create_image(&info, None)
            .map_err(|code| context.refused(&format!("an image of {width}x{height} pixels"), code))?;
        let needs = device.get_image_memory_requirements(image);
        let wishes = [vk::MemoryPropertyFlags::DEVICE_LOCAL, vk::MemoryPropertyFlags::empty()];
        let bound = allocate(context, needs.size, needs.memory_type_bits, &wishes).and_then(|(memory, _)| {
            device.bind_image_memory(image, memory, 0).map(|()| memory).map_err(|code| {
                device.free_memory(memory, None);
                context.refused("binding memory", code)
            })
        });
        bound.map(|memory| (image, memory)).inspect_err(|_| device.destroy_image(image, None))
    }
}

#[cfg(test)]
mod tests {
    use super::super::testing;
    use super::*;

    #[test]
    fn a_new_picture_is_black_in_every_format() {
        let Some(context) = testing::context() else { return };
        let formats = [
            (vk::Format::R32G32B32A32_SFLOAT, 16),
            (vk::Format::R16G16B16A16_SFLOAT, 8),
            (vk::Format::R8G8B8A8_UNORM, 4),
            (vk::Format::B8G8R8A8_SRGB, 4),
        ];
        for (format, bytes) in formats {
            let image = Image::new(&context, format, 7, 3).unwrap();
            assert_eq!(image.read().unwrap(), vec![0; 21 * bytes], "{format:?}");
        }
        testing::assert_valid(&context);
    }

    #[test]
    fn pictures_that_cannot_be_drawn_are_refused() {
        let Some(context) = testing::context() else { return };
        let new = |format, width, height| Image::new(&context, format, width, height).err();
        assert!(matches!(new(vk::Format::R8G8B8A8_UNORM, 0, 4), Some(Error::Setting { .. })));
        assert!(matches!(new(vk::Format::R8G8B8A8_UNORM, 4, u32::MAX), Some(Error::Setting { .. })));
        assert!(matches!(new(vk::Format::D32_SFLOAT, 4, 4), Some(Error::Device { .. })));
        testing::assert_valid(&context);
    }
}
