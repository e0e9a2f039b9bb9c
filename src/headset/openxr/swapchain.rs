//! The runtime's images that views are drawn into.
#![allow(unsafe_code)]

use ash::vk::{self, Handle};
use openxr as xr;

use super::fault::{Called, Fault, Outcome};
use crate::error::Error;
use crate::gpu::vulkan::{Context, Target};

/// Formats to draw into, best first. Runtimes read all of them as linear light: SRGB formats decode by
/// themselves, so that eight bits are spent where the eye sees them; half floats cost twice the memory
/// traffic; eight linear bits show bands in the dark.
const FORMATS: [vk::Format; 6] = [
    vk::Format::R8G8B8A8_SRGB,
    vk::Format::B8G8R8A8_SRGB,
    vk::Format::R16G16B16A16_SFLOAT,
    vk::Format::R16G16B16A16_UNORM,
    vk::Format::R8G8B8A8_UNORM,
    vk::Format::B8G8R8A8_UNORM,
];

/// The images of one view.
pub struct ViewImages {
    // Declared before the chain: views of its images go first.
    targets: Vec<Target>,
    chain: xr::Swapchain<xr::Vulkan>,
    width: u32,
    height: u32,
    acquired: Option<usize>,
}

/// The best format that the runtime offers.
pub fn choose_format(session: &xr::Session<xr::Vulkan>) -> Outcome<vk::Format> {
    let offered = session.enumerate_swapchain_formats().called("xrEnumerateSwapchainFormats")?;
    FORMATS.into_iter().find(|format| offered.contains(&(format.as_raw() as u32))).ok_or_else(|| {
        let problem = format!("it offers no format that can be drawn into, only {offered:?}; update it");
        Error::Device { device: "the OpenXR runtime".into(), problem }.into()
    })
}

impl ViewImages {
    /// Makes the images of a view.
    ///
    /// # Errors
    /// Where the runtime or the device refuses.
    pub fn new(
        session: &xr::Session<xr::Vulkan>,
        context: &Context,
        format: vk::Format,
        (width, height): (u32, u32),
    ) -> Outcome<ViewImages> {
        let info = xr::SwapchainCreateInfo {
            create_flags: xr::SwapchainCreateFlags::EMPTY,
            usage_flags: xr::SwapchainUsageFlags::COLOR_ATTACHMENT | xr::SwapchainUsageFlags::SAMPLED,
            format: format.as_raw() as u32,
            sample_count: 1,
            width,
            height,
            face_count: 1,
            array_size: 1,
            mip_count: 1,
        };
        let chain = session.create_swapchain(&info).called("xrCreateSwapchain")?;
        let images = chain.enumerate_images().called("xrEnumerateSwapchainImages")?;
        let target = |image| {
            // SAFETY: the runtime made the image on this device as asked for above; XR_KHR_vulkan_enable2
            // promises the layout COLOR_ATTACHMENT_OPTIMAL while it is acquired, which is when it is
            // drawn into; the chain is destroyed after the targets, which commands have let go of by then.
            unsafe { Target::from_raw(context, vk::Image::from_raw(image), format, width, height, 0) }
        };
        let targets = images.into_iter().map(target).collect::<Result<Vec<_>, _>>()?;
        Ok(ViewImages { targets, chain, width, height, acquired: None })
    }

    /// Gets the next image to draw into, once the compositor has read it.
    ///
    /// # Errors
    /// Where the runtime refuses: then the session is built anew.
    pub fn acquire(&mut self) -> Outcome<&Target> {
        let index =
            self.chain.acquire_image().called("xrAcquireSwapchainImage").map_err(Fault::spoilt)? as usize;
        self.chain
            .wait_image(xr::Duration::INFINITE)
            .called("xrWaitSwapchainImage")
            .map_err(Fault::spoilt)?;
        self.acquired = Some(index);
        self.targets.get(index).ok_or_else(|| Fault::Session(format!("there is no swapchain image {index}")))
    }

    /// Hands the image that was drawn into to the compositor.
    ///
    /// # Errors
    /// As [`ViewImages::acquire`].
    pub fn release(&mut self) -> Outcome<()> {
        match self.acquired.take() {
            Some(_) => self.chain.release_image().called("xrReleaseSwapchainImage").map_err(Fault::spoilt),
            None => Ok(()),
        }
    }

    /// The whole of the image that was released last, for a layer.
    pub fn sub_image(&self) -> xr::SwapchainSubImage<'_, xr::Vulkan> {
        let extent = xr::Extent2Di { width: self.width as i32, height: self.height as i32 };
        let rect = xr::Rect2Di { offset: xr::Offset2Di::default(), extent };
        xr::SwapchainSubImage::new().swapchain(&self.chain).image_array_index(0).image_rect(rect)
    }

    /// Pixels across and down.
    pub fn size(&self) -> (u32, u32) {
        (self.width, self.height)
    }
}
