//! The runtime's images that views are drawn into.
#![allow(unsafe_code)]

use std::collections::HashMap;
use std::marker::PhantomData;

use ash::vk::{self, Handle};
use openxr::{self as xr, sys};

use super::fault::{Called, Fault, Outcome};
use super::{EyeView, convert};
use crate::error::Error;
use crate::gpu::vulkan::{Context, Target};
use crate::reconstruct::NEAREST_DEPTH;

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

/// Formats of depths, best first: reversed depths are at their best in floats.
const DEPTH_FORMATS: [vk::Format; 4] = [
    vk::Format::D32_SFLOAT,
    vk::Format::D32_SFLOAT_S8_UINT,
    vk::Format::D24_UNORM_S8_UINT,
    vk::Format::D16_UNORM,
];

/// What the images of views are like.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Formats {
    /// Of colours.
    pub color: vk::Format,
    /// Of depths, where they are handed over.
    pub depth: Option<vk::Format>,
}

/// The best formats that the runtime offers, for depths only where they are wanted.
pub fn choose_formats(session: &xr::Session<xr::Vulkan>, depth: bool) -> Outcome<Formats> {
    let offered = session.enumerate_swapchain_formats().called("xrEnumerateSwapchainFormats")?;
    let best = |formats: &[vk::Format]| {
        formats.iter().copied().find(|format| offered.contains(&(format.as_raw() as u32)))
    };
    let color = best(&FORMATS).ok_or_else(|| {
        let problem = format!("it offers no format that can be drawn into, only {offered:?}; update it");
        Fault::from(Error::Device { device: "the OpenXR runtime".into(), problem })
    })?;
    Ok(Formats { color, depth: best(&DEPTH_FORMATS).filter(|_| depth) })
}

/// A swapchain and which of its images is drawn into.
struct Chain {
    chain: xr::Swapchain<xr::Vulkan>,
    images: Vec<vk::Image>,
    acquired: Option<usize>,
}

impl Chain {
    fn new(
        session: &xr::Session<xr::Vulkan>,
        format: vk::Format,
        usage: xr::SwapchainUsageFlags,
        (width, height): (u32, u32),
    ) -> Outcome<Chain> {
        let info = xr::SwapchainCreateInfo {
            create_flags: xr::SwapchainCreateFlags::EMPTY,
            usage_flags: usage | xr::SwapchainUsageFlags::SAMPLED,
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
        let images = images.into_iter().map(vk::Image::from_raw).collect();
        Ok(Chain { chain, images, acquired: None })
    }

    fn acquire(&mut self) -> Outcome<(usize, vk::Image)> {
        let index =
            self.chain.acquire_image().called("xrAcquireSwapchainImage").map_err(Fault::spoilt)? as usize;
        self.chain
            .wait_image(xr::Duration::INFINITE)
            .called("xrWaitSwapchainImage")
            .map_err(Fault::spoilt)?;
        self.acquired = Some(index);
        let image = self.images.get(index).copied();
        let image = image.ok_or_else(|| Fault::Session(format!("there is no swapchain image {index}")))?;
        Ok((index, image))
    }

    fn release(&mut self) -> Outcome<()> {
        match self.acquired.take() {
            Some(_) => self.chain.release_image().called("xrReleaseSwapchainImage").map_err(Fault::spoilt),
            None => Ok(()),
        }
    }

    /// The whole of the image that was released last.
    fn sub_image(&self, (width, height): (u32, u32)) -> sys::SwapchainSubImage {
        let extent = xr::Extent2Di { width: width as i32, height: height as i32 };
        let image_rect = xr::Rect2Di { offset: xr::Offset2Di::default(), extent };
        sys::SwapchainSubImage { swapchain: self.chain.as_raw(), image_rect, image_array_index: 0 }
    }
}

/// The images of one view.
pub struct ViewImages {
    // Declared before the chains: views of their images go first.
    targets: HashMap<(usize, Option<usize>), Target>,
    color: Chain,
    depth: Option<Chain>,
    context: Context,
    formats: Formats,
    size: (u32, u32),
}

impl ViewImages {
    /// Makes the images of a view.
    ///
    /// # Errors
    /// Where the runtime or the device refuses.
    pub fn new(
        session: &xr::Session<xr::Vulkan>,
        context: &Context,
        formats: Formats,
        size: (u32, u32),
    ) -> Outcome<ViewImages> {
        use xr::SwapchainUsageFlags as Usage;
        let color = Chain::new(session, formats.color, Usage::COLOR_ATTACHMENT, size)?;
        let depth = |format| Chain::new(session, format, Usage::DEPTH_STENCIL_ATTACHMENT, size);
        let depth = formats.depth.map(depth).transpose()?;
        Ok(ViewImages { targets: HashMap::new(), color, depth, context: context.clone(), formats, size })
    }

    /// Gets the next images to draw into, once the compositor has read them.
    ///
    /// # Errors
    /// Where the runtime refuses: then the session is built anew.
    pub fn acquire(&mut self) -> Outcome<Target> {
        let (index, image) = self.color.acquire()?;
        let depth = self.depth.as_mut().map(Chain::acquire).transpose()?;
        let key = (index, depth.map(|(index, _)| index));
        if let Some(target) = self.targets.get(&key) {
            return Ok(target.clone());
        }
        let color = (image, self.formats.color);
        let depth = depth.map(|(_, image)| image).zip(self.formats.depth);
        let (width, height) = self.size;
        // SAFETY: the runtime made the images on this device as asked for above; XR_KHR_vulkan_enable2
        // promises the layouts COLOR_ATTACHMENT_OPTIMAL and DEPTH_STENCIL_ATTACHMENT_OPTIMAL while they are
        // acquired, which is when they are drawn into; the chains are destroyed after the targets, which
        // commands have let go of by then.
        let target = unsafe {
            match depth {
                Some(depth) => Target::from_raw_with_depth(&self.context, color, depth, self.size)?,
                None => Target::from_raw(&self.context, color.0, color.1, width, height, 0)?,
            }
        };
        Ok(self.targets.entry(key).or_insert(target).clone())
    }

    /// Hands the images that were drawn into to the compositor.
    ///
    /// # Errors
    /// As [`ViewImages::acquire`].
    pub fn release(&mut self) -> Outcome<()> {
        self.color.release()?;
        self.depth.as_mut().map_or(Ok(()), Chain::release)
    }

    /// What a layer tells of the depths of the images that were released last, where there are any.
    pub fn depth_info(&self) -> Option<DepthInfo<'_>> {
        let depth = self.depth.as_ref()?;
        let info = sys::CompositionLayerDepthInfoKHR {
            ty: sys::CompositionLayerDepthInfoKHR::TYPE,
            next: std::ptr::null(),
            sub_image: depth.sub_image(self.size),
            min_depth: 0.0,
            max_depth: 1.0,
            // Reversed: 0 is infinitely far away. Runtimes that reckon with an infinity get no number.
            near_z: f32::MAX,
            far_z: NEAREST_DEPTH,
        };
        Some(DepthInfo(info, PhantomData))
    }

    /// The images that were released last as a layer's view, as an eye saw what was drawn into them.
    pub fn layer_view<'a>(
        &'a self,
        eye: &EyeView,
        depth: Option<&'a DepthInfo<'_>>,
    ) -> xr::CompositionLayerProjectionView<'a, xr::Vulkan> {
        let view = sys::CompositionLayerProjectionView {
            ty: sys::CompositionLayerProjectionView::TYPE,
            next: depth.map_or(std::ptr::null(), |depth| (&raw const depth.0).cast()),
            pose: convert::posef(eye.space_from_eye),
            fov: convert::fovf(&eye.fov),
            sub_image: self.color.sub_image(self.size),
        };
        // SAFETY: the swapchain and what is chained live as long as the view's lifetime says; structures of
        // depths exist only where their extension is enabled.
        unsafe { xr::CompositionLayerProjectionView::from_raw(view) }
    }

    /// Pixels across and down.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }
}

/// What a layer tells of a view's depths; lives as long as the images that it names.
pub struct DepthInfo<'a>(sys::CompositionLayerDepthInfoKHR, PhantomData<&'a ViewImages>);
