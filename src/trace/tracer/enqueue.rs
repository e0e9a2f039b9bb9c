//! The work of a view, handed to a device's queue.

use super::pattern::Ring;
use super::{COUNTERS, Hardware, InFlight, Past, Settings, TracePattern, Tracer, camera, untraced};
use crate::error::Result;
use crate::foveation::pattern::TILE;
use crate::foveation::workload::Part;
use crate::gpu::opencl::{Buffer, Transfer};
use crate::layout::{PATH_QUEUES, SampleRecord, VisibilityRecord};
use crate::math::view::View;

impl Tracer {
    /// Enqueues the trace of all samples of a view; with guided settings also what every pixel sees. More may be enqueued
    /// before this is waited for.
    ///
    /// `samples` and `visibility` are at least as long as the pattern's samples and the view's pixels;
    /// their content is complete after [`Tracer::finish`].
    pub fn enqueue(
        &mut self,
        view: &View,
        settings: &Settings,
        pattern: &TracePattern,
        samples: &Buffer<SampleRecord>,
        visibility: Option<&Buffer<VisibilityRecord>>,
    ) -> Result<InFlight> {
        let whole = std::slice::from_ref(&pattern.whole);
        self.enqueue_parts(view, settings, pattern, whole, (samples, visibility), None)
    }

    /// Like [`Tracer::enqueue`], for parts of the view that follow each other: records of other parts stay as
    /// they are, except that the first part's first traced tile is described too. `past` is the view's frame before this one,
    /// for [`Settings::fewer_rays`], and then this one, whose parts are to be all that the view has: [`Tracer::hits`] are not its own
    /// then.
    pub fn enqueue_parts(
        &mut self,
        view: &View,
        settings: &Settings,
        pattern: &TracePattern,
        parts: &[Part],
        records: (&Buffer<SampleRecord>, Option<&Buffer<VisibilityRecord>>),
        past: Option<&mut Option<Past>>,
    ) -> Result<InFlight> {
        let most = PATH_QUEUES - 1;
        assert!(
            settings.bounces <= most,
            "{} bounces are more than the {most} that paths take",
            settings.bounces
        );
        let mut hardware = self.hardware.take();
        let begun = self.enqueue_by(hardware.as_mut(), view, settings, pattern, parts, records, past);
        self.hardware = hardware;
        begun
    }

    /// The same; rays that `hardware` traces are waited for meanwhile.
    #[allow(clippy::too_many_arguments)]
    fn enqueue_by(
        &mut self,
        mut hardware: Option<&mut Hardware>,
        view: &View,
        settings: &Settings,
        pattern: &TracePattern,
        parts: &[Part],
        (samples, visibility): (&Buffer<SampleRecord>, Option<&Buffer<VisibilityRecord>>),
        past: Option<&mut Option<Past>>,
    ) -> Result<InFlight> {
        assert_eq!(
            settings.guided,
            visibility.is_some(),
            "guided reconstruction needs visibility, k-NN does not"
        );
        let needed = if settings.guided { view.pixels() } else { pattern.whole.samples.len() };
        if self.hits.len() < needed {
            self.hits = untraced(&self.device, needed)?;
        }
        if self.may_blend && self.blends.len() < needed {
            self.blends = Buffer::zeroed(&self.device, needed)?;
        }
        if let Some(mirrors) = &mut self.mirrors
            && settings.guided
        {
            let [across, down] = [view.width, view.height].map(|pixels| pixels.div_ceil(TILE) as usize);
            mirrors.reserve(&self.device, across * down)?;
        }
        if settings.cached {
            self.light.reserve(&self.device)?;
        }
        samples.acquire()?;
        visibility.map_or(Ok(()), Buffer::acquire)?;
        if !std::mem::take(&mut self.counts) {
            self.counters.fill_zero()?;
        }
        let camera = camera(view, self.anchor, settings);
        let known = past.as_deref().and_then(Option::as_ref).filter(|_| settings.guided);
        let before = known.map_or(camera, |past| self::camera(&past.view, self.anchor, settings));
        let shading = self.shading(settings);
        let mut copied = None;
        let (traces, camera_rays) = match visibility {
            Some(records) => {
                let edges = settings.edge_rays;
                let ring = if edges > 0 { pattern.ring(parts) } else { Ring::default() };
                let (tiles, blocks) = (ring.tiles.len(), ring.blocks);
                copied = self.give_ring(ring)?;
                let ring = (tiles as u32, blocks);
                let by = hardware.as_deref_mut();
                self.trace_tiles(by, &camera, &shading, edges, pattern, parts, ring, records)?
            }
            None => {
                let by = &mut hardware;
                let trace = |part: &Part| self.trace_only_samples(by.as_deref_mut(), &camera, pattern, part);
                let rays = parts.iter().map(|part| part.samples.len() as u64).sum();
                (parts.iter().map(trace).collect::<Result<Vec<_>>>()?, rays)
            }
        };
        let mut events = Vec::with_capacity(parts.len());
        for (part, trace) in parts.iter().zip(traces) {
            let by = hardware.as_deref_mut();
            let past = (&before, known.map(|past| &past.hits));
            let shaded = self.shade(by, &camera, &shading, pattern, part, visibility, samples, past)?;
            events.push((trace, shaded));
        }
        if let Some(past) = past.filter(|_| settings.guided) {
            // What was the last frame's is written over by the next view's.
            let spare = match past.take() {
                Some(past) => past.hits,
                None => untraced(&self.device, needed)?,
            };
            *past = Some(Past { view: *view, hits: std::mem::replace(&mut self.hits, spare) });
        }
        samples.release()?;
        visibility.map_or(Ok(()), Buffer::release)?;
        let counters = self.counters.start_read(0, COUNTERS)?;
        self.device.flush()?;
        Ok(InFlight { parts: events, camera_rays, counters, _copied: copied })
    }

    /// Has the tiles around parts copied to where kernels find them.
    fn give_ring(&mut self, ring: Ring) -> Result<Option<Transfer<Vec<u32>>>> {
        if ring.tiles.is_empty() {
            return Ok(None);
        }
        if self.ring.len() < ring.tiles.len() {
            self.ring = Buffer::new(&self.device, ring.tiles.len().next_power_of_two())?;
        }
        self.ring.start_write(ring.tiles).map(Some)
    }
}
