//! Pictures of a window, one after the other.
//!
//! The host waits for an image before it is drawn into and for the drawing before it is presented, so no
//! semaphores are needed; the frame that comes next is not begun before either way. Who may not wait
//! ([`Swapchain::show_without_waiting`]) looks each time how far the picture has come.
#![allow(unsafe_code)]

use std::ffi::{CStr, CString};
use std::sync::Arc;

use ash::vk;
use raw_window_handle::{HasDisplayHandle, HasWindowHandle};

use super::commands::Commands;
use super::context::Context;
use super::image::Target;
use crate::error::{Error, Result};
use crate::waiting::Limits;

/// Formats whose pixels reach the screen as they are written, the usual first.
const FORMATS: [vk::Format; 2] = [vk::Format::B8G8R8A8_UNORM, vk::Format::R8G8B8A8_UNORM];

/// A window that pictures can be shown in.
pub trait Window: HasDisplayHandle + HasWindowHandle + Send + Sync {}

impl<W: HasDisplayHandle + HasWindowHandle + Send + Sync> Window for W {}

/// What became of a picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// It is on its way to the screen.
    Yes,
    /// The window has changed: [`Swapchain::resize`] comes first.
    NeedsResize,
    /// The display takes no picture now, as of a hidden window.
    NotNow,
}

/// How pictures follow each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Presenting {
    /// One after the other, at the display's rate.
    InTurn,
    /// The newest one replaces those that the display has not shown yet, where the device can do that.
    Newest,
}

impl Presenting {
    /// Vulkan's modes, best first; the last is the one that every device has.
    fn modes(self) -> &'static [vk::PresentModeKHR] {
        use vk::PresentModeKHR as Mode;
        match self {
            Presenting::InTurn => &[Mode::FIFO],
            Presenting::Newest => &[Mode::MAILBOX, Mode::IMMEDIATE, Mode::FIFO],
        }
    }
}

/// How far a picture has come that is shown without waiting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Progress {
    Nothing,
    /// An image was acquired, which may be read yet; whether it fits the window.
    Acquired(u32, bool),
    /// It is being drawn.
    Drawn(u32, bool),
}

/// Nanoseconds that the display may take to want a picture.
const PATIENCE: u64 = 200_000_000;

/// The extensions that windows of a display need, for the instance and for the device.
///
/// # Errors
/// [`Error::NoDevice`] where Vulkan knows no windows of such a display.
pub fn window_extensions(display: &impl HasDisplayHandle) -> Result<(Vec<CString>, Vec<CString>)> {
    let unknown = |why: String| Error::NoDevice {
        kind: "Vulkan",
        problem: format!("it cannot show windows here ({why}); use the mock headset: `foveate demo`"),
    };
    let handle = display.display_handle().map_err(|error| unknown(error.to_string()))?;
    let names = ash_window::enumerate_required_extensions(handle.as_raw())
        .map_err(|code| unknown(code.to_string()))?;
    // SAFETY: the names are constants that end with a zero.
    let instance = names.iter().map(|&name| unsafe { CStr::from_ptr(name) }.to_owned()).collect();
    Ok((instance, vec![ash::khr::swapchain::NAME.to_owned()]))
}

/// The window's surface, which outlives its swapchains.
struct Surface {
    context: Context,
    functions: ash::khr::surface::Instance,
    handle: vk::SurfaceKHR,
    // The window is there for as long as its surface.
    _window: Arc<dyn Window>,
}

impl Drop for Surface {
    fn drop(&mut self) {
        // SAFETY: swapchains of the surface are gone, since the struct that holds both drops them first.
        unsafe { self.functions.destroy_surface(self.handle, None) };
    }
}

/// A window's images.
pub struct Swapchain {
    surface: Arc<Surface>,
    functions: ash::khr::swapchain::Device,
    handle: vk::SwapchainKHR,
    images: Vec<Target>,
    format: vk::SurfaceFormatKHR,
    acquired: vk::Fence,
    commands: Commands,
    mode: vk::PresentModeKHR,
    progress: Progress,
}

impl Swapchain {
    /// Images for a window of `width` x `height` pixels. The context was opened with the extensions of
    /// [`window_extensions`].
    ///
    /// # Errors
    /// [`Error::Device`] where the device cannot show pictures in this window.
    pub fn new(
        context: &Context,
        window: Arc<dyn Window>,
        (width, height): (u32, u32),
        presenting: Presenting,
    ) -> Result<Self> {
        let surface = Arc::new(Surface::new(context, window)?);
        let (format, mode) = (surface.format()?, surface.mode(presenting));
        let device = &context.0.device;
        let functions = ash::khr::swapchain::Device::new(&context.0.instance, device);
        let commands = Commands::new(context)?;
        // SAFETY: the device is valid; the fence is destroyed by the struct's drop.
        let acquired = unsafe { device.create_fence(&vk::FenceCreateInfo::default(), None) }
            .map_err(|code| context.refused("a fence", code))?;
        let mut swapchain = Swapchain {
            surface,
            functions,
            handle: vk::SwapchainKHR::null(),
            images: Vec::new(),
            format,
            acquired,
            commands,
            mode,
            progress: Progress::Nothing,
        };
        swapchain.resize(width, height)?;
        Ok(swapchain)
    }

    /// The pixels' format.
    pub fn format(&self) -> vk::Format {
        self.format.format
    }

    /// Pixels across and down of the images; zeros while the window has none.
    pub fn size(&self) -> [u32; 2] {
        self.images.first().map_or([0, 0], |image| [image.width(), image.height()])
    }

    /// Makes images for the window's new size; none for a window without pixels.
    ///
    /// # Errors
    /// [`Error::Device`] where the device refuses.
    pub fn resize(&mut self, width: u32, height: u32) -> Result<()> {
        self.commands.wait()?;
        let context = self.surface.context.clone();
        let refused = |code| context.refused("images for a window", code);
        if let Progress::Acquired(..) = std::mem::replace(&mut self.progress, Progress::Nothing) {
            // SAFETY: the fence was handed over as the image was acquired.
            unsafe {
                context.await_fence(self.acquired, Limits::MOMENTS)?;
                context.0.device.reset_fences(&[self.acquired]).map_err(refused)?;
            }
        }
        let surface = &self.surface;
        // SAFETY: surface and physical device belong to the instance.
        let limits = unsafe {
            surface
                .functions
                .get_physical_device_surface_capabilities(context.0.physical_device, surface.handle)
        }
        .map_err(refused)?;
        let extent = extent_within(&limits, width, height);
        self.images.clear();
        if extent.width == 0 || extent.height == 0 {
            return Ok(());
        }
        let wanted = (limits.min_image_count + 1).max(2);
        let count = if limits.max_image_count == 0 { wanted } else { wanted.min(limits.max_image_count) };
        let alpha = [
            vk::CompositeAlphaFlagsKHR::OPAQUE,
            vk::CompositeAlphaFlagsKHR::INHERIT,
            vk::CompositeAlphaFlagsKHR::PRE_MULTIPLIED,
        ];
        let alpha = alpha.into_iter().find(|&kind| limits.supported_composite_alpha.contains(kind));
        let info = vk::SwapchainCreateInfoKHR::default()
            .surface(surface.handle)
            .min_image_count(count)
            .image_format(self.format.format)
            .image_color_space(self.format.color_space)
            .image_extent(extent)
            .image_array_layers(1)
            .image_usage(vk::ImageUsageFlags::COLOR_ATTACHMENT)
            .image_sharing_mode(vk::SharingMode::EXCLUSIVE)
            .pre_transform(limits.current_transform)
            .composite_alpha(alpha.unwrap_or(vk::CompositeAlphaFlagsKHR::OPAQUE))
            .present_mode(self.mode)
            .clipped(true)
            .old_swapchain(self.handle);
        // SAFETY: the surface is valid, what is asked for lies within its limits, and nothing is being drawn
        // into the old images, whose targets are gone. Presenting may still read them, so the queue is idle
        // before they go.
        unsafe {
            let new = self.functions.create_swapchain(&info, None).map_err(refused)?;
            let old = std::mem::replace(&mut self.handle, new);
            // What a device that does not answer still reads stays.
            context.await_queue()?;
            self.functions.destroy_swapchain(old, None);
        }
        // SAFETY: the swapchain is valid.
        let images = unsafe { self.functions.get_swapchain_images(self.handle) }.map_err(refused)?;
        for image in images {
            // SAFETY: the image is a colour attachment of this format and size; targets and commands go
            // before the swapchain; `show` brings it into the layout before it is drawn into.
            let target = unsafe {
                Target::from_raw(&context, image, self.format.format, extent.width, extent.height, 0)
            }?;
            self.images.push(target);
        }
        Ok(())
    }

    /// Shows what `draw` records into the next image, every pixel of it.
    ///
    /// # Errors
    /// [`Error::Device`] where the device or the window is lost, and what `draw` answers.
    pub fn show(&mut self, draw: impl FnOnce(&mut Commands, &Target) -> Result<()>) -> Result<Shown> {
        if self.images.is_empty() {
            return Ok(Shown::NeedsResize);
        }
        let context = self.surface.context.clone();
        let refused = |code| context.refused("showing a picture in a window", code);
        let (index, good) = match self.acquire(PATIENCE)? {
            Ok(next) => next,
            Err(shown) => return Ok(shown),
        };
        // SAFETY: the fence was handed over as the image was acquired.
        unsafe {
            context.await_fence(self.acquired, Limits::MOMENTS)?;
            context.0.device.reset_fences(&[self.acquired]).map_err(refused)?;
        }
        self.draw(index, draw)?;
        self.commands.wait()?;
        self.present(index, good)
    }

    /// The same in steps that wait for nothing: each call does what can be done by now, and answers
    /// [`Shown::NotNow`] until the picture is on its way. What `draw` records is that of the call in which an image
    /// is there to be drawn into.
    ///
    /// # Errors
    /// As [`Swapchain::show`].
    pub fn show_without_waiting(
        &mut self,
        draw: impl FnOnce(&mut Commands, &Target) -> Result<()>,
    ) -> Result<Shown> {
        if self.images.is_empty() {
            return Ok(Shown::NeedsResize);
        }
        if let Progress::Drawn(index, good) = self.progress {
            if !self.commands.is_done()? {
                return Ok(Shown::NotNow);
            }
            self.progress = Progress::Nothing;
            return self.present(index, good);
        }
        if self.progress == Progress::Nothing {
            match self.acquire(0)? {
                Ok((index, good)) => self.progress = Progress::Acquired(index, good),
                Err(shown) => return Ok(shown),
            }
        }
        if let Progress::Acquired(index, good) = self.progress {
            let context = self.surface.context.clone();
            let refused = |code| context.refused("showing a picture in a window", code);
            // SAFETY: the fence belongs to the device; it is reset once it is signalled.
            unsafe {
                if !context.0.device.get_fence_status(self.acquired).map_err(refused)? {
                    return Ok(Shown::NotNow);
                }
                context.0.device.reset_fences(&[self.acquired]).map_err(refused)?;
            }
            self.progress = Progress::Drawn(index, good);
            self.draw(index, draw)?;
        }
        Ok(Shown::NotNow)
    }

    /// Whether a picture is on its way that was begun by [`Swapchain::show_without_waiting`].
    pub fn is_busy(&self) -> bool {
        matches!(self.progress, Progress::Drawn(..))
    }

    fn draw(&mut self, index: u32, draw: impl FnOnce(&mut Commands, &Target) -> Result<()>) -> Result<()> {
        let target = self.images[index as usize].clone();
        let drawing = vk::ImageLayout::COLOR_ATTACHMENT_OPTIMAL;
        self.commands.begin()?;
        self.commands.transition(target.0.image, vk::ImageLayout::UNDEFINED, drawing);
        draw(&mut self.commands, &target)?;
        self.commands.transition(target.0.image, drawing, vk::ImageLayout::PRESENT_SRC_KHR);
        self.commands.submit()
    }

    /// Presents an image into which drawing is done; `good` where it fits the window.
    fn present(&mut self, index: u32, mut good: bool) -> Result<Shown> {
        let context = &self.surface.context;
        let (swapchains, indices) = ([self.handle], [index]);
        let info = vk::PresentInfoKHR::default().swapchains(&swapchains).image_indices(&indices);
        let queue = context.queue();
        // SAFETY: the image was acquired, and drawing into it is done; the queue's lock is held.
        match unsafe { self.functions.queue_present(*queue, &info) } {
            Ok(suboptimal) => good &= !suboptimal,
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => good = false,
            Err(code) => return Err(context.refused("showing a picture in a window", code)),
        }
        Ok(if good { Shown::Yes } else { Shown::NeedsResize })
    }

    /// The next image's index, whose fence tells when it can be drawn into, and whether it fits the window;
    /// otherwise why there is none. Waits for so many nanoseconds.
    fn acquire(&mut self, patience: u64) -> Result<Result<(u32, bool), Shown>> {
        let context = &self.surface.context;
        // SAFETY: the fence is not in use.
        let next = unsafe {
            self.functions.acquire_next_image(self.handle, patience, vk::Semaphore::null(), self.acquired)
        };
        match next {
            Ok((index, suboptimal)) => Ok(Ok((index, !suboptimal))),
            Err(vk::Result::ERROR_OUT_OF_DATE_KHR) => Ok(Err(Shown::NeedsResize)),
            Err(vk::Result::TIMEOUT | vk::Result::NOT_READY) => Ok(Err(Shown::NotNow)),
            Err(code) => Err(context.refused("the next picture of a window", code)),
        }
    }
}

impl Drop for Swapchain {
    fn drop(&mut self) {
        // What is being drawn holds targets.
        let drawn = self.commands.wait().is_ok();
        let context = &self.surface.context;
        if !drawn || context.await_queue().is_err() {
            // The device may still read the images.
            std::mem::forget((std::mem::take(&mut self.images), self.surface.clone()));
            return;
        }
        self.images.clear();
        // SAFETY: the queue is idle, and targets of the images are gone; null handles are ignored.
        unsafe {
            self.functions.destroy_swapchain(self.handle, None);
            context.0.device.destroy_fence(self.acquired, None);
        }
    }
}

impl Surface {
    fn new(context: &Context, window: Arc<dyn Window>) -> Result<Self> {
        let inner = &context.0;
        let name = || inner.report.name.clone();
        let gone = |why: String| Error::Device {
            device: name(),
            problem: format!("the window cannot be drawn into ({why}); check the display and the driver"),
        };
        let display = window.display_handle().map_err(|error| gone(error.to_string()))?.as_raw();
        let raw = window.window_handle().map_err(|error| gone(error.to_string()))?.as_raw();
        // SAFETY: the instance has the display's extensions, or the call fails; the handles are valid for
        // as long as the window, which the struct keeps.
        let handle = unsafe { ash_window::create_surface(&inner.entry, &inner.instance, display, raw, None) }
            .map_err(|code| gone(code.to_string()))?;
        let functions = ash::khr::surface::Instance::new(&inner.entry, &inner.instance);
        let surface = Surface { context: context.clone(), functions, handle, _window: window };
        // SAFETY: all belong to the instance.
        let shows = unsafe {
            surface.functions.get_physical_device_surface_support(
                inner.physical_device,
                inner.queue_family,
                surface.handle,
            )
        };
        match shows {
            Ok(true) => Ok(surface),
            _ => Err(Error::Device {
                device: name(),
                problem: "it cannot show pictures on this display; choose the device that drives it with \
                          --set devices.vulkan=NAME (`foveate devices` lists them)"
                    .to_string(),
            }),
        }
    }

    /// The best mode for pictures that follow each other so.
    fn mode(&self, presenting: Presenting) -> vk::PresentModeKHR {
        // SAFETY: both belong to the instance.
        let offered = unsafe {
            self.functions
                .get_physical_device_surface_present_modes(self.context.0.physical_device, self.handle)
        };
        let offered = offered.unwrap_or_default();
        let modes = presenting.modes().iter().copied();
        modes.into_iter().find(|mode| offered.contains(mode)).unwrap_or(vk::PresentModeKHR::FIFO)
    }

    /// A format that takes pixels as they are.
    fn format(&self) -> Result<vk::SurfaceFormatKHR> {
        let context = &self.context;
        // SAFETY: both belong to the instance.
        let offered = unsafe {
            self.functions.get_physical_device_surface_formats(context.0.physical_device, self.handle)
        }
        .map_err(|code| context.refused("formats of a window", code))?;
        let plain = |wanted: vk::Format| {
            offered.iter().copied().find(|format| {
                format.format == wanted && format.color_space == vk::ColorSpaceKHR::SRGB_NONLINEAR
            })
        };
        FORMATS.into_iter().find_map(plain).ok_or_else(|| Error::Device {
            device: context.report().name.clone(),
            problem: "it shows no windows with 8 bits a channel; choose another screen or driver".to_string(),
        })
    }
}

/// The size that the surface has, or the one that is asked for as far as it allows.
fn extent_within(limits: &vk::SurfaceCapabilitiesKHR, width: u32, height: u32) -> vk::Extent2D {
    let (least, most) = (limits.min_image_extent, limits.max_image_extent);
    match limits.current_extent {
        vk::Extent2D { width: u32::MAX, .. } => vk::Extent2D {
            width: width.clamp(least.width, most.width.max(least.width)),
            height: height.clamp(least.height, most.height.max(least.height)),
        },
        given => given,
    }
}
