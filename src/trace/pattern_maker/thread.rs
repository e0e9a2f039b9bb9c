//! A device's patterns, on a thread of its own: a driver that builds, fails or hangs holds up nobody for long.

use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use glam::DVec2;

use super::{PatternMaker, Wanted};
use crate::foveation::{Cells, Law, Pattern};
use crate::gpu::opencl::Device;
use crate::math::pose::Pose;
use crate::math::view::{FieldOfView, View};
use crate::waiting::{self, Limits};

/// A pattern takes milliseconds; who takes so long is not asked again.
const PATIENCE: Duration = Duration::from_secs(3);

/// Patterns from a device, as far as it serves.
pub struct Patterns {
    /// The device, until it is first asked.
    idle: Option<Device>,
    working: Option<Working>,
}

struct Working {
    name: String,
    wanted: Option<Sender<Wanted>>,
    /// The first says that kernels are built.
    made: Receiver<Option<(Pattern, Cells)>>,
    thread: Option<JoinHandle<()>>,
    ready: bool,
}

impl Patterns {
    /// Those of a device, if there is one. Nothing is built before a pattern is wanted.
    pub fn of(device: Option<Device>) -> Self {
        Patterns { idle: device, working: None }
    }

    /// A pattern, with its samples sorted for searches. `None` while kernels are built, and where the device has failed:
    /// then the host makes it.
    pub fn choose(&mut self, wanted: &Wanted) -> Option<(Pattern, Cells)> {
        if let Some(device) = self.idle.take() {
            self.working = Working::begin(device);
        }
        let working = self.working.as_mut()?;
        match working.choose(wanted) {
            Ok(made) => made,
            Err(RecvTimeoutError::Disconnected) => {
                self.working = None;
                None
            }
            Err(RecvTimeoutError::Timeout) => {
                waiting::give_up();
                working.thread = None;
                self.working = None;
                None
            }
        }
    }
}

impl Working {
    /// Has kernels built, and used once, since drivers end building at the first launch. None where there is no thread for it.
    fn begin(device: Device) -> Option<Self> {
        let ((wanted, received), (answer, made)) = (channel::<Wanted>(), channel());
        let name = device.info().name.clone();
        let work = move || {
            let Ok(mut maker) = PatternMaker::new(&device) else { return };
            let mut answered = maker.choose(&small()).map(|_| None);
            while let Ok(pattern) = answered
                && answer.send(pattern).is_ok()
                && let Ok(next) = received.recv()
            {
                answered = maker.choose(&next).map(Some);
            }
        };
        let thread = std::thread::Builder::new().name("patterns".to_string()).spawn(work).ok()?;
        Some(Working { name, wanted: Some(wanted), made, thread: Some(thread), ready: false })
    }

    /// A pattern, or none where kernels are not built yet.
    fn choose(&mut self, wanted: &Wanted) -> Result<Option<(Pattern, Cells)>, RecvTimeoutError> {
        if !self.ready {
            match self.made.recv_timeout(Duration::ZERO) {
                Ok(_) => self.ready = true,
                Err(RecvTimeoutError::Timeout) => return Ok(None),
                Err(gone) => return Err(gone),
            }
        }
        let sent = self.wanted.as_ref().is_some_and(|sender| sender.send(wanted.clone()).is_ok());
        if sent { self.made.recv_timeout(PATIENCE) } else { Err(RecvTimeoutError::Disconnected) }
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

/// A pattern to have kernels built by.
fn small() -> Wanted {
    let fov = FieldOfView::symmetric(1.0, 1.0);
    let spacing = Default::default();
    let view = View { world_from_eye: Pose::IDENTITY, fov, width: 64, height: 64, spacing };
    Wanted { view, law: Law::default(), gaze: DVec2::splat(0.5), count: 100, hidden: None, lens: None }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::gpu::opencl::device;

    /// Patterns come from the device once its kernels are built, and are the host's.
    #[test]
    fn patterns_come_from_the_device_once_it_is_ready() {
        let Some(info) = device::list().into_iter().find(|info| info.unusable.is_none()) else {
            assert!(std::env::var("CI").as_deref() != Ok("true"), "there is no OpenCL device");
            println!("not run: there is no OpenCL device");
            return;
        };
        let mut patterns = Patterns::of(Some(Device::open(&info).unwrap()));
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
        assert!(patterns.choose(&small()).is_some());
        // Ended while it builds: waits for that and hangs no longer.
        drop(Patterns { idle: None, working: Working::begin(Device::open(&info).unwrap()) });
    }

    #[test]
    fn a_device_that_has_failed_is_not_asked_again() {
        assert!(Patterns::of(None).choose(&small()).is_none());
        let ((wanted, received), (answer, made)) = (channel::<Wanted>(), channel());
        let thread = std::thread::spawn(move || {
            answer.send(None).unwrap();
            drop(received.recv());
        });
        while !thread.is_finished() && made.try_recv().is_err() {}
        let working =
            Working { name: String::new(), wanted: Some(wanted), made, thread: Some(thread), ready: true };
        let mut patterns = Patterns { idle: None, working: Some(working) };
        assert!(patterns.choose(&small()).is_none());
        assert!(patterns.working.is_none());
    }
}
