//! A window for spectators: what a wearer sees, for those who stand beside.
//!
//! It belongs to whoever makes the frames and is looked after between them. Nothing here waits, for the display or the
//! device: a picture that cannot be shown yet is left out.

use std::sync::Arc;
use std::time::Duration;

use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::WindowEvent;
use winit::event_loop::{ActiveEventLoop, EventLoop};
use winit::platform::pump_events::EventLoopExtPumpEvents;
use winit::window::{Window, WindowId};

use super::{LensWarp, Panel, PanelPass};
use crate::error::{Error, Result};
use crate::gpu::vulkan::{Context, ContextOptions, Presenting, Shown, Swapchain, Target};

/// Pixels that the window has at first, at most: pictures for headsets are larger than many screens.
const FIRST: (u32, u32) = (1024, 768);

/// A window that mirrors pictures until the user closes it.
pub struct Mirror {
    // Before the desktop's connection, which it is made with.
    glass: Glass,
    event_loop: EventLoop<()>,
    options: ContextOptions,
}

/// What the window is drawn with, on one device.
struct Opened {
    swapchain: Swapchain,
    pass: PanelPass,
}

/// The window, as far as there is one.
struct Glass {
    window: Option<Arc<Window>>,
    /// Its size at first, once it is known.
    wanted: Option<(u32, u32)>,
    opened: Option<Opened>,
    /// The window has another size.
    resized: bool,
    closed: bool,
    /// Why no window can be opened.
    failed: Option<Error>,
}

impl Mirror {
    /// Connects to the desktop; there is no window yet.
    ///
    /// # Errors
    /// Where there is no desktop, or Vulkan knows no windows of it.
    pub fn connect() -> Result<Self> {
        let panel = Panel::connect("leave --mirror out")?;
        let options = panel.vulkan_options()?;
        let glass =
            Glass { window: None, wanted: None, opened: None, resized: false, closed: false, failed: None };
        Ok(Mirror { glass, event_loop: panel.into_event_loop(), options })
    }

    /// What the Vulkan device has to offer whose pictures are mirrored.
    pub fn vulkan_options(&self) -> &ContextOptions {
        &self.options
    }

    /// Whether the user has closed it, or it could not be opened.
    pub fn is_closed(&self) -> bool {
        self.glass.closed
    }

    /// Whether a picture is wanted now: the last one is on its way to the screen.
    pub fn wants(&self) -> bool {
        !self.glass.closed && !self.glass.opened.as_ref().is_some_and(|opened| opened.swapchain.is_busy())
    }

    /// Lets go of a device that is about to end; the window stays.
    pub fn release(&mut self) {
        self.glass.opened = None;
    }

    /// Handles what the desktop says, and shows a picture of the device, of format R8G8B8A8 and encoded as sRGB, where
    /// there is a new one and the window is ready for it.
    ///
    /// # Errors
    /// Where the window cannot be opened or is lost: then there is no mirror any more.
    pub fn look(&mut self, context: &Context, picture: Option<&Target>) -> Result<()> {
        if let Some(picture) = picture {
            self.glass.wanted.get_or_insert(first_size((picture.width(), picture.height())));
        }
        // Once the window is closed, too: the desktop is told so here.
        self.event_loop.pump_app_events(Some(Duration::ZERO), &mut self.glass);
        let shown = self.glass.failed.take().map_or_else(|| self.glass.show(context, picture), Err);
        if shown.is_err() {
            self.glass.close();
        }
        shown
    }
}

/// Pixels of the window at first.
fn first_size((width, height): (u32, u32)) -> (u32, u32) {
    let scale =
        f64::min(1.0, (f64::from(FIRST.0) / f64::from(width)).min(f64::from(FIRST.1) / f64::from(height)));
    let side = |pixels: u32| ((f64::from(pixels) * scale).round() as u32).max(1);
    (side(width), side(height))
}

impl Glass {
    fn close(&mut self) {
        (self.opened, self.window, self.closed) = (None, None, true);
    }

    fn show(&mut self, context: &Context, picture: Option<&Target>) -> Result<()> {
        let Some(window) = self.window.clone() else { return Ok(()) };
        let size = window.inner_size();
        let Opened { swapchain, pass } = match &mut self.opened {
            Some(opened) => opened,
            none => {
                let swapchain = Swapchain::new(context, window, size.into(), Presenting::Newest)?;
                let pass = PanelPass::new(context, swapchain.format())?;
                none.insert(Opened { swapchain, pass })
            }
        };
        if std::mem::take(&mut self.resized) {
            swapchain.resize(size.width, size.height)?;
        }
        let shown = match picture {
            // What is drawn already is brought on its way.
            _ if swapchain.is_busy() => swapchain.show_without_waiting(|_, _| Ok(()))?,
            None => return Ok(()),
            Some(picture) => {
                let warp = LensWarp::fitted([picture.width(), picture.height()], swapchain.size());
                swapchain.show_without_waiting(|commands, target| {
                    pass.record(commands, picture, &[warp], target)
                })?
            }
        };
        self.resized = shown == Shown::NeedsResize;
        Ok(())
    }
}

impl ApplicationHandler for Glass {
    fn resumed(&mut self, _: &ActiveEventLoop) {}

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        let Some((width, height)) = self.wanted.filter(|_| self.window.is_none() && !self.closed) else {
            return;
        };
        let attributes = Window::default_attributes()
            .with_title("foveate: what the left eye sees")
            .with_inner_size(PhysicalSize::new(width, height));
        match event_loop.create_window(attributes) {
            Ok(window) => self.window = Some(Arc::new(window)),
            Err(error) => {
                let problem = format!(
                    "no window can be opened ({error}); check the desktop session, or leave --mirror out"
                );
                self.failed = Some(Error::Device { device: "display".to_string(), problem });
            }
        }
    }

    fn window_event(&mut self, _: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => self.close(),
            WindowEvent::Resized(_) => self.resized = true,
            _ => {}
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_are_as_large_as_pictures_or_as_fits() {
        assert_eq!(first_size((320, 240)), (320, 240));
        assert_eq!(first_size((2048, 768)), (1024, 384));
        assert_eq!(first_size((1000, 7680)), (100, 768));
        assert_eq!(first_size((1, 1_000_000)), (1, 768));
    }
}
