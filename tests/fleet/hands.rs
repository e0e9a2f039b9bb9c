//! Devices that misbehave.

use std::sync::{Arc, Condvar, Mutex};

use foveate::error::{Error, Result};
use foveate::foveation::Part;
use foveate::trace::{DeviceWorker, Job, PartResult, Worker};

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The driver refuses.
    Error,
    /// The driver does not answer until it is released.
    Hang,
}

/// A device that goes wrong after some parts, once.
pub struct Failing {
    pub worker: DeviceWorker,
    pub fault: Option<Fault>,
    pub after: u32,
    pub release: Arc<Release>,
}

/// Lets drivers that hang go on, all of them and from then on.
#[derive(Default)]
pub struct Release {
    over: Mutex<bool>,
    told: Condvar,
}

impl Release {
    pub fn now(&self) {
        *self.over.lock().unwrap() = true;
        self.told.notify_all();
    }

    fn wait(&self) {
        drop(self.told.wait_while(self.over.lock().unwrap(), |over| !*over).unwrap());
    }
}

impl Worker for Failing {
    fn trace(&mut self, job: &Job, part: &Part) -> Result<PartResult> {
        if self.after > 0 || self.fault.is_none() {
            self.after = self.after.saturating_sub(1);
            return self.worker.trace(job, part);
        }
        match self.fault.take() {
            Some(Fault::Hang) => {
                self.release.wait();
                self.worker.trace(job, part)
            }
            _ => Err(Error::Device { device: "the second".into(), problem: "it is out of paper".into() }),
        }
    }
}
