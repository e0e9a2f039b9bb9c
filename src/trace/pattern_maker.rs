//! Patterns made where they are used: `kernels/pattern.cl` on a tracing device.
//!
//! With an eye tracker the gaze is new in each frame, and a graphics card would wait for the host each time. The list, which
//! the host and other devices need too, is read back; nothing on the host goes over pixels or samples.
//! [`Pattern::new`] and those beside it make the same patterns, to the bit where the device rounds divisions and roots
//! correctly: they serve until the kernels are built, after a failure, and as the tests' reference.

mod neighbours;
mod thread;

use std::sync::Arc;

use glam::DVec2;

use super::kernels::{
    CountKeys, Grid, ListSamples, MarkSamples, SampleKeys, ScanCounts, ScanSums, SelectKey, SelectPixel,
    SumCounts,
};
use super::source;
use crate::error::{Error, Result};
use crate::foveation::keys::Keys;
use crate::foveation::{BitMask, Cells, Law, Lens, Pattern, order, pattern::TILE};
use crate::gpu::opencl::{Buffer, Device, Program, Transfer};
use crate::gpu::vulkan::Context;
use crate::layout::SampleLaw;
use crate::math::blue_noise;
use crate::math::view::View;
use neighbours::{Finder, SampleBuffers};
pub use neighbours::{NeighbourLists, Neighbours, PatternTables};
pub use thread::{Patterns, Trial};

/// Work-items that scan or select together, and of a group elsewhere: SCAN_GROUP of kernels/pattern.cl.
const SCAN_GROUP: usize = 64;
/// Pixels that a group counts, and values that it tells apart: COUNTED and BINS there.
const COUNTED: usize = 16384;
const BINS: usize = 1 << 12;
/// From which bits on keys are looked at, one pass after the other, and which are known before.
const PASSES: [(u32, u32); 3] = [(20, 32), (8, 20), (0, 8)];
/// Blocks of 8 x 4 pixels in a tile.
const BLOCKS: usize = 8;
/// Words of a Selection there, and which of them is the number of samples.
const SELECTION: usize = 5;
const SELECTED: usize = 4;

/// What a pattern is wanted for.
#[derive(Clone, Debug)]
pub struct PatternRequest {
    /// The view.
    pub view: View,
    /// How samples are spread.
    pub law: Law,
    /// Where the eye looks, in 0..1 of the view.
    pub gaze: DVec2,
    /// Samples, at least 1 and at most all visible pixels.
    pub count: usize,
    /// The picture's pixels that nobody sees; not asked where there is a lens.
    pub hidden: Option<Arc<BitMask>>,
    /// The lens that it is seen through.
    pub lens: Option<Arc<Lens>>,
}

impl PatternRequest {
    /// The pattern as the host makes it.
    pub fn on_host(&self) -> Pattern {
        let PatternRequest { view, law, gaze, count, .. } = self;
        match (&self.lens, &self.hidden) {
            (Some(lens), _) => Pattern::through(view, law, *gaze, *count, lens),
            (None, Some(hidden)) => Pattern::with_mask(view, law, *gaze, *count, hidden),
            (None, None) => Pattern::new(view, law, *gaze, *count),
        }
    }
}

/// Kernels that choose samples, and their memory.
pub struct PatternMaker {
    device: Device,
    kernels: Kernels,
    room: Room,
    ranks: Buffer<f32>,
    /// Work-items of a group that counts.
    group: usize,
    /// Finds neighbours where the presenting device does not.
    finder: Option<Finder>,
}

#[derive(Debug)]
struct Kernels {
    sample_keys: SampleKeys,
    count_keys: CountKeys,
    select_key: SelectKey,
    select_pixel: SelectPixel,
    mark_samples: MarkSamples,
    sum_counts: SumCounts,
    scan_sums: ScanSums,
    scan_counts: ScanCounts,
    list_samples: ListSamples,
}

/// Memory on the device, as large as patterns have needed.
#[derive(Debug)]
struct Room {
    columns: Buffer<f32>,
    rows: Buffer<[f32; 2]>,
    lens: Buffer<[f32; 2]>,
    repetitions: Buffer<f32>,
    places: Buffer<u32>,
    hidden: Buffer<u32>,
    order: Buffer<u32>,
    keys: Buffer<u32>,
    selection: Buffer<u32>,
    histogram: Buffer<u32>,
    marks: Buffer<u32>,
    counts: Buffer<u32>,
    sums: Buffer<u32>,
    starts: Buffer<u32>,
    samples: Buffer<u32>,
    sorted: Buffer<[u32; 2]>,
}

/// Makes a buffer large enough for `len` elements.
fn enlarge<T: bytemuck::Pod>(device: &Device, buffer: &mut Buffer<T>, len: usize) -> Result<()> {
    if buffer.len() < len {
        // A gaze that moves needs a few more here and there.
        *buffer = Buffer::new(device, len / 4 * 5 + 16)?;
    }
    Ok(())
}

/// Makes room for values and starts copying them there.
fn upload<T: bytemuck::Pod>(
    device: &Device,
    buffer: &mut Buffer<T>,
    values: Vec<T>,
) -> Result<Transfer<Vec<T>>> {
    enlarge(device, buffer, values.len())?;
    buffer.start_write(values)
}

impl PatternMaker {
    /// Builds the kernels.
    ///
    /// # Errors
    /// [`crate::Error::Kernel`] or [`crate::Error::Device`] where the device does not take them.
    pub fn new(device: &Device) -> Result<Self> {
        Self::with_group(device, if device.info().kind == "cpu" { 1 } else { 256 })
    }

    /// The same for one that also finds neighbours for a presenting device whose memory it sees, if it is the faster of the two.
    ///
    /// # Errors
    /// As [`PatternMaker::new`].
    pub fn with_neighbours(device: &Device, context: &Context, lists: NeighbourLists) -> Result<Self> {
        let finds = Neighbours::is_faster_on(device, context);
        let finder = finds.then(|| Finder::new(device, context, lists)).transpose()?;
        Ok(PatternMaker { finder, ..Self::new(device)? })
    }

    /// The same with groups of so many work-items that count.
    fn with_group(device: &Device, group: usize) -> Result<Self> {
        let text = source::pattern_text();
        let program = Program::build(device, "pattern", &text, &source::pattern_options(group))?;
        let ranks: Vec<f32> = blue_noise::ranks().iter().map(|&rank| f32::from(rank)).collect();
        Ok(PatternMaker {
            device: device.clone(),
            kernels: Kernels {
                sample_keys: SampleKeys::of(&program)?,
                count_keys: CountKeys::of(&program)?,
                select_key: SelectKey::of(&program)?,
                select_pixel: SelectPixel::of(&program)?,
                mark_samples: MarkSamples::of(&program)?,
                sum_counts: SumCounts::of(&program)?,
                scan_sums: ScanSums::of(&program)?,
                scan_counts: ScanCounts::of(&program)?,
                list_samples: ListSamples::of(&program)?,
            },
            room: Room::new(device)?,
            ranks: Buffer::from_slice(device, &ranks)?,
            group,
            finder: None,
        })
    }

    /// Chooses the pixels that are sampled, and sorts them into cells or finds their neighbours.
    ///
    /// # Errors
    /// [`crate::Error::Device`] where the device has no room, is lost, or lists what cannot be.
    pub fn choose(&mut self, wanted: &PatternRequest) -> Result<(Pattern, PatternTables)> {
        let (view, lens) = (&wanted.view, wanted.lens.as_deref());
        let hidden = wanted.hidden.as_deref().filter(|_| lens.is_none());
        let keys = Keys::new(view, &wanted.law, wanted.gaze, lens, hidden);
        let all = view.pixels().max(1);
        let asked = if wanted.law == Law::Full { all } else { wanted.count.clamp(1, all) };
        let shift = Cells::shift_for(view.width, view.height, asked);
        let [across, down] = Cells::counts(view.width, view.height, shift);
        let order = order::hilbert(view.width.div_ceil(TILE), view.height.div_ceil(TILE));
        let law = SampleLaw { cell_shift: shift, ..keys.law };
        let blocks = order.len() * BLOCKS;
        let counts = blocks + across as usize * down as usize;

        self.room.fit(&self.device, (view.pixels(), asked, blocks, counts))?;
        let uploads = self.upload(&keys, &order)?;
        self.enqueue(&keys, &law, (view.pixels(), asked, blocks, counts))?;
        let selection = self.room.selection.start_read(0, SELECTION)?;
        self.device.flush()?;
        let count = selection.into_memory()?[SELECTED] as usize;
        drop(uploads);
        if count > asked {
            return Err(self.impossible_list());
        }
        let found = self.find([view.width, view.height], count, blocks, shift)?;
        // In order: when the list is read, neighbours are found.
        let room = &self.room;
        let starts = room.starts.start_read(0, if found.is_some() { blocks } else { counts + 1 })?;
        let sorted = found.is_none().then(|| room.sorted.start_read(0, count)).transpose()?;
        let samples = room.samples.start_read(0, count)?;
        self.device.flush()?;
        let (samples, starts) = (samples.into_memory()?, starts.into_memory()?);
        let lists = [&starts[..blocks], &starts[blocks..]];
        let rises =
            |list: &&[u32]| list.is_sorted() && list.last().is_none_or(|&last| last as usize <= count);
        if !lists.iter().all(rises) {
            return Err(self.impossible_list());
        }
        let tiles: Vec<u32> = starts[..blocks].iter().step_by(BLOCKS).copied().collect();
        let pattern = Pattern::of_list(view, samples, order, &tiles);
        let tables = match (found, sorted) {
            (Some(found), _) => PatternTables::Neighbours(found),
            (None, sorted) => {
                let sorted = sorted.map_or(Ok(Vec::new()), Transfer::into_memory)?;
                PatternTables::Cells(Cells { sorted, starts: starts[blocks..].to_vec(), shift, across })
            }
        };
        Ok((pattern, tables))
    }

    fn impossible_list(&self) -> Error {
        let problem = "lists samples that cannot be; update its driver".to_string();
        Error::Device { device: self.device.info().name.clone(), problem }
    }

    /// Starts finding the neighbours of so many samples, whose cells begin at a place of `starts`.
    fn find(
        &mut self,
        size: [u32; 2],
        count: usize,
        first_start: usize,
        shift: u32,
    ) -> Result<Option<Arc<Neighbours>>> {
        let Some(finder) = &mut self.finder else { return Ok(None) };
        let Room { samples, sorted, starts, .. } = &self.room;
        let first_start = first_start as u32;
        finder.find(&SampleBuffers { size, count, samples, sorted, starts, first_start, shift })
    }

    /// Starts copying what keys come from; what is copied lives until the copies are done.
    fn upload(&mut self, keys: &Keys, order: &[u32]) -> Result<Uploads> {
        let (device, room) = (&self.device, &mut self.room);
        let words = keys.hidden.map(|hidden| bytemuck::cast_slice(hidden.words()).to_vec());
        let places = if words.is_some() { keys.places() } else { Vec::new() };
        let table = keys.lens.map(|lens| lens.table().to_vec());
        let pairs = [
            upload(device, &mut room.rows, keys.rows())?,
            upload(device, &mut room.lens, table.unwrap_or_default())?,
        ];
        let words = [
            upload(device, &mut room.places, places)?,
            upload(device, &mut room.hidden, words.unwrap_or_default())?,
            upload(device, &mut room.order, order.to_vec())?,
        ];
        let numbers = [
            upload(device, &mut room.columns, keys.columns())?,
            upload(device, &mut room.repetitions, keys.repetitions())?,
        ];
        Ok(Uploads { _pairs: pairs, _words: words, _numbers: numbers })
    }

    /// Puts the kernels into the queue.
    fn enqueue(
        &self,
        keys: &Keys,
        law: &SampleLaw,
        (pixels, asked, blocks, counts): (usize, usize, usize, usize),
    ) -> Result<()> {
        let (kernels, room) = (&self.kernels, &self.room);
        let groups = |items: usize| Grid { items, group: SCAN_GROUP };
        // A row of a repetition of the mask each.
        let rows = (law.width as usize).div_ceil(blue_noise::SIZE) * law.height as usize;
        kernels.sample_keys.launch(
            Grid { items: rows * self.group, group: self.group },
            law,
            &room.columns,
            &room.rows,
            keys.lens.map(|_| &room.lens),
            &self.ranks,
            &room.repetitions,
            &room.places,
            keys.hidden.map(|_| &room.hidden),
            &room.keys,
        )?;
        room.selection.fill_zero()?;
        room.histogram.fill_zero()?;
        room.counts.fill_zero()?;
        let count = pixels as u32;
        let counting = Grid { items: pixels.div_ceil(COUNTED) * self.group, group: self.group };
        for (shift, found) in PASSES {
            let (selection, histogram) = (&room.selection, &room.histogram);
            kernels.count_keys.launch(counting, &room.keys, count, shift, found, selection, histogram)?;
            let asked = if found == 32 { asked as u32 } else { 0 };
            kernels.select_key.launch(groups(SCAN_GROUP), shift, asked, count, selection, histogram)?;
        }
        kernels.select_pixel.launch(groups(SCAN_GROUP), &room.keys, count, &room.selection)?;
        let (order, marks, listed) = (&room.order, &room.marks, &room.counts);
        let block_count = blocks as u32;
        kernels.mark_samples.launch(
            groups(blocks),
            law,
            &room.keys,
            order,
            block_count,
            &room.selection,
            marks,
            listed,
        )?;
        let (runs, all) = (counts.div_ceil(SCAN_GROUP), counts as u32);
        kernels.sum_counts.launch(groups(runs), listed, all, &room.sums)?;
        kernels.scan_sums.launch(groups(SCAN_GROUP), &room.sums, runs as u32)?;
        let (sums, starts) = (&room.sums, &room.starts);
        kernels.scan_counts.launch(groups(runs), listed, all, block_count, sums, &room.selection, starts)?;
        let (samples, sorted) = (&room.samples, &room.sorted);
        kernels.list_samples.launch(
            groups(blocks),
            law,
            order,
            block_count,
            marks,
            starts,
            listed,
            samples,
            sorted,
        )?;
        Ok(())
    }
}

/// Copies under way.
struct Uploads {
    _pairs: [Transfer<Vec<[f32; 2]>>; 2],
    _words: [Transfer<Vec<u32>>; 3],
    _numbers: [Transfer<Vec<f32>>; 2],
}

impl Room {
    fn new(device: &Device) -> Result<Self> {
        Ok(Room {
            columns: Buffer::new(device, 1)?,
            rows: Buffer::new(device, 1)?,
            lens: Buffer::new(device, 1)?,
            repetitions: Buffer::new(device, 1)?,
            places: Buffer::new(device, 1)?,
            hidden: Buffer::new(device, 1)?,
            order: Buffer::new(device, 1)?,
            keys: Buffer::new(device, 1)?,
            selection: Buffer::new(device, SELECTION)?,
            histogram: Buffer::new(device, BINS)?,
            marks: Buffer::new(device, 1)?,
            counts: Buffer::new(device, 1)?,
            sums: Buffer::new(device, 1)?,
            starts: Buffer::new(device, 1)?,
            samples: Buffer::new(device, 1)?,
            sorted: Buffer::new(device, 1)?,
        })
    }

    fn fit(
        &mut self,
        device: &Device,
        (pixels, asked, blocks, counts): (usize, usize, usize, usize),
    ) -> Result<()> {
        enlarge(device, &mut self.keys, pixels)?;
        enlarge(device, &mut self.marks, blocks)?;
        enlarge(device, &mut self.counts, counts)?;
        enlarge(device, &mut self.sums, counts.div_ceil(SCAN_GROUP))?;
        enlarge(device, &mut self.starts, counts + 1)?;
        enlarge(device, &mut self.samples, asked)?;
        enlarge(device, &mut self.sorted, asked)
    }
}

#[cfg(test)]
pub(crate) mod testing {
    use crate::gpu::opencl::{Device, device};

    /// A processor, which rounds divisions and roots correctly; `None`, and a line that says so, where there is none. On
    /// machines that promise one (CI=true) that is a failure.
    pub fn processor() -> Option<Device> {
        let mut devices = device::list().into_iter();
        let Some(info) = devices.find(|info| info.unusable.is_none() && info.kind == "cpu") else {
            assert!(
                std::env::var("CI").as_deref() != Ok("true"),
                "there is no OpenCL device that is a processor"
            );
            println!("not run: there is no OpenCL device that is a processor");
            return None;
        };
        Some(Device::open(&info).unwrap())
    }
}
#[cfg(test)]
mod tests;
