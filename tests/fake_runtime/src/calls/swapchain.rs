//! Swapchains.

use ash::vk;
use openxr_sys::{self as xr, Handle};

use crate::abi::{In, Out};
use crate::objects::{Object, Swapchain};
use crate::order::ImageOrder;
use crate::refusal::{Outcome, Refusal, invalid, out_of_order};
use crate::runtime::{On, Runtime, enter};
use crate::vulkan::{Image, Part, Shape};

const DONE: Outcome = Ok(xr::Result::SUCCESS);

/// Images of a swapchain that is not static.
const IMAGES: usize = 3;

pub(crate) fn enumerate_formats(
    session: xr::Session,
    capacity: u32,
    count: Out<u32>,
    formats: Out<i64>,
) -> xr::Result {
    enter("xrEnumerateSwapchainFormats", On::Session(session), |runtime, _| {
        formats.fill(capacity, count, runtime.script.formats.clone())?;
        DONE
    })
}

pub(crate) fn create(
    session: xr::Session,
    info: In<xr::SwapchainCreateInfo>,
    swapchain: Out<xr::Swapchain>,
) -> xr::Result {
    enter("xrCreateSwapchain", On::Session(session), |runtime, note| {
        let info = info.get()?;
        note.set("format", info.format);
        note.set("usage", info.usage_flags.into_raw());
        note.set("size", [info.width, info.height]);
        note.set("array_size", info.array_size);
        let shape = runtime.shape(info)?;
        let once = info.create_flags.contains(xr::SwapchainCreateFlags::STATIC_IMAGE);
        let count = if once { 1 } else { IMAGES };
        let gpu = &runtime.session(session.into_raw())?.gpu;
        let images: Result<Vec<Image>, vk::Result> = (0..count).map(|_| gpu.create_image(&shape)).collect();
        let images = images.map_err(|_| xr::Result::ERROR_OUT_OF_MEMORY)?;
        let object = Swapchain { shape, images, order: ImageOrder::new(count, once) };
        let handle = runtime.objects.insert(session.into_raw(), Object::Swapchain(Box::new(object)));
        note.set("made", "Swapchain");
        note.set("handle", handle);
        swapchain.set(xr::Swapchain::from_raw(handle))?;
        DONE
    })
}

pub(crate) fn destroy(swapchain: xr::Swapchain) -> xr::Result {
    enter("xrDestroySwapchain", On::Swapchain(swapchain), |runtime, note| {
        let handle = swapchain.into_raw();
        note.set("held", runtime.swapchain(handle)?.order.held());
        runtime.destroy(handle, note)
    })
}

pub(crate) fn enumerate_images(
    swapchain: xr::Swapchain,
    capacity: u32,
    count: Out<u32>,
    images: Out<xr::SwapchainImageBaseHeader>,
) -> xr::Result {
    enter("xrEnumerateSwapchainImages", On::Swapchain(swapchain), |runtime, _| {
        let swapchain = runtime.swapchain(swapchain.into_raw())?;
        let handles = swapchain.images.iter().map(|image| vk::Handle::as_raw(image.handle)).collect();
        images.vulkan().fill_typed(capacity, count, handles, |next, image| xr::SwapchainImageVulkanKHR {
            ty: xr::SwapchainImageVulkanKHR::TYPE,
            next,
            image,
        })?;
        DONE
    })
}

pub(crate) fn acquire(
    swapchain: xr::Swapchain,
    info: In<xr::SwapchainImageAcquireInfo>,
    index: Out<u32>,
) -> xr::Result {
    enter("xrAcquireSwapchainImage", On::Swapchain(swapchain), |runtime, note| {
        info.optional()?;
        let handle = swapchain.into_raw();
        let image = runtime.swapchain(handle)?.order.acquire()?;
        note.set("image", image);
        runtime.make_ready(handle, image)?;
        index.set(image as u32)?;
        DONE
    })
}

pub(crate) fn wait(swapchain: xr::Swapchain, info: In<xr::SwapchainImageWaitInfo>) -> xr::Result {
    enter("xrWaitSwapchainImage", On::Swapchain(swapchain), |runtime, note| {
        let timeout = info.get()?.timeout.as_nanos();
        if timeout < 0 {
            return Err(invalid(format!("a timeout of {timeout} ns")));
        }
        note.set("timeout", timeout);
        note.set("image", runtime.swapchain(swapchain.into_raw())?.order.wait()?);
        DONE
    })
}

pub(crate) fn release(swapchain: xr::Swapchain, info: In<xr::SwapchainImageReleaseInfo>) -> xr::Result {
    enter("xrReleaseSwapchainImage", On::Swapchain(swapchain), |runtime, note| {
        info.optional()?;
        note.set("image", runtime.swapchain(swapchain.into_raw())?.order.release()?);
        DONE
    })
}

impl Runtime {
    /// What the images of a swapchain will be like; refused where the runtime has no such thing.
    fn shape(&self, info: &xr::SwapchainCreateInfo) -> Result<Shape, Refusal> {
        if !self.script.formats.contains(&info.format) {
            return Err(xr::Result::ERROR_SWAPCHAIN_FORMAT_UNSUPPORTED.into());
        }
        let sizes = [info.width, info.height, info.array_size, info.mip_count, info.sample_count];
        if sizes.contains(&0) || info.face_count != 1 || info.width.max(info.height) > 4096 {
            return Err(invalid(format!("a swapchain of {sizes:?} and {} faces", info.face_count)));
        }
        if info.sample_count != 1 {
            return Err(xr::Result::ERROR_FEATURE_UNSUPPORTED.into());
        }
        let format = vk::Format::from_raw(info.format as i32);
        let usage = usage(info.usage_flags);
        let srgb = matches!(format, vk::Format::R8G8B8A8_SRGB | vk::Format::B8G8R8A8_SRGB);
        if usage.is_empty() {
            return Err(invalid("a swapchain without a usage"));
        }
        if srgb && usage.contains(vk::ImageUsageFlags::STORAGE) {
            return Err(xr::Result::ERROR_FEATURE_UNSUPPORTED.into());
        }
        Ok(Shape {
            format,
            width: info.width,
            height: info.height,
            layers: info.array_size,
            mips: info.mip_count,
            usage,
            mutable: info.usage_flags.contains(xr::SwapchainUsageFlags::MUTABLE_FORMAT),
        })
    }

    fn make_ready(&mut self, handle: u64, image: usize) -> Result<(), Refusal> {
        let session = self.session_of(handle).unwrap_or_default();
        let (session, swapchain) = self
            .objects
            .session_and_swapchain(session, handle)
            .ok_or_else(|| out_of_order("the session is gone"))?;
        let ready = session.gpu.make_ready(&mut swapchain.images[image], &swapchain.shape);
        ready.map_err(|_| xr::Result::ERROR_RUNTIME_FAILURE.into())
    }

    /// The pixels of a part of the image that was released last.
    pub fn read(&mut self, session: u64, handle: u64, part: Part) -> Result<Vec<u8>, Refusal> {
        let (session, swapchain) = self
            .objects
            .session_and_swapchain(session, handle)
            .ok_or_else(|| out_of_order("the session is gone"))?;
        let image = swapchain.order.released().ok_or_else(|| out_of_order("no image was released"))?;
        let texel = match swapchain.shape.format {
            vk::Format::R16G16B16A16_UNORM | vk::Format::R16G16B16A16_SFLOAT => 8,
            vk::Format::D16_UNORM => 2,
            _ => 4,
        };
        let read = session.gpu.read(&swapchain.images[image], &swapchain.shape, part, texel);
        read.map_err(|_| xr::Result::ERROR_RUNTIME_FAILURE.into())
    }
}

/// Vulkan's words for a swapchain's usage.
fn usage(flags: xr::SwapchainUsageFlags) -> vk::ImageUsageFlags {
    use xr::SwapchainUsageFlags as Xr;
    let pairs = [
        (Xr::COLOR_ATTACHMENT, vk::ImageUsageFlags::COLOR_ATTACHMENT),
        (Xr::DEPTH_STENCIL_ATTACHMENT, vk::ImageUsageFlags::DEPTH_STENCIL_ATTACHMENT),
        (Xr::UNORDERED_ACCESS, vk::ImageUsageFlags::STORAGE),
        (Xr::TRANSFER_SRC, vk::ImageUsageFlags::TRANSFER_SRC),
        (Xr::TRANSFER_DST, vk::ImageUsageFlags::TRANSFER_DST),
        (Xr::SAMPLED, vk::ImageUsageFlags::SAMPLED),
    ];
    let has = pairs.into_iter().filter(|&(xr, _)| flags.contains(xr));
    has.fold(vk::ImageUsageFlags::empty(), |all, (_, one)| all | one)
}
