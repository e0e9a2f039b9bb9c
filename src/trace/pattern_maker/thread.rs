//! A device's patterns, on a thread of its own: a driver that builds, fails or hangs holds up nobody for long.

use std::collections::HashSet;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use glam::DVec2;

use super::{NeighbourLists, PatternMaker, PatternRequest, PatternTables};
use crate::foveation::{Law, Pattern};
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::Context;
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::waiting::{self, Limits};

/// A pattern takes milliseconds; who takes so long is not asked again.
const PATIENCE: Limits = Limits { told: Duration::from_secs(3), end: Duration::from_secs(3) };

/// Whether a device is asked for patterns and neighbours in this process, or why not: see [`Patterns::of`].
pub type Trial = fn(&Device, Option<&(Context, NeighbourLists)>) -> Result<(), String>;

type Made = (Pattern, PatternTables);

/// What a device's thread tells.
enum Told {
    /// Kernels are built; what the operator should know of them.
    Ready(Option<String>),
    Made(Made),
}

/// Why there will be no more, otherwise.
type Answer = Result<Told, String>;

/// What a thread is at before it is ready.
#[derive(Clone, Copy, PartialEq)]
enum Stage {
    /// Another process tries the kernels.
    Trial,
    /// This one's driver builds or runs them.
    Driver,
    /// Nothing any more, since nobody waits.
    Left,
}

/// Patterns from a device, as far as it serves.
pub struct Patterns {
    /// The device, as long as it has not failed.
    device: Option<Device>,
    /// The presenting device whose memory it sees, if it does, and which neighbours that wants.
    neighbours: Option<(Context, NeighbourLists)>,
    trial: Trial,
    /// From when it is first asked.
    working: Option<Working>,
    notes: Vec<String>,
}

struct Working {
    name: String,
    wanted: Option<Sender<PatternRequest>>,
    stage: Arc<Mutex<Stage>>,
    /// The first says that kernels are built.
    made: Receiver<Answer>,
    thread: Option<JoinHandle<()>>,
    ready: bool,
}

impl Patterns {
    /// Those of a device, if there is one; with their neighbours where it sees a presenting device's memory. Nothing is
    /// built before a pattern is wanted, and then only where `trial` has no reason against it.
    pub fn of(device: Option<Device>, neighbours: Option<(Context, NeighbourLists)>, trial: Trial) -> Self {
        Patterns { device, neighbours, trial, working: None, notes: Vec::new() }
    }

    /// Other neighbours are wanted from now on.
    pub fn set_lists(&mut self, lists: NeighbourLists) {
        if let Some((_, old)) = self.neighbours.as_mut().filter(|(_, old)| *old != lists) {
            *old = lists;
            let old = self.working.take();
            // A driver that builds is waited for by nobody who makes frames; without a thread it is.
            let _ = std::thread::Builder::new().spawn(move || drop(old));
        }
    }

    /// Whether a pattern can be had at once.
    pub fn is_ready(&self) -> bool {
        self.working.as_ref().is_some_and(|working| working.ready)
    }

    /// A pattern, with its samples sorted for searches or these done. `None` while kernels are built, and where the device has failed:
    /// then the host makes it.
    pub fn choose(&mut self, wanted: &PatternRequest) -> Option<Made> {
        if self.working.is_none() {
            let device = self.device.clone()?;
            self.working = Working::begin(device, self.neighbours.clone(), self.trial, wanted.clone());
        }
        match self.working.as_mut()?.choose(wanted, &mut self.notes) {
            Ok(made) => made,
            Err(why) => {
                self.notes.push(format!("patterns are made by the host from now on, since {why}"));
                (self.working, self.device) = (None, None);
                None
            }
        }
    }

    /// What the operator should know, once.
    pub fn take_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }
}

impl Working {
    /// Has kernels built, and used once for a pattern like the first one wanted, since drivers end building at launches.
    /// None where there is no thread for it.
    fn begin(
        device: Device,
        neighbours: Option<(Context, NeighbourLists)>,
        trial: Trial,
        first: PatternRequest,
    ) -> Option<Self> {
        let ((wanted, received), (answer, made)) = (channel::<PatternRequest>(), channel());
        let name = device.info().name.clone();
        let stage = Arc::new(Mutex::new(Stage::Trial));
        let own = stage.clone();
        let work = move || {
            let ready = first_maker(&device, neighbours.as_ref(), trial, &first, &own);
            let (mut maker, note) = match ready {
                Ok(ready) => ready,
                Err(why) => return drop(answer.send(Err(why))),
            };
            let mut answered = Ok(Told::Ready(note));
            loop {
                let ends = answered.is_err();
                if answer.send(answered).is_err() || ends {
                    return;
                }
                let Ok(next) = received.recv() else { return };
                answered = maker.choose(&next).map(Told::Made).map_err(|error| error.to_string());
            }
        };
        let thread = std::thread::Builder::new().name("patterns".to_string()).spawn(work).ok()?;
        Some(Working { name, wanted: Some(wanted), stage, made, thread: Some(thread), ready: false })
    }

    /// A pattern, or none where kernels are not built yet.
    fn choose(&mut self, wanted: &PatternRequest, notes: &mut Vec<String>) -> Result<Option<Made>, String> {
        let gone = || Err(format!("{} answers no more", self.name));
        if !self.ready {
            match self.made.try_recv() {
                Ok(Ok(Told::Ready(note))) => {
                    notes.extend(note);
                    self.ready = true;
                }
                Ok(Ok(Told::Made(_))) => return gone().map(|()| None),
                Ok(Err(why)) => return Err(why),
                Err(TryRecvError::Empty) => return Ok(None),
                Err(TryRecvError::Disconnected) => return gone().map(|()| None),
            }
        }
        if self.wanted.as_ref().is_none_or(|sender| sender.send(wanted.clone()).is_err()) {
            return gone().map(|()| None);
        }
        let answer = waiting::wait_for(&self.name, PATIENCE, |step| match self.made.recv_timeout(step) {
            Ok(Ok(Told::Made(made))) => Some(Ok(Some(made))),
            Ok(Ok(Told::Ready(_))) | Err(RecvTimeoutError::Timeout) => None,
            Ok(Err(why)) => Some(Err(why)),
            Err(RecvTimeoutError::Disconnected) => Some(gone().map(|()| None)),
        });
        answer.unwrap_or_else(|| {
            // Its driver may hang: nobody waits for the thread.
            self.thread = None;
            Err(format!("{} has not answered for {} s", self.name, PATIENCE.end.as_secs()))
        })
    }
}

impl Drop for Working {
    fn drop(&mut self) {
        self.wanted = None;
        let mut stage = self.stage.lock().unwrap_or_else(PoisonError::into_inner);
        if std::mem::replace(&mut *stage, Stage::Left) == Stage::Trial {
            // The other process ends with this one at the latest.
            return;
        }
        drop(stage);
        let Some(thread) = self.thread.take() else { return };
        // A driver that builds is not left alone with a program that ends, unless it hangs.
        let ended = waiting::wait_for(&self.name, Limits::MOMENTS, |step| {
            let waiting = self.made.recv_timeout(step);
            matches!(waiting, Err(RecvTimeoutError::Disconnected)).then_some(())
        });
        match ended {
            Some(()) => drop(thread.join()),
            None => waiting::give_up(),
        }
    }
}

/// A maker that has proven itself and made a first pattern. Where a device's kernels for neighbours are of no use, one without,
/// and why.
fn first_maker(
    device: &Device,
    neighbours: Option<&(Context, NeighbourLists)>,
    trial: Trial,
    first: &PatternRequest,
    stage: &Mutex<Stage>,
) -> Result<(PatternMaker, Option<String>), String> {
    let goes_on_to = |next: Stage| {
        let mut stage = stage.lock().unwrap_or_else(PoisonError::into_inner);
        let goes_on = *stage != Stage::Left;
        if goes_on {
            *stage = next;
        }
        goes_on.then_some(()).ok_or_else(|| "nobody waits".to_string())
    };
    let prove = |neighbours: Option<&(Context, NeighbourLists)>| {
        goes_on_to(Stage::Trial)?;
        trial(device, neighbours)
            .map_err(|why| format!("a trial of {} failed: {why}", device.info().name))?;
        goes_on_to(Stage::Driver)?;
        let mut maker = PatternMaker::proven(device, neighbours)?;
        maker.choose(first).map_err(|error| error.to_string())?;
        Ok(maker)
    };
    match prove(neighbours) {
        Ok(maker) => Ok((maker, None)),
        Err(why) if neighbours.is_some() => {
            let note = format!("neighbours are found by the presenting device, since {why}");
            prove(None).map(|maker| (maker, Some(note)))
        }
        Err(why) => Err(why),
    }
}

impl PatternMaker {
    /// A maker that has made two small patterns as the host does, and found their neighbours where they are wanted.
    ///
    /// # Errors
    /// Why it has not, as the end of a sentence.
    pub fn proven(device: &Device, neighbours: Option<&(Context, NeighbourLists)>) -> Result<Self, String> {
        let text = |error: crate::Error| error.to_string();
        let mut maker = match neighbours {
            Some((context, lists)) => PatternMaker::with_neighbours(device, context, *lists),
            None => PatternMaker::new(device),
        }
        .map_err(text)?;
        let name = &device.info().name;
        for request in [small(), sparse()] {
            let (pattern, tables) = maker.choose(&request).map_err(text)?;
            if !is_like(&pattern, &request.on_host()) {
                return Err(format!("{name} chooses other samples than it should; update its driver"));
            }
            let size = [request.view.width, request.view.height];
            if let PatternTables::Neighbours(found) = tables
                && !found.are_right(size, &pattern.samples)
            {
                return Err(format!("{name} finds other neighbours than it should; update its driver"));
            }
        }
        Ok(maker)
    }
}

/// Whether two patterns differ by no more than divisions that are rounded otherwise make a difference: in one of fifty samples.
fn is_like(pattern: &Pattern, expected: &Pattern) -> bool {
    let own: HashSet<u32> = pattern.samples.iter().copied().collect();
    let common = expected.samples.iter().filter(|sample| own.contains(sample)).count();
    let count = expected.samples.len();
    pattern.samples.len() == count && own.len() == count && (count - common) * 50 <= count
}

/// A pattern to look at what a device makes of it.
fn small() -> PatternRequest {
    let fov = FieldOfView::symmetric(1.0, 1.0);
    let spacing = Default::default();
    let view = View { world_from_eye: Pose::IDENTITY, fov, width: 128, height: 96, spacing };
    PatternRequest {
        view,
        law: Law::default(),
        gaze: DVec2::splat(0.5),
        count: 800,
        hidden: None,
        lens: None,
    }
}

/// One whose samples lie far from each other, in a view of odd sizes.
fn sparse() -> PatternRequest {
    let mut request = small();
    (request.view.width, request.view.height, request.count) = (403, 9, 61);
    request.gaze = DVec2::new(0.1, 0.5);
    request
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use super::*;
    use crate::reference::reconstruct::WeightKind;
    use crate::trace::pattern_maker::testing;

    /// Patterns come from the device once its kernels are built, and are the host's.
    #[test]
    fn patterns_come_from_the_device_once_it_is_ready() {
        let Some(device) = testing::processor() else { return };
        let mut patterns = Patterns::of(Some(device.clone()), None, |_, _| Ok(()));
        let mut made = None;
        assert!(!patterns.is_ready(), "nothing is built yet");
        for _ in 0..6000 {
            made = patterns.choose(&small());
            if made.is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let (pattern, _) = made.expect("a pattern within a minute");
        assert!(pattern == small().on_host() && patterns.is_ready());
        assert!(patterns.choose(&small()).is_some() && patterns.take_notes().is_empty());
        // Ended while it builds: waits for that and hangs no longer.
        drop(Working::begin(device, None, |_, _| Ok(()), small()));
    }

    /// Asks somebody whose thread does this with each pattern wanted.
    fn asked(work: impl Fn(&Sender<Answer>) + Send + 'static) -> (bool, Vec<String>) {
        let ((wanted, received), (answer, made)) = (channel::<PatternRequest>(), channel());
        let thread = std::thread::spawn(move || received.iter().for_each(|_| work(&answer)));
        let (name, wanted, thread) = ("it".to_string(), Some(wanted), Some(thread));
        let stage = Arc::new(Mutex::new(Stage::Driver));
        let working = Working { name, wanted, stage, made, thread, ready: true };
        let mut patterns = Patterns {
            device: None,
            neighbours: None,
            trial: |_, _| Ok(()),
            working: Some(working),
            notes: Vec::new(),
        };
        let made = patterns.choose(&small()).is_some();
        assert!(patterns.choose(&small()).is_none(), "it is not asked again");
        (made, patterns.take_notes())
    }

    #[test]
    fn a_device_that_fails_or_hangs_is_not_asked_again() {
        assert!(Patterns::of(None, None, |_, _| Ok(())).choose(&small()).is_none());
        let (made, notes) = asked(|answer| answer.send(Err("it is lost".to_string())).unwrap());
        assert!(!made && notes.len() == 1 && notes[0].ends_with("it is lost"), "{notes:?}");
        let (made, notes) = asked(|_| std::thread::sleep(Duration::from_secs(3600)));
        assert!(!made && notes.len() == 1 && notes[0].contains("has not answered for 3 s"), "{notes:?}");
    }

    /// A device that fails its trial is told of once, and nothing is built for it.
    #[test]
    fn a_device_that_fails_its_trial_makes_no_patterns() {
        let Some(device) = testing::processor() else { return };
        let trial: Trial = |_, _| Err("its driver crashed".to_string());
        let mut patterns = Patterns::of(Some(device), None, trial);
        for _ in 0..1000 {
            assert!(patterns.choose(&small()).is_none());
            if patterns.device.is_none() {
                break;
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        let notes = patterns.take_notes();
        assert!(notes.len() == 1 && notes[0].ends_with("its driver crashed"), "{notes:?}");
        assert!(patterns.choose(&small()).is_none() && patterns.take_notes().is_empty());
    }

    /// Where neighbours' kernels are of no use, patterns are made all the same, and their neighbours elsewhere.
    #[test]
    fn patterns_are_made_without_neighbours_where_these_fail() {
        let Some(device) = testing::processor() else { return };
        let Some(context) = crate::gpu::vulkan::testing::context() else { return };
        let lists = NeighbourLists { of_pixel: 4, of_sample: 24, weights: WeightKind::Shepard };
        let trial: Trial =
            |_, neighbours| neighbours.map_or(Ok(()), |_| Err("its driver crashed".to_string()));
        let stage = Mutex::new(Stage::Trial);
        let (mut maker, note) =
            first_maker(&device, Some(&(context, lists)), trial, &small(), &stage).unwrap();
        assert!(note.unwrap().ends_with("failed: its driver crashed"));
        assert!(matches!(maker.choose(&small()).unwrap().1, PatternTables::Cells(_)));
    }

    /// Who leaves while another process tries kernels waits for nobody, and this process builds none.
    #[test]
    fn nobody_waits_for_a_trial() {
        let Some(device) = testing::processor() else { return };
        static BEGUN: AtomicBool = AtomicBool::new(false);
        let trial: Trial = |_, _| {
            BEGUN.store(true, Ordering::Relaxed);
            std::thread::sleep(Duration::from_secs(3600));
            Ok(())
        };
        let working = Working::begin(device.clone(), None, trial, small());
        while !BEGUN.load(Ordering::Relaxed) {
            std::thread::sleep(Duration::from_millis(5));
        }
        let start = std::time::Instant::now();
        drop(working);
        assert!(start.elapsed() < Duration::from_secs(60));
        let left = first_maker(&device, None, |_, _| Ok(()), &small(), &Mutex::new(Stage::Left));
        assert_eq!(left.err().as_deref(), Some("nobody waits"));
    }

    #[test]
    fn other_samples_are_told_from_those_that_differ_by_rounding() {
        let expected = small().on_host();
        let mut other = expected.clone();
        // Where the view has no pixels.
        other.samples[..16].iter_mut().for_each(|sample| *sample += 1 << 28);
        assert!(is_like(&expected, &expected) && is_like(&other, &expected));
        other.samples[..17].iter_mut().for_each(|sample| *sample += 1 << 28);
        assert!(!is_like(&other, &expected));
        other.samples.clone_from(&expected.samples);
        other.samples[0] = other.samples[1];
        assert!(!is_like(&other, &expected), "none twice");
    }
}
