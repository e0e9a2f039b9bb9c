//! One device's share of a frame, from the job to the results that others can use.

use std::sync::Arc;

use super::{InFlight, Past, SceneData, SceneState, Settings, SkyState, TracePattern, Tracer, Traversals};
use crate::error::{Error, Result};
use crate::foveation::workload::{Part, TILE_PIXELS, Workload};
use crate::foveation::{Pattern, pattern::TILE};
use crate::gpu::interop::Shared;
use crate::gpu::opencl::{Buffer, Device, Event, Transfer};
use crate::gpu::vulkan::{BufferRef, Context};
use crate::layout::{SampleRecord, VisibilityRecord};
use crate::math::view::View;

/// Steps of the cache of light that a device makes up for at most.
const MISSED_STEPS: u64 = 96;

/// A view to trace, the same for all devices.
#[derive(Clone)]
pub struct Job {
    /// Which view of the frame it is.
    pub index: usize,
    /// The view.
    pub view: View,
    /// How its samples are traced.
    pub settings: Settings,
    /// Steps of the cache of light that are made before it, counted from the first frame on: all devices make the same.
    pub light: u64,
    /// How often the cache has begun anew before these steps.
    pub light_restarts: u32,
    /// Where what moves is, in scenes in which something does.
    pub state: Option<Arc<SceneState>>,
    /// Light from infinitely far, where that changes.
    pub sky: Option<Arc<SkyState>>,
    /// Where its samples are.
    pub pattern: Arc<Pattern>,
    /// The pattern's tiles and samples, as parts are cut from them.
    pub workload: Arc<Workload>,
    /// Where the results go.
    pub sample_target: Arc<SampleTarget>,
    /// A device that can may write them there itself: not when others' results are there already, since it
    /// also describes the tiles around its part.
    pub direct: bool,
    /// Runs of a part are timed apart where that says more of costs than the whole: for devices that share views.
    pub timed_apart: bool,
}

/// The memory that a view's results end up in, for Vulkan to read.
pub struct SampleTarget {
    /// A record for each sample.
    pub samples: Shared<SampleRecord>,
    /// A record for each pixel, where they are asked for.
    pub visibility: Option<Shared<VisibilityRecord>>,
}

/// What a device did with its part.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PartResult {
    /// The part.
    pub part: Part,
    /// The part as it was timed, and milliseconds of device time for pixels and for samples.
    pub slices: Vec<(Part, [f64; 2])>,
    /// What the device kept the frame waiting for beside: copying results, in milliseconds.
    pub copy_ms: f64,
    /// Device time of the cache of light, in milliseconds.
    pub light_ms: f64,
    /// Camera rays and light rays.
    pub rays: u64,
    /// Samples whose estimate was not finite.
    pub dropped: u32,
    /// What the pixels of the part's tiles see, 256 records a tile, to be copied to the sample target; none where it is
    /// there, as samples are.
    pub visibility: Vec<VisibilityRecord>,
}

/// Something that traces parts of views: a device, or in tests one that misbehaves.
pub trait Worker: Send {
    /// Traces a part.
    ///
    /// # Errors
    /// Where the device fails; it is not used again before it was opened anew.
    fn trace(&mut self, job: &Job, part: &Part) -> Result<PartResult>;

    /// Traces parts of views that follow each other, and tells each result as soon as it is there; ends with the first
    /// that fails. A device that can begins the next part before it is waited for with the last.
    fn trace_all(&mut self, work: &[(Arc<Job>, Part)], tell: &mut dyn FnMut(Result<PartResult>)) {
        for (job, part) in work {
            let done = self.trace(job, part);
            let failed = done.is_err();
            tell(done);
            if failed {
                return;
            }
        }
    }

    /// What the operator should know of how it was opened.
    fn note(&self) -> Option<String> {
        None
    }

    /// After a failure: the device is gone for good, and its driver may hang when it is told to let go of
    /// what was there.
    fn is_lost(&self) -> bool {
        false
    }
}

/// The presenting device, whose ray queries are to trace rays.
#[derive(Clone, Debug)]
pub struct RayQueryDevice {
    /// The device.
    pub context: Context,
    /// Whether it is an error where they cannot trace a scene's rays; else the kernels do.
    pub required: bool,
}

/// A device with a scene.
pub struct DeviceWorker {
    tracer: Tracer,
    /// Writes the sample target in place.
    direct: bool,
    /// Parts that are timed apart: they tell where the costs are. Graphics cards idle at each part's end.
    slices: u32,
    /// Steps that its cache of light has made.
    light: u64,
    light_restarts: u32,
    views: Vec<Option<OwnView>>,
    note: Option<String>,
}

/// A part that the device works on.
struct Begun {
    part: Part,
    slices: Vec<Part>,
    work: InFlight,
    /// Steps of the cache of light.
    light: Vec<Event>,
    /// Results on their way to the host, where they are not written in place.
    samples: Option<Transfer<BufferRef>>,
    visibility: Option<Visibility>,
}

/// What pixels see, on its way to the host.
enum Visibility {
    /// That of all of the view's pixels, to its place.
    Whole(Transfer<BufferRef>),
    /// That of a part's tiles, gathered: others' may have to go before it to where Vulkan reads it.
    Packed(Event, Transfer<Vec<VisibilityRecord>>),
}

/// A view's pattern and results in the device's own memory.
struct OwnView {
    pattern: Arc<Pattern>,
    uploaded: TracePattern,
    samples: Option<Buffer<SampleRecord>>,
    visibility: Option<Buffer<VisibilityRecord>>,
    /// Its last frame, where that is asked for.
    past: Option<Past>,
}

impl DeviceWorker {
    /// A device that has been opened, with its variants of the kernels; `direct` says that it writes landings in place.
    ///
    /// # Errors
    /// Where the device fails its self-test, or the scene does not fit.
    pub fn new(device: &Device, data: &SceneData, traversals: Traversals, direct: bool) -> Result<Self> {
        let slices = if device.info().kind == "cpu" { 4 } else { 1 };
        Ok(Self::with_tracer(Tracer::open(device, data, traversals)?, direct, slices))
    }

    fn with_tracer(tracer: Tracer, direct: bool, slices: u32) -> Self {
        DeviceWorker { tracer, direct, slices, light: 0, light_restarts: 0, views: Vec::new(), note: None }
    }

    /// The first device of a fleet, which writes landings in place, with rays that the presenting device's ray queries trace:
    /// see [`Tracer::with_hardware_rays`]. Where these cannot and need not, its kernels trace them in the given variants, and
    /// [`Worker::note`] tells why.
    ///
    /// # Errors
    /// As [`DeviceWorker::new`], and where ray queries are required and the presenting device has no room for the scene.
    pub fn with_hardware_rays(
        device: &Device,
        data: &SceneData,
        rays: &RayQueryDevice,
        traversals: Traversals,
    ) -> Result<Self> {
        match Tracer::with_hardware_rays(device, data, &rays.context) {
            Ok(tracer) => Ok(Self::with_tracer(tracer, true, 1)),
            Err(error) if rays.required => Err(or_without_ray_queries(error)),
            Err(error) => {
                let why = format!(
                    "the kernels trace all rays, since ray queries could not take this scene: {error}"
                );
                Ok(DeviceWorker { note: Some(why), ..Self::new(device, data, traversals, true)? })
            }
        }
    }

    /// Opens a device anew, as after a failure.
    ///
    /// # Errors
    /// As [`DeviceWorker::new`], and where the driver refuses the device.
    pub fn reopen(from: &Device, data: &SceneData, traversals: Traversals) -> Result<Self> {
        Self::new(&from.reopen()?, data, traversals, false)
    }

    /// Has the device begin with a part, after all that it has begun with before.
    fn begin(&mut self, job: &Job, part: &Part) -> Result<Begun> {
        if let Some(state) = &job.state {
            self.tracer.move_to(state)?;
        }
        if let Some(sky) = &job.sky {
            self.tracer.light_by(sky)?;
        }
        if self.light_restarts != job.light_restarts {
            self.tracer.forget_light();
            (self.light, self.light_restarts) = (0, job.light_restarts);
        }
        self.prepare(job)?;
        let DeviceWorker { tracer, views, direct, slices, light, .. } = self;
        let Some(own) = &mut views[job.index] else { unreachable!("a view that was just prepared") };
        let target = &job.sample_target;
        let in_place = target.samples.opencl().filter(|_| *direct && job.direct);
        let Some(samples) = in_place.or(own.samples.as_ref()) else {
            unreachable!("it has room for samples")
        };
        let visibility = match in_place {
            Some(_) => target.visibility.as_ref().and_then(Shared::opencl),
            None => own.visibility.as_ref().filter(|_| job.settings.guided),
        };
        let parts = job.workload.slices(part, if job.timed_apart { *slices } else { 1 });
        let mut steps = Vec::new();
        if job.settings.cached {
            // What a device has missed it makes up for, within bounds.
            for step in (*light).max(job.light.saturating_sub(MISSED_STEPS))..job.light {
                steps.extend(tracer.update_light(&job.view, &job.settings, &own.uploaded, step + 1)?);
            }
            // It may be ahead already, where it does another's part of a view before.
            *light = job.light.max(*light);
        }
        let past = job.settings.fewer_rays.map(|_| &mut own.past);
        let records = (samples, visibility);
        let work = tracer.enqueue_parts(&job.view, &job.settings, &own.uploaded, &parts, records, past)?;
        let mut begun =
            Begun { part: part.clone(), slices: parts, work, light: steps, samples: None, visibility: None };
        if in_place.is_none() {
            let (first, count) = (part.samples.start as usize, part.samples.len());
            begun.samples = Some(target.samples.start_copy(samples, first, count)?);
            begun.visibility = match (visibility, &target.visibility) {
                (Some(records), Some(shared)) if *part == job.workload.whole() => {
                    Some(Visibility::Whole(shared.start_copy(records, 0, job.view.pixels())?))
                }
                (Some(records), _) => {
                    let tiles = part.tiles.clone();
                    let packed = tracer.packed_visibility(&job.view, &own.uploaded, tiles, records)?;
                    packed.map(|(packing, records)| Visibility::Packed(packing, records))
                }
                (None, _) => None,
            };
            tracer.device().flush()?;
        }
        Ok(begun)
    }

    /// Takes in a view's pattern, where it is new.
    fn prepare(&mut self, job: &Job) -> Result<()> {
        if self.views.len() <= job.index {
            self.views.resize_with(job.index + 1, || None);
        }
        let slot = &mut self.views[job.index];
        if !slot.as_ref().is_some_and(|own| Arc::ptr_eq(&own.pattern, &job.pattern)) {
            let uploaded = self.tracer.pattern(&job.pattern)?;
            let pattern = job.pattern.clone();
            *slot = Some(match slot.take() {
                Some(own) => OwnView { pattern, uploaded, ..own },
                None => OwnView { pattern, uploaded, samples: None, visibility: None, past: None },
            });
        }
        if job.settings.fewer_rays.is_none()
            && let Some(own) = slot
        {
            own.past = None;
        }
        let direct = self.direct && job.direct && job.sample_target.samples.opencl().is_some();
        if let Some(own) = slot.as_mut().filter(|_| !direct) {
            let device = self.tracer.device();
            let (count, pixels) = (job.pattern.samples.len(), job.view.pixels());
            if own.samples.as_ref().is_none_or(|buffer| buffer.len() < count) {
                own.samples = Some(Buffer::new(device, count)?);
            }
            if job.settings.guided && own.visibility.as_ref().is_none_or(|buffer| buffer.len() < pixels) {
                own.visibility = Some(Buffer::new(device, pixels)?);
            }
        }
        Ok(())
    }
}

/// An error of a device, with the setting by which its kernels trace all rays as another next step.
fn or_without_ray_queries(error: Error) -> Error {
    match error {
        Error::Device { device, problem } => {
            Error::Device { device, problem: format!("{problem}; or set trace.hardware_rays=off") }
        }
        other => other,
    }
}

impl Worker for DeviceWorker {
    fn note(&self) -> Option<String> {
        self.note.clone()
    }

    fn is_lost(&self) -> bool {
        !self.tracer.device().is_available()
    }

    fn trace(&mut self, job: &Job, part: &Part) -> Result<PartResult> {
        self.begin(job, part)?.finish(&self.tracer)
    }

    fn trace_all(&mut self, work: &[(Arc<Job>, Part)], tell: &mut dyn FnMut(Result<PartResult>)) {
        // Rays of ray queries are waited for as soon as they are begun: whoever waits for the first part would wait for all.
        let together = if self.tracer.has_hardware_rays() { 1 } else { work.len().max(1) };
        let _ = work.chunks(together).all(|work| self.trace_together(work, tell));
    }
}

impl DeviceWorker {
    /// Begins with parts before it waits for any; false after a failure.
    fn trace_together(
        &mut self,
        work: &[(Arc<Job>, Part)],
        tell: &mut dyn FnMut(Result<PartResult>),
    ) -> bool {
        let mut failed = false;
        let mut begun = Vec::with_capacity(work.len());
        for (job, part) in work {
            begun.push(self.begin(job, part));
            if begun.last().is_some_and(Result::is_err) {
                break;
            }
        }
        for begun in begun {
            if failed {
                // The device may never be done with it: who lets go of it might be waiting for ever.
                std::mem::forget(begun);
                continue;
            }
            let done = begun.and_then(|begun| begun.finish(&self.tracer));
            failed = done.is_err();
            if failed {
                // Kernels that wait in its queue may still write to memory of Vulkan's that the jobs keep.
                work.iter().for_each(|(job, _)| std::mem::forget(job.clone()));
            }
            tell(done);
        }
        !failed
    }
}

impl Begun {
    /// Waits for the part, and tells what was done. After a failure nothing of it is let go of, which might wait for ever.
    fn finish(self, tracer: &Tracer) -> Result<PartResult> {
        // The last in the queue first: once it is done all are, and the thread has slept once.
        let waits = [
            match &self.visibility {
                Some(Visibility::Whole(records)) => records.wait(),
                Some(Visibility::Packed(_, records)) => records.wait(),
                None => Ok(()),
            },
            self.samples.as_ref().map_or(Ok(()), Transfer::wait),
            self.work.wait(),
        ];
        if let Some(error) = waits.into_iter().find_map(Result::err) {
            std::mem::forget(self);
            return Err(error);
        }
        let traced = tracer.finish(self.work)?;
        let mut done = PartResult {
            part: self.part,
            slices: self.slices.into_iter().zip(traced.parts_ms).collect(),
            rays: traced.rays + traced.light_rays,
            dropped: traced.dropped,
            light_ms: self.light.iter().map(Event::device_ms).sum(),
            ..PartResult::default()
        };
        if let Some(samples) = self.samples {
            samples.wait()?;
            done.copy_ms += samples.device_ms();
        }
        match self.visibility {
            Some(Visibility::Whole(records)) => {
                records.wait()?;
                done.copy_ms += records.device_ms();
            }
            Some(Visibility::Packed(packing, records)) => {
                records.wait()?;
                done.copy_ms += packing.device_ms() + records.device_ms();
                done.visibility = records.into_memory()?;
            }
            None => {}
        }
        Ok(done)
    }
}

impl SampleTarget {
    /// Copies what a device has delivered to its place.
    pub fn take(&self, job: &Job, done: &PartResult) {
        let Some(visibility) = &self.visibility else { return };
        let (width, height) = (job.view.width, job.view.height);
        let across = width.div_ceil(TILE);
        let tiles = &job.pattern.order[done.part.tiles.start as usize..done.part.tiles.end as usize];
        for (&tile, records) in tiles.iter().zip(done.visibility.chunks_exact(TILE_PIXELS as usize)) {
            let (left, top) = (tile % across * TILE, tile / across * TILE);
            let length = TILE.min(width - left) as usize;
            let rows = records.chunks_exact(TILE as usize).zip(top..height);
            for (row, y) in rows {
                visibility.write((y * width + left) as usize, &row[..length]);
            }
        }
    }

    /// The share of each tile's samples that met a surface, from every eighth of them; NaN where there is
    /// none. Call it when all parts have landed.
    pub fn seen(&self, workload: &Workload) -> Vec<f32> {
        const STEP: usize = 8;
        let records = self.samples.sparse(workload.samples() as usize, STEP);
        let share = |tile: usize| {
            let range = workload.tile(tile);
            let (first, end) = ((range.start as usize).div_ceil(STEP), (range.end as usize).div_ceil(STEP));
            let met = records[first..end].iter().filter(|record| record.depth != 0.0).count();
            if end > first { met as f32 / (end - first) as f32 } else { f32::NAN }
        };
        (0..workload.tiles()).map(share).collect()
    }
}
