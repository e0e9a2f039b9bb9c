//! A session: states, frames, views, images.

mod events;
mod input;
mod layers;
mod menu;

use std::time::{Duration, Instant};

use glam::DVec3;
use openxr as xr;

pub use self::menu::Controls;
use self::menu::Menu;
use super::actions::Actions;
use super::board::Notices;
use super::clock::{FrameClock, Told};
use super::fault::{Called, Fault, Notes, Outcome};
use super::floor::Floor;
use super::foveated::Followed;
use super::gaze::{self, EyeTracker};
use super::hand_tracking::HandTrackers;
use super::lifecycle::{self, Lifecycle};
use super::motion::MotionVectors;
use super::runtime::Runtime;
use super::setup::{Sizes, Steady, images, sizes};
use super::spectator::Spectator;
use super::swapchain::{Formats, ViewImages, formats};
use super::waiter::Waiter;
use super::{convert, extras, vulkan};
use crate::gpu::vulkan::{Context, Encoding, Rect};
use crate::headset::{Canvas, Deadline, EyeView, Frame, Headset, HiddenMesh, Input, Next};
use crate::math::pose::Pose;

/// How long one look for a frame lasts before events are looked for again.
const PATIENCE: Duration = Duration::from_millis(50);
/// How long a runtime may take to end a session that was asked to exit.
const EXIT_PATIENCE: Duration = Duration::from_secs(10);
/// Frames in a row whose views may stay where they were.
const MOST_STRIKES: u32 = 20;

/// What a session is asked for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Pixels across and down of each view instead of what the runtime recommends.
    pub size: [Option<u32>; 2],
    /// Use an eye tracker where there is one.
    pub gaze: bool,
    /// Pictures a second to ask the headset for; 0 for its own choice.
    pub refresh_hz: f64,
    /// Hand over depths beside pictures where the runtime takes them.
    pub depth: bool,
    /// Hand over motion vectors where the runtime takes them.
    pub motion_vectors: bool,
    /// What controllers do.
    pub controls: Controls,
    /// Spectators want to see what the first view shows.
    pub mirrored: bool,
}

/// A session with the runtime.
pub struct Session {
    // In the order in which they end.
    images: Vec<ViewImages>,
    motion: Option<MotionVectors>,
    notices: Notices,
    menu: Menu,
    /// What spectators see, where they can.
    spectator: Option<Spectator>,
    sizes: Sizes,
    actions: Option<Actions>,
    eyes: Option<EyeTracker>,
    /// Hands that are seen without controllers.
    hands: Option<HandTrackers>,
    /// What the insets follow.
    followed: Option<Followed>,
    space: xr::Space,
    floor: Floor,
    waiter: Waiter,
    /// Its queue is the runtime's too: see [`vulkan::open`].
    context: Context,
    stream: xr::FrameStream<xr::Vulkan>,
    session: xr::Session<xr::Vulkan>,
    instance: xr::Instance,
    views: xr::ViewConfigurationType,
    blend: xr::EnvironmentBlendMode,
    formats: Formats,
    life: Lifecycle,
    clock: FrameClock,
    steady: Steady,
    /// How long frames usually take.
    usual: Duration,
    /// The wearer sees the newest frame.
    visible: bool,
    exit: Option<Instant>,
    ended: bool,
    /// What the runtime wants to be told at the frame's end.
    display_time: xr::Time,
    located: Vec<EyeView>,
    /// The views of the last picture that was handed over.
    shown: Vec<EyeView>,
    /// When that was.
    newest: Option<Instant>,
    /// The compositor keeps the images of this frame.
    starved: bool,
    /// Frames in a row whose views could not be located.
    strikes: u32,
    /// Frames for which the eye tracker is not asked.
    blind: u32,
    state: xr::SessionState,
    notes: Notes,
    hidden: Vec<HiddenMesh>,
    masks: u64,
}

impl Session {
    /// Opens a session that presents from the runtime's device.
    ///
    /// # Errors
    /// Where the runtime or the device refuses.
    pub fn new(runtime: &Runtime, context: &Context, options: &Options) -> Outcome<Session> {
        let (session, waiter, stream) = vulkan::session(&runtime.instance, runtime.system, context)?;
        let steady = Steady::new(&runtime.instance);
        let waiter = Waiter::new(waiter, move || steady.read());
        let space = session
            .create_reference_space(xr::ReferenceSpaceType::LOCAL, xr::Posef::IDENTITY)
            .called("xrCreateReferenceSpace")?;
        let floor = Floor::new(&session);
        let mut notes = Notes::default();
        let made = Actions::new(&runtime.instance, &session, options.controls.left_handed);
        let mut actions = notes.or_without(made, "controllers are not used")?;
        let tracked = options.gaze && gaze::supported(&runtime.instance, runtime.system);
        let made = if tracked { EyeTracker::new(&runtime.instance, &session) } else { Ok(None) };
        let mut eyes = notes.or_without(made, "the gaze is not followed")?.flatten();
        let sets: Vec<_> =
            actions.iter().map(Actions::set).chain(eyes.as_ref().map(EyeTracker::set)).collect();
        let attached = session.attach_action_sets(&sets).called("xrAttachSessionActionSets");
        if notes.or_without(attached, "neither controllers nor eyes are followed")?.is_none() {
            (actions, eyes) = (None, None);
        }
        let made = HandTrackers::new(&runtime.instance, runtime.system, &session);
        let hands = notes.or_without(made, "only controllers are seen, no hands")?.flatten();
        extras::request(&session, options.refresh_hz);
        let hidden = extras::hidden(&session, runtime.views, runtime.sizes.len());
        let follows = options.gaze && runtime.follows;
        let followed = follows.then(|| Followed::new(&session, &mut notes)).flatten();
        let wished = Sizes::new(runtime, followed.is_some(), options.size, context);
        // Those that were told before there was a session, where nothing else is.
        let views = followed.as_ref().and_then(|_| wished.views(&runtime.instance).ok());
        let views = views.as_ref().unwrap_or(&runtime.sizes);
        let sizes = sizes(views, options.size, context.image_size_limit(), &mut notes);
        let candidates = formats(&session, options.depth && runtime.takes_depth, options.mirrored)?;
        let (formats, images) = images(&session, context, &candidates, &sizes, &mut notes)?;
        let of_views = (runtime.views, images.len());
        let moves = || MotionVectors::new(&session, runtime.system, of_views, context, &mut notes);
        let motion = options.motion_vectors.then(moves).transpose()?.flatten();
        let spectator = options.mirrored.then(|| Spectator::new(context, formats, &mut notes)).transpose()?;
        let spectator = spectator.flatten();
        Ok(Session {
            images,
            motion,
            notices: Notices::new(context),
            menu: Menu::new(options.controls),
            spectator,
            sizes: wished,
            followed,
            actions,
            eyes,
            hands,
            space,
            waiter,
            context: context.clone(),
            stream,
            floor,
            session,
            instance: runtime.instance.clone(),
            views: runtime.views,
            blend: runtime.blend,
            formats,
            life: Lifecycle::default(),
            clock: FrameClock::new(steady.lent),
            steady,
            usual: Duration::ZERO,
            visible: false,
            exit: None,
            ended: false,
            display_time: xr::Time::from_nanos(0),
            located: Vec::new(),
            shown: Vec::new(),
            newest: None,
            starved: false,
            strikes: 0,
            blind: 0,
            state: xr::SessionState::UNKNOWN,
            notes,
            hidden,
            masks: 0,
        })
    }

    /// The formats of all images.
    pub fn formats(&self) -> Formats {
        self.formats
    }

    /// The extension by which the runtime gets motion vectors, if it does.
    pub fn motion_vectors(&self) -> Option<&'static str> {
        self.motion.as_ref().map(MotionVectors::extension)
    }

    /// Why nothing is shown, where that lasts.
    pub fn why_dark(&self) -> &'static str {
        if self.waiter.hangs() {
            return "xrWaitFrame does not return: the runtime hangs, or its compositor does; Ctrl-C ends";
        }
        if self.starved {
            return "the compositor gives no image back that could be drawn into: restart the runtime";
        }
        lifecycle::why_dark(self.state, !self.located.is_empty())
    }

    /// Whether an eye tracker is used.
    pub fn tracks_eyes(&self) -> bool {
        self.eyes.is_some()
    }

    /// What the runtime's times have told so far.
    pub fn clock(&self) -> &FrameClock {
        &self.clock
    }

    /// Asks the runtime to end the session; frames go on, without pictures, until it does.
    pub fn request_exit(&mut self) {
        if self.exit.is_none() {
            self.exit = Some(Instant::now());
            // A session that does not run yet, or cannot be asked, simply ends.
            self.ended |= self.session.request_exit().is_err();
        }
    }

    /// Takes the session down while nobody submits to the queue, for which runtimes may wait.
    pub fn close(self) {
        let context = self.context.clone();
        let _queue = context.queue();
        drop(self);
    }

    /// Whether [`Session::request_exit`] was called.
    pub fn exiting(&self) -> bool {
        self.exit.is_some()
    }

    fn begin(&mut self, (state, arrived): (xr::FrameState, i64)) -> Outcome<Frame> {
        let queue = self.context.queue();
        self.stream.begin().called("xrBeginFrame")?;
        drop(queue);
        let predicted = state.predicted_display_time.as_nanos();
        let period = state.predicted_display_period.as_nanos();
        let time = self.clock.frame(Told { time: predicted, period, arrived });
        // Zero and less are no times, and xrEndFrame refuses them even where they came from the runtime.
        self.display_time = xr::Time::from_nanos(if predicted > 0 { predicted } else { time });
        let should_render = state.should_render && self.exit.is_none();
        self.visible = should_render;
        if !should_render {
            self.clock.pause();
        }
        Ok(Frame { time, should_render, began: Instant::now() })
    }
}

impl Headset for Session {
    fn next_frame(&mut self) -> Outcome<Next> {
        self.poll()?;
        if self.ended || self.exit.is_some_and(|asked| asked.elapsed() > EXIT_PATIENCE) {
            return Ok(Next::End);
        }
        if !self.life.running() {
            std::thread::sleep(PATIENCE / 5);
            return Ok(Next::Pause);
        }
        // Where the last frame ended sooner than it usually does, this one need not wait.
        if self.visible || !self.waiter.asked() {
            self.waiter.ask(Duration::ZERO);
        }
        let Some(state) = self.waiter.take(PATIENCE)? else { return Ok(Next::Pause) };
        let frame = self.begin(state)?;
        let renewed = self.sizes.renewed(&self.session, self.formats, &self.images, &mut self.notes)?;
        if let Some(images) = renewed {
            // Of these none was handed over that could be shown again.
            self.images = images;
            self.shown.clear();
        }
        let step = Duration::from_nanos(self.clock.step() as u64);
        // The next frame is waited for while this one is traced; not so early that its time is past when
        // this one ends. Not every runtime holds up frames that nobody sees.
        let delay = if frame.should_render { self.usual.saturating_sub(step) } else { step * 4 / 5 };
        self.waiter.ask(delay);
        Ok(Next::Frame(frame))
    }

    fn sizes(&self) -> Vec<(u32, u32)> {
        self.images.iter().map(ViewImages::size).collect()
    }

    fn expect(&mut self, usual: Duration) {
        self.usual = usual;
    }

    fn now(&self) -> i64 {
        self.clock.now(self.steady.read())
    }

    fn deadline(&self, frame: &Frame) -> Deadline {
        Deadline { time: frame.time, period: self.clock.period() }
    }

    fn locate(&mut self, time: i64) -> Outcome<Option<Vec<EyeView>>> {
        let time = xr::Time::from_nanos(time);
        let found = match &self.followed {
            None => self.session.locate_views(self.views, time, &self.space),
            Some(followed) => {
                followed.locate(&self.session, self.views, (&self.space, time), self.images.len())
            }
        };
        let found = found.called("xrLocateViews");
        let found = self.notes.or_without(found, "the views stay where they were")?;
        self.strikes = if found.is_some() { 0 } else { self.strikes + 1 };
        if self.strikes > MOST_STRIKES {
            return Err(Fault::Session("xrLocateViews fails again and again".into()));
        }
        let (flags, views) = found.unwrap_or((xr::ViewStateFlags::EMPTY, Vec::new()));
        let turned = flags.contains(xr::ViewStateFlags::ORIENTATION_VALID);
        let placed = flags.contains(xr::ViewStateFlags::POSITION_VALID);
        let known = views.len() == self.images.len() && turned;
        if known {
            let eye = |(index, view): (usize, &xr::View)| {
                let last = self.located.get(index);
                let fov = convert::field_of_view(&view.fov).or(last.map(|eye| eye.fov))?;
                let mut pose = convert::pose(&view.pose);
                if !placed {
                    // What the runtime leaves there is undefined.
                    pose.position = last.map_or(DVec3::ZERO, |eye| eye.space_from_eye.position);
                }
                Some(EyeView { space_from_eye: pose, fov })
            };
            if let Some(located) = views.iter().enumerate().map(eye).collect() {
                self.located = located;
            }
        }
        Ok((!self.located.is_empty()).then(|| self.located.clone()))
    }

    fn input(&mut self, time: i64) -> Outcome<Input> {
        let floor = self.floor.moved(&self.space, xr::Time::from_nanos(time));
        let (hands, gaze) = self.actions(xr::Time::from_nanos(time))?;
        let followed = self.followed.as_ref();
        let gaze = gaze.or(followed.map(|eyes| eyes.look(&self.space, xr::Time::from_nanos(time))));
        Ok(Input { hands, gaze, floor, ..Input::default() })
    }

    fn acquire(&mut self) -> Outcome<Option<Vec<Canvas>>> {
        let canvas = |images: &mut ViewImages| {
            let (width, height) = images.size();
            // Runtimes take what they are given for linear light, or decode it by themselves.
            let encoding = Encoding::DisplayLinear;
            let rect = Rect { x: 0, y: 0, width, height };
            Ok(images.acquire()?.map(|target| Canvas { target, rect, encoding, motion: None }))
        };
        let canvases: Outcome<Option<Vec<Canvas>>> = self.images.iter_mut().map(canvas).collect();
        let mut canvases = canvases?;
        self.starved = canvases.is_none();
        if let (Some(canvases), Some(motion)) = (&mut canvases, &mut self.motion) {
            canvases.iter_mut().zip(motion.acquire()?).for_each(|(canvas, image)| canvas.motion = image);
        }
        Ok(canvases)
    }

    fn end(&mut self, _: &Frame, shown: Option<&[EyeView]>) -> Outcome<()> {
        // What was not drawn into is kept for the next frame.
        let (mut board, mut moves) = (false, false);
        if let Some(shown) = shown {
            board = self.show_menu()?;
            self.spectate()?;
            self.images.iter_mut().try_for_each(ViewImages::release)?;
            moves = self.motion.as_mut().map_or(Ok(false), |motion| motion.release(shown))?;
            self.shown = shown.to_vec();
            self.newest = Some(Instant::now());
        }
        self.submit(shown, board, moves)?;
        self.motion.iter_mut().for_each(|motion| motion.shown(shown.is_some()));
        Ok(())
    }

    fn stand(&mut self, world_from_space: Pose) {
        self.motion.iter_mut().for_each(|motion| motion.stand(world_from_space));
    }

    fn describe(&mut self, status: String) {
        self.menu.status = status;
    }

    fn hold(&mut self, _: &Frame, why: Option<&str>) -> Outcome<()> {
        self.submit_last(why)
    }

    fn hidden(&self) -> (&[HiddenMesh], u64) {
        (&self.hidden, self.masks)
    }

    fn take_notes(&mut self) -> Vec<String> {
        self.notes.take()
    }

    fn surprises(&self) -> bool {
        true
    }
}
