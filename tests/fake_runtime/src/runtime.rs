//! The runtime's state, and what every call has in common: the log, handles, scripted faults, losses.

use std::path::{Path, PathBuf};
use std::sync::{Condvar, LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use openxr_sys::{self as xr, Handle};

use crate::clock;
use crate::log::{Note, Writer};
use crate::objects::{Instance, Object, Objects, Queued, Session, Swapchain};
use crate::order::State;
use crate::refusal::{self, Outcome, Refusal, wrong};
use crate::script::{self, EventKind, Fault, Script, When, within};
use crate::world::{self, Pose};

/// Names the script's file.
pub const SCRIPT_VARIABLE: &str = "FAKE_XR_SCRIPT";

/// The one headset.
pub(crate) const SYSTEM: u64 = 1;

/// Between two loads of the library handles move up by this much.
const HANDLES_A_LOAD: u64 = 100_000;

/// Codes of success that a script may give to calls which do their work.
const DONE_WITH: [xr::Result; 3] =
    [xr::Result::FRAME_DISCARDED, xr::Result::SESSION_LOSS_PENDING, xr::Result::SESSION_NOT_FOCUSED];

/// Everything that the runtime knows.
pub(crate) struct Runtime {
    pub script: Script,
    pub objects: Objects,
    pub paths: Vec<String>,
    pub lost: bool,
    pub vulkan: Vulkan,
    log: Writer,
}

/// What XR_KHR_vulkan_enable2 has made.
#[derive(Default)]
pub(crate) struct Vulkan {
    pub function: Option<xr::platform::VkGetInstanceProcAddr>,
    pub requirements_told: bool,
    pub instances: Vec<u64>,
    pub devices: Vec<u64>,
    pub physical: Option<u64>,
}

static RUNTIME: LazyLock<Mutex<Runtime>> = LazyLock::new(|| Mutex::new(Runtime::load()));

/// Told when a frame is begun, for an xrWaitFrame that has to wait for that.
pub(crate) static BEGUN: Condvar = Condvar::new();

/// The runtime; a panic elsewhere leaves it as it was.
pub(crate) fn lock() -> MutexGuard<'static, Runtime> {
    RUNTIME.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What a call is about.
#[derive(Clone, Copy)]
pub(crate) enum On {
    /// No handle: calls before there is an instance.
    Nothing,
    Instance(xr::Instance),
    Session(xr::Session),
    Swapchain(xr::Swapchain),
    Space(xr::Space),
    ActionSet(xr::ActionSet),
    HandTracker(xr::HandTrackerEXT),
    Action(xr::Action),
}

impl On {
    fn handle(self) -> Option<(&'static str, u64)> {
        match self {
            On::Nothing => None,
            On::Instance(handle) => Some(("Instance", handle.into_raw())),
            On::Session(handle) => Some(("Session", handle.into_raw())),
            On::Swapchain(handle) => Some(("Swapchain", handle.into_raw())),
            On::Space(handle) => Some(("Space", handle.into_raw())),
            On::ActionSet(handle) => Some(("ActionSet", handle.into_raw())),
            On::HandTracker(handle) => Some(("HandTracker", handle.into_raw())),
            On::Action(handle) => Some(("Action", handle.into_raw())),
        }
    }
}

/// One call: its handle is checked, a scripted fault comes before its work, and it is logged.
pub(crate) fn enter(
    call: &'static str,
    on: On,
    work: impl FnOnce(&mut Runtime, &mut Note) -> Outcome,
) -> xr::Result {
    let mut note = Note::default();
    hang(call);
    let mut runtime = lock();
    let outcome = runtime.admit(call, on, &mut note).and_then(|()| work(&mut runtime, &mut note));
    runtime.finish(call, outcome, note)
}

/// Lets a call take as long as the script wants; others go on meanwhile.
pub(crate) fn hang(call: &str) {
    let for_ms = {
        let runtime = lock();
        let number = runtime.log.count(call) + 1;
        let hangs = runtime.script.hangs.iter().filter(|h| h.call == call && within(number, h.from, h.to));
        hangs.map(|hang| hang.ms).sum()
    };
    std::thread::sleep(Duration::from_millis(for_ms));
}

impl Runtime {
    fn load() -> Self {
        let path =
            std::env::var_os(SCRIPT_VARIABLE).map(PathBuf::from).expect("FAKE_XR_SCRIPT names a script");
        let text = std::fs::read_to_string(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let script: Script =
            serde_json::from_str(&text).unwrap_or_else(|e| panic!("{}: {e}", path.display()));
        let log = path.parent().unwrap_or(Path::new(".")).join(&script.log);
        let log = Writer::open(&log).unwrap_or_else(|e| panic!("{}: {e}", log.display()));
        let loads = log.count("xrCreateInstance") + 1;
        Runtime {
            script,
            objects: Objects::starting_at(loads * HANDLES_A_LOAD),
            paths: Vec::new(),
            lost: false,
            vulkan: Vulkan::default(),
            log,
        }
    }

    /// Checks handle and losses, and looks for a fault in the script.
    pub fn admit(&mut self, call: &'static str, on: On, note: &mut Note) -> Result<(), Refusal> {
        let mut session = None;
        if let Some((kind, handle)) = on.handle() {
            note.set("on", handle);
            if self.objects.get(handle).is_none_or(|object| object.kind() != kind) {
                return Err(wrong(
                    xr::Result::ERROR_HANDLE_INVALID,
                    format!("there is no {kind} {handle}, or no longer"),
                ));
            }
            session = self.session_of(handle);
        }
        let destroys = call.starts_with("xrDestroy");
        let scripted = self.fault(call, session);
        if let Some(result) = scripted {
            note.set("scripted", true);
            note.set("answers", format!("{result:?}"));
        }
        if let Some(result) = scripted.filter(|result| !DONE_WITH.contains(result)) {
            match result {
                xr::Result::ERROR_INSTANCE_LOST => self.lost = true,
                xr::Result::ERROR_SESSION_LOST => {
                    if let Some(session) = session {
                        self.session(session)?.lost = true;
                    }
                }
                _ => {}
            }
            return Err(result.into());
        }
        if self.lost && !destroys && on.handle().is_some() {
            return Err(xr::Result::ERROR_INSTANCE_LOST.into());
        }
        match session {
            Some(session) if self.session(session)?.lost && !destroys => {
                Err(xr::Result::ERROR_SESSION_LOST.into())
            }
            _ => Ok(()),
        }
    }

    /// Writes the call down and gives its result.
    pub fn finish(&mut self, call: &'static str, outcome: Outcome, mut note: Note) -> xr::Result {
        let result = match outcome {
            Ok(result) => note.get("answers").and_then(refusal::named).unwrap_or(result),
            Err(Refusal::Answer(result)) => result,
            Err(Refusal::Wrong(result, what)) => {
                note.set("violation", what);
                result
            }
        };
        self.log.write(call, result, note);
        result
    }

    /// The result that the script has for this call, if it has one.
    fn fault(&mut self, call: &str, session: Option<u64>) -> Option<xr::Result> {
        let hit = |faults: &[Fault], number: u64| {
            let fault = faults.iter().find(|f| f.call == call && within(number, f.from, f.to))?;
            Some(refusal::named(&fault.result).unwrap_or_else(|| panic!("{} is no result", fault.result)))
        };
        let in_run = hit(&self.script.faults, self.log.count(call) + 1);
        let session = session.and_then(|session| self.session(session).ok());
        let in_session = session.and_then(|session| {
            let number = session.calls.entry(call.to_string()).or_default();
            *number += 1;
            hit(&session.script.faults, *number)
        });
        in_run.or(in_session)
    }

    /// How many sessions the run has had.
    pub fn sessions_so_far(&self) -> usize {
        self.log.count("session") as usize
    }

    /// Counts a session.
    pub fn count_session(&mut self) {
        self.log.write("session", xr::Result::SUCCESS, Note::default());
    }

    /// The session that an object belongs to.
    pub fn session_of(&self, handle: u64) -> Option<u64> {
        match self.objects.get(handle)? {
            Object::Session(_) => Some(handle),
            _ => self.session_of(self.objects.parent(handle)?),
        }
    }

    pub fn session(&mut self, handle: u64) -> Result<&mut Session, Refusal> {
        match self.objects.get_mut(handle) {
            Some(Object::Session(session)) => Ok(session),
            _ => Err(wrong(xr::Result::ERROR_HANDLE_INVALID, format!("there is no Session {handle}"))),
        }
    }

    pub fn swapchain(&mut self, handle: u64) -> Result<&mut Swapchain, Refusal> {
        match self.objects.get_mut(handle) {
            Some(Object::Swapchain(swapchain)) => Ok(swapchain),
            _ => Err(wrong(xr::Result::ERROR_HANDLE_INVALID, format!("there is no Swapchain {handle}"))),
        }
    }

    /// The one instance.
    fn instance(&mut self) -> Option<&mut Instance> {
        self.objects.iter_mut().find_map(|(_, object)| match object {
            Object::Instance(instance) => Some(instance),
            _ => None,
        })
    }

    /// Whether the application has enabled an extension.
    pub fn has(&mut self, extension: &str) -> bool {
        self.instance().is_some_and(|instance| instance.extensions.contains(extension))
    }

    /// Refuses a call whose extension was not enabled.
    pub fn needs(&mut self, extension: &str) -> Result<(), Refusal> {
        if self.has(extension) {
            return Ok(());
        }
        Err(wrong(xr::Result::ERROR_FUNCTION_UNSUPPORTED, format!("{extension} is not enabled")))
    }

    /// Whether the application asked for OpenXR 1.1 or later.
    pub fn is_1_1(&mut self) -> bool {
        self.instance().is_some_and(|instance| instance.minor_version >= 1)
    }

    pub fn queue(&mut self, event: Queued) {
        if let Some(instance) = self.instance() {
            instance.events.push_back(event);
        }
    }

    pub fn next_event(&mut self) -> Option<Queued> {
        self.instance()?.events.pop_front()
    }

    /// A session goes through states, as far as the specification has arrows for them.
    pub fn go(&mut self, handle: u64, states: &[State]) -> Result<(), Refusal> {
        for &next in states {
            let session = self.session(handle)?;
            assert!(
                session.state.may_become(next),
                "the script lets a session become {next:?} from {:?}, which OpenXR does not",
                session.state
            );
            session.state = next;
            self.queue(Queued::State(handle, next));
        }
        Ok(())
    }

    /// The script's steps for a moment.
    pub fn step(&mut self, handle: u64, at: When) -> Result<(), Refusal> {
        let steps = &self.session(handle)?.script.steps;
        let states: Vec<State> =
            steps.iter().filter(|step| step.at == at).flat_map(|step| step.go.clone()).collect();
        self.go(handle, &states)
    }

    /// The script's events for a frame.
    pub fn tell_events(&mut self, handle: u64, frame: u64) -> Result<(), Refusal> {
        let session = self.session(handle)?;
        let configuration = session.configuration.unwrap_or(xr::ViewConfigurationType::PRIMARY_STEREO);
        let events = session.script.events.iter().filter(|event| event.frame == frame);
        let events: Vec<EventKind> = events.map(|event| event.event).collect();
        let (created, time) = (session.created, now());
        for event in &events {
            match *event {
                EventKind::VisibilityMask { view, hidden_corner } => {
                    self.session(handle)?.hidden_corners.insert(view, hidden_corner);
                }
                EventKind::Recentred => {
                    let head = world::head(&self.script.head, (time - created) as f64 * 1e-9);
                    self.session(handle)?.origin = head;
                }
                EventKind::ViewSize { view, size } => {
                    self.script.views.iter_mut().skip(view).take(1).for_each(|view| view.size = size);
                }
                _ => {}
            }
        }
        let events = events.into_iter().filter(|event| !matches!(event, EventKind::ViewSize { .. }));
        events.for_each(|event| self.queue(Queued::Scripted(handle, event, configuration)));
        Ok(())
    }

    /// The views of a configuration, if it is offered.
    pub fn views(&mut self, configuration: xr::ViewConfigurationType) -> Result<Vec<script::View>, Refusal> {
        let views = match configuration {
            xr::ViewConfigurationType::PRIMARY_STEREO => self.script.views.clone(),
            xr::ViewConfigurationType::PRIMARY_STEREO_WITH_FOVEATED_INSET if self.offers_insets() => {
                self.script.inset_views.clone()
            }
            _ => return Err(xr::Result::ERROR_VIEW_CONFIGURATION_TYPE_UNSUPPORTED.into()),
        };
        Ok(views)
    }

    /// Whether foveated insets are there for the application.
    pub fn offers_insets(&mut self) -> bool {
        !self.script.inset_views.is_empty() && (self.is_1_1() || self.has("XR_VARJO_quad_views"))
    }

    pub fn check_system(&self, system: xr::SystemId) -> Result<(), Refusal> {
        let known = system.into_raw() == SYSTEM;
        known.then_some(()).ok_or_else(|| wrong(xr::Result::ERROR_SYSTEM_INVALID, "there is no such system"))
    }

    /// The head in the LOCAL space at a time.
    pub fn head(&mut self, session: u64, time: i64) -> Result<Pose, Refusal> {
        let (created, origin) = (self.session(session)?.created, self.session(session)?.origin);
        let head = world::head(&self.script.head, (time - created) as f64 * 1e-9);
        Ok(origin.inverse().then(head))
    }

    /// The text of a path.
    pub fn path(&self, path: xr::Path) -> Result<&str, Refusal> {
        let index = (path.into_raw() as usize).checked_sub(1);
        index
            .and_then(|index| self.paths.get(index))
            .map(String::as_str)
            .ok_or_else(|| wrong(xr::Result::ERROR_PATH_INVALID, "there is no such path"))
    }
}

/// Nanoseconds now.
pub(crate) fn now() -> i64 {
    clock::now()
}
