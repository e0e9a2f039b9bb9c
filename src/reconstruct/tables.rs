//! The neighbours of pixels and samples: found on the device when the pattern changes.
//!
//! **Blocks that search together.** Each new pattern has its pixels' and samples' nearest samples found anew,
//! exactly. On lavapipe a lane's read of a sample costs several times what comparing it costs, so the 16
//! pixels of a block take each sample that is read into 16 lists, with squares as the keys' upper bits: 28 ms
//! became 12 for 1280 × 800 pixels. Rows of cells end where the circle does. A sample's 24 neighbours are
//! looked for at once in a circle that its block's radius suggests, 1.3 times as wide as in proportion (1.05,
//! 1.15 and 1.5 cost more), where three searches were usual: 23 ms became 11. What gained less there: groups
//! of eight lanes that all read the same samples, for 8 × 8 pixels or for eight samples, took about two
//! thirds of the time before (it seems that lavapipe reads lane by lane in loops all the same). Where a processor
//! both traces and presents, `src/trace/pattern_maker/neighbours.rs` finds them in a quarter of the time, but for the host's first patterns.

mod bands;

use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::settings::{PREPARED_BYTES, Settings};
use super::{Mode, shaders};
use crate::error::{Error, Result};
use crate::foveation::{Cells, one_to_one};
use crate::gpu::vulkan::{BufferRef, Commands, ComputePipeline, Context, HostBuffer, StageTime};
use crate::layout::SampleRecord;
use crate::trace::pattern_maker::{Neighbours, PatternTables};
pub(super) use bands::Band;
use bands::{band_rows, device, empty_bands};

/// Pixels across and down a block that shares a search radius, as in neighbours.wgsl.
const BLOCK: u32 = 4;
/// How much farther than in proportion to their number a sample's neighbours are looked for at once: rarely too
/// little, which would have it look again.
const GROWTH: f32 = 1.3;
/// Work-groups in one direction that every device takes.
const MAX_GROUPS: usize = 65535;

#[repr(C)]
#[derive(Clone, Copy, Pod, Zeroable)]
pub(super) struct NeighbourParameters {
    width: u32,
    height: u32,
    count: u32,
    cell_shift: u32,
    cells_across: u32,
    wanted: u32,
    first_radius: u32,
    weights: u32,
    first_row: u32,
    rows: u32,
    written: u32,
    growth: f32,
}

/// The shaders that find neighbours.
pub(super) struct Finders {
    radii: ComputePipeline,
    pixels: ComputePipeline,
    samples: Option<ComputePipeline>,
    /// Rows of pixels that an invocation of `pixels` takes, as in neighbours.wgsl.
    rows: u32,
}

impl Finders {
    pub fn new(context: &Context, settings: &Settings) -> Result<Self> {
        let of_pixels = shaders::neighbours(settings.k + 1);
        let rows = BLOCK / shaders::capacity(settings.k + 1).div_ceil(8);
        let samples = match settings.mode {
            Mode::Guided(guided) if guided.neighbours > 1 => {
                let shader = shaders::neighbours(guided.neighbours);
                Some(ComputePipeline::new(context, &shader, "nearest_to_samples")?)
            }
            _ => None,
        };
        Ok(Finders {
            radii: ComputePipeline::new(context, &of_pixels, "find_radii")?,
            pixels: ComputePipeline::new(context, &of_pixels, "nearest_to_pixels")?,
            samples,
            rows,
        })
    }
}

/// What a view's frames need of its pattern.
pub(super) struct Tables {
    pub width: u32,
    pub height: u32,
    pub count: usize,
    /// Neighbours of each pixel.
    pub k: u32,
    /// Neighbours of each sample, itself included.
    pub neighbours: u32,
    /// Whether each pixel has a sample of its own.
    full: bool,
    bands: Vec<Band>,
    /// Bands of an earlier pattern, whose memory the next one may have.
    spare: Vec<Band>,
    spare_shape: (u32, u32, u32),
    /// Whether the next frame looks this one's samples up: then a new pattern leaves its tables alone.
    kept: bool,
    nearest: Option<BufferRef>,
    /// Whether it belongs to who lends the bands.
    nearest_is_lent: bool,
    positions: BufferRef,
    prepared: BufferRef,
    /// Room for as many samples more, once a pass has needed it.
    exchanged: Option<BufferRef>,
    commands: Commands,
}

/// Records copying values to memory that the device reads fast, if the host's is not such.
fn upload<T: Pod>(context: &Context, commands: &mut Commands, values: &[T]) -> Result<BufferRef> {
    let host = HostBuffer::new(context, size_of_val(values))?;
    host.write(0, values);
    let host = BufferRef::from(&host);
    if host.is_device_local() {
        return Ok(host);
    }
    let own = device(context, host.size())?;
    commands.copy(&host, &own, host.size());
    Ok(own)
}

impl Tables {
    pub fn new(context: &Context) -> Result<Self> {
        let empty = device(context, 16)?;
        Ok(Tables {
            width: 0,
            height: 0,
            count: 0,
            k: 0,
            neighbours: 1,
            full: false,
            bands: Vec::new(),
            spare: Vec::new(),
            spare_shape: (0, 0, 0),
            kept: false,
            nearest: None,
            nearest_is_lent: false,
            positions: empty.clone(),
            prepared: empty,
            exchanged: None,
            commands: Commands::new(context)?,
        })
    }

    pub fn bands(&self) -> &[Band] {
        &self.bands
    }

    pub fn nearest(&self) -> Option<&BufferRef> {
        self.nearest.as_ref()
    }

    pub fn positions(&self) -> &BufferRef {
        &self.positions
    }

    pub fn prepared(&self) -> &BufferRef {
        &self.prepared
    }

    /// What a pass over all samples reads, and what it writes, which is [`Tables::prepared`] from then on.
    pub fn next_prepared(&mut self, context: &Context) -> Result<[BufferRef; 2]> {
        let next = match self.exchanged.take() {
            Some(room) if room.size() >= self.count * PREPARED_BYTES => room,
            _ => device(context, self.count * PREPARED_BYTES)?,
        };
        let last = std::mem::replace(&mut self.prepared, next.clone());
        self.exchanged = Some(last.clone());
        Ok([last, next])
    }

    /// The sample of each pixel, where all have one of their own and one binding reaches all of them.
    pub fn sample_of_pixel(&self) -> Option<&BufferRef> {
        match self.bands.as_slice() {
            [band] if self.full => Some(&band.indices),
            _ => None,
        }
    }

    /// The next frame looks up what this one is made of: a new pattern does not overwrite it.
    pub fn keep(&mut self) {
        self.kept = true;
    }

    pub fn wait(&mut self) -> Result<Vec<StageTime>> {
        self.commands.wait()
    }

    /// Starts finding the neighbours of a new pattern, whose samples may be sorted already, if they are not found.
    pub fn set(
        &mut self,
        context: &Context,
        settings: &Settings,
        finders: &Finders,
        size: (u32, u32),
        samples: &[u32],
        known: Option<PatternTables>,
    ) -> Result<()> {
        let started = self.start(context, settings, finders, size, samples, known);
        if started.is_err() {
            // A pattern that failed half way must not be drawn.
            (self.width, self.height, self.count) = (0, 0, 0);
            self.bands.clear();
        }
        started
    }

    fn start(
        &mut self,
        context: &Context,
        settings: &Settings,
        finders: &Finders,
        (width, height): (u32, u32),
        samples: &[u32],
        known: Option<PatternTables>,
    ) -> Result<()> {
        check_size(context, (width, height))?;
        let map = one_to_one(width, height, samples);
        check_count(context, settings, (width, height), samples.len(), map.is_some())?;
        let known = match (&map, known) {
            (Some(_), _) => None,
            (None, None) => Some(PatternTables::Cells(Cells::new(width, height, samples)?)),
            (None, given) => given,
        };
        let k = if map.is_some() { 1 } else { settings.k.min(samples.len() as u32) };
        self.commands.begin()?;
        let mut shape = (self.width, self.height, self.k);
        if std::mem::take(&mut self.kept) {
            std::mem::swap(&mut self.bands, &mut self.spare);
            shape = std::mem::replace(&mut self.spare_shape, shape);
        }
        let same = shape == (width, height, k) && self.bands.iter().all(|band| band.lent.is_none());
        (self.width, self.height, self.k, self.count) = (width, height, k, samples.len());
        self.positions = upload(context, &mut self.commands, samples)?;
        if self.prepared.size() < samples.len() * PREPARED_BYTES {
            self.prepared = device(context, samples.len() * PREPARED_BYTES)?;
        }
        self.full = map.is_some();
        match (map, known) {
            (Some(map), _) => {
                self.nearest = None;
                self.neighbours = 1;
                self.bands = self.own_samples(context, &map)?;
            }
            (None, Some(PatternTables::Neighbours(found))) => self.take(found, settings)?,
            (None, Some(PatternTables::Cells(cells))) => {
                if !same {
                    self.bands = empty_bands(context, (width, height), k)?;
                }
                for band in &mut self.bands {
                    (band.first_sample, band.samples) = (0, samples.len());
                }
                self.find(context, settings, finders, &cells)?;
            }
            (None, None) => {}
        }
        self.commands.submit()
    }

    /// Takes over what was found elsewhere.
    fn take(&mut self, found: Arc<Neighbours>, settings: &Settings) -> Result<()> {
        if found.lists != settings.lists()
            || !found.fits(self.width as usize * self.height as usize, self.count)
        {
            return Err(Error::setting(
                "pattern",
                "its neighbours are not those of these settings and samples",
            ));
        }
        let [indices, weights] = found.of_pixels(self.width as usize * self.height as usize);
        (self.nearest, self.nearest_is_lent) = (found.of_samples(self.count), true);
        self.neighbours = found.lists.of_sample.max(1);
        self.bands = vec![Band {
            first_row: 0,
            rows: self.height,
            indices,
            weights,
            first_sample: 0,
            samples: self.count,
            lent: Some(found),
        }];
        Ok(())
    }

    /// Tables that give each pixel its own sample.
    fn own_samples(&mut self, context: &Context, map: &[u32]) -> Result<Vec<Band>> {
        let mut bands = Vec::new();
        for (first_row, rows) in band_rows(context, (self.width, self.height), 1) {
            let row = self.width as usize;
            let part = &map[first_row as usize * row..(first_row + rows) as usize * row];
            let low = part.iter().min().copied().unwrap_or(0) / 64 * 64;
            let samples = (part.iter().max().copied().unwrap_or(0) - low) as usize + 1;
            if (samples * PREPARED_BYTES) as u64 > context.storage_range() {
                let problem = "samples of a full pattern must be ordered from top to bottom at this size";
                return Err(Error::setting("pattern", problem));
            }
            bands.push(Band {
                first_row,
                rows,
                indices: upload(context, &mut self.commands, part)?,
                weights: upload(context, &mut self.commands, &vec![1.0f32; part.len()])?,
                first_sample: low,
                samples,
                lent: None,
            });
        }
        Ok(bands)
    }

    /// Records the searches.
    fn find(
        &mut self,
        context: &Context,
        settings: &Settings,
        finders: &Finders,
        cells: &Cells,
    ) -> Result<()> {
        let sorted = upload(context, &mut self.commands, &cells.sorted)?;
        let cell_start = upload(context, &mut self.commands, &cells.starts)?;
        let blocks = [self.width.div_ceil(BLOCK), self.height.div_ceil(BLOCK)];
        let radii = device(context, blocks[0] as usize * blocks[1] as usize * 4)?;
        self.commands.end_stage("upload");

        let wanted = self.k + 1;
        let mut parameters = NeighbourParameters {
            width: self.width,
            height: self.height,
            count: self.count as u32,
            cell_shift: cells.shift,
            cells_across: cells.across,
            wanted,
            first_radius: self.usual_radius(wanted),
            weights: settings.lists().weights as u32,
            first_row: 0,
            rows: self.height,
            written: self.k,
            growth: 0.0,
        };
        let buffers = [Some(&sorted), Some(&cell_start), Some(&radii), None, None];
        let groups = [blocks[0].div_ceil(64), blocks[1], 1];
        self.commands.dispatch(&finders.radii, &buffers, bytemuck::bytes_of(&parameters), groups)?;
        self.commands.end_stage("radii");
        for band in &self.bands {
            (parameters.first_row, parameters.rows) = (band.first_row, band.rows);
            let (indices, weights) = (Some(&band.indices), Some(&band.weights));
            let buffers = [Some(&sorted), Some(&cell_start), Some(&radii), indices, weights];
            let groups = [blocks[0].div_ceil(64), band.rows.div_ceil(finders.rows), 1];
            self.commands.dispatch(&finders.pixels, &buffers, bytemuck::bytes_of(&parameters), groups)?;
        }
        self.commands.end_stage("pixels");
        if let Some(pipeline) = &finders.samples {
            self.neighbours = settings.guided().neighbours.min(self.count as u32);
            let bytes = self.count * self.neighbours as usize * 4;
            let nearest = match self.nearest.take() {
                Some(nearest) if nearest.size() >= bytes && !self.nearest_is_lent => nearest,
                _ => device(context, bytes)?,
            };
            parameters.wanted = self.neighbours;
            parameters.written = self.neighbours;
            // Blocks' radii tell how dense samples are there.
            parameters.growth = (self.neighbours as f32 / wanted as f32).sqrt() * GROWTH;
            let buffers = [Some(&sorted), Some(&cell_start), Some(&radii), Some(&nearest), None];
            let groups = [parameters.count.div_ceil(64), 1, 1];
            self.commands.dispatch(pipeline, &buffers, bytemuck::bytes_of(&parameters), groups)?;
            self.commands.end_stage("samples");
            (self.nearest, self.nearest_is_lent) = (Some(nearest), false);
        }
        Ok(())
    }

    /// Somewhat above the radius that holds so many samples at mean density: where it does not hold
    /// them, a search looks again.
    fn usual_radius(&self, wanted: u32) -> u32 {
        let area = f64::from(self.width) * f64::from(self.height) / self.count as f64;
        let radius = (area * f64::from(wanted) / std::f64::consts::PI).sqrt();
        (radius * 1.25).clamp(1.0, f64::from(self.width.max(self.height))) as u32
    }
}

/// Refuses views that the device cannot draw.
fn check_size(context: &Context, (width, height): (u32, u32)) -> Result<()> {
    let limit = context.image_size_limit().min(1 << 15);
    if width == 0 || height == 0 || width > limit || height > limit {
        let problem = format!("{width}x{height} pixels cannot be drawn; from 1 to {limit} can");
        return Err(Error::setting("size", problem));
    }
    Ok(())
}

/// Refuses more samples than one binding reaches, and more neighbours than the device has memory for.
fn check_count(
    context: &Context,
    settings: &Settings,
    (width, height): (u32, u32),
    count: usize,
    full: bool,
) -> Result<()> {
    if count == 0 {
        return Err(Error::setting("samples", "there must be at least one"));
    }
    let reach = context.storage_range() as usize;
    let record = size_of::<SampleRecord>().max(settings.guided().neighbours as usize * 4);
    let most = if full { reach / 4 } else { (reach / record).min(MAX_GROUPS * 64) };
    if count > most {
        let problem = format!("{count} are more than the {most} that this device reaches; ask for fewer");
        return Err(Error::setting("samples", problem));
    }
    let k = if full { 1 } else { settings.k as usize };
    let bytes = (width as usize * height as usize * k * 8) as u64;
    if bytes > context.memory_size() / 2 {
        let problem = format!(
            "tables of {} MiB for {width}x{height} pixels do not fit the device; make k or the picture smaller",
            bytes >> 20
        );
        return Err(Error::setting("k", problem));
    }
    Ok(())
}

#[cfg(test)]
mod tests;
