//! Several devices that share each frame.
//!
//! Each has a thread of its own, which opens it, has it show that it computes what it should
//! (`src/trace/self_test.rs`), traces its parts, and opens it anew after a failure, at growing intervals. A
//! driver that hangs holds up nobody else: after a while its part goes to the others in the same frame, and
//! it may take part again once it answers. `Worker` is what a fleet has of a device; tests give it some that
//! fail. Devices are given their parts of all views of a frame at once, and begin with the next one without being waited
//! for (`Fleet::begin`). Each device has a context and a copy of the scene of its own, although devices of one platform could
//! share a context: nothing is shared between devices but what the host packs once and keeps for those that
//! come back, and in a common context buffers may be kept for, moved to, or lost with each device in it, as
//! the driver likes. The first device writes results in place where memory is shared; the others' are copied without a wait of the host,
//! samples straight to their places, visibility too where one device has traced all of it, else packed tile by tile
//! (`kernels/gather.cl`).

mod thread;

use std::collections::HashMap;
use std::ops::Range;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::worker::{DeviceWorker, Job, PartResult, RayQueryDevice, Worker};
use super::{SceneData, Traversals};
use crate::error::{Error, Result};
use crate::foveation::Part;
use crate::gpu::opencl::Device;
use crate::progress;
use crate::waiting::{self, Limits};
use thread::{Answer, Order, work};

/// Opens a worker: called on the worker's own thread, at start and again after a failure. The number counts the
/// times.
pub type Opener = Box<dyn Fn(u32) -> Result<Box<dyn Worker>> + Send>;

/// A device, and its variants of the kernels or why it is of no use.
pub type Tried = (Device, std::result::Result<Traversals, String>);

/// Parts of a view, each with the index of the device that is to trace it.
pub type Parts = Vec<(usize, Part)>;

/// How long devices may take to open, and for their first part: drivers build kernels meanwhile.
const BUILDING: Limits = Limits::BUILDING;
/// A part may take this long at least, and this many times as long as parts have taken lately.
const PATIENCE: Duration = Duration::from_secs(3);
const PATIENCE_FACTOR: f64 = 20.0;

/// Where a device stands.
#[derive(Clone, Debug, PartialEq)]
pub enum State {
    /// It is being opened, or opened anew.
    Opening,
    /// It takes part.
    Ready,
    /// It has not answered in time, and may still.
    Late,
    /// It does not take part, and why.
    Out(String),
}

/// Devices that trace together.
pub struct Fleet {
    members: Vec<Member>,
    answers: Receiver<(usize, Answer)>,
    /// Rounds so far, and those that nobody has waited for yet.
    rounds: u64,
    begun: Vec<Begun>,
    notes: Vec<String>,
}

/// A round under way.
#[derive(Default)]
struct Begun {
    number: u64,
    /// Parts that devices work on, each under its device's index.
    waiting: HashMap<usize, Part>,
    round: Round,
}

struct Member {
    name: String,
    orders: Option<Sender<Order>>,
    thread: Option<JoinHandle<()>>,
    state: State,
    /// How long its last parts took, in seconds; none before the first.
    usual: Option<f64>,
    /// It has failed since it was first opened.
    failed: bool,
}

/// What became of a round's parts.
#[derive(Debug, Default)]
pub struct Round {
    /// Parts that are done, with the index of the device.
    pub done: Vec<(usize, PartResult)>,
    /// Parts that devices have left undone.
    pub lost: Vec<Part>,
}

impl Fleet {
    /// Opens devices, each with its variants of the kernels, the first of which may write landings in place (`direct`).
    ///
    /// # Errors
    /// Where none of them can be used: the first one's reason.
    pub fn of_devices(
        devices: &[(Device, Traversals)],
        data: &Arc<SceneData>,
        direct: bool,
    ) -> Result<Fleet> {
        let fit: Vec<Tried> =
            devices.iter().map(|(device, traversals)| (device.clone(), Ok(*traversals))).collect();
        Self::of_tried(&fit, data, direct, None)
    }

    /// The same where some devices are known to be of no use, and why: they are left out with that sentence. The rays of
    /// the first, which writes in place, may be traced by ray queries of the presenting one, until it fails; a note tells
    /// where they cannot be and need not.
    ///
    /// # Errors
    /// As [`Fleet::of_devices`].
    pub fn of_tried(
        devices: &[Tried],
        data: &Arc<SceneData>,
        direct: bool,
        rays: Option<&RayQueryDevice>,
    ) -> Result<Fleet> {
        let opener = |(index, (device, traversals)): (usize, &Tried)| {
            let (device, traversals, data) = (device.clone(), traversals.clone(), data.clone());
            let mut name = device.info().name.clone();
            let twin = |other: &&Tried| other.0.info().name == name;
            if devices.iter().filter(twin).count() > 1 {
                name += &format!(" (number {})", devices[..=index].iter().filter(twin).count());
            }
            let rays = rays.filter(|_| index == 0).cloned();
            let open: Opener = Box::new(move |times| {
                let traversals = traversals
                    .clone()
                    .map_err(|problem| Error::Device { device: device.info().name.clone(), problem })?;
                Ok(Box::new(match (times, &rays) {
                    (0, Some(rays)) => DeviceWorker::with_hardware_rays(&device, &data, rays, traversals)?,
                    (0, None) => DeviceWorker::new(&device, &data, traversals, direct && index == 0)?,
                    (_, _) => DeviceWorker::reopen(&device, &data, traversals)?,
                }))
            });
            (name, open)
        };
        Self::new(devices.iter().enumerate().map(opener).collect())
    }

    /// Opens hands by their names, and waits until each can be used or not.
    ///
    /// # Errors
    /// Where none of them can be used: the first one's reason.
    pub fn new(openers: Vec<(String, Opener)>) -> Result<Fleet> {
        let (answer, answers) = channel();
        let members = openers.into_iter().enumerate().map(|(index, (name, open))| {
            let (orders, received) = channel();
            let answer = answer.clone();
            let work = move || work(index, &open, &received, &answer);
            let thread = std::thread::Builder::new().name(format!("device {index}")).spawn(work).ok();
            let state = match thread {
                Some(_) => State::Opening,
                None => State::Out(format!("{name}: there is no thread for it; end other programs")),
            };
            Member { name, orders: Some(orders), thread, state, usual: None, failed: false }
        });
        let mut fleet =
            Fleet { members: members.collect(), answers, rounds: 0, begun: Vec::new(), notes: Vec::new() };
        fleet.wait_open();
        if fleet.members.iter().any(|m| m.state == State::Ready) {
            return Ok(fleet);
        }
        let problem = fleet.notes.first().cloned().unwrap_or_else(|| "there is none to open".to_string());
        Err(Error::NoDevice { kind: "OpenCL", problem })
    }

    fn wait_open(&mut self) {
        while let Some(waiting) = self.members.iter().find(|m| m.state == State::Opening) {
            let heard =
                waiting::wait_for(&waiting.name, BUILDING, |step| self.answers.recv_timeout(step).ok());
            let Some((index, answer)) = heard else { break };
            self.hear(index, answer);
        }
        for member in self.members.iter_mut().filter(|m| m.state == State::Opening) {
            waiting::give_up();
            let seconds = BUILDING.end.as_secs();
            let why =
                format!("{} has not answered for {seconds} s; leave it out with --devices", member.name);
            self.notes.push(why.clone());
            (member.failed, member.state) = (true, State::Out(why));
        }
    }

    /// The devices' names.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.members.iter().map(|m| m.name.as_str())
    }

    /// Number of devices, ready or not.
    pub fn count(&self) -> usize {
        self.members.len()
    }

    /// Where a device stands.
    pub fn state(&self, device: usize) -> &State {
        &self.members[device].state
    }

    /// What the operator should know of devices that have left or come back, once.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    /// Waits until a device takes part, for so long at most; tells whether one does.
    pub fn wait(&mut self, most: Duration) -> bool {
        let start = Instant::now();
        while !self.members.iter().any(|m| m.state == State::Ready) {
            let left = most.saturating_sub(start.elapsed());
            match self.answers.recv_timeout(left.min(waiting::STEP)) {
                Ok((index, answer)) => self.hear(index, answer),
                Err(_) if left.is_zero() || waiting::leaves(start.elapsed()) => return false,
                Err(_) => {}
            }
        }
        true
    }

    /// Hears of devices that have come back.
    pub fn refresh(&mut self) {
        while let Ok((index, answer)) = self.answers.try_recv() {
            self.hear(index, answer);
        }
    }

    /// Has parts of a view traced, all at the same time, and waits for them. A device that fails or is late leaves its
    /// part undone.
    pub fn trace(&mut self, job: &Arc<Job>, parts: Parts) -> Round {
        let number = self.begin(vec![(job.clone(), parts)]).start;
        self.end(number)
    }

    /// Has devices begin with parts of views that follow each other: none waits between its parts. The numbers of the
    /// views' rounds, for [`Fleet::end`].
    pub fn begin(&mut self, views: Vec<(Arc<Job>, Parts)>) -> Range<u64> {
        let first = self.rounds;
        let mut orders: Vec<Order> = self.members.iter().map(|_| Order::default()).collect();
        for (job, parts) in views {
            let mut begun = Begun { number: self.rounds, ..Begun::default() };
            for (index, part) in parts {
                orders[index].rounds.push(self.rounds);
                orders[index].work.push((job.clone(), part.clone()));
                begun.waiting.insert(index, part);
            }
            self.begun.push(begun);
            self.rounds += 1;
        }
        for (index, order) in orders.into_iter().enumerate().filter(|(_, order)| !order.work.is_empty()) {
            let member = &self.members[index];
            let send = |orders: &Sender<Order>| orders.send(order).is_ok();
            if member.state != State::Ready || !member.orders.as_ref().is_some_and(send) {
                self.lose(index);
            }
        }
        first..self.rounds
    }

    /// Forgets rounds that were begun and that nobody will wait for; tells how many.
    pub fn forget(&mut self) -> usize {
        self.begun.drain(..).count()
    }

    /// Waits for a round's parts.
    ///
    /// # Panics
    /// If there is no such round, or it was waited for before.
    pub fn end(&mut self, number: u64) -> Round {
        let start = Instant::now();
        let mut silent_at = Some(start + BUILDING.told);
        loop {
            let at = self.begun.iter().position(|begun| begun.number == number);
            let at = at.unwrap_or_else(|| panic!("round {number} is not under way"));
            let waiting = &self.begun[at].waiting;
            let deadline = |index: &usize| start + self.members[*index].patience();
            let Some(first) = waiting.keys().map(deadline).min() else {
                return self.begun.swap_remove(at).round;
            };
            let left = first.saturating_duration_since(Instant::now());
            match self.answers.recv_timeout(left.min(waiting::step(start.elapsed()))) {
                Ok((index, answer)) => self.hear(index, answer),
                Err(RecvTimeoutError::Timeout) => {
                    let now = Instant::now();
                    let leaves = waiting::leaves(start.elapsed());
                    if silent_at.take_if(|at| *at <= now).is_some() {
                        self.tell_silent(waiting.keys());
                    }
                    let late = waiting.keys().copied().filter(|index| leaves || deadline(index) <= now);
                    let late: Vec<usize> = late.collect();
                    late.into_iter().for_each(|index| self.leave_late(index));
                }
                Err(RecvTimeoutError::Disconnected) => {
                    (0..self.members.len()).for_each(|index| self.lose(index));
                }
            }
        }
    }

    /// Takes what a device has begun with from it.
    fn lose(&mut self, index: usize) {
        for begun in &mut self.begun {
            begun.round.lost.extend(begun.waiting.remove(&index));
        }
    }

    /// Tells at once who is waited for: a frame does not end meanwhile.
    fn tell_silent<'a>(&self, waiting: impl Iterator<Item = &'a usize>) {
        let names: Vec<&str> = waiting.map(|&index| self.members[index].name.as_str()).collect();
        let seconds = BUILDING.told.as_secs();
        let told =
            format!("{} has not answered for {seconds} s; waiting for it, Ctrl-C ends", names.join(" and "));
        progress::complain(&told);
    }

    /// Goes on without a device that does not answer.
    fn leave_late(&mut self, index: usize) {
        self.members[index].state = State::Late;
        self.lose(index);
        let rest = match self.members.iter().any(|m| m.state == State::Ready) {
            true => "; the others do its part until it does",
            false => "",
        };
        self.notes.push(format!("{} does not answer{rest}", self.members[index].name));
    }

    /// Takes an answer in.
    fn hear(&mut self, index: usize, answer: Answer) {
        let others = self.members.iter().enumerate().any(|(i, m)| i != index && m.state == State::Ready);
        let left =
            |why: &str| if others { format!("{why}; the others do its part") } else { why.to_string() };
        let member = &mut self.members[index];
        match answer {
            Answer::Opened(Ok(note)) => {
                self.notes.extend(note);
                if member.failed {
                    self.notes.push(format!("{} takes part again", member.name));
                }
                (member.usual, member.state) = (None, State::Ready);
            }
            Answer::Opened(Err(why)) => {
                if !member.failed {
                    self.notes.push(why.clone());
                }
                member.state = State::Out(why);
            }
            Answer::Traced(round, took, Ok(done)) => {
                if member.state == State::Late {
                    self.notes.push(format!("{} answers again", member.name));
                    member.state = State::Ready;
                }
                // What came too late is done by others already.
                if let Some(begun) = self.begun.iter_mut().find(|begun| begun.number == round)
                    && begun.waiting.remove(&index).is_some()
                {
                    member.remember(took);
                    begun.round.done.push((index, *done));
                }
            }
            Answer::Traced(_, _, Err(why)) => {
                self.notes.push(left(&why));
                member.failed = true;
                member.state = State::Out(why);
                self.lose(index);
            }
        }
    }
}

impl Member {
    /// How long its next part may take.
    fn patience(&self) -> Duration {
        let usual = |seconds: f64| PATIENCE.max(Duration::from_secs_f64(seconds * PATIENCE_FACTOR));
        self.usual.map_or(BUILDING.end, usual)
    }

    /// The longest of the last parts counts, and is forgotten slowly.
    fn remember(&mut self, took: Duration) {
        self.usual = Some(took.as_secs_f64().max(self.usual.unwrap_or(0.0) * 0.9));
    }
}

impl Drop for Fleet {
    fn drop(&mut self) {
        for (index, member) in self.members.iter_mut().enumerate() {
            member.orders = None;
            let works = self.begun.iter().any(|begun| begun.waiting.contains_key(&index));
            // A thread whose driver hangs, may hang with what nobody waits for, or is being tried again is left to itself.
            if member.state == State::Ready
                && !works
                && let Some(thread) = member.thread.take()
            {
                let _ = thread.join();
            }
        }
    }
}
