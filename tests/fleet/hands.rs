//! Devices that misbehave.

use std::time::Duration;

use foveate::error::{Error, Result};
use foveate::foveation::Part;
use foveate::trace::{DeviceWorker, Job, PartResult, Worker};

/// What goes wrong.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    /// The driver refuses.
    Error,
    /// The driver answers far too late.
    Hang,
}

/// A device that goes wrong after some parts, once.
pub struct Failing {
    pub worker: DeviceWorker,
    pub fault: Option<Fault>,
    pub after: u32,
}

impl Worker for Failing {
    fn trace(&mut self, job: &Job, part: &Part) -> Result<PartResult> {
        if self.after > 0 || self.fault.is_none() {
            self.after = self.after.saturating_sub(1);
            return self.worker.trace(job, part);
        }
        match self.fault.take() {
            Some(Fault::Hang) => {
                std::thread::sleep(Duration::from_secs(5));
                self.worker.trace(job, part)
            }
            _ => Err(Error::Device { device: "the second".into(), problem: "it is out of paper".into() }),
        }
    }
}
