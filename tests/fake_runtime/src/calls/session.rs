//! Sessions, and the end of everything that was created.

use std::collections::{BTreeMap, BTreeSet, HashMap};

use openxr_sys::{self as xr, Handle};

use crate::abi::{self, In, Out};
use crate::log::Note;
use crate::objects::{Object, Session};
use crate::order::{Frame, FrameLoop, State};
use crate::refusal::{Outcome, invalid, wrong};
use crate::runtime::{On, Runtime, enter, now};
use crate::script::When;
use crate::vulkan::Gpu;
use crate::world::Pose;

const DONE: Outcome = Ok(xr::Result::SUCCESS);

pub(crate) fn create(
    instance: xr::Instance,
    info: In<xr::SessionCreateInfo>,
    session: Out<xr::Session>,
) -> xr::Result {
    enter("xrCreateSession", On::Instance(instance), |runtime, note| {
        let info = info.get()?;
        runtime.check_system(info.system_id)?;
        let binding: &xr::GraphicsBindingVulkanKHR = abi::chained(info.next, info).ok_or_else(|| {
            wrong(xr::Result::ERROR_GRAPHICS_DEVICE_INVALID, "there is no Vulkan binding in the chain")
        })?;
        let vulkan = &runtime.vulkan;
        if !vulkan.requirements_told {
            return Err(wrong(
                xr::Result::ERROR_GRAPHICS_REQUIREMENTS_CALL_MISSING,
                "xrGetVulkanGraphicsRequirements2KHR comes first",
            ));
        }
        let ours = vulkan.instances.contains(&(binding.instance as u64))
            && vulkan.devices.contains(&(binding.device as u64))
            && vulkan.physical == Some(binding.physical_device as u64);
        let function = vulkan.function.filter(|_| ours).ok_or_else(|| {
            wrong(
                xr::Result::ERROR_GRAPHICS_DEVICE_INVALID,
                "instance, physical device and device do not come from the runtime",
            )
        })?;
        let gpu = Gpu::new(function, binding)
            .map_err(|code| wrong(xr::Result::ERROR_GRAPHICS_DEVICE_INVALID, code.to_string()))?;
        let alive = |(_, object): (u64, &Object)| matches!(object, Object::Session(_));
        if runtime.objects.iter().any(alive) {
            gpu.destroy();
            return Err(xr::Result::ERROR_LIMIT_REACHED.into());
        }
        let number = runtime.sessions_so_far();
        runtime.count_session();
        note.set("made", "Session");
        for (key, value) in held() {
            note.set(key, value);
        }
        let object = Session {
            script: runtime.script.sessions.get(number).cloned().unwrap_or_default(),
            gpu,
            state: State::Unknown,
            told: State::Unknown,
            configuration: None,
            frames: FrameLoop::default(),
            latest: Frame { number: 0, display_time: 0, should_render: false },
            ended_frames: 0,
            begun_times: 0,
            ended_times: 0,
            calls: HashMap::new(),
            exit_requested: false,
            lost: false,
            created: now(),
            last_display: 0,
            action_sets: None,
            synced: BTreeSet::new(),
            sync_frames: (0, 0),
            hidden_corners: BTreeMap::new(),
            origin: Pose::IDENTITY,
            refresh_rate: (1000.0 / runtime.script.period_ms) as f32,
            asked: (u64::MAX, 0),
        };
        let handle = runtime.objects.insert(instance.into_raw(), Object::Session(Box::new(object)));
        session.set(xr::Session::from_raw(handle))?;
        runtime.step(handle, When::Created)?;
        DONE
    })
}

/// What the process holds now, to find leaks: open files, threads, memory.
fn held() -> [(&'static str, Option<u64>); 3] {
    let count = |folder: &str| std::fs::read_dir(folder).ok().map(|entries| entries.count() as u64);
    let pages = std::fs::read_to_string("/proc/self/statm").ok();
    let resident = pages.and_then(|text| text.split(' ').nth(1)?.parse::<u64>().ok());
    [
        ("fds", count("/proc/self/fd")),
        ("threads", count("/proc/self/task")),
        ("memory_kib", resident.map(|pages| pages * 4)),
    ]
}

pub(crate) fn destroy(session: xr::Session) -> xr::Result {
    enter("xrDestroySession", On::Session(session), |runtime, note| runtime.destroy(session.into_raw(), note))
}

pub(crate) fn begin(session: xr::Session, info: In<xr::SessionBeginInfo>) -> xr::Result {
    enter("xrBeginSession", On::Session(session), |runtime, note| {
        let configuration = info.get()?.primary_view_configuration_type;
        note.set("configuration", format!("{configuration:?}"));
        held().into_iter().for_each(|(key, count)| note.set(key, count));
        runtime.views(configuration)?;
        let handle = session.into_raw();
        let session = runtime.session(handle)?;
        if session.configuration.is_some() {
            return Err(wrong(xr::Result::ERROR_SESSION_RUNNING, "the session runs already"));
        }
        if session.told != State::Ready {
            let told = session.told;
            return Err(wrong(
                xr::Result::ERROR_SESSION_NOT_READY,
                format!("the session was told to be {told:?}, not Ready"),
            ));
        }
        session.configuration = Some(configuration);
        session.begun_times += 1;
        let at = When::Begun(session.begun_times);
        runtime.step(handle, at)?;
        DONE
    })
}

pub(crate) fn end(session: xr::Session) -> xr::Result {
    enter("xrEndSession", On::Session(session), |runtime, _| {
        let handle = session.into_raw();
        let session = runtime.running(handle)?;
        if session.told != State::Stopping {
            let told = session.told;
            return Err(wrong(
                xr::Result::ERROR_SESSION_NOT_STOPPING,
                format!("the session was told to be {told:?}, not Stopping"),
            ));
        }
        session.configuration = None;
        session.frames = FrameLoop::default();
        session.ended_times += 1;
        let at = When::Ended(session.ended_times);
        if session.exit_requested {
            runtime.go(handle, &[State::Idle, State::Exiting])?;
        } else {
            runtime.step(handle, at)?;
        }
        DONE
    })
}

pub(crate) fn request_exit(session: xr::Session) -> xr::Result {
    enter("xrRequestExitSession", On::Session(session), |runtime, _| {
        let handle = session.into_raw();
        // A session may be asked before it runs; the answer is an error, but no rule is broken.
        let session = runtime.session(handle)?;
        if session.configuration.is_none() {
            return Err(xr::Result::ERROR_SESSION_NOT_RUNNING.into());
        }
        session.exit_requested = true;
        let way = session.state.way_to_stop();
        runtime.go(handle, way)?;
        DONE
    })
}

pub(crate) fn enumerate_reference_spaces(
    session: xr::Session,
    capacity: u32,
    count: Out<u32>,
    spaces: Out<xr::ReferenceSpaceType>,
) -> xr::Result {
    enter("xrEnumerateReferenceSpaces", On::Session(session), |runtime, _| {
        spaces.fill(capacity, count, runtime.reference_spaces())?;
        DONE
    })
}

impl Runtime {
    /// The reference spaces on offer.
    pub fn reference_spaces(&mut self) -> Vec<xr::ReferenceSpaceType> {
        use xr::ReferenceSpaceType as Type;
        let mut spaces = vec![Type::VIEW, Type::LOCAL, Type::STAGE];
        if self.is_1_1() || self.has("XR_EXT_local_floor") {
            spaces.push(Type::LOCAL_FLOOR);
        }
        if self.has("XR_VARJO_foveated_rendering") {
            spaces.push(Type::COMBINED_EYE_VARJO);
        }
        spaces
    }

    /// A session that has begun and not ended.
    pub fn running(&mut self, handle: u64) -> Result<&mut Session, crate::refusal::Refusal> {
        let session = self.session(handle)?;
        match session.configuration {
            Some(_) => Ok(session),
            None => Err(wrong(xr::Result::ERROR_SESSION_NOT_RUNNING, "the session does not run")),
        }
    }

    /// Destroys an object and everything below it, and writes down what was left to the runtime.
    pub fn destroy(&mut self, handle: u64, note: &mut Note) -> Outcome {
        let below = self.objects.below(handle);
        let mut left: BTreeMap<&str, u32> = BTreeMap::new();
        for &child in &below {
            let kind = self.objects.get(child).map_or("nothing", Object::kind);
            *left.entry(kind).or_default() += 1;
        }
        note.set("left", &left);
        for one in below.into_iter().chain([handle]) {
            self.free(one)?;
        }
        // Vulkan's memory cannot be given back to a device that may be gone, so the session comes first.
        if left.contains_key("Session") {
            return Err(invalid("a session was left to xrDestroyInstance"));
        }
        DONE
    }

    fn free(&mut self, handle: u64) -> Result<(), crate::refusal::Refusal> {
        let session = self.session_of(handle);
        match self.objects.remove(handle) {
            Some(Object::Swapchain(swapchain)) => {
                let session = session.ok_or_else(|| invalid("a swapchain has no session"))?;
                let gpu = &self.session(session)?.gpu;
                swapchain.images.iter().for_each(|image| gpu.destroy_image(image));
            }
            Some(Object::Session(session)) => session.gpu.destroy(),
            _ => {}
        }
        Ok(())
    }
}
