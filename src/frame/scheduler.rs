//! The devices that trace a frame's views, each its part.

use std::sync::Arc;
use std::time::Duration;

use super::balance::{Balancer, Observation, Slice};
use crate::error::{Error, Result};
use crate::foveation::Part;
use crate::gpu::opencl::Device;
use crate::trace::{Fleet, Job, PartResult, State, Turn};
use crate::{progress, waiting};

/// How long a frame waits for a device to come back when none is left, unless told otherwise.
const COMEBACK: Duration = Duration::from_secs(60);

/// What a device did in a frame.
#[derive(Clone, Debug, Default, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct DeviceShare {
    /// Samples that it traced.
    pub samples: u64,
    /// Device time of camera rays and visibility, in milliseconds.
    pub trace_ms: f64,
    /// Device time of shading.
    pub shade_ms: f64,
    /// Device time of the cache of light, which each device keeps by itself.
    #[serde(default)]
    pub light_ms: f64,
    /// Copying its results, where they do not land in place.
    pub copy_ms: f64,
}

/// What the devices did for one view.
#[derive(Clone, Debug, Default)]
pub struct ViewReport {
    /// Camera rays and light rays.
    pub rays: u64,
    /// What each device did.
    pub devices: Vec<DeviceShare>,
}

/// A view that devices have begun with.
pub struct BegunView {
    job: Arc<Job>,
    /// None where there was no device to begin with it.
    round: Option<u64>,
}

/// A fleet, and who gets which part of each view.
pub struct Scheduler {
    fleet: Fleet,
    balancer: Balancer,
    /// Writes results in place: the fleet's first device.
    direct: Option<Device>,
    losses: u64,
    comeback: Duration,
}

impl Scheduler {
    /// `direct` is the fleet's first device, where it writes results in place.
    pub fn new(fleet: Fleet, direct: Option<Device>) -> Self {
        Scheduler { balancer: Balancer::new(fleet.count()), fleet, direct, losses: 0, comeback: COMEBACK }
    }

    /// The device that writes results in place, as long as it does.
    pub fn direct(&self) -> Option<&Device> {
        self.direct.as_ref()
    }

    /// How often something that devices had begun with was given up. Who has it may still write to where its results were to
    /// go.
    pub fn losses(&self) -> u64 {
        self.losses
    }

    /// The devices.
    pub fn fleet(&self) -> &Fleet {
        &self.fleet
    }

    /// A frame waits so long for a device to come back when none is left: a minute, unless told otherwise. What is
    /// longer than a second is told at once.
    pub fn set_comeback(&mut self, comeback: Duration) {
        self.comeback = comeback;
    }

    /// Sentences for the operator, each once.
    pub fn take_notes(&mut self) -> Vec<String> {
        self.fleet.take_notes()
    }

    /// Forgets views that were begun and not waited for, as of a frame that has failed: to be called before a frame's targets
    /// are made, since devices may still write to the last ones.
    pub fn forget(&mut self) {
        self.losses += self.fleet.forget() as u64;
    }

    /// Has devices begin with views that follow each other; each is to be waited for by [`Scheduler::end`], in their order.
    pub fn begin(&mut self, jobs: Vec<Arc<Job>>) -> Vec<BegunView> {
        self.fleet.refresh();
        self.know_present();
        let parts: Vec<_> = jobs.iter().map(|job| self.balancer.split(job.index, &job.workload)).collect();
        let idle: Vec<bool> = parts.iter().map(Vec::is_empty).collect();
        let rounds = self.fleet.begin(jobs.iter().cloned().zip(parts).collect());
        let begun = jobs.into_iter().zip(rounds).zip(idle);
        begun.map(|((job, round), idle)| BegunView { job, round: (!idle).then_some(round) }).collect()
    }

    /// Waits for a view, whose results are in its sample target afterwards. What a device leaves undone, the
    /// others do at once.
    ///
    /// # Errors
    /// [`Error::NoDevice`] where no device is left.
    pub fn end(&mut self, view: BegunView) -> Result<ViewReport> {
        let BegunView { mut job, round } = view;
        let workload = &job.workload.clone();
        let mut report = ViewReport { devices: vec![DeviceShare::default(); self.fleet.count()], rays: 0 };
        let (mut done, mut lost) = (Vec::new(), Vec::new());
        let mut round = round.map(|round| self.fleet.end(round));
        loop {
            let Some(ended) = round else {
                let parts = self.wait_for_one(&job)?;
                // What was done before is done anew.
                (done, lost) = (Vec::new(), Vec::new());
                round = Some(self.fleet.trace(&job, parts));
                continue;
            };
            self.losses += ended.lost.len() as u64;
            done.extend(ended.done);
            lost.extend(ended.lost);
            let Some(part) = lost.pop() else { break };
            self.know_present();
            job = Arc::new(Job { direct: false, ..Job::clone(&job) });
            let parts = self.balancer.split_part(job.index, workload, part);
            round = if parts.is_empty() { None } else { Some(self.fleet.trace(&job, parts)) };
        }
        // Only now: the device that writes in place also describes tiles around its part.
        done.iter().for_each(|(_, done)| job.sample_target.take(&job, done));
        done.iter().for_each(|(device, done)| report.add(*device, done));
        // Samples that take turns cost less than they will.
        if self.fleet.count() > 1 && job.settings.turn == Turn::ALL {
            let observed: Vec<Observation> =
                done.into_iter().map(|(device, done)| observation(device, done)).collect();
            self.balancer.observe(job.index, workload, &job.sample_target.seen(workload), &observed);
        }
        Ok(report)
    }

    /// The whole view for a device that has come back, where all had left.
    fn wait_for_one(&mut self, job: &Job) -> Result<Vec<(usize, Part)>> {
        let mut notes = self.fleet.take_notes();
        if self.comeback >= Duration::from_secs(1) {
            let seconds = self.comeback.as_secs();
            notes.push(format!(
                "no device is left to trace with; waiting {seconds} s for one to come back, Ctrl-C ends"
            ));
            notes.drain(..).for_each(|note| progress::complain(&note));
        }
        while self.fleet.wait(self.comeback) {
            self.know_present();
            let parts = self.balancer.split(job.index, &job.workload);
            if !parts.is_empty() {
                return Ok(parts);
            }
        }
        if self.comeback >= Duration::from_secs(1) {
            waiting::give_up();
        }
        notes.extend(self.fleet.take_notes());
        notes.push("run `foveate devices`, and start the program again when it lists one".to_string());
        let problem = format!("none is left to trace with; {}", notes.join("; "));
        Err(Error::NoDevice { kind: "OpenCL", problem })
    }

    fn know_present(&mut self) {
        for device in 0..self.fleet.count() {
            self.balancer.set_present(device, *self.fleet.state(device) == State::Ready);
        }
        // A device that has failed may still write where it wrote, and another one takes its place.
        if *self.fleet.state(0) != State::Ready {
            self.direct = None;
        }
    }
}

impl ViewReport {
    fn add(&mut self, device: usize, done: &PartResult) {
        self.rays += done.rays;
        let share = &mut self.devices[device];
        share.samples += done.part.samples.len() as u64;
        share.trace_ms += done.slices.iter().map(|(_, ms)| ms[0]).sum::<f64>();
        share.shade_ms += done.slices.iter().map(|(_, ms)| ms[1]).sum::<f64>();
        share.light_ms += done.light_ms;
        share.copy_ms += done.copy_ms;
    }

    /// The device that took longest.
    pub fn slowest(&self) -> DeviceShare {
        self.devices.iter().max_by(|a, b| a.busy_ms().total_cmp(&b.busy_ms())).cloned().unwrap_or_default()
    }
}

impl DeviceShare {
    /// All of its time, in milliseconds.
    pub fn busy_ms(&self) -> f64 {
        self.trace_ms + self.shade_ms + self.light_ms + self.copy_ms
    }

    /// Adds what it did for another view.
    pub fn add(&mut self, other: &DeviceShare) {
        self.samples += other.samples;
        self.trace_ms += other.trace_ms;
        self.shade_ms += other.shade_ms;
        self.light_ms += other.light_ms;
        self.copy_ms += other.copy_ms;
    }
}

fn observation(device: usize, done: PartResult) -> Observation {
    let slice = |(part, [pixels_ms, samples_ms]): (Part, [f64; 2])| Slice { part, pixels_ms, samples_ms };
    let overhead_ms = done.copy_ms + done.light_ms;
    Observation { device, slices: done.slices.into_iter().map(slice).collect(), overhead_ms }
}
