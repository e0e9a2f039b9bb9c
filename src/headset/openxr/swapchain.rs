//! The runtime's images that views are drawn into.
#![allow(unsafe_code)]

use std::collections::HashMap;
use std::marker::PhantomData;
use std::time::Duration;

use ash::vk::{self, Handle};
use openxr::{self as xr, sys};

use super::convert;
use super::fault::{Called, Fault, Outcome};
use crate::error::Error;
use crate::gpu::vulkan::{Context, Target};
use crate::headset::EyeView;
use crate::math::pose::Pose;
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
pub(super) const DEPTH_FORMATS: [vk::Format; 4] = [
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
    /// Colours can be copied from, for spectators.
    pub copied: bool,
}

/// The formats that the runtime offers, best first; each with depths, where they are wanted, and without. Where they
/// are to be copied, those that cannot come last.
pub fn formats(session: &xr::Session<xr::Vulkan>, depth: bool, copied: bool) -> Outcome<Vec<Formats>> {
    let offered = session.enumerate_swapchain_formats().called("xrEnumerateSwapchainFormats")?;
    let is_offered = |format: &vk::Format| offered.contains(&(format.as_raw() as u32));
    let depth = DEPTH_FORMATS.into_iter().find(is_offered).filter(|_| depth);
    let colors: Vec<_> = FORMATS.into_iter().filter(is_offered).collect();
    if colors.is_empty() {
        let problem = format!("it offers no format that can be drawn into, only {offered:?}; update it");
        return Err(Error::Device { device: "the OpenXR runtime".into(), problem }.into());
    }
    let each = |color| depth.map(Some).into_iter().chain([None]).map(move |depth| (color, depth));
    let plain: Vec<_> = colors.into_iter().flat_map(each).collect();
    let with = |copied| plain.iter().map(move |&(color, depth)| Formats { color, depth, copied });
    Ok(with(copied).chain(with(false).filter(|_| copied)).collect())
}

/// A swapchain and which of its images is drawn into.
struct Chain {
    chain: xr::Swapchain<xr::Vulkan>,
    images: Vec<vk::Image>,
    /// The image that is held, and whether the compositor has read it.
    acquired: Option<(usize, bool)>,
    instance: xr::Instance,
    /// Nobody submits to its queue where the runtime may.
    context: Context,
}

/// How long an image for a view is waited for in one frame.
const PATIENCE: Duration = Duration::from_millis(500);

impl Chain {
    fn new(
        session: &xr::Session<xr::Vulkan>,
        context: &Context,
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
        let instance = session.instance().clone();
        Ok(Chain { chain, images, acquired: None, instance, context: context.clone() })
    }

    /// The next image to draw into, once the compositor has read it; `None` where that takes too long: then
    /// it is waited for again the next time.
    fn acquire(&mut self, patience: Duration) -> Outcome<Option<(usize, vk::Image)>> {
        let (index, ready) = match self.acquired {
            Some(acquired) => acquired,
            None => {
                let _queue = self.context.queue();
                (self.chain.acquire_image().called("xrAcquireSwapchainImage")? as usize, false)
            }
        };
        self.acquired = Some((index, ready));
        if !ready && !self.wait(patience)? {
            return Ok(None);
        }
        self.acquired = Some((index, true));
        let image = self.images.get(index).copied();
        let image = image.ok_or_else(|| Fault::Session(format!("there is no swapchain image {index}")))?;
        Ok(Some((index, image)))
    }

    /// Whether the image that was acquired becomes ready in that time.
    fn wait(&self, patience: Duration) -> Outcome<bool> {
        let info = sys::SwapchainImageWaitInfo {
            ty: sys::SwapchainImageWaitInfo::TYPE,
            next: std::ptr::null(),
            timeout: xr::Duration::from_nanos(patience.as_nanos() as i64),
        };
        // SAFETY: the swapchain is alive and only used here; the info outlives the call.
        let code = unsafe { (self.instance.fp().wait_swapchain_image)(self.chain.as_raw(), &info) };
        match code {
            sys::Result::TIMEOUT_EXPIRED => Ok(false),
            code if code.into_raw() >= 0 => Ok(true),
            code => Err(Fault::of("xrWaitSwapchainImage", code)),
        }
    }

    /// Hands the image over, if it was drawn into.
    fn release(&mut self) -> Outcome<()> {
        if !self.acquired.is_some_and(|(_, ready)| ready) {
            return Ok(());
        }
        self.acquired = None;
        let info = sys::SwapchainImageReleaseInfo {
            ty: sys::SwapchainImageReleaseInfo::TYPE,
            next: std::ptr::null(),
        };
        let _queue = self.context.queue();
        // SAFETY: as in `wait`.
        let code = unsafe { (self.instance.fp().release_swapchain_image)(self.chain.as_raw(), &info) };
        if code.into_raw() < 0 { Err(Fault::of("xrReleaseSwapchainImage", code)) } else { Ok(()) }
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
        let copied = if formats.copied { Usage::TRANSFER_SRC } else { Usage::EMPTY };
        let color = Chain::new(session, context, formats.color, Usage::COLOR_ATTACHMENT | copied, size)?;
        let depth = |format| Chain::new(session, context, format, Usage::DEPTH_STENCIL_ATTACHMENT, size);
        let depth = formats.depth.map(depth).transpose()?;
        Ok(ViewImages { targets: HashMap::new(), color, depth, context: context.clone(), formats, size })
    }

    /// Gets the next images to draw into, once the compositor has read them; `None` where it takes too long.
    ///
    /// # Errors
    /// Where the runtime refuses: then the session is built anew.
    pub fn acquire(&mut self) -> Outcome<Option<Target>> {
        self.acquire_within(PATIENCE)
    }

    /// The same with another time that may be waited.
    ///
    /// # Errors
    /// As [`ViewImages::acquire`].
    pub fn acquire_within(&mut self, patience: Duration) -> Outcome<Option<Target>> {
        let Some((index, image)) = self.color.acquire(patience)? else { return Ok(None) };
        let depth = match &mut self.depth {
            Some(depth) => match depth.acquire(patience)? {
                Some(depth) => Some(depth),
                None => return Ok(None),
            },
            None => None,
        };
        let key = (index, depth.map(|(index, _)| index));
        if let Some(target) = self.targets.get(&key) {
            return Ok(Some(target.clone()));
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
        Ok(Some(self.targets.entry(key).or_insert(target).clone()))
    }

    /// Where the view is drawn, while its images are held.
    pub fn target(&self) -> Option<&Target> {
        let depth = self.depth.as_ref().map(|depth| depth.acquired);
        let depth = depth.map_or(Some(None), |acquired| acquired.map(|(index, _)| Some(index)))?;
        self.targets.get(&(self.color.acquired?.0, depth))
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

    /// The images that were released last, and those of their depths.
    pub fn sub_images(&self) -> (sys::SwapchainSubImage, Option<sys::SwapchainSubImage>) {
        (self.color.sub_image(self.size), self.depth.as_ref().map(|depth| depth.sub_image(self.size)))
    }

    /// The images that were released last as a layer's view, as an eye saw what was drawn into them, with what is
    /// told beside them.
    pub fn layer_view<'a>(
        &'a self,
        eye: &EyeView,
        beside: Option<Chained<'a>>,
    ) -> xr::CompositionLayerProjectionView<'a, xr::Vulkan> {
        let view = sys::CompositionLayerProjectionView {
            ty: sys::CompositionLayerProjectionView::TYPE,
            next: Chained::next(beside),
            pose: convert::posef(eye.space_from_eye),
            fov: convert::fovf(&eye.fov),
            sub_image: self.color.sub_image(self.size),
        };
        // SAFETY: the swapchain and what is chained live as long as the view's lifetime says; structures that are
        // chained exist only where their extension is enabled.
        unsafe { xr::CompositionLayerProjectionView::from_raw(view) }
    }

    /// The images that were released last as a flat picture of `width` metres at a pose in a space.
    pub fn layer_quad<'a>(
        &'a self,
        space: &'a xr::Space,
        pose: Pose,
        width: f32,
    ) -> xr::CompositionLayerQuad<'a, xr::Vulkan> {
        let (across, down) = self.size;
        let quad = sys::CompositionLayerQuad {
            ty: sys::CompositionLayerQuad::TYPE,
            next: std::ptr::null(),
            layer_flags: xr::CompositionLayerFlags::EMPTY,
            space: space.as_raw(),
            eye_visibility: xr::EyeVisibility::BOTH,
            sub_image: self.color.sub_image(self.size),
            pose: convert::posef(pose),
            size: xr::Extent2Df { width, height: width * down as f32 / across as f32 },
        };
        // SAFETY: swapchain and space live as long as the layer's lifetime says.
        unsafe { xr::CompositionLayerQuad::from_raw(quad) }
    }

    /// Pixels across and down.
    pub fn size(&self) -> (u32, u32) {
        self.size
    }
}

/// What a layer tells of a view's depths; lives as long as the images that it names.
pub struct DepthInfo<'a>(sys::CompositionLayerDepthInfoKHR, PhantomData<&'a ViewImages>);

impl DepthInfo<'_> {
    /// To be chained to a layer's view.
    pub fn chained(&self) -> Chained<'_> {
        Chained((&raw const self.0).cast(), PhantomData)
    }
}

/// A structure that is told beside another one.
#[derive(Clone, Copy)]
pub struct Chained<'a>(pub(super) *const std::ffi::c_void, pub(super) PhantomData<&'a ()>);

impl Chained<'_> {
    /// What the other one's `next` becomes.
    pub fn next(chained: Option<Chained<'_>>) -> *const std::ffi::c_void {
        chained.map_or(std::ptr::null(), |chained| chained.0)
    }
}
