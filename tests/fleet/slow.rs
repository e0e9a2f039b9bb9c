//! A slow device.

use foveate::error::Result;
use foveate::foveation::Part;
use foveate::trace::{DeviceWorker, Job, PartResult, Worker};

/// A device that is slowed by a known factor: it does all of its work so many times.
pub struct Slow {
    pub worker: DeviceWorker,
    pub times: u32,
}

impl Worker for Slow {
    fn trace(&mut self, job: &Job, part: &Part) -> Result<PartResult> {
        let mut done = self.worker.trace(job, part)?;
        for _ in 1..self.times {
            let again = self.worker.trace(job, part)?;
            for (sum, more) in done.slices.iter_mut().zip(again.slices) {
                (0..2).for_each(|channel| sum.1[channel] += more.1[channel]);
            }
        }
        Ok(done)
    }
}
