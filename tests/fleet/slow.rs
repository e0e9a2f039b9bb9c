//! A slow device.

use foveate::error::Result;
use foveate::foveation::Part;
use foveate::trace::{DeviceHand, Done, Hand, Job};

/// A device that is slowed by a known factor: it does all of its work so many times.
pub struct Slow {
    pub hand: DeviceHand,
    pub times: u32,
}

impl Hand for Slow {
    fn trace(&mut self, job: &Job, part: &Part) -> Result<Done> {
        let mut done = self.hand.trace(job, part)?;
        for _ in 1..self.times {
            let again = self.hand.trace(job, part)?;
            for (sum, more) in done.slices.iter_mut().zip(again.slices) {
                (0..2).for_each(|channel| sum.1[channel] += more.1[channel]);
            }
        }
        Ok(done)
    }
}
