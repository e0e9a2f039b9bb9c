//! The window itself, and its loop.

use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use winit::application::ApplicationHandler;
use winit::dpi::PhysicalSize;
use winit::event::{DeviceEvent, DeviceId, ElementState, WindowEvent};
use winit::event_loop::{ActiveEventLoop, ControlFlow, EventLoop};
use winit::keyboard::{KeyCode, PhysicalKey};
use winit::monitor::MonitorHandle;
use winit::platform::pump_events::{EventLoopExtPumpEvents, PumpStatus};
use winit::window::{CursorGrabMode, Fullscreen, Window, WindowId};

use super::keys::Keys;
use super::monitor::{CONNECTORS, Monitor, panel_among, rift_connectors};
use super::{LensWarp, PanelPass};
use crate::error::{Error, Result};
use crate::gpu::vulkan::{Context, ContextOptions, Presenting, Shown, Swapchain, Target, window_extensions};
use crate::headset::Toggles;
use crate::headset::mouse_look::Wish;

/// The keys, for the title and for the line that the program greets with.
pub const HELP: &str = "click: the mouse looks around; WASD or arrows, Q and E walk; Shift hurries; R recentres; \
                        L holds the exposure; O shows how pictures are made; F11: full screen; Escape: lets the mouse go, then ends";
/// How long a title stays at least.
const TITLE_STAYS: Duration = Duration::from_millis(500);
/// How long one look waits for what the desktop says.
const LOOK: Duration = Duration::from_millis(50);

/// What a frame is made for.
#[derive(Clone, Copy, Debug)]
pub struct Moment {
    /// When it is begun.
    pub now: Instant,
    /// Seconds since the frame before; 0 for the first.
    pub since_last: f64,
    /// Seconds that the frame before took from here to its presentation; 0 for the first.
    pub latency: f64,
    /// Keys and mouse.
    pub wish: Wish,
    /// The wearer looks ahead now.
    pub recentre: bool,
    /// What is switched.
    pub toggles: Toggles,
    /// Pixels of the window.
    pub window: [u32; 2],
    /// Milliseconds between two pictures of the monitor that the window is on, where the desktop tells.
    pub period_ms: Option<f64>,
}

/// A picture, and the way to bring it to the window.
pub struct PanelFrame {
    /// The picture, of format R8G8B8A8, sRGB encoded.
    pub picture: Target,
    /// How it fills the window; rectangles do not overlap, and cover it all.
    pub warps: Vec<LensWarp>,
    /// What the window's title tells beside the frame rate.
    pub status: String,
}

/// What the window shall be.
#[derive(Clone, Debug)]
pub struct Wanted {
    /// Its title.
    pub title: String,
    /// Pixels across and down.
    pub size: [u32; 2],
    /// Take the whole of the headset's own monitor, if there is one of this size.
    pub on_headset: bool,
    /// End after so many frames.
    pub frames: Option<u64>,
}

/// A connection to the desktop; there can be one in a process.
pub struct Panel {
    event_loop: EventLoop<()>,
}

impl Panel {
    /// Connects to the desktop; `instead` is what can be done without one.
    ///
    /// # Errors
    /// [`Error::Device`] where there is none, or a library for it is missing.
    pub fn connect(instead: &str) -> Result<Self> {
        let refused = |problem: String| Error::Device { device: "display".to_string(), problem };
        require_libraries().map_err(refused)?;
        let event_loop = EventLoop::new().map_err(|_| {
            refused(format!(
                "no desktop answers (WAYLAND_DISPLAY or DISPLAY name it); start this in a desktop session, or \
                 {instead}"
            ))
        })?;
        event_loop.set_control_flow(ControlFlow::Wait);
        Ok(Panel { event_loop })
    }

    /// What a Vulkan device has to offer to show windows here.
    ///
    /// # Errors
    /// Where Vulkan knows no windows of this desktop.
    pub fn vulkan_options(&self) -> Result<ContextOptions> {
        let (instance_extensions, device_extensions) = window_extensions(&self.event_loop)?;
        Ok(ContextOptions { instance_extensions, device_extensions, ..ContextOptions::default() })
    }

    /// What the window's loop is run by.
    pub(super) fn into_event_loop(self) -> EventLoop<()> {
        self.event_loop
    }

    /// Has a window opened at the next look for a moment. The context was opened with [`Panel::vulkan_options`].
    pub fn window(self, context: &Context, wanted: Wanted, stop: Arc<AtomicBool>) -> PanelWindow {
        let shower = Shower {
            context: context.clone(),
            wanted,
            stop,
            opened: None,
            keys: Keys::default(),
            captured: false,
            due: false,
            last: None,
            began: None,
            latency: 0.0,
            shown: 0,
            occluded: false,
            help: false,
            titled: None,
            ended: None,
        };
        PanelWindow { shower, event_loop: self.event_loop }
    }
}

/// What a look at the window has found.
pub enum Look {
    /// A frame is to be made.
    Moment(Moment),
    /// Nothing: look again.
    Pause,
    /// It was closed, or has shown enough.
    End,
}

/// A window that shows frames until the user closes it, the operator wants to leave, or enough were shown. Escape
/// lets the mouse go, and closes the window where it is free. A window that cannot be seen asks for no frames.
pub struct PanelWindow {
    // Before the desktop's connection, which it is made with.
    shower: Shower,
    event_loop: EventLoop<()>,
}

impl PanelWindow {
    /// Handles what the desktop says, and tells what is to be done. Waits for that a moment.
    ///
    /// # Errors
    /// Where the window, the desktop or a device is lost.
    pub fn next_look(&mut self) -> Result<Look> {
        let status = self.event_loop.pump_app_events(Some(LOOK), &mut self.shower);
        if let Some(outcome) = self.shower.ended.take() {
            self.shower.ended = Some(Ok(()));
            return outcome.map(|()| Look::End);
        }
        if let PumpStatus::Exit(code) = status {
            return Err(Error::Device {
                device: "display".to_string(),
                problem: format!("the connection to it was lost (code {code}); start the program again"),
            });
        }
        if !std::mem::take(&mut self.shower.due) || self.shower.is_hidden() {
            return Ok(Look::Pause);
        }
        Ok(self.shower.moment()?.map_or(Look::Pause, Look::Moment))
    }

    /// Shows a frame; whether it could be shown.
    ///
    /// # Errors
    /// Where the window or a device is lost.
    pub fn show(&mut self, frame: &PanelFrame) -> Result<bool> {
        self.shower.show(frame)
    }
}

/// What was opened for the window.
struct Opened {
    window: Arc<Window>,
    swapchain: Swapchain,
    pass: PanelPass,
}

/// What the desktop's events lead to.
struct Shower {
    context: Context,
    wanted: Wanted,
    stop: Arc<AtomicBool>,
    opened: Option<Opened>,
    keys: Keys,
    /// The mouse turns the head.
    captured: bool,
    /// The desktop wants a frame.
    due: bool,
    /// When the last frame was begun, and the current one.
    last: Option<Instant>,
    began: Option<Instant>,
    latency: f64,
    shown: u64,
    /// Other windows hide this one.
    occluded: bool,
    /// The title tells the keys.
    help: bool,
    /// When the title was made last, and how many frames had been shown.
    titled: Option<(Instant, u64)>,
    /// That, and how, it has ended.
    ended: Option<Result<()>>,
}

impl Shower {
    fn open(&mut self, event_loop: &ActiveEventLoop) -> Result<Opened> {
        let [width, height] = self.wanted.size;
        let mut attributes = Window::default_attributes()
            .with_title(self.wanted.title.clone())
            .with_inner_size(PhysicalSize::new(width, height));
        if self.wanted.on_headset
            && let Some(monitor) = headset_monitor(event_loop, self.wanted.size)
        {
            attributes = attributes.with_fullscreen(Some(Fullscreen::Borderless(Some(monitor))));
        }
        let window = event_loop.create_window(attributes).map_err(|error| Error::Device {
            device: "display".to_string(),
            problem: format!("no window can be opened ({error}); check the desktop session"),
        })?;
        let window = Arc::new(window);
        let size = window.inner_size();
        let swapchain = Swapchain::new(&self.context, window.clone(), size.into(), Presenting::InTurn)?;
        let pass = PanelPass::new(&self.context, swapchain.format())?;
        Ok(Opened { window, swapchain, pass })
    }

    /// What the next frame is made for; `None` where the window has no pixels.
    fn moment(&mut self) -> Result<Option<Moment>> {
        let Some(opened) = &mut self.opened else { return Ok(None) };
        let window = opened.swapchain.size();
        if window.contains(&0) {
            let size = opened.window.inner_size();
            return opened.swapchain.resize(size.width, size.height).map(|()| None);
        }
        let now = Instant::now();
        let (wish, recentre) = self.keys.take();
        let toggles = self.keys.take_toggles();
        let since_last = self.last.replace(now).map_or(0.0, |last| (now - last).as_secs_f64());
        self.began = Some(now);
        let (latency, period_ms) = (self.latency, period_ms(&opened.window));
        Ok(Some(Moment { now, since_last, latency, wish, recentre, toggles, window, period_ms }))
    }

    /// Shows one frame; whether it could be shown.
    fn show(&mut self, frame: &PanelFrame) -> Result<bool> {
        let Some(Opened { window, swapchain, pass }) = &mut self.opened else { return Ok(false) };
        window.pre_present_notify();
        let shown =
            swapchain.show(|commands, target| pass.record(commands, &frame.picture, &frame.warps, target))?;
        if shown == Shown::NeedsResize {
            let size = window.inner_size();
            return swapchain.resize(size.width, size.height).map(|()| false);
        }
        if shown == Shown::Yes {
            self.latency = self.began.map_or(0.0, |began| began.elapsed().as_secs_f64());
            self.shown += 1;
            self.entitle(&frame.status);
        }
        Ok(shown == Shown::Yes)
    }

    /// Tells frame rate and status, or the keys, in the title.
    fn entitle(&mut self, status: &str) {
        let (since, before) = *self.titled.get_or_insert((Instant::now(), self.shown));
        let Some(opened) = self.opened.as_ref().filter(|_| since.elapsed() > TITLE_STAYS) else { return };
        let rate = (self.shown - before) as f64 / since.elapsed().as_secs_f64();
        let told = if self.help { HELP.to_string() } else { format!("{rate:.0} fps, {status}; F1: keys") };
        opened.window.set_title(&format!("{}: {told}", self.wanted.title));
        self.titled = Some((Instant::now(), self.shown));
    }

    /// A key goes down that is not about the head; whether it was one.
    fn is_command(&mut self, key: KeyCode, event_loop: &ActiveEventLoop) -> bool {
        match key {
            KeyCode::Escape if self.captured => self.capture(false),
            KeyCode::Escape => self.end(event_loop, Ok(())),
            KeyCode::F1 => self.help = !self.help,
            KeyCode::F11 => {
                if let Some(Opened { window, .. }) = &self.opened {
                    let whole = window.fullscreen().is_none().then_some(Fullscreen::Borderless(None));
                    window.set_fullscreen(whole);
                }
            }
            _ => return false,
        }
        true
    }

    /// Whether nobody can see the window.
    fn is_hidden(&self) -> bool {
        let minimised = |opened: &Opened| opened.window.is_minimized() == Some(true);
        self.occluded || self.opened.as_ref().is_some_and(minimised)
    }

    /// The mouse turns the head from now on, or no more.
    fn capture(&mut self, wanted: bool) {
        let Some(opened) = &self.opened else { return };
        let window = &opened.window;
        self.captured = wanted
            && window
                .set_cursor_grab(CursorGrabMode::Locked)
                .or_else(|_| window.set_cursor_grab(CursorGrabMode::Confined))
                .is_ok();
        if !self.captured {
            // Where the pointer was never held there is nothing to let go.
            let _ = window.set_cursor_grab(CursorGrabMode::None);
        }
        window.set_cursor_visible(!self.captured);
    }

    fn end(&mut self, event_loop: &ActiveEventLoop, outcome: Result<()>) {
        self.ended.get_or_insert(outcome);
        self.opened = None;
        event_loop.exit();
    }

    fn enough(&self) -> bool {
        self.stop.load(Ordering::Relaxed) || self.wanted.frames.is_some_and(|frames| self.shown >= frames)
    }
}

impl ApplicationHandler for Shower {
    fn resumed(&mut self, event_loop: &ActiveEventLoop) {
        if self.opened.is_some() {
            return;
        }
        match self.open(event_loop) {
            Ok(opened) => self.opened = Some(opened),
            Err(error) => self.end(event_loop, Err(error)),
        }
    }

    fn window_event(&mut self, event_loop: &ActiveEventLoop, _: WindowId, event: WindowEvent) {
        match event {
            WindowEvent::CloseRequested => self.end(event_loop, Ok(())),
            WindowEvent::Resized(size) => {
                let resized = self.opened.as_mut().map(|o| o.swapchain.resize(size.width, size.height));
                if let Some(Err(error)) = resized {
                    self.end(event_loop, Err(error));
                }
            }
            WindowEvent::KeyboardInput { event, .. } => {
                let PhysicalKey::Code(key) = event.physical_key else { return };
                let pressed = event.state == ElementState::Pressed;
                if !(pressed && !event.repeat && self.is_command(key, event_loop)) {
                    self.keys.key(key, pressed);
                }
            }
            WindowEvent::MouseInput { state: ElementState::Pressed, .. } => self.capture(true),
            WindowEvent::Focused(false) => {
                self.keys.forget();
                self.capture(false);
            }
            WindowEvent::Occluded(occluded) => self.occluded = occluded,
            WindowEvent::RedrawRequested => self.due = true,
            _ => {}
        }
    }

    fn device_event(&mut self, _: &ActiveEventLoop, _: DeviceId, event: DeviceEvent) {
        if let DeviceEvent::MouseMotion { delta: (right, down) } = event
            && self.captured
        {
            self.keys.mouse(right, down);
        }
    }

    fn about_to_wait(&mut self, event_loop: &ActiveEventLoop) {
        if self.enough() {
            return self.end(event_loop, Ok(()));
        }
        if self.is_hidden() {
            return;
        }
        if let Some(opened) = &self.opened {
            opened.window.request_redraw();
        }
    }
}

/// Milliseconds between two pictures of the monitor that a window is on. Monitors in memory have none.
fn period_ms(window: &Window) -> Option<f64> {
    let millihertz = window.current_monitor()?.refresh_rate_millihertz().filter(|&rate| rate > 0)?;
    Some(1e6 / f64::from(millihertz))
}

/// The monitor that is a headset's panel of that many pixels.
fn headset_monitor(event_loop: &ActiveEventLoop, pixels: [u32; 2]) -> Option<MonitorHandle> {
    let primary = event_loop.primary_monitor();
    let handles: Vec<MonitorHandle> = event_loop.available_monitors().collect();
    let describe = |handle: &MonitorHandle| Monitor {
        name: handle.name().unwrap_or_default(),
        size: [handle.size().width, handle.size().height],
        primary: primary.as_ref() == Some(handle),
    };
    let monitors: Vec<Monitor> = handles.iter().map(describe).collect();
    panel_among(&monitors, pixels, &rift_connectors(Path::new(CONNECTORS))).map(|i| handles[i].clone())
}

/// The desktop's library panics where this one is missing, so it is looked for before.
#[cfg(target_os = "linux")]
fn require_libraries() -> Result<(), String> {
    let x11 = std::env::var_os("WAYLAND_DISPLAY").is_none_or(|name| name.is_empty());
    let there = |library: bool, package: &str| {
        let problem = || format!("a library for keyboards is not installed; install {package}");
        if library { Ok(()) } else { Err(problem()) }
    };
    there(xkbcommon_dl::xkbcommon_option().is_some(), "libxkbcommon0")?;
    there(!x11 || xkbcommon_dl::x11::xkbcommon_x11_option().is_some(), "libxkbcommon-x11-0")
}

#[cfg(not(target_os = "linux"))]
fn require_libraries() -> Result<(), String> {
    Ok(())
}
