//! Several devices that share each frame.
//!
//! Each has a thread of its own, which opens it, has it show that it computes what it should
//! (`src/trace/self_test.rs`), traces its parts, and opens it anew after a failure, at growing intervals. A
//! driver that hangs holds up nobody else: after a while its part goes to the others in the same frame, and
//! it may take part again once it answers. `Worker` is what a fleet has of a device; tests give it some that
//! fail. Each device has a context and a copy of the scene of its own, although devices of one platform could
//! share a context: nothing is shared between devices but what the host packs once and keeps for those that
//! come back, and in a common context buffers may be kept for, moved to, or lost with each device in it, as
//! the driver likes. The first device writes results in place where memory is shared; the others' are copied,
//! samples as they are and visibility packed tile by tile (`kernels/gather.cl`).

use std::collections::HashMap;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::worker::{DeviceWorker, Job, PartResult, Worker};
use super::{SceneData, Traversals};
use crate::error::{Error, Result};
use crate::foveation::Part;
use crate::gpu::opencl::Device;
use crate::progress;
use crate::waiting::{self, Limits};

/// Opens a worker: called on the worker's own thread, at start and again after a failure. The number counts the
/// times.
pub type Opener = Box<dyn Fn(u32) -> Result<Box<dyn Worker>> + Send>;

/// A device, and its variants of the kernels or why it is of no use.
pub type Tried = (Device, std::result::Result<Traversals, String>);

/// How long devices may take to open, and for their first part: drivers build kernels meanwhile.
const BUILDING: Limits = Limits::BUILDING;
/// A part may take this long at least, and this many times as long as parts have taken lately.
const PATIENCE: Duration = Duration::from_secs(3);
const PATIENCE_FACTOR: f64 = 20.0;
/// A failed device is tried again after this time, which doubles with each failure.
const RETRY: Duration = Duration::from_millis(500);
const RETRY_LONGEST: Duration = Duration::from_secs(60);

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
    round: u64,
    notes: Vec<String>,
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

struct Order {
    round: u64,
    job: Arc<Job>,
    part: Part,
}

enum Answer {
    Opened(std::result::Result<(), String>),
    /// The round that it belongs to, and the result.
    Traced(u64, std::result::Result<Box<PartResult>, String>),
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
        Self::of_tried(&fit, data, direct)
    }

    /// The same where some devices are known to be of no use, and why: they are left out with that sentence.
    ///
    /// # Errors
    /// As [`Fleet::of_devices`].
    pub fn of_tried(devices: &[Tried], data: &Arc<SceneData>, direct: bool) -> Result<Fleet> {
        let opener = |(index, (device, traversals)): (usize, &Tried)| {
            let (device, traversals, data) = (device.clone(), traversals.clone(), data.clone());
            let mut name = device.info().name.clone();
            let twin = |other: &&Tried| other.0.info().name == name;
            if devices.iter().filter(twin).count() > 1 {
                name += &format!(" (number {})", devices[..=index].iter().filter(twin).count());
            }
            let open: Opener = Box::new(move |times| {
                let traversals = traversals
                    .clone()
                    .map_err(|problem| Error::Device { device: device.info().name.clone(), problem })?;
                Ok(Box::new(match times {
                    0 => DeviceWorker::new(&device, &data, traversals, direct && index == 0)?,
                    _ => DeviceWorker::reopen(device.info(), &data, traversals)?,
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
        let mut fleet = Fleet { members: members.collect(), answers, round: 0, notes: Vec::new() };
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
            drop(self.hear(index, answer));
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
                Ok((index, answer)) => drop(self.hear(index, answer)),
                Err(_) if left.is_zero() || waiting::leaves(start.elapsed()) => return false,
                Err(_) => {}
            }
        }
        true
    }

    /// Hears of devices that have come back.
    pub fn refresh(&mut self) {
        while let Ok((index, answer)) = self.answers.try_recv() {
            drop(self.hear(index, answer));
        }
    }

    /// Has parts traced, all at the same time, and waits for them. A device that fails or is late leaves its
    /// part undone.
    pub fn trace(&mut self, job: &Arc<Job>, parts: &[(usize, Part)]) -> Round {
        self.round += 1;
        let (mut round, start) = (Round::default(), Instant::now());
        let mut silent_at = Some(start + BUILDING.told);
        let mut waiting: HashMap<usize, (Part, Instant)> = HashMap::new();
        for (index, part) in parts {
            let order = Order { round: self.round, job: job.clone(), part: part.clone() };
            let member = &self.members[*index];
            let send = |orders: &Sender<Order>| orders.send(order).is_ok();
            if member.state == State::Ready && member.orders.as_ref().is_some_and(send) {
                waiting.insert(*index, (part.clone(), start + member.patience()));
            } else {
                round.lost.push(part.clone());
            }
        }
        while let Some(deadline) = waiting.values().map(|(_, deadline)| *deadline).min() {
            let left = deadline.saturating_duration_since(Instant::now());
            match self.answers.recv_timeout(left.min(waiting::STEP)) {
                Ok((index, answer)) => {
                    let done = self.hear(index, answer);
                    if self.members[index].state != State::Ready {
                        round.lost.extend(waiting.remove(&index).map(|(part, _)| part));
                    } else if let Some(done) = done
                        && waiting.remove(&index).is_some()
                    {
                        self.members[index].remember(start.elapsed());
                        round.done.push((index, done));
                    }
                }
                Err(RecvTimeoutError::Timeout) => {
                    let now = Instant::now();
                    let leaves = waiting::leaves(start.elapsed());
                    if silent_at.take_if(|at| *at <= now).is_some() {
                        self.tell_silent(waiting.keys());
                    }
                    let is_late = |deadline: Instant| deadline <= now || leaves;
                    let late: Vec<usize> =
                        waiting.iter().filter(|(_, w)| is_late(w.1)).map(|(&index, _)| index).collect();
                    for index in late {
                        round.lost.extend(waiting.remove(&index).map(|(part, _)| part));
                        self.leave_late(index);
                    }
                }
                Err(RecvTimeoutError::Disconnected) => {
                    round.lost.extend(waiting.drain().map(|(_, (part, _))| part));
                }
            }
        }
        round
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
        let rest = match self.members.iter().any(|m| m.state == State::Ready) {
            true => "; the others do its part until it does",
            false => "",
        };
        self.notes.push(format!("{} does not answer{rest}", self.members[index].name));
    }

    /// Takes an answer in; what was traced in this round is handed on.
    fn hear(&mut self, index: usize, answer: Answer) -> Option<PartResult> {
        let others = self.members.iter().enumerate().any(|(i, m)| i != index && m.state == State::Ready);
        let left =
            |why: &str| if others { format!("{why}; the others do its part") } else { why.to_string() };
        let member = &mut self.members[index];
        match answer {
            Answer::Opened(Ok(())) => {
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
            Answer::Traced(round, Ok(done)) => {
                if member.state == State::Late {
                    self.notes.push(format!("{} answers again", member.name));
                    member.state = State::Ready;
                }
                return (round == self.round).then_some(*done);
            }
            Answer::Traced(_, Err(why)) => {
                self.notes.push(left(&why));
                member.failed = true;
                member.state = State::Out(why);
            }
        }
        None
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
        for member in &mut self.members {
            member.orders = None;
            // A thread whose driver hangs or is being tried again is left to itself.
            if member.state == State::Ready
                && let Some(thread) = member.thread.take()
            {
                let _ = thread.join();
            }
        }
    }
}

/// A device's thread: ends when nobody is left to give orders.
fn work(index: usize, open: &Opener, orders: &Receiver<Order>, answer: &Sender<(usize, Answer)>) {
    let mut pause = RETRY;
    for times in 0.. {
        let opened = open(times);
        let told = opened.as_ref().map(drop).map_err(ToString::to_string);
        if answer.send((index, Answer::Opened(told))).is_err() {
            return;
        }
        if let Ok(mut worker) = opened {
            loop {
                let Ok(order) = orders.recv() else { return };
                let traced = worker.trace(&order.job, &order.part);
                let failed = traced.is_err();
                let told = traced.map(Box::new).map_err(|error| error.to_string());
                if answer.send((index, Answer::Traced(order.round, told))).is_err() {
                    return;
                }
                if failed {
                    if worker.is_lost() {
                        std::mem::forget(worker);
                    }
                    break;
                }
                pause = RETRY;
            }
        } else if times == 0 {
            // What cannot be used at the start is left out for good.
            return;
        }
        let until = Instant::now() + pause;
        pause = (pause * 2).min(RETRY_LONGEST);
        loop {
            match orders.recv_timeout(until.saturating_duration_since(Instant::now())) {
                Ok(_) => {}
                Err(RecvTimeoutError::Timeout) => break,
                Err(RecvTimeoutError::Disconnected) => return,
            }
        }
    }
}
