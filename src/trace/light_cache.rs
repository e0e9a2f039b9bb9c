//! The cache of light that surfaces send, in a device's memory: see `kernels/shared/cache.h`.
//!
//! **A cache of light.** Reflected light rays that meet a surface look up what it sends. Cells are those of a
//! grid in the world, found by a hash of place, size and the side that the surface faces, as in SHaRC and in
//! kajiya's cache; they are between 1/32 and 1/16 of their distance from the eye in size, and young ones are
//! helped out by cells four times as large. In each frame short paths start at samples spread over the view,
//! pass up to three surfaces beyond the first, and bring each surface's cell its direct light and the
//! reflection of what the cache knows of the next one: over frames that is light of all bounces. Samples
//! count half after 64 steps, and earlier while the cell is young; the first frames make three steps each.
//! What is nearer than a quarter of a cell, and what smooth surfaces reflect, is not looked up but lit by one
//! more step, whose ray then looks up. A path also asks, along its surface, whether it sees a random place of
//! its cell: if not, a wall parts the cell, and cells half as large count there, up to three times; then a
//! step is made instead. So a floor that goes on under a wall lets no light through.
//!
//! Sums are integers of 64 bits in two words, added atomically and looked up from the next settling on, and a
//! step depends on the view and its number alone. So devices that trace parts of a view need not exchange
//! anything: each makes all steps for itself, which is a small part of a frame, and all know the same, bit by
//! bit. One that has missed frames makes up for the last 96 steps; until its older samples have faded it may
//! differ from the others within the cache's noise. So may what another has left undone and a device does that has begun
//! with the next view already: its cache is a step ahead.

mod cells;

use crate::error::Result;
use crate::gpu::opencl::{Buffer, Device, Event, Program};
use crate::layout::{CACHE_CELLS, CacheCell, CacheInfo, CacheSum, Camera, Shading};

use super::kernels::{ForgetCells, Grid, SceneOf, SettleCells};
use super::{SceneBuffers, TracePattern, Traversal};
use cells::{CellLight, Seen};

/// Paths that bring light to the cache in each frame of a view while it is new: fewer learn a view too slowly, however
/// small it is.
const PATHS: u32 = 3072;
/// The same later, when most of what is seen is known.
const LATER_PATHS: u32 = 1536;
/// Frames of views after which a cache is no longer new.
const NEW: u64 = 48;
/// After so many frames what a path has brought counts half as much.
const HALF_LIFE: f32 = 64.0;
/// The same where things move: light that has changed is forgotten sooner, at the price of more noise.
const MOVING_HALF_LIFE: f32 = 12.0;
/// A cell that no path has passed for so many frames is given up.
const LIFETIME: u32 = 512;
/// Work-items that forget and settle cells.
const SETTLERS: usize = 64;

/// What a kernel is given that looks the cache up: it as a whole, keys and cells.
pub(super) type LookedUp<'a> = (&'a CacheInfo, Option<&'a Buffer<u32>>, Option<&'a Buffer<CacheCell>>);

/// A device's cache and its kernels.
#[derive(Debug)]
pub(super) struct LightCache {
    cell_light: CellLight,
    settle_cells: SettleCells,
    forget_cells: ForgetCells,
    traversal: Traversal,
    /// Frames after which what a path has brought counts half, where the sky stands still.
    half_life: f32,
    /// Made when it is first used.
    memory: Option<Memory>,
    info: CacheInfo,
}

#[derive(Debug)]
struct Memory {
    keys: Buffer<u32>,
    cells: Buffer<CacheCell>,
    sums: Buffer<CacheSum>,
    touched: Buffer<u32>,
}

/// What counts the work for a view.
#[derive(Clone, Copy)]
pub(super) struct Counters<'a> {
    /// Light rays, samples that were dropped, the cache's rays, and cells that a step of it has touched.
    pub words: &'a Buffer<u32>,
    /// Whether the view begins with this step.
    pub begins: bool,
}

impl LightCache {
    /// An empty cache for the kernels of a program, whose variant is `traversal`.
    pub fn new(program: &Program, traversal: Traversal, scene: &SceneBuffers) -> Result<Self> {
        Ok(LightCache {
            cell_light: CellLight::of(program, traversal)?,
            settle_cells: SettleCells::of(program)?,
            forget_cells: ForgetCells::of(program)?,
            traversal,
            half_life: HALF_LIFE,
            memory: None,
            info: CacheInfo {
                frame: 0,
                paths: PATHS,
                half_life: HALF_LIFE,
                lifetime: LIFETIME,
                ..scene.cache
            },
        })
    }

    /// From now on things move, and light changes with them.
    pub fn follow_motion(&mut self) {
        self.half_life = MOVING_HALF_LIFE;
        self.info.half_life = self.info.half_life.min(MOVING_HALF_LIFE);
    }

    /// From now on the sky's light changes so fast that so many frames are half of a memory.
    pub fn follow_sky(&mut self, half_life: f32) {
        self.info.half_life = self.half_life.min(half_life);
    }

    /// Nothing is known from now on; memory is made anew when it is used next, since work under way may still need this one.
    pub fn forget(&mut self) {
        self.memory = None;
    }

    /// Has its memory, where nothing is known until there are steps.
    pub fn reserve(&mut self, device: &Device) -> Result<()> {
        if self.memory.is_none() {
            self.memory = Some(Memory::new(device)?);
        }
        Ok(())
    }

    /// What a kernel is given that looks the cache up: it as a whole, keys and cells.
    pub fn looked_up(&self) -> LookedUp<'_> {
        let memory = self.memory.as_ref();
        (&self.info, memory.map(|m| &m.keys), memory.map(|m| &m.cells))
    }

    /// Brings light for one more frame, the `step`-th of all; camera and samples say where it is wanted. The events of
    /// its kernels.
    #[allow(clippy::too_many_arguments)]
    pub fn update(
        &mut self,
        device: &Device,
        scene: &SceneBuffers,
        camera: &Camera,
        shading: &Shading,
        pattern: &TracePattern,
        step: u64,
        counters: Counters,
    ) -> Result<Vec<Event>> {
        self.reserve(device)?;
        self.info.frame = step as u32;
        self.info.paths = if step < NEW { PATHS } else { LATER_PATHS };
        let (info, group) = (&self.info, self.traversal.group());
        let Some(memory) = &self.memory else { unreachable!("it has been reserved") };
        let Memory { keys, cells, sums, touched } = memory;
        let Counters { words, begins } = counters;
        let settlers = Grid { items: SETTLERS, group };
        let mut events = vec![self.forget_cells.launch(settlers, info, keys, cells, begins.into(), words)?];
        let seen = Seen { scene: SceneOf(Some(scene), self.traversal), camera, shading, pattern };
        events.extend(self.cell_light.enqueue(device, seen, info, (memory, words))?);
        events.push(self.settle_cells.launch(settlers, info, cells, sums, touched, words)?);
        Ok(events)
    }

    /// The memory that paths under way need on GPUs, in bytes, where each surface asks so many punctual lights.
    pub fn bytes_under_way(lights: u32) -> u64 {
        cells::bytes_under_way(lights)
    }

    /// The names of kernels of a variant that may need memory of their own.
    pub fn kernels(traversal: Traversal) -> &'static [&'static str] {
        CellLight::kernels(traversal)
    }
}

impl Memory {
    fn new(device: &Device) -> Result<Self> {
        let cells = CACHE_CELLS as usize;
        Ok(Memory {
            keys: Buffer::zeroed(device, cells)?,
            cells: Buffer::zeroed(device, cells)?,
            sums: Buffer::zeroed(device, cells)?,
            touched: Buffer::new(device, cells)?,
        })
    }
}
