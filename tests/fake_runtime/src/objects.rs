//! What the application has created. Handles are numbers that are never used twice, so a stale one is found.

use std::collections::{BTreeMap, BTreeSet, HashMap, VecDeque};

use openxr_sys as xr;

use crate::order::{Frame, FrameLoop, ImageOrder, State};
use crate::script;
use crate::vulkan::{Gpu, Image, Shape};
use crate::world::Pose;

/// The instance.
#[derive(Debug, Default)]
pub(crate) struct Instance {
    pub extensions: BTreeSet<String>,
    pub minor_version: u16,
    pub events: VecDeque<Queued>,
}

/// A session.
pub(crate) struct Session {
    pub script: script::Session,
    pub gpu: Gpu,
    /// The state that the runtime is in, and the one that the application has been told.
    pub state: State,
    pub told: State,
    pub configuration: Option<xr::ViewConfigurationType>,
    pub frames: FrameLoop,
    /// The latest frame of xrWaitFrame.
    pub latest: Frame,
    pub ended_frames: u64,
    pub begun_times: u64,
    pub ended_times: u64,
    pub calls: HashMap<String, u64>,
    pub exit_requested: bool,
    pub lost: bool,
    pub created: i64,
    pub last_display: i64,
    pub action_sets: Option<BTreeSet<u64>>,
    pub synced: BTreeSet<u64>,
    /// The frames of the last xrSyncActions but one, and of the last.
    pub sync_frames: (u64, u64),
    /// By view, where an event has changed it.
    pub hidden_corners: BTreeMap<u32, f32>,
    /// The LOCAL space's origin where it was when the session was created.
    pub origin: Pose,
    pub refresh_rate: f32,
    /// How many frames had ended as views were located last, and how often it was asked in that frame before.
    pub asked: (u64, u32),
}

/// A swapchain.
pub(crate) struct Swapchain {
    pub shape: Shape,
    pub images: Vec<Image>,
    pub order: ImageOrder,
}

/// A space.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Space {
    Reference(xr::ReferenceSpaceType, Pose),
    Action { action: u64, hand: xr::Path, pose: Pose },
}

/// An action.
#[derive(Clone, Debug)]
pub(crate) struct Action {
    pub set: u64,
    pub kind: xr::ActionType,
    /// Profile and component path of each suggested binding.
    pub bindings: Vec<(String, String)>,
    pub name: String,
}

/// An event that waits for xrPollEvent.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Queued {
    State(u64, State),
    ProfileChanged(u64),
    Scripted(u64, script::EventKind, xr::ViewConfigurationType),
}

/// What a handle stands for.
pub(crate) enum Object {
    Instance(Instance),
    Session(Box<Session>),
    Swapchain(Box<Swapchain>),
    Space(Space),
    ActionSet { attached: bool },
    HandTracker { left: bool },
    Action(Action),
}

impl Object {
    /// The name of the kind, as in xrCreate and xrDestroy.
    pub fn kind(&self) -> &'static str {
        match self {
            Object::Instance(_) => "Instance",
            Object::Session(_) => "Session",
            Object::Swapchain(_) => "Swapchain",
            Object::Space(_) => "Space",
            Object::ActionSet { .. } => "ActionSet",
            Object::HandTracker { .. } => "HandTracker",
            Object::Action(_) => "Action",
        }
    }
}

/// Every object that lives.
#[derive(Default)]
pub(crate) struct Objects {
    next: u64,
    live: BTreeMap<u64, (u64, Object)>,
}

impl Objects {
    /// Handles start above a number, so that those of an earlier instance are not met again.
    pub fn starting_at(next: u64) -> Self {
        Objects { next, live: BTreeMap::new() }
    }

    pub fn insert(&mut self, parent: u64, object: Object) -> u64 {
        self.next += 1;
        self.live.insert(self.next, (parent, object));
        self.next
    }

    pub fn get(&self, handle: u64) -> Option<&Object> {
        self.live.get(&handle).map(|(_, object)| object)
    }

    pub fn get_mut(&mut self, handle: u64) -> Option<&mut Object> {
        self.live.get_mut(&handle).map(|(_, object)| object)
    }

    pub fn parent(&self, handle: u64) -> Option<u64> {
        self.live.get(&handle).map(|&(parent, _)| parent)
    }

    pub fn iter(&self) -> impl Iterator<Item = (u64, &Object)> {
        self.live.iter().map(|(&handle, (_, object))| (handle, object))
    }

    pub fn iter_mut(&mut self) -> impl Iterator<Item = (u64, &mut Object)> {
        self.live.iter_mut().map(|(&handle, (_, object))| (handle, object))
    }

    /// The children of an object and theirs, the deepest first.
    pub fn below(&self, handle: u64) -> Vec<u64> {
        let children = self.live.iter().filter(|(_, (parent, _))| *parent == handle).map(|(&child, _)| child);
        children.flat_map(|child| self.below(child).into_iter().chain([child])).collect()
    }

    pub fn remove(&mut self, handle: u64) -> Option<Object> {
        self.live.remove(&handle).map(|(_, object)| object)
    }

    /// Two objects of different kinds, to work on both at once.
    pub fn session_and_swapchain(
        &mut self,
        session: u64,
        swapchain: u64,
    ) -> Option<(&mut Session, &mut Swapchain)> {
        let mut found = (None, None);
        for (&handle, (_, object)) in &mut self.live {
            match object {
                Object::Session(object) if handle == session => found.0 = Some(&mut **object),
                Object::Swapchain(object) if handle == swapchain => found.1 = Some(&mut **object),
                _ => {}
            }
        }
        found.0.zip(found.1)
    }
}
