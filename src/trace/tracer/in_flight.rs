//! Work that a device was given and is not done with.

use super::Traced;
use crate::error::Result;
use crate::gpu::opencl::{Event, Transfer};

/// A step of work, and how long it takes.
#[derive(Debug)]
pub(in crate::trace) enum Step {
    /// A kernel's, known when it is done.
    Kernel(Event),
    /// What was done elsewhere, in milliseconds.
    Elsewhere(f64),
}

impl From<Event> for Step {
    fn from(event: Event) -> Step {
        Step::Kernel(event)
    }
}

impl Step {
    fn ms(&self) -> f64 {
        match self {
            Step::Kernel(event) => event.device_ms(),
            Step::Elsewhere(ms) => *ms,
        }
    }
}

/// Work under way: steps whose times are read when it is done.
#[derive(Debug)]
pub struct InFlight {
    /// Each part's camera rays and visibility, and its shading.
    pub(super) parts: Vec<(Vec<Step>, Vec<Step>)>,
    pub(super) camera_rays: u64,
    /// See [`crate::trace::light_cache::Counters`]: the last that the queue does for it.
    pub(super) counters: Transfer<Vec<u32>>,
    /// The host's side of what is copied to the device meanwhile.
    pub(super) _copied: Option<Transfer<Vec<u32>>>,
}

impl InFlight {
    /// Waits until it is done.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device is lost.
    pub(in crate::trace) fn wait(&self) -> Result<()> {
        self.counters.wait()
    }

    /// Waits, and tells what was done.
    pub(super) fn finish(self, is_timed: bool) -> Result<Traced> {
        let counters = self.counters.into_memory()?;
        // Of a device that times nothing, steps elsewhere alone would pass for all of them.
        let of_steps = |steps: &[Step]| if is_timed { steps.iter().map(Step::ms).sum() } else { 0.0 };
        let times = |(trace, shade): &(Vec<Step>, Vec<Step>)| [of_steps(trace), of_steps(shade)];
        let parts_ms: Vec<[f64; 2]> = self.parts.iter().map(times).collect();
        Ok(Traced {
            rays: self.camera_rays + u64::from(counters[0]),
            light_rays: counters[2].into(),
            dropped: counters[1],
            trace_ms: parts_ms.iter().map(|ms| ms[0]).sum(),
            shade_ms: parts_ms.iter().map(|ms| ms[1]).sum(),
            parts_ms,
        })
    }
}
