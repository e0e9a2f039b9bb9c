//! A device's patterns, on a thread of its own: a driver that builds, fails or hangs holds up nobody for long.

use std::collections::HashSet;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, TryRecvError, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use glam::DVec2;

use super::{Lists, PatternMaker, PatternRequest, Searched};
use crate::foveation::{Law, Pattern};
use crate::gpu::opencl::Device;
use crate::gpu::vulkan::Context;
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::waiting::{self, Limits};

/// A pattern takes milliseconds; who takes so long is not asked again.
const PATIENCE: Limits = Limits { told: Duration::from_secs(3), end: Duration::from_secs(3) };

/// Whether a device is asked for patterns and neighbours in this process, or why not: see [`Patterns::of`].
pub type Trial = fn(&Device, Option<&(Context, Lists)>) -> Result<(), String>;

type Made = (Pattern, Searched);
/// A pattern, or none where kernels are built, or why there will be no more.
type Answer = Result<Option<Made>, String>;

/// Patterns from a device, as far as it serves.
pub struct Patterns {
    /// The device, as long as it has not failed.
    device: Option<Device>,
    /// The presenting device whose memory it sees, if it does, and which neighbours that wants.
    neighbours: Option<(Context, Lists)>,
    trial: Trial,
    /// From when it is first asked.
    working: Option<Working>,
    notes: Vec<String>,
}

struct Working {
    name: String,
    wanted: Option<Sender<PatternRequest>>,
    /// The first says that kernels are built.
    made: Receiver<Answer>,
    thread: Option<JoinHandle<()>>,
    ready: bool,
}

impl Patterns {
    /// Those of a device, if there is one; with their neighbours where it sees a presenting device's memory. Nothing is
    /// built before a pattern is wanted, and then only where `trial` has no reason against it.
    pub fn of(device: Option<Device>, neighbours: Option<(Context, Lists)>, trial: Trial) -> Self {
        Patterns { device, neighbours, trial, working: None, notes: Vec::new() }
    }

    /// Other neighbours are wanted from now on.
    pub fn look_for(&mut self, lists: Lists) {
        if let Some((_, old)) = self.neighbours.as_mut().filter(|(_, old)| *old != lists) {
            *old = lists;
            self.working = None;
        }
    }

    /// A pattern, with its samples sorted for searches or these done. `None` while kernels are built, and where the device has failed:
    /// then the host makes it.
    pub fn choose(&mut self, wanted: &PatternRequest) -> Option<Made> {
        if self.working.is_none() {
            let device = self.device.clone()?;
            self.working = Working::begin(device, self.neighbours.clone(), self.trial, wanted.clone());
        }
        match self.working.as_mut()?.choose(wanted) {
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
        neighbours: Option<(Context, Lists)>,
        trial: Trial,
        first: PatternRequest,
    ) -> Option<Self> {
        let ((wanted, received), (answer, made)) = (channel::<PatternRequest>(), channel());
        let name = device.info().name.clone();
        let work = move || {
            let prove = || {
                trial(&device, neighbours.as_ref())
                    .map_err(|why| format!("a trial of {} failed: {why}", device.info().name))?;
                let mut maker = PatternMaker::proven(&device, neighbours.as_ref())?;
                maker.choose(&first).map_err(|error| error.to_string())?;
                Ok(maker)
            };
            let mut maker = match prove() {
                Ok(maker) => maker,
                Err(why) => return drop(answer.send(Err(why))),
            };
            let mut answered = Ok(None);
            loop {
                let ends = answered.is_err();
                if answer.send(answered).is_err() || ends {
                    return;
                }
                let Ok(next) = received.recv() else { return };
                answered = maker.choose(&next).map(Some).map_err(|error| error.to_string());
            }
        };
        let thread = std::thread::Builder::new().name("patterns".to_string()).spawn(work).ok()?;
        Some(Working { name, wanted: Some(wanted), made, thread: Some(thread), ready: false })
    }

    /// A pattern, or none where kernels are not built yet.
    fn choose(&mut self, wanted: &PatternRequest) -> Answer {
        let gone = || Err(format!("{} answers no more", self.name));
        if !self.ready {
            match self.made.try_recv() {
                Ok(Ok(_)) => self.ready = true,
                Ok(Err(why)) => return Err(why),
                Err(TryRecvError::Empty) => return Ok(None),
                Err(TryRecvError::Disconnected) => return gone(),
            }
        }
        if self.wanted.as_ref().is_none_or(|sender| sender.send(wanted.clone()).is_err()) {
            return gone();
        }
        let answer = waiting::wait_for(&self.name, PATIENCE, |step| match self.made.recv_timeout(step) {
            Ok(answer) => Some(answer),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => Some(gone()),
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

impl PatternMaker {
    /// A maker that has made a small pattern as the host does, and found its neighbours where they are wanted.
    ///
    /// # Errors
    /// Why it has not, as the end of a sentence.
    pub fn proven(device: &Device, neighbours: Option<&(Context, Lists)>) -> Result<Self, String> {
        let text = |error: crate::Error| error.to_string();
        let mut maker = match neighbours {
            Some((context, lists)) => PatternMaker::with_neighbours(device, context, *lists),
            None => PatternMaker::new(device),
        }
        .map_err(text)?;
        let (view, name) = (small().view, &device.info().name);
        let (pattern, searched) = maker.choose(&small()).map_err(text)?;
        if !is_like(&pattern, &small().on_host()) {
            return Err(format!("{name} chooses other samples than it should; update its driver"));
        }
        match searched {
            Searched::Neighbours(found)
                if !found.are_nearest([view.width, view.height], &pattern.samples) =>
            {
                Err(format!("{name} finds other neighbours than it should; update its driver"))
            }
            _ => Ok(maker),
        }
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::trace::pattern_maker::testing;

    /// Patterns come from the device once its kernels are built, and are the host's.
    #[test]
    fn patterns_come_from_the_device_once_it_is_ready() {
        let Some(device) = testing::processor() else { return };
        let mut patterns = Patterns::of(Some(device.clone()), None, |_, _| Ok(()));
        let mut made = None;
        for _ in 0..6000 {
            made = patterns.choose(&small());
            if made.is_some() {
                break;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
        let (pattern, _) = made.expect("a pattern within a minute");
        assert!(pattern == small().on_host());
        assert!(patterns.choose(&small()).is_some() && patterns.take_notes().is_empty());
        // Ended while it builds: waits for that and hangs no longer.
        drop(Working::begin(device, None, |_, _| Ok(()), small()));
    }

    /// Asks somebody whose thread does this with each pattern wanted.
    fn asked(work: impl Fn(&Sender<Answer>) + Send + 'static) -> (bool, Vec<String>) {
        let ((wanted, received), (answer, made)) = (channel::<PatternRequest>(), channel());
        let thread = std::thread::spawn(move || received.iter().for_each(|_| work(&answer)));
        let (name, wanted, thread) = ("it".to_string(), Some(wanted), Some(thread));
        let working = Working { name, wanted, made, thread, ready: true };
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
